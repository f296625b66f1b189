//! Proven properties of flying towards the loudest direction, from section III of the rotating vehicle's paper, as
//! functions that report when they do not apply; equation numbers are that paper's.
//!
//! ```text
//!     psi = (1 - s) (theta + n) + s w        eq. 2: heard direction, s = 1 with the outlier rate p
//!     x  <- x + h [cos psi, sin psi]         eq. 3: a step of length h along it
//!     eta = E[cos n]                         eq. 5: exp(-sigma^2 / 2) for Gaussian noise
//! ```
//!
//! Lemma 1: with outliers of uniform direction, the vehicle always returns to the disc of radius
//! `h / (2 (1 - p) eta)` around the source. Lemma 2: with any outliers, to `h / (2 (eta - p eta - p sqrt 2))`, if
//! `p < eta / (sqrt 2 + eta)` (eq. 6). The square root of two bounds `|x| + |y|` by `sqrt 2 r`; the worst outlier
//! points straight away from the source and costs only `r`, so both hold with 1 instead: [`Bound::Sharp`].
//!
//! Frames: the paper's angles run anticlockwise from `x`, ours clockwise from north. The model has no preferred direction,
//! so only the names change.

use foxhound_core::base::error::{ConfigError, check};

/// `E[cos n]` of Gaussian noise (eq. 5).
#[must_use]
pub fn mean_cosine(sigma_rad: f32) -> f32 {
    libm::expf(-0.5 * sigma_rad * sigma_rad)
}

/// The effect assumed for the worst outlier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bound {
    /// The paper's: `|x| + |y| <= sqrt 2 r`.
    #[default]
    Printed,
    /// What an outlier can do: `x cos w + y sin w <= r`.
    Sharp,
}

impl Bound {
    fn reach(self) -> f32 {
        match self {
            Self::Printed => core::f32::consts::SQRT_2,
            Self::Sharp => 1.0,
        }
    }
}

/// Why a lemma does not apply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Silent {
    /// `E[cos n] > 0` is false: on average the noise turns the vehicle around.
    NoiseTurnsAround,
    /// More outliers than eq. 6 allows.
    TooManyOutliers {
        /// The largest rate allowed.
        threshold: f32,
    },
}

/// Motion towards a heard direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    step_m: f32,
    outlier_rate: f32,
    mean_cosine: f32,
}

impl Motion {
    /// Steps of a length, outliers at a rate, noise with an `E[cos n]`.
    ///
    /// # Errors
    /// `lemma.step_m` outside 1e-6..=1e3, `lemma.outlier_rate` outside 0..=1, `lemma.mean_cosine` outside -1..=1.
    pub fn new(step_m: f32, outlier_rate: f32, mean_cosine: f32) -> Result<Self, ConfigError> {
        check("lemma.step_m", step_m, 1e-6, 1e3)?;
        check("lemma.outlier_rate", outlier_rate, 0.0, 1.0)?;
        check("lemma.mean_cosine", mean_cosine, -1.0, 1.0)?;
        Ok(Self { step_m, outlier_rate, mean_cosine })
    }

    /// Radius of the disc of lemma 1: outliers that point anywhere alike.
    ///
    /// # Errors
    /// The noise turns the vehicle around, or there are outliers only.
    pub fn random_outlier_radius_m(&self) -> Result<f32, Silent> {
        let pull = self.pull()?;
        if pull > 0.0 { Ok(self.step_m / (2.0 * pull)) } else { Err(Silent::TooManyOutliers { threshold: 1.0 }) }
    }

    /// Radius of the disc of lemma 2: any outliers.
    ///
    /// # Errors
    /// The noise turns the vehicle around, or there are too many outliers.
    pub fn any_outlier_radius_m(&self, bound: Bound) -> Result<f32, Silent> {
        let threshold = self.outlier_threshold(bound)?;
        let left = self.pull()? - self.outlier_rate * bound.reach();
        if self.outlier_rate < threshold && left > 0.0 {
            Ok(self.step_m / (2.0 * left))
        } else {
            Err(Silent::TooManyOutliers { threshold })
        }
    }

    /// The outlier rate below which lemma 2 holds (eq. 6).
    ///
    /// # Errors
    /// The noise turns the vehicle around.
    pub fn outlier_threshold(&self, bound: Bound) -> Result<f32, Silent> {
        self.pull()?;
        Ok(self.mean_cosine / (bound.reach() + self.mean_cosine))
    }

