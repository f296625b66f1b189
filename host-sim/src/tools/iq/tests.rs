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
    let (repeated, extremes) = (0, None);
    let read = Samples { channels, samples, values, is_real, repeated, extremes, kind: "made".to_owned() };
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

/// The array file of `docs/hardware/radios.md`.
fn kraken() -> (Vec<[f64; 2]>, RadioArray) {
    let antennas_m = [[0.2, 0.0], [0.062, 0.190], [-0.162, 0.118], [-0.162, -0.118], [0.062, -0.190]];
    for (number, [forward, right]) in antennas_m.into_iter().enumerate() {
        // As the maker has them: clockwise, a fifth of a turn each.
        let off_deg = f64::atan2(right, forward).to_degrees() - 72.0 * number as f64;
        assert!((off_deg - 360.0 * (off_deg / 360.0).round()).abs() < 0.5, "antenna {number}");
    }
    let text = format!(
        "wavelength_m = 0.6909\nantennas_m = {antennas_m:?}\nsample_rate_hz = 2.4e6\ntone_band_hz = [-12.5e3, 12.5e3]\nsigma_floor_deg = 3.0\n"
    );
    (antennas_m.map(|xy| xy.map(|part| part / 0.6909)).to_vec(), RadioArray::parse(&text).unwrap())
}

#[test]
fn a_channel_beside_the_band_makes_no_valid_bearing() {
    let (antennas_m, array) = kraken();
    let mut rng = Rng::new(33, 0);
    for hz in [20e3, 25e3, 37.5e3, 50e3, 75e3] {
        for snr_db in [10.0, 20.0, 30.0, 40.0, 60.0] {
            let mut values = white(5, 100, &mut rng);
            add_tone(&mut values, &antennas_m, 1.3, 10.0_f64.powf(snr_db / 20.0), hz / 2.4e6);
            let lines = find(&frames(5, N, false, values), &array, 1).unwrap();
            assert!(valid(&lines) <= 1, "{hz} Hz, {snr_db} dB: {} of 100 valid", valid(&lines));
        }
    }
}

#[test]
fn a_source_is_heard_beside_another_channel() {
    let (antennas_m, array) = kraken();
    let mut rng = Rng::new(34, 0);
    for (hz, snr_db) in [(25e3, 20.0), (37.5e3, 30.0), (50e3, 30.0)] {
        let mut values = white(5, 100, &mut rng);
        add_tone(&mut values, &antennas_m, 1.3, 10.0_f64.powf(snr_db / 20.0), hz / 2.4e6);
        add_tone(&mut values, &antennas_m, -1.0, 1.0, 3e3 / 2.4e6);
        let lines = find(&frames(5, N, false, values), &array, 1).unwrap();
        assert!(valid(&lines) >= 95, "{hz} Hz, {snr_db} dB: {} of 100 valid", valid(&lines));
        for line in lines.iter().filter(|line| line.line.valid) {
            let off_deg = line.line.azimuth_deg.unwrap() + 1.0_f64.to_degrees();
            assert!(off_deg.abs() < 3.0 * line.line.sigma_deg.unwrap(), "{hz} Hz, {snr_db} dB: {line:?}");
        }
    }
}

#[test]
fn the_image_of_real_samples_bends_no_bearing() {
    let antennas_m = ring(4, 0.28);
    let mut rng = Rng::new(35, 0);
    // In bins, beside both ends of the spectrum.
    for bins in [0.3, 1.0, 2.1, 3.2, 4.0, 5.5, 8.3, 508.1, 509.0, 510.4, 511.2, 511.7] {
        let mut values = white(4, 40, &mut rng);
        values.iter_mut().for_each(|value| *value *= 0.03);
        add_tone(&mut values, &antennas_m, 0.5, 1.0, bins / N as f64);
        values.iter_mut().for_each(|value| value.im = 0.0);
        for line in find(&frames(4, N, true, values), &array(&antennas_m, ""), 1).unwrap() {
            let off_deg = line.line.azimuth_deg.unwrap_or(0.0) - 0.5_f64.to_degrees();
            let most_deg = 4.0 * line.line.sigma_deg.unwrap_or(0.0) + 0.5;
            assert!(!line.line.valid || off_deg.abs() < most_deg, "{bins} bins: {line:?}");
        }
    }
}

