//! One closed-loop flight at a fixed step of 20 ms: world, sensor, autopilot, computer, autopilot, vehicle, and again. A
//! computer that keeps its own time ([`Computer::next_step_s`]) says when the steps are.
//!
//! The truth decides what the flight came to: *reached* within the goal tolerance (horizontally), *collision* when the
//! hull meets a pillar, *hold* when the vehicle stands still and says why, *timeout* otherwise. Simulated time is the only
//! time.
//!
//! Where the scenario has a landing the flight goes on until the vehicle has landed, or hovers and hands over: *reached* then
//! is the ground within the pad, or the air within the goal tolerance of the beacon.

use std::fmt;
use std::io;

use foxhound_computer::twin::Planned;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::control::response;
use foxhound_core::doa::bearing::{self, Estimator, Flags};
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::guidance::{self, FrontEnd, turning};
use foxhound_core::landing as core_landing;
use foxhound_core::planning::{explore, planner};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::computer::{BLOCK, Computer, ComputerError};
use crate::autopilot::{Autopilot, Start, tlog};
use crate::scenario::{BearingModel, OtherBeacon, Pulses, Scenario, SensorModel, Software, VehicleModel, inside};
use crate::world::air::{Air, Drift};
use crate::world::antennas::{Antennas, Fault, Interferer, Pattern, Reflection};
use crate::world::random::Random;
use crate::world::sensor::View;
use crate::world::vehicle::{Motion, Vehicle};
use crate::world::{Horizontal, Hull, Pose, World, from_core, horizontal, rays, wrap_pi};

#[cfg(test)]
mod disturbed;
mod landing;

use landing::Downward;
pub use landing::{Landing, Picture};

/// Length of one step.
pub const TICK_S: f64 = 0.02;
const TICK_US: u64 = 20_000;
/// Parts of a step after which the hull is checked.
const CHECKS_PER_TICK: usize = 4;
/// Steps from one word of the obstacle sensor to the next: 10 Hz.
const SENSOR_TICKS: u64 = 5;
/// Steps from one try of the pilot to give control to the next.
const PILOT_TICKS: u64 = 25;
/// Steps that a computer hears of another mode, where the mode that gives it control has to be entered after its start.
const ENTRY_TICKS: u64 = 100;
/// A vehicle that moved less than this within the last while stands still.
const STILL_M: f64 = 0.1;
const STILL_TICKS: usize = 150;
/// How far the clock jumps back as a fault.
const CLOCK_JUMP_US: u64 = 1_000_000;
/// Steps of the dead time and lag of the point mass: a setpoint waits for its 20 Hz slot, telemetry for the next step.
const POINT_DEAD_TIME_S: f32 = 0.06;
/// Clearance that a search keeps.
const EXPLORE_MARGIN_M: f64 = 0.05;
/// Sigma of a bearing that is known exactly, so that no weight is infinite.
const SIGMA_FLOOR_RAD: f64 = 1e-3;

/// What is flown.
#[derive(Clone, Debug, PartialEq)]
pub struct Mission {
    /// The world and the vehicle.
    pub scenario: Scenario,
    /// Seed of everything random.
    pub seed: u64,
    /// Which planner.
    pub planner: planner::Config,
    /// Which estimator.
    pub estimator: Estimator,
}

