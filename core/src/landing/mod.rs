//! The last metres: whether this is the beacon, where the pad is, and the descent onto it. A layer of its own, which
//! may import `base`, `doa` and `localize`.
//!
//! The planner brings the vehicle near the beacon. A filter of the belief estimates where the beacon is ([`near`]), and
//! [`arrival`] decides when the vehicle is above it, or that this cannot be told; [`search`] searches within limits;
//! [`centring`] flies to above the pad and down. The pad is detected by a separate
//! crate (`foxhound-pad`). [`Lander::step`] is called in every step of the fast loop; as long as it has no demand the
//! planner is followed, and the guard checks every demand. Without a camera the vehicle stays above the beacon and
//! hands over; the user decides whether the autopilot lands it there ([`Config::request_land`]).
//!
//! After ArduPilot's `AC_PrecLand` and PX4's `precland`: a cone for the descent, counted retries, a short climb after
//! a loss, a last part without sight of the pad. Unlike those it never descends onto a pad that it has not found: it
//! ends on the ground, or in a hover with a reason.
//!
//! | stage | event | what the vehicle does |
//! |---|---|---|
//! | `Seeking` | nothing yet | no demand: the planner is followed |
//! | | arrived, or known to be near for long | `Approaching` |
//! | | near for long and not known well enough | `SearchingBeacon` |
//! | | pad found near the beacon | `Centring` |
//! | `Approaching` | above the beacon, no camera expected | hand over, `Arrived`; land if the user wants it; `Blocked` while an obstacle is too near for that |
//! | | above the beacon, camera, pad not seen | `SearchingPad` |
//! | | above the beacon, no frames, or bad ones only | hand over, `NoCamera` |
//! | | the estimated beacon was not there | `Seeking`, `retries_max` times; then hand over, `Ambiguous` |
//! | | blocked by the guard for 5 s | hand over, `Blocked` |
//! | | not above it in time | hand over, `TimeLimit` |
//! | `SearchingBeacon` | arrived, or known | `Approaching` |
//! | | not near after all | `Seeking`, `retries_max` times |
//! | | all searched; time limit; most of it blocked | back to its start, then hand over, `SearchLimit`; `TimeLimit`; `Blocked` |
//! | `SearchingPad` | pad found | `Centring` |
//! | | all searched; time limit; most of it blocked | back to its start, then hand over, `NoPad` (`PadLost` if it had been found); `TimeLimit`; `Blocked` |
//! | | pad seen, but the height is unknown | hand over at the end of the search, `NoHeight` |
//! | | no frames, or bad ones only | hand over, `NoCamera` |
//! | `Centring` | pushed away so far that the pad leaves the picture | climbs while that lasts |
//! | | inside the cone, detections fresh | `Descending` |
//! | | pad not seen for 2 s | `Recovering` |
//! | | not down in time | `Recovering`, `retries_max` times; then hand over, `TimeLimit` |
//! | `Descending` | outside of the cone, or detections not fresh | `Centring`: the height is held |
//! | | low, in the middle and slow | `Committed` |
//! | `Recovering` | it holds, and climbs a little | |
//! | | pad found | `Centring` |
//! | | climbed | `SearchingPad` around where it was, `retries_max` times; then hand over, `PadLost` |
//! | `Committed` | on the ground, by the autopilot or because it sinks no more | `Landed` |
//! | | not in the middle, or not for long | the drop waits |
//! | | pushed out of the middle before that; no drop for 10 s | `Centring` |
//! | | dropped, and not down in time | `Recovering` |
//! | `Landed` | | straight down until the autopilot says that it has landed, then zero; land (and disarm) if the user wants it |
//! | `HandedOver` | | zero velocity until the mode is entered again |
//! | any but `Seeking` | own position or attitude unknown, absurd, or older than 0.5 s | zero velocity, `NoOwnship`; goes on afterwards |
//! | | the mission holds | it holds; limits of time wait, but `total_s` |
//! | | `total_s` over | hand over, `TimeLimit` |
//!
//! Numbers are defaults of [`Config`], and constants. There is a test for each row. Every demand is finite, inside the
//! limits of [`centring`]'s speeds, and changes no faster than its accelerations.
//!
//! Cost: the bench's `landing_step`, which has a bearing in every step and a detection in some.
//!
//! [`near`]: crate::localize::source::near

