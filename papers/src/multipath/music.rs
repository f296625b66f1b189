//! MUSIC (Schmidt 1986): the directions whose steering vectors the noise subspace does not know.

use super::bartlett::{GRID, GRID_STEP_RAD, Scan};
use super::matrix::{Symmetric, Vector, dot, plus, scaled};
use super::model::Solver;
use foxhound_core::base::math::sqrt;
use foxhound_core::base::sort::sort_by_key;
use foxhound_core::base::units::sin_cos_inlined as sin_cos;

/// Rounds of Jacobi rotations: the off-diagonal is below rounding after four.
const SWEEPS: u8 = 4;

impl Symmetric {
    /// The eigenvectors of the two smallest eigenvalues, by cyclic Jacobi rotations.
    pub(super) fn lesser_eigenvectors(&self) -> [Vector; 2] {
        let mut a = self.0;
        let mut v = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let negligible = 1e-14 * self.trace() * self.trace();
        for _ in 0..SWEEPS {
            for (p, q) in [(0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)] {
                let off = a[p][q];
                if off * off <= negligible {
                    continue;
                }
                let ratio = (a[q][q] - a[p][p]) / (2.0 * off);
                let t = 1.0 / (libm::fabsf(ratio) + sqrt(ratio * ratio + 1.0));
                let t = if ratio < 0.0 { -t } else { t };
                let c = 1.0 / sqrt(t * t + 1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                for rows in [&mut a, &mut v] {
                    let (x, y) = (rows[p], rows[q]);
                    rows[p] = plus(&scaled(&x, c), -s, &y);
                    rows[q] = plus(&scaled(&x, s), c, &y);
                }
            }
        }
        let mut order = [0, 1, 2, 3];
        sort_by_key(&mut order, |i: &usize| a[*i][*i]);
        [v[order[0]], v[order[1]]]
    }
}

impl Solver<'_> {
    /// The two deepest minima of the noise subspace's spectrum; `None` with more headings than one, or one minimum.
    pub(super) fn music(&self, scan: &Scan) -> Option<[f32; 2]> {
        let [heading] = self.headings.as_slice() else {
            return None;
        };
        let noise = heading.covariance.lesser_eigenvectors();
        let spectrum = |d: &Vector| {
            let (a, b) = (dot(d, &noise[0]), dot(d, &noise[1]));
            a * a + b * b
        };
        let values: [f32; GRID] = core::array::from_fn(|i| spectrum(&scan.steering(i)));
        let mut deepest = [(f32::MAX, 0.0); 2];
        for i in 0..GRID {
            let (before, after) = (values[(i + GRID - 1) % GRID], values[(i + 1) % GRID]);
            if !(values[i] < before && values[i] <= after) {
                continue;
            }
            let mut azimuth_rad = i as f32 * GRID_STEP_RAD;
            let mut depth = values[i];
            for _ in 0..3 {
                let steering = self.steering(Self::direction(heading, sin_cos(azimuth_rad)), self.wavenumber);
                depth = spectrum(&steering.d);
                let (mut slope, mut curvature) = (0.0, 1e-6);
                for v in &noise {
                    let turn = dot(&steering.by_azimuth, v);
                    slope += turn * dot(&steering.d, v);
                    curvature += turn * turn;
                }
                azimuth_rad -= (slope / curvature).clamp(-0.5 * GRID_STEP_RAD, 0.5 * GRID_STEP_RAD);
            }
            if depth < deepest[0].0 {
                deepest = [(depth, azimuth_rad), deepest[0]];
            } else if depth < deepest[1].0 {
                deepest[1] = (depth, azimuth_rad);
            }
        }
        let found = deepest.iter().all(|(depth, _)| *depth < f32::MAX);
        found.then_some(deepest.map(|(_, azimuth_rad)| azimuth_rad))
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec as List;

    use super::*;
    use foxhound_core::base::rng::Rng;

    #[test]
    fn the_lesser_eigenvectors_are_those_of_a_matrix_made_from_them() {
        let mut rng = Rng::new(8, 1);
        for _ in 0..500 {
            // Gram-Schmidt in f64 on random vectors, then a matrix of known eigenvalues.
            let mut basis: List<[f64; 4]> = List::new();
            while basis.len() < 4 {
                let mut v = [0; 4].map(|_| f64::from(rng.gaussian()));
                for b in &basis {
                    let along: f64 = b.iter().zip(v).map(|(x, y)| x * y).sum();
                    v = core::array::from_fn(|i| v[i] - along * b[i]);
                }
                let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
                if length > 0.1 {
                    basis.push(v.map(|x| x / length));
                }
            }
            let small = f64::from(rng.uniform()) * 1e-3;
            let mut matrix = Symmetric::default();
            for (value, v) in [3.0, small, 0.2 + f64::from(rng.uniform()), 0.1 * small].iter().zip(&basis) {
                matrix.add(*value as f32, [&v.map(|x| x as f32), &[0.0; 4]]);
            }
            for found in matrix.lesser_eigenvectors() {
                assert!((dot(&found, &found) - 1.0).abs() < 1e-5);
                for strong in [0, 2] {
                    assert!(dot(&found, &basis[strong].map(|x| x as f32)).abs() < 1e-5, "{found:?}");
                }
            }
        }
    }
}
