//! Bluetooth IQ reports: LE meta events 0x15 (Connectionless IQ Report) and 0x16 (Connection IQ Report).
//!
//! Bluetooth Core Specification, Vol 4: part A for the H4 framing of a serial line, part E 7.7.65.21 and 22 for the events. The
//! first eight samples are the reference period, 1 us apart, all from one antenna. Then each sample slot gives one sample, two slot
//! durations after the last, from the next antenna of the switching pattern. A report with an invalid field is not used.
//!
//! Reports name their transmitter by a handle. Which address it has is said once, when the controller synchronises with the train
//! (0x0E, 0x24) or connects (0x01, 0x0A, 0x29): [`Reader::address`].

use heapless::Vec;

/// Largest number of samples in a report: those of a constant tone extension of 160 us.
pub const SAMPLES_MAX: usize = 82;
/// Smallest number of samples in a report that has any.
pub const SAMPLES_MIN: usize = 9;
/// Samples of the reference period.
pub const REFERENCE: usize = 8;
/// Longest event: its code, its length, its parameters.
const EVENT_MAX: usize = 257;
/// Value of an invalid sample.
const NO_SAMPLE: i8 = i8::MIN;

const LE_META: u8 = 0x3E;
const CONNECTIONLESS: u8 = 0x15;
const CONNECTION: u8 = 0x16;
/// Events that end what a handle is for: Disconnection Complete, and the LE meta event Periodic Advertising Sync Lost.
const DISCONNECTION: u8 = 0x05;
const SYNC_LOST: u8 = 0x10;
/// Longest body of a packet that is not an event; what says it is longer begins no packet.
const BODY_MAX: u16 = 1024;
/// Most handles whose addresses are kept at a time; the oldest gives way.
const HANDLES_MAX: usize = 16;

/// How the packet was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Link {
    /// Periodic advertising: the handle is that of the synchronised train.
    Advertising,
    /// A connection.
    Connection,
}

/// Type of the constant tone extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cte {
    /// Angle of arrival: the receiver switches its antennas, so a bearing can be measured.
    Arrival,
    /// Angle of departure: the transmitter switches its antennas; no bearing can be measured.
    Departure,
}

/// Status of the packet in the radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Received without error.
    Good,
    /// The checksum is wrong, so the sender is not certain.
    BadChecksum,
    /// The radio had no memory for the samples.
    NoResources,
}

/// An IQ report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IqReport {
    /// How it was sent.
    pub link: Link,
    /// Handle of the connection or of the advertising train: tells transmitters apart.
    pub handle: u16,
    /// Radio channel, 0 to 39.
    pub channel: u8,
    /// Received power, in tenths of a dBm.
    pub rssi_ddbm: i16,
    /// Type of the constant tone extension.
    pub cte: Cte,
    /// Length of a slot: 1 or 2 us. Samples come two slots apart.
    pub slot_us: u8,
    /// Status of the packet.
    pub status: Status,
    /// Counter of events.
    pub counter: u16,
    samples: Vec<[i8; 2], SAMPLES_MAX>,
}

impl IqReport {
    /// I and Q of the reference period, 1 us apart.
    #[must_use]
    pub fn reference(&self) -> &[[i8; 2]] {
        self.samples.get(..REFERENCE).unwrap_or_default()
    }

    /// I and Q of the sample slots.
    #[must_use]
    pub fn slots(&self) -> &[[i8; 2]] {
        self.samples.get(REFERENCE..).unwrap_or_default()
    }

    /// Whether a bearing can be measured from it.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        let is_whole = !self.samples.iter().flatten().any(|part| *part == NO_SAMPLE);
        self.cte == Cte::Arrival && self.status == Status::Good && !self.slots().is_empty() && is_whole
    }
}

/// Why a report is refused: the invalid field and its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Name of the field in the specification.
    pub field: &'static str,
    /// Its value.
    pub value: i32,
}

impl core::fmt::Display for Refused {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} = {}", self.field, self.value)
    }
}

/// The parameters of an event that have not been read yet.
struct Fields<'a> {
    rest: &'a [u8],
    length: usize,
}

impl Fields<'_> {
    fn byte(&mut self) -> Result<u8, Refused> {
        let (first, rest) =
            self.rest.split_first().ok_or(Refused { field: "Parameter_Total_Length", value: self.length as i32 })?;
        self.rest = rest;
        Ok(*first)
    }

    fn word(&mut self) -> Result<u16, Refused> {
        Ok(u16::from_le_bytes([self.byte()?, self.byte()?]))
    }

    fn within(&mut self, field: &'static str, most: u8) -> Result<u8, Refused> {
        let value = self.byte()?;
        if value > most { Err(Refused { field, value: i32::from(value) }) } else { Ok(value) }
    }
}

