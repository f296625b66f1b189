//! The occupied band of a frame's spectrum, and how many independent samples it holds.
//!
//! Noise that a filter has narrowed has fewer: `(sum r)^2 / sum r^2` for `r` its spectrum. That is measured, bin by bin, on what is left of the
//! channels beside the plane wave that fits best and the strongest wave beside it, which may be a second emitter, a reflection, or what
//! unlike channels leave of the first. Of two channels it is what is left beside their strongest component.

use foxhound_core::base::adc::ANTENNAS_MAX;
use foxhound_core::doa::beam::{Beam, Covariance, Vector};
use foxhound_core::signal::phase::Complex;
use num_complex::Complex32;
use rustfft::FftPlanner;

use super::RadioArray;
use crate::scenario::input::InputError;

/// Share of a frame at either end that a window tapers: little, to use nearly all samples, or all, for the least leakage (Hann).
const TAPER: f64 = 0.07;
const HANN: f64 = 0.5;
/// Half-width, in bins, for a tone without a band.
const TONE_BINS: f64 = 4.0;
/// Steps of the power iteration for an eigenvector.
const STEPS: usize = 12;
/// What rounding leaves of a wave, as a share of its power.
const ROUNDING: f32 = 1e-9;

/// What frames add up to.
#[derive(Default)]
pub(super) struct Sums {
    pub(super) covariance: Covariance,
    /// Of the frequency and the power, for the centre of the band.
    moment: f64,
    power: f64,
}

impl Sums {
    /// Centre of the power in the band.
    pub(super) fn hz(&self) -> f64 {
        if self.power > 0.0 { self.moment / self.power } else { 0.0 }
    }
}

/// The weights of a frame's samples; the sum of their squares is one.
struct Window {
    weights: Vec<f32>,
    /// Number of independent samples that a bin of a band stands for.
    worth: f32,
}

impl Window {
    fn new(samples: usize, taper: f64) -> Self {
        let tapered = taper * samples as f64;
        let weight = |k: usize| {
            let from_edge = (k.min(samples - 1 - k) as f64 + 0.5) / tapered;
            if from_edge < 1.0 { 0.5 - 0.5 * libm::cos(std::f64::consts::PI * from_edge) } else { 1.0 }
        };
        let length = (0..samples).map(|k| weight(k).powi(2)).sum::<f64>().sqrt();
        let weights: Vec<f32> = (0..samples).map(|k| (weight(k) / length) as f32).collect();
        let fourths: f32 = weights.iter().map(|weight| weight.powi(4)).sum();
        Self { weights, worth: 1.0 / (fourths * samples as f32) }
    }
}

/// The bins of a frame in the occupied band.
pub(super) struct Band {
    /// Each with its frequency; `None` if the whole spectrum is occupied.
    bins: Option<Vec<(usize, f64)>>,
    window: Window,
    fft: std::sync::Arc<dyn rustfft::Fft<f32>>,
}

impl Band {
    pub(super) fn of(samples: usize, is_real: bool, array: &RadioArray) -> Result<Self, InputError> {
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
        let window = Window::new(samples, if bins.is_some() { TAPER } else { HANN });
        Ok(Self { bins, window, fft: FftPlanner::new().plan_fft_forward(samples) })
    }

    /// Number of bins in the band, if there is one.
    pub(super) fn bins(&self) -> Option<usize> {
        self.bins.as_ref().map(Vec::len)
    }

    /// Number of independent samples that a bin stands for.
    pub(super) fn worth(&self) -> f32 {
        self.window.worth
    }

    /// Adds a frame.
    pub(super) fn add(&self, beam: &Beam, channels: Vec<Vec<Complex32>>, sums: &mut Sums) {
        let mut spectra = channels.clone();
        for spectrum in &mut spectra {
            for (value, weight) in spectrum.iter_mut().zip(&self.window.weights) {
                *value *= weight;
            }
            self.fft.process(spectrum);
        }
        let mut own = Covariance::default();
        let bins: Vec<Vector> = match &self.bins {
            Some(bins) => {
                let heard: Vec<Vector> = bins.iter().map(|(bin, _)| at(&spectra, *bin)).collect();
                for (z, (_, hz)) in heard.iter().zip(bins) {
                    let power = f64::from(power_of(z));
                    sums.moment += hz * power;
                    sums.power += power;
                    own.add(z, self.window.worth);
                }
                heard
            }
            None => {
                let samples = self.window.weights.len();
                (0..samples).for_each(|k| own.add(&at(&channels, k), 1.0));
                (0..samples).map(|k| at(&spectra, k)).collect()
            }
        };
        sums.covariance.join(&own, flatness(beam, &own, bins));
    }
}

