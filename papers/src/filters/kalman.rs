//! The Kalman update by a direction, eq. 16 and 17 of the mmWave paper, for its filters.
//!
//! The paper measures an angle as `z = [cos, sin]`. Whatever a direction `h` depends on, its derivative is across it:
//! `H = t g'` with `t` across `h` and `g` the gradient of its angle. With the same noise on both components, `R = r I`, the
//! 2x2 update is therefore one along `t`, of the innovation `t . z` (the sine of the angle's error), with the gradient `g`:
//! the component along `h` has no gain. The tests hold that against the matrices of eq. 16 and 17.
//!
//! Joseph's form, `(I - k g') P (I - k g')' + r k k'`, instead of the paper's `(I - K H) P`, keeps the covariance
//! positive except in the last digits; those are checked by its pivots.

use super::Estimate;
use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::units::between;
use foxhound_core::localize::source::covariance::keep_positive;

/// A direction that a state predicts, and how its angle depends on the state.
pub(super) struct Predicted<const S: usize> {
    /// Unit vector.
    pub(super) direction: [f32; 2],
    /// Gradient of its angle.
    pub(super) gradient: [f32; S],
}

/// The result of an update.
#[derive(Clone, Copy)]
pub(super) struct Weighed {
    /// Normalised innovation squared.
    pub(super) nis: f32,
    /// Variance of the innovation.
    pub(super) variance: f32,
}

impl Weighed {
    /// Density of the angle, 1/rad.
    pub(super) fn likelihood(&self) -> f32 {
        // sqrt(2 pi).
        libm::expf(-0.5 * self.nis) / (2.506_628_3 * sqrt(self.variance))
    }
}

/// Updates a state and its covariance, both triangles of it, by a direction whose components have the variance `r`.
pub(super) fn update<const S: usize>(
    x: &mut [f32; S],
    p: &mut [[f32; S]; S],
    predicted: &Predicted<S>,
    z: [f32; 2],
    r: f32,
) -> Weighed {
    let (h, g) = (predicted.direction, &predicted.gradient);
    let along = h[0] * z[0] + h[1] * z[1] - 1.0;
    let across = h[0] * z[1] - h[1] * z[0];
    let zeta = times(p, g);
    let variance = dot(g, &zeta) + r;
    let inverse = 1.0 / variance;
    let k = zeta.map(|zeta| zeta * inverse);
    for (x, k) in x.iter_mut().zip(&k) {
        *x += k * across;
    }
    let mut half = *p;
    for (row, k) in half.iter_mut().zip(&k) {
        for (entry, zeta) in row.iter_mut().zip(&zeta) {
            *entry -= k * zeta;
        }
    }
    let rest = times(&half, g);
    for i in 0..S {
        for j in i..S {
            let entry = half[i][j] - (rest[i] - r * k[i]) * k[j];
            p[i][j] = entry;
            p[j][i] = entry;
        }
    }
    keep_positive(p);
    Weighed { nis: across * across * inverse + along * along / r, variance }
}

/// A matrix times a vector.
pub(super) fn times<const S: usize>(p: &[[f32; S]; S], v: &[f32; S]) -> [f32; S] {
    let mut product = [0.0; S];
    for (out, row) in product.iter_mut().zip(p) {
        *out = dot(row, v);
    }
    product
}

/// An inner product.
pub(super) fn dot<const S: usize>(a: &[f32; S], b: &[f32; S]) -> f32 {
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        sum += a * b;
    }
    sum
}

/// The covariance of two functions of a state, by two rows of derivatives.
pub(super) fn projected<const S: usize>(p: &[[f32; S]; S], rows: [&[f32; S]; 2]) -> [f32; 3] {
    let (a, b) = (times(p, rows[0]), times(p, rows[1]));
    [dot(rows[0], &a), dot(rows[0], &b), dot(rows[1], &b)]
}

