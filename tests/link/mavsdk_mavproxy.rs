//! `foxhound companion` with programs by others: MAVSDK as its autopilot and ground station, `MAVProxy` as a router
//! that requests its own rates. `cargo xtask test` installs both and runs these.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::collections::{BTreeMap, BTreeSet};
use std::net::UdpSocket;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

use foxhound_tests::{Autopilot, Program, foxhound, peer, python, run_json, share_machine, text};
use serde_json::Value;

const V_MAX: f64 = 2.0;

fn companion(address: &str, arguments: &[&str]) -> Program {
    let mut command = foxhound();
    command.args(["companion", "--json", "--autopilot", address, "--v-max", "2"]).args(arguments);
    Program::start(&mut command)
}

/// A message as MAVSDK tells it.
struct Told(Value);

impl Told {
    fn number(&self, field: &str) -> f64 {
        self.0[field].as_f64().unwrap_or_else(|| panic!("{field} of {}", self.0))
    }

    fn is(&self, fields: &[(&str, f64)]) -> bool {
        fields.iter().all(|(field, value)| self.number(field) == *value)
    }

    fn norm(&self, fields: [&str; 3]) -> f64 {
        fields.iter().map(|field| self.number(field).powi(2)).sum::<f64>().sqrt()
    }
}

#[derive(Default)]
struct Transcript {
    messages: BTreeMap<String, Vec<Told>>,
    params: Value,
    changed_in_flight: Option<bool>,
}

impl Transcript {
    fn take(&mut self, line: &str) {
        let mut line: Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        if let Some(name) = line["name"].as_str().map(str::to_owned) {
            assert_eq!(line["sender"], serde_json::json!([1, 191]), "{line}");
            self.messages.entry(name).or_default().push(Told(line["fields"].take()));
        } else if line["params"].is_object() {
            assert_eq!(line["others"], 0, "all of them are REAL32");
            self.params = line["params"].take();
        } else {
            self.changed_in_flight = Some(line["changed_in_flight"].as_bool().unwrap_or_else(|| panic!("{line}")));
        }
    }

    fn of(&self, name: &str) -> &[Told] {
        self.messages.get(name).map_or(&[], Vec::as_slice)
    }

    fn texts(&self) -> Vec<&str> {
        self.of("STATUSTEXT").iter().map(|text| text.0["text"].as_str().unwrap()).collect()
    }
}

fn is_moving(setpoint: &Told) -> bool {
    setpoint.norm(["vx", "vy", "vz"]) > 0.3
}

/// Flies with MAVSDK until it has read enough of it, and stops then.
fn flown_with_mavsdk(software: &str) -> Transcript {
    let mut mavsdk = Program::start(peer("mavsdk_autopilot.py").arg(software));
    let mut lines = mavsdk.lines();
    let first: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
    // So far that it does not arrive, on a busy machine either, before enough is read.
    let arguments = ["--source=100,0,-5", "--max-time", "180"];
    let mut companion = companion(&format!("udpout:127.0.0.1:{}", first["port"]), &arguments);
    let mut transcript = Transcript::default();
    let mut is_stopped = false;
    for line in lines {
        transcript.take(&line.unwrap());
        let setpoints = transcript.of("SET_POSITION_TARGET_LOCAL_NED");
        let is_enough = transcript.changed_in_flight.is_some()
            && setpoints.iter().filter(|setpoint| is_moving(setpoint)).count() > 80
            && transcript.of("LANDING_TARGET").len() > 10;
        if is_enough && !is_stopped {
            is_stopped = true;
            companion.signal("-INT");
            // The exit code after Ctrl-C, if the beacon was not reached.
            assert_eq!(companion.wait(), 130);
            // Left alone, MAVSDK ends once it has told the rest.
        }
    }
    assert!(is_stopped, "too little was read: {:?}", transcript.texts());
    assert_eq!(mavsdk.wait(), 0);
    transcript
}