impl Mission {
    /// The configuration of the computer for this mission.
    #[must_use]
    pub fn guidance(&self) -> guidance::Config {
        let scenario = &self.scenario;
        let mut config = guidance::Config { seed: self.seed, planner: self.planner, ..guidance::Config::default() };
        config.set_vehicle_radius_m(scenario.drone_radius as f32);
        config.bearing.estimator = self.estimator;
        config.guard.v_max_mps = scenario.limits.v_max as f32;
        config.guard.a_max_mps2 = scenario.limits.a_max as f32;
        if scenario.bearing.tone_known {
            config.phase.tone_hz = Some(Antennas::default().tone_hz as f32);
        }
        let moves = scenario.goal_velocity.iter().any(|speed| *speed != 0.0);
        if !scenario.bearing.only && !moves {
            let [east, north] = scenario.goal.map(|metres| metres as f32);
            config.goal.known_source_ned_m = Some(foxhound_core::base::ned::Horizontal { north, east });
        }
        config.guard.sight.range_m = scenario.sensor.range_m as f32;
        // The others are flown as they are.
        if scenario.explore_s > 0.0 && self.planner.kind == planner::Kind::Foxhound {
            config.planner.explore = Some(explore::Config {
                limit_s: scenario.explore_s as f32,
                clearance_m: (scenario.drone_radius + EXPLORE_MARGIN_M) as f32,
                seed: self.seed as u32,
                ..explore::Config::default()
            });
        }
        config.turning = scenario.antenna.map(|antenna| {
            let mut turning = turning::Config {
                role: if antenna.single { turning::Role::Alone(0) } else { turning::Role::Fallback },
                boresights_rad: antenna.boresight_deg.map(|deg| deg.to_radians() as f32),
                yaw_rate_radps: antenna.turn_deg_per_s.to_radians() as f32,
                ..turning::Config::default()
            };
            turning.rss.pattern.exponent = antenna.exponent as f32;
            turning.rss.pattern.front_to_back_db = antenna.front_to_back_db as f32;
            turning
        });
        config.landing = scenario.landing.map(|landing| core_landing::Config {
            has_camera: landing.camera.is_some(),
            focal_widths: landing.camera.unwrap_or_default().focal_widths() as f32,
            pad_radius_m: landing.pad_radius as f32,
            request_land: landing.request_land,
            ..core_landing::Config::default()
        });
        config.planner.sees_m = config.guard.sight.range_m;
        config.planner.sees_rad = scenario.sensor.fov_deg.to_radians() as f32;
        config.guard.fov_rad = scenario.sensor.fov_deg.to_radians() as f32;
        config.response = match scenario.vehicle.model {
            VehicleModel::Point => {
                response::Config { dead_time_s: POINT_DEAD_TIME_S, lag_s: scenario.vehicle.lag_s as f32 }
            }
            VehicleModel::Arducopter => response::Config::default(),
        };
        config
    }
}

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Within the goal tolerance.
    Reached,
    /// Standing still, with a reason.
    Hold,
    /// The hull met a pillar.
    Collision,
    /// Still under way at the end of the time.
    Timeout,
}

/// What a flight came to: the object that is printed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The scenario's name.
    pub name: String,
    /// Seed of the flight.
    pub seed: u64,
    /// How it ended.
    pub result: Ending,
    /// The outcome that explains it, by name.
    pub reason: &'static str,
    /// Duration of the flight.
    pub time_s: f64,
    /// Length of the path flown.
    pub path_length_m: f64,
    /// Distance from the start to the goal's place at the end.
    pub straight_line_m: f64,
    /// Smallest distance between hull and pillars; none in a world without pillars.
    pub min_clearance_m: Option<f64>,
    /// Collisions, 0 or 1: the first one ends the flight.
    pub collisions: u32,
    /// Plans made.
    pub replans: u32,
    /// Error of the valid bearings, rms; none without any.
    pub bearing_rms_deg: Option<f64>,
    /// Hash over every bearing, plan and setpoint.
    pub trace_hash: String,
    /// How the landing went, where there was to be one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landing: Option<Landing>,
    /// Carried through from the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expect: Option<Value>,
    /// Carried through from the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_length_m: Option<Value>,
}

/// One step of the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// When.
    pub time_s: f64,
    /// Where the vehicle was.
    pub position: Horizontal,
    /// Where its nose pointed.
    pub yaw_rad: f64,
    /// How far below the origin it was; negative above.
    pub down_m: f64,
    /// How fast it was, horizontally.
    pub speed_mps: f64,
    /// What guidance said.
    pub outcome: Outcome,
}

/// A plan that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Replan {
    /// When.
    pub time_s: f64,
    /// The temporary target that it was made for.
    pub target: Option<Horizontal>,
    /// The plan and its samples.
    pub plan: Planned,
}

/// One step as it happens.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    /// The world as it is.
    pub world: &'a World,
    /// How the vehicle really moves.
    pub motion: &'a Motion,
    /// The step as the record has it.
    pub sample: &'a Sample,
    /// What guidance published.
    pub output: &'a guidance::Output,
    /// The computer that flies, to look into.
    pub computer: &'a dyn Computer,
    /// What the camera that looks down has just seen, now and then.
    pub picture: Option<&'a Picture>,
}

/// Everything that a picture of the flight needs.
#[derive(Clone, Debug)]
pub struct Record {
    /// What was flown.
    pub scenario: Scenario,
    /// What it came to.
    pub report: Report,
    /// Where it went.
    pub path: Vec<Sample>,
    /// The plans on the way.
    pub replans: Vec<Replan>,
    /// The obstacles that the computer remembers at the end.
    pub remembered: Vec<Circle>,
}

/// Why a flight could not be flown to its end.
#[derive(Debug)]
pub enum FlightError {
    /// The computer failed.
    Computer(ComputerError),
    /// The telemetry log could not be written.
    Log(io::Error),
}

impl fmt::Display for FlightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Computer(error) => error.fmt(f),
            Self::Log(error) => write!(f, "telemetry log: {error}"),
        }
    }
}

impl std::error::Error for FlightError {}

impl From<ComputerError> for FlightError {
    fn from(error: ComputerError) -> Self {
        Self::Computer(error)
    }
}

