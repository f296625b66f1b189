//! The law of reflection as the mmWave paper has it, in its frame: x east, y north, line `y = m x + c`.
//!
//! Eq. 4 asks that the rays from the transponder `t` and from the robot `p` meet the line at the same angle, eq. 6 that they
//! meet on it. The paper says that a symbolic expression of `p_r,x` follows and does not print it. With the heights above
//! the line and the feet along it, both to a common scale,
//!
//! ```text
//!     d = |m p_x - p_y + c|,           a = p_x + m (p_y - c)
//!     e = |m t_x - t_y + c|,           b = t_x + m (t_y - c)
//!     p_r,x = (e a + d b) / ((1 + m^2) (d + e))
//! ```
//!
//! (similar triangles). The absolute values are eq. 4's own: it uses only parts along the line and distances, and so
//! cannot distinguish a transponder from its mirror image.

use super::Degenerate;
use foxhound_core::base::math::sqrt;

/// Beyond this slope a line is vertical.
const SLOPE_MAX: f32 = 1e3;
/// Nearer to the point of reflection than this the robot counts as on the line.
const ON_LINE_M: f32 = 1e-3;

/// The reflected ray at the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// `h` of eq. 7: unit vector from the robot to the point of reflection.
    pub direction: [f32; 2],
    /// The point of reflection.
    pub point_m: [f32; 2],
    /// Gradient of the direction's angle by `p_x, p_y, t_x, t_y, m, c`.
    pub gradient: [f32; 6],
}

