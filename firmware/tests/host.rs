//! The application on the host's board: start-up, link, guidance, planner, console and store, without hardware.
//!
//! The application lies in statics, as on any board, so each test runs in a process of its own.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::pin::Pin;
use std::process::Command;
use std::sync::atomic::Ordering;
use std::task::{Context, Waker};
use std::thread;

use foxhound_computer::flight::ParameterStore as _;
use foxhound_computer::log::Record as Logged;
use foxhound_computer::log::frame::LogDeframer;
use foxhound_computer::store::Store;
use foxhound_computer::twin;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::guidance::param::{self, Id, Values};
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_core::planning::planner;
use foxhound_firmware::app::{self, Kept, Line, Outgoing, Shared};
use foxhound_firmware::board::{Board as _, Parts};
use foxhound_firmware::boards::host::{Answer, Flash, Machine, Order, RESTARTED, WORLD};
use foxhound_firmware::console;
use foxhound_sim::drive::computer::{BLOCK, Computer, ComputerError, HostComputer, StepReport};
use foxhound_sim::drive::flight::{self, Ending, Mission, Record};
use foxhound_sim::drive::replay::replay;
use foxhound_sim::scenario::Scenario;

static OUTGOING: Outgoing = Outgoing::new();
static PLANNER: Shared<Kept<Machine>> = Shared::new();

/// Says to the process that it is the one of a test.
const ALONE: &str = "FOXHOUND_TEST_ALONE";
/// How such a process ends when its test has passed: a name that no test has would end it with zero.
const DONE: i32 = 76;
const TICK_US: u64 = 20_000;

/// Runs a test in a process of its own, by the test's name; how that ends.
fn alone(test: &str, work: impl FnOnce()) -> i32 {
    if std::env::var_os(ALONE).is_some() {
        work();
        std::process::exit(DONE);
    }
    let mut process = Command::new(std::env::current_exe().unwrap());
    let status = process.args(["--exact", test, "--nocapture"]).env(ALONE, "1").status().unwrap();
    status.code().unwrap_or(-1)
}

/// The same; it must pass.
fn passes(test: &str, work: impl FnOnce()) {
    assert_eq!(alone(test, work), DONE, "{test}");
}

/// The board with the application on it, started.
struct Computing {
    tasks: Vec<Pin<Box<dyn Future<Output = ()>>>>,
    now: Instant,
    /// All that came out at the console.
    console: Vec<u8>,
    /// All that the autopilot heard.
    sent: Vec<u8>,
    /// A simulator has said what it flies with.
    is_set_up: bool,
}

impl Computing {
    /// As `program.rs` does on a microcontroller, but for the executors.
    fn start() -> Self {
        let board: Parts<Machine> = Machine::start();
        let begun = app::begin_with::<Machine>(app::first_state(), board.flash).unwrap();
        let detector = begun.detector().unwrap();
        let (planning, desk) = app::planning(&PLANNER).unwrap();
        let (end, log, camera) = console::ends(detector);
        let line = Line::new(board.receiver, board.sensor, &OUTGOING);
        thread::spawn(|| app::plan::<Machine>(desk));
        let tasks: Vec<Pin<Box<dyn Future<Output = ()>>>> = vec![
            Box::pin(app::guide(board.pacer, board.watchdog, board.restart, begun, line, end, planning)),
            Box::pin(app::transmit::<Machine>(board.transmitter, &OUTGOING)),
            Box::pin(console::listen::<Machine>(board.console_receiver, camera)),
            Box::pin(console::speak::<Machine>(board.console_transmitter, log)),
        ];
        Self { tasks, now: Instant(0), console: Vec::new(), sent: Vec::new(), is_set_up: false }
    }

