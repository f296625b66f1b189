//! The estimators of the main paper, literally: the baselines that ours is compared with.
//!
//! Equation numbers are the main paper's. Its frame is used inside: `x` forward, `y` left, angles anticlockwise,
//! antennas A1 `(d, -d)`, A2 `(d, d)`, A3 `(-d, d)`, A4 `(-d, -d)` on the square (eq. 18-19), in metres from their
//! centroid. The output is in our frame: azimuth clockwise from the nose.
//!
//! | [`Estimator`] | source | method |
//! |---|---|---|
//! | `Pair` | eq. 2 | the arcsine of A1A2; its side by cross-correlation with A4 and A3 |
//! | `PaperSquare` | eq. 29-30, Algorithm 1 | the cotangent rule; half-plane where `theta1 > theta2`, as printed |
//! | `PaperRepaired` | the same | half-plane where `abs theta1 > abs theta2`, as meant |
//! | `PaperCorrelated` | the same | half-plane by cross-correlation, the alternative that section II-B names |
//! | `TwoArray` | eq. 6-17, 50, appendix B | the intersection of the directions of A1A2 and A3A4; any positions |
//! | `ThreeAntenna` | eq. 51 | the same with A2 = A3 |
//!
//! **Eq. 2.** A pair `i j` hears `sin theta = phi lambda / (2 pi |r_j - r_i|)`, where `phi` is the lead of `j` over `i` and
//! `theta` is seen from the pair's normal. Outside its domain the sine is clamped to 1. The arcsine cannot tell the two
//! sides of the pair apart: the source is at `s = sin theta e + cos theta n` or at its mirror image, `e` along the pair
//! and `n` across it.
//!
//! **Cross-correlation.** "Which antenna receives the signal first": the lag between the pair and the others, less what
//! `theta` explains, has the sign of `cos theta`. On the square it is the sign of the lag of A4 after A1 and A3 after A2.
//!
//! **Outcomes.** What a system of equations can do is an [`Outcome`]. A bearing keeps the azimuth of every outcome that
//! has one, but is `valid` only where the paper gives a direction to fly: `Solved`, and both singular cases, of which
//! eq. 50 says that either direction will do. `NegativeScale` and `Undefined` are `AMBIGUOUS`.
//!
//! **In noise**, eq. 30 costs four bounds at 20 dB and seven at 40 dB (N = 256, square of 0.40 wavelength: 0.58 and 0.10 deg
//! rms around the circle), though the cross-correlation gives it the right half-plane. Away from the axes it has the bound
//! of one of the two coordinates; to the sides the arcsine is steep and leaves its domain; straight ahead, where
//! `tan theta1 + tan theta2` is noise alone, any angle comes out: 3.5 deg rms and up to 90 at 20 dB.
//!
//! The paper has no measure of its errors. Sigma, closure, elevation and flags of a bearing are those of our wavefront
//! fit: what the array allows, and less than what these estimators make of it. They assume a source at our height, lose
//! precision as `1 / cos theta` to the sides, and the crossings have `det A ~ s sin(beta) / R`, which vanishes with range.

use foxhound_core::base::adc::CHANNELS;
use foxhound_core::base::error::{ConfigError, Why};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::doa::array::Array;
use foxhound_core::doa::bearing::{Bearing, BearingEstimator, Config, Direction, Estimator};
use foxhound_core::signal::phase::{Complex, Phasors};

mod crossing;
mod pair;
mod positions;
mod square;
#[cfg(test)]
mod waves;

pub use positions::is_square;

use pair::Antennas;
use square::HalfPlane;

/// Shortest pair, and least distance between midpoints, in radians of phase.
const PAIR_MIN_RAD: f32 = 1e-3;

/// What an estimator of the paper arrived at. Azimuths are from the nose, clockwise positive, (-pi, pi].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// A direction; with its range where the directions of several pairs cross (eq. 17).
    Solved {
        /// Direction of the source.
        azimuth_rad: f32,
        /// Its distance from the centroid of the antennas.
        range_m: Option<f32>,
    },
    /// `det A = 0` and no solution: parallel directions, the source is far away (eq. 50).
    AtInfinity {
        /// Direction of A1A2.
        azimuth_rad: f32,
    },
    /// `det A = 0` and any number of solutions: the source is in line with the midpoints of the pairs (eq. 50).
    Collinear {
        /// Direction of A1A2.
        azimuth_rad: f32,
    },
    /// The directions diverge and cross behind a pair (appendix B): no source does this, noise does.
    NegativeScale {
        /// Direction of A1A2, not of the crossing.
        azimuth_rad: f32,
    },
    /// No direction: a pair has a dead antenna or no length, or the pairs contradict each other.
    Undefined,
}

