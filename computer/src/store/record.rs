//! The content of records, byte by byte, little-endian. The map adds a CRC-32 to each.
//!
//! Each begins with its number, 2 bytes: the records of one kind count up (0 for the starts, which have none). Then:
//!
//! | record | bytes |
//! |---|---|
//! | any that was removed | 0 |
//! | parameters | 1; for each a hash of its name and its value, 4 bytes each |
//! | calibration | as in [`foxhound_core::doa::calibration::record`] |
//! | key | 1; 32 bytes |
//! | timestamp | 1; CRC-32 of the key that it belongs to; 6 bytes |
//! | starts | 2; count, 4 bytes; the number of the newest record of each name, 2 bytes each, 0 where there never was one |
//!
//! The first byte of these is the version of the format. Parameters are identified by a hash of their names (FNV-1a,
//! 32 bits): a firmware with other parameters, or the same in another order, reads those that it knows. No two names
//! of the table have the same hash (a test).

use foxhound_core::base::units::between;
use foxhound_core::doa::calibration::record::{RECORD_BYTES, crc32};
use foxhound_core::guidance::param::{COUNT, Id, Values};
use sequential_storage::map::{SerializationError, Value};

use super::{NAMES, Name};

/// Largest number of parameters.
const PARAMETERS_MAX: usize = 70;
/// The longest record and its key, in whole words.
pub(super) const RECORD_MAX: usize = (4 + 8 * PARAMETERS_MAX).next_multiple_of(8);
const _: () = assert!(COUNT <= PARAMETERS_MAX && 3 + RECORD_BYTES <= RECORD_MAX, "the records have room");

const GONE: u8 = 0;
const VERSION: u8 = 1;
const STARTS_VERSION: u8 = 2;

/// Content to be written.
#[derive(Clone, Copy, Debug)]
pub(super) enum Content<'a> {
    /// Removed.
    Gone,
    /// Parameters.
    Parameters(&'a Values),
    /// A calibration, which contains its version.
    Calibration(&'a [u8; RECORD_BYTES]),
    /// Bytes after the version.
    Bytes(&'a [u8]),
    /// The count of starts, and the marks.
    Starts(&'a [u8; STARTS_BYTES]),
}

/// A record: its number, and its content.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record<'a>(pub(super) u16, pub(super) Content<'a>);

impl Record<'_> {
    /// The bytes, one after the other.
    fn bytes(&self) -> impl Iterator<Item = u8> {
        self.0.to_le_bytes().into_iter().chain(self.1.bytes())
    }

    /// Whether that is what was read.
    pub(super) fn is(&self, read: &[u8]) -> bool {
        self.bytes().eq(read.iter().copied())
    }
}

/// The number and the content of a record that was read.
pub(super) fn numbered(read: &[u8]) -> Option<(u16, &[u8])> {
    read.split_first_chunk().map(|(number, held)| (u16::from_le_bytes(*number), held))
}

/// The number of the next record; 0 is not used.
pub(super) const fn next(number: u16) -> u16 {
    if number == u16::MAX { 1 } else { number + 1 }
}

/// Whether a record is older than another one. They are never so far apart that the order is ambiguous: the flash has
/// space for only hundreds.
pub(super) const fn is_older(number: u16, than: u16) -> bool {
    (number.wrapping_sub(than) as i16) < 0
}

impl Content<'_> {
    /// The bytes, one after the other.
    fn bytes(&self) -> impl Iterator<Item = u8> {
        let (first, bytes, values) = match *self {
            Self::Gone => (Some(GONE), &[][..], None),
            Self::Parameters(values) => (Some(VERSION), &[][..], Some(values)),
            Self::Calibration(record) => (None, &record[..], None),
            Self::Bytes(bytes) => (Some(VERSION), bytes, None),
            Self::Starts(bytes) => (Some(STARTS_VERSION), &bytes[..], None),
        };
        let entry = |(id, values): (Id, &Values)| {
            let ([a, b, c, d], [e, f, g, h]) = (hash(id).to_le_bytes(), values.get(id).to_le_bytes());
            [a, b, c, d, e, f, g, h]
        };
        let parameters = values.into_iter().flat_map(move |values| Id::all().map(move |id| (id, values)));
        first.into_iter().chain(bytes.iter().copied()).chain(parameters.flat_map(entry))
    }
}

/// For the map, which needs one type for reading and writing.
impl<'a> Value<'a> for Record<'_> {
    fn serialize_into(&self, buffer: &mut [u8]) -> Result<usize, SerializationError> {
        let mut count = 0;
        for byte in self.bytes() {
            *buffer.get_mut(count).ok_or(SerializationError::BufferTooSmall)? = byte;
            count += 1;
        }
        Ok(count)
    }

    fn deserialize_from(_: &'a [u8]) -> Result<(Self, usize), SerializationError> {
        Err(SerializationError::InvalidFormat)
    }
}

