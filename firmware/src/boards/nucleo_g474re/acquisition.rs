//! Four coherent antenna channels: ADC1 to ADC4, triggered together, written to memory by DMA.
//!
//! TIM6 counts periods of the converters' clock, 415 for the default 102.4 kHz; its update event (TRGO) starts all four
//! converters at the same instant. The count follows from the configuration ([`foxhound_computer::sampling`]), in
//! which the actual rate, 102 409.6 Hz, is stored from then on; an impossible rate is refused there, with the name of
//! the field.
//! Each converter's results go by its own DMA channel into its own ring of two blocks. DMA interrupts when a half of
//! the last ring is full; the other half fills in the 2.5 ms that follow, and until then the full one may be read.
//! Every eighth block is passed to guidance, one per step, or as many as the step's period has.
//!
//! | channel | converter, input | pin | connector | DMA | request |
//! |---|---|---|---|---|---|
//! | A1 front-right | ADC1 IN1 | PA0 | CN8-1 (A0) | DMA2 channel 1 | 5 |
//! | A2 front-left | ADC2 IN2 | PA1 | CN8-2 (A1) | DMA2 channel 2 | 36 |
//! | A3 back-left | ADC3 IN12 | PB0 | CN8-4 (A3) | DMA2 channel 3 | 37 |
//! | A4 back-right | ADC4 IN3 | PB12 | CN10-16 | DMA2 channel 4 | 38 |
//!
//! After RM0440, chapters ADC (clocks; deep-power-down and regulator; calibration; on-off control; external triggers:
//! `TIM6_TRGO` is input 13 of the regular groups of all five converters; overrun; DMA circular mode) and DMAMUX (its
//! channels 8 to 15 serve DMA2).
//!
//! - **Clock.** Synchronous, HCLK / 4 = 42.5 MHz: below the 52 MHz that are allowed with several converters at work,
//!   and a trigger from a timer of the same clock then has no jitter. TIM6 has the same prescaler, 4: a trigger in
//!   another phase of the converters' clock would let them disturb each other (ES0430, section 2.7.11, 2.7.9 in Rev 8).
//!   The dividers of the pairs ADC1/2 and ADC3/4 may be up to three HCLK cycles (18 ns) apart; `calibrate` measures
//!   the difference, `skew_s` of the array corrects it.
//! - **Time.** 92.5 cycles of sampling and 12.5 of conversion, 2.5 us of the 9.8 us between two triggers, and a few
//!   to begin: 108 cycles of 42.5 MHz are the shortest accepted.
//! - **Offset.** Half scale is subtracted from the samples and nothing else. Any constant is projected out where the
//!   tone is fitted (`foxhound_core::signal::phase`).
//! - **Overrun.** When DMA does not fetch a result in time the converter sets OVR and sends no more requests; the
//!   rings would then be out of step with each other. Every block that is passed on is checked for that, and
//!   everything is started anew: timer off, ADSTP until ADSTART is clear, DMAEN off (it may be written then only),
//!   channel off, DR read, flags cleared; then all registers of the channel, DMAEN, ADSTART, timer. A transfer error
//!   stops DMA; no block comes then, which also leads to a new start.
//! - **Waits.** The hardware gets 1 ms for each wait, fifty times the longest. A part that is not ready in that time
//!   is taken to be broken: from then on there are no frames, and the pilot is informed ([`Trouble`]).
//! - **Out of step.** A converter that has missed a trigger, or stops silently, fills less of its ring than the others. This is
//!   looked at with every block, and everything is started anew. Samples that repeat, for another reason, are detected too
//!   ([`foxhound_computer::frozen`]).

use core::sync::atomic::{AtomicU16, AtomicU32, Ordering, compiler_fence};

use cortex_m::peripheral::DWT;
use embassy_stm32::interrupt;
use embassy_stm32::pac::adc::Adc;
use embassy_stm32::pac::adc::vals::{Adcaldif, Adstp, Dmacfg, Dmaen, Exten, Ovrmod, SampleTime};
use embassy_stm32::pac::adccommon::vals::Ckmode;
use embassy_stm32::pac::bdma::vals::{Dir, Pl, Size};
use embassy_stm32::pac::timer::vals::Mms;
use embassy_stm32::pac::{ADC1, ADC2, ADC3, ADC4, ADC12_COMMON, ADC345_COMMON, DMA2, DMAMUX1, GPIOA, GPIOB, RCC, TIM6};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, block_for};
use foxhound_computer::SAMPLES_PER_CHANNEL as N;
use foxhound_computer::sampling::{Sampling, Timer};
use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::time;

use super::CLOCK_MHZ;
use crate::register_values::{half_block_us, patience_us, ring_half};

