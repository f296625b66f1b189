//! The memory that the firmware's twin in QEMU shares with the simulator: how frames go in, and what comes back.
//!
//! The twin's external memory is a file shared with the simulator. A byte on UART1 is the doorbell, like the
//! half-transfer interrupt of a DMA on the real board; a byte back means that the answer is ready. This module is
//! only the layout; the two sides map, read and ring.
//!
//! | block | at | bytes | written by | content |
//! |---|---|---|---|---|
//! | setup | `0x0000` | 4096 | simulator | head, [`Setup`] |
//! | step | `0x1000` | 4096 | simulator | head, `StepHead`; circles from byte 512, samples from byte 2048 (`i16`, channel by channel) |
//! | report | `0x2000` | 4096 | twin | head, then [`Ready`], [`Report`] or the text of a refusal |
//! | line | `0x3000` | 4, then 16 384 from `0x4000` | simulator | bytes of the autopilot that bypass the serial line: their number since the setup of a new start (`u32`), and a ring of them |
//! | sensor | `0x3008` | 4, then 4096 from `0x8000` | simulator | bytes of the lidar or the radio: the same |
//! | port | `0x3004` | 4, then 262 144 from `0x4_0000` | simulator | bytes for the maintenance port that bypass the serial line: the same |
//! | store | `0x10_0000` | 16 384 | twin | its non-volatile storage, every bit inverted: a new file is a blank flash |
//!
//! Every block starts with the same head: [`MAGIC`] (`u32`, its last letter is the version of the layout), then the
//! length in bytes of what follows (`u32`). Everything is little-endian; records are in postcard's format, in which
//! floats keep their bits.
//!
//! | doorbell | direction | meaning |
//! |---|---|---|
//! | [`SETUP`] `S` | to the twin | the setup block is filled: start anew from it |
//! | [`FRAME`] `F` | to the twin | the step block is filled: do one step |
//! | [`DONE`] `K` | to the simulator | done: the report block holds [`Ready`] after `S`, [`Report`] after `F` |
//! | [`REFUSED`] `E` | to the simulator | not done; the report block holds the reason |
//! | [`BOOTED`] `B` | to the simulator | the twin has started, for the first time or again: it wants a setup |
//!
//! The two serial lines and the memory are not ordered with respect to each other. So a step gives the number of
//! bytes of UART0 that the twin must have received before it ([`Step::rx_expected`]), by UART0 or by the ring, of the
//! camera's bytes ([`Step::camera_expected`]), by UART2 or by its ring, and of the sensor's
//! ([`Step::sensor_expected`]), which have no serial line; and a report gives the number sent ([`Report::tx_total`]).
//! That makes every step, and with it the whole flight, repeatable.

use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::mapping::map::DELIVERY_MAX;
use foxhound_core::planning::planner::SAMPLES;
use foxhound_core::planning::rollout::WAYPOINTS;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// First word of every block; the last letter is the version of the layout.
pub const MAGIC: u32 = u32::from_le_bytes(*b"FXM4");

/// Bytes of one block.
pub const BLOCK_BYTES: usize = 4096;
/// Where the setup block begins.
pub const SETUP_AT: usize = 0;
/// Where the step block begins.
pub const STEP_AT: usize = BLOCK_BYTES;
/// Where the report block begins.
pub const REPORT_AT: usize = 2 * BLOCK_BYTES;

/// Position of the count of bytes in the ring.
pub const LINE_TOTAL_AT: usize = 3 * BLOCK_BYTES;
/// Position of the ring.
pub const LINE_AT: usize = 4 * BLOCK_BYTES;
/// Bytes of the ring.
pub const LINE_BYTES: usize = 16 << 10;

/// Position of the count of bytes in the sensor's ring.
pub const SENSOR_TOTAL_AT: usize = LINE_TOTAL_AT + 8;
/// Position of the sensor's ring.
pub const SENSOR_AT: usize = 8 * BLOCK_BYTES;
/// Bytes of the sensor's ring.
pub const SENSOR_BYTES: usize = 4 << 10;

