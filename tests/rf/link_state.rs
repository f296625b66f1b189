//! The link state's classifier on fresh scenes, and its training, through the command line.

use foxhound_tests::{number, root, run, run_json};
use serde_json::Value;

/// Counts, rates and intervals of an outcome agree with one another.
fn check(outcome: &Value, counts: &Value) {
    let mut balanced = 0.0;
    for class in 0..4 {
        let cell = |truth: usize, answer: usize| number(outcome, &format!("/confusion/{truth}/{answer}"));
        let there: f64 = (0..4).map(|answer| cell(class, answer)).sum();
        assert_eq!(there, number(counts, &format!("/{class}")), "{outcome}");
        assert!(there > 300.0, "class {class} hardly occurs");
        let recall = cell(class, class) / there;
        assert!((number(outcome, &format!("/recall/{class}")) - recall).abs() < 1e-12, "{outcome}");
        balanced += recall / 4.0;
    }
    assert!((number(outcome, "/balanced_accuracy") - balanced).abs() < 1e-12, "{outcome}");
    let [low, high] = ["0", "1"].map(|end| number(outcome, &format!("/balanced_accuracy_95/{end}")));
    assert!(low < balanced && balanced < high && high - low < 0.10, "{outcome}");
}

/// On new scenes the classifier is better than the best thresholds on the signal level, with 95 % confidence.
#[test]
fn fresh_scenes_are_told_apart_better_than_the_level_alone_can_with_its_best_thresholds() {
    let arguments = ["link-state", "--json", "--seed", "4711", "--scenes", "500"];
    let (status, report) = run_json(&arguments);
    assert_eq!(status, 0);
    let [blind, mapped, baseline] = ["without_map", "with_map", "baseline"].map(|key| &report[key]);
    for outcome in [blind, mapped, baseline] {
        check(outcome, &report["class_counts"]);
    }
    // Lower ends of 95 % intervals.
    assert!(number(blind, "/balanced_accuracy_95/0") > 0.62, "{blind}");
    assert!(number(mapped, "/balanced_accuracy_95/0") > 0.64, "{mapped}");
    assert!(number(blind, "/above_baseline_95/0") > 0.01, "{blind}");
    assert!(number(mapped, "/above_baseline_95/0") > 0.03, "{mapped}");
    assert!(number(mapped, "/balanced_accuracy") > number(blind, "/balanced_accuracy"), "a map helps");
    for outcome in [blind, mapped] {
        assert!(number(outcome, "/line_of_sight_balanced") > 0.75, "{outcome}");
        assert!(number(outcome, "/recall/3") > 0.9, "silence is heard: {outcome}");
        assert!(number(outcome, "/clear_balanced") > number(outcome, "/balanced_accuracy"), "{outcome}");
    }
    assert_eq!(run_json(&arguments).1, report, "the same seed, the same scenes");
}

/// Training again gives the weights in the repository, byte for byte.
#[test]
fn training_anew_gives_the_weights_of_the_repository_byte_for_byte() {
    let repository = root().to_string_lossy().into_owned();
    let (status, report) = run_json(&["link-state", "--check", "--json", "--repository", &repository]);
    assert_eq!(status, 0, "foxhound link-state --train renews them: {report}");
    // What is in the core now does as well as what was trained.
    let scenes = report["scenes"].to_string();
    let (_, own) = run_json(&["link-state", "--json", "--scenes", &scenes]);
    assert_eq!(own, report);
}

/// A folder that is not the repository is refused.
#[test]
fn another_folder_is_no_repository() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(&["link-state", "--check", "--repository", &folder.path().to_string_lossy()]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("weights.rs"), "{text}");
}
