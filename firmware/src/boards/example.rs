//! A made-up board, as a template for a new one: a bare Cortex-M4F at 100 MHz, with only the peripherals that every
//! one of them has. `cargo xtask test` builds it; it was never flashed, and nothing of it is proven.
//!
//! It starts, steps every 20 ms without a frame, restarts by itself after a fault, and communicates with nothing.
//! "HERE" marks each place for hardware code. `docs/contributing.md` explains the steps.

#![expect(unsafe_code, reason = "vectors, interrupt handlers")]

use core::ops::Range;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::DWT;
use cortex_m::peripheral::syst::SystClkSource;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use foxhound_computer::part::Refused;
use foxhound_computer::port::Clock;
use foxhound_computer::restart::{Cause, End, Restart};
use foxhound_computer::sampling::Timer;
use foxhound_computer::store::PAGES;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::FrontEnd;
use foxhound_core::planning::rollout::Trajectory;

use crate::arm;
use crate::arm::crash_record::{self, CrashOutput};
use crate::arm::stack::{self, Watermark};
use crate::board::{self, Board, Call, Done, NoLine, Parts, Step, Write};

const CLOCK_MHZ: u32 = 100;
/// From one interrupt of the system timer to the next.
const TICK_US: u32 = 1_000;
/// Interrupts per step.
const TICKS_PER_STEP: u32 = 20;

static GUIDANCE: InterruptExecutor = InterruptExecutor::new();
static LINK: InterruptExecutor = InterruptExecutor::new();
/// Interrupts of the system timer since the start.
static TICKS: AtomicU32 = AtomicU32::new(0);
static STEP: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// The board.
#[derive(Debug)]
pub struct Machine;

// SAFETY: the memory map keeps this section and puts it into flash; it is only read, from outside.
#[unsafe(link_section = ".foxhound_board")]
#[used]
static MARK: [u8; Machine::NAME.len()] = *b"example";

impl Board for Machine {
    const NAME: &'static str = "example";
    const TICKS_PER_US: u32 = CLOCK_MHZ;
    /// HERE: the timer that starts the samples.
    const SAMPLE_TIMER: Option<Timer> = None;

    type Spawner = SendSpawner;
    /// HERE: a serial line's receiver.
    type Receiver = NoLine;
    type Transmitter = Transmitter;
    /// HERE: a serial line of 230 400 baud, where there is a lidar, of 115 200 or 1 000 000 with a radio.
    type SensorReceiver = NoLine;
    type ConsoleReceiver = NoLine;
    type ConsoleTransmitter = Transmitter;
    type Pacer = Pacer;
    type Watchdog = Watchdog;
    type Flash = Flash;

    fn start() -> Parts<Self> {
        stack::paint();
        let record = crash_record::take();
        let Some(mut core) = cortex_m::Peripherals::take() else { Self::halt("started twice") };
        stack::guard(&mut core.MPU);
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();
        // HERE: clocks, and the watchdog before any wait.
        core.SYST.set_clock_source(SystClkSource::Core);
        core.SYST.set_reload(CLOCK_MHZ * TICK_US - 1);
        core.SYST.clear_current();
        core.SYST.enable_interrupt();
        core.SYST.enable_counter();
        for (interrupt, level) in [(Interrupt::Guidance, 0x80), (Interrupt::Link, 0xa0)] {
            // SAFETY: neither is unmasked yet, and no critical section counts on priorities.
            unsafe { core.NVIC.set_priority(interrupt, level) };
        }
        // HERE: the chip's report of its last reset.
        let cause = if crash_record::was_running() { Cause::Other } else { Cause::Power };
        Parts {
            guidance: GUIDANCE.start(Interrupt::Guidance),
            link: LINK.start(Interrupt::Link),
            receiver: NoLine,
            transmitter: Transmitter,
            sensor: NoLine,
            console_receiver: NoLine,
            console_transmitter: Transmitter,
            pacer: Pacer { stack: Watermark::new() },
            watchdog: Watchdog,
            restart: Restart { cause, record },
            flash: Flash,
        }
    }

    fn ticks() -> u32 {
        DWT::cycle_count()
    }

