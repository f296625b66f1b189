//! The belief-space planner among 64 obstacles: one iteration over 50 steps, the worst of all iterations of some problems, and
//! a whole solve over 20 steps, as a flight would have it.

use core::hint::black_box;

use crate::halt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Obstacle;
use foxhound_core::base::rng::Rng;
use foxhound_core::planning::ilqr::{Bound, Config, Guess, Outcome, Problem, Workspace};

use super::{forest, row};

const STEPS: usize = 50;
const PROBLEMS: u64 = 4;
const ITERATIONS: u16 = 16;

fn config(iterations_max: u16) -> Config {
    Config {
        q_terminal: 50.0,
        r_control: 1.0,
        t_covariance: [5.0, 5.0],
        u_max_m: 0.35,
        bound: Bound::Norm,
        n_std: 0.5,
        process_noise_m2: [1e-4, 0.0],
        iterations_max,
        ..Config::default()
    }
}

#[inline(never)]
pub(super) fn rows(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    row("belief_5_iteration", iteration(measure), 110_000);
    row("belief_5_solve_20", solve(measure), 470_000);
}

/// What an iteration adds to a solve that ends before it.
#[inline(never)]
fn iteration(measure: &impl Fn(&mut dyn FnMut()) -> u32) -> u32 {
    let mut workspace = Workspace::<3, STEPS>::new();
    let mut worst = 0;
    for seed in 0..PROBLEMS {
        let mut rng = Rng::new(seed, 17);
        let obstacles = forest(&mut rng);
        let problem = problem(&obstacles, seed, &mut rng);
        let mut before = None;
        for iterations_max in 1..=ITERATIONS {
            let Ok(planner) = config(iterations_max).build() else { return 0 };
            let (mut outcome, mut iterations) = (Outcome::Refused, 0);
            let count = measure(&mut || {
                let solution = planner.solve(&mut workspace, black_box(&problem));
                (outcome, iterations) = (solution.outcome, solution.iterations);
            });
            if outcome == Outcome::Refused {
                halt(format_args!("the belief-space planner refuses a problem"));
            }
            if let Some(before) = before {
                if iterations < iterations_max {
                    break;
                }
                worst = worst.max(count.saturating_sub(before));
            }
            before = Some(count);
        }
    }
    worst
}

/// Of the whole solve, and not more than ten iterations.
#[inline(never)]
fn solve(measure: &impl Fn(&mut dyn FnMut()) -> u32) -> u32 {
    let mut workspace = Workspace::<3, 20>::new();
    let Ok(planner) = config(10).build() else { return 0 };
    let mut worst = 0;
    for seed in 0..PROBLEMS {
        let mut rng = Rng::new(seed, 17);
        let obstacles = forest(&mut rng);
        let problem = Problem { steps: 20, ..problem(&obstacles, seed, &mut rng) };
        worst = worst.max(measure(&mut || {
            black_box(planner.solve(&mut workspace, black_box(&problem)).outcome);
        }));
    }
    worst
}

fn problem<'a>(obstacles: &'a [Obstacle], seed: u64, rng: &mut Rng) -> Problem<'a, 3> {
    Problem {
        start_ned_m: Horizontal { north: -4.5, east: -4.5 },
        source_ned_m: Horizontal { north: 5.0, east: 9.0 * rng.uniform() - 4.5 },
        covariance_m2: [0.04, 0.01, 0.09],
        goal_ned_m: Horizontal { north: 4.5, east: 4.5 },
        steps: STEPS,
        obstacles,
        seen_through: None,
        guess: Guess::Bow(1.0 - 0.5 * seed as f32),
    }
}
