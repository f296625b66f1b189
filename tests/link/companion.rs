//! `foxhound companion` beside an autopilot, in real time, over every kind of line.
//!
//! The autopilot is a thread here, so that everything is known: the true position of the vehicle, its setpoints and
//! their times, and the mode at that time. Nothing is asserted about durations.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use foxhound_link::dialect::MavMessage;
use foxhound_link::framer::Framer;
use foxhound_sim::autopilot::transport::{Line, Listen};
use foxhound_sim::autopilot::{Autopilot, GUIDED};
use foxhound_sim::drive::companion::Pace;
use foxhound_sim::scenario::{self, VehicleModel};
use foxhound_sim::world::Pose;
use foxhound_sim::world::vehicle::Vehicle;
use foxhound_tests::station::{messages, words};
use foxhound_tests::{
    Program, assert_refused, errors, foxhound, peer_says, qemu_image, run_json, share_machine, take_machine, text,
};
use serde_json::Value;

const STEP_US: u64 = 10_000;
const LOITER: u32 = 5;
const ENTER_AGAIN: &str = "Foxhound: leave the mode and enter it again";
const SOURCE: [f64; 2] = [8.0, 0.0];
const V_MAX: f32 = 2.0;
/// North, east, radius.
const PILLARS: [[f64; 3]; 2] = [[3.0, 0.3, 0.4], [5.5, -0.6, 0.3]];
const HULL_M: f64 = 0.15;

/// A setpoint that the autopilot received.
#[derive(Clone, Copy, Debug)]
struct Told {
    /// Whether it was in the mode and armed.
    in_mode: bool,
    velocity: [f32; 3],
    yaw_rate: f32,
}

impl Told {
    fn horizontal_mps(&self) -> f32 {
        self.velocity[0].hypot(self.velocity[1])
    }

