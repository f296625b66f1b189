//! Every setting that a vehicle is flown in, crossed with the others: obstacle sensor, bearings, vehicle, hull.
//!
//! Tests fly [`pairwise`], in which every two values of different factors meet at least once. `cargo xtask campaign` flies
//! [`product`], all of them, and prints a table.

use rayon::prelude::*;

use crate::autopilot::Software;
use crate::computer::HostComputer;
use crate::flight::{self, Ending, Mission};
use crate::input::InputError;
use crate::maps::{self, Recipe, thicket};
use crate::scenario::{Bearing, Obstacle, Scenario, Sensor, SensorModel, Vehicle, VehicleModel};
use foxhound_core::bearing::Estimator;
use foxhound_core::planner;

/// Model, field of view in degrees, range in metres.
const SENSORS: [(SensorModel, f64, f64); 5] = [
    (SensorModel::Circles, 90.0, 3.0),
    (SensorModel::Scan, 90.0, 3.0),
    (SensorModel::Scan, 120.0, 4.0),
    (SensorModel::Scan, 270.0, 5.0),
    (SensorModel::Scan, 360.0, 4.0),
];
/// Signal-to-noise ratio of the waveforms; without one bearings are drawn, with the scenario's sigma.
const SNR_DB: [Option<f64>; 2] = [None, Some(20.0)];
/// Whether the vehicle is a point mass or answers as slowly as behind a real autopilot, and which.
const VEHICLES: [(VehicleModel, Software); 3] = [
    (VehicleModel::Point, Software::ArduCopter),
    (VehicleModel::Arducopter, Software::ArduCopter),
    (VehicleModel::Arducopter, Software::Px4),
];
const HULLS_M: [f64; 2] = [0.15, 0.215];

/// One value of each factor, by its index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    sensor: usize,
    bearings: usize,
    vehicle: usize,
    hull: usize,
}

/// All settings.
#[must_use]
pub fn product() -> Vec<Setting> {
    let mut settings = Vec::new();
    for sensor in 0..SENSORS.len() {
        for bearings in 0..SNR_DB.len() {
            for vehicle in 0..VEHICLES.len() {
                settings.extend((0..HULLS_M.len()).map(|hull| Setting { sensor, bearings, vehicle, hull }));
            }
        }
    }
    settings
}

/// As few of them as hold every pair of values.
#[must_use]
pub fn pairwise() -> Vec<Setting> {
    let pairs = (0..SENSORS.len()).flat_map(|sensor| (0..VEHICLES.len()).map(move |vehicle| (sensor, vehicle)));
    pairs
        .map(|(sensor, vehicle)| Setting {
            sensor,
            bearings: (sensor + vehicle) % 2,
            vehicle,
            hull: (sensor + vehicle.div_ceil(2)) % 2,
        })
        .collect()
}

impl Setting {
    /// What it is, for tables.
    #[must_use]
    pub fn name(&self) -> String {
        let (model, fov_deg, range_m) = SENSORS[self.sensor];
        let model = if model == SensorModel::Scan { "scan" } else { "circles" };
        let bearings = SNR_DB[self.bearings].map_or("drawn".to_owned(), |snr_db| format!("{snr_db} dB"));
        let vehicle = match VEHICLES[self.vehicle] {
            (VehicleModel::Point, _) => "point",
            (VehicleModel::Arducopter, Software::ArduCopter) => "ArduCopter",
            (VehicleModel::Arducopter, Software::Px4) => "PX4",
        };
        format!("{model} {fov_deg} deg {range_m} m, {bearings}, {vehicle}, hull {}", HULLS_M[self.hull])
    }

    /// Radius of the hull.
    #[must_use]
    pub fn hull_m(&self) -> f64 {
        HULLS_M[self.hull]
    }

    /// The scenario flown in this setting, but with the hull it has.
    #[must_use]
    pub fn equip(&self, scenario: &Scenario) -> Scenario {
        let (model, fov_deg, range_m) = SENSORS[self.sensor];
        let (vehicle, autopilot) = VEHICLES[self.vehicle];
        Scenario {
            sensor: Sensor { model, fov_deg, range_m, ..scenario.sensor },
            bearing: Bearing { snr_db: SNR_DB[self.bearings], model: None, ..scenario.bearing },
            vehicle: Vehicle { model: vehicle, autopilot, ..scenario.vehicle },
            ..scenario.clone()
        }
    }
}

/// What the flights in one setting came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Flights.
    pub flights: u32,
    /// Those that reached the goal.
    pub reached: u32,
    /// Those that touched something: name and seed.
    pub collided: Vec<(String, u64)>,
    /// The others: name, seed and outcome.
    pub others: Vec<(String, u64, String)>,
    /// Mean of path flown, with what was left to the goal, over the shortest path, of those that reached it.
    pub length_ratio: Option<f64>,
    /// Least clearance of all.
    pub clearance_m: Option<f64>,
}

