//! IQ reports and `+UUDF` lines over a serial line.

use std::collections::HashMap;
use std::time::Instant;

use foxhound_core::base::time;
use foxhound_core::doa::switched::{Emitter, Group};
use foxhound_link::radio::{hci, uudf};

use super::{Event, Measurement};
use crate::autopilot::transport::Line;
use crate::scenario::input::InputError;
use crate::tools::hci::packet;
use crate::tools::radio_array::RadioArray;
use crate::tools::switched::Estimators;

/// Largest number of transmitters; handles have 12 bits, and line noise can invent many.
const EMITTERS_MAX: usize = 64;
/// Handles are at most this; what is larger is an address.
const HANDLE_MAX: u64 = 0x0FFF;

enum Reader {
    Reports(Box<(hci::Reader, Reports)>),
    Angles(uudf::Reader),
}

/// A serial line and its reader.
pub(super) struct Serial {
    line: Line,
    reader: Reader,
    was_open: bool,
}

impl Serial {
    pub(super) fn reports(line: Line, reports: Reports) -> Self {
        Self { line, reader: Reader::Reports(Box::new((hci::Reader::new(), reports))), was_open: true }
    }

    pub(super) fn angles(line: Line) -> Self {
        Self { line, reader: Reader::Angles(uudf::Reader::default()), was_open: true }
    }

    /// The events since the last call. The wanted transmitter is a handle, or an address.
    pub(super) fn events(&mut self, wanted: Option<u64>) -> Vec<Event> {
        let bytes = self.line.read();
        let is_open = self.line.is_open();
        let mut events = self.reader.read(&bytes, wanted);
        if self.was_open && !is_open {
            events.push(Event::Lost("the serial line is closed".to_owned()));
        }
        self.was_open = is_open;
        events
    }
}

impl Reader {
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
                            Some(wanted) if wanted <= HANDLE_MAX && wanted != u64::from(report.handle) => other(),
                            Some(wanted) if wanted > HANDLE_MAX && address.is_none() => {
                                Event::Nothing(format!("handle {} has no known address", report.handle))
                            }
                            Some(wanted) if wanted > HANDLE_MAX && address != Some(wanted) => other(),
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

/// The estimators, and the state of each transmitter.
pub(super) struct Reports {
    estimators: Estimators,
    emitters: HashMap<Transmitter, Emitter>,
}

/// A transmitter: by its address where it is known, as the controller may give its handle to another.
#[derive(PartialEq, Eq, Hash)]
enum Transmitter {
    Address(u64),
    Handle(bool, u16),
}

impl Reports {
    pub(super) fn new(array: &RadioArray) -> Result<Self, InputError> {
        // An array that cannot be used is refused before the flight, with a constant tone extension of 160 us.
        let mut estimators = Estimators::new(array, 1);
        estimators.of(hci::SAMPLES_MAX - hci::REFERENCE)?;
        Ok(Self { estimators, emitters: HashMap::new() })
    }

    fn estimate(&mut self, report: &hci::IqReport, address: Option<u64>, now: Instant) -> Event {
        let refused = |error: InputError| Event::Refused(error.to_string());
        let (_, reference, values) = match packet(report, self.estimators.array()) {
            Ok(parts) => parts,
            Err(error) => return refused(error),
        };
        if values.is_empty() {
            return Event::Nothing("reports without samples to use".to_owned());
        }
        let handle = || Transmitter::Handle(report.link == hci::Link::Connection, report.handle);
        let transmitter = address.map_or_else(handle, Transmitter::Address);
        if self.emitters.len() >= EMITTERS_MAX && !self.emitters.contains_key(&transmitter) {
            return Event::Nothing("more transmitters than are told apart".to_owned());
        }
        let estimator = match self.estimators.of(values.len()) {
            Ok(estimator) => estimator,
            Err(error) => return refused(error),
        };
        let mut group = Group::default();
        estimator.take_with(self.emitters.entry(transmitter).or_default(), &mut group, &reference, &values);
        Measurement::of(&estimator.bearing(&group, time::Instant(0)).bearing, now)
    }
}
