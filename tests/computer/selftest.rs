//! The receiver tested and calibrated on board: the whole computer, an autopilot, a ground station that sends the
//! command and reads the answers, and antennas with one fault at a time.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_computer::selftest::{Check, Report, Verdict};
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::guidance::{self, FrontEnd};
use foxhound_link::dialect::MavMessage;
use foxhound_link::framer::Framer;
use foxhound_sim::autopilot::{Autopilot, GUIDED, Start};
use foxhound_sim::drive::computer::{Computer as _, HostComputer};
use foxhound_sim::scenario::Software;
use foxhound_sim::tools::calibrate;
use foxhound_sim::tools::frames::Recording;
use foxhound_sim::world::Pose;
use foxhound_sim::world::antennas::{Antennas, Fault, square};
use foxhound_sim::world::random::Random;
use foxhound_sim::world::vehicle::Motion;
use foxhound_tests::{npy_frames, station};

const SELF_TEST: u16 = 31_010;
const CALIBRATE: u16 = 31_011;
const ACCEPTED: u8 = 0;
const REJECTED: u8 = 1;
const FAILED: u8 = 4;
const IN_PROGRESS: u8 = 5;
/// So far away that the wave is plane, and the antennas' distances do not matter.
const FAR_M: f64 = 5_000.0;

/// A receiver with a tone as the board's own makes it through a splitter: 322 codes, and two codes of noise.
fn good() -> Antennas {
    Antennas { amplitude_codes: 322.0, snr_db: Some(40.0), positions_m: [[0.0; 2]; 4], ..Antennas::default() }
}

/// Changes to a frame before the computer gets it.
type Spoil = fn(u64, &mut AdcFrame<256>, &AdcFrame<256>);

/// The computer on the bench.
struct Bench {
    computer: HostComputer,
    autopilot: Autopilot,
    antennas: Antennas,
    source_ned_m: [f64; 3],
    random: Random,
    step: u64,
    step_us: u64,
    last: AdcFrame<256>,
    spoil: Spoil,
    framer: Framer,
    /// Results of the commands to us, and texts.
    results: Vec<(u16, u8)>,
    texts: Vec<String>,
    setpoints: usize,
    /// Frames since the last command, where they are wanted.
    kept: Option<Vec<AdcFrame<256>>>,
    bearing: Option<Bearing>,
}

impl Bench {
    fn new(antennas: Antennas, seed: u64) -> Self {
        let mut bench = Self {
            computer: HostComputer::new(&guidance::Config::default()).unwrap(),
            autopilot: Autopilot::new(Software::ArduCopter, Start::Parked),
            antennas,
            source_ned_m: [FAR_M, 0.0, 0.0],
            random: Random::new(seed, 7),
            step: 0,
            step_us: 20_000,
            last: AdcFrame::zeroed(),
            spoil: |_, _, _| (),
            framer: Framer::new(),
            results: Vec::new(),
            texts: Vec::new(),
            setpoints: 0,
            kept: None,
            bearing: None,
        };
        bench.run(100);
        bench
    }

    fn heard_from(mut self, azimuth_deg: f64) -> Self {
        let (sine, cosine) = azimuth_deg.to_radians().sin_cos();
        self.source_ned_m = [FAR_M * cosine, FAR_M * sine, 0.0];
        self
    }

    fn run(&mut self, steps: u64) {
        (0..steps).for_each(|_| self.step(&[]));
    }

    fn step(&mut self, said: &[u8]) {
        let (now_us, pose) = (self.step * self.step_us, Pose::default());
        let mut snapshot = self.antennas.frame::<256>(Instant(now_us), &pose, self.source_ned_m, &mut self.random);
        (self.spoil)(self.step, &mut snapshot, &self.last);
        self.last = snapshot.clone();
        self.kept.iter_mut().for_each(|kept| kept.push(snapshot.clone()));
        let motion = Motion { pose, ..Motion::default() };
        self.autopilot.telemetry(now_us, &motion, false);
        let mut rx = self.autopilot.transmit();
        rx.extend_from_slice(said);
        let report = self.computer.step(Instant(now_us), FrontEnd::Frame(&snapshot), Some(&[]), &rx).unwrap();
        self.autopilot.receive(now_us, &motion, &report.tx);
        self.read(&report.tx);
        self.bearing = report.output.bearing;
        self.step += 1;
    }

