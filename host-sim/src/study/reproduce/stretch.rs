//! `stretch`: path over straight line of a vehicle that flies along the bearings of its turning antenna, outliers among them
//! (fig. 3 and 4 of the paper of the rotating vehicle).
//!
//! From (50, 50) m to within 1 m of the source in steps of 0.1 m, [`Settings::trials`] times for each outlier rate and noise. Two
//! rules: the paper's, which follows each direction that it measures and needs no position; and what flies, the filter bank
//! ([`foxhound_core::localize::source::bank`]), which fuses the directions with the vehicle's own positions. Both walk under
//! the same draws. The filters know the noise, as a bearing brings its sigma with it, and take one rate of outliers whatever
//! it is.
//!
//! Far from the source a greedy step gains `(1 - p) exp(-sigma^2 / 2)` of its length, which makes the stretch that closed
//! form's inverse, less what the last metre saves. [`moving`] is a source that moves.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::{IntoParallelIterator as _, ParallelIterator as _};
use serde::Serialize;
use serde_json::{Value, json};

use super::beside::{empty, judged, line, shown};
use super::chart::{Axis, Chart, Panel, Series};
use super::settings::Settings;
use crate::scenario::input::InputError;
use crate::study::reproduce::{Beside, Judgement, Study, Verdict, Watch};
use crate::world::Horizontal;
use crate::world::random::Random;

pub mod moving;

mod walk;

use walk::{Model, REACHED_M, Rule, STEP_M, Walk};

/// Outlier rates: the paper's range, with the rates it names.
pub const OUTLIER_RATES: [f64; 9] = [0.0, 0.1, 0.2, 0.2667, 0.3, 1.0 / 3.0, 0.4, 0.5, 0.6];
/// Standard deviations of the noise; fig. 4 has 0.4654 rad.
pub const SIGMAS_DEG: [f64; 8] = [0.0, 10.0, 20.0, FIG_4_SIGMA_DEG, 30.0, 40.0, 50.0, 60.0];
/// What fig. 4 holds while it varies the other.
const FIG_4_SIGMA_DEG: f64 = 0.4654 * 180.0 / std::f64::consts::PI;
const FIG_4_RATE: f64 = 0.2667;
/// The only number of the paper: at this rate and noise its text says this stretch.
const PAPER: [f64; 3] = [0.4, 20.0, 1.6];
/// Where a vehicle starts, x east and y north; the source is at the origin.
const START_M: [f64; 2] = [50.0, 50.0];
/// Steps after which a trial is given up: 28 times the straight line.
const STEPS_MAX: u32 = 20_000;
/// Purpose of the random numbers.
const DRAWS: u64 = 21;

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `stretch`.
    pub experiment: &'static str,
    /// Trials of each row.
    pub trials: u32,
    /// Steps after which a trial counts as that long.
    pub steps_max: u32,
    /// A condition each.
    pub rows: Vec<Row>,
    /// A source that moves.
    pub moving: moving::Report,
}

/// An outlier rate and a noise.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Rate of outliers.
    pub p: f64,
    /// Standard deviation of the noise.
    pub sigma_deg: f64,
    /// The paper's rule.
    pub greedy_stretch: Stretch,
    /// What flies: the directions and the vehicle's positions.
    pub filtered_stretch: Stretch,
    /// What the model gives for the greedy rule, without randomness.
    pub closed_form: f64,
    /// What the paper says.
    pub paper: Paper,
}

/// Stretch of a rule.
#[derive(Clone, Debug, Serialize)]
pub struct Stretch {
    /// Mean over the trials.
    pub mean: f64,
    /// Standard deviation of a trial.
    pub std: f64,
    /// Standard error of the mean.
    pub standard_error: f64,
    /// Trials that were given up.
    pub given_up: usize,
    #[serde(skip)]
    all: Vec<f64>,
}

/// What the paper says of a condition.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Paper {
    /// The mean in its text.
    pub mean: Option<f64>,
}

