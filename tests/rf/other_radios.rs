//! `foxhound bearing` on what other receivers give: an array behind a switch, complex samples of several channels, and recordings
//! that were made by others.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

use foxhound_tests::recording::{self, Place, places};
use foxhound_tests::{json_lines, root, run, run_json_lines, text};
use serde_json::Value;

use crate::waves::{Random, degrees_between, quantile, rms};

/// Writes a NumPy file.
pub(crate) fn npy(path: &Path, descr: &str, shape: &[usize], bytes: &[u8]) {
    let shape: String = shape.iter().map(|n| format!("{n},")).collect();
    std::fs::write(path, foxhound_tests::npy(descr, &format!("({shape})"), bytes)).unwrap();
}

pub(crate) fn complex64(path: &Path, shape: &[usize], values: &[[f64; 2]]) {
    let parts = values.iter().flatten().map(|part| *part as f32);
    npy(path, "<c8", shape, &parts.flat_map(f32::to_le_bytes).collect::<Vec<_>>());
}

pub(crate) struct Files(tempfile::TempDir);

impl Files {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn text(&self, name: &str, text: &str) -> PathBuf {
        std::fs::write(self.path(name), text).unwrap();
        self.path(name)
    }

    pub(crate) fn bearing(&self, source: &str, file: &str, array: &str, more: &[&str]) -> std::process::Output {
        let (array, file) = (text(&self.text("array.toml", array)), text(&self.path(file)));
        run(&[&["bearing", source, &file, "--array", &array, "--json"], more].concat())
    }

    pub(crate) fn lines(&self, source: &str, file: &str, array: &str, more: &[&str]) -> Vec<Value> {
        let output = self.bearing(source, file, array, more);
        assert!(output.status.success(), "{}", foxhound_tests::errors(&output));
        json_lines(&output)
    }

    /// What is said of an input that is refused.
    pub(crate) fn refused(&self, source: &str, file: &str, array: &str, more: &[&str]) -> String {
        let output = self.bearing(source, file, array, more);
        assert_eq!(output.status.code(), Some(2), "{array} is taken");
        foxhound_tests::errors(&output)
    }
}

pub(crate) fn has(line: &Value, flag: &str) -> bool {
    line["flags"].as_array().unwrap().iter().any(|name| name == flag)
}

pub(crate) fn number(line: &Value, key: &str) -> f64 {
    line[key].as_f64().unwrap()
}

pub(crate) fn ring(antennas: usize, radius_m: f64) -> Vec<[f64; 2]> {
    let angle = |k: usize| k as f64 * TAU / antennas as f64;
    (0..antennas).map(|k| [radius_m * angle(k).cos(), radius_m * angle(k).sin()]).collect()
}

pub(crate) fn line(antennas: usize, apart_m: f64) -> Vec<[f64; 2]> {
    (0..antennas).map(|k| [0.0, apart_m * (k as f64 - 0.5 * (antennas as f64 - 1.0))]).collect()
}

/// A switched array and what is sent to it; wavelength 1 m, samples at 2 MHz.
struct Switched {
    antennas_m: Vec<[f64; 2]>,
    pattern: Vec<usize>,
    tone_hz: f64,
    offset_hz: f64,
    slot_s: f64,
    slots: usize,
    samples: usize,
    snr_db: f64,
}

impl Switched {
    fn of(antennas_m: Vec<[f64; 2]>) -> Self {
        let pattern = (1..=antennas_m.len()).collect();
        let (tone_hz, offset_hz, slot_s, snr_db) = (250e3, 12e3, 4e-6, 20.0);
        Self { antennas_m, pattern, tone_hz, offset_hz, slot_s, slots: 37, samples: 3, snr_db }
    }

    fn array(&self) -> String {
        format!(
            "wavelength_m = 1.0\nantennas_m = {:?}\nsample_rate_hz = 2e6\ntone_hz = {:?}\n[switch]\nslot_s = {:?}\npattern = {:?}\n",
            self.antennas_m, self.tone_hz, self.slot_s, self.pattern
        )
    }

