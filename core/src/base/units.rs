//! Angles: the one place where they wrap, and the sine and cosine that host and target share.

use core::f32::consts::{FRAC_2_PI, FRAC_PI_2, PI, TAU};

use crate::base::math::sqrt;

/// Degrees in one radian.
pub const DEG_PER_RAD: f32 = 180.0 / PI;

/// Wraps an angle to (-pi, pi]. Meant for angles within a few turns of zero; non-finite stays non-finite.
#[must_use]
#[inline(never)]
pub fn wrap_pi(angle_rad: f32) -> f32 {
    // Adding zero makes zero of minus zero.
    if libm::fabsf(angle_rad) < 3.1 {
        return angle_rad + 0.0;
    }
    let turns = angle_rad / TAU;
    // Numbers so large are whole, and no conversion holds them.
    let turns = if libm::fabsf(turns) < 8_388_608.0 { nearest(turns) as f32 } else { turns };
    let wrapped = (angle_rad + 0.0) - turns * TAU;
    if wrapped <= -PI {
        wrapped + TAU
    } else if wrapped > PI {
        wrapped - TAU
    } else {
        wrapped
    }
}

/// The largest whole number not above `x`: `libm::floorf` for `|x| < 2^23`, in a quarter of its instructions.
#[must_use]
#[inline]
pub fn whole_below(x: f32) -> i32 {
    let whole = x as i32;
    whole.saturating_sub(i32::from(x < whole as f32))
}

/// The nearest whole number, halves away from zero: `libm::roundf` for `|x| < 2^23`, in a quarter of its instructions.
#[must_use]
#[inline(always)]
pub fn nearest(x: f32) -> i32 {
    // The largest number below a half: with a half, a value just below one would be rounded twice.
    const BELOW_HALF: f32 = 0.5 - 0.25 * f32::EPSILON;
    (x + libm::copysignf(BELOW_HALF, x)) as i32
}

/// Sine and cosine, for `|angle| <= 1000 rad`, each within 2e-6 of the truth for the first turns.
///
/// Our own, because `libm`'s go through `f64`, which this core has in software only: 1 240 to 2 190 instructions a
/// call against about 40. Reduction to [-pi/4, pi/4] in two steps, then the minimax polynomials of the Cephes library's
/// single-precision functions.
#[must_use]
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    sin_cos_inlined(angle_rad)
}

/// [`sin_cos`] without a call, for the innermost loops of another crate.
#[must_use]
#[inline(always)]
pub fn sin_cos_inlined(angle_rad: f32) -> (f32, f32) {
    let index = nearest(angle_rad * FRAC_2_PI);
    let quadrant = index as f32;
    // pi/2 in three parts, so that the products are exact for the quadrants that matter. Adding zero makes zero of minus
    // zero.
    let x = (((angle_rad + 0.0) - quadrant * 1.570_312_5) - quadrant * 4.837_513e-4) - quadrant * 7.549_789_4e-8;
    let x2 = x * x;
    let sine = x + x * x2 * (-1.666_665_5e-1 + x2 * (8.332_161e-3 - x2 * 1.951_529_6e-4));
    let cosine = 1.0 - 0.5 * x2 + x2 * x2 * (4.166_664_6e-2 + x2 * (-1.388_731_6e-3 + x2 * 2.443_315_7e-5));
    match index & 3 {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

/// The angle in [0, pi/2] whose sine is `x`, for `x` in [0, 1], within 4e-7 rad of the truth.
///
/// Below a half the same bits as `libm::asinf`, which above it uses `f64`: 3 KB of software that nothing else needs.
#[must_use]
pub fn asin(x: f32) -> f32 {
    if x < 0.5 { asin_small(x) } else { FRAC_PI_2 - 2.0 * asin_small(sqrt(0.5 * (1.0 - x))) }
}

fn asin_small(x: f32) -> f32 {
    let x2 = x * x;
    let p = x2 * (1.666_658_7e-1 + x2 * (-4.274_342_2e-2 + x2 * -8.656_363e-3));
    x + x * (p / (1.0 + x2 * -7.066_296_3e-1))
}

/// `value` within limits. `clamp` would panic if the limits have crossed or are NaN.
#[must_use]
pub fn between(value: f32, low: f32, high: f32) -> f32 {
    if value > high {
        high
    } else if value < low {
        low
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_direction_and_the_half_open_range() {
        for k in -4000..4000 {
            let angle = k as f32 * 0.005;
            let wrapped = wrap_pi(angle);
            assert!(wrapped > -PI && wrapped <= PI, "{angle} -> {wrapped}");
            assert!((f64::from(wrapped) - f64::from(angle)).rem_euclid(std::f64::consts::TAU).sin().abs() < 1e-5);
        }
        assert_eq!(wrap_pi(PI), PI);
        assert!(wrap_pi(-PI) > 0.0);
    }

    #[test]
    fn the_nearest_whole_number_is_that_of_libm() {
        let halves = (-40..=40).map(|k| k as f32 * 0.5);
        let around = halves.flat_map(|x| [-1, 0, 1].map(|ulps| f32::from_bits(x.to_bits().wrapping_add_signed(ulps))));
        let all = around.chain((-100_000..100_000).map(|k| k as f32 * 0.013_7)).chain([8e6, -8e6, 8_388_607.5]);
        for x in all.filter(|x| x.is_finite()) {
            assert_eq!(nearest(x) as f32, libm::roundf(x), "{x}");
            assert_eq!(whole_below(x) as f32, libm::floorf(x), "{x}");
        }
    }

    #[test]
    fn what_is_no_angle_stays_none_and_zero_has_no_sign() {
        for angle in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!wrap_pi(angle).is_finite());
            let (s, c) = sin_cos(angle);
            assert!(s.is_nan() && c.is_nan(), "{angle}: {s} {c}");
        }
        assert!(wrap_pi(-0.0).is_sign_positive() && sin_cos(-0.0).0.is_sign_positive());
    }

    #[test]
    fn sine_and_cosine_agree_with_f64() {
        let mut worst = 0.0_f64;
        for k in -40_000..40_000 {
            let angle = k as f32 * 3e-4;
            let (s, c) = sin_cos(angle);
            let truth = f64::from(angle).sin_cos();
            worst = worst.max((f64::from(s) - truth.0).abs()).max((f64::from(c) - truth.1).abs());
        }
        assert!(worst < 2e-6, "{worst:e}");
    }

    #[test]
    fn the_arc_sine_is_that_of_libm_below_a_half_and_agrees_with_f64_above() {
        for k in 0..=100_000 {
            let x = k as f32 * 1e-5;
            if x < 0.5 {
                assert_eq!(asin(x).to_bits(), libm::asinf(x).to_bits(), "{x}");
            }
            assert!((f64::from(asin(x)) - f64::from(x).asin()).abs() < 4e-7, "{x}: {}", asin(x));
        }
        for tiny in [0.0, 1e-45, 1e-38, 1e-20, 2.4e-4] {
            assert_eq!(asin(tiny).to_bits(), libm::asinf(tiny).to_bits(), "{tiny}");
        }
        assert!(asin(f32::NAN).is_nan() && asin(1.000_1).is_nan());
    }
}
