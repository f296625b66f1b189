//! The time, and how the program ends; its last words go to a debugger.

use core::fmt;

use defmt_rtt as _;
use foxhound_computer::restart::End;

use crate::arm::crash_record;

/// Cycles of the core; wraps after some seconds.
#[must_use]
pub fn ticks() -> u32 {
    cortex_m::peripheral::DWT::cycle_count()
}

/// Seconds since the start.
#[must_use]
pub fn uptime_s() -> u32 {
    embassy_time::Instant::now().as_secs() as u32
}

/// It cannot go on: says why, and begins anew.
pub fn halt(reason: fmt::Arguments<'_>) -> ! {
    last_words(reason);
    crash_record::end(End::Halt, 0, 0, reason.as_str().unwrap_or("halt").as_bytes())
}

/// Says why it ends, to a debugger.
pub fn last_words(words: fmt::Arguments<'_>) {
    defmt::error!("{}", defmt::Display2Format(&words));
}

/// A fault: goes on with a stack begun anew, in which there is room.
///
/// # Safety
/// To be reached from the vector only.
// SAFETY: comes from the vector with the main stack, the only one in use, in r0. Nothing returns from here.
#[unsafe(naked)]
pub unsafe extern "C" fn on_fault() {
    core::arch::naked_asm!(
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr  msp, r1",
        "b    {fault}",
        fault = sym crash_record::fault,
    )
}