/// The estimate of a source at rest from a vehicle, from its position and covariance.
pub(super) fn seen(
    vehicle_ned_m: Horizontal,
    place_ned_m: Horizontal,
    covariance_m2: [f32; 3],
    range_min_m: f32,
) -> Estimate {
    let to = place_ned_m.minus(vehicle_ned_m);
    let bearing_ned_rad = to.bearing_rad();
    let norm = to.norm();
    let range_m = if norm > range_min_m { norm } else { range_min_m };
    let along = if norm > 0.0 { to.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
    let [nn, ne, ee] = covariance_m2;
    let ratio = |e: Horizontal| {
        let variance = nn * e.north * e.north + 2.0 * ne * e.north * e.east + ee * e.east * e.east;
        sqrt(if variance > 0.0 { variance } else { 0.0 }) / range_m
    };
    Estimate {
        place_ned_m,
        velocity_ned_mps: Horizontal::default(),
        covariance_m2,
        bearing_ned_rad,
        bearing_sigma_rad: between(ratio(Horizontal { north: -along.east, east: along.north }), 0.0, UNIFORM_SIGMA_RAD),
        range_m,
        range_sigma_ratio: ratio(along),
    }
}

/// Standard deviation of a bearing from anywhere.
const UNIFORM_SIGMA_RAD: f32 = 1.813_8;

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use foxhound_core::base::rng::Rng;

    #[test]
    fn one_row_across_the_direction_does_what_the_matrices_of_eq_16_and_17_do() {
        let mut rng = Rng::new(1, 22);
        for _ in 0..500 {
            let a: [[f32; 4]; 4] = core::array::from_fn(|_| core::array::from_fn(|_| rng.gaussian()));
            let mut p = [[0.0; 4]; 4];
            for i in 0..4 {
                for j in 0..4 {
                    p[i][j] = (0..4).map(|k| a[i][k] * a[j][k]).sum::<f32>() + if i == j { 0.1 } else { 0.0 };
                }
            }
            let x: [f32; 4] = core::array::from_fn(|_| rng.gaussian());
            let (h, z) = (Horizontal::from_bearing(TAU * rng.uniform()), Horizontal::from_bearing(TAU * rng.uniform()));
            let predicted =
                Predicted { direction: [h.north, h.east], gradient: core::array::from_fn(|_| rng.gaussian()) };
            let r = 0.01 + rng.uniform();

            // H = t g', S = H P H' + r I, K = P H' S^-1, x + K y, (I - K H) P; all of it in f64.
            let t = [-f64::from(h.east), f64::from(h.north)];
            let big_h: [[f64; 4]; 2] = t.map(|t| predicted.gradient.map(|g| t * f64::from(g)));
            let zeta: [[f64; 2]; 4] = core::array::from_fn(|i| {
                core::array::from_fn(|row| (0..4).map(|j| f64::from(p[i][j]) * big_h[row][j]).sum())
            });
            let mut s = [[0.0; 2]; 2];
            for (i, row) in s.iter_mut().enumerate() {
                for (j, entry) in row.iter_mut().enumerate() {
                    *entry =
                        (0..4).map(|k| big_h[i][k] * zeta[k][j]).sum::<f64>() + if i == j { f64::from(r) } else { 0.0 };
                }
            }
            let det = s[0][0] * s[1][1] - s[0][1] * s[1][0];
            let inverse = [[s[1][1] / det, -s[0][1] / det], [-s[1][0] / det, s[0][0] / det]];
            let y = [f64::from(z.north) - f64::from(h.north), f64::from(z.east) - f64::from(h.east)];
            let gain = |i: usize, j: usize| zeta[i][0] * inverse[0][j] + zeta[i][1] * inverse[1][j];
            let nis: f64 =
                (0..2).flat_map(|i| (0..2).map(move |j| (i, j))).map(|(i, j)| y[i] * inverse[i][j] * y[j]).sum();

            let (mut ours, mut covariance) = (x, p);
            let weighed = update(&mut ours, &mut covariance, &predicted, [z.north, z.east], r);
            assert!((f64::from(weighed.nis) - nis).abs() < 1e-4 * (1.0 + nis), "{} {nis}", weighed.nis);
            for i in 0..4 {
                let expected = f64::from(x[i]) + gain(i, 0) * y[0] + gain(i, 1) * y[1];
                assert!((f64::from(ours[i]) - expected).abs() < 1e-4 * (1.0 + expected.abs()));
                for j in 0..4 {
                    let expected = f64::from(p[i][j]) - gain(i, 0) * zeta[j][0] - gain(i, 1) * zeta[j][1];
                    assert!(
                        (f64::from(covariance[i][j]) - expected).abs() < 1e-4 * (1.0 + f64::from(p[i][i] + p[j][j]))
                    );
                }
            }
        }
    }
}
