//! Recorded ADC frames (`.npy`) and the description of the array that they were taken with (TOML).
//!
//! The description's `[calibration]`, which [`crate::tools::calibrate`] writes:
//!
//! ```toml
//! [calibration]
//! wavelength_m = 0.345          # the carrier's wavelength that it is valid for
//! frequency_hz = 14800.0        # the tone's frequency in the samples that it holds for
//! gain = [1.0, 0.9, 1.1, 1.0]   # relative to their mean
//! phase_rad = [0.1, -0.4, 0.2, 0.1]
//! residual_deg = 0.04           # standard deviation that is left
//! temperature_c = 21.0          # optional
//! crc = 0x1b2f34a5              # of the record that the firmware stores
//!
//! [[calibration.further]]       # up to three more frequencies, the same keys
//!
//! [calibration.deviation]       # optional: measured by turning on the spot
//! constant_rad = 0.01
//! cosine_rad = [0.0, 0.0, 0.0, 0.0]
//! sine_rad = [0.0, 0.0, 0.0, 0.0]
//! sigma_rad = 0.001
//! ```
//!
//! A calibration written by hand needs only `gain` and `phase_rad`, which are then valid at all frequencies. A
//! table whose `crc` does not match is valid nowhere.

use std::io::Cursor;
use std::path::Path;

use foxhound_core::base::adc::{AdcFrame, CHANNELS, CODE_MAX, CODE_MIN};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array::{self, Entry, Table};
use foxhound_core::doa::calibration::deviation::{Deviation, ORDER};
use foxhound_core::doa::calibration::record::Calibration;
use foxhound_core::signal::phase::{self, Complex};
use npyz::{NpyFile, Order, WriterBuilder as _};
use num_complex::Complex32;
use serde::Deserialize;

use crate::scenario::input::{
    Exactly, InputError, check, parse_strictly, read_bytes, read_text, refuse_lists_for_tables,
};
use crate::scenario::output::{self, Output};

/// Block lengths that the core is compiled for.
pub const BLOCK_LENGTHS: [usize; 5] = [64, 128, 256, 512, 1024];

/// Samples of a channel that make one frame of a recording that has none of its own; a shorter one is one frame.
pub(super) const FRAME: usize = 1024;

/// A recording of complex samples, in frames.
pub(super) struct Samples {
    pub(super) channels: usize,
    /// Of a frame.
    pub(super) samples: usize,
    /// The frames, channel after channel.
    pub(super) values: Vec<Complex32>,
    pub(super) is_real: bool,
    /// How many samples of the last frame are in the one before as well.
    pub(super) repeated: usize,
    /// The least and the largest value that the format of whole numbers has.
    pub(super) extremes: Option<[f32; 2]>,
    /// The format.
    pub(super) kind: String,
}

/// Where the frames of a recording begin. The last one is the last samples, some of which may be in the one before as well: none is
/// left out.
pub(super) fn frame_starts(samples: usize, frame: usize) -> impl Iterator<Item = usize> {
    (0..samples.div_ceil(frame)).map(move |k| (k * frame).min(samples - frame))
}

/// How many samples of the last of these frames are in the one before as well.
pub(super) fn repeated(samples: usize, frame: usize) -> usize {
    samples.div_ceil(frame) * frame - samples
}

/// Frames of four channels of signed 12-bit samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recording {
    /// Samples per channel and frame.
    pub block_length: usize,
    /// Frame after frame, channel after channel.
    codes: Vec<i16>,
}

