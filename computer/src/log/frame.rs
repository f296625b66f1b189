//! Frames: how records are stored in a stream of bytes that may begin and end anywhere and contain anything else in
//! between.
//!
//! ```text
//! 0x00  COBS( kind, number (varint), record, CRC-32 )  0x00
//! ```
//!
//! Consistent overhead byte stuffing (Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999) removes the zeros
//! from a frame, at the cost of one byte in 254, so that a zero only stands between frames. The checksum is
//! CRC-32/ISO-HDLC, little-endian, over everything before it. Records are in postcard's format. Frames are numbered
//! from the start, including those that were dropped because the ring was full, so that a reader knows what is
//! missing.
//!
//! A frame is written in place in the ring, and may be written in parts; it needs no other memory.

use crc::{CRC_32_ISO_HDLC, Crc, Digest, Table};
use postcard::ser_flavors::Flavor;
use serde::Serialize;

use super::ring::{Draft, Full, Producer};

const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);
static CHECK: Crc<u32, Table<1>> = CRC;

/// Bytes after the record.
const CRC_BYTES: usize = 4;
/// Longest frame without its stuffing; the samples of an antenna frame are the longest record.
pub const FRAME_MAX: usize = 2048;

/// A frame in progress.
pub(super) struct Open {
    draft: Draft,
    /// Position of the length of the present run.
    code_at: usize,
    /// Its length, plus one.
    code: u8,
    digest: Digest<'static, u32, Table<1>>,
}

impl Open {
    /// Begins a frame; its content follows.
    pub(super) fn begin(ring: &mut Producer<'_>, kind: u8, number: u32) -> Result<Self, Full> {
        let mut draft = ring.draft();
        ring.push(&mut draft, 0)?;
        let code_at = ring.push(&mut draft, 0)?;
        let mut open = Self { draft, code_at, code: 1, digest: CHECK.digest() };
        open.append(ring, &(kind, number))?;
        Ok(open)
    }

    /// Appends a part of the record, serialised.
    pub(super) fn append(&mut self, ring: &mut Producer<'_>, part: &impl Serialize) -> Result<(), Full> {
        postcard::serialize_with_flavor(part, Stuffer { open: self, ring }).map_err(|_| Full)
    }

    /// Appends bytes as they are.
    #[inline(never)]
    pub(super) fn extend(&mut self, ring: &mut Producer<'_>, bytes: &[u8]) -> Result<(), Full> {
        self.digest.update(bytes);
        bytes.iter().try_for_each(|byte| self.stuff(ring, *byte))
    }

    /// Ends the frame; it can be read now.
    #[inline(never)]
    pub(super) fn end(mut self, ring: &mut Producer<'_>) -> Result<(), Full> {
        let check = self.digest.clone().finalize();
        check.to_le_bytes().into_iter().try_for_each(|byte| self.stuff(ring, byte))?;
        ring.set(self.code_at, self.code);
        ring.push(&mut self.draft, 0)?;
        ring.commit(self.draft);
        Ok(())
    }

    /// Removes the zeros from what is written.
    fn stuff(&mut self, ring: &mut Producer<'_>, byte: u8) -> Result<(), Full> {
        if byte != 0 {
            ring.push(&mut self.draft, byte)?;
            self.code += 1;
        }
        if byte == 0 || self.code == u8::MAX {
            ring.set(self.code_at, self.code);
            (self.code_at, self.code) = (ring.push(&mut self.draft, 0)?, 1);
        }
        Ok(())
    }
}

/// The serialiser's output.
struct Stuffer<'o, 'r, 'a> {
    open: &'o mut Open,
    ring: &'r mut Producer<'a>,
}

// Never inlined: the serialiser calls them for every field of every record.
impl Flavor for Stuffer<'_, '_, '_> {
    type Output = ();

    #[inline(never)]
    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.open.extend(self.ring, &[byte]).map_err(|_| postcard::Error::SerializeBufferFull)
    }

    #[inline(never)]
    fn try_extend(&mut self, bytes: &[u8]) -> postcard::Result<()> {
        self.open.extend(self.ring, bytes).map_err(|_| postcard::Error::SerializeBufferFull)
    }

    fn finalize(self) -> postcard::Result<()> {
        Ok(())
    }
}

