//! The inner loops in the instructions of a Cortex-M4: the functions of [`super::portable`] under the same names, equal to
//! them bit for bit.
//!
//! The compiler does not find the dual 16-bit instructions by itself, and spills when it is given all sums of the lock-in
//! as variables. The only file of this crate with `unsafe` in it: inline assembly that touches registers alone, and two
//! loops over arrays whose length is a type.

#![deny(clippy::float_arithmetic)]
#![expect(unsafe_code, reason = "inline assembly; each block says why it is sound")]

use core::arch::{asm, naked_asm};

pub use super::portable::{Moments, high, low, pack, pack_high, pack_low};

/// Lines of assembly, two, four or eight times over. Not `.rept`: the compiler takes the length of inline assembly from its
/// lines, and would place constants out of reach.
macro_rules! repeated {
    (2: $($line:literal)*) => { concat!($($line, "\n",)* $($line, "\n",)*) };
    (4: $($line:literal)*) => { concat!(repeated!(2: $($line)*), repeated!(2: $($line)*)) };
    (8: $($line:literal)*) => { concat!(repeated!(4: $($line)*), repeated!(4: $($line)*)) };
}

/// `a + b`.
#[inline(always)]
#[must_use]
pub fn add(a: u32, b: u32) -> u32 {
    let result;
    // SAFETY: touches the named registers and flags only.
    unsafe {
        asm!("sadd16 {result}, {a}, {b}", result = lateout(reg) result, a = in(reg) a, b = in(reg) b,
            options(pure, nomem, nostack));
    }
    result
}

/// `a - b`.
#[inline(always)]
#[must_use]
pub fn subtract(a: u32, b: u32) -> u32 {
    let result;
    // SAFETY: touches the named registers and flags only.
    unsafe {
        asm!("ssub16 {result}, {a}, {b}", result = lateout(reg) result, a = in(reg) a, b = in(reg) b,
            options(pure, nomem, nostack));
    }
    result
}

/// The square root: one instruction, where `libm` computes it in integers. Both are rounded as IEEE 754 says.
///
/// A call, because stable Rust gives inline assembly no floating-point registers on this target.
#[must_use]
#[inline(always)]
pub fn sqrt(value: f32) -> f32 {
    vsqrt(value)
}

// The procedure call standard of the target (AAPCS, VFP variant) passes and returns the number in s0.
#[unsafe(naked)]
extern "C" fn vsqrt(value: f32) -> f32 {
    // The assembler does not know the unit from the target.
    naked_asm!(".fpu fpv4-sp-d16", "vsqrt.f32 s0, s0", "bx lr")
}

/// The first butterfly of two neighbouring samples of one channel.
#[inline(always)]
#[must_use]
pub fn first_butterfly([x0, x1, x2, x3]: [u32; 4], up: u32, mask: u32, mean: u32) -> [u32; 4] {
    let (sum, alternating, even_difference, odd_difference);
    // SAFETY: touches the named registers and flags only.
    unsafe {
        asm!(
            "lsl {x0}, {x0}, {up}",
            "lsl {x1}, {x1}, {up}",
            "lsl {x2}, {x2}, {up}",
            "lsl {x3}, {x3}, {up}",
            "and {x0}, {x0}, {mask}",
            "and {x1}, {x1}, {mask}",
            "and {x2}, {x2}, {mask}",
            "and {x3}, {x3}, {mask}",
            "sadd16 {t}, {x0}, {x2}",
            "ssub16 {x0}, {x0}, {x2}",
            "sadd16 {x2}, {x1}, {x3}",
            "ssub16 {x1}, {x1}, {x3}",
            "ssub16 {x3}, {t}, {x2}",
            "sadd16 {t}, {t}, {x2}",
            "ssub16 {t}, {t}, {mean}",
            x0 = inout(reg) x0 => even_difference,
            x1 = inout(reg) x1 => odd_difference,
            x2 = inout(reg) x2 => _,
            x3 = inout(reg) x3 => alternating,
            t = out(reg) sum,
            up = in(reg) up % 16,
            mask = in(reg) mask,
            mean = in(reg) mean,
            options(pure, nomem, nostack),
        );
    }
    [sum, alternating, even_difference, odd_difference]
}

/// One stage: blocks of four transforms of length `L` become transforms of length `LEN = 4 L`.
pub fn stage<const N: usize, const L: usize, const LEN: usize, const BY_TWO: bool>(
    data: &mut [u32; N],
    twiddles: &[u32; N],
) -> u32 {
    if LEN != 4 * L || !N.is_multiple_of(LEN) || N > 1024 {
        return 0;
    }
    // SAFETY: both arrays hold N words, and N is a multiple of LEN.
    let reach = unsafe { stage_words::<N, L, LEN, BY_TWO>(data.as_mut_ptr(), twiddles.as_ptr()) };
    (reach | reach >> 16) & 0xffff
}

