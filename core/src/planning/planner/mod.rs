//! The slow loop's planner: a temporary target and the known obstacles in, a trajectory of 15 waypoints out.
//!
//! The main paper's method (section III-B, Algorithm 2): draw ten sets of field parameters (eq. 38-40), follow each
//! field, compute each trajectory's cost (eq. 41-45), weight them by `w = exp(-S / lambda)` (eq. 46), average their
//! offsets from the initial trajectory (eq. 47) and follow the sampled trajectory nearest to that average. Three kinds,
//! of which the first two are in the crate `foxhound-papers`:
//!
//! - [`Kind::Paper`], literally, with eq. 47's `|T_j - T_init|` interpreted as the signed offset point by point (a
//!   distance cannot be added to a point);
//! - [`Kind::Standard`], the paper's baseline: the initial trajectory alone;
//! - [`Kind::Foxhound`], the default: the same samples and waypoints, but with the places where the source may be, a
//!   path there around the remembered obstacles, soft repulsion and a sampled swirl; and only trajectories whose swept
//!   path keeps its margin may be chosen (`planner/mppi.rs`). If none is safe, the answer is a brake plan. (The paper
//!   states that sampled trajectories cannot cross obstacles; with finite steps they can.)
//!
//! The paper says that a larger lambda makes the weights stricter; eq. 46 says the opposite, and eq. 46 is implemented.

use heapless::Vec;

use crate::base::config::{Fence, RangeSensor, Vehicle};
use crate::base::error::{ConfigError, Why, check};
use crate::base::ned::Horizontal;
use crate::base::obstacle::{Disc, Obstacle};
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::localize::source::support::{SourcePosition, Support};
use crate::mapping::map::CIRCLES_MAX;
use crate::mapping::walls::{self, WALLS_MAX, Wall};
use crate::planning::explore::{self, Explored};
use crate::planning::field::Gains;
use crate::planning::rollout::{Scene, Trajectory, WAYPOINTS};

pub mod baseline;
mod bend;
mod mppi;
pub mod sampling;

use baseline::{Law, Offsets, Reading};

/// Parameter samples of one replan (main paper, section IV).
pub const SAMPLES: usize = 10;
/// Sampled gains stay above these; the swirl has no limit.
pub const GAINS_MIN: Gains = Gains { k_att: 0.05, k_rep: 0.005, influence_m: 0.05, swirl: 0.0 };
/// Farthest temporary target (main paper, section IV: 2 m).
pub const HORIZON_M: f32 = 2.0;
/// Number of segments, from the start, that must keep the margin: those that are flown before the next replan with the default
/// `replan_at_waypoint`, and one more. Where more are flown, the guard alone keeps the vehicle clear of what is near them.
const CHECKED_SEGMENTS: usize = 6;
/// Half of the narrowest gap that counts as passable: in margins, and at least.
const PASSABLE_MARGINS: f32 = 1.2;
const PASSABLE_MIN_M: f32 = 0.036;

/// Which planner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Kind {
    /// Foxhound's planner.
    #[default]
    Foxhound,
    /// The main paper's Algorithm 2.
    Paper,
    /// The plain field with fixed gains.
    Standard,
}

/// Configuration of the planner.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Which planner.
    pub kind: Kind,
    /// Mean of the sampled gains, and the gains of the initial trajectory.
    pub gains: Gains,
    /// Their standard deviations.
    pub gains_sigma: Gains,
    /// Repulsion law of the papers' planners.
    pub law: Law,
    /// How their trajectories follow the field.
    pub reading: Reading,
    /// What counts as a wall.
    pub walls: walls::Config,
    /// Whether the path is bent to learn the range, where no obstacle is near. Only [`Kind::Foxhound`] does it.
    pub bends: bool,
    /// How to search while no signal is received; `None`: the vehicle holds instead. Only [`Kind::Foxhound`] can
    /// search.
    pub explore: Option<explore::Config>,
    /// How [`Kind::Paper`] averages the samples' offsets.
    pub offsets: Offsets,
    /// Clearance that a trajectory of [`Kind::Foxhound`] keeps from every known obstacle.
    pub margin_m: f32,
    /// Clearance that it keeps where there is no space for more.
    pub tight_margin_m: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self::of(Kind::Foxhound)
    }
}

