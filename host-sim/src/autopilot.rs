//! The autopilot's side of the link: ArduPilot Copter as a companion computer meets it.
//!
//! Its rules, as measured on ArduCopter in software-in-the-loop and documented in *Copter Commands in Guided Mode*:
//!
//! - HEARTBEAT at 1 Hz; nothing else until a companion asks with `MAV_CMD_SET_MESSAGE_INTERVAL`, which is acknowledged;
//! - `SET_POSITION_TARGET_LOCAL_NED` is obeyed in GUIDED and armed only, and dropped without a word elsewhere;
//! - one ignored axis ignores the whole vector; frames 1 and 7 are north-east-down, 8 and 9 are turned by the yaw only;
//!   what cannot be obeyed (another frame, a force, a velocity that is not finite or beyond 1000 m/s) makes it stop;
//! - the last velocity is held for `GUID_TIMEOUT`, 3 s, then it brakes and stays in GUIDED.
//!
//! Position targets and accelerations are not modelled: they stop it.

use foxhound_link::MessageData;
use foxhound_link::dialect::{
    ATTITUDE_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA,
    LOCAL_POSITION_NED_DATA, MavAutopilot, MavCmd, MavLandedState, MavMessage, MavModeFlag, MavResult, MavState,
    MavType, OBSTACLE_DISTANCE_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA, TIMESYNC_DATA,
};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};

use crate::vehicle::{Command, Motion};

/// ArduPilot Copter's number of GUIDED.
pub const GUIDED: u32 = 4;
/// How long the last velocity setpoint is held.
pub const GUID_TIMEOUT_US: u64 = 3_000_000;

const SYSTEM: u8 = 1;
const AUTOPILOT: u8 = 1;
/// The obstacle sensor's own component, whose broadcasts the autopilot forwards.
const SENSOR: u8 = 158;
const HEARTBEAT_PERIOD_US: u64 = 1_000_000;
const SPEED_MAX_MPS: f32 = 1000.0;

const BODY_FRAMES: [u8; 2] = [8, 9];
const LOCAL_FRAMES: [u8; 2] = [1, 7];
const POSITION_BITS: u16 = 0x0007;
const VELOCITY_BITS: u16 = 0x0038;
const ACCELERATION_BITS: u16 = 0x01C0;
const FORCE_BIT: u16 = 0x0200;
const YAW_RATE_BIT: u16 = 0x0800;

/// A message that streams once it was asked for.
#[derive(Clone, Copy, Debug)]
struct Stream {
    message_id: u32,
    interval_us: Option<u64>,
    due_us: u64,
}

/// The autopilot.
#[derive(Clone, Debug)]
pub struct Autopilot {
    framer: Framer,
    sequence: [u8; 2],
    streams: [Stream; 3],
    heartbeat_due_us: u64,
    /// Its mode.
    pub custom_mode: u32,
    /// Whether the motors are armed.
    pub armed: bool,
    /// The last setpoint that was obeyed, and when.
    setpoint: Option<(u64, Command)>,
    outgoing: Vec<u8>,
}

impl Default for Autopilot {
    /// In GUIDED, armed, in the air.
    fn default() -> Self {
        let off = |message_id| Stream { message_id, interval_us: None, due_us: 0 };
        Self {
            framer: Framer::new(),
            sequence: [0; 2],
            streams: [LOCAL_POSITION_NED_DATA::ID, ATTITUDE_DATA::ID, EXTENDED_SYS_STATE_DATA::ID].map(off),
            heartbeat_due_us: 0,
            custom_mode: GUIDED,
            armed: true,
            setpoint: None,
            outgoing: Vec::new(),
        }
    }
}

