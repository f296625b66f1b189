//! Each system test says what it proves, and each file is part of a program.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::{Path, PathBuf};

use foxhound_tests::{files, root};

/// The tests of a source file without a comment.
fn without_comment(source: &str) -> Vec<&str> {
    let lines: Vec<&str> = source.lines().map(str::trim_start).collect();
    let is_head = |line: &&&str| line.starts_with("///") || line.starts_with("#[");
    let says_nothing = |at: &usize| {
        let above = lines[..*at].iter().rev().take_while(is_head);
        lines[*at] == "#[test]" && !above.into_iter().any(|line| line.starts_with("///"))
    };
    let name = |at: usize| *lines[at..].iter().find(|line| line.starts_with("fn ")).unwrap();
    (0..lines.len()).filter(says_nothing).map(name).collect()
}

/// The files of a program, itself first.
fn modules(file: &Path) -> Vec<PathBuf> {
    let source = std::fs::read_to_string(file).unwrap();
    let declares_beside = file.ends_with("main.rs") || file.ends_with("mod.rs");
    let folder = if declares_beside { file.parent().unwrap().to_path_buf() } else { file.with_extension("") };
    let mut found = vec![file.to_path_buf()];
    // A module at another path is no file of the program.
    for line in source.lines().filter(|_| !source.contains("#[path")) {
        let name = line.trim_start_matches("pub ").strip_prefix("mod ").and_then(|rest| rest.strip_suffix(';'));
        if let Some(name) = name {
            let beside = folder.join(format!("{name}.rs"));
            found.extend(modules(&if beside.exists() { beside } else { folder.join(name).join("mod.rs") }));
        }
    }
    found
}

/// Each system test has a comment that says what it proves, and each file with tests is built into a program.
#[test]
fn each_test_says_what_it_proves_and_is_built() {
    let manifest = std::fs::read_to_string(root().join("tests/Cargo.toml")).unwrap();
    let programs = manifest.lines().filter_map(|line| line.strip_prefix("path = \"")?.strip_suffix("/main.rs\""));
    for folder in programs.map(|program| root().join("tests").join(program)) {
        let modules = modules(&folder.join("main.rs"));
        assert_eq!(modules.len(), files(&folder, "rs").len(), "a file in {} is in no program", folder.display());
        for file in modules {
            let source = std::fs::read_to_string(&file).unwrap();
            assert_eq!(without_comment(&source), [""; 0], "{}: what do they prove?", file.display());
        }
    }
}

/// A test without a comment is found between others.
#[test]
fn a_test_without_a_comment_is_found() {
    let source = "/// It flies.\n#[test]\n#[ignore = \"needs QEMU\"]\nfn it_flies() {\n}\n\n    #[test]\n    #[ignore = \"-\"]\n    fn nameless() {}\n";
    assert_eq!(without_comment(source), ["fn nameless() {}"]);
}