use crate::base::error::{ConfigError, check};
use crate::base::history::{FullPose, Poses};
use crate::base::ned::{Horizontal, Ned};
use crate::base::ownship::Ownship;
use crate::base::time::Instant;
use crate::base::units::between;
use crate::localize::source::Estimate;
use crate::localize::source::near::Fix;

pub mod arrival;
pub mod centring;
pub mod observation;
pub mod search;
mod stages;

use centring::{
    ACCEL_MAX_MPS2, CLIMB_M, CLIMB_MPS, COAST_M, COMMIT_MAX_M, COMMIT_MPS, DESCENT_MAX_MPS, DOWN_ACCEL_MAX_MPS2,
    LOST_S, SPEED_MAX_MPS, Taken,
};
use observation::{PadObservation, Seen};

/// Own position and attitude older than this are not used.
const OWNSHIP_AGE_MAX_S: f32 = 0.5;
/// Larger readings of a range finder are ignored.
const FINDER_MAX_M: f32 = 200.0;
/// The autopilot is asked to land beside the beacon only with this much room around the hull: it knows no obstacles, and drifts.
const LAND_ROOM_M: f32 = 0.25;
/// For so long, without a break.
const LAND_ROOM_S: f32 = 1.0;
/// Farther from the beacon, in distances at which it arrives, the autopilot is not asked to land.
const ASIDE: f32 = 2.0;

/// Configuration of the landing.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// A camera looks down, and there is a pad to land on.
    pub has_camera: bool,
    /// Its focal length over the width of its image.
    pub focal_widths: f32,
    /// Radius of the pad.
    pub pad_radius_m: f32,
    /// The autopilot is asked to land above the beacon where no camera is expected, and to disarm on the pad.
    pub request_land: bool,
    /// How often a lost pad or beacon may be searched for again, or an attempt may run out of time.
    pub retries_max: u8,
    /// How long the flight to above the beacon may take.
    pub approach_s: f32,
    /// How long it may take to enter the cone, or to descend.
    pub attempt_s: f32,
    /// How long the whole landing may take.
    pub total_s: f32,
    /// When the beacon's fix is an arrival.
    pub arrival: arrival::Config,
    /// Search.
    pub search: search::Config,
    /// Centring and descent.
    pub centring: centring::Config,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            has_camera: false,
            focal_widths: 0.866,
            pad_radius_m: 0.25,
            request_land: false,
            retries_max: 3,
            approach_s: 20.0,
            attempt_s: 45.0,
            total_s: 240.0,
            arrival: arrival::Config::default(),
            search: search::Config::default(),
            centring: centring::Config::default(),
        }
    }
}

impl Config {
    /// Checks the configuration. It climbs no higher than `altitude_band_m` above where the landing began.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self, altitude_band_m: f32) -> Result<Lander, ConfigError> {
        check("landing.focal_widths", self.focal_widths, 0.2, 5.0)?;
        // No larger than what is seen until this low.
        let most_m = COMMIT_MAX_M * stages::SHORT_SIDE_HALF * stages::FILLED / self.focal_widths;
        check("landing.pad_radius_m", self.pad_radius_m, 0.02, most_m)?;
        check("landing.retries_max", f32::from(self.retries_max), 0.0, 20.0)?;
        check("landing.approach_s", self.approach_s, 1.0, 600.0)?;
        check("landing.attempt_s", self.attempt_s, 1.0, 600.0)?;
        check("landing.total_s", self.total_s, 1.0, 3600.0)?;
        let highest_m = if altitude_band_m < CLIMB_M { altitude_band_m } else { CLIMB_M };
        Ok(Lander {
            config: *self,
            climb_m: highest_m - COAST_M,
            arrival: self.arrival.build()?,
            search: self.search.build()?,
            pilot: self.centring.build()?,
        })
    }
}

