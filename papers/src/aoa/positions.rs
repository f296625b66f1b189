//! The antennas' positions: the square of eq. 18-19.

use foxhound_core::doa::array::Array;

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
    use crate::aoa::AnyBearingEstimator;
    use crate::aoa::waves::{SKEWED, with};
    use foxhound_core::doa::array;
    use foxhound_core::doa::bearing::{Config, Estimator};

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
