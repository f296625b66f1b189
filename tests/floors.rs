//! The floors of the core stand one on the other: every import goes to a floor that is allowed, so that none goes round.
//!
//! What is read is the code, tests among it. A path to another floor begins with `crate::`; one of `super::` may not leave
//! its floor.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use foxhound_tests::root;

/// Each floor and the others that it imports, from the ground up.
const FLOORS: [(&str, &[&str]); 9] = [
    ("base", &[]),
    ("signal", &["base"]),
    ("doa", &["base", "signal"]),
    ("mapping", &["base"]),
    ("localize", &["base", "doa", "mapping"]),
    ("planning", &["base", "mapping", "localize"]),
    ("landing", &["base", "doa", "localize"]),
    ("control", &["base", "mapping", "planning"]),
    ("guidance", &["base", "signal", "doa", "mapping", "localize", "planning", "landing", "control"]),
];

/// The one name at the root that is no floor: it is from `base`.
const ERROR: &str = "ConfigError";

/// The code without comments and strings, and without blanks but between two words.
fn packed(text: &str) -> String {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut code = String::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("'\"'") || rest.starts_with("'\\\"'") {
            if rest.starts_with("'\"") { 3 } else { 4 }
        } else if first == '"' {
            let mut is_escaped = false;
            let end = rest[1..].find(|c| {
                let is_end = c == '"' && !is_escaped;
                is_escaped = c == '\\' && !is_escaped;
                is_end
            });
            end.map_or(rest.len(), |end| end + 2)
        } else {
            first.len_utf8()
        };
        code.push_str(if length == first.len_utf8() { &rest[..length] } else { " " });
        rest = &rest[length..];
    }
    let mut packed = String::new();
    for word in code.split_whitespace() {
        if packed.ends_with(is_word) && word.starts_with(is_word) {
            packed.push(' ');
        }
        packed.push_str(word);
    }
    packed
}

/// What a module's code names at the root of the crate.
fn named_at_root(module: &[&str], text: &str) -> BTreeSet<String> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let first_word = |path: &str| path.split(|c| !is_word(c)).next().unwrap_or_default().to_owned();
    let code = packed(text);
    let mut found = BTreeSet::new();
    for (at, _) in code.match_indices("crate") {
        let (before, behind) = (&code[..at], &code[at + "crate".len()..]);
        if before.ends_with(is_word) || behind.starts_with(is_word) || before.ends_with('(') && behind.starts_with(')')
        {
            continue;
        }
        if let Some(tree) = behind.strip_prefix("::{") {
            let mut depth = 0;
            for part in tree.split_inclusive(['{', '}', ',']) {
                if depth == 0 && part.len() > 1 {
                    found.insert(first_word(part));
                }
                depth += i32::from(part.ends_with('{')) - i32::from(part.ends_with('}'));
                if depth < 0 {
                    break;
                }
            }
        } else {
            // Nothing where the crate itself is given another name.
            found.insert(behind.strip_prefix("::").map(first_word).unwrap_or_default());
        }
    }
    // As many as there are above it lead out of the floor.
    if code.contains(&"super::".repeat(module.len())) {
        found.insert("super".to_owned());
    }
    found
}

/// The core's files, each as a path from `core/src`.
fn files() -> Vec<PathBuf> {
    let top = root().join("core/src");
    let (mut folders, mut found) = (vec![top.clone()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push(path.strip_prefix(&top).unwrap().to_path_buf());
            }
        }
    }
    found.sort();
    found
}

/// The names of a file's modules, from its floor to itself.
fn module(file: &Path) -> Vec<&str> {
    let names = file.iter().map(|name| name.to_str().unwrap()).filter(|name| *name != "mod.rs");
    names.map(|name| name.trim_end_matches(".rs")).collect()
}

#[test]
fn every_import_goes_to_a_floor_that_is_allowed() {
    let (mut wrong, mut arrows) = (Vec::new(), BTreeSet::new());
    let files = files();
    assert!(files.len() > 100, "{}", files.len());
    for file in files.iter().filter(|file| *file != Path::new("lib.rs")) {
        let module = module(file);
        let floor = FLOORS.iter().find(|floor| floor.0 == module[0]);
        let (floor, allowed) = floor.unwrap_or_else(|| panic!("{} stands on no floor", file.display()));
        let text = std::fs::read_to_string(root().join("core/src").join(file)).unwrap();
        for name in named_at_root(&module, &text) {
            let name = if name == ERROR { "base" } else { &name };
            if allowed.contains(&name) {
                arrows.insert((*floor, name.to_owned()));
            } else if name != *floor {
                wrong.push(format!("core/src/{} names `{name}`", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "floors import what they may not:\n{}", wrong.join("\n"));
    // What nobody needs any more is not allowed any more.
    let allowed: BTreeSet<_> =
        FLOORS.iter().flat_map(|(floor, all)| all.iter().map(|name| (*floor, (*name).to_owned()))).collect();
    assert_eq!(arrows, allowed);
}

#[test]
fn no_imports_of_floors_go_round() {
    for (at, (floor, imports)) in FLOORS.iter().enumerate() {
        for import in *imports {
            assert!(
                FLOORS[..at].iter().any(|below| below.0 == *import),
                "{floor} imports {import}, which is not below it"
            );
        }
    }
}

#[test]
fn the_root_declares_the_floors_and_nothing_else() {
    let text = std::fs::read_to_string(root().join("core/src/lib.rs")).unwrap();
    let declared: BTreeSet<&str> =
        text.lines().filter_map(|line| line.split_once("mod ")?.1.strip_suffix(';')).collect();
    assert_eq!(declared, FLOORS.iter().map(|floor| floor.0).collect());
    let exported: Vec<&str> = text.lines().filter(|line| line.starts_with("pub use ")).collect();
    assert_eq!(exported, [format!("pub use base::error::{ERROR};")]);
}

#[test]
fn an_import_is_seen_however_it_is_written() {
    let named = |text: &str| named_at_root(&["mapping", "map", "index"], text).into_iter().collect::<Vec<_>>();
    for text in [
        "use crate::planning::planner::Plan;",
        "pub(in crate::planning) fn f() {}",
        "pub use crate::{\n    // Beside it\n    planning,\n};",
        "let far = crate :: planning\n    ::planner::FAR_M;",
        "fn f(c: char) -> bool { c == '\"' || crate::planning::is_far(\"\\\"\") }",
    ] {
        assert_eq!(named(text), ["planning"], "{text}");
    }
    let tree = "use crate::{base::{sort, math::{self, sqrt}}, control, doa::{array, bearing::{Flags}}, planning as p};";
    assert_eq!(named(tree), ["base", "control", "doa", "planning"]);
    assert_eq!(named("use crate as all;"), [""]);
    assert_eq!(named("use super::super::super::planning::Plan;"), ["super"]);
    let none = "//! [`crate::planning`]\npub(crate) fn f() { super::super::g(\"crate::planning\") } // crate::planning";
    assert!(named(none).is_empty());
}
