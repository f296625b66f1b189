//! The functions that an update needs, by series: they take a third of the instructions of `libm`'s, which are accurate
//! for every argument.

use crate::base::ned::Horizontal;
use crate::base::units::sin_cos;

/// `tan(pi / 8)`.
const TAN_22_5: f32 = core::f32::consts::SQRT_2 - 1.0;
/// Largest angle for which the series of sine and cosine are used.
const TURN_MAX_RAD: f32 = 0.4;

/// The angle of a sine and a cosine that may have a common factor >= 0. The relative error, or the difference from
/// `libm`, is at most 2e-7.
pub(super) fn angle(sine: f32, cosine: f32) -> f32 {
    if !(libm::fabsf(sine) < TAN_22_5 * cosine) {
        return libm::atan2f(sine, cosine);
    }
    // The polynomial of the Cephes library's single-precision arctangent.
    let t = sine / cosine;
    let z = t * t;
    t + t * z * (-3.333_295e-1 + z * (1.997_771_1e-1 + z * (-1.387_768_6e-1 + z * 8.053_745e-2)))
}

/// `exp(-x)` for `x >= 0`, with a relative error of at most 1e-5; zero where it underflows in `f32`.
pub(super) fn exp_minus(x: f32) -> f32 {
    if !(x < 87.0) {
        return 0.0;
    }
    let halvings = (x * core::f32::consts::LOG2_E + 0.5) as i32;
    let r = halvings as f32 * core::f32::consts::LN_2 - x;
    let power = f32::from_bits(((127 - halvings) as u32) << 23);
    power * (1.0 + r * (1.0 + r * (0.5 + r * (1.666_666_7e-1 + r * (4.166_666_8e-2 + r * 8.333_334e-3)))))
}

/// A direction turned clockwise.
pub(super) fn turned(direction: Horizontal, turn_rad: f32) -> Horizontal {
    let (sine, cosine) = if libm::fabsf(turn_rad) < TURN_MAX_RAD {
        let z = turn_rad * turn_rad;
        let sine = turn_rad - turn_rad * z * (1.666_666_7e-1 - z * 8.333_334e-3);
        (sine, 1.0 - z * (0.5 - z * (4.166_666_8e-2 - z * 1.388_888_9e-3)))
    } else {
        sin_cos(turn_rad)
    };
    Horizontal {
        north: cosine * direction.north - sine * direction.east,
        east: cosine * direction.east + sine * direction.north,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_agree_with_f64_all_around_and_at_any_scale() {
        for k in -20_000..=20_000 {
            let truth = f64::from(k) * 1.570_7e-4;
            for scale in [1e-3, 1.0, 1e3] {
                let (sine, cosine) = ((scale * truth.sin()) as f32, (scale * truth.cos()) as f32);
                let exact = f64::from(sine).atan2(f64::from(cosine));
                let found = f64::from(angle(sine, cosine));
                assert!((found - exact).abs() < 2e-7 * exact.abs() + 1e-12, "{truth}: {found} {exact}");
            }
        }
        assert_eq!(angle(0.0, 0.0), 0.0);
        assert!(angle(f32::NAN, 1.0).is_nan() && angle(1.0, f32::NAN).is_nan());
    }

    #[test]
    fn the_exponential_agrees_with_f64_and_ends_in_zero() {
        for k in 0..87_000 {
            let x = k as f32 * 1e-3;
            let truth = (-f64::from(x)).exp();
            assert!((f64::from(exp_minus(x)) - truth).abs() < 1e-5 * truth, "{x}: {} {truth}", exp_minus(x));
        }
        assert_eq!(exp_minus(0.0), 1.0);
        for x in [87.0, 1e9, f32::INFINITY, f32::NAN] {
            assert_eq!(exp_minus(x), 0.0, "{x}");
        }
    }

    #[test]
    fn turns_are_turns_and_keep_the_length() {
        for k in -4_000..4_000 {
            let (from, turn) = (f64::from(k) * 7e-4, f64::from(k) * 7.8e-4);
            let to = turned(Horizontal { north: from.cos() as f32, east: from.sin() as f32 }, turn as f32);
            let off = (f64::from(to.north) - (from + turn).cos()).hypot(f64::from(to.east) - (from + turn).sin());
            assert!(off < 2e-6, "{from} {turn}: {off}");
        }
    }
}
