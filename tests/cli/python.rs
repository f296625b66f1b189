//! The Python package of `python`, installed by `cargo xtask test`: its own tests hold it to the command line, the notebook
//! runs from its first cell to its last, and the program of the manual runs in a clone.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::os::unix::fs::symlink;
use std::process::Command;

use foxhound_tests::{errors, foxhound, peer, python, root};

/// What a Python program prints; it must succeed.
fn printed(command: &mut Command) -> String {
    let output = command.env("PYTHONDONTWRITEBYTECODE", "1").output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}\n{}", errors(&output));
    text
}

/// Bearings, flights and suites of the package `foxhound` are those of the command line, number by number.
#[test]
#[ignore = "needs the Python package: cargo xtask test"]
fn the_package_gives_what_the_command_line_gives() {
    let output = python()
        .env("FOXHOUND", foxhound().get_program())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(root().join("python/tests/test_foxhound.py"))
        .output()
        .unwrap();
    // unittest says there how many it ran.
    let text = errors(&output);
    assert!(output.status.success() && text.contains("Ran 9 tests") && text.contains("\nOK\n"), "{text}");
}

/// The notebook, which is committed without results, runs from a clean state, draws its pictures and reaches the beacon.
#[test]
#[ignore = "needs the Python package and Jupyter: cargo xtask test"]
fn the_notebook_runs_from_its_first_cell_to_its_last() {
    let dir = tempfile::tempdir().unwrap();
    let mut command = peer("notebook.py");
    // Nothing of this machine's user is read or written.
    for name in ["IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_DATA_DIR", "MPLCONFIGDIR"] {
        command.env(name, dir.path().join(name));
    }
    let text = printed(command.arg(root().join("examples/bearings_and_flights.ipynb")));
    assert!(text.starts_with("reached after 13.36 s, bearings 0.17 deg rms\n"), "{text}");
    assert!(text.ends_with("\n20 dB: 10 of 10 reached\n3 pictures\n"), "{text}");
}

/// The Python program of the manual has fewer than ten lines, and runs in a clone: the bearings of the recording are within four
/// standard deviations of the beacon, at 40 degrees, and the path is drawn.
#[test]
#[ignore = "needs the Python package and Matplotlib: cargo xtask test"]
fn the_python_of_the_manual_runs_in_a_clone() {
    let manual = std::fs::read_to_string(root().join("docs/python.md")).unwrap();
    let program = manual.split("```python\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    assert!(program.lines().filter(|line| !line.is_empty()).count() < 10, "{program}");
    let dir = tempfile::tempdir().unwrap();
    symlink(root().join("examples"), dir.path().join("examples")).unwrap();
    let text = printed(python().current_dir(dir.path()).env("MPLCONFIGDIR", dir.path()).args(["-c", program]));
    let rows: Vec<Vec<f64>> =
        text.lines().map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 8, "{text}");
    for row in rows {
        assert!((row[0] - 40.0).abs() < 4.0 * row[1] && row[1] < 0.2, "{text}");
    }
    let picture = std::fs::read(dir.path().join("flight.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG") && picture.len() > 5000, "{} bytes", picture.len());
}
