//! `foxhound bearing --iq`: from recorded complex samples of several coherent channels to bearings.
//!
//! The covariance is that of a frame's spectrum in the occupied band, bin by bin, or of its samples if no band is given. A window
//! tapered at both ends keeps out signals outside the band. Of real samples only positive frequencies are used.
//!
//! - **At 0 Hz** a direct-conversion receiver has an offset of its own, which looks like a source. Where the mean is much the same in each of
//!   eight and more frames it is taken out, and with it what a transmitter sends at exactly 0 Hz.
//! - **Samples that follow one another are alike** where their spectrum is not flat. Without a band a frame is worth
//!   `(sum M)^2 / sum M^2` samples, `M` the spectrum's running median: a tone in white noise takes nothing away. In a given band the
//!   noise is taken to be flat.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use foxhound_core::base::adc::ANTENNAS_MAX;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::beam::{Arrival, Beam, Covariance, Source, Vector, can_tell};
use foxhound_core::signal::phase::Complex;
use num_complex::{Complex32, Complex64};
use rustfft::FftPlanner;

use super::bearings::ArrayLine;
use super::frames::{Samples, npy_type, read_npy};
use super::radio_array::RadioArray;
use super::{sigmf, wav};
use crate::scenario::input::{InputError, read_bytes};

/// An offset is known from so many frames, in which so much of their means is alike.
const OFFSET_FRAMES: usize = 8;
const OFFSET_SHARE: f64 = 0.5;
/// Cells of a spectrum for its median; that is over one of so many parts of them, and of at least so many.
const CELLS_MAX: usize = 1024;
const MEDIAN_SHARE: usize = 8;
const MEDIAN_LEAST: usize = 5;
/// Samples of a channel in a frame.
const SAMPLES: std::ops::RangeInclusive<usize> = 8..=1 << 20;
/// Share of a frame at either end that the window tapers.
const TAPER: f64 = 0.07;
/// Half-width, in bins, for a tone without a band.
const TONE_BINS: f64 = 4.0;

/// Frames of complex samples, channel after channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    channels: usize,
    samples: usize,
    values: Vec<Complex32>,
    /// Whether the samples are real.
    is_real: bool,
    kind: String,
    /// Of each channel.
    means: Vec<Complex32>,
}

impl Frames {
    /// Reads complex64 of shape (frames, channels, N), integers of shape (frames, channels, N, 2), or a SigMF or WAV recording, for an array.
    ///
    /// # Errors
    /// Names the file and what is wrong with it.
    pub fn read(path: &Path, array: &RadioArray) -> Result<Self, InputError> {
        let antennas = array.beam.count;
        let ends = |endings: &[&str]| {
            let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
            endings.iter().any(|ending| extension.eq_ignore_ascii_case(ending))
        };
        let read = if ends(&["sigmf-meta", "sigmf-data"]) {
            sigmf::read(path, array.sample_rate_hz)?
        } else if ends(&["wav"]) {
            wav::read(path, antennas, array.sample_rate_hz)?
        } else {
            read_frames(&read_bytes(path)?).map_err(|error| error.in_file(path))?
        };
        Self::checked(read, antennas).map_err(|error| error.in_file(path))
    }

    /// Reads the bytes of a `.npy` file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(bytes: &[u8], array: &RadioArray) -> Result<Self, InputError> {
        Self::checked(read_frames(bytes)?, array.beam.count)
    }

    fn checked(read: Samples, antennas: usize) -> Result<Self, InputError> {
        let Samples { channels, samples, values, is_real, kind } = read;
        let wrong = |text: String| Err(InputError::new(text));
        if channels != antennas {
            return wrong(format!("channels = {channels}: antennas_m has {antennas}, shape (frames, channels, N)"));
        }
        if !SAMPLES.contains(&samples) {
            return wrong(format!("N = {samples} samples a frame is outside {}..={}", SAMPLES.start(), SAMPLES.end()));
        }
        if values.len() < channels * samples {
            return wrong("no frames".to_owned());
        }
        let mut offset = Offset::new(channels);
        for frame in values.chunks_exact(channels * samples) {
            offset.add(frame.chunks_exact(samples));
        }
        Ok(Self { channels, samples, values, is_real, kind, means: offset.means() })
    }

    /// What was read.
    #[must_use]
    pub fn taken(&self) -> String {
        let power: f64 = self.values.iter().map(|value| f64::from(value.norm_sqr())).sum();
        let at_zero: f64 = self.means.iter().map(|mean| f64::from(mean.norm_sqr())).sum();
        let share = at_zero * self.values.len() as f64 / (self.channels as f64 * power);
        let note = if share > 0.01 {
            format!("; {:.0} % of the power are at 0 Hz, taken for the receiver's own offset", 100.0 * share)
        } else {
            String::new()
        };
        format!(
            "{} frames of {} channels of {} samples, {}{note}",
            self.count(),
            self.channels,
            self.samples,
            self.kind
        )
    }

    /// Samples of a channel in a frame.
    pub(super) fn samples(&self) -> usize {
        self.samples
    }

    /// The channels of all frames, one after the other.
    pub(super) fn channels(&self) -> impl Iterator<Item = &[Complex32]> {
        self.values.chunks_exact(self.samples)
    }

    /// Number of frames.
    #[must_use]
    pub fn count(&self) -> usize {
        self.values.len() / (self.channels * self.samples)
    }
}

