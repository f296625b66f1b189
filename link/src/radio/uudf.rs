//! Angles of u-blox modules (ANT-B10 and others with u-connectLocate), lines such as
//!
//! ```text
//! +UUDF:6C1DEBA41845,-56,-11,20,0,39,"6C1DEBA79D14","",746675,12
//! ```
//!
//! The fields are: the tag's address, received power in dBm, azimuth and elevation in degrees from the board's normal, a reserved number, the radio
//! channel, the anchor's address, a user-defined text, milliseconds since the board started, and in newer versions a sequence number. Azimuth is
//! positive to the right of the board, looking along its normal. The caller adds the angle at which the board is mounted.

use heapless::Vec;

/// Longest line that is read.
pub const LINE_MAX: usize = 160;

/// A measured angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Angle {
    /// Address of the tag.
    pub tag: u64,
    /// Received power.
    pub rssi_dbm: i16,
    /// Azimuth from the board's normal, degrees.
    pub azimuth_deg: i16,
    /// Elevation, degrees.
    pub elevation_deg: i16,
    /// Radio channel, 0 to 39.
    pub channel: u8,
    /// Time since the board started.
    pub time_ms: u64,
}

/// Why a line is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// The field, or `line` if the line is longer than [`LINE_MAX`].
    pub field: &'static str,
}

impl core::fmt::Display for Refused {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "+UUDF: {}", self.field)
    }
}

/// Reads a line; `None` for other kinds of lines.
///
/// # Errors
/// The field that is missing, not a number or out of range.
pub fn angle(line: &[u8]) -> Result<Option<Angle>, Refused> {
    let Some(fields) = line.trim_ascii().strip_prefix(b"+UUDF:") else { return Ok(None) };
    let mut fields = Split { rest: Some(fields) };
    let tag = address(fields.text("tag")?).ok_or(Refused { field: "tag" })?;
    let rssi_dbm = fields.number("rssi", -127, 20)?;
    let azimuth_deg = fields.number("azimuth", -180, 180)?;
    let elevation_deg = fields.number("elevation", -90, 90)?;
    fields.text("reserved")?;
    let channel = fields.number("channel", 0, 39)? as u8;
    fields.text("anchor")?;
    fields.text("user")?;
    let time_ms = digits(fields.text("timestamp")?).ok_or(Refused { field: "timestamp" })?;
    if fields.rest.is_some_and(|rest| digits(rest).is_none()) {
        return Err(Refused { field: "sequence" });
    }
    Ok(Some(Angle { tag, rssi_dbm, azimuth_deg, elevation_deg, channel, time_ms }))
}

/// Twelve hexadecimal digits.
fn address(text: &[u8]) -> Option<u64> {
    let digit = |byte: &u8| (*byte as char).to_digit(16);
    let add = |sum, byte| Some(sum << 4 | u64::from(digit(byte)?));
    text.iter().try_fold(0, add).filter(|_| text.len() == 12)
}

/// Decimal digits, as many as cannot overflow.
fn digits(text: &[u8]) -> Option<u64> {
    let add = |sum, byte: &u8| byte.is_ascii_digit().then(|| 10 * sum + u64::from(byte - b'0'));
    let is_number = (1..20).contains(&text.len());
    text.iter().take(19).try_fold(0, add).filter(|_| is_number)
}

/// The fields that have not been read yet; a comma inside quotation marks does not end a field. Bytes, as the parsers of Rust's own
/// library take 0.5 KB more of a microcontroller's flash.
struct Split<'a> {
    rest: Option<&'a [u8]>,
}

impl<'a> Split<'a> {
    #[inline(never)]
    fn text(&mut self, field: &'static str) -> Result<&'a [u8], Refused> {
        let rest = self.rest.ok_or(Refused { field })?;
        let mut quoted = false;
        let mut parts = rest.splitn(2, |byte| {
            quoted ^= *byte == b'"';
            *byte == b',' && !quoted
        });
        let mut text = parts.next().unwrap_or_default();
        self.rest = parts.next();
        while let [b' ' | b'"', inner @ ..] | [inner @ .., b' ' | b'"'] = text {
            text = inner;
        }
        Ok(text)
    }

    #[inline(never)]
    fn number(&mut self, field: &'static str, least: i16, most: i16) -> Result<i16, Refused> {
        let text = self.text(field)?;
        let (sign, text) = text.strip_prefix(b"-").map_or((1, text), |text| (-1, text));
        let value = digits(text).map(|value| sign * value.min(0xFFFF) as i32);
        let is_right = |value: &i32| (i32::from(least)..=i32::from(most)).contains(value);
        value.filter(is_right).map(|value| value as i16).ok_or(Refused { field })
    }
}

/// Collects bytes into lines.
///
/// ```
/// use foxhound_link::radio::uudf::Reader;
///
/// let mut reader = Reader::default();
/// let line = b"+UUDF:6C1DEBA41845,-56,-11,20,0,39,\"6C1DEBA79D14\",\"\",746675,12\r\n";
/// let angle = line.iter().find_map(|byte| reader.push(*byte)).expect("a whole line").unwrap();
/// assert_eq!((angle.azimuth_deg, angle.elevation_deg), (-11, 20));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Reader {
    line: Vec<u8, LINE_MAX>,
    is_too_long: bool,
}

