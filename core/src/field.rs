//! The artificial potential field: attraction to the target, repulsion from circles.
//!
//! - attraction (eq. 33): `U = 1/2 k_att |q - q_goal|^2`, force `-k_att (q - q_goal)`;
//! - logarithmic repulsion (eq. 36): `U = -k_rep ln(d / d_0)` inside the influence range `d_0`, force `k_rep / d` away from
//!   the circle, where `d` is the distance between the vehicle's and the obstacle's boundaries (eq. 35).
//!
//! Our planner adds a swirl: a share of each repulsion, turned by a right angle, which carries the vehicle round what
//! stands exactly in its way.

use crate::frame::Horizontal;
use crate::map::Circle;

/// Distance below which the repulsion stops growing: inside a circle its force still points out and stays finite.
const DISTANCE_MIN_M: f32 = 0.01;

/// The parameters that the planner samples (eq. 38-40), and the swirl.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Gains {
    /// Attraction constant.
    pub k_att: f32,
    /// Repulsion constant.
    pub k_rep: f32,
    /// Influence range of an obstacle's boundary, `d_0`.
    pub influence_m: f32,
    /// Share of the repulsion that acts sideways; positive turns clockwise (leaves the obstacle to the right).
    pub swirl: f32,
}

/// An obstacle as the field sees it: the circle within which the vehicle's centre must not come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Obstacle {
    /// Centre.
    pub center_ned_m: Horizontal,
    /// Radius of the obstacle plus that of the vehicle.
    pub reach_m: f32,
    /// Velocity; the field takes obstacles as they stand, the guard does not.
    pub velocity_ned_mps: Horizontal,
}

impl Obstacle {
    /// A circle as an obstacle to a vehicle of the given radius.
    #[must_use]
    pub fn of(circle: &Circle, vehicle_radius_m: f32) -> Self {
        Self {
            center_ned_m: circle.center_ned_m,
            reach_m: circle.radius_m + vehicle_radius_m,
            velocity_ned_mps: circle.velocity_ned_mps,
        }
    }

    /// Distance from the vehicle's boundary to the obstacle's (eq. 35); negative inside.
    #[must_use]
    pub fn clearance_m(&self, position_ned_m: Horizontal) -> f32 {
        position_ned_m.minus(self.center_ned_m).norm() - self.reach_m
    }
}

/// The force at a position: minus the gradient of eq. 37.
#[must_use]
pub fn force(gains: &Gains, position: Horizontal, target: Horizontal, obstacles: &[Obstacle]) -> Horizontal {
    let mut total = target.minus(position).times(gains.k_att);
    for obstacle in obstacles {
        let away = position.minus(obstacle.center_ned_m);
        let range = obstacle.reach_m + gains.influence_m;
        let squared = away.norm_squared();
        if squared >= range * range {
            continue;
        }
        let norm = libm::sqrtf(squared);
        let distance = norm - obstacle.reach_m;
        let distance = if distance > DISTANCE_MIN_M { distance } else { DISTANCE_MIN_M };
        // Exactly at the centre any direction will do.
        let out = if norm > 1e-6 { away.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
        let push = gains.k_rep / distance;
        let side = Horizontal { north: -out.east, east: out.north };
        total = total.plus(out.times(push)).plus(side.times(push * gains.swirl));
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eq. 33 + 36 in f64.
    fn potential(gains: &Gains, q: (f64, f64), target: Horizontal, obstacles: &[Obstacle]) -> f64 {
        let to = (q.0 - f64::from(target.north), q.1 - f64::from(target.east));
        let mut u = 0.5 * f64::from(gains.k_att) * (to.0 * to.0 + to.1 * to.1);
        for o in obstacles {
            let from = (q.0 - f64::from(o.center_ned_m.north), q.1 - f64::from(o.center_ned_m.east));
            let d = from.0.hypot(from.1) - f64::from(o.reach_m);
            if d < f64::from(gains.influence_m) {
                u -= f64::from(gains.k_rep) * (d / f64::from(gains.influence_m)).ln();
            }
        }
        u
    }

    #[test]
    fn the_force_is_minus_the_gradient_of_the_potential() {
        let gains = Gains { k_att: 1.3, k_rep: 0.2, influence_m: 0.8, swirl: 0.0 };
        let target = Horizontal { north: 2.0, east: -1.0 };
        let obstacles = [
            Obstacle { center_ned_m: Horizontal { north: 1.0, east: 0.2 }, reach_m: 0.4, ..Obstacle::default() },
            Obstacle { center_ned_m: Horizontal { north: 0.3, east: -0.9 }, reach_m: 0.3, ..Obstacle::default() },
        ];
        let mut tested = 0;
        for i in 0..20 {
            for j in 0..20 {
                let q = Horizontal { north: -0.5 + 0.15 * i as f32, east: -1.5 + 0.15 * j as f32 };
                let near =
                    |o: &Obstacle| o.clearance_m(q) < 0.05 || (o.clearance_m(q) - gains.influence_m).abs() < 0.01;
                if obstacles.iter().any(near) {
                    continue;
                }
                let (x, y, h) = (f64::from(q.north), f64::from(q.east), 1e-5);
                let at = |a, b| potential(&gains, (a, b), target, &obstacles);
                let gradient = ((at(x + h, y) - at(x - h, y)) / (2.0 * h), (at(x, y + h) - at(x, y - h)) / (2.0 * h));
                let f = force(&gains, q, target, &obstacles);
                assert!((f64::from(f.north) + gradient.0).abs() < 1e-3, "{q:?}");
                assert!((f64::from(f.east) + gradient.1).abs() < 1e-3, "{q:?}");
                tested += 1;
            }
        }
        assert!(tested > 250);
    }

    #[test]
    fn inside_an_obstacle_and_at_its_centre_the_force_is_finite_and_points_out() {
        let gains = Gains { k_att: 1.0, k_rep: 0.2, influence_m: 0.8, swirl: 0.3 };
        let obstacle = Obstacle { center_ned_m: Horizontal::default(), reach_m: 0.5, ..Obstacle::default() };
        let inside = Horizontal { north: 0.0, east: 0.2 };
        assert!(force(&gains, inside, inside, &[obstacle]).east > 0.0);
        assert!(force(&gains, Horizontal::default(), inside, &[obstacle]).is_finite());
    }
}
