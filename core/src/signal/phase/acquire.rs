//! Searches the whole spectrum for the tone.

use super::fit::{Fit, Level, fit, left_over, tune};
use super::floor::{MEDIAN_OF_MEAN, hann_gain, leak, median, under_the_tone};
use super::follow::{Frequency, REFINEMENTS, bins_between};
use super::lines::{INTERPOLATION_VARIANCE, Peak, leakage, louder_beside, other_line};
use super::{Extractor, QUANTISATION, REFRESH, SEARCH_THRESHOLD, State};
use crate::base::adc::CHANNELS;
use crate::signal::spectrum::power_of_two;
use crate::signal::spectrum::tone::Window;

/// Weight of another measurement of the noise beside the same line.
const SMOOTHING: f32 = 0.25;
/// A line beside another one stands out by this from the noise at its quieter side.
const LINE_RATIO: f32 = 6.0;

/// The line in the spectrum that may be the tone.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// Its interpolated frequency, as phase per sample.
    pub(super) at: u32,
    /// Whether it is the tracked line, to within half a bin, so that it can be followed there.
    pub(super) is_held: bool,
    pub(super) is_near: bool,
    /// Whether it is high enough for a closer test.
    pub(super) is_worth_it: bool,
    /// Whether it stands out from its neighbourhood, not only from the floor of the whole spectrum.
    pub(super) is_line: bool,
    /// How much louder the noise is beside it than in the whole spectrum.
    pub(super) beside: f32,
    /// How much more than [`Extractor::CONFIRM`] a new tone needs here.
    pub(super) confirm: f32,
}

impl<const N: usize> Extractor<N> {
    /// Noise beside a peak that is not louder than this is taken as white.
    const WHITE: f32 = 1.5 * (1.0 + 25.0 / N as f32);

    fn unless_white(beside: f32) -> f32 {
        if beside > Self::WHITE { beside } else { 1.0 }
    }

    /// Evaluates the whole spectrum: floors, tone, other lines. `None` without a tone.
    pub(super) fn acquire(
        &self,
        state: &mut State<N>,
        codes: &[[i16; N]; CHANNELS],
        levels: &[Level; CHANNELS],
    ) -> Option<Fit> {
        state.floor_due_in = 0;
        let mut workspace = [0.0; N];
        state.spectrum.measure(self.config.backend, codes, &mut workspace);
        for channel in 0..CHANNELS {
            self.measure_floor(state, channel, &mut workspace);
        }
        let candidate = self.choose(state, &mut workspace);
        let before = state.tracked;
        let found = if state.interferer {
            self.settle_beside(state, codes, &candidate)
        } else {
            if state.reference.window() == Window::Hann {
                tune(state, candidate.at, Window::Flat);
            }
            let is_followed = candidate.is_held && candidate.is_near;
            let followed = if is_followed { self.follow(state, codes, REFINEMENTS) } else { None };
            followed.or_else(|| self.settle(state, codes, &candidate, REFINEMENTS))
        };
        match &found {
            Some(fit) => {
                state.floor_due_in = REFRESH - 1;
                state.beside = candidate.beside;
                remember_left_over(state, levels, fit);
            }
            None => {
                state.tracked = before;
                state.interferer = false;
            }
        }
        found
    }

    /// The floor of one channel, in the spectrum, before the correction for the tone.
    pub(super) fn measure_floor(&self, state: &mut State<N>, channel: usize, workspace: &mut [f32; N]) {
        let floor = median(&state.spectrum, channel, workspace) / MEDIAN_OF_MEAN;
        if let Some(slot) = state.floors.get_mut(channel) {
            *slot = floor.max(QUANTISATION * hann_gain::<N>());
        }
    }