/// The loops of [`stage`]: over the `L` twiddles of a block, and for each over the blocks.
///
/// r0 to r3 are the operands `x0, x1, x2, x3`, r4 to r6 the twiddles, r7 rounds, r8 is zero, r9 the reach, r10 the data,
/// r11 its end, r12 the twiddles; lr is scratch. On the stack: the end of the twiddles.
///
/// # Safety
/// `data` and `twiddles` point to `N` words; `LEN` is `4 L` and divides `N`.
#[unsafe(naked)]
unsafe extern "C" fn stage_words<const N: usize, const L: usize, const LEN: usize, const BY_TWO: bool>(
    data: *mut u32,
    twiddles: *const u32,
) -> u32 {
    naked_asm!(
        "push {{r4-r11, lr}}",
        "mov r10, r0",
        "mov r12, r1",
        "add r0, r1, #{table}",
        "push {{r0}}",
        "mov r7, #0x8000",
        "mov r8, #0",
        "mov r9, #0",
        "add r11, r10, #{table}",
        "2:",
        "ldrd r4, r5, [r12]",
        "ldr r6, [r12, #8]",
        "add r12, r12, #{stride}",
        "3:",
        "ldr r2, [r10, #{one}]",
        "ldr r1, [r10, #{two}]",
        "ldr r3, [r10, #{three}]",
        "ldr r0, [r10]",
        "smlsd lr, r2, r5, r7",
        "smladx r2, r2, r5, r7",
        "pkhtb r2, r2, lr, asr #16",
        "smlsd lr, r1, r4, r7",
        "smladx r1, r1, r4, r7",
        "pkhtb r1, r1, lr, asr #16",
        "smlsd lr, r3, r6, r7",
        "smladx r3, r3, r6, r7",
        "pkhtb r3, r3, lr, asr #16",
        "shadd16 r0, r0, r8",
        // Even in lr, its difference in r0; odd in r2, its difference in r1.
        "sadd16 lr, r0, r2",
        "ssub16 r0, r0, r2",
        "sadd16 r2, r1, r3",
        "ssub16 r1, r1, r3",
        ".if {by_two}",
        "shsub16 r3, lr, r2",
        "shadd16 lr, lr, r2",
        "shsax r2, r0, r1",
        "shasx r0, r0, r1",
        ".else",
        "ssub16 r3, lr, r2",
        "sadd16 lr, lr, r2",
        "ssax r2, r0, r1",
        "sasx r0, r0, r1",
        ".endif",
        "str r2, [r10, #{one}]",
        "str r3, [r10, #{two}]",
        "str r0, [r10, #{three}]",
        ".if {last}",
        "str lr, [r10], #4",
        ".else",
        "str lr, [r10]",
        "eor r2, r2, r2, lsl #1",
        "orr r9, r9, r2",
        "eor r3, r3, r3, lsl #1",
        "orr r9, r9, r3",
        "eor r0, r0, r0, lsl #1",
        "orr r9, r9, r0",
        "eor lr, lr, lr, lsl #1",
        "orr r9, r9, lr",
        "add r10, r10, #{block}",
        "cmp r10, r11",
        "blo 3b",
        "sub r10, r10, #{table} - 4",
        ".endif",
        "ldr r0, [sp]",
        "cmp r12, r0",
        "bne 2b",
        "mov r0, r9",
        "pop {{r1, r4-r11, pc}}",
        table = const 4 * N,
        stride = const 16 * (N / LEN),
        one = const 4 * L,
        two = const 8 * L,
        three = const 12 * L,
        block = const 4 * LEN,
        by_two = const BY_TWO as u32,
        last = const (LEN == N) as u32,
    )
}

/// Powers of both channels at one bin.
#[inline(always)]
#[must_use]
pub fn powers([before, here, after]: [u32; 3], [mirror_before, mirror_here, mirror_after]: [u32; 3]) -> [u32; 2] {
    let (first, second);
    // SAFETY: touches the named registers and flags only.
    unsafe {
        asm!(
            "shadd16 {t}, {before}, {after}",
            "shsub16 {t}, {here}, {t}",
            "shadd16 {u}, {mirror_before}, {mirror_after}",
            "shsub16 {u}, {mirror_here}, {u}",
            "shadd16 {sum}, {t}, {u}",
            "shsub16 {t}, {t}, {u}",
            "pkhbt {u}, {sum}, {t}",
            "pkhbt {t}, {t}, {sum}",
            "smuad {u}, {u}, {u}",
            "smuad {t}, {t}, {t}",
            t = out(reg) second,
            u = out(reg) first,
            sum = out(reg) _,
            before = in(reg) before,
            here = in(reg) here,
            after = in(reg) after,
            mirror_before = in(reg) mirror_before,
            mirror_here = in(reg) mirror_here,
            mirror_after = in(reg) mirror_after,
            options(pure, nomem, nostack),
        );
    }
    [first, second]
}

