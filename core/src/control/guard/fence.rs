//! The geofence: a circle or a convex polygon that the vehicle does not leave.

use crate::base::error::{ConfigError, Why, check};
use crate::base::ned::Horizontal;
use crate::base::obstacle::Neighbour;

/// Radius of the discs that stand for sides: large against what the evader foresees, and small enough for its squares.
const DISC_M: f32 = 100.0;

/// Most corners of a polygon.
pub const CORNERS_MAX: usize = 8;

/// Where the vehicle may be, in the local NED frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Fence {
    /// Anywhere.
    #[default]
    Off,
    /// In a circle.
    Circle {
        /// Centre.
        center_ned_m: Horizontal,
        /// Radius.
        radius_m: f32,
    },
    /// In a convex polygon.
    Polygon {
        /// Its corners in order, in either direction; those past `count` are ignored.
        corners_ned_m: [Horizontal; CORNERS_MAX],
        /// Number of corners, at least three.
        count: u8,
    },
}

impl Fence {
    /// A box whose sides run north and east.
    #[must_use]
    pub fn rectangle(south_west_ned_m: Horizontal, north_east_ned_m: Horizontal) -> Self {
        let (a, b) = (south_west_ned_m, north_east_ned_m);
        let mut corners_ned_m = [a; CORNERS_MAX];
        corners_ned_m[1] = Horizontal { north: b.north, east: a.east };
        corners_ned_m[2] = b;
        corners_ned_m[3] = Horizontal { north: a.north, east: b.east };
        Self::Polygon { corners_ned_m, count: 4 }
    }

    /// Checks the fence.
    ///
    /// # Errors
    /// The field that is out of range; a polygon that is not convex.
    pub fn build(&self) -> Result<Self, ConfigError> {
        match self {
            Self::Off => {}
            Self::Circle { center_ned_m, radius_m } => {
                check("guard.fence.center_ned_m", center_ned_m.north, -1e5, 1e5)?;
                check("guard.fence.center_ned_m", center_ned_m.east, -1e5, 1e5)?;
                check("guard.fence.radius_m", *radius_m, 1.0, 1e5)?;
            }
            Self::Polygon { corners_ned_m, count } => {
                check("guard.fence.count", f32::from(*count), 3.0, CORNERS_MAX as f32)?;
                let corners = corners_ned_m.get(..usize::from(*count)).unwrap_or_default();
                for corner in corners {
                    check("guard.fence.corners_ned_m", corner.north, -1e5, 1e5)?;
                    check("guard.fence.corners_ned_m", corner.east, -1e5, 1e5)?;
                }
                // Every corner is on the same side of every edge, and off it except the edge's own two.
                let sense = twice_area(corners);
                let inside = edges(corners).all(|(a, b)| {
                    let apart = |p: &&Horizontal| **p != a && **p != b;
                    corners.iter().filter(apart).all(|p| turn(a, b, *p) * sense > 0.0)
                });
                if !inside || !(libm::fabsf(sense) > 1.0) {
                    let why = Why::Inconsistent("the corners of a fence must form a convex polygon, in order");
                    return Err(ConfigError { field: "guard.fence.corners_ned_m", value: sense, why });
                }
            }
        }
        Ok(*self)
    }

