//! IQ reports and `+UUDF` lines over a serial line.

use std::time::{Duration, Instant};

use foxhound_computer::iq;
use foxhound_core::base::time;
use foxhound_core::doa::switched::FLOOR_RAD;
use foxhound_link::radio::{hci, uudf};

use super::{Event, Measurement};
use crate::autopilot::transport::Line;
use crate::scenario::input::InputError;
use crate::tools::bearings::mark_clipped;
use crate::tools::hci::{array_of, clipped, emitter};
use crate::tools::radio_array::RadioArray;

/// A silence in which no packet goes on.
const PAUSE: Duration = Duration::from_micros(iq::PAUSE_US);
/// Transmitters that are told apart; handles have 12 bits, and line noise can invent many.
const TRANSMITTERS: usize = 64;
/// Numbers of trains and connections are at most this; what is larger is an address.
const NUMBER_MAX: u64 = 0x1FFF;

enum Reader {
    Reports(Box<(hci::Reader, Reports)>),
    Angles(uudf::Reader),
}

/// A serial line and its reader.
pub(super) struct Serial {
    line: Line,
    reader: Reader,
    was_open: bool,
    /// How often the line had been opened again.
    openings: u32,
    /// When the last bytes came.
    last: Instant,
}

impl Serial {
    pub(super) fn reports(line: Line, reports: Reports) -> Self {
        Self {
            line,
            reader: Reader::Reports(Box::new((hci::Reader::new(), reports))),
            was_open: true,
            openings: 0,
            last: Instant::now(),
        }
    }

    pub(super) fn angles(line: Line) -> Self {
        let reader = Reader::Angles(uudf::Reader::default());
        Self { line, reader, was_open: true, openings: 0, last: Instant::now() }
    }

    /// The events since the last call. The wanted transmitter is the number of a train or connection, or an address.
    pub(super) fn events(&mut self, wanted: Option<u64>) -> Vec<Event> {
        let bytes = self.line.read();
        if self.line.openings() != self.openings {
            self.openings = self.line.openings();
            self.reader.begin_anew();
        }
        let is_open = self.line.is_open();
        if !bytes.is_empty() {
            let silent = std::mem::replace(&mut self.last, Instant::now()).elapsed();
            if let (Reader::Reports(both), true) = (&mut self.reader, silent > PAUSE) {
                both.0.pause();
            }
        }
        let mut events = self.reader.read(&bytes, wanted);
        if self.was_open && !is_open {
            events.push(Event::Lost("the serial line is closed".to_owned()));
        }
        self.was_open = is_open;
        events
    }
}

impl Reader {
    /// The radio may have restarted: its handles are new, and half a line is none.
    fn begin_anew(&mut self) {
        match self {
            Self::Reports(both) => {
                both.0 = hci::Reader::new();
                both.1.finder = iq::Finder::new();
                // It was begun with the same before.
                both.1.finder.begin(&both.1.array, both.1.floor_rad).ok();
            }
            Self::Angles(reader) => *reader = uudf::Reader::default(),
        }
    }

    fn read(&mut self, bytes: &[u8], wanted: Option<u64>) -> Vec<Event> {
        let now = Instant::now();
        let other = || Event::Nothing("another transmitter".to_owned());
        let mut events = Vec::new();
        for byte in bytes {
            events.extend(match self {
                Self::Reports(both) => both.0.push(*byte).map(|found| match found {
                    Ok(report) => {
                        let address = both.0.address(&report);
                        match wanted {
                            Some(wanted) if wanted <= NUMBER_MAX && i64::from(emitter(&report)) != wanted as i64 => {
                                other()
                            }
                            Some(wanted) if wanted > NUMBER_MAX && address.is_none() => {
                                Event::Nothing(format!("handle {} has no known address", report.handle))
                            }
                            Some(wanted) if wanted > NUMBER_MAX && address != Some(wanted) => other(),
                            _ => both.1.estimate(&report, address, now),
                        }
                    }
                    Err(refused) => Event::Refused(refused.to_string()),
                }),
                Self::Angles(reader) => reader.push(*byte).map(|found| match found {
                    Ok(angle) if wanted.is_some_and(|wanted| wanted != angle.tag) => other(),
                    Ok(angle) => {
                        Event::Measured(Measurement::plain(now, f32::from(angle.azimuth_deg).to_radians(), None))
                    }
                    Err(refused) => Event::Refused(refused.to_string()),
                }),
            });
        }
        events
    }
}

/// The directions of the packets that are reported.
pub(super) struct Reports {
    array: iq::Array,
    floor_rad: f32,
    finder: iq::Finder<TRANSMITTERS>,
}

impl Reports {
    pub(super) fn new(array: &RadioArray) -> Result<Self, InputError> {
        let floor_rad = array.sigma_floor_rad.unwrap_or(FLOOR_RAD);
        let mut reports = Self { array: array_of(array)?, floor_rad, finder: iq::Finder::new() };
        reports.finder.begin(&reports.array, floor_rad)?;
        Ok(reports)
    }

    fn estimate(&mut self, report: &hci::IqReport, address: Option<u64>, now: Instant) -> Event {
        match self.finder.bearing(&self.array.switch, report, address, time::Instant(0)) {
            Ok(Some(mut bearing)) => {
                let samples = report.reference().len() + report.slots().len();
                mark_clipped(&mut bearing, clipped(report), samples, self.array.beam.count);
                Measurement::of(&bearing, now)
            }
            Ok(None) => Event::Nothing("reports without samples to use".to_owned()),
            Err(error) => Event::Refused(error.to_string()),
        }
    }
}
