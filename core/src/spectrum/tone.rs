//! The lock-in: products with a cosine and a sine at one frequency, exact in integers.
//!
//! The time origin is the middle of the block, so sample `N/2 + k` and sample `N/2 - 1 - k` share the reference
//! `c_k = cos((k + 1/2) w)`, `s_k = +- sin((k + 1/2) w)`, and half a table serves.
//!
//! The mean of each half block must not leak into the products. Instead of measuring it and solving for it, the table
//! holds what is left of the reference after its projection on a constant: with weights `h_k` (all one, or Hann's),
//! `C_k = h_k (c_k - c~)`, `c~ = sum h c / sum h`, and `S_k` alike. The products with `C`, `S` are then those of the
//! least-squares fit of cosine, sine and a constant (the theorem of Frisch and Waugh), for nothing at run time.
//!
//! Frequencies are phase steps a sample, 2^32 a turn.

#![deny(clippy::float_arithmetic)]

use super::kernel;
use super::trig::{ONE, Oscillator};
use crate::adc::CHANNELS;

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
    /// `sum C^2`: what white noise makes of the cosine product.
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
    /// Amplitude one in the table. `sum |C| <= N/2 scale` because a projection shortens, so the products of 12-bit codes
    /// stay below `2^11 N/2 scale <= 2^31`; from N = 256 on the bound is met with equality only by `|c| = 1` throughout.
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
        let tone = Oscillator::new(self.step / 2, self.step);
        let bin = ((1_u64 << 32) / N as u64) as u32;
        let bell = Oscillator::new(bin / 2, bin);
        let weight = |bell: &mut Oscillator| if HANN { ONE / 2 + (bell.turn().0 >> 1) } else { ONE };
        let weighted = |h: i32, value: i32| if HANN { ((i64::from(h) * i64::from(value)) >> 30) as i32 } else { value };

        let (mut oscillator, mut window) = (tone, bell);
        let (mut sum_c, mut sum_s) = (0_i64, 0_i64);
        for _ in 0..N / 2 {
            let h = weight(&mut window);
            let (c, s) = oscillator.turn();
            sum_c += i64::from(weighted(h, c));
            sum_s += i64::from(weighted(h, s));
        }
        // The sum of the weights is N/2 or N/4 but for the last bit.
        let mean = |sum: i64| if HANN { (sum / (N as i64 / 4)) as i32 } else { (sum / (N as i64 / 2)) as i32 };
        let (mean_c, mean_s) = (mean(sum_c), mean(sum_s));

        let (mut oscillator, mut window) = (tone, bell);
        let mut normal = Normal::default();
        // What rounding one entry leaves goes to the next, so that the sums stay zero to one unit.
        let (mut rest_c, mut rest_s) = (0, 0);
        let entry = |value: i32, rest: &mut i32| {
            let exact = value + *rest;
            let rounded = (exact + (1 << (Self::SHIFT - 1))) >> Self::SHIFT;
            *rest = exact - (rounded << Self::SHIFT);
            rounded as i16
        };
        for pair in self.table.0.as_chunks_mut::<4>().0 {
            for k in 0..2 {
                let h = weight(&mut window);
                let (c, s) = oscillator.turn();
                let table_c = entry(weighted(h, c - mean_c), &mut rest_c);
                let table_s = entry(weighted(h, s - mean_s), &mut rest_s);
                let round = 1 << (Self::SHIFT - 1);
                let (c, s) = ((c + round) >> Self::SHIFT, (s + round) >> Self::SHIFT);
                normal.cos_cos += i64::from(i32::from(table_c) * c);
                normal.cos_sin += i64::from(i32::from(table_c) * s);
                normal.sin_sin += i64::from(i32::from(table_s) * s);
                if HANN {
                    normal.cos_energy += i64::from(i32::from(table_c) * i32::from(table_c));
                    normal.sin_energy += i64::from(i32::from(table_s) * i32::from(table_s));
                }
                pair[k] = table_c;
                pair[k + 2] = table_s;
            }
        }
        if !HANN {
            // A projection: the same sums.
            normal.cos_energy = normal.cos_cos;
            normal.sin_energy = normal.sin_sin;
        }
        self.normal = normal;
    }

    /// The products of all channels with the reference. Exact for 12-bit codes.
    #[must_use]
    pub fn products(&self, codes: &[[i16; N]; CHANNELS]) -> [Products; CHANNELS] {
        codes.each_ref().map(|row| {
            let [first_cos, first_sin, second_cos, second_sin] = kernel::lock_in(row, &self.table.0);
            Products { first_cos, first_sin, second_cos, second_sin }
        })
    }
}
