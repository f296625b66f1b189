//! The serial lines: UART0 to the autopilot, UART1 to the simulator, UART2 the maintenance port.
//!
//! Bytes are received by interrupt into a ring. When the ring is full the interrupt is masked until the ring is read:
//! the byte stays in the receiver, and QEMU makes the sender wait.
//!
//! Bytes of the autopilot, and of a camera, also come through the memory shared with the simulator, as by DMA: layout
//! in `foxhound_computer::twin`. QEMU's serial line costs the simulator's machine a dozen thread switches per byte. A
//! simulator that flies for hours fills the rings before it rings the doorbell; one that does not uses UART0 and
//! UART2. Bytes written before the setup of this start belong to the last one. Those of a sensor come only through the
//! memory.

use core::future::{Future as _, poll_fn};
use core::ops::Range;
use core::pin::Pin;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering, fence};
use core::task::{Poll, Waker};

use cortex_m::peripheral::NVIC;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::waitqueue::AtomicWaker;

use foxhound_computer::part::{self, Refused};
use foxhound_computer::port::Waiting;
use foxhound_computer::twin::{
    LINE_AT, LINE_BYTES, LINE_TOTAL_AT, PORT_AT, PORT_BYTES, PORT_TOTAL_AT, SENSOR_AT, SENSOR_BYTES, SENSOR_TOTAL_AT,
};

use super::PSRAM;
use super::interrupt::{Interrupt, unmask};
use super::registers::{Peripheral, Register, UART0, UART1, UART2};
use crate::board::{self, Read, Write};
use crate::register_values::baud_divider;

const TX_FULL: u32 = 1;
const RX_FULL: u32 = 1 << 1;

const TX_ENABLE: u32 = 1;
const RX_ENABLE: u32 = 1 << 1;
const TX_INTERRUPT_ENABLE: u32 = 1 << 2;
const RX_INTERRUPT_ENABLE: u32 = 1 << 3;

const TX_INTERRUPT: u32 = 1;
const RX_INTERRUPT: u32 = 1 << 1;

const DIVIDER: u32 = baud_divider(25_000_000, 921_600, 1);

/// Bytes of a step of 20 ms at 921 600 baud.
const RING_BYTES: usize = 2048;
static RING: Pipe<CriticalSectionRawMutex, RING_BYTES> = Pipe::new();
/// As on the NUCLEO-G474RE.
const PIECE_BYTES: usize = 128;
/// Memory of the twin that its DMA would reach: program and data.
const DMA_REACHES: [Range<usize>; 2] = [0..0x0008_0000, 0x2000_0000..0x2002_0000];
static IS_SENDING: AtomicBool = AtomicBool::new(false);
static PORT_IS_SENDING: AtomicBool = AtomicBool::new(false);
static BELL: Pipe<CriticalSectionRawMutex, 16> = Pipe::new();
static TYPED: Pipe<CriticalSectionRawMutex, 64> = Pipe::new();
static ROOM: AtomicWaker = AtomicWaker::new();
static PORT_ROOM: AtomicWaker = AtomicWaker::new();
static DRAINED: AtomicWaker = AtomicWaker::new();
static SENT: AtomicU32 = AtomicU32::new(0);

/// Opens the lines.
pub fn start() {
    for uart in [UART0, UART1, UART2] {
        uart.write(Register::Divider, DIVIDER);
    }
    for uart in [UART0, UART2] {
        uart.write(Register::Control, TX_ENABLE | RX_ENABLE | TX_INTERRUPT_ENABLE | RX_INTERRUPT_ENABLE);
    }
    UART1.write(Register::Control, TX_ENABLE | RX_ENABLE | RX_INTERRUPT_ENABLE);
    unmask(Interrupt::Uart0Rx);
    unmask(Interrupt::Uart1Rx);
    unmask(Interrupt::Uart2Rx);
}

/// From the autopilot.
#[derive(Debug)]
pub struct Receiver {
    /// The largest number of bytes that waited at once.
    most: u32,
}

/// To the autopilot.
#[derive(Debug)]
pub struct Transmitter(());

/// To and from the simulator.
#[derive(Debug)]
pub struct Doorbell(());

/// The ends of the lines, once.
pub(super) fn ends() -> (Receiver, Transmitter, Doorbell) {
    (Receiver { most: 0 }, Transmitter(()), Doorbell(()))
}

/// From the maintenance port.
#[derive(Debug)]
pub struct ConsoleReceiver(());

/// To the maintenance port.
#[derive(Debug)]
pub struct ConsoleTransmitter(());

/// The ends of the maintenance port, once.
pub(super) fn console_ends() -> (ConsoleReceiver, ConsoleTransmitter) {
    (ConsoleReceiver(()), ConsoleTransmitter(()))
}