/// Position of the count of bytes in the port's ring.
pub const PORT_TOTAL_AT: usize = LINE_TOTAL_AT + 4;
/// Position of the port's ring.
pub const PORT_AT: usize = 256 << 10;
/// Bytes of the port's ring: the largest frame of a camera fits.
pub const PORT_BYTES: usize = 256 << 10;

/// Position of the twin's flash, stored inverted.
pub const STORE_AT: usize = 1 << 20;

/// Doorbell to the twin: the setup block is filled.
pub const SETUP: u8 = b'S';
/// Doorbell to the twin: the step block is filled.
pub const FRAME: u8 = b'F';
/// Doorbell to the simulator: done.
pub const DONE: u8 = b'K';
/// Doorbell to the simulator: refused.
pub const REFUSED: u8 = b'E';
/// Doorbell to the simulator: the twin has started.
pub const BOOTED: u8 = b'B';

/// One block.
pub type Block = [u8; BLOCK_BYTES];

const HEAD_BYTES: usize = 8;
const CIRCLES_FROM: usize = 512;
const CODES_FROM: usize = 2048;

/// Setup of the twin.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Setup {
    /// The whole chain.
    pub guidance: guidance::Config,
    /// The mode has to be entered before guidance has control, as after a start on a vehicle.
    pub needs_entry: bool,
}

/// A fault inside the twin in a step. Times are of its own clock, on which an instruction takes 256 ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fault {
    /// The power fails and returns, this long after the step has begun, wherever the program is then.
    PowerCut {
        /// Microseconds.
        after_us: u32,
    },
    /// An interrupt takes the processor for a while, in the middle of the step.
    Steal {
        /// Microseconds.
        for_us: u32,
    },
    /// The planner gets no time: its result waits for a later step.
    StarvePlanner,
    /// The program panics.
    Panic,
    /// It executes an invalid instruction.
    Undefined,
    /// It calls itself without end.
    Overflow,
    /// It never returns from the step.
    Hang,
}

/// One step of the fast loop, as the simulator requests it.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a, const N: usize> {
    /// Counts the steps since the setup.
    pub sequence: u32,
    /// The time of the step: the only clock of guidance and link.
    pub now: Instant,
    /// Bytes of the autopilot since the twin's start that it must have received before this step.
    pub rx_expected: u32,
    /// Bytes of camera frames since the twin's start that it must have processed before this step.
    pub camera_expected: u32,
    /// Bytes of the sensor since the twin's start that it must have received before this step.
    pub sensor_expected: u32,
    /// The measurement of the antennas.
    pub front_end: FrontEnd<'a, N>,
    /// Obstacles from a sensor that reports circles.
    pub circles: Option<&'a [Circle]>,
    /// A fault to inject.
    pub fault: Option<Fault>,
}

/// The twin's copy of the data that came with a step.
#[derive(Clone, Debug)]
pub struct Arrivals<const N: usize> {
    head: StepHead,
    snapshot: AdcFrame<N>,
    circles: [Circle; DELIVERY_MAX],
}

impl<const N: usize> Arrivals<N> {
    const CODES_FIT: () = assert!(CODES_FROM + CHANNELS * N * 2 <= BLOCK_BYTES, "at most 256 samples a channel");

    /// Nothing yet.
    #[must_use]
    pub const fn new() -> Self {
        let none = Horizontal { north: 0.0, east: 0.0 };
        let nowhere = Circle { center_ned_m: none, radius_m: 0.0, velocity_ned_mps: none };
        let head = StepHead {
            sequence: 0,
            now: Instant(0),
            rx_expected: 0,
            camera_expected: 0,
            sensor_expected: 0,
            front_end: FrontEndKind::Nothing,
            circles: None,
            fault: None,
        };
        Self { head, snapshot: AdcFrame::zeroed(), circles: [nowhere; DELIVERY_MAX] }
    }

