//! The experiments by name, and one way to run any of them.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::beside::Beside;
use super::{circle, crb, density, localize, mmwave, multipath, stretch, variants};
use crate::scenario::input::InputError;

/// An experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// [`circle`].
    AoaCircle,
    /// [`crb`].
    AoaCrb,
    /// [`density`].
    ApfDensity,
    /// [`variants`].
    ApfVariants,
    /// [`multipath`].
    Multipath,
    /// [`localize`].
    Localize,
    /// [`mmwave`].
    Mmwave,
    /// [`stretch`].
    Stretch,
}

/// What of the experiments can be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Settings {
    /// Seed of everything random.
    pub seed: u64,
    /// Pairs of each row, of `apf-density`.
    pub pairs: u32,
    /// Scenes of each kind, of `multipath`.
    pub scenes: u32,
    /// Trials of each condition, of `stretch`.
    pub trials: u32,
    /// Scenarios, of `mmwave`: as many as the belief-space paper has.
    pub scenarios: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { seed: 1, pairs: 100, scenes: 50, trials: stretch::TRIALS, scenarios: 200 }
    }
}

/// What an experiment came to.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// A line of JSON.
    pub json: String,
    /// The rows for people.
    pub table: String,
    /// What was published, and what became of it here.
    pub beside: Vec<Beside>,
    /// The pictures that were drawn.
    pub pictures: Vec<PathBuf>,
}

