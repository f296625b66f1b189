//! Table 3 and fig. 5 and 6 of the paper, our numbers beside its.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{DrawingBackend, RGBColor};
use plotters::style::text_anchor::{HPos, VPos};
use serde::Serialize;
use serde_json::{Value, json};

use super::agent::Kind;
use super::cycle::STEP_M;
use super::plan::Plan;
use super::radio::Link;
use super::scenarios::{CLASSES, PLANS, Scenario};
use super::trial::{CYCLES_MAX, Noise, Trial};
use crate::drive::suite::wilson_95;
use crate::record::sheet::{Drawn, FAINT_INK, GROUND, INK, Map, fill, line, path, text, write_svg};
use crate::scenario::input::InputError;
use crate::study::reproduce::beside::{self, empty, judged, percent, shown};
use crate::study::reproduce::chart::{Axis, Chart, Panel, Series};
use crate::study::reproduce::settings::Settings;
use crate::study::reproduce::{Beside, Judgement, Study, Verdict, Watch};
use crate::world::Horizontal;

/// What the paper prints at 0.35 rad (table 3): success rate and duration over the baseline's, of the baseline, of the
/// filters without covariance minimisation and with it.
const PRINTED: [[f64; 2]; 3] = [[0.895, 1.0], [0.945, 0.82], [0.945, 0.76]];
/// The paper prints no limit of a search. The limit of the path here is the first of these steps at which the baseline
/// solves as much as it does there.
const LIMIT_STEP_M: f64 = 5.0;
/// Right end of the profile's axis.
const TAU_MAX: f64 = 6.0;

/// All searches at one noise, by agent and scenario.
pub(super) struct Searched {
    pub(super) noise: Noise,
    pub(super) trials: Vec<Vec<Trial>>,
}

/// The experiment's result.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// `mmwave`.
    pub experiment: &'static str,
    /// Seed of plans, scenarios and noise.
    pub seed: u64,
    /// Scenarios.
    pub scenarios: usize,
    /// Plans.
    pub plans: u32,
    /// Path length after which a search counts as failed.
    pub limit_m: f64,
    /// By noise.
    pub noises: Vec<AtNoise>,
    /// Success rate and relative duration that the paper prints: baseline, without and with covariance minimisation.
    pub printed: [[f64; 2]; 3],
    #[serde(skip)]
    profiles: Vec<Vec<Vec<Vec<f64>>>>,
    #[serde(skip)]
    pictured: Option<Pictured>,
}

/// Results at one noise.
#[derive(Clone, Debug, Serialize)]
pub struct AtNoise {
    /// The noise.
    #[serde(flatten)]
    pub noise: Noise,
    /// By agent.
    pub agents: Vec<Row>,
}

/// An agent's results at one noise.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Which.
    pub agent: Kind,
    /// All scenarios.
    #[serde(flatten)]
    pub all: Tally,
    /// By the link at the start.
    pub classes: Vec<Class>,
}

/// Results of one class of scenarios.
#[derive(Clone, Debug, Serialize)]
pub struct Class {
    /// The link at the start.
    pub start: Link,
    /// Its scenarios.
    #[serde(flatten)]
    pub tally: Tally,
}

/// Counts and means over scenarios.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Tally {
    /// Scenarios.
    pub scenarios: usize,
    /// Found within the limit.
    pub found: usize,
    /// Share of them.
    pub success_rate: f64,
    /// Its 95 % interval.
    pub success_rate_95: [f64; 2],
    /// Share found in all cycles that are simulated.
    pub success_rate_unlimited: f64,
    /// Sum of path lengths over the baseline's, of the scenarios that both solve, however long it takes.
    pub relative_length: Option<f64>,
    /// The same with cycles in place of lengths.
    pub relative_cycles: Option<f64>,
    /// Mean path length of what was found, however long it took.
    pub mean_length_m: Option<f64>,
}

