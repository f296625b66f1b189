//! Logs that other tools open: MCAP, CSV, Parquet, telemetry logs. Those tools read them: `cargo xtask test` installs them.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use foxhound_sim::record::table::COLUMNS;
use foxhound_tests::{Autopilot, checked_by, peer_says, refused, root, run_json, text};
use serde_json::{Value, json};

use crate::report::number;

/// Largest MCAP file of the built-in mission.
const MCAP_BYTES: u64 = 3_000_000;
const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// The content of an MCAP file by the makers' reader.
fn look_into(path: &Path) -> Value {
    let said = checked_by("check_mcap.py", &[path, &root().join("docs/foxglove-layout.json")]);
    serde_json::from_str(said.lines().last().unwrap()).unwrap()
}

/// What a program of `tests/peers` says of files, as one JSON object.
fn told(script: &str, files: &[&Path]) -> Value {
    serde_json::from_str(&peer_says(script, files)).unwrap()
}

fn manual() -> String {
    std::fs::read_to_string(root().join("docs/simulator.md")).unwrap()
}

/// Writing an MCAP file does not change the flight, and the file stays below 3 MB.
#[test]
fn watching_a_flight_for_its_file_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("new/flight.mcap");
    let (code, watched) = run_json(&["fly", "--json", "--mcap", path.to_str().unwrap()]);
    assert_eq!((code, &watched), (0, &run_json(&["fly", "--json"]).1));
    let bytes = std::fs::read(&path).unwrap();
    assert!(bytes.starts_with(MAGIC) && bytes.ends_with(MAGIC));
    assert!(bytes.len() as u64 <= MCAP_BYTES, "{} bytes", bytes.len());
}

/// A result that would replace what was read, or another result, is refused, and nothing is written.
#[test]
fn two_options_of_one_file_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let suite = folder.path().join("suite.json");
    let content = three_flights().to_string();
    std::fs::write(&suite, &content).unwrap();
    let [world, other] = ["world.json", "new.csv"].map(|name| folder.path().join(name));
    std::fs::copy(root().join("tests/scenarios/open_field.json"), &world).unwrap();
    let drawn = std::fs::read_to_string(&world).unwrap();
    let [suite, world, other] = [&suite, &world, &other].map(|path| path.to_str().unwrap());
    for arguments in [
        vec!["fly", "--scenario", world, "--report", world],
        vec!["fly", "--params", suite, "--mcap", suite],
        vec!["fly", "--tlog", other, "--flight-log", other],
        vec!["suite", suite, "--csv", suite],
        vec!["suite", suite, "--csv", other, "--parquet", other],
    ] {
        let words = refused(&arguments);
        assert!(words.contains("is also the file of"), "{arguments:?}: {words}");
        assert_eq!(std::fs::read_to_string(suite).unwrap(), content, "{arguments:?}");
        assert_eq!(std::fs::read_to_string(world).unwrap(), drawn, "{arguments:?}");
        assert!(!Path::new(other).exists(), "{arguments:?}");
    }
}

/// The reader by the makers of MCAP reads the file, and finds the flight that was flown.
#[test]
#[ignore = "needs the Python package mcap: cargo xtask test"]
fn the_makers_of_mcap_read_the_flight_that_was_flown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.mcap");
    let (_, printed) = run_json(&["fly", "--json", "--seed", "3", "--mcap", path.to_str().unwrap()]);
    let found = look_into(&path);

    for (name, value) in printed.as_object().unwrap() {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        assert_eq!(found["metadata"]["result"][name], text, "{name}");
    }
    let steps = (number(&printed["time_s"]) / 0.02).round() as u64;
    for topic in ["/tf", "/pose", "/vehicle", "/beacon", "/setpoint", "/outcome", "/guard", "/source"] {
        assert_eq!(found["counts"][topic], steps, "{topic}");
    }
    assert_eq!(found["counts"]["/plan"], printed["replans"]);
    assert!((number(&found["last_s"]) + 0.02 - number(&printed["time_s"])).abs() < 1e-9);
    for (name, within) in [("bearing_rms_deg", 0.005), ("path_length_m", 0.05), ("min_clearance_m", 0.005)] {
        let (found, printed) = (number(&found[name]), number(&printed[name]));
        assert!((found - printed).abs() < within, "{name}: {found}, {printed}");
    }

    // The scenario is in it, and can be flown again.
    let scenario = folder.path().join("scenario.json");
    std::fs::write(&scenario, found["scenario"].to_string()).unwrap();
    let (_, again) = run_json(&["fly", "--json", "--seed", "3", "--scenario", scenario.to_str().unwrap()]);
    assert_eq!(again["trace_hash"], printed["trace_hash"]);

    let manual = manual();
    for topic in found["counts"].as_object().unwrap().keys() {
        assert!(manual.contains(&format!("| `{topic}` |")), "docs/simulator.md has no {topic}");
    }
    assert_eq!(manual.matches("| `/").count(), found["counts"].as_object().unwrap().len());
}