    fn packet(&self, azimuth_rad: f64, amplitude: f64, random: &mut Random) -> Vec<[f64; 2]> {
        let begin_rad = random.uniform() * TAU;
        let noise = 10.0_f64.powf(-self.snr_db / 20.0) * 0.5_f64.sqrt();
        let mut packet = Vec::new();
        for slot in 0..self.slots {
            let antenna = self.pattern[slot % self.pattern.len()];
            for k in 0..self.samples {
                let time_s = slot as f64 * self.slot_s + k as f64 / 2e6;
                let [x, y] = if antenna > 0 { self.antennas_m[antenna - 1] } else { [9.0, 9.0] };
                let wave_rad = TAU * (x * azimuth_rad.cos() + y * azimuth_rad.sin());
                let phase = begin_rad + wave_rad + TAU * (self.tone_hz + self.offset_hz) * time_s;
                packet.push([
                    amplitude * phase.cos() + noise * random.normal(),
                    amplitude * phase.sin() + noise * random.normal(),
                ]);
            }
        }
        packet
    }

    fn lines(&self, azimuths: &[f64], amplitude: f64, more: &[&str]) -> Vec<Value> {
        let (files, mut random) = (Files::new(), Random::new(41));
        let values: Vec<_> = azimuths.iter().flat_map(|a| self.packet(*a, amplitude, &mut random)).collect();
        complex64(&files.path("f.npy"), &[azimuths.len(), self.slots, self.samples], &values);
        files.lines("--switched", "f.npy", &self.array(), more)
    }
}

pub(crate) fn all_round(count: usize) -> Vec<f64> {
    (0..count).map(|k| k as f64 * 2.4 - PI).collect()
}

/// Cramer-Rao bound of a Gaussian source, degrees.
pub(crate) fn bound_deg(antennas_m: &[[f64; 2]], azimuth: f64, snr_db: f64, samples: f64) -> f64 {
    let slopes: Vec<f64> = antennas_m.iter().map(|[x, y]| TAU * (y * azimuth.cos() - x * azimuth.sin())).collect();
    let antennas = antennas_m.len() as f64;
    let mean = slopes.iter().sum::<f64>() / antennas;
    let sharpness: f64 = slopes.iter().map(|slope| (slope - mean).powi(2)).sum();
    let ratio = 10.0_f64.powf(-snr_db / 10.0);
    (ratio / (2.0 * samples) * (1.0 + ratio / antennas) / sharpness).sqrt().to_degrees()
}

/// Errors of the valid lines, in degrees; on a line of antennas, of the nearer of the answer and its mirror.
pub(crate) fn errors(lines: &[Value], azimuths: &[f64]) -> Vec<f64> {
    let valid = lines.iter().filter(|line| line["valid"] == true);
    valid
        .map(|line| {
            let truth = azimuths[line["frame"].as_u64().unwrap() as usize];
            let off = |key: &str| {
                line[key].as_f64().map_or(f64::MAX, |degrees| degrees_between(degrees.to_radians(), truth).abs())
            };
            off("azimuth_deg").min(off("mirror_deg"))
        })
        .collect()
}

