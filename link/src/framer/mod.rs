//! Bytes to frames and back: MAVLink framing, for either end of a link.
//!
//! ```text
//!  2:  0xFD  length  incompat  compat  sequence  system  component  id (3)  payload  crc (2)  [signature (13)]
//!  1:  0xFE  length                    sequence  system  component  id (1)  payload  crc (2)
//! ```
//!
//! After <https://mavlink.io/en/guide/serialization.html>. The checksum is CRC-16/MCRF4XX over everything from the
//! length to the end of the payload and one more byte, `CRC_EXTRA`, which fixes the layout of the message.
//!
//! The framer tests candidates: each 0xFD outside a frame may start one. A candidate is tested as early as possible:
//! its flags when 3 bytes are there, its message id when 10 are, its checksum when all are. One that fails gives back
//! all its bytes but the first, so a false start never costs a true frame behind it. Random bytes rarely contain a
//! published id (one in 43 000), so a false start hardly ever delays a frame.
//!
//! Messages outside our [`dialect`](crate::dialect) must be consumed whole too. Otherwise a frame inside the payload of
//! another (a tunnel, a file transfer, a log download) would be taken for traffic. So the framer knows the `CRC_EXTRA`
//! of every published message ([`known`]): common, ardupilotmega, development and the vendors' dialects. A frame may be
//! longer than its message was when the table was made, if its checksum is right: that is how MAVLink 2 extends
//! messages.
//!
//! Signed frames are accepted without a check of their signature. Frames with 32-bit system ids or other
//! incompatibility flags are skipped byte by byte. So is MAVLink 1, unless [`Framer::accept_v1`] enables it: in noise
//! its short header passes over 10 000 times as often, and it cannot be signed.
//!
//! # What this does not protect from
//!
//! * Messages that are not published, or that use another's id: their frames count as noise, and a whole frame in their
//!   payload is taken for traffic.
//! * Forgery: a checksum is no signature.
//! * Chance: a damaged or false frame with a published id passes one time in 65 536.
//! * Delay: a false start that looks like a frame holds back the bytes behind it until it is complete, at most
//!   [`FRAME_MAX`].
//! * Load: bytes made to look like the start of a long frame every 5 bytes cost 56 bytes of checksum each.

mod candidate;
mod content;
mod known;
mod senders;
mod table;
#[cfg(test)]
mod tests;
mod write;

pub use content::Content;
pub use known::{Known, known, known_ids};
pub use mavlink_core::MavlinkVersion;
pub(crate) use write::Packed;
pub use write::{encode, encode_data};

use mavlink_core::Message;

use crate::dialect::MavMessage;
use candidate::Candidate;
use senders::Senders;

/// Longest frame: header, 255 bytes of payload, checksum, signature.
pub const FRAME_MAX: usize = HEADER + PAYLOAD_MAX + CHECKSUM + SIGNATURE;

const STX: u8 = 0xFD;
const HEADER: usize = 10;
const PAYLOAD_MAX: usize = 255;
const CHECKSUM: usize = 2;
const SIGNATURE: usize = 13;

/// The sender of a frame, and its sequence number.
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
    /// MAVLink 1 or 2.
    pub version: MavlinkVersion,
    /// Which message it carries, in or out of our dialect.
    pub message_id: u32,
    /// Whether it carries a signature (which has not been checked).
    pub signed: bool,
    /// The message, in MAVLink 2 with trailing zeros cut off by the sender.
    pub payload: &'a [u8],
    /// All its bytes, from 0xFD to the end.
    pub bytes: &'a [u8],
}

impl<'a> Frame<'a> {
    /// The message, if it is one of our dialect.
    #[must_use]
    pub fn message(&self) -> Option<MavMessage> {
        MavMessage::parse(self.version, self.message_id, self.payload).ok()
    }

    /// The signature of a signed frame: link id, time (6 bytes, little endian) and 6 bytes of hash, over all bytes up
    /// to the hash.
    #[must_use]
    pub fn signature(&self) -> Option<&'a [u8; SIGNATURE]> {
        if self.signed { self.bytes.last_chunk() } else { None }
    }
}

/// Counts of a framer. No count overflows: each stays at its greatest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames of messages of our dialect.
    pub frames: u32,
    /// Frames of other published messages.
    pub unknown: u32,
    /// Candidates with the header of a frame and a wrong checksum: damaged frames, rarely noise.
    pub bad_crc: u32,
    /// Bytes outside frames.
    pub skipped_bytes: u32,
    /// Frames that are missing between those of one sender; the sum over all senders, also those forgotten.
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
/// framer.each(&sent[..length], |frame| assert!(matches!(frame.message(), Some(MavMessage::HEARTBEAT(_)))));
/// assert_eq!(framer.counters().frames, 1);
/// ```
#[derive(Clone, Debug)]
pub struct Framer {
    buffer: [u8; FRAME_MAX],
    start: usize,
    end: usize,
    /// With fewer bytes than these the candidate at `start` cannot be judged further.
    until: usize,
    v1: bool,
    counters: Counters,
    senders: Senders,
}