impl Stretch {
    fn of(trials: impl Iterator<Item = Option<f64>>) -> Self {
        let straight_m = libm::hypot(START_M[0], START_M[1]);
        let all: Vec<Option<f64>> = trials.collect();
        let given_up = all.iter().filter(|trial| trial.is_none()).count();
        let longest = STEP_M * f64::from(STEPS_MAX) / straight_m;
        let all: Vec<f64> = all.into_iter().map(|trial| trial.unwrap_or(longest)).collect();
        let count = all.len().max(1) as f64;
        let mean = all.iter().sum::<f64>() / count;
        let square = all.iter().map(|stretch| (stretch - mean) * (stretch - mean)).sum::<f64>();
        let std = libm::sqrt(square / (count - 1.0).max(1.0));
        Self { mean, std, standard_error: std / libm::sqrt(count), given_up, all }
    }
}

/// Conditions, one after the other.
fn conditions() -> impl Iterator<Item = (f64, f64)> {
    OUTLIER_RATES.into_iter().flat_map(|p| SIGMAS_DEG.into_iter().map(move |sigma_deg| (p, sigma_deg)))
}

/// Trials in all, for a progress bar.
#[must_use]
pub fn trials(each: u32) -> u64 {
    u64::from(each) * (OUTLIER_RATES.len() * SIGMAS_DEG.len()) as u64
}

/// What the model gives for the greedy rule: a step gains `(1 - p) exp(-sigma^2 / 2)` of its length.
fn closed_form(p: f64, sigma_deg: f64) -> f64 {
    let sigma_rad = sigma_deg.to_radians();
    let far = 1.0 / ((1.0 - p) * libm::exp(-0.5 * sigma_rad * sigma_rad));
    far * (1.0 - REACHED_M / libm::hypot(START_M[0], START_M[1]))
}

impl Study for Report {
    const NAME: &'static str = "stretch";
    const TITLE: &'static str = "Excess travel behind a turning antenna";
    const SOURCE: &'static str = "rotating vehicle's paper, fig. 3 and 4";
    const NOTE: &'static str = "\
        The paper prints one number in its text and figures without numbers. That number is not what its own model \
        gives at that rate of outliers, but what it gives at one in three.";

    fn chosen(settings: &Settings) -> Value {
        json!({ "seed": settings.seed, "trials": settings.trials })
    }

    fn length(settings: &Settings) -> Option<u64> {
        Some(trials(settings.trials))
    }

    fn run(settings: &Settings, watch: Watch<'_>) -> Result<Self, InputError> {
        let &Settings { seed, trials, .. } = settings;
        let rules = Rule::all()?;
        let done = AtomicU64::new(0);
        let mut rows = Vec::new();
        for (condition, (p, sigma_deg)) in conditions().enumerate() {
            let model = Model { outlier_rate: p, sigma_rad: sigma_deg.to_radians() };
            let all: Vec<[Option<f64>; 2]> = (0..trials)
                .into_par_iter()
                .map(|trial| {
                    let random = Random::new(seed, DRAWS + ((condition as u64) << 32) + (u64::from(trial) << 8));
                    let start = Horizontal::from_xy(START_M);
                    let stretches =
                        rules.each_ref().map(|rule| Walk::new(rule, model, start, random.clone()).stretch(STEPS_MAX));
                    watch(done.fetch_add(1, Ordering::Relaxed) + 1);
                    stretches
                })
                .collect();
            let stretch = |rule: usize| Stretch::of(all.iter().map(|trial| trial[rule]));
            rows.push(Row {
                p,
                sigma_deg,
                greedy_stretch: stretch(0),
                filtered_stretch: stretch(1),
                closed_form: closed_form(p, sigma_deg),
                paper: Paper { mean: ([p, sigma_deg] == PAPER[..2]).then_some(PAPER[2]) },
            });
        }
        Ok(Self { experiment: "stretch", trials, steps_max: STEPS_MAX, rows, moving: moving::run(seed, trials)? })
    }

