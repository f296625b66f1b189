//! Whole frames of everything that the link hears.

use std::sync::OnceLock;

use foxhound_core::base::time::Instant;
use foxhound_link::Message as _;
use foxhound_link::MessageData;
use foxhound_link::dialect::{
    ATTITUDE_DATA, BATTERY_STATUS_DATA, COMMAND_LONG_DATA, EKF_STATUS_REPORT_DATA, FENCE_STATUS_DATA,
    GPS_GLOBAL_ORIGIN_DATA, LOCAL_POSITION_NED_DATA, MavMessage, ODOMETRY_DATA, PARAM_SET_DATA, RC_CHANNELS_DATA,
    SETUP_SIGNING_DATA,
};
use foxhound_link::framer::{FRAME_MAX, Header, encode_data};
use foxhound_link::signing::{Key, Signing};

use super::{Draw, setting};

const SIGNATURE: usize = 13;
const REAL32: u8 = 9;
/// `DO_PAUSE_CONTINUE`, `PREFLIGHT_STORAGE`, `COMPONENT_ARM_DISARM`, `DO_SET_MODE`.
const ORDERS: [u16; 4] = [193, 245, 400, 176];

/// One of two keys, or none.
pub(super) fn key(draw: &mut Draw<'_>) -> Option<Key> {
    Key::new([draw.below(4).min(2); 32])
}

/// Who speaks to the companion: all senders, with one key at most.
pub(super) struct Peer {
    signing: Option<Signing>,
    /// The signatures that it has made, with which key, and whether they were heard.
    made: Vec<([u8; SIGNATURE], Key, bool)>,
    last: ([u8; FRAME_MAX], usize),
    /// Where the vehicle is, and its clock.
    boot_ms: u32,
    north_m: f32,
    yaw_rad: f32,
}

impl Peer {
    pub(super) fn new(draw: &mut Draw<'_>) -> Self {
        let signing = key(draw).map(|key| Signing::new(key, 1));
        Self { signing, made: Vec::new(), last: ([0; FRAME_MAX], 0), boot_ms: 5_000, north_m: 0.0, yaw_rad: 0.0 }
    }

    /// Whether a signature was made with this key, and is heard for the first time.
    pub(super) fn signed(&mut self, signature: Option<&[u8; SIGNATURE]>, key: Option<&Key>) -> bool {
        let is_it = |(made, with, heard): &&mut ([u8; SIGNATURE], Key, bool)| {
            Some(made) == signature && Some(with) == key && !*heard
        };
        self.made.iter_mut().find(is_it).map(|(.., heard)| *heard = true).is_some()
    }

    /// The companion has begun anew with a key: what it has heard may be told again.
    pub(super) fn begins_anew(&mut self) {
        self.made.iter_mut().for_each(|(.., heard)| *heard = false);
    }

    /// A heartbeat of an autopilot, in or out of the mode, armed or not.
    pub(super) fn heartbeat(&mut self, now: Instant, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        let (kind, mode) = (draw.byte(), draw.byte());
        let (autopilot, custom_mode) = match kind & 7 {
            0..5 => (3, if mode < 192 { 4 } else { u32::from(mode) }),
            5 | 6 => (12, if mode < 192 { 6 << 16 } else { u32::from(mode) << 16 }),
            _ => (mode, 4),
        };
        let armed = if kind < 224 { 0x89 } else { 0x09 };
        let component = if kind & 0x18 == 0x18 { mode } else { 1 };
        buffer[..10].copy_from_slice(&[0xfd, 9, 0, 0, draw.byte(), 1, component, 0, 0, 0]);
        buffer[10..14].copy_from_slice(&custom_mode.to_le_bytes());
        buffer[14..19].copy_from_slice(&[2, autopilot, armed, 4, 3]);
        self.finish(now, 0, draw, buffer)
    }

