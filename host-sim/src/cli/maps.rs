//! `foxhound maps`: pillar forests of given density, and pairs to fly on them.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use foxhound_sim::drive::maps;
use foxhound_sim::drive::suite::{self, Suite};
use foxhound_sim::record;
use foxhound_sim::scenario::input::{DRONE_RADIUS_M, InputError, check_within};
use serde::Serialize;

use super::terminal::{say, show};
use super::value::{number, whole};
use super::{Cli, json_line, write_text};

const MAPS_HELP: &str =
    "Density is the area of all pillars in a unit square over that of the square; mean and variance are over all unit \
squares and are reached within 0.0005. Starts and goals are at least 4 m apart and can be joined by a planner that \
knows the map and keeps 0.05 m from every pillar; the suite file holds the length of the shortest such path. \
Without --row or --mean: the five maps of the main paper's Table I, four of each.

Examples:
  foxhound maps                     out/suite.json and out/maps.svg
  foxhound maps --row 4 --count 20 --pairs 5 --seed 3 --out dense
  foxhound maps --mean 0.12 --variance 0.01 --step
  foxhound maps --describe out/suite.json --json";

#[derive(Args, Debug)]
#[command(after_help = MAPS_HELP)]
pub(super) struct MapsCommand {
    /// Row of the main paper's Table I.
    #[arg(long, value_name = "K", value_parser = whole::<u32>(1..=5))]
    row: Option<u32>,
    /// Mean density.
    #[arg(long, value_name = "SHARE", value_parser = number(maps::MEAN), requires = "variance", conflicts_with = "row")]
    mean: Option<f64>,
    /// Variance of the density.
    #[arg(long, value_name = "V", value_parser = number(maps::VARIANCE), requires = "mean")]
    variance: Option<f64>,
    /// Dense on one side of a line, sparse on the other, as in row 5.
    #[arg(long, requires = "mean")]
    step: bool,
    /// Edges of the map, metres.
    #[arg(
        long,
        value_name = "X0,Y0,X1,Y1",
        value_delimiter = ',',
        value_parser = number(maps::EDGE_M),
        allow_hyphen_values = true
    )]
    bounds: Vec<f64>,
    /// Maps of each density.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = whole::<u32>(1..=1000))]
    count: u32,
    /// Start/goal pairs of each map.
    #[arg(long, value_name = "P", default_value_t = 40, value_parser = whole::<u32>(1..=10_000))]
    pairs: u32,
    /// Radius of the vehicle, metres.
    #[arg(long, value_name = "M", value_parser = number(DRONE_RADIUS_M), default_value_t = 0.15)]
    drone_radius: f64,
    /// Describes the maps of this suite file instead.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["row", "mean", "bounds"])]
    describe: Option<PathBuf>,
}

/// A map for people and machines.
#[derive(Serialize)]
struct MapLine {
    row: u32,
    instance: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    asked: Option<maps::Density>,
    mean: f64,
    variance: f64,
    pillars: usize,
    pairs: usize,
    /// Share of the drawn pairs between which there was a path.
    #[serde(skip_serializing_if = "Option::is_none")]
    reachable_share: Option<f64>,
}

impl MapLine {
    fn of(bounds: [f64; 4], map: &suite::Map) -> Self {
        let maps::Density { mean, variance } = maps::density(bounds, &map.obstacles);
        let (pillars, pairs) = (map.obstacles.len(), map.pairs.len());
        Self {
            row: map.row,
            instance: map.instance,
            asked: None,
            mean,
            variance,
            pillars,
            pairs,
            reachable_share: None,
        }
    }
}

#[derive(Serialize)]
struct MapsReport {
    maps: Vec<MapLine>,
}

