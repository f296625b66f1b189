//! The parts of the main paper's Algorithm 2 that fly: gains are drawn, trajectories weighted by their costs, and one
//! is chosen.

use super::{Config, GAINS_MIN, Workspace};
use crate::base::ned::Horizontal;
use crate::base::rng::Rng;
use crate::planning::field::Gains;
use crate::planning::rollout::{Trajectory, WAYPOINTS};

/// Largest number of draws of one parameter before its limit is used instead; the paper draws without a bound
/// ("until").
const DRAWS_MAX: usize = 8;
/// Temperature of eq. 46, in units of the cost.
const LAMBDA: f32 = 1.0;

/// One set of gains (eq. 38-40), each drawn until it is above its limit.
pub fn draw(c: &Config, rng: &mut Rng) -> Gains {
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
        k_att: above(c.gains.k_att, c.gains_sigma.k_att, GAINS_MIN.k_att),
        k_rep: above(c.gains.k_rep, c.gains_sigma.k_rep, GAINS_MIN.k_rep),
        influence_m: above(c.gains.influence_m, c.gains_sigma.influence_m, GAINS_MIN.influence_m),
        swirl: c.gains.swirl + c.gains_sigma.swirl * rng.gaussian(),
    }
}

/// Eq. 46 and 47: the initial trajectory plus the weighted mean of the offsets of the feasible samples; `None` if there
/// are none.
pub(super) fn weighted(workspace: &Workspace) -> Option<Trajectory> {
    average(workspace, |offset| offset)
}

/// The same with another interpretation of a point's offset: `read` converts it.
#[must_use]
#[inline(always)]
pub fn average(workspace: &Workspace, read: impl Fn(Horizontal) -> Horizontal) -> Option<Trajectory> {
    let samples = || workspace.samples.iter().zip(&workspace.costs).zip(&workspace.feasible);
    let chosen = || samples().filter(|(_, feasible)| **feasible).map(|(sample, _)| sample);
    // Weights relative to the best, so that they cannot all underflow.
    let best = chosen().map(|(_, cost)| *cost).fold(f32::INFINITY, |a, b| if b < a { b } else { a });
    if !best.is_finite() {
        return None;
    }
    let mut optimal = workspace.initial;
    let mut total = 0.0;
    let mut offsets = [Horizontal::default(); WAYPOINTS];
    for (sample, cost) in chosen() {
        let weight = libm::expf((best - cost) / LAMBDA);
        total += weight;
        for ((sum, sample), initial) in offsets.iter_mut().zip(sample).zip(&workspace.initial) {
            *sum = sum.plus(read(sample.minus(*initial)).times(weight));
        }
    }
    for (point, offset) in optimal.iter_mut().zip(offsets) {
        *point = point.plus(offset.times(1.0 / total));
    }
    Some(optimal)
}

/// Line 16 of Algorithm 2: the sample nearest to the average, by the sum of the distances of its points.
pub fn nearest(workspace: &Workspace, optimal: &Trajectory) -> usize {
    let (mut chosen, mut least) = (0, f32::INFINITY);
    for (j, (sample, feasible)) in workspace.samples.iter().zip(&workspace.feasible).enumerate() {
        if !feasible {
            continue;
        }
        let distance = sample.iter().zip(optimal).map(|(a, b)| a.minus(*b).norm()).sum::<f32>();
        if distance < least {
            (chosen, least) = (j, distance);
        }
    }
    chosen
}