impl Default for Framer {
    fn default() -> Self {
        Self::new()
    }
}

impl Framer {
    /// A framer for MAVLink 2 with all counts zero.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            buffer: [0; FRAME_MAX],
            start: 0,
            end: 0,
            until: 0,
            v1: false,
            counters: Counters { frames: 0, unknown: 0, bad_crc: 0, skipped_bytes: 0, lost: 0 },
            senders: Senders::NONE,
        }
    }

    /// Accepts MAVLink 1 too from now on, or no longer. Only frames of the length without extensions are taken.
    pub const fn accept_v1(&mut self, accept: bool) {
        self.v1 = accept;
        // The waiting bytes are tested again.
        self.until = 0;
    }

    /// Takes bytes, and gives each frame that is whole with them.
    pub fn each(&mut self, mut bytes: &[u8], mut take: impl FnMut(Frame<'_>)) {
        while !bytes.is_empty() {
            bytes = bytes.get(self.push(bytes)..).unwrap_or_default();
            while let Some(frame) = self.next_frame() {
                take(frame);
            }
        }
    }

    /// Takes as many bytes as fit and returns how many: at least one, if frames were fetched with [`Self::next_frame`]
    /// until there was none.
    #[inline(never)]
    pub fn push(&mut self, bytes: &[u8]) -> usize {
        let is_crowded = bytes.len() > self.buffer.len() - self.end;
        if is_crowded && self.start <= self.end && self.end <= self.buffer.len() {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        let taken = fill(self.buffer.get_mut(self.end..).unwrap_or_default(), bytes);
        self.end += taken;
        taken
    }

    /// The next frame; `None` when more bytes are needed.
    #[inline(never)]
    pub fn next_frame(&mut self) -> Option<Frame<'_>> {
        loop {
            if self.waiting() < self.until {
                return None;
            }
            self.seek();
            if self.waiting() == 0 {
                return None;
            }
            match candidate::judge(self.candidates()) {
                Candidate::Undecided { until } => {
                    self.until = until;
                    return None;
                }
                Candidate::Noise => self.skip(1),
                Candidate::Damaged => {
                    self.counters.bad_crc = self.counters.bad_crc.saturating_add(1);
                    self.skip(1);
                }
                Candidate::Whole { length } => return self.take(length),
            }
        }
    }

    /// Bytes that were pushed and are neither skipped nor part of a frame yet: the start of a candidate, and what
    /// follows it. Fewer than [`FRAME_MAX`] once [`Self::next_frame`] has returned `None`.
    #[must_use]
    pub const fn waiting(&self) -> usize {
        self.end - self.start
    }

    /// The counts so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    fn candidates(&self) -> &[u8] {
        self.buffer.get(self.start..self.end).unwrap_or_default()
    }

    /// Skips what cannot start a frame.
    fn seek(&mut self) {
        let waiting = self.candidates();
        let noise = waiting.iter().position(|&byte| candidate::starts(byte, self.v1)).unwrap_or(waiting.len());
        self.skip(noise);
    }

    #[inline(never)]
    fn skip(&mut self, bytes: usize) {
        self.start += bytes;
        self.until = 0;
        // At most what the buffer holds.
        self.counters.skipped_bytes = self.counters.skipped_bytes.saturating_add(bytes as u32);
    }

    #[inline(never)]
    fn take(&mut self, length: usize) -> Option<Frame<'_>> {
        let start = self.start;
        self.start += length;
        self.until = 0;
        let frame = candidate::frame(self.buffer.get(start..start + length)?)?;
        let counter =
            if content::is_ours(frame.message_id) { &mut self.counters.frames } else { &mut self.counters.unknown };
        *counter = counter.saturating_add(1);
        self.counters.lost = self.counters.lost.saturating_add(self.senders.hear(frame.header));
        Some(frame)
    }
}

/// Copies as many bytes as fit, and returns how many.
pub(crate) fn fill(room: &mut [u8], bytes: &[u8]) -> usize {
    let length = room.len().min(bytes.len());
    if let (Some(room), Some(bytes)) = (room.get_mut(..length), bytes.get(..length)) {
        room.copy_from_slice(bytes);
    }
    length
}