#[test]
fn a_tone_at_half_the_sample_rate_is_heard_around_it() {
    let antennas_m = ring(4, 0.28);
    let mut rng = Rng::new(36, 0);
    for hz in [498.5e3, -498.5e3] {
        let mut values = white(4, 20, &mut rng);
        add_tone(&mut values, &antennas_m, 0.5, 1.0, hz / 1e6);
        // The file says half the rate; the tone is at one side of it or the other.
        let lines = find(&frames(4, N, false, values), &array(&antennas_m, "tone_hz = 5e5"), 1).unwrap();
        let hears = |line: &ArrayLine| (line.line.freq_hz.unwrap() - hz).abs() < 200.0;
        assert!(valid(&lines) == 20 && lines.iter().all(hears), "{hz} Hz: {:?}", lines.first());
    }
}

/// Adds what a receiver has at 0 Hz, of another phase in each channel.
fn add_offset(values: &mut [Complex32], channels: usize, amplitude: f32) {
    for (at, channel) in values.chunks_exact_mut(N).enumerate() {
        let offset = Complex32::from_polar(amplitude, 1.9 * (at % channels) as f32);
        channel.iter_mut().for_each(|value| *value += offset);
    }
}

#[test]
fn an_offset_is_no_source_in_a_short_recording_or_beside_a_sample_that_is_no_number() {
    let antennas_m = ring(4, 0.28);
    let mut rng = Rng::new(37, 0);
    for count in [1, 2, 7, 8, 16] {
        for is_damaged in [false, true] {
            let mut values = white(4, count, &mut rng);
            add_offset(&mut values, 4, 0.3);
            if is_damaged {
                values[N + 100].re = f32::NAN;
            }
            let lines = find(&frames(4, N, false, values), &array(&antennas_m, ""), 1).unwrap();
            let found = lines.iter().filter(|line| line.line.azimuth_deg.is_some()).count();
            assert_eq!(found, 0, "{count} frames, damaged: {is_damaged}");
            assert_eq!(lines[0].line.flags.contains(&"not_finite"), is_damaged);
        }
    }
}

/// How a receiver's own offset changes over a recording, whose time goes from 0 to 1.
type Wanders = fn(f64) -> f64;

const WANDERS: [(&str, Wanders); 4] = [
    ("rises", |time| time - 0.3),
    ("steps", |time| if time < 0.42 { 1.0 } else { -0.7 }),
    ("settles", |time| (-4.0 * time).exp()),
    ("swings", |time| (3.0 * TAU * time).sin()),
];

/// Adds an offset that changes, of another phase in each channel.
fn add_wandering(values: &mut [Complex32], channels: usize, amplitude: f64, wanders: Wanders) {
    let count = (values.len() / channels) as f64;
    for (at, channel) in values.chunks_exact_mut(N).enumerate() {
        let phase = 1.9 * (at % channels) as f64;
        for (k, value) in channel.iter_mut().enumerate() {
            let time = (at / channels * N + k) as f64 / count;
            let offset = Complex64::from_polar(amplitude * wanders(time), phase);
            *value += Complex32::new(offset.re as f32, offset.im as f32);
        }
    }
}

#[test]
fn an_offset_that_wanders_is_no_source_and_hides_none_elsewhere() {
    const COUNT: usize = 20;
    let antennas_m = ring(4, 0.28);
    let mut rng = Rng::new(41, 0);
    for (name, wanders) in WANDERS {
        for amplitude in [0.1, 0.3, 1.0] {
            let mut values = white(4, COUNT, &mut rng);
            add_wandering(&mut values, 4, amplitude, wanders);
            let lines = find(&frames(4, N, false, values.clone()), &array(&antennas_m, ""), 1).unwrap();
            assert!(valid(&lines) <= 1, "{name}, {amplitude}: {} of {COUNT}", valid(&lines));
            add_tone(&mut values, &antennas_m, 0.5, 1.0, 0.2371);
            let read = frames(4, N, false, values);
            let lines = find(&read, &array(&antennas_m, ""), 1).unwrap();
            let near = |line: &&ArrayLine| (line.line.azimuth_deg.unwrap() - 0.5_f64.to_degrees()).abs() < 2.0;
            let found = lines.iter().filter(|line| line.line.valid).filter(near).count();
            assert!(found >= COUNT - 1, "{name}, {amplitude}: {found} of {COUNT}");
        }
    }
}

