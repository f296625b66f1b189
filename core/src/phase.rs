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
//! is the mean of four exponential variables, and exceeds 7 in 3 of 10^9 bins.
//!
//! **Other lines.** With another line within 10 dB the fit is weighted by Hann's window: half as much variance again, but
//! lines more than three bins away are out. Every snapshot is then acquired anew.
//!
//! Instructions on a Cortex-M4F, four channels, N = 256 (1024), counted in QEMU:
//!
//! | | fixed point | `microfft` |
//! |---|---|---|
//! | periodogram | 25 800 (120 800) | 59 800 (288 100) |
//! | products with a given reference | 1 610 (5 930) | |
//! | a new reference | 4 660 (14 400) | |
//! | snapshot, tracked | 6 600 (21 600) | 6 600 (21 600) |
//! | snapshot, floor renewed | 58 000 (240 000) | 93 000 (400 000) |
//! | snapshot, first | 67 000 (274 000) | 104 000 (444 000) |

use crate::adc::{CHANNELS, Snapshot};
use crate::error::{ConfigError, Why, check};
use crate::spectrum::active;
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
/// The tone statistic, after refinement, of a new tone; times what the floor's own uncertainty asks for, `1 + 25 / N`.
pub const CONFIRM_THRESHOLD: f32 = 7.0;
/// The tone statistic, at a known frequency, of a tone that is still there; times the same.
pub const HOLD_THRESHOLD: f32 = 5.5;
/// The noise floor is measured anew after this many snapshots.
pub const REFRESH: u8 = 8;

/// Variance of the converter's rounding, in squared codes: no channel is quieter.
const QUANTISATION: f32 = 1.0 / 12.0;
/// Two lines within 10 dB, as a ratio of powers.
const COMPARABLE: f32 = 0.1;
/// A line beside the tone must stand this far above the floor to count.
const LINE_THRESHOLD: f32 = 8.0;
/// A line's own bins either side, in Hann's window.
const LOBE_BINS: usize = 3;
/// Variance by which the tone's frequency may move from snapshot to snapshot, in squared bins.
const DRIFT: f32 = 1e-6;
/// Squared distance, in variances, beyond which a frequency is believed instead of averaged.
const GATE: f32 = 16.0;
/// The reference is made anew when the frequency is this far from it, in bins, or two standard deviations.
const RETUNE_BINS: f32 = 1.0 / 256.0;
/// A new tone's frequency is refined to this, in bins, or a quarter of a standard deviation.
const REFINED_BINS: f32 = 1.0 / 2048.0;
/// Rounds of refinement from an interpolated peak to the tone.
const REFINEMENTS: u8 = 4;
/// Squared error of a peak interpolated in the periodogram, in squared bins.
const INTERPOLATION_VARIANCE: f32 = 4e-4;
/// Median over mean of an exponential variable: `ln 2`.
const MEDIAN_OF_MEAN: f32 = core::f32::consts::LN_2;
/// The signal-to-noise ratio that stands for none.
const SNR_FLOOR_DB: f32 = -60.0;

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
    /// Energy in the block of a cosine and a sine of amplitude one, without their mean.
    energy: [f32; 2],
}

