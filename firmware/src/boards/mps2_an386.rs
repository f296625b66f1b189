//! The twin: Arm's MPS2 board with the AN386 image (Cortex-M4F), as QEMU emulates it.
//!
//! | function | where |
//! |---|---|
//! | MAVLink | UART0, or from the autopilot by the memory: see `line` |
//! | sensor | the memory only: see `line` |
//! | doorbell of the simulator | UART1 |
//! | maintenance port | UART2 |
//! | frames and reports | the shared memory at `0x2100_0000`, layout in `foxhound_computer::twin` |
//! | flash | the memory behind it: see `flash` |
//! | time | timers 0 and 1 |
//!
//! It runs freely on its own time, 50 steps a second without frames, until the simulator sends a setup. From then on
//! it is in lock-step: a step is made when the doorbell rings, its time is the simulator's, and the answer is sent
//! when everything that the step has started is finished. If the doorbell is silent for 5 s the twin runs freely
//! again, from the time at which it stopped, so that the autopilot is not left alone; it then needs a new setup.

#![expect(unsafe_code, reason = "registers, vectors and the shared memory")]

mod clock;
mod ending;
mod faults;
mod flash;
mod interrupt;
mod registers;
mod uart;
mod vectors;
mod watchdog;

use core::fmt;
use core::sync::atomic::{Ordering, fence};

use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::port::Clock;
use foxhound_computer::restart::{Cause, End, Record, Restart};
use foxhound_computer::sampling;
use foxhound_computer::twin::{self, Arrivals, Block};
use foxhound_core::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::planning::planner::SAMPLES;
use foxhound_core::planning::rollout::Trajectory;
use static_cell::ConstStaticCell;

use crate::arm;
use crate::arm::crash_record;
use crate::arm::stack::{self, Watermark};
use crate::board::{self, Board, Call, Done, LockStep, Parts, Step};
use interrupt::Interrupt;
use uart::Doorbell;

pub use flash::Flash;
pub use uart::{ConsoleReceiver, ConsoleTransmitter, Receiver, SensorReceiver, Transmitter};
pub use watchdog::Watchdog;

// SAFETY: the memory map keeps this section and puts it into flash; it is only read, from outside.
#[unsafe(link_section = ".foxhound_board")]
#[used]
static MARK: [u8; Machine::NAME.len()] = *b"mps2_an386";

/// A step of the free run.
const FREE_RUN_PERIOD: Duration = Duration::from_millis(20);
/// How long the bell may be silent in lock-step.
const BELL_TIMEOUT: Duration = Duration::from_secs(5);

static GUIDANCE: InterruptExecutor = InterruptExecutor::new();
static LINK: InterruptExecutor = InterruptExecutor::new();

static BLOCK: ConstStaticCell<Block> = ConstStaticCell::new([0; twin::BLOCK_BYTES]);
static ARRIVALS: ConstStaticCell<Arrivals<N>> = ConstStaticCell::new(Arrivals::new());

/// The twin.
#[derive(Debug)]
pub struct Machine;

impl Board for Machine {
    const NAME: &'static str = "mps2_an386";
    const TICKS_PER_US: u32 = clock::TICKS_PER_US;
    /// The simulator samples, at any rate.
    const SAMPLE_TIMER: Option<sampling::Timer> = None;

    type Spawner = SendSpawner;
    type Receiver = Receiver;
    type Transmitter = Transmitter;
    type SensorReceiver = SensorReceiver;
    type ConsoleReceiver = ConsoleReceiver;
    type ConsoleTransmitter = ConsoleTransmitter;
    type Pacer = Pacer;
    type Watchdog = Watchdog;
    type Flash = Flash;

    fn start() -> Parts<Self> {
        start()
    }

    fn ticks() -> u32 {
        clock::ticks()
    }

    fn uptime_us() -> u64 {
        embassy_time::Instant::now().as_micros()
    }

    fn sleep_unless(is_ready: impl Fn() -> bool) {
        arm::sleep_unless(is_ready);
    }

    fn halt(why: &str) -> ! {
        ending::halt(why)
    }

    fn restart() -> ! {
        crash_record::restart::<Self>()
    }
}

