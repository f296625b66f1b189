//! Facts that several stages need. They are configured here and nowhere else.

use core::f32::consts::{FRAC_PI_2, TAU};

use crate::base::error::{ConfigError, check};

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
}

impl RangeSensor {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self { range_m: 3.0, fov_rad: FRAC_PI_2 };

    /// Checks the values.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("sensor.range_m", self.range_m, 0.1, 100.0)?;
        check("sensor.fov_rad", self.fov_rad, 0.1, TAU).map(drop)
    }
}

impl Default for RangeSensor {
    fn default() -> Self {
        Self::DEFAULT
    }
}
