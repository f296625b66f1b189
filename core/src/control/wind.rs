//! Estimates gusts: how much faster the vehicle has lately been than its commands explain.
//!
//! The comparison uses the delay of [`crate::control::vehicle_model`], as a dead time and two equal lags in series:
//! the shape of a real autopilot's response, which is nearly a critically damped second order.
//!
//! ```text
//!     s1' = (command a dead time ago - s1) / tau,    s2' = (s1 - s2) / tau,    excess = |measured - s2| - floor - slack |s2'|
//! ```
//!
//! The excess is due to the wind. Its largest recent value, fading with [`Config::memory_s`], times
//! [`Config::margin_s`] is the **gust margin**: about how far such gusts move the vehicle before its autopilot has
//! brought it back. (A controller that holds a position at a bandwidth of 1 rad/s, as ArduCopter's does, is off by
//! about as many metres as it is metres a second too fast.) The largest of few gusts is not yet the largest to
//! expect, so at first the margin is larger by the factor [`Config::unsure`]. Guard and planner add it to their own
//! margins from standing obstacles. In calm air there is no excess, and the margin is exactly zero.
//!
//! A vehicle that hovers and leans when control begins is leaning against the wind, and wind has gusts: a part of the
//! lean counts as a gust. A lean of less than two degrees is not attributed to wind.
//!
//! It is estimated only while we are in control: otherwise, and for the first second in control, it keeps its value.

use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::time::Instant;
use crate::control::vehicle_model::{self, VehicleModel};

/// No comparison for this long after control was taken.
const SETTLING_S: f32 = 1.0;

/// Steps after which the vehicle may lean because of a command.
const BEGINNING: u8 = 5;
/// The vehicle counts as hovering below this speed.
const STANDING_MPS: f32 = 0.3;
/// A lean that the vehicle may have without wind.
const LEAN_MIN_RAD: f32 = 0.035;
/// A measured excess above this is a gust: a steady wind that the vehicle leans against has none.
const GUST_MPS: f32 = 0.1;

/// Configuration of the gust margin.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Margin for each metre a second of excess; zero: gusts are ignored.
    pub margin_s: f32,
    /// Largest margin.
    pub margin_max_m: f32,
    /// Time constant with which a gust is forgotten.
    pub memory_s: f32,
    /// The additional share of margin before any gust has been seen.
    pub unsure: f32,
    /// Time after which enough of them have been seen.
    pub unsure_s: f32,
    /// An excess below this is noise.
    pub floor_mps: f32,
    /// Error of the vehicle's model, in time.
    pub slack_s: f32,
    /// Excess per radian of lean at the beginning; zero: the lean is ignored.
    pub lean_mps_per_rad: f32,
}

impl Default for Config {
    /// Compared with other values in `docs/results/gusts.md`. Floor and slack keep the margin at zero in calm air, with
    /// the responses of ArduCopter and of PX4, and with a point mass with a lag of 0.15 s.
    fn default() -> Self {
        Self {
            margin_s: 1.3,
            margin_max_m: 1.0,
            memory_s: 40.0,
            unsure: 2.0,
            unsure_s: 4.0,
            floor_mps: 0.06,
            slack_s: 0.09,
            lean_mps_per_rad: 1.4,
        }
    }
}

impl Config {
    /// Checks the configuration, for a model of the vehicle.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self, vehicle_model: &VehicleModel, tick_s: f32) -> Result<Estimator, ConfigError> {
        check("wind.margin_s", self.margin_s, 0.0, 10.0)?;
        check("wind.margin_max_m", self.margin_max_m, 0.0, 5.0)?;
        check("wind.memory_s", self.memory_s, 0.1, 1000.0)?;
        check("wind.unsure", self.unsure, 0.0, 10.0)?;
        check("wind.unsure_s", self.unsure_s, 0.1, 1000.0)?;
        check("wind.floor_mps", self.floor_mps, 0.0, 10.0)?;
        check("wind.slack_s", self.slack_s, 0.0, 10.0)?;
        check("wind.lean_mps_per_rad", self.lean_mps_per_rad, 0.0, 100.0)?;
        let (dead_steps, tau_s) = vehicle_model.twice_lagged();
        Ok(Estimator {
            config: *self,
            dead_steps,
            per_tau: 1.0 / tau_s,
            share: tick_s / (tau_s + 0.5 * tick_s),
            stays: libm::expf(-tick_s / self.memory_s),
            learned: 1.0 - libm::expf(-tick_s / self.unsure_s),
            settling: libm::ceilf(SETTLING_S / tick_s) as u8,
        })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimator {
    config: Config,
    dead_steps: usize,
    per_tau: f32,
    /// Share of its distance that a lag covers in a step.
    share: f32,
    stays: f32,
    learned: f32,
    settling: u8,
}

/// The expected velocity of the vehicle, and the largest recent excess.
#[derive(Clone, Debug, Default)]
pub struct State {
    first_mps: Horizontal,
    second_mps: Horizontal,
    excess_mps: f32,
    /// The same without the lean at the beginning.
    measured_mps: f32,
    /// From 0, nothing has been seen, to 1.
    sure: f32,
    /// Steps in control, up to the end of the settling.
    since: u8,
    /// When the velocity was received: the lower bits, which distinguish it from the one before.
    received_us: u32,
}

impl State {
    /// The velocity between the two lags, which the vehicle's velocity is approaching.
    #[must_use]
    pub fn halfway_mps(&self) -> Horizontal {
        self.first_mps
    }

