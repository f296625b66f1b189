//! The flight log: every input of the flight computer, recorded step by step, so that the host can repeat the flight
//! to the last bit; a difference is reported with its step (`foxhound replay`).
//!
//! | kind | record | when |
//! |---|---|---|
//! | 1 | [`Begin`]: version, cause, configuration, parameters | at the start, and when a simulator begins anew |
//! | 2 | bytes received from the autopilot; of keys only zeros | before the step that they belong to |
//! | 3 | circles of a simulated obstacle sensor | before the step, when there are some |
//! | 4 | [`Codes`]: samples of the converters | every fiftieth frame, after its step, if there is space; every frame for a dump |
//! | 5, 6 | results of the parameter storage: saved or not; loaded values or none | when it was called |
//! | 7 | [`Step`]: time, bearing, plan, trace hash | at the end of every step |
//! | 8 | [`Late`]: steps that missed their deadline | when there is a new one |
//! | 9 | text for people | when requested on the maintenance port |
//! | 10 | an observation of the camera | before the step, when a frame has ended |
//! | 11 | bytes of the lidar, or the radio, on a line of its own | before the step that they belong to |
//!
//! The samples of all frames are more than the line can carry: 4 x 256 x 12 bit, 50 times a second, are 77 KB/s of
//! its 92. So a step holds what guidance needs from a frame ([`Measurement`]): the bearing, and the phasors if the
//! vehicle may seek by turning. Every fiftieth frame is followed by its samples, so that the front end can be checked
//! by itself.
//!
//! [`frame`] defines how records are stored in the stream, [`ring`] how they get to the port. Nothing here waits: a
//! frame that does not fit is dropped, and its number is missing.
//!
//! Keys are not logged. A flight with a signed link is replayed without signatures: every frame is then accepted.

use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::param::{self, COUNT, Values};
use foxhound_core::guidance::{self, FrontEnd, Measurement};
use foxhound_core::landing::observation::PadObservation;
use foxhound_core::mapping::map::DELIVERY_MAX;
use heapless::Vec;
use serde::{Deserialize, Serialize, Serializer};

use crate::SAMPLES_PER_CHANNEL as N;
use crate::deadline::Counts;
use crate::flight::{Flight, ParameterStore, Stepped};

pub mod frame;
pub mod ring;
mod secret;

use frame::{Frame, Open};
use ring::{Full, Producer};
use secret::Mask;

/// Version of the records.
pub const LAYOUT: u8 = 13;
/// Frames from one with samples to the next.
const CODES_EVERY: u8 = 50;
/// Bytes of the samples of one frame: 12 bits each.
const CODES_BYTES: usize = CHANNELS * N * 3 / 2;
/// Samples are logged if there is space for them, their frame, and the stuffing.
const CODES_ROOM: usize = CODES_BYTES + 32;
/// Largest number of received bytes in one frame.
const PIECE_BYTES: u16 = 1024;

/// Kinds of records, see the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
enum Kind {
    Begin = 1,
    Bytes = 2,
    Circles = 3,
    Codes = 4,
    Saved = 5,
    Loaded = 6,
    Step = 7,
    Late = 8,
    Text = 9,
    Look = 10,
    Sensor = 11,
}

/// The begin of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Begin<'a, C, V> {
    /// [`LAYOUT`] of the writer.
    pub layout: u8,
    /// [`param::LAYOUT`] of the writer.
    pub param_layout: u32,
    /// Version of the program.
    pub version: &'a str,
    /// Why the computer has started, or the other cause of the flight's begin.
    pub why: &'a str,
    /// Whether the mode has to be left and entered again before it gives control.
    pub needs_entry: bool,
    /// The configuration in use, with its parameters.
    pub config: C,
    /// The parameters in use.
    pub values: V,
}

/// The program that wrote a log: the first fields of every [`Begin`], of whatever version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Writer<'a> {
    /// Its [`LAYOUT`].
    pub layout: u8,
    /// Its [`param::LAYOUT`].
    pub param_layout: u32,
    /// Its version.
    pub version: &'a str,
}

