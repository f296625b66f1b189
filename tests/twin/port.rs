//! The maintenance port of the image in QEMU: bring-up, raw frames, and a line of the autopilot that carries noise.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::{sleep, spawn};
use std::time::{Duration, Instant as WallInstant};

use foxhound_computer::twin::Setup;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_link::dialect::MavMessage;
use foxhound_link::framer::Framer;
use foxhound_sim::autopilot::transport::{Address, Line, Listen};
use foxhound_sim::drive::qemu::QemuComputer;
use foxhound_sim::tools::frames::Recording;
use foxhound_sim::world::Pose;
use foxhound_sim::world::antennas::Antennas;
use foxhound_sim::world::random::Random;
use foxhound_tests::{foxhound, qemu_image, run, run_json, run_json_lines, station};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

/// QEMU alone: the autopilot's line is a socket, the maintenance port a pseudo-terminal.
struct Alone {
    qemu: Child,
    line: TcpStream,
    terminal: String,
    folder: tempfile::TempDir,
}

impl Alone {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let words = folder.path().join("stdout");
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let qemu = Command::new("qemu-system-arm")
            .args(["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-icount", "shift=8"])
            .args(["-semihosting-config", "enable=on,target=native", "-serial"])
            .arg(format!("tcp:{}", listener.local_addr().unwrap()))
            .args(["-serial", "null", "-serial", "pty", "-kernel", &qemu_image()])
            .stdout(std::fs::File::create(&words).unwrap())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let (line, _) = listener.accept().unwrap();
        // QEMU says on its output which terminal it has opened.
        let terminal = (0..200).find_map(|_| {
            sleep(Duration::from_millis(20));
            let said = std::fs::read_to_string(&words).unwrap();
            said.split_whitespace().find(|word| word.starts_with("/dev/pts/")).map(str::to_owned)
        });
        Self { qemu, line, terminal: terminal.unwrap(), folder }
    }

    /// What the maintenance port answers, and the exit status.
    fn ask(&self, command: &str) -> (Option<i32>, String) {
        let log = self.folder.path().join("capture.log");
        let log = log.to_string_lossy();
        let output = run(&["port", "--serial", &self.terminal, "--log", &log, "--force", command]);
        (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// The whole status: an answer ends for `foxhound port` where QEMU gets no processor for a second.
    fn status(&self) -> String {
        let mut answers = (0..10).map(|_| self.ask("status"));
        let (code, status) =
            answers.find(|(_, status)| status.lines().any(|line| line.starts_with("speak: "))).unwrap();
        assert_eq!(code, Some(0), "{status}");
        status
    }
}

impl Drop for Alone {
    fn drop(&mut self) {
        // It may be gone already.
        let _ = self.qemu.kill();
        let _ = self.qemu.wait();
    }
}

/// The firmware in QEMU answers every command on its maintenance port.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn the_firmware_answers_at_its_maintenance_port() {
    let alone = Alone::start();
    let ask = |command: &str| alone.ask(command);
    let status = alone.status();
    for word in ["on mps2_an386", "restart: power", "late 0", "outcome not_in_control", "link: frames 0", "log: frames"]
    {
        assert!(status.contains(word) || word.contains("not_in_control") && status.contains("link_lost"), "{status}");
    }
    assert!(status.contains("clock: the simulator's") && status.contains("1.5 an instruction assumed"), "{status}");
    assert!(status.contains(" of 4000000 us; start 1\n"), "{status}");
    // Each task but the planner has run; the sum of its histogram is how often.
    let lines: Vec<_> = status.lines().collect();
    let number = |word: &str| word.parse::<u32>().unwrap();
    for task in ["receive", "step", "transmit", "listen", "speak"] {
        let at = lines.iter().position(|line| line.starts_with(&format!("{task}: "))).unwrap();
        let words: Vec<_> = lines[at].split_whitespace().collect();
        let [runs, min, mean, max] = [1, 4, 5, 6].map(|at| number(words[at]));
        assert!(runs > 0 && min <= mean && mean <= max && max > 0, "{status}");
        let bins = lines[at + 1..].iter().take_while(|line| line.starts_with(' ')).flat_map(|line| line.split(" <2^"));
        let counted: u32 = bins.filter_map(|bin| bin.split_whitespace().nth(1)).map(number).sum();
        assert_eq!(counted, runs, "{status}");
    }
    assert!(ask("help").1.contains("factory-reset yes"));
    let (code, said) = ask("fly away");
    assert!(code == Some(1) && said.contains("error: no such command"), "{said}");
    // It waits for the result, which without frames is none.
    let (code, said) = ask("selftest");
    assert!(code == Some(1) && said.contains("listens") && said.contains("Foxhound: self-test: "), "{said}");
    assert!(ask("factory-reset").1.contains("`factory-reset yes`"));
    assert!(ask(&"status ".repeat(20)).1.contains("error: the line is too long"));
    assert!(ask("watchdog").1.contains("`watchdog yes`"));
    assert!(ask("restart").1.contains("restarts"));
    let status = alone.status();
    assert!(status.contains("restart: as asked"), "{status}");
}

