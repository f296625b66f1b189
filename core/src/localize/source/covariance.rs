//! Keeps the covariance of a filter positive definite despite rounding.
#![expect(clippy::needless_range_loop, reason = "symmetric matrices are filled by row and column")]

use crate::base::math::sqrt;
use crate::base::units::between;

/// Least pivot of a covariance, as a share of its diagonal. Rounding changes a pivot by about
/// `eps / sqrt(least pivot before)`, so that a matrix that passes in `f32` has a Cholesky factor in `f64` too.
const PIVOT_MIN: f32 = 1e-4;
/// Largest number of widenings, each about twice the one before; together they widen by a factor of five at most.
const WIDENINGS: u8 = 14;
/// Smallest and largest variance of any state.
const VARIANCES: [f32; 2] = [1e-12, 1e12];

/// Limits the variances, and increases them a little where rounding has made their correlations impossible; reads the
/// upper triangle only, and keeps a symmetric matrix symmetric.
#[inline(always)]
pub fn keep_positive<const S: usize>(p: &mut [[f32; S]; S]) {
    let mut trace = 0.0;
    for i in 0..S {
        trace += p[i][i];
    }
    if !(is_positive(p) && trace <= VARIANCES[1]) {
        widen(p);
    }
}

#[cold]
#[inline(never)]
fn widen<const S: usize>(p: &mut [[f32; S]; S]) {
    for i in 0..S {
        let variance = p[i][i];
        // A variance that is too large keeps its correlations; one that is not positive loses them.
        let share = if variance > VARIANCES[1] { sqrt(VARIANCES[1] / variance) } else { 1.0 };
        if !(variance > 0.0) || share < 1.0 {
            for j in 0..S {
                p[i][j] = if share > 0.0 && variance > 0.0 { p[i][j] * share } else { 0.0 };
                p[j][i] = if share > 0.0 && variance > 0.0 { p[j][i] * share } else { 0.0 };
            }
        }
        p[i][i] = if variance > VARIANCES[0] { between(variance, VARIANCES[0], VARIANCES[1]) } else { VARIANCES[0] };
    }
    let mut wider = 1.0 + PIVOT_MIN;
    for _ in 0..WIDENINGS {
        if is_positive(p) {
            return;
        }
        for i in 0..S {
            p[i][i] *= wider;
        }
        wider += wider - 1.0;
    }
    // Larger errors are not caused by rounding.
    for i in 0..S {
        for j in 0..S {
            if i != j {
                p[i][j] = 0.0;
            }
        }
    }
}

/// Whether all pivots of a symmetric matrix are positive enough.
#[inline(always)]
fn is_positive<const S: usize>(p: &[[f32; S]; S]) -> bool {
    let mut rest = *p;
    for k in 0..S {
        let (pivot, variance) = (rest[k][k], p[k][k]);
        if !(pivot > PIVOT_MIN * (variance + VARIANCES[0])) {
            return false;
        }
        if k + 1 < S {
            let inverse = 1.0 / pivot;
            for i in 0..S {
                if k < i {
                    let factor = rest[k][i] * inverse;
                    for j in 0..S {
                        if i <= j {
                            rest[i][j] -= factor * rest[k][j];
                        }
                    }
                }
            }
        }
    }
    true
}
