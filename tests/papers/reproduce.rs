//! `foxhound reproduce apf-density` and `apf-variants`, through the command line.

use foxhound_tests::{number, run_json};
use serde_json::Value;

const PLANNERS: [&str; 5] = ["standard", "paper", "standard_full_loop", "paper_full_loop", "ours"];

fn density(pairs: &str, extra: &[&str]) -> Value {
    let (status, report) = run_json(&[&["reproduce", "apf-density", "--pairs", pairs, "--json"], extra].concat());
    assert_eq!(status, 0);
    report
}

/// The Wilson interval with `z = 1.96`, by the textbook's other form: the roots of `(p - rate)^2 = z^2 p (1 - p) / n`.
fn wilson(success: f64, runs: f64) -> [f64; 2] {
    let z2 = 1.96_f64 * 1.96;
    let (a, b, c) = (1.0 + z2 / runs, -(2.0 * success + z2) / runs, (success / runs).powi(2));
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)]
}

/// Counts, rate and interval of one planner agree with one another.
fn check_tally(tally: &Value, runs: f64) {
    let [success, collisions] = ["/success", "/collisions"].map(|pointer| number(tally, pointer));
    assert_eq!(number(tally, "/runs"), runs);
    assert!(success >= 0.0 && collisions >= 0.0 && success + collisions <= runs, "{tally}");
    assert!((number(tally, "/success_rate") - success / runs).abs() < 1e-12, "{tally}");
    for (index, bound) in wilson(success, runs).into_iter().enumerate() {
        let given = number(tally, &format!("/success_rate_95/{index}"));
        assert!((0.0..=1.0).contains(&given) && (given - bound).abs() < 1e-4, "{given} {bound}: {tally}");
    }
}

/// A small comparison of the planners is complete and consistent, and depends on the seed only.
#[test]
fn a_small_comparison_is_complete_and_the_same_again_with_the_same_seed_only() {
    let report = density("10", &[]);
    assert_eq!(report["rows"].as_array().unwrap().len(), 5);
    let printed = [(0.0702, 0.0020), (0.1102, 0.0023), (0.1267, 0.0021), (0.1520, 0.0011), (0.1552, 0.0152)];
    for (row, (mean, variance)) in report["rows"].as_array().unwrap().iter().zip(printed) {
        assert_eq!((number(row, "/mean"), number(row, "/variance")), (mean, variance));
        for planner in PLANNERS {
            check_tally(&row[planner], 10.0);
        }
        assert_eq!(row["printed"]["runs"], 7);
        assert_eq!(row["printed"]["paper"].is_null(), row["map"] != 5, "the paper prints its fifth map's numbers only");
    }
    for planner in PLANNERS {
        check_tally(&report["all"][planner], 50.0);
        let sum: f64 = report["rows"].as_array().unwrap().iter().map(|row| number(&row[planner], "/success")).sum();
        assert_eq!(number(&report["all"][planner], "/success"), sum, "{planner}");
    }
    for reading in report["readings"].as_array().unwrap() {
        check_tally(&reading["standard"], 50.0);
        check_tally(&reading["paper"], 50.0);
    }
    let rate = |planner: &str| number(&report["all"][planner], "/success_rate");
    assert!(rate("ours") > rate("paper") && rate("paper") > rate("standard"));
    assert!(rate("ours") >= rate("standard_full_loop") && rate("ours") >= rate("paper_full_loop"));
    assert_eq!(number(&report["all"]["ours"], "/collisions"), 0.0);
    assert_eq!(density("10", &[]), report);
    assert_ne!(density("10", &["--seed", "2"])["rows"], report["rows"]);
}

/// The figures are written to the folder that is asked for, and nothing else is.
#[test]
fn the_pictures_are_written_where_they_are_asked_for_and_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("new/pictures");
    let _ = density("4", &["--out", &out.to_string_lossy()]);
    let (status, _) = run_json(&["reproduce", "apf-variants", "--json", "--out", &out.to_string_lossy()]);
    assert_eq!(status, 0);
    let mut names: Vec<String> =
        std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    let expected = ["apf-density-map.svg", "apf-density.svg", "apf-variants.svg"];
    assert_eq!(names, expected);
    for name in names {
        let svg = std::fs::read_to_string(out.join(&name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"), "{name}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{name}");
    }
}

/// 100 pairs a row give the success rates that the manual claims, to 1 %.
#[test]
fn a_hundred_pairs_a_row_give_the_numbers_of_the_readme() {
    let report = density("100", &[]);
    let near = |given: f64, percent: f64| assert!((100.0 * given - percent).abs() < 1.0, "{given} {percent}");
    let rate = |planner: &str| number(&report["all"][planner], "/success_rate");
    near(rate("standard"), 32.0);
    near(rate("paper"), 61.0);
    near(rate("standard_full_loop"), 56.0);
    near(rate("paper_full_loop"), 61.0);
    let reading = |name: &str, planner: &str| {
        let readings = report["readings"].as_array().unwrap();
        let found = readings.iter().find(|reading| reading["reading"] == name).unwrap();
        number(&found[planner], "/success_rate")
    };
    near(reading("goal reached within 0.3 m", "standard"), 23.0);
    near(reading("all pillars known", "paper"), 66.0);
    for row in report["rows"].as_array().unwrap() {
        assert!(number(row, "/ours/success_rate") >= 0.99, "{row}");
        assert_eq!(number(row, "/ours/collisions"), 0.0);
    }
}

/// The four potential fields agree with the paper's table in the cells where an independent check does.
#[test]
fn the_four_fields_agree_with_the_printed_table_where_an_independent_check_says_so() {
    let (status, report) = run_json(&["reproduce", "apf-variants", "--json"]);
    assert_eq!(status, 0);
    assert_eq!(run_json(&["reproduce", "apf-variants", "--json"]).1, report);
    let settings = number(&report, "/settings");
    let cell = |start: &str, scene: &str, algorithm: &str| {
        let cells = report[start]["cells"].as_array().unwrap();
        assert_eq!(cells.len(), 16);
        cells.iter().find(|cell| cell["scene"] == scene && cell["algorithm"] == algorithm).unwrap().clone()
    };
    // Exactly on the line no field without a push to the side passes; beside it all of the pure repulsions do.
    for algorithm in ["khatib", "rizqi", "sun"] {
        assert_eq!(number(&cell("printed_start", "one_obstacle", algorithm), "/reaching_settings"), 0.0);
        assert_eq!(number(&cell("beside", "one_obstacle", algorithm), "/reaching_settings"), settings);
    }
    assert!(number(&cell("printed_start", "one_obstacle", "virtual_force"), "/reaching_settings") > 0.0);
    // No gains give the printed table; the optimized field stalls at the pair of obstacles.
    for start in ["printed_start", "beside"] {
        assert_eq!(number(&report[start], "/reproducing_settings"), 0.0);
        assert!(number(&report[start], "/agreeing") < 16.0);
        assert_eq!(cell(start, "two_obstacles", "sun")["agrees"], false);
    }
    assert_eq!(number(&report["beside"], "/agreeing"), 15.0, "the number of the readme");
    let one = cell("beside", "one_obstacle", "khatib");
    assert_eq!(number(&one, "/printed_time_s"), 6.370);
    assert!(number(&one, "/path_length_m") > 21.0 && number(&one, "/time_s") > 6.0, "{one}");
}