/// Sum, energy and clipped samples of 12-bit samples.
#[must_use]
pub fn moments(row: &[i16]) -> Moments {
    if row.is_empty() || !row.len().is_multiple_of(8) || !row.as_ptr().cast::<u32>().is_aligned() {
        return unaligned::moments(row);
    }
    let (mut sum, mut low, mut high, mut clipped) = (0_i32, 0_u32, 0_u32, 0_u32);
    // SAFETY: reads the codes of `row`, eight a turn and a multiple of eight, from an address that is a multiple of four.
    unsafe {
        asm!(
            "2:",
            repeated!(2:
                "ldrd {x0}, {x1}, [{p}], #8"
                "smlad {sum}, {x0}, {ones}, {sum}"
                "smlald {low}, {high}, {x0}, {x0}"
                "sadd16 {x0}, {x0}, {offset}"
                "and {x0}, {x0}, {mask}"
                "uqsub16 {x0}, {ones}, {x0}"
                "add {clipped}, {clipped}, {x0}"
                "smlad {sum}, {x1}, {ones}, {sum}"
                "smlald {low}, {high}, {x1}, {x1}"
                "sadd16 {x1}, {x1}, {offset}"
                "and {x1}, {x1}, {mask}"
                "uqsub16 {x1}, {ones}, {x1}"
                "add {clipped}, {clipped}, {x1}"
            ),
            "cmp {p}, {end}",
            "bne 2b",
            p = inout(reg) row.as_ptr() => _,
            end = in(reg) row.as_ptr_range().end,
            x0 = out(reg) _,
            x1 = out(reg) _,
            ones = in(reg) 0x0001_0001,
            offset = in(reg) 0x0801_0801,
            mask = in(reg) 0x0ffe_0ffe,
            sum = inout(reg) sum,
            low = inout(reg) low,
            high = inout(reg) high,
            clipped = inout(reg) clipped,
            options(pure, readonly, nostack),
        );
    }
    let energy = (u64::from(high) << 32 | u64::from(low)) as i64;
    Moments { sum, energy, clipped: (clipped & 0xffff) + (clipped >> 16) }
}

/// Sum of the samples, and a word whose highest set bit `h` means that all samples are within `2^h`.
#[must_use]
pub fn sum_and_reach<const N: usize>(row: &[i16; N]) -> (i32, u32) {
    const { assert!(N >= 32 && N.is_multiple_of(32)) };
    if !row.as_ptr().cast::<u32>().is_aligned() {
        return unaligned::sum_and_reach(row);
    }
    let (mut sum, mut differing) = (0_i32, 0_u32);
    // SAFETY: reads the N codes of `row`, thirty-two a turn, from an address that is a multiple of four.
    unsafe {
        asm!(
            "2:",
            repeated!(8:
                "ldrd {x0}, {x1}, [{p}], #8"
                "smlad {sum}, {x0}, {ones}, {sum}"
                "smlad {sum}, {x1}, {ones}, {sum}"
                "eor {x0}, {x0}, {x0}, lsl #1"
                "eor {x1}, {x1}, {x1}, lsl #1"
                "orr {low}, {low}, {x0}"
                "orr {low}, {low}, {x1}"
            ),
            "cmp {p}, {end}",
            "bne 2b",
            p = inout(reg) row.as_ptr() => _,
            end = in(reg) row.as_ptr_range().end,
            x0 = out(reg) _,
            x1 = out(reg) _,
            ones = in(reg) 0x0001_0001,
            sum = inout(reg) sum,
            low = inout(reg) differing,
            options(pure, readonly, nostack),
        );
    }
    // The lowest bit of the upper lane came from the lower one, but is set anyway.
    (sum, ((differing | differing >> 16) & 0xffff) | 1)
}

