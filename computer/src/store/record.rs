//! What the records hold, byte by byte; everything is little-endian. The map adds a CRC-32 to each.
//!
//! | record | bytes |
//! |---|---|
//! | any that was taken away | 0 |
//! | parameters | 1; for each a hash of its name and its value, 4 bytes each |
//! | calibration | as in [`foxhound_core::calibration::record`] |
//! | key | 1; 32 bytes |
//! | timestamp | 1; CRC-32 of the key that it belongs to; 6 bytes |
//! | starts | 1; which records were ever kept, a bit each; count, 4 bytes |
//!
//! The first byte is the version of the format. Parameters go by their names, of which only a hash (FNV-1a, 32 bits) is kept:
//! a firmware with other parameters, or the same in another order, takes out of them what it knows. No two names of the
//! table have the same hash (a test).

use foxhound_core::calibration::record::{RECORD_BYTES, crc32};
use foxhound_core::param::{COUNT, Id, Values};
use sequential_storage::map::{SerializationError, Value};

/// Parameters that there is room for.
const PARAMETERS_MAX: usize = 70;
/// The longest record and its key, in whole words.
pub(super) const RECORD_MAX: usize = (2 + 8 * PARAMETERS_MAX).next_multiple_of(8);
const _: () = assert!(COUNT <= PARAMETERS_MAX && RECORD_BYTES < RECORD_MAX, "the records have room");

const GONE: u8 = 0;
const VERSION: u8 = 1;

/// What is to be written.
#[derive(Clone, Copy, Debug)]
pub(super) enum Content<'a> {
    /// Nothing any more.
    Gone,
    /// Parameters.
    Parameters(&'a Values),
    /// A calibration, which brings its version along.
    Calibration(&'a [u8; RECORD_BYTES]),
    /// Bytes behind the version.
    Bytes(&'a [u8]),
}

impl Content<'_> {
    /// The bytes, one after the other.
    fn bytes(&self) -> impl Iterator<Item = u8> {
        let (first, bytes, values) = match *self {
            Self::Gone => (Some(GONE), &[][..], None),
            Self::Parameters(values) => (Some(VERSION), &[][..], Some(values)),
            Self::Calibration(record) => (None, &record[..], None),
            Self::Bytes(bytes) => (Some(VERSION), bytes, None),
        };
        let entry = |(id, values): (Id, &Values)| {
            let ([a, b, c, d], [e, f, g, h]) = (hash(id).to_le_bytes(), values.get(id).to_le_bytes());
            [a, b, c, d, e, f, g, h]
        };
        let parameters = values.into_iter().flat_map(move |values| Id::all().map(move |id| (id, values)));
        first.into_iter().chain(bytes.iter().copied()).chain(parameters.flat_map(entry))
    }

    /// Whether that is what was read.
    pub(super) fn is(&self, read: &[u8]) -> bool {
        self.bytes().eq(read.iter().copied())
    }
}

/// For the map, which wants one type for both ways.
impl<'a> Value<'a> for Content<'_> {
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

/// What stands behind the version; `None` for another format.
fn body(record: &[u8]) -> Option<&[u8]> {
    record.split_first().filter(|(version, _)| **version == VERSION).map(|(_, body)| body)
}

/// Whether the record was taken away.
pub(super) fn is_gone(record: &[u8]) -> bool {
    record == [GONE]
}

fn hash(id: Id) -> u32 {
    let name = id.padded_name().iter().take_while(|byte| **byte != 0);
    name.fold(0x811C_9DC5, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}

/// Parameters that were kept, and how many could not be taken: unknown by now, or refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Restored {
    /// The values; what was not kept is its default.
    pub values: Values,
    /// How many were dropped.
    pub dropped: u8,
}

pub(super) fn parameters(record: &[u8]) -> Option<Restored> {
    let mut restored = Restored { values: Values::DEFAULT, dropped: 0 };
    let (entries, rest) = body(record)?.as_chunks::<8>();
    for &[a, b, c, d, value @ ..] in entries {
        let kept = u32::from_le_bytes([a, b, c, d]);
        let id = Id::all().find(|id| hash(*id) == kept);
        let is_taken = id.is_some_and(|id| restored.values.set(id, f32::from_le_bytes(value)).is_ok());
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

/// How often the computer was started, and what was ever kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Starts {
    pub(super) kept: u8,
    pub(super) count: u32,
}

impl Starts {
    pub(super) fn encode(self) -> [u8; 5] {
        let [a, b, c, d] = self.count.to_le_bytes();
        [self.kept, a, b, c, d]
    }

    pub(super) fn decode(record: &[u8]) -> Option<Self> {
        let &[kept, a, b, c, d] = body(record)? else { return None };
        Some(Self { kept, count: u32::from_le_bytes([a, b, c, d]) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::param;
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
        // The published vectors of FNV-1a have no name of ours; this one was computed apart, in Python.
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
        assert_eq!(parameters(&record), Some(Restored { values, dropped: 2 }));
        // An older one had fewer.
        record.truncate(1 + 8);
        assert_eq!(parameters(&record), Some(Restored { values: Values::DEFAULT, dropped: 1 }));
        record[0] = 2;
        assert_eq!(parameters(&record), None, "another format");
        assert_eq!(parameters(&[1, 0]), None, "cut off");
    }

    #[test]
    fn a_timestamp_belongs_to_its_key() {
        let record = timestamp_record(&[7; 32], 0x0102_0304_0506);
        let record: Vec<u8> = Content::Bytes(&record).bytes().collect();
        assert_eq!(timestamp(&record, &[7; 32]), Some(0x0102_0304_0506));
        assert_eq!(timestamp(&record, &[8; 32]), None);
    }
}