    fn table(&self) -> String {
        let mut text = format!(
            "Path over straight line from (50, 50) m in steps of {STEP_M} m, {} trials a row: mean and standard deviation\n\
             {:>6}{:>7}{:>17}{:>9}{:>8}{:>18}\n",
            self.trials, "p", "sigma", "greedy", "model", "paper", "filtered"
        );
        for row in &self.rows {
            let written = |stretch: &Stretch| {
                let given_up =
                    if stretch.given_up > 0 { format!(" ({} given up)", stretch.given_up) } else { String::new() };
                format!("{:.3} +- {:.3}{given_up}", stretch.mean, stretch.std)
            };
            let paper = row.paper.mean.map_or_else(String::new, |mean| format!("{mean:.1}"));
            let _ = writeln!(
                text,
                "{:>6.3}{:>4.0} deg{:>17}{:>9.3}{paper:>8}{:>18}",
                row.p,
                row.sigma_deg,
                written(&row.greedy_stretch),
                row.closed_form,
                written(&row.filtered_stretch)
            );
        }
        text.push_str(&self.moving.table());
        text
    }

    /// Draws fig. 3, fig. 4 and the pursuit of a moving source; says which files these are.
    fn figures(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let [mean, histograms, moving] =
            ["stretch.svg", "stretch-histograms.svg", "stretch-moving.svg"].map(|name| folder.join(name));
        self.draw_mean(&mean)?;
        self.draw_histograms(&histograms)?;
        self.moving.draw(&moving)?;
        Ok(vec![mean, histograms, moving])
    }

    /// The paper's number and, as the closed form of its own model says it, those of its figure.
    fn verdict(&self) -> Vec<Beside> {
        let told = [(0.0, 20.0), (0.2, 20.0), (1.0 / 3.0, 20.0), (0.4, 20.0), (0.6, 60.0)];
        let rows = self.rows.iter().filter(|row| told.contains(&(row.p, row.sigma_deg)));
        rows.map(|row| {
            let published = row.paper.mean.map_or_else(empty, |mean| format!("{mean:.1}"));
            let theirs = format!("{:.3}; its model: {:.3}", row.greedy_stretch.mean, row.closed_form);
            let words = [published, theirs, format!("{:.3}", row.filtered_stretch.mean)];
            let what = format!("path over straight line, outliers {:.3}, noise {:.0} deg", row.p, row.sigma_deg);
            line::<Self>(what, words)
        })
        .collect()
    }

    fn judgements(&self) -> Vec<Judgement> {
        let off = |row: &Row| (row.greedy_stretch.mean / row.closed_form - 1.0).abs();
        // Where the model converges, and outliers are fewer than half.
        let rows: Vec<&Row> = self.rows.iter().filter(|row| row.p <= 0.4 && row.closed_form.is_finite()).collect();
        let most = 100.0 * rows.iter().map(|row| off(row)).fold(0.0, f64::max);
        let [p, sigma_deg, printed] = PAPER;
        let told = self.rows.iter().find(|row| [row.p, row.sigma_deg] == [p, sigma_deg]);
        let (theirs, ours) =
            told.map_or((f64::NAN, f64::NAN), |row| (row.greedy_stretch.mean, row.filtered_stretch.mean));
        let why = format!(
            "The one number in the text, {printed} at a rate of outliers of {p} and {sigma_deg} deg, is {} here, as the paper's \
             own model says; with the filters Foxhound's is {}.",
            shown(theirs, 2),
            shown(ours, 2)
        );
        let verdict = Verdict::of((theirs / printed - 1.0).abs() <= 0.05, ours <= printed);
        let spread = "The paper prints curves without numbers: the spread over outliers and noise is drawn as it does, and has no \
                      number to be held against.";
        vec![
            judged::<Self>("rotating vehicle's paper, fig. 3", verdict, why),
            judged::<Self>(
                "rotating vehicle's paper, fig. 4",
                Verdict::of(most <= 5.0, false),
                format!("{spread} The mean is within {most:.1} % of the paper's model where outliers are 0.4 at most."),
            ),
        ]
    }
}