fn mavsdk_reads_every_word(software: &str, landing_frame: f64) {
    let transcript = flown_with_mavsdk(software);

    let setpoints = transcript.of("SET_POSITION_TARGET_LOCAL_NED");
    assert!(setpoints.len() > 80);
    for setpoint in setpoints {
        let ignored = ["x", "y", "z", "afx", "afy", "afz", "yaw"].map(|field| (field, 0.0));
        let fixed =
            [("type_mask", 1479.0), ("coordinate_frame", 1.0), ("target_system", 1.0), ("target_component", 1.0)];
        assert!(setpoint.is(&fixed) && setpoint.is(&ignored), "{}", setpoint.0);
        let horizontal_mps = setpoint.number("vx").hypot(setpoint.number("vy"));
        assert!(horizontal_mps <= V_MAX && setpoint.number("vz").abs() < 0.5, "{}", setpoint.0);
        assert!(setpoint.number("yaw_rate").abs() <= 4.0, "{}", setpoint.0);
    }
    let last = setpoints.last().unwrap();
    assert!(last.is(&[("vx", 0.0), ("vy", 0.0), ("vz", 0.0), ("yaw_rate", 0.0)]), "{}", last.0);
    // Twenty a second by the companion's own clock.
    let times_s: Vec<f64> =
        setpoints.iter().filter(|setpoint| is_moving(setpoint)).map(|m| m.number("time_boot_ms") / 1e3).collect();
    let span_s = times_s.last().unwrap() - times_s[0];
    let rate_hz = (times_s.len() - 1) as f64 / span_s;
    assert!(span_s >= 3.0 && (16.0..=24.0).contains(&rate_hz), "{rate_hz} Hz in {span_s} s");

    let beats = transcript.of("HEARTBEAT");
    assert!(beats.len() > 4 && beats.iter().all(|beat| beat.is(&[("type", 18.0), ("autopilot", 8.0)])));
    let names: BTreeSet<&str> =
        transcript.of("NAMED_VALUE_FLOAT").iter().map(|value| value.0["name"].as_str().unwrap()).collect();
    assert!(
        ["FH_BRG", "FH_ELV", "FH_SNR", "FH_RNG", "FH_CNF", "FH_ST"].iter().all(|name| names.contains(name)),
        "{names:?}"
    );
    assert!(names.iter().all(|name| name.starts_with("FH_")), "{names:?}");
    let directions = transcript.of("DEBUG_VECT");
    assert!(directions.len() > 4);
    for direction in directions {
        let is_unit = (direction.norm(["x", "y", "z"]) - 1.0).abs() < 1e-5;
        assert!(direction.0["name"] == "FH_DIR" && is_unit && direction.number("x") > 0.9, "{}", direction.0);
    }
    let texts = transcript.texts();
    assert!(texts.contains(&"Foxhound: seeking"), "{texts:?}");
    for command in transcript.of("COMMAND_LONG") {
        assert!(command.is(&[("command", 511.0), ("target_system", 1.0), ("target_component", 1.0)]), "{}", command.0);
    }

    // Streams that MAVSDK enabled as a ground station.
    let listed = transcript.params.as_object().unwrap();
    let (_, table) = run_json(&["params", "--json"]);
    let names: BTreeSet<&str> =
        table["params"].as_array().unwrap().iter().map(|row| row["name"].as_str().unwrap()).collect();
    assert_eq!(listed.keys().map(String::as_str).collect::<BTreeSet<_>>(), names);
    assert_eq!((&listed["FH_LND_OUT"], &listed["FH_OBS_OUT"]), (&1.0.into(), &1.0.into()));
    let targets = transcript.of("LANDING_TARGET");
    for target in targets {
        let is_valid = target.is(&[("frame", landing_frame), ("position_valid", 1.0), ("type", 1.0)]);
        assert!(is_valid && target.number("distance") > 0.0, "{}", target.0);
    }
    let scans = transcript.of("OBSTACLE_DISTANCE");
    assert!(!scans.is_empty() && scans.iter().all(|scan| scan.0["distances"].as_array().unwrap().len() == 72));
    // And those that it could not change any more.
    assert_eq!(transcript.changed_in_flight, Some(false));
    assert!(texts.contains(&"FH_SPD_MAX refused while seeking"), "{texts:?}");
    assert!(
        transcript
            .of("PARAM_VALUE")
            .iter()
            .all(|value| value.0["param_id"] != "FH_SPD_MAX" || value.number("param_value") > 1.9)
    );
}

/// MAVSDK, in the place of ArduPilot, reads every message at the right rate and sets parameters.
#[test]
#[ignore = "needs MAVSDK: cargo xtask test"]
fn mavsdk_in_the_place_of_ardupilot_reads_every_word_and_sets_parameters() {
    let _machine = share_machine();
    mavsdk_reads_every_word("ardupilot", 12.0);
}

