//! Phasors: one complex amplitude per channel, its noise, and whether there is a tone at all. After [`crate::spectrum`],
//! before [`crate::bearing`].
//!
//! **Fit.** Least squares of `x[n] = a cos w t + b sin w t + d` over the block, `t = n - (N-1)/2`, with the constant
//! projected out beforehand ([`crate::spectrum::tone`]): the origin in the middle makes cosine and sine orthogonal, so
//! `a = sum C x / sum C c`, `b = sum S x / sum S s`, `z = a - j b`. Constant and negative-frequency image are gone for
//! any frequency between bins.
//!
//! **Frequency.** The same fit to each half block gives `z1`, `z2`, and `arg sum_m z2 z1* / v_m = pi d` the distance `d` from
//! the reference in bins, with variance `1 / (2 pi^2 s)` where `s` is the mean of `|z_m|^2 / v_m` over the channels. A
//! scalar Kalman filter follows it; beyond four standard deviations it is believed at once.
//!
//! **Acquisition**, at the start, on loss, when the power the fit leaves over has changed, and every
//! [`REFRESH`] snapshots for the noise floor: the Hann periodogram, each channel in units of its floor (the median over
//! `ln 2`, corrected for the bins under the tone), averaged over the channels. The peak in the band must reach
//! [`SEARCH_THRESHOLD`] and then, after refinement and the fit, `s` must reach [`CONFIRM_THRESHOLD`]: in noise alone `s`
//! is the mean of four exponential variables, and exceeds 7 in one of 10^9 bins.

use crate::adc::{CHANNELS, Snapshot};
use crate::error::{ConfigError, Why, check};
use crate::spectrum::kernel::{self, Moments};
use crate::spectrum::tone::{Products, Reference, Window};
use crate::spectrum::{Backend, Spectrum};
use crate::time::Instant;
use crate::units::sin_cos;

/// A complex number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Complex {
    /// Real part.
    pub re: f32,
    /// Imaginary part.
    pub im: f32,
}

impl Complex {
    /// Product.
    #[must_use]
    pub fn times(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }

    /// Product with the conjugate of `other`.
    #[must_use]
    pub fn times_conj(self, other: Self) -> Self {
        Self { re: self.re * other.re + self.im * other.im, im: self.im * other.re - self.re * other.im }
    }

    /// Sum.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }

    /// Squared magnitude.
    #[must_use]
    pub fn norm_squared(self) -> f32 {
        self.re * self.re + self.im * self.im
    }

    /// Argument in (-pi, pi].
    #[must_use]
    pub fn arg(self) -> f32 {
        libm::atan2f(self.im, self.re)
    }
}

/// Whether a frame holds the tone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Tone {
    /// The tone stands above the noise floor.
    Present,
    /// Nothing above the noise floor.
    Absent,
}

/// One phasor per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Phasors {
    /// The middle of the block.
    pub time: Instant,
    /// Channel `m` carries `Re(z e^{j w (n - (N-1)/2)})`; the magnitude is the amplitude in ADC codes.
    pub z: [Complex; CHANNELS],
    /// Variance of each phasor, `E|z - truth|^2` in squared codes: `4 sigma^2 / N` in white noise of variance `sigma^2`.
    pub noise: [f32; CHANNELS],
    /// Tone power over noise power, per sample, mean over the channels: `10 lg(A^2 / (2 sigma^2))`.
    pub snr_db: f32,
    /// The tone's frequency.
    pub frequency_hz: f32,
    /// Whether the frame holds the tone.
    pub tone: Tone,
    /// More than 1 % of some channel's samples are at a rail.
    pub clipped: bool,
    /// Another line stands in the spectrum, within 10 dB of the tone.
    pub interferer: bool,
}

