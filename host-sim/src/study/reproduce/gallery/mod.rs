//! Every experiment into one folder, with a page that shows them: `foxhound reproduce all`.
//!
//! ```text
//!  DIR/index.html            what was published beside ours, tables and figures; opens from disk, asks no network
//!  DIR/NAME/report.json      what `foxhound reproduce NAME --json` prints
//!  DIR/NAME/table.txt        the same as text
//!  DIR/NAME/*.svg            its figures
//!  DIR/NAME/made.json        what it was made with, written last: with a list of the files
//! ```
//!
//! An experiment whose list is there, with all files on it, and was made by this very program with these settings, is not run
//! again: a run that was ended goes on where it was.

use std::fs;
use std::hash::{DefaultHasher, Hasher as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::{Experiment, Settings};
use crate::scenario::input::InputError;
use crate::scenario::output;
use crate::study::reproduce::{Beside, Judgement};

mod page;

const REPORT: &str = "report.json";
const TABLE: &str = "table.txt";
const MADE: &str = "made.json";
const INDEX: &str = "index.html";

/// What an experiment was made with, and its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Made {
    program: String,
    settings: serde_json::Value,
    seconds: f64,
    beside: Vec<Beside>,
    judgements: Vec<Judgement>,
    files: Vec<String>,
}

/// An experiment in the folder.
#[derive(Clone, Debug, Serialize)]
pub struct Shown {
    /// Its name.
    pub experiment: &'static str,
    /// How long it took when it was made.
    pub seconds: f64,
    /// Whether it was there already.
    pub kept: bool,
    /// Its files.
    pub files: Vec<PathBuf>,
    #[serde(skip)]
    made: Made,
    #[serde(skip)]
    table: String,
}

/// A folder of experiments.
#[derive(Debug)]
pub struct Gallery {
    folder: PathBuf,
    settings: Settings,
    program: String,
    shown: Vec<Shown>,
}

/// What the folder holds in the end.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// The page.
    pub index: PathBuf,
    /// How long all experiments took when they were made.
    pub seconds: f64,
    /// One by one.
    pub experiments: Vec<Shown>,
    /// What was published, beside ours.
    pub beside: Vec<Beside>,
    /// Verdict for each figure.
    pub judgements: Vec<Judgement>,
}

impl Gallery {
    /// Opens a folder, which need not be there.
    ///
    /// # Errors
    /// The program cannot read itself, by which it knows its own work.
    pub fn open(folder: &Path, settings: Settings) -> Result<Self, InputError> {
        let unreadable = |error: std::io::Error| InputError::new(format!("the program cannot read itself: {error}"));
        let program = fs::read(std::env::current_exe().map_err(unreadable)?).map_err(unreadable)?;
        let mut hasher = DefaultHasher::new();
        hasher.write(&program);
        let program = format!("{} {:016x}", env!("CARGO_PKG_VERSION"), hasher.finish());
        Ok(Self { folder: folder.to_owned(), settings, program, shown: Vec::new() })
    }

    /// Whether an experiment is in the folder and whole; then it is shown as it is.
    pub fn keep(&mut self, experiment: Experiment) -> bool {
        let Some((made, table)) = self.whole(experiment) else { return false };
        self.show(experiment, made, table, true);
        true
    }

    /// Runs an experiment and writes its files; `watch` is called with how far it is.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn make(&mut self, experiment: Experiment, watch: impl Fn(u64) + Sync) -> Result<(), InputError> {
        let folder = self.folder.join(experiment.name);
        // What is there is of another program or another setting, or is not whole.
        if folder.is_dir() {
            let list = folder.join(MADE);
            fs::remove_file(&list).or_else(|error| match error.kind() {
                std::io::ErrorKind::NotFound => Ok(()),
                _ => Err(InputError::new(error.to_string()).in_file(&list)),
            })?;
        }
        let begin = Instant::now();
        let outcome = experiment.run(&self.settings, Some(&folder), watch)?;
        let seconds = begin.elapsed().as_secs_f64();
        write(&folder.join(REPORT), &outcome.json)?;
        write(&folder.join(TABLE), &outcome.table)?;
        let pictures = outcome.pictures.iter().filter_map(|path| path.file_name()?.to_str());
        let files = [REPORT, TABLE].into_iter().chain(pictures).map(str::to_owned).collect();
        let made = Made {
            program: self.program.clone(),
            settings: (experiment.chosen)(&self.settings),
            seconds,
            beside: outcome.beside,
            judgements: outcome.judgements,
            files,
        };
        let list = serde_json::to_string(&made).map_err(|error| InputError::new(error.to_string()))?;
        write(&folder.join(MADE), &(list + "\n"))?;
        self.show(experiment, made, outcome.table, false);
        Ok(())
    }

    /// What is in the folder so far.
    #[must_use]
    pub fn shown(&self) -> &[Shown] {
        &self.shown
    }

    /// Writes the page of what is in the folder so far. `command` is what it says it was made by.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write_page(&self, command: &str) -> Result<(), InputError> {
        write(&self.folder.join(INDEX), &page::page(&self.shown, &self.settings, command))
    }

    /// What the folder holds in the end.
    #[must_use]
    pub fn summary(self) -> Summary {
        let beside = self.shown.iter().flat_map(|shown| shown.made.beside.clone()).collect();
        let judgements = self.shown.iter().flat_map(|shown| shown.made.judgements.clone()).collect();
        let seconds = self.shown.iter().map(|shown| shown.seconds).sum();
        Summary { index: self.folder.join(INDEX), seconds, experiments: self.shown, beside, judgements }
    }

    fn show(&mut self, experiment: Experiment, made: Made, table: String, kept: bool) {
        let folder = self.folder.join(experiment.name);
        let files = made.files.iter().map(|name| folder.join(name)).collect();
        let seconds = made.seconds;
        self.shown.push(Shown { experiment: experiment.name, seconds, kept, files, made, table });
    }

    fn whole(&self, experiment: Experiment) -> Option<(Made, String)> {
        let folder = self.folder.join(experiment.name);
        let made: Made = serde_json::from_str(&fs::read_to_string(folder.join(MADE)).ok()?).ok()?;
        let is_ours = made.program == self.program && made.settings == (experiment.chosen)(&self.settings);
        let is_whole = made.files.iter().all(|name| folder.join(name).is_file());
        let table = fs::read_to_string(folder.join(TABLE)).ok()?;
        (is_ours && is_whole).then_some((made, table))
    }
}

fn write(path: &Path, text: &str) -> Result<(), InputError> {
    output::write(path, text.as_bytes())
}
