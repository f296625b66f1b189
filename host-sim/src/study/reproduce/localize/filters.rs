//! How well filters localize: fig. 2 and 3 of the mmWave paper, and what it leaves out.
//!
//! The robot moves at random along both axes, up to the paper's control limit of 1 m, and measures the source's
//! direction with 0.05 rad at each of 200 places. The paper shows one run a figure and prints neither its map nor its
//! covariances; here each row is many runs, each on a new geometry, sources 10-30 m away.
//!
//! - `los_fig_2`: line of sight, 40 m initial error. The paper's filter begins with a guess that is 40 m off in any
//!   direction, with a covariance that says so. Ours takes the direction from the first bearing; its range is 40 m off.
//! - `los_prior`, `los_leg`, `los_moving`: truths drawn from our filter's prior, which is when consistency means something:
//!   random motions; 6 m of a straight leg of about 12 m; a source of nearly constant velocity, which the paper's filter
//!   does not know.
//! - `nlos_fig_3`: first-order reflection off a known wall, 10 m initial error, and the same off a wall that is vertical in
//!   the paper's frame, off two walls of a corner, and from a moving source.
//!
//! Normalised innovations (NIS) are gathered over all sightings, normalised errors (NEES) at the ends of runs, each with the
//! band in which 95 % of the means of a consistent filter are.

use std::fmt::Write as _;

use serde::Serialize;

use crate::scenario::input::InputError;

mod consistency;
mod picture;
mod scene;
mod stage;
mod trial;

use consistency::Consistency;
use scene::{draw_fig_2, draw_leg, draw_prior, draw_slanted, draw_vertical};
use stage::Stage;
use trial::{Gathered, SIGHTINGS};

pub use consistency::Verdict;

/// Runs of each experiment.
pub const RUNS: usize = 200;
/// Initial errors of fig. 2 and 3.
const FIG_2_M: f64 = 40.0;
const FIG_3_M: f64 = 10.0;
/// The error that the paper's fig. 3 ends with.
pub const PAPER_FIG_3_M: f64 = 3.0;
/// Prior of the drawn truths.
const PRIOR_RHO: [f64; 2] = [1.0 / 15.0, 0.01];
/// The leg's: about 12 m. Were it much wider, the inverse of what is left of the range would be skew, and no filter of means
/// and covariances consistent.
const LEG_RHO: [f64; 2] = [0.08, 0.006];

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `localize-filters`.
    pub experiment: &'static str,
    /// Runs of each experiment.
    pub runs: usize,
    /// One for each experiment.
    pub rows: Vec<Row>,
    #[serde(skip)]
    figures: [picture::Figure; 2],
}

/// One experiment.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// The same as text.
    pub label: &'static str,
    /// What the paper's filter, as printed, makes of it; `None` where it has none.
    pub paper: Option<Outcome>,
    /// What ours does.
    pub ours: Outcome,
}

/// Many runs of a filter.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Median error of the source's place at the first sighting.
    pub initial_m: f64,
    /// At the end.
    pub median_m: f64,
    /// Nine of ten runs end with less.
    pub p90_m: f64,
    /// Runs whose filter diverged.
    pub lost: usize,
    /// Normalised innovations squared: one on average.
    pub nis: Normalised,
    /// Normalised errors squared at the end: as many as states on average.
    pub nees: Normalised,
}

/// The mean of normalised squares.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Normalised {
    /// The mean.
    pub mean: f64,
    /// Where 95 % of the means of a consistent filter are.
    pub band: [f64; 2],
    /// What that says.
    pub verdict: Verdict,
}

impl From<Consistency> for Normalised {
    fn from(gathered: Consistency) -> Self {
        Self { mean: f64::from(gathered.mean()), band: gathered.band().map(f64::from), verdict: gathered.verdict() }
    }
}

impl Outcome {
    fn new(gathered: &Gathered) -> Self {
        let share = |values: &[f64], share: f64| {
            let mut sorted = values.to_vec();
            sorted.sort_by(f64::total_cmp);
            let index = libm::ceil(share * sorted.len() as f64) as usize;
            sorted.get(index.saturating_sub(1)).copied().unwrap_or(f64::INFINITY)
        };
        Self {
            initial_m: share(&gathered.initial_m, 0.5),
            median_m: share(&gathered.errors_m, 0.5),
            p90_m: share(&gathered.errors_m, 0.9),
            lost: gathered.lost,
            nis: gathered.nis.into(),
            nees: gathered.nees.into(),
        }
    }
}