/// A periodogram peak in units of the noise floor that is worth a closer look.
pub const SEARCH_THRESHOLD: f32 = 4.0;
/// The tone statistic, after refinement, of a new tone.
pub const CONFIRM_THRESHOLD: f32 = 7.0;
/// The tone statistic, at a known frequency, of a tone that is still there.
pub const HOLD_THRESHOLD: f32 = 5.0;
/// The noise floor is measured anew after this many snapshots.
pub const REFRESH: u8 = 8;

/// Variance of the converter's rounding, in squared codes: no channel is quieter.
const QUANTISATION: f32 = 1.0 / 12.0;
/// Two lines within 10 dB, as a ratio of powers.
const COMPARABLE: f32 = 0.1;
/// A line beside the tone must stand this far above the floor to count.
const LINE_THRESHOLD: f32 = 8.0;
/// Variance by which the tone's frequency may move from snapshot to snapshot, in squared bins.
const DRIFT: f32 = 1e-6;
/// Squared distance, in variances, beyond which a frequency is believed instead of averaged.
const GATE: f32 = 16.0;
/// The reference is made anew when the frequency is this far from it, in bins, or two standard deviations.
const RETUNE_BINS: f32 = 1.0 / 256.0;
/// Rounds of refinement from an interpolated peak to the tone.
const REFINEMENTS: u8 = 4;
/// Squared error of a peak interpolated in the periodogram, in squared bins.
const INTERPOLATION_VARIANCE: f32 = 4e-4;
/// Median over mean of an exponential variable: `ln 2`.
const MEDIAN_OF_MEAN: f32 = core::f32::consts::LN_2;
/// The signal-to-noise ratio that stands for none.
const SNR_FLOOR_DB: f32 = -60.0;
/// Centroid of one half of Hann's window over that of a flat half block: `1 - 4 / pi^2`.
const HANN_LEVER: f32 = 0.594_715_3;

/// What the extraction needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct Config {
    /// Sample rate of each channel.
    pub sample_rate_hz: f32,
    /// The tone lies inside this band.
    pub tone_band_hz: [f32; 2],
    /// The tone's frequency, when it is known to within one bin: then nothing else is looked for.
    pub tone_hz: Option<f32>,
    /// Sampling delay of each channel: channel `i` is sampled that much later than its time stamp says.
    pub skew_s: [f32; CHANNELS],
    /// Which transform the acquisition uses.
    pub backend: Backend,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            sample_rate_hz: 102_400.0,
            tone_band_hz: [2_000.0, 49_000.0],
            tone_hz: None,
            skew_s: [0.0; CHANNELS],
            backend: Backend::Fixed,
        }
    }
}

impl Config {
    /// Checks the configuration. The band is cut to `[2, N/2 - 2]` bins.
    ///
    /// # Errors
    /// Names the field that is not finite or out of range.
    pub fn build<const N: usize>(&self) -> Result<Extractor<N>, ConfigError> {
        let rate = check("phase.sample_rate_hz", self.sample_rate_hz, 1e3, 1e7)?;
        let bins_per_hz = N as f32 / rate;
        let bin_limits = [2.0, (N / 2) as f32 - 2.0];
        let [low, high] = self.tone_band_hz;
        check("phase.tone_band_hz", low, 0.0, rate / 2.0)?;
        check("phase.tone_band_hz", high, 0.0, rate / 2.0)?;
        let mut band = [(low * bins_per_hz).max(bin_limits[0]), (high * bins_per_hz).min(bin_limits[1])];
        if band[1] - band[0] < 1.0 {
            let why = Why::Inconsistent("the band must hold at least one bin between bins 2 and N/2 - 2");
            return Err(ConfigError { field: "phase.tone_band_hz", value: low, why });
        }
        if let Some(tone) = self.tone_hz {
            let limits = bin_limits.map(|bin| bin / bins_per_hz);
            let bin = check("phase.tone_hz", tone, limits[0], limits[1])? * bins_per_hz;
            band = [(bin - 1.0).max(bin_limits[0]), (bin + 1.0).min(bin_limits[1])];
        }
        for skew in self.skew_s {
            check("phase.skew_s", skew, -4.0 / rate, 4.0 / rate)?;
        }
        Ok(Extractor { config: *self, band })
    }
}