impl Config {
    /// The defaults of a kind. The paper does not print its gains; these were found by an independent reproduction.
    #[must_use]
    pub const fn of(kind: Kind) -> Self {
        let (gains, gains_sigma) = match kind {
            Kind::Foxhound => (
                Gains { k_att: 1.0, k_rep: 0.05, influence_m: 0.3, swirl: 0.0 },
                Gains { k_att: 0.3, k_rep: 0.05, influence_m: 0.1, swirl: 0.7 },
            ),
            Kind::Paper | Kind::Standard => (
                Gains { k_att: 1.0, k_rep: 0.2, influence_m: 0.8, swirl: 0.0 },
                Gains { k_att: 0.3, k_rep: 0.1, influence_m: 0.32, swirl: 0.0 },
            ),
        };
        Self {
            kind,
            gains,
            gains_sigma,
            law: Law::of(baseline::Kind::Logarithmic),
            reading: Reading::Waypoint,
            walls: walls::Config::DEFAULT,
            bends: true,
            explore: None,
            offsets: Offsets::Signed,
            margin_m: 0.05,
            tight_margin_m: 0.02,
        }
    }

    /// Checks the configuration. The sensor decides what counts as searched; no path leads out of the fence, or through a
    /// gap in which neither planner nor guard could keep their margins.
    ///
    /// # Errors
    /// The field that is out of range; or `planner.kind` or `planner.law.kind` if it is one of the papers', with its
    /// number as the value.
    pub fn build(
        &self,
        vehicle: &Vehicle,
        sensor: &RangeSensor,
        fence: &Fence,
        guard_margin_m: f32,
    ) -> Result<Planner, ConfigError> {
        for (field, number) in [("planner.kind", self.kind as u8), ("planner.law.kind", self.law.kind as u8)] {
            if number != 0 {
                let why = Why::Inconsistent("the papers' planners and fields are not part of this program");
                return Err(ConfigError { field, value: f32::from(number), why });
            }
        }
        for (field, value, min) in [
            ("planner.gains.k_att", self.gains.k_att, GAINS_MIN.k_att),
            ("planner.gains.k_rep", self.gains.k_rep, GAINS_MIN.k_rep),
            ("planner.gains.influence_m", self.gains.influence_m, GAINS_MIN.influence_m),
        ] {
            check(field, value, min, 100.0)?;
        }
        check("planner.gains.swirl", self.gains.swirl, -100.0, 100.0)?;
        let sigma = &self.gains_sigma;
        for value in [sigma.k_att, sigma.k_rep, sigma.influence_m, sigma.swirl] {
            check("planner.gains_sigma", value, 0.0, 100.0)?;
        }
        check("planner.margin_m", self.margin_m, 0.0, 5.0)?;
        check("planner.tight_margin_m", self.tight_margin_m, 0.0, self.margin_m)?;
        vehicle.check()?;
        sensor.check()?;
        fence.check()?;
        let widest_m = if guard_margin_m > self.tight_margin_m { guard_margin_m } else { self.tight_margin_m };
        let passable_m = PASSABLE_MARGINS * widest_m;
        let clearance_m = vehicle.radius_m + self.margin_m;
        Ok(Planner {
            config: *self,
            vehicle: *vehicle,
            sensor: *sensor,
            fence: *fence,
            passable_m: if passable_m > PASSABLE_MIN_M { passable_m } else { PASSABLE_MIN_M },
            walls: self.walls.build()?,
            explorer: self.explore.map(|explore| explore.build(clearance_m, fence)).transpose()?,
        })
    }
}

/// Request to bend the path because the source's range is unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learn {
    /// The estimated position of the source.
    pub source_ned_m: Horizontal,
    /// Its covariance: north-north, north-east, east-east.
    pub covariance_m2: [f32; 3],
    /// Standard deviation of the bearings to come.
    pub sigma_rad: f32,
}