    /// Reads the step block.
    ///
    /// # Errors
    /// What is wrong with the block; [`Self::step`] must not be used then.
    pub fn decode(&mut self, block: &Block) -> Result<(), Error> {
        const { Self::CODES_FIT };
        let (records, codes) = block.split_at(CODES_FROM);
        let (first, mut rest) = records.split_at(CIRCLES_FROM);
        self.head = read_record(first)?;
        let count = usize::from(self.head.circles.unwrap_or(0));
        for circle in self.circles.get_mut(..count).ok_or(Error::Length)? {
            (*circle, rest) = postcard::take_from_bytes(rest).map_err(|_| Error::Content)?;
        }
        if let FrontEndKind::AdcFrame { time } = self.head.front_end {
            self.snapshot.time = time;
            for (code, bytes) in self.snapshot.codes.as_flattened_mut().iter_mut().zip(codes.as_chunks().0) {
                *code = i16::from_le_bytes(*bytes);
            }
        }
        Ok(())
    }

    /// The step that was read last.
    #[must_use]
    pub fn step(&self) -> Step<'_, N> {
        let head = &self.head;
        Step {
            sequence: head.sequence,
            now: head.now,
            rx_expected: head.rx_expected,
            camera_expected: head.camera_expected,
            sensor_expected: head.sensor_expected,
            front_end: match head.front_end {
                FrontEndKind::AdcFrame { .. } => FrontEnd::Frame(&self.snapshot),
                FrontEndKind::Bearing(bearing) => FrontEnd::Bearing(bearing),
                FrontEndKind::Nothing => FrontEnd::Nothing,
            },
            circles: head.circles.and_then(|count| self.circles.get(..usize::from(count))),
            fault: head.fault,
        }
    }
}

impl<const N: usize> Default for Arrivals<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The answer to a setup.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ready {
    /// Bytes sent on UART0 before the setup: later ones belong to the first step.
    pub tx_total: u32,
}

/// The result of one step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// The step that it answers.
    pub sequence: u32,
    /// Output of guidance.
    pub output: guidance::Output,
    /// Bytes sent on UART0 since the twin's start.
    pub tx_total: u32,
    /// Length of the guidance step in ticks of the 25 MHz timer; [`instructions`] converts.
    pub fast_ticks: u32,
    /// Steps that were late since the twin's start.
    pub late: u32,
    /// Largest use of the stack since the twin's start, as far as it was checked.
    pub stack_bytes: u32,
    /// A replan that was finished in this step.
    pub plan: Option<Planned>,
}

/// A finished replan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Planned {
    /// The request that it answers.
    pub id: u32,
    /// The trajectory to follow.
    pub waypoints_ned_m: [Horizontal; WAYPOINTS],
    /// The sampled trajectories that it was made from.
    pub samples_ned_m: [[Horizontal; WAYPOINTS]; SAMPLES],
    /// Length of the replan in ticks of the 25 MHz timer; [`instructions`] converts.
    pub ticks: u32,
}

/// Executed instructions, from ticks of the twin's 25 MHz timer, when QEMU runs with `-icount shift=8`.
///
/// An instruction then takes 256 ns of the twin's time, which is 6.4 ticks.
#[must_use]
pub fn instructions(ticks: u32) -> u32 {
    ((u64::from(ticks) * 10 + 32) / 64) as u32
}

/// Why a block cannot be written or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error {
    /// The block does not begin with [`MAGIC`]: nothing there, or another version.
    Magic,
    /// The content does not fit, or its length is impossible.
    Length,
    /// The content is not what this version writes.
    Content,
}

impl core::fmt::Display for Error {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Magic => "the shared block is empty or of another version",
            Self::Length => "the shared block is too small for its content",
            Self::Content => "the shared block cannot be read",
        })
    }
}

impl core::error::Error for Error {}

/// Fills the report block with the reason of a refusal, cut off where the block ends.
pub fn encode_refusal(block: &mut Block, reason: core::fmt::Arguments<'_>) {
    let (head, body) = block.split_at_mut(HEAD_BYTES);
    let mut text = Text { body, len: 0 };
    // Text stops by itself when it is full.
    let _ = core::fmt::write(&mut text, reason);
    let len = text.len;
    write_head(head, len);
}

/// Reads the reason of a refusal.
///
/// # Errors
/// What is wrong with the block.
pub fn decode_refusal(block: &Block) -> Result<&str, Error> {
    core::str::from_utf8(body(block)?).map_err(|_| Error::Content)
}

/// The part of a step that is a record; circles and codes follow it.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct StepHead {
    sequence: u32,
    now: Instant,
    rx_expected: u32,
    camera_expected: u32,
    sensor_expected: u32,
    front_end: FrontEndKind,
    circles: Option<u8>,
    fault: Option<Fault>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
