//! The parts of a map.

/// A pillar: x, y, radius.
pub type Pillar = [f64; 3];
/// Start x and y, goal x and y, length of the shortest path.
pub type Pair = [f64; 5];