/// `companion` writes an MCAP file of a flight beside an autopilot.
#[test]
#[ignore = "needs the Python package mcap: cargo xtask test"]
fn a_flight_beside_an_autopilot_is_written_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let (path, obstacles) = (folder.path().join("flight.mcap"), folder.path().join("obstacles.json"));
    std::fs::write(&obstacles, r#"{"obstacles":[{"x":1.5,"y":2.1,"r":0.3}]}"#).unwrap();
    let autopilot = Autopilot::start(&[]);
    let flight = ["companion", "--json", "--source=4,3,-5", "--max-time", "60", "--autopilot", &autopilot.address];
    let files = ["--obstacles", &text(&obstacles), "--mcap", &text(&path)];
    let (code, printed) = run_json(&[&flight[..], &files].concat());
    assert_eq!((code, &printed["result"]), (0, &"reached".into()), "{printed}");
    let found = look_into(&path);
    assert_eq!(found["metadata"]["result"]["trace_hash"], printed["trace_hash"]);
    assert!(found["counts"]["/vehicle"].as_u64().unwrap() > 200, "{found}");
}

/// One in the open, one without a reference path, one that cannot end well: in each something is missing.
fn three_flights() -> Value {
    json!({"max_time_s": 40, "maps": [
        {"row": 1, "instance": 0, "obstacles": [],
         "pairs": [[1.0, 5.0, 9.0, 5.0, 8.02], [1.0, 1.0, 9.0, 1.0, 0.0]]},
        {"row": 2, "instance": 3, "obstacles": [[7.0, 5.0, 1.2]], "pairs": [[2.0, 5.0, 7.0, 5.0, 5.0]]}]})
}

/// `PyArrow` reads the CSV and Parquet tables of a suite.
#[test]
#[ignore = "needs the Python package pyarrow: cargo xtask test"]
fn pyarrow_reads_the_tables_of_a_suite() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let text = |name: &str| text(&file(name));
    std::fs::write(file("suite.json"), three_flights().to_string()).unwrap();
    let out = text("");
    let tables = ["--csv", &text("flights.csv"), "--parquet", &text("flights.parquet")];
    let (code, printed) = run_json(&[&["suite", &text("suite.json"), "--json", "--out", &out], &tables[..]].concat());
    assert_eq!((code, &printed["all"]["runs"]), (1, &3.into()), "{printed}");

    let found = told("check_table.py", &[&file("flights.parquet"), &file("flights.csv"), &file("flights.jsonl")]);
    assert_eq!((&found["rows"], &found["columns"]), (&3.into(), &json!(COLUMNS.map(|column| column.name))));
    assert_eq!(found["nulls"], 3, "two without a pillar, one without a reference");
}

/// The manual lists every column of the tables.
#[test]
fn every_column_is_in_the_manual() {
    let manual = manual();
    for column in COLUMNS {
        assert!(manual.contains(&format!("| `{}` | {} |", column.name, column.what)), "{}", column.name);
    }
}

/// pymavlink reads the telemetry log of a flight.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn pymavlink_reads_the_telemetry_log_of_a_flight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.tlog");
    let (code, printed) = run_json(&["fly", "--json", "--tlog", path.to_str().unwrap()]);
    assert_eq!(code, 0, "{printed}");
    checked_by("check_tlog.py", &[&path]);
    let (code, ours) = run_json(&["tlog", path.to_str().unwrap(), "--json"]);
    let theirs = told("read_tlog.py", &[&path]);
    let total: u64 = theirs["counts"].as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum();
    assert_eq!((code, &ours["frames"], &theirs["bad"]), (0, &total.into(), &0.into()), "{ours} {theirs}");
    assert_eq!(theirs["directions"], 2);
    assert!(number(&theirs["last_s"]) <= number(&printed["time_s"]));
}

/// A telemetry log that begins with MAVLink 1 is read frame for frame as pymavlink reads it.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn a_telemetry_log_that_begins_with_mavlink_1_is_read_as_pymavlink_reads_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.tlog");
    let written = told("write_v1_tlog.py", &[&path]);
    let (code, ours) = run_json(&["tlog", path.to_str().unwrap(), "--json"]);
    assert_eq!((code, &ours["bad_crc"], &ours["skipped_bytes"]), (0, &json!(0), &json!(0)), "{ours}");
    assert_eq!((&ours["counts"], &ours["mavlink_1"]), (&written["counts"], &written["mavlink_1"]), "{ours}");
    let theirs = told("read_tlog.py", &[&path]);
    let total: u64 = theirs["counts"].as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum();
    assert_eq!((&ours["frames"], &theirs["bad"]), (&json!(total), &json!(0)), "{ours} {theirs}");
}
