//! Many flights in gusts, scene by scene: how many touch something, how many arrive.
//!
//! All fly with the whole chain from the antennas' codes on, at 20 dB, and a vehicle as slow as a real autopilot, ArduCopter
//! unless the scene says PX4 ([`crate::world::deviation`]). The air: a mean wind of 3 m/s with Dryden's gusts on top of it.

pub mod page;

use rayon::prelude::*;
use serde::Serialize;

use super::flight;
use crate::drive::flight::{Ending, Report};
use crate::drive::maps::rows::{self, Rows};
use crate::scenario::input::InputError;
use crate::scenario::{Obstacle, Position, Scenario, VehicleModel, Wind};

/// A kind of world to fly through.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scene {
    /// Its name.
    pub name: &'static str,
    /// The scenario, without its wind.
    #[serde(skip)]
    text: &'static str,
    /// Rows of pillars besides, by the seed.
    #[serde(skip)]
    rows: Option<Rows>,
}

const fn scene(name: &'static str, text: &'static str) -> Scene {
    Scene { name, text, rows: None }
}

/// Twelve metres north past two rows.
const NORTH: &str = r#"{"start":[0,0],"goal":[0,12],"bounds":[-6,-1,6,13],"sensor":{"model":"scan"},
    "bearing":{"snr_db":20},"vehicle":{"model":"arducopter"},"max_time_s":120}"#;
const WALLS: Rows =
    Rows { count: 2, first_m: 4.0, apart_m: 4.0, radius_m: 0.15, half_m: [1.0, 2.5], aside_m: 1.0, gap_m: [0.0, 0.0] };
const GAPS: Rows = Rows { half_m: [5.0, 5.0], aside_m: 2.0, gap_m: [1.5, 2.5], ..WALLS };

/// The scenes.
pub const SCENES: [Scene; 9] = [
    // The pillars of `scenarios/gusts_strong.json`.
    scene("pillars, scan", include_str!("../../../scenarios/gusts_strong.json")),
    scene(
        "pillars, scan, PX4",
        r#"{"obstacles":[{"x":2.5,"y":2.7,"r":0.3},{"x":4.2,"y":2.3,"r":0.33},{"x":4.3,"y":4.4,"r":0.34},
            {"x":2.9,"y":5.9,"r":0.28},{"x":6.2,"y":3.6,"r":0.28},{"x":5.6,"y":6.1,"r":0.32},{"x":7.1,"y":7.3,"r":0.33},
            {"x":8.4,"y":5.2,"r":0.3}],"sensor":{"model":"scan"},"bearing":{"snr_db":20},
            "vehicle":{"model":"arducopter","autopilot":"px4"}}"#,
    ),
    // Every seed places its own.
    scene(
        "forest, scan",
        r#"{"random":{"count":24},"sensor":{"model":"scan"},"bearing":{"snr_db":20},
            "vehicle":{"model":"arducopter"},"max_time_s":120}"#,
    ),
    scene(
        "forest, circles",
        r#"{"random":{"count":24},"bearing":{"snr_db":20},"vehicle":{"model":"arducopter"},"max_time_s":120}"#,
    ),
    // Two walls of 2 to 5 m across the route, to fly around.
    Scene { rows: Some(WALLS), ..scene("walls, scan", NORTH) },
    // Two walls of 10 m, each with a gap of 1.5 to 2.5 m.
    Scene { rows: Some(GAPS), ..scene("gaps, scan", NORTH) },
    // Gaps down to half a metre.
    scene(
        "thicket, scan",
        r#"{"random":{"count":62,"radius":[0.15,0.33],"gap":0.5,"clear":0.6},"sensor":{"model":"scan"},
            "bearing":{"snr_db":20},"vehicle":{"model":"arducopter"},"max_time_s":120}"#,
    ),
    scene("corridor", include_str!("../../../tests/scenarios/corridor.json")),
    // Straight and 1 m wide, along the wind, for a hull of 0.15 m.
    scene(
        "narrow corridor, PX4",
        r#"{"start":[0,0],"goal":[13,0],"drone_radius":0.15,"walls":[{"x0":-1,"y0":0.55,"x1":14,"y1":0.55,"r":0.05},
            {"x0":-1,"y0":-0.55,"x1":14,"y1":-0.55,"r":0.05}],"sensor":{"model":"scan"},"bearing":{"snr_db":20},
            "vehicle":{"model":"arducopter","autopilot":"px4"},"max_time_s":120}"#,
    ),
];

