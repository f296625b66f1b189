//! One closed-loop flight at a fixed step of 20 ms: world, sensor, autopilot, computer, autopilot, vehicle, and
//! again. A computer that keeps its own time ([`Computer::next_step_s`]) decides when the steps are.
//!
//! The result is decided by the truth: *reached* within the goal tolerance (horizontally), *collision* when the hull
//! touches a pillar, *hold* when the vehicle stands still with a reason, *timeout* otherwise. Simulated time is the
//! only time.
//!
//! If the scenario has a landing the flight goes on until the vehicle has landed, or hovers and hands over: *reached*
//! then means on the ground within the pad, or in the air within the goal tolerance of the beacon.

use std::sync::atomic::{AtomicBool, Ordering};

use foxhound_core::base::time::Instant;
use foxhound_core::control::vehicle_model;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::doa::radio;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::guidance::{self, turning};
use foxhound_core::landing as core_landing;
use foxhound_core::mapping::lidar::Mount;
use foxhound_core::planning::{explore, planner};

use super::computer::{Computer, ComputerError, HostComputer};
use crate::autopilot::{Autopilot, Start, tlog};
use crate::scenario::input::InputError;
use crate::scenario::params::Given;
use crate::scenario::{BearingModel, Scenario, SensorModel, Software, VehicleModel, inside};
use crate::world::antennas::Antennas;
use crate::world::{Horizontal, Pose, World, from_core, horizontal, wrap_pi};

#[cfg(test)]
mod disturbed;
mod receiver;
mod record;

pub use super::landing::{Landing, Picture};
pub use super::rig::TICK_S;
use super::rig::{Answer, Rig, When};
use receiver::Receiver;
pub use record::{Ending, Moment, Record, Replan, Report, Sample};

const TICK_US: u64 = 20_000;
/// Parts of a step after which the hull is checked.
const CHECKS_PER_TICK: u32 = 4;
/// Steps between the pilot's attempts to give control.
const PILOT_TICKS: u64 = 25;
/// Steps in another mode, for a computer that needs the mode to be entered after its start.
const ENTRY_TICKS: u64 = 100;
/// A vehicle that moved less than this within the last while stands still.
const STILL_M: f64 = 0.1;
const STILL_TICKS: usize = 150;
/// How far the clock jumps back as a fault.
const CLOCK_JUMP_US: u64 = 1_000_000;
/// Steps of the dead time and lag of the point mass: a setpoint waits for its 20 Hz slot, telemetry for the next step.
const POINT_DEAD_TIME_S: f32 = 0.06;
/// The point mass yaws as fast as it is asked to.
const POINT_YAW_RATE_MAX_RADPS: f32 = 2.5;
/// Sigma of a bearing that is known exactly, so that no weight is infinite.
const SIGMA_FLOOR_RAD: f64 = 1e-3;

/// Largest age of a bearing of a slow radio, in its periods.
const RATE_PATIENCE: f32 = 3.5;

/// A flight to be flown.
#[derive(Clone, Debug, PartialEq)]
pub struct Mission {
    /// The world and the vehicle.
    pub scenario: Scenario,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The planner.
    pub planner: planner::Config,
    /// The estimator.
    pub estimator: Estimator,
}

