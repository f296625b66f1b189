//! Scenario files: start of the vehicle, place of the beacon, obstacles between them, and how everything behaves.
//!
//! Map axes: x east, y north, metres; degrees, seconds. Every key is optional; an unknown key, or a value out of
//! range, is refused with its full path.

use std::path::PathBuf;
use std::sync::LazyLock;

use foxhound_core::base::config::RangeSensor;
use foxhound_core::mapping::coverage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::TICK_S;
use super::disturbed::{OtherBeacon, Position, Wind};
use super::input::{InputError, check};
use super::landing::Landing;
use super::people::Person;
use super::random::RandomPillars;
use super::schema::Schema;
use super::tracks;

mod parts;

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
        let scenario = SCHEMA.read::<Self>(text)?.checked()?;
        scenario.refuse_start_inside()?;
        Ok(scenario)
    }

    /// Checks every number. Whether the start is free is not asked: beside a real autopilot it is not known yet.
    ///
    /// # Errors
    /// The path of the first field out of range, its value and the range.
    pub fn checked(self) -> Result<Self, InputError> {
        SCHEMA.check(&serde_json::to_value(&self).map_err(|error| InputError::new(error.to_string()))?)?;
        let far = 10_000.0;
        check("bounds[2]", self.bounds[2], self.bounds[0] + 0.1, far)?;
        check("bounds[3]", self.bounds[3], self.bounds[1] + 0.1, far)?;
        for (index, obstacle) in self.obstacles.iter().enumerate().filter(|(_, obstacle)| obstacle.turns_s != 0.0) {
            check(&format!("obstacles[{index}].turns_s"), obstacle.turns_s, 0.5, 3600.0)?;
        }
        for (index, person) in self.people.iter().enumerate() {
            person.check(&format!("people[{index}]"), self.start)?;
        }
        if let Some(random) = self.random {
            check("random.radius[1]", random.radius[1], random.radius[0], 10.0)?;
        }
        for (index, wall) in self.walls.iter().enumerate() {
            let length = libm::hypot(wall.x1 - wall.x0, wall.y1 - wall.y0);
            check(&format!("walls[{index}]: its length"), length, 0.1, 1000.0 * wall.r)?;
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
        let is_radio = matches!(self.bearing_model(), BearingModel::Uudf | BearingModel::Hci);
        let needs_radio =
            [("bearing.mount_deg", self.bearing.mount_deg != 0.0), ("bearing.tag", self.bearing.tag != 0)];
        if let Some((field, _)) = needs_radio.iter().find(|(_, is_set)| *is_set && !is_radio) {
            return Err(InputError::new(format!("{field}: only where bearing.model is `uudf` or `hci`")));
        }
        let needs_ranges = [("sensor.noise_m", self.sensor.noise_m), ("sensor.missed", self.sensor.missed)];
        if let (Some((field, _)), SensorModel::Circles) =
            (needs_ranges.iter().find(|(_, error)| *error != 0.0), self.sensor.model)
        {
            return Err(InputError::new(format!("{field}: only where sensor.model is `scan` or `lidar`")));
        }
        let lag_s = self.sensor.lag_s;
        let is_whole = (lag_s - (lag_s / TICK_S).round() * TICK_S).abs() < 1e-6;
        if self.sensor.model == SensorModel::Scan && !is_whole {
            // It would fly with another lag than the flight computer is told of.
            let error = format!("sensor.lag_s, FH_OBS_LAG = {lag_s} is not a number of steps of {TICK_S} s");
            return Err(InputError::new(error));
        }
        if self.antenna.is_some() {
            self.needs_waveforms("antenna")?;
        }
        for (index, window) in self.faults.dead_channels.into_iter().enumerate() {
            let name = format!("faults.dead_channels[{index}]");
            check_window(&name, window)?;
            window.map_or(Ok(()), |_| self.needs_waveforms(&name))?;
        }
        if let Some(pulses) = self.bearing.pulses {
            check("bearing.pulses.length_s", pulses.length_s, 0.001, pulses.period_s)?;
        }
        for index in 0..self.other_beacons.len() {
            self.needs_waveforms(&format!("other_beacons[{index}]"))?;
        }
        if self.explore_s != 0.0 {
            check("explore_s", self.explore_s, 1.0, 3600.0)?;
        }
        let camera = self.landing.and_then(|landing| landing.camera).unwrap_or_default();
        for (name, window) in [
            ("landing.camera.cut", camera.cut),
            ("landing.camera.blind", camera.blind),
            ("bearing.dropout", self.bearing.dropout),
            ("faults.nan_bearing", self.faults.nan_bearing),
            ("faults.stale_obstacles", self.faults.stale_obstacles),
            ("faults.stale_ownship", self.faults.stale_ownship),
        ] {
            check_window(name, window)?;
        }
        let Sensor { range_m, fov_deg, .. } = self.sensor;
        let sight =
            RangeSensor { range_m: range_m as f32, fov_rad: fov_deg.to_radians() as f32, ..RangeSensor::DEFAULT };
        let hull_m = self.drone_radius as f32;
        sight.check_beyond(hull_m).map_err(|error| InputError::new(error.to_string()))?;
        let smallest_m = coverage::Config::default().smallest_obstacle_m;
        sight.check_beside(hull_m, smallest_m).map_err(|error| {
            let of_the_file = error.to_string().replace("vehicle.radius_m", "drone_radius");
            InputError::new(format!("{of_the_file} (sensor.fov_deg = {fov_deg})"))
        })?;
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

static SCHEMA: LazyLock<Schema> = LazyLock::new(|| Schema::of::<Scenario>("scenario"));

/// The JSON schema (draft 2020-12) of a scenario file.
#[must_use]
pub fn schema() -> Value {
    let mut schema = SCHEMA.root.clone();
    schema["title"] = "Foxhound scenario".into();
    schema
}

/// Refuses a time span that ends before it begins.
fn check_window(name: &str, window: Option<[f64; 2]>) -> Result<(), InputError> {
    window.map_or(Ok(()), |[from, to]| check(&format!("{name}[1]"), to, from, 1e6))
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
