//! Looking for a transmitter indoors: filters against the raw angle of arrival.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_tests::{number, run, run_json};
use serde_json::Value;

const SCENARIOS: &str = "60";

fn report(more: &[&str]) -> Value {
    let mut arguments = vec!["reproduce", "mmwave", "--json", "--scenarios", SCENARIOS];
    arguments.extend(more);
    let (status, report) = run_json(&arguments);
    assert_eq!(status, 0);
    report
}

/// An agent's row at a noise.
fn row(report: &Value, noise: usize, agent: &str) -> Value {
    let rows = report["noises"][noise]["agents"].as_array().unwrap();
    rows.iter().find(|row| row["agent"] == agent).unwrap().clone()
}

/// With noise, our filters find at least as many transmitters as following the raw angle, on shorter paths.
#[test]
fn filters_find_more_transmitters_on_shorter_ways_than_the_raw_angle_of_arrival() {
    let folder = tempfile::tempdir().unwrap();
    let report = report(&["--out", folder.path().to_str().unwrap()]);
    assert_eq!(number(&report, "/scenarios"), 60.0);
    let noisy = &report["noises"][1];
    assert_eq!((number(noisy, "/sigma_rad"), number(noisy, "/link_error_rate")), (0.35, 0.0));
    let [reference, baseline, ours] = ["reference", "follow", "estimate"].map(|agent| row(&report, 1, agent));
    for class in baseline["classes"].as_array().unwrap() {
        assert_eq!(number(class, "/scenarios"), 20.0);
    }
    // The navigation that all share finds every transmitter whose place it is told.
    assert_eq!(number(&reference, "/success_rate_unlimited"), 1.0);
    // The limit is where the baseline finds what is printed of it.
    let rate = |row: &Value| number(row, "/success_rate");
    assert!((0.895..0.97).contains(&rate(&baseline)), "{baseline}");
    // Sixty scenarios show the direction, not the paper's five points: their 95 % intervals are twice as wide.
    assert!(rate(&ours) >= rate(&baseline), "{ours} {baseline}");
    assert!(number(&ours, "/relative_length") < 1.0, "{ours}");
    let higher = &ours["classes"][2];
    assert!(higher["start"] == "higher_order" && number(higher, "/relative_length") <= 0.85, "{higher}");
    // Nobody is quicker than who knows.
    assert!(number(&reference, "/relative_length") < number(&ours, "/relative_length"));
    // Without noise the filters lose nothing.
    let free = row(&report, 0, "estimate");
    assert!(number(&free, "/success_rate_unlimited") >= 0.95 && number(&free, "/relative_length") <= 0.8, "{free}");
    for name in ["mmwave-noise-free.svg", "mmwave-noisy.svg", "mmwave-map.svg"] {
        let svg = std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{name}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{name}");
    }
}

/// The same seed gives the same output, and another seed another one.
#[test]
fn the_seed_decides_everything() {
    let few = |seed: &str| run(&["reproduce", "mmwave", "--json", "--scenarios", "6", "--seed", seed]).stdout;
    let one = few("5");
    assert!(!one.is_empty());
    assert_eq!(few("5"), one);
    assert_ne!(few("6"), one);
}
