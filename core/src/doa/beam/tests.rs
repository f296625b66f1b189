use std::vec::Vec;

use super::*;

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