/// A switched array of 2 to 8 antennas, of any shape, pattern, slot and tone, gives bearings within its sigma; a line tells its
/// mirror answer; silence and damage give none.
#[test]
fn any_switched_array_gives_bearings_and_silence_none() {
    let square = vec![[0.2, 0.2], [0.2, -0.2], [-0.2, -0.2], [-0.2, 0.2]];
    let mut arrays: Vec<Switched> = (3..=8).map(|n| Switched::of(ring(n, 0.08 * n as f64))).collect();
    arrays.push(Switched { pattern: vec![1, 2, 1, 3, 1, 4], ..Switched::of(square.clone()) });
    arrays.push(Switched { pattern: vec![1, 0, 2, 0, 3, 0, 4, 0], slots: 60, ..Switched::of(square.clone()) });
    arrays.push(Switched { pattern: vec![1, 2, 3, 4, 4, 3, 2, 1], offset_hz: -35e3, ..Switched::of(square.clone()) });
    arrays.push(Switched { slot_s: 2e-6, slots: 74, tone_hz: -1e5, ..Switched::of(square.clone()) });
    arrays.push(Switched { slots: 16, samples: 1, ..Switched::of(ring(8, 0.5)) });
    for array in &arrays {
        let azimuths = all_round(150);
        let lines = array.lines(&azimuths, 1.0, &[]);
        let off = errors(&lines, &azimuths);
        assert!(off.len() >= 143, "{}: {} of 150 valid", array.array(), off.len());
        assert!(quantile(&off, 0.5) < 0.7 && quantile(&off, 0.9) < 2.0, "{}", array.array());
        let frequency_hz = number(&lines[149], "freq_hz");
        assert!((frequency_hz - array.tone_hz - array.offset_hz).abs() < 500.0, "{frequency_hz}");
        assert!(lines.iter().all(|line| line["emitter"] == 0 && line["elevation_deg"].is_null()));
    }
    for antennas in [3, 4, 6] {
        let array = Switched::of(line(antennas, 0.45));
        let azimuths = all_round(150);
        let lines = array.lines(&azimuths, 1.0, &[]);
        let off = errors(&lines, &azimuths);
        assert!(off.len() >= 130 && quantile(&off, 0.9) < 2.0, "{antennas} on a line: {} valid", off.len());
        let is_told = |line: &Value| line["mirror_deg"].is_number() && has(line, "ambiguous");
        assert!(lines.iter().filter(|line| line["valid"] == true).all(is_told), "{antennas} on a line");
    }
    // Two wavelengths across four antennas: where directions fit as well they are counted, and the bearing is not valid.
    let (wide, azimuths) = (Switched::of(ring(4, 1.0)), all_round(100));
    let lines = wide.lines(&azimuths, 1.0, &[]);
    assert!(quantile(&errors(&lines, &azimuths), 0.98) < 1.0);
    let ambiguous = lines.iter().filter(|line| line["valid"] == false && has(line, "ambiguous"));
    assert!(ambiguous.clone().count() >= 25);
    assert!(ambiguous.filter(|line| line["ambiguities"].as_u64().unwrap() > 0).count() >= 20);

    let silence = Switched::of(square.clone()).lines(&all_round(300), 0.0, &[]);
    assert!(silence.iter().all(|line| line["valid"] == false && has(line, "no_signal")));
    let (files, mut random) = (Files::new(), Random::new(3));
    let array = Switched::of(square);
    let mut values: Vec<_> = (0..3).flat_map(|_| array.packet(1.0, 1.0, &mut random)).collect();
    values[37 * 3 + 5] = [f64::NAN, 0.0];
    complex64(&files.path("f.npy"), &[3, 37, 3], &values);
    let lines = files.lines("--switched", "f.npy", &array.array(), &[]);
    assert!(has(&lines[1], "not_finite") && lines[1]["azimuth_deg"].is_null() && lines[0]["valid"] == true);
}

/// Offsets are tracked for each transmitter, and packets are joined by transmitter; the noise shrinks with their number, the floor
/// does not.
#[test]
fn packets_are_joined_by_transmitter() {
    let (files, mut random) = (Files::new(), Random::new(7));
    let near = Switched { snr_db: 6.0, ..Switched::of(ring(8, 0.5)) };
    let far = Switched { offset_hz: -30e3, ..Switched::of(ring(8, 0.5)) };
    let mut values = Vec::new();
    let mut emitters = Vec::new();
    for k in 0..64 {
        let (array, azimuth, number) = if k % 2 == 0 { (&near, 1.0, 7_i32) } else { (&far, -2.0, -3) };
        values.extend(array.packet(azimuth, 1.0, &mut random));
        emitters.extend(number.to_le_bytes());
    }
    complex64(&files.path("f.npy"), &[64, 37, 3], &values);
    npy(&files.path("e.npy"), "<i4", &[64], &emitters);
    let e = files.path("e.npy");
    let lines = files.lines("--switched", "f.npy", &near.array(), &["--emitter", e.to_str().unwrap(), "--looks", "8"]);
    assert_eq!(lines.len(), 8);
    for line in &lines {
        let (azimuth, frame) = if line["emitter"] == 7 { (1.0, 14) } else { (-2.0, 15) };
        assert_eq!(line["frame"].as_u64().unwrap() % 16, frame);
        assert!(line["valid"] == true, "{line}");
        assert!(degrees_between(number(line, "azimuth_deg").to_radians(), azimuth).abs() < 1.5, "{line}");
        assert!((4.0..4.5).contains(&number(line, "sigma_deg")), "{line}");
    }
    let key = near.array().replace("[switch]", "sigma_floor_deg = 0.0\n[switch]");
    let alone = files.lines("--switched", "f.npy", &key, &["--emitter", e.to_str().unwrap()]);
    let joined = files.lines("--switched", "f.npy", &key, &["--emitter", e.to_str().unwrap(), "--looks", "8"]);
    assert!(number(&joined[7], "sigma_deg") < number(&alone[63], "sigma_deg") + 0.1);
}

