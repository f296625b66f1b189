//! What the autopilot tells us of our own vehicle.

use crate::frame::Ned;
use crate::time::Instant;
use crate::units::wrap_pi;

/// Position, velocity and attitude of the vehicle, as last heard.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Ownship {
    /// When position and velocity were heard.
    pub position_time: Instant,
    /// Position in the autopilot's local NED frame, metres.
    pub position_ned_m: Ned,
    /// Velocity in the local NED frame, metres a second.
    pub velocity_ned_mps: Ned,
    /// When the attitude was heard.
    pub attitude_time: Instant,
    /// Roll, right side down positive.
    pub roll_rad: f32,
    /// Pitch, nose up positive.
    pub pitch_rad: f32,
    /// Yaw from north, clockwise positive.
    pub yaw_rad: f32,
    /// Yaw rate, clockwise positive.
    pub yaw_rate_radps: f32,
}

impl Ownship {
    /// Yaw at an instant near the last attitude, carried there by the yaw rate for at most 0.1 s.
    #[must_use]
    pub fn yaw_at(&self, at: Instant) -> f32 {
        let ahead_s = at.seconds_since(self.attitude_time) - self.attitude_time.seconds_since(at);
        wrap_pi(self.yaw_rad + self.yaw_rate_radps * ahead_s.clamp(-0.1, 0.1))
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position_ned_m.is_finite()
            && self.velocity_ned_mps.is_finite()
            && self.roll_rad.is_finite()
            && self.pitch_rad.is_finite()
            && self.yaw_rad.is_finite()
            && self.yaw_rate_radps.is_finite()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yaw_is_carried_both_ways_but_not_far() {
        let ownship =
            Ownship { attitude_time: Instant(1_000_000), yaw_rad: 1.0, yaw_rate_radps: 2.0, ..Ownship::default() };
        assert!((ownship.yaw_at(Instant(1_050_000)) - 1.1).abs() < 1e-5);
        assert!((ownship.yaw_at(Instant(950_000)) - 0.9).abs() < 1e-5);
        assert!((ownship.yaw_at(Instant(9_000_000)) - 1.2).abs() < 1e-5);
    }
}
