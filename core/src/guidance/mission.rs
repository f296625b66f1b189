//! The state machine above the chain: the outcome of a step, and the vehicle's behaviour.
//!
//! A problem in the world is not an error: it has one of these outcomes, the first that applies from the top. "Hold"
//! is zero velocity within the acceleration limit, with the altitude kept (except for `StaleOwnship`, whose altitude is
//! not known) and the setpoint stream continued; except for `StaleOwnship`, `StaleObstacles` and `Fault` the vehicle also
//! gives way to moving obstacles ([`crate::control::evade`]). "None" leaves the stream to the link, which sends no motion outside of the mode and
//! sends nothing when the autopilot is silent. With `StaleOwnship` the vehicle brakes, and keeps clear of nothing: it does
//! not know where it is.
//!
//! | outcome | condition | behaviour |
//! |---|---|---|
//! | `LinkLost` | no heartbeat of the autopilot | none; the mission starts over when it is back |
//! | `NotInControl` | not in GUIDED / OFFBOARD, or disarmed | none; the mission starts over when the mode is entered again |
//! | `StaleOwnship` | position older than 0.3 s, attitude older than 0.2 s, or not finite ([`Stale::PositionOld`], [`Stale::AttitudeOld`]) | hold |
//! | `StaleOwnship` | positions contradict the velocity, or stand still while it says that the vehicle moves ([`Stale::VelocityContradicts`], [`Stale::PositionFrozen`]; [`crate::base::ownship::Agreement`]) | hold until the mode is entered again |
//! | `StaleObstacles` | the newest obstacle measurement in the map is older than 0.5 s, and a sensor is required | hold |
//! | `Uncalibrated` | no usable bearing for 1 s, the last one unusable for lack of a calibration | hold |
//! | `Ambiguous` | the same, the last one because its direction was ambiguous | hold |
//! | `NoSignal` | the same, for any other reason | hold; if `planner::Config::explore` is set, search, then hold |
//! | `GoalUnreachable` | no path for 15 s (time on a path is subtracted), or no progress beyond 1 m in 20 s, or, a distance `d` within 5 m of where the beacon is believed, beyond `1 m + 2 d` in 20 s for each metre of that; while a plan is late, or the vehicle holds for one of the reasons above, no time runs; the first time reflections are left out instead, if any was supposed ([`crate::localize::belief`]) | hold until the mode is entered again |
//! | `Fault` | a stage reported an impossible value (a demand that is not finite) | hold |
//! | `NoPath` | the planner answered with a brake plan | hold, request again every 0.5 s |
//! | `PlanLate` | the plan has run out, or there is none, or it brakes or is braked, and the next one did not arrive in time | hold, request again at once |
//! | `GuardBrake` | the guard replaced the command by a brake | hold, request a new plan at once |
//! | `HandedOver` | the beacon or the pad is reached as far as possible ([`crate::landing::Reason`]) | hover there, until the mode is entered again |
//! | `Landed` | the vehicle has come down onto the ground | straight down until the autopilot says that it has landed, and ends control |
//! | `Nominal` | none of these | follow the plan, or the landing ([`crate::landing`]) |
//!
//! Limits are fields of [`Config`]; the numbers above are its defaults. There is a test for each row.

use crate::base::error::{ConfigError, check};
use crate::base::ned::Horizontal;
use crate::base::ownship::Stale;
use crate::base::time::Instant;
use crate::doa::bearing::Flags;

/// The outcome of a guidance step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
#[repr(u8)]
pub enum Outcome {
    /// Seeking, with all inputs fresh.
    Nominal = 0,
    /// No bearing for too long.
    NoSignal,
    /// Bearings whose direction is ambiguous.
    Ambiguous,
    /// The array needs a calibration that is missing or does not apply.
    Uncalibrated,
    /// Position or attitude too old, not finite, or the velocity contradicts the positions ([`Stale`]).
    StaleOwnship,
    /// Obstacle data too old.
    StaleObstacles,
    /// The planner found no safe path.
    NoPath,
    /// No path for long, or no progress: given up until the mode is entered again.
    GoalUnreachable,
    /// The plan ran out before the next one came.
    PlanLate,
    /// The guard overruled the plan and braked.
    GuardBrake,
    /// The autopilot is silent.
    LinkLost,
    /// The autopilot is not in GUIDED or OFFBOARD, or not armed.
    NotInControl,
    /// A stage reported an impossible value.
    Fault,
    /// Arrived: hovers over the beacon, or where it could not go on, until the pilot takes over.
    HandedOver,
    /// Stands on the ground; the mission is complete.
    Landed,
}

