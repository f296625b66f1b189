//! The waypoint tracker: a PID on the error to a point ahead on the planned trajectory (main paper, section IV: "the next
//! waypoint ... is fed into PID controllers ... to get global velocities").
//!
//! It steers the rest point, which follows at once, so the proportional part does most; the derivative part acts on
//! the rest point's motion, and the integral part removes a steady drift. The nose follows the direction of travel.

use crate::base::ned::Horizontal;
use crate::base::units::wrap_pi;
use crate::planning::rollout::{SPACING_M, Trajectory, WAYPOINTS};

/// Velocity per metre of error.
const KP_PER_S: f32 = 3.0;
/// Velocity per metre and second of error.
const KI_PER_S2: f32 = 0.2;
/// Share of the last command that is subtracted.
const KD: f32 = 0.1;
/// Bound of the integral part.
const INTEGRAL_MAX_MPS: f32 = 0.2;
/// How far ahead of the rest point the aim on the trajectory is.
const LOOKAHEAD_M: f32 = 0.4;
/// Yaw rate per radian between where the nose comes to rest and the direction of travel.
const YAW_GAIN_PER_S: f32 = 2.5;
/// For how long the nose turns on at its rate: less than the 0.3 to 0.4 s after which ArduCopter and PX4 follow a yaw rate, enough
/// that neither swings past the direction (`tests/flight/step_response.rs`).
const YAW_REST_S: f32 = 0.2;
/// Vertical velocity per metre of altitude error.
const ALTITUDE_GAIN_PER_S: f32 = 0.8;

/// Largest speed on a straight plan without a guard: the command at which all parts balance.
pub const FASTEST_MPS: f32 = (KP_PER_S * LOOKAHEAD_M + INTEGRAL_MAX_MPS) / (1.0 + KD);

/// Progress along a trajectory, and the integral.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Waypoints passed; `WAYPOINTS` when the trajectory is used up.
    pub passed: usize,
    integral_mps: Horizontal,
    last_mps: Horizontal,
}

impl State {
    /// Starts on a new trajectory; the integral is kept, since the drift is still there.
    pub fn restart(&mut self) {
        self.passed = 0;
    }

    /// One step along a trajectory.
    pub fn step(&mut self, trajectory: &Trajectory, rest: Horizontal, rest_yaw_rad: f32, dt_s: f32) -> Demand {
        self.passed = progress(self.passed, trajectory, rest);
        let ahead = libm::roundf(LOOKAHEAD_M / SPACING_M) as usize;
        let aim = trajectory[(self.passed + ahead).min(WAYPOINTS).saturating_sub(1)];
        let error = aim.minus(rest);

        self.integral_mps = self.integral_mps.plus(error.times(KI_PER_S2 * dt_s)).clamped(INTEGRAL_MAX_MPS);
        let velocity_ned_mps = error.times(KP_PER_S).plus(self.integral_mps).minus(self.last_mps.times(KD));
        self.last_mps = velocity_ned_mps;

        // Too close to give a direction: keep the nose where it is.
        let yaw_rate_radps =
            if error.norm() > 0.5 * SPACING_M { turn_to(error.bearing_rad(), rest_yaw_rad) } else { 0.0 };
        Demand { velocity_ned_mps, down_mps: 0.0, yaw_rate_radps }
    }
}

/// What the tracker demands; the guard decides.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Demand {
    /// Horizontal velocity, local NED.
    pub velocity_ned_mps: Horizontal,
    /// Vertical velocity, down positive.
    pub down_mps: f32,
    /// Yaw rate, clockwise positive.
    pub yaw_rate_radps: f32,
}

/// Where the nose would come to rest if it were told to turn no further.
#[must_use]
pub fn rest_yaw_rad(yaw_rad: f32, yaw_rate_radps: f32) -> f32 {
    yaw_rad + YAW_REST_S * yaw_rate_radps
}

/// The yaw rate that turns the nose to a bearing, from where it would come to rest.
#[must_use]
#[inline(never)]
pub fn turn_to(bearing_ned_rad: f32, rest_yaw_rad: f32) -> f32 {
    YAW_GAIN_PER_S * wrap_pi(bearing_ned_rad - rest_yaw_rad)
}

/// The vertical velocity that holds an altitude.
#[must_use]
pub fn hold_altitude(wanted_down_m: f32, down_m: f32) -> f32 {
    ALTITUDE_GAIN_PER_S * (wanted_down_m - down_m)
}

/// Waypoints passed: a waypoint is passed when the rest point is nearer to the next, or has reached it.
fn progress(passed: usize, trajectory: &Trajectory, rest: Horizontal) -> usize {
    let mut passed = passed.min(WAYPOINTS);
    while passed < WAYPOINTS {
        let here = trajectory[passed].minus(rest).norm_squared();
        let near = 0.25 * SPACING_M * SPACING_M;
        let next_is_nearer = passed + 1 < WAYPOINTS && trajectory[passed + 1].minus(rest).norm_squared() < here;
        if here > near && !next_is_nearer {
            break;
        }
        passed += 1;
    }
    passed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_plan_is_flown_no_faster_than_the_fastest() {
        let mut state = State::default();
        let mut fastest_mps: f32 = 0.0;
        // A rest point that is pulled along for ever, one look-ahead behind.
        let aim = core::array::from_fn(|_| Horizontal { north: LOOKAHEAD_M, east: 0.0 });
        for _ in 0..1000 {
            fastest_mps = state.step(&aim, Horizontal::default(), 0.0, 0.02).velocity_ned_mps.norm();
        }
        assert!((fastest_mps - FASTEST_MPS).abs() < 0.01, "{fastest_mps} {FASTEST_MPS}");
    }

    fn straight() -> Trajectory {
        core::array::from_fn(|k| Horizontal { north: 0.0, east: SPACING_M * (k as f32 + 1.0) })
    }

    #[test]
    fn it_follows_a_straight_line_to_its_end_and_counts_the_waypoints() {
        let mut state = State::default();
        let (mut rest, mut yaw) = (Horizontal { north: 0.1, east: 0.0 }, 0.0);
        let mut last = 0;
        for _ in 0..600 {
            let demand = state.step(&straight(), rest, yaw, 0.02);
            rest = rest.plus(demand.velocity_ned_mps.clamped(1.0).times(0.02));
            yaw += demand.yaw_rate_radps.clamp(-1.5, 1.5) * 0.02;
            assert!(state.passed >= last);
            last = state.passed;
        }
        assert_eq!(last, WAYPOINTS);
        assert!(rest.minus(Horizontal { north: 0.0, east: 2.0 }).norm() < 0.05, "{rest:?}");
        assert!((yaw - core::f32::consts::FRAC_PI_2).abs() < 0.2, "the nose points east: {yaw}");
    }

    #[test]
    fn a_brake_trajectory_asks_to_stay() {
        let mut state = State::default();
        let here = Horizontal { north: 3.0, east: 1.0 };
        let demand = state.step(&[here; WAYPOINTS], here, 0.4, 0.02);
        assert!(demand.velocity_ned_mps.norm() < 1e-6 && demand.yaw_rate_radps == 0.0);
    }
}