/// The configured stage.
#[derive(Clone, Debug)]
pub struct Extractor<const N: usize> {
    config: Config,
    /// Where the tone may be, in bins.
    band: [f32; 2],
}

/// What is carried from snapshot to snapshot: the tracked frequency and the noise floor; and working memory.
#[derive(Clone, Debug)]
pub struct State<const N: usize> {
    spectrum: Spectrum<N>,
    reference: Reference<N>,
    solver: Solver,
    /// The tracked frequency and its variance in squared bins.
    tracked: Option<Frequency>,
    /// Variance of a sample, per channel, in squared codes.
    variance: [f32; CHANNELS],
    /// Power the fit left over when the floor was measured, per channel.
    left_over: [f32; CHANNELS],
    /// Snapshots until the floor is due.
    floor_due_in: u8,
    interferer: bool,
    scratch: [f32; N],
}

impl<const N: usize> Default for State<N> {
    fn default() -> Self {
        Self {
            spectrum: Spectrum::default(),
            reference: Reference::default(),
            solver: Solver::default(),
            tracked: None,
            variance: [QUANTISATION; CHANNELS],
            left_over: [0.0; CHANNELS],
            floor_due_in: 0,
            interferer: false,
            scratch: [0.0; N],
        }
    }
}

impl<const N: usize> State<N> {
    /// Forgets the tone: for a snapshot that has nothing to do with the ones before.
    pub fn reset(&mut self) {
        self.tracked = None;
        self.floor_due_in = 0;
        self.interferer = false;
    }
}

/// A frequency in the reference's units.
#[derive(Clone, Copy, Debug)]
struct Frequency {
    /// Phase a sample, 2^32 a turn.
    step: u32,
    /// Variance in squared bins.
    variance: f32,
}

/// A table's normal equations, solved.
#[derive(Clone, Copy, Debug, Default)]
struct Solver {
    /// Whole block: `a` and `b` from their products.
    whole: [f32; 2],
    /// Half block: inverse of the symmetric two by two system, `[aa, ab, bb]`.
    half: [f32; 3],
    /// Variance of a phasor for samples of variance one.
    noise_gain: f32,
    /// Distance of the half blocks' centroids, over half a block.
    lever: f32,
}

impl Solver {
    fn new<const N: usize>(reference: &Reference<N>) -> Self {
        let normal = reference.normal();
        let scale = reference.scale() as f32;
        let (cc, cs, ss) = (normal.cos_cos as f32, normal.cos_sin as f32, normal.sin_sin as f32);
        let whole = [0.5 * scale / cc, 0.5 * scale / ss];
        let factor = scale / (cc * ss - cs * cs);
        Self {
            whole,
            half: [factor * ss, -factor * cs, factor * cc],
            noise_gain: 2.0
                * (whole[0] * whole[0] * normal.cos_energy as f32 + whole[1] * whole[1] * normal.sin_energy as f32),
            lever: if reference.window() == Window::Hann { HANN_LEVER } else { 1.0 },
        }
    }

    /// The phasor over the whole block.
    fn phasor(&self, products: &Products) -> Complex {
        Complex {
            re: self.whole[0] * (products.first_cos as f32 + products.second_cos as f32),
            im: self.whole[1] * (products.first_sin as f32 - products.second_sin as f32),
        }
    }

    /// The phasors over the first and the second half, both referred to the middle of the block.
    fn half_phasors(&self, products: &Products) -> [Complex; 2] {
        let [aa, ab, bb] = self.half;
        let (c1, s1) = (products.first_cos as f32, products.first_sin as f32);
        let (c2, s2) = (products.second_cos as f32, products.second_sin as f32);
        // The first half is a second half in reversed time: b changes its sign.
        [
            Complex { re: aa * c1 + ab * s1, im: ab * c1 + bb * s1 },
            Complex { re: aa * c2 + ab * s2, im: -(ab * c2 + bb * s2) },
        ]
    }
}