impl Autopilot {
    /// Says what is due. While `ownship_is_silent`, position and attitude are not.
    pub fn telemetry(&mut self, now_us: u64, motion: &Motion, ownship_is_silent: bool) {
        if now_us >= self.heartbeat_due_us {
            self.heartbeat_due_us += HEARTBEAT_PERIOD_US;
            self.send(AUTOPILOT, &self.heartbeat());
        }
        for index in 0..self.streams.len() {
            let stream = &mut self.streams[index];
            let Some(interval_us) = stream.interval_us.filter(|_| now_us >= stream.due_us) else { continue };
            // A step may be a microsecond or two short of the interval.
            stream.due_us = (stream.due_us + interval_us).max(now_us + interval_us / 2);
            match stream.message_id {
                LOCAL_POSITION_NED_DATA::ID if !ownship_is_silent => self.send(AUTOPILOT, &position(now_us, motion)),
                ATTITUDE_DATA::ID if !ownship_is_silent => self.send(AUTOPILOT, &attitude(now_us, motion)),
                EXTENDED_SYS_STATE_DATA::ID => {
                    let landed_state = MavLandedState::MAV_LANDED_STATE_IN_AIR as u8;
                    self.send(AUTOPILOT, &EXTENDED_SYS_STATE_DATA { vtol_state: 0, landed_state });
                }
                _ => {}
            }
        }
    }

    /// Forwards what the obstacle sensor broadcasts.
    pub fn forward(&mut self, scan: &OBSTACLE_DISTANCE_DATA) {
        self.send(SENSOR, scan);
    }

    /// The bytes that were said since the last call.
    pub fn transmit(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.outgoing)
    }

    /// Takes in bytes from the companion.
    pub fn receive(&mut self, now_us: u64, motion: &Motion, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let taken = self.framer.push(bytes);
            bytes = &bytes[taken..];
            while let Some((header, message)) = self.framer.next_frame().map(|frame| (frame.header, frame.message())) {
                match message {
                    Some(MavMessage::COMMAND_LONG(command)) => self.obey_command(now_us, header, &command),
                    Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) => {
                        self.obey_target(now_us, motion, &target);
                    }
                    Some(MavMessage::TIMESYNC(request)) if request.tc1 == 0 => {
                        let tc1 = (now_us * 1000) as i64;
                        let target = (header.system_id, header.component_id);
                        let (target_system, target_component) = target;
                        self.send(AUTOPILOT, &TIMESYNC_DATA { tc1, ts1: request.ts1, target_system, target_component });
                    }
                    _ => {}
                }
            }
        }
    }

    /// What the vehicle is to do now.
    #[must_use]
    pub fn command(&self, now_us: u64) -> Command {
        let brake = Command { is_brake: true, ..Command::default() };
        match self.setpoint {
            Some((since_us, command)) if self.obeys() && now_us.saturating_sub(since_us) < GUID_TIMEOUT_US => command,
            _ => brake,
        }
    }

    fn obeys(&self) -> bool {
        self.custom_mode == GUIDED && self.armed
    }

    fn heartbeat(&self) -> HEARTBEAT_DATA {
        let armed = if self.armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED as u8 } else { 0 };
        HEARTBEAT_DATA {
            custom_mode: self.custom_mode,
            mavtype: MavType::MAV_TYPE_QUADROTOR as u8,
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA as u8,
            base_mode: armed | MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED as u8,
            system_status: MavState::MAV_STATE_ACTIVE as u8,
            mavlink_version: 3,
        }
    }

    fn send<D: MessageData>(&mut self, component_id: u8, data: &D) {
        let sequence = &mut self.sequence[usize::from(component_id == SENSOR)];
        let header = Header { system_id: SYSTEM, component_id, sequence: *sequence };
        *sequence = sequence.wrapping_add(1);
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(header, data, &mut frame);
        self.outgoing.extend_from_slice(&frame[..length]);
    }

    fn obey_command(&mut self, now_us: u64, from: Header, command: &COMMAND_LONG_DATA) {
        if !is_for_us(command.target_system, command.target_component) {
            return;
        }
        let result = if command.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16 {
            let wanted = command.param1 as u32;
            match self.streams.iter_mut().find(|stream| stream.message_id == wanted) {
                Some(stream) => {
                    stream.interval_us = (command.param2 > 0.0).then_some(command.param2 as u64);
                    stream.due_us = now_us;
                    MavResult::MAV_RESULT_ACCEPTED
                }
                // It has no stream of the obstacle sensor's messages to speed up, and says so.
                None => MavResult::MAV_RESULT_FAILED,
            }
        } else {
            MavResult::MAV_RESULT_UNSUPPORTED
        };
        let acknowledgement = COMMAND_ACK_DATA {
            command: command.command,
            result: result as u8,
            target_system: from.system_id,
            target_component: from.component_id,
            ..COMMAND_ACK_DATA::default()
        };
        self.send(AUTOPILOT, &acknowledgement);
    }

    fn obey_target(&mut self, now_us: u64, motion: &Motion, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        if is_for_us(target.target_system, target.target_component) && self.obeys() {
            self.setpoint = velocity_command(target, motion).map(|command| (now_us, command));
        }
    }
}

