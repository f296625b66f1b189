//! Scenario files: where the vehicle starts, where the beacon is, what stands between, and how everything behaves.
//!
//! Map axes: x east, y north, metres; degrees, seconds. Every key may be missing; a key that is not known, or a value out
//! of range, is refused with its full path.

use foxhound_core::adc::CHANNELS;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::autopilot::Software;
use crate::input::{InputError, check, parse_strictly};
use crate::rays;
use crate::world::{Horizontal, Pillar, World};

/// A flight to be simulated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Scenario {
    /// What it is called.
    pub name: String,
    /// The map that is drawn: west, south, east, north.
    pub bounds: [f64; 4],
    /// Radius of the vehicle's hull.
    pub drone_radius: f64,
    /// Where the vehicle starts, facing the goal.
    pub start: [f64; 2],
    /// Where the beacon is at time zero.
    pub goal: [f64; 2],
    /// How the beacon moves.
    pub goal_velocity: [f64; 2],
    /// The pillars.
    pub obstacles: Vec<Obstacle>,
    /// Walls, which reflect the beacon's waves and are in their way.
    pub walls: Vec<Wall>,
    /// The obstacle sensor.
    pub sensor: Sensor,
    /// The direction finding.
    pub bearing: Bearing,
    /// What kind of antennas there are; without it four that hear the same all round.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub antenna: Option<Antenna>,
    /// Limits of the vehicle.
    pub limits: Limits,
    /// The vehicle's dynamics.
    pub vehicle: Vehicle,
    /// Horizontal distance to the beacon that counts as reached.
    pub goal_tolerance: f64,
    /// When the flight is given up.
    pub max_time_s: f64,
    /// For how long a signal is searched for when there is none; zero: not at all.
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

/// A vertical pillar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Obstacle {
    /// East.
    pub x: f64,
    /// North.
    pub y: f64,
    /// Radius.
    pub r: f64,
    /// Velocity to the east.
    #[serde(default)]
    pub vx: f64,
    /// Velocity to the north.
    #[serde(default)]
    pub vy: f64,
}

/// A vertical wall. It is as thick as the pillars that it is made of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    /// East, of one end.
    pub x0: f64,
    /// North.
    pub y0: f64,
    /// East, of the other end.
    pub x1: f64,
    /// North.
    pub y1: f64,
    /// Half its thickness.
    #[serde(default = "half_a_wall")]
    pub r: f64,
    /// What a wave loses that is reflected.
    #[serde(default = "reflection_loss")]
    pub reflection_db: f64,
    /// What a wave loses that goes through.
    #[serde(default = "passage_loss")]
    pub passage_db: f64,
}

fn half_a_wall() -> f64 {
    0.2
}

fn reflection_loss() -> f64 {
    6.0
}

fn passage_loss() -> f64 {
    30.0
}

impl Wall {
    /// The row of pillars that it is: so near to one another that nothing gets through.
    fn pillars(self) -> impl Iterator<Item = Pillar> {
        let (from, to) = (Horizontal::from_xy([self.x0, self.y0]), Horizontal::from_xy([self.x1, self.y1]));
        let gaps = libm::ceil(to.minus(from).norm() / (1.5 * self.r)).max(1.0);
        (0..=gaps as u32).map(move |k| Pillar {
            center: from.along(to.minus(from), f64::from(k) / gaps),
            radius_m: self.r,
            velocity_mps: Horizontal::default(),
        })
    }
}

/// The obstacle sensor on the nose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Sensor {
    /// Width of the field of view.
    pub fov_deg: f64,
    /// How far it sees.
    pub range_m: f64,
    /// Whether pillars hide what is behind them.
    pub occlusion: bool,
    /// What it delivers.
    pub model: SensorModel,
}

/// What the obstacle sensor delivers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorModel {
    /// The visible pillars, exactly.
    #[default]
    Circles,
    /// Distances in 72 sectors, as an `OBSTACLE_DISTANCE` message.
    Scan,
}