impl Outcome {
    /// The outcome's name in logs and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Nominal => "nominal",
            Self::NoSignal => "no_signal",
            Self::Ambiguous => "ambiguous",
            Self::Uncalibrated => "uncalibrated",
            Self::StaleOwnship => "stale_ownship",
            Self::StaleObstacles => "stale_obstacles",
            Self::NoPath => "no_path",
            Self::GoalUnreachable => "goal_unreachable",
            Self::PlanLate => "plan_late",
            Self::GuardBrake => "guard_brake",
            Self::LinkLost => "link_lost",
            Self::NotInControl => "not_in_control",
            Self::Fault => "fault",
            Self::HandedOver => "handed_over",
            Self::Landed => "landed",
        }
    }

    /// The vehicle's behaviour for the outcome.
    #[must_use]
    pub fn behaviour(self) -> Behaviour {
        match self {
            Self::Nominal => Behaviour::Follow,
            Self::LinkLost | Self::NotInControl | Self::Landed => Behaviour::None,
            _ => Behaviour::Hold,
        }
    }
}

/// The vehicle's behaviour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Behaviour {
    /// Follow the plan.
    Follow,
    /// Brake, stay, keep the altitude.
    Hold,
    /// Left to the link.
    None,
}

/// Whether the autopilot has given us control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Control {
    /// No heartbeat of the autopilot.
    LinkLost,
    /// Received, but not in GUIDED / OFFBOARD or not armed.
    NotInControl,
    /// In the mode and armed.
    Granted,
}

/// Oldest position that can be flown by: with an older one the vehicle is too far from where its velocity would lead to.
pub(super) const OLDEST_POSITION_S: f32 = 0.5;

/// The limits of the table above.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Oldest position.
    pub position_age_max_s: f32,
    /// Oldest attitude.
    pub attitude_age_max_s: f32,
    /// Oldest age of the newest obstacle measurement in the map.
    pub obstacles_age_max_s: f32,
    /// Whether there must be an obstacle sensor at all.
    pub obstacles_required: bool,
    /// Oldest bearing.
    pub bearing_age_max_s: f32,
    /// How long the planner may find no path.
    pub no_path_max_s: f32,
    /// Time without progress after which the goal counts as unreachable.
    pub stall_s: f32,
    /// Progress means having moved this far from where the time started.
    pub stall_radius_m: f32,
}

/// Within how many stall radii of the source the vehicle is around it.
const AROUND: f32 = 5.0;

