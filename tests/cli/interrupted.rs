//! Full disks and interrupted programs: a result is complete or absent, and the exit status tells which.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use foxhound_tests::{Program, errors, foxhound, run, run_json, signal, take_machine, text};
use serde_json::Value;

use crate::live::Served;
use crate::packed;

const FULL: &str = "/dev/full";

/// Names of the files in a folder.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|entry| text(Path::new(&entry.unwrap().file_name()))).collect();
    names.sort();
    names
}

/// Writes a suite of some seconds into a folder.
fn suite(folder: &Path) -> String {
    let maps = ["maps", "--count", "4", "--pairs", "12", "--seed", "5", "--json", "--out", &text(folder)];
    assert!(run(&maps).status.success());
    text(&folder.join("suite.json"))
}

/// Every output to a full device, including stdout, ends with status 2, "no space left" and the file's name.
#[test]
fn whatever_is_written_to_a_full_disk_is_an_error_with_its_name() {
    if !Path::new(FULL).exists() {
        eprintln!("skipped: there is no {FULL}");
        return;
    }
    for option in ["--report", "--mcap", "--tlog", "--flight-log"] {
        let output = run(&["fly", "--json", option, FULL]);
        let said = errors(&output);
        assert_eq!(output.status.code(), Some(2), "{option}: {said}");
        assert!(said.contains("no space left") && said.contains(FULL), "{option}: {said}");
    }
    let dir = tempfile::tempdir().unwrap();
    let suite = suite(dir.path());
    for option in ["--csv", "--parquet"] {
        let output = run(&["suite", &suite, "--only", "1,0,0", "--json", option, FULL]);
        assert_eq!(output.status.code(), Some(2), "{option}: {}", errors(&output));
        assert!(errors(&output).contains(&format!("{FULL}: no space left")), "{option}: {}", errors(&output));
    }
    for arguments in
        [&["fly", "--json"][..], &["fly", "--quiet"], &["params", "--json"], &["schema"], &["fly", "--help"]]
    {
        let full = std::fs::File::options().write(true).open(FULL).unwrap();
        let output =
            foxhound().current_dir(dir.path()).args(arguments).stdout(full).stderr(Stdio::piped()).spawn().unwrap();
        let output = output.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", errors(&output));
    }
}

/// On a disk that fills up, no incomplete file gets its final name, and a previous file stays as it was.
#[test]
fn a_file_that_does_not_fit_is_not_there_and_the_one_before_it_stays() {
    let dir = tempfile::tempdir().unwrap();
    let before = dir.path().join("f.html");
    std::fs::write(&before, "before").unwrap();
    let program = foxhound().get_program().to_owned();
    // The shell's limit on the size of a file, in kilobytes, stands for the disk.
    let script = "ulimit -f 40; exec \"$0\" fly --quiet --out o --report f.html --mcap f.mcap --tlog f.tlog";
    let output = Command::new("bash").arg("-c").arg(script).arg(program).current_dir(dir.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    for name in ["o/flight.svg", "f.html", "f.mcap", "f.tlog"] {
        assert!(errors(&output).contains(&format!("{name}: no space left")), "{name}: {}", errors(&output));
    }
    assert!(String::from_utf8_lossy(&output.stdout).contains("reached"), "the result is printed all the same");
    assert_eq!(names(dir.path()), ["f.html", "o"]);
    assert_eq!((std::fs::read_to_string(before).unwrap(), names(&dir.path().join("o"))), ("before".to_owned(), vec![]));
}

/// A flight that receives SIGINT or SIGTERM closes its files, prints its result so far, and ends with 130 or 143.
#[test]
fn a_flight_that_is_told_to_end_closes_its_files_and_prints_what_was_flown() {
    for (name, code) in [("-INT", 130), ("-TERM", 143)] {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| text(&dir.path().join(name));
        let (mcap, tlog, report) = (path("f.mcap"), path("f.tlog"), path("f.html"));
        let files = ["--mcap", &mcap, "--tlog", &tlog, "--report", &report, "--flight-log", &path("f.log")];
        let flight = Served::with(&[&["fly", "--speed", "0.5"], &files[..]].concat());
        flight.flies_for(0.7);
        let (ended, printed) = flight.stop_by(name);
        assert_eq!((ended, &printed["result"]), (code, &"interrupted".into()), "{printed}");
        assert!(printed["time_s"].as_f64().unwrap() > 0.1, "{printed}");
        assert_eq!(names(dir.path()), ["f.html", "f.log", "f.mcap", "f.tlog"]);
        let bytes = std::fs::read(&mcap).unwrap();
        assert!(bytes.starts_with(b"\x89MCAP0\r\n") && bytes.ends_with(b"\x89MCAP0\r\n"), "footer");
        let (_, log) = run_json(&["tlog", "--json", &tlog]);
        assert!(log["frames"].as_u64().unwrap() > 20 && log["bad_crc"] == 0, "{log}");
        assert_eq!(run(&["replay", &path("f.log")]).status.code(), Some(0));
        let records = packed::records(&std::fs::read_to_string(&report).unwrap());
        assert_eq!(records[records.len() - 1]["report"], printed);
    }
}

/// The output of a suite, printed and written.
fn results(folder: &Path, output: &Output) -> [Vec<u8>; 4] {
    let file = |name: &str| std::fs::read(folder.join(name)).unwrap();
    [output.stdout.clone(), file("flights.jsonl"), file("f.csv"), file("f.parquet")]
}

fn suite_command(file: &str, out: &Path, more: &[&str]) -> Command {
    let mut command = foxhound();
    command.args(["suite", file, "--json", "--quiet", "--out", &text(out), "--csv", &text(&out.join("f.csv"))]);
    command.args(["--parquet", &text(&out.join("f.parquet"))]).args(more);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Waits until so many lines are in the journal of a suite that is flown.
fn until_lines<'a>(suite: &'a mut Program, count: usize, out: &Path) -> &'a mut Child {
    let since = Instant::now();
    while journal_lines(out) < count {
        assert!(suite.child().try_wait().unwrap().is_none(), "it has ended before");
        assert!(since.elapsed() < Duration::from_secs(120), "it does not fly");
        sleep(Duration::from_millis(2));
    }
    suite.child()
}

