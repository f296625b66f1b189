//! Bad input ends with exit code 2 and a text that names the field.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::Path;

use foxhound_tests::run;

/// Writes `content` into a file and runs the arguments, in which `{}` stands for its path.
fn refusal(name: &str, content: &[u8], arguments: &[&str]) -> String {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("array.toml"), ARRAY).unwrap();
    let frames = npy("<i2", "(2, 4, 256)", 2 * 4 * 256 * 2);
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

/// A NumPy file, written by hand.
fn npy(dtype: &str, shape: &str, bytes: usize) -> Vec<u8> {
    let mut header = format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend_from_slice(&(header.len() as u16).to_le_bytes());
    file.extend_from_slice(header.as_bytes());
    file.resize(file.len() + bytes, 0);
    file
}

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

#[test]
fn bad_frame_files_say_what_is_wrong() {
    let bearing = ["bearing", "--json", "--adc", "{}", "--array", "{array}"];
    for (file, word) in [
        (npy("<f4", "(2, 4, 256)", 2 * 4 * 256 * 4), "int16"),
        (npy("<i2", "(2, 3, 256)", 2 * 3 * 256 * 2), "shape"),
        (npy("<i2", "(2, 4, 250)", 2 * 4 * 250 * 2), "N = 250"),
        (npy("<i2", "(8, 256)", 8 * 256 * 2), "shape"),
        (npy("<i2", "(2, 4, 256)", 2 * 4 * 256 * 2 - 100), "truncated"),
        (b"not numpy at all".to_vec(), "npy"),
        (Vec::new(), "npy"),
    ] {
        let text = refusal("frames.npy", &file, &bearing);
        assert!(text.contains(word), "{word}: {text}");
    }
}

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
