//! The manual is consistent: every page is in its summary, every link leads somewhere, every file that it names
//! exists, and the program accepts every command that it shows.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use foxhound_tests::{errors, files, foxhound, root, run, run_json, text};

/// All pages below `docs`, by their path from the root.
fn pages() -> Vec<PathBuf> {
    let found = files(&root().join("docs"), "md");
    found.iter().map(|page| page.strip_prefix(root()).unwrap().to_path_buf()).collect()
}

fn pages_and_readme() -> Vec<PathBuf> {
    let others = ["README.md", "CONTRIBUTING.md", "tests/README.md"].map(PathBuf::from);
    pages().into_iter().chain(others).collect()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(root().join(path)).unwrap()
}

/// The lines of a page, each with whether it stands in a block of code.
fn lines(text: &str) -> Vec<(bool, &str)> {
    let mut is_fenced = false;
    let mut found = Vec::new();
    for line in text.lines() {
        let is_fence = line.trim_start().starts_with("```");
        found.push((is_fenced || is_fence || line.starts_with("    "), line));
        is_fenced ^= is_fence;
    }
    found
}

/// The lines of a page that are code, or those that are not.
fn only(text: &str, is_code: bool) -> String {
    lines(text).iter().filter(|line| line.0 == is_code).map(|line| format!("{}\n", line.1)).collect()
}

/// Where the links and pictures of a page lead.
fn links(text: &str) -> Vec<String> {
    let prose = only(text, false);
    prose.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0.to_owned())).collect()
}

/// What stands between backticks in the prose of a page.
fn spans(text: &str) -> Vec<String> {
    only(text, false).split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

/// The anchors of a page's headings.
fn anchors(text: &str) -> BTreeSet<String> {
    let headings = lines(text).into_iter().filter(|(is_code, line)| !is_code && line.starts_with('#'));
    headings
        .map(|(_, line)| {
            let title = line.trim_start_matches('#').trim().to_lowercase();
            let kept = title.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
            kept.map(|c| if c == ' ' { '-' } else { c }).collect()
        })
        .collect()
}

/// A path without its `..`.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => assert!(plain.pop(), "{} leads out of the repository", path.display()),
            Component::CurDir => {}
            part => plain.push(part),
        }
    }
    plain
}

/// The commands of a page that are ours, as words: those in blocks of code, without what a shell does around them.
fn commands(text: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for line in only(text, true).replace("\\\n", " ").lines() {
        let line = line.trim().trim_start_matches("$ ");
        let line = line.split(" #").next().unwrap_or_default();
        // What a shell puts in for `$(...)`, we cannot know.
        let line = match (line.split_once("$("), line.rsplit_once(')')) {
            (Some((before, _)), Some((_, after))) => format!("{before}x{after}"),
            _ => line.to_owned(),
        };
        for command in line.split("&&").flat_map(|part| part.split(" | ")) {
            let command = command.split(" > ").next().unwrap_or_default().trim();
            let arguments = if let Some(rest) = command.strip_prefix("foxhound ") {
                rest
            } else if let Some((_, rest)) = command.split_once(" -- ").filter(|_| is_our_run(command)) {
                rest
            } else {
                continue;
            };
            found.push(arguments.split_whitespace().map(str::to_owned).collect());
        }
    }
    found
}

/// Whether it is `cargo run` for the program itself and not for an example.
fn is_our_run(command: &str) -> bool {
    command.starts_with("cargo run ") && !command.contains("--example") && !command.contains(" -p ")
}

/// Every page of the manual is in its summary, and the summary names no other.
#[test]
fn every_page_is_in_the_summary_and_the_summary_names_no_other() {
    let listed: Vec<PathBuf> =
        links(&read(Path::new("docs/SUMMARY.md"))).iter().map(|link| Path::new("docs").join(link)).collect();
    let unique: BTreeSet<&PathBuf> = listed.iter().collect();
    assert_eq!(unique.len(), listed.len(), "a page stands in the summary twice");
    let pages = pages();
    let there: BTreeSet<&PathBuf> = pages.iter().filter(|page| !page.ends_with("SUMMARY.md")).collect();
    assert!(there.len() > 20, "{there:?}");
    assert_eq!(unique, there);
}