impl From<io::Error> for FlightError {
    fn from(error: io::Error) -> Self {
        Self::Log(error)
    }
}

/// Flies a mission with a computer; `watch` is told the time as it passes.
///
/// # Errors
/// The computer fails, or the log cannot be written.
pub fn fly(
    mission: &Mission,
    computer: &mut dyn Computer,
    log: Option<&mut tlog::Writer>,
    mut watch: impl FnMut(f64),
) -> Result<Record, FlightError> {
    fly_watched(mission, computer, log, |moment| watch(moment.sample.time_s))
}

/// The same; `watch` is shown every step.
///
/// # Errors
/// The computer fails, or the log cannot be written.
pub fn fly_watched(
    mission: &Mission,
    computer: &mut dyn Computer,
    mut log: Option<&mut tlog::Writer>,
    mut watch: impl FnMut(&Moment<'_>),
) -> Result<Record, FlightError> {
    let scenario = &mission.scenario;
    let world = scenario.world();
    let start = Horizontal::from_xy(scenario.start);
    let mut vehicle = Vehicle::new(scenario.vehicle, scenario.limits.a_max, pose_at_start(scenario, &world, start));
    let mut downward = Downward::new(scenario, &world, mission.seed);
    let mut autopilot = autopilot_at_start(scenario.vehicle.autopilot, computer.needs_entry());
    let entry_tick = if computer.needs_entry() { ENTRY_TICKS } else { 0 };
    let mut control_is_due = autopilot.custom_mode != autopilot.companion_mode();
    let mut air = scenario.wind.map(|wind| Air::new(wind, Random::new(mission.seed, 3)));
    let mut drift = scenario.position.map(|position| Drift::new(position, Random::new(mission.seed, 4)));
    let mut ears = Ears::new(mission);
    let mut hull = Hull::new(&world, scenario.drone_radius, start);
    let mut path: Vec<Sample> = Vec::new();
    let mut replans = Vec::new();
    let mut bearing_errors = (0.0, 0_u32);
    let mut trace_hash = 0;
    let mut path_length_m = 0.0;

    let ticks = libm::ceil(scenario.max_time_s / TICK_S) as u64;
    let mut ending = None;
    let mut tick = 0;
    let mut clock = Clock::at(computer, 0);
    while clock.time_s < scenario.max_time_s && tick < ticks && ending.is_none() {
        let Clock { now_us, time_s } = clock;

        // The pilot gives control as soon as the autopilot lets him, once.
        if control_is_due && tick >= entry_tick && tick % PILOT_TICKS == 0 {
            control_is_due = !autopilot.select_mode(now_us, autopilot.companion_mode());
        }

        // What the autopilot and the obstacle sensor say.
        let motion = vehicle.motion;
        let error = drift.as_mut().map_or(Horizontal::default(), |drift| drift.step(TICK_S));
        let believed = motion.displaced(error);
        autopilot.telemetry(now_us, &believed, inside(scenario.faults.stale_ownship, time_s));
        let looks = tick % SENSOR_TICKS == 0 && !inside(scenario.faults.stale_obstacles, time_s);
        let position = horizontal(&motion.pose);
        let view = View { world: &world, time_s, position, yaw_rad: motion.pose.yaw_rad, sensor: scenario.sensor };
        let circles =
            (looks && scenario.sensor.model == SensorModel::Circles).then(|| on_the_map(view.circles(), error));
        if looks && scenario.sensor.model == SensorModel::Scan {
            autopilot.forward(&view.scan(now_us));
        }
        if let Some(downward) = &mut downward {
            if tick % landing::RANGE_TICKS == 0
                && let Some(range) = downward.range(&motion.pose)
            {
                autopilot.find_range(&range);
            }
            if let Some(bytes) = downward.look(now_us, &motion) {
                computer.see(&bytes)?;
            }
        }
        let rx = autopilot.transmit();

        // What the computer makes of it.
        let now = Instant(match scenario.faults.clock_back_s {
            Some(at_s) if time_s >= at_s => now_us.saturating_sub(CLOCK_JUMP_US),
            _ => now_us,
        });
        let heard = ears.hear(&world, &motion.pose, now, time_s);
        let report = computer.step(now, heard.front_end(), circles.as_deref(), &rx)?;
        if let Some(log) = log.as_deref_mut() {
            log.bytes(now_us, tlog::Direction::ToCompanion, &rx)?;
            log.bytes(now_us, tlog::Direction::ToAutopilot, &report.tx)?;
        }
        trace_hash = report.output.trace_hash;
        if let Some(bearing_ned_rad) = report.output.bearing_ned_rad {
            let truth_rad = world.source_at(time_s).minus(position).bearing_rad();
            let error_rad = wrap_pi(f64::from(bearing_ned_rad) - truth_rad);
            bearing_errors = (bearing_errors.0 + error_rad * error_rad, bearing_errors.1 + 1);
        }
        if let Some(plan) = report.plan {
            let target = report.output.target_ned_m.map(from_core);
            replans.push(Replan { time_s, target, plan });
        }
        let outcome = report.output.outcome;
        let [north_mps, east_mps, _] = motion.velocity_ned_mps;
        let speed_mps = libm::hypot(north_mps, east_mps);
        let [_, _, down_m] = motion.pose.position_ned_m;
        let sample = Sample { time_s, position, yaw_rad: motion.pose.yaw_rad, down_m, speed_mps, outcome };
        path.push(sample);
        let (output, computer) = (&report.output, &*computer);
        let picture = downward.as_ref().and_then(|downward| downward.fresh(time_s));
        watch(&Moment { world: &world, motion: &motion, sample: &sample, output, computer, picture });

        // What the vehicle does until the next step.
        clock = Clock::at(computer, tick + 1);
        let step_s = if computer.next_step_s().is_some() { clock.time_s - time_s } else { TICK_S };
        autopilot.receive(now_us, &believed, &report.tx);
        if let Some(air) = &mut air {
            vehicle.push = air.step(step_s);
        }
        for part in 1..=CHECKS_PER_TICK {
            vehicle.step(autopilot.command(now_us), step_s / CHECKS_PER_TICK as f64);
            if let Some(downward) = &mut downward {
                downward.touch(vehicle.touch_ground());
            }
            let at_s = time_s + step_s * part as f64 / CHECKS_PER_TICK as f64;
            if hull.collides(&world, horizontal(&vehicle.motion.pose), at_s) {
                ending = Some(Ending::Collision);
                break;
            }
        }
        let position_now = horizontal(&vehicle.motion.pose);
        path_length_m += position_now.minus(position).norm();
        tick += 1;
        let end_s = if computer.next_step_s().is_some() { clock.time_s } else { tick as f64 * TICK_S };
        let to_goal_m = world.source_at(end_s).minus(position_now).norm();
        let is_over = match &mut downward {
            Some(downward) => downward.follow(time_s, &report.output),
            None => to_goal_m <= scenario.goal_tolerance,
        };
        if ending.is_none() && is_over {
            let landed = downward.as_ref().map(|downward| downward.ended(&world, time_s, &vehicle.motion.pose));
            let is_reached = landed.is_none_or(|landed| landed.is_there(scenario, to_goal_m));
            ending = Some(if is_reached { Ending::Reached } else { Ending::Hold });
        }
        if ending.is_none() && outcome == Outcome::GoalUnreachable && is_still(&path) {
            ending = Some(Ending::Hold);
        }
    }

    let time_s = if computer.next_step_s().is_some() { clock.time_s } else { tick as f64 * TICK_US as f64 / 1e6 };
    let last_outcome = path.last().map_or(Outcome::Nominal, |sample| sample.outcome);
    let (result, reason) = match ending {
        // What the last step was about explains nothing where the mission is done.
        Some(Ending::Reached) => (Ending::Reached, Outcome::Nominal),
        Some(ending) => (ending, last_outcome),
        None => match why_still(&path) {
            Some(outcome) => (Ending::Hold, outcome),
            None => (Ending::Timeout, last_outcome),
        },
    };
    let report = Report {
        name: scenario.name.clone(),
        seed: mission.seed,
        result,
        reason: reason.name(),
        time_s,
        path_length_m,
        straight_line_m: world.source_at(time_s).minus(start).norm(),
        min_clearance_m: Some(hull.min_clearance_m).filter(|clearance| clearance.is_finite()),
        collisions: u32::from(result == Ending::Collision),
        replans: replans.len() as u32,
        bearing_rms_deg: (bearing_errors.1 > 0)
            .then(|| libm::sqrt(bearing_errors.0 / f64::from(bearing_errors.1)).to_degrees()),
        trace_hash: format!("{trace_hash:016x}"),
        landing: downward.as_ref().map(|downward| downward.ended(&world, time_s, &vehicle.motion.pose)),
        expect: scenario.expect.clone(),
        reference_length_m: scenario.reference_length_m.clone(),
    };
    Ok(Record { scenario: scenario.clone(), report, path, replans, remembered: computer.remembered() })
}

/// When a step is.
#[derive(Clone, Copy)]
struct Clock {
    now_us: u64,
    time_s: f64,
}

impl Clock {
    fn at(computer: &dyn Computer, tick: u64) -> Self {
        match computer.next_step_s() {
            Some(time_s) => Self { now_us: (time_s * 1e6) as u64, time_s },
            None => Self { now_us: tick * TICK_US, time_s: (tick * TICK_US) as f64 * 1e-6 },
        }
    }
}

/// PX4 cannot begin in OFFBOARD: it needs the companion's stream first. A computer may need the mode to be entered.
fn autopilot_at_start(software: Software, needs_entry: bool) -> Autopilot {
    let start = match software {
        Software::ArduCopter if !needs_entry => Start::InControl,
        _ => Start::Hovering,
    };
    Autopilot::new(software, start)
}

fn pose_at_start(scenario: &Scenario, world: &World, start: Horizontal) -> Pose {
    Pose {
        position_ned_m: [start.north, start.east, scenario.flight_down_m()],
        yaw_rad: world.source.minus(start).bearing_rad(),
        ..Pose::default()
    }
}

/// Circles where they are for who believes to be elsewhere.
fn on_the_map(mut circles: Vec<Circle>, error: Horizontal) -> Vec<Circle> {
    let error = error.to_core();
    for circle in &mut circles {
        circle.center_ned_m.north += error.north;
        circle.center_ned_m.east += error.east;
    }
    circles
}

/// Whether the vehicle has stood still for the last while.
fn is_still(path: &[Sample]) -> bool {
    let Some(recent) = path.len().checked_sub(STILL_TICKS).map(|from| &path[from..]) else { return false };
    recent.iter().all(|sample| sample.position.minus(recent[0].position).norm() < STILL_M)
}

/// The latest outcome that explains why the vehicle stands still.
fn why_still(path: &[Sample]) -> Option<Outcome> {
    let recent = is_still(path).then(|| &path[path.len() - STILL_TICKS..])?;
    recent.iter().rev().map(|sample| sample.outcome).find(|outcome| *outcome != Outcome::Nominal)
}

/// What the direction finding receives.
struct Ears<'a> {
    mission: &'a Mission,
    antennas: Antennas,
    random: Random,
}

