//! Wind: a mean, and gusts on top of it, which push the vehicle.
//!
//! Gusts are a first-order process along each axis, `dg = -g dt / T + sigma sqrt(2 dt / T) n`: the longitudinal one
//! of Dryden's turbulence. Air that moves by `w` pushes with `d w`; `d` of 0.3 1/s, a small multicopter's drag, is an
//! assumption. The autopilot has countered the mean when the flight begins; its reaction to the rest is in
//! [`super::deviation`].

use super::geometry::Horizontal;
use super::random::Random;
use crate::scenario;

/// Acceleration per metre a second of wind.
const DRAG_PER_S: f64 = 0.3;

/// The acceleration of the vehicle by the air, NED, m/s^2.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Push {
    /// Mean and gusts.
    pub whole: Horizontal,
    /// The gusts, without the mean.
    pub gust: Horizontal,
}

/// The air around the vehicle.
#[derive(Clone, Debug)]
pub struct Air {
    wind: scenario::Wind,
    random: Random,
    gust_mps: Horizontal,
}

impl Air {
    /// The air at the start of a flight, with a random gust.
    #[must_use]
    pub fn new(wind: scenario::Wind, mut random: Random) -> Self {
        let (north, east) = (random.gaussian(), random.gaussian());
        let gust_mps = Horizontal { north: wind.gust_mps * north, east: wind.gust_mps * east };
        Self { wind, random, gust_mps }
    }

    /// The push over the next step.
    pub fn step(&mut self, step_s: f64) -> Push {
        let stays = libm::exp(-step_s / self.wind.gust_s);
        let fresh_mps = self.wind.gust_mps * libm::sqrt(1.0 - stays * stays);
        let mut next = |gust_mps: f64| stays * gust_mps + fresh_mps * self.random.gaussian();
        self.gust_mps = Horizontal { north: next(self.gust_mps.north), east: next(self.gust_mps.east) };
        let wind_mps = self.gust_mps.along(Horizontal::from_xy([self.wind.vx, self.wind.vy]), 1.0);
        let whole = Horizontal::default().along(wind_mps, DRAG_PER_S);
        Push { whole, gust: Horizontal::default().along(self.gust_mps, DRAG_PER_S) }
    }
}

/// The error of the position that the autopilot reports: noise from report to report, and a slow drift.
#[derive(Clone, Debug)]
pub struct Drift {
    position: scenario::Position,
    random: Random,
    drift_m: Horizontal,
}

impl Drift {
    /// Zero at the start, where the map's origin is.
    #[must_use]
    pub fn new(position: scenario::Position, random: Random) -> Self {
        Self { position, random, drift_m: Horizontal::default() }
    }

    /// The error after the next step.
    pub fn step(&mut self, step_s: f64) -> Horizontal {
        let Self { position, random, drift_m } = self;
        let stays = libm::exp(-step_s / position.drift_s);
        let fresh_m = position.drift_m * libm::sqrt(1.0 - stays * stays);
        let mut next = |drift_m: f64| stays * drift_m + fresh_m * random.gaussian();
        *drift_m = Horizontal { north: next(drift_m.north), east: next(drift_m.east) };
        let noise = Horizontal { north: random.gaussian(), east: random.gaussian() };
        drift_m.along(noise, position.noise_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 0.02;

    /// Standard deviation, and correlation of a value with the one `later` steps after it.
    fn moments(values: &[f64], later: usize) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let product = |a: &[f64], b: &[f64]| {
            a.iter().zip(b).map(|(a, b)| (a - mean) * (b - mean)).sum::<f64>() / a.len().min(b.len()) as f64
        };
        let variance = product(values, values);
        (variance.sqrt(), product(values, &values[later..]) / variance)
    }

    #[test]
    fn gusts_have_the_strength_and_the_length_that_were_asked_for() {
        let wind = scenario::Wind { vx: 3.0, vy: -1.0, gust_mps: 1.5, gust_s: 2.0 };
        let mut air = Air::new(wind, Random::new(1, 3));
        let pushes: Vec<Push> = (0..500_000).map(|_| air.step(STEP_S)).collect();
        for (axis, mean_mps) in [(0, -1.0), (1, 3.0)] {
            let wind_mps: Vec<f64> =
                pushes.iter().map(|push| [push.whole.north, push.whole.east][axis] / DRAG_PER_S).collect();
            let (sigma_mps, after_2_s) = moments(&wind_mps, 100);
            // 10 000 s of gusts of 2 s: some thousand independent ones.
            assert!((sigma_mps - 1.5).abs() < 0.06, "{sigma_mps}");
            assert!((after_2_s - (-1.0_f64).exp()).abs() < 0.05, "{after_2_s}");
            let mean = wind_mps.iter().sum::<f64>() / wind_mps.len() as f64;
            assert!((mean - mean_mps).abs() < 0.12, "{mean}");
        }
        let gust = pushes.iter().map(|push| push.gust.east).sum::<f64>() / pushes.len() as f64;
        assert!(gust.abs() < 0.12 * DRAG_PER_S, "the mean is no gust: {gust}");
    }

    #[test]
    fn a_steady_wind_pushes_nobody_about_and_is_leant_into() {
        let mut air = Air::new(scenario::Wind { vx: 5.0, ..scenario::Wind::default() }, Random::new(1, 3));
        for _ in 0..100 {
            let Push { whole, gust } = air.step(STEP_S);
            assert!(gust.norm() < 1e-12 && (whole.east - 1.5).abs() < 1e-12);
        }
    }

    #[test]
    fn a_drift_comes_slowly_and_is_bounded_by_its_sigma() {
        let position = scenario::Position { noise_m: 0.02, drift_m: 0.3, drift_s: 20.0 };
        let mut drift = Drift::new(position, Random::new(2, 4));
        assert!(drift.step(STEP_S).norm() < 0.15, "it begins where the map does");
        let errors: Vec<f64> = (0..2_000_000).map(|_| drift.step(STEP_S).north).collect();
        let (sigma_m, after_20_s) = moments(&errors, 1000);
        assert!((sigma_m - 0.3).abs() < 0.02 && (after_20_s - 0.37).abs() < 0.06, "{sigma_m} {after_20_s}");
        let steps: Vec<f64> = errors.windows(2).map(|pair| pair[1] - pair[0]).collect();
        // Two draws of the noise, and what the drift has moved: 0.3 sqrt(2 0.02 / 20).
        let (jitter_m, _) = moments(&steps, 1);
        let expected_m = (2.0 * 0.02_f64.powi(2) + 0.3_f64.powi(2) * 2.0 * 0.02 / 20.0).sqrt();
        assert!((jitter_m / expected_m - 1.0).abs() < 0.02, "{jitter_m}");
    }
}
