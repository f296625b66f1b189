//! How a wave travels from the beacon to a receiver among walls: directly, and by reflections.
//!
//! Geometrical optics in the horizontal plane by the image method (Allen and Berkley 1979): mirrored in one wall
//! after another, the beacon has an image for every order of reflections, and the path to it is straight. A path
//! exists if every reflection point is on its wall; each reflection costs the wall's reflection loss, each wall in
//! the way its passage loss.

use super::geometry::Horizontal;

/// A vertical wall, metres, NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// One end.
    pub from: Horizontal,
    /// The other.
    pub to: Horizontal,
    /// Loss of a reflection.
    pub reflection_db: f64,
    /// Loss of a passage.
    pub passage_db: f64,
}

/// Most reflections of a path.
pub const ORDER_MAX: usize = 3;

/// A path from the beacon to the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Path {
    /// Apparent position of the beacon: its image, or itself.
    pub image: Horizontal,
    /// Number of reflections.
    pub order: usize,
    /// Loss by reflections and walls in the way, without that by distance.
    pub loss_db: f64,
    /// Length.
    pub length_m: f64,
    /// The last reflection point, as seen from the beacon.
    pub last_bounce: Option<Horizontal>,
}

impl Path {
    /// Bearing of the wave's arrival, from north, clockwise.
    #[must_use]
    pub fn bearing_rad(&self, listener: Horizontal) -> f64 {
        self.image.minus(listener).bearing_rad()
    }

    /// Power at the receiver, relative to the free wave at one metre.
    #[must_use]
    pub fn gain_db(&self) -> f64 {
        -self.loss_db - 20.0 * libm::log10(self.length_m.max(0.1))
    }
}

impl Wall {
    /// The mirror image of a point.
    #[must_use]
    pub fn mirror(&self, point: Horizontal) -> Horizontal {
        let along = self.to.minus(self.from);
        let square = along.dot(along);
        if square <= 0.0 {
            return point;
        }
        let foot = self.from.along(along, point.minus(self.from).dot(along) / square);
        foot.along(foot.minus(point), 1.0)
    }

    /// Where a leg from `a` to `b` crosses the wall, as a share of the leg.
    #[must_use]
    pub fn crossing(&self, a: Horizontal, b: Horizontal) -> Option<f64> {
        let (leg, wall, gap) = (b.minus(a), self.to.minus(self.from), self.from.minus(a));
        let cross = |u: Horizontal, v: Horizontal| u.north * v.east - u.east * v.north;
        let determinant = cross(leg, wall);
        if determinant.abs() < 1e-12 {
            return None;
        }
        let (on_leg, on_wall) = (cross(gap, wall) / determinant, cross(gap, leg) / determinant);
        ((0.0..=1.0).contains(&on_leg) && (0.0..=1.0).contains(&on_wall)).then_some(on_leg)
    }
}

/// All paths of up to `order_max` reflections with a loss of at most `loss_max_db`, the strongest at the receiver
/// first.
#[must_use]
pub fn paths(
    walls: &[Wall],
    source: Horizontal,
    listener: Horizontal,
    order_max: usize,
    loss_max_db: f64,
) -> Vec<Path> {
    let search = Search { walls, listener, order_max: order_max.min(ORDER_MAX), loss_max_db };
    let mut found = Vec::new();
    search.extend(&mut vec![source], &mut Vec::new(), 0.0, &mut found);
    found.sort_by(|a, b| b.gain_db().total_cmp(&a.gain_db()));
    found
}

struct Search<'a> {
    walls: &'a [Wall],
    listener: Horizontal,
    order_max: usize,
    loss_max_db: f64,
}