impl Outcome {
    /// The azimuth, where there is one.
    #[must_use]
    pub fn azimuth_rad(self) -> Option<f32> {
        match self {
            Self::Solved { azimuth_rad, .. }
            | Self::AtInfinity { azimuth_rad }
            | Self::Collinear { azimuth_rad }
            | Self::NegativeScale { azimuth_rad } => Some(azimuth_rad),
            Self::Undefined => None,
        }
    }

    /// Whether the paper would fly there.
    #[must_use]
    pub fn is_usable(self) -> bool {
        matches!(self, Self::Solved { .. } | Self::AtInfinity { .. } | Self::Collinear { .. })
    }
}

/// An estimator of the paper, or the core's own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnyEstimator(Estimator);

impl AnyEstimator {
    /// The estimator that a configuration names, for an array.
    ///
    /// # Errors
    /// `bearing.estimator` when it needs the paper's square and the array, whose longest side in wavelengths is the value, is
    /// another.
    pub fn build(config: &Config, array: &Array) -> Result<Self, ConfigError> {
        let needs_square =
            matches!(config.estimator, Estimator::PaperSquare | Estimator::PaperRepaired | Estimator::PaperCorrelated);
        if needs_square && !is_square(array) {
            let why = Why::Inconsistent("the cotangent rule is valid for the square A1 A2 A3 A4 only");
            return Err(ConfigError { field: "bearing.estimator", value: array.side_wavelengths, why });
        }
        Ok(Self(config.estimator))
    }

    /// The bearing that a set of phasors tells. `estimator` is the core's own, for the same array.
    #[must_use]
    pub fn estimate(self, estimator: &BearingEstimator, phasors: &Phasors) -> Bearing {
        if self.0 == Estimator::CrossSpectrum {
            return estimator.estimate(phasors);
        }
        estimator.find_with(phasors, |array, z, living| {
            let outcome = solve(self.0, array, z, living).unwrap_or(Outcome::Undefined);
            Direction { azimuth_rad: outcome.azimuth_rad(), is_usable: outcome.is_usable() }
        })
    }
}

/// An estimator with the one that flies, for the same array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnyBearingEstimator {
    flown: BearingEstimator,
    estimator: AnyEstimator,
}

impl AnyBearingEstimator {
    /// Checks the configuration and joins it with the array.
    ///
    /// # Errors
    /// The field that is refused.
    pub fn build(config: &Config, array: Array) -> Result<Self, ConfigError> {
        let flown = own(config).build(array)?;
        Ok(Self { flown, estimator: AnyEstimator::build(config, &array)? })
    }

    /// The array that this estimator listens with.
    #[must_use]
    pub fn array(&self) -> &Array {
        self.flown.array()
    }

    /// The bearing that a set of phasors tells; never NaN, `valid` only when it may be used.
    #[must_use]
    pub fn estimate(&self, phasors: &Phasors) -> Bearing {
        self.estimator.estimate(&self.flown, phasors)
    }
}

/// The same configuration with the core's own estimator.
#[must_use]
pub fn own(config: &Config) -> Config {
    Config { estimator: Estimator::CrossSpectrum, ..*config }
}

/// Runs an estimator of the paper on phasors that are corrected for their channels' gains; `None` for one that is not the
/// paper's.
#[must_use]
#[inline(never)]
pub fn solve(
    estimator: Estimator,
    array: &Array,
    z: &[Complex; CHANNELS],
    living: [bool; CHANNELS],
) -> Option<Outcome> {
    let antennas = Antennas::new(array, z, living);
    let outcome = match estimator {
        Estimator::CrossSpectrum => return None,
        Estimator::Pair => antennas.pair(),
        Estimator::PaperSquare => antennas.square(HalfPlane::Printed),
        Estimator::PaperRepaired => antennas.square(HalfPlane::Magnitudes),
        Estimator::PaperCorrelated => antennas.square(HalfPlane::CrossCorrelation),
        Estimator::TwoArray => antennas.two_arrays(),
        Estimator::ThreeAntenna => antennas.three_antennas(),
        Estimator::NArray => antennas.all_neighbours(),
    };
    Some(outcome.unwrap_or(Outcome::Undefined))
}