impl Solver {
    fn new<const N: usize>(reference: &Reference<N>) -> Self {
        let normal = reference.normal();
        let scale = reference.scale() as f32;
        // In units of the table once: products over these are codes.
        let [cc, cs, ss] = [normal.cos_cos, normal.cos_sin, normal.sin_sin].map(|sum| sum as f32 / scale);
        let whole = [0.5 / cc, 0.5 / ss];
        let factor = 1.0 / (cc * ss - cs * cs);
        let gain = |whole: f32, energy: i64| 2.0 * whole * whole * energy as f32;
        Self {
            whole,
            half: [factor * ss, -factor * cs, factor * cc],
            energy: [2.0 * cc / scale, 2.0 * ss / scale],
            noise_gain: gain(whole[0], normal.cos_energy) + gain(whole[1], normal.sin_energy),
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
    /// The tone's distance from the reference, in bins; for a flat window.
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
    /// The statistics' thresholds, for a floor that is the median of few bins.
    const HOLD: f32 = HOLD_THRESHOLD * (1.0 + 25.0 / N as f32);
    const CONFIRM: f32 = CONFIRM_THRESHOLD * (1.0 + 25.0 / N as f32);

    /// Extracts the phasors of one snapshot.
    pub fn step(&self, state: &mut State<N>, snapshot: &Snapshot<N>) -> Phasors {
        let codes = &snapshot.codes;
        let levels = codes.each_ref().map(level);
        let mut found = None;
        if state.floor_due_in > 0 && state.reference.window() == Window::Flat {
            state.floor_due_in -= 1;
            let before = state.tracked;
            found = self.follow(state, codes).filter(|fit| !left_over_changed::<N>(state, &levels, fit));
            if found.is_none() {
                state.tracked = before;
            }
        }
        if found.is_none() {
            found = self.acquire(state, codes, &levels);
        }
        self.report(state, snapshot, &levels, found)
    }

    /// Fits at the tracked frequency and follows it; nothing when the tone is not there.
    fn follow(&self, state: &mut State<N>, codes: &[[i16; N]; CHANNELS]) -> Option<Fit> {
        let mut tracked = state.tracked?;
        tracked.variance += DRIFT;
        if state.reference.step() != tracked.step {
            let away = bins_between::<N>(state.reference.step(), tracked.step);
            if away.abs() > RETUNE_BINS.max(2.0 * libm::sqrtf(tracked.variance)) {
                tune(state, tracked.step, Window::Flat);
            }
        }
        let mut fit = fit(state, codes);
        if fit.statistic < Self::HOLD {
            return None;
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
            if fit.offset_bins.abs() < REFINED_BINS.max(0.25 * libm::sqrtf(variance)) {
                break;
            }
        }
        let (fit, frequency) = found?;
        let there = fit.statistic >= Self::HOLD && fit.offset_bins.abs() < 0.25 && self.in_band(step);
        there.then(|| {
            state.tracked = Some(frequency);
            fit
        })
    }

    /// Looks at the whole spectrum: floors, tone, other lines. Nothing when there is no tone.
    fn acquire(&self, state: &mut State<N>, codes: &[[i16; N]; CHANNELS], levels: &[Level; CHANNELS]) -> Option<Fit> {
        state.floor_due_in = 0;
        state.interferer = false;
        state.spectrum.measure(self.config.backend, codes, &mut state.scratch);
        let floors = [0, 1, 2, 3].map(|channel| median(&state.spectrum, channel, &mut state.scratch) / MEDIAN_OF_MEAN);
        let floors = floors.map(|floor| floor.max(QUANTISATION * hann_gain::<N>()));
        self.statistics(state, &floors);

        let strongest = self.peak(state, self.band);
        let held = state.tracked.and_then(|tracked| self.held(state, tracked, &strongest));
        let peak = held.unwrap_or(strongest);
        for ((variance, floor), channel) in state.variance.iter_mut().zip(floors).zip(0..) {
            let power = state.spectrum.power(channel, peak.bin) as f32 * power_of_two(state.spectrum.exponent(channel));
            let floor = floor * under_the_tone::<N>(power / floor, peak.bins - peak.bin as f32);
            *variance = (floor / hann_gain::<N>()).max(QUANTISATION);
        }

        let known = self.config.tone_hz.is_some();
        let confirm = if known || held.is_some() { Self::HOLD } else { Self::CONFIRM };
        let worth_it = known || peak.statistic >= SEARCH_THRESHOLD;
        let at = (peak.bins * Self::STEPS_PER_BIN) as u32;
        let before = state.tracked;
        state.interferer = other_line(state, &peak);
        let found = if state.interferer {
            // The half blocks have no window that would keep the other line out of the frequency.
            tune(state, at, Window::Hann);
            state.tracked = Some(Frequency { step: at, variance: INTERPOLATION_VARIANCE });
            Some(fit(state, codes)).filter(|fit| fit.statistic >= confirm)
        } else {
            if state.reference.window() == Window::Hann {
                tune(state, at, Window::Flat);
            }
            // Half blocks tell the frequency to within one bin only.
            let near = |tracked: Frequency| bins_between::<N>(tracked.step, at).abs() < 0.5;
            let followed = if held.is_some() && before.is_some_and(near) { self.follow(state, codes) } else { None };
            let confirm = if known { Self::HOLD } else { Self::CONFIRM };
            followed.or_else(|| {
                let refined = if worth_it { self.refine(state, codes, at) } else { None };
                refined.filter(|fit| fit.statistic >= confirm)
            })
        };
        match &found {
            Some(fit) => {
                state.floor_due_in = REFRESH - 1;
                state.left_over = left_over(&state.solver, levels, fit);
                // Above some 50 dB the floor in the spectrum is that of its own rounding.
                for (variance, left) in state.variance.iter_mut().zip(state.left_over) {
                    let residual = left / (N as f32 - 4.0);
                    if residual < 0.5 * *variance {
                        *variance = residual.max(QUANTISATION);
                    }
                }
            }
            None => {
                state.tracked = before;
                state.interferer = false;
            }
        }
        found
    }

    /// The line that is tracked, when it still is a line of its own and within 10 dB of the strongest: then it stays the
    /// tone.
    fn held(&self, state: &State<N>, tracked: Frequency, strongest: &Peak) -> Option<Peak> {
        let bin = tracked.step as f32 / Self::STEPS_PER_BIN;
        let near = self.peak(state, [bin - 1.0, bin + 1.0]);
        let summit = neighbours(&state.scratch, near.bin).iter().all(|beside| near.statistic >= *beside);
        let apart = near.bin == strongest.bin || near.bin.abs_diff(strongest.bin) > LOBE_BINS;
        (summit && apart && near.statistic >= COMPARABLE * strongest.statistic).then_some(near)
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
        let [below, above] = neighbours(&state.scratch, bin);
        let (side, neighbour) = if above > below { (1.0, above) } else { (-1.0, below) };
        let ratio = if statistic > 0.0 { libm::sqrtf(neighbour / statistic).min(1.0) } else { 0.5 };
        Peak { bin, bins: bin as f32 + side * (2.0 * ratio - 1.0) / (ratio + 1.0), statistic }
    }

    /// Puts the result into the contract's units.
    fn report(
        &self,
        state: &State<N>,
        snapshot: &Snapshot<N>,
        levels: &[Level; CHANNELS],
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
            clipped: levels.iter().any(|level| level.clipped as usize * 100 > N),
            interferer: state.interferer,
        };
        if let Some(fit) = found {
            phasors.tone = Tone::Present;
            phasors.noise = state.variance.map(|variance| variance * state.solver.noise_gain);
            // No noise gets through where the wave is clipped. What does stands about the zero crossings, where it turns the
            // phase: with a share c clipped, 1 + sin(pi c) / (pi (1 - c)) times as much as the same power all round. The
            // harmonics have raised the floor a little too; 1 + c makes up for both.
            for (noise, level) in phasors.noise.iter_mut().zip(levels) {
                *noise *= 1.0 + level.clipped as f32 / N as f32;
            }
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
        offset_bins: advance.arg() * core::f32::consts::FRAC_1_PI,
    }
}

/// Variance of a fit's distance from the reference, in squared bins.
fn offset_variance(fit: &Fit) -> f32 {
    0.5 * core::f32::consts::FRAC_1_PI * core::f32::consts::FRAC_1_PI / fit.statistic.max(1.0)
}

/// What a channel's samples say by themselves.
#[derive(Clone, Copy, Debug)]
struct Level {
    /// Energy of the block without the mean of each half.
    energy: f32,
    clipped: u32,
}

fn level<const N: usize>(row: &[i16; N]) -> Level {
    let (first, second) = row.split_at(N / 2);
    let halves = [first, second].map(active::moments);
    let half = N as i64 / 2;
    let energy =
        halves.map(|half_block| half_block.energy * half - i64::from(half_block.sum) * i64::from(half_block.sum));
    Level { energy: (energy[0] + energy[1]) as f32 / half as f32, clipped: halves[0].clipped + halves[1].clipped }
}

/// Energy that the fit does not explain, per channel. In white noise `N - 4` times its variance: the fit has two
/// parameters beside the two means.
fn left_over(solver: &Solver, levels: &[Level; CHANNELS], fit: &Fit) -> [f32; CHANNELS] {
    let mut left = [0.0; CHANNELS];
    for ((left, level), z) in left.iter_mut().zip(levels).zip(fit.z) {
        *left = (level.energy - z.re * z.re * solver.energy[0] - z.im * z.im * solver.energy[1]).max(0.0);
    }
    left
}

/// Whether the frame is another than the floor was measured in: by more than six standard deviations of the energy of
/// white noise, in some channel.
fn left_over_changed<const N: usize>(state: &State<N>, levels: &[Level; CHANNELS], fit: &Fit) -> bool {
    let bound = 1.0 + 6.0 * libm::sqrtf(2.0 / N as f32);
    let now = left_over(&state.solver, levels, fit);
    now.iter().zip(state.left_over).zip(levels).any(|((now, then), level)| {
        // 40 dB below the signal, an error of the frequency within its tolerance shows.
        let least = 1e-4 * level.energy + 1.0;
        let (now, then) = (now.max(least), then.max(least));
        now > then * bound || then > now * bound
    })
}

/// What stands either side of a bin; the modulus only spares a bounds check.
fn neighbours<const N: usize>(values: &[f32; N], bin: usize) -> [f32; 2] {
    [values[(bin + N - 1) % N], values[(bin + 1) % N]]
}

/// Whether another line stands more than three bins from the peak and within 10 dB of it.
fn other_line<const N: usize>(state: &State<N>, peak: &Peak) -> bool {
    let bound = (COMPARABLE * peak.statistic).max(LINE_THRESHOLD);
    let lines = state.scratch.iter().enumerate().take(N / 2 - 1).skip(2);
    lines.into_iter().any(|(k, value)| *value > bound && k.abs_diff(peak.bin) > LOBE_BINS)
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
    // Floats that are not negative stand in the order of their bits.
    let (_, median, _) = scratch[..count].select_nth_unstable_by_key(count / 2, |power| power.to_bits());
    *median * power_of_two(spectrum.exponent(channel))
}

/// By how much the median overrates the floor because of the bins under the tone, which all lie above it: the factor
/// that corrects for this. `ratio` is the peak over the floor, `fraction` the tone's distance from that bin.
///
/// Hann's window falls off as `sin^2(pi f) / (pi^2 d^6)`, so `2 d` bins with `d = (ratio sin^2(pi f) / pi^2)^(1/6)` stand
/// out, and the main lobe does. With `c` of `n` bins out of the way the middle one is the `n / 2 / (n - c)` quantile of the
/// noise.
fn under_the_tone<const N: usize>(ratio: f32, fraction: f32) -> f32 {
    if ratio < LINE_THRESHOLD {
        return 1.0;
    }
    let (sine, _) = sin_cos(core::f32::consts::PI * fraction);
    let sine_over_pi = sine * core::f32::consts::FRAC_1_PI;
    let reach = libm::expf(libm::logf(ratio * sine_over_pi * sine_over_pi + 1.0) * (1.0 / 6.0)).max(2.0);
    let count = (N / 2 - 3) as f32;
    let occupied = (2.0 * reach).min(0.4 * count);
    MEDIAN_OF_MEAN / libm::logf((count - occupied) / (0.5 * count - occupied))
}

/// Two to a power, within the range of f32.
fn power_of_two(exponent: i32) -> f32 {
    f32::from_bits(((127 + exponent).clamp(1, 254) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use std::f64::consts::TAU;
    use std::vec::Vec;

    const RATE: f32 = 102_400.0;

    /// One tone, with a phase per channel at the middle of the block, and what stands beside it.
    #[derive(Clone, Copy)]
    struct Scene {
        bins: f64,
        amplitude: [f64; CHANNELS],
        phases: [f64; CHANNELS],
        sigma: f64,
        dc: [f64; CHANNELS],
        /// Bins, amplitude and phase of another tone.
        other: [f64; 3],
    }

    impl Scene {
        fn new(bins: f64, amplitude: f64, sigma: f64) -> Self {
            Self {
                bins,
                amplitude: [amplitude; CHANNELS],
                phases: [0.3, -1.1, 2.0, -2.9],
                sigma,
                dc: [0.0; CHANNELS],
                other: [0.0; 3],
            }
        }

        /// As strong as the converter takes with 4 standard deviations to spare, but not below 60 codes.
        fn at_snr(bins: f64, snr_db: f64) -> Self {
            let ratio = (2.0 * 10_f64.powf(snr_db / 10.0)).sqrt();
            let sigma = 1800.0 / (ratio + 4.0);
            Self::new(bins, ratio * sigma, sigma)
        }

        fn silence(sigma: f64) -> Self {
            Self::new(10.0, 0.0, sigma)
        }

        fn with_random_phases(mut self, rng: &mut Rng) -> Self {
            self.phases = [0; CHANNELS].map(|_| f64::from(rng.uniform()) * TAU);
            self.other[2] = f64::from(rng.uniform()) * TAU;
            self
        }

        fn frame<const N: usize>(&self, rng: &mut Rng) -> Snapshot<N> {
            let mut snapshot = Snapshot::zeroed();
            for (channel, row) in snapshot.codes.iter_mut().enumerate() {
                for (n, code) in row.iter_mut().enumerate() {
                    let t = (n as f64 - (N as f64 - 1.0) / 2.0) * TAU / N as f64;
                    let value = self.dc[channel]
                        + self.amplitude[channel] * (self.bins * t + self.phases[channel]).cos()
                        + self.other[1] * (self.other[0] * t + self.other[2]).cos()
                        + self.sigma * f64::from(rng.gaussian());
                    *code = value.round().clamp(-2048.0, 2047.0) as i16;
                }
            }
            snapshot
        }

        /// Errors of the phase differences to channel 0, in radians.
        fn errors(&self, phasors: &Phasors) -> [f64; 3] {
            [1, 2, 3].map(|m| wrapped(arg(phasors.z[m]) - arg(phasors.z[0]) - self.phases[m] + self.phases[0]))
        }

        /// Cramer-Rao bound of a phase difference, radians; rounding to codes counts as noise.
        fn bound<const N: usize>(&self) -> f64 {
            (2.0 * 2.0 * (self.sigma * self.sigma + 1.0 / 12.0) / (N as f64 * self.amplitude[0].powi(2))).sqrt()
        }
    }

    fn arg(z: Complex) -> f64 {
        f64::from(z.im).atan2(f64::from(z.re))
    }

    fn wrapped(angle: f64) -> f64 {
        (angle + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0
    }

    fn rms(values: &[f64]) -> f64 {
        assert!(!values.is_empty());
        (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
    }

    fn open_config() -> Config {
        Config { tone_band_hz: [0.0, RATE / 2.0], ..Config::default() }
    }

    fn extractor<const N: usize>() -> Extractor<N> {
        open_config().build().unwrap()
    }

    fn bins_of<const N: usize>(phasors: &Phasors) -> f64 {
        f64::from(phasors.frequency_hz / RATE) * N as f64
    }

    fn assert_finite(phasors: &Phasors) {
        for z in phasors.z {
            assert!(z.re.is_finite() && z.im.is_finite(), "{phasors:?}");
        }
        assert!(phasors.noise.iter().all(|noise| noise.is_finite() && *noise > 0.0), "{phasors:?}");
        assert!(phasors.snr_db.is_finite() && phasors.frequency_hz.is_finite(), "{phasors:?}");
    }

    /// Least squares of cosine, sine and a constant at a given frequency, in f64: the oracle of the fit.
    fn reference_fit(row: &[i16], bins: f64) -> (f64, f64) {
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

    #[test]
    fn the_phasor_is_the_least_squares_fit_at_the_reported_frequency() {
        fn check<const N: usize>() {
            let mut rng = Rng::new(11, N as u64);
            for bins in [4.3, 7.77, N as f64 / 8.0 + 0.4, N as f64 / 2.0 - 5.3] {
                let scene = Scene::new(bins, 1100.0, 0.0).with_random_phases(&mut rng);
                let frame = scene.frame::<N>(&mut rng);
                let phasors = extractor::<N>().step(&mut State::default(), &frame);
                for (z, row) in phasors.z.iter().zip(&frame.codes) {
                    let (re, im) = reference_fit(row, bins_of::<N>(&phasors));
                    let off = (re - f64::from(z.re)).hypot(im - f64::from(z.im));
                    // The reference is within 1/2048 bin of the reported frequency, and has a mean for each half.
                    assert!(off < 0.5, "N {N} bins {bins}: {off} codes of 1100");
                }
            }
        }
        check::<64>();
        check::<128>();
        check::<256>();
        check::<512>();
        check::<1024>();
    }

    #[test]
    fn a_clean_tone_is_as_good_as_its_twelve_bits() {
        // Degrees, as in the project's budget: 0.005 at 1 500 codes, 0.065 at 60.
        for (amplitude, bound) in [(1500.0, 0.005), (60.0, 0.065)] {
            let mut rng = Rng::new(5, 0);
            let mut errors = Vec::new();
            for k in 0..60 {
                let scene = Scene::new(20.0 + f64::from(k % 3) * 9.0, amplitude, 0.0).with_random_phases(&mut rng);
                let phasors = extractor::<256>().step(&mut State::default(), &scene.frame(&mut rng));
                errors.extend(scene.errors(&phasors));
            }
            assert!(rms(&errors).to_degrees() < bound, "{}", rms(&errors).to_degrees());
        }
    }

    #[test]
    fn blind_single_frames_reach_the_cramer_rao_bound_and_predict_their_errors() {
        for backend in [Backend::Fixed, Backend::Microfft] {
            let extractor = Config { backend, ..open_config() }.build::<256>().unwrap();
            for bins in [4.5, 20.5, 37.0, 60.25] {
                for snr_db in [0.0, 10.0, 20.0, 40.0] {
                    let scene = Scene::at_snr(bins, snr_db);
                    let mut rng = Rng::new(3, 1);
                    let (mut fresh, mut tracked, mut normalised, mut frequency) = (vec(), vec(), vec(), vec());
                    let mut state = State::default();
                    let mut snr = 0.0;
                    for _ in 0..400 {
                        let scene = scene.with_random_phases(&mut rng);
                        let frame = scene.frame::<256>(&mut rng);
                        let phasors = extractor.step(&mut State::default(), &frame);
                        assert_eq!(phasors.tone, Tone::Present, "{bins} {snr_db}");
                        assert!(!phasors.interferer && !phasors.clipped);
                        frequency.push(bins_of::<256>(&phasors) - bins);
                        snr += f64::from(phasors.snr_db) / 400.0;
                        let errors = scene.errors(&phasors);
                        fresh.extend(errors);
                        let variance =
                            phasors.z.iter().zip(phasors.noise).map(|(z, v)| f64::from(v / (2.0 * z.norm_squared())));
                        let variance: Vec<_> = variance.collect();
                        normalised.extend(errors.iter().zip(1..).map(|(e, m)| e / (variance[0] + variance[m]).sqrt()));
                        let phasors = extractor.step(&mut state, &frame);
                        assert_eq!(phasors.tone, Tone::Present, "{bins} {snr_db}");
                        tracked.extend(scene.errors(&phasors));
                    }
                    let what = std::format!("{backend:?} {bins} bins {snr_db} dB");
                    let bound = scene.bound::<256>();
                    let allowed = if bins < 5.0 { 1.35 } else { 1.10 };
                    assert!(rms(&fresh) < allowed * bound, "{what}: {}", rms(&fresh) / bound);
                    assert!(rms(&tracked) < allowed * bound, "{what}: {} tracked", rms(&tracked) / bound);
                    let honesty = rms(&normalised).powi(2);
                    assert!((0.85..1.2).contains(&honesty), "{what}: {honesty}");
                    assert!((snr - snr_db).abs() < 0.5, "{what}: {snr}");
                    // 0.024 bins at 0 dB, where the bound is 0.022 (four channels) over sqrt(3/4).
                    let frequency_bound = 0.027 / 10_f64.powf(snr_db / 20.0);
                    assert!(rms(&frequency) < frequency_bound, "{what}: {}", rms(&frequency));
                }
            }
        }
    }

    fn vec() -> Vec<f64> {
        Vec::new()
    }

    #[test]
    fn noise_alone_raises_no_alarm_and_a_tone_at_minus_9_db_is_found() {
        let extractor = extractor::<256>();
        let mut rng = Rng::new(21, 0);
        let mut state = State::default();
        for k in 0..4000 {
            if k % 2 == 0 {
                state.reset();
            }
            let phasors = extractor.step(&mut state, &Scene::silence(100.0).frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Absent, "frame {k}: {phasors:?}");
            assert_finite(&phasors);
        }
        let mut missed = 0;
        for _ in 0..2000 {
            let bins = 5.0 + 118.0 * f64::from(rng.uniform());
            let scene = Scene::at_snr(bins, -9.0).with_random_phases(&mut rng);
            let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
            let found = phasors.tone == Tone::Present && (bins_of::<256>(&phasors) - bins).abs() < 0.5;
            missed += usize::from(!found);
        }
        assert!(missed < 20, "{missed} of 2000 missed");
    }

    #[test]
    fn the_noise_is_that_of_each_channel() {
        fn check<const N: usize>() {
            let extractor = extractor::<N>();
            let mut rng = Rng::new(8, 8);
            for sigma in [1.0, 30.0, 300.0] {
                let mut mean = [0.0; CHANNELS];
                for _ in 0..200 {
                    let mut frame = Scene::silence(sigma).frame::<N>(&mut rng);
                    frame.codes[2] = [-7; N];
                    let phasors = extractor.step(&mut State::default(), &frame);
                    for (mean, noise) in mean.iter_mut().zip(phasors.noise) {
                        *mean += f64::from(noise) / 200.0;
                    }
                }
                let expected = 4.0 * (sigma * sigma + 1.0 / 12.0) / N as f64;
                for channel in [0, 1, 3] {
                    let ratio = mean[channel] / expected;
                    assert!((0.93..1.08).contains(&ratio), "N {N} sigma {sigma}: {ratio}");
                }
                // The transform's rounding beside a loud neighbour.
                let stuck = mean[2] / (4.0 / 12.0 / N as f64);
                assert!((0.999..1.001 + 1e-3 * sigma * sigma).contains(&stuck), "N {N} sigma {sigma}: {stuck}");
            }
        }
        check::<64>();
        check::<256>();
        check::<1024>();
    }

    #[test]
    fn an_offset_of_a_third_of_full_scale_changes_nothing() {
        for bins in [4.5, 20.5, 37.0] {
            let mut rng = Rng::new(3, 1);
            let (mut errors, mut scene) = (vec(), Scene::at_snr(bins, 20.0));
            scene.amplitude = [1000.0; CHANNELS];
            scene.sigma = 70.0;
            scene.dc = [614.0, -614.0, 0.0, 300.0];
            for _ in 0..300 {
                let scene = scene.with_random_phases(&mut rng);
                let phasors = extractor::<256>().step(&mut State::default(), &scene.frame(&mut rng));
                assert_eq!(phasors.tone, Tone::Present);
                errors.extend(scene.errors(&phasors));
            }
            let allowed = if bins < 5.0 { 1.35 } else { 1.10 };
            assert!(rms(&errors) < allowed * scene.bound::<256>(), "{bins}: {}", rms(&errors) / scene.bound::<256>());
        }
    }

    #[test]
    fn a_dead_channel_leaves_the_others_alone() {
        let mut rng = Rng::new(4, 1);
        let scene = Scene::at_snr(33.3, 10.0);
        for dead in 0..CHANNELS {
            for value in [0, 1234, -2048] {
                let mut frame = scene.frame::<256>(&mut rng);
                frame.codes[dead] = [value; 256];
                let phasors = extractor::<256>().step(&mut State::default(), &frame);
                assert_eq!(phasors.tone, Tone::Present);
                assert!((bins_of::<256>(&phasors) - 33.3).abs() < 0.05);
                assert!(phasors.z[dead].norm_squared() < 1e-3, "{:?}", phasors.z[dead]);
                assert_eq!(phasors.clipped, value == -2048);
                for alive in (0..CHANNELS).filter(|m| *m != dead) {
                    assert!(wrapped(arg(phasors.z[alive]) - scene.phases[alive]).abs() < 0.2);
                    assert!(
                        (f64::from(phasors.z[alive].norm_squared()).sqrt() / scene.amplitude[0] - 1.0).abs() < 0.15
                    );
                }
            }
        }
    }

    #[test]
    fn a_drifting_tone_is_followed_and_a_jump_is_found_in_the_same_frame() {
        let extractor = extractor::<256>();
        for (snr_db, drift) in [(0.0, 0.002), (20.0, 0.002), (20.0, 0.05), (40.0, 0.3)] {
            let mut rng = Rng::new(6, 1);
            let mut state = State::default();
            let (mut errors, mut frequency, mut bins) = (vec(), vec(), 30.0);
            let mut bound = 0.0;
            for _ in 0..200 {
                bins += drift;
                let scene = Scene::at_snr(bins, snr_db).with_random_phases(&mut rng);
                let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
                assert_eq!(phasors.tone, Tone::Present);
                errors.extend(scene.errors(&phasors));
                frequency.push(bins_of::<256>(&phasors) - bins);
                bound = scene.bound::<256>();
            }
            assert!(rms(&errors) < 1.12 * bound, "{snr_db} dB {drift}: {}", rms(&errors) / bound);
            assert!(rms(&frequency) < 0.03, "{snr_db} dB {drift}: {}", rms(&frequency));
        }
        // Hops anywhere in the band, also onto the sidelobes of the old frequency.
        let mut rng = Rng::new(6, 2);
        let mut state = State::default();
        for _ in 0..500 {
            let bins = 5.0 + 118.0 * f64::from(rng.uniform());
            let scene = Scene::at_snr(bins, 30.0).with_random_phases(&mut rng);
            let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Present);
            assert!((bins_of::<256>(&phasors) - bins).abs() < 0.01, "{bins}: {}", bins_of::<256>(&phasors));
            assert!(scene.errors(&phasors).iter().all(|error| error.abs() < 6.0 * scene.bound::<256>()));
        }
    }

    #[test]
    fn a_tone_that_comes_back_is_found_again() {
        let extractor = extractor::<256>();
        let mut rng = Rng::new(9, 1);
        let mut state = State::default();
        let scene = Scene::new(41.7, 300.0, 100.0);
        assert_eq!(extractor.step(&mut state, &scene.frame(&mut rng)).tone, Tone::Present);
        for _ in 0..20 {
            let phasors = extractor.step(&mut state, &Scene::silence(100.0).frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Absent);
            assert!((bins_of::<256>(&phasors) - 41.7).abs() < 0.1, "the tracked frequency is kept");
            assert_eq!(phasors.z, [Complex::default(); CHANNELS]);
        }
        let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
        assert_eq!(phasors.tone, Tone::Present);
        assert!((bins_of::<256>(&phasors) - 41.7).abs() < 0.05);
    }

    #[test]
    fn a_known_tone_is_found_within_one_bin_and_nothing_else_is() {
        let mut rng = Rng::new(12, 1);
        for offset in [-0.9, -0.4, 0.0, 0.6, 0.95] {
            let config = Config { tone_hz: Some(50.0 * 400.0), ..open_config() };
            let extractor = config.build::<256>().unwrap();
            let mut scene = Scene::at_snr(50.0 + offset, 10.0);
            scene.amplitude = [500.0; CHANNELS];
            scene.sigma = 100.0;
            // A line four times as strong elsewhere.
            scene.other = [90.5, 1000.0, 0.0];
            let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Present);
            assert!(phasors.interferer);
            assert!((bins_of::<256>(&phasors) - 50.0 - offset).abs() < 0.1, "{offset}: {}", bins_of::<256>(&phasors));
            scene.amplitude = [0.0; CHANNELS];
            let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
            assert_eq!(phasors.tone, Tone::Absent, "{offset}");
        }
    }

    #[test]
    fn another_line_is_flagged_and_kept_out_by_the_window() {
        let config = Config { tone_band_hz: [30.0 * 400.0, 45.0 * 400.0], ..open_config() };
        let extractor = config.build::<256>().unwrap();
        // Line relative to the tone in dB, its bin, the flag.
        for (line_db, bin, flagged) in [(-20.0, 50.5, false), (0.0, 41.0, true), (10.0, 50.5, true), (10.0, 25.7, true)]
        {
            let mut rng = Rng::new(14, 1);
            let mut scene = Scene::new(37.4, 300.0, 21.2);
            scene.other = [bin, 300.0 * 10_f64.powf(line_db / 20.0), 0.0];
            let band = if bin > 30.0 && bin < 45.0 { [36.0 * 400.0, 38.9 * 400.0] } else { config.tone_band_hz };
            let extractor = if band == config.tone_band_hz {
                extractor.clone()
            } else {
                Config { tone_band_hz: band, ..config }.build().unwrap()
            };
            let (mut state, mut errors, mut normalised) = (State::default(), vec(), vec());
            for _ in 0..300 {
                let scene = scene.with_random_phases(&mut rng);
                let phasors = extractor.step(&mut state, &scene.frame(&mut rng));
                assert_eq!(phasors.tone, Tone::Present, "{line_db} dB at {bin}");
                assert_eq!(phasors.interferer, flagged, "{line_db} dB at {bin}");
                let new = scene.errors(&phasors);
                errors.extend(new);
                let variance = |m: usize| f64::from(phasors.noise[m] / (2.0 * phasors.z[m].norm_squared()));
                normalised.extend(new.iter().zip(1..).map(|(e, m)| e / (variance(m) + variance(0)).sqrt()));
            }
            if flagged {
                let ratio = rms(&errors) / scene.bound::<256>();
                assert!(ratio < 1.6, "{line_db} dB at {bin}: {ratio}");
                let honesty = rms(&normalised).powi(2);
                assert!((0.7..1.6).contains(&honesty), "{line_db} dB at {bin}: {honesty}");
            }
        }
    }

    #[test]
    fn a_channel_sampled_later_is_turned_back() {
        let mut rng = Rng::new(15, 1);
        let skew_s = [0.0, 2e-6, -3e-6, 7e-6];
        let mut scene = Scene::at_snr(52.3, 30.0);
        let truth = scene.phases;
        let frequency_hz = 52.3 * 400.0;
        // Channel m samples cos(w t + phase) at t + skew.
        for (phase, skew) in scene.phases.iter_mut().zip(skew_s) {
            *phase += TAU * frequency_hz * f64::from(skew);
        }
        let extractor = Config { skew_s, ..open_config() }.build::<256>().unwrap();
        let phasors = extractor.step(&mut State::default(), &scene.frame(&mut rng));
        scene.phases = truth;
        assert!(scene.errors(&phasors).iter().all(|error| error.abs() < 6.0 * scene.bound::<256>()));
    }

    #[test]
    fn more_than_one_sample_in_a_hundred_at_a_rail_is_clipping() {
        let mut rng = Rng::new(16, 1);
        let frame = Scene::new(20.0, 1500.0, 10.0).frame::<256>(&mut rng);
        let clipped = |rails: usize| {
            let mut frame = frame.clone();
            for (code, rail) in frame.codes[1].iter_mut().zip([2047, -2048].iter().cycle()).take(rails) {
                *code = *rail;
            }
            extractor::<256>().step(&mut State::default(), &frame).clipped
        };
        assert!(!clipped(0) && !clipped(2) && clipped(3));
    }

    #[test]
    fn whatever_comes_in_finite_numbers_come_out() {
        fn check<const N: usize>(backend: Backend) {
            let extractor = Config { backend, ..open_config() }.build::<N>().unwrap();
            let mut rng = Rng::new(17, N as u64);
            let mut state = State::default();
            let silent = extractor.step(&mut state, &Snapshot::zeroed());
            assert_eq!(silent.tone, Tone::Absent);
            assert_finite(&silent);
            for k in 0..120_usize {
                let mut frame = Scene::new(2.0 + k as f64 / 5.0, 1500.0, 30.0).frame::<N>(&mut rng);
                for (m, row) in frame.codes.iter_mut().enumerate() {
                    for (n, code) in row.iter_mut().enumerate() {
                        let random = (rng.uniform() * 65_536.0) as i32 as i16;
                        match (k + m) % 8 {
                            0 => *code = random,
                            1 => *code = random >> 4,
                            2 => *code = if n % (k + 2) < k / 2 { 2047 } else { -2048 },
                            3 => *code = if n % 2 == 0 { i16::MIN } else { i16::MAX },
                            4 => *code = 0,
                            5 => *code = i16::from(n == k),
                            _ => (),
                        }
                    }
                }
                assert_finite(&extractor.step(&mut state, &frame));
                assert_finite(&extractor.step(&mut State::default(), &frame));
            }
        }
        for backend in [Backend::Fixed, Backend::Microfft] {
            check::<64>(backend);
            check::<128>(backend);
            check::<256>(backend);
            check::<512>(backend);
            check::<1024>(backend);
        }
    }

    #[test]
    fn the_state_is_small() {
        assert!(size_of::<State<256>>() < 4096, "{}", size_of::<State<256>>());
        assert!(size_of::<State<1024>>() < 16 * 1024, "{}", size_of::<State<1024>>());
    }

    #[test]
    fn configurations_are_checked_and_named() {
        let refused = |config: Config| config.build::<256>().unwrap_err().field;
        let good = Config::default();
        assert!(good.build::<64>().is_ok() && good.build::<1024>().is_ok());
        assert_eq!(refused(Config { sample_rate_hz: f32::NAN, ..good }), "phase.sample_rate_hz");
        assert_eq!(refused(Config { sample_rate_hz: 0.0, ..good }), "phase.sample_rate_hz");
        assert_eq!(refused(Config { tone_band_hz: [-1.0, 1e4], ..good }), "phase.tone_band_hz");
        assert_eq!(refused(Config { tone_band_hz: [1e4, 1e3], ..good }), "phase.tone_band_hz");
        assert_eq!(refused(Config { tone_band_hz: [0.0, 800.0], ..good }), "phase.tone_band_hz");
        assert_eq!(refused(Config { tone_band_hz: [1e3, 6e4], ..good }), "phase.tone_band_hz");
        assert_eq!(refused(Config { tone_hz: Some(500.0), ..good }), "phase.tone_hz");
        assert_eq!(refused(Config { tone_hz: Some(f32::INFINITY), ..good }), "phase.tone_hz");
        assert_eq!(refused(Config { skew_s: [0.0, 0.0, 1.0, 0.0], ..good }), "phase.skew_s");
    }
}
