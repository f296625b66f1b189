//! The record that the program writes before it ends: after a panic, a fault of the processor, or a board that cannot
//! continue.
//!
//! The record is in memory that neither a reset nor the start-up code writes (`.uninit`); after the restart it is
//! reported to the pilot and erased. Every end of the program is a reset, and the computer comes up in standby.
//! Without setpoints the autopilot stops by itself meanwhile.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::ops::Range;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SCB;
use foxhound_computer::restart::{self, End, Record, TEXT_BYTES, WORDS, decimal};

use crate::board::Board;

/// A board that can print why the program ends, and knows its data memory.
pub(crate) trait CrashOutput: Board {
    /// Data memory.
    const MEMORY: Range<u32>;
    /// Prints why the program ends, to a debugger or simulator.
    fn print_end(what: &str, text: &str);
}

/// Words that a reset does not clear.
struct Kept(UnsafeCell<MaybeUninit<[u32; WORDS]>>);

// SAFETY: touched at the start, before anything else runs, and at the end, when nothing else runs any more.
unsafe impl Sync for Kept {}

// SAFETY: the section is one that the start-up code does not write; nothing else lies by that name.
#[unsafe(link_section = ".uninit.foxhound_kept")]
static KEPT: Kept = Kept(UnsafeCell::new(MaybeUninit::uninit()));

/// The record of the last run, if any. Call it once, at the start.
pub(crate) fn take() -> Option<Record> {
    let kept = KEPT.0.get().cast::<[u32; WORDS]>();
    // SAFETY: aligned and ours, see `Kept`. Any words are valid ones, and volatile access does not care who wrote them.
    let mut words = unsafe { kept.read_volatile() };
    let record = restart::take(&mut words);
    // SAFETY: as above.
    unsafe { kept.write_volatile(words) };
    record
}

/// Whether the program has been running in this memory before; from now on it has. After a long loss of power memory
/// holds anything.
pub(crate) fn was_running() -> bool {
    /// Set since the program has begun.
    // SAFETY: as for `KEPT`; any bits are a valid one.
    #[unsafe(link_section = ".uninit.foxhound_warm")]
    static WARM: AtomicU32 = AtomicU32::new(0);
    const IS_WARM: u32 = 0x3A9C_71E5;
    WARM.swap(IS_WARM, Ordering::Relaxed) == IS_WARM
}

/// Writes the record, and restarts.
pub(crate) fn end<B: Board>(end: End, address: u32, status: u32, text: &[u8]) -> ! {
    keep::<B>(end, address, status, text);
    SCB::sys_reset()
}

/// The same with words for a debugger. The record comes first: what prints may be what failed.
pub(crate) fn end_saying<B: CrashOutput>(end: End, address: u32, status: u32, text: &str) -> ! {
    if keep::<B>(end, address, status, text.as_bytes()) {
        let what = match end {
            End::Panic => "panic at",
            End::Fault => "fault",
            End::Watchdog => "watchdog",
            _ => "halt:",
        };
        B::print_end(what, text);
    }
    SCB::sys_reset()
}

/// Writes the record, unless there is one: then this is the end of an end. Whether it did.
fn keep<B: Board>(end: End, address: u32, status: u32, text: &[u8]) -> bool {
    cortex_m::interrupt::disable();
    let kept = KEPT.0.get().cast::<[u32; WORDS]>();
    // SAFETY: as in `take`, which has erased the last run's record.
    if restart::is_begun(&unsafe { kept.read_volatile() }) {
        return false;
    }
    let record = Record::new(end, address, status, B::uptime_s(), text);
    // SAFETY: interrupts are off, and only a fault can come, which ends in here and writes nothing.
    unsafe { kept.write_volatile(record.encode()) };
    true
}

/// A requested restart.
pub(crate) fn restart<B: Board>() -> ! {
    end::<B>(End::Wanted, 0, 0, b"")
}

/// The end of a panic.
pub(crate) fn panicked<B: CrashOutput>(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    let mut text = Tail { bytes: [0; TEXT_BYTES], length: 0 };
    if let Some(location) = info.location() {
        text.add(location.file());
        text.add(":");
        text.add(decimal(location.line(), &mut [0; 10]));
    }
    end_saying::<B>(End::Panic, 0, 0, text.text())
}

/// The end of a fault: `frame` is where the processor has stacked its registers, or would have.
pub(crate) extern "C" fn fault<B: CrashOutput>(frame: u32) -> ! {
    // SAFETY: reading this register has no effect.
    let status = unsafe { (*SCB::PTR).cfsr.read() };
    end_saying::<B>(End::Fault, interrupted(frame, &B::MEMORY), status, "")
}

/// Where the program was, if its registers are in memory.
pub(crate) fn interrupted(frame: u32, memory: &Range<u32>) -> u32 {
    if !(memory.start..memory.end - 32).contains(&frame) {
        return 0;
    }
    // SAFETY: `frame` is a word-aligned place in RAM; the processor keeps its stack pointer so.
    unsafe { ((frame & !3) as *const u32).wrapping_add(6).read_volatile() }
}

/// The last bytes of a text.
struct Tail {
    bytes: [u8; TEXT_BYTES],
    length: usize,
}

impl Tail {
    fn text(&self) -> &str {
        self.bytes.get(..self.length).and_then(|bytes| str::from_utf8(bytes).ok()).unwrap_or("?")
    }

    fn add(&mut self, text: &str) {
        for byte in text.bytes() {
            if let Some(free) = self.bytes.get_mut(self.length) {
                *free = byte;
                self.length += 1;
            } else {
                self.bytes.rotate_left(1);
                if let Some(last) = self.bytes.last_mut() {
                    *last = byte;
                }
            }
        }
    }
}
