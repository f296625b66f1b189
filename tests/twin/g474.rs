//! The shipped image for the NUCLEO-G474RE, unchanged, in an instruction emulator with a strict model of the part
//! (`tests/g474`): it boots, flies, survives floods and faults; and what the model knows of registers is what others know.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::guidance::FrontEnd;
use foxhound_core::guidance::param::{self, Values};
use foxhound_core::planning::planner;
use foxhound_link::dialect::{ATTITUDE_DATA, MavMessage};
use foxhound_link::framer::{Framer, Header};
use foxhound_sim::autopilot::{Autopilot, Start};
use foxhound_sim::drive::computer::{BLOCK, Computer, ComputerError, HostComputer, StepReport};
use foxhound_sim::drive::flight::{self, Ending, Mission};
use foxhound_sim::drive::g474::{Board, Crystal, G474Computer, G474Error, Needs, Options, Report, Restarted, trial};
use foxhound_sim::drive::replay::replay;
use foxhound_sim::scenario::{Scenario, Software};
use foxhound_sim::world::Pose;
use foxhound_sim::world::antennas::Antennas;
use foxhound_sim::world::random::Random;
use foxhound_sim::world::vehicle::Motion;
use foxhound_tests::{assert_refused, g474_image, g474_iq_image, python, qemu_image, root, station};
use serde_json::{Value, json};
use stm32_metapac::metadata::METADATA;
use stm32_metapac::metadata::ir::{Array, BitOffset, BlockItemInner, IR};

/// A board, an autopilot that hovers, and what the board says.
struct Bench {
    board: Board,
    report: Report,
    autopilot: Autopilot,
    framer: Framer,
    random: Random,
    texts: Vec<String>,
    heartbeats_s: Vec<f64>,
    parameters: Vec<f32>,
    resets: Vec<Restarted>,
}

impl Bench {
    fn start(options: Options) -> Self {
        let (board, report) = Board::start(Path::new(&g474_image()), options).unwrap();
        let resets = report.resets.clone();
        Self {
            board,
            report,
            autopilot: Autopilot::new(Software::ArduCopter, Start::Hovering),
            framer: Framer::new(),
            random: Random::new(1, 1),
            texts: Vec::new(),
            heartbeats_s: Vec::new(),
            parameters: Vec::new(),
            resets,
        }
    }

    fn seconds(&mut self, seconds: f64) {
        let until_us = self.report.now_us + seconds * 1e6;
        while self.report.now_us < until_us {
            self.step(&[]);
        }
    }

    /// One frame; the autopilot speaks, and somebody else may.
    fn step(&mut self, more: &[u8]) {
        self.autopilot.telemetry(self.report.frame_us as u64, &Motion::default(), false);
        let mut rx = self.autopilot.transmit();
        rx.extend_from_slice(more);
        let snapshot = self.noise();
        let report = self.board.step(&rx, &[], &[], Some(&snapshot)).unwrap();
        self.listen(report);
    }

    /// No beacon.
    fn noise(&mut self) -> AdcFrame<BLOCK> {
        let antennas = Antennas { channel_gain: [0.0; 4], snr_db: Some(20.0), ..Antennas::default() };
        antennas.frame(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut self.random)
    }

    fn listen(&mut self, report: Report) {
        for (_, message) in station::messages(&mut self.framer, &report.tx) {
            match message {
                MavMessage::STATUSTEXT(text) => self.texts.push(station::words(&text)),
                MavMessage::HEARTBEAT(_) => self.heartbeats_s.push(report.now_us * 1e-6),
                MavMessage::PARAM_VALUE(value) => self.parameters.push(value.param_value),
                _ => {}
            }
        }
        self.resets.extend_from_slice(&report.resets);
        self.report = report;
    }

    fn fault(&mut self, fault: &Value) {
        let report = self.board.fault(fault).unwrap();
        self.listen(report);
    }

    fn causes(&self) -> Vec<&str> {
        self.resets.iter().map(|reset| reset.cause.as_str()).collect()
    }

    fn has_said(&self, words: &str) -> bool {
        self.texts.iter().any(|text| text.contains(words))
    }