fn is_for_us(system: u8, component: u8) -> bool {
    matches!(system, 0 | SYSTEM) && matches!(component, 0 | AUTOPILOT)
}

/// The velocity that a target asks for; `None` where it makes the vehicle stop.
fn velocity_command(target: &SET_POSITION_TARGET_LOCAL_NED_DATA, motion: &Motion) -> Option<Command> {
    let mask = target.type_mask;
    let only_velocity = mask & VELOCITY_BITS == 0 && mask & POSITION_BITS != 0 && mask & ACCELERATION_BITS != 0;
    let velocity = [target.vx, target.vy, target.vz];
    let is_sane = velocity.iter().all(|v| v.abs() <= SPEED_MAX_MPS) && target.yaw_rate.is_finite();
    if mask & FORCE_BIT != 0 || !only_velocity || !is_sane {
        return None;
    }
    let [x, y, z] = velocity.map(f64::from);
    let yaw_rad = motion.pose.yaw_rad;
    let velocity_ned_mps = match target.coordinate_frame {
        frame if LOCAL_FRAMES.contains(&frame) => [x, y, z],
        frame if BODY_FRAMES.contains(&frame) => {
            let (sine, cosine) = (libm::sin(yaw_rad), libm::cos(yaw_rad));
            [x * cosine - y * sine, x * sine + y * cosine, z]
        }
        _ => return None,
    };
    let yaw_rate_radps = if mask & YAW_RATE_BIT == 0 { f64::from(target.yaw_rate) } else { 0.0 };
    Some(Command { velocity_ned_mps, yaw_rate_radps, is_brake: false })
}

fn position(now_us: u64, motion: &Motion) -> LOCAL_POSITION_NED_DATA {
    let [x, y, z] = motion.pose.position_ned_m.map(|x| x as f32);
    let [vx, vy, vz] = motion.velocity_ned_mps.map(|v| v as f32);
    LOCAL_POSITION_NED_DATA { time_boot_ms: (now_us / 1000) as u32, x, y, z, vx, vy, vz }
}

