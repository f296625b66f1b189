//! The whole companion with a modelled autopilot, step by step, with all data accessible: the true motion of the
//! vehicle, guidance's output, the messages sent, and the mode at that time.
//!
//! Unlike in [`super::flight`] nothing here ends, fails or reports by itself: the caller injects faults between the
//! steps. Waves come from the beacon's true position and obstacles are seen from the vehicle's true position,
//! whatever the autopilot reports.

use std::convert::Infallible;

use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::guidance::{self, FrontEnd, Output};
use foxhound_core::planning::planner;
use foxhound_link::MessageData;
use foxhound_link::dialect::{
    COMMAND_LONG_DATA, MavMessage, PARAM_SET_DATA, PARAM_VALUE_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};

use super::computer::{BLOCK, Computer, HostComputer};
use super::flight::Mission;
use super::rig::{Answer, Rig, TICK_S, When};
use crate::autopilot::{Autopilot, Start, Wire, asks_for_entry};
use crate::scenario::{self, FLIGHT_DOWN_M, Scenario, SensorModel, Software, VehicleModel};
use crate::world::antennas::Antennas;
use crate::world::random::Random;
use crate::world::vehicle::Motion;
use crate::world::{Horizontal, Pose};

/// Length of one step.
pub const STEP_US: u64 = 20_000;
const SNR_DB: f64 = 20.0;
const GROUND_STATION: (u8, u8) = (255, 190);
/// Our system and component.
const US: (u8, u8) = (1, 191);
const REAL32: u8 = 9;

/// Time on the clocks of both ends when the trial begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clocks {
    /// The companion's, microseconds.
    pub ours_us: u64,
    /// The autopilot's since its boot, microseconds.
    pub theirs_us: u64,
}

/// The result of one step.
#[derive(Clone, Debug)]
pub struct Step {
    /// Time since the beginning, microseconds.
    pub time_us: u64,
    /// True motion at its beginning.
    pub motion: Motion,
    /// Whether the autopilot obeyed us then: in the mode and armed.
    pub obeyed: bool,
    /// What guidance published; `None` while the computer stood still.
    pub output: Option<Output>,
    /// The messages that we sent.
    pub sent: Vec<(Header, MavMessage)>,
}

impl Step {
    /// The setpoints that we sent.
    pub fn setpoints(&self) -> impl Iterator<Item = &SET_POSITION_TARGET_LOCAL_NED_DATA> {
        self.sent.iter().filter_map(|(_, message)| match message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => Some(target),
            _ => None,
        })
    }

    /// Whether the pilot is asked to leave the mode and enter it again.
    #[must_use]
    pub fn asks_for_entry(&self) -> bool {
        self.sent.iter().any(|(_, message)| matches!(message, MavMessage::STATUSTEXT(text) if asks_for_entry(text)))
    }

    /// Seconds since the beginning.
    #[must_use]
    pub const fn time_s(&self) -> f64 {
        self.time_us as f64 * 1e-6
    }

    /// True horizontal speed.
    #[must_use]
    pub fn speed_mps(&self) -> f64 {
        let [north, east, _] = self.motion.velocity_ned_mps;
        libm::hypot(north, east)
    }

    /// True position.
    #[must_use]
    pub const fn place(&self) -> Horizontal {
        place(&self.motion)
    }
}

/// State of the antennas' converters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Converters {
    /// They work.
    #[default]
    Work,
    /// They deliver the same samples again and again.
    Freeze,
    /// They deliver nothing.
    Stop,
}

/// A flight in progress.
#[derive(Debug)]
pub struct Trial<C = HostComputer> {
    /// The vehicle, its autopilot and the world.
    pub rig: Rig,
    /// The line that the bytes of both directions pass.
    pub wire: Option<Wire>,
    /// Position and attitude are not sent.
    pub ownship_is_silent: bool,
    /// The obstacle sensor sends nothing.
    pub obstacles_are_silent: bool,
    /// The computer does nothing; its input waits.
    pub computer_stands_still: bool,
    /// State of the converters.
    pub converters: Converters,
    /// Error of our clock, microseconds.
    pub clock_off_us: i64,
    /// The computer.
    pub computer: C,
    antennas: Antennas,
    frame: AdcFrame<BLOCK>,
    random: Random,
    clocks: Clocks,
    time_us: u64,
    waiting: Vec<u8>,
    framer: Framer,
    sequence: u8,
}

