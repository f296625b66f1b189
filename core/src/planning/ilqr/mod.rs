//! Belief-space planning: a path that reaches its goal, avoids obstacles, and from which bearings give more information
//! about the source.
//!
//! K. Pfeiffer et al., "Path Planning Under Uncertainty to Localize mmWave Sources" (the paper here), eq. 10-14: over
//! the controls `u` of `N` steps, with the belief of a place `p` and a covariance `P`,
//!
//! ```text
//! min  sum_i  R u_i'u_i + tr(P_i T)  +  Q |p_N - p_d|^2 + tr(P_N T)
//! p_i = p_(i-1) + u_i,   P_i = EKF(P_(i-1), p_i)                       (eq. 11, 16; `sensor`)
//! |u_i| <= u_max,   |p_i - c| >= r_rob + r_obs + n_std deviation(P_i)  (eq. 12, 14; `clearance`)
//! ```
//!
//! Two kinds of belief: two states, five numbers (eq. 2: the vehicle's position relative to the source), and four
//! states, fourteen numbers (eq. 8: the vehicle and the source, which is received by reflection at a known line). The
//! mean of states that are not controlled is constant, so its derivatives are not part of the problem. Covariances are
//! in the NED frame, as upper triangles column by column: `[nn, ne, ee]`, or `[nn, ne, ee, ns n, ...]` with the
//! source's two after the vehicle's.
//!
//! `solver` contains the iteration. All memory is in a [`Workspace`] of fixed size; nothing is allocated. A path is
//! only a proposal: the caller must check it like any other before it is flown.

use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Obstacle;
use crate::mapping::walls::Wall;

mod begin;
mod clearance;
#[expect(clippy::needless_range_loop, reason = "sums over matrices are read by their indices")]
mod sensor;
#[expect(clippy::needless_range_loop, reason = "sums over matrices are read by their indices")]
mod solver;
#[cfg(test)]
#[expect(clippy::needless_range_loop, reason = "sums over matrices are read by their indices")]
mod tests;

use clearance::{NEAREST, Near};
use sensor::Sensor;
use solver::{Law, Search};

/// Shares of a step that are tried in an iteration. A model is expensive, so a shorter step is tried, too. If none is
/// accepted, the next model has more regularisation.
const SHARES: [f32; 2] = [1.0, 0.4];

/// The bound on a control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Bound {
    /// Its length.
    #[default]
    Norm,
    /// Each component, the paper's.
    Axes,
}

/// Configuration of the planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// `Q`, weight of the squared distance to the goal at the end.
    pub q_terminal: f32,
    /// `R`, weight of the squared steps.
    pub r_control: f32,
    /// `T`, weight of the variances: of the first two states, and of the other two if there are any.
    pub t_covariance: [f32; 2],
    /// Longest step.
    pub u_max_m: f32,
    /// What `u_max_m` limits.
    pub bound: Bound,
    /// Number of standard deviations of its position that the vehicle keeps from obstacles.
    pub n_std: f32,
    /// Noise of the bearing taken at each step.
    pub bearing_sigma_rad: f32,
    /// Within about this distance of the source a bearing contains no information.
    pub near_m: f32,
    /// Variance added at each step: to the first two states, and to the other two.
    pub process_noise_m2: [f32; 2],
    /// Largest number of iterations.
    pub iterations_max: u16,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            q_terminal: 50.0,
            r_control: 0.01,
            t_covariance: [50.0, 50.0],
            u_max_m: 1.0,
            bound: Bound::Norm,
            n_std: 0.0,
            bearing_sigma_rad: 0.05,
            near_m: 0.3,
            process_noise_m2: [0.0, 0.0],
            iterations_max: 60,
        }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Planner, ConfigError> {
        check("belief.q_terminal", self.q_terminal, 0.0, 1e4)?;
        check("belief.r_control", self.r_control, 1e-6, 1e4)?;
        for weight in self.t_covariance {
            check("belief.t_covariance", weight, 0.0, 1e4)?;
        }
        check("belief.u_max_m", self.u_max_m, 1e-3, 100.0)?;
        check("belief.n_std", self.n_std, 0.0, 10.0)?;
        check("belief.bearing_sigma_rad", self.bearing_sigma_rad, 1e-3, 3.2)?;
        check("belief.near_m", self.near_m, 0.0, 10.0)?;
        for noise in self.process_noise_m2 {
            check("belief.process_noise_m2", noise, 0.0, 1e3)?;
        }
        check("belief.iterations_max", f32::from(self.iterations_max), 1.0, 1000.0)?;
        let u_max2 = self.u_max_m * self.u_max_m;
        let longest2 = if self.bound == Bound::Axes { 2.0 * u_max2 } else { u_max2 };
        Ok(Planner { config: *self, half_step_m2: 0.25 * longest2, inverse_u_max2: 1.0 / u_max2 })
    }
}

