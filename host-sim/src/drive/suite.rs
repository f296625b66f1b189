//! Many flights in parallel: a suite file holds maps and start/goal pairs; every pair is flown by [`flight::fly`],
//! with a seed of its own, and the flights are summed up by row.
//!
//! A flight ends within the goal tolerance of the beacon, while the reference path leads to the beacon itself: the
//! length ratio is therefore given as flown, and once more with the tolerance added to the path.
//!
//! The results do not depend on the number of parallel flights: every flight has its own world, computer and random
//! numbers, and the sums are taken in the order of the file.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::SplitMix64;
use rayon::prelude::{IntoParallelRefIterator as _, ParallelIterator as _};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::computer::HostComputer;
use super::flight::{self, Ending, Mission, Record};
use super::maps::{Pair, Pillar};
use crate::scenario::input::{InputError, check, read_text};
use crate::scenario::{Bearing, Limits, Obstacle, Scenario, Schema, Sensor, Vehicle};

pub mod journal;
mod report;
pub mod shard;

pub use report::{Report, Row, Tally, wilson_95};
use shard::Shard;

/// Stack of a worker: a computer is some hundred kilobytes.
const STACK_BYTES: usize = 16 << 20;

/// Maps and pairs, and the common settings of all flights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Suite {
    /// Descriptive: its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<Value>,
    /// Descriptive: why it exists.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<Value>,
    /// Descriptive: which frame the numbers are in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<Value>,
    /// Descriptive: what should happen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expect: Option<Value>,
    /// Descriptive: the seed from which it was drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<Value>,
    /// Radius of the vehicle's hull.
    pub drone_radius: f64,
    /// West, south, east, north.
    pub bounds: [f64; 4],
    /// The obstacle sensor.
    pub sensor: Sensor,
    /// The direction finding.
    pub bearing: Bearing,
    /// Limits of the vehicle.
    pub limits: Limits,
    /// The vehicle's dynamics.
    pub vehicle: Vehicle,
    /// Horizontal distance to the beacon that counts as reached.
    pub goal_tolerance: f64,
    /// When a flight is given up.
    pub max_time_s: f64,
    /// The maps.
    pub maps: Vec<Map>,
}

/// One map and its pairs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Map {
    /// The row of the table that it belongs to.
    pub row: u32,
    /// Which map of that row.
    pub instance: u32,
    /// Descriptive: the mean density.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mean: Option<Value>,
    /// Descriptive: the variance of the density.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variance: Option<Value>,
    /// Descriptive: its name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<Value>,
    /// Descriptive: the seed from which it was drawn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<Value>,
    /// The pillars: x, y, r.
    pub obstacles: Vec<Pillar>,
    /// Starts and goals and the length of the reference path: x0, y0, x1, y1, length.
    pub pairs: Vec<Pair>,
}

impl Map {
    /// A map without descriptive keys.
    #[must_use]
    pub fn new(row: u32, instance: u32, obstacles: Vec<Pillar>, pairs: Vec<Pair>) -> Self {
        Self { row, instance, mean: None, variance: None, name: None, seed: None, obstacles, pairs }
    }
}

static SCHEMA: LazyLock<Schema> = LazyLock::new(|| Schema::of::<Suite>("suite"));

impl Default for Suite {
    fn default() -> Self {
        let flight = Scenario::default();
        Self {
            name: None,
            why: None,
            frame: None,
            expect: None,
            seed: None,
            drone_radius: flight.drone_radius,
            bounds: flight.bounds,
            sensor: flight.sensor,
            bearing: flight.bearing,
            limits: flight.limits,
            vehicle: flight.vehicle,
            goal_tolerance: flight.goal_tolerance,
            max_time_s: flight.max_time_s,
            maps: Vec::new(),
        }
    }
}

