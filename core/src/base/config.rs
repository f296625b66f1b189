//! Facts that several stages need. They are configured here and nowhere else.

use core::f32::consts::{FRAC_PI_2, TAU};

use crate::base::error::{ConfigError, Why, check};
use crate::base::ned::Horizontal;

/// The vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Vehicle {
    /// Radius of a circle around everything that may touch something.
    pub radius_m: f32,
}

impl Vehicle {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self { radius_m: 0.15 };

    /// Checks the values.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("vehicle.radius_m", self.radius_m, 0.0, 5.0).map(drop)
    }
}

impl Default for Vehicle {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// The obstacle sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RangeSensor {
    /// Its range. A scan brings its own.
    pub range_m: f32,
    /// Full angle of its view, centred on the nose; 2 pi when it covers the full circle.
    pub fov_rad: f32,
    /// How long a scan takes that does not tell it, from its first ray to its last; negative: from the last to the first; 0: all
    /// rays at once.
    pub turn_s: f32,
    /// How old what it saw is when it arrives: of a scan its last ray, of points all.
    pub lag_s: f32,
}

impl RangeSensor {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self { range_m: 3.0, fov_rad: FRAC_PI_2, turn_s: 0.0, lag_s: 0.0 };

    /// Checks the values.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("sensor.range_m", self.range_m, 0.35, 100.0)?;
        check("sensor.turn_s", self.turn_s, -0.3, 0.3)?;
        check("sensor.lag_s", self.lag_s, 0.0, 0.15)?;
        check("sensor.fov_rad", self.fov_rad, 0.1, TAU).map(drop)
    }

    /// Checks that it sees beyond a hull: with less than 0.35 m of sight an obstacle is known too late to keep clear of it.
    ///
    /// # Errors
    /// The range, if it is too short.
    pub fn check_beyond(&self, hull_m: f32) -> Result<(), ConfigError> {
        if self.range_m >= hull_m + 0.35 {
            return Ok(());
        }
        let why = Why::Inconsistent("the obstacle sensor must see 0.35 m farther than the hull");
        Err(ConfigError { field: "sensor.range_m", value: self.range_m, why })
    }

    /// Checks that the guard can know of what stands beside a hull, with room for the smallest obstacle: what was seen to the side
    /// is remembered up to 1.5 m.
    ///
    /// # Errors
    /// The hull, if it is too wide for this view.
    pub fn check_beside(&self, hull_m: f32, smallest_obstacle_m: f32) -> Result<(), ConfigError> {
        if self.fov_rad >= ALL_AHEAD_RAD || hull_m + smallest_obstacle_m <= BESIDE_M {
            return Ok(());
        }
        let why = Why::Inconsistent("with the smallest obstacle above 1.35 m: needs a view of 155 degrees");
        Err(ConfigError { field: "vehicle.radius_m", value: hull_m, why })
    }
}

impl Default for RangeSensor {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A view that covers a hull's front whichever way it flies with its nose ahead.
const ALL_AHEAD_RAD: f32 = 2.7;
/// Largest sum of a hull's radius and the smallest obstacle's where the view is narrower.
const BESIDE_M: f32 = 1.35;

/// The geofence: a circle that the vehicle does not leave.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Fence {
    /// Its centre, in the local NED frame.
    pub center_ned_m: Horizontal,
    /// Its radius; 0: there is none.
    pub radius_m: f32,
    /// Distance that is kept from it, on its inside.
    pub margin_m: f32,
}

impl Fence {
    /// The default, no fence, as a constant.
    pub const DEFAULT: Self = Self { center_ned_m: Horizontal { north: 0.0, east: 0.0 }, radius_m: 0.0, margin_m: 0.5 };

    /// Checks the values.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("fence.center_ned_m", self.center_ned_m.north, -1e5, 1e5)?;
        check("fence.center_ned_m", self.center_ned_m.east, -1e5, 1e5)?;
        check("fence.margin_m", self.margin_m, 0.0, 100.0)?;
        if self.radius_m == 0.0 {
            return Ok(());
        }
        check("fence.radius_m", self.radius_m, 1.0, 1e5)?;
        if self.margin_m < self.radius_m {
            return Ok(());
        }
        let why = Why::Inconsistent("must be less than the fence's radius");
        Err(ConfigError { field: "fence.margin_m", value: self.margin_m, why })
    }

    /// The direction inwards at a place, and how far inside it is; negative outside. `None` without a fence.
    #[must_use]
    pub fn inside(&self, place_ned_m: Horizontal) -> Option<(Horizontal, f32)> {
        let inwards = self.center_ned_m.minus(place_ned_m);
        let norm = inwards.norm();
        let inwards = if norm > 1e-6 { inwards.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
        (self.radius_m > 0.0).then_some((inwards, self.radius_m - norm))
    }

    /// Whether a path that begins at a place does not lead out of it.
    #[must_use]
    #[inline(never)]
    pub fn has_inside(&self, path_ned_m: &[Horizontal], from_ned_m: Horizontal) -> bool {
        let reach_m = self.reach_m(from_ned_m);
        path_ned_m.iter().all(|place| place.minus(self.center_ned_m).norm() <= reach_m)
    }

    /// How far from the centre a path may lead that begins at a place: as far as the margin leaves, or, where the place
    /// is farther out, no farther than that. Infinite without a fence.
    #[must_use]
    pub fn reach_m(&self, from_ned_m: Horizontal) -> f32 {
        if !(self.radius_m > 0.0) {
            return f32::INFINITY;
        }
        let (allowed_m, off_m) = (self.radius_m - self.margin_m, from_ned_m.minus(self.center_ned_m).norm());
        if off_m > allowed_m { off_m } else { allowed_m }
    }

    /// The place nearest to another one to which a path from a start may lead.
    #[must_use]
    pub fn nearest_inside(&self, place_ned_m: Horizontal, from_ned_m: Horizontal) -> Horizontal {
        self.center_ned_m.plus(place_ned_m.minus(self.center_ned_m).clamped(self.reach_m(from_ned_m)))
    }
}

impl Default for Fence {
    fn default() -> Self {
        Self::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fence_that_leaves_no_room_is_refused_by_name() {
        let refused =
            |radius_m, margin_m| Fence { radius_m, margin_m, ..Fence::DEFAULT }.check().map_err(|error| error.field);
        assert_eq!([refused(0.0, 2.0), refused(1.0, 0.5)], [Ok(()); 2]);
        assert_eq!(refused(0.5, 0.1), Err("fence.radius_m"));
        assert_eq!(refused(f32::NAN, 0.5), Err("fence.radius_m"));
        assert_eq!(refused(2.0, 2.0), Err("fence.margin_m"));
        assert_eq!(Fence::DEFAULT.inside(Horizontal::default()), None);
    }
}
