//! `apf-density`: the main paper's comparison of planners on maps of growing obstacle density (Table I, fig. 9 and 10).
//!
//! The paper prints mean and variance of its five maps and flies each seven times; [`crate::drive::maps`] draws maps to
//! these numbers, four to each, and pairs of starts and goals between which there is a path. Every pair is flown by
//!
//! - the paper's planner and its baseline as published: a kinematic point, by [`Rules`];
//! - both once more, and ours, as the product flies: dynamics, tracker and guard, [`crate::drive::flight`].
//!
//! The paper leaves much open; the report says what the numbers become when it is read otherwise. Lengths are compared as
//! the paper does: over the straight line, on the pairs that all of those compared reach.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner::{self, Kind};
use serde::Serialize;
use serde_json::{Value, json};

use super::beside::{self, empty, judged, line, signed};
use super::chart::{Axis, Bar, Bars, Chart, Panel, Series};
use super::kinematic::Rules;
use super::potential::draw_heat;
use super::settings::Settings;
use crate::drive::maps::{self, TABLE_I};
use crate::drive::suite::{self, Selection, Tally, wilson_95};
use crate::scenario::input::InputError;
use crate::study::reproduce::{Beside, Judgement, Study, Verdict, Watch};

mod flights;

use flights::{AS_PUBLISHED, AllFlown, Pictured, READINGS, drawn, fly_published};
pub use flights::{Columns, INSTANCES, Planners, RelativeLength};

/// Flights that the paper flies on each of its maps.
const PRINTED_RUNS: usize = 7;
/// Rates of an independent kinematic reproduction on maps of its own, baseline and paper, and how near is as good.
const INDEPENDENT: [f64; 2] = [0.23, 0.72];
const INDEPENDENT_WITHIN: f64 = 0.06;
/// What the paper says: the success rate grows by 46 %, the relative length falls by 1.2 %.
const PRINTED_GAINS_PERCENT: [f64; 2] = [46.0, -1.2];

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `apf-density`.
    pub experiment: &'static str,
    /// Seed of maps, pairs and flights.
    pub seed: u64,
    /// Pairs of each row.
    pub pairs: u32,
    /// Rules of the flights as published.
    pub rules: Rules,
    /// A row of Table I each.
    pub rows: Vec<Row>,
    /// All together.
    pub all: Columns,
    /// All together, the paper read otherwise.
    pub readings: Vec<Read>,
    /// What the paper says of all: growth of the success rate, and of the relative length, percent.
    pub printed_gains_percent: [f64; 2],
    #[serde(skip)]
    pictured: Option<Pictured>,
}

/// A map of Table I.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Which, from 1.
    pub map: u32,
    /// Its mean density.
    pub mean: f64,
    /// Its variance.
    pub variance: f64,
    /// How its pairs were flown.
    #[serde(flatten)]
    pub columns: Columns,
    /// What the paper says about it.
    pub printed: Printed,
}

/// The paper read otherwise.
#[derive(Clone, Debug, Serialize)]
pub struct Read {
    /// What is otherwise.
    pub reading: &'static str,
    /// The rules.
    pub rules: Rules,
    /// The baseline.
    pub standard: Tally,
    /// The paper's planner.
    pub paper: Tally,
}

/// What the paper prints about a map. The numbers behind its fig. 9 and 10 are not printed, but for the fifth map's.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Printed {
    /// Flights.
    pub runs: usize,
    /// The baseline's success rate.
    pub standard: Option<f64>,
    /// Its 95 % interval.
    pub standard_95: Option<[f64; 2]>,
    /// The paper's planner's.
    pub paper: Option<f64>,
    /// Its 95 % interval.
    pub paper_95: Option<[f64; 2]>,
}

impl Printed {
    fn of(map: u32) -> Self {
        let (standard, paper) = if map == maps::STEP_ROW { (Some(0), Some(4)) } else { (None, None) };
        let rate = |success: usize| success as f64 / PRINTED_RUNS as f64;
        let interval = |success: usize| wilson_95(success, PRINTED_RUNS);
        Self {
            runs: PRINTED_RUNS,
            standard: standard.map(rate),
            standard_95: standard.and_then(interval),
            paper: paper.map(rate),
            paper_95: paper.and_then(interval),
        }
    }
}

/// How many flights an experiment with that many pairs a row has.
#[must_use]
pub fn flights(pairs: u32) -> u64 {
    (3 + 2 + 2 * READINGS.len() as u64) * TABLE_I.len() as u64 * u64::from(pairs)
}