    /// Lets all tasks run until the order is carried out.
    fn carry_out(&mut self, order: Order) -> Answer {
        WORLD.order(order);
        loop {
            for task in &mut self.tasks {
                assert!(task.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending(), "a task has ended");
            }
            self.console.extend(WORLD.console.heard());
            if let Some(answer) = WORLD.answer() {
                // What is told after a step, and what is still on its way.
                for _ in 0..100 {
                    for task in &mut self.tasks {
                        let _ = task.as_mut().poll(&mut Context::from_waker(Waker::noop()));
                    }
                }
                self.console.extend(WORLD.console.heard());
                return answer;
            }
        }
    }

    /// Steps of 20 ms without a frame.
    fn steps(&mut self, count: usize) -> guidance::Output {
        let mut last = None;
        for _ in 0..count {
            self.now = self.now.plus_micros(TICK_US);
            let order = Order::Step { now: self.now, frame: None, circles: None };
            let Answer::Step { output, .. } = self.carry_out(order) else { panic!("not a step") };
            self.sent.extend(WORLD.autopilot.heard());
            last = Some(output);
        }
        last.unwrap()
    }

    /// Types a command, and lets it be carried out.
    fn type_line(&mut self, line: &str) {
        WORLD.console.say(format!("{line}\r").as_bytes());
        self.steps(20);
    }

    fn set_up(&mut self, config: &guidance::Config) {
        let Answer::Setup(result) = self.carry_out(Order::Setup(Box::new(*config))) else { panic!("not a setup") };
        result.unwrap();
        WORLD.autopilot.heard();
        self.is_set_up = true;
    }
}

fn contains(bytes: &[u8], text: &str) -> bool {
    bytes.windows(text.len()).any(|window| window == text.as_bytes())
}

/// Takes what is wanted out of the flight log's records.
fn logged<T>(log: &[u8], mut wanted: impl FnMut(Logged<'_>) -> Option<T>) -> Vec<T> {
    let mut deframer = LogDeframer::new();
    let mut read = |byte: &u8| deframer.push(*byte).and_then(|frame| Logged::of(&frame)).and_then(&mut wanted);
    log.iter().filter_map(&mut read).collect()
}

/// What was answered at the console.
fn answers(log: &[u8]) -> String {
    let texts = logged(log, |record| match record {
        Logged::Text(text) => Some(text.to_owned()),
        _ => None,
    });
    texts.join("\n")
}

/// A parameter with which the first flight of a log begins.
fn begun_with(log: &[u8], id: Id) -> f32 {
    let values: Vec<f32> = logged(log, |record| match record {
        Logged::Begin(begin) => begin.values.as_slice().try_into().ok().map(|values| Values::restore(values).0.get(id)),
        _ => None,
    });
    values[0]
}

/// MAVLink 2 frames of a message below 256 that follow each other without a gap.
fn frames_of(bytes: &[u8], message: u8) -> usize {
    let (mut at, mut found) = (0, 0);
    while let Some(&[0xfd, length, flags, _, _, _, _, id, 0, 0]) = bytes.get(at..at + 10) {
        found += usize::from(id == message);
        at += 12 + usize::from(length) + if flags & 1 != 0 { 13 } else { 0 };
    }
    assert_eq!(at, bytes.len(), "whole frames only");
    found
}

impl Computer for Computing {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        let frame = match front_end {
            FrontEnd::Frame(snapshot) => Some(Box::new(snapshot.clone())),
            FrontEnd::Nothing => None,
            _ => return Err(ComputerError("the board hears waveforms".to_owned())),
        };
        WORLD.autopilot.say(rx);
        self.now = now;
        let order = Order::Step { now, frame, circles: circles.map(<[Circle]>::to_vec) };
        let Answer::Step { output, plan } = self.carry_out(order) else { panic!("not a step") };
        let plan = plan.map(|planned| twin::Planned {
            id: planned.answer.plan.id,
            waypoints_ned_m: planned.answer.plan.waypoints_ned_m,
            samples_ned_m: planned.samples_ned_m,
            ticks: planned.ticks,
        });
        let tx = WORLD.autopilot.heard();
        self.sent.extend(&tx);
        Ok(StepReport { output, plan, tx })
    }

    fn needs_entry(&self) -> bool {
        !self.is_set_up
    }

    fn see(&mut self, _bytes: &[u8]) -> Result<(), ComputerError> {
        Err(ComputerError("there is no camera".to_owned()))
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        WORLD.sensor.say(bytes);
        Ok(())
    }
}