/// Every link and picture of the manual leads to a file and a heading that exist.
#[test]
fn every_link_and_picture_leads_to_a_file_and_a_heading_that_are_there() {
    let mut checked = 0;
    for page in pages_and_readme() {
        for link in links(&read(&page)) {
            if link.starts_with("http://") || link.starts_with("https://") {
                continue;
            }
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let target =
                if file.is_empty() { page.clone() } else { plain(&page.parent().unwrap_or(Path::new("")).join(file)) };
            assert!(root().join(&target).exists(), "{}: {link} leads nowhere", page.display());
            assert!(
                anchor.is_empty() || anchors(&read(&target)).contains(anchor),
                "{}: {link}: no such heading",
                page.display()
            );
            // The book is built from docs alone: what lies elsewhere is named, not linked to.
            assert!(
                !page.starts_with("docs") || target.starts_with("docs"),
                "{}: {link} leads out of the book",
                page.display()
            );
            checked += 1;
        }
    }
    assert!(checked > 60, "only {checked} links found");
}

/// Every picture of the manual is shown on a page.
#[test]
fn every_picture_is_shown_on_a_page() {
    let shown: BTreeSet<PathBuf> = pages_and_readme()
        .iter()
        .flat_map(|page| links(&read(page)).into_iter().map(|link| page.parent().unwrap().join(link)))
        .map(|path| plain(&path))
        .collect();
    for picture in ["svg", "png"].into_iter().flat_map(|ending| files(&root().join("docs"), ending)) {
        assert!(shown.contains(picture.strip_prefix(root()).unwrap()), "{} is shown nowhere", picture.display());
    }
}

/// Every file of the repository that the manual names exists.
#[test]
fn every_file_of_ours_that_a_page_names_is_there() {
    const FOLDERS: [&str; 12] = [
        "core/",
        "computer/",
        "link/",
        "firmware/",
        "host-sim/",
        "tests/",
        "fuzz/",
        "examples/",
        "python/",
        "docs/",
        "xtask/",
        "scenarios/",
    ];
    let mut checked = 0;
    for page in pages_and_readme() {
        for span in spans(&read(&page)) {
            let is_path = span.chars().all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c));
            if is_path && FOLDERS.iter().any(|folder| span.starts_with(folder)) {
                // A test may be a file or a folder: `tests/computer/failsafes`.
                assert!(root().join(&span).exists(), "{} names {span}, which is not there", page.display());
                checked += 1;
            }
        }
    }
    assert!(checked > 60, "only {checked} names found");
}

/// The manual explains every parameter of the files that set up an autopilot.
#[test]
fn every_parameter_of_the_autopilots_files_is_explained() {
    let page = read(Path::new("docs/hardware/autopilot.md"));
    let explained: BTreeSet<&str> = page.split('`').skip(1).step_by(2).collect();
    let mut checked = 0;
    for (file, column) in [("examples/ardupilot.parm", 0), ("examples/px4.params", 2)] {
        for line in read(Path::new(file)).lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
            let name = line.split_whitespace().nth(column).unwrap();
            assert!(explained.contains(name), "{file}: docs/hardware/autopilot.md does not explain {name}");
            checked += 1;
        }
    }
    assert!(checked > 20, "only {checked} parameters found");
}

/// Every benchmark row that the documentation of a module names is in `docs/results/bench.md`, and so is every number of
/// instructions in the README.
#[test]
fn every_benchmark_row_that_a_module_names_is_counted() {
    let bench = read(Path::new("docs/results/bench.md"));
    let counted: BTreeSet<&str> = bench.split_whitespace().collect();
    let mut checked = 0;
    for folder in ["core/src", "papers/src", "pad/src"] {
        for file in files(&root().join(folder), "rs") {
            let text = std::fs::read_to_string(&file).unwrap();
            // A comment that is long goes on in the next line.
            let text: String = text.lines().filter_map(|line| line.strip_prefix("//!")).collect();
            for sentence in text.split(". ").filter(|part| part.contains("bench row") || part.contains("bench's")) {
                for row in sentence.split('`').skip(1).step_by(2) {
                    assert!(counted.contains(row), "{}: docs/results/bench.md has no row {row}", file.display());
                    checked += 1;
                }
            }
        }
    }
    assert!(checked >= 8, "only {checked} rows found");
    let readme = read(Path::new("README.md"));
    let row = readme.lines().find(|line| line.starts_with("| instructions")).unwrap();
    // Thousands are apart by a space.
    let words: Vec<&str> = row.split_whitespace().map(|word| word.trim_end_matches([',', ';'])).collect();
    let is_number = |word: &&str| !word.is_empty() && word.chars().all(|c| c.is_ascii_digit());
    let groups: Vec<&[&str]> =
        words.chunk_by(|one, next| is_number(one) && is_number(next) && next.len() == 3).collect();
    let numbers: Vec<String> = groups.iter().filter(|group| group.len() > 1).map(|group| group.concat()).collect();
    assert_eq!(numbers.len(), 3, "{row}");
    for number in numbers {
        assert!(counted.contains(number.as_str()), "docs/results/bench.md has no {number}");
    }
}

