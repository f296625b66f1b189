//! What the camera sees of the landing pad.

use crate::time::Instant;

/// Where the pad is in the body frame: a ray through its centre, as tangents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pad {
    /// Forward, metres per metre along body-down.
    pub forward: f32,
    /// To the right, metres per metre along body-down.
    pub right: f32,
    /// Tangent of the radius.
    pub radius: f32,
    /// How sure it is, 0..=1.
    pub confidence: f32,
    /// The image's border cuts it.
    pub is_cut: bool,
}

/// Why nothing was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nothing {
    /// Nothing of its colour.
    NoRegion,
    /// Not its shape.
    Shape,
    /// Not its size.
    Size,
    /// Not its colour.
    Colour,
}

/// What was wrong with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bad {
    /// Its size.
    Size,
    /// The length of a line.
    Line,
    /// The order of its lines.
    Order,
    /// It ended early.
    Cut,
    /// It is all one colour.
    Flat,
}

/// What a frame shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// The pad.
    Pad(Pad),
    /// No pad.
    Nothing(Nothing),
    /// It is no frame.
    Bad(Bad),
}

/// A frame that was looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// When it was exposed.
    pub time: Instant,
    /// What it shows.
    pub seen: Seen,
}
