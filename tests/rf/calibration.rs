//! `foxhound calibrate`: uneven channels, one frame of a known bearing, and bearings at the bound after it. The frames
//! are made here, in `f64`, by a wave model of their own.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::TAU;

use foxhound_tests::{npy, npy_frames, refused, run_json, text};
use serde_json::Value;

use crate::other_radios::Files;
use crate::waves::{N, Random, SAMPLE_RATE_HZ as FS, SIDE_WAVELENGTHS, WAVELENGTH_M as WAVELENGTH};

const SIDE: f64 = SIDE_WAVELENGTHS * WAVELENGTH;

/// Four different channels; their noise is the same.
#[derive(Clone, Copy)]
struct Receiver {
    gain: [f64; 4],
    phase_deg: [f64; 4],
    skew_samples: [f64; 4],
    tone_hz: f64,
    amplitude: f64,
    snr_db: f64,
}

const UNEVEN: Receiver = Receiver {
    gain: [1.0, 0.708, 1.0, 0.85],
    phase_deg: [0.0, 47.0, -31.0, 68.0],
    skew_samples: [0.0; 4],
    tone_hz: 37.3 * FS / 256.0,
    amplitude: 1500.0,
    snr_db: 20.0,
};

/// Frames of a source far away, one an azimuth; none is a splitter.
fn frames(receiver: &Receiver, azimuths: &[Option<f64>], seed: u64) -> Vec<i16> {
    let mut random = Random::new(seed);
    let sigma = receiver.amplitude / (2.0 * 10f64.powf(receiver.snr_db / 10.0)).sqrt();
    let h = SIDE / 2.0;
    let antennas = [(h, h), (h, -h), (-h, -h), (-h, h)];
    let mut codes = Vec::new();
    for azimuth in azimuths {
        let start = random.turn();
        for (m, (x, y)) in antennas.into_iter().enumerate() {
            let nearer = azimuth.map_or(0.0, |a| x * a.cos() + y * a.sin());
            let phase = start + TAU / WAVELENGTH * nearer + receiver.phase_deg[m].to_radians();
            for n in 0..N {
                let t = (n as f64 + receiver.skew_samples[m]) / FS;
                let wave = receiver.amplitude * receiver.gain[m] * (TAU * receiver.tone_hz * t + phase).cos();
                codes.push((wave + sigma * random.first_normal()).round().clamp(-2048.0, 2047.0) as i16);
            }
        }
    }
    codes
}

fn all_around(rounds: usize) -> Vec<Option<f64>> {
    (0..360 * rounds).map(|degree| Some((degree as f64).to_radians())).collect()
}

/// A folder with an array file in it.
struct Bench(Files);

impl Bench {
    fn new(extra: &str) -> Self {
        let files = Files::new();
        files.text(
            "array.toml",
            &format!(
                "# Prototype 2\nwavelength_m = {WAVELENGTH} # 868 MHz\nside_m = {SIDE}\nsample_rate_hz = {FS}\n{extra}"
            ),
        );
        Self(files)
    }

    fn array(&self) -> String {
        std::fs::read_to_string(self.0.path("array.toml")).unwrap()
    }

    fn calibration(&self, codes: &[i16], extra: &[&str]) -> Vec<String> {
        let (adc, array) = (self.0.path("adc.npy"), self.0.path("array.toml"));
        std::fs::write(&adc, npy_frames(codes, N)).unwrap();
        let call = ["calibrate", "--adc", &text(&adc), "--array", &text(&array), "--json"];
        call.iter().chain(extra).map(|word| (*word).to_owned()).collect()
    }