impl Recording {
    /// Reads int16 frames of shape (frames, 4, N) in C order.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let bytes = read_bytes(path)?;
        Self::parse(&bytes).map_err(|error| error.in_file(path))
    }

    /// Frames of the flight computer's type.
    #[must_use]
    pub fn of<const N: usize>(frames: &[AdcFrame<N>]) -> Self {
        Self { block_length: N, codes: frames.iter().flat_map(|frame| frame.codes.as_flattened().to_vec()).collect() }
    }

    /// Writes a file that [`read`](Self::read) reads.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn write(&self, path: &Path) -> Result<(), InputError> {
        let frames = self.codes.len() / (CHANNELS * self.block_length);
        let shape = [frames, CHANNELS, self.block_length].map(|length| length as u64);
        let mut file = Output::create(path)?;
        let write = |file: &mut Output| {
            let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(file).begin_nd()?;
            writer.extend(&self.codes)?;
            writer.finish()
        };
        write(&mut file).map_err(|error: std::io::Error| output::failed(path, &error))?;
        file.finish()
    }

    /// Reads the bytes of such a file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(bytes: &[u8]) -> Result<Self, InputError> {
        let (shape, codes) = read_npy::<i16>(bytes, "int16")?;
        let [frames, channels, block_length] = shape[..] else {
            return Err(InputError::new(format!("shape {shape:?}: expected (frames, {CHANNELS}, N)")));
        };
        if channels != CHANNELS as u64 {
            return Err(InputError::new(format!(
                "channels = {channels}: expected {CHANNELS}, shape (frames, channels, N)"
            )));
        }
        let block_length = BLOCK_LENGTHS.into_iter().find(|n| *n as u64 == block_length).ok_or_else(|| {
            InputError::new(format!("N = {block_length} samples a frame: expected one of {BLOCK_LENGTHS:?}"))
        })?;
        if frames == 0 {
            return Err(InputError::new("no frames: shape (0, 4, N)"));
        }
        if let Some(at) = codes.iter().position(|code| !(CODE_MIN..=CODE_MAX).contains(code)) {
            let (frame, channel) = (at / (CHANNELS * block_length), at / block_length % CHANNELS);
            return Err(InputError::new(format!(
                "code {} in frame {frame}, channel {} is outside the 12-bit range {CODE_MIN}..={CODE_MAX}",
                codes[at],
                channel + 1,
            )));
        }
        Ok(Self { block_length, codes })
    }

    /// The frames as the flight computer has them, sampled one after another.
    pub(super) fn snapshots<const N: usize>(&self, sample_rate_hz: f32) -> impl Iterator<Item = AdcFrame<N>> {
        let block_us = 1e6 * N as f64 / f64::from(sample_rate_hz);
        self.frames().enumerate().map(move |(frame, codes)| {
            let mut snapshot = AdcFrame::zeroed();
            snapshot.time = Instant(((frame as f64 + 0.5) * block_us) as u64);
            snapshot.codes.as_flattened_mut().copy_from_slice(codes);
            snapshot
        })
    }

    /// The frames in order, each four rows of `block_length` samples.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = &[i16]> {
        self.codes.chunks_exact(CHANNELS * self.block_length)
    }
}

/// Reads one float64 yaw per frame, rad.
///
/// # Errors
/// Names the file and what is wrong with it.
pub fn read_yaw(path: &Path, frames: usize) -> Result<Vec<f64>, InputError> {
    let bytes = read_bytes(path)?;
    parse_yaw(&bytes, frames).map_err(|error| error.in_file(path))
}

/// Reads the bytes of such a file.
///
/// # Errors
/// What is wrong with it.
pub fn parse_yaw(bytes: &[u8], frames: usize) -> Result<Vec<f64>, InputError> {
    let (shape, yaw) = read_npy::<f64>(bytes, "float64")?;
    if shape != [frames as u64] {
        return Err(InputError::new(format!("shape {shape:?}: expected one yaw a frame, ({frames},)")));
    }
    if let Some(at) = yaw.iter().position(|yaw| !yaw.is_finite() || yaw.abs() > 1e4) {
        return Err(InputError::new(format!("yaw[{at}] = {}: expected radians", yaw[at])));
    }
    Ok(yaw)
}

/// The type of a `.npy` file's values, as NumPy writes it, and its shape; `None` if it is not such a file.
#[must_use]
pub fn npy_type(bytes: &[u8]) -> Option<(String, Vec<u64>)> {
    refuse_absurd_shape(bytes).ok()?;
    let header = npyz::NpyHeader::from_reader(&mut Cursor::new(bytes)).ok()?;
    Some((header.dtype().descr().trim_matches('\'').to_owned(), header.shape().to_vec()))
}