enum FrontEndKind {
    AdcFrame { time: Instant },
    Bearing(Bearing),
    Nothing,
}

impl<const N: usize> Step<'_, N> {
    /// Fills the step block.
    ///
    /// # Errors
    /// [`Error::Length`] when there are more circles than [`DELIVERY_MAX`], [`Error::Content`] for a frame that was heard
    /// before.
    pub fn encode(&self, block: &mut Block) -> Result<(), Error> {
        const { Arrivals::<N>::CODES_FIT };
        let circles = match self.circles {
            Some(circles) if circles.len() > DELIVERY_MAX => return Err(Error::Length),
            Some(circles) => Some(circles.len() as u8),
            None => None,
        };
        let front_end = match self.front_end {
            FrontEnd::Frame(snapshot) => FrontEndKind::AdcFrame { time: snapshot.time },
            FrontEnd::Bearing(bearing) => FrontEndKind::Bearing(bearing),
            FrontEnd::Nothing => FrontEndKind::Nothing,
            // A flight is flown again on the host only.
            FrontEnd::Measured(_) => return Err(Error::Content),
        };
        let head = StepHead {
            sequence: self.sequence,
            now: self.now,
            rx_expected: self.rx_expected,
            camera_expected: self.camera_expected,
            sensor_expected: self.sensor_expected,
            front_end,
            circles,
            fault: self.fault,
        };
        let (records, codes) = block.split_at_mut(CODES_FROM);
        let (first, mut rest) = records.split_at_mut(CIRCLES_FROM);
        write_record(first, &head)?;
        for circle in self.circles.unwrap_or_default() {
            let used = postcard::to_slice(circle, rest).map_err(|_| Error::Length)?.len();
            rest = rest.split_at_mut_checked(used).ok_or(Error::Length)?.1;
        }
        if let FrontEnd::Frame(snapshot) = self.front_end {
            for (bytes, code) in codes.as_chunks_mut().0.iter_mut().zip(snapshot.codes.as_flattened()) {
                *bytes = code.to_le_bytes();
            }
        }
        Ok(())
    }
}

/// Fills a block with a [`Setup`], a [`Ready`] or a [`Report`].
///
/// # Errors
/// [`Error::Length`].
pub fn write_record(block: &mut [u8], record: &impl Serialize) -> Result<(), Error> {
    let (head, body) = block.split_at_mut_checked(HEAD_BYTES).ok_or(Error::Length)?;
    let len = postcard::to_slice(record, body).map_err(|_| Error::Length)?.len();
    write_head(head, len);
    Ok(())
}

/// Reads it back.
///
/// # Errors
/// What is wrong with the block.
pub fn read_record<T: DeserializeOwned>(block: &[u8]) -> Result<T, Error> {
    postcard::from_bytes(body(block)?).map_err(|_| Error::Content)
}

fn write_head(head: &mut [u8], len: usize) {
    for (bytes, word) in head.as_chunks_mut().0.iter_mut().zip([MAGIC, len as u32]) {
        *bytes = word.to_le_bytes();
    }
}

fn body(block: &[u8]) -> Result<&[u8], Error> {
    let (head, body) = block.split_at_checked(HEAD_BYTES).ok_or(Error::Length)?;
    let [magic, len] = *head.as_chunks().0 else {
        return Err(Error::Length);
    };
    if u32::from_le_bytes(magic) != MAGIC {
        return Err(Error::Magic);
    }
    body.get(..u32::from_le_bytes(len) as usize).ok_or(Error::Length)
}

/// Writes text into bytes, whole characters only.
struct Text<'a> {
    body: &'a mut [u8],
    len: usize,
}

impl core::fmt::Write for Text<'_> {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        let room = self.body.get_mut(self.len..).unwrap_or_default();
        let mut fits = text.len().min(room.len());
        while !text.is_char_boundary(fits) {
            fits -= 1;
        }
        for (byte, letter) in room.iter_mut().zip(text.bytes().take(fits)) {
            *byte = letter;
        }
        self.len += fits;
        if fits < text.len() { Err(core::fmt::Error) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests;
