//! Summaries of the flights of a suite.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;

use super::Flown;
use crate::drive::flight::Ending;

/// Two-sided 95 % of the normal distribution.
const Z_95: f64 = 1.959_963_985;

/// A summary of flights.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tally {
    /// Flights.
    pub runs: usize,
    /// Those that reached the beacon.
    pub success: usize,
    /// Those that collided with a pillar.
    pub collisions: usize,
    /// Mean of path flown over reference path, of those that reached the beacon.
    pub mean_length_ratio: Option<f64>,
    /// Least clearance of all flights.
    pub min_clearance_m: Option<f64>,
    /// Share that reached the beacon.
    pub success_rate: Option<f64>,
    /// Its 95 % interval after Wilson.
    pub success_rate_95: Option<[f64; 2]>,
    /// As `mean_length_ratio`, with the goal tolerance added to each path.
    pub mean_whole_length_ratio: Option<f64>,
    /// Mean time of those that reached the beacon.
    pub mean_time_s: Option<f64>,
    /// Number of flights by outcome.
    pub outcomes: BTreeMap<String, usize>,
}

impl Tally {
    /// Makes a summary.
    #[must_use]
    pub fn of<'a>(flights: impl IntoIterator<Item = &'a Flown>) -> Self {
        let flights: Vec<&Flown> = flights.into_iter().collect();
        let reached: Vec<&&Flown> = flights.iter().filter(|flown| flown.result == Ending::Reached).collect();
        let mean = |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        let mut outcomes = BTreeMap::new();
        for flown in &flights {
            *outcomes.entry(flown.outcome()).or_default() += 1;
        }
        let (success, runs) = (reached.len(), flights.len());
        Self {
            runs,
            success,
            collisions: flights.iter().filter(|flown| flown.result == Ending::Collision).count(),
            mean_length_ratio: mean(reached.iter().filter_map(|flown| flown.length_ratio).collect()),
            min_clearance_m: flights.iter().filter_map(|flown| flown.min_clearance_m).min_by(f64::total_cmp),
            success_rate: (runs > 0).then(|| success as f64 / runs as f64),
            success_rate_95: wilson_95(success, runs),
            mean_whole_length_ratio: mean(reached.iter().filter_map(|flown| flown.whole_length_ratio).collect()),
            mean_time_s: mean(reached.iter().map(|flown| flown.time_s).collect()),
            outcomes,
        }
    }
}

/// The 95 % interval of a rate after Wilson (1927).
#[must_use]
pub fn wilson_95(success: usize, runs: usize) -> Option<[f64; 2]> {
    if runs == 0 {
        return None;
    }
    let n = runs as f64;
    let rate = success as f64 / n;
    let center = rate + Z_95 * Z_95 / (2.0 * n);
    let half = Z_95 * libm::sqrt(rate * (1.0 - rate) / n + Z_95 * Z_95 / (4.0 * n * n));
    let scale = 1.0 + Z_95 * Z_95 / n;
    Some([((center - half) / scale).max(0.0), ((center + half) / scale).min(1.0)])
}

/// Summary of a row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The row.
    pub row: u32,
    /// Its sums.
    #[serde(flatten)]
    pub tally: Tally,
}

/// Result of a suite: the object that is printed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// By row.
    pub rows: Vec<Row>,
    /// Summary of all rows.
    pub all: Tally,
}

impl Report {
    /// Makes the summaries.
    #[must_use]
    pub fn of(flights: &[Flown]) -> Self {
        let mut rows: BTreeMap<u32, Vec<&Flown>> = BTreeMap::new();
        for flown in flights {
            rows.entry(flown.place.row).or_default().push(flown);
        }
        let rows = rows.into_iter().map(|(row, flights)| Row { row, tally: Tally::of(flights) }).collect();
        Self { rows, all: Tally::of(flights) }
    }

    /// A table for people.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = String::from(
            " row   runs  reached     95 % interval  collisions  length/shortest  to the beacon  least clearance  mean time\n",
        );
        let mut line = |name: &str, tally: &Tally| {
            let number = |value: Option<f64>, digits: usize, unit: &str| {
                value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}{unit}"))
            };
            let interval = tally
                .success_rate_95
                .map_or_else(String::new, |[low, high]| format!("{:.1} .. {:.1} %", 100.0 * low, 100.0 * high));
            let _ = writeln!(
                text,
                "{name:>4} {:>6} {:>8} {interval:>17} {:>11} {:>16} {:>14} {:>16} {:>10}",
                tally.runs,
                number(tally.success_rate.map(|rate| 100.0 * rate), 2, " %"),
                tally.collisions,
                number(tally.mean_length_ratio, 3, ""),
                number(tally.mean_whole_length_ratio, 3, ""),
                number(tally.min_clearance_m, 3, " m"),
                number(tally.mean_time_s, 1, " s"),
            );
        };
        for row in &self.rows {
            line(&row.row.to_string(), &row.tally);
        }
        line("all", &self.all);
        for (outcome, count) in self.all.outcomes.iter().filter(|(outcome, _)| *outcome != "reached") {
            let _ = writeln!(text, "{count:>6} {outcome}");
        }
        text
    }
}