    fn is_zero(&self) -> bool {
        self.velocity == [0.0; 3] && self.yaw_rate == 0.0
    }
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Heard {
    setpoints: Vec<Told>,
    heartbeats: u32,
    /// Texts for the pilot.
    texts: Vec<String>,
    /// Commands that were sent to the autopilot.
    commands: Vec<u16>,
    /// Where the vehicle is, and how fast.
    pub(crate) position_ned_m: [f64; 3],
    pub(crate) speed_mps: f64,
    pub(crate) yaw_rad: f64,
    min_clearance_m: f64,
}

impl Heard {
    fn to_source_m(&self) -> f64 {
        (self.position_ned_m[0] - SOURCE[0]).hypot(self.position_ned_m[1] - SOURCE[1])
    }
}

/// An autopilot and its vehicle, in a thread.
pub(crate) struct Bench {
    /// For `--autopilot`.
    pub(crate) address: String,
    heard: Arc<Mutex<Heard>>,
    custom_mode: Arc<Mutex<u32>>,
    gives: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Bench {
    /// In LOITER, with a pilot who gives control once a companion is heard.
    pub(crate) fn new(listen: &str) -> Self {
        Self::at(listen, [0.0, 0.0, -5.0], LOITER).that_gives()
    }

    fn that_gives(self) -> Self {
        self.gives.store(true, Ordering::Relaxed);
        self
    }

    fn at(listen: &str, position_ned_m: [f64; 3], custom_mode: u32) -> Self {
        let (line, address) = Line::listen(&listen.parse::<Listen>().unwrap()).unwrap();
        Self::on(line, address.to_string(), position_ned_m, custom_mode)
    }

    fn on(mut line: Line, address: String, position_ned_m: [f64; 3], custom_mode: u32) -> Self {
        let heard = Arc::new(Mutex::new(Heard { position_ned_m, min_clearance_m: f64::INFINITY, ..Heard::default() }));
        let custom_mode = Arc::new(Mutex::new(custom_mode));
        let [gives, stop] = [false; 2].map(|flag| Arc::new(AtomicBool::new(flag)));
        let (ours, mode) = (Arc::clone(&heard), Arc::clone(&custom_mode));
        let (is_given, stopped) = (Arc::clone(&gives), Arc::clone(&stop));
        let thread = std::thread::spawn(move || {
            let model = scenario::Vehicle { model: VehicleModel::Arducopter, ..scenario::Vehicle::default() };
            let mut vehicle = Vehicle::new(model, 2.0, Pose { position_ned_m, ..Pose::default() });
            let mut autopilot = Autopilot::default();
            let (mut framer, mut pace, mut flown_us) = (Framer::new(), Pace::new(Duration::from_micros(STEP_US)), 0);
            while !stopped.load(Ordering::Relaxed) {
                let now_us = pace.wait().0;
                autopilot.custom_mode = *mode.lock().unwrap();
                let rx = line.read();
                let mut heard = ours.lock().unwrap();
                listen(&mut heard, &mut framer, &rx, autopilot.custom_mode == GUIDED);
                // By then the companion has heard that it is not in control.
                if heard.heartbeats >= 3 && is_given.swap(false, Ordering::Relaxed) {
                    *mode.lock().unwrap() = GUIDED;
                }
                autopilot.receive(now_us, &vehicle.motion, &rx);
                while flown_us + STEP_US <= now_us {
                    vehicle.step(autopilot.command(now_us), STEP_US as f64 * 1e-6);
                    flown_us += STEP_US;
                    let [north, east, _] = vehicle.motion.pose.position_ned_m;
                    for [n, e, r] in PILLARS {
                        let clearance_m = (north - n).hypot(east - e) - r - HULL_M;
                        heard.min_clearance_m = heard.min_clearance_m.min(clearance_m);
                    }
                }
                let velocity = vehicle.motion.velocity_ned_mps;
                heard.position_ned_m = vehicle.motion.pose.position_ned_m;
                heard.yaw_rad = vehicle.motion.pose.yaw_rad;
                heard.speed_mps = velocity[0].hypot(velocity[1]);
                drop(heard);
                autopilot.telemetry(now_us, &vehicle.motion, false);
                let tx = autopilot.transmit();
                if line.is_open() {
                    line.write(&tx);
                }
            }
        });
        Self { address, heard, custom_mode, gives, stop, thread: Some(thread) }
    }

    /// What it has heard and where it is, for a thread beside.
    pub(crate) fn shared(&self) -> Arc<Mutex<Heard>> {
        Arc::clone(&self.heard)
    }

    pub(crate) fn heard(&self) -> Heard {
        self.heard.lock().unwrap().clone()
    }

    fn switch(&self, custom_mode: u32) {
        *self.custom_mode.lock().unwrap() = custom_mode;
    }

    /// Waits until it is so, for two minutes at most.
    pub(crate) fn wait(&self, what: &str, is_so: impl Fn(&Heard) -> bool) -> Heard {
        let begin = Instant::now();
        loop {
            let heard = self.heard();
            if is_so(&heard) {
                return heard;
            }
            assert!(begin.elapsed() < Duration::from_secs(120), "never: {what}; {:?}", heard.position_ned_m);
            sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map_or(Ok(()), JoinHandle::join);
        // A second panic would end the program at once, and nobody would end the companions.
        if !std::thread::panicking() {
            ended.unwrap();
        }
    }
}

fn listen(heard: &mut Heard, framer: &mut Framer, bytes: &[u8], in_mode: bool) {
    for (header, message) in messages(framer, bytes) {
        assert_eq!((header.system_id, header.component_id), (1, 191));
        match message {
            MavMessage::HEARTBEAT(beat) => {
                assert_eq!((beat.mavtype, beat.autopilot), (18, 8));
                heard.heartbeats += 1;
            }
            MavMessage::STATUSTEXT(text) => heard.texts.push(words(&text)),
            MavMessage::COMMAND_LONG(command) => heard.commands.push(command.command),
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(target) => {
                assert_eq!((target.type_mask, target.coordinate_frame), (0x05C7, 1));
                let velocity = [target.vx, target.vy, target.vz];
                heard.setpoints.push(Told { in_mode, velocity, yaw_rate: target.yaw_rate });
            }
            _ => {}
        }
    }
}

/// The file of the pillars.
fn pillars(dir: &Path) -> String {
    let obstacles = PILLARS.map(|[north, east, r]| format!(r#"{{"x":{east},"y":{north},"r":{r}}}"#));
    let path = dir.join("pillars.json");
    std::fs::write(&path, format!(r#"{{"obstacles":[{}]}}"#, obstacles.join(","))).unwrap();
    text(&path)
}

pub(crate) fn start(address: &str, extra: &[&str]) -> Program {
    let mut command = foxhound();
    command.args(["companion", "--autopilot", address, "--json", "--v-max", "2"]).args(extra);
    if !extra.iter().any(|word| word.starts_with("--source")) {
        command.arg("--source=8,0,-5");
    }
    // One that is never given control is to fail, not to wait.
    if !extra.contains(&"--max-time") {
        command.args(["--max-time", "100"]);
    }
    Program::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()))
}

pub(crate) fn ended(mut companion: Program) -> (i32, Value) {
    let output = companion.output();
    let report = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", errors(&output)));
    (output.status.code().unwrap(), report)
}

/// Requirements at the end of every flight that arrives.
fn arrived(bench: &Bench, code: i32, report: &Value) {
    assert_eq!((code, &report["result"], &report["reason"]), (0, &"reached".into(), &"nominal".into()), "{report}");
    assert_eq!(report["collisions"], 0, "{report}");
    let heard = bench.heard();
    well_behaved(&heard);
    assert!(heard.to_source_m() < 1.5 && heard.speed_mps < 0.5, "{:?} {}", heard.position_ned_m, heard.speed_mps);
    assert!((heard.position_ned_m[2] + 5.0).abs() < 0.3, "altitude lost: {:?}", heard.position_ned_m);
}

fn well_behaved(heard: &Heard) {
    assert!(heard.setpoints.iter().all(|told| told.horizontal_mps() <= V_MAX));
    let outside = heard.setpoints.iter().filter(|told| !told.in_mode);
    // The mode is known with the next heartbeat only, and nothing that comes until then is obeyed.
    assert!(outside.clone().filter(|told| told.horizontal_mps() > 0.05).count() < 40);
    assert!(heard.setpoints.last().is_none_or(Told::is_zero), "{:?}", heard.setpoints.last());
    assert!(heard.commands.iter().all(|command| *command == 511), "only messages are asked for: {:?}", heard.commands);
}

fn flies_to_the_beacon(listen: &str) {
    let dir = tempfile::tempdir().unwrap();
    let bench = Bench::new(listen);
    let log = text(&dir.path().join("flight.tlog"));
    let (code, report) = ended(start(&bench.address, &["--obstacles", &pillars(dir.path()), "--tlog", &log]));
    arrived(&bench, code, &report);
    let heard = bench.heard();
    assert!(heard.min_clearance_m > 0.0, "{}", heard.min_clearance_m);
    let told_m = report["min_clearance_m"].as_f64().unwrap();
    // It knows the reported positions, fifty a second, at 2 m/s at most.
    assert!((told_m - heard.min_clearance_m).abs() < 0.05, "{told_m} {}", heard.min_clearance_m);
    let length_m = report["path_length_m"].as_f64().unwrap();
    assert!(length_m > 7.0 && length_m < 14.0 && report["straight_line_m"] == 8.0, "{report}");
    for key in ["name", "seed", "time_s", "replans", "bearing_rms_deg", "trace_hash"] {
        assert!(!report[key].is_null(), "{key}: {report}");
    }
    let (code, counts) = run_json(&["tlog", &log, "--json"]);
    assert_eq!((code, &counts["bad_crc"], &counts["skipped_bytes"]), (0, &0.into(), &0.into()), "{counts}");
    let setpoints = counts["counts"]["84"].as_u64().unwrap() as usize;
    bench.wait("what was logged is what was sent", |heard| heard.setpoints.len() == setpoints);
    assert!(counts["counts"]["32"].as_u64().unwrap() > 100, "{counts}");
}

/// Over TCP the companion flies among pillars to the beacon and stops there.
#[test]
fn over_tcp_it_flies_among_pillars_to_the_beacon_and_stops_there() {
    let _machine = share_machine();
    flies_to_the_beacon("tcp:127.0.0.1:0");
}

/// Over UDP the companion flies among pillars to the beacon and stops there.
#[test]
fn over_udp_it_flies_among_pillars_to_the_beacon_and_stops_there() {
    let _machine = share_machine();
    flies_to_the_beacon("udp:127.0.0.1:0");
}

/// Over a serial port the companion flies among pillars to the beacon and stops there.
#[test]
fn over_a_serial_port_it_flies_among_pillars_to_the_beacon_and_stops_there() {
    let _machine = share_machine();
    flies_to_the_beacon("pty");
}

/// An autopilot that sends first, from a port of its own, is answered and flown to the beacon.
#[test]
fn an_autopilot_that_sends_first_is_answered() {
    let _machine = share_machine();
    // A port that was free a moment ago, of an address at which nobody else listens.
    let port = std::net::UdpSocket::bind("127.0.0.6:0").unwrap().local_addr().unwrap().port();
    let address = format!("udp:127.0.0.6:{port}");
    let companion = start(&address, &["--source=4,0,-5"]);
    let line = Line::open(&format!("udpout:127.0.0.6:{port}").parse().unwrap()).unwrap();
    let bench = Bench::on(line, address, [0.0, 0.0, -5.0], LOITER).that_gives();
    let (code, report) = ended(companion);
    assert_eq!((code, &report["result"]), (0, &"reached".into()), "{report}");
    well_behaved(&bench.heard());
}

/// It waits for the mode, holds when the mode is taken away, and continues when it is given back.
#[test]
fn it_waits_for_the_mode_holds_when_it_is_taken_away_and_goes_on_when_it_is_given_back() {
    let _machine = share_machine();
    let bench = Bench::at("tcp:127.0.0.1:0", [0.0, 0.0, -5.0], LOITER);
    let companion = start(&bench.address, &["--source=7,0,-5"]);
    let before = bench.wait("two heartbeats", |heard| heard.heartbeats >= 2);
    assert!(before.setpoints.iter().all(Told::is_zero) && before.speed_mps < 1e-3, "{:?}", before.setpoints.last());
    bench.switch(GUIDED);
    bench.wait("on the way", |heard| heard.position_ned_m[0] > 1.5);
    bench.switch(LOITER);
    let beats = bench.heard().heartbeats;
    let taken = bench.wait("a stand", |heard| heard.speed_mps < 0.02 && heard.heartbeats >= beats + 3);
    let count = taken.setpoints.len();
    bench.wait("another second", |heard| heard.heartbeats >= beats + 4);
    let later = bench.heard();
    assert!(later.setpoints[count..].iter().all(|told| told.horizontal_mps() <= 0.05));
    assert!((later.position_ned_m[0] - taken.position_ned_m[0]).abs() < 0.1, "it is not ours");
    bench.switch(GUIDED);
    let (code, report) = ended(companion);
    assert_eq!((code, &report["result"]), (0, &"reached".into()), "{report}");
    well_behaved(&bench.heard());
}

/// Started while the vehicle is in the mode already, as after a restart in flight, it holds until the mode is left and entered
/// again, and tells the pilot so.
#[test]
fn started_in_the_mode_it_holds_until_the_mode_is_entered_again() {
    let _machine = share_machine();
    let bench = Bench::at("tcp:127.0.0.1:0", [0.0, 0.0, -5.0], GUIDED);
    let companion = start(&bench.address, &["--source=6,0,-5"]);
    let heard = bench.wait("a text", |heard| heard.texts.iter().any(|text| text == ENTER_AGAIN));
    let later = bench.wait("three seconds", |later| later.heartbeats >= heard.heartbeats + 3);
    assert!(later.setpoints.len() > 40 && later.setpoints.iter().all(Told::is_zero), "{:?}", later.setpoints.last());
    assert!(later.position_ned_m[0].abs() < 0.05, "{:?}", later.position_ned_m);
    bench.switch(LOITER);
    bench.wait("two heartbeats", |heard| heard.heartbeats >= later.heartbeats + 2);
    bench.switch(GUIDED);
    let (code, report) = ended(companion);
    assert_eq!((code, &report["result"]), (0, &"reached".into()), "{report}");
    well_behaved(&bench.heard());
}

/// After a restart of the autopilot it connects again, and waits until the mode is entered again.
#[test]
fn an_autopilot_that_starts_anew_is_called_again_and_must_give_the_mode_afresh() {
    let _machine = share_machine();
    // Nobody else listens at this address of the machine, so that the port is still free afterwards.
    let bench = Bench::new("tcp:127.0.0.5:0");
    let companion = start(&bench.address, &["--source=6,0,-5"]);
    let heard = bench.wait("on the way", |heard| heard.position_ned_m[0] > 1.0);
    let address = bench.address.clone();
    drop(bench);
    // Longer than the link takes to fall silent.
    sleep(Duration::from_millis(5_500));
    let bench = Bench::at(&address, heard.position_ned_m, GUIDED);
    bench.wait("a heartbeat", |heard| heard.heartbeats >= 2);
    let first = bench.heard();
    assert!(first.setpoints.iter().all(Told::is_zero), "it was in the mode, but nobody gave it: {:?}", first.setpoints);
    bench.switch(LOITER);
    bench.wait("another heartbeat", |heard| heard.heartbeats >= first.heartbeats + 2);
    bench.switch(GUIDED);
    let (code, report) = ended(companion);
    assert_eq!((code, &report["result"]), (0, &"reached".into()), "{report}");
    well_behaved(&bench.heard());
}

/// When interrupted, the companion stops the vehicle before it ends.
#[test]
fn interrupted_it_stops_the_vehicle_first() {
    let _machine = share_machine();
    let bench = Bench::new("tcp:127.0.0.1:0");
    let companion = start(&bench.address, &["--source=40,0,-5"]);
    bench.wait("some speed", |heard| heard.speed_mps > 0.6);
    companion.signal("-INT");
    let (code, report) = ended(companion);
    assert_eq!((code, &report["result"]), (130, &"interrupted".into()), "{report}");
    let heard = bench.heard();
    well_behaved(&heard);
    assert!(heard.speed_mps < 0.4, "{}", heard.speed_mps);
}

/// At the time limit the companion stops the vehicle and reports a timeout.
#[test]
fn at_the_time_limit_it_stops_the_vehicle_and_says_so() {
    let _machine = share_machine();
    let bench = Bench::new("udp:127.0.0.1:0");
    let (code, report) = ended(start(&bench.address, &["--source=40,0,-5", "--max-time", "15"]));
    assert_eq!((code, &report["result"], &report["reason"]), (1, &"timeout".into(), &"nominal".into()), "{report}");
    well_behaved(&bench.heard());
    let (code, report) =
        run_json(&["companion", "--json", "--autopilot", "tcp:127.0.0.1:9", "--source", "1,2,-3", "--max-time", "1"]);
    assert_eq!((code, &report["result"], &report["reason"]), (1, &"timeout".into(), &"link_lost".into()), "{report}");
}

/// Beside `foxhound autopilot` as ArduCopter, over a line that damages bytes, the beacon is reached.
#[test]
fn a_stranger_can_try_it_with_the_modelled_arducopter_and_a_bad_line() {
    let _machine = share_machine();
    tried_with("arducopter");
}

/// Beside `foxhound autopilot` as PX4, over a line that damages bytes, the beacon is reached.
#[test]
fn a_stranger_can_try_it_with_the_modelled_px4_and_a_bad_line() {
    let _machine = share_machine();
    tried_with("px4");
}

fn tried_with(software: &str) {
    let autopilot =
        foxhound_tests::Autopilot::start(&["--start=1,-1,7", "--noise", "3:0.0005", "--software", software]);
    // One companion after another: each is given control afresh.
    for source in ["--source=1,2,-7", "--source=-3,-3,-7"] {
        let (code, report) = ended(start(&autopilot.address, &[source]));
        assert_eq!((code, &report["result"]), (0, &"reached".into()), "{report}");
    }
    let last = autopilot.end();
    assert_eq!(last["last_setpoint_mps"], serde_json::json!([0.0, 0.0, 0.0]), "{last}");
    let [north, east, down] = [0, 1, 2].map(|axis| last["position_ned_m"][axis].as_f64().unwrap());
    assert!((north + 3.0).hypot(east + 3.0) < 1.5 && (down + 7.0).abs() < 0.3, "{last}");
    assert!(last["fastest_setpoint_mps"].as_f64().unwrap() <= 2.0, "{last}");
}

/// Files, ports and places that cannot be used are refused by the option that names them; `tests/proof/bad_input.rs` has the rest.
#[test]
fn what_cannot_be_used_is_refused_by_option() {
    let _machine = share_machine();
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, content: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, content).unwrap();
        text(&path)
    };
    let unknown = write("unknown.json", r#"{"obstacles":[{"x":1,"y":2,"r":0.3,"height":4}]}"#);
    let negative = write("negative.json", r#"{"obstacles":[{"x":1,"y":2,"r":-0.3}]}"#);
    let missing = text(&dir.path().join("missing.json"));
    let fast = write("fast.toml", "FH_SPD_MAX = 99");
    let no_elf = format!("qemu:{unknown}");
    let with_source = ["companion", "--source", "1,2,-3", "--autopilot"];
    assert_refused(
        &with_source,
        &[
            (["tcp:127.0.0.1:70000"], ["--autopilot", "70000 is outside"]),
            (["tcp:127.0.0.1"], ["--autopilot", "has no port"]),
            (["/dev/ttyACM0"], ["--autopilot", "serial:/dev/ttyACM0:115200"]),
            (["serial:/dev/no-such-port:57600"], ["--autopilot", "No such file"]),
            (["serial:/dev/null:57600"], ["--autopilot", "/dev/null"]),
            (["udpout:no-such-host.invalid:9"], ["--autopilot", "no-such-host"]),
        ],
    );
    let beside = ["companion", "--autopilot", "tcp:127.0.0.1:9"];
    assert_refused(
        &beside,
        &[
            (["--source", "1,nan,3"], ["--source", "three numbers"]),
            (["--source", "1e9,0,0"], ["--source: N", "is outside"]),
        ],
    );
    assert_refused(
        &[&beside[..], &["--source", "1,2,-3", "--max-time", "1"]].concat(),
        &[
            (["--snr-db", "900"], ["--snr-db", "is outside"]),
            (["--obstacles", &missing], ["--obstacles", "missing.json"]),
            (["--obstacles", &unknown], ["--obstacles", "obstacles[0].height: unknown key"]),
            (["--obstacles", &negative], ["--obstacles", "obstacles[0].r = -0.3 is outside"]),
            (["--pad", "1"], ["--pad", "two numbers"]),
            (["--pad", "1,12.5"], ["--pad: E = 12.5", "is outside -8..=12"]),
            (["--via", "qmeu:x"], ["--via", "expected"]),
            (["--via", &no_elf], ["--via", "not an ELF file"]),
            (["--tlog", "/dev/null/f.tlog"], ["--tlog", "/dev/null"]),
            (["--planner", "nobody"], ["--planner", "nobody"]),
            (["--params", &missing], ["missing.json", "No such file"]),
            (["--params", &fast], ["fast.toml: FH_SPD_MAX = 99", "outside"]),
        ],
    );
    assert_refused(
        &["autopilot", "--listen"],
        &[
            (&["ptty"][..], ["--listen", "expected"]),
            (&["pty", "--noise", "0.1"], ["--noise", "SEED:RATE"]),
            (&["pty", "--start", "1,2"], ["--start", "three numbers"]),
        ],
    );
}

/// The firmware in QEMU flies among pillars to the beacon, over TCP and in real time, and stops there.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_firmware_in_qemu_flies_among_pillars_to_the_beacon_and_stops_there() {
    // QEMU needs much of a processor to keep up.
    let _machine = take_machine();
    let dir = tempfile::tempdir().unwrap();
    let bench = Bench::new("tcp:127.0.0.1:0");
    let via = format!("qemu:{}", qemu_image());
    let (code, report) = ended(start(&bench.address, &["--obstacles", &pillars(dir.path()), "--via", &via]));
    arrived(&bench, code, &report);
    assert!(bench.heard().min_clearance_m > 0.0);
}

/// pymavlink reads the telemetry log without bad data, in both directions and with the true time.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn pymavlink_reads_the_log_without_bad_data() {
    let _machine = share_machine();
    let dir = tempfile::tempdir().unwrap();
    let bench = Bench::new("tcp:127.0.0.1:0");
    let log = dir.path().join("flight.tlog");
    let (code, report) = ended(start(&bench.address, &["--source=4,0,-5", "--tlog", &text(&log)]));
    assert_eq!(code, 0, "{report}");
    let counts: Value = serde_json::from_str(&peer_says("read_tlog.py", &[log])).unwrap();
    assert_eq!((&counts["bad"], &counts["directions"]), (&0.into(), &2.into()), "{counts}");
    let now_s = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs_f64();
    assert!((counts["last_s"].as_f64().unwrap() - now_s).abs() < 60.0, "wall time: {counts}");
}
