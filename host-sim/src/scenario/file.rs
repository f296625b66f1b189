//! Scenario files: start of the vehicle, place of the beacon, obstacles between them, and how everything behaves.
//!
//! Map axes: x east, y north, metres; degrees, seconds. Every key is optional; an unknown key, or a value out of
//! range, is refused with its full path.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::disturbed::{OtherBeacon, Position, Wind};
use super::input::{InputError, check, parse_strictly};
use super::landing::Landing;
use super::people::Person;
use super::random::RandomPillars;
use super::tracks;

mod keys;
mod parts;

pub(crate) use keys::FLIGHT_KEYS;
pub(super) use keys::KEYS;
pub use parts::{
    Antenna, Bearing, BearingModel, Faults, Limits, Obstacle, Outlier, Sensor, SensorModel, Software, Vehicle,
    VehicleModel, Wall,
};

/// A flight to be simulated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct Scenario {
    /// For editors: where the schema of these files is.
    #[serde(rename = "$schema", skip_serializing_if = "Option::is_none")]
    pub schema: Option<String>,
    /// Name of the scenario.
    pub name: String,
    /// Area of the map that is drawn: west, south, east, north.
    #[schemars(inner(range(min = -10000.0, max = 10000.0)))]
    pub bounds: [f64; 4],
    /// Radius of the vehicle's hull.
    #[schemars(range(min = 0.01, max = 5.0))]
    pub drone_radius: f64,
    /// Start of the vehicle, which faces the goal.
    #[schemars(inner(range(min = -10000.0, max = 10000.0)))]
    pub start: [f64; 2],
    /// Place of the beacon at time zero.
    #[schemars(inner(range(min = -10000.0, max = 10000.0)))]
    pub goal: [f64; 2],
    /// Velocity of the beacon.
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub goal_velocity: [f64; 2],
    /// The pillars.
    pub obstacles: Vec<Obstacle>,
    /// People who walk about; their random motion depends on the flight's seed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub people: Vec<Person>,
    /// A CSV file of tracks of more people, with lines `time_s,person,x,y`; a relative path starts at this file's
    /// folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub people_csv: Option<PathBuf>,
    /// Random pillars, placed by the flight's seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub random: Option<RandomPillars>,
    /// Walls, which reflect the beacon's waves and are obstacles.
    pub walls: Vec<Wall>,
    /// The obstacle sensor.
    pub sensor: Sensor,
    /// The direction finding.
    pub bearing: Bearing,
    /// Directional antennas; without this there are four that receive equally from all directions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub antenna: Option<Antenna>,
    /// Other beacons, on frequencies of their own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub other_beacons: Vec<OtherBeacon>,
    /// Limits of the vehicle.
    pub limits: Limits,
    /// The vehicle's dynamics.
    pub vehicle: Vehicle,
    /// The wind; none by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wind: Option<Wind>,
    /// Errors of the autopilot's position; exact by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position: Option<Position>,
    /// How the flight ends after arrival; without this it ends within the goal tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landing: Option<Landing>,
    /// Horizontal distance to the beacon that counts as reached.
    #[schemars(range(min = 0.01, max = 100.0))]
    pub goal_tolerance: f64,
    /// Time limit of the flight.
    #[schemars(range(min = 0.1, max = 3600.0))]
    pub max_time_s: f64,
    /// How long to search while there is no signal; zero: no search.
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub explore_s: f64,
    /// Faults to inject.
    pub faults: Faults,
    /// Descriptive: why this scenario exists.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<Value>,
    /// Descriptive: which frame the numbers are in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<Value>,
    /// Descriptive: what should happen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expect: Option<Value>,
    /// Descriptive: length of a reference path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_length_m: Option<Value>,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            schema: None,
            name: "scenario".to_owned(),
            bounds: [0.0, 0.0, 10.0, 10.0],
            drone_radius: 0.15,
            start: [1.0, 1.0],
            goal: [9.0, 9.0],
            goal_velocity: [0.0, 0.0],
            obstacles: Vec::new(),
            people: Vec::new(),
            people_csv: None,
            random: None,
            walls: Vec::new(),
            sensor: Sensor::default(),
            bearing: Bearing::default(),
            antenna: None,
            other_beacons: Vec::new(),
            limits: Limits::default(),
            vehicle: Vehicle::default(),
            wind: None,
            position: None,
            landing: None,
            goal_tolerance: 0.5,
            max_time_s: 90.0,
            explore_s: 0.0,
            faults: Faults::default(),
            why: None,
            frame: None,
            expect: None,
            reference_length_m: None,
        }
    }
}