    fn read(&mut self, bytes: &[u8]) {
        for (_, message) in station::messages(&mut self.framer, bytes) {
            match message {
                MavMessage::COMMAND_ACK(ack) => self.results.push((ack.command, ack.result)),
                MavMessage::STATUSTEXT(text) => self.texts.push(station::words(&text)),
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) => self.setpoints += 1,
                _ => {}
            }
        }
    }

    /// Sends the command of a ground station, and waits for the result.
    fn order(&mut self, command: u16, param1: f32, param2: f32) -> Option<Report> {
        (self.results, self.texts, self.setpoints) = (Vec::new(), Vec::new(), 0);
        self.step(&station::command(command, param1, param2));
        self.run(200);
        assert_eq!(self.setpoints, 0, "nothing moves");
        self.computer.examined().copied()
    }

    fn bearing(&mut self) -> Option<Bearing> {
        self.run(10);
        self.bearing
    }

    fn self_test(&mut self) -> Report {
        self.order(SELF_TEST, 0.0, 0.0).unwrap()
    }
}

/// The check and the channels reported for a faulty receiver, also in the text.
fn assert_found(mut bench: Bench, check: Check, channels: &[usize], words: &str) {
    let report = bench.self_test();
    let Verdict::Fail { check: found, channels: named } = report.verdict else { unreachable!("{report:?}") };
    let named: Vec<usize> = (0..4).filter(|channel| named.contains(*channel)).collect();
    assert_eq!((found, named.as_slice()), (check, channels), "{report:?}");
    assert_eq!(bench.results, [(SELF_TEST, IN_PROGRESS), (SELF_TEST, FAILED)]);
    assert!(bench.texts.iter().any(|text| text == &format!("Foxhound: self-test: {words}")), "{:?}", bench.texts);
}

/// A good receiver passes the self-test, and its measured values are the true ones.
#[test]
fn a_good_receiver_passes_and_what_is_measured_of_it_is_what_it_is() {
    for seed in 1..=3 {
        let antennas = Antennas {
            offset_codes: [12.0, -30.0, 0.0, 55.0],
            channel_gain: [1.0, 0.9, 1.1, 1.05],
            channel_phase_rad: [0.0, 0.5, -1.0, 2.0],
            ..good()
        };
        let truth = antennas.clone();
        let mut bench = Bench::new(antennas, seed);
        let report = bench.self_test();
        assert_eq!((report.verdict, report.frames), (Verdict::Pass, 64), "{report:?}");
        assert_eq!(bench.results, [(SELF_TEST, IN_PROGRESS), (SELF_TEST, ACCEPTED)]);
        assert!(bench.texts.contains(&"Foxhound: self-test passed".to_owned()), "{:?}", bench.texts);
        assert!(bench.computer.config().array.calibration.is_none(), "a test changes nothing");
        assert!((report.frequency_hz - 14_800).abs() <= 1 && report.rate_off_ppm.abs() <= 1, "{report:?}");
        assert!((report.snr_centi_db - 4_000).abs() < 100, "{report:?}");
        let noise_codes = 322.0 / 2e4_f64.sqrt();
        let mean_gain = truth.channel_gain.iter().sum::<f64>() / 4.0;
        for (m, channel) in report.channels.iter().enumerate() {
            let near = |found: i32, truth: f64, within: f64| (f64::from(found) - truth).abs() < within;
            assert!(near(channel.offset_centi_codes, 100.0 * truth.offset_codes[m], 10.0), "{channel:?}");
            // The median of one frame's spectrum is within a tenth of the floor, which holds the converter's rounding, too.
            let floor_codes = (noise_codes.powi(2) + 1.0 / 12.0).sqrt();
            assert!(near(channel.noise_centi_codes, 100.0 * floor_codes, 10.0 * floor_codes), "{channel:?}");
            assert!(near(channel.amplitude_centi_codes, 32_200.0 * truth.channel_gain[m], 30.0), "{channel:?}");
            assert!(near(channel.gain_centi_db, 2e3 * (truth.channel_gain[m] / mean_gain).log10(), 2.0), "{channel:?}");
            let apart = f64::from(channel.phase_mdeg - report.channels[0].phase_mdeg);
            let error = (apart / 1e3 - truth.channel_phase_rad[m].to_degrees() + 540.0).rem_euclid(360.0) - 180.0;
            assert!(error.abs() < 0.05, "{channel:?}");
            assert!((5..100).contains(&channel.phase_sigma_mdeg) && channel.clipped_ppm == 0, "{channel:?}");
        }
    }
}

