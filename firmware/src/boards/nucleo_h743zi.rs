//! NUCLEO-H743ZI2 (MB1364): STM32H743ZIT6, Cortex-M7F at 400 MHz from the 8 MHz that the ST-LINK gives out.
//!
//! | what | where |
//! |---|---|
//! | MAVLink, 921 600 baud, 8N1 | USART1: TX PB6 (D1), RX PB7 (D0); DMA1 streams 0 and 1 |
//! | maintenance port, 921 600 baud, 8N1 | USART3, to the ST-LINK's virtual COM port: TX PD8, RX PD9; DMA1 streams 2 and 3 |
//! | antennas | none: acquisition is not written for this board |
//! | what is kept | nothing: see `flash` |
//! | test tone | none |
//! | log | defmt over RTT, through the ST-LINK |
//! | time | a timer of embassy-stm32's choice, 1 MHz ticks |
//!
//! Pins after the board's files in Zephyr ([connector], [lines]).
//!
//! **What is proven:** the application compiles, links and passes the lints for a second chip, with another core, clock tree,
//! DMA and memory. Outside of this file and its folder, only the lists of boards know of it. **What is not:** everything else.
//! Nothing of this has run, on a board or in an emulator; no time was measured, and no stack was added up.
//!
//! There are no antennas, so it steps at 50 Hz by the time alone, says so to the pilot once, and seeks nothing. Four channels
//! would want ADC1 and ADC2 together, ADC3 for the third, and the fourth after it, with a skew to be written into the array.
//!
//! Both caches are off, as they are after a reset: DMA goes past them, and a cached copy would have to be cleaned and dropped
//! by hand around every transfer. The price is that the program is fetched from the flash with its wait states.
//!
//! Without the ST-LINK's clock the start waits for ever: the watchdog begins behind it.
//!
//! Priorities, most urgent first: DMA and time (embassy's), guidance, link; the planner is the thread.
//!
//! [connector]: https://github.com/zephyrproject-rtos/zephyr/blob/main/boards/st/nucleo_h743zi/arduino_r3_connector.dtsi
//! [lines]: https://github.com/zephyrproject-rtos/zephyr/blob/main/boards/st/nucleo_h743zi/nucleo_h743zi.dts

#![expect(unsafe_code, reason = "interrupt handlers, and the memory that outlives a reset")]

mod flash;

use core::ptr;

use cortex_m::peripheral::DWT;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_stm32::interrupt::{InterruptExt as _, Priority};
use embassy_stm32::pac::rcc::regs::Rsr;
use embassy_stm32::pac::{DBGMCU, RCC};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, Uart};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, dma, interrupt, peripherals, rcc};
use embassy_time::{Duration, Ticker};
use foxhound_computer::restart::{Cause, Restart};
use foxhound_computer::sampling::Timer;
use foxhound_core::ConfigError;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::time::Instant;
use static_cell::ConstStaticCell;

use super::{Call, Done, Step, Watermark, last_words, stack};

pub use super::last_words::restart;
pub use super::stm32::{PortReceiver, PortTransmitter, Receiver, Transmitter, halt, ticks, uptime_s};
pub(super) use super::stm32::{last_words, on_fault};
pub use flash::Flash;

/// Samples of a plan that are kept for somebody to see.
pub const SAMPLES_KEPT: usize = 0;

/// The name of this board.
pub const NAME: &str = "nucleo_h743zi";

// SAFETY: the memory map keeps this section and puts it into flash; it is only read, from outside.
#[unsafe(link_section = ".foxhound_board")]
#[used]
static MARK: [u8; NAME.len()] = *b"nucleo_h743zi";

const BAUD: u32 = 921_600;
/// A step.
const PERIOD: Duration = Duration::from_millis(20);
/// Nothing paces samples: there are none.
pub const SAMPLE_TIMER: Option<Timer> = None;

