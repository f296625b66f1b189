//! The walls found so far: lines of one scan after another, joined where they are the same.

use foxhound_core::mapping::walls::Wall;

/// Lines.
#[derive(Clone, Debug, Default)]
pub(super) struct Walls {
    lines: Vec<Wall>,
}

/// Two lines whose normals agree so well,
const SAME_COSINE: f32 = 0.985;
/// and of which the one's ends are so close to the other,
const SAME_M: f32 = 0.25;
/// with a gap no wider than that, are one.
const GAP_M: f32 = 0.4;

impl Walls {
    /// All.
    pub(super) fn lines(&self) -> &[Wall] {
        &self.lines
    }

    /// Adds a line, or joins it to one that is the same.
    pub(super) fn add(&mut self, line: Wall) {
        for known in &mut self.lines {
            let [long, short] = if length_m(known) >= length_m(&line) { [*known, line] } else { [line, *known] };
            let ends = short.ends_ned_m();
            let is_same = long.normal_ned.dot(short.normal_ned).abs() > SAME_COSINE
                && ends.iter().all(|end| long.distance_m(*end).abs() < SAME_M);
            let along = ends.map(|end| long.along_ned().dot(end));
            let (from_m, to_m) = (along[0].min(along[1]), along[0].max(along[1]));
            if is_same && from_m < long.to_m + GAP_M && to_m > long.from_m - GAP_M {
                *known = Wall { from_m: long.from_m.min(from_m), to_m: long.to_m.max(to_m), ..long };
                return;
            }
        }
        self.lines.push(line);
    }
}

fn length_m(line: &Wall) -> f32 {
    line.to_m - line.from_m
}
