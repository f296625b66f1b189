//! The lock-in: products with a cosine and a sine at one frequency, exact in integers.
//!
//! The time origin is the middle of the block, so sample `N/2 + k` and sample `N/2 - 1 - k` share the reference
//! `c_k = cos((k + 1/2) w)`, `s_k = +- sin((k + 1/2) w)`, and half a table serves.
//!
//! The mean of each half block must not leak into the products. Instead of measuring it and solving for it, the table
//! holds the reference minus its projection on a constant: with weights `h_k` (all one, or Hann's), `C_k = h_k (c_k -
//! c~)`, `c~ = sum h c / sum h`, and `S_k` alike. The products with `C`, `S` are then those of the least-squares fit
//! of cosine, sine and a constant (the theorem of Frisch and Waugh), at no cost at run time.
//!
//! Frequencies are phase steps per sample, 2^32 per turn.

#![deny(clippy::float_arithmetic)]

use super::trig::{ONE, Oscillator, cos_sin};
use crate::base::adc::CHANNELS;
use crate::base::math::active;

/// How samples are weighted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Window {
    /// All alike: the least variance in white noise.
    #[default]
    Flat,
    /// Hann: half as much variance again, but other lines are kept out.
    Hann,
}

/// A reference table and its normal equations.
#[derive(Clone, Debug)]
pub struct Reference<const N: usize> {
    table: Table<N>,
    step: u32,
    window: Window,
    /// Sums over one half block.
    normal: Normal,
}

/// `c0 c1 s0 s1 c2 c3 s2 s3 ..`, aligned for double-word loads.
#[derive(Clone, Debug)]
#[repr(C, align(8))]
struct Table<const N: usize>([i16; N]);

/// The normal equations of one half block, in units of [`Reference::scale`] squared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Normal {
    /// `sum C c`.
    pub cos_cos: i64,
    /// `sum C s`, which is `sum S c`.
    pub cos_sin: i64,
    /// `sum S s`.
    pub sin_sin: i64,
    /// `sum C^2`: the effect of white noise on the cosine product.
    pub cos_energy: i64,
    /// `sum S^2`.
    pub sin_energy: i64,
}

/// Products of one channel with the reference, by half block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Products {
    /// First half with the cosine.
    pub first_cos: i32,
    /// First half with the sine of the time *before* the middle: the negative of the sine.
    pub first_sin: i32,
    /// Second half with the cosine.
    pub second_cos: i32,
    /// Second half with the sine.
    pub second_sin: i32,
}

impl<const N: usize> Default for Reference<N> {
    fn default() -> Self {
        Self { table: Table([0; N]), step: 0, window: Window::Flat, normal: Normal::default() }
    }
}

impl<const N: usize> Reference<N> {
    /// Amplitude one in the table. `sum |C| <= N/2 scale` because a projection shortens, so the products of 12-bit
    /// samples stay below `2^11 N/2 scale <= 2^31`; from N = 256 on the bound is reached only with `|c| = 1`
    /// throughout.
    const SHIFT: u32 = {
        let bits = 21 - N.trailing_zeros();
        30 - if bits > 14 { 14 } else { bits }
    };

    /// Amplitude one in the table.
    #[must_use]
    pub const fn scale(&self) -> i32 {
        ONE >> Self::SHIFT
    }

    /// The frequency of the table.
    #[must_use]
    pub const fn step(&self) -> u32 {
        self.step
    }

    /// The weights in the table.
    #[must_use]
    pub const fn window(&self) -> Window {
        self.window
    }

    /// The normal equations of half a block.
    #[must_use]
    pub const fn normal(&self) -> &Normal {
        &self.normal
    }

    /// Makes the table for a frequency.
    pub fn tune(&mut self, step: u32, window: Window) {
        self.step = step;
        self.window = window;
        match window {
            Window::Flat => self.fill::<false>(),
            Window::Hann => self.fill::<true>(),
        }
    }

