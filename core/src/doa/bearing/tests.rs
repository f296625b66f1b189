//! Bearings against the truth, the Cramer-Rao bound and f64.

use super::*;
use crate::base::rng::Rng;
use crate::doa::array;
use std::f64::consts::PI;

const SIDE: f64 = 0.40;

/// Phasors of a spherical outgoing wave at the default array, computed in f64, independently of the estimator.
fn wave(azimuth: f64, range_m: f64, height_m: f64) -> [Complex; 4] {
    let config = array::Config::default();
    let k = 2.0 * PI / f64::from(config.wavelength_m);
    let source = [range_m * azimuth.cos(), range_m * azimuth.sin(), height_m];
    config.antennas_m.map(|p| {
        let d =
            ((source[0] - f64::from(p[0])).powi(2) + (source[1] - f64::from(p[1])).powi(2) + height_m.powi(2)).sqrt();
        let phase = -k * d;
        Complex { re: (1000.0 * phase.cos()) as f32, im: (1000.0 * phase.sin()) as f32 }
    })
}

fn phasors(z: [Complex; 4], noise: f32) -> Phasors {
    Phasors {
        time: Instant(0),
        z,
        noise: [noise; 4],
        snr_db: 20.0,
        frequency_hz: 1.0,
        tone: Tone::Present,
        clipped: false,
        interferer: false,
    }
}

fn estimator() -> BearingEstimator {
    Config::default().build(array::Config::default().build().unwrap()).unwrap()
}

fn error_deg(found: f32, truth: f64) -> f64 {
    let difference = f64::from(found) - truth;
    difference.sin().atan2(difference.cos()).to_degrees()
}

fn noisy(z: [Complex; 4], sigma: f32, rng: &mut Rng) -> [Complex; 4] {
    z.map(|c| Complex { re: c.re + sigma * rng.gaussian(), im: c.im + sigma * rng.gaussian() })
}

#[test]
fn a_source_to_the_right_has_a_positive_azimuth_and_one_ahead_none() {
    let found = |azimuth: f64| estimator().estimate(&phasors(wave(azimuth, 50.0, 0.0), 1e-3)).azimuth_rad;
    assert!(found(0.0).abs() < 1e-3);
    assert!((found(PI / 2.0) - core::f32::consts::FRAC_PI_2).abs() < 1e-3);
    assert!((found(-PI / 4.0) + core::f32::consts::FRAC_PI_4).abs() < 1e-3);
}

#[test]
fn the_whole_circle_at_five_metres_is_exact_without_noise() {
    let estimator = estimator();
    for degree in 0..360 {
        let truth = f64::from(degree).to_radians();
        let bearing = estimator.estimate(&phasors(wave(truth, 5.0, 0.0), 1e-3));
        assert!(error_deg(bearing.azimuth_rad, truth).abs() < 0.03, "{degree}: {bearing:?}");
        assert!(bearing.valid && bearing.elevation_rad < 0.1);
    }
}

#[test]
fn noise_gives_the_predicted_sigma_and_reaches_the_bound() {
    let (estimator, mut rng) = (estimator(), Rng::new(3, 0));
    // N = 256 at 20 dB: E|dz|^2 = 4 sigma^2 / N with A^2 / (2 sigma^2) = 100.
    let noise = 4.0 * (1000.0_f32 * 1000.0 / 200.0) / 256.0;
    let bound = 1.0 / (2.0 * PI * SIDE * (256.0_f64 * 100.0).sqrt());
    let (mut squares, mut nees, mut flagged, mut chi2) = (0.0, 0.0, 0, 0.0);
    let runs = 3600;
    for run in 0..runs {
        let truth = f64::from(run).to_radians() * 0.1;
        let z = noisy(wave(truth, 500.0, 0.0), libm::sqrtf(noise / 2.0), &mut rng);
        let bearing = estimator.estimate(&phasors(z, noise));
        let error = error_deg(bearing.azimuth_rad, truth).to_radians();
        squares += error * error;
        nees += error * error / f64::from(bearing.sigma_rad).powi(2);
        chi2 += f64::from(bearing.quality.closure_chi2);
        flagged += i32::from(bearing.flags.contains(Flags::MULTIPATH));
    }
    let runs = f64::from(runs);
    let efficiency = (squares / runs).sqrt() / bound;
    assert!((0.95..1.05).contains(&efficiency), "rms over bound {efficiency}");
    assert!((0.9..1.1).contains(&(nees / runs)), "NEES {}", nees / runs);
    // One degree of freedom, of which the curvature may explain the half with its sign.
    assert!((0.4..1.1).contains(&(chi2 / runs)), "chi2 {}", chi2 / runs);
    assert!(flagged < 20, "{flagged} of {runs} clean frames called multipath");
}