fn start() -> Parts<Machine> {
    stack::paint();
    let restart = why();
    let Some(mut core) = cortex_m::Peripherals::take() else { ending::halt("started twice") };
    stack::guard(&mut core.MPU);
    interrupt::prioritise(&mut core.NVIC);
    clock::start();
    uart::start();
    let (receiver, transmitter, mut doorbell) = uart::ends();
    doorbell.ring(twin::BOOTED);
    let (console_receiver, console_transmitter) = uart::console_ends();
    Parts {
        guidance: GUIDANCE.start(Interrupt::GuidanceExecutor),
        link: LINK.start(Interrupt::LinkExecutor),
        receiver,
        transmitter,
        sensor: SensorReceiver::new(),
        console_receiver,
        console_transmitter,
        pacer: Pacer {
            doorbell,
            block: BLOCK.take(),
            arrivals: ARRIVALS.take(),
            pace: Pace::Free { next: embassy_time::Instant::now() },
            now: Instant(0),
            now_at: embassy_time::Instant::MIN,
            stack: Watermark::new(),
            setup: guidance::Config::default(),
        },
        watchdog: Watchdog::start(),
        restart,
        flash: Flash::new(),
    }
}

/// Why the computer has started: power-up, a reset from outside, or our own restart.
fn why() -> Restart {
    let record = crash_record::take();
    let is_warm = crash_record::was_running();
    let cause = match record {
        Some(Record { end: End::Watchdog, .. }) => Cause::Watchdog,
        Some(_) => Cause::Software,
        None if is_warm => Cause::BrownOut,
        None => Cause::Power,
    };
    Restart { cause, record }
}

/// Triggers the steps.
pub struct Pacer {
    doorbell: Doorbell,
    block: &'static mut Block,
    arrivals: &'static mut Arrivals<N>,
    pace: Pace,
    /// The time of the last step, and when it was made in embassy's time.
    now: Instant,
    now_at: embassy_time::Instant,
    stack: Watermark,
    setup: guidance::Config,
}

#[derive(Clone, Copy)]
enum Pace {
    Free { next: embassy_time::Instant },
    LockStep { alarm: embassy_time::Instant },
}

impl board::Pacer for Pacer {
    /// The simulator shows all of them.
    type Samples = [Trajectory; SAMPLES];

    fn stack_bytes(&self) -> u32 {
        self.stack.bytes()
    }

    fn clock(&self) -> Clock {
        Clock::Simulated
    }

    /// Waits for the doorbell or, running freely, for the next period.
    async fn next(&mut self) -> Call<'_> {
        loop {
            let (Pace::Free { next: alarm } | Pace::LockStep { alarm }) = self.pace;
            match select(self.doorbell.wait(), Timer::at(alarm)).await {
                Either::First(twin::SETUP) => {
                    read(twin::SETUP_AT, self.block);
                    uart::AUTOPILOT.open();
                    uart::PORT.open();
                    uart::SENSOR.open();
                    match twin::read_record::<twin::Setup>(self.block) {
                        Ok(setup) => {
                            self.setup = setup.guidance;
                            return Call::Setup { config: &self.setup, needs_entry: setup.needs_entry };
                        }
                        Err(error) => self.refuse(format_args!("{error}")),
                    }
                }
                Either::First(twin::FRAME) => match self.take_in() {
                    Ok(()) => break,
                    Err(reason) => self.refuse(reason),
                },
                Either::First(_) => {}
                Either::Second(()) => {
                    self.pace = Pace::Free { next: alarm + FREE_RUN_PERIOD };
                    return Call::Step(self.free_step());
                }
            }
        }
        let step = self.arrivals.step();
        faults::go_on();
        if let Some(fault) = step.fault {
            faults::begin(fault);
        }
        (self.now, self.now_at) = (step.now, embassy_time::Instant::now());
        Call::Step(Step {
            now: step.now,
            lock_step: Some(LockStep {
                rx_expected: step.rx_expected,
                sensor_expected: step.sensor_expected,
                camera_expected: step.camera_expected,
                holds_plan: step.fault == Some(twin::Fault::StarvePlanner),
                begin: faults::measured,
            }),
            front_end: step.front_end,
            circles: step.circles,
        })
    }

    /// Answers a setup.
    async fn accept(&mut self, result: Result<(), ConfigError>, tx_total: u32) {
        match result {
            Ok(()) => {
                uart::drained(tx_total).await;
                let written = twin::write_record(self.block, &twin::Ready { tx_total });
                self.answer(written);
            }
            Err(error) => self.refuse(format_args!("{error}")),
        }
    }

    /// Answers a step.
    async fn done(&mut self, done: Done<'_, Self::Samples>) {
        let Pace::LockStep { .. } = self.pace else {
            return;
        };
        uart::drained(done.tx_total).await;
        let report = twin::Report {
            sequence: self.arrivals.step().sequence,
            output: done.output,
            tx_total: done.tx_total,
            fast_ticks: done.fast_ticks,
            late: done.late,
            stack_bytes: self.stack.look(),
            plan: done.plan.map(|planned| twin::Planned {
                id: planned.answer.plan.id,
                waypoints_ned_m: planned.answer.plan.waypoints_ned_m,
                samples_ned_m: planned.samples_ned_m,
                ticks: planned.ticks,
            }),
        };
        let written = twin::write_record(self.block, &report);
        self.answer(written);
    }
}

