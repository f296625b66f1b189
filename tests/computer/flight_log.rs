//! Flight logs: flown, and replayed to the last bit; lost, damaged and cut anywhere.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;

use foxhound_computer::log::frame::LogDeframer;
use foxhound_computer::log::{Codes, LAYOUT, Record};
use foxhound_computer::twin::{Fault, Setup};
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::doa::calibration::record::crc32;
use foxhound_core::guidance::{FrontEnd, param};
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::{BLOCK, Computer, ComputerError, HostComputer, StepReport};
use foxhound_sim::drive::flight::{self, Ending, Mission};
use foxhound_sim::drive::qemu::QemuComputer;
use foxhound_sim::drive::replay::{Summary, replay};
use foxhound_sim::scenario::Scenario;
use foxhound_tests::{qemu_image, refused, root, run, run_json, station};

/// A computer that is disturbed before each step; what it is told beside what the autopilot says.
struct Disturbed<C: ?Sized, F> {
    inner: Box<C>,
    disturb: F,
}

impl<C: Computer + ?Sized, F: FnMut(&mut C, Instant) -> Vec<u8>> Computer for Disturbed<C, F> {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        let told = (self.disturb)(&mut self.inner, now);
        self.inner.step(now, front_end, circles, &[rx, &told].concat())
    }

    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.inner.see(bytes)
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.inner.turn(bytes)
    }

    fn log_flight(&mut self) {
        self.inner.log_flight();
    }

    fn take_flight_log(&mut self) -> Vec<u8> {
        self.inner.take_flight_log()
    }
}

fn mission(scenario: Scenario) -> Mission {
    Mission { scenario, seed: 3, planner: planner::Config::default(), estimator: Estimator::default() }
}

fn scenario(name: &str) -> Scenario {
    Scenario::parse(&std::fs::read_to_string(root().join("tests/scenarios").join(name)).unwrap()).unwrap()
}

fn host(mission: &Mission) -> Box<dyn Computer> {
    Box::new(HostComputer::new(&mission.guidance()).unwrap())
}

fn twin(mission: &Mission) -> Box<dyn Computer> {
    let setup = Setup { guidance: mission.guidance(), needs_entry: false };
    Box::new(QemuComputer::start(Path::new(&qemu_image()), &setup).unwrap())
}

/// Flies, and replays the log; returns the log, the flight's hash and the result.
fn flown(mission: &Mission, mut computer: Box<dyn Computer>) -> (Vec<u8>, String, Summary) {
    computer.log_flight();
    let record = flight::fly(mission, computer.as_mut(), None, |_| ()).unwrap();
    let log = computer.take_flight_log();
    let summary = replay(&log).unwrap();
    (log, record.report.trace_hash, summary)
}

/// A flight out of each of these computers is flown again without a difference.
fn every_flight_is_flown_again(computer: impl Fn(&Mission) -> Box<dyn Computer>) {
    for scenario in [Scenario::built_in(), scenario("turning_antenna.json"), scenario("two_channels_die.json")] {
        let mission = mission(scenario);
        let (log, trace_hash, summary) = flown(&mission, computer(&mission));
        assert!(summary.is_identical(), "{summary:?}");
        assert_eq!(summary.trace_hash, trace_hash);
        assert!(summary.codes_checked >= summary.steps / 60, "{summary:?}");
        // What the maintenance port carries is 92 KB/s.
        let bytes_per_s = log.len() as u64 * 50 / summary.steps;
        assert!(bytes_per_s < 20_000, "{bytes_per_s}");
    }
    // PX4 gives control a while after the start, so that a parameter can be set before.
    let mut scenario = scenario("open_field.json");
    scenario.vehicle.autopilot = foxhound_sim::scenario::Software::Px4;
    let mission = mission(scenario);
    let untouched = flown(&mission, computer(&mission)).1;
    let mut is_set = false;
    let disturb = move |_: &mut (dyn Computer + 'static), now: Instant| {
        let is_time = now >= Instant(400_000) && !std::mem::replace(&mut is_set, now >= Instant(400_000));
        if is_time { station::set(param::FH_SPD_MAX, 0.7) } else { Vec::new() }
    };
    let (_, trace_hash, summary) = flown(&mission, Box::new(Disturbed { inner: computer(&mission), disturb }));
    assert!(summary.is_identical(), "{summary:?}");
    assert_eq!(summary.trace_hash, trace_hash);
    assert_ne!(untouched, trace_hash, "the parameter was set and meant something");
}

