//! Recordings of other radios in every format that `foxhound bearing` reads, valid and damaged.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::TAU;
use std::path::Path;
use std::sync::mpsc::RecvTimeoutError;

use foxhound_sim::tools::iq::{self, Frames};
use foxhound_sim::tools::radio_array::RadioArray;
use foxhound_sim::tools::switched::{self, Packets};
use foxhound_tests::{assert_refused, refused, run_json, text};
use serde_json::Value;

use crate::other_radios::{Files, has, npy, number, ring};
use crate::waves::{Random, degrees_between};

const AZIMUTH: f64 = 0.7;

/// Samples of a noise-like source at three antennas, I and Q of each in turn.
fn samples(count: usize) -> Vec<f64> {
    let mut random = Random::new(5);
    let mut samples = Vec::new();
    for _ in 0..count {
        let (re, im) = (0.2 * random.normal(), 0.2 * random.normal());
        for [x, y] in ring(3, 0.25) {
            let (s, c) = (TAU * (x * AZIMUTH.cos() + y * AZIMUTH.sin())).sin_cos();
            samples.extend([re * c - im * s + 0.02 * random.normal(), re * s + im * c + 0.02 * random.normal()]);
        }
    }
    samples
}

/// A tone with noise at three antennas as a converter takes it: real samples.
fn real_samples(count: usize) -> Vec<f64> {
    let mut random = Random::new(6);
    let mut samples = Vec::new();
    for k in 0..count {
        for [x, y] in ring(3, 0.25) {
            let phase = TAU * (x * AZIMUTH.cos() + y * AZIMUTH.sin()) + TAU * 0.11 * k as f64;
            samples.push(0.5 * phase.cos() + 0.02 * random.normal());
        }
    }
    samples
}

/// A WAV file as the format's description has it.
fn wav(path: &Path, channels: u16, rate: u32, bits: u16, is_float: bool, samples: &[f64]) {
    let data: Vec<u8> = samples
        .iter()
        .flat_map(|x| match (bits, is_float) {
            (32, true) => (*x as f32).to_le_bytes().to_vec(),
            (16, _) => ((x * 32_767.0) as i16).to_le_bytes().to_vec(),
            (24, _) => ((x * 8_388_607.0) as i32).to_le_bytes()[..3].to_vec(),
            _ => vec![(x * 127.0 + 128.0) as u8],
        })
        .collect();
    let block = channels * bits / 8;
    let mut file = b"RIFF".to_vec();
    file.extend((36 + data.len() as u32).to_le_bytes());
    file.extend(b"WAVEfmt ");
    file.extend(16_u32.to_le_bytes());
    file.extend((if is_float { 3_u16 } else { 1 }).to_le_bytes());
    file.extend(channels.to_le_bytes());
    file.extend(rate.to_le_bytes());
    file.extend((rate * u32::from(block)).to_le_bytes());
    file.extend(block.to_le_bytes());
    file.extend(bits.to_le_bytes());
    file.extend(b"data");
    file.extend((data.len() as u32).to_le_bytes());
    file.extend(data);
    std::fs::write(path, file).unwrap();
}

fn array() -> String {
    format!("wavelength_m = 1.0\nantennas_m = {:?}\nsample_rate_hz = 48e3\n", ring(3, 0.25))
}

fn is_right(line: &Value) -> bool {
    line["valid"] == true && degrees_between(number(line, "azimuth_deg").to_radians(), AZIMUTH).abs() < 1.5
}

