//! The end of the program; its reason goes to a debugger.

use core::ops::Range;
use core::panic::PanicInfo;

use defmt_rtt as _;
use foxhound_computer::restart::End;

use super::Machine;
use crate::arm::crash_record::{self, CrashOutput};

/// Reports why the program cannot continue, and restarts.
pub(super) fn halt(reason: &str) -> ! {
    crash_record::end_saying::<Machine>(End::Halt, 0, 0, reason)
}

impl CrashOutput for Machine {
    const MEMORY: Range<u32> = 0x2000_0000..0x2002_0000;

    /// Prints to a debugger.
    fn print_end(what: &str, text: &str) {
        defmt::error!("{=str} {=str}", what, text);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    crash_record::panicked::<Machine>(info)
}

/// A fault of the processor; every other fault comes through it. The stack may be corrupt: it is started anew, so
/// that there is space.
// SAFETY: the name is that of the vector, and the main stack is the only one in use. Nothing returns from here.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn HardFault() {
    core::arch::naked_asm!(
        "mrs  r0, msp",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr  msp, r1",
        "b    {fault}",
        fault = sym crash_record::fault::<Machine>,
    )
}