/// A switched recording or its array file that is wrong is refused by key, with the value and the range.
#[test]
fn a_wrong_switched_recording_is_refused_by_key() {
    let files = Files::new();
    let array = Switched::of(ring(4, 0.25));
    let good = array.array();
    let packet = array.packet(0.0, 1.0, &mut Random::new(1));
    complex64(&files.path("f.npy"), &[1, 37, 3], &packet);
    complex64(&files.path("flat.npy"), &[37, 3], &packet);
    complex64(&files.path("short.npy"), &[37, 3, 1], &packet);
    complex64(&files.path("none.npy"), &[0, 37, 3], &[]);
    npy(&files.path("real.npy"), "<f4", &[1, 37, 6], &vec![0; 888]);
    npy(&files.path("e.npy"), "<i4", &[2], &[0; 8]);
    npy(&files.path("wide_e.npy"), "<i8", &[1], &[0; 8]);
    let refused = |file: &str, text: &str| files.refused("--switched", file, text, &[]);
    assert!(refused("flat.npy", &good).contains("(packets, slots, samples of a slot)"));
    assert!(refused("short.npy", &good).contains("switch.pattern = 4: this antenna has no slot in a packet"));
    assert!(refused("none.npy", &good).contains("no packets"));
    assert!(refused("real.npy", &good).contains("expected complex64"));
    for (emitter, text) in [("e.npy", "one number a packet, (1,)"), ("wide_e.npy", "expected int32")] {
        let path = files.path(emitter);
        assert!(files.refused("--switched", "f.npy", &good, &["--emitter", path.to_str().unwrap()]).contains(text));
    }
    let changed = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        refused("f.npy", &good.replace(from, to))
    };
    assert!(
        changed("pattern = [1, 2, 3, 4]", "pattern = [1, 2, 3, 5]").contains("switch.pattern[3] = 5 is outside 0..=4")
    );
    assert!(changed("pattern = [1, 2, 3, 4]", "pattern = [1, 2, 3]").contains("switch.pattern = 4"));
    assert!(changed("pattern = [1, 2, 3, 4]", "pattern = []").contains("switch.pattern: 0 slots is outside 1..=160"));
    assert!(changed("pattern = [1, 2, 3, 4]", "patern = [1]").contains("pattern"));
    assert!(changed("slot_s = 4e-6", "slot_s = 0.0").contains("switch.slot_s = 0 is outside"));
    assert!(changed("slot_s = 4e-6", "slot_s = 5e-7").contains("switch.slot_s"));
    assert!(changed("tone_hz = 250000.0", "tone_hz = 2e6").contains("tone_hz = 2000000 is outside"));
    assert!(changed("tone_hz = 250000.0\n", "").contains("tone_hz: missing"));
    assert!(changed("sample_rate_hz = 2e6", "sample_rate_hz = nan").contains("sample_rate_hz = NaN is outside"));
    assert!(changed("wavelength_m = 1.0", "wavelength_m = -1.0").contains("wavelength_m = -1 is outside"));
    assert!(changed("wavelength_m = 1.0", "wavelength_m = 0.05").contains("antennas_m"));
    let nine = Switched::of(ring(9, 0.5)).array();
    assert!(refused("f.npy", &nine).contains("antennas_m: 9 antennas is outside 2..=8"));
    let twice = Switched::of(vec![[0.0, 0.0], [0.0, 0.0]]).array();
    assert!(refused("f.npy", &twice).contains("antennas_m = 0: antennas closer than"));
    let plain = good.split("[switch]").next().unwrap();
    assert!(refused("f.npy", plain).contains("switch: missing"));
}