impl Mission {
    /// The configuration of the computer for this mission.
    #[must_use]
    pub fn guidance(&self) -> guidance::Config {
        let scenario = &self.scenario;
        let mut config = guidance::Config { seed: self.seed, planner: self.planner, ..guidance::Config::default() };
        config.vehicle.radius_m = scenario.drone_radius as f32;
        config.bearing.estimator = self.estimator;
        config.guard.v_max_mps = scenario.limits.v_max as f32;
        config.guard.evade_max_mps = scenario.limits.v_evade as f32;
        config.guard.a_max_mps2 = scenario.limits.a_max as f32;
        if scenario.bearing.tone_known {
            config.phase.tone_hz = Some(Antennas::default().tone_hz as f32);
        }
        if let Some(rate_hz) = scenario.bearing.rate_hz {
            // As a pilot with such a radio sets FH_BRG_AGE: two bearings in a row may be missing.
            config.mission.bearing_age_max_s = config.mission.bearing_age_max_s.max(RATE_PATIENCE / rate_hz as f32);
        }
        let moves = scenario.goal_velocity.iter().any(|speed| *speed != 0.0);
        if !scenario.bearing.only && !moves {
            let [east, north] = scenario.goal.map(|metres| metres as f32);
            config.known_source_ned_m = Some(foxhound_core::base::ned::Horizontal { north, east });
        }
        config.sensor.range_m = scenario.sensor.range_m as f32;
        config.sensor.fov_rad = scenario.sensor.fov_deg.to_radians() as f32;
        config.sensor.turn_s = scenario.sensor.turn_s as f32;
        if scenario.sensor.model == SensorModel::Scan {
            config.sensor.lag_s = scenario.sensor.lag_s as f32;
        }
        // The other planners are flown unchanged.
        if scenario.explore_s > 0.0 && self.planner.kind == planner::Kind::Foxhound {
            config.planner.explore = Some(explore::Config {
                limit_s: scenario.explore_s as f32,
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
            turning.rotating.pattern.exponent = antenna.exponent as f32;
            turning.rotating.pattern.front_to_back_db = antenna.front_to_back_db as f32;
            turning
        });
        config.landing = scenario.landing.map(|landing| core_landing::Config {
            has_camera: landing.camera.is_some(),
            focal_widths: landing.camera.unwrap_or_default().focal_widths() as f32,
            pad_radius_m: landing.pad_radius as f32,
            request_land: landing.request_land,
            ..core_landing::Config::default()
        });
        config.lidar = (scenario.sensor.model == SensorModel::Lidar).then(Mount::default);
        let sends = match scenario.bearing_model() {
            BearingModel::Uudf => Some(radio::Sends::Angles),
            BearingModel::Hci => Some(radio::Sends::IqReports),
            BearingModel::Noise | BearingModel::Rf => None,
        };
        config.radio = sends.map(|sends| radio::Mount {
            sends,
            yaw_rad: scenario.bearing.mount_deg.to_radians() as f32,
            sigma_rad: (scenario.bearing.sigma_deg.to_radians() as f32).max(radio::SIGMA_MIN_RAD),
            tag: scenario.bearing.tag,
        });
        config.vehicle_model = match scenario.vehicle.model {
            VehicleModel::Point => {
                config.guard.yaw_rate_max_radps = POINT_YAW_RATE_MAX_RADPS;
                vehicle_model::Config { dead_time_s: POINT_DEAD_TIME_S, lag_s: scenario.vehicle.lag_s as f32 }
            }
            VehicleModel::Arducopter => match scenario.vehicle.autopilot {
                Software::ArduCopter => vehicle_model::Config::ARDUCOPTER,
                Software::Px4 => vehicle_model::Config::PX4,
            },
        };
        config
    }
}

impl Mission {
    /// The configuration with given parameters, and a computer with it; the simulated vehicle becomes the one that they describe.
    ///
    /// # Errors
    /// The field or parameter that is refused.
    pub fn with_parameters(&mut self, given: &Given) -> Result<(guidance::Config, HostComputer), InputError> {
        given.check_link()?;
        given.describe(&mut self.scenario);
        let mut config = self.guidance();
        given.apply(&mut config);
        let all = given.beside(&config);
        let host = HostComputer::with_values(&config, *all.values()).map_err(|error| all.named(error))?;
        if !given.is_empty() {
            self.scenario = self.scenario.clone().checked()?;
        }
        Ok((config, host))
    }
}

/// Flies a mission with a computer; `watch` gets every step.
///
/// # Errors
/// The computer fails. Errors of the log are returned by its [`finish`](tlog::Writer::finish).
pub fn fly(
    mission: &Mission,
    computer: &mut dyn Computer,
    log: Option<&mut tlog::Writer>,
    watch: impl FnMut(&Moment<'_>),
) -> Result<Record, ComputerError> {
    fly_until(mission, computer, log, &AtomicBool::new(false), watch)
}

/// The same, until `stop` is set: then the flight ends as [`Ending::Interrupted`].
///
/// # Errors
/// The computer fails. Errors of the log are returned by its [`finish`](tlog::Writer::finish).
pub fn fly_until(
    mission: &Mission,
    computer: &mut dyn Computer,
    log: Option<&mut tlog::Writer>,
    stop: &AtomicBool,
    watch: impl FnMut(&Moment<'_>),
) -> Result<Record, ComputerError> {
    match fly_as_far(mission, computer, log, stop, watch) {
        (record, None) => Ok(record),
        (_, Some(error)) => Err(error),
    }
}

/// The same, with the flight as far as it came where the computer fails, and its error: the flight then ends as [`Ending::Hold`] with
/// [`Outcome::Fault`].
pub fn fly_as_far(
    mission: &Mission,
    computer: &mut dyn Computer,
    mut log: Option<&mut tlog::Writer>,
    stop: &AtomicBool,
    mut watch: impl FnMut(&Moment<'_>),
) -> (Record, Option<ComputerError>) {
    let scenario = &mission.scenario;
    let world = scenario.peopled(mission.seed);
    let start = Horizontal::from_xy(scenario.start);
    let pose = pose_at_start(scenario, &world, start);
    let autopilot = autopilot_at_start(scenario.vehicle.autopilot, computer.needs_entry());
    let entry_tick = if computer.needs_entry() { ENTRY_TICKS } else { 0 };
    let mut control_is_due = autopilot.custom_mode != autopilot.companion_mode();
    let mut rig = Rig::new(scenario, world, autopilot, pose, CHECKS_PER_TICK).disturbed(mission.seed);
    let mut receiver = Receiver::new(mission);
    let mut path: Vec<Sample> = Vec::new();
    let mut replans = Vec::new();
    let mut bearing_errors = (0.0, 0_u32);
    let mut trace_hash = 0;
    let mut path_length_m = 0.0;

    let ticks = libm::ceil(scenario.max_time_s / TICK_S) as u64;
    let mut ending = None;
    let mut failed = None;
    let mut tick = 0;
    let mut clock = Clock::at(computer, 0);
    while clock.time_s < scenario.max_time_s && tick < ticks && ending.is_none() {
        let Clock { now_us, time_s } = clock;

        // The pilot gives control as soon as the autopilot allows it, once.
        if control_is_due && tick >= entry_tick && tick % PILOT_TICKS == 0 {
            control_is_due = !rig.autopilot.select_mode(now_us, rig.autopilot.companion_mode());
        }

        let position = horizontal(&rig.vehicle.motion.pose);
        let when = When {
            tick,
            now_us,
            time_s,
            ownship_is_silent: inside(scenario.faults.stale_ownship, time_s),
            obstacles_are_silent: inside(scenario.faults.stale_obstacles, time_s),
        };
        let stepped = rig.step(&when, |rig, sensed| {
            if let Some(bytes) = &sensed.lidar {
                computer.turn(bytes)?;
            }
            if let Some(bytes) = &sensed.camera {
                computer.see(bytes)?;
            }
            let now = Instant(match scenario.faults.clock_back_s {
                Some(at_s) if time_s >= at_s => now_us.saturating_sub(CLOCK_JUMP_US),
                _ => now_us,
            });
            let motion = &sensed.motion;
            let heard = receiver.receive(&rig.world, &motion.pose, now, time_s);
            if let Some(line) = heard.line() {
                computer.turn(line)?;
            }
            let report = computer.step(now, heard.front_end(), sensed.circles.as_deref(), &sensed.rx)?;
            if let Some(log) = log.as_deref_mut() {
                // `finish` reports what went wrong; the flight continues without the log.
                let _ = log.bytes(now_us, tlog::Direction::ToCompanion, &sensed.rx);
                let _ = log.bytes(now_us, tlog::Direction::ToAutopilot, &report.tx);
            }
            if let Some(bearing_ned_rad) = report.output.bearing_ned_rad {
                let truth_rad = rig.world.source_at(time_s).minus(position).bearing_rad();
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
            let picture = rig.downward.as_ref().and_then(|downward| downward.fresh(time_s));
            let (output, computer) = (&report.output, &*computer);
            let frame = heard.frame();
            let (world, sample) = (&rig.world, &sample);
            watch(&Moment { world, motion, sample, output, computer, frame, picture, knows_source: true });
            clock = Clock::at(computer, tick + 1);
            let step_s = if computer.next_step_s().is_some() { clock.time_s - time_s } else { TICK_S };
            Ok::<_, ComputerError>((Answer { tx: report.tx, step_s }, report.output))
        });
        let output = match stepped {
            Ok(output) => output,
            // A stop from the terminal may have stopped the computer's process, too: that is no error.
            Err(_) if stop.load(Ordering::Relaxed) => {
                ending = Some(Ending::Interrupted);
                break;
            }
            Err(error) => {
                failed = Some(error);
                break;
            }
        };
        trace_hash = output.trace_hash;
        let position_now = horizontal(&rig.vehicle.motion.pose);
        path_length_m += position_now.minus(position).norm();
        tick += 1;
        let end_s = if computer.next_step_s().is_some() { clock.time_s } else { tick as f64 * TICK_S };
        let to_goal_m = rig.world.source_at(end_s).minus(position_now).norm();
        let is_over = match &mut rig.downward {
            Some(downward) => downward.follow(time_s, &output),
            None => to_goal_m <= scenario.goal_tolerance,
        };
        if rig.collided {
            ending = Some(Ending::Collision);
        } else if is_over {
            let landed = rig.landing(time_s);
            let is_reached = landed.is_none_or(|landed| landed.is_there(scenario, to_goal_m));
            ending = Some(if is_reached { Ending::Reached } else { Ending::Hold });
        } else if output.outcome == Outcome::GoalUnreachable && is_still(&path) {
            ending = Some(Ending::Hold);
        } else if stop.load(Ordering::Relaxed) {
            ending = Some(Ending::Interrupted);
        }
    }

    let time_s = if computer.next_step_s().is_some() { clock.time_s } else { tick as f64 * TICK_US as f64 / 1e6 };
    let last_outcome = path.last().map_or(Outcome::Nominal, |sample| sample.outcome);
    let (result, reason) = match ending {
        _ if failed.is_some() => (Ending::Hold, Outcome::Fault),
        // The last step's outcome explains nothing when the mission is done.
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
        straight_line_m: Some(rig.world.source_at(time_s).minus(start).norm()),
        to_beacon_m: Some(rig.world.source_at(time_s).minus(horizontal(&rig.vehicle.motion.pose)).norm()),
        min_clearance_m: Some(rig.hull.min_clearance_m).filter(|clearance| clearance.is_finite()),
        collisions: Some(u32::from(result == Ending::Collision)),
        obstacles: None,
        replans: replans.len() as u32,
        bearing_rms_deg: (bearing_errors.1 > 0)
            .then(|| libm::sqrt(bearing_errors.0 / f64::from(bearing_errors.1)).to_degrees()),
        trace_hash: format!("{trace_hash:016x}"),
        landing: rig.landing(time_s),
        expect: scenario.expect.clone(),
        reference_length_m: scenario.reference_length_m.clone(),
    };
    let remembered = computer.inside().map_or_else(Vec::new, |one| one.state().map().circles().collect());
    (Record { scenario: scenario.clone(), report, path, replans, remembered, world: rig.world }, failed)
}

/// Time of a step.
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
    let mut autopilot = Autopilot::new(software, start);
    // The pilot has all switches on (FH_RC_CH).
    autopilot.faults.rc_us = [1900; 18];
    autopilot
}

fn pose_at_start(scenario: &Scenario, world: &World, start: Horizontal) -> Pose {
    Pose {
        position_ned_m: [start.north, start.east, scenario.flight_down_m()],
        yaw_rad: world.source.minus(start).bearing_rad(),
        ..Pose::default()
    }
}

/// Whether the vehicle has stood still for the last while.
fn is_still(path: &[Sample]) -> bool {
    let Some(recent) = path.len().checked_sub(STILL_TICKS).map(|from| &path[from..]) else { return false };
    recent.iter().all(|sample| sample.position.minus(recent[0].position).norm() < STILL_M)
}

/// The latest outcome that explains why the vehicle holds.
fn why_still(path: &[Sample]) -> Option<Outcome> {
    let recent = is_still(path).then(|| &path[path.len() - STILL_TICKS..])?;
    recent.iter().rev().map(|sample| sample.outcome).find(|outcome| *outcome != Outcome::Nominal)
}

#[cfg(test)]
mod tests;
