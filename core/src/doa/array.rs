//! The antenna array: the antennas' positions, and the calibration of their channels.
//!
//! Positions are body forward-right (metres, any common offset). The default is the main paper's square (eq. 18-19)
//! in our frame: A1 front-right, A2 front-left, A3 back-left, A4 back-right. Its side is 0.40 wavelength. With half a
//! wavelength, which the paper's eq. 3 allows, opposite directions cannot be distinguished, and close to that noise
//! reverses some bearings.
//!
//! A [`Table`] holds the channels' gains and phases relative to each other, at up to four frequencies. Two
//! frequencies are involved. The table's own is that of the tone in the converters' samples (the intermediate
//! frequency, [`crate::signal::phase::Phasors::frequency_hz`]): filters and sampling delays change the phases with
//! it. The other is the carrier, given by the table's wavelength, on which cables and antennas depend. [`Array::at`]
//! is the array for a tone of a given frequency: between two entries phases and amplitudes are interpolated linearly.

use crate::base::adc::CHANNELS;
use crate::base::error::{ConfigError, Why, check};
use crate::base::math::sqrt;
use crate::base::sort::sort_by_key;
use crate::base::units::{sin_cos, wrap_pi};
use crate::signal::phase::Complex;

/// Shortest side, in wavelengths, that is refused: from here on two opposite directions are indistinguishable.
pub const SIDE_REFUSED: f32 = 0.5;
/// Shortest side, in wavelengths, with a warning.
pub const SIDE_WARNED: f32 = 0.46;

/// Most frequencies that a table holds.
pub const TABLE_ENTRIES: usize = 4;
/// A table is valid this far below its lowest and above its highest frequency, as a share of that frequency; there
/// the nearest entry is used. A tone of 15 kHz may drift by 3.7 kHz: 4 ppm of a carrier of 868 MHz.
pub const FREQUENCY_MARGIN: f32 = 0.25;
/// A table is valid for wavelengths this close to its own, as a share of it: the width of a band for short-range
/// devices.
pub const WAVELENGTH_MARGIN: f32 = 0.01;

/// The channels at one frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Entry {
    /// The tone's frequency in the converters' samples.
    pub frequency_hz: f32,
    /// Amplitude of each channel relative to their mean.
    pub gain: [f32; CHANNELS],
    /// Phase of each channel relative to their common phase.
    pub phase_rad: [f32; CHANNELS],
    /// Remaining standard deviation of a channel's phase after correction.
    pub residual_rad: f32,
    /// Temperature of the receiver when it was measured.
    pub temperature_c: Option<f32>,
}

/// Calibration of the channels, frequency by frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Table {
    wavelength_m: f32,
    /// By rising frequency; the first `count` are in use.
    entries: [Entry; TABLE_ENTRIES],
    count: u8,
}

impl Table {
    /// A table that is valid nowhere: it stands for a damaged one.
    pub const EMPTY: Self = {
        let nothing = Entry {
            frequency_hz: 0.0,
            gain: [0.0; CHANNELS],
            phase_rad: [0.0; CHANNELS],
            residual_rad: 0.0,
            temperature_c: None,
        };
        Self { wavelength_m: 0.0, entries: [nothing; TABLE_ENTRIES], count: 0 }
    };

    /// A table for one carrier, from one to four entries in any order.
    ///
    /// # Errors
    /// `calibration.wavelength_m` outside 1 mm..10 m; `calibration.frequency_hz` outside 1 Hz..10 MHz, or twice the same,
    /// or a wrong number of entries; `calibration.gain` outside 0.01..100; `calibration.phase_rad` outside +-100;
    /// `calibration.residual` outside 0..1 rad; `calibration.temperature_c` outside -100..200.
    pub fn new(wavelength_m: f32, entries: &[Entry]) -> Result<Self, ConfigError> {
        check("calibration.wavelength_m", wavelength_m, 1e-3, 10.0)?;
        let mut table = Self { wavelength_m, ..Self::EMPTY };
        let field = "calibration.frequency_hz";
        if entries.is_empty() || entries.len() > TABLE_ENTRIES {
            let why = Why::Inconsistent("a table has one to four frequencies");
            return Err(ConfigError { field, value: entries.len() as f32, why });
        }
        for entry in entries {
            check(field, entry.frequency_hz, 1.0, 1e7)?;
            for (gain, phase_rad) in entry.gain.iter().zip(entry.phase_rad) {
                check("calibration.gain", *gain, 0.01, 100.0)?;
                check("calibration.phase_rad", phase_rad, -100.0, 100.0)?;
            }
            check("calibration.residual", entry.residual_rad, 0.0, 1.0)?;
            check("calibration.temperature_c", entry.temperature_c.unwrap_or(0.0), -100.0, 200.0)?;
            if table.entries().iter().any(|other| other.frequency_hz == entry.frequency_hz) {
                let why = Why::Inconsistent("two entries of a table are for the same frequency");
                return Err(ConfigError { field, value: entry.frequency_hz, why });
            }
            if let Some(free) = table.entries.get_mut(usize::from(table.count)) {
                *free = *entry;
                table.count += 1;
            }
        }
        let count = usize::from(table.count);
        if let Some(used) = table.entries.get_mut(..count) {
            sort_by_key(used, |entry| entry.frequency_hz);
        }
        Ok(table)
    }

