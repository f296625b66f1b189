//! Bearings, spectrum and eigenvalues of the covariance of a recording, for `foxhound listen`.

use std::fmt::Write as _;
use std::path::Path;

use foxhound_core::doa::beam::Covariance;
use rustfft::FftPlanner;

use super::bearings::{ArrayLine, refuse_left};
use super::eigen;
use super::iq::{self, Frames};
use super::radio_array::RadioArray;
use super::switched::{self, Packets};
use crate::scenario::input::InputError;

/// Largest number of points of the displayed spectrum.
const POINTS: usize = 512;

/// Results of a recording.
#[derive(Clone, Debug)]
pub struct Listened {
    /// The bearings.
    pub lines: Vec<ArrayLine>,
    /// The covariance's eigenvalues of each, largest first.
    pub eigenvalues: Vec<Vec<f64>>,
    /// Frequency and mean power of all channels, relative to the strongest; empty for an array behind a switch, whose slots are too short.
    pub spectrum: Vec<[f64; 2]>,
    /// The occupied band, if it is given.
    pub band_hz: Option<[f64; 2]>,
    /// What was read.
    pub taken: String,
}

/// Processes a recording: as `bearing --switched` if the array file has `[switch]`, else as `bearing --iq`.
///
/// # Errors
/// Names the file or the key, and what is wrong with it.
pub fn listen(path: &Path, array: &RadioArray, looks: usize) -> Result<Listened, InputError> {
    let mut eigenvalues = Vec::new();
    let mut watch = |covariance: &Covariance| eigenvalues.push(eigen::values(covariance, array.beam.count));
    if array.switch.is_some() {
        let packets = Packets::read(path, None, array)?;
        let (lines, left) = switched::find_watched(&packets, array, looks, |group| watch(&group.covariance()))?;
        let mut taken = packets.taken().to_owned();
        if left > 0 {
            let _ = write!(taken, "; {left} packets make no group of {looks}");
        }
        return Ok(Listened { lines, eigenvalues, spectrum: Vec::new(), band_hz: None, taken });
    }
    let frames = Frames::read(path, array)?;
    refuse_left(frames.count() % looks, frames.count(), "frames", looks)?;
    let lines = iq::find_watched(&frames, array, looks, watch)?;
    let (spectrum, band_hz) = (spectrum(&frames, array.sample_rate_hz), array.band_hz);
    Ok(Listened { lines, eigenvalues, spectrum, band_hz, taken: frames.taken() })
}

/// Mean power over channels and frames, in at most [`POINTS`] points.
fn spectrum(frames: &Frames, rate_hz: f64) -> Vec<[f64; 2]> {
    let samples = frames.samples();
    let fft = FftPlanner::<f32>::new().plan_fft_forward(samples);
    let mut power = vec![0.0_f64; samples];
    for channel in frames.channels() {
        let mut bins = channel.to_vec();
        for (k, value) in bins.iter_mut().enumerate() {
            let part = std::f32::consts::TAU * (k as f32 + 0.5) / samples as f32;
            *value *= 0.5 - 0.5 * part.cos();
        }
        fft.process(&mut bins);
        // One sample that is no number makes all bins none.
        if !bins.iter().all(|value| value.is_finite()) {
            continue;
        }
        for (sum, value) in power.iter_mut().zip(&bins) {
            *sum += f64::from(value.norm_sqr());
        }
    }
    power.rotate_left(samples.div_ceil(2));
    let width = samples.div_ceil(POINTS);
    let most = power.iter().copied().filter(|value| value.is_finite()).fold(f64::MIN_POSITIVE, f64::max);
    let bin_hz = rate_hz / samples as f64;
    let point = |(at, part): (usize, &[f64])| {
        let strongest = part.iter().copied().filter(|value| value.is_finite()).fold(most * 1e-12, f64::max);
        let middle = (at * width) as f64 + 0.5 * (part.len() - 1) as f64;
        [(middle - (samples / 2) as f64) * bin_hz, 10.0 * (strongest / most).log10()]
    };
    power.chunks(width).enumerate().map(point).collect()
}

#[cfg(test)]
mod tests {
    use num_complex::Complex32;

    use super::*;
    use crate::tools::frames::Samples;

    #[test]
    fn a_sample_that_is_no_number_does_not_empty_the_spectrum() {
        let tone = |at: usize| Complex32::from_polar(1.0, 0.25 * std::f32::consts::TAU * at as f32);
        let mut values: Vec<_> = (0..2 * 2 * 64).map(tone).collect();
        values[70] = Complex32::new(f32::NAN, 0.0);
        let read = Samples {
            channels: 2,
            samples: 64,
            values,
            is_real: false,
            repeated: 0,
            extremes: None,
            kind: String::new(),
        };
        let spectrum = spectrum(&Frames::checked(read, 2).unwrap(), 64.0);
        let highest = spectrum.iter().max_by(|a, b| a[1].total_cmp(&b[1])).unwrap();
        assert_eq!(*highest, [16.0, 0.0]);
        assert!(spectrum[10][1] < -40.0, "{spectrum:?}");
    }
}