/// MAVSDK, in the place of PX4, reads every message at the right rate and sets parameters.
#[test]
#[ignore = "needs MAVSDK: cargo xtask test"]
fn mavsdk_in_the_place_of_px4_reads_every_word_and_sets_parameters() {
    let _machine = share_machine();
    mavsdk_reads_every_word("px4", 1.0);
}

/// A frame of a telemetry log.
#[derive(Clone, Debug)]
struct Record {
    time_us: u64,
    sender: (u8, u8),
    message_id: u32,
    frame: Vec<u8>,
}

impl Record {
    fn sequence(&self) -> u8 {
        self.frame[4]
    }

    fn payload(&self) -> &[u8] {
        &self.frame[10..]
    }
}

/// All frames of a log; a last one that is cut off is none.
fn records(path: &Path) -> Vec<Record> {
    let log = std::fs::read(path).unwrap();
    let (mut records, mut at) = (Vec::new(), 0);
    while let Some(record) = log.get(at..at + 18) {
        assert_eq!(record[8], 0xFD, "no frame at {at} of {}", path.display());
        let Some(frame) = log.get(at + 8..at + 20 + usize::from(record[9])) else { break };
        records.push(Record {
            time_us: u64::from_be_bytes(record[..8].try_into().unwrap()),
            sender: (frame[5], frame[6]),
            message_id: u32::from_le_bytes([frame[7], frame[8], frame[9], 0]),
            frame: frame.to_vec(),
        });
        at += 8 + frame.len();
    }
    records
}

fn of(records: &[Record], sender: (u8, u8)) -> Vec<Record> {
    records.iter().filter(|record| record.sender == sender).cloned().collect()
}

/// Frames that the end of a log may lack: neither program waits for what is under way.
const END: usize = 200;

/// That two logs hold the same frames without a gap, from the first one of `log` on, but for the end of either.
fn goes_on_as(log: &[Record], other: &[Record]) {
    let begin = other.iter().position(|record| record.frame == log[0].frame).unwrap();
    let other = &other[begin..];
    assert!(log.len() > 3 * END && log.len().abs_diff(other.len()) < END, "{} of {}", log.len(), other.len());
    let lost = log.iter().zip(other).position(|(one, other)| one.frame != other.frame);
    assert_eq!(lost, None, "of {}", log.len());
    assert!(log.windows(2).all(|pair| pair[1].sequence() == pair[0].sequence().wrapping_add(1)), "a gap");
}

const LOCAL_POSITION_NED: u32 = 32;
const SET_POSITION_TARGET_LOCAL_NED: u32 = 84;
const COMMAND_LONG: u32 = 76;
const REQUEST_DATA_STREAM: u32 = 66;
/// What the companion wishes for `LOCAL_POSITION_NED`, and how much of it is enough.
const WISH_HZ: f64 = 50.0;
const ENOUGH: f64 = 0.6;
const SECOND_US: u64 = 1_000_000;

fn rate_hz(times_us: &[u64], from_us: u64, to_us: u64) -> f64 {
    let count = times_us.iter().filter(|time_us| (from_us..to_us).contains(time_us)).count();
    count as f64 / ((to_us - from_us) as f64 * 1e-6)
}

