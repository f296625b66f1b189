//! MAVLink 2 signing: nobody without the key can make a frame, and nobody can replay one.
//!
//! ```text
//!  frame with incompat bit 0x01, its checksum | link id (1) | timestamp (6) | signature (6)
//!  signature = first 6 bytes of SHA-256(key | everything from 0xFD to the timestamp)
//! ```
//!
//! After <https://mavlink.io/en/guide/message_signing.html>. A timestamp counts units of 10 us since 2015-01-01 UTC, in
//! 48 bits, which end in 2104: signing ends then, until there is a new key. Nothing wraps.
//!
//! # Receiving
//!
//! A *stream* is (system, component, link id). The frames of a stream must have strictly rising timestamps; a new
//! stream must not be more than a minute behind us. Only frames with valid signatures change any state here. There is
//! space for [`STREAMS`] streams. One more replaces the stream with the oldest timestamp, if that is more than a minute
//! behind us, since all earlier frames of it are then refused as too old; otherwise the new one is refused. So no
//! stream can be pushed out in order to be replayed.
//!
//! A valid frame that is ahead of us sets our clock forward, as MAVLink requires, however far: its sender holds the
//! key. A sender whose clock is wrong by years takes all its peers with it, for as long as this key is in use, and one
//! at the end of the range silences them.
//!
//! # Sending
//!
//! Timestamps rise strictly. They follow the best clock there is: the time of day if it was set, the stored timestamp
//! and the time since then, or the timestamps received. [`Signing::timestamp_to_store`] is a minute ahead of what is in
//! use, so that after a loss of power we continue after everything that we have signed. It is not farther ahead, so
//! that peers that have waited for us are at most a minute behind, and are accepted at once.
//!
//! Without a clock and a stored timestamp the first valid frame is accepted, whatever its age.

mod policy;
mod setup;

use core::fmt;

use foxhound_core::base::time::Instant;
use mavlink_core::calculate_crc;
use sha2::{Digest as _, Sha256};

use crate::framer::fill;

pub use policy::{Unsigned, is_secret};
pub use setup::{Setup, set_up};

/// Streams that are distinguished.
pub const STREAMS: usize = 8;
/// Bytes that a signature adds to a frame.
pub const SIGNATURE: usize = 13;
/// The last possible timestamp.
pub const TIMESTAMP_MAX: u64 = (1 << 48) - 1;

const STX: u8 = 0xFD;
const HEADER: usize = 10;
const CHECKSUM: usize = 2;
const INCOMPAT: usize = 2;
const SIGNED: u8 = 0x01;
/// Link id and timestamp.
const STAMP: usize = 7;

/// 2015-01-01 in the time of Unix.
const EPOCH_US: u64 = 1_420_070_400_000_000;
const UNIT_US: u64 = 10;
const MINUTE: u64 = 6_000_000;
/// The next timestamp is stored this long before the stored one is reached.
const STORE_AHEAD: u64 = 500_000;

/// A key. Its bytes are never shown.
#[derive(Clone, PartialEq, Eq)]
pub struct Key([u8; 32]);

impl Key {
    /// A key; `None` for 32 zeros, which mean no key.
    // Here and below: inlined into code that is made fast, small code becomes long code.
    #[must_use]
    #[inline(never)]
    pub const fn new(bytes: [u8; 32]) -> Option<Self> {
        let mut index = 0;
        while index < bytes.len() {
            if bytes[index] != 0 {
                return Some(Self(bytes));
            }
            index += 1;
        }
        None
    }

    /// Its bytes, only for storing it.
    #[must_use]
    pub const fn secret(&self) -> &[u8; 32] {
        &self.0
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(..)")
    }
}

/// The result of checking a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Signed with our key, and new.
    Valid,
    /// Not signed: see [`Unsigned`].
    Unsigned,
    /// Not a whole frame of MAVLink 2, or one with unknown flags.
    Malformed,
    /// Signed with another key, or changed in transit.
    WrongSignature,
    /// Validly signed, and not newer than the last frame of its stream.
    Replayed,
    /// Validly signed, of a new stream, and more than a minute behind us.
    TooOld,
    /// Validly signed and new, but all streams that there is space for were active within a minute.
    TooManyStreams,
}

/// The last timestamp of a sender on one of its links.
#[derive(Clone, Copy, Debug)]
struct Stream {
    /// System, component, link id.
    name: [u8; 3],
    /// Little-endian; 0 for no stream.
    last: [u8; 6],
}