/// Stage of the landing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[repr(u8)]
pub enum Stage {
    /// Not there yet: the planner is followed.
    #[default]
    Seeking = 0,
    /// Flying to above the beacon.
    Approaching,
    /// Near the beacon, searching for its position.
    SearchingBeacon,
    /// Above the beacon, searching for the pad.
    SearchingPad,
    /// Flying to above the pad, or waiting there.
    Centring,
    /// Going down.
    Descending,
    /// The pad is out of sight: holding, then climbing a little.
    Recovering,
    /// The last part, without sight of the pad.
    Committed,
    /// On the ground.
    Landed,
    /// Hovering, until the pilot takes over.
    HandedOver,
}

impl Stage {
    /// Whether the vehicle may be far below the altitude at which it seeks, on its way to the ground.
    #[must_use]
    pub fn is_low(self) -> bool {
        matches!(self, Self::SearchingPad | Self::Centring | Self::Descending | Self::Recovering | Self::Committed)
    }
}

/// Why a stage ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[repr(u8)]
pub enum Reason {
    /// Above the beacon.
    Arrived = 0,
    /// On the pad.
    Landed,
    /// There is no pad where the beacon is.
    NoPad,
    /// The pad was found, and lost too often.
    PadLost,
    /// No frames come from the camera, or bad ones only.
    NoCamera,
    /// The vehicle's height is unknown.
    NoHeight,
    /// The beacon's position is ambiguous.
    Ambiguous,
    /// Everything inside the limits was searched.
    SearchLimit,
    /// The time limit was reached.
    TimeLimit,
    /// The guard does not allow it.
    Blocked,
    /// Own position or attitude is unknown.
    NoOwnship,
}

impl Reason {
    /// The reason's name in logs and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Arrived => "arrived",
            Self::Landed => "landed",
            Self::NoPad => "no_pad",
            Self::PadLost => "pad_lost",
            Self::NoCamera => "no_camera",
            Self::NoHeight => "no_height",
            Self::Ambiguous => "ambiguous",
            Self::SearchLimit => "search_limit",
            Self::TimeLimit => "time_limit",
            Self::Blocked => "blocked",
            Self::NoOwnship => "no_ownship",
        }
    }
}

/// Input of a step.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// The time of the step.
    pub now: Instant,
    /// The vehicle as last received, if it is plausible.
    pub ownship: Option<&'a Ownship>,
    /// Height over the ground, by a range finder.
    pub height_m: Option<f32>,
    /// The vehicle's poses of the last moments.
    pub poses: &'a Poses,
    /// The belief's fix of the beacon.
    pub fix: Option<Fix>,
    /// The estimate of the source's filters, if the source is in line of sight.
    pub estimate: Option<&'a Estimate>,
    /// The detector's result for a frame.
    pub look: Option<PadObservation>,
    /// The autopilot reports that it has landed.
    pub is_landed: bool,
    /// The guard braked in the last step.
    pub is_blocked: bool,
    /// Distance of the hull from the nearest known obstacle; infinite if none is near.
    pub clearance_m: f32,
    /// Time since the last step.
    pub tick_s: f32,
}

/// The target for `LANDING_TARGET`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Target {
    /// Local NED.
    pub place_ned_m: Ned,
    /// Standard deviation of the horizontal position.
    pub sigma_m: f32,
    /// Whether it is the pad; else the beacon.
    pub is_pad: bool,
}

/// The result of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Output {
    /// Stage of the landing.
    pub stage: Stage,
    /// Velocity, horizontal in NED and down; `None` to follow the planner.
    pub demand: Option<(Horizontal, f32)>,
    /// Why it hovers, or is back in this stage.
    pub reason: Option<Reason>,
    /// The position of the pad, or of the beacon.
    pub target: Option<Target>,
    /// The autopilot is to land, or to disarm, here.
    pub wants_land: bool,
}

