//! What a map is made of.

/// A pillar: x, y, radius.
pub type Pillar = [f64; 3];
/// Start x and y, goal x and y, length of the shortest way.
pub type Pair = [f64; 5];
