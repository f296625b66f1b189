//! Where the directions of pairs cross: two linear arrays (eq. 6-17, 50), three antennas (eq. 51), any number of arrays
//! (appendix C).

use super::pair::{ACROSS, Antennas, Ray};
use super::{Outcome, PAIR_MIN_RAD, azimuth, cross, dot, length, subtract};
use foxhound_core::base::adc::CHANNELS;

/// Directions closer than this are parallel, `det A = 0`: what rounding makes of parallel ones.
const PARALLEL: f32 = 4e-6;
/// Parallel directions this close to the line between the midpoints, as a sine, count as on it.
const COLLINEAR: f32 = 1e-3;

impl Antennas<'_> {
    pub(super) fn two_arrays(&self) -> Option<Outcome> {
        let (one, two) = (self.ray([0, 1], &ACROSS)?, self.ray([2, 3], &ACROSS)?);
        // Directions from one midpoint cross there, whatever they are.
        let apart_rad = self.wavenumber * length(subtract(two.midpoint_m, one.midpoint_m));
        if apart_rad > PAIR_MIN_RAD { crossing(one, two) } else { None }
    }

    /// Eq. 51: the paper's A1, A2 = A3, A4 are three neighbours, A1 A2 A3 of ours or those that live.
    pub(super) fn three_antennas(&self) -> Option<Outcome> {
        let left_out = self.living.iter().position(|lives| !lives).unwrap_or(CHANNELS - 1);
        let [first, corner, last] = [1, 2, 3].map(|n| (left_out + n) % CHANNELS);
        // The lag of A4 after A1, whose side is too long for eq. 3, is measured via the corner.
        crossing(self.ray([first, corner], &[[corner, last]])?, self.ray([corner, last], &[[first, corner]])?)
    }

    /// Every pair of working neighbours is a linear array; those beside it decide its side.
    pub(super) fn all_neighbours(&self) -> Option<Outcome> {
        let rays: [Option<Ray>; CHANNELS] = core::array::from_fn(|n| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| (n + k) % CHANNELS);
            self.ray([a, b], &[[b, c], [d, a]])
        });
        least_squares(rays.iter().flatten())
    }
}

/// Eq. 16-17 for the directions `one` of A1A2 and `two` of A3A4.
///
/// The rows of eq. 16, subtracted from each other, leave `k12 d12 - k34 d34 = r34 - r12`; the determinant stays.
fn crossing(one: Ray, two: Ray) -> Option<Outcome> {
    let between = subtract(two.midpoint_m, one.midpoint_m);
    let azimuth_rad = azimuth(one.direction)?;
    // On the square sin(theta1 - theta2), eq. 25.
    let determinant = cross(two.direction, one.direction);
    if !(libm::fabsf(determinant) > PARALLEL) {
        let same = dot(one.direction, two.direction) > 0.0;
        return same.then(|| eq_50(azimuth_rad, is_along(one.direction, between)));
    }
    let (k12, k34) = (cross(two.direction, between) / determinant, cross(one.direction, between) / determinant);
    if k12 < 0.0 || k34 < 0.0 {
        return Some(Outcome::NegativeScale { azimuth_rad });
    }
    let source_m = [one.midpoint_m[0] + k12 * one.direction[0], one.midpoint_m[1] + k12 * one.direction[1]];
    Some(Outcome::Solved { azimuth_rad: azimuth(source_m)?, range_m: Some(length(source_m)) })
}