/// The fit at one reference frequency.
#[derive(Clone, Copy, Debug)]
struct Fit {
    z: [Complex; CHANNELS],
    /// Mean over the channels of `|z|^2` over its variance.
    statistic: f32,
    /// The tone's distance from the reference, in bins.
    offset_bins: f32,
}

/// A peak in the periodogram.
#[derive(Clone, Copy, Debug)]
struct Peak {
    bin: usize,
    /// Interpolated.
    bins: f32,
    statistic: f32,
}

impl<const N: usize> Extractor<N> {
    /// Phase steps a bin.
    const STEPS_PER_BIN: f32 = 4_294_967_296.0 / N as f32;

    /// Extracts the phasors of one snapshot.
    pub fn step(&self, state: &mut State<N>, snapshot: &Snapshot<N>) -> Phasors {
        let codes = &snapshot.codes;
        let moments = codes.each_ref().map(|row| kernel::moments(row));
        let mut found = None;
        if state.floor_due_in > 0 && state.reference.window() == Window::Flat {
            state.floor_due_in -= 1;
            found = self.follow(state, codes).filter(|fit| !left_over_changed::<N>(state, &moments, fit));
        }
        if found.is_none() {
            found = self.acquire(state, codes, &moments);
        }
        self.report(state, snapshot, &moments, found)
    }

    /// Fits at the tracked frequency and follows it; nothing when the tone is not there.
    fn follow(&self, state: &mut State<N>, codes: &[[i16; N]; CHANNELS]) -> Option<Fit> {
        let mut tracked = state.tracked?;
        tracked.variance += DRIFT;
        if state.reference.step() != tracked.step {
            let away = bins_between::<N>(state.reference.step(), tracked.step);
            if state.solver.lever == 0.0 || away.abs() > RETUNE_BINS.max(2.0 * libm::sqrtf(tracked.variance)) {
                tune(state, tracked.step, state.reference.window());
            }
        }
        let mut fit = fit(state, codes);
        if fit.statistic < HOLD_THRESHOLD {
            return None;
        }
        if state.reference.window() == Window::Hann {
            return Some(fit);
        }
        let measured = state.reference.step().wrapping_add(steps::<N>(fit.offset_bins));
        let innovation = bins_between::<N>(tracked.step, measured);
        let variance = offset_variance(&fit);
        if innovation * innovation > GATE * (tracked.variance + variance) {
            // Believed only if the fit is the better for it, and then settled.
            let refined = self.refine(state, codes, measured)?;
            if refined.statistic < fit.statistic {
                return None;
            }
            fit = refined;
        } else {
            let gain = tracked.variance / (tracked.variance + variance);
            tracked.step = tracked.step.wrapping_add(steps::<N>(gain * innovation));
            tracked.variance *= 1.0 - gain;
            state.tracked = Some(tracked);
        }
        self.in_band(state.tracked?.step).then_some(fit)
    }

    /// Moves the reference to the tone, from at most half a bin away, and tracks it there.
    fn refine(&self, state: &mut State<N>, codes: &[[i16; N]; CHANNELS], from: u32) -> Option<Fit> {
        let mut step = from;
        let mut found = None;
        for _ in 0..REFINEMENTS {
            if !self.in_band(step) {
                return None;
            }
            tune(state, step, Window::Flat);
            let fit = fit(state, codes);
            let variance = offset_variance(&fit);
            step = step.wrapping_add(steps::<N>(fit.offset_bins));
            found = Some((fit, Frequency { step, variance }));
            if fit.offset_bins.abs() < RETUNE_BINS.max(0.25 * libm::sqrtf(variance)) {
                break;
            }
        }
        let (fit, frequency) = found?;
        let there = fit.statistic >= HOLD_THRESHOLD && fit.offset_bins.abs() < 0.25 && self.in_band(step);
        there.then(|| {
            state.tracked = Some(frequency);
            fit
        })
    }