/// The direction finding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Bearing {
    /// The goal is never given to the planner; else it is told its place, unless that moves.
    pub only: bool,
    /// Antenna waveforms, or bearings with noise.
    pub model: Option<BearingModel>,
    /// Standard deviation of the noise model.
    pub sigma_deg: f64,
    /// Signal-to-noise ratio per sample of the waveforms.
    pub snr_db: Option<f64>,
    /// Wrong bearings.
    pub outlier: Outlier,
    /// From when to when nothing is received.
    pub dropout: Option<[f64; 2]>,
}

/// Where bearings come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BearingModel {
    /// Simulated antennas, through the whole signal chain.
    Rf,
    /// The true bearing and Gaussian noise.
    Noise,
}

/// Wrong bearings: a share of them is off by an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Outlier {
    /// Share of the bearings.
    pub rate: f64,
    /// By how much they are off.
    pub offset_deg: f64,
}

/// Directional antennas: with one of them, or with fewer than three of four, a vehicle seeks by turning.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Antenna {
    /// There is one antenna only, on the first channel.
    pub single: bool,
    /// Exponent of the raised cosine: 2 is a cardioid, more a narrower lobe.
    pub exponent: f64,
    /// Gain to the front over that to the back.
    pub front_to_back_db: f64,
    /// Where each antenna points, from the nose, clockwise.
    pub boresight_deg: [f64; CHANNELS],
    /// How fast the vehicle turns when it seeks by turning; to the right.
    pub turn_deg_per_s: f64,
}

/// Limits that the guard keeps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Limits {
    /// Speed, m/s.
    pub v_max: f64,
    /// Acceleration, m/s^2.
    pub a_max: f64,
}

/// The vehicle's dynamics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Vehicle {
    /// Which model.
    pub model: VehicleModel,
    /// Velocity lag of the point mass, s.
    pub lag_s: f64,
    /// Which autopilot flies it.
    pub autopilot: Software,
}

/// Which vehicle model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehicleModel {
    /// A point mass with a velocity lag and an acceleration limit.
    #[default]
    Point,
    /// The delays measured on ArduCopter.
    Arducopter,
}

/// Faults to inject; each from when to when.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Faults {
    /// Bearings are NaN.
    pub nan_bearing: Option<[f64; 2]>,
    /// The obstacle sensor is silent.
    pub stale_obstacles: Option<[f64; 2]>,
    /// The autopilot's clock jumps back by a second at this time.
    pub clock_back_s: Option<f64>,
    /// The autopilot's position and attitude are silent.
    pub stale_ownship: Option<[f64; 2]>,
    /// A channel hears nothing at all; for each of the four.
    pub dead_channels: [Option<[f64; 2]>; CHANNELS],
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            name: "scenario".to_owned(),
            bounds: [0.0, 0.0, 10.0, 10.0],
            drone_radius: 0.15,
            start: [1.0, 1.0],
            goal: [9.0, 9.0],
            goal_velocity: [0.0, 0.0],
            obstacles: Vec::new(),
            walls: Vec::new(),
            sensor: Sensor::default(),
            bearing: Bearing::default(),
            antenna: None,
            limits: Limits::default(),
            vehicle: Vehicle::default(),
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

impl Default for Sensor {
    fn default() -> Self {
        Self { fov_deg: 90.0, range_m: 3.0, occlusion: true, model: SensorModel::Circles }
    }
}

impl Default for Bearing {
    fn default() -> Self {
        Self { only: true, model: None, sigma_deg: 1.86, snr_db: None, outlier: Outlier::default(), dropout: None }
    }
}