/// A suite that is killed by SIGKILL at twenty random moments and resumed gives the same bytes as an uninterrupted one, and leaves no
/// journal behind.
#[test]
fn a_suite_that_is_killed_twenty_times_and_resumed_is_the_suite_in_one_piece() {
    let _machine = take_machine();
    let dir = tempfile::tempdir().unwrap();
    let file = suite(dir.path());
    let (whole_in, out) = (dir.path().join("whole"), dir.path().join("pieces"));
    let whole = suite_command(&file, &whole_in, &[]).output().unwrap();
    let expected = results(&whole_in, &whole);

    // Moments of a linear congruential generator: up to 7 flights later, so that of the 240 there are some left for the last, and
    // within the flight that follows.
    let mut random = 20_261_125_u64;
    let mut flown = Vec::new();
    for kill in 0..20 {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let (flights, wait_ms) = ((random >> 61) as usize, (random >> 40) % 20);
        let before = journal_lines(&out);
        let mut flying = Program::spawn(&mut suite_command(&file, &out, &["--resume", "--jobs", "2"]));
        let child = until_lines(&mut flying, before + flights, &out);
        sleep(Duration::from_millis(wait_ms));
        assert!(child.try_wait().unwrap().is_none(), "kill {kill} is too late");
        child.kill().unwrap();
        assert_eq!(child.wait().unwrap().signal(), Some(9));
        flown.push(journal_lines(&out));
    }
    assert!(flown.is_sorted() && flown[19] > flown[0], "{flown:?}");
    // Without an option it neither resumes nor starts again.
    let refused = suite_command(&file, &out, &[]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{}", errors(&refused));
    assert!(errors(&refused).contains("--resume goes on"), "{}", errors(&refused));
    let last = suite_command(&file, &out, &["--resume"]).output().unwrap();
    assert_eq!(last.status.code(), whole.status.code(), "{}", errors(&last));
    assert!(results(&out, &last) == expected, "other bytes");
    assert_eq!(names(&out), ["f.csv", "f.parquet", "flights.jsonl"]);
}

/// Lines of the journal of the suite in a folder so far, of which the first is its header.
fn journal_lines(folder: &Path) -> usize {
    let names = if folder.exists() { names(folder) } else { Vec::new() };
    let journal = names.into_iter().find(|name| name.ends_with(".journal"));
    journal.map_or(0, |name| std::fs::read_to_string(folder.join(name)).unwrap().matches('\n').count())
}

/// A suite that receives SIGINT or SIGTERM prints and keeps its finished flights, ends with 130 or 143, and continues with `--resume`.
#[test]
fn a_suite_that_is_told_to_end_prints_what_was_flown_and_goes_on() {
    let _machine = take_machine();
    let dir = tempfile::tempdir().unwrap();
    let file = suite(dir.path());
    let (whole_in, out) = (dir.path().join("whole"), dir.path().join("pieces"));
    let whole = suite_command(&file, &whole_in, &["--jobs", "1"]).output().unwrap();
    for (name, code) in [("-INT", 130), ("-TERM", 143)] {
        let before = journal_lines(&out).max(1);
        let mut flying = Program::spawn(&mut suite_command(&file, &out, &["--resume", "--jobs", "1"]));
        signal(until_lines(&mut flying, before + 1, &out).id(), name);
        let output = flying.output();
        assert_eq!(output.status.code(), Some(code), "{}", errors(&output));
        let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
        let runs = printed["all"]["runs"].as_u64().unwrap();
        assert!((1..240).contains(&runs), "{printed}");
        assert!(errors(&output).contains(&format!("interrupted after {runs} of 240 flights")), "{}", errors(&output));
    }
    let last = suite_command(&file, &out, &["--resume"]).output().unwrap();
    assert!(results(&out, &last) == results(&whole_in, &whole), "other bytes");
}

/// In a folder given by `--out` nothing is replaced without `--force`; in the default folder the last run is replaced, with a note.
#[test]
fn a_result_of_before_is_replaced_only_where_that_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let fly = |more: &[&str]| {
        let output = foxhound().current_dir(dir.path()).arg("fly").args(more).output().unwrap();
        (output.status.code(), errors(&output))
    };
    let picture: PathBuf = dir.path().join("mine/flight.svg");
    assert_eq!(fly(&["--out", "mine"]).0, Some(0));
    let first = std::fs::read(&picture).unwrap();
    let (code, said) = fly(&["--out", "mine", "--seed", "2"]);
    assert!(
        code == Some(2) && said.contains("mine/flight.svg: is there already") && said.contains("--force"),
        "{said}"
    );
    assert_eq!(std::fs::read(&picture).unwrap(), first);
    assert_eq!(fly(&["--out", "mine", "--seed", "2", "--force"]).0, Some(0));
    assert_ne!(std::fs::read(&picture).unwrap(), first);
    // As `cargo run --release` does, twice in a row.
    assert_eq!(fly(&[]), (Some(0), String::new()));
    let (code, said) = fly(&["--seed", "2"]);
    assert!(code == Some(0) && said.contains("out/flight.svg of the last run is replaced"), "{said}");
}
