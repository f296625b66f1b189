//! `localize`: what the mmWave paper shows of its filters and planner on simple maps (its section V-A and V-B), K. Pfeiffer
//! et al., "Path Planning Under Uncertainty to Localize mmWave Sources".
//!
//! - [`filters`]: how well filters localize, in line of sight and behind walls (fig. 2 and 3).
//! - [`paths`]: paths on which bearings tell more, among three obstacles (fig. 4 and Table 2).
//! - [`leg`]: how well the range is known after half a leg, flown straight and as planned.

pub mod filters;
pub mod leg;
pub mod paths;

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::scenario::input::InputError;

/// Runs of the leg.
const LEG_RUNS: u32 = 500;

/// All of it.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Filters.
    pub filters: filters::Report,
    /// Paths.
    pub paths: paths::Report,
    /// Legs.
    pub leg: leg::Report,
}

/// Runs all of it.
///
/// # Errors
/// A built-in configuration is refused.
pub fn run(seed: u64) -> Result<Report, InputError> {
    Ok(Report { filters: filters::run(seed)?, paths: paths::run(), leg: leg::run(seed, LEG_RUNS) })
}

impl Report {
    /// The tables for people.
    #[must_use]
    pub fn table(&self) -> String {
        [self.filters.table(), self.paths.table(), self.leg.table()].join("\n")
    }

    /// Draws the pictures; says which files these are.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn draw(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let filters = folder.join("localize.svg");
        self.filters.draw(&filters)?;
        let mut files = vec![filters];
        files.extend(self.paths.draw(folder)?);
        Ok(files)
    }
}