impl Suite {
    /// Reads a suite file.
    ///
    /// # Errors
    /// The file, and the path of the first key that is unknown, of the wrong type or out of range.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::parse(&read_text(path)?).map_err(|error| error.in_file(path))
    }

    /// Reads a suite.
    ///
    /// # Errors
    /// The path of the first key that is unknown, of the wrong type or out of range.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        SCHEMA.read::<Self>(text)?.checked()
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The path of the first field out of range, its value and the range.
    pub fn checked(self) -> Result<Self, InputError> {
        self.scenario_without_map().checked()?;
        let far = 10_000.0;
        let mut names = BTreeMap::new();
        for (k, map) in self.maps.iter().enumerate() {
            let Map { row, instance, .. } = map;
            // The flights would have the same seeds, and `--only` could not tell them apart.
            if let Some(other) = names.insert((*row, *instance), k) {
                let text = format!("maps[{k}]: row {row}, instance {instance} is maps[{other}], too");
                return Err(InputError::new(text));
            }
            for (n, [x, y, r]) in map.obstacles.iter().enumerate() {
                check(&format!("maps[{k}].obstacles[{n}][0]"), *x, -far, far)?;
                check(&format!("maps[{k}].obstacles[{n}][1]"), *y, -far, far)?;
                check(&format!("maps[{k}].obstacles[{n}][2]"), *r, 0.001, 1000.0)?;
            }
            for (n, pair) in map.pairs.iter().enumerate() {
                for (axis, value) in pair[..4].iter().enumerate() {
                    check(&format!("maps[{k}].pairs[{n}][{axis}]"), *value, -far, far)?;
                }
                check(&format!("maps[{k}].pairs[{n}][4]"), pair[4], 0.0, 10.0 * far)?;
                let is_inside = |[x, y, r]: &Pillar| libm::hypot(x - pair[0], y - pair[1]) < *r;
                if let Some(pillar) = map.obstacles.iter().position(is_inside) {
                    let [x, y, ..] = pair;
                    let text = format!("maps[{k}].pairs[{n}]: the start [{x}, {y}] is inside obstacles[{pillar}]");
                    return Err(InputError::new(text));
                }
            }
        }
        Ok(self)
    }

    fn scenario_without_map(&self) -> Scenario {
        Scenario {
            bounds: self.bounds,
            drone_radius: self.drone_radius,
            sensor: self.sensor,
            bearing: self.bearing,
            limits: self.limits,
            vehicle: self.vehicle,
            goal_tolerance: self.goal_tolerance,
            max_time_s: self.max_time_s,
            ..Scenario::default()
        }
    }

    /// The selected flights of this suite, in the order of the file.
    #[must_use]
    pub fn flights(&self, seed: u64, selection: &Selection) -> Vec<Flight> {
        let base = self.scenario_without_map();
        let mut flights = Vec::new();
        let mut number = 0;
        for map in self.maps.iter().filter(|map| selection.takes_map(map)) {
            let obstacle = |[x, y, r]: &Pillar| Obstacle { x: *x, y: *y, r: *r, ..Obstacle::default() };
            let obstacles: Vec<Obstacle> = map.obstacles.iter().map(obstacle).collect();
            for (index, [x0, y0, x1, y1, reference_m]) in (0..).zip(&map.pairs) {
                let place = Place { row: map.row, instance: map.instance, pair: index };
                let is_selected = selection.takes_pair(index);
                // Those of other shards are never built: a large suite needs much memory.
                if is_selected && selection.shard.is_none_or(|shard| shard.takes(number)) {
                    let scenario = Scenario {
                        name: format!("row {}, map {}, pair {}", map.row, map.instance, index),
                        obstacles: obstacles.clone(),
                        start: [*x0, *y0],
                        goal: [*x1, *y1],
                        reference_length_m: Some(Value::from(*reference_m)),
                        ..base.clone()
                    };
                    let seed = place.seed(seed);
                    flights.push(Flight { place, seed, scenario, reference_length_m: *reference_m });
                }
                number += usize::from(is_selected);
            }
        }
        flights
    }

    /// How many flights are selected, in all shards together.
    ///
    /// # Errors
    /// There is none.
    pub fn count(&self, selection: &Selection) -> Result<usize, InputError> {
        if selection.only.len() > 3 {
            return Err(InputError::new("--only: expected ROW, ROW,INSTANCE or ROW,INSTANCE,PAIR"));
        }
        let maps = self.maps.iter().filter(|map| selection.takes_map(map));
        let count = maps.map(|map| (0..).zip(&map.pairs).filter(|(index, _)| selection.takes_pair(*index)).count());
        match count.sum() {
            0 if selection.only.is_empty() && selection.pairs.is_none() => {
                Err(InputError::new("maps: there is no pair"))
            }
            0 => Err(InputError::new("--only or --pairs: no pair is left")),
            count => Ok(count),
        }
    }
}

/// Position of a flight in a suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Place {
    /// The map's row.
    pub row: u32,
    /// The map's number in its row.
    pub instance: u32,
    /// The pair's number on its map, from 0.
    pub pair: u32,
}

impl Place {
    /// The flight's own seed, below 2^32 so that every JSON reader holds it exactly.
    #[must_use]
    pub fn seed(self, base: u64) -> u64 {
        [self.row, self.instance, self.pair]
            .into_iter()
            .fold(base, |seed, number| SplitMix64::seed_from_u64(seed ^ u64::from(number) << 32).next_u64())
            >> 32
    }
}

/// Selection of a suite's flights.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Row, instance and pair, if given.
    pub only: Vec<u32>,
    /// Largest number of pairs of each map.
    pub pairs: Option<u32>,
    /// Only the flights of one shard.
    pub shard: Option<Shard>,
}

impl Selection {
    fn takes_map(&self, map: &Map) -> bool {
        self.only.iter().zip([map.row, map.instance]).all(|(asked, is)| *asked == is)
    }

    fn takes_pair(&self, pair: u32) -> bool {
        self.only.get(2).is_none_or(|asked| *asked == pair) && self.pairs.is_none_or(|count| pair < count)
    }
}

/// A flight to be flown.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// Its position in the suite.
    pub place: Place,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The world and the vehicle.
    pub scenario: Scenario,
    /// Length of the reference path.
    pub reference_length_m: f64,
}