bind_interrupts!(struct Irqs {
    USART1 => usart::InterruptHandler<peripherals::USART1>;
    USART3 => usart::InterruptHandler<peripherals::USART3>;
    DMA1_STREAM0 => dma::InterruptHandler<peripherals::DMA1_CH0>;
    DMA1_STREAM1 => dma::InterruptHandler<peripherals::DMA1_CH1>;
    DMA1_STREAM2 => dma::InterruptHandler<peripherals::DMA1_CH2>;
    DMA1_STREAM3 => dma::InterruptHandler<peripherals::DMA1_CH3>;
});

unsafe extern "C" {
    static _kept_start: u32;
    static _kept_end: u32;
}

/// The watchdog restarts the board when no step was in time for so long: 25 steps.
const WATCHDOG_US: u32 = 500_000;

static GUIDANCE: InterruptExecutor = InterruptExecutor::new();
static LINK: InterruptExecutor = InterruptExecutor::new();
static RING: ConstStaticCell<[u8; 2048]> = ConstStaticCell::new([0; 2048]);
static PORT_RING: ConstStaticCell<[u8; 32]> = ConstStaticCell::new([0; 32]);

/// The board, started.
pub struct Board {
    /// The fast loop.
    pub guidance: SendSpawner,
    /// Bytes to and from the autopilot.
    pub link: SendSpawner,
    /// From the autopilot.
    pub receiver: Receiver,
    /// To the autopilot.
    pub transmitter: Transmitter,
    /// From the maintenance port.
    pub port_receiver: PortReceiver,
    /// To the maintenance port.
    pub port_transmitter: PortTransmitter,
    /// What to do next.
    pub pacer: Pacer,
    /// Runs from now on.
    pub watchdog: Watchdog,
    /// Why we are here.
    pub restart: Restart,
    /// What is kept while the power is off.
    pub flash: Flash,
}

/// Starts the board. To be called once.
pub fn start() -> Board {
    stack::paint();
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    if flags.porrstf() {
        forget();
    }
    let restart = Restart { cause: cause(flags), record: last_words::take() };
    let board = embassy_stm32::init(clocks());
    DBGMCU.apb4fzr1().modify(|w| w.set_iwdg1(true));
    let mut watchdog = IndependentWatchdog::new(board.IWDG1, WATCHDOG_US);
    watchdog.unleash();
    let Some(mut core) = cortex_m::Peripherals::take() else { halt(format_args!("started twice")) };
    stack::guard(&mut core.MPU);
    core.DCB.enable_trace();
    // The counter of a Cortex-M7 is locked.
    DWT::unlock();
    core.DWT.enable_cycle_counter();

    let mut config = usart::Config::default();
    config.baudrate = BAUD;
    let uart = Uart::new(board.USART1, board.PB7, board.PB6, board.DMA1_CH0, board.DMA1_CH1, Irqs, config);
    let (tx, rx) = match uart {
        Ok(uart) => uart.split(),
        Err(_) => halt(format_args!("USART1 does not take {BAUD} baud")),
    };
    let port = Uart::new(board.USART3, board.PD9, board.PD8, board.DMA1_CH2, board.DMA1_CH3, Irqs, config);
    let (port_tx, port_rx) = match port {
        Ok(port) => port.split(),
        Err(_) => halt(format_args!("USART3 does not take {BAUD} baud")),
    };

    // Two vectors whose peripherals are off.
    interrupt::SWPMI1.set_priority(Priority::P6);
    interrupt::MDIOS.set_priority(Priority::P8);
    Board {
        guidance: GUIDANCE.start(interrupt::SWPMI1),
        link: LINK.start(interrupt::MDIOS),
        receiver: Receiver(rx.into_ring_buffered(RING.take())),
        transmitter: Transmitter(tx),
        port_receiver: PortReceiver(port_rx.into_ring_buffered(PORT_RING.take())),
        port_transmitter: PortTransmitter(port_tx),
        pacer: Pacer { ticker: Ticker::every(PERIOD), stack: Watermark::new(), lost: 0, told: false },
        watchdog: Watchdog(watchdog),
        restart,
        flash: Flash::new(),
    }
}