/// A fault of a channel is reported with the number of that channel.
#[test]
fn what_is_wrong_with_a_channel_is_named_with_the_channel() {
    for seed in 1..=3 {
        let one = |m: usize, value: f64, others: f64| std::array::from_fn(|k| if k == m { value } else { others });
        let found = |antennas, check, channels: &[usize], words: &str| {
            assert_found(Bench::new(antennas, seed), check, channels, words);
        };
        let m = seed as usize;
        let name = |what: &str| format!("channel {} {what}", m + 1);
        let mut dead = good();
        dead.impairments.faults[m] = Fault::Dead;
        found(dead, Check::Dead, &[m], &name("dead"));
        let mut stuck = good();
        stuck.impairments.faults[m] = Fault::Stuck(-700);
        found(stuck, Check::Dead, &[m], &name("dead"));
        // It still makes noise.
        found(Antennas { channel_gain: one(m, 0.0, 1.0), ..good() }, Check::Dead, &[m], &name("dead"));
        let loud = Antennas { channel_gain: one(m, 7.0, 1.0), gain_control: false, ..good() };
        found(loud, Check::Clipped, &[m], &name("clipped"));
        found(Antennas { offset_codes: one(m, -140.0, 20.0), ..good() }, Check::Offset, &[m], &name("offset"));
        found(Antennas { channel_gain: one(m, 0.65, 1.0), ..good() }, Check::Gain, &[m], &name("gain off"));
        found(Antennas { channel_gain: one(m, 1.5, 1.0), ..good() }, Check::Gain, &[m], &name("gain off"));
        found(Antennas { snr_db: Some(5.0), amplitude_codes: 20.0, ..good() }, Check::Tone, &[], "no tone");
        found(
            Antennas { amplitude_codes: 0.0, snr_db: None, ..good() },
            Check::Dead,
            &[0, 1, 2, 3],
            "channels 1234 dead",
        );
        found(Antennas { snr_db: Some(15.0), ..good() }, Check::Noise, &[0, 1, 2, 3], "channels 1234 noisy");
    }
}

/// A noisy channel, an unsteady one and two that carry the same signal are each reported.
#[test]
fn a_noisy_an_unsteady_and_a_doubled_channel_are_named() {
    let found = |spoil: Spoil, check, channels: &[usize], words: &str| {
        for seed in 1..=3 {
            let mut bench = Bench::new(good(), seed);
            bench.spoil = spoil;
            assert_found(bench, check, channels, words);
        }
    };
    // 6 codes of noise among 2.
    let noisy: Spoil = |step, snapshot, _| {
        let mut random = Random::new(step, 3);
        for code in &mut snapshot.codes[2] {
            *code += (6.0 * random.gaussian()).round() as i16;
        }
    };
    found(noisy, Check::Noise, &[2], "channel 3 noisy");
    // By a sample every other frame: 52 degrees.
    let unsteady: Spoil = |step, snapshot, _| snapshot.codes[1].rotate_right((step % 2) as usize);
    found(unsteady, Check::Phase, &[1], "channel 2 unsteady");
    let doubled: Spoil = |_, snapshot, _| snapshot.codes[3] = snapshot.codes[0];
    found(doubled, Check::Same, &[0, 3], "channels 14 identical");
    let frozen: Spoil = |step, snapshot, last| {
        if step % 10 == 0 {
            snapshot.codes[2] = last.codes[2];
        }
    };
    found(frozen, Check::Frozen, &[2], "channel 3 frozen");
}

/// A slow sample clock is distinguished from missing frames.
#[test]
fn a_clock_that_is_slow_is_told_from_frames_that_are_left_out() {
    let mut bench = Bench::new(good(), 1);
    // 1 % slow.
    bench.step_us = 20_200;
    bench.step = bench.step * 20_000 / 20_200 + 1;
    let report = bench.self_test();
    let Verdict::Fail { check: Check::Rate, channels } = report.verdict else { unreachable!("{report:?}") };
    assert!(channels.is_none() && (report.rate_off_ppm + 9_901).abs() < 5, "{report:?}");
    assert!(bench.texts.contains(&"Foxhound: self-test: rate off".to_owned()));
    let mut bench = Bench::new(good(), 1);
    bench.step_us = 60_000;
    assert_eq!(bench.self_test().verdict, Verdict::Pass);
}

