//! Many complete flights, scene by scene: how many land on the pad, and how the others ended.
//!
//! All fly with the whole chain from the antennas' codes on, at 20 dB, through pillars placed by the seed, with a
//! vehicle as slow as a real autopilot, to a beacon on the ground with a pad within half a metre of it. A camera of 160 by 120
//! pixels sees the ground ten times a second, 80 ms late.

use std::collections::BTreeMap;

pub mod page;

use foxhound_core::landing::Stage;
use rayon::prelude::*;
use serde::Serialize;

use super::flight;
use crate::drive::flight::{Ending, Landing, Report};
use crate::scenario::Scenario;
use crate::scenario::input::InputError;

/// A touchdown within this of the pad's middle is one on the pad.
pub const ON_PAD_M: f64 = 0.15;
/// From the beacon to the pad.
const PAD_M: f64 = 0.5;

/// A scene: sensors, weather and autopilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Scene {
    /// Its name.
    pub name: &'static str,
    /// What the scenario has under `landing`, `bearing` and `vehicle`.
    #[serde(skip)]
    parts: [&'static str; 3],
    #[serde(skip)]
    is_gusty: bool,
}

const BEARING: &str = r#"{"snr_db":20}"#;
const ARDUCOPTER: &str = r#"{"model":"arducopter"}"#;
const PX4: &str = r#"{"model":"arducopter","autopilot":"px4"}"#;

impl Scene {
    const fn calm(name: &'static str, landing: &'static str) -> Self {
        Self { name, parts: [landing, BEARING, ARDUCOPTER], is_gusty: false }
    }

    const fn gusty(name: &'static str, landing: &'static str) -> Self {
        Self { is_gusty: true, ..Self::calm(name, landing) }
    }

    const fn with(self, bearing: &'static str, vehicle: &'static str) -> Self {
        Self { parts: [self.parts[0], bearing, vehicle], ..self }
    }

    /// Its scenario, without what the seed places.
    fn text(&self) -> String {
        let [landing, bearing, vehicle] = self.parts;
        let wind = if self.is_gusty { r#""wind":{"vx":3,"gust_mps":1},"# } else { "" };
        format!(
            r#"{{"landing":{landing},"bearing":{bearing},"vehicle":{vehicle},{wind}"random":{{"count":12,"clear":1.2}},
            "sensor":{{"model":"scan"}},"goal_tolerance":1.5,"max_time_s":300}}"#
        )
    }

    /// The world of a seed.
    ///
    /// # Errors
    /// The scenario is refused, or its pillars do not fit.
    pub fn scenario(&self, seed: u64) -> Result<Scenario, InputError> {
        let mut scenario = Scenario::parse(&self.text())?;
        if let Some(landing) = &mut scenario.landing {
            // All round the beacon, by the golden angle, and evenly over the disc.
            let (turn, part) = (seed as f64 * 2.399_963, libm::sqrt((seed as f64 * 0.618_034) % 1.0));
            landing.pad = [PAD_M * part * libm::cos(turn), PAD_M * part * libm::sin(turn)];
        }
        scenario.drawn(seed)
    }
}

/// The scenes.
pub const SCENES: [Scene; 10] = [
    Scene::calm("camera, calm", "{}"),
    Scene::gusty("camera, gusts of 3 m/s", "{}"),
    Scene::gusty("camera, gusts of 3 m/s, red things about", r#"{"camera":{"distractors":true}}"#),
    Scene::gusty("camera, gusts of 3 m/s, PX4, no range finder", r#"{"range_finder":false}"#).with(BEARING, PX4),
    Scene::gusty("camera, from 6 m, gusts of 3 m/s", r#"{"height":6}"#),
    Scene::gusty("camera that fails on the last metres", r#"{"camera":{"cut":[16,300]}}"#),
    Scene::gusty("camera, no pad there", r#"{"pad_missing":true}"#),
    Scene::calm("no camera, calm", r#"{"camera":null}"#),
    Scene::gusty("no camera, gusts of 3 m/s", r#"{"camera":null}"#),
    Scene::gusty("no camera, no range finder, bearings to 10 deg only", r#"{"camera":null,"range_finder":false}"#)
        .with(r#"{"sigma_deg":10}"#, ARDUCOPTER),
];

/// Results of the flights of one scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// The scene.
    pub scene: &'static str,
    /// How many.
    pub flights: u32,
    /// Those with a collision, by their seeds.
    pub collided: Vec<u64>,
    /// Those that came down within [`ON_PAD_M`] of the pad's middle.
    pub on_pad: u32,
    /// Those that came down elsewhere, by their seeds.
    pub beside: Vec<u64>,
    /// Those that hover and have handed over, by their reasons; of these, how many within the tolerance of the beacon.
    pub handed_over: BTreeMap<&'static str, [u32; 2]>,
    /// Those still flying at the time limit, or that had given up, by their seeds.
    pub unfinished: Vec<u64>,
    /// From the pad's middle to the touchdown: the median, 99 of 100, the farthest; `None` where nothing came down.
    pub pad_m: Option<[f64; 3]>,
    /// Mean duration of the flights that came down or handed over.
    pub time_s: f64,
}

/// The flights with these seeds.
///
/// # Errors
/// A scenario that is refused.
pub fn row(scene: &Scene, seeds: std::ops::Range<u64>) -> Result<Row, InputError> {
    let fly = |seed| flight::report(scene.scenario(seed)?, seed, |_| ());
    let reports: Vec<Report> = seeds.into_par_iter().map(fly).collect::<Result<_, InputError>>()?;
    let mut row = Row { scene: scene.name, flights: reports.len() as u32, ..Row::default() };
    let (mut distances_m, mut times_s) = (Vec::new(), Vec::new());
    for report in &reports {
        if report.result == Ending::Collision {
            row.collided.push(report.seed);
            continue;
        }
        let Some(Landing { stage, reason, pad_distance_m, .. }) = report.landing else { continue };
        match stage {
            Stage::Landed => {
                let distance_m = pad_distance_m.unwrap_or(f64::INFINITY);
                distances_m.push(distance_m);
                if distance_m <= ON_PAD_M { row.on_pad += 1 } else { row.beside.push(report.seed) }
            }
            Stage::HandedOver => {
                let [all, near] = row.handed_over.entry(reason.unwrap_or("none")).or_default();
                *all += 1;
                *near += u32::from(report.result == Ending::Reached);
            }
            _ => {
                row.unfinished.push(report.seed);
                continue;
            }
        }
        times_s.push(report.time_s);
    }
    distances_m.sort_by(f64::total_cmp);
    let at = |share: f64| distances_m[((share * distances_m.len() as f64) as usize).min(distances_m.len() - 1)];
    row.pad_m = (!distances_m.is_empty()).then(|| [at(0.5), at(0.99), at(1.0)]);
    row.time_s = times_s.iter().sum::<f64>() / times_s.len() as f64;
    Ok(row)
}
