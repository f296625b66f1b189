//! A circle through points on an arc: Taubin's fit (1991), which is unbiased to first order, while Kasa's fit makes
//! short arcs too small.
//!
//! In the principal axes of the centred points (x along the chord, y along the sagitta, `z = x^2 + y^2`, `M` means) the
//! fit is the smallest eigenvalue `eta` of a symmetric arrow matrix, the smallest root of
//!
//! ```text
//!     (p - eta - u^2 / (Mxx - eta)) (Myy - eta) - v^2 = 0
//!     p = (Mzz - Mz^2) / 4 Mz,   u = Mxz / 2 sqrt(Mz),   v = Myz / 2 sqrt(Mz)
//! ```
//!
//! which is convex below the root, so that Newton's steps from 0 rise to it and never pass it. Then the centre is
//! `(Mxz / 2 (Mxx - eta), Myz / 2 (Myy - eta))` and `R^2 = |centre|^2 + Mz`. Nothing here subtracts large numbers,
//! unlike the usual expansion into a polynomial, which loses digits in single precision.
//!
//! Accuracy of the radius: noise `s` on `n` points over a half arc `phi` leaves the sagitta's curvature with
//! `sigma_r = 6.7 s / (sqrt(n) phi^2)` (least-squares parabola through evenly spaced points).

use crate::base::math::{inverse_root, sqrt};
use crate::base::ned::Horizontal;

/// Largest number of Newton steps; three are enough for clean arcs, the rest is for noise.
const STEPS: usize = 6;
/// Lower limit of the measurement noise: quantisation to whole centimetres.
const NOISE_MIN_M: f32 = 0.003;

/// Larger circles count as straight lines.
const RADIUS_MAX_M: f32 = 1e5;
/// Radius beyond which a miss is so small in comparison that `d + R` is taken as `2 R`.
const FLAT_M: f32 = 10.0;

/// Result of a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Circle {
    pub(super) center: Horizontal,
    pub(super) radius_m: f32,
    /// The point farthest from the circle, and its distance.
    pub(super) worst: usize,
    pub(super) residual_m: f32,
    /// Standard deviation of the radius; that of the centre is no larger.
    pub(super) sigma_m: f32,
}

/// The circle through `points`; `None` for fewer than three, for points on a line, and if a number is not finite.
pub(super) fn fit(points: &[Horizontal]) -> Option<Circle> {
    let (first, last) = (points.first()?, points.last()?);
    if points.len() < 3 {
        return None;
    }
    let share = 1.0 / points.len() as f32;
    let centroid = points.iter().fold(Horizontal::default(), |sum, p| sum.plus(*p)).times(share);
    let axis = principal_axis(points, centroid)?;

    let (mut xx, mut yy, mut xz, mut yz, mut zz) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
    for point in points {
        let p = point.minus(centroid);
        let (x, y) = (p.dot(axis), cross(axis, p));
        let z = x * x + y * y;
        xx += x * x;
        yy += y * y;
        xz += x * z;
        yz += y * z;
        zz += z * z;
    }
    (xx, yy, xz, yz, zz) = (xx * share, yy * share, xz * share, yz * share, zz * share);
    let z = xx + yy;
    if !(yy > 1e-7 * xx) {
        return None;
    }
    let (p, u2, v2) = ((zz - z * z) / (4.0 * z), xz * xz / (4.0 * z), yz * yz / (4.0 * z));
    let mut eta = 0.0;
    for _ in 0..STEPS {
        let across = 1.0 / (xx - eta);
        let head = p - eta - u2 * across;
        let slope = -(1.0 + u2 * across * across) * (yy - eta) - head;
        let step = (head * (yy - eta) - v2) / slope;
        // Below the root the signs are as in the module's text; at the root rounding may change them.
        if !(step < 0.0) || !(eta - step < yy) {
            break;
        }
        eta -= step;
    }
    // The centre relative to the centroid, converted from the principal axes. The radius follows from it and the mean
    // square.
    let center = Horizontal { north: 0.5 * xz / (xx - eta), east: 0.5 * yz / (yy - eta) };
    let center = axis.times(center.north).plus(right_of(axis).times(center.east));
    let radius_m = root(center.norm_squared() + z);
    if !(radius_m > 0.0 && radius_m < RADIUS_MAX_M) {
        return None;
    }

    // With `d^2 - R^2 = |p|^2 - 2 p c - z`, which subtracts no large numbers, a miss is `(d^2 - R^2) / (d + R)`.
    let (mut worst, mut most, mut sum) = (0, 0.0_f32, 0.0_f32);
    for (index, point) in points.iter().enumerate() {
        let p = point.minus(centroid);
        let excess = libm::fabsf(p.norm_squared() - 2.0 * p.dot(center) - z);
        sum += excess * excess;
        if excess > most {
            (worst, most) = (index, excess);
        }
    }
    let center = centroid.plus(center);
    let miss_of = |point: &Horizontal| libm::fabsf(point.minus(center).norm() - radius_m);
    let residual_m = if radius_m > FLAT_M { 0.5 * most / radius_m } else { points.get(worst).map_or(0.0, miss_of) };
    let noise_m = 0.5 * root(sum * share) / radius_m;
    let noise_m = if noise_m > NOISE_MIN_M { noise_m } else { NOISE_MIN_M };
    let (a, b) = (first.minus(center), last.minus(center));
    let half_arc = 0.5 * libm::atan2f(libm::fabsf(cross(a, b)), a.dot(b));
    let sigma_m = 6.7 * noise_m / (root(points.len() as f32) * half_arc * half_arc + 1e-6);
    Some(Circle { center, radius_m, worst, residual_m, sigma_m })
}

