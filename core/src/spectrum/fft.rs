//! The packed transform of two real channels: radix 4, decimation in time, block floating point.
//!
//! With `z = a + j b` and `Z` its transform, `A[k] = (Z[k] + conj Z[N-k]) / 2` and `B[k] = (Z[k] - conj Z[N-k]) / 2j`.
//!
//! Overflow is excluded by magnitudes, not components. The first stage is exact: four 12-bit codes, shifted left as far
//! as the largest of them allows, and their mean taken off, stay within 2^14, so magnitudes within `R = 2^14 sqrt 2`.
//! A stage that shifts by two keeps the bound (four terms, each a quarter); a stage that shifts by one doubles it and is
//! only taken when all components are below 2^13. Rounding adds at most 2 a stage, and `R` is far below 2^15.

#![deny(clippy::float_arithmetic)]

use super::kernel::{
    add, add_halved, add_j, add_j_halved, dot, pack, pack_high, pack_low, pack_mixed, subtract, subtract_halved, subtract_j,
    subtract_j_halved, twiddled_halved,
};
use super::trig::cos_sin;

/// The compile-time tables for one length.
struct Plan<const N: usize>;

impl<const N: usize> Plan<N> {
    /// `w^j`, `w^2j`, `w^3j` and a pause for each `j` below `N / 4`, `w = e^{-j 2 pi / N}`, Q15.
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
    let exponent = transform(a, b, out);
    window_and_unpack(out);
    // Two halvings in the unpacking, squared.
    2 * exponent + 2
}

/// The transform of `a + j b` without their means; returns the exponent of the result.
fn transform<const N: usize>(a: &[i16; N], b: &[i16; N], out: &mut [u32; N]) -> i32 {
    let up = headroom(a, b);
    let odd = N.trailing_zeros() % 2 == 1;
    let mut exponent = -(up as i32);
    if odd {
        first_stage_of_two(a, b, up, out);
    } else {
        first_stage_of_four(a, b, up, out);
    }
    let mut large = 1 << 14;
    if odd {
        exponent += stage::<N, 2, 8>(out, &mut large);
        exponent += stage::<N, 8, 32>(out, &mut large);
        exponent += stage::<N, 32, 128>(out, &mut large);
        exponent += stage::<N, 128, 512>(out, &mut large);
    } else {
        exponent += stage::<N, 4, 16>(out, &mut large);
        exponent += stage::<N, 16, 64>(out, &mut large);
        exponent += stage::<N, 64, 256>(out, &mut large);
        exponent += stage::<N, 256, 1024>(out, &mut large);
    }
    exponent
}

/// How far left the codes can be shifted so that 11 bits beside the sign are used.
fn headroom<const N: usize>(a: &[i16; N], b: &[i16; N]) -> u32 {
    // The highest bit that differs from its lower neighbour: 2^h bounds the magnitude.
    let mut differing = 0;
    for [x0, x1] in a.as_chunks::<2>().0.iter().chain(b.as_chunks::<2>().0) {
        let word = pack(*x0, *x1);
        differing |= word ^ (word << 1);
    }
    let differing = (differing | differing >> 16) & 0xffff;
    (differing | 1).leading_zeros().saturating_sub(31 - 11)
}

/// What a sum of `terms` samples, shifted left by `up`, holds of the channel's mean.
fn mean_of<const N: usize>(row: &[i16; N], terms: i32, up: u32) -> i16 {
    let sum = row.as_chunks::<2>().0.iter().fold(0, |sum, [x0, x1]| dot(pack(*x0, *x1), 0x0001_0001, sum));
    let scaled = (i64::from(sum) * i64::from(terms)) << up;
    ((scaled + (N as i64) / 2) >> N.trailing_zeros()) as i16
}

/// Shifts both lanes left.
#[inline(always)]
fn shifted(word: u32, up: u32, mask: u32) -> u32 {
    (word << up) & mask
}

/// The lanes that survive a shift by `up`.
fn shift_mask(up: u32) -> u32 {
    let lane = (0xffff_u32 << up) & 0xffff;
    lane | lane << 16
}

fn first_stage_of_four<const N: usize>(a: &[i16; N], b: &[i16; N], up: u32, out: &mut [u32; N]) {
    let mean = pack(mean_of(a, 4, up), mean_of(b, 4, up));
    let mask = shift_mask(up);
    let blocks = out.as_chunks_mut::<4>().0;
    let bits = 34 - N.trailing_zeros();
    let quarters = |row: &'_ [i16; N], quarter: usize, n: usize| {
        let at = quarter * (N / 4) + 2 * n;
        shifted(pack(row[at], row[at + 1]), up, mask)
    };
    for n in 0..N / 8 {
        let x: [u32; 4] = [quarters(a, 0, n), quarters(a, 1, n), quarters(a, 2, n), quarters(a, 3, n)];
        let y: [u32; 4] = [quarters(b, 0, n), quarters(b, 1, n), quarters(b, 2, n), quarters(b, 3, n)];
        let at = ((2 * n as u32).reverse_bits() >> bits) as usize;
        blocks[at % (N / 4)] = butterfly_without_shift([
            pack_low(x[0], y[0]),
            pack_low(x[1], y[1]),
            pack_low(x[2], y[2]),
            pack_low(x[3], y[3]),
        ], mean);
        blocks[(at + N / 8) % (N / 4)] = butterfly_without_shift([
            pack_high(x[0], y[0]),
            pack_high(x[1], y[1]),
            pack_high(x[2], y[2]),
            pack_high(x[3], y[3]),
        ], mean);
    }
}

