//! The state of our own vehicle, as the autopilot reports it.

use crate::base::math::sqrt;
use crate::base::ned::{Horizontal, Ned};
use crate::base::time::Instant;
use crate::base::units::{sin_cos, wrap_pi};

/// The difference between positions and velocities is forgotten with this time constant.
const FORGOTTEN_S: f32 = 1.0;
/// They contradict each other when they differ by more than this distance, plus this time at the reported speed. The
/// first allows for an estimator's corrections within a second, the second for the delay of its messages.
const APART_M: f32 = 0.27;
const APART_S: f32 = 0.05;
/// A position that is bit for bit the same is frozen when the velocity has led this far in the meantime. The second
/// value is for autopilots that report a position several times.
const FROZEN_M: f32 = 0.15;
const FROZEN_S: f32 = 0.1;
/// A yaw is extrapolated by the yaw rate so far back, and so far ahead, where the vehicle may have begun another turn.
pub const YAW_BACK_MAX_S: f32 = 0.3;
/// See [`YAW_BACK_MAX_S`].
pub const YAW_FORTH_MAX_S: f32 = 0.15;
/// Over a longer gap the velocity in between is unknown.
const GAP_MAX_S: f32 = 0.3;

/// Why ownship is unusable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Stale {
    /// The position is too old, was never received, or is not finite.
    PositionOld,
    /// The same of the attitude.
    AttitudeOld,
    /// The positions contradict the velocity.
    VelocityContradicts,
    /// The position stands still while the velocity says that the vehicle moves.
    PositionFrozen,
}

impl Stale {
    /// Its name in logs and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PositionOld => "position_old",
            Self::AttitudeOld => "attitude_old",
            Self::VelocityContradicts => "velocity_contradicts",
            Self::PositionFrozen => "position_frozen",
        }
    }
}

/// Whether the positions of an autopilot agree with its velocities, in the plane. A correction of its estimator in
/// one step is no contradiction: the link removes it from both.
///
/// With `d` the displacement from position to position minus that by the velocities, the difference is `s`, the sum
/// of all `d`, forgotten with a time constant of 1 s. A velocity with an error of `u` leads to `s = u (1 s) (1 -
/// exp(-t / 1 s))`: the limit at 1 m/s, 0.32 m, is passed after 0.4 s by an error of 1 m/s, and never by one below
/// 0.32 m/s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    apart_m: Horizontal,
    /// How far the velocity has led since the position last changed, forgotten likewise.
    frozen_m: f32,
    found: Option<Stale>,
}

impl Agreement {
    /// Continues from the last ownship to the present one, which may be the same. A contradiction is kept until
    /// [`Self::release`].
    pub fn follow(&mut self, last: Option<&Ownship>, heard: &Ownship) {
        let speed_mps = heard.velocity_ned_mps.horizontal().norm();
        if let Some(last) = last.filter(|last| last.position_time != heard.position_time) {
            self.add(last, heard);
        }
        let is_frozen = self.frozen_m > FROZEN_M + FROZEN_S * speed_mps;
        if is_frozen || self.apart_m.norm() > APART_M + APART_S * speed_mps {
            let stands = self.frozen_m > FROZEN_M;
            self.found.get_or_insert(if stands { Stale::PositionFrozen } else { Stale::VelocityContradicts });
        }
    }

    fn add(&mut self, last: &Ownship, heard: &Ownship) {
        let dt_s = heard.position_time.seconds_since(last.position_time);
        if dt_s <= 0.0 || dt_s > GAP_MAX_S {
            // The clock was set, or the silence was too long.
            *self = Self { found: self.found, ..Self::default() };
            return;
        }
        let (from_m, to_m) = (last.position_ned_m.horizontal(), heard.position_ned_m.horizontal());
        let led_m = last.velocity_ned_mps.horizontal().plus(heard.velocity_ned_mps.horizontal()).times(0.5 * dt_s);
        let off_m = to_m.minus(from_m).minus(led_m);
        let stays = 1.0 - dt_s / FORGOTTEN_S;
        self.apart_m = self.apart_m.times(stays).plus(off_m);
        self.frozen_m = if to_m == from_m { stays * self.frozen_m + led_m.norm() } else { 0.0 };
    }

    /// How far the positions are by now from where the velocities led in the last second.
    #[must_use]
    pub fn apart_m(&self) -> f32 {
        self.apart_m.norm()
    }