/// The same with a lidar on a line of its own, whose bytes are in the log, too; returns the hash.
fn a_flight_by_a_lidar_is_flown_again(computer: impl Fn(&Mission) -> Box<dyn Computer>) -> String {
    let mission = mission(scenario("lidar.json"));
    let (log, trace_hash, summary) = flown(&mission, computer(&mission));
    assert!(summary.is_identical(), "{summary:?}");
    assert_eq!(summary.trace_hash, trace_hash);
    // 17 625 bytes a second more.
    let bytes_per_s = log.len() as u64 * 50 / summary.steps;
    assert!((20_000..40_000).contains(&bytes_per_s), "{bytes_per_s}");
    trace_hash
}

/// A flight by a lidar on the companion's own line is replayed from its log with identical bits.
#[test]
fn a_flight_by_a_lidar_in_process_is_flown_again_to_the_last_bit() {
    a_flight_by_a_lidar_is_flown_again(host);
}

/// With the same bytes of a lidar the firmware in QEMU flies the desktop's flight, and its log is replayed with
/// identical bits.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn by_the_same_bytes_of_a_lidar_the_firmware_flies_the_same_flight() {
    let [here, there] = [host, twin].map(|computer| a_flight_by_a_lidar_is_flown_again(computer));
    assert_eq!(here, there);
}

/// What a radio sends: angles, and samples.
const RADIOS: [&str; 2] = ["../computer/uudf.json", "../computer/hci.json"];

/// The same with nothing but the bytes of a radio for bearings.
fn a_flight_by_a_radio_is_flown_again(radio: &str, computer: impl Fn(&Mission) -> Box<dyn Computer>) -> String {
    let mission = mission(scenario(radio));
    let mut computer = computer(&mission);
    computer.log_flight();
    let record = flight::fly(&mission, computer.as_mut(), None, |_| ()).unwrap();
    assert_eq!((record.report.result, record.report.collisions), (Ending::Reached, Some(0)), "{:?}", record.report);
    let summary = replay(&computer.take_flight_log()).unwrap();
    assert!(summary.is_identical(), "{summary:?}");
    assert_eq!(summary.trace_hash, record.report.trace_hash);
    summary.trace_hash
}

/// A flight whose bearings come only from the `+UUDF` lines of a radio, or only from the IQ reports of a Bluetooth controller, reaches
/// the beacon, and is replayed from its log with identical bits.
#[test]
fn a_flight_by_a_radio_in_process_is_flown_again_to_the_last_bit() {
    for radio in RADIOS {
        a_flight_by_a_radio_is_flown_again(radio, host);
    }
}

/// With the same `+UUDF` lines of a radio, or IQ reports of a Bluetooth controller, the firmware in QEMU flies the desktop's flight to
/// the beacon, and its log is replayed with identical bits.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn by_the_same_lines_of_a_radio_the_firmware_flies_the_same_flight() {
    for radio in RADIOS {
        let [here, there] = [host, twin].map(|computer| a_flight_by_a_radio_is_flown_again(radio, computer));
        assert_eq!(here, there);
    }
}

/// A flight on the desktop is replayed from its log with identical bits.
#[test]
fn a_flight_in_process_is_flown_again_to_the_last_bit() {
    every_flight_is_flown_again(host);
}

/// A flight of the firmware in QEMU is replayed from its log on the desktop with identical bits.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn a_flight_of_the_firmware_is_flown_again_to_the_last_bit() {
    every_flight_is_flown_again(twin);
}

/// Plans that arrived late in flight are applied at the same steps in the replay.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn plans_that_come_late_are_handed_in_at_their_steps_again() {
    let mission = mission(Scenario::built_in());
    let undisturbed = flown(&mission, host(&mission)).1;
    let setup = Setup { guidance: mission.guidance(), needs_entry: false };
    let inner = Box::new(QemuComputer::start(Path::new(&qemu_image()), &setup).unwrap());
    let disturb = |computer: &mut QemuComputer, now: Instant| {
        // For longer than a handover takes, and for shorter.
        if matches!(now.0 / 20_000 % 150, 20..70 | 90..93) {
            computer.inject(Fault::StarvePlanner);
        }
        Vec::new()
    };
    let (_, trace_hash, summary) = flown(&mission, Box::new(Disturbed { inner, disturb }));
    assert!(summary.is_identical(), "{summary:?}");
    assert_eq!(summary.trace_hash, trace_hash);
    assert_ne!(trace_hash, undisturbed, "late plans mean something");
}