/// The vehicle as last received, if that is plausible and recent.
#[must_use]
pub fn fresh(ownship: Option<&Ownship>, now: Instant) -> Option<&Ownship> {
    let is_fresh = |at: Instant| now.seconds_since(at) < OWNSHIP_AGE_MAX_S && at.seconds_since(now) < OWNSHIP_AGE_MAX_S;
    ownship
        .filter(|ownship| ownship.is_plausible() && is_fresh(ownship.position_time) && is_fresh(ownship.attitude_time))
}

/// A range finder's height, if it is plausible.
#[must_use]
pub fn plausible_height_m(height_m: Option<f32>) -> Option<f32> {
    height_m.filter(|height_m| *height_m > 0.0 && *height_m < FINDER_MAX_M)
}

/// The configured stage machine.
///
/// ```
/// # use foxhound_core::ConfigError;
/// use foxhound_core::base::history::Poses;
/// use foxhound_core::base::ned::Ned;
/// use foxhound_core::base::ownship::Ownship;
/// use foxhound_core::base::time::Instant;
/// use foxhound_core::landing::{Config, Input, Stage, State};
///
/// let lander = Config::default().build(2.0)?;
/// let mut state = State::default();
/// let now = Instant(1_000_000);
/// let position_ned_m = Ned { north: 0.0, east: 0.0, down: -2.0 };
/// let ownship = Ownship { position_time: now, attitude_time: now, position_ned_m, ..Ownship::default() };
/// let input = Input {
///     now,
///     ownship: Some(&ownship),
///     height_m: None,
///     poses: &Poses::default(),
///     fix: None,
///     estimate: None,
///     look: None,
///     is_landed: false,
///     is_blocked: false,
///     clearance_m: f32::INFINITY,
///     tick_s: 0.02,
/// };
/// // Nothing is heard yet: the planner is followed.
/// let output = lander.step(&mut state, &input);
/// assert_eq!((output.stage, output.demand), (Stage::Seeking, None));
/// # Ok::<(), ConfigError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lander {
    config: Config,
    /// How far above its beginning a climb is ended.
    climb_m: f32,
    arrival: arrival::Arrival,
    search: search::Search,
    pilot: centring::Pilot,
}

/// State of the landing.
#[derive(Clone, Debug, Default)]
pub struct State {
    stage: Stage,
    reason: Option<Reason>,
    /// When the stage, the attempt and all of it began.
    entered: Instant,
    attempted: Instant,
    began: Option<Instant>,
    arrival: arrival::State,
    search: search::State,
    track: centring::Track,
    /// The goal while there is no pad.
    goal_ned_m: Horizontal,
    integral_mps: Horizontal,
    /// The last demand.
    velocity_ned_mps: Horizontal,
    down_mps: f32,
    /// When the last good frame arrived.
    framed: Option<Instant>,
    /// A pad was seen from an unknown height.
    lacks_height: bool,
    /// The drop has begun, which cannot be aborted.
    is_dropping: bool,
    /// A pad was found.
    has_found: bool,
    retries: u8,
    settled_s: f32,
    blocked_s: f32,
    stands_s: f32,
    /// For how long there has been room to land.
    roomy_s: f32,
    /// Vertical positions: where the pad was lost, and how high it may climb.
    lost_down_m: f32,
    top_down_m: f32,
}

impl State {
    /// Stage of the landing.
    #[must_use]
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Height over the pad at that vertical position, once it is the one to land on.
    #[must_use]
    pub fn height_m(&self, down_m: f32) -> Option<f32> {
        (self.has_found && self.track.is_sure()).then(|| self.track.height_m(down_m))
    }

    fn enter(&mut self, stage: Stage, reason: Option<Reason>, now: Instant) {
        // A pad that is found again from a little higher does not make it another attempt.
        if stage == Stage::Centring && !matches!(self.stage, Stage::Descending | Stage::Committed | Stage::Recovering) {
            self.attempted = now;
        }
        if stage == Stage::Seeking {
            self.began = None;
        }
        (self.stage, self.reason, self.entered) = (stage, reason, now);
        self.is_dropping = false;
        (self.settled_s, self.blocked_s, self.stands_s) = (0.0, 0.0, 0.0);
    }

