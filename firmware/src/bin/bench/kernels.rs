//! The target's kernels and the portable ones over the same words.

use foxhound_core::base::math::{armv7em, portable};
use foxhound_core::base::rng::Rng;

use crate::halt;

/// Runs the target's kernels and the portable ones over the same words, random ones and corners, and ends the program
/// when they differ. Returns how many words went in.
#[inline(never)]
pub(super) fn kernels<const M: usize>(seed: u64) -> u32 {
    const ROUNDS: usize = 24;
    let mut words = Words(Rng::new(seed, 3));
    let check = |same: bool, name: &str| {
        if !same {
            halt(format_args!("kernel {name} differs from the portable one, N = {M}"));
        }
    };
    for round in 0..ROUNDS {
        let (data, twiddles): ([u32; M], [u32; M]) = ([0; M].map(|_| words.word()), [0; M].map(|_| words.word()));
        stages(&data, &twiddles, &check);
        for quad in data.as_chunks::<4>().0 {
            let [a, b, c, d] = *quad;
            check(armv7em::add(a, b) == portable::add(a, b), "add");
            check(armv7em::subtract(a, b) == portable::subtract(a, b), "subtract");
            let powers = [[a, b, c], [d, a ^ c, b ^ d]];
            let value = f32::from_bits(a);
            // Not a number has several words; which one comes out does not matter.
            let same = |one: f32, other: f32| one.to_bits() == other.to_bits() || (one.is_nan() && other.is_nan());
            check(same(armv7em::sqrt(value), portable::sqrt(value)), "sqrt");
            check(armv7em::powers(powers[0], powers[1]) == portable::powers(powers[0], powers[1]), "powers");
            let (up, mask) = (a % 16, !b);
            check(
                armv7em::first_butterfly(*quad, up, mask, c ^ d) == portable::first_butterfly(*quad, up, mask, c ^ d),
                "first_butterfly",
            );
        }
        let mut codes = Codes([0_i16; M]);
        let mut table = Codes([0_i16; M]);
        for ((code, entry), word) in codes.0.iter_mut().zip(&mut table.0).zip(data) {
            // Codes of 12 bits in every other round, or no clipped sample would be seen.
            *code = if round % 2 == 0 { portable::low(word) >> 4 } else { portable::low(word) };
            *entry = portable::high(word);
        }
        let (row, table) = (&codes.0, &table.0);
        check(armv7em::moments(row) == portable::moments(row), "moments");
        check(armv7em::moments(&row[1..]) == portable::moments(&row[1..]), "moments, unaligned");
        check(armv7em::sum_and_reach(row) == portable::sum_and_reach(row), "sum_and_reach");
        check(armv7em::lock_in(row, table) == portable::lock_in(row, table), "lock_in");
        check(armv7em::table_energies(table) == portable::table_energies(table), "table_energies");
    }
    (ROUNDS * 2 * M) as u32
}

/// Aligned as the product's own tables are.
#[repr(C, align(8))]
struct Codes<const M: usize>([i16; M]);

/// Words whose lanes are random, a third of them corners.
struct Words(Rng);

impl Words {
    fn lane(&mut self) -> i16 {
        match (self.0.uniform() * 24.0) as u32 {
            0 => 0,
            1 => 1,
            2 => -1,
            3 => i16::MAX,
            4 => i16::MIN,
            5 => 16_384,
            6 => -2048,
            7 => 2047,
            _ => (self.0.uniform() * 65_536.0) as i32 as i16,
        }
    }

    fn word(&mut self) -> u32 {
        portable::pack(self.lane(), self.lane())
    }
}

/// All stages of a transform of `M` points, both ways of scaling.
fn stages<const M: usize>(data: &[u32; M], twiddles: &[u32; M], check: &impl Fn(bool, &str)) {
    if M.trailing_zeros() % 2 == 1 {
        stage::<M, 2, 8>(data, twiddles, check);
        stage::<M, 8, 32>(data, twiddles, check);
        stage::<M, 32, 128>(data, twiddles, check);
        stage::<M, 128, 512>(data, twiddles, check);
    } else {
        stage::<M, 4, 16>(data, twiddles, check);
        stage::<M, 16, 64>(data, twiddles, check);
        stage::<M, 64, 256>(data, twiddles, check);
        stage::<M, 256, 1024>(data, twiddles, check);
    }
}

fn stage<const M: usize, const L: usize, const LEN: usize>(
    data: &[u32; M],
    twiddles: &[u32; M],
    check: &impl Fn(bool, &str),
) {
    if LEN > M {
        return;
    }
    let both = |target: &mut [u32; M], portable: &mut [u32; M], by_two: bool| {
        if by_two {
            let reach = armv7em::stage::<M, L, LEN, true>(target, twiddles);
            reach == portable::stage::<M, L, LEN, true>(portable, twiddles)
        } else {
            let reach = armv7em::stage::<M, L, LEN, false>(target, twiddles);
            reach == portable::stage::<M, L, LEN, false>(portable, twiddles)
        }
    };
    for by_two in [false, true] {
        let (mut target, mut portable) = (*data, *data);
        let same_reach = both(&mut target, &mut portable, by_two);
        check(same_reach && target == portable, "stage");
    }
}
