//! Bad input ends with exit code 2 and a text that names the field; unusual but valid input is flown to an end with a
//! name.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_tests::{assert_refused, errors, in_parallel, npy, npy_frames, refused, run, text};
use serde_json::Value;

const ARRAY: &str = "wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0\n";

/// Four good frames.
fn frames() -> Vec<u8> {
    npy_frames(&[0; 4 * 4 * 256], 256)
}

/// Writes `content` into a file and runs the arguments, in which `{}` stands for its path; what is said.
fn refusal(name: &str, content: &[u8], arguments: &[&str]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = |file: &str| text(&dir.path().join(file));
    for (file, content) in [("array.toml", ARRAY.as_bytes()), ("good.npy", &frames()[..]), (name, content)] {
        std::fs::write(path(file), content).unwrap();
    }
    let place = |argument: &&str| {
        argument.replace("{}", &path(name)).replace("{array}", &path("array.toml")).replace("{npy}", &path("good.npy"))
    };
    let arguments: Vec<String> = arguments.iter().map(place).collect();
    refused(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
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
    // One value too many in a list, a list in the place of a table, two keys that exclude each other.
    for (keys, named) in [
        ("antennas_m = [[0.07,0.07],[0.07,-0.07],[-0.07,-0.07],[-0.07,0.07],[0,0]]\n", "antennas_m: 5 antennas"),
        ("antennas_m = [[0.07,0.07,1],[0.07,-0.07],[-0.07,-0.07],[-0.07,0.07]]\n", "antennas_m[0]"),
        ("side_m = 0.138\ntone_band_hz = [2000, 9000, 10000]\n", "tone_band_hz"),
        ("side_m = 0.138\nskew_s = [0, 0, 0, 0, 0]\n", "skew_s"),
        ("side_m = 0.138\ntone_hz = 9500\ntone_band_hz = [2000, 9000]\n", "tone_hz, beside tone_band_hz,"),
        ("side_m = 0.138\ncalibration = [[1, 1, 1, 1], [0, 0, 0, 0]]\n", "calibration: expected a table"),
    ] {
        let array = format!("wavelength_m = 0.345\nsample_rate_hz = 102400.0\n{keys}");
        let text = refusal("bad.toml", array.as_bytes(), &bearing);
        assert!(text.contains(named), "{keys}: {text}");
    }
}

/// An incomplete last group of `--looks` frames is an error.
#[test]
fn frames_that_make_no_group_of_looks_are_an_error() {
    for (looks, why) in [("99", "4 frames make no group of 99"), ("3", "the last")] {
        let text = refusal("unused", b"", &["bearing", "--adc", "{npy}", "--array", "{array}", "--looks", looks]);
        assert!(text.contains(&format!("--looks {looks}: {why}")) && text.contains("4 frames"), "{text}");
    }
}

/// Missing files and files that are no firmware image are refused.
#[test]
fn missing_files_and_foreign_images_are_refused() {
    for (arguments, name) in [
        (&["fly", "--scenario", "does-not-exist.json"][..], "does-not-exist.json"),
        (&["bearing", "--adc", "does-not-exist.npy", "--array", "{array}"], "does-not-exist.npy"),
        (&["bearing", "--adc", "{npy}", "--array", "does-not-exist.toml"], "does-not-exist.toml"),
        (&["fly", "--via", "qemu:does-not-exist.elf"], "does-not-exist.elf"),
        (&["fly", "--via", "qemu:{}"], "image.elf"),
    ] {
        let text = refusal("image.elf", b"\x7fELF but no more than that", arguments);
        assert!(text.contains(name), "{arguments:?}: {text}");
    }
}

/// What must become of an input.
enum Expected {
    /// Exit code 2 and a text with these words: field, value and range, or field and what is wrong with it.
    Refused(&'static [&'static str]),
    /// It is flown, or drawn, to this result and, unless empty, this reason.
    Ends(&'static str, &'static str),
}

use Expected::{Ends, Refused};

/// A text, and what must become of it.
type Case = (Vec<u8>, Expected);

