//! One step of the fast loop: input is taken, the mission decides, and one setpoint is output.

use super::intake::ownship_at;
use super::mission::{self, Behaviour, Control, Mission, Outcome, Progress};
use super::turning::Turning;
use super::{Guidance, Input, Output, State};
use crate::base::history::FullPose;
use crate::base::ned::{Horizontal, Ned};
use crate::base::obstacle::Neighbour;
use crate::base::ownship::{Ownship, Stale};
use crate::base::time::Instant;
use crate::base::trace::Trace;
use crate::base::units::between;
use crate::control::guard::{self, GuardInput, Setpoint};
use crate::control::track::{self, Demand};
use crate::doa::bearing::{Bearing, Flags};
use crate::landing;
use crate::localize::source::near::Fix;
use crate::planning::planner::{Plan, Searched, Verdict};
use crate::planning::rollout::WAYPOINTS;

/// A landing begins no longer than this after a bearing: longer than any radio's pause and any turn of one antenna.
const HEARD_S: f32 = 60.0;

/// What the mission says about this step.
struct Decision<'a> {
    outcome: Outcome,
    stale: Option<Stale>,
    mission: &'a Mission,
    /// Set while the vehicle turns to receive.
    turning: Option<&'a Turning>,
}

/// What is commanded in this step.
#[derive(Default)]
struct Command {
    setpoint: Setpoint,
    guard: guard::Action,
    plan_requested: bool,
}

impl<const N: usize> Guidance<N> {
    /// One step of the fast loop: all input is processed, and nothing is left for the next step.
    pub fn step(&self, state: &mut State<N>, input: &Input<'_, N>) -> Output {
        state.tick = state.tick.wrapping_add(1);
        take_ownship(state, input.ownship);
        let heard = self.listen(state, input.front_end);
        let (bearing, bearing_ned_rad) = heard.and_then(|heard| self.hear(state, &heard)).unzip();
        let bearing_ned_rad = bearing_ned_rad.flatten();
        self.look(state, input);
        self.take_over(state, input.answer);
        self.estimate_wind(state, input.control);
        self.land(state, input, bearing.as_ref());
        let situation = self.situation(state, input.now);
        let mut decision = self.decide(state, input, &situation);
        let Command { setpoint, guard, plan_requested } = self.act(state, input, &situation, &mut decision);
        self.vehicle_model.command(&mut state.vehicle.model, setpoint.velocity_ned_mps.horizontal());
        note(&mut state.trace, bearing.as_ref(), &setpoint);

        let is_overhead = bearing.is_some_and(|bearing| is_overhead(state.vehicle.ownship.as_ref(), &bearing));
        let plan = state.plans.active.as_ref();
        Output {
            time: input.now,
            outcome: decision.outcome,
            stale: decision.stale,
            setpoint,
            bearing: bearing.map(|bearing| if is_overhead { unusable(bearing) } else { bearing }),
            bearing_ned_rad: bearing_ned_rad.filter(|_| !is_overhead),
            source_bearing_ned_rad: state.belief.bearing_ned_rad(),
            target_ned_m: plan.map(|plan| plan.target_ned_m),
            source: plan.and_then(|plan| plan.source),
            source_share_and_nis: state.belief.share_and_nis(),
            landing: state.arrival.advice,
            guard,
            guard_counts: state.control.guard.counts(),
            plan_requested,
            trace_hash: state.trace.hash(),
        }
    }

    /// Estimates the gusts from the last position received: in control, and unless its velocity is wrong.
    fn estimate_wind(&self, state: &mut State<N>, control: Control) {
        let is_told = control == Control::Granted && state.vehicle.agreement.found().is_none();
        let Some(ownship) = state.vehicle.ownship.as_ref().filter(|_| is_told) else { return };
        let velocity_ned_mps = ownship.velocity_ned_mps.horizontal();
        self.wind.begin(&mut state.vehicle.wind, ownship.roll_rad, ownship.pitch_rad, velocity_ned_mps);
        self.wind.step(&mut state.vehicle.wind, &state.vehicle.model, velocity_ned_mps, ownship.position_time);
    }

