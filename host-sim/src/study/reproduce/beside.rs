//! What was published, what the published method makes of it here, and what Foxhound does: the lines that the index page of
//! `reproduce all` begins with.

use serde::{Deserialize, Serialize};

use super::circle::{self, Phases};
use super::{Experiment, crb, density, localize, mmwave, multipath, stretch, variants};
use crate::drive::flight::Ending;
use crate::drive::suite::Tally;

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

fn line(experiment: Experiment, what: String, [published, theirs, ours]: [String; 3]) -> Beside {
    Beside { experiment: experiment.name().to_owned(), what, published, theirs, ours }
}

fn empty() -> String {
    String::new()
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(empty, |share| format!("{:.1} %", 100.0 * share))
}

/// `61.0 % of 100`.
fn rate(tally: &Tally) -> String {
    tally.success_rate.map_or_else(empty, |rate| format!("{:.1} % of {}", 100.0 * rate, tally.runs))
}

impl circle::Report {
    /// The mean errors beside the paper's.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let at = |height_m: f64| {
            let mean = |estimator: &str| {
                let mut rows = self.rows.iter().filter(|row| row.phases == Phases::Frames && row.height_m == height_m);
                rows.find(|row| row.estimator == estimator).map_or(f64::NAN, |row| row.ours.mean_deg)
            };
            let theirs = format!("{:.2} deg; its rule repaired: {:.2} deg", mean("paper"), mean("paper_repaired"));
            let words = [format!("{} deg", circle::PAPER_MEAN_DEG), theirs, format!("{:.4} deg", mean("cross"))];
            line(Experiment::AoaCircle, format!("mean error, source {height_m} m above the array"), words)
        };
        circle::HEIGHTS_M.map(at).into()
    }
}

impl crb::Report {
    /// Errors over the bound, of frames of 256 samples.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let over = |rms: &crb::Rms| rms.over_bound.map_or_else(empty, |ratio| format!("{ratio:.2}"));
        let rows = self.rows.iter().filter(|row| row.n == 256 && [10.0, 20.0, 30.0].contains(&row.snr_db));
        rows.map(|row| {
            let what =
                format!("rms error over the bound of {:.3} deg, {:.0} dB, 256 samples", row.bound_deg, row.snr_db);
            line(Experiment::AoaCrb, what, [empty(), over(&row.paper), over(&row.ours)])
        })
        .collect()
    }
}

impl density::Report {
    /// Success rates, and what the paper's planner gains on its baseline.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let mut lines = Vec::new();
        for row in &self.rows {
            let printed = |share: Option<f64>| {
                share.map_or_else(
                    || "a bar without a number".to_owned(),
                    |rate| format!("{:.1} % of {}", 100.0 * rate, row.printed.runs),
                )
            };
            let what = |planner: &str| format!("reached, {planner}, map {} (density {:.4})", row.map, row.mean);
            let standard = [printed(row.printed.standard), rate(&row.columns.standard), empty()];
            let paper = [printed(row.printed.paper), rate(&row.columns.paper), rate(&row.columns.ours)];
            lines.push(line(Experiment::ApfDensity, what("baseline"), standard));
            lines.push(line(Experiment::ApfDensity, what("planner"), paper));
        }
        let all = &self.all;
        let gain = |better: &Tally| {
            let gained = better.success_rate.zip(all.standard.success_rate).map(|(better, base)| better - base);
            gained.map_or_else(empty, |gained| format!("{:+.1} points", 100.0 * gained))
        };
        let shorter = |length: Option<f64>| {
            let ratio = length.zip(all.relative_length.standard).map(|(length, base)| length / base - 1.0);
            ratio.map_or_else(empty, |ratio| format!("{:+.1} %", 100.0 * ratio))
        };
        let [success, length] = self.printed_gains_percent;
        let words = [format!("{success:+.0} %"), gain(&all.paper), gain(&all.ours)];
        lines.push(line(Experiment::ApfDensity, "reached, more than the baseline, all maps".to_owned(), words));
        let (paper, ours) = (all.relative_length.paper, all.relative_length.ours);
        let words = [format!("{length:+.1} %"), shorter(paper), shorter(ours)];
        lines.push(line(
            Experiment::ApfDensity,
            "path, longer than the baseline's, pairs that all reach".to_owned(),
            words,
        ));
        lines
    }
}

impl variants::Report {
    /// Times to the goal, from beside the printed start.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let seconds = |time_s: Option<f64>, otherwise: &str| {
            time_s.map_or_else(|| otherwise.to_owned(), |time_s| format!("{time_s:.3} s"))
        };
        let cell = |cell: &variants::Cell| {
            let otherwise = if cell.result == Ending::Collision { "collides" } else { "stalls" };
            let words = [seconds(cell.printed_time_s, "does not reach it"), seconds(cell.time_s, otherwise), empty()];
            let what =
                format!("time to the goal, {}: {}", cell.scene.replace('_', " "), cell.algorithm.replace('_', " "));
            line(Experiment::ApfVariants, what, words)
        };
        let mut lines: Vec<Beside> = self.beside.cells.iter().map(cell).collect();
        let cells = self.beside.cells.len();
        let words = [format!("{cells} of {cells}"), format!("{} of {cells}", self.beside.agreeing), empty()];
        lines.push(line(
            Experiment::ApfVariants,
            "cells of the table that agree on who reaches the goal".to_owned(),
            words,
        ));
        lines
    }
}

