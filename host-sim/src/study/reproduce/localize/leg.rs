//! How well the range to the source is known after 6 m of a leg of 12 m: flown straight, and on the path that the belief-space
//! planner finds within a bound on the extra length.
//!
//! Bearings of 1.86 deg at 10 Hz and 1 m/s, so one every 0.1 m; the filter is the product's (`source::polar`) but for its
//! prior, which is drawn: the inverse range that the first bearing is taken to mean has a mean of 1/12 m and a deviation of
//! [`PRIOR_SIGMA_PER_M`], which the filter is given, and it accepts no range beyond 50 m. (A filter that begins at 12 m would be
//! right by luck.) The vehicle follows its path exactly.
//!
//! The planner runs again after every metre, with the filter's state by then, and starts from the last path. Length is
//! what has been flown and what is left from there to the source in a straight line.

use std::f64::consts::PI;

use foxhound_core::base::ned::Horizontal as Core;
use foxhound_core::localize::source::polar::{self, Filter, Resting};
use foxhound_core::localize::source::{Sighting, Update};
use foxhound_core::planning::ilqr::{Config, Guess, Outcome, Planner, Problem, Workspace};
use serde::Serialize;

use crate::world::random::Random;

/// Length of the leg, and how much of it is flown.
pub const LEG_M: f64 = 12.0;
const FLOWN_M: f32 = 6.0;
/// Noise of the bearings.
pub const BEARING_SIGMA_RAD: f64 = 1.86 * PI / 180.0;
/// Deviation of the inverse range before the first bearing.
pub const PRIOR_SIGMA_PER_M: f64 = 0.025;
/// From bearing to bearing.
const SPACING_M: f32 = 0.1;
/// From plan to plan.
const REPLAN_M: f32 = 1.0;
/// Planned steps: of the whole path, and their length where it is straight.
const STEPS: usize = 20;
const STRIDE_M: f32 = FLOWN_M / STEPS as f32;
/// How much longer than the straight one the flown part may be; the rest of the tenth is for where it ends.
const STRETCH: f32 = 0.07;
/// Farthest range that the filter accepts.
const RANGE_MAX_M: f32 = 50.0;

/// One path, over all runs.
#[derive(Clone, Debug, Serialize)]
pub struct Way {
    /// `straight` or `planned`.
    pub way: &'static str,
    /// Root mean squared error of the range.
    pub range_rmse_m: f64,
    /// Mean over the runs of the whole length over that of the leg, less one.
    pub extra_length: f64,
    /// The largest of them.
    pub extra_length_max: f64,
    /// Mean normalised innovation squared; one where the filter is consistent.
    pub nis: f64,
    /// Its 95 % band.
    pub nis_band: [f64; 2],
}

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Runs of each path.
    pub runs: u32,
    /// Straight ahead.
    pub straight: Way,
    /// As planned.
    pub planned: Way,
}

/// The planner's settings; `stretch` is how much longer than the straight one the flown part may be.
fn planner(stretch: f32) -> Option<Planner> {
    // Several bearings a step tell as much as a better one.
    let per_step = STRIDE_M / SPACING_M;
    let config = Config {
        q_terminal: 200.0,
        r_control: 1.0,
        t_covariance: [0.5, 0.0],
        u_max_m: STRIDE_M * (1.0 + stretch),
        bearing_sigma_rad: (BEARING_SIGMA_RAD / libm::sqrt(f64::from(per_step))) as f32,
        iterations_max: 30,
        ..Config::default()
    };
    config.build().ok()
}

struct Run {
    error_m: f64,
    extra_length: f64,
    nis: f64,
    bearings: u32,
}

/// A path to be flown, point by point.
struct Route {
    points: Vec<Core>,
}

impl Route {
    /// The place so far along it, from `from`; the end if it is shorter.
    fn advance(&mut self, from: Core, mut length_m: f32) -> Core {
        let mut at = from;
        while let Some(next) = self.points.first().copied() {
            let leg = next.minus(at);
            if leg.norm() > length_m {
                return at.plus(leg.times(length_m / leg.norm()));
            }
            length_m -= leg.norm();
            at = next;
            self.points.remove(0);
        }
        at
    }
}

