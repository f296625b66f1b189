//! Any steering: demands and places through the guard alone, and flights through guidance and planner, step by step.

mod drawn;

use std::f32::consts::PI;

use foxhound_core::base::ned::{Horizontal, Ned};
use foxhound_core::base::obstacle::{Circle, Disc, Neighbour};
use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::pose::Pose;
use foxhound_core::base::time::Instant;
use foxhound_core::control::guard::{self, Action, GuardInput, Setpoint};
use foxhound_core::control::track::Demand;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::guidance::mission::{Behaviour, Control, Outcome};
use foxhound_core::guidance::systems::Systems as _;
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input, Output};
use foxhound_core::landing::observation::PadObservation;
use foxhound_core::mapping::map::CIRCLES_MAX;
use foxhound_core::mapping::scan::{Points, Scan};
use foxhound_core::planning::planner::{self, Answer, Plan, Verdict, Workspace};
use foxhound_papers::AllSystems;

use super::{Draw, Reached};
use drawn::{
    any_bearing, bearing, circle, circles, draw_time, guard_config, guidance_config, look, not_absurd, place, points,
    scan, sensor, situation, vehicle,
};

/// Longest flight, steps.
const STEPS_MAX: u32 = 400;
/// Farther out than this a place is not exact enough to measure clearances by.
const NEAR_M: f32 = 100.0;

/// Any steering. Of a case, `answers` are the steps and plans, `usable` those that moved the vehicle or may be followed.
pub fn steer(case: &[u8]) -> Reached {
    let draw = &mut Draw { rest: case };
    if draw.below(3) == 0 { guarded(draw) } else { flown(draw) }
}

/// A command against the one before it.
struct Step<'a> {
    limits: &'a guard::Config,
    dt_s: f32,
    setpoint: Setpoint,
    last: Ned,
    last_change_mps: f32,
    /// Whether the jerk limit holds: nothing comes at the vehicle.
    is_calm: bool,
}

impl Step<'_> {
    fn change_mps(&self) -> f32 {
        self.setpoint.velocity_ned_mps.horizontal().minus(self.last.horizontal()).norm()
    }

    /// Comparisons are false for what is not a number.
    fn check(&self, about: &dyn Fn() -> String) {
        let (limits, velocity) = (self.limits, self.setpoint.velocity_ned_mps);
        assert!(velocity.is_finite() && self.setpoint.yaw_rate_radps.is_finite(), "not finite: {}", about());
        // The evader may be the faster one.
        let fastest_mps = limits.v_max_mps.max(limits.evade_max_mps);
        assert!(velocity.horizontal().norm() <= fastest_mps * 1.0001, "speed: {}", about());
        assert!(velocity.down.abs() <= limits.v_down_max_mps, "vertical speed: {}", about());
        assert!(self.setpoint.yaw_rate_radps.abs() <= limits.yaw_rate_max_radps, "yaw rate: {}", about());
        let (change_mps, most) = (self.change_mps(), limits.a_max_mps2 * self.dt_s);
        // Differences of single-precision speeds.
        let grain = 1e-5 + 1e-6 * fastest_mps;
        assert!(change_mps <= most * 1.001 + grain, "acceleration: {}", about());
        assert!((velocity.down - self.last.down).abs() <= most * 1.001 + grain, "vertical acceleration: {}", about());
        let is_faster = velocity.horizontal().norm() > self.last.horizontal().norm() + 2.0 * grain;
        if self.is_calm && is_faster {
            let built_up = limits.jerk_max_mps3 * self.dt_s * self.dt_s;
            assert!(change_mps <= self.last_change_mps + built_up * 1.001 + grain, "jerk: {}", about());
        }
    }
}

/// How far a place is from a segment, in double precision.
fn from_segment_m(point: Horizontal, a: Horizontal, b: Horizontal) -> f64 {
    let to = |p: Horizontal| [f64::from(p.north) - f64::from(a.north), f64::from(p.east) - f64::from(a.east)];
    let (along, place) = (to(b), to(point));
    let length_squared = along[0] * along[0] + along[1] * along[1];
    let share = if length_squared > 0.0 { (along[0] * place[0] + along[1] * place[1]) / length_squared } else { 0.0 };
    let share = share.clamp(0.0, 1.0);
    (place[0] - share * along[0]).hypot(place[1] - share * along[1])
}

