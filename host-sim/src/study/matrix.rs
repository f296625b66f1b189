//! Every setting that a vehicle is flown in, crossed with the others: obstacle sensor, bearings, vehicle, hull.
//!
//! Tests fly [`pairwise`], in which every two values of different factors meet at least once. `cargo xtask campaign` flies
//! [`product`], all of them, and prints a table.

pub mod page;
mod worlds;

use std::fmt;

use rayon::prelude::*;
use serde_json::Value;

use super::flight::report;
use crate::drive::flight::{Ending, Report};
use crate::scenario::input::InputError;
use crate::scenario::{Bearing, Scenario, Sensor, SensorModel, Software, Vehicle, VehicleModel};

pub use worlds::{World, barn, forests, gusty, pillars, thickets, traps};

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
/// Radii of the hull.
pub const HULLS_M: [f64; 2] = [0.15, 0.215];

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

/// Its corners: every two extreme values of sensor, vehicle and hull meet once; waveforms beside PX4.
#[must_use]
pub fn corners() -> [Setting; 4] {
    let (sensors, vehicles) = (SENSORS.len() - 1, VEHICLES.len() - 1);
    [(0, 0, 0), (0, vehicles, 1), (sensors, 0, 1), (sensors, vehicles, 0)].map(|(sensor, vehicle, hull)| Setting {
        sensor,
        bearings: vehicle.min(1),
        vehicle,
        hull,
    })
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

    /// A world as it is flown in this setting.
    #[must_use]
    pub fn equip(&self, world: &World) -> World {
        let (model, fov_deg, range_m) = SENSORS[self.sensor];
        let (vehicle, autopilot) = VEHICLES[self.vehicle];
        let scenario = &world.scenario;
        let scenario = Scenario {
            drone_radius: self.hull_m(),
            sensor: Sensor { model, fov_deg, range_m, ..scenario.sensor },
            bearing: Bearing { snr_db: SNR_DB[self.bearings], model: None, ..scenario.bearing },
            vehicle: Vehicle { model: vehicle, autopilot, ..scenario.vehicle },
            ..scenario.clone()
        };
        World { scenario, ..world.clone() }
    }

    /// Flies worlds in this setting.
    ///
    /// # Errors
    /// See [`report`].
    pub fn fly(&self, worlds: &[World]) -> Result<Row, InputError> {
        fly(&worlds.iter().map(|world| self.equip(world)).collect::<Vec<_>>())
    }
}

/// Results of the flights in one setting.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Flights.
    pub flights: u32,
    /// Those that ended as expected: at the goal, or as the scenario's `expect` says.
    pub as_expected: u32,
    /// Those that touched something.
    pub collided: Vec<Failure>,
    /// Those that did not, and ended otherwise than expected.
    pub others: Vec<Failure>,
    /// Mean of path flown, with what was left to the goal, over the shortest path, of those that reached it.
    pub length_ratio: Option<f64>,
    /// Least clearance of all.
    pub clearance_m: Option<f64>,
}

/// A flight that did not end as expected.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Its world.
    pub world: String,
    /// Its seed.
    pub seed: u64,
    /// How it ended.
    pub outcome: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, seed {}: {}", self.world, self.seed, self.outcome)
    }
}

/// Flies worlds, in parallel.
///
/// # Errors
/// See [`report`].
pub fn fly(worlds: &[World]) -> Result<Row, InputError> {
    let reports = worlds.par_iter().map(|world| report(world.scenario.clone(), world.seed, |_| ()));
    let reports = reports.collect::<Result<Vec<_>, InputError>>()?;
    let mut row = Row { flights: reports.len() as u32, ..Row::default() };
    let mut ratios = Vec::new();
    for (world, report) in worlds.iter().zip(reports) {
        row.clearance_m = report.min_clearance_m.into_iter().chain(row.clearance_m).min_by(f64::total_cmp);
        if report.result == Ending::Reached {
            ratios.extend(world.shortest_m.map(|m| (report.path_length_m + world.scenario.goal_tolerance) / m));
        }
        let failure = |outcome| Failure { world: report.name.clone(), seed: report.seed, outcome };
        if report.result == Ending::Collision {
            let depth_mm = -1000.0 * report.min_clearance_m.unwrap_or(f64::NAN);
            row.collided.push(failure(format!("collision, {depth_mm:.2} mm deep")));
        } else if ends_as_expected(&report) && is_in_time(&report) {
            row.as_expected += 1;
        } else {
            let how = format!("{:?}", report.result).to_lowercase();
            let late = if ends_as_expected(&report) { ", late" } else { "" };
            row.others.push(failure(format!("{how}, {}{late}", report.reason)));
        }
    }
    row.length_ratio = (!ratios.is_empty()).then(|| ratios.iter().sum::<f64>() / ratios.len() as f64);
    Ok(row)
}

/// As the scenario's `expect` says, or at the goal where it says nothing.
fn ends_as_expected(report: &Report) -> bool {
    let Some(expect) = &report.expect else { return report.result == Ending::Reached };
    let result = serde_json::to_value(report.result).ok();
    expect.get("result") == result.as_ref() && expect.get("reason").is_none_or(|reason| reason == report.reason)
}

/// A hold has to come within a minute, unless the scenario says otherwise.
fn is_in_time(report: &Report) -> bool {
    let within_s = report.expect.as_ref().and_then(|expect| expect.get("within_s")).and_then(Value::as_f64);
    report.result == Ending::Reached || report.time_s < within_s.unwrap_or(60.0)
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
