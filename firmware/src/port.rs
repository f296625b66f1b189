//! The maintenance port: the flight log and answers go out by it, lines come in.
//!
//! Guidance writes the log and carries out what lines say, a command a step; the tasks here only move bytes, and run behind
//! the autopilot's line. Where the port is too slow, or nobody is there, the log is what suffers.

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use foxhound_computer::log::ring::{Consumer, Ring};
use foxhound_computer::log::{Log, State};
use foxhound_computer::port::{Command, Lines};
use foxhound_core::mission::Control;
use static_cell::ConstStaticCell;

use crate::boards::board::{PortReceiver, PortTransmitter};

/// What a step brings, and the codes of a frame.
const RING_BYTES: usize = 2048;

static RING: ConstStaticCell<Ring<RING_BYTES>> = ConstStaticCell::new(Ring::new());
/// Bytes that were typed and not yet read.
static TYPED: Pipe<CriticalSectionRawMutex, 48> = Pipe::new();
/// There is something in the ring; there was nothing more in it, and all is sent.
static NEWS: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static SENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Guidance's end.
pub struct Port {
    /// The flight log, which carries the answers, too.
    pub log: Log<'static>,
    lines: Lines,
}

/// Both ends. To be called once.
pub fn ends() -> (Port, Consumer<'static>) {
    let (producer, consumer) = RING.take().ends();
    (Port { log: Log::resume(producer, State::default()), lines: Lines::new() }, consumer)
}

impl Port {
    /// The next command that was typed and may be carried out now; others are answered.
    #[inline(never)]
    pub fn command(&mut self, control: Control) -> Option<Command> {
        let mut byte = [0];
        while TYPED.try_read(&mut byte).is_ok() {
            let Some(line) = self.lines.push(byte[0]) else { continue };
            match line.map_err(|refusal| refusal.words()).and_then(|command| command.admit(control)) {
                Ok(command) => return Some(command),
                Err(words) => self.log.text(words),
            }
        }
        None
    }

    /// Lets the log be sent.
    pub fn flush(&self) {
        if !self.log.is_drained() {
            NEWS.signal(());
        }
    }

    /// Waits until all of the log is sent: where a simulator waits for us, and before an end.
    pub async fn drain(&self) {
        SENT.reset();
        NEWS.signal(());
        SENT.wait().await;
        while !self.log.is_drained() {
            // That was said of what came before.
            NEWS.signal(());
            SENT.wait().await;
        }
    }
}

/// Bytes that somebody types. Where they come faster than guidance reads them, the line waits.
#[embassy_executor::task]
pub async fn listen(mut line: PortReceiver) {
    let mut bytes = [0; 16];
    loop {
        let count = line.read(&mut bytes).await;
        TYPED.write_all(bytes.get(..count).unwrap_or_default()).await;
    }
}

/// The log, onto the port.
#[embassy_executor::task]
pub async fn speak(mut line: PortTransmitter, mut log: Consumer<'static>) {
    let mut bytes = [0; 64];
    loop {
        let count = log.read(&mut bytes);
        if count == 0 {
            SENT.signal(());
            NEWS.wait().await;
        }
        line.write(bytes.get(..count).unwrap_or_default()).await;
    }
}
