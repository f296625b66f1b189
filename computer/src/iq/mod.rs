//! Bluetooth's IQ reports ([`hci`]) to bearings, for a board with an antenna array behind the switch of a Bluetooth controller,
//! and for `foxhound companion --bearings hci:`.
//!
//! A report whose samples are not usable, or whose packet has no direction, gives no bearing; a report that contradicts the
//! array's schedule is an error. Transmitters are told apart by their address where the controller has said it, otherwise by their
//! handle. There is memory for a fixed number of them: a further one takes the place of the one that was silent longest.

use foxhound_core::base::error::{ConfigError, Why, check};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::beam;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::doa::radio::Mount;
use foxhound_core::doa::switched::{self as direction, Emitter, Estimator};
use foxhound_core::signal::phase::Complex;
use foxhound_core::signal::switched;
use foxhound_link::radio::hci::{self, IqReport, Link, REFERENCE, SAMPLES_MAX};
use heapless::Vec;

use crate::came::Came;

mod array;

pub use array::ARRAY;

/// Sample rate of the reference period.
pub const REFERENCE_HZ: f32 = 1e6;
/// Packets that are worked out in a step.
pub const PACKETS_MAX: u8 = 2;
/// A silence in which no packet goes on: two steps and a half.
pub const PAUSE_US: u64 = 50_000;
/// Samples behind the reference period.
const SLOTS_MAX: usize = SAMPLES_MAX - REFERENCE;

/// An array behind a switch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Array {
    /// Geometry.
    pub beam: beam::Config,
    /// Schedule.
    pub switch: switched::Config,
}

/// The samples of a report.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Of the reference period.
    pub reference: Vec<Complex, REFERENCE>,
    /// Of the slots.
    pub slots: Vec<Complex, SLOTS_MAX>,
}

/// The samples of a report that was taken by a schedule; `None` if they are not usable.
///
/// # Errors
/// `sample_rate_hz` that is not [`REFERENCE_HZ`]; `switch.slot_s` that is not the report's.
pub fn samples(report: &IqReport, switch: &switched::Config) -> Result<Option<Samples>, ConfigError> {
    let is_near = |own: f32, theirs: f32, tolerance: f32| libm::fabsf(own - theirs) <= tolerance * theirs;
    let refuse = |field, value, text| Err(ConfigError { field, value, why: Why::Inconsistent(text) });
    if !is_near(switch.sample_rate_hz, REFERENCE_HZ, 1e-6) {
        return refuse("sample_rate_hz", switch.sample_rate_hz, "the reference period of IQ reports has 1000000");
    }
    if !report.is_usable() {
        return Ok(None);
    }
    let (slot_s, text) = match report.slot_us {
        1 => (2e-6, "Slot_Durations = 1 us of a report make 2e-6"),
        _ => (4e-6, "Slot_Durations = 2 us of a report make 4e-6"),
    };
    if !is_near(switch.slot_s, slot_s, 1e-3) {
        return refuse("switch.slot_s", switch.slot_s, text);
    }
    Ok(Some(Samples { reference: complex(report.reference()), slots: complex(report.slots()) }))
}

/// All of them: a report has no more than there is room for.
fn complex<const N: usize>(samples: &[[i8; 2]]) -> Vec<Complex, N> {
    let mut all = Vec::new();
    for [i, q] in samples {
        let _ = all.push(Complex { re: f32::from(*i) / 128.0, im: f32::from(*q) / 128.0 });
    }
    all
}

/// A transmitter: by its address where it is known, as the controller may give its handle to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transmitter {
    Address(u64),
    Handle(Link, u16),
}

/// Finds directions for packets of several transmitters.
#[derive(Clone, Debug)]
pub struct Finder<const TRANSMITTERS: usize> {
    estimator: Estimator,
    /// The one that was silent longest first.
    transmitters: Vec<(Transmitter, Emitter), TRANSMITTERS>,
}

impl<const TRANSMITTERS: usize> Finder<TRANSMITTERS> {
    /// Without an array: [`begin`](Self::begin) is to be called.
    #[must_use]
    pub const fn new() -> Self {
        Self { estimator: Estimator::EMPTY, transmitters: Vec::new() }
    }

