//! Foxhound: starts the board, creates the channels, spawns the tasks.
#![no_std]
#![no_main]

use embassy_executor::SpawnToken;
use foxhound_firmware::app::{self, Incoming, Orders, Outgoing, Plans};
use foxhound_firmware::boards::board;

static INCOMING: Incoming = Incoming::new();
static OUTGOING: Outgoing = Outgoing::new();
static ORDERS: Orders = Orders::new();
static PLANS: Plans = Plans::new();

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board::start();
    board.urgent.spawn(task(app::receive(board.receiver, &INCOMING)));
    board.urgent.spawn(task(app::transmit(board.transmitter, &OUTGOING)));
    board.urgent.spawn(task(app::guide(board.pacer, &INCOMING, &OUTGOING, &ORDERS, &PLANS)));
    board.relaxed.spawn(task(app::plan(&ORDERS, &PLANS)));

    // Everything runs in interrupts; the thread sleeps.
    loop {
        cortex_m::asm::wfi();
    }
}

/// A task that is spawned once cannot be refused.
fn task<S>(token: Result<SpawnToken<S>, embassy_executor::SpawnError>) -> SpawnToken<S> {
    match token {
        Ok(token) => token,
        Err(_) => board::halt(format_args!("a task was spawned twice")),
    }
}
