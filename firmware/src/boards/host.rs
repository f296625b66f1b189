//! A board without hardware, for tests: it runs on the machine that builds it. Its surroundings are [`WORLD`].
//!
//! | part | here |
//! |---|---|
//! | autopilot, sensor, maintenance port | pipes: [`Wire`] |
//! | frames | orders, a step each, in lock-step: [`World::order`] |
//! | flash | memory: [`Flash`] |
//! | time | the world's own; constant during a step |
//! | watchdog | counts how often it is fed |
//!
//! The application is in statics, so a process is one board that is started once. There is no executor here: the code
//! that starts the board polls the tasks.

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use core::task::Poll;
use core::time::Duration;
use std::boxed::Box;
use std::collections::VecDeque;
use std::process;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::vec::Vec;

use embassy_sync::waitqueue::AtomicWaker;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::part::{self, BLANK, Refused};
use foxhound_computer::port::{Clock, Waiting};
use foxhound_computer::restart::{Cause, Restart};
use foxhound_computer::sampling::Timer;
use foxhound_computer::store::PAGES;
use foxhound_core::ConfigError;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::planning::planner::SAMPLES;
use foxhound_core::planning::rollout::Trajectory;

use crate::board::{self, Board, Call, Done, LockStep, Parts, Planned, Read, Step, Write};

/// Exit status of the process for a requested restart.
pub const RESTARTED: i32 = 75;

const PAGE_BYTES: usize = 2048;
const FLASH_BYTES: u32 = PAGES * PAGE_BYTES as u32;
/// How long the thread sleeps before it checks again: here nothing interrupts it.
const NAP: Duration = Duration::from_micros(50);

/// What surrounds the board.
pub static WORLD: World = World {
    autopilot: Wire::new(),
    sensor: Wire::new(),
    console: Wire::new(),
    orders: Mutex::new(VecDeque::new()),
    answers: Mutex::new(VecDeque::new()),
    flash: Mutex::new(Vec::new()),
    refuses_flash: AtomicBool::new(false),
    now_us: AtomicU64::new(0),
    feeds: AtomicU32::new(0),
};

/// What surrounds a board.
pub struct World {
    /// The autopilot's line.
    pub autopilot: Wire,
    /// The line of a lidar or a radio.
    pub sensor: Wire,
    /// The maintenance port.
    pub console: Wire,
    orders: Mutex<VecDeque<Order>>,
    answers: Mutex<VecDeque<Answer>>,
    /// Its flash, stored inverted; empty at first, which is a blank one.
    flash: Mutex<Vec<u8>>,
    /// The flash refuses everything.
    pub refuses_flash: AtomicBool,
    /// Its time.
    pub now_us: AtomicU64,
    /// How often the watchdog was fed.
    pub feeds: AtomicU32,
}

/// Two pipes.
pub struct Wire {
    coming: Mutex<VecDeque<u8>>,
    gone: Mutex<Vec<u8>>,
    /// Bytes sent to the board since the start.
    said: AtomicU32,
    waker: AtomicWaker,
}

/// An order to the board.
#[derive(Clone, Debug)]
pub enum Order {
    /// Begin anew with this configuration.
    Setup(Box<guidance::Config>),
    /// A step.
    Step {
        /// Its time.
        now: Instant,
        /// The measurement of the antennas.
        frame: Option<Box<AdcFrame<N>>>,
        /// Obstacles as circles.
        circles: Option<Vec<Circle>>,
    },
}

/// The result of an order.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "one at a time, in a test")]
pub enum Answer {
    /// A setup.
    Setup(Result<(), ConfigError>),
    /// A step.
    Step {
        /// Output of guidance.
        output: guidance::Output,
        /// A plan that was finished in it.
        plan: Option<Planned<[Trajectory; SAMPLES]>>,
    },
}

