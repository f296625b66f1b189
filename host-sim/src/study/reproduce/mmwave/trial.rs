//! One search: the robot, its sensors and its navigation, until it is there or has given up.

use foxhound_core::ConfigError;
use serde::Serialize;

use super::agent::{Agent, Kind};
use super::cycle::{STEP_M, View};
use super::known::Known;
use super::plan::Plan;
use super::radio::{self, Link};
use crate::world::Horizontal;
use crate::world::random::Random;

/// Control cycles, before a search is given up.
pub(super) const CYCLES_MAX: u32 = 500;
/// The transmitter is found within this distance, in sight.
pub(super) const FOUND_M: f64 = 1.0;
/// A path is planned again when the goal has moved by this much.
const GOAL_MOVED_M: f64 = 0.3;
/// The robot's hull keeps this from walls that it has not seen.
const HULL_M: f64 = 0.1;

/// Where a search begins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start {
    /// Of the transmitter.
    pub(super) transmitter: Horizontal,
    /// Of the robot.
    pub(super) place: Horizontal,
    /// Of the noise.
    pub(super) seed: u64,
}

/// What the angle of arrival is like.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Noise {
    /// Standard deviation of the angle of arrival, white from cycle to cycle.
    pub sigma_rad: f64,
    /// Rate at which the state of the link is given wrongly.
    pub link_error_rate: f64,
}

/// How a search went.
#[derive(Clone, Debug)]
pub(super) struct Trial {
    /// Whether the transmitter was found.
    pub(super) found: bool,
    /// Length of the path.
    pub(super) length_m: f64,
    /// Control cycles.
    pub(super) cycles: u32,
    /// The path.
    pub(super) path: Vec<Horizontal>,
    /// Points of the map at the end.
    pub(super) points: Vec<Horizontal>,
}

/// Follows paths on the known map.
struct Navigator {
    way: Vec<Horizontal>,
    goal: Option<Horizontal>,
}

impl Navigator {
    /// The next place; `None` when there is no path.
    fn step(&mut self, known: &Known, place: Horizontal, goal: Horizontal) -> Option<Horizontal> {
        let moved = self.goal.is_none_or(|old| old.minus(goal).norm() > GOAL_MOVED_M);
        if moved || self.next(known, place).is_none() {
            // There already, as near as can be: no step.
            self.goal = None;
            self.way = known.way(place, goal)?;
            self.goal = Some(goal);
        }
        let next = self.next(known, place).or_else(|| self.way.first().copied())?;
        let leg = next.minus(place);
        let length_m = leg.norm();
        if length_m <= STEP_M { Some(next) } else { Some(place.along(leg, STEP_M / length_m)) }
    }

    /// The farthest point of the path that can be reached in a straight line; the ones before are dropped.
    fn next(&mut self, known: &Known, place: Horizontal) -> Option<Horizontal> {
        while self.way.first().is_some_and(|first| first.minus(place).norm() < 1e-6) {
            self.way.remove(0);
        }
        let farthest = (0..self.way.len().min(40)).rev().find(|k| known.is_clear(place, self.way[*k]))?;
        self.way.drain(..farthest);
        self.way.first().copied()
    }
}

/// Searches.
///
/// # Errors
/// None that the built-in configuration could cause.
pub(super) fn search(plan: &Plan, start: &Start, kind: Kind, noise: Noise) -> Result<Trial, ConfigError> {
    let mut agent = Agent::new(kind, start.transmitter, noise.sigma_rad, start.seed)?;
    let [mut air, mut classifier, mut ranges] = [2, 3, 4].map(|purpose| Random::new(start.seed, purpose));
    let mut known = Known::new(plan);
    let mut navigator = Navigator { way: Vec::new(), goal: None };
    let mut place = start.place;
    let mut trial = Trial { found: false, length_m: 0.0, cycles: 0, path: vec![place], points: Vec::new() };
    for cycle in 0..=CYCLES_MAX {
        trial.cycles = cycle;
        if is_found(plan, start.transmitter, place) {
            trial.found = true;
            break;
        }
        let scan = known.scan(&plan.walls, place, &mut ranges);
        let heard = radio::hear(&plan.walls, start.transmitter, place);
        let error = noise.sigma_rad * air.gaussian();
        let link: Link = heard.link.told(noise.link_error_rate, &mut classifier);
        let bearing_rad = heard.bearing_rad + error;
        let view = View { cycle, known: &known, scan: &scan, place, link, bearing_rad };
        let goal = agent.decide(&view);
        let Some(goal) = goal else { continue };
        let Some(next) = navigator.step(&known, place, goal) else {
            agent.blocked();
            continue;
        };
        if plan.is_clear(place, next) && plan.room_m(next) > HULL_M {
            trial.length_m += next.minus(place).norm();
            place = next;
            trial.path.push(place);
        } else {
            // A wall that no ray has met stops it all the same, and is felt.
            known.keep_off(plan.nearest_of_walls(next));
        }
    }
    trial.points = known.points().to_vec();
    Ok(trial)
}

/// Whether the transmitter is close by and not behind a wall.
fn is_found(plan: &Plan, transmitter: Horizontal, place: Horizontal) -> bool {
    transmitter.minus(place).norm() <= FOUND_M && plan.is_clear(place, transmitter)
}
