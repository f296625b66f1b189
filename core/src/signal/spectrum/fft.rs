//! The packed transform of two real channels: radix 4, decimation in time, block floating point.
//!
//! With `z = a + j b` and `Z` its transform, `A[k] = (Z[k] + conj Z[N-k]) / 2` and `B[k] = (Z[k] - conj Z[N-k]) / 2j`.
//!
//! Overflow is excluded by magnitudes, not components. The first stage is exact: four 12-bit samples, shifted left as
//! far as the largest of them allows, with their mean subtracted, stay within 2^14, so magnitudes within `R = 2^14
//! sqrt 2`. A stage that shifts by two keeps the bound (four terms, each a quarter); a stage that shifts by one
//! doubles it and is only used when all components are below 2^13. Rounding adds at most 2 a stage, and `R` is far
//! below 2^15.

#![deny(clippy::float_arithmetic)]

use super::trig::cos_sin;
use crate::base::math::active::{
    self, add, first_butterfly, pack, pack_high, pack_low, powers, subtract, sum_and_reach,
};

/// The compile-time tables for one length.
struct Plan<const N: usize>;

impl<const N: usize> Plan<N> {
    /// `w^j`, `w^2j`, `w^3j` and padding for each `j` below `N / 4`, `w = e^{-j 2 pi / N}`, Q15.
    const TWIDDLES: [u32; N] = {
        let mut table = [0; N];
        let mut j = 0;
        while j < N / 4 {
            let mut power = 1;
            while power <= 3 {
                let phase = ((j * power) as u32).wrapping_mul(((1_u64 << 32) / N as u64) as u32);
                let (cosine, sine) = cos_sin(phase.wrapping_neg());
                table[4 * j + power - 1] = pack(q15(cosine), q15(sine));
                power += 1;
            }
            j += 1;
        }
        table
    };
}

/// Q30 to Q15, rounded; one becomes the largest i16.
const fn q15(value: i32) -> i16 {
    let rounded = (value + (1 << 14)) >> 15;
    if rounded > i16::MAX as i32 { i16::MAX } else { rounded as i16 }
}

/// Replaces `out` by the powers of the windowed transforms of two channels: of `a` at `k`, of `b` at `N - k`, for
/// `k = 1..N/2`. Returns their exponent.
pub(super) fn pair_powers<const N: usize>(a: &[i16; N], b: &[i16; N], out: &mut [u32; N]) -> i32 {
    if let (Ok(a), Ok(b), Ok(out)) = (a.as_slice().try_into(), b.as_slice().try_into(), out.as_mut_slice().try_into()) {
        return pair_powers_256(a, b, out);
    }
    pair_powers_any(a, b, out)
}

/// The length of the flight computer, compiled with this crate (for speed) and not with the caller.
#[inline(never)]
fn pair_powers_256(a: &[i16; 256], b: &[i16; 256], out: &mut [u32; 256]) -> i32 {
    pair_powers_any(a, b, out)
}

fn pair_powers_any<const N: usize>(a: &[i16; N], b: &[i16; N], out: &mut [u32; N]) -> i32 {
    let exponent = transform(a, b, out);
    window_and_unpack(out);
    2 * exponent
}

/// The transform of `a + j b` without their means; returns the exponent of the result.
fn transform<const N: usize>(a: &[i16; N], b: &[i16; N], out: &mut [u32; N]) -> i32 {
    let ((sum_a, reach_a), (sum_b, reach_b)) = (sum_and_reach(a), sum_and_reach(b));
    // The free bits to the left of 11 bits and the sign.
    let up = (reach_a | reach_b).leading_zeros().saturating_sub(31 - 11);
    let mut exponent = -(up as i32);
    let mut reach = 1 << 14;
    if N.trailing_zeros() % 2 == 1 {
        first_stage_of_two(a, b, [sum_a, sum_b], up, out);
        exponent += stage::<N, 2, 8>(out, &mut reach);
        exponent += stage::<N, 8, 32>(out, &mut reach);
        exponent += stage::<N, 32, 128>(out, &mut reach);
        exponent += stage::<N, 128, 512>(out, &mut reach);
    } else {
        first_stage_of_four(a, b, [sum_a, sum_b], up, out);
        exponent += stage::<N, 4, 16>(out, &mut reach);
        exponent += stage::<N, 16, 64>(out, &mut reach);
        exponent += stage::<N, 64, 256>(out, &mut reach);
        exponent += stage::<N, 256, 1024>(out, &mut reach);
    }
    exponent
}

/// The channel's mean in the sum of `terms` samples, shifted left by `up`; in both lanes.
fn share_of_mean<const N: usize>(sum: i32, terms: i32, up: u32) -> u32 {
    let mean = (((sum * terms) << up) + (N as i32) / 2) >> N.trailing_zeros();
    pack(mean as i16, mean as i16)
}

