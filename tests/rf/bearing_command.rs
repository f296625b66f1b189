//! `foxhound bearing`, by files, on the same waves.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_core::base::adc::AdcFrame;
use foxhound_tests::{npy, npy_frames, text};
use serde_json::Value;

use crate::other_radios::Files;
use crate::reflections::{Passage, passage};
use crate::waves::*;

/// The lines that `foxhound bearing` prints for frames.
fn lines(frames: &[AdcFrame<N>], yaws: &[f64], keys: &str, arguments: &[&str]) -> Vec<Value> {
    let files = Files::new();
    let codes: Vec<i16> = frames.iter().flat_map(|frame| frame.codes.as_flattened()).copied().collect();
    std::fs::write(files.path("adc.npy"), npy_frames(&codes, N)).unwrap();
    let values: Vec<u8> = yaws.iter().flat_map(|yaw| yaw.to_le_bytes()).collect();
    std::fs::write(files.path("yaw.npy"), npy("<f8", &format!("({},)", yaws.len()), &values)).unwrap();
    let side_m = SIDE_WAVELENGTHS * WAVELENGTH_M;
    let array = format!("wavelength_m = {WAVELENGTH_M}\nside_m = {side_m}\nsample_rate_hz = {SAMPLE_RATE_HZ}\n{keys}");
    let yaw = ["--yaw", &text(&files.path("yaw.npy"))];
    files.lines("--adc", "adc.npy", &array, &[arguments, if yaws.is_empty() { &[] } else { &yaw }].concat())
}

/// Errors of lines, in degrees and in sigmas.
fn errors_of(lines: &[Value], truth: impl Fn(usize) -> f64) -> (Vec<f64>, Vec<f64>) {
    let errors = lines.iter().enumerate().map(|(k, line)| {
        assert_eq!(line["valid"], true, "{line}");
        let error = degrees_between(line["azimuth_deg"].as_f64().unwrap().to_radians(), truth(k));
        (error, error / line["sigma_deg"].as_f64().unwrap())
    });
    errors.unzip()
}

fn turns(count: usize, make: impl Fn(f64, &mut Random) -> AdcFrame<N>) -> Vec<AdcFrame<N>> {
    let mut random = Random::new(17);
    (0..count).map(|k| make(azimuth_of(k), &mut random)).collect()
}

fn azimuth_of(frame: usize) -> f64 {
    (frame as f64).to_radians()
}

/// `foxhound bearing` is at the bound too.
#[test]
fn the_command_line_is_at_the_bound_too() {
    for (bins, snr_db) in [(37.37, 0.0), (60.25, 10.0), (37.0, 40.0)] {
        let source = Source::new(bins, snr_db);
        let frames = turns(2880, |azimuth, random| source.air(azimuth, random).codes());
        for arguments in [&[][..], &["--independent"]] {
            let answers = lines(&frames, &[], "", arguments);
            // One plane wave, less its noise; none has a range but by chance, three sigma on one side.
            let coherent = |line: &Value| line["coherence"].as_f64().is_some_and(|gamma| (0.93..=1.0).contains(&gamma));
            assert!(answers.iter().all(coherent), "{bins} {snr_db}: coherence");
            assert!(
                answers.iter().filter(|line| !line["range_hint_m"].is_null()).count() <= 14,
                "{bins} {snr_db}: ranges"
            );
            let (errors, normalised) = errors_of(&answers, azimuth_of);
            assert_eq!(errors.len(), 2880);
            assert!(rms(&errors) <= 1.10 * source.bound_deg(), "{bins} {snr_db}: {}", rms(&errors));
            let nees = rms(&normalised).powi(2);
            assert!((0.80..=1.25).contains(&nees), "{bins} {snr_db}: NEES {nees}");
        }
    }
}

/// `foxhound bearing` reports a dead channel, an interferer and silence.
#[test]
fn the_command_line_names_a_dead_channel_an_interferer_and_silence() {
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 20.0) };
    let frames = turns(360, |azimuth, random| {
        let mut frame = source.air(azimuth, random).codes();
        frame.codes[2] = [0; N];
        frame
    });
    let answers = lines(&frames, &[], "", &["--independent"]);
    assert!(answers.iter().all(|line| line["flags"] == serde_json::json!(["dead_3"])), "{}", answers[0]);
    assert!(answers.iter().all(|line| line["closure_chi2"].is_null() && line["coherence"].is_null()));
    assert!(rms(&errors_of(&answers, azimuth_of).0) <= 1.6 * source.bound_deg());

    let frames = turns(360, |azimuth, random| {
        let other = Wave { bins: 45.3, amplitude: 1265.0, ..source.wave(azimuth + 2.0, random) };
        source.air(azimuth, random).with_wave(other).codes()
    });
    let answers = lines(&frames, &[], "tone_hz = 14900\n", &["--independent"]);
    assert!(answers.iter().all(|line| line["flags"].as_array().unwrap().iter().any(|flag| flag == "interferer")));
    assert!(rms(&errors_of(&answers, azimuth_of).0) <= 0.25);

    let frames = turns(360, |_, random| Air::silence().with_noise(300.0, random).codes());
    let answers = lines(&frames, &[], "", &[]);
    let is_silent = |line: &Value| line["valid"] == false && line["azimuth_deg"].is_null();
    assert!(answers.iter().filter(|line| is_silent(line)).count() >= 359);
    assert_eq!(answers[0]["flags"], serde_json::json!(["no_signal"]));
}

