//! A radio on the lidar's serial line, in its place, that measures angles itself: a u-blox module that sends `+UUDF`
//! lines ([`uudf`]). It needs no antennas at the converters.
//!
//! The newest angle of the wanted tag becomes the bearing of the step in which its line has ended. A line that cannot
//! be read, and one of another tag, make no bearing and are counted.

use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::doa::radio::Mount;
use foxhound_link::radio::uudf;

const DEG_TO_RAD: f32 = core::f32::consts::PI / 180.0;

/// Bit rate of its line, the module's default.
pub const BAUD: u32 = 115_200;

/// Counts since it was built.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Angles of wanted tags.
    pub angles: u32,
    /// Angles of other tags.
    pub others: u32,
    /// Lines that cannot be read.
    pub refused: u32,
}

/// Reads its bytes.
#[derive(Clone, Debug)]
pub struct Radio {
    mount: Mount,
    reader: uudf::Reader,
    bearing: Option<Bearing>,
    counters: Counters,
}

impl Radio {
    /// Before the first byte, of a mount that has been checked.
    #[must_use]
    pub fn new(mount: Mount) -> Self {
        Self { mount, reader: uudf::Reader::default(), bearing: None, counters: Counters::default() }
    }

    /// Takes bytes, in pieces of any size, that have arrived by now.
    pub fn push(&mut self, now: Instant, bytes: &[u8]) {
        for byte in bytes {
            let count = match self.reader.push(*byte) {
                None => continue,
                Some(Ok(angle)) if self.mount.wants(angle.tag) => {
                    self.bearing = Some(self.mount.bearing(now, f32::from(angle.azimuth_deg) * DEG_TO_RAD));
                    &mut self.counters.angles
                }
                Some(Ok(_)) => &mut self.counters.others,
                Some(Err(_)) => &mut self.counters.refused,
            };
            *count = count.saturating_add(1);
        }
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
        radio.push(Instant(1), &LINE[..20]);
        assert_eq!(radio.bearing(), None);
        radio.push(Instant(2), &LINE[20..]);
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
        radio.push(Instant(1), LINE);
        radio.push(Instant(1), b"+UUDF:6C1DEBA41846,-56,-999,20,0,39,\"\",\"\",1\r\n");
        radio.push(Instant(1), b"+STARTUP\r\nOK\r\n");
        assert_eq!(radio.bearing(), None);
        assert_eq!(radio.counters(), Counters { angles: 0, others: 1, refused: 1 });
    }
}