/// Reads a `.npy` file of one type: its shape and its values in C order.
pub(super) fn read_npy<T: npyz::Deserialize>(bytes: &[u8], dtype: &str) -> Result<(Vec<u64>, Vec<T>), InputError> {
    refuse_absurd_shape(bytes)?;
    let mut cursor = Cursor::new(bytes);
    let header = npyz::NpyHeader::from_reader(&mut cursor)
        .map_err(|error| InputError::new(format!("not a NumPy .npy file: {error}")))?;
    let found = header.dtype().descr();
    let elements = header.shape().iter().try_fold(1_u64, |product, n| product.checked_mul(*n));
    let shape = header.shape().to_vec();
    if header.order() == Order::Fortran && shape.len() > 1 {
        return Err(InputError::new("Fortran order: expected C order (numpy.ascontiguousarray)"));
    }
    let wrong_type = || InputError::new(format!("dtype {found}: expected {dtype}"));
    let item_bytes = std::mem::size_of::<T>() as u64;
    let held = bytes.len() as u64 - cursor.position();
    let file = NpyFile::with_header(header, cursor);
    let data = file.data::<T>().map_err(|_| wrong_type())?;
    let wanted = elements.and_then(|n| n.checked_mul(item_bytes));
    if wanted != Some(held) {
        let wanted = wanted.map_or_else(|| "more bytes than there can be".to_owned(), |n| format!("{n} bytes"));
        let why = if held == 0 { "empty" } else { "truncated or overlong" };
        return Err(InputError::new(format!("{why}: the shape {shape:?} needs {wanted}, the file holds {held}")));
    }
    let values = data.collect::<Result<Vec<T>, _>>().map_err(|error| InputError::new(error.to_string()))?;
    Ok((shape, values))
}

/// The header's reader multiplies the shape unchecked; a shape that no file can hold is refused before.
fn refuse_absurd_shape(bytes: &[u8]) -> Result<(), InputError> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]);
    let shape =
        head.split_once("shape").and_then(|(_, rest)| rest.split_once('(')).and_then(|(_, rest)| rest.split_once(')'));
    let Some((shape, _)) = shape else { return Ok(()) };
    let numbers = shape.split(',').map(|n| n.trim().trim_end_matches('L')).filter(|n| !n.is_empty());
    let bytes_needed = numbers.map(|n| n.parse::<u64>().ok()).try_fold(8_u64, |product, n| product.checked_mul(n?));
    match bytes_needed {
        Some(_) => Ok(()),
        None => Err(InputError::new(format!("truncated or overlong: no file holds the shape ({shape})"))),
    }
}

/// Every key of an array file.
const ARRAY_KEYS: [&str; 27] = [
    "wavelength_m",
    "side_m",
    "antennas_m",
    "sample_rate_hz",
    "tone_hz",
    "tone_band_hz",
    "skew_s",
    "require_calibration",
    "calibration",
    "calibration.gain",
    "calibration.phase_rad",
    "calibration.wavelength_m",
    "calibration.frequency_hz",
    "calibration.residual_deg",
    "calibration.temperature_c",
    "calibration.crc",
    "calibration.further",
    "calibration.further[].gain",
    "calibration.further[].phase_rad",
    "calibration.further[].frequency_hz",
    "calibration.further[].residual_deg",
    "calibration.further[].temperature_c",
    "calibration.deviation",
    "calibration.deviation.constant_rad",
    "calibration.deviation.cosine_rad",
    "calibration.deviation.sine_rad",
    "calibration.deviation.sigma_rad",
];

/// The array file as written.
#[derive(Clone, Debug, Deserialize)]
struct ArrayFile {
    wavelength_m: f64,
    side_m: Option<f64>,
    antennas_m: Option<Vec<Exactly<f64, 2>>>,
    sample_rate_hz: f64,
    tone_hz: Option<f64>,
    tone_band_hz: Option<Exactly<f64, 2>>,
    skew_s: Option<Exactly<f64, CHANNELS>>,
    #[serde(default)]
    require_calibration: bool,
    calibration: Option<CalibrationTable>,
}