/// Flies worlds, each with its seed and the length of its shortest path, in parallel.
///
/// # Errors
/// A configuration is refused, or a flight cannot be flown.
pub fn fly(worlds: &[World]) -> Result<Row, InputError> {
    let reports = worlds.par_iter().map(|world| {
        let mission = Mission {
            scenario: world.scenario.clone(),
            seed: world.seed,
            planner: planner::Config::default(),
            estimator: Estimator::CrossSpectrum,
        };
        let mut computer = HostComputer::new(&mission.guidance())?;
        let record = flight::fly(&mission, &mut computer, None, |_| ())
            .map_err(|error| InputError::new(format!("{}: {error}", world.scenario.name)))?;
        Ok(record.report)
    });
    let reports = reports.collect::<Result<Vec<_>, InputError>>()?;
    let mut row = Row { flights: reports.len() as u32, ..Row::default() };
    let mut ratios = Vec::new();
    for (world, report) in worlds.iter().zip(reports) {
        row.clearance_m = report.min_clearance_m.into_iter().chain(row.clearance_m).min_by(f64::total_cmp);
        match report.result {
            Ending::Reached => {
                row.reached += 1;
                ratios.extend(world.shortest_m.map(|m| (report.path_length_m + world.scenario.goal_tolerance) / m));
            }
            Ending::Collision => row.collided.push((report.name, report.seed)),
            Ending::Hold | Ending::Timeout => row.others.push((report.name, report.seed, report.reason.to_owned())),
        }
    }
    row.length_ratio = (!ratios.is_empty()).then(|| ratios.iter().sum::<f64>() / ratios.len() as f64);
    Ok(row)
}

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

fn pillars(pillars: &[maps::Pillar]) -> Vec<Obstacle> {
    pillars.iter().map(|[x, y, r]| Obstacle { x: *x, y: *y, r: *r, ..Obstacle::default() }).collect()
}

/// Dense corridors ([`thicket`]), one for each seed.
///
/// # Errors
/// One of the seeds has no world.
pub fn thickets(setting: &Setting, seeds: impl IntoIterator<Item = u64>) -> Result<Vec<World>, InputError> {
    let world = |seed| {
        let (obstacles, [x0, y0, x1, y1, shortest_m]) = thicket::thicket(seed)?;
        let scenario = Scenario {
            name: "thicket".to_owned(),
            bounds: thicket::BOUNDS,
            drone_radius: setting.hull_m(),
            start: [x0, y0],
            goal: [x1, y1],
            obstacles: pillars(&obstacles),
            max_time_s: 100.0,
            ..Scenario::default()
        };
        Ok(World { scenario: setting.equip(&scenario), seed, shortest_m: Some(shortest_m) })
    };
    seeds.into_iter().map(world).collect()
}

/// Forests of the main paper's densities (Table I), by turns, with so many pairs of start and goal in each.
///
/// # Errors
/// A forest cannot be drawn.
pub fn forests(
    setting: &Setting,
    seeds: impl IntoIterator<Item = u64>,
    pairs: usize,
) -> Result<Vec<World>, InputError> {
    let mut worlds = Vec::new();
    for (row, seed) in (1..=maps::TABLE_I.len() as u32).cycle().zip(seeds) {
        let Some(recipe) = Recipe::of_row(row) else { continue };
        let obstacles = maps::generate(&recipe, seed)?;
        let drawn = maps::pairs(recipe.bounds, &obstacles, setting.hull_m(), pairs, seed)?;
        for (k, [x0, y0, x1, y1, shortest_m]) in (0..).zip(drawn.pairs) {
            let scenario = Scenario {
                name: format!("forest {row}, pair {k}"),
                bounds: recipe.bounds,
                drone_radius: setting.hull_m(),
                start: [x0, y0],
                goal: [x1, y1],
                obstacles: pillars(&obstacles),
                ..Scenario::default()
            };
            let scenario = setting.equip(&scenario);
            worlds.push(World { scenario, seed: seed + k, shortest_m: Some(shortest_m) });
        }
    }
    Ok(worlds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_two_values_of_different_factors_meet_in_the_pairwise_settings() {
        let factors: [fn(&Setting) -> usize; 4] = [|s| s.sensor, |s| s.bearings, |s| s.vehicle, |s| s.hull];
        let (all, few) = (product(), pairwise());
        assert_eq!((all.len(), few.len()), (60, 15));
        for (k, a) in factors.iter().enumerate() {
            for b in &factors[..k] {
                for setting in &all {
                    let pair = (a(setting), b(setting));
                    assert!(few.iter().any(|one| (a(one), b(one)) == pair), "{setting:?}");
                }
            }
        }
    }
}
