//! PX4's rules on a multicopter, of the sources after v1.13 where they differ from older ones.

use foxhound_link::dialect::{MavSeverity, MavState, SET_POSITION_TARGET_LOCAL_NED_DATA};

use crate::world::vehicle::{Command, Motion};

use super::Autopilot;
use super::arducopter::{ACCELERATION_BITS, FORCE_BIT, VELOCITY_BITS, YAW_BIT, YAW_RATE_BIT};
use super::flight::{Behaviour, Goal, Yaw};

/// Encodes a mode as HEARTBEAT does: main mode in the third byte, sub mode in the fourth \[src: `px4_custom_mode.h`;
/// run\].
#[must_use]
pub const fn mode(main: u8, sub: u8) -> u32 {
    (main as u32) << 16 | (sub as u32) << 24
}

/// Manual flight at a held height.
pub const ALTITUDE: u32 = mode(2, 0);
/// Manual flight that holds its position.
pub const POSITION: u32 = mode(3, 0);
/// Takes off.
pub const TAKEOFF: u32 = mode(4, 2);
/// Holds its position.
pub const HOLD: u32 = mode(4, 3);
/// A mission.
pub const MISSION: u32 = mode(4, 4);
/// Returns and lands.
pub const RETURN: u32 = mode(4, 5);
/// Lands.
pub const LAND: u32 = mode(4, 6);
/// Obeys a companion.
pub const OFFBOARD: u32 = mode(6, 0);
/// Manual flight.
pub const STABILIZED: u32 = mode(7, 0);

const MODES: [u32; 9] = [ALTITUDE, POSITION, TAKEOFF, HOLD, MISSION, RETURN, LAND, OFFBOARD, STABILIZED];
/// Modes that fly without a position.
const BLIND_MODES: [u32; 3] = [ALTITUDE, LAND, STABILIZED];
/// The bit of `COM_RCL_EXCEPT` that lets OFFBOARD fly without a remote control: the value 4, not 2 \[issue:
/// `PX4/PX4-user_guide#1690`\].
const OFFBOARD_WITHOUT_RC: u32 = 4;

const LOCAL_NED: u8 = 1;
const BODY_NED: u8 = 8;

impl Autopilot {
    pub(super) fn px4_status(&self) -> MavState {
        match (self.armed, self.flight.is_in_failsafe) {
            (true, true) => MavState::MAV_STATE_CRITICAL,
            (true, false) => MavState::MAV_STATE_ACTIVE,
            (false, _) => MavState::MAV_STATE_STANDBY,
        }
    }

    /// A setpoint: a valid one counts as a sign of life in every mode, which makes the stream that is needed to enter
    /// OFFBOARD; in OFFBOARD it is obeyed, too \[src: `handle_message_set_position_target_local_ned`\]. An invalid
    /// one is reported as a text and changes nothing: the setpoint before it stays in use.
    pub(super) fn px4_target(&mut self, now_us: u64, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        match goal(now_us, target, &self.flight.estimate(), self.body_ned_by_full_attitude) {
            Ok(goal) => {
                self.flight.stream_us = Some(now_us);
                if self.custom_mode == OFFBOARD {
                    self.flight.goal = Some(goal);
                }
            }
            Err(refusal) => {
                let text = format!("SET_POSITION_TARGET_LOCAL_NED {refusal}");
                self.text(MavSeverity::MAV_SEVERITY_CRITICAL, &text);
            }
        }
    }