/// `72.5 % (69..76)`.
fn rate(tally: &Tally) -> String {
    match (tally.success_rate, tally.success_rate_95) {
        (Some(rate), Some([low, high])) => {
            format!("{:.1} % ({:.0}..{:.0})", 100.0 * rate, 100.0 * low, 100.0 * high)
        }
        _ => "-".to_owned(),
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"))
}

fn near(tally: &Tally, independent: f64) -> bool {
    tally.success_rate.is_some_and(|rate| (rate - independent).abs() <= INDEPENDENT_WITHIN)
}

impl Study for Report {
    const NAME: &'static str = "apf-density";
    const TITLE: &'static str = "Planners on maps of growing obstacle density";
    const SOURCE: &'static str = "main paper, Table I, fig. 9 and 10";
    const NOTE: &'static str = "\
        The paper prints mean and variance of its maps, flies each seven times, and prints rates for the fifth \
        only; maps of these numbers are drawn here. Its planner and its baseline fly as published, as a point; \
        Foxhound flies with dynamics, tracker and guard. What the numbers become when the paper is read otherwise \
        is among all numbers.";

    fn chosen(settings: &Settings) -> Value {
        json!({ "seed": settings.seed, "pairs": settings.pairs })
    }

    fn length(settings: &Settings) -> Option<u64> {
        Some(flights(settings.pairs))
    }

    fn run(settings: &Settings, watch: Watch<'_>) -> Result<Self, InputError> {
        let suite = drawn(settings)?;
        let flights = suite.flights(settings.seed, &Selection::default());
        let rules = Rules::default();
        let done = AtomicUsize::new(0);
        let tick = |count: usize| watch((done.fetch_add(count, Ordering::Relaxed) + count) as u64);
        let published = |names, rules| {
            let columns = fly_published(&flights, names, rules, suite.drone_radius);
            tick(2 * flights.len());
            columns
        };
        let [standard, paper] = published(AS_PUBLISHED, rules)?;
        let mut readings = Vec::with_capacity(READINGS.len());
        for reading in READINGS {
            let rules = (reading.rules)(rules);
            let [standard, paper] = published(reading.planners, rules)?;
            let (standard, paper) = (Tally::of(&standard), Tally::of(&paper));
            readings.push(Read { reading: reading.name, rules, standard, paper });
        }
        let jobs = std::thread::available_parallelism().map_or(1, usize::from);
        let full_loop = |kind| suite::fly_all(&flights, kind, Estimator::CrossSpectrum, jobs, |_| tick(1));
        let flown = AllFlown {
            flights: &flights,
            by: Planners {
                standard,
                paper,
                standard_full_loop: full_loop(planner::Config::of(Kind::Standard))?,
                paper_full_loop: full_loop(planner::Config::of(Kind::Paper))?,
                ours: full_loop(planner::Config::of(Kind::Foxhound))?,
            },
        };
        let rows = (1..).zip(TABLE_I).map(|(map, density)| Row {
            map,
            mean: density.mean,
            variance: density.variance,
            columns: flown.columns(|place| place.row == map),
            printed: Printed::of(map),
        });
        Ok(Self {
            experiment: "apf-density",
            seed: settings.seed,
            pairs: settings.pairs,
            rules,
            rows: rows.collect(),
            all: flown.columns(|_| true),
            readings,
            printed_gains_percent: PRINTED_GAINS_PERCENT,
            pictured: flown.pictured(rules)?,
        })
    }

    fn table(&self) -> String {
        let mut text = format!(
            "{} pairs a row; reached (95 % interval), collisions, length over the shortest way, the paper's own number\n\
             standard and paper: a point, as published; in loop: with dynamics, tracker and guard\n",
            self.pairs
        );
        let all = ("all rows".to_owned(), &self.all, None);
        let rows = self.rows.iter().map(|row| {
            let name = format!("row {} of Table I: mean {:.4}, variance {:.4}", row.map, row.mean, row.variance);
            (name, &row.columns, Some(&row.printed))
        });
        for (name, columns, printed) in rows.chain([all]) {
            let _ = writeln!(text, "\n{name}");
            for (index, (planner, tally)) in columns.tallies.named().into_iter().enumerate() {
                let said = match (index, printed) {
                    (0, Some(Printed { standard: Some(rate), standard_95: Some(interval), .. }))
                    | (1, Some(Printed { paper: Some(rate), paper_95: Some(interval), .. })) => {
                        let [low, high] = interval.map(|bound| 100.0 * bound);
                        format!("   printed {:.1} % of {PRINTED_RUNS} flights ({low:.0}..{high:.0})", 100.0 * rate)
                    }
                    (0 | 1, Some(_)) => "   printed: a figure without numbers".to_owned(),
                    _ => String::new(),
                };
                let _ = writeln!(
                    text,
                    "  {planner:<18}{:>19} {:>4} collisions  {:>6}{said}",
                    rate(tally),
                    tally.collisions,
                    number(tally.mean_whole_length_ratio)
                );
            }
            let relative = &columns.relative_length;
            let lengths = relative.of.named().map(|(_, length)| number(*length)).join(", ");
            let _ = writeln!(
                text,
                "  over the straight line, the {} pairs that all five reach, in this order: {lengths}",
                relative.pairs
            );
        }
        let gain = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{:+.1}", 100.0 * value));
        let (all, length) = (&self.all.tallies, &self.all.relative_length.of);
        let gained = all.paper.success_rate.zip(all.standard.success_rate).map(|(paper, standard)| paper - standard);
        let _ = writeln!(
            text,
            "\nfrom standard to paper: {} points reached (printed {:+.0} %), {} % of length (printed {:+.1} %)",
            gain(gained),
            self.printed_gains_percent[0],
            gain(length.paper.zip(length.standard).map(|(paper, standard)| paper / standard - 1.0)),
            self.printed_gains_percent[1],
        );
        self.write_readings(&mut text);
        text
    }

    /// Draws the rates with their intervals and the relative lengths, and a flight in its potential; says which
    /// files these are.
    fn figures(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let [chart, map] = ["apf-density.svg", "apf-density-map.svg"].map(|name| folder.join(name));
        self.chart().draw(&chart)?;
        let Some(pictured) = &self.pictured else { return Ok(vec![chart]) };
        draw_heat(&[pictured.scene()], &map)?;
        Ok(vec![chart, map])
    }

    /// Success rates, and what the paper's planner gains on its baseline.
    fn verdict(&self) -> Vec<Beside> {
        let mut lines = Vec::new();
        for row in &self.rows {
            let printed = |share: Option<f64>| {
                share.map_or_else(
                    || "a bar without a number".to_owned(),
                    |rate| format!("{:.1} % of {}", 100.0 * rate, row.printed.runs),
                )
            };
            let what = |planner: &str| format!("reached, {planner}, map {} (density {:.4})", row.map, row.mean);
            let standard = [printed(row.printed.standard), beside::rate(&row.columns.tallies.standard), empty()];
            let paper = [
                printed(row.printed.paper),
                beside::rate(&row.columns.tallies.paper),
                beside::rate(&row.columns.tallies.ours),
            ];
            lines.push(line::<Self>(what("baseline"), standard));
            lines.push(line::<Self>(what("planner"), paper));
        }
        let Columns { tallies: all, relative_length: RelativeLength { of: lengths, .. } } = &self.all;
        let gain = |better: &Tally| {
            let gained = better.success_rate.zip(all.standard.success_rate).map(|(better, base)| better - base);
            gained.map_or_else(empty, |gained| format!("{:+.1} points", 100.0 * gained))
        };
        let shorter = |length: Option<f64>| {
            let ratio = length.zip(lengths.standard).map(|(length, base)| length / base - 1.0);
            ratio.map_or_else(empty, |ratio| format!("{:+.1} %", 100.0 * ratio))
        };
        let [success, length] = self.printed_gains_percent;
        let words = [format!("{success:+.0} %"), gain(&all.paper), gain(&all.ours)];
        lines.push(line::<Self>("reached, more than the baseline, all maps".to_owned(), words));
        let words = [format!("{length:+.1} %"), shorter(lengths.paper), shorter(lengths.ours)];
        lines.push(line::<Self>("path, longer than the baseline's, pairs that all reach".to_owned(), words));
        lines
    }

    fn judgements(&self) -> Vec<Judgement> {
        let Columns { tallies: all, relative_length: RelativeLength { of: lengths, .. } } = &self.all;
        let points = |better: &Tally| {
            100.0 * better.success_rate.zip(all.standard.success_rate).map_or(f64::NAN, |(better, base)| better - base)
        };
        let longer = |length: Option<f64>| {
            100.0 * length.zip(lengths.standard).map_or(f64::NAN, |(length, base)| length / base - 1.0)
        };
        let [success, length] = self.printed_gains_percent;
        let last = self.rows.last();
        let of_last = |pick: fn(&Planners<Tally>) -> &Tally| {
            last.map_or_else(empty, |row| beside::rate(pick(&row.columns.tallies)))
        };
        let maps = "Maps of the printed mean and variance are drawn here, since the paper's own are not at hand";
        let (theirs, ours) = (points(&all.paper), points(&all.ours));
        let rates = format!(
            "The paper's planner reaches {} points more than the baseline where {success:+.0} % are printed, and on the \
             fifth map {} against the baseline's {}; Foxhound, with dynamics, {} points and {} there.",
            signed(theirs, 1),
            of_last(|by| &by.paper),
            of_last(|by| &by.standard),
            signed(ours, 1),
            of_last(|by| &by.ours)
        );
        let (their_length, our_length) = (longer(lengths.paper), longer(lengths.ours));
        let why = format!(
            "Where all reach, the path of the paper's planner differs from the baseline's by {} % where {length:+.1} % are \
             printed; Foxhound's by {} %.",
            signed(their_length, 1),
            signed(our_length, 1)
        );
        let is_near = |here: f64, printed: f64| (here - printed).abs() <= 5.0;
        vec![
            judged::<Self>("main paper, Table I", Verdict::Reproduced, format!("{maps}.")),
            judged::<Self>("main paper, fig. 9", Verdict::of(is_near(theirs, success), ours >= success), rates),
            judged::<Self>(
                "main paper, fig. 10",
                Verdict::of(is_near(their_length, length), our_length <= length),
                why,
            ),
        ]
    }
}

impl Report {
    fn write_readings(&self, text: &mut String) {
        let [standard, paper] = INDEPENDENT.map(|rate| 100.0 * rate);
        let _ = writeln!(
            text,
            "\nThe paper read otherwise, as published, all rows; * within {:.0} points of an independent reproduction's \
             {standard:.0} and {paper:.0} %\n{:<34}{:>21}{:>7}{:>21}{:>7}",
            100.0 * INDEPENDENT_WITHIN,
            "",
            "standard",
            "hit",
            "paper",
            "hit"
        );
        let base = ("as in the rows above", &self.all.tallies.standard, &self.all.tallies.paper);
        let others = self.readings.iter().map(|read| (read.reading, &read.standard, &read.paper));
        for (name, standard, paper) in std::iter::once(base).chain(others) {
            let starred = |tally: &Tally, independent| {
                format!("{} {}", rate(tally), if near(tally, independent) { '*' } else { ' ' })
            };
            let _ = writeln!(
                text,
                "  {name:<32}{:>21}{:>7}{:>21}{:>7}",
                starred(standard, INDEPENDENT[0]),
                standard.collisions,
                starred(paper, INDEPENDENT[1]),
                paper.collisions
            );
        }
        text.push_str(
            "The baseline moves with what counts as reached; the paper's planner with what is known of the pillars: most of\n\
             its collisions are with some that it had not seen.\n",
        );
    }

    fn chart(&self) -> Chart {
        let bars = |index: usize, name: &str| {
            let bar = |row: &Row| {
                let (_, tally) = row.columns.tallies.named()[index];
                let (rate, [low, high]) = (tally.success_rate?, tally.success_rate_95?);
                let [value, low, high] = [rate, low, high].map(|share| 100.0 * share);
                Some(Bar { value, low, high })
            };
            Bars { label: name.to_owned(), bars: self.rows.iter().map(bar).collect() }
        };
        let length = |index: usize, name: &str| {
            let points = self
                .rows
                .iter()
                .filter_map(|row| Some((f64::from(row.map), (*row.columns.relative_length.of.named()[index].1)?)));
            Series { label: name.to_owned(), dashed: false, points: points.collect() }
        };
        let rows = || Axis::counted("row of Table I", TABLE_I.len() as u32);
        let names = self.all.tallies.named();
        let panels = vec![
            Panel {
                title: format!("reached, of {} pairs a row, and 95 % interval (fig. 9)", self.pairs),
                x: rows(),
                y: Axis::linear("%", 0.0, 100.0, 10.0),
                series: Vec::new(),
                bars: names.iter().enumerate().map(|(index, (name, _))| bars(index, name)).collect(),
                level: None,
            },
            Panel {
                title: "length over the straight line, pairs that all reach (fig. 10)".to_owned(),
                x: rows(),
                y: Axis::linear("", 0.9, 2.0, 0.1),
                series: names.iter().enumerate().map(|(index, (name, _))| length(index, name)).collect(),
                bars: Vec::new(),
                level: Some((1.0, "the straight line".to_owned())),
            },
        ];
        Chart { title: "Planners on maps of growing obstacle density".to_owned(), panels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_gets_its_pairs_and_few_pairs_leave_no_map_without_any() {
        let counts = |pairs| -> Vec<usize> {
            let suite = drawn(&Settings { seed: 5, pairs, ..Settings::default() }).unwrap();
            suite.maps.iter().map(|map| map.pairs.len()).collect()
        };
        assert_eq!(counts(6), [2, 2, 1, 1].repeat(5));
        assert_eq!(counts(1), [1; 5]);
    }
}
