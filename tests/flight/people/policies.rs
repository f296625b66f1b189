//! What others would do among the same people: stand still, fly on blindly, brake, or fly by ORCA. They are told everybody within 5 m, behind
//! others too, and fly the simulator's point mass without the rest of it: where they are and where the goal is they know.

use foxhound_sim::scenario::Scenario;
use foxhound_sim::world::vehicle::{Command, Vehicle};
use foxhound_sim::world::{Horizontal, Hull, Pose, horizontal};
use serde_json::Value;

use super::orca::{self, V, dot, minus, norm, plus};

const STEP_S: f64 = 0.02;
/// As often as in a flight the hull is checked.
const CHECKS: usize = 4;
const TOLD_M: f64 = 5.0;
/// Kept from others beside the radii.
const MARGIN_M: f64 = 0.05;
/// So long who only stands stands: as long as the people were recorded.
const STANDS_S: f64 = 25.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Policy {
    Stands,
    Straight,
    Brakes,
    Orca,
}

/// What a flight came to.
pub(super) struct Flown {
    pub(super) hit: bool,
    /// Seconds for each metre, of a flight that arrived.
    pub(super) pace_spm: Option<f64>,
}

/// Flies one with a seed, at the most `v_max_mps`.
pub(super) fn fly(world: &Value, seed: u64, policy: Policy, v_max_mps: f64) -> Flown {
    let scenario = Scenario::parse(&world.to_string()).unwrap();
    let (mut world, start) = (scenario.peopled(seed), Horizontal::from_xy(scenario.start));
    let pose = Pose { position_ned_m: [start.north, start.east, -2.0], ..Pose::default() };
    let mut vehicle = Vehicle::new(scenario.vehicle, scenario.limits.a_max, pose);
    let mut hull = Hull::new(&world, scenario.drone_radius, start);
    let lasts_s = if policy == Policy::Stands { STANDS_S } else { scenario.max_time_s };
    for step in 0..(lasts_s / STEP_S) as u32 {
        let time_s = f64::from(step) * STEP_S;
        let place = horizontal(&vehicle.motion.pose);
        let to_goal = Horizontal::from_xy(scenario.goal).minus(place);
        if to_goal.norm() <= scenario.goal_tolerance {
            let straight_m = Horizontal::from_xy(scenario.goal).minus(start).norm();
            return Flown { hit: false, pace_spm: Some(time_s / straight_m) };
        }
        let [north_mps, east_mps, _] = vehicle.motion.velocity_ned_mps;
        let ahead = [to_goal.north, to_goal.east].map(|part| part / to_goal.norm() * v_max_mps);
        let others: Vec<(V, V)> = world
            .pillars_at(time_s)
            .map(|body| (body.center.minus(place), body.velocity_mps))
            .filter(|(apart, _)| apart.norm() <= TOLD_M)
            .map(|(apart, moves)| ([apart.north, apart.east], [moves.north, moves.east]))
            .collect();
        let reach_m = scenario.drone_radius + 0.3 + MARGIN_M;
        let own = [north_mps, east_mps];
        let [north, east] = match policy {
            Policy::Stands => [0.0, 0.0],
            Policy::Straight => ahead,
            Policy::Brakes => brakes(own, ahead, &others, reach_m, [scenario.limits.a_max, scenario.vehicle.lag_s]),
            Policy::Orca => orca::velocity(own, ahead, &others, reach_m, v_max_mps),
        };
        let command = Command { velocity_ned_mps: [north, east, 0.0], ..Command::default() };
        let velocity = Horizontal { north: north_mps, east: east_mps };
        world.step_aside(scenario.drone_radius, place, velocity, time_s, time_s + STEP_S);
        for part in 1..=CHECKS {
            vehicle.step(command, STEP_S / CHECKS as f64);
            let at_s = time_s + STEP_S * part as f64 / CHECKS as f64;
            if hull.collides(&world, horizontal(&vehicle.motion.pose), at_s) {
                return Flown { hit: true, pace_spm: None };
            }
        }
    }
    Flown { hit: false, pace_spm: None }
}

/// Straight on, as long as it would be at rest before it met anybody if it braked the next moment; else it brakes.
fn brakes(own: V, ahead: V, others: &[(V, V)], reach_m: f64, [a_max_mps2, lag_s]: [f64; 2]) -> V {
    const LOOK_S: f64 = 0.1;
    let (mut place, mut velocity, mut time_s) = ([0.0; 2], own, 0.0);
    // The first moment straight on, then braking.
    while time_s < LOOK_S || norm(velocity) > 0.02 {
        let wanted = if time_s < LOOK_S { ahead } else { [0.0; 2] };
        let change = minus(wanted, velocity);
        let most = (STEP_S / lag_s * norm(change)).min(a_max_mps2 * STEP_S);
        velocity = plus(velocity, change, most / norm(change).max(1e-9));
        place = plus(place, velocity, STEP_S);
        time_s += STEP_S;
        let meets = |(apart, moves): &(V, V)| {
            let now = minus(plus(*apart, *moves, time_s), place);
            norm(now) < reach_m && dot(now, minus(*moves, velocity)) < 0.0
        };
        if others.iter().any(meets) {
            return [0.0; 2];
        }
    }
    ahead
}