/// The bytes after the version; `None` for another format.
fn body(record: &[u8]) -> Option<&[u8]> {
    record.split_first().filter(|(version, _)| **version == VERSION).map(|(_, body)| body)
}

/// Whether the record was removed.
pub(super) fn is_gone(record: &[u8]) -> bool {
    record == [GONE]
}

fn hash(id: Id) -> u32 {
    let name = id.padded_name().iter().take_while(|byte| **byte != 0);
    name.fold(0x811C_9DC5, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}

/// Restored parameters, and how many could not be used as stored: unknown by now, or out of their range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Restored {
    /// The values, with defaults for those not stored.
    pub values: Values,
    /// Number of those dropped.
    pub dropped: u8,
}

pub(super) fn parameters(record: &[u8]) -> Option<Restored> {
    let mut restored = Restored { values: Values::DEFAULT, dropped: 0 };
    let (entries, rest) = body(record)?.as_chunks::<8>();
    for &[a, b, c, d, value @ ..] in entries {
        let kept = u32::from_le_bytes([a, b, c, d]);
        let id = Id::all().find(|id| hash(*id) == kept);
        let value = f32::from_le_bytes(value);
        let is_taken = id.is_some_and(|id| restored.values.set(id, value).is_ok());
        if let Some(id) = id.filter(|id| !is_taken && !id.is_whole()) {
            // Its range was wider once: the nearest to what was wanted. What is no number stays the default, and so does a choice.
            let (min, max) = id.range();
            let _ = restored.values.set(id, between(value, min, max));
        }
        restored.dropped = restored.dropped.saturating_add(u8::from(!is_taken));
    }
    rest.is_empty().then_some(restored)
}

pub(super) fn key(record: &[u8]) -> Option<[u8; 32]> {
    body(record)?.try_into().ok()
}

pub(super) fn timestamp_record(key: &[u8; 32], timestamp: u64) -> [u8; 10] {
    let ([a, b, c, d], [t0, t1, t2, t3, t4, t5, ..]) = (crc32(key).to_le_bytes(), timestamp.to_le_bytes());
    [a, b, c, d, t0, t1, t2, t3, t4, t5]
}

/// The timestamp, if it belongs to this key.
pub(super) fn timestamp(record: &[u8], key: &[u8; 32]) -> Option<u64> {
    let &[a, b, c, d, t0, t1, t2, t3, t4, t5] = body(record)? else { return None };
    let timestamp = u64::from_le_bytes([t0, t1, t2, t3, t4, t5, 0, 0]);
    (u32::from_le_bytes([a, b, c, d]) == crc32(key)).then_some(timestamp)
}

/// Bytes of a count of starts after its version.
const STARTS_BYTES: usize = 4 + 2 * NAMES;

/// How often the computer was started, and the number of the newest record of each name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Starts {
    pub(super) count: u32,
    pub(super) marks: [u16; NAMES],
}

impl Starts {
    /// The mark of a name.
    pub(super) const fn mark(&mut self, name: Name) -> &mut u16 {
        let [parameters, calibration, key, timestamp] = &mut self.marks;
        match name {
            Name::Parameters => parameters,
            Name::Calibration => calibration,
            Name::Key => key,
            Name::Timestamp => timestamp,
        }
    }