impl Search<'_> {
    /// Tries the images so far, and one more mirror. `mirrors` are the indices of the walls, `loss_db` their loss.
    fn extend(&self, images: &mut Vec<Horizontal>, mirrors: &mut Vec<usize>, loss_db: f64, found: &mut Vec<Path>) {
        if let Some(path) = self.trace(images, mirrors, loss_db) {
            found.push(path);
        }
        if mirrors.len() == self.order_max {
            return;
        }
        let Some(image) = images.last().copied() else { return };
        for (index, wall) in self.walls.iter().enumerate() {
            let loss_db = loss_db + wall.reflection_db;
            if mirrors.last() == Some(&index) || loss_db > self.loss_max_db {
                continue;
            }
            images.push(wall.mirror(image));
            mirrors.push(index);
            self.extend(images, mirrors, loss_db, found);
            images.pop();
            mirrors.pop();
        }
    }

    /// The path back from the receiver through all mirrors, if it exists.
    fn trace(&self, images: &[Horizontal], mirrors: &[usize], reflections_db: f64) -> Option<Path> {
        let image = *images.last()?;
        let (mut at, mut loss_db, mut last_bounce) = (self.listener, reflections_db, None);
        let mut left: Option<usize> = None;
        for (order, mirror) in mirrors.iter().enumerate().rev() {
            let towards = images[order + 1];
            let share = self.walls[*mirror].crossing(at, towards)?;
            let bounce = at.along(towards.minus(at), share);
            last_bounce = last_bounce.or(Some(bounce));
            loss_db += self.passages_db(at, bounce, [left, Some(*mirror)]);
            (at, left) = (bounce, Some(*mirror));
        }
        loss_db += self.passages_db(at, images[0], [left, None]);
        let length_m = image.minus(self.listener).norm();
        (loss_db <= self.loss_max_db).then_some(Path { image, order: mirrors.len(), loss_db, length_m, last_bounce })
    }

    /// Loss of the walls between two points, except those at which the leg begins and ends.
    fn passages_db(&self, a: Horizontal, b: Horizontal, ends: [Option<usize>; 2]) -> f64 {
        let between = self.walls.iter().enumerate().filter(|(index, _)| !ends.contains(&Some(*index)));
        between.filter(|(_, wall)| wall.crossing(a, b).is_some()).map(|(_, wall)| wall.passage_db).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(east: f64, north: f64) -> Horizontal {
        Horizontal { north, east }
    }

    fn wall(from: [f64; 2], to: [f64; 2]) -> Wall {
        Wall { from: at(from[0], from[1]), to: at(to[0], to[1]), reflection_db: 6.0, passage_db: 40.0 }
    }

    #[test]
    fn a_corner_gives_one_direct_two_single_and_one_double_reflection() {
        // Walls on the axes, both ends in the first quadrant: the images are the four sign changes.
        let walls = [wall([-20.0, 0.0], [20.0, 0.0]), wall([0.0, -20.0], [0.0, 20.0])];
        let found = paths(&walls, at(3.0, 1.0), at(1.0, 4.0), 2, 30.0);
        let mut images: Vec<(usize, i32, i32)> =
            found.iter().map(|p| (p.order, p.image.east.round() as i32, p.image.north.round() as i32)).collect();
        images.sort_unstable();
        assert_eq!(images, [(0, 3, 1), (1, -3, 1), (1, 3, -1), (2, -3, -1)]);
        assert_eq!(found[0].order, 0, "the direct wave is the strongest");
        for path in &found {
            assert!((path.length_m - path.image.minus(at(1.0, 4.0)).norm()).abs() < 1e-9);
            assert!((path.loss_db - 6.0 * path.order as f64).abs() < 1e-9);
        }
    }

    #[test]
    fn a_reflection_obeys_the_law_and_needs_its_wall() {
        let long = wall([-5.0, 3.0], [15.0, 3.0]);
        let found = paths(&[long], at(0.0, 0.0), at(6.0, 1.0), 1, 30.0);
        let bounce = found.iter().find(|p| p.order == 1).unwrap().last_bounce.unwrap();
        // Equal slopes on both sides: 3 up from the source, 2 from the listener.
        assert!((bounce.north - 3.0).abs() < 1e-9 && (bounce.east / 3.0 - (6.0 - bounce.east) / 2.0).abs() < 1e-9);
        let short = wall([-5.0, 3.0], [bounce.east - 0.1, 3.0]);
        assert_eq!(paths(&[short], at(0.0, 0.0), at(6.0, 1.0), 1, 30.0).len(), 1);
    }

    #[test]
    fn a_wall_in_the_way_takes_its_share() {
        let walls = [wall([3.0, -1.0], [3.0, 1.0])];
        let direct = |loss_max_db| paths(&walls, at(0.0, 0.0), at(6.0, 0.0), 0, loss_max_db);
        assert!(direct(30.0).is_empty());
        assert_eq!(direct(50.0)[0].loss_db, 40.0);
        assert_eq!(paths(&walls, at(0.0, 0.0), at(6.0, 5.0), 0, 30.0)[0].loss_db, 0.0);
    }
}