/// A search for the picture.
#[derive(Clone, Debug)]
struct Pictured {
    plan: Plan,
    transmitter: Horizontal,
    start: Horizontal,
    points: Vec<Horizontal>,
    paths: Vec<(&'static str, Vec<Horizontal>)>,
}

impl Tally {
    fn of(trials: &[&Trial], baseline: &[&Trial], limit_m: f64) -> Self {
        let scenarios = trials.len();
        let found = trials.iter().filter(|trial| trial.found && trial.length_m <= limit_m).count();
        let ever: Vec<&&Trial> = trials.iter().filter(|trial| trial.found).collect();
        let both: Vec<(&&Trial, &&Trial)> = trials.iter().zip(baseline).filter(|(a, b)| a.found && b.found).collect();
        let relative = |of: &dyn Fn(&Trial) -> f64| {
            let [ours, theirs] = both.iter().fold([0.0, 0.0], |sums, (a, b)| [sums[0] + of(a), sums[1] + of(b)]);
            (theirs > 0.0).then(|| ours / theirs)
        };
        let share = |count: usize| if scenarios > 0 { count as f64 / scenarios as f64 } else { 0.0 };
        Self {
            scenarios,
            found,
            success_rate: share(found),
            success_rate_95: wilson_95(found, scenarios).unwrap_or([0.0, 1.0]),
            success_rate_unlimited: share(ever.len()),
            relative_length: relative(&|trial| trial.length_m),
            relative_cycles: relative(&|trial| f64::from(trial.cycles)),
            mean_length_m: (!ever.is_empty())
                .then(|| ever.iter().map(|trial| trial.length_m).sum::<f64>() / ever.len() as f64),
        }
    }
}

/// The index of an agent among all.
fn index_of(kind: Kind) -> usize {
    Kind::ALL.iter().position(|other| *other == kind).unwrap_or(0)
}

impl Report {
    pub(super) fn of(settings: &Settings, plans: Vec<Plan>, scenarios: &[Scenario], searched: Vec<Searched>) -> Self {
        let baseline = index_of(Kind::Follow);
        let noisy = searched.iter().position(|at| at.noise.sigma_rad > 0.0).unwrap_or(0);
        let limit_m = limit_m(&searched[noisy].trials[baseline]);
        let chosen = |class: Option<Link>| -> Vec<usize> {
            (0..scenarios.len()).filter(|k| class.is_none_or(|class| scenarios[*k].link == class)).collect()
        };
        let tally = |at: &Searched, agent: usize, class: Option<Link>| {
            let of =
                |agent: usize| -> Vec<&Trial> { chosen(class).into_iter().map(|k| &at.trials[agent][k]).collect() };
            Tally::of(&of(agent), &of(baseline), limit_m)
        };
        let noises = searched.iter().map(|at| {
            let agents = Kind::ALL.into_iter().enumerate().map(|(index, agent)| Row {
                agent,
                all: tally(at, index, None),
                classes: CLASSES.map(|start| Class { start, tally: tally(at, index, Some(start)) }).to_vec(),
            });
            AtNoise { noise: at.noise, agents: agents.collect() }
        });
        let profiles = searched.iter().map(|at| CLASSES.map(|class| profile(at, &chosen(Some(class)))).to_vec());
        Self {
            experiment: "mmwave",
            seed: settings.seed,
            scenarios: scenarios.len(),
            plans: PLANS,
            limit_m,
            noises: noises.collect(),
            printed: PRINTED,
            profiles: profiles.collect(),
            pictured: pictured(&plans, scenarios, &searched[noisy]),
        }
    }

    fn chart(&self, at: usize) -> Chart {
        let panel = |(class, taus): (Link, &Vec<Vec<f64>>)| Panel {
            title: match class {
                Link::LineOfSight => "start in line of sight",
                Link::FirstOrder => "start behind one reflection",
                _ => "start behind more reflections",
            }
            .to_owned(),
            x: Axis::linear("path length over the shortest", 1.0, TAU_MAX, 1.0),
            y: Axis::linear("% solved", 0.0, 100.0, 10.0),
            series: Kind::ALL.into_iter().zip(taus).map(|(kind, taus)| series(kind, taus)).collect(),
            bars: Vec::new(),
            level: None,
        };
        let sigma_rad = self.noises[at].noise.sigma_rad;
        Chart {
            title: format!("Performance profiles (fig. 6), noise of the angle of arrival {sigma_rad:.2} rad"),
            panels: CLASSES.into_iter().zip(&self.profiles[at]).map(panel).collect(),
        }
    }
}

impl Study for Report {
    const NAME: &'static str = "mmwave";
    const TITLE: &'static str = "Agents that look for a transmitter indoors";
    const SOURCE: &'static str = "mmWave paper, Table 3, fig. 5 and 6";
    const NOTE: &'static str = "\
        The paper's flats and ray tracings are not at hand: flats are drawn here, and the strongest path is traced. \
        It prints no limit of a search; the limit here is the path at which the baseline finds as much as it does \
        there. That minimising the covariance shortens the way does not come out.";

