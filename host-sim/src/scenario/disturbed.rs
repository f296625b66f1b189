//! Disturbances of a flight: wind, a position with errors, other beacons, a beacon that transmits in pulses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The beacon transmits in pulses, from the start of the flight on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Pulses {
    /// From the start of one pulse to that of the next.
    #[schemars(range(min = 0.01, max = 3600.0))]
    pub period_s: f64,
    /// Length of a pulse.
    #[schemars(range(min = 0.001, max = 3600.0))]
    pub length_s: f64,
}

/// Another beacon.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct OtherBeacon {
    /// East.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub x: f64,
    /// North.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub y: f64,
    /// Its frequency minus that of our beacon.
    #[schemars(range(min = -12000.0, max = 30000.0))]
    pub offset_hz: f64,
    /// Its power relative to our beacon, wherever the vehicle is.
    #[serde(default)]
    #[schemars(range(min = -60.0, max = 40.0))]
    pub level_db: f64,
}

/// The wind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Wind {
    /// Its mean, to the east.
    #[schemars(range(min = -20.0, max = 20.0))]
    pub vx: f64,
    /// To the north.
    #[schemars(range(min = -20.0, max = 20.0))]
    pub vy: f64,
    /// Standard deviation of the gusts, along each axis.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub gust_mps: f64,
    /// Approximate duration of a gust.
    #[schemars(range(min = 0.1, max = 100.0))]
    pub gust_s: f64,
}

/// Errors of the position that the autopilot reports.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Position {
    /// Standard deviation from report to report, along each axis.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub noise_m: f64,
    /// Standard deviation of a slow drift.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub drift_m: f64,
    /// Time constant of the drift.
    #[schemars(range(min = 1.0, max = 3600.0))]
    pub drift_s: f64,
}

impl Default for Wind {
    fn default() -> Self {
        Self { vx: 0.0, vy: 0.0, gust_mps: 0.0, gust_s: 2.0 }
    }
}

impl Default for Position {
    fn default() -> Self {
        Self { noise_m: 0.0, drift_m: 0.0, drift_s: 20.0 }
    }
}
