//! Frames: four coherent channels of signed 12-bit samples, taken at the same instants.
//!
//! The samples are centred (midscale subtracted), -2048..=2047. Samples at either rail are counted as clipped.

#![deny(clippy::float_arithmetic)]

use crate::base::time::Instant;

/// Antenna channels of one frame. Channel `i` is antenna `A(i+1)` of the main paper's square: front-right,
/// front-left, back-left, back-right.
pub const CHANNELS: usize = 4;
/// Largest number of antennas of an array with another receiver than our own AD converters: behind a switch, or with
/// complex samples.
pub const ANTENNAS_MAX: usize = 8;

/// Smallest sample of the converter after centring.
pub const CODE_MIN: i16 = -2048;
/// Largest sample of the converter after centring.
pub const CODE_MAX: i16 = 2047;

/// `N` simultaneous samples of four channels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdcFrame<const N: usize> {
    /// The middle of the block: halfway between the first and the last sample.
    pub time: Instant,
    /// Signed 12-bit samples, one row per channel.
    pub codes: [[i16; N]; CHANNELS],
}

impl<const N: usize> AdcFrame<N> {
    /// A frame of zeros.
    #[must_use]
    pub const fn zeroed() -> Self {
        Self { time: Instant(0), codes: [[0; N]; CHANNELS] }
    }

    /// Fills the frame from the converters' unsigned right-aligned 12-bit results (0..=4095), channel by channel.
    pub fn fill_from_unsigned(&mut self, time: Instant, raw: [impl Iterator<Item = u16>; CHANNELS]) {
        self.time = time;
        for (row, source) in self.codes.iter_mut().zip(raw) {
            for (code, value) in row.iter_mut().zip(source) {
                *code = (value & 0x0fff) as i16 + CODE_MIN;
            }
        }
    }

    /// Samples at a rail, per channel.
    #[must_use]
    pub fn clip_count(&self) -> [u16; CHANNELS] {
        self.codes.each_ref().map(|row| row.iter().map(|code| u16::from(*code <= CODE_MIN || *code >= CODE_MAX)).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unsigned_codes_are_centred_and_rails_are_counted() {
        let mut frame = AdcFrame::<64>::zeroed();
        let mut raw = [[2048_u16; 64]; 4];
        raw[1][3] = 0;
        raw[1][4] = 4095;
        raw[2][0] = 0xf000 | 4095;
        frame.fill_from_unsigned(Instant(9), raw.map(<[u16; 64]>::into_iter));
        assert_eq!(frame.codes[0], [0; 64]);
        assert_eq!((frame.codes[1][3], frame.codes[1][4]), (CODE_MIN, CODE_MAX));
        assert_eq!(frame.clip_count(), [0, 2, 1, 0]);
        assert_eq!(frame.time, Instant(9));
    }
}
