//! `scenarios/`: every file matches its schema, and ends as it says.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::{Path, PathBuf};

use foxhound_tests::{in_parallel, piped_through, refused, root, run, run_json};
use serde_json::{Value, json};

/// Seeds of each scenario: 1 to this.
const SEEDS: usize = 10;

fn files(folder: &str) -> Vec<PathBuf> {
    let mut files = foxhound_tests::files(&root().join(folder), "json");
    files.retain(|path| !path.ends_with("scenario.schema.json"));
    files
}

fn read(path: &PathBuf) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// What Python's jsonschema has against each document; nothing where it is valid.
fn complaints(documents: &[Value]) -> Vec<String> {
    let schema = root().join("scenarios/scenario.schema.json");
    let lines: String = documents.iter().map(|document| format!("{document}\n")).collect();
    let said = String::from_utf8(piped_through("check_schema.py", &[schema], lines.into_bytes())).unwrap();
    let complaints: Vec<String> = said.lines().map(str::to_owned).collect();
    assert_eq!(complaints.len(), documents.len(), "{said}");
    complaints
}

/// `scenarios/scenario.schema.json` is what `foxhound schema` prints.
#[test]
fn the_schema_is_the_one_that_the_program_prints() {
    let printed = run(&["schema"]);
    let file = std::fs::read_to_string(root().join("scenarios/scenario.schema.json")).unwrap();
    assert_eq!(String::from_utf8_lossy(&printed.stdout), file, "foxhound schema > scenarios/scenario.schema.json");
}

/// Every scenario is valid against the schema.
#[test]
#[ignore = "needs the Python package jsonschema: cargo xtask test"]
fn every_scenario_is_valid_against_the_schema() {
    let all: Vec<PathBuf> = ["scenarios", "tests/scenarios", "tests/traps"].into_iter().flat_map(files).collect();
    assert!(all.len() > 50, "{}", all.len());
    let documents: Vec<Value> = all.iter().map(read).collect();
    for (path, complaint) in all.iter().zip(complaints(&documents)) {
        assert_eq!(complaint, "", "{}", path.display());
    }
}

/// What the program refuses in a scenario, the schema refuses too.
#[test]
#[ignore = "needs the Python package jsonschema: cargo xtask test"]
fn what_the_reader_refuses_the_schema_refuses_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.json");
    let scenarios = [
        json!({"gaol": [1, 1]}),
        json!({"goal": [1]}),
        json!({"start": [1, 2, 3]}),
        json!({"start": "here"}),
        json!({"obstacles": [{"x": 1, "y": 1}]}),
        json!({"obstacles": [[1, 2, 3]]}),
        json!({"people": [{"route": [[5, 5]], "heading_deg": 0, "group": 0}]}),
        json!({"people": [{"route": [[5, 5, 5]]}]}),
        json!({"walls": [{"x0": 1, "y0": 1, "x1": 2}]}),
        json!({"sensor": {"model": "sonar"}}),
        json!({"sensor": {"fov_deg": 361}}),
        json!({"vehicle": {"autopilot": "betaflight"}}),
        json!({"wind": {"gust": 1}}),
        json!({"wind": {"gust_s": 0}}),
        json!({"position": {"drift_m": -1}}),
        json!({"bearing": {"snr_db": 20, "pulses": {"period_s": 1}}}),
        json!({"bearing": {"snr_db": 20}, "other_beacons": [{"x": 1, "y": 1}]}),
        json!({"random": {"count": 1.5}}),
        json!({"limits": {"v_max": "fast"}}),
        json!({"max_time_s": 0}),
        json!([]),
    ];
    for (scenario, complaint) in scenarios.iter().zip(complaints(&scenarios)) {
        assert_ne!(complaint, "", "{scenario}");
        std::fs::write(&path, scenario.to_string()).unwrap();
        let _ = refused(&["fly", "--json", "--scenario", path.to_str().unwrap()]);
    }
}

/// Every scenario says why it exists, and the library has one of each kind.
#[test]
fn every_scenario_says_why_it_is_there_and_the_library_has_one_of_each_kind() {
    let list = std::fs::read_to_string(root().join("scenarios/README.md")).unwrap();
    let mut all = String::new();
    for path in files("scenarios") {
        let scenario = read(&path);
        let (stem, why) = (path.file_stem().unwrap().to_str().unwrap(), scenario["why"].as_str().unwrap());
        assert!(why.len() > 40 && why.ends_with('.'), "{stem}: {why}");
        assert!(list.contains(&format!("- [{stem}]({stem}.json): {why}\n")), "README.md: {stem}");
        assert_eq!(scenario["$schema"], "scenario.schema.json", "{stem}");
        all += &scenario.to_string();
    }
    for kind in [
        "random",
        "walls",
        "reflection_db",
        "wind",
        "gust_mps",
        "noise_m",
        "drift_m",
        "turns_s",
        "people",
        "goal_velocity",
    ]
    .into_iter()
    .chain(["other_beacons", "pulses", "dropout", "outlier", "antenna", "px4"])
    {
        assert!(all.contains(&format!("\"{kind}\"")), "{kind}");
    }
}

/// What the flights of a scenario came to: the result and the reason of each.
fn flown(path: &Path) -> Vec<(String, String)> {
    let fly = |seed: usize| {
        let (_, report) =
            run_json(&["fly", "--json", "--scenario", path.to_str().unwrap(), "--seed", &seed.to_string()]);
        let text = |key: &str| report[key].as_str().unwrap_or_else(|| panic!("{report}")).to_owned();
        (text("result"), text("reason"))
    };
    (1..=SEEDS).map(fly).collect()
}

/// Every scenario ends as its `expect` says, over seeds 1 to 10.
#[test]
fn every_scenario_comes_to_what_it_says() {
    let files = files("scenarios");
    let results = in_parallel(&files, |path| flown(path));
    for (path, came_to) in files.iter().zip(results) {
        let expect = &read(path)["expect"];
        let is_it = |(result, reason): &&(String, String)| {
            expect["result"] == **result && expect.get("reason").is_none_or(|expected| expected == &**reason)
        };
        let share = came_to.iter().filter(is_it).count() as f64 / SEEDS as f64;
        let least = expect.get("least").map_or(1.0, |least| least.as_f64().unwrap());
        assert!(share >= least, "{}: {expect} in {share} of them: {came_to:?}", path.display());
    }
}
