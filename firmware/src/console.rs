//! The maintenance port: the flight log and answers go out by it, lines and the frames of a camera come in.
//!
//! Frames are looked at here, line by line as they come ([`foxhound_computer::camera`]), in the time that guidance leaves;
//! it gets what they show with its next step. Guidance writes the log and carries out what lines say, a command a step; the tasks here only move bytes, and run behind
//! the autopilot's line. Where the port is too slow, or nobody is there, the log is what suffers.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use foxhound_computer::camera::{self, Came, Camera, Sighted};
use foxhound_computer::log::ring::{Consumer, Ring};
use foxhound_computer::log::{Log, State};
use foxhound_computer::port::{Command, Lines, Status, Waiting};
use foxhound_computer::timing::Task;
use foxhound_core::ConfigError;
use foxhound_core::guidance;
use foxhound_core::guidance::mission::Control;
use foxhound_core::landing::observation::PadObservation;
use foxhound_pad::Detector;
use heapless::Vec;
use static_cell::{ConstStaticCell, StaticCell};

use crate::board::{Board, Read as _, Step, Write as _};
use crate::timing::{self, measured};

/// What a step brings, and the codes of a frame.
const RING_BYTES: usize = 2048;

static RING: ConstStaticCell<Ring<RING_BYTES>> = ConstStaticCell::new(Ring::new());
/// Bytes that were typed and not yet read.
static TYPED: Pipe<CriticalSectionRawMutex, 48> = Pipe::new();
/// There is something in the ring; there was nothing more in it, and all is sent.
static NEWS: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static SENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Bytes that are taken in at a time.
const PIECE_BYTES: usize = 64;

/// What the camera's latest frame came to.
static SIGHTED: Signal<CriticalSectionRawMutex, Sighted> = Signal::new();
/// What pad it looks for from now on.
static DETECTOR: Signal<CriticalSectionRawMutex, Detector> = Signal::new();
/// The height over the ground, as bits; not a number where nobody knows it.
static HEIGHT_M: AtomicU32 = AtomicU32::new(0);
/// Bytes of frames that were looked at since the start; and there are more.
static LOOKED_AT: AtomicU32 = AtomicU32::new(0);
static PROGRESS: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Guidance's end.
pub struct Console {
    /// The flight log, which carries the answers, too.
    pub log: Log<'static>,
    lines: Lines,
    /// The next part of the status, while that is told.
    telling: Option<usize>,
    /// Bytes of the log that have waited at once, at most.
    most_waiting: usize,
}

/// Parts of the status that are told in a step: the log has room for them.
const PARTS: usize = 5;

/// The ends of the log and of the lines, and the camera. To be called once.
#[inline(never)]
pub fn ends(detector: Detector) -> (Console, Consumer<'static>, &'static mut Camera) {
    static CAMERA: StaticCell<Camera> = StaticCell::new();
    let (producer, consumer) = RING.take().ends();
    let console =
        Console { log: Log::resume(producer, State::default()), lines: Lines::new(), telling: None, most_waiting: 0 };
    (console, consumer, CAMERA.init_with(|| Camera::new(detector)))
}

impl Console {
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

    /// What the camera has seen since the last step; in lock-step as soon as all that belongs before this step was looked at.
    ///
    /// `feed` is called as often as a piece of a frame was looked at: a whole frame at once takes longer than a step.
    pub async fn look(&self, step: &Step<'_>, mut feed: impl FnMut()) -> Option<PadObservation> {
        if let Some(lock_step) = &step.lock_step {
            while LOOKED_AT.load(Ordering::Relaxed) != lock_step.camera_expected {
                PROGRESS.wait().await;
                feed();
            }
        }
        SIGHTED.try_take().map(|sighted| sighted.look(step.now))
    }

    /// What the next frame is looked at with: how high the vehicle is, where that is known.
    pub fn set_height(&self, height_m: Option<f32>) {
        HEIGHT_M.store(height_m.unwrap_or(f32::NAN).to_bits(), Ordering::Relaxed);
    }

    /// Another pad is looked for, or with another camera: of a configuration that guidance runs with.
    ///
    /// # Errors
    /// The field of the configuration for which there is no detector; the one before it goes on.
    pub fn set_detector(&self, config: &guidance::Config) -> Result<(), ConfigError> {
        DETECTOR.signal(camera::detector(config)?);
        Ok(())
    }

    /// Somebody wants to know how it is.
    pub const fn begin_status(&mut self) {
        self.telling = Some(0);
    }

    /// Whether some of the status is still to be told.
    #[must_use]
    pub const fn is_telling(&self) -> bool {
        self.telling.is_some()
    }

    /// Tells the next parts of the status.
    #[inline(never)]
    pub fn tell(&mut self, status: &Status<'_>) {
        let from = self.telling.unwrap_or(0);
        let until = (from + PARTS).min(Status::LINES);
        let times = timing::table();
        (from..until).for_each(|part| status.tell(part, &times, |line| self.log.text(line)));
        self.telling = Some(until).filter(|until| *until < Status::LINES);
    }

    /// How full the log was.
    #[must_use]
    pub fn waiting(&self) -> Waiting {
        Waiting { most: self.most_waiting as u32, room: RING_BYTES as u32 - 1, lost: self.log.lost() }
    }

    /// Lets the log be sent.
    pub fn flush(&mut self) {
        self.most_waiting = self.most_waiting.max(self.log.waiting());
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

/// Bytes that somebody types, and the frames of a camera. Where lines come faster than guidance reads them, all waits.
pub async fn listen<B: Board>(mut line: B::ConsoleReceiver, camera: &'static mut Camera) {
    measured::<B, _>(Task::Listen, async {
        let mut bytes = [0; PIECE_BYTES];
        loop {
            let count = line.read(&mut bytes).await;
            let typed = look_at(camera, bytes.get(..count).unwrap_or_default());
            TYPED.write_all(&typed).await;
        }
    })
    .await;
}

/// Takes frames in; what is left was typed.
#[inline(never)]
fn look_at(camera: &mut Camera, bytes: &[u8]) -> Vec<u8, PIECE_BYTES> {
    if let Some(detector) = DETECTOR.try_take() {
        camera.set_detector(detector);
    }
    let mut typed = Vec::new();
    let height_m = Some(f32::from_bits(HEIGHT_M.load(Ordering::Relaxed))).filter(|height_m| height_m.is_finite());
    for byte in bytes {
        match camera.push(*byte, height_m) {
            // There is room for all of them.
            Some(Came::Text(byte)) => typed.push(byte).unwrap_or(()),
            Some(Came::Sighted(sighted)) => SIGHTED.signal(sighted),
            None => {}
        }
    }
    LOOKED_AT.fetch_add((bytes.len() - typed.len()) as u32, Ordering::Relaxed);
    PROGRESS.signal(());
    typed
}

/// The log, onto the port.
pub async fn speak<B: Board>(mut line: B::ConsoleTransmitter, mut log: Consumer<'static>) {
    measured::<B, _>(Task::Speak, async {
        let mut bytes = [0; 64];
        loop {
            let count = log.read(&mut bytes);
            if count == 0 {
                SENT.signal(());
                NEWS.wait().await;
                continue;
            }
            line.write(bytes.get(..count).unwrap_or_default()).await;
        }
    })
    .await;
}