    /// The entries, by rising frequency.
    #[must_use]
    pub fn entries(&self) -> &[Entry] {
        self.entries.get(..usize::from(self.count)).unwrap_or_default()
    }

    /// Wavelength of the carrier that it was measured at.
    #[must_use]
    pub fn wavelength_m(&self) -> f32 {
        self.wavelength_m
    }

    /// Whether it is valid for a tone of this frequency: inside the span of its entries, or at most
    /// [`FREQUENCY_MARGIN`] outside.
    #[must_use]
    pub fn covers(&self, frequency_hz: f32) -> bool {
        let [Some(first), Some(last)] = [self.entries().first(), self.entries().last()] else { return false };
        frequency_hz >= first.frequency_hz * (1.0 - FREQUENCY_MARGIN)
            && frequency_hz <= last.frequency_hz * (1.0 + FREQUENCY_MARGIN)
    }

    /// The channels at a frequency, interpolated or from the nearest entry; `None` outside the valid range.
    #[must_use]
    pub fn at(&self, frequency_hz: f32) -> Option<Entry> {
        let above = self.entries().iter().position(|entry| entry.frequency_hz > frequency_hz);
        let (a, b) = match above {
            None => return self.entries().last().copied(),
            Some(0) => return self.entries().first().copied(),
            Some(above) => (self.entries().get(above - 1)?, self.entries().get(above)?),
        };
        let share = (frequency_hz - a.frequency_hz) / (b.frequency_hz - a.frequency_hz);
        let turn = phase_steps(a, b);
        Some(Entry {
            frequency_hz,
            gain: core::array::from_fn(|m| a.gain[m] + share * (b.gain[m] - a.gain[m])),
            phase_rad: core::array::from_fn(|m| a.phase_rad[m] + share * turn[m]),
            residual_rad: if a.residual_rad > b.residual_rad { a.residual_rad } else { b.residual_rad },
            temperature_c: None,
        })
    }
}

/// How much each channel's phase changes from one entry to the next, minus their common change; each the short way
/// round.
#[must_use]
pub fn phase_steps(a: &Entry, b: &Entry) -> [f32; CHANNELS] {
    let step = |m: usize| wrap_pi(b.phase_rad[m] - a.phase_rad[m]);
    let common = (0..CHANNELS).fold(Complex::default(), |sum, m| sum.plus(Complex::at(step(m)))).arg();
    core::array::from_fn(|m| wrap_pi(step(m) - common))
}

/// Configuration of the array.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Wavelength of the carrier.
    pub wavelength_m: f32,
    /// Antenna positions, `[forward, right]`.
    pub antennas_m: [[f32; 2]; CHANNELS],
    /// Complex gain of each channel relative to their mean, the same at all frequencies; measured phasors are divided
    /// by it.
    pub channel_gain: Option<[Complex; CHANNELS]>,
    /// The same by frequency, as measured; replaces `channel_gain`. Where it is not valid, no bearing is valid.
    pub calibration: Option<Table>,
    /// Without either of the two, no bearing is valid.
    pub require_calibration: bool,
}

impl Default for Config {
    /// 868 MHz, side 0.40 wavelength.
    fn default() -> Self {
        Self::square(0.345, 0.40 * 0.345)
    }
}

impl Config {
    /// The square array in the paper's order.
    #[must_use]
    pub const fn square(wavelength_m: f32, side_m: f32) -> Self {
        let h = side_m / 2.0;
        Self {
            wavelength_m,
            antennas_m: [[h, h], [h, -h], [-h, -h], [-h, h]],
            channel_gain: None,
            calibration: None,
            require_calibration: false,
        }
    }

