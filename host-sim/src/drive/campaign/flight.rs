//! One mission of the campaign: its faults, and their results.

use foxhound_computer::twin::{self, Fault, Setup};
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::FrontEnd;
use foxhound_core::guidance::mission::{Behaviour, Outcome};
use foxhound_link::dialect::MavMessage;

use super::kind::Kind;
use super::report::Row;
use crate::autopilot::Wire;
use crate::drive::computer::{BLOCK, Computer, ComputerError, StepReport};
use crate::drive::qemu::{QemuComputer, QemuError};
use crate::drive::soak::manual_mode;
use crate::drive::trial::{Converters, Trial};
use crate::scenario::Software;
use crate::world::Horizontal;
use crate::world::random::Random;

/// Bytes of the firmware's flash.
const STORE_BYTES: usize = 32 << 10;

pub(super) const SECOND_US: u64 = 1_000_000;
/// A restart lasts this long: 25 steps.
const AWAY_STEPS: u32 = 25;
/// With the computer away the autopilot flies on for a second and brakes.
const COAST_US: u64 = 2_000_000;
/// Longest time for the vehicle to fly on after the pilot has entered the mode again.
const RECOVERY_US: u64 = 25 * SECOND_US;
/// Longest time until the pilot gets the text about a restart.
const TOLD_US: u64 = 5 * SECOND_US;
/// Bytes that the line carries in a step at 921 600 baud.
const LINE_BYTES: usize = 1843;
/// The computer learns of a change of the mode by the next heartbeat, after a second at most, and half a step later
/// here.
const HEARTBEAT_US: u64 = 1_060_000;
/// If noise destroys that heartbeat, the vehicle holds after 2.5 s without one (`docs/autopilot.md`).
const QUIET_US: u64 = 2_560_000;
const ARRIVED_M: f64 = 1.0;

/// A mission in progress.
pub(super) struct Flight {
    pub(super) trial: Trial<Twin>,
    software: Software,
    random: Random,
    ends: [Horizontal; 2],
    /// The autopilot is on its own until then.
    away_until_us: u64,
    row: Row,
    /// The last outcome that was published.
    last: Option<Outcome>,
    /// When the autopilot last obeyed us, and could report it.
    obeyed_us: u64,
    guard_mps: f64,
    /// The present fault, or the last one.
    kind: Option<Kind>,
}

impl Flight {
    pub(super) fn new(
        trial: Trial<Twin>,
        software: Software,
        random: Random,
        ends: [Horizontal; 2],
        guard_mps: f32,
    ) -> Self {
        Self {
            trial,
            software,
            random,
            ends,
            away_until_us: 0,
            row: Row::default(),
            last: None,
            obeyed_us: 0,
            guard_mps: f64::from(guard_mps),
            kind: None,
        }
    }

