use std::vec::Vec;

use super::*;
use crate::base::rng::Rng;
use crate::base::time::Instant;
use crate::doa::bearing::Flags;

fn beam(antennas_m: &[[f32; 2]]) -> Beam {
    config(antennas_m).build().unwrap()
}

fn config(antennas_m: &[[f32; 2]]) -> Config {
    let mut all = [[0.0; 2]; ANTENNAS_MAX];
    all[..antennas_m.len()].copy_from_slice(antennas_m);
    Config { wavelength_m: 1.0, antennas_m: all, count: antennas_m.len() }
}

fn ring(count: usize, radius_m: f32) -> Vec<[f32; 2]> {
    let at = |k: usize| sin_cos(k as f32 * TAU / count as f32);
    (0..count).map(|k| [radius_m * at(k).1, radius_m * at(k).0]).collect()
}

fn covariance_of(z: &Vector) -> Covariance {
    let mut covariance = Covariance::default();
    covariance.add(z, 1.0);
    covariance
}

#[test]
fn every_direction_is_found_by_every_ring() {
    for count in 3..=8 {
        for radius_m in [0.1, 0.25, 0.08 * count as f32] {
            let beam = beam(&ring(count, radius_m));
            for degree in (-179..=180).step_by(3) {
                let azimuth_rad = (degree as f32).to_radians();
                let peak = beam.find(&covariance_of(&beam.toward(azimuth_rad))).unwrap();
                let off = wrap_pi(peak.azimuth_rad - azimuth_rad);
                assert!(libm::fabsf(off) < 2e-3 && peak.share > 0.9999, "{count} {radius_m} {degree}: {peak:?}");
            }
        }
    }
}

#[test]
fn a_line_has_a_mirror_and_a_wide_square_has_rivals() {
    let line = beam(&[[0.0, 0.0], [0.3, 0.3], [0.6, 0.6]]);
    let peak = line.find(&covariance_of(&line.toward(0.1))).unwrap();
    let sides = [peak.azimuth_rad, peak.mirror_rad.unwrap()];
    let off = |side: f32, rad: f32| libm::fabsf(side - rad);
    let is_one = |rad: f32| off(sides[0], rad).min(off(sides[1], rad)) < 2e-3;
    assert!(is_one(0.1) && is_one(TAU / 4.0 - 0.1), "{sides:?}");
    assert!(peak.ambiguities(0.1) == 0 && line.refuse_line().is_err());
    let square = beam(&ring(4, 0.25));
    assert_eq!(square.find(&covariance_of(&square.toward(0.1))).unwrap().mirror_rad, None);
    let wide = beam(&[[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]]);
    // Sides of a wavelength: the phases are those of the opposite direction at 30 deg from the normal.
    let peak = wide.find(&covariance_of(&wide.toward(TAU / 12.0))).unwrap();
    assert!(peak.ambiguities(0.1) >= 1, "{peak:?}");
}

/// Near the end of a line the maximum and its mirror image are close together. What counts is the phase of the outermost antenna.
#[test]
fn near_the_end_of_a_line_the_maximum_is_found_too() {
    for count in [3, 5, 8] {
        let antennas_m: Vec<_> = (0..count).map(|k| [0.25 * k as f32, 0.0]).collect();
        let (line, half_rad) = (beam(&antennas_m), 0.125 * TAU * (count - 1) as f32);
        for tenth in 1600..1800 {
            let azimuth_rad = (0.1 * tenth as f32).to_radians();
            let peak = line.find(&covariance_of(&line.toward(azimuth_rad))).unwrap();
            let off_rad = half_rad * (libm::cosf(peak.azimuth_rad) - libm::cosf(azimuth_rad));
            assert!(libm::fabsf(off_rad) < 2e-3, "{count} {tenth}: {off_rad} {peak:?}");
        }
    }
}

#[test]
fn bad_geometry_is_refused_by_name() {
    let refused = |antennas_m: &[[f32; 2]]| config(antennas_m).build().unwrap_err().field;
    assert_eq!(refused(&[[0.0, 0.0]]), "antennas_m");
    assert_eq!(refused(&[[0.0, 0.0], [0.0, 0.001]]), "antennas_m");
    assert_eq!(refused(&[[0.0, 0.0], [0.0, f32::NAN]]), "antennas_m");
    assert_eq!(refused(&[[0.0, 0.0], [0.0, 10.0]]), "antennas_m");
    assert_eq!(Config { wavelength_m: 0.0, ..config(&ring(4, 0.2)) }.build().unwrap_err().field, "wavelength_m");
    assert!(beam(&ring(4, 0.2)).find(&Covariance::default()).is_none());
}

/// Samples of sources in noise.
fn heard(beam: &Beam, sources: &[(f32, f32, bool)], noise: f32, count: usize, rng: &mut Rng) -> Covariance {
    let mut covariance = Covariance::default();
    for _ in 0..count {
        let mut z = Vector::default();
        let mut sent = Complex::default();
        for (azimuth_rad, amplitude, is_own) in sources {
            if *is_own {
                sent = Complex { re: rng.gaussian(), im: rng.gaussian() };
            }
            for (z, a) in z.iter_mut().zip(beam.toward(*azimuth_rad)) {
                *z = z.plus(a.times(sent).scaled(*amplitude));
            }
        }
        for z in z.iter_mut().take(beam.antennas()) {
            *z = z.plus(Complex { re: noise * rng.gaussian(), im: noise * rng.gaussian() });
        }
        covariance.add(&z, 1.0);
    }
    covariance
}