impl<'a> Writer<'a> {
    /// The writer of a frame in which a flight begins.
    #[must_use]
    pub fn of(frame: &Frame<'a>) -> Option<Self> {
        let begins = frame.kind == Kind::Begin as u8;
        begins.then(|| postcard::take_from_bytes(frame.record).ok()).flatten().map(|(writer, _)| writer)
    }
}

/// The begin of a flight as it is read.
pub type Beginning<'a> = Begin<'a, guidance::Config, Vec<f32, COUNT>>;

/// One step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step<H> {
    /// The time of the step.
    pub now: Instant,
    /// The measurement of the antennas.
    pub heard: Option<H>,
    /// Number of the plan that was passed in.
    pub plan: Option<u32>,
    /// Whether the planner took a request.
    pub ordered: bool,
    /// `Output::trace_hash`, little-endian.
    pub trace_hash: [u8; 8],
}

/// Steps that missed their deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Late {
    /// Number since the start.
    pub late: u32,
    /// The longest step since the start.
    pub longest_us: u32,
}

/// The samples of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Codes<C> {
    /// The middle of the block.
    pub time: Instant,
    /// Two samples in three bytes, the lower bits first, channel by channel.
    pub packed: C,
}

impl Codes<&[u8]> {
    /// The frame of these samples; `None` if there are too few.
    #[must_use]
    pub fn snapshot(&self) -> Option<AdcFrame<N>> {
        let mut snapshot = AdcFrame::zeroed();
        snapshot.time = self.time;
        let (pairs, []) = self.packed.as_chunks::<3>() else { return None };
        let (codes, _) = snapshot.codes.as_flattened_mut().as_chunks_mut::<2>();
        if pairs.len() != codes.len() {
            return None;
        }
        for ([first, second], [low, middle, high]) in codes.iter_mut().zip(pairs) {
            // Shifting out of the upper end and back restores the sign.
            *first = (i16::from_le_bytes([*low, *middle]) << 4) >> 4;
            *second = i16::from_le_bytes([*middle, *high]) >> 4;
        }
        Some(snapshot)
    }
}

/// Samples as they are written.
struct Packed<'a>(&'a AdcFrame<N>);

impl Serialize for Packed<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeSeq as _;
        let mut bytes = serializer.serialize_seq(Some(CODES_BYTES))?;
        for [first, second] in self.0.codes.as_flattened().as_chunks::<2>().0 {
            let ([low, middle], [rest, high]) = (first.to_le_bytes(), (*second << 4).to_le_bytes());
            for byte in [low, (middle & 0x0f) | (rest & 0xf0), high] {
                bytes.serialize_element(&byte)?;
            }
        }
        bytes.end()
    }
}

