//! How ArduCopter shapes velocity setpoints in GUIDED, before its controller follows them ([`super::deviation`]).
//!
//! `shape_vel_accel_xy` of `AP_Math/control.cpp`, as `AC_PosControl::input_vel_accel_NE_m` calls it: the acceleration is
//! proportional to the velocity's error where that is small, its root where it is large, and limited in size and
//! in its rate. `WPNAV_ACCEL` 2.5 m/s^2 and `PSC_JERK_NE` 5 m/s^3, the defaults.

use super::deviation::Wanted;
use super::geometry::Horizontal;

const ACCELERATION_MPS2: f64 = 2.5;
const JERK_MPS3: f64 = 5.0;
const GAIN_PER_S: f64 = JERK_MPS3 / ACCELERATION_MPS2;
/// The share of the acceleration that is left across the wanted velocity, where both want more than there is.
const ACROSS: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The shaped velocity and acceleration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Shaping {
    shaped: Wanted,
}

impl Shaping {
    /// Shapes towards a velocity for `dt`.
    pub(super) fn step(&mut self, velocity_mps: Horizontal, dt: f64) -> Wanted {
        let Wanted { velocity_mps: now_mps, acceleration_mps2: now_mps2 } = self.shaped;
        let now_mps = now_mps.along(now_mps2, dt);
        let wanted_mps2 = limited(velocity_mps, towards(velocity_mps.minus(now_mps), dt));
        let change = shortened(wanted_mps2.minus(now_mps2), JERK_MPS3 * dt);
        self.shaped = Wanted { velocity_mps: now_mps, acceleration_mps2: now_mps2.along(change, 1.0) };
        self.shaped
    }
}

/// `sqrt_controller`.
fn towards(error_mps: Horizontal, dt: f64) -> Horizontal {
    let size_mps = error_mps.norm();
    if size_mps == 0.0 {
        return Horizontal::default();
    }
    let linear_mps = JERK_MPS3 / (GAIN_PER_S * GAIN_PER_S);
    let wanted_mps2 = if size_mps > linear_mps {
        libm::sqrt(2.0 * JERK_MPS3 * (size_mps - 0.5 * linear_mps))
    } else {
        GAIN_PER_S * size_mps
    };
    Horizontal::default().along(error_mps, wanted_mps2.min(size_mps / dt) / size_mps)
}

/// Of an acceleration that is too large, what is across the wanted velocity is kept first.
fn limited(velocity_mps: Horizontal, wanted_mps2: Horizontal) -> Horizontal {
    let speed_mps = velocity_mps.norm();
    if speed_mps == 0.0 {
        return shortened(wanted_mps2, ACCELERATION_MPS2);
    }
    let ahead = Horizontal::default().along(velocity_mps, 1.0 / speed_mps);
    let along_mps2 = ahead.dot(wanted_mps2);
    let across_mps2 = wanted_mps2.along(ahead, -along_mps2);
    if along_mps2 * along_mps2 <= across_mps2.dot(across_mps2) {
        return shortened(wanted_mps2, ACCELERATION_MPS2);
    }
    let across_mps2 = shortened(across_mps2, ACROSS * ACCELERATION_MPS2);
    let rest_mps2 = libm::sqrt(ACCELERATION_MPS2 * ACCELERATION_MPS2 - across_mps2.dot(across_mps2));
    across_mps2.along(ahead, along_mps2.clamp(-rest_mps2, rest_mps2))
}

fn shortened(vector: Horizontal, length: f64) -> Horizontal {
    let norm = vector.norm();
    if norm > length { Horizontal::default().along(vector, length / norm) } else { vector }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.002;

    #[test]
    fn a_large_step_takes_the_time_that_its_limits_allow_and_keeps_both() {
        let mut shaping = Shaping::default();
        let wanted_mps = Horizontal { north: 3.0, east: -4.0 };
        let (mut before, mut half_s) = (Horizontal::default(), None);
        for step in 0..5000 {
            let shaped = shaping.step(wanted_mps, DT_S);
            let mps2 = shaped.acceleration_mps2;
            assert!(mps2.norm() <= ACCELERATION_MPS2 + 1e-9, "{mps2:?}");
            assert!(mps2.minus(before).norm() <= JERK_MPS3 * DT_S + 1e-9);
            before = mps2;
            if half_s.is_none() && shaped.velocity_mps.norm() >= 2.5 {
                half_s = Some(f64::from(step) * DT_S);
            }
        }
        // Half a second to the full acceleration, in which 0.625 m/s are reached; the rest at 2.5 m/s^2.
        let expected_s = 0.5 + (2.5 - 0.625) / 2.5;
        assert!((half_s.unwrap() - expected_s).abs() < 0.01, "{half_s:?}");
        assert!(shaping.shaped.velocity_mps.minus(wanted_mps).norm() < 1e-6);
    }
}
