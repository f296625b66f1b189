//! `multipath`: the whole closed loop, antennas to setpoints, among walls that reflect the beacon's waves and are in their
//! way; with the filters behind the bearing, and the same chain without them.
//!
//! Six kinds of scenes, drawn from a seed and turned at random: the beacon in the open beside one and two reflecting walls,
//! behind a partition with one and two of them, around the corner of a corridor, and in another room. Walls take 6 dB of
//! what they reflect and 30 dB of what goes through; up to three reflections are followed; the beacon has 20 dB of
//! signal-to-noise ratio at 10 m in the open.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde::Serialize;
use serde_json::{Value, json};

use super::beside::{empty, line};
use super::chart::{Axis, Bar, Bars, Chart, Panel};
use super::settings::Settings;
use crate::drive::flight::{Ending, Report as Flown};
use crate::scenario::input::InputError;
use crate::scenario::{Bearing, Scenario, Wall};
use crate::study::flight;
use crate::study::reproduce::{Beside, Study, Watch};
use crate::world::random::Random;

/// A kind of scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// In the open, one reflector.
    OpenOne,
    /// In the open, two reflectors.
    OpenTwo,
    /// Behind a partition, one reflector.
    HiddenOne,
    /// Behind a partition, two reflectors.
    HiddenTwo,
    /// Around the corner of a corridor.
    Corridor,
    /// In another room.
    Room,
}

/// All kinds.
pub const KINDS: [Kind; 6] =
    [Kind::OpenOne, Kind::OpenTwo, Kind::HiddenOne, Kind::HiddenTwo, Kind::Corridor, Kind::Room];

impl Kind {
    fn label(self) -> &'static str {
        match self {
            Self::OpenOne => "open, one reflector",
            Self::OpenTwo => "open, two reflectors",
            Self::HiddenOne => "partition, one reflector",
            Self::HiddenTwo => "partition, two reflectors",
            Self::Corridor => "corridor",
            Self::Room => "other room",
        }
    }
}

/// The chains that are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Chain {
    /// Bearings to the planner, as they come.
    Without,
    /// Link state, bank of filters and exploration.
    With,
}

const CHAINS: [Chain; 2] = [Chain::Without, Chain::With];

/// Results of the flights of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The kind of scenes.
    pub kind: Kind,
    /// The chain.
    pub chain: Chain,
    /// Flights.
    pub flights: u32,
    /// Of these, how many reached the beacon.
    pub reached: u32,
    /// And how many hit something.
    pub collisions: u32,
    /// Mean time of those that both chains finish.
    pub mean_time_s: Option<f64>,
    /// Mean length of the path of those.
    pub mean_length_m: Option<f64>,
    /// Smallest distance between hull and walls.
    pub min_clearance_m: f64,
}

/// Results of all flights.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Seed.
    pub seed: u64,
    /// Row by row.
    pub rows: Vec<Row>,
    /// Share of the flights with filters that reached the beacon.
    pub success_with: f64,
    /// And without.
    pub success_without: f64,
    /// Collisions, with and without.
    pub collisions: u32,
}

/// Flights of the experiment.
#[must_use]
pub fn flights(scenes: u32) -> u64 {
    u64::from(scenes) * (KINDS.len() * CHAINS.len()) as u64
}

fn row(kind: Kind, chain: Chain, index: usize, pairs: &[&[Flown; 2]]) -> Row {
    let own = || pairs.iter().map(|pair| &pair[index]);
    let reached = |flown: &Flown| flown.result == Ending::Reached;
    let both: Vec<&Flown> = pairs.iter().filter(|pair| pair.iter().all(reached)).map(|pair| &pair[index]).collect();
    let mean = |of: &dyn Fn(&Flown) -> f64| {
        (!both.is_empty()).then(|| both.iter().map(|flown| of(flown)).sum::<f64>() / both.len() as f64)
    };
    Row {
        kind,
        chain,
        flights: pairs.len() as u32,
        reached: own().filter(|flown| reached(flown)).count() as u32,
        collisions: own().filter_map(|flown| flown.collisions).sum(),
        mean_time_s: mean(&|flown| flown.time_s),
        mean_length_m: mean(&|flown| flown.path_length_m),
        min_clearance_m: own().filter_map(|flown| flown.min_clearance_m).fold(f64::INFINITY, f64::min),
    }
}