fn attitude(now_us: u64, motion: &Motion) -> ATTITUDE_DATA {
    ATTITUDE_DATA {
        time_boot_ms: (now_us / 1000) as u32,
        roll: motion.pose.roll_rad as f32,
        pitch: motion.pose.pitch_rad as f32,
        yaw: motion.pose.yaw_rad as f32,
        yawspeed: motion.yaw_rate_radps as f32,
        ..ATTITUDE_DATA::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes<D: MessageData>(data: &D) -> Vec<u8> {
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(Header { system_id: 1, component_id: 191, sequence: 0 }, data, &mut frame);
        frame[..length].to_vec()
    }

    fn target(type_mask: u16, coordinate_frame: u8) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
        SET_POSITION_TARGET_LOCAL_NED_DATA {
            vx: 1.0,
            vy: 2.0,
            vz: -0.5,
            yaw_rate: 0.25,
            type_mask,
            target_system: 1,
            target_component: 1,
            coordinate_frame,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
        }
    }

    fn obey(autopilot: &mut Autopilot, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> Command {
        let mut motion = Motion::default();
        motion.pose.yaw_rad = std::f64::consts::FRAC_PI_2;
        autopilot.receive(0, &motion, &bytes(target));
        autopilot.command(0)
    }

    fn heard(autopilot: &mut Autopilot) -> Vec<u32> {
        let bytes = autopilot.transmit();
        crate::tlog::read_raw(&bytes).counts.into_iter().flat_map(|(id, n)| vec![id; n as usize]).collect()
    }

    #[test]
    fn only_heartbeats_come_until_a_message_is_asked_for() {
        let mut autopilot = Autopilot::default();
        for tick in 0..100 {
            autopilot.telemetry(tick * 20_000, &Motion::default(), false);
        }
        assert_eq!(heard(&mut autopilot), [0, 0]);
        let ask = COMMAND_LONG_DATA {
            param1: 32.0,
            param2: 20_000.0,
            command: 511,
            target_system: 1,
            target_component: 1,
            ..COMMAND_LONG_DATA::default()
        };
        autopilot.receive(2_000_000, &Motion::default(), &bytes(&ask));
        assert_eq!(heard(&mut autopilot), [77], "acknowledged");
        for tick in 100..150 {
            autopilot.telemetry(tick * 20_000, &Motion::default(), false);
        }
        assert_eq!(heard(&mut autopilot).iter().filter(|id| **id == 32).count(), 50);
        autopilot.telemetry(3_000_000, &Motion::default(), true);
        assert!(!heard(&mut autopilot).contains(&32), "a silent position is silent");
    }

    #[test]
    fn a_velocity_is_obeyed_in_guided_and_armed_only() {
        let velocity = [1.0, 2.0, -0.5];
        let mut autopilot = Autopilot::default();
        let command = obey(&mut autopilot, &target(0x05C7, 1));
        assert_eq!((command.velocity_ned_mps, command.yaw_rate_radps, command.is_brake), (velocity, 0.25, false));
        for (custom_mode, armed) in [(5, true), (GUIDED, false)] {
            let mut autopilot = Autopilot { custom_mode, armed, ..Autopilot::default() };
            assert!(obey(&mut autopilot, &target(0x05C7, 1)).is_brake);
            autopilot.custom_mode = GUIDED;
            autopilot.armed = true;
            assert!(autopilot.command(0).is_brake, "what came outside the mode is not kept");
        }
        let mut other = target(0x05C7, 1);
        other.target_system = 2;
        assert!(obey(&mut Autopilot::default(), &other).is_brake);
    }

    #[test]
    fn the_last_velocity_is_held_for_three_seconds() {
        let mut autopilot = Autopilot::default();
        obey(&mut autopilot, &target(0x05C7, 1));
        assert!(!autopilot.command(2_999_999).is_brake);
        assert!(autopilot.command(3_000_000).is_brake);
    }

    #[test]
    fn what_cannot_be_obeyed_stops_the_vehicle() {
        let mut not_finite = target(0x05C7, 1);
        not_finite.vy = f32::NAN;
        for bad in
            [target(0x05CF, 1), target(0x0FFF, 1), target(0x07C7, 1), target(0x05C0, 1), target(0x05C7, 12), not_finite]
        {
            let mut autopilot = Autopilot::default();
            obey(&mut autopilot, &target(0x05C7, 1));
            assert!(obey(&mut autopilot, &bad).is_brake, "mask {:#06x} frame {}", bad.type_mask, bad.coordinate_frame);
        }
    }

    #[test]
    fn body_frames_are_turned_by_the_yaw() {
        let command = obey(&mut Autopilot::default(), &target(0x05C7, 8));
        let [north, east, down] = command.velocity_ned_mps;
        assert!((north + 2.0).abs() < 1e-9 && (east - 1.0).abs() < 1e-9 && down == -0.5);
    }

    #[test]
    fn without_yaw_rate_the_nose_stays() {
        assert_eq!(obey(&mut Autopilot::default(), &target(0x0DC7, 1)).yaw_rate_radps, 0.0);
    }
}
