//! Flights by bearings like those of radios on the market: few per second, some of them outliers, with a bias that depends on the place.

use foxhound_sim::study::seeds;
use foxhound_tests::run_json;
use serde_json::{Value, json};

/// Pillar forests of five densities, four maps each, by bearings at 1, 2 and 10 a second, with a sigma of 5 and 10 degrees, 10 % of them from any
/// direction and a bias of 5 degrees at each place: at least 98 % arrive, and none collides. Four pairs a map, 80 flights a setting;
/// `FOXHOUND_PAIRS=40` flies the 800 of `docs/results/radios.md`.
#[test]
fn bearings_of_slow_radios_lead_through_pillar_forests() {
    let dir = tempfile::tempdir().unwrap();
    let pairs = std::env::var("FOXHOUND_PAIRS").unwrap_or_else(|_| "4".to_owned());
    let (out, seed) = (dir.path().to_string_lossy().into_owned(), seeds::TEST.start.to_string());
    let made = ["maps", "--json", "--seed", &seed, "--pairs", &pairs, "--drone-radius", "0.15", "--out", &out];
    assert_eq!(run_json(&made).0, 0);
    let file = dir.path().join("suite.json");
    let mut suite: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    println!("| bearings a second | sigma | flights | reached | collisions | path over reference |");
    let mut failures = Vec::new();
    for rate_hz in [1, 2, 10] {
        for sigma_deg in [5, 10] {
            suite["bearing"] = json!({
                "only": true, "model": "noise", "rate_hz": rate_hz, "sigma_deg": sigma_deg, "place_bias_deg": 5,
                "outlier": {"rate": 0.1, "anywhere": true}
            });
            std::fs::write(&file, suite.to_string()).unwrap();
            let (_, report) = run_json(&["suite", "--json", "--seed", &seed, &file.to_string_lossy()]);
            let all = &report["all"];
            let count = |key: &str| all[key].as_u64().unwrap();
            let (runs, reached, collisions) = (count("runs"), count("success"), count("collisions"));
            let ratio = all["mean_whole_length_ratio"].as_f64().unwrap_or(f64::NAN);
            println!("| {rate_hz} | {sigma_deg} | {runs} | {reached} | {collisions} | {ratio:.2} |");
            assert!(runs >= 80);
            if (reached as f64) < 0.98 * runs as f64 || collisions > 0 {
                failures.push(format!("{rate_hz} Hz, {sigma_deg} deg: {reached} of {runs}, {collisions} collisions"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}
