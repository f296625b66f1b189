//! Where the source may be: a few weighted places, for a planner that cannot reach the likeliest one.
//!
//! The filters' densities are wide in the range and narrow in the bearing, and normal in the inverse range. So each
//! filter gives the quantiles of its inverse range, each with the bearing that is expected at it.

use heapless::Vec;

use super::FILTERS;
use super::polar::Resting;
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::units::between;

/// Places of one filter: the middle of each sixteenth of the normal distribution.
const QUANTILES: [f32; 16] = [
    -1.862_732, -1.318_011, -1.009_99, -0.776_422, -0.579_132, -0.402_250, -0.237_202, -0.078_412, 0.078_412,
    0.237_202, 0.402_250, 0.579_132, 0.776_422, 1.009_99, 1.318_011, 1.862_732,
];
/// Places of all filters of the bank.
pub const PLACES_MAX: usize = FILTERS * QUANTILES.len();
/// Nearest and farthest range of a place.
const NEAR_M: f32 = 0.5;
const FAR_M: f32 = 60.0;

/// Weighted places; none before the first sighting.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Support {
    places: Vec<(Horizontal, f32), PLACES_MAX>,
    /// Weight of the places at `FAR_M`, which stand for any range beyond it.
    beyond: f32,
}

/// Mean and spread of the places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SourcePosition {
    /// Mean position.
    pub place_ned_m: Horizontal,
    /// Square root of the larger eigenvalue of the covariance; about 60 m where the source is that far away, or farther.
    pub sigma_m: f32,
}

impl Support {
    /// Removes all places.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Adds the places of a filter, which share a weight.
    pub fn add(&mut self, filter: &Resting, weight: f32) {
        let (variance, with_bearing) = (filter.covariance(1, 1), filter.covariance(0, 1));
        let (sigma, along) = (sqrt(variance), filter.direction_ned());
        let slope = if variance > 0.0 { with_bearing / variance } else { 0.0 };
        let across = Horizontal { north: -along.east, east: along.north };
        for quantile in QUANTILES {
            let off = quantile * sigma;
            let inverse_range = between(filter.inverse_range_per_m() + off, 1.0 / FAR_M, 1.0 / NEAR_M);
            if inverse_range <= 1.0 / FAR_M {
                self.beyond += weight / QUANTILES.len() as f32;
            }
            let towards = along.plus(across.times(slope * off));
            let place_ned_m = filter.place_ned_m().plus(towards.times(1.0 / inverse_range));
            // Cannot fail: there is space for every filter of the bank.
            let _ = self.places.push((place_ned_m, weight / QUANTILES.len() as f32));
        }
    }

    /// The places and their weights.
    #[must_use]
    pub fn places(&self) -> &[(Horizontal, f32)] {
        &self.places
    }

    /// Mean and spread; `None` without places.
    #[must_use]
    pub fn mean(&self) -> Option<SourcePosition> {
        if self.places.is_empty() {
            return None;
        }
        let (place_ned_m, [nn, ne, ee]) = moments(&self.places);
        let (half_sum, half_difference) = (0.5 * (nn + ee), 0.5 * (nn - ee));
        let largest = half_sum + sqrt(half_difference * half_difference + ne * ne);
        // Where most of the places are the farthest, their spread is small, and still nothing is known beyond them.
        let (spread_m, beyond_m) = (sqrt(largest), self.beyond * FAR_M);
        Some(SourcePosition { place_ned_m, sigma_m: if beyond_m > spread_m { beyond_m } else { spread_m } })
    }
}

