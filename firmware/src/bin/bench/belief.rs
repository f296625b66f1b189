//! The belief-space planner among 64 obstacles: one iteration over 50 steps, the worst of all iterations of some problems, and
//! a whole solve over 20 steps, as a flight would have it.

use core::hint::black_box;

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Obstacle;
use foxhound_core::base::rng::Rng;
use foxhound_core::mapping::walls::Wall;
use foxhound_core::planning::ilqr::{Bound, Config, Guess, Outcome, Problem, Workspace};
use foxhound_firmware::board::Board as _;
use foxhound_firmware::boards::mps2_an386::Machine as Twin;

use super::{OBSTACLES, forest, row};

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

/// The numbers of both beliefs. Their memory is on the stack, one after the other: the variables have no room for it beside
/// the planner's.
#[inline(never)]
pub(super) fn rows(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let five = five(measure);
    row("belief_5_iteration", five.iteration, 110_000);
    row("belief_5_mean_iteration", five.mean, 0);
    row("belief_5_solve_20", self::solve(measure), 0);
    let fourteen = fourteen(measure);
    row("belief_14_iteration", fourteen.iteration, 700_000);
    row("belief_14_mean_iteration", fourteen.mean, 0);
}

#[inline(never)]
fn five(measure: &impl Fn(&mut dyn FnMut()) -> u32) -> Worst {
    let mut workspace = Workspace::<3, STEPS>::new();
    worst([0.04, 0.01, 0.09], &mut |iterations_max, problem| {
        let Ok(planner) = config(iterations_max).build() else { return (0, Outcome::Refused, 0) };
        let (mut outcome, mut iterations) = (Outcome::Refused, 0);
        let instructions = measure(&mut || {
            let solution = planner.solve(&mut workspace, black_box(problem));
            (outcome, iterations) = (solution.outcome, solution.iterations);
        });
        (instructions, outcome, iterations)
    })
}

#[inline(never)]
fn fourteen(measure: &impl Fn(&mut dyn FnMut()) -> u32) -> Worst {
    let mut workspace = Workspace::<10, STEPS>::new();
    let covariance = [0.01, 0.0, 0.01, 0.0, 0.0, 0.5, 0.0, 0.0, 0.1, 0.4];
    worst(covariance, &mut |iterations_max, problem| {
        let Ok(planner) = config(iterations_max).build() else { return (0, Outcome::Refused, 0) };
        let (mut outcome, mut iterations) = (Outcome::Refused, 0);
        let instructions = measure(&mut || {
            let solution = planner.solve_reflected(&mut workspace, black_box(problem));
            (outcome, iterations) = (solution.outcome, solution.iterations);
        });
        (instructions, outcome, iterations)
    })
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
        let problem = Problem { steps: 20, ..problem([0.04, 0.01, 0.09], &obstacles, seed, &mut rng) };
        worst = worst.max(measure(&mut || {
            black_box(planner.solve(&mut workspace, black_box(&problem)).outcome);
        }));
    }
    worst
}

struct Worst {
    iteration: u32,
    /// Of the problem in which the mean of all iterations but the first is largest.
    mean: u32,
}

fn problem<'a, const M: usize>(
    covariance_m2: [f32; M],
    obstacles: &'a [Obstacle],
    seed: u64,
    rng: &mut Rng,
) -> Problem<'a, M> {
    let wall = Wall::between(Horizontal { north: 6.0, east: -9.0 }, Horizontal { north: 6.0, east: 9.0 });
    Problem {
        start_ned_m: Horizontal { north: -4.5, east: -4.5 },
        source_ned_m: Horizontal { north: 5.0, east: 9.0 * rng.uniform() - 4.5 },
        covariance_m2,
        goal_ned_m: Horizontal { north: 4.5, east: 4.5 },
        steps: STEPS,
        obstacles,
        seen_through: if M == 10 { wall } else { None },
        guess: Guess::Bow(1.0 - 0.5 * seed as f32),
    }
}

/// What an iteration adds to a solve that ends before it.
fn worst<const M: usize>(
    covariance_m2: [f32; M],
    solve: &mut dyn FnMut(u16, &Problem<'_, M>) -> (u32, Outcome, u16),
) -> Worst {
    let mut worst = Worst { iteration: 0, mean: 0 };
    for seed in 0..PROBLEMS {
        let mut rng = Rng::new(seed, 17);
        let obstacles: [_; OBSTACLES] = forest(&mut rng);
        let problem = problem(covariance_m2, &obstacles, seed, &mut rng);
        let (one, ..) = solve(1, &problem);
        let (mut before, mut mean) = (one, 0);
        for iterations_max in 2..=ITERATIONS {
            let (count, outcome, iterations) = solve(iterations_max, &problem);
            if iterations < iterations_max {
                break;
            }
            if outcome == Outcome::Refused {
                Twin::halt(format_args!("the belief-space planner refuses a problem"));
            }
            worst.iteration = worst.iteration.max(count.saturating_sub(before));
            before = count;
            mean = count.saturating_sub(one) / u32::from(iterations_max - 1);
        }
        worst.mean = worst.mean.max(mean);
    }
    worst
}
