//! The link for days: one end of it with a modelled autopilot, in simulated time, with alternating faults.
//!
//! Guidance is constant here, so that hours pass in seconds; [`fly_laps`] has the whole computer. Every few seconds
//! one of these happens, by a seed, and then nothing for a while:
//!
//! - bytes are lost, or changed, in bursts;
//! - heartbeats do not come, or nothing does;
//! - the autopilot restarts;
//! - guidance stops;
//! - the autopilot's position or heading jumps;
//! - the pilot changes the mode to and fro;
//! - a ground station requests the time, all parameters, or its own rates of all streams, as `MAVProxy` does.
//!
//! After each the pilot enters the mode again, and the stream must be guidance's again.

use foxhound_core::ConfigError;
use foxhound_core::base::ned::Ned;
use foxhound_core::base::time::Instant;
use foxhound_core::control::guard::Setpoint;
use foxhound_core::guidance::mission::{Control, Outcome};
use foxhound_core::guidance::{self, FrontEnd, Input, Output};
use foxhound_link::MessageData;
use foxhound_link::companion::{self, Companion, Counters};
use foxhound_link::dialect::{MavMessage, PARAM_REQUEST_LIST_DATA, REQUEST_DATA_STREAM_DATA, TIMESYNC_DATA};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};
use serde::Serialize;

use super::computer::BLOCK;
use super::trial::{Clocks, Trial};
use crate::autopilot::{Autopilot, Start, TIMEOUTS_S, Wire};
use crate::scenario::{self, Obstacle, Scenario, Sensor, SensorModel, Software, VehicleModel};
use crate::world::Pose;
use crate::world::random::Random;
use crate::world::vehicle::{Motion, Vehicle};

/// Setpoints leave on multiples of this.
const GRID_US: u64 = 50_000;
const SECOND_US: u64 = 1_000_000;
const GROUND_STATION: (u8, u8) = (255, 190);
/// Largest age of the vehicle's telemetry without a fault: a step on each side, and a millisecond of stamps.
const TELEMETRY_AGE_MAX_S: f32 = 0.05;
const SPEED_MPS: f32 = 0.5;
const TRANSMIT_BYTES: usize = 4096;
const KINDS: usize = 13;
const LAP_KINDS: usize = 8;
/// Steps after which the number in a setpoint starts over; over this many the yaw rate stays below 1 rad/s.
const NUMBERS: u64 = 4096;

/// Duration and conditions.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// The autopilot.
    pub software: Software,
    /// Simulated time.
    pub hours: f64,
    /// Length of a step; a divisor of 50 ms.
    pub step_us: u64,
    /// The clocks at the beginning.
    pub clocks: Clocks,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Results.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Simulated seconds.
    pub seconds: u64,
    /// Heartbeats that we sent.
    pub heartbeats: u64,
    /// Largest deviation of one of them from its second, microseconds.
    pub heartbeat_off_us: u64,
    /// Setpoints that we sent.
    pub setpoints: u64,
    /// Those that were not sent in the first step of their period.
    pub setpoints_off_grid: u64,
    /// Those that are neither guidance's nor zero.
    pub setpoints_wrong: u64,
    /// The longest time from guidance's output to the setpoint that repeats it, microseconds.
    pub setpoint_oldest_us: u64,
    /// Clock requests to us, and answers to them.
    pub clock_requests: u64,
    /// Answers to clock requests.
    pub clock_answers: u64,
    /// Values of parameters that we sent.
    pub parameters: u64,
    /// Faults, by kind.
    pub faults: [u64; KINDS],
    /// Faults after which guidance's stream was not restored by entering the mode again.
    pub not_recovered: u64,
    /// Moments without a fault at which telemetry was taken for older than it was, or for newer than now.
    pub telemetry_off: u64,
    /// The oldest telemetry in such a moment, seconds.
    pub telemetry_oldest_s: f32,
    /// True restarts of the autopilot.
    pub restarts: u64,
    /// Restarts of the autopilot counted by the link.
    pub restarts_counted: u32,
    /// Frames that the link took.
    pub frames: u32,
    /// Frames that it found damaged.
    pub damaged: u32,
    /// Answers and telemetry that were dropped.
    pub dropped: u32,
    /// Bytes of the link's state.
    pub state_bytes: usize,
}