impl Default for Antenna {
    fn default() -> Self {
        Self {
            single: false,
            exponent: 2.0,
            front_to_back_db: 15.0,
            boresight_deg: [0.0; CHANNELS],
            turn_deg_per_s: 70.0,
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self { v_max: 1.0, a_max: 2.0 }
    }
}

impl Default for Vehicle {
    fn default() -> Self {
        Self { model: VehicleModel::Point, lag_s: 0.15, autopilot: Software::ArduCopter }
    }
}

/// The keys that a scenario file and a suite file share, with their paths.
pub(crate) const FLIGHT_KEYS: [&str; 29] = [
    "name",
    "why",
    "frame",
    "expect",
    "bounds",
    "drone_radius",
    "sensor",
    "sensor.fov_deg",
    "sensor.range_m",
    "sensor.occlusion",
    "sensor.model",
    "bearing",
    "bearing.only",
    "bearing.model",
    "bearing.sigma_deg",
    "bearing.snr_db",
    "bearing.outlier",
    "bearing.outlier.rate",
    "bearing.outlier.offset_deg",
    "bearing.dropout",
    "limits",
    "limits.v_max",
    "limits.a_max",
    "vehicle",
    "vehicle.model",
    "vehicle.lag_s",
    "vehicle.autopilot",
    "goal_tolerance",
    "max_time_s",
];

/// The others of a scenario file.
const KEYS: [&str; 31] = [
    "start",
    "goal",
    "goal_velocity",
    "obstacles",
    "obstacles[].x",
    "obstacles[].y",
    "obstacles[].r",
    "obstacles[].vx",
    "obstacles[].vy",
    "walls",
    "walls[].x0",
    "walls[].y0",
    "walls[].x1",
    "walls[].y1",
    "walls[].r",
    "walls[].reflection_db",
    "walls[].passage_db",
    "antenna",
    "antenna.single",
    "antenna.exponent",
    "antenna.front_to_back_db",
    "antenna.boresight_deg",
    "antenna.turn_deg_per_s",
    "explore_s",
    "faults",
    "faults.nan_bearing",
    "faults.stale_obstacles",
    "faults.clock_back_s",
    "faults.stale_ownship",
    "faults.dead_channels",
    "reference_length_m",
];

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
    /// The mission that is flown when no file is given: a pillar forest, a beacon at 20 dB, a scanning sensor and a
    /// vehicle as slow as a real autopilot.
    #[must_use]
    pub fn built_in() -> Self {
        Self {
            name: "pillar forest".to_owned(),
            obstacles: FOREST.iter().map(|[x, y, r]| Obstacle { x: *x, y: *y, r: *r, vx: 0.0, vy: 0.0 }).collect(),
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
        // What is no JSON at all is refused below, where the path is known.
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
        check("sensor.fov_deg", self.sensor.fov_deg, 6.0, 360.0)?;
        check("sensor.range_m", self.sensor.range_m, 0.1, 100.0)?;
        check("bearing.sigma_deg", self.bearing.sigma_deg, 0.0, 180.0)?;
        if let Some(snr_db) = self.bearing.snr_db {
            check("bearing.snr_db", snr_db, -30.0, 80.0)?;
        }
        check("bearing.outlier.rate", self.bearing.outlier.rate, 0.0, 1.0)?;
        check("bearing.outlier.offset_deg", self.bearing.outlier.offset_deg, -360.0, 360.0)?;
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
        check("limits.v_max", self.limits.v_max, 0.05, 20.0)?;
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

    /// Refuses what the noise model knows nothing of.
    fn needs_waveforms(&self, field: &str) -> Result<(), InputError> {
        match self.bearing_model() {
            BearingModel::Rf => Ok(()),
            BearingModel::Noise => {
                Err(InputError::new(format!("{field}: there are channels only where bearing.model is `rf`")))
            }
        }
    }

    /// Where bearings come from: antenna waveforms when a signal-to-noise ratio is given and nothing else is asked.
    #[must_use]
    pub fn bearing_model(&self) -> BearingModel {
        let default = if self.bearing.snr_db.is_some() { BearingModel::Rf } else { BearingModel::Noise };
        self.bearing.model.unwrap_or(default)
    }

    /// The true world of this scenario.
    #[must_use]
    pub fn world(&self) -> World {
        let pillars = self.obstacles.iter().map(|obstacle| Pillar {
            center: Horizontal::from_xy([obstacle.x, obstacle.y]),
            radius_m: obstacle.r,
            velocity_mps: Horizontal::from_xy([obstacle.vx, obstacle.vy]),
        });
        let walls = self.walls.iter().map(|wall| rays::Wall {
            from: Horizontal::from_xy([wall.x0, wall.y0]),
            to: Horizontal::from_xy([wall.x1, wall.y1]),
            reflection_db: wall.reflection_db,
            passage_db: wall.passage_db,
        });
        World {
            pillars: pillars.chain(self.walls.iter().flat_map(|wall| wall.pillars())).collect(),
            walls: walls.collect(),
            source: Horizontal::from_xy(self.goal),
            source_velocity_mps: Horizontal::from_xy(self.goal_velocity),
            source_down_m: SOURCE_DOWN_M,
        }
    }
}

/// A derived reader would take a list for an object, field after field.
fn refuse_lists_for_objects(value: &Value) -> Result<(), InputError> {
    let mut places = vec![("scenario".to_owned(), Some(value))];
    for name in ["sensor", "bearing", "antenna", "limits", "vehicle", "faults"] {
        places.push((name.to_owned(), value.get(name)));
    }
    places.push(("bearing.outlier".to_owned(), value.pointer("/bearing/outlier")));
    for (index, obstacle) in value.get("obstacles").and_then(Value::as_array).into_iter().flatten().enumerate() {
        places.push((format!("obstacles[{index}]"), Some(obstacle)));
    }
    for (index, wall) in value.get("walls").and_then(Value::as_array).into_iter().flatten().enumerate() {
        places.push((format!("walls[{index}]"), Some(wall)));
    }
    match places.into_iter().find(|(_, place)| place.is_some_and(|value| !value.is_object())) {
        Some((path, _)) => Err(InputError::new(format!("{path}: expected an object {{...}}"))),
        None => Ok(()),
    }
}

/// Height of the flight above the local origin: 2 m up.
pub const FLIGHT_DOWN_M: f64 = -2.0;
/// Height of the beacon: a third of a metre below the flight, so that elevation is not exactly zero.
pub const SOURCE_DOWN_M: f64 = -1.7;

/// Whether `time_s` is inside a window.
#[must_use]
pub fn inside(window: Option<[f64; 2]>, time_s: f64) -> bool {
    window.is_some_and(|[from, to]| time_s >= from && time_s < to)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        Scenario::parse(text).unwrap_err().to_string()
    }

    #[test]
    fn an_empty_scenario_is_the_defaults() {
        let scenario = Scenario::parse("{}").unwrap();
        assert_eq!(scenario, Scenario::default());
        assert!(scenario.bearing.only);
        assert_eq!(scenario.bearing_model(), BearingModel::Noise);
        assert_eq!((scenario.limits.v_max, scenario.limits.a_max, scenario.max_time_s), (1.0, 2.0, 90.0));
    }

    #[test]
    fn every_key_is_taken_and_written_back() {
        let text = r#"{"name":"n","bounds":[-1,-2,12,13],"drone_radius":0.2,"start":[1,2],"goal":[3,4],
            "goal_velocity":[0.1,-0.1],"obstacles":[{"x":5,"y":6,"r":0.5,"vx":0.1,"vy":0.2},{"x":1,"y":9,"r":0.1}],
            "walls":[{"x0":-1,"y0":8,"x1":4,"y1":8,"r":0.1,"reflection_db":5,"passage_db":20}],
            "sensor":{"fov_deg":120,"range_m":4,"occlusion":false,"model":"scan"},
            "bearing":{"only":false,"model":"rf","sigma_deg":5,"snr_db":10,"outlier":{"rate":0.1,"offset_deg":60},
            "dropout":[1,2]},"antenna":{"single":true,"exponent":3,"front_to_back_db":20,"boresight_deg":[0,90,180,-90],
            "turn_deg_per_s":60},"limits":{"v_max":2,"a_max":4},"vehicle":{"model":"arducopter","lag_s":0.1,"autopilot":"px4"},
            "goal_tolerance":0.3,"max_time_s":30,"faults":{"nan_bearing":[1,2],"stale_obstacles":[3,4],"clock_back_s":5,
            "stale_ownship":[6,7],"dead_channels":[null,[1,2],null,[3,4]]},"why":"w","frame":{"x":"east"},"expect":"reached","reference_length_m":9.5}"#;
        let scenario = Scenario::parse(text).unwrap();
        assert_eq!(scenario.obstacles[0].vy, 0.2);
        let written = serde_json::to_string(&scenario).unwrap();
        assert_eq!(Scenario::parse(&written).unwrap(), scenario);
        // The list of known keys is the list of the keys that there are.
        let value: Value = serde_json::from_str(&written).unwrap();
        for key in FLIGHT_KEYS.into_iter().chain(KEYS) {
            let pointer = format!("/{}", key.replace("[]", ".0").replace('.', "/"));
            assert!(value.pointer(&pointer).is_some(), "{key} is no key of a scenario");
        }
    }

