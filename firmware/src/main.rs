//! Foxhound: starts the board, creates the channels, spawns the tasks.
#![no_std]
#![no_main]

use embassy_executor::SpawnToken;
use foxhound_firmware::app::{self, Desk, Line, Outgoing};
use foxhound_firmware::boards::board;
use foxhound_firmware::console;

static OUTGOING: Outgoing = Outgoing::new();

#[cortex_m_rt::entry]
fn main() -> ! {
    app::plan(start())
}

/// Its own function, so that the stack does not hold it while the planner runs.
#[inline(never)]
fn start() -> Desk {
    let board = board::start();
    let ready = app::begin_with(board.flash).and_then(|begun| Ok((begun.detector()?, begun, app::planning()?)));
    let (detector, begun, (planning, desk)) = match ready {
        Ok(all) => all,
        Err(error) => app::refuse(error),
    };
    board.link.spawn(task(app::transmit(board.transmitter, &OUTGOING)));
    let (port, log, camera) = console::ends(detector);
    board.link.spawn(task(console::listen(board.port_receiver, camera)));
    board.link.spawn(task(console::speak(board.port_transmitter, log)));
    let line = Line::new(board.receiver, &OUTGOING);
    let guide = app::guide(board.pacer, board.watchdog, board.restart, begun, line, port, planning);
    board.guidance.spawn(task(guide));
    desk
}

/// A task that is spawned once cannot be refused.
fn task<S>(token: Result<SpawnToken<S>, embassy_executor::SpawnError>) -> SpawnToken<S> {
    match token {
        Ok(token) => token,
        Err(_) => board::halt(format_args!("a task was spawned twice")),
    }
}
