//! PX4's rules on a multicopter, of the sources after v1.13 where they differ from older ones.

use foxhound_link::dialect::{MavSeverity, MavState, SET_POSITION_TARGET_LOCAL_NED_DATA};

use crate::world::vehicle::Command;

use super::Autopilot;
use super::flight::{Behaviour, Goal, LOCAL_NED, Yaw};

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
        match goal(now_us, target) {
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

    /// A setpoint with an axis that is not finite is replaced by standing still \[src: `PositionControl::_inputValid` and the failsafe
    /// setpoint\].
    pub(super) fn px4_command(&self, now_us: u64) -> Option<Command> {
        let goal = self.flight.goal.filter(|_| self.stream_is_fresh(now_us))?;
        if !goal.velocity_ned_mps.iter().all(|v| v.is_finite()) {
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

/// The command of a setpoint, or why it is refused. Without a number for yaw or yaw rate the nose stays \[src\].
fn goal(now_us: u64, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> Result<Goal, String> {
    let frame = target.coordinate_frame;
    if frame != LOCAL_NED {
        return Err(format!("coordinate frame {frame} unsupported"));
    }
    let goal = Goal::of(now_us, target).ok_or_else(|| format!("mask {:#06x} unknown", target.type_mask))?;
    if !goal.velocity_ned_mps.iter().any(|v| v.is_finite()) {
        return Err("invalid".to_owned());
    }
    Ok(if goal.yaw.is_finite() { goal } else { Goal { yaw: Yaw::Rate(0.0), ..goal } })
}
