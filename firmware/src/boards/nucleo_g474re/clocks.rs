//! 170 MHz from the 24 MHz crystal or, if that does not start, from the internal oscillator; corrects two errors of
//! embassy-stm32 0.6.0.
//!
//! | oscillator | PLL input | VCO | SYSCLK, HCLK, PCLK1, PCLK2 |
//! |---|---|---|---|
//! | HSE, 24 MHz | / 6 = 4 MHz | * 85 = 340 MHz | / 2 = 170 MHz |
//! | HSI, 16 MHz, 1 % from 0 to 85 °C | / 4 = 4 MHz | * 85 = 340 MHz | / 2 = 170 MHz |
//!
//! After RM0440, section "Dynamic voltage scaling management" (PWR), "System clock (SYSCLK) selection" (RCC) and "Relation
//! between CPU clock frequency and flash memory read time" (FLASH):
//!
//! 1. HCLK is divided by 2 before the system clock becomes faster.
//! 2. Above 150 MHz the regulator needs range 1 boost, and so does the PLL: R1MODE, **bit 8** of `PWR_CR5`, is cleared, with PWR
//!    clocked. stm32-metapac 21.0.0 has it as bit 0, so that embassy's `boost` changes nothing. Then the PLL is started.
//! 3. The flash gets the wait states of the new frequency, 4, and they are read back.
//! 4. The system clock is switched to the PLL.
//! 5. HCLK is divided by 1 again after 1 us at the earliest. embassy writes the switch and the divider in one access.
//!
//! embassy is started on the HSI at 16 MHz, which it does correctly, and keeps that as its table of clocks.
//! Afterwards only its time driver uses the table, and its prescaler is corrected here; serial lines, converters and
//! timers are the board's own and use [`CLOCK_MHZ`].
//!
//! embassy also waits for the HSE without a timeout. Here the limit is [`HSE_WAIT_MS`], with the watchdog running. Should it fail
//! later, be it before the system clock comes from it, the clock security system raises an NMI, at 16 MHz from the HSI: the program
//! ends, and begins again on the HSI.

use cortex_m::asm;
use cortex_m::peripheral::DWT;
use embassy_stm32::pac::flash::vals::Latency;
use embassy_stm32::pac::rcc::vals::{Hpre, Pllm, Plln, Pllr, Pllsrc, Sw};
use embassy_stm32::pac::timer::vals::Urs;
use embassy_stm32::pac::{FLASH, PWR, RCC, TIM15};
use embassy_stm32::time::Hertz;
use embassy_stm32::{Peripherals, rcc};
use foxhound_computer::port::Clock;
use foxhound_computer::restart::Record;

use crate::register_values::{pll_hz, prescaler};

/// HCLK, and all clocks derived from it.
pub(super) const CLOCK_MHZ: u32 = 170;
const CLOCK_HZ: u32 = CLOCK_MHZ * 1_000_000;
const HSE_HZ: u32 = 24_000_000;
const _: () = assert!(pll_hz(HSE_HZ, 6, 85, 2) == CLOCK_HZ && pll_hz(HSI_MHZ * 1_000_000, 4, 85, 2) == CLOCK_HZ);
/// Clock of the core, until it is raised.
const HSI_MHZ: u32 = 16;
/// The crystal starts in some 2 ms (DS12288, HSE oscillator characteristics).
const HSE_WAIT_MS: u32 = 100;
/// Status of a run's record: the next one leaves the crystal alone, which could fail and restart the board again and again. No
/// `CFSR` is like it.
pub(super) const CRYSTAL_FAILED: u32 = 1 << 31;
/// `PWR_CR5`: 0 is range 1 boost.
const R1MODE: u32 = 1 << 8;

/// Starts embassy and raises the clock. Call it once after a reset, with the cycle counter and the watchdog running.
pub(super) fn start(last: Option<&Record>) -> (Peripherals, Clock) {
    let has_failed = last.is_some_and(|last| last.status == CRYSTAL_FAILED);
    let clock = if has_failed { Clock::Internal } else { wait_for_crystal() };
    let mut config = embassy_stm32::Config::default();
    if clock == Clock::Crystal {
        // It is left on.
        config.rcc.hse = Some(rcc::Hse { freq: Hertz(HSE_HZ), mode: rcc::HseMode::Oscillator });
    }
    // Nothing here needs the clock for times of day; on the oscillator of the watchdog it could make that too fast after a dip of the
    // voltage.
    config.rcc.ls = rcc::LsConfig::off();
    let peripherals = embassy_stm32::init(config);
    raise(clock);
    set_time_driver();
    (peripherals, clock)
}

fn wait_for_crystal() -> Clock {
    RCC.cr().modify(|w| w.set_hseon(true));
    let begin = DWT::cycle_count();
    while !RCC.cr().read().hserdy() {
        if DWT::cycle_count().wrapping_sub(begin) > HSE_WAIT_MS * 1000 * HSI_MHZ {
            RCC.cr().modify(|w| w.set_hseon(false));
            return Clock::Internal;
        }
    }
    // Until the next reset.
    RCC.cr().modify(|w| w.set_csson(true));
    Clock::Crystal
}

/// From 16 to 170 MHz. If a wait here never ends, the watchdog resets.
fn raise(clock: Clock) {
    let (source, divider) = match clock {
        Clock::Crystal => (Pllsrc::HSE, Pllm::DIV6),
        _ => (Pllsrc::HSI, Pllm::DIV4),
    };
    RCC.cfgr().modify(|w| w.set_hpre(Hpre::DIV2));
    RCC.apb1enr1().modify(|w| w.set_pwren(true));
    // A clock takes two cycles to arrive: the read is the wait.
    let _ = RCC.apb1enr1().read();
    PWR.cr5().modify(|w| w.0 &= !R1MODE);

    RCC.pllcfgr().write(|w| {
        w.set_pllsrc(source);
        w.set_pllm(divider);
        w.set_plln(Plln::MUL85);
        w.set_pllr(Pllr::DIV2);
        w.set_pllren(true);
    });
    RCC.cr().modify(|w| w.set_pllon(true));
    while !RCC.cr().read().pllrdy() {}

    FLASH.acr().modify(|w| w.set_latency(Latency::WS4));
    while FLASH.acr().read().latency() != Latency::WS4 {}
    RCC.cfgr().modify(|w| w.set_sw(Sw::PLL1_R));
    while RCC.cfgr().read().sws() != Sw::PLL1_R {}
    // At 85 MHz: 2 us.
    asm::delay(170);
    RCC.cfgr().modify(|w| w.set_hpre(Hpre::DIV1));
}

/// embassy has started its timer, the one that the feature `time-driver-tim15` names, for 16 MHz; nobody has read it yet.
fn set_time_driver() {
    TIM15.psc().write_value(prescaler(CLOCK_HZ, embassy_time::TICK_HZ as u32) as u16);
    // The prescaler holds from an update on, which is to raise no interrupt.
    TIM15.cr1().modify(|w| w.set_urs(Urs::COUNTER_ONLY));
    TIM15.egr().write(|w| w.set_ug(true));
    TIM15.cr1().modify(|w| w.set_urs(Urs::ANY_EVENT));
}
