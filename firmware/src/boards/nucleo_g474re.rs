//! NUCLEO-G474RE (MB1367): STM32G474RET6, Cortex-M4F at 170 MHz from the 24 MHz crystal: see `clocks`.
//!
//! | function | where |
//! |---|---|
//! | MAVLink, 921 600 baud, 8N1 | USART1: TX PA9 (CN5-1, D8), RX PA10 (CN9-3, D2): see `serial` |
//! | maintenance port, 921 600 baud, 8N1 | LPUART1, to the ST-LINK's virtual COM port: TX PA2, RX PA3: see `serial` |
//! | lidar, 230 400 baud, or radio, 115 200 or 1 000 000, 8N1 | USART3: RX PC11 (CN7-2): see `serial` |
//! | antennas | PA0, PA1, PB0, PB12: see `acquisition` |
//! | storage | the last 16 KB of the flash: see `flash` |
//! | test tone | PA4: see `tone` |
//! | log | defmt over RTT, through the ST-LINK |
//! | time | TIM15, 1 MHz ticks |
//!
//! Priorities, most urgent first: DMA, lines and time (embassy's), guidance, link; the planner is the thread.
//!
//! The independent watchdog is started before any wait, runs on its own oscillator and stops while a debugger holds
//! the core. The brown-out reset monitors the supply; its level is in the option bytes, which
//! the firmware leaves alone; one below the chip's own least supply, as delivered, is reported.

#![expect(unsafe_code, reason = "registers, interrupt handlers and the memory that DMA writes")]

mod acquisition;
mod clocks;
mod ending;
mod flash;
mod serial;
mod tone;

use cortex_m::peripheral::DWT;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::interrupt::{InterruptExt as _, Priority};
use embassy_stm32::pac::{DBGMCU, FLASH, RCC};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{interrupt, peripherals};
use embassy_time::with_timeout;
use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::port::Clock;
use foxhound_computer::restart::{Cause, Restart};
use foxhound_computer::sampling::Timer;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::planning::rollout::Trajectory;
use static_cell::ConstStaticCell;

use crate::arm;
use crate::arm::crash_record;
use crate::arm::stack::{self, Watermark};
use crate::board::{self, Board, Call, Done, Parts, Step};
use acquisition::Acquisition;
use clocks::CLOCK_MHZ;
use tone::Tone;

pub use flash::Flash;
pub use serial::{Receiver, Transmitter};

// SAFETY: the memory map keeps this section and puts it into flash; it is only read, from outside.
#[unsafe(link_section = ".foxhound_board")]
#[used]
static MARK: [u8; Machine::NAME.len()] = *b"nucleo_g474re";

static GUIDANCE: InterruptExecutor = InterruptExecutor::new();
static LINK: InterruptExecutor = InterruptExecutor::new();
static SNAPSHOT: ConstStaticCell<AdcFrame<N>> = ConstStaticCell::new(AdcFrame::zeroed());

/// The NUCLEO-G474RE.
#[derive(Debug)]
pub struct Machine;

impl Board for Machine {
    const NAME: &'static str = "nucleo_g474re";
    const TICKS_PER_US: u32 = CLOCK_MHZ;
    const SAMPLE_TIMER: Option<Timer> = Some(acquisition::TIMER);

    type Spawner = SendSpawner;
    type Receiver = Receiver;
    type Transmitter = Transmitter;
    type SensorReceiver = Receiver;
    type ConsoleReceiver = Receiver;
    type ConsoleTransmitter = Transmitter;
    type Pacer = Pacer;
    type Watchdog = Watchdog;
    type Flash = Flash;

    fn start() -> Parts<Self> {
        start()
    }