/// TIM6, by which samples are taken.
pub const TIMER: Timer =
    Timer { clock_hz: CLOCK_MHZ * 1_000_000 / DIVIDER, cycles_min: CYCLES_PER_CONVERSION, cycles_max: 1 << 16 };
/// HCLK is divided by this for the converters, and for TIM6.
const DIVIDER: u32 = 4;
/// 92.5 and 12.5 cycles, and three more from the trigger on.
const CYCLES_PER_CONVERSION: u32 = 105 + 3;
/// `TIM6_TRGO`, for the regular groups of all converters.
const TRIGGER: u8 = 13;
/// The first DMA multiplexer channel of DMA2.
const DMAMUX_OF_DMA2: usize = 8;
/// Longest wait for the hardware.
const WAIT_CYCLES: u32 = 1_000 * CLOCK_MHZ;

struct Channel {
    converter: Adc,
    input: u8,
    request: u8,
}

const CHANNEL: [Channel; CHANNELS] = [
    Channel { converter: ADC1, input: 1, request: 5 },
    Channel { converter: ADC2, input: 2, request: 36 },
    Channel { converter: ADC3, input: 12, request: 37 },
    Channel { converter: ADC4, input: 3, request: 38 },
];

/// Written by DMA: a ring of two blocks for each channel.
static RINGS: [[[AtomicU16; N]; 2]; CHANNELS] = [const { [const { [const { AtomicU16::new(0) }; N] }; 2] }; CHANNELS];
/// Halves that have been filled since the start.
static FILLED: AtomicU32 = AtomicU32::new(0);
/// One in this many blocks is passed on.
static BLOCKS: AtomicU32 = AtomicU32::new(0);
static READY: Signal<CriticalSectionRawMutex, Block> = Signal::new();

/// A block that is waiting to be read.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    /// `FILLED` when the block was full.
    count: u32,
    /// The half of the ring.
    half: usize,
    /// When its last sample was taken.
    end: Instant,
}

/// Why there will be no frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trouble {
    /// This converter, 0..4, does not calibrate itself.
    Calibration(usize),
    /// It does not get ready.
    Start(usize),
    /// It does not stop.
    Stop(usize),
}

impl Trouble {
    /// Text for the pilot.
    pub fn words(self) -> &'static str {
        match self {
            Self::Calibration(0) => "Foxhound: ADC1 does not calibrate",
            Self::Calibration(1) => "Foxhound: ADC2 does not calibrate",
            Self::Calibration(2) => "Foxhound: ADC3 does not calibrate",
            Self::Calibration(_) => "Foxhound: ADC4 does not calibrate",
            Self::Start(0) => "Foxhound: ADC1 does not start",
            Self::Start(1) => "Foxhound: ADC2 does not start",
            Self::Start(2) => "Foxhound: ADC3 does not start",
            Self::Start(_) => "Foxhound: ADC4 does not start",
            Self::Stop(_) => "Foxhound: an ADC does not stop",
        }
    }
}

/// Waits for the hardware; false on timeout.
fn wait(until: impl Fn() -> bool) -> bool {
    let begin = DWT::cycle_count();
    while DWT::cycle_count().wrapping_sub(begin) < WAIT_CYCLES {
        if until() {
            return true;
        }
    }
    until()
}

/// The four channels; they run from the first [`sample`](Self::sample) on.
#[derive(Debug)]
pub struct Acquisition {
    sampling: Option<Sampling>,
    trouble: Option<Trouble>,
    restarts: u32,
}

