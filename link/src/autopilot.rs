//! The autopilot's state and the vehicle's, from its messages, checked before use.
//!
//! The autopilot is recognised by its heartbeat: it names an autopilot software and the type of a vehicle. GUIDED is
//! mode 4 of ArduPilot's copters (4 means other things on its planes and rovers); OFFBOARD is main mode 6 of PX4. What is no
//! copter cannot hover, and is never commanded.

use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Ned;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::sin_cos;

use crate::dialect::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavModeFlag,
    MavState, MavType,
};
use crate::framer::Header;

const GUIDED: u32 = 4;
/// ArduCopter's own, as an aircraft comes near; it may return to the mode before.
const AVOID_ADSB: u32 = 19;
const OFFBOARD: u32 = 6;

/// Numbers beyond these come from no copter.
const POSITION_MAX_M: f32 = 1e6;
const SPEED_MAX_MPS: f32 = 1e3;
const ANGLE_MAX_RAD: f32 = 7.0;
const RATE_MAX_RADPS: f32 = 100.0;

/// Which autopilot software we talk to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Software {
    /// ArduPilot.
    ArduPilot,
    /// PX4.
    Px4,
    /// Another one, or PX4 on what is no copter: its messages are read, it is never commanded.
    Other,
}

/// The autopilot that we listen to, as of its last heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Autopilot {
    /// Its system, and ours.
    pub system_id: u8,
    /// Its component.
    pub component_id: u8,
    /// Its software.
    pub software: Software,
    /// Its mode, in its own numbers.
    pub custom_mode: u32,
    /// Whether it is in GUIDED or OFFBOARD.
    pub in_mode: bool,
    /// Whether the motors are armed.
    pub armed: bool,
    /// Whether its own failsafe may have chosen the mode, and may choose ours again.
    pub in_failsafe: bool,
    /// When the last heartbeat came.
    pub heard: Instant,
}

impl Autopilot {
    /// The sender of a heartbeat, if it is the autopilot of a vehicle.
    pub(crate) fn from_heartbeat(now: Instant, header: Header, heartbeat: &HEARTBEAT_DATA) -> Option<Self> {
        if !is_vehicle(heartbeat) {
            return None;
        }
        let software = Software::of(heartbeat);
        let armed = heartbeat.base_mode & MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED as u8 != 0;
        let is_critical = heartbeat.system_status == MavState::MAV_STATE_CRITICAL as u8;
        Some(Self {
            system_id: header.system_id,
            component_id: header.component_id,
            software,
            custom_mode: heartbeat.custom_mode,
            in_mode: match software {
                Software::ArduPilot => heartbeat.custom_mode == GUIDED && is_copter(heartbeat),
                Software::Px4 => (heartbeat.custom_mode >> 16) & 0xFF == OFFBOARD,
                Software::Other => false,
            },
            armed,
            in_failsafe: armed
                && match software {
                    Software::Px4 => is_critical,
                    Software::ArduPilot => heartbeat.custom_mode == AVOID_ADSB && is_copter(heartbeat),
                    Software::Other => false,
                },
            heard: now,
        })
    }

    /// Whether it is the sender of a frame.
    pub(crate) fn sent(&self, header: Header) -> bool {
        (self.system_id, self.component_id) == (header.system_id, header.component_id)
    }

    /// Whether it would obey us: in the mode and armed.
    pub(crate) fn obeys(&self) -> bool {
        self.in_mode && self.armed
    }

    /// Whether it obeys us, or its failsafe flies, after which it may again by itself.
    pub(crate) fn may_obey(&self) -> bool {
        self.obeys() || self.in_failsafe
    }
}

impl Software {
    fn of(heartbeat: &HEARTBEAT_DATA) -> Self {
        if heartbeat.autopilot == MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA as u8 {
            Self::ArduPilot
        } else if heartbeat.autopilot == MavAutopilot::MAV_AUTOPILOT_PX4 as u8 && is_copter(heartbeat) {
            Self::Px4
        } else {
            Self::Other
        }
    }
}

/// Some gimbals and antenna trackers run autopilot software too, so the type counts: up to 25 all are vehicles but
/// three, above that only copters matter here.
fn is_vehicle(heartbeat: &HEARTBEAT_DATA) -> bool {
    const LAST_OF_THE_VEHICLES: u8 = 25;
    let other = [MavType::MAV_TYPE_ANTENNA_TRACKER, MavType::MAV_TYPE_GCS, MavType::MAV_TYPE_ONBOARD_CONTROLLER]
        .iter()
        .any(|other| *other as u8 == heartbeat.mavtype);
    let vehicle = (heartbeat.mavtype <= LAST_OF_THE_VEHICLES && !other) || is_copter(heartbeat);
    vehicle && heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID as u8
}

