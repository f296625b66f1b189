//! The rollouts of the planner and a whole replan among obstacles.

use core::f32::consts::TAU;
use core::hint::black_box;

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Disc;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::localize::source::{Sighting, polar};
use foxhound_core::planning::field::{Field, Gains};
use foxhound_core::planning::planner::{self, PlanRequest, Planner, SAMPLES, Workspace};
use foxhound_core::planning::rollout::{Cost, Scene, WAYPOINTS};

use crate::{FORESTS, OBSTACLES, forest, row};

/// Ten rollouts with their costs, the worst of some maps of 64 circles at one per square metre with the vehicle in the
/// middle.
#[inline(never)]
pub(super) fn rollouts(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let mut worst = 0;
    for seed in 0..FORESTS {
        let mut rng = Rng::new(seed, 11);
        let obstacles = forest(&mut rng);
        let target = Horizontal::from_bearing(wrap_pi(TAU * rng.uniform())).times(2.0);
        let fields = [(); SAMPLES].map(|()| draw(&planner::Config::default(), &mut rng));
        let mut samples = [([Horizontal::default(); WAYPOINTS], Cost::default()); SAMPLES];
        let mut scene = Scene::new();
        worst = worst.max(measure(&mut || {
            scene.gather_all(Horizontal::default(), black_box(&obstacles));
            for (sample, field) in samples.iter_mut().zip(black_box(&fields)) {
                *sample = scene.roll(field, target);
            }
        }));
        black_box(&samples);
    }
    row("rollouts_64", worst, 100_000);
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
