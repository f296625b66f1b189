//! The fast door: one step takes in a frame and the telemetry, and gives out one setpoint. Here the rooms are wired, in the
//! order of the data; this is the only file that knows them all. It is the uppermost floor, with the state machine
//! ([`mission`]) and the parameters ([`param`]), and may import every other.
//!
//! The planner is not called from here. A step that wants a plan says so ([`Output::plan_requested`]); whoever drives the
//! step lets [`crate::planning::planner`] answer [`State::request`], now or on a slower task, and hands the answer to any
//! later step. It takes effect [`Config::handover_ticks`] steps after the request, neither earlier nor later, so that the
//! flight does not depend on how fast the planner ran. An answer that comes later than that is dropped and counted; the old
//! plan goes on while it lasts.

use heapless::Vec;

use crate::base::adc::AdcFrame;
use crate::base::error::{ConfigError, Why, check};
use crate::base::ned::Horizontal;
use crate::base::obstacle::{Circle, Neighbour};
use crate::base::ownship::{Agreement, Ownship, Stale};
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::base::trace::Trace;
use crate::control::guard::{self, GuardInput, Setpoint};
use crate::control::track::{self, Demand};
use crate::control::{evade, gust, response};
use crate::doa::array;
use crate::doa::bearing::{self, Bearing, Finder, Flags};
use crate::guidance::mission::{Behaviour, Control, Facts, Outcome, Progress};
use crate::guidance::systems::Systems;
use crate::landing::observation::PadObservation;
use crate::landing::{self, Advice, Lander};
use crate::localize::goal;
use crate::localize::goal::posterior::Estimate;
use crate::localize::link_state::{self, Classifier, Sightline};
use crate::localize::source::Sighting;
use crate::localize::source::bank::{self, Mode, Way};
use crate::localize::source::gather::Gathering;
use crate::mapping::map::{self, Map};
use crate::mapping::scan::{self, Points, Refusal, Scan, Segmentation};
use crate::mapping::sight::Sight;
use crate::mapping::tracks::{self, Tracks};
use crate::planning::planner::{self, Learn, Plan, PlanRequest, Search, Searched, Verdict};
use crate::planning::rollout::WAYPOINTS;
use crate::signal::phase::{self, Phasors};

pub mod mission;
mod near;
pub mod param;
pub mod systems;
pub mod turning;

/// Where the vehicle was when a sensor looked is known from positions and attitudes that are no farther away in time.
const POSE_AGE_MAX_S: f32 = 0.3;
/// The fast loop heeds so many of the nearest ones; the planner is told all.
pub const OBSTACLES_MAX: usize = 64;
/// The guard lets the vehicle come so much nearer to what is told to move than to what stands, where the evader finds no better
/// way.
const BODY_M: f32 = 0.1;
/// What tells a reflected link from a direct one, and how many of the links are reflected for each that is direct.
const CLASSIFIER: Classifier = Classifier::TRAINED;
const REFLECTED_PRIOR: f32 = 0.25;
/// Share of the weight that the leading filter must have for its reflection to be followed.
const SURE: f32 = 0.7;

/// What the antennas brought.
#[derive(Clone, Copy, Debug)]
pub enum FrontEnd<'a, const N: usize> {
    /// Four channels of codes: the real thing.
    Frame(&'a AdcFrame<N>),
    /// What was made of them before, here or in a flight that is flown again.
    Heard(&'a Heard),
    /// A bearing made elsewhere.
    Bearing(Bearing),
    /// No frame in this step.
    Nothing,
}

/// All that guidance takes from a frame: with it instead of the codes a step comes to the same bits.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Heard {
    /// What the array made of the frame.
    pub bearing: Bearing,
    /// What it made that of, where the vehicle may seek by turning.
    pub phasors: Option<Phasors>,
}

/// Deliveries of obstacle sensors of which nothing was taken into the map, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refused {
    /// [`Refusal::NoOwnship`].
    pub no_ownship: u32,
    /// [`Refusal::TimesApart`].
    pub times_apart: u32,
    /// [`Refusal::Geometry`].
    pub geometry: u32,
    /// [`Refusal::Absurd`].
    pub absurd: u32,
}

impl Refused {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> u32 {
        [self.times_apart, self.geometry, self.absurd].iter().fold(self.no_ownship, |sum, n| sum.saturating_add(*n))
    }