/// What the channels have at one place.
fn at(channels: &[Vec<Complex32>], k: usize) -> Vector {
    let mut z = Vector::default();
    for (z, channel) in z.iter_mut().zip(channels).take(ANTENNAS_MAX) {
        *z = Complex { re: channel[k].re, im: channel[k].im };
    }
    z
}

fn power_of(z: &Vector) -> f32 {
    z.iter().map(|z| z.norm_squared()).sum()
}

/// Takes the part along a vector of length one away, and returns its power.
fn take_out(z: &mut Vector, along: &Vector) -> f32 {
    let part = z.iter().zip(along).fold(Complex::default(), |sum, (z, a)| sum.plus(z.times_conj(*a)));
    for (z, a) in z.iter_mut().zip(along) {
        *z = z.plus(part.times(*a).scaled(-1.0));
    }
    part.norm_squared()
}

/// The eigenvector of the largest eigenvalue, of length one.
fn strongest(covariance: &Covariance) -> Vector {
    // Any direction that is not at right angles to it.
    let mut vector: Vector = std::array::from_fn(|k| Complex::at((k * k) as f32));
    for _ in 0..STEPS {
        let length = vector.iter().map(|z| f64::from(z.re).powi(2) + f64::from(z.im).powi(2)).sum::<f64>().sqrt();
        if !(length > 0.0) || !length.is_finite() {
            return Vector::default();
        }
        vector = covariance.times(&vector.map(|z| z.scaled((1.0 / length) as f32)));
    }
    let length = vector.iter().map(|z| f64::from(z.re).powi(2) + f64::from(z.im).powi(2)).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() { vector.map(|z| z.scaled((1.0 / length) as f32)) } else { Vector::default() }
}

/// The share of the samples that are independent, by the spectrum of what the strongest waves leave.
fn flatness(beam: &Beam, covariance: &Covariance, mut bins: Vec<Vector>) -> f32 {
    let Some(peak) = beam.find(covariance) else { return 1.0 };
    let mut wave = if peak.antennas > 2 { beam.toward(peak.azimuth_rad) } else { strongest(covariance) };
    let mut heard = 0.0;
    for (k, z) in wave.iter_mut().enumerate() {
        *z = if covariance.lives(k) { *z } else { Complex::default() };
        heard += z.norm_squared();
    }
    wave = wave.map(|z| z.scaled(1.0 / heard.max(f32::MIN_POSITIVE).sqrt()));
    let mut rounding: Vec<f32> = bins.iter_mut().map(|z| ROUNDING * take_out(z, &wave)).collect();
    let mut freedom = peak.antennas as f64 - 1.0;
    if peak.antennas > 2 {
        let mut beside = Covariance::default();
        bins.iter().for_each(|z| beside.add(z, 1.0));
        let second = strongest(&beside);
        for (z, rounding) in bins.iter_mut().zip(&mut rounding) {
            *rounding += ROUNDING * take_out(z, &second);
        }
        freedom -= 1.0;
    }
    let left = bins.iter().zip(&rounding).map(|(z, rounding)| f64::from((power_of(z) - rounding).max(0.0)));
    let (sum, squares) = left.fold((0.0, 0.0), |(sum, squares), power| (sum + power, squares + power * power));
    let count = bins.len() as f64;
    // Of white noise they scatter as well: by their mean over the root of the degrees of freedom; and that scatter is only so well known.
    let of_white = 1.0 + 1.0 / freedom;
    let unsure = 1.0 + (2.0 * of_white / count).sqrt() / (freedom + 1.0);
    let flatness = of_white * unsure * sum * sum / (squares * count);
    if squares > 0.0 && flatness < 1.0 { flatness as f32 } else { 1.0 }
}