/// The door out: anticlockwise with `y` to the left becomes clockwise; `None` for no direction.
fn azimuth([x, y]: [f32; 2]) -> Option<f32> {
    let angle_rad = wrap_pi(libm::atan2f(-y, x));
    (angle_rad.is_finite() && (x != 0.0 || y != 0.0)).then_some(angle_rad)
}

fn subtract(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

fn length(a: [f32; 2]) -> f32 {
    sqrt(dot(a, a))
}

#[cfg(test)]
mod tests {
    use super::waves::{SKEWED, distances, error_deg, estimator, phasors, solved, wave, with};
    use super::*;
    use foxhound_core::doa::array;
    use foxhound_core::doa::bearing::{Bearing, Flags};
    use std::vec::Vec;

    #[test]
    fn the_pair_and_the_crossings_find_a_near_source_on_any_array_and_the_crossings_its_range() {
        let square = array::Config::default();
        for (config, estimator, azimuth_deg, range_part) in [
            // The pair's direction is from its own midpoint, half a side ahead of the centroid.
            (square, Estimator::Pair, 0.85, 0.0),
            (square, Estimator::TwoArray, 0.02, 0.01),
            (square, Estimator::ThreeAntenna, 0.05, 0.05),
            (square, Estimator::NArray, 0.02, 0.05),
            (with(SKEWED), Estimator::Pair, 0.85, 0.0),
            (with(SKEWED), Estimator::TwoArray, 0.15, 0.05),
            (with(SKEWED), Estimator::ThreeAntenna, 0.15, 0.05),
            (with(SKEWED), Estimator::NArray, 0.15, 0.05),
        ] {
            let side = |n: usize| (config.antennas_m[n % 4], config.antennas_m[(n + 1) % 4]);
            let line = |a: [f32; 2], b: [f32; 2]| f64::from(b[1] - a[1]).atan2(f64::from(b[0] - a[0]));
            let middle = |n: usize| [side(n).0[0] + side(n).1[0], side(n).0[1] + side(n).1[1]];
            let mut bad: Vec<f64> = (0..4).map(|n| line(side(n).0, side(n).1)).collect();
            bad.extend([(0, 1), (0, 2), (1, 2), (1, 3), (2, 3), (3, 0)].map(|(n, m)| line(middle(n), middle(m))));
            let mut answered = 0;
            for step in 0..360 {
                let truth = (f64::from(step) + 0.5).to_radians();
                let d = distances(&config, truth, 5.0, 0.0);
                // To the sides of a pair the arcsine is steep, in line with the midpoints the crossing is grazing.
                if bad.iter().any(|line| (truth - line).cos().abs() > 0.985) {
                    continue;
                }
                answered += 1;
                let outcome = solved(estimator, &config, wave(&config, d));
                let Outcome::Solved { azimuth_rad, range_m } = outcome else {
                    panic!("{estimator:?} {step}: {outcome:?}")
                };
                assert!(error_deg(azimuth_rad, truth).abs() < azimuth_deg, "{estimator:?} {step}: {outcome:?}");
                assert_eq!(range_m.is_some(), range_part > 0.0);
                let range_m = f64::from(range_m.unwrap_or(5.0));
                assert!((range_m / 5.0 - 1.0).abs() <= range_part, "{estimator:?} {step}: {outcome:?}");
            }
            assert!(answered > 80, "{answered}");
        }
    }

    #[test]
    fn three_antennas_go_on_with_the_three_that_live_and_the_others_say_that_they_cannot() {
        let config = array::Config::default();
        for dead in 0..4 {
            for step in 0..36 {
                let truth = (f64::from(step) * 10.0 + 7.0).to_radians();
                let mut z = wave(&config, distances(&config, truth, 5.0, 0.0));
                z[dead] = Complex { re: 1.0, im: 0.5 };
                let found = |kind| estimator(kind, &config).estimate(&phasors(z, 1.0));
                let three: Bearing = found(Estimator::ThreeAntenna);
                assert!(three.flags.contains(Flags::dead(dead)));
                assert!(error_deg(three.azimuth_rad, truth).abs() < 2.0, "{dead} {step} {three:?}");
                let square = found(Estimator::PaperSquare);
                assert!(!square.valid && square.flags.contains(Flags::AMBIGUOUS), "{square:?}");
                // The pair needs its own two, and one lag for its side.
                assert_eq!(found(Estimator::Pair).valid, dead >= 2);
            }
        }
    }
}