    /// The half-planes that make it up, as seen from a place: the inward direction, and how far inside the place is.
    pub(super) fn sides(&self, place: Horizontal) -> impl Iterator<Item = (Horizontal, f32)> {
        let (corners, circle) = match self {
            Self::Off => (&[] as &[Horizontal], None),
            Self::Circle { center_ned_m, radius_m } => {
                let inwards = center_ned_m.minus(place);
                let norm = inwards.norm();
                let inwards =
                    if norm > 1e-6 { inwards.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
                (&[] as &[Horizontal], Some((inwards, radius_m - norm)))
            }
            Self::Polygon { corners_ned_m, count } => {
                (corners_ned_m.get(..usize::from(*count)).unwrap_or_default(), None)
            }
        };
        let sense = if twice_area(corners) > 0.0 { 1.0 } else { -1.0 };
        let sides = edges(corners).map(move |(a, b)| {
            let along = b.minus(a);
            let length_m = along.norm();
            let inwards = Horizontal { north: -along.east, east: along.north }.times(sense / length_m);
            (inwards, inwards.dot(place.minus(a)))
        });
        circle.into_iter().chain(sides)
    }

    /// Its sides, this far inside, as obstacles around a place, for a stage that knows circles only: large discs, which a side of the
    /// fence touches where it is nearest.
    pub(super) fn discs(&self, place: Horizontal, margin_m: f32) -> impl Iterator<Item = Neighbour> {
        self.sides(place).map(move |(inwards, depth_m)| Neighbour {
            center_ned_m: place.minus(inwards.times(depth_m - margin_m + DISC_M)),
            reach_m: DISC_M,
            ..Neighbour::default()
        })
    }

    /// How far inside a place is; negative outside.
    #[must_use]
    pub fn depth_m(&self, place: Horizontal) -> f32 {
        self.sides(place).fold(f32::INFINITY, |least, (_, depth)| if depth < least { depth } else { least })
    }
}

fn edges(corners: &[Horizontal]) -> impl Iterator<Item = (Horizontal, Horizontal)> {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Positive when `p` lies clockwise (to the right) of the line from `a` to `b`.
fn turn(a: Horizontal, b: Horizontal, p: Horizontal) -> f32 {
    let (along, to) = (b.minus(a), p.minus(a));
    along.north * to.east - along.east * to.north
}

fn twice_area(corners: &[Horizontal]) -> f32 {
    let first = corners.first().copied().unwrap_or_default();
    edges(corners).map(|(a, b)| turn(first, a, b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(north: f32, east: f32) -> Horizontal {
        Horizontal { north, east }
    }

    #[test]
    fn depth_is_the_distance_to_the_nearest_side_whichever_way_the_corners_run() {
        let fence = Fence::rectangle(at(-2.0, -1.0), at(4.0, 3.0)).build().unwrap();
        let Fence::Polygon { mut corners_ned_m, count } = fence else { panic!() };
        corners_ned_m[..4].reverse();
        for fence in [fence, Fence::Polygon { corners_ned_m, count }.build().unwrap()] {
            assert_eq!(fence.depth_m(at(0.0, 0.0)), 1.0);
            assert_eq!(fence.depth_m(at(3.5, 1.0)), 0.5);
            assert_eq!(fence.depth_m(at(0.0, 5.0)), -2.0);
        }
        let circle = Fence::Circle { center_ned_m: at(1.0, 0.0), radius_m: 5.0 };
        assert_eq!(circle.depth_m(at(1.0, 3.0)), 2.0);
        assert_eq!(circle.depth_m(at(1.0, 0.0)), 5.0);
        assert_eq!(Fence::Off.depth_m(at(1e9, 0.0)), f32::INFINITY);
    }

    #[test]
    fn fences_that_are_not_convex_or_not_finite_are_refused_by_name() {
        let polygon = |corners: &[(f32, f32)]| {
            let mut corners_ned_m = [Horizontal::default(); CORNERS_MAX];
            for (to, from) in corners_ned_m.iter_mut().zip(corners) {
                *to = at(from.0, from.1);
            }
            Fence::Polygon { corners_ned_m, count: corners.len() as u8 }.build().map_err(|e| e.field)
        };
        assert!(polygon(&[(0.0, 0.0), (0.0, 5.0), (5.0, 0.0)]).is_ok());
        let refused = Err("guard.fence.corners_ned_m");
        assert_eq!(polygon(&[(0.0, 0.0), (5.0, 5.0), (5.0, 0.0), (0.0, 5.0)]), refused, "crossed");
        assert_eq!(polygon(&[(0.0, 0.0), (0.0, 5.0), (1.0, 1.0), (5.0, 0.0)]), refused, "a dent");
        assert_eq!(polygon(&[(0.0, 0.0), (0.0, 5.0), (0.0, 9.0)]), refused, "flat");
        assert_eq!(polygon(&[(0.0, 0.0), (f32::NAN, 5.0), (5.0, 0.0)]), refused);
        assert_eq!(polygon(&[(0.0, 0.0), (5.0, 0.0)]), Err("guard.fence.count"));
        let circle = Fence::Circle { center_ned_m: at(0.0, 0.0), radius_m: f32::INFINITY };
        assert_eq!(circle.build().unwrap_err().field, "guard.fence.radius_m");
    }
}
