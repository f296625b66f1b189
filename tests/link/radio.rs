//! `foxhound companion --bearings`: a live radio instead of simulated antennas.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::net::UdpSocket;
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;

use foxhound_tests::{Program, assert_refused, foxhound, share_machine, text};

use crate::companion::{Bench, ended, start};

const BEACON_NORTH_M: f64 = 20.0;
/// So near to the beacon a bearing changes much while it is on its way: it tells how busy the machine is.
const NEAR_M: f64 = 3.0;

/// Sends the bearing of a beacon in the north by UDP ten times a second, as a radio on the vehicle would, while `is_wanted`.
fn radio(bench: &Bench, port: u16, is_wanted: &Arc<AtomicBool>) -> impl FnOnce() {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let (heard, is_wanted, ends) = (bench.shared(), Arc::clone(is_wanted), Arc::new(AtomicBool::new(false)));
    let ended = Arc::clone(&ends);
    let thread = std::thread::spawn(move || {
        let mut number = 0_u32;
        while !ended.load(Ordering::Relaxed) {
            let ([north, east, _], yaw_rad) = {
                let heard = heard.lock().unwrap();
                (heard.position_ned_m, heard.yaw_rad)
            };
            // 5 degrees of what looks like noise.
            number = number.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise_deg = 17.0 * (f64::from(number >> 8) / f64::from(1 << 24) - 0.5);
            let azimuth_deg = f64::atan2(-east, BEACON_NORTH_M - north).to_degrees() - yaw_rad.to_degrees() + noise_deg;
            let line = format!(
                "{{\"azimuth_deg\": {:.1}, \"sigma_deg\": 5.0}}\n",
                (azimuth_deg + 540.0).rem_euclid(360.0) - 180.0
            );
            if is_wanted.load(Ordering::Relaxed) {
                let _ = socket.send_to(line.as_bytes(), ("127.0.0.1", port));
            }
            sleep(Duration::from_millis(100));
        }
    });
    move || {
        ends.store(true, Ordering::Relaxed);
        thread.join().unwrap();
    }
}

fn free_port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

/// With bearings of a radio, JSON lines by UDP, the companion reaches the beacon; when the radio stops it holds, reports
/// `no_signal`, and continues when bearings come again.
#[test]
fn bearings_of_a_radio_are_flown_by_and_its_silence_is_a_hold() {
    let _machine = share_machine();
    let (bench, port) = (Bench::new("tcp:127.0.0.1:0"), free_port());
    let is_wanted = Arc::new(AtomicBool::new(true));
    let end = radio(&bench, port, &is_wanted);
    let source = format!("udp:127.0.0.1:{port}");
    let folder = tempfile::tempdir().unwrap();
    let (params, mcap) = (params(folder.path()), folder.path().join("flight.mcap"));
    let beacon = format!("--source={BEACON_NORTH_M},0,-5");
    let arguments =
        [&beacon, "--obstacles", "none", "--bearings", &source, "--params", &params, "--mcap", &text(&mcap)];
    let child = start(&bench.address, &arguments);
    bench.wait("it flies", |heard| heard.position_ned_m[0] > 2.0);
    is_wanted.store(false, Ordering::Relaxed);
    sleep(Duration::from_millis(2500));
    let stood = bench.wait("it stands", |heard| heard.speed_mps < 0.2);
    assert!(stood.position_ned_m[0] < BEACON_NORTH_M - 2.0, "{:?}", stood.position_ned_m);
    is_wanted.store(true, Ordering::Relaxed);
    let (code, report) = ended(child);
    assert_eq!((code, &report["result"]), (0, &"reached".into()), "{report}");
    let (count, rms_deg) = far_errors(&mcap);
    assert!(count > 50 && (2.0..9.0).contains(&rms_deg), "{rms_deg} of {count}");
    end();
}

