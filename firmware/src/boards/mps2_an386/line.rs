//! Bytes of the autopilot, and of a camera, by the memory that we share with the simulator, as by DMA: layout in
//! `foxhound_computer::twin`.
//!
//! QEMU's serial line costs the simulator's machine a dozen changes of thread for every byte. A simulator that flies for hours
//! fills the rings before it rings the bell; one that fills nothing has UART0 and UART2. What was written before the setup of this start
//! was for the last one.

use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, fence};
use core::task::Waker;

use embassy_sync::waitqueue::AtomicWaker;
use foxhound_computer::twin::{LINE_AT, LINE_BYTES, LINE_TOTAL_AT, PORT_AT, PORT_BYTES, PORT_TOTAL_AT};

use super::PSRAM;

/// Of the autopilot.
pub(super) static AUTOPILOT: Line = Line::new(LINE_TOTAL_AT, LINE_AT, LINE_BYTES);
/// Of the maintenance port.
pub(super) static PORT: Line = Line::new(PORT_TOTAL_AT, PORT_AT, PORT_BYTES);

/// A ring in the shared memory.
pub(super) struct Line {
    total_at: usize,
    from: usize,
    length: usize,
    waker: AtomicWaker,
    is_open: AtomicBool,
    taken: AtomicU32,
}

impl Line {
    const fn new(total_at: usize, from: usize, length: usize) -> Self {
        let (is_open, taken) = (AtomicBool::new(false), AtomicU32::new(0));
        Self { total_at, from, length, waker: AtomicWaker::new(), is_open, taken }
    }

    /// A setup has come: what follows is for us.
    pub(super) fn open(&self) {
        if !self.is_open.swap(true, Ordering::Relaxed) {
            self.taken.store(self.total(), Ordering::Relaxed);
        }
    }

    /// The bell has rung.
    pub(super) fn wake(&self) {
        self.waker.wake();
    }

    /// Takes what is there; the waker is woken by the bell.
    pub(super) fn take(&self, bytes: &mut [u8], waker: &Waker) -> usize {
        self.waker.register(waker);
        if !self.is_open.load(Ordering::Relaxed) {
            return 0;
        }
        let taken = self.taken.load(Ordering::Relaxed);
        let count = (self.total().wrapping_sub(taken) as usize).min(bytes.len());
        for (index, byte) in bytes.iter_mut().take(count).enumerate() {
            let address = (PSRAM + self.from + (taken as usize).wrapping_add(index) % self.length) as *const u8;
            // SAFETY: inside the 16 MB PSRAM, where no Rust object lies; volatile, because somebody else writes there.
            *byte = unsafe { address.read_volatile() };
        }
        self.taken.store(taken.wrapping_add(count as u32), Ordering::Relaxed);
        count
    }

    fn total(&self) -> u32 {
        // SAFETY: word-aligned, and as above.
        let total = unsafe { ((PSRAM + self.total_at) as *const u32).read_volatile() };
        fence(Ordering::Acquire);
        u32::from_le(total)
    }
}