/// It turns from frame to frame, however slowly a sample.
#[test]
fn a_transmitter_beside_0_hz_is_no_offset_that_wanders() {
    let antennas_m = ring(4, 0.28);
    let mut rng = Rng::new(42, 0);
    for bins in [0.05, 0.1, 0.3, 0.5, 1.0, 1.02, 1.97, 2.03, 2.4, 3.02, 4.97, 8.02, 100.02] {
        for is_pulsed in [false, true] {
            let mut values = white(4, 40, &mut rng);
            let mut tone = vec![Complex32::default(); values.len()];
            add_tone(&mut tone, &antennas_m, 0.5, 10.0, bins / N as f64);
            let is_on = |frame: usize| !is_pulsed || frame % 10 < 3;
            for (at, (value, tone)) in values.iter_mut().zip(tone).enumerate() {
                *value += if is_on(at / (4 * N)) { tone } else { Complex32::default() };
            }
            let read = frames(4, N, false, values);
            assert!(!read.wanders, "{bins} bins, pulsed {is_pulsed}");
            let lines = find(&read, &array(&antennas_m, ""), 1).unwrap();
            let found = lines.iter().filter(|line| line.line.valid && is_on(line.line.frame)).count();
            let sent = (0..40).filter(|frame| is_on(*frame)).count();
            assert!(found + 1 >= sent, "{bins} bins, pulsed {is_pulsed}: {found} of {sent}");
        }
    }
}

#[test]
fn most_of_a_recording_left_out_is_warned_of() {
    let mut rng = Rng::new(38, 0);
    let mut values = white(4, 16, &mut rng);
    assert_eq!(frames(4, N, false, values.clone()).warning(), None);
    add_offset(&mut values, 4, 0.7);
    assert_eq!(frames(4, N, false, values.clone()).warning(), None);
    add_offset(&mut values, 4, 1.0);
    let text = frames(4, N, false, values).warning().unwrap();
    assert!(text.starts_with("74 % of the power are at 0 Hz"), "{text}");
}

#[test]
fn samples_that_two_frames_have_in_common_count_once() {
    const MORE: usize = 10;
    let antennas_m = ring(8, 0.5);
    let mut rng = Rng::new(39, 0);
    let mut found = 0;
    for _ in 0..150 {
        // The last frame ends with the recording.
        let recorded: Vec<_> = (0..8).map(|_| (0..N + MORE).map(|_| normal(&mut rng)).collect::<Vec<_>>()).collect();
        let values =
            [0, MORE].iter().flat_map(|from| recorded.iter().flat_map(move |all| all[*from..from + N].to_vec()));
        let mut frames = frames(8, N, false, values.collect());
        frames.repeated = N - MORE;
        found += usize::from(find(&frames, &array(&antennas_m, ""), 2).unwrap()[0].line.azimuth_deg.is_some());
    }
    assert!(found <= 1, "{found} of 150 recordings of noise have a source");
}

#[test]
fn samples_at_the_ends_of_the_range_are_flagged_and_make_no_bearing_of_three() {
    let mut rng = Rng::new(40, 0);
    for (antennas, amplitude, is_clipped) in [(3, 0.8, false), (3, 20.0, true), (5, 20.0, true)] {
        let antennas_m = ring(antennas, 0.08 * antennas as f64);
        let mut values = white(antennas, 4, &mut rng);
        values.iter_mut().for_each(|value| *value *= 0.01);
        add_tone(&mut values, &antennas_m, 0.5, amplitude, 0.2371);
        let whole = |part: f32| (128.0 * part).round().clamp(-128.0, 127.0) / 128.0;
        let values = values.iter().map(|value| Complex32::new(whole(value.re), whole(value.im))).collect();
        let extremes = Some([-1.0, 127.0 / 128.0]);
        let kind = "int8".to_owned();
        let read = Samples { channels: antennas, samples: N, values, is_real: false, repeated: 0, extremes, kind };
        for line in find(&Frames::checked(read, antennas).unwrap(), &array(&antennas_m, ""), 2).unwrap() {
            assert_eq!(line.line.flags.contains(&"clip"), is_clipped, "{line:?}");
            assert!(line.line.valid != (is_clipped && antennas == 3) || antennas > 3, "{line:?}");
        }
    }
}

