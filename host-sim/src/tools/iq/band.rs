//! The occupied band of a frame's spectrum, and how many independent samples it holds.
//!
//! Noise that a filter has narrowed has fewer: `(sum r)^2 / sum r^2` for `r` its spectrum. That is measured, bin by bin, on what is left of the
//! channels beside the plane wave that fits best and the strongest wave beside it, which may be a second emitter, a reflection, or what
//! unlike channels leave of the first. Of two channels it is what is left beside their strongest component.

use foxhound_core::base::adc::ANTENNAS_MAX;
use foxhound_core::doa::beam::{Beam, Covariance, Peak, Vector};
use foxhound_core::signal::phase::Complex;
use num_complex::{Complex32, Complex64};
use rustfft::FftPlanner;

use super::RadioArray;
use crate::scenario::input::InputError;

/// Share of a frame at either end that a window tapers: little, to use nearly all samples, or all, for the least leakage (Hann).
const TAPER: f64 = 0.07;
const HANN: f64 = 0.5;
/// Bins beside a band that count for it, and those behind them from which something may come in.
const EDGE: usize = 2;
const REACH: usize = 32;
/// Samples of a window by which its shares are known: they hardly depend on their number.
const SHARES_OF: usize = 1024;
/// A bin stands above the noise by this many times.
const ABOVE_NOISE: f32 = 4.0;
/// Share of what a frame hears that another window is taken for, and of what a bearing is made of that makes it invalid.
const LEAK_WINDOW: f32 = 0.03;
const LEAK_MOST: f32 = 0.1;
/// Bins left out at either end of the spectrum of real samples, where a frequency stands beside its mirror image.
const REAL_ENDS: f64 = 3.0;
/// Bins left out on either side of 0 Hz where the receiver's own offset wanders.
const WANDERS_BINS: usize = 5;
/// Half-width, in bins, for a tone without a band.
const TONE_BINS: f64 = 4.0;
/// Steps of the power iteration for an eigenvector.
const STEPS: usize = 12;
/// Noise is narrow where its spectrum differs from a flat one by more than so many standard deviations.
const UNSURE_SIGMAS: f64 = 3.0;
/// What rounding leaves of a wave, as a share of its power.
const ROUNDING: f32 = 1e-9;

/// What frames add up to.
#[derive(Default)]
pub(super) struct Sums {
    pub(super) covariance: Covariance,
    /// Power of the plane waves that fit best, and what of it may have come in from beside the band.
    wave: f32,
    leak: f32,
    /// Of the frequency and the power, for the centre of the band.
    moment: f64,
    power: f64,
}

impl Sums {
    /// Centre of the power in the band.
    fn hz(&self) -> f64 {
        if self.power > 0.0 { self.moment / self.power } else { 0.0 }
    }

    /// Whether much of what is heard may have come in from beside the band.
    pub(super) fn is_leaked(&self) -> bool {
        self.leak > LEAK_MOST * self.wave
    }
}

/// The weights of a frame's samples; the sum of their squares is one.
struct Window {
    weights: Vec<f32>,
    /// Number of independent samples that a bin of a band stands for.
    worth: f32,
    /// Bins beside the band, and which share of what they hold comes into it.
    beside: Vec<(usize, f32)>,
}

impl Window {
    fn new(samples: usize, taper: f64) -> Self {
        let weights = weights(samples, taper);
        let fourths: f32 = weights.iter().map(|weight| weight.powi(4)).sum();
        Self { weights, worth: 1.0 / (fourths * samples as f32), beside: Vec::new() }
    }

    /// With what may come into a band.
    fn of(samples: usize, taper: f64, bins: &[(usize, f64)]) -> Self {
        let mut is_inside = vec![false; samples];
        bins.iter().for_each(|(bin, _)| is_inside[*bin] = true);
        let is_inside = &is_inside;
        // The spectrum has no ends.
        let farthest = 2 * REACH.min((samples - 1) / 4);
        let shares = shares(&weights(samples.min(SHARES_OF), taper), farthest);
        let inside = |bin: usize, most: usize| {
            let most = most.min(farthest);
            (0..=2 * most)
                .filter(move |at| is_inside[(bin + samples + at - most) % samples])
                .map(move |at| at.abs_diff(most))
        };
        let mut beside = Vec::new();
        for bin in 0..samples {
            let nearest = inside(bin, REACH).min();
            if nearest.is_some_and(|nearest| nearest > EDGE) {
                beside.push((bin, inside(bin, farthest).map(|apart| shares[apart]).sum()));
            }
        }
        Self { beside, ..Self::new(samples, taper) }
    }
}