    /// Checks the geometry.
    ///
    /// # Errors
    /// `wavelength_m` outside 1 mm..10 m; `side_m` where two neighbours are 0.5 wavelength or more apart or closer than
    /// 0.02; `antennas_m` where the positions are not finite or lie on one line; `channel_gain` that is zero or not finite.
    pub fn build(&self) -> Result<Array, ConfigError> {
        let wavelength_m = check("wavelength_m", self.wavelength_m, 1e-3, 10.0)?;
        for coordinate in self.antennas_m.iter().flatten() {
            check("antennas_m", *coordinate, -10.0, 10.0)?;
        }
        let mean = |axis: usize| self.antennas_m.iter().map(|p| p[axis]).sum::<f32>() / CHANNELS as f32;
        let centre = [mean(0), mean(1)];
        let wavenumber = core::f32::consts::TAU / wavelength_m;
        let steering = self.antennas_m.map(|p| [wavenumber * (p[0] - centre[0]), wavenumber * (p[1] - centre[1])]);

        // Neighbours around the array, in order: the sides whose length decides about ambiguity.
        let mut side_m = 0.0_f32;
        for (a, b) in self.antennas_m.iter().zip(self.antennas_m.iter().cycle().skip(1)) {
            let length = sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]));
            side_m = if length > side_m { length } else { side_m };
        }
        let side = side_m / wavelength_m;
        if side >= SIDE_REFUSED {
            let why =
                Why::Inconsistent("with antennas half a wavelength or more apart opposite directions are ambiguous");
            return Err(ConfigError { field: "side_m", value: side_m, why });
        }
        if side < 0.02 {
            let why = Why::Inconsistent("antennas closer than 0.02 wavelength measure no angle");
            return Err(ConfigError { field: "side_m", value: side_m, why });
        }
        let [xx, xy, yy] = steering.iter().fold([0.0; 3], |[xx, xy, yy], [x, y]| [xx + x * x, xy + x * y, yy + y * y]);
        if xx * yy - xy * xy < 1e-3 * (xx + yy) * (xx + yy) {
            let why = Why::Inconsistent("antennas on one line cover only half of the circle");
            return Err(ConfigError { field: "antennas_m", value: side_m, why });
        }

        let mut array = Array {
            steering,
            wavenumber,
            closure: closure(&steering),
            side_wavelengths: side,
            correction: [Complex { re: 1.0, im: 0.0 }; CHANNELS],
            residual_rad: 0.0,
            uncalibrated: self.require_calibration,
            table: self.calibration,
        };
        if let Some(table) = self.calibration {
            if !table.entries().is_empty() {
                Table::new(table.wavelength_m, table.entries())?;
            }
            let away_m = libm::fabsf(table.wavelength_m - wavelength_m);
            if away_m > WAVELENGTH_MARGIN * wavelength_m {
                array.table = Some(Table::EMPTY);
            }
            let first_hz = array.table.and_then(|table| table.entries().first().map(|entry| entry.frequency_hz));
            return Ok(array.at(first_hz.unwrap_or(0.0)));
        }
        if let Some(gains) = self.channel_gain {
            for (inverse, gain) in array.correction.iter_mut().zip(gains) {
                let power = check("channel_gain", gain.norm_squared(), 1e-6, 1e6)?;
                *inverse = Complex { re: gain.re / power, im: -gain.im / power };
            }
            array.uncalibrated = false;
        }
        Ok(array)
    }
}

/// The checked array.
///
/// ```
/// use foxhound_core::doa::array::Config;
///
/// assert!(Config::square(0.345, 0.138).build().is_ok());
/// let error = Config::square(0.345, 0.18).build().unwrap_err();
/// assert_eq!(error.field, "side_m", "opposite directions would be ambiguous");
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Array {
    /// Positions relative to their centroid, times the wavenumber, `[forward, right]`: radians of phase per unit of
    /// direction.
    pub steering: [[f32; 2]; CHANNELS],
    /// Free-space wavenumber, radians a metre.
    pub wavenumber: f32,
    /// The one combination of the four phases that is zero for every plane wave; largest element 1. On the square it
    /// is `1, -1, 1, -1`.
    pub closure: [f32; CHANNELS],
    /// Longest distance between neighbours, in wavelengths.
    pub side_wavelengths: f32,
    correction: [Complex; CHANNELS],
    residual_rad: f32,
    uncalibrated: bool,
    table: Option<Table>,
}