/// Runs a command on each text, and hands over what it printed: the text, expectation, exit code, output.
fn run_each(cases: &[Case], command: &[&str], check: impl Fn(&str, &Expected, i32, &str, &str) + Sync) {
    let dir = tempfile::tempdir().unwrap();
    let numbered: Vec<(usize, &Case)> = cases.iter().enumerate().collect();
    in_parallel(&numbered, |(index, (content, expected))| {
        let file = dir.path().join(format!("case{index}.json"));
        std::fs::write(&file, content).unwrap();
        let output = run(&[command, &[&text(&file), "--json"]].concat());
        let shown: String = String::from_utf8_lossy(content).chars().take(120).collect();
        let (out, errors) = (String::from_utf8_lossy(&output.stdout), errors(&output));
        assert!(!errors.contains("panicked"), "{shown}: {errors}");
        let code = output.status.code().unwrap_or(-1);
        if let Refused(words) = expected {
            assert_eq!((code, &*out), (2, ""), "{shown}: {errors}");
            assert!(words.iter().all(|word| errors.contains(word)), "{shown}: {words:?} in {errors}");
            assert!(errors.contains(&format!("case{index}.json")), "{shown}: names the file: {errors}");
            assert!(errors.lines().count() == 1 && errors.len() < 400, "{shown}: {errors}");
        }
        check(&shown, expected, code, &out, &errors);
    });
}

/// A list of so many obstacles.
fn many(count: usize, obstacle: impl Fn(usize) -> String) -> String {
    (0..count).map(obstacle).collect::<Vec<_>>().join(",")
}

