//! What people's hands do: lists too long, recordings that do not come out even. Each is an error that names the key.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use foxhound_tests::run;

const ARRAY: &str = "wavelength_m = 0.345\nsample_rate_hz = 102400.0\n";
const SIDE: &str = "side_m = 0.138\n";

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

/// Runs `foxhound bearing` on `count` frames and returns what it says of the refusal; nothing may be on stdout.
fn refusal(array: &str, more: &[&str]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    std::fs::write(Path::new(&path("f.npy")), npy("<i2", "(4, 4, 256)", 4 * 4 * 256 * 2)).unwrap();
    std::fs::write(Path::new(&path("a.toml")), array).unwrap();
    let output = run(&[&["bearing", "--adc", &path("f.npy"), "--array", &path("a.toml")], more].concat());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{array}: {text}");
    assert!(output.stdout.is_empty());
    text
}

/// Lists of an array file with a value too many, tables written as lists, and keys of which one rules the other out are errors that
/// name the key.
#[test]
fn a_list_with_a_value_too_many_is_an_error_that_names_the_key() {
    for (keys, named) in [
        ("antennas_m = [[0.07,0.07],[0.07,-0.07],[-0.07,-0.07],[-0.07,0.07],[0,0]]\n", "antennas_m: 5 antennas"),
        ("antennas_m = [[0.07,0.07,1],[0.07,-0.07],[-0.07,-0.07],[-0.07,0.07]]\n", "antennas_m[0]"),
        ("side_m = 0.138\ntone_band_hz = [2000, 9000, 10000]\n", "tone_band_hz"),
        ("side_m = 0.138\nskew_s = [0, 0, 0, 0, 0]\n", "skew_s"),
        ("side_m = 0.138\ntone_hz = 3000\ntone_band_hz = [2000, 9000]\n", "tone_hz and tone_band_hz"),
        ("side_m = 0.138\ncalibration = [[1, 1, 1, 1], [0, 0, 0, 0]]\n", "calibration: expected a table"),
    ] {
        let text = refusal(&format!("{ARRAY}{keys}"), &[]);
        assert!(text.contains(named), "{keys}: {text}");
    }
}

/// Frames that make no whole group of looks are an error, whether there is a whole group before them or not.
#[test]
fn frames_that_make_no_group_of_looks_are_an_error() {
    for looks in ["99", "3"] {
        let text = refusal(&format!("{ARRAY}{SIDE}"), &["--looks", looks]);
        assert!(text.contains(&format!("--looks {looks}: the last")) && text.contains("of 4 frames"), "{text}");
    }
}