/// Request to search because no signal is received.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Search {
    /// The time of the request.
    pub now: Instant,
    /// The vehicle's position and heading.
    pub pose: Pose,
}

/// Result of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Searched {
    /// The plan leads to a place that has not been searched yet.
    On,
    /// The search is over: its time has run out, or everything within its radius has been searched.
    Ended,
}

/// A request to the planner; a copy, so that it can be answered while the fast loop goes on.
#[derive(Clone, Debug, Default)]
pub struct PlanRequest {
    /// Number of the request in a flight; seeds the draws together with `seed`.
    pub id: u32,
    /// Seed of the flight.
    pub seed: u64,
    /// The first request since the vehicle was handed over: obstacles and source stay known, earlier attempts to reach
    /// it are forgotten.
    pub begins: bool,
    /// Too soon after another to count as an attempt of its own, as where something has come into the way.
    pub is_early: bool,
    /// Where the trajectory starts.
    pub start_ned_m: Horizontal,
    /// A place on the source's bearing, at a fixed distance: the target if nothing better is known.
    pub target_ned_m: Horizontal,
    /// Where the vehicle is.
    pub position_ned_m: Horizontal,
    /// Averaged unit vector from there to the source; zero when there is none.
    pub direction_ned: Horizontal,
    /// Where the source may be.
    pub support: Support,
    /// How far gusts push the vehicle: its distance to standing obstacles is increased by this.
    pub gust_margin_m: f32,
    /// Whether a moving body is tracked.
    pub among_moving: bool,
    /// The position of the source, if it is known.
    pub known_source_ned_m: Option<Horizontal>,
    /// Set when the range is unknown: bend the path.
    pub learn: Option<Learn>,
    /// Set when no signal is received: search.
    pub search: Option<Search>,
    /// Whether the walls are requested.
    pub wants_walls: bool,
}

/// Result of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Verdict {
    /// A trajectory to follow.
    Follow,
    /// No trajectory keeps its margin: stay at the present position.
    Brake,
}

/// The planner's answer.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Plan {
    /// The request that it answers.
    pub id: u32,
    /// Its result.
    pub verdict: Verdict,
    /// Where the trajectory starts.
    pub start_ned_m: Horizontal,
    /// The trajectory to follow; for a brake plan, the start throughout.
    pub waypoints_ned_m: Trajectory,
    /// The gains of the trajectory.
    pub gains: Gains,
    /// Its cost (eq. 41).
    pub cost: f32,
    /// The temporary target that it leads to.
    pub target_ned_m: Horizontal,
    /// The estimated position of the source.
    pub source: Option<SourcePosition>,
    /// Result of the search, if one was requested.
    pub search: Option<Searched>,
}

/// What the slow loop answers to a request.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Answer {
    /// The plan.
    pub plan: Plan,
    /// The walls among the known obstacles, for the localizer; none if they were not requested.
    pub walls: Vec<Wall, WALLS_MAX>,
}

impl Plan {
    /// The plan to stay at the start.
    #[must_use]
    pub fn brake(config: &Config, request: &PlanRequest) -> Self {
        Self {
            id: request.id,
            verdict: Verdict::Brake,
            start_ned_m: request.start_ned_m,
            waypoints_ned_m: [request.start_ned_m; WAYPOINTS],
            gains: config.gains,
            cost: f32::INFINITY,
            target_ned_m: request.start_ned_m,
            source: None,
            search: None,
        }
    }
}

/// The planner's memory: its estimate of the source, and its workspace. After a replan it contains the samples.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// The trajectory with the mean gains.
    pub initial: Trajectory,
    /// The sampled trajectories.
    pub samples: [Trajectory; SAMPLES],
    /// Their gains.
    pub gains: [Gains; SAMPLES],
    /// Their costs (eq. 41).
    pub costs: [f32; SAMPLES],
    /// Whether they may be chosen.
    pub feasible: [bool; SAMPLES],
    /// The known obstacles; at the end only those that matter within the horizon.
    obstacles: Vec<Obstacle, CIRCLES_MAX>,
    /// The obstacles as used by the rollouts.
    pub scene: Scene,
    memory: mppi::Memory,
    explore: explore::State,
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