/// Gain and phase of each channel relative to their mean, the frequency, and other measurements.
#[derive(Clone, Debug, Deserialize)]
struct CalibrationTable {
    gain: Exactly<f64, CHANNELS>,
    phase_rad: Exactly<f64, CHANNELS>,
    wavelength_m: Option<f64>,
    frequency_hz: Option<f64>,
    residual_deg: Option<f64>,
    temperature_c: Option<f64>,
    crc: Option<i64>,
    #[serde(default)]
    further: Vec<FurtherFrequency>,
    deviation: Option<DeviationTable>,
}

/// Another frequency of the same table.
#[derive(Clone, Debug, Deserialize)]
struct FurtherFrequency {
    gain: Exactly<f64, CHANNELS>,
    phase_rad: Exactly<f64, CHANNELS>,
    frequency_hz: f64,
    residual_deg: Option<f64>,
    temperature_c: Option<f64>,
}

/// Fourier series of the deviation.
#[derive(Clone, Debug, Deserialize)]
struct DeviationTable {
    constant_rad: f64,
    cosine_rad: Exactly<f64, ORDER>,
    sine_rad: Exactly<f64, ORDER>,
    #[serde(default)]
    sigma_rad: f64,
}

impl DeviationTable {
    fn checked(&self) -> Result<Deviation, InputError> {
        for term in self.cosine_rad.0.iter().chain(&self.sine_rad.0).chain([&self.constant_rad]) {
            check("calibration.deviation", *term, -3.2, 3.2)?;
        }
        check("calibration.deviation.sigma_rad", self.sigma_rad, 0.0, 1.0)?;
        Ok(Deviation {
            constant_rad: self.constant_rad as f32,
            cosine_rad: self.cosine_rad.0.map(|term| term as f32),
            sine_rad: self.sine_rad.0.map(|term| term as f32),
            sigma_rad: self.sigma_rad as f32,
        })
    }
}

impl CalibrationTable {
    fn deviation(&self) -> Result<Deviation, InputError> {
        self.deviation.as_ref().map_or(Ok(Deviation::default()), DeviationTable::checked)
    }

    /// The table by frequency: empty if it is damaged, `None` if it is valid at all frequencies.
    fn table(&self, wavelength_m: f64) -> Result<Option<Table>, InputError> {
        let Some(frequency_hz) = self.frequency_hz else {
            if self.further.is_empty() {
                for (key, value) in [
                    ("wavelength_m", self.wavelength_m),
                    ("residual_deg", self.residual_deg),
                    ("temperature_c", self.temperature_c),
                ] {
                    if value.is_some() {
                        return Err(InputError::new(format!(
                            "calibration.{key}: is of no use without calibration.frequency_hz"
                        )));
                    }
                }
                // Without a frequency, the checksum covers nothing.
                return Ok(self.crc.map(|_| Table::EMPTY));
            }
            return Err(InputError::new("calibration.frequency_hz: missing, though there are further frequencies"));
        };
        let first = FurtherFrequency {
            gain: self.gain,
            phase_rad: self.phase_rad,
            frequency_hz,
            residual_deg: self.residual_deg,
            temperature_c: self.temperature_c,
        };
        let entries: Vec<Entry> = std::iter::once(&first)
            .chain(&self.further)
            .map(|entry| Entry {
                frequency_hz: entry.frequency_hz as f32,
                gain: entry.gain.0.map(|gain| gain as f32),
                phase_rad: entry.phase_rad.0.map(|phase_rad| phase_rad as f32),
                residual_rad: (entry.residual_deg.unwrap_or(0.0) as f32).to_radians(),
                temperature_c: entry.temperature_c.map(|temperature_c| temperature_c as f32),
            })
            .collect();
        let table = Table::new(self.wavelength_m.unwrap_or(wavelength_m) as f32, &entries)?;
        let calibration = Calibration { table, deviation: self.deviation()? };
        let is_whole = self.crc.is_none_or(|crc| crc == i64::from(calibration.crc()));
        Ok(Some(if is_whole { table } else { Table::EMPTY }))
    }
}

/// The content of an array file, as configurations of the core.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrayDescription {
    /// Geometry and calibration.
    pub array: array::Config,
    /// Sampling, and where the tone is.
    pub phase: phase::Config,
    /// Deviation of bearings by the airframe; the default, zero, if it has not been measured.
    pub deviation: Deviation,
}