    fn note(&mut self, taken: Result<Pose, Refusal>) {
        let count = match taken {
            Ok(_) => return,
            Err(Refusal::NoOwnship) => &mut self.no_ownship,
            Err(Refusal::TimesApart) => &mut self.times_apart,
            Err(Refusal::Geometry) => &mut self.geometry,
            Err(Refusal::Absurd) => &mut self.absurd,
        };
        *count = count.saturating_add(1);
    }
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
    pub landing: Option<Advice>,
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

/// Configuration of the whole chain, room by room.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Seed of everything random in the flight.
    pub seed: u64,
    /// Period of the steps.
    pub tick_s: f32,
    /// Steps from a plan's request to its taking effect.
    pub handover_ticks: u32,
    /// The next plan is asked for when this many waypoints are passed (main paper, section IV: 5).
    pub replan_at_waypoint: u8,
    /// It is asked for after this long at the latest.
    pub replan_after_s: f32,
    /// A plan that says brake is asked for again after this long.
    pub retry_s: f32,
    /// Phasor extraction.
    pub phase: phase::Config,
    /// Antenna array.
    pub array: array::Config,
    /// Angle of arrival.
    pub bearing: bearing::Config,
    /// Circles from scans.
    pub scan: scan::Config,
    /// Obstacle memory.
    pub map: map::Config,
    /// Tracks of what moves.
    pub tracks: tracks::Config,
    /// Filters of where the source is.
    pub source: bank::Config,
    /// Whether reflections are looked for.
    pub reflections: bool,
    /// Temporary target.
    pub goal: goal::Config,
    /// Planner.
    pub planner: planner::Config,
    /// The vehicle's answer to setpoints.
    pub response: response::Config,
    /// What is made of gusts.
    pub gust: gust::Config,
    /// Waypoint tracker.
    pub track: track::Config,
    /// What gets out of the way of what moves.
    pub evade: evade::Config,
    /// Safety filter.
    pub guard: guard::Config,
    /// State machine.
    pub mission: mission::Config,
    /// Seeking by turning, where there is no array or too little of it is left; none where its elements hear the same all
    /// round.
    pub turning: Option<turning::Config>,
    /// What it does where it arrives; without it the beacon is sought for ever.
    pub landing: Option<landing::Config>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            tick_s: 0.02,
            handover_ticks: 5,
            replan_at_waypoint: 5,
            replan_after_s: 0.7,
            retry_s: 0.5,
            phase: phase::Config::default(),
            array: array::Config::default(),
            bearing: bearing::Config::default(),
            scan: scan::Config::default(),
            map: map::Config::default(),
            tracks: tracks::Config::default(),
            source: bank::Config::DEFAULT,
            reflections: true,
            goal: goal::Config::default(),
            planner: planner::Config::default(),
            response: response::Config::default(),
            gust: gust::Config::default(),
            track: track::Config::default(),
            evade: evade::Config::default(),
            guard: guard::Config::default(),
            mission: mission::Config::default(),
            turning: None,
            landing: None,
        }
    }
}

impl Config {
    /// Sets the vehicle's radius wherever it counts.
    pub fn set_vehicle_radius_m(&mut self, radius_m: f32) {
        if let Some(explore) = &mut self.planner.explore {
            explore.clearance_m = radius_m + self.planner.margin_m;
        }
        self.planner.vehicle_radius_m = radius_m;
        self.guard.vehicle_radius_m = radius_m;
    }

    /// Checks every room's part.
    ///
    /// # Errors
    /// The first field that is refused.
    pub fn build<const N: usize>(&self) -> Result<Guidance<N>, ConfigError> {
        check("tick_s", self.tick_s, 0.005, 0.1)?;
        check("handover_ticks", self.handover_ticks as f32, 2.0, 100.0)?;
        check("replan_at_waypoint", f32::from(self.replan_at_waypoint), 1.0, WAYPOINTS as f32)?;
        check("replan_after_s", self.replan_after_s, 0.1, 60.0)?;
        check("retry_s", self.retry_s, 0.05, 10.0)?;
        if self.planner.vehicle_radius_m < self.guard.vehicle_radius_m {
            let why = Why::Inconsistent("the planner may not think the vehicle smaller than the guard does");
            return Err(ConfigError { field: "planner.vehicle_radius_m", value: self.planner.vehicle_radius_m, why });
        }
        self.planner.build()?;
        let response = self.response.build(self.tick_s)?;
        Ok(Guidance {
            seed: self.seed,
            tick_s: self.tick_s,
            handover_ticks: self.handover_ticks,
            replan_at_waypoint: usize::from(self.replan_at_waypoint),
            replan_ticks: libm::ceilf(self.replan_after_s / self.tick_s) as u32,
            retry_ticks: libm::ceilf(self.retry_s / self.tick_s) as u32,
            plan_margin_m: 0.5 * self.planner.margin_m,
            target_distance_m: self.goal.target_distance_m,
            known_source_ned_m: self.goal.known_source_ned_m,
            reflected_min: self.source.reflected_min,
            slack_m: self.source.slack_m,
            range_sigma_max: self.source.range_sigma_max,
            phase: self.phase.build()?,
            bearing: self.bearing.build(self.array.build()?)?,
            scan: self.scan.build()?,
            map: self.map.build()?,
            tracks: self.tracks.build()?,
            source: self.source.build()?,
            reflections: self.reflections,
            searches: self.planner.explore.is_some(),
            goal: self.goal.build()?,
            response,
            gust: self.gust.build(&response, self.tick_s)?,
            track: self.track.build()?,
            evade: self.evade.build(&response, self.guard.v_max_mps, self.guard.a_max_mps2)?,
            guard: self.guard.build()?,
            mission: self.mission.build()?,
            turning: match &self.turning {
                Some(turning) => Some(turning.build(&self.mission, self.guard.yaw_rate_max_radps)?),
                None => None,
            },
            lander: match &self.landing {
                Some(landing) => Some(landing.build()?),
                None => None,
            },
        })
    }
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
    bearing: bearing::Finder,
    scan: scan::Segmenter,
    map: map::Mapper,
    tracks: tracks::Tracker,
    source: bank::Bank,
    reflections: bool,
    searches: bool,
    goal: goal::Seeker,
    response: response::Response,
    gust: gust::Gauge,
    track: track::Tracker,
    evade: evade::Evader,
    guard: guard::Guard,
    mission: mission::Mission,
    turning: Option<turning::Turning>,
    lander: Option<Lander>,
}

