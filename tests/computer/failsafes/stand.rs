//! A flight towards the beacon past some pillars, with a fault, and its requirements.

use foxhound_link::dialect::{MavMessage, SET_POSITION_TARGET_LOCAL_NED_DATA};
use foxhound_sim::autopilot::Start;
use foxhound_sim::drive::soak::course;
use foxhound_sim::drive::trial::{Clocks, Step, Trial};
use foxhound_sim::scenario::Software;

pub(crate) use foxhound_sim::drive::soak::manual_mode as manual;

pub(crate) const BOTH: [Software; 2] = [Software::ArduCopter, Software::Px4];
/// A vehicle slower than this stands.
pub(crate) const STANDS_MPS: f64 = 0.15;
/// From a setpoint of zero to standing, at 1 m/s: 0.05 s to the next setpoint, 0.22 s of dead time, and 1.09 s of a
/// critically damped second order of 3.1 rad/s to 15 %; and how far it gets: 0.27 m, and 2/3.1 m.
pub(crate) const BRAKES_S: f64 = 1.5;
pub(crate) const BRAKES_M: f64 = 1.0;
/// Nearer than this the vehicle is there.
const THERE_M: f64 = 1.0;
/// What a companion may ask of an autopilot: `SET_MESSAGE_INTERVAL`.
const ALLOWED_COMMAND: u16 = 511;

/// Which of the setpoints there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stream {
    Silent,
    Zero,
    Moving,
}

