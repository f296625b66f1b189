//! The main paper's planner (section III-B, Algorithm 2) and its baselines: the initial trajectory alone, in the
//! paper's field and in those of the variants paper.
//!
//! Gains are drawn inside limits (eq. 38-40), each set's trajectory gets a cost (eq. 41-45) and a weight (eq. 46),
//! the weighted offsets make an average (eq. 47), and the sampled trajectory nearest to that is followed. Neither
//! planner checks for collisions: the paper argues that sampled trajectories cannot cross obstacles, but with finite
//! steps they do.
//!
//! Line 1 of Algorithm 2 puts the temporary target on the goal, the text puts it two metres along the bearing. The
//! latter is implemented, with the target from the request. If the target comes within range of a goal whose position
//! is known, or would be behind it, it is the goal.

use foxhound_core::base::config::{RangeSensor, Vehicle};
use foxhound_core::base::error::{ConfigError, Why};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::{Disc, Obstacle};
use foxhound_core::base::rng::Rng;
use foxhound_core::control::guard;
use foxhound_core::planning::field::Gains;
use foxhound_core::planning::planner::baseline::{self, Exponent, Law, Offsets, Reading};
use foxhound_core::planning::planner::sampling::{average, draw, nearest};
use foxhound_core::planning::planner::{Answer, Config, Kind, Plan, PlanRequest, Planner, SAMPLES, Verdict, Workspace};
use foxhound_core::planning::rollout::{Cost, SPACING_M, Scene, Stride, Trajectory, WAYPOINTS, Waypoint};

pub mod field;
mod law;

pub use field::Field;

/// Range of the goal within which the temporary target becomes it.
const END_RANGE_M: f32 = 0.5;

/// Step of [`Reading::Gradient`], metres per unit of force.
const GRADIENT_STEP: f32 = 0.02;

/// Every planner that [`named`] knows: ours, the paper's and its baseline with their readings (of eq. 47, then of
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

/// A planner by its name in [`NAMES`].
#[must_use]
pub fn named(name: &str) -> Option<Config> {
    let paper = Config::of(Kind::Paper);
    let standard = Config::of(Kind::Standard);
    let sun = |exponent, k_rep| in_field(standard, Law { exponent, ..Law::of(baseline::Kind::Sun) }, k_rep);
    Some(match name {
        "foxhound" => Config::of(Kind::Foxhound),
        "paper" => paper,
        "paper_scalar" => Config { offsets: Offsets::Scalar, ..paper },
        "paper_quarters" => in_quarters(paper),
        "paper_gradient" => Config { reading: Reading::Gradient, ..paper },
        "standard" => standard,
        "standard_quarters" => in_quarters(standard),
        "standard_gradient" => Config { reading: Reading::Gradient, ..standard },
        "inverse_distance" => in_field(standard, Law::of(baseline::Kind::InverseDistance), 0.08),
        "khatib" => in_field(standard, Law::of(baseline::Kind::Khatib), 0.064),
        "rizqi" => in_field(standard, Law::of(baseline::Kind::Rizqi), 0.064),
        "sun" => sun(Exponent::Two, 0.016),
        "sun_0" => sun(Exponent::Zero, 0.064),
        "sun_half" => sun(Exponent::Half, 0.045),
        "sun_1" => sun(Exponent::One, 0.032),
        "virtual_force" => in_field(standard, Law::of(baseline::Kind::VirtualForce), 1.33),
        _ => return None,
    })
}

/// In another field. The variants paper prints no gains: they repel at half the range (of a circle of 0.35 m, two metres
/// from the target) as the main paper's field does.
fn in_field(config: Config, law: Law, k_rep: f32) -> Config {
    Config { law, gains: Gains { k_rep, ..config.gains }, ..config }
}

/// With four force evaluations from waypoint to waypoint, and the gains that suit them.
fn in_quarters(config: Config) -> Config {
    Config {
        reading: Reading::Quarters,
        gains: Gains { k_rep: 0.05, influence_m: 0.3, ..config.gains },
        gains_sigma: Gains { k_rep: 0.025, influence_m: 0.12, ..config.gains_sigma },
        ..config
    }
}

