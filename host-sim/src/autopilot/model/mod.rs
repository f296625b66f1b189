//! The autopilot's side of the link, as a companion computer sees it: ArduPilot Copter or PX4.
//!
//! Each rule is marked with its origin: \[run\] measured on ArduCopter in software-in-the-loop, \[src\] read in the
//! project's source or documentation, \[issue\] from its issue tracker, \[mem\] general knowledge that was not
//! verified, \[inf\] inferred from the source. A model is no proof: anything that depends on a rule of the last two
//! kinds has to be tried on a real autopilot.
//!
//! | | [ArduCopter](arducopter) | [PX4](px4) |
//! |---|---|---|
//! | obeys setpoints in | GUIDED, armed, not landed | OFFBOARD, armed |
//! | enters that mode | always | with a stream of setpoints fresher than `COM_OF_LOSS_T` |
//! | setpoints other than Foxhound's | stop it | are refused |
//! | the stream ends | brakes after `GUID_TIMEOUT`, stays | Hold after `COM_OF_LOSS_T`, then `COM_OBL_RC_ACT` |
//! | streams without request | heartbeats | many |
//!
//! Setpoints are those of a Foxhound companion: frame 1 with a velocity, and a yaw rate (mask 0x05C7) or a yaw (0x09C7). The real autopilots
//! obey other frames and masks, too; their target is not read back.
//!
//! The vehicle itself is [`crate::world::vehicle`]; [`Autopilot::command`] is its command. Not modelled: missions
//! (AUTO holds), sticks (manual modes hold), obstacle avoidance, falling (a vehicle disarmed in the air stays there),
//! and the limits of the autopilot's own speed controllers beyond a speed for its own flight.

pub mod arducopter;
mod commands;
mod faults;
mod flight;
mod messages;
mod parameters;
mod proximity;
pub mod px4;
mod streams;
#[cfg(test)]
mod tests;
mod wire;

use foxhound_link::MessageData;
use foxhound_link::dialect::{
    DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavSeverity, MavType,
    OBSTACLE_DISTANCE_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode, encode_data};

use crate::scenario::Software;
use crate::world::vehicle::Motion;

pub use arducopter::GUIDED;
pub use faults::{Battery, Faults};
pub use proximity::{Proximity, Told};
pub use wire::Wire;

use flight::Flight;
use parameters::Parameters;
use streams::Streams;

const SYSTEM: u8 = 1;
const AUTOPILOT: u8 = 1;
/// The obstacle sensor's own component, whose broadcasts the autopilot forwards.
const SENSOR: u8 = 158;
/// 1 Hz on both \[src: devguide heartbeat.md\].
const HEARTBEAT_PERIOD_US: u64 = 1_000_000;

/// State of a model at the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Start {
    /// Armed, in the air, in GUIDED or OFFBOARD.
    #[default]
    InControl,
    /// Armed, in the air, in LOITER or Hold.
    Hovering,
    /// Disarmed, on the ground, in STABILIZE or Hold.
    Parked,
}

/// The autopilot.
#[derive(Clone, Debug)]
pub struct Autopilot {
    software: Software,
    /// Its mode, in its own numbers. Writing it changes the mode without a check.
    pub custom_mode: u32,
    /// Whether the motors are armed.
    pub armed: bool,
    /// Injected faults.
    pub faults: Faults,
    /// Its own proximity sensor, if it has one.
    pub proximity: Option<Proximity>,
    parameters: Parameters,
    streams: Streams,
    flight: Flight,
    framer: Framer,
    /// Of the autopilot, the obstacle sensor, another autopilot.
    sequences: [u8; 3],
    booted_us: u64,
    awake_us: u64,
    is_booting: bool,
    heartbeat_due_us: u64,
    timesync_due_us: u64,
    outgoing: Vec<u8>,
}

impl Default for Autopilot {
    /// ArduCopter in GUIDED, armed, in the air.
    fn default() -> Self {
        Self::new(Software::ArduCopter, Start::InControl)
    }
}

impl Autopilot {
    /// A model that begins now, at time zero.
    #[must_use]
    pub fn new(software: Software, start: Start) -> Self {
        let custom_mode = match (software, start) {
            (Software::ArduCopter, Start::InControl) => arducopter::GUIDED,
            (Software::ArduCopter, Start::Hovering) => arducopter::LOITER,
            (Software::ArduCopter, Start::Parked) => arducopter::STABILIZE,
            (Software::Px4, Start::InControl) => px4::OFFBOARD,
            (Software::Px4, Start::Hovering | Start::Parked) => px4::HOLD,
        };
        Self {
            software,
            custom_mode,
            armed: start != Start::Parked,
            faults: Faults::default(),
            proximity: None,
            parameters: Parameters::of(software),
            streams: Streams::of(software),
            flight: Flight::new(start == Start::Parked),
            framer: Framer::new(),
            sequences: [0; 3],
            booted_us: 0,
            awake_us: 0,
            is_booting: false,
            heartbeat_due_us: 0,
            timesync_due_us: streams::TIMESYNC_FIRST_US,
            outgoing: Vec::new(),
        }
    }

    /// Its software.
    #[must_use]
    pub const fn software(&self) -> Software {
        self.software
    }

    /// The mode in which this software obeys a companion.
    #[must_use]
    pub const fn companion_mode(&self) -> u32 {
        match self.software {
            Software::ArduCopter => arducopter::GUIDED,
            Software::Px4 => px4::OFFBOARD,
        }
    }