/// Square root of a number >= 0, within a millionth, in a third of the time of `libm`'s on the target.
pub(super) fn root(x: f32) -> f32 {
    x * inverse_root(x)
}

/// Unit vector along which the points spread most.
fn principal_axis(points: &[Horizontal], centroid: Horizontal) -> Option<Horizontal> {
    let (mut nn, mut ne, mut ee) = (0.0_f32, 0.0_f32, 0.0_f32);
    for point in points {
        let p = point.minus(centroid);
        nn += p.north * p.north;
        ne += p.north * p.east;
        ee += p.east * p.east;
    }
    // The doubled angle has cosine (nn - ee) / size and sine 2 ne / size.
    let (c, s) = (nn - ee, 2.0 * ne);
    let size = sqrt(c * c + s * s);
    if !(nn + ee > 1e-9) || !size.is_finite() {
        return None;
    }
    let cosine = if size > 0.0 { c / size } else { 1.0 };
    let north = sqrt(0.5 * (1.0 + cosine.clamp(-1.0, 1.0)));
    let east = sqrt(0.5 * (1.0 - cosine.clamp(-1.0, 1.0)));
    Some(Horizontal { north, east: if s < 0.0 { -east } else { east } })
}

/// The unit vector turned clockwise by a right angle.
fn right_of(v: Horizontal) -> Horizontal {
    Horizontal { north: -v.east, east: v.north }
}

