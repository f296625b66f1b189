//! Phasors: one complex amplitude per channel, its noise, and whether there is a tone at all. Uses
//! [`crate::signal::spectrum`]; its output goes to [`crate::doa::bearing`].
//!
//! **Fit.** Least squares of `x[n] = a cos w t + b sin w t + d` over the block, `t = n - (N-1)/2`, with the constant
//! projected out beforehand ([`crate::signal::spectrum::tone`]). The origin in the middle makes cosine and sine
//! orthogonal, so `a = sum C x / sum C c`, `b = sum S x / sum S s`, `z = a - j b`. Constant and negative-frequency
//! image are removed for any frequency between bins.
//!
//! **Frequency.** The same fit to each half block gives `z1`, `z2`, and `arg sum_m z2 z1* / v_m = pi d` the distance `d` from
//! the reference in bins, with variance `1 / (2 pi^2 s)` where `s` is the mean of `|z_m|^2 / v_m` over the channels. A
//! scalar Kalman filter follows it; beyond four standard deviations it is believed at once.
//!
//! **Acquisition**, at the start, on loss, when the power the fit leaves over has changed, and every
//! [`REFRESH`] frames for the noise floor: the Hann periodogram, each channel in units of its floor (the median over
//! `ln 2`, corrected for the bins under the tone), averaged over the channels. The peak in the band must reach
//! [`SEARCH_THRESHOLD`] and then, after refinement and the fit, `s` must reach [`CONFIRM_THRESHOLD`]: in noise alone `s`
//! is the mean of four exponential variables, and exceeds 7 in 3 of 10^9 bins.
//!
//! **Noise that is not white**, as behind a filter: where it is louder beside the peak than in the whole spectrum, the floors are
//! raised by as much, and a new tone needs as much more. A hump of a few bins is not told from a tone.
//!
//! **Other lines.** With another line within 10 dB, or one that would disturb it, the fit is weighted by Hann's window: the
//! variance is half as much again, but lines more than three bins away are suppressed to `sin pi d / (pi d (d^2 - 1))` of their
//! amplitude, which [`Phasors::noise`] then includes. Every frame is then acquired anew. A line within three bins of the tone or of an
//! end of the spectrum is not in that noise, and turns the phase by more than it says.
//!
//! Cost of four channels, N = 256: bench rows `phasors` (products with a known reference), `spectrum` (periodogram),
//! `phase_tracking`, `phase_renewing` (with the floor), `phase_first`; other libraries stand beside the first two.

use crate::base::adc::{AdcFrame, CHANNELS};
use crate::base::error::{ConfigError, Why, check};
use crate::base::time::Instant;
use crate::signal::spectrum::tone::{Reference, Window};
use crate::signal::spectrum::{Backend, Spectrum};

mod acquire;
mod complex;
mod fit;
mod floor;
mod follow;
mod lines;
#[cfg(test)]
mod scene;
#[cfg(test)]
mod tests;

pub use complex::Complex;

use fit::{Fit, Level, Solver, left_over_changed, level};
use follow::{Frequency, REFINEMENTS};

/// Whether a frame holds the tone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Tone {
    /// There is a tone above the noise floor.
    Present,
    /// Nothing above the noise floor.
    Absent,
}

/// One phasor per channel.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Phasors {
    /// The middle of the block.
    pub time: Instant,
    /// Channel `m` contains `Re(z e^{j w (n - (N-1)/2)})`; the magnitude is the amplitude in ADC units.
    pub z: [Complex; CHANNELS],
    /// Variance of each phasor, `E|z - truth|^2` in squared ADC units: `4 sigma^2 / N` in white noise of variance
    /// `sigma^2`, and the leakage of other lines.
    pub noise: [f32; CHANNELS],
    /// Tone power over noise power, per sample, mean over the channels: `10 lg(A^2 / (2 sigma^2))`.
    pub snr_db: f32,
    /// The tone's frequency.
    pub frequency_hz: f32,
    /// Whether the frame holds the tone.
    pub tone: Tone,
    /// More than 1 % of some channel's samples are at a rail.
    pub clipped: bool,
    /// There is another line in the spectrum, within 10 dB of the tone or disturbing it.
    pub interferer: bool,
}

