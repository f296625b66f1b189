//! Bytes to frames and back: MAVLink 2 framing, for either end of a link.
//!
//! ```text
//!  0xFD  length  incompat  compat  sequence  system  component  id (3)  payload  crc (2)  [signature (13)]
//! ```
//!
//! After <https://mavlink.io/en/guide/serialization.html>. The checksum is CRC-16/MCRF4XX over everything from the
//! length to the end of the payload and one more byte, `CRC_EXTRA`, which fixes the layout of the message.
//!
//! A stream is read by candidates: each 0xFD that was not consumed may start a frame. A candidate whose checksum fails
//! gives back all its bytes but the first, so a false start in noise never costs a true frame behind it.
//!
//! Messages outside our [`dialect`](crate::dialect) have a `CRC_EXTRA` that we do not know. Their frames must still be
//! consumed whole, or a message that carries another frame in its payload (a tunnel, a log download) would have its
//! cargo taken for traffic. Of the 65 536 possible checksums, the 256 values of the missing byte can explain only 256:
//! a frame of an unknown message is accepted when its checksum is one of these and its id has at most 16 bits (no
//! published dialect uses more). So of the false starts that look like an unknown message one in 256 is believed, and
//! may swallow up to 280 bytes; a known message has the full 16 bits of its checksum.
//!
//! Signed frames are accepted and their signature is not looked at. Other incompatibility flags, and MAVLink 1, are not
//! understood: such frames are skipped byte by byte.

use mavlink_core::{MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, MessageData, calculate_crc};

use crate::dialect::MavMessage;

/// Longest frame: header, 255 bytes of payload, checksum, signature.
pub const FRAME_MAX: usize = HEADER + 255 + CHECKSUM + SIGNATURE;

const STX: u8 = 0xFD;
const HEADER: usize = 10;
const CHECKSUM: usize = 2;
const SIGNATURE: usize = 13;
const SIGNED: u8 = 0x01;
/// No published dialect has a greater message id.
const UNKNOWN_ID_MAX: u32 = 0xFFFF;

/// Senders whose sequence numbers are followed.
const SENDERS: usize = 8;

/// Who sent a frame, and as which of its frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// The sender's system.
    pub system_id: u8,
    /// The sender's component.
    pub component_id: u8,
    /// Counts the sender's frames.
    pub sequence: u8,
}

/// A frame whose checksum is right, inside the framer's buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Who sent it.
    pub header: Header,
    /// Which message it carries, in or out of our dialect.
    pub message_id: u32,
    /// Whether it carries a signature (which nobody has checked).
    pub signed: bool,
    /// The message, with trailing zeros cut off by the sender.
    pub payload: &'a [u8],
    /// All its bytes, from 0xFD to the end.
    pub bytes: &'a [u8],
}

impl Frame<'_> {
    /// The message, if it is one of our dialect.
    #[must_use]
    pub fn message(&self) -> Option<MavMessage> {
        MavMessage::parse(MavlinkVersion::V2, self.message_id, self.payload).ok()
    }
}

/// What a framer has seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames of messages that we know.
    pub frames: u32,
    /// Frames of messages that we do not know.
    pub unknown: u32,
    /// Candidates whose checksum failed: damaged frames, and 0xFD bytes in noise.
    pub bad_crc: u32,
    /// Bytes outside frames.
    pub skipped_bytes: u32,
    /// Frames that are missing between those of one sender.
    pub lost: u32,
}

/// Finds frames in bytes that arrive in pieces of any size.
///
/// ```
/// use foxhound_link::dialect::{HEARTBEAT_DATA, MavMessage};
/// use foxhound_link::framer::{self, Framer, Header};
///
/// let mut sent = [0; framer::FRAME_MAX];
/// let length = framer::encode(Header::default(), &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()), &mut sent);
///
/// let mut framer = Framer::new();
/// let mut rest = &sent[..length];
/// while !rest.is_empty() {
///     let taken = framer.push(rest);
///     rest = &rest[taken..];
///     while let Some(frame) = framer.next_frame() {
///         assert!(matches!(frame.message(), Some(MavMessage::HEARTBEAT(_))));
///     }
/// }
/// assert_eq!(framer.counters().frames, 1);
/// ```
#[derive(Clone, Debug)]
pub struct Framer {
    buffer: [u8; 2 * FRAME_MAX],
    start: usize,
    end: usize,
    counters: Counters,
    senders: [Option<Header>; SENDERS],
    oldest: usize,
}