/// A frame as received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Kind of the record.
    pub kind: u8,
    /// Its number.
    pub number: u32,
    /// The record.
    pub record: &'a [u8],
}

/// Largest number of bytes between a frame's zeros, for `plain` bytes without the stuffing.
#[must_use]
pub const fn stuffed_bytes(plain: usize) -> usize {
    plain + plain / 254 + 2
}

/// Finds the frames of a log.
pub type LogDeframer = Deframer<{ stuffed_bytes(FRAME_MAX) }>;

/// Finds frames of a limited length between their zeros in a stream, which may come in pieces of any size.
#[derive(Debug)]
pub struct Deframer<const BYTES: usize> {
    bytes: [u8; BYTES],
    length: usize,
    /// The bytes since the last zero are more than any frame.
    is_too_long: bool,
    /// Pieces between zeros that were not frames.
    rubbish: u64,
}

impl<const BYTES: usize> Deframer<BYTES> {
    /// Before the first byte.
    #[must_use]
    pub const fn new() -> Self {
        Self { bytes: [0; BYTES], length: 0, is_too_long: false, rubbish: 0 }
    }

    /// Whether the bytes since the last zero are more than any frame.
    #[must_use]
    pub const fn is_too_long(&self) -> bool {
        self.is_too_long
    }

    /// Whether there are bytes since the last zero.
    #[must_use]
    pub const fn is_inside(&self) -> bool {
        self.length > 0
    }

    /// Forgets the bytes since the last zero.
    pub fn clear(&mut self) {
        (self.length, self.is_too_long) = (0, false);
    }

    /// Takes a byte; returns the frame that it ends, if any.
    pub fn push(&mut self, byte: u8) -> Option<Frame<'_>> {
        if byte != 0 {
            match self.bytes.get_mut(self.length) {
                Some(free) => (*free, self.length) = (byte, self.length + 1),
                None => self.is_too_long = true,
            }
            return None;
        }
        let (length, is_too_long) = (core::mem::take(&mut self.length), core::mem::take(&mut self.is_too_long));
        if length == 0 {
            return None;
        }
        let frame = self.bytes.get_mut(..length).filter(|_| !is_too_long).and_then(read);
        if frame.is_none() {
            self.rubbish = self.rubbish.saturating_add(1);
        }
        frame
    }

    /// Pieces between zeros that were not frames.
    #[must_use]
    pub const fn rubbish(&self) -> u64 {
        self.rubbish
    }
}

impl<const BYTES: usize> Default for Deframer<BYTES> {
    fn default() -> Self {
        Self::new()
    }
}

/// The frame in these bytes, between zeros.
fn read(stuffed: &mut [u8]) -> Option<Frame<'_>> {
    let length = unstuff(stuffed)?;
    let (bytes, check) = stuffed.get(..length)?.split_last_chunk::<CRC_BYTES>()?;
    if CHECK.checksum(bytes) != u32::from_le_bytes(*check) {
        return None;
    }
    let ((kind, number), record) = postcard::take_from_bytes::<(u8, u32)>(bytes).ok()?;
    Some(Frame { kind, number, record })
}

/// Removes the stuffing in place; returns the new length. This cannot panic, which `cobs` does not guarantee: camera
/// frames are read in flight.
fn unstuff(bytes: &mut [u8]) -> Option<usize> {
    let (mut from, mut to) = (0, 0);
    while let Some(code) = bytes.get(from).copied() {
        let next = from + usize::from(code.max(1));
        for at in from + 1..next {
            *bytes.get_mut(to)? = bytes.get(at).copied()?;
            to += 1;
        }
        if code < 0xff && next < bytes.len() {
            *bytes.get_mut(to)? = 0;
            to += 1;
        }
        from = next;
    }
    Some(to)
}