/// The null vector of `[1; x; y]`: signed areas of the triangles that remain when one antenna is left out.
fn closure(p: &[[f32; 2]; CHANNELS]) -> [f32; CHANNELS] {
    let area = |a: usize, b: usize, c: usize| {
        (p[b][0] - p[a][0]) * (p[c][1] - p[a][1]) - (p[c][0] - p[a][0]) * (p[b][1] - p[a][1])
    };
    let areas = [area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)];
    let largest = areas.iter().fold(0.0_f32, |a, b| if libm::fabsf(*b) > a { libm::fabsf(*b) } else { a });
    let scale = if areas[0] < 0.0 { -largest } else { largest };
    areas.map(|area| area / scale)
}

impl Array {
    /// The array for a tone of this frequency: corrected by its table, uncalibrated where that is not valid. Without
    /// a table it is the same at all frequencies.
    #[must_use]
    pub fn at(&self, frequency_hz: f32) -> Self {
        let Some(table) = &self.table else { return *self };
        let mut array = *self;
        array.uncalibrated = !table.covers(frequency_hz);
        if let Some(entry) = table.at(frequency_hz) {
            for (m, inverse) in array.correction.iter_mut().enumerate() {
                let (sine, cosine) = sin_cos(entry.phase_rad[m]);
                *inverse = Complex { re: cosine / entry.gain[m], im: -sine / entry.gain[m] };
            }
            array.residual_rad = entry.residual_rad;
        }
        array
    }

    /// Whether [`Self::at`] changes anything.
    #[must_use]
    pub fn depends_on_frequency(&self) -> bool {
        self.table.is_some()
    }

    /// Removes the channels' own gains and phases from a set of phasors.
    #[must_use]
    pub fn correct(&self, z: &[Complex; CHANNELS]) -> [Complex; CHANNELS] {
        core::array::from_fn(|m| z[m].times(self.correction[m]))
    }

    /// Power gain of that correction, by which noise variances grow.
    #[must_use]
    pub fn correction_power(&self, channel: usize) -> f32 {
        self.correction[channel].norm_squared()
    }

    /// Standard deviation of a channel's phase after calibration.
    #[must_use]
    pub fn residual_rad(&self) -> f32 {
        self.residual_rad
    }

    /// Whether a calibration is required and missing, or there is one that is not valid: for another carrier, for
    /// other frequencies, or damaged.
    #[must_use]
    pub fn is_uncalibrated(&self) -> bool {
        self.uncalibrated
    }

    /// Whether the side is so close to half a wavelength that noise reverses some bearings.
    #[must_use]
    pub fn is_nearly_ambiguous(&self) -> bool {
        self.side_wavelengths > SIDE_WARNED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_wavelength_is_refused_by_name() {
        assert_eq!(Config::square(0.345, 0.1725).build().unwrap_err().field, "side_m");
        assert_eq!(Config::square(0.345, 0.5 * 0.345).build().unwrap_err().field, "side_m");
        assert!(Config::square(0.345, 0.49 * 0.345).build().unwrap().is_nearly_ambiguous());
        assert!(!Config::default().build().unwrap().is_nearly_ambiguous());
    }

    #[test]
    fn the_closure_cancels_every_plane_wave() {
        let skewed = [[0.05, 0.06], [0.07, -0.05], [-0.04, -0.06], [-0.06, 0.04]];
        for config in [Config::default(), Config { antennas_m: skewed, ..Config::default() }] {
            let array = config.build().unwrap();
            for (a, b, c) in [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -2.0, 0.7)] {
                let sum: f32 =
                    array.closure.iter().zip(array.steering).map(|(k, p)| k * (a + b * p[0] + c * p[1])).sum();
                assert!(sum.abs() < 1e-5, "{sum}");
            }
        }
        assert_eq!(
            Config::default().build().unwrap().closure.map(|c| (c * 1e4) as i32),
            [10_000, -10_000, 10_000, -10_000]
        );
    }

