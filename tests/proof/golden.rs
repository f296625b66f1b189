//! Golden traces: every bearing, plan and setpoint of these flights, folded into one hash each.
//!
//! A change that means to alter flights renews the table:
//! `INSTA_UPDATE=always cargo test -p foxhound-tests --test proof golden`, and shows it in its diff.

use std::fmt::Write as _;

use foxhound_tests::{files, root, run_json, text};

/// A set of flights gives the recorded results and trace hashes, bit for bit.
#[test]
fn flights_are_the_ones_on_record() {
    let files = files(&root().join("tests/scenarios"), "json");
    let mut table = String::new();
    let mut fly = |name: &str, arguments: &[&str]| {
        let (_, report) = run_json(&[&["fly", "--json"], arguments].concat());
        let word = |field: &str| report[field].as_str().unwrap().to_owned();
        let number = |field: &str| report[field].as_f64().map_or("-".to_owned(), |n| format!("{n:.2}"));
        writeln!(
            table,
            "{name:<24} {:<8} {:<17} {:>6} s {:>6} m, clearance {:>5} m  {}",
            word("result"),
            word("reason"),
            number("time_s"),
            number("path_length_m"),
            number("min_clearance_m"),
            word("trace_hash"),
        )
        .unwrap();
    };
    for seed in ["1", "2", "3"] {
        fly(&format!("built-in, seed {seed}"), &["--seed", seed]);
    }
    fly("built-in, paper planner", &["--planner", "paper"]);
    fly("built-in, plain field", &["--planner", "standard"]);
    for file in files {
        let name = file.file_stem().unwrap().to_string_lossy().replace('_', " ");
        fly(&name, &["--scenario", &text(&file)]);
    }
    insta::assert_snapshot!(table);
}