impl MapsReport {
    fn table(&self) -> String {
        let mut text =
            String::from(" row  map  asked: mean  variance  reached: mean  variance  pillars  pairs  reachable\n");
        for line in &self.maps {
            let (mean, variance) = match line.asked {
                Some(asked) => (format!("{:.4}", asked.mean), format!("{:.4}", asked.variance)),
                None => ("-".to_owned(), "-".to_owned()),
            };
            let reachable =
                line.reachable_share.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
            let _ = writeln!(
                text,
                "{:>4} {:>4} {mean:>12} {variance:>9} {:>14.4} {:>9.4} {:>8} {:>6} {reachable:>10}",
                line.row, line.instance, line.mean, line.variance, line.pillars, line.pairs
            );
        }
        text
    }
}

pub(super) fn draw_maps(cli: &Cli, args: &MapsCommand) -> Result<ExitCode, InputError> {
    // A described suite has its file already.
    let folder = cli.out.clone().or_else(|| (!cli.json && args.describe.is_none()).then(|| PathBuf::from("out")));
    if let Some(folder) = &folder {
        cli.claim(&folder.join("maps.svg"))?;
        if args.describe.is_none() {
            cli.claim(&folder.join("suite.json"))?;
        }
    }
    let (suite, report) = match &args.describe {
        Some(path) => describe(Suite::read(path)?),
        None => drawn(cli, args)?,
    };
    if cli.json {
        say(&json_line(&report)?);
    } else {
        show(&report.table());
    }
    if let Some(folder) = folder {
        let picture = folder.join("maps.svg");
        record::maps::draw(&suite, &picture)?;
        cli.note(&format!("picture: {}", picture.display()));
        if args.describe.is_none() {
            let file = folder.join("suite.json");
            write_text(&file, &json_line(&suite)?)?;
            cli.note(&format!("suite: {}", file.display()));
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn drawn(cli: &Cli, args: &MapsCommand) -> Result<(Suite, MapsReport), InputError> {
    check_within("--drone-radius", args.drone_radius, &DRONE_RADIUS_M)?;
    let mut recipes: Vec<(u32, maps::Recipe)> = match (args.row, args.mean, args.variance) {
        (_, Some(mean), Some(variance)) => {
            let density = maps::Density { mean, variance };
            vec![(0, maps::Recipe { density, step: args.step, ..maps::Recipe::default() })]
        }
        (row, ..) => (1..=5)
            .filter(|k| row.is_none_or(|row| row == *k))
            .filter_map(|row| Some((row, maps::Recipe::of_row(row)?)))
            .collect(),
    };
    let mut suite = Suite { drone_radius: args.drone_radius, seed: Some(cli.seed.into()), ..Suite::default() };
    match *args.bounds.as_slice() {
        [] => {}
        [x0, y0, x1, y1] => suite.bounds = [x0, y0, x1, y1],
        _ => return Err(InputError::new("--bounds: expected X0,Y0,X1,Y1")),
    }
    for (_, recipe) in &mut recipes {
        recipe.bounds = suite.bounds;
    }
    let progress = cli.bar("drawing", u64::from(args.count) * recipes.len() as u64, "maps");
    let mut lines = Vec::new();
    for (row, recipe) in recipes {
        for instance in 0..args.count {
            let seed = suite::Place { row, instance, pair: u32::MAX }.seed(cli.seed);
            let obstacles = maps::generate(&recipe, seed)?;
            let drawn = maps::pairs(suite.bounds, &obstacles, args.drone_radius, args.pairs as usize, seed)?;
            let map = suite::Map::new(row, instance, obstacles, drawn.pairs);
            let reachable_share = Some(drawn.reachable_share);
            lines.push(MapLine { asked: Some(recipe.density), reachable_share, ..MapLine::of(suite.bounds, &map) });
            suite.maps.push(map);
            progress.inc(1);
        }
    }
    progress.finish_and_clear();
    Ok((suite, MapsReport { maps: lines }))
}

fn describe(suite: Suite) -> (Suite, MapsReport) {
    let maps = suite.maps.iter().map(|map| MapLine::of(suite.bounds, map)).collect();
    (suite, MapsReport { maps })
}
