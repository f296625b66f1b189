//! The waypoint tracker: a PID on the error to a point ahead on the planned trajectory (main paper, section IV: "the next
//! waypoint ... is fed into PID controllers ... to get global velocities").
//!
//! It steers the rest point, which follows at once, so the proportional part does most; the derivative part acts on
//! the rest point's motion, and the integral part removes a steady drift. The nose follows the direction of travel.

use crate::base::error::{ConfigError, check};
use crate::base::ned::Horizontal;
use crate::base::units::wrap_pi;
use crate::planning::rollout::{SPACING_M, Trajectory, WAYPOINTS};

/// Configuration of the tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Velocity per metre of error.
    pub kp_per_s: f32,
    /// Velocity per metre and second of error.
    pub ki_per_s2: f32,
    /// Share of the last command that is subtracted.
    pub kd: f32,
    /// Bound of the integral part.
    pub integral_max_mps: f32,
    /// How far ahead of the rest point the aim on the trajectory is.
    pub lookahead_m: f32,
    /// Yaw rate per radian between the nose and the direction of travel.
    pub yaw_gain_per_s: f32,
    /// Vertical velocity per metre of altitude error.
    pub altitude_gain_per_s: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            kp_per_s: 3.0,
            ki_per_s2: 0.2,
            kd: 0.1,
            integral_max_mps: 0.2,
            lookahead_m: 0.4,
            yaw_gain_per_s: 2.5,
            altitude_gain_per_s: 0.8,
        }
    }
}

impl Config {
    /// Largest speed on a straight plan without a guard: the command at which all parts balance.
    #[must_use]
    pub fn fastest_mps(&self) -> f32 {
        (self.kp_per_s * self.lookahead_m + self.integral_max_mps) / (1.0 + self.kd)
    }

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Tracker, ConfigError> {
        check("track.kp_per_s", self.kp_per_s, 0.1, 20.0)?;
        check("track.ki_per_s2", self.ki_per_s2, 0.0, 10.0)?;
        check("track.kd", self.kd, 0.0, 0.9)?;
        check("track.integral_max_mps", self.integral_max_mps, 0.0, 2.0)?;
        check("track.lookahead_m", self.lookahead_m, SPACING_M, 2.0)?;
        check("track.yaw_gain_per_s", self.yaw_gain_per_s, 0.0, 10.0)?;
        check("track.altitude_gain_per_s", self.altitude_gain_per_s, 0.0, 5.0)?;
        Ok(Tracker { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracker {
    config: Config,
}

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

impl Tracker {
    /// One step along a trajectory.
    pub fn step(
        &self,
        state: &mut State,
        trajectory: &Trajectory,
        rest: Horizontal,
        yaw_rad: f32,
        dt_s: f32,
    ) -> Demand {
        let c = &self.config;
        state.passed = progress(state.passed, trajectory, rest);
        let ahead = libm::roundf(c.lookahead_m / SPACING_M) as usize;
        let aim = trajectory[(state.passed + ahead).min(WAYPOINTS).saturating_sub(1)];
        let error = aim.minus(rest);

        state.integral_mps = state.integral_mps.plus(error.times(c.ki_per_s2 * dt_s)).clamped(c.integral_max_mps);
        let velocity_ned_mps = error.times(c.kp_per_s).plus(state.integral_mps).minus(state.last_mps.times(c.kd));
        state.last_mps = velocity_ned_mps;

        // Too close to give a direction: keep the nose where it is.
        let yaw_rate_radps =
            if error.norm() > 0.5 * SPACING_M { self.turn_to(error.bearing_rad(), yaw_rad) } else { 0.0 };
        Demand { velocity_ned_mps, down_mps: 0.0, yaw_rate_radps }
    }

    /// The yaw rate that turns the nose to a bearing.
    #[must_use]
    pub fn turn_to(&self, bearing_ned_rad: f32, yaw_rad: f32) -> f32 {
        self.config.yaw_gain_per_s * wrap_pi(bearing_ned_rad - yaw_rad)
    }

    /// The vertical velocity that holds an altitude.
    #[must_use]
    pub fn hold_altitude(&self, wanted_down_m: f32, down_m: f32) -> f32 {
        self.config.altitude_gain_per_s * (wanted_down_m - down_m)
    }
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
        let config = Config::default();
        let (tracker, mut state) = (config.build().unwrap(), State::default());
        let mut fastest_mps: f32 = 0.0;
        // A rest point that is pulled along for ever, one look-ahead behind.
        let aim = core::array::from_fn(|_| Horizontal { north: config.lookahead_m, east: 0.0 });
        for _ in 0..1000 {
            fastest_mps = tracker.step(&mut state, &aim, Horizontal::default(), 0.0, 0.02).velocity_ned_mps.norm();
        }
        assert!((fastest_mps - config.fastest_mps()).abs() < 0.01, "{fastest_mps} {}", config.fastest_mps());
    }

    fn straight() -> Trajectory {
        core::array::from_fn(|k| Horizontal { north: 0.0, east: SPACING_M * (k as f32 + 1.0) })
    }

    #[test]
    fn it_follows_a_straight_line_to_its_end_and_counts_the_waypoints() {
        let (tracker, mut state) = (Config::default().build().unwrap(), State::default());
        let (mut rest, mut yaw) = (Horizontal { north: 0.1, east: 0.0 }, 0.0);
        let mut last = 0;
        for _ in 0..600 {
            let demand = tracker.step(&mut state, &straight(), rest, yaw, 0.02);
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
        let (tracker, mut state) = (Config::default().build().unwrap(), State::default());
        let here = Horizontal { north: 3.0, east: 1.0 };
        let demand = tracker.step(&mut state, &[here; WAYPOINTS], here, 0.4, 0.02);
        assert!(demand.velocity_ned_mps.norm() < 1e-6 && demand.yaw_rate_radps == 0.0);
    }
}
