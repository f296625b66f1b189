//! How ArduCopter in GUIDED and PX4 in OFFBOARD follow yaw rates, as recorded in their own simulators
//! (`tests/flight/step_response.rs`).
//!
//! ArduCopter turns a heading that it wants at the rate it is asked for, and follows that heading: by the rate and by
//! what it is behind, with a lag. So it begins late, then turns faster than asked until it has caught up, and swings
//! back where it stops. PX4 follows the rate alone.

use std::collections::VecDeque;

use crate::scenario::Software;

struct Numbers {
    delay_s: f64,
    lag_s: f64,
    /// Of the rate on the heading it is behind.
    gain_per_s: f64,
    rate_max_radps: f64,
}

/// The largest rate is `ATC_SLEW_YAW`, 60 degrees a second; the others are fitted.
const ARDUCOPTER: Numbers = Numbers { delay_s: 0.18, lag_s: 0.15, gain_per_s: 2.0, rate_max_radps: 1.047 };
/// The largest rate is `MC_YAWRATE_MAX`; the others are fitted.
const PX4: Numbers = Numbers { delay_s: 0.13, lag_s: 0.25, gain_per_s: 0.0, rate_max_radps: 3.49 };

/// The heading's controller.
#[derive(Clone, Debug, Default)]
pub(super) struct Yaw {
    /// Rates that have not taken effect yet, with the times when they will.
    underway: VecDeque<(f64, f64)>,
    wanted_radps: f64,
    behind_rad: f64,
}

impl Yaw {
    /// Takes a rate that is asked for.
    pub(super) fn accept(&mut self, software: Software, wanted_radps: f64, time_s: f64) {
        self.underway.push_back((time_s + numbers(software).delay_s, wanted_radps));
    }

    /// The rate after `dt`, from that before.
    pub(super) fn step(&mut self, software: Software, rate_radps: f64, time_s: f64, dt: f64) -> f64 {
        let Numbers { lag_s, gain_per_s, rate_max_radps, .. } = numbers(software);
        while let Some((_, wanted_radps)) = self.underway.pop_front_if(|(at_s, _)| *at_s <= time_s) {
            self.wanted_radps = wanted_radps.clamp(-rate_max_radps, rate_max_radps);
        }
        self.behind_rad += dt * (self.wanted_radps - rate_radps);
        rate_radps + dt / lag_s * (self.wanted_radps + gain_per_s * self.behind_rad - rate_radps)
    }
}

const fn numbers(software: Software) -> Numbers {
    match software {
        Software::ArduCopter => ARDUCOPTER,
        Software::Px4 => PX4,
    }
}