    /// Looks at the whole spectrum: floors, tone, other lines. Nothing when there is no tone.
    fn acquire(
        &self,
        state: &mut State<N>,
        codes: &[[i16; N]; CHANNELS],
        moments: &[Moments; CHANNELS],
    ) -> Option<Fit> {
        state.floor_due_in = 0;
        state.interferer = false;
        state.spectrum.measure(self.config.backend, codes, &mut state.scratch);
        let floors = [0, 1, 2, 3].map(|channel| median(&state.spectrum, channel, &mut state.scratch) / MEDIAN_OF_MEAN);
        let floors = floors.map(|floor| floor.max(QUANTISATION * hann_gain::<N>()));
        self.statistics(state, &floors);

        let strongest = self.peak(state, self.band);
        let held = state.tracked.and_then(|tracked| {
            let bin = tracked.step as f32 / Self::STEPS_PER_BIN;
            let near = self.peak(state, [bin - 1.0, bin + 1.0]);
            (near.statistic >= COMPARABLE * strongest.statistic).then_some(near)
        });
        let peak = held.unwrap_or(strongest);
        for ((variance, floor), channel) in state.variance.iter_mut().zip(floors).zip(0..) {
            let power = state.spectrum.power(channel, peak.bin) as f32 * power_of_two(state.spectrum.exponent(channel));
            *variance = (floor * under_the_tone::<N>(power / floor) / hann_gain::<N>()).max(QUANTISATION);
        }

        let known = self.config.tone_hz.is_some();
        if peak.statistic < SEARCH_THRESHOLD && held.is_none() && !known {
            return None;
        }
        state.interferer = other_line(state, &peak);
        let at = (peak.bins * Self::STEPS_PER_BIN) as u32;
        let before = state.tracked;
        let confirm = if known || held.is_some() { HOLD_THRESHOLD } else { CONFIRM_THRESHOLD };
        let found = if state.interferer {
            tune(state, at, Window::Hann);
            state.tracked = Some(Frequency { step: at, variance: INTERPOLATION_VARIANCE });
            Some(fit(state, codes))
        } else {
            if state.reference.window() == Window::Hann {
                tune(state, at, Window::Flat);
            }
            let followed = if held.is_some() { self.follow(state, codes) } else { None };
            followed.or_else(|| self.refine(state, codes, at))
        };
        let found = found.filter(|fit| fit.statistic >= confirm);
        match &found {
            Some(fit) => {
                state.floor_due_in = REFRESH - 1;
                state.left_over = left_over::<N>(moments, fit);
            }
            None => {
                state.tracked = before;
                state.interferer = false;
            }
        }
        found
    }

    /// Overwrites the working memory by the mean over the channels of power over floor, bin by bin.
    fn statistics(&self, state: &mut State<N>, floors: &[f32; CHANNELS]) {
        let State { spectrum, scratch, .. } = state;
        scratch.fill(0.0);
        for (channel, floor) in floors.iter().enumerate() {
            let weight = power_of_two(spectrum.exponent(channel)) / (CHANNELS as f32 * floor);
            for (sum, power) in scratch.iter_mut().skip(1).zip(spectrum.powers(channel)) {
                *sum += power as f32 * weight;
            }
        }
    }

