//! The main paper's planner (section III-B, Algorithm 2) and what it is compared with: the initial trajectory alone, in the
//! paper's field and in those of the variants paper.
//!
//! Gains are drawn inside limits (eq. 38-40), each set's trajectory is costed (eq. 41-45) and weighed (eq. 46), the weighted
//! offsets make an average (eq. 47), and the sampled trajectory nearest to that is followed. Neither checks anything: the
//! paper holds that sampled trajectories cannot cross obstacles, but with finite steps they do.
//!
//! Line 1 of Algorithm 2 puts the temporary target on the goal, the text puts it two metres along the bearing. The latter is
//! built: the request brings it. When it comes within range of a goal whose place is known, or would lie behind it, it
//! becomes the goal.

use super::{Config, Kind, Plan, PlanRequest, SAMPLES, Scratch, Verdict};
use crate::base::ned::Horizontal;
use crate::base::obstacle::Obstacle;
use crate::base::rng::Rng;
use crate::planning::field::{self, Exponent, Field, Gains, Law};
use crate::planning::rollout::{Reading, Trajectory, WAYPOINTS};

/// Draws of one parameter before its limit is taken instead; the paper draws "until".
const DRAWS_MAX: usize = 8;

/// Range of the goal within which the temporary target becomes it.
const END_RANGE_M: f32 = 0.5;

/// How `|T_j - T_init|` of eq. 47 is read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Offsets {
    /// As the signed offset, point by point.
    #[default]
    Signed,
    /// To the letter, as a distance, which is then added to both coordinates of a point.
    Scalar,
}

/// Every planner that [`Config::named`] knows: ours, the paper's and its baseline with their readings (of eq. 47, then of
/// "gradient descent": [`Reading::Quarters`] and [`Reading::Gradient`]), and the baseline in the other fields.
pub const NAMES: [&str; 16] = [
    "foxhound",
    "paper",
    "paper_scalar",
    "paper_quarters",
    "paper_gradient",
    "standard",
    "standard_quarters",
    "standard_gradient",
    "inverse_distance",
    "khatib",
    "rizqi",
    "sun",
    "sun_0",
    "sun_half",
    "sun_1",
    "virtual_force",
];

impl Config {
    /// A planner by its name in [`NAMES`].
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        let paper = Self::of(Kind::Paper);
        let standard = Self::of(Kind::Standard);
        let sun = |exponent, k_rep| standard.in_field(Law { exponent, ..Law::of(field::Kind::Sun) }, k_rep);
        Some(match name {
            "foxhound" => Self::of(Kind::Foxhound),
            "paper" => paper,
            "paper_scalar" => Self { offsets: Offsets::Scalar, ..paper },
            "paper_quarters" => paper.in_quarters(),
            "paper_gradient" => Self { reading: Reading::Gradient, ..paper },
            "standard" => standard,
            "standard_quarters" => standard.in_quarters(),
            "standard_gradient" => Self { reading: Reading::Gradient, ..standard },
            "inverse_distance" => standard.in_field(Law::of(field::Kind::InverseDistance), 0.08),
            "khatib" => standard.in_field(Law::of(field::Kind::Khatib), 0.064),
            "rizqi" => standard.in_field(Law::of(field::Kind::Rizqi), 0.064),
            "sun" => sun(Exponent::Two, 0.016),
            "sun_0" => sun(Exponent::Zero, 0.064),
            "sun_half" => sun(Exponent::Half, 0.045),
            "sun_1" => sun(Exponent::One, 0.032),
            "virtual_force" => standard.in_field(Law::of(field::Kind::VirtualForce), 1.33),
            _ => return None,
        })
    }

    /// In another field. The variants paper prints no gains: they repel at half the range (of a circle of 0.35 m, two metres
    /// from the target) as the main paper's field does.
    fn in_field(self, law: Law, k_rep: f32) -> Self {
        Self { law, gains: Gains { k_rep, ..self.gains }, ..self }
    }

    /// With four force evaluations from waypoint to waypoint, and the gains that suit them.
    fn in_quarters(self) -> Self {
        Self {
            reading: Reading::Quarters,
            gains: Gains { k_rep: 0.05, influence_m: 0.3, ..self.gains },
            gains_sigma: Gains { k_rep: 0.025, influence_m: 0.12, ..self.gains_sigma },
            ..self
        }
    }
}

