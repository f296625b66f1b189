//! The layers of the core, the folders of the simulator, and the modules of the firmware: every import goes to an
//! allowed layer. Every layer imports only those below it, so there are no circles, neither of layers nor of files of
//! different layers.
//!
//! The check reads the code, including tests. A path to another layer begins with `crate::`, or with the library's
//! name in the program beside it; a path with `super::` may not leave its layer.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use foxhound_tests::{files, root};

/// A crate whose imports are checked.
struct Layout {
    /// Its sources, from the top of the repository.
    sources: &'static str,
    /// The name of its root in a path.
    roots: &'static [&'static str],
    /// Each layer and those that it imports, from the lowest up.
    floors: &'static [(&'static str, &'static [&'static str])],
    /// The one name at the root that is not a layer, and the layer that it is from.
    exported: Option<(&'static str, &'static str)>,
    /// Files and folders outside the layers: they combine them.
    roofs: &'static [&'static str],
    /// The check fails if there are fewer files than that.
    files_min: usize,
}

const CORE: Layout = Layout {
    sources: "core/src",
    roots: &["crate"],
    floors: &[
        ("base", &[]),
        ("signal", &["base"]),
        ("doa", &["base", "signal"]),
        ("mapping", &["base"]),
        ("localize", &["base", "doa", "mapping"]),
        ("planning", &["base", "mapping", "localize"]),
        ("landing", &["base", "doa", "localize"]),
        ("control", &["base", "mapping", "planning"]),
        ("guidance", &["base", "signal", "doa", "mapping", "localize", "planning", "landing", "control"]),
    ],
    exported: Some(("ConfigError", "base")),
    roofs: &["lib.rs"],
    files_min: 100,
};

const SIMULATOR: Layout = Layout {
    sources: "host-sim/src",
    roots: &["crate", "foxhound_sim"],
    floors: &[
        ("scenario", &[]),
        ("world", &["scenario"]),
        ("autopilot", &["scenario", "world"]),
        ("tools", &["scenario", "world", "autopilot"]),
        ("drive", &["scenario", "world", "autopilot"]),
        ("record", &["scenario", "world", "drive"]),
        ("study", &["scenario", "world", "drive", "record"]),
        ("cli", &["scenario", "world", "autopilot", "tools", "drive", "record", "study"]),
    ],
    exported: None,
    roofs: &["lib.rs", "main.rs"],
    files_min: 100,
};

/// No board knows the application, nor the application a board.
const FIRMWARE: Layout = Layout {
    sources: "firmware/src",
    roots: &["crate", "foxhound_firmware"],
    floors: &[
        ("register_values", &[]),
        ("board", &[]),
        ("timing", &["board"]),
        ("console", &["board", "timing"]),
        ("app", &["board", "timing", "console"]),
        ("arm", &["register_values", "board"]),
        ("boards", &["register_values", "board", "arm"]),
        ("program", &["board", "console", "app", "boards"]),
    ],
    exported: None,
    roofs: &["lib.rs", "main.rs", "bin"],
    files_min: 25,
};

const LAYOUTS: [Layout; 3] = [CORE, SIMULATOR, FIRMWARE];

/// The length of the raw string that the rest begins with.
fn raw_string(before: &str, rest: &str) -> Option<usize> {
    let opening = rest.strip_prefix('r').filter(|_| !before.ends_with(is_word_but_b))?;
    let hashes = opening.len() - opening.trim_start_matches('#').len();
    let text = opening[hashes..].strip_prefix('"')?;
    let closing = format!("\"{}", &opening[..hashes]);
    text.find(&closing).map(|end| 1 + hashes + 1 + end + closing.len())
}

