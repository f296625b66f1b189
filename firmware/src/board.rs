//! The interface between application and board. `boards` has one file for each board; `app` and `console` know
//! nothing else of them.
//!
//! Most boards can use the defaults given here. `docs/contributing.md` describes how to add a board.

use core::future::{Future, pending};

use embedded_storage::nor_flash::NorFlash;
use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::port::{Clock, Waiting};
use foxhound_computer::restart::Restart;
use foxhound_computer::sampling::Timer;
use foxhound_core::ConfigError;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::planning::planner::Answer;
use foxhound_core::planning::rollout::{Trajectory, WAYPOINTS};

/// A board.
pub trait Board: Sized + 'static {
    /// Its name in `--board` and in the image's `.foxhound_board` section.
    const NAME: &'static str;
    /// Ticks of [`ticks`](Self::ticks) per microsecond.
    const TICKS_PER_US: u32;
    /// The sample timer, if not every rate is possible.
    const SAMPLE_TIMER: Option<Timer>;

    /// Starts tasks.
    type Spawner;
    /// From the autopilot.
    type Receiver: Receiver;
    /// To the autopilot.
    type Transmitter: Write;
    /// From a lidar or a radio; [`NoLine`] where there is no line for one.
    type SensorReceiver: Receiver;
    /// From the maintenance port.
    type ConsoleReceiver: Read;
    /// To the maintenance port.
    type ConsoleTransmitter: Write;
    /// Triggers the steps.
    type Pacer: Pacer;
    /// Restarts the board when it is not fed.
    type Watchdog: Watchdog;
    /// Non-volatile storage, with the requirements of [`foxhound_computer::store`].
    type Flash: NorFlash;

    /// Starts clocks, peripherals and executors. Call it once.
    fn start() -> Parts<Self>;
    /// A fast free-running counter, for measurements.
    fn ticks() -> u32;
    /// Microseconds since the start.
    fn uptime_us() -> u64;
    /// Seconds since the start.
    fn uptime_s() -> u32 {
        (Self::uptime_us() / 1_000_000) as u32
    }
    /// Sleeps until the next interrupt, unless `is_ready` is true. An interrupt in between still ends the sleep.
    fn sleep_unless(is_ready: impl Fn() -> bool);
    /// Ends the program because it cannot continue.
    fn halt(why: &str) -> !;
    /// Restarts on request.
    fn restart() -> !;
}

/// A board, started.
pub struct Parts<B: Board> {
    /// Spawner of the fast loop.
    pub guidance: B::Spawner,
    /// Spawner of the tasks that move bytes; guidance pre-empts them.
    pub link: B::Spawner,
    /// From the autopilot.
    pub receiver: B::Receiver,
    /// To the autopilot.
    pub transmitter: B::Transmitter,
    /// From a lidar or a radio.
    pub sensor: B::SensorReceiver,
    /// From the maintenance port.
    pub console_receiver: B::ConsoleReceiver,
    /// To the maintenance port.
    pub console_transmitter: B::ConsoleTransmitter,
    /// Triggers the steps.
    pub pacer: B::Pacer,
    /// The watchdog, already running.
    pub watchdog: B::Watchdog,
    /// Why the computer has started.
    pub restart: Restart,
    /// Non-volatile storage.
    pub flash: B::Flash,
}

/// Bytes come in.
pub trait Read {
    /// Waits for bytes; returns how many.
    fn read(&mut self, bytes: &mut [u8]) -> impl Future<Output = usize>;
}

/// Bytes go out.
pub trait Write {
    /// Returns when all of them are handed to the line.
    fn write(&mut self, bytes: &[u8]) -> impl Future<Output = ()>;
}

/// The bytes of the autopilot, or of a sensor. Its buffer holds those of a step at the line's full rate.
pub trait Receiver: Read {
    /// Takes the bytes that are available.
    fn try_read(&mut self, bytes: &mut [u8]) -> usize;
    /// The largest number that waited, the size of the buffer, which is the most that a step takes, and the number lost.
    fn waiting(&self) -> Waiting;
    /// Number of errors: noise, framing errors or overruns.
    fn errors(&self) -> u32;
}

/// A line that a board does not have.
#[derive(Debug)]
pub struct NoLine;

impl Read for NoLine {
    async fn read(&mut self, _bytes: &mut [u8]) -> usize {
        pending().await
    }
}

impl Receiver for NoLine {
    fn try_read(&mut self, _bytes: &mut [u8]) -> usize {
        0
    }