    pub(super) fn encode(self) -> [u8; STARTS_BYTES] {
        let mut bytes = [0; STARTS_BYTES];
        let (count, marks) = bytes.split_at_mut(4);
        count.copy_from_slice(&self.count.to_le_bytes());
        for (bytes, mark) in marks.as_chunks_mut().0.iter_mut().zip(self.marks) {
            *bytes = mark.to_le_bytes();
        }
        bytes
    }

    pub(super) fn decode(record: &[u8]) -> Option<Self> {
        let (version, bytes) = record.split_first()?;
        let bytes: &[u8; STARTS_BYTES] = bytes.try_into().ok().filter(|_| *version == STARTS_VERSION)?;
        let (count, marks) = bytes.split_first_chunk()?;
        let mut starts = Self { count: u32::from_le_bytes(*count), marks: [0; NAMES] };
        for (mark, bytes) in starts.marks.iter_mut().zip(marks.as_chunks().0) {
            *mark = u16::from_le_bytes(*bytes);
        }
        Some(starts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::guidance::param;
    use std::vec::Vec;

    #[test]
    fn no_two_parameters_have_the_same_hash() {
        let mut hashes: Vec<u32> = Id::all().map(hash).collect();
        hashes.sort_unstable();
        hashes.dedup();
        assert_eq!(hashes.len(), COUNT);
    }

    #[test]
    fn the_hash_is_fnv_1a() {
        // The published vectors of FNV-1a have no name of ours; this one was computed separately, in Python.
        assert_eq!(hash(param::FH_SPD_MAX), 0xE346_3DDC);
    }

    #[test]
    fn a_store_of_another_firmware_gives_what_is_known_and_counts_the_rest() {
        let mut values = Values::DEFAULT;
        values.set(param::FH_RADIUS, 0.4).unwrap();
        let mut record: Vec<u8> = Content::Parameters(&values).bytes().collect();
        assert_eq!(parameters(&record), Some(Restored { values, dropped: 0 }));
        // A newer one had a parameter more, in front of ours, and allowed more speed.
        let tail = record.split_off(1);
        record.extend([1, 2, 3, 4, 0, 0, 0x80, 0x3f]);
        record.extend(tail);
        record[13..17].copy_from_slice(&1e9_f32.to_le_bytes());
        values.set(param::FH_SPD_MAX, param::FH_SPD_MAX.range().1).unwrap();
        assert_eq!(parameters(&record), Some(Restored { values, dropped: 2 }), "the nearest");
        record[13..17].copy_from_slice(&f32::NAN.to_le_bytes());
        values.set(param::FH_SPD_MAX, param::FH_SPD_MAX.default()).unwrap();
        assert_eq!(parameters(&record), Some(Restored { values, dropped: 2 }));
        // An older one had fewer.
        record.truncate(1 + 8);
        assert_eq!(parameters(&record), Some(Restored { values: Values::DEFAULT, dropped: 1 }));
        record[0] = 2;
        assert_eq!(parameters(&record), None, "another format");
        assert_eq!(parameters(&[1, 0]), None, "cut off");
    }

    #[test]
    fn numbers_go_round_without_zero_and_the_older_one_is_told_wherever_they_are() {
        for (older, newer) in [(1, 2), (0x7ffe, 0x8001), (u16::MAX, 1), (u16::MAX - 3, 300), (0, 1)] {
            assert!(is_older(older, newer) && !is_older(newer, older) && !is_older(newer, newer));
        }
        assert_eq!((next(0), next(7), next(u16::MAX)), (1, 8, 1));
    }

    #[test]
    fn the_count_of_starts_comes_back_with_its_marks() {
        let starts = Starts { count: 70_000, marks: [1, 0, 65_535, 258] };
        let bytes: Vec<u8> = Content::Starts(&starts.encode()).bytes().collect();
        assert_eq!(Starts::decode(&bytes), Some(starts));
        assert_eq!(Starts::decode(&bytes[..bytes.len() - 1]), None);
    }

    #[test]
    fn a_timestamp_belongs_to_its_key() {
        let record = timestamp_record(&[7; 32], 0x0102_0304_0506);
        let record: Vec<u8> = Content::Bytes(&record).bytes().collect();
        assert_eq!(timestamp(&record, &[7; 32]), Some(0x0102_0304_0506));
        assert_eq!(timestamp(&record, &[8; 32]), None);
    }
}
