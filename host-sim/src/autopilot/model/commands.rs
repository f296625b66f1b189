//! Commands, and changes of mode.

use foxhound_link::dialect::{COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavResult, MavSeverity};
use foxhound_link::framer::Header;

use super::flight::Behaviour;
use super::{AUTOPILOT, Autopilot, arducopter, is_for_us, px4};
use crate::scenario::Software;

/// Disarms in the air, too.
const FORCE: f32 = 21196.0;
/// `MAV_MODE_FLAG_CUSTOM_MODE_ENABLED` of `DO_SET_MODE`.
const CUSTOM_MODE: u8 = 1;

const SET_MESSAGE_INTERVAL: u16 = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16;
const REQUEST_MESSAGE: u16 = MavCmd::MAV_CMD_REQUEST_MESSAGE as u16;
const ARM_DISARM: u16 = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16;
const SET_MODE: u16 = MavCmd::MAV_CMD_DO_SET_MODE as u16;
const TAKEOFF: u16 = MavCmd::MAV_CMD_NAV_TAKEOFF as u16;
const LAND: u16 = MavCmd::MAV_CMD_NAV_LAND as u16;

impl Autopilot {
    /// The pilot, or a ground station, chooses a mode; false where it is refused.
    pub fn select_mode(&mut self, now_us: u64, mode: u32) -> bool {
        let may = match self.software {
            Software::ArduCopter => self.arducopter_may_enter(mode),
            Software::Px4 => self.px4_may_enter(now_us, mode),
        };
        if may {
            self.change_mode(mode);
            self.flight.is_in_failsafe = false;
        }
        may
    }

    /// Arms; false if it is refused: without a valid estimator, while returning or landing, and on PX4 in OFFBOARD
    /// without its stream \[mem\].
    pub fn arm(&mut self, now_us: u64) -> bool {
        let is_leaving = matches!(self.behaviour(), Behaviour::Land | Behaviour::Return);
        let mode_is_fine = self.software != Software::Px4
            || self.custom_mode != px4::OFFBOARD
            || self.px4_may_enter(now_us, px4::OFFBOARD);
        let may = !self.faults.filter_is_bad && !is_leaving && mode_is_fine;
        if may {
            self.armed = true;
        } else {
            self.text(MavSeverity::MAV_SEVERITY_CRITICAL, "Arming refused");
        }
        may
    }

    /// Takes off to a height above the ground; false where it is refused. ArduCopter does so in GUIDED and armed \[src\],
    /// PX4 in a mode of its own, and holds afterwards.
    pub fn take_off(&mut self, now_us: u64, height_m: f64) -> bool {
        let may = match self.software {
            // A vehicle in the air does not take off again [src].
            Software::ArduCopter => self.custom_mode == arducopter::GUIDED && self.armed && self.flight.landed,
            Software::Px4 => self.select_mode(now_us, px4::TAKEOFF),
        };
        if may {
            self.flight.takeoff_down_m = Some(-height_m);
            self.flight.goal = None;
            // It is not landed any more once it begins to climb [src: `set_land_complete(false)`].
            self.flight.landed &= self.software == Software::Px4;
        }
        may
    }

    pub(super) const fn behaviour(&self) -> Behaviour {
        match self.software {
            Software::ArduCopter => arducopter::behaviour(self.custom_mode),
            Software::Px4 => px4::behaviour(self.custom_mode),
        }
    }

    /// Enters a mode without asking. Goals are those of the mode that is left.
    pub(super) fn change_mode(&mut self, mode: u32) {
        self.custom_mode = mode;
        self.flight.mode = Some(mode);
        self.flight.goal = None;
        self.flight.takeoff_down_m = None;
    }

    pub(super) fn finish_takeoff(&mut self) {
        let Some(down_m) = self.flight.takeoff_down_m else { return };
        if self.flight.truth.pose.position_ned_m[2] > down_m + 0.1 {
            return;
        }
        self.flight.takeoff_down_m = None;
        if self.custom_mode == px4::TAKEOFF && self.software == Software::Px4 {
            self.change_mode(px4::HOLD);
        }
    }

    /// Every command addressed to it is answered; unknown ones with UNSUPPORTED \[src, both\].
    pub(super) fn obey_command(&mut self, now_us: u64, from: Header, command: &COMMAND_LONG_DATA) {
        if !is_for_us(command.target_system, command.target_component) {
            return;
        }
        let or = |is_done: bool, refusal: MavResult| if is_done { MavResult::MAV_RESULT_ACCEPTED } else { refusal };
        // The answer of each of the two to a refused command [mem].
        let refusal = match self.software {
            Software::ArduCopter => MavResult::MAV_RESULT_FAILED,
            Software::Px4 => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
        };
        let result = match command.command {
            SET_MESSAGE_INTERVAL => {
                let is_known = self.streams.set(now_us, command.param1 as u32, command.param2);
                or(is_known, MavResult::MAV_RESULT_FAILED)
            }
            REQUEST_MESSAGE => {
                let denial = match self.software {
                    Software::ArduCopter => MavResult::MAV_RESULT_FAILED,
                    Software::Px4 => MavResult::MAV_RESULT_DENIED,
                };
                or(self.say(now_us, command.param1 as u32), denial)
            }
            ARM_DISARM if command.param1 == 1.0 => or(self.arm(now_us), refusal),
            ARM_DISARM => or(self.disarm(command.param2 == FORCE), refusal),
            SET_MODE => match self.mode_of(command) {
                Some(mode) => or(self.select_mode(now_us, mode), refusal),
                None => MavResult::MAV_RESULT_DENIED,
            },
            TAKEOFF => {
                let height_m = match f64::from(command.param7) {
                    height_m if self.software == Software::ArduCopter => height_m,
                    // Above sea level, there; taken for the default height [inf].
                    _ => self.parameters.get("MIS_TAKEOFF_ALT"),
                };
                or(self.take_off(now_us, height_m), refusal)
            }
            LAND => {
                let mode = match self.software {
                    Software::ArduCopter => arducopter::LAND,
                    Software::Px4 => px4::LAND,
                };
                or(self.select_mode(now_us, mode), refusal)
            }
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
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

    fn disarm(&mut self, is_forced: bool) -> bool {
        let may = self.flight.landed || is_forced;
        self.armed &= !may;
        may
    }

    /// ArduPilot takes its mode's number, PX4 main and sub mode apart \[run: MAVSDK sends 129, 6, 0\].
    fn mode_of(&self, command: &COMMAND_LONG_DATA) -> Option<u32> {
        let is_custom = command.param1 as u8 & CUSTOM_MODE != 0;
        is_custom.then(|| match self.software {
            Software::ArduCopter => command.param2 as u32,
            Software::Px4 => px4::mode(command.param2 as u8, command.param3 as u8),
        })
    }
}