    fn calibrate(&self, codes: &[i16], extra: &[&str]) -> Value {
        let call = self.calibration(codes, extra);
        let (status, report) = run_json(&call.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(status, 0);
        report
    }

    fn refuses(&self, codes: &[i16], extra: &[&str]) -> String {
        let (call, before) = (self.calibration(codes, extra), self.array());
        let said = refused(&call.iter().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(self.array(), before, "a refused calibration writes nothing");
        said
    }

    fn bearings(&self, codes: &[i16]) -> Vec<Value> {
        std::fs::write(self.0.path("adc.npy"), npy_frames(codes, N)).unwrap();
        self.0.lines("--adc", "adc.npy", &self.array(), &["--independent"])
    }
}

fn uncalibrated(line: &Value) -> bool {
    line["valid"] == false && line["flags"].as_array().unwrap().iter().any(|flag| flag == "uncalibrated")
}

/// rms error in units of the Cramer-Rao bound of equal channels, and the mean of the squared errors over their variance.
fn rms_over_bound(lines: &[Value], azimuths: &[Option<f64>], snr_db: f64) -> (f64, f64) {
    assert_eq!(lines.len(), azimuths.len());
    let (mut squares, mut nees) = (0.0, 0.0);
    for (line, truth) in lines.iter().zip(azimuths) {
        assert_eq!(line["valid"], true, "{line}");
        let error_deg = line["azimuth_deg"].as_f64().unwrap() - truth.unwrap().to_degrees();
        let error_deg = (error_deg + 180.0).rem_euclid(360.0) - 180.0;
        assert!(error_deg.abs() < 20.0, "{line}");
        squares += error_deg * error_deg;
        nees += (error_deg / line["sigma_deg"].as_f64().unwrap()).powi(2);
    }
    let bound_deg = (SIDE / WAVELENGTH * TAU * (N as f64 * 10f64.powf(snr_db / 10.0)).sqrt()).recip().to_degrees();
    let n = lines.len() as f64;
    ((squares / n).sqrt() / bound_deg, nees / n)
}

/// One frame at 40 dB calibrates uneven channels to 1.3 of the bound; before it every frame is `uncalibrated`.
#[test]
fn one_frame_at_40_db_makes_uneven_channels_good_and_before_it_every_frame_is_uncalibrated() {
    let bench = Bench::new("require_calibration = true # it flies\n");
    let azimuths = all_around(8);
    let codes = frames(&UNEVEN, &azimuths, 1);
    assert!(bench.bearings(&codes[..360 * 4 * N]).iter().all(uncalibrated));

    let known = frames(&Receiver { snr_db: 40.0, ..UNEVEN }, &[Some(0.7)], 2);
    let report = bench.calibrate(&known, &["--azimuth-deg", &0.7_f64.to_degrees().to_string()]);
    assert!((report["snr_db"].as_f64().unwrap() - 40.0).abs() < 3.0, "{report}");
    assert!((report["residual_deg"].as_f64().unwrap() - 0.04).abs() < 0.02, "{report}");
    for (m, truth_deg) in UNEVEN.phase_deg.iter().enumerate() {
        let found = report["phase_deg"][m].as_f64().unwrap() - report["phase_deg"][0].as_f64().unwrap();
        assert!((found - truth_deg).abs() < 0.3, "{report}");
    }
    let text = bench.array();
    for kept in ["# Prototype 2", "# 868 MHz", "require_calibration = true # it flies"] {
        assert!(text.contains(kept), "{text}");
    }

    let (ratio, nees) = rms_over_bound(&bench.bearings(&codes), &azimuths, 20.0);
    assert!(ratio <= 1.30, "{ratio} of the bound");
    assert!((0.8..=1.25).contains(&nees), "NEES {nees}");
    let azimuths = all_around(1);
    let codes = frames(&Receiver { snr_db: 30.0, ..UNEVEN }, &azimuths, 3);
    let (ratio, _) = rms_over_bound(&bench.bearings(&codes), &azimuths, 30.0);
    assert!(ratio <= 1.35, "{ratio} of the bound at 30 dB");
}

/// A calibration table that was changed, or is for another frequency, makes every frame `uncalibrated`.
#[test]
fn a_changed_or_foreign_table_makes_every_frame_uncalibrated() {
    let bench = Bench::new("");
    let known = frames(&Receiver { snr_db: 40.0, ..UNEVEN }, &[None; 4], 4);
    bench.calibrate(&known, &["--splitter"]);
    let (good, codes) = (bench.array(), frames(&UNEVEN, &all_around(1), 5));
    assert!(bench.bearings(&codes).iter().all(|line| line["valid"] == true));
    let elsewhere = frames(&Receiver { tone_hz: 60.25 * FS / 256.0, ..UNEVEN }, &all_around(1), 6);
    assert!(bench.bearings(&elsewhere).iter().all(uncalibrated), "a tone at another frequency");
    let silence = frames(&Receiver { amplitude: 0.1, snr_db: -60.0, ..UNEVEN }, &[None; 4], 7);
    assert!(bench.bearings(&silence).iter().all(|line| line["flags"] == serde_json::json!(["no_signal"])));
    let frequency = good.lines().find(|line| line.starts_with("frequency_hz")).unwrap();
    let other_carrier = good.replace(&format!("wavelength_m = {WAVELENGTH} #"), "wavelength_m = 0.36 #");
    assert_ne!(other_carrier, good);
    for bad in [good.replace(frequency, "frequency_hz = 14921.0"), other_carrier] {
        bench.0.text("array.toml", &bad);
        assert!(bench.bearings(&codes).iter().all(uncalibrated));
    }
}

/// Two tones give the skew of the channels, and with it 1.15 of the bound at any frequency.
#[test]
fn two_tones_tell_the_skew_and_with_it_the_bound_is_reached_at_any_frequency() {
    let bench = Bench::new("");
    let skew_samples = [0.0, 0.75, -0.75, 0.4];
    let even = Receiver { gain: [1.0; 4], skew_samples, snr_db: 40.0, ..UNEVEN };
    for (bins, seed, extra) in [(21.0, 6, &[][..]), (83.3, 7, &["--add", "--skew"])] {
        let codes = frames(&Receiver { tone_hz: bins * FS / 256.0, ..even }, &[None; 8], seed);
        let report = bench.calibrate(&codes, &[&["--splitter"], extra].concat());
        if !extra.is_empty() {
            assert_eq!(report["table_hz"].as_array().unwrap().len(), 2);
            let found = |m: usize| report["skew_s"][m].as_f64().unwrap() * FS;
            for (m, truth) in skew_samples.iter().enumerate() {
                assert!((found(m) - found(0) - truth).abs() < 0.004, "{report}");
            }
        }
    }
    let azimuths = all_around(2);
    for bins in [21.0, 48.6, 83.3] {
        let receiver = Receiver { tone_hz: bins * FS / 256.0, snr_db: 30.0, ..even };
        let (ratio, _) = rms_over_bound(&bench.bearings(&frames(&receiver, &azimuths, 8)), &azimuths, 30.0);
        assert!(ratio <= 1.15, "{ratio} of the bound at bin {bins}");
    }
}

/// A known skew of 0.75 samples costs at most 10 % of accuracy.
#[test]
fn a_configured_skew_of_three_quarters_of_a_sample_costs_nothing() {
    let skew_samples = [0.0, 0.75, -0.75, 0.4];
    let skew_s = skew_samples.map(|samples| samples / FS);
    let bench = Bench::new(&format!("skew_s = {skew_s:?}\n"));
    let azimuths = all_around(8);
    let even = Receiver { gain: [1.0; 4], phase_deg: [0.0; 4], skew_samples, snr_db: 30.0, ..UNEVEN };
    let (ratio, _) = rms_over_bound(&bench.bearings(&frames(&even, &azimuths, 9)), &azimuths, 30.0);
    assert!(ratio <= 1.10, "{ratio} of the bound");
}

/// A turn on the spot calibrates the channels, and swapped channels are reported.
#[test]
fn a_turn_on_the_spot_calibrates_and_names_swapped_channels() {
    let bench = Bench::new("");
    let yaw_rad: Vec<f64> = (0..90).map(|k| f64::from(k) * TAU / 90.0).collect();
    let yaw = bench.0.path("yaw.npy");
    let values: Vec<u8> = yaw_rad.iter().flat_map(|yaw_rad| yaw_rad.to_le_bytes()).collect();
    std::fs::write(&yaw, npy("<f8", "(90,)", &values)).unwrap();
    let azimuths: Vec<_> = yaw_rad.iter().map(|yaw_rad| Some(30_f64.to_radians() - yaw_rad)).collect();
    let mut codes = frames(&Receiver { snr_db: 30.0, ..UNEVEN }, &azimuths, 10);
    let arguments = ["--azimuth-deg", "30", "--yaw", &text(&yaw)];
    let report = bench.calibrate(&codes, &arguments);
    assert!(report["deviation_max_deg"].as_f64().unwrap() < 0.2, "there is none: {report}");
    assert!((report["phase_deg"][1].as_f64().unwrap() - report["phase_deg"][0].as_f64().unwrap() - 47.0).abs() < 0.1);

    // Of a wrong azimuth a deviation is learnt; the next calibration forgets it.
    let report = bench.calibrate(&codes, &["--azimuth-deg", "45", "--yaw", &text(&yaw)]);
    assert!(report["deviation_max_deg"].as_f64().unwrap() > 10.0 && bench.array().contains("deviation"), "{report}");
    bench.calibrate(&codes[..4 * N], &["--azimuth-deg", "30"]);
    assert!(!bench.array().contains("deviation"), "{}", bench.array());

    for frame in codes.as_chunks_mut::<{ 4 * N }>().0 {
        let (first, second) = frame.split_at_mut(2 * N);
        first[N..].swap_with_slice(&mut second[..N]);
    }
    let text = bench.refuses(&codes, &arguments);
    assert!(text.contains("channels 2 and 3 look swapped"), "{text}");
}

/// Frames and arrays that cannot be used for a calibration are refused, and the message says why.
#[test]
fn frames_and_arrays_that_will_not_do_are_refused_by_name() {
    let bench = Bench::new("");
    let good = frames(&Receiver { snr_db: 40.0, ..UNEVEN }, &[Some(0.0); 3], 11);
    let known = ["--azimuth-deg", "0"];
    let silent = frames(&Receiver { amplitude: 0.1, snr_db: -60.0, ..UNEVEN }, &[None], 12);
    let text = bench.refuses(&[&good[..], &silent].concat(), &known);
    assert!(text.contains("frame 3") && text.contains("no tone"), "{text}");
    let drifting = |k: u64| {
        frames(&Receiver { phase_deg: [0.0, 90.0 * k as f64, 0.0, 0.0], snr_db: 40.0, ..UNEVEN }, &[Some(0.0)], k)
    };
    let text = bench.refuses(&(0..8).flat_map(drifting).collect::<Vec<_>>(), &known);
    assert!(text.contains("not sampled in step"), "{text}");
    let loud = frames(&Receiver { amplitude: 2300.0, gain: [0.8, 0.8, 1.0, 0.8], ..UNEVEN }, &[None], 13);
    let text = bench.refuses(&loud, &known);
    assert!(text.contains("frame 0: channel 3 is clipped"), "{text}");
    let mut dead = good.clone();
    dead[4 * N + 3 * N..2 * 4 * N].fill(0);
    let text = bench.refuses(&dead, &known);
    assert!(text.contains("frame 1: channel 4 is dead"), "{text}");
    for options in
        [&[][..], &["--azimuth-deg", "nan"], &["--azimuth-deg", "0", "--splitter"], &["--azimuth-deg", "0", "--add"]]
    {
        let text = bench.refuses(&good, options);
        assert!(text.contains("azimuth") || text.contains("--add"), "{text}");
    }
    for (from, to, field) in [
        (format!("side_m = {SIDE}"), "side_m = 0.2".to_owned(), "side_m"),
        (format!("wavelength_m = {WAVELENGTH}"), "wavelength_m = -1".to_owned(), "wavelength_m"),
        (format!("wavelength_m = {WAVELENGTH}"), String::new(), "wavelength_m"),
    ] {
        let bench = Bench::new("");
        bench.0.text("array.toml", &bench.array().replace(&from, &to));
        let text = bench.refuses(&good, &known);
        assert!(text.contains(field), "{text}");
    }
}
