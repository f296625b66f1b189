//! How the vehicle follows a velocity setpoint, and the rest point: where it would stop if commanded to stop now.
//!
//! An autopilot follows a velocity setpoint after a dead time `T` and with a first-order lag `tau`. Whatever
//! is commanded now, the vehicle still moves by `v tau` and by the commands of the last `T` seconds; so
//!
//! ```text
//!     rest = p + v tau + integral of the commands over the last T seconds,     d rest / dt = command
//! ```
//!
//! The rest point follows a command at once. The planner plans for it, the tracker steers it and the guard keeps it
//! clear, and the straight line to it; the vehicle follows it, and cuts its curves by no more than that line.

use heapless::Deque;

use crate::base::error::{ConfigError, check};
use crate::base::ned::Horizontal;

/// Most commands that can be pending.
const PENDING_MAX: usize = 56;

/// Configuration of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Dead time from a setpoint to the first motion; one step at least is counted.
    pub dead_time_s: f32,
    /// Time constant of the velocity after that.
    pub lag_s: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self::ARDUCOPTER
    }
}

impl Config {
    /// ArduCopter in GUIDED, recorded in its own simulator (`tests/flight/step_response`), for commands up to 1 m/s that
    /// change by 2 m/s^2. Steps take longer: its acceleration is limited in its rate.
    pub const ARDUCOPTER: Self = Self { dead_time_s: 0.08, lag_s: 0.45 };
    /// PX4 in OFFBOARD, likewise.
    pub const PX4: Self = Self { dead_time_s: 0.18, lag_s: 0.50 };

    /// Checks the configuration for a loop of the given period.
    ///
    /// # Errors
    /// The field that is out of range; a dead time of more steps than can be stored.
    pub fn build(&self, tick_s: f32) -> Result<VehicleModel, ConfigError> {
        check("vehicle_model.dead_time_s", self.dead_time_s, 0.0, tick_s * PENDING_MAX as f32)?;
        check("vehicle_model.lag_s", self.lag_s, 0.0, 2.0)?;
        // A command takes effect after the step that gives it.
        let steps = (libm::roundf(self.dead_time_s / tick_s) as usize).clamp(1, PENDING_MAX);
        Ok(VehicleModel { lag_s: self.lag_s, pending: steps, tick_s })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleModel {
    lag_s: f32,
    pending: usize,
    tick_s: f32,
}

/// The commands that have not taken effect yet.
#[derive(Clone, Debug, Default)]
pub struct State {
    commands: Deque<Horizontal, PENDING_MAX>,
}

impl State {
    /// The command of `steps` steps ago; there is one for each of the last `pending` steps.
    #[must_use]
    pub fn ago(&self, steps: usize) -> Horizontal {
        let index = self.commands.len().checked_sub(steps + 1);
        index.and_then(|index| self.commands.get(index)).copied().unwrap_or_default()
    }
}

impl VehicleModel {
    /// Mean delay of the vehicle behind its rest point.
    #[must_use]
    pub fn delay_s(&self) -> f32 {
        self.lag_s + self.pending as f32 * self.tick_s
    }

    /// The same delay as a shorter dead time, in steps, and two equal lags one after the other.
    #[must_use]
    pub fn twice_lagged(&self) -> (usize, f32) {
        let dead_steps = (0.7 * self.pending as f32) as usize;
        let tau_s = 0.5 * (self.delay_s() - dead_steps as f32 * self.tick_s);
        (dead_steps, if tau_s > self.tick_s { tau_s } else { self.tick_s })
    }

    /// Records the command of this step.
    pub fn command(&self, state: &mut State, velocity_ned_mps: Horizontal) {
        while state.commands.len() >= self.pending {
            state.commands.pop_front();
        }
        // Cannot fail: one was removed.
        let _ = state.commands.push_back(velocity_ned_mps);
    }

    /// The period of the loop.
    #[must_use]
    pub fn tick_s(&self) -> f32 {
        self.tick_s
    }

    /// Where the vehicle would come to rest.
    #[must_use]
    pub fn rest_point(&self, state: &State, position_ned_m: Horizontal, velocity_ned_mps: Horizontal) -> Horizontal {
        let pending = state.commands.iter().fold(Horizontal::default(), |sum, command| sum.plus(*command));
        position_ned_m.plus(velocity_ned_mps.times(self.lag_s)).plus(pending.times(self.tick_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_with_dead_time_and_lag_stops_where_the_rest_point_said() {
        let (tick, dead, lag) = (0.02, 0.32, 0.5);
        let vehicle_model = Config { dead_time_s: dead, lag_s: lag }.build(tick as f32).unwrap();
        let mut state = State::default();
        let (mut position, mut velocity) = (0.0_f64, 0.0_f64);
        let mut line = std::collections::VecDeque::from(std::vec![0.0_f64; 16]);
        let mut run = |command: f64, state: &mut State| {
            vehicle_model.command(state, Horizontal { north: command as f32, east: 0.0 });
            line.push_back(command);
            let acting = line.pop_front().unwrap();
            for _ in 0..20 {
                velocity += (acting - velocity) * (tick / 20.0) / f64::from(lag);
                position += velocity * tick / 20.0;
            }
            (position, velocity)
        };
        let mut at = (0.0, 0.0);
        for step in 0..70 {
            at = run(if step < 30 { 1.0 } else { 0.4 }, &mut state);
        }
        let north = |value: f64| Horizontal { north: value as f32, east: 0.0 };
        let rest = vehicle_model.rest_point(&state, north(at.0), north(at.1));
        for _ in 0..300 {
            at = run(0.0, &mut state);
        }
        assert!((f64::from(rest.north) - at.0).abs() < 0.02, "said {rest:?}, stopped at {at:?}");
    }
}