    /// Out of control; the estimate is kept.
    pub fn release(&mut self) {
        self.since = 0;
    }
}

impl Estimator {
    /// Takes in the vehicle's lean when control has just begun.
    pub fn begin(&self, state: &mut State, roll_rad: f32, pitch_rad: f32, velocity_ned_mps: Horizontal) {
        if state.since > BEGINNING || velocity_ned_mps.norm_squared() > STANDING_MPS * STANDING_MPS {
            return;
        }
        let lean_rad = sqrt(roll_rad * roll_rad + pitch_rad * pitch_rad);
        let excess_mps = self.config.lean_mps_per_rad * (lean_rad - LEAN_MIN_RAD);
        // False also for NaN.
        if excess_mps > state.excess_mps {
            state.excess_mps = excess_mps;
        }
    }

    /// One step in control: `commands` are those before this step's; the velocity is the latest received, with its
    /// time.
    pub fn step(
        &self,
        state: &mut State,
        commands: &vehicle_model::State,
        velocity_ned_mps: Horizontal,
        received: Instant,
    ) {
        let c = &self.config;
        if state.since == 0 {
            (state.first_mps, state.second_mps) = (velocity_ned_mps, velocity_ned_mps);
        }
        state.since = state.since.saturating_add(1).min(self.settling);
        let command = commands.ago(self.dead_steps);
        state.first_mps = state.first_mps.plus(command.minus(state.first_mps).times(self.share));
        let change = state.first_mps.minus(state.second_mps);
        state.second_mps = state.second_mps.plus(change.times(self.share));
        state.excess_mps *= self.stays;
        state.measured_mps *= self.stays;
        // Only a new velocity is compared.
        let received_us = received.0 as u32;
        if state.since >= self.settling && received_us != state.received_us {
            state.sure += self.learned * (1.0 - state.sure);
            let off_mps = sqrt(velocity_ned_mps.minus(state.second_mps).norm_squared());
            let excess_mps = off_mps - c.floor_mps - c.slack_s * self.per_tau * sqrt(change.norm_squared());
            // False also for NaN.
            if excess_mps > state.excess_mps {
                state.excess_mps = excess_mps;
            }
            if excess_mps > state.measured_mps {
                state.measured_mps = excess_mps;
            }
        }
        state.received_us = received_us;
    }

    /// Whether gusts have pushed the vehicle lately; a lean at the beginning alone only lets expect them.
    #[must_use]
    pub fn has_gusts(&self, state: &State) -> bool {
        self.config.margin_s > 0.0 && state.measured_mps > GUST_MPS
    }