#[test]
fn one_noisy_channel_counts_for_less_and_a_near_source_is_not_bent_by_unequal_weights() {
    let (estimator, mut rng) = (estimator(), Rng::new(4, 0));
    let quiet = 4.0 * (1000.0_f32 * 1000.0 / 200.0) / 256.0;
    let (mut squares, mut nees) = (0.0, 0.0);
    for run in 0..3600 {
        let truth = f64::from(run) * 0.1_f64.to_radians();
        let mut z = noisy(wave(truth, 500.0, 0.0), libm::sqrtf(quiet / 2.0), &mut rng);
        z[2] = noisy(wave(truth, 500.0, 0.0), libm::sqrtf(16.0 * quiet / 2.0), &mut rng)[2];
        let mut heard = phasors(z, quiet);
        heard.noise[2] = 16.0 * quiet;
        let bearing = estimator.estimate(&heard);
        let error = error_deg(bearing.azimuth_rad, truth);
        squares += error * error / 3600.0;
        nees += (error.to_radians() / f64::from(bearing.sigma_rad)).powi(2) / 3600.0;
    }
    // Averaging the pairs without weights gives 0.317 deg.
    assert!(squares.sqrt() < 0.22, "rms {}", squares.sqrt());
    assert!((0.9..1.1).contains(&nees), "NEES {nees}");

    for degree in 0..360 {
        let truth = f64::from(degree).to_radians();
        let mut heard = phasors(wave(truth, 5.0, 0.0), 1e-3);
        heard.noise[1] = 5e-3;
        let error = error_deg(estimator.estimate(&heard).azimuth_rad, truth);
        assert!(error.abs() < 0.03, "{degree}: {error}");
    }
}

#[test]
fn elevation_comes_from_the_wavenumber_and_does_not_bias_the_azimuth() {
    let estimator = estimator();
    for degree in (0..360).step_by(7) {
        let truth = f64::from(degree).to_radians();
        let bearing = estimator.estimate(&phasors(wave(truth, 100.0, 57.735), 1.0));
        assert!(error_deg(bearing.azimuth_rad, truth).abs() < 0.02);
        assert!((bearing.elevation_rad.to_degrees() - 30.0).abs() < 0.1, "{bearing:?}");
    }
}

#[test]
fn a_dead_channel_is_named_and_the_other_three_go_on() {
    let estimator = estimator();
    for dead in 0..4 {
        for degree in (0..360).step_by(5) {
            let truth = f64::from(degree).to_radians();
            let mut z = wave(truth, 50.0, 0.0);
            z[dead] = Complex { re: 1.0, im: 0.5 };
            let bearing = estimator.estimate(&phasors(z, 1.0));
            assert!(bearing.valid && bearing.flags == Flags::dead(dead), "{bearing:?}");
            assert!(error_deg(bearing.azimuth_rad, truth).abs() < 0.3, "{dead} {degree} {bearing:?}");
        }
    }
}