fn read_frames(bytes: &[u8]) -> Result<Samples, InputError> {
    match npy_type(bytes).as_ref().map(|(name, _)| name.as_str()) {
        Some("<i2") => return whole::<i16>(bytes, "int16", 32_768.0),
        Some("|i1") => return whole::<i8>(bytes, "int8", 128.0),
        _ => {}
    }
    let (shape, values) = read_npy::<Complex32>(bytes, "complex64")?;
    let [_, channels, samples] = shape[..] else {
        return Err(InputError::new(format!("shape {shape:?}: expected (frames, channels, N)")));
    };
    Ok(Samples {
        channels: size(channels),
        samples: size(samples),
        values,
        is_real: false,
        kind: "complex64".to_owned(),
    })
}

fn size(value: u64) -> usize {
    usize::try_from(value).unwrap_or(usize::MAX)
}

/// Integers, real and imaginary parts in turn.
fn whole<T: npyz::Deserialize + Into<f32>>(bytes: &[u8], dtype: &str, full: f32) -> Result<Samples, InputError> {
    let (shape, values) = read_npy::<T>(bytes, dtype)?;
    let [_, channels, samples, 2] = shape[..] else {
        return Err(InputError::new(format!("shape {shape:?}: expected (frames, channels, N, 2) of {dtype}")));
    };
    let mut parts = values.into_iter().map(|part| part.into() / full);
    let mut complex = Vec::with_capacity(parts.len() / 2);
    while let (Some(re), Some(im)) = (parts.next(), parts.next()) {
        complex.push(Complex32::new(re, im));
    }
    let kind = format!("{dtype}, I and Q");
    Ok(Samples { channels: size(channels), samples: size(samples), values: complex, is_real: false, kind })
}

/// The results, one for each `looks` frames.
///
/// # Errors
/// A key of the array file that is missing or that the core refuses.
pub fn find(frames: &Frames, array: &RadioArray, looks: usize) -> Result<Vec<ArrayLine>, InputError> {
    find_watched(frames, array, looks, |_| ())
}

/// The results; `watch` sees the covariance of each.
pub(super) fn find_watched(
    frames: &Frames,
    array: &RadioArray,
    looks: usize,
    mut watch: impl FnMut(&Covariance),
) -> Result<Vec<ArrayLine>, InputError> {
    if array.switch.is_some() {
        return Err(InputError::new(
            "switch: the channels of --iq must be sampled at the same instants; use --switched",
        ));
    }
    let mut estimator = Estimator::new(array, frames.samples, frames.is_real)?;
    estimator.check_enough(looks)?;
    let mut lines = Vec::with_capacity(frames.count() / looks);
    for (frame, values) in frames.values.chunks_exact(frames.channels * frames.samples).enumerate() {
        estimator.add(values, &frames.means);
        if (frame + 1) % looks == 0 {
            watch(&estimator.covariance);
            let mut line = ArrayLine::new(frame, None, &estimator.take(frame as u64));
            // Without a band no frequency is measured.
            line.line.freq_hz = line.line.freq_hz.filter(|_| estimator.band.bins.is_some());
            lines.push(line);
        }
    }
    Ok(lines)
}

/// Estimates bearings from the spectra of frames.
pub(super) struct Estimator {
    beam: Beam,
    source: Source,
    band: Band,
    samples: usize,
    covariance: Covariance,
    centre: Centre,
}

impl Estimator {
    /// The estimator for frames with this number of samples of each channel.
    pub(super) fn new(array: &RadioArray, samples: usize, is_real: bool) -> Result<Self, InputError> {
        Ok(Self {
            beam: array.beam.build()?,
            source: Source { floor_rad: array.sigma_floor_rad.unwrap_or(0.0) }.build()?,
            band: Band::of(samples, is_real, array)?,
            samples,
            covariance: Covariance::default(),
            centre: Centre::default(),
        })
    }

