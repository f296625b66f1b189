//! The serial lines, 8N1, by DMA: two of 921 600 baud in both directions, and one of 230 400, with a radio of 115 200 or
//! 1 000 000, that only receives.
//!
//! | line | pins | DMA1 | request |
//! |---|---|---|---|
//! | autopilot, USART1 | TX PA9, RX PA10 (alternate function 7) | channel 1 sends, 2 receives | 25, 24 |
//! | maintenance port, LPUART1 | TX PA2, RX PA3 (alternate function 12) | channel 3 sends, 4 receives | 35, 34 |
//! | lidar or radio, USART3 | RX PC11 (alternate function 7) | channel 5 receives | 28 |
//!
//! After RM0440, chapters DMA, DMAMUX, USART and LPUART:
//!
//! - **Receiving.** A circular transfer fills a ring and never stops ([`foxhound_computer::circular`] reads behind
//!   it). With DDRE = 0 (`USART_CR3`) a byte with noise or a framing error raises its flag and no DMA request: it is
//!   dropped, and the next good byte is transferred. So nothing has to be restarted after an error; the interrupt
//!   clears the flag and counts. An overrun (ORE) keeps the byte in the data register, which DMA fetches; bytes
//!   received meanwhile are lost. A channel is never disabled and enabled again without new values in its registers
//!   ("suspend and resume" is not supported).
//! - **Sending.** Bytes are copied into a buffer of the line, which DMA can reach and which outlives the transfer.
//! - **Pull-ups** on the inputs: an open input is an idle line.

use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering, fence};
use core::task::Poll;

use embassy_stm32::interrupt;
use embassy_stm32::pac::bdma::vals::{Dir, Pl, Size};
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr, Pupdr};
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::pac::{DMA1, DMAMUX1, GPIOA, GPIOC, LPUART1, RCC, USART1, USART3};
use embassy_sync::waitqueue::AtomicWaker;
use foxhound_computer::circular::{self, Counts, Cursor};
use foxhound_computer::part;
use foxhound_computer::port::Waiting;
use foxhound_computer::radio;
use foxhound_core::guidance;

use super::CLOCK_MHZ;
use crate::board::{self, Read, Write};
use crate::register_values::baud_divider;

const BAUD: u32 = 921_600;
const LIDAR_BAUD: u32 = 230_400;
/// Bytes that are sent in one transfer.
const PIECE_BYTES: usize = 128;
/// 44 ms at the full rate: two steps of guidance.
const RING_BYTES: usize = 4096;
/// 22 ms of a camera's bytes, more than twice those of a step's budget; without one it is for what is typed.
const PORT_RING_BYTES: usize = if cfg!(feature = "pad") { 2048 } else { 256 };
/// 44 ms of a lidar at the full rate, two steps of guidance; 20.5 ms of IQ reports, one step.
const SENSOR_RING_BYTES: usize = if cfg!(feature = "iq") { 2048 } else { 1024 };

type Bytes<const N: usize> = [AtomicU8; N];

static RING: Bytes<RING_BYTES> = [const { AtomicU8::new(0) }; RING_BYTES];
static PIECE: Bytes<PIECE_BYTES> = [const { AtomicU8::new(0) }; PIECE_BYTES];
static PORT_RING: Bytes<PORT_RING_BYTES> = [const { AtomicU8::new(0) }; PORT_RING_BYTES];
static SENSOR_RING: Bytes<SENSOR_RING_BYTES> = [const { AtomicU8::new(0) }; SENSOR_RING_BYTES];
static PORT_PIECE: Bytes<PIECE_BYTES> = [const { AtomicU8::new(0) }; PIECE_BYTES];

/// A channel of DMA1, by its index from 0, and its request.
struct Channel {
    index: usize,
    request: u8,
}

/// A serial line.
struct Line {
    uart: Usart,
    /// `None` if it only receives.
    sends: Option<Channel>,
    receives: Channel,
    /// DMA writes it.
    ring: &'static [AtomicU8],
    /// DMA reads it.
    piece: &'static [AtomicU8],
    /// How often the ring was filled.
    laps: AtomicU32,
    /// Interrupts for noise, framing errors and overruns.
    errors: AtomicU32,
    /// DMA has stopped receiving, by a bus error or for another bit rate.
    is_stopped: AtomicBool,
    is_sending: AtomicBool,
    received: AtomicWaker,
    sent: AtomicWaker,
}