/// A frame, taken apart.
struct Piece {
    bytes: Vec<u8>,
    kind: u8,
    number: u32,
}

/// The log frame by frame.
fn pieces(log: &[u8]) -> Vec<Piece> {
    let (mut deframer, mut pieces, mut from) = (LogDeframer::new(), Vec::new(), 0);
    for (at, byte) in log.iter().enumerate() {
        if let Some(frame) = deframer.push(*byte) {
            pieces.push(Piece { bytes: log[from..=at].to_vec(), kind: frame.kind, number: frame.number });
            from = at + 1;
        }
    }
    pieces
}

fn joined(pieces: &[Piece]) -> Vec<u8> {
    pieces.iter().flat_map(|piece| piece.bytes.clone()).collect()
}

/// A frame as another implementation of the stuffing writes it.
fn encoded(content: &[u8]) -> Vec<u8> {
    let plain = [content, &crc32(content).to_le_bytes()].concat();
    let mut stuffed = vec![0; cobs::max_encoding_length(plain.len())];
    let length = cobs::encode(&plain, &mut stuffed);
    [&[0], &stuffed[..length], &[0]].concat()
}

const STEP: u8 = 7;

/// A log of the built-in mission.
fn log() -> Vec<u8> {
    let mission = mission(Scenario::built_in());
    flown(&mission, host(&mission)).0
}

/// The replay names the step at which an input was changed, and reports lost bytes as a gap.
#[test]
fn a_changed_input_is_named_by_its_step_and_lost_bytes_are_named_as_a_gap() {
    let log = log();
    let whole = replay(&log).unwrap();

    // One bit of one bearing, with a right checksum.
    let mut changed = pieces(&log);
    let steps: Vec<usize> = (0..changed.len()).filter(|at| changed[*at].kind == STEP).collect();
    let piece = &mut changed[steps[300]];
    let mut deframer = LogDeframer::new();
    let mut content = [0; 400];
    let mut length = 0;
    for byte in &piece.bytes {
        if let Some(frame) = deframer.push(*byte) {
            let Some(Record::Step(mut step)) = Record::of(&frame) else { panic!("no step") };
            let heard = step.heard.as_mut().unwrap();
            heard.bearing.azimuth_rad = f32::from_bits(heard.bearing.azimuth_rad.to_bits() ^ 1);
            length = postcard::to_slice(&(STEP, piece.number, &step), &mut content).unwrap().len();
        }
    }
    piece.bytes = encoded(&content[..length]);
    let summary = replay(&joined(&changed)).unwrap();
    assert_eq!((summary.gaps, summary.first_difference), (0, Some(300)));
    assert_eq!((summary.first_difference_flight, summary.first_difference_s), (Some(1), Some(6.0)));
    assert!(!summary.is_identical());
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("flight.log");
    std::fs::write(&path, joined(&changed)).unwrap();
    let output = run(&["replay", &path.to_string_lossy()]);
    let words = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.starts_with("differs from step 300 of flight 1 on, at 6.00 s\n"), "{words}");

    // Bytes that are lost on the line.
    for (from, count) in [(log.len() / 2, 1), (log.len() / 3, 40), (log.len() / 2, 5000)] {
        let summary = replay(&[&log[..from], &log[from + count..]].concat()).unwrap();
        assert_eq!((summary.gaps, summary.first_difference), (1, None), "{count} bytes at {from}");
        assert!(summary.frames_missing >= 1 && summary.frames + summary.frames_missing == whole.frames);
        assert!(!summary.is_identical() && summary.steps > 100 && summary.steps < whole.steps);
    }
}