    /// Refuses a band so narrow that its bins in so many frames can tell no source from noise.
    fn check_enough(&self, looks: usize) -> Result<(), InputError> {
        let Some(bins) = &self.band.bins else { return Ok(()) };
        let enough = |looks: usize| can_tell(self.beam.antennas(), (bins.len() * looks) as f32 * self.band.worth);
        if enough(looks) {
            return Ok(());
        }
        let needed = (looks..=100).find(|looks| enough(*looks)).unwrap_or(100);
        let (bins, samples, antennas) = (bins.len(), self.samples, self.beam.antennas());
        Err(InputError::new(format!(
            "tone_band_hz: {bins} bins of {samples} samples cannot tell a source from noise with {antennas} antennas; a wider band, \
             longer frames, or --looks {needed}"
        )))
    }

    /// Takes a frame, channel after channel, less the mean of each channel.
    pub(super) fn add(&mut self, values: &[Complex32], means: &[Complex32]) {
        let less = |(channel, mean): (&[Complex32], &Complex32)| channel.iter().map(|value| value - mean).collect();
        let channels = values.chunks_exact(self.samples).zip(means).map(less).collect();
        self.band.add(channels, &mut self.covariance, &mut self.centre);
    }

    /// The bearing of the frames since the last bearing.
    pub(super) fn take(&mut self, time: u64) -> Arrival {
        let (covariance, centre) = (std::mem::take(&mut self.covariance), std::mem::take(&mut self.centre));
        self.source.bearing(&self.beam, &covariance, centre.hz() as f32, Instant(time))
    }
}

/// Centre of the power in the band.
#[derive(Default)]
struct Centre {
    moment: f64,
    power: f64,
}

impl Centre {
    fn hz(&self) -> f64 {
        if self.power > 0.0 { self.moment / self.power } else { 0.0 }
    }
}

/// A receiver's own offset of each channel: the mean, where it is much the same in each frame.
pub(super) struct Offset {
    sums: Vec<Complex64>,
    squares: f64,
    frames: usize,
}

impl Offset {
    pub(super) fn new(channels: usize) -> Self {
        Self { sums: vec![Complex64::default(); channels], squares: 0.0, frames: 0 }
    }

    /// Takes a frame, channel after channel.
    pub(super) fn add<'a>(&mut self, channels: impl Iterator<Item = &'a [Complex32]>) {
        for (sum, channel) in self.sums.iter_mut().zip(channels) {
            let wide = |value: &Complex32| Complex64::new(f64::from(value.re), f64::from(value.im));
            let mean = channel.iter().map(wide).sum::<Complex64>() / channel.len() as f64;
            *sum += mean;
            self.squares += mean.norm_sqr();
        }
        self.frames += 1;
    }

    /// The offset of each channel; zeros where there is none.
    pub(super) fn means(&self) -> Vec<Complex32> {
        let frames = self.frames as f64;
        let alike = self.sums.iter().map(Complex64::norm_sqr).sum::<f64>() / frames;
        let is_offset = self.frames >= OFFSET_FRAMES && alike > OFFSET_SHARE * self.squares;
        let mean = |sum: &Complex64| Complex32::new((sum.re / frames) as f32, (sum.im / frames) as f32);
        self.sums.iter().map(|sum| if is_offset { mean(sum) } else { Complex32::default() }).collect()
    }
}

/// The bins of a frame in the occupied band; `None` if the whole spectrum is occupied.
struct Band {
    bins: Option<Vec<(usize, f64)>>,
    window: Vec<f32>,
    /// Number of independent samples that a bin of a band stands for.
    worth: f32,
    fft: std::sync::Arc<dyn rustfft::Fft<f32>>,
}

