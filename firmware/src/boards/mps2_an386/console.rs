//! The end of the program, by semihosting: a message on QEMU's error output and a non-zero exit.
//!
//! Without semihosting a `bkpt 0xab` is a fault. So that the image also runs in a QEMU that was started without it,
//! the fault handler answers such a breakpoint with "failed" and goes on behind it.

use core::fmt;
use core::panic::PanicInfo;

use defmt_semihosting as _;

/// The end.
pub fn halt(reason: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    semihosting::eprintln!("foxhound: {reason}");
    semihosting::process::exit(1)
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    halt(format_args!("{info}"))
}

/// Steps over a semihosting breakpoint that nobody answered; everything else is the end.
// SAFETY: the name is that of the vector. The handler reads the exception frame at the top of the main stack, the only
// stack in use, and changes in it only r0 and the program counter, after having seen that this points to `bkpt 0xab`
// (0xbeab) inside the program's memory. It uses no register that the exception entry does not save.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn HardFault() {
    core::arch::naked_asm!(
        "mrs  r0, msp",
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
        "ldr  r0, [r0, #24]",
        "b    {fault}",
        fault = sym fault,
    )
}

extern "C" fn fault(address: u32) -> ! {
    halt(format_args!("hard fault at {address:#010x}"))
}
