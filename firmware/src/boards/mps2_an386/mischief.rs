//! What goes wrong inside the twin because the simulator wants it so: `cargo xtask qemu faults`.
//!
//! What comes from outside, the simulator does itself: noise on the line, frames that stand still, an autopilot that
//! restarts. What has to happen at an instruction is done here, by the first of the two timers of the dual timer (Arm DDI
//! 0479, chapter 4), the most urgent interrupt.

use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use foxhound_link::mailbox::Fault;

use super::clock::ticks;
use super::interrupt::{Interrupt, unmask};
use super::registers::{DUAL_TIMER, Register};

const TICKS_PER_US: u32 = 25;
const ENABLE: u32 = 1 << 7;
const INTERRUPT_ENABLE: u32 = 1 << 5;
const SIZE_32: u32 = 1 << 1;
const ONE_SHOT: u32 = 1;
/// How far into the step an interrupt storm begins: when the bytes have been read, and guidance steps.
const STORM_AFTER_US: u32 = 4_000;

/// Ticks that the interrupt takes away; none: it cuts the power.
static STOLEN_TICKS: AtomicU32 = AtomicU32::new(0);

/// Does it, or sees to it that it comes.
pub(super) fn begin(fault: Fault) {
    match fault {
        Fault::PowerCut { after_us } => arm(after_us, 0),
        Fault::Steal { for_us } => arm(STORM_AFTER_US, for_us.max(1).saturating_mul(TICKS_PER_US)),
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

fn arm(after_us: u32, stolen_ticks: u32) {
    STOLEN_TICKS.store(stolen_ticks, Ordering::Relaxed);
    DUAL_TIMER.write(Register::DUAL_CONTROL, 0);
    DUAL_TIMER.write(Register::DUAL_LOAD, after_us.max(1).saturating_mul(TICKS_PER_US));
    DUAL_TIMER.write(Register::DUAL_CONTROL, ENABLE | INTERRUPT_ENABLE | SIZE_32 | ONE_SHOT);
    unmask(Interrupt::DualTimer);
}

pub(super) extern "C" fn on_due() {
    DUAL_TIMER.write(Register::DUAL_CLEAR, 1);
    let stolen_ticks = STOLEN_TICKS.load(Ordering::Relaxed);
    if stolen_ticks == 0 {
        SCB::sys_reset();
    }
    let begin = ticks();
    while ticks().wrapping_sub(begin) < stolen_ticks {}
}
