//! The rollouts of the planner and a whole replan among obstacles.

use core::f32::consts::TAU;
use core::hint::black_box;

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::{Disc, Obstacle};
use foxhound_core::base::rng::Rng;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::localize::source::{Sighting, polar};
use foxhound_core::planning::field::{Field, Gains};
use foxhound_core::planning::planner::{self, Kind, PlanRequest, Planner, SAMPLES, Workspace};
use foxhound_core::planning::rollout::{Cost, SPACING_M, Scene, Trajectory, WAYPOINTS};
use foxhound_firmware::board::Board as _;

use crate::{FORESTS, OBSTACLES, Twin, forest, row};

/// Ten rollouts with their costs, the worst of some maps of 64 circles at one per square metre with the vehicle in the
/// middle: the planner's, and every obstacle at every waypoint with `libm`'s functions.
#[inline(never)]
pub(super) fn rollouts(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    for (kind, row_name, naive_name) in [
        (Kind::Foxhound, "rollouts_64", "rollouts_64_naive"),
        (Kind::Paper, "rollouts_64_paper_gains", "rollouts_64_paper_gains_naive"),
    ] {
        let (mut worst, mut naive_worst) = (0, 0);
        for seed in 0..FORESTS {
            let mut rng = Rng::new(seed, 11);
            let obstacles = forest(&mut rng);
            let target = Horizontal::from_bearing(wrap_pi(TAU * rng.uniform())).times(2.0);
            let fields = [(); SAMPLES].map(|()| draw(&planner::Config::of(kind), &mut rng));
            let mut samples = [([Horizontal::default(); WAYPOINTS], Cost::default()); SAMPLES];
            let mut naive = samples;
            let mut scene = Scene::new();
            worst = worst.max(measure(&mut || {
                scene.gather_all(Horizontal::default(), black_box(&obstacles));
                for (sample, field) in samples.iter_mut().zip(black_box(&fields)) {
                    *sample = scene.roll(field, target);
                }
            }));
            naive_worst = naive_worst.max(measure(&mut || {
                for (sample, field) in naive.iter_mut().zip(black_box(&fields)) {
                    let trajectory = roll_naively(&field.gains, target, black_box(&obstacles));
                    *sample = (trajectory, cost_naively(&trajectory, target, black_box(&obstacles)));
                }
            }));
            for ((ours, our_cost), (theirs, their_cost)) in samples.iter().zip(&naive) {
                let apart_m = ours.iter().zip(theirs).map(|(a, b)| a.minus(*b).norm()).fold(0.0, f32::max);
                let costs = (our_cost.total() / their_cost.total() - 1.0).abs();
                // Where a trajectory hops from side to side, rounding grows from hop to hop.
                if apart_m > 0.01 || costs > 0.005 {
                    Twin::halt(format_args!("a rollout is {apart_m} m and {costs} of the cost from the naive one"));
                }
            }
            if cheapest(&samples) != cheapest(&naive) {
                Twin::halt(format_args!("the naive rollouts lead to another choice"));
            }
        }
        // The paper's gains reach farther: more is in range. Above the 100 000 of ours since the image is compiled for size.
        row(row_name, worst, if kind == Kind::Paper { 105_000 } else { 100_000 });
        row(naive_name, naive_worst, 0);
    }
}

/// The sample of least cost.
fn cheapest(samples: &[(Trajectory, Cost); SAMPLES]) -> Option<usize> {
    (0..SAMPLES).min_by(|a, b| samples[*a].1.total().total_cmp(&samples[*b].1.total()))
}

/// A sample of the gains.
fn draw(config: &planner::Config, rng: &mut Rng) -> Field {
    let mut above = |mean: f32, sigma: f32, least: f32| (mean + sigma * rng.gaussian()).max(least);
    let (mean, sigma, least) = (config.gains, config.gains_sigma, planner::GAINS_MIN);
    let gains = Gains {
        k_att: above(mean.k_att, sigma.k_att, least.k_att),
        k_rep: above(mean.k_rep, sigma.k_rep, least.k_rep),
        influence_m: above(mean.influence_m, sigma.influence_m, least.influence_m),
        swirl: above(mean.swirl, sigma.swirl, -100.0),
    };
    Field { gains }
}

