//! Least-squares fit of one tone at a given frequency, and its residual power.

use super::{Complex, State};
use crate::base::adc::CHANNELS;
use crate::base::math::{active, sqrt};
use crate::signal::spectrum::tone::{Products, Reference, Window};

/// A table's normal equations, solved.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Solver {
    /// Whole block: `a` and `b` from their products.
    pub(super) whole: [f32; 2],
    /// Half block: inverse of the symmetric two by two system, `[aa, ab, bb]`.
    pub(super) half: [f32; 3],
    /// Variance of a phasor for samples of variance one.
    pub(super) noise_gain: f32,
    /// Energy in the block of a cosine and a sine of amplitude one, without their mean.
    pub(super) energy: [f32; 2],
}

impl Solver {
    pub(super) fn new<const N: usize>(reference: &Reference<N>) -> Self {
        let normal = reference.normal();
        let scale = reference.scale() as f32;
        // Divided by the table's scale once: products over these are in ADC units.
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
    pub(super) fn phasor(&self, products: &Products) -> Complex {
        Complex {
            re: self.whole[0] * (products.first_cos as f32 + products.second_cos as f32),
            im: self.whole[1] * (products.first_sin as f32 - products.second_sin as f32),
        }
    }

    /// The phasors over the first and the second half, both referred to the middle of the block.
    pub(super) fn half_phasors(&self, products: &Products) -> [Complex; 2] {
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
pub(super) struct Fit {
    pub(super) z: [Complex; CHANNELS],
    /// Mean over the channels of `|z|^2` over its variance.
    pub(super) statistic: f32,
    /// The tone's distance from the reference, in bins; for a flat window.
    pub(super) offset_bins: f32,
}

/// Makes the reference for a frequency and solves its normal equations.
pub(super) fn tune<const N: usize>(state: &mut State<N>, step: u32, window: Window) {
    state.reference.tune(step, window);
    state.solver = Solver::new(&state.reference);
}

/// Fits the tone at the reference's frequency.
pub(super) fn fit<const N: usize>(state: &State<N>, codes: &[[i16; N]; CHANNELS]) -> Fit {
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
        advance = advance.plus(second.times_conj(first).scaled(weight));
    }
    Fit {
        z,
        statistic: statistic / (CHANNELS as f32 * solver.noise_gain),
        offset_bins: advance.arg() * core::f32::consts::FRAC_1_PI,
    }
}

/// Variance of a fit's distance from the reference, in squared bins.
pub(super) fn offset_variance(fit: &Fit) -> f32 {
    0.5 * core::f32::consts::FRAC_1_PI * core::f32::consts::FRAC_1_PI / fit.statistic.max(1.0)
}

/// Level of a channel's samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// Energy of the block without the mean of each half.
    pub(super) energy: f32,
    pub(super) clipped: u32,
}

pub(super) fn level<const N: usize>(row: &[i16; N]) -> Level {
    let (first, second) = row.split_at(N / 2);
    let halves = [first, second].map(active::moments);
    let half = N as i64 / 2;
    let energy =
        halves.map(|half_block| half_block.energy * half - i64::from(half_block.sum) * i64::from(half_block.sum));
    Level { energy: (energy[0] + energy[1]) as f32 / half as f32, clipped: halves[0].clipped + halves[1].clipped }
}

/// Residual energy of the fit, per channel. In white noise it is `N - 4` times the variance: the fit has two
/// parameters beside the two means.
pub(super) fn left_over(solver: &Solver, levels: &[Level; CHANNELS], fit: &Fit) -> [f32; CHANNELS] {
    let mut left = [0.0; CHANNELS];
    for ((left, level), z) in left.iter_mut().zip(levels).zip(fit.z) {
        *left = (level.energy - z.re * z.re * solver.energy[0] - z.im * z.im * solver.energy[1]).max(0.0);
    }
    left
}

/// Whether the frame differs from the one in which the floor was measured: by more than six standard deviations of
/// the energy of white noise, in some channel.
pub(super) fn left_over_changed<const N: usize>(state: &State<N>, levels: &[Level; CHANNELS], fit: &Fit) -> bool {
    let bound = 1.0 + 6.0 * sqrt(2.0 / N as f32);
    let now = left_over(&state.solver, levels, fit);
    now.iter().zip(state.left_over).zip(levels).any(|((now, then), level)| {
        // 40 dB below the signal, an error of the frequency within its tolerance is visible.
        let least = 1e-4 * level.energy + 1.0;
        let (now, then) = (now.max(least), then.max(least));
        now > then * bound || then > now * bound
    })
}
