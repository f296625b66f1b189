//! Bytes of the autopilot by the memory that we share with the simulator, as by DMA: layout in `foxhound_link::mailbox`.
//!
//! QEMU's serial line costs the simulator's machine a dozen changes of thread for every byte. A simulator that flies for hours
//! fills the ring before it rings the bell; one that fills nothing has UART0. What was written before the setup of this start
//! was for the last one.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, fence};
use core::task::Waker;

use embassy_sync::waitqueue::AtomicWaker;
use foxhound_link::mailbox::{LINE_AT, LINE_BYTES, LINE_TOTAL_AT};

use super::PSRAM;

static WAKER: AtomicWaker = AtomicWaker::new();
static IS_OPEN: AtomicBool = AtomicBool::new(false);
static TAKEN: AtomicU32 = AtomicU32::new(0);

/// A setup has come: what follows is for us.
pub(super) fn open() {
    if !IS_OPEN.swap(true, Ordering::Relaxed) {
        TAKEN.store(total(), Ordering::Relaxed);
    }
}

/// The bell has rung.
pub(super) fn wake() {
    WAKER.wake();
}

/// Takes what is there; the waker is woken by the bell.
pub(super) fn take(bytes: &mut [u8], waker: &Waker) -> usize {
    WAKER.register(waker);
    if !IS_OPEN.load(Ordering::Relaxed) {
        return 0;
    }
    let taken = TAKEN.load(Ordering::Relaxed);
    let count = (total().wrapping_sub(taken) as usize).min(bytes.len());
    for (index, byte) in bytes.iter_mut().take(count).enumerate() {
        let address = (PSRAM + LINE_AT + (taken as usize).wrapping_add(index) % LINE_BYTES) as *const u8;
        // SAFETY: inside the 16 MB PSRAM, where no Rust object lies; volatile, because somebody else writes there.
        *byte = unsafe { address.read_volatile() };
    }
    TAKEN.store(taken.wrapping_add(count as u32), Ordering::Relaxed);
    count
}

fn total() -> u32 {
    // SAFETY: word-aligned, and as above.
    let total = unsafe { ((PSRAM + LINE_TOTAL_AT) as *const u32).read_volatile() };
    fence(Ordering::Acquire);
    u32::from_le(total)
}