impl Band {
    fn of(samples: usize, is_real: bool, array: &RadioArray) -> Result<Self, InputError> {
        let rate_hz = array.sample_rate_hz;
        let bin_hz = rate_hz / samples as f64;
        let around_tone = |tone_hz: f64| [tone_hz - TONE_BINS * bin_hz, tone_hz + TONE_BINS * bin_hz];
        let mut band_hz = array.band_hz.or(array.tone_hz.map(around_tone));
        if is_real {
            if let Some([low_hz, high_hz]) = array.band_hz.filter(|[low_hz, _]| *low_hz < 0.0) {
                let text = format!("tone_band_hz = [{low_hz}, {high_hz}]: real samples have no frequencies below zero");
                return Err(InputError::new(text));
            }
            // Without the bins at zero and at half the sample rate, which have no phase.
            let [low_hz, high_hz] = band_hz.unwrap_or([bin_hz, 0.5 * rate_hz]);
            band_hz = Some([low_hz.max(bin_hz), high_hz.min(0.5 * rate_hz - bin_hz)]);
        }
        let hz = |bin: usize| if 2 * bin < samples { bin as f64 } else { bin as f64 - samples as f64 } * bin_hz;
        let bins = band_hz.map(|[low_hz, high_hz]| {
            let all = (0..samples).map(|bin| (bin, hz(bin)));
            all.filter(|(_, hz)| (low_hz..=high_hz).contains(hz)).collect::<Vec<_>>()
        });
        if bins.as_ref().is_some_and(Vec::is_empty) {
            let [low_hz, high_hz] = band_hz.unwrap_or_default();
            let text =
                format!("tone_band_hz = [{low_hz}, {high_hz}] holds no bin of {samples} samples at {rate_hz} Hz");
            return Err(InputError::new(text));
        }
        let bins = bins.filter(|bins| bins.len() < samples);
        let tapered = TAPER * samples as f64;
        let window: Vec<f32> = (0..samples)
            .map(|k| {
                let from_edge = (k.min(samples - 1 - k) as f64 + 0.5) / tapered;
                if from_edge < 1.0 { 0.5 - 0.5 * libm::cos(std::f64::consts::PI * from_edge) } else { 1.0 }
            })
            .map(|weight| weight as f32)
            .collect();
        let squares: f32 = window.iter().map(|weight| weight * weight).sum();
        let fourths: f32 = window.iter().map(|weight| weight.powi(4)).sum();
        let worth = if bins.is_some() { squares * squares / (fourths * samples as f32) } else { 1.0 };
        Ok(Self { bins, window, worth, fft: FftPlanner::new().plan_fft_forward(samples) })
    }

    /// Adds a frame to the covariance.
    fn add(&self, channels: Vec<Vec<Complex32>>, covariance: &mut Covariance, centre: &mut Centre) {
        let mut spectra = channels.clone();
        let scale = 1.0 / (self.window.len() as f32).sqrt();
        for spectrum in &mut spectra {
            for (value, weight) in spectrum.iter_mut().zip(&self.window) {
                *value *= weight * scale;
            }
            self.fft.process(spectrum);
        }
        let mut at = |channels: &[Vec<Complex32>], k: usize, hz: f64, worth: f32| {
            let mut z = Vector::default();
            for (z, channel) in z.iter_mut().zip(channels).take(ANTENNAS_MAX) {
                *z = Complex { re: channel[k].re, im: channel[k].im };
            }
            let power: f64 = z.iter().map(|z| f64::from(z.norm_squared())).sum();
            centre.moment += hz * power;
            centre.power += power;
            covariance.add(&z, worth);
        };
        match &self.bins {
            Some(bins) => bins.iter().for_each(|(bin, hz)| at(&spectra, *bin, *hz, self.worth)),
            None => {
                let worth = flatness(&spectra);
                (0..self.window.len()).for_each(|k| at(&channels, k, 0.0, worth));
            }
        }
    }
}

/// The share of the samples that are independent, by the running median of the spectrum of all channels.
fn flatness(spectra: &[Vec<Complex32>]) -> f32 {
    let samples = spectra.first().map_or(0, Vec::len);
    let power = |k: usize| spectra.iter().map(|spectrum| spectrum[k].norm_sqr()).sum::<f32>();
    let powers: Vec<f32> = (0..samples).map(power).collect();
    let cells: Vec<f32> = powers.chunks(samples.div_ceil(CELLS_MAX)).map(|bins| bins.iter().sum()).collect();
    let count = cells.len();
    let width = (count / MEDIAN_SHARE).max(MEDIAN_LEAST);
    let (mut sum, mut squares) = (0.0, 0.0);
    for first in 0..count {
        let mut near: Vec<f32> = (first..first + width).map(|cell| cells[cell % count]).collect();
        let (_, median, _) = near.select_nth_unstable_by(width / 2, f32::total_cmp);
        sum += f64::from(*median);
        squares += f64::from(*median) * f64::from(*median);
    }
    // The medians of a flat spectrum differ as well: at most, where a source is in all channels, by a variance of pi / 2 over their width.
    let of_flat = 1.0 + FRAC_PI_2 / width as f64;
    let flatness = if squares > 0.0 { of_flat * sum * sum / (squares * count as f64) } else { 1.0 };
    flatness.min(1.0) as f32
}
