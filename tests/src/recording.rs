//! Packets of a Bluetooth array that others recorded, for the tests that hear them or fly on them.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::io::Read as _;
use std::path::Path;

use crate::{npy, root};

/// One place of the recording.
#[derive(Clone, Debug, Default)]
pub struct Place {
    /// When each packet came; the runs of a place, each of which begins at zero, follow one another.
    pub times_s: Vec<f64>,
    /// Who sent it.
    pub beacons: Vec<i32>,
    /// Its samples.
    pub values: Vec<[f64; 2]>,
    /// Where it came from, radians, less the board's heading, which is not known.
    pub truth: Vec<f64>,
}

/// Slots of a packet, and samples of a slot.
const SLOTS: [usize; 2] = [37, 3];

impl Place {
    /// Writes the packets into a folder, and who sent each: `f.npy`, `e.npy`.
    pub fn write(&self, folder: &Path) {
        let ([slots, samples], packets) = (SLOTS, self.beacons.len());
        let parts = self.values.iter().flatten().map(|part| *part as f32);
        let values: Vec<u8> = parts.flat_map(f32::to_le_bytes).collect();
        let beacons: Vec<u8> = self.beacons.iter().flat_map(|beacon| beacon.to_le_bytes()).collect();
        let shape = format!("({packets}, {slots}, {samples})");
        std::fs::write(folder.join("f.npy"), npy("<c8", &shape, &values)).unwrap();
        std::fs::write(folder.join("e.npy"), npy("<i4", &format!("({packets},)"), &beacons)).unwrap();
    }
}

/// The description of the array of eight.
#[must_use]
pub fn array() -> String {
    let radius_m = 0.0456 / 2.0 / (PI / 8.0).sin();
    let at = |k: u32| (f64::from(k) * PI / 4.0).sin_cos();
    let antennas_m: Vec<[f64; 2]> = (0..8).map(at).map(|(s, c)| [radius_m * c, radius_m * s]).collect();
    format!(
        "wavelength_m = 0.12287\nantennas_m = {antennas_m:?}\nsample_rate_hz = 2e6\ntone_hz = 250e3\n[switch]\nslot_s = 4e-6\n\
         pattern = [1, 2, 3, 4, 5, 6, 7, 8]\n"
    )
}

/// The recorded places, if they lie beside the repository.
#[must_use]
pub fn places() -> Option<BTreeMap<String, Place>> {
    let packed = std::fs::File::open(root().join("../shared/data/radio/ble-cte-dev.tgz")).ok()?;
    let mut archive = Vec::new();
    flate2::read::GzDecoder::new(packed).read_to_end(&mut archive).unwrap();
    let mut places = BTreeMap::new();
    let mut rest = &archive[..];
    // A tar file: a header of 512 bytes with name and length, and the file filled up to 512 bytes.
    while let Some((header, behind)) = rest.split_at_checked(512).filter(|(header, _)| header[0] != 0) {
        let text = |range: std::ops::Range<usize>| {
            String::from_utf8_lossy(&header[range]).trim_matches(['\0', ' ']).to_owned()
        };
        let length = usize::from_str_radix(&text(124..136), 8).unwrap();
        if let Some(name) = text(0..100).strip_suffix(".csv") {
            places.insert(name.to_owned(), place(name, std::str::from_utf8(&behind[..length]).unwrap()));
        }
        rest = &behind[length.div_ceil(512) * 512..];
    }
    Some(places)
}

fn place(name: &str, table: &str) -> Place {
    let (_, at) = name.rsplit_once("_x").unwrap();
    let (x, y) = at.split_once('y').unwrap();
    let (x, y): (f64, f64) = (x.parse().unwrap(), y.parse().unwrap());
    let mut place = Place::default();
    let (mut begin_s, mut last_s) = (0.0, 0.0);
    for row in table.lines() {
        let numbers: Vec<f64> = row.split(',').map(|number| number.trim().parse().unwrap()).collect();
        let beacon = numbers[1] as i32;
        let (bx, by) = match beacon {
            2 => (0.0, 0.0),
            5 => (4.0, 0.0),
            4 => (0.0, 4.0),
            _ => (4.0, 4.0),
        };
        begin_s += if numbers[0] < last_s { last_s } else { 0.0 };
        last_s = numbers[0];
        place.times_s.push(begin_s + last_s);
        place.beacons.push(beacon);
        place.truth.push(f64::atan2(x - bx, by - y));
        for slot in numbers[2..].chunks_exact(3) {
            place.values.extend(unwrapped(slot).map(|units| [(units * PI / 201.0).cos(), (units * PI / 201.0).sin()]));
        }
    }
    place
}

/// The samples of a slot in pi / 201 rad: what was above 127 is 256 too low, and 45 deg a sample tell which.
fn unwrapped(slot: &[f64]) -> [f64; 3] {
    let candidates =
        |units: f64| if (-128.0..=-55.0).contains(&units) { vec![units, units + 256.0] } else { vec![units] };
    let off = |a: f64, b: f64| ((b - a - 50.25 + 201.0).rem_euclid(402.0) - 201.0).abs().min(64.0);
    let mut best = (f64::MAX, [0.0; 3]);
    for a in candidates(slot[0]) {
        for b in candidates(slot[1]) {
            for c in candidates(slot[2]) {
                let cost = off(a, b) + 0.5 * off(b, c);
                best = if cost < best.0 { (cost, [a, b, c]) } else { best };
            }
        }
    }
    best.1
}
