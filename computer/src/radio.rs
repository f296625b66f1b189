//! A radio on the lidar's serial line, in its place: a u-blox module that measures angles itself and sends `+UUDF` lines ([`uudf`]), or
//! a Bluetooth controller that sends IQ reports of an antenna array ([`iq`](crate::iq)). It needs no antennas at the converters.
//!
//! The newest angle of the wanted tag, or direction of its packet, becomes the bearing of the step in which its last byte has come.
//! What cannot be read, what has no direction, and what is of another tag make no bearing and are counted. Of a tag whose address
//! the controller has not said nothing is known: it is another one, unless any tag will do.
//!
//! In a step no more than two packets are worked out, so that a flood of reports does not delay the flight; others count as
//! without a direction.

use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::doa::radio::{Mount, Sends};
use foxhound_link::radio::uudf;

use crate::came::Came;
use crate::iq::Reports;

const DEG_TO_RAD: f32 = core::f32::consts::PI / 180.0;

/// Bit rate of its line: the default of u-blox modules, and that of Zephyr's controllers.
#[must_use]
pub const fn baud(sends: Sends) -> u32 {
    match sends {
        Sends::Angles => 115_200,
        Sends::IqReports => 1_000_000,
    }
}

/// Counts since it was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Angles of wanted tags.
    pub angles: u32,
    /// Angles and reports of other tags.
    pub others: u32,
    /// Reports of wanted tags without a direction.
    pub unclear: u32,
    /// Lines and reports that cannot be read.
    pub refused: u32,
}

/// Reads its bytes.
#[derive(Clone, Debug)]
pub struct Radio {
    mount: Mount,
    angles: uudf::Reader,
    bearing: Option<Bearing>,
    counters: Counters,
}

impl Radio {
    /// Before the first byte, of a mount that has been checked.
    #[must_use]
    pub fn new(mount: Mount) -> Self {
        Self { mount, angles: uudf::Reader::default(), bearing: None, counters: Counters::default() }
    }

    /// Takes bytes, in pieces of any size, that have arrived by now; the reports have begun with this mount.
    pub fn push(&mut self, now: Instant, bytes: &[u8], reports: &mut Reports) {
        for byte in bytes {
            let came = match self.mount.sends {
                Sends::Angles => self.push_angle(now, *byte),
                Sends::IqReports => reports.push(&self.mount, now, *byte),
            };
            let count = match came {
                None => continue,
                Some(Came::Bearing(bearing)) => {
                    self.bearing = Some(bearing);
                    &mut self.counters.angles
                }
                Some(Came::Other) => &mut self.counters.others,
                Some(Came::Unclear) => &mut self.counters.unclear,
                Some(Came::Refused) => &mut self.counters.refused,
            };
            *count = count.saturating_add(1);
        }
    }

    fn push_angle(&mut self, now: Instant, byte: u8) -> Option<Came> {
        Some(match self.angles.push(byte)? {
            Ok(angle) if self.mount.wants(angle.tag) => {
                Came::Bearing(self.mount.bearing(now, f32::from(angle.azimuth_deg) * DEG_TO_RAD))
            }
            Ok(_) => Came::Other,
            Err(_) => Came::Refused,
        })
    }

    /// The bearing that has not been taken, if there is one.
    #[must_use]
    pub const fn bearing(&self) -> Option<Bearing> {
        self.bearing
    }

    /// The bearing has been taken.
    pub fn take(&mut self) {
        self.bearing = None;
    }

    /// Counts since it was built.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &[u8] = b"+UUDF:6C1DEBA41845,-56,-11,20,0,39,\"6C1DEBA79D14\",\"\",746675,12\r\n";

    fn radio(tag: u32) -> Radio {
        Radio::new(Mount { yaw_rad: 90.0 * DEG_TO_RAD, tag, ..Mount::default() })
    }

    #[test]
    fn a_line_in_pieces_becomes_one_bearing_of_its_time() {
        let mut radio = radio(0xA4_1845);
        radio.push(Instant(1), &LINE[..20], &mut Reports::new());
        assert_eq!(radio.bearing(), None);
        radio.push(Instant(2), &LINE[20..], &mut Reports::new());
        let bearing = radio.bearing().unwrap();
        assert!((bearing.azimuth_rad.to_degrees() - 79.0).abs() < 1e-4 && bearing.time == Instant(2), "{bearing:?}");
        assert!(bearing.valid && (bearing.sigma_rad.to_degrees() - 8.0).abs() < 1e-4, "{bearing:?}");
        radio.take();
        assert_eq!(radio.bearing(), None);
        assert_eq!(radio.counters(), Counters { angles: 1, ..Counters::default() });
    }

    #[test]
    fn other_tags_and_damaged_lines_are_counted_and_make_no_bearing() {
        let mut radio = radio(0xA4_1846);
        let reports = &mut Reports::new();
        radio.push(Instant(1), LINE, reports);
        radio.push(Instant(1), b"+UUDF:6C1DEBA41846,-56,-999,20,0,39,\"\",\"\",1\r\n", reports);
        radio.push(Instant(1), b"+STARTUP\r\nOK\r\n", reports);
        assert_eq!(radio.bearing(), None);
        assert_eq!(radio.counters(), Counters { others: 1, refused: 1, ..Counters::default() });
    }
}
