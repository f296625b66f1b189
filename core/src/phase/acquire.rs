//! The tone, looked for in the whole spectrum.

use super::fit::{Fit, Level, fit, left_over, tune};
use super::floor::{MEDIAN_OF_MEAN, hann_gain, median, power_of_two, under_the_tone};
use super::follow::{Frequency, bins_between};
use super::lines::{INTERPOLATION_VARIANCE, leakage, other_line};
use super::{Extractor, QUANTISATION, REFRESH, SEARCH_THRESHOLD, State};
use crate::adc::CHANNELS;
use crate::spectrum::tone::Window;

impl<const N: usize> Extractor<N> {
    /// Looks at the whole spectrum: floors, tone, other lines. Nothing when there is no tone.
    pub(super) fn acquire(
        &self,
        state: &mut State<N>,
        codes: &[[i16; N]; CHANNELS],
        levels: &[Level; CHANNELS],
    ) -> Option<Fit> {
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
            state.leakage = leakage(state, &peak);
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
}