#[test]
fn one_source_is_clean_two_are_flagged_and_none_is_none() {
    let beam = beam(&ring(6, 0.45));
    let (source, mut rng) = (Source::default(), Rng::new(11, 0));
    let mut flags = |sources: &[(f32, f32, bool)]| {
        let covariance = heard(&beam, sources, 0.3, 256, &mut rng);
        source.bearing(&beam, &covariance, 0.0, Instant(0)).bearing.flags
    };
    let mut counts = [0; 4];
    for run in 0..300 {
        let azimuth_rad = run as f32 * 0.7;
        let wrong = [
            flags(&[(azimuth_rad, 1.0, true)]) != Flags::default(),
            !flags(&[(azimuth_rad, 1.0, true), (azimuth_rad + 2.0, 0.5, true)]).contains(Flags::INTERFERER),
            !flags(&[(azimuth_rad, 1.0, true), (azimuth_rad + 2.0, 0.5, false)]).contains(Flags::MULTIPATH),
            flags(&[]) != Flags::NO_SIGNAL,
        ];
        for (count, wrong) in counts.iter_mut().zip(wrong) {
            *count += i32::from(wrong);
        }
    }
    assert!(counts.iter().all(|count| *count <= 6), "{counts:?} of 300");
}

#[test]
fn what_is_no_number_has_no_bearing() {
    let (beam, source) = (beam(&ring(4, 0.25)), Source::default());
    let mut covariance = Covariance::default();
    covariance.add(&[Complex { re: f32::NAN, im: 0.0 }; ANTENNAS_MAX], 1.0);
    let bearing = source.bearing(&beam, &covariance, 0.0, Instant(0)).bearing;
    assert!(!bearing.valid && bearing.flags.contains(Flags::NOT_FINITE) && bearing.sigma_rad > 3.0);
}

#[test]
fn antennas_that_are_left_on_a_line_by_dead_ones_give_no_bearing() {
    let source = Source::default().build().unwrap();
    for (antennas_m, dead) in [(&ring(3, 0.25)[..], &[0][..]), (&ring(4, 0.25)[..], &[1, 2][..])] {
        let beam = beam(antennas_m);
        for degree in (-179_i32..=180).step_by(7) {
            let azimuth_rad = (degree as f32).to_radians();
            let mut covariance = Covariance::default();
            let mut rng = Rng::new(degree.unsigned_abs().into(), 3);
            for _ in 0..64 {
                let mut z = beam.toward(azimuth_rad);
                for (k, z) in z.iter_mut().enumerate() {
                    *z = Complex { re: z.re + 0.05 * rng.gaussian(), im: z.im + 0.05 * rng.gaussian() };
                    if k >= antennas_m.len() || dead.contains(&k) {
                        *z = Complex { re: 0.0, im: 0.0 };
                    }
                }
                covariance.add(&z, 1.0);
            }
            let arrival = source.bearing(&beam, &covariance, 0.0, Instant(0));
            let bearing = arrival.bearing;
            assert!(!bearing.valid && bearing.flags.contains(Flags::AMBIGUOUS), "{dead:?} {degree}: {bearing:?}");
        }
    }
}

#[test]
fn noise_of_channels_that_are_not_equally_loud_is_no_source() {
    for (antennas, radius_m) in [(2, 0.2), (3, 0.15), (4, 0.28), (5, 0.4), (8, 0.5)] {
        let (beam, mut rng) = (beam(&ring(antennas, radius_m)), Rng::new(12, 0));
        // The first is louder by 2 dB, or has no antenna and hears half as much.
        for gain in [1.26, 0.71] {
            let found = |_: &i32| {
                let mut covariance = Covariance::default();
                for _ in 0..512 {
                    let mut z = Vector::default();
                    for (k, z) in z.iter_mut().enumerate().take(antennas) {
                        *z = Complex { re: rng.gaussian(), im: rng.gaussian() }.scaled(if k == 0 { gain } else { 1.0 });
                    }
                    covariance.add(&z, 1.0);
                }
                let bearing = Source::default().bearing(&beam, &covariance, 0.0, Instant(0)).bearing;
                !bearing.flags.contains(Flags::NO_SIGNAL)
            };
            let count = (0..200).filter(found).count();
            assert!(count <= 2, "{antennas} antennas, {gain}: a source in {count} of 200");
        }
    }
}

#[test]
fn loud_codes_are_as_good_as_others() {
    let (beam, mut rng) = (beam(&ring(5, 0.4)), Rng::new(13, 0));
    let loud = heard(&beam, &[(0.9, 1e9, true)], 1e8, 64, &mut rng);
    let bearing = Source::default().bearing(&beam, &loud, 0.0, Instant(0)).bearing;
    assert!(bearing.valid && bearing.flags == Flags::default(), "{bearing:?}");
    assert!(libm::fabsf(bearing.azimuth_rad - 0.9) < 0.02, "{bearing:?}");
}
