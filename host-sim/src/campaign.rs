//! The firmware in QEMU with everything going wrong, some hundred missions long.
//!
//! The vehicle flies to and fro between two places past pillars, beside a modelled autopilot. Every few seconds one fault
//! happens, by a seed: from outside (noise and cuts on the line, an autopilot that restarts, converters that freeze) or
//! inside ([`Fault`]: power cuts at any instruction, panics, faults of the processor, a stolen processor, a starved
//! planner, spoiled flash). Then the pilot takes over and enters the mode afresh, and the vehicle must fly on, or stand
//! still and say why. What is asked of every fault:
//!
//! - no setpoint outside the limits, and none that moves where the autopilot would not obey us;
//! - no pillar touched under our control. What the autopilot flies on by itself after the computer went away is counted
//!   apart: with `GUID_TIMEOUT` as [the manual](../../../docs/mavlink.md) has it that is a second;
//! - every restart that the program has made itself, or the watchdog, is told to the pilot.

use std::collections::BTreeMap;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use foxhound_core::guidance::FrontEnd;
use foxhound_core::map::Circle;
use foxhound_core::mission::{Behaviour, Outcome};
use foxhound_core::time::Instant;
use foxhound_link::dialect::MavMessage;
use foxhound_link::mailbox::{Fault, Setup};
use serde::Serialize;

use crate::autopilot::{Software, Start, Wire};
use crate::computer::{BLOCK, Computer, ComputerError, StepReport};
use crate::qemu::{QemuComputer, QemuError, Worst};
use crate::random::Random;
use crate::scenario::{Obstacle, Scenario, Sensor, SensorModel};
use crate::soak::manual_mode;
use crate::trial::{Clocks, Converters, Trial};
use crate::world::Horizontal;

/// Where the firmware keeps its flash in the shared memory, and how much of it.
pub const STORE_AT: u64 = 1 << 20;
/// Bytes of it.
pub const STORE_BYTES: u64 = 32 << 10;

/// A restart lasts this long: 25 steps.
const AWAY_STEPS: u32 = 25;
/// With the computer away the autopilot flies on for a second and brakes.
const COAST_US: u64 = 2_000_000;
const SECOND_US: u64 = 1_000_000;
/// So long the vehicle may take to fly on after the pilot's fresh entry.
const RECOVERY_US: u64 = 25 * SECOND_US;
/// So long it may take until the pilot is told of a restart.
const TOLD_US: u64 = 5 * SECOND_US;
/// Bytes that the line carries in a step at 921 600 baud.
const LINE_BYTES: usize = 1843;
/// We hear of a change of the mode with the next heartbeat, a second later at most, and half a step later here.
const HEARTBEAT_US: u64 = 1_060_000;
const ARRIVED_M: f64 = 1.0;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Bytes are lost and changed, both ways.
    LineNoise,
    /// Nothing comes through, either way.
    LineCut,
    /// Random bytes come in as fast as the line carries them.
    LineFlood,
    /// Frames are cut short, and their length is wrong.
    WrongLength,
    /// The autopilot does not say that it is there.
    NoHeartbeat,
    /// It does not say where the vehicle is.
    NoPosition,
    /// Nothing is said of obstacles.
    NoObstacles,
    /// Its place jumps.
    PositionJump,
    /// It restarts.
    AutopilotRestart,
    /// The pilot changes the mode to and fro.
    ModeFlapping,
    /// The converters bring the same codes again and again.
    FrozenConverters,
    /// They bring nothing.
    NoFrames,
    /// Our clock jumps, forward or back.
    ClockJump,
    /// The power is cut at any instruction.
    PowerCut,
    /// So it is, and the flash is spoiled.
    SpoiledFlash,
    /// Interrupts take the processor away.
    StolenProcessor,
    /// The planner does not get to run.
    StarvedPlanner,
    /// The program panics.
    Panic,
    /// It executes what is no instruction.
    UndefinedInstruction,
    /// Its stack overflows.
    StackOverflow,
    /// It hangs.
    Hang,
}