/// What the fast loop carries from step to step.
#[derive(Clone, Debug)]
pub struct State<const N: usize> {
    tick: u32,
    phase: phase::State<N>,
    map: Map,
    tracks: Tracks,
    refused: Refused,
    gathering: Gathering,
    link: link_state::State,
    /// How likely the link is reflected, as of the last bearing.
    reflected: f32,
    source: bank::State,
    /// What the planner has learned of the source was about its image.
    misled: bool,
    /// What the bank said last.
    belief: Option<bank::Answer>,
    /// Nothing is heard, and the vehicle goes and looks for it.
    is_searching: bool,
    goal: goal::State,
    response: response::State,
    gust: gust::State,
    track: track::State,
    evade: evade::State,
    guard: guard::State,
    /// Where the guard wants to look before it goes on.
    look_ned_rad: Option<f32>,
    mission: mission::State,
    turning: turning::State,
    landing: landing::State,
    /// What the landing said last, and whether the guard braked then.
    advice: Option<Advice>,
    is_blocked: bool,
    height_m: Option<f32>,
    /// Obstacles near the vehicle, as of this step.
    near: Vec<Neighbour, OBSTACLES_MAX>,
    ownship: Option<Ownship>,
    agreement: Agreement,
    last_flags: Flags,
    hold_down_m: Option<f32>,
    request: PlanRequest,
    /// The step at which the request's answer takes effect; `None` when nothing is asked.
    due: Option<u32>,
    pending: Option<Plan>,
    active: Option<Plan>,
    /// When the active plan took effect.
    activated: u32,
    plans_late: u32,
    /// The last plan that was asked for did not come in time.
    is_plan_late: bool,
    trace: Trace,
}

impl<const N: usize> Default for State<N> {
    /// Before the first step, of whatever configuration.
    fn default() -> Self {
        Self {
            tick: 0,
            phase: phase::State::default(),
            map: Map::default(),
            tracks: Tracks::default(),
            refused: Refused::default(),
            gathering: Gathering::default(),
            link: link_state::State::new(),
            reflected: 0.0,
            source: bank::State::new(),
            misled: false,
            belief: None,
            is_searching: false,
            goal: goal::State::default(),
            response: response::State::default(),
            gust: gust::State::default(),
            track: track::State::default(),
            evade: evade::State::default(),
            guard: guard::State::default(),
            look_ned_rad: None,
            mission: mission::State::default(),
            turning: turning::State::default(),
            landing: landing::State::default(),
            advice: None,
            is_blocked: false,
            height_m: None,
            near: Vec::new(),
            ownship: None,
            agreement: Agreement::default(),
            last_flags: Flags::default(),
            hold_down_m: None,
            request: PlanRequest::default(),
            due: None,
            pending: None,
            active: None,
            activated: 0,
            plans_late: 0,
            is_plan_late: false,
            trace: Trace::default(),
        }
    }
}

impl<const N: usize> State<N> {
    /// The plan request that is under way. It is made with the obstacles that [`Self::map`] knew at its step.
    #[must_use]
    pub fn request(&self) -> &PlanRequest {
        &self.request
    }

    /// The known obstacles.
    #[must_use]
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// The bodies that are followed.
    #[must_use]
    pub fn tracks(&self) -> &Tracks {
        &self.tracks
    }

    /// Deliveries of obstacle sensors that were refused.
    #[must_use]
    pub const fn refused(&self) -> &Refused {
        &self.refused
    }

    /// Obstacles near the vehicle, as the guard took them in the last step.
    #[must_use]
    pub fn near(&self) -> &[Neighbour] {
        &self.near
    }

    /// What the obstacle sensors have looked at.
    #[must_use]
    pub fn sight(&self) -> &Sight {
        self.guard.sight()
    }

    /// How high the vehicle is over the ground, where that is known.
    #[must_use]
    pub const fn height_m(&self) -> Option<f32> {
        self.height_m
    }

    /// The plan that is being followed.
    #[must_use]
    pub fn plan(&self) -> Option<&Plan> {
        self.active.as_ref()
    }
}

impl<const N: usize> State<N> {
    /// The direction of a source that is heard by way of a wall, from a place.
    fn around_the_corner(&self, from_ned_m: Horizontal) -> Option<Horizontal> {
        let belief = self.belief.filter(|belief| belief.way != Way::Direct)?;
        let towards = belief.estimate.place_ned_m.minus(from_ned_m);
        let norm = towards.norm();
        (norm > 1e-3).then(|| towards.times(1.0 / norm))
    }
}

impl<const N: usize> Guidance<N> {
    /// The state before the first step.
    #[must_use]
    pub fn start(&self) -> State<N> {
        State::default()
    }

    /// Back to the state before the first step, in place: a second state on the stack is more than a microcontroller has
    /// room for.
    pub fn restart(&self, state: &mut State<N>) {
        let State {
            tick,
            phase,
            map,
            tracks,
            refused,
            gathering,
            link,
            reflected,
            source,
            misled,
            belief,
            is_searching,
            goal,
            response,
            gust,
            track,
            evade,
            guard,
            look_ned_rad,
            mission,
            turning,
            landing,
            advice,
            is_blocked,
            height_m,
            near,
            ownship,
            agreement,
            last_flags,
            hold_down_m,
            request,
            due,
            pending,
            active,
            activated,
            plans_late,
            is_plan_late,
            trace,
        } = state;
        (*tick, *activated, *plans_late, *is_plan_late) = (0, 0, 0, false);
        phase.clear();
        map.clear();
        tracks.clear();
        *refused = Refused::default();
        *gathering = Gathering::default();
        *link = link_state::State::new();
        *reflected = 0.0;
        *source = bank::State::new();
        (*misled, *is_searching) = (false, false);
        *belief = None;
        *goal = goal::State::default();
        *response = response::State::default();
        *gust = gust::State::default();
        *track = track::State::default();
        *evade = evade::State::default();
        *guard = guard::State::default();
        (*look_ned_rad, *hold_down_m) = (None, None);
        *mission = mission::State::default();
        *turning = turning::State::default();
        *landing = landing::State::default();
        (*advice, *is_blocked, *height_m) = (None, false, None);
        near.clear();
        *ownship = None;
        *agreement = Agreement::default();
        *last_flags = Flags::default();
        *request = PlanRequest::default();
        *due = None;
        *pending = None;
        *active = None;
        *trace = Trace::default();
    }

