//! The antennas' positions: the constraints of eq. 3-5, and the square of eq. 18-19.

use super::{cross, length, subtract};
use foxhound_core::doa::array::{self, Array};

/// Pairs this close to parallel, as a sine, violate eq. 5.
const PAIRS_PARALLEL: f32 = 1e-3;

/// A violated constraint on the positions of the antennas.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Violation {
    /// Eq. 3: the antennas of a pair are more than half a wavelength apart.
    Spacing {
        /// Antennas of the pair, 0..4.
        pair: [u8; 2],
        /// Their distance in wavelengths.
        wavelengths: f32,
    },
    /// Eq. 4: the positions do not add up to zero.
    Unbalanced {
        /// Length of their sum.
        sum_m: f32,
    },
    /// Eq. 5: the two pairs are parallel. The paper's own square is.
    Parallel,
}

/// Checks arbitrary positions against eq. 3, 4 and 5, in this order, for the pairs A1A2 and A3A4.
///
/// The paper's estimators work without them: eq. 4 is about the vehicle's balance, and the directions of parallel
/// pairs still intersect at a near source.
pub fn constraints(config: &array::Config) -> [Result<(), Violation>; 3] {
    let r = &config.antennas_m;
    let pairs = [subtract(r[1], r[0]), subtract(r[3], r[2])];
    let wavelengths = pairs.map(|pair| length(pair) / config.wavelength_m);
    let spacing = |n: usize, pair: [u8; 2]| {
        let met = wavelengths[n] <= 0.5 + 1e-6;
        if met { Ok(()) } else { Err(Violation::Spacing { pair, wavelengths: wavelengths[n] }) }
    };
    let sum_m = length(r.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]));
    let balanced = sum_m <= 1e-4 * config.wavelength_m;
    let crossed = libm::fabsf(cross(pairs[0], pairs[1])) > PAIRS_PARALLEL * length(pairs[0]) * length(pairs[1]);
    [
        spacing(0, [0, 1]).and(spacing(1, [2, 3])),
        if balanced { Ok(()) } else { Err(Violation::Unbalanced { sum_m }) },
        if crossed { Ok(()) } else { Err(Violation::Parallel) },
    ]
}

/// Whether the antennas are the paper's square (eq. 18-19), in its order, within 5 % of half its side.
#[must_use]
pub fn is_square(array: &Array) -> bool {
    let p = &array.steering;
    let h = 0.25 * (p[0][0] + p[1][0] - p[2][0] - p[3][0]);
    let square = [[h, h], [h, -h], [-h, -h], [-h, h]];
    p.iter().flatten().zip(square.iter().flatten()).all(|(is, ideal)| libm::fabsf(is - ideal) <= 0.05 * h)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aoa::AnyBearingEstimator;
    use crate::aoa::waves::{SKEWED, with};
    use foxhound_core::doa::bearing::{Config, Estimator};

    #[test]
    fn every_constraint_is_named_and_the_papers_own_square_violates_one() {
        let square = array::Config::square(0.345, 0.40 * 0.345);
        assert_eq!(constraints(&square), [Ok(()), Ok(()), Err(Violation::Parallel)]);
        assert_eq!(constraints(&array::Config::square(0.345, 0.5 * 0.345))[0], Ok(()), "half a wavelength is allowed");
        let [spacing, ..] = constraints(&array::Config::square(0.345, 0.52 * 0.345));
        assert!(
            matches!(spacing, Err(Violation::Spacing { pair: [0, 1], wavelengths }) if (wavelengths - 0.52).abs() < 1e-4)
        );
        let of = |antennas_m| constraints(&with(antennas_m));
        assert_eq!(of(SKEWED), [Ok(()), Ok(()), Ok(())]);
        let [spacing, balance, parallel] = of([[0.05, 0.06], [0.07, -0.05], [-0.1, -0.1], [-0.1, 0.1]]);
        assert!(matches!(spacing, Err(Violation::Spacing { pair: [2, 3], .. })));
        assert!(matches!(balance, Err(Violation::Unbalanced { sum_m }) if (sum_m - 0.0806).abs() < 1e-3));
        assert_eq!(parallel, Ok(()));
        // One line, and nonsense.
        assert_eq!(of([[0.12, 0.0], [0.04, 0.0], [-0.04, 0.0], [-0.12, 0.0]])[2], Err(Violation::Parallel));
        assert!(of([[f32::NAN; 2]; 4]).iter().all(Result::is_err));
    }

    #[test]
    fn the_cotangent_rule_is_refused_on_other_arrays_than_its_square() {
        let [a, b, c, d] = array::Config::default().antennas_m;
        let build = |estimator, antennas_m| {
            let array = with(antennas_m).build().unwrap();
            AnyBearingEstimator::build(&Config { estimator, ..Config::default() }, array)
        };
        for estimator in [Estimator::PaperSquare, Estimator::PaperRepaired, Estimator::PaperCorrelated] {
            assert!(build(estimator, [a, b, c, d]).is_ok());
            assert!(build(estimator, [a, b, c, d].map(|[x, y]| [x + 0.3, y - 0.1])).is_ok(), "any origin");
            for other in [[b, c, d, a], [b, a, d, c], SKEWED] {
                assert_eq!(build(estimator, other).unwrap_err().field, "bearing.estimator");
            }
        }
        for estimator in [Estimator::Pair, Estimator::TwoArray, Estimator::ThreeAntenna, Estimator::NArray] {
            assert!(build(estimator, SKEWED).is_ok());
        }
    }
}
