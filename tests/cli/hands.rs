//! What users stumble over: results that look wrong, and logs without words.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::net::UdpSocket;

use foxhound_tests::{Autopilot, errors, run, run_json, share_machine, text};
use serde_json::Value;

/// Runs a scenario; returns exit status, result and stderr.
fn flown(scenario: &str) -> (Option<i32>, Value, String) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.json");
    std::fs::write(&path, scenario).unwrap();
    let output = run(&["fly", "--json", "--scenario", &text(&path)]);
    (output.status.code(), serde_json::from_slice(&output.stdout).unwrap(), errors(&output))
}

/// A hull that only touches something at the start flies, with a note.
#[test]
fn a_hull_that_touches_something_at_the_start_flies_with_a_note() {
    let (code, report, said) = flown(r#"{"start": [1, 1], "obstacles": [{"x": 1, "y": 0, "r": 0.95}]}"#);
    assert_eq!((code, &report["result"]), (Some(0), &"reached".into()));
    assert!(said.contains("overlapped something by 0.100 m"), "{said}");
}

/// A path may be shorter than the straight line, since it ends before the beacon; path and remaining distance together are not.
#[test]
fn path_and_what_is_left_to_the_beacon_are_never_shorter_than_the_straight_line() {
    for (scenario, is_shorter) in [("{}", false), (r#"{"goal_tolerance": 2}"#, true)] {
        let (_, report, _) = flown(scenario);
        let of = |key: &str| report[key].as_f64().unwrap();
        assert!(of("path_length_m") + of("to_beacon_m") >= of("straight_line_m") - 1e-9, "{report}");
        assert!(!is_shorter || of("path_length_m") < of("straight_line_m"), "{report}");
    }
}

/// With the manual's example, a beacon below the vehicle, no bearing that is reported as valid is far off, even close to the beacon.
#[test]
fn the_example_beside_an_autopilot_tells_no_wrong_bearing() {
    let _machine = share_machine();
    let autopilot = Autopilot::start(&[]);
    let flight = ["companion", "--source", "8,3,0", "--max-time", "60", "--json", "--autopilot", &autopilot.address];
    let (_, report) = run_json(&flight);
    assert_eq!(report["result"], "reached", "{report}");
    assert!(report["bearing_rms_deg"].as_f64().unwrap() < 3.0, "{report}");
}

/// A `companion` that heard nobody tells no distances: they are null, not 0.
#[test]
fn a_companion_that_heard_nobody_tells_no_distances() {
    let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = format!("udpout:{}", silent.local_addr().unwrap());
    let companion = ["companion", "--autopilot", &address, "--source", "8,3,0", "--max-time", "0.5"];
    let (code, report) = run_json(&[&companion[..], &["--json"]].concat());
    assert_eq!((code, &report["result"]), (1, &"timeout".into()), "{report}");
    for key in ["to_beacon_m", "straight_line_m", "min_clearance_m", "bearing_rms_deg"] {
        assert_eq!(report.get(key), Some(&Value::Null), "{key}: {report}");
    }
    let printed = String::from_utf8(run(&companion).stdout).unwrap();
    assert!(printed.contains("path             0.00 m\n"), "{printed}");
}

/// `tlog` prints the names of messages beside their numbers.
#[test]
fn messages_of_a_log_have_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = text(&dir.path().join("f.tlog"));
    assert!(run(&["fly", "--json", "--tlog", &path]).status.success());
    let counted = String::from_utf8(run(&["tlog", &path]).stdout).unwrap();
    for named in ["message 0     HEARTBEAT", "message 84    SET_POSITION_TARGET_LOCAL_NED"] {
        assert!(counted.contains(named), "{counted}");
    }
    assert!(!counted.contains("unknown"), "{counted}");
    let (_, printed) = run_json(&["tlog", &path, "--json"]);
    assert_eq!((&printed["names"]["0"], printed["counts"]["0"].as_u64().is_some()), (&"HEARTBEAT".into(), true));
}