/// Component of `b` to the right of `a`, times the length of `a`.
pub(super) fn cross(a: Horizontal, b: Horizontal) -> f32 {
    a.north * b.east - a.east * b.north
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use std::vec::Vec;

    /// Points on an arc of `arc_deg` around bearing `middle`, with radial noise.
    fn arc(center: (f64, f64), radius: f64, arc_deg: f64, n: usize, noise: f64, rng: &mut Rng) -> Vec<(f64, f64)> {
        let middle = f64::from(rng.uniform()) * std::f64::consts::TAU;
        (0..n)
            .map(|k| {
                let angle = middle + arc_deg.to_radians() * (k as f64 / (n - 1) as f64 - 0.5);
                let r = radius + noise * f64::from(rng.gaussian());
                (center.0 + r * angle.cos(), center.1 + r * angle.sin())
            })
            .collect()
    }

    fn single(points: &[(f64, f64)]) -> Vec<Horizontal> {
        points.iter().map(|p| Horizontal { north: p.0 as f32, east: p.1 as f32 }).collect()
    }

    /// The geometric fit in f64, the maximum-likelihood one: Gauss-Newton on `sum (|p - c| - r)^2`, from the truth.
    fn reference(points: &[(f64, f64)], start: (f64, f64, f64)) -> Option<(f64, f64, f64)> {
        let (mut a, mut b, mut r) = start;
        for _ in 0..200 {
            let mut m = [[0.0_f64; 4]; 3];
            for (x, y) in points {
                let d = (x - a).hypot(y - b);
                let row = [-(x - a) / d, -(y - b) / d, -1.0, -(d - r)];
                for i in 0..3 {
                    for j in 0..4 {
                        m[i][j] += row[i] * row[j];
                    }
                }
            }
            for i in 0..3 {
                m[i][i] *= 1.0 + 1e-6;
                for j in 0..3 {
                    if j != i {
                        let (pivot, factor) = (m[i], m[j][i] / m[i][i]);
                        for (value, above) in m[j].iter_mut().zip(pivot) {
                            *value -= factor * above;
                        }
                    }
                }
            }
            let step = [m[0][3] / m[0][0], m[1][3] / m[1][1], m[2][3] / m[2][2]];
            (a, b, r) = (a + step[0], b + step[1], r + step[2]);
            if step.iter().all(|s| s.abs() < 1e-12) {
                return Some((a, b, r));
            }
        }
        None
    }

    #[test]
    fn clean_arcs_of_every_length_are_found_to_a_millimetre_even_far_from_the_origin() {
        let mut rng = Rng::new(1, 0);
        for arc_deg in [20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 150.0, 180.0] {
            for radius in [0.05, 0.1, 0.3, 0.5, 1.5] {
                for n in [5, 9, 20, 72] {
                    let (north, east) = (3.0 * f64::from(rng.gaussian()), 3.0 * f64::from(rng.gaussian()));
                    let found = fit(&single(&arc((north, east), radius, arc_deg, n, 0.0, &mut rng))).unwrap();
                    let off = (f64::from(found.center.north) - north).hypot(f64::from(found.center.east) - east);
                    let allowed = 1e-3 * (radius / 0.3).max(1.0);
                    assert!(
                        off < allowed && (f64::from(found.radius_m) - radius).abs() < allowed,
                        "{arc_deg} {radius} {n}: {found:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn with_noise_it_agrees_with_the_geometric_fit_in_f64() {
        // The two differ by terms of second order in noise / sagitta; measured against the claimed sigma.
        let mut rng = Rng::new(2, 0);
        let mut tested = 0;
        for arc_deg in [20.0, 40.0, 60.0, 90.0, 120.0, 160.0, 180.0_f64] {
            for radius in [0.1, 0.2, 0.33, 0.5, 1.0] {
                for _ in 0..40 {
                    let points = arc((1.5, -0.7), radius, arc_deg, 16, 0.003, &mut rng);
                    let found = fit(&single(&points)).unwrap();
                    // Where the sagitta is less than the noise, the fits are not compared.
                    let sagitta = radius * (1.0 - (arc_deg.to_radians() / 2.0).cos());
                    if sagitta < 5.0 * 0.003 {
                        let off = (f64::from(found.radius_m) - radius).abs() / f64::from(found.sigma_m);
                        let is_doubtful = found.sigma_m > 0.15 * found.radius_m;
                        assert!(is_doubtful || off < 4.0, "{arc_deg} {radius}: {found:?} is believed");
                        continue;
                    }
                    let Some(truth) = reference(&points, (1.5, -0.7, radius)) else { continue };
                    let off = (f64::from(found.radius_m) - truth.2).abs();
                    assert!(off < 0.25 * f64::from(found.sigma_m) + 2e-4, "{arc_deg} {radius}: {found:?} {truth:?}");
                    tested += 1;
                }
            }
        }
        assert!(tested > 800, "{tested}");
    }

    #[test]
    fn the_claimed_sigma_is_the_error_that_is_made() {
        let mut rng = Rng::new(3, 0);
        for (arc_deg, radius) in [(60.0, 0.3), (90.0, 0.3), (120.0, 0.15), (150.0, 0.3), (160.0, 0.5)] {
            let (mut square, mut claimed) = (0.0, 0.0);
            for _ in 0..400 {
                let found = fit(&single(&arc((2.0, 0.0), radius, arc_deg, 14, 0.004, &mut rng))).unwrap();
                square += (f64::from(found.radius_m) - radius).powi(2) / 400.0;
                claimed += f64::from(found.sigma_m) / 400.0;
            }
            let ratio = square.sqrt() / claimed;
            assert!((0.4..1.6).contains(&ratio), "{arc_deg} deg, {radius} m: error / sigma = {ratio}");
        }
    }

    #[test]
    fn a_short_arc_is_not_shrunk_as_kasa_would() {
        let mut rng = Rng::new(4, 0);
        let mut sum = 0.0;
        for _ in 0..400 {
            sum += f64::from(fit(&single(&arc((2.0, 0.0), 0.5, 60.0, 20, 0.003, &mut rng))).unwrap().radius_m) / 400.0;
        }
        assert!((sum - 0.5).abs() < 0.01, "mean radius {sum}");
    }

    #[test]
    fn lines_doublets_and_numbers_that_end_yield_nothing_or_a_finite_circle() {
        let at = |north: f32, east: f32| Horizontal { north, east };
        assert_eq!(fit(&[at(1.0, 0.0), at(1.0, 1.0)]), None);
        assert_eq!(fit(&[at(1.0, 0.0); 9]), None);
        assert_eq!(fit(&[at(0.0, 0.0), at(0.0, 1.0), at(0.0, 2.0), at(0.0, 3.0)]), None);
        for wild in [f32::NAN, f32::INFINITY, 1e30, 1e19, -1e30] {
            if let Some(circle) = fit(&[at(1.0, 0.0), at(wild, 0.2), at(0.9, 0.5), at(1.0, wild)]) {
                assert!(circle.center.is_finite() && circle.radius_m.is_finite(), "{wild}: {circle:?}");
            }
        }
    }
}