impl Default for Config {
    fn default() -> Self {
        Self {
            position_age_max_s: 0.3,
            attitude_age_max_s: 0.2,
            obstacles_age_max_s: 0.5,
            obstacles_required: true,
            bearing_age_max_s: 1.0,
            no_path_max_s: 15.0,
            stall_s: 20.0,
            stall_radius_m: 1.0,
        }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Mission, ConfigError> {
        check("mission.position_age_max_s", self.position_age_max_s, 0.02, OLDEST_POSITION_S)?;
        check("mission.attitude_age_max_s", self.attitude_age_max_s, 0.02, 5.0)?;
        check("mission.obstacles_age_max_s", self.obstacles_age_max_s, 0.15, 10.0)?;
        check("mission.bearing_age_max_s", self.bearing_age_max_s, 0.05, 60.0)?;
        check("mission.no_path_max_s", self.no_path_max_s, 2.0, 600.0)?;
        check("mission.stall_s", self.stall_s, 1.0, 600.0)?;
        check("mission.stall_radius_m", self.stall_radius_m, 0.1, 100.0)?;
        Ok(Mission { config: *self })
    }
}

/// Input of the mission in a step.
#[derive(Clone, Copy, Debug)]
pub struct Input {
    /// The time of the step.
    pub now: Instant,
    /// Whether we are in control.
    pub control: Control,
    /// When the position was received; `None` if never, or not finite.
    pub position: Option<Instant>,
    /// When the attitude was received; `None` if never, or not finite.
    pub attitude: Option<Instant>,
    /// The contradiction between positions and velocities, if any.
    pub contradiction: Option<Stale>,
    /// When the newest obstacle measurement in the map was made.
    pub obstacles: Option<Instant>,
    /// When the last usable bearing was measured.
    pub bearing: Option<Instant>,
    /// Flags of the last bearing, usable or not.
    pub bearing_flags: Flags,
    /// The planner has not answered the last request in time.
    pub is_plan_late: bool,
    /// The beacon is reached, and the landing is in command.
    pub is_arriving: bool,
    /// Where the vehicle is.
    pub place_ned_m: Horizontal,
    /// Where the source is believed to be.
    pub source_ned_m: Option<Horizontal>,
}

/// A place that the vehicle has not left; it has left one without a radius.
#[derive(Clone, Copy, Debug, Default)]
struct Stay {
    since: Instant,
    from_ned_m: Horizontal,
    radius_m: f32,
}

/// State of the mission.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    /// The last step in control.
    looked: Instant,
    /// The last step that called [`Mission::conclude`].
    concluded: Instant,
    no_path_since: Option<Instant>,
    stalling: Stay,
    circling: Stay,
    given_up: bool,
}

impl State {
    /// Whether the goal has been given up, until the mode is entered again.
    pub(super) fn has_given_up(&self) -> bool {
        self.given_up
    }

    #[cfg(test)]
    pub(super) fn give_up(&mut self) {
        self.given_up = true;
    }

    /// A path that is found only for a moment now and then does not count: time on a path is subtracted from the time
    /// without one.
    fn follow(&mut self, now: Instant) {
        let since = self.no_path_since.map(|since| since.plus_micros(2 * now.0.saturating_sub(self.concluded.0)));
        self.no_path_since = since.filter(|since| *since < now);
    }

    /// The planner's delay, or a hold for something that is missing, says nothing about the goal: no clock counts it.
    fn wait(&mut self, micros: u64) {
        if let Some(since) = &mut self.no_path_since {
            *since = since.plus_micros(micros);
        }
        self.stalling.since = self.stalling.since.plus_micros(micros);
        self.circling.since = self.circling.since.plus_micros(micros);
    }
}

/// Progress of the plan in a step, once the mission has returned [`Behaviour::Follow`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Following.
    Following,
    /// The plan says brake.
    NoPath,
    /// There is no plan, or it has run out, and the next one is still in time.
    RanOut,
    /// There is no plan, or it ends here, and the next one is late.
    Late,
    /// The guard braked.
    GuardBraked,
    /// The demand was not finite.
    NotFinite,
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mission {
    config: Config,
}

impl Mission {
    /// Before the chain: whether the plan may be followed at all. [`Outcome::Nominal`] if so.
    pub fn admit(&self, state: &mut State, input: &Input) -> Outcome {
        match input.control {
            Control::Granted => {}
            withheld => {
                *state = State::default();
                return if withheld == Control::LinkLost { Outcome::LinkLost } else { Outcome::NotInControl };
            }
        }
        let step_us = input.now.micros_since(core::mem::replace(&mut state.looked, input.now));
        let missing = self.missing(input);
        if input.is_plan_late || missing.is_some() {
            state.wait(step_us);
        }
        if let Some(missing) = missing {
            state.concluded = input.now;
            return missing;
        }
        if input.is_arriving {
            *state = State::default();
            return Outcome::Nominal;
        }
        if self.gives_up(state, input) { Outcome::GoalUnreachable } else { Outcome::Nominal }
    }

