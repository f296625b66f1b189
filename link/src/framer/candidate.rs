//! Whether a start byte begins a frame.

use mavlink_core::{MavlinkVersion, calculate_crc};

use super::{CHECKSUM, Frame, HEADER, Header, SIGNATURE, STX, known::known};

const STX_V1: u8 = 0xFE;
const HEADER_V1: usize = 6;
const SIGNED: u8 = 0x01;

/// What the first waiting bytes are.
pub(super) enum Candidate {
    /// Perhaps the start of a frame: decided, or tested further, once this many bytes are there.
    Undecided {
        /// How many, from the first.
        until: usize,
    },
    /// Not a frame, by its header.
    Noise,
    /// A frame with a wrong checksum.
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
    let (Some(content), Some([low, high, ..])) = (waiting.get(1..body), waiting.get(body..length)) else {
        return Candidate::Undecided { until: length };
    };
    let checksum = u16::from_le_bytes([*low, *high]);
    if checksum == calculate_crc(content, extra) { Candidate::Whole { length } } else { Candidate::Damaged }
}

/// The parts of a [`Candidate::Whole`].
pub(super) fn frame(bytes: &[u8]) -> Option<Frame<'_>> {
    Some(match *bytes {
        [STX_V1, payload, sequence, system_id, component_id, id, ..] => Frame {
            header: Header { sequence, system_id, component_id },
            version: MavlinkVersion::V1,
            message_id: u32::from(id),
            signed: false,
            payload: bytes.get(HEADER_V1..HEADER_V1 + usize::from(payload))?,
            bytes,
        },
        [_, payload, incompatible, _, sequence, system_id, component_id, id0, id1, id2, ..] => Frame {
            header: Header { sequence, system_id, component_id },
            version: MavlinkVersion::V2,
            message_id: u32::from_le_bytes([id0, id1, id2, 0]),
            signed: incompatible & SIGNED != 0,
            payload: bytes.get(HEADER..HEADER + usize::from(payload))?,
            bytes,
        },
        _ => return None,
    })
}