    /// A setpoint that is not finite where it controls, or has only one of north and east, is replaced by standing still
    /// \[src: `PositionControl::_inputValid` and the failsafe setpoint\].
    pub(super) fn px4_command(&self, now_us: u64) -> Option<Command> {
        let goal = self.flight.goal.filter(|_| self.stream_is_fresh(now_us))?;
        let vectors = [goal.position_ned_m, goal.velocity_ned_mps, goal.acceleration_ned_mps2];
        let every_axis = (0..3).all(|axis| vectors.iter().any(|vector| vector[axis].is_some()));
        let in_pairs = vectors.iter().all(|[north, east, _]| north.is_some() == east.is_some());
        if !every_axis || !in_pairs {
            return None;
        }
        let command = goal.command(&self.flight.estimate());
        // On the ground it climbs, and does nothing else [src].
        (!self.flight.landed || command.velocity_ned_mps[2] < 0.0).then_some(command)
    }

    fn stream_is_fresh(&self, now_us: u64) -> bool {
        // A model that begins in OFFBOARD has been sent setpoints until then.
        let since_us = self.flight.stream_us.unwrap_or(self.booted_us);
        now_us.saturating_sub(since_us) < self.seconds_us("COM_OF_LOSS_T")
    }

    fn seconds_us(&self, parameter: &str) -> u64 {
        (self.parameters.get(parameter) * 1e6) as u64
    }

    /// Without a setpoint for `COM_OF_LOSS_T` another mode, that of `COM_OBL_RC_ACT`, is flown instead of OFFBOARD, at once, until there is one again or a
    /// pilot chooses a mode \[src: `Failsafe::checkModeFallback` is given the mode that is wanted by value, and its action is removed
    /// `WhenConditionClears`; `COM_FAIL_ACT_T` delays only actions that allow `UserTakeoverAllowed::Auto`\].
    pub(super) fn px4_watch_the_stream(&mut self, now_us: u64) {
        let is_lost = self.armed && !self.stream_is_fresh(now_us);
        if self.flight.is_in_failsafe && !is_lost {
            self.change_mode(OFFBOARD);
            self.flight.is_in_failsafe = false;
        } else if self.custom_mode == OFFBOARD && is_lost {
            self.text(MavSeverity::MAV_SEVERITY_CRITICAL, "Failsafe activated");
            let Some(fallback) = self.px4_fallback() else {
                self.armed = false;
                return;
            };
            self.change_mode(fallback);
            self.flight.is_in_failsafe = true;
        }
    }

    /// The mode of `COM_OBL_RC_ACT`; `None` disarms.
    fn px4_fallback(&self) -> Option<u32> {
        Some(match self.parameters.get("COM_OBL_RC_ACT") as u8 {
            // Position mode is no fallback without a remote control [issue: PX4 PR#26289].
            0 if !self.faults.rc_is_lost => POSITION,
            1 if !self.faults.rc_is_lost => ALTITUDE,
            2 if !self.faults.rc_is_lost => STABILIZED,
            0..=3 => RETURN,
            4 => LAND,
            5 => HOLD,
            _ => return None,
        })
    }

    /// Whether a change of mode is accepted: OFFBOARD needs its stream, and the remote control unless
    /// `COM_RCL_EXCEPT` excludes it \[src; issue: PX4#27636\]; modes that need a position need one.
    pub(super) fn px4_may_enter(&mut self, now_us: u64, mode: u32) -> bool {
        let without_rc = self.parameters.get("COM_RCL_EXCEPT") as u32 & OFFBOARD_WITHOUT_RC != 0;
        let why = if !MODES.contains(&mode) {
            "Unsupported mode"
        } else if mode == OFFBOARD && (self.flight.stream_us.is_none() || !self.stream_is_fresh(now_us)) {
            "Switching to Offboard is not possible: no signal"
        } else if mode == OFFBOARD && self.faults.rc_is_lost && !without_rc {
            "Switching to Offboard is not possible: no RC"
        } else if self.faults.filter_is_bad && !BLIND_MODES.contains(&mode) {
            "Mode change is not possible: no position"
        } else {
            return true;
        };
        self.text(MavSeverity::MAV_SEVERITY_CRITICAL, why);
        false
    }
}

