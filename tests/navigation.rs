//! Never stuck, never hit: traps, and pillar forests of the main paper's densities, flown with bearings alone.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_tests::{root, run_json};
use serde_json::Value;

/// Every file of `tests/traps`, flown with `seeds` seeds, ends as it says, without a collision.
#[test]
fn every_trap_ends_as_it_should_for_twenty_of_twenty_seeds() {
    let mut files: Vec<_> = std::fs::read_dir(root().join("tests/traps")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 22);
    let fly = |file: &std::path::PathBuf| {
        let path = file.to_string_lossy().into_owned();
        let expect = serde_json::from_str::<Value>(&std::fs::read_to_string(file).unwrap()).unwrap()["expect"].clone();
        for seed in 0..20 {
            let (_, report) = run_json(&["fly", "--json", "--scenario", &path, "--seed", &seed.to_string()]);
            assert_eq!(report["result"], expect["result"], "{path} seed {seed}: {report}");
            assert_eq!(report["collisions"], 0, "{path} seed {seed}: {report}");
            if let Some(reason) = expect.get("reason") {
                assert_eq!(&report["reason"], reason, "{path} seed {seed}: {report}");
                let within_s = expect["within_s"].as_f64().unwrap_or(60.0);
                assert!(report["time_s"].as_f64().unwrap() < within_s, "{path} seed {seed}: {report}");
            }
        }
    };
    let half = files.len().div_ceil(2);
    std::thread::scope(|scope| {
        let workers: Vec<_> = files.chunks(half).map(|part| scope.spawn(move || part.iter().for_each(fly))).collect();
        workers.into_iter().for_each(|worker| worker.join().unwrap());
    });
}

/// A suite of Table I's five densities, four maps each, `pairs` pairs a map.
fn suite(dir: &std::path::Path, seed: &str, pairs: &str, radius: &str) -> String {
    let out = dir.to_string_lossy().into_owned();
    let arguments = ["maps", "--json", "--seed", seed, "--pairs", pairs, "--drone-radius", radius, "--out", &out];
    assert_eq!(run_json(&arguments).0, 0);
    dir.join("suite.json").to_string_lossy().into_owned()
}

fn check(suite: &str, extra: &[&str], success: f64, ratio: f64) {
    let (_, report) = run_json(&[&["suite", suite, "--json"], extra].concat());
    let all = &report["all"];
    let rate = |row: &Value| row["success"].as_f64().unwrap() / row["runs"].as_f64().unwrap();
    assert!(rate(all) >= success, "{extra:?}: {report}");
    assert!(report["rows"].as_array().unwrap().iter().all(|row| rate(row) >= 0.99), "{extra:?}: {report}");
    assert_eq!(all["collisions"], 0, "{extra:?}: {report}");
    assert!(all["min_clearance_m"].as_f64().unwrap() >= 0.02, "{extra:?}: {report}");
    assert!(all["mean_whole_length_ratio"].as_f64().unwrap() <= ratio, "{extra:?}: {report}");
}

#[test]
fn eight_hundred_flights_through_pillar_forests_all_arrive_and_none_touches() {
    let dir = tempfile::tempdir().unwrap();
    let suite = suite(dir.path(), "31", "40", "0.15");
    check(&suite, &[], 0.9975, 1.06);
    check(&suite, &["--bearing-sigma-deg", "5"], 0.995, 1.06);
    check(&suite, &["--bearing-sigma-deg", "20"], 0.99, 1.10);
    check(&suite, &["--vehicle", "arducopter"], 0.99, 1.06);
    check(&suite, &["--snr-db", "20", "--pairs", "10"], 0.9975, 1.06);
}

#[test]
fn a_wider_hull_arrives_as_well() {
    let dir = tempfile::tempdir().unwrap();
    check(&suite(dir.path(), "32", "40", "0.20"), &[], 0.995, 1.06);
}