#[inline(always)]
fn butterfly_without_shift([x0, x1, x2, x3]: [u32; 4], mean: u32) -> [u32; 4] {
    let (even, odd) = (add(x0, x2), add(x1, x3));
    let (even_difference, odd_difference) = (subtract(x0, x2), subtract(x1, x3));
    [
        subtract(add(even, odd), mean),
        subtract_j(even_difference, odd_difference),
        subtract(even, odd),
        add_j(even_difference, odd_difference),
    ]
}

fn first_stage_of_two<const N: usize>(a: &[i16; N], b: &[i16; N], up: u32, out: &mut [u32; N]) {
    let mean = pack(mean_of(a, 2, up), mean_of(b, 2, up));
    let mask = shift_mask(up);
    let bits = 33 - N.trailing_zeros();
    let blocks = out.as_chunks_mut::<2>().0;
    for n in 0..N / 2 {
        let early = shifted(pack(a[n], b[n]), up, mask);
        let late = shifted(pack(a[n + N / 2], b[n + N / 2]), up, mask);
        let at = ((n as u32).reverse_bits() >> bits) as usize;
        blocks[at % (N / 2)] = [subtract(add(early, late), mean), subtract(early, late)];
    }
}

/// One stage: blocks of four transforms of length `L` become transforms of length `LEN = 4 L`. Shifts by one when all
/// components are below 2^13 (`large`), else by two; returns the shift and renews `large`.
#[inline(always)]
fn stage<const N: usize, const L: usize, const LEN: usize>(data: &mut [u32; N], large: &mut u32) -> i32 {
    if LEN > N {
        return 0;
    }
    if *large >= 1 << 14 {
        *large = stage_shifting::<N, L, LEN, true>(data);
        2
    } else {
        *large = stage_shifting::<N, L, LEN, false>(data);
        1
    }
}

#[inline(never)]
fn stage_shifting<const N: usize, const L: usize, const LEN: usize, const BY_TWO: bool>(data: &mut [u32; N]) -> u32 {
    let blocks = data.as_chunks_mut::<LEN>().0;
    let mut differing = 0;
    let twiddles = Plan::<N>::TWIDDLES.as_chunks::<4>().0.iter().step_by(N / LEN);
    for (j, [w1, w2, w3, _]) in (0..L).zip(twiddles) {
        for block in blocks.iter_mut() {
            let x0 = add_halved(block[j], 0);
            let x2 = twiddled_halved(block[j + L], *w2);
            let x1 = twiddled_halved(block[j + 2 * L], *w1);
            let x3 = twiddled_halved(block[j + 3 * L], *w3);
            let (even, even_difference) = (add(x0, x2), subtract(x0, x2));
            let (odd, odd_difference) = (add(x1, x3), subtract(x1, x3));
            let out = if BY_TWO {
                [
                    add_halved(even, odd),
                    subtract_j_halved(even_difference, odd_difference),
                    subtract_halved(even, odd),
                    add_j_halved(even_difference, odd_difference),
                ]
            } else {
                [
                    add(even, odd),
                    subtract_j(even_difference, odd_difference),
                    subtract(even, odd),
                    add_j(even_difference, odd_difference),
                ]
            };
            if LEN < N {
                for word in out {
                    differing |= word ^ (word << 1);
                }
            }
            [block[j], block[j + L], block[j + 2 * L], block[j + 3 * L]] = out;
        }
    }
    // The highest bit h of a lane says that all components are within 2^h and some is at 2^(h-1) or beyond.
    (differing | differing >> 16) & 0xffff
}

/// Windows the transform and splits it into the powers of the two channels.
fn window_and_unpack<const N: usize>(data: &mut [u32; N]) {
    let (mut before, mut here) = (data[0], data[1]);
    let (mut mirror_before, mut mirror_here) = (data[0], data[N - 1]);
    for k in 1..N / 2 {
        let (after, mirror_after) = (data[k + 1], data[N - 1 - k]);
        let z = subtract_halved(here, add_halved(before, after));
        let mirror = subtract_halved(mirror_here, add_halved(mirror_before, mirror_after));
        let sum = add_halved(z, mirror);
        let difference = subtract_halved(z, mirror);
        // A = sum.re + j difference.im, B = sum.im - j difference.re
        let first = pack_mixed(sum, difference);
        let second = pack_mixed(difference, sum);
        data[k] = dot(first, first, 0) as u32;
        data[N - k] = dot(second, second, 0) as u32;
        (before, here) = (here, after);
        (mirror_before, mirror_here) = (mirror_here, mirror_after);
    }
}