    /// Beats once a second, in this last while.
    fn assert_beats(&self, seconds: f64) {
        let from_s = self.report.now_us * 1e-6 - seconds;
        let beats: Vec<f64> = self.heartbeats_s.iter().copied().filter(|at_s| *at_s > from_s).collect();
        assert!((beats.len() as f64 - seconds).abs() <= 1.5, "{} beats in {seconds} s", beats.len());
        assert!(beats.windows(2).all(|pair| (pair[1] - pair[0] - 1.0).abs() < 0.1), "{beats:?}");
    }

    fn set_speed(&mut self, value: f32) {
        self.step(&station::set(param::FH_SPD_MAX, value));
    }

    fn save(&mut self) {
        self.step(&station::save());
    }

    fn speed(&mut self) -> f32 {
        self.parameters.clear();
        for _ in 0..50 {
            self.step(&station::read(param::FH_SPD_MAX));
            if let Some(value) = self.parameters.last() {
                return *value;
            }
        }
        panic!("the board does not tell its parameters");
    }
}

/// The mission of a file of `tests`.
fn mission(file: &str) -> Mission {
    let text = std::fs::read_to_string(root().join("tests").join(file)).unwrap();
    let scenario = Scenario::parse(&text).unwrap();
    Mission { scenario, seed: 3, planner: planner::Config::default(), estimator: Estimator::default() }
}

/// The image for the NUCLEO-G474RE boots and runs for a minute without a restart.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn it_boots_and_runs_for_a_minute_without_a_restart() {
    let mut bench = Bench::start(Options { seed: 1, ..Options::default() });
    bench.seconds(61.0);
    assert_eq!(bench.causes(), [""; 0], "{:?}", bench.texts);
    bench.assert_beats(60.0);
    assert!(!bench.has_said("restart"), "{:?}", bench.texts);
}

/// It flies to the beacon with the trace hash of the desktop and of QEMU at every step.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn it_flies_to_the_beacon_with_the_hash_of_the_desktop_and_of_qemu() {
    let flown = trial::fly(Path::new(&g474_image()), Some(Path::new(&qemu_image())), 1).unwrap();
    assert_eq!(flown.report.result, Ending::Reached, "{:?}", flown.report);
    assert!(flown.report.time_s >= 13.0, "{}", flown.report.time_s);
    assert!(flown.steps > 600 && flown.twin_steps == flown.steps, "{} {}", flown.steps, flown.twin_steps);
    assert!(flown.replayed.is_identical(), "{:?}", flown.replayed);
    assert_eq!(flown.replayed.trace_hash, flown.report.trace_hash);
    assert!(flown.replayed.codes_checked > 10);
    let most = |name: &str| flown.timing["per_activation"][name]["most"].as_f64().unwrap() / 170e3;
    assert!(most("guidance") < 20.0, "the longest step takes {} ms", most("guidance"));
}

/// It flies by a lidar, and by the `+UUDF` lines of a radio on that line, with the trace hash of the desktop at every step.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn it_flies_by_a_lidar_and_by_a_radio_on_the_sensors_line() {
    for name in ["scenarios/lidar.json", "computer/uudf.json"] {
        let mut mission = mission(name);
        let config = mission.guidance();
        let needs = Needs::of(&mut mission, &config, &Values::of(&config)).unwrap();
        let mut computer = G474Computer::start(Path::new(&g474_image()), Options::default(), &needs).unwrap();
        let report = flight::fly(&mission, &mut computer, None, |_| ()).unwrap().report;
        assert_eq!((report.result, report.collisions), (Ending::Reached, Some(0)), "{report:?}");
        assert_eq!(computer.config().map(|config| (config.lidar, config.radio)), Some((None, None)), "as it was built");
        let replayed = replay(&computer.take_flight_log()).unwrap();
        assert!(replayed.is_identical() && replayed.late_steps == 0, "{replayed:?}");
        assert_eq!(replayed.trace_hash, report.trace_hash);
    }
}