/// Runs the link for the time of `config`; `watch` is called with the hours as they pass.
///
/// # Errors
/// The field of the link's configuration that is refused.
pub fn keep_link(config: &Config, mut watch: impl FnMut(f64)) -> Result<Report, ConfigError> {
    let mut soak = Soak::new(config)?;
    let end_us = (config.hours * 3600.0) as u64 * SECOND_US;
    while soak.time_us < end_us {
        watch(soak.time_us as f64 / 3.6e9);
        let calm_us = (5.0 + 20.0 * soak.random.uniform()) as u64 * SECOND_US;
        soak.run(calm_us);
        soak.be_faulty();
        soak.recover();
    }
    Ok(soak.finish())
}

struct Soak {
    config: Config,
    companion: Companion,
    autopilot: Autopilot,
    vehicle: Vehicle,
    wire: Option<Wire>,
    guidance_stands_still: bool,
    random: Random,
    output: Output,
    framer: Framer,
    time_us: u64,
    ground: Vec<u8>,
    sequence: u8,
    report: Report,
    /// Recent setpoints: whether each is guidance's.
    latest: Vec<bool>,
}

impl Soak {
    fn new(config: &Config) -> Result<Self, ConfigError> {
        let model = scenario::Vehicle { model: VehicleModel::Point, ..scenario::Vehicle::default() };
        let pose = Pose { position_ned_m: [0.0, 0.0, -5.0], ..Pose::default() };
        Ok(Self {
            config: *config,
            companion: companion::Config::default().build()?,
            autopilot: Autopilot::new(config.software, Start::Hovering),
            vehicle: Vehicle::new(model, 2.0, pose),
            wire: None,
            guidance_stands_still: false,
            random: Random::new(config.seed, 0x50a1),
            output: constant_output()?,
            framer: Framer::new(),
            time_us: 0,
            ground: Vec::new(),
            sequence: 0,
            report: Report { state_bytes: size_of::<Companion>(), ..Report::default() },
            latest: Vec::new(),
        })
    }

    const fn theirs_us(&self) -> u64 {
        self.config.clocks.theirs_us + self.time_us
    }

    fn run(&mut self, for_us: u64) {
        let end_us = self.time_us + for_us;
        while self.time_us < end_us {
            self.step();
        }
    }

    fn step(&mut self) {
        let theirs_us = self.theirs_us();
        let now = Instant(self.config.clocks.ours_us + self.time_us);
        let motion = self.vehicle.motion;
        self.autopilot.telemetry(theirs_us, &motion, false);
        let mut rx = self.autopilot.transmit();
        rx.append(&mut self.ground);
        if let Some(wire) = &mut self.wire {
            rx = wire.to_companion(&rx);
        }
        self.companion.receive(now, &rx);
        if !self.guidance_stands_still {
            self.output.time = now;
            self.output.setpoint = self.setpoint();
            self.companion.publish(now, &self.output);
        }
        self.companion.poll(now);
        let mut tx = vec![0; TRANSMIT_BYTES];
        let length = self.companion.transmit(&mut tx);
        tx.truncate(length);
        self.read(now, &tx);
        if let Some(wire) = &mut self.wire {
            tx = wire.to_autopilot(&tx);
        }
        self.autopilot.receive(theirs_us, &motion, &tx);
        self.vehicle.step(self.autopilot.command(theirs_us), self.config.step_us as f64 * 1e-6);
        self.time_us += self.config.step_us;
    }

    /// To and fro, so that the vehicle stays near; the yaw rate encodes the number of the step.
    fn setpoint(&self) -> Setpoint {
        let step = self.time_us / self.config.step_us;
        let sign = if (self.time_us / GRID_US).is_multiple_of(2) { 1.0 } else { -1.0 };
        Setpoint {
            velocity_ned_mps: Ned { north: sign * SPEED_MPS, east: 0.0, down: 0.0 },
            yaw_rate_radps: (step % NUMBERS) as f32 / NUMBERS as f32,
        }
    }

