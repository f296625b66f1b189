//! Bluetooth IQ reports in files: btsnoop, as written by `btmon`, Android and Wireshark, or the bytes of a serial line (H4).
//!
//! btsnoop is a header of sixteen bytes (`btsnoop\0`, version 1, kind of packets) and records of a header of 24 bytes and a packet; numbers
//! are big-endian. Kinds: 1001 (H1, no packet type: flags tell what a packet is), 1002 (H4) and 2001 (Linux' monitor).

use std::fmt::Write as _;

use foxhound_computer::iq::{self, Array, Samples};
use foxhound_core::signal::phase::Complex;
use foxhound_link::radio::hci::{self, IqReport, Link, Refused};

use super::radio_array::RadioArray;
use crate::scenario::input::InputError;

const MAGIC: &[u8] = b"btsnoop\0";
/// Longest valid record.
const RECORD_MAX: usize = 1 << 20;
/// Opcode of an event in the monitor format.
const MONITOR_EVENT: u32 = 3;

/// A report, or which of its fields is invalid.
type Report = Result<IqReport, Refused>;

/// A packet of an array behind a switch; an unusable one has no samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Packet {
    pub(super) emitter: i32,
    /// Samples of the reference period, if there are any.
    pub(super) reference: Vec<Complex>,
    /// Samples of the slots.
    pub(super) values: Vec<Complex>,
    /// How many samples are at the ends of the converter's range.
    pub(super) clipped: usize,
}

/// The contents of a file.
pub(super) struct Reports {
    pub(super) packets: Vec<Packet>,
    /// Description of what was read.
    pub(super) taken: String,
}

/// Converts a report to a packet of the array and checks it against the switching schedule; an unusable report has no samples.
fn packet(report: &IqReport, array: &RadioArray) -> Result<Packet, InputError> {
    let Array { switch, .. } = array_of(array)?;
    let Samples { reference, slots } = iq::samples(report, &switch)?.unwrap_or_default();
    if !slots.is_empty() {
        switch.build(slots.len(), 1)?;
    }
    let clipped = clipped(report);
    Ok(Packet { emitter: emitter(report), reference: reference.to_vec(), values: slots.to_vec(), clipped })
}

/// How many samples of a report are at the ends of the range.
pub(super) fn clipped(report: &IqReport) -> usize {
    let is_extreme = |[i, q]: &&[i8; 2]| [i, q].iter().any(|part| part.unsigned_abs() >= 127);
    report.reference().iter().chain(report.slots()).filter(is_extreme).count()
}

/// Number of a report's transmitter. Connections and trains have handles of their own, of twelve bits.
pub(super) fn emitter(report: &IqReport) -> i32 {
    let link = match report.link {
        Link::Advertising => 0,
        Link::Connection => 1,
    };
    i32::from(report.handle) | link << 12
}

/// The array behind a switch that a file describes.
///
/// # Errors
/// There is no switch.
pub(super) fn array_of(array: &RadioArray) -> Result<Array, InputError> {
    let missing = || InputError::new("switch: missing; IQ reports need [switch] with slot_s and pattern");
    Ok(Array { beam: array.beam, switch: array.switch.ok_or_else(missing)? })
}