    /// The autopilot says where the vehicle is: on the ground, in the air, or anywhere.
    pub(super) fn landed(&mut self, now: Instant, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        const ID: u8 = 245;
        let state = match draw.below(4) {
            0 => 1,
            1 => draw.byte(),
            _ => 2,
        };
        buffer[..12].copy_from_slice(&[0xfd, 2, 0, 0, draw.byte(), 1, 1, ID, 0, 0, 0, state]);
        self.finish(now, u32::from(ID), draw, buffer)
    }

    /// Where the vehicle is and which way it looks, by and by, with a jump now and then.
    pub(super) fn motion(&mut self, now: Instant, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        let gap_ms = if draw.below(16) == 0 { draw.word() } else { u32::from(draw.below(64)) };
        self.boot_ms = self.boot_ms.wrapping_add(gap_ms);
        let time_boot_ms = self.boot_ms;
        match draw.below(8) {
            0 => {
                let latitude = i32::from(draw.below(2));
                self.say(&GPS_GLOBAL_ORIGIN_DATA { latitude, ..GPS_GLOBAL_ORIGIN_DATA::DEFAULT }, now, draw, buffer)
            }
            1 => self.say(&ODOMETRY_DATA { reset_counter: draw.below(2), ..ODOMETRY_DATA::DEFAULT }, now, draw, buffer),
            2..5 => {
                self.yaw_rad += if draw.below(8) == 0 { draw.any(-3.0, 3.0) } else { 0.01 };
                self.yaw_rad = if self.yaw_rad.abs() < 6.0 { self.yaw_rad } else { 0.0 };
                let yaw = self.yaw_rad;
                self.say(&ATTITUDE_DATA { time_boot_ms, yaw, ..ATTITUDE_DATA::DEFAULT }, now, draw, buffer)
            }
            _ => {
                self.north_m += if draw.below(8) == 0 { draw.any(-50.0, 50.0) } else { 0.02 };
                self.north_m = if self.north_m.abs() < 1e6 { self.north_m } else { 0.0 };
                let x = self.north_m;
                let place = LOCAL_POSITION_NED_DATA { time_boot_ms, x, vx: 1.0, ..LOCAL_POSITION_NED_DATA::DEFAULT };
                self.say(&place, now, draw, buffer)
            }
        }
    }

    /// Battery, fence, transmitter and estimator.
    pub(super) fn health(&mut self, now: Instant, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        match draw.below(4) {
            0 => {
                let (id, charge_state, battery_remaining) = (draw.below(6), draw.below(8), draw.byte() as i8);
                let usual = BATTERY_STATUS_DATA::DEFAULT;
                let battery = BATTERY_STATUS_DATA { id, charge_state, battery_remaining, ..usual };
                self.say(&battery, now, draw, buffer)
            }
            1 => {
                let breach_status = draw.below(2);
                self.say(&FENCE_STATUS_DATA { breach_status, ..FENCE_STATUS_DATA::DEFAULT }, now, draw, buffer)
            }
            2 => {
                let pulse = 900 + 5 * u16::from(draw.byte());
                let channels = RC_CHANNELS_DATA {
                    chancount: draw.below(20),
                    chan1_raw: pulse,
                    chan2_raw: pulse,
                    chan7_raw: pulse,
                    chan18_raw: pulse,
                    ..RC_CHANNELS_DATA::DEFAULT
                };
                self.say(&channels, now, draw, buffer)
            }
            _ => {
                let flags = if draw.flag() { 0x33F } else { u16::from(draw.byte()) };
                self.say(&EKF_STATUS_REPORT_DATA { flags, ..EKF_STATUS_REPORT_DATA::DEFAULT }, now, draw, buffer)
            }
        }
    }