/// The image that reads IQ reports flies by those of a Bluetooth controller for four seconds, with the trace hash of the desktop at every
/// step.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn an_image_that_reads_iq_reports_flies_by_them() {
    let mut mission = mission("computer/hci.json");
    let config = mission.guidance();
    let needs = Needs::of(&mut mission, &config, &Values::of(&config)).unwrap();
    let mut computer = G474Computer::start(Path::new(&g474_iq_image()), Options::default(), &needs).unwrap();
    let stop = AtomicBool::new(false);
    let watch = |moment: &flight::Moment<'_>| stop.store(moment.sample.time_s > 4.0, Ordering::Relaxed);
    let report = flight::fly_until(&mission, &mut computer, None, &stop, watch).unwrap().report;
    assert_eq!((report.result, report.collisions), (Ending::Interrupted, Some(0)), "{report:?}");
    assert!(report.bearing_rms_deg.is_some_and(|rms_deg| rms_deg < 14.0), "{report:?}");
    let replayed = replay(&computer.take_flight_log()).unwrap();
    assert!(replayed.is_identical() && replayed.late_steps == 0, "{replayed:?}");
    assert_eq!(replayed.trace_hash, report.trace_hash);
}

/// The image flies, its line full of telemetry, noise and breaks; what flies beside it only says what guidance would have said.
struct Flooded {
    board: Board,
    report: Report,
    beside: HostComputer,
    framer: Framer,
    attitude: Vec<u8>,
    step: u64,
    heartbeats_s: Vec<f64>,
    setpoints_s: Vec<f64>,
    resets: Vec<Restarted>,
}

/// Of the 1 843 bytes that the line carries in a step.
const FLOOD_BYTES: usize = 1_800;

impl Computer for Flooded {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        let FrontEnd::Frame(snapshot) = front_end else { panic!("it flies by waves") };
        let output = self.beside.step(now, front_end, circles, rx)?.output;
        // A byte in a thousand is damaged.
        let error = if self.step.is_multiple_of(2) { "noise" } else { "break" };
        self.board.fault(&json!({ "kind": error, "bytes": 2 })).unwrap();
        let mut line = rx.to_vec();
        while line.len() + self.attitude.len() < FLOOD_BYTES {
            line.extend_from_slice(&self.attitude);
        }
        self.step += 1;
        let report = self.board.step(&line, &[], &[], Some(snapshot)).unwrap();
        for (_, message) in station::messages(&mut self.framer, &report.tx) {
            match message {
                MavMessage::HEARTBEAT(_) => self.heartbeats_s.push(report.now_us * 1e-6),
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) => self.setpoints_s.push(report.now_us * 1e-6),
                _ => {}
            }
        }
        self.resets.extend_from_slice(&report.resets);
        let tx = report.tx.clone();
        self.report = report;
        Ok(StepReport { output, plan: None, tx })
    }

    fn see(&mut self, _bytes: &[u8]) -> Result<(), ComputerError> {
        Ok(())
    }

    fn turn(&mut self, _bytes: &[u8]) -> Result<(), ComputerError> {
        Ok(())
    }

    fn next_step_s(&self) -> Option<f64> {
        Some(self.report.frame_us * 1e-6)
    }

    fn needs_entry(&self) -> bool {
        true
    }
}

/// A line that is full of telemetry, noise and breaks delays no task.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn a_line_that_is_full_of_telemetry_noise_and_breaks_starves_nothing() {
    let scenario = Scenario { max_time_s: 9.0, ..Scenario::built_in() };
    let mission = Mission { scenario, seed: 2, planner: Default::default(), estimator: Default::default() };
    let (board, report) = Board::start(Path::new(&g474_image()), Options { seed: 2, ..Options::default() }).unwrap();
    // From a component that is not the autopilot: parsed, and of no use.
    let header = Header { system_id: 1, component_id: 100, sequence: 0 };
    let mut flooded = Flooded {
        board,
        report,
        beside: HostComputer::new(&mission.guidance()).unwrap(),
        framer: Framer::new(),
        attitude: station::frame(header, &ATTITUDE_DATA::DEFAULT),
        step: 0,
        heartbeats_s: Vec::new(),
        setpoints_s: Vec::new(),
        resets: Vec::new(),
    };
    let record = flight::fly(&mission, &mut flooded, None, |_| ()).unwrap();
    assert_eq!(flooded.resets, []);
    assert_eq!(record.report.collisions, Some(0));
    let [beats, setpoints] = [&flooded.heartbeats_s, &flooded.setpoints_s];
    assert!(beats.len() >= 7 && beats.windows(2).all(|pair| (pair[1] - pair[0] - 1.0).abs() < 0.1), "{beats:?}");
    let (first_s, last_s) = (setpoints[0], setpoints[setpoints.len() - 1]);
    assert!(first_s < 3.5 && last_s > 8.8, "from {first_s} s to {last_s} s");
    let rate_hz = (setpoints.len() - 1) as f64 / (last_s - first_s);
    assert!((10.0..30.0).contains(&rate_hz), "{rate_hz} Hz");
    let gap_s = setpoints.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    assert!(gap_s <= 0.1, "{gap_s} s without a setpoint");
    assert!(record.report.path_length_m > 3.0, "it flies: {} m", record.report.path_length_m);
}

