//! What a frame of the camera shows of the pad: the detector says it, the landing takes it, the log keeps it.
//!
//! Tangents are those of the body: who looks knows nothing of how the vehicle leans.

use crate::base::math::sqrt;
use crate::base::time::Instant;

/// Where the pad is in the body frame: a ray through its centre, as tangents.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pad {
    /// Metres forward a metre along body-down.
    pub forward: f32,
    /// Metres to the right a metre along body-down.
    pub right: f32,
    /// The radius, in the same measure.
    pub radius: f32,
    /// 0 to 1.
    pub confidence: f32,
    /// Whether the picture's border cuts it.
    pub is_cut: bool,
}

impl Pad {
    /// The same pad with its centre as the disc's own, not its ellipse's. `up` is where up is, as the tangents of the vertical in the
    /// body frame: nose down by 10 degrees and level, it is `[-0.176, 0.0]`.
    ///
    /// Along the slope the disc's near half looks longer: with the depth `1 + v s` at `s` radii, the middle of both ends
    /// is off by `radius^2 v (slope - centre v)`.
    #[must_use]
    pub fn straightened(self, up: [f32; 2]) -> Self {
        let square = up[0] * up[0] + up[1] * up[1];
        if !(square > 1e-6 && square < 4.0) {
            return self;
        }
        let tangent = sqrt(square);
        let cosine = 1.0 / sqrt(1.0 + square);
        let sine = tangent * cosine;
        let along = [up[0] / tangent, up[1] / tangent];
        // The direction on the ground that leads away from the camera in depth.
        let v = sine;
        let centre = self.forward * along[0] + self.right * along[1];
        let part = self.radius * self.radius * v / (1.0 - self.radius * self.radius * v * v);
        let across = [self.forward - centre * along[0], self.right - centre * along[1]];
        let shift = part * (cosine - centre * v);
        let side = -part * v;
        Self {
            forward: self.forward + shift * along[0] + side * across[0],
            right: self.right + shift * along[1] + side * across[1],
            ..self
        }
    }
}

/// Why there is no pad: how far the region went that came closest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Nothing {
    /// Nothing red in the frame, or not enough of it.
    NoRegion,
    /// No region with the edge of a disc.
    Shape,
    /// Too little of the disc is there, or there is a round hole in it.
    Hidden,
    /// No step of colour at its edge: a glow.
    Colour,
    /// A disc, but not of the size that the pad has from here.
    Size,
}

/// What was wrong with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Bad {
    /// Too small or too large.
    Size,
    /// A line with too few or too many bytes.
    Line,
    /// A line twice, left out, or before its turn.
    Order,
    /// The last lines did not come.
    Cut,
    /// All of it has one colour.
    Flat,
    /// A line or the end of a frame that has not begun.
    NotBegun,
    /// It is too old when it comes.
    Age,
}

/// What was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Seen {
    /// The pad.
    Pad(Pad),
    /// A good frame without a pad.
    Nothing(Nothing),
    /// No good frame.
    Bad(Bad),
}

/// What a frame came to.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PadObservation {
    /// When the frame was exposed.
    pub time: Instant,
    /// What it shows.
    pub seen: Seen,
}