    /// Cycles of the core; wraps after some seconds.
    fn ticks() -> u32 {
        DWT::cycle_count()
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
    let restart = Restart { cause: cause(), record: crash_record::take() };
    // Before any wait.
    DBGMCU.apb1lfzr().modify(|w| w.set_iwdg(true));
    // SAFETY: nothing else takes it from embassy's peripherals.
    let mut watchdog =
        IndependentWatchdog::new(unsafe { peripherals::IWDG::steal() }, <Watchdog as board::Watchdog>::PERIOD_US);
    watchdog.unleash();
    let Some(mut core) = cortex_m::Peripherals::take() else { ending::halt("started twice") };
    stack::guard(&mut core.MPU);
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    let (board, clock) = clocks::start(restart.record.as_ref());
    let ([(receiver, transmitter), (console_receiver, console_transmitter)], sensor) = serial::start();

    // Two vectors of unused peripherals.
    interrupt::CORDIC.set_priority(Priority::P6);
    interrupt::FMAC.set_priority(Priority::P8);
    Parts {
        guidance: GUIDANCE.start(interrupt::CORDIC),
        link: LINK.start(interrupt::FMAC),
        receiver,
        transmitter,
        sensor,
        console_receiver,
        console_transmitter,
        pacer: Pacer {
            acquisition: Acquisition::new(),
            tone: Tone::new(),
            snapshot: SNAPSHOT.take(),
            stack: Watermark::new(),
            lost: 0,
            told: false,
            clock,
            clock_told: false,
            supply_told: false,
        },
        watchdog: Watchdog(watchdog),
        restart,
        flash: Flash::new(board.FLASH),
    }
}

/// The chip's report of its last reset (RM0440, `RCC_CSR`); the flags are cleared, so that they describe only one
/// reset.
fn cause() -> Cause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|w| w.set_rmvf(true));
    // The brown-out flag is set at every power-up, too: it is a brown-out if memory was kept. The pin flag is set at
    // every reset.
    let power = if crash_record::was_running() { Cause::BrownOut } else { Cause::Power };
    let causes = [
        (flags.iwdgrstf() || flags.wwdgrstf(), Cause::Watchdog),
        (flags.sftrstf(), Cause::Software),
        (flags.oblrstf() || flags.lpwrrstf(), Cause::Other),
        (flags.borrstf(), power),
        (flags.pinrstf(), Cause::Pin),
    ];
    causes.into_iter().find(|(is_set, _)| *is_set).map_or(Cause::Other, |(_, cause)| cause)
}

/// Restarts the board when it is not fed.
pub struct Watchdog(IndependentWatchdog<'static, peripherals::IWDG>);

impl board::Watchdog for Watchdog {
    /// 25 steps.
    const PERIOD_US: u32 = 500_000;

    fn feed(&mut self) {
        self.0.pet();
    }
}

/// Triggers the steps: one for every frame.
pub struct Pacer {
    acquisition: Acquisition,
    tone: Tone,
    snapshot: &'static mut AdcFrame<N>,
    stack: Watermark,
    /// Frames that were missing or unusable.
    lost: u32,
    /// The error has been reported.
    told: bool,
    clock: Clock,
    clock_told: bool,
    supply_told: bool,
}

impl board::Pacer for Pacer {
    type Samples = [Trajectory; 0];

    fn stack_bytes(&self) -> u32 {
        self.stack.bytes()
    }

    fn clock(&self) -> Clock {
        self.clock
    }

    fn follow(&mut self, config: &guidance::Config) {
        if let Ok(sampling) = acquisition::TIMER.sampling(config) {
            self.acquisition.sample(sampling);
        }
        serial::follow(config);
    }

    fn lost(&self) -> u32 {
        self.lost
    }

    fn sound(&mut self, sounds: bool) {
        self.tone.sound(sounds);
    }

    /// Permanent errors, each reported once.
    fn trouble(&mut self) -> Option<&'static str> {
        if self.clock == Clock::Internal && !core::mem::replace(&mut self.clock_told, true) {
            defmt::warn!("the crystal does not start: HSI");
            return Some("Foxhound: no crystal, HSI: rate off by 1 %");
        }
        if FLASH.optr().read().bor_lev() == 0 && !core::mem::replace(&mut self.supply_told, true) {
            return Some("Foxhound: brown-out level is not set");
        }
        let trouble = self.acquisition.trouble().filter(|_| !self.told)?;
        self.told = true;
        Some(trouble.words())
    }

    /// Waits for the next frame; after two missing ones, the link continues without.
    async fn next(&mut self) -> Call<'_> {
        let patience = self.acquisition.patience();
        let fresh = match with_timeout(patience, self.acquisition.ready()).await {
            Ok(block) => self.acquisition.take(block, self.snapshot),
            Err(_) => {
                self.acquisition.restart();
                false
            }
        };
        if !fresh {
            self.lost = self.lost.saturating_add(1);
            defmt::warn!("no frame; {} restarts so far", self.acquisition.restarts());
        }
        Call::Step(Step {
            now: Instant(embassy_time::Instant::now().as_micros()),
            lock_step: None,
            front_end: if fresh { FrontEnd::Frame(self.snapshot) } else { FrontEnd::Nothing },
            circles: None,
        })
    }

    /// Logs the time of a step.
    async fn done(&mut self, done: Done<'_, Self::Samples>) {
        let stack_bytes = self.stack.look();
        defmt::trace!(
            "guidance took {} cycles: {}; {} late, {} bytes of stack",
            done.fast_ticks,
            done.output.outcome,
            done.late,
            stack_bytes,
        );
    }
}

#[interrupt]
fn CORDIC() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is unmasked by `start` only.
    unsafe { GUIDANCE.on_interrupt() }
}

#[interrupt]
fn FMAC() {
    // SAFETY: as above.
    unsafe { LINK.on_interrupt() }
}
