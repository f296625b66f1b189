//! Faults of an autopilot, injected by the caller.

use foxhound_link::MessageData;
use foxhound_link::dialect::{
    GPS_GLOBAL_ORIGIN_DATA, HEARTBEAT_DATA, MavAutopilot, MavBatteryChargeState, MavModeFlag, MavState, MavType,
};
use foxhound_link::framer::{FRAME_MAX, Frame, Header, encode_data};

use super::flight::Flight;
use super::{AUTOPILOT, Autopilot, arducopter, px4, streams::Streams};
use crate::scenario::Software;

/// How full the battery is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Battery {
    /// Energy left in percent, -1 unknown.
    pub remaining_percent: i8,
    /// `MAV_BATTERY_CHARGE_STATE`.
    pub charge_state: u8,
}

impl Default for Battery {
    fn default() -> Self {
        Self { remaining_percent: 80, charge_state: MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK as u8 }
    }
}

/// Faults, active as long as they are set.
#[derive(Clone, Copy, Debug)]
pub struct Faults {
    /// It sends nothing.
    pub is_silent: bool,
    /// It sends everything but its heartbeats.
    pub heartbeat_is_silent: bool,
    /// It receives nothing.
    pub is_deaf: bool,
    /// The battery, as it is reported.
    pub battery: Battery,
    /// The fence was left (ArduPilot).
    pub fence_is_breached: bool,
    /// The estimator has neither position nor velocity; the numbers keep coming.
    pub filter_is_bad: bool,
    /// `LOCAL_POSITION_NED` reports this position, metres, whatever the estimator has; its velocity is unchanged.
    pub position_ned_m: Option<[f32; 3]>,
    /// `LOCAL_POSITION_NED` reports the velocity with the opposite sign.
    pub velocity_is_backwards: bool,
    /// The remote control is not received.
    pub rc_is_lost: bool,
    /// Pulses of the remote control, microseconds.
    pub rc_us: [u16; 18],
    /// A key is set: unsigned messages are dropped, except heartbeats. PX4 does so on all links \[src, PR#25284\].
    pub signing_required: bool,
    /// Checks a signed frame, all its bytes. Without it every signature is accepted.
    pub signature_check: Option<fn(&[u8]) -> bool>,
    /// The heartbeats of another system's autopilot come on this link.
    pub other_system: Option<u8>,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            is_silent: false,
            heartbeat_is_silent: false,
            is_deaf: false,
            battery: Battery::default(),
            fence_is_breached: false,
            filter_is_bad: false,
            position_ned_m: None,
            velocity_is_backwards: false,
            rc_is_lost: false,
            rc_us: [1500; 18],
            signing_required: false,
            signature_check: None,
            other_system: None,
        }
    }
}

impl Faults {
    pub(super) fn lets_through(&self, frame: &Frame<'_>) -> bool {
        !self.signing_required
            || frame.message_id == HEARTBEAT_DATA::ID
            || frame.signed && self.signature_check.is_none_or(|check| check(frame.bytes))
    }
}

impl Autopilot {
    /// Restarts, without sending or receiving for `boot_us`: its clock starts over, streams, setpoints and sequences
    /// are forgotten, and the mode is the one after power-up \[src: devguide routing.md on `time_boot_ms`; the rest
    /// mem\]. It is disarmed; in the air it stays where it is.
    pub fn reboot(&mut self, now_us: u64, boot_us: u64) {
        self.streams = Streams::of(self.software);
        self.flight = Flight::new(self.flight.landed);
        self.custom_mode = match self.software {
            Software::ArduCopter => arducopter::STABILIZE,
            Software::Px4 => px4::HOLD,
        };
        self.armed = false;
        self.sequences = [0; 3];
        self.booted_us = now_us;
        self.awake_us = now_us + boot_us;
        self.is_booting = true;
        self.heartbeat_due_us = self.awake_us;
        self.timesync_due_us = self.awake_us;
    }

    /// The estimator's position jumps, NED in metres; the vehicle stays where it is. PX4 counts it in
    /// `ODOMETRY.reset_counter` \[src\], ArduPilot does not report it. `tells_origin`: a new `GPS_GLOBAL_ORIGIN` is broadcast.
    pub fn jump(&mut self, now_us: u64, step_ned_m: [f64; 3], tells_origin: bool) {
        for (axis, step) in step_ned_m.into_iter().enumerate() {
            self.flight.offset_ned_m[axis] += step;
        }
        self.flight.resets = self.flight.resets.wrapping_add(1);
        if tells_origin {
            self.flight.origin_moves += 1;
            self.say(now_us, GPS_GLOBAL_ORIGIN_DATA::ID);
        }
    }

    /// The estimator's yaw jumps; the nose does not turn. Counted as a [jump](Self::jump) is.
    pub fn jump_yaw(&mut self, step_rad: f64) {
        self.flight.yaw_offset_rad += step_rad;
        self.flight.resets = self.flight.resets.wrapping_add(1);
    }

    /// It reports that it is on the ground, or that it is not.
    pub fn set_landed(&mut self, is_landed: bool) {
        self.flight.landed = is_landed;
    }

    /// The heartbeat of another autopilot, if there is one.
    pub(super) fn other_heartbeat(&mut self) {
        let Some(system_id) = self.faults.other_system else { return };
        let heartbeat = HEARTBEAT_DATA {
            custom_mode: arducopter::RTL,
            mavtype: MavType::MAV_TYPE_QUADROTOR as u8,
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA as u8,
            base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED as u8,
            system_status: MavState::MAV_STATE_STANDBY as u8,
            mavlink_version: 3,
        };
        let header = Header { system_id, component_id: AUTOPILOT, sequence: self.sequences[2] };
        self.sequences[2] = self.sequences[2].wrapping_add(1);
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(header, &heartbeat, &mut frame);
        self.emit(&frame[..length]);
    }
}
