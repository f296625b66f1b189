//! Covariance minimisation: the core's belief planner bends the path to a goal so that bearings tell more on it.
//!
//! The paper's weights (section V: `Q = 50`, `R = 0.01`, `T = 50`, `T = 1` once the range is known), a new trajectory every
//! ten control cycles. The source is where the filters see it, an image behind a wall included: to the vehicle the two are
//! the same. A path counts only when all of it fits into the map.

use foxhound_core::ConfigError;
use foxhound_core::base::obstacle::Obstacle;
use foxhound_core::localize::source::bank::{Answer, Mode, Path};
use foxhound_core::planning::ilqr::{self, Guess, Outcome, Planner, Problem, Workspace};

use super::cycle::{PERIOD, STEP_M, View};
use super::known::CLEARANCE_M;
use crate::world::{Horizontal, from_core};

/// Most steps of a trajectory.
const STEPS_MAX: usize = 24;
/// A path may be longer than the straight one by this factor.
const LONGER: f64 = 1.06;
/// Most obstacles of a request.
const OBSTACLES_MAX: usize = 64;
/// Obstacles farther away are left out.
const OBSTACLES_WITHIN_M: f64 = 6.0;
/// The largest variance of a request. The paper's trajectories begin with 0.1 m^2; with the tens of m^2 that the filters
/// begin with, its weights would have the robot gather bearings and never go anywhere.
const VARIANCE_MAX_M2: f32 = 0.1;
/// The robot heads for a point of its trajectory so far ahead: closer ones drown in the cells of the map.
const AHEAD_M: f64 = 1.0;

/// The planner, and where the trajectory is.
pub(super) struct Bend {
    learn: Planner,
    go: Planner,
    workspace: Box<Workspace<3, STEPS_MAX>>,
    path: Vec<Horizontal>,
    age: u32,
}

impl Bend {
    /// For this noise of the angle of arrival.
    ///
    /// # Errors
    /// None that the built-in configuration could cause.
    pub(super) fn new(sigma_rad: f64) -> Result<Self, ConfigError> {
        let config = |weight| ilqr::Config {
            t_covariance: [weight, weight],
            u_max_m: STEP_M as f32,
            bearing_sigma_rad: sigma_rad.max(0.03) as f32,
            iterations_max: 30,
            ..ilqr::Config::default()
        };
        Ok(Self {
            learn: config(50.0).build()?,
            go: config(1.0).build()?,
            workspace: Box::default(),
            path: Vec::new(),
            age: 0,
        })
    }

    /// Where to go next on the path to a goal.
    pub(super) fn towards(&mut self, view: &View<'_>, goal: Horizontal, answer: &Answer) -> Horizontal {
        self.age += 1;
        if self.age >= PERIOD || self.path.is_empty() {
            self.age = 0;
            self.path = self.solve(view, goal, answer).unwrap_or_default();
        }
        while self.path.first().is_some_and(|next| next.minus(view.place).norm() < AHEAD_M) {
            self.path.remove(0);
        }
        self.path.first().copied().filter(|next| view.known.is_clear(view.place, *next)).unwrap_or(goal)
    }

    fn solve(&mut self, view: &View<'_>, goal: Horizontal, answer: &Answer) -> Option<Vec<Horizontal>> {
        let leg_m = goal.minus(view.place).norm();
        let steps = libm::ceil(LONGER * leg_m / STEP_M) as usize;
        if steps < 3 || !view.known.is_clear(view.place, goal) {
            return None;
        }
        let (steps, goal) = if steps > STEPS_MAX {
            let part = STEPS_MAX as f64 / steps as f64;
            (STEPS_MAX, view.place.along(goal.minus(view.place), part))
        } else {
            (steps, goal)
        };
        let source = match answer.path {
            Path::Direct => answer.estimate.place_ned_m,
            Path::Reflected(line) => line.mirror(answer.estimate.place_ned_m),
        };
        let mut near: Vec<(f64, Horizontal)> = (view.known.points().iter())
            .map(|point| (point.minus(view.place).norm(), *point))
            .filter(|(distance_m, _)| *distance_m < OBSTACLES_WITHIN_M)
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let obstacles: Vec<Obstacle> = (near.iter().take(OBSTACLES_MAX))
            .map(|(_, point)| Obstacle { center_ned_m: point.to_core(), reach_m: CLEARANCE_M as f32 + 0.1 })
            .collect();
        let [nn, ne, ee] = answer.estimate.covariance_m2;
        let scale = (VARIANCE_MAX_M2 / nn.max(ee)).min(1.0);
        let planner = if answer.mode == Mode::Learn { &self.learn } else { &self.go };
        let mut best: Option<(f32, Vec<Horizontal>)> = None;
        for bow_m in [0.5, -0.5] {
            let problem = Problem {
                start_ned_m: view.place.to_core(),
                source_ned_m: source,
                covariance_m2: [nn * scale, ne * scale, ee * scale],
                goal_ned_m: goal.to_core(),
                steps,
                obstacles: &obstacles,
                seen_through: None,
                guess: Guess::Bow(bow_m),
            };
            let solution = planner.solve(&mut self.workspace, &problem);
            let is_sound = matches!(solution.outcome, Outcome::Converged | Outcome::CapReached);
            let path: Vec<Horizontal> = solution.path.iter().map(|step| from_core(step.place_ned_m)).collect();
            let legs = std::iter::once(&view.place).chain(&path).zip(&path);
            if is_sound
                && best.as_ref().is_none_or(|(cost, _)| solution.cost < *cost)
                && legs.into_iter().all(|(from, to)| view.known.is_clear(*from, *to))
            {
                best = Some((solution.cost, path));
            }
        }
        best.map(|(_, path)| path)
    }
}