/// The built-in mission's pillars: x, y, r.
const FOREST: [[f64; 3]; 13] = [
    [2.5, 2.7, 0.30],
    [1.4, 4.2, 0.25],
    [4.2, 2.3, 0.33],
    [4.3, 4.4, 0.34],
    [2.9, 5.9, 0.28],
    [6.2, 3.6, 0.28],
    [5.6, 6.1, 0.32],
    [4.3, 7.9, 0.25],
    [7.1, 7.3, 0.33],
    [8.4, 5.2, 0.30],
    [6.0, 8.9, 0.22],
    [7.6, 2.2, 0.24],
    [8.9, 7.3, 0.22],
];

impl Scenario {
    /// The mission that is flown without a scenario file: a pillar forest, a beacon at 20 dB, a scanning sensor and
    /// a vehicle with the delays of a real autopilot.
    #[must_use]
    pub fn built_in() -> Self {
        Self {
            name: "pillar forest".to_owned(),
            obstacles: FOREST.iter().map(|[x, y, r]| Obstacle { x: *x, y: *y, r: *r, ..Obstacle::default() }).collect(),
            sensor: Sensor { model: SensorModel::Scan, ..Sensor::default() },
            bearing: Bearing { snr_db: Some(20.0), ..Bearing::default() },
            vehicle: Vehicle { model: VehicleModel::Arducopter, ..Vehicle::default() },
            ..Self::default()
        }
    }

