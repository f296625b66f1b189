//! The noise floor of a channel: the median of its periodogram, corrected for the tone.

use super::lines::LINE_THRESHOLD;
use crate::base::sort::nth;
use crate::base::units::sin_cos;
use crate::signal::spectrum::{Spectrum, power_of_two};

/// Median over mean of an exponential variable: `ln 2`.
pub(super) const MEDIAN_OF_MEAN: f32 = core::f32::consts::LN_2;

/// Mean power of the windowed periodogram for white noise of variance one.
pub(super) const fn hann_gain<const N: usize>() -> f32 {
    0.375 * N as f32
}

/// The median power of a channel, from bin 2 to N/2 - 2.
pub(super) fn median<const N: usize>(spectrum: &Spectrum<N>, channel: usize, workspace: &mut [f32; N]) -> f32 {
    let count = N / 2 - 3;
    for (value, power) in workspace.iter_mut().zip(spectrum.powers(channel).skip(1)) {
        *value = power as f32;
    }
    let median = workspace.get_mut(..count).and_then(|powers| nth(powers, count / 2)).unwrap_or_default();
    // The powers of a quiet channel beside a loud one are nothing or one.
    median.max(0.5 * MEDIAN_OF_MEAN) * power_of_two(spectrum.exponent(channel))
}

/// How much the bins under the tone, which all lie above the floor, raise the median: the factor that corrects for
/// it. `ratio` is the peak over the floor, `leaks` the [`leak`] of the tone.
///
/// Hann's window falls off as `leak / d^6`, so `2 d` bins with `d = (ratio leak)^(1/6)` stand out, and the main lobe does.
/// With `c` of `n` bins excluded the middle one is the `n / 2 / (n - c)` quantile of the noise.
pub(super) fn under_the_tone<const N: usize>(ratio: f32, leaks: f32) -> f32 {
    if ratio < LINE_THRESHOLD {
        return 1.0;
    }
    let reach = libm::expf(libm::logf(ratio * leaks + 1.0) * (1.0 / 6.0)).max(2.0);
    let count = (N / 2 - 3) as f32;
    let occupied = (2.0 * reach).min(0.4 * count);
    MEDIAN_OF_MEAN / libm::logf((count - occupied) / (0.5 * count - occupied))
}

/// `(sin(pi f) / pi)^2` of a tone `f` bins from its peak's bin.
pub(super) fn leak(fraction: f32) -> f32 {
    let (sine, _) = sin_cos(core::f32::consts::PI * fraction);
    let sine_over_pi = sine * core::f32::consts::FRAC_1_PI;
    sine_over_pi * sine_over_pi
}