    /// One step of the fast loop: all that came in is taken in, and nothing is left for the next step.
    pub fn step(&self, state: &mut State<N>, input: &Input<'_, N>) -> Output {
        state.tick = state.tick.wrapping_add(1);
        if let Some(ownship) = input.ownship.filter(Ownship::is_plausible) {
            state.agreement.follow(state.ownship.as_ref(), &ownship);
            state.ownship = Some(ownship);
        }
        let heard = self.listen(state, input.front_end);
        let (bearing, bearing_ned_rad) = heard.and_then(|heard| self.hear(state, &heard)).unzip();
        let bearing_ned_rad = bearing_ned_rad.flatten();
        self.look(state, input);
        let plan_activated = self.take_over(state, input.plan);

        if let Some(ownship) = &state.ownship {
            let velocity_ned_mps = ownship.velocity_ned_mps.horizontal();
            self.gust.begin(&mut state.gust, ownship.roll_rad, ownship.pitch_rad, velocity_ned_mps);
            self.gust.step(&mut state.gust, &state.response, velocity_ned_mps, ownship.position_time);
        }
        let was_landing = is_landing(state);
        self.land(state, input, bearing.as_ref());
        if was_landing && !is_landing(state) {
            // It seeks again, from where it is now.
            state.active = None;
        }
        let situation = self.situation(state);
        let facts = self.facts(state, input, &situation);
        let turning = self.turning.as_ref().filter(|turning| turning.is_used(&state.turning));
        let mission = turning.map_or(&self.mission, |turning| &turning.mission);
        let mut outcome = mission.admit(&mut state.mission, &facts);
        let stale = mission.stale(&facts).filter(|_| outcome == Outcome::StaleOwnship);
        // It turns to hear something, and not for anything else that makes it hold.
        let turning = turning.filter(|_| matches!(outcome, Outcome::Nominal | Outcome::NoSignal | Outcome::Ambiguous));
        let may_search = turning.is_none() || state.last_flags.contains(Flags::NO_SIGNAL);
        let mut guard_action = guard::Action::Passed;
        let mut setpoint = Setpoint::default();
        let mut plan_requested = false;
        state.is_searching = self.searches
            && may_search
            && outcome == Outcome::NoSignal
            && !is_landing(state)
            && state.active.as_ref().is_none_or(|plan| plan.search != Some(Searched::Ended));
        match outcome.behaviour() {
            Behaviour::None if has_landed(state) && input.is_landed => {
                self.let_go(state);
                outcome = Outcome::Landed;
            }
            Behaviour::None => {
                self.let_go(state);
                state.landing = landing::State::default();
                state.advice = None;
            }
            Behaviour::Follow if is_landing(state) => {
                let (mut demand, ends) = landing_demand(state);
                if let Some(look_ned_rad) = state.look_ned_rad {
                    demand.yaw_rate_radps = self.track.turn_to(look_ned_rad, situation.yaw_rad);
                }
                (setpoint, guard_action) = self.command(state, &demand, &situation, false);
                let progress = match guard_action {
                    _ if !demand.velocity_ned_mps.is_finite() => Progress::NotFinite,
                    guard::Action::Braked => Progress::GuardBraked,
                    _ => Progress::Following,
                };
                outcome = mission.conclude(&mut state.mission, input.now, progress);
                if outcome == Outcome::Nominal {
                    outcome = ends.unwrap_or(outcome);
                }
            }
            Behaviour::Hold if !state.is_searching => {
                let stay = Demand::default();
                let demand = turning.map_or(stay, |turning| turning.turn(stay));
                // Where it is, or what is around it, is not known well enough to give way.
                let knows = !matches!(outcome, Outcome::StaleOwnship | Outcome::StaleObstacles | Outcome::Fault);
                (setpoint, _) = self.command(state, &demand, &situation, knows);
            }
            Behaviour::Hold | Behaviour::Follow => {
                let demand = self.demand(state, &situation);
                let demanded = demand.unwrap_or_default();
                let demanded = turning.map_or(demanded, |turning| turning.turn(demanded));
                (setpoint, guard_action) = self.command(state, &demanded, &situation, true);
                let progress = progress(state, demand, guard_action);
                let concluded = mission.conclude(&mut state.mission, input.now, progress);
                if !state.is_searching {
                    outcome = concluded;
                }
                plan_requested = self.ask(state, input.now, &situation, progress);
            }
        }
        state.is_blocked = guard_action == guard::Action::Braked;
        self.response.command(&mut state.response, setpoint.velocity_ned_mps.horizontal());

        if let Some(bearing) = &bearing {
            state.trace.float(bearing.azimuth_rad);
            state.trace.float(bearing.sigma_rad);
            state.trace.word(u32::from(bearing.flags.0) | u32::from(bearing.valid) << 16);
        }
        let velocity = setpoint.velocity_ned_mps;
        for value in [velocity.north, velocity.east, velocity.down, setpoint.yaw_rate_radps] {
            state.trace.float(value);
        }
        Output {
            time: input.now,
            outcome,
            stale,
            setpoint,
            bearing,
            bearing_ned_rad,
            source_bearing_ned_rad: state.goal.source_bearing_ned_rad(),
            target_ned_m: state.active.as_ref().map(|plan| plan.target_ned_m),
            source: state.active.as_ref().and_then(|plan| plan.source),
            source_share_and_nis: state.belief.map(|belief| (belief.share, belief.nis)),
            landing: state.advice,
            guard: guard_action,
            guard_counts: state.guard.counts(),
            plan_requested,
            plan_activated,
            plans_late: state.plans_late,
            trace_hash: state.trace.hash(),
        }
    }

    /// The phasors of a frame that the chain is not to go by, as when the receiver is examined; a step that comes with it gets
    /// [`FrontEnd::Nothing`]. What is known of the tone is forgotten before and after ([`Self::forget_tone`]).
    pub fn phasors(&self, state: &mut State<N>, snapshot: &AdcFrame<N>) -> Phasors {
        self.phase.step(&mut state.phase, snapshot)
    }

