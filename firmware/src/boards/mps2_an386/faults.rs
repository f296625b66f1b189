//! Faults inside the twin, injected by the simulator: `cargo xtask qemu faults`.
//!
//! Faults from outside are made by the simulator itself: noise on the line, frames that stand still, an autopilot
//! that restarts. A fault that must happen at a certain instruction is made here, by the first of the two timers of
//! the dual timer (Arm DDI 0479, chapter 4), the most urgent interrupt.

use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use foxhound_computer::twin::Fault;

use super::clock::ticks;
use super::interrupt::{Interrupt, unmask};
use super::registers::{DUAL_TIMER, Register};

const TICKS_PER_US: u32 = 25;
const ENABLE: u32 = 1 << 7;
const INTERRUPT_ENABLE: u32 = 1 << 5;
const SIZE_32: u32 = 1 << 1;
const ONE_SHOT: u32 = 1;
/// How far into the measured part of the step an interrupt storm begins: 3 900 instructions, when guidance steps.
const STORM_AFTER_US: u32 = 1_000;
/// Instructions from one reading of the clock to the next in the storm: QEMU takes as long for a reading as for
/// hundreds of them.
const STORM_STRIDE: u32 = 500;

/// Ticks that the interrupt takes; 0: it cuts the power.
static STOLEN_TICKS: AtomicU32 = AtomicU32::new(0);
/// Ticks to be taken in this step.
static WANTED_TICKS: AtomicU32 = AtomicU32::new(0);
/// The rest of the timer when the last step was done; 0: it does not run.
static LEFT: AtomicU32 = AtomicU32::new(0);

/// Makes the fault, or starts the timer for it.
pub(super) fn begin(fault: Fault) {
    match fault {
        Fault::PowerCut { after_us } => arm(after_us, 0),
        Fault::Steal { for_us } => {
            WANTED_TICKS.store(for_us.max(1).saturating_mul(TICKS_PER_US), Ordering::Relaxed);
        }
        // It is the application that waits.
        Fault::StarvePlanner => {}
        Fault::Panic => break_down(),
        Fault::Undefined => cortex_m::asm::udf(),
        Fault::Overflow => {
            overflow(u64::from(ticks()));
        }
        Fault::Hang => loop {
            cortex_m::asm::nop();
        },
    }
}

#[expect(clippy::panic, reason = "somebody wants to see what becomes of it")]
fn break_down() {
    panic!("as the simulator wants it");
}

#[expect(unconditional_recursion, reason = "somebody wants to see what becomes of it")]
#[inline(never)]
fn overflow(depth: u64) -> u64 {
    let frame = black_box([depth; 16]);
    overflow(depth.wrapping_add(frame[3])).wrapping_add(frame[5])
}

/// The bytes have been read, and the measured part of the step begins. A storm before it would have no effect: the
/// wait for bytes is the simulator's time.
pub(super) fn measured() -> u32 {
    let wanted_ticks = WANTED_TICKS.swap(0, Ordering::Relaxed);
    if wanted_ticks > 0 {
        arm(STORM_AFTER_US, wanted_ticks);
    }
    ticks()
}

fn arm(after_us: u32, stolen_ticks: u32) {
    STOLEN_TICKS.store(stolen_ticks, Ordering::Relaxed);
    DUAL_TIMER.write(Register::DUAL_CONTROL, 0);
    run(after_us.max(1).saturating_mul(TICKS_PER_US));
    unmask(Interrupt::DualTimer);
}

fn run(for_ticks: u32) {
    DUAL_TIMER.write(Register::DUAL_LOAD, for_ticks);
    DUAL_TIMER.write(Register::DUAL_CONTROL, ENABLE | INTERRUPT_ENABLE | SIZE_32 | ONE_SHOT);
}

/// The step is done: until the next one only the simulator's time passes, which must not decide when the power is
/// cut.
pub(super) fn pause() {
    if DUAL_TIMER.read(Register::DUAL_CONTROL) & ENABLE != 0 {
        DUAL_TIMER.write(Register::DUAL_CONTROL, 0);
        LEFT.store(DUAL_TIMER.read(Register::DUAL_VALUE), Ordering::Relaxed);
    }
}

/// The next step begins.
pub(super) fn go_on() {
    let left = LEFT.swap(0, Ordering::Relaxed);
    if left > 0 {
        run(left);
    }
}

pub(super) extern "C" fn on_due() {
    DUAL_TIMER.write(Register::DUAL_CLEAR, 1);
    DUAL_TIMER.write(Register::DUAL_CONTROL, 0);
    let stolen_ticks = STOLEN_TICKS.load(Ordering::Relaxed);
    if stolen_ticks == 0 {
        SCB::sys_reset();
    }
    let begin = ticks();
    while ticks().wrapping_sub(begin) < stolen_ticks {
        cortex_m::asm::delay(STORM_STRIDE);
    }
}
