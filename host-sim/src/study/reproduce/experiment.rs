//! The experiments by name, and one function to run any of them.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::settings::Settings;
use super::{circle, crb, density, localize, mmwave, multipath, stretch, variants};
use crate::scenario::input::InputError;

/// Called with how much of an experiment is done.
pub type Watch<'a> = &'a (dyn Fn(u64) + Sync);

/// The result of an experiment, and how it is made and shown.
pub trait Study: Serialize + Sized {
    /// Its name on the command line.
    const NAME: &'static str;
    /// What it shows, in a line.
    const TITLE: &'static str;
    /// Whose experiment it is.
    const SOURCE: &'static str;
    /// What its source leaves open, how that was read, and what does not come out as published.
    const NOTE: &'static str;

    /// Of the settings those by which the result changes.
    fn chosen(settings: &Settings) -> Value;

    /// Until where its progress counts; `None` where it does not say how far it is.
    fn length(_: &Settings) -> Option<u64> {
        None
    }

    /// Runs it on all cores; the result does not depend on how many there are. `watch` is called with how much is done of
    /// [`Self::length`].
    ///
    /// # Errors
    /// The built-in configurations cause no error.
    fn run(settings: &Settings, watch: Watch<'_>) -> Result<Self, InputError>;

    /// The table as text.
    fn table(&self) -> String;

    /// Draws its pictures and says which files these are.
    ///
    /// # Errors
    /// A file cannot be written.
    fn figures(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError>;

    /// What was published, and what was measured here.
    fn verdict(&self) -> Vec<Beside>;

    /// Verdict for each figure of its paper.
    fn judgements(&self) -> Vec<Judgement> {
        Vec::new()
    }
}

/// Verdict on a published figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The published method gives the published result here.
    Reproduced,
    /// The published result does not come out here, and Foxhound's is at least as good.
    Better,
    /// The published result does not come out here.
    NotReproduced,
}

impl Verdict {
    /// The one that holds.
    #[must_use]
    pub const fn of(is_reproduced: bool, is_better: bool) -> Self {
        match (is_reproduced, is_better) {
            (true, _) => Self::Reproduced,
            (false, true) => Self::Better,
            (false, false) => Self::NotReproduced,
        }
    }

    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::Better => "better",
            Self::NotReproduced => "not reproduced",
        }
    }
}

/// A figure or a table of a paper, and its verdict.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Judgement {
    /// The experiment.
    pub experiment: String,
    /// The paper, and the figure.
    pub figure: String,
    /// Its verdict.
    pub verdict: Verdict,
    /// The reason, in a sentence.
    pub why: String,
}

/// A number that was published, beside ours. What there is not is empty.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Beside {
    /// The experiment.
    pub experiment: String,
    /// What is measured.
    pub what: String,
    /// What was published.
    pub published: String,
    /// The published method, run here.
    pub theirs: String,
    /// Foxhound.
    pub ours: String,
}

/// What an experiment gives.
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

    const fn of<S: Study>() -> Self {
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

fn outcome<S: Study>(settings: &Settings, folder: Option<&Path>, watch: Watch<'_>) -> Result<Outcome, InputError> {
    let report = S::run(settings, watch)?;
    let json = serde_json::to_string(&report).map_err(|error| InputError::new(error.to_string()))? + "\n";
    let pictures = folder.map_or(Ok(Vec::new()), |folder| report.figures(folder))?;
    Ok(Outcome { json, table: report.table(), beside: report.verdict(), judgements: report.judgements(), pictures })
}