#[test]
fn channel_gains_are_taken_out_and_without_them_a_demanded_calibration_is_missed() {
    let gains = [(1.0, 0.0), (0.5, 0.9), (1.4, -2.0), (0.8, 2.9)]
        .map(|(r, phi): (f64, f64)| Complex { re: (r * phi.cos()) as f32, im: (r * phi.sin()) as f32 });
    let truth = 1.0;
    let z = core::array::from_fn(|m| wave(truth, 50.0, 0.0)[m].times(gains[m]));
    let calibrated = array::Config { channel_gain: Some(gains), require_calibration: true, ..array::Config::default() };
    let bearing = Config::default().build(calibrated.build().unwrap()).unwrap().estimate(&phasors(z, 1.0));
    assert!(bearing.valid && error_deg(bearing.azimuth_rad, truth).abs() < 0.1, "{bearing:?}");
    let demanded = array::Config { require_calibration: true, ..array::Config::default() };
    let bearing = Config::default().build(demanded.build().unwrap()).unwrap().estimate(&phasors(z, 1.0));
    assert!(!bearing.valid && bearing.flags.contains(Flags::UNCALIBRATED));
}

#[test]
fn a_reflection_that_breaks_the_closure_is_flagged_and_widens_sigma() {
    let estimator = estimator();
    let (direct, echo) = (wave(0.3, 50.0, 0.0), wave(1.9, 50.0, 0.0));
    let turn = Complex { re: 0.0, im: 0.32 };
    let z = core::array::from_fn(|m| direct[m].plus(echo[m].times(turn)));
    let bearing = estimator.estimate(&phasors(z, 40.0));
    assert!(bearing.flags.contains(Flags::MULTIPATH) && bearing.sigma_rad > 0.087, "{bearing:?}");
}

#[test]
fn a_near_source_is_not_taken_for_a_reflection() {
    let estimator = estimator();
    let mut rng = Rng::new(8, 0);
    let noise = 4.0 * (1000.0_f32 * 1000.0 / 200.0) / 256.0;
    for range in [2.5, 5.0, 20.0] {
        let mut flagged = 0;
        for run in 0..1000 {
            let z = noisy(wave(f64::from(run) * 0.1, range, 0.3), libm::sqrtf(noise / 2.0), &mut rng);
            flagged += i32::from(estimator.estimate(&phasors(z, noise)).flags.contains(Flags::MULTIPATH));
        }
        assert!(flagged < 10, "{flagged} of 1000 at {range} m");
    }
}