    /// Chooses the line that may be the tone and corrects the floors for it; returns also whether there are other
    /// lines.
    #[inline(never)]
    pub(super) fn choose(&self, state: &mut State<N>, workspace: &mut [f32; N]) -> Candidate {
        self.statistics(&state.spectrum, &state.floors, workspace);
        let strongest = self.peak(workspace, self.band);
        let held = state.tracked.and_then(|tracked| self.held(workspace, tracked, &strongest));
        let peak = held.unwrap_or(strongest);
        let [is_comparable, disturbs] = other_line(workspace, &peak);
        state.interferer = disturbs;
        let at = (peak.bins * Self::STEPS_PER_BIN) as u32;
        // Half blocks determine the frequency to within one bin only.
        let is_near = state.tracked.is_some_and(|tracked| bins_between::<N>(tracked.step, at).abs() < 0.5);
        let [quieter, louder] = louder_beside(workspace, &peak);
        // A strong line has skirts at its side.
        let measured = if is_comparable { quieter } else { louder };
        let smoothed = if is_near { state.beside + SMOOTHING * (measured - state.beside) } else { measured };
        let beside = Self::unless_white(smoothed);
        self.take_over_floors(state, &peak, beside);
        if state.interferer {
            state.leakage = leakage(&state.spectrum, workspace, &peak);
        }
        Candidate {
            at,
            is_held: held.is_some(),
            is_near,
            is_worth_it: self.config.tone_hz.is_some() || peak.statistic >= SEARCH_THRESHOLD,
            is_line: peak.statistic > LINE_RATIO * quieter,
            beside: smoothed,
            confirm: (Self::unless_white(louder) / beside).max(1.0),
        }
    }

    fn take_over_floors(&self, state: &mut State<N>, peak: &Peak, beside: f32) {
        let leaks = leak(peak.bins - peak.bin as f32);
        for ((variance, floor), channel) in state.variance.iter_mut().zip(state.floors).zip(0..) {
            let power = state.spectrum.power(channel, peak.bin) as f32 * power_of_two(state.spectrum.exponent(channel));
            let floor = beside * floor * under_the_tone::<N>(power / floor, leaks);
            *variance = (floor / hann_gain::<N>()).max(QUANTISATION);
        }
    }

    /// Fits the tone beside another line. The half blocks have no window that would keep the other line out of the
    /// frequency.
    pub(super) fn settle_beside(
        &self,
        state: &mut State<N>,
        codes: &[[i16; N]; CHANNELS],
        candidate: &Candidate,
    ) -> Option<Fit> {
        tune(state, candidate.at, Window::Hann);
        state.tracked = Some(Frequency { step: candidate.at, variance: INTERPOLATION_VARIANCE });
        let is_new = self.config.tone_hz.is_none() && !candidate.is_held;
        let confirm = if is_new { Self::CONFIRM * candidate.confirm } else { Self::HOLD };
        let fit = fit(state, codes);
        let is_tone = fit.statistic >= confirm && candidate.is_line && self.in_band(candidate.at);
        is_tone.then_some(fit)
    }

    /// Moves the reference to a tone without other lines.
    pub(super) fn settle(
        &self,
        state: &mut State<N>,
        codes: &[[i16; N]; CHANNELS],
        candidate: &Candidate,
        rounds: u8,
    ) -> Option<Fit> {
        let confirm = if self.config.tone_hz.is_some() { Self::HOLD } else { Self::CONFIRM * candidate.confirm };
        let refined = if candidate.is_worth_it { self.refine(state, codes, candidate.at, rounds) } else { None };
        refined.filter(|fit| fit.statistic >= confirm)
    }
}

/// Stores the residual power together with the measured floor. Above some 50 dB the floor in the spectrum is its own
/// rounding.
pub(super) fn remember_left_over<const N: usize>(state: &mut State<N>, levels: &[Level; CHANNELS], fit: &Fit) {
    state.left_over = left_over(&state.solver, levels, fit);
    for (variance, left) in state.variance.iter_mut().zip(state.left_over) {
        let residual = left / (N as f32 - 4.0);
        if residual < 0.5 * *variance && state.beside <= Extractor::<N>::WHITE {
            *variance = residual.max(QUANTISATION);
        }
    }
}
