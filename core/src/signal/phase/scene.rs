//! Scenes for the tests of this module: one tone, its neighbours in the spectrum, and its truth in `f64`.

use super::{Complex, Config, Extractor, Phasors};
use crate::base::adc::{AdcFrame, CHANNELS};
use crate::base::rng::Rng;
use std::f64::consts::TAU;
use std::vec::Vec;

const RATE: f32 = 102_400.0;

/// One tone, with a phase per channel at the middle of the block, and its neighbours in the spectrum.
#[derive(Clone, Copy)]
pub(super) struct Scene {
    pub(super) bins: f64,
    pub(super) amplitude: [f64; CHANNELS],
    pub(super) phases: [f64; CHANNELS],
    pub(super) sigma: f64,
    pub(super) dc: [f64; CHANNELS],
    /// Bins, amplitude and phase of another tone.
    pub(super) other: [f64; 3],
    /// What filters the noise: its power over that of white noise, by frequency in hertz.
    pub(super) colour: Option<fn(f64) -> f64>,
}

impl Scene {
    pub(super) fn new(bins: f64, amplitude: f64, sigma: f64) -> Self {
        Self {
            bins,
            amplitude: [amplitude; CHANNELS],
            phases: [0.3, -1.1, 2.0, -2.9],
            sigma,
            dc: [0.0; CHANNELS],
            other: [0.0; 3],
            colour: None,
        }
    }

    /// The largest amplitude that leaves 4 standard deviations to the rails, but not below 60 ADC units.
    pub(super) fn at_snr(bins: f64, snr_db: f64) -> Self {
        let ratio = (2.0 * 10_f64.powf(snr_db / 10.0)).sqrt();
        let sigma = 1800.0 / (ratio + 4.0);
        Self::new(bins, ratio * sigma, sigma)
    }

    pub(super) fn silence(sigma: f64) -> Self {
        Self::new(10.0, 0.0, sigma)
    }

    pub(super) fn with_random_phases(mut self, rng: &mut Rng) -> Self {
        self.phases = [0; CHANNELS].map(|_| f64::from(rng.uniform()) * TAU);
        self.other[2] = f64::from(rng.uniform()) * TAU;
        self
    }

    pub(super) fn frame<const N: usize>(&self, rng: &mut Rng) -> AdcFrame<N> {
        let mut frame = AdcFrame::zeroed();
        let taps = self.colour.map(taps);
        for (channel, row) in frame.codes.iter_mut().enumerate() {
            let noise = noise::<N>(taps.as_deref(), rng);
            for (n, code) in row.iter_mut().enumerate() {
                let t = (n as f64 - (N as f64 - 1.0) / 2.0) * TAU / N as f64;
                let value = self.dc[channel]
                    + self.amplitude[channel] * (self.bins * t + self.phases[channel]).cos()
                    + self.other[1] * (self.other[0] * t + self.other[2]).cos()
                    + self.sigma * noise[n];
                *code = value.round().clamp(-2048.0, 2047.0) as i16;
            }
        }
        frame
    }

    /// Errors of the phase differences to channel 0, in radians.
    pub(super) fn errors(&self, phasors: &Phasors) -> [f64; 3] {
        [1, 2, 3].map(|m| wrapped(arg(phasors.z[m]) - arg(phasors.z[0]) - self.phases[m] + self.phases[0]))
    }

    /// Cramer-Rao bound of a phase difference, radians; rounding to codes counts as noise.
    pub(super) fn bound<const N: usize>(&self) -> f64 {
        (2.0 * 2.0 * (self.sigma * self.sigma + 1.0 / 12.0) / (N as f64 * self.amplitude[0].powi(2))).sqrt()
    }
}

/// Taps of a filter.
const TAPS: usize = 256;

/// The filter without delay that gives white noise this power.
fn taps(colour: fn(f64) -> f64) -> Vec<f64> {
    let gain = |bin: usize| colour(bin as f64 * f64::from(RATE) / TAPS as f64).sqrt();
    let tap = |n: usize| {
        let wave = |bin: usize| (TAU * (bin * n) as f64 / TAPS as f64).cos();
        let sum: f64 = (1..TAPS / 2).map(|bin| 2.0 * gain(bin) * wave(bin)).sum();
        (gain(0) + sum + gain(TAPS / 2) * wave(TAPS / 2)) / TAPS as f64
    };
    (0..TAPS).map(|n| tap((n + TAPS / 2) % TAPS)).collect()
}

/// Noise of variance one, behind the filter.
fn noise<const N: usize>(taps: Option<&[f64]>, rng: &mut Rng) -> Vec<f64> {
    let taps = taps.unwrap_or(&[1.0]);
    let white: Vec<f64> = (1..N + taps.len()).map(|_| f64::from(rng.gaussian())).collect();
    white.windows(taps.len()).map(|past| past.iter().zip(taps).map(|(value, tap)| value * tap).sum()).collect()
}

pub(super) fn arg(z: Complex) -> f64 {
    f64::from(z.im).atan2(f64::from(z.re))
}

pub(super) fn wrapped(angle: f64) -> f64 {
    (angle + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0
}

pub(super) fn rms(values: &[f64]) -> f64 {
    assert!(!values.is_empty());
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

pub(super) fn open_config() -> Config {
    Config { tone_band_hz: [0.0, RATE / 2.0], ..Config::default() }
}

pub(super) fn extractor<const N: usize>() -> Extractor<N> {
    open_config().build().unwrap()
}

pub(super) fn bins_of<const N: usize>(phasors: &Phasors) -> f64 {
    f64::from(phasors.frequency_hz / RATE) * N as f64
}

pub(super) fn assert_finite(phasors: &Phasors) {
    for z in phasors.z {
        assert!(z.re.is_finite() && z.im.is_finite(), "{phasors:?}");
    }
    assert!(phasors.noise.iter().all(|noise| noise.is_finite() && *noise > 0.0), "{phasors:?}");
    assert!(phasors.snr_db.is_finite() && phasors.frequency_hz.is_finite(), "{phasors:?}");
}

/// Least squares of cosine, sine and a constant at a given frequency, in f64: the oracle of the fit.
pub(super) fn reference_fit(row: &[i16], bins: f64) -> (f64, f64) {
    let n = row.len() as f64;
    let mut normal = [[0.0_f64; 4]; 3];
    for (k, code) in row.iter().enumerate() {
        let (s, c) = ((k as f64 - (n - 1.0) / 2.0) * TAU * bins / n).sin_cos();
        let regressors = [c, s, 1.0];
        for (equation, left) in normal.iter_mut().zip(regressors) {
            for (sum, right) in equation.iter_mut().zip([c, s, 1.0, f64::from(*code)]) {
                *sum += left * right;
            }
        }
    }
    for pivot in 0..3 {
        for other in 0..3 {
            if other != pivot {
                let factor = normal[other][pivot] / normal[pivot][pivot];
                let row = normal[pivot];
                for (value, subtracted) in normal[other].iter_mut().zip(row) {
                    *value -= factor * subtracted;
                }
            }
        }
    }
    let [a, b] = [0, 1].map(|k| normal[k][3] / normal[k][k]);
    (a, -b)
}

pub(super) fn vec() -> Vec<f64> {
    Vec::new()
}