/// What it received in one step.
enum Heard {
    Snapshot(Box<foxhound_core::base::adc::Snapshot<BLOCK>>),
    Bearing(bearing::Bearing),
    Nothing,
}

impl Heard {
    fn front_end(&self) -> FrontEnd<'_, BLOCK> {
        match self {
            Self::Snapshot(snapshot) => FrontEnd::Snapshot(snapshot),
            Self::Bearing(bearing) => FrontEnd::Bearing(*bearing),
            Self::Nothing => FrontEnd::Nothing,
        }
    }
}

impl<'a> Ears<'a> {
    fn new(mission: &'a Mission) -> Self {
        let snr_db = mission.scenario.bearing.snr_db.unwrap_or(DEFAULT_SNR_DB);
        let pattern = mission.scenario.antenna.map(|antenna| Pattern {
            exponent: antenna.exponent,
            front_to_back_db: antenna.front_to_back_db,
            boresights_rad: antenna.boresight_deg.map(f64::to_radians),
        });
        let mut antennas = Antennas { snr_db: Some(snr_db), pattern, ..Antennas::default() };
        antennas.impairments.pulses = mission.scenario.bearing.pulses.map(Pulses::at_antennas);
        Self { mission, antennas, random: Random::new(mission.seed, 1) }
    }