    #[test]
    fn bad_geometry_is_refused_by_name() {
        assert_eq!(Config::square(f32::NAN, 0.1).build().unwrap_err().field, "wavelength_m");
        assert_eq!(Config::square(0.345, 0.0).build().unwrap_err().field, "side_m");
        assert_eq!(Config::square(0.345, f32::INFINITY).build().unwrap_err().field, "antennas_m");
        let line = Config { antennas_m: [[0.0, 0.0], [0.04, 0.0], [0.08, 0.0], [0.12, 0.0]], ..Config::default() };
        assert_eq!(line.build().unwrap_err().field, "antennas_m");
        let dead = Config { channel_gain: Some([Complex::default(); 4]), ..Config::default() };
        assert_eq!(dead.build().unwrap_err().field, "channel_gain");
    }

    fn entry(frequency_hz: f32, delay_s: [f32; 4], gain: [f32; 4]) -> Entry {
        let phase_rad = delay_s.map(|delay| wrap_pi(0.3 + core::f32::consts::TAU * frequency_hz * delay));
        Entry { frequency_hz, gain, phase_rad, residual_rad: 1e-3, temperature_c: None }
    }

    #[test]
    fn between_two_entries_the_phases_are_those_of_the_delay_and_amplitudes_are_linear() {
        // Up to 0.75 sample: between the entries some phases pass through half a turn.
        let delay_s = [0.0, 7.3e-6, -4.1e-6, 2.2e-6];
        let entries = [entry(44_000.0, delay_s, [1.0, 1.2, 0.8, 1.0]), entry(12_000.0, delay_s, [1.0; 4])];
        let table = Table::new(0.345, &entries).unwrap();
        for k in 0..=40 {
            let frequency_hz = 12_000.0 + 800.0 * k as f32;
            let (found, truth) = (table.at(frequency_hz).unwrap(), entry(frequency_hz, delay_s, [1.0; 4]));
            assert!((found.gain[1] - 1.0 - 0.005 * k as f32).abs() < 1e-5);
            for m in 1..4 {
                let difference = found.phase_rad[m] - found.phase_rad[0] - truth.phase_rad[m] + truth.phase_rad[0];
                assert!(wrap_pi(difference).abs() < 1e-4, "{k} {m}: {difference}");
            }
        }
    }

    #[test]
    fn a_table_holds_a_quarter_beyond_its_span_and_nowhere_when_it_is_empty_or_for_another_carrier() {
        let table = Table::new(0.345, &[entry(20_000.0, [0.0; 4], [1.0; 4]), entry(10_000.0, [0.0; 4], [1.0; 4])]);
        let config = Config { calibration: Some(table.unwrap()), ..Config::default() };
        let array = config.build().unwrap();
        for (frequency_hz, holds) in [(7_400.0, false), (7_600.0, true), (24_900.0, true), (25_100.0, false)] {
            assert_eq!(array.at(frequency_hz).is_uncalibrated(), !holds, "{frequency_hz}");
        }
        assert!(array.at(f32::NAN).is_uncalibrated());
        let damaged = Config { calibration: Some(Table::EMPTY), ..Config::default() }.build().unwrap();
        assert!(damaged.is_uncalibrated() && damaged.at(15_000.0).is_uncalibrated());
        let moved = Config { wavelength_m: 0.350, ..config }.build().unwrap();
        assert!(moved.is_uncalibrated() && moved.at(15_000.0).is_uncalibrated());
        assert!(!Config { wavelength_m: 0.347, ..config }.build().unwrap().at(15_000.0).is_uncalibrated());
    }

    #[test]
    fn a_bad_table_is_refused_by_name() {
        let good = entry(1e4, [0.0; 4], [1.0; 4]);
        let refused = |entries: &[Entry]| Table::new(0.345, entries).unwrap_err().field;
        assert_eq!(Table::new(f32::NAN, &[good]).unwrap_err().field, "calibration.wavelength_m");
        assert_eq!(refused(&[]), "calibration.frequency_hz");
        assert_eq!(refused(&[good; 5]), "calibration.frequency_hz");
        assert_eq!(refused(&[good, good]), "calibration.frequency_hz");
        assert_eq!(refused(&[Entry { frequency_hz: 0.0, ..good }]), "calibration.frequency_hz");
        assert_eq!(refused(&[Entry { gain: [1.0, 0.0, 1.0, 1.0], ..good }]), "calibration.gain");
        assert_eq!(refused(&[Entry { phase_rad: [f32::NAN; 4], ..good }]), "calibration.phase_rad");
        assert_eq!(refused(&[Entry { residual_rad: -1.0, ..good }]), "calibration.residual");
    }
}
