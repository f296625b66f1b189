//! The autopilot's horizontal velocity controller: how the vehicle follows what is wanted of it, and how far the wind
//! moves it.
//!
//! The controllers are those of the real autopilots at their default gains:
//!
//! - *ArduCopter* in GUIDED under velocity setpoints holds a **position**: `ModeGuided::velaccel_control_run` gives
//!   the velocity to `AC_PosControl::input_vel_accel_NE_cm`, whose `update_pos_vel_accel_xy` integrates the shaped
//!   velocity (`shaping`) into the wanted position, and `update_NE_controller` corrects
//!   `P_pos (wanted - estimated)`, then a PID on the velocity; the shaped acceleration is added. (The bit
//!   `DoNotStabilizePositionXY` of `GUID_OPTIONS` would turn the position off; it is clear by default.)
//!   `PSC_POSXY_P` 1.0; `PSC_VELXY_P`, `I`, `D` 2.0, 1.0, 0.5; error and derivative filtered at 5 Hz.
//! - *PX4* in OFFBOARD holds no position with a velocity setpoint only: a position setpoint of NaN has no effect
//!   (`PositionControl::_positionControl`), so only `_velocityControl` acts, on the setpoint as it is:
//!   `MPC_XY_VEL_P_ACC`, `I`, `D` 1.8, 0.4, 0.2, with the derivative of the velocity.
//!
//! Between the controller's output and the thrust's lean there is a first-order lag, which is fitted to recordings
//! ([`super::vehicle`]): 0.2 s for ArduCopter (`ATC_ANG_RLL_P` is 4.5, `ATC_INPUT_TC` 0.15), 0.25 s for PX4
//! (`MC_ROLL_P` is 4). The lean has no limit here: gusts of 3 m/s sigma need half of what
//! 30 degrees give.
//!
//! Where nothing is wanted this is the deviation from the undisturbed path.

use super::geometry::Horizontal;
use crate::scenario::Software;

/// The controller's gains; all act on metres and seconds.
#[derive(Clone, Copy, Debug)]
struct Gains {
    position: f64,
    velocity: f64,
    integral: f64,
    derivative: f64,
    /// Whether the derivative is the error's, or the velocity's alone.
    is_of_error: bool,
    /// Time constant of the filters of error and derivative.
    filter_s: f64,
    /// Lag of the lean behind the controller's output.
    lean_lag_s: f64,
}

const fn gains(software: Software) -> Gains {
    // 5 Hz.
    let filter_s = 1.0 / (2.0 * std::f64::consts::PI * 5.0);
    match software {
        Software::ArduCopter => {
            let is_of_error = true;
            Gains {
                position: 1.0,
                velocity: 2.0,
                integral: 1.0,
                derivative: 0.5,
                is_of_error,
                filter_s,
                lean_lag_s: 0.2,
            }
        }
        Software::Px4 => {
            let is_of_error = false;
            Gains {
                position: 0.0,
                velocity: 1.8,
                integral: 0.4,
                derivative: 0.2,
                is_of_error,
                filter_s,
                lean_lag_s: 0.25,
            }
        }
    }
}

/// What is wanted of the vehicle now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wanted {
    /// Velocity, m/s.
    pub velocity_mps: Horizontal,
    /// Acceleration that the controller adds to its own, m/s^2.
    pub acceleration_mps2: Horizontal,
}

/// One axis, metres and seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Axis {
    /// Position, ahead of the wanted one.
    ahead_m: f64,
    velocity_mps: f64,
    /// Both filtered: the wanted velocity, and the rest of the error.
    wanted_mps: f64,
    error_mps: f64,
    derivative_mps2: f64,
    integral_mps2: f64,
    lean_mps2: f64,
}

impl Axis {
    fn step(&mut self, gains: &Gains, wanted_mps: f64, wanted_mps2: f64, push_mps2: f64, dt: f64) -> f64 {
        let correction_mps = -gains.position * self.ahead_m;
        let part = if gains.is_of_error { 1.0 } else { 0.0 };
        let before_mps = part * self.wanted_mps + self.error_mps;
        let share = dt / (gains.filter_s + dt);
        self.wanted_mps += share * (wanted_mps - self.wanted_mps);
        self.error_mps += share * (correction_mps - self.velocity_mps - self.error_mps);
        let after_mps = part * self.wanted_mps + self.error_mps;
        self.derivative_mps2 += share * ((after_mps - before_mps) / dt - self.derivative_mps2);
        let error_mps = self.wanted_mps + self.error_mps;
        self.integral_mps2 += gains.integral * error_mps * dt;
        let asked_mps2 =
            wanted_mps2 + gains.velocity * error_mps + self.integral_mps2 + gains.derivative * self.derivative_mps2;
        self.lean_mps2 += dt / (gains.lean_lag_s + dt) * (asked_mps2 - self.lean_mps2);
        let acceleration_mps2 = push_mps2 + self.lean_mps2;
        self.ahead_m += dt * (self.velocity_mps - wanted_mps + 0.5 * dt * acceleration_mps2);
        self.velocity_mps += dt * acceleration_mps2;
        acceleration_mps2
    }
}

/// The controlled motion, north and east.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    north: Axis,
    east: Axis,
}

impl Deviation {
    /// Simulates a step under a push that the controller has not countered yet; returns the acceleration.
    pub fn step(&mut self, software: Software, wanted: Wanted, push_mps2: Horizontal, dt: f64) -> Horizontal {
        let (gains, Wanted { velocity_mps, acceleration_mps2 }) = (gains(software), wanted);
        let (north, east) = (&mut self.north, &mut self.east);
        Horizontal {
            north: north.step(&gains, velocity_mps.north, acceleration_mps2.north, push_mps2.north, dt),
            east: east.step(&gains, velocity_mps.east, acceleration_mps2.east, push_mps2.east, dt),
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
                deviation.step(software, Wanted::default(), push_mps2, DT_S);
                assert_eq!(deviation.east, Axis::default());
                deviation.north.ahead_m
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
            let step = deviation.step(Software::ArduCopter, Wanted::default(), Horizontal::default(), DT_S);
            assert_eq!(step, Horizontal::default());
        }
        assert_eq!(deviation, Deviation::default());
    }
}
