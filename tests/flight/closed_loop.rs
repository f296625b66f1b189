//! The main job, flown through the command line.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_sim::study::seeds;
use foxhound_tests::{root, run_json};
use serde_json::Value;

fn fly(extra: &[&str]) -> (i32, Value) {
    let mut arguments = vec!["fly", "--json"];
    arguments.extend_from_slice(extra);
    run_json(&arguments)
}

/// Flies many argument lists on two threads.
fn fly_all(flights: Vec<Vec<String>>) -> Vec<(i32, Value)> {
    let half = flights.len().div_ceil(2);
    std::thread::scope(|scope| {
        let workers: Vec<_> = flights
            .chunks(half)
            .map(|chunk| {
                scope.spawn(move || {
                    let run = |flight: &Vec<String>| fly(&flight.iter().map(String::as_str).collect::<Vec<_>>());
                    chunk.iter().map(run).collect::<Vec<_>>()
                })
            })
            .collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    })
}

/// The built-in mission reaches the beacon without a collision for 20 of 20 held-out seeds.
#[test]
fn the_built_in_mission_is_reached_without_a_collision_by_twenty_of_twenty_seeds() {
    let flights = seeds::test(20).map(|seed| vec!["--seed".into(), seed.to_string()]).collect();
    for (seed, (code, report)) in seeds::test(20).zip(&fly_all(flights)) {
        assert_eq!((*code, report["result"].as_str()), (0, Some("reached")), "seed {seed}: {report}");
        assert_eq!((&report["collisions"], &report["reason"]), (&0.into(), &"nominal".into()), "seed {seed}: {report}");
        assert!(report["min_clearance_m"].as_f64().unwrap() > 0.0, "seed {seed}: {report}");
        // The Cramer-Rao bound at 20 dB is 0.142 deg for a source level with the array.
        assert!(report["bearing_rms_deg"].as_f64().unwrap() < 0.2, "seed {seed}: {report}");
    }
}

/// The same seed gives the same trace hash, and another seed another one.
#[test]
fn the_same_seed_gives_the_same_trace_and_another_seed_another() {
    let hash = |seed: &str| fly(&["--seed", seed]).1["trace_hash"].as_str().unwrap().to_string();
    let first = hash("5");
    assert_eq!(first, hash("5"));
    assert_ne!(first, hash("6"));
    assert_eq!(first.len(), 16);
}

/// Every scenario in `tests/scenarios` ends with the result that it expects.
#[test]
fn every_scenario_ends_as_it_expects() {
    let mut flights = Vec::new();
    let mut expected = Vec::new();
    let mut files: Vec<_> =
        std::fs::read_dir(root().join("tests/scenarios")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for file in files {
        let scenario: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
        for seed in seeds::test(4) {
            let path = file.to_string_lossy().into_owned();
            flights.push(vec!["--scenario".into(), path.clone(), "--seed".into(), seed.to_string()]);
            expected.push((path, seed, scenario["expect"].clone()));
        }
    }
    assert!(flights.len() >= 24);
    let mut ways = std::collections::BTreeMap::<_, Vec<f64>>::new();
    for ((code, report), (file, seed, expect)) in fly_all(flights).iter().zip(&expected) {
        assert_eq!(report["result"], expect["result"], "{file} seed {seed}: {report}");
        if let Some(reason) = expect.get("reason") {
            assert_eq!(&report["reason"], reason, "{file} seed {seed}: {report}");
        }
        assert_eq!(report["collisions"], 0, "{file} seed {seed}: {report}");
        assert_eq!(*code == 0, report["result"] == "reached", "{file} seed {seed}: {report}");
        if report["result"] == "reached" {
            let length = report["path_length_m"].as_f64().unwrap();
            let straight = report["straight_line_m"].as_f64().unwrap();
            assert!(length > straight - 1.0 && length < 4.0 * straight, "{file} seed {seed}: {report}");
            ways.entry(file).or_default().push(length / straight);
        }
    }
    // One that has to search may look into the wrong end first, and go farther than the others.
    for (file, mut ways) in ways {
        ways.sort_by(f64::total_cmp);
        assert!(ways[ways.len() / 2 - 1] < 2.0, "{file}: {ways:?} times the straight line");
    }
}

/// The JSON report of a flight has exactly the documented fields.
#[test]
fn the_report_has_every_field_of_the_interface_and_no_others_by_surprise() {
    let (_, report) = fly(&["--seed", "1"]);
    for field in [
        "result",
        "reason",
        "time_s",
        "path_length_m",
        "straight_line_m",
        "min_clearance_m",
        "collisions",
        "replans",
        "bearing_rms_deg",
        "trace_hash",
    ] {
        assert!(!report[field].is_null(), "{field} is missing in {report}");
    }
}

/// A source at a known position is flown to directly, whatever the bearings say.
#[test]
fn a_source_whose_place_is_known_is_flown_to_straight_whatever_the_bearings_say() {
    let dir = tempfile::tempdir().unwrap();
    let mut lengths_m = Vec::new();
    for only in [true, false] {
        let file = dir.path().join("known.json");
        let scenario = serde_json::json!({"goal": [8, 4], "bearing": {"only": only, "sigma_deg": 40}});
        std::fs::write(&file, scenario.to_string()).unwrap();
        for seed in ["1", "2", "3"] {
            let (code, report) = fly(&["--seed", seed, "--scenario", &file.to_string_lossy()]);
            assert_eq!(code, 0, "{report}");
            lengths_m.push(report["path_length_m"].as_f64().unwrap());
        }
    }
    let straight_m = 80.0_f64.sqrt() - 0.5;
    assert!(lengths_m[3..].iter().all(|length_m| *length_m < 1.03 * straight_m), "{lengths_m:?}");
    assert!(lengths_m[..3].iter().sum::<f64>() > 1.02 * lengths_m[3..].iter().sum::<f64>(), "{lengths_m:?}");
}

/// Every planner can be selected by name, and an unknown name is refused with the list.
#[test]
fn every_planner_flies_by_its_name_and_another_name_is_refused_with_the_list() {
    let open_field = root().join("tests/scenarios/open_field.json").to_string_lossy().into_owned();
    let mut hashes = std::collections::BTreeSet::new();
    for name in foxhound_papers::apf::NAMES {
        let (code, report) = fly(&["--planner", name, "--scenario", &open_field]);
        assert_eq!((code, report["result"].as_str()), (0, Some("reached")), "{name}: {report}");
        let forest = fly(&["--planner", name]).1;
        assert_eq!(forest["collisions"], 0, "{name}: {forest}");
        hashes.insert(forest["trace_hash"].to_string());
    }
    // Sun's factor to the power of zero is Khatib's field, and Rizqi's is another only in its core, where the guard does not
    // let the vehicle go.
    assert_eq!(hashes.len(), foxhound_papers::apf::NAMES.len() - 2);
    let output = foxhound_tests::run(&["fly", "--planner", "astar"]);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && error.contains("virtual_force"), "{error}");
}
