//! Frames of a camera that looks down, as they arrive at the maintenance port, and the pad detector's results.
//!
//! They are in the stream like records of the flight log ([`crate::log::frame`]), between zeros; typed lines contain
//! no zeros:
//!
//! | kind | number | record |
//! |---|---|---|
//! | 32, begin | any | width (`u16`), height (`u16`), format (`u8`: 0 RGB565 little-endian, 1 grey), little-endian |
//! | 33, line | its row | the pixels, from left to right |
//! | 34, end | any | time from the middle of the exposure to this record (`u32`, microseconds), little-endian |
//!
//! A line is processed as soon as its checksum is right, and not stored: there is memory for one. An error in a frame
//! (an invalid size, a line that is missing, short, damaged or out of order, a missing end) is reported in the
//! [`PadObservation`] of that frame, and the next frame begins afresh. The camera needs no clock: it sends the age of
//! the frame, and the caller passes the time when it takes the result ([`Sighted::look`]).
//!
//! After a zero a record is expected, and text after the zero that ends a good record. A zero that ends anything else
//! begins a record, so that a lost zero costs only the record that it belongs to.

use foxhound_core::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance;
use foxhound_core::landing::observation::{Bad, PadObservation, Seen};
use foxhound_pad::{self as pad, Format, Header, State, WIDTH_MAX};

pub use foxhound_pad::Detector;

use crate::log::frame::{Deframer, Frame, stuffed_bytes};

/// Kinds of records: the begin of a frame.
pub const BEGIN: u8 = 32;
/// A line.
pub const LINE: u8 = 33;
/// The end of a frame.
pub const END: u8 = 34;

/// The longest record is a line of two bytes per pixel, with kind and number before it and the checksum after it.
const ROOM: usize = stuffed_bytes(1 + 5 + 2 * WIDTH_MAX as usize + 4);
/// An older frame is refused.
const AGE_MAX_US: u32 = 2_000_000;

/// The pad detector for the configured camera.
///
/// # Errors
/// The field that is out of range; none if guidance was built from the same configuration.
pub fn detector(config: &guidance::Config) -> Result<Detector, ConfigError> {
    let landing = config.landing.unwrap_or_default();
    let camera = pad::Camera { focal_widths: landing.focal_widths };
    // The vehicle's estimated height may come from the pad's own size.
    let height_tolerance = 0.15;
    pad::Config { camera, pad_radius_m: landing.pad_radius_m, height_tolerance }.build()
}

/// The result of a byte.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Came {
    /// Typed text.
    Text(u8),
    /// A frame has ended.
    Sighted(Sighted),
}

/// The result of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighted {
    /// What it shows.
    pub seen: Seen,
    /// From the exposure to its last byte.
    pub age_us: u32,
}

impl Sighted {
    /// The observation for a caller who takes it now.
    #[must_use]
    pub const fn look(&self, now: Instant) -> PadObservation {
        PadObservation { time: Instant(now.0.saturating_sub(self.age_us as u64)), seen: self.seen }
    }
}

/// Reads frames, a byte at a time.
#[derive(Debug)]
pub struct Camera {
    detector: Detector,
    state: State,
    deframer: Deframer<ROOM>,
    /// Whether the bytes are text, or a record that a zero has begun.
    is_text: bool,
    progress: Progress,
}

/// Progress of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    /// There is none.
    None,
    /// Its lines are arriving.
    Lines,
    /// It has an error; its end is awaited.
    Bad(Bad),
}

impl Camera {
    /// Before the first byte.
    #[must_use]
    pub const fn new(detector: Detector) -> Self {
        let state = State::new();
        Self { detector, state, deframer: Deframer::new(), is_text: true, progress: Progress::None }
    }

    /// Uses another detector from the next frame on.
    pub fn set_detector(&mut self, detector: Detector) {
        self.detector = detector;
    }

    /// Takes a byte. The height over the ground, if known, gives the expected size of the pad.
    #[inline(never)]
    pub fn push(&mut self, byte: u8, height_m: Option<f32>) -> Option<Came> {
        if self.is_text {
            if byte == 0 {
                self.is_text = false;
                return None;
            }
            return Some(Came::Text(byte));
        }
        let Self { detector, state, deframer, is_text, progress } = self;
        let is_full = deframer.is_too_long();
        let Some(frame) = deframer.push(byte) else {
            // No record is this long: a random zero does not swallow typed text after it for ever.
            if is_full {
                deframer.clear();
                *is_text = true;
            }
            return None;
        };
        *is_text = true;
        take_in(detector, state, progress, &frame, height_m).map(Came::Sighted)
    }
}

/// Takes a record; returns the result of the frame that it ends.
fn take_in(
    detector: &Detector,
    state: &mut State,
    progress: &mut Progress,
    record: &Frame<'_>,
    height_m: Option<f32>,
) -> Option<Sighted> {
    match record.kind {
        BEGIN => {
            let was = core::mem::replace(progress, Progress::Lines);
            let begun =
                header(record.record).ok_or(Bad::Size).and_then(|header| detector.begin(state, &header, height_m));
            if let Err(bad) = begun {
                *progress = Progress::Bad(bad);
            }
            // The last frame never ended.
            (was != Progress::None).then_some(Sighted { seen: Seen::Bad(Bad::Cut), age_us: 0 })
        }
        LINE => {
            if *progress == Progress::Lines
                && let Err(bad) = u16::try_from(record.number)
                    .map_err(|_| Bad::Order)
                    .and_then(|row| detector.line(state, row, record.record))
            {
                *progress = Progress::Bad(bad);
            }
            None
        }
        END => {
            let age_us = record.record.try_into().map(u32::from_le_bytes).ok().filter(|age_us| *age_us <= AGE_MAX_US);
            let seen = match (core::mem::replace(progress, Progress::None), age_us) {
                (Progress::None, _) => return None,
                (Progress::Bad(bad), _) => Seen::Bad(bad),
                (Progress::Lines, None) => Seen::Bad(Bad::Age),
                (Progress::Lines, Some(_)) => detector.end(state).seen,
            };
            Some(Sighted { seen, age_us: age_us.unwrap_or(0) })
        }
        _ => None,
    }
}

fn header(record: &[u8]) -> Option<Header> {
    let [w0, w1, h0, h1, format] = *record else { return None };
    let format = match format {
        0 => Format::Rgb565,
        1 => Format::Grey,
        _ => return None,
    };
    let (width_px, height_px) = (u16::from_le_bytes([w0, w1]), u16::from_le_bytes([h0, h1]));
    Some(Header { time: Instant(0), width_px, height_px, format })
}
