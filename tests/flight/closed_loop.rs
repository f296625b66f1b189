//! The main job, flown through the command line.

use foxhound_sim::study::seeds;
use foxhound_tests::{files, in_parallel, refused, root, run_json};
use serde_json::Value;

fn fly(extra: &[&str]) -> (i32, Value) {
    run_json(&[&["fly", "--json"], extra].concat())
}

/// Flies many argument lists beside one another.
fn fly_all(flights: &[Vec<String>]) -> Vec<(i32, Value)> {
    in_parallel(flights, |flight| fly(&flight.iter().map(String::as_str).collect::<Vec<_>>()))
}

/// The built-in mission reaches the beacon without a collision for 20 of 20 held-out seeds.
#[test]
fn the_built_in_mission_is_reached_without_a_collision_by_twenty_of_twenty_seeds() {
    let flights: Vec<_> = seeds::test(20).map(|seed| vec!["--seed".into(), seed.to_string()]).collect();
    for (seed, (code, report)) in seeds::test(20).zip(&fly_all(&flights)) {
        assert_eq!((*code, report["result"].as_str()), (0, Some("reached")), "seed {seed}: {report}");
        assert_eq!((&report["collisions"], &report["reason"]), (&0.into(), &"nominal".into()), "seed {seed}: {report}");
        assert!(report["min_clearance_m"].as_f64().unwrap() > 0.0, "seed {seed}: {report}");
        // The Cramer-Rao bound at 20 dB is 0.142 deg for a source level with the array.
        assert!(report["bearing_rms_deg"].as_f64().unwrap() < 0.2, "seed {seed}: {report}");
    }
}

/// Every scenario in `tests/scenarios` ends with the result that it expects.
#[test]
fn every_scenario_ends_as_it_expects() {
    let mut flights = Vec::new();
    let mut expected = Vec::new();
    for file in files(&root().join("tests/scenarios"), "json") {
        let scenario: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
        for seed in seeds::test(4) {
            let path = file.to_string_lossy().into_owned();
            flights.push(vec!["--scenario".into(), path.clone(), "--seed".into(), seed.to_string()]);
            expected.push((path, seed, scenario["expect"].clone()));
        }
    }
    assert!(flights.len() >= 24);
    let mut ways = std::collections::BTreeMap::<_, Vec<f64>>::new();
    for ((code, report), (file, seed, expect)) in fly_all(&flights).iter().zip(&expected) {
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
    let error = refused(&["fly", "--planner", "astar"]);
    assert!(error.contains("virtual_force"), "{error}");
}