/// Appendix C, end: the point with the least sum of squared distances from all directions.
///
/// It minimises `sum |r_n + k_n d_n - s|^2` over `s` and all `k_n`; with `k_n = d_n . (s - r_n)` the normal equations are
/// `sum (I - d_n d_n') s = sum (I - d_n d_n') r_n`. They are set up along and across the mean direction, where the small
/// angles between far-field directions are not lost in rounding.
fn least_squares<'r>(rays: impl Iterator<Item = &'r Ray> + Clone) -> Option<Outcome> {
    let first = rays.clone().next()?;
    let count = rays.clone().count() as f32;
    let sum = rays.clone().fold([0.0; 2], |sum, ray| [sum[0] + ray.direction[0], sum[1] + ray.direction[1]]);
    let agreement = length(sum);
    if count < 2.0 || !(agreement > 0.5 * count) {
        return None;
    }
    let along = [sum[0] / agreement, sum[1] / agreement];
    let azimuth_rad = azimuth(along)?;
    let (mut xx, mut xy, mut yy, mut right) = (0.0, 0.0, 0.0, [0.0; 2]);
    for ray in rays.clone() {
        let across = [-cross(along, ray.direction), dot(along, ray.direction)];
        let distance = across[0] * dot(along, ray.midpoint_m) + across[1] * cross(along, ray.midpoint_m);
        xx += across[0] * across[0];
        xy += across[0] * across[1];
        yy += across[1] * across[1];
        right = [right[0] + across[0] * distance, right[1] + across[1] * distance];
    }
    let determinant = xx * yy - xy * xy;
    // For two directions this is (det A / 2)^2, times 4.
    if !(determinant > 0.25 * PARALLEL * PARALLEL * count * count) {
        let on_line = |ray: &Ray| is_along(along, subtract(ray.midpoint_m, first.midpoint_m));
        return Some(eq_50(azimuth_rad, rays.clone().all(on_line)));
    }
    let local = [(right[0] * yy - right[1] * xy) / determinant, (right[1] * xx - right[0] * xy) / determinant];
    let source_m = [along[0] * local[0] - along[1] * local[1], along[1] * local[0] + along[0] * local[1]];
    if rays.clone().any(|ray| dot(ray.direction, subtract(source_m, ray.midpoint_m)) < 0.0) {
        return Some(Outcome::NegativeScale { azimuth_rad });
    }
    Some(Outcome::Solved { azimuth_rad: azimuth(source_m)?, range_m: Some(length(source_m)) })
}

/// Both cases of `det A = 0`.
fn eq_50(azimuth_rad: f32, collinear: bool) -> Outcome {
    if collinear { Outcome::Collinear { azimuth_rad } } else { Outcome::AtInfinity { azimuth_rad } }
}

