//! The rules of both models, one test each.

mod arducopter;
mod faults;
mod link;
mod px4;

use foxhound_link::MessageData;
use foxhound_link::dialect::{COMMAND_LONG_DATA, MavMessage, SET_POSITION_TARGET_LOCAL_NED_DATA};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};

use super::{Autopilot, Start};
use crate::scenario::{self, VehicleModel};
use crate::world::Pose;
use crate::world::vehicle::{Command, Motion, Vehicle};

const COMPANION: Header = Header { system_id: 1, component_id: 191, sequence: 0 };
const TICK_US: u64 = 20_000;

fn bytes<D: MessageData>(data: &D) -> Vec<u8> {
    let mut frame = [0; FRAME_MAX];
    let length = encode_data(COMPANION, data, &mut frame);
    frame[..length].to_vec()
}

/// A setpoint with something in every field.
fn target(type_mask: u16, coordinate_frame: u8) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    SET_POSITION_TARGET_LOCAL_NED_DATA {
        x: 3.0,
        y: 4.0,
        z: -6.0,
        vx: 1.0,
        vy: 2.0,
        vz: -0.5,
        afx: 0.5,
        afy: -0.25,
        afz: -0.125,
        yaw: 0.5,
        yaw_rate: 0.25,
        type_mask,
        target_system: 1,
        target_component: 1,
        coordinate_frame,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    }
}

fn command(command: u16, parameters: [f32; 7]) -> COMMAND_LONG_DATA {
    let [param1, param2, param3, param4, param5, param6, param7] = parameters;
    COMMAND_LONG_DATA {
        param1,
        param2,
        param3,
        param4,
        param5,
        param6,
        param7,
        command,
        target_system: 1,
        target_component: 1,
        confirmation: 0,
    }
}

/// At a place, at rest, with the nose to the east.
fn eastward(position_ned_m: [f64; 3]) -> Motion {
    let pose = Pose { position_ned_m, yaw_rad: std::f64::consts::FRAC_PI_2, ..Pose::default() };
    Motion { pose, ..Motion::default() }
}

const PLACE: [f64; 3] = [1.0, 2.0, -5.0];

/// What the vehicle is told right after a setpoint.
fn obey(autopilot: &mut Autopilot, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> Command {
    autopilot.receive(0, &eastward(PLACE), &bytes(target));
    autopilot.command(0)
}

/// Everything that was said since the last call.
fn heard(autopilot: &mut Autopilot) -> Vec<(Header, MavMessage)> {
    let bytes = autopilot.transmit();
    let (mut framer, mut messages) = (Framer::new(), Vec::new());
    framer.each(&bytes, |frame| messages.push((frame.header, frame.message().unwrap())));
    messages
}

fn heard_ids(autopilot: &mut Autopilot) -> Vec<u32> {
    use foxhound_link::Message as _;
    heard(autopilot).iter().map(|(_, message)| message.message_id()).collect()
}

/// The results of the commands that were answered.
fn results(autopilot: &mut Autopilot) -> Vec<u8> {
    let result = |(_, message): (_, MavMessage)| match message {
        MavMessage::COMMAND_ACK(acknowledgement) => Some(acknowledgement.result),
        _ => None,
    };
    heard(autopilot).into_iter().filter_map(result).collect()
}

fn texts(autopilot: &mut Autopilot) -> Vec<String> {
    let text = |(_, message): (_, MavMessage)| match message {
        MavMessage::STATUSTEXT(text) => Some(text.text.to_str().unwrap().to_owned()),
        _ => None,
    };
    heard(autopilot).into_iter().filter_map(text).collect()
}

/// An autopilot and its vehicle.
struct Flown {
    autopilot: Autopilot,
    vehicle: Vehicle,
    tick: u64,
}

impl Flown {
    fn new(autopilot: Autopilot, start: Start) -> Self {
        let down_m = if start == Start::Parked { 0.0 } else { -5.0 };
        let pose = Pose { position_ned_m: [0.0, 0.0, down_m], ..Pose::default() };
        let config = scenario::Vehicle { model: VehicleModel::Point, ..scenario::Vehicle::default() };
        Self { autopilot, vehicle: Vehicle::new(config, 4.0, pose), tick: 0 }
    }

    fn now_us(&self) -> u64 {
        self.tick * TICK_US
    }

    /// Flies on; `said` gives what the companion sends at a time.
    fn fly(&mut self, seconds: f64, mut said: impl FnMut(u64) -> Vec<u8>) {
        for _ in 0..(seconds * 50.0).round() as u64 {
            let now_us = self.now_us();
            self.autopilot.telemetry(now_us, &self.vehicle.motion, false);
            self.autopilot.receive(now_us, &self.vehicle.motion, &said(now_us));
            self.vehicle.step(self.autopilot.command(now_us), 0.02);
            self.tick += 1;
        }
    }

    fn idle(&mut self, seconds: f64) {
        self.fly(seconds, |_| Vec::new());
    }

    /// Sends a command now and gives the result.
    fn order(&mut self, order: &COMMAND_LONG_DATA) -> u8 {
        self.autopilot.transmit();
        self.autopilot.receive(self.now_us(), &self.vehicle.motion, &bytes(order));
        let results = results(&mut self.autopilot);
        assert_eq!(results.len(), 1, "one answer to one command");
        results[0]
    }

    fn place(&self) -> [f64; 3] {
        self.vehicle.motion.pose.position_ned_m
    }

    fn speed_mps(&self) -> f64 {
        self.vehicle.motion.velocity_ned_mps.iter().map(|v| v * v).sum::<f64>().sqrt()
    }
}