/// Answers one request.
pub(super) fn plan(config: &Config, scratch: &mut Scratch, request: &PlanRequest) -> Plan {
    let target = target(request);
    let circles = request.circles.iter();
    scratch.scene.gather(request.start_ned_m, circles.map(|circle| Obstacle::of(circle, config.vehicle_radius_m)));
    let field = |gains| Field { law: config.law, gains };
    let (initial, cost) = scratch.scene.roll(&field(config.gains), config.reading, target);
    scratch.initial = initial;
    let mut plan = Plan {
        verdict: Verdict::Follow,
        waypoints_ned_m: initial,
        cost: cost.total(),
        target_ned_m: target,
        ..Plan::brake(config, request)
    };
    if config.kind == Kind::Standard {
        return plan;
    }

    let mut rng = Rng::new(request.seed, u64::from(request.id));
    for index in 0..SAMPLES {
        let gains = draw(config, &mut rng);
        let (trajectory, cost) = scratch.scene.roll(&field(gains), config.reading, target);
        scratch.gains[index] = gains;
        scratch.samples[index] = trajectory;
        scratch.costs[index] = cost.total();
        scratch.feasible[index] = true;
    }
    if let Some(optimal) = average(scratch, config.lambda, config.offsets) {
        scratch.choose(nearest(scratch, &optimal), &mut plan);
    } else {
        // A request that is not finite.
        plan.verdict = Verdict::Brake;
        plan.waypoints_ned_m = [request.start_ned_m; WAYPOINTS];
    }
    plan
}

/// The temporary target, or the goal at the end of the way.
fn target(request: &PlanRequest) -> Horizontal {
    let (start, temporary) = (request.start_ned_m, request.target_ned_m);
    match request.known_source_ned_m {
        Some(goal)
            if goal.minus(temporary).norm() <= END_RANGE_M
                || goal.minus(start).norm_squared() < temporary.minus(start).norm_squared() =>
        {
            goal
        }
        _ => temporary,
    }
}

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
    average(scratch, lambda, Offsets::Signed)
}