    fn hear(&mut self, world: &World, vehicle: &Pose, now: Instant, time_s: f64) -> Heard {
        let scenario = &self.mission.scenario;
        let settings = &scenario.bearing;
        let from = horizontal(vehicle);
        let to_source = world.source_at(time_s).minus(from);
        let is_outlier = settings.outlier.rate > 0.0 && self.random.uniform() < settings.outlier.rate;
        let offset_rad = if is_outlier { settings.outlier.offset_deg.to_radians() } else { 0.0 };
        let bearing_ned_rad = to_source.bearing_rad() + offset_rad;
        if inside(scenario.faults.nan_bearing, time_s) {
            return Heard::Bearing(bearing_of(now, f64::NAN, SIGMA_FLOOR_RAD));
        }
        let is_between = settings.pulses.is_some_and(|pulses| !pulses.at_antennas().sounds(time_s));
        let is_silent =
            inside(settings.dropout, time_s) || is_between && scenario.bearing_model() == BearingModel::Noise;
        let other = |beacon: &OtherBeacon| Interferer {
            tone_hz: self.antennas.tone_hz + beacon.offset_hz,
            azimuth_ned_rad: Horizontal::from_xy([beacon.x, beacon.y]).minus(from).bearing_rad(),
            elevation_rad: 0.0,
            level_db: beacon.level_db,
        };
        self.antennas.impairments.interferers = scenario.other_beacons.iter().map(other).collect();
        let is_single = scenario.antenna.is_some_and(|antenna| antenna.single);
        self.antennas.impairments.faults = std::array::from_fn(|channel| {
            let is_dead = inside(scenario.faults.dead_channels[channel], time_s) || is_single && channel > 0;
            if is_dead { Fault::Dead } else { Fault::None }
        });
        match scenario.bearing_model() {
            _ if !world.walls.is_empty() => self.hear_among_walls(world, vehicle, now, time_s, is_silent),
            BearingModel::Noise if is_silent => Heard::Nothing,
            BearingModel::Noise => {
                let sigma_rad = settings.sigma_deg.to_radians();
                let azimuth_rad = bearing_ned_rad - vehicle.yaw_rad + sigma_rad * self.random.gaussian();
                Heard::Bearing(bearing_of(now, wrap_pi(azimuth_rad), sigma_rad.max(SIGMA_FLOOR_RAD)))
            }
            BearingModel::Rf => {
                let apparent = from.along(Horizontal::from_bearing(bearing_ned_rad), to_source.norm());
                let source = [apparent.north, apparent.east, world.source_down_m];
                self.antennas.channel_gain = [if is_silent { 0.0 } else { 1.0 }; 4];
                Heard::Snapshot(Box::new(self.antennas.frame(now, vehicle, source, &mut self.random)))
            }
        }
    }
}

