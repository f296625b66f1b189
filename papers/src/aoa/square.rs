//! Algorithm 1: the cotangent rule on the square (eq. 29-30).

use super::pair::{ACROSS, Angle, Antennas};
use super::{Outcome, azimuth};

/// Smallest sine whose cotangent is taken.
const SINE_MIN: f32 = 1e-6;

/// How Algorithm 1, lines 1-6, finds the half-plane.
#[derive(Clone, Copy)]
pub(super) enum HalfPlane {
    /// `theta1 > theta2`.
    Printed,
    /// `|theta1| > |theta2|`: the nearer pair sees the source farther to the side.
    Magnitudes,
    /// The side of A1A2 that the lags of A4 after A1 and of A3 after A2 tell.
    CrossCorrelation,
}

impl Antennas<'_> {
    /// Algorithm 1. Both angles are seen from the nose (eq. 22-23), so the second pair is A4A3.
    pub(super) fn square(&self, half_plane: HalfPlane) -> Option<Outcome> {
        let (one, two) = (self.angle([0, 1])?, self.angle([3, 2])?);
        let ahead = match half_plane {
            HalfPlane::Printed => one.sine > two.sine,
            HalfPlane::Magnitudes => libm::fabsf(one.sine) > libm::fabsf(two.sine),
            HalfPlane::CrossCorrelation => self.is_ahead(&one, &ACROSS)?,
        };
        let cotangent = |angle: &Angle| {
            let floor = if angle.sine < 0.0 { -SINE_MIN } else { SINE_MIN };
            angle.cosine() / if libm::fabsf(angle.sine) > SINE_MIN { angle.sine } else { floor }
        };
        // Eq. 30. The cotangent says left or right, the half-plane ahead or behind.
        let cotangent0 = 0.5 * (cotangent(&one) + cotangent(&two));
        let x = if ahead { libm::fabsf(cotangent0) } else { -libm::fabsf(cotangent0) };
        // With both sines clamped it is a zero, and the zero's sign is that of the sines.
        let y = libm::copysignf(1.0, cotangent0);
        Some(Outcome::Solved { azimuth_rad: azimuth([x, y])?, range_m: None })
    }
}

#[cfg(test)]
mod tests {
    use crate::aoa::waves::{distances, error_deg, plane_wave, solved, wave};
    use foxhound_core::base::rng::Rng;
    use foxhound_core::doa::array;
    use foxhound_core::doa::bearing::Estimator;
    use foxhound_core::signal::phase::Complex;
    use std::f64::consts::{PI, TAU};
    use std::vec::Vec;

    /// Eq. 29-30 in f64 from the distances alone, in the paper's frame, its answer turned into ours.
    fn rule_f64(config: &array::Config, d: [f64; 4], is_ahead: impl Fn(f64, f64) -> bool) -> f64 {
        let side = f64::from(config.antennas_m[0][1] - config.antennas_m[1][1]);
        let theta1 = ((d[0] - d[1]) / side).clamp(-1.0, 1.0).asin();
        let theta2 = ((d[3] - d[2]) / side).clamp(-1.0, 1.0).asin();
        let cotangent = 0.5 * (1.0 / theta1.tan() + 1.0 / theta2.tan());
        let angle = (1.0 / cotangent).atan();
        let theta0 = if is_ahead(theta1, theta2) { angle } else { angle.signum() * PI - angle };
        // Behind, the printed tangent leaves the sign of y: theta0 and its mirror image share it.
        -theta0
    }