/// Reads the report in an event (code, length, parameters); `None` for other events.
///
/// # Errors
/// The field with an invalid value, or `Parameter_Total_Length` if it does not match the number of samples.
pub fn report(event: &[u8]) -> Result<Option<IqReport>, Refused> {
    let (Some(code), Some(length)) = (event.first(), event.get(1)) else {
        return Err(Refused { field: "Parameter_Total_Length", value: -1 });
    };
    let parameters = event.get(2..).unwrap_or_default();
    if *code != LE_META {
        return Ok(None);
    }
    let link = match parameters.first() {
        Some(&CONNECTIONLESS) => Link::Advertising,
        Some(&CONNECTION) => Link::Connection,
        _ => return Ok(None),
    };
    let wrong_length = Refused { field: "Parameter_Total_Length", value: i32::from(*length) };
    if parameters.len() != usize::from(*length) {
        return Err(wrong_length);
    }
    let mut fields = Fields { rest: parameters.get(1..).unwrap_or_default(), length: parameters.len() };
    let handle = fields.word()?;
    if handle > 0x0FFF {
        let field = if link == Link::Advertising { "Sync_Handle" } else { "Connection_Handle" };
        return Err(Refused { field, value: i32::from(handle) });
    }
    if link == Link::Connection {
        let phy = fields.byte()?;
        if !(1..=2).contains(&phy) {
            return Err(Refused { field: "RX_PHY", value: i32::from(phy) });
        }
    }
    let channel = fields.within("Channel_Index", 39)?;
    let rssi_ddbm = fields.word()?.cast_signed();
    if !(-1270..=200).contains(&rssi_ddbm) {
        return Err(Refused { field: "RSSI", value: i32::from(rssi_ddbm) });
    }
    let _antenna = fields.byte()?;
    let cte = if fields.within("CTE_Type", 2)? == 0 { Cte::Arrival } else { Cte::Departure };
    let slot_us = fields.within("Slot_Durations", 2)?;
    if slot_us == 0 {
        return Err(Refused { field: "Slot_Durations", value: 0 });
    }
    let status = match fields.byte()? {
        0 => Status::Good,
        1 | 2 => Status::BadChecksum,
        0xFF => Status::NoResources,
        value => return Err(Refused { field: "Packet_Status", value: i32::from(value) }),
    };
    let counter = fields.word()?;
    let count = usize::from(fields.byte()?);
    if count != 0 && !(SAMPLES_MIN..=SAMPLES_MAX).contains(&count) {
        // Some radios report "no samples" as one invalid sample.
        let is_none = status == Status::NoResources && count == 1;
        if !is_none {
            return Err(Refused { field: "Sample_Count", value: count as i32 });
        }
    }
    let wanted = 2 * count;
    let is_none = count == 0 && fields.rest.len() <= 2;
    if fields.rest.len() != wanted && !is_none {
        return Err(wrong_length);
    }
    let mut samples = Vec::new();
    if count >= SAMPLES_MIN {
        for pair in fields.rest.chunks_exact(2) {
            if let &[i, q] = pair {
                // Cannot fail: the count was checked.
                let _ = samples.push([i.cast_signed(), q.cast_signed()]);
            }
        }
    }
    Ok(Some(IqReport { link, handle, channel, rssi_ddbm, cte, slot_us, status, counter, samples }))
}

/// The addresses of the transmitters that have a handle.
#[derive(Clone, Debug, Default)]
struct Handles(Vec<(Link, u16, [u8; 6]), HANDLES_MAX>);

impl Handles {
    /// Takes note of an event; most say nothing of a handle.
    fn note(&mut self, event: &[u8]) {
        let word = |at: usize| Some(u16::from_le_bytes([*event.get(at)?, *event.get(at.checked_add(1)?)?]));
        match *event {
            // Status 0: it has ended, or begun. Then the handle; behind it role or set, kind of address, address.
            [DISCONNECTION, _, 0, ..] => self.forget(Link::Connection, word(3)),
            [LE_META, _, SYNC_LOST, ..] => self.forget(Link::Advertising, word(3)),
            [LE_META, _, sub, 0, _, _, _, _, a, b, c, d, e, f, ..] => {
                let link = match sub {
                    0x0E | 0x24 => Link::Advertising,
                    0x01 | 0x0A | 0x29 => Link::Connection,
                    _ => return,
                };
                self.forget(link, word(4));
                if let Some(handle) = word(4) {
                    if self.0.is_full() {
                        self.0.remove(0);
                    }
                    // Cannot fail: there is a free place.
                    let _ = self.0.push((link, handle, [a, b, c, d, e, f]));
                }
            }
            _ => {}
        }
    }

