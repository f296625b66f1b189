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
use crate::study::reproduce::beside::{empty, judged, line, shown};
use crate::study::reproduce::settings::Settings;
use crate::study::reproduce::{Beside, Judgement, Study, Verdict, Watch};

/// Runs of the leg.
const LEG_RUNS: u32 = 500;

/// The whole report.
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

    fn judgements(&self) -> Vec<Judgement> {
        let median = |name: &str| {
            let row = self.filters.rows.iter().find(|row| row.name == name);
            row.map_or([f64::NAN; 2], |row| {
                [row.paper.as_ref().map_or(f64::NAN, |paper| paper.median_m), row.ours.median_m]
            })
        };
        let ([sight, our_sight], [wall, our_wall]) = (median("los_fig_2"), median("nlos_fig_3"));
        let printed_wall = filters::PAPER_FIG_3_M;
        let ratio = |case, step_m| self.paths.ratio(case, step_m).unwrap_or(f64::NAN);
        let [free, printed_step] =
            [paths::FREE_STEP_M, paths::PRINTED_STEP_M].map(|step_m| ratio("line_of_sight", step_m));
        let printed = 10.95 / 4.4;
        vec![
            judged::<Self>(
                "mmWave paper, fig. 2",
                Verdict::of(sight <= 1.5, our_sight <= 1.0),
                format!(
                    "The paper's one run converges to about 1 m; over many runs its filter has a median of {} m here, \
                     Foxhound's {} m.",
                    shown(sight, 2),
                    shown(our_sight, 2)
                ),
            ),
            judged::<Self>(
                "mmWave paper, fig. 3",
                Verdict::of((wall - printed_wall).abs() <= 0.5 * printed_wall, our_wall <= printed_wall),
                format!(
                    "The paper's one run behind a wall ends {printed_wall} m off; over many runs its filter has a median of {} m \
                     here, Foxhound's {} m.",
                    shown(wall, 2),
                    shown(our_wall, 2)
                ),
            ),
            judged::<Self>(
                "mmWave paper, fig. 4",
                Verdict::of(free > 1.5, false),
                format!(
                    "The path bends so that bearings tell more, as drawn: the uncertainty along it is {} times lower with steps \
                     of 2.5 m.",
                    shown(free, 2)
                ),
            ),
            judged::<Self>(
                "mmWave paper, Table 2",
                Verdict::of((printed_step / printed - 1.0).abs() <= 0.1, printed_step >= printed),
                format!(
                    "With its steps of 1 m the uncertainty in sight becomes {} times lower where {printed:.2} is printed, \
                     for no process noise that was tried.",
                    shown(printed_step, 2)
                ),
            ),
        ]
    }
}