/// Without a crystal it runs on the internal oscillator and reports it.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn without_a_crystal_it_runs_on_the_internal_oscillator_and_says_so() {
    let mut bench = Bench::start(Options { seed: 3, crystal: Crystal::Missing, ..Options::default() });
    bench.seconds(5.0);
    assert_eq!(bench.causes(), [""; 0]);
    bench.assert_beats(4.0);
    assert!(bench.has_said("no crystal"), "{:?}", bench.texts);
}

/// As delivered, the chip runs on below its least supply.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn a_board_whose_brown_out_level_is_not_set_says_so() {
    for is_new in [true, false] {
        let mut bench = Bench::start(Options { seed: 42, is_new, ..Options::default() });
        bench.seconds(3.0);
        assert_eq!(bench.has_said("brown-out level"), is_new, "{:?}", bench.texts);
    }
}

/// A crystal that stops while the PLL locks, at every start, restarts the board once, too.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn a_crystal_that_stops_while_the_clock_is_raised_restarts_the_board_once() {
    let mut bench = Bench::start(Options { seed: 41, crystal: Crystal::Fails, ..Options::default() });
    bench.seconds(5.0);
    assert_eq!(bench.causes(), ["software"]);
    assert!(bench.has_said("the crystal has failed") && bench.has_said("no crystal"), "{:?}", bench.texts);
    bench.assert_beats(4.0);
}

/// A crystal that fails again and again restarts the board once: from then on it runs on the internal oscillator.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn a_crystal_that_fails_again_and_again_restarts_the_board_once() {
    let mut bench = Bench::start(Options { seed: 40, ..Options::default() });
    bench.seconds(2.0);
    for _ in 0..2 {
        bench.fault(&json!({ "kind": "crystal", "after_us": 1_234 }));
        bench.seconds(3.0);
    }
    assert_eq!(bench.causes(), ["software"]);
    assert!(bench.has_said("the crystal has failed") && bench.has_said("no crystal"), "{:?}", bench.texts);
    bench.assert_beats(2.0);
}

/// After an overrun of a converter new frames arrive.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn after_an_overrun_of_a_converter_frames_come_again() {
    let mut bench = Bench::start(Options { seed: 4, ..Options::default() });
    bench.seconds(1.0);
    for channel in 0..4 {
        bench.fault(&json!({ "kind": "adc-overrun", "channel": channel, "after_us": 3_000 }));
        bench.seconds(0.5);
        assert!(bench.report.is_sampling, "ADC{} has stopped", channel + 1);
    }
    assert_eq!(bench.causes(), [""; 0]);
    bench.assert_beats(2.0);
    assert!(!bench.has_said("does not"), "{:?}", bench.texts);
}

/// A converter that has missed a trigger would be a sample behind the others from then on: all are started anew.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn a_converter_that_misses_a_trigger_does_not_stay_behind() {
    let mut bench = Bench::start(Options { seed: 4, ..Options::default() });
    bench.seconds(1.0);
    for channel in 0..4 {
        bench.fault(&json!({ "kind": "adc-miss", "channel": channel, "after_us": 3_000 }));
        bench.seconds(0.5);
        assert!(bench.report.is_sampling && bench.report.is_in_step, "ADC{} is out of step", channel + 1);
    }
    assert_eq!(bench.causes(), [""; 0]);
    bench.assert_beats(2.0);
}

