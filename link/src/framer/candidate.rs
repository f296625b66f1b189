//! What a byte 0xFD starts: a frame, or nothing.

use mavlink_core::{MavlinkVersion, calculate_crc};

use super::{CHECKSUM, Frame, HEADER, Header, SIGNATURE, STX, known::known};

const STX_V1: u8 = 0xFE;
const HEADER_V1: usize = 6;
const SIGNED: u8 = 0x01;

/// What the first waiting bytes are.
pub(super) enum Candidate {
    /// Perhaps the start of a frame: this many bytes decide, or take the next decision.
    Undecided {
        /// How many, from the first.
        until: usize,
    },
    /// No start of a frame, by its header.
    Noise,
    /// A frame, but for its checksum.
    Damaged,
    /// A frame of this length.
    Whole {
        /// All its bytes.
        length: usize,
    },
}

/// Whether a frame can start with this byte.
pub(super) const fn starts(byte: u8, accept_v1: bool) -> bool {
    byte == STX || accept_v1 && byte == STX_V1
}

/// Judges the bytes from one that [`starts`] a frame.
pub(super) fn judge(waiting: &[u8]) -> Candidate {
    if waiting.first() == Some(&STX_V1) { judge_v1(waiting) } else { judge_v2(waiting) }
}

fn judge_v2(waiting: &[u8]) -> Candidate {
    let Some(&[_, payload, flags]) = waiting.first_chunk() else { return Candidate::Undecided { until: 3 } };
    if flags & !SIGNED != 0 {
        return Candidate::Noise;
    }
    let Some(&[.., id_0, id_1, id_2]) = waiting.first_chunk::<HEADER>() else {
        return Candidate::Undecided { until: HEADER };
    };
    let Some(known) = known(u32::from_le_bytes([id_0, id_1, id_2, 0])) else { return Candidate::Noise };
    let signature = if flags & SIGNED != 0 { SIGNATURE } else { 0 };
    check(waiting, HEADER + usize::from(payload), signature, known.extra)
}

fn judge_v1(waiting: &[u8]) -> Candidate {
    let Some(&[_, payload, .., id]) = waiting.first_chunk::<HEADER_V1>() else {
        return Candidate::Undecided { until: HEADER_V1 };
    };
    match known(u32::from(id)) {
        Some(known) if known.shortest == payload => check(waiting, HEADER_V1 + usize::from(payload), 0, known.extra),
        _ => Candidate::Noise,
    }
}

/// Judges the checksum behind `body` bytes, when all of the frame is there.
fn check(waiting: &[u8], body: usize, signature: usize, extra: u8) -> Candidate {
    let length = body + CHECKSUM + signature;
    if waiting.len() < length {
        return Candidate::Undecided { until: length };
    }
    let checksum = u16::from_le_bytes([waiting[body], waiting[body + 1]]);
    if checksum == calculate_crc(&waiting[1..body], extra) { Candidate::Whole { length } } else { Candidate::Damaged }
}

/// The parts of a [`Candidate::Whole`].
pub(super) fn frame(bytes: &[u8]) -> Frame<'_> {
    let payload = usize::from(bytes[1]);
    if bytes[0] == STX_V1 {
        return Frame {
            header: Header { sequence: bytes[2], system_id: bytes[3], component_id: bytes[4] },
            version: MavlinkVersion::V1,
            message_id: u32::from(bytes[5]),
            signed: false,
            payload: &bytes[HEADER_V1..HEADER_V1 + payload],
            bytes,
        };
    }
    Frame {
        header: Header { sequence: bytes[4], system_id: bytes[5], component_id: bytes[6] },
        version: MavlinkVersion::V2,
        message_id: u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]),
        signed: bytes[2] & SIGNED != 0,
        payload: &bytes[HEADER..HEADER + payload],
        bytes,
    }
}