/// The bits of both lanes that a shift by `up` keeps inside its lane.
fn shift_mask(up: u32) -> u32 {
    let lane = (0xffff_u32 << up) & 0xffff;
    lane | lane << 16
}

/// Two butterflies of neighbouring samples at a time, one in each lane, channel by channel: sums and differences do not
/// mix real and imaginary parts until the end.
#[inline(never)]
fn first_stage_of_four<const N: usize>(a: &[i16; N], b: &[i16; N], sums: [i32; 2], up: u32, out: &mut [u32; N]) {
    let means = sums.map(|sum| share_of_mean::<N>(sum, 4, up));
    let mask = shift_mask(up);
    let (a, b) = (a.as_chunks::<2>().0, b.as_chunks::<2>().0);
    let blocks = out.as_chunks_mut::<4>().0;
    for n in 0..N / 8 {
        let column = |row: &[[i16; 2]]| [0, N / 8, N / 4, 3 * N / 8].map(|quarter| word(row[n + quarter]));
        let [a0, a2, a_even, a_odd] = first_butterfly(column(a), up, mask, means[0]);
        let [b0, b2, b_even, b_odd] = first_butterfly(column(b), up, mask, means[1]);
        let at = ((2 * n as u32).reverse_bits() >> (34 - N.trailing_zeros())) as usize % (N / 8);
        // Bins 1 and 3: even -+ j odd.
        let (re1, im1) = (add(a_even, b_odd), subtract(b_even, a_odd));
        let (re3, im3) = (subtract(a_even, b_odd), add(b_even, a_odd));
        blocks[at] = [pack_low(a0, b0), pack_low(re1, im1), pack_low(a2, b2), pack_low(re3, im3)];
        blocks[at + N / 8] = [pack_high(a0, b0), pack_high(re1, im1), pack_high(a2, b2), pack_high(re3, im3)];
    }
}

fn first_stage_of_two<const N: usize>(a: &[i16; N], b: &[i16; N], sums: [i32; 2], up: u32, out: &mut [u32; N]) {
    let means = sums.map(|sum| share_of_mean::<N>(sum, 2, up));
    let mask = shift_mask(up);
    let (a, b) = (a.as_chunks::<2>().0, b.as_chunks::<2>().0);
    let blocks = out.as_chunks_mut::<2>().0;
    for n in 0..N / 4 {
        let butterfly = |row: &[[i16; 2]], mean: u32| {
            let [early, late] = [0, N / 4].map(|half| (word(row[n + half]) << up) & mask);
            [subtract(add(early, late), mean), subtract(early, late)]
        };
        let [a0, a1] = butterfly(a, means[0]);
        let [b0, b1] = butterfly(b, means[1]);
        let at = ((2 * n as u32).reverse_bits() >> (33 - N.trailing_zeros())) as usize % (N / 4);
        blocks[at] = [pack_low(a0, b0), pack_low(a1, b1)];
        blocks[at + N / 4] = [pack_high(a0, b0), pack_high(a1, b1)];
    }
}

/// Two neighbouring samples.
#[inline(always)]
fn word([first, second]: [i16; 2]) -> u32 {
    pack(first, second)
}

/// One stage: blocks of four transforms of length `L` become transforms of length `LEN = 4 L`. Shifts by one when all
/// components are within 2^13, else by two; returns the shift and renews the reach.
#[inline(always)]
fn stage<const N: usize, const L: usize, const LEN: usize>(data: &mut [u32; N], reach: &mut u32) -> i32 {
    if LEN > N {
        return 0;
    }
    if *reach >= 1 << 14 {
        *reach = active::stage::<N, L, LEN, true>(data, &Plan::<N>::TWIDDLES);
        2
    } else {
        *reach = active::stage::<N, L, LEN, false>(data, &Plan::<N>::TWIDDLES);
        1
    }
}

/// Windows the transform and splits it into the powers of the two channels.
#[inline(never)]
fn window_and_unpack<const N: usize>(data: &mut [u32; N]) {
    let (mut before, mut here) = (data[0], data[1]);
    let (mut mirror_before, mut mirror_here) = (data[0], data[N - 1]);
    let mut k = 1;
    // Two bins per iteration, so that no values are moved between registers.
    while k < N / 2 - 1 {
        let (after, mirror_after) = (data[k + 1], data[N - 1 - k]);
        [data[k], data[N - k]] = powers([before, here, after], [mirror_before, mirror_here, mirror_after]);
        (before, mirror_before) = (data[k + 2], data[N - 2 - k]);
        [data[k + 1], data[N - 1 - k]] = powers([here, after, before], [mirror_here, mirror_after, mirror_before]);
        (here, before) = (before, after);
        (mirror_here, mirror_before) = (mirror_before, mirror_after);
        k += 2;
    }
    [data[N / 2 - 1], data[N / 2 + 1]] = powers([before, here, data[N / 2]], [mirror_before, mirror_here, data[N / 2]]);
}