/// Those with space for the margin: walls, gaps and random pillars, by scan.
pub fn roomy() -> impl Iterator<Item = &'static Scene> {
    SCENES.iter().filter(|scene| ["walls, scan", "gaps, scan", "forest, scan"].contains(&scene.name))
}

impl Scene {
    /// The world of a seed in that weather.
    ///
    /// # Errors
    /// The scenario is refused, or its pillars do not fit.
    pub fn scenario(&self, weather: &Weather, seed: u64) -> Result<Scenario, InputError> {
        let mut scenario = Scenario::parse(self.text)?;
        (scenario.wind, scenario.position) = (weather.wind, weather.position);
        scenario.vehicle.model = VehicleModel::Arducopter;
        if let Some(recipe) = &self.rows {
            let pillars = rows::rows(recipe, seed).into_iter();
            scenario.obstacles = pillars.map(|[x, y, r]| Obstacle { x, y, r, ..Obstacle::default() }).collect();
        }
        scenario.drawn(seed)
    }
}

/// What the air does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Weather {
    /// Its name.
    pub name: &'static str,
    /// The wind.
    pub wind: Option<Wind>,
    /// What the autopilot's position is off by.
    pub position: Option<Position>,
}

const fn gusts(name: &'static str, gust_mps: f64) -> Weather {
    Weather { name, wind: Some(Wind { vx: 3.0, vy: 0.0, gust_mps, gust_s: 2.0 }), position: None }
}

const fn wandering(name: &'static str, drift_m: f64) -> Weather {
    Weather { name, wind: None, position: Some(Position { noise_m: 0.01, drift_m, drift_s: 20.0 }) }
}

/// The gusts that worlds with space for the margin should stand.
pub const STRONG: Weather = gusts("gusts, sigma 2.5 m/s", 2.5);

/// The weathers.
pub const WEATHERS: [Weather; 7] = [
    Weather { name: "calm", wind: None, position: None },
    gusts("gusts, sigma 0.5 m/s", 0.5),
    gusts("gusts, sigma 1 m/s", 1.0),
    gusts("gusts, sigma 1.5 m/s", 1.5),
    gusts("gusts, sigma 2 m/s", 2.0),
    STRONG,
    gusts("gusts, sigma 3 m/s", 3.0),
];

/// Calm air, and a position that wanders.
pub const WANDERING: [Weather; 3] = [
    wandering("position wanders by 0.1 m", 0.1),
    wandering("position wanders by 0.2 m", 0.2),
    wandering("position wanders by 0.3 m", 0.3),
];

/// Results of the flights of one scene in one weather.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// The scene.
    pub scene: &'static str,
    /// The weather.
    pub weather: &'static str,
    /// How many.
    pub flights: u32,
    /// Those with a collision, by their seeds.
    pub collided: Vec<u64>,
    /// Those that reached the beacon.
    pub reached: u32,
    /// Mean duration of those that did.
    pub time_s: f64,
    /// Least clearance of all, and the tenth percentile.
    pub clearance_m: [f64; 2],
}

/// The flights with these seeds.
///
/// # Errors
/// The scenario is refused, or a flight cannot be flown.
pub fn row(scene: &Scene, weather: &Weather, seeds: std::ops::Range<u64>) -> Result<Row, InputError> {
    let fly = |seed| flight::report(scene.scenario(weather, seed)?, seed, |_| ());
    let reports: Vec<Report> = seeds.into_par_iter().map(fly).collect::<Result<_, InputError>>()?;
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
