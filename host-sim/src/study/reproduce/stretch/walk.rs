//! The paper's model of a vehicle that flies along a measured direction (eq. 2-3), and the rules that choose it.

use std::f64::consts::TAU;

use foxhound_core::ConfigError;
use foxhound_core::localize::source::{Sighting, bank};

use crate::world::random::Random;
use crate::world::{Horizontal, wrap_pi};

/// Length of a step, from rotation to rotation.
pub(super) const STEP_M: f64 = 0.1;
/// Time of a step: 1 m/s. The model has none; the filters want one.
const STEP_S: f32 = 0.1;
/// The least sigma that the filters are told: they divide by it.
const SIGMA_MIN_RAD: f32 = 0.02;
/// Distance at which the source is reached.
pub(super) const REACHED_M: f64 = 1.0;

/// The measurement; outliers point anywhere.
#[derive(Clone, Copy, Debug)]
pub(super) struct Model {
    pub(super) outlier_rate: f64,
    pub(super) sigma_rad: f64,
}

impl Model {
    /// A measured direction (eq. 2). The same numbers are drawn whatever comes of them.
    pub(super) fn heard_rad(&self, source_rad: f64, random: &mut Random) -> f64 {
        let (coin, noise, anywhere) = (random.uniform(), random.gaussian(), random.uniform());
        wrap_pi(if coin < self.outlier_rate { TAU * anywhere } else { source_rad + self.sigma_rad * noise })
    }
}

/// Who says where to fly.
#[derive(Clone, Debug)]
pub(super) enum Rule {
    /// The paper: along the last measured direction.
    Greedy,
    /// The filters that fly.
    Filtered(bank::FilterBank, Box<bank::State>),
}

impl Rule {
    /// The rules, in the order of the reports.
    pub(super) fn all() -> Result<[Self; 2], ConfigError> {
        Ok([Self::Greedy, Self::Filtered(bank::Config::DEFAULT.build()?, Box::new(bank::State::new()))])
    }

    /// Where to fly after this rotation.
    fn course_rad(&mut self, place: Horizontal, heard_rad: f64, sigma_rad: f64) -> f64 {
        let Self::Filtered(bank, state) = self else { return heard_rad };
        let sighting = Sighting {
            place_ned_m: place.to_core(),
            direction_ned: Horizontal::from_bearing(heard_rad).to_core(),
            sigma_rad: (sigma_rad as f32).max(SIGMA_MIN_RAD),
            since_s: STEP_S,
        };
        bank.step(state, &sighting, 0.0, &[]).map_or(heard_rad, |known| f64::from(known.estimate.bearing_ned_rad))
    }
}

/// A vehicle in flight.
pub(super) struct Walk {
    pub(super) place: Horizontal,
    pub(super) steps: u32,
    rule: Rule,
    model: Model,
    random: Random,
}

impl Walk {
    pub(super) fn new(rule: &Rule, model: Model, start: Horizontal, random: Random) -> Self {
        Self { place: start, steps: 0, rule: rule.clone(), model, random }
    }

    /// Measures the direction and takes a step (eq. 3); returns the distance to the source then.
    pub(super) fn step(&mut self, source: Horizontal) -> f64 {
        let heard_rad = self.model.heard_rad(source.minus(self.place).bearing_rad(), &mut self.random);
        let course_rad = self.rule.course_rad(self.place, heard_rad, self.model.sigma_rad);
        self.place = self.place.along(Horizontal::from_bearing(course_rad), STEP_M);
        self.steps += 1;
        source.minus(self.place).norm()
    }

    /// Path to a source at the origin over the straight line; `None` if it takes more steps than that.
    pub(super) fn stretch(mut self, steps_max: u32) -> Option<f64> {
        let straight_m = self.place.norm();
        while self.steps < steps_max {
            if self.step(Horizontal::default()) <= REACHED_M {
                return Some(STEP_M * f64::from(self.steps) / straight_m);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn a_step_is_that_of_the_paper() {
        let model = Model { outlier_rate: 0.3, sigma_rad: 0.4 };
        let start = Horizontal { north: 4.0, east: -3.0 };
        let mut walk = Walk::new(&Rule::Greedy, model, start, Random::new(1, 1));
        let mut random = Random::new(1, 1);
        // Its angles run anticlockwise from x, to the east; ours clockwise from north.
        let (mut x, mut y) = start.xy();
        for _ in 0..50 {
            let (coin, noise, anywhere) = (random.uniform(), random.gaussian(), random.uniform());
            let psi = if coin < 0.3 { PI / 2.0 - TAU * anywhere } else { libm::atan2(-y, -x) - 0.4 * noise };
            (x, y) = (x + 0.1 * libm::cos(psi), y + 0.1 * libm::sin(psi));
            walk.step(Horizontal::default());
            assert!(walk.place.minus(Horizontal::from_xy([x, y])).norm() < 1e-6);
        }
    }

    #[test]
    fn without_noise_and_outliers_every_rule_flies_the_straight_line() {
        let model = Model { outlier_rate: 0.0, sigma_rad: 0.0 };
        for rule in Rule::all().unwrap() {
            let walk = Walk::new(&rule, model, Horizontal { north: 50.0, east: 50.0 }, Random::new(1, 1));
            let stretch = walk.stretch(1000).unwrap();
            assert!((stretch - 69.8 / 70.71).abs() < 0.003, "{rule:?}: {stretch}");
        }
    }

    #[test]
    fn who_does_not_arrive_is_said_not_to() {
        let model = Model { outlier_rate: 1.0, sigma_rad: 0.0 };
        let start = Horizontal { north: 50.0, east: 50.0 };
        assert_eq!(Walk::new(&Rule::Greedy, model, start, Random::new(1, 1)).stretch(500), None);
    }
}