    /// Path over straight line, far from the source: `1 / ((1 - p) eta)`, as each step gains that much of its length.
    ///
    /// # Errors
    /// The noise turns the vehicle around, or there are outliers only.
    pub fn stretch(&self) -> Result<f32, Silent> {
        let pull = self.pull()?;
        if pull > 0.0 { Ok(1.0 / pull) } else { Err(Silent::TooManyOutliers { threshold: 1.0 }) }
    }

    /// Share of a step that goes towards the source, on average.
    fn pull(&self) -> Result<f32, Silent> {
        if self.mean_cosine > 0.0 {
            Ok((1.0 - self.outlier_rate) * self.mean_cosine)
        } else {
            Err(Silent::NoiseTurnsAround)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::PI;
    use foxhound_core::base::rng::Rng;

    fn motion(outlier_rate: f32, sigma_rad: f32) -> Motion {
        Motion::new(0.1, outlier_rate, mean_cosine(sigma_rad)).unwrap()
    }

    #[test]
    fn the_mean_cosine_is_that_of_draws() {
        let mut rng = Rng::new(2, 1);
        for sigma in [0.0_f32, 0.35, 0.4654, 1.05] {
            let n = 100_000;
            let mean = (0..n).map(|_| libm::cos(f64::from(sigma * rng.gaussian()))).sum::<f64>() / f64::from(n);
            assert!((mean - f64::from(mean_cosine(sigma))).abs() < 5.0 * 0.7 / f64::from(n).sqrt(), "{sigma} {mean}");
        }
    }

    #[test]
    fn radii_and_threshold_are_the_printed_ones() {
        // Without noise: h / (2 (1 - p)), 1 / (1 + sqrt 2), h / (2 (1 - p - p sqrt 2)).
        assert!((motion(0.5, 0.0).random_outlier_radius_m().unwrap() - 0.1).abs() < 1e-6);
        assert!((motion(0.0, 0.0).outlier_threshold(Bound::Printed).unwrap() - 0.414_213_6).abs() < 1e-6);
        assert!((motion(0.2, 0.0).any_outlier_radius_m(Bound::Printed).unwrap() - 0.096_682_4).abs() < 1e-6);
        assert!((motion(0.4, 20.0 * PI / 180.0).stretch().unwrap() - 1.771_4).abs() < 1e-3);
        assert!((motion(0.6, PI / 3.0).random_outlier_radius_m().unwrap() - 0.216_3).abs() < 1e-3);
    }

    #[test]
    fn the_lemmas_say_when_they_do_not_apply() {
        let around = Motion::new(0.1, 0.1, -0.2).unwrap();
        assert_eq!(around.random_outlier_radius_m(), Err(Silent::NoiseTurnsAround));
        assert_eq!(around.any_outlier_radius_m(Bound::Sharp), Err(Silent::NoiseTurnsAround));
        assert_eq!(motion(1.0, 0.1).stretch(), Err(Silent::TooManyOutliers { threshold: 1.0 }));
        for bound in [Bound::Printed, Bound::Sharp] {
            let threshold = motion(0.0, 0.3).outlier_threshold(bound).unwrap();
            assert!(motion(threshold - 1e-3, 0.3).any_outlier_radius_m(bound).is_ok());
            let many = motion(threshold + 1e-3, 0.3).any_outlier_radius_m(bound);
            assert_eq!(many, Err(Silent::TooManyOutliers { threshold }));
        }
        assert_eq!(Motion::new(0.1, 1.1, 0.5).unwrap_err().field, "lemma.outlier_rate");
        assert_eq!(Motion::new(f32::NAN, 0.1, 0.5).unwrap_err().field, "lemma.step_m");
    }

    #[test]
    fn inside_lemma_twos_threshold_the_worst_outlier_leaves_a_drift_towards_the_source() {
        // The drift of the proof of lemma 2 at the disc's rim is zero, by quadrature over the noise.
        for (p, sigma) in [(0.1_f32, 0.2_f32), (0.2, 0.3), (0.25, 0.0)] {
            let radius = f64::from(motion(p, sigma).any_outlier_radius_m(Bound::Sharp).unwrap());
            let (h, p, sigma) = (0.1_f64, f64::from(p), f64::from(sigma));
            let mut gain = 0.0;
            for k in -4000..=4000 {
                let z = f64::from(k) * 2e-3;
                let weight = libm::exp(-0.5 * z * z) * 2e-3 / libm::sqrt(std::f64::consts::TAU);
                let n = sigma * z;
                let after = radius * radius + h * h - 2.0 * h * radius * libm::cos(n);
                gain += weight * (1.0 - p) * (after - radius * radius);
            }
            gain += p * ((radius + h) * (radius + h) - radius * radius);
            assert!(gain.abs() < 1e-4 * h * h, "{gain:e}");
        }
    }
}
