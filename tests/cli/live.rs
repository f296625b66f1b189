//! `fly --live`, `companion --live`: browsers are served the report while the flight runs. `cargo xtask test` installs one.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use foxhound_tests::{Autopilot, assert_refused, checked_by, foxhound, qemu_image, run_json, signal, take_machine};
use serde_json::Value;

use crate::packed;

/// A flight that is served; it ends with the test.
pub(crate) struct Served {
    child: Child,
    address: String,
}

impl Served {
    /// Starts `foxhound` with arguments and a port of the system's choice, and reads where the page is.
    pub(crate) fn with(arguments: &[&str]) -> Self {
        let mut command = foxhound();
        command.args(arguments).args(["--json", "--live", "--port", "0"]);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut notes = BufReader::new(child.stderr.take().unwrap());
        let mut line = String::new();
        let address = loop {
            line.clear();
            assert!(notes.read_line(&mut line).unwrap() > 0, "it ended without a page");
            if let Some(address) = line.trim().strip_prefix("live: ") {
                break address.to_owned();
            }
        };
        // What else it says has to go somewhere.
        std::thread::spawn(move || std::io::copy(&mut notes, &mut std::io::sink()));
        Self { child, address }
    }

    /// The body of an answer.
    fn get(&self, path: &str) -> String {
        let host = self.address.trim_start_matches("http://").trim_end_matches('/');
        let mut stream = TcpStream::connect(host).unwrap();
        write!(stream, "GET {path} HTTP/1.0\r\nHost: {host}\r\n\r\n").unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").unwrap();
        assert!(head.starts_with("HTTP/1.") && head.contains(" 200 "), "{head}");
        body.to_owned()
    }

    fn records(&self, from: usize) -> Vec<Value> {
        let text = self.get(&format!("/records?from={from}"));
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// Waits for the records up to the last one, as a page does.
    fn follow(&self) -> Vec<Value> {
        let (mut records, since) = (Vec::new(), Instant::now());
        while records.last().is_none_or(|record: &Value| record["kind"] != "end") {
            records.extend(self.records(records.len()));
            assert!(since.elapsed() < Duration::from_secs(120), "it does not end");
            std::thread::sleep(Duration::from_millis(50));
        }
        records
    }

    /// The records so far, of which there may be none yet when the page can be had.
    fn first_records(&self) -> Vec<Value> {
        let since = Instant::now();
        loop {
            let records = self.records(0);
            if !records.is_empty() {
                return records;
            }
            assert!(since.elapsed() < Duration::from_secs(60), "it does not begin");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Waits until so much of it is flown.
    pub(crate) fn flies_for(&self, time_s: f64) {
        let since = Instant::now();
        while last_time_s(&self.records(0)) < time_s {
            assert!(since.elapsed() < Duration::from_secs(120), "it does not fly");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Stops it by Ctrl-C; returns its exit code, and its output.
    fn stop(self) -> (i32, Value) {
        self.stop_by("-INT")
    }

    /// The same by a signal.
    pub(crate) fn stop_by(mut self, name: &str) -> (i32, Value) {
        signal(self.child.id(), name);
        let code = self.child.wait().unwrap().code();
        let mut text = String::new();
        self.child.stdout.take().unwrap().read_to_string(&mut text).unwrap();
        (code.unwrap_or(-1), serde_json::from_str(&text).unwrap())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        // It may have ended before.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn last_time_s(records: &[Value]) -> f64 {
    records.iter().rev().find_map(|record| record["time_s"].as_f64()).unwrap_or(0.0)
}

/// The live page receives the flight as it runs, and its records are those of the finished report.
#[test]
fn the_flight_is_told_as_it_runs_and_in_the_end_it_is_that_of_the_report() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.html");
    let since = Instant::now();
    let served = Served::with(&["fly", "--speed", "4", "--report", path.to_str().unwrap()]);
    assert!(served.get("/").contains("connect-src 'self'"));
    // It does not run ahead of the clock, but for the step that is due next.
    let early = served.first_records();
    let passed_s = since.elapsed().as_secs_f64();
    assert!(last_time_s(&early) < 4.0 * passed_s + 0.025, "{} s after {passed_s} s", last_time_s(&early));
    assert_eq!(early[0]["kind"], "begin");
    let records = served.follow();
    assert!(since.elapsed().as_secs_f64() > last_time_s(&records) / 4.0);
    assert_eq!(records[..early.len()], early);

    let (code, printed) = served.stop();
    assert_eq!((code, &printed["result"]), (0, &"reached".into()));
    assert_eq!(records[records.len() - 1]["report"], printed);
    let page = std::fs::read_to_string(path).unwrap();
    // The file has them kind by kind.
    let by_kind = |mut records: Vec<Value>| {
        records.sort_by_key(|record| record["kind"].to_string());
        records
    };
    assert_eq!(by_kind(packed::records(&page)), by_kind(records));
    assert!(!page.contains("connect-src"), "a file asks nobody");
}

/// Watching a flight live does not change its result.
#[test]
fn being_watched_live_changes_nothing() {
    let served = Served::with(&["fly", "--speed", "1000", "--seed", "3"]);
    served.follow();
    assert_eq!(served.stop().1, run_json(&["fly", "--json", "--seed", "3"]).1);
}

/// `companion --live` serves a flight beside an autopilot.
#[test]
fn a_flight_beside_an_autopilot_is_served_as_well() {
    let autopilot = Autopilot::start(&[]);
    let address = ["--autopilot", &autopilot.address];
    let served = Served::with(&[&["companion", "--source=3,2,-5", "--max-time", "60"], &address[..]].concat());
    let records = served.follow();
    assert!(records.iter().filter(|record| record["kind"] == "step").count() > 50);
    let (code, printed) = served.stop();
    assert_eq!((code, &records[records.len() - 1]["report"]), (0, &printed));
}

/// A flight of the image in QEMU is served with the same records as the same flight on the desktop.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_image_in_qemu_is_served_as_well() {
    let via = format!("qemu:{}", qemu_image());
    let records = |via: &str| Served::with(&["fly", "--speed", "1000", "--via", via]).follow();
    assert_eq!(records(&via)[1..], records("host")[1..]);
}

/// A port that is taken is refused by name.
#[test]
fn a_port_that_is_taken_is_refused_by_name() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let words = format!("--port {port}: is taken by another program");
    for flight in [&["fly"][..], &["companion", "--autopilot", "tcp:127.0.0.1:1", "--source=1,2,-5"]] {
        assert_refused(flight, &[(["--live", "--port", &port], [words.as_str()])]);
    }
}

/// Has a browser watch flights, which it starts when it is there itself.
fn watched(arguments: &[&str]) {
    let program = foxhound().get_program().to_str().unwrap().to_owned();
    checked_by("live_page.py", &[&[program.as_str()], arguments].concat());
}

/// A browser that opens the live page at any time sees the drone move, and the finished report at the end.
#[test]
#[ignore = "needs a browser: cargo xtask test"]
fn browsers_see_the_drone_move_on_whenever_they_come_and_the_finished_report_at_the_end() {
    let _machine = take_machine();
    let folder = tempfile::tempdir().unwrap();
    watched(&["--report", folder.path().join("flight.html").to_str().unwrap()]);
}

/// When the flight's program is killed, the live page says that it was cut off and still shows what was flown.
#[test]
#[ignore = "needs a browser: cargo xtask test"]
fn a_browser_says_so_when_the_flight_is_cut_off() {
    let _machine = take_machine();
    watched(&["--cut"]);
}