    fn uptime_us() -> u64 {
        u64::from(TICKS.load(Ordering::Relaxed)) * u64::from(TICK_US)
    }

    fn sleep_unless(is_ready: impl Fn() -> bool) {
        arm::sleep_unless(is_ready);
    }

    fn halt(why: &str) -> ! {
        crash_record::end::<Self>(End::Halt, 0, 0, why.as_bytes())
    }

    fn restart() -> ! {
        crash_record::restart::<Self>()
    }
}

impl CrashOutput for Machine {
    const MEMORY: Range<u32> = 0x2000_0000..0x2002_0000;

    /// HERE: a debugger's line, where there is one.
    fn print_end(_what: &str, _text: &str) {}
}

/// HERE: a serial line's transmitter.
#[derive(Debug)]
pub struct Transmitter;

impl Write for Transmitter {
    async fn write(&mut self, _bytes: &[u8]) {}
}

/// A step every 20 ms. HERE: with a frame, as soon as there is one.
#[derive(Debug)]
pub struct Pacer {
    stack: Watermark,
}

impl board::Pacer for Pacer {
    type Samples = [Trajectory; 0];

    async fn next(&mut self) -> Call<'_> {
        STEP.wait().await;
        let now = Instant(Machine::uptime_us());
        Call::Step(Step { now, lock_step: None, front_end: FrontEnd::Nothing, circles: None })
    }

    async fn done(&mut self, _done: Done<'_, Self::Samples>) {
        self.stack.look();
    }

    fn clock(&self) -> Clock {
        Clock::Crystal
    }

    fn stack_bytes(&self) -> u32 {
        self.stack.bytes()
    }
}

/// HERE: the chip's watchdog.
#[derive(Debug)]
pub struct Watchdog;

impl board::Watchdog for Watchdog {
    const PERIOD_US: u32 = 500_000;

    fn feed(&mut self) {}
}

/// HERE: eight pages of the chip's flash, in words of eight bytes. With one that refuses everything the vehicle comes
/// up as one whose store is lost.
#[derive(Debug)]
pub struct Flash;

impl ErrorType for Flash {
    type Error = Refused;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 8;

    fn read(&mut self, _offset: u32, _bytes: &mut [u8]) -> Result<(), Refused> {
        Err(Refused::Failed)
    }

    fn capacity(&self) -> usize {
        PAGES as usize * Self::ERASE_SIZE
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2048;

    fn erase(&mut self, _from: u32, _to: u32) -> Result<(), Refused> {
        Err(Refused::Failed)
    }

    fn write(&mut self, _offset: u32, _bytes: &[u8]) -> Result<(), Refused> {
        Err(Refused::Failed)
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    crash_record::panicked::<Machine>(info)
}

/// A fault of the processor; every other fault comes through it. The stack may be corrupt: it is started anew.
// SAFETY: the name is that of the vector, and the main stack is the only one in use. Nothing returns from here.
#[unsafe(no_mangle)]
#[unsafe(naked)]
unsafe extern "C" fn HardFault() {
    core::arch::naked_asm!(
        "mrs  r0, msp",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr  msp, r1",
        "b    {fault}",
        fault = sym crash_record::fault::<Machine>,
    )
}

#[cortex_m_rt::exception]
fn SysTick() {
    let ticks = TICKS.load(Ordering::Relaxed).wrapping_add(1);
    TICKS.store(ticks, Ordering::Relaxed);
    if ticks.is_multiple_of(TICKS_PER_STEP) {
        STEP.signal(());
    }
}

/// HERE: the chip's interrupts; two unused ones run the executors. A crate with the chip's names has the table, too.
#[derive(Clone, Copy, Debug)]
#[repr(u16)]
enum Interrupt {
    Guidance = 0,
    Link = 1,
}

// SAFETY: the numbers are those of the table below.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

// SAFETY: the section and the name are those under which cortex-m-rt's linker script wants the table, and every entry is a
// function that may be called at any time.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [extern "C" fn(); 2] = [on_guidance, on_link];

extern "C" fn on_guidance() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is unmasked by `start` only.
    unsafe { GUIDANCE.on_interrupt() }
}

extern "C" fn on_link() {
    // SAFETY: as above.
    unsafe { LINK.on_interrupt() }
}