/// Every parameter and telemetry value that any page names exists, and every telemetry value is on the page that lists them.
#[test]
fn every_parameter_and_telemetry_value_that_a_page_names_exists() {
    let listed = |text: &str| -> BTreeSet<String> {
        let is_name = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
        text.split(|c| !is_name(c)).filter(|word| word.starts_with("FH_")).map(str::to_owned).collect()
    };
    // A test holds the page of parameters to what the program prints.
    let table: String = read(Path::new("docs/parameters.md"))
        .lines()
        .filter_map(|line| Some(format!("{} ", line.strip_prefix("| `")?.split_once('`')?.0)))
        .collect();
    let sent: String = read(Path::new("link/src/companion/send.rs"))
        .split("*b\"FH_")
        .skip(1)
        .filter_map(|rest| Some(format!("FH_{} ", rest.split_once('\\')?.0)))
        .collect();
    let (parameters, telemetry) = (listed(&table), listed(&sent));
    assert!(parameters.len() > 50 && telemetry.len() > 10, "{parameters:?} {telemetry:?}");
    for page in pages_and_readme() {
        for name in listed(&read(&page)) {
            assert!(
                parameters.contains(&name) || telemetry.contains(&name),
                "{}: no parameter or telemetry value is called {name}",
                page.display()
            );
        }
    }
    let told = listed(&read(Path::new("docs/autopilot.md")));
    for name in telemetry {
        assert!(told.contains(&name), "docs/autopilot.md does not tell of {name}");
    }
}

/// The program accepts every command that the manual shows.
#[test]
fn every_command_that_the_manual_shows_is_one_that_the_program_takes() {
    let mut checked = 0;
    for page in pages_and_readme() {
        for command in commands(&read(&page)) {
            // What stands before --help is read, and refused where it must be, before help is printed.
            let words: Vec<&str> = command.iter().map(String::as_str).chain(["--help"]).collect();
            let output = run(&words);
            let (page, errors) = (page.display(), errors(&output));
            assert_eq!(output.status.code(), Some(0), "{page}: foxhound {}\n{errors}", command.join(" "));
            assert!(String::from_utf8_lossy(&output.stdout).contains("Usage: foxhound"), "{command:?}");
            checked += 1;
        }
    }
    assert!(checked > 40, "only {checked} commands found");
}

/// The check of the commands would find one that the program refuses.
#[test]
fn a_command_that_the_program_does_not_take_would_be_found() {
    let page =
        "Text.\n\n    foxhound fly --speling 3 && foxhound fly --seed x\n    cargo run --release -- flly --json\n";
    let commands = commands(page);
    assert_eq!(commands.len(), 3);
    for command in commands {
        let words: Vec<&str> = command.iter().map(String::as_str).chain(["--help"]).collect();
        assert_eq!(run(&words).status.code(), Some(2), "{command:?}");
    }
}

/// The first command of the README prints the lines and draws the picture that it shows.
#[test]
fn the_first_command_prints_and_draws_what_the_readme_shows() {
    let dir = tempfile::tempdir().unwrap();
    let output = foxhound().current_dir(dir.path()).output().unwrap();
    let readme = read(Path::new("README.md"));
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        assert!(readme.contains(&format!("    {line}\n")), "the README does not say: {line}");
    }
    let drawn = std::fs::read(dir.path().join("out/flight.svg")).unwrap();
    assert!(drawn == std::fs::read(root().join("docs/flight.svg")).unwrap(), "cp out/flight.svg docs/flight.svg");
}

/// What stands in the fenced blocks of a language.
fn blocks<'a>(page: &'a str, language: &str) -> Vec<&'a str> {
    let fence = format!("```{language}\n");
    page.split(&fence).skip(1).map(|rest| rest.split("```").next().unwrap_or_default()).collect()
}

/// The scenarios of the manual are flown to their beacons.
#[test]
fn the_scenarios_of_the_manual_are_flown_to_their_beacons() {
    let manual = read(Path::new("docs/simulator.md"));
    let (scenarios, tracks) = (blocks(&manual, "json"), blocks(&manual, "csv"));
    assert_eq!((scenarios.len(), tracks.len()), (2, 1));
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("station.csv"), tracks[0]).unwrap();
    for scenario in scenarios {
        let file = dir.path().join("world.json");
        std::fs::write(&file, scenario).unwrap();
        let (code, flight) = run_json(&["fly", "--json", "--scenario", &text(&file)]);
        assert_eq!((code, flight["result"].as_str()), (0, Some("reached")), "{flight}");
    }
}