impl Report {
    fn draw_mean(&self, path: &Path) -> Result<(), InputError> {
        let panel = |title: &str, pick: &dyn Fn(&Row) -> f64, model: bool| {
            let line = |p: f64, pick: &dyn Fn(&Row) -> f64| {
                let rows = self.rows.iter().filter(|row| row.p == p);
                rows.map(|row| (row.sigma_deg, pick(row))).collect::<Vec<_>>()
            };
            let rates = [0.0, 0.2, 0.4, 0.5, 0.6];
            let mut series: Vec<Series> = rates
                .iter()
                .map(|p| Series { label: format!("p = {p}"), dashed: false, points: line(*p, pick) })
                .collect();
            if model {
                let closed =
                    |p: &f64| Series { label: String::new(), dashed: true, points: line(*p, &|row| row.closed_form) };
                series.extend(rates.iter().map(closed));
            }
            Panel {
                title: title.to_owned(),
                x: Axis::linear("noise sigma, deg", 0.0, 60.0, 10.0),
                y: Axis::linear("path / straight line", 0.5, 4.5, 0.5),
                series,
                bars: Vec::new(),
                level: None,
            }
        };
        let chart = Chart {
            title: format!("Excess travel over outlier rate and noise, {} trials a point (fig. 3)", self.trials),
            panels: vec![
                panel("greedy; dashed: 1 / ((1 - p) exp(-sigma^2 / 2))", &|row| row.greedy_stretch.mean, true),
                panel("filtered, with our own position", &|row| row.filtered_stretch.mean, false),
            ],
        };
        chart.draw(path)
    }

    fn draw_histograms(&self, path: &Path) -> Result<(), InputError> {
        let sigmas = SIGMAS_DEG.into_iter().enumerate().filter(|(k, _)| [0, 2, 3, 5, 7].contains(k));
        let over_sigma: Vec<(String, &Row)> = sigmas
            .filter_map(|(_, sigma_deg)| {
                Some((format!("sigma = {sigma_deg:.0} deg"), self.row(FIG_4_RATE, sigma_deg)?))
            })
            .collect();
        let rates = [0.0, 0.2, 0.2667, 0.4, 0.6];
        let over_rate: Vec<(String, &Row)> =
            rates.into_iter().filter_map(|p| Some((format!("p = {p}"), self.row(p, FIG_4_SIGMA_DEG)?))).collect();
        let panel = |title: &str, rows: &[(String, &Row)], pick: &dyn Fn(&Row) -> &Stretch, to: f64| Panel {
            title: title.to_owned(),
            x: Axis::linear("path / straight line", 0.5, to, 0.5),
            y: Axis::linear("share of trials in a bin of 0.05", 0.0, 1.0, 0.1),
            series: rows
                .iter()
                .map(|(label, row)| Series {
                    label: label.clone(),
                    dashed: false,
                    points: histogram(&pick(row).all, to),
                })
                .collect(),
            bars: Vec::new(),
            level: None,
        };
        let chart = Chart {
            title: format!("Distribution of the excess travel, {} trials a line (fig. 4)", self.trials),
            panels: vec![
                panel("greedy, p = 0.2667", &over_sigma, &|row| &row.greedy_stretch, 3.5),
                panel("greedy, sigma = 0.4654 rad", &over_rate, &|row| &row.greedy_stretch, 3.5),
                panel("filtered, p = 0.2667", &over_sigma, &|row| &row.filtered_stretch, 3.5),
                panel("filtered, sigma = 0.4654 rad", &over_rate, &|row| &row.filtered_stretch, 3.5),
            ],
        };
        chart.draw(path)
    }

    fn row(&self, p: f64, sigma_deg: f64) -> Option<&Row> {
        self.rows.iter().find(|row| row.p == p && row.sigma_deg == sigma_deg)
    }
}

/// Shares in bins of 0.05 from 0.5 on, as the outline of their bars.
fn histogram(values: &[f64], to: f64) -> Vec<(f64, f64)> {
    const WIDTH: f64 = 0.05;
    const FROM: f64 = 0.5;
    let mut counts = vec![0_u32; libm::ceil((to - FROM) / WIDTH) as usize];
    for value in values {
        if let Some(count) = counts.get_mut(((value - FROM).max(0.0) / WIDTH) as usize) {
            *count += 1;
        }
    }
    let bars = counts.into_iter().enumerate().flat_map(|(bin, count)| {
        let (left, share) = (FROM + WIDTH * bin as f64, f64::from(count) / values.len().max(1) as f64);
        [(left, share), (left + WIDTH, share)]
    });
    bars.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_counts_each_trial_once() {
        let shares = histogram(&[1.0, 1.01, 1.2, 9.0], 3.5);
        let area: f64 = shares.chunks(2).map(|bar| bar[0].1).sum();
        assert!((area - 0.75).abs() < 1e-12, "one is outside: {area}");
    }
}