/// `foxhound bearing` resolves a reflection over eight frames while moving.
#[test]
fn the_command_line_resolves_a_reflection_over_eight_looks() {
    for turning in [false, true] {
        let mut random = Random::new(18);
        let passages: Vec<Passage> = (0..250).map(|_| passage(turning, &mut random)).collect();
        let frames: Vec<_> = passages.iter().flat_map(|passage| passage.frames.clone()).collect();
        let yaws: Vec<f64> = passages.iter().flat_map(|passage| passage.yaws.clone()).collect();
        // A yaw that does not change need not be told.
        let yaws = if turning { &yaws[..] } else { &[] };
        let answers = lines(&frames, yaws, "", &["--looks", "8", "--independent"]);
        assert_eq!(answers.len(), 250);
        assert!(answers.iter().enumerate().all(|(group, line)| line["frame"] == 8 * group + 7));
        let unresolved = answers.iter().filter(|line| line["valid"] == false).count();
        assert_eq!(unresolved, 0);
        let error = |(line, passage): (&Value, &Passage)| {
            degrees_between(line["azimuth_deg"].as_f64().unwrap().to_radians(), passage.truth)
        };
        let errors: Vec<f64> = answers.iter().zip(&passages).map(error).collect();
        let (median, p90) = (quantile(&errors, 0.5), quantile(&errors, 0.9));
        assert!(median <= 1.0 && p90 <= 2.5, "turning {turning}: median {median}, p90 {p90}");
        let flagged = answers.iter().filter(|line| line["flags"].as_array().unwrap().iter().any(|f| f == "multipath"));
        assert!(flagged.count() >= 225);
    }
}

/// Looks from one place whose channels miss a plane wave by 17 deg, as those of a recorded array do, are no worse together than the
/// median of their own bearings, and within three sigma in 95 %.
#[test]
fn looks_from_one_place_are_no_worse_than_the_median_of_their_own() {
    const SCENES: usize = 120;
    let (mut random, source) = (Random::new(31), Source::new(37.37, 25.0));
    let (mut frames, mut azimuths) = (Vec::new(), Vec::new());
    for scene in 0..SCENES {
        let azimuth = scene as f64 * 2.4;
        let channel_phases = [0; 4].map(|_| 0.3 * random.normal());
        azimuths.push(azimuth);
        for _ in 0..8 {
            // Each look has a little of its own.
            let channel_phases = channel_phases.map(|phase| phase + 0.04 * random.normal());
            let silence = Air { channel_phases, ..Air::silence() };
            let air = silence.with_wave(source.wave(azimuth, &mut random));
            frames.push(air.with_noise(source.sigma(), &mut random).codes());
        }
    }
    let off = |line: &Value, scene: usize| {
        degrees_between(line["azimuth_deg"].as_f64().unwrap().to_radians(), azimuths[scene])
    };
    let alone = lines(&frames, &[], "", &["--independent"]);
    let medians: Vec<f64> = (0..SCENES)
        .map(|scene| {
            let mut own: Vec<f64> = alone[8 * scene..8 * scene + 8].iter().map(|line| off(line, scene)).collect();
            own.sort_by(f64::total_cmp);
            0.5 * (own[3] + own[4])
        })
        .collect();
    let joined = lines(&frames, &[], "", &["--independent", "--looks", "8"]);
    let errors: Vec<f64> = joined.iter().enumerate().map(|(scene, line)| off(line, scene)).collect();
    assert!(rms(&errors) <= 1.02 * rms(&medians), "{} deg, their medians {}", rms(&errors), rms(&medians));
    let sigma = |line: &Value| line["sigma_deg"].as_f64().unwrap();
    let inside = errors.iter().zip(&joined).filter(|(error, line)| error.abs() < 3.0 * sigma(line)).count();
    assert!(inside >= SCENES * 95 / 100, "{inside} of {SCENES} within three sigma");
}