impl Experiment {
    /// All of them, in the order in which the papers build on one another.
    pub const ALL: [Self; 8] = [
        Self::AoaCircle,
        Self::AoaCrb,
        Self::ApfDensity,
        Self::ApfVariants,
        Self::Multipath,
        Self::Localize,
        Self::Mmwave,
        Self::Stretch,
    ];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::AoaCircle => "aoa-circle",
            Self::AoaCrb => "aoa-crb",
            Self::ApfDensity => "apf-density",
            Self::ApfVariants => "apf-variants",
            Self::Multipath => "multipath",
            Self::Localize => "localize",
            Self::Mmwave => "mmwave",
            Self::Stretch => "stretch",
        }
    }

    /// What it shows, in a line.
    #[must_use]
    pub const fn title(self) -> &'static str {
        match self {
            Self::AoaCircle => "Bearings around a circle of 5 m, without noise",
            Self::AoaCrb => "Bearings over the Cramer-Rao bound",
            Self::ApfDensity => "Planners on maps of growing obstacle density",
            Self::ApfVariants => "Four potential fields in four scenes with local minima",
            Self::Multipath => "The closed loop among walls that reflect",
            Self::Localize => "Filters in sight and behind walls, paths on which bearings tell more",
            Self::Mmwave => "Agents that look for a transmitter indoors",
            Self::Stretch => "Excess travel behind a turning antenna",
        }
    }

    /// Whose experiment it is.
    #[must_use]
    pub const fn source(self) -> &'static str {
        match self {
            Self::AoaCircle => "main paper, fig. 8",
            Self::AoaCrb => "theory; the main paper has no noise",
            Self::ApfDensity => "main paper, Table I, fig. 9 and 10",
            Self::ApfVariants => "variants paper, Table I, fig. 2 to 5",
            Self::Multipath => "no paper's: what the filters behind the bearing are worth",
            Self::Localize => "mmWave paper, fig. 2 to 4, Table 2",
            Self::Mmwave => "mmWave paper, Table 3, fig. 5 and 6",
            Self::Stretch => "rotating vehicle's paper, fig. 3 and 4",
        }
    }

    /// What the paper leaves open, how it was read, and what does not come out as published.
    #[must_use]
    pub const fn note(self) -> &'static str {
        match self {
            Self::AoaCircle => {
                "The paper prints neither heights nor frequencies. Its rule for the half-plane, as printed, is false for half of \
                 all directions; with the magnitudes of its angles its mean error is the published one at 0.83 m of height."
            }
            Self::AoaCrb => {
                "Its method here is the paper's with the half-plane by cross-correlation, on the same frames, the frequency \
                 not told. One is the bound."
            }
            Self::ApfDensity => {
                "The paper prints mean and variance of its maps, flies each seven times, and prints rates for the fifth only; \
                 maps of these numbers are drawn here. Its planner and its baseline fly as published, as a point; Foxhound \
                 flies with dynamics, tracker and guard. What the numbers become when the paper is read otherwise is among \
                 all numbers."
            }
            Self::ApfVariants => {
                "The paper prints no gains, and nothing of the controller that takes the force: here a point flows along it. From \
                 the exact start three of the four fields never pass the first obstacle, so these are from 5 cm beside it, with \
                 the common gains that come nearest to the table. No gains that were tried reproduce all of it."
            }
            Self::Multipath => {
                "Scenes drawn from the seed: in the open beside walls, behind a partition, around a corner, in another room."
            }
            Self::Localize => {
                "The paper shows one run a figure and prints neither maps nor covariances; each row is many runs here. Table 2 \
                 is not reproduced with its steps of 1 m, for no process noise that was tried: how many times lower the \
                 uncertainty becomes is therefore shown with steps of 2.5 m as well."
            }
            Self::Mmwave => {
                "The paper's flats and ray tracings are not at hand: flats are drawn here, and the strongest path is traced. It \
                 prints no limit of a search; the limit here is the path at which the baseline finds as much as it does there. \
                 That minimising the covariance shortens the way does not come out."
            }
            Self::Stretch => {
                "The paper prints one number in its text and figures without numbers. That number is not what its own model \
                 gives at that rate of outliers, but what it gives at one in three."
            }
        }
    }

    /// Until where its progress counts; none where it does not say how far it is.
    #[must_use]
    pub fn length(self, settings: &Settings) -> Option<u64> {
        match self {
            Self::ApfDensity => Some(density::flights(settings.pairs)),
            Self::Multipath => Some(multipath::flights(settings.scenes)),
            Self::Mmwave => Some(mmwave::searches(settings.scenarios)),
            Self::Stretch => Some(stretch::trials(settings.trials)),
            Self::AoaCircle | Self::AoaCrb | Self::ApfVariants | Self::Localize => None,
        }
    }

    /// Runs it on all cores and draws its pictures, if there is a folder; `watch` hears that one more of [`Self::length`]
    /// is done, or several.
    ///
    /// # Errors
    /// A picture cannot be written; none that the built-in configurations could cause.
    pub fn run(
        self,
        settings: &Settings,
        folder: Option<&Path>,
        watch: impl Fn(u64) + Sync,
    ) -> Result<Outcome, InputError> {
        let &Settings { seed, pairs, scenes, trials, scenarios } = settings;
        match self {
            Self::AoaCircle => {
                let report = circle::run(seed)?;
                let draw = |folder: &Path| one(folder, "aoa-circle.svg", |path| report.draw(path));
                outcome(&report, report.table(), report.beside(), folder, draw)
            }
            Self::AoaCrb => {
                let report = crb::run(seed)?;
                let draw = |folder: &Path| one(folder, "aoa-crb.svg", |path| report.draw(path));
                outcome(&report, report.table(), report.beside(), folder, draw)
            }
            Self::ApfDensity => {
                let report = density::run(&density::Options { seed, pairs }, watch)?;
                outcome(&report, report.table(), report.beside(), folder, |folder| report.draw(folder))
            }
            Self::ApfVariants => {
                let report = variants::run();
                outcome(&report, report.table(), report.beside(), folder, |folder| report.draw(folder))
            }
            Self::Multipath => {
                let done = std::sync::atomic::AtomicU64::new(0);
                let options = multipath::Options { seed, scenes };
                let report =
                    multipath::run(&options, || watch(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1))?;
                let draw = |folder: &Path| one(folder, "multipath.svg", |path| report.draw(path));
                outcome(&report, report.table(), report.beside(), folder, draw)
            }
            Self::Localize => {
                let report = localize::run(seed)?;
                outcome(&report, report.table(), report.beside(), folder, |folder| report.draw(folder))
            }
            Self::Mmwave => {
                let report = mmwave::run(&mmwave::Options { seed, scenarios }, watch)?;
                outcome(&report, report.table(), report.beside(), folder, |folder| report.draw(folder))
            }
            Self::Stretch => {
                let report = stretch::run(&stretch::Options { seed, trials }, watch)?;
                outcome(&report, report.table(), report.beside(), folder, |folder| report.draw(folder))
            }
        }
    }
}

/// Draws a single picture.
fn one(folder: &Path, name: &str, draw: impl Fn(&Path) -> Result<(), InputError>) -> Result<Vec<PathBuf>, InputError> {
    let path = folder.join(name);
    draw(&path)?;
    Ok(vec![path])
}

fn outcome(
    report: &impl Serialize,
    table: String,
    beside: Vec<Beside>,
    folder: Option<&Path>,
    draw: impl Fn(&Path) -> Result<Vec<PathBuf>, InputError>,
) -> Result<Outcome, InputError> {
    let json = serde_json::to_string(report).map_err(|error| InputError::new(error.to_string()))? + "\n";
    let pictures = folder.map_or(Ok(Vec::new()), draw)?;
    Ok(Outcome { json, table, beside, pictures })
}