    fn chosen(settings: &Settings) -> Value {
        json!({ "seed": settings.seed, "scenarios": settings.scenarios })
    }

    fn length(settings: &Settings) -> Option<u64> {
        Some(super::searches(settings.scenarios))
    }

    fn run(settings: &Settings, watch: Watch<'_>) -> Result<Self, InputError> {
        super::run(settings, watch)
    }

    fn table(&self) -> String {
        let mut text = format!(
            "{} scenarios on {} plans; found within {} m of path, at which the baseline finds what the paper prints for it \
             ({:.1} %), 95 % interval;\nin all {} cycles; path length and cycles over the baseline's, where both find\n",
            self.scenarios,
            self.plans,
            self.limit_m,
            100.0 * PRINTED[0][0],
            CYCLES_MAX
        );
        for at in &self.noises {
            let _ = write!(text, "\nnoise of the angle of arrival {:.2} rad", at.noise.sigma_rad);
            if at.noise.link_error_rate > 0.0 {
                let _ = write!(text, ", state of the link told wrongly in {:.0} %", 100.0 * at.noise.link_error_rate);
            }
            let starts = "   by start: direct, one reflection, more";
            let _ = writeln!(text, "\n{:<28}{:>20}{:>8}{:>8}{:>8}{starts}", "", "found", "ever", "length", "cycles");
            for row in &at.agents {
                let [low, high] = row.all.success_rate_95.map(|bound| 100.0 * bound);
                let _ = write!(
                    text,
                    "  {:<26}{:>20}{:>8}{:>8}{:>8}",
                    row.agent.label(),
                    format!("{:.1} % ({low:.0}..{high:.0})", 100.0 * row.all.success_rate),
                    format!("{:.1} %", 100.0 * row.all.success_rate_unlimited),
                    number(row.all.relative_length),
                    number(row.all.relative_cycles)
                );
                for class in &row.classes {
                    let of = &class.tally;
                    let _ = write!(text, "   {:>3}/{} {:>5}", of.found, of.scenarios, number(of.relative_length));
                }
                text.push('\n');
            }
            if at.noise.sigma_rad > 0.0 && at.noise.link_error_rate == 0.0 {
                let [baseline, without, with] = PRINTED.map(|[rate, _]| 100.0 * rate);
                let _ = writeln!(
                    text,
                    "  printed: baseline {baseline:.1} %, filters {without:.1} % and {:.2}, with covariance minimisation \
                     {with:.1} % and {:.2}",
                    PRINTED[1][1], PRINTED[2][1]
                );
            }
        }
        text
    }

    /// Draws the performance profiles and a map with paths; says which files these are.
    fn figures(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let mut files = Vec::new();
        for (at, name) in [(0, "mmwave-noise-free.svg"), (1, "mmwave-noisy.svg")] {
            let file = folder.join(name);
            self.chart(at).draw(&file)?;
            files.push(file);
        }
        if let Some(pictured) = &self.pictured {
            let file = folder.join("mmwave-map.svg");
            pictured.draw(&file)?;
            files.push(file);
        }
        Ok(files)
    }

