//! `foxhound bearing --iq`: from recorded complex samples of several coherent channels to bearings.
//!
//! The covariance is that of a frame's spectrum in the occupied band, bin by bin, or of its samples if no band is given. A window
//! tapered at both ends keeps out signals outside the band. Of real samples only positive frequencies are used.
//!
//! - **At 0 Hz** a direct-conversion receiver has an offset of its own, which looks like a source. Where the mean is much the same in
//!   all frames, or in eight parts of fewer, it is taken out, and with it what a transmitter sends at less than about half a turn in all of it.
//! - **Samples and bins count for less where noise is not white**, and a bearing to what stands beside the band is not valid, see `band`.

use std::path::Path;

use foxhound_core::base::time::Instant;
use foxhound_core::doa::beam::{Arrival, Beam, Covariance, Source, can_tell};
use foxhound_core::doa::bearing::Flags;
use num_complex::{Complex32, Complex64};

use super::bearings::{ArrayLine, mark_clipped};
use super::frames::{Samples, npy_type, read_npy};
use super::radio_array::RadioArray;
use super::{sigmf, wav};
use crate::scenario::input::{InputError, read_bytes};

mod band;
use band::{Band, Sums};

/// An offset is looked for in so many parts, of which half are enough, and known where so much of their means is alike.
const OFFSET_PARTS: usize = 8;
const OFFSET_SHARE: f64 = 0.5;
/// Samples of a channel in a frame.
const SAMPLES: std::ops::RangeInclusive<usize> = 8..=1 << 20;