/// No motion: less than a millimetre a second, with which the guard may still be leaving an obstacle's margin.
pub(crate) fn is_zero(setpoint: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> bool {
    [setpoint.vx, setpoint.vy, setpoint.vz, setpoint.yaw_rate].iter().all(|rate| rate.abs() < 1e-3)
}

/// A trial and all its steps.
pub(crate) struct Stand {
    pub(crate) trial: Trial,
    pub(crate) steps: Vec<Step>,
    pub(crate) software: Software,
}

impl Stand {
    pub(crate) fn new(software: Software, start: Start) -> Self {
        Self::with(software, start, Clocks::default(), 1)
    }

    pub(crate) fn with(software: Software, start: Start, clocks: Clocks, seed: u64) -> Self {
        Self::of(Trial::new(&course(), software, start, clocks, seed).unwrap())
    }

    pub(crate) fn of(trial: Trial) -> Self {
        let software = trial.rig.autopilot.software();
        Self { trial, steps: Vec::new(), software }
    }

    /// In control after two seconds, and under way at full speed between the first pillars.
    pub(crate) fn under_way(software: Software) -> Self {
        let mut stand = Self::new(software, Start::Hovering);
        stand.run(2.0);
        stand.get_under_way();
        stand
    }

    pub(crate) fn get_under_way(&mut self) {
        assert!(self.trial.give_control(), "the autopilot lets its pilot give control");
        self.fly_past(7.5);
    }

    /// Until the vehicle is farther north than that, and fast.
    pub(crate) fn fly_past(&mut self, north_m: f64) {
        for _ in 0..3000 {
            self.step();
            let motion = self.trial.motion();
            if motion.pose.position_ned_m[0] > north_m && motion.velocity_ned_mps[0] > 0.8 {
                return;
            }
        }
        panic!("{:?} does not fly: {:?}", self.software, self.trial.motion());
    }

    pub(crate) fn step(&mut self) -> &Step {
        let step = self.trial.step();
        assert!(!self.trial.rig.collided, "{:?} at {} s", self.software, step.time_s());
        for (header, message) in &step.sent {
            assert_eq!((header.system_id, header.component_id), (1, 191));
            let is_allowed = match message {
                MavMessage::COMMAND_LONG(command) => command.command == ALLOWED_COMMAND,
                MavMessage::COMMAND_INT(_) | MavMessage::REQUEST_DATA_STREAM(_) | MavMessage::PARAM_SET(_) => false,
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => {
                    (target.target_system, target.coordinate_frame, target.type_mask) == (1, 1, 0x05C7)
                }
                _ => true,
            };
            assert!(is_allowed, "{message:?}");
        }
        self.steps.push(step);
        &self.steps[self.steps.len() - 1]
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 50.0).round() as u32 {
            self.step();
        }
    }

    /// What is streamed during the next while: the same all the time, and at 20 Hz.
    pub(crate) fn expect(&mut self, seconds: f64, stream: Stream, why: &str) {
        let from = self.steps.len();
        self.run(seconds);
        let setpoints: Vec<_> = self.steps[from..].iter().flat_map(Step::setpoints).collect();
        let moving = setpoints.iter().filter(|setpoint| !is_zero(setpoint)).count();
        let at_s = self.trial.time_us() as f64 * 1e-6;
        let seen = match (setpoints.len(), moving) {
            (0, _) => Stream::Silent,
            (_, 0) => Stream::Zero,
            _ => Stream::Moving,
        };
        assert_eq!(seen, stream, "{why}, {:?}, until {at_s} s: {moving} of {}", self.software, setpoints.len());
        if stream != Stream::Silent {
            assert!((setpoints.len() as f64 - 20.0 * seconds).abs() <= 1.0, "{why}: {} setpoints", setpoints.len());
        }
    }

    /// Requires that the vehicle stops within a time and a distance from now, and stays there until `until_s`.
    pub(crate) fn expect_stand(&mut self, within_s: f64, way_m: f64, until_s: f64, why: &str) {
        let from = self.steps.len();
        self.run(until_s);
        let steps = &self.steps[from..];
        let begin = steps[0].place();
        let last_fast = steps.iter().rposition(|step| step.speed_mps() >= STANDS_MPS);
        let stood_s = last_fast.map_or(0.0, |index| (index + 1) as f64 * 0.02);
        let moved_m = steps.iter().map(|step| step.place().minus(begin).norm()).fold(0.0, f64::max);
        assert!(stood_s <= within_s, "{why}, {:?}: stands after {stood_s} s only", self.software);
        assert!(moved_m <= way_m, "{why}, {:?}: moves {moved_m} m", self.software);
    }

    /// The autopilot's verdict on each recent setpoint.
    pub(crate) fn stream_now(&self) -> Stream {
        let recent = &self.steps[self.steps.len() - 25..];
        let setpoints: Vec<_> = recent.iter().flat_map(Step::setpoints).collect();
        match setpoints.iter().all(|setpoint| is_zero(setpoint)) {
            _ if setpoints.is_empty() => Stream::Silent,
            true => Stream::Zero,
            false => Stream::Moving,
        }
    }

    /// The states in our heartbeats from a step on.
    pub(crate) fn statuses(&self, from: usize) -> Vec<u8> {
        let sent = self.steps[from..].iter().flat_map(|step| &step.sent);
        sent.filter_map(|(_, message)| match message {
            MavMessage::HEARTBEAT(heartbeat) => Some(heartbeat.system_status),
            _ => None,
        })
        .collect()
    }

    /// The state in our last heartbeat; none in the last 1.1 s.
    pub(crate) fn status(&self) -> Option<u8> {
        self.statuses(self.steps.len().saturating_sub(55)).last().copied()
    }

    /// The pilot leaves the mode for a second and a half and enters it again.
    pub(crate) fn enter_afresh(&mut self) {
        let now_us = self.trial.autopilot_us();
        assert!(self.trial.rig.autopilot.select_mode(now_us, manual(self.software)));
        self.run(1.5);
        assert!(self.trial.give_control(), "{:?} lets its pilot give control again", self.software);
    }

    /// It flies to the beacon.
    pub(crate) fn expect_beacon(&mut self, why: &str) {
        for _ in 0..60 * 50 {
            if self.trial.to_source_m() < THERE_M {
                return;
            }
            self.step();
        }
        let (motion, outcome) = (self.trial.motion(), self.steps.last().and_then(|step| step.output));
        let outcome = outcome.map(|output| output.outcome);
        panic!("{why}, {:?}: {motion:?} {outcome:?} {:?}", self.software, self.stream_now());
    }
}