/// A thread that panics fails its test, and does no harm here.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl World {
    /// Gives the board an order; the time of a step is the world's from then on.
    pub fn order(&self, order: Order) {
        if let Order::Step { now, .. } = &order {
            self.now_us.store(now.0, Ordering::Relaxed);
        }
        lock(&self.orders).push_back(order);
    }

    /// The result of the oldest order that has been carried out.
    pub fn answer(&self) -> Option<Answer> {
        lock(&self.answers).pop_front()
    }
}

impl Wire {
    const fn new() -> Self {
        Self {
            coming: Mutex::new(VecDeque::new()),
            gone: Mutex::new(Vec::new()),
            said: AtomicU32::new(0),
            waker: AtomicWaker::new(),
        }
    }

    /// Sends bytes to the board.
    pub fn say(&self, bytes: &[u8]) {
        lock(&self.coming).extend(bytes);
        self.said.fetch_add(bytes.len() as u32, Ordering::Relaxed);
        self.waker.wake();
    }

    /// The bytes that the board has sent since the last call.
    pub fn heard(&self) -> Vec<u8> {
        core::mem::take(&mut lock(&self.gone))
    }

    fn take(&self, bytes: &mut [u8]) -> usize {
        let mut coming = lock(&self.coming);
        let count = coming.len().min(bytes.len());
        bytes.iter_mut().zip(coming.drain(..count)).for_each(|(to, from)| *to = from);
        count
    }
}

/// The board.
#[derive(Debug)]
pub struct Machine;

impl Board for Machine {
    const NAME: &'static str = "host";
    const TICKS_PER_US: u32 = 1;
    const SAMPLE_TIMER: Option<Timer> = None;

    type Spawner = ();
    type Receiver = Receiver;
    type Transmitter = Transmitter;
    type SensorReceiver = Receiver;
    type ConsoleReceiver = Receiver;
    type ConsoleTransmitter = Transmitter;
    type Pacer = Pacer;
    type Watchdog = Watchdog;
    type Flash = Flash;

    fn start() -> Parts<Self> {
        Parts {
            guidance: (),
            link: (),
            receiver: Receiver { wire: &WORLD.autopilot, most: 0 },
            transmitter: Transmitter(&WORLD.autopilot),
            sensor: Receiver { wire: &WORLD.sensor, most: 0 },
            console_receiver: Receiver { wire: &WORLD.console, most: 0 },
            console_transmitter: Transmitter(&WORLD.console),
            pacer: Pacer { order: Order::Step { now: Instant(0), frame: None, circles: None } },
            watchdog: Watchdog,
            restart: Restart { cause: Cause::Power, record: None },
            flash: Flash,
        }
    }

    fn ticks() -> u32 {
        Self::uptime_us() as u32
    }

    fn uptime_us() -> u64 {
        WORLD.now_us.load(Ordering::Relaxed)
    }

    fn sleep_unless(is_ready: impl Fn() -> bool) {
        if !is_ready() {
            thread::sleep(NAP);
        }
    }

    #[expect(clippy::print_stderr, reason = "where a board has a debugger")]
    fn halt(why: &str) -> ! {
        std::eprintln!("foxhound: {why}");
        process::exit(1)
    }

    fn restart() -> ! {
        process::exit(RESTARTED)
    }
}

/// The board's end of a wire, where bytes come in.
pub struct Receiver {
    wire: &'static Wire,
    most: u32,
}

impl Read for Receiver {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        poll_fn(|context| {
            self.wire.waker.register(context.waker());
            match self.wire.take(bytes) {
                0 => Poll::Pending,
                count => Poll::Ready(count),
            }
        })
        .await
    }
}

impl board::Receiver for Receiver {
    fn try_read(&mut self, bytes: &mut [u8]) -> usize {
        self.most = self.most.max(lock(&self.wire.coming).len() as u32);
        self.wire.take(bytes)
    }

    fn waiting(&self) -> Waiting {
        Waiting { most: self.most, room: u32::MAX, lost: 0 }
    }

    fn errors(&self) -> u32 {
        0
    }
}

