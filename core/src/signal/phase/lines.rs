//! Lines in the periodogram: peaks, which of them is the tone, and the leakage of the others into its phasors.

use core::ops::Range;

use super::Extractor;
use super::follow::Frequency;
use crate::base::adc::CHANNELS;
use crate::base::math::sqrt;
use crate::base::sort::nth;
use crate::base::units::sin_cos;
use crate::signal::spectrum::{Spectrum, power_of_two};

/// Two lines within 10 dB, as a ratio of powers.
const COMPARABLE: f32 = 0.1;
/// A line beside the tone must stand this far above the floor to count.
pub(super) const LINE_THRESHOLD: f32 = 8.0;
/// The largest number of other lines that are accounted for.
const LINES_MAX: usize = 12;
/// A line's own bins either side, in Hann's window.
const LOBE_BINS: usize = 3;
/// A peak's share in the bin `d` away is at most half of this over `d^6`, where that is more than three bins.
const SKIRT: f32 = 0.8;
/// The largest number of bins on one side of a peak in which the noise is measured.
const SIDE_BINS_MAX: usize = 40;
/// Squared error of a peak interpolated in the periodogram, in squared bins.
pub(super) const INTERPOLATION_VARIANCE: f32 = 4e-4;

/// A peak in the periodogram.
#[derive(Clone, Copy, Debug)]
pub(super) struct Peak {
    pub(super) bin: usize,
    /// Interpolated frequency.
    pub(super) bins: f32,
    pub(super) statistic: f32,
}

impl<const N: usize> Extractor<N> {
    /// The tracked line, if it still is a line of its own and within 10 dB of the strongest: then it stays the tone.
    pub(super) fn held(&self, values: &[f32; N], tracked: Frequency, strongest: &Peak) -> Option<Peak> {
        let bin = tracked.step as f32 / Self::STEPS_PER_BIN;
        let near = self.peak(values, [bin - 1.0, bin + 1.0]);
        let apart = near.bin == strongest.bin || near.bin.abs_diff(strongest.bin) > LOBE_BINS;
        (apart && near.statistic >= COMPARABLE * strongest.statistic).then_some(near)
    }

    /// Fills the workspace with the mean over the channels of power over floor, from bin 1 to N/2 - 1.
    #[inline(never)]
    pub(super) fn statistics(&self, spectrum: &Spectrum<N>, floors: &[f32; CHANNELS], workspace: &mut [f32; N]) {
        let [a, b, c, d] = core::array::from_fn(|channel| {
            power_of_two(spectrum.exponent(channel)) / (CHANNELS as f32 * floors[channel % CHANNELS])
        });
        let powers = spectrum.pair_powers(0).zip(spectrum.pair_powers(1));
        for (sum, ((first, second), (third, fourth))) in workspace.iter_mut().skip(1).zip(powers) {
            *sum = first as f32 * a + second as f32 * b + third as f32 * c + fourth as f32 * d;
        }
    }

    /// The highest peak between two frequencies in bins, interpolated. A slope towards a line outside does not count.
    pub(super) fn peak(&self, values: &[f32; N], band: [f32; 2]) -> Peak {
        let from = (libm::floorf(band[0]) as usize).clamp(2, N / 2 - 2);
        let to = (libm::ceilf(band[1]) as usize).clamp(from, N / 2 - 2);
        let mut bin = from;
        let mut statistic = 0.0;
        for (k, value) in values.iter().enumerate().take(to + 1).skip(from) {
            if *value > statistic && is_summit(values, k) {
                (bin, statistic) = (k, *value);
            }
        }
        Peak { bin, bins: interpolated(values, bin), statistic }
    }
}

/// The values on either side of a bin; the modulus only avoids a bounds check.
fn neighbours<const N: usize>(values: &[f32; N], bin: usize) -> [f32; 2] {
    [values[(bin + N - 1) % N], values[(bin + 1) % N]]
}

/// Whether a bin is no lower than those beside it.
fn is_summit<const N: usize>(values: &[f32; N], bin: usize) -> bool {
    neighbours(values, bin).iter().all(|beside| values[bin % N] >= *beside)
}

/// Position of the tone in a peak of power, in bins: for Hann's window and the ratio `r` of the larger neighbour's
/// amplitude to the peak's, `(2 r - 1) / (r + 1)` bins towards that neighbour.
fn interpolated<const N: usize>(values: &[f32; N], bin: usize) -> f32 {
    let summit = values[bin % N];
    let [below, above] = neighbours(values, bin);
    let (side, neighbour) = if above > below { (1.0, above) } else { (-1.0, below) };
    let ratio = if summit > 0.0 { sqrt(neighbour / summit).min(1.0) } else { 0.5 };
    bin as f32 + side * (2.0 * ratio - 1.0) / (ratio + 1.0)
}