    #[test]
    fn the_papers_circle_gives_the_numbers_of_an_independent_study() {
        // Noise-free, 5 m, 0.125 m wavelength, 360 directions: mean and largest error in degrees.
        let config = array::Config::square(0.125, 0.45 * 0.125);
        let run = |estimator, height_m: f64, is_ahead: &dyn Fn(f64, f64) -> bool| {
            let (mut sum, mut worst, mut apart) = (0.0, 0.0_f64, 0.0_f64);
            for step in 0..360 {
                let truth = (f64::from(step) + 0.5).to_radians();
                let d = distances(&config, truth, 5.0, height_m);
                let found = solved(estimator, &config, wave(&config, d)).azimuth_rad().unwrap();
                let error = error_deg(found, truth).abs();
                sum += error / 360.0;
                worst = worst.max(error);
                apart = apart.max(error_deg(found, rule_f64(&config, d, is_ahead)).abs());
            }
            assert!(apart < 0.01, "{estimator:?} at {height_m} m is {apart} deg from the same rule in f64");
            [sum, worst]
        };
        let printed = |one: f64, two: f64| one > two;
        let magnitudes = |one: f64, two: f64| one.abs() > two.abs();
        let near = |found: [f64; 2], mean: f64, worst: f64| {
            assert!(
                (found[0] - mean).abs() < 0.011 && (found[1] - worst).abs() < 0.06,
                "{found:?}, not {mean} {worst}"
            );
        };
        near(run(Estimator::PaperSquare, 0.0, &printed), 45.0, 179.0);
        near(run(Estimator::PaperSquare, 1.0, &printed), 47.01, 179.0);
        near(run(Estimator::PaperRepaired, 0.0, &magnitudes), 0.0, 0.0);
        near(run(Estimator::PaperRepaired, 0.5, &magnitudes), 0.635, 5.24);
        near(run(Estimator::PaperRepaired, 0.828, &magnitudes), 1.48, 8.92);
        near(run(Estimator::PaperRepaired, 1.0, &magnitudes), 2.01, 10.83);
        near(run(Estimator::PaperRepaired, 2.0, &magnitudes), 5.81, 21.31);
        // Without noise the cross-correlation finds the same half-planes.
        near(run(Estimator::PaperCorrelated, 0.828, &magnitudes), 1.48, 8.92);
        near(run(Estimator::PaperCorrelated, 2.0, &magnitudes), 5.81, 21.31);
    }

    #[test]
    fn in_noise_the_magnitudes_miss_the_half_plane_and_the_cross_correlation_does_not() {
        // The same study: 5 m, 20 dB, N = 256, 0.125 m: 49.6, 22.4 and 0.05 % wrong.
        let config = array::Config::square(0.125, 0.45 * 0.125);
        let sigma = libm::sqrtf(0.5 * 4.0 * (1000.0 * 1000.0 / 200.0) / 256.0);
        let mut rng = Rng::new(5, 0);
        let mut wrong = [0_i32; 3];
        for step in 0..8000 {
            let truth = f64::from(step) * TAU / 8000.0;
            let z = wave(&config, distances(&config, truth, 5.0, 0.0));
            let z = z.map(|c| Complex { re: c.re + sigma * rng.gaussian(), im: c.im + sigma * rng.gaussian() });
            for (count, estimator) in
                wrong.iter_mut().zip([Estimator::PaperSquare, Estimator::PaperRepaired, Estimator::PaperCorrelated])
            {
                // Where both arcsines are clamped the answer is the side itself, and in neither half.
                let found = solved(estimator, &config, z).azimuth_rad().unwrap();
                *count += i32::from(f64::from(found).cos() * truth.cos() < -1e-7);
            }
        }
        let [printed, magnitudes, correlated] = wrong.map(|count| f64::from(count) / 80.0);
        assert!((printed - 49.6).abs() < 2.0, "{printed} %");
        assert!((magnitudes - 22.4).abs() < 2.0, "{magnitudes} %");
        assert!(correlated < 0.2, "{correlated} %");
    }