impl multipath::Report {
    /// With the filters and without.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let count = |chain: multipath::Chain| {
            let rows = self.rows.iter().filter(|row| row.chain == chain);
            let (reached, flights) = rows.fold((0, 0), |(r, f), row| (r + row.reached, f + row.flights));
            format!("{reached} of {flights}")
        };
        let ours = format!("{}; without filters {}", count(multipath::Chain::With), count(multipath::Chain::Without));
        let hit = format!("{} in all flights", self.collisions);
        vec![
            line(Experiment::Multipath, "flights that reach the beacon".to_owned(), [empty(), empty(), ours]),
            line(Experiment::Multipath, "collisions".to_owned(), [empty(), empty(), hit]),
        ]
    }
}

impl localize::Report {
    /// Errors at the end, and uncertainty along the paths.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let mut lines = Vec::new();
        for row in &self.filters.rows {
            let median = |outcome: &localize::filters::Outcome| match outcome.median_m {
                median_m if median_m.is_finite() => format!("{median_m:.2} m"),
                _ => "lost".to_owned(),
            };
            let published = match row.name {
                "nlos_fig_3" => format!("{} m, one run", localize::filters::PAPER_FIG_3_M),
                "los_fig_2" => "one run, no number".to_owned(),
                _ => empty(),
            };
            let words = [published, row.paper.as_ref().map_or_else(empty, median), median(&row.ours)];
            lines.push(line(Experiment::Localize, format!("median error at the end, {}", row.label), words));
        }
        for row in self.paths.rows.iter().filter(|row| row.step_max_m == localize::paths::PRINTED_STEP_M) {
            let case = row.case.replace('_', " ");
            let words = [format!("{} m^2", row.printed_xi_m2), empty(), format!("{:.2} m^2", row.xi_m2)];
            lines.push(line(
                Experiment::Localize,
                format!("uncertainty along the path, {case}, T = {}", row.weight),
                words,
            ));
        }
        for (case, printed) in [("line_of_sight", 10.95 / 4.4), ("reflected", 12.51 / 10.84)] {
            let lower = |step_m| self.paths.ratio(case, step_m).map_or_else(empty, |ratio| format!("{ratio:.2}"));
            let [free, short] = [localize::paths::FREE_STEP_M, localize::paths::PRINTED_STEP_M].map(lower);
            let words = [format!("{printed:.2} times"), empty(), format!("{free} times; steps of 1 m: {short}")];
            let what = format!("uncertainty, how much lower with T = 50, {}", case.replace('_', " "));
            lines.push(line(Experiment::Localize, what, words));
        }
        for way in [&self.leg.straight, &self.leg.planned] {
            let words =
                [empty(), empty(), format!("{:.2} m for {:.1} % more way", way.range_rmse_m, 100.0 * way.extra_length)];
            lines.push(line(Experiment::Localize, format!("range after half a leg of 12 m, rmse, {}", way.way), words));
        }
        lines
    }
}

impl mmwave::Report {
    /// Who finds the transmitter at the paper's noise, and how far they go.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let Some(noisy) = self.noises.get(1) else { return Vec::new() };
        // Behind the one that knows the transmitter: the baseline, the paper's switch, ours without and with minimisation.
        let [_, follow, switch, estimate, belief] = noisy.agents.as_slice() else { return Vec::new() };
        let [baseline, without, with] = self.printed;
        let found = |share: f64| percent(Some(share));
        let length = |ratio: Option<f64>| ratio.map_or_else(empty, |ratio| format!("{ratio:.2}"));
        let entry = |what: &str, words: [String; 3]| line(Experiment::Mmwave, what.to_owned(), words);
        vec![
            entry("found, baseline", [found(baseline[0]), found(follow.all.success_rate), empty()]),
            entry(
                "found, filters",
                [found(without[0]), found(switch.all.success_rate), found(estimate.all.success_rate)],
            ),
            entry("found, with covariance minimisation", [found(with[0]), empty(), found(belief.all.success_rate)]),
            entry(
                "path over the baseline's, filters",
                [length(Some(without[1])), length(switch.all.relative_length), length(estimate.all.relative_length)],
            ),
            entry(
                "path over the baseline's, with covariance minimisation",
                [length(Some(with[1])), empty(), length(belief.all.relative_length)],
            ),
        ]
    }
}

impl stretch::Report {
    /// The paper's number and, as the closed form of its own model says it, those of its figure.
    #[must_use]
    pub fn beside(&self) -> Vec<Beside> {
        let told = [(0.0, 20.0), (0.2, 20.0), (1.0 / 3.0, 20.0), (0.4, 20.0), (0.6, 60.0)];
        let rows = self.rows.iter().filter(|row| told.contains(&(row.p, row.sigma_deg)));
        rows.map(|row| {
            let published = row.paper.mean.map_or_else(empty, |mean| format!("{mean:.1}"));
            let theirs = format!("{:.3}; its model: {:.3}", row.greedy_stretch.mean, row.closed_form);
            let words = [published, theirs, format!("{:.3}", row.filtered_stretch.mean)];
            let what = format!("path over straight line, outliers {:.3}, noise {:.0} deg", row.p, row.sigma_deg);
            line(Experiment::Stretch, what, words)
        })
        .collect()
    }
}
