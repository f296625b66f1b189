//! ArduPilot Copter's rules, of the 4.6 and 4.7-dev sources where they differ from older ones.

use foxhound_link::dialect::{MavBatteryChargeState, MavSeverity, MavState, SET_POSITION_TARGET_LOCAL_NED_DATA};

use crate::world::vehicle::Command;

use super::Autopilot;
use super::flight::{Behaviour, Goal};

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

/// `sane_vel_or_acc_vector` \[src\].
const SPEED_MAX_MPS: f64 = 1000.0;

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
        // Refused are a velocity that is not finite or has a component beyond 1000 m/s [src]. (A yaw that is not finite stops it here; the real
        // effect is not known.)
        self.flight.goal = Goal::of(now_us, target)
            .filter(|goal| goal.velocity_ned_mps.iter().all(|v| v.abs() <= SPEED_MAX_MPS) && goal.yaw.is_finite());
    }

    /// A setpoint is obeyed for `GUID_TIMEOUT`, then it brakes and stays in GUIDED \[run: 3.24 s to the first 15 %; src\].
    pub(super) fn arducopter_command(&self, now_us: u64) -> Option<Command> {
        let timeout_us = (self.parameters.get("GUID_TIMEOUT") * 1e6) as u64;
        let goal = self.flight.goal.filter(|goal| now_us.saturating_sub(goal.since_us) < timeout_us)?;
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
