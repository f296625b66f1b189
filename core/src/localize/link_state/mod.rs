//! How the beacon's wave reaches us: straight on, by one reflection, by several, or not at all.
//!
//! A bearing points at the beacon only when the strongest wave is the direct one. One look does not tell: a wall that
//! mirrors one strong wave makes as clean a plane wave as the beacon itself. But a wave that has been around corners seldom
//! comes alone. Where it is the strongest, others of nearly its strength fade it from place to place, bend the wavefront and
//! make the bearing wander. So some [`WINDOW`] looks, [`SPACING_M`] apart, are summed up in [`FEATURES`] numbers (module
//! `features`: level, fading, closure, coherence, how well one source at rest explains the bearings, the wall ahead if a map
//! knows one), and a small neural network (module `network`) weighs them.
//!
//! The network was trained in the simulator on random buildings and yards: `foxhound link-state --train` makes
//! [`weights`] and `docs/results/link-state.md`, which says how often it is right, and what each feature is worth. Its probabilities
//! are those of classes that are equally frequent; `docs/results/link-state.md` has the numbers of the scenes.
//!
//! What cannot be told from here: a lone strong mirror image, far from other waves, from the beacon, unless the map knows the
//! wall.
//!
//! Instructions on a Cortex-M4F: 4 850 for a look that is kept, 1 030 of them the network; 130 for one that is left out.

use crate::base::ned::Horizontal;
use crate::doa::bearing::Bearing;
use crate::mapping::walls;

mod features;
mod network;
pub mod weights;

pub use features::{FEATURES, NAMES, SPACING_M, State, WINDOW};
pub use network::{CLASSES, HIDDEN, Weights};

/// How the strongest wave gets here.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum LinkState {
    /// Straight on, perhaps through a wall: the bearing points at the beacon.
    LineOfSight,
    /// By one reflection: the bearing points at the beacon's image.
    FirstOrder,
    /// By more than one.
    HigherOrder,
    /// Not above the noise. Also before there are [`LOOKS_MIN`] looks.
    #[default]
    None,
}

impl LinkState {
    /// All, in the order of [`Estimate::probabilities`].
    pub const ALL: [Self; CLASSES] = [Self::LineOfSight, Self::FirstOrder, Self::HigherOrder, Self::None];
}

/// Fewer looks say nothing.
pub const LOOKS_MIN: u8 = 8;

/// What is known about the path along the bearing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sightline {
    /// Nothing: there is no map.
    #[default]
    Unknown,
    /// The map has no wall there.
    Clear,
    /// It has one, at this range.
    Wall {
        /// Along the bearing.
        range_m: f32,
    },
}

impl Sightline {
    /// What some walls, each widened by `slack_m` at both ends, are to a bearing from a place.
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

/// A bearing, heard or not, and from where.
#[derive(Clone, Copy, Debug)]
pub struct Features<'a> {
    /// Where the antennas are.
    pub place_ned_m: Horizontal,
    /// What the front end made of the frame.
    pub bearing: &'a Bearing,
    /// Where that points, from north, clockwise; `None` when it may not be used.
    pub bearing_ned_rad: Option<f32>,
    /// What lies there.
    pub sightline: Sightline,
}

/// What the classifier makes of the last looks.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimate {
    /// The most probable.
    pub state: LinkState,
    /// Of [`LinkState::ALL`]; they add up to one, and are equal while nothing is known.
    pub probabilities: [f32; CLASSES],
}

impl Estimate {
    /// Nothing is known yet.
    pub const UNKNOWN: Self = Self { state: LinkState::None, probabilities: [0.25; CLASSES] };

    /// The probability that the bearing is that of one reflection and not of the beacon, where there are `prior` reflected
    /// links for each direct one; none while nothing is known.
    #[must_use]
    pub fn reflected(&self, prior: f32) -> f32 {
        let [direct, first, ..] = self.probabilities;
        if self.state == LinkState::None { 0.0 } else { prior * first / (prior * first + direct + 1e-6) }
    }
}

/// The classifier.
#[derive(Clone, Debug, PartialEq)]
pub struct Classifier {
    weights: Weights,
}

impl Classifier {
    /// With the weights of this release.
    pub const TRAINED: Self = Self::new(weights::WEIGHTS);

    /// With other weights.
    #[must_use]
    pub const fn new(weights: Weights) -> Self {
        Self { weights }
    }

    /// Takes in a look and says what the looks so far tell. Looks closer together than [`SPACING_M`] are left out, but for
    /// five a second.
    pub fn step(&self, state: &mut State, look: &Features<'_>) -> Estimate {
        if state.take(look)
            && let Some(features) = state.features()
        {
            state.estimate = self.classify(&features);
        }
        state.estimate
    }

    /// What the features tell.
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