/// Any demands, situations and obstacles through the guard.
fn guarded(draw: &mut Draw<'_>) -> Reached {
    let mut reached = Reached::default();
    let limits = guard_config(draw);
    let dt_s = draw.between(0.005, 0.1);
    let Ok(guard) = limits.build(&vehicle(draw), &sensor(draw)) else { return reached };
    reached.configured = true;
    let mut state = guard::State::default();
    let (mut last, mut last_change_mps) = (Ned::default(), 0.0);
    while !draw.rest.is_empty() && reached.answers < STEPS_MAX {
        match draw.below(8) {
            0 => {
                let pose = Pose { position_ned_m: place(draw), yaw_rad: not_absurd(draw.any(-4.0, 4.0)) };
                guard.note_scan(&mut state, &scan(draw, Instant(0)), &pose, false);
            }
            1 => {
                let obstacles: Vec<_> = circles(draw).iter().map(|circle| guard.obstacle(circle)).collect();
                let pose = Pose { position_ned_m: place(draw), yaw_rad: not_absurd(draw.any(-4.0, 4.0)) };
                guard.note_circles(&mut state, &obstacles, &pose);
            }
            2 if draw.flag() => {
                state.release(draw.flag().then(|| draw.any(-20.0, 5.0)));
                (last, last_change_mps) = (Ned::default(), 0.0);
            }
            _ => {
                let situation = situation(draw);
                let demand = Demand {
                    velocity_ned_mps: Horizontal { north: draw.any(-3.0, 3.0), east: draw.any(-3.0, 3.0) },
                    down_mps: draw.any(-1.0, 1.0),
                    yaw_rate_radps: draw.any(-3.0, 3.0),
                };
                let obstacles: Vec<_> = circles(draw).iter().map(|circle| guard.obstacle(circle)).collect();
                let ruling = guard.step(&mut state, &demand, &situation, &obstacles, dt_s);
                let about =
                    || format!("{ruling:?} after {last:?}: {demand:?} {situation:?} {obstacles:?} {dt_s} {limits:?}");
                let stands = |obstacle: &Neighbour| obstacle.velocity_ned_mps == Horizontal::default();
                let is_calm = !situation.is_evading && obstacles.iter().all(stands);
                let step = Step { limits: &limits, dt_s, setpoint: ruling.setpoint, last, last_change_mps, is_calm };
                step.check(&about);
                assert!(ruling.look_ned_rad.is_none_or(f32::is_finite), "where to look: {}", about());
                check_altitude(&step, &situation, &about);
                if matches!(ruling.action, Action::Passed | Action::Limited) {
                    check_way(&limits, ruling.setpoint, &situation, &obstacles, &about);
                }
                reached.answers += 1;
                let velocity = ruling.setpoint.velocity_ned_mps;
                reached.usable += u32::from(velocity.horizontal().norm() > 0.01);
                (last, last_change_mps) = (velocity, step.change_mps());
            }
        }
    }
    reached
}

/// Beyond the band of altitude nothing goes on outwards but what is being braked.
fn check_altitude(step: &Step<'_>, situation: &GuardInput, about: &dyn Fn() -> String) {
    let [Some(down_m), Some(held_m)] =
        [situation.down_m, situation.held_down_m].map(|down_m| down_m.filter(|down_m| down_m.is_finite()))
    else {
        return;
    };
    let slowed = |speed_mps: f32| (speed_mps - step.limits.a_max_mps2 * step.dt_s * 0.999).max(0.0) + 1e-5;
    let down_mps = step.setpoint.velocity_ned_mps.down;
    let too_low = down_m >= held_m + step.limits.altitude_band_m && down_mps > slowed(step.last.down);
    let too_high = down_m <= held_m - step.limits.altitude_band_m && -down_mps > slowed(-step.last.down);
    assert!(!too_low && !too_high, "altitude: {}", about());
}