/// All of them.
pub const KINDS: [Kind; 21] = [
    Kind::LineNoise,
    Kind::LineCut,
    Kind::LineFlood,
    Kind::WrongLength,
    Kind::NoHeartbeat,
    Kind::NoPosition,
    Kind::NoObstacles,
    Kind::PositionJump,
    Kind::AutopilotRestart,
    Kind::ModeFlapping,
    Kind::FrozenConverters,
    Kind::NoFrames,
    Kind::ClockJump,
    Kind::PowerCut,
    Kind::SpoiledFlash,
    Kind::StolenProcessor,
    Kind::StarvedPlanner,
    Kind::Panic,
    Kind::UndefinedInstruction,
    Kind::StackOverflow,
    Kind::Hang,
];

/// What became of the faults of one kind.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Row {
    /// How many there were.
    pub faults: u32,
    /// After so many the vehicle flew on.
    pub recovered: u32,
    /// After so many it stood still, by the outcome that was published.
    pub safe: BTreeMap<&'static str, u32>,
    /// After so many it did neither.
    pub lost: u32,
    /// Pillars touched under our control.
    pub collisions: u32,
    /// Pillars touched while the computer was away.
    pub collisions_away: u32,
    /// Restarts of the computer.
    pub restarts: u32,
    /// Those that the pilot was told of.
    pub restarts_told: u32,
    /// Setpoints that were too fast or not finite.
    pub outside_limits: u32,
    /// Setpoints that would have moved the vehicle where the autopilot would not obey us.
    pub uninvited: u32,
}

impl Row {
    fn add(&mut self, other: &Self) {
        self.faults += other.faults;
        self.recovered += other.recovered;
        for (name, count) in &other.safe {
            *self.safe.entry(name).or_default() += count;
        }
        self.lost += other.lost;
        self.collisions += other.collisions;
        self.collisions_away += other.collisions_away;
        self.restarts += other.restarts;
        self.restarts_told += other.restarts_told;
        self.outside_limits += other.outside_limits;
        self.uninvited += other.uninvited;
    }
}

/// What came of some missions.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// How many.
    pub missions: u32,
    /// Simulated seconds.
    pub seconds: u64,
    /// By kind.
    pub rows: BTreeMap<Kind, Row>,
    /// The worst that was seen.
    pub worst: Worst,
}

impl Report {
    /// Takes in another one.
    pub fn add(&mut self, other: &Self) {
        self.missions += other.missions;
        self.seconds += other.seconds;
        for (kind, row) in &other.rows {
            self.rows.entry(*kind).or_default().add(row);
        }
        self.worst.add(other.worst);
    }

    /// All kinds together.
    #[must_use]
    pub fn all(&self) -> Row {
        self.rows.values().fold(Row::default(), |mut all, row| {
            all.add(row);
            all
        })
    }
}

/// Flies one mission with so many faults; their kinds take turns from `first` on.
///
/// # Errors
/// The firmware does not answer any more.
pub fn fly(elf: &Path, seed: u64, faults: u32, first: usize) -> Result<Report, QemuError> {
    let software = if seed.is_multiple_of(2) { Software::ArduCopter } else { Software::Px4 };
    let scenario = forest(seed);
    let setup = Setup { guidance: Trial::guidance(&scenario, seed) };
    let twin = Twin { qemu: QemuComputer::start_without_port(elf, &setup)?, setup, away: 0, restarts: 0, broken: None };
    let mut trial = Trial::with(twin, &scenario, software, Start::Hovering, Clocks::default(), seed);
    for (name, value) in [("GUID_TIMEOUT", 1.0), ("COM_OF_LOSS_T", 0.5)] {
        trial.autopilot.set_parameter(name, value);
    }
    let ends = [trial.world.source, Horizontal::from_xy(scenario.start)];
    let random = Random::new(seed, 0xfa17);
    let mut flight = Flight {
        trial,
        software,
        random,
        ends,
        away_until_us: 0,
        row: Row::default(),
        last: None,
        obeyed_us: 0,
        guard_mps: f64::from(setup.guidance.guard.v_max_mps),
    };
    let mut report = Report { missions: 1, ..Report::default() };
    flight.run(2.0);
    for number in 0..faults as usize {
        let kind = KINDS[(first + number) % KINDS.len()];
        let row = flight.suffer(kind);
        report.rows.entry(kind).or_default().add(&row);
        if let Some(error) = flight.trial.computer.broken.take() {
            return Err(error);
        }
        if flight.trial.collided {
            break;
        }
    }
    report.seconds = flight.trial.time_us() / SECOND_US;
    report.worst = flight.trial.computer.qemu.worst();
    Ok(report)
}