impl Acquisition {
    /// Calibrates. Call it once, when the clocks and the cycle counter run; takes some hundred microseconds.
    pub fn new() -> Self {
        RCC.ahb1enr().modify(|w| {
            w.set_dma2en(true);
            w.set_dmamux1en(true);
        });
        RCC.ahb2enr().modify(|w| {
            w.set_adc12en(true);
            w.set_adc345en(true);
            w.set_gpioaen(true);
            w.set_gpioben(true);
        });
        RCC.apb1enr1().modify(|w| w.set_tim6en(true));
        // A clock takes two cycles to arrive: the read is the wait.
        let _ = RCC.apb1enr1().read();

        // Analogue, without pull: PA0, PA1, PB0, PB12.
        for (port, pin) in [(GPIOA, 0), (GPIOA, 1), (GPIOB, 0), (GPIOB, 12)] {
            port.moder().modify(|w| w.set_moder(pin, embassy_stm32::pac::gpio::vals::Moder::ANALOG));
            port.pupdr().modify(|w| w.set_pupdr(pin, embassy_stm32::pac::gpio::vals::Pupdr::FLOATING));
        }

        // Only while all converters are off.
        ADC12_COMMON.ccr().modify(|w| w.set_ckmode(Ckmode::SYNC_DIV4));
        ADC345_COMMON.ccr().modify(|w| w.set_ckmode(Ckmode::SYNC_DIV4));

        for Channel { converter, .. } in &CHANNEL {
            converter.cr().modify(|w| w.set_deeppwd(false));
            converter.cr().modify(|w| w.set_advregen(true));
        }
        // The regulators' start-up time, t_ADCVREG_STUP, is 20 us at most.
        block_for(Duration::from_micros(25));
        let mut trouble = None;
        for (channel, Channel { converter, .. }) in CHANNEL.iter().enumerate() {
            converter.cr().modify(|w| w.set_adcaldif(Adcaldif::SINGLE_ENDED));
            converter.cr().modify(|w| w.set_adcal(true));
            if !wait(|| !converter.cr().read().adcal()) {
                trouble.get_or_insert(Trouble::Calibration(channel));
            }
        }
        // ADEN may be set four converter clocks after the calibration at the earliest.
        block_for(Duration::from_micros(2));
        for (channel, Channel { converter, input, .. }) in CHANNEL.iter().enumerate() {
            converter.isr().write(|w| w.set_adrdy(true));
            converter.cr().modify(|w| w.set_aden(true));
            if !wait(|| converter.isr().read().adrdy()) {
                trouble.get_or_insert(Trouble::Start(channel));
            }
            converter.sqr1().write(|w| {
                w.set_l(0);
                w.set_sq(0, *input);
            });
            if *input < 10 {
                converter.smpr().write(|w| w.set_smp(usize::from(*input), SampleTime::CYCLES92_5));
            } else {
                converter.smpr2().write(|w| w.set_smp(usize::from(*input) - 10, SampleTime::CYCLES92_5));
            }
            converter.cfgr().write(|w| {
                w.set_exten(Exten::RISING_EDGE);
                w.set_extsel(TRIGGER);
                w.set_ovrmod(Ovrmod::PRESERVE);
                w.set_dmacfg(Dmacfg::CIRCULAR);
                w.set_jqdis(true);
            });
        }

        TIM6.psc().write_value(DIVIDER as u16 - 1);
        TIM6.cr2().modify(|w| w.set_mms(Mms::UPDATE));
        // SAFETY: the handler below is ready, and no mask-based critical section is in use.
        unsafe { cortex_m::peripheral::NVIC::unmask(interrupt::DMA2_CHANNEL4) };
        Self { sampling: None, trouble, restarts: 0 }
    }

    /// Uses this sampling from now on.
    pub fn sample(&mut self, sampling: Sampling) {
        if self.sampling == Some(sampling) {
            return;
        }
        self.halt();
        TIM6.arr().write(|w| w.set_arr((sampling.cycles - 1) as u16));
        BLOCKS.store(sampling.blocks, Ordering::Relaxed);
        self.sampling = Some(sampling);
        self.arm();
    }

    /// Starts everything anew, after an overrun or when no block comes.
    pub fn restart(&mut self) {
        self.restarts = self.restarts.wrapping_add(1);
        self.halt();
        self.arm();
    }

    fn halt(&mut self) {
        TIM6.cr1().modify(|w| w.set_cen(false));
        for (channel, Channel { converter, .. }) in CHANNEL.iter().enumerate() {
            if converter.cr().read().adstart() {
                converter.cr().modify(|w| w.set_adstp(Adstp::STOP));
                if !wait(|| !converter.cr().read().adstart()) {
                    self.trouble.get_or_insert(Trouble::Stop(channel));
                }
            }
        }
        for (channel, Channel { converter, .. }) in CHANNEL.iter().enumerate() {
            // The request of a result that was not fetched goes with DMAEN, the result with a read; then its flags.
            converter.cfgr().modify(|w| w.set_dmaen(Dmaen::DISABLE));
            DMA2.ch(channel).cr().modify(|w| w.set_en(false));
            let _ = converter.dr().read();
            converter.isr().write(|w| {
                w.set_ovr(true);
                w.set_eoc(true);
                w.set_eos(true);
            });
        }
    }