/// What is granted can be braked away inside the fence and clear of what stands, or does not make it worse.
fn check_way(
    limits: &guard::Config,
    setpoint: Setpoint,
    situation: &GuardInput,
    obstacles: &[Neighbour],
    about: &dyn Fn() -> String,
) {
    let (position, rest) = (situation.position_ned_m, situation.rest_ned_m);
    if rest.norm() > NEAR_M || position.norm() > NEAR_M {
        return;
    }
    let velocity = setpoint.velocity_ned_mps.horizontal();
    let end = rest.plus(velocity.times(0.5 * velocity.norm() / limits.a_max_mps2));
    let depth_m = |place| limits.fence.inside(place).map_or(f32::INFINITY, |(_, depth_m)| depth_m);
    let (before_m, after_m) = (depth_m(rest), depth_m(end));
    assert!(after_m >= before_m.min(0.0) - 1e-2, "fence, {before_m} then {after_m}: {}", about());
    // The map lets no other circles through.
    let is_sane = |o: &Neighbour| o.reach_m.is_finite() && o.center_ned_m.norm() < NEAR_M;
    let stands = |o: &&Neighbour| o.velocity_ned_mps == Horizontal::default() && is_sane(o);
    for obstacle in obstacles.iter().filter(stands) {
        let reach_m = f64::from(obstacle.reach_m);
        let committed_m = from_segment_m(obstacle.center_ned_m, position, rest) - reach_m;
        let after_m = from_segment_m(obstacle.center_ned_m, rest, end) - reach_m;
        let least_m = committed_m.min(0.0) - 2e-3;
        assert!(after_m >= least_m, "obstacle {obstacle:?}, {committed_m} then {after_m}: {}", about());
    }
}

/// A flight with a vehicle that obeys at once.
struct Flight {
    config: guidance::Config,
    guidance: Guidance<64>,
    state: guidance::State<64>,
    systems: AllSystems,
    workspace: Workspace,
    now: Instant,
    ownship: Ownship,
    source_ned_m: Horizontal,
    circles: Vec<Circle>,
    control: Control,
    /// What still works.
    is_heard: bool,
    is_seen: bool,
    is_planned: bool,
    height_m: Option<f32>,
    is_landed: bool,
    /// The planner's answer, and the steps until it is there.
    answer: Option<(Answer, u8)>,
    plan_steps: u8,
    last: Ned,
    last_change_mps: f32,
    steps: u32,
    reached: Reached,
}

/// What differs from the ordinary in a step.
#[derive(Default)]
struct Odd {
    scan: Option<Scan>,
    points: Option<Points>,
    bearing: Option<Bearing>,
    answer: Option<Answer>,
    look: Option<PadObservation>,
    is_silent: bool,
}

/// Flights through any configuration, with anything in their way.
fn flown(draw: &mut Draw<'_>) -> Reached {
    let config = guidance_config(draw);
    let (Ok(systems), Ok(guidance)) = (AllSystems::build(&config), AllSystems::guidance::<64>(&config)) else {
        return Reached::default();
    };
    let mut flight = Flight {
        state: guidance.start(),
        config,
        guidance,
        systems,
        workspace: Workspace::default(),
        now: Instant(u64::from(draw.word())),
        ownship: Ownship::default(),
        source_ned_m: place(draw),
        circles: circles(draw),
        control: Control::Granted,
        is_heard: true,
        is_seen: true,
        is_planned: true,
        height_m: None,
        is_landed: false,
        answer: None,
        plan_steps: if draw.flag() { 0 } else { draw.below(8) },
        last: Ned::default(),
        last_change_mps: 0.0,
        steps: 0,
        reached: Reached { configured: true, ..Reached::default() },
    };
    while !draw.rest.is_empty() && flight.reached.answers < STEPS_MAX {
        match draw.byte() {
            count @ 0..160 => {
                for _ in 0..=count % 24 {
                    flight.step(&Odd::default());
                }
            }
            event => flight.happens(event, draw),
        }
    }
    flight.reached
}