/// Noise and breaks on the line lose only the bytes that they hit.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn noise_and_breaks_on_the_line_cost_the_bytes_that_they_hit() {
    let mut bench = Bench::start(Options { seed: 5, ..Options::default() });
    bench.seconds(2.0);
    for round in 0..50 {
        let kind = if round % 2 == 0 { "noise" } else { "break" };
        bench.fault(&json!({ "kind": kind, "bytes": 1 + round % 3, "after_us": 37 * round }));
        bench.step(&[]);
    }
    bench.set_speed(0.8);
    assert_eq!(bench.speed(), 0.8, "it hears");
    assert_eq!(bench.causes(), [""; 0]);
    assert!(!bench.has_said("autopilot has restarted"), "old bytes were read as new: {:?}", bench.texts);
    bench.assert_beats(2.0);
}

/// When the power is cut during a save, the old value or the new one remains.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn a_save_that_the_power_cuts_off_leaves_the_old_value_or_the_new_one() {
    let mut values = Vec::new();
    for operation in [0, 1, 2, 5, 12] {
        let mut bench = Bench::start(Options { seed: 6 + operation, ..Options::default() });
        bench.seconds(0.5);
        bench.set_speed(0.7);
        bench.seconds(0.5);
        bench.fault(&json!({ "kind": "flash-cut", "operation": operation }));
        bench.save();
        bench.seconds(2.0);
        assert_eq!(bench.causes(), ["cut"], "operation {operation}: {:?}", bench.texts);
        values.push(bench.speed());
        bench.assert_beats(1.0);
    }
    assert!(values.iter().all(|value| [1.0, 0.7].contains(value)), "{values:?}");
}

/// Saved values remain after every kind of restart.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn what_was_saved_is_there_after_every_kind_of_restart() {
    let mut bench = Bench::start(Options { seed: 20, ..Options::default() });
    bench.seconds(0.5);
    bench.set_speed(0.6);
    bench.save();
    bench.seconds(2.0);
    for (kind, cause, words) in [
        ("brown-out", "brown-out", Some("brown-out")),
        ("stuck", "watchdog", Some("watchdog")),
        ("pin", "pin", None),
        ("power", "power", None),
    ] {
        bench.texts.clear();
        bench.fault(&json!({ "kind": kind, "after_us": 1_234 }));
        bench.seconds(2.5);
        assert_eq!(bench.causes().last(), Some(&cause), "{:?}", bench.resets);
        assert!(words.is_none_or(|words| bench.has_said(words)), "{kind}: {:?}", bench.texts);
        assert_eq!(bench.speed(), 0.6, "{kind}");
        bench.assert_beats(1.0);
    }
    assert_eq!(bench.resets.len(), 4);
    // The watchdog bites within its time.
    let [before, bitten] = [&bench.resets[0], &bench.resets[1]].map(|reset| reset.time_us);
    assert!(bitten - before < 4e6, "{:?}", bench.resets);
}

/// Random contents of the memory at power-on do not change the start.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn memory_that_starts_as_noise_starts_no_other_way() {
    for seed in 30..34 {
        let mut bench = Bench::start(Options { seed, ..Options::default() });
        bench.seconds(1.5);
        assert_eq!(bench.causes(), [""; 0]);
        assert!(!bench.has_said("restart"), "seed {seed}: {:?}", bench.texts);
    }
}

/// An image for another board, or a scenario that the board cannot fly, is refused.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn an_image_of_another_board_is_refused_and_so_is_what_cannot_be_flown() {
    let [via, other] = [g474_image(), qemu_image()].map(|image| format!("g474:{image}"));
    let cases = [
        (&["--via", &other][..], ["it is for the board mps2_an386"]),
        (&["--via", "g474:Cargo.toml"], ["it is not an ELF file"]),
        (&["--planner", "paper", "--via", &via], ["--planner: no parameter of the image sets this"]),
    ];
    assert_refused(&["fly", "--json"], &cases);
    let error = Board::start(Path::new("/nonexistent"), Options::default()).unwrap_err();
    assert!(matches!(error, G474Error::Image(_)), "{error}");
}

/// A register in which the model and stm32-metapac differ, by its bits; and what `stm32g4`, which is made from ST's SVD file,
/// has in that place.
struct Difference {
    register: &'static str,
    bits: u32,
    file: &'static str,
    has: &'static str,
    lacks: &'static str,
}