/// Complex samples of 2 to 8 channels give bearings at the Cramer-Rao bound of a Gaussian source, with their own sigma, from 0 to
/// 30 dB; noise gives none, two emitters in one band are flagged, and what is outside of the band given is not heard.
#[test]
fn complex_samples_of_two_to_eight_channels_are_at_the_bound() {
    const N: usize = 256;
    let files = Files::new();
    let mut random = Random::new(23);
    let mut frames = |antennas_m: &[[f64; 2]], azimuths: &[f64], snr_db: f64, other: f64, outside: f64| {
        let noise = 10.0_f64.powf(-snr_db / 20.0);
        let mut values = Vec::new();
        for azimuth in azimuths {
            let waves: Vec<[f64; 4]> = (0..N)
                .map(|_| [random.normal(), random.normal(), other * random.normal(), other * random.normal()])
                .collect();
            for [x, y] in antennas_m {
                let at = |azimuth: f64| TAU * (x * azimuth.cos() + y * azimuth.sin());
                let (here, there) = (at(*azimuth).sin_cos(), at(azimuth + 2.0).sin_cos());
                for (k, [a, b, c, d]) in waves.iter().enumerate() {
                    let far = at(azimuth - 1.5) + TAU * 0.4 * k as f64;
                    let part = |re: f64, im: f64, (s, c): (f64, f64)| [re * c - im * s, re * s + im * c];
                    let (one, two) = (part(*a, *b, here), part(*c, *d, there));
                    values.push([
                        one[0] + two[0] + outside * far.cos() + noise * random.normal(),
                        one[1] + two[1] + outside * far.sin() + noise * random.normal(),
                    ]);
                }
            }
        }
        complex64(&files.path("f.npy"), &[azimuths.len(), antennas_m.len(), N], &values);
    };
    let array =
        |antennas_m: &[[f64; 2]]| format!("wavelength_m = 1.0\nantennas_m = {antennas_m:?}\nsample_rate_hz = 1e6\n");
    for antennas in 2..=8 {
        for snr_db in [0.0, 10.0, 30.0] {
            // Two antennas look across their line, where they see.
            let antennas_m = if antennas == 2 { line(2, 0.45) } else { ring(antennas, 0.08 * antennas as f64) };
            let azimuths: Vec<f64> =
                (0..600).map(|k| if antennas == 2 { 0.002 * f64::from(k) - 0.6 } else { f64::from(k) }).collect();
            frames(&antennas_m, &azimuths, snr_db, 0.0, 0.0);
            let lines = files.lines("--iq", "f.npy", &array(&antennas_m), &[]);
            let off = errors(&lines, &azimuths);
            assert_eq!(off.len(), 600, "{antennas} channels, {snr_db} dB");
            let bound = |azimuth: &f64| bound_deg(&antennas_m, *azimuth, snr_db, N as f64);
            let over: Vec<f64> = off.iter().zip(&azimuths).map(|(off, azimuth)| off / bound(azimuth)).collect();
            assert!(rms(&over) <= 1.15, "{antennas} channels, {snr_db} dB: {} of the bound", rms(&over));
            let own: Vec<f64> = off.iter().zip(&lines).map(|(off, line)| off / number(line, "sigma_deg")).collect();
            assert!(
                (0.8..1.25).contains(&rms(&own).powi(2)),
                "{antennas} channels, {snr_db} dB: NEES {}",
                rms(&own).powi(2)
            );
        }
    }
    let (five, azimuths) = (ring(5, 0.4), all_round(200));
    let flagged =
        |lines: &[Value]| lines.iter().filter(|line| has(line, "interferer") || has(line, "multipath")).count();
    frames(&five, &azimuths, 10.0, 0.0, 0.0);
    assert!(flagged(&files.lines("--iq", "f.npy", &array(&five), &[])) <= 4);
    frames(&five, &azimuths, 10.0, 0.5, 0.0);
    assert!(flagged(&files.lines("--iq", "f.npy", &array(&five), &[])) >= 196);
    frames(&five, &azimuths, 10.0, 0.0, 20.0);
    let banded = format!("{}tone_band_hz = [-2e5, 2e5]\n", array(&five));
    let lines = files.lines("--iq", "f.npy", &banded, &[]);
    assert!(quantile(&errors(&lines, &azimuths), 0.9) < 2.0, "a tone outside of the band is heard");
    let few = "tone_band_hz = [1.0, 2.0]\n";
    assert!(
        files
            .refused("--iq", "f.npy", &format!("{}{few}", array(&five)), &[])
            .contains("tone_band_hz = [1, 2] holds no bin")
    );
    assert!(files.refused("--iq", "f.npy", &array(&ring(4, 0.25)), &[]).contains("channels = 5: antennas_m has 4"));
}

