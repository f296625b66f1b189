//! `foxhound reproduce stretch`: the numbers of the rotating vehicle's paper, and ours, through the command line.

use std::sync::OnceLock;

use foxhound_tests::{number, run_json};
use serde_json::Value;

const TRIALS: &str = "150";

/// The report of 150 trials a row, run once.
fn report() -> &'static Value {
    static REPORT: OnceLock<Value> = OnceLock::new();
    REPORT.get_or_init(|| {
        let (status, report) = run_json(&["reproduce", "stretch", "--trials", TRIALS, "--json"]);
        assert_eq!(status, 0);
        report
    })
}

fn row(p: f64, sigma_deg: f64) -> Value {
    let near =
        |row: &&Value| (number(row, "/p") - p).abs() < 1e-9 && (number(row, "/sigma_deg") - sigma_deg).abs() < 1e-9;
    report()["rows"].as_array().into_iter().flatten().find(near).cloned().unwrap_or_default()
}

/// The greedy path is as much longer than the straight one as the paper's model says, to 2 %.
#[test]
fn the_greedy_stretch_at_the_papers_condition_is_the_models_and_at_a_third_the_texts() {
    // The standard error of 150 trials is 0.3 % of the mean; 2 % are six of them.
    let there = &row(0.4, 20.0);
    let mean = number(there, "/greedy_stretch/mean");
    assert!(number(there, "/greedy_stretch/standard_error") < 0.004 * mean, "{there}");
    assert!((mean / 1.75 - 1.0).abs() < 0.02, "{there}");
    assert_eq!(number(there, "/paper/mean"), 1.6);
    let third = number(&row(1.0 / 3.0, 20.0), "/greedy_stretch/mean");
    assert!((third - 1.6).abs() < 0.04, "what the text says of 0.4: {third}");
}

/// By the filters that fly the path is less than 5 % longer than the straight one.
#[test]
fn the_filtered_stretch_is_far_below_what_was_asked() {
    let there = &row(0.4, 20.0);
    let [mean, error] = ["mean", "standard_error"].map(|key| number(there, &format!("/filtered_stretch/{key}")));
    assert!(mean + 3.0 * error < 1.05 && mean > 0.98, "{there}");
    let worst = &row(0.6, 60.0);
    assert!(number(worst, "/filtered_stretch/mean") < 1.6 && number(worst, "/greedy_stretch/mean") > 4.0, "{worst}");
}

/// Every row has the documented fields and agrees with the closed form.
#[test]
fn every_row_has_the_shape_of_the_interface_and_agrees_with_the_closed_form() {
    let rows = report()["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 72);
    for row in rows {
        for rule in ["greedy_stretch", "filtered_stretch"] {
            let [mean, std] = ["mean", "std"].map(|key| number(row, &format!("/{rule}/{key}")));
            assert!(mean > 0.98 && std >= 0.0 && row[rule]["given_up"] == 0, "{rule}: {row}");
        }
        let sigma = number(row, "/sigma_deg").to_radians();
        let straight_m = 50.0 * 2.0_f64.sqrt();
        let expected = (1.0 - 1.0 / straight_m) / ((1.0 - number(row, "/p")) * (-0.5 * sigma * sigma).exp());
        assert!((number(row, "/closed_form") / expected - 1.0).abs() < 1e-5, "{row}");
        // The last step overshoots by half its length, and close to the source a step sideways leads away: 0.3 %.
        let [mean, error] = ["mean", "standard_error"].map(|key| number(row, &format!("/greedy_stretch/{key}")));
        assert!((mean - expected).abs() < 4.5 * error + 0.003 * expected, "{row}");
        assert!(number(row, "/filtered_stretch/mean") < mean + 0.003, "{row}");
        assert!(row["paper"].is_object());
    }
}

/// Behind a moving source the filters arrive at least 15 % earlier and stay within half a metre, up to twice as far behind it as the
/// greedy rule.
#[test]
fn behind_a_moving_source_the_filters_arrive_earlier_and_stay_near() {
    let moving = &report()["moving"];
    let rows = moving["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 8);
    for both in rows.chunks(2) {
        let [greedy, filtered] = [&both[0], &both[1]];
        for row in both {
            assert_eq!(row["reaching"], moving["walks"], "{row}");
            assert!(number(row, "/rms_m") < 0.5, "{row}");
        }
        assert!(number(filtered, "/steps_to_reach") < 0.85 * number(greedy, "/steps_to_reach"), "{filtered} {greedy}");
        assert!(number(filtered, "/rms_m") < 2.2 * number(greedy, "/rms_m"), "{filtered} {greedy}");
    }
}

/// The same seed gives the same report, another seed another one, and figures go where they are asked for.
#[test]
fn the_same_seed_repeats_another_does_not_and_pictures_are_where_they_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("pictures");
    let small = |extra: &[&str]| run_json(&[&["reproduce", "stretch", "--trials", "4", "--json"], extra].concat()).1;
    let first = small(&["--out", &out.to_string_lossy()]);
    assert_eq!(small(&[]), first);
    assert_ne!(small(&["--seed", "2"])["rows"], first["rows"]);
    for name in ["stretch.svg", "stretch-histograms.svg", "stretch-moving.svg"] {
        let svg = std::fs::read_to_string(out.join(name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{name}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{name}");
    }
}
