//! Position and direction of a sensor.

use crate::base::ned::Horizontal;

/// Angles are expected within a few turns of zero; larger ones are refused.
pub(crate) const ANGLE_MAX_RAD: f32 = 100.0;

/// Position and direction of a sensor at the time of a measurement.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position of the vehicle when it scanned.
    pub position_ned_m: Horizontal,
    /// Yaw of the vehicle when it scanned.
    pub yaw_rad: f32,
}

impl Pose {
    /// Whether it is a valid position and direction.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        self.position_ned_m.is_finite()
            && self.position_ned_m.norm_squared() < 1e12
            && libm::fabsf(self.yaw_rad) <= ANGLE_MAX_RAD
    }
}
