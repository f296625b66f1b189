//! What the application asks of a board. `boards` has one file for each; `app` and `console` know nothing else of them.
//!
//! What most boards do alike has a default here. How a new one is made is told in `docs/contributing.md`.

use core::fmt;
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
use foxhound_core::planning::planner::Plan;
use foxhound_core::planning::rollout::{Trajectory, WAYPOINTS};

/// A board.
pub trait Board: Sized + 'static {
    /// Its name in `--board` and in the image's `.foxhound_board` section.
    const NAME: &'static str;
    /// Of [`ticks`](Self::ticks).
    const TICKS_PER_US: u32;
    /// What paces the samples, where that cannot be at any rate.
    const SAMPLE_TIMER: Option<Timer>;

    /// Starts tasks.
    type Spawner;
    /// From the autopilot.
    type Receiver: Receiver;
    /// To the autopilot.
    type Transmitter: Write;
    /// From a lidar; [`NoLine`] where there is no line for one.
    type LidarReceiver: Receiver;
    /// From the maintenance port.
    type ConsoleReceiver: Read;
    /// To the maintenance port.
    type ConsoleTransmitter: Write;
    /// Says what to do next.
    type Pacer: Pacer;
    /// Restarts the board when it is not fed.
    type Watchdog: Watchdog;
    /// What is kept while the power is off: [`foxhound_computer::store`] says what it asks of it.
    type Flash: NorFlash;

    /// Starts clocks, peripherals and executors. To be called once.
    fn start() -> Parts<Self>;
    /// A fast counter that runs freely, to measure with.
    fn ticks() -> u32;
    /// Microseconds since the start.
    fn uptime_us() -> u64;
    /// Seconds since the start.
    fn uptime_s() -> u32 {
        (Self::uptime_us() / 1_000_000) as u32
    }
    /// Sleeps until the next interrupt, unless this is so already. One that comes in between still ends the sleep.
    fn sleep_unless(is_ready: impl Fn() -> bool);
    /// It cannot go on.
    fn halt(why: fmt::Arguments<'_>) -> !;
    /// Somebody wants a restart.
    fn restart() -> !;
}

/// A board, started.
pub struct Parts<B: Board> {
    /// Of the fast loop.
    pub guidance: B::Spawner,
    /// Of the tasks that move bytes; guidance pre-empts them.
    pub link: B::Spawner,
    /// From the autopilot.
    pub receiver: B::Receiver,
    /// To the autopilot.
    pub transmitter: B::Transmitter,
    /// From a lidar.
    pub lidar: B::LidarReceiver,
    /// From the maintenance port.
    pub console_receiver: B::ConsoleReceiver,
    /// To the maintenance port.
    pub console_transmitter: B::ConsoleTransmitter,
    /// What to do next.
    pub pacer: B::Pacer,
    /// Runs from now on.
    pub watchdog: B::Watchdog,
    /// Why we are here.
    pub restart: Restart,
    /// What is kept while the power is off.
    pub flash: B::Flash,
}

/// Bytes come in.
pub trait Read {
    /// Waits for bytes; how many have come.
    fn read(&mut self, bytes: &mut [u8]) -> impl Future<Output = usize>;
}

/// Bytes go out.
pub trait Write {
    /// Returns when all of them are on their way.
    fn write(&mut self, bytes: &[u8]) -> impl Future<Output = ()>;
}

/// The bytes of the autopilot, or of a lidar. It holds those of a step at the line's full rate.
pub trait Receiver: Read {
    /// Takes the bytes that are there.
    fn try_read(&mut self, bytes: &mut [u8]) -> usize;
    /// How many have waited, and how many were lost.
    fn waiting(&self) -> Waiting;
    /// How often noise, framing or overruns have damaged some.
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
    /// It was not fed for so long.
    const PERIOD_US: u32;
    /// Begins anew.
    fn feed(&mut self);
}

/// Says what to do next.
pub trait Pacer {
    /// The sampled trajectories of a plan that somebody wants to see: an array, empty where nobody does.
    type Samples: Samples;

    /// Waits for what to do next.
    fn next(&mut self) -> impl Future<Output = Call<'_>>;
    /// Takes note of how a step went.
    fn done(&mut self, done: Done<'_, Self::Samples>) -> impl Future<Output = ()>;
    /// Where the clock is from.
    fn clock(&self) -> Clock;
    /// How much of the stack was ever used, as far as is known.
    fn stack_bytes(&self) -> u32;

    /// Takes note of how a setup went; `tx_total` bytes were handed to the transmitter since the start.
    fn accept(&mut self, result: Result<(), ConfigError>, tx_total: u32) -> impl Future<Output = ()> {
        let _ = (result, tx_total);
        core::future::ready(())
    }
    /// Samples as this configuration says from now on, which was fitted to [`Board::SAMPLE_TIMER`].
    fn follow(&mut self, config: &guidance::Config) {
        let _ = config;
    }
    /// The test tone sounds or does not, where there is one.
    fn sound(&mut self, sounds: bool) {
        let _ = sounds;
    }
    /// What is wrong for good, once.
    fn trouble(&mut self) -> Option<&'static str> {
        None
    }
    /// Frames that did not come or were no use, since the start.
    fn lost(&self) -> u32 {
        0
    }
}

/// What the board wants done.
#[derive(Debug)]
pub enum Call<'a> {
    /// Start anew with this configuration.
    Setup(&'a guidance::Config),
    /// One step of the fast loop.
    Step(Step<'a>),
}

/// One step of the fast loop.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The time of the step: the only clock of guidance and link.
    pub now: Instant,
    /// In lock-step with a simulator nothing is left running when the step is done, so that the result does not depend on
    /// the simulator's speed.
    pub lock_step: Option<LockStep>,
    /// What the antennas brought.
    pub front_end: FrontEnd<'a, N>,
    /// Obstacles that a sensor delivers as circles already.
    pub circles: Option<&'a [Circle]>,
}

/// What a step in lock-step heeds.
#[derive(Clone, Copy, Debug)]
pub struct LockStep {
    /// So many bytes of the autopilot, counted from the start, come before it.
    pub rx_expected: u32,
    /// So many bytes of the lidar come before it.
    pub lidar_expected: u32,
    /// So many bytes of camera frames have been looked at before it.
    pub camera_expected: u32,
    /// The planner is starved: what it has found waits for a later step.
    pub holds_plan: bool,
    /// Says that the measured part of the step begins, and when that is, in `ticks`.
    pub begin: fn() -> u32,
}

/// What one step came to.
#[derive(Debug)]
pub struct Done<'a, S> {
    /// What guidance said.
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

/// A plan, and how it came about.
#[derive(Clone, Debug)]
pub struct Planned<S> {
    /// The plan.
    pub plan: Plan,
    /// Sampled trajectories that it was made from.
    pub samples_ned_m: S,
    /// Length of the replan, in `ticks`.
    pub ticks: u32,
}

/// Sampled trajectories, as many as are kept.
pub trait Samples: AsMut<[Trajectory]> + 'static {
    /// Before the first plan.
    const NONE: Self;
}

impl<const KEPT: usize> Samples for [Trajectory; KEPT] {
    const NONE: Self = [[Horizontal { north: 0.0, east: 0.0 }; WAYPOINTS]; KEPT];
}
