//! `foxhound port` at a pseudo-terminal in place of a board.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::symlink;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use foxhound_sim::autopilot::transport::{Address, Line, Listen};
use foxhound_tests::{foxhound, refused, run, text};

/// A board's end of a cable, and its device.
fn board() -> (Line, String) {
    match Line::listen(&Listen::Pty).unwrap() {
        (line, Address::Serial { device, .. }) => (line, text(&device)),
        (_, other) => panic!("{other:?}"),
    }
}

/// A log that is there already stays, unless it is to be replaced; and no file has two contents.
#[test]
fn the_log_of_a_flight_is_not_replaced_by_another() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flight.log");
    fs::write(&path, "a flight").unwrap();
    let (log, (_board, device)) = (text(&path), board());
    let listens = ["port", "--serial", &device, "--seconds", "0.2", "--log", &log];
    assert!(refused(&listens).contains("is there already"));
    assert!(
        refused(&["port", "--serial", &device, "--log", &log, "dump", "1", "--out", &log]).contains("also the file")
    );
    assert_eq!(fs::read_to_string(&path).unwrap(), "a flight");
    assert!(run(&[&listens[..], &["--force"]].concat()).status.success());
    assert_eq!(fs::read_to_string(&path).unwrap(), "", "nothing was sent");
    assert!(run(&listens).status.success(), "an empty log is none");
}

/// A cable that goes and comes back is told, and the status says that something is missing.
#[test]
fn a_cable_that_goes_is_told_and_so_is_its_return() {
    let folder = tempfile::tempdir().unwrap();
    let [device, log] = ["tty", "flight.log"].map(|name| folder.path().join(name));
    let (first, end) = board();
    symlink(end, &device).unwrap();
    let mut command = foxhound();
    command.args(["port", "--serial", &text(&device), "--seconds", "8", "--log", &text(&log)]);
    let mut port = command.stderr(Stdio::piped()).spawn().unwrap();
    let mut told = BufReader::new(port.stderr.take().unwrap()).lines();
    while !log.exists() {
        sleep(Duration::from_millis(2));
    }
    drop(first);
    let line = told.next().unwrap_or_else(|| panic!("{:?}", port.wait())).unwrap();
    assert!(line.contains("the port is gone"), "{line}");
    let (mut second, end) = board();
    fs::remove_file(&device).unwrap();
    symlink(end, &device).unwrap();
    let line = told.next().unwrap().unwrap();
    assert!(line.contains("the port is back"), "{line}");
    while !second.is_open() {
        second.read();
        sleep(Duration::from_millis(2));
    }
    second.write(b"more");
    assert_eq!(port.wait().unwrap().code(), Some(1));
    assert_eq!(fs::read(&log).unwrap(), b"more");
}