#[test]
fn it_boots_beats_once_a_second_and_answers_at_the_console() {
    passes("it_boots_beats_once_a_second_and_answers_at_the_console", || {
        let mut computing = Computing::start();
        let output = computing.steps(250);
        assert_eq!(output.outcome, Outcome::LinkLost);
        // Heartbeats; 5 s.
        let beats = frames_of(&computing.sent, 0);
        assert!((5..=6).contains(&beats), "{beats}");
        assert_eq!(WORLD.feeds.load(Ordering::Relaxed), 250);
        computing.type_line("status");
        computing.type_line("nonsense");
        let answers = answers(&computing.console);
        for answer in [" on host, up 5 s", "restart: ", "outcome link_lost", "; start 1", "error: no such command"] {
            assert!(answers.contains(answer), "{answer}: {answers}");
        }
    });
}

fn mission() -> Mission {
    Mission {
        scenario: Scenario::built_in(),
        seed: 7,
        planner: planner::Config::default(),
        estimator: Estimator::CrossSpectrum,
    }
}

#[test]
fn it_flies_the_built_in_mission_as_the_simulators_own_computer_does() {
    passes("it_flies_the_built_in_mission_as_the_simulators_own_computer_does", || {
        let mission = mission();
        let fly = |computer: &mut dyn Computer| flight::fly(&mission, computer, None, |_| ()).unwrap();
        let Record { report: expected, replans: expected_replans, .. } =
            fly(&mut HostComputer::new(&mission.guidance()).unwrap());
        let mut computing = Computing::start();
        computing.set_up(&mission.guidance());
        let Record { report, replans, .. } = fly(&mut computing);
        assert_eq!(report.result, Ending::Reached);
        assert_eq!(report, expected);
        assert!(replans.len() > 3, "{}", replans.len());
        let waypoints = |all: &[flight::Replan]| all.iter().map(|one| one.plan.waypoints_ned_m).collect::<Vec<_>>();
        assert_eq!(waypoints(&replans), waypoints(&expected_replans));
        // What it wrote down comes to the same flight once more.
        let again = replay(&computing.console).unwrap();
        assert!(again.is_identical() && again.trace_hash == report.trace_hash, "{again:?}");
    });
}

/// Flies a scenario to its end, as the desktop's computer does, and replays the log of it.
fn arrive_as_the_desktop_does(scenario: &str) -> Computing {
    let mission = Mission { scenario: Scenario::parse(scenario).unwrap(), ..mission() };
    let fly = |computer: &mut dyn Computer| flight::fly(&mission, computer, None, |_| ()).unwrap().report;
    let expected = fly(&mut HostComputer::new(&mission.guidance()).unwrap());
    let mut computing = Computing::start();
    computing.set_up(&mission.guidance());
    let report = fly(&mut computing);
    assert_eq!((report.result, report.collisions), (Ending::Reached, Some(0)));
    assert_eq!(report, expected);
    let again = replay(&computing.console).unwrap();
    assert!(again.is_identical() && again.trace_hash == report.trace_hash, "{again:?}");
    computing
}

#[test]
fn it_flies_by_the_bytes_of_a_lidar_and_tells_of_damaged_frames() {
    passes("it_flies_by_the_bytes_of_a_lidar_and_tells_of_damaged_frames", || {
        let mut computing = arrive_as_the_desktop_does(include_str!("../../tests/scenarios/lidar.json"));

        // A frame of which a bit is wrong.
        let mut broken = [0x54; 47];
        broken[1] = 0x2C;
        WORLD.sensor.say(&broken);
        WORLD.sensor.say(&[0; 47]);
        computing.steps(250);
        computing.type_line("status");
        let answers = answers(&computing.console);
        let line = answers.lines().find(|line| line.starts_with("lidar: turns ")).unwrap();
        assert!(line.ends_with(", damaged 1") && !line.contains("turns 0"), "{line}");
    });
}