/// Eight pillars between two places, far enough from each other to fly between.
fn forest(seed: u64) -> Scenario {
    let mut random = Random::new(seed, 0xf0e5);
    let mut obstacles: Vec<Obstacle> = Vec::new();
    while obstacles.len() < 8 {
        let (x, y, r) = (-2.0 + 4.0 * random.uniform(), 3.0 + 18.0 * random.uniform(), 0.2 + 0.3 * random.uniform());
        let gap_m = |other: &Obstacle| libm::hypot(other.x - x, other.y - y) - other.r - r;
        if obstacles.iter().all(|other| gap_m(other) > 1.0) {
            obstacles.push(Obstacle { x, y, r, ..Obstacle::default() });
        }
    }
    Scenario {
        start: [0.0, 0.0],
        goal: [0.0, 24.0],
        obstacles,
        sensor: Sensor { model: SensorModel::Scan, range_m: 4.0, ..Sensor::default() },
        ..Scenario::default()
    }
}

struct Flight {
    trial: Trial<Twin>,
    software: Software,
    random: Random,
    ends: [Horizontal; 2],
    /// The autopilot is on its own until then.
    away_until_us: u64,
    row: Row,
    /// The last outcome that was published.
    last: Option<Outcome>,
    /// When the autopilot obeyed us last, and could say so.
    obeyed_us: u64,
    guard_mps: f64,
}

impl Flight {
    /// One fault, from before it until the vehicle flies on or stands still.
    fn suffer(&mut self, kind: Kind) -> Row {
        self.row = Row { faults: 1, ..Row::default() };
        let restarts = self.trial.computer.restarts;
        self.trial.give_control();
        let calm_s = 0.5 + 1.5 * self.random.uniform();
        self.run(calm_s);
        self.happen(kind);
        self.heal();
        self.run(0.5);
        let (now_us, manual) = (self.trial.autopilot_us(), manual_mode(self.software));
        self.trial.autopilot.select_mode(now_us, manual);
        // Long enough for a heartbeat to say so.
        self.run(1.1);
        let now_us = self.trial.autopilot_us();
        self.trial.autopilot.arm(now_us);
        self.trial.give_control();
        let until_us = self.trial.time_us() + RECOVERY_US;
        let from = self.trial.motion().pose.position_ned_m;
        let mut flies = false;
        while !flies && self.trial.time_us() < until_us && !self.trial.collided && !self.is_broken() {
            self.run(0.2);
            let [north, east, _] = self.trial.motion().pose.position_ned_m;
            let way_m = libm::hypot(north - from[0], east - from[1]);
            flies = way_m > 0.7 && self.last.is_some_and(|outcome| outcome.behaviour() == Behaviour::Follow);
        }
        let [north_mps, east_mps, _] = self.trial.motion().velocity_ned_mps;
        match self.last {
            _ if self.trial.collided => {}
            _ if flies => self.row.recovered = 1,
            Some(outcome) if outcome.behaviour() != Behaviour::Follow && libm::hypot(north_mps, east_mps) < 0.1 => {
                self.row.safe.insert(outcome.name(), 1);
            }
            _ => self.row.lost = 1,
        }
        // A power cut may come late, and the word of it after that.
        let until_us = self.trial.time_us() + TOLD_US;
        while self.row.restarts_told < self.trial.computer.restarts - restarts
            && self.trial.time_us() < until_us
            && !self.trial.collided
            && !self.is_broken()
        {
            self.step();
        }
        self.row.restarts = self.trial.computer.restarts - restarts;
        self.row.clone()
    }

