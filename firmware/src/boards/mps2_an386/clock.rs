//! Embassy's time from two CMSDK timers: timer 0 runs freely at 25 MHz and is extended to 64 bits by its interrupt,
//! timer 1 runs out at the next alarm.
//!
//! Under `-icount shift=8` the machine's time, and with it timer 0, moves 256 ns or 6.4 ticks an instruction.

use core::cell::{Cell, RefCell};
use core::task::Waker;

use critical_section::{CriticalSection, Mutex};
use embassy_time_driver::{Driver, TICK_HZ};
use embassy_time_queue_utils::Queue;

use super::interrupt::{Interrupt, unmask};
use super::registers::{Register, TIMER0, TIMER1};
use crate::register_values::{alarm_count, wide_count};

const TIMER_HZ: u64 = 25_000_000;
const PER_TICK: u64 = TIMER_HZ / TICK_HZ;

/// Ticks of [`ticks`] per microsecond of the chip that the twin stands for: 170 MHz and 1.5 cycles an instruction are
/// 113 instructions, and an instruction takes 6.4 ticks here.
pub const TICKS_PER_US: u32 = 725;

const ENABLE: u32 = 1;
const INTERRUPT_ENABLE: u32 = 1 << 3;

struct Clock {
    /// How often timer 0 has wrapped.
    wraps: Mutex<Cell<u32>>,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock {
    wraps: Mutex::new(Cell::new(0)),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// Starts the time.
pub fn start() {
    TIMER0.write(Register::TIMER_RELOAD, u32::MAX);
    TIMER0.write(Register::TIMER_VALUE, u32::MAX);
    TIMER0.write(Register::TIMER_CONTROL, ENABLE | INTERRUPT_ENABLE);
    unmask(Interrupt::Timer0);
    unmask(Interrupt::Timer1);
}

/// Ticks of the 25 MHz timer; wraps after 171 s.
#[must_use]
pub fn ticks() -> u32 {
    !TIMER0.read(Register::TIMER_VALUE)
}

impl Clock {
    /// Sets the alarm; false if it is too late for that.
    fn set_alarm(&self, at: u64) -> bool {
        TIMER1.write(Register::TIMER_CONTROL, 0);
        TIMER1.write(Register::Interrupt, 1);
        if at == u64::MAX {
            return true;
        }
        // A distant alarm rings early, finds nothing to do and is set again.
        let Some(wait) = alarm_count(self.now(), at, PER_TICK) else { return false };
        TIMER1.write(Register::TIMER_RELOAD, wait);
        TIMER1.write(Register::TIMER_VALUE, wait);
        TIMER1.write(Register::TIMER_CONTROL, ENABLE | INTERRUPT_ENABLE);
        true
    }

    fn wake_expired(&self, section: CriticalSection<'_>) {
        let mut queue = self.queue.borrow_ref_mut(section);
        let mut next = queue.next_expiration(self.now());
        while !self.set_alarm(next) {
            next = queue.next_expiration(self.now());
        }
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        critical_section::with(|section| {
            let mut low = ticks();
            let mut high = self.wraps.borrow(section).get();
            if TIMER0.read(Register::Interrupt) & 1 != 0 {
                // Wrapped, and the interrupt has not come through yet.
                low = ticks();
                high = high.wrapping_add(1);
            }
            wide_count(high, low) / PER_TICK
        })
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|section| {
            if self.queue.borrow_ref_mut(section).schedule_wake(at, waker) {
                self.wake_expired(section);
            }
        });
    }
}

pub(super) extern "C" fn on_wrap() {
    critical_section::with(|section| {
        TIMER0.write(Register::Interrupt, 1);
        let wraps = CLOCK.wraps.borrow(section);
        wraps.set(wraps.get().wrapping_add(1));
    });
}

pub(super) extern "C" fn on_alarm() {
    critical_section::with(|section| CLOCK.wake_expired(section));
}
