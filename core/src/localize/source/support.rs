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
}

/// Mean and spread of the places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SourcePosition {
    /// Mean position.
    pub place_ned_m: Horizontal,
    /// Square root of the larger eigenvalue of the covariance.
    pub sigma_m: f32,
}

impl Support {
    /// Removes all places.
    pub fn clear(&mut self) {
        self.places.clear();
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
        (!self.places.is_empty()).then(|| SourcePosition::of(self.places.iter().copied()))
    }
}

impl SourcePosition {
    /// Of places whose weights sum to one.
    pub(super) fn of(places: impl Iterator<Item = (Horizontal, f32)> + Clone) -> Self {
        let (place_ned_m, [nn, ne, ee]) = moments(places);
        let (half_sum, half_difference) = (0.5 * (nn + ee), 0.5 * (nn - ee));
        let largest = half_sum + sqrt(half_difference * half_difference + ne * ne);
        Self { place_ned_m, sigma_m: sqrt(largest) }
    }
}

/// Mean and covariance, north-north, north-east and east-east, of places whose weights sum to one.
pub(super) fn moments(places: impl Iterator<Item = (Horizontal, f32)> + Clone) -> (Horizontal, [f32; 3]) {
    let mut mean = Horizontal::default();
    for (place, weight) in places.clone() {
        mean = mean.plus(place.times(weight));
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
    use crate::localize::source::polar::{Config, State};
    use crate::localize::source::{Sighting, polar};

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
}