/// Integer `.npy` and WAV files of real samples or I and Q give the right bearing and a description of what was read; files that do not fit the
/// array are refused by field.
#[test]
fn whole_numbers_and_wav_files_give_their_bearing() {
    let files = Files::new();
    let (iq, real) = (samples(2048), real_samples(2048));
    // (frames, channels, N, 2) of the same samples.
    let framed: Vec<f64> = (0..2)
        .flat_map(|frame| {
            (0..3)
                .flat_map(move |channel| (0..1024).flat_map(move |k| [(frame, channel, k, 0), (frame, channel, k, 1)]))
        })
        .map(|(frame, channel, k, part)| iq[(frame * 1024 + k) * 6 + channel * 2 + part])
        .collect();
    npy(
        &files.path("i16.npy"),
        "<i2",
        &[2, 3, 1024, 2],
        &framed.iter().flat_map(|x| ((x * 32_768.0) as i16).to_le_bytes()).collect::<Vec<_>>(),
    );
    npy(
        &files.path("i8.npy"),
        "|i1",
        &[2, 3, 1024, 2],
        &framed.iter().map(|x| (x * 128.0).round() as i8 as u8).collect::<Vec<_>>(),
    );
    wav(&files.path("iq16.wav"), 6, 48_000, 16, false, &iq);
    wav(&files.path("iq8.wav"), 6, 48_000, 8, false, &iq);
    wav(&files.path("iq24.wav"), 6, 48_000, 24, false, &iq);
    wav(&files.path("iqf.wav"), 6, 48_000, 32, true, &iq);
    wav(&files.path("real16.wav"), 3, 48_000, 16, false, &real);
    wav(&files.path("realf.wav"), 3, 48_000, 32, true, &real);
    for (name, said) in [
        ("i16.npy", "2 frames of 3 channels of 1024 samples, int16, I and Q"),
        ("i8.npy", "int8, I and Q"),
        ("iq16.wav", "WAV int16, I and Q"),
        ("iq8.wav", "WAV int8, I and Q"),
        ("iq24.wav", "WAV int24, I and Q"),
        ("iqf.wav", "WAV float32, I and Q"),
        ("real16.wav", "WAV int16, real samples"),
        ("realf.wav", "WAV float32, real samples"),
    ] {
        let output = files.bearing("--iq", name, &array(), &[]);
        let note = String::from_utf8(output.stderr).unwrap();
        assert!(note.contains(said), "{name}: {note}");
        let lines = files.lines("--iq", name, &array(), &[]);
        assert!(lines.len() == 2 && lines.iter().all(is_right), "{name}: {lines:?}");
    }
    let band = format!("{}tone_band_hz = [5e3, 5.6e3]\n", array());
    assert!(files.lines("--iq", "real16.wav", &band, &[]).iter().all(is_right));
    // The tone is outside: not a bearing.
    let other = format!("{}tone_band_hz = [8e3, 9e3]\n", array());
    assert!(files.lines("--iq", "real16.wav", &other, &[]).iter().all(|line| line["valid"] == false));
    let refused = |name: &str, array: &str| files.refused("--iq", name, array, &[]);
    let below = format!("{}tone_band_hz = [-1e3, 1e3]\n", array());
    assert!(refused("real16.wav", &below).contains("tone_band_hz = [-1000, 1000]"));
    let slower = array().replace("48e3", "44.1e3");
    assert!(refused("iq16.wav", &slower).contains("sample_rate = 48000: the array file has sample_rate_hz = 44100"));
    wav(&files.path("two.wav"), 2, 48_000, 16, false, &iq);
    assert!(refused("two.wav", &array()).contains("channels = 2: antennas_m has 3"));
    wav(&files.path("empty.wav"), 6, 48_000, 16, false, &[]);
    assert!(refused("empty.wav", &array()).contains("no samples"));
    npy(&files.path("flat.npy"), "<i2", &[3, 1024, 2], &vec![0; 3 * 1024 * 4]);
    assert!(refused("flat.npy", &array()).contains("expected (frames, channels, N, 2)"));
    std::fs::write(files.path("no.wav"), b"RIFX").unwrap();
    assert!(refused("no.wav", &array()).contains("not a WAV file"));
}