    fn forget(&mut self, link: Link, handle: Option<u16>) {
        self.0.retain(|(own_link, own, _)| *own_link != link || Some(*own) != handle);
    }
}

/// What was received.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Events, including reports.
    pub events: u32,
    /// Valid reports.
    pub reports: u32,
    /// Reports with an invalid field.
    pub refused: u32,
    /// Bytes that are not part of a packet.
    pub skipped: u32,
}

/// Position in a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Within {
    /// The next byte is a packet's type.
    Type,
    /// An event is being collected.
    Event,
    /// The header of a packet that is not an event: the type of the packet, and the header bytes read so far.
    Header { kind: u8, taken: u8 },
    /// The body of such a packet: the number of bytes still to come.
    Body(u16),
}

/// Finds reports in the bytes of a serial line. H4 has no mark between packets: bytes that cannot begin one are skipped.
///
/// ```
/// use foxhound_link::radio::hci::Reader;
///
/// let mut reader = Reader::new();
/// // An event that is no report: its code, a length of one, one byte.
/// assert!([4, 0x0E, 1, 0].into_iter().all(|byte| reader.push(byte).is_none()));
/// assert_eq!((reader.counters().events, reader.is_inside()), (1, false));
/// ```
#[derive(Clone, Debug)]
pub struct Reader {
    within: Within,
    event: Vec<u8, EVENT_MAX>,
    length: u16,
    counters: Counters,
    handles: Handles,
}

impl Default for Reader {
    fn default() -> Self {
        Self::new()
    }
}

