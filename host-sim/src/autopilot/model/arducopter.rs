//! ArduPilot Copter's rules, of the 4.6 and 4.7-dev sources where they differ from older ones.

use foxhound_link::dialect::{MavBatteryChargeState, MavSeverity, MavState, SET_POSITION_TARGET_LOCAL_NED_DATA};

use crate::world::vehicle::{Command, Motion};

use super::Autopilot;
use super::flight::{Behaviour, Goal, Yaw};

/// Manual flight.
pub const STABILIZE: u32 = 0;
/// Manual flight at a held height.
pub const ALT_HOLD: u32 = 2;
/// A mission.
pub const AUTO: u32 = 3;
/// Obeys a companion.
pub const GUIDED: u32 = 4;
/// Holds its position.
pub const LOITER: u32 = 5;
/// Returns and lands.
pub const RTL: u32 = 6;
/// Lands.
pub const LAND: u32 = 9;
/// Stops and holds.
pub const BRAKE: u32 = 17;

const MODES: [u32; 8] = [STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, LAND, BRAKE];
/// Modes that fly without a position.
const BLIND_MODES: [u32; 3] = [STABILIZE, ALT_HOLD, LAND];

/// `MAV_FRAME`: `LOCAL_NED`, `LOCAL_OFFSET_NED`, `BODY_NED`, `BODY_OFFSET_NED`; no other, 12 `BODY_FRD` included \[src\].
const FRAMES: [u8; 4] = [1, 7, 8, 9];
const BODY_FRAMES: [u8; 2] = [8, 9];
const OFFSET_FRAMES: [u8; 3] = [7, 8, 9];

pub(super) const POSITION_BITS: u16 = 0x0007;
pub(super) const VELOCITY_BITS: u16 = 0x0038;
pub(super) const ACCELERATION_BITS: u16 = 0x01C0;
pub(super) const FORCE_BIT: u16 = 0x0200;
pub(super) const YAW_BIT: u16 = 0x0400;
pub(super) const YAW_RATE_BIT: u16 = 0x0800;
/// `sane_vel_or_acc_vector` \[src\].
const SPEED_MAX_MPS: f32 = 1000.0;

impl Autopilot {
    pub(super) fn arducopter_status(&self) -> MavState {
        // CRITICAL in a failsafe, STANDBY on the ground [src].
        let is_failing =
            self.faults.battery.charge_state >= MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_CRITICAL as u8;
        match (is_failing, self.flight.landed) {
            (true, _) => MavState::MAV_STATE_CRITICAL,
            (false, true) => MavState::MAV_STATE_STANDBY,
            (false, false) => MavState::MAV_STATE_ACTIVE,
        }
    }

    /// A setpoint: obeyed in GUIDED, armed and in the air; elsewhere dropped silently \[src; run\]. An invalid one
    /// makes it stop in place and stay in GUIDED \[src: `mode_guided.init(true)`\]. One during a take-off aborts the
    /// take-off \[src: `set_vel_accel` leaves the take-off's submode\].
    pub(super) fn arducopter_target(&mut self, now_us: u64, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        if self.custom_mode != GUIDED || !self.armed || self.flight.landed {
            return;
        }
        self.flight.takeoff_down_m = None;
        let default_yaw = match self.parameters.get("WP_YAW_BEHAVIOR") as u8 {
            0 => Yaw::Hold,
            _ => Yaw::Travel,
        };
        self.flight.goal = goal(now_us, target, &self.flight.estimate(), default_yaw);
    }

    /// Velocities and accelerations are obeyed for `GUID_TIMEOUT`, then it brakes and stays in GUIDED \[run: 3.24 s
    /// to the first 15 %; src\]; of a position with a velocity the position is kept; a position alone has no time-out
    /// \[src\].
    pub(super) fn arducopter_command(&self, now_us: u64) -> Option<Command> {
        let mut goal = self.flight.goal?;
        let timeout_us = (self.parameters.get("GUID_TIMEOUT") * 1e6) as u64;
        if now_us.saturating_sub(goal.since_us) >= timeout_us {
            goal.position_ned_m[0]?;
            if goal.velocity_ned_mps[0].is_some() {
                goal.velocity_ned_mps = [Some(0.0); 3];
                goal.yaw = if matches!(goal.yaw, Yaw::Rate(_)) { Yaw::Hold } else { goal.yaw };
            }
        }
        Some(goal.command(&self.flight.estimate()))
    }