    fn waiting(&self) -> Waiting {
        Waiting::default()
    }

    fn errors(&self) -> u32 {
        0
    }
}

/// Restarts the board when it is not fed.
pub trait Watchdog {
    /// The timeout.
    const PERIOD_US: u32;
    /// Restarts the timeout.
    fn feed(&mut self);
}

/// Triggers the steps and supplies their input.
pub trait Pacer {
    /// The sampled trajectories of a plan that are reported: an array, empty if they are not needed.
    type Samples: Samples;

    /// Waits for the next call.
    fn next(&mut self) -> impl Future<Output = Call<'_>>;
    /// Receives the result of a step.
    fn done(&mut self, done: Done<'_, Self::Samples>) -> impl Future<Output = ()>;
    /// Source of the clock.
    fn clock(&self) -> Clock;
    /// Bytes of the stack used, as found so far.
    fn stack_bytes(&self) -> u32;

    /// Receives the result of a setup; `tx_total` bytes were handed to the transmitter since the start.
    fn accept(&mut self, result: Result<(), ConfigError>, tx_total: u32) -> impl Future<Output = ()> {
        let _ = (result, tx_total);
        core::future::ready(())
    }
    /// Uses the sample rate of this configuration from now on, which was adapted to [`Board::SAMPLE_TIMER`], and the bit
    /// rate of its sensor.
    fn follow(&mut self, config: &guidance::Config) {
        let _ = config;
    }
    /// Switches the test tone on or off, if there is one.
    fn sound(&mut self, sounds: bool) {
        let _ = sounds;
    }
    /// A permanent error, reported once.
    fn trouble(&mut self) -> Option<&'static str> {
        None
    }
    /// Frames that were missing or unusable, since the start.
    fn lost(&self) -> u32 {
        0
    }
}

/// A call of the pacer.
#[derive(Debug)]
pub enum Call<'a> {
    /// Start anew with this configuration.
    Setup {
        /// The configuration.
        config: &'a guidance::Config,
        /// The mode has to be entered before guidance has control.
        needs_entry: bool,
    },
    /// One step of the fast loop.
    Step(Step<'a>),
}

/// One step of the fast loop.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The time of the step: the only clock of guidance and link.
    pub now: Instant,
    /// In lock-step with a simulator no task is left running when the step is done, so that the result does not
    /// depend on the simulator's speed.
    pub lock_step: Option<LockStep>,
    /// The measurement of the antennas.
    pub front_end: FrontEnd<'a, N>,
    /// Obstacles from a sensor that reports circles.
    pub circles: Option<&'a [Circle]>,
}

/// Conditions of a step in lock-step.
#[derive(Clone, Copy, Debug)]
pub struct LockStep {
    /// The number of bytes of the autopilot, counted from the start, that come before it.
    pub rx_expected: u32,
    /// The number of bytes of the sensor that come before it.
    pub sensor_expected: u32,
    /// The number of bytes of camera frames that are processed before it.
    pub camera_expected: u32,
    /// The planner gets no time: its result waits for a later step.
    pub holds_plan: bool,
    /// Called when the measured part of the step begins; returns the time, in `ticks`.
    pub begin: fn() -> u32,
}

/// The result of one step.
#[derive(Debug)]
pub struct Done<'a, S> {
    /// Output of guidance.
    pub output: guidance::Output,
    /// Length of the guidance step, in `ticks`.
    pub fast_ticks: u32,
    /// Steps that were late since the start.
    pub late: u32,
    /// Bytes handed to the transmitter since the start.
    pub tx_total: u32,
    /// A replan that was finished in this step (lock-step only).
    pub plan: Option<&'a Planned<S>>,
}

/// The slow loop's answer, and how it was made.
#[derive(Clone, Debug)]
pub struct Planned<S> {
    /// The answer.
    pub answer: Answer,
    /// Sampled trajectories that it was made from.
    pub samples_ned_m: S,
    /// Length of the replan, in `ticks`.
    pub ticks: u32,
}

/// Sampled trajectories, as many as are stored.
pub trait Samples: AsMut<[Trajectory]> + 'static {
    /// Before the first plan.
    const NONE: Self;
}

impl<const KEPT: usize> Samples for [Trajectory; KEPT] {
    const NONE: Self = [[Horizontal { north: 0.0, east: 0.0 }; WAYPOINTS]; KEPT];
}