    fn fill<const HANN: bool>(&mut self) {
        let bin = ((1_u64 << 32) / N as u64) as u32;
        let (mean_c, mean_s) = if HANN {
            // Hann's weights are a constant and two lines one bin away.
            let means = [self.step, self.step.wrapping_add(bin), self.step.wrapping_sub(bin)].map(half_block_mean::<N>);
            let mean = |[middle, above, below]: [i32; 3]| middle + (above >> 1) + (below >> 1);
            (mean(means.map(|mean| mean.0)), mean(means.map(|mean| mean.1)))
        } else {
            half_block_mean::<N>(self.step)
        };
        let mut oscillator = Oscillator::new(self.step / 2, self.step);
        let mut bell = Oscillator::new(bin / 2, bin);
        let mut normal = Normal::default();
        let round = 1 << (Self::SHIFT - 1);
        // The rounding error of one entry is added to the next, so that the sums stay zero to one unit.
        let (mut rest_c, mut rest_s) = (round, round);
        let entry = |value: i32, rest: &mut i32| {
            let exact = value + *rest;
            *rest = exact & ((1 << Self::SHIFT) - 1);
            exact >> Self::SHIFT
        };
        for quad in self.table.0.as_chunks_mut::<4>().0 {
            for k in 0..2 {
                let (c, s) = oscillator.turn();
                let (mut table_c, mut table_s) = (c - mean_c, s - mean_s);
                if HANN {
                    let h = ONE / 2 + (bell.turn().0 >> 1);
                    let weighted = |value: i32| ((i64::from(h) * i64::from(value)) >> 30) as i32;
                    (table_c, table_s) = (weighted(table_c), weighted(table_s));
                }
                let (table_c, table_s) = (entry(table_c, &mut rest_c), entry(table_s, &mut rest_s));
                if HANN {
                    let (c, s) = ((c + round) >> Self::SHIFT, (s + round) >> Self::SHIFT);
                    normal.cos_cos += i64::from(table_c * c);
                    normal.cos_sin += i64::from(table_c * s);
                    normal.sin_sin += i64::from(table_s * s);
                }
                quad[k] = table_c as i16;
                quad[k + 2] = table_s as i16;
            }
        }
        let [cos_energy, cos_sin, sin_energy] = active::table_energies(&self.table.0);
        if !HANN {
            // A projection is orthogonal to its remainder, so the products with the reference are these: to 2e-4, and
            // far better except where few different entries repeat, at an eighth of the sample rate and the like.
            normal = Normal { cos_cos: cos_energy, cos_sin, sin_sin: sin_energy, ..normal };
        }
        (normal.cos_energy, normal.sin_energy) = (cos_energy, sin_energy);
        self.normal = normal;
    }

    /// The products of all channels with the reference. Exact for 12-bit samples.
    #[must_use]
    pub fn products(&self, codes: &[[i16; N]; CHANNELS]) -> [Products; CHANNELS] {
        codes.each_ref().map(|row| {
            let [first_cos, first_sin, second_cos, second_sin] = active::lock_in(row, &self.table.0);
            Products { first_cos, first_sin, second_cos, second_sin }
        })
    }
}

/// Means of cosine and sine over half a block from its middle, in Q30: with `M = N / 2`,
/// `sum_k cos((k + 1/2) w) = sin(M w) / (2 sin(w / 2))`, `sum_k sin((k + 1/2) w) = (1 - cos(M w)) / (2 sin(w / 2))`.
fn half_block_mean<const N: usize>(step: u32) -> (i32, i32) {
    let (cosine, sine) = cos_sin(step.wrapping_mul(N as u32 / 2));
    let (_, half_angle) = cos_sin(step / 2);
    let divisor = i64::from(half_angle) * N as i64;
    let ratio = |value: i64| (value << 30).checked_div(divisor).unwrap_or(0) as i32;
    (ratio(i64::from(sine)), ratio(i64::from(ONE) - i64::from(cosine)))
}

#[cfg(test)]
#[expect(clippy::float_arithmetic, reason = "the oracle is f64")]
mod tests {
    use super::*;
    use std::f64::consts::TAU;
    use std::vec::Vec;

    fn entries<const N: usize>(reference: &Reference<N>) -> Vec<(f64, f64)> {
        let pairs = reference.table.0.as_chunks::<4>().0.iter();
        pairs
            .flat_map(|[c0, c1, s0, s1]| [(f64::from(*c0), f64::from(*s0)), (f64::from(*c1), f64::from(*s1))])
            .collect()
    }

