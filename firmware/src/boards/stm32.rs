//! What the boards with an STM32 share: the serial lines, of which USART1 is the autopilot's on each, the time, and how they
//! end.

use core::fmt;

use defmt_rtt as _;
use embassy_stm32::mode::Async;
use embassy_stm32::usart::{self, RingBufferedUartRx, UartTx};
use foxhound_computer::restart::End;
use foxhound_computer::transfer;

use super::last_words;

/// From the autopilot.
pub struct Receiver(pub(super) RingBufferedUartRx<'static>);

impl Receiver {
    /// Waits for bytes. After noise or an overrun the receiver goes on; MAVLink finds its next frame by itself.
    pub async fn read(&mut self, bytes: &mut [u8]) -> usize {
        loop {
            match self.0.read(bytes).await {
                Ok(count) => return count,
                Err(error) => defmt::warn!("USART1: {}", defmt::Debug2Format(&error)),
            }
        }
    }
}

/// To the autopilot.
pub struct Transmitter(pub(super) UartTx<'static, Async>);

impl Transmitter {
    /// Sends bytes; returns when DMA has handed over the last one.
    pub async fn write(&mut self, bytes: &[u8]) {
        if let Err(error) = send(&mut self.0, bytes).await {
            defmt::warn!("USART1: {}", defmt::Debug2Format(&error));
        }
    }
}

/// From the maintenance port.
pub struct PortReceiver(pub(super) RingBufferedUartRx<'static>);

impl PortReceiver {
    /// Waits for bytes. After noise or an overrun the line that was being typed is a bad one.
    pub async fn read(&mut self, bytes: &mut [u8]) -> usize {
        loop {
            if let Ok(count) = self.0.read(bytes).await {
                return count;
            }
        }
    }
}

/// To the maintenance port.
pub struct PortTransmitter(pub(super) UartTx<'static, Async>);

impl PortTransmitter {
    /// Sends bytes; returns when DMA has handed over the last one.
    pub async fn write(&mut self, bytes: &[u8]) {
        // What does not arrive is a gap in the log.
        let _ = send(&mut self.0, bytes).await;
    }
}

/// Sends bytes by DMA, none or any number of them: [`transfer`] says what DMA takes, and embassy panics at anything else.
async fn send(line: &mut UartTx<'static, Async>, bytes: &[u8]) -> Result<(), usart::Error> {
    for piece in transfer::pieces(bytes) {
        line.write(piece).await?;
    }
    Ok(())
}

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
    last_words::end(End::Halt, 0, 0, reason.as_str().unwrap_or("halt").as_bytes())
}

/// Says why it ends, to a debugger.
pub(super) fn last_words(words: fmt::Arguments<'_>) {
    defmt::error!("{}", defmt::Display2Format(&words));
}

/// A fault: goes on with a stack begun anew, in which there is room.
///
/// # Safety
/// To be reached from the vector only.
// SAFETY: comes from the vector with the main stack, the only one in use, in r0. Nothing returns from here.
#[unsafe(naked)]
pub(super) unsafe extern "C" fn on_fault() {
    core::arch::naked_asm!(
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr  msp, r1",
        "b    {fault}",
        fault = sym last_words::fault,
    )
}
