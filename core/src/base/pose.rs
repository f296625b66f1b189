//! Where and which way a sensor looked.

use crate::base::ned::Horizontal;

/// Angles within a few turns of zero are meant; others are absurd.
pub(crate) const ANGLE_MAX_RAD: f32 = 100.0;

/// Where and which way the sensor looked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position of the vehicle when it scanned.
    pub position_ned_m: Horizontal,
    /// Yaw of the vehicle when it scanned.
    pub yaw_rad: f32,
}

impl Pose {
    /// Whether it is a place and a direction.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        self.position_ned_m.is_finite()
            && self.position_ned_m.norm_squared() < 1e12
            && libm::fabsf(self.yaw_rad) <= ANGLE_MAX_RAD
    }
}