    /// Points the DMA channels at the rings' beginnings, starts the converters, then the timer: the first trigger comes
    /// a period later and finds all four waiting.
    fn arm(&self) {
        if self.trouble.is_some() || self.sampling.is_none() {
            return;
        }
        DMA2.ifcr().write(|w| (0..CHANNELS).for_each(|channel| w.set_gif(channel, true)));
        FILLED.store(0, Ordering::Relaxed);
        READY.reset();
        // Loads the prescaler, and is a trigger: long before the converters wait for one, since some of them might miss it.
        TIM6.egr().write(|w| w.set_ug(true));
        for ((index, Channel { converter, request, .. }), ring) in CHANNEL.iter().enumerate().zip(&RINGS) {
            DMAMUX1.ccr(DMAMUX_OF_DMA2 + index).write(|w| w.set_dmareq_id(*request));
            let dma = DMA2.ch(index);
            dma.par().write_value(converter.dr().as_ptr() as u32);
            dma.mar().write_value(ring.as_ptr() as u32);
            dma.ndtr().write(|w| w.set_ndt(2 * N as u16));
            let last = index == CHANNELS - 1;
            dma.cr().write(|w| {
                w.set_dir(Dir::FROM_PERIPHERAL);
                w.set_circ(true);
                w.set_minc(true);
                w.set_psize(Size::BITS16);
                w.set_msize(Size::BITS16);
                w.set_pl(Pl::VERY_HIGH);
                w.set_htie(last);
                w.set_tcie(last);
                w.set_en(true);
            });
        }
        for Channel { converter, .. } in &CHANNEL {
            converter.cfgr().modify(|w| w.set_dmaen(Dmaen::ENABLE));
            converter.cr().modify(|w| w.set_adstart(true));
        }
        TIM6.cr1().modify(|w| w.set_cen(true));
    }

    /// Waits for the next block that is to be passed on.
    pub async fn ready(&mut self) -> Block {
        READY.wait().await
    }

    /// Copies a block into a frame. False if it came too late or a result was lost: the frame must not be used then,
    /// and after a loss everything has been started anew.
    pub fn take(&mut self, block: Block, snapshot: &mut AdcFrame<N>) -> bool {
        if CHANNEL.iter().any(|channel| channel.converter.isr().read().ovr()) || !is_in_step() {
            self.restart();
            return false;
        }
        compiler_fence(Ordering::Acquire);
        // DMA has filled this half and writes the other one for the next 2.5 ms; if we are later than that, the check below
        // says so and what was read is thrown away.
        let codes = |[first, second]: &'static [[AtomicU16; N]; 2]| {
            let half = if block.half == 0 { first } else { second };
            half.iter().map(|code| code.load(Ordering::Relaxed))
        };
        let raw = RINGS.each_ref().map(codes);
        let cycles = self.sampling.map_or(0, |sampling| sampling.cycles * DIVIDER);
        let half_block = Duration::from_micros(half_block_us(N as u64, cycles, CLOCK_MHZ));
        let middle = time::Instant(block.end.saturating_sub(half_block).as_micros());
        snapshot.fill_from_unsigned(middle, raw);
        compiler_fence(Ordering::Acquire);
        FILLED.load(Ordering::Relaxed) == block.count
    }

    /// Longest wait for a frame: the time of two missing ones, and a twentieth. The autopilot's bytes of that time
    /// fit its ring.
    pub fn patience(&self) -> Duration {
        let cycles =
            self.sampling.map_or(0, |sampling| u64::from(sampling.cycles * DIVIDER * sampling.blocks) * N as u64);
        Duration::from_micros(patience_us(cycles, CLOCK_MHZ))
    }

    /// Why there are no frames, permanently.
    pub fn trouble(&self) -> Option<Trouble> {
        self.trouble
    }

    /// Number of new starts.
    pub fn restarts(&self) -> u32 {
        self.restarts
    }
}

/// Whether the four rings are equally full: a converter that has missed a trigger, or has stopped, stays behind the others.
#[inline(never)]
fn is_in_step() -> bool {
    // Their results are fetched one after the other, within a microsecond of ten.
    (0..3).any(|_| {
        let [one, two, three, four] = core::array::from_fn(|channel| DMA2.ch(channel).ndtr().read().0);
        let is_equal = (one ^ four) | (two ^ four) | (three ^ four) == 0;
        if !is_equal {
            cortex_m::asm::delay(CLOCK_MHZ * 2);
        }
        is_equal
    })
}

/// A half of the last ring is full; those of the other channels have been since some hundred nanoseconds.
#[interrupt]
fn DMA2_CHANNEL4() {
    let end = Instant::now();
    let flags = DMA2.isr().read();
    let (half, full) = (flags.htif(3), flags.tcif(3));
    DMA2.ifcr().write(|w| {
        w.set_htif(3, half);
        w.set_tcif(3, full);
    });
    if !half && !full {
        // Left over from before a restart.
        return;
    }
    let count = FILLED.load(Ordering::Relaxed).wrapping_add(1);
    FILLED.store(count, Ordering::Relaxed);
    if half && full {
        // Late by a whole block or, while a page of the flash is erased, by several: how many is not known, nor when the last ended.
        return;
    }
    if count.is_multiple_of(BLOCKS.load(Ordering::Relaxed).max(1)) {
        // From the counter, since interrupts may have been missed.
        let half = ring_half(usize::from(DMA2.ch(3).ndtr().read().ndt()), N);
        READY.signal(Block { count, half, end });
    }
}