/// Mean and covariance, north-north, north-east and east-east, of places whose weights sum to one.
fn moments(places: &[(Horizontal, f32)]) -> (Horizontal, [f32; 3]) {
    let mut mean = Horizontal::default();
    for (place, weight) in places {
        mean = mean.plus(place.times(*weight));
    }
    let (mut nn, mut ne, mut ee) = (0.0, 0.0, 0.0);
    for (place, weight) in places {
        let off = place.minus(mean);
        nn += weight * off.north * off.north;
        ne += weight * off.north * off.east;
        ee += weight * off.east * off.east;
    }
    (mean, [nn, ne, ee])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::base::units::sin_cos;
    use crate::localize::source::polar::{Config, State};
    use crate::localize::source::{Sighting, bank, polar};

    /// A filter after sightings of a source from places on a line to the east.
    fn filter(source: Horizontal, steps: u32) -> polar::Resting {
        let (filter, mut state) = (Config::DEFAULT.build().unwrap(), State::new());
        for k in 0..steps {
            let place_ned_m = Horizontal { north: 0.0, east: 0.1 * k as f32 };
            let to = source.minus(place_ned_m);
            let direction_ned = to.times(1.0 / to.norm());
            filter.step(&mut state, &Sighting { place_ned_m, direction_ned, sigma_rad: 0.01, since_s: 0.1 });
        }
        state
    }

    #[test]
    fn at_first_the_places_are_spread_along_the_bearing_and_then_close_round_the_source() {
        let source = Horizontal { north: 8.0, east: 1.0 };
        let mut spread_m = f32::INFINITY;
        for steps in [1, 10, 30, 60] {
            let mut support = Support::default();
            support.add(&filter(source, steps), 1.0);
            let mean = support.mean().unwrap();
            assert!(mean.sigma_m < spread_m, "{steps}: {mean:?}");
            spread_m = mean.sigma_m;
            assert!((support.places().iter().map(|(_, weight)| weight).sum::<f32>() - 1.0).abs() < 1e-5);
        }
        let mut support = Support::default();
        support.add(&filter(source, 60), 1.0);
        let mean = support.mean().unwrap();
        assert!(mean.place_ned_m.minus(source).norm() < 0.3 && mean.sigma_m < 0.5, "{mean:?}");
    }

    /// The places end at 60 m: of a source beyond, they lie in one point, and nobody may take it for a range that is known.
    #[test]
    fn a_source_beyond_the_farthest_place_has_no_range_that_is_known() {
        for range_m in [70.0, 150.0, 1000.0] {
            let mut support = Support::default();
            support.add(&filter(Horizontal { north: range_m, east: 5.0 }, 400), 1.0);
            let mean = support.mean().unwrap();
            assert!(mean.sigma_m > 0.5 * mean.place_ned_m.norm(), "{range_m}: {mean:?}");
        }
    }

    /// Against the filter's own covariance, where that is small enough to be linear.
    #[test]
    fn the_spread_is_that_of_the_filter() {
        let state = filter(Horizontal { north: 6.0, east: -2.0 }, 80);
        let [nn, ne, ee] = state.estimate().unwrap().covariance_m2;
        let mut support = Support::default();
        support.add(&state, 1.0);
        let (mean, expected) =
            (support.mean().unwrap(), sqrt(0.5 * (nn + ee) + sqrt(0.25 * (nn - ee) * (nn - ee) + ne * ne)));
        assert!((mean.sigma_m / expected - 1.0).abs() < 0.12, "{} {expected}", mean.sigma_m);
        assert_eq!(Support::default().mean(), None);
    }
    const SOURCE: Horizontal = Horizontal { north: 9.0, east: 2.0 };

    /// Straight on, with a detour of a metre and a half to the right.
    fn bent(s: f32) -> Horizontal {
        let off = if (1.0..5.0).contains(&s) { 1.5 * sin_cos((s - 1.0) * 0.785).0 } else { 0.0 };
        Horizontal { north: s, east: 0.2 * s - off }
    }

    /// What the bank tells at the end of a path flown at 1 m/s. A share of the bearings comes from anywhere.
    fn fly(seed: u64, sigma_rad: f32, path: impl Fn(f32) -> Horizontal, wrong: f32) -> SourcePosition {
        let (bank, mut state) = (bank::Config::DEFAULT.build().unwrap(), bank::State::new());
        let mut rng = Rng::new(seed, 99);
        for step in 0..60 {
            let place_ned_m = path(0.1 * step as f32);
            let mut bearing_rad = SOURCE.minus(place_ned_m).bearing_rad() + sigma_rad * rng.gaussian();
            if rng.uniform() < wrong {
                bearing_rad = core::f32::consts::TAU * rng.uniform();
            }
            let direction_ned = Horizontal::from_bearing(bearing_rad);
            bank.step(&mut state, &Sighting { place_ned_m, direction_ned, sigma_rad, since_s: 0.1 }, 0.0, &[]);
        }
        let mut support = Support::default();
        state.support(&mut support);
        support.mean().unwrap()
    }

    /// The limits are a tenth above what it is.
    #[test]
    fn after_a_detour_the_bank_knows_where_the_source_is_among_outliers_too() {
        for (sigma_deg, wrong, most_m) in
            [(0.5_f32, 0.0, 0.086), (1.86, 0.0, 0.33), (5.0, 0.0, 1.2), (1.72, 0.2, 0.74), (1.72, 0.4, 1.33)]
        {
            let errors = (0..60).map(|seed| fly(seed, sigma_deg.to_radians(), bent, wrong).place_ned_m.minus(SOURCE));
            let rms_m = sqrt(errors.map(Horizontal::norm_squared).sum::<f32>() / 60.0);
            assert!(rms_m < most_m, "{sigma_deg} {wrong}: {rms_m} m");
        }
    }

    #[test]
    fn on_a_straight_line_the_bank_does_not_claim_to_know_the_range() {
        for seed in 0..20 {
            let found = fly(seed, 0.03, |s| Horizontal { north: 0.5 * s, east: 0.111 * s }, 0.0);
            let error_m = found.place_ned_m.minus(SOURCE).norm();
            assert!(found.sigma_m > 2.0 && error_m < 3.0 * found.sigma_m, "seed {seed}: {error_m} m off, {found:?}");
        }
    }
}
