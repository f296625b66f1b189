//! Maps of given obstacle density, and suites of flights on them, through the command line.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeSet;
use std::fs::read_to_string;
use std::path::Path;

use foxhound_tests::{run, run_json, text};
use serde_json::{Value, json};

/// The main paper's Table I: mean and variance.
const TABLE_I: [(f64, f64); 5] =
    [(0.0702, 0.0020), (0.1102, 0.0023), (0.1267, 0.0021), (0.1520, 0.0011), (0.1552, 0.0152)];

fn read_json(path: &Path) -> Value {
    serde_json::from_str(&read_to_string(path).unwrap()).unwrap()
}

/// Writes a suite and flies it.
fn fly(dir: &Path, suite: &Value, extra: &[&str]) -> (i32, Value) {
    let file = dir.join("suite.json");
    std::fs::write(&file, suite.to_string()).unwrap();
    let file = text(&file);
    run_json(&[&["suite", &file, "--json"], extra].concat())
}

/// Two maps: an open one, and one with a goal that is inside a pillar.
fn two_maps() -> Value {
    json!({"max_time_s": 40, "maps": [
        {"row": 1, "instance": 0, "obstacles": [[5.0, 5.6, 0.3], [6.0, 2.0, 0.3]],
         "pairs": [[1.0, 5.0, 9.0, 5.0, 8.02], [1.0, 1.0, 9.0, 1.0, 8.0], [2.0, 2.0, 2.0, 8.0, 6.0]]},
        {"row": 2, "instance": 3, "obstacles": [[7.0, 5.0, 1.2]], "pairs": [[2.0, 5.0, 7.0, 5.0, 5.0]]}]})
}

/// Mean and variance of the covered share of the 100 unit squares, counted on a grid of points 4 mm apart.
fn counted_density(obstacles: &Value) -> (f64, f64) {
    const FINE: usize = 250;
    let side = 10 * FINE;
    let mut covered = vec![false; side * side];
    for pillar in obstacles.as_array().unwrap() {
        let [x, y, r] = [0, 1, 2].map(|k| pillar[k].as_f64().unwrap() * FINE as f64);
        let span = |at: f64| ((at - r).floor().max(0.0) as usize)..((at + r).ceil() as usize + 1).min(side);
        for row in span(y) {
            for column in span(x) {
                let (dx, dy) = (column as f64 + 0.5 - x, row as f64 + 0.5 - y);
                covered[row * side + column] |= dx * dx + dy * dy <= r * r;
            }
        }
    }
    let mut shares = [0.0_f64; 100];
    for (index, _) in covered.iter().enumerate().filter(|(_, is_covered)| **is_covered) {
        shares[index / side / FINE * 10 + index % side / FINE] += 1.0 / (FINE * FINE) as f64;
    }
    let mean = shares.iter().sum::<f64>() / 100.0;
    (mean, shares.iter().map(|share| (share - mean).powi(2)).sum::<f64>() / 100.0)
}

/// `foxhound maps` draws maps with the densities of the main paper's Table I, and describes them correctly.
#[test]
fn maps_have_the_densities_of_table_i_and_are_described_as_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let out = text(dir.path());
    let (code, report) = run_json(&["maps", "--count", "2", "--pairs", "6", "--seed", "11", "--json", "--out", &out]);
    assert_eq!(code, 0);
    let suite = read_json(&dir.path().join("suite.json"));
    let maps = suite["maps"].as_array().unwrap();
    assert_eq!((maps.len(), report["maps"].as_array().unwrap().len()), (10, 10));
    for (map, line) in maps.iter().zip(report["maps"].as_array().unwrap()) {
        let row = map["row"].as_u64().unwrap();
        let (mean, variance) = TABLE_I[row as usize - 1];
        let (counted_mean, counted_variance) = counted_density(&map["obstacles"]);
        assert!((counted_mean - mean).abs() < 5e-4, "row {row}: {counted_mean}");
        assert!((counted_variance - variance).abs() < 5e-4, "row {row}: {counted_variance}");
        assert!((line["mean"].as_f64().unwrap() - counted_mean).abs() < 5e-5);
        assert!((line["variance"].as_f64().unwrap() - counted_variance).abs() < 5e-5);
        for pair in map["pairs"].as_array().unwrap() {
            let [x0, y0, x1, y1, length] = [0, 1, 2, 3, 4].map(|k| pair[k].as_f64().unwrap());
            let straight = (x1 - x0).hypot(y1 - y0);
            assert!(straight >= 4.0 && length >= straight - 1e-6 && length < 2.0 * straight, "{pair}");
        }
    }
    assert!(read_to_string(dir.path().join("maps.svg")).unwrap().contains("<circle"));

    let (code, described) = run_json(&["maps", "--describe", &text(&dir.path().join("suite.json")), "--json"]);
    assert_eq!(code, 0);
    for (drawn, described) in report["maps"].as_array().unwrap().iter().zip(described["maps"].as_array().unwrap()) {
        for key in ["row", "instance", "mean", "variance", "pillars", "pairs"] {
            assert_eq!(drawn[key], described[key], "{key}");
        }
    }
}

