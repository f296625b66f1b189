//! The flights of the comparison: maps, the readings of the paper, points that move as published.

use foxhound_core::base::config::{RangeSensor, Vehicle};
use foxhound_core::base::obstacle::Obstacle;
use foxhound_core::control::guard;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner::{self, Kind};
use foxhound_papers::apf::{self, AnyPlanner, Field};
use rayon::prelude::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde::Serialize;

use crate::drive::flight::Ending;
use crate::drive::maps::{self, Recipe, TABLE_I};
use crate::drive::suite::{Flight, Flown, Map, Place, Suite, Tally};
use crate::scenario::input::InputError;
use crate::study::reproduce::kinematic::{self, Rules, Sight};
use crate::study::reproduce::potential::Scene;
use crate::study::reproduce::settings::Settings;
use crate::world::Horizontal;

/// Maps drawn to each row of Table I.
pub const INSTANCES: u32 = 4;
/// Speed by which a path of the kinematic point is a time.
const POINT_SPEED_MPS: f64 = 1.0;

/// Another reading of the paper: what it is, the planners, the rules.
pub(super) struct Reading {
    pub(super) name: &'static str,
    pub(super) planners: [&'static str; 2],
    pub(super) rules: fn(Rules) -> Rules,
}

pub(super) const AS_PUBLISHED: [&str; 2] = ["standard", "paper"];

/// Other readings, one thing changed at a time but for the fourth.
pub(super) const READINGS: [Reading; 8] = [
    Reading {
        name: "goal reached within 0.3 m",
        planners: AS_PUBLISHED,
        rules: |rules| Rules { tolerance_m: Some(0.3), ..rules },
    },
    Reading {
        name: "nose along the way",
        planners: AS_PUBLISHED,
        rules: |rules| Rules { sight: Sight::AlongWay, ..rules },
    },
    Reading {
        name: "all pillars known",
        planners: AS_PUBLISHED,
        rules: |rules| Rules { sight: Sight::Everything, ..rules },
    },
    Reading {
        name: "all pillars known, within 0.3 m",
        planners: AS_PUBLISHED,
        rules: |rules| Rules { sight: Sight::Everything, tolerance_m: Some(0.3), ..rules },
    },
    Reading {
        name: "replan at the fourth waypoint",
        planners: AS_PUBLISHED,
        rules: |rules| Rules { followed: 4, ..rules },
    },
    Reading {
        name: "given up after 60 replans",
        planners: AS_PUBLISHED,
        rules: |rules| Rules { replans_max: 60, ..rules },
    },
    Reading {
        name: "four forces to a waypoint",
        planners: ["standard_quarters", "paper_quarters"],
        rules: |rules| rules,
    },
    Reading { name: "eq. 47 to the letter", planners: ["standard", "paper_scalar"], rules: |rules| rules },
];

/// The flight of the pictures.
#[derive(Clone, Debug)]
pub(super) struct Pictured {
    flight: Flight,
    paths: Vec<(&'static str, Vec<Horizontal>)>,
}

/// All flights of one planner, in the order of the suite.
pub(super) type Column = Vec<Flown>;

/// Draws the maps, the same that `foxhound maps` draws with this seed.
pub(super) fn drawn(settings: &Settings) -> Result<Suite, InputError> {
    let mut suite = Suite { seed: Some(settings.seed.into()), ..Suite::default() };
    for row in 1..=TABLE_I.len() as u32 {
        let recipe = Recipe::of_row(row).unwrap_or_default();
        for instance in 0..INSTANCES {
            // As even as it goes.
            let count = (settings.pairs + INSTANCES - 1 - instance) / INSTANCES;
            if count > 0 {
                let seed = Place { row, instance, pair: u32::MAX }.seed(settings.seed);
                let pillars = maps::generate(&recipe, seed)?;
                let pairs = maps::pairs(suite.bounds, &pillars, suite.drone_radius, count as usize, seed)?;
                suite.maps.push(Map::new(row, instance, pillars, pairs.pairs));
            }
        }
    }
    Ok(suite)
}

/// One pair, flown as published.
fn fly_kinematic(flight: &Flight, planner: &AnyPlanner, rules: Rules) -> (Flown, Vec<Horizontal>) {
    let flown = kinematic::fly(&flight.scenario, planner, rules, flight.seed);
    let ratio = |length_m: f64| (flight.reference_length_m > 0.0).then(|| length_m / flight.reference_length_m);
    let tolerance_m = rules.tolerance_m.unwrap_or(flight.scenario.goal_tolerance);
    let line = Flown {
        place: flight.place,
        seed: flight.seed,
        result: flown.ending,
        reason: if flown.ending == Ending::Timeout { "no_path" } else { "nominal" }.to_owned(),
        time_s: flown.length_m / POINT_SPEED_MPS,
        path_length_m: flown.length_m,
        reference_length_m: flight.reference_length_m,
        length_ratio: ratio(flown.length_m),
        whole_length_ratio: ratio(flown.length_m + tolerance_m),
        min_clearance_m: flown.min_clearance_m,
        replans: flown.replans,
        bearing_rms_deg: None,
        trace_hash: String::new(),
    };
    (line, flown.path)
}

pub(super) fn planner_of(name: &str, vehicle_radius_m: f64) -> Result<AnyPlanner, InputError> {
    let config = apf::named(name).ok_or_else(|| InputError::new(format!("{name}: no such planner")))?;
    let vehicle = Vehicle { radius_m: vehicle_radius_m as f32 };
    Ok(AnyPlanner::build(&config, &vehicle, &RangeSensor::DEFAULT, &guard::Config::default())?)
}

/// All flights as published, by the baseline and by the paper's planner.
pub(super) fn fly_published(
    flights: &[Flight],
    names: [&str; 2],
    rules: Rules,
    vehicle_radius_m: f64,
) -> Result<[Column; 2], InputError> {
    let fly = |name: &str| -> Result<Column, InputError> {
        let planner = planner_of(name, vehicle_radius_m)?;
        Ok(flights.par_iter().map(|flight| fly_kinematic(flight, &planner, rules).0).collect())
    };
    Ok([fly(names[0])?, fly(names[1])?])
}

/// What was flown.
pub(super) struct AllFlown<'a> {
    pub(super) flights: &'a [Flight],
    pub(super) by: Planners<Column>,
}

impl AllFlown<'_> {
    pub(super) fn columns(&self, takes: impl Fn(Place) -> bool) -> Columns {
        let shared: Vec<usize> = (0..self.flights.len())
            .filter(|k| takes(self.flights[*k].place))
            .filter(|k| self.by.named().iter().all(|(_, column)| column[*k].result == Ending::Reached))
            .collect();
        let relative = |column: &Column| {
            let ratio = |k: &usize| {
                let flight = &self.flights[*k];
                (column[*k].path_length_m + flight.scenario.goal_tolerance) / straight_m(flight)
            };
            let sum: f64 = shared.iter().map(ratio).sum();
            (!shared.is_empty()).then(|| sum / shared.len() as f64)
        };
        Columns {
            tallies: self.by.map(|column| Tally::of(column.iter().filter(|flown| takes(flown.place)))),
            relative_length: RelativeLength { pairs: shared.len(), of: self.by.map(relative) },
        }
    }