    /// The first input that is missing, for which the vehicle holds.
    fn missing(&self, input: &Input) -> Option<Outcome> {
        let c = &self.config;
        if self.stale(input).is_some() {
            Some(Outcome::StaleOwnship)
        } else if c.obstacles_required && is_old(input.now, input.obstacles, c.obstacles_age_max_s) {
            Some(Outcome::StaleObstacles)
        } else if !is_old(input.now, input.bearing, c.bearing_age_max_s) {
            None
        } else if input.bearing_flags.contains(Flags::UNCALIBRATED) {
            Some(Outcome::Uncalibrated)
        } else if input.bearing_flags.contains(Flags::AMBIGUOUS) {
            Some(Outcome::Ambiguous)
        } else {
            Some(Outcome::NoSignal)
        }
    }

    /// Why ownship is unusable, if it is: the first reason that applies.
    #[must_use]
    pub fn stale(&self, input: &Input) -> Option<Stale> {
        if is_old(input.now, input.position, self.config.position_age_max_s) {
            Some(Stale::PositionOld)
        } else if is_old(input.now, input.attitude, self.config.attitude_age_max_s) {
            Some(Stale::AttitudeOld)
        } else {
            input.contradiction
        }
    }

    /// After the chain: the outcome from the plan's progress.
    pub fn conclude(&self, state: &mut State, now: Instant, progress: Progress) -> Outcome {
        if progress == Progress::NoPath {
            state.no_path_since.get_or_insert(now);
        } else if progress == Progress::Following {
            state.follow(now);
        }
        state.concluded = now;
        match progress {
            Progress::Following | Progress::RanOut => Outcome::Nominal,
            Progress::NoPath => Outcome::NoPath,
            Progress::Late => Outcome::PlanLate,
            Progress::GuardBraked => Outcome::GuardBrake,
            Progress::NotFinite => Outcome::Fault,
        }
    }

    /// Whether the goal has to be given up: no retry goes on for ever.
    #[inline(never)]
    fn gives_up(&self, state: &mut State, input: &Input) -> bool {
        let c = &self.config;
        // Circles around the source are no progress, however wide they are.
        let away_m = input.source_ned_m.map_or(f32::INFINITY, |source| source.minus(input.place_ned_m).norm());
        let around_m = if away_m < AROUND * c.stall_radius_m { c.stall_radius_m + 2.0 * away_m } else { 0.0 };
        let stalls = self.stays(&mut state.stalling, input, c.stall_radius_m);
        let circles = self.stays(&mut state.circling, input, around_m);
        let has_no_path = state.no_path_since.is_some_and(|since| input.now.seconds_since(since) > c.no_path_max_s);
        state.given_up |= stalls || circles || has_no_path;
        state.given_up
    }

    /// Whether the vehicle has stayed where it was for the time that so wide a place may take, `stall_s` for each stall radius. It
    /// begins anew with this radius where it has left, and when a clock was set back.
    #[inline(never)]
    fn stays(&self, stay: &mut Stay, input: &Input, radius_m: f32) -> bool {
        if input.place_ned_m.minus(stay.from_ned_m).norm() >= stay.radius_m || stay.since > input.now {
            *stay = Stay { since: input.now, from_ned_m: input.place_ned_m, radius_m };
        }
        input.now.seconds_since(stay.since) * self.config.stall_radius_m > self.config.stall_s * stay.radius_m
    }
}

