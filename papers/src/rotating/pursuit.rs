//! The direction to fly in, from rotations and the vehicle's own positions.
//!
//! Two filters run side by side. [`direction`] recovers soon from outliers, because it keeps every maximum of the
//! posterior, but it uses neither range nor the vehicle's motion. [`polar`] estimates the range and compensates the
//! bearing for the vehicle's motion, but it has one maximum only: started on an outlier, it would reject the correct
//! bearings as outliers. So the first filter starts the second, and restarts it when the two contradict each other.
//! Close to the source, where the direction changes fast and jumps, the first filter decides.

use foxhound_core::base::error::ConfigError;
use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::localize::source::{Sighting, Update, polar};

use super::direction;

/// Largest standard deviation of the direction at which the second filter is started.
const START_SIGMA_RAD: f32 = 0.4;
/// The two contradict each other when they differ by more than this many of their joint standard deviations, for this
/// many rotations in a row.
const CONTRADICTION: f32 = 3.0;
const PATIENCE: u8 = 5;
/// Probability of a fast direction above which the position is ignored.
const FAST: f32 = 0.5;

/// Configuration of the pursuit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The filter without a position.
    pub direction: direction::Config,
    /// The filter with a position. Its outlier rate is that of `direction`.
    pub polar: polar::Config,
}

