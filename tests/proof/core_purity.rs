//! The core, the papers' systems and the pad's detector use no standard library and no heap, and the simulated world none of its
//! mathematics.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::Command;

use foxhound_tests::{errors, files, root};

/// All crates that the core may depend on, with its features off: each is `no_std` and allocates nothing.
const ALLOWED: [&str; 15] = [
    "byteorder",
    "cfg-if",
    "foxhound-core",
    "hash32",
    "heapless",
    "libm",
    "micromath",
    "microfft",
    "num-complex",
    "num-traits",
    "autocfg",
    "rand_core",
    "rand_xoshiro",
    "stable_deref_trait",
    "static_assertions",
];

/// Functions of floats whose last bits may be others on another system.
const OF_THE_SYSTEM: [&str; 22] = [
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sin_cos", "sinh", "cosh", "tanh", "exp", "exp2", "exp_m1",
    "ln", "ln_1p", "log", "log2", "log10", "powf", "hypot", "cbrt",
];

/// The crates that a package is built from, itself among them.
fn built_from(package: &str) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .current_dir(root())
        .args(["tree", "-p", package, "-e", "normal", "--prefix", "none", "--format", "{p}"])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", errors(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect()
}

/// The core depends on no crate but the listed ones, which are `no_std` and allocate nothing.
#[test]
fn the_core_depends_on_no_crate_beyond_the_known_ones() {
    let found = built_from("foxhound-core");
    assert!(found.contains("foxhound-core"));
    let unknown: Vec<_> = found.iter().filter(|name| !ALLOWED.contains(&name.as_str())).collect();
    assert!(unknown.is_empty(), "new under the core: {unknown:?}");
}

/// The crates of the papers and the pad depend on the core and on what it depends on, and nothing else.
#[test]
fn papers_and_pad_depend_on_the_core_and_on_nothing_that_it_does_not() {
    let core = built_from("foxhound-core");
    for package in ["foxhound-papers", "foxhound-pad"] {
        let its = built_from(package);
        assert_eq!(its.difference(&core).collect::<Vec<_>>(), [package]);
        assert!(its.contains("foxhound-core"));
    }
}

/// The lines of the code in these folders, without comments and tests; each with its file and number.
fn code_outside_of_tests(folders: &[&str]) -> Vec<(String, String)> {
    let files: Vec<PathBuf> = folders.iter().flat_map(|folder| files(&root().join(folder), "rs")).collect();
    assert!(files.len() > 20);
    // Files that are a module of their own, there for tests only: `#[cfg(test)] mod scenes;` in the same folder or in
    // that of the file's name.
    let mut tests_only = BTreeSet::new();
    for file in &files {
        let text = std::fs::read_to_string(file).unwrap();
        let mut lines = text.lines().skip_while(|line| *line != "#[cfg(test)]").skip(1);
        while let Some(line) = lines.find(|line| !line.starts_with("#[")) {
            let name = line.rsplit("mod ").next().and_then(|name| name.strip_suffix(';'));
            if let (true, Some(name)) = (line.contains("mod "), name) {
                // A file, or a folder with all that is in it.
                tests_only.insert(file.with_file_name(name));
                tests_only.insert(file.with_file_name(format!("{name}.rs")));
                tests_only.insert(file.with_extension("").join(format!("{name}.rs")));
                tests_only.insert(file.with_extension("").join(name));
            }
            if !lines.any(|line| line == "#[cfg(test)]") {
                break;
            }
        }
    }
    let mut code = Vec::new();
    for file in files.into_iter().filter(|file| !file.ancestors().any(|part| tests_only.contains(part))) {
        let text = std::fs::read_to_string(&file).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        // Up to the first module that is there for tests only.
        let opens_tests = |at: usize| {
            let next = lines[at + 1..].iter().find(|line| !line.trim_start().starts_with("#["));
            lines[at] == "#[cfg(test)]" && next.is_some_and(|line| line.contains("mod ") && line.ends_with('{'))
        };
        let end = (0..lines.len()).find(|at| opens_tests(*at)).unwrap_or(lines.len());
        for (number, line) in lines[..end].iter().enumerate() {
            if number == 0 || lines[number - 1] != "#[cfg(test)]" {
                let place = format!("{}:{}: {line}", file.display(), number + 1);
                code.push((place, line.split("//").next().unwrap().to_owned()));
            }
        }
    }
    code
}

/// The code of core, papers and pad uses neither `alloc` nor `std`, except in tests.
#[test]
fn core_papers_and_pad_name_neither_alloc_nor_std_outside_of_tests() {
    for (place, code) in code_outside_of_tests(&["core/src", "papers/src", "pad/src"]) {
        let named =
            ["alloc::", "extern crate alloc", "std::", "extern crate std"].iter().any(|name| code.contains(name));
        assert!(!named, "{place}");
    }
}

/// The simulated world has its sines and powers from `libm`: the standard library leaves theirs to the system.
#[test]
fn the_simulated_world_asks_no_system_for_a_sine() {
    let folders = ["autopilot", "drive", "scenario", "world"].map(|folder| format!("host-sim/src/{folder}"));
    for (place, code) in code_outside_of_tests(&folders.each_ref().map(String::as_str)) {
        let asks = |name| [".", "f32::", "f64::"].iter().any(|of| code.contains(&format!("{of}{name}(")));
        assert!(!OF_THE_SYSTEM.iter().any(asks), "{place}");
    }
}
