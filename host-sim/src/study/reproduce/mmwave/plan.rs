//! Floor plans: rooms, corridors and doors made of walls, with furniture, drawn by a seed.
//!
//! A rectangle is cut in two by a wall with a door, each part again until rooms are small enough; every other plan begins
//! with a corridor. A door is never where a later wall ends. Boxes at any angle stand free in the rooms. Walls have no
//! thickness; whether everything can be reached is checked by [`super::known`] when scenarios are drawn.

use crate::world::Horizontal;
use crate::world::random::Random;
use crate::world::rays::Wall;

/// What a reflection loses. Printed ranges for plasterboard, concrete and glass at 28 GHz are 6 to 10 dB.
const REFLECTION_DB: f64 = 8.0;
/// What a passage loses: a wall or a cupboard is the end of a direct wave.
const PASSAGE_DB: f64 = 60.0;
/// Sides of a plan.
const SIDE_M: [f64; 2] = [20.0, 30.0];
/// Shortest side of a room.
const ROOM_MIN_M: f64 = 3.2;
/// A room larger than this is cut for sure; a smaller one by chance.
const ROOM_AREA_M2: f64 = 45.0;
const DOOR_M: [f64; 2] = [1.0, 1.5];
const CORRIDOR_M: [f64; 2] = [1.8, 2.4];
/// Walls end no closer to a door than this.
const DOOR_GAP_M: f64 = 0.3;
/// Passage left around furniture.
const FURNITURE_GAP_M: f64 = 0.9;

/// A plan.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// East and north; the south-western corner is the origin.
    pub(super) size_m: [f64; 2],
    /// Walls and the sides of furniture.
    pub(super) walls: Vec<Wall>,
}

/// A rectangle: west, south, east, north.
type Rectangle = [f64; 4];

/// A wall while a plan is drawn: where it is (across its axis), and its doors along it.
struct Drawn {
    /// 0 along east, 1 along north.
    axis: usize,
    across: f64,
    from: f64,
    to: f64,
    doors: Vec<[f64; 2]>,
}

impl Plan {
    /// Draws a plan.
    pub(super) fn draw(seed: u64, corridor: bool) -> Self {
        let mut random = Random::new(seed, 1);
        let size_m = [0, 1].map(|_| within(&mut random, SIDE_M));
        let mut drawn = Vec::new();
        let whole = [0.0, 0.0, size_m[0], size_m[1]];
        for (axis, across) in [(0, 0.0), (0, size_m[1]), (1, 0.0), (1, size_m[0])] {
            drawn.push(Drawn { axis, across, from: 0.0, to: size_m[axis], doors: Vec::new() });
        }
        if corridor {
            add_corridor(&mut random, whole, &mut drawn);
        } else {
            cut(&mut random, whole, &mut drawn);
        }
        let mut walls: Vec<Wall> = drawn.iter().flat_map(Drawn::pieces).collect();
        furnish(&mut random, size_m, &drawn, &mut walls);
        Self { size_m, walls }
    }

    /// Distance from a point to the nearest wall.
    pub(super) fn room_m(&self, point: Horizontal) -> f64 {
        self.walls.iter().map(|wall| distance_m(wall, point)).fold(f64::INFINITY, f64::min)
    }

    /// The point of the walls nearest to a place.
    pub(super) fn nearest_of_walls(&self, place: Horizontal) -> Horizontal {
        let points = self.walls.iter().map(|wall| nearest(wall, place));
        points.min_by(|a, b| a.minus(place).norm().total_cmp(&b.minus(place).norm())).unwrap_or(place)
    }

    /// A place for something with this much space around it.
    pub(super) fn place(&self, random: &mut Random, room_m: f64) -> Horizontal {
        loop {
            let place = Horizontal::from_xy(self.size_m.map(|side_m| side_m * random.uniform()));
            if self.room_m(place) >= room_m {
                return place;
            }
        }
    }

    /// Whether a straight leg meets a wall.
    pub(super) fn is_clear(&self, a: Horizontal, b: Horizontal) -> bool {
        self.walls.iter().all(|wall| wall.crossing(a, b).is_none())
    }
}

/// The point of a wall nearest to another.
fn nearest(wall: &Wall, point: Horizontal) -> Horizontal {
    let along = wall.to.minus(wall.from);
    let square = along.dot(along);
    let share = if square > 0.0 { (point.minus(wall.from).dot(along) / square).clamp(0.0, 1.0) } else { 0.0 };
    wall.from.along(along, share)
}

/// Distance from a wall to a point.
pub(super) fn distance_m(wall: &Wall, point: Horizontal) -> f64 {
    point.minus(nearest(wall, point)).norm()
}

fn within(random: &mut Random, [from, to]: [f64; 2]) -> f64 {
    from + (to - from) * random.uniform()
}

fn wall(from: [f64; 2], to: [f64; 2]) -> Wall {
    let [from, to] = [from, to].map(Horizontal::from_xy);
    Wall { from, to, reflection_db: REFLECTION_DB, passage_db: PASSAGE_DB }
}

impl Drawn {
    fn point(&self, along: f64) -> [f64; 2] {
        if self.axis == 0 { [along, self.across] } else { [self.across, along] }
    }

    /// What is left between the doors.
    fn pieces(&self) -> Vec<Wall> {
        let mut doors = self.doors.clone();
        doors.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut pieces = Vec::new();
        let mut from = self.from;
        for [begin, end] in doors.into_iter().chain([[self.to, self.to]]) {
            if begin - from > 1e-9 {
                pieces.push(wall(self.point(from), self.point(begin)));
            }
            from = end;
        }
        pieces
    }

