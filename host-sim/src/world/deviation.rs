//! How far the wind moves a vehicle from its undisturbed path, and the reaction of its autopilot.
//!
//! The response to setpoints is measured ([`super::vehicle`]) and unchanged; the deviation from it is added, with the
//! controllers of the real autopilots at their default gains:
//!
//! - *ArduCopter* in GUIDED under velocity setpoints holds a **position**: `ModeGuided::velaccel_control_run` gives
//!   the velocity to `AC_PosControl::input_vel_accel_NE_cm`, whose `update_pos_vel_accel_xy` integrates the shaped
//!   velocity into the wanted position, and `update_NE_controller` corrects `P_pos (wanted - estimated)`, then a PID
//!   on the velocity. (The bit `DoNotStabilizePositionXY` of `GUID_OPTIONS` would turn that off; it is clear by
//!   default.) `PSC_POSXY_P` 1.0; `PSC_VELXY_P`, `I`, `D` 2.0, 1.0, 0.5; error and derivative filtered at 5 Hz.
//! - *PX4* in OFFBOARD holds no position with a velocity setpoint only: a position setpoint of NaN has no effect
//!   (`PositionControl::_positionControl`), so only `_velocityControl` acts: `MPC_XY_VEL_P_ACC`, `I`, `D` 1.8, 0.4,
//!   0.2, with the derivative of the velocity.
//!
//! Between the controller's output and the thrust's lean there is a first-order lag of 0.2 s, an assumption
//! (`ATC_ANG_RLL_P` is 4.5, `ATC_INPUT_TC` 0.15). The lean has no limit here: gusts of 3 m/s sigma need half of what
//! 30 degrees give.

use super::geometry::Horizontal;
use crate::scenario::Software;

/// Lag of the lean behind the controller's output.
const LEAN_LAG_S: f64 = 0.2;

/// The controller's gains; all act on metres and seconds.
#[derive(Clone, Copy, Debug)]
struct Gains {
    position: f64,
    velocity: f64,
    integral: f64,
    derivative: f64,
    /// Time constant of the filters of error and derivative.
    filter_s: f64,
}

const fn gains(software: Software) -> Gains {
    // 5 Hz.
    let filter_s = 1.0 / (2.0 * std::f64::consts::PI * 5.0);
    match software {
        Software::ArduCopter => Gains { position: 1.0, velocity: 2.0, integral: 1.0, derivative: 0.5, filter_s },
        Software::Px4 => Gains { position: 0.0, velocity: 1.8, integral: 0.4, derivative: 0.2, filter_s },
    }
}

/// One axis, metres and seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Axis {
    position_m: f64,
    velocity_mps: f64,
    error_mps: f64,
    derivative_mps2: f64,
    integral_mps2: f64,
    lean_mps2: f64,
}

impl Axis {
    fn step(&mut self, gains: &Gains, push_mps2: f64, dt: f64) -> f64 {
        let wanted_mps = -gains.position * self.position_m;
        let before_mps = self.error_mps;
        let share = dt / (gains.filter_s + dt);
        self.error_mps += share * (wanted_mps - self.velocity_mps - self.error_mps);
        self.derivative_mps2 += share * ((self.error_mps - before_mps) / dt - self.derivative_mps2);
        self.integral_mps2 += gains.integral * self.error_mps * dt;
        let wanted_mps2 =
            gains.velocity * self.error_mps + self.integral_mps2 + gains.derivative * self.derivative_mps2;
        self.lean_mps2 += dt / (LEAN_LAG_S + dt) * (wanted_mps2 - self.lean_mps2);
        let acceleration_mps2 = push_mps2 + self.lean_mps2;
        self.position_m += dt * (self.velocity_mps + 0.5 * dt * acceleration_mps2);
        self.velocity_mps += dt * acceleration_mps2;
        acceleration_mps2
    }
}

/// The deviation, north and east.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    north: Axis,
    east: Axis,
}

impl Deviation {
    /// Simulates a step under a push that the controller has not countered yet; returns the acceleration of the
    /// deviation.
    pub fn step(&mut self, software: Software, push_mps2: Horizontal, dt: f64) -> Horizontal {
        let gains = gains(software);
        Horizontal {
            north: self.north.step(&gains, push_mps2.north, dt),
            east: self.east.step(&gains, push_mps2.east, dt),
        }
    }

    /// Its velocity, m/s.
    #[must_use]
    pub fn velocity_mps(&self) -> Horizontal {
        Horizontal { north: self.north.velocity_mps, east: self.east.velocity_mps }
    }

    /// The acceleration that the thrust's lean makes, m/s^2.
    #[must_use]
    pub fn lean_mps2(&self) -> Horizontal {
        Horizontal { north: self.north.lean_mps2, east: self.east.lean_mps2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.002;

    /// The deviation while it is pushed north with 1 m/s^2, every 2 ms.
    fn pushed(software: Software, duration_s: f64) -> Vec<f64> {
        let mut deviation = Deviation::default();
        let push_mps2 = Horizontal { north: 1.0, east: 0.0 };
        (0..(duration_s / DT_S) as usize)
            .map(|_| {
                deviation.step(software, push_mps2, DT_S);
                assert_eq!(deviation.east, Axis::default());
                deviation.north.position_m
            })
            .collect()
    }

    #[test]
    fn arducopter_comes_back_to_where_it_was_and_px4_stays_where_it_was_pushed_to() {
        // Final values: 0 with a position loop; without one, the path that the integrator needs to counter the push:
        // 1 / I.
        for (software, expected_m) in [(Software::ArduCopter, 0.0), (Software::Px4, 1.0 / 0.4)] {
            let last_m = pushed(software, 60.0).pop().unwrap();
            assert!((last_m - expected_m).abs() < 1e-3, "{software:?}: {last_m}");
        }
    }

    #[test]
    fn a_step_of_wind_moves_it_as_far_as_the_transfer_function_says() {
        // Without the lags, from push to position: s / ((1 + D) s^3 + (P + D K) s^2 + (P K + I) s + I K), K the
        // position's gain: the response to a step is that of 1 / (1.5 s^3 + 2.5 s^2 + 3 s + 1), here integrated
        // separately.
        let (mut x, mut v, mut a, mut most) = (0.0, 0.0, 0.0, 0.0_f64);
        for _ in 0..10_000 {
            let jerk = (-2.5 * a - 3.0 * v - x) / 1.5;
            (x, v, a) = (x + DT_S * v, v + DT_S * a, a + DT_S * jerk);
            // From rest, a step in the push is a step of 1 / 1.5 in a.
            if most == 0.0 {
                (a, most) = (1.0 / 1.5, 1e-9);
            }
            most = most.max(x);
        }
        let flown = pushed(Software::ArduCopter, 20.0).into_iter().fold(0.0, f64::max);
        // The lags of filters and lean, together a quarter of a second, increase it.
        assert!(flown > most && flown < 1.4 * most, "{flown} m, without lags {most} m");
        assert!((0.3..0.4).contains(&most), "{most}");
    }

    #[test]
    fn without_wind_there_is_none() {
        let mut deviation = Deviation::default();
        for _ in 0..1000 {
            assert_eq!(deviation.step(Software::ArduCopter, Horizontal::default(), DT_S), Horizontal::default());
        }
        assert_eq!(deviation, Deviation::default());
    }
}
