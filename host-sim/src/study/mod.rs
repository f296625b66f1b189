//! Results of many flights or many frames: the papers' experiments, and campaigns that answer one question each.
//!
//! | module | the question |
//! |---|---|
//! | [`reproduce`] | what of the papers' results comes out here? |
//! | [`matrix`] | does every setting of sensor, bearings, vehicle and hull fly? |
//! | [`gusts`] | how many flights touch something in gusts? |
//! | [`landings`] | how many come down on the pad? |
//! | [`link_state`] | how often is the link state's classifier right, and how is it trained? |
//! | [`pad`] | what does the landing pad's detector find, and how are its weights trained? |
//! | [`flight`] | how does one flight end? |
//! | [`seeds`] | the ranges of seeds: those to tune on, those to publish |

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::scenario::input::InputError;

pub mod flight;
pub mod gusts;
pub mod landings;
pub mod link_state;
pub mod matrix;
pub mod pad;
pub mod reproduce;
pub mod seeds;

mod network;

/// Called with how much of a study is done.
pub type Watch<'a> = &'a (dyn Fn(u64) + Sync);

/// How much of a campaign is flown.
#[derive(Clone, Copy, Debug)]
pub struct Campaign {
    /// Flights of each scene.
    pub flights: u64,
    /// Whether on development seeds.
    pub is_development: bool,
    /// Called with what is flown next, or has been.
    pub tell: fn(&str),
}

/// Many flights or frames that answer one question: the result, and how it is made and shown.
pub trait Study: Serialize + Sized {
    /// What can be chosen.
    type Settings;

    /// Its name on the command line.
    const NAME: &'static str;
    /// What it shows, in a line.
    const TITLE: &'static str;
    /// Whose experiment it is.
    const SOURCE: &'static str = "";
    /// What its source leaves open, how that was read, and what does not come out as published.
    const NOTE: &'static str = "";

    /// Of the settings those by which the result changes.
    fn chosen(_: &Self::Settings) -> serde_json::Value {
        serde_json::Value::Null
    }

    /// Until where its progress counts; `None` where it does not say how far it is.
    fn length(_: &Self::Settings) -> Option<u64> {
        None
    }

    /// Runs it on all cores; the result does not depend on how many there are. `watch` is called with how much is done of
    /// [`Self::length`].
    ///
    /// # Errors
    /// The built-in configurations cause no error.
    fn run(settings: &Self::Settings, watch: Watch<'_>) -> Result<Self, InputError>;

    /// The table as text.
    fn table(&self) -> String;

    /// Draws its pictures and says which files these are.
    ///
    /// # Errors
    /// A file cannot be written.
    fn figures(&self, _: &Path) -> Result<Vec<PathBuf>, InputError> {
        Ok(Vec::new())
    }

    /// What was published, and what was measured here.
    fn verdict(&self) -> Vec<Beside> {
        Vec::new()
    }

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