impl ArrayDescription {
    /// Reads and checks an array file.
    ///
    /// # Errors
    /// Names the file and the field.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(&read_text(path)?).map_err(|error| error.in_file(path))
    }

    /// What is allowed, but makes bearings worse than the user may expect.
    ///
    /// # Errors
    /// A field that the core refuses.
    pub fn warnings(&self) -> Result<Vec<&'static str>, InputError> {
        let is_damaged = self.array.calibration.is_some_and(|table| table.entries().is_empty());
        let all = [
            (
                self.array.build()?.is_nearly_ambiguous(),
                "side_m is close to half a wavelength: noise will turn some bearings round",
            ),
            (is_damaged, "[calibration] is damaged, its crc does not match: all bearings are uncalibrated"),
        ];
        Ok(all.into_iter().filter(|(applies, _)| *applies).map(|(_, text)| text).collect())
    }

    /// Checks the text of an array file.
    ///
    /// # Errors
    /// Names the field.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        refuse_lists_for_tables(text, &["calibration", "calibration.further[]", "calibration.deviation"])?;
        let document = toml::Deserializer::parse(text).map_err(|error| InputError::new(error.to_string()))?;
        let file: ArrayFile = parse_strictly(document, &ARRAY_KEYS)?;
        check("wavelength_m", file.wavelength_m, 1e-3, 10.0)?;
        check("sample_rate_hz", file.sample_rate_hz, 1e3, 1e7)?;
        let wavelength_m = file.wavelength_m as f32;
        let mut array = match (file.side_m, &file.antennas_m) {
            (Some(side_m), None) => {
                check("side_m", side_m, 1e-4, 10.0)?;
                array::Config::square(wavelength_m, side_m as f32)
            }
            (None, Some(antennas_m)) => {
                array::Config { wavelength_m, antennas_m: four(antennas_m)?, ..array::Config::default() }
            }
            (Some(_), Some(_)) => return Err(InputError::new("side_m and antennas_m: give only one of the two")),
            (None, None) => return Err(InputError::new("side_m or antennas_m: one of the two is missing")),
        };
        array.require_calibration = file.require_calibration;
        let mut deviation = Deviation::default();
        if let Some(table) = &file.calibration {
            let mut gains = [Complex::default(); CHANNELS];
            for (channel, gain) in gains.iter_mut().enumerate() {
                let (magnitude, phase_rad) = (table.gain.0[channel], table.phase_rad.0[channel]);
                check("calibration.gain", magnitude, 0.01, 100.0)?;
                check("calibration.phase_rad", phase_rad, -100.0, 100.0)?;
                *gain = Complex {
                    re: (magnitude * libm::cos(phase_rad)) as f32,
                    im: (magnitude * libm::sin(phase_rad)) as f32,
                };
            }
            array.channel_gain = Some(gains);
            array.calibration = table.table(file.wavelength_m)?;
            deviation = table.deviation()?;
        }
        array.build()?;

        let nyquist_hz = file.sample_rate_hz / 2.0;
        let mut phase = phase::Config { sample_rate_hz: file.sample_rate_hz as f32, ..phase::Config::default() };
        // The tone is unknown: it may be anywhere in the spectrum where it is distinct from its own image.
        phase.tone_band_hz = [0.0, phase.sample_rate_hz / 2.0];
        if let Some(tone_hz) = file.tone_hz {
            check("tone_hz", tone_hz, 0.0, nyquist_hz)?;
            phase.tone_hz = Some(tone_hz as f32);
        }
        if let Some(Exactly([low_hz, high_hz])) = file.tone_band_hz {
            check("tone_band_hz[0]", low_hz, 0.0, nyquist_hz)?;
            check("tone_band_hz[1]", high_hz, low_hz, nyquist_hz)?;
            if let Some(tone_hz) = file.tone_hz {
                check("tone_hz, beside tone_band_hz,", tone_hz, low_hz, high_hz)?;
            }
            phase.tone_band_hz = [low_hz as f32, high_hz as f32];
        }
        for (channel, skew_s) in file.skew_s.into_iter().flat_map(|skew_s| skew_s.0).enumerate() {
            check(&format!("skew_s[{channel}]"), skew_s, -4.0 / file.sample_rate_hz, 4.0 / file.sample_rate_hz)?;
            phase.skew_s[channel] = skew_s as f32;
        }
        Ok(Self { array, phase, deviation })
    }
}