/// The `bringup` command reports what works and what is missing.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn bring_up_finds_what_works_and_what_is_missing() {
    let alone = Alone::start();
    let mut line = alone.line.try_clone().unwrap();
    // The wire from TX to RX.
    spawn(move || {
        let mut bytes = [0; 256];
        while let Ok(count @ 1..) = line.read(&mut bytes) {
            if line.write_all(&bytes[..count]).is_err() {
                return;
            }
        }
    });
    let (code, report) = run_json(&["port", "--json", "--serial", &alone.terminal, "bringup"]);
    let verdict = |name: &str| {
        let checks = report["checks"].as_array().unwrap();
        let check = checks.iter().find(|check| check["check"] == name);
        check.unwrap_or_else(|| panic!("{report:#}"))["verdict"].as_str().unwrap().to_owned()
    };
    for name in ["port", "clock", "steps", "autopilot's line", "flash", "watchdog"] {
        assert_eq!(verdict(name), "passed", "{name}: {report:#}");
    }
    // It runs freely, without antennas.
    assert_eq!((verdict("frames"), verdict("tone"), code), ("failed".into(), "not_checked".into(), 1), "{report:#}");
    let answers = report["answers"].as_array().unwrap();
    assert!(answers.iter().any(|line| line.as_str().unwrap().starts_with("step: ")), "{report:#}");
}

/// Frames that are read back over the maintenance port are those that went in.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn frames_come_out_of_the_port_as_they_went_in() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("frames.npy");
    // It may have to be built first, and the image does not wait for that.
    let mut command = foxhound();
    let setup = Setup { guidance: guidance::Config::default(), needs_entry: false };
    let mut twin = QemuComputer::start(Path::new(&qemu_image()), &setup).unwrap();
    twin.keep_port();
    let (mut terminal, address) = Line::listen(&Listen::Pty).unwrap();
    let Address::Serial { device, .. } = address else { panic!("{address:?}") };
    let mut port = command
        .args(["port", "--serial"])
        .arg(&device)
        .args(["dump", "12", "--out"])
        .arg(&out)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let antennas = Antennas { snr_db: Some(20.0), ..Antennas::default() };
    let (mut random, mut sent) = (Random::new(3, 7), Vec::new());
    let begin = WallInstant::now();
    while port.try_wait().unwrap().is_none() {
        assert!(begin.elapsed() < Duration::from_secs(300), "{} steps", sent.len());
        let now = Instant(sent.len() as u64 * 20_000);
        let frame: AdcFrame<256> = antennas.frame(now, &Pose::default(), [300.0, 300.0, 0.0], &mut random);
        twin.type_on_port(&terminal.read()).unwrap();
        twin.step(now, FrontEnd::Frame(&frame), None, &[]).unwrap();
        terminal.write(&twin.take_port());
        sent.push(frame);
        // As fast as a board.
        sleep(Duration::from_millis(20));
    }
    assert!(port.wait().unwrap().success());
    let dumped = Recording::read(&out).unwrap();
    // Each as it was sent, in this order; what the terminal had no room for is missing between them.
    let mut sent = sent.iter().map(|frame| frame.codes.as_flattened());
    assert_eq!(dumped.frames().len(), 12);
    assert!(dumped.frames().all(|codes| sent.any(|frame| frame == codes)));
    // What `foxhound bearing` makes of them.
    let array = dir.path().join("array.toml");
    std::fs::write(&array, "wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0\n").unwrap();
    let (out, array) = (out.to_string_lossy(), array.to_string_lossy());
    let last = run_json_lines(&["bearing", "--json", "--adc", &out, "--array", &array]).pop().unwrap();
    let azimuth_deg = last["azimuth_deg"].as_f64().unwrap_or_else(|| panic!("{last}"));
    assert!((azimuth_deg - 45.0).abs() < 3.0, "{last}");
}

/// Noise and breaks on the autopilot's line do not stop or restart the image.
#[test]
#[ignore = "needs QEMU and the image: cargo xtask test"]
fn noise_and_breaks_on_the_autopilots_line_stop_nothing() {
    let alone = Alone::start();
    let mut line = alone.line.try_clone().unwrap();
    // As fast as it is taken: bytes of any value, and between them a line that is held low.
    spawn(move || {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(6);
        loop {
            let mut bytes = [0; 512];
            random.fill_bytes(&mut bytes[..256]);
            if line.write_all(&bytes).is_err() {
                return;
            }
        }
    });
    let mut heard = alone.line.try_clone().unwrap();
    heard.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    let (mut framer, mut beats, mut times_ms, begin) = (Framer::new(), 0, Vec::new(), WallInstant::now());
    while begin.elapsed() < Duration::from_secs(5) {
        let mut bytes = [0; 256];
        let count = heard.read(&mut bytes).unwrap_or(0);
        for (_, message) in station::messages(&mut framer, &bytes[..count]) {
            match message {
                MavMessage::HEARTBEAT(_) => beats += 1,
                MavMessage::NAMED_VALUE_FLOAT(value) => times_ms.push(value.time_boot_ms),
                _ => {}
            }
        }
    }
    // One a second of its own time, which passes faster than ours while it has something to do.
    let seconds = times_ms.last().unwrap() / 1000;
    assert!(seconds >= 3 && beats + 2 >= seconds && beats <= seconds + 2, "{beats} heartbeats in {seconds} s");
    assert!(times_ms.is_sorted(), "it has not restarted: {times_ms:?}");
    let status = alone.status();
    for words in ["restart: power", "; start 1\n", ", late 0", "link: frames 0"] {
        assert!(status.contains(words), "{words}: {status}");
    }
    assert!(!status.contains("received: at most 0 of"), "{status}");
}