    /// What a frame says by itself, looked at as a whole: that is how one checks what was heard of it in a flight.
    pub fn bearing(&self, state: &mut State<N>, systems: &impl Systems, snapshot: &AdcFrame<N>) -> Bearing {
        systems.bearing(&self.bearing, &self.phasors(state, snapshot))
    }

    /// The next frame has nothing to do with the ones before.
    pub fn forget_tone(&self, state: &mut State<N>) {
        state.phase.reset();
    }

    /// Frame -> phasors -> bearing: the part of a step that has to do with codes. Whoever wants to keep what was heard calls
    /// it before the step, which then takes [`FrontEnd::Heard`].
    pub fn listen(&self, state: &mut State<N>, front_end: FrontEnd<'_, N>) -> Option<Heard> {
        self.listen_with(state, front_end, Finder::find)
    }

    /// The same with another way from phasors to a bearing, see [`Systems::bearing`].
    pub fn listen_with(
        &self,
        state: &mut State<N>,
        front_end: FrontEnd<'_, N>,
        find: impl FnOnce(&Finder, &Phasors) -> Bearing,
    ) -> Option<Heard> {
        match front_end {
            FrontEnd::Frame(snapshot) => {
                let phasors = self.phase.step(&mut state.phase, snapshot);
                let bearing = find(&self.bearing, &phasors);
                Some(Heard { bearing, phasors: self.turning.is_some().then_some(phasors) })
            }
            FrontEnd::Heard(heard) => Some(*heard),
            FrontEnd::Bearing(bearing) => Some(Heard { bearing, phasors: None }),
            FrontEnd::Nothing => None,
        }
    }

    /// Bearing -> direction of the source, and where it is.
    fn hear(&self, state: &mut State<N>, heard: &Heard) -> Option<(Bearing, Option<f32>)> {
        let Heard { bearing, phasors } = *heard;
        if let Some(turning) = &self.turning
            && turning.notice(&mut state.turning, &bearing)
        {
            return self.hear_by_turning(turning, state, &bearing, phasors.as_ref());
        }
        state.last_flags = bearing.flags;
        let sane =
            libm::fabsf(bearing.azimuth_rad) <= 100.0 && bearing.sigma_rad.is_finite() && bearing.sigma_rad > 0.0;
        let usable = state.ownship.filter(|_| bearing.valid && sane);
        let bearing_ned_rad = usable.map(|ownship| self.goal.observe(&mut state.goal, &bearing, &ownship));
        if let Some(ownship) = state.ownship.filter(|_| self.reflections) {
            self.classify(state, &bearing, bearing_ned_rad, &ownship);
        }
        if let (Some(ownship), Some(bearing_ned_rad)) = (usable, bearing_ned_rad) {
            self.gather(state, &bearing, bearing_ned_rad, &ownship);
        }
        Some((bearing, bearing_ned_rad))
    }

    /// Frame -> power -> rotation -> direction of the source. The link's state is not known: it is told from arrays.
    fn hear_by_turning(
        &self,
        turning: &turning::Turning,
        state: &mut State<N>,
        bearing: &Bearing,
        phasors: Option<&Phasors>,
    ) -> Option<(Bearing, Option<f32>)> {
        state.reflected = 0.0;
        let ownship = state.ownship?;
        let depression_rad = state.goal.depression_rad();
        let turned = turning.step(&mut state.turning, bearing, phasors, &ownship, depression_rad)?;
        state.last_flags = turned.bearing.flags;
        let observed = Some(turned.bearing).filter(|bearing| bearing.valid);
        let bearing_ned_rad = observed.map(|bearing| self.goal.observe(&mut state.goal, &bearing, &ownship));
        if let Some(sighting) = &turned.sighting {
            self.weigh(state, sighting);
        }
        Some((turned.bearing, bearing_ned_rad))
    }

    /// How likely the link is reflected, from what was heard and what was not.
    fn classify(&self, state: &mut State<N>, bearing: &Bearing, bearing_ned_rad: Option<f32>, ownship: &Ownship) {
        // A bearing made elsewhere says nothing of the waves that it was made from.
        if bearing_ned_rad.is_some() && bearing.quality.coherence.is_none() {
            state.reflected = 0.0;
            return;
        }
        let place_ned_m = ownship.position_ned_m.horizontal();
        let lines = state.active.as_ref().map_or(&[][..], |plan| &plan.lines);
        let sightline = match (lines, bearing_ned_rad) {
            ([], _) | (_, None) => Sightline::Unknown,
            (walls, Some(bearing_ned_rad)) => Sightline::among(walls, place_ned_m, bearing_ned_rad, self.slack_m),
        };
        let look = link_state::Features { place_ned_m, bearing, bearing_ned_rad, sightline };
        state.reflected = CLASSIFIER.step(&mut state.link, &look).reflected(REFLECTED_PRIOR);
    }

    /// Bearings -> sightings.
    fn gather(&self, state: &mut State<N>, bearing: &Bearing, bearing_ned_rad: f32, ownship: &Ownship) {
        let (at, place) = (bearing.time, ownship.position_ned_m.horizontal());
        let direction = Horizontal::from_bearing(bearing_ned_rad);
        let Some(sighting) = state.gathering.add(at, direction, place, bearing.sigma_rad) else { return };
        self.weigh(state, &sighting);
    }