/// Reads a file.
///
/// # Errors
/// The file is truncated or has no report that can be used: of the first, the field that is invalid or the key of the array file that contradicts it.
pub(super) fn read(bytes: &[u8], array: &RadioArray) -> Result<Reports, InputError> {
    let (reports, kind) = if bytes.starts_with(MAGIC) { (btsnoop(bytes)?, "btsnoop") } else { (h4(bytes)?, "H4") };
    let count = reports.len();
    if count == 0 {
        return Err(InputError::new(format!(
            "no IQ report (LE meta event 0x15 or 0x16) in {} bytes of {kind}",
            bytes.len()
        )));
    }
    let mut packets = Vec::with_capacity(count);
    // Reports of another array or with a field that cannot be: the first, and how many.
    let (mut foreign, mut first) = (0, None);
    for (at, report) in reports.into_iter().enumerate() {
        let read = match report {
            Ok(report) => packet(&report, array).map_err(|error| {
                packets.push(Packet { emitter: emitter(&report), ..Packet::default() });
                InputError::new(format!("report {at}: {error}"))
            }),
            Err(why) => Err(refused(at, why)),
        };
        match read {
            Ok(packet) => packets.push(packet),
            Err(error) => {
                foreign += 1;
                first.get_or_insert(error);
            }
        }
    }
    let usable = packets.iter().filter(|packet| !packet.values.is_empty()).count();
    if usable == 0 {
        let text =
            "none of the IQ reports is of an arrival extension that came whole (CTE_Type 0, Packet_Status 0, samples)";
        return Err(first.unwrap_or_else(|| InputError::new(format!("{text}: {count} reports"))));
    }
    let mut taken = format!("{count} IQ reports, {usable} of them with samples to use, {kind}");
    if let Some(first) = first {
        let _ = write!(taken, "; {foreign} not of this array or not valid, the first is {first}");
    }
    Ok(Reports { packets, taken })
}

fn refused(at: usize, refused: Refused) -> InputError {
    InputError::new(format!("report {at}: {refused}: there is no such value"))
}

/// The reports in the bytes of a serial line.
fn h4(bytes: &[u8]) -> Result<Vec<Report>, InputError> {
    let mut reader = hci::Reader::new();
    let mut reports = Vec::new();
    for byte in bytes {
        if let Some(found) = reader.push(*byte) {
            reports.push(found);
        }
    }
    let skipped = reader.counters().skipped;
    if skipped > 0 {
        return Err(InputError::new(format!("{skipped} bytes begin no H4 packet (types 1 to 5), of {}", bytes.len())));
    }
    if reader.is_inside() {
        return Err(InputError::new(format!("truncated: the last of {} bytes is inside a packet", bytes.len())));
    }
    Ok(reports)
}

/// The reports in a btsnoop file.
fn btsnoop(bytes: &[u8]) -> Result<Vec<Report>, InputError> {
    let word = |bytes: &[u8], at: usize| {
        let four = bytes.get(at..at + 4).and_then(|four| four.try_into().ok());
        four.map(u32::from_be_bytes)
    };
    let (Some(version), Some(kind)) = (word(bytes, 8), word(bytes, 12)) else {
        return Err(InputError::new(format!("truncated: {} bytes, the header of btsnoop has 16", bytes.len())));
    };
    if version != 1 {
        return Err(InputError::new(format!("btsnoop version {version}: expected 1")));
    }
    if ![1001, 1002, 2001].contains(&kind) {
        return Err(InputError::new(format!(
            "btsnoop datalink {kind}: expected 1001 (H1), 1002 (H4) or 2001 (monitor)"
        )));
    }
    let mut reports = Vec::new();
    let (mut rest, mut record) = (&bytes[16..], 0);
    while !rest.is_empty() {
        let truncated = || InputError::new(format!("truncated: record {record} breaks off"));
        let (original, included) =
            (word(rest, 0).ok_or_else(truncated)?, word(rest, 4).ok_or_else(truncated)? as usize);
        let flags = word(rest, 8).ok_or_else(truncated)?;
        // A shortened record of something else does not matter, and a shortened report is refused as such.
        if included > RECORD_MAX || included > original as usize {
            let text = format!("record {record}: {included} bytes of a packet of {original}");
            return Err(InputError::new(text));
        }
        let packet = rest.get(24..24 + included).ok_or_else(truncated)?;
        rest = &rest[24 + included..];
        record += 1;
        let event = match kind {
            1001 => (flags & 3 == 3).then_some(packet),
            1002 => packet.strip_prefix(&[4]),
            _ => (flags & 0xFFFF == MONITOR_EVENT).then_some(packet),
        };
        reports.extend(event.and_then(|event| hci::report(event).transpose()));
    }
    Ok(reports)
}