/// `br"..."` is a raw string too.
fn is_word_but_b(c: char) -> bool {
    c != 'b' && (c.is_alphanumeric() || c == '_')
}

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
        } else if let Some(length) = raw_string(&code, rest) {
            length
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
fn named_at_root(roots: &[&str], module: &[&str], text: &str) -> BTreeSet<String> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let first_word = |path: &str| path.split(|c| !is_word(c)).next().unwrap_or_default().to_owned();
    let code = packed(text);
    let mut found = BTreeSet::new();
    let places = roots.iter().flat_map(|root| code.match_indices(root).map(|(at, root)| (at, at + root.len())));
    for (before, behind) in places.map(|(from, to)| (&code[..from], &code[to..])) {
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

/// A crate's files, each as a path from its sources.
fn files_of(sources: &str) -> Vec<PathBuf> {
    let top = root().join(sources);
    files(&top, "rs").iter().map(|path| path.strip_prefix(&top).unwrap().to_path_buf()).collect()
}

/// The names of a file's modules, from its floor to itself.
fn module(file: &Path) -> Vec<&str> {
    let names = file.iter().map(|name| name.to_str().unwrap()).filter(|name| *name != "mod.rs");
    names.map(|name| name.trim_end_matches(".rs")).collect()
}

fn check_imports(layout: &Layout) {
    let (mut wrong, mut arrows) = (Vec::new(), BTreeSet::new());
    let files = files_of(layout.sources);
    assert!(files.len() > layout.files_min, "{}", files.len());
    let is_roof = |file: &&PathBuf| layout.roofs.iter().any(|roof| file.starts_with(roof));
    for file in files.iter().filter(|file| !is_roof(file)) {
        let module = module(file);
        let Some((floor, allowed)) = layout.floors.iter().find(|floor| floor.0 == module[0]) else {
            wrong.push(format!("{}/{} stands on no floor", layout.sources, file.display()));
            continue;
        };
        let text = std::fs::read_to_string(root().join(layout.sources).join(file)).unwrap();
        for name in named_at_root(layout.roots, &module, &text) {
            let name =
                layout.exported.filter(|exported| exported.0 == name).map_or(name.as_str(), |exported| exported.1);
            if allowed.contains(&name) {
                arrows.insert((*floor, name.to_owned()));
            } else if name != *floor {
                wrong.push(format!("{}/{} names `{name}`", layout.sources, file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "what may not be:\n{}", wrong.join("\n"));
    // Unused permissions are not allowed.
    let allowed: BTreeSet<_> =
        layout.floors.iter().flat_map(|(floor, all)| all.iter().map(|name| (*floor, (*name).to_owned()))).collect();
    assert_eq!(arrows, allowed);
}

/// Every import between modules of the core is one of the allowed ones, and each allowed one is used.
#[test]
fn every_import_of_the_core_goes_to_a_floor_that_is_allowed() {
    check_imports(&CORE);
}

/// Every import between folders of the simulator is one of the allowed ones, and each allowed one is used.
#[test]
fn every_import_of_the_simulator_goes_to_a_folder_that_is_allowed() {
    check_imports(&SIMULATOR);
}

/// Every import between modules of the firmware is one of the allowed ones, and each allowed one is used.
#[test]
fn every_import_of_the_firmware_goes_to_a_module_that_is_allowed() {
    check_imports(&FIRMWARE);
}

/// The allowed imports contain no cycle.
#[test]
fn no_imports_of_floors_go_round() {
    for Layout { floors, .. } in LAYOUTS {
        for (at, (floor, imports)) in floors.iter().enumerate() {
            for import in *imports {
                assert!(
                    floors[..at].iter().any(|below| below.0 == *import),
                    "{floor} imports {import}, which is not below it"
                );
            }
        }
    }
}

/// The crate roots declare the listed modules and nothing else.
#[test]
fn the_roots_declare_the_floors_and_nothing_else() {
    for Layout { sources, floors, exported, roofs, .. } in LAYOUTS {
        let read = |roof| std::fs::read_to_string(root().join(sources).join(roof)).unwrap();
        let text: String = roofs.iter().filter(|roof| roof.ends_with(".rs")).map(read).collect();
        let declared: BTreeSet<&str> =
            text.lines().filter_map(|line| line.split_once("mod ")?.1.strip_suffix(';')).collect();
        assert_eq!(declared, floors.iter().map(|floor| floor.0).collect());
        let found: Vec<&str> = text.lines().filter(|line| line.starts_with("pub use ")).collect();
        let expected = exported.map(|(name, floor)| format!("pub use {floor}::error::{name};"));
        assert_eq!(found, Vec::from_iter(expected));
    }
}

/// The check finds an import in whatever way it is written.
#[test]
fn an_import_is_seen_however_it_is_written() {
    let named = |text: &str| {
        named_at_root(&["crate", "foxhound_sim"], &["mapping", "map", "index"], text).into_iter().collect::<Vec<_>>()
    };
    for text in [
        "use crate::planning::planner::Plan;",
        "pub(in crate::planning) fn f() {}",
        "pub use crate::{\n    // Beside it\n    planning,\n};",
        "let far = crate :: planning\n    ::planner::FAR_M;",
        "use foxhound_sim::planning::planner;",
        "fn f() -> bool { r#\"{\"a\": \"}\"# == crate::planning::NAME }",
        "fn f(c: char) -> bool { c == '\"' || crate::planning::is_far(\"\\\"\") }",
    ] {
        assert_eq!(named(text), ["planning"], "{text}");
    }
    let tree = "use crate::{base::{sort, math::{self, sqrt}}, control, doa::{array, bearing::{Flags}}, planning as p};";
    assert_eq!(named(tree), ["base", "control", "doa", "planning"]);
    assert_eq!(named("use crate as all;"), [""]);
    assert_eq!(named("use super::super::super::planning::Plan;"), ["super"]);
    let none = "//! [`crate::planning`]\npub(crate) fn f() { super::super::g(\"crate::planning\") } // crate::planning
        fn h() { g(r#\"\"crate::planning\", 3 of \"#, b\"crate::planning\") }";
    assert!(named(none).is_empty());
}

/// All crates of the repository, by their sources.
const CRATES: [&str; 10] = [
    "computer/src",
    "core/src",
    "firmware/src",
    "fuzz/src",
    "host-sim/src",
    "link/src",
    "pad/src",
    "papers/src",
    "python/src",
    "xtask/src",
];

/// The paths of a tree of imports, each behind `before`.
fn expand(before: &[String], tree: &str, found: &mut BTreeSet<Vec<String>>) {
    let (mut path, mut rest) = (before.to_vec(), tree);
    loop {
        if let Some(list) = rest.strip_prefix('{') {
            let (mut depth, mut from) = (0, 0);
            for (at, c) in list.char_indices() {
                match c {
                    '{' => depth += 1,
                    '}' if depth > 0 => depth -= 1,
                    ',' | '}' if depth == 0 => {
                        expand(&path, &list[from..at], found);
                        from = at + 1;
                        if c == '}' {
                            return;
                        }
                    }
                    _ => {}
                }
            }
            return;
        }
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
        path.push(rest[..end].to_owned());
        match rest[end..].strip_prefix("::") {
            Some(next) => rest = next,
            None => break,
        }
    }
    found.insert(path);
}

/// The modules, from the root of the crate, that a module's code uses, with the names used in them.
fn named_anywhere(module: &[&str], text: &str) -> BTreeSet<Vec<String>> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let code = packed(text);
    // Tests are at the end, in a module of their own.
    let code = code.split("#[cfg(test)]mod tests{").next().unwrap_or_default();
    let mut found = BTreeSet::new();
    for start in ["crate", "super", "foxhound_sim", "foxhound_firmware"] {
        for (at, _) in code.match_indices(&format!("{start}::")) {
            if !code[..at].ends_with(is_word) && !code[..at].ends_with("::") {
                expand(&[], &code[at..], &mut found);
            }
        }
    }
    let from_root = |path: Vec<String>| {
        let above = path.iter().take_while(|name| *name == "super").count();
        let base = if above == 0 { &[] } else { &module[..module.len().saturating_sub(above)] };
        let named = path.into_iter().skip(above.max(1));
        base.iter().map(|name| (*name).to_owned()).chain(named).collect()
    };
    found.into_iter().map(from_root).collect()
}

/// Removes edges to nodes without outgoing edges, and from nodes without incoming ones, until none is left to remove.
fn circles(mut arrows: BTreeSet<(PathBuf, PathBuf)>) -> BTreeSet<(PathBuf, PathBuf)> {
    loop {
        let (begins, ends): (BTreeSet<PathBuf>, BTreeSet<PathBuf>) = arrows.iter().cloned().unzip();
        let before = arrows.len();
        arrows.retain(|(from, to)| begins.contains(to) && ends.contains(from));
        if arrows.len() == before {
            return arrows;
        }
    }
}

/// No files of a crate import each other in a circle; a module and those inside it may.
#[test]
fn no_imports_of_files_go_round() {
    let mut arrows = BTreeSet::new();
    for sources in CRATES {
        let files: Vec<PathBuf> = files_of(sources).into_iter().filter(|file| !file.starts_with("bin")).collect();
        let modules: Vec<Vec<&str>> = files.iter().map(|file| module(file)).collect();
        for (file, from) in files.iter().zip(&modules) {
            let text = std::fs::read_to_string(root().join(sources).join(file)).unwrap();
            for path in named_anywhere(from, &text) {
                // The innermost module on the path.
                let to = (1..=path.len()).rev().find_map(|length| modules.iter().position(|to| path[..length] == **to));
                if let Some(to) = to.filter(|to| !from.starts_with(&modules[*to]) && !modules[*to].starts_with(from)) {
                    arrows.insert((Path::new(sources).join(file), Path::new(sources).join(&files[to])));
                }
            }
        }
    }
    assert!(arrows.len() > 1000, "{}", arrows.len());
    let round = circles(arrows);
    assert!(round.is_empty(), "files that import each other:\n{round:#?}");
}

/// A circle of three files is found, without the files that lead to it or from it.
#[test]
fn a_circle_of_files_is_seen() {
    let named =
        named_anywhere(&["map", "index"], "use super::{motion::{self, Motion}, Known}; fn f() { crate::scan::g(); }");
    let named: Vec<String> = named.iter().map(|path| path.join("/")).collect();
    assert_eq!(named, ["map/Known", "map/motion/Motion", "map/motion/self", "scan/g"]);
    let arrows = [("z", "a"), ("a", "b"), ("b", "c"), ("c", "a"), ("c", "d"), ("d", "e")];
    let round = circles(arrows.map(|(from, to)| (PathBuf::from(from), PathBuf::from(to))).into());
    assert_eq!(round.len(), 3);
}