    /// Sighting -> filters. One that came by way of a wall is handed on as the vehicle's mirror image would have had it,
    /// directly.
    fn weigh(&self, state: &mut State<N>, sighting: &Sighting) {
        if !sighting.is_plausible() {
            return;
        }
        let lines = state.active.as_ref().map_or(&[][..], |plan| &plan.lines);
        let answer = self.source.step(&mut state.source, sighting, state.reflected, lines);
        // A reflection is worth following when it is known where it leads.
        let sure = |answer: &bank::Answer| answer.mode == Mode::Go && answer.share > SURE;
        let answer =
            answer.map(|answer| if sure(&answer) { answer } else { bank::Answer { way: Way::Direct, ..answer } });
        let way = answer.map_or(Way::Direct, |answer| answer.way);
        let was_direct = state.belief.is_none_or(|belief| belief.way == Way::Direct);
        // What has been taken for the source was its image.
        state.misled |= was_direct && way != Way::Direct;
        state.belief = answer;
        state.goal.push_sighting(way.straightened(sighting));
    }

    /// What obstacle sensors delivered -> map -> what is near; and what was looked at -> guard. The scan comes last: what it says of
    /// a place holds.
    fn look(&self, state: &mut State<N>, input: &Input<'_, N>) {
        let (now, ownship) = (input.now, state.ownship);
        let pose = |time: Instant| pose_at(ownship.as_ref(), time);
        self.map.advance(&mut state.map, now);
        self.tracks.advance(&mut state.tracks, now);
        let circles =
            input.circles.map(|circles| pose(now).and_then(|pose| self.take_circles(state, now, circles, pose)));
        let points =
            input.points.map(|points| pose(points.time).and_then(|pose| self.take_points(state, now, points, pose)));
        let scan = input.scan.map(|scan| pose(scan.time).and_then(|pose| self.take_scan(state, now, scan, pose)));
        for taken in [circles, points, scan].into_iter().flatten() {
            state.refused.note(taken);
        }
        if let Some(ownship) = &state.ownship {
            near::gather(&self.guard, &state.map, ownship.position_ned_m.horizontal(), &mut state.near);
        }
        if let Some(Ok(pose)) = circles {
            self.guard.look_circles(&mut state.guard, &state.near, &pose);
        }
        if let (Some(scan), Some(Ok(pose))) = (input.scan, scan) {
            self.guard.look_scan(&mut state.guard, scan, &pose);
        }
    }

    /// Circles -> map; says from where they were seen.
    #[inline(never)]
    fn take_circles(
        &self,
        state: &mut State<N>,
        now: Instant,
        circles: &[Circle],
        pose: Pose,
    ) -> Result<Pose, Refusal> {
        self.map.observe_circles(&mut state.map, now, pose.position_ned_m, circles)?;
        Ok(pose)
    }

    /// Scan -> circles -> map; says from where it was made.
    #[inline(never)]
    fn take_scan(&self, state: &mut State<N>, now: Instant, scan: &Scan, pose: Pose) -> Result<Pose, Refusal> {
        if scan.is_fine() {
            self.tracks.observe_rays(&mut state.tracks, scan, &pose);
        }
        self.map_scan(state, now, scan, pose)
    }

    #[inline(never)]
    fn map_scan(&self, state: &mut State<N>, now: Instant, scan: &Scan, pose: Pose) -> Result<Pose, Refusal> {
        let mut look = Segmentation::default();
        self.scan.fit_into(&mut look, scan, &pose)?;
        if !scan.is_fine() {
            self.tracks.observe(&mut state.tracks, scan, &pose, &look.points_m);
        }
        let (centers_ned_m, radius_m) = self.tracks.left_by(&state.tracks);
        self.map.vacate(&mut state.map, &centers_ned_m, radius_m);
        self.map.observe_scan(&mut state.map, now, scan, &pose, &look);
        Ok(pose)
    }

    /// Single points -> circles -> map; says from where they were seen. They do not say what was looked at.
    #[inline(never)]
    fn take_points(&self, state: &mut State<N>, now: Instant, points: &Points, pose: Pose) -> Result<Pose, Refusal> {
        let mut look = Segmentation::default();
        self.scan.fit_points_into(&mut look, points, &pose)?;
        self.map.observe_points(&mut state.map, now, &look);
        Ok(pose)
    }

    /// Takes in the planner's answer and lets it take effect at its step; true if one did.
    fn take_over(&self, state: &mut State<N>, answer: Option<&Plan>) -> bool {
        if let Some(plan) = answer
            && state.due.is_some()
            && plan.id == state.request.id
        {
            state.pending = Some(plan.clone());
        }
        if state.due != Some(state.tick) {
            return false;
        }
        state.due = None;
        let answer = state.pending.take();
        state.is_plan_late = answer.is_none();
        let Some(plan) = answer else {
            state.plans_late = state.plans_late.saturating_add(1);
            return false;
        };
        state.trace.word(plan.id);
        for waypoint in &plan.waypoints_ned_m {
            state.trace.float(waypoint.north);
            state.trace.float(waypoint.east);
        }
        state.active = Some(plan);
        state.activated = state.tick;
        state.track.restart();
        true
    }

    /// Where the vehicle is and where it would come to rest.
    fn situation(&self, state: &State<N>) -> GuardInput {
        let ownship = state.ownship.unwrap_or_default();
        let position_ned_m = ownship.position_ned_m.horizontal();
        let velocity_ned_mps = ownship.velocity_ned_mps.horizontal();
        let rest_ned_m = self.response.rest_point(&state.response, position_ned_m, velocity_ned_mps);
        GuardInput {
            position_ned_m,
            rest_ned_m,
            yaw_rad: ownship.yaw_rad,
            delay_s: self.response.delay_s(),
            gust_margin_m: self.gust.margin_m(&state.gust),
            is_evading: false,
            down_m: state.ownship.map(|ownship| ownship.position_ned_m.down),
            held_down_m: state.hold_down_m,
        }
    }

