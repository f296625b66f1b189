//! How a lidar is mounted that the computer has on a line of its own.

use core::f32::consts::PI;

use crate::base::error::{ConfigError, check};

/// How it is mounted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Mount {
    /// Where its arrow points, from the nose, clockwise.
    pub yaw_rad: f32,
    /// It hangs upside down: what it calls clockwise is not.
    pub is_upside_down: bool,
}

impl Mount {
    /// Checks it.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("lidar.yaw_rad", self.yaw_rad, -PI, PI).map(|_| ())
    }
}