#[test]
fn the_range_hint_is_right_within_its_noise_from_one_to_five_metres_and_none_far_away() {
    let (estimator, mut rng) = (estimator(), Rng::new(9, 0));
    // 40 dB, N = 256.
    let noise = 4.0 * (1000.0_f32 * 1000.0 / 2e4) / 256.0;
    let steering_m = 0.40 * 0.345;
    for (range, height) in [(1.0, 0.0), (2.0, 0.0), (3.0, 0.0), (5.0, 0.0), (3.0, 2.0)] {
        let distance = f64::hypot(range, height);
        let (mut hints, mut nees, mut bias) = (0, 0.0, 0.0);
        for run in 0..3600 {
            let truth = f64::from(run) * 0.1_f64.to_radians();
            let z = noisy(wave(truth, range, height), libm::sqrtf(noise / 2.0), &mut rng);
            // The curvature of a sphere in the closure, and the noise of four phases in it.
            let bend = PI / 0.345 * (steering_m * range / distance).powi(2) * (2.0 * truth).sin().abs();
            let sigma = (4.0 * 0.5 * f64::from(noise) / 1e6).sqrt() / bend;
            let hint = estimator.estimate(&phasors(z, noise)).quality.range_hint_m;
            // Significant at three of its own sigma: always beyond seven, below that it does not matter.
            assert!(hint.is_some() || 1.0 / distance < 7.0 * sigma, "{run} at {range} m: none");
            if let Some(hint) = hint.filter(|_| 1.0 / distance > 7.0 * sigma) {
                let error = 1.0 / f64::from(hint) - 1.0 / distance;
                hints += 1;
                nees += (error / sigma).powi(2);
                bias += error * distance;
            }
        }
        assert!(hints > 2400, "{hints} at {range} m");
        let (nees, bias) = (nees / f64::from(hints), bias / f64::from(hints));
        // Nearer than 2 m the wavefront is not a paraboloid: a few thousandths, which is more than the noise.
        let nees_limit = if range < 3.0 { 4.0 } else { 1.1 };
        assert!((0.9..nees_limit).contains(&nees), "NEES {nees} at {range} m");
        assert!(bias.abs() < 0.01, "bias {bias} at {range} m");
    }
    let mut hints = 0;
    for run in 0..20_000 {
        let z = noisy(wave(f64::from(run), 5e4, 0.0), libm::sqrtf(noise / 2.0), &mut rng);
        hints += i32::from(estimator.estimate(&phasors(z, noise)).quality.range_hint_m.is_some());
    }
    // Three sigma on one side: 1.35 in a thousand.
    assert!((10..50).contains(&hints), "{hints} of 20000 far sources have a range");
    let absent = Phasors { tone: Tone::Absent, ..phasors(wave(0.7, 1.0, 0.0), noise) };
    assert_eq!(estimator.estimate(&absent).quality.range_hint_m, None);
    let demanded = array::Config { require_calibration: true, ..array::Config::default() };
    let unknown = Config::default().build(demanded.build().unwrap()).unwrap();
    let near = phasors(wave(0.7, 3.0, 0.0), noise);
    assert!(estimator.estimate(&near).quality.range_hint_m.is_some());
    assert_eq!(unknown.estimate(&near).quality.range_hint_m, None);
}

#[test]
fn the_coherence_is_one_for_one_plane_wave_on_any_array_and_less_for_two() {
    let square = array::Config::default();
    let skewed = [[0.05, 0.06], [0.07, -0.05], [-0.055, -0.06], [-0.065, 0.05]];
    let mut rng = Rng::new(10, 0);
    for config in [square, array::Config { antennas_m: skewed, ..square }] {
        let estimator = Config::default().build(config.build().unwrap()).unwrap();
        let k = 2.0 * PI / f64::from(config.wavelength_m);
        let plane = |azimuth: f64, level: f64, turn: f64| {
            config.antennas_m.map(|p| {
                let phase = turn + k * (f64::from(p[0]) * azimuth.cos() + f64::from(p[1]) * azimuth.sin());
                Complex { re: (level * phase.cos()) as f32, im: (level * phase.sin()) as f32 }
            })
        };
        // The noise of 20 dB, N = 256.
        let noise = 4.0 * (1000.0_f32 * 1000.0 / 200.0) / 256.0;
        let (mut mean, mut least) = ([0.0; 3], 1.0_f32);
        for run in 0..3600 {
            let azimuth = f64::from(run) * 0.1_f64.to_radians();
            let mut turn = || f64::from(rng.uniform()) * 2.0 * PI;
            let (direct, echo) = (plane(azimuth, 1000.0, turn()), plane(turn(), 1.0, turn()));
            // No reflection, one at -10 dB, one as strong as the direct path.
            for (sum, level) in mean.iter_mut().zip([0.0, 316.0, 1000.0]) {
                let level = Complex { re: level, im: 0.0 };
                let z = core::array::from_fn(|m| direct[m].plus(echo[m].times(level)));
                let z = noisy(z, libm::sqrtf(noise / 2.0), &mut rng);
                let Some(gamma) = estimator.estimate(&phasors(z, noise)).quality.coherence else { continue };
                assert!((0.0..=1.0).contains(&gamma));
                if config == square {
                    // The definition, in f64.
                    let [(r0, i0), (r1, i1), (r2, i2), (r3, i3)] = z.map(|z| (f64::from(z.re), f64::from(z.im)));
                    let re = r0 * r2 - i0 * i2 + r1 * r3 - i1 * i3;
                    let im = r0 * i2 + i0 * r2 + r1 * i3 + i1 * r3;
                    let power: f64 = z.iter().map(|z| f64::from(z.norm_squared())).sum();
                    assert!((f64::from(gamma) - 2.0 * re.hypot(im) / power).abs() < 1e-5, "{gamma}");
                }
                least = if level.re == 0.0 && gamma < least { gamma } else { least };
                *sum += f64::from(gamma) / 3600.0;
            }
        }
        assert!(least > 0.999, "a plane wave at 20 dB has {least}");
        assert!(mean[1] < 0.98 && mean[2] < 0.85, "{mean:?}");
    }
    let mut z = wave(0.7, 50.0, 0.0);
    z[2] = Complex { re: 1.0, im: 0.5 };
    assert_eq!(estimator().estimate(&phasors(z, 1.0)).quality.coherence, None);
}