fn average(scratch: &Scratch, lambda: f32, reading: Offsets) -> Option<Trajectory> {
    let samples = || scratch.samples.iter().zip(&scratch.costs).zip(&scratch.feasible);
    let chosen = || samples().filter(|(_, feasible)| **feasible).map(|(sample, _)| sample);
    // Weights relative to the best, so that they cannot all vanish.
    let best = chosen().map(|(_, cost)| *cost).fold(f32::INFINITY, |a, b| if b < a { b } else { a });
    if !best.is_finite() {
        return None;
    }
    let mut optimal = scratch.initial;
    let mut total = 0.0;
    let mut offsets = [Horizontal::default(); WAYPOINTS];
    for (sample, cost) in chosen() {
        let weight = libm::expf((best - cost) / lambda);
        total += weight;
        for ((sum, sample), initial) in offsets.iter_mut().zip(sample).zip(&scratch.initial) {
            let offset = sample.minus(*initial);
            let offset = match reading {
                Offsets::Signed => offset,
                Offsets::Scalar => {
                    let distance = offset.norm();
                    Horizontal { north: distance, east: distance }
                }
            };
            *sum = sum.plus(offset.times(weight));
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
    for (j, (sample, feasible)) in scratch.samples.iter().zip(&scratch.feasible).enumerate() {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::obstacle::Circle;
    use std::vec::Vec as StdVec;

    fn request(seed: u64) -> PlanRequest {
        let mut rng = Rng::new(seed, 78);
        let circles = (0..6)
            .map(|_| Circle {
                center_ned_m: Horizontal { north: 0.4 + 2.0 * rng.uniform(), east: -1.0 + 2.0 * rng.uniform() },
                radius_m: 0.1 + 0.2 * rng.uniform(),
                ..Circle::default()
            })
            .collect();
        PlanRequest {
            id: 1,
            seed,
            target_ned_m: Horizontal { north: 2.0, east: 0.0 },
            circles,
            ..PlanRequest::default()
        }
    }

    fn run(name: &str, request: &PlanRequest) -> (Plan, Scratch) {
        let mut scratch = Scratch::default();
        let plan = Config::named(name).unwrap().build().unwrap().plan(&mut scratch, request);
        (plan, scratch)
    }

    #[test]
    fn every_name_is_a_planner_that_flies_and_no_two_are_the_same() {
        let plans: StdVec<StdVec<Trajectory>> = NAMES
            .iter()
            .map(|name| (0..30).map(|seed| run(name, &request(seed)).0.waypoints_ned_m).collect())
            .collect();
        for (i, paths) in plans.iter().enumerate() {
            assert!(paths.iter().flatten().all(|w| w.is_finite()), "{}", NAMES[i]);
            for (j, others) in plans.iter().enumerate().skip(i + 1) {
                assert_ne!(Config::named(NAMES[i]), Config::named(NAMES[j]));
                // Sun's factor to the power of zero is Khatib's field.
                let twins = (NAMES[i], NAMES[j]) == ("khatib", "sun_0");
                assert_eq!(paths == others, twins, "{} {}", NAMES[i], NAMES[j]);
            }
        }
        assert_eq!(Config::named("bug"), None);
    }

    #[test]
    fn the_standard_planner_follows_its_field_without_sampling() {
        let request = request(3);
        for name in ["standard", "khatib", "rizqi", "sun", "virtual_force", "inverse_distance", "standard_quarters"] {
            let (plan, scratch) = run(name, &request);
            let config = Config::named(name).unwrap();
            let obstacles: StdVec<Obstacle> = scratch.scene.obstacles().collect();
            let field = Field { law: config.law, gains: config.gains };
            let (start, target) = (request.start_ned_m, request.target_ned_m);
            let plain = crate::planning::rollout::roll_plainly(&field, config.reading, start, target, &obstacles);
            assert_eq!(plan.waypoints_ned_m, plain, "{name}");
        }
    }

    #[test]
    fn read_to_the_letter_equation_47_moves_every_point_to_the_north_east() {
        let (mut moved, mut other) = (0, 0);
        for seed in 0..200 {
            let (plan, scratch) = run("paper_scalar", &request(seed));
            let optimal = average(&scratch, 1.0, Offsets::Scalar).unwrap();
            for (point, initial) in optimal.iter().zip(&scratch.initial) {
                let offset = point.minus(*initial);
                assert!(offset.north >= 0.0 && (offset.north - offset.east).abs() < 1e-5);
                moved += i32::from(offset.north > 0.05);
            }
            other += i32::from(plan.waypoints_ned_m != run("paper", &request(seed)).0.waypoints_ned_m);
        }
        assert!(moved > 500 && other > 20, "{moved} {other}");
    }

    #[test]
    fn the_temporary_target_becomes_a_known_goal_within_its_range_and_not_before() {
        let target = |north| {
            let goal = Some(Horizontal { north, east: 0.1 });
            let (plan, _) = run("paper", &PlanRequest { known_source_ned_m: goal, ..request(1) });
            plan.target_ned_m
        };
        assert_eq!(target(2.4), Horizontal { north: 2.4, east: 0.1 });
        assert_eq!(target(0.7), Horizontal { north: 0.7, east: 0.1 });
        assert_eq!(target(2.6), Horizontal { north: 2.0, east: 0.0 });
    }

    /// Eq. 41-44 in f64, with what eq. 45 gave.
    fn exact_cost(start: Horizontal, sample: &Trajectory, target: Horizontal, proximity: f64) -> f64 {
        let (mut total, mut heading) = (proximity, None::<f64>);
        let mut previous = start;
        let double = |a: Horizontal| (f64::from(a.north), f64::from(a.east));
        for waypoint in sample {
            let (to, from) = (double(*waypoint), double(previous));
            let step = (to.0 - from.0, to.1 - from.1);
            total += step.0.hypot(step.1);
            if step.0.hypot(step.1) > 1e-4 {
                let bearing = step.1.atan2(step.0);
                if let Some(heading) = heading {
                    let turn = (bearing - heading).abs();
                    total += turn.min(std::f64::consts::TAU - turn);
                }
                heading = Some(bearing);
            }
            previous = *waypoint;
        }
        let (end, target) = (double(previous), double(target));
        total + (end.0 - target.0).hypot(end.1 - target.1)
    }

    #[test]
    fn the_cheap_roots_and_angles_of_the_cost_never_change_the_choice() {
        for seed in 0..3000 {
            let request = request(seed);
            let (_, mut scratch) = run("paper", &request);
            let chosen = nearest(&scratch, &weighted(&scratch, 1.0).unwrap());
            let (start, target) = (request.start_ned_m, request.target_ned_m);
            let obstacles: StdVec<Obstacle> = request.circles.iter().map(|c| Obstacle::of(c, 0.15)).collect();
            for (sample, cost) in scratch.samples.iter().zip(&mut scratch.costs) {
                let closest = obstacles
                    .iter()
                    .flat_map(|o| {
                        sample.iter().map(move |w| {
                            let north = f64::from(w.north) - f64::from(o.center_ned_m.north);
                            let east = f64::from(w.east) - f64::from(o.center_ned_m.east);
                            north.hypot(east) - f64::from(o.reach_m)
                        })
                    })
                    .fold(f64::INFINITY, f64::min);
                let exact = exact_cost(start, sample, target, 1.0 / closest.max(0.01));
                assert!((exact - f64::from(*cost)).abs() < 1e-4 * exact, "{cost} {exact}");
                *cost = exact as f32;
            }
            assert_eq!(nearest(&scratch, &weighted(&scratch, 1.0).unwrap()), chosen, "seed {seed}");
        }
    }
}