/// Without a band, noise of a receiver whose filter makes 16 samples alike is no source, and neither is the receiver's own offset, in a
/// band or without one; a source is heard beside both.
#[test]
fn coloured_noise_and_an_offset_at_zero_are_no_source() {
    const N: usize = 1024;
    let files = Files::new();
    let (five, count, mut random) = (ring(5, 0.4), 60, Random::new(8));
    let mut record = |snr_db: Option<f64>, alike: usize, offset: f64| {
        let source = snr_db.map_or(0.0, |snr_db| 10.0_f64.powf(snr_db / 20.0));
        let mut values = Vec::new();
        for _ in 0..count {
            for (channel, [x, y]) in five.iter().enumerate() {
                let white: Vec<[f64; 2]> = (0..N + 15).map(|_| [random.normal(), random.normal()]).collect();
                let phase = TAU * (x * 1.1_f64.cos() + y * 1.1_f64.sin());
                let (sine, cosine) = (0.7 * channel as f64).sin_cos();
                for k in 0..N {
                    let share = (alike as f64).sqrt().recip();
                    let sum = white[k..k + alike].iter().fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
                    let [re, im] = sum.map(|part| share * part);
                    let (s, c) = (phase + TAU * 0.13 * k as f64).sin_cos();
                    values.push([re + source * c + offset * cosine, im + source * s + offset * sine]);
                }
            }
        }
        complex64(&files.path("f.npy"), &[count, 5, N], &values);
    };
    let plain = format!("wavelength_m = 1.0\nantennas_m = {five:?}\nsample_rate_hz = 1e6\n");
    let banded = format!("{plain}tone_band_hz = [-1.5e5, 1.5e5]\n");
    let valid = |array: &str| {
        let lines = files.lines("--iq", "f.npy", array, &[]);
        lines.into_iter().filter(|line| line["valid"] == true).collect::<Vec<_>>()
    };
    for (alike, offset, array) in [(16, 0.0, &plain), (16, 1.0, &plain), (1, 1.0, &plain), (1, 1.0, &banded)] {
        record(None, alike, offset);
        let heard = valid(array).len();
        assert!(heard <= 1, "{alike} alike, offset {offset}: {heard} of {count} frames are valid");
    }
    for (alike, array) in [(16, &plain), (1, &plain), (1, &banded)] {
        record(Some(10.0), alike, 1.0);
        let lines = valid(array);
        assert!(lines.len() >= 58, "{alike} alike: {} of {count} are valid", lines.len());
        for line in lines {
            let off_deg = degrees_between(number(&line, "azimuth_deg").to_radians(), 1.1);
            assert!(off_deg.abs() < 4.0 * number(&line, "sigma_deg").max(1.0), "{line}");
        }
    }
}

/// Of a recording at eleven places, with the given slots of each packet: errors less each place's mean, those errors over their sigma,
/// the share of answers, and the share of these that are flagged.
fn judge(places: &BTreeMap<String, Place>, array: &str, looks: usize) -> (Vec<f64>, Vec<f64>, f64, f64) {
    let (mut all, mut over, mut lines_made, mut flagged) = (Vec::new(), Vec::new(), 0, 0);
    for place in places.values() {
        let files = Files::new();
        place.write(&files.path("."));
        let (e, looks) = (text(&files.path("e.npy")), looks.to_string());
        let lines = files.lines("--switched", "f.npy", array, &["--emitter", &e, "--looks", &looks]);
        lines_made += lines.len();
        let valid: Vec<&Value> = lines.iter().filter(|line| line["valid"] == true).collect();
        flagged += valid.iter().filter(|line| has(line, "multipath")).count();
        let off: Vec<f64> = valid
            .iter()
            .map(|line| {
                number(line, "azimuth_deg").to_radians() - place.truth[line["frame"].as_u64().unwrap() as usize]
            })
            .collect();
        let heading = f64::atan2(off.iter().map(|off| off.sin()).sum(), off.iter().map(|off| off.cos()).sum());
        for (off, line) in off.iter().zip(valid) {
            let error = degrees_between(*off, heading).abs();
            all.push(error);
            over.push(error / number(line, "sigma_deg"));
        }
    }
    let answered = all.len() as f64 / lines_made as f64;
    let flagged = flagged as f64 / all.len() as f64;
    (all, over, answered, flagged)
}

