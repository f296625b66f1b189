//! A line of reflection: its position, its extent, and the mirror images of points and directions in it.
//!
//! The paper's `y = m x + c` (eq. 5) cannot represent vertical walls. Here a line is stored as its unit normal and its
//! distance from the origin (Hesse normal form), `n . p = offset`, which exists for every wall and varies smoothly as a
//! wall turns.
//!
//! By the law of reflection (eq. 4) a ray that is reflected once seems to come straight from the mirror image of its
//! origin. So a vehicle that receives a reflection sees what its own mirror image sees directly: with position and
//! direction mirrored, every line-of-sight formula is valid. Eq. 6 and 7 are equivalent (`foxhound-papers` has them
//! literally; a test compares).

use crate::base::ned::Horizontal;

/// A wall that reflects.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Wall {
    /// Unit normal; either of the two opposite ones.
    pub normal_ned: Horizontal,
    /// `normal . p` of its points.
    pub offset_m: f32,
    /// Where it begins and ends along [`Wall::along_ned`], measured from the foot of the origin's perpendicular.
    pub from_m: f32,
    /// See `from_m`; not less than that.
    pub to_m: f32,
}

impl Wall {
    /// The line between two points; `None` if they are equal or not finite.
    #[must_use]
    pub fn between(a_ned_m: Horizontal, b_ned_m: Horizontal) -> Option<Self> {
        let along = b_ned_m.minus(a_ned_m);
        let length_m = along.norm();
        if !(length_m > 1e-6 && length_m.is_finite()) {
            return None;
        }
        let along = along.times(1.0 / length_m);
        let normal_ned = Horizontal { north: -along.east, east: along.north };
        let from_m = along.dot(a_ned_m);
        Some(Self { normal_ned, offset_m: normal_ned.dot(a_ned_m), from_m, to_m: from_m + length_m })
    }

    /// Whether its normal is a unit vector and its offset plausible.
    #[must_use]
    #[inline]
    pub fn is_valid(&self) -> bool {
        let norm2 = self.normal_ned.norm_squared();
        norm2 > 0.999 && norm2 < 1.001 && libm::fabsf(self.offset_m) < 1e6
    }

    /// Unit vector along the line, from its beginning to its end.
    #[must_use]
    pub fn along_ned(&self) -> Horizontal {
        Horizontal { north: self.normal_ned.east, east: -self.normal_ned.north }
    }

    /// Its beginning and its end.
    #[must_use]
    pub fn ends_ned_m(&self) -> [Horizontal; 2] {
        let foot = self.normal_ned.times(self.offset_m);
        [self.from_m, self.to_m].map(|along_m| foot.plus(self.along_ned().times(along_m)))
    }

    /// Signed distance of a point from the line, positive on the side of the normal.
    #[must_use]
    #[inline]
    pub fn distance_m(&self, point_ned_m: Horizontal) -> f32 {
        self.normal_ned.dot(point_ned_m) - self.offset_m
    }

    /// The mirror image of a point.
    #[must_use]
    #[inline]
    pub fn mirror(&self, point_ned_m: Horizontal) -> Horizontal {
        point_ned_m.minus(self.normal_ned.times(2.0 * self.distance_m(point_ned_m)))
    }

    /// The mirror image of a direction.
    #[must_use]
    #[inline]
    pub fn mirror_direction(&self, direction_ned: Horizontal) -> Horizontal {
        direction_ned.minus(self.normal_ned.times(2.0 * self.normal_ned.dot(direction_ned)))
    }

    /// Distance along a ray at which it meets the line, within the line's extent widened by `slack_m` at both ends;
    /// `None` if it does not.
    #[must_use]
    pub fn range_along_m(&self, from_ned_m: Horizontal, direction_ned: Horizontal, slack_m: f32) -> Option<f32> {
        let approach = self.normal_ned.dot(direction_ned);
        let range_m = -self.distance_m(from_ned_m) / approach;
        // A ray parallel to the line divides by zero: the result is not finite or not plausible.
        if !(range_m > 0.0 && range_m < 1e5) {
            return None;
        }
        let along_m = self.along_ned().dot(from_ned_m.plus(direction_ned.times(range_m)));
        (along_m >= self.from_m - slack_m && along_m <= self.to_m + slack_m).then_some(range_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    fn point(rng: &mut Rng) -> Horizontal {
        Horizontal { north: 20.0 * rng.uniform() - 10.0, east: 20.0 * rng.uniform() - 10.0 }
    }

    #[test]
    fn a_line_goes_through_the_points_that_made_it_whichever_way_it_runs() {
        let mut rng = Rng::new(1, 1);
        for case in 0..1000 {
            let a = point(&mut rng);
            let mut b = point(&mut rng);
            match case % 4 {
                0 => b.east = a.east,
                1 => b.north = a.north,
                _ => (),
            }
            let line = Wall::between(a, b).unwrap();
            let [from, to] = line.ends_ned_m();
            assert!(from.minus(a).norm() < 1e-4 && to.minus(b).norm() < 1e-4, "{a:?} {b:?}: {line:?}");
        }
        assert_eq!(Wall::between(Horizontal::default(), Horizontal::default()), None);
    }

    #[test]
    fn a_ray_that_is_reflected_by_the_law_comes_from_the_mirror_image() {
        let mut rng = Rng::new(2, 1);
        for _ in 0..1000 {
            let (a, b) = (point(&mut rng), point(&mut rng));
            let Some(line) = Wall::between(a, b) else { continue };
            // A point of the line, two directions with the same angle to it (eq. 4), a source and a receiver.
            let at = a.plus(b.minus(a).times(rng.uniform()));
            let out = Horizontal::from_bearing(6.0 * rng.uniform());
            let u = line.along_ned();
            let back = line.normal_ned.times(out.dot(line.normal_ned)).minus(u.times(out.dot(u)));
            let (source, ear) = (at.plus(back.times(4.0)), at.plus(out.times(3.0)));
            let image = line.mirror(source);
            let heard = at.minus(ear).times(1.0 / 3.0);
            let seen = image.minus(ear).times(1.0 / image.minus(ear).norm());
            assert!(heard.minus(seen).norm() < 1e-3, "{heard:?} {seen:?}");
            // The other way: the receiver's mirror image sees the source directly.
            let direct = source.minus(line.mirror(ear));
            let mirrored = line.mirror_direction(heard);
            assert!(direct.times(1.0 / direct.norm()).minus(mirrored).norm() < 1e-3);
            let range_m = line.range_along_m(ear, heard, 0.01);
            if libm::fabsf(line.distance_m(ear)) > 0.1 {
                assert!((range_m.unwrap() - 3.0).abs() < 1e-2, "{range_m:?}");
            }
        }
    }

    #[test]
    fn a_ray_misses_a_line_that_is_behind_parallel_or_too_short() {
        let wall = Wall::between(Horizontal { north: 2.0, east: -1.0 }, Horizontal { north: 2.0, east: 1.0 }).unwrap();
        let here = Horizontal::default();
        assert_eq!(wall.range_along_m(here, Horizontal::from_bearing(0.0), 0.0), Some(2.0));
        assert_eq!(wall.range_along_m(here, Horizontal { north: -1.0, east: 0.0 }, 0.0), None);
        assert_eq!(wall.range_along_m(here, Horizontal { north: 0.0, east: 1.0 }, 0.0), None);
        assert_eq!(wall.range_along_m(here, Horizontal::from_bearing(0.6), 0.0), None);
        assert!(wall.range_along_m(here, Horizontal::from_bearing(0.6), 0.5).is_some());
    }
}