/// The initial path of the iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Guess<'a> {
    /// A bow from the start towards the goal, with its deviation to the right in the middle (to the left if negative).
    /// A straight line does not work where it meets an obstacle's middle or leads to the source: by symmetry, the
    /// derivatives show no side to bend it to.
    Bow(f32),
    /// A path, point by point, such as the last solution: followed as far as the bound on the steps allows.
    Path(&'a [Horizontal]),
}

/// The planning problem; `M` is 3 or 10, the size of the covariance triangle.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a, const M: usize> {
    /// Position of the vehicle.
    pub start_ned_m: Horizontal,
    /// Estimated position of the source.
    pub source_ned_m: Horizontal,
    /// Covariance of the states.
    pub covariance_m2: [f32; M],
    /// Position to end at.
    pub goal_ned_m: Horizontal,
    /// Number of steps.
    pub steps: usize,
    /// Obstacles to avoid; their reach includes the vehicle's radius.
    pub obstacles: &'a [Obstacle],
    /// The line that reflects the source's signal, if it is not received directly.
    pub seen_through: Option<Wall>,
    /// The initial path of the iteration.
    pub guess: Guess<'a>,
}

/// How a solve ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Outcome {
    /// At a minimum; the path is clear of obstacles.
    Converged,
    /// The limit of iterations was reached, or rounding stopped the progress; the path is clear of obstacles.
    CapReached,
    /// The best path found goes through an obstacle.
    Blocked,
    /// The problem has no steps, more than the workspace can hold, or numbers that are not finite.
    Refused,
}

/// The result.
#[derive(Clone, Copy, Debug)]
pub struct Solution<'a, const M: usize> {
    /// How it ended.
    pub outcome: Outcome,
    /// Number of passes over the path.
    pub iterations: u16,
    /// Eq. 10, without barriers.
    pub cost: f32,
    /// Smallest distance to an obstacle along the path, less all widening; large without obstacles.
    pub clearance_m: f32,
    /// The path, without the start.
    pub path: &'a [Step<M>],
}

/// A step of the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step<const M: usize> {
    /// Position after the step.
    pub place_ned_m: Horizontal,
    /// The control: north and east.
    pub control_m: [f32; 2],
    /// The covariance there, after its bearing.
    pub covariance_m2: [f32; M],
    /// Slack to the obstacles around it.
    rooms_m: [f32; NEAREST],
}

impl<const M: usize> Step<M> {
    const ZERO: Self = Self {
        place_ned_m: Horizontal { north: 0.0, east: 0.0 },
        control_m: [0.0; 2],
        covariance_m2: [0.0; M],
        rooms_m: [0.0; NEAREST],
    };
}

/// Memory of a solve of up to `N` steps.
#[derive(Clone, Debug)]
pub struct Workspace<const M: usize, const N: usize> {
    paths: [[Step<M>; N]; 2],
    laws: [Law<M>; N],
    near: [Near; N],
    duals: [[f32; NEAREST]; N],
    bounds: [[f32; 2]; N],
}