    /// The longest pair, of the third row if there is one, on which the others reach the goal and the baseline stalls.
    pub(super) fn pictured(&self, rules: Rules) -> Result<Option<Pictured>, InputError> {
        let tells = |k: &usize| {
            self.by.standard[*k].result == Ending::Timeout
                && self.by.paper[*k].result == Ending::Reached
                && self.by.ours[*k].result == Ending::Reached
        };
        let in_row = |row: u32| {
            let pairs = (0..self.flights.len()).filter(|k| self.flights[*k].place.row == row).filter(tells);
            pairs.max_by(|a, b| straight_m(&self.flights[*a]).total_cmp(&straight_m(&self.flights[*b])))
        };
        let Some(index) = [3, 2, 1, 4, 5].into_iter().find_map(in_row) else { return Ok(None) };
        let flight = &self.flights[index];
        let mut paths = Vec::new();
        for name in AS_PUBLISHED {
            let planner = planner_of(name, flight.scenario.drone_radius)?;
            paths.push((name, fly_kinematic(flight, &planner, rules).1));
        }
        let (_, record) = flight.fly(planner::Config::default(), Estimator::CrossSpectrum)?;
        paths.push(("Foxhound", record.path.iter().map(|sample| sample.position).collect()));
        Ok(Some(Pictured { flight: flight.clone(), paths }))
    }
}

fn straight_m(flight: &Flight) -> f64 {
    Horizontal::from_xy(flight.scenario.goal).minus(Horizontal::from_xy(flight.scenario.start)).norm()
}

impl Pictured {
    pub(super) fn scene(&self) -> Scene {
        let scenario = &self.flight.scenario;
        let config = planner::Config::of(Kind::Standard);
        let world = scenario.world();
        let reach = |pillar: &crate::world::Pillar| Obstacle {
            center_ned_m: pillar.center.to_core(),
            reach_m: (pillar.radius_m + scenario.drone_radius) as f32,
        };
        Scene {
            title: format!("Potential (eq. 36, 37) on a map of row {}", self.flight.place.row),
            bounds: scenario.bounds,
            field: Field { law: config.law, gains: config.gains },
            obstacles: world.pillars.iter().map(reach).collect(),
            pillars: world.pillars.iter().map(|pillar| (pillar.center, pillar.radius_m)).collect(),
            start: Horizontal::from_xy(scenario.start),
            goal: Horizontal::from_xy(scenario.goal),
            paths: self.paths.clone(),
        }
    }
}

/// Something of each planner, with its model of motion.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Planners<T> {
    /// The paper's baseline as published.
    pub standard: T,
    /// The paper's planner as published.
    pub paper: T,
    /// The baseline with dynamics, tracker and guard.
    pub standard_full_loop: T,
    /// The paper's planner with dynamics, tracker and guard.
    pub paper_full_loop: T,
    /// Ours with dynamics, tracker and guard.
    pub ours: T,
}

impl<T> Planners<T> {
    pub(super) fn named(&self) -> [(&'static str, &T); 5] {
        [
            ("standard", &self.standard),
            ("paper", &self.paper),
            ("standard in loop", &self.standard_full_loop),
            ("paper in loop", &self.paper_full_loop),
            ("Foxhound in loop", &self.ours),
        ]
    }

    fn map<U>(&self, of: impl Fn(&T) -> U) -> Planners<U> {
        Planners {
            standard: of(&self.standard),
            paper: of(&self.paper),
            standard_full_loop: of(&self.standard_full_loop),
            paper_full_loop: of(&self.paper_full_loop),
            ours: of(&self.ours),
        }
    }
}

/// How all planners flew.
#[derive(Clone, Debug, Serialize)]
pub struct Columns {
    /// How many arrived, and the like.
    #[serde(flatten)]
    pub tallies: Planners<Tally>,
    /// Length over the straight line.
    pub relative_length: RelativeLength,
}

/// Mean length over the straight line, on the pairs that all of these reached. What was left to the goal is in the length.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RelativeLength {
    /// How many pairs.
    pub pairs: usize,
    /// The lengths.
    #[serde(flatten)]
    pub of: Planners<Option<f64>>,
}
