//! The sums behind the boards' registers, without the registers, so that the host tests them. What DMA has written into a ring is
//! [`foxhound_computer::circular`]'s business, sample rates are [`foxhound_computer::sampling`]'s, the table of the test tone is
//! [`foxhound_computer::tone`]'s.

/// What a serial line divides its clock by, to the nearest; in so many `parts` of a cycle where it divides finer.
#[must_use]
pub const fn baud_divider(clock_hz: u32, baud: u32, parts: u32) -> u32 {
    ((clock_hz as u64 * parts as u64 + baud as u64 / 2) / baud as u64) as u32
}

/// The frequency of a phase-locked loop: the input divided, multiplied, and divided again.
#[must_use]
pub const fn pll_hz(input_hz: u32, divider: u32, factor: u32, output_divider: u32) -> u32 {
    input_hz / divider * factor / output_divider
}

/// What stands in a timer's prescaler for so many counts a second: one less than it divides by.
#[must_use]
pub const fn prescaler(clock_hz: u32, counts_hz: u32) -> u32 {
    clock_hz / counts_hz - 1
}

/// Ticks since the start, of a counter of 32 bits that has wrapped so often.
#[must_use]
pub const fn wide_count(wraps: u32, count: u32) -> u64 {
    (wraps as u64) << 32 | count as u64
}

/// What a timer counts down from until an alarm, of which it takes `counts` a tick; none where the alarm is due. One that is too far
/// off for the timer is to ring early, and to be set again.
#[must_use]
pub fn alarm_count(now_ticks: u64, at_ticks: u64, counts: u64) -> Option<u32> {
    let wait = at_ticks.checked_sub(now_ticks).filter(|wait| *wait > 0)?;
    Some(wait.saturating_mul(counts).min(u64::from(u32::MAX)) as u32)
}

/// From the middle of a block of samples to its last one, rounded up.
#[must_use]
pub const fn half_block_us(samples: u64, cycles_per_sample: u32, clock_mhz: u32) -> u64 {
    ((samples - 1) * cycles_per_sample as u64 / 2).div_ceil(clock_mhz as u64)
}

/// For how long a frame is waited for that comes every so many cycles: two of them, and a twentieth; 1 ms at least.
#[must_use]
pub const fn patience_us(cycles_per_frame: u64, clock_mhz: u32) -> u64 {
    let patience_us = cycles_per_frame * 41 / 20 / clock_mhz as u64;
    if patience_us > 1_000 { patience_us } else { 1_000 }
}

/// Which half of a ring was filled last, when so many have been since the start: 0 or 1.
#[must_use]
pub const fn ring_half(filled: u32) -> usize {
    (filled.wrapping_sub(1) & 1) as usize
}

/// The size field of a region's register (`MPU_RASR`, Armv7-M B3.5.9) for a power of two of bytes, from 32 on: 2^(size + 1) bytes.
#[must_use]
pub const fn region_size(bytes: u32) -> u32 {
    assert!(bytes.is_power_of_two() && bytes >= 32);
    (bytes.ilog2() - 1) << 1
}

#[cfg(test)]
mod tests;
