//! How the beacon's wave reaches the vehicle: directly, by one reflection, by several, or not at all.
//!
//! A bearing points at the beacon only when the strongest wave is the direct one. One observation cannot show that: a
//! wall that mirrors one strong wave makes as clean a plane wave as the beacon itself. But a wave that comes around
//! corners rarely comes alone. Where it is the strongest, others of nearly the same strength make its level vary from
//! place to place, bend the wavefront and shift the bearing. So the last [`WINDOW`] observations (called looks in the
//! code), taken [`SPACING_M`] apart, are summarised in [`FEATURES`] numbers (module `features`: level, fading, closure,
//! coherence, how well one source at rest explains the bearings, the wall ahead if a map contains one), and a small
//! neural network (module `network`) classifies them.
//!
//! The network was trained in the simulator on random buildings and yards: `foxhound link-state --train` makes
//! [`weights`] and `docs/results/link-state.md`, which shows how often it is right. Its probabilities assume that all
//! classes are equally frequent; the page has the numbers of the scenes.
//!
//! Limit: a single strong mirror image without other waves cannot be distinguished from the beacon, unless the map
//! contains the wall.
//!
//! Cost of an observation that is kept: bench row `link_state_step`.

use crate::base::ned::Horizontal;
use crate::doa::bearing::Bearing;
use crate::mapping::walls;

mod features;
mod network;
pub mod weights;

pub use features::{FEATURES, NAMES, SPACING_M, State, WINDOW};
pub use network::{CLASSES, HIDDEN, Weights};

/// How the strongest wave reaches the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum LinkState {
    /// Directly, possibly through a wall: the bearing points at the beacon.
    LineOfSight,
    /// By one reflection: the bearing points at the beacon's image.
    FirstOrder,
    /// By more than one reflection.
    HigherOrder,
    /// The wave is not above the noise. Also the value before there are [`LOOKS_MIN`] observations.
    #[default]
    None,
}

impl LinkState {
    /// All states, in the order of [`Estimate::probabilities`].
    pub const ALL: [Self; CLASSES] = [Self::LineOfSight, Self::FirstOrder, Self::HigherOrder, Self::None];
}

/// Smallest number of observations for a classification.
pub const LOOKS_MIN: u8 = 8;

/// What the map contains along the bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sightline {
    /// Nothing: there is no map.
    #[default]
    Unknown,
    /// The map has no wall there.
    Clear,
    /// The map has a wall there, at this range.
    Wall {
        /// Range along the bearing.
        range_m: f32,
    },
}

impl Sightline {
    /// The sightline of a bearing from a position among walls, each extended by `slack_m` at both ends.
    #[must_use]
    pub fn among(walls: &[walls::Wall], place_ned_m: Horizontal, bearing_ned_rad: f32, slack_m: f32) -> Self {
        let direction = Horizontal::from_bearing(bearing_ned_rad);
        let mut nearest = Self::Clear;
        for wall in walls {
            if let Some(range_m) = wall.range_along_m(place_ned_m, direction, slack_m) {
                nearest = match nearest {
                    Self::Wall { range_m: other } if other < range_m => nearest,
                    _ => Self::Wall { range_m },
                };
            }
        }
        nearest
    }
}

/// One observation: a bearing, valid or not, and the position where it was measured.
#[derive(Clone, Copy, Debug)]
pub struct Features<'a> {
    /// Where the antennas are.
    pub place_ned_m: Horizontal,
    /// The front end's result for the frame.
    pub bearing: &'a Bearing,
    /// Its direction, from north, clockwise; `None` when it may not be used.
    pub bearing_ned_rad: Option<f32>,
    /// What the map contains in that direction.
    pub sightline: Sightline,
}

/// The classifier's result for the last observations.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimate {
    /// The most probable state.
    pub state: LinkState,
    /// Probabilities of [`LinkState::ALL`]; their sum is one, and they are equal while nothing is known.
    pub probabilities: [f32; CLASSES],
}

impl Estimate {
    /// Nothing is known yet.
    pub const UNKNOWN: Self = Self { state: LinkState::None, probabilities: [0.25; CLASSES] };

    /// The probability that the bearing is that of one reflection and not of the beacon, if there are `prior` reflected
    /// links for each direct one; zero while nothing is known.
    #[must_use]
    pub fn reflected(&self, prior: f32) -> f32 {
        let [direct, first, ..] = self.probabilities;
        if self.state == LinkState::None { 0.0 } else { prior * first / (prior * first + direct + 1e-6) }
    }

    /// The probability that the bearing is that of one or more reflections.
    #[must_use]
    pub fn indirect(&self, prior: f32) -> f32 {
        let [direct, first, higher, _] = self.probabilities;
        let away = prior * (first + higher);
        if self.state == LinkState::None { 0.0 } else { away / (away + direct + 1e-6) }
    }
}

/// The classifier.
#[derive(Clone, Debug, PartialEq)]
pub struct Classifier {
    weights: Weights,
}

impl Classifier {
    /// The classifier with the weights of this release.
    pub const TRAINED: Self = Self::new(weights::WEIGHTS);

    /// A classifier with other weights.
    #[must_use]
    pub const fn new(weights: Weights) -> Self {
        Self { weights }
    }

    /// Processes an observation and returns the estimate. Observations closer together than [`SPACING_M`] are skipped,
    /// except five per second.
    pub fn step(&self, state: &mut State, look: &Features<'_>) -> Estimate {
        if state.take(look)
            && let Some(features) = state.features()
        {
            state.estimate = self.classify(&features);
        }
        state.estimate
    }

    /// Classifies the features.
    #[must_use]
    pub fn classify(&self, features: &[f32; FEATURES]) -> Estimate {
        let probabilities = self.weights.probabilities(features);
        let mut best = 0;
        for (class, p) in probabilities.iter().enumerate() {
            best = if *p > probabilities[best] { class } else { best };
        }
        Estimate { state: LinkState::ALL[best], probabilities }
    }
}

#[cfg(test)]
mod tests;