/// What the chip says of its last reset (RM0433, `RCC_RSR`); the flags were cleared, so that they speak of one reset only.
fn cause(flags: Rsr) -> Cause {
    // A brown-out shows at every power-up, too: it is one where memory has not been lost. The pin shows at every reset.
    let power = if last_words::was_running() { Cause::BrownOut } else { Cause::Power };
    let causes = [
        (flags.iwdg1rstf() || flags.wwdg1rstf(), Cause::Watchdog),
        (flags.sftrstf(), Cause::Software),
        (flags.lpwrrstf(), Cause::Other),
        (flags.porrstf() || flags.borrstf(), power),
        (flags.pinrstf(), Cause::Pin),
    ];
    causes.into_iter().find(|(is_set, _)| *is_set).map_or(Cause::Other, |(_, cause)| cause)
}

/// Writes what outlives a reset, once the power has come: until then its check bits do not fit.
fn forget() {
    let (mut at, end) = (&raw const _kept_start as u32, &raw const _kept_end as u32);
    while at < end {
        // SAFETY: word-aligned and inside the section; any words are valid there, and nothing reads them before.
        unsafe { ptr::with_exposed_provenance_mut::<u32>(at as usize).write_volatile(0) };
        at += 4;
    }
}

/// Whether so many bytes from there on are data memory.
pub(super) fn is_memory(address: u32, bytes: u32) -> bool {
    (0x2000_0000..0x2002_0000 - bytes).contains(&address) || (0x2400_0000..0x2408_0000 - bytes).contains(&address)
}

/// Restarts the board when it is not fed.
pub struct Watchdog(IndependentWatchdog<'static, peripherals::IWDG1>);

impl Watchdog {
    /// Begins anew.
    pub fn feed(&mut self) {
        self.0.pet();
    }
}

/// 8 MHz / 4 * 400 / 2 = 400 MHz, half of it for the buses' matrix, a quarter for the peripherals: the most that voltage
/// scale 1 allows.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse { freq: Hertz(8_000_000), mode: rcc::HseMode::Bypass });
    config.rcc.pll1 = Some(rcc::Pll {
        source: rcc::PllSource::HSE,
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::MUL400,
        fracn: None,
        divp: Some(rcc::PllDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV2;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb3_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb4_pre = rcc::APBPrescaler::DIV2;
    config.rcc.voltage_scale = rcc::VoltageScale::Scale1;
    config
}

/// Says what to do next: a step every 20 ms, without a frame.
pub struct Pacer {
    ticker: Ticker,
    stack: Watermark,
    lost: u32,
    /// That there are no antennas has been told.
    told: bool,
}

impl Pacer {
    /// How much of the stack was ever used, as far as is known.
    #[must_use]
    pub fn stack_bytes(&self) -> u32 {
        self.stack.bytes()
    }

    /// There are no samples.
    pub fn follow(&mut self, _config: &guidance::Config) {}

    /// Frames that did not come, since the start: one a step.
    pub fn lost(&self) -> u32 {
        self.lost
    }

    /// There is nothing that sounds.
    pub fn sound(&mut self, _sounds: bool) {}

    /// That there are no antennas, once.
    pub fn trouble(&mut self) -> Option<&'static str> {
        let told = core::mem::replace(&mut self.told, true);
        (!told).then_some("Foxhound: this board has no antennas")
    }

    /// Waits for the next step.
    pub async fn next(&mut self) -> Call<'_> {
        self.ticker.next().await;
        self.lost = self.lost.saturating_add(1);
        Call::Step(Step {
            now: Instant(embassy_time::Instant::now().as_micros()),
            lock_step: None,
            front_end: FrontEnd::Nothing,
            circles: None,
        })
    }

    /// Nobody sets this board up from outside.
    pub async fn accept(&mut self, _result: Result<(), ConfigError>, _tx_total: u32) {}

    /// Looks after the stack.
    pub async fn done(&mut self, _done: Done<'_>) {
        self.stack.look();
    }
}

/// Of [`ticks`].
pub const TICKS_PER_US: u32 = 400;

#[interrupt]
fn SWPMI1() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is unmasked by `start` only.
    unsafe { GUIDANCE.on_interrupt() }
}

#[interrupt]
fn MDIOS() {
    // SAFETY: as above.
    unsafe { LINK.on_interrupt() }
}
