//! The paper's model of a vehicle that flies along a measured direction (eq. 2-3), and the rules that choose it.

use std::f64::consts::{PI, TAU};

use foxhound_core::ConfigError;
use foxhound_core::base::time::Instant;
use foxhound_papers::rotating::{direction, pursuit};

use crate::world::random::Random;
use crate::world::{Horizontal, wrap_pi};

/// Length of a step, from rotation to rotation.
pub(super) const STEP_M: f64 = 0.1;
/// Time of a step: 1 m/s. The model has none; the filters want one.
const STEP_US: u64 = 100_000;
/// Distance at which the source is reached.
pub(super) const REACHED_M: f64 = 1.0;

/// Where outliers point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outliers {
    /// Anywhere.
    Anywhere,
    /// Straight away from the source: the worst that can be.
    Away,
}

/// The measurement.
#[derive(Clone, Copy, Debug)]
pub(super) struct Model {
    pub(super) outlier_rate: f64,
    pub(super) sigma_rad: f64,
    pub(super) outliers: Outliers,
}

impl Model {
    /// A measured direction (eq. 2). The same numbers are drawn whatever comes of them.
    pub(super) fn heard_rad(&self, source_rad: f64, random: &mut Random) -> f64 {
        let (coin, noise, anywhere) = (random.uniform(), random.gaussian(), random.uniform());
        let outlier_rad = match self.outliers {
            Outliers::Anywhere => TAU * anywhere,
            Outliers::Away => source_rad + PI,
        };
        wrap_pi(if coin < self.outlier_rate { outlier_rad } else { source_rad + self.sigma_rad * noise })
    }
}

/// Who says where to fly.
#[derive(Clone, Debug)]
pub(super) enum Rule {
    /// The paper: along the last measured direction.
    Greedy,
    /// The direction filter: neither position nor range.
    Direction(direction::Filter, Box<direction::State>),
    /// Both filters, for a source at rest.
    Filtered(pursuit::Pursuer, Box<pursuit::State<2>>),
    /// Both filters, for a source that moves.
    FilteredMoving(pursuit::Pursuer, Box<pursuit::State<4>>),
}

impl Rule {
    /// The rules for a source at rest, in the order of the reports.
    pub(super) fn resting() -> Result<[Self; 3], ConfigError> {
        let [greedy, direction, _] = Self::moving()?;
        Ok([greedy, direction, Self::Filtered(pursuit::Config::default().build()?, Box::default())])
    }

    /// The rules for a source that moves.
    pub(super) fn moving() -> Result<[Self; 3], ConfigError> {
        let direction = direction::Config::default().build()?;
        let pursuer = pursuit::Config::default().build()?;
        Ok([Self::Greedy, Self::Direction(direction, Box::default()), Self::FilteredMoving(pursuer, Box::default())])
    }

    /// Where to fly after this rotation.
    fn course_rad(&mut self, step: u32, place: Horizontal, heard_rad: f64, sigma_rad: f64) -> f64 {
        let time = Instant(u64::from(step) * STEP_US);
        let (heard, sigma, place) = (heard_rad as f32, sigma_rad as f32, place.to_core());
        let said = match self {
            Self::Greedy => None,
            Self::Direction(filter, state) => filter.step(state, time, heard, sigma).map(|known| known.bearing_ned_rad),
            Self::Filtered(pursuer, state) => pursuer.step(state, time, place, heard, sigma),
            Self::FilteredMoving(pursuer, state) => pursuer.step(state, time, place, heard, sigma),
        };
        said.map_or(heard_rad, f64::from)
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
        let course_rad = self.rule.course_rad(self.steps, self.place, heard_rad, self.model.sigma_rad);
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
    use super::*;

    #[test]
    fn a_step_is_that_of_the_paper() {
        let model = Model { outlier_rate: 0.3, sigma_rad: 0.4, outliers: Outliers::Anywhere };
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
        let model = Model { outlier_rate: 0.0, sigma_rad: 0.0, outliers: Outliers::Anywhere };
        for rule in Rule::resting().unwrap() {
            let walk = Walk::new(&rule, model, Horizontal { north: 50.0, east: 50.0 }, Random::new(1, 1));
            let stretch = walk.stretch(1000).unwrap();
            assert!((stretch - 69.8 / 70.71).abs() < 0.003, "{rule:?}: {stretch}");
        }
    }

    #[test]
    fn who_does_not_arrive_is_said_not_to() {
        let model = Model { outlier_rate: 1.0, sigma_rad: 0.0, outliers: Outliers::Away };
        let start = Horizontal { north: 5.0, east: 5.0 };
        assert_eq!(Walk::new(&Rule::Greedy, model, start, Random::new(1, 1)).stretch(500), None);
    }
}