/// A periodogram peak, in units of the noise floor, that is tested further.
pub const SEARCH_THRESHOLD: f32 = 4.0;
/// The tone statistic, after refinement, required for a new tone; times `1 + 25 / N` for the floor's own uncertainty.
pub const CONFIRM_THRESHOLD: f32 = 7.0;
/// The tone statistic, at a known frequency, required for a tone that is still there; times the same.
pub const HOLD_THRESHOLD: f32 = 5.5;
/// The noise floor is measured anew after this many frames.
pub const REFRESH: u8 = 8;

/// A tone this far outside the band may still be one at its edge.
const EDGE_BINS: f32 = 0.05;

/// Harmonics of a clipped tone that are considered.
const HARMONICS: u32 = 15;
/// No farther from the tone they pass for it.
const FOLDED_BINS: f32 = 2.5;

/// Variance of the converter's rounding, in squared ADC units: no channel has less noise.
const QUANTISATION: f32 = 1.0 / 12.0;
/// The signal-to-noise ratio reported without a tone.
const SNR_FLOOR_DB: f32 = -60.0;

/// Configuration of the extraction.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct Config {
    /// Sample rate of each channel.
    pub sample_rate_hz: f32,
    /// The tone lies inside this band.
    pub tone_band_hz: [f32; 2],
    /// The tone's frequency, if it is known to within one bin: then it is the only one considered.
    pub tone_hz: Option<f32>,
    /// Sampling delay of each channel: channel `i` is sampled this much later than its time stamp.
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

/// State kept from frame to frame: the tracked frequency and the noise floor; and working memory.
#[derive(Clone, Debug)]
pub struct State<const N: usize> {
    spectrum: Spectrum<N>,
    reference: Reference<N>,
    solver: Solver,
    /// The tracked frequency and its variance in squared bins.
    tracked: Option<Frequency>,
    /// Floor of each channel in the spectrum, if it has been measured.
    floors: [f32; CHANNELS],
    /// Variance of a sample, per channel, in squared ADC units.
    variance: [f32; CHANNELS],
    /// Residual power of the fit when the floor was measured, per channel.
    left_over: [f32; CHANNELS],
    /// Frames until the floor is due.
    floor_due_in: u8,
    /// How much louder the noise is beside the tone than in the whole spectrum, smoothed over the measurements since it is tracked.
    beside: f32,
    interferer: bool,
    /// Variance of a phasor due to the interferers, per channel, in squared ADC units.
    leakage: [f32; CHANNELS],
}

impl<const N: usize> Default for State<N> {
    fn default() -> Self {
        Self {
            spectrum: Spectrum::default(),
            reference: Reference::default(),
            solver: Solver::default(),
            tracked: None,
            floors: [QUANTISATION; CHANNELS],
            variance: [QUANTISATION; CHANNELS],
            left_over: [0.0; CHANNELS],
            floor_due_in: 0,
            beside: 1.0,
            interferer: false,
            leakage: [0.0; CHANNELS],
        }
    }
}

impl<const N: usize> State<N> {
    /// Back to the state before the first frame, in place.
    pub fn clear(&mut self) {
        let Self {
            spectrum,
            reference,
            solver,
            tracked,
            floors,
            variance,
            left_over,
            floor_due_in,
            beside,
            interferer,
            leakage,
        } = self;
        spectrum.clear();
        *reference = Reference::default();
        *solver = Solver::default();
        (*tracked, *floor_due_in, *beside, *interferer) = (None, 0, 1.0, false);
        (*floors, *variance) = ([QUANTISATION; CHANNELS], [QUANTISATION; CHANNELS]);
        (*left_over, *leakage) = ([0.0; CHANNELS], [0.0; CHANNELS]);
    }

    /// Forgets the tone: for a frame that does not follow the ones before.
    pub fn reset(&mut self) {
        self.tracked = None;
        self.floor_due_in = 0;
        self.interferer = false;
    }
}