impl Stream {
    fn last(&self) -> u64 {
        timestamp(self.last)
    }
}

/// The state of signing under one key.
///
/// ```
/// use foxhound_core::base::time::Instant;
/// use foxhound_link::dialect::{HEARTBEAT_DATA, MavMessage};
/// use foxhound_link::framer::{FRAME_MAX, Header, encode};
/// use foxhound_link::signing::{Key, Signing, Verdict};
///
/// let key = Key::new([7; 32]).expect("not all zeros");
/// let (mut ours, mut theirs) = (Signing::new(key.clone(), 0), Signing::new(key, 0));
/// let mut frame = [0; FRAME_MAX];
/// let length = encode(Header::default(), &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()), &mut frame);
/// let signed = ours.sign(Instant(0), &mut frame, length);
/// assert_eq!(theirs.check(Instant(0), &frame[..signed]), Verdict::Valid);
/// assert_eq!(theirs.check(Instant(0), &frame[..signed]), Verdict::Replayed);
/// ```
#[derive(Clone, Debug)]
pub struct Signing {
    key: Key,
    link_id: u8,
    streams: [Stream; STREAMS],
    /// The greatest timestamp that was signed, accepted or restored.
    last: u64,
    /// Timestamp of `Instant(0)` by the best clock.
    start: i64,
    /// The last timestamp that was returned to be stored.
    stored: u64,
}

impl Signing {
    /// Signs with a key, under the id of one of our links.
    #[must_use]
    pub const fn new(key: Key, link_id: u8) -> Self {
        Self { key, link_id, streams: [Stream { name: [0; 3], last: [0; 6] }; STREAMS], last: 0, start: 0, stored: 0 }
    }

    /// The key, to be stored.
    #[must_use]
    pub const fn key(&self) -> &Key {
        &self.key
    }

    /// Continues from a stored timestamp; call it before the first frame.
    #[inline(never)]
    pub fn restore(&mut self, now: Instant, stored: u64) {
        let stored = stored.min(TIMESTAMP_MAX);
        self.last = self.last.max(stored);
        self.set_forward(now, stored);
    }

    /// Sets the time of day, in microseconds since 1970 UTC. A clock that is behind us changes nothing. Signing is only
    /// as sound as the source of this time, which must not be an unsigned message.
    #[inline(never)]
    pub fn set_clock(&mut self, now: Instant, unix_us: u64) {
        self.set_forward(now, (unix_us.saturating_sub(EPOCH_US) / UNIT_US).min(TIMESTAMP_MAX));
    }

    /// A timestamp to be stored now, if that is due: every 55 seconds, and when the time was set forward. Call it
    /// before frames are signed, and have it written within five seconds.
    #[inline(never)]
    pub fn timestamp_to_store(&mut self, now: Instant) -> Option<u64> {
        let due = (self.time(now) + STORE_AHEAD).min(TIMESTAMP_MAX);
        if due <= self.stored {
            return None;
        }
        self.stored = (self.time(now) + MINUTE).min(TIMESTAMP_MAX);
        Some(self.stored)
    }

    /// Signs the unsigned frame in the first `length` bytes of `buffer` and returns its new length. Returns 0 and
    /// changes nothing when it is not such a frame, when [`SIGNATURE`] more bytes do not fit, or when the last
    /// timestamp is used up: then the frame must not be sent.
    #[inline(never)]
    pub fn sign(&mut self, now: Instant, buffer: &mut [u8], length: usize) -> usize {
        let Some(Shape { body, signed: false }) = buffer.get(..length).and_then(Shape::of) else {
            return 0;
        };
        let timestamp = self.reading(now).max(self.last + 1);
        let Some(frame) = buffer.get_mut(..length + SIGNATURE).filter(|_| timestamp <= TIMESTAMP_MAX) else {
            return 0;
        };
        self.last = timestamp;
        // The checksum is linear: what the flag changes in it does not depend on the message's CRC_EXTRA.
        let checksum = |frame: &[u8]| calculate_crc(frame.get(1..body).unwrap_or_default(), 0);
        let before = checksum(frame);
        if let Some(flags) = frame.get_mut(INCOMPAT) {
            *flags |= SIGNED;
        }
        let difference = (before ^ checksum(frame)).to_le_bytes();
        for (byte, difference) in frame.iter_mut().skip(body).zip(difference) {
            *byte ^= difference;
        }
        let [t0, t1, t2, t3, t4, t5, ..] = timestamp.to_le_bytes();
        let stamp = [self.link_id, t0, t1, t2, t3, t4, t5];
        fill(frame.get_mut(length..).unwrap_or_default(), &stamp);
        let signature = self.signature(frame.get(..length + STAMP).unwrap_or_default());
        fill(frame.get_mut(length + STAMP..).unwrap_or_default(), &signature);
        length + SIGNATURE
    }