impl Trial {
    /// A vehicle that hovers, or stands on the ground, at the scenario's start.
    ///
    /// # Errors
    /// The field of the configuration that is refused.
    pub fn new(
        scenario: &Scenario,
        software: Software,
        start: Start,
        clocks: Clocks,
        seed: u64,
    ) -> Result<Self, ConfigError> {
        let computer = HostComputer::new(&Self::guidance(scenario, seed))?;
        Ok(Self::with(computer, scenario, software, start, clocks, seed))
    }

    /// The configuration of a computer that flies it.
    #[must_use]
    pub fn guidance(scenario: &Scenario, seed: u64) -> guidance::Config {
        let (planner, estimator) = (planner::Config::default(), Estimator::CrossSpectrum);
        let scenario = Scenario { vehicle: vehicle(scenario, scenario.vehicle.autopilot), ..scenario.clone() };
        Mission { scenario, seed, planner, estimator }.guidance()
    }
}

impl<C: Computer> Trial<C> {
    /// The same with an existing computer.
    #[must_use]
    pub fn with(computer: C, scenario: &Scenario, software: Software, start: Start, clocks: Clocks, seed: u64) -> Self {
        let scenario = Scenario {
            vehicle: vehicle(scenario, software),
            sensor: scenario::Sensor { model: SensorModel::Scan, ..scenario.sensor },
            ..scenario.clone()
        };
        let world = scenario.world();
        let from = Horizontal::from_xy(scenario.start);
        let down_m = if start == Start::Parked { 0.0 } else { FLIGHT_DOWN_M };
        let pose = Pose {
            position_ned_m: [from.north, from.east, down_m],
            yaw_rad: world.source.minus(from).bearing_rad(),
            ..Pose::default()
        };
        Self {
            rig: Rig::new(&scenario, world, Autopilot::new(software, start), pose, 1),
            wire: None,
            ownship_is_silent: false,
            obstacles_are_silent: false,
            computer_stands_still: false,
            converters: Converters::Work,
            clock_off_us: 0,
            computer,
            frame: AdcFrame::zeroed(),
            antennas: Antennas { snr_db: Some(SNR_DB), ..Antennas::default() },
            random: Random::new(seed, 1),
            clocks,
            time_us: 0,
            waiting: Vec::new(),
            framer: Framer::new(),
            sequence: 0,
        }
    }

    /// Time since the beginning.
    #[must_use]
    pub const fn time_us(&self) -> u64 {
        self.time_us
    }

    /// Time on the clock of the autopilot's model, for calls to it.
    #[must_use]
    pub const fn autopilot_us(&self) -> u64 {
        self.clocks.theirs_us + self.time_us
    }

    /// True motion of the vehicle.
    #[must_use]
    pub const fn motion(&self) -> Motion {
        self.rig.vehicle.motion
    }

    /// Horizontal distance to the beacon.
    #[must_use]
    pub fn to_source_m(&self) -> f64 {
        self.rig.world.source.minus(place(&self.rig.vehicle.motion)).norm()
    }

    /// The least distance of the hull to a pillar so far.
    #[must_use]
    pub const fn min_clearance_m(&self) -> f64 {
        self.rig.hull.min_clearance_m
    }

    /// The pilot chooses the mode in which a companion is obeyed; false if the autopilot refuses.
    pub fn give_control(&mut self) -> bool {
        let (now_us, mode) = (self.autopilot_us(), self.rig.autopilot.companion_mode());
        self.rig.autopilot.select_mode(now_us, mode)
    }

