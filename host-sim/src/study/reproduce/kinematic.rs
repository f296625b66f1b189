//! A planner flown as published: a point that moves exactly along the waypoints.
//!
//! No dynamics, no tracker, no guard. At each replan the point turns to the measured bearing, true but for the noise, and
//! senses; what it sees it keeps, exactly and for good. It follows the plan up to the fifth waypoint (main paper, section
//! IV) and senses at each. Pillars do not hide one another.
//!
//! What the paper leaves open is in [`Rules`].

use foxhound_core::base::obstacle::Disc;
use foxhound_core::mapping::map::CIRCLES_MAX;
use foxhound_core::planning::planner::{PlanRequest, Workspace};
use foxhound_papers::apf::AnyPlanner;
use serde::Serialize;

use crate::drive::flight::Ending;
use crate::scenario::Scenario;
use crate::world::random::Random;
use crate::world::{Horizontal, Hull, Pillar, from_core, wrap_pi};

/// Distance of the temporary target (main paper, section IV).
const TARGET_M: f64 = 2.0;
/// Parts of a segment after which the hull is checked.
const PARTS: u32 = 8;
/// Purpose of the random numbers.
const NOISE: u64 = 11;

/// What a pillar has to do to be known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sight {
    /// Come into the field of view of a nose that points to the source.
    #[default]
    ToSource,
    /// Come into the field of view of a nose that points along the path.
    AlongWay,
    /// Nothing: all are known from the start.
    Everything,
}

/// What the paper leaves open.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rules {
    /// Replans before a flight is given up as stalled.
    pub replans_max: u32,
    /// Waypoints from replan to replan (main paper, section IV: 5).
    pub followed: usize,
    /// Distance to the goal that counts as reached; `None` for the scenario's.
    pub tolerance_m: Option<f64>,
    /// What is known of the pillars.
    pub sight: Sight,
}

impl Default for Rules {
    fn default() -> Self {
        Self { replans_max: 200, followed: 5, tolerance_m: None, sight: Sight::ToSource }
    }
}

/// The result of a flight.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Flown {
    /// Reached, collision, or timeout: not there after all replans.
    pub(super) ending: Ending,
    /// Length of the path.
    pub(super) length_m: f64,
    /// Smallest distance between hull and pillars.
    pub(super) min_clearance_m: Option<f64>,
    /// Plans made.
    pub(super) replans: u32,
    /// From the start, waypoint by waypoint.
    pub(super) path: Vec<Horizontal>,
}

/// The pillars and which of them are known.
struct Known<'a> {
    scenario: &'a Scenario,
    pillars: &'a [Pillar],
    seen: Vec<bool>,
}

impl Known<'_> {
    /// Senses once; sees a pillar if any part of it is within the field of view, and its near side within range.
    fn look(&mut self, from: Horizontal, yaw_rad: f64) {
        let sensor = &self.scenario.sensor;
        for (pillar, seen) in self.pillars.iter().zip(&mut self.seen) {
            let to = pillar.center.minus(from);
            let distance_m = to.norm();
            if distance_m - pillar.radius_m <= sensor.range_m {
                let aside_rad = wrap_pi(to.bearing_rad() - yaw_rad).abs();
                let half_rad = libm::asin((pillar.radius_m / distance_m).min(1.0));
                *seen |= distance_m <= pillar.radius_m || aside_rad - half_rad <= sensor.fov_deg.to_radians() / 2.0;
            }
        }
    }

    /// The known pillars as the planner takes them, the nearest first.
    fn discs(&self, from: Horizontal) -> Vec<Disc> {
        let gap = |pillar: &Pillar| pillar.center.minus(from).norm() - pillar.radius_m;
        let mut known: Vec<&Pillar> =
            self.pillars.iter().zip(&self.seen).filter(|(_, seen)| **seen).map(|(pillar, _)| pillar).collect();
        known.sort_by(|a, b| gap(a).total_cmp(&gap(b)));
        let disc = |pillar: &Pillar| Disc {
            center_ned_m: pillar.center.to_core(),
            radius_m: pillar.radius_m as f32,
            ..Disc::default()
        };
        known.into_iter().take(CIRCLES_MAX).map(disc).collect()
    }
}

