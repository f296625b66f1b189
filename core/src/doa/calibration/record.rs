//! The stored form of a calibration: a record of fixed size with a checksum.
//!
//! | bytes | content (little-endian, floats as IEEE 754 single precision) |
//! |---|---|
//! | 0..4 | `FXC1`; the digit is the version of the layout |
//! | 4..8 | number of entries in use, `u32` |
//! | 8..12 | wavelength of the carrier, m |
//! | 12..188 | four entries: frequency Hz, four gains, four phases rad, residual rad, temperature deg C or NaN |
//! | 188..228 | deviation: constant, four cosines, four sines, standard deviation; rad |
//! | 228..232 | CRC-32 of all before (IEEE 802.3: reflected, `0xedb88320`) |

use super::deviation::{Deviation, ORDER};
use crate::base::adc::CHANNELS;
use crate::doa::array::{Entry, TABLE_ENTRIES, Table};

/// Bytes of a record.
pub const RECORD_BYTES: usize = 232;
const MAGIC: [u8; 4] = *b"FXC1";
const CRC_AT: usize = RECORD_BYTES - 4;

/// The stored calibration of an array.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Calibration {
    /// The channels.
    pub table: Table,
    /// The airframe; the default when it has not been measured.
    pub deviation: Deviation,
}

impl Calibration {
    /// The record.
    #[must_use]
    pub fn encode(&self) -> [u8; RECORD_BYTES] {
        let mut record = [0; RECORD_BYTES];
        let (words, _) = record.as_chunks_mut::<4>();
        let entries = self.table.entries();
        let unused = core::iter::repeat_n(Entry::default(), TABLE_ENTRIES - entries.len());
        let d = self.deviation;
        let content = entries.iter().copied().chain(unused).flat_map(|entry| {
            let temperature_c = entry.temperature_c.unwrap_or(f32::NAN);
            let head = core::iter::once(entry.frequency_hz);
            head.chain(entry.gain).chain(entry.phase_rad).chain([entry.residual_rad, temperature_c])
        });
        let deviation = core::iter::once(d.constant_rad).chain(d.cosine_rad).chain(d.sine_rad).chain([d.sigma_rad]);
        let floats = core::iter::once(self.table.wavelength_m()).chain(content).chain(deviation);
        let head = [MAGIC, (entries.len() as u32).to_le_bytes()];
        for (word, bytes) in words.iter_mut().zip(head.into_iter().chain(floats.map(f32::to_le_bytes))) {
            *word = bytes;
        }
        let crc = crc32(&record[..CRC_AT]);
        record[CRC_AT..].copy_from_slice(&crc.to_le_bytes());
        record
    }

    /// The checksum of the record.
    #[must_use]
    pub fn crc(&self) -> u32 {
        crc32(&self.encode()[..CRC_AT])
    }

    /// Reads a record; `None` when it is damaged, of another version, or contains an invalid table.
    #[must_use]
    pub fn decode(record: &[u8; RECORD_BYTES]) -> Option<Self> {
        let (words, _) = record.as_chunks::<4>();
        let mut words = words.iter().copied();
        let magic = words.next()?;
        let count = u32::from_le_bytes(words.next()?) as usize;
        let stored = u32::from_le_bytes(*record.last_chunk()?);
        if magic != MAGIC || crc32(&record[..CRC_AT]) != stored || count > TABLE_ENTRIES {
            return None;
        }
        let mut float = || words.next().map_or(f32::NAN, f32::from_le_bytes);
        let wavelength_m = float();
        let mut entries = [Entry::default(); TABLE_ENTRIES];
        for entry in &mut entries {
            *entry = Entry {
                frequency_hz: float(),
                gain: [(); CHANNELS].map(|()| float()),
                phase_rad: [(); CHANNELS].map(|()| float()),
                residual_rad: float(),
                temperature_c: Some(float()).filter(|temperature_c| !temperature_c.is_nan()),
            };
        }
        let deviation = Deviation {
            constant_rad: float(),
            cosine_rad: [(); ORDER].map(|()| float()),
            sine_rad: [(); ORDER].map(|()| float()),
            sigma_rad: float(),
        };
        let Deviation { constant_rad, cosine_rad, sine_rad, sigma_rad } = &deviation;
        let mut angles_rad = cosine_rad.iter().chain(sine_rad).chain([constant_rad, sigma_rad]);
        if angles_rad.any(|angle_rad| !(libm::fabsf(*angle_rad) <= core::f32::consts::PI)) {
            return None;
        }
        let table = Table::new(wavelength_m, entries.get(..count)?).ok()?;
        Some(Self { table, deviation })
    }
}

/// CRC-32 as in Ethernet and zip, bit by bit: 30 instructions a byte, and no table.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
    !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |crc, _| step(crc)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(frequency_hz: f32, temperature_c: Option<f32>) -> Entry {
        Entry {
            frequency_hz,
            gain: [1.0, 0.7, 1.1, 1.2],
            phase_rad: [0.1, -0.9, 3.0, -2.2],
            residual_rad: 6e-4,
            temperature_c,
        }
    }

    fn calibration() -> Calibration {
        let deviation =
            Deviation { constant_rad: 0.01, cosine_rad: [0.1, 0.2, 0.3, 0.4], sine_rad: [-0.1; 4], sigma_rad: 1e-3 };
        let table = Table::new(0.345, &[entry(14_800.0, Some(21.5)), entry(30_000.0, None)]).unwrap();
        Calibration { table, deviation }
    }

    #[test]
    fn the_check_sum_is_that_of_ethernet_and_zip() {
        // The check value of CRC-32/ISO-HDLC in the catalogue of parametrised CRC algorithms; and zip's of two texts.
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        assert_eq!(crc32(b""), 0);
        assert_eq!(crc32(b"The quick brown fox jumps over the lazy dog"), 0x414f_a339);
    }

    #[test]
    fn a_record_comes_back_as_it_went() {
        for calibration in [
            calibration(),
            Calibration { table: Table::new(0.69, &[entry(5e3, None)]).unwrap(), ..Calibration::default() },
            Calibration {
                table: Table::new(0.125, &[4e3, 5e3, 6e3, 7e3].map(|f| entry(f, Some(f / 1e3)))).unwrap(),
                ..calibration()
            },
        ] {
            assert_eq!(Calibration::decode(&calibration.encode()), Some(calibration));
        }
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let good = calibration().encode();
        for bit in 0..8 * RECORD_BYTES {
            let mut bad = good;
            bad[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Calibration::decode(&bad), None, "bit {bit}");
        }
        assert_eq!(Calibration::decode(&[0; RECORD_BYTES]), None);
        assert_eq!(Calibration::decode(&[0xff; RECORD_BYTES]), None, "erased flash");
    }

    #[test]
    fn a_table_that_could_not_be_is_not_taken_from_a_record_that_is_whole() {
        for (at, word) in [(12, f32::NAN), (8, -1.0), (16, 0.0), (4, f32::from_bits(5)), (4, f32::from_bits(0))] {
            let mut bad = calibration().encode();
            bad[at..at + 4].copy_from_slice(&word.to_le_bytes());
            let crc = crc32(&bad[..CRC_AT]);
            bad[CRC_AT..].copy_from_slice(&crc.to_le_bytes());
            assert_eq!(Calibration::decode(&bad), None, "byte {at}");
        }
        for constant_rad in [f32::NAN, f32::INFINITY, 4.0] {
            let deviation = Deviation { constant_rad, ..calibration().deviation };
            assert_eq!(
                Calibration::decode(&Calibration { deviation, ..calibration() }.encode()),
                None,
                "{constant_rad}"
            );
        }
    }
}