/// Whether there is another line, more than three bins from the peak, within 10 dB of it; and whether there is such a line or one
/// that disturbs a fit without a window: that passes `1 / (pi d)^2` of its power `d` bins away, here more than a quarter of the noise.
pub(super) fn other_line<const N: usize>(values: &[f32; N], peak: &Peak) -> [bool; 2] {
    let bound = COMPARABLE * peak.statistic;
    let (mut is_comparable, mut disturbs) = (false, false);
    for (k, value) in values.iter().enumerate().take(N / 2 - 1).skip(2) {
        let bins = k.abs_diff(peak.bin);
        if *value > LINE_THRESHOLD && bins > LOBE_BINS {
            let away = bins as f32;
            let skirt = peak.statistic * SKIRT / (away * away * away * away * away * away);
            is_comparable |= *value > bound;
            disturbs |= *value - skirt > 0.25 * core::f32::consts::PI * core::f32::consts::PI * away * away;
        }
    }
    [is_comparable, is_comparable || disturbs]
}

/// How much louder the noise is beside a peak than the floor of the whole spectrum, at the quieter side and at the louder one: about
/// 1 for white noise. Noise that is louder at some frequencies, as that of propellers, has maxima that are no lines. A side
/// of less than two bins within the spectrum counts as the other one.
pub(super) fn louder_beside<const N: usize>(values: &[f32; N], peak: &Peak) -> [f32; 2] {
    // A twenty-fifth of the sample rate on either side: with 256 samples, half of the bins are not of one line's.
    let reach = (5 * N / 128).clamp(6, SIDE_BINS_MAX);
    let (below, above) = ((peak.bin + 1).saturating_sub(LOBE_BINS), peak.bin + LOBE_BINS);
    let below = louder(values, peak, below.saturating_sub(reach).max(2)..below);
    let above = louder(values, peak, above..(above + reach).min(N / 2 - 2));
    match (below, above) {
        (Some(below), Some(above)) => [below.min(above), below.max(above)],
        (one, other) => [one.or(other).unwrap_or(1.0); 2],
    }
}

/// The median of some bins. What leaks from the peak itself is taken off, by Hann's window `(f (f^2 - 1) / (d (d^2 - 1)))^2` of
/// it for a peak `f` from its bin.
#[inline(never)]
fn louder<const N: usize>(values: &[f32; N], peak: &Peak, side: Range<usize>) -> Option<f32> {
    let passed = |bins: f32| bins * (bins * bins - 1.0);
    let fraction = libm::fabsf(peak.bins - peak.bin as f32) + sqrt(INTERPOLATION_VARIANCE);
    let leaking = peak.statistic * passed(fraction) * passed(fraction);
    let mut away = side.start as f32 - peak.bins;
    let mut noise = [0.0; SIDE_BINS_MAX];
    let mut count = 0;
    for (noise, value) in noise.iter_mut().zip(values.get(side)?) {
        *noise = (value - leaking / (passed(away) * passed(away))).max(0.0);
        away += 1.0;
        count += 1;
    }
    nth(noise.get_mut(..count).filter(|noise| noise.len() > 1)?, count / 2)
}

/// Leakage of the other lines into each channel's phasor with Hann's window, as a variance in squared ADC units.
///
/// The window passes `sin pi d / (pi d (d^2 - 1))` of an amplitude `d` bins away, and both ends of `d` are
/// interpolated. The constant that is removed from each half couples lines at `w` and `w'` by up to `4 sqrt 2 / (N^2
/// sin w/2 sin w'/2)`. The three bins of a line of amplitude `A` hold `3/32 (N A)^2` together.
pub(super) fn leakage<const N: usize>(spectrum: &Spectrum<N>, values: &[f32; N], peak: &Peak) -> [f32; CHANNELS] {
    let squared_amplitude = 32.0 / (3.0 * N as f32 * N as f32);
    let scales: [f32; CHANNELS] =
        core::array::from_fn(|channel| squared_amplitude * power_of_two(spectrum.exponent(channel)));
    let half_step_sine = |bins: f32| sin_cos(core::f32::consts::PI / N as f32 * bins).0;
    let mut leakage = [0.0; CHANNELS];
    let mut count = 0;
    for (k, value) in values.iter().enumerate().take(N / 2 - 2).skip(3) {
        let is_line = *value > LINE_THRESHOLD && is_summit(values, k);
        if !is_line || k.abs_diff(peak.bin) <= LOBE_BINS || count == LINES_MAX {
            continue;
        }
        count += 1;
        let bins = interpolated(values, k);
        let away = bins - peak.bins;
        let (sine, _) = sin_cos(core::f32::consts::PI * away);
        let blur = 2.0 * INTERPOLATION_VARIANCE * core::f32::consts::PI * core::f32::consts::PI;
        let falloff = core::f32::consts::PI * away * (away * away - 1.0);
        let constant = (N * N) as f32 * half_step_sine(bins) * half_step_sine(peak.bins);
        let passed = (sine * sine + blur) / (falloff * falloff) + 32.0 / (constant * constant);
        for ((sum, scale), channel) in leakage.iter_mut().zip(scales).zip(0..) {
            let lobe = [k - 1, k, k + 1].map(|bin| spectrum.power(channel, bin) as f32);
            *sum += scale * passed * (lobe[0] + lobe[1] + lobe[2]);
        }
    }
    leakage
}