impl Reader {
    /// Takes a byte; returns an angle, or why its line is refused, at the end of the line.
    pub fn push(&mut self, byte: u8) -> Option<Result<Angle, Refused>> {
        if byte != b'\n' && byte != b'\r' {
            self.is_too_long |= self.line.push(byte).is_err();
            return None;
        }
        let is_too_long = core::mem::take(&mut self.is_too_long);
        let found = if is_too_long && self.line.starts_with(b"+UUDF:") {
            Some(Err(Refused { field: "line" }))
        } else if is_too_long {
            None
        } else {
            angle(&self.line).transpose()
        };
        self.line.clear();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec as List;

    #[test]
    fn lines_of_old_and_new_boards_are_read() {
        let line = br#"+UUDF:6C1DEBA41845,-56,-11,20,0,39,"6C1DEBA79D14","a,b",746675"#;
        let found = angle(line).unwrap().unwrap();
        assert_eq!(found.tag, 0x6C1D_EBA4_1845);
        assert_eq!((found.rssi_dbm, found.azimuth_deg, found.elevation_deg), (-56, -11, 20));
        assert_eq!((found.channel, found.time_ms), (39, 746_675));
        let newer = br#"+UUDF:F4CE5FC91A6A,-50,59,20,0,20,"CD84C98B935D","",238777,40871"#;
        assert_eq!(angle(newer).unwrap().unwrap().azimuth_deg, 59);
        assert_eq!(angle(b"OK"), Ok(None));
        assert_eq!(angle(b"+UUDFP:1"), Ok(None));
    }

    #[test]
    fn a_wrong_field_is_refused_by_name() {
        let good = r#"+UUDF:6C1DEBA41845,-56,-11,20,0,39,"6C1DEBA79D14","",746675,12"#;
        for (from, to, field) in [
            ("6C1DEBA41845", "6C1DEBA4184", "tag"),
            ("6C1DEBA41845", "+C1DEBA41845", "tag"),
            ("-56", "-200", "rssi"),
            ("-11", "181", "azimuth"),
            ("-11", "", "azimuth"),
            (",20,", ",ninety,", "elevation"),
            (",39,", ",40,", "channel"),
            ("746675", "-1", "timestamp"),
            ("746675", "", "timestamp"),
            ("-56", "--56", "rssi"),
            ("-11", "99999999999999999999999", "azimuth"),
            ("-11", "65529", "azimuth"),
            (",12", ",12,4", "sequence"),
            ("-11,20,0,39,\"6C1DEBA79D14\",\"\",746675,12", "-11", "elevation"),
        ] {
            assert_eq!(angle(good.replace(from, to).as_bytes()).unwrap_err().field, field, "{from} -> {to}");
        }
    }

    #[test]
    fn lines_are_collected_and_long_ones_are_dropped() {
        let mut reader = Reader::default();
        let mut text = List::from(*b"noise\r\n\r\n");
        text.extend(br#"+UUDF:6C1DEBA41845,-56,-11,20,0,39,"6C1DEBA79D14","",746675"#);
        text.extend(b"\r\n+UUDF:");
        text.extend([b'1'; 300]);
        text.extend(b"\n");
        text.extend([b'x'; 300]);
        text.extend(b"\n+UUDF:1,2\n");
        let found: List<_> = text.iter().filter_map(|byte| reader.push(*byte)).collect();
        assert_eq!(found.len(), 3);
        assert!(found[0].is_ok_and(|angle| angle.azimuth_deg == -11));
        assert_eq!((found[1], found[2]), (Err(Refused { field: "line" }), Err(Refused { field: "tag" })));
    }
}