    /// The gust margin.
    #[must_use]
    pub fn margin_m(&self, state: &State) -> f32 {
        let c = &self.config;
        let margin_m = c.margin_s * (1.0 + c.unsure * (1.0 - state.sure)) * state.excess_mps;
        if margin_m < c.margin_max_m { margin_m } else { c.margin_max_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    const TICK_S: f32 = 0.02;

    /// A response of the second order: natural frequency and damping, after two steps; and what is configured for it.
    struct Response(f32, f32, vehicle_model::Config);

    /// Fitted to the simulator's ArduCopter and PX4, which are fitted to recordings.
    const ARDUCOPTER: Response = Response(4.35, 1.08, vehicle_model::Config::ARDUCOPTER);
    const PX4: Response = Response(2.82, 0.92, vehicle_model::Config::PX4);

    /// `wind` is added to a response. Commands turn and change at the guard's limit of 2 m/s^2. Returns the margin after
    /// each step.
    fn margins(response: &Response, duration_s: f32, wind: impl Fn(f32) -> Horizontal) -> std::vec::Vec<f32> {
        let Response(rate_radps, damping, config) = *response;
        let vehicle_model = config.build(TICK_S).unwrap();
        let estimator = Config::default().build(&vehicle_model, TICK_S).unwrap();
        let (mut commands, mut state) = (vehicle_model::State::default(), State::default());
        let mut line = std::collections::VecDeque::from(std::vec![Horizontal::default(); 2]);
        let (mut velocity, mut acceleration) = (Horizontal::default(), Horizontal::default());
        let (mut command, mut wanted) = (Horizontal::default(), Horizontal::default());
        let mut rng = Rng::new(5, 1);
        let steps = (duration_s / TICK_S) as u64;
        (0..steps)
            .map(|step| {
                if step % 60 == 0 {
                    wanted = Horizontal::from_bearing(6.3 * rng.uniform()).times(rng.uniform());
                }
                let heard = velocity.plus(wind(step as f32 * TICK_S));
                estimator.step(&mut state, &commands, heard, Instant(1 + step * 20_000));
                command = command.plus(wanted.minus(command).clamped(2.0 * TICK_S));
                vehicle_model.command(&mut commands, command);
                line.push_back(command);
                let acting = line.pop_front().unwrap();
                for _ in 0..10 {
                    let pull = acting.minus(velocity).times(rate_radps * rate_radps);
                    let jerk = pull.minus(acceleration.times(2.0 * damping * rate_radps));
                    acceleration = acceleration.plus(jerk.times(0.002));
                    velocity = velocity.plus(acceleration.times(0.002));
                }
                estimator.margin_m(&state)
            })
            .collect()
    }

    #[test]
    fn in_calm_air_the_margin_is_exactly_zero_whatever_is_flown() {
        let prompt = Response(13.0, 1.0, vehicle_model::Config { dead_time_s: 0.0, lag_s: 0.15 });
        for response in [ARDUCOPTER, PX4, prompt] {
            let margins = margins(&response, 300.0, |_| Horizontal::default());
            assert!(margins.into_iter().all(|margin_m| margin_m == 0.0));
        }
    }

    #[test]
    fn who_stands_in_the_air_and_leans_expects_gusts_and_who_flies_does_not() {
        let vehicle_model = vehicle_model::Config::default().build(TICK_S).unwrap();
        let estimator = Config::default().build(&vehicle_model, TICK_S).unwrap();
        let margin_m = |pitch_rad: f32, north: f32| {
            let mut state = State::default();
            estimator.begin(&mut state, 0.0, pitch_rad, Horizontal { north, east: 0.0 });
            estimator.margin_m(&state)
        };
        // Against 3 m/s: 0.3 1/s of it over gravity.
        assert!((0.2..0.4).contains(&margin_m(-0.092, 0.0)), "{}", margin_m(-0.092, 0.0));
        assert_eq!([margin_m(0.03, 0.0), margin_m(-0.092, 0.5), margin_m(f32::NAN, 0.0)], [0.0; 3]);
        assert_eq!(margin_m(-0.8, 0.0), Config::default().margin_max_m);
    }

    #[test]
    fn a_gust_of_so_many_metres_a_second_is_found_and_fades() {
        // 0.4 m/s for two seconds, late in the flight.
        let margins = margins(&ARDUCOPTER, 100.0, |at_s| Horizontal {
            north: if (50.0..52.0).contains(&at_s) { 0.4 } else { 0.0 },
            east: 0.0,
        });
        let at = |at_s: f32| margins[(at_s / TICK_S) as usize];
        assert_eq!(at(49.9), 0.0);
        // Reduced by at most the floor; increased by the model's error, which may add to it.
        assert!((0.9 * 0.35..1.1 * 0.45).contains(&(at(52.0) / 1.3)), "{}", at(52.0));
        assert!((at(92.0) / at(52.0) - (-1.0_f32).exp()).abs() < 0.02);
    }

    #[test]
    fn the_first_gust_counts_for_more() {
        let first = |from_s: f32| {
            let gust = move |at_s| Horizontal { north: 0.0, east: if at_s > from_s { 0.15 } else { 0.0 } };
            margins(&ARDUCOPTER, from_s + 0.5, gust).pop().unwrap()
        };
        assert!(first(1.5) > 1.8 * first(40.0), "{} {}", first(1.5), first(40.0));
    }

    #[test]
    fn it_is_bounded_and_learns_nothing_from_silence_or_out_of_control() {
        let vehicle_model = vehicle_model::Config::default().build(TICK_S).unwrap();
        let estimator = Config::default().build(&vehicle_model, TICK_S).unwrap();
        let commands = vehicle_model::State::default();
        let mut state = State::default();
        let mut flown = |north: f32, received_us: u64, released: bool| {
            if released {
                state.release();
            }
            estimator.step(&mut state, &commands, Horizontal { north, east: 0.0 }, Instant(received_us));
            estimator.margin_m(&state)
        };
        // A pilot flies it about; then a velocity that stands still on the link, and one that is NaN.
        assert!((0..500).all(|k| flown((0.1 * k as f32).sin(), 1 + k, true) == 0.0));
        assert!((0..500).all(|k| flown(0.0, 1000 + k, false) == 0.0));
        assert!((0..500).all(|_| flown(3.0, 1499, false) == 0.0));
        assert_eq!(flown(f32::NAN, 2000, false), 0.0);
        assert_eq!(flown(1e30, 2001, false), 1.0);
        assert_eq!(flown(f32::INFINITY, 2002, false), 1.0);
    }

    #[test]
    fn what_is_out_of_range_is_refused_by_name() {
        let vehicle_model = vehicle_model::Config::default().build(TICK_S).unwrap();
        let refused = |config: Config| config.build(&vehicle_model, TICK_S).unwrap_err().field;
        assert_eq!(refused(Config { margin_s: -1.0, ..Config::default() }), "wind.margin_s");
        assert_eq!(refused(Config { memory_s: f32::NAN, ..Config::default() }), "wind.memory_s");
    }
}