    /// Reads a scenario.
    ///
    /// # Errors
    /// The path of the first key that is unknown, of the wrong type or out of range.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        // Invalid JSON is refused below, where the path is known.
        if let Ok(value) = serde_json::from_str::<Value>(text) {
            refuse_lists_for_objects(&value)?;
        }
        let mut document = serde_json::Deserializer::from_str(text);
        let scenario: Self = parse_strictly(&mut document, &[&FLIGHT_KEYS[..], &KEYS].concat())?;
        document.end().map_err(|error| InputError::new(error.to_string()))?;
        scenario.checked()
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The path of the first field out of range, its value and the range.
    pub fn checked(self) -> Result<Self, InputError> {
        let far = 10_000.0;
        for (index, value) in self.bounds.iter().enumerate() {
            check(&format!("bounds[{index}]"), *value, -far, far)?;
        }
        check("bounds[2]", self.bounds[2], self.bounds[0] + 0.1, far)?;
        check("bounds[3]", self.bounds[3], self.bounds[1] + 0.1, far)?;
        check("drone_radius", self.drone_radius, 0.01, 5.0)?;
        for (name, pair, limit) in
            [("start", self.start, far), ("goal", self.goal, far), ("goal_velocity", self.goal_velocity, 20.0)]
        {
            for (index, value) in pair.iter().enumerate() {
                check(&format!("{name}[{index}]"), *value, -limit, limit)?;
            }
        }
        for (index, obstacle) in self.obstacles.iter().enumerate() {
            let path = |key: &str| format!("obstacles[{index}].{key}");
            check(&path("x"), obstacle.x, -far, far)?;
            check(&path("y"), obstacle.y, -far, far)?;
            check(&path("r"), obstacle.r, 0.001, 1000.0)?;
            check(&path("vx"), obstacle.vx, -20.0, 20.0)?;
            check(&path("vy"), obstacle.vy, -20.0, 20.0)?;
            if obstacle.turns_s != 0.0 {
                check(&path("turns_s"), obstacle.turns_s, 0.5, 3600.0)?;
            }
        }
        for (index, person) in self.people.iter().enumerate() {
            person.check(&format!("people[{index}]"), self.start)?;
        }
        if let Some(random) = self.random {
            random.check()?;
        }
        for (index, wall) in self.walls.iter().enumerate() {
            let path = |key: &str| format!("walls[{index}].{key}");
            for (key, value) in [("x0", wall.x0), ("y0", wall.y0), ("x1", wall.x1), ("y1", wall.y1)] {
                check(&path(key), value, -far, far)?;
            }
            check(&path("r"), wall.r, 0.02, 10.0)?;
            check(&path("reflection_db"), wall.reflection_db, 0.0, 100.0)?;
            check(&path("passage_db"), wall.passage_db, 0.0, 100.0)?;
            let length = libm::hypot(wall.x1 - wall.x0, wall.y1 - wall.y0);
            check(&format!("walls[{index}]: its length"), length, 0.1, 1000.0 * wall.r)?;
        }
        self.refuse_start_inside()?;
        check("sensor.fov_deg", self.sensor.fov_deg, 6.0, 360.0)?;
        check("sensor.range_m", self.sensor.range_m, 0.1, 100.0)?;
        check("sensor.rays", f64::from(self.sensor.rays), 8.0, 360.0)?;
        check("sensor.turn_s", self.sensor.turn_s, 0.0, 0.1)?;
        check("bearing.sigma_deg", self.bearing.sigma_deg, 0.0, 180.0)?;
        if let Some(snr_db) = self.bearing.snr_db {
            check("bearing.snr_db", snr_db, -30.0, 80.0)?;
        }
        check("bearing.outlier.rate", self.bearing.outlier.rate, 0.0, 1.0)?;
        check("bearing.outlier.offset_deg", self.bearing.outlier.offset_deg, -360.0, 360.0)?;
        check("bearing.place_bias_deg", self.bearing.place_bias_deg, 0.0, 45.0)?;
        if let Some(rate_hz) = self.bearing.rate_hz {
            check("bearing.rate_hz", rate_hz, 0.2, 50.0)?;
        }
        let needs_noise = [
            ("bearing.place_bias_deg", self.bearing.place_bias_deg != 0.0),
            ("bearing.rate_hz", self.bearing.rate_hz.is_some()),
        ];
        if let (Some((field, _)), BearingModel::Rf) =
            (needs_noise.iter().find(|(_, is_set)| *is_set), self.bearing_model())
        {
            return Err(InputError::new(format!("{field}: only where bearing.model is not `rf`")));
        }
        if let Some(antenna) = self.antenna {
            check("antenna.exponent", antenna.exponent, 0.5, 8.0)?;
            check("antenna.front_to_back_db", antenna.front_to_back_db, 3.0, 40.0)?;
            for (index, boresight_deg) in antenna.boresight_deg.into_iter().enumerate() {
                check(&format!("antenna.boresight_deg[{index}]"), boresight_deg, -360.0, 360.0)?;
            }
            check("antenna.turn_deg_per_s", antenna.turn_deg_per_s, 23.0, 140.0)?;
            self.needs_waveforms("antenna")?;
        }
        for (index, window) in self.faults.dead_channels.into_iter().enumerate() {
            if let Some([from, to]) = window {
                check(&format!("faults.dead_channels[{index}][0]"), from, 0.0, 1e6)?;
                check(&format!("faults.dead_channels[{index}][1]"), to, from, 1e6)?;
                self.needs_waveforms(&format!("faults.dead_channels[{index}]"))?;
            }
        }
        if let Some(pulses) = self.bearing.pulses {
            pulses.check()?;
        }
        for (index, beacon) in self.other_beacons.iter().enumerate() {
            beacon.check(index)?;
            self.needs_waveforms(&format!("other_beacons[{index}]"))?;
        }
        if let Some(wind) = self.wind {
            wind.check()?;
        }
        if let Some(position) = self.position {
            position.check()?;
        }
        if let Some(landing) = self.landing {
            landing.check()?;
        }
        check("limits.v_max", self.limits.v_max, 0.05, 20.0)?;
        check("limits.v_evade", self.limits.v_evade, 0.0, 20.0)?;
        check("limits.a_max", self.limits.a_max, 0.1, 20.0)?;
        check("vehicle.lag_s", self.vehicle.lag_s, 0.0, 5.0)?;
        if self.explore_s != 0.0 {
            check("explore_s", self.explore_s, 1.0, 3600.0)?;
        }
        check("goal_tolerance", self.goal_tolerance, 0.01, 100.0)?;
        check("max_time_s", self.max_time_s, 0.1, 3600.0)?;
        for (name, window) in [
            ("bearing.dropout", self.bearing.dropout),
            ("faults.nan_bearing", self.faults.nan_bearing),
            ("faults.stale_obstacles", self.faults.stale_obstacles),
            ("faults.stale_ownship", self.faults.stale_ownship),
        ] {
            if let Some([from, to]) = window {
                check(&format!("{name}[0]"), from, 0.0, 1e6)?;
                check(&format!("{name}[1]"), to, from, 1e6)?;
            }
        }
        if let Some(at) = self.faults.clock_back_s {
            check("faults.clock_back_s", at, 0.0, 1e6)?;
        }
        Ok(self)
    }

