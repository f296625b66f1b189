//! Tracks the frequency from frame to frame, by the advance of the phase from half block to half block.

use super::fit::{Fit, fit, offset_variance, tune};
use super::{Extractor, State};
use crate::base::adc::CHANNELS;
use crate::base::math::sqrt;
use crate::signal::spectrum::tone::Window;

/// Variance by which the tone's frequency may move from frame to frame, in squared bins.
const DRIFT: f32 = 1e-6;
/// Squared distance, in variances, beyond which a new frequency replaces the old one instead of being averaged.
const GATE: f32 = 16.0;
/// The reference is made anew when the frequency is this far from it, in bins, or two standard deviations.
const RETUNE_BINS: f32 = 1.0 / 256.0;
/// A new tone's frequency is refined to this, in bins, or a quarter of a standard deviation.
const REFINED_BINS: f32 = 1.0 / 2048.0;
/// Rounds of refinement from an interpolated peak to the tone.
pub(super) const REFINEMENTS: u8 = 4;

/// A frequency in the reference's units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frequency {
    /// Phase a sample, 2^32 a turn.
    pub(super) step: u32,
    /// Variance in squared bins.
    pub(super) variance: f32,
}

impl<const N: usize> Extractor<N> {
    /// Fits at the tracked frequency and updates it; `None` when the tone is not there.
    pub(super) fn follow(&self, state: &mut State<N>, codes: &[[i16; N]; CHANNELS], rounds: u8) -> Option<Fit> {
        let mut tracked = state.tracked?;
        tracked.variance += DRIFT;
        if state.reference.step() != tracked.step {
            let away = bins_between::<N>(state.reference.step(), tracked.step);
            if away.abs() > RETUNE_BINS.max(2.0 * sqrt(tracked.variance)) {
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
            // Accepted only if the fit is better with it.
            let refined = self.refine(state, codes, measured, rounds)?;
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
    pub(super) fn refine(
        &self,
        state: &mut State<N>,
        codes: &[[i16; N]; CHANNELS],
        from: u32,
        rounds: u8,
    ) -> Option<Fit> {
        let mut step = from;
        let mut found = None;
        for _ in 0..rounds {
            if !self.is_near_band(step) {
                return None;
            }
            tune(state, step, Window::Flat);
            let fit = fit(state, codes);
            let variance = offset_variance(&fit);
            step = step.wrapping_add(steps::<N>(fit.offset_bins));
            found = Some((fit, Frequency { step, variance }));
            if fit.offset_bins.abs() < REFINED_BINS.max(0.25 * sqrt(variance)) {
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
}

pub(super) fn steps<const N: usize>(bins: f32) -> u32 {
    (bins * Extractor::<N>::STEPS_PER_BIN) as i32 as u32
}

/// The distance from one frequency to another, in bins.
pub(super) fn bins_between<const N: usize>(from: u32, to: u32) -> f32 {
    to.wrapping_sub(from) as i32 as f32 / Extractor::<N>::STEPS_PER_BIN
}
