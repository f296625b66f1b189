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
use serde_json::{Value, json};

use crate::scenario::input::InputError;
use crate::study::reproduce::beside::{empty, line};
use crate::study::reproduce::settings::Settings;
use crate::study::{Beside, Study, Watch};

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

impl Study for Report {
    type Settings = Settings;

    const NAME: &'static str = "localize";
    const TITLE: &'static str = "Filters in sight and behind walls, paths on which bearings tell more";
    const SOURCE: &'static str = "mmWave paper, fig. 2 to 4, Table 2";
    const NOTE: &'static str = "\
        The paper shows one run a figure and prints neither maps nor covariances; each row is many runs here. Table \
        2 is not reproduced with its steps of 1 m, for no process noise that was tried: how many times lower the \
        uncertainty becomes is therefore shown with steps of 2.5 m as well.";

    fn chosen(settings: &Settings) -> Value {
        json!({ "seed": settings.seed })
    }

    fn run(settings: &Settings, _: Watch<'_>) -> Result<Self, InputError> {
        Ok(Self { filters: filters::run(settings.seed)?, paths: paths::run(), leg: leg::run(settings.seed, LEG_RUNS) })
    }

    fn table(&self) -> String {
        [self.filters.table(), self.paths.table(), self.leg.table()].join("\n")
    }

    /// Draws the pictures; says which files these are.
    fn figures(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let filters = folder.join("localize.svg");
        self.filters.draw(&filters)?;
        let mut files = vec![filters];
        files.extend(self.paths.draw(folder)?);
        Ok(files)
    }

    /// Errors at the end, and uncertainty along the paths.
    fn verdict(&self) -> Vec<Beside> {
        let mut lines = Vec::new();
        for row in &self.filters.rows {
            let median = |outcome: &filters::Outcome| match outcome.median_m {
                median_m if median_m.is_finite() => format!("{median_m:.2} m"),
                _ => "lost".to_owned(),
            };
            let published = match row.name {
                "nlos_fig_3" => format!("{} m, one run", filters::PAPER_FIG_3_M),
                "los_fig_2" => "one run, no number".to_owned(),
                _ => empty(),
            };
            let words = [published, row.paper.as_ref().map_or_else(empty, median), median(&row.ours)];
            lines.push(line::<Self>(format!("median error at the end, {}", row.label), words));
        }
        for row in self.paths.rows.iter().filter(|row| row.step_max_m == paths::PRINTED_STEP_M) {
            let case = row.case.replace('_', " ");
            let words = [format!("{} m^2", row.printed_xi_m2), empty(), format!("{:.2} m^2", row.xi_m2)];
            lines.push(line::<Self>(format!("uncertainty along the path, {case}, T = {}", row.weight), words));
        }
        for (case, printed) in [("line_of_sight", 10.95 / 4.4), ("reflected", 12.51 / 10.84)] {
            let lower = |step_m| self.paths.ratio(case, step_m).map_or_else(empty, |ratio| format!("{ratio:.2}"));
            let [free, short] = [paths::FREE_STEP_M, paths::PRINTED_STEP_M].map(lower);
            let words = [format!("{printed:.2} times"), empty(), format!("{free} times; steps of 1 m: {short}")];
            let what = format!("uncertainty, how much lower with T = 50, {}", case.replace('_', " "));
            lines.push(line::<Self>(what, words));
        }
        for way in [&self.leg.straight, &self.leg.planned] {
            let words =
                [empty(), empty(), format!("{:.2} m for {:.1} % more way", way.range_rmse_m, 100.0 * way.extra_length)];
            lines.push(line::<Self>(format!("range after half a leg of 12 m, rmse, {}", way.way), words));
        }
        lines
    }
}