/// 6 600 recorded Bluetooth packets of a ring of eight at eleven places: the bearings' errors, sigma and flags are what
/// `docs/results/radios.md` says. The recording lies beside the repository, where it lies at all.
#[test]
fn a_recorded_ring_of_eight_gives_the_bearings_of_the_table() {
    let Some(places) = places() else {
        eprintln!("SKIPPED: there is no ../shared/data/radio: recorded packets are not heard");
        return;
    };
    assert_eq!(places.len(), 11);
    println!("| antennas | packets | median | 90 % | answered | within 1, 2, 3 sigma | flagged |");
    // Median, 90 %, answered, within three sigma, flagged.
    for (looks, [median, ninety, answered, within, flagged]) in
        [(1, [3.4, 7.8, 0.78, 0.98, 0.25]), (8, [3.2, 7.4, 0.78, 0.98, 0.25]), (24, [3.2, 7.4, 0.78, 0.98, 0.25])]
    {
        let (errors, over, share, marked) = judge(&places, &recording::array(), looks);
        let inside = |sigmas: f64| over.iter().filter(|over| **over < sigmas).count() as f64 / over.len() as f64;
        let (half, most) = (quantile(&errors, 0.5), quantile(&errors, 0.9));
        println!(
            "| 8 | {looks} | {half:.2} | {most:.2} | {:.1} % | {:.1}, {:.1}, {:.1} % | {:.1} % |",
            100.0 * share,
            100.0 * inside(1.0),
            100.0 * inside(2.0),
            100.0 * inside(3.0),
            100.0 * marked
        );
        assert!(half <= median && most <= ninety, "{looks} packets: {half} and {most} deg");
        assert!(share >= answered && inside(3.0) >= within && marked <= flagged, "{looks} packets");
    }
}

/// Four microphones on a real quadrotor: a tone is heard within 2 deg with the propellers running, calibrated without; the propellers alone
/// make no bearing. The recording lies beside the repository, where it lies at all.
#[test]
fn a_recorded_quadrotors_propellers_make_no_bearing() {
    let folder = root().join("../shared/data/radio/quadrotor");
    let Ok(array) = std::fs::read_to_string(folder.join("array.toml")) else {
        eprintln!("SKIPPED: there is no {}: recorded propellers are not heard", folder.display());
        return;
    };
    let files = Files::new();
    let recorded = |name: &str| text(&folder.join(name));
    for band in ["", "tone_band_hz = [150.0, 250.0]\n"] {
        let path = text(&files.text("a.toml", &format!("{array}\n{band}")));
        let calibrated = run(&["calibrate", "--adc", &recorded("alone.npy"), "--array", &path, "--azimuth-deg", "0"]);
        assert!(calibrated.status.success(), "{}", foxhound_tests::errors(&calibrated));
        let lines = |name: &str| run_json_lines(&["bearing", "--adc", &recorded(name), "--array", &path, "--json"]);
        for name in ["alone.npy", "props_0.npy"] {
            let azimuths: Vec<f64> = lines(name).iter().map(|line| number(line, "azimuth_deg")).collect();
            assert!(azimuths.len() == 12 && rms(&azimuths) < 2.0, "{name}: {azimuths:?}");
        }
        // Uncalibrated or not: none.
        let alone = lines("props_only.npy");
        assert!(alone.iter().filter(|line| !line["azimuth_deg"].is_null()).count() <= 1, "{alone:?}");
    }
}