    /// Puts a door somewhere within a stretch, if it fits.
    fn open(&mut self, random: &mut Random, [from, to]: [f64; 2]) {
        let width_m = within(random, DOOR_M);
        let room = [from + DOOR_GAP_M, to - DOOR_GAP_M - width_m];
        if room[1] > room[0] {
            let begin = within(random, room);
            let end = begin + width_m;
            if self.doors.iter().all(|door| begin > door[1] + DOOR_GAP_M || end < door[0] - DOOR_GAP_M) {
                self.doors.push([begin, end]);
            }
        }
    }
}

/// A corridor across the middle, with doors on both sides, and rooms beyond.
fn add_corridor(random: &mut Random, whole: Rectangle, drawn: &mut Vec<Drawn>) {
    let axis = usize::from(random.uniform() < 0.5);
    let (length, depth) = (whole[2 + axis], whole[3 - axis]);
    let width_m = within(random, CORRIDOR_M);
    let near = within(random, [0.35 * depth, 0.6 * depth - width_m]);
    let mut begin = drawn.len();
    for across in [near, near + width_m] {
        drawn.push(Drawn { axis, across, from: 0.0, to: length, doors: Vec::new() });
    }
    for (low, high) in [(0.0, near), (near + width_m, depth)] {
        let mut rectangle = whole;
        (rectangle[1 - axis], rectangle[3 - axis]) = (low, high);
        // Doors first, so that the rooms' walls keep clear of them.
        let stretches = libm::floor(length / 6.0) as usize;
        for stretch in 0..stretches {
            let [from, to] = [stretch, stretch + 1].map(|k| length * k as f64 / stretches as f64);
            drawn[begin].open(random, [from, to]);
        }
        begin += 1;
        cut(random, rectangle, drawn);
    }
}

/// Cuts a rectangle in two by a wall with a door, and its parts again.
fn cut(random: &mut Random, rectangle: Rectangle, drawn: &mut Vec<Drawn>) {
    let sides = [rectangle[2] - rectangle[0], rectangle[3] - rectangle[1]];
    let is_large = sides[0] * sides[1] > ROOM_AREA_M2;
    if !is_large && random.uniform() < 0.7 {
        return;
    }
    // The wall runs across the longer side.
    let long = usize::from(sides[1] > sides[0]);
    let axis = 1 - long;
    if sides[long] < 2.0 * ROOM_MIN_M {
        return;
    }
    let [from, to] = [rectangle[axis], rectangle[axis + 2]];
    for _ in 0..20 {
        let across = within(random, [rectangle[long] + ROOM_MIN_M, rectangle[long + 2] - ROOM_MIN_M]);
        let meets_door = |wall: &Drawn| {
            let ends_here = wall.axis == long && [from, to].iter().any(|end| (wall.across - end).abs() < 1e-9);
            ends_here && wall.doors.iter().any(|door| across > door[0] - DOOR_GAP_M && across < door[1] + DOOR_GAP_M)
        };
        if drawn.iter().any(meets_door) {
            continue;
        }
        let mut new = Drawn { axis, across, from, to, doors: Vec::new() };
        new.open(random, [from, to]);
        if to - from > 7.0 && random.uniform() < 0.5 {
            new.open(random, [from, to]);
        }
        drawn.push(new);
        for part in [[rectangle[long], across], [across, rectangle[long + 2]]] {
            let mut room = rectangle;
            [room[long], room[long + 2]] = part;
            cut(random, room, drawn);
        }
        return;
    }
}

/// Boxes that leave a passage around them, and stay away from doors.
fn furnish(random: &mut Random, size_m: [f64; 2], drawn: &[Drawn], walls: &mut Vec<Wall>) {
    let doors: Vec<Horizontal> = drawn
        .iter()
        .flat_map(|wall| wall.doors.iter().map(|door| Horizontal::from_xy(wall.point(0.5 * (door[0] + door[1])))))
        .collect();
    let wanted = libm::rint(size_m[0] * size_m[1] / 60.0) as usize;
    let mut placed = 0;
    for _ in 0..400 {
        if placed == wanted {
            break;
        }
        let center = Horizontal::from_xy(size_m.map(|side_m| side_m * random.uniform()));
        let [half_long, half_wide] = [within(random, [0.4, 1.0]), within(random, [0.25, 0.5])];
        let along = Horizontal::from_bearing(std::f64::consts::PI * random.uniform());
        let across = Horizontal { north: -along.east, east: along.north };
        let corner = |a: f64, b: f64| center.along(along, a * half_long).along(across, b * half_wide);
        let corners = [corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0), corner(-1.0, 1.0)];
        let reach_m = libm::hypot(half_long, half_wide);
        let is_free = walls.iter().all(|wall| distance_m(wall, center) > reach_m + FURNITURE_GAP_M)
            && doors.iter().all(|door| door.minus(center).norm() > reach_m + FURNITURE_GAP_M + 0.5);
        if is_free {
            placed += 1;
            for (k, from) in corners.iter().enumerate() {
                let to = corners[(k + 1) % 4];
                walls.push(Wall { from: *from, to, reflection_db: REFLECTION_DB, passage_db: PASSAGE_DB });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plans_are_rooms_with_doors_and_furniture() {
        for seed in 0..20 {
            let plan = Plan::draw(seed, seed % 2 == 0);
            let area_m2 = plan.size_m[0] * plan.size_m[1];
            assert!((400.0..=900.0).contains(&area_m2), "{area_m2}");
            assert!(plan.walls.len() >= 30, "seed {seed}: {} walls", plan.walls.len());
            assert!(plan.walls.len() <= 140, "seed {seed}: {} walls", plan.walls.len());
            let again = Plan::draw(seed, seed % 2 == 0);
            assert_eq!(plan.walls, again.walls);
        }
    }
}
