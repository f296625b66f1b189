//! The interrupts of the mps2-an386 (Arm AN386, table 3-7): numbers, priorities, masks.

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;

/// An interrupt that we use.
#[derive(Clone, Copy, Debug)]
#[repr(u16)]
pub enum Interrupt {
    /// UART0 has a byte.
    Uart0Rx = 0,
    /// UART0 takes a byte.
    Uart0Tx = 1,
    /// UART1 has a byte.
    Uart1Rx = 2,
    /// UART2 has a byte.
    Uart2Rx = 4,
    /// UART2 takes a byte.
    Uart2Tx = 5,
    /// The time has wrapped.
    Timer0 = 8,
    /// The alarm.
    Timer1 = 9,
    /// A fault is due.
    DualTimer = 10,
    /// Not connected: the executor of guidance.
    GuidanceExecutor = 30,
    /// Not connected: the executor of the link.
    LinkExecutor = 31,
}

// SAFETY: the numbers are inside the vector table below and belong to the vectors of the same name.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Sets priorities (lower is more urgent): time and serial lines, then guidance, then the link, then the maintenance
/// port; the planner is the thread.
pub fn prioritise(nvic: &mut NVIC) {
    use Interrupt as I;
    let levels = [
        (I::DualTimer, 0x00),
        (I::Timer0, 0x20),
        (I::Timer1, 0x20),
        (I::Uart0Rx, 0x40),
        (I::Uart0Tx, 0x40),
        (I::Uart1Rx, 0x40),
        (I::Uart2Rx, 0xc0),
        (I::Uart2Tx, 0xc0),
        (I::GuidanceExecutor, 0x80),
        (I::LinkExecutor, 0xa0),
    ];
    for (interrupt, level) in levels {
        // SAFETY: called at the start, before any of these is unmasked and inside no critical section that counts on
        // priorities.
        unsafe { nvic.set_priority(interrupt, level) };
    }
}

/// Enables an interrupt.
pub fn unmask(interrupt: Interrupt) {
    // SAFETY: every handler takes what it shares from statics that are safe to share; no mask-based critical section
    // is in use.
    unsafe { NVIC::unmask(interrupt) };
}