const fn differs(register: &'static str, bits: u32, file: &'static str, has: &'static str) -> Difference {
    Difference { register, bits, file, has, lacks: "\0" }
}

/// metapac gives a low-power UART what an UART has.
const fn lacks(register: &'static str, bits: u32, file: &'static str, lacks: &'static str) -> Difference {
    Difference { register, bits, file, has: "", lacks }
}

const DIFFERENCES: [Difference; 14] = [
    // The one that left the regulator's boost off.
    differs("PWR.CR5", 0x101, "pwr/cr5.rs", "R1MODE_W::new(self, 8)"),
    differs("TIM6.CR2", 0x200_0000, "tim6/cr2.rs", "MMS_R::new(((self.bits >> 4) & 7) as u8)"),
    differs("TIM15.DIER", 0x404, "tim15/dier.rs", "CCIE_W::new(self, 2)"),
    differs("DMAMUX1.CCR", 0x80, "dmamux/ccr.rs", "DMAREQ_ID_R::new((self.bits & 0x7f) as u8)"),
    differs("USART1.CR2", 0x9, "usart1/cr2.rs", "SLVEN"),
    differs("USART1.CR3", 0x100_0000, "usart1/cr3.rs", "TCBGTIE"),
    differs("USART1.ISR", 0x200_2000, "usart1/isr.rs", "UDR"),
    differs("USART1.ICR", 0x20A0, "usart1/icr.rs", "UDRCF"),
    lacks("LPUART1.CR1", 0xC00_8000, "lpuart1/cr1.rs", "OVER8_W"),
    lacks("LPUART1.CR2", 0xF0_4F60, "lpuart1/cr2.rs", "LINEN_W"),
    lacks("LPUART1.CR3", 0xE_0836, "lpuart1/cr3.rs", "SCEN_W"),
    lacks("LPUART1.ISR", 0xD900, "lpuart1/isr.rs", "RTOF_R"),
    lacks("LPUART1.ICR", 0x1900, "lpuart1/icr.rs", "RTOCF_W"),
    differs("LPUART1.BRR", 0xF_0000, "lpuart1/brr.rs", "0x000f_ffff"),
];

/// The bits that metapac knows of the registers at this place of a block; several registers may lie there.
fn known_bits(ir: &IR, block: &str, offset: u32) -> Vec<u32> {
    let same = |a: &str, b: &str| a.replace('_', "").eq_ignore_ascii_case(&b.replace('_', ""));
    let Some(block) = ir.blocks.iter().find(|known| same(known.name, block)) else { return Vec::new() };
    let mut found = block.extends.map_or_else(Vec::new, |base| known_bits(ir, base, offset));
    for item in block.items {
        for shift in places(item.array.as_ref()) {
            let at = item.byte_offset + shift;
            match &item.inner {
                BlockItemInner::Block(inner) if at <= offset => found.extend(known_bits(ir, inner.block, offset - at)),
                BlockItemInner::Register(register) if at == offset => {
                    found.push(register.fieldset.map_or(u32::MAX >> (32 - register.bit_size), |name| fields(ir, name)));
                }
                _ => {}
            }
        }
    }
    found
}

fn fields(ir: &IR, name: &str) -> u32 {
    let same = |a: &str, b: &str| a.replace('_', "").eq_ignore_ascii_case(&b.replace('_', ""));
    let Some(set) = ir.fieldsets.iter().find(|set| same(set.name, name)) else { return 0 };
    let mut bits = set.extends.map_or(0, |base| fields(ir, base));
    for field in set.fields {
        for shift in places(field.array.as_ref()) {
            let ranges = match &field.bit_offset {
                BitOffset::Regular(at) => vec![at.offset..=at.offset + field.bit_size - 1],
                BitOffset::Cursed(at) => at.ranges.to_vec(),
            };
            bits |= ranges.into_iter().flatten().map(|bit| 1 << (bit + shift)).sum::<u32>();
        }
    }
    bits
}

fn places(array: Option<&Array>) -> Vec<u32> {
    match array {
        None => vec![0],
        Some(Array::Regular(array)) => (0..array.len).map(|at| at * array.stride).collect(),
        Some(Array::Cursed(array)) => array.offsets.to_vec(),
    }
}

