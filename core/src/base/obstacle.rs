//! Obstacles as all layers use them: a circle, and a circle enlarged by the vehicle's radius.

use crate::base::ned::Horizontal;

/// An obstacle as a vertical cylinder, in the local NED frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Circle {
    /// Centre.
    pub center_ned_m: Horizontal,
    /// Radius.
    pub radius_m: f32,
    /// Velocity.
    pub velocity_ned_mps: Horizontal,
}

impl Circle {
    /// Whether its numbers are finite, not negative and not absurd.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        self.center_ned_m.is_finite()
            && self.velocity_ned_mps.is_finite()
            && self.radius_m >= 0.0
            && self.radius_m <= 1e3
            && self.center_ned_m.norm_squared() < 1e12
            && self.velocity_ned_mps.norm_squared() < 1e4
    }
}

/// A circle as the planner uses it: its position now, and whether it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Disc {
    /// Centre.
    pub center_ned_m: Horizontal,
    /// Radius, its standard deviation included.
    pub radius_m: f32,
    /// Standard deviation of centre and radius, mm: sixteen bytes are enough for all of a disc.
    pub sigma_mm: u16,
    /// Whether it moves.
    pub moves: bool,
}

impl Disc {
    /// Whether its numbers are finite, not negative and not absurd.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        let Self { center_ned_m, radius_m, .. } = *self;
        Circle { center_ned_m, radius_m, ..Circle::default() }.is_plausible()
    }

    /// As it was measured: without its standard deviation.
    #[must_use]
    pub fn measured(&self) -> Self {
        Self { radius_m: self.radius_m - 0.001 * f32::from(self.sigma_mm), ..*self }
    }
}

impl From<Circle> for Disc {
    fn from(circle: Circle) -> Self {
        let Circle { center_ned_m, radius_m, velocity_ned_mps } = circle;
        Self { center_ned_m, radius_m, sigma_mm: 0, moves: velocity_ned_mps != Horizontal::default() }
    }
}

/// An obstacle as the potential field uses it: the circle that the vehicle's centre must not enter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Obstacle {
    /// Centre.
    pub center_ned_m: Horizontal,
    /// Radius of the obstacle plus that of the vehicle.
    pub reach_m: f32,
}

impl Obstacle {
    /// A disc as an obstacle to a vehicle of the given radius.
    #[must_use]
    pub fn of(disc: &Disc, vehicle_radius_m: f32) -> Self {
        Self { center_ned_m: disc.center_ned_m, reach_m: disc.radius_m + vehicle_radius_m }
    }

    /// Distance from the vehicle's boundary to the obstacle's (eq. 35); negative inside.
    #[must_use]
    pub fn clearance_m(&self, position_ned_m: Horizontal) -> f32 {
        position_ned_m.minus(self.center_ned_m).norm() - self.reach_m
    }
}

/// An obstacle near the vehicle, as the guard uses it: with its velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Neighbour {
    /// Centre.
    pub center_ned_m: Horizontal,
    /// Radius of the obstacle plus that of the vehicle.
    pub reach_m: f32,
    /// Velocity.
    pub velocity_ned_mps: Horizontal,
}

impl Neighbour {
    /// A circle as a neighbour of a vehicle of the given radius.
    #[must_use]
    pub fn of(circle: &Circle, vehicle_radius_m: f32) -> Self {
        Self {
            center_ned_m: circle.center_ned_m,
            reach_m: circle.radius_m + vehicle_radius_m,
            velocity_ned_mps: circle.velocity_ned_mps,
        }
    }

    /// Distance from the vehicle's boundary to the obstacle's; negative inside.
    #[must_use]
    pub fn clearance_m(&self, position_ned_m: Horizontal) -> f32 {
        self.standing().clearance_m(position_ned_m)
    }

    /// The same obstacle without its velocity.
    #[must_use]
    pub fn standing(&self) -> Obstacle {
        Obstacle { center_ned_m: self.center_ned_m, reach_m: self.reach_m }
    }
}