    /// Asks the mission what to do, and whether to search.
    fn decide(&self, state: &mut State<N>, input: &Input<'_, N>, situation: &GuardInput) -> Decision<'_> {
        let facts = self.mission_input(state, input, situation);
        let turning = self.turning.as_ref().filter(|turning| turning.is_used(&state.turning));
        let mission = turning.map_or(&self.mission, |turning| &turning.mission);
        let mut outcome = mission.admit(&mut state.mission, &facts);
        if outcome == Outcome::GoalUnreachable && state.belief.doubt_reflections() {
            // It may have followed a reflection that was none. Once more, straight towards what is received.
            state.mission = mission::State::default();
            state.plans.end_active();
            outcome = Outcome::Nominal;
        }
        let stale = mission.stale(&facts).filter(|_| outcome == Outcome::StaleOwnship);
        // It turns to receive a signal, not for any other reason to hold.
        let turning = turning.filter(|_| matches!(outcome, Outcome::Nominal | Outcome::NoSignal | Outcome::Ambiguous));
        let may_search = turning.is_none() || state.last_flags.contains(Flags::NO_SIGNAL);
        let has_ended = |plan: &Plan| plan.search == Some(Searched::Ended);
        state.plans.is_searching = self.searches
            && may_search
            && outcome == Outcome::NoSignal
            && !state.mission.has_given_up()
            && !is_landing(state)
            && !state.plans.active.as_ref().is_some_and(has_ended);
        Decision { outcome, stale, mission, turning }
    }

    /// Does what was decided. What happens may change the outcome.
    fn act(
        &self,
        state: &mut State<N>,
        input: &Input<'_, N>,
        situation: &GuardInput,
        decision: &mut Decision<'_>,
    ) -> Command {
        state.arrival.is_blocked = false;
        match decision.outcome.behaviour() {
            Behaviour::None => {
                self.let_go(state);
                if has_landed(state) && input.is_landed {
                    decision.outcome = Outcome::Landed;
                } else {
                    state.arrival.landing = landing::State::default();
                    state.belief.forget_near();
                    state.arrival.advice = None;
                }
                Command::default()
            }
            // On the ground nothing is waited for: the autopilot takes it for landed only while it is told to sink.
            Behaviour::Hold if has_landed(state) => self.descend(state, input, situation, decision),
            Behaviour::Follow if is_landing(state) => self.descend(state, input, situation, decision),
            Behaviour::Hold if !state.plans.is_searching => {
                let stay = Demand::default();
                let demand = decision.turning.map_or(stay, |turning| turning.turn(stay));
                // Its position or its surroundings are not known well enough to give way.
                let knows =
                    !matches!(decision.outcome, Outcome::StaleOwnship | Outcome::StaleObstacles | Outcome::Fault);
                // Nor is its position known well enough to keep clear of anything, or its altitude to be held.
                let is_lost = decision.outcome == Outcome::StaleOwnship;
                let down_m = situation.down_m.filter(|_| !is_lost);
                if decision.outcome == Outcome::StaleObstacles {
                    // Where they are by now is a guess.
                    state.surroundings.near.retain(|one| one.velocity_ned_mps == Horizontal::default());
                }
                // What a landing asked for is not done.
                state.arrival.landing.overrule(self.tick_s);
                if let Some(advice) = &mut state.arrival.advice {
                    advice.wants_land = false;
                }
                let situation = GuardInput { down_m, is_lost, ..*situation };
                let (setpoint, guard) = self.command(state, &demand, &situation, knows);
                Command { setpoint, guard, plan_requested: false }
            }
            Behaviour::Hold | Behaviour::Follow => self.follow(state, input, situation, decision),
        }
    }

    /// Follows the landing.
    fn descend(
        &self,
        state: &mut State<N>,
        input: &Input<'_, N>,
        situation: &GuardInput,
        decision: &mut Decision<'_>,
    ) -> Command {
        let (mut demand, ends) = landing_demand(state);
        if has_landed(state) {
            // On the ground nothing is kept away from and nothing looked at: it would tip over.
            state.surroundings.near.clear();
            let (Setpoint { velocity_ned_mps, .. }, guard) = self.command(state, &demand, situation, false);
            state.control.look_ned_rad = None;
            decision.outcome = Outcome::Landed;
            let velocity_ned_mps = Ned { down: velocity_ned_mps.down, ..Ned::default() };
            let setpoint = Setpoint { velocity_ned_mps, yaw_rate_radps: 0.0 };
            return Command { setpoint, guard, plan_requested: false };
        }
        if let Some(look_ned_rad) = state.control.look_ned_rad {
            demand.yaw_rate_radps = track::turn_to(look_ned_rad, situation.rest_yaw_rad);
        }
        // On the way down it does not give way.
        let stage = state.arrival.advice.map(|advice| advice.stage);
        let evades = !matches!(stage, Some(landing::Stage::Descending | landing::Stage::Committed));
        let (setpoint, guard) = self.command(state, &demand, situation, evades);
        state.arrival.is_blocked = guard == guard::Action::Braked;
        let progress = match guard {
            _ if !demand.velocity_ned_mps.is_finite() => Progress::NotFinite,
            guard::Action::Braked => Progress::GuardBraked,
            _ => Progress::Following,
        };
        decision.outcome = decision.mission.conclude(&mut state.mission, input.now, progress);
        if decision.outcome == Outcome::Nominal {
            decision.outcome = ends.unwrap_or(decision.outcome);
        }
        Command { setpoint, guard, plan_requested: false }
    }

    /// Follows the plan, and asks for the next one.
    fn follow(
        &self,
        state: &mut State<N>,
        input: &Input<'_, N>,
        situation: &GuardInput,
        decision: &mut Decision<'_>,
    ) -> Command {
        let demand = self.demand(state, situation);
        let demanded = demand.unwrap_or_default();
        let demanded = decision.turning.map_or(demanded, |turning| turning.turn(demanded));
        let (setpoint, guard) = self.command(state, &demanded, situation, true);
        state.arrival.is_blocked = guard == guard::Action::Braked;
        let progress = progress(state, demand, guard);
        let concluded = decision.mission.conclude(&mut state.mission, input.now, progress);
        if !state.plans.is_searching {
            decision.outcome = concluded;
        }
        Command { setpoint, guard, plan_requested: self.ask(state, input.now, situation, progress) }
    }

    /// The guard's input: the vehicle's position by now, and its rest point.
    fn situation(&self, state: &State<N>, now: Instant) -> GuardInput {
        let ownship = state.vehicle.ownship.unwrap_or_default();
        let velocity_ned_mps = ownship.velocity_ned_mps.horizontal();
        let age_s = between(now.seconds_since(ownship.position_time), 0.0, mission::OLDEST_POSITION_S);
        let position_ned_m = ownship.position_ned_m.horizontal().plus(velocity_ned_mps.times(age_s));
        let rest_ned_m = self.vehicle_model.rest_point(&state.vehicle.model, position_ned_m, velocity_ned_mps);
        GuardInput {
            position_ned_m,
            rest_ned_m,
            yaw_rad: ownship.yaw_rad,
            rest_yaw_rad: track::rest_yaw_rad(ownship.yaw_rad, ownship.yaw_rate_radps),
            delay_s: self.vehicle_model.delay_s(),
            gust_margin_m: self.wind.margin_m(&state.vehicle.wind),
            has_gusts: self.wind.has_gusts(&state.vehicle.wind),
            is_evading: false,
            may_be_unseen: false,
            is_lost: false,
            down_m: state.vehicle.ownship.map(|ownship| ownship.position_ned_m.down),
            held_down_m: state.control.hold_down_m,
        }
    }

    /// Runs the landing for this step; not before the vehicle is in control, and not after, unless it has landed.
    fn land(&self, state: &mut State<N>, input: &Input<'_, N>, bearing: Option<&Bearing>) {
        let Some(lander) = &self.lander else { return };
        let was_landing = is_landing(state);
        if input.control != Control::Granted && !(input.is_landed && was_landing) {
            return;
        }
        // What was given up is not begun again, whatever comes into view.
        if state.mission.has_given_up() && !was_landing {
            return;
        }
        let (now, ownship) = (input.now, input.ownship.as_ref());
        // What was concluded before begins nothing while nothing is heard.
        let hears = was_landing || state.belief.updated().is_some_and(|at| now.seconds_since(at) < HEARD_S);
        let fix = landing::fresh(ownship, now).and_then(|ownship| self.approach(state, input, bearing, ownship));
        let fix = fix.filter(|_| hears);
        let estimate = state.belief.direct().filter(|_| hears);
        let facts = landing::Input {
            now,
            ownship,
            height_m: input.height_m,
            poses: &state.vehicle.poses,
            fix,
            estimate: estimate.as_ref(),
            look: input.look,
            is_landed: input.is_landed,
            is_blocked: state.arrival.is_blocked,
            clearance_m: clearance_m(state),
            tick_s: self.tick_s,
        };
        state.arrival.advice = Some(lander.step(&mut state.arrival.landing, &facts));
        let by_pad = input.ownship.and_then(|ownship| state.arrival.landing.height_m(ownship.position_ned_m.down));
        state.vehicle.height_m = input.height_m.or(by_pad);
        if was_landing && !is_landing(state) {
            // It seeks again, from its present position.
            state.plans.end_active();
        }
    }

    /// The belief's fix of the source in the last metres.
    fn approach(
        &self,
        state: &mut State<N>,
        input: &Input<'_, N>,
        bearing: Option<&Bearing>,
        ownship: &Ownship,
    ) -> Option<Fix> {
        if let Some(jump) = state.vehicle.jump_m {
            state.belief.shift_near(jump);
            state.arrival.landing.shift(jump);
        }
        let pose = FullPose::carried(ownship, input.now);
        let is_placed = |bearing: &&Bearing| ownship_at(&state.vehicle, bearing.time).is_some();
        let heard = bearing.filter(is_placed);
        let heard = heard.map(|bearing| (bearing, state.vehicle.poses.at(bearing.time).unwrap_or(pose)));
        let height_m = landing::plausible_height_m(input.height_m);
        self.localizer.observe_near(&mut state.belief, input.now, heard, &pose, height_m)
    }

    fn mission_input(&self, state: &State<N>, input: &Input<'_, N>, situation: &GuardInput) -> mission::Input {
        let heard = input.ownship.filter(Ownship::is_plausible);
        mission::Input {
            now: input.now,
            control: input.control,
            position: heard.map(|ownship| ownship.position_time),
            attitude: heard.map(|ownship| ownship.attitude_time),
            contradiction: state.vehicle.agreement.found(),
            obstacles: state.surroundings.map.taken(),
            // The last metres are not flown by bearings.
            bearing: if is_landing(state) { Some(input.now) } else { state.belief.updated() },
            is_plan_late: state.plans.is_late,
            is_arriving: is_landing(state),
            bearing_flags: state.last_flags,
            place_ned_m: situation.position_ned_m,
            source_ned_m: state.belief.direct().map(|source| source.place_ned_m),
        }
    }
}

/// Distance of the hull from the nearest obstacle in the list of those that are near.
fn clearance_m<const N: usize>(state: &State<N>) -> f32 {
    let Some(ownship) = &state.vehicle.ownship else { return 0.0 };
    let here = ownship.position_ned_m.horizontal();
    let away_m = |other: &Neighbour| other.center_ned_m.minus(here).norm() - other.reach_m;
    let near = state.surroundings.near.iter().map(away_m);
    near.fold(f32::INFINITY, |least, away| if away < least { away } else { least })
}

fn take_ownship<const N: usize>(state: &mut State<N>, heard: Option<Ownship>) {
    if let Some(ownship) = heard.filter(Ownship::is_plausible) {
        state.vehicle.agreement.follow(state.vehicle.ownship.as_ref(), &ownship);
        state.vehicle.jump_m = state.vehicle.poses.note(&ownship);
        state.vehicle.ownship = Some(ownship);
    }
}

/// Adds a step's bearing and setpoint to the trace.
fn note(trace: &mut Trace, bearing: Option<&Bearing>, setpoint: &Setpoint) {
    if let Some(bearing) = bearing {
        trace.float(bearing.azimuth_rad);
        trace.float(bearing.sigma_rad);
        trace.word(u32::from(bearing.flags.0) | u32::from(bearing.valid) << 16);
    }
    let velocity = setpoint.velocity_ned_mps;
    for value in [velocity.north, velocity.east, velocity.down, setpoint.yaw_rate_radps] {
        trace.float(value);
    }
}

/// Whether the landing is in command, or has ended.
pub(super) fn is_landing<const N: usize>(state: &State<N>) -> bool {
    state.arrival.advice.is_some_and(|advice| advice.demand.is_some())
}

/// Whether the vehicle has landed and is done.
fn has_landed<const N: usize>(state: &State<N>) -> bool {
    state.arrival.advice.is_some_and(|advice| advice.stage == landing::Stage::Landed)
}

/// The landing's demand, and the outcome if it has ended.
fn landing_demand<const N: usize>(state: &State<N>) -> (Demand, Option<Outcome>) {
    let Some(advice) = state.arrival.advice else { return (Demand::default(), None) };
    let (velocity_ned_mps, down_mps) = advice.demand.unwrap_or_default();
    let ends = match advice.stage {
        landing::Stage::HandedOver => Some(Outcome::HandedOver),
        _ => None,
    };
    (Demand { velocity_ned_mps, down_mps, ..Demand::default() }, ends)
}

/// Progress of the plan in this step.
fn progress<const N: usize>(state: &State<N>, demand: Option<Demand>, action: guard::Action) -> Progress {
    let progress = match (&state.plans.active, demand) {
        (Some(_), Some(demand)) if !demand.velocity_ned_mps.is_finite() => Progress::NotFinite,
        (Some(plan), Some(_)) if plan.verdict == Verdict::Brake => Progress::NoPath,
        (Some(_), Some(_)) if state.control.track.passed >= WAYPOINTS => Progress::RanOut,
        (Some(_), Some(_)) if action == guard::Action::Braked => Progress::GuardBraked,
        (Some(_), Some(_)) => Progress::Following,
        _ => Progress::RanOut,
    };
    match progress {
        // It waits for the planner, not for a path.
        Progress::RanOut | Progress::NoPath | Progress::GuardBraked if state.plans.is_late => Progress::Late,
        progress => progress,
    }
}

/// Smallest ratio of a wave's horizontal part to the sine of the tilt for its azimuth to be reported.
const TILTS: f32 = 3.0;

/// Whether a wave comes from so nearly above or below that the vehicle's tilt decides on which side it is heard: whether it
/// comes from above or from below the array cannot tell, so that this cannot be taken out. Guidance averages over it, and the
/// landing takes its elevation; for anybody else it is no bearing.
fn is_overhead(ownship: Option<&Ownship>, bearing: &Bearing) -> bool {
    let wavenumber = bearing.quality.wavenumber;
    ownship.is_some_and(|ownship| wavenumber > 0.0 && wavenumber < TILTS * ownship.tilt_sine())
}

fn unusable(bearing: Bearing) -> Bearing {
    Bearing { valid: false, flags: bearing.flags.with(Flags::AMBIGUOUS), ..bearing }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::Config;

    #[test]
    fn between_two_positions_the_vehicle_is_where_its_velocity_has_taken_it() {
        let guidance = Config::default().build::<64>().unwrap();
        let mut state = guidance.start();
        let velocity_ned_mps = Ned { north: 1.0, east: -0.5, down: 0.0 };
        let heard = Instant(1_000_000);
        let ownship = Ownship { position_time: heard, velocity_ned_mps, ..Ownship::default() };
        guidance.step(&mut state, &Input { ownship: Some(ownship), ..Input::at(heard) });
        for (age_us, carried_s) in [(0, 0.0), (280_000, 0.28), (3_000_000, mission::OLDEST_POSITION_S)] {
            let GuardInput { position_ned_m, rest_ned_m, .. } = guidance.situation(&state, heard.plus_micros(age_us));
            let carried_ned_m = velocity_ned_mps.horizontal().times(carried_s);
            assert!(position_ned_m.minus(carried_ned_m).norm() < 1e-5, "{age_us} {position_ned_m:?}");
            let rest_ahead_m = rest_ned_m.minus(position_ned_m).dot(velocity_ned_mps.horizontal());
            assert!(rest_ahead_m > 0.3, "{age_us} {rest_ahead_m}");
        }
    }
}