    fn is_broken(&self) -> bool {
        self.trial.computer.broken.is_some()
    }

    fn happen(&mut self, kind: Kind) {
        let long_s = 0.2 + 3.0 * self.random.uniform();
        let now_us = self.trial.autopilot_us();
        match kind {
            Kind::LineNoise => {
                let (loss, corruption) = (0.05 * self.random.uniform(), 0.02 * self.random.uniform());
                self.trial.wire = Some(Wire::new(now_us, loss, corruption));
            }
            Kind::LineCut => {
                self.trial.autopilot.faults.is_silent = true;
                self.trial.autopilot.faults.is_deaf = true;
            }
            Kind::NoHeartbeat => self.trial.autopilot.faults.heartbeat_is_silent = true,
            Kind::NoPosition => self.trial.ownship_is_silent = true,
            Kind::NoObstacles => self.trial.obstacles_are_silent = true,
            Kind::PositionJump => {
                let step_ned_m = [3.0 * self.random.gaussian(), 3.0 * self.random.gaussian(), 0.0];
                self.trial.autopilot.jump(now_us, step_ned_m, false);
            }
            Kind::AutopilotRestart => self.trial.autopilot.reboot(now_us, 1_500_000),
            Kind::FrozenConverters => self.trial.converters = Converters::Freeze,
            Kind::NoFrames => self.trial.converters = Converters::Stop,
            Kind::ClockJump => {
                let jump_us = (6e6 * (self.random.uniform() - 0.5)) as i64;
                self.trial.clock_off_us += jump_us;
            }
            Kind::SpoiledFlash => {
                self.spoil();
                self.inject(Fault::PowerCut { after_us: 1 });
            }
            Kind::PowerCut => {
                // Steps take a few thousand microseconds of the twin's time, a replan some hundred thousand.
                let after_us = libm::pow(10.0, 5.5 * self.random.uniform()) as u32;
                self.inject(Fault::PowerCut { after_us });
            }
            Kind::Panic => self.inject(Fault::Panic),
            Kind::UndefinedInstruction => self.inject(Fault::Undefined),
            Kind::StackOverflow => self.inject(Fault::Overflow),
            Kind::Hang => self.inject(Fault::Hang),
            Kind::LineFlood | Kind::WrongLength | Kind::ModeFlapping | Kind::StolenProcessor | Kind::StarvedPlanner => {
            }
        }
        for _ in 0..(long_s * 50.0) as u32 {
            match kind {
                Kind::LineFlood => {
                    let bytes: Vec<u8> = (0..LINE_BYTES).map(|_| (256.0 * self.random.uniform()) as u8).collect();
                    self.trial.pour(&bytes);
                }
                Kind::WrongLength => {
                    // The head of a frame with any length, and less than that of it.
                    let length = (256.0 * self.random.uniform()) as u8;
                    let mut frame = vec![0xfd, length, 0, 0, 0, 1, 1, 30, 0, 0];
                    frame.resize(10 + usize::from(length) / 2, 0x55);
                    self.trial.pour(&frame);
                }
                Kind::ModeFlapping if self.random.uniform() < 0.2 => {
                    let now_us = self.trial.autopilot_us();
                    let mode = if self.random.uniform() < 0.5 {
                        manual_mode(self.software)
                    } else {
                        self.trial.autopilot.companion_mode()
                    };
                    self.trial.autopilot.select_mode(now_us, mode);
                }
                Kind::StolenProcessor => {
                    let for_us = (600_000.0 * self.random.uniform()) as u32;
                    self.inject(Fault::Steal { for_us });
                }
                Kind::StarvedPlanner => self.inject(Fault::StarvePlanner),
                _ => {}
            }
            self.step();
        }
    }