impl<const M: usize, const N: usize> Workspace<M, N> {
    /// All zero.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            paths: [[Step::ZERO; N]; 2],
            laws: [Law::ZERO; N],
            near: [Near::NONE; N],
            duals: [[0.0; NEAREST]; N],
            bounds: [[0.0; 2]; N],
        }
    }

    fn parts(&mut self) -> Parts<'_, M> {
        let Self { paths: [path, trial], laws, near, duals, bounds } = self;
        Parts { paths: [path, trial], laws, near, duals, bounds }
    }
}

/// The same without the const length.
struct Parts<'s, const M: usize> {
    paths: [&'s mut [Step<M>]; 2],
    laws: &'s mut [Law<M>],
    near: &'s mut [Near],
    duals: &'s mut [[f32; NEAREST]],
    bounds: &'s mut [[f32; 2]],
}

impl<const M: usize, const N: usize> Default for Workspace<M, N> {
    fn default() -> Self {
        Self::new()
    }
}

/// The planner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planner {
    config: Config,
    /// Square of half the longest step.
    half_step_m2: f32,
    inverse_u_max2: f32,
}

impl Planner {
    /// Its configuration.
    #[must_use]
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Plans with a belief of two states.
    pub fn solve<'s, const N: usize>(
        &self,
        workspace: &'s mut Workspace<3, N>,
        problem: &Problem<'_, 3>,
    ) -> Solution<'s, 3> {
        self.search_two(workspace.parts(), problem)
    }

    /// A separate function, so that it is compiled with this crate and not with the caller, which may be optimised for
    /// size.
    #[inline(never)]
    fn search_two<'s>(&self, parts: Parts<'s, 3>, problem: &Problem<'_, 3>) -> Solution<'s, 3> {
        self.search::<2, 3>(parts, problem)
    }

    /// Plans with a belief of four states.
    pub fn solve_reflected<'s, const N: usize>(
        &self,
        workspace: &'s mut Workspace<10, N>,
        problem: &Problem<'_, 10>,
    ) -> Solution<'s, 10> {
        self.search_four(workspace.parts(), problem)
    }

    #[inline(never)]
    fn search_four<'s>(&self, parts: Parts<'s, 10>, problem: &Problem<'_, 10>) -> Solution<'s, 10> {
        self.search::<4, 10>(parts, problem)
    }

    /// Slack of a control to its bounds, as a share.
    #[inline]
    fn rooms(&self, control: [f32; 2]) -> [f32; 2] {
        let [north, east] = control.map(|control| control * control * self.inverse_u_max2);
        match self.config.bound {
            Bound::Axes => [1.0 - north, 1.0 - east],
            Bound::Norm => [1.0 - north - east, 1.0],
        }
    }

    /// A control within its bounds, and not much nearer to them than the one before.
    #[inline]
    fn bounded(&self, control: [f32; 2], before: [f32; 2]) -> [f32; 2] {
        const KEPT: f32 = 0.05;
        let (rooms, least) = (self.rooms(control), self.rooms(before).map(|room| KEPT * room));
        // A control that is too long is shortened to leave the smallest slack.
        let shortened = |room: f32, least: f32| if room < least { sqrt((1.0 - least) / (1.0 - room)) } else { 1.0 };
        let first = shortened(rooms[0], least[0]);
        let second = if self.config.bound == Bound::Axes { shortened(rooms[1], least[1]) } else { first };
        [control[0] * first, control[1] * second]
    }

    fn search<'s, const L: usize, const M: usize>(
        &self,
        parts: Parts<'s, M>,
        problem: &Problem<'_, M>,
    ) -> Solution<'s, M> {
        let config = &self.config;
        let finite = problem.start_ned_m.is_finite()
            && problem.source_ned_m.is_finite()
            && problem.goal_ned_m.is_finite()
            && problem.covariance_m2.iter().all(|value| value.is_finite());
        let Parts { paths: [path, trial], laws, near, duals, bounds } = parts;
        let length = problem.steps;
        let (Some(mut path), Some(mut trial), Some(laws), Some(near), Some(duals), Some(bounds), true) = (
            path.get_mut(..length),
            trial.get_mut(..length),
            laws.get_mut(..length),
            near.get_mut(..length),
            duals.get_mut(..length),
            bounds.get_mut(..length),
            finite && length > 0,
        ) else {
            return Solution { outcome: Outcome::Refused, iterations: 0, cost: 0.0, clearance_m: 0.0, path: &[] };
        };
        let first = &problem.covariance_m2;
        let mut search = Search {
            planner: self,
            sensor: Sensor::<L>::new(
                problem.source_ned_m,
                problem.seen_through.as_ref(),
                config.bearing_sigma_rad * config.bearing_sigma_rad,
                config.near_m,
                config.process_noise_m2,
            ),
            start: [problem.start_ned_m.north, problem.start_ned_m.east],
            goal: [problem.goal_ned_m.north, problem.goal_ned_m.east],
            obstacles: problem.obstacles,
            weight: core::array::from_fn(|a| config.t_covariance[usize::from(a >= 2)]),
            mu: 0.0,
            delta_m: 0.1 * config.u_max_m,
            inverse_delta: 10.0 / config.u_max_m,
            rho: 0.0,
        };
        search.begin(path, first, problem, near);

        let steps = length as f32;
        let unit = |cost: f32| cost / steps;
        let start_cost = unit(search.cost(path));
        search.mu = 0.1 * start_cost;
        let rho_unit = start_cost * self.inverse_u_max2;
        let raised = |rho: f32| if rho > 1e-2 * rho_unit { 8.0 * rho } else { 0.1 * rho_unit };
        search.rho = 0.1 * rho_unit;
        duals.fill([0.0; NEAREST]);
        search.look(path, near, duals, length);
        search.begin_bounds(path, bounds);

        let mut outcome = Outcome::CapReached;
        let mut iterations = 0;
        while iterations < config.iterations_max {
            iterations += 1;
            let Some(model) = search.backward(path, first, near, duals, bounds, laws) else {
                search.rho = raised(search.rho);
                if search.rho > 1e6 * rho_unit {
                    break;
                }
                continue;
            };
            let shares = if M > 3 { &SHARES[..] } else { &SHARES[..1] };
            let found = shares.iter().copied().find(|share| {
                let merit = search.forward(path, trial, first, near, laws, *share);
                merit.is_some_and(|merit| merit < model.merit - 1e-4 * share * model.decrease)
            });
            if let Some(share) = found {
                search.move_duals(path, trial, duals, bounds);
                core::mem::swap(&mut path, &mut trial);
                search.look(path, near, duals, length / 5 + 1);
                search.rho = if share == 1.0 { 0.3 * search.rho } else { search.rho };
            } else {
                search.rho = raised(search.rho);
            }
            let flat = model.decrease < search.mu * steps * 0.1 || (found.is_none() && search.rho > 1e3 * rho_unit);
            if flat {
                let least = 1e-3 * unit(search.cost(path));
                if search.mu <= least {
                    if model.room_m > 0.0 {
                        outcome = Outcome::Converged;
                        break;
                    }
                    // The parabola is not steep enough to push every step out of the obstacles.
                    if search.delta_m < 1e-4 * config.u_max_m {
                        break;
                    }
                    search.steepen(0.3 * search.delta_m);
                    continue;
                }
                search.mu *= 0.2;
                let delta_m = 0.5 * search.mu / model.dual;
                if delta_m < search.delta_m {
                    search.steepen(delta_m);
                }
            }
        }
        let clearance_m = search.clearance_m(path);
        Solution {
            outcome: if clearance_m < 0.0 { Outcome::Blocked } else { outcome },
            iterations,
            cost: search.cost(path),
            clearance_m,
            path,
        }
    }
}
