//! QEMU ends with the program that started it, however that ends, and leaves nothing in the temporary folder.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use foxhound_tests::{foxhound, qemu_image, run_json, take_machine, text};

/// Numbers of the QEMUs that a program has started.
fn qemus(of: u32) -> Vec<u32> {
    let folder = format!("foxhound-qemu-{of}-");
    let lines = std::fs::read_dir("/proc").unwrap().flatten().filter_map(|entry| {
        let line = std::fs::read(entry.path().join("cmdline")).ok()?;
        let line = String::from_utf8_lossy(&line).replace('\0', " ");
        let is_its = line.starts_with("qemu-system-arm ") && line.contains(&folder);
        is_its.then(|| entry.file_name().to_string_lossy().parse().ok())?
    });
    lines.collect()
}

/// The folders of a program in the temporary folder.
fn folders(of: u32) -> Vec<String> {
    let names = std::fs::read_dir(std::env::temp_dir()).unwrap().flatten();
    let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.starts_with(&format!("foxhound-qemu-{of}-"))).collect()
}

fn until(what: &str, is_so: impl Fn() -> bool) {
    let since = Instant::now();
    while !is_so() {
        assert!(since.elapsed() < Duration::from_secs(120), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn flying(more: &[&str]) -> Child {
    let via = format!("qemu:{}", qemu_image());
    // Where the tests run in the background of a shell SIGINT is ignored, and a program that has just begun would miss it.
    let mut command = Command::new("env");
    command.arg("--default-signal=INT").arg(foxhound().get_program());
    command.args(["fly", "--json", "--via", &via, "--live", "--port", "0", "--speed", "0.1"]);
    command.args(more).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// After SIGKILL, SIGTERM and SIGINT of its parent no QEMU is running, and there is no folder of it, neither then nor during the flight.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn qemu_never_outlives_its_parent_and_leaves_no_folder() {
    let _machine = take_machine();
    for signal in ["-KILL", "-TERM", "-INT"] {
        let mut child = flying(&[]);
        let pid = child.id();
        until("QEMU does not start", || qemus(pid).len() == 1);
        until("the folder stays", || folders(pid).is_empty());
        foxhound_tests::signal(pid, signal);
        child.wait().unwrap();
        until(&format!("QEMU runs on after {signal}"), || qemus(pid).is_empty());
        assert_eq!(folders(pid), Vec::<String>::new(), "{signal}");
    }
}

/// When QEMU is gone in flight the records and the flight log are written as far as it came, with status 2.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_records_of_a_flight_outlive_its_qemu() {
    let _machine = take_machine();
    let folder = tempfile::tempdir().unwrap();
    let names = ["f.html", "f.mcap", "f.tlog", "f.log"];
    let [page, mcap, tlog, log] = names.map(|name| text(&folder.path().join(name)));
    let mut child = flying(&["--report", &page, "--mcap", &mcap, "--tlog", &tlog, "--flight-log", &log]);
    let pid = child.id();
    until("QEMU does not start", || qemus(pid).len() == 1);
    until("the folder stays", || folders(pid).is_empty());
    std::thread::sleep(Duration::from_secs(3));
    foxhound_tests::signal(qemus(pid)[0], "-KILL");
    until("the report is not written", || Path::new(&page).exists() && Path::new(&log).exists());
    // The live page stays until it is stopped.
    std::thread::sleep(Duration::from_secs(1));
    foxhound_tests::signal(pid, "-INT");
    assert_eq!(child.wait().unwrap().code(), Some(2));
    let (code, printed) = run_json(&["replay", "--json", &log]);
    assert!(code == 0 && printed["steps"].as_u64().unwrap() > 5, "{printed}");
    assert!(Path::new(&mcap).exists() && Path::new(&tlog).exists());
}
