//! The inner loops in plain Rust: used everywhere but on the target, whose functions must give the same bits.
//!
//! A word holds two i16 lanes, the lower one first in memory; of a complex number the lower lane is the real part.
//! The small functions are the target's dual 16-bit instructions, named in their docs, and wrap like them; the others
//! are the loops that take most of the time of the transform and the lock-in.

#![deny(clippy::float_arithmetic)]

use crate::base::adc::CODE_MIN;

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

/// The square root (`VSQRT.F32`).
#[inline(always)]
#[must_use]
pub fn sqrt(value: f32) -> f32 {
    libm::sqrtf(value)
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
fn add_halved(a: u32, b: u32) -> u32 {
    pack(halved(i32::from(low(a)) + i32::from(low(b))), halved(i32::from(high(a)) + i32::from(high(b))))
}

/// `(a - b) / 2`, rounded down (`SHSUB16`).
#[inline(always)]
fn subtract_halved(a: u32, b: u32) -> u32 {
    pack(halved(i32::from(low(a)) - i32::from(low(b))), halved(i32::from(high(a)) - i32::from(high(b))))
}

/// `a + j b` (`SASX`).
#[inline(always)]
fn add_j(a: u32, b: u32) -> u32 {
    pack(low(a).wrapping_sub(high(b)), high(a).wrapping_add(low(b)))
}

/// `a - j b` (`SSAX`).
#[inline(always)]
fn subtract_j(a: u32, b: u32) -> u32 {
    pack(low(a).wrapping_add(high(b)), high(a).wrapping_sub(low(b)))
}

/// `(a + j b) / 2`, rounded down (`SHASX`).
#[inline(always)]
fn add_j_halved(a: u32, b: u32) -> u32 {
    pack(halved(i32::from(low(a)) - i32::from(high(b))), halved(i32::from(high(a)) + i32::from(low(b))))
}

/// `(a - j b) / 2`, rounded down (`SHSAX`).
#[inline(always)]
fn subtract_j_halved(a: u32, b: u32) -> u32 {
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

#[inline(always)]
fn dot(a: u32, b: u32, sum: i32) -> i32 {
    sum.wrapping_add(i32::from(low(a)) * i32::from(low(b))).wrapping_add(i32::from(high(a)) * i32::from(high(b)))
}

#[inline(always)]
fn dot_crossed(a: u32, b: u32, sum: i32) -> i32 {
    dot(a, b.rotate_left(16), sum)
}

/// Half the complex product of a Q15 twiddle and `x`, rounded.
#[inline(always)]
fn twiddled_halved(x: u32, twiddle: u32) -> u32 {
    let re = 0x8000_i32
        .wrapping_add(i32::from(low(x)) * i32::from(low(twiddle)))
        .wrapping_sub(i32::from(high(x)) * i32::from(high(twiddle)));
    let im = dot_crossed(x, twiddle, 0x8000);
    pack((re >> 16) as i16, (im >> 16) as i16)
}

/// The first butterfly of two neighbouring samples of one channel, one in each lane: from four samples a quarter of the
/// block apart, shifted left, `[x0+x1+x2+x3 - mean, x0-x1+x2-x3, x0-x2, x1-x3]`.
///
/// `mask` clears what a shift by `up` carries from lane to lane.
#[inline(always)]
#[must_use]
pub fn first_butterfly(x: [u32; 4], up: u32, mask: u32, mean: u32) -> [u32; 4] {
    let [x0, x1, x2, x3] = x.map(|x| (x << (up % 16)) & mask);
    let (even, odd) = (add(x0, x2), add(x1, x3));
    [subtract(add(even, odd), mean), subtract(even, odd), subtract(x0, x2), subtract(x1, x3)]
}

/// One stage: blocks of four transforms of length `L` become transforms of length `LEN = 4 L`, over two or (`BY_TWO`) over
/// four. `twiddles` is a table for `N`: `w^j w^2j w^3j` and a pause. Returns the reach, or 0 after the last stage.
pub fn stage<const N: usize, const L: usize, const LEN: usize, const BY_TWO: bool>(
    data: &mut [u32; N],
    twiddles: &[u32; N],
) -> u32 {
    let blocks = data.as_chunks_mut::<LEN>().0;
    let twiddles = twiddles.as_chunks::<4>().0;
    let mut reach = 0;
    for j in 0..L {
        let [w1, w2, w3, _] = twiddles[j * (N / LEN)];
        for block in blocks.iter_mut() {
            let x0 = add_halved(block[j], 0);
            // In the order of bit reversal: the second quarter holds every fourth sample from the third on.
            let x2 = twiddled_halved(block[j + L], w2);
            let x1 = twiddled_halved(block[j + 2 * L], w1);
            let x3 = twiddled_halved(block[j + 3 * L], w3);
            let (even, even_difference) = (add(x0, x2), subtract(x0, x2));
            let (odd, odd_difference) = (add(x1, x3), subtract(x1, x3));
            let bins = if BY_TWO {
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
                for word in bins {
                    reach |= word ^ (word << 1);
                }
            }
            [block[j], block[j + L], block[j + 2 * L], block[j + 3 * L]] = bins;
        }
    }
    (reach | reach >> 16) & 0xffff
}

/// Powers of both channels at one bin, from three neighbours of the packed transform and their mirror images.
#[inline(always)]
#[must_use]
pub fn powers([before, here, after]: [u32; 3], [mirror_before, mirror_here, mirror_after]: [u32; 3]) -> [u32; 2] {
    let z = subtract_halved(here, add_halved(before, after));
    let mirror = subtract_halved(mirror_here, add_halved(mirror_before, mirror_after));
    let (sum, difference) = (add_halved(z, mirror), subtract_halved(z, mirror));
    // A = sum.re + j difference.im, B = sum.im - j difference.re
    [pack(low(sum), high(difference)), pack(low(difference), high(sum))].map(|x| dot(x, x, 0) as u32)
}

/// Sums over a row of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moments {
    /// Sum of the samples.
    pub sum: i32,
    /// Sum of the squared samples.
    pub energy: i64,
    /// Samples at a rail.
    pub clipped: u32,
}

/// Sum, energy and clipped samples of 12-bit samples.
#[must_use]
pub fn moments(row: &[i16]) -> Moments {
    // The rails, -2048 and 2047, are the neighbours of zero once 2048 is added and only 12 bits are kept.
    const OFFSET: i16 = 1 - CODE_MIN;
    let mut moments = Moments::default();
    for code in row {
        moments.sum += i32::from(*code);
        moments.energy += i64::from(i32::from(*code) * i32::from(*code));
        moments.clipped += u32::from(code.wrapping_add(OFFSET) & 0x0ffe == 0);
    }
    moments
}

/// Sum of the samples, and a word whose highest set bit `h` means that all samples are within `2^h`: their reach.
#[must_use]
pub fn sum_and_reach(row: &[i16]) -> (i32, u32) {
    let (mut sum, mut differing) = (0, 0);
    for code in row {
        sum += i32::from(*code);
        // A bit that differs from its lower neighbour: above the magnitude there is none.
        differing |= (*code ^ (*code << 1)) as u16;
    }
    (sum, u32::from(differing) | 1)
}

/// Products of the two halves of a frame with a reference table: cosine and sine of the first half, of the second.
///
/// The table holds `c0 c1 s0 s1 c2 c3 s2 s3 ..` from the middle outwards, so the first half runs backwards. Exact as
/// long as the table's sum of magnitudes times 2^11 is below 2^31.
#[must_use]
pub fn lock_in(row: &[i16], table: &[i16]) -> [i32; 4] {
    let (first, second) = row.split_at(row.len() / 2);
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

/// Energies of a reference table: sums of squared cosines, of cosines times sines, of squared sines.
#[must_use]
pub fn table_energies(table: &[i16]) -> [i64; 3] {
    let mut sums = [0_i64; 3];
    for [c0, c1, s0, s1] in table.as_chunks::<4>().0 {
        for (cosine, sine) in [(*c0, *s0), (*c1, *s1)].map(|(c, s)| (i32::from(c), i32::from(s))) {
            sums[0] += i64::from(cosine * cosine);
            sums[1] += i64::from(cosine * sine);
            sums[2] += i64::from(sine * sine);
        }
    }
    sums
}

#[cfg(test)]
#[expect(clippy::float_arithmetic, reason = "random numbers are drawn as floats")]
mod tests {
    use super::*;
    use crate::base::adc::AdcFrame;
    use crate::base::rng::Rng;

    fn words(count: usize) -> impl Iterator<Item = [u32; 3]> {
        const CORNERS: [i16; 6] = [0, 1, -1, i16::MAX, i16::MIN, 16_384];
        let mut rng = Rng::new(1, 0);
        let mut lane = move || match (rng.uniform() * 12.0) as usize {
            corner if corner < CORNERS.len() => CORNERS[corner],
            _ => (rng.uniform() * 65_536.0) as i32 as i16,
        };
        (0..count).map(move |_| [0; 3].map(|_| pack(lane(), lane())))
    }

    /// Complex numbers of enough bits.
    fn wide(word: u32) -> [i64; 2] {
        [i64::from(low(word)), i64::from(high(word))]
    }

    /// Wraps to 16 bits a lane, as the instructions do.
    fn narrow([re, im]: [i64; 2]) -> u32 {
        pack(re as i16, im as i16)
    }

    #[test]
    fn lane_operations_are_complex_arithmetic_that_wraps() {
        for [a, b, _] in words(20_000) {
            let ([ar, ai], [br, bi]) = (wide(a), wide(b));
            assert_eq!(add(a, b), narrow([ar + br, ai + bi]));
            assert_eq!(subtract(a, b), narrow([ar - br, ai - bi]));
            assert_eq!(add_halved(a, b), narrow([(ar + br) >> 1, (ai + bi) >> 1]));
            assert_eq!(subtract_halved(a, b), narrow([(ar - br) >> 1, (ai - bi) >> 1]));
            assert_eq!(add_j(a, b), narrow([ar - bi, ai + br]));
            assert_eq!(subtract_j(a, b), narrow([ar + bi, ai - br]));
            assert_eq!(add_j_halved(a, b), narrow([(ar - bi) >> 1, (ai + br) >> 1]));
            assert_eq!(subtract_j_halved(a, b), narrow([(ar + bi) >> 1, (ai - br) >> 1]));
            assert_eq!((pack_low(a, b), pack_high(a, b)), (narrow([ar, br]), narrow([ai, bi])));
            // Twiddles are never -1 in both lanes at once.
            if br * br + bi * bi < 1 << 31 && ar * ar + ai * ai < 1 << 31 {
                let product = [(ar * br - ai * bi + 0x8000) >> 16, (ar * bi + ai * br + 0x8000) >> 16];
                assert_eq!(twiddled_halved(a, b), narrow(product));
            }
        }
    }

    #[test]
    fn the_first_butterfly_is_exact_for_twelve_bits_without_a_shift() {
        for [a, b, c] in words(20_000) {
            let x = [a, b, c, a ^ b].map(|word| pack(low(word) >> 4, high(word) >> 4));
            let [x0, x1, x2, x3] = x.map(wide);
            let combine =
                |signs: [i64; 4]| {
                    narrow([0, 1].map(|lane| {
                        signs[0] * x0[lane] + signs[1] * x1[lane] + signs[2] * x2[lane] + signs[3] * x3[lane]
                    }))
                };
            let expected = [[1, 1, 1, 1], [1, -1, 1, -1], [1, 0, -1, 0], [0, 1, 0, -1]].map(combine);
            assert_eq!(first_butterfly(x, 0, u32::MAX, 0), expected);
        }
        // Shifted by three, the lanes do not mix.
        let bins = first_butterfly([pack(-5, 7), 0, 0, 0], 3, 0xfff8_fff8, pack(8, -8));
        assert_eq!(bins, [pack(-48, 64), pack(-40, 56), pack(-40, 56), 0]);
    }

    #[test]
    fn sums_are_those_of_wide_integers() {
        let mut rng = Rng::new(2, 0);
        let mut frame = AdcFrame::<64>::zeroed();
        let mut table = [0_i16; 64];
        for round in 0..500 {
            for code in frame.codes.as_flattened_mut() {
                *code = match round % 3 {
                    0 => ((rng.uniform() * 4096.0) as i32 - 2048).clamp(-2048, 2047) as i16,
                    1 => [-2048, 2047][usize::from(rng.uniform() > 0.5)],
                    _ => [-2048, -2047, 2046, 2047, 0, 1, -1, 700][(rng.uniform() * 7.9) as usize],
                };
            }
            for entry in &mut table {
                *entry = ((rng.uniform() - 0.5) * 32_000.0) as i16;
            }
            for (row, clipped) in frame.codes.iter().zip(frame.clip_count()) {
                let moments = moments(row);
                assert_eq!(i64::from(moments.sum), row.iter().map(|code| i64::from(*code)).sum::<i64>());
                assert_eq!(moments.energy, row.iter().map(|code| i64::from(*code).pow(2)).sum::<i64>());
                assert_eq!(moments.clipped, u32::from(clipped));

                let (sum, reach) = sum_and_reach(row);
                assert_eq!(sum, moments.sum);
                let bound = 1 << reach.ilog2();
                assert!(row.iter().all(|code| (-bound..=bound).contains(&i32::from(*code))));
                assert!(bound == 1 || row.iter().any(|code| i32::from(*code).abs() >= bound / 2));

                let mut expected = [0_i64; 4];
                for k in 0..32 {
                    let entry = 4 * (k / 2) + k % 2;
                    let (c, s) = (i64::from(table[entry]), i64::from(table[entry + 2]));
                    let (before, after) = (i64::from(row[31 - k]), i64::from(row[32 + k]));
                    for (sum, term) in expected.iter_mut().zip([before * c, before * s, after * c, after * s]) {
                        *sum += term;
                    }
                }
                assert_eq!(lock_in(row, &table).map(i64::from), expected);
            }
            let entries = |offset: usize| (0..64).filter(move |k| k % 4 / 2 == offset).map(|k| i64::from(table[k]));
            let dot = |a: usize, b: usize| entries(a).zip(entries(b)).map(|(a, b)| a * b).sum::<i64>();
            assert_eq!(table_energies(&table), [dot(0, 0), dot(0, 1), dot(1, 1)]);
        }
    }
}
