//! The core, the papers' systems and the pad's detector use no standard library and no heap.

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

/// The code of core, papers and pad uses neither `alloc` nor `std`, except in tests.
#[test]
fn core_papers_and_pad_name_neither_alloc_nor_std_outside_of_tests() {
    let crates = ["core/src", "papers/src", "pad/src"];
    let files: Vec<PathBuf> = crates.iter().flat_map(|folder| files(&root().join(folder), "rs")).collect();
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
            }
            if !lines.any(|line| line == "#[cfg(test)]") {
                break;
            }
        }
    }
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
            let code = line.split("//").next().unwrap();
            let tests_only = number > 0 && lines[number - 1] == "#[cfg(test)]";
            let named = ["alloc::", "extern crate alloc", "std::", "extern crate std"].iter().any(|n| code.contains(n));
            assert!(!named || tests_only, "{}:{}: {line}", file.display(), number + 1);
        }
    }
}