    /// One fault, from before it until the vehicle flies on or holds.
    pub(super) fn suffer(&mut self, kind: Kind) -> Row {
        self.row = Row { faults: 1, ..Row::default() };
        self.kind = Some(kind);
        let (restarts, late_steps) = (self.trial.computer.restarts, self.trial.computer.late_steps);
        self.trial.give_control();
        let calm_s = 0.5 + 1.5 * self.random.uniform();
        self.run(calm_s);
        self.happen(kind);
        self.heal();
        self.run(0.5);
        let (now_us, manual) = (self.trial.autopilot_us(), manual_mode(self.software));
        self.trial.rig.autopilot.select_mode(now_us, manual);
        // Long enough for a heartbeat to report it.
        self.run(1.1);
        let now_us = self.trial.autopilot_us();
        self.trial.rig.autopilot.arm(now_us);
        self.trial.give_control();
        let until_us = self.trial.time_us() + RECOVERY_US;
        let from = self.trial.motion().pose.position_ned_m;
        let mut flies = false;
        while !flies && self.trial.time_us() < until_us && !self.trial.rig.collided && !self.is_broken() {
            self.run(0.2);
            let [north, east, _] = self.trial.motion().pose.position_ned_m;
            let way_m = libm::hypot(north - from[0], east - from[1]);
            flies = way_m > 0.7 && self.last.is_some_and(|outcome| outcome.behaviour() == Behaviour::Follow);
        }
        let [north_mps, east_mps, _] = self.trial.motion().velocity_ned_mps;
        match self.last {
            _ if self.trial.rig.collided => {}
            _ if flies => self.row.recovered = 1,
            Some(outcome) if outcome.behaviour() != Behaviour::Follow && libm::hypot(north_mps, east_mps) < 0.1 => {
                self.row.safe.insert(outcome.name().to_owned(), 1);
            }
            _ => self.row.lost = 1,
        }
        // A power cut may come late, and the text about it after that.
        let until_us = self.trial.time_us() + TOLD_US;
        while self.row.restarts_told < self.trial.computer.restarts - restarts
            && self.trial.time_us() < until_us
            && !self.trial.rig.collided
            && !self.is_broken()
        {
            self.step();
        }
        self.row.restarts = self.trial.computer.restarts - restarts;
        self.row.late_steps = self.trial.computer.late_steps - late_steps;
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
                self.trial.rig.autopilot.faults.is_silent = true;
                self.trial.rig.autopilot.faults.is_deaf = true;
            }
            Kind::NoHeartbeat => self.trial.rig.autopilot.faults.heartbeat_is_silent = true,
            Kind::NoPosition => self.trial.ownship_is_silent = true,
            Kind::NoObstacles => self.trial.obstacles_are_silent = true,
            Kind::PositionJump => {
                let step_ned_m = [3.0 * self.random.gaussian(), 3.0 * self.random.gaussian(), 0.0];
                self.trial.rig.autopilot.jump(now_us, step_ned_m, false);
            }
            Kind::AutopilotRestart => self.trial.rig.autopilot.reboot(now_us, 1_500_000),
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
                    // The head of a frame with any length, and fewer bytes than that.
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
                        self.trial.rig.autopilot.companion_mode()
                    };
                    self.trial.rig.autopilot.select_mode(now_us, mode);
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
        let faults = &mut self.trial.rig.autopilot.faults;
        (faults.heartbeat_is_silent, faults.is_silent, faults.is_deaf) = (false, false, false);
        (self.trial.wire, self.trial.ownship_is_silent, self.trial.obstacles_are_silent) = (None, false, false);
        self.trial.converters = Converters::Work;
    }

    fn inject(&mut self, fault: Fault) {
        self.trial.computer.qemu.inject(fault);
    }

    /// Flips bits of the flash, or fills pages of it with random bytes.
    fn spoil(&mut self) {
        let qemu = &self.trial.computer.qemu;
        let mut flash = vec![0; STORE_BYTES];
        // If it cannot be read or written, it shows as a flash that is not damaged.
        if qemu.read_memory(&mut flash, twin::STORE_AT).is_err() {
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
        let _ = qemu.write_memory(&flash, twin::STORE_AT);
    }

    pub(super) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 50.0) as u32 {
            self.step();
        }
    }

    fn step(&mut self) {
        if self.trial.rig.collided || self.is_broken() {
            return;
        }
        if self.trial.to_source_m() < ARRIVED_M {
            // To the other place.
            let [first, second] = self.ends;
            self.trial.rig.world.source = if self.trial.rig.world.source == first { second } else { first };
        }
        let step = self.trial.step();
        if self.trial.computer.away > 0 {
            self.away_until_us = step.time_us + COAST_US;
        }
        if let Some(output) = &step.output {
            self.last = Some(output.outcome);
        }
        if step.obeyed || self.trial.rig.autopilot.faults.is_silent {
            self.obeyed_us = step.time_us;
        }
        let known_us = if self.kind == Some(Kind::LineNoise) { QUIET_US } else { HEARTBEAT_US };
        let may_move = step.time_us < self.obeyed_us + known_us;
        for setpoint in step.setpoints() {
            let speed_mps = libm::hypot(f64::from(setpoint.vx), f64::from(setpoint.vy));
            let numbers = [setpoint.vx, setpoint.vy, setpoint.vz, setpoint.yaw_rate];
            let is_inside = numbers.iter().all(|number| number.is_finite()) && speed_mps <= self.guard_mps + 1e-3;
            self.row.outside_limits += u32::from(!is_inside);
            self.row.uninvited += u32::from(!may_move && speed_mps > 0.05);
        }
        for (_, message) in &step.sent {
            if let MavMessage::STATUSTEXT(text) = message
                && let Ok(text) = text.text.to_str()
                && let Some((_, why)) = text.strip_prefix("Foxhound: restart").and_then(|text| text.split_once(": "))
            {
                let words = self.kind.and_then(Kind::restart_words);
                self.row.restarts_told += u32::from(words.is_none_or(|words| why.starts_with(words)));
            }
        }
        if self.trial.rig.collided {
            let is_away = step.time_us < self.away_until_us;
            self.row.collisions_away += u32::from(is_away);
            self.row.collisions += u32::from(!is_away);
        }
    }
}

/// The firmware, which is absent for a while after a restart.
pub(super) struct Twin {
    pub(super) qemu: QemuComputer,
    setup: Setup,
    /// Steps until it is back.
    away: u32,
    restarts: u32,
    /// Set when it does not answer any more.
    pub(super) broken: Option<QemuError>,
    /// Late steps, through all restarts.
    late_steps: u32,
}

impl Twin {
    pub(super) const fn new(qemu: QemuComputer, setup: Setup) -> Self {
        Self { qemu, setup, away: 0, restarts: 0, broken: None, late_steps: 0 }
    }
}

impl Computer for Twin {
    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        if self.away > 0 {
            return Ok(());
        }
        Computer::see(&mut self.qemu, bytes)
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        if self.away > 0 {
            return Ok(());
        }
        Computer::turn(&mut self.qemu, bytes)
    }

    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        if self.away > 0 {
            self.away -= 1;
            return Err(ComputerError("the firmware restarts".to_owned()));
        }
        let late_before = self.qemu.late_steps();
        let stepped = self.qemu.step(now, front_end, circles, rx);
        self.late_steps += self.qemu.late_steps() - late_before;
        stepped.map_err(|error| {
            let text = error.to_string();
            match error {
                QemuError::Restarted => {
                    (self.away, self.restarts) = (AWAY_STEPS, self.restarts + 1);
                    // At once: otherwise it would run freely while we fly on without it.
                    self.broken = self.qemu.recover(&self.setup).err();
                }
                error => self.broken = Some(error),
            }
            ComputerError(text)
        })
    }
}