    /// Checks the array, with packets of the longest tone, and begins without a memory of transmitters.
    ///
    /// # Errors
    /// The field that is refused; antennas on a line are.
    pub fn begin(&mut self, array: &Array, floor_rad: f32) -> Result<(), ConfigError> {
        self.transmitters.clear();
        check("sample_rate_hz", array.switch.sample_rate_hz, REFERENCE_HZ, REFERENCE_HZ)?;
        self.estimator.build_in(&direction::Config { floor_rad }, &array.beam, &array.switch, SLOTS_MAX)?;
        self.estimator.beam().refuse_line()
    }

    /// The bearing of a report from the array's zero; it may be invalid. `None` without samples to use.
    ///
    /// # Errors
    /// What the report contradicts: see [`samples`]; `slots` and `switch.pattern` if it is too short for the array.
    #[inline(never)]
    pub fn bearing(
        &mut self,
        switch: &switched::Config,
        report: &IqReport,
        address: Option<u64>,
        time: Instant,
    ) -> Result<Option<Bearing>, ConfigError> {
        let Some(Samples { reference, slots }) = samples(report, switch)? else { return Ok(None) };
        if slots.len() != self.estimator.slots() {
            self.estimator.set_slots(switch, slots.len())?;
        }
        let transmitter = address.map_or(Transmitter::Handle(report.link, report.handle), Transmitter::Address);
        let known = self.transmitters.iter().position(|(known, _)| *known == transmitter);
        let (_, mut emitter) = match known {
            Some(at) => self.transmitters.remove(at),
            None => {
                if self.transmitters.is_full() {
                    self.transmitters.remove(0);
                }
                (transmitter, Emitter::default())
            }
        };
        let arrival = self.estimator.bearing_of_packet(&mut emitter, &reference, &slots, time);
        // Cannot fail: there is a free place.
        let _ = self.transmitters.push((transmitter, emitter));
        Ok(Some(arrival.bearing))
    }
}

impl<const TRANSMITTERS: usize> Default for Finder<TRANSMITTERS> {
    fn default() -> Self {
        Self::new()
    }
}

/// What the bytes of a controller's line become.
#[derive(Clone, Debug, Default)]
pub struct Reports {
    hci: hci::Reader,
    /// There is one transmitter that is wanted.
    finder: Finder<1>,
    /// Packets that were worked out in this step.
    packets: u8,
    /// When the last byte came.
    last: Instant,
}

impl Reports {
    /// Without an array: [`begin`](Self::begin) is to be called.
    #[must_use]
    pub const fn new() -> Self {
        Self { hci: hci::Reader::new(), finder: Finder::new(), packets: 0, last: Instant(0) }
    }

    /// Begins anew, but for the addresses of handles, which a controller says once.
    ///
    /// # Errors
    /// The field of [`ARRAY`] that is refused.
    #[inline(never)]
    pub fn begin(&mut self, mount: &Mount) -> Result<(), ConfigError> {
        self.hci.pause();
        self.packets = 0;
        // A larger sigma makes no bearing.
        self.finder.begin(&ARRAY, mount.sigma_rad.min(1.0))
    }

    /// The packets by which a controller says the addresses that are known.
    pub fn known(&self) -> impl Iterator<Item = [u8; 15]> {
        self.hci.known()
    }

    /// Takes a byte; returns what it ends.
    pub(crate) fn push(&mut self, mount: &Mount, now: Instant, byte: u8) -> Option<Came> {
        if now.micros_since(self.last) > PAUSE_US {
            self.hci.pause();
        }
        self.last = now;
        let report = match self.hci.push(byte)? {
            Ok(report) => report,
            Err(_) => return Some(Came::Refused),
        };
        let address = self.hci.address(&report);
        if mount.tag != 0 && !address.is_some_and(|address| mount.wants(address)) {
            return Some(Came::Other);
        }
        if self.packets >= PACKETS_MAX {
            return Some(Came::Unclear);
        }
        self.packets += 1;
        Some(match self.finder.bearing(&ARRAY.switch, &report, address, now) {
            Ok(Some(bearing)) if bearing.valid => Came::Bearing(mount.mounted(&bearing)),
            Ok(_) => Came::Unclear,
            Err(_) => Came::Refused,
        })
    }

    /// A step has ended.
    pub fn end_step(&mut self) {
        self.packets = 0;
    }
}
