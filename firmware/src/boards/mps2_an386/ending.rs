//! Prints why the program ends by semihosting, on QEMU's error output.
//!
//! Without semihosting a `bkpt 0xab` is a fault. So that the image also runs in a QEMU that was started without it,
//! the fault handler answers such a breakpoint with "failed" and continues after it.

use core::ops::Range;
use core::panic::PanicInfo;

use defmt_semihosting as _;
use foxhound_computer::restart::End;

use super::Machine;
use crate::arm::crash_record::{self, CrashOutput, fault};

/// Ends a program that cannot even begin.
pub(super) fn halt(reason: &str) -> ! {
    cortex_m::interrupt::disable();
    Machine::print_end("halt:", reason);
    semihosting::process::exit(1)
}

impl CrashOutput for Machine {
    const MEMORY: Range<u32> = 0x2000_0000..0x2002_0000;

    fn print_end(what: &str, text: &str) {
        semihosting::eprintln!("foxhound: {what} {text}");
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    crash_record::panicked::<Machine>(info)
}

/// A fault of the processor. Steps over a semihosting breakpoint that nobody answered; everything else is the end, on a stack
/// begun anew.
// SAFETY: the name is that of the vector, and the main stack is the only one in use. It reads the exception frame at its top,
// if that is in memory, and changes in it only r0 and the program counter, after having seen that this points to `bkpt 0xab`
// (0xbeab) inside the program's memory. It uses no register that the exception entry does not save.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn HardFault() {
    core::arch::naked_asm!(
        "mrs  r0, msp",
        "movw r2, #0",
        "movt r2, #0x2000",
        "cmp  r0, r2",
        "blo  2f",
        "ldr  r1, [r0, #24]",
        "cmp  r1, #0x80000",
        "bhs  2f",
        "ldrh r2, [r1]",
        "movw r3, #0xbeab",
        "cmp  r2, r3",
        "bne  2f",
        "adds r1, #2",
        "str  r1, [r0, #24]",
        "mov  r1, #-1",
        "str  r1, [r0, #0]",
        "bx   lr",
        "2:",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr  msp, r1",
        "b    {fault}",
        fault = sym fault::<Machine>,
    )
}

/// Ends a program that did not feed the watchdog, which first raises an interrupt.
extern "C" fn starved(frame: u32) -> ! {
    let address = crash_record::interrupted(frame, &Machine::MEMORY);
    crash_record::end_saying::<Machine>(End::Watchdog, address, 0, "")
}

/// The watchdog's interrupt.
// SAFETY: the name is that of the vector. Nothing returns from here, and the stack is begun anew.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn NonMaskableInt() {
    core::arch::naked_asm!(
        "mrs  r0, msp",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr  msp, r1",
        "b    {starved}",
        starved = sym starved,
    )
}