/// Garbage between frames changes nothing, and a log may end anywhere.
#[test]
fn rubbish_around_frames_changes_nothing_and_a_log_can_end_anywhere() {
    let log = log();
    let whole = replay(&log).unwrap();
    let mut noisy = b"\xfd\x00\x13 what stood on the line before\r\n".to_vec();
    for (index, piece) in pieces(&log).iter().enumerate() {
        noisy.extend_from_slice(&piece.bytes);
        if index % 7 == 0 {
            noisy.extend_from_slice(b"boot\xff\x00\x01\x00noise");
        }
    }
    let summary = replay(&noisy).unwrap();
    assert!(summary.is_identical() && summary.rubbish > 100);
    assert_eq!((summary.steps, &summary.trace_hash), (whole.steps, &whole.trace_hash));
    for cut in [1, 30, 700, 40_000] {
        let summary = replay(&log[..log.len() - cut]).unwrap();
        assert!(summary.is_identical() && summary.steps <= whole.steps, "{cut} bytes off the end");
        assert_eq!(summary.verdict(), "ends inside a frame: identical as far as it goes", "{cut} bytes off the end");
    }
    assert_eq!(whole.verdict(), "identical");
    let mut damaged = log.clone();
    let last = damaged.len() - 10;
    damaged[last] ^= 0x40;
    let summary = replay(&damaged).unwrap();
    assert_eq!((summary.gaps, &summary.verdict()[..]), (0, "ends inside a frame: identical as far as it goes"));
    // A flight that began before cannot be flown again, one that begins later can.
    let tail = &log[log.len() / 2..];
    assert!(replay(tail).unwrap_err().to_string().contains("no beginning"));
    let summary = replay(&[tail, &log].concat()).unwrap();
    assert_eq!((summary.trace_hash, summary.first_difference), (whole.trace_hash, None));
}

/// The replay reports samples that differ from those that were flown.
#[test]
fn codes_that_are_others_are_told() {
    let mut log = pieces(&log());
    let mut deframer = LogDeframer::new();
    let codes = log.iter_mut().filter(|piece| piece.kind == 4).nth(2).unwrap();
    for byte in &codes.bytes.clone() {
        if let Some(frame) = deframer.push(*byte) {
            let Some(Record::Codes(Codes { time, packed })) = Record::of(&frame) else { panic!("no codes") };
            // The antennas in front and behind change places: what is ahead seems to be behind.
            let channels: Vec<&[u8]> = packed.chunks(384).rev().collect();
            let packed = &channels.concat()[..];
            let mut content = [0; 2000];
            let record = Codes { time, packed };
            let length = postcard::to_slice(&(4_u8, codes.number, &record), &mut content).unwrap().len();
            codes.bytes = encoded(&content[..length]);
        }
    }
    let summary = replay(&joined(&log)).unwrap();
    assert_eq!((summary.codes_off, summary.first_difference), (1, None));
    assert!(!summary.is_identical());
    assert_eq!(summary.verdict(), "front end differs in 1 frames");
}

/// A log of another layout is refused by that, whatever its other fields are.
#[test]
fn a_log_of_another_layout_is_refused_by_its_version() {
    let mut content = [0; 100];
    let begin = (1_u8, 0_u32, LAYOUT - 1, param::LAYOUT, "0.0.9", [1_u8; 30]);
    let length = postcard::to_slice(&begin, &mut content).unwrap().len();
    let refused = replay(&encoded(&content[..length])).unwrap_err().to_string();
    assert!(refused.contains("written by version 0.0.9") && refused.contains(&format!("here {LAYOUT}")), "{refused}");
}

/// The exit code of `foxhound replay` tells whether the replay is identical, differs, or found nothing.
#[test]
fn the_command_says_identical_different_and_nothing_there_by_its_exit_code() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("flight.log");
    let file = path.to_string_lossy();
    let (code, report) = run_json(&["fly", "--json", "--flight-log", &file]);
    assert_eq!(code, 0, "{report}");
    let (code, summary) = run_json(&["replay", "--json", &file]);
    assert_eq!((code, &summary["trace_hash"]), (0, &report["trace_hash"]), "{summary}");
    assert_eq!((&summary["verdict"], &summary["ends_inside"]), (&"identical".into(), &false.into()));
    assert!(summary["first_difference"].is_null() && summary["steps"].as_u64().unwrap() > 100);
    let log = std::fs::read(&path).unwrap();
    std::fs::write(&path, [&log[..50_000], &log[50_100..]].concat()).unwrap();
    let (code, summary) = run_json(&["replay", "--json", &file]);
    assert_eq!((code, &summary["gaps"]), (1, &1.into()), "{summary}");
    for (bytes, word) in [(&b"no log"[..], "no flight log"), (&[], "no flight log"), (&log[90_000..], "no beginning")] {
        std::fs::write(&path, bytes).unwrap();
        let words = refused(&["replay", &file]);
        assert!(words.contains(word), "{words}");
    }
}
