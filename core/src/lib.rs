//! # Foxhound core
//!
//! Four coherent antenna channels in, one velocity setpoint out. No heap, no clock, no IO, no globals: time,
//! samples, telemetry and seeds are arguments, results are return values. The same code runs on a Cortex-M4F and on
//! the desktop and computes the same bits on both.
//!
//! ```text
//!  adc -> spectrum -> phase -> bearing -> source -> goal -> planner -> track -> guard -> setpoint
//!  i16    fixed point  phasors  rad, sigma  filters  where   10 x 15    PID     limits, swept check
//! ```
//!
//! Each stage is one module, a file or a folder, and the modules are in nine layers. A layer imports only those
//! listed in its row; `tests/proof/floors.rs` checks that:
//!
//! | layer | purpose | imports |
//! |---|---|---|
//! | [`base`] | units, time, vectors, mathematics, random numbers | |
//! | [`signal`] | a frame of samples becomes phasors | `base` |
//! | [`doa`] | phasors become a bearing | `base`, `signal` |
//! | [`mapping`] | hits become circles and walls; which places have been seen | `base` |
//! | [`localize`] | bearings become an estimate of the source | `base`, `doa`, `mapping` |
//! | [`planning`] | a trajectory from the estimate and the obstacles | `base`, `mapping`, `localize` |
//! | [`landing`] | the last metres | `base`, `doa`, `localize` |
//! | [`control`] | a trajectory becomes a safe velocity | `base`, `mapping`, `planning` |
//! | [`guidance`] | the whole chain in one step, the state machine, the parameters | all |
//!
//! There are two entries: [`guidance`], stepped with every frame, and [`planning::planner`], called on request. Each
//! module has the same parts in the same order: what it does and its sources, `Config` with defaults in SI units,
//! `build` which checks it, the immutable stage, its `State` and outputs, `step`, tests.
//!
//! ## Three programs
//!
//! Every stage is used in the same way: a `Config` is checked by `build` and gives the stage, which never changes;
//! the changing part is a `State` that the caller owns; time and samples are arguments. `core/examples` has longer
//! versions of these three: samples that become bearings, a path around pillars, and the whole chain in a loop with a
//! vehicle.
//!
//! ```
//! # use foxhound_core::ConfigError;
//! use foxhound_core::base::adc::AdcFrame;
//! use foxhound_core::doa::{array, bearing};
//! use foxhound_core::signal::phase;
//!
//! let extractor = phase::Config::default().build::<256>()?;
//! let estimator = bearing::Config::default().build(array::Config::default().build()?)?;
//! let mut state = phase::State::default();
//! let phasors = extractor.step(&mut state, &AdcFrame::zeroed());
//! assert!(!estimator.estimate(&phasors).valid, "silence has no bearing");
//! # Ok::<(), ConfigError>(())
//! ```
//!
//! ```
//! # use foxhound_core::ConfigError;
//! use foxhound_core::base::config::{Fence, RangeSensor, Vehicle};
//! use foxhound_core::base::ned::Horizontal;
//! use foxhound_core::base::obstacle::Disc;
//! use foxhound_core::planning::planner::{Config, PlanRequest, Workspace, Verdict};
//!
//! let guard_margin_m = 0.03;
//! let planner =
//!     Config::default().build(&Vehicle::default(), &RangeSensor::default(), &Fence::default(), guard_margin_m)?;
//! let known_source_ned_m = Some(Horizontal { north: 6.0, east: 0.0 });
//! let request = PlanRequest { known_source_ned_m, ..PlanRequest::default() };
//! let center_ned_m = Horizontal { north: 1.0, east: 0.1 };
//! let pillar = Disc { center_ned_m, radius_m: 0.3, ..Disc::default() };
//! let plan = planner.plan(&mut Workspace::new(), &request, &[pillar]);
//! assert_eq!(plan.verdict, Verdict::Follow);
//! # Ok::<(), ConfigError>(())
//! ```
//!
//! ```
//! # use foxhound_core::ConfigError;
//! use foxhound_core::base::adc::AdcFrame;
//! use foxhound_core::base::time::Instant;
//! use foxhound_core::guidance::mission::{Control, Outcome};
//! use foxhound_core::guidance::{Config, FrontEnd, Input};
//!
//! let guidance = Config::default().build::<256>()?;
//! let mut state = guidance.start();
//! let frame = AdcFrame::zeroed();
//! let input = Input {
//!     front_end: FrontEnd::Frame(&frame),
//!     control: Control::NotInControl,
//!     ..Input::at(Instant(0))
//! };
//! assert_eq!(guidance.step(&mut state, &input).outcome, Outcome::NotInControl);
//! # Ok::<(), ConfigError>(())
//! ```
//!
//! ## Frames and units
//!
//! North-east-down and body forward-right-down everywhere; azimuth from the nose, clockwise positive. Metres, metres a
//! second, radians, hertz, microseconds, with the unit in the name of every dimensional scalar.
//!
//! ## Same bits everywhere
//!
//! Only `+ - * /`, comparisons, the square root of [`base::math`] and the free functions of `libm` on `f32`, and
//! integers, so that host and target agree bit for bit; [`base::trace`] hashes the outputs. Float *methods* of the
//! standard library are never used: they would be other functions on the host.
//!
//! ## Sources
//!
//! *main paper*: S. M. Mulla, A. Kanakapudi, L. Narasimhan, A. Tiwari, "RF-source Seeking with Obstacle Avoidance using
//! Real-time Modified Artificial Potential Fields in Unknown Environments", IIT Madras. Equation numbers in the docs of
//! the modules are that paper's unless another is named.
//!
//! *mmWave paper*: K. Pfeiffer et al., "Path Planning Under Uncertainty to Localize mmWave Sources" (modules
//! [`localize::source`], [`mapping::walls`], [`planning::ilqr`]). *Rotating vehicle's paper*: RF source seeking with a
//! single-wing rotating micro aerial vehicle (module [`doa::rotating`]).
#![no_std]

#[cfg(test)]
extern crate std;

pub mod base;
pub mod control;
pub mod doa;
pub mod guidance;
pub mod landing;
pub mod localize;
pub mod mapping;
pub mod planning;
pub mod signal;

pub use base::error::ConfigError;