    /// Sends what is due. While `ownship_is_silent`, position and attitude are not sent.
    pub fn telemetry(&mut self, now_us: u64, motion: &Motion, ownship_is_silent: bool) {
        self.advance(now_us, motion);
        if self.is_booting || self.faults.is_silent {
            return;
        }
        if now_us >= self.heartbeat_due_us {
            self.heartbeat_due_us = (self.heartbeat_due_us + HEARTBEAT_PERIOD_US).max(now_us + HEARTBEAT_PERIOD_US / 2);
            if !self.faults.heartbeat_is_silent {
                self.send(AUTOPILOT, &self.heartbeat());
            }
            self.other_heartbeat();
        }
        self.ask_for_time(now_us);
        self.tell_proximity(now_us, motion);
        for index in 0..self.streams.len() {
            let Some(message_id) = self.streams.take_due(index, now_us) else { continue };
            if !(ownship_is_silent && messages::is_ownship(message_id)) {
                self.say(now_us, message_id);
            }
        }
    }

    /// Forwards what the obstacle sensor broadcasts.
    pub fn forward(&mut self, scan: &OBSTACLE_DISTANCE_DATA) {
        self.send(SENSOR, scan);
    }

    /// Sends a reading of its range finder.
    pub fn find_range(&mut self, range: &DISTANCE_SENSOR_DATA) {
        self.send(AUTOPILOT, range);
    }

    /// The bytes sent since the last call.
    pub fn transmit(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.outgoing)
    }

    /// Receives bytes from the companion.
    pub fn receive(&mut self, now_us: u64, motion: &Motion, mut bytes: &[u8]) {
        self.advance(now_us, motion);
        if self.is_booting || self.faults.is_deaf {
            return;
        }
        while !bytes.is_empty() {
            let taken = self.framer.push(bytes);
            bytes = &bytes[taken..];
            while let Some(frame) = self.framer.next_frame() {
                if !self.faults.lets_through(&frame) {
                    continue;
                }
                if let (header, Some(message)) = (frame.header, frame.message()) {
                    self.obey(now_us, header, &message);
                }
            }
        }
    }

    fn obey(&mut self, now_us: u64, from: Header, message: &MavMessage) {
        match message {
            MavMessage::COMMAND_LONG(command) => self.obey_command(now_us, from, command),
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => self.obey_target(now_us, target),
            MavMessage::REQUEST_DATA_STREAM(request) => self.obey_stream_request(now_us, request),
            MavMessage::PARAM_REQUEST_READ(request) => self.obey_parameter_request(request),
            MavMessage::PARAM_REQUEST_LIST(request) => self.obey_parameter_list_request(request),
            MavMessage::PARAM_SET(wish) => self.obey_parameter_wish(wish),
            MavMessage::TIMESYNC(request) if request.tc1 == 0 => {
                let answer = TIMESYNC_DATA {
                    tc1: self.boot_ns(now_us),
                    ts1: request.ts1,
                    target_system: from.system_id,
                    target_component: from.component_id,
                };
                self.send(AUTOPILOT, &answer);
            }
            _ => {}
        }
    }

    /// Messages for others are ignored \[src, both\].
    fn obey_target(&mut self, now_us: u64, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        if !is_for_us(target.target_system, target.target_component) {
            return;
        }
        match self.software {
            Software::ArduCopter => self.arducopter_target(now_us, target),
            Software::Px4 => self.px4_target(now_us, target),
        }
    }

    fn heartbeat(&self) -> HEARTBEAT_DATA {
        let (autopilot, status) = match self.software {
            Software::ArduCopter => (MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, self.arducopter_status()),
            Software::Px4 => (MavAutopilot::MAV_AUTOPILOT_PX4, self.px4_status()),
        };
        let armed = if self.armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED as u8 } else { 0 };
        HEARTBEAT_DATA {
            custom_mode: self.custom_mode,
            mavtype: MavType::MAV_TYPE_QUADROTOR as u8,
            autopilot: autopilot as u8,
            base_mode: armed | MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED as u8,
            system_status: status as u8,
            mavlink_version: 3,
        }
    }

    fn text(&mut self, severity: MavSeverity, text: &str) {
        self.send(AUTOPILOT, &STATUSTEXT_DATA { severity: severity as u8, text: text.into(), ..Default::default() });
    }

    /// Time since its boot.
    fn boot_us(&self, now_us: u64) -> u64 {
        now_us.saturating_sub(self.booted_us)
    }

    fn boot_ms(&self, now_us: u64) -> u32 {
        (self.boot_us(now_us) / 1000) as u32
    }

    fn boot_ns(&self, now_us: u64) -> i64 {
        (self.boot_us(now_us) * 1000) as i64
    }

    fn send<D: MessageData>(&mut self, component_id: u8, data: &D) {
        let header = self.header(component_id);
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(header, data, &mut frame);
        self.emit(&frame[..length]);
    }

    /// Sends a message once, if it exists now.
    fn say(&mut self, now_us: u64, message_id: u32) -> bool {
        let Some(message) = self.message(now_us, message_id) else { return false };
        let header = self.header(AUTOPILOT);
        let mut frame = [0; FRAME_MAX];
        let length = encode(header, &message, &mut frame);
        self.emit(&frame[..length]);
        true
    }

    fn emit(&mut self, frame: &[u8]) {
        if !self.is_booting && !self.faults.is_silent {
            self.outgoing.extend_from_slice(frame);
        }
    }

    fn header(&mut self, component_id: u8) -> Header {
        let sequence = &mut self.sequences[usize::from(component_id == SENSOR)];
        let header = Header { system_id: SYSTEM, component_id, sequence: *sequence };
        *sequence = sequence.wrapping_add(1);
        header
    }
}

fn is_for_us(system: u8, component: u8) -> bool {
    matches!(system, 0 | SYSTEM) && matches!(component, 0 | AUTOPILOT)
}
