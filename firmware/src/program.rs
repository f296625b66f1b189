//! The program: the application on the chosen board. Starts the board, creates the channels, spawns the tasks.
//!
//! It is part of the library, so that the compiler makes one copy of `core`'s code for a number of samples, as in the
//! benchmark.

use crate::app::{self, Begun, Desk, Kept, Line, Outgoing, Planning, Shared, State};
use crate::board::{Board, Parts};
use crate::boards::Chosen;
use crate::console::{self, Console};
use embassy_executor::SpawnToken;
use foxhound_computer::camera::Camera;
use foxhound_computer::log::ring::Consumer;
use foxhound_computer::restart::Restart;

static OUTGOING: Outgoing = Outgoing::new();
static PLANNER: Shared<Kept<Chosen>> = Shared::new();

/// Runs it.
pub fn run() -> ! {
    app::plan::<Chosen>(start())
}

/// Its own function, so that the stack does not hold it while the planner runs.
#[inline(never)]
fn start() -> Desk<Kept<Chosen>> {
    start_with(app::first_state())
}

#[inline(never)]
fn start_with(state: &'static mut State) -> Desk<Kept<Chosen>> {
    let board: Parts<Chosen> = Chosen::start();
    let ready =
        app::begin_with(state, board.flash).and_then(|begun| Ok((begun.detector()?, begun, app::planning(&PLANNER)?)));
    let (detector, begun, (planning, desk)) = match ready {
        Ok(all) => all,
        Err(error) => app::refuse::<Chosen>(error),
    };
    board.link.spawn(task(transmit(board.transmitter)));
    let (console, log, camera) = console::ends(detector);
    board.link.spawn(task(listen(board.console_receiver, camera)));
    board.link.spawn(task(speak(board.console_transmitter, log)));
    let line = Line::new(board.receiver, board.sensor, &OUTGOING);
    board.guidance.spawn(task(guide(board.pacer, board.watchdog, board.restart, begun, line, console, planning)));
    desk
}

/// A task that is spawned once cannot be refused.
fn task<S>(token: Result<SpawnToken<S>, embassy_executor::SpawnError>) -> SpawnToken<S> {
    match token {
        Ok(token) => token,
        Err(_) => Chosen::halt("a task was spawned twice"),
    }
}

// The tasks of `app` and `console` for this board: tasks of the executor cannot have type parameters.

#[embassy_executor::task]
fn transmit(line: <Chosen as Board>::Transmitter) -> impl Future<Output = ()> {
    app::transmit::<Chosen>(line, &OUTGOING)
}

#[embassy_executor::task]
fn listen(line: <Chosen as Board>::ConsoleReceiver, camera: &'static mut Camera) -> impl Future<Output = ()> {
    console::listen::<Chosen>(line, camera)
}

#[embassy_executor::task]
fn speak(line: <Chosen as Board>::ConsoleTransmitter, log: Consumer<'static>) -> impl Future<Output = ()> {
    console::speak::<Chosen>(line, log)
}

#[embassy_executor::task]
fn guide(
    pacer: <Chosen as Board>::Pacer,
    watchdog: <Chosen as Board>::Watchdog,
    restart: Restart,
    begun: Begun<Chosen>,
    line: Line<Chosen>,
    console: Console,
    planning: Planning<Kept<Chosen>>,
) -> impl Future<Output = ()> {
    app::guide(pacer, watchdog, restart, begun, line, console, planning)
}
