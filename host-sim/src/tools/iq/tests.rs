//! Noise that is not white and what stands beside a band, as frames in memory.

use std::f64::consts::TAU;

use foxhound_core::base::rng::Rng;

use super::*;

const N: usize = 1024;

fn ring(antennas: usize, radius_m: f64) -> Vec<[f64; 2]> {
    let at = |k: usize| (k as f64 * TAU / antennas as f64).sin_cos();
    (0..antennas).map(|k| [radius_m * at(k).1, radius_m * at(k).0]).collect()
}

/// An array with a wavelength of 1 m, at 1 MHz.
fn array(antennas_m: &[[f64; 2]], keys: &str) -> RadioArray {
    RadioArray::parse(&format!("wavelength_m = 1.0\nantennas_m = {antennas_m:?}\nsample_rate_hz = 1e6\n{keys}\n"))
        .unwrap()
}

fn frames(channels: usize, samples: usize, is_real: bool, values: Vec<Complex32>) -> Frames {
    let read = Samples { channels, samples, values, is_real, kind: "made".to_owned() };
    Frames::checked(read, channels).unwrap()
}

fn normal(rng: &mut Rng) -> Complex32 {
    Complex32::new(rng.gaussian(), rng.gaussian())
}

/// Adds a tone from a direction, of an amplitude and turning so often a sample.
fn add_tone(values: &mut [Complex32], antennas_m: &[[f64; 2]], azimuth: f64, amplitude: f64, turns: f64) {
    let samples = N * antennas_m.len();
    for (frame, values) in values.chunks_exact_mut(samples).enumerate() {
        for (channel, [x, y]) in values.chunks_exact_mut(N).zip(antennas_m) {
            let wave = x * azimuth.cos() + y * azimuth.sin();
            for (k, value) in channel.iter_mut().enumerate() {
                let (sine, cosine) = (TAU * (wave + turns * (frame * N + k) as f64)).sin_cos();
                *value += Complex32::new((amplitude * cosine) as f32, (amplitude * sine) as f32);
            }
        }
    }
}

fn white(channels: usize, count: usize, rng: &mut Rng) -> Vec<Complex32> {
    (0..count * channels * N).map(|_| normal(rng) * 0.5_f32.sqrt()).collect()
}

/// Noise in a share of the spectrum about a frequency, in turns a sample, and 40 dB below it everywhere.
fn narrow(middle: f64, share: f64, rng: &mut Rng) -> Vec<Complex32> {
    let tones = (4.0 * share * N as f64).ceil() as usize;
    let mut sum = vec![Complex64::default(); N];
    for tone in 0..tones {
        let turns = middle + share * (tone as f64 / tones as f64 - 0.5);
        let turn = Complex64::from_polar(1.0, TAU * turns);
        let part = normal(rng);
        let mut part = Complex64::new(f64::from(part.re), f64::from(part.im));
        for value in &mut sum {
            *value += part;
            part *= turn;
        }
    }
    let floor = 0.01 * (tones as f32).sqrt();
    sum.iter().map(|value| Complex32::new(value.re as f32, value.im as f32) + normal(rng) * floor).collect()
}

fn valid(lines: &[ArrayLine]) -> usize {
    lines.iter().filter(|line| line.line.valid).count()
}

#[test]
fn noise_that_a_filter_has_narrowed_is_no_source() {
    const COUNT: usize = 60;
    let mut rng = Rng::new(31, 0);
    for antennas in [2, 3, 5] {
        let antennas_m = ring(antennas, 0.08 * antennas as f64);
        for share in [0.2, 0.05, 0.03, 0.01] {
            let values: Vec<_> = (0..COUNT * antennas).flat_map(|_| narrow(0.07, share, &mut rng)).collect();
            let real = values.iter().map(|value| Complex32::new(value.re, 0.0)).collect();
            let (complex, real) = (frames(antennas, N, false, values), frames(antennas, N, true, real));
            for (what, frames, keys) in [
                ("complex samples", &complex, ""),
                ("complex samples in a band", &complex, "tone_band_hz = [-2e5, 2e5]"),
                ("real samples", &real, ""),
            ] {
                let lines = find(frames, &array(&antennas_m, keys), 1).unwrap();
                let found = lines.iter().filter(|line| line.line.azimuth_deg.is_some()).count();
                assert!(found <= 1, "{antennas} channels, {share} of the spectrum, {what}: {found} of {COUNT}");
            }
        }
    }
}

#[test]
fn the_sigma_of_a_tone_without_a_band_is_its_error() {
    let mut rng = Rng::new(32, 0);
    for (antennas, amplitude) in [(3, 1.0), (5, 1.0), (5, 10.0), (5, 100.0), (8, 30.0)] {
        let (antennas_m, mut off) = (ring(antennas, 0.08 * antennas as f64), Vec::new());
        for run in 0..5 {
            let mut values = white(antennas, 60, &mut rng);
            add_tone(&mut values, &antennas_m, 0.5, amplitude, 0.071 * f64::from(run) - 0.31);
            for line in find(&frames(antennas, N, false, values), &array(&antennas_m, ""), 1).unwrap() {
                let (azimuth, sigma) = (line.line.azimuth_deg.unwrap(), line.line.sigma_deg.unwrap());
                assert!(line.line.valid && line.line.flags.is_empty(), "{line:?}");
                off.push(((azimuth - 0.5_f64.to_degrees()) / sigma).powi(2));
            }
        }
        let nees = off.iter().sum::<f64>() / off.len() as f64;
        assert!((0.75..1.3).contains(&nees), "{antennas} channels, {amplitude}: NEES {nees}");
    }
}
