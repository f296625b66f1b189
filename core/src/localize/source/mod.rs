//! Where the source is: filters that process the bearings.
//!
//! - [`polar`], the default: bearing, inverse range and, for a source that moves, its velocity over the range. A
//!   bearing contains no range; the filter keeps the range uncertain until the vehicle's motion determines it.
//! - [`bank`]: several such filters, for a source whose signal may be reflected by a wall.
//! - [`near`]: the last metres, in Cartesian coordinates.
//! - [`support`]: the places where the source may be, for the planner.
//! - [`covariance`]: keeps a filter's covariance positive definite.
//!
//! The mmWave paper's filters, as printed and repaired, are in the crate `foxhound-papers`.

use crate::base::math::sqrt;
use crate::base::ned::Horizontal;

mod series;

pub mod bank;
pub mod covariance;
pub mod gather;
pub mod near;
pub mod polar;
pub mod support;

/// Largest number of filters of the [`bank`].
pub const FILTERS: usize = 4;

/// A bearing as input of the filters, with the position where it was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sighting {
    /// Where it was measured.
    pub place_ned_m: Horizontal,
    /// Unit vector towards the source.
    pub direction_ned: Horizontal,
    /// Standard deviation of the direction.
    pub sigma_rad: f32,
    /// Time since the sighting before.
    pub since_s: f32,
}

impl Sighting {
    /// Whether a filter can use it.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        let norm2 = self.direction_ned.norm_squared();
        self.place_ned_m.norm_squared() < 1e12
            && norm2 > 0.5
            && norm2 < 2.0
            && self.sigma_rad >= 0.0
            && self.sigma_rad < 10.0
            && self.since_s >= 0.0
            && self.since_s < 1e6
    }
}

/// A filter's estimate of the source.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimate {
    /// Its position.
    pub place_ned_m: Horizontal,
    /// Its velocity; zero from filters that assume a source at rest.
    pub velocity_ned_mps: Horizontal,
    /// Covariance of the position: north-north, north-east, east-east.
    pub covariance_m2: [f32; 3],
    /// Its bearing from the vehicle, from north, clockwise.
    pub bearing_ned_rad: f32,
    /// Standard deviation of that.
    pub bearing_sigma_rad: f32,
    /// Its range from the vehicle.
    pub range_m: f32,
    /// Standard deviation of the range over the range.
    pub range_sigma_ratio: f32,
}

impl Estimate {
    /// Its bearing from a place, clockwise from north, and the standard deviation; `None` if the two cannot be
    /// distinguished.
    #[must_use]
    pub fn bearing_from(&self, place_ned_m: Horizontal) -> Option<(f32, f32)> {
        let towards = self.place_ned_m.minus(place_ned_m);
        let squared = towards.norm_squared();
        let [north, both, east] = self.covariance_m2;
        // Across the line of sight, times the range.
        let across = towards.east * towards.east * north - 2.0 * towards.east * towards.north * both
            + towards.north * towards.north * east;
        let sigma_rad = sqrt(if across > 0.0 { across } else { 0.0 }) / squared;
        (sigma_rad < 1.0).then(|| (towards.bearing_rad(), sigma_rad))
    }

    /// The same with as much more uncertainty as the innovations are larger than their own covariance, by their mean
    /// normalised square; never with less (the scale factor of R. T. Birge, Phys. Rev. 40 (1932) 207).
    #[must_use]
    pub(super) fn scaled(&self, nis: f32) -> Self {
        let variance = if nis > 1.0 { nis } else { 1.0 };
        let sigma = sqrt(variance);
        Self {
            covariance_m2: self.covariance_m2.map(|entry| entry * variance),
            bearing_sigma_rad: self.bearing_sigma_rad * sigma,
            range_sigma_ratio: self.range_sigma_ratio * sigma,
            ..*self
        }
    }
}

/// The result of a filter's update with a sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Update {
    /// It was the first: the filter has started or restarted.
    Started,
    /// The state was updated with it.
    Fused {
        /// Normalised innovation squared: one on average, when the filter is consistent.
        nis: f32,
        /// Probability that it is not an outlier.
        weight: f32,
        /// Its density under the filter, outliers included, 1/rad.
        likelihood: f32,
    },
    /// The sighting is invalid: not finite, or implausible. The state is unchanged.
    Refused,
    /// The vehicle is at the source, where its bearing is meaningless; the filter restarts with the next sighting.
    Overhead,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_estimate_is_as_much_less_certain_as_its_innovations_are_too_large() {
        let estimate = Estimate {
            covariance_m2: [1.0, 0.5, 2.0],
            bearing_sigma_rad: 0.1,
            range_m: 5.0,
            range_sigma_ratio: 0.2,
            ..Estimate::default()
        };
        let scaled = estimate.scaled(4.0);
        assert_eq!(scaled.covariance_m2, [4.0, 2.0, 8.0]);
        assert_eq!([scaled.bearing_sigma_rad, scaled.range_sigma_ratio, scaled.range_m], [0.2, 0.4, 5.0]);
        // Small innovations, and what is none, make it no more certain.
        for nis in [1.0, 0.2, 0.0, -1.0, f32::NAN] {
            assert_eq!(estimate.scaled(nis), estimate);
        }
    }
}
