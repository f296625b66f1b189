//! The CMSDK watchdog (Arm DDI 0479, chapter 4): counts down at 25 MHz, raises an interrupt, which is not answered,
//! at the first zero, and resets the machine at the second.

use super::registers::{Register, WATCHDOG};
use crate::board;

/// Opens the registers for writing.
const KEY: u32 = 0x1ACC_E551;
const INTERRUPT_ENABLE: u32 = 1;
const RESET_ENABLE: u32 = 1 << 1;
/// The clock of the timer.
const TICKS_PER_US: u32 = 25;

/// Restarts the machine when it is not fed.
#[derive(Debug)]
pub struct Watchdog(());

impl Watchdog {
    /// Starts it.
    pub(super) fn start() -> Self {
        WATCHDOG.write(Register::Lock, KEY);
        WATCHDOG.write(Register::WATCHDOG_LOAD, <Self as board::Watchdog>::PERIOD_US * TICKS_PER_US);
        WATCHDOG.write(Register::WATCHDOG_CONTROL, INTERRUPT_ENABLE | RESET_ENABLE);
        Self(())
    }

    /// Stops it, for a program that measures and makes no steps.
    pub fn stop(self) {
        WATCHDOG.write(Register::WATCHDOG_CONTROL, 0);
    }
}

impl board::Watchdog for Watchdog {
    const PERIOD_US: u32 = 4_000_000;

    fn feed(&mut self) {
        WATCHDOG.write(Register::WATCHDOG_CLEAR, 1);
    }
}