    /// The highest peak between two frequencies in bins, interpolated: for Hann's window and the ratio `r` of the larger
    /// neighbour's amplitude to the peak's, the tone is `(2 r - 1) / (r + 1)` bins towards that neighbour.
    fn peak(&self, state: &State<N>, band: [f32; 2]) -> Peak {
        let from = (libm::floorf(band[0]) as usize).clamp(2, N / 2 - 2);
        let to = (libm::ceilf(band[1]) as usize).clamp(from, N / 2 - 2);
        let mut bin = from;
        let mut statistic = 0.0;
        for (k, value) in state.scratch.iter().enumerate().take(to + 1).skip(from) {
            if *value > statistic {
                (bin, statistic) = (k, *value);
            }
        }
        let (below, above) = (state.scratch[bin - 1], state.scratch[bin + 1]);
        let (side, neighbour) = if above > below { (1.0, above) } else { (-1.0, below) };
        let ratio = if statistic > 0.0 { libm::sqrtf(neighbour / statistic).min(1.0) } else { 0.5 };
        Peak { bin, bins: bin as f32 + side * (2.0 * ratio - 1.0) / (ratio + 1.0), statistic }
    }

    /// Puts the result into the contract's units.
    fn report(
        &self,
        state: &State<N>,
        snapshot: &Snapshot<N>,
        moments: &[Moments; CHANNELS],
        found: Option<Fit>,
    ) -> Phasors {
        let rate = self.config.sample_rate_hz;
        let frequency_hz = state.tracked.map_or(0.0, |tracked| tracked.step as f32 * (rate / 4_294_967_296.0));
        let mut phasors = Phasors {
            time: snapshot.time,
            z: [Complex::default(); CHANNELS],
            noise: state.variance.map(|variance| variance * 4.0 / N as f32),
            snr_db: SNR_FLOOR_DB,
            frequency_hz,
            tone: Tone::Absent,
            clipped: moments.iter().any(|moments| moments.clipped as usize * 100 > N),
            interferer: state.interferer,
        };
        if let Some(fit) = found {
            phasors.tone = Tone::Present;
            phasors.noise = state.variance.map(|variance| variance * state.solver.noise_gain);
            let mut snr = 0.0;
            for ((z, noise), variance) in fit.z.iter().zip(phasors.noise).zip(state.variance) {
                snr += (z.norm_squared() - noise) / (2.0 * CHANNELS as f32 * variance);
            }
            phasors.snr_db = (10.0 * libm::log10f(snr.max(1e-9))).max(SNR_FLOOR_DB);
            phasors.z = fit.z;
            for (z, skew_s) in phasors.z.iter_mut().zip(self.config.skew_s) {
                // Sampled later means further in phase.
                if skew_s != 0.0 {
                    let (sine, cosine) = sin_cos(core::f32::consts::TAU * frequency_hz * skew_s);
                    *z = z.times_conj(Complex { re: cosine, im: sine });
                }
            }
        }
        phasors
    }

    fn in_band(&self, step: u32) -> bool {
        let bins = step as f32 / Self::STEPS_PER_BIN;
        bins > self.band[0] - 0.5 && bins < self.band[1] + 0.5
    }
}

fn steps<const N: usize>(bins: f32) -> u32 {
    (bins * Extractor::<N>::STEPS_PER_BIN) as i32 as u32
}

/// From one frequency to another, in bins.
fn bins_between<const N: usize>(from: u32, to: u32) -> f32 {
    to.wrapping_sub(from) as i32 as f32 / Extractor::<N>::STEPS_PER_BIN
}

/// Makes the reference for a frequency and solves its normal equations.
fn tune<const N: usize>(state: &mut State<N>, step: u32, window: Window) {
    state.reference.tune(step, window);
    state.solver = Solver::new(&state.reference);
}

/// Fits the tone at the reference's frequency.
fn fit<const N: usize>(state: &State<N>, codes: &[[i16; N]; CHANNELS]) -> Fit {
    let products = state.reference.products(codes);
    let solver = &state.solver;
    let mut statistic = 0.0;
    let mut advance = Complex::default();
    let mut z = [Complex::default(); CHANNELS];
    for ((z, products), variance) in z.iter_mut().zip(&products).zip(state.variance) {
        let weight = 1.0 / variance;
        *z = solver.phasor(products);
        statistic += z.norm_squared() * weight;
        let [first, second] = solver.half_phasors(products);
        let turned = second.times_conj(first);
        advance.re += turned.re * weight;
        advance.im += turned.im * weight;
    }
    Fit {
        z,
        statistic: statistic / (CHANNELS as f32 * solver.noise_gain),
        offset_bins: advance.arg() / (core::f32::consts::PI * solver.lever),
    }
}

