//! The inner loops in plain Rust: what runs everywhere but on the target, and what the target's must agree with.
//!
//! A word holds two i16 lanes, the lower one first in memory; of a complex number the lower lane is the real part. The
//! small functions are the target's dual 16-bit instructions, named in their docs, and wrap like them.

#![deny(clippy::float_arithmetic)]

use crate::adc::{CODE_MAX, CODE_MIN};

/// The lower lane.
#[inline(always)]
#[must_use]
pub const fn low(word: u32) -> i16 {
    word as i16
}

/// The upper lane.
#[inline(always)]
#[must_use]
pub const fn high(word: u32) -> i16 {
    (word >> 16) as i16
}

/// Two lanes as one word.
#[inline(always)]
#[must_use]
pub const fn pack(low: i16, high: i16) -> u32 {
    low as u16 as u32 | (high as u16 as u32) << 16
}

#[inline(always)]
fn halved(sum: i32) -> i16 {
    (sum >> 1) as i16
}

/// `a + b` (`SADD16`).
#[inline(always)]
#[must_use]
pub fn add(a: u32, b: u32) -> u32 {
    pack(low(a).wrapping_add(low(b)), high(a).wrapping_add(high(b)))
}

/// `a - b` (`SSUB16`).
#[inline(always)]
#[must_use]
pub fn subtract(a: u32, b: u32) -> u32 {
    pack(low(a).wrapping_sub(low(b)), high(a).wrapping_sub(high(b)))
}

/// `(a + b) / 2`, rounded down (`SHADD16`).
#[inline(always)]
#[must_use]
pub fn add_halved(a: u32, b: u32) -> u32 {
    pack(halved(i32::from(low(a)) + i32::from(low(b))), halved(i32::from(high(a)) + i32::from(high(b))))
}

/// `(a - b) / 2`, rounded down (`SHSUB16`).
#[inline(always)]
#[must_use]
pub fn subtract_halved(a: u32, b: u32) -> u32 {
    pack(halved(i32::from(low(a)) - i32::from(low(b))), halved(i32::from(high(a)) - i32::from(high(b))))
}

/// `a + j b` (`SASX`).
#[inline(always)]
#[must_use]
pub fn add_j(a: u32, b: u32) -> u32 {
    pack(low(a).wrapping_sub(high(b)), high(a).wrapping_add(low(b)))
}

/// `a - j b` (`SSAX`).
#[inline(always)]
#[must_use]
pub fn subtract_j(a: u32, b: u32) -> u32 {
    pack(low(a).wrapping_add(high(b)), high(a).wrapping_sub(low(b)))
}

/// `(a + j b) / 2`, rounded down (`SHASX`).
#[inline(always)]
#[must_use]
pub fn add_j_halved(a: u32, b: u32) -> u32 {
    pack(halved(i32::from(low(a)) - i32::from(high(b))), halved(i32::from(high(a)) + i32::from(low(b))))
}

/// `(a - j b) / 2`, rounded down (`SHSAX`).
#[inline(always)]
#[must_use]
pub fn subtract_j_halved(a: u32, b: u32) -> u32 {
    pack(halved(i32::from(low(a)) + i32::from(high(b))), halved(i32::from(high(a)) - i32::from(low(b))))
}

/// Both lower lanes (`PKHBT`).
#[inline(always)]
#[must_use]
pub fn pack_low(first: u32, second: u32) -> u32 {
    pack(low(first), low(second))
}

/// Both upper lanes (`PKHTB`).
#[inline(always)]
#[must_use]
pub fn pack_high(first: u32, second: u32) -> u32 {
    pack(high(first), high(second))
}

/// The lower lane of one and the upper lane of another (`PKHBT` without a shift).
#[inline(always)]
#[must_use]
pub fn pack_mixed(lower: u32, upper: u32) -> u32 {
    (lower & 0xffff) | (upper & 0xffff_0000)
}

/// `sum + a.low b.low + a.high b.high` (`SMLAD`).
#[inline(always)]
#[must_use]
pub fn dot(a: u32, b: u32, sum: i32) -> i32 {
    sum.wrapping_add(i32::from(low(a)) * i32::from(low(b))).wrapping_add(i32::from(high(a)) * i32::from(high(b)))
}

/// `sum + a.low b.high + a.high b.low` (`SMLADX`).
#[inline(always)]
#[must_use]
pub fn dot_crossed(a: u32, b: u32, sum: i32) -> i32 {
    sum.wrapping_add(i32::from(low(a)) * i32::from(high(b))).wrapping_add(i32::from(high(a)) * i32::from(low(b)))
}

/// Half the complex product of a Q15 twiddle and `x`, rounded (`SMLSD`, `SMLADX`, `PKHTB`).
#[inline(always)]
#[must_use]
pub fn twiddled_halved(x: u32, twiddle: u32) -> u32 {
    let re = 0x8000_i32
        .wrapping_add(i32::from(low(x)) * i32::from(low(twiddle)))
        .wrapping_sub(i32::from(high(x)) * i32::from(high(twiddle)));
    let im = dot_crossed(x, twiddle, 0x8000);
    pack((re >> 16) as i16, (im >> 16) as i16)
}

/// Sums over one channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moments {
    /// Sum of the codes.
    pub sum: i32,
    /// Sum of the squared codes.
    pub energy: i64,
    /// Samples at a rail.
    pub clipped: u32,
}

/// Sum, energy and clipped samples of one channel.
#[must_use]
pub fn moments(row: &[i16]) -> Moments {
    let mut moments = Moments::default();
    for code in row {
        moments.sum += i32::from(*code);
        moments.energy += i64::from(i32::from(*code) * i32::from(*code));
        moments.clipped += u32::from(*code <= CODE_MIN || *code >= CODE_MAX);
    }
    moments
}

/// Products of the two halves of a block with a reference table: cosine and sine of the first half, of the second.
///
/// The table holds `c0 c1 s0 s1 c2 c3 s2 s3 ..` from the middle outwards, so the first half runs backwards. Exact as
/// long as the table's sum of magnitudes times 2^11 is below 2^31.
#[must_use]
pub fn lock_in<const N: usize>(row: &[i16; N], table: &[i16; N]) -> [i32; 4] {
    let (first, second) = row.split_at(N / 2);
    let mut sums = [0_i32; 4];
    let table = table.as_chunks::<4>().0.iter();
    let second = second.as_chunks::<2>().0.iter();
    let first = first.as_chunks::<2>().0.iter().rev();
    for (([c0, c1, s0, s1], [b0, b1]), [f1, f0]) in table.zip(second).zip(first) {
        let (cosines, sines) = (pack(*c0, *c1), pack(*s0, *s1));
        let (forward, backward) = (pack(*b0, *b1), pack(*f1, *f0));
        sums[0] = dot_crossed(backward, cosines, sums[0]);
        sums[1] = dot_crossed(backward, sines, sums[1]);
        sums[2] = dot(forward, cosines, sums[2]);
        sums[3] = dot(forward, sines, sums[3]);
    }
    sums
}
