//! The parts of a scenario file.

use foxhound_core::base::adc::CHANNELS;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::scenario::disturbed::Pulses;
use crate::scenario::input::{InputError, SIGMA_DEG, SNR_DB, check_within};

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
    /// It reverses after this many seconds, again and again. Zero: never.
    #[serde(default, skip_serializing_if = "is_zero")]
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub turns_s: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A vertical wall, a row of pillars that touch.
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
    /// Loss of a wave on reflection.
    #[serde(default = "reflection_loss")]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub reflection_db: f64,
    /// Loss of a wave on its passage through the wall.
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
    /// Range.
    #[schemars(range(min = 0.35, max = 100.0))]
    pub range_m: f64,
    /// Whether pillars hide what is behind them.
    pub occlusion: bool,
    /// Form of its data.
    pub model: SensorModel,
    /// Sectors of a scan.
    #[schemars(range(min = 8, max = 360))]
    pub rays: u32,
    /// Duration of a scan, during which the vehicle moves.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub turn_s: f64,
    /// How long a message of a scan takes from its last ray to the flight computer, in steps of 0.02 s; only of
    /// the model `scan`.
    #[schemars(range(min = 0.0, max = 0.15))]
    pub lag_s: f64,
    /// Standard deviation of each range of a scan or a lidar.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub noise_m: f64,
    /// Share of the rays of a scan or a lidar that read nothing, whatever stands there.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub missed: f64,
}

/// Form of the obstacle sensor's data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SensorModel {
    /// The visible pillars, exactly.
    #[default]
    Circles,
    /// Distances in sectors, as `OBSTACLE_DISTANCE` messages of 72 each.
    Scan,
    /// The bytes of a lidar on a serial line of the flight computer: 450 points in a turn of 0.1 s; `rays` and
    /// `turn_s` have no effect.
    Lidar,
}

/// The direction finding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Bearing {
    /// The planner is never given the goal; otherwise it knows the goal's place, unless that moves.
    pub only: bool,
    /// Antenna waveforms, or bearings with noise.
    pub model: Option<BearingModel>,
    /// Standard deviation of the noise model and the radios.
    #[schemars(range(min = 0.0, max = 180.0))]
    pub sigma_deg: f64,
    /// Direction of the radio's zero, clockwise from the nose; of the radios only.
    #[schemars(range(min = -180.0, max = 180.0))]
    pub mount_deg: f64,
    /// The last six digits of the beacon's address as a radio hears it [default, 0: those of the one built in]; of the radios only.
    #[schemars(range(max = 16_777_215))]
    pub tag: u32,
    /// Signal-to-noise ratio per sample of the waveforms.
    #[schemars(range(min = -30.0, max = 80.0))]
    pub snr_db: Option<f64>,
    /// Wrong bearings.
    pub outlier: Outlier,
    /// Time span without any signal.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub dropout: Option<[f64; 2]>,
    /// The beacon's frequency is known: tones more than two bins away are ignored.
    pub tone_known: bool,
    /// The beacon transmits in pulses only.
    pub pulses: Option<Pulses>,
    /// Bearings a second of the noise model and the radios, as of one that is slower than the flight [default: one every step].
    #[schemars(range(min = 0.2, max = 50.0))]
    pub rate_hz: Option<f64>,
    /// Standard deviation of an error of the noise model that stays the same within two metres.
    #[schemars(range(min = 0.0, max = 45.0))]
    pub place_bias_deg: f64,
}

/// Source of the bearings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BearingModel {
    /// Simulated antennas, through the whole signal chain.
    Rf,
    /// The true bearing and Gaussian noise.
    Noise,
    /// The same as `+UUDF` lines of a radio on a serial line of the flight computer, whole degrees, ten a second unless `rate_hz` says
    /// otherwise; it hears the half plane ahead.
    Uudf,
    /// The same as Bluetooth's IQ reports of an antenna array on that line, ten a second unless `rate_hz` says otherwise.
    Hci,
}

/// Wrong bearings: a share of them is off by an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Outlier {
    /// Share of the bearings.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub rate: f64,
    /// Their error.
    #[schemars(range(min = -360.0, max = 360.0))]
    pub offset_deg: f64,
    /// Outliers come from any direction instead.
    pub anywhere: bool,
}

