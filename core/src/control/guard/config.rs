//! Configuration of the guard, and which values are refused.

use super::Guard;
use crate::base::config::{Fence, RangeSensor, Vehicle};
use crate::base::error::{ConfigError, check};
use crate::mapping::coverage;

/// Configuration of the guard.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Largest horizontal speed.
    pub v_max_mps: f32,
    /// Largest horizontal speed of the evader's demands, if it is above `v_max_mps`.
    pub evade_max_mps: f32,
    /// Largest vertical speed.
    pub v_down_max_mps: f32,
    /// Largest change of the horizontal, and of the vertical, command.
    pub a_max_mps2: f32,
    /// Largest change of the acceleration while the speed grows.
    pub jerk_max_mps3: f32,
    /// Largest yaw rate.
    pub yaw_rate_max_radps: f32,
    /// Clearance that the half-spaces keep from every obstacle (`FH_MARGIN_GRD`).
    pub margin_m: f32,
    /// Share of the remaining clearance that may be used up per second.
    pub approach_rate_per_s: f32,
    /// Share of the speed that is allowed outside the field of view, into places that have been seen.
    pub out_of_view_share: f32,
    /// Which places the sensor has seen.
    pub coverage: coverage::Config,
    /// Largest deviation from the held altitude, in either direction.
    pub altitude_band_m: f32,
    /// Where the vehicle may be.
    pub fence: Fence,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            v_max_mps: 1.0,
            evade_max_mps: 0.0,
            v_down_max_mps: 0.5,
            a_max_mps2: 2.0,
            jerk_max_mps3: 20.0,
            yaw_rate_max_radps: 1.25,
            margin_m: 0.03,
            approach_rate_per_s: 2.0,
            out_of_view_share: 0.5,
            coverage: coverage::Config::default(),
            altitude_band_m: 2.0,
            fence: Fence::DEFAULT,
        }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self, vehicle: &Vehicle, sensor: &RangeSensor) -> Result<Guard, ConfigError> {
        check("guard.v_max_mps", self.v_max_mps, 0.05, 20.0)?;
        check("guard.evade_max_mps", self.evade_max_mps, 0.0, 20.0)?;
        check("guard.v_down_max_mps", self.v_down_max_mps, 0.0, 5.0)?;
        check("guard.a_max_mps2", self.a_max_mps2, 0.1, 20.0)?;
        check("guard.jerk_max_mps3", self.jerk_max_mps3, 1.0, 1000.0)?;
        check("guard.yaw_rate_max_radps", self.yaw_rate_max_radps, 0.1, 6.3)?;
        vehicle.check()?;
        check("guard.margin_m", self.margin_m, 0.0, 5.0)?;
        check("guard.approach_rate_per_s", self.approach_rate_per_s, 0.1, 20.0)?;
        check("guard.out_of_view_share", self.out_of_view_share, 0.05, 1.0)?;
        check("guard.altitude_band_m", self.altitude_band_m, 0.1, 1e3)?;
        self.fence.check()?;
        Ok(Guard { config: *self, vehicle: *vehicle, fov_rad: sensor.fov_rad, surveyor: self.coverage.build(sensor)? })
    }
}