/// SigMF recordings of every format that is read give the same bearing; damaged ones are refused by key.
#[test]
fn sigmf_recordings_are_read_and_damaged_ones_refused() {
    let files = Files::new();
    let array = format!("wavelength_m = 1.0\nantennas_m = {:?}\nsample_rate_hz = 1e6\n", ring(3, 0.25));
    let meta = |datatype: &str, channels: usize, rate: &str| {
        format!(
            "{{\"global\": {{\"core:datatype\": \"{datatype}\", \"core:version\": \"1.0.0\", \"core:num_channels\": {channels}, \
             \"core:sample_rate\": {rate}}}, \"captures\": [{{\"core:sample_start\": 0}}], \"annotations\": []}}"
        )
    };
    let samples = samples(2048);
    type Encode = fn(f64) -> Vec<u8>;
    let formats: [(&str, Encode); 4] = [
        ("cf32_le", |x| (x as f32).to_le_bytes().to_vec()),
        ("ci16_le", |x| ((x * 32_768.0) as i16).to_le_bytes().to_vec()),
        ("ci8", |x| ((x * 128.0).round() as i8).to_le_bytes().to_vec()),
        ("cu8", |x| vec![(x * 127.5 + 127.5).round() as u8]),
    ];
    for (datatype, encode) in formats {
        files.text("f.sigmf-meta", &meta(datatype, 3, "1e6"));
        let bytes: Vec<u8> = samples.iter().flat_map(|x| encode(*x)).collect();
        std::fs::write(files.path("f.sigmf-data"), &bytes).unwrap();
        let lines = files.lines("--iq", "f.sigmf-meta", &array, &[]);
        assert_eq!(lines.len(), 2);
        for line in &lines {
            assert!(line["valid"] == true, "{datatype}: {line}");
            assert!(
                degrees_between(number(line, "azimuth_deg").to_radians(), AZIMUTH).abs() < 1.0,
                "{datatype}: {line}"
            );
        }
        std::fs::write(files.path("f.sigmf-data"), &bytes[..bytes.len() - 1]).unwrap();
        assert!(files.refused("--iq", "f.sigmf-meta", &array, &[]).contains("truncated"), "{datatype}");
    }
    for (text, key) in [
        (meta("rf64_le", 3, "1e6"), "core:datatype"),
        (meta("ci8", 1, "1e6"), "core:num_channels"),
        (meta("ci8", 3, "2e6"), "core:sample_rate"),
        ("{}".to_owned(), "global"),
        ("{".to_owned(), "f.sigmf-meta"),
    ] {
        files.text("f.sigmf-meta", &text);
        assert!(files.refused("--iq", "f.sigmf-meta", &array, &[]).contains(key), "{text}");
    }
}

/// A ring of eight behind a switch, as Bluetooth reports it.
struct Reports {
    offset_hz: f64,
    random: Random,
}

impl Reports {
    fn array() -> String {
        format!(
            "wavelength_m = 1.0\nantennas_m = {:?}\nsample_rate_hz = 1e6\ntone_hz = 250e3\n[switch]\nslot_s = 4e-6\npattern = {:?}\n",
            ring(8, 0.5),
            [2, 3, 4, 5, 6, 7, 8, 1]
        )
    }

    /// The event of a connectionless report of a whole extension.
    fn event(&mut self, handle: u16, azimuth: f64, amplitude: f64) -> Vec<u8> {
        let begin = self.random.uniform() * TAU;
        let antennas_m = ring(8, 0.5);
        let mut parameters = vec![0x15];
        parameters.extend(handle.to_le_bytes());
        parameters.extend([17, 0x18, 0xFD, 0, 0, 2, 0, 1, 0, 45]);
        // The reference is heard by the first antenna, from 4 us on; slots begin at 14 us and are 4 us apart.
        let reference = (0..8).map(|k| (0, 4.5e-6 + 1e-6 * f64::from(k)));
        let slots = (0..37).map(|s| ((s + 1) % 8, 15e-6 + 4e-6 * s as f64));
        for (antenna, time_s) in reference.chain(slots) {
            let [x, y] = antennas_m[antenna];
            let phase = begin + TAU * (x * azimuth.cos() + y * azimuth.sin()) + TAU * (250e3 + self.offset_hz) * time_s;
            let mut part = |value: f64| {
                ((amplitude * value + 5.0 * self.random.normal()).clamp(-127.0, 127.0) as i8).cast_unsigned()
            };
            parameters.extend([part(phase.cos()), part(phase.sin())]);
        }
        let mut event = vec![0x3E, parameters.len() as u8];
        event.extend(parameters);
        event
    }