/// Frames of complex samples, channel after channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    channels: usize,
    samples: usize,
    values: Vec<Complex32>,
    /// Whether the samples are real.
    is_real: bool,
    /// How many samples of the last frame are in the one before as well.
    repeated: usize,
    /// Samples of each frame at the ends of the format's range.
    clipped: Vec<usize>,
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
            sigmf::read(path, array)?
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

    pub(super) fn checked(read: Samples, antennas: usize) -> Result<Self, InputError> {
        let Samples { channels, samples, values, is_real, repeated, extremes, kind } = read;
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
        let mut offset = Offset::new(channels, values.len() / (channels * samples));
        for frame in values.chunks_exact(channels * samples) {
            offset.add(frame.chunks_exact(samples));
        }
        let is_extreme = |value: &&Complex32| {
            extremes
                .is_some_and(|[least, most]| [value.re, value.im].iter().any(|part| *part <= least || *part >= most))
        };
        let clipped = values.chunks_exact(channels * samples).map(|frame| frame.iter().filter(is_extreme).count());
        let (clipped, means) = (clipped.collect(), offset.means());
        Ok(Self { channels, samples, values, is_real, repeated, clipped, kind, means })
    }

    /// What was read.
    #[must_use]
    pub fn taken(&self) -> String {
        let share = self.share_at_zero();
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

    /// What is left out, where that is most of the recording.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let share = self.share_at_zero();
        let text =
            "of the power are at 0 Hz and left out as the receiver's own offset: a transmitter there is not heard";
        (share > OFFSET_SHARE).then(|| format!("{:.0} % {text}", 100.0 * share))
    }

    /// Share of the power that is taken for the receiver's own offset.
    fn share_at_zero(&self) -> f64 {
        let powers = self.values.iter().map(|value| f64::from(value.norm_sqr())).filter(|power| power.is_finite());
        let (count, power) = powers.fold((0.0, 0.0), |(count, sum), power| (count + 1.0, sum + power));
        let at_zero: f64 = self.means.iter().map(|mean| f64::from(mean.norm_sqr())).sum();
        at_zero * count / (self.channels as f64 * power)
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
        repeated: 0,
        extremes: None,
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
    Ok(Samples {
        channels: size(channels),
        samples: size(samples),
        values: complex,
        is_real: false,
        repeated: 0,
        extremes: Some([-1.0, (full - 1.0) / full]),
        kind,
    })
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
        // Joined with the frame before, its samples count once.
        let is_repeated = looks > 1 && frame + 1 == frames.count();
        let repeated = if is_repeated { frames.repeated as f32 / frames.samples as f32 } else { 0.0 };
        estimator.add(values, &frames.means, 1.0 - repeated);
        if (frame + 1) % looks == 0 {
            watch(&estimator.sums.covariance);
            let clipped: usize = frames.clipped[frame + 1 - looks..=frame].iter().sum();
            let mut arrival = estimator.take(frame as u64);
            mark_clipped(&mut arrival.bearing, clipped, looks * frames.channels * frames.samples, frames.channels);
            let mut line = ArrayLine::new(frame, None, &arrival);
            // Without a band no frequency is measured.
            line.line.freq_hz = line.line.freq_hz.filter(|_| estimator.band.bins().is_some());
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
    sums: Sums,
}

impl Estimator {
    /// The estimator for frames with this number of samples of each channel.
    pub(super) fn new(array: &RadioArray, samples: usize, is_real: bool) -> Result<Self, InputError> {
        Ok(Self {
            beam: array.beam.build()?,
            source: Source { floor_rad: array.sigma_floor_rad.unwrap_or(0.0) }.build()?,
            band: Band::of(samples, is_real, array)?,
            samples,
            sums: Sums::default(),
        })
    }

    /// Refuses a band so narrow that its bins in so many frames can tell no source from noise.
    fn check_enough(&self, looks: usize) -> Result<(), InputError> {
        let Some(bins) = self.band.bins() else { return Ok(()) };
        let enough = |looks: usize| can_tell(self.beam.antennas(), (bins * looks) as f32 * self.band.worth());
        if enough(looks) {
            return Ok(());
        }
        let needed = (looks..=100).find(|looks| enough(*looks)).unwrap_or(100);
        let (samples, antennas) = (self.samples, self.beam.antennas());
        Err(InputError::new(format!(
            "tone_band_hz: {bins} bins of {samples} samples cannot tell a source from noise with {antennas} antennas; a wider band, \
             longer frames, or --looks {needed}"
        )))
    }

    /// Takes a frame, channel after channel, less the mean of each channel; it counts for a share.
    pub(super) fn add(&mut self, values: &[Complex32], means: &[Complex32], share: f32) {
        let less = |(channel, mean): (&[Complex32], &Complex32)| channel.iter().map(|value| value - mean).collect();
        let channels = values.chunks_exact(self.samples).zip(means).map(less).collect::<Vec<_>>();
        self.band.add(&self.beam, &channels, share, &mut self.sums);
    }

    /// The bearing of the frames since the last bearing.
    pub(super) fn take(&mut self, time: u64) -> Arrival {
        let sums = std::mem::take(&mut self.sums);
        let mut arrival = self.source.bearing(&self.beam, &sums.covariance, self.band.hz(&sums) as f32, Instant(time));
        let bearing = &mut arrival.bearing;
        if sums.is_leaked() && !bearing.flags.contains(Flags::NO_SIGNAL) {
            (bearing.valid, bearing.flags) = (false, bearing.flags.with(Flags::INTERFERER));
        }
        arrival
    }
}

/// A receiver's own offset of each channel: the mean, where it is much the same in all parts of a recording.
pub(super) struct Offset {
    sums: Vec<Complex64>,
    squares: f64,
    means: usize,
    /// Of a frame.
    parts: usize,
}

impl Offset {
    /// For so many frames. Few are cut into parts.
    pub(super) fn new(channels: usize, frames: usize) -> Self {
        let parts = OFFSET_PARTS.div_ceil(frames.max(1));
        Self { sums: vec![Complex64::default(); channels], squares: 0.0, means: 0, parts }
    }

    /// Takes a frame, channel after channel. A part that is not finite does not count.
    pub(super) fn add<'a>(&mut self, channels: impl Iterator<Item = &'a [Complex32]>) {
        let channels: Vec<&[Complex32]> = channels.collect();
        let length = channels.first().map_or(0, |channel| channel.len() / self.parts);
        if length == 0 {
            return;
        }
        let wide = |value: &Complex32| Complex64::new(f64::from(value.re), f64::from(value.im));
        for part in 0..self.parts {
            let of_part = |channel: &&[Complex32]| channel.iter().skip(part * length).take(length).map(wide).sum();
            let means: Vec<Complex64> = channels.iter().map(of_part).collect();
            if means.iter().all(|mean| mean.is_finite()) {
                for (sum, mean) in self.sums.iter_mut().zip(means) {
                    *sum += mean / length as f64;
                    self.squares += mean.norm_sqr() / (length * length) as f64;
                }
                self.means += 1;
            }
        }
    }

    /// The offset of each channel; zeros where there is none.
    pub(super) fn means(&self) -> Vec<Complex32> {
        let count = self.means as f64;
        let alike = self.sums.iter().map(Complex64::norm_sqr).sum::<f64>() / count;
        let is_offset = 2 * self.means >= OFFSET_PARTS && alike > OFFSET_SHARE * self.squares;
        let mean = |sum: &Complex64| Complex32::new((sum.re / count) as f32, (sum.im / count) as f32);
        self.sums.iter().map(|sum| if is_offset { mean(sum) } else { Complex32::default() }).collect()
    }
}

#[cfg(test)]
mod tests;
