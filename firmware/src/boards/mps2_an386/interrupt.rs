//! The interrupts of the mps2-an386 (Arm AN386, table 3-7) and their vectors.

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
    /// Nothing is wired here: the executor of guidance.
    GuidanceExecutor = 30,
    /// Nothing is wired here: the executor of the link.
    LinkExecutor = 31,
}

// SAFETY: the numbers are inside the vector table below and belong to the vectors of the same name.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Sets priorities (lower is more urgent): time and serial lines before guidance before the link before the
/// maintenance port; the planner has none of this, it is the thread.
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

/// Lets an interrupt through.
pub fn unmask(interrupt: Interrupt) {
    // SAFETY: every handler takes what it shares from statics that are safe to share; no mask-based critical section
    // is in use.
    unsafe { NVIC::unmask(interrupt) };
}

/// The vectors, by interrupt number.
// SAFETY: the section and the name are those under which cortex-m-rt's linker script wants the table, and every entry
// is a function that may be called at any time.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [extern "C" fn(); 32] = {
    let mut table: [extern "C" fn(); 32] = [unexpected; 32];
    table[Interrupt::Uart0Rx as usize] = super::uart::on_byte;
    table[Interrupt::Uart0Tx as usize] = super::uart::on_room;
    table[Interrupt::Uart1Rx as usize] = super::uart::on_bell;
    table[Interrupt::Uart2Rx as usize] = super::uart::on_port_byte;
    table[Interrupt::Uart2Tx as usize] = super::uart::on_port_room;
    table[Interrupt::Timer0 as usize] = super::clock::on_wrap;
    table[Interrupt::Timer1 as usize] = super::clock::on_alarm;
    table[Interrupt::DualTimer as usize] = super::faults::on_due;
    table[Interrupt::GuidanceExecutor as usize] = super::on_guidance;
    table[Interrupt::LinkExecutor as usize] = super::on_link;
    table
};

extern "C" fn unexpected() {
    super::ending::halt(format_args!("an interrupt that nobody handles"));
}