impl Pacer {
    fn take_in(&mut self) -> Result<(), fmt::Arguments<'static>> {
        if matches!(self.pace, Pace::Free { .. }) {
            return Err(format_args!(
                "the twin runs freely (no setup yet, or a bell silent for 5 s): send a setup first"
            ));
        }
        read(twin::STEP_AT, self.block);
        self.arrivals.decode(self.block).map_err(|error| match error {
            twin::Error::Magic => {
                format_args!("the step block is empty or of another version")
            }
            twin::Error::Length => format_args!("the step block has an impossible length"),
            twin::Error::Content => format_args!("the step block cannot be read"),
        })
    }

    fn free_step(&mut self) -> Step<'static> {
        let at = embassy_time::Instant::now();
        self.now = self.now.plus_micros((at - self.now_at).as_micros());
        self.now_at = at;
        Step { now: self.now, lock_step: None, front_end: FrontEnd::Nothing, circles: None }
    }

    fn answer(&mut self, written: Result<(), twin::Error>) {
        faults::pause();
        self.pace = Pace::LockStep { alarm: embassy_time::Instant::now() + BELL_TIMEOUT };
        match written {
            Ok(()) => {
                write(twin::REPORT_AT, self.block);
                self.doorbell.ring(twin::DONE);
            }
            Err(error) => self.refuse(format_args!("the report: {error}")),
        }
    }

    fn refuse(&mut self, reason: fmt::Arguments<'_>) {
        twin::encode_refusal(self.block, reason);
        write(twin::REPORT_AT, self.block);
        self.doorbell.ring(twin::REFUSED);
    }
}

const PSRAM: usize = 0x2100_0000;
const _: () = assert!(twin::BLOCK_BYTES.is_multiple_of(4));

/// Reads a block from the memory shared with the simulator.
fn read(from: usize, block: &mut Block) {
    fence(Ordering::Acquire);
    let words = (PSRAM + from) as *const u32;
    for (index, bytes) in block.as_chunks_mut().0.iter_mut().enumerate() {
        // SAFETY: word-aligned and inside the 16 MB PSRAM, where no Rust object lies; volatile, because somebody else
        // writes there.
        *bytes = unsafe { words.add(index).read_volatile() }.to_le_bytes();
    }
}

/// Writes a block to the memory shared with the simulator.
fn write(to: usize, block: &Block) {
    let words = (PSRAM + to) as *mut u32;
    for (index, bytes) in block.as_chunks().0.iter().enumerate() {
        // SAFETY: as above.
        unsafe { words.add(index).write_volatile(u32::from_le_bytes(*bytes)) };
    }
    fence(Ordering::Release);
}

extern "C" fn on_guidance() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is unmasked by `start` only.
    unsafe { GUIDANCE.on_interrupt() }
}

extern "C" fn on_link() {
    // SAFETY: as above.
    unsafe { LINK.on_interrupt() }
}
