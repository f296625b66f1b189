//! Mounting of a lidar that is connected directly to the computer.

use core::f32::consts::PI;

use crate::base::error::{ConfigError, check};

/// How it is mounted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Mount {
    /// Direction of its forward mark, from the nose, clockwise.
    pub yaw_rad: f32,
    /// Whether it is mounted upside down, which reverses its direction of rotation.
    pub is_upside_down: bool,
}

impl Mount {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("lidar.yaw_rad", self.yaw_rad, -PI, PI).map(|_| ())
    }
}