/// A frame in which a channel is frozen gives no bearing, and the next frame does.
#[test]
fn a_frame_in_which_a_channel_stands_still_gives_no_bearing_and_its_successor_does() {
    for seed in 1..=3 {
        let mut computer = HostComputer::new(&guidance::Config::default()).unwrap();
        let mut random = Random::new(seed, 1);
        let mut last = AdcFrame::zeroed();
        for step in 0..200_u64 {
            let now = Instant(step * 20_000);
            let antennas = Antennas::default();
            let mut snapshot = antennas.frame::<256>(now, &Pose::default(), [FAR_M, 0.0, 0.0], &mut random);
            let stands = step % 3 == 2;
            if stands {
                snapshot.codes[(step % 4) as usize] = last.codes[(step % 4) as usize];
            }
            last = snapshot.clone();
            let report = computer.step(now, FrontEnd::Frame(&snapshot), None, &[]).unwrap();
            assert_eq!(report.output.bearing.is_none(), stands, "step {step}");
        }
    }
}

/// The self-test is refused while the vehicle is armed, and stops when it is armed during the test.
#[test]
fn armed_it_is_refused_and_one_that_is_armed_meanwhile_is_interrupted() {
    for command in [SELF_TEST, CALIBRATE] {
        let mut bench = Bench::new(good(), 1);
        let begin_us = bench.step * bench.step_us;
        assert!(bench.autopilot.select_mode(begin_us, GUIDED) && bench.autopilot.arm(begin_us));
        bench.run(100);
        let frame = station::command(command, 0.0, 0.0);
        bench.results.clear();
        bench.step(&frame);
        bench.run(200);
        assert_eq!(bench.results, [(command, REJECTED)]);
        assert!(bench.computer.examined().is_none());

        let mut bench = Bench::new(good(), 1);
        bench.results.clear();
        bench.step(&frame);
        bench.run(20);
        let now_us = bench.step * bench.step_us;
        assert!(bench.autopilot.select_mode(now_us, GUIDED) && bench.autopilot.arm(now_us));
        bench.run(200);
        assert_eq!(bench.results, [(command, IN_PROGRESS), (command, FAILED)]);
        assert_eq!(bench.computer.examined().unwrap().verdict, Verdict::Interrupted);
        assert!(bench.texts.iter().any(|text| text.ends_with(": interrupted")), "{:?}", bench.texts);
        assert!(bench.computer.config().array.calibration.is_none());
    }
}

/// The result of `foxhound calibrate` for the same frames.
fn calibrated_by_the_command(frames: &[AdcFrame<256>], azimuth_deg: Option<f64>) -> calibrate::Report {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames.npy");
    let codes: Vec<i16> = frames.iter().flat_map(|frame| frame.codes.as_flattened().iter().copied()).collect();
    std::fs::write(&path, npy_frames(&codes, 256)).unwrap();
    let array = "wavelength_m = 0.345\nside_m = 0.138\nsample_rate_hz = 102400.0\n";
    let options = calibrate::Options { azimuth_deg, ..calibrate::Options::default() };
    calibrate::calibrate(&Recording::read(&path).unwrap(), array, &options).unwrap().1
}

