//! The fast door: one step takes in a frame and the telemetry, and gives out one setpoint. Here the rooms are wired, in the
//! order of the data; this is the only module that knows them all. It is the uppermost floor, with the state machine
//! ([`mission`]) and the parameters ([`param`]), and may import every other.
//!
//! The planner is not called from here. A step that wants a plan says so ([`Output::plan_requested`]); whoever drives the
//! step lets [`crate::planning::planner`] answer [`State::request`], now or on a slower task, and hands the answer to any
//! later step. It takes effect [`Config::handover_ticks`] steps after the request, neither earlier nor later, so that the
//! flight does not depend on how fast the planner ran. An answer that comes later than that is dropped and counted; the old
//! plan goes on while it lasts.

use crate::base::adc::AdcFrame;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Circle;
use crate::base::ownship::{Ownship, Stale};
use crate::base::time::Instant;
use crate::control::guard::{self, Setpoint};
use crate::control::{evade, track, vehicle_model, wind};
use crate::doa::bearing::{self, Bearing};
use crate::guidance::mission::{Control, Outcome};
use crate::landing::observation::PadObservation;
use crate::landing::{self, Lander};
use crate::localize::goal;
use crate::localize::goal::posterior::Estimate;
use crate::localize::source::bank;
use crate::mapping::scan::{self, Points, Scan};
use crate::mapping::{map, tracks};
use crate::planning::planner::Plan;
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
pub use intake::Refused;
pub use state::State;

/// The fast loop heeds so many of the nearest ones; the planner is told all.
pub const OBSTACLES_MAX: usize = 64;

/// What the antennas brought.
#[derive(Clone, Copy, Debug)]
pub enum FrontEnd<'a, const N: usize> {
    /// Four channels of codes: the real thing.
    Frame(&'a AdcFrame<N>),
    /// What was made of them before, here or in a flight that is flown again.
    Measured(&'a Measurement),
    /// A bearing made elsewhere.
    Bearing(Bearing),
    /// No frame in this step.
    Nothing,
}

/// All that guidance takes from a frame: with it instead of the codes a step comes to the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Measurement {
    /// What the array made of the frame.
    pub bearing: Bearing,
    /// What it made that of, where the vehicle may seek by turning.
    pub phasors: Option<Phasors>,
}

/// Everything that one step of the fast loop may know.
#[derive(Clone, Debug)]
pub struct Input<'a, const N: usize> {
    /// The time of the step.
    pub now: Instant,
    /// What the antennas brought.
    pub front_end: FrontEnd<'a, N>,
    /// The vehicle as last heard; `None` before the first word.
    pub ownship: Option<Ownship>,
    /// A new obstacle scan.
    pub scan: Option<&'a Scan>,
    /// New single points of obstacles.
    pub points: Option<&'a Points>,
    /// Obstacles that a sensor delivers as circles already.
    pub circles: Option<&'a [Circle]>,
    /// What the camera that looks down has seen.
    pub look: Option<PadObservation>,
    /// The height over the ground by a range finder, where there is one and it reads.
    pub height_m: Option<f32>,
    /// The autopilot says that the vehicle stands on the ground.
    pub is_landed: bool,
    /// Whether we are in control.
    pub control: Control,
    /// The planner's answer, handed over once, as soon as there is one.
    pub plan: Option<&'a Plan>,
}

impl<const N: usize> Input<'_, N> {
    /// A step in which nothing was heard from anyone.
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
            plan: None,
        }
    }
}

/// What one step came to.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Output {
    /// The time of the step.
    pub time: Instant,
    /// What it came to.
    pub outcome: Outcome,
    /// Why, where that is [`Outcome::StaleOwnship`].
    pub stale: Option<Stale>,
    /// The command; always finite and inside the limits.
    pub setpoint: Setpoint,
    /// A bearing measured in this step (it may be invalid; see its flags).
    pub bearing: Option<Bearing>,
    /// Where that bearing points, from north, clockwise: attitude and yaw taken into account.
    pub bearing_ned_rad: Option<f32>,
    /// The bearing of the source that guidance now follows, averaged, from north, clockwise.
    pub source_bearing_ned_rad: Option<f32>,
    /// The temporary target that guidance now follows.
    pub target_ned_m: Option<Horizontal>,
    /// Where the source is believed to be, as of the active plan.
    pub source: Option<Estimate>,
    /// Share of the weight that the leading filter of the source has, and its normalised innovation squared, averaged.
    pub source_share_and_nis: Option<(f32, f32)>,
    /// How far the landing is, once the vehicle has come near the beacon.
    pub landing: Option<landing::Output>,
    /// What the guard did.
    pub guard: guard::Action,
    /// What the guard has done so far; its beats tell that it is alive.
    pub guard_counts: guard::Counts,
    /// A plan is wanted: [`State::request`] says for what.
    pub plan_requested: bool,
    /// A plan took effect in this step.
    pub plan_activated: bool,
    /// Plans that came too late so far.
    pub plans_late: u32,
    /// Hash over every bearing, plan and setpoint so far.
    pub trace_hash: u64,
}

/// The configured fast loop.
#[derive(Clone, Debug)]
pub struct Guidance<const N: usize> {
    seed: u64,
    tick_s: f32,
    handover_ticks: u32,
    replan_at_waypoint: usize,
    replan_ticks: u32,
    retry_ticks: u32,
    plan_margin_m: f32,
    target_distance_m: f32,
    known_source_ned_m: Option<Horizontal>,
    reflected_min: f32,
    slack_m: f32,
    range_sigma_max: f32,
    phase: phase::Extractor<N>,
    bearing: bearing::BearingEstimator,
    scan: scan::Segmenter,
    map: map::Mapper,
    tracks: tracks::Tracker,
    source: bank::FilterBank,
    reflections: bool,
    searches: bool,
    goal: goal::Seeker,
    vehicle_model: vehicle_model::VehicleModel,
    wind: wind::Estimator,
    track: track::Tracker,
    evade: evade::Evader,
    guard: guard::Guard,
    mission: mission::Mission,
    turning: Option<turning::Turning>,
    lander: Option<Lander>,
}

#[cfg(test)]
mod taken;
#[cfg(test)]
mod tests;