#[test]
fn it_flies_by_the_lines_of_a_radio_and_tells_of_damaged_ones() {
    passes("it_flies_by_the_lines_of_a_radio_and_tells_of_damaged_ones", || {
        let mut computing = arrive_as_the_desktop_does(include_str!("../../tests/computer/uudf.json"));

        // An azimuth out of range, and a good line.
        let say = |azimuth_deg: i32| {
            let line = format!("+UUDF:6C1DEBA41845,-56,{azimuth_deg},0,0,37,\"6C1DEBA79D14\",\"\",1\r\n");
            WORLD.sensor.say(line.as_bytes());
        };
        say(181);
        let output = computing.steps(1);
        assert_eq!(output.bearing, None);
        say(30);
        let bearing = computing.steps(1).bearing.unwrap();
        assert!((bearing.azimuth_rad.to_degrees() - 30.0).abs() < 1e-4 && bearing.time == computing.now, "{bearing:?}");
        assert!((bearing.sigma_rad.to_degrees() - 8.0).abs() < 1e-4, "{bearing:?}");
        computing.steps(250);
        computing.type_line("status");
        let answers = answers(&computing.console);
        let line = answers.lines().find(|line| line.starts_with("radio: angles ")).unwrap();
        assert!(
            line.ends_with(", of other tags 0, without direction 0, refused 1") && !line.contains("angles 0"),
            "{line}"
        );
    });
}

#[test]
fn it_begins_with_the_parameters_that_were_kept() {
    passes("it_begins_with_the_parameters_that_were_kept", || {
        let mut kept = Values::DEFAULT;
        kept.set(param::FH_SPD_MAX, 1.25).unwrap();
        let mut store = Store::new(Flash);
        assert_eq!(store.begin(), 1);
        assert!(store.save(&kept));

        let mut computing = Computing::start();
        computing.steps(20);
        assert_eq!(begun_with(&computing.console, param::FH_SPD_MAX).to_bits(), 1.25_f32.to_bits());
        computing.type_line("status");
        assert!(answers(&computing.console).contains("; start 2"));
        assert!(!contains(&computing.sent, "lost"));
    });
}

#[test]
fn a_flash_that_refuses_to_be_read_is_told_by_name_and_keeps_it_from_seeking() {
    passes("a_flash_that_refuses_to_be_read_is_told_by_name_and_keeps_it_from_seeking", || {
        WORLD.refuses_flash.store(true, Ordering::Relaxed);
        let mut computing = Computing::start();
        let report = flight::fly(&mission(), &mut computing, None, |_| ()).unwrap().report;
        assert_eq!((report.result, report.reason), (Ending::Hold, Outcome::Uncalibrated.name()));
        for news in ["parameters lost: defaults, does not seek", "stored calibration lost", "stored key lost"] {
            assert!(contains(&computing.sent, news), "{news}");
        }
        assert_eq!(begun_with(&computing.console, param::FH_CAL_REQ).to_bits(), 1.0_f32.to_bits());
        computing.type_line("factory-reset yes");
        // The autopilot says nothing any more: not in control.
        computing.steps(250);
        computing.type_line("factory-reset yes");
        computing.type_line("status");
        let answers = answers(&computing.console);
        for answer in ["; start 0", "refused: in control", "error: the flash cannot be erased"] {
            assert!(answers.contains(answer), "{answer}: {answers}");
        }
    });
}

#[test]
fn restart_ends_the_program_when_all_is_told() {
    let ended = alone("restart_ends_the_program_when_all_is_told", || {
        let mut computing = Computing::start();
        computing.steps(5);
        computing.type_line("restart");
        panic!("it goes on");
    });
    assert_eq!(ended, RESTARTED);
}