#[cfg(test)]
mod tests {
    use super::super::ring::Ring;
    use super::*;
    use rand_core::{Rng as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use std::vec::Vec;

    fn written(kind: u8, number: u32, record: &[u8]) -> Vec<u8> {
        let mut ring = Ring::<4096>::new();
        let (mut producer, mut consumer) = ring.ends();
        let mut open = Open::begin(&mut producer, kind, number).unwrap();
        open.append(&mut producer, &record).unwrap();
        open.end(&mut producer).unwrap();
        let mut bytes = std::vec![0; 4096];
        let length = consumer.read(&mut bytes);
        bytes.truncate(length);
        bytes
    }

    /// Records of every length about those at which the stuffing turns over, with many zeros and with none.
    fn records() -> impl Iterator<Item = Vec<u8>> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(9);
        let lengths = (0..20).chain(230..270).chain(490..520).chain([1000, 2000]);
        lengths.flat_map(|length| [1, 3, 200].map(|of| (length, of))).map(move |(length, of)| {
            (0..length)
                .map(|_| if of > 1 && random.next_u32() % of == 0 { 0 } else { random.next_u32() as u8 | 1 })
                .collect()
        })
    }

    #[test]
    fn another_implementation_reads_the_stuffing_and_the_checksum() {
        for (number, record) in (0..).zip(records()) {
            let frame = written(7, number, &record);
            let [0, stuffed @ .., 0] = &frame[..] else { panic!("no zeros around it") };
            assert!(!stuffed.contains(&0));
            let mut plain = [0; 3000];
            let plain = &*postcard::to_slice(&(7_u8, number, &record[..]), &mut plain).unwrap();
            let check = foxhound_core::doa::calibration::record::crc32(plain);
            let mut read = std::vec![0; stuffed.len()];
            let length = cobs::decode(stuffed, &mut read).unwrap().frame_size();
            assert_eq!(read[..length], [plain, &check.to_le_bytes()].concat());
        }
    }

    #[test]
    fn the_stuffing_is_taken_out_as_another_implementation_does_it_or_refused_as_there() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
        let (mut good, mut bad) = (0, 0);
        for round in 0..20_000_u32 {
            let length = 1 + random.next_u32() as usize % 600;
            // Short runs, any runs, long ones; some of them end where the bytes do.
            let most = [8, 255, 1000][round as usize % 3];
            let stuffed: Vec<u8> = (0..length).map(|_| (1 + random.next_u32() % most).min(255) as u8).collect();
            let (mut ours, mut theirs) = (stuffed.clone(), stuffed);
            let found = unstuff(&mut ours).map(|length| ours[..length].to_vec());
            let expected = cobs::decode_in_place(&mut theirs).ok().map(|length| theirs[..length].to_vec());
            assert_eq!(found, expected, "{round}");
            (good, bad) = if found.is_some() { (good + 1, bad) } else { (good, bad + 1) };
        }
        assert!(good > 500 && bad > 500, "{good} {bad}");
        assert_eq!(unstuff(&mut []), Some(0));
    }

    #[test]
    fn frames_are_found_among_anything_and_a_damaged_one_is_none() {
        let mut deframer = LogDeframer::new();
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut rubbish = 0;
        for (number, record) in (0..).zip(records()) {
            let frame = written(1, number, &record);
            // Whatever stood on the line before.
            let noise: Vec<u8> = (0..random.next_u32() % 4000).map(|_| random.next_u32() as u8 | 1).collect();
            assert!(noise.iter().all(|byte| deframer.push(*byte).is_none()));
            rubbish += u64::from(!noise.is_empty());
            let mut found = None;
            for byte in &frame {
                if let Some(Frame { kind, number, record }) = deframer.push(*byte) {
                    found = Some((kind, number, postcard::from_bytes::<&[u8]>(record).unwrap().to_vec()));
                }
            }
            assert_eq!(found, Some((1, number, record)));
            let bit = random.next_u32() as usize % (8 * (frame.len() - 2)) + 8;
            let mut damaged = frame;
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(damaged.iter().all(|byte| deframer.push(*byte).is_none()));
        }
        assert!(deframer.rubbish() > rubbish);
    }

    #[test]
    fn any_bytes_end_in_frames_or_rubbish() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut deframer = LogDeframer::new();
        for round in 0..300_000_u32 {
            let word = random.next_u32();
            // Stretches with few zeros and with many.
            let byte = if word % (2 + round / 3000 % 90) == 0 { 0 } else { (word >> 8) as u8 };
            assert!(deframer.push(byte).is_none(), "a checksum of 32 bits by chance");
        }
        assert!(deframer.rubbish() > 1000);
    }
}