impl Default for Framer {
    fn default() -> Self {
        Self::new()
    }
}

impl Framer {
    /// A framer that has seen nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: [0; 2 * FRAME_MAX],
            start: 0,
            end: 0,
            counters: Counters { frames: 0, unknown: 0, bad_crc: 0, skipped_bytes: 0, lost: 0 },
            senders: [None; SENDERS],
            oldest: 0,
        }
    }

    /// Takes as many bytes as there is room for and says how many. At least one, if the frames were fetched with
    /// [`Self::next_frame`] until there was none.
    pub fn push(&mut self, bytes: &[u8]) -> usize {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        let taken = bytes.len().min(self.buffer.len() - self.end);
        self.buffer[self.end..self.end + taken].copy_from_slice(&bytes[..taken]);
        self.end += taken;
        taken
    }

    /// The next frame; `None` when more bytes are needed.
    pub fn next_frame(&mut self) -> Option<Frame<'_>> {
        loop {
            let waiting = &self.buffer[self.start..self.end];
            match candidate(waiting) {
                Candidate::Incomplete => return None,
                Candidate::Noise => self.skip(),
                Candidate::Damaged => {
                    self.counters.bad_crc = self.counters.bad_crc.saturating_add(1);
                    self.skip();
                }
                Candidate::Frame { length, known } => {
                    let start = self.start;
                    self.start += length;
                    let counter = if known { &mut self.counters.frames } else { &mut self.counters.unknown };
                    *counter = counter.saturating_add(1);
                    let header = Header {
                        sequence: self.buffer[start + 4],
                        system_id: self.buffer[start + 5],
                        component_id: self.buffer[start + 6],
                    };
                    self.follow(header);
                    return Some(frame(header, &self.buffer[start..start + length]));
                }
            }
        }
    }

    /// What was seen so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    fn skip(&mut self) {
        self.start += 1;
        self.counters.skipped_bytes = self.counters.skipped_bytes.saturating_add(1);
    }

    /// Counts the frames missing between the sender's last one and this one. A sender too many replaces the one that
    /// was first heard longest ago.
    fn follow(&mut self, header: Header) {
        let same =
            |sender: &&mut Header| sender.system_id == header.system_id && sender.component_id == header.component_id;
        if let Some(last) = self.senders.iter_mut().flatten().find(same) {
            // A frame that a router sent twice is no gap.
            let step = header.sequence.wrapping_sub(last.sequence);
            self.counters.lost = self.counters.lost.saturating_add(u32::from(step.saturating_sub(1)));
            *last = header;
        } else {
            self.senders[self.oldest] = Some(header);
            self.oldest = (self.oldest + 1) % SENDERS;
        }
    }
}

/// What the first waiting byte may start.
enum Candidate {
    Incomplete,
    Noise,
    Damaged,
    Frame { length: usize, known: bool },
}

fn candidate(waiting: &[u8]) -> Candidate {
    let Some(&first) = waiting.first() else {
        return Candidate::Incomplete;
    };
    if first != STX {
        return Candidate::Noise;
    }
    let Some(&flags) = waiting.get(2) else {
        return Candidate::Incomplete;
    };
    if flags & !SIGNED != 0 {
        return Candidate::Noise;
    }
    let body = HEADER + usize::from(waiting[1]);
    let length = body + CHECKSUM + if flags & SIGNED != 0 { SIGNATURE } else { 0 };
    if waiting.len() < length {
        return Candidate::Incomplete;
    }
    let checksum = u16::from_le_bytes([waiting[body], waiting[body + 1]]);
    let message_id = u32::from_le_bytes([waiting[7], waiting[8], waiting[9], 0]);
    let known = MavMessage::all_ids().contains(&message_id);
    let right = if message_id > UNKNOWN_ID_MAX {
        false
    } else if known {
        checksum == calculate_crc(&waiting[1..body], MavMessage::extra_crc(message_id))
    } else {
        some_extra_explains(checksum ^ calculate_crc(&waiting[1..body], 0))
    };
    if right { Candidate::Frame { length, known } } else { Candidate::Damaged }
}

