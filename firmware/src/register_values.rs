//! Calculations of register values, without the registers, so that the host can test them.
//! [`foxhound_computer::circular`] has those of DMA rings, [`foxhound_computer::sampling`] sample rates,
//! [`foxhound_computer::tone`] the table of the test tone.

/// Divider of a serial line's clock, to the nearest; in `parts` of a cycle if it divides more finely.
#[must_use]
pub const fn baud_divider(clock_hz: u32, baud: u32, parts: u32) -> u32 {
    ((clock_hz as u64 * parts as u64 + baud as u64 / 2) / baud as u64) as u32
}

/// The frequency of a phase-locked loop: the input divided, multiplied, and divided again.
#[must_use]
pub const fn pll_hz(input_hz: u32, divider: u32, factor: u32, output_divider: u32) -> u32 {
    input_hz / divider * factor / output_divider
}

/// A timer's prescaler for a number of counts a second: the divider minus one.
#[must_use]
pub const fn prescaler(clock_hz: u32, counts_hz: u32) -> u32 {
    clock_hz / counts_hz - 1
}

/// Ticks since the start, from a 32-bit counter and the number of its wraps.
#[must_use]
pub const fn wide_count(wraps: u32, count: u32) -> u64 {
    (wraps as u64) << 32 | count as u64
}

/// Start value of a timer until an alarm, with `counts` per tick; `None` if the alarm is due. One that is too far for
/// the timer rings early, and has to be set again.
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

/// Longest wait for a frame that comes every `cycles_per_frame`: two of them, and a twentieth; 1 ms at least.
#[must_use]
pub const fn patience_us(cycles_per_frame: u64, clock_mhz: u32) -> u64 {
    let patience_us = cycles_per_frame * 41 / 20 / clock_mhz as u64;
    if patience_us > 1_000 { patience_us } else { 1_000 }
}

/// Which half of a ring of two blocks was filled last, from the number of samples until its end: 0 or 1. The other is being filled.
#[must_use]
pub const fn ring_half(left: usize, samples: usize) -> usize {
    if left > samples { 1 } else { 0 }
}

/// The size field of a region's register (`MPU_RASR`, Armv7-M B3.5.9) for a power of two of bytes, from 32 on: 2^(size + 1) bytes.
#[must_use]
pub const fn region_size(bytes: u32) -> u32 {
    assert!(bytes.is_power_of_two() && bytes >= 32);
    (bytes.ilog2() - 1) << 1
}

#[cfg(test)]
mod tests;
