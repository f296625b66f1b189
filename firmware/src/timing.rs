//! Measures the tasks; [`foxhound_computer::timing`] keeps the statistics.

use core::cell::RefCell;
use core::future::{Future, poll_fn};
use core::pin::pin;

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use foxhound_computer::timing::{CYCLES_PER_US, Table, Task, Times};

use crate::board::Board;

static TABLE: Mutex<CriticalSectionRawMutex, RefCell<Table>> =
    Mutex::new(RefCell::new([const { Times::new() }; Task::ALL.len()]));

/// Records a run of that many ticks of the board.
#[inline(never)]
pub fn note<B: Board>(task: Task, ticks: u32) {
    TABLE.lock(|table| {
        if let Some(times) = table.borrow_mut().get_mut(task as usize) {
            // The two are equal on the NUCLEO-G474RE.
            times.add((u64::from(ticks) * u64::from(CYCLES_PER_US) / u64::from(B::TICKS_PER_US)) as u32);
        }
    });
}

/// All times so far.
#[must_use]
pub fn table() -> Table {
    TABLE.lock(|table| *table.borrow())
}

/// A task of which every activation is measured.
pub async fn measured<B: Board, F: Future>(task: Task, future: F) -> F::Output {
    let mut future = pin!(future);
    poll_fn(|context| {
        let begin = B::ticks();
        let polled = future.as_mut().poll(context);
        note::<B>(task, B::ticks().wrapping_sub(begin));
        polled
    })
    .await
}