    /// A ground station sends a message to us.
    pub fn say<D: MessageData>(&mut self, data: &D) {
        let (system_id, component_id) = GROUND_STATION;
        let header = Header { system_id, component_id, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(header, data, &mut frame);
        self.waiting.extend_from_slice(&frame[..length]);
    }

    /// Any bytes arrive on our line.
    pub fn pour(&mut self, bytes: &[u8]) {
        self.waiting.extend_from_slice(bytes);
    }

    /// A ground station commands us.
    pub fn command(&mut self, command: u16, param1: f32) {
        let (target_system, target_component) = US;
        let order =
            COMMAND_LONG_DATA { target_system, target_component, command, param1, ..COMMAND_LONG_DATA::DEFAULT };
        self.say(&order);
    }

    /// A ground station sets one of our parameters.
    pub fn set_parameter(&mut self, name: &str, value: f32) {
        let (target_system, target_component) = US;
        let wish = PARAM_SET_DATA {
            target_system,
            target_component,
            param_id: name.into(),
            param_value: value,
            param_type: REAL32,
        };
        self.say(&wish);
    }

    /// Flies for one step.
    pub fn step(&mut self) -> Step {
        let time_us = self.time_us;
        let when = When {
            tick: time_us / STEP_US,
            now_us: self.autopilot_us(),
            time_s: time_us as f64 * 1e-6,
            ownship_is_silent: self.ownship_is_silent,
            obstacles_are_silent: self.obstacles_are_silent,
        };
        let now = Instant((self.clocks.ours_us + time_us).saturating_add_signed(self.clock_off_us));
        let motion = self.motion();
        let Self {
            rig,
            wire,
            computer_stands_still,
            converters,
            computer,
            antennas,
            frame,
            random,
            waiting,
            framer,
            ..
        } = self;
        let Ok(step) = rig.step(&when, |rig, sensed| {
            let obeyed = rig.autopilot.armed && rig.autopilot.custom_mode == rig.autopilot.companion_mode();
            match wire {
                Some(wire) => waiting.extend(wire.to_companion(&sensed.rx)),
                None => waiting.extend_from_slice(&sensed.rx),
            }
            let (mut output, mut tx) = (None, Vec::new());
            if !*computer_stands_still {
                let source = [rig.world.source.north, rig.world.source.east, rig.world.source_down_m];
                if *converters == Converters::Work {
                    *frame = antennas.frame(now, &motion.pose, source, random);
                }
                // Samples are stamped when they are delivered, however old they are.
                frame.time = now;
                let front_end = match converters {
                    Converters::Stop => FrontEnd::Nothing,
                    _ => FrontEnd::Frame(frame),
                };
                if let Ok(report) = computer.step(now, front_end, None, &std::mem::take(waiting)) {
                    (output, tx) = (Some(report.output), report.tx);
                }
            }
            let sent = read(framer, &tx);
            if let Some(wire) = wire {
                tx = wire.to_autopilot(&tx);
            }
            let step = Step { time_us, motion, obeyed, output, sent };
            Ok::<_, Infallible>((Answer { tx, step_s: TICK_S }, step))
        });
        self.time_us += STEP_US;
        step
    }
}

/// The messages in the bytes that we sent.
fn read(framer: &mut Framer, bytes: &[u8]) -> Vec<(Header, MavMessage)> {
    let mut sent = Vec::new();
    framer.each(bytes, |frame| {
        if let (header, Some(message)) = (frame.header, frame.message()) {
            sent.push((header, message));
        }
    });
    sent
}

/// The value of a parameter in the messages sent, if it is there.
#[must_use]
pub fn parameter(step: &Step, name: &str) -> Option<f32> {
    step.sent.iter().find_map(|(_, message)| match message {
        MavMessage::PARAM_VALUE(PARAM_VALUE_DATA { param_id, param_value, .. }) if param_id.to_str() == Ok(name) => {
            Some(*param_value)
        }
        _ => None,
    })
}

/// The vehicle's response is that of an autopilot, and guidance is configured for it.
const fn vehicle(scenario: &Scenario, software: Software) -> scenario::Vehicle {
    scenario::Vehicle { model: VehicleModel::Arducopter, autopilot: software, ..scenario.vehicle }
}

const fn place(motion: &Motion) -> Horizontal {
    let [north, east, _] = motion.pose.position_ned_m;
    Horizontal { north, east }
}