#[test]
fn a_converter_of_fewer_bits_than_its_format_is_seen_to_be_clipped() {
    let mut rng = Rng::new(43, 0);
    // The codes' range, and what a code is worth in the file.
    let formats = [
        ("12 bits in 16", -2048.0, 2047.0, 1.0 / 32_768.0),
        ("12 bits in 16, the upper ones", -2048.0, 2047.0, 1.0 / 2048.0),
        ("codes as they are", -2048.0, 2047.0, 1.0),
        ("from -1 to 1", -127.5, 127.5, 1.0 / 127.5),
    ];
    for (name, least, most, scale) in formats {
        for (amplitude, is_clipped) in [(0.7, false), (3.0, true)] {
            let antennas_m = ring(4, 0.28);
            let mut values = white(4, 4, &mut rng);
            values.iter_mut().for_each(|value| *value *= 0.01);
            add_tone(&mut values, &antennas_m, 0.5, amplitude, 0.2371);
            let half: f32 = if most == 127.5 { 0.5 } else { 0.0 };
            let code = |part: f32| scale * ((most * part - half).round() + half).clamp(least, most);
            let values = values.iter().map(|value| Complex32::new(code(value.re), code(value.im))).collect();
            for line in find(&frames(4, N, false, values), &array(&antennas_m, ""), 2).unwrap() {
                assert_eq!(line.line.flags.contains(&"clip"), is_clipped, "{name}: {line:?}");
            }
        }
    }
}

/// One frame of a tone from a direction at 26 dB.
fn tone_from(antennas_m: &[[f64; 2]], azimuth_deg: f64, rng: &mut Rng) -> Vec<Complex32> {
    let mut values = white(antennas_m.len(), 1, rng);
    add_tone(&mut values, antennas_m, azimuth_deg.to_radians(), 20.0, 0.2371);
    values
}

/// Of few antennas, exchanged ones may hear what a wave from elsewhere would make them hear; always so the opposite ones of a square.
#[test]
fn most_bearings_of_exchanged_channels_are_not_valid_and_the_others_have_a_large_sigma() {
    let mut rng = Rng::new(44, 0);
    for (antennas, radius_m, exchanged) in [(4, 0.28, [0, 1]), (8, 0.48, [0, 1]), (8, 0.48, [0, 3])] {
        let antennas_m = ring(antennas, radius_m);
        let (mut count, mut wrong) = (0, 0);
        for degrees in (-180..180).step_by(5) {
            let mut values = tone_from(&antennas_m, f64::from(degrees), &mut rng);
            let [first, second] = exchanged;
            (0..N).for_each(|k| values.swap(first * N + k, second * N + k));
            let line = &find(&frames(antennas, N, false, values), &array(&antennas_m, ""), 1).unwrap()[0].line;
            let error_deg = (line.azimuth_deg.unwrap() - f64::from(degrees) + 540.0).rem_euclid(360.0) - 180.0;
            count += usize::from(line.valid);
            wrong += usize::from(line.valid && error_deg.abs() > 3.0 * line.sigma_deg.unwrap());
            assert!(!line.flags.is_empty() || error_deg.abs() < 1.0, "{degrees}: {line:?}");
        }
        assert!(count < 36 && wrong <= 4, "{antennas} {exchanged:?}: {count} of 72 valid, {wrong} beyond 3 sigma");
    }
}

/// What it hears is noise, or comes from another antenna's cable.
#[test]
fn an_antenna_that_is_not_connected_is_told_and_left_out() {
    let mut rng = Rng::new(45, 0);
    let antennas_m = ring(5, 0.35);
    for degrees in (-180..180).step_by(15) {
        for crosstalk in [None, Some(0.0), Some(1.5), Some(3.1)] {
            let mut values = tone_from(&antennas_m, f64::from(degrees), &mut rng);
            for value in &mut values[2 * N..3 * N] {
                let noise = normal(&mut rng) * 0.5_f32.sqrt();
                *value = crosstalk.map_or(noise, |phase| *value * Complex32::from_polar(0.089, phase));
            }
            let line = &find(&frames(5, N, false, values), &array(&antennas_m, ""), 1).unwrap()[0].line;
            let error_deg = (line.azimuth_deg.unwrap() - f64::from(degrees) + 540.0).rem_euclid(360.0) - 180.0;
            assert!(line.valid && error_deg.abs() < 5.0 * line.sigma_deg.unwrap(), "{degrees}: {line:?}");
            assert!((line.snr_db.unwrap() - 26.0).abs() < 1.0, "{degrees}: {line:?}");
            assert_eq!(line.flags, ["dead_3"]);
        }
    }
}