impl Flight {
    fn happens(&mut self, event: u8, draw: &mut Draw<'_>) {
        let mut odd = Odd::default();
        match event % 16 {
            0 => self.now = draw.instant(self.now),
            1 => self.now = Instant(self.now.0.saturating_sub(u64::from(draw.word() % 5_000_000))),
            2 => {
                self.control = [Control::Granted, Control::NotInControl, Control::LinkLost][usize::from(draw.below(3))];
            }
            3 => self.circles = circles(draw),
            4 => self.circles.push(circle(draw)),
            5 => self.is_heard = draw.below(3) != 0,
            6 => self.is_seen = draw.below(3) != 0,
            7 => self.is_planned = draw.below(3) != 0,
            8 => {
                let time = draw_time(draw, self.now);
                odd.scan = Some(scan(draw, time));
            }
            9 => {
                let time = draw_time(draw, self.now);
                odd.points = Some(points(draw, time));
            }
            10 => odd.bearing = Some(any_bearing(draw, self.now)),
            11 => odd.answer = Some(self.any_plan(draw)),
            12 => odd.is_silent = true,
            13 => self.source_ned_m = place(draw),
            14 => {
                odd.look = Some(look(draw, self.now));
                self.height_m = draw.flag().then(|| draw.any(-1.0, 12.0));
                self.is_landed = draw.below(4) == 0;
            }
            _ => {
                let ownship = &mut self.ownship;
                let field = match draw.below(10) {
                    0 => &mut ownship.position_ned_m.north,
                    1 => &mut ownship.position_ned_m.east,
                    2 => &mut ownship.position_ned_m.down,
                    3 => &mut ownship.velocity_ned_mps.north,
                    4 => &mut ownship.velocity_ned_mps.east,
                    5 => &mut ownship.roll_rad,
                    6 => &mut ownship.pitch_rad,
                    7 => &mut ownship.yaw_rate_radps,
                    _ => &mut ownship.yaw_rad,
                };
                *field = draw.any(-4.0, 4.0);
                // It is heard once; what is no place does not last.
                self.step(&odd);
                let place = self.ownship.position_ned_m.horizontal();
                if !self.ownship.is_finite() || place.norm() > 1e5 {
                    self.ownship = Ownship::default();
                }
            }
        }
        self.step(&odd);
    }

    fn known(&self) -> Vec<Disc> {
        self.state.map().discs().collect()
    }

    /// A plan that no planner made, or the active one, or one that was asked for, bent.
    fn any_plan(&self, draw: &mut Draw<'_>) -> Answer {
        let mut answer = self.systems.answer(&mut Workspace::default(), self.state.request(), &self.known());
        let plan = &mut answer.plan;
        plan.id = if draw.below(4) == 0 { draw.word() } else { plan.id };
        let index = usize::from(draw.byte()) % plan.waypoints_ned_m.len();
        plan.waypoints_ned_m[index] = place(draw);
        if draw.below(4) == 0 {
            plan.verdict = if plan.verdict == Verdict::Brake { Verdict::Follow } else { Verdict::Brake };
        }
        answer
    }

    /// One step, and whether it keeps what was promised.
    fn step(&mut self, odd: &Odd) {
        let tick_s = self.config.tick_s;
        self.now = self.now.plus_micros((tick_s * 1e6) as u64);
        (self.ownship.position_time, self.ownship.attitude_time) = (self.now, self.now);
        let front_end = match odd.bearing {
            Some(bearing) => FrontEnd::Bearing(bearing),
            None if self.is_heard => FrontEnd::Bearing(self.bearing()),
            None => FrontEnd::Nothing,
        };
        let answer = odd.answer.clone().or_else(|| match self.answer.take() {
            Some((answer, 0)) => Some(answer),
            Some((answer, steps)) => {
                self.answer = Some((answer, steps - 1));
                None
            }
            None => None,
        });
        let input = Input {
            now: self.now,
            front_end,
            ownship: (!odd.is_silent).then_some(self.ownship),
            scan: odd.scan.as_ref(),
            points: odd.points.as_ref(),
            circles: (self.is_seen && self.steps.is_multiple_of(5)).then_some(&*self.circles),
            look: odd.look,
            height_m: self.height_m,
            is_landed: self.is_landed,
            control: self.control,
            answer: answer.as_ref(),
        };
        let output = self.guidance.step(&mut self.state, &input);
        self.check(&output, odd);
        self.fly(&output);
        if output.plan_requested && self.is_planned {
            let known = self.known();
            let answer = self.systems.answer(&mut self.workspace, self.state.request(), &known);
            check_plan(&answer.plan, self.state.request());
            self.reached.answers += 1;
            self.reached.usable += u32::from(answer.plan.verdict == Verdict::Follow);
            self.answer = Some((answer, self.plan_steps));
        }
    }

