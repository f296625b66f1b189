//! `foxhound pad`.

use foxhound_tests::{assert_refused, run_json};

/// `foxhound pad` finds the pad in a picture that it draws, and again in that picture's file.
#[test]
fn the_command_finds_the_pad_in_its_own_picture_and_in_that_file_again() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().to_string_lossy().into_owned();
    let (code, report) = run_json(&["pad", "--render", "--seed", "3", "--json", "--out", &out]);
    assert_eq!((code, &report["seen"]), (0, &"pad".into()), "{report}");
    let picture = report["picture"].as_str().unwrap();
    // The circle drawn on it is thin.
    let (_, again) = run_json(&["pad", "--image", picture, "--json"]);
    assert_eq!(again["width_px"], 160, "{again}");
    assert!(["pad", "nothing"].contains(&again["seen"].as_str().unwrap()), "{again}");
}

/// `foxhound pad` refuses bad pictures and options by name.
#[test]
fn bad_pictures_and_options_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("broken.png");
    std::fs::write(&path, b"\x89PNG\r\n\x1a\n and no more").unwrap();
    let broken = path.to_string_lossy().into_owned();
    let folder = dir.path().to_string_lossy().into_owned();
    let cases: &[(&[&str], &[&str])] = &[
        (&[], &["--image"]),
        (&["--image", "does-not-exist.png"], &["does-not-exist.png"]),
        (&["--image", &broken], &["broken.png", "PNG"]),
        (&["--render", "--size", "1x1"], &["--size 1x1", "16x16"]),
        (&["--render", "--size", "640x480"], &["--size 640x480", "320x240"]),
        (&["--render", "--size", "wide"], &["--size wide"]),
        (&["--image", &broken, "--height", "0"], &["--height = 0 is outside 0.05..=1000"]),
        (&["--image", &broken, "--height", "nan"], &["--height = NaN"]),
        (&["--image", &broken, "--height", "high"], &["--height", "'high'"]),
        (&["--render", "--focal=-1"], &["--focal = -1 is outside 0.2..=5"]),
        (&["--render", "--radius", "99"], &["--radius = 99 is outside 0.02..=5"]),
        (&["--render", "--height", "2"], &["--height"]),
        (&["--grounds", "does-not-exist"], &["--grounds", "does-not-exist"]),
        (&["--grounds", &folder], &["--grounds", "broken.png", "PNG"]),
        (&["--grounds", &folder, "--grey"], &["--grey"]),
    ];
    assert_refused(&["pad", "--json"], cases);
}