/// Without `--source` the beacon's position is unknown: the flight ends when it is interrupted, and neither its result nor its MCAP file has
/// a number that needs that position, or the signal-to-noise ratio that the radio does not tell.
#[test]
fn a_beacon_whose_place_is_not_known_is_flown_to_until_it_is_stopped() {
    let _machine = share_machine();
    let (bench, port) = (Bench::new("tcp:127.0.0.1:0"), free_port());
    let is_wanted = Arc::new(AtomicBool::new(true));
    let end = radio(&bench, port, &is_wanted);
    let source = format!("udp:127.0.0.1:{port}");
    let mut command = foxhound();
    command.args(["companion", "--autopilot", &bench.address, "--json", "--obstacles", "none"]);
    let folder = tempfile::tempdir().unwrap();
    let mcap = folder.path().join("flight.mcap");
    command.args(["--bearings", &source, "--params", &params(folder.path()), "--mcap", &text(&mcap)]);
    let child = Program::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
    bench.wait("it flies", |heard| heard.position_ned_m[0] > 6.0);
    child.signal("-INT");
    let (code, report) = ended(child);
    assert!(code == 130 && report["bearing_rms_deg"].is_null(), "{report}");
    // Its messages are JSON, uncompressed. Schemas have these names, too, with an object.
    let messages = String::from_utf8_lossy(&std::fs::read(&mcap).unwrap()).into_owned();
    let numbers = |name: &str| {
        let key = format!("\"{name}\":");
        let is_number = |piece: &&str| piece.starts_with(|first: char| first == '-' || first.is_ascii_digit());
        messages.split(&key).skip(1).filter(is_number).count()
    };
    assert!(numbers("bearing_deg") > 10);
    // The scenario has the range of a sensor and the ratio of simulated waveforms.
    assert_eq!(["range_m", "error_deg", "error_m", "snr_db"].map(numbers), [1, 0, 0, 1]);
    end();
}

/// Of the bearings that came while the beacon was not near, in a recorded flight: how many, and the root mean square of their errors.
fn far_errors(mcap: &Path) -> (usize, f64) {
    // Its messages are JSON, uncompressed: in every step the true range, and after it the bearing.
    let messages = String::from_utf8_lossy(&std::fs::read(mcap).unwrap()).into_owned();
    let number = |piece: &str, name: &str| {
        let text = piece.split_once(&format!("\"{name}\":"))?.1;
        text.split([',', '}']).next()?.parse::<f64>().ok()
    };
    let steps = messages.split("\"range_m\":").skip(1);
    let errors = steps.filter_map(|step| {
        let range_m: f64 = step.split([',', '}']).next()?.parse().ok()?;
        number(step, "error_deg").filter(|_| range_m > NEAR_M)
    });
    let (count, squares) = errors.fold((0, 0.0), |(count, squares), error| (count + 1, squares + error * error));
    (count, (squares / count as f64).sqrt())
}

/// A parameter file that requires no obstacle sensor.
fn params(folder: &Path) -> String {
    let path = folder.join("radio.toml");
    std::fs::write(&path, "FH_OBS_REQ = 0\n").unwrap();
    text(&path)
}

/// A radio that cannot be opened is refused before the flight, by the name of the option.
#[test]
fn a_radio_that_cannot_be_had_is_refused_by_option() {
    assert_refused(
        &["companion", "--autopilot", "tcp:127.0.0.1:1"],
        &[
            (&[][..], ["--source"]),
            (&["--bearings", "radio:1"], ["expected kraken:HOST"]),
            (&["--bearings", "heimdall:127.0.0.1"], ["needs --array"]),
            (&["--bearings", "hci:/dev/does-not-exist:115200"], ["needs --array"]),
            (&["--bearings", "uudf:/dev/does-not-exist:115200"], ["/dev/does-not-exist"]),
            (&["--bearings", "kraken:127.0.0.1:1", "--sigma-deg", "0"], ["--sigma-deg = 0 is outside"]),
            (&["--bearings", "kraken:127.0.0.1:1", "--bearing-age", "99"], ["--bearing-age = 99 is outside"]),
        ],
    );
}