/// Whether two checksums that differ by `difference` can come from the same bytes with different last bytes. The CRC is
/// linear: the difference must be the CRC, from zero, of a single byte `e`. That is, with `t = e ^ (e << 4)` in 8 bits,
/// `(t << 8) ^ (t << 3) ^ (t >> 4)`, and its upper half gives `t`.
fn some_extra_explains(difference: u16) -> bool {
    let upper = difference >> 8;
    let t = upper ^ (upper >> 5);
    difference == (t << 8) ^ (t << 3) ^ (t >> 4)
}

fn frame(header: Header, bytes: &[u8]) -> Frame<'_> {
    Frame {
        header,
        message_id: u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]),
        signed: bytes[2] & SIGNED != 0,
        payload: &bytes[HEADER..HEADER + usize::from(bytes[1])],
        bytes,
    }
}

/// Writes one frame into `sink` and says how long it is; 0 when it does not fit. [`FRAME_MAX`] bytes always suffice.
pub fn encode(header: Header, message: &MavMessage, sink: &mut [u8]) -> usize {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(mav_header(header), message);
    copy_out(&raw, sink)
}

/// [`encode`] for a message whose type is known when compiling: the other messages' encoders are not linked.
pub fn encode_data<D: MessageData>(header: Header, data: &D, sink: &mut [u8]) -> usize {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message_data(mav_header(header), data);
    copy_out(&raw, sink)
}

fn mav_header(header: Header) -> MavHeader {
    MavHeader { system_id: u32::from(header.system_id), component_id: header.component_id, sequence: header.sequence }
}