/// Eq. 33 and 36 as they stand.
#[inline(never)]
fn roll_naively(gains: &Gains, target: Horizontal, obstacles: &[Obstacle]) -> Trajectory {
    let mut trajectory = [Horizontal::default(); WAYPOINTS];
    let mut position = Horizontal::default();
    for waypoint in &mut trajectory {
        let mut force = target.minus(position).times(gains.k_att);
        for obstacle in obstacles {
            let away = position.minus(obstacle.center_ned_m);
            let distance = away.norm() - obstacle.reach_m;
            if distance < gains.influence_m {
                let push = away.times(gains.k_rep / (distance.max(0.01) * away.norm()));
                force = force.plus(push).plus(Horizontal { north: -push.east, east: push.north }.times(gains.swirl));
            }
        }
        position = if target.minus(position).norm() <= SPACING_M {
            target
        } else if force.norm() > 1e-6 {
            position.plus(force.times(SPACING_M / force.norm()))
        } else {
            position
        };
        *waypoint = position;
    }
    trajectory
}

/// Eq. 41-45 as they stand.
#[inline(never)]
fn cost_naively(trajectory: &Trajectory, target: Horizontal, obstacles: &[Obstacle]) -> Cost {
    let mut cost = Cost::default();
    let mut previous = Horizontal::default();
    let mut heading_rad = None;
    let mut closest = f32::INFINITY;
    for waypoint in trajectory {
        let step = waypoint.minus(previous);
        if step.norm() > 1e-4 {
            if let Some(heading_rad) = heading_rad {
                cost.turns += wrap_pi(step.bearing_rad() - heading_rad).abs();
            }
            heading_rad = Some(step.bearing_rad());
        }
        cost.length += step.norm();
        previous = *waypoint;
        for obstacle in obstacles {
            closest = closest.min(waypoint.minus(obstacle.center_ned_m).norm() - obstacle.reach_m);
        }
    }
    cost.error = previous.minus(target).norm();
    cost.proximity = 1.0 / closest.max(0.01);
    cost
}

/// Sixty-four obstacles between the start and the target and around them.
#[inline(never)]
pub(super) fn replan(measure: &impl Fn(&mut dyn FnMut()) -> u32, planner: &Planner, workspace: &mut Workspace) {
    let mut rng = Rng::new(1, 1);
    let mut request = PlanRequest {
        id: 1,
        begins: true,
        target_ned_m: Horizontal { north: 2.0, east: 0.0 },
        direction_ned: Horizontal { north: 1.0, east: 0.0 },
        ..PlanRequest::default()
    };
    let mut filter = polar::State::new();
    let sighting = Sighting { direction_ned: request.direction_ned, sigma_rad: 0.03, ..Sighting::default() };
    if let Ok(stage) = polar::Config::DEFAULT.build() {
        stage.step(&mut filter, &sighting);
    }
    request.support.add(&filter, 1.0);
    let known: [Disc; OBSTACLES] = core::array::from_fn(|_| Disc {
        center_ned_m: Horizontal { north: 8.0 * rng.uniform() - 3.0, east: 8.0 * rng.uniform() - 4.0 },
        radius_m: 0.1 + 0.2 * rng.uniform(),
        ..Disc::default()
    });
    // From the same place again and again: from the ninth on some look far.
    let mut worst = 0;
    for _ in 0..12 {
        worst = worst.max(measure(&mut || {
            black_box(planner.plan(workspace, black_box(&request), black_box(&known)));
        }));
        (request.id, request.begins) = (request.id + 1, false);
    }
    row("replan_64", worst, 1_400_000);
}
