use super::*;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array::{self, Entry};
use foxhound_core::doa::calibration::Source;
use foxhound_core::signal::phase;
use std::string::ToString as _;

#[test]
fn every_verdict_has_words_of_its_own_that_fit_a_message() {
    let checks = [
        Check::Frames,
        Check::Frozen,
        Check::Dead,
        Check::Clipped,
        Check::Same,
        Check::Rate,
        Check::Offset,
        Check::Noise,
        Check::Tone,
        Check::Gain,
        Check::Phase,
        Check::Order,
    ];
    let mut said = std::vec::Vec::new();
    for exam in [Exam::SelfTest(Tone::Splitter), Exam::Calibrate { azimuth_rad: None }] {
        let mut say = |verdict| {
            let words = words(exam, verdict).to_string();
            assert!(words.len() <= 50 && !said.contains(&words), "{words}");
            said.push(words);
        };
        say(Verdict::Pass);
        say(Verdict::Interrupted);
        for check in checks {
            say(Verdict::Fail { check, channels: Channels::NONE });
            say(Verdict::Fail { check, channels: Channels::one(2) });
            say(Verdict::Fail { check, channels: Channels::which(|_| true) });
        }
    }
    // Nothing was cut off: all end as they should.
    assert!(said.iter().filter(|words| words.contains("channels 1234 ")).count() == 2 * checks.len());
    assert!(checks.iter().all(|check| said.iter().filter(|words| words.ends_with(check.words())).count() == 6));
    let dead = Verdict::Fail { check: Check::Dead, channels: Channels::one(2) };
    assert_eq!(words(Exam::SelfTest(Tone::Splitter), dead), "Foxhound: self-test: channel 3 dead");
}

#[test]
fn frames_that_do_not_come_end_it_and_one_that_runs_is_not_begun_again() {
    let mut test = SelfTest::default();
    assert!(test.report().is_none() && !test.is_running());
    test.begin(Exam::SelfTest(Tone::Board)).unwrap();
    assert!(test.wants_tone() && test.is_beginning());
    assert_eq!(test.begin(Exam::SelfTest(Tone::Splitter)), Err(Refused::Busy));
    for _ in 0..FRAMES {
        assert!(test.is_running() && test.take_ended().is_none());
        test.miss(None);
    }
    assert!(!test.is_running() && !test.wants_tone());
    let (report, entry) = test.take_ended().unwrap();
    assert_eq!(report.verdict, Verdict::Fail { check: Check::Frames, channels: Channels::NONE });
    assert!(entry.is_none() && test.take_ended().is_none());
    assert_eq!(test.report(), Some(&report));
    test.begin(Exam::SelfTest(Tone::Splitter)).unwrap();
    assert!(test.report().is_none());
}

#[test]
fn whatever_codes_come_it_ends_after_its_frames() {
    let array = array::Config::default().build().unwrap();
    let extractor = phase::Config::default().build::<N>().unwrap();
    let mut rng = foxhound_core::base::rng::Rng::new(3, 1);
    for kind in 0..6 {
        let mut test = SelfTest::default();
        test.begin(Exam::Calibrate { azimuth_rad: Some(1.0) }).unwrap();
        let mut state = phase::State::default();
        for frame in 0..FRAMES + SETTLING {
            let mut snapshot = AdcFrame { time: Instant(u64::from(frame) * 20_000), codes: [[0; N]; CHANNELS] };
            for (n, code) in snapshot.codes.iter_mut().flatten().enumerate() {
                *code = match kind {
                    0 => 0,
                    1 => i16::MAX,
                    2 => i16::MIN,
                    3 => (rng.uniform() * 65_536.0 - 32_768.0) as i16,
                    4 if n % 2 == 0 => 2047,
                    4 => -2048,
                    _ => (rng.gaussian() * 3.0) as i16,
                };
            }
            assert!(test.is_running());
            let phasors = extractor.step(&mut state, &snapshot);
            test.step(&array, 102_400.0, &snapshot, &phasors);
        }
        let (report, entry) = test.take_ended().unwrap();
        assert!(matches!(report.verdict, Verdict::Fail { .. }) && entry.is_none(), "{kind}: {report:?}");
    }
}

