//! `foxhound companion --key` beside an autopilot that signs, and beside one that does not.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::path::Path;

use foxhound_tests::{Autopilot, Program, foxhound, peer, refused, share_machine, text};
use serde_json::{Value, json};

const KEY: &str = "00112233445566778899aabbccddeeff0123456789abcdeffedcba9876543210";
const OTHER: &str = "10112233445566778899aabbccddeeff0123456789abcdeffedcba9876543210";

fn key_file(dir: &Path, name: &str, key: &str) -> String {
    let path = dir.join(name);
    std::fs::write(&path, format!("{key}\n")).unwrap();
    text(&path)
}

/// What a flight came to, to the companion and to pymavlink, which signs with [`KEY`].
fn flown_with_pymavlink(arguments: &[&str]) -> (Value, Value) {
    let mut autopilot = Program::start(peer("signed_autopilot.py").arg(KEY));
    let mut said = autopilot.lines().map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap());
    let address = format!("udpout:127.0.0.1:{}", said.next().unwrap()["port"]);
    let report = flown(&address, arguments);
    autopilot.end_input();
    (report, said.next().unwrap())
}

fn flown(address: &str, arguments: &[&str]) -> Value {
    let mut command = foxhound();
    command.args(["companion", "--json", "--autopilot", address]).args(arguments);
    let mut companion = Program::start(&mut command);
    serde_json::from_str(&companion.lines().next().unwrap().unwrap()).unwrap()
}

/// With the same key on both sides pymavlink accepts every frame, and the flight reaches the beacon.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn with_one_key_pymavlink_takes_every_frame_and_is_believed() {
    let _machine = share_machine();
    let dir = tempfile::tempdir().unwrap();
    let key = key_file(dir.path(), "key", KEY);
    let arguments = ["--source=5,0,-5", "--max-time", "60", "--key", &key];
    let (report, told) = flown_with_pymavlink(&arguments);
    assert_eq!(report["result"], "reached", "{report}");
    assert_eq!(told["refused"], 0, "{told}");
    let count = |name: &str| told["taken"][name].as_u64().unwrap_or(0);
    assert!(count("SET_POSITION_TARGET_LOCAL_NED") > 40 && count("HEARTBEAT") > 2 && count("DEBUG_VECT") > 2, "{told}");
    assert_eq!(told["velocity_ned_mps"], json!([0.0, 0.0, 0.0]), "{told}");
    assert!((told["position_ned_m"][0].as_f64().unwrap() - 5.0).abs() < 1.5, "{told}");
    // The driver's command to stop was signed, too.
    assert!(told["texts"].as_array().unwrap().contains(&"Foxhound: reached the beacon, take over".into()), "{told}");
}

/// With another key, or none, no message is accepted by the autopilot and the vehicle does not move.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn with_another_key_or_none_nothing_is_believed_and_nothing_moves() {
    let _machine = share_machine();
    let dir = tempfile::tempdir().unwrap();
    let key = key_file(dir.path(), "other", OTHER);
    // Without a key the companion hears everything, and is heard by nobody.
    for arguments in [&["--key", key.as_str()][..], &[]] {
        let (report, told) = flown_with_pymavlink(&[&["--source=5,0,-5", "--max-time", "8"], arguments].concat());
        assert_eq!(report["result"], "timeout", "{report}");
        assert_eq!(report["reason"] == "link_lost", !arguments.is_empty(), "{report}");
        assert!(told["refused"].as_u64().unwrap() > 2 && told["taken"] == json!({}), "{told}");
        assert_eq!(told["position_ned_m"], json!([0.0, 0.0, -5.0]), "{told}");
    }
}

/// With a key, an autopilot that does not sign is ignored, and receives no setpoint.
#[test]
fn with_a_key_an_autopilot_that_does_not_sign_is_not_moved() {
    let _machine = share_machine();
    let dir = tempfile::tempdir().unwrap();
    let key = key_file(dir.path(), "key", KEY);
    let autopilot = Autopilot::start(&[]);
    let report = flown(&autopilot.address, &["--source=5,0,-5", "--max-time", "8", "--key", &key]);
    assert_eq!((&report["result"], &report["reason"]), (&"timeout".into(), &"link_lost".into()), "{report}");
    let last = autopilot.end();
    assert!(last["heartbeats"].as_u64().unwrap() > 2 && last["setpoints"] == 0, "{last}");
}

/// A bad key file is refused, and the message does not show the key.
#[test]
fn a_bad_key_file_is_refused_and_what_stands_in_it_is_not_told() {
    let _machine = share_machine();
    let dir = tempfile::tempdir().unwrap();
    let short = key_file(dir.path(), "short", &KEY[2..]);
    let zero = key_file(dir.path(), "zero", &"0".repeat(64));
    let missing = text(&dir.path().join("missing"));
    for (arguments, words) in [
        (&["--key", short.as_str()][..], ["--key", "64 hexadecimal digits"]),
        (&["--key", &zero], ["--key", "64 hexadecimal digits"]),
        (&["--key", &missing], ["--key", "missing"]),
        (&["--key", &short, "--via", "qemu:x.elf"], ["--key", "--via host"]),
    ] {
        let common = ["companion", "--autopilot", "tcp:127.0.0.1:9", "--source=1,2,-3", "--max-time", "1"];
        let errors = refused(&[&common[..], arguments].concat());
        assert!(words.iter().all(|word| errors.contains(word)) && !errors.contains(&KEY[4..12]), "{errors}");
    }
}