    fn read(&mut self, now: Instant, bytes: &[u8]) {
        self.framer.each(bytes, |frame| match frame.message() {
            Some(MavMessage::HEARTBEAT(_)) => {
                let due_us = self.report.heartbeats * SECOND_US;
                self.report.heartbeat_off_us = self.report.heartbeat_off_us.max(self.time_us.abs_diff(due_us));
                self.report.heartbeats += 1;
            }
            Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) => {
                self.report.setpoints += 1;
                self.report.setpoints_off_grid += u64::from(now.0 % GRID_US >= self.config.step_us);
                let speed_mps = libm::hypotf(target.vx, target.vy);
                // The link may have rotated it.
                let is_ours = (speed_mps - SPEED_MPS).abs() < 1e-4;
                self.report.setpoints_wrong += u64::from(!is_ours && speed_mps != 0.0);
                if is_ours {
                    let number = (target.yaw_rate * NUMBERS as f32) as u64;
                    let age = (self.time_us / self.config.step_us + NUMBERS - number) % NUMBERS;
                    let age_us = age * self.config.step_us;
                    self.report.setpoint_oldest_us = self.report.setpoint_oldest_us.max(age_us);
                }
                self.latest.push(is_ours);
            }
            Some(MavMessage::TIMESYNC(answer)) => self.report.clock_answers += u64::from(answer.tc1 != 0),
            Some(MavMessage::PARAM_VALUE(_)) => self.report.parameters += 1,
            _ => {}
        });
    }

    fn be_faulty(&mut self) {
        let kind = (self.random.uniform() * KINDS as f64) as usize;
        self.report.faults[kind] += 1;
        let long_us = (0.2 + 8.0 * self.random.uniform()) * 1e6;
        let (theirs_us, share) = (self.theirs_us(), 0.03 * self.random.uniform());
        match kind {
            0 => self.wire = Some(Wire::new(theirs_us, share, 0.0)),
            1 => self.wire = Some(Wire::new(theirs_us, 0.0, share)),
            2 => self.autopilot.faults.heartbeat_is_silent = true,
            3 => self.autopilot.faults.is_silent = true,
            4 => self.autopilot.faults.is_deaf = true,
            5 => {
                self.report.restarts += 1;
                self.autopilot.reboot(theirs_us, (long_us / 2.0) as u64);
            }
            6 => {
                let step_m = [5.0 * self.random.gaussian(), 5.0 * self.random.gaussian(), self.random.gaussian()];
                self.autopilot.jump(theirs_us, step_m, share < 0.015);
            }
            7 => self.autopilot.jump_yaw(self.random.gaussian()),
            8 => {
                for _ in 0..5 {
                    self.change_mode();
                    self.run((0.3 * long_us) as u64 / self.config.step_us * self.config.step_us);
                    self.give_control();
                }
            }
            9 => {
                for index in 0..100_i64 {
                    self.report.clock_requests += 1;
                    self.say(&TIMESYNC_DATA { tc1: 0, ts1: index + 1, target_system: 1, target_component: 191 });
                    self.run(SECOND_US / 20);
                }
            }
            // A longer stop makes us unfit permanently.
            10 => {
                self.guidance_stands_still = true;
                self.run(long_us as u64 / 5 / self.config.step_us * self.config.step_us);
                self.guidance_stands_still = false;
            }
            11 => self.say(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 191 }),
            _ => {
                for rate_hz in [4, 1, 0] {
                    self.ask_for_streams(rate_hz);
                    self.run(SECOND_US);
                }
            }
        }
        self.run(long_us as u64 / self.config.step_us * self.config.step_us);
    }

    /// Ends the fault, and the pilot enters the mode again.
    fn recover(&mut self) {
        self.wire = None;
        let faults = &mut self.autopilot.faults;
        (faults.heartbeat_is_silent, faults.is_silent, faults.is_deaf) = (false, false, false);
        self.run(2 * SECOND_US);
        self.change_mode();
        self.run(3 * SECOND_US);
        if !self.autopilot.armed {
            let theirs_us = self.theirs_us();
            self.autopilot.arm(theirs_us);
        }
        self.give_control();
        // Time for a heartbeat, and for the window in which damaged frames are counted.
        self.run(3 * SECOND_US);
        self.latest.clear();
        self.run(SECOND_US);
        let is_good = self.latest.len().abs_diff(20) <= 1 && self.latest.iter().all(|is_ours| *is_ours);
        let now = Instant(self.config.clocks.ours_us + self.time_us);
        self.report.not_recovered += u64::from(!is_good || self.companion.control(now) != Control::Granted);
        let age_s = self.companion.ownship().map_or(f32::MAX, |ownship| {
            let is_future = ownship.position_time.0 > now.0 || ownship.attitude_time.0 > now.0;
            let oldest = ownship.position_time.0.min(ownship.attitude_time.0);
            if is_future { f32::MAX } else { now.seconds_since(Instant(oldest)) }
        });
        self.report.telemetry_off += u64::from(age_s > TELEMETRY_AGE_MAX_S);
        self.report.telemetry_oldest_s = self.report.telemetry_oldest_s.max(age_s);
        self.latest.clear();
    }

    fn change_mode(&mut self) {
        let (theirs_us, software) = (self.theirs_us(), self.config.software);
        self.autopilot.select_mode(theirs_us, manual_mode(software));
    }

    fn give_control(&mut self) {
        let (theirs_us, mode) = (self.theirs_us(), self.autopilot.companion_mode());
        self.autopilot.select_mode(theirs_us, mode);
    }

    /// As `MAVProxy` does by itself, towards the autopilot.
    fn ask_for_streams(&mut self, rate_hz: u16) {
        let request = REQUEST_DATA_STREAM_DATA {
            req_message_rate: rate_hz,
            target_system: 1,
            target_component: 1,
            req_stream_id: 0,
            start_stop: u8::from(rate_hz > 0),
        };
        let frame = self.frame(&request);
        let (theirs_us, motion): (u64, Motion) = (self.theirs_us(), self.vehicle.motion);
        self.autopilot.receive(theirs_us, &motion, &frame);
    }

    fn say<D: MessageData>(&mut self, data: &D) {
        let frame = self.frame(data);
        self.ground.extend(frame);
    }

    fn frame<D: MessageData>(&mut self, data: &D) -> Vec<u8> {
        let (system_id, component_id) = GROUND_STATION;
        let header = Header { system_id, component_id, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(header, data, &mut frame);
        frame[..length].to_vec()
    }

    fn finish(self) -> Report {
        let Counters { framer, reboots, errands_dropped, telemetry_dropped, .. } = self.companion.counters();
        Report {
            seconds: self.time_us / SECOND_US,
            restarts_counted: reboots,
            frames: framer.frames,
            damaged: framer.bad_crc,
            dropped: errands_dropped.saturating_add(telemetry_dropped),
            ..self.report
        }
    }
}