#[test]
fn channels_that_are_noisy_together_and_every_second_frame_missing_are_found() {
    let array = array::Config::default().build().unwrap();
    let extractor = phase::Config::default().build::<N>().unwrap();
    let noisy = |count: usize, sigma: f32| {
        let mut sigmas = [1.0; CHANNELS];
        sigmas[..count].fill(sigma);
        sigmas
    };
    let channels = |count| Channels::which(|m| m < count);
    for (sigmas, lost, verdict) in [
        (noisy(0, 1.0), 0, Verdict::Pass),
        (noisy(1, 6.0), 0, Verdict::Fail { check: Check::Noise, channels: channels(1) }),
        (noisy(2, 6.0), 0, Verdict::Fail { check: Check::Noise, channels: channels(2) }),
        (noisy(3, 18.0), 0, Verdict::Fail { check: Check::Noise, channels: channels(3) }),
        (noisy(0, 1.0), 10, Verdict::Fail { check: Check::Frames, channels: Channels::NONE }),
        (noisy(0, 1.0), 20, Verdict::Pass),
    ] {
        let (mut test, mut state) = (SelfTest::default(), phase::State::default());
        let mut rng = foxhound_core::base::rng::Rng::new(5, 1);
        test.begin(Exam::SelfTest(Tone::Splitter)).unwrap();
        for frame in 0_u64.. {
            if !test.is_running() {
                break;
            }
            // One of two, or one of eight.
            if lost == 10 && frame % 2 == 1 || lost == 20 && frame % 8 == 1 {
                test.miss(None);
                continue;
            }
            let mut snapshot = AdcFrame { time: Instant(frame * 20_000), codes: [[0; N]; CHANNELS] };
            for (row, sigma) in snapshot.codes.iter_mut().zip(sigmas) {
                for (n, code) in row.iter_mut().enumerate() {
                    let turns = 41.0 * n as f32 / N as f32;
                    *code = (322.0 * (core::f32::consts::TAU * turns).cos() + sigma * rng.gaussian()).round() as i16;
                }
            }
            let phasors = extractor.step(&mut state, &snapshot);
            test.step(&array, 102_400.0, &snapshot, &phasors);
        }
        assert_eq!(test.take_ended().unwrap().0.verdict, verdict, "{sigmas:?} {lost}");
    }
}

/// A source ahead, with exchanged cables; the last frame is of no use.
#[test]
fn exchanged_cables_are_found_whatever_the_last_frame_holds() {
    const BIN: f32 = 41.0;
    let frequency_hz = BIN * 102_400.0 / N as f32;
    let config = array::Config::default();
    let entry = Entry { frequency_hz, gain: [1.0; CHANNELS], ..Entry::default() };
    let table = array::Table::new(config.wavelength_m, &[entry]).unwrap();
    let array = array::Config { calibration: Some(table), ..config }.build().unwrap();
    let extractor = phase::Config::default().build::<N>().unwrap();
    let azimuth_rad = 0.4;
    let expected = Source::ahead_at(azimuth_rad).phasors(&array);
    let exchanged = Verdict::Fail { check: Check::Order, channels: Channels::one(0).and(1) };
    for (order, verdict) in [([0, 1, 2, 3], Verdict::Pass), ([1, 0, 2, 3], exchanged)] {
        for last_bin in [BIN, 0.0, 67.0] {
            let (mut test, mut state) = (SelfTest::default(), phase::State::default());
            let mut rng = foxhound_core::base::rng::Rng::new(5, 1);
            test.begin(Exam::SelfTest(Tone::Ahead { azimuth_rad })).unwrap();
            for frame in 1..=u64::from(FRAMES + SETTLING) {
                let bin = if frame < u64::from(FRAMES + SETTLING) { BIN } else { last_bin };
                let mut snapshot = AdcFrame { time: Instant(frame * 20_000), codes: [[0; N]; CHANNELS] };
                for (row, m) in snapshot.codes.iter_mut().zip(order) {
                    for (n, code) in row.iter_mut().enumerate() {
                        let turns = bin * n as f32 / N as f32;
                        let angle_rad = core::f32::consts::TAU * turns + expected[m].arg();
                        let tone = if bin > 0.0 { 322.0 * angle_rad.cos() } else { 0.0 };
                        *code = (tone + rng.gaussian()).round() as i16;
                    }
                }
                let phasors = extractor.step(&mut state, &snapshot);
                test.step(&array, 102_400.0, &snapshot, &phasors);
            }
            assert_eq!(test.take_ended().unwrap().0.verdict, verdict, "{order:?} {last_bin}");
        }
    }
}