/// Flies a scenario.
pub(super) fn fly(scenario: &Scenario, planner: &AnyPlanner, rules: Rules, seed: u64) -> Flown {
    let world = scenario.world();
    let goal = world.source;
    let start = Horizontal::from_xy(scenario.start);
    let tolerance_m = rules.tolerance_m.unwrap_or(scenario.goal_tolerance);
    let sigma_rad = scenario.bearing.sigma_deg.to_radians();
    let mut hull = Hull::new(&world, scenario.drone_radius, start);
    let mut random = Random::new(seed, NOISE);
    let mut workspace = Workspace::new();
    let everything = rules.sight == Sight::Everything;
    let mut known = Known { scenario, pillars: &world.pillars, seen: vec![everything; world.pillars.len()] };
    let mut flown =
        Flown { ending: Ending::Timeout, length_m: 0.0, min_clearance_m: None, replans: 0, path: vec![start] };
    let mut position = start;
    let mut yaw_rad = goal.minus(start).bearing_rad();
    'flight: for id in 0..rules.replans_max {
        let heard_rad = goal.minus(position).bearing_rad() + sigma_rad * random.gaussian();
        if rules.sight == Sight::ToSource {
            yaw_rad = heard_rad;
        }
        known.look(position, yaw_rad);
        let here = position.to_core();
        let request = PlanRequest {
            id,
            seed,
            start_ned_m: here,
            position_ned_m: here,
            target_ned_m: position.along(Horizontal::from_bearing(heard_rad), TARGET_M).to_core(),
            known_source_ned_m: Some(goal.to_core()),
            ..PlanRequest::default()
        };
        let plan = planner.plan(&mut workspace, &request, &known.discs(position));
        flown.replans += 1;
        for waypoint in plan.waypoints_ned_m.iter().take(rules.followed) {
            let step = from_core(*waypoint).minus(position);
            for part in 1..=PARTS {
                let share = f64::from(part) / f64::from(PARTS);
                let place = position.along(step, share);
                let ending = if hull.collides(&world, place, 0.0) {
                    Some(Ending::Collision)
                } else {
                    (goal.minus(place).norm() <= tolerance_m).then_some(Ending::Reached)
                };
                if let Some(ending) = ending {
                    flown.ending = ending;
                    flown.length_m += share * step.norm();
                    flown.path.push(place);
                    break 'flight;
                }
            }
            if rules.sight == Sight::AlongWay && step.norm() > 0.0 {
                yaw_rad = step.bearing_rad();
            }
            position = from_core(*waypoint);
            flown.length_m += step.norm();
            flown.path.push(position);
            known.look(position, yaw_rad);
        }
    }
    flown.min_clearance_m = Some(hull.min_clearance_m).filter(|clearance| clearance.is_finite());
    flown
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::config::{RangeSensor, Vehicle};
    use foxhound_core::control::guard;
    use foxhound_papers::apf;

    fn fly_past(obstacles: &str, rules: Rules) -> Flown {
        let text = format!(
            r#"{{"start":[1,5],"goal":[9,5],"bearing":{{"sigma_deg":0}},"goal_tolerance":0.3,"obstacles":{obstacles}}}"#
        );
        let planner = AnyPlanner::build(
            &apf::named("standard").unwrap(),
            &Vehicle::DEFAULT,
            &RangeSensor::DEFAULT,
            &guard::Config::default(),
        )
        .unwrap();
        fly(&Scenario::parse(&text).unwrap(), &planner, rules, 1)
    }

    #[test]
    fn in_the_open_the_point_goes_straight_to_the_goal() {
        let flown = fly_past("[]", Rules::default());
        assert_eq!(flown.ending, Ending::Reached);
        assert!((flown.length_m - 7.7).abs() < 0.02, "{}", flown.length_m);
        assert_eq!(flown.replans, 12);
        assert!(flown.path.iter().all(|place| (place.north - 5.0).abs() < 1e-4));
        let near = fly_past("[]", Rules { tolerance_m: Some(0.1), ..Rules::default() });
        assert!((near.length_m - 7.9).abs() < 0.02, "{}", near.length_m);
    }

    #[test]
    fn a_pillar_in_the_line_is_a_local_minimum_and_one_behind_the_goal_is_none() {
        assert_ne!(fly_past(r#"[{"x":5,"y":5,"r":0.5}]"#, Rules::default()).ending, Ending::Reached);
        assert_eq!(fly_past(r#"[{"x":9.9,"y":5,"r":0.2}]"#, Rules::default()).ending, Ending::Reached);
    }

    #[test]
    fn what_stands_outside_the_field_of_view_is_hit_unless_all_is_known() {
        // Seen from the start, its near rim is 48 deg to the left.
        let beside = r#"[{"x":1.1,"y":5.185,"r":0.05}]"#;
        let flown = fly_past(beside, Rules::default());
        assert_eq!(flown.ending, Ending::Collision);
        assert!(flown.min_clearance_m.unwrap() < 0.0);
        let known = fly_past(beside, Rules { sight: Sight::Everything, ..Rules::default() });
        assert_eq!(known.ending, Ending::Reached);
    }

    #[test]
    fn replans_are_limited() {
        assert_eq!(fly_past("[]", Rules { replans_max: 3, ..Rules::default() }).replans, 3);
    }
}
