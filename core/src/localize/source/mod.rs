//! Where the source is: filters behind the bearing.
//!
//! - [`polar`], the default: bearing, inverse range and, for a source that moves, its velocity over the range. A bearing says
//!   nothing about range, and this filter says so for as long as that is true.
//! - [`bank`]: several of them, for a source that may be seen by way of a wall.
//! - [`covariance`]: what keeps a filter's covariance positive definite.
//!
//! The mmWave paper's filters, as printed and repaired, are in the crate `foxhound-papers`.

use crate::base::ned::Horizontal;

mod series;

pub mod bank;
pub mod covariance;
pub mod gather;
pub mod polar;

/// A bearing as the filters take it in, from a place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sighting {
    /// From where.
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

/// What a filter believes of the source.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimate {
    /// Where it is.
    pub place_ned_m: Horizontal,
    /// How it moves; zero from filters that hold it to be at rest.
    pub velocity_ned_mps: Horizontal,
    /// Covariance of the place: north-north, north-east, east-east.
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

/// What a filter made of a sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Update {
    /// It was the first: the filter has started, or started over.
    Started,
    /// It was weighed.
    Fused {
        /// Normalised innovation squared: one on average, when the filter is consistent.
        nis: f32,
        /// Probability that it is no outlier.
        weight: f32,
        /// Its density under the filter, outliers included, 1/rad.
        likelihood: f32,
    },
    /// It is no sighting: not finite, or absurd. Nothing has changed.
    Refused,
    /// The vehicle is at the source, whose bearing means nothing there; the filter starts over with the next sighting.
    Overhead,
}