    /// Who finds the transmitter at the paper's noise, and how far they go.
    fn verdict(&self) -> Vec<Beside> {
        let Some(noisy) = self.noises.get(1) else { return Vec::new() };
        // Behind the one that knows the transmitter: the baseline, the paper's switch, ours without and with minimisation.
        let [_, follow, switch, estimate, belief] = noisy.agents.as_slice() else { return Vec::new() };
        let [baseline, without, with] = self.printed;
        let found = |share: f64| percent(Some(share));
        let length = |ratio: Option<f64>| ratio.map_or_else(empty, |ratio| format!("{ratio:.2}"));
        let entry = |what: &str, words: [String; 3]| beside::line::<Self>(what.to_owned(), words);
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

    fn judgements(&self) -> Vec<Judgement> {
        let Some(noisy) = self.noises.get(1) else { return Vec::new() };
        let [_, _, switch, estimate, belief] = noisy.agents.as_slice() else { return Vec::new() };
        let [_, without, with] = self.printed;
        let rate = |row: &Row| 100.0 * row.all.success_rate;
        let length = |row: &Row| row.all.relative_length.unwrap_or(f64::NAN);
        let is_near = |row: &Row, printed: [f64; 2]| {
            (rate(row) - 100.0 * printed[0]).abs() <= 3.0 && (length(row) - printed[1]).abs() <= 0.05
        };
        let table = format!(
            "Its switch finds {:.1} % at {} of the baseline's path where {:.1} % and {:.2} are printed; minimising the covariance, \
             which should shorten it to {:.2}, gives {} here against {} without.",
            rate(switch),
            shown(length(switch), 2),
            100.0 * without[0],
            without[1],
            with[1],
            shown(length(belief), 2),
            shown(length(estimate), 2)
        );
        let is_better = rate(belief) >= 100.0 * with[0] && length(belief) <= with[1];
        // The paper claims that minimising shortens the path.
        let is_shorter = length(belief) < length(estimate);
        let verdict = Verdict::of(is_shorter && is_near(switch, without) && is_near(belief, with), is_better);
        let flats = "The paper's flats are not at hand: flats are drawn here";
        vec![
            judged::<Self>("mmWave paper, Table 3", verdict, table),
            judged::<Self>(
                "mmWave paper, fig. 5",
                Verdict::Reproduced,
                format!("{flats}, and a search of the same kind is drawn: walls, directions and path."),
            ),
            judged::<Self>(
                "mmWave paper, fig. 6",
                verdict,
                format!(
                    "{flats}, and their profiles follow Table 3: the order of the agents with and without minimising is another."
                ),
            ),
        ]
    }
}

/// The first limit at which the baseline finds as much as the paper prints for it.
fn limit_m(baseline: &[Trial]) -> f64 {
    let wanted = PRINTED[0][0] * baseline.len() as f64;
    let found = |limit_m: f64| baseline.iter().filter(|trial| trial.found && trial.length_m <= limit_m).count() as f64;
    let most_m = STEP_M * f64::from(CYCLES_MAX);
    let steps = libm::floor(most_m / LIMIT_STEP_M) as u32;
    (1..=steps).map(|k| f64::from(k) * LIMIT_STEP_M).find(|limit_m| found(*limit_m) >= wanted).unwrap_or(most_m)
}

/// By agent, the ratios of path lengths to the shortest of all agents, ascending; infinite where nothing was found.
fn profile(at: &Searched, chosen: &[usize]) -> Vec<Vec<f64>> {
    let length_m = |agent: usize, k: usize| {
        let trial = &at.trials[agent][k];
        if trial.found { trial.length_m } else { f64::INFINITY }
    };
    let ratios = |agent: usize| {
        let mut ratios: Vec<f64> = (chosen.iter())
            .map(|k| {
                let least_m = (0..at.trials.len()).map(|other| length_m(other, *k)).fold(f64::INFINITY, f64::min);
                if least_m.is_finite() { length_m(agent, *k) / least_m } else { f64::INFINITY }
            })
            .collect();
        ratios.sort_by(f64::total_cmp);
        ratios
    };
    (0..at.trials.len()).map(ratios).collect()
}

/// A staircase.
fn series(kind: Kind, taus: &[f64]) -> Series {
    let mut points = vec![(1.0, 0.0)];
    let percent = |count: usize| 100.0 * count as f64 / taus.len().max(1) as f64;
    for (count, tau) in taus.iter().enumerate().filter(|(_, tau)| **tau <= TAU_MAX) {
        points.push((*tau, percent(count)));
        points.push((*tau, percent(count + 1)));
    }
    points.push((TAU_MAX, percent(taus.iter().filter(|tau| **tau <= TAU_MAX).count())));
    Series { label: kind.label().to_owned(), dashed: false, points }
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

/// The scenario behind a reflection on which all find the transmitter, and the baseline's path is the longest of
/// those where it needs no more than four times the shortest path.
fn pictured(plans: &[Plan], scenarios: &[Scenario], at: &Searched) -> Option<Pictured> {
    let [reference, baseline, ours] = [Kind::Reference, Kind::Follow, Kind::Estimate].map(index_of);
    let detour = |k: &usize| at.trials[baseline][*k].length_m / at.trials[reference][*k].length_m.max(1.0);
    let tells = |k: &usize| {
        scenarios[*k].link != Link::LineOfSight
            && at.trials.iter().all(|trials| trials[*k].found)
            && detour(k) < 4.0
            && at.trials[ours][*k].length_m < at.trials[baseline][*k].length_m
    };
    let chosen = (0..scenarios.len()).filter(tells).max_by(|a, b| detour(a).total_cmp(&detour(b)))?;
    let scenario = &scenarios[chosen];
    let path_of = |kind: Kind| (kind.label(), at.trials[index_of(kind)][chosen].path.clone());
    Some(Pictured {
        plan: plans[scenario.plan].clone(),
        transmitter: scenario.start.transmitter,
        start: scenario.start.place,
        points: at.trials[ours][chosen].points.clone(),
        paths: [Kind::Reference, Kind::Follow, Kind::Estimate, Kind::Belief].map(path_of).to_vec(),
    })
}

/// Points a metre, and what is around the map.
const SCALE: f64 = 26.0;
const EDGE: f64 = 40.0;
const HEAD: f64 = 84.0;
const FOOT: f64 = 64.0;
const PATHS: [RGBColor; 4] =
    [RGBColor(148, 156, 168), RGBColor(240, 140, 30), RGBColor(21, 128, 61), RGBColor(62, 74, 137)];
const SEEN: RGBColor = RGBColor(30, 147, 140);

impl Pictured {
    fn draw(&self, file: &Path) -> Result<(), InputError> {
        let [width, height] = self.plan.size_m.map(|side_m| side_m * SCALE);
        write_svg(file, [width + 2.0 * EDGE, HEAD + height + FOOT], |area| self.draw_on(area))
    }

    fn draw_on<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        let [east, north] = self.plan.size_m;
        let map = Map { area, bounds: [0.0, 0.0, east, north], corner: [EDGE, HEAD], scale: SCALE };
        let title = "Looking for a transmitter (fig. 5), noise 0.35 rad; dots: what ours has seen of the walls";
        text(area, title, [EDGE, 36.0], 16.0, INK, (HPos::Left, VPos::Center))?;
        map.rectangle(map.bounds, fill(GROUND, 1.0))?;
        for wall in &self.plan.walls {
            map.path([wall.from, wall.to], line(INK, 1.0, 2.0))?;
        }
        for point in &self.points {
            map.dot(*point, 2.0, fill(SEEN, 1.0))?;
        }
        for (index, ((label, places), color)) in self.paths.iter().zip(PATHS).enumerate() {
            map.path(places.iter().copied(), line(color, 1.0, 2.0))?;
            let [x, y] = [EDGE + 190.0 * index as f64, map.end()[1] + 30.0];
            path(area, [[x, y], [x + 24.0, y]], line(color, 1.0, 2.0))?;
            text(area, label, [x + 32.0, y], 13.0, FAINT_INK, (HPos::Left, VPos::Center))?;
        }
        for (place, name) in [(self.start, "start"), (self.transmitter, "transmitter")] {
            map.dot(place, 5.0, fill(INK, 1.0))?;
            let [x, y] = map.points(place);
            text(area, name, [x + 8.0, y - 8.0], 13.0, INK, (HPos::Left, VPos::Bottom))?;
        }
        Ok(())
    }
}