    /// What the landing says of this step; nothing before the vehicle is in control, and nothing after, unless it has landed.
    fn land(&self, state: &mut State<N>, input: &Input<'_, N>, bearing: Option<&Bearing>) {
        let Some(lander) = &self.lander else { return };
        if input.control != Control::Granted && !(input.is_landed && is_landing(state)) {
            return;
        }
        let is_direct = state.reflected < self.reflected_min;
        let believed = state.belief.filter(|belief| belief.way == Way::Direct);
        let estimate = believed.map(|belief| belief.estimate);
        let facts = landing::Facts {
            now: input.now,
            ownship: input.ownship.as_ref().filter(|ownship| ownship.is_plausible()),
            height_m: input.height_m,
            bearing: bearing.filter(|_| is_direct),
            estimate: estimate.as_ref(),
            look: input.look,
            is_landed: input.is_landed,
            is_blocked: state.is_blocked,
            tick_s: self.tick_s,
        };
        state.advice = Some(lander.step(&mut state.landing, &facts));
        let by_pad = input.ownship.and_then(|ownship| state.landing.height_m(ownship.position_ned_m.down));
        state.height_m = input.height_m.or(by_pad);
    }

    fn facts(&self, state: &State<N>, input: &Input<'_, N>, situation: &GuardInput) -> Facts {
        let heard = input.ownship.filter(Ownship::is_plausible);
        Facts {
            now: input.now,
            control: input.control,
            position: heard.map(|ownship| ownship.position_time),
            attitude: heard.map(|ownship| ownship.attitude_time),
            contradiction: state.agreement.found(),
            obstacles: state.map.taken(),
            // The last metres are not flown by bearings.
            bearing: if is_landing(state) { Some(input.now) } else { state.goal.updated() },
            is_plan_late: state.is_plan_late,
            is_arriving: is_landing(state),
            bearing_flags: state.last_flags,
            place_ned_m: situation.position_ned_m,
        }
    }

    /// What the active plan asks for; `None` when there is nothing to follow.
    fn demand(&self, state: &mut State<N>, situation: &GuardInput) -> Option<Demand> {
        let plan = state.active.as_ref()?;
        let trajectory = &plan.waypoints_ned_m;
        let mut demand =
            self.track.step(&mut state.track, trajectory, situation.rest_ned_m, situation.yaw_rad, self.tick_s);
        if let Some(look_ned_rad) = state.look_ned_rad {
            demand.yaw_rate_radps = self.track.turn_to(look_ned_rad, situation.yaw_rad);
        }
        if plan.verdict == Verdict::Brake {
            demand.velocity_ned_mps = Horizontal::default();
            // Nothing safe in sight: look where the source is.
            if let Some(bearing_rad) = state.goal.source_bearing_ned_rad() {
                demand.yaw_rate_radps = self.track.turn_to(bearing_rad, situation.yaw_rad);
            }
        }
        Some(demand)
    }

    /// The demand, with the altitude held, past what moves and through the guard.
    fn command(
        &self,
        state: &mut State<N>,
        demand: &Demand,
        situation: &GuardInput,
        evades: bool,
    ) -> (Setpoint, guard::Action) {
        // The altitude of the first word heard in control; before it there is none to hold.
        let mut demand = *demand;
        let mut situation = *situation;
        if is_landing(state) {
            // What it is held at next is where the landing leaves it.
            state.hold_down_m = None;
            situation.held_down_m = None;
        } else if let Some(ownship) = &state.ownship {
            let down_m = ownship.position_ned_m.down;
            demand.down_mps = self.track.hold_altitude(*state.hold_down_m.get_or_insert(down_m), down_m);
        }
        if evades {
            let ownship = state.ownship.unwrap_or_default();
            let (standing, told) = near::told_apart(&state.near);
            let mut followed = Vec::new();
            near::followed(&self.guard, self.tracks.radius_m(), &state.tracks, &mut followed);
            let evasion = self.evade.step(
                &mut state.evade,
                demand.velocity_ned_mps,
                &evade::Input {
                    position_ned_m: situation.position_ned_m,
                    velocity_ned_mps: ownship.velocity_ned_mps.horizontal(),
                    command_ned_mps: state.guard.command_ned_mps(),
                    halfway_ned_mps: state.gust.halfway_mps(),
                    underway: &state.response,
                    has_looked: state.tracks.has_just_looked(),
                    standing,
                    moving: [told, &followed],
                },
            );
            if let Some(velocity_ned_mps) = evasion {
                demand.velocity_ned_mps = velocity_ned_mps;
                situation.is_evading = true;
            }
            // The guard keeps off where a body is now, as if it stood there; the hits of one that is followed are in the map.
            let standing = standing.len();
            for body in state.near.iter_mut().skip(standing) {
                body.velocity_ned_mps = Horizontal::default();
                body.reach_m -= BODY_M;
            }
        }
        let ruling = self.guard.step(&mut state.guard, &demand, &situation, &state.near, self.tick_s);
        state.look_ned_rad = ruling.look_ned_rad;
        (ruling.setpoint, ruling.action)
    }

    /// Out of control: everything that belongs to a mission starts over, what is known of the world stays.
    fn let_go(&self, state: &mut State<N>) {
        state.guard.release();
        state.gust.release();
        state.agreement.release();
        state.is_searching = false;
        state.look_ned_rad = None;
        state.track = track::State::default();
        state.evade = evade::State::default();
        state.hold_down_m = None;
        state.due = None;
        state.pending = None;
        state.active = None;
        state.is_plan_late = false;
    }

    /// Whether what is known by now stands in the way of the active plan's next waypoints.
    fn is_invalid(&self, state: &State<N>, situation: &GuardInput) -> bool {
        let State { active: Some(plan), near, track, .. } = state else { return false };
        let from = track.passed.min(WAYPOINTS);
        let next = plan.waypoints_ned_m.get(from..(from + 6).min(WAYPOINTS)).unwrap_or_default();
        near::stands_in_the_way(near, situation.rest_ned_m, next, self.plan_margin_m)
    }