    /// The contradiction found since the last release, if any.
    #[must_use]
    pub const fn found(&self) -> Option<Stale> {
        self.found
    }

    /// The pilot has control: an earlier contradiction is dropped, and one that persists is found again.
    pub const fn release(&mut self) {
        self.found = None;
    }
}

/// Position, velocity and attitude of the vehicle, as last received.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Ownship {
    /// When position and velocity were received.
    pub position_time: Instant,
    /// Position in the autopilot's local NED frame, metres.
    pub position_ned_m: Ned,
    /// Velocity in the local NED frame, metres a second.
    pub velocity_ned_mps: Ned,
    /// When the attitude was received.
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
    /// Yaw at an instant near the last attitude, extrapolated by the yaw rate from [`YAW_BACK_MAX_S`] before it to
    /// [`YAW_FORTH_MAX_S`] after it.
    #[must_use]
    pub fn yaw_at(&self, at: Instant) -> f32 {
        let ahead_s = at.seconds_since(self.attitude_time) - self.attitude_time.seconds_since(at);
        wrap_pi(self.yaw_rad + self.yaw_rate_radps * ahead_s.clamp(-YAW_BACK_MAX_S, YAW_FORTH_MAX_S))
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

    /// Sine of the tilt, in any direction.
    #[must_use]
    pub fn tilt_sine(&self) -> f32 {
        let [forward, right, _] = self.vector_to_body(Ned { north: 0.0, east: 0.0, down: 1.0 });
        sqrt(forward * forward + right * right)
    }

    /// From the level axes ahead, right and down to the body's own axes: the inverse rotations by pitch and roll.
    fn leant(&self, ahead: f32, right: f32, down: f32) -> [f32; 3] {
        let (sin_roll, cos_roll) = sin_cos(self.roll_rad);
        let (sin_pitch, cos_pitch) = sin_cos(self.pitch_rad);
        let forward = cos_pitch * ahead - sin_pitch * down;
        let below = sin_pitch * ahead + cos_pitch * down;
        [forward, cos_roll * right + sin_roll * below, cos_roll * below - sin_roll * right]
    }

    /// The bearing, from north and clockwise, of a source with this body azimuth at an instant and this depression
    /// below the horizon.
    ///
    /// With a tilted array the azimuth of a level source is wrong by up to half its tilt squared (10 degrees: 0.4),
    /// but that of a source below by up to the tilt times the tangent of its depression, which is degrees in the last
    /// metres. Solved by a few fixed-point steps, each of which gains a factor of about that product.
    #[must_use]
    pub fn bearing_ned_rad(&self, azimuth_rad: f32, depression_rad: f32, at: Instant) -> f32 {
        let mut off_rad = azimuth_rad;
        for _ in 0..4 {
            let [forward, right, _] = self.to_body(off_rad, depression_rad);
            off_rad += wrap_pi(azimuth_rad - libm::atan2f(right, forward));
        }
        wrap_pi(off_rad + self.yaw_at(at))
    }

    /// Whether its numbers are finite and not absurd: an angle of 1e20 has no direction.
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

    /// The contradiction, and when it is found, for an autopilot that reports a vehicle's true state for 2 s, and
    /// something else from then on. The vehicle flies a turn of 0.5 rad/s at a speed.
    fn found(hz: u64, speed_mps: f32, tell: impl Fn(&mut Ownship, &Ownship)) -> Option<(Stale, f32)> {
        let mut agreement = Agreement::default();
        let (mut last, mut before) = (None, Ownship::default());
        for tick in 0..30 * hz {
            let at_us = tick * 1_000_000 / hz;
            let (sin, cos) = sin_cos(at_us as f32 * 0.5e-6);
            let mut heard = Ownship {
                position_time: Instant(at_us),
                position_ned_m: Ned { north: speed_mps * sin / 0.5, east: speed_mps * (1.0 - cos) / 0.5, down: -5.0 },
                velocity_ned_mps: Ned { north: speed_mps * cos, east: speed_mps * sin, down: 0.0 },
                ..Ownship::default()
            };
            if at_us <= 2_000_000 {
                before = heard;
            } else {
                tell(&mut heard, &before);
            }
            agreement.follow(last.as_ref(), &heard);
            if let Some(found) = agreement.found() {
                assert!(at_us > 2_000_000, "{found:?} at {at_us}");
                return Some((found, at_us as f32 * 1e-6 - 2.0));
            }
            last = Some(heard);
        }
        None
    }

    #[test]
    fn what_contradicts_is_found_within_half_a_second_and_by_its_name() {
        for hz in [10, 20, 30, 50] {
            for speed_mps in [1.0, 1.5, 2.5] {
                let (name, after_s) = found(hz, speed_mps, |heard, before| {
                    heard.position_ned_m = before.position_ned_m;
                    heard.velocity_ned_mps = before.velocity_ned_mps;
                })
                .unwrap();
                assert!(name == Stale::PositionFrozen && after_s < 0.45, "{hz} {speed_mps}: {name:?} {after_s}");
                type Tell = fn(&mut Ned);
                let tells: [Tell; 4] = [
                    |v| (v.north, v.east) = (-v.north, -v.east),
                    |v| (v.north, v.east) = (-v.east, v.north),
                    |v| (v.north, v.east) = (0.0, 0.0),
                    |v| (v.north, v.east) = (2.0 * v.north, 2.0 * v.east),
                ];
                for (at, tell) in tells.iter().enumerate() {
                    let (name, after_s) = found(hz, speed_mps, |heard, _| tell(&mut heard.velocity_ned_mps)).unwrap();
                    let is_in_time = name == Stale::VelocityContradicts && after_s <= 0.5;
                    assert!(is_in_time, "{hz} {speed_mps}, {at}: {name:?} {after_s}");
                }
            }
        }
    }

    #[test]
    fn what_a_sane_estimator_does_is_no_contradiction() {
        for hz in [4, 10, 50] {
            for speed_mps in [0.0, 0.3, 1.0, 2.5] {
                assert_eq!(found(hz, speed_mps, |_, _| {}), None);
                // A correction of 15 cm, a velocity with an error of 15 cm/s, a position that is late by 40 ms.
                assert_eq!(found(hz, speed_mps, |heard, _| heard.position_ned_m.north += 0.15), None);
                assert_eq!(found(hz, speed_mps, |heard, _| heard.velocity_ned_mps.east += 0.15), None);
                let late = |heard: &mut Ownship, _: &Ownship| {
                    let (position_m, mps) = (&mut heard.position_ned_m, heard.velocity_ned_mps);
                    (position_m.north, position_m.east) =
                        (position_m.north - 0.04 * mps.north, position_m.east - 0.04 * mps.east);
                };
                assert_eq!(found(hz, speed_mps, late), None);
            }
        }
    }

    #[test]
    fn positions_that_are_told_five_times_each_stand_for_a_vehicle_that_moves() {
        let mut agreement = Agreement::default();
        let mut last = None;
        for tick in 0..500_u64 {
            let heard = Ownship {
                position_time: Instant(tick * 20_000),
                position_ned_m: Ned { north: (tick / 5) as f32 * 0.2, ..Ned::default() },
                velocity_ned_mps: Ned { north: 2.0, ..Ned::default() },
                ..Ownship::default()
            };
            agreement.follow(last.as_ref(), &heard);
            last = Some(heard);
        }
        assert_eq!(agreement.found(), None);
    }

    #[test]
    fn what_was_found_stays_until_it_is_released_and_is_found_again_while_it_lasts() {
        let mut agreement = Agreement::default();
        let told = |tick: u64, north: f32| Ownship {
            position_time: Instant(tick * 20_000),
            velocity_ned_mps: Ned { north, ..Ned::default() },
            ..Ownship::default()
        };
        for tick in 1..50 {
            agreement.follow(Some(&told(tick - 1, 1.0)), &told(tick, 1.0));
        }
        assert_eq!(agreement.found(), Some(Stale::PositionFrozen));
        agreement.release();
        agreement.follow(Some(&told(49, 1.0)), &told(50, 1.0));
        assert_eq!(agreement.found(), Some(Stale::PositionFrozen));
        for tick in 51..500 {
            agreement.follow(Some(&told(tick - 1, 0.0)), &told(tick, 0.0));
        }
        assert!(agreement.found().is_some());
        // A gap, over which the motion is unknown.
        agreement.follow(Some(&told(499, 0.0)), &told(600, 0.0));
        agreement.release();
        agreement.follow(Some(&told(600, 0.0)), &told(601, 0.0));
        assert_eq!(agreement.found(), None);
    }

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
        // Nose down by 0.1: a source below lies ahead of the body's own down axis; its forward component is negative
        // only behind.
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
        assert!((ownship.yaw_at(Instant(9_000_000)) - 1.3).abs() < 1e-5);
    }
}
