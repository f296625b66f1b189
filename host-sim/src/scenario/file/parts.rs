//! The parts of a scenario file.

use foxhound_core::base::adc::CHANNELS;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::scenario::disturbed::Pulses;

/// A vertical pillar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Obstacle {
    /// East.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub x: f64,
    /// North.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub y: f64,
    /// Radius.
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub r: f64,
    /// Velocity to the east.
    #[serde(default)]
    #[schemars(range(min = -20.0, max = 20.0))]
    pub vx: f64,
    /// Velocity to the north.
    #[serde(default)]
    #[schemars(range(min = -20.0, max = 20.0))]
    pub vy: f64,
    /// It turns back after so many seconds, and again: somebody who walks to and fro. Zero: never.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub turns_s: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A vertical wall. It is as thick as the pillars that it is made of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
pub struct Wall {
    /// East, of one end.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub x0: f64,
    /// North.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub y0: f64,
    /// East, of the other end.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub x1: f64,
    /// North.
    #[schemars(range(min = -10000.0, max = 10000.0))]
    pub y1: f64,
    /// Half its thickness.
    #[serde(default = "half_a_wall")]
    #[schemars(range(min = 0.02, max = 10.0))]
    pub r: f64,
    /// What a wave loses that is reflected.
    #[serde(default = "reflection_loss")]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub reflection_db: f64,
    /// What a wave loses that goes through.
    #[serde(default = "passage_loss")]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub passage_db: f64,
}

fn half_a_wall() -> f64 {
    0.2
}

fn reflection_loss() -> f64 {
    6.0
}

fn passage_loss() -> f64 {
    30.0
}

/// The obstacle sensor on the nose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Sensor {
    /// Width of the field of view.
    #[schemars(range(min = 6.0, max = 360.0))]
    pub fov_deg: f64,
    /// How far it sees.
    #[schemars(range(min = 0.1, max = 100.0))]
    pub range_m: f64,
    /// Whether pillars hide what is behind them.
    pub occlusion: bool,
    /// What it delivers.
    pub model: SensorModel,
    /// Sectors of a scan.
    #[schemars(range(min = 8, max = 360))]
    pub rays: u32,
    /// How long a scan takes; the vehicle moves meanwhile.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub turn_s: f64,
}

/// What the obstacle sensor delivers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorModel {
    /// The visible pillars, exactly.
    #[default]
    Circles,
    /// Distances in sectors, as `OBSTACLE_DISTANCE` messages of 72 each.
    Scan,
    /// The bytes of a lidar on a line of the computer's own: 450 points in a turn of 0.1 s, whatever `rays` and `turn_s` say.
    Lidar,
}

/// The direction finding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Bearing {
    /// The goal is never given to the planner; else it is told its place, unless that moves.
    pub only: bool,
    /// Antenna waveforms, or bearings with noise.
    pub model: Option<BearingModel>,
    /// Standard deviation of the noise model.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub sigma_deg: f64,
    /// Signal-to-noise ratio per sample of the waveforms.
    #[schemars(range(min = -30.0, max = 80.0))]
    pub snr_db: Option<f64>,
    /// Wrong bearings.
    pub outlier: Outlier,
    /// From when to when nothing is received.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub dropout: Option<[f64; 2]>,
    /// The beacon's frequency is known: no other is listened to.
    pub tone_known: bool,
    /// The beacon sounds in pulses only.
    pub pulses: Option<Pulses>,
}

/// Where bearings come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BearingModel {
    /// Simulated antennas, through the whole signal chain.
    Rf,
    /// The true bearing and Gaussian noise.
    Noise,
}

/// Wrong bearings: a share of them is off by an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Outlier {
    /// Share of the bearings.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub rate: f64,
    /// By how much they are off.
    #[schemars(range(min = -360.0, max = 360.0))]
    pub offset_deg: f64,
}

/// Directional antennas: with one of them, or with fewer than three of four, a vehicle seeks by turning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Antenna {
    /// There is one antenna only, on the first channel.
    pub single: bool,
    /// Exponent of the raised cosine: 2 is a cardioid, more a narrower lobe.
    #[schemars(range(min = 0.5, max = 8.0))]
    pub exponent: f64,
    /// Gain to the front over that to the back.
    #[schemars(range(min = 3.0, max = 40.0))]
    pub front_to_back_db: f64,
    /// Where each antenna points, from the nose, clockwise.
    #[schemars(inner(range(min = -360.0, max = 360.0)))]
    pub boresight_deg: [f64; CHANNELS],
    /// How fast the vehicle turns when it seeks by turning; to the right.
    #[schemars(range(min = 23.0, max = 140.0))]
    pub turn_deg_per_s: f64,
}

/// Limits that the guard keeps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Limits {
    /// Speed, m/s.
    #[schemars(range(min = 0.05, max = 20.0))]
    pub v_max: f64,
    /// Speed while giving way to what moves, m/s, where that is above `v_max`.
    #[schemars(range(min = 0.0, max = 20.0))]
    pub v_evade: f64,
    /// Acceleration, m/s^2.
    #[schemars(range(min = 0.1, max = 20.0))]
    pub a_max: f64,
}

/// The vehicle's dynamics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Vehicle {
    /// Which model.
    pub model: VehicleModel,
    /// Velocity lag of the point mass, s.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub lag_s: f64,
    /// Which autopilot flies it.
    pub autopilot: Software,
}

/// Which software the autopilot runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Software {
    /// ArduPilot Copter.
    #[default]
    ArduCopter,
    /// PX4 on a multicopter.
    Px4,
}

/// Which vehicle model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VehicleModel {
    /// A point mass with a velocity lag and an acceleration limit.
    #[default]
    Point,
    /// The delays measured on ArduCopter.
    Arducopter,
}

/// Faults to inject; each from when to when.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Faults {
    /// Bearings are NaN.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub nan_bearing: Option<[f64; 2]>,
    /// The obstacle sensor is silent.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub stale_obstacles: Option<[f64; 2]>,
    /// The autopilot's clock jumps back by a second at this time.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub clock_back_s: Option<f64>,
    /// The autopilot's position and attitude are silent.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub stale_ownship: Option<[f64; 2]>,
    /// A channel hears nothing at all; for each of the four.
    #[schemars(inner(inner(range(min = 0.0, max = 1e6))))]
    pub dead_channels: [Option<[f64; 2]>; CHANNELS],
}

impl Default for Sensor {
    fn default() -> Self {
        Self { fov_deg: 90.0, range_m: 3.0, occlusion: true, model: SensorModel::Circles, rays: 72, turn_s: 0.0 }
    }
}

impl Default for Bearing {
    fn default() -> Self {
        Self {
            only: true,
            model: None,
            sigma_deg: 1.86,
            snr_db: None,
            outlier: Outlier::default(),
            dropout: None,
            tone_known: false,
            pulses: None,
        }
    }
}

impl Default for Antenna {
    fn default() -> Self {
        Self {
            single: false,
            exponent: 2.0,
            front_to_back_db: 15.0,
            boresight_deg: [0.0; CHANNELS],
            turn_deg_per_s: 70.0,
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self { v_max: 1.0, v_evade: 0.0, a_max: 2.0 }
    }
}

impl Default for Vehicle {
    fn default() -> Self {
        Self { model: VehicleModel::Point, lag_s: 0.15, autopilot: Software::ArduCopter }
    }
}