/// The places of four antennas.
fn four(antennas_m: &[Exactly<f64, 2>]) -> Result<[[f32; 2]; CHANNELS], InputError> {
    let places: Vec<[f32; 2]> = antennas_m.iter().map(|xy| xy.0.map(|coordinate| coordinate as f32)).collect();
    let count = places.len();
    places.try_into().map_err(|_| {
        InputError::new(format!(
            "antennas_m: {count} antennas; --adc has {CHANNELS} channels, --iq and --switched 2 to 8"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A .npy file of format version 1.0 after NumPy's format specification, not made by the crate under test.
    fn npy(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let mut header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn codes(n: usize) -> Vec<u8> {
        (0..n).flat_map(|k| ((k % 4096) as i16 - 2048).to_le_bytes()).collect()
    }

    #[test]
    fn a_file_laid_out_as_numpy_does_is_read_in_c_order() {
        let recording = Recording::parse(&npy("<i2", "False", "(2, 4, 64)", &codes(512))).unwrap();
        assert_eq!(recording.block_length, 64);
        assert_eq!(recording.frames().len(), 2);
        let second = recording.frames().nth(1).unwrap();
        assert_eq!(second[0], 256 - 2048);
        assert_eq!(second[3 * 64 + 63], 511 - 2048);
    }

    #[test]
    fn every_kind_of_bad_file_is_refused_and_named() {
        let refused = |bytes: &[u8]| Recording::parse(bytes).unwrap_err().to_string();
        let good = codes(256);
        assert!(refused(b"").contains(".npy"));
        assert!(refused(b"PK\x03\x04").contains(".npy"));
        assert!(refused(&npy("<f8", "False", "(1, 4, 64)", &[0; 2048])).contains("dtype"));
        assert!(refused(&npy("<i4", "False", "(1, 4, 64)", &[0; 1024])).contains("int16"));
        assert!(refused(&npy("<i2", "True", "(1, 4, 64)", &good)).contains("Fortran"));
        assert!(refused(&npy("<i2", "False", "(4, 64)", &good)).contains("shape"));
        assert!(refused(&npy("<i2", "False", "(1, 3, 64)", &codes(192))).contains("channels = 3"));
        assert!(refused(&npy("<i2", "False", "(1, 4, 100)", &codes(400))).contains("N = 100"));
        assert!(refused(&npy("<i2", "False", "(0, 4, 64)", &[])).contains("no frames"));
        assert!(refused(&npy("<i2", "False", "(1, 4, 64)", &good[..511])).contains("truncated"));
        assert!(refused(&npy("<i2", "False", "(9999999999, 9999999999, 64)", &good)).contains("truncated"));
        let mut loud = good.clone();
        loud[2 * 130..2 * 130 + 2].copy_from_slice(&2048_i16.to_le_bytes());
        assert!(refused(&npy("<i2", "False", "(1, 4, 64)", &loud)).contains("code 2048 in frame 0, channel 3"));
    }

    const GOOD: &str = "wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0\n";

    #[test]
    fn every_key_of_an_array_file_reaches_the_core() {
        let text = "wavelength_m = 0.345\nantennas_m = [[0.06,0.06],[0.06,-0.06],[-0.06,-0.06],[-0.06,0.06]]\n\
            sample_rate_hz = 204800\ntone_band_hz = [14000, 15000.0]\nskew_s = [0.0, 1e-7, 2e-7, 3e-7]\n\
            require_calibration = true\n[calibration]\ngain = [1.0, 1.1, 0.9, 1.0]\nphase_rad = [0.0, 0.5, 0.0, 0.0]\n";
        let description = ArrayDescription::parse(text).unwrap();
        assert_eq!(description.phase.sample_rate_hz, 204_800.0);
        assert_eq!(description.phase.tone_band_hz, [14_000.0, 15_000.0]);
        assert_eq!(description.phase.skew_s[3], 3e-7);
        assert_eq!(description.array.antennas_m[1], [0.06, -0.06]);
        assert!(description.array.require_calibration);
        let gain = description.array.channel_gain.unwrap()[1];
        assert!((gain.norm_squared() - 1.21).abs() < 1e-5 && (gain.arg() - 0.5).abs() < 1e-5);
    }

    #[test]
    fn a_refused_array_file_names_the_field() {
        let refused = |text: &str| ArrayDescription::parse(text).unwrap_err().to_string();
        assert!(ArrayDescription::parse(GOOD).is_ok());
        assert!(refused("side_m = 0.138\nsample_rate_hz = 1e5\n").contains("wavelength_m"));
        assert!(refused("wavelength_m = 0.345\nsample_rate_hz = 1e5\n").contains("side_m"));
        assert!(refused("wavelength_m = 0.345\nside_m = 0.1725\nsample_rate_hz = 1e5\n").contains("side_m"));
        assert!(refused("wavelength_m = -1\nside_m = 0.1\nsample_rate_hz = 1e5\n").contains("wavelength_m"));
        assert!(refused("wavelength_m = nan\nside_m = 0.1\nsample_rate_hz = 1e5\n").contains("wavelength_m"));
        assert!(refused(&format!("{GOOD}antennas_m = [[0,0],[0,1],[1,1],[1,0]]\n")).contains("antennas_m"));
        assert!(refused(&format!("{GOOD}tone_hz = 60e3\n")).contains("tone_hz"));
        assert!(refused(&format!("{GOOD}tone_band_hz = [9e3, 8e3]\n")).contains("tone_band_hz[1]"));
        assert!(
            refused(&format!("{GOOD}tone_hz = 12e3\ntone_band_hz = [8e3, 1e4]\n"))
                .contains("tone_hz, beside tone_band_hz,")
        );
        assert!(refused(&format!("{GOOD}tone_band_hz = [8e3, 9e3, 1e4]\n")).contains("tone_band_hz: "));
        assert!(refused(&format!("{GOOD}skew_s = [0.0, 0.0, 0.0, 0.0, 0.0]\n")).contains("skew_s: "));
        let places = |list: &str| format!("wavelength_m = 0.345\nsample_rate_hz = 1e5\nantennas_m = [{list}]\n");
        let five = places("[0,0],[0,0.1],[0.1,0.1],[0.1,0],[0.05,0.05]");
        assert!(refused(&five).contains("antennas_m: 5 antennas"), "{}", refused(&five));
        let third = places("[0,0],[0,0.1,0.2],[0.1,0.1],[0.1,0]");
        assert!(refused(&third).contains("antennas_m[1]"), "{}", refused(&third));
        assert!(
            refused(&format!("{GOOD}calibration = [[1,1,1,1],[0,0,0,0]]\n")).contains("calibration: expected a table")
        );
        let list = format!("{GOOD}[calibration]\ngain = [1,1,1,1]\nphase_rad = [0,0,0,0]\ndeviation = [0,[0],[0]]\n");
        assert!(refused(&list).contains("calibration.deviation: expected a table"));
        let five = format!("{GOOD}[calibration]\ngain = [1,1,1,1,1]\nphase_rad = [0,0,0,0]\n");
        assert!(refused(&five).contains("calibration.gain"), "{}", refused(&five));
        let idle = format!("{GOOD}[calibration]\ngain = [1,1,1,1]\nphase_rad = [0,0,0,0]\nresidual_deg = 1\n");
        assert!(refused(&idle).contains("calibration.residual_deg"), "{}", refused(&idle));
        assert!(refused(&format!("{GOOD}tone_hertz = 9e3\n")).contains("did you mean `tone_hz`"));
        assert!(refused(&format!("{GOOD}side_m = 0.1\n")).contains("side_m"), "a key twice");
        let table = format!("{GOOD}[calibration]\ngain = [1,1,1,0]\nphase_rad = [0,0,0,0]\n");
        assert!(refused(&table).contains("calibration.gain"));
        let table = format!("{GOOD}[calibration]\ngain = [1,1,1,1]\nphase_deg = [0,0,0,0]\nphase_rad = [0,0,0,0]\n");
        assert!(refused(&table).contains("calibration.phase_deg"));
    }
}