    #[test]
    fn an_snr_means_waveforms() {
        let scenario = Scenario::parse(r#"{"bearing":{"snr_db":20}}"#).unwrap();
        assert_eq!(scenario.bearing_model(), BearingModel::Rf);
        let scenario = Scenario::parse(r#"{"bearing":{"snr_db":20,"model":"noise"}}"#).unwrap();
        assert_eq!(scenario.bearing_model(), BearingModel::Noise, "said so, although there is an SNR");
        assert_eq!(Scenario::built_in().bearing_model(), BearingModel::Rf);
    }

    #[test]
    fn unknown_keys_are_named_with_their_path_and_the_nearest_known_one() {
        assert_eq!(refused(r#"{"gaol":[1,1]}"#), "gaol: unknown key; did you mean `goal`?");
        assert_eq!(refused(r#"{"sensor":{"fov":90}}"#), "sensor.fov: unknown key; did you mean `fov_deg`?");
        assert_eq!(
            refused(r#"{"bearing":{"outlier":{"rat":0.1}}}"#),
            "bearing.outlier.rat: unknown key; did you mean `rate`?"
        );
        assert!(
            refused(r#"{"obstacles":[{"x":1,"y":1,"r":1},{"x":1,"y":1,"r":1,"radius":2}]}"#)
                .starts_with("obstacles[1].radius: unknown key")
        );
        assert!(refused(r#"{"limits":{"zzz":1}}"#).contains("known here: v_max, a_max"));
        assert!(refused(r#"{"faults":{"nan_bearings":[1,2]}}"#).contains("`nan_bearing`"));
    }

    #[test]
    fn values_out_of_range_are_named_with_value_and_range() {
        assert_eq!(refused(r#"{"limits":{"v_max":-1}}"#), "limits.v_max = -1 is outside 0.05..=20");
        for (text, field) in [
            (r#"{"drone_radius":0}"#, "drone_radius"),
            (r#"{"start":[1e9,0]}"#, "start[0]"),
            (r#"{"goal":[0,-1e9]}"#, "goal[1]"),
            (r#"{"bounds":[0,0,-1,10]}"#, "bounds[2]"),
            (r#"{"obstacles":[{"x":1,"y":1,"r":1},{"x":1,"y":1,"r":-1}]}"#, "obstacles[1].r"),
            (r#"{"sensor":{"fov_deg":361}}"#, "sensor.fov_deg"),
            (r#"{"sensor":{"range_m":0}}"#, "sensor.range_m"),
            (r#"{"bearing":{"sigma_deg":-1}}"#, "bearing.sigma_deg"),
            (r#"{"bearing":{"outlier":{"rate":2}}}"#, "bearing.outlier.rate"),
            (r#"{"bearing":{"dropout":[5,4]}}"#, "bearing.dropout[1]"),
            (r#"{"vehicle":{"lag_s":-0.1}}"#, "vehicle.lag_s"),
            (r#"{"antenna":{"exponent":0}}"#, "antenna.exponent"),
            (r#"{"antenna":{"front_to_back_db":60}}"#, "antenna.front_to_back_db"),
            (r#"{"antenna":{"boresight_deg":[0,0,0,999]}}"#, "antenna.boresight_deg[3]"),
            (r#"{"antenna":{"turn_deg_per_s":0}}"#, "antenna.turn_deg_per_s"),
            (
                r#"{"bearing":{"snr_db":20},"faults":{"dead_channels":[null,null,[5,4],null]}}"#,
                "faults.dead_channels[2][1]",
            ),
            (r#"{"goal_tolerance":0}"#, "goal_tolerance"),
            (r#"{"max_time_s":-5}"#, "max_time_s"),
            (r#"{"faults":{"clock_back_s":-5}}"#, "faults.clock_back_s"),
        ] {
            let message = refused(text);
            assert!(message.starts_with(field) && message.contains("is outside"), "{text}: {message}");
        }
    }

    #[test]
    fn values_of_the_wrong_kind_are_named_with_their_path() {
        for (text, field) in [
            (r#"{"limits":{"v_max":"fast"}}"#, "limits.v_max"),
            (r#"{"start":[1]}"#, "start"),
            (r#"{"start":[1,2,3]}"#, "start"),
            (r#"{"sensor":{"model":"lidar"}}"#, "sensor.model"),
            (r#"{"vehicle":{"autopilot":"betaflight"}}"#, "vehicle.autopilot"),
            (r#"{"obstacles":[{"x":1,"y":1}]}"#, "obstacles[0]"),
            (r#"{"obstacles":[{"x":1,"y":null,"r":1}]}"#, "obstacles[0].y"),
            (r#"{"bearing":{"only":1}}"#, "bearing.only"),
            (r#"{"antenna":{"boresight_deg":[0,0]}}"#, "antenna.boresight_deg"),
            (r#"{"antenna":[true]}"#, "antenna: expected an object"),
            (r#"{"faults":{"dead_channels":[[1,2]]}}"#, "faults.dead_channels"),
        ] {
            let message = refused(text);
            assert!(message.starts_with(field), "{text}: {message}");
        }
        assert_eq!(
            refused(r#"{"antenna":{}}"#),
            "antenna: there are channels only where bearing.model is `rf`",
            "there is nothing to hear with"
        );
        let dead = refused(r#"{"faults":{"dead_channels":[null,[1,2],null,null]}}"#);
        assert!(dead.starts_with("faults.dead_channels[1]: there are channels only"), "{dead}");
        assert!(refused(r#"{"antenna":{"exponents":2}}"#).contains("`exponent`"));
        assert!(refused("{").contains("EOF"));
        assert!(refused("{} {}").contains("trailing"));
        assert!(refused(r#"{"max_time_s":1,"max_time_s":2}"#).contains("duplicate"));
        assert_eq!(refused("[]"), "scenario: expected an object {...}");
        assert_eq!(refused(r#"{"limits":[1,2]}"#), "limits: expected an object {...}");
        assert_eq!(refused(r#"{"obstacles":[[1,2,0.3]]}"#), "obstacles[0]: expected an object {...}");
    }

    #[test]
    fn the_built_in_mission_passes_its_own_checks_and_starts_clear() {
        let scenario = Scenario::built_in().checked().unwrap();
        let world = scenario.world();
        for place in [scenario.start, scenario.goal] {
            let hull = crate::world::Hull::new(&world, scenario.drone_radius, Horizontal::from_xy(place));
            assert!(hull.min_clearance_m > 0.5);
        }
    }
}