impl Ears<'_> {
    /// By all the ways that a wave finds among walls. The receiver's gain follows the strongest one; the scenario's
    /// signal-to-noise ratio holds at [`REFERENCE_M`].
    fn hear_among_walls(&mut self, world: &World, vehicle: &Pose, now: Instant, time_s: f64, is_silent: bool) -> Heard {
        let settings = &self.mission.scenario.bearing;
        let from = horizontal(vehicle);
        let source = world.source_at(time_s);
        let paths = rays::paths(&world.walls, source, from, REFLECTIONS_MAX, LOSS_MAX_DB);
        let Some(strongest) = paths.first() else { return Heard::Nothing };
        let snr_db = settings.snr_db.unwrap_or(DEFAULT_SNR_DB) + strongest.gain_db() + 20.0 * libm::log10(REFERENCE_M);
        match self.mission.scenario.bearing_model() {
            BearingModel::Noise if is_silent || snr_db < SNR_MIN_DB => Heard::Nothing,
            BearingModel::Noise => {
                let sigma_rad = settings.sigma_deg.to_radians();
                let heard_rad = strongest.bearing_rad(from) + sigma_rad * self.random.gaussian();
                let mut bearing = bearing_of(now, wrap_pi(heard_rad - vehicle.yaw_rad), sigma_rad.max(SIGMA_FLOOR_RAD));
                bearing.quality.snr_db = snr_db as f32;
                Heard::Bearing(bearing)
            }
            BearingModel::Rf => {
                let place = |at: Horizontal| [at.north, at.east, world.source_down_m];
                let level_db = |path: &rays::Path| path.gain_db() - strongest.gain_db();
                let direct = paths.iter().find(|path| path.order == 0);
                let images = paths.iter().filter(|path| path.order > 0);
                let antennas = &mut self.antennas;
                antennas.snr_db = Some(snr_db.min(SNR_MAX_DB));
                antennas.impairments.direct_level_db = direct.map_or(-2.0 * LOSS_MAX_DB, level_db);
                antennas.impairments.reflections = images
                    .map(|path| Reflection { image_ned_m: place(path.image), level_db: level_db(path) })
                    .collect();
                antennas.channel_gain = [if is_silent { 0.0 } else { 1.0 }; 4];
                Heard::Snapshot(Box::new(antennas.frame(now, vehicle, place(source), &mut self.random)))
            }
        }
    }
}

/// Reflections that are followed.
const REFLECTIONS_MAX: usize = 3;
/// Paths that lose more than this are not heard.
const LOSS_MAX_DB: f64 = 60.0;
/// The distance at which a scenario with walls has its signal-to-noise ratio.
const REFERENCE_M: f64 = 10.0;
/// The best that the receiver gets, however near.
const SNR_MAX_DB: f64 = 40.0;
/// Below this the noise model hears nothing.
const SNR_MIN_DB: f64 = -5.0;

/// Signal-to-noise ratio of waveforms when the scenario names none.
const DEFAULT_SNR_DB: f64 = 20.0;