    /// Refuses a start inside an obstacle. A hull that only touches one may start, and fly away from it.
    fn refuse_start_inside(&self) -> Result<(), InputError> {
        let [x, y] = self.start;
        let pillars = self.obstacles.iter().enumerate().map(|(index, obstacle)| {
            (format!("obstacles[{index}]"), libm::hypot(obstacle.x - x, obstacle.y - y) < obstacle.r)
        });
        let walls = self.walls.iter().enumerate().map(|(index, wall)| {
            let [along_x, along_y] = [wall.x1 - wall.x0, wall.y1 - wall.y0];
            let squared = (along_x * along_x + along_y * along_y).max(1e-12);
            let share = (((x - wall.x0) * along_x + (y - wall.y0) * along_y) / squared).clamp(0.0, 1.0);
            let away = libm::hypot(wall.x0 + share * along_x - x, wall.y0 + share * along_y - y);
            (format!("walls[{index}]"), away < wall.r)
        });
        match pillars.chain(walls).find(|(_, is_inside)| *is_inside) {
            Some((what, _)) => Err(InputError::new(format!("start = [{x}, {y}] is inside {what}"))),
            None => Ok(()),
        }
    }

    /// The same, with the people of its CSV file added.
    pub(crate) fn with_tracks(mut self) -> Result<Self, InputError> {
        let Some(path) = self.people_csv.take() else { return Ok(self) };
        for (name, person) in tracks::read(&path)? {
            person.check(&format!("person {name}"), self.start).map_err(|error| error.in_file(&path))?;
            self.people.push(person);
        }
        Ok(self)
    }

    /// Refuses keys that need waveforms where bearings are simulated.
    fn needs_waveforms(&self, field: &str) -> Result<(), InputError> {
        match self.bearing_model() {
            BearingModel::Rf => Ok(()),
            BearingModel::Noise | BearingModel::Uudf | BearingModel::Hci => {
                Err(InputError::new(format!("{field}: needs bearing.model `rf`; other models have no channels")))
            }
        }
    }

    /// Down coordinate of the flight, in the local frame.
    #[must_use]
    pub fn flight_down_m(&self) -> f64 {
        self.landing.map_or(FLIGHT_DOWN_M, |landing| -landing.height)
    }

    /// Source of the bearings: antenna waveforms if a signal-to-noise ratio is given and the model is not.
    #[must_use]
    pub fn bearing_model(&self) -> BearingModel {
        let default = if self.bearing.snr_db.is_some() { BearingModel::Rf } else { BearingModel::Noise };
        self.bearing.model.unwrap_or(default)
    }
}

/// A derived reader would accept a list for an object, field by field.
fn refuse_lists_for_objects(value: &Value) -> Result<(), InputError> {
    let mut places = vec![("scenario".to_owned(), Some(value))];
    for name in ["sensor", "bearing", "limits", "vehicle", "faults"] {
        places.push((name.to_owned(), value.get(name)));
    }
    places.push(("bearing.outlier".to_owned(), value.pointer("/bearing/outlier")));
    // These may be null.
    for name in ["antenna", "random", "wind", "position", "landing", "landing.camera", "bearing.pulses"] {
        let place = value.pointer(&format!("/{}", name.replace('.', "/")));
        places.push((name.to_owned(), place.filter(|value| !value.is_null())));
    }
    for name in ["obstacles", "people", "walls", "other_beacons"] {
        for (index, entry) in value.get(name).and_then(Value::as_array).into_iter().flatten().enumerate() {
            places.push((format!("{name}[{index}]"), Some(entry)));
        }
    }
    match places.into_iter().find(|(_, place)| place.is_some_and(|value| !value.is_object())) {
        Some((path, _)) => Err(InputError::new(format!("{path}: expected an object {{...}}"))),
        None => Ok(()),
    }
}

/// Height of the flight above the local origin: 2 m up.
pub const FLIGHT_DOWN_M: f64 = -2.0;

/// Whether `time_s` is inside a window.
#[must_use]
pub fn inside(window: Option<[f64; 2]>, time_s: f64) -> bool {
    window.is_some_and(|[from, to]| time_s >= from && time_s < to)
}

#[cfg(test)]
mod tests;
