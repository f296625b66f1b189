//! What the autopilot tells us of our own vehicle.

use crate::frame::Ned;
use crate::time::Instant;
use crate::units::{sin_cos, wrap_pi};

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

    /// The bearing, from north and clockwise, of a source at our height that is heard on a body azimuth at an instant.
    ///
    /// A tilted array sees the horizon as a tilted plane: 10 degrees of tilt turn an azimuth by up to 0.4 degrees. With `R`
    /// the rotation from body to NED, a level direction `psi` is heard on `atan2(R_12 cos psi + R_22 sin psi,
    /// R_11 cos psi + R_21 sin psi)`; this is its inverse.
    #[must_use]
    pub fn bearing_ned_rad(&self, azimuth_rad: f32, at: Instant) -> f32 {
        let (sin_roll, cos_roll) = sin_cos(self.roll_rad);
        let (sin_pitch, cos_pitch) = sin_cos(self.pitch_rad);
        let (sin_azimuth, cos_azimuth) = sin_cos(azimuth_rad);
        // Yaw is added at the end; without it R_11 = cos pitch, R_21 = 0, R_12 = sin roll sin pitch, R_22 = cos roll.
        let level = libm::atan2f(cos_pitch * sin_azimuth - sin_roll * sin_pitch * cos_azimuth, cos_roll * cos_azimuth);
        wrap_pi(level + self.yaw_at(at))
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
    fn a_tilted_array_still_finds_the_level_bearing() {
        for (roll, pitch, yaw) in [(0.0_f64, 0.0_f64, 0.0_f64), (0.3, -0.2, 1.0), (-0.25, 0.3, -2.0), (0.0, 0.35, 3.0)]
        {
            for degree in (-175..=180).step_by(5) {
                let psi = f64::from(degree).to_radians();
                // The level direction in the body frame, by the transposed rotation (yaw, pitch, roll), in f64.
                let (n, e) = ((psi - yaw).cos(), (psi - yaw).sin());
                let forward = pitch.cos() * n;
                let right = roll.sin() * pitch.sin() * n + roll.cos() * e;
                let ownship = Ownship {
                    roll_rad: roll as f32,
                    pitch_rad: pitch as f32,
                    yaw_rad: yaw as f32,
                    ..Ownship::default()
                };
                let found = ownship.bearing_ned_rad(right.atan2(forward) as f32, Instant(0));
                let error = wrap_pi(found - psi as f32);
                assert!(error.abs() < 1e-5, "{roll} {pitch} {yaw} {degree}: {error}");
            }
        }
    }

    #[test]
    fn yaw_is_carried_both_ways_but_not_far() {
        let ownship =
            Ownship { attitude_time: Instant(1_000_000), yaw_rad: 1.0, yaw_rate_radps: 2.0, ..Ownship::default() };
        assert!((ownship.yaw_at(Instant(1_050_000)) - 1.1).abs() < 1e-5);
        assert!((ownship.yaw_at(Instant(950_000)) - 0.9).abs() < 1e-5);
        assert!((ownship.yaw_at(Instant(9_000_000)) - 1.2).abs() < 1e-5);
    }
}