/// Calibration on board equals that of `foxhound calibrate`, and bearings are correct after it.
#[test]
fn calibrated_on_board_it_is_as_the_command_calibrates_it_and_the_bearing_is_right_afterwards() {
    for (seed, azimuth_deg) in [(1, None), (2, Some(30.0)), (3, Some(-110.0))] {
        let antennas = Antennas {
            channel_gain: [1.0, 0.85, 1.12, 0.95],
            channel_phase_rad: [0.0, 0.8, -0.6, 1.2],
            positions_m: if azimuth_deg.is_some() { square(0.138) } else { [[0.0; 2]; 4] },
            ..good()
        };
        let mut bench = Bench::new(antennas, seed).heard_from(azimuth_deg.unwrap_or(0.0));
        bench.kept = Some(Vec::new());
        let report =
            bench.order(CALIBRATE, azimuth_deg.unwrap_or(0.0) as f32, f32::from(azimuth_deg.is_some())).unwrap();
        assert_eq!(report.verdict, Verdict::Pass, "{report:?}");
        assert_eq!(bench.results, [(CALIBRATE, IN_PROGRESS), (CALIBRATE, ACCEPTED)]);
        assert!(bench.texts.contains(&"Foxhound: calibrated".to_owned()), "{:?}", bench.texts);

        let kept = bench.kept.take().unwrap();
        let expected = calibrated_by_the_command(&kept[8..72], azimuth_deg);
        let table = bench.computer.config().array.calibration.unwrap();
        let [entry] = table.entries() else { unreachable!("one frequency") };
        assert!((f64::from(entry.frequency_hz) - expected.frequency_hz).abs() < 1.0);
        let phase_deg = entry.phase_rad.map(|phase_rad| f64::from(phase_rad).to_degrees());
        for m in 0..4 {
            let off_db = 20.0 * (f64::from(entry.gain[m]) / expected.gain[m]).log10();
            let off_deg = phase_deg[m] - expected.phase_deg[m];
            assert!(off_db.abs() < 0.05 && off_deg.abs() < 0.05, "channel {}: {off_db} dB, {off_deg} deg", m + 1);
            // And as the antennas are made.
            let apart = phase_deg[m] - phase_deg[0] - bench.antennas.channel_phase_rad[m].to_degrees();
            assert!(((apart + 540.0).rem_euclid(360.0) - 180.0).abs() < 0.1, "channel {}: {apart} deg", m + 1);
        }
        assert!(
            (f64::from(report.residual_mdeg) / 1e3 - expected.residual_deg).abs() < 0.02,
            "{report:?} {expected:?}"
        );

        // Handed out once, to be kept.
        let calibration = bench.computer.take_calibration().unwrap();
        assert_eq!(calibration.table, table);
        assert!(bench.computer.take_calibration().is_none());

        bench.antennas.positions_m = square(0.138);
        let mut bench = bench.heard_from(75.0);
        // Found within half a second.
        let bearing = (0..25).filter_map(|_| bench.bearing()).find(|bearing| bearing.valid).unwrap();
        assert!((f64::from(bearing.azimuth_rad) - 75_f64.to_radians()).abs() < 0.01, "{bearing:?}");
    }
}

/// Exchanged cables are reported after a calibration with a source off the nose.
#[test]
fn exchanged_cables_are_named_once_the_channels_are_calibrated_by_a_source_beside_the_nose() {
    for seed in 1..=3 {
        let mut bench = Bench::new(Antennas { channel_phase_rad: [0.0, 0.8, -0.6, 1.2], ..good() }, seed);
        assert_eq!(bench.order(CALIBRATE, 0.0, 0.0).unwrap().verdict, Verdict::Pass);
        bench.antennas.positions_m = square(0.138);
        let mut bench = bench.heard_from(30.0);
        assert_eq!(bench.order(SELF_TEST, 30.0, 1.0).unwrap().verdict, Verdict::Pass);
        // The cables of two antennas.
        bench.antennas.positions_m.swap(1, 2);
        let report = bench.order(SELF_TEST, 30.0, 1.0).unwrap();
        let Verdict::Fail { check: Check::Order, channels } = report.verdict else { unreachable!("{report:?}") };
        assert_eq!([0, 1, 2, 3].map(|m| channels.contains(m)), [false, true, true, false]);
        assert!(bench.texts.contains(&"Foxhound: self-test: channels 23 exchanged".to_owned()), "{:?}", bench.texts);
        // A splitter cannot tell.
        bench.antennas.positions_m = [[0.0; 2]; 4];
        assert_eq!(bench.self_test().verdict, Verdict::Pass);
    }
}

/// A receiver that fails the self-test is not calibrated, and its old calibration stays.
#[test]
fn a_receiver_that_fails_is_not_calibrated_and_an_old_calibration_stays() {
    let mut bench = Bench::new(good(), 1);
    assert_eq!(bench.order(CALIBRATE, 0.0, 0.0).unwrap().verdict, Verdict::Pass);
    let before = bench.computer.config().array.calibration;
    bench.computer.take_calibration();
    bench.antennas.channel_gain[2] = 0.5;
    assert!(matches!(bench.order(CALIBRATE, 0.0, 0.0).unwrap().verdict, Verdict::Fail { check: Check::Gain, .. }));
    assert_eq!(bench.results, [(CALIBRATE, IN_PROGRESS), (CALIBRATE, FAILED)]);
    assert!(bench.texts.contains(&"Foxhound: not calibrated: channel 3 gain off".to_owned()), "{:?}", bench.texts);
    assert!(before.is_some() && bench.computer.config().array.calibration == before);
    assert!(bench.computer.take_calibration().is_none());
}
