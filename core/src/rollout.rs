//! One trajectory through the field and what it costs.
//!
//! The main paper descends the gradient for 15 steps (section IV) and leaves the step open; here a step is one force
//! evaluation and 2 m / 15 of path in its direction, the reading that its budget allows (two metres of target distance
//! in fifteen waypoints). Cost by eq. 41-45: length, error at the end, turns, proximity.
//!
//! Headings for eq. 44 come from `micromath`'s arctangent: within 0.16 degrees and three times as fast as `libm`'s. A test
//! of [`crate::planner`] shows that it does not change which trajectory is chosen.

use micromath::F32;

use crate::field::{Gains, Obstacle, force};
use crate::frame::Horizontal;
use crate::units::wrap_pi;

/// Waypoints of a trajectory (main paper, section IV).
pub const WAYPOINTS: usize = 15;

/// Distance between waypoints: the paper's 2 m in 15 steps.
pub const SPACING_M: f32 = 2.0 / WAYPOINTS as f32;

/// Proximity below which eq. 45 stops growing: closer, or inside, is as bad.
const PROXIMITY_MIN_M: f32 = 0.01;

/// A trajectory: the waypoints after the start.
pub type Trajectory = [Horizontal; WAYPOINTS];

/// Follows the field from `start`; once at the target it stays there.
#[must_use]
pub fn roll(gains: &Gains, start: Horizontal, target: Horizontal, obstacles: &[Obstacle]) -> Trajectory {
    let mut trajectory = [Horizontal::default(); WAYPOINTS];
    let mut position = start;
    for waypoint in &mut trajectory {
        let left = target.minus(position);
        if left.norm_squared() <= SPACING_M * SPACING_M {
            position = target;
        } else {
            let force = force(gains, position, target, obstacles);
            let norm = force.norm();
            if norm > 1e-6 {
                position = position.plus(force.times(SPACING_M / norm));
            }
        }
        *waypoint = position;
    }
    trajectory
}

/// The terms of eq. 41.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Cost {
    /// Length, metres (eq. 42).
    pub length: f32,
    /// Distance from the end to the target, metres (eq. 43).
    pub error: f32,
    /// Sum of the turns, radians (eq. 44).
    pub turns: f32,
    /// One over the smallest distance to an obstacle, 1/m (eq. 45); 0 where there is none.
    pub proximity: f32,
}

impl Cost {
    /// Eq. 41.
    #[must_use]
    pub fn total(&self) -> f32 {
        self.length + self.error + self.turns + self.proximity
    }
}

/// The cost of a trajectory from `start` (eq. 41-45).
#[must_use]
pub fn cost(start: Horizontal, trajectory: &Trajectory, target: Horizontal, obstacles: &[Obstacle]) -> Cost {
    let mut cost = Cost::default();
    let (mut previous, mut heading_rad) = (start, None);
    for waypoint in trajectory {
        let step = waypoint.minus(previous);
        let length = step.norm();
        if length > 1e-4 {
            let F32(bearing_rad) = F32(step.east).atan2(F32(step.north));
            if let Some(heading_rad) = heading_rad {
                cost.turns += libm::fabsf(wrap_pi(bearing_rad - heading_rad));
            }
            heading_rad = Some(bearing_rad);
        }
        cost.length += length;
        previous = *waypoint;
    }
    cost.error = previous.minus(target).norm();

    let mut closest = f32::INFINITY;
    for obstacle in obstacles {
        for waypoint in trajectory {
            // The square root only where it can matter.
            let limit = closest + obstacle.reach_m;
            let squared = waypoint.minus(obstacle.center_ned_m).norm_squared();
            if squared < limit * limit {
                closest = libm::sqrtf(squared) - obstacle.reach_m;
                if closest < PROXIMITY_MIN_M {
                    cost.proximity = 1.0 / PROXIMITY_MIN_M;
                    return cost;
                }
            }
        }
    }
    cost.proximity = 1.0 / closest;
    cost
}

/// Smallest distance between the vehicle's boundary and any obstacle along the first `segments` segments from `start`;
/// infinite without obstacles. Exact for the straight segments between waypoints.
#[must_use]
pub fn swept_clearance_m(start: Horizontal, trajectory: &[Horizontal], obstacles: &[Obstacle]) -> f32 {
    let mut closest = f32::INFINITY;
    let mut previous = start;
    for waypoint in trajectory {
        let half = 0.5 * waypoint.minus(previous).norm();
        let middle = previous.plus(*waypoint).times(0.5);
        for obstacle in obstacles {
            let limit = closest + obstacle.reach_m + half;
            if middle.minus(obstacle.center_ned_m).norm_squared() >= limit * limit {
                continue;
            }
            let distance =
                Horizontal::distance_to_segment(obstacle.center_ned_m, previous, *waypoint) - obstacle.reach_m;
            if distance < closest {
                closest = distance;
            }
        }
        previous = *waypoint;
    }
    closest
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAINS: Gains = Gains { k_att: 1.0, k_rep: 0.2, influence_m: 0.8, swirl: 0.0 };

    #[test]
    fn without_obstacles_it_goes_straight_to_the_target() {
        let (start, target) = (Horizontal::default(), Horizontal { north: 2.0, east: 0.0 });
        let trajectory = roll(&GAINS, start, target, &[]);
        assert!(trajectory[14].minus(target).norm() < 1e-5);
        let cost = cost(start, &trajectory, target, &[]);
        assert!((cost.total() - 2.0).abs() < 1e-4, "{cost:?}");
        assert_eq!(swept_clearance_m(start, &trajectory, &[]), f32::INFINITY);
    }

    #[test]
    fn the_cost_of_a_known_staircase_is_what_the_paper_says() {
        let start = Horizontal::default();
        // One metre north, one metre east, then standing still.
        let mut trajectory = [Horizontal { north: 1.0, east: 1.0 }; WAYPOINTS];
        trajectory[0] = Horizontal { north: 1.0, east: 0.0 };
        let target = Horizontal { north: 1.0, east: 3.0 };
        let obstacle =
            Obstacle { center_ned_m: Horizontal { north: 0.0, east: 1.0 }, reach_m: 0.5, ..Obstacle::default() };
        let cost = cost(start, &trajectory, target, &[obstacle]);
        assert!((cost.length - 2.0).abs() < 1e-6 && (cost.error - 2.0).abs() < 1e-6);
        assert!((cost.turns - core::f32::consts::FRAC_PI_2).abs() < 2.0 * 0.0029);
        assert!((cost.proximity - 2.0).abs() < 1e-5, "{cost:?}");
        // Between the waypoints (1,0) and (1,1) the obstacle is 0.5 m away, from the start to (1,0) 0.5 m as well.
        assert!((swept_clearance_m(start, &trajectory, &[obstacle]) - 0.5).abs() < 1e-5);
    }

    #[test]
    fn a_segment_that_jumps_over_a_pillar_is_seen() {
        let start = Horizontal::default();
        let trajectory = [Horizontal { north: 2.0, east: 0.0 }];
        let pillar =
            Obstacle { center_ned_m: Horizontal { north: 1.0, east: 0.05 }, reach_m: 0.2, ..Obstacle::default() };
        assert!((swept_clearance_m(start, &trajectory, &[pillar]) + 0.15).abs() < 1e-5);
    }
}