    fn check(&mut self, output: &Output, odd: &Odd) {
        self.steps += 1;
        assert_eq!(output.time, self.now);
        if self.control != Control::Granted {
            // The next command starts from rest.
            (self.last, self.last_change_mps) = (Ned::default(), 0.0);
        }
        let about = || {
            format!(
                "{output:?} after {:?}, control {:?}, {:?}, {:?}",
                self.last, self.control, self.ownship, self.config
            )
        };
        let behaviour = output.outcome.behaviour();
        if self.control == Control::Granted {
            assert!(behaviour != Behaviour::None || output.outcome == Outcome::Landed, "{}", about());
        } else {
            assert_eq!(output.setpoint, Setpoint::default(), "without control: {}", about());
            let withheld = [Outcome::LinkLost, Outcome::NotInControl, Outcome::Landed];
            assert!(withheld.contains(&output.outcome), "{}", about());
        }
        let is_calm = self.state.map().circles().all(|circle| circle.velocity_ned_mps == Horizontal::default())
            && !self.state.tracks().all().iter().any(|track| track.moves());
        let step = Step {
            limits: &self.config.guard,
            dt_s: self.config.tick_s,
            setpoint: output.setpoint,
            last: self.last,
            last_change_mps: self.last_change_mps,
            is_calm,
        };
        step.check(&about);
        assert!(self.state.map().circles().all(|circle| circle.is_plausible()), "the map: {}", about());
        assert!(self.state.map().circles().count() <= CIRCLES_MAX);
        if let Some(bearing_rad) = output.source_bearing_ned_rad {
            assert!(bearing_rad.abs() <= PI + 1e-5, "the source's bearing: {}", about());
        }
        if odd.answer.is_none() {
            assert!(output.target_ned_m.is_none_or(Horizontal::is_finite), "the target: {}", about());
        }
        let velocity = output.setpoint.velocity_ned_mps;
        self.last_change_mps = step.change_mps();
        self.last = velocity;
        self.reached.answers += 1;
        self.reached.usable += u32::from(velocity.horizontal().norm() > 0.01);
    }

    /// The vehicle does as it is told.
    fn fly(&mut self, output: &Output) {
        let (tick_s, velocity) = (self.config.tick_s, output.setpoint.velocity_ned_mps);
        let position = &mut self.ownship.position_ned_m;
        position.north += velocity.north * tick_s;
        position.east += velocity.east * tick_s;
        position.down += velocity.down * tick_s;
        self.ownship.velocity_ned_mps = velocity;
        self.ownship.yaw_rate_radps = output.setpoint.yaw_rate_radps;
        self.ownship.yaw_rad += output.setpoint.yaw_rate_radps * tick_s;
        for circle in &mut self.circles {
            circle.center_ned_m = circle.center_ned_m.plus(circle.velocity_ned_mps.times(tick_s));
        }
    }

    fn bearing(&self) -> Bearing {
        let to = self.source_ned_m.minus(self.ownship.position_ned_m.horizontal());
        bearing(to.bearing_rad() - self.ownship.yaw_rad, 0.02, self.now)
    }
}

fn check_plan(plan: &Plan, request: &planner::PlanRequest) {
    assert_eq!(plan.id, request.id);
    let is_finite = plan.waypoints_ned_m.iter().all(|waypoint| waypoint.is_finite())
        && plan.start_ned_m.is_finite()
        && plan.target_ned_m.is_finite()
        && !plan.cost.is_nan()
        && plan.source.is_none_or(|source| source.place_ned_m.is_finite() && source.sigma_m >= 0.0);
    assert!(is_finite, "{plan:?} for {request:?}");
}
