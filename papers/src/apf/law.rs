//! The laws of repulsion; their equations are in the documentation of [`super::field`].

use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::planning::field::{DISTANCE_MIN_M, Gains};
use foxhound_core::planning::planner::baseline::{Exponent, Kind, Law};

/// Checks the parameters.
///
/// # Errors
/// The field that is out of range.
pub(super) fn check_law(law: &Law) -> Result<(), ConfigError> {
    check("planner.law.core_m", law.core_m, DISTANCE_MIN_M, 100.0)?;
    check("planner.law.k_virtual", law.k_virtual, -100.0, 100.0)?;
    Ok(())
}

/// Where the force stops growing.
fn floor(law: &Law, gains: &Gains) -> f32 {
    match law.kind {
        Kind::Rizqi if law.core_m < gains.influence_m => law.core_m,
        Kind::Rizqi => 0.5 * gains.influence_m,
        _ => DISTANCE_MIN_M,
    }
}

/// Force of one obstacle along the line from it, before [`complete`]; and its share of the force across.
#[inline(never)]
pub(super) fn strength(law: &Law, gains: &Gains, distance: f32, norm: f32) -> (f32, f32) {
    let floor = floor(law, gains);
    let floored = if distance > floor { distance } else { floor };
    let inverse = 1.0 / floored;
    let above = inverse - 1.0 / gains.influence_m;
    let slope = above * inverse * inverse;
    match law.kind {
        Kind::Logarithmic => (gains.logarithmic(distance), 0.0),
        Kind::InverseDistance => (gains.k_rep * inverse * inverse, 0.0),
        Kind::Khatib | Kind::Rizqi => (gains.k_rep * slope, 0.0),
        // The share is twice the traditional potential of unit gain.
        Kind::Sun => (gains.k_rep * slope, above * above + 2.0 * slope * (floored - distance)),
        Kind::VirtualForce => (gains.k_rep * (1.0 - distance / gains.influence_m) * norm, 1.0),
    }
}

/// Completes the sums over the obstacles: the repulsion, and the force that is not along the lines from them.
#[inline(always)]
pub(super) fn complete(
    law: &Law,
    gains: &Gains,
    push: Horizontal,
    shares: f32,
    to_target: Horizontal,
) -> (Horizontal, Horizontal) {
    match law.kind {
        Kind::Sun => {
            let (factor, growth) = fade(law, to_target.norm_squared());
            (push.times(factor), to_target.times(0.5 * gains.k_rep * shares * growth))
        }
        Kind::VirtualForce => (push, Horizontal { north: law.k_virtual, east: -law.k_virtual }.times(shares)),
        _ => (push, Horizontal::default()),
    }
}

/// The factor `e^n` of a squared distance to the goal, and `n e^(n-2)`; finite at the goal.
pub(super) fn fade(law: &Law, squared: f32) -> (f32, f32) {
    if law.kind != Kind::Sun {
        return (1.0, 0.0);
    }
    let least = DISTANCE_MIN_M * DISTANCE_MIN_M;
    let error = sqrt(squared);
    let floored = if squared > least { squared } else { least };
    match law.exponent {
        Exponent::Zero => (1.0, 0.0),
        Exponent::Half => {
            let root = sqrt(sqrt(floored));
            (sqrt(error), 0.5 * root / floored)
        }
        Exponent::One => (error, 1.0 / sqrt(floored)),
        Exponent::Two => (squared, 2.0),
    }
}

/// Potential of one obstacle within its range, before the factor of [`fade`].
pub(super) fn potential(law: &Law, gains: &Gains, distance: f32, reach: f32, away: Horizontal) -> f32 {
    let (k, range) = (gains.k_rep, gains.influence_m);
    if law.kind == Kind::VirtualForce {
        let squares = range * range - distance * distance;
        let cubes = range * range * range - distance * distance * distance;
        let central =
            0.5 * squares - cubes / (3.0 * range) + reach * (range - distance) - 0.5 * reach * squares / range;
        return k * central - law.k_virtual * (away.north - away.east);
    }
    let floor = floor(law, gains);
    let floored = if distance > floor { distance } else { floor };
    let above = 1.0 / floored - 1.0 / range;
    let outside = match law.kind {
        Kind::Logarithmic => -k * libm::logf(floored / range),
        Kind::InverseDistance => k * above,
        _ => 0.5 * k * above * above,
    };
    let (slope, _) = strength(law, gains, floored, floored);
    outside + slope * (floored - distance)
}