/// A seed always draws the same maps; another hull radius changes only the pairs of start and goal.
#[test]
fn a_seed_draws_the_same_maps_every_time_and_another_radius_only_other_pairs() {
    let drawn = |seed: &str, radius: &str| {
        let dir = tempfile::tempdir().unwrap();
        let out = text(dir.path());
        let arguments =
            ["maps", "--row", "4", "--count", "2", "--pairs", "5", "--seed", seed, "--drone-radius", radius];
        let (code, _) = run_json(&[&arguments[..], &["--json", "--out", &out]].concat());
        assert_eq!(code, 0);
        read_json(&dir.path().join("suite.json"))
    };
    let first = drawn("3", "0.15");
    assert_eq!(first, drawn("3", "0.15"));
    assert_ne!(first["maps"], drawn("4", "0.15")["maps"]);
    let wider = drawn("3", "0.2");
    assert_eq!(wider["drone_radius"], 0.2);
    assert_eq!(first["maps"][1]["obstacles"], wider["maps"][1]["obstacles"]);
    assert_ne!(first["maps"][1]["pairs"], wider["maps"][1]["pairs"]);
}

/// A seed draws the same map on every machine.
#[test]
fn a_seed_draws_the_same_map_on_every_machine() {
    let dir = tempfile::tempdir().unwrap();
    let out = text(dir.path());
    let (code, _) = run_json(&["maps", "--row", "5", "--count", "1", "--pairs", "10", "--json", "--out", &out]);
    assert_eq!(code, 0);
    let suite = read_json(&dir.path().join("suite.json"));
    // Sums of x, y and r of the pillars and of the pairs' coordinates in tenths of a millimetre, of lengths in micrometres.
    let sum = |list: &Value, key: usize, grains: f64| -> i64 {
        list.as_array().unwrap().iter().map(|item| (item[key].as_f64().unwrap() * grains).round() as i64).sum()
    };
    let map = &suite["maps"][0];
    assert_eq!([0, 1, 2].map(|key| sum(&map["obstacles"], key, 1e4)), [4_480_781, 5_043_188, 207_523]);
    assert_eq!([0, 1, 2, 3].map(|key| sum(&map["pairs"], key, 1e4)), [548_682, 459_878, 497_176, 421_287]);
    assert_eq!(sum(&map["pairs"], 4, 1e6), 82_737_275);
}

/// The result of a suite does not depend on how many flights run in parallel.
#[test]
fn a_suite_comes_to_the_same_however_many_flights_are_flown_at_a_time() {
    let dir = tempfile::tempdir().unwrap();
    let out = text(dir.path());
    let (code, _) = run_json(&["maps", "--count", "1", "--pairs", "3", "--json", "--out", &out]);
    assert_eq!(code, 0);
    let suite = text(&dir.path().join("suite.json"));
    let flown = |jobs: &str| {
        let to = text(&dir.path().join(jobs));
        let output = run(&["suite", &suite, "--json", "--jobs", jobs, "--out", &to]);
        (output.status.code(), output.stdout, read_to_string(dir.path().join(jobs).join("flights.jsonl")).unwrap())
    };
    let alone = flown("1");
    assert_eq!(alone.2.lines().count(), 15);
    assert_eq!(alone, flown("5"));
}

