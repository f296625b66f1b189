//! Random scenes: yards with some walls, and floors of rooms.

use crate::world::Horizontal;
use crate::world::random::Random;
use crate::world::rays::Wall;

/// A beacon among walls.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    pub(super) walls: Vec<Wall>,
    /// North and east of all of it; the corner is the origin.
    pub(super) size_m: [f64; 2],
    pub(super) source: Horizontal,
    /// Its height over the vehicle's.
    pub(super) source_above_m: f64,
    /// Signal-to-noise ratio per sample that the free wave would have at one metre.
    pub(super) snr_at_1m_db: f64,
}

/// Uniform.
pub(super) fn within(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.uniform()
}

/// One of `0..count`.
fn choice(random: &mut Random, count: usize) -> usize {
    ((random.uniform() * count as f64) as usize).min(count - 1)
}

impl Scene {
    /// Draws one: half of them are yards.
    pub(super) fn draw(random: &mut Random) -> Self {
        let (walls, size_m) = if random.uniform() < 0.5 { yard(random) } else { floor(random) };
        let margin = 0.5;
        let mut source = Horizontal { north: size_m[0] / 2.0, east: size_m[1] / 2.0 };
        for _ in 0..20 {
            source = Horizontal {
                north: within(random, margin, size_m[0] - margin),
                east: within(random, margin, size_m[1] - margin),
            };
            if clearance_m(&walls, source) > margin {
                break;
            }
        }
        Self {
            walls,
            size_m,
            source,
            source_above_m: within(random, -1.5, 1.0),
            snr_at_1m_db: (38.0 + 7.0 * random.gaussian()).clamp(20.0, 55.0),
        }
    }

    /// Distance to the nearest wall.
    pub(super) fn clearance_m(&self, place: Horizontal) -> f64 {
        clearance_m(&self.walls, place)
    }
}

/// One material for all outer walls of a scene, another for the rest.
fn material(random: &mut Random, passage_db: [f64; 2]) -> [f64; 2] {
    [within(random, 3.0, 10.0), within(random, passage_db[0], passage_db[1])]
}

fn wall([from, to]: [[f64; 2]; 2], [reflection_db, passage_db]: [f64; 2]) -> Wall {
    let at = |[north, east]: [f64; 2]| Horizontal { north, east };
    Wall { from: at(from), to: at(to), reflection_db, passage_db }
}

/// One to six walls in the open.
fn yard(random: &mut Random) -> (Vec<Wall>, [f64; 2]) {
    let side = within(random, 15.0, 35.0);
    let count = 1 + choice(random, 6);
    let walls = (0..count).map(|_| {
        let middle = [within(random, 0.0, side), within(random, 0.0, side)];
        let (half, angle) = (within(random, 1.5, 8.0), within(random, 0.0, std::f64::consts::PI));
        let step = [half * libm::cos(angle), half * libm::sin(angle)];
        let ends = [[middle[0] - step[0], middle[1] - step[1]], [middle[0] + step[0], middle[1] + step[1]]];
        wall(ends, material(random, [15.0, 50.0]))
    });
    (walls.collect(), [side, side])
}

/// Four outer walls and one to three partitions, each with a door.
fn floor(random: &mut Random) -> (Vec<Wall>, [f64; 2]) {
    let [n, e] = [within(random, 8.0, 20.0), within(random, 8.0, 25.0)];
    let outer = material(random, [15.0, 40.0]);
    let ends = [[[0.0, 0.0], [n, 0.0]], [[n, 0.0], [n, e]], [[n, e], [0.0, e]], [[0.0, e], [0.0, 0.0]]];
    let mut walls: Vec<Wall> = ends.map(|ends| wall(ends, outer)).to_vec();
    let inner = material(random, [6.0, 40.0]);
    for _ in 0..=choice(random, 3) {
        let swap = random.uniform() < 0.5;
        let [long, wide] = if swap { [e, n] } else { [n, e] };
        let at = within(random, 0.2, 0.8) * wide;
        let door = within(random, 0.8, 2.5);
        let from = within(random, 0.0, long - door);
        for [a, b] in [[0.0, from], [from + door, long]] {
            if b - a > 0.3 {
                let ends = if swap { [[at, a], [at, b]] } else { [[a, at], [b, at]] };
                walls.push(wall(ends, inner));
            }
        }
    }
    (walls, [n, e])
}

fn clearance_m(walls: &[Wall], place: Horizontal) -> f64 {
    let distance = |wall: &Wall| {
        let along = wall.to.minus(wall.from);
        let share = (place.minus(wall.from).dot(along) / along.dot(along).max(1e-9)).clamp(0.0, 1.0);
        place.minus(wall.from.along(along, share)).norm()
    };
    walls.iter().map(distance).fold(f64::INFINITY, f64::min)
}
