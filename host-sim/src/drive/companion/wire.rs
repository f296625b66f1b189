//! What the driver itself says on the link, and what it notices of what the computer says.
//!
//! To stop, the computer is told to pause as a ground station would tell it, with `MAV_CMD_DO_PAUSE_CONTINUE`: so the stop
//! works for every computer, and is one that a pilot has, too. Where no computer is left to obey, the driver sends zero
//! velocity in its place.

use foxhound_core::base::time::Instant;
use foxhound_link::companion::{Autopilot, NOTICE_BYTES, TYPE_MASK};
use foxhound_link::dialect::{
    COMMAND_LONG_DATA, MavCmd, MavFrame, MavMessage, MavSeverity, SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA,
};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode_data};
use foxhound_link::signing::Signing;
use foxhound_link::{CharArray, MessageData};

const COMPANION: u8 = 191;
/// The driver, among the vehicle's components, where it speaks to the computer: another onboard computer.
const SIMULATOR: u8 = 192;

/// Follows the computer's frames on their way out.
#[derive(Debug, Default)]
pub(super) struct Wire {
    framer: Framer,
    /// Number of the computer's last frame.
    sequence: u8,
    /// The last setpoint asks for motion.
    moves: bool,
    /// When a setpoint last asked for motion.
    moved: Instant,
    /// The computer's last text for the pilot.
    told: Option<CharArray<NOTICE_BYTES>>,
    /// Number of what the driver says next.
    said: u8,
    /// Where there is a key, the driver signs, too: by a link of its own, since the computer counts on its.
    signing: Option<Signing>,
}

impl Wire {
    pub(super) fn new(signing: Option<Signing>) -> Self {
        Self { signing, ..Self::default() }
    }

