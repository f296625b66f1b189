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

    /// The direction to a source in the body frame, `[forward, right, down]`, from its bearing relative to the nose's heading
    /// and its depression below the horizon.
    #[must_use]
    pub fn to_body(&self, heading_off_rad: f32, depression_rad: f32) -> [f32; 3] {
        let (sin_off, cos_off) = sin_cos(heading_off_rad);
        let (down, level) = sin_cos(depression_rad);
        self.leant(cos_off * level, sin_off * level, down)
    }

    /// A vector in the body frame, `[forward, right, down]`.
    #[must_use]
    pub fn vector_to_body(&self, vector_ned: Ned) -> [f32; 3] {
        let (sin_yaw, cos_yaw) = sin_cos(self.yaw_rad);
        let Ned { north, east, down } = vector_ned;
        self.leant(cos_yaw * north + sin_yaw * east, cos_yaw * east - sin_yaw * north, down)
    }

    /// From ahead, to the right and down, level, into the body's own axes: rotations by pitch and roll, backwards.
    fn leant(&self, ahead: f32, right: f32, down: f32) -> [f32; 3] {
        let (sin_roll, cos_roll) = sin_cos(self.roll_rad);
        let (sin_pitch, cos_pitch) = sin_cos(self.pitch_rad);
        let forward = cos_pitch * ahead - sin_pitch * down;
        let below = sin_pitch * ahead + cos_pitch * down;
        [forward, cos_roll * right + sin_roll * below, cos_roll * below - sin_roll * right]
    }

    /// The bearing, from north and clockwise, of a source that is heard on a body azimuth at an instant and lies that far
    /// below the horizon.
    ///
    /// A tilted array sees a level source off by up to half its tilt squared (10 degrees: 0.4), but a source below by up to
    /// the tilt times the tangent of its depression, which on the last metres is degrees. Solved by a few fixed-point
    /// steps, each of which gains a factor of about that product.
    #[must_use]
    pub fn bearing_ned_rad(&self, azimuth_rad: f32, depression_rad: f32, at: Instant) -> f32 {
        let mut off_rad = azimuth_rad;
        for _ in 0..4 {
            let [forward, right, _] = self.to_body(off_rad, depression_rad);
            off_rad += wrap_pi(azimuth_rad - libm::atan2f(right, forward));
        }
        wrap_pi(off_rad + self.yaw_at(at))
    }

    /// Whether it is finite and not absurd: an angle of 1e20 has no direction.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        let angles = [self.roll_rad, self.pitch_rad, self.yaw_rad, self.yaw_rate_radps];
        self.is_finite()
            && angles.iter().all(|angle| libm::fabsf(*angle) <= 100.0)
            && self.position_ned_m.horizontal().norm_squared() < 1e12
            && libm::fabsf(self.position_ned_m.down) < 1e6
            && self.velocity_ned_mps.horizontal().norm_squared() < 1e6
            && libm::fabsf(self.velocity_ned_mps.down) < 1e3
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
    fn what_is_finite_and_absurd_is_not_plausible() {
        let north = |metres: f32| Ned { north: metres, ..Ned::default() };
        assert!(Ownship { yaw_rad: 7.0, position_ned_m: north(1e4), ..Ownship::default() }.is_plausible());
        for ownship in [
            Ownship { yaw_rad: 8e15, ..Ownship::default() },
            Ownship { roll_rad: -1e3, ..Ownship::default() },
            Ownship { yaw_rate_radps: f32::MAX, ..Ownship::default() },
            Ownship { pitch_rad: f32::NAN, ..Ownship::default() },
            Ownship { position_ned_m: north(1e20), ..Ownship::default() },
            Ownship { velocity_ned_mps: north(1e6), ..Ownship::default() },
        ] {
            assert!(!ownship.is_plausible(), "{ownship:?}");
        }
    }

    #[test]
    fn a_vector_into_the_body_is_its_direction_into_the_body() {
        let ownship = Ownship { roll_rad: 0.2, pitch_rad: -0.15, yaw_rad: 2.4, ..Ownship::default() };
        for (bearing_rad, depression_rad) in [(0.3_f32, 0.2_f32), (-2.0, 1.3), (3.0, -0.7)] {
            let level = 7.0 * depression_rad.cos();
            let vector = Ned {
                north: level * bearing_rad.cos(),
                east: level * bearing_rad.sin(),
                down: 7.0 * depression_rad.sin(),
            };
            let direction = ownship.to_body(bearing_rad - ownship.yaw_rad, depression_rad);
            for (part, expected) in ownship.vector_to_body(vector).into_iter().zip(direction) {
                assert!((part - 7.0 * expected).abs() < 1e-5, "{part} {expected}");
            }
        }
        // Nose down by 0.1: what is below lies ahead of the body's own down axis, negative forward only where it is behind.
        let nose_down = Ownship { pitch_rad: -0.1, ..Ownship::default() };
        assert!(nose_down.vector_to_body(Ned { north: 0.0, east: 0.0, down: 1.0 })[0] > 0.09);
    }

    #[test]
    fn a_tilted_array_still_finds_the_bearing_of_a_source_that_is_level_or_below() {
        for (roll, pitch, yaw) in [(0.0_f64, 0.0_f64, 0.0_f64), (0.2, -0.2, 1.0), (-0.25, 0.1, -2.0), (0.0, 0.3, 3.0)] {
            for depression in [0.0_f64, 0.1, 0.6] {
                for degree in (-175..=180).step_by(5) {
                    let psi = f64::from(degree).to_radians();
                    // The direction in NED, then the transposed rotation (yaw, pitch, roll) element by element, in f64.
                    let d = [psi.cos() * depression.cos(), psi.sin() * depression.cos(), depression.sin()];
                    let (sr, cr, sp, cp, sy, cy) =
                        (roll.sin(), roll.cos(), pitch.sin(), pitch.cos(), yaw.sin(), yaw.cos());
                    let forward = cp * cy * d[0] + cp * sy * d[1] - sp * d[2];
                    let right = (sr * sp * cy - cr * sy) * d[0] + (sr * sp * sy + cr * cy) * d[1] + sr * cp * d[2];
                    let ownship = Ownship {
                        roll_rad: roll as f32,
                        pitch_rad: pitch as f32,
                        yaw_rad: yaw as f32,
                        ..Ownship::default()
                    };
                    let heard = right.atan2(forward) as f32;
                    let error = wrap_pi(ownship.bearing_ned_rad(heard, depression as f32, Instant(0)) - psi as f32);
                    assert!(error.abs() < 2e-3, "{roll} {pitch} {yaw} {depression} {degree}: {error}");
                }
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