impl Flight {
    /// The mission for `fly`.
    #[must_use]
    pub fn mission(&self, planner: planner::Config, estimator: Estimator) -> Mission {
        Mission { scenario: self.scenario.clone(), seed: self.seed, planner, estimator }
    }

    /// Flies it.
    ///
    /// # Errors
    /// The configuration is refused, or the computer fails.
    pub fn fly(&self, planner: planner::Config, estimator: Estimator) -> Result<(Flown, Record), InputError> {
        self.fly_until(planner, estimator, &AtomicBool::new(false))
    }

    fn fly_until(
        &self,
        planner: planner::Config,
        estimator: Estimator,
        stop: &AtomicBool,
    ) -> Result<(Flown, Record), InputError> {
        let mission = self.mission(planner, estimator);
        let mut computer = HostComputer::new(&mission.guidance())?;
        let record = flight::fly_until(&mission, &mut computer, None, stop, |_| ())
            .map_err(|error| InputError::new(format!("{}: {error}", self.scenario.name)))?;
        Ok((Flown::of(self, &record), record))
    }
}

/// The result of a flight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flown {
    /// Its position in the suite.
    #[serde(flatten)]
    pub place: Place,
    /// Its seed.
    pub seed: u64,
    /// How it ended.
    pub result: Ending,
    /// The outcome that explains it, by name.
    pub reason: String,
    /// Duration of the flight.
    pub time_s: f64,
    /// Length of the path flown.
    pub path_length_m: f64,
    /// Length of the reference path.
    pub reference_length_m: f64,
    /// Path flown over reference path; `None` without a reference.
    pub length_ratio: Option<f64>,
    /// The same with the goal tolerance added to the path.
    pub whole_length_ratio: Option<f64>,
    /// Smallest distance between hull and pillars; `None` in a world without pillars.
    pub min_clearance_m: Option<f64>,
    /// Plans made.
    pub replans: u32,
    /// Error of the valid bearings, rms; `None` without any.
    pub bearing_rms_deg: Option<f64>,
    /// Hash over every bearing, plan and setpoint.
    pub trace_hash: String,
}

impl Flown {
    fn of(flight: &Flight, record: &Record) -> Self {
        let report = &record.report;
        let ratio = |length_m: f64| (flight.reference_length_m > 0.0).then(|| length_m / flight.reference_length_m);
        Self {
            place: flight.place,
            seed: flight.seed,
            result: report.result,
            reason: report.reason.to_owned(),
            time_s: report.time_s,
            path_length_m: report.path_length_m,
            reference_length_m: flight.reference_length_m,
            length_ratio: ratio(report.path_length_m),
            whole_length_ratio: ratio(report.path_length_m + flight.scenario.goal_tolerance),
            min_clearance_m: report.min_clearance_m,
            replans: report.replans,
            bearing_rms_deg: report.bearing_rms_deg,
            trace_hash: report.trace_hash.clone(),
        }
    }

    /// Its result as text.
    #[must_use]
    pub fn outcome(&self) -> String {
        match self.result {
            Ending::Reached => "reached".to_owned(),
            Ending::Collision => "collision".to_owned(),
            Ending::Hold => format!("hold: {}", self.reason),
            Ending::Timeout => format!("timeout: {}", self.reason),
            Ending::Interrupted => "interrupted".to_owned(),
        }
    }
}

/// Flies many flights, `jobs` at a time; `watch` is called for each when it is done, in any order.
///
/// # Errors
/// The configuration is refused, or a computer fails.
pub fn fly_all(
    flights: &[Flight],
    planner: planner::Config,
    estimator: Estimator,
    jobs: usize,
    watch: impl Fn(&Flown) + Sync,
) -> Result<Vec<Flown>, InputError> {
    let flights: Vec<(usize, &Flight)> = flights.iter().enumerate().collect();
    let watch = |_, flown: &Flown| {
        watch(flown);
        Ok(())
    };
    let flown = fly_until(&flights, planner, estimator, jobs, &AtomicBool::new(false), watch)?;
    Ok(flown.into_iter().flatten().collect())
}

/// The same with flights that have numbers, until `stop` is set: flights that were not finished then are none.
///
/// # Errors
/// The configuration is refused, a computer fails, or `watch` does.
pub fn fly_until(
    flights: &[(usize, &Flight)],
    planner: planner::Config,
    estimator: Estimator,
    jobs: usize,
    stop: &AtomicBool,
    watch: impl Fn(usize, &Flown) -> Result<(), InputError> + Sync,
) -> Result<Vec<Option<Flown>>, InputError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).stack_size(STACK_BYTES).build();
    let pool = pool.map_err(|error| InputError::new(format!("--jobs {jobs}: {error}")))?;
    pool.install(|| {
        let one = |(number, flight): &(usize, &Flight)| {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let (flown, _) = flight.fly_until(planner, estimator, stop)?;
            if flown.result == Ending::Interrupted {
                return Ok(None);
            }
            watch(*number, &flown)?;
            Ok(Some(flown))
        };
        flights.par_iter().map(one).collect()
    })
}

#[cfg(test)]
mod tests;