static AUTOPILOT: Line =
    Line::new(USART1, Some(Channel { index: 0, request: 25 }), Channel { index: 1, request: 24 }, &RING, &PIECE);
static PORT: Line = Line::new(
    // SAFETY: the registers that are used lie at the same places in both.
    unsafe { Usart::from_ptr(LPUART1.as_ptr()) },
    Some(Channel { index: 2, request: 35 }),
    Channel { index: 3, request: 34 },
    &PORT_RING,
    &PORT_PIECE,
);
static SENSOR: Line = Line::new(USART3, None, Channel { index: 4, request: 28 }, &SENSOR_RING, &[]);

/// The receiving end of a line.
pub struct Receiver {
    line: &'static Line,
    cursor: Cursor,
}

/// The sending end of a line.
pub struct Transmitter(&'static Line);

/// The lines of the autopilot, the maintenance port and the sensor. Call it once, when the clocks run.
pub(super) fn start() -> ([(Receiver, Transmitter); 2], Receiver) {
    RCC.ahb1enr().modify(|w| {
        w.set_dma1en(true);
        w.set_dmamux1en(true);
    });
    RCC.ahb2enr().modify(|w| {
        w.set_gpioaen(true);
        w.set_gpiocen(true);
    });
    RCC.apb2enr().modify(|w| w.set_usart1en(true));
    RCC.apb1enr1().modify(|w| w.set_usart3en(true));
    RCC.apb1enr2().modify(|w| w.set_lpuart1en(true));
    // A clock takes two cycles to arrive: the read is the wait.
    let _ = RCC.apb1enr2().read();
    let clock_hz = CLOCK_MHZ * 1_000_000;
    let ends = [
        AUTOPILOT.start(baud_divider(clock_hz, BAUD, 1)),
        // LPUART: 256 times finer.
        PORT.start(baud_divider(clock_hz, BAUD, 256)),
    ];
    let (sensor, _) = SENSOR.start(baud_divider(clock_hz, LIDAR_BAUD, 1));
    GPIOC.afr(1).modify(|w| w.set_afr(11 % 8, 7));
    GPIOC.pupdr().modify(|w| w.set_pupdr(11, Pupdr::PULL_UP));
    GPIOC.moder().modify(|w| w.set_moder(11, Moder::ALTERNATE));
    for (transmits, receives, function) in [(9, 10, 7), (2, 3, 12)] {
        for pin in [transmits, receives] {
            GPIOA.afr(pin / 8).modify(|w| w.set_afr(pin % 8, function));
        }
        GPIOA.ospeedr().modify(|w| w.set_ospeedr(transmits, Ospeedr::HIGH_SPEED));
        GPIOA.pupdr().modify(|w| {
            w.set_pupdr(transmits, Pupdr::FLOATING);
            w.set_pupdr(receives, Pupdr::PULL_UP);
        });
        GPIOA.moder().modify(|w| {
            w.set_moder(transmits, Moder::ALTERNATE);
            w.set_moder(receives, Moder::ALTERNATE);
        });
    }
    for vector in [interrupt::USART1, interrupt::LPUART1, interrupt::USART3] {
        // SAFETY: the handlers below are ready, and no mask-based critical section is in use. Those of DMA1 embassy has enabled.
        unsafe { cortex_m::peripheral::NVIC::unmask(vector) };
    }
    (ends, sensor)
}

/// Gives the sensor's line the bit rate of the configured sensor.
pub(super) fn follow(config: &guidance::Config) {
    let baud = config.radio.map_or(LIDAR_BAUD, |mount| radio::baud(mount.sends));
    SENSOR.set_divider(baud_divider(CLOCK_MHZ * 1_000_000, baud, 1));
}

impl Line {
    const fn new(
        uart: Usart,
        sends: Option<Channel>,
        receives: Channel,
        ring: &'static [AtomicU8],
        piece: &'static [AtomicU8],
    ) -> Self {
        // Circular reading counts modulo 2^32.
        assert!(ring.len().is_power_of_two());
        Self {
            uart,
            sends,
            receives,
            ring,
            piece,
            laps: AtomicU32::new(0),
            errors: AtomicU32::new(0),
            is_stopped: AtomicBool::new(false),
            is_sending: AtomicBool::new(false),
            received: AtomicWaker::new(),
            sent: AtomicWaker::new(),
        }
    }

    fn start(&'static self, divider: u32) -> (Receiver, Transmitter) {
        let uart = self.uart;
        uart.cr1().write(|_| {});
        uart.cr2().write(|_| {});
        uart.cr3().write(|_| {});
        uart.brr().write(|w| w.0 = divider);
        if let Some(sends) = &self.sends {
            DMAMUX1.ccr(sends.index).write(|w| w.set_dmareq_id(sends.request));
        }
        DMAMUX1.ccr(self.receives.index).write(|w| w.set_dmareq_id(self.receives.request));
        self.receive();
        uart.cr3().write(|w| {
            w.set_eie(true);
            w.set_dmar(true);
            w.set_dmat(self.sends.is_some());
        });
        uart.cr1().write(|w| {
            w.set_idleie(true);
            w.set_te(self.sends.is_some());
            w.set_re(true);
            w.set_ue(true);
        });
        (Receiver { line: self, cursor: Cursor::new() }, Transmitter(self))
    }

    /// Changes the bit rate, for which the UART has to be off (RM0440, `USART_BRR`), and before it its DMA channel
    /// (`USART_CR1`, UE); what is being received is lost.
    fn set_divider(&self, divider: u32) {
        let uart = self.uart;
        if uart.brr().read().0 != divider {
            DMA1.ch(self.receives.index).cr().modify(|w| w.set_en(false));
            uart.cr1().modify(|w| w.set_ue(false));
            uart.brr().write(|w| w.0 = divider);
            self.receive();
            uart.cr1().modify(|w| w.set_ue(true));
            // The reader begins anew, too.
            self.is_stopped.store(true, Ordering::Relaxed);
        }
    }

    /// Lets DMA fill the ring from its beginning.
    fn receive(&self) {
        let channel = self.receives.index;
        let dma = DMA1.ch(channel);
        dma.cr().modify(|w| w.set_en(false));
        DMA1.ifcr().write(|w| w.set_gif(channel, true));
        self.laps.store(0, Ordering::Relaxed);
        dma.par().write_value(self.uart.rdr().as_ptr() as u32);
        dma.mar().write_value(self.ring.as_ptr() as u32);
        dma.ndtr().write(|w| w.set_ndt(self.ring.len() as u16));
        dma.cr().write(|w| {
            w.set_dir(Dir::FROM_PERIPHERAL);
            w.set_circ(true);
            w.set_minc(true);
            w.set_psize(Size::BITS8);
            w.set_msize(Size::BITS8);
            w.set_pl(Pl::HIGH);
            w.set_htie(true);
            w.set_tcie(true);
            w.set_teie(true);
            w.set_en(true);
        });
    }

    /// Bytes that DMA has written into the ring since it began.
    fn written(&self) -> u32 {
        let left = || u32::from(DMA1.ch(self.receives.index).ndtr().read().ndt());
        critical_section::with(|_| {
            let (mut laps, mut at) = (self.laps.load(Ordering::Relaxed), left());
            if DMA1.isr().read().tcif(self.receives.index) {
                // Its interrupt has not come through yet.
                (laps, at) = (laps.wrapping_add(1), left());
            }
            circular::written(laps, at, self.ring.len() as u32)
        })
    }

    /// Waits until nothing is being sent.
    async fn idle(&self) {
        poll_fn(|context| {
            self.sent.register(context.waker());
            if self.is_sending.load(Ordering::Acquire) { Poll::Pending } else { Poll::Ready(()) }
        })
        .await;
    }

    fn on_uart(&self) {
        let flags = self.uart.isr().read();
        self.uart.icr().write(|w| {
            w.set_pe(flags.pe());
            w.set_fe(flags.fe());
            w.set_ne(flags.ne());
            w.set_ore(flags.ore());
            w.set_idle(flags.idle());
        });
        if flags.fe() || flags.ne() || flags.ore() {
            self.errors.store(self.errors.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
        }
        if flags.idle() {
            self.received.wake();
        }
    }

    fn on_received(&self) {
        let channel = self.receives.index;
        let flags = DMA1.isr().read();
        let (half, full, error) = (flags.htif(channel), flags.tcif(channel), flags.teif(channel));
        DMA1.ifcr().write(|w| {
            w.set_htif(channel, half);
            w.set_tcif(channel, full);
            w.set_teif(channel, error);
        });
        if full {
            self.laps.store(self.laps.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
        }
        if error {
            self.is_stopped.store(true, Ordering::Relaxed);
        }
        self.received.wake();
    }

    fn on_sent(&self) {
        let Some(Channel { index: channel, .. }) = self.sends else { return };
        let flags = DMA1.isr().read();
        let (half, full, error) = (flags.htif(channel), flags.tcif(channel), flags.teif(channel));
        DMA1.ifcr().write(|w| {
            w.set_htif(channel, half);
            w.set_tcif(channel, full);
            w.set_teif(channel, error);
        });
        if full || error {
            self.is_sending.store(false, Ordering::Release);
            self.sent.wake();
        }
    }
}

impl board::Receiver for Receiver {
    fn try_read(&mut self, bytes: &mut [u8]) -> usize {
        let line = self.line;
        if line.is_stopped.swap(false, Ordering::Relaxed) {
            line.receive();
            self.cursor.begin_anew();
        }
        let byte = |index: usize| line.ring.get(index).map_or(0, |byte| byte.load(Ordering::Relaxed));
        self.cursor.take(bytes, line.ring.len() as u32, || line.written(), byte)
    }

    fn waiting(&self) -> Waiting {
        let Counts { lost, most } = self.cursor.counts();
        Waiting { most, room: self.line.ring.len() as u32, lost }
    }

    /// Interrupts for noise, framing errors and overruns since the start.
    fn errors(&self) -> u32 {
        self.line.errors.load(Ordering::Relaxed)
    }
}

impl Read for Receiver {
    /// Waits until the line is idle or a half of the ring is full.
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        poll_fn(|context| {
            self.line.received.register(context.waker());
            match board::Receiver::try_read(self, bytes) {
                0 => Poll::Pending,
                count => Poll::Ready(count),
            }
        })
        .await
    }
}

impl Write for Transmitter {
    /// Returns when DMA has handed over the last byte.
    async fn write(&mut self, bytes: &[u8]) {
        let line = self.0;
        let Some(Channel { index: channel, .. }) = line.sends else { return };
        let dma = DMA1.ch(channel);
        for piece in part::pieces(bytes, line.piece.len()) {
            // A transfer whose future was dropped is still in progress.
            line.idle().await;
            for (slot, byte) in line.piece.iter().zip(piece) {
                slot.store(*byte, Ordering::Relaxed);
            }
            line.is_sending.store(true, Ordering::Relaxed);
            // DMA reads the memory after this.
            fence(Ordering::SeqCst);
            dma.cr().modify(|w| w.set_en(false));
            dma.par().write_value(line.uart.tdr().as_ptr() as u32);
            dma.mar().write_value(line.piece.as_ptr() as u32);
            dma.ndtr().write(|w| w.set_ndt(piece.len() as u16));
            dma.cr().write(|w| {
                w.set_dir(Dir::FROM_MEMORY);
                w.set_minc(true);
                w.set_psize(Size::BITS8);
                w.set_msize(Size::BITS8);
                w.set_pl(Pl::MEDIUM);
                w.set_tcie(true);
                w.set_teie(true);
                w.set_en(true);
            });
            line.idle().await;
        }
    }
}

#[interrupt]
fn USART1() {
    AUTOPILOT.on_uart();
}

#[interrupt]
fn LPUART1() {
    PORT.on_uart();
}

#[interrupt]
fn USART3() {
    SENSOR.on_uart();
}

#[interrupt]
fn DMA1_CHANNEL1() {
    AUTOPILOT.on_sent();
}

#[interrupt]
fn DMA1_CHANNEL2() {
    AUTOPILOT.on_received();
}

#[interrupt]
fn DMA1_CHANNEL3() {
    PORT.on_sent();
}

#[interrupt]
fn DMA1_CHANNEL4() {
    PORT.on_received();
}

#[interrupt]
fn DMA1_CHANNEL5() {
    SENSOR.on_received();
}
