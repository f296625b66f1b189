//! The filters of the mmWave paper behind the bearing: as printed, and for a reflection off one wall.
//!
//! What flies is [`foxhound_core::localize::source`]: the filter in modified polar coordinates and the bank of them.
//!
//! - [`cartesian`] and [`reflected::literal`]: the paper's filters, as printed.
//! - [`reflected`]: the polar filter behind walls, known or not quite, one or several.
//! - [`consistency`]: whether a filter errs as much as it says.

use foxhound_core::localize::source::{Estimate, Sighting, Update};

mod kalman;

pub mod cartesian;
pub mod consistency;
pub mod reflected;