/// The board's end of a wire, where bytes go out.
pub struct Transmitter(&'static Wire);

impl Write for Transmitter {
    async fn write(&mut self, bytes: &[u8]) {
        lock(&self.0.gone).extend_from_slice(bytes);
    }
}

/// Carries out the world's orders.
#[derive(Debug)]
pub struct Pacer {
    order: Order,
}

impl board::Pacer for Pacer {
    type Samples = [Trajectory; SAMPLES];

    async fn next(&mut self) -> Call<'_> {
        // The tasks are polled without end, and need no waker.
        self.order = poll_fn(|_| lock(&WORLD.orders).pop_front().map_or(Poll::Pending, Poll::Ready)).await;
        match &self.order {
            Order::Setup(config) => Call::Setup { config, needs_entry: false },
            Order::Step { now, frame, circles } => Call::Step(Step {
                now: *now,
                lock_step: Some(LockStep {
                    rx_expected: WORLD.autopilot.said.load(Ordering::Relaxed),
                    sensor_expected: WORLD.sensor.said.load(Ordering::Relaxed),
                    camera_expected: 0,
                    holds_plan: false,
                    begin: Machine::ticks,
                }),
                front_end: frame.as_deref().map_or(FrontEnd::Nothing, FrontEnd::Frame),
                circles: circles.as_deref(),
            }),
        }
    }

    async fn accept(&mut self, result: Result<(), ConfigError>, _tx_total: u32) {
        lock(&WORLD.answers).push_back(Answer::Setup(result));
    }

    async fn done(&mut self, done: Done<'_, Self::Samples>) {
        let plan = done.plan.cloned();
        lock(&WORLD.answers).push_back(Answer::Step { output: done.output, plan });
    }

    fn clock(&self) -> Clock {
        Clock::Simulated
    }

    fn stack_bytes(&self) -> u32 {
        0
    }
}

/// Counts how often it is fed.
#[derive(Debug)]
pub struct Watchdog;

impl board::Watchdog for Watchdog {
    const PERIOD_US: u32 = 500_000;

    fn feed(&mut self) {
        WORLD.feeds.fetch_add(1, Ordering::Relaxed);
    }
}

/// The world's flash: pages and words as those of the STM32G4 ([`foxhound_computer::part`]).
#[derive(Debug)]
pub struct Flash;

/// The words of some bytes of the flash, inverted as they are stored.
fn words(flash: &mut Vec<u8>, from: u32, bytes: usize) -> Result<&mut [[u8; 8]], Refused> {
    if WORLD.refuses_flash.load(Ordering::Relaxed) {
        return Err(Refused::Failed);
    }
    flash.resize(FLASH_BYTES as usize, 0);
    let bytes = flash.get_mut(from as usize..from as usize + bytes).ok_or(Refused::Outside)?;
    Ok(bytes.as_chunks_mut().0)
}

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 8;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Refused> {
        part::flash(offset, bytes.len(), 8, FLASH_BYTES)?;
        let mut flash = lock(&WORLD.flash);
        let words = words(&mut flash, offset, bytes.len())?;
        for (to, from) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(words) {
            *to = from.map(|byte| !byte);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        FLASH_BYTES as usize
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = PAGE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Refused> {
        let length = to.saturating_sub(from) as usize;
        part::flash(from, length, PAGE_BYTES as u32, FLASH_BYTES)?;
        words(&mut lock(&WORLD.flash), from, length)?.fill((!BLANK).to_le_bytes());
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Refused> {
        part::flash(offset, bytes.len(), 8, FLASH_BYTES)?;
        let mut flash = lock(&WORLD.flash);
        for (word, wanted) in words(&mut flash, offset, bytes.len())?.iter_mut().zip(bytes.as_chunks::<8>().0) {
            let taken = part::program(!u64::from_le_bytes(*word), u64::from_le_bytes(*wanted));
            // A word that is not blank is struck out by any other value.
            *word = taken.map_or([0xff; 8], |()| wanted.map(|byte| !byte));
            taken?;
        }
        Ok(())
    }
}