    /// Checks a frame whose checksum is right. One that is [`Verdict::Valid`] now will not be so again.
    #[inline(never)]
    pub fn check(&mut self, now: Instant, frame: &[u8]) -> Verdict {
        match Shape::of(frame) {
            None => return Verdict::Malformed,
            Some(Shape { signed: false, .. }) => return Verdict::Unsigned,
            Some(_) => {}
        }
        let Some((content, signature)) = frame.split_last_chunk::<{ SIGNATURE - STAMP }>() else {
            return Verdict::Malformed;
        };
        let difference = self.signature(content).iter().zip(signature).fold(0, |sum, (ours, its)| sum | (ours ^ its));
        if difference != 0 {
            return Verdict::WrongSignature;
        }
        let &[.., link_id, t0, t1, t2, t3, t4, t5] = content else { return Verdict::Malformed };
        self.follow(now, [frame[5], frame[6], link_id], [t0, t1, t2, t3, t4, t5])
    }

    /// Compares the timestamp of a valid signature with those of its stream.
    fn follow(&mut self, now: Instant, name: [u8; 3], stamp: [u8; 6]) -> Verdict {
        let (heard, time) = (timestamp(stamp), self.time(now));
        let known = self.streams.iter_mut().find(|stream| stream.name == name && stream.last() > 0);
        let stream = match known {
            // A timestamp of 0 is behind all others.
            Some(stream) if heard <= stream.last() => return Verdict::Replayed,
            Some(stream) => stream,
            None if heard == 0 || heard + MINUTE < time => return Verdict::TooOld,
            None => match self.streams.iter_mut().min_by_key(|stream| stream.last()) {
                Some(oldest) if oldest.last() == 0 || oldest.last() + MINUTE < time => oldest,
                _ => return Verdict::TooManyStreams,
            },
        };
        *stream = Stream { name, last: stamp };
        // Kept, so that what was too old stays so.
        self.last = time.max(heard);
        self.set_forward(now, heard);
        Verdict::Valid
    }

    #[inline(never)]
    fn signature(&self, content: &[u8]) -> [u8; 6] {
        let hash = Sha256::new().chain_update(self.key.0).chain_update(content).finalize();
        let [a, b, c, d, e, f, ..] = hash.0;
        [a, b, c, d, e, f]
    }

    /// The current timestamp: by the clock, or the last one in use if that is greater.
    #[inline(never)]
    fn time(&self, now: Instant) -> u64 {
        self.reading(now).max(self.last)
    }

    #[inline(never)]
    fn reading(&self, now: Instant) -> u64 {
        u64::try_from(self.start.saturating_add(units(now))).unwrap_or(0).min(TIMESTAMP_MAX)
    }

    #[inline(never)]
    fn set_forward(&mut self, now: Instant, timestamp: u64) {
        // 48 bits.
        self.start = self.start.max(timestamp as i64 - units(now));
    }
}

/// Since `Instant(0)`: a tenth of 64 bits is less than 63.
fn units(now: Instant) -> i64 {
    (now.0 / UNIT_US) as i64
}

#[inline(never)]
fn timestamp([t0, t1, t2, t3, t4, t5]: [u8; 6]) -> u64 {
    u64::from_le_bytes([t0, t1, t2, t3, t4, t5, 0, 0])
}

/// A whole frame.
struct Shape {
    /// Header and payload.
    body: usize,
    signed: bool,
}

impl Shape {
    fn of(frame: &[u8]) -> Option<Self> {
        let &[STX, payload, flags, ..] = frame else { return None };
        let (body, signed) = (HEADER + usize::from(payload), flags & SIGNED != 0);
        let length = body + CHECKSUM + if signed { SIGNATURE } else { 0 };
        (flags & !SIGNED == 0 && frame.len() == length).then_some(Self { body, signed })
    }
}