    /// A command for us, or a key.
    pub(super) fn order(&mut self, now: Instant, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        let (target_system, target_component) = (1, 191);
        if draw.below(8) == 0 {
            let (initial_timestamp, secret_key) = (u64::from(draw.word()), [draw.below(3); 32]);
            let setup = SETUP_SIGNING_DATA { initial_timestamp, target_system, target_component, secret_key };
            return self.say(&setup, now, draw, buffer);
        }
        let (command, param1) = (ORDERS[usize::from(draw.below(4))], f32::from(draw.below(4)));
        let usual = COMMAND_LONG_DATA::DEFAULT;
        let order = COMMAND_LONG_DATA { target_system, target_component, command, param1, ..usual };
        self.say(&order, now, draw, buffer)
    }

    /// A parameter is set.
    pub(super) fn parameter(&mut self, now: Instant, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        let (id, param_value) = setting(draw);
        let set = PARAM_SET_DATA {
            param_value,
            target_system: 1,
            target_component: if draw.flag() { 191 } else { draw.byte() },
            param_id: foxhound_link::CharArray::new(*id.padded_name()),
            param_type: if draw.below(8) == 0 { draw.byte() } else { REAL32 },
        };
        self.say(&set, now, draw, buffer)
    }

    /// What was said last, once more.
    pub(super) fn again(&self, buffer: &mut [u8; FRAME_MAX]) -> usize {
        *buffer = self.last.0;
        self.last.1
    }

    /// A whole frame of one of our messages with any payload.
    pub(super) fn any_frame(&mut self, now: Instant, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        let ids = MavMessage::all_ids();
        let id = ids[usize::from(draw.byte()) % ids.len()];
        let length = draw.byte();
        let signed = draw.below(8) == 0;
        let sender = if draw.below(4) == 0 { [draw.byte(), draw.byte()] } else { [1, 1] };
        let [low, middle, high, _] = id.to_le_bytes();
        let head = [0xfd, length, u8::from(signed), 0, draw.byte(), sender[0], sender[1], low, middle, high];
        buffer[..10].copy_from_slice(&head);
        buffer[10..10 + usize::from(length)].fill_with(|| draw.byte());
        self.finish(now, id, draw, buffer)
    }

    fn say<D: MessageData>(
        &mut self,
        data: &D,
        now: Instant,
        draw: &mut Draw<'_>,
        buffer: &mut [u8; FRAME_MAX],
    ) -> usize {
        let header = Header { system_id: 1, component_id: 1, sequence: draw.byte() };
        let length = encode_data(header, data, buffer);
        self.sign(now, length, draw, buffer)
    }

    /// Finishes a frame whose header and payload are there, and says how long it is.
    fn finish(&mut self, now: Instant, id: u32, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        let body = 10 + usize::from(buffer[1]);
        let crc = checksum(&buffer[1..body], MavMessage::extra_crc(id)).to_le_bytes();
        buffer[body..body + 2].copy_from_slice(&crc);
        if buffer[2] == 0 {
            return self.sign(now, body + 2, draw, buffer);
        }
        // With a signature that is none.
        buffer[body + 2..body + 2 + SIGNATURE].fill_with(|| draw.byte());
        self.last = (*buffer, body + 2 + SIGNATURE);
        self.last.1
    }

    /// Signs a frame, more often than not, where there is a key for it.
    fn sign(&mut self, now: Instant, length: usize, draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
        let mut length = length;
        if let Some(signing) = self.signing.as_mut().filter(|_| draw.below(4) > 0) {
            let signed = signing.sign(now, buffer, length);
            if let Some(signature) = buffer[..signed].last_chunk() {
                self.made.push((*signature, signing.key().clone(), false));
                length = signed;
            }
        }
        self.last = (*buffer, length);
        length
    }
}

/// CRC-16/MCRF4XX from a table of our own.
fn checksum(bytes: &[u8], extra: u8) -> u16 {
    static TABLE: OnceLock<[u16; 256]> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        std::array::from_fn(|byte| {
            (0..8).fold(byte as u16, |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0x8408 } else { crc >> 1 })
        })
    });
    let step = |crc: u16, byte: u8| (crc >> 8) ^ table[usize::from(crc as u8 ^ byte)];
    step(bytes.iter().fold(0xffff, |crc, byte| step(crc, *byte)), extra)
}
