//! Detects full turns of the antenna, from yaw alone.
//!
//! The yaw is unwrapped, and a rotation is complete once the unwrapped yaw has covered a full turn between its lowest
//! and its highest value, in either direction. So jitter back and forth counts once, a pause only costs time, and a
//! vehicle that sweeps back and forth completes one rotation per sweep.

use core::f32::consts::TAU;

use crate::base::time::Instant;
use crate::base::units::wrap_pi;

/// Turning, so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turn {
    started: Option<Instant>,
    yaw_rad: f32,
    /// Unwrapped yaw since the start, and its extremes.
    turned_rad: f32,
    low_rad: f32,
    high_rad: f32,
}

/// The result of a yaw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turned {
    /// Not around yet.
    Partly,
    /// Around, since that instant. The next rotation starts here.
    Full(Instant),
    /// Not around within the time limit; started afresh.
    TooSlow,
    /// The yaw jumped so far that its direction is unknown; started afresh.
    Leapt,
}

impl Turn {
    /// Without a measurement.
    #[must_use]
    pub const fn new() -> Self {
        Self { started: None, yaw_rad: 0.0, turned_rad: 0.0, low_rad: 0.0, high_rad: 0.0 }
    }

    /// Takes in a yaw.
    pub fn step(&mut self, time: Instant, yaw_rad: f32, leap_max_rad: f32, duration_max_s: f32) -> Turned {
        let Some(started) = self.started else {
            self.restart(time, yaw_rad);
            return Turned::Partly;
        };
        let moved_rad = wrap_pi(yaw_rad - self.yaw_rad);
        if !(libm::fabsf(moved_rad) <= leap_max_rad) {
            self.restart(time, yaw_rad);
            return Turned::Leapt;
        }
        self.yaw_rad = yaw_rad;
        self.turned_rad += moved_rad;
        if self.turned_rad < self.low_rad {
            self.low_rad = self.turned_rad;
        }
        if self.turned_rad > self.high_rad {
            self.high_rad = self.turned_rad;
        }
        // Time that ran backwards is no rotation either.
        if time < started || time.seconds_since(started) > duration_max_s {
            self.restart(time, yaw_rad);
            return Turned::TooSlow;
        }
        if self.high_rad - self.low_rad >= TAU {
            self.restart(time, yaw_rad);
            return Turned::Full(started);
        }
        Turned::Partly
    }

    fn restart(&mut self, time: Instant, yaw_rad: f32) {
        *self = Self { started: Some(time), yaw_rad, ..Self::new() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use std::vec::Vec;

    /// Full turns of a yaw that arrives every 20 ms.
    fn turns(yaws: impl IntoIterator<Item = f32>) -> usize {
        let mut turn = Turn::new();
        let heard = yaws.into_iter().enumerate();
        let outcomes: Vec<Turned> =
            heard.map(|(k, yaw)| turn.step(Instant(k as u64 * 20_000), wrap_pi(yaw), 1.0, 20.0)).collect();
        outcomes.iter().filter(|outcome| matches!(outcome, Turned::Full(_))).count()
    }

    #[test]
    fn full_turns_are_counted_either_way_round_from_any_start() {
        for start in [-3.1_f32, 0.0, 1.0, 3.1] {
            for rate in [0.02_f32, -0.02, 0.5, -0.5] {
                let steps = (5.05 * TAU / rate.abs()) as usize + 5;
                // A turn ends with the first yaw that is over it, so that few long steps may lose one of five.
                let count = turns((0..steps).map(|k| start + rate * k as f32));
                assert!(count == 5 || count == 4 && rate.abs() > 0.1, "{start} {rate}: {count}");
            }
        }
    }

    #[test]
    fn jitter_does_not_turn_and_pauses_do_not_reset() {
        let mut rng = Rng::new(1, 1);
        assert_eq!(turns((0..900).map(|_| 3.1 + 0.2 * rng.gaussian())), 0);
        let stop_and_go = (0..900).map(|k| if k < 300 { 0.01 * k as f32 } else { 0.01 * (k.max(600) - 300) as f32 });
        assert_eq!(turns(stop_and_go), 0, "six seconds of ten at 0.5 rad/s: 6.0 rad");
        let stop_and_go = (0..960).map(|k| if k < 300 { 0.01 * k as f32 } else { 0.01 * (k.max(600) - 300) as f32 });
        assert_eq!(turns(stop_and_go), 1);
        let shaking = (0..700).map(|k| 0.01 * k as f32 + 0.05 * rng.gaussian());
        assert_eq!(turns(shaking), 1);
    }

    #[test]
    fn there_and_back_is_a_turn_only_if_it_covers_every_direction() {
        let sweep = |reach: f32| (0..3000).map(move |k| reach * crate::base::units::sin_cos(0.008 * k as f32).0);
        assert_eq!(turns(sweep(3.0)), 0);
        assert!(turns(sweep(3.3)) >= 3);
    }

    #[test]
    fn a_leap_or_an_endless_pause_starts_afresh_and_says_so() {
        let mut turn = Turn::new();
        assert_eq!(turn.step(Instant(0), 0.0, 1.0, 20.0), Turned::Partly);
        assert_eq!(turn.step(Instant(20_000), 2.0, 1.0, 20.0), Turned::Leapt);
        assert_eq!(turn.step(Instant(40_000), f32::NAN, 1.0, 20.0), Turned::Leapt);
        turn = Turn::new();
        assert_eq!(turn.step(Instant(0), 0.0, 1.0, 20.0), Turned::Partly);
        assert_eq!(turn.step(Instant(20_100_000), 0.5, 1.0, 20.0), Turned::TooSlow);
        assert_eq!(turn.step(Instant(5), 0.5, 1.0, 20.0), Turned::TooSlow);
        // Nor does what ends it count as a turn.
        turn = Turn::new();
        let almost = (0..62).map(|k| turn.step(Instant(20_000 * k), wrap_pi(0.1 * k as f32), 1.0, 20.0));
        assert!(almost.into_iter().all(|turned| turned == Turned::Partly));
        assert_eq!(turn.step(Instant(900_000_000), wrap_pi(6.5), 1.0, 20.0), Turned::TooSlow);
    }
}
