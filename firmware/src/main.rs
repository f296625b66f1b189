//! Foxhound: starts the board, creates the channels, spawns the tasks.
#![no_std]
#![no_main]

use embassy_executor::SpawnToken;
use foxhound_firmware::app::{self, Bytes, Orders, Plans};
use foxhound_firmware::boards::board;
use static_cell::StaticCell;

static INCOMING: StaticCell<Bytes> = StaticCell::new();
static OUTGOING: StaticCell<Bytes> = StaticCell::new();
static ORDERS: StaticCell<Orders> = StaticCell::new();
static PLANS: StaticCell<Plans> = StaticCell::new();

#[cortex_m_rt::entry]
fn main() -> ! {
    let board = board::start();
    let incoming: &Bytes = INCOMING.init(Bytes::new());
    let outgoing: &Bytes = OUTGOING.init(Bytes::new());
    let orders: &Orders = ORDERS.init(Orders::new());
    let plans: &Plans = PLANS.init(Plans::new());

    board.urgent.spawn(task(app::receive(board.receiver, incoming)));
    board.urgent.spawn(task(app::transmit(board.transmitter, outgoing)));
    board.urgent.spawn(task(app::guide(board.pacer, incoming, outgoing, orders, plans)));
    board.relaxed.spawn(task(app::plan(orders, plans)));

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