/// The report of a suite has the documented fields, and its counts are those of its flights.
#[test]
fn the_report_has_the_fields_of_the_interface_and_its_counts_are_those_of_the_flights() {
    let dir = tempfile::tempdir().unwrap();
    let out = text(dir.path());
    let (code, report) = fly(dir.path(), &two_maps(), &["--out", &out]);
    assert_eq!(code, 1, "a goal inside a pillar cannot be reached: {report}");
    let flights: Vec<Value> = read_to_string(dir.path().join("flights.jsonl"))
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(flights.len(), 4);
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.iter().map(|row| row["row"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 2]);
    for sums in rows.iter().chain([&report["all"]]) {
        let mine: Vec<&Value> =
            flights.iter().filter(|flight| sums["row"].is_null() || flight["row"] == sums["row"]).collect();
        let reached: Vec<&&Value> = mine.iter().filter(|flight| flight["result"] == "reached").collect();
        assert_eq!(sums["runs"], mine.len());
        assert_eq!(sums["success"], reached.len());
        assert_eq!(sums["collisions"], mine.iter().filter(|flight| flight["result"] == "collision").count());
        let number = |flight: &Value, key: &str| flight[key].as_f64().unwrap();
        let least = mine.iter().map(|flight| number(flight, "min_clearance_m")).fold(f64::INFINITY, f64::min);
        assert_eq!(sums["min_clearance_m"], least);
        match sums["mean_length_ratio"].as_f64() {
            None => assert!(reached.is_empty()),
            Some(mean) => {
                let ratio = |flight: &&&Value| number(flight, "path_length_m") / number(flight, "reference_length_m");
                let expected = reached.iter().map(ratio).sum::<f64>() / reached.len() as f64;
                assert!((mean - expected).abs() < 1e-12);
            }
        }
    }
    assert_eq!((&rows[0]["success"], &rows[1]["success"]), (&json!(3), &json!(0)));
    assert_eq!(report["all"]["collisions"], 0);
}

/// A suite in which every goal is reached ends with exit code 0, and rows and pairs can be selected.
#[test]
fn reaching_every_goal_is_exit_code_zero_and_rows_and_pairs_can_be_picked() {
    let dir = tempfile::tempdir().unwrap();
    let (code, report) = fly(dir.path(), &two_maps(), &["--only", "1"]);
    assert_eq!((code, &report["all"]["runs"]), (0, &json!(3)));
    let (_, report) = fly(dir.path(), &two_maps(), &["--pairs", "1"]);
    assert_eq!(report["all"]["runs"], 2);
    let (_, report) = fly(dir.path(), &two_maps(), &["--only", "1,0", "--pairs", "2"]);
    assert_eq!(report["all"]["runs"], 2);
}

/// A flight of a suite is the same as the flight that `foxhound fly` makes of it.
#[test]
fn a_flight_of_a_suite_is_the_one_that_fly_flies() {
    let dir = tempfile::tempdir().unwrap();
    let out = text(dir.path());
    let changes = ["--bearing-sigma-deg", "4", "--drone-radius", "0.2", "--vehicle", "arducopter", "--seed", "5"];
    let only = ["--only", "1,0,1", "--out", &out];
    fly(dir.path(), &two_maps(), &[&changes[..], &only].concat());
    let flight = read_json(&dir.path().join("flights.jsonl"));
    let path = dir.path().join("flight-1-0-1.json");
    let scenario = read_json(&path);
    assert_eq!(scenario["bearing"]["sigma_deg"], 4.0);
    assert_eq!((&scenario["drone_radius"], &scenario["vehicle"]["model"]), (&json!(0.2), &json!("arducopter")));
    let seed = flight["seed"].to_string();
    let (_, again) = run_json(&["fly", "--json", "--scenario", &text(&path), "--seed", &seed]);
    for key in ["trace_hash", "path_length_m", "time_s", "min_clearance_m", "result"] {
        assert_eq!(again[key], flight[key], "{key}");
    }
    assert!(read_to_string(dir.path().join("flight-1-0-1.svg")).unwrap().contains("<svg"));
    // The whole suite flies it with the same seed.
    fly(dir.path(), &two_maps(), &[&changes[..], &["--only", "1", "--out", &out, "--force"]].concat());
    let lines = read_to_string(dir.path().join("flights.jsonl")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(lines.lines().nth(1).unwrap()).unwrap(), flight);
}

/// Every flight of a suite has its own seed.
#[test]
fn every_flight_has_a_seed_of_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let out = text(dir.path());
    // The same pair many times over, on two maps alike.
    let pairs = vec![json!([4.0, 4.0, 5.0, 5.0, 1.4]); 20];
    let maps: Vec<Value> =
        (0..2).map(|k| json!({"row": 1, "instance": k, "obstacles": [], "pairs": pairs.clone()})).collect();
    let (code, report) = fly(dir.path(), &json!({"maps": maps}), &["--out", &out]);
    assert_eq!(code, 0);
    assert_eq!(report["all"]["min_clearance_m"], Value::Null, "there are no pillars");
    let lines = read_to_string(dir.path().join("flights.jsonl")).unwrap();
    let hashes: BTreeSet<String> =
        lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()["trace_hash"].to_string()).collect();
    assert_eq!(hashes.len(), 40);
}