impl Workspace {
    /// An empty memory; all its bits are zero, so that it takes no flash.
    #[must_use]
    pub const fn new() -> Self {
        const ZERO: Horizontal = Horizontal { north: 0.0, east: 0.0 };
        const NONE: Gains = Gains { k_att: 0.0, k_rep: 0.0, influence_m: 0.0, swirl: 0.0 };
        Self {
            initial: [ZERO; WAYPOINTS],
            samples: [[ZERO; WAYPOINTS]; SAMPLES],
            gains: [NONE; SAMPLES],
            costs: [0.0; SAMPLES],
            feasible: [false; SAMPLES],
            obstacles: Vec::new(),
            scene: Scene::new(),
            memory: mppi::Memory::new(),
            explore: explore::State::new(),
        }
    }

    /// Copies a sample into the plan.
    fn choose(&self, chosen: usize, plan: &mut Plan) {
        if let (Some(sample), Some(gains), Some(cost)) =
            (self.samples.get(chosen), self.gains.get(chosen), self.costs.get(chosen))
        {
            (plan.waypoints_ned_m, plan.gains, plan.cost) = (*sample, *gains, *cost);
        }
    }
}

/// The configured planner.
#[derive(Clone, Debug)]
pub struct Planner {
    config: Config,
    vehicle: Vehicle,
    sensor: RangeSensor,
    fence: Fence,
    /// Half of the narrowest gap that a path may lead through.
    passable_m: f32,
    walls: walls::Extractor,
    explorer: Option<explore::Explorer>,
}

impl Planner {
    /// The answer to stay at the request's start.
    #[must_use]
    pub fn brake(&self, request: &PlanRequest) -> Answer {
        Answer { plan: Plan::brake(&self.config, request), walls: Vec::new() }
    }

    /// Answers one request; `known` are the known obstacles.
    pub fn answer(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Answer {
        Answer { plan: self.plan(workspace, request, known), walls: self.walls(request, known) }
    }

    /// Plans to the source, or to a place that has not been searched when no signal is received; `known` are the known
    /// obstacles.
    pub fn plan(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Plan {
        if request.begins {
            workspace.explore.end();
        }
        let (Some(search), Some(explorer)) = (&request.search, &self.explorer) else {
            workspace.explore.home();
            return mppi::plan(self, workspace, (request, known), request.known_source_ned_m);
        };
        match explorer.step(&mut workspace.explore, search.now, &search.pose, &self.sensor, known.iter()) {
            Explored::Target(place_ned_m) => {
                let plan = mppi::plan(self, workspace, (request, known), Some(place_ned_m));
                // What shuts the vehicle in, people or a margin in gusts, says nothing about the target.
                if plan.verdict == Verdict::Brake && !workspace.memory.is_shut_in(request.start_ned_m) {
                    workspace.explore.blocked();
                }
                Plan { search: Some(Searched::On), ..plan }
            }
            Explored::Exhausted | Explored::TimedOut | Explored::NoPose => {
                Plan { search: Some(Searched::Ended), ..Plan::brake(&self.config, request) }
            }
        }
    }

    /// The walls among the known obstacles, if they are requested.
    #[must_use]
    pub fn walls(&self, request: &PlanRequest, known: &[Disc]) -> Vec<Wall, WALLS_MAX> {
        if request.wants_walls { self.find_walls(request.position_ned_m, known) } else { Vec::new() }
    }

    /// Its workspace is on the stack: it is not used at the same time as the rest.
    #[inline(never)]
    fn find_walls(&self, seen_from_ned_m: Horizontal, known: &[Disc]) -> Vec<Wall, WALLS_MAX> {
        let mut workspace = walls::Workspace::new();
        let points = walls::points_of(known, seen_from_ned_m);
        self.walls.find(&mut workspace, &points)
    }
}

#[cfg(test)]
mod tests;
