//! The fast loop: one step takes a frame and the telemetry, and returns one setpoint. It connects all modules in the
//! order of the data. It is the uppermost layer, with the state machine ([`mission`]) and the parameters ([`param`]),
//! and may import every other.
//!
//! It does not call the planner. A step that needs a plan sets [`Output::plan_requested`]; the caller lets
//! [`crate::planning::planner`] answer [`State::request`], at once or in a slower task, and passes the answer to any
//! later step. The plan takes effect `HANDOVER_TICKS` steps after the request, neither earlier nor later,
//! so that the flight does not depend on the planner's speed. A later answer is dropped; the old plan is followed to its
//! end.

use crate::base::adc::AdcFrame;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Circle;
use crate::base::ownship::{Ownship, Stale};
use crate::base::time::Instant;
use crate::control::guard::{self, Setpoint};
use crate::control::{evade, vehicle_model, wind};
use crate::doa::bearing::{self, Bearing};
use crate::guidance::mission::{Control, Outcome};
use crate::landing::observation::PadObservation;
use crate::landing::{self, Lander};
use crate::localize::belief;
use crate::localize::source::support::SourcePosition;
use crate::mapping::scan::{Points, Scan};
use crate::planning::planner::Answer;
use crate::signal::phase::{self, Phasors};

mod command;
mod config;
mod intake;
pub mod mission;
mod near;
pub mod param;
mod replan;
mod state;
mod step;
pub mod systems;
pub mod turning;

pub use config::Config;
pub use state::State;

pub use crate::control::guard::OBSTACLES_MAX;

/// Steps from a plan's request to the step in which it takes effect.
const HANDOVER_TICKS: u32 = 5;

/// The measurement of the antennas.
#[derive(Clone, Copy, Debug)]
pub enum FrontEnd<'a, const N: usize> {
    /// Samples of four channels, from the AD converters.
    Frame(&'a AdcFrame<N>),
    /// The measurement of a frame, made before, or recorded in a flight that is replayed.
    Measured(&'a Measurement),
    /// A bearing made elsewhere.
    Bearing(Bearing),
    /// No frame in this step.
    Nothing,
}

/// Everything that guidance needs from a frame: a step with it instead of the samples gives the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Measurement {
    /// The array's bearing from the frame.
    pub bearing: Bearing,
    /// The phasors of the frame, if the vehicle may seek by turning.
    pub phasors: Option<Phasors>,
}

/// Input of one step of the fast loop.
#[derive(Clone, Debug)]
pub struct Input<'a, const N: usize> {
    /// The time of the step.
    pub now: Instant,
    /// The measurement of the antennas.
    pub front_end: FrontEnd<'a, N>,
    /// The vehicle as last received; `None` before the first message.
    pub ownship: Option<Ownship>,
    /// A new obstacle scan.
    pub scan: Option<&'a Scan>,
    /// New single points of obstacles.
    pub points: Option<&'a Points>,
    /// Obstacles from a sensor that reports circles.
    pub circles: Option<&'a [Circle]>,
    /// The latest observation of the camera that looks down.
    pub look: Option<PadObservation>,
    /// The height over the ground by a range finder, if there is a reading.
    pub height_m: Option<f32>,
    /// The autopilot reports that the vehicle is on the ground.
    pub is_landed: bool,
    /// Whether we are in control.
    pub control: Control,
    /// The slow loop's answer, passed once, as soon as there is one.
    pub answer: Option<&'a Answer>,
}

impl<const N: usize> Input<'_, N> {
    /// A step without any input.
    #[must_use]
    pub const fn at(now: Instant) -> Self {
        Self {
            now,
            front_end: FrontEnd::Nothing,
            ownship: None,
            scan: None,
            points: None,
            circles: None,
            look: None,
            height_m: None,
            is_landed: false,
            control: Control::LinkLost,
            answer: None,
        }
    }
}

/// The result of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Output {
    /// The time of the step.
    pub time: Instant,
    /// The outcome.
    pub outcome: Outcome,
    /// The reason, if that is [`Outcome::StaleOwnship`].
    pub stale: Option<Stale>,
    /// The command; always finite and inside the limits.
    pub setpoint: Setpoint,
    /// A bearing measured in this step (it may be invalid; see its flags).
    pub bearing: Option<Bearing>,
    /// The direction of that bearing from north, clockwise, with attitude and yaw taken into account.
    pub bearing_ned_rad: Option<f32>,
    /// The averaged bearing of the source that guidance follows now, from north, clockwise.
    pub source_bearing_ned_rad: Option<f32>,
    /// The temporary target that guidance follows now.
    pub target_ned_m: Option<Horizontal>,
    /// The estimated position of the source, as of the active plan.
    pub source: Option<SourcePosition>,
    /// Weight of the leading filter of the source, and its averaged normalised innovation squared.
    pub source_share_and_nis: Option<(f32, f32)>,
    /// State of the landing, once the vehicle has come near the beacon.
    pub landing: Option<landing::Output>,
    /// What the guard did.
    pub guard: guard::Action,
    /// Counts of the guard.
    pub guard_counts: guard::Counts,
    /// A plan is requested; [`State::request`] has the request.
    pub plan_requested: bool,
    /// Hash over every bearing, plan and setpoint so far.
    pub trace_hash: u64,
}

impl Output {
    /// Whether an interruption ends it: the mode must be entered again, since guidance has ended by itself, or the vehicle
    /// has left the altitude at which it seeks.
    #[must_use]
    pub fn is_final(&self) -> bool {
        let is_low = self.landing.is_some_and(|landing| landing.demand.is_some() && landing.stage.is_low());
        match self.outcome {
            Outcome::GoalUnreachable | Outcome::HandedOver | Outcome::Landed => true,
            Outcome::StaleOwnship => {
                is_low || matches!(self.stale, Some(Stale::VelocityContradicts | Stale::PositionFrozen))
            }
            _ => is_low,
        }
    }
}

/// The configured fast loop.
#[derive(Clone, Debug)]
pub struct Guidance<const N: usize> {
    seed: u64,
    tick_s: f32,
    replan_at_waypoint: usize,
    replan_ticks: u32,
    retry_ticks: u32,
    plan_margin_m: f32,
    stop_m: f32,
    turn_s: f32,
    lag_us: u32,
    known_source_ned_m: Option<Horizontal>,
    phase: phase::Extractor<N>,
    bearing: bearing::BearingEstimator,
    localizer: belief::Localizer,
    searches: bool,
    vehicle_model: vehicle_model::VehicleModel,
    wind: wind::Estimator,
    evade: evade::Evader,
    guard: guard::Guard,
    mission: mission::Mission,
    turning: Option<turning::Turning>,
    lander: Option<Lander>,
}

#[cfg(test)]
mod arriving;
#[cfg(test)]
mod taken;
#[cfg(test)]
mod tests;