pub(super) const fn behaviour(mode: u32) -> Behaviour {
    match mode {
        OFFBOARD => Behaviour::Companion,
        TAKEOFF => Behaviour::TakeOff,
        RETURN => Behaviour::Return,
        LAND => Behaviour::Land,
        _ => Behaviour::Hold,
    }
}

/// The command of a setpoint, or why it is refused \[src\]:
///
/// - frames `LOCAL_NED` and `BODY_NED` only; in the latter no place, and one ignored axis ignores the whole vector;
/// - in `LOCAL_NED` each axis counts by itself; ignored or not a number means not controlled;
/// - velocities of `BODY_NED` are turned by the yaw alone since PR#17958, accelerations by the full attitude
///   \[issue: PX4#23255\];
/// - no forces; yaw alone is invalid;
/// - yaw is absolute in every frame; without yaw and yaw rate the nose stays.
fn goal(
    now_us: u64,
    target: &SET_POSITION_TARGET_LOCAL_NED_DATA,
    estimate: &Motion,
    by_full_attitude: bool,
) -> Result<Goal, String> {
    let mask = target.type_mask;
    let vectors: [[f32; 3]; 3] =
        [[target.x, target.y, target.z], [target.vx, target.vy, target.vz], [target.afx, target.afy, target.afz]];
    let axis =
        |bit: usize| Some(f64::from(vectors[bit / 3][bit % 3])).filter(|x| mask & 1 << bit == 0 && x.is_finite());
    let raw = |index: usize| vectors[index].map(f64::from);
    let turned = |vector: [f64; 3]| vector.map(|x| x.is_finite().then_some(x));
    let [position_ned_m, velocity_ned_mps, acceleration_ned_mps2] = match target.coordinate_frame {
        LOCAL_NED => [0, 3, 6].map(|first| [axis(first), axis(first + 1), axis(first + 2)]),
        BODY_NED => {
            let attitude = if by_full_attitude { from_body(estimate, raw(1)) } else { from_heading(estimate, raw(1)) };
            let velocity = if mask & VELOCITY_BITS == 0 { turned(attitude) } else { [None; 3] };
            let acceleration =
                if mask & ACCELERATION_BITS == 0 { turned(from_body(estimate, raw(2))) } else { [None; 3] };
            [[None; 3], velocity, acceleration]
        }
        frame => return Err(format!("coordinate frame {frame} unsupported")),
    };
    let has = |vector: [Option<f64>; 3]| vector.iter().any(Option::is_some);
    if has(acceleration_ned_mps2) && mask & FORCE_BIT != 0 {
        return Err("force not supported".to_owned());
    }
    if !has(position_ned_m) && !has(velocity_ned_mps) && !has(acceleration_ned_mps2) {
        return Err("invalid".to_owned());
    }
    let (yaw, rate) = (f64::from(target.yaw), f64::from(target.yaw_rate));
    let yaw = if mask & YAW_BIT == 0 && yaw.is_finite() {
        Yaw::Angle(yaw)
    } else if mask & YAW_RATE_BIT == 0 && rate.is_finite() {
        Yaw::Rate(rate)
    } else {
        Yaw::Hold
    };
    Ok(Goal { since_us: now_us, position_ned_m, velocity_ned_mps, acceleration_ned_mps2, yaw })
}

fn from_heading(estimate: &Motion, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sine, cosine) = (libm::sin(estimate.pose.yaw_rad), libm::cos(estimate.pose.yaw_rad));
    [x * cosine - y * sine, x * sine + y * cosine, z]
}

fn from_body(estimate: &Motion, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sr, cr) = (libm::sin(estimate.pose.roll_rad), libm::cos(estimate.pose.roll_rad));
    let (sp, cp) = (libm::sin(estimate.pose.pitch_rad), libm::cos(estimate.pose.pitch_rad));
    let (y, z) = (y * cr - z * sr, y * sr + z * cr);
    let (x, z) = (x * cp + z * sp, z * cp - x * sp);
    from_heading(estimate, [x, y, z])
}