impl Default for Config {
    fn default() -> Self {
        let polar =
            polar::Config { inverse_range_per_m: 0.03, inverse_range_sigma_per_m: 0.06, ..polar::Config::DEFAULT };
        Self { direction: direction::Config::default(), polar }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Pursuer, ConfigError> {
        let direction = self.direction.build()?;
        let polar = polar::Config { outlier_rate: self.direction.outlier_rate.min(0.9), ..self.polar }.build()?;
        Ok(Pursuer { direction, polar })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pursuer {
    direction: direction::Filter,
    polar: polar::Filter,
}

/// The state of both filters; `S` as for [`polar::State`].
#[derive(Clone, Debug, PartialEq)]
pub struct State<const S: usize> {
    direction: direction::State,
    polar: polar::State<S>,
    heard: Option<Instant>,
    contradictions: u8,
}

impl<const S: usize> Default for State<S> {
    fn default() -> Self {
        Self { direction: direction::State::default(), polar: polar::State::new(), heard: None, contradictions: 0 }
    }
}

impl Pursuer {
    /// The direction to fly in, from north, clockwise, (-pi, pi], after a rotation's bearing, measured at a position;
    /// `None` if either is not finite.
    pub fn step<const S: usize>(
        &self,
        state: &mut State<S>,
        time: Instant,
        place_ned_m: Horizontal,
        bearing_ned_rad: f32,
        sigma_rad: f32,
    ) -> Option<f32> {
        let known = self.direction.step(&mut state.direction, time, bearing_ned_rad, sigma_rad)?;
        let since_s = state.heard.replace(time).map_or(0.0, |heard| time.seconds_since(heard));
        let sighting = |bearing_rad: f32, sigma_rad: f32| Sighting {
            place_ned_m,
            direction_ned: Horizontal::from_bearing(bearing_rad),
            sigma_rad,
            since_s,
        };
        if state.polar.is_started() {
            if let Update::Fused { .. } = self.polar.step(&mut state.polar, &sighting(bearing_ned_rad, sigma_rad)) {
                self.compare(state, &known);
            }
        } else if known.sigma_rad < START_SIGMA_RAD {
            self.polar.step(&mut state.polar, &sighting(known.bearing_ned_rad, known.sigma_rad));
        }
        Some(match state.polar.estimate() {
            Some(source) if known.fast < FAST => source.bearing_ned_rad,
            _ => known.bearing_ned_rad,
        })
    }

    /// Stops the filter with the position when the one without contradicts it.
    fn compare<const S: usize>(&self, state: &mut State<S>, known: &direction::Estimate) {
        let Some(source) = state.polar.estimate() else { return };
        let off_rad = wrap_pi(source.bearing_ned_rad - known.bearing_ned_rad);
        let both_rad = sqrt(source.bearing_sigma_rad * source.bearing_sigma_rad + known.sigma_rad * known.sigma_rad);
        if libm::fabsf(off_rad) > CONTRADICTION * both_rad {
            state.contradictions += 1;
        } else {
            state.contradictions = 0;
        }
        if state.contradictions >= PATIENCE {
            state.contradictions = 0;
            state.polar = polar::State::new();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::TAU;
    use foxhound_core::base::rng::Rng;
    use foxhound_core::localize::source::bank;

    /// What says where to fly: both filters, or the bank that flies.
    enum Rule {
        Pursuit(Pursuer, State<2>),
        Bank(bank::FilterBank, bank::State),
    }

    impl Rule {
        fn pursuit() -> Self {
            Self::Pursuit(Config::default().build().unwrap(), State::default())
        }

        fn bank() -> Self {
            Self::Bank(bank::Config::default().build().unwrap(), bank::State::new())
        }

        fn bearing_rad(&mut self, step: u64, place_ned_m: Horizontal, heard_rad: f32, sigma_rad: f32) -> f32 {
            match self {
                Self::Pursuit(pursuer, state) => {
                    pursuer.step(state, Instant(step * 100_000), place_ned_m, heard_rad, sigma_rad).unwrap()
                }
                Self::Bank(bank, state) => {
                    let direction_ned = Horizontal::from_bearing(heard_rad);
                    let sighting = Sighting { place_ned_m, direction_ned, sigma_rad, since_s: 0.1 };
                    bank.step(state, &sighting, 0.0, &[]).unwrap().estimate.bearing_ned_rad
                }
            }
        }
    }

    /// Flies towards a source at the origin; returns the length of the path over that of the straight line.
    fn fly(mut rule: Rule, seed: u64, outlier_rate: f32, sigma_rad: f32, worst_case: bool) -> f32 {
        let mut rng = Rng::new(seed, 1);
        let mut place = Horizontal { north: 30.0, east: -20.0 };
        let straight_m = place.norm();
        let mut k = 0_u64;
        loop {
            let truth = place.times(-1.0).bearing_rad();
            let away = if worst_case { truth + core::f32::consts::PI } else { TAU * rng.uniform() };
            let outlier = (rng.uniform() <= outlier_rate).then_some(away);
            let heard = wrap_pi(outlier.unwrap_or(truth + sigma_rad * rng.gaussian()));
            let bearing_rad = rule.bearing_rad(k, place, heard, sigma_rad);
            k += 1;
            place = place.plus(Horizontal::from_bearing(bearing_rad).times(0.1));
            if place.norm() < 1.0 || k > 5000 {
                return k as f32 * 0.1 / straight_m;
            }
        }
    }

    fn mean(rule: fn() -> Rule, outlier_rate: f32, sigma_rad: f32, worst_case: bool) -> f32 {
        (0..40).map(|seed| fly(rule(), seed, outlier_rate, sigma_rad, worst_case)).sum::<f32>() / 40.0
    }

    #[test]
    fn outliers_cost_little_even_the_worst_ones_and_at_the_very_start() {
        // The greedy rule needs 1.0, 1.8, 4.3 and 3.8.
        for (outlier_rate, sigma_rad, worst_case, most) in
            [(0.0, 0.1, false, 1.02), (0.4, 0.35, false, 1.1), (0.6, 1.0, false, 1.6), (0.35, 0.35, true, 1.35)]
        {
            let mean = mean(Rule::pursuit, outlier_rate, sigma_rad, worst_case);
            assert!(mean < most, "{outlier_rate} {sigma_rad} {worst_case}: {mean}");
        }
    }

    #[test]
    fn the_bank_that_flies_is_as_good_up_to_one_outlier_in_four_and_close_beyond() {
        for (outlier_rate, sigma_rad, most) in
            [(0.0, 0.1, 1.005), (0.25, 0.35, 1.02), (0.4, 0.35, 1.04), (0.6, 1.0, 1.4)]
        {
            let [bank, pursuit] = [Rule::bank, Rule::pursuit].map(|rule| mean(rule, outlier_rate, sigma_rad, false));
            assert!(bank < most * pursuit, "{outlier_rate} {sigma_rad}: {bank} {pursuit}");
        }
    }

    #[test]
    fn no_numbers_change_nothing() {
        let pursuer = Config::default().build().unwrap();
        let mut state = State::<4>::default();
        let before = state.clone();
        assert_eq!(pursuer.step(&mut state, Instant(0), Horizontal::default(), f32::NAN, 0.1), None);
        assert_eq!(state, before);
        assert!(core::mem::size_of::<State<4>>() <= 560);
    }
}