fn copy_out(raw: &MAVLinkV2MessageRaw, sink: &mut [u8]) -> usize {
    let bytes = raw.raw_bytes();
    let Some(room) = sink.get_mut(..bytes.len()) else {
        return 0;
    };
    room.copy_from_slice(bytes);
    bytes.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::HEARTBEAT_DATA;
    use std::vec::Vec;

    fn bytes(hex: &str) -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
    }

    // pymavlink 2.4.50: the heartbeat of an armed quadrotor in GUIDED, system 1, component 1.
    const HEARTBEAT: &str = "fd090000000101000000040000000203890403dbb3";
    // The same as the cargo of a TUNNEL (385), which is not in our dialect.
    const TUNNEL: &str = "fd1a00000001bf8101000000010115fd090000000101000000040000000203890403dbb3ac70";
    // A signed heartbeat of component 191: key 00 01 .. 1f, link 3, time stamp 123456.
    const SIGNED_HEARTBEAT: &str = "fd0901000001bf000000000000001208000403493e0340e2010000002bb0c9030021";

    /// The ids of all frames in a stream, and the counters.
    fn read(stream: &[u8]) -> (Vec<u32>, Counters) {
        let mut framer = Framer::new();
        let mut ids = Vec::new();
        let mut rest = stream;
        while !rest.is_empty() {
            rest = &rest[framer.push(rest)..];
            while let Some(frame) = framer.next_frame() {
                ids.push(frame.message_id);
            }
        }
        (ids, framer.counters())
    }

    #[test]
    fn a_difference_is_explained_exactly_when_one_of_the_256_last_bytes_does() {
        let data = b"anything";
        let mut explained = Vec::new();
        for last in 0..=255 {
            explained.push(calculate_crc(data, 0) ^ calculate_crc(data, last));
        }
        for difference in 0..=u16::MAX {
            assert_eq!(some_extra_explains(difference), explained.contains(&difference), "{difference:#06x}");
        }
    }

    #[test]
    fn a_frame_of_an_unknown_message_is_passed_over_whole_with_its_cargo() {
        let mut stream = bytes(TUNNEL);
        stream.extend_from_slice(&bytes(HEARTBEAT));
        let (ids, counters) = read(&stream);
        assert_eq!(ids, [385, 0]);
        assert_eq!((counters.frames, counters.unknown, counters.skipped_bytes), (1, 1, 0));

        // Damaged, it is rescanned like any other.
        stream[12] ^= 0x10;
        let (ids, counters) = read(&stream);
        assert_eq!(ids, [0, 0]);
        assert_eq!((counters.frames, counters.unknown, counters.bad_crc), (2, 0, 1));
    }

    #[test]
    fn a_signed_frame_is_taken_and_its_signature_belongs_to_it() {
        let mut stream = bytes(SIGNED_HEARTBEAT);
        stream.extend_from_slice(&bytes(HEARTBEAT));
        let mut framer = Framer::new();
        framer.push(&stream);
        let signed = framer.next_frame().unwrap();
        assert!(signed.signed && signed.bytes.len() == 34 && signed.header.component_id == 191);
        assert!(!framer.next_frame().unwrap().signed);
        assert_eq!(framer.counters().skipped_bytes, 0);
    }

    #[test]
    fn unknown_flags_and_the_old_protocol_are_not_understood() {
        // Flag 0x02 (32-bit system ids) and flag 0x80, each with a right checksum.
        for flags in [0x02, 0x80] {
            let mut stream = bytes(HEARTBEAT);
            stream[2] = flags;
            let crc = calculate_crc(&stream[1..19], 50).to_le_bytes();
            stream[19..21].copy_from_slice(&crc);
            stream.extend_from_slice(&bytes(HEARTBEAT));
            let (ids, counters) = read(&stream);
            assert_eq!((ids.len(), counters.skipped_bytes), (1, 21), "flags {flags:#x}");
        }
        // MAVLink 1, the same heartbeat.
        let mut stream = bytes("fe0900010100040000000203890403");
        let crc = calculate_crc(&stream[1..], 50).to_le_bytes();
        stream.extend_from_slice(&crc);
        stream.extend_from_slice(&bytes(HEARTBEAT));
        let (ids, counters) = read(&stream);
        assert_eq!((ids.len(), counters.skipped_bytes), (1, 17));
    }

    #[test]
    fn missing_frames_are_counted_for_each_sender() {
        let mut stream = Vec::new();
        let mut send = |component_id, sequence| {
            let header = Header { system_id: 1, component_id, sequence };
            let mut bytes = [0; FRAME_MAX];
            let length = encode_data(header, &HEARTBEAT_DATA::DEFAULT, &mut bytes);
            stream.extend_from_slice(&bytes[..length]);
        };
        for sequence in [250, 251, 255, 0, 0, 2] {
            send(1, sequence);
            send(2, sequence.wrapping_mul(3));
        }
        let (_, counters) = read(&stream);
        // Component 1: 252..=254 and 1. Component 2 sent 238, 241, 253, 0, 0, 6: 2 + 11 + 2 + 0 + 5.
        assert_eq!(counters.lost, 4 + 20);
    }

    #[test]
    fn a_long_false_start_gives_back_the_frames_that_it_covers() {
        let mut stream = bytes("fdff00");
        (0..12).for_each(|_| stream.extend_from_slice(&bytes(HEARTBEAT)));
        stream.extend_from_slice(&[0; FRAME_MAX]);
        assert_eq!(read(&stream).0.len(), 12);
    }

    #[test]
    fn a_sink_that_is_too_small_gets_nothing() {
        let mut sink = [0xAA; 20];
        assert_eq!(encode_data(Header::default(), &HEARTBEAT_DATA::DEFAULT, &mut sink), 0);
        assert_eq!(sink, [0xAA; 20]);
    }
}