/// Runs the experiments.
///
/// # Errors
/// None that the built-in configuration could cause.
pub fn run(seed: u64) -> Result<Report, InputError> {
    let runs = RUNS;
    let mut rows = Vec::new();
    let mut figures = [picture::Figure::default(), picture::Figure::default()];

    let mut stage = Stage::new(seed, 1, runs);
    stage.line_of_sight(draw_fig_2)?;
    figures[0] = stage.figure("line of sight (fig. 2)");
    rows.push(stage.row("los_fig_2", "line of sight, 40 m off (fig. 2)"));

    let mut stage = Stage::new(seed, 2, runs);
    stage.line_of_sight(|random| draw_prior(PRIOR_RHO, random))?;
    rows.push(stage.row("los_prior", "line of sight, drawn from the prior"));

    let mut stage = Stage::new(seed, 3, runs);
    stage.line_of_sight(|random| draw_leg(LEG_RHO, random))?;
    rows.push(stage.row("los_leg", "line of sight, 6 m of a straight leg"));

    let mut stage = Stage::new(seed, 4, runs);
    stage.moving(false)?;
    rows.push(stage.row("los_moving", "line of sight, moving source"));

    let mut stage = Stage::new(seed, 5, runs);
    stage.known(&draw_slanted)?;
    figures[1] = stage.figure("one wall, known (fig. 3)");
    rows.push(stage.row("nlos_fig_3", "one wall, known, 10 m off (fig. 3)"));

    let mut stage = Stage::new(seed, 6, runs);
    stage.known(&draw_vertical)?;
    rows.push(stage.row("nlos_vertical", "the same, a vertical wall"));

    let mut stage = Stage::new(seed, 7, runs);
    stage.corner()?;
    rows.push(stage.row("nlos_corner", "two walls, known, 10 m off"));

    let mut stage = Stage::new(seed, 8, runs);
    stage.moving(true)?;
    rows.push(stage.row("nlos_moving", "one wall, known, moving source"));

    Ok(Report { experiment: "localize-filters", runs, rows, figures })
}

impl Report {
    /// The table as text.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text =
            format!("Error of the source's place after {SIGHTINGS} bearings of 0.05 rad, {} runs each\n\n", self.runs);
        let _ = writeln!(
            text,
            "{:<38}{:<8}{:>7}{:>8}{:>8}{:>6}  {:<33}NEES (95 % band)",
            "", "filter", "first", "median", "90 %", "lost", "NIS (95 % band)"
        );
        for row in &self.rows {
            let both = [row.paper.as_ref().map(|paper| ("paper", paper)), Some(("ours", &row.ours))];
            let mut label = row.label;
            for (filter, outcome) in both.into_iter().flatten() {
                let metres = [outcome.initial_m, outcome.median_m, outcome.p90_m].map(metres);
                let _ = writeln!(
                    text,
                    "{label:<38}{filter:<8}{:>7}{:>8}{:>8}{:>6}  {:<33}{}",
                    metres[0],
                    metres[1],
                    metres[2],
                    outcome.lost,
                    outcome.nis.written(),
                    outcome.nees.written()
                );
                label = "";
            }
        }
        text
    }
}

fn metres(value: f64) -> String {
    if value.is_finite() { format!("{value:.2} m") } else { "-".to_owned() }
}

impl Normalised {
    fn written(&self) -> String {
        let [low, high] = self.band;
        let verdict = match self.verdict {
            Verdict::Consistent => "",
            Verdict::Optimistic => " optim.",
            Verdict::Pessimistic => " pessim.",
            Verdict::TooFew => return "-".to_owned(),
        };
        let mean = if self.mean < 100.0 { format!("{:.3}", self.mean) } else { format!("{:.0}", self.mean) };
        format!("{mean} ({low:.3}..{high:.3}){verdict}")
    }
}

#[cfg(test)]
mod tests;
