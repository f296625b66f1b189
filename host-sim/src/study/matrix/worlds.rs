//! The worlds that are flown in every setting of the matrix.

use std::fs::File;
use std::ops::Range;
use std::path::Path;

use flate2::read::GzDecoder;
use serde_json::{Map, Value};

use crate::drive::maps::{self, Recipe, thicket};
use crate::drive::suite::{Selection, Suite};
use crate::scenario::input::{InputError, read_text};
use crate::scenario::{Obstacle, RandomPillars, Scenario};
use crate::study::gusts::{self, Scene};

/// A world to fly through.
#[derive(Clone, Debug)]
pub struct World {
    /// It, and everything that flies.
    pub scenario: Scenario,
    /// Seed of the flight.
    pub seed: u64,
    /// Length of the shortest path, where it is known.
    pub shortest_m: Option<f64>,
}

fn obstacles(pillars: &[maps::Pillar]) -> Vec<Obstacle> {
    pillars.iter().map(|[x, y, r]| Obstacle { x: *x, y: *y, r: *r, ..Obstacle::default() }).collect()
}

/// Forests of the main paper's densities (Table I), by turns, with so many pairs of start and goal in each, for a hull of that
/// radius.
///
/// # Errors
/// A forest cannot be drawn.
pub fn forests(hull_m: f64, seeds: Range<u64>, pairs: usize) -> Result<Vec<World>, InputError> {
    let mut worlds = Vec::new();
    for (row, seed) in (1..=maps::TABLE_I.len() as u32).cycle().zip(seeds) {
        let Some(recipe) = Recipe::of_row(row) else { continue };
        let pillars = maps::generate(&recipe, seed)?;
        let drawn = maps::pairs(recipe.bounds, &pillars, hull_m, pairs, seed)?;
        for (k, [x0, y0, x1, y1, shortest_m]) in (0..).zip(drawn.pairs) {
            let scenario = Scenario {
                name: format!("forest {seed} of row {row}, pair {k}"),
                bounds: recipe.bounds,
                start: [x0, y0],
                goal: [x1, y1],
                obstacles: obstacles(&pillars),
                ..Scenario::default()
            };
            worlds.push(World { scenario, seed: seed + k, shortest_m: Some(shortest_m) });
        }
    }
    Ok(worlds)
}

/// Dense corridors ([`thicket`]). A hull of 0.25 m has a path, of which the length is known.
///
/// # Errors
/// One of the seeds has no world.
pub fn thickets(seeds: Range<u64>) -> Result<Vec<World>, InputError> {
    let world = |seed| {
        let (pillars, [x0, y0, x1, y1, shortest_m]) = thicket::thicket(seed)?;
        let scenario = Scenario {
            name: "thicket".to_owned(),
            bounds: thicket::BOUNDS,
            start: [x0, y0],
            goal: [x1, y1],
            obstacles: obstacles(&pillars),
            max_time_s: 100.0,
            ..Scenario::default()
        };
        Ok(World { scenario, seed, shortest_m: Some(shortest_m) })
    };
    seeds.map(world).collect()
}

/// Pillars at random places.
///
/// # Errors
/// One of the seeds has no world.
pub fn pillars(seeds: Range<u64>) -> Result<Vec<World>, InputError> {
    let world = |seed| {
        let random = Some(RandomPillars { count: 24, ..RandomPillars::default() });
        let scenario = Scenario { name: "random pillars".to_owned(), random, ..Scenario::default() };
        Ok(World { scenario: scenario.drawn(seed)?, seed, shortest_m: None })
    };
    seeds.map(world).collect()
}

/// Walls, gaps and pillars in strong gusts, one of each for each seed.
///
/// # Errors
/// One of the seeds has no world.
pub fn gusty(seeds: Range<u64>) -> Result<Vec<World>, InputError> {
    let world = |scene: &Scene, seed| {
        let scenario = Scenario { name: format!("gusts, {}", scene.name), ..scene.scenario(&gusts::STRONG, seed)? };
        Ok(World { scenario, seed, shortest_m: None })
    };
    seeds.flat_map(|seed| gusts::roomy().map(move |scene| world(scene, seed))).collect()
}

/// The traps of a folder, each with all seeds.
///
/// # Errors
/// The folder cannot be read, or a scenario of it is refused.
pub fn traps(folder: &Path, seeds: &Range<u64>) -> Result<Vec<World>, InputError> {
    let unread = |error: std::io::Error| InputError::new(error.to_string()).in_file(folder);
    let files = std::fs::read_dir(folder).map_err(unread)?.map(|entry| entry.map(|entry| entry.path()));
    let mut files = files.collect::<Result<Vec<_>, _>>().map_err(unread)?;
    files.sort();
    let mut worlds = Vec::new();
    for file in files {
        let scenario = Scenario::parse(&read_text(&file)?).map_err(|error| error.in_file(&file))?;
        worlds.extend(seeds.clone().map(|seed| World { scenario: scenario.clone(), seed, shortest_m: None }));
    }
    Ok(worlds)
}

/// Hulls for which the shortest paths through BARN's worlds are known.
const BARN_HULLS_M: [f64; 4] = [0.15, 0.20, 0.215, 0.25];

/// Every `nth` of BARN's worlds from a folder; `None` where there is no such folder.
///
/// # Errors
/// What is in the folder is not what is expected.
pub fn barn(folder: &Path, hull_m: f64, seeds: &Range<u64>, nth: usize) -> Result<Option<Vec<World>>, InputError> {
    let Ok(packed) = File::open(folder.join("worlds-dev.json.gz")) else { return Ok(None) };
    let refused = |error: serde_json::Error| InputError::new(error.to_string()).in_file(folder);
    let mut suite: Map<String, Value> = serde_json::from_reader(GzDecoder::new(packed)).map_err(refused)?;
    let read = |name: &str| -> Result<Value, InputError> {
        serde_json::from_str(&read_text(&folder.join(name))?).map_err(refused)
    };
    if let Value::Object(setting) = &read("settings.json")?["default_hull015"] {
        suite.extend(setting.clone());
    }
    let lengths_m = read("shortest-dev.json")?;
    let suite = Suite::parse(&Value::Object(suite).to_string())?;
    let column = BARN_HULLS_M.iter().position(|radius_m| *radius_m == hull_m);
    let flights = suite.flights(0, &Selection::default()).into_iter().step_by(nth);
    let worlds = flights.map(|flight| {
        let number = flight.place.instance;
        // To within the tolerance.
        let length_m = column.and_then(|column| lengths_m[number.to_string()][column].as_f64());
        let scenario = Scenario { name: format!("BARN {number}"), reference_length_m: None, ..flight.scenario };
        let shortest_m = length_m.map(|length_m| length_m + scenario.goal_tolerance);
        World { scenario, seed: seeds.start + u64::from(number), shortest_m }
    });
    Ok(Some(worlds.collect()))
}
