//! The main paper's sampling (section III-B, Algorithm 2): gains drawn inside limits, trajectories weighed and averaged.

use super::{Config, SAMPLES, Scratch};
use crate::field::Gains;
use crate::frame::Horizontal;
use crate::rng::Rng;
use crate::rollout::{Trajectory, WAYPOINTS};

/// Draws of one parameter before its limit is taken instead; the paper draws "until".
const DRAWS_MAX: usize = 8;

/// One set of gains (eq. 38-40), each drawn until it is above its limit.
pub(super) fn draw(c: &Config, rng: &mut Rng) -> Gains {
    let mut above = |mean: f32, sigma: f32, min: f32| {
        let mut value = min;
        for _ in 0..DRAWS_MAX {
            let drawn = mean + sigma * rng.gaussian();
            if drawn > min {
                value = drawn;
                break;
            }
        }
        value
    };
    Gains {
        k_att: above(c.gains.k_att, c.gains_sigma.k_att, c.gains_min.k_att),
        k_rep: above(c.gains.k_rep, c.gains_sigma.k_rep, c.gains_min.k_rep),
        influence_m: above(c.gains.influence_m, c.gains_sigma.influence_m, c.gains_min.influence_m),
        swirl: c.gains.swirl + c.gains_sigma.swirl * rng.gaussian(),
    }
}

/// Eq. 46 and 47: the initial trajectory plus the weighted mean of the offsets of those that may be chosen; `None` if
/// there are none.
pub(super) fn weighted(scratch: &Scratch, lambda: f32) -> Option<Trajectory> {
    let chosen = || (0..SAMPLES).filter(|j| scratch.feasible[*j]);
    // Weights relative to the best, so that they cannot all vanish.
    let best = chosen().map(|j| scratch.costs[j]).fold(f32::INFINITY, |a, b| if b < a { b } else { a });
    if !best.is_finite() {
        return None;
    }
    let mut optimal = scratch.initial;
    let mut total = 0.0;
    let mut offsets = [Horizontal::default(); WAYPOINTS];
    for j in chosen() {
        let weight = libm::expf((best - scratch.costs[j]) / lambda);
        total += weight;
        for ((offset, sample), initial) in offsets.iter_mut().zip(&scratch.samples[j]).zip(&scratch.initial) {
            *offset = offset.plus(sample.minus(*initial).times(weight));
        }
    }
    for (point, offset) in optimal.iter_mut().zip(offsets) {
        *point = point.plus(offset.times(1.0 / total));
    }
    Some(optimal)
}

/// Line 16 of Algorithm 2: the sample nearest to the average, by the sum of the distances of its points.
pub(super) fn nearest(scratch: &Scratch, optimal: &Trajectory) -> usize {
    let (mut chosen, mut least) = (0, f32::INFINITY);
    for (j, sample) in scratch.samples.iter().enumerate() {
        if !scratch.feasible[j] {
            continue;
        }
        let distance = sample.iter().zip(optimal).map(|(a, b)| a.minus(*b).norm()).sum::<f32>();
        if distance < least {
            (chosen, least) = (j, distance);
        }
    }
    chosen
}