/// Whether a message is older than the limit, or in the future by as much, or was never received.
fn is_old(now: Instant, heard: Option<Instant>, limit_s: f32) -> bool {
    heard.is_none_or(|at| now.seconds_since(at) > limit_s || at.seconds_since(now) > limit_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Instant = Instant(100_000_000);

    fn ago(seconds: f32) -> Option<Instant> {
        Some(Instant(NOW.0 - (seconds * 1e6) as u64))
    }

    fn fresh() -> Input {
        Input {
            now: NOW,
            control: Control::Granted,
            position: ago(0.02),
            attitude: ago(0.02),
            contradiction: None,
            obstacles: ago(0.1),
            bearing: ago(0.02),
            bearing_flags: Flags::default(),
            is_plan_late: false,
            is_arriving: false,
            place_ned_m: Horizontal::default(),
            source_ned_m: None,
        }
    }

    /// All is of this moment.
    fn fresh_at(now: Instant) -> Input {
        let at = Some(now);
        Input { now, position: at, attitude: at, obstacles: at, bearing: at, ..fresh() }
    }

    fn step_at(step: u64) -> Instant {
        Instant(NOW.0 + step * 20_000)
    }

    fn admit(input: &Input) -> Outcome {
        Config::default().build().unwrap().admit(&mut State::default(), input)
    }

    #[test]
    fn fresh_inputs_are_nominal_and_followed() {
        assert_eq!(admit(&fresh()), Outcome::Nominal);
        assert_eq!(Outcome::Nominal.behaviour(), Behaviour::Follow);
    }

    #[test]
    fn without_a_link_or_the_mode_nothing_is_said() {
        let outcome = admit(&Input { control: Control::LinkLost, ..fresh() });
        assert_eq!((outcome, outcome.behaviour()), (Outcome::LinkLost, Behaviour::None));
        let outcome = admit(&Input { control: Control::NotInControl, ..fresh() });
        assert_eq!((outcome, outcome.behaviour()), (Outcome::NotInControl, Behaviour::None));
    }

    #[test]
    fn stale_or_missing_ownship_holds() {
        for input in [
            Input { position: ago(0.31), ..fresh() },
            Input { attitude: ago(0.21), ..fresh() },
            Input { position: None, ..fresh() },
            Input { attitude: None, ..fresh() },
            // A clock that went back is as bad as an old message.
            Input { position: Some(Instant(NOW.0 + 5_000_000)), ..fresh() },
        ] {
            let outcome = admit(&input);
            assert_eq!((outcome, outcome.behaviour()), (Outcome::StaleOwnship, Behaviour::Hold), "{input:?}");
        }
    }

    #[test]
    fn ownship_that_contradicts_itself_holds_and_says_in_what() {
        let mission = Config::default().build().unwrap();
        for stale in [Stale::VelocityContradicts, Stale::PositionFrozen] {
            let input = Input { contradiction: Some(stale), ..fresh() };
            assert_eq!((admit(&input), mission.stale(&input)), (Outcome::StaleOwnship, Some(stale)));
            let old = Input { attitude: ago(0.21), ..input };
            assert_eq!(mission.stale(&old), Some(Stale::AttitudeOld));
            assert_eq!(mission.stale(&Input { position: None, ..old }), Some(Stale::PositionOld));
        }
        assert_eq!(mission.stale(&fresh()), None);
    }

    #[test]
    fn stale_obstacles_hold_unless_none_are_required() {
        let input = Input { obstacles: ago(0.6), ..fresh() };
        assert_eq!((admit(&input), admit(&input).behaviour()), (Outcome::StaleObstacles, Behaviour::Hold));
        assert_eq!(admit(&Input { obstacles: None, ..fresh() }), Outcome::StaleObstacles);
        let free = Config { obstacles_required: false, ..Config::default() }.build().unwrap();
        assert_eq!(free.admit(&mut State::default(), &input), Outcome::Nominal);
    }

    #[test]
    fn a_lost_bearing_holds_and_says_why() {
        for (flags, expected) in [
            (Flags::NO_SIGNAL, Outcome::NoSignal),
            (Flags::default(), Outcome::NoSignal),
            (Flags::AMBIGUOUS, Outcome::Ambiguous),
            (Flags::UNCALIBRATED, Outcome::Uncalibrated),
        ] {
            for bearing in [ago(1.1), None] {
                let outcome = admit(&Input { bearing, bearing_flags: flags, ..fresh() });
                assert_eq!((outcome, outcome.behaviour()), (expected, Behaviour::Hold));
            }
            assert_eq!(admit(&Input { bearing_flags: flags, ..fresh() }), Outcome::Nominal, "one bad frame is no loss");
        }
    }

    #[test]
    fn plan_trouble_holds_by_name() {
        let mission = Config::default().build().unwrap();
        for (progress, expected) in [
            (Progress::NoPath, Outcome::NoPath),
            (Progress::Late, Outcome::PlanLate),
            (Progress::GuardBraked, Outcome::GuardBrake),
            (Progress::NotFinite, Outcome::Fault),
        ] {
            let outcome = mission.conclude(&mut State::default(), NOW, progress);
            assert_eq!((outcome, outcome.behaviour()), (expected, Behaviour::Hold));
        }
    }

    #[test]
    fn no_path_for_long_is_given_up_until_a_fresh_entry() {
        let (mission, mut state) = (Config::default().build().unwrap(), State::default());
        mission.conclude(&mut state, NOW, Progress::NoPath);
        let later = |s: u64| {
            let place_ned_m = Horizontal { north: s as f32 * 2.0, east: 0.0 };
            Input { place_ned_m, ..fresh_at(step_at(50 * s)) }
        };
        assert_eq!(mission.admit(&mut state, &later(14)), Outcome::Nominal);
        let outcome = mission.admit(&mut state, &later(16));
        assert_eq!((outcome, outcome.behaviour()), (Outcome::GoalUnreachable, Behaviour::Hold));
        mission.conclude(&mut state, NOW, Progress::Following);
        assert_eq!(mission.admit(&mut state, &later(17)), Outcome::GoalUnreachable, "not by itself");
        mission.admit(&mut state, &Input { control: Control::NotInControl, ..later(18) });
        assert_eq!(mission.admit(&mut state, &later(19)), Outcome::Nominal);
    }

    #[test]
    fn the_time_of_a_hold_for_something_missing_counts_neither_as_no_path_nor_as_no_progress() {
        let mission = Config::default().build().unwrap();
        for progress in [Progress::NoPath, Progress::Following] {
            let mut state = State::default();
            let outcome = |state: &mut State, step: u64, has_signal: bool, has_obstacles: bool| {
                let now = step_at(step);
                let (bearing, obstacles) = (has_signal.then_some(now), has_obstacles.then_some(now));
                let outcome = mission.admit(state, &Input { obstacles, bearing, ..fresh_at(now) });
                if outcome == Outcome::Nominal {
                    mission.conclude(state, now, progress);
                }
                outcome
            };
            for step in 0..250 {
                assert_eq!(outcome(&mut state, step, true, true), Outcome::Nominal);
            }
            for step in 250..5_000 {
                assert_eq!(outcome(&mut state, step, false, true), Outcome::NoSignal);
            }
            for step in 5_000..10_000 {
                assert_eq!(outcome(&mut state, step, true, false), Outcome::StaleObstacles);
            }
            for step in 10_000..10_450 {
                assert_eq!(outcome(&mut state, step, true, true), Outcome::Nominal, "{progress:?} {step}");
            }
        }
    }

    #[test]
    fn after_a_hold_a_moment_on_a_path_counts_as_that_moment() {
        let mission = Config::default().build().unwrap();
        let mut state = State::default();
        let step = |state: &mut State, step: u64, has_obstacles: bool, progress: Progress| {
            let now = step_at(step);
            let input = Input { obstacles: has_obstacles.then_some(now), ..fresh_at(now) };
            let outcome = mission.admit(state, &input);
            if outcome == Outcome::Nominal {
                mission.conclude(state, now, progress);
            }
            outcome
        };
        // 14 s without a path, 8 s of a hold, a moment of one, and then none again: 15 s are over a second later.
        (0..700).for_each(|k| assert_eq!(step(&mut state, k, true, Progress::NoPath), Outcome::Nominal));
        (700..1_100).for_each(|k| assert_eq!(step(&mut state, k, false, Progress::NoPath), Outcome::StaleObstacles));
        step(&mut state, 1_100, true, Progress::Following);
        let given_up = (1_101..1_800).find(|k| step(&mut state, *k, true, Progress::NoPath) != Outcome::Nominal);
        assert!(given_up.is_some_and(|k| (1_150..1_170).contains(&k)), "{given_up:?}");
    }

    #[test]
    fn the_time_that_a_plan_is_late_counts_neither_as_no_path_nor_as_no_progress() {
        let mission = Config::default().build().unwrap();
        for (progress, late_steps, expected_s) in [
            (Progress::NoPath, 0, 15.0),
            (Progress::NoPath, 2_000, 55.0),
            (Progress::Following, 0, 20.0),
            (Progress::Following, 5_000, 120.0),
        ] {
            let mut state = State::default();
            let given_up = (0..10_000).find(|step| {
                let is_plan_late = (100..100 + late_steps).contains(step);
                let input = Input { is_plan_late, ..fresh_at(step_at(*step)) };
                let outcome = mission.admit(&mut state, &input);
                mission.conclude(&mut state, input.now, if is_plan_late { Progress::Late } else { progress });
                outcome == Outcome::GoalUnreachable
            });
            let given_up_s = given_up.unwrap() as f32 * 0.02;
            assert!((given_up_s - expected_s).abs() < 0.05, "{progress:?}, {late_steps} late: {given_up_s}");
        }
    }

    #[test]
    fn a_path_that_is_found_for_a_moment_now_and_then_does_not_put_off_giving_up_and_one_half_of_the_time_does() {
        let mission = Config::default().build().unwrap();
        let run = |without_steps: u64| {
            let mut state = State::default();
            (0..5_000_u64).find(|step| {
                let place_ned_m = Horizontal { north: 0.02 * *step as f32, east: 0.0 };
                let input = Input { place_ned_m, ..fresh_at(step_at(*step)) };
                let outcome = mission.admit(&mut state, &input);
                let is_without = step % 100 < without_steps;
                mission.conclude(
                    &mut state,
                    input.now,
                    if is_without { Progress::NoPath } else { Progress::Following },
                );
                outcome == Outcome::GoalUnreachable
            })
        };
        // 15 s without one, with one for a quarter of the time: 1.5 s and -0.5 s in 2 s.
        assert!(run(75).is_some_and(|step| (27.0..31.0).contains(&(step as f32 * 0.02))), "{:?}", run(75));
        assert_eq!(run(50), None);
    }

    #[test]
    fn standing_still_for_long_is_given_up_and_slow_progress_is_not() {
        let mission = Config::default().build().unwrap();
        let run = |speed_mps: f32| {
            let mut state = State::default();
            (0..100_u64)
                .map(|s| {
                    let place_ned_m = Horizontal { north: speed_mps * s as f32, east: 0.0 };
                    mission.admit(&mut state, &Input { place_ned_m, ..fresh_at(step_at(50 * s)) })
                })
                .position(|outcome| outcome == Outcome::GoalUnreachable)
        };
        assert_eq!(run(0.0), Some(21));
        assert_eq!(run(0.1), None);
    }

    #[test]
    fn circles_around_the_source_have_an_end_however_wide_they_are_and_a_source_that_moves_on_is_followed() {
        let mission = Config::default().build().unwrap();
        let given_up_s = |circle_m: f32, source_mps: f32| {
            let mut state = State::default();
            (0..600_u64).find(|s| {
                let source = Horizontal { north: source_mps * *s as f32, east: 3.0 };
                let place_ned_m = source.plus(Horizontal::from_bearing(0.6 * *s as f32).times(circle_m));
                let input = Input { place_ned_m, source_ned_m: Some(source), ..fresh_at(step_at(50 * s)) };
                mission.admit(&mut state, &input) == Outcome::GoalUnreachable
            })
        };
        for (circle_m, longest_s) in [(0.4, 40), (1.0, 61), (2.0, 101), (4.0, 181)] {
            let given_up_s = given_up_s(circle_m, 0.0);
            assert!(given_up_s.is_some_and(|s| s <= longest_s), "{circle_m} m: {given_up_s:?}");
        }
        assert_eq!(given_up_s(2.0, 0.3), None);
    }
}
