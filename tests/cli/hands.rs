//! Mistakes that users make, such as lists that are too long or incomplete groups of frames: each is an error that names the key.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use foxhound_tests::{Program, foxhound, npy, run, share_machine};
use serde_json::Value;

const ARRAY: &str = "wavelength_m = 0.345\nsample_rate_hz = 102400.0\n";
const SIDE: &str = "side_m = 0.138\n";

/// Runs `foxhound bearing` and returns the error text; stdout must be empty.
fn refusal(array: &str, more: &[&str]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    std::fs::write(Path::new(&path("f.npy")), npy("<i2", "(4, 4, 256)", &[0; 4 * 4 * 256 * 2])).unwrap();
    std::fs::write(Path::new(&path("a.toml")), array).unwrap();
    let output = run(&[&["bearing", "--adc", &path("f.npy"), "--array", &path("a.toml")], more].concat());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{array}: {text}");
    assert!(output.stdout.is_empty());
    text
}

/// Array files with one value too many in a list, with a list instead of a table, or with two keys that exclude each other are refused by
/// key.
#[test]
fn a_list_with_a_value_too_many_is_an_error_that_names_the_key() {
    for (keys, named) in [
        ("antennas_m = [[0.07,0.07],[0.07,-0.07],[-0.07,-0.07],[-0.07,0.07],[0,0]]\n", "antennas_m: 5 antennas"),
        ("antennas_m = [[0.07,0.07,1],[0.07,-0.07],[-0.07,-0.07],[-0.07,0.07]]\n", "antennas_m[0]"),
        ("side_m = 0.138\ntone_band_hz = [2000, 9000, 10000]\n", "tone_band_hz"),
        ("side_m = 0.138\nskew_s = [0, 0, 0, 0, 0]\n", "skew_s"),
        ("side_m = 0.138\ntone_hz = 9500\ntone_band_hz = [2000, 9000]\n", "tone_hz, beside tone_band_hz,"),
        ("side_m = 0.138\ncalibration = [[1, 1, 1, 1], [0, 0, 0, 0]]\n", "calibration: expected a table"),
    ] {
        let text = refusal(&format!("{ARRAY}{keys}"), &[]);
        assert!(text.contains(named), "{keys}: {text}");
    }
}

/// Runs a scenario; returns exit status, result and stderr.
fn flown(scenario: &str) -> (Option<i32>, Value, String) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.json");
    std::fs::write(&path, scenario).unwrap();
    let output = run(&["fly", "--json", "--scenario", &path.to_string_lossy()]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), serde_json::from_slice(&output.stdout).unwrap_or_default(), said)
}

/// A start inside a pillar or a wall is an error that names it, also in a suite; a hull that only touches one flies, with a note.
#[test]
fn a_start_inside_of_something_is_an_error() {
    for (scenario, named) in [
        (
            r#"{"start": [1, 1], "obstacles": [{"x": 8, "y": 1, "r": 1}, {"x": 1.2, "y": 1, "r": 1}]}"#,
            "inside obstacles[1]",
        ),
        (r#"{"start": [1, 1], "walls": [{"x0": 0, "y0": 1.1, "x1": 3, "y1": 1.1, "r": 0.3}]}"#, "inside walls[0]"),
    ] {
        let (code, _, said) = flown(scenario);
        assert!(code == Some(2) && said.contains(named) && said.contains("start = [1, 1]"), "{scenario}: {said}");
    }
    let (code, report, said) = flown(r#"{"start": [1, 1], "obstacles": [{"x": 1, "y": 0, "r": 0.95}]}"#);
    assert_eq!((code, &report["result"]), (Some(0), &"reached".into()));
    assert!(said.contains("overlapped something by 0.100 m"), "{said}");

    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("suite.json");
    let maps = r#"{"maps": [{"row": 1, "instance": 1, "obstacles": [[1, 1, 0.3]], "pairs": [[5, 1, 9, 9, 9], [1, 1.1, 9, 9, 11]]}]}"#;
    std::fs::write(&path, maps).unwrap();
    let output = run(&["suite", &path.to_string_lossy(), "--json"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("maps[0].pairs[1]") && said.contains("inside obstacles[0]"), "{said}");
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
    let mut autopilot = Program::start(foxhound().args(["autopilot", "--json", "--listen", "tcp:127.0.0.1:0"]));
    let first: Value = serde_json::from_str(&autopilot.lines().next().unwrap().unwrap()).unwrap();
    let address = first["autopilot"].as_str().unwrap();
    let output = run(&["companion", "--autopilot", address, "--source", "8,3,0", "--max-time", "60", "--json"]);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["result"], "reached", "{report}");
    // It was 42 deg.
    assert!(report["bearing_rms_deg"].as_f64().unwrap() < 3.0, "{report}");
}

/// A `companion` that heard nobody tells no distances: they are null, not 0.
#[test]
fn a_companion_that_heard_nobody_tells_no_distances() {
    let companion = ["companion", "--autopilot", "udpin:127.0.0.1:39471", "--source", "8,3,0", "--max-time", "0.5"];
    let output = run(&[&companion[..], &["--json"]].concat());
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((output.status.code(), &report["result"]), (Some(1), &"timeout".into()), "{report}");
    for key in ["to_beacon_m", "straight_line_m", "min_clearance_m", "bearing_rms_deg"] {
        assert_eq!(report.get(key), Some(&Value::Null), "{key}: {report}");
    }
    let text = String::from_utf8(run(&companion).stdout).unwrap();
    assert!(text.contains("path             0.00 m\n"), "{text}");
}

/// `tlog` prints the names of messages beside their numbers.
#[test]
fn messages_of_a_log_have_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("f.tlog").to_string_lossy().into_owned();
    assert!(run(&["fly", "--json", "--tlog", &path]).status.success());
    let text = String::from_utf8(run(&["tlog", &path]).stdout).unwrap();
    for named in ["message 0     HEARTBEAT", "message 84    SET_POSITION_TARGET_LOCAL_NED"] {
        assert!(text.contains(named), "{text}");
    }
    assert!(!text.contains("unknown"), "{text}");
    let printed: Value = serde_json::from_slice(&run(&["tlog", &path, "--json"]).stdout).unwrap();
    assert_eq!((&printed["names"]["0"], printed["counts"]["0"].as_u64().is_some()), (&"HEARTBEAT".into(), true));
}

/// An incomplete last group of `--looks` frames is an error.
#[test]
fn frames_that_make_no_group_of_looks_are_an_error() {
    for (looks, why) in [("99", "4 frames make no group of 99"), ("3", "the last")] {
        let text = refusal(&format!("{ARRAY}{SIDE}"), &["--looks", looks]);
        assert!(text.contains(&format!("--looks {looks}: {why}")) && text.contains("4 frames"), "{text}");
    }
}