/// `MAVProxy` routes every frame, and the message rates that it changes are restored within 6 s.
#[test]
#[ignore = "needs MAVProxy: cargo xtask test"]
fn mavproxy_routes_without_loss_and_its_greedy_stream_requests_are_corrected() {
    let _machine = share_machine();
    let dir = tempfile::tempdir().unwrap();
    let autopilot = Autopilot::start(&[]);
    // A port that was free a moment ago, of an address at which nobody else listens.
    let port = UdpSocket::bind("127.0.0.7:0").unwrap().local_addr().unwrap().port();
    let router_log = dir.path().join("router.tlog");
    let mut command = python();
    // Every 15 s it asks for four of every message a second, by default.
    command
        .args(["-m", "MAVProxy.mavproxy", "--daemon", "--non-interactive", "--streamrate=4"])
        .arg(format!("--master={}", autopilot.address))
        .arg(format!("--out=udpout:127.0.0.7:{port}"))
        .arg(format!("--logfile={}", router_log.display()))
        .current_dir(dir.path())
        .env("HOME", dir.path());
    let mut router = Program::start(&mut command);
    let log = dir.path().join("companion.tlog");
    let arguments = ["--source=50,0,-5", "--max-time", "120", "--tlog", &text(&log)];
    let mut companion = companion(&format!("udpin:127.0.0.7:{port}"), &arguments);

    let report: Value = serde_json::from_str(&companion.lines().next().unwrap().unwrap()).unwrap();
    assert_eq!((companion.wait(), &report["result"]), (0, &"reached".into()), "{report}");
    let ours = records(&log);
    let sent = of(&ours, (1, 191));
    // What it has still to pass on. While the autopilot speaks the router writes, and so its log comes to the end, too; what is
    // lost is judged below.
    let begin = Instant::now();
    while of(&records(&router_log), (1, 191)).last().is_none_or(|last| last.frame != sent.last().unwrap().frame)
        && begin.elapsed() < Duration::from_secs(30)
    {
        sleep(Duration::from_millis(500));
    }
    router.signal("-TERM");
    router.wait();
    let last = autopilot.end();

    // Both ways, frame for frame. What it passed on last it may not have written any more; the autopilot counts that.
    let routed = records(&router_log);
    goes_on_as(&of(&routed, (1, 191)), &sent);
    goes_on_as(&of(&ours, (1, 1)), &of(&routed, (1, 1)));
    let setpoints = sent.iter().filter(|record| record.message_id == SET_POSITION_TARGET_LOCAL_NED).count();
    assert!(setpoints > 200 && last["setpoints"] == setpoints, "{setpoints} {last}");
    assert_eq!(last["last_setpoint_mps"], serde_json::json!([0.0, 0.0, 0.0]), "{last}");
    for path in [&log, &router_log] {
        let (code, counts) = run_json(&["tlog", &text(path), "--json"]);
        assert_eq!((code, &counts["bad_crc"], &counts["skipped_bytes"]), (0, &0.into(), &0.into()), "{counts}");
    }

    // A request on the way takes the rates away, and the companion takes them back: the last one after which there is time for it.
    let positions: Vec<u64> = of(&ours, (1, 1))
        .iter()
        .filter(|record| record.message_id == LOCAL_POSITION_NED)
        .map(|record| record.time_us)
        .collect();
    let end_us = *positions.last().unwrap();
    let requests = routed.iter().filter(|record| record.sender.0 == 255 && record.message_id == REQUEST_DATA_STREAM);
    let requests: Vec<u64> = requests.map(|record| record.time_us).collect();
    let stolen_us = *requests.iter().rfind(|time_us| **time_us + 9 * SECOND_US <= end_us).unwrap();
    // The next one takes them away again.
    let next_us = requests.iter().find(|time_us| **time_us > stolen_us + SECOND_US);
    let end_us = next_us.map_or(end_us, |next_us| end_us.min(*next_us));
    let is_wish =
        |record: &&Record| record.message_id == COMMAND_LONG && record.payload()[..4] == 32.0_f32.to_le_bytes();
    let wishes: Vec<u64> = sent.iter().filter(is_wish).map(|record| record.time_us).collect();
    let before_hz = rate_hz(&positions, stolen_us - 2 * SECOND_US, stolen_us);
    let taken_us = *wishes.iter().find(|time_us| **time_us > stolen_us).unwrap();
    let meanwhile_hz = rate_hz(&positions, stolen_us + SECOND_US / 10, taken_us);
    let after_hz = rate_hz(&positions, taken_us + SECOND_US, end_us);
    let enough_hz = ENOUGH * WISH_HZ;
    let rates = format!("{before_hz} Hz, {meanwhile_hz} Hz for {} us, {after_hz} Hz", taken_us - stolen_us);
    assert!(before_hz >= enough_hz && meanwhile_hz < enough_hz && after_hz >= enough_hz, "{rates}");
    // It counts for 3 s at a time: in those in which it happens it may not be too few yet.
    assert!(taken_us - stolen_us < 6 * SECOND_US && end_us > taken_us + 2 * SECOND_US, "{rates}");
    println!("{rates}; {} frames up, {} down", sent.len(), of(&ours, (1, 1)).len());
}