#[test]
fn a_closure_that_is_in_doubt_beside_another_line_is_flagged_and_widens_sigma_by_its_excess() {
    let estimator = estimator();
    let noise = 400.0;
    let sigma_of = |turn: f64, interferer: bool| {
        let mut z = wave(0.0, 5e4, 0.0);
        z[0] = z[0].times(Complex { re: turn.cos() as f32, im: turn.sin() as f32 });
        let bearing = estimator.estimate(&Phasors { interferer, ..phasors(z, noise) });
        let flagged = bearing.flags.contains(Flags::MULTIPATH);
        (bearing.sigma_rad.to_degrees(), bearing.quality.closure_chi2, flagged)
    };
    // Phases of variance 2e-4, so that the closure's sigma is 0.0283 rad. Clean, doubtful, certain; alone and beside
    // a line. Doubtful means chi-square 16 (the wrong phase costs the fit some): sqrt(16 / 10.83) more.
    for (turn, alone, beside) in [(0.05, 0.323, 0.323), (0.12, 5.0, 0.392), (0.2, 5.0, 5.0)] {
        for (interferer, expected) in [(false, alone), (true, beside)] {
            let (sigma_deg, chi2, flagged) = sigma_of(turn, interferer);
            assert!((f64::from(sigma_deg) / expected - 1.0).abs() < 0.02, "{turn} {interferer}: {sigma_deg}");
            assert_eq!(flagged, chi2 > CLOSURE_LIMIT, "{turn} {interferer}");
        }
    }
}

#[test]
fn silence_overhead_and_garbage_are_never_valid_and_never_nan() {
    let estimator = estimator();
    let absent = Phasors { tone: Tone::Absent, ..phasors(wave(0.0, 50.0, 0.0), 1.0) };
    assert!(estimator.estimate(&absent).flags.contains(Flags::NO_SIGNAL));
    let overhead = estimator.estimate(&phasors(wave(0.0, 0.0, 5.0), 400.0));
    assert!(!overhead.valid && overhead.flags.contains(Flags::AMBIGUOUS), "{overhead:?}");
    let minus = estimator.estimate(&phasors(wave(0.0, 50.0, 0.0), -1e6));
    assert!(!minus.valid && minus.sigma_rad > 0.0, "{minus:?}");
    for z in [[Complex::default(); 4], [Complex { re: f32::NAN, im: f32::INFINITY }; 4]] {
        let bearing = estimator.estimate(&phasors(z, 0.0));
        assert!(!bearing.valid && bearing.azimuth_rad.is_finite() && bearing.sigma_rad > 0.0, "{bearing:?}");
    }
}

#[test]
fn the_papers_estimators_are_refused_by_name() {
    let array = array::Config::default().build().unwrap();
    let config = Config { estimator: Estimator::PaperSquare, ..Config::default() };
    assert_eq!(config.build(array).unwrap_err().field, "bearing.estimator");
}