/// Variance of a fit's distance from the reference, in squared bins.
fn offset_variance(fit: &Fit) -> f32 {
    0.5 * core::f32::consts::FRAC_1_PI * core::f32::consts::FRAC_1_PI / fit.statistic.max(1.0)
}

/// Power that the fit does not explain, summed over the block, per channel; not below 40 dB under the signal, where an
/// error of the frequency within its tolerance shows.
fn left_over<const N: usize>(moments: &[Moments; CHANNELS], fit: &Fit) -> [f32; CHANNELS] {
    let mut left = [0.0; CHANNELS];
    for ((left, moments), z) in left.iter_mut().zip(moments).zip(fit.z) {
        let sum = i64::from(moments.sum);
        let power = (moments.energy * N as i64 - sum * sum) as f32 / N as f32;
        *left = (power - 0.5 * N as f32 * z.norm_squared()).max(1e-4 * power).max(1.0);
    }
    left
}

/// Whether the frame is another than the floor was measured in: by more than six standard deviations of the power of
/// white noise, in some channel.
fn left_over_changed<const N: usize>(state: &State<N>, moments: &[Moments; CHANNELS], fit: &Fit) -> bool {
    let bound = 1.0 + 6.0 * libm::sqrtf(2.0 / N as f32);
    let now = left_over::<N>(moments, fit);
    now.iter().zip(state.left_over).any(|(now, then)| *now > then * bound || then > *now * bound)
}

/// Whether another line stands more than three bins from the peak and within 10 dB of it.
fn other_line<const N: usize>(state: &State<N>, peak: &Peak) -> bool {
    let bound = (COMPARABLE * peak.statistic).max(LINE_THRESHOLD);
    let lines = state.scratch.iter().enumerate().take(N / 2 - 1).skip(2);
    lines.into_iter().any(|(k, value)| *value > bound && k.abs_diff(peak.bin) > 3)
}

/// Mean power of the windowed periodogram for white noise of variance one.
const fn hann_gain<const N: usize>() -> f32 {
    0.375 * N as f32
}

/// The median power of a channel, from bin 2 to N/2 - 2.
fn median<const N: usize>(spectrum: &Spectrum<N>, channel: usize, scratch: &mut [f32; N]) -> f32 {
    let count = N / 2 - 3;
    for (value, power) in scratch.iter_mut().zip(spectrum.powers(channel).skip(1)) {
        *value = power as f32;
    }
    let (_, median, _) = scratch[..count].select_nth_unstable_by(count / 2, f32::total_cmp);
    *median * power_of_two(spectrum.exponent(channel))
}

/// By how much the median overrates the floor because of the bins under the tone, which all lie above it: the factor
/// that corrects for this. `ratio` is the peak over the floor.
///
/// Hann's window falls off as `1 / (2 pi^2 d^6)`, so `2 d` bins with `d = (ratio / 2 pi^2)^(1/6)` stand out. With `c` of
/// `n` bins out of the way the middle one is the `n / 2 / (n - c)` quantile of the noise.
fn under_the_tone<const N: usize>(ratio: f32) -> f32 {
    if ratio < LINE_THRESHOLD {
        return 1.0;
    }
    let reach = libm::expf(libm::logf(ratio * (1.0 / 19.739_209)) * (1.0 / 6.0)).max(2.0);
    let count = (N / 2 - 3) as f32;
    let occupied = (2.0 * reach).min(0.4 * count);
    MEDIAN_OF_MEAN / libm::logf((count - occupied) / (0.5 * count - occupied))
}

/// Two to a power, within the range of f32.
fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((127 + exponent).clamp(1, 254) as u32) << 23)
}