/// A scene of a kind. Different seeds and indices give different ones.
#[must_use]
pub fn scene(kind: Kind, seed: u64, index: u32) -> Scenario {
    let mut draw = Random::new(seed ^ u64::from(index) << 20, 0x6d75_6c74 + kind as u64);
    let mut between = |low: f64, high: f64| low + (high - low) * draw.uniform();
    let mut walls: Vec<[f64; 4]> = Vec::new();
    let (start, goal);
    match kind {
        Kind::OpenOne | Kind::OpenTwo | Kind::HiddenOne | Kind::HiddenTwo => {
            let length = between(8.0, 11.0);
            (start, goal) = ([0.0, 0.0], [length, 0.0]);
            let side = if between(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
            let mut wall = |along: f64, aside: f64, length: f64, turned: f64| {
                let (dx, dy) = (0.5 * length * libm::cos(turned), 0.5 * length * libm::sin(turned));
                walls.push([along - dx, aside - dy, along + dx, aside + dy]);
            };
            let two = matches!(kind, Kind::OpenTwo | Kind::HiddenTwo);
            for side in [side, -side].into_iter().take(if two { 2 } else { 1 }) {
                let along = 0.5 * length + between(-1.0, 1.0);
                wall(along, side * between(2.5, 4.0), between(7.0, 11.0), between(-0.25, 0.25));
            }
            if matches!(kind, Kind::HiddenOne | Kind::HiddenTwo) {
                let turned = FRAC_PI_2 + between(-0.2, 0.2);
                wall(length * between(0.4, 0.6), -side * between(0.0, 0.6), between(2.5, 3.5), turned);
            }
        }
        Kind::Corridor => {
            let (width, length, branch) = (between(2.4, 3.2), between(5.0, 7.0), between(5.0, 8.0));
            let half = 0.5 * width;
            (start, goal) = ([0.0, 0.0], [branch, length - half + between(-0.4, 0.4)]);
            walls.extend([
                [-half, -2.0, -half, length],
                [-half, length, branch + 2.0, length],
                [half, -2.0, half, length - width],
                [half, length - width, branch + 2.0, length - width],
            ]);
        }
        Kind::Room => {
            let half = 0.5 * between(9.0, 11.0);
            let mut within = |low: f64, high: f64| between(low, high);
            start = [within(1.0 - half, -0.5 * half), within(1.0 - half, half - 1.0)];
            goal = [within(0.5 * half - 1.0, half - 1.0), within(1.0 - half, half - 1.0)];
            let (door, partition) = (within(1.2 - half, half - 1.2), within(-0.8, 0.8));
            walls.extend([
                [-half, -half, half, -half],
                [half, -half, half, half],
                [half, half, -half, half],
                [-half, half, -half, -half],
                [partition, -half, partition, door - 0.8],
                [partition, door + 0.8, partition, half],
            ]);
        }
    }
    let turned = between(0.0, TAU);
    let (sine, cosine) = (libm::sin(turned), libm::cos(turned));
    let place = |[x, y]: [f64; 2]| [cosine * x - sine * y, sine * x + cosine * y];
    let wall = |[x0, y0, x1, y1]: [f64; 4]| {
        let ([x0, y0], [x1, y1]) = (place([x0, y0]), place([x1, y1]));
        Wall { x0, y0, x1, y1, r: 0.2, reflection_db: 6.0, passage_db: 30.0 }
    };
    Scenario {
        name: format!("{}, scene {index}", kind.label()),
        bounds: [-14.0, -14.0, 14.0, 14.0],
        start: place(start),
        goal: place(goal),
        walls: walls.into_iter().map(wall).collect(),
        bearing: Bearing { snr_db: Some(20.0), ..Bearing::default() },
        max_time_s: 120.0,
        explore_s: 60.0,
        ..Scenario::default()
    }
}

impl Study for Report {
    const NAME: &'static str = "multipath";
    const TITLE: &'static str = "The closed loop among walls that reflect";
    const SOURCE: &'static str = "no paper's: what the filters behind the bearing are worth";
    const NOTE: &'static str = "\
        Scenes drawn from the seed: in the open beside walls, behind a partition, around a corner, in another room.";

    fn chosen(settings: &Settings) -> Value {
        json!({ "seed": settings.seed, "scenes": settings.scenes })
    }

    fn length(settings: &Settings) -> Option<u64> {
        Some(flights(settings.scenes))
    }

    /// Flies all scenes with both chains.
    fn run(settings: &Settings, watch: Watch<'_>) -> Result<Self, InputError> {
        let done = AtomicU64::new(0);
        let mut jobs = Vec::new();
        for kind in KINDS {
            for index in 0..settings.scenes {
                jobs.push((kind, scene(kind, settings.seed, index), u64::from(index)));
            }
        }
        let flown: Result<Vec<[Flown; 2]>, InputError> = jobs
            .par_iter()
            .map(|(_, scenario, seed)| {
                let flight = |chain| {
                    let flown = flight::report(scenario.clone(), settings.seed.wrapping_add(*seed), |config| {
                        if chain == Chain::Without {
                            (config.reflections, config.planner.explore) = (false, None);
                        }
                    });
                    watch(done.fetch_add(1, Ordering::Relaxed) + 1);
                    flown
                };
                Ok([flight(Chain::Without)?, flight(Chain::With)?])
            })
            .collect();
        let flown = flown?;
        let mut rows = Vec::new();
        for kind in KINDS {
            let pairs: Vec<&[Flown; 2]> =
                jobs.iter().zip(&flown).filter(|((of, _, _), _)| *of == kind).map(|(_, pair)| pair).collect();
            for (index, chain) in CHAINS.into_iter().enumerate() {
                rows.push(row(kind, chain, index, &pairs));
            }
        }
        let share = |chain| {
            let of_chain = rows.iter().filter(|row| row.chain == chain);
            let (reached, all) = of_chain.fold((0, 0), |(r, a), row| (r + row.reached, a + row.flights));
            f64::from(reached) / f64::from(all.max(1))
        };
        let (success_with, success_without) = (share(Chain::With), share(Chain::Without));
        let collisions = rows.iter().map(|row| row.collisions).sum();
        Ok(Self { seed: settings.seed, rows, success_with, success_without, collisions })
    }

    fn table(&self) -> String {
        let mut text = String::from(
            "The closed loop among walls, with the filters behind the bearing and without\n\n\
             scenes                      chain     reached   hit   time     length   clearance\n",
        );
        for row in &self.rows {
            let number = |value: Option<f64>, unit: &str| value.map_or("-".to_owned(), |v| format!("{v:.1} {unit}"));
            let chain = if row.chain == Chain::With { "filters" } else { "bearing" };
            let _ = writeln!(
                text,
                "{:<27} {chain:<8} {:>4}/{:<4} {:>4}   {:>7} {:>9}   {:>6.3} m",
                row.kind.label(),
                row.reached,
                row.flights,
                row.collisions,
                number(row.mean_time_s, "s"),
                number(row.mean_length_m, "m"),
                row.min_clearance_m
            );
        }
        let _ = writeln!(
            text,
            "\nreached: {:.1} % with filters, {:.1} % without; times and lengths over the flights that both finish",
            100.0 * self.success_with,
            100.0 * self.success_without
        );
        text
    }

    /// Draws the shares reached.
    fn figures(&self, folder: &Path) -> Result<Vec<PathBuf>, InputError> {
        let bars = CHAINS.map(|chain| {
            let of_chain = self.rows.iter().filter(|row| row.chain == chain);
            let bar = |row: &Row| {
                let value = 100.0 * f64::from(row.reached) / f64::from(row.flights.max(1));
                Some(Bar { value, low: value, high: value })
            };
            let label = if chain == Chain::With { "with filters" } else { "bearing only" };
            Bars { label: label.to_owned(), bars: of_chain.map(bar).collect() }
        });
        let panel = Panel {
            title: KINDS.map(Kind::label).join(" | "),
            x: Axis::counted("kind of scenes", KINDS.len() as u32),
            y: Axis::linear("%", 0.0, 100.0, 10.0),
            series: Vec::new(),
            bars: bars.into(),
            level: Some((98.0, "98 %".to_owned())),
        };
        Chart { title: "The closed loop among walls: beacons reached".to_owned(), panels: vec![panel] }
            .write(folder, "multipath.svg")
    }

    /// With the filters and without.
    fn verdict(&self) -> Vec<Beside> {
        let count = |chain: Chain| {
            let rows = self.rows.iter().filter(|row| row.chain == chain);
            let (reached, flights) = rows.fold((0, 0), |(r, f), row| (r + row.reached, f + row.flights));
            format!("{reached} of {flights}")
        };
        let ours = format!("{}; without filters {}", count(Chain::With), count(Chain::Without));
        let hit = format!("{} in all flights", self.collisions);
        vec![
            line::<Self>("flights that reach the beacon".to_owned(), [empty(), empty(), ours]),
            line::<Self>("collisions".to_owned(), [empty(), empty(), hit]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_a_valid_scenario_and_depends_on_its_seed() {
        for kind in KINDS {
            for index in 0..20 {
                scene(kind, 3, index).checked().unwrap();
            }
            assert_ne!(scene(kind, 3, 0), scene(kind, 3, 1));
            assert_ne!(scene(kind, 3, 0), scene(kind, 4, 0));
            assert_eq!(scene(kind, 3, 0), scene(kind, 3, 0));
        }
    }
}
