//! Accuracy of `foxhound bearing` on frames made here, in `f64`, by a wave model of their own.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::PI;

use foxhound_tests::npy_frames;
use serde_json::Value;

use crate::other_radios::Files;
use crate::waves::{N, Random, SAMPLE_RATE_HZ as FS, SIDE_WAVELENGTHS, WAVELENGTH_M as WAVELENGTH, rms};

const SIDE: f64 = SIDE_WAVELENGTHS * WAVELENGTH;

/// Frames of a source on a circle of 5 m at our height, one a degree; `snr_db` per sample, or none.
fn circle(tone_hz: f64, snr_db: Option<f64>, seed: u64) -> Vec<i16> {
    let mut random = Random::new(seed);
    let k = 2.0 * PI / WAVELENGTH;
    let amplitude = 1500.0;
    let sigma = snr_db.map_or(0.0, |snr| amplitude / (2.0 * 10f64.powf(snr / 10.0)).sqrt());
    let h = SIDE / 2.0;
    // Body forward-right: A1 front-right, A2 front-left, A3 back-left, A4 back-right.
    let antennas = [(h, h), (h, -h), (-h, -h), (-h, h)];
    let mut codes = Vec::new();
    for degree in 0..360 {
        let azimuth = f64::from(degree).to_radians();
        let start = random.turn();
        for (x, y) in antennas {
            let distance = (5.0 * azimuth.cos() - x).hypot(5.0 * azimuth.sin() - y);
            for n in 0..N {
                let phase = 2.0 * PI * tone_hz / FS * n as f64 + start - k * distance;
                let value = amplitude * phase.cos() + sigma * random.first_normal();
                codes.push(value.round().clamp(-2048.0, 2047.0) as i16);
            }
        }
    }
    codes
}

/// What `foxhound bearing` prints, line by line.
fn lines(codes: &[i16], extra: &[&str]) -> Vec<Value> {
    let files = Files::new();
    std::fs::write(files.path("adc.npy"), npy_frames(codes, N)).unwrap();
    let array = format!("wavelength_m = {WAVELENGTH}\nside_m = {SIDE}\nsample_rate_hz = {FS}\n");
    files.lines("--adc", "adc.npy", &array, extra)
}

/// Errors in degrees, and the mean of their squares over the predicted variance.
fn errors(codes: &[i16], extra: &[&str]) -> (Vec<f64>, f64) {
    let mut nees = 0.0;
    let errors: Vec<f64> = lines(codes, extra)
        .iter()
        .enumerate()
        .map(|(frame, value)| {
            assert_eq!(value["frame"], frame);
            assert_eq!(value["valid"], true, "{value}");
            let error = value["azimuth_deg"].as_f64().unwrap() - frame as f64;
            let error = (error + 180.0).rem_euclid(360.0) - 180.0;
            nees += (error / value["sigma_deg"].as_f64().unwrap()).powi(2);
            error.abs()
        })
        .collect();
    assert_eq!(errors.len(), 360);
    let nees = nees / errors.len() as f64;
    (errors, nees)
}

fn mean(errors: &[f64]) -> f64 {
    errors.iter().sum::<f64>() / errors.len() as f64
}

fn worst(errors: &[f64]) -> f64 {
    errors.iter().copied().fold(0.0, f64::max)
}

/// Without noise, on a circle of 5 m, the mean error of the bearing is at most 0.05 degrees.
#[test]
fn without_noise_the_circle_at_five_metres_is_right_to_a_twentieth_of_a_degree() {
    // On a bin and off: the paper reports 1.48 deg.
    for tone_hz in [37.0 * FS / 256.0, 37.37 * FS / 256.0] {
        for mode in [&[][..], &["--independent"][..]] {
            let (errors, _) = errors(&circle(tone_hz, None, 1), mode);
            assert!(mean(&errors) <= 0.05, "{tone_hz} {mode:?}: mean {}", mean(&errors));
            assert!(worst(&errors) <= 0.10, "{tone_hz} {mode:?}: worst {}", worst(&errors));
        }
    }
}

/// At 5 m the wave is coherent, and its curvature gives the range except near the axes.
#[test]
fn five_metres_away_the_wave_is_coherent_and_its_curvature_tells_the_range_between_the_axes() {
    let answers = lines(&circle(37.37 * FS / 256.0, Some(40.0), 5), &["--independent"]);
    let (mut hints, mut squares) = (0.0, 0.0);
    for (degree, line) in answers.iter().enumerate() {
        assert!(line["coherence"].as_f64().is_some_and(|gamma| (0.999..=1.0).contains(&gamma)), "{line}");
        // The curvature of a spherical wave shows by sin(2 azimuth): 4 % of the range on a diagonal at 40 dB.
        let slant = (2.0 * degree as f64).to_radians().sin().abs();
        if slant > 0.7 {
            let error = 5.0 / line["range_hint_m"].as_f64().unwrap() - 1.0;
            (hints, squares) = (hints + 1.0, squares + (error * slant).powi(2));
        } else if slant < 0.1 {
            assert!(line["range_hint_m"].as_f64().is_none_or(|range_m| range_m < 5.0), "{line}");
        }
    }
    let rms = (squares / hints).sqrt();
    assert!((0.03..0.05).contains(&rms), "{rms} of 1 / R over {hints} lines");
}

/// At 20 dB the error of the bearing is at most 0.16 degrees (Cramer-Rao bound: 0.142).
#[test]
fn at_twenty_decibels_the_error_is_at_the_bound() {
    // Cramer-Rao: lambda / (2 pi s sqrt(N SNR)) = 0.142 deg.
    let bound = (1.0 / (2.0 * PI * 0.40 * (256.0 * 100.0_f64).sqrt())).to_degrees();
    let mut all = Vec::new();
    let mut consistency = 0.0;
    for seed in 0..6 {
        let tone_hz = (37.0 + 0.21 * seed as f64) * FS / 256.0;
        let (errors, nees) = errors(&circle(tone_hz, Some(20.0), seed), &["--independent"]);
        assert!(worst(&errors) < 20.0);
        consistency += nees / 6.0;
        all.extend(errors);
    }
    assert!(rms(&all) <= 0.16, "rms {} against a bound of {bound}", rms(&all));
    assert!(rms(&all) >= 0.9 * bound, "better than physics: {}", rms(&all));
    assert!((0.8..=1.25).contains(&consistency), "NEES {consistency}");
}

/// The paper's own algorithm is available for comparison, and mirrors half of the circle.
#[test]
fn the_papers_algorithm_is_there_as_a_baseline_and_mirrors_half_of_the_circle() {
    let (errors, _) = errors(&circle(37.0 * FS / 256.0, None, 3), &["--estimator", "paper"]);
    let mirrored = errors.iter().filter(|e| **e > 20.0).count();
    assert!((100..=180).contains(&mirrored), "{mirrored}");
    assert!((mean(&errors) - 45.0).abs() < 3.0, "mean {}", mean(&errors));
}