#[inline(never)]
fn is_copter(heartbeat: &HEARTBEAT_DATA) -> bool {
    [
        MavType::MAV_TYPE_QUADROTOR,
        MavType::MAV_TYPE_COAXIAL,
        MavType::MAV_TYPE_HELICOPTER,
        MavType::MAV_TYPE_HEXAROTOR,
        MavType::MAV_TYPE_OCTOROTOR,
        MavType::MAV_TYPE_TRICOPTER,
        MavType::MAV_TYPE_DODECAROTOR,
        MavType::MAV_TYPE_DECAROTOR,
        MavType::MAV_TYPE_GENERIC_MULTIROTOR,
    ]
    .iter()
    .any(|copter| *copter as u8 == heartbeat.mavtype)
}

/// Where the vehicle is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Position {
    /// When it was made, on our clock.
    pub(crate) time: Instant,
    /// The same on the autopilot's.
    pub(crate) time_boot_ms: u32,
    pub(crate) position_ned_m: Ned,
    pub(crate) velocity_ned_mps: Ned,
}

impl Position {
    /// What the message says; `None` when a number is absurd or not finite.
    pub(crate) fn from_message(time: Instant, message: &LOCAL_POSITION_NED_DATA) -> Option<Self> {
        let position_ned_m = Ned { north: message.x, east: message.y, down: message.z };
        let velocity_ned_mps = Ned { north: message.vx, east: message.vy, down: message.vz };
        let within = |vector: Ned, limit: f32| {
            is_within(vector.north, limit) && is_within(vector.east, limit) && is_within(vector.down, limit)
        };
        (within(position_ned_m, POSITION_MAX_M) && within(velocity_ned_mps, SPEED_MAX_MPS)).then_some(Self {
            time,
            time_boot_ms: message.time_boot_ms,
            position_ned_m,
            velocity_ned_mps,
        })
    }
}

/// Which way the vehicle looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Attitude {
    /// When it was made, on our clock.
    pub(crate) time: Instant,
    /// The same on the autopilot's.
    pub(crate) time_boot_ms: u32,
    pub(crate) roll_rad: f32,
    pub(crate) pitch_rad: f32,
    pub(crate) yaw_rad: f32,
    pub(crate) yaw_rate_radps: f32,
}

impl Attitude {
    /// What the message says; `None` when a number is absurd or not finite.
    pub(crate) fn from_angles(time: Instant, message: &ATTITUDE_DATA) -> Option<Self> {
        let angles_rad = [message.roll, message.pitch, message.yaw];
        Self::from_euler((time, message.time_boot_ms), angles_rad, message.pitchspeed, message.yawspeed)
    }

    /// What the message says; `None` when a number is absurd or not finite, or the quaternion is none.
    pub(crate) fn from_quaternion(time: Instant, message: &ATTITUDE_QUATERNION_DATA) -> Option<Self> {
        let (w, x, y, z) = (message.q1, message.q2, message.q3, message.q4);
        // The norm is right within 1 %.
        if !is_within(w * w + x * x + y * y + z * z - 1.0, 0.02) {
            return None;
        }
        let roll_rad = libm::atan2f(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
        // The arc sine, by way of the arc tangent: libm's own computes in f64.
        let sin_pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0);
        let pitch_rad = libm::atan2f(sin_pitch, sqrt((1.0 - sin_pitch) * (1.0 + sin_pitch)));
        let yaw_rad = libm::atan2f(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
        let times = (time, message.time_boot_ms);
        Self::from_euler(times, [roll_rad, pitch_rad, yaw_rad], message.pitchspeed, message.yawspeed)
    }

    /// With the body's pitch rate `q` and yaw rate `r`, the yaw angle turns at `(q sin(roll) + r cos(roll)) /
    /// cos(pitch)`; where the nose points up or down it has no meaning, and the body's rate must do.
    #[inline(never)]
    fn from_euler((time, time_boot_ms): (Instant, u32), angles_rad: [f32; 3], q: f32, r: f32) -> Option<Self> {
        let sane = angles_rad.iter().all(|&angle| is_within(angle, ANGLE_MAX_RAD))
            && is_within(q, RATE_MAX_RADPS)
            && is_within(r, RATE_MAX_RADPS);
        if !sane {
            return None;
        }
        let [roll_rad, pitch_rad, yaw_rad] = angles_rad;
        let (sin_roll, cos_roll) = sin_cos(roll_rad);
        let (_, cos_pitch) = sin_cos(pitch_rad);
        let level = libm::fabsf(cos_pitch) > 0.1;
        let yaw_rate_radps = if level { (q * sin_roll + r * cos_roll) / cos_pitch } else { r };
        Some(Self { time, time_boot_ms, roll_rad, pitch_rad, yaw_rad, yaw_rate_radps })
    }
}

/// False for what is not finite, too.
fn is_within(value: f32, limit: f32) -> bool {
    libm::fabsf(value) <= limit
}
