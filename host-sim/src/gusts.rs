//! Many flights in gusts, scene by scene: how many touch something, how many arrive.
//!
//! All fly with the whole chain from the antennas' codes on, at 20 dB, and a vehicle as slow as a
//! real autopilot, ArduCopter unless the scene says PX4 ([`crate::deviation`]). The scenes: the pillars
//! of `scenarios/gusts_strong.json`, forests that every seed plants anew, seen by a scan or told as circles, a thicket with gaps
//! down to half a metre, the corridor of `tests/scenarios`. The air: a mean wind of 3 m/s with Dryden's gusts on top of it.

use foxhound_core::bearing::Estimator;
use foxhound_core::planner;
use rayon::prelude::*;
use serde::Serialize;

use crate::computer::HostComputer;
use crate::flight::{self, Ending, Mission, Report};
use crate::scenario::{Scenario, Wind};

/// A kind of world to fly through.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Scene {
    /// Its name.
    pub name: &'static str,
    /// The scenario, without its wind.
    #[serde(skip)]
    pub scenario: &'static str,
}

/// The scenes.
pub const SCENES: [Scene; 6] = [
    Scene { name: "pillars, scan", scenario: include_str!("../../scenarios/gusts_strong.json") },
    Scene {
        name: "pillars, scan, PX4",
        scenario: r#"{"obstacles":[{"x":2.5,"y":2.7,"r":0.3},{"x":4.2,"y":2.3,"r":0.33},{"x":4.3,"y":4.4,"r":0.34},
            {"x":2.9,"y":5.9,"r":0.28},{"x":6.2,"y":3.6,"r":0.28},{"x":5.6,"y":6.1,"r":0.32},{"x":7.1,"y":7.3,"r":0.33},
            {"x":8.4,"y":5.2,"r":0.3}],"sensor":{"model":"scan"},"bearing":{"snr_db":20},
            "vehicle":{"model":"arducopter","autopilot":"px4"}}"#,
    },
    Scene {
        name: "forest, scan",
        scenario: r#"{"random":{"count":24},"sensor":{"model":"scan"},"bearing":{"snr_db":20},
            "vehicle":{"model":"arducopter"},"max_time_s":120}"#,
    },
    Scene {
        name: "forest, circles",
        scenario: r#"{"random":{"count":24},"bearing":{"snr_db":20},"vehicle":{"model":"arducopter"},"max_time_s":120}"#,
    },
    Scene {
        name: "thicket, scan",
        scenario: r#"{"random":{"count":62,"radius":[0.15,0.33],"gap":0.5,"clear":0.6},"sensor":{"model":"scan"},
            "bearing":{"snr_db":20},"vehicle":{"model":"arducopter"},"max_time_s":120}"#,
    },
    Scene { name: "corridor", scenario: include_str!("../../tests/scenarios/corridor.json") },
];

/// What the air does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Weather {
    /// Its name.
    pub name: &'static str,
    /// The wind.
    pub wind: Option<Wind>,
}

const fn gusts(gust_mps: f64) -> Option<Wind> {
    Some(Wind { vx: 3.0, vy: 0.0, gust_mps, gust_s: 2.0 })
}

/// The weathers.
pub const WEATHERS: [Weather; 5] = [
    Weather { name: "calm", wind: None },
    Weather { name: "gusts, sigma 0.4 m/s", wind: gusts(0.4) },
    Weather { name: "gusts, sigma 1 m/s", wind: gusts(1.0) },
    Weather { name: "gusts, sigma 1.5 m/s", wind: gusts(1.5) },
    Weather { name: "gusts, sigma 3 m/s", wind: gusts(3.0) },
];

/// What the flights of one scene in one weather came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// The scene.
    pub scene: &'static str,
    /// The weather.
    pub weather: &'static str,
    /// How many.
    pub flights: u32,
    /// Those that touched something, by their seeds.
    pub collided: Vec<u64>,
    /// Those that reached the beacon.
    pub reached: u32,
    /// Mean duration of those that did.
    pub time_s: f64,
    /// Least clearance of all, and the tenth percentile.
    pub clearance_m: [f64; 2],
}

/// One flight.
///
/// # Errors
/// The scenario is refused, or the flight cannot be flown.
pub fn fly(scene: &Scene, weather: &Weather, seed: u64) -> Result<Report, String> {
    let mut scenario = Scenario::parse(scene.scenario).map_err(|error| error.to_string())?;
    scenario.wind = weather.wind;
    scenario.vehicle.model = crate::scenario::VehicleModel::Arducopter;
    let scenario = scenario.drawn(seed).map_err(|error| error.to_string())?;
    let mission = Mission { scenario, seed, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum };
    let mut computer = HostComputer::new(&mission.guidance()).map_err(|error| error.to_string())?;
    let record = flight::fly(&mission, &mut computer, None, |_| ()).map_err(|error| error.to_string())?;
    Ok(record.report)
}

/// The flights with these seeds.
///
/// # Errors
/// See [`fly`].
pub fn row(scene: &Scene, weather: &Weather, seeds: std::ops::Range<u64>) -> Result<Row, String> {
    let reports: Vec<Report> =
        seeds.into_par_iter().map(|seed| fly(scene, weather, seed)).collect::<Result<_, String>>()?;
    let of = |ending: Ending| reports.iter().filter(move |report| report.result == ending);
    let reached = of(Ending::Reached).count();
    let mut clearances_m: Vec<f64> = reports.iter().filter_map(|report| report.min_clearance_m).collect();
    clearances_m.sort_by(f64::total_cmp);
    let at = |share: f64| clearances_m.get((share * clearances_m.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    Ok(Row {
        scene: scene.name,
        weather: weather.name,
        flights: reports.len() as u32,
        collided: of(Ending::Collision).map(|report| report.seed).collect(),
        reached: reached as u32,
        time_s: of(Ending::Reached).map(|report| report.time_s).sum::<f64>() / reached as f64,
        clearance_m: [at(0.0), at(0.1)],
    })
}