    /// Whether a change of mode is accepted: the mode must exist, and must have a position if it needs one \[mem\].
    pub(super) fn arducopter_may_enter(&mut self, mode: u32) -> bool {
        if !MODES.contains(&mode) {
            self.text(MavSeverity::MAV_SEVERITY_NOTICE, &format!("No such mode {mode}"));
            return false;
        }
        if self.faults.filter_is_bad && !BLIND_MODES.contains(&mode) {
            self.text(MavSeverity::MAV_SEVERITY_WARNING, "Mode change failed: requires position");
            return false;
        }
        true
    }
}

pub(super) const fn behaviour(mode: u32) -> Behaviour {
    match mode {
        GUIDED => Behaviour::Companion,
        RTL => Behaviour::Return,
        LAND => Behaviour::Land,
        _ => Behaviour::Hold,
    }
}

/// The command of a setpoint; `None` if it makes the vehicle stop \[src:
/// `handle_message_set_position_target_local_ned` of `GCS_MAVLink_Copter.cpp`\]:
///
/// - one ignored axis ignores its whole vector;
/// - accepted are position; position and velocity, with or without acceleration; velocity, with or without
///   acceleration; acceleration; nothing else, so neither yaw alone nor position and acceleration;
/// - forces are refused, unless the acceleration is ignored;
/// - a velocity that is not finite or has a component beyond 1000 m/s is refused; nothing else is checked. (Here any
///   other number that is not finite stops it, too: the real effect is not known.)
/// - body frames are rotated by the yaw alone, down stays down; positions in them are offsets, as they are in frame
///   7;
/// - yaw in a body frame is relative, and is applied anew with each message.
fn goal(now_us: u64, target: &SET_POSITION_TARGET_LOCAL_NED_DATA, estimate: &Motion, default_yaw: Yaw) -> Option<Goal> {
    let (mask, frame) = (target.type_mask, target.coordinate_frame);
    let has = |bits: u16| mask & bits == 0;
    let (position, velocity, acceleration) = (has(POSITION_BITS), has(VELOCITY_BITS), has(ACCELERATION_BITS));
    if !FRAMES.contains(&frame) || mask & FORCE_BIT != 0 && acceleration {
        return None;
    }
    if !velocity && position == acceleration {
        return None;
    }
    let (sine, cosine) = (libm::sin(estimate.pose.yaw_rad), libm::cos(estimate.pose.yaw_rad));
    let turned = |vector: [f32; 3]| {
        let [x, y, z] = vector.map(f64::from);
        if BODY_FRAMES.contains(&frame) { [x * cosine - y * sine, x * sine + y * cosine, z] } else { [x, y, z] }
    };
    let velocity_mps = [target.vx, target.vy, target.vz];
    if velocity && !velocity_mps.iter().all(|v| v.abs() <= SPEED_MAX_MPS) {
        return None;
    }
    let mut place = turned([target.x, target.y, target.z]);
    if OFFSET_FRAMES.contains(&frame) {
        place.iter_mut().zip(estimate.pose.position_ned_m).for_each(|(place, here)| *place += here);
    }
    let yaw_rate = f64::from(target.yaw_rate);
    let yaw = match (has(YAW_BIT), has(YAW_RATE_BIT)) {
        (true, _) if BODY_FRAMES.contains(&frame) => Yaw::Angle(estimate.pose.yaw_rad + f64::from(target.yaw)),
        (true, _) => Yaw::Angle(f64::from(target.yaw)),
        (false, true) => Yaw::Rate(yaw_rate),
        (false, false) => default_yaw,
    };
    let is_finite = match yaw {
        Yaw::Angle(x) | Yaw::Rate(x) => x.is_finite(),
        Yaw::Hold | Yaw::Travel => true,
    };
    let accelerations = turned([target.afx, target.afy, target.afz]);
    let used = |is_used: bool, vector: [f64; 3]| vector.map(|x| is_used.then_some(x));
    let goal = Goal {
        since_us: now_us,
        position_ned_m: used(position, place),
        velocity_ned_mps: used(velocity, turned(velocity_mps)),
        acceleration_ned_mps2: used(acceleration, accelerations),
        yaw,
    };
    let numbers = [goal.position_ned_m, goal.acceleration_ned_mps2];
    (is_finite && numbers.iter().flatten().flatten().all(|x| x.is_finite())).then_some(goal)
}