    /// Errors in degrees of Algorithm 1 with the half-plane by cross-correlation, in noise of a ratio for N = 256, each beside
    /// that of the same rule in f64 with the right half-plane.
    fn in_noise(snr_db: f64, seed: u64, azimuths: impl Iterator<Item = f64>) -> Vec<[f64; 2]> {
        let config = array::Config::default();
        let side = f64::from(config.antennas_m[0][1] - config.antennas_m[1][1]);
        let wavenumber = TAU / f64::from(config.wavelength_m);
        let variance = 4.0 * (1e6 / (2.0 * 10_f64.powf(snr_db / 10.0))) / 256.0;
        let sigma = libm::sqrtf(0.5 * variance as f32);
        let mut rng = Rng::new(seed, 0);
        let one = |truth: f64| {
            let z = plane_wave(&config, truth);
            let z = z.map(|c| Complex { re: c.re + sigma * rng.gaussian(), im: c.im + sigma * rng.gaussian() });
            let phase = |m: usize| f64::from(z[m].im).atan2(f64::from(z[m].re));
            let theta = |i: usize, j: usize| {
                let lead = phase(j) - phase(i);
                (lead.sin().atan2(lead.cos()) / (wavenumber * side)).clamp(-1.0, 1.0).asin()
            };
            let cotangent = 0.5 * (1.0 / theta(0, 1).tan() + 1.0 / theta(3, 2).tan());
            // The printed cotangent is that of two directions, one to each side: its own sign is left or right.
            let rule = -1.0_f64.copysign(cotangent).atan2(cotangent.abs().copysign(truth.cos()));
            let found = solved(Estimator::PaperCorrelated, &config, z).azimuth_rad().unwrap();
            [error_deg(found, truth), error_deg(rule as f32, truth)]
        };
        azimuths.map(one).collect()
    }

    fn rms(errors: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| (sum + error * error, count + 1.0));
        (sum / count).sqrt()
    }

    #[test]
    fn in_noise_the_cotangent_rule_is_four_bounds_with_the_right_half_plane_and_singular_ahead() {
        let azimuths = |step: u32| (f64::from(step) + 0.5).to_radians();
        // The bound is 0.142 and 0.0142 deg. An independent study, random azimuths: 0.60 and 0.109 deg.
        for (snr_db, study_deg, bound_deg) in [(20.0, 0.60, 0.142), (40.0, 0.109, 0.0142)] {
            let errors = in_noise(snr_db, 6, (0..14_400).map(azimuths));
            let [ours, rule] = [0, 1].map(|k| rms(errors.iter().map(|errors| errors[k])));
            assert!((ours / rule - 1.0).abs() < 0.02, "{snr_db} dB: {ours}, in f64 {rule}");
            assert!((0.8..1.15).contains(&(ours / study_deg)), "{snr_db} dB: {ours}, not {study_deg}");
            // Between the axes the rule is at the bound of one coordinate of two.
            let oblique = errors.iter().zip(0..).filter(|(_, step)| (azimuths(*step) * 2.0).sin().abs() > 0.9);
            let oblique = rms(oblique.map(|(errors, _)| errors[0]));
            assert!(oblique < 2.0 * bound_deg, "{snr_db} dB: {oblique} far from the axes");
            assert!(errors.iter().all(|[ours, _]| ours.abs() < 90.0), "to the sides no error is half a turn");
        }
        // Exactly ahead tan theta1 + tan theta2 is noise alone. The study: rms 3.5, worst 88 deg at 20 dB.
        let errors: Vec<f64> = in_noise(20.0, 7, (0..4000).map(|_| 0.0)).iter().map(|errors| errors[0]).collect();
        let worst = errors.iter().fold(0.0_f64, |worst, error| worst.max(error.abs()));
        assert!((2.5..5.0).contains(&rms(errors.iter().copied())) && worst > 45.0, "{worst}");
    }

    #[test]
    fn with_both_arcsines_clamped_the_side_is_theirs() {
        // Noise has made the pairs' leads longer than their sides.
        let config = array::Config::default();
        for azimuth_rad in [PI / 2.0, -PI / 2.0] {
            let stretched = array::Config { wavelength_m: 0.98 * config.wavelength_m, ..config };
            let z = plane_wave(&stretched, azimuth_rad);
            for estimator in [Estimator::PaperSquare, Estimator::PaperRepaired, Estimator::PaperCorrelated] {
                let found = solved(estimator, &config, z).azimuth_rad().unwrap();
                assert!(error_deg(found, azimuth_rad).abs() < 1e-3, "{estimator:?} {azimuth_rad}: {found}");
            }
        }
    }
}
