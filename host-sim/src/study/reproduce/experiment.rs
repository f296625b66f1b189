//! The experiments by name, and one function to run any of them.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::settings::Settings;
use super::{circle, crb, density, localize, mmwave, multipath, stretch, variants};
use crate::scenario::input::InputError;
use crate::study::{Beside, Judgement, Study, Watch};

/// The result of an experiment.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// A line of JSON.
    pub json: String,
    /// The table as text.
    pub table: String,
    /// What was published, and what was measured here.
    pub beside: Vec<Beside>,
    /// Verdict for each figure.
    pub judgements: Vec<Judgement>,
    /// The pictures that were drawn.
    pub pictures: Vec<PathBuf>,
}

/// An experiment: a [`Study`] whatever its result is.
#[derive(Clone, Copy, Debug)]
pub struct Experiment {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it shows, in a line.
    pub title: &'static str,
    /// Whose experiment it is.
    pub source: &'static str,
    /// What the paper leaves open, how it was read, and what does not come out as published.
    pub note: &'static str,
    /// Of the settings those by which it changes.
    pub chosen: fn(&Settings) -> Value,
    /// Until where its progress counts; `None` where it does not say how far it is.
    pub length: fn(&Settings) -> Option<u64>,
    run: fn(&Settings, Option<&Path>, Watch<'_>) -> Result<Outcome, InputError>,
}

impl Experiment {
    /// All of them, in the order in which the papers build on one another.
    pub const ALL: [Self; 8] = [
        Self::of::<circle::Report>(),
        Self::of::<crb::Report>(),
        Self::of::<density::Report>(),
        Self::of::<variants::Report>(),
        Self::of::<multipath::Report>(),
        Self::of::<localize::Report>(),
        Self::of::<mmwave::Report>(),
        Self::of::<stretch::Report>(),
    ];

    const fn of<S: Study<Settings = Settings>>() -> Self {
        Self {
            name: S::NAME,
            title: S::TITLE,
            source: S::SOURCE,
            note: S::NOTE,
            chosen: S::chosen,
            length: S::length,
            run: outcome::<S>,
        }
    }

    /// The one of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|experiment| experiment.name == name)
    }

    /// Runs it on all cores and draws its pictures, if there is a folder; `watch` is called when one more of [`Self::length`]
    /// is done, or several.
    ///
    /// # Errors
    /// A picture cannot be written. The built-in configurations cause no error.
    pub fn run(
        &self,
        settings: &Settings,
        folder: Option<&Path>,
        watch: impl Fn(u64) + Sync,
    ) -> Result<Outcome, InputError> {
        (self.run)(settings, folder, &watch)
    }
}

fn outcome<S: Study>(settings: &S::Settings, folder: Option<&Path>, watch: Watch<'_>) -> Result<Outcome, InputError> {
    let report = S::run(settings, watch)?;
    let json = serde_json::to_string(&report).map_err(|error| InputError::new(error.to_string()))? + "\n";
    let pictures = folder.map_or(Ok(Vec::new()), |folder| report.figures(folder))?;
    Ok(Outcome { json, table: report.table(), beside: report.verdict(), judgements: report.judgements(), pictures })
}