/// A course between six pillars, as a scan sees them.
#[must_use]
pub fn course() -> Scenario {
    let pillars =
        [[0.3, 6.0, 0.4], [-0.8, 10.0, 0.3], [0.9, 13.0, 0.5], [-0.2, 17.0, 0.3], [0.4, 21.0, 0.4], [-1.2, 24.0, 0.4]];
    Scenario {
        start: [0.0, 0.0],
        goal: [0.0, 28.0],
        obstacles: pillars.map(|[x, y, r]| Obstacle { x, y, r, ..Obstacle::default() }).to_vec(),
        sensor: Sensor { model: SensorModel::Scan, range_m: 4.0, ..Sensor::default() },
        ..Scenario::default()
    }
}

/// The pilot's own mode.
#[must_use]
pub const fn manual_mode(software: Software) -> u32 {
    match software {
        Software::ArduCopter => crate::autopilot::model::arducopter::LOITER,
        Software::Px4 => crate::autopilot::model::px4::POSITION,
    }
}

/// A guidance that always flies its demand.
fn constant_output() -> Result<Output, ConfigError> {
    let guidance = guidance::Config::default().build::<BLOCK>()?;
    let input = Input {
        now: Instant(0),
        front_end: FrontEnd::Nothing,
        ownship: None,
        scan: None,
        points: None,
        circles: None,
        look: None,
        height_m: None,
        is_landed: false,
        control: Control::NotInControl,
        answer: None,
    };
    let output = guidance.step(&mut guidance.start(), &input);
    Ok(Output { outcome: Outcome::Nominal, ..output })
}

/// Results of the whole computer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Laps {
    /// Simulated seconds.
    pub seconds: u64,
    /// Number of times that the vehicle reached the beacon, which was then at the other end of the field.
    pub laps: u64,
    /// Number of times that it did not reach it within three minutes, and was continued by entering the mode again.
    pub missed: u64,
    /// Number of times that the pilot was asked to leave the mode and enter it again, and did.
    pub entered_again: u64,
    /// Faults, by kind.
    pub faults: [u64; LAP_KINDS],
    /// The last one.
    pub last_fault: usize,
    /// Whether there was a collision.
    pub collided: bool,
    /// The least distance of the hull to a pillar, metres.
    pub min_clearance_m: f64,
    /// Heartbeats that we sent.
    pub heartbeats: u64,
    /// Setpoints that were not sent in the first step of their period.
    pub setpoints_off_grid: u64,
}