    /// The vehicle holds instead of what this step demanded: the next demand begins at rest, it does not stand on the
    /// ground because it does not come down, and the time limits of the stage, the attempt and the search wait.
    pub fn overrule(&mut self, tick_s: f32) {
        (self.velocity_ned_mps, self.down_mps) = (Horizontal::default(), 0.0);
        self.stands_s = 0.0;
        let tick_us = (tick_s * 1e6) as u64;
        self.entered = self.entered.plus_micros(tick_us);
        self.attempted = self.attempted.plus_micros(tick_us);
        self.search.wait(tick_us);
    }

    #[cfg(test)]
    pub(crate) fn put_down(&mut self, now: Instant) {
        self.enter(Stage::Landed, Some(Reason::Landed), now);
    }

    /// The position has jumped: all stored positions are shifted.
    pub fn shift(&mut self, by: Horizontal) {
        self.arrival.shift(by);
        self.search.shift(by);
        self.track.shift(by);
        self.goal_ned_m = self.goal_ned_m.plus(by);
    }
}

/// The vehicle in a step.
struct Here {
    now: Instant,
    tick_s: f32,
    place_ned_m: Horizontal,
    down_m: f32,
    velocity_ned_mps: Horizontal,
    down_mps: f32,
    height_m: Option<f32>,
}

impl Here {
    /// Where the vehicle will be after `time_s`, at its present velocity.
    fn after(&self, time_s: f32) -> Horizontal {
        self.place_ned_m.plus(self.velocity_ned_mps.times(time_s))
    }
}

/// A demand before its limits.
#[derive(Clone, Copy, Default)]
struct Wish {
    velocity_ned_mps: Horizontal,
    down_mps: f32,
}

impl Lander {
    /// One step.
    pub fn step(&self, state: &mut State, input: &Input<'_>) -> Output {
        let tick_s = if input.tick_s > 1e-3 && input.tick_s < 0.2 { input.tick_s } else { 0.02 };
        let now = input.now;
        let Some(ownship) = fresh(input.ownship, now) else { return self.hold_blindly(state, input.is_landed, tick_s) };
        let height_m = plausible_height_m(input.height_m);
        let place = FullPose::carried(ownship, now).place_ned_m;
        let here = Here {
            now,
            tick_s,
            place_ned_m: place.horizontal(),
            down_m: place.down,
            velocity_ned_mps: ownship.velocity_ned_mps.horizontal(),
            down_mps: ownship.velocity_ned_mps.down,
            height_m,
        };
        self.look(state, input, &here);
        let verdict = self.arrival.judge(&mut state.arrival, here.place_ned_m, input.fix, input.estimate, tick_s);

        state.blocked_s = if input.is_blocked { state.blocked_s + tick_s } else { 0.0 };
        self.mind_time(state, now);
        state.roomy_s = if input.clearance_m >= LAND_ROOM_M { state.roomy_s + tick_s } else { 0.0 };
        let mut wish = self.act(state, input, &here, verdict);
        if let Some(wish) = &mut wish
            && wish.down_mps < 0.0
            && here.down_m <= state.top_down_m
        {
            wish.down_mps = 0.0;
        }
        let demand = wish.map(|wish| self.limited(state, wish, tick_s));
        if demand.is_none() {
            // A demand begins at the velocity that the planner's flight has now.
            state.velocity_ned_mps = here.velocity_ned_mps.clamped(SPEED_MAX_MPS);
            state.down_mps = 0.0;
        }
        self.output(state, input, demand)
    }