/// The weights of a window that tapers a share at either end; the sum of their squares is one.
fn weights(samples: usize, taper: f64) -> Vec<f32> {
    let tapered = taper * samples as f64;
    let weight = |k: usize| {
        let from_edge = (k.min(samples - 1 - k) as f64 + 0.5) / tapered;
        if from_edge < 1.0 { 0.5 - 0.5 * libm::cos(std::f64::consts::PI * from_edge) } else { 1.0 }
    };
    let length = (0..samples).map(|k| weight(k).powi(2)).sum::<f64>().sqrt();
    (0..samples).map(|k| (weight(k) / length) as f32).collect()
}

/// Which share of a tone's power a bin holds that is so many bins away, on average over tones between two bins.
fn shares(weights: &[f32], farthest: usize) -> Vec<f32> {
    let samples = weights.len() as f64;
    let power = |bins: f64| {
        let turn = Complex64::from_polar(1.0, std::f64::consts::TAU * bins / samples);
        let (mut sum, mut at) = (Complex64::default(), Complex64::new(1.0, 0.0));
        for weight in weights {
            sum += at * f64::from(*weight);
            at *= turn;
        }
        sum.norm_sqr() / samples
    };
    let between = [-0.375, -0.125, 0.125, 0.375];
    (0..=farthest)
        .map(|apart| between.map(|part| power(apart as f64 + part)).iter().sum::<f64>() as f32 / 4.0)
        .collect()
}

/// The bins of a frame in the occupied band.
pub(super) struct Band {
    /// Each with its frequency; `None` if the whole spectrum is occupied.
    bins: Option<Vec<(usize, f64)>>,
    /// The first is taken; the others where they let in less.
    windows: Vec<Window>,
    rate_hz: f64,
    fft: std::sync::Arc<dyn rustfft::Fft<f32>>,
}

impl Band {
    pub(super) fn of(samples: usize, is_real: bool, wanders: bool, array: &RadioArray) -> Result<Self, InputError> {
        let rate_hz = array.sample_rate_hz;
        let bin_hz = rate_hz / samples as f64;
        let around_tone = |tone_hz: f64| [tone_hz - TONE_BINS * bin_hz, tone_hz + TONE_BINS * bin_hz];
        let mut band_hz = array.band_hz.or(array.tone_hz.map(around_tone));
        if is_real {
            if let Some([low_hz, high_hz]) = array.band_hz.filter(|[low_hz, _]| *low_hz < 0.0) {
                let text = format!("tone_band_hz = [{low_hz}, {high_hz}]: real samples have no frequencies below zero");
                return Err(InputError::new(text));
            }
            let [low_hz, high_hz] = band_hz.unwrap_or([0.0, 0.5 * rate_hz]);
            let least_hz = REAL_ENDS * bin_hz;
            band_hz = Some([low_hz.max(least_hz), high_hz.min(0.5 * rate_hz - least_hz)]);
        }
        // A band about a tone near half the sample rate goes on at the other end.
        let hz = |bin: usize, [low_hz, high_hz]: [f64; 2]| {
            let all = [0.0, 1.0, -1.0, -2.0].map(|turns| (bin as f64 / samples as f64 + turns) * rate_hz);
            all.into_iter().find(|hz| (low_hz..=high_hz).contains(hz))
        };
        let bins = band_hz.map(|band_hz| {
            let all = (0..samples).filter_map(|bin| Some((bin, hz(bin, band_hz)?)));
            all.collect::<Vec<_>>()
        });
        if bins.as_ref().is_some_and(Vec::is_empty) {
            let [low_hz, high_hz] = band_hz.unwrap_or_default();
            let text =
                format!("tone_band_hz = [{low_hz}, {high_hz}] holds no bin of {samples} samples at {rate_hz} Hz");
            return Err(InputError::new(text));
        }
        let all = || (0..samples).map(|bin| (bin, bin as f64 * bin_hz)).collect::<Vec<_>>();
        let bins = if wanders { bins.or_else(|| Some(all())) } else { bins };
        let is_clear = |(bin, _): &(usize, f64)| !wanders || (*bin).min(samples - bin) > WANDERS_BINS;
        let bins = bins.map(|bins| bins.into_iter().filter(is_clear).collect::<Vec<_>>());
        if bins.as_ref().is_some_and(Vec::is_empty) {
            let text = "the receiver's own offset at 0 Hz wanders, and there is nothing but what is beside it";
            return Err(InputError::new(text));
        }
        let bins = bins.filter(|bins| bins.len() < samples);
        let windows = match &bins {
            Some(bins) => [TAPER, HANN].map(|taper| Window::of(samples, taper, bins)).into(),
            None => vec![Window::new(samples, HANN)],
        };
        Ok(Self { bins, windows, rate_hz, fft: FftPlanner::new().plan_fft_forward(samples) })
    }