/// The whole computer, guidance and link, to and fro between two places past some pillars, with a fault in every lap.
///
/// # Errors
/// The field of the configuration that is refused.
pub fn fly_laps(scenario: &Scenario, config: &Config, mut watch: impl FnMut(f64)) -> Result<Laps, ConfigError> {
    let mut trial = Trial::new(scenario, config.software, Start::Hovering, config.clocks, config.seed)?;
    for (name, value) in TIMEOUTS_S {
        trial.rig.autopilot.set_parameter(name, value);
    }
    let mut random = Random::new(config.seed, 0x1a95);
    let mut laps = Laps::default();
    let ends = [trial.rig.world.source, crate::world::Horizontal::from_xy(scenario.start)];
    let end_us = (config.hours * 3600.0) as u64 * SECOND_US;
    let mut stood_still = false;
    // Says whether the pilot was asked to enter the mode again.
    let mut run = |trial: &mut Trial, laps: &mut Laps, seconds: f64| {
        let mut is_asked = false;
        for _ in 0..(seconds * 50.0) as u32 {
            let step = trial.step();
            is_asked |= step.asks_for_entry();
            // Setpoints that waited while the computer stood still are sent at once.
            let is_late = step.time_us % GRID_US >= crate::drive::trial::STEP_US && !stood_still;
            stood_still = step.output.is_none();
            laps.setpoints_off_grid += u64::from(is_late) * step.setpoints().count() as u64;
            let beats = step.sent.iter().filter(|(_, message)| matches!(message, MavMessage::HEARTBEAT(_)));
            laps.heartbeats += beats.count() as u64;
        }
        is_asked
    };
    run(&mut trial, &mut laps, 2.0);
    while trial.time_us() < end_us && !trial.rig.collided {
        watch(trial.time_us() as f64 / 3.6e9);
        trial.rig.world.source = ends[(laps.laps % 2) as usize];
        trial.give_control();
        run(&mut trial, &mut laps, 4.0 + 6.0 * random.uniform());
        let now_us = trial.autopilot_us();
        let kind = (random.uniform() * LAP_KINDS as f64) as usize;
        (laps.faults[kind], laps.last_fault) = (laps.faults[kind] + 1, kind);
        match kind {
            0 => trial.wire = Some(Wire::new(now_us, 0.02 * random.uniform(), 0.01 * random.uniform())),
            1 => trial.rig.autopilot.faults.heartbeat_is_silent = true,
            2 => trial.rig.autopilot.faults.is_silent = true,
            3 => trial.ownship_is_silent = true,
            4 => trial.obstacles_are_silent = true,
            5 => trial.rig.autopilot.jump(now_us, [3.0 * random.gaussian(), 3.0 * random.gaussian(), 0.0], false),
            6 => trial.rig.autopilot.reboot(now_us, 1_500_000),
            _ => trial.computer_stands_still = true,
        }
        let long_s = 0.2 + 6.0 * random.uniform();
        run(&mut trial, &mut laps, long_s);
        let faults = &mut trial.rig.autopilot.faults;
        (faults.heartbeat_is_silent, faults.is_silent) = (false, false);
        (trial.wire, trial.ownship_is_silent, trial.obstacles_are_silent) = (None, false, false);
        trial.computer_stands_still = false;
        run(&mut trial, &mut laps, 2.0);
        let (now_us, mode) = (trial.autopilot_us(), manual_mode(config.software));
        trial.rig.autopilot.select_mode(now_us, mode);
        run(&mut trial, &mut laps, 1.5);
        trial.rig.autopilot.arm(now_us);
        trial.give_control();
        let limit_us = trial.time_us() + 180 * SECOND_US;
        while trial.to_source_m() > 1.0 && trial.time_us() < limit_us && !trial.rig.collided {
            if run(&mut trial, &mut laps, 0.2) {
                laps.entered_again += 1;
                let now_us = trial.autopilot_us();
                trial.rig.autopilot.select_mode(now_us, mode);
                run(&mut trial, &mut laps, 1.5);
                trial.give_control();
            }
        }
        laps.missed += u64::from(trial.to_source_m() > 1.0);
        laps.laps += u64::from(trial.to_source_m() <= 1.0);
        // The search for the next place of the beacon starts over.
        let now_us = trial.autopilot_us();
        trial.rig.autopilot.select_mode(now_us, mode);
        run(&mut trial, &mut laps, 3.0);
    }
    Ok(Laps {
        seconds: trial.time_us() / SECOND_US,
        collided: trial.rig.collided,
        min_clearance_m: trial.min_clearance_m(),
        ..laps
    })
}