impl Reader {
    /// A reader at the beginning of a line.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            within: Within::Type,
            event: Vec::new(),
            length: 0,
            counters: Counters { events: 0, reports: 0, refused: 0, skipped: 0 },
            handles: Handles(Vec::new()),
        }
    }

    /// Address of the transmitter of a report, its first octet the highest of 48 bits; `None` when the controller has not said
    /// which one has this handle.
    #[must_use]
    pub fn address(&self, report: &IqReport) -> Option<u64> {
        let mut handles = self.handles.0.iter();
        handles
            .find(|(link, handle, _)| (*link, *handle) == (report.link, report.handle))
            .map(|(_, _, [a, b, c, d, e, f])| u64::from_le_bytes([*a, *b, *c, *d, *e, *f, 0, 0]))
    }

    /// The counters.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Whether the last packet is incomplete.
    #[must_use]
    pub fn is_inside(&self) -> bool {
        self.within != Within::Type
    }

    /// The line was silent. Packets are sent without a pause, so the last one has lost bytes if it is incomplete: it is left out.
    pub fn pause(&mut self) {
        if self.is_inside() {
            self.within = Within::Type;
            self.counters.skipped = self.counters.skipped.saturating_add(1);
        }
    }

    /// The events that say again which addresses have a handle, as packets.
    pub fn known(&self) -> impl Iterator<Item = [u8; 15]> {
        self.handles.0.iter().map(|(link, handle, [a, b, c, d, e, f])| {
            let [low, high] = handle.to_le_bytes();
            let event = if *link == Link::Advertising { 0x0E } else { 0x01 };
            [4, LE_META, 12, event, 0, low, high, 0, 0, *a, *b, *c, *d, *e, *f]
        })
    }

    /// Takes a byte; returns a report, or why it is refused, with the report's last byte.
    pub fn push(&mut self, byte: u8) -> Option<Result<IqReport, Refused>> {
        match self.within {
            Within::Type => {
                self.length = 0;
                self.within = match byte {
                    4 => Within::Event,
                    1 | 2 | 3 | 5 => Within::Header { kind: byte, taken: 0 },
                    _ => {
                        self.counters.skipped = self.counters.skipped.saturating_add(1);
                        Within::Type
                    }
                };
                self.event.clear();
                None
            }
            Within::Header { kind, taken } => {
                // Command and SCO: two bytes, then one byte of length. ACL and ISO: two bytes, then two of length (ISO: 14 bits).
                match (kind, taken) {
                    (1 | 3, 2) => self.skip(u16::from(byte)),
                    (2 | 5, 3) => {
                        let high = if kind == 5 { byte & 0x3F } else { byte };
                        self.skip(self.length | u16::from(high) << 8);
                    }
                    _ => {
                        self.length = u16::from(byte);
                        self.within = Within::Header { kind, taken: taken.saturating_add(1) };
                    }
                }
                None
            }
            Within::Body(left) => {
                self.skip(left.saturating_sub(1));
                None
            }
            Within::Event => {
                let _ = self.event.push(byte);
                let wanted = self.event.get(1).map(|length| usize::from(*length).saturating_add(2))?;
                if self.event.len() < wanted {
                    return None;
                }
                self.within = Within::Type;
                self.counters.events = self.counters.events.saturating_add(1);
                self.handles.note(&self.event);
                let found = report(&self.event).transpose();
                match &found {
                    Some(Ok(_)) => self.counters.reports = self.counters.reports.saturating_add(1),
                    Some(Err(_)) => self.counters.refused = self.counters.refused.saturating_add(1),
                    None => {}
                }
                found
            }
        }
    }

    fn skip(&mut self, count: u16) {
        if count > BODY_MAX {
            self.within = Within::Type;
            self.counters.skipped = self.counters.skipped.saturating_add(1);
            return;
        }
        self.within = if count == 0 { Within::Type } else { Within::Body(count) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec as List;

    /// A connectionless report of 45 samples, by the table of the specification.
    fn event(count: u8) -> List<u8> {
        let mut parameters = vec![0x15, 0x34, 0x02, 17, 0x18, 0xFD, 3, 0, 2, 0, 0x39, 0x05, count];
        for k in 0..count {
            parameters.extend([k, 0u8.wrapping_sub(k)]);
        }
        let mut event = vec![0x3E, parameters.len() as u8];
        event.extend(parameters);
        event
    }

    #[test]
    fn a_report_is_read_by_the_table_of_the_specification() {
        let found = report(&event(45)).unwrap().unwrap();
        assert_eq!((found.link, found.handle, found.channel), (Link::Advertising, 0x234, 17));
        assert_eq!((found.rssi_ddbm, found.slot_us, found.counter), (-744, 2, 0x539));
        assert_eq!((found.reference().len(), found.slots().len()), (8, 37));
        assert_eq!((found.reference()[1], found.slots()[0]), ([1, -1], [8, -8]));
        assert!(found.is_usable());
        let mut connection = event(9);
        connection[1] += 1;
        connection[2] = 0x16;
        connection.insert(5, 1);
        let found = report(&connection).unwrap().unwrap();
        assert_eq!((found.link, found.handle, found.slots().len()), (Link::Connection, 0x234, 1));
    }

    #[test]
    fn what_makes_no_bearing_says_so() {
        for (at, value) in [(9, 1), (11, 1), (11, 2)] {
            let mut other = event(45);
            other[at] = value;
            assert!(!report(&other).unwrap().unwrap().is_usable(), "{at}");
        }
        let mut none = event(0);
        none[11] = 0xFF;
        assert!(!report(&none).unwrap().unwrap().is_usable());
        let mut invalid = event(45);
        invalid[15 + 2 * 40] = 0x80;
        assert!(!report(&invalid).unwrap().unwrap().is_usable());
        assert_eq!(report(&[0x3E, 1, 0x02]), Ok(None));
        assert_eq!(report(&[0x0E, 0]), Ok(None));
    }

    #[test]
    fn a_wrong_field_is_refused_by_name() {
        for (at, value, field) in [
            (1, 12, "Parameter_Total_Length"),
            (4, 0x10, "Sync_Handle"),
            (5, 40, "Channel_Index"),
            (7, 0x7F, "RSSI"),
            (9, 3, "CTE_Type"),
            (10, 0, "Slot_Durations"),
            (10, 3, "Slot_Durations"),
            (11, 3, "Packet_Status"),
            (14, 8, "Sample_Count"),
            (14, 83, "Sample_Count"),
            (14, 44, "Parameter_Total_Length"),
        ] {
            let mut wrong = event(45);
            wrong[at] = value;
            assert_eq!(report(&wrong).unwrap_err().field, field, "byte {at} = {value}");
        }
        assert!(report(&[]).is_err() && report(&[0x3E]).is_err());
    }

    #[test]
    fn a_handle_has_the_address_that_the_controller_says_until_it_ends() {
        let mut reader = Reader::new();
        let mut take = |event: &[u8]| {
            let found = core::iter::once(&4).chain(event).filter_map(|byte| reader.push(*byte)).last();
            found.and_then(|report| reader.address(&report.unwrap()))
        };
        // By the tables of Vol 4, part E, 7.7.65.14, 7.7.65.1 and 7.7.65.16, and 7.7.5.
        let synchronised = [0x3E, 16, 0x0E, 0, 0x34, 0x02, 3, 1, 0x45, 0x18, 0xA4, 0xEB, 0x1D, 0x6C, 1, 80, 0, 0];
        let mut connected = [0x3E, 19, 0x01, 0, 0x34, 0x02, 0, 1, 6, 5, 4, 3, 2, 1, 0, 0, 0, 0, 0, 0, 0];
        let mut connection = event(9);
        connection[1] += 1;
        connection[2] = 0x16;
        connection.insert(5, 1);
        assert_eq!(take(&event(45)), None);
        take(&synchronised);
        assert_eq!(take(&event(45)), Some(0x6C1D_EBA4_1845));
        assert_eq!(take(&connection), None, "a connection has handles of its own");
        take(&connected);
        assert_eq!((take(&connection), take(&event(45))), (Some(0x0102_0304_0506), Some(0x6C1D_EBA4_1845)));
        connected[8] = 7;
        take(&connected);
        assert_eq!(take(&connection), Some(0x0102_0304_0507));
        let known = reader.known().flatten().collect::<List<_>>();
        let mut again = Reader::new();
        assert!(known.iter().all(|byte| again.push(*byte).is_none()) && !again.is_inside());
        assert_eq!(again.handles.0, reader.handles.0);
        let mut take = |event: &[u8]| {
            let found = core::iter::once(&4).chain(event).filter_map(|byte| reader.push(*byte)).last();
            found.and_then(|report| reader.address(&report.unwrap()))
        };
        take(&[0x05, 4, 0, 0x34, 0x02, 0x13]);
        assert_eq!((take(&connection), take(&event(45))), (None, Some(0x6C1D_EBA4_1845)));
        take(&[0x3E, 3, 0x10, 0x34, 0x02]);
        assert_eq!(take(&event(45)), None);
        let mut failed = synchronised;
        failed[3] = 0x3E;
        take(&failed);
        assert_eq!(take(&event(45)), None);
        for handle in 0..200 {
            let mut one = synchronised;
            one[4] = handle;
            take(&one);
            // Truncated, of no known length.
            take(&[0x3E, 5, 0x0E, 0, handle, 2, 3]);
        }
        take(&synchronised);
        assert_eq!(take(&event(45)), Some(0x6C1D_EBA4_1845));
    }

    #[test]
    fn after_a_pause_and_after_an_impossible_length_a_packet_may_begin() {
        let whole: List<u8> = core::iter::once(4).chain(event(45)).collect();
        let mut reader = Reader::new();
        let reports = |bytes: &[u8], reader: &mut Reader| bytes.iter().filter_map(|byte| reader.push(*byte)).count();
        // Cut off, then the next one: without a pause that is lost, too.
        assert_eq!(reports(&whole[..50], &mut reader), 0);
        reader.pause();
        assert_eq!((reports(&whole, &mut reader), reader.is_inside()), (1, false));
        // A data packet of 65 535 bytes.
        assert_eq!(reports(&[2, 0, 0, 0xFF, 0xFF], &mut reader), 0);
        assert_eq!((reports(&whole, &mut reader), reader.counters().skipped), (1, 2));
    }

    #[test]
    fn reports_are_found_between_other_packets_and_noise() {
        let mut line =
            vec![0xAA, 0x00, 1, 0x03, 0x0C, 0, 2, 0x01, 0x20, 3, 0, 4, 4, 4, 3, 1, 0, 2, 4, 4, 5, 1, 0, 1, 0xC0, 4];
        for _ in 0..2 {
            line.push(4);
            line.extend(event(45));
        }
        line.extend([4, 0x0E, 1, 0, 4]);
        let mut reader = Reader::new();
        let found: List<_> = line.iter().filter_map(|byte| reader.push(*byte)).collect();
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(Result::is_ok) && reader.is_inside());
        assert_eq!(reader.counters(), Counters { events: 3, reports: 2, refused: 0, skipped: 2 });
    }
}
