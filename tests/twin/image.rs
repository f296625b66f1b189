//! The firmware image itself, flown in QEMU. `cargo xtask test` builds the image, installs what is needed and runs these.

use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use foxhound_tests::{checked_by, g474_image, qemu_image, refused, root, run, run_json};
use object::{Object as _, ObjectSymbol as _};

fn fly(via: &str, extra: &[&str]) -> (i32, serde_json::Value) {
    run_json(&[&["fly", "--json", "--via", via], extra].concat())
}

/// The built-in mission has the same trace hash in QEMU and on the desktop.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_built_in_mission_flies_the_same_in_qemu_and_in_process() {
    let via = format!("qemu:{}", qemu_image());
    for seed in ["0", "7"] {
        let (host, twin) = (fly("host", &["--seed", seed]), fly(&via, &["--seed", seed]));
        assert_eq!(twin.1["result"], "reached", "{}", twin.1);
        assert_eq!(host.1["trace_hash"], twin.1["trace_hash"], "host {} twin {}", host.1, twin.1);
        assert_eq!(host.1["time_s"], twin.1["time_s"]);
    }
}

/// A flight of 60 simulated seconds has the same trace hash in QEMU and on the desktop.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn sixty_simulated_seconds_end_in_the_same_hash() {
    let via = format!("qemu:{}", qemu_image());
    let scenario = root().join("tests/twin/sixty_seconds.json");
    let scenario = ["--seed", "11", "--scenario", &scenario.to_string_lossy()];
    let (host, twin) = (fly("host", &scenario), fly(&via, &scenario));
    assert!(host.1["time_s"].as_f64().unwrap() >= 60.0, "{}", host.1);
    assert_eq!(host.1["trace_hash"], twin.1["trace_hash"], "host {} twin {}", host.1, twin.1);
}

/// pymavlink reads the bytes that the firmware sends, and their content is right.
#[test]
#[ignore = "needs QEMU, the image and pymavlink: cargo xtask test"]
fn pymavlink_reads_the_firmwares_own_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("flight.tlog");
    let (code, report) = fly(&format!("qemu:{}", qemu_image()), &["--tlog", &log.to_string_lossy()]);
    assert_eq!(code, 0, "{report}");
    checked_by("check_tlog.py", &[log]);
}

/// In the mode but without antennas the image streams zero velocity at 20 Hz, by its own clock.
#[test]
#[ignore = "needs QEMU, the image and pymavlink: cargo xtask test"]
fn in_the_mode_without_antennas_the_image_streams_zero_velocity() {
    checked_by("free_run.py", &[qemu_image()]);
}

/// An image for another board is refused.
#[test]
#[ignore = "needs QEMU and both images: cargo xtask test"]
fn an_image_for_another_board_is_refused() {
    let _ = refused(&["fly", "--via", &format!("qemu:{}", g474_image())]);
}

/// No image contains an allocator, and the product contains no code that prints floating-point numbers.
#[test]
#[ignore = "needs both images: cargo xtask test"]
fn no_image_holds_an_allocator_and_the_product_writes_no_floats() {
    for variable in ["FOXHOUND_QEMU_ELF", "FOXHOUND_G474_ELF"] {
        let data = std::fs::read(std::env::var(variable).unwrap()).unwrap();
        let file = object::File::parse(&*data).unwrap();
        let mut symbols = 0;
        for symbol in file.symbols() {
            let name = symbol.name().unwrap_or_default();
            assert!(!name.contains("__rust_alloc") && !name.contains("__rg_alloc"), "{variable}: {name}");
            // What a `clamp` that may panic brings along; the twin writes numbers when it refuses a setup.
            let is_product = variable == "FOXHOUND_G474_ELF";
            assert!(!(is_product && name.contains("flt2dec")), "floats are written as text: {name}");
            symbols += 1;
        }
        assert!(symbols > 100, "{variable} is stripped: nothing was checked");
    }
}

/// The image for QEMU contains the papers' systems, and the product contains none of them.
#[test]
#[ignore = "needs both images: cargo xtask test"]
fn the_twin_holds_the_systems_of_the_papers_and_the_product_none() {
    let count = |variable: &str| {
        let data = std::fs::read(std::env::var(variable).unwrap()).unwrap();
        let file = object::File::parse(&*data).unwrap();
        file.symbols().filter(|symbol| symbol.name().is_ok_and(|name| name.contains("foxhound_papers"))).count()
    };
    assert_eq!(count("FOXHOUND_G474_ELF"), 0);
    assert!(count("FOXHOUND_QEMU_ELF") > 0);
}

/// Without a simulator the image sends a heartbeat a second and no setpoint.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn without_a_doorbell_the_image_beats_once_a_second_and_sends_no_motion() {
    // QEMU alone, as a stranger would start it: UART0 into a file, no shared memory, no doorbell.
    let dir = tempfile::tempdir().unwrap();
    let bytes = dir.path().join("uart0.bin");
    let mut qemu = Command::new("qemu-system-arm")
        .args(["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-icount", "shift=8"])
        .args(["-semihosting-config", "enable=on,target=native", "-serial"])
        .arg(format!("file:{}", bytes.display()))
        .args(["-serial", "null", "-kernel", &qemu_image()])
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let (begin, mut counts) = (Instant::now(), serde_json::Value::Null);
    let beats = |counts: &serde_json::Value| counts["counts"]["0"].as_u64().unwrap_or(0);
    while beats(&counts) < 8 && begin.elapsed() < Duration::from_secs(60) {
        sleep(Duration::from_secs(1));
        counts = serde_json::from_slice(&run(&["tlog", &bytes.to_string_lossy(), "--raw", "--json"]).stdout)
            .unwrap_or_default();
    }
    let passed_s = begin.elapsed().as_secs();
    qemu.kill().unwrap();
    qemu.wait().unwrap();
    assert_eq!((&counts["bad_crc"], &counts["skipped_bytes"]), (&0.into(), &0.into()), "{counts}");
    // A beat, on a machine that may be busy, and no flood.
    assert!((8..=passed_s + 3).contains(&beats(&counts)), "{counts} in {passed_s} s");
    assert!(counts["counts"].get("84").is_none(), "no setpoint without an autopilot: {counts}");
}