/// Products of the two halves of a block with a reference table.
#[must_use]
pub fn lock_in<const N: usize>(row: &[i16; N], table: &[i16; N]) -> [i32; 4] {
    const { assert!(N >= 64 && N.is_multiple_of(64)) };
    if !(row.as_ptr().cast::<u32>().is_aligned() && table.as_ptr().cast::<u32>().is_aligned()) {
        return unaligned::lock_in(row, table);
    }
    let mut sums = [0; 4];
    // SAFETY: both arrays hold N codes, start at multiples of four, and N is a multiple of 64.
    unsafe { lock_in_rows(row.as_ptr(), table.as_ptr(), N, &mut sums) };
    sums
}

/// The loop of [`lock_in`]: four samples of each half against four entries of the table, in eleven instructions.
///
/// # Safety
/// `row` and `table` point to `length` codes each, at multiples of four; `length` is a multiple of 64.
#[unsafe(naked)]
unsafe extern "C" fn lock_in_rows(row: *const i16, table: *const i16, length: usize, sums: &mut [i32; 4]) {
    naked_asm!(
        "push {{r3-r11, lr}}",
        // r0 runs down from the middle, r2 up from it, r1 along the table to r3. Half a block is `length` bytes.
        "add r3, r1, r2, lsl #1",
        "add r2, r0, r2",
        "sub r0, r2, #8",
        "movs r4, #0",
        "movs r5, #0",
        "movs r6, #0",
        "movs r7, #0",
        "2:",
        ".rept 8",
        "ldm r1!, {{r8-r11}}",
        "ldrd r12, lr, [r0], #-8",
        "smladx r4, lr, r8, r4",
        "smladx r5, lr, r9, r5",
        "smladx r4, r12, r10, r4",
        "smladx r5, r12, r11, r5",
        "ldrd r12, lr, [r2], #8",
        "smlad r6, r12, r8, r6",
        "smlad r7, r12, r9, r7",
        "smlad r6, lr, r10, r6",
        "smlad r7, lr, r11, r7",
        ".endr",
        "cmp r1, r3",
        "bne 2b",
        "ldr r0, [sp]",
        "stm r0, {{r4-r7}}",
        "pop {{r3-r11, pc}}",
    )
}

/// Energies of a reference table: sums of squared cosines, of cosines times sines, of squared sines.
#[must_use]
pub fn table_energies<const N: usize>(table: &[i16; N]) -> [i64; 3] {
    const { assert!(N >= 16 && N.is_multiple_of(16)) };
    if !table.as_ptr().cast::<u32>().is_aligned() {
        return unaligned::table_energies(table);
    }
    let mut halves = [0_u32; 6];
    let [cc_low, cc_high, cs_low, cs_high, ss_low, ss_high] = &mut halves;
    // SAFETY: reads the N codes of `table`, sixteen a turn, from an address that is a multiple of four.
    unsafe {
        asm!(
            "2:",
            repeated!(4:
                "ldrd {c}, {s}, [{p}], #8"
                "smlald {cc_low}, {cc_high}, {c}, {c}"
                "smlald {cs_low}, {cs_high}, {c}, {s}"
                "smlald {ss_low}, {ss_high}, {s}, {s}"
            ),
            "cmp {p}, {end}",
            "bne 2b",
            p = inout(reg) table.as_ptr() => _,
            end = in(reg) table.as_ptr_range().end,
            c = out(reg) _,
            s = out(reg) _,
            cc_low = inout(reg) *cc_low,
            cc_high = inout(reg) *cc_high,
            cs_low = inout(reg) *cs_low,
            cs_high = inout(reg) *cs_high,
            ss_low = inout(reg) *ss_low,
            ss_high = inout(reg) *ss_high,
            options(pure, readonly, nostack),
        );
    }
    let [cc_low, cc_high, cs_low, cs_high, ss_low, ss_high] = halves.map(u64::from);
    [(cc_high << 32 | cc_low) as i64, (cs_high << 32 | cs_low) as i64, (ss_high << 32 | ss_low) as i64]
}

/// The portable functions, for arrays that do not start at a multiple of four, as double-word loads require. A module
/// of its own, or the compiler unrolls them into their callers.
mod unaligned {
    use super::super::portable;
    use super::Moments;

    #[cold]
    #[inline(never)]
    pub(super) fn moments(row: &[i16]) -> Moments {
        portable::moments(row)
    }

    #[cold]
    #[inline(never)]
    pub(super) fn sum_and_reach(row: &[i16]) -> (i32, u32) {
        portable::sum_and_reach(row)
    }

    #[cold]
    #[inline(never)]
    pub(super) fn lock_in(row: &[i16], table: &[i16]) -> [i32; 4] {
        portable::lock_in(row, table)
    }

    #[cold]
    #[inline(never)]
    pub(super) fn table_energies(table: &[i16]) -> [i64; 3] {
        portable::table_energies(table)
    }
}
