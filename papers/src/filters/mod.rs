//! The mmWave paper's filters for bearings: as printed, and for a reflection off one wall.
//!
//! The filters that fly are in [`foxhound_core::localize::source`]: modified polar coordinates, and a bank of them.
//!
//! - [`cartesian`] and [`reflected::literal`]: the paper's filters, as printed.
//! - [`reflected`]: the polar filter behind known walls, one or several.

use foxhound_core::localize::source::{Estimate, Sighting, Update};

mod kalman;

pub mod cartesian;
pub mod reflected;