/// The folder of `stm32g4`'s sources for this part.
fn third_source() -> std::path::PathBuf {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = std::process::Command::new(cargo);
    let output = command.current_dir(root()).args(["metadata", "--format-version", "1", "--offline"]).output().unwrap();
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let package = metadata["packages"].as_array().unwrap().iter().find(|package| package["name"] == "stm32g4").unwrap();
    Path::new(package["manifest_path"].as_str().unwrap()).parent().unwrap().join("src/stm32g474")
}

/// `C0CR` to `C15CR` of the multiplexer are of one kind, and so are USART1 and USART3 (RM0440, table of the implementation).
fn kind_of(block: &str, register: &str) -> String {
    match block {
        "DMAMUX1" => format!("{block}.CCR"),
        "USART3" => format!("USART1.{register}"),
        _ => format!("{block}.{register}"),
    }
}

/// The emulator's registers agree with stm32-metapac and with ST's SVD file, except for listed differences.
#[test]
#[ignore = "needs the image, and Python with Unicorn: cargo xtask test"]
fn the_registers_of_the_model_are_those_of_two_other_sources() {
    let output = python().arg("-B").arg(root().join("tests/g474/registers.py")).output().unwrap();
    let table: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (third, mut used, mut registers) = (third_source(), Vec::new(), 0);
    for block in table["blocks"].as_array().unwrap() {
        let name = block["name"].as_str().unwrap();
        let known = METADATA.peripherals.iter().find(|peripheral| peripheral.name == name).unwrap();
        assert_eq!(block["address"].as_u64().unwrap(), known.address, "{name}");
        if let (Some(clock), Some(enable)) =
            (block["clock"].as_str(), known.rcc.as_ref().and_then(|rcc| rcc.enable.as_ref()))
        {
            assert_eq!(clock, format!("{}.{}", enable.register, enable.field).to_uppercase(), "{name}");
        }
        if let Some(number) = block["interrupt"].as_u64() {
            let is_its = |name: &str| {
                METADATA.interrupts.iter().any(|known| known.name == name && u64::from(known.number) == number)
            };
            assert!(known.interrupts.iter().any(|of| is_its(of.interrupt)), "{name}: interrupt {number}");
        }
        let of = known.registers.as_ref().unwrap();
        for register in block["registers"].as_array().unwrap() {
            let (text, offset) = (register["name"].as_str().unwrap(), register["offset"].as_u64().unwrap() as u32);
            let number = |value: &Value| value.as_u64().unwrap() as u32;
            let fields = register["fields"].as_array().unwrap().iter();
            let ours: u32 =
                fields.map(|field| (u32::MAX >> (32 - number(&field["width"]))) << number(&field["bit"])).sum();
            let theirs = known_bits(of.ir, of.block, offset);
            registers += 1;
            if theirs.contains(&ours) {
                continue;
            }
            let kind = kind_of(name, text);
            let difference = DIFFERENCES.iter().find(|difference| difference.register == kind);
            let difference = difference.unwrap_or_else(|| panic!("{kind}: {ours:#x} here, {theirs:x?} there"));
            assert!(theirs.iter().any(|theirs| theirs ^ ours == difference.bits), "{kind}: {ours:#x}, {theirs:x?}");
            let source = std::fs::read_to_string(third.join(difference.file)).unwrap();
            assert!(
                source.contains(difference.has) && !source.contains(difference.lacks),
                "{kind}: {}",
                difference.file
            );
            used.push(kind);
        }
    }
    assert!(registers > 150, "{registers}");
    let unused = DIFFERENCES.iter().map(|difference| difference.register);
    let unused: Vec<&str> = unused.filter(|register| !used.iter().any(|kind| kind == register)).collect();
    assert_eq!(unused, [""; 0], "they agree by now");
    for request in table["requests"].as_array().unwrap() {
        let (number, name) = (request["number"].as_u64().unwrap(), request["peripheral"].as_str().unwrap());
        let known = METADATA.peripherals.iter().find(|peripheral| peripheral.name == name).unwrap();
        assert!(
            known.dma_channels.iter().any(|channel| channel.request.map(u64::from) == Some(number)),
            "{name}: {number}"
        );
    }
}