fn fly(planner: Option<&Planner>, seed: u64, run: u64) -> Option<Run> {
    let mut random = Random::new(seed, 5_000 + run);
    let source = Core { north: LEG_M as f32, east: 0.0 };
    let inverse = (1.0 / LEG_M + PRIOR_SIGMA_PER_M * random.gaussian()).clamp(0.04, 0.3);
    let filter: Filter = polar::Config {
        inverse_range_per_m: inverse as f32,
        inverse_range_sigma_per_m: PRIOR_SIGMA_PER_M as f32,
        range_max_m: RANGE_MAX_M,
        // There are none here.
        outlier_rate: 0.0,
        odometry_m2_per_s: 0.0,
        ..polar::Config::DEFAULT
    }
    .build()
    .ok()?;
    let mut state = Resting::new();
    let mut workspace = Box::new(Workspace::<3, STEPS>::new());
    let goal = Core { north: FLOWN_M, east: 0.0 };
    let mut route = Route { points: vec![goal] };
    let side = if random.uniform() < 0.5 { 1.0 } else { -1.0 };
    let (mut place, mut flown_m, mut since_plan_m) = (Core::default(), 0.0_f32, REPLAN_M);
    let (mut nis, mut bearings) = (0.0, 0);
    loop {
        let bearing = f64::from(source.minus(place).bearing_rad()) + BEARING_SIGMA_RAD * random.gaussian();
        let sighting = Sighting {
            place_ned_m: place,
            direction_ned: Core::from_bearing(bearing as f32),
            sigma_rad: BEARING_SIGMA_RAD as f32,
            since_s: SPACING_M,
        };
        if let Update::Fused { nis: one, .. } = filter.step(&mut state, &sighting) {
            nis += f64::from(one);
            bearings += 1;
        }
        let estimate = state.estimate()?;
        if let Some(planner) = planner
            && since_plan_m >= REPLAN_M - 1e-3
            && goal.minus(place).norm() > STRIDE_M
        {
            since_plan_m = 0.0;
            let left = (STEPS as f32 * (1.0 - flown_m / (FLOWN_M * planner.config().u_max_m / STRIDE_M))) as usize;
            let problem = Problem {
                start_ned_m: place,
                source_ned_m: estimate.place_ned_m,
                covariance_m2: estimate.covariance_m2,
                goal_ned_m: goal,
                steps: left.clamp(1, STEPS),
                obstacles: &[],
                seen_through: None,
                guess: if flown_m == 0.0 { Guess::Bow(side) } else { Guess::Path(&route.points) },
            };
            let solution = planner.solve(&mut workspace, &problem);
            if matches!(solution.outcome, Outcome::Converged | Outcome::CapReached) {
                route.points = solution.path.iter().map(|step| step.place_ned_m).collect();
                route.points.push(goal);
            }
        }
        let next = route.advance(place, SPACING_M);
        let step_m = next.minus(place).norm();
        if step_m < 1e-4 || goal.minus(place).norm() < 1e-3 {
            break;
        }
        (place, flown_m, since_plan_m) = (next, flown_m + step_m, since_plan_m + step_m);
    }
    let left_m = source.minus(place).norm();
    Some(Run {
        error_m: f64::from(state.estimate()?.range_m - left_m),
        extra_length: f64::from(flown_m + left_m) / LEG_M - 1.0,
        nis,
        bearings,
    })
}

fn way(name: &'static str, planner: Option<&Planner>, seed: u64, runs: u32) -> Way {
    let flown: Vec<Run> = (0..u64::from(runs)).filter_map(|run| fly(planner, seed, run)).collect();
    let count = flown.len() as f64;
    let bearings = f64::from(flown.iter().map(|run| run.bearings).sum::<u32>());
    let mean = |of: fn(&Run) -> f64| flown.iter().map(of).sum::<f64>() / count;
    // Chi-squared over its degrees of freedom, which are many.
    let half = 1.96 * libm::sqrt(2.0 / bearings);
    Way {
        way: name,
        range_rmse_m: libm::sqrt(mean(|run| run.error_m * run.error_m)),
        extra_length: mean(|run| run.extra_length),
        extra_length_max: flown.iter().map(|run| run.extra_length).fold(f64::NEG_INFINITY, f64::max),
        nis: flown.iter().map(|run| run.nis).sum::<f64>() / bearings,
        nis_band: [1.0 - half, 1.0 + half],
    }
}

/// Flies both paths `runs` times each.
#[must_use]
pub fn run(seed: u64, runs: u32) -> Report {
    let planned = planner(STRETCH);
    Report { runs, straight: way("straight", None, seed, runs), planned: way("planned", planned.as_ref(), seed, runs) }
}

impl Report {
    /// The table as text.
    #[must_use]
    pub fn table(&self) -> String {
        let mut out = format!(
            "Range after {FLOWN_M} m of {LEG_M} m, bearings of 1.86 deg every {SPACING_M} m, {} runs each\n\n{:<12}{:>12}{:>14}{:>8}\
             {:>8}   95 % band of NIS\n",
            self.runs, "way", "range rmse", "extra length", "most", "NIS"
        );
        for way in [&self.straight, &self.planned] {
            out += &format!(
                "{:<12}{:>10.2} m{:>12.1} %{:>6.1} %{:>8.3}   {:.3} to {:.3}\n",
                way.way,
                way.range_rmse_m,
                100.0 * way.extra_length,
                100.0 * way.extra_length_max,
                way.nis,
                way.nis_band[0],
                way.nis_band[1]
            );
        }
        out
    }
}