    /// Asks for a plan where one is wanted; true if it did.
    fn ask(&self, state: &mut State<N>, now: Instant, situation: &GuardInput, progress: Progress) -> bool {
        let since = state.tick.wrapping_sub(state.activated);
        let wanted = match progress {
            Progress::RanOut | Progress::Late => true,
            Progress::NoPath => since >= self.retry_ticks,
            Progress::GuardBraked | Progress::NotFinite => since >= self.handover_ticks,
            Progress::Following => {
                state.track.passed >= self.replan_at_waypoint
                    || since >= self.replan_ticks
                    || self.is_invalid(state, situation)
            }
        };
        if !wanted || state.due.is_some() {
            return false;
        }
        // The rest point obeys at once, so that is where it will be when the plan takes effect.
        let ahead_s = self.tick_s * self.handover_ticks as f32;
        let start_ned_m = situation.rest_ned_m.plus(state.guard.command_ned_mps().times(ahead_s));
        let heard = state.goal.source_bearing_ned_rad().or(state.is_searching.then_some(situation.yaw_rad));
        let Some(bearing_rad) = heard else { return false };
        // On the measured line, which begins at the vehicle and not at the start of the plan; where that was reflected, on
        // the line to where it came from.
        let direction =
            state.around_the_corner(situation.position_ned_m).unwrap_or(Horizontal::from_bearing(bearing_rad));
        let along_m = start_ned_m.minus(situation.position_ned_m).dot(direction);
        let distance_m = self.target_distance_m + if along_m > 0.0 { along_m } else { 0.0 };
        state.request.id = state.request.id.wrapping_add(1);
        state.request.seed = self.seed;
        state.request.start_ned_m = start_ned_m;
        state.request.gust_margin_m = self.gust.margin_m(&state.gust);
        state.request.target_ned_m = situation.position_ned_m.plus(direction.times(distance_m));
        state.request.fresh = state.request.id == 1 || core::mem::take(&mut state.misled);
        state.request.wants_lines = state.reflected >= self.reflected_min;
        state.request.begins = state.active.is_none();
        state.request.position_ned_m = situation.position_ned_m;
        state.request.direction_ned = direction;
        let vague = |belief: &bank::Answer| belief.estimate.range_sigma_ratio > self.range_sigma_max;
        state.request.learn = state.belief.filter(vague).map(|belief| Learn {
            source_ned_m: belief.estimate.place_ned_m,
            covariance_m2: belief.estimate.covariance_m2,
            sigma_rad: if belief.estimate.bearing_sigma_rad > 0.01 { belief.estimate.bearing_sigma_rad } else { 0.01 },
        });
        state.request.known_source_ned_m = self.known_source_ned_m;
        let pose = Pose { position_ned_m: situation.position_ned_m, yaw_rad: situation.yaw_rad };
        state.request.search = state.is_searching.then_some(Search { now, pose });
        state.request.sightings = state.goal.take_sightings();
        state.due = Some(state.tick.wrapping_add(self.handover_ticks));
        true
    }
}

/// Whether the vehicle is flown by the landing, or has been to its end.
fn is_landing<const N: usize>(state: &State<N>) -> bool {
    state.advice.is_some_and(|advice| advice.demand.is_some())
}

/// Whether it stands on the ground and is done.
fn has_landed<const N: usize>(state: &State<N>) -> bool {
    state.advice.is_some_and(|advice| advice.stage == landing::Stage::Landed)
}

/// What the landing asks for, and the outcome if that is its end.
fn landing_demand<const N: usize>(state: &State<N>) -> (Demand, Option<Outcome>) {
    let Some(advice) = state.advice else { return (Demand::default(), None) };
    let (velocity_ned_mps, down_mps) = advice.demand.unwrap_or_default();
    let ends = match advice.stage {
        landing::Stage::HandedOver => Some(Outcome::HandedOver),
        landing::Stage::Landed => Some(Outcome::Landed),
        _ => None,
    };
    (Demand { velocity_ned_mps, down_mps, ..Demand::default() }, ends)
}

/// Where the vehicle was when a sensor looked, carried on from the last word about it.
///
/// # Errors
/// That is not known.
fn pose_at(ownship: Option<&Ownship>, time: Instant) -> Result<Pose, Refusal> {
    let ownship = ownship.ok_or(Refusal::NoOwnship)?;
    let is_apart =
        |heard: Instant| time.seconds_since(heard) > POSE_AGE_MAX_S || heard.seconds_since(time) > POSE_AGE_MAX_S;
    if is_apart(ownship.position_time) || is_apart(ownship.attitude_time) {
        return Err(Refusal::TimesApart);
    }
    let since_s = time.seconds_since(ownship.position_time);
    let moved = ownship.velocity_ned_mps.horizontal().times(since_s.clamp(0.0, 0.1));
    Ok(Pose { position_ned_m: ownship.position_ned_m.horizontal().plus(moved), yaw_rad: ownship.yaw_at(time) })
}

/// What became of the plan in this step.
fn progress<const N: usize>(state: &State<N>, demand: Option<Demand>, action: guard::Action) -> Progress {
    let progress = match (&state.active, demand) {
        (Some(_), Some(demand)) if !demand.velocity_ned_mps.is_finite() => Progress::NotFinite,
        (Some(plan), Some(_)) if plan.verdict == Verdict::Brake => Progress::NoPath,
        (Some(_), Some(_)) if state.track.passed >= WAYPOINTS => Progress::RanOut,
        (Some(_), Some(_)) if action == guard::Action::Braked => Progress::GuardBraked,
        (Some(_), Some(_)) => Progress::Following,
        _ => Progress::RanOut,
    };
    match progress {
        // It waits for the planner, not for a way.
        Progress::RanOut | Progress::NoPath | Progress::GuardBraked if state.is_plan_late => Progress::Late,
        progress => progress,
    }
}

#[cfg(test)]
mod taken;
#[cfg(test)]
mod tests;