    fn heal(&mut self) {
        let faults = &mut self.trial.autopilot.faults;
        (faults.heartbeat_is_silent, faults.is_silent, faults.is_deaf) = (false, false, false);
        (self.trial.wire, self.trial.ownship_is_silent, self.trial.obstacles_are_silent) = (None, false, false);
        self.trial.converters = Converters::Work;
    }

    fn inject(&mut self, fault: Fault) {
        self.trial.computer.qemu.inject(fault);
    }

    /// Turns bits of the flash, or fills pages of it with rubbish.
    fn spoil(&mut self) {
        let memory = self.trial.computer.qemu.memory();
        let mut flash = vec![0; STORE_BYTES as usize];
        // What cannot be read or written shows as a flash that is not spoiled.
        if memory.read_exact_at(&mut flash, STORE_AT).is_err() {
            return;
        }
        for _ in 0..1 + (40.0 * self.random.uniform()) as usize {
            let at = (self.random.uniform() * flash.len() as f64) as usize;
            if self.random.uniform() < 0.2 {
                let fill = (256.0 * self.random.uniform()) as u8;
                flash[at..].iter_mut().take(64).for_each(|byte| *byte = fill);
            } else {
                flash[at] ^= 1 << ((8.0 * self.random.uniform()) as u8 & 7);
            }
        }
        let _ = memory.write_all_at(&flash, STORE_AT);
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 50.0) as u32 {
            self.step();
        }
    }

    fn step(&mut self) {
        if self.trial.collided || self.is_broken() {
            return;
        }
        if self.trial.to_source_m() < ARRIVED_M {
            // To the other end.
            let [first, second] = self.ends;
            self.trial.world.source = if self.trial.world.source == first { second } else { first };
        }
        let step = self.trial.step();
        if self.trial.computer.away > 0 {
            self.away_until_us = step.time_us + COAST_US;
        }
        if let Some(output) = &step.output {
            self.last = Some(output.outcome);
        }
        if step.obeyed || self.trial.autopilot.faults.is_silent {
            self.obeyed_us = step.time_us;
        }
        let may_move = step.time_us < self.obeyed_us + HEARTBEAT_US;
        for setpoint in step.setpoints() {
            let speed_mps = libm::hypot(f64::from(setpoint.vx), f64::from(setpoint.vy));
            let numbers = [setpoint.vx, setpoint.vy, setpoint.vz, setpoint.yaw_rate];
            let is_inside = numbers.iter().all(|number| number.is_finite()) && speed_mps <= self.guard_mps + 1e-3;
            self.row.outside_limits += u32::from(!is_inside);
            self.row.uninvited += u32::from(!may_move && speed_mps > 0.05);
        }
        for (_, message) in &step.sent {
            if let MavMessage::STATUSTEXT(text) = message
                && text.text.to_str().is_ok_and(|text| text.starts_with("Foxhound: restart "))
            {
                self.row.restarts_told += 1;
            }
        }
        if self.trial.collided {
            let is_away = step.time_us < self.away_until_us;
            self.row.collisions_away += u32::from(is_away);
            self.row.collisions += u32::from(!is_away);
        }
    }
}

/// The firmware, which is away for a while after a restart.
struct Twin {
    qemu: QemuComputer,
    setup: Setup,
    /// Steps until it is there again.
    away: u32,
    restarts: u32,
    /// It does not answer any more.
    broken: Option<QemuError>,
}

impl Computer for Twin {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        if self.away > 0 {
            self.away -= 1;
            if self.away == 0
                && let Err(error) = self.qemu.recover(&self.setup)
            {
                self.broken = Some(error);
            }
            return Err(ComputerError("the firmware restarts".to_owned()));
        }
        match self.qemu.step(now, front_end, circles, rx) {
            Ok(report) => Ok(StepReport { output: report.output, plan: report.plan, tx: report.tx }),
            Err(error) => {
                let text = error.to_string();
                match error {
                    QemuError::Restarted => (self.away, self.restarts) = (AWAY_STEPS, self.restarts + 1),
                    error => self.broken = Some(error),
                }
                Err(ComputerError(text))
            }
        }
    }
}