/// Eq. 7 with the gradient of its angle.
///
/// # Errors
/// [`Degenerate::Vertical`] for a line too steep for `m`, [`Degenerate::OnLine`] where there is no direction.
pub fn reflect(p: [f32; 2], t: [f32; 2], [m, c]: [f32; 2]) -> Result<Ray, Degenerate> {
    if !(libm::fabsf(m) < SLOPE_MAX && libm::fabsf(c) < 1e6) {
        return Err(Degenerate::Vertical);
    }
    let height = |q: [f32; 2]| {
        let signed = m * q[0] - q[1] + c;
        if signed < 0.0 { (-signed, -1.0) } else { (signed, 1.0) }
    };
    let ((d, ds), (e, es)) = (height(p), height(t));
    let (a, b) = (p[0] + m * (p[1] - c), t[0] + m * (t[1] - c));
    let scale = 1.0 + m * m;
    let inverse = 1.0 / (scale * (d + e));
    let x = (e * a + d * b) * inverse;
    let y = m * x + c;
    let v = [x - p[0], y - p[1]];
    let range2 = v[0] * v[0] + v[1] * v[1];
    if !(range2 > ON_LINE_M * ON_LINE_M && range2 < 1e12) {
        return Err(Degenerate::OnLine);
    }
    // Derivatives of p_r,x: of its numerator less p_r,x times those of its denominator.
    let dx = [
        e + ds * m * (b - scale * x),
        e * m - ds * (b - scale * x),
        d + es * m * (a - scale * x),
        d * m - es * (a - scale * x),
        es * t[0] * a + e * (p[1] - c) + ds * p[0] * b + d * (t[1] - c)
            - x * (2.0 * m * (d + e) + scale * (ds * p[0] + es * t[0])),
        es * a + ds * b - m * (d + e) - x * scale * (ds + es),
    ]
    .map(|part| part * inverse);
    // dv = (dx - dp_x, m dx + x dm + dc - dp_y); the angle turns by (v_x dv_y - v_y dv_x) / |v|^2.
    let turn = 1.0 / range2;
    let (lever, [vx, vy]) = (v[0] * m - v[1], v);
    let beside = [vy, -vx, 0.0, 0.0, vx * x, vx];
    let mut gradient = [0.0; 6];
    for ((out, dx), beside) in gradient.iter_mut().zip(dx).zip(beside) {
        *out = (lever * dx + beside) * turn;
    }
    let shrink = 1.0 / sqrt(range2);
    Ok(Ray { direction: [vx * shrink, vy * shrink], point_m: [x, y], gradient })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::reflected::of_slope_intercept;
    use foxhound_core::base::ned::Horizontal;
    use foxhound_core::base::rng::Rng;

    fn case(rng: &mut Rng) -> ([f32; 2], [f32; 2], [f32; 2]) {
        let mut point = || [20.0 * rng.uniform() - 10.0, 20.0 * rng.uniform() - 10.0];
        let (p, t) = (point(), point());
        (p, t, [2.0 * rng.gaussian(), 6.0 * rng.gaussian()])
    }

    #[test]
    fn the_point_satisfies_eq_4_and_6_wherever_transponder_and_robot_are() {
        let mut rng = Rng::new(1, 24);
        let mut cases = 0;
        for _ in 0..2000 {
            let (p, t, [m, c]) = case(&mut rng);
            let Ok(ray) = reflect(p, t, [m, c]) else { continue };
            let r = ray.point_m;
            let along = |q: [f32; 2]| {
                let v = [r[0] - q[0], r[1] - q[1]];
                (v[0] + m * v[1]) / v[0].hypot(v[1])
            };
            let (back, on) = ((r[0] - t[0]).hypot(r[1] - t[1]), (r[0] - p[0]).hypot(r[1] - p[1]));
            if back < 0.1 || on < 0.1 {
                continue;
            }
            cases += 1;
            assert!((along(t) + along(p)).abs() < 2e-3 * (1.0 + m * m), "{p:?} {t:?} {m} {c}");
            assert!((r[1] - m * r[0] - c).abs() < 1e-3);
        }
        assert!(cases > 1800, "{cases}");
    }

    #[test]
    fn it_is_the_direction_of_the_mirror_image() {
        let mut rng = Rng::new(2, 24);
        let mut cases = 0;
        for _ in 0..2000 {
            let (p, t, [m, c]) = case(&mut rng);
            let line = of_slope_intercept([m, c]);
            let ned = |q: [f32; 2]| Horizontal { north: q[1], east: q[0] };
            if line.distance_m(ned(p)) * line.distance_m(ned(t)) < 0.01 {
                continue;
            }
            let ray = reflect(p, t, [m, c]).unwrap();
            let to = line.mirror(ned(t)).minus(ned(p));
            assert!(to.times(1.0 / to.norm()).minus(ned(ray.direction)).norm() < 1e-3, "{p:?} {t:?} {m} {c}");
            cases += 1;
        }
        assert!(cases > 500, "{cases}");
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        // Eq. 4-7 again, in f64: the direction to the image, on whichever side.
        let angle = |x: [f64; 6]| -> f64 {
            let [px, py, tx, ty, m, c] = x;
            let height = |qx: f64, qy: f64| (m * qx - qy + c).abs();
            let (d, e) = (height(px, py), height(tx, ty));
            let foot = |qx: f64, qy: f64| (qx + m * (qy - c)) / (1.0 + m * m);
            let rx = (e * foot(px, py) + d * foot(tx, ty)) / (d + e);
            (m * rx + c - py).atan2(rx - px)
        };
        let mut rng = Rng::new(3, 24);
        for _ in 0..1000 {
            let (p, t, [m, c]) = case(&mut rng);
            let Ok(ray) = reflect(p, t, [m, c]) else { continue };
            let height = |q: [f32; 2]| (m * q[0] - q[1] + c).abs() / (1.0 + m * m).sqrt();
            if height(p) < 0.3 || height(t) < 0.3 {
                continue;
            }
            let x = [p[0], p[1], t[0], t[1], m, c].map(f64::from);
            for i in 0..6 {
                let (mut up, mut down) = (x, x);
                (up[i], down[i]) = (x[i] + 1e-6, x[i] - 1e-6);
                let turn = (angle(up) - angle(down) + 9.0 * std::f64::consts::TAU + 3.0) % std::f64::consts::TAU - 3.0;
                let expected = turn / 2e-6;
                let error = (f64::from(ray.gradient[i]) - expected).abs();
                assert!(error < 2e-3 * (1.0 + expected.abs()), "{i}: {} {expected}", ray.gradient[i]);
            }
        }
    }

    #[test]
    fn steep_lines_and_robots_on_the_line_are_told() {
        assert_eq!(reflect([1.0, 2.0], [3.0, 4.0], [f32::INFINITY, 0.0]), Err(Degenerate::Vertical));
        assert_eq!(reflect([1.0, 2.0], [3.0, 4.0], [f32::NAN, 0.0]), Err(Degenerate::Vertical));
        assert_eq!(reflect([1.0, 2.0], [3.0, 4.0], [2e3, 0.0]), Err(Degenerate::Vertical));
        assert_eq!(reflect([1.0, 0.5], [3.0, 4.0], [0.5, 0.0]), Err(Degenerate::OnLine));
        assert_eq!(reflect([1.0, 0.5], [3.0, 1.5], [0.5, 0.0]), Err(Degenerate::OnLine), "both on it: zero over zero");
    }
}