impl<const N: usize> Extractor<N> {
    /// Phase steps a bin.
    const STEPS_PER_BIN: f32 = 4_294_967_296.0 / N as f32;
    /// The statistics' thresholds, for a floor that is the median of few bins.
    const HOLD: f32 = HOLD_THRESHOLD * (1.0 + 25.0 / N as f32);
    const CONFIRM: f32 = CONFIRM_THRESHOLD * (1.0 + 25.0 / N as f32);

    /// Extracts the phasors of one frame.
    pub fn step(&self, state: &mut State<N>, frame: &AdcFrame<N>) -> Phasors {
        let codes = &frame.codes;
        let levels = codes.each_ref().map(level);
        let mut found = None;
        if state.floor_due_in > 0 && state.reference.window() == Window::Flat {
            state.floor_due_in -= 1;
            let before = state.tracked;
            found = self.follow(state, codes, REFINEMENTS).filter(|fit| !left_over_changed::<N>(state, &levels, fit));
            if found.is_none() {
                state.tracked = before;
            }
        }
        if found.is_none() {
            found = self.acquire(state, codes, &levels);
        }
        self.report(state, frame, &levels, found)
    }

    /// Converts the result into the units of the output.
    fn report(&self, state: &State<N>, frame: &AdcFrame<N>, levels: &[Level; CHANNELS], found: Option<Fit>) -> Phasors {
        let rate = self.config.sample_rate_hz;
        let frequency_hz = state.tracked.map_or(0.0, |tracked| tracked.step as f32 * (rate / 4_294_967_296.0));
        let mut phasors = Phasors {
            time: frame.time,
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
            // There is no noise where the wave is clipped. The remaining noise is at the zero crossings, where it
            // turns the phase: with a share c clipped, 1 + sin(pi c) / (pi (1 - c)) times as much as the same power
            // all round. The harmonics have raised the floor a little too; 1 + 0.85 c makes up for both.
            let tone_bins = state.tracked.map_or(0.0, |tracked| tracked.step as f32 / Self::STEPS_PER_BIN);
            for ((noise, level), z) in phasors.noise.iter_mut().zip(levels).zip(fit.z) {
                let share = level.clipped as f32 / N as f32;
                *noise *= 1.0 + 0.85 * share;
                if share > 0.0 {
                    let folded = share * folded::<N>(tone_bins);
                    *noise += folded * folded * z.norm_squared();
                }
            }
            if state.interferer {
                for (noise, leakage) in phasors.noise.iter_mut().zip(state.leakage) {
                    *noise += leakage;
                }
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
                    *z = z.times_conj(Complex::at(core::f32::consts::TAU * frequency_hz * skew_s));
                }
            }
        }
        phasors
    }

    /// Whether a frequency is in the band, with a tolerance for noise at its edge.
    fn in_band(&self, step: u32) -> bool {
        self.is_within(step, EDGE_BINS)
    }

    /// Whether a peak there may be that of a tone in the band.
    fn is_near_band(&self, step: u32) -> bool {
        self.is_within(step, 0.5)
    }

    fn is_within(&self, step: u32, margin_bins: f32) -> bool {
        let bins = step as f32 / Self::STEPS_PER_BIN;
        bins > self.band[0] - margin_bins && bins < self.band[1] + margin_bins
    }
}

/// How much of a clipped tone's harmonics is sampled as if it were the tone, of its amplitude: the `h`-th, at most `1 / h` where all of the
/// wave is clipped and less than in proportion where a share is, folds onto it near the sample rate over `h + 1` and `h - 1`.
#[cold]
fn folded<const N: usize>(tone_bins: f32) -> f32 {
    let mut amplitude = 0.0;
    for h in 2..=HARMONICS {
        let at = tone_bins * h as f32 / N as f32;
        let beyond = at - libm::floorf(at + 0.5);
        let away_bins = libm::fabsf(beyond) * N as f32 - tone_bins;
        // Those farther away have raised the floor.
        if libm::fabsf(away_bins) < FOLDED_BINS {
            amplitude += 1.0 / h as f32;
        }
    }
    amplitude
}
