//! The boards. Exactly one is compiled in, and `app` knows only this of it:
//!
//! | name | what |
//! |---|---|
//! | `NAME` | the name in `--board` and in the image's `.foxhound_board` section |
//! | `start()` | clocks, peripherals, executors -> `Board { guidance, link, receiver, transmitter, port_receiver, port_transmitter, pacer, watchdog, restart, flash }` |
//! | `Receiver::read(&mut self, &mut [u8]) -> usize` | waits for bytes from the autopilot |
//! | `Receiver::try_read(&mut self, &mut [u8]) -> usize` | takes the bytes that are there; it holds those of a step at the line's full rate |
//! | `Receiver::waiting(&self) -> Waiting`, `Receiver::errors(&self) -> u32` | how many waited, what was lost or damaged |
//! | `Transmitter::write(&mut self, &[u8])` | returns when the bytes are on their way |
//! | `PortReceiver`, `PortTransmitter` | the same for the maintenance port |
//! | `Pacer::next(&mut self) -> Call` | waits for what to do next |
//! | `Pacer::accept(&mut self, Result)`, `Pacer::done(&mut self, Done)` | takes note of how it went |
//! | `Pacer::clock(&self) -> Clock` | where the clock is from |
//! | `Pacer::stack_bytes(&self) -> u32` | how much of the stack was ever used, as far as is known |
//! | `Pacer::follow(&mut self, &Config)` | samples at this rate, which was fitted to `SAMPLE_TIMER` |
//! | `SAMPLE_TIMER` | what paces the samples, where that cannot be at any rate |
//! | `Pacer::sound(&mut self, bool)` | the test tone, where there is one |
//! | `Pacer::trouble(&mut self) -> Option<&str>` | what is wrong with it for good, once |
//! | `Pacer::lost(&self) -> u32` | frames that did not come or were no use, since the start |
//! | `Watchdog::feed(&mut self)`, `Watchdog::PERIOD_US` | runs from the start; without food for so long the board restarts |
//! | `Flash`, a `NorFlash` | what is kept while the power is off: [`foxhound_computer::store`] says what it asks of it |
//! | `SAMPLES_KEPT` | samples of a plan that are kept for somebody to see |
//! | `ticks() -> u32`, `TICKS_PER_US` | a fast free-running counter, to measure with |
//! | `uptime_s() -> u32` | since the start |
//! | `halt(reason) -> !` | it cannot go on |
//! | `restart() -> !` | somebody wants it |
//! | `last_words(words)`, `on_fault`, `is_memory` | for [`crash_record`](crate::arm::crash_record) |
//!
//! Everything `unsafe` of the firmware is in the boards, and in [`arm`](crate::arm), which they share.

#[cfg(feature = "board-mps2_an386")]
pub mod mps2_an386;
#[cfg(feature = "board-nucleo_g474re")]
pub mod nucleo_g474re;

#[cfg(feature = "board-mps2_an386")]
pub use mps2_an386 as board;
#[cfg(feature = "board-nucleo_g474re")]
pub use nucleo_g474re as board;

use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::{self, FrontEnd};

use crate::app::{Planned, SAMPLES_PER_CHANNEL as N};

/// What the board wants done.
#[derive(Debug)]
pub enum Call<'a> {
    /// Start anew with this configuration.
    Setup(&'a guidance::Config),
    /// One step of the fast loop.
    Step(Step<'a>),
}

/// One step of the fast loop.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The time of the step: the only clock of guidance and link.
    pub now: Instant,
    /// In lock-step with a simulator nothing is left running when the step is done, so that the result does not depend on
    /// the simulator's speed.
    pub lock_step: Option<LockStep>,
    /// What the antennas brought.
    pub front_end: FrontEnd<'a, N>,
    /// Obstacles that a sensor delivers as circles already.
    pub circles: Option<&'a [Circle]>,
}

/// What a step in lock-step heeds.
#[derive(Clone, Copy, Debug)]
pub struct LockStep {
    /// So many bytes of the autopilot, counted from the start, come before it.
    pub rx_expected: u32,
    /// So many bytes of camera frames have been looked at before it.
    pub camera_expected: u32,
    /// The planner is starved: what it has found waits for a later step.
    pub holds_plan: bool,
    /// Says that the measured part of the step begins, and when that is, in `ticks`.
    pub begin: fn() -> u32,
}

/// What one step came to.
#[derive(Debug)]
pub struct Done<'a> {
    /// What guidance said.
    pub output: guidance::Output,
    /// Length of the guidance step, in `ticks`.
    pub fast_ticks: u32,
    /// Steps that were late since the start.
    pub late: u32,
    /// Bytes handed to the transmitter since the start.
    pub tx_total: u32,
    /// A replan that was finished in this step (lock-step only).
    pub plan: Option<&'a Planned>,
}
