use std::vec::Vec;

use super::*;
use crate::base::rng::Rng;

fn config(pattern: &[u8]) -> Config {
    let mut slots = [0; SLOTS_MAX];
    slots[..pattern.len()].copy_from_slice(pattern);
    let antennas = usize::from(*pattern.iter().max().unwrap());
    Config { antennas, sample_rate_hz: 2e6, tone_hz: 250e3, slot_s: 4e-6, pattern: slots, pattern_slots: pattern.len() }
}

/// A packet of antennas with these phases.
fn packet(config: &Config, phases: &[f32], offset_hz: f32, noise: f32, rng: &mut Rng) -> Vec<Complex> {
    let mut samples = Vec::new();
    for slot in 0..37 {
        let antenna = config.pattern[slot % config.pattern_slots];
        for k in 0..3 {
            let time_s = slot as f32 * config.slot_s + k as f32 / config.sample_rate_hz;
            let phase = 0.4 + TAU * fraction((config.tone_hz + offset_hz) * time_s);
            let phase = phase + antenna.checked_sub(1).map_or(0.0, |a| phases[usize::from(a)]);
            let z = Complex::at(wrap_pi(phase));
            samples.push(Complex { re: z.re + noise * rng.gaussian(), im: z.im + noise * rng.gaussian() });
        }
    }
    samples
}

#[test]
fn antennas_have_their_phases_whatever_the_offset_and_the_pattern() {
    let phases = [0.0, 1.0, -2.0, 0.5];
    let mut rng = Rng::new(1, 0);
    for pattern in [&[1, 2, 3, 4][..], &[1, 2, 1, 3, 1, 4], &[1, 1, 2, 2, 3, 3, 4, 4], &[4, 0, 3, 0, 2, 0, 1, 0]] {
        let config = config(pattern);
        let reader = config.build(37, 3).unwrap();
        for offset_hz in [0.0, 9_000.0, -41_000.0, 80_000.0] {
            let read = reader.read(&[], &packet(&config, &phases, offset_hz, 0.03, &mut rng));
            assert_eq!(read.outcome, Outcome::Tone);
            // The offset is known but for the cell.
            let offset_rad = TAU * offset_hz * config.slot_s;
            let cells = wrap_pi((offset_rad - read.offset_rad) * reader.cells() as f32);
            assert!(libm::fabsf(cells) < 0.1, "{pattern:?} {offset_hz}: {cells}");
            let cell_rad = TAU / reader.cells() as f32;
            let z = reader.moved(&read.z, nearest((offset_rad - read.offset_rad) / cell_rad));
            for (own, phase) in z.iter().zip(phases) {
                let off = wrap_pi(own.times_conj(z[0]).arg() - phase);
                assert!(libm::fabsf(off) < 0.1, "{pattern:?} {offset_hz}: {off}");
            }
            assert!((20.0..36.0).contains(&read.snr_db), "{}", read.snr_db);
        }
    }
}

#[test]
fn noise_gaps_and_damage_are_named() {
    let config = config(&[1, 2, 3, 4]);
    let reader = config.build(37, 3).unwrap();
    let mut rng = Rng::new(2, 0);
    for _ in 0..500 {
        let noise: Vec<Complex> = (0..111).map(|_| Complex { re: rng.gaussian(), im: rng.gaussian() }).collect();
        assert_eq!(reader.read(&[], &noise).outcome, Outcome::NoTone);
    }
    assert_eq!(reader.read(&[], &[Complex::default(); 111]).outcome, Outcome::NoTone);
    let mut good = packet(&config, &[0.0; 4], 0.0, 0.0, &mut rng);
    assert_eq!(reader.read(&[], &good[1..]).outcome, Outcome::Damaged);
    good[50].im = f32::NAN;
    assert_eq!(reader.read(&[], &good).outcome, Outcome::Damaged);
}

#[test]
fn a_visit_that_is_off_and_a_dead_antenna_do_not_turn_the_others() {
    let config = config(&[1, 2, 3, 4]);
    let reader = config.build(37, 3).unwrap();
    let mut rng = Rng::new(3, 0);
    let mut samples = packet(&config, &[0.0, 1.0, -2.0, 0.5], 0.0, 0.01, &mut rng);
    for sample in &mut samples[3 * 13..3 * 14] {
        *sample = sample.times(Complex::at(2.5));
    }
    for sample in samples.chunks_exact_mut(3).skip(2).step_by(4).flatten() {
        *sample = sample.scaled(0.01);
    }
    let read = reader.read(&[], &samples);
    assert_eq!((read.outcome, read.z[2]), (Outcome::Tone, Complex::default()));
    assert!(libm::fabsf(read.z[1].times_conj(read.z[0]).arg() - 1.0) < 0.03, "{:?}", read.z);
}

#[test]
fn a_schedule_is_refused_by_name() {
    let good = config(&[1, 2, 3, 4]);
    let refused = |config: Config, slots, samples| config.build(slots, samples).unwrap_err().field;
    assert_eq!(refused(Config { antennas: 1, ..good }, 37, 3), "antennas_m");
    assert_eq!(refused(Config { antennas: 5, ..good }, 37, 3), "switch.pattern");
    assert_eq!(refused(Config { antennas: 3, ..good }, 37, 3), "switch.pattern");
    assert_eq!(refused(Config { tone_hz: 1.1e6, ..good }, 37, 3), "tone_hz");
    assert_eq!(refused(Config { slot_s: f32::NAN, ..good }, 37, 3), "switch.slot_s");
    assert_eq!(refused(good, 3, 3), "switch.pattern");
    assert_eq!(refused(good, 4, 1), "slots");
    assert_eq!(refused(good, 161, 3), "slots");
    assert_eq!(refused(good, 37, 65), "samples");
}