    /// Number of bins in the band, if there is one.
    pub(super) fn bins(&self) -> Option<usize> {
        self.bins.as_ref().map(Vec::len)
    }

    /// Number of independent samples that a bin stands for.
    pub(super) fn worth(&self) -> f32 {
        self.windows.first().map_or(1.0, |window| window.worth)
    }

    /// Centre of the power in the band.
    pub(super) fn hz(&self, sums: &Sums) -> f64 {
        let hz = sums.hz();
        hz - self.rate_hz * (hz / self.rate_hz).round()
    }

    /// Adds a frame, which counts for a share.
    pub(super) fn add(&self, beam: &Beam, channels: &[Vec<Complex32>], share: f32, sums: &mut Sums) {
        let mut best: Option<Heard> = None;
        for window in &self.windows {
            let heard = self.hear(beam, window, channels);
            let is_clear = heard.leak <= LEAK_WINDOW * heard.wave;
            if best.as_ref().is_none_or(|best| heard.leak * best.wave < best.leak * heard.wave) {
                best = Some(heard);
            }
            if is_clear {
                break;
            }
        }
        let Some(heard) = best else { return };
        let worth = share * heard.worth * heard.left.flatness;
        sums.covariance.join(&heard.covariance, worth);
        sums.wave += worth * heard.wave;
        sums.leak += worth * heard.leak;
        sums.moment += f64::from(share) * heard.moment;
        sums.power += f64::from(share) * heard.power;
    }

    fn hear(&self, beam: &Beam, window: &Window, channels: &[Vec<Complex32>]) -> Heard {
        let mut spectra = channels.to_vec();
        for spectrum in &mut spectra {
            for (value, weight) in spectrum.iter_mut().zip(&window.weights) {
                *value *= weight;
            }
            self.fft.process(spectrum);
        }
        let mut heard = Heard::default();
        let bins: Vec<Vector> = match &self.bins {
            Some(bins) => {
                let found: Vec<Vector> = bins.iter().map(|(bin, _)| at(&spectra, *bin)).collect();
                for (z, (_, hz)) in found.iter().zip(bins) {
                    let power = f64::from(power_of(z));
                    heard.moment += hz * power;
                    heard.power += power;
                    heard.covariance.add(z, 1.0);
                }
                heard.worth = window.worth;
                found
            }
            None => {
                let samples = window.weights.len();
                (0..samples).for_each(|k| heard.covariance.add(&at(channels, k), 1.0));
                heard.worth = 1.0;
                (0..samples).map(|k| at(&spectra, k)).collect()
            }
        };
        let living = heard.covariance.of_the_living();
        let Some(peak) = beam.find(&living) else { return heard };
        heard.wave = peak.share * living.trace();
        heard.left = Left::of(beam, &living, &peak, bins);
        let least = ABOVE_NOISE * peak.antennas as f32 * heard.left.noise;
        let beside = window.beside.iter().map(|(bin, share)| (power_of(&at(&spectra, *bin)), share));
        heard.leak = beside.filter(|(power, _)| *power > least).map(|(power, share)| power * share).sum();
        heard
    }
}

/// What a frame holds.
#[derive(Default)]
struct Heard {
    covariance: Covariance,
    /// Number of independent samples that an element of the covariance stands for, in white noise.
    worth: f32,
    left: Left,
    wave: f32,
    leak: f32,
    moment: f64,
    power: f64,
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

/// What the strongest waves leave.
struct Left {
    /// The share of the samples that are independent.
    flatness: f32,
    /// Power of a channel in a bin.
    noise: f32,
}

impl Default for Left {
    fn default() -> Self {
        Self { flatness: 1.0, noise: 0.0 }
    }
}

impl Left {
    fn of(beam: &Beam, covariance: &Covariance, peak: &Peak, mut bins: Vec<Vector>) -> Self {
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
        let unsure = 1.0 + UNSURE_SIGMAS * (2.0 * of_white / count).sqrt() / (freedom + 1.0);
        let flatness = of_white * unsure * sum * sum / (squares * count);
        Self {
            flatness: if squares > 0.0 && flatness < 1.0 { flatness as f32 } else { 1.0 },
            noise: (sum / (count * freedom)) as f32,
        }
    }
}