/// A planner of the papers, or the core's own.
#[derive(Clone, Debug)]
pub struct AnyPlanner {
    config: Config,
    vehicle: Vehicle,
    /// The core's own, with the same limits.
    own: Planner,
}

impl AnyPlanner {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(
        config: &Config,
        vehicle: &Vehicle,
        sensor: &RangeSensor,
        guard: &guard::Config,
    ) -> Result<Self, ConfigError> {
        let (fence, margin_m) = (&guard.fence, guard.margin_m);
        if config.kind == Kind::Foxhound {
            return Ok(Self {
                config: *config,
                vehicle: *vehicle,
                own: config.build(vehicle, sensor, fence, margin_m)?,
            });
        }
        let own = own(config).build(vehicle, sensor, fence, margin_m)?;
        law::check_law(&config.law)?;
        if config.explore.is_some() {
            let why = Why::Inconsistent("only the planner foxhound can search");
            return Err(ConfigError { field: "planner.explore", value: 1.0, why });
        }
        Ok(Self { config: *config, vehicle: *vehicle, own })
    }

    /// Answers one request; `known` are the known obstacles.
    pub fn answer(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Answer {
        Answer { plan: self.plan(workspace, request, known), walls: self.own.walls(request, known) }
    }

    /// The plan of an answer.
    pub fn plan(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Plan {
        if self.config.kind == Kind::Foxhound {
            return self.own.plan(workspace, request, known);
        }
        plan(&self.config, &self.vehicle, workspace, request, known)
    }

    /// The answer to stay where the request starts.
    #[must_use]
    pub fn brake(&self, request: &PlanRequest) -> Answer {
        self.own.brake(request)
    }
}

/// The configuration of the core's own planner with the same gains and limits.
#[must_use]
pub fn own(config: &Config) -> Config {
    let Config { law, reading, offsets, .. } = Config::of(Kind::Foxhound);
    Config { kind: Kind::Foxhound, law, reading, offsets, ..*config }
}

/// Answers one request.
fn plan(config: &Config, vehicle: &Vehicle, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Plan {
    let target = target(request);
    workspace.scene.gather(request.start_ned_m, known.iter().map(|disc| Obstacle::of(disc, vehicle.radius_m)));
    let field = |gains| Field { law: config.law, gains };
    let (initial, cost) = roll(&workspace.scene, &field(config.gains), config.reading, target);
    workspace.initial = initial;
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
        let (trajectory, cost) = roll(&workspace.scene, &field(gains), config.reading, target);
        workspace.gains[index] = gains;
        workspace.samples[index] = trajectory;
        workspace.costs[index] = cost.total();
        workspace.feasible[index] = true;
    }
    if let Some(optimal) = optimal(workspace, config.offsets) {
        let chosen = nearest(workspace, &optimal);
        (plan.waypoints_ned_m, plan.gains, plan.cost) =
            (workspace.samples[chosen], workspace.gains[chosen], workspace.costs[chosen]);
    } else {
        // A request that is not finite.
        plan.verdict = Verdict::Brake;
        plan.waypoints_ned_m = [request.start_ned_m; WAYPOINTS];
    }
    plan
}

/// The trajectory from the start of a scene, and its cost.
#[must_use]
pub fn roll(scene: &Scene, field: &Field, reading: Reading, target: Horizontal) -> (Trajectory, Cost) {
    match (reading, field.flown()) {
        (Reading::Waypoint, Some(flown)) => scene.roll(&flown, target),
        (Reading::Waypoint, None) => scene.roll_by(field, Waypoint, target),
        _ => scene.roll_by(field, Steps(reading), target),
    }
}

/// Steps of any reading.
#[derive(Clone, Copy, Debug)]
pub struct Steps(pub Reading);

impl Stride for Steps {
    #[inline(always)]
    fn steps(self) -> u8 {
        if self.0 == Reading::Quarters { 4 } else { 1 }
    }

    #[inline(always)]
    fn ends_within_m(self) -> Option<f32> {
        match self.0 {
            Reading::Waypoint => Some(SPACING_M),
            Reading::Quarters => Some(0.25 * SPACING_M),
            Reading::Gradient => None,
        }
    }

    #[inline(always)]
    fn factor(self, squared: f32, inverse: f32) -> f32 {
        match self.0 {
            Reading::Gradient if GRADIENT_STEP * squared * inverse < SPACING_M => GRADIENT_STEP,
            Reading::Gradient | Reading::Waypoint => SPACING_M * inverse,
            Reading::Quarters => 0.25 * SPACING_M * inverse,
        }
    }
}

/// The temporary target, or the goal at the end of the path.
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

/// Eq. 46 and 47, in either reading.
fn optimal(workspace: &Workspace, reading: Offsets) -> Option<Trajectory> {
    match reading {
        Offsets::Signed => average(workspace, |offset| offset),
        Offsets::Scalar => average(workspace, |offset| {
            let distance = offset.norm();
            Horizontal { north: distance, east: distance }
        }),
    }
}

#[cfg(test)]
mod rollout_tests;
#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::planning::explore;
    use std::vec::Vec as StdVec;

    fn request(seed: u64) -> PlanRequest {
        PlanRequest { id: 1, seed, target_ned_m: Horizontal { north: 2.0, east: 0.0 }, ..PlanRequest::default() }
    }

    fn known(seed: u64) -> StdVec<Disc> {
        let mut rng = Rng::new(seed, 78);
        (0..6)
            .map(|_| Disc {
                center_ned_m: Horizontal { north: 0.4 + 2.0 * rng.uniform(), east: -1.0 + 2.0 * rng.uniform() },
                radius_m: 0.1 + 0.2 * rng.uniform(),
                ..Disc::default()
            })
            .collect()
    }

    fn run(name: &str, request: &PlanRequest, known: &[Disc]) -> (Plan, Workspace) {
        let mut workspace = Workspace::default();
        let plan = AnyPlanner::build(
            &named(name).unwrap(),
            &Vehicle::DEFAULT,
            &RangeSensor::DEFAULT,
            &guard::Config::default(),
        )
        .unwrap()
        .plan(&mut workspace, request, known);
        (plan, workspace)
    }

    #[test]
    fn all_kinds_fly_straight_through_the_open() {
        for name in ["foxhound", "paper", "standard"] {
            let (plan, _) = run(name, &request(1), &[]);
            assert_eq!(plan.verdict, Verdict::Follow);
            assert!(plan.waypoints_ned_m[14].minus(Horizontal { north: 2.0, east: 0.0 }).norm() < 1e-4, "{name}");
        }
    }

    #[test]
    fn only_the_planner_foxhound_can_search() {
        let build = |config: &Config| {
            AnyPlanner::build(config, &Vehicle::DEFAULT, &RangeSensor::DEFAULT, &guard::Config::default())
        };
        let search = |name| Config { explore: Some(explore::Config::default()), ..named(name).unwrap() };
        assert_eq!(build(&search("paper")).unwrap_err().field, "planner.explore");
        assert!(build(&search("foxhound")).is_ok());
    }

    #[test]
    fn the_paper_mode_follows_the_sample_nearest_to_the_weighted_mean() {
        let circle =
            |north, east, radius_m| Disc { center_ned_m: Horizontal { north, east }, radius_m, ..Disc::default() };
        let known = [circle(1.0, 0.1, 0.25), circle(1.4, -0.5, 0.2)];
        let (plan, workspace) = run("paper", &PlanRequest { seed: 9, ..request(1) }, &known);
        // Eq. 46-47 again, in f64 and without the shift of the exponent.
        let weights: std::vec::Vec<f64> = workspace.costs.iter().map(|s| (-f64::from(*s)).exp()).collect();
        let total: f64 = weights.iter().sum();
        let mean = |t: usize, pick: &dyn Fn(&Horizontal) -> f32| {
            let initial = f64::from(pick(&workspace.initial[t]));
            let offset: f64 =
                weights.iter().zip(&workspace.samples).map(|(w, s)| w * (f64::from(pick(&s[t])) - initial)).sum();
            initial + offset / total
        };
        let distance = |s: &Trajectory| -> f64 {
            (0..WAYPOINTS)
                .map(|t| {
                    let north = f64::from(s[t].north) - mean(t, &|p| p.north);
                    let east = f64::from(s[t].east) - mean(t, &|p| p.east);
                    north.hypot(east)
                })
                .sum()
        };
        let best = workspace.samples.iter().map(distance).fold(f64::INFINITY, f64::min);
        assert!((distance(&plan.waypoints_ned_m) - best).abs() < 1e-4);
    }

    #[test]
    fn every_name_is_a_planner_that_flies_and_no_two_are_the_same() {
        let plans: StdVec<StdVec<Trajectory>> = NAMES
            .iter()
            .map(|name| (0..30).map(|seed| run(name, &request(seed), &known(seed)).0.waypoints_ned_m).collect())
            .collect();
        for (i, paths) in plans.iter().enumerate() {
            assert!(paths.iter().flatten().all(|w| w.is_finite()), "{}", NAMES[i]);
            for (j, others) in plans.iter().enumerate().skip(i + 1) {
                assert_ne!(named(NAMES[i]), named(NAMES[j]));
                // Sun's factor to the power of zero is Khatib's field.
                let twins = (NAMES[i], NAMES[j]) == ("khatib", "sun_0");
                assert_eq!(paths == others, twins, "{} {}", NAMES[i], NAMES[j]);
            }
        }
        assert_eq!(named("bug"), None);
    }

    #[test]
    fn the_standard_planner_follows_its_field_without_sampling() {
        let request = request(3);
        for name in ["standard", "khatib", "rizqi", "sun", "virtual_force", "inverse_distance", "standard_quarters"] {
            let (plan, workspace) = run(name, &request, &known(3));
            let config = named(name).unwrap();
            let obstacles: StdVec<Obstacle> = workspace.scene.obstacles().collect();
            let field = Field { law: config.law, gains: config.gains };
            let (start, target) = (request.start_ned_m, request.target_ned_m);
            let plain = foxhound_core::planning::rollout::roll_plainly(
                &field,
                Steps(config.reading),
                start,
                target,
                &obstacles,
            );
            assert_eq!(plan.waypoints_ned_m, plain, "{name}");
        }
    }

    #[test]
    fn read_to_the_letter_equation_47_moves_every_point_to_the_north_east() {
        let (mut moved, mut other) = (0, 0);
        for seed in 0..200 {
            let (plan, workspace) = run("paper_scalar", &request(seed), &known(seed));
            let optimal = optimal(&workspace, Offsets::Scalar).unwrap();
            for (point, initial) in optimal.iter().zip(&workspace.initial) {
                let offset = point.minus(*initial);
                assert!(offset.north >= 0.0 && (offset.north - offset.east).abs() < 1e-5);
                moved += i32::from(offset.north > 0.05);
            }
            other += i32::from(plan.waypoints_ned_m != run("paper", &request(seed), &known(seed)).0.waypoints_ned_m);
        }
        assert!(moved > 500 && other > 20, "{moved} {other}");
    }

    #[test]
    fn the_temporary_target_becomes_a_known_goal_within_its_range_and_not_before() {
        let target = |north| {
            let goal = Some(Horizontal { north, east: 0.1 });
            let (plan, _) = run("paper", &PlanRequest { known_source_ned_m: goal, ..request(1) }, &known(1));
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
            let known = known(seed);
            let (_, mut workspace) = run("paper", &request, &known);
            let chosen = nearest(&workspace, &optimal(&workspace, Offsets::Signed).unwrap());
            let (start, target) = (request.start_ned_m, request.target_ned_m);
            let obstacles: StdVec<Obstacle> = known.iter().map(|c| Obstacle::of(c, 0.15)).collect();
            for (sample, cost) in workspace.samples.iter().zip(&mut workspace.costs) {
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
            assert_eq!(nearest(&workspace, &optimal(&workspace, Offsets::Signed).unwrap()), chosen, "seed {seed}");
        }
    }
}
