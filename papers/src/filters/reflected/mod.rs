//! Filters behind reflections: the source is not where its signal comes from.
//!
//! - [`fold`]: lines of reflection as mirrors, of any order (eq. 9 of the mmWave paper). A sighting off lines that are known
//!   becomes a sighting of the source itself.
//! - [`Known`]: lines that are known, the default: [`polar`](foxhound_core::localize::source::polar) behind the mirrors.
//! - [`Unknown`]: a line that is not quite known, the default: the mirror image in modified polar coordinates, which is all
//!   that bearings tell, and the line by its angle and offset, which only a prior can tell.
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

/// Where a reflection has no geometry. The filter is as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Degenerate {
    /// The line runs along the paper's y axis: its slope is infinite. The literal filters cannot have it.
    Vertical,
    /// The vehicle is on the line, and the point of reflection where it is.
    OnLine,
    /// The ray runs along a line, or away from it: nothing comes from there.
    NoReflection,
    /// It is no line: its normal is no unit vector, or its offset none.
    NoLine,
    /// The filter has not begun.
    NotBegun,
}