    fn check<const N: usize>(window: Window) {
        let mut reference = Reference::<N>::default();
        for bins in [1.5, 2.0, 4.37, N as f64 / 8.0, N as f64 / 3.1, N as f64 / 2.0 - 1.5] {
            let step = (bins / N as f64 * 4_294_967_296.0) as u32;
            reference.tune(step, window);
            let scale = f64::from(reference.scale());
            let angle = |k: usize| TAU * f64::from(step) / 4_294_967_296.0 * (k as f64 + 0.5);
            let weight = |k: usize| match window {
                Window::Flat => 1.0,
                Window::Hann => 0.5 + 0.5 * (TAU / N as f64 * (k as f64 + 0.5)).cos(),
            };
            let weights: f64 = (0..N / 2).map(weight).sum();
            let mean = |f: fn(f64) -> f64| (0..N / 2).map(|k| weight(k) * f(angle(k))).sum::<f64>() / weights;
            let (mean_c, mean_s) = (mean(f64::cos), mean(f64::sin));
            let mut normal = [0.0; 5];
            let mut magnitude = [0.0; 2];
            for (k, (c, s)) in entries(&reference).into_iter().enumerate() {
                let exact_c = weight(k) * (angle(k).cos() - mean_c) * scale;
                let exact_s = weight(k) * (angle(k).sin() - mean_s) * scale;
                // Rounding carries over at most half a unit.
                assert!((c - exact_c).abs() < 1.1 && (s - exact_s).abs() < 1.1, "N {N} bins {bins} k {k}");
                let (cosine, sine) = (scale * angle(k).cos(), scale * angle(k).sin());
                for (sum, term) in normal.iter_mut().zip([c * cosine, c * sine, s * sine, c * c, s * s]) {
                    *sum += term;
                }
                magnitude = [magnitude[0] + c.abs(), magnitude[1] + s.abs()];
            }
            let ours = reference.normal();
            let ours =
                [ours.cos_cos, ours.cos_sin, ours.sin_sin, ours.cos_energy, ours.sin_energy].map(|sum| sum as f64);
            for (ours, truth) in ours.iter().zip(normal) {
                assert!((ours - truth).abs() < 2e-4 * normal[0].max(normal[2]), "N {N} bins {bins}: {ours} {truth}");
            }
            // No constant gets through: 0.001 ADC units of a third of full scale.
            let sums = entries(&reference).into_iter().fold((0.0, 0.0), |sums, (c, s)| (sums.0 + c, sums.1 + s));
            assert!(f64::abs(sums.0) <= 1.0 && f64::abs(sums.1) <= 1.0, "N {N} bins {bins}: {sums:?}");
            // Nor is there an overflow, whatever the samples.
            assert!(2048.0 * magnitude[0].max(magnitude[1]) < 2_147_483_648.0);
        }
    }

    #[test]
    fn the_table_is_the_reference_without_its_mean() {
        for window in [Window::Flat, Window::Hann] {
            check::<64>(window);
            check::<128>(window);
            check::<256>(window);
            check::<512>(window);
            check::<1024>(window);
        }
    }

    #[test]
    fn products_of_full_scale_square_waves_do_not_overflow() {
        let mut reference = Reference::<1024>::default();
        let step = 37 << 22;
        reference.tune(step, Window::Flat);
        let mut codes = [[0; 1024]; CHANNELS];
        for (n, code) in codes[0].iter_mut().enumerate() {
            let angle = TAU * 37.0 / 1024.0 * (n as f64 - 511.5);
            *code = if angle.cos() > 0.0 { 2047 } else { -2048 };
        }
        let [square, ..] = reference.products(&codes);
        // 4/pi of the amplitude, half the samples: N/4 scale 4/pi.
        let expected = 2047.5 * 4.0 / std::f64::consts::PI * 256.0 * f64::from(reference.scale());
        for sum in [square.first_cos, square.second_cos] {
            assert!((f64::from(sum) / expected - 1.0).abs() < 0.01, "{sum} {expected}");
        }
    }
}