/// A record as it is read.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "read one at a time, with a desktop's memory")]
pub enum Record<'a> {
    /// The begin of a flight.
    Begin(Beginning<'a>),
    /// Bytes received from the autopilot.
    Bytes(&'a [u8]),
    /// Circles of an obstacle sensor.
    Circles(Vec<Circle, DELIVERY_MAX>),
    /// Samples of a frame.
    Codes(Codes<&'a [u8]>),
    /// Whether the parameters were saved.
    Saved(bool),
    /// The parameters that were loaded.
    Loaded(Option<Vec<f32, COUNT>>),
    /// One step.
    Step(Step<Measurement>),
    /// Steps that were late.
    Late(Late),
    /// Text for people.
    Text(&'a str),
    /// An observation of the camera.
    Look(PadObservation),
    /// Bytes of the sensor.
    Sensor(&'a [u8]),
}

impl<'a> Record<'a> {
    /// The record of a frame; `None` if it cannot be read, or is of a later version's kind.
    #[must_use]
    pub fn of(frame: &Frame<'a>) -> Option<Self> {
        fn read<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Option<T> {
            postcard::take_from_bytes(bytes).ok().filter(|(_, rest)| rest.is_empty()).map(|(record, _)| record)
        }
        const KINDS: [Kind; 11] = [
            Kind::Begin,
            Kind::Bytes,
            Kind::Circles,
            Kind::Codes,
            Kind::Saved,
            Kind::Loaded,
            Kind::Step,
            Kind::Late,
            Kind::Text,
            Kind::Look,
            Kind::Sensor,
        ];
        let kind = KINDS.into_iter().find(|kind| *kind as u8 == frame.kind)?;
        Some(match kind {
            Kind::Begin => Self::Begin(read(frame.record)?),
            Kind::Bytes => Self::Bytes(frame.record),
            Kind::Circles => Self::Circles(read(frame.record)?),
            Kind::Codes => Self::Codes(read(frame.record)?),
            Kind::Saved => Self::Saved(read(frame.record)?),
            Kind::Loaded => Self::Loaded(read(frame.record)?),
            Kind::Step => Self::Step(read(frame.record)?),
            Kind::Late => Self::Late(read(frame.record)?),
            Kind::Text => Self::Text(read(frame.record)?),
            Kind::Look => Self::Look(read(frame.record)?),
            Kind::Sensor => Self::Sensor(frame.record),
        })
    }
}

/// State of the log, kept from frame to frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct State {
    /// Number of the next frame.
    next: u32,
    lost: u32,
    mask: Mask,
    codes_due_in: u8,
    /// Frames still to be dumped.
    dump: u16,
    late: u32,
}

/// Writes the log.
pub struct Log<'a> {
    producer: Producer<'a>,
    state: State,
    /// Frame of received bytes in progress, their source, and their number.
    heard: Option<(Kind, Open, u16)>,
}

impl<'a> Log<'a> {
    /// Continues a log, or begins one.
    #[must_use]
    pub const fn resume(producer: Producer<'a>, state: State) -> Self {
        Self { producer, state, heard: None }
    }

    /// The state for the next writer.
    #[must_use]
    pub fn pause(mut self) -> State {
        self.end_heard();
        self.state
    }

    /// Frames that were dropped because the ring was full.
    #[must_use]
    pub const fn lost(&self) -> u32 {
        self.state.lost
    }

    /// Whether everything has been read.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        self.producer.is_empty()
    }

    /// A flight begins, with its configuration. Call it before the first step.
    #[inline(never)]
    pub fn begin<S>(&mut self, why: &str, needs_entry: bool, flight: &Flight<'_, S>) {
        let values: &[f32] = flight.companion.parameters().as_array();
        let version = env!("CARGO_PKG_VERSION");
        let config: &guidance::Config = flight.config;
        let (layout, param_layout) = (LAYOUT, param::LAYOUT);
        self.write(Kind::Begin, &Begin { layout, param_layout, version, why, needs_entry, config, values });
        self.state.codes_due_in = 0;
        // What the sensor's line has said once, and will not say again.
        flight.reports.known().for_each(|packet| self.hear_sensor(&packet));
    }

    /// Bytes of the autopilot, as they are passed to the link, in pieces of any size.
    #[inline(never)]
    pub fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes {
            let shown = self.state.mask.pass(*byte);
            self.note(Kind::Bytes, shown);
        }
    }

    /// Bytes of the lidar or the radio, likewise.
    #[inline(never)]
    pub fn hear_sensor(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.note(Kind::Sensor, *byte));
    }

    /// A received byte, appended to those before it of the same line.
    #[inline(never)]
    fn note(&mut self, kind: Kind, byte: u8) {
        if self.heard.as_ref().is_some_and(|(before, _, count)| *before != kind || *count >= PIECE_BYTES) {
            self.end_heard();
        }
        let begun = match self.heard.take() {
            Some((_, open, count)) => Ok((open, count)),
            None => self.open(kind).map(|open| (open, 0)),
        };
        let written = begun.and_then(|(mut open, count)| {
            open.extend(&mut self.producer, &[byte]).map(|()| self.heard = Some((kind, open, count + 1)))
        });
        self.count(written);
    }

    /// Ends the frame of received bytes in progress.
    fn end_heard(&mut self) {
        if let Some((_, open, _)) = self.heard.take() {
            let written = open.end(&mut self.producer);
            self.count(written);
        }
    }

    /// A storage whose results are logged.
    pub fn parameter_store<'k, K: ParameterStore>(&'k mut self, parameter_store: &'k mut K) -> Logged<'k, 'a, K> {
        Logged { log: self, parameter_store }
    }

    /// A finished step; `ordered` if the planner took a request.
    #[inline(never)]
    pub fn step(
        &mut self,
        front_end: FrontEnd<'_, N>,
        circles: Option<&[Circle]>,
        look: Option<&PadObservation>,
        came: &Stepped,
        ordered: bool,
    ) {
        if let Some(look) = look {
            self.write(Kind::Look, look);
        }
        if let Some(circles) = circles {
            // No more than this are ever used.
            self.write(Kind::Circles, &circles.get(..DELIVERY_MAX).unwrap_or(circles));
        }
        let (now, heard, plan) = (came.output.time, came.heard.as_ref(), came.plan);
        let trace_hash = came.output.trace_hash.to_le_bytes();
        self.write(Kind::Step, &Step { now, heard, plan, ordered, trace_hash });
        if let FrontEnd::Frame(snapshot) = front_end {
            self.codes(snapshot);
        }
    }

    fn codes(&mut self, snapshot: &AdcFrame<N>) {
        self.state.codes_due_in = self.state.codes_due_in.saturating_sub(1);
        let is_due = self.state.codes_due_in == 0 || self.state.dump > 0;
        if is_due && self.producer.room() >= CODES_ROOM {
            self.write(Kind::Codes, &Codes { time: snapshot.time, packed: Packed(snapshot) });
            self.state.codes_due_in = CODES_EVERY;
            self.state.dump = self.state.dump.saturating_sub(1);
        }
    }

    /// Requests the samples of that many frames from now on; one that does not fit is skipped and the next one
    /// counts.
    pub fn dump(&mut self, frames: u16) {
        self.state.dump = frames;
    }

    /// Bytes that wait to be read.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.producer.capacity() - self.producer.room()
    }

    /// Takes the counts of deadlines; logs them if there is a new miss.
    pub fn deadlines(&mut self, counts: Counts) {
        if counts.late != self.state.late {
            self.state.late = counts.late;
            self.write(Kind::Late, &Late { late: counts.late, longest_us: counts.longest_us });
        }
    }

    /// Text for people.
    #[inline(never)]
    pub fn text(&mut self, text: &str) {
        self.write(Kind::Text, &text);
    }

    fn write(&mut self, kind: Kind, record: &impl Serialize) {
        self.end_heard();
        let written = self.open(kind).and_then(|mut open| {
            open.append(&mut self.producer, record)?;
            open.end(&mut self.producer)
        });
        self.count(written);
    }

    /// Begins the next frame, which uses a number even if it does not fit.
    #[inline(never)]
    fn open(&mut self, kind: Kind) -> Result<Open, Full> {
        let number = self.state.next;
        self.state.next = number.wrapping_add(1);
        Open::begin(&mut self.producer, kind as u8, number)
    }

    fn count(&mut self, written: Result<(), Full>) {
        if written.is_err() {
            self.state.lost = self.state.lost.saturating_add(1);
        }
    }
}

/// A storage whose results are logged.
pub struct Logged<'k, 'a, K> {
    log: &'k mut Log<'a>,
    parameter_store: &'k mut K,
}

impl<K: ParameterStore> ParameterStore for Logged<'_, '_, K> {
    fn save(&mut self, values: &Values) -> bool {
        let is_saved = self.parameter_store.save(values);
        self.log.write(Kind::Saved, &is_saved);
        is_saved
    }

    fn load(&mut self) -> Option<Values> {
        let values = self.parameter_store.load();
        self.log.write(Kind::Loaded, &values.as_ref().map(|values| values.as_array().as_slice()));
        values
    }

    fn reset(&mut self) -> bool {
        let is_reset = self.parameter_store.reset();
        self.log.write(Kind::Saved, &is_reset);
        is_reset
    }
}

#[cfg(test)]
mod tests;