/// What is wrong with any document, be it a scenario or a suite.
fn bad_documents() -> Vec<Case> {
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
        (b"{\"limits\": {\"v_max\": 0}}", Refused(&["limits.v_max = 0 is outside 0.1..=20"])),
        (b"{\"limits\": {\"v_max\": -1}}", Refused(&["limits.v_max = -1 is outside 0.1..=20"])),
        (b"{\"limits\": {\"a_max\": 30}}", Refused(&["limits.a_max = 30 is outside 0.1..=20"])),
        (b"{\"sensor\": {\"fov_deg\": 1}}", Refused(&["sensor.fov_deg = 1 is outside 6..=360"])),
        (b"{\"sensor\": {\"fov_deg\": 400}}", Refused(&["sensor.fov_deg = 400 is outside 6..=360"])),
        (b"{\"sensor\": {\"model\": \"sonar\"}}", Refused(&["model"])),
        (b"{\"sensor\": null}", Refused(&["sensor", "expected an object"])),
        (b"{\"bearing\": {\"sigma_deg\": -1}}", Refused(&["bearing.sigma_deg = -1 is outside 0..=180"])),
        (b"{\"bearing\": {\"sigma\": 1}}", Refused(&["bearing.sigma: unknown key", "did you mean `sigma_deg`"])),
        (b"{\"bearing\": {\"dropout\": [5, 3]}}", Refused(&["bearing.dropout[1] = 3 is outside 5..=1000000"])),
        (b"{\"bearing\": {\"dropout\": [5]}}", Refused(&["bearing.dropout", "length 1", "length 2"])),
        (b"{\"bearing\": {\"outlier\": {\"rate\": 2}}}", Refused(&["bearing.outlier.rate = 2 is outside 0..=1"])),
        (b"{\"vehicle\": {\"model\": \"kite\"}}", Refused(&["vehicle.model", "`kite`", "`point`"])),
        (b"{\"max_time_s\": 0}", Refused(&["max_time_s = 0 is outside 0.1..=3600"])),
        (b"{\"goal_tolerance\": 0}", Refused(&["goal_tolerance = 0 is outside 0.01..=100"])),
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
        (r#"{"start": [0, "x"]}"#.into(), Refused(&["start"])),
        (r#"{"obstcles": []}"#.into(), Refused(&["obstcles", "`obstacles`"])),
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
        (
            r#"{"obstacles": [{"x":8,"y":1,"r":1}, {"x":1.2,"y":1,"r":1}]}"#.into(),
            Refused(&["start = [1, 1]", "inside obstacles[1]"]),
        ),
        (
            r#"{"walls": [{"x0":0,"y0":1.1,"x1":3,"y1":1.1,"r":0.3}]}"#.into(),
            Refused(&["start = [1, 1]", "inside walls[0]"]),
        ),
        (r#"{"limits": {"v_max": 20, "a_max": 20}}"#.into(), Ends("reached", "")),
        (r#"{"limits": {"v_max": 0.05}}"#.into(), Refused(&["limits.v_max = 0.05 is outside 0.1..=20"])),
        (r#"{"limits": {"v_max": 0.1, "a_max": 0.1}, "max_time_s": 8}"#.into(), Ends("timeout", "nominal")),
        (r#"{"drone_radius": 5}"#.into(), Refused(&["sensor.range_m = 3", "0.35 m farther than the hull"])),
        (
            r#"{"drone_radius": 5, "sensor": {"range_m": 6}}"#.into(),
            Refused(&["drone_radius = 5", "sensor.fov_deg = 90", "155 degrees"]),
        ),
        (
            r#"{"drone_radius": 5, "sensor": {"range_m": 6, "fov_deg": 360}, "max_time_s": 8}"#.into(),
            Ends("timeout", "nominal"),
        ),
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
        (r#"{"maps":[{"row":1,"instance":0,"obstacles":[]}]}"#.into(), Refused(&["pairs"])),
        (r#"{"maps":[{"row":1,"instance":0,"obstacles":null,"pairs":[]}]}"#.into(), Refused(&["maps[0].obstacles"])),
        (
            r#"{"maps":[{"row":1,"instance":0,"obstacle":[],"obstacles":[],"pairs":[]}]}"#.into(),
            Refused(&["`obstacles`"]),
        ),
        (r#"{"maps":[[1,0,[],[[1,1,5,5,5.7]]]]}"#.into(), Refused(&["maps[0]: expected an object"])),
        (r#"{"map":[]}"#.into(), Refused(&["did you mean `maps`"])),
        (r#"{"faults":{"nan_bearing":[1,2]}}"#.into(), Refused(&["faults: unknown key"])),
        (suite_of("", ""), Refused(&["maps", "no pair"])),
        (suite_of("[NaN,5,1]", pair), Refused(&["maps[0].obstacles[0][0]", "expected value"])),
        (suite_of("[5,1e400,1]", pair), Refused(&["maps[0].obstacles[0][1]", "number out of range"])),
        (suite_of("[5,5,-1]", pair), Refused(&["maps[0].obstacles[0][2] = -1 is outside 0.001..=1000"])),
        (suite_of("[5,5,1e30]", pair), Refused(&["maps[0].obstacles[0][2] = 1e30 is outside 0.001..=1000"])),
        (suite_of("[5,5,0]", pair), Refused(&["maps[0].obstacles[0][2]"])),
        (suite_of("[5,5,0.3],[1e7,2,0.3]", pair), Refused(&["maps[0].obstacles[1][0]"])),
        (suite_of("[5,5,0.3,4]", pair), Refused(&["maps[0].obstacles[0]"])),
        (suite_of("[5,5]", pair), Refused(&["maps[0].obstacles[0]", "length 2", "length 3"])),
        (suite_of("[5,5,null]", pair), Refused(&["maps[0].obstacles[0][2]", "null", "expected f64"])),
        (suite_of(r#"{"x":5,"y":5,"r":1}"#, pair), Refused(&["maps[0].obstacles[0]", "map", "array of length 3"])),
        (suite_of("", "[1,1,9,9]"), Refused(&["maps[0].pairs[0]", "length 4", "length 5"])),
        (suite_of("", "[1,1,null,9,11]"), Refused(&["maps[0].pairs[0][2]", "null"])),
        (suite_of("", "[1,1,9,\"x\",11]"), Refused(&["maps[0].pairs[0][3]"])),
        (suite_of("", "[1,1,9,9,null]"), Refused(&["maps[0].pairs[0][4]"])),
        (suite_of("", "[1,1,9,1e9,11]"), Refused(&["maps[0].pairs[0][3] = 1000000000 is outside -10000..=10000"])),
        (suite_of("", "[1,1,9,9,-3]"), Refused(&["maps[0].pairs[0][4] = -3 is outside 0..=100000"])),
        (suite_of("", pair), Ends("reached", "")),
        (suite_of("", "[5,5,5,5,0]"), Ends("reached", "")),
        (suite_of("", "[1,1,12,12,0]"), Ends("reached", "")),
        (suite_of(&many(10_000, same), pair), Ends("reached", "")),
        (suite_of("[1,1,0.5]", pair), Refused(&["maps[0].pairs[0]", "is inside obstacles[0]"])),
        (suite_of("[1,1,0.3]", "[5,1,9,9,9],[1,1.1,9,9,11]"), Refused(&["maps[0].pairs[1]", "inside obstacles[0]"])),
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
    assert_refused(
        &["maps", "--json", "--out", &text(dir.path())],
        &[
            (&["--row", "0"][..], &["--row", "'0'", "1..=5"][..]),
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
            (&["--mean", "0.02", "--variance", "0.05"], &["variance = 0.05"]),
            (&["--row", "1", "--bounds", "0,0,-5,5"], &["bounds[2]"]),
        ],
    );
}

/// A message of a refused command line: exit code 2, nothing on stdout, one error, and no trace of the program's inside.
fn message(arguments: &[&str]) -> String {
    let text = refused(arguments);
    let errors = text.lines().filter(|line| line.starts_with("error: ")).count();
    assert_eq!((errors, text.starts_with("error: ")), (1, true), "{arguments:?}: {text}");
    for inside in ["backtrace", ".rs:", "Err(", "\u{1b}["] {
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
    let place = |name: &str| text(&dir.path().join(name));
    for (name, content) in [
        ("file", &b"words"[..]),
        ("suite.json", suite_of("", "[1,1,9,9,11]").as_bytes()),
        ("array.toml", ARRAY.as_bytes()),
        ("frames.npy", &frames()),
        ("params.toml", b"FH_SPD_MAX = \"fast\""),
        ("key", b"0123"),
    ] {
        std::fs::write(place(name), content).unwrap();
    }
    let [folder, file, under_a_file] = ["", "file", "file/x"].map(place);
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
        (vec!["fly", "--live", "--speed", "-1"], vec!["--speed = -1 is outside"]),
        (vec!["fly", "--live", "--speed", "nan"], vec!["--speed = NaN is outside"]),
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
        (suite_with(&["--pairs", "0"]), vec!["--pairs"]),
        (suite_with(&["--shard", "5/4"]), vec!["--shard", "'5/4'", "1..=N"]),
        (suite_with(&["--shard", "0/4"]), vec!["--shard"]),
        (suite_with(&["--shard", "4"]), vec!["--shard"]),
        (suite_with(&["--shard", "x/y"]), vec!["--shard"]),
        (suite_with(&["--drone-radius", "wide"]), vec!["--drone-radius", "'wide'", "0.01..=5"]),
        (suite_with(&["--drone-radius", "nan"]), vec!["--drone-radius"]),
        (suite_with(&["--snr-db", "1000"]), vec!["--snr-db"]),
        (suite_with(&["--snr-db", "20", "--bearing-sigma-deg", "2"]), vec!["--bearing-sigma-deg"]),
        (suite_with(&["--planner", "magic"]), vec!["--planner"]),
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
        (vec!["listen", &array, "--array", &array, "--mount-deg", "90"], vec!["cannot be used with '--mount-deg"]),
        (vec!["listen", &array, "--array", &array, "--emitter", "77"], vec!["cannot be used with '--emitter"]),
        (
            vec!["companion", "--autopilot", "tcp:127.0.0.1:1", "--source", "1,0,0", "--sigma-deg", "5"],
            vec!["--bearings"],
        ),
        (
            vec!["companion", "--autopilot", "tcp:127.0.0.1:1", "--source", "1,0,0", "--array", "nofile"],
            vec!["--array: only with --bearings"],
        ),
        (vec!["port", "--serial", &folder, "status"], vec![&folder, "directory"]),
        (vec!["port", "--serial", &array, "--baud", "300"], vec!["--baud", "'300'", "1200..=12000000"]),
        (vec!["port", "--serial", &array, "--seconds", "-1"], vec!["--seconds = -1", "0.1..=1000000"]),
        (vec!["params", "--set", "FH_SPD_MX=1"], vec!["--set", "FH_SPD_MX", "`FH_SPD_MAX`"]),
        (vec!["params", "--set", "FH_SPD_MAX=1e9"], vec!["--set FH_SPD_MAX = 1000000000", "0.05..=20"]),
        (vec!["schema", "suite"], vec!["'suite'"]),
        (vec!["params", "--markdown", "--json"], vec!["--markdown", "--json"]),
        (vec!["link-state", "--scenes", "0"], vec!["--scenes", "'0'", "1..=100000"]),
        (vec!["reproduce"], vec!["EXPERIMENT"]),
        (vec!["reproduce", "apf"], vec!["apf-density"]),
        (vec!["reproduce", "apf-density", "--pairs", "0"], vec!["1..=10000"]),
        (vec!["reproduce", "apf-density", "--pairs", "many"], vec!["--pairs"]),
        (vec!["reproduce", "apf-variants", "--pairs", "10"], vec!["--pairs"]),
        (vec!["reproduce", "aoa-crb", "--pairs", "10"], vec!["only apf-density"]),
        (vec!["reproduce", "aoa-crb", "--scenarios", "10"], vec!["only mmwave"]),
        (vec!["reproduce", "apf-variants", "--trials", "9"], vec!["--trials"]),
        (vec!["reproduce", "stretch", "--trials", "1"], vec!["--trials", "'1'", "2..=100000"]),
        (vec!["reproduce", "all", "--json"], vec!["--out"]),
        (vec!["reproduce", "all", "--pairs", "0"], vec!["1..=10000"]),
        (vec!["reproduce", "all", "--out", &file], vec!["file"]),
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