    fn output(&self, state: &State, input: &Input<'_>, demand: Option<(Horizontal, f32)>) -> Output {
        let is_seen = state.has_found && state.stage.is_low() || state.track.unseen_s(input.now) < LOST_S;
        let target = if state.track.is_sure() && is_seen {
            let (place_ned_m, sigma_m) = (state.track.place_ned_m(), state.track.sigma_m());
            Some(Target { place_ned_m, sigma_m, is_pad: true })
        } else {
            input.fix.map(|fix| Target { place_ned_m: fix.place_ned_m, sigma_m: fix.sigma_m, is_pad: false })
        };
        // Somebody may have pushed it aside meanwhile.
        let is_beside = input.fix.is_some_and(|fix| fix.distance_m > ASIDE * self.config.arrival.arrive_m);
        let is_above = state.stage == Stage::HandedOver && state.reason == Some(Reason::Arrived) && !is_beside;
        let is_narrow = is_above && self.config.request_land && state.roomy_s < LAND_ROOM_S;
        Output {
            stage: state.stage,
            demand,
            reason: if is_narrow { Some(Reason::Blocked) } else { state.reason },
            target,
            wants_land: self.config.request_land && !is_narrow && (is_above || state.stage == Stage::Landed),
        }
    }

    /// Without an ownship.
    fn hold_blindly(&self, state: &mut State, is_landed: bool, tick_s: f32) -> Output {
        if state.stage == Stage::Seeking {
            return Output { reason: Some(Reason::NoOwnship), ..Output::default() };
        }
        let sinks = state.stage == Stage::Landed && !is_landed;
        let down_mps = if sinks { COMMIT_MPS } else { 0.0 };
        let demand = self.limited(state, Wish { down_mps, ..Wish::default() }, tick_s);
        let is_over = matches!(state.stage, Stage::HandedOver | Stage::Landed);
        let reason = if is_over { state.reason } else { Some(Reason::NoOwnship) };
        Output { stage: state.stage, demand: Some(demand), reason, ..Output::default() }
    }

    /// Frames -> pad.
    fn look(&self, state: &mut State, input: &Input<'_>, here: &Here) {
        let ground_down_m = here.height_m.map(|height_m| here.down_m + height_m);
        if let (Some(ground_down_m), Some(height_m)) = (ground_down_m, here.height_m) {
            state.track.level(ground_down_m, height_m, here.tick_s);
        }
        let Some(look) = input.look.filter(|_| self.config.has_camera) else { return };
        let pad = match look.seen {
            Seen::Bad(_) => return,
            Seen::Nothing(_) => None,
            Seen::Pad(pad) => Some(pad),
        };
        state.framed = Some(here.now);
        // A detection whose attitude is not known any more cannot be used.
        let (Some(pad), Some(pose)) = (pad, input.poses.at(look.time)) else { return };
        let radius_m = self.config.pad_radius_m;
        let taken = self.pilot.see(&mut state.track, &pad, look.time, &pose, radius_m, ground_down_m);
        state.lacks_height |= taken == Taken::NoHeight;
    }

    /// Every stage has a time limit.
    fn mind_time(&self, state: &mut State, now: Instant) {
        let is_active = !matches!(state.stage, Stage::Seeking | Stage::Landed | Stage::HandedOver | Stage::Committed);
        if is_active && state.began.is_some_and(|began| now.seconds_since(began) > self.config.total_s) {
            state.enter(Stage::HandedOver, Some(Reason::TimeLimit), now);
        }
    }

    /// Limits a demand in speed and in change.
    fn limited(&self, state: &mut State, wish: Wish, tick_s: f32) -> (Horizontal, f32) {
        let wanted = if wish.velocity_ned_mps.is_finite() { wish.velocity_ned_mps } else { Horizontal::default() };
        let wanted_down = if wish.down_mps.is_finite() { wish.down_mps } else { 0.0 };
        let wanted = wanted.clamped(SPEED_MAX_MPS);
        let wanted_down = between(wanted_down, -CLIMB_MPS, DESCENT_MAX_MPS);
        let change = wanted.minus(state.velocity_ned_mps).clamped(ACCEL_MAX_MPS2 * tick_s);
        let most = DOWN_ACCEL_MAX_MPS2 * tick_s;
        state.velocity_ned_mps = state.velocity_ned_mps.plus(change);
        state.down_mps += between(wanted_down - state.down_mps, -most, most);
        (state.velocity_ned_mps, state.down_mps)
    }
}

#[cfg(test)]
mod tests;
