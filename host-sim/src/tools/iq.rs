//! `foxhound bearing --iq`: from recorded complex samples of several coherent channels to bearings.
//!
//! The covariance is that of a frame's spectrum in the occupied band, bin by bin, or of its samples if no band is given. A window
//! tapered at both ends keeps out signals outside the band. Of real samples only positive frequencies are used.
//!
//! - **At 0 Hz** a direct-conversion receiver has an offset of its own, which looks like a source. Where the mean is much the same in
//!   all frames, or in eight parts of fewer, it is taken out, and with it what a transmitter sends at less than about half a turn in all of it.
//!   Where it wanders slowly, over eight frames or more, the bins beside 0 Hz are left out. What a transmitter sends there turns.
//! - **Samples and bins count for less where noise is not white**, and a bearing to what stands beside the band is not valid, see `band`.

use std::f64::consts::PI;
use std::path::Path;

use foxhound_core::base::time::Instant;
use foxhound_core::doa::beam::{Arrival, Beam, Covariance};
use foxhound_core::doa::bearing::Flags;
use num_complex::{Complex32, Complex64};

use super::bearings::{ArrayLine, mark_clipped};
use super::frames::{Samples, npy_type, read_npy};
use super::radio_array::RadioArray;
use super::{sigmf, wav};
use crate::scenario::input::{InputError, read_bytes};

mod band;
mod source;
use band::{Band, Sums};
use source::{Source, can_tell};

/// An offset is looked for in so many parts, of which half are enough, and known where so much of their means is alike.
const OFFSET_PARTS: usize = 8;
const OFFSET_SHARE: f64 = 0.5;
/// The offset wanders where this much of its power goes on from part to part, and does not turn by more than this share of it.
const WANDERS: f64 = 0.5;
const WANDERS_TURN: f64 = 0.2;
/// A converter has at least so many codes on either side of zero.
const RAIL_STEPS: f32 = 32.0;
/// Half frames in a frame, an eighth apart.
const PLACES: usize = 5;
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
    /// Whether the receiver's own offset changes slowly.
    wanders: bool,
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
        let extremes = rails(&values).or(extremes);
        let is_extreme = |value: &&Complex32| {
            extremes
                .is_some_and(|[least, most]| [value.re, value.im].iter().any(|part| *part <= least || *part >= most))
        };
        let clipped = values.chunks_exact(channels * samples).map(|frame| frame.iter().filter(is_extreme).count());
        let clipped = clipped.collect();
        let means = offset.means();
        // Of real samples what is beside 0 Hz is left out anyway.
        let wanders = !is_real && wanders(&values, channels, samples);
        Ok(Self { channels, samples, values, is_real, repeated, clipped, kind, means, wanders })
    }

    /// What was read.
    #[must_use]
    pub fn taken(&self) -> String {
        let share = self.share_at_zero();
        let mut note = String::new();
        if share > 0.01 {
            note = format!("; {:.0} % of the power are at 0 Hz, taken for the receiver's own offset", 100.0 * share);
        }
        if self.wanders {
            note += "; the receiver's own offset wanders, what is beside 0 Hz is left out";
        }
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

/// Where a converter of fewer bits than the format ends, or one whose codes were scaled: its least value is a power of two, and its largest a
/// lesser power of two below it, or both are one. A recording that does not reach them has such values by chance, and seldom.
fn rails(values: &[Complex32]) -> Option<[f32; 2]> {
    let parts = values.iter().flat_map(|value| [value.re, value.im]).filter(|part| part.is_finite());
    let ends = parts.fold([f32::INFINITY, f32::NEG_INFINITY], |[least, most], part| [least.min(part), most.max(part)]);
    let is_power = |value: f32| value > f32::MIN_POSITIVE && value.to_bits() << 9 == 0;
    let [full, step] = [-ends[0], -ends[0] - ends[1]];
    let is_converter = is_power(full) && is_power(step) && step <= full / RAIL_STEPS;
    (is_converter || ends == [-1.0, 1.0]).then_some(ends)
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
    let mut estimator = Estimator::new(array, frames.samples, frames.is_real, frames.wanders)?;
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
            let is_banded = array.band_hz.is_some() || array.tone_hz.is_some() || frames.is_real;
            line.line.freq_hz = line.line.freq_hz.filter(|_| is_banded && estimator.band.bins().is_some());
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
    /// The estimator for frames with this number of samples of each channel; without what is beside 0 Hz where the receiver's own offset wanders.
    pub(super) fn new(array: &RadioArray, samples: usize, is_real: bool, wanders: bool) -> Result<Self, InputError> {
        Ok(Self {
            beam: array.beam.build()?,
            source: Source { floor_rad: array.sigma_floor_rad.unwrap_or(0.0) }.build()?,
            band: Band::of(samples, is_real, wanders, array)?,
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

/// Whether the receiver's own offset changes slowly: tapered means of half a frame, less the mean of all of them, resemble those an eighth of a frame
/// later and those of the next frame, and do not turn as those of a transmitter do. By the taper they hold what is within four bins of 0 Hz, and that
/// turns by less than half a turn in an eighth of a frame.
fn wanders(values: &[Complex32], channels: usize, samples: usize) -> bool {
    let (hop, half) = (samples / 8, samples / 2);
    let weights: Vec<f64> = (0..half).map(|k| libm::sin(PI * (k as f64 + 0.5) / half as f64).powi(2)).collect();
    let mean = |channel: &[Complex32], place: usize| {
        let part = channel[place * hop..].iter().zip(&weights);
        part.map(|(value, weight)| Complex64::new(value.re.into(), value.im.into()) * weight).sum::<Complex64>()
    };
    // One after the other; in each all channels.
    let mut frames: Vec<Vec<Complex64>> = Vec::new();
    for frame in values.chunks_exact(channels * samples) {
        let places = (0..PLACES).flat_map(|place| frame.chunks_exact(samples).map(move |channel| (channel, place)));
        frames.push(places.map(|(channel, place)| mean(channel, place)).collect());
    }
    frames.retain(|means| means.iter().all(|mean| mean.is_finite()));
    if hop == 0 || frames.len() < OFFSET_PARTS {
        return false;
    }
    for channel in 0..channels {
        let all = frames.iter().flat_map(|means| means.iter().skip(channel).step_by(channels));
        let middle = all.sum::<Complex64>() / (frames.len() * PLACES) as f64;
        for mean in frames.iter_mut().flat_map(|means| means.iter_mut().skip(channel).step_by(channels)) {
            *mean -= middle;
        }
    }
    let places = frames.iter().flat_map(|means| means.iter().zip(&means[channels..]));
    let following = frames.windows(2).flat_map(|two| two[0].iter().zip(&two[1]));
    stays(places) && stays(following)
}

/// Whether most of these goes on from the first to the second of each pair, and does not turn.
fn stays<'a>(pairs: impl Iterator<Item = (&'a Complex64, &'a Complex64)>) -> bool {
    let (mut alike, mut power) = (Complex64::default(), 0.0);
    for (before, after) in pairs {
        alike += after * before.conj();
        power += 0.5 * (before.norm_sqr() + after.norm_sqr());
    }
    alike.re > WANDERS * power && alike.im.abs() < WANDERS_TURN * alike.re
}

#[cfg(test)]
mod tests;
