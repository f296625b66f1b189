//! The vector table of the mps2-an386: which function serves which interrupt.

use super::interrupt::Interrupt;

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
    super::ending::halt("an interrupt that nobody handles");
}
