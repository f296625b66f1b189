//! Bad input ends with exit code 2 and a text that names the field; unusual but valid input is flown to an end with a
//! name.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;

use foxhound_tests::{npy, run};
use serde_json::Value;

/// Writes `content` into a file and runs the arguments, in which `{}` stands for its path.
fn refusal(name: &str, content: &[u8], arguments: &[&str]) -> String {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("array.toml"), ARRAY).unwrap();
    let frames = npy("<i2", "(2, 4, 256)", &[0; 2 * 4 * 256 * 2]);
    std::fs::write(dir.path().join("good.npy"), frames).unwrap();
    std::fs::write(dir.path().join(name), content).unwrap();
    let place = |argument: &&str| {
        let path = |file: &str| dir.path().join(file).to_string_lossy().into_owned();
        argument.replace("{}", &path(name)).replace("{array}", &path("array.toml")).replace("{npy}", &path("good.npy"))
    };
    let arguments: Vec<String> = arguments.iter().map(place).collect();
    let output = run(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    assert!(!text.contains("panicked"), "{text}");
    text
}

const ARRAY: &str = "wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0\n";

/// A bad scenario is refused, and the message names the field.
#[test]
fn bad_scenarios_name_the_field() {
    let fly = ["fly", "--json", "--scenario", "{}"];
    for (scenario, field) in [
        (r#"{"drone_radius": -1}"#, "drone_radius"),
        (r#"{"start": [0, "x"]}"#, "start"),
        (r#"{"goal": null}"#, "goal"),
        (r#"{"goal": [1e400, 0]}"#, "goal"),
        (r#"{"obstacles": [{"x": 1, "y": 1, "r": -0.5}]}"#, "obstacles"),
        (r#"{"obstacles": [{"x": 1, "y": 1}]}"#, "r"),
        (r#"{"limits": {"v_max": 0}}"#, "v_max"),
        (r#"{"sensor": {"fov_deg": 400}}"#, "fov_deg"),
        (r#"{"sensor": {"model": "sonar"}}"#, "model"),
        (r#"{"bounds": [10, 10, 0, 0]}"#, "bounds"),
        (r#"{"vehicle": {"model": "bicycle"}}"#, "model"),
        (r#"{"max_time_s": 0}"#, "max_time_s"),
        (r#"{"obstcles": []}"#, "obstcles"),
        (r#"{"drone_radius": 0.15"#, "line 1"),
    ] {
        let text = refusal("scenario.json", scenario.as_bytes(), &fly);
        assert!(text.contains(field), "{scenario}: {text}");
    }
    let text = refusal("scenario.json", br#"{"obstcles": []}"#, &fly);
    assert!(text.contains("obstacles"), "suggests the nearest key: {text}");
}

/// A bad file of samples is refused, and the message says what is wrong.
#[test]
fn bad_frame_files_say_what_is_wrong() {
    let bearing = ["bearing", "--json", "--adc", "{}", "--array", "{array}"];
    for (file, word) in [
        (npy("<f4", "(2, 4, 256)", &[0; 2 * 4 * 256 * 4]), "int16"),
        (npy("<i2", "(2, 3, 256)", &[0; 2 * 3 * 256 * 2]), "shape"),
        (npy("<i2", "(2, 4, 250)", &[0; 2 * 4 * 250 * 2]), "N = 250"),
        (npy("<i2", "(8, 256)", &[0; 8 * 256 * 2]), "shape"),
        (npy("<i2", "(2, 4, 256)", &[0; 2 * 4 * 256 * 2 - 100]), "truncated"),
        (b"not numpy at all".to_vec(), "npy"),
        (Vec::new(), "npy"),
    ] {
        let text = refusal("frames.npy", &file, &bearing);
        assert!(text.contains(word), "{word}: {text}");
    }
}

/// A bad description of the antenna array is refused, and the message names the field.
#[test]
fn bad_arrays_name_the_field() {
    let bearing = ["bearing", "--json", "--adc", "{npy}", "--array", "{}"];
    for (array, field) in [
        ("wavelength_m = 0.345\nside_m = 0.1725\nsample_rate_hz = 102400.0\n", "side_m"),
        ("wavelength_m = -1.0\nside_m = 0.1\nsample_rate_hz = 102400.0\n", "wavelength_m"),
        ("wavelength_m = nan\nside_m = 0.1\nsample_rate_hz = 102400.0\n", "wavelength_m"),
        ("side_m = 0.1\nsample_rate_hz = 102400.0\n", "wavelength_m"),
        ("wavelength_m = 0.345\nsample_rate_hz = 102400.0\n", "side_m"),
        ("wavelength_m = 0.345\nside_m = 0.138\n", "sample_rate_hz"),
        ("wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 0.0\n", "sample_rate_hz"),
        ("wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0\ntone_hz = 90000.0\n", "tone_hz"),
        ("wavelength_m = 0.345\nside_m = \"wide\"\nsample_rate_hz = 102400.0\n", "side_m"),
        ("wavelength_m = 0.345\nsidem = 0.138\nsample_rate_hz = 102400.0\n", "sidem"),
        ("wavelength_m = = 3", "line 1"),
    ] {
        let text = refusal("bad.toml", array.as_bytes(), &bearing);
        assert!(text.contains(field), "{array:?}: {text}");
    }
}

/// Missing files and files that are no firmware image are refused.
#[test]
fn missing_files_and_foreign_images_are_refused() {
    for arguments in [
        &["fly", "--scenario", "does-not-exist.json"][..],
        &["bearing", "--adc", "does-not-exist.npy", "--array", "{array}"],
        &["bearing", "--adc", "{npy}", "--array", "does-not-exist.toml"],
        &["fly", "--via", "qemu:does-not-exist.elf"],
        &["fly", "--via", "carrier-pigeon"],
    ] {
        let text = refusal("unused", b"", arguments);
        let named = arguments.iter().find(|a| a.contains("does-not-exist") || a.contains("carrier")).unwrap();
        let name = Path::new(named.trim_start_matches("qemu:")).file_name().unwrap().to_string_lossy();
        assert!(text.contains(name.as_ref()), "{arguments:?}: {text}");
    }
    let text = refusal("image.elf", b"\x7fELF but no more than that", &["fly", "--via", "qemu:{}"]);
    assert!(text.contains("image.elf"), "{text}");
}

/// What must become of an input.
enum Expected {
    /// Exit code 2 and a text with these words: field, value and range, or field and what is wrong with it.
    Refused(&'static [&'static str]),
    /// It is flown, or drawn, to this result and, unless empty, this reason.
    Ends(&'static str, &'static str),
}

use Expected::{Ends, Refused};

/// Runs a command on each text, two at a time, and hands over what it printed: the text, expectation, exit code, output.
fn run_each(cases: &[(Vec<u8>, Expected)], command: &[&str], check: impl Fn(&str, &Expected, i32, &str, &str) + Sync) {
    let dir = tempfile::tempdir().unwrap();
    let run_one = |index: usize, (text, expected): &(Vec<u8>, Expected)| {
        let file = dir.path().join(format!("case{index}.json"));
        std::fs::write(&file, text).unwrap();
        let output = run(&[command, &[&file.to_string_lossy(), "--json"]].concat());
        let shown: String = String::from_utf8_lossy(text).chars().take(120).collect();
        let (out, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(!errors.contains("panicked"), "{shown}: {errors}");
        let code = output.status.code().unwrap_or(-1);
        if let Refused(words) = expected {
            assert_eq!((code, &*out), (2, ""), "{shown}: {errors}");
            assert!(words.iter().all(|word| errors.contains(word)), "{shown}: {words:?} in {errors}");
            assert!(errors.contains(&format!("case{index}.json")), "{shown}: names the file: {errors}");
            assert!(errors.lines().count() == 1 && errors.len() < 400, "{shown}: {errors}");
        }
        check(&shown, expected, code, &out, &errors);
    };
    std::thread::scope(|scope| {
        for part in 0..2 {
            let run_one = &run_one;
            scope.spawn(move || {
                cases.iter().enumerate().skip(part).step_by(2).for_each(|(index, case)| run_one(index, case));
            });
        }
    });
}

/// A list of so many obstacles.
fn many(count: usize, obstacle: impl Fn(usize) -> String) -> String {
    (0..count).map(obstacle).collect::<Vec<_>>().join(",")
}

/// What is wrong with any document, be it a scenario or a suite.
fn bad_documents() -> Vec<(Vec<u8>, Expected)> {
    let texts: Vec<(&[u8], Expected)> = vec![
        (b"", Refused(&["EOF", "line 1"])),
        (b" \n ", Refused(&["EOF", "line 2"])),
        (b"null", Refused(&["expected an object"])),
        (b"[]", Refused(&["expected an object"])),
        (b"17", Refused(&["expected an object"])),
        (b"drone_radius = 0.15", Refused(&["expected value", "line 1 column 1"])),
        (b"{\"drone_radius\": 0.15", Refused(&["EOF while parsing an object", "line 1"])),
        (b"{\"bounds\": [0, 0,", Refused(&["bounds", "EOF"])),
        (b"{} {}", Refused(&["trailing characters"])),
        (b"\xff\xfe{}", Refused(&["UTF-8"])),
        (b"\xef\xbb\xbf{}", Refused(&["line 1 column 1"])),
        (b"{\"drone_radius\": 0.1, \"drone_radius\": 0.2}", Refused(&["duplicate field `drone_radius`"])),
        (b"{\"drone_radius\": NaN}", Refused(&["drone_radius", "expected value"])),
        (b"{\"drone_radius\": -Infinity}", Refused(&["drone_radius", "invalid number"])),
        (b"{\"drone_radius\": 1e400}", Refused(&["drone_radius", "number out of range"])),
        (b"{\"drone_radius\": 1e308}", Refused(&["drone_radius = 1e308 is outside 0.01..=5"])),
        (b"{\"drone_radius\": -0.15}", Refused(&["drone_radius = -0.15 is outside 0.01..=5"])),
        (b"{\"drone_radius\": \"small\"}", Refused(&["drone_radius", "string \"small\"", "expected f64"])),
        (b"{\"drone_radius\": null}", Refused(&["drone_radius", "null", "expected f64"])),
        (b"{\"bounds\": [10, 10, 0, 0]}", Refused(&["bounds[2] = 0 is outside 10.1..=10000"])),
        (b"{\"bounds\": [0, 0, 10]}", Refused(&["bounds", "length 3", "length 4"])),
        (b"{\"limits\": {\"v_max\": 0}}", Refused(&["limits.v_max = 0 is outside 0.05..=20"])),
        (b"{\"limits\": {\"v_max\": -1}}", Refused(&["limits.v_max = -1 is outside 0.05..=20"])),
        (b"{\"limits\": {\"a_max\": 30}}", Refused(&["limits.a_max = 30 is outside 0.1..=20"])),
        (b"{\"sensor\": {\"fov_deg\": 1}}", Refused(&["sensor.fov_deg = 1 is outside 6..=360"])),
        (b"{\"sensor\": null}", Refused(&["sensor", "expected an object"])),
        (b"{\"bearing\": {\"sigma_deg\": -1}}", Refused(&["bearing.sigma_deg = -1 is outside 0..=180"])),
        (b"{\"bearing\": {\"dropout\": [5, 3]}}", Refused(&["bearing.dropout[1] = 3 is outside 5..=1000000"])),
        (b"{\"bearing\": {\"dropout\": [5]}}", Refused(&["bearing.dropout", "length 1", "length 2"])),
        (b"{\"bearing\": {\"outlier\": {\"rate\": 2}}}", Refused(&["bearing.outlier.rate = 2 is outside 0..=1"])),
        (b"{\"vehicle\": {\"model\": \"kite\"}}", Refused(&["vehicle.model", "`kite`", "`point`"])),
        (b"{\"max_time_s\": 1e9}", Refused(&["max_time_s = 1000000000 is outside 0.1..=3600"])),
        (b"{\"drone_radios\": 0.15}", Refused(&["drone_radios: unknown key", "`drone_radius`"])),
        (b"{\"limits\": {\"vmax\": 1}}", Refused(&["limits.vmax: unknown key", "`v_max`"])),
    ];
    texts.into_iter().map(|(text, expected)| (text.to_vec(), expected)).collect()
}

/// Every unusual scenario is refused by field, value and range, or flown to a result with a name.
#[test]
fn every_strange_scenario_is_refused_by_field_value_and_range_or_flown_to_a_named_end() {
    let far_row = |k: usize| format!(r#"{{"x":{},"y":{},"r":0.3}}"#, 10 + k % 100, k / 100);
    let carpet =
        |k: usize| format!(r#"{{"x":{},"y":{},"r":0.3}}"#, 2.5 + 0.2 * (k % 100) as f64, 0.2 * (k / 100) as f64);
    let same = |_: usize| r#"{"x":5,"y":5,"r":0.3}"#.to_owned();
    let last_is_bad = |k: usize| format!(r#"{{"x":5,"y":5,"r":{}}}"#, if k == 9999 { -1 } else { 1 });
    let texts: Vec<(String, Expected)> = vec![
        (r#"{"goal": null}"#.into(), Refused(&["goal", "null", "array of length 2"])),
        (r#"{"goal": [NaN, 0]}"#.into(), Refused(&["goal[0]", "expected value"])),
        (r#"{"goal": [9]}"#.into(), Refused(&["goal", "length 1"])),
        (r#"{"start": [1e9, 0]}"#.into(), Refused(&["start[0] = 1000000000 is outside -10000..=10000"])),
        (r#"{"goal_velocity": [0, -21]}"#.into(), Refused(&["goal_velocity[1] = -21 is outside -20..=20"])),
        (r#"{"obstacles": null}"#.into(), Refused(&["obstacles", "null", "sequence"])),
        (r#"{"obstacles": [{"x":5,"y":5,"r":-1}]}"#.into(), Refused(&["obstacles[0].r = -1 is outside 0.001..=1000"])),
        (r#"{"obstacles": [{"x":5,"y":5,"r":0}]}"#.into(), Refused(&["obstacles[0].r = 0 is outside 0.001..=1000"])),
        (
            r#"{"obstacles": [{"x":5,"y":5,"r":1e30}]}"#.into(),
            Refused(&["obstacles[0].r = 1e30 is outside 0.001..=1000"]),
        ),
        (r#"{"obstacles": [{"x":5,"y":null,"r":1}]}"#.into(), Refused(&["obstacles[0].y", "null", "expected f64"])),
        (r#"{"obstacles": [{"x":5,"y":5}]}"#.into(), Refused(&["obstacles[0]", "missing field `r`"])),
        (
            r#"{"obstacles": [{"x":5,"y":5,"r":1,"vx":1e3}]}"#.into(),
            Refused(&["obstacles[0].vx = 1000 is outside -20..=20"]),
        ),
        (r#"{"goal_tolerance": 0}"#.into(), Refused(&["goal_tolerance = 0 is outside 0.01..=100"])),
        (
            r#"{"faults": {"stale_ownship": [6, 3]}}"#.into(),
            Refused(&["faults.stale_ownship[1] = 3 is outside 6..=1000000"]),
        ),
        (r#"{"faults": {"clock_back_s": -1}}"#.into(), Refused(&["faults.clock_back_s = -1 is outside 0..=1000000"])),
        (
            format!(r#"{{"obstacles":[{}]}}"#, many(10_000, last_is_bad)),
            Refused(&["obstacles[9999].r = -1 is outside 0.001..=1000"]),
        ),
        (format!(r#"{{"obstacles":[{}]}}"#, many(10_000, far_row)), Ends("reached", "")),
        (format!(r#"{{"max_time_s":200,"obstacles":[{}]}}"#, many(10_000, carpet)), Ends("hold", "goal_unreachable")),
        (format!(r#"{{"obstacles":[{}]}}"#, many(10_000, same)), Ends("reached", "")),
        (format!(r#"{{"sensor":{{"model":"scan"}},"obstacles":[{}]}}"#, many(3, same)), Ends("reached", "")),
        (r#"{"goal": [15, 5]}"#.into(), Ends("reached", "")),
        (r#"{"start": [-3, -3]}"#.into(), Ends("reached", "")),
        (r#"{"start": [5, 5], "goal": [5, 5]}"#.into(), Ends("reached", "")),
        (r#"{"goal": [10000, 10000], "max_time_s": 8}"#.into(), Ends("timeout", "nominal")),
        (r#"{"goal_velocity": [20, 0], "max_time_s": 8}"#.into(), Ends("timeout", "nominal")),
        (r#"{"obstacles": [{"x":9,"y":9,"r":1}]}"#.into(), Ends("hold", "goal_unreachable")),
        (r#"{"obstacles": [{"x":1,"y":1,"r":0.5}]}"#.into(), Refused(&["start = [1, 1] is inside obstacles[0]"])),
        (r#"{"obstacles": [{"x":1,"y":1,"r":900}]}"#.into(), Refused(&["start = [1, 1] is inside obstacles[0]"])),
        (r#"{"limits": {"v_max": 20, "a_max": 20}}"#.into(), Ends("reached", "")),
        (r#"{"limits": {"v_max": 0.05, "a_max": 0.1}, "max_time_s": 8}"#.into(), Ends("timeout", "nominal")),
        (r#"{"drone_radius": 5, "max_time_s": 8}"#.into(), Ends("timeout", "nominal")),
        (r#"{"sensor": {"fov_deg": 360, "range_m": 100}}"#.into(), Ends("reached", "")),
        (r#"{"bearing": {"sigma_deg": 0}}"#.into(), Ends("reached", "")),
        (r#"{"bearing": {"sigma_deg": 180}, "max_time_s": 8}"#.into(), Ends("timeout", "nominal")),
        (r#"{"bearing": {"snr_db": -30}, "max_time_s": 8}"#.into(), Ends("hold", "no_signal")),
        (r#"{"bearing": {"dropout": [3, 5]}}"#.into(), Ends("reached", "")),
        (r#"{"bearing": {"dropout": [0, 1e6]}, "max_time_s": 8}"#.into(), Ends("hold", "no_signal")),
        (r#"{"bearing": {"outlier": {"rate": 0.2, "offset_deg": 180}}}"#.into(), Ends("reached", "")),
        (
            r#"{"bearing": {"outlier": {"rate": 1, "offset_deg": 180}}, "max_time_s": 8}"#.into(),
            Ends("timeout", "nominal"),
        ),
        (r#"{"faults": {"nan_bearing": [2, 4]}}"#.into(), Ends("reached", "")),
        (r#"{"faults": {"nan_bearing": [0, 1e6]}, "max_time_s": 8}"#.into(), Ends("hold", "no_signal")),
        (r#"{"faults": {"clock_back_s": 4}}"#.into(), Ends("reached", "")),
        (r#"{"faults": {"stale_obstacles": [3, 6]}}"#.into(), Ends("reached", "")),
        (r#"{"faults": {"stale_obstacles": [0, 1e6]}, "max_time_s": 8}"#.into(), Ends("hold", "stale_obstacles")),
        (r#"{"faults": {"stale_ownship": [3, 6]}}"#.into(), Ends("reached", "")),
        (r#"{"faults": {"stale_ownship": [0, 1e6]}, "max_time_s": 8}"#.into(), Ends("hold", "")),
    ];
    let mut cases: Vec<_> = texts.into_iter().map(|(text, expected)| (text.into_bytes(), expected)).collect();
    cases.extend(bad_documents());
    run_each(&cases, &["fly", "--scenario"], |shown, expected, code, out, errors| {
        let Ends(result, reason) = expected else { return };
        let report: Value = serde_json::from_str(out).unwrap_or_else(|error| panic!("{shown}: {error} {out} {errors}"));
        assert_eq!(report["result"], *result, "{shown}: {report}");
        assert!(reason.is_empty() || report["reason"] == *reason, "{shown}: {report}");
        assert_eq!(code, i32::from(*result != "reached"), "{shown}: {report}");
        assert_eq!(report["collisions"], 0, "{shown}: {report}");
        // What is not finite is printed as null.
        let number = |key: &str| report[key].as_f64().unwrap_or_else(|| panic!("{shown}: {key} of {report}"));
        let (time_s, length_m) = (number("time_s"), number("path_length_m"));
        assert!(length_m <= 20.0 * time_s && number("straight_line_m") >= 0.0, "{shown}: {report}");
        if shown.starts_with("{\"obstacles") {
            number("min_clearance_m");
        }
        assert_eq!(report["trace_hash"].as_str().map(str::len), Some(16), "{shown}: {report}");
    });
}

/// A suite of one map.
fn suite_of(obstacles: &str, pairs: &str) -> String {
    format!(r#"{{"max_time_s":40,"maps":[{{"row":1,"instance":0,"obstacles":[{obstacles}],"pairs":[{pairs}]}}]}}"#)
}

/// Every unusual suite is refused by field, value and range, or flown to a result with a name.
#[test]
fn every_strange_suite_is_refused_by_field_value_and_range_or_flown_to_a_named_end() {
    let pair = "[1,1,9,9,11.4]";
    let same = |_: usize| "[5,5,0.3]".to_owned();
    let texts: Vec<(String, Expected)> = vec![
        ("{}".into(), Refused(&["maps", "no pair"])),
        (r#"{"maps":[]}"#.into(), Refused(&["maps", "no pair"])),
        (r#"{"maps":null}"#.into(), Refused(&["maps", "null"])),
        (r#"{"maps":[null]}"#.into(), Refused(&["maps[0]", "expected an object"])),
        (r#"{"maps":[{"row":1"#.into(), Refused(&["maps[0]", "EOF"])),
        (r#"{"maps":[{"row":-1}]}"#.into(), Refused(&["maps[0].row", "-1"])),
        (r#"{"maps":[{"row":1.5}]}"#.into(), Refused(&["maps[0].row", "1.5"])),
        (r#"{"maps":[{"instance":0,"obstacles":[],"pairs":[]}]}"#.into(), Refused(&["maps[0]", "missing field `row`"])),
        (r#"{"faults":{"nan_bearing":[1,2]}}"#.into(), Refused(&["faults: unknown key"])),
        (suite_of("", ""), Refused(&["maps", "no pair"])),
        (suite_of("[NaN,5,1]", pair), Refused(&["maps[0].obstacles[0][0]", "expected value"])),
        (suite_of("[5,1e400,1]", pair), Refused(&["maps[0].obstacles[0][1]", "number out of range"])),
        (suite_of("[5,5,-1]", pair), Refused(&["maps[0].obstacles[0][2] = -1 is outside 0.001..=1000"])),
        (suite_of("[5,5,1e30]", pair), Refused(&["maps[0].obstacles[0][2] = 1e30 is outside 0.001..=1000"])),
        (suite_of("[5,5]", pair), Refused(&["maps[0].obstacles[0]", "length 2", "length 3"])),
        (suite_of("[5,5,null]", pair), Refused(&["maps[0].obstacles[0][2]", "null", "expected f64"])),
        (suite_of(r#"{"x":5,"y":5,"r":1}"#, pair), Refused(&["maps[0].obstacles[0]", "map", "array of length 3"])),
        (suite_of("", "[1,1,9,9]"), Refused(&["maps[0].pairs[0]", "length 4", "length 5"])),
        (suite_of("", "[1,1,null,9,11]"), Refused(&["maps[0].pairs[0][2]", "null"])),
        (suite_of("", "[1,1,9,1e9,11]"), Refused(&["maps[0].pairs[0][3] = 1000000000 is outside -10000..=10000"])),
        (suite_of("", "[1,1,9,9,-3]"), Refused(&["maps[0].pairs[0][4] = -3 is outside 0..=100000"])),
        (suite_of("", pair), Ends("reached", "")),
        (suite_of("", "[5,5,5,5,0]"), Ends("reached", "")),
        (suite_of("", "[1,1,12,12,0]"), Ends("reached", "")),
        (suite_of(&many(10_000, same), pair), Ends("reached", "")),
        (suite_of("[1,1,0.5]", pair), Refused(&["maps[0].pairs[0]", "is inside obstacles[0]"])),
        (suite_of("[9,9,1]", pair), Ends("hold: goal_unreachable", "")),
    ];
    let mut cases: Vec<_> = texts.into_iter().map(|(text, expected)| (text.into_bytes(), expected)).collect();
    cases.extend(bad_documents());
    run_each(&cases, &["suite"], |shown, expected, code, out, errors| {
        let Ends(outcome, _) = expected else { return };
        let report: Value = serde_json::from_str(out).unwrap_or_else(|error| panic!("{shown}: {error} {out} {errors}"));
        assert_eq!(report["all"]["outcomes"], serde_json::json!({*outcome: 1}), "{shown}: {report}");
        assert_eq!(report["all"]["collisions"], 0, "{shown}: {report}");
        assert_eq!(code, i32::from(*outcome != "reached"), "{shown}: {report}");
    });
    // The maps of a file are described only if they could be flown over.
    let refused = cases.into_iter().filter(|(text, expected)| match expected {
        Refused(words) => !words.contains(&"no pair") && !text.is_empty(),
        Ends(..) => false,
    });
    run_each(&refused.collect::<Vec<_>>(), &["maps", "--describe"], |_, _, _, _, _| ());
}

/// Maps that cannot be drawn are refused, and the message names the field.
#[test]
fn maps_that_cannot_be_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().to_string_lossy().into_owned();
    let kinds: &[(&[&str], &[&str])] = &[
        (&["--row", "0"], &["--row", "'0'", "1..=5"]),
        (&["--row", "6"], &["--row", "'6'", "1..=5"]),
        (&["--row", "one"], &["--row", "'one'"]),
        (&["--row=-1"], &["--row", "-1"]),
        (&["--row", "1", "--mean", "0.1", "--variance", "0.01"], &["--row", "--mean"]),
        (&["--mean", "0.1"], &["--variance"]),
        (&["--variance", "0.1"], &["--mean"]),
        (&["--step"], &["--mean"]),
        (&["--mean", "nan", "--variance", "0.01"], &["mean = NaN is outside 0.005..=0.22"]),
        (&["--mean", "inf", "--variance", "0.01"], &["mean = inf is outside 0.005..=0.22"]),
        (&["--mean=-1", "--variance", "0.01"], &["mean = -1 is outside 0.005..=0.22"]),
        (&["--mean", "0", "--variance", "0.01"], &["mean = 0 is outside 0.005..=0.22"]),
        (&["--mean", "0.9", "--variance", "0.01"], &["mean = 0.9 is outside 0.005..=0.22"]),
        (&["--mean", "1e300", "--variance", "0.01"], &["mean = 1e300 is outside 0.005..=0.22"]),
        (&["--mean", "0.1", "--variance", "inf"], &["variance = inf is outside 0..=0.05"]),
        (&["--mean", "0.1", "--variance=-0.01"], &["variance = -0.01 is outside 0..=0.05"]),
        (&["--mean", "dense", "--variance", "0.01"], &["--mean", "'dense'"]),
        (&["--drone-radius", "nan"], &["--drone-radius = NaN is outside 0.01..=5"]),
        (&["--drone-radius=-1"], &["--drone-radius = -1 is outside 0.01..=5"]),
        (&["--drone-radius", "50"], &["--drone-radius = 50 is outside 0.01..=5"]),
        (&["--row", "1", "--count", "1", "--drone-radius", "3"], &["drone-radius = 3", "pairs"]),
        (&["--count", "0"], &["--count", "'0'", "1..=1000"]),
        (&["--count", "99999999999"], &["--count", "'99999999999'", "1..=1000"]),
        (&["--seed=-1"], &["--seed", "-1"]),
        (&["--describe", "does-not-exist.json"], &["does-not-exist.json"]),
        (&["--row", "1", "--count", "1", "--describe", "does-not-exist.json"], &["--describe"]),
    ];
    for (arguments, words) in kinds {
        let output = run(&[&["maps", "--json", "--out", &out], *arguments].concat());
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}: {text}");
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {words:?} in {text}");
        assert!(!text.contains("panicked"), "{arguments:?}: {text}");
    }
}

/// A message of a refused command line: exit code 2, nothing on stdout, one error, and no trace of the program's inside.
fn message(arguments: &[&str]) -> String {
    let output = run(arguments);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}: {text}");
    let errors = text.lines().filter(|line| line.starts_with("error: ")).count();
    assert_eq!((errors, text.starts_with("error: ")), (1, true), "{arguments:?}: {text}");
    for inside in ["panicked", "backtrace", ".rs:", "Err(", "\u{1b}["] {
        assert!(!text.contains(inside), "{arguments:?}: {inside} in {text}");
    }
    // What to do next may follow, and no page of help.
    assert!(text.lines().count() <= 12 && text.len() < 700, "{arguments:?}: {text}");
    text
}

/// Every bad option is refused in one message with name, value and range.
#[test]
fn every_bad_option_is_refused_by_name_value_and_range_in_one_message() {
    let dir = tempfile::tempdir().unwrap();
    let place = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    for (name, content) in [
        ("file", &b"words"[..]),
        ("suite.json", suite_of("", "[1,1,9,9,11]").as_bytes()),
        ("array.toml", ARRAY.as_bytes()),
        ("frames.npy", &npy("<i2", "(2, 4, 256)", &[0; 2 * 4 * 256 * 2])),
        ("params.toml", b"FH_SPD_MAX = \"fast\""),
        ("key", b"0123"),
    ] {
        std::fs::write(place(name), content).unwrap();
    }
    let [folder, under_a_file] = ["", "file/x"].map(place);
    let [suite, array, frames, params, key] =
        ["suite.json", "array.toml", "frames.npy", "params.toml", "key"].map(place);
    let by = ["companion", "--autopilot", "tcp:127.0.0.1:9", "--source=1,2,-3"];
    let companion = |more: &[&'static str]| [&by[..], more].concat();
    let listen = |more: &[&'static str]| [&["autopilot", "--listen", "pty"][..], more].concat();
    let calibrate = |more: &[&'static str]| [&["calibrate", "--adc", &frames, "--array", &array][..], more].concat();
    let suite_with = |more: &[&'static str]| [&["suite", suite.as_str()][..], more].concat();
    let seeds = "0..=18446744073709551615";
    let cases: Vec<(Vec<&str>, Vec<&str>)> = vec![
        // Words that are none.
        (vec!["fli"], vec!["'fli'", "'fly'"]),
        (vec!["fly", "--sede", "7"], vec!["'--sede'", "'--seed'"]),
        (vec!["fly", "over", "there"], vec!["'over'"]),
        (vec!["--seed"], vec!["--seed", "value is required"]),
        (vec!["--seed", "-1"], vec!["--seed", "'-1'", seeds]),
        (vec!["--seed", "1.5"], vec!["--seed", "'1.5'", seeds]),
        (vec!["--seed", "18446744073709551616"], vec!["--seed", "'18446744073709551616'", seeds]),
        // A flight.
        (vec!["fly", "--snr-db", "loud"], vec!["--snr-db", "'loud'", "-30..=80"]),
        (vec!["fly", "--snr-db", "81"], vec!["--snr-db = 81", "-30..=80"]),
        (vec!["fly", "--snr-db=-inf"], vec!["--snr-db = -inf", "-30..=80"]),
        (vec!["fly", "--planner", "best"], vec!["--planner", "'best'", "foxhound", "virtual_force"]),
        (vec!["fly", "--estimator", "ears"], vec!["--estimator", "'ears'", "cross", "n-array"]),
        (vec!["fly", "--via", "pigeon"], vec!["--via", "'pigeon'", "`qemu:ELF`"]),
        (vec!["fly", "--plot", "flight.jpg"], vec!["--plot flight.jpg", ".svg or .png"]),
        (vec!["fly", "--params", &params], vec![&params, "FH_SPD_MAX", "number"]),
        (vec!["fly", "--scenario", &folder], vec![&folder, "directory"]),
        (vec!["fly", "--out", &under_a_file], vec![&under_a_file]),
        (vec!["fly", "--json", "--tlog", &under_a_file], vec!["--tlog", &under_a_file]),
        (vec!["fly", "--json", "--report", &under_a_file], vec!["--report", &under_a_file]),
        (vec!["fly", "--json", "--flight-log", &under_a_file], vec!["--flight-log", &under_a_file]),
        (vec!["fly", "--json", "--mcap", &under_a_file], vec![&under_a_file]),
        (vec!["fly", "--live", "--port", "65536"], vec!["--port", "'65536'", "0..=65535"]),
        (vec!["fly", "--live", "--port", "-1"], vec!["--port", "'-1'", "0..=65535"]),
        (vec!["fly", "--port", "0"], vec!["--live"]),
        (vec!["fly", "--live", "--speed", "fast"], vec!["--speed", "'fast'", "0.05..=1000"]),
        (vec!["fly", "--live", "--speed", "0"], vec!["--speed = 0", "0.05..=1000"]),
        (vec!["fly", "--speed", "2"], vec!["--live"]),
        // Beside an autopilot, and being one.
        (vec!["companion"], vec!["--autopilot", "--source"]),
        (vec!["companion", "--autopilot", "tpc:h:1", "--source=1,2,3"], vec!["--autopilot", "'tpc:h:1'", "`tcp`"]),
        (vec!["companion", "--autopilot", "tcp:h:0", "--source=1,2,3"], vec!["--autopilot", "port 0", "1..=65535"]),
        (vec!["companion", "--autopilot", "tcp:h:1", "--source=1,2"], vec!["--source", "'1,2'", "-10000..=10000"]),
        (companion(&["--v-max", "fast"]), vec!["--v-max", "'fast'", "0.1..=20"]),
        (companion(&["--v-max", "21"]), vec!["--v-max = 21", "0.1..=20"]),
        (companion(&["--drone-radius", "0"]), vec!["--drone-radius = 0", "0.01..=5"]),
        (companion(&["--max-time", "never"]), vec!["--max-time", "'never'", "0.1..=1000000"]),
        (companion(&["--max-time=-1"]), vec!["--max-time = -1", "0.1..=1000000"]),
        (companion(&["--live", "--port", "http"]), vec!["--port", "'http'", "0..=65535"]),
        ([&by[..], &["--key", &key]].concat(), vec!["--key", &key, "64"]),
        (listen(&["--noise", "7:2"]), vec!["--noise", "'7:2'", "0..=1"]),
        (listen(&["--start", "0,0,1e9"]), vec!["--start: ALT = 1000000000", "0..=10000"]),
        (listen(&["--start", "0,0,-5"]), vec!["--start: ALT = -5", "0..=10000"]),
        (listen(&["--software", "betaflight"]), vec!["--software", "'betaflight'", "arducopter", "px4"]),
        (listen(&["--max-time", "0"]), vec!["--max-time = 0", "0.1..=1000000"]),
        // Frames.
        (vec!["bearing", "--adc", &frames], vec!["--array"]),
        (vec!["bearing", "--adc", &frames, "--array", &array, "--looks", "0"], vec!["--looks", "'0'", "1..=1000000"]),
        (vec!["bearing", "--adc", &frames, "--array", &array, "--yaw", &array], vec![&array, "npy"]),
        (calibrate(&[]), vec!["--azimuth-deg"]),
        (calibrate(&["--azimuth-deg", "north"]), vec!["--azimuth-deg", "'north'", "-360..=360"]),
        (calibrate(&["--azimuth-deg", "361"]), vec!["--azimuth-deg = 361", "-360..=360"]),
        (calibrate(&["--azimuth-deg", "0", "--elevation-deg", "90"]), vec!["--elevation-deg = 90", "-85..=85"]),
        (calibrate(&["--azimuth-deg", "0", "--range-m", "-1"]), vec!["--range-m = -1", "0.1..=1000000"]),
        (calibrate(&["--azimuth-deg", "0", "--splitter"]), vec!["--azimuth-deg", "--splitter"]),
        // Suites and maps.
        (suite_with(&["--jobs", "0"]), vec!["--jobs", "'0'", "1..=1024"]),
        (suite_with(&["--jobs", "many"]), vec!["--jobs", "'many'", "1..=1024"]),
        (suite_with(&["--only", "1,x"]), vec!["--only", "'x'", "0..=4294967295"]),
        (suite_with(&["--only", "1,0,0,0"]), vec!["--only", "ROW,INSTANCE,PAIR"]),
        (suite_with(&["--only", "7"]), vec!["--only", "no pair is left"]),
        (suite_with(&["--pairs", "-3"]), vec!["--pairs", "'-3'", "0..=4294967295"]),
        (suite_with(&["--shard", "5/4"]), vec!["--shard", "'5/4'", "1..=N"]),
        (suite_with(&["--drone-radius", "wide"]), vec!["--drone-radius", "'wide'", "0.01..=5"]),
        (suite_with(&["--bearing-sigma-deg", "181"]), vec!["--bearing-sigma-deg = 181", "0..=180"]),
        (suite_with(&["--vehicle", "kite"]), vec!["--vehicle", "'kite'", "point", "arducopter"]),
        (vec!["suite", &suite, "--csv", &under_a_file], vec!["--csv", &under_a_file]),
        (vec!["suite", &suite, "--parquet", &under_a_file], vec!["--parquet", &under_a_file]),
        (vec!["maps", "--bounds", "0,0,9"], vec!["--bounds", "X0,Y0,X1,Y1"]),
        (vec!["maps", "--bounds", "0,0,9,high"], vec!["--bounds", "'high'", "-1000..=1000"]),
        (vec!["maps", "--bounds", "0,0,1,9"], vec!["bounds[2] = 1", "2..=50"]),
        (vec!["maps", "--pairs", "-1"], vec!["--pairs", "'-1'", "1..=10000"]),
        (vec!["maps", "--pairs", "0"], vec!["--pairs", "'0'", "1..=10000"]),
        (vec!["merge", &params], vec![&params, "line 1"]),
        // The rest.
        (vec!["tlog", &folder], vec![&folder, "directory"]),
        (vec!["tlog", &array], vec![&array, "no MAVLink frame"]),
        (vec!["replay", &array], vec![&array, "no flight log"]),
        (vec!["port", "--serial", &folder, "status"], vec![&folder, "directory"]),
        (vec!["port", "--serial", &array, "--baud", "300"], vec!["--baud", "'300'", "1200..=12000000"]),
        (vec!["port", "--serial", &array, "--seconds", "-1"], vec!["--seconds = -1", "0.1..=1000000"]),
        (vec!["params", "--set", "FH_SPD_MX=1"], vec!["--set", "FH_SPD_MX", "`FH_SPD_MAX`"]),
        (vec!["params", "--set", "FH_SPD_MAX=1e9"], vec!["--set FH_SPD_MAX = 1000000000", "0.05..=20"]),
        (vec!["schema", "suite"], vec!["'suite'"]),
        (vec!["params", "--markdown", "--json"], vec!["--markdown", "--json"]),
        (vec!["link-state", "--scenes", "0"], vec!["--scenes", "'0'", "1..=100000"]),
        (vec!["reproduce", "stretch", "--trials", "1"], vec!["--trials", "'1'", "2..=100000"]),
        (vec!["completions", "tcsh"], vec!["'tcsh'", "bash", "zsh", "fish"]),
        (vec!["completions", "bash", "--json"], vec!["--json", "completion"]),
        (vec!["man", "flie"], vec!["`flie`", "fly"]),
    ];
    assert!(cases.len() >= 70, "{}", cases.len());
    for (arguments, words) in &cases {
        let text = message(arguments);
        assert!(words.iter().all(|word| text.contains(word)), "{arguments:?}: {words:?} in {text}");
    }
}
