//! `tests/README.md` lists what each test proves. The list is written from the comments above the tests:
//! `FOXHOUND_RENEW=1 cargo test -p foxhound-tests --test proof readme` writes it again.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use foxhound_tests::{files, root};

/// What stands above it in the page is written by hand.
const BEGIN: &str = "<!-- From here on the page is written by `tests/proof/readme.rs`. -->\n";

/// A test, as its source has it.
#[derive(Debug, PartialEq, Eq)]
struct Test {
    name: String,
    /// The first sentence of its comment; empty where there is none.
    claim: String,
    /// What it needs, if it is left out by `cargo test`.
    needs: Option<String>,
}

/// The first sentence of a comment, which begins in each line with the same mark.
fn first_sentence(lines: &[&str], mark: &str) -> String {
    let comment = lines.iter().map_while(|line| line.trim().strip_prefix(mark)).take_while(|line| !line.is_empty());
    let text = comment.map(str::trim).collect::<Vec<_>>().join(" ");
    // A number or an abbreviation goes on in lower case or with a digit.
    let mut ends = text.match_indices(". ").map(|(at, _)| at + 1);
    let end = ends.find(|end| text[end + 1..].starts_with(|c: char| c.is_uppercase() || c == '`'));
    text[..end.unwrap_or(text.len())].to_owned()
}

/// The tests of a source file, in their order.
fn tests(source: &str) -> Vec<Test> {
    let lines: Vec<&str> = source.lines().collect();
    let is_head = |line: &&str| line.trim_start().starts_with("///") || line.trim_start().starts_with("#[");
    let is_test = |at: &usize| lines[*at].trim() == "#[test]";
    let read = |at: usize| {
        let begin = at - lines[..at].iter().rev().take_while(|line| is_head(line)).count();
        let end = at + lines[at..].iter().take_while(|line| is_head(line)).count();
        let behind = lines[end].split_once("fn ").unwrap().1;
        let reason = lines[begin..end].iter().find_map(|line| line.trim().strip_prefix("#[ignore = \""));
        Test {
            name: behind.split('(').next().unwrap_or_default().to_owned(),
            claim: first_sentence(&lines[begin..at], "///"),
            needs: reason.map(|text| text.trim_end_matches("\"]").trim_end_matches(": cargo xtask test").to_owned()),
        }
    };
    (0..lines.len()).filter(is_test).map(read).collect()
}

/// The files of a program, itself first, in the order in which they declare one another.
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

/// The list of a program's tests, under their files; and how many they are.
fn list(program: &str, without_claim: &mut Vec<String>) -> (String, String, usize) {
    let folder = root().join("tests").join(program);
    let modules = modules(&folder.join("main.rs"));
    assert_eq!(modules.len(), files(&folder, "rs").len(), "a file in {} is in no program", folder.display());
    let (mut text, mut count, mut says) = (String::new(), 0, String::new());
    for file in modules {
        let source = std::fs::read_to_string(&file).unwrap();
        let what = first_sentence(&source.lines().collect::<Vec<_>>(), "//!");
        if file.ends_with("main.rs") {
            says = what;
            continue;
        }
        let tests = tests(&source);
        if tests.is_empty() {
            continue;
        }
        let path = file.strip_prefix(root().join("tests")).unwrap().display().to_string();
        write!(text, "\n### [{path}]({path})\n\n{what}\n\n").unwrap();
        for Test { name, claim, needs } in tests {
            if claim.is_empty() {
                without_claim.push(format!("{path}: {name}"));
            }
            let needs = needs.map_or_else(String::new, |needs| format!(" ({needs})"));
            writeln!(text, "- {claim}{needs}\n  `{name}`").unwrap();
            count += 1;
        }
    }
    (says, text, count)
}

/// The programs, in the order in which `tests/Cargo.toml` has them.
fn programs() -> Vec<String> {
    let manifest = std::fs::read_to_string(root().join("tests/Cargo.toml")).unwrap();
    let paths = manifest.lines().filter_map(|line| line.strip_prefix("path = \"")?.strip_suffix("/main.rs\""));
    paths.map(str::to_owned).collect()
}

/// `tests/README.md` lists every test of these programs with what it proves, and each has a comment that says so.
#[test]
fn the_readme_lists_every_test_with_what_it_proves() {
    let (mut table, mut lists, mut without_claim) =
        (String::from("| program | tests | what they prove |\n|---|---|---|\n"), String::new(), Vec::new());
    for program in programs() {
        let (says, list, count) = list(&program, &mut without_claim);
        writeln!(table, "| [{program}](#{program}) | {count} | {says} |").unwrap();
        write!(lists, "\n## {program}\n\n{says}\n{list}").unwrap();
    }
    assert!(without_claim.is_empty(), "no comment says what is proved: {without_claim:#?}");

    let path = root().join("tests/README.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (by_hand, written) = page.split_once(BEGIN).unwrap();
    let expected = format!("\n{table}{lists}");
    if std::env::var_os("FOXHOUND_RENEW").is_some() {
        std::fs::write(path, format!("{by_hand}{BEGIN}{expected}")).unwrap();
    } else {
        let advice = "FOXHOUND_RENEW=1 cargo test -p foxhound-tests --test proof readme";
        assert!(written == expected, "tests/README.md is old: {advice}");
    }
}

/// The first sentence of a comment is found, over lines, past numbers and abbreviations, and so is what a test needs.
#[test]
fn a_test_is_read_as_it_is_written() {
    let source = "//! A file.\n\n/// Of Fig. 2 at least 0.5 m,\n/// in calm air. More of it.\n#[test]\n\
                  #[ignore = \"needs QEMU: cargo xtask test\"]\nfn it_flies() {\n}\n\n    #[test]\n    fn nameless() {}\n";
    let with = |name: &str, claim: &str, needs: Option<&str>| Test {
        name: name.to_owned(),
        claim: claim.to_owned(),
        needs: needs.map(str::to_owned),
    };
    let expected =
        [with("it_flies", "Of Fig. 2 at least 0.5 m, in calm air.", Some("needs QEMU")), with("nameless", "", None)];
    assert_eq!(tests(source), expected);
}