fn bearing_of(time: Instant, azimuth_rad: f64, sigma_rad: f64) -> bearing::Bearing {
    bearing::Bearing {
        time,
        valid: true,
        azimuth_rad: azimuth_rad as f32,
        sigma_rad: sigma_rad as f32,
        elevation_rad: 0.0,
        elevation_sigma_rad: std::f32::consts::FRAC_PI_2,
        quality: bearing::Quality { snr_db: DEFAULT_SNR_DB as f32, wavenumber: 1.0, ..bearing::Quality::default() },
        flags: Flags::default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::computer::HostComputer;
    use crate::scenario::FLIGHT_DOWN_M;

    fn mission(scenario: Scenario, seed: u64) -> Mission {
        Mission { scenario, seed, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum }
    }

    fn flown(mission: &Mission) -> Record {
        let mut computer = HostComputer::new(&mission.guidance()).unwrap();
        fly(mission, &mut computer, None, |_| ()).unwrap()
    }

    fn parsed(text: &str) -> Scenario {
        Scenario::parse(text).unwrap()
    }

    #[test]
    fn the_built_in_mission_reaches_the_beacon_by_its_waves_alone() {
        for seed in 1..=5 {
            let Record { report, path, .. } = flown(&mission(Scenario::built_in(), seed));
            assert_eq!((report.result, report.collisions), (Ending::Reached, 0), "seed {seed}: {report:?}");
            assert!(
                path.iter().all(|sample| (sample.down_m - FLIGHT_DOWN_M).abs() < 0.05),
                "seed {seed}: altitude lost"
            );
            // The straight line less the tolerance is the least that anyone can fly.
            assert!(report.path_length_m > report.straight_line_m - 0.51);
            assert!(report.path_length_m < 1.5 * report.straight_line_m);
            assert!(report.min_clearance_m.unwrap() > 0.0);
            assert!(report.bearing_rms_deg.unwrap() < 0.25);
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_flight_and_another_seed_another() {
        let hash = |seed| flown(&mission(Scenario::built_in(), seed)).report;
        assert_eq!(hash(3), hash(3));
        assert_ne!(hash(3).trace_hash, hash(4).trace_hash);
    }

    #[test]
    fn the_printed_object_has_the_promised_keys_and_no_others() {
        let report = flown(&mission(parsed(r#"{"goal":[3,1],"reference_length_m":2,"max_time_s":20}"#), 1)).report;
        let json = serde_json::to_value(&report).unwrap();
        let mut keys: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
        keys.sort_unstable();
        let promised = [
            "bearing_rms_deg",
            "collisions",
            "min_clearance_m",
            "name",
            "path_length_m",
            "reason",
            "reference_length_m",
            "replans",
            "result",
            "seed",
            "straight_line_m",
            "time_s",
            "trace_hash",
        ];
        assert_eq!(keys, promised);
        assert_eq!(json["result"], "reached");
        assert_eq!(json["trace_hash"].as_str().unwrap().len(), 16);
        assert!(json["min_clearance_m"].is_null(), "there is nothing to be clear of");
        assert_eq!(json["reference_length_m"], 2);
    }

    #[test]
    fn in_the_open_the_path_is_the_straight_line_to_the_tolerance_and_what_a_bend_to_learn_the_range_adds() {
        let mut mission = mission(parsed(r#"{"start":[0,0],"goal":[6,0],"bounds":[-1,-1,7,1]}"#), 1);
        let bent = flown(&mission).report;
        assert!(bent.path_length_m > 5.4 && bent.path_length_m < 1.1 * 5.5, "{}", bent.path_length_m);
        mission.planner.bends = false;
        let report = flown(&mission).report;
        assert_eq!(report.result, Ending::Reached);
        assert!((report.path_length_m - 5.5).abs() < 0.1, "{}", report.path_length_m);
        // Six metres at 1 m/s, and the start.
        assert!(report.time_s > 5.5 && report.time_s < 9.0, "{}", report.time_s);
    }

    #[test]
    fn the_noise_of_the_bearings_is_the_one_that_was_asked_for() {
        let report = flown(&mission(parsed(r#"{"bearing":{"sigma_deg":5}}"#), 2)).report;
        // 500 bearings: the rms is known to 3 %.
        assert!((report.bearing_rms_deg.unwrap() - 5.0).abs() < 0.6, "{:?}", report.bearing_rms_deg);
    }

    #[test]
    fn a_vehicle_without_a_signal_holds_and_says_why() {
        let record = flown(&mission(parsed(r#"{"bearing":{"snr_db":20,"dropout":[0,99]},"max_time_s":8}"#), 1));
        assert_eq!((record.report.result, record.report.reason), (Ending::Hold, "no_signal"));
        assert!(record.report.path_length_m < 0.05, "noise alone moves nothing");
        assert_eq!(record.report.bearing_rms_deg, None);
    }

    #[test]
    fn a_vehicle_without_a_signal_searches_where_it_may_and_ends_in_a_hold_or_at_the_beacon() {
        let text = r#"{"bearing":{"snr_db":20,"dropout":[0,99]},"max_time_s":40,"explore_s":20,
            "obstacles":[{"x":3,"y":3,"r":0.4},{"x":1,"y":3,"r":0.3}]}"#;
        let record = flown(&mission(parsed(text), 1));
        assert_eq!((record.report.result, record.report.reason), (Ending::Hold, "no_signal"));
        assert!(record.report.path_length_m > 5.0 && record.report.min_clearance_m.unwrap() > 0.0);
        let after = record.path.iter().filter(|sample| sample.time_s > 24.0);
        assert!(after.clone().all(|sample| sample.speed_mps < 0.1), "the search has an end");
        let text = text.replace("[0,99]", "[0,12]");
        let record = flown(&mission(parsed(&text), 1));
        assert_eq!((record.report.result, record.report.collisions), (Ending::Reached, 0), "{:?}", record.report);
    }

    #[test]
    fn px4_is_flown_once_its_pilot_could_enter_offboard() {
        let mut scenario = Scenario::built_in();
        scenario.vehicle.autopilot = Software::Px4;
        let record = flown(&mission(scenario, 1));
        assert_eq!((record.report.result, record.report.collisions), (Ending::Reached, 0), "{:?}", record.report);
        let before = &record.path[..PILOT_TICKS as usize];
        assert!(before.iter().all(|sample| sample.outcome == Outcome::NotInControl && sample.speed_mps < 0.01));
    }

    #[test]
    fn a_vehicle_without_telemetry_or_obstacle_data_holds_and_goes_on_afterwards() {
        for (fault, name) in [("stale_ownship", "stale_ownship"), ("stale_obstacles", "stale_obstacles")] {
            let text = format!(r#"{{"faults":{{"{fault}":[3,6]}},"limits":{{"v_max":1}}}}"#);
            let record = flown(&mission(parsed(&text), 1));
            assert_eq!(record.report.result, Ending::Reached, "{fault}");
            let during = record.path.iter().find(|sample| sample.time_s > 5.0).unwrap();
            assert_eq!(during.outcome.name(), name);
            assert!(during.speed_mps < 0.1, "{fault}: {} m/s", during.speed_mps);
        }
    }

    #[test]
    fn bearings_that_are_not_numbers_move_nothing() {
        let record = flown(&mission(parsed(r#"{"faults":{"nan_bearing":[0,99]},"max_time_s":8}"#), 1));
        assert_eq!(record.report.result, Ending::Hold);
        assert!(record.report.path_length_m < 0.05);
        assert!(serde_json::to_value(&record.report).unwrap()["bearing_rms_deg"].is_null());
    }

    #[test]
    fn a_clock_that_jumps_back_does_not_end_the_mission() {
        let report = flown(&mission(parsed(r#"{"faults":{"clock_back_s":4}}"#), 1)).report;
        assert_eq!(report.result, Ending::Reached, "{report:?}");
    }

    #[test]
    fn a_beacon_behind_a_closed_ring_is_never_reached_and_nothing_is_hit() {
        let ring: Vec<String> = (0..16)
            .map(|k| {
                let angle = std::f64::consts::TAU * f64::from(k) / 16.0;
                format!(r#"{{"x":{},"y":{},"r":0.35}}"#, 7.0 + 1.5 * angle.cos(), 7.0 + 1.5 * angle.sin())
            })
            .collect();
        let text = format!(r#"{{"goal":[7,7],"max_time_s":60,"obstacles":[{}]}}"#, ring.join(","));
        let report = flown(&mission(parsed(&text), 1)).report;
        assert_ne!(report.result, Ending::Reached);
        assert_eq!(report.collisions, 0, "{report:?}");
    }

    #[test]
    fn the_bytes_of_a_logged_flight_are_clean_mavlink() {
        let path = std::env::temp_dir().join(format!("foxhound-flight-test-{}.tlog", std::process::id()));
        let mission = mission(Scenario::built_in(), 1);
        let mut computer = HostComputer::new(&mission.guidance()).unwrap();
        let mut log = tlog::Writer::create(&path).unwrap();
        let record = fly(&mission, &mut computer, Some(&mut log), |_| ()).unwrap();
        log.finish().unwrap();
        let summary = tlog::read_stamped(&std::fs::read(&path).unwrap());
        std::fs::remove_file(&path).unwrap();
        assert_eq!((summary.bad_crc, summary.skipped_bytes), (0, 0));
        let rate_hz = |id: u32| summary.counts.get(&id).copied().unwrap_or(0) as f64 / record.report.time_s;
        assert!((rate_hz(84) - 20.0).abs() < 2.0, "setpoints at {} Hz", rate_hz(84));
        assert!((rate_hz(330) - 10.0).abs() < 1.0, "scans at {} Hz", rate_hz(330));
        // Two ends, one beat a second each.
        assert!((rate_hz(0) - 2.0).abs() < 0.3, "heartbeats at {} Hz", rate_hz(0));
    }
}
