//! IQ reports of a Bluetooth controller on the sensor's line.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::{PI, TAU};

use foxhound_computer::iq::{ARRAY, Array, PACKETS_MAX, PAUSE_US, Reports};
use foxhound_computer::radio::{Counters, Radio};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::doa::radio::{Mount, Sends};
use foxhound_sim::tools::radio_array::RadioArray;
use foxhound_sim::world::iq::{report, synchronised};
use foxhound_tests::{root, run_json_lines};

const ADDRESS: u64 = 0x6C1D_EBA4_1845;
const OFFSET_HZ: f64 = 7e3;
/// That of `foxhound bearing`: 4 degrees.
const MOUNT: Mount =
    Mount { sends: Sends::IqReports, yaw_rad: 0.0, sigma_rad: foxhound_core::doa::switched::FLOOR_RAD, tag: 0 };

/// A board's line.
struct Line {
    radio: Radio,
    reports: Reports,
    now_us: u64,
}

impl Line {
    fn new(mount: Mount) -> Self {
        let mut reports = Reports::new();
        reports.begin(&mount).unwrap();
        Self { radio: Radio::new(mount), reports, now_us: 0 }
    }

    /// The bytes of a step after this time.
    fn step(&mut self, after_us: u64, bytes: &[u8]) -> Option<Bearing> {
        self.now_us += after_us;
        self.radio.push(Instant(self.now_us), bytes, &mut self.reports);
        let bearing = self.radio.bearing();
        self.radio.take();
        self.reports.end_step();
        bearing
    }
}

fn sent(azimuth_rad: f64) -> Vec<u8> {
    report(&ARRAY, 1, azimuth_rad, OFFSET_HZ)
}

/// The array that an image has is that of `tests/computer/ring.toml`.
#[test]
fn the_array_of_the_image_is_that_of_its_file() {
    let file = RadioArray::read(&root().join("tests/computer/ring.toml")).unwrap();
    assert_eq!(Some(ARRAY), file.switch.map(|switch| Array { beam: file.beam, switch }));
}

/// From the same bytes the computer gets the azimuths, sigmas and validities that `foxhound bearing --switched` prints.
#[test]
fn the_line_gives_the_bearings_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let (path, array) = (folder.path().join("line.h4"), root().join("tests/computer/ring.toml"));
    let mut packets: Vec<Vec<u8>> = (0..60).map(|k| sent(TAU * f64::from(k) / 60.0)).collect();
    // No tone at all.
    packets[20][16..].fill(1);
    std::fs::write(&path, packets.concat()).unwrap();
    let text = |path: &std::path::Path| path.to_string_lossy().into_owned();
    let printed = run_json_lines(&["bearing", "--switched", &text(&path), "--array", &text(&array), "--json"]);
    assert_eq!(printed.len(), packets.len());
    let mut line = Line::new(MOUNT);
    for (packet, printed) in packets.iter().zip(&printed) {
        let bearing = line.step(100_000, packet);
        assert_eq!(bearing.is_some(), printed["valid"] == true, "{printed}");
        let Some(bearing) = bearing else { continue };
        for (own, key) in [(bearing.azimuth_rad, "azimuth_deg"), (bearing.sigma_rad, "sigma_deg")] {
            let printed = printed[key].as_f64().unwrap();
            assert!((f64::from(own).to_degrees() - printed).abs() < 1e-4, "{key}: {own} rad, {printed} deg");
        }
    }
    assert_eq!(line.radio.counters(), Counters { angles: 59, unclear: 1, ..Counters::default() });
}

/// Bearings are turned by the mount, have the time of the last byte, and are of the wanted tag alone, whose address outlasts a new start.
#[test]
fn a_bearing_is_of_the_wanted_tag_and_turned_by_the_mount() {
    let mut line = Line::new(Mount { yaw_rad: 0.5, tag: 0xA4_1845, ..MOUNT });
    let packet = sent(1.0);
    assert_eq!(line.step(20_000, &packet), None, "nobody has said whose it is");
    assert_eq!(line.step(100_000, &synchronised(1, ADDRESS)), None);
    for _ in 0..2 {
        let bearing = line.step(100_000, &packet).unwrap();
        assert!((bearing.azimuth_rad - 1.5).abs() < 0.02 && bearing.time == Instant(line.now_us), "{bearing:?}");
        line.reports.begin(&MOUNT).unwrap();
    }
    line.step(100_000, &synchronised(1, ADDRESS + 1));
    assert_eq!(line.step(100_000, &packet), None);
    assert_eq!(line.radio.counters(), Counters { angles: 2, others: 2, ..Counters::default() });
}

/// In a step no more packets are worked out than there is time for.
#[test]
fn a_flood_of_reports_is_counted_and_not_worked_out() {
    let mut line = Line::new(MOUNT);
    assert!(line.step(20_000, &sent(0.3).repeat(9)).is_some());
    let most = u32::from(PACKETS_MAX);
    assert_eq!(line.radio.counters(), Counters { angles: most, unclear: 9 - most, ..Counters::default() });
    assert!(line.step(20_000, &sent(0.3)).is_some());
}

/// A packet with a byte lost or damaged gives no bearing or nearly the right one, and the one after a pause is heard.
#[test]
fn damaged_packets_give_no_wrong_bearing_and_the_next_one_is_heard() {
    let azimuth_rad = 0.7;
    let (good, mut line) = (sent(azimuth_rad), Line::new(MOUNT));
    assert!(line.step(100_000, &good).is_some());
    let is_near = |bearing: &Bearing| {
        let away_rad = (f64::from(bearing.azimuth_rad) - azimuth_rad + PI).rem_euclid(TAU) - PI;
        away_rad.abs() < 4.0 * f64::from(bearing.sigma_rad)
    };
    let (mut heard, mut tried) = (0, 0);
    for at in 0..good.len() {
        for damage in [None, Some(0xFF), Some(0x55), Some(0x01), Some(0x80)] {
            let mut bytes = good.clone();
            match damage {
                None => drop(bytes.remove(at)),
                Some(flip) => bytes[at] ^= flip,
            }
            let bearing = line.step(PAUSE_US + 1, &bytes);
            assert!(bearing.as_ref().is_none_or(is_near), "byte {at}, {damage:?}: {bearing:?}");
            heard += usize::from(bearing.is_some());
            tried += 1;
            let next = line.step(PAUSE_US + 1, &good);
            assert!(next.as_ref().is_some_and(is_near), "after byte {at}, {damage:?}: {next:?}");
        }
    }
    assert!(heard > tried / 2, "{heard} of {tried}");
}
