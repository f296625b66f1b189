//! Filters behind reflections: the source is not where its signal comes from.
//!
//! - [`fold`]: lines of reflection as mirrors, of any order (eq. 9 of the mmWave paper). A sighting off lines that are known
//!   becomes a sighting of the source itself.
//! - [`Known`]: known lines, the default: [`polar`](foxhound_core::localize::source::polar) behind the mirrors.
//! - [`Unknown`]: an uncertain line, the default: the mirror image in modified polar coordinates, which is all that
//!   bearings determine, and the line by its angle and offset, which only a prior determines.
//! - [`law`]: the law of reflection as the paper has it (eq. 4-7), and [`literal`] its two filters, the baselines.

use super::kalman;
use super::{Estimate, Sighting, Update};

pub mod fold;
pub mod known;
pub mod law;
pub mod literal;
pub mod unknown;

pub use known::Known;
pub use unknown::Unknown;

/// Degenerate geometry of a reflection. The filter is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Degenerate {
    /// The line runs along the paper's y axis: its slope is infinite. The literal filters cannot have it.
    Vertical,
    /// The vehicle is on the line, and the point of reflection where it is.
    OnLine,
    /// The ray runs along a line, or away from it: there is no reflection.
    NoReflection,
    /// Not a line: its normal is not a unit vector, or its offset is not finite.
    NoLine,
    /// The filter has not begun.
    NotBegun,
}