/// Directional antennas: with one of them, or with fewer than three of four, the vehicle finds the beacon by
/// turning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Antenna {
    /// There is only one antenna, on the first channel.
    pub single: bool,
    /// Exponent of the raised cosine: 2 is a cardioid, more a narrower lobe.
    #[schemars(range(min = 0.5, max = 8.0))]
    pub exponent: f64,
    /// Gain to the front relative to the back.
    #[schemars(range(min = 3.0, max = 40.0))]
    pub front_to_back_db: f64,
    /// Direction of each antenna, from the nose, clockwise.
    #[schemars(inner(range(min = -360.0, max = 360.0)))]
    pub boresight_deg: [f64; CHANNELS],
    /// Turn rate when it seeks by turning; to the right.
    #[schemars(range(min = 23.0, max = 140.0))]
    pub turn_deg_per_s: f64,
}

/// Limits that the guard enforces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Limits {
    /// Speed, m/s.
    #[schemars(range(min = 0.1, max = 20.0))]
    pub v_max: f64,
    /// Largest speed while evading moving obstacles, m/s, if it is above `v_max`.
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
    /// Name of the model.
    pub model: VehicleModel,
    /// Velocity lag of the point mass, s.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub lag_s: f64,
    /// Autopilot of the vehicle.
    pub autopilot: Software,
}

/// Software of the autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
#[value(rename_all = "lower")]
pub enum Software {
    /// ArduPilot Copter.
    #[default]
    ArduCopter,
    /// PX4 on a multicopter.
    Px4,
}

/// Model of the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum VehicleModel {
    /// A point mass with a velocity lag and an acceleration limit.
    #[default]
    Point,
    /// The delays measured on ArduCopter.
    Arducopter,
}

/// Faults to inject, each with its time span.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Faults {
    /// Bearings are NaN.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub nan_bearing: Option<[f64; 2]>,
    /// The obstacle sensor sends nothing.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub stale_obstacles: Option<[f64; 2]>,
    /// The autopilot's clock jumps back by a second at this time.
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub clock_back_s: Option<f64>,
    /// The autopilot sends no position and attitude.
    #[schemars(inner(range(min = 0.0, max = 1e6)))]
    pub stale_ownship: Option<[f64; 2]>,
    /// A channel receives nothing at all; for each of the four.
    #[schemars(inner(inner(range(min = 0.0, max = 1e6))))]
    pub dead_channels: [Option<[f64; 2]>; CHANNELS],
}

impl Default for Sensor {
    fn default() -> Self {
        Self {
            fov_deg: 90.0,
            range_m: 3.0,
            occlusion: true,
            model: SensorModel::Circles,
            rays: 72,
            turn_s: 0.0,
            lag_s: 0.0,
            noise_m: 0.0,
            missed: 0.0,
        }
    }
}

impl Default for Bearing {
    fn default() -> Self {
        Self {
            only: true,
            model: None,
            sigma_deg: 1.86,
            mount_deg: 0.0,
            tag: 0,
            snr_db: None,
            outlier: Outlier::default(),
            dropout: None,
            tone_known: false,
            pulses: None,
            rate_hz: None,
            place_bias_deg: 0.0,
        }
    }
}

impl Bearing {
    /// Changes to antenna waveforms with this signal-to-noise ratio per sample; `name` is what the user gave it as.
    ///
    /// # Errors
    /// Names it, its value and the range.
    pub fn set_snr_db(&mut self, name: &str, snr_db: f64) -> Result<(), InputError> {
        check_within(name, snr_db, &SNR_DB)?;
        (self.snr_db, self.model) = (Some(snr_db), Some(BearingModel::Rf));
        Ok(())
    }

    /// Changes to bearings with this noise.
    ///
    /// # Errors
    /// Names it, its value and the range.
    pub fn set_sigma_deg(&mut self, name: &str, sigma_deg: f64) -> Result<(), InputError> {
        check_within(name, sigma_deg, &SIGMA_DEG)?;
        (self.sigma_deg, self.model) = (sigma_deg, Some(BearingModel::Noise));
        Ok(())
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