impl board::Receiver for Receiver {
    fn try_read(&mut self, bytes: &mut [u8]) -> usize {
        self.most = self.most.max(RING.len() as u32);
        let count = match AUTOPILOT.take(bytes, Waker::noop()) {
            0 => RING.try_read(bytes).unwrap_or(0),
            count => count,
        };
        unmask(Interrupt::Uart0Rx);
        count
    }

    /// Bytes that waited in the ring.
    fn waiting(&self) -> Waiting {
        Waiting { most: self.most, room: RING_BYTES as u32, lost: 0 }
    }

    /// There is no noise on the line.
    fn errors(&self) -> u32 {
        0
    }
}

impl Read for Receiver {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        let count = poll_fn(|context| match AUTOPILOT.take(bytes, context.waker()) {
            0 => Pin::new(&mut RING.read(bytes)).poll(context),
            count => Poll::Ready(count),
        })
        .await;
        unmask(Interrupt::Uart0Rx);
        count
    }
}

/// From the sensor.
#[derive(Debug)]
pub struct SensorReceiver {
    /// The largest number of bytes that waited at once.
    most: u32,
}

impl SensorReceiver {
    pub(super) const fn new() -> Self {
        Self { most: 0 }
    }
}

impl board::Receiver for SensorReceiver {
    fn try_read(&mut self, bytes: &mut [u8]) -> usize {
        self.most = self.most.max(SENSOR.waiting());
        SENSOR.take(bytes, Waker::noop())
    }

    fn waiting(&self) -> Waiting {
        Waiting { most: self.most, room: SENSOR_BYTES as u32, lost: 0 }
    }

    fn errors(&self) -> u32 {
        0
    }
}

impl Read for SensorReceiver {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        self.most = self.most.max(SENSOR.waiting());
        poll_fn(|context| match SENSOR.take(bytes, context.waker()) {
            0 => Poll::Pending,
            count => Poll::Ready(count),
        })
        .await
    }
}

impl Write for Transmitter {
    /// Returns when the last byte has been taken.
    async fn write(&mut self, bytes: &[u8]) {
        for piece in part::pieces(bytes, PIECE_BYTES) {
            let transfer = Transfer::begin(&IS_SENDING, piece);
            for byte in piece {
                send(UART0, Interrupt::Uart0Tx, &ROOM, *byte).await;
                SENT.fetch_add(1, Ordering::Relaxed);
            }
            transfer.end();
        }
        DRAINED.wake();
    }
}

