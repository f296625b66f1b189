//! The maintenance port: it sends the flight log and answers, and receives lines and the frames of a camera.
//!
//! Frames are processed here, line by line as they arrive ([`foxhound_computer::camera`]), in the time left by
//! guidance; guidance gets the result with its next step. Guidance writes the log and carries out typed commands, one
//! per step; what the tasks here do has a lower priority than guidance. If the port is too
//! slow, or not connected, only the log suffers.

use core::sync::atomic::{AtomicU32, Ordering};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use foxhound_computer::camera::{self, Came, Camera, Detector, Sighted};
use foxhound_computer::log::ring::{Consumer, Ring};
use foxhound_computer::log::{Log, State};
use foxhound_computer::port::{Command, Lines, Status, Waiting};
use foxhound_computer::timing::Task;
use foxhound_core::ConfigError;
use foxhound_core::guidance;
use foxhound_core::guidance::mission::Control;
use foxhound_core::landing::observation::PadObservation;
use heapless::Vec;
use static_cell::{ConstStaticCell, StaticCell};

use crate::board::{Board, Read as _, Step, Write as _};
use crate::timing::{self, measured};

/// Space for the records of a step and the samples of a frame.
const RING_BYTES: usize = 2048;

static RING: ConstStaticCell<Ring<RING_BYTES>> = ConstStaticCell::new(Ring::new());
/// Bytes that were typed and not yet read.
static TYPED: Pipe<CriticalSectionRawMutex, 48> = Pipe::new();
/// Signals: there is something in the ring; the ring was empty and everything is sent.
static NEWS: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static SENT: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Bytes that are taken in at a time.
const PIECE_BYTES: usize = 64;

/// Result of the camera's latest frame.
static SIGHTED: Signal<CriticalSectionRawMutex, Sighted> = Signal::new();
/// A new detector for the next frames.
static DETECTOR: Signal<CriticalSectionRawMutex, Detector> = Signal::new();
/// The height over the ground, as bits; NaN if unknown.
static HEIGHT_M: AtomicU32 = AtomicU32::new(0);
/// Bytes of frames that were processed since the start; and a signal for more.
static LOOKED_AT: AtomicU32 = AtomicU32::new(0);
static PROGRESS: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Guidance's end.
pub struct Console {
    /// The flight log, which also carries the answers.
    pub log: Log<'static>,
    lines: Lines,
    /// The next part of the status, while it is printed.
    telling: Option<usize>,
    /// The largest number of bytes of the log that waited at once.
    most_waiting: usize,
}

/// Parts of the status that are printed per step: the log has space for them.
const PARTS: usize = 5;

/// The ends of the log and of the lines, and the camera. Call it once.
#[inline(never)]
pub fn ends(detector: Detector) -> (Console, Consumer<'static>, &'static mut Camera) {
    static CAMERA: StaticCell<Camera> = StaticCell::new();
    let (producer, consumer) = RING.take().ends();
    let console =
        Console { log: Log::resume(producer, State::default()), lines: Lines::new(), telling: None, most_waiting: 0 };
    (console, consumer, CAMERA.init_with(|| Camera::new(detector)))
}

impl Console {
    /// The next typed command that may be carried out now; others are answered.
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

    /// The camera's observation since the last step; in lock-step as soon as all bytes that belong before this step
    /// are processed.
    ///
    /// `feed` is called for each processed piece of a frame: a whole frame at once takes longer than a step.
    pub async fn look(&self, step: &Step<'_>, mut feed: impl FnMut()) -> Option<PadObservation> {
        if let Some(lock_step) = &step.lock_step {
            while LOOKED_AT.load(Ordering::Relaxed) != lock_step.camera_expected {
                PROGRESS.wait().await;
                feed();
            }
        }
        SIGHTED.try_take().map(|sighted| sighted.look(step.now))
    }

    /// Sets the vehicle's height for the next frame, if known.
    pub fn set_height(&self, height_m: Option<f32>) {
        HEIGHT_M.store(height_m.unwrap_or(f32::NAN).to_bits(), Ordering::Relaxed);
    }

    /// Uses the pad and camera of the configuration that guidance runs with.
    ///
    /// # Errors
    /// The field of the configuration for which there is no detector; the one before is kept.
    pub fn set_detector(&self, config: &guidance::Config) -> Result<(), ConfigError> {
        DETECTOR.signal(camera::detector(config)?);
        Ok(())
    }

    /// The status was requested.
    pub const fn begin_status(&mut self) {
        self.telling = Some(0);
    }

    /// Whether a part of the status is still to be printed.
    #[must_use]
    pub const fn is_telling(&self) -> bool {
        self.telling.is_some()
    }

    /// Prints the next parts of the status.
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

    /// Waits until all of the log is sent: when a simulator waits for us, and before an end.
    pub async fn drain(&self) {
        SENT.reset();
        NEWS.signal(());
        SENT.wait().await;
        while !self.log.is_drained() {
            // The signal was for earlier bytes.
            NEWS.signal(());
            SENT.wait().await;
        }
    }
}

/// Receives typed bytes, and the frames of a camera. If lines come faster than guidance reads them, both wait.
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

/// Processes frames; the remaining bytes were typed.
#[inline(never)]
fn look_at(camera: &mut Camera, bytes: &[u8]) -> Vec<u8, PIECE_BYTES> {
    if let Some(detector) = DETECTOR.try_take() {
        camera.set_detector(detector);
    }
    let mut typed = Vec::new();
    let height_m = Some(f32::from_bits(HEIGHT_M.load(Ordering::Relaxed))).filter(|height_m| height_m.is_finite());
    for byte in bytes {
        match camera.push(*byte, height_m) {
            // There is space for all of them.
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
