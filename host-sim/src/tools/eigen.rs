//! Eigenvalues of a covariance, for display.

use foxhound_core::doa::beam::{Covariance, Vector};
use foxhound_core::signal::phase::Complex;

/// Jacobi sweeps.
const SWEEPS: usize = 12;

/// The eigenvalues of the covariance of the first antennas, largest first, by Jacobi rotations.
pub(super) fn values(covariance: &Covariance, antennas: usize) -> Vec<f64> {
    // A Hermitian matrix as a real symmetric one of twice the size: each eigenvalue appears twice.
    let mut a = vec![vec![0.0_f64; 2 * antennas]; 2 * antennas];
    for column in 0..antennas {
        let mut unit = Vector::default();
        unit[column] = Complex { re: 1.0, im: 0.0 };
        for (row, z) in covariance.times(&unit).iter().take(antennas).enumerate() {
            let (re, im) = (f64::from(z.re), f64::from(z.im));
            (a[row][column], a[antennas + row][antennas + column]) = (re, re);
            (a[row][antennas + column], a[antennas + row][column]) = (-im, im);
        }
    }
    if a.iter().flatten().any(|value| !value.is_finite()) {
        return vec![0.0; antennas];
    }
    let size = a.len();
    for _ in 0..SWEEPS {
        for p in 0..size {
            for q in p + 1..size {
                if a[p][q].abs() <= 1e-300 {
                    continue;
                }
                let (sine, cosine) = (0.5 * (2.0 * a[p][q]).atan2(a[q][q] - a[p][p])).sin_cos();
                for row in &mut a {
                    (row[p], row[q]) = (cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]);
                }
                let (upper, lower) = a.split_at_mut(q);
                for (x, y) in upper[p].iter_mut().zip(&mut lower[0]) {
                    (*x, *y) = (cosine * *x - sine * *y, sine * *x + cosine * *y);
                }
            }
        }
    }
    let mut all: Vec<f64> = (0..size).map(|k| a[k][k].max(0.0)).collect();
    all.sort_by(|x, y| y.total_cmp(x));
    all.into_iter().step_by(2).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_sources_have_two_large_eigenvalues_and_their_sum_is_the_trace() {
        let mut covariance = Covariance::default();
        let wave = |step: f32, scale: f32| -> Vector {
            std::array::from_fn(|k| Complex::at(step * k as f32).scaled(if k < 5 { scale } else { 0.0 }))
        };
        covariance.add(&wave(0.7, 2.0), 1.0);
        covariance.add(&wave(-1.1, 1.0), 1.0);
        let found = values(&covariance, 5);
        assert_eq!(found.len(), 5);
        assert!((found.iter().sum::<f64>() - 25.0).abs() < 1e-4, "{found:?}");
        assert!(found[0] > 15.0 && found[1] > 1.0 && found[2] < 1e-4, "{found:?}");
        covariance.add(&[Complex { re: f32::NAN, im: 0.0 }; 8], 1.0);
        assert_eq!(values(&covariance, 5), [0.0; 5]);
    }
}