/// Whether `v` lies along the unit vector `direction`, either way.
fn is_along(direction: [f32; 2], v: [f32; 2]) -> bool {
    libm::fabsf(cross(direction, v)) <= COLLINEAR * length(v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aoa::waves::{SKEWED, distances, error_deg, estimator, phasors, plane_wave, solved, wave, with};
    use foxhound_core::base::rng::Rng;
    use foxhound_core::doa::array;
    use foxhound_core::doa::bearing::{Estimator, Flags};
    use foxhound_core::signal::phase::Complex;
    use std::f64::consts::{PI, TAU};
    use std::vec::Vec;

    /// Gaussian elimination with pivoting, in f64, of as many equations as unknowns.
    fn linear(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
        let n = rows.len();
        for column in 0..n {
            let pivot = (column..n).max_by(|a, b| rows[*a][column].abs().total_cmp(&rows[*b][column].abs())).unwrap();
            rows.swap(column, pivot);
            let pivot = rows[column].clone();
            for row in rows.iter_mut().enumerate().filter(|(n, _)| *n != column).map(|(_, row)| row) {
                let factor = row[column] / pivot[column];
                row.iter_mut().zip(&pivot).for_each(|(value, pivot)| *value -= factor * pivot);
            }
        }
        (0..n).map(|k| rows[k][n] / rows[k][k]).collect()
    }

    #[test]
    fn the_crossing_is_the_solution_of_the_printed_system_and_of_the_square_in_closed_form() {
        for (m12, m34, source) in [
            ([0.07, 0.0], [-0.07, 0.0], [3.0, 4.0]),
            ([0.06, 0.01], [-0.02, 0.05], [-1.0, 2.5]),
            ([0.3, -0.2], [-0.1, 0.4], [0.7, -2.0]),
        ] {
            let toward = |m: [f64; 2]| {
                let v = [source[0] - m[0], source[1] - m[1]];
                let length = f64::hypot(v[0], v[1]);
                [v[0] / length, v[1] / length]
            };
            let (d12, d34) = (toward(m12), toward(m34));
            // Eq. 16: the endpoints of d12 and d34 less the midpoints are the directions.
            let x = linear(std::vec![
                std::vec![1.0, 0.0, 0.0, -d34[0], m34[0]],
                std::vec![0.0, 1.0, 0.0, -d34[1], m34[1]],
                std::vec![1.0, 0.0, -d12[0], 0.0, m12[0]],
                std::vec![0.0, 1.0, -d12[1], 0.0, m12[1]],
            ]);
            let ray =
                |m: [f64; 2], d: [f64; 2]| Ray { midpoint_m: m.map(|v| v as f32), direction: d.map(|v| v as f32) };
            let rays = [ray(m12, d12), ray(m34, d34)];
            for outcome in [crossing(rays[0], rays[1]).unwrap(), least_squares(rays.iter()).unwrap()] {
                let Outcome::Solved { azimuth_rad, range_m: Some(range_m) } = outcome else { panic!("{outcome:?}") };
                assert!(error_deg(azimuth_rad, -f64::atan2(x[1], x[0])).abs() < 0.005, "{outcome:?}, not {x:?}");
                assert!((f64::from(range_m) / f64::hypot(x[0], x[1]) - 1.0).abs() < 1e-3, "{outcome:?}, not {x:?}");
            }
        }
        // Eq. 27 with d = 0.07 and angles that cross at (3, 4).
        let d = 0.07_f64;
        let (theta1, theta2) = (f64::atan2(4.0, 3.0 - d), f64::atan2(4.0, 3.0 + d));
        let cosecant = 1.0 / (theta2 - theta1).sin();
        assert!((-d * cosecant * (theta2 + theta1).sin() - 3.0).abs() < 1e-9);
        assert!((-2.0 * d * cosecant * theta1.sin() * theta2.sin() - 4.0).abs() < 1e-9);
    }

    #[test]
    fn many_arrays_are_solved_in_the_sense_of_least_squares() {
        let mut rng = Rng::new(11, 0);
        for case in 0..200 {
            let angle = f64::from(case) * TAU / 200.0;
            let source = [3.0 * angle.cos(), 3.0 * angle.sin()];
            let rays: Vec<Ray> = (0..7)
                .map(|_| {
                    let m = [0.5 * rng.gaussian(), 0.5 * rng.gaussian()];
                    let toward = f64::atan2(source[1] - f64::from(m[1]), source[0] - f64::from(m[0]));
                    let heard = toward + 0.01 * f64::from(rng.gaussian());
                    Ray { midpoint_m: m, direction: [heard.cos() as f32, heard.sin() as f32] }
                })
                .collect();
            // All equations `s - k_n d_n = r_n`, unknowns s and k, by their normal equations.
            let unknowns = 2 + rays.len();
            let mut normal = std::vec![std::vec![0.0; unknowns + 1]; unknowns];
            for (n, ray) in rays.iter().enumerate() {
                for axis in 0..2 {
                    let mut row = std::vec![0.0; unknowns + 1];
                    row[axis] = 1.0;
                    row[2 + n] = -f64::from(ray.direction[axis]);
                    row[unknowns] = f64::from(ray.midpoint_m[axis]);
                    for i in 0..unknowns {
                        for j in 0..=unknowns {
                            normal[i][j] += row[i] * row[j];
                        }
                    }
                }
            }
            let x = linear(normal);
            let Some(Outcome::Solved { azimuth_rad, range_m: Some(range_m) }) = least_squares(rays.iter()) else {
                panic!("case {case}")
            };
            assert!(error_deg(azimuth_rad, -f64::atan2(x[1], x[0])).abs() < 0.01, "case {case}");
            assert!((f64::from(range_m) - f64::hypot(x[0], x[1])).abs() < 1e-3, "case {case}");
        }
    }

    #[test]
    fn both_singular_cases_are_told_apart_and_keep_their_direction() {
        for config in [array::Config::default(), with(SKEWED)] {
            for estimator in [Estimator::TwoArray, Estimator::ThreeAntenna, Estimator::NArray] {
                for degree in [-160_i32, -110, -30, 20, 75, 130] {
                    let truth = f64::from(degree).to_radians();
                    let outcome = solved(estimator, &config, plane_wave(&config, truth));
                    let Outcome::AtInfinity { azimuth_rad } = outcome else {
                        panic!("{estimator:?} {degree}: {outcome:?}")
                    };
                    assert!(error_deg(azimuth_rad, truth).abs() < 1e-3, "{estimator:?} {degree}: {outcome:?}");
                }
            }
        }
        // In line with both midpoints: ahead and behind on the square, at any range.
        let config = array::Config::default();
        for (azimuth_rad, range_m) in [(0.0, 5.0), (PI, 5.0), (0.0, 0.5), (PI, 400.0)] {
            let z = wave(&config, distances(&config, azimuth_rad, range_m, 0.0));
            let outcome = solved(Estimator::TwoArray, &config, z);
            let Outcome::Collinear { azimuth_rad: found } = outcome else { panic!("{azimuth_rad}: {outcome:?}") };
            assert!(error_deg(found, azimuth_rad).abs() < 1e-3);
            let bearing = estimator(Estimator::TwoArray, &config).estimate(&phasors(z, 1.0));
            assert!(bearing.valid && error_deg(bearing.azimuth_rad, azimuth_rad).abs() < 1e-3, "{bearing:?}");
        }
        let ray = |x: f32, y: f32| Ray { midpoint_m: [x, y], direction: [0.6, 0.8] };
        let (on, off) =
            ([ray(0.0, 0.0), ray(0.6, 0.8), ray(-0.3, -0.4)], [ray(0.0, 0.0), ray(0.6, 0.8), ray(1.0, 0.0)]);
        assert!(matches!(least_squares(on.iter()), Some(Outcome::Collinear { .. })));
        assert!(matches!(least_squares(off.iter()), Some(Outcome::AtInfinity { .. })));
    }

    #[test]
    fn diverging_directions_are_a_negative_scale_and_not_a_valid_bearing() {
        // Figure 15: to the left of the nose, the pair ahead sees the source less far to the side than the one behind.
        let d = 0.069;
        let ray = |x: f32, angle: f32| Ray { midpoint_m: [x, 0.0], direction: [angle.cos(), angle.sin()] };
        let diverging = [ray(d, 0.5), ray(-d, 0.6)];
        for outcome in [crossing(diverging[0], diverging[1]), least_squares(diverging.iter())] {
            assert!(matches!(outcome, Some(Outcome::NegativeScale { .. })), "{outcome:?}");
        }
        // A plane wave with 1 deg of phase that the model does not know.
        let config = array::Config::default();
        let mut z = plane_wave(&config, 0.7);
        z[0] = z[0].times(Complex { re: 0.999_85, im: -0.017_45 });
        let outcomes = [solved(Estimator::TwoArray, &config, z), {
            z[0] = z[0].times(Complex { re: 0.999_39, im: 0.034_9 });
            solved(Estimator::TwoArray, &config, z)
        }];
        let negative = outcomes.iter().filter(|outcome| matches!(outcome, Outcome::NegativeScale { .. })).count();
        assert_eq!(negative, 1, "one sign diverges, the other crosses: {outcomes:?}");
        z[0] = plane_wave(&config, 0.7)[0];
        for turn in [-0.017_45, 0.017_45] {
            let mut z = z;
            z[0] = z[0].times(Complex { re: 0.999_85, im: turn });
            let outcome = solved(Estimator::TwoArray, &config, z);
            let bearing = estimator(Estimator::TwoArray, &config).estimate(&phasors(z, 100.0));
            assert_eq!(bearing.valid, outcome.is_usable(), "{outcome:?} {bearing:?}");
            assert_eq!(bearing.flags.contains(Flags::AMBIGUOUS), !outcome.is_usable());
        }
    }

    #[test]
    fn pairs_with_one_midpoint_have_no_crossing_and_an_antenna_that_is_not_asked_does_not_matter() {
        let square = array::Config::default();
        // Off the origin, so that rounding keeps the midpoints from being quite the same.
        let [a, b, c, d] = square.antennas_m.map(|[x, y]| [0.31 + 0.7 * x, -0.17 + 0.7 * y]);
        let crossed = with([a, c, b, d]);
        let mut z = wave(&crossed, distances(&crossed, 0.6, 5.0, 0.0));
        z[0] = z[0].times(Complex { re: 0.999_85, im: 0.017_45 });
        assert_eq!(solved(Estimator::TwoArray, &crossed, z), Outcome::Undefined);

        let mut z = wave(&square, distances(&square, 0.5, 5.0, 0.0));
        let three = solved(Estimator::ThreeAntenna, &square, z);
        z[3] = Complex { re: -300.0, im: 700.0 };
        assert_eq!(solved(Estimator::ThreeAntenna, &square, z), three);
        assert_ne!(solved(Estimator::NArray, &square, z).azimuth_rad(), three.azimuth_rad());
    }
}
