//! The pad in a frame of the camera: made by the detector, used by the landing, stored in the log.
//!
//! Tangents are in the body frame: the detector does not know the vehicle's attitude.

use crate::base::math::sqrt;
use crate::base::time::Instant;

/// The pad's position in the body frame: a ray through its centre, as tangents.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pad {
    /// Metres forward per metre of body-down.
    pub forward: f32,
    /// Metres to the right per metre of body-down.
    pub right: f32,
    /// The radius, in the same unit.
    pub radius: f32,
    /// 0 to 1.
    pub confidence: f32,
    /// Whether the picture's border cuts it.
    pub is_cut: bool,
}

impl Pad {
    /// The same pad with the centre of the disc instead of that of its ellipse. `up` is the vertical as tangents in
    /// the body frame: nose down by 10 degrees and roll level, it is `[-0.176, 0.0]`.
    ///
    /// Along the slope the disc's near half looks longer: with the depth `1 + v s` at `s` radii, the middle of both
    /// ends is off by `radius^2 v (slope - centre v)`.
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
        // The direction on the ground along which the distance from the camera grows.
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

/// Why there is no pad: the last check that a region failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Nothing {
    /// No red region in the frame, or too small.
    NoRegion,
    /// No region with the edge of a disc.
    Shape,
    /// Too little of the disc is visible, or there is a round hole in it.
    Hidden,
    /// No step of colour at its edge: a glow.
    Colour,
    /// A disc, but not of the pad's expected size.
    Size,
}

/// Errors of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Bad {
    /// Too small or too large.
    Size,
    /// A line with too few or too many bytes.
    Line,
    /// A line twice, missing, or too early.
    Order,
    /// The last lines are missing.
    Cut,
    /// The whole frame has one colour.
    Flat,
    /// A line or an end without a begin.
    NotBegun,
    /// It is too old on arrival.
    Age,
}

/// The result of a detection.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Seen {
    /// The pad.
    Pad(Pad),
    /// A good frame without a pad.
    Nothing(Nothing),
    /// A bad frame.
    Bad(Bad),
}

/// The detector's result for a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PadObservation {
    /// When the frame was exposed.
    pub time: Instant,
    /// The result.
    pub seen: Seen,
}
