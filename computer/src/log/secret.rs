//! Keeps keys out of the log: the autopilot's bytes are logged unchanged, except for the content of `SETUP_SIGNING`,
//! which is replaced by zeros.
//!
//! Every byte is tested for the head of such a frame, whatever came before it, so that no part of a frame and no
//! noise can hide one. Other bytes look like that head by chance once in 2^32; a message is then missing in the log.

use foxhound_link::signing::is_secret;

/// Bytes of a head: magic, length, two bytes of flags, sequence, system, component, three bytes of the message's number.
const HEAD_BYTES: usize = 10;
const MAGIC: u8 = 0xFD;

/// Filters one stream of bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Mask {
    last: [u8; HEAD_BYTES],
    /// The number of secret bytes from here on.
    secret: u16,
}

impl Mask {
    /// The byte, or zero in its place.
    pub(super) fn pass(&mut self, byte: u8) -> u8 {
        let shown = if self.secret > 0 { 0 } else { byte };
        self.secret = self.secret.saturating_sub(1);
        self.last.rotate_left(1);
        let [magic, length, .., low, middle, high] = &mut self.last;
        *high = byte;
        if *magic == MAGIC && is_secret(u32::from_le_bytes([*low, *middle, *high, 0])) {
            self.secret = self.secret.max(u16::from(*length));
        }
        shown
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_link::dialect::{HEARTBEAT_DATA, SETUP_SIGNING_DATA};
    use foxhound_link::framer::{FRAME_MAX, Header, encode_data};
    use std::vec::Vec;

    #[test]
    fn a_key_is_not_seen_and_everything_else_is() {
        let header = Header { system_id: 255, component_id: 190, sequence: 3 };
        let mut frame = [0; FRAME_MAX];
        let length = encode_data(header, &HEARTBEAT_DATA::default(), &mut frame);
        let heartbeat = frame[..length].to_vec();
        let key = SETUP_SIGNING_DATA { secret_key: [0x5a; 32], target_system: 1, ..Default::default() };
        let length = encode_data(header, &key, &mut frame);
        let keyed = frame[..length].to_vec();
        // The beginning of a frame right before it, as of one that was cut off.
        let stream = [&heartbeat[..], &heartbeat[..7], &keyed, &heartbeat].concat();
        let mut mask = Mask::default();
        let seen: Vec<u8> = stream.iter().map(|byte| mask.pass(*byte)).collect();
        assert!(stream.windows(8).any(|bytes| bytes == [0x5a; 8]) && !seen.contains(&0x5a));
        let until = heartbeat.len() + 7 + HEAD_BYTES;
        assert_eq!(seen[..until], stream[..until]);
        assert_eq!(seen[seen.len() - heartbeat.len() - 2..], stream[stream.len() - heartbeat.len() - 2..]);
    }
}