    /// Takes in what the computer sends.
    pub(super) fn watch(&mut self, now: Instant, bytes: &[u8]) {
        self.framer.each(bytes, |frame| {
            if let Some(signing) = &mut self.signing {
                // The computer goes by the time of others; so does the driver, then.
                signing.check(now, frame.bytes);
            }
            let (header, message) = (frame.header, frame.message());
            self.sequence = header.sequence;
            match message {
                Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) => {
                    self.moves = [target.vx, target.vy, target.vz, target.yaw_rate].iter().any(|v| *v != 0.0);
                    if self.moves {
                        self.moved = now;
                    }
                }
                Some(MavMessage::STATUSTEXT(text)) => self.told = Some(text.text),
                _ => {}
            }
        });
    }

    /// Whether the last setpoint asks for motion.
    pub(super) const fn moves(&self) -> bool {
        self.moves
    }

    /// The computer's last text for the pilot.
    pub(super) const fn told(&self) -> Option<CharArray<NOTICE_BYTES>> {
        self.told
    }

    /// Since when no setpoint has asked for motion.
    pub(super) fn quiet_s(&self, now: Instant) -> f32 {
        now.seconds_since(self.moved)
    }

    /// The command to pause, for the computer beside an autopilot, from aboard: so the computer leaves it to the driver to tell
    /// the pilot why.
    pub(super) fn pause(&mut self, now: Instant, autopilot: &Autopilot) -> Vec<u8> {
        let header = Header { system_id: autopilot.system_id, component_id: SIMULATOR, sequence: self.said };
        self.said = self.said.wrapping_add(1);
        let pause = COMMAND_LONG_DATA {
            target_system: autopilot.system_id,
            target_component: COMPANION,
            command: MavCmd::MAV_CMD_DO_PAUSE_CONTINUE as u16,
            ..COMMAND_LONG_DATA::DEFAULT
        };
        self.frame(now, header, &pause)
    }

    /// A text for the pilot in the computer's place.
    pub(super) fn text(&mut self, now: Instant, autopilot: &Autopilot, text: &'static str) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(1);
        let header = Header { system_id: autopilot.system_id, component_id: COMPANION, sequence: self.sequence };
        let severity = MavSeverity::MAV_SEVERITY_WARNING as u8;
        let text = STATUSTEXT_DATA { severity, text: CharArray::from(text), ..STATUSTEXT_DATA::DEFAULT };
        self.frame(now, header, &text)
    }

    /// A setpoint of zero velocity in the computer's place.
    pub(super) fn zero(&mut self, now: Instant, autopilot: &Autopilot) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(1);
        self.moves = false;
        let header = Header { system_id: autopilot.system_id, component_id: COMPANION, sequence: self.sequence };
        let zero = SET_POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: (now.0 / 1000) as u32,
            target_system: autopilot.system_id,
            target_component: autopilot.component_id,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
            type_mask: TYPE_MASK,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        };
        self.frame(now, header, &zero)
    }

    fn frame<D: MessageData>(&mut self, now: Instant, header: Header, data: &D) -> Vec<u8> {
        let mut frame = [0; FRAME_MAX];
        let mut length = encode_data(header, data, &mut frame);
        if let Some(signing) = &mut self.signing {
            length = signing.sign(now, &mut frame, length);
        }
        frame[..length].to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_link::companion::Software;
    use foxhound_link::signing::{Key, Verdict};

    const AUTOPILOT: Autopilot = Autopilot {
        in_failsafe: false,
        system_id: 7,
        component_id: 1,
        software: Software::ArduPilot,
        custom_mode: 4,
        in_mode: true,
        armed: true,
        heard: Instant(0),
    };

    #[test]
    fn the_last_setpoint_is_known_and_a_zero_continues_the_numbers_of_the_frames() {
        let mut wire = Wire::default();
        let setpoint = SET_POSITION_TARGET_LOCAL_NED_DATA { vy: 0.1, ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT };
        let computer = Header { system_id: 7, component_id: 191, sequence: 255 };
        let sent = Wire::default().frame(Instant(0), computer, &setpoint);
        wire.watch(Instant(1_000_000), &sent);
        assert!(wire.moves() && wire.quiet_s(Instant(3_000_000)) == 2.0);
        let zero = wire.zero(Instant(3_000_000), &AUTOPILOT);
        assert!(!wire.moves());
        assert_eq!(zero[4..7], [0, 7, 191]);
        wire.watch(Instant(4_000_000), &zero);
        assert!(!wire.moves() && wire.quiet_s(Instant(4_000_000)) == 3.0);
    }

    #[test]
    fn the_pause_is_for_our_component_of_the_autopilots_system() {
        let mut framer = Framer::new();
        framer.push(&Wire::default().pause(Instant(0), &AUTOPILOT));
        let Some(MavMessage::COMMAND_LONG(pause)) = framer.next_frame().unwrap().message() else {
            unreachable!("it is a command")
        };
        assert_eq!((pause.command, pause.target_system, pause.target_component, pause.param1), (193, 7, 191, 0.0));
    }
    #[test]
    fn where_there_is_a_key_a_computer_that_is_a_year_ahead_believes_the_driver() {
        let key = Key::new([7; 32]).unwrap();
        let mut wire = Wire::new(Some(Signing::new(key.clone(), 1)));
        wire.signing.as_mut().unwrap().set_clock(Instant(0), 1_800_000_000_000_000);
        let mut computer = Signing::new(key, 0);
        computer.set_clock(Instant(0), 1_831_536_000_000_000);
        let early = wire.pause(Instant(0), &AUTOPILOT);
        assert_eq!(computer.check(Instant(0), &early), Verdict::TooOld);
        let mut sent = vec![0; FRAME_MAX];
        let header = Header { system_id: 7, component_id: 191, sequence: 1 };
        let length = encode_data(header, &SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT, &mut sent);
        let length = computer.sign(Instant(1_000), &mut sent, length);
        wire.watch(Instant(1_000), &sent[..length]);
        let (pause, zero) = (wire.pause(Instant(2_000), &AUTOPILOT), wire.zero(Instant(2_000), &AUTOPILOT));
        assert_eq!(computer.check(Instant(3_000), &pause), Verdict::Valid);
        assert_eq!(computer.check(Instant(3_000), &zero), Verdict::Valid);
    }
}