/// Stands for a DMA transfer: one that the chip would refuse ends the program here.
struct Transfer(&'static AtomicBool);

impl Transfer {
    fn begin(is_sending: &'static AtomicBool, piece: &[u8]) -> Self {
        let is_busy = is_sending.swap(true, Ordering::Relaxed);
        let taken = part::transfer(piece.as_ptr().addr(), piece.len(), &DMA_REACHES);
        if let Err(refused) = if is_busy { Err(Refused::Busy) } else { taken } {
            super::ending::halt(refused.words());
        }
        Self(is_sending)
    }

    fn end(self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// Sends a byte as soon as the line takes one.
async fn send(uart: Peripheral, interrupt: Interrupt, room: &AtomicWaker, byte: u8) {
    poll_fn(|context| {
        if uart.read(Register::State) & TX_FULL == 0 {
            return Poll::Ready(());
        }
        room.register(context.waker());
        unmask(interrupt);
        // It may have drained before the interrupt was let through.
        if uart.read(Register::State) & TX_FULL == 0 { Poll::Ready(()) } else { Poll::Pending }
    })
    .await;
    uart.write(Register::Data, u32::from(byte));
}

impl Read for ConsoleReceiver {
    async fn read(&mut self, bytes: &mut [u8]) -> usize {
        let count = poll_fn(|context| match PORT.take(bytes, context.waker()) {
            0 => Pin::new(&mut TYPED.read(bytes)).poll(context),
            count => Poll::Ready(count),
        })
        .await;
        unmask(Interrupt::Uart2Rx);
        count
    }
}

impl Write for ConsoleTransmitter {
    /// Returns when the last byte has been taken.
    async fn write(&mut self, bytes: &[u8]) {
        for piece in part::pieces(bytes, PIECE_BYTES) {
            let transfer = Transfer::begin(&PORT_IS_SENDING, piece);
            for byte in piece {
                send(UART2, Interrupt::Uart2Tx, &PORT_ROOM, *byte).await;
            }
            transfer.end();
        }
    }
}

/// Waits until this many bytes have been sent to the autopilot since the start.
pub(super) async fn drained(total: u32) {
    poll_fn(|context| {
        DRAINED.register(context.waker());
        if SENT.load(Ordering::Relaxed) == total { Poll::Ready(()) } else { Poll::Pending }
    })
    .await;
}

impl Doorbell {
    /// Waits for the doorbell.
    pub async fn wait(&mut self) -> u8 {
        let mut bell = [0];
        BELL.read(&mut bell).await;
        unmask(Interrupt::Uart1Rx);
        bell[0]
    }

    /// Rings. A byte that the line cannot take is dropped: then there is no simulator.
    pub fn ring(&mut self, bell: u8) {
        if UART1.read(Register::State) & TX_FULL == 0 {
            UART1.write(Register::Data, u32::from(bell));
        }
    }
}

fn receive<const N: usize>(uart: Peripheral, interrupt: Interrupt, ring: &Pipe<CriticalSectionRawMutex, N>) {
    uart.write(Register::Interrupt, RX_INTERRUPT);
    while uart.read(Register::State) & RX_FULL != 0 {
        if ring.is_full() {
            NVIC::mask(interrupt);
            NVIC::pend(interrupt);
            return;
        }
        // There is space for one.
        let _ = ring.try_write(&[uart.read(Register::Data) as u8]);
    }
}

pub(super) extern "C" fn on_byte() {
    receive(UART0, Interrupt::Uart0Rx, &RING);
}

pub(super) extern "C" fn on_room() {
    UART0.write(Register::Interrupt, TX_INTERRUPT);
    NVIC::mask(Interrupt::Uart0Tx);
    ROOM.wake();
}

pub(super) extern "C" fn on_port_byte() {
    receive(UART2, Interrupt::Uart2Rx, &TYPED);
}

pub(super) extern "C" fn on_port_room() {
    UART2.write(Register::Interrupt, TX_INTERRUPT);
    NVIC::mask(Interrupt::Uart2Tx);
    PORT_ROOM.wake();
}

pub(super) extern "C" fn on_bell() {
    receive(UART1, Interrupt::Uart1Rx, &BELL);
    AUTOPILOT.wake();
    PORT.wake();
    SENSOR.wake();
}

/// Bytes of the autopilot.
pub(super) static AUTOPILOT: Line = Line::new(LINE_TOTAL_AT, LINE_AT, LINE_BYTES);
/// Bytes of the maintenance port, those of a camera among them.
pub(super) static PORT: Line = Line::new(PORT_TOTAL_AT, PORT_AT, PORT_BYTES);

/// Bytes of the sensor.
pub(super) static SENSOR: Line = Line::new(SENSOR_TOTAL_AT, SENSOR_AT, SENSOR_BYTES);

/// A ring in the shared memory.
pub(super) struct Line {
    total_at: usize,
    from: usize,
    length: usize,
    waker: AtomicWaker,
    is_open: AtomicBool,
    taken: AtomicU32,
}

impl Line {
    const fn new(total_at: usize, from: usize, length: usize) -> Self {
        let (is_open, taken) = (AtomicBool::new(false), AtomicU32::new(0));
        Self { total_at, from, length, waker: AtomicWaker::new(), is_open, taken }
    }

    /// A setup has come: later bytes are for this start.
    pub(super) fn open(&self) {
        if !self.is_open.swap(true, Ordering::Relaxed) {
            self.taken.store(self.total(), Ordering::Relaxed);
        }
    }

    /// The doorbell has rung.
    pub(super) fn wake(&self) {
        self.waker.wake();
    }

    /// Bytes that are available.
    fn waiting(&self) -> u32 {
        if !self.is_open.load(Ordering::Relaxed) {
            return 0;
        }
        self.total().wrapping_sub(self.taken.load(Ordering::Relaxed))
    }

    /// Takes the available bytes; the doorbell wakes the waker.
    pub(super) fn take(&self, bytes: &mut [u8], waker: &Waker) -> usize {
        self.waker.register(waker);
        if !self.is_open.load(Ordering::Relaxed) {
            return 0;
        }
        let taken = self.taken.load(Ordering::Relaxed);
        let count = (self.total().wrapping_sub(taken) as usize).min(bytes.len());
        for (index, byte) in bytes.iter_mut().take(count).enumerate() {
            let address = (PSRAM + self.from + (taken as usize).wrapping_add(index) % self.length) as *const u8;
            // SAFETY: inside the 16 MB PSRAM, where no Rust object lies; volatile, because somebody else writes there.
            *byte = unsafe { address.read_volatile() };
        }
        self.taken.store(taken.wrapping_add(count as u32), Ordering::Relaxed);
        count
    }

    fn total(&self) -> u32 {
        // SAFETY: word-aligned, and as above.
        let total = unsafe { ((PSRAM + self.total_at) as *const u32).read_volatile() };
        fence(Ordering::Acquire);
        u32::from_le(total)
    }
}