    /// The same of a connection: with the radio mode and the channel before the strength.
    fn connection(&mut self, handle: u16, azimuth: f64, amplitude: f64) -> Vec<u8> {
        let mut event = self.event(handle, azimuth, amplitude);
        event[2] = 0x16;
        event.insert(5, 1);
        event[1] += 1;
        event
    }
}

fn text_of(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn h4(events: &[Vec<u8>]) -> Vec<u8> {
    events.iter().flat_map(|event| [&[4], &event[..]].concat()).collect()
}

/// As btsnoop's description has it; a command of no interest comes first.
fn btsnoop(kind: u32, events: &[Vec<u8>]) -> Vec<u8> {
    let mut file = b"btsnoop\0".to_vec();
    file.extend(1_u32.to_be_bytes());
    file.extend(kind.to_be_bytes());
    let mut record = |flags: u32, packet: &[u8]| {
        file.extend((packet.len() as u32).to_be_bytes());
        file.extend((packet.len() as u32).to_be_bytes());
        file.extend(flags.to_be_bytes());
        file.extend([0; 4]);
        file.extend(0x00E0_3AB4_4A67_6000_u64.to_be_bytes());
        file.extend(packet);
    };
    match kind {
        1001 => record(2, &[0x03, 0x0C, 0]),
        1002 => record(2, &[1, 0x03, 0x0C, 0]),
        _ => record(2, &[0x03, 0x0C, 0]),
    }
    for event in events {
        match kind {
            1001 => record(3, event),
            1002 => record(3, &[&[4], &event[..]].concat()),
            _ => record(0x0001_0003, event),
        }
    }
    file
}

/// Bluetooth IQ reports in btsnoop files and H4 bytes give bearings of each transmitter, told apart by handle and link; reports without usable samples
/// give none, and foreign or invalid ones are counted, and refused by field where there are no others.
#[test]
fn bluetooth_iq_reports_give_bearings() {
    let files = Files::new();
    let mut radio = Reports { offset_hz: 9e3, random: Random::new(8) };
    let mut events: Vec<Vec<u8>> =
        (0..24).map(|k| if k % 2 == 0 { radio.event(1, 0.7, 90.0) } else { radio.event(2, -1.9, 60.0) }).collect();
    let captures = [
        ("a.h4", h4(&events)),
        ("b.snoop", btsnoop(1001, &events)),
        ("c.snoop", btsnoop(1002, &events)),
        ("d.snoop", btsnoop(2001, &events)),
    ];
    for (name, bytes) in &captures {
        std::fs::write(files.path(name), bytes).unwrap();
        let lines = files.lines("--switched", name, &Reports::array(), &[]);
        assert_eq!(lines.len(), 24, "{name}");
        for line in &lines {
            let azimuth = if line["emitter"] == 1 { 0.7 } else { -1.9 };
            let off = degrees_between(number(line, "azimuth_deg").to_radians(), azimuth).abs();
            assert!(line["valid"] == true && off < 2.0, "{name}: {line}");
            assert!((number(line, "freq_hz") - 259e3).abs() < 1e3, "{name}: {line}");
        }
        let output = files.bearing("--switched", name, &Reports::array(), &["--looks", "4"]);
        assert!(String::from_utf8(output.stderr).unwrap().contains("24 IQ reports, 24 of them with samples to use"));
        assert_eq!(String::from_utf8(output.stdout).unwrap().lines().count(), 6);
    }
    // Of several transmitters nobody chooses how many packets come of each; a handle of a connection is not that of a train.
    let mut mixed = events.clone();
    mixed.truncate(23);
    for event in mixed.iter_mut().skip(1).step_by(2) {
        *event = radio.connection(1, -1.9, 60.0);
    }
    std::fs::write(files.path("mixed.h4"), h4(&mixed)).unwrap();
    let lines = files.lines("--switched", "mixed.h4", &Reports::array(), &["--looks", "5"]);
    assert_eq!(lines.iter().map(|line| number(line, "emitter")).collect::<Vec<_>>(), [1.0, 4097.0, 1.0, 4097.0]);
    let output = files.bearing("--switched", "mixed.h4", &Reports::array(), &["--looks", "5"]);
    assert!(text_of(&output.stderr).contains("3 of 23 packets make no group of 5 of one transmitter"));
    // An extension of a departure, a wrong checksum, no room for samples, an invalid sample: no signal.
    let mut none = events[0][..15].to_vec();
    (none[1], none[11], none[14]) = (13, 0xFF, 0);
    events[0][9] = 1;
    events[1][11] = 1;
    events[2] = none;
    events[3][60] = 0x80;
    std::fs::write(files.path("e.h4"), h4(&events)).unwrap();
    let lines = files.lines("--switched", "e.h4", &Reports::array(), &[]);
    assert!(lines[..4].iter().all(|line| line["valid"] == false && has(line, "no_signal")), "{:?}", &lines[..4]);
    assert!(lines[4..].iter().all(|line| line["valid"] == true));
    // Clipped: flagged.
    let loud: Vec<Vec<u8>> = (0..4).map(|_| radio.event(1, 0.7, 300.0)).collect();
    std::fs::write(files.path("loud.h4"), h4(&loud)).unwrap();
    let lines = files.lines("--switched", "loud.h4", &Reports::array(), &[]);
    assert!(lines.iter().all(|line| has(line, "clip")), "{lines:?}");
    // Noise instead of a tone.
    let noise: Vec<Vec<u8>> = (0..200).map(|_| radio.event(3, 0.0, 0.0)).collect();
    std::fs::write(files.path("noise.h4"), h4(&noise)).unwrap();
    let lines = files.lines("--switched", "noise.h4", &Reports::array(), &[]);
    assert!(lines.iter().filter(|line| line["valid"] == true).count() <= 1, "a bearing from noise");

    let refused = |bytes: &[u8], array: &str| {
        std::fs::write(files.path("f.h4"), bytes).unwrap();
        files.refused("--switched", "f.h4", array, &[])
    };
    let (good, array) = (&captures[0].1, Reports::array());
    assert!(
        refused(good, &array.replace("4e-6", "2e-6"))
            .contains("report 0: switch.slot_s = 0.000002: Slot_Durations = 2 us")
    );
    assert!(refused(good, &array.replace("1e6", "2e6")).contains("sample_rate_hz = 2000000"));
    assert!(refused(good, array.split("[switch]").next().unwrap()).contains("switch: missing"));
    assert!(refused(&good[..good.len() - 1], &array).contains("truncated"));
    assert!(refused(&[&[9], &good[..]].concat(), &array).contains("1 bytes begin no H4 packet"));
    assert!(refused(b"", &array).contains("no IQ report"));
    let mut wrong = good.clone();
    wrong[1 + 11] = 7;
    // One report that cannot be, and one with slots of another length, are counted; where all are so the first is named.
    wrong[events[0].len() + 1 + 1 + 9 + 1] = 1;
    std::fs::write(files.path("wrong.h4"), &wrong).unwrap();
    let output = files.bearing("--switched", "wrong.h4", &array, &[]);
    let note = text_of(&output.stderr);
    assert!(note.contains("24 IQ reports, 22 of them with samples to use"), "{note}");
    assert!(note.contains("2 not of this array or not valid, the first is report 0: Packet_Status = 7"), "{note}");
    let lines = files.lines("--switched", "wrong.h4", &array, &[]);
    assert_eq!((lines.len(), lines.iter().filter(|line| line["valid"] == true).count()), (23, 22));
    let all = h4(&vec![wrong[1..=events[0].len()].to_vec(); 3]);
    assert!(refused(&all, &array).contains("report 0: Packet_Status = 7"));
    let snoop = &captures[2].1;
    assert!(refused(&snoop[..snoop.len() - 1], &array).contains("truncated: record 24"));
    // A capture may shorten what is no report.
    let data: Vec<u8> = [256_u32, 32, 0, 0, 0, 0].into_iter().flat_map(u32::to_be_bytes).chain([2; 32]).collect();
    std::fs::write(files.path("shortened.snoop"), [&snoop[..16], &data, &snoop[16..]].concat()).unwrap();
    assert_eq!(
        files.lines("--switched", "shortened.snoop", &array, &[]),
        files.lines("--switched", captures[2].0, &array, &[])
    );
    assert!(refused(&snoop[..12], &array).contains("the header of btsnoop has 16"));
    let mut version = snoop.clone();
    version[11] = 2;
    assert!(refused(&version, &array).contains("btsnoop version 2"));
    version[11] = 1;
    version[15] = 0;
    assert!(refused(&version, &array).contains("btsnoop datalink"));
}

/// Truncated or altered recordings of every format, 3000 in all, are refused with a reason or still give finite results.
#[test]
fn damaged_recordings_are_refused_or_give_finite_lines() {
    let files = Files::new();
    let mut radio = Reports { offset_hz: 9e3, random: Random::new(9) };
    let events: Vec<Vec<u8>> = (0..6).map(|_| radio.event(1, 0.7, 90.0)).collect();
    let iq = samples(256);
    wav(&files.path("a.wav"), 6, 48_000, 16, false, &iq);
    wav(&files.path("b.wav"), 6, 48_000, 32, true, &iq);
    npy(&files.path("c.npy"), "<i2", &[2, 3, 128, 2], &vec![7; 2 * 3 * 128 * 4]);
    files.text("d.sigmf-meta", r#"{"global": {"core:datatype": "cf32_le", "core:num_channels": 3, "core:sample_rate": 48e3}, "captures": [], "annotations": []}"#);
    std::fs::write(files.path("d.sigmf-data"), iq.iter().flat_map(|x| (*x as f32).to_le_bytes()).collect::<Vec<_>>())
        .unwrap();
    std::fs::write(files.path("e.h4"), h4(&events)).unwrap();
    std::fs::write(files.path("f.snoop"), btsnoop(1002, &events)).unwrap();
    let (plain, switch) = (RadioArray::parse(&array()).unwrap(), RadioArray::parse(&Reports::array()).unwrap());
    let mut random = Random::new(77);
    let mut below = |most: usize| ((random.uniform() * most as f64) as usize).min(most - 1);
    let (mut refused, mut read) = (0, 0);
    for name in ["a.wav", "b.wav", "c.npy", "d.sigmf-meta", "d.sigmf-data", "e.h4", "f.snoop"] {
        let good = std::fs::read(files.path(name)).unwrap();
        for _ in 0..430 {
            let mut bytes = good.clone();
            let is_cut = below(3) == 0;
            if is_cut {
                bytes.truncate(below(good.len()));
            } else {
                // The front, where the headers are, more often than its share.
                let most = if below(2) == 0 { good.len() } else { good.len().min(160) };
                for _ in 0..=below(4) {
                    let at = below(most);
                    bytes[at] = [0, 0xFF, 0x80, below(256) as u8][below(4)];
                }
            }
            std::fs::write(files.path(name), &bytes).unwrap();
            let lines = if ["e.h4", "f.snoop"].contains(&name) {
                Packets::read(&files.path(name), None, &switch)
                    .and_then(|packets| switched::find(&packets, &switch, 1))
                    .map(|(lines, _)| lines)
            } else {
                Frames::read(&files.path(name), &plain).and_then(|frames| iq::find(&frames, &plain, 1))
            };
            match lines {
                Err(error) => {
                    assert!(error.to_string().len() > 10, "{name}: {error}");
                    refused += 1;
                }
                Ok(lines) => {
                    read += 1;
                    for line in lines {
                        let line = serde_json::to_value(&line).unwrap();
                        assert!(line["valid"] == false || number(&line, "sigma_deg") > 0.0, "{name}: {line}");
                    }
                }
            }
        }
        std::fs::write(files.path(name), &good).unwrap();
    }
    assert!(refused > 1000 && read > 200, "{refused} refused, {read} read");
}

/// `foxhound listen` writes a page that needs no network: bearings, eigenvalues and spectrum of a recording, or bearings of a live
/// radio.
#[test]
fn listen_makes_a_page_of_a_recording_and_of_a_radio() {
    let files = Files::new();
    wav(&files.path("a.wav"), 6, 48_000, 16, false, &samples(4096));
    let mut radio = Reports { offset_hz: 9e3, random: Random::new(8) };
    let events: Vec<Vec<u8>> = (0..24).map(|k| radio.event(1 + k % 2, 0.7, 90.0)).collect();
    std::fs::write(files.path("b.h4"), h4(&events)).unwrap();
    let page = |name: &str, array: &str, more: &[&str]| {
        let (array, file, out) =
            (files.text("array.toml", array), files.path(name), files.path(&format!("{name}.html")));
        let all = ["listen", &text(&file), "--array", &text(&array), "--out", &text(&out), "--json"];
        let (code, summary) = run_json(&[&all[..], more].concat());
        assert_eq!(code, 0, "{summary}");
        assert!(refused(&[&all[..], more].concat()).contains("is there already"), "{name}");
        let html = std::fs::read_to_string(&out).unwrap();
        assert!(!html.contains("<script") && !html.contains("http") && !html.contains("NaN"), "{name}");
        (summary, html)
    };
    let (summary, html) = page("a.wav", &format!("{}tone_band_hz = [-2e4, 2e4]\n", array()), &[]);
    assert_eq!((&summary["answers"], &summary["valid"]), (&4.into(), &4.into()), "{summary}");
    assert_eq!((html.matches("<svg").count(), html.matches("<circle").count()), (3, 4));
    // A line of the spectrum and three eigenvalues.
    assert_eq!(html.matches("<polyline").count(), 4);
    let (summary, html) = page("b.h4", &Reports::array(), &["--looks", "4"]);
    assert_eq!((&summary["answers"], &summary["valid"]), (&6.into(), &6.into()), "{summary}");
    assert_eq!((html.matches("<svg").count(), html.matches("<polyline").count()), (2, 8));

    let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    // It sends until the other end is dropped.
    let (sends, ended) = std::sync::mpsc::channel::<()>();
    let sender = std::thread::spawn(move || {
        let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        while ended.recv_timeout(std::time::Duration::from_millis(50)) == Err(RecvTimeoutError::Timeout) {
            let _ = socket.send_to(b"{\"azimuth_deg\": 30, \"sigma_deg\": 5}", ("127.0.0.1", port));
        }
    });
    let (source, out) = (format!("udp:127.0.0.1:{port}"), text(&files.path("live.html")));
    let (code, summary) = run_json(&["listen", "--bearings", &source, "--seconds", "2", "--out", &out, "--json"]);
    assert!(code == 0 && summary["valid"].as_u64().unwrap() >= 3, "{summary}");
    drop(sends);
    sender.join().unwrap();
    assert_refused(&["listen"], &[(&[][..], ["<FILE>"]), (&["a.wav"], ["--array"])]);
}
