//! The records: a header, then steps, the obstacle map, plans, and the end. One line of JSON each, distinguished by
//! `kind`.
//!
//! In the frame of a scenario file: x east and y north, metres, seconds, degrees from north clockwise. Numbers are
//! rounded to what a picture can show, a millimetre, a centimetre a second and a hundredth of a degree; a missing number is left out, so
//! that a record never holds NaN.

use foxhound_core::base::ned;
use foxhound_core::base::obstacle::Disc;
use foxhound_core::control::guard::Action;
use foxhound_core::landing::Stage;
use serde::Serialize;
use serde_json::Value;

use crate::drive::flight::Report;
use crate::scenario::Scenario;
use crate::world::Horizontal;

/// Version of the format; a page and its records come from the same program.
pub(super) const VERSION: u32 = 2;

/// A line.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Record {
    Begin(Box<Begin>),
    Step(Step),
    /// The obstacle map has changed.
    Remembered(Remembered),
    /// The people at their true positions.
    People(People),
    /// The objects that are tracked.
    Tracks(Tracks),
    Plan(Box<Plan>),
    /// What the antennas heard.
    Signal(Signal),
    /// A picture of the camera that looks down.
    Picture(Picture),
    Thinned(Thinned),
    End(End),
}

impl Record {
    /// Where a file has it: after the header, before the end, beside those of its kind.
    pub(super) const fn rank(&self) -> u8 {
        match self {
            Self::Begin(_) => 0,
            Self::Step(_) => 1,
            Self::Remembered(_) => 2,
            Self::People(_) => 3,
            Self::Tracks(_) => 4,
            Self::Plan(_) => 5,
            Self::Signal(_) => 6,
            Self::Picture(_) => 7,
            Self::Thinned(_) => 8,
            Self::End(_) => 9,
        }
    }
}

/// A position or a vector: east, north.
pub(crate) type Xy = [f64; 2];

/// The flight's conditions.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Begin {
    pub version: u32,
    pub program: &'static str,
    /// The command that repeats the flight.
    pub command: String,
    pub seed: u64,
    pub planner: &'static str,
    pub tick_s: f64,
    /// Mean of the random gains.
    pub gains: Gains,
    /// Farthest temporary target.
    pub horizon_m: f64,
    /// Clearance that the planner keeps, and the least that it accepts.
    pub margins_m: [f64; 2],
    /// Fastest setpoint.
    pub speed_max_mps: f64,
    /// Height of the beacon over the local origin.
    pub beacon_height_m: f64,
    /// Width of a bin of a signal's spectrum.
    pub bin_hz: f64,
    pub scenario: Scenario,
    /// The pillars that walls are made of, at their true positions: x, y, radius.
    pub walls: Vec<[f64; 3]>,
    pub parameters: Vec<Parameter>,
}

/// A parameter as a ground station shows it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    pub name: &'static str,
    pub value: Value,
    pub default: Value,
    pub unit: &'static str,
    pub what: &'static str,
}

/// A step of the fast loop: the truth, and guidance's results.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Step {
    /// Time since the first step.
    pub time_s: f64,
    /// True position of the vehicle; with a real autopilot, the reported one.
    pub place_m: Xy,
    /// Its height over the local origin.
    pub height_m: f64,
    pub yaw_deg: f64,
    pub velocity_mps: Xy,
    /// Its true velocity upwards.
    pub climb_mps: f64,
    pub setpoint_mps: Xy,
    /// Commanded velocity upwards.
    pub setpoint_climb_mps: f64,
    /// Commanded yaw rate, clockwise.
    pub yaw_rate_degps: f64,
    /// The velocity with which it would give way to moving obstacles; `None` if it need not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evasion_mps: Option<Xy>,
    pub outcome: &'static str,
    pub guard: &'static str,
    /// Its reason, where it did not just pass the command.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard_reason: Option<&'static str>,
    /// The landing, once the vehicle has come near the beacon.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landing: Option<Landing>,
    /// From the hull to the nearest pillar.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clearance_m: Option<f64>,
    /// True bearing of the beacon from the vehicle, and its distance, where they are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth_m: Option<f64>,
    /// The bearing measured in this step, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heard: Option<Bearing>,
    /// The bearing that guidance follows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub followed_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source_m: Option<Xy>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source_sigma_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_m: Option<Xy>,
}

/// The state of a landing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Landing {
    pub stage: Stage,
    /// Why it hovers, or is back in this stage.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<&'static str>,
    pub sees_pad: bool,
}

/// What the antennas heard in a step.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Signal {
    pub time_s: f64,
    /// The tone; `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tone: Option<Tone>,
    /// Power in each bin from 0 Hz on, mean of the four antennas; 0 dB is a sine that fills the converter.
    pub spectrum_db: Vec<i32>,
}

/// A tone at the four antennas.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tone {
    pub frequency_hz: f64,
    /// Amplitude at each antenna, in steps of the converter.
    pub amplitudes: [f64; 4],
    /// Phase at each antenna, after that at the first.
    pub phases_deg: [f64; 4],
}

/// A bearing.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Bearing {
    pub valid: bool,
    /// Its direction; `None` without a valid attitude.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bearing_deg: Option<f64>,
    pub sigma_deg: f64,
    /// `None` from a radio that does not tell it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snr_db: Option<f64>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flags: Vec<&'static str>,
}

/// The obstacle map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Remembered {
    pub time_s: f64,
    pub circles_m: Vec<[f64; 3]>,
}

/// The people who are present.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct People {
    pub time_s: f64,
    pub circles_m: Vec<[f64; 3]>,
}

/// The tracked objects that move. Those that stand are in the map.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tracks {
    pub time_s: f64,
    pub tracks: Vec<Track>,
}

/// An object that is tracked.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Track {
    pub place_m: Xy,
    pub velocity_mps: Xy,
    /// Covariance of position and position (m2), position and velocity (m2/s), velocity and velocity (m2/s2): the
    /// same along both axes.
    pub covariance: [f64; 3],
    /// Time since it was last seen.
    pub unseen_s: f64,
}

/// How a plan was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// One of the sampled trajectories.
    Sampled,
    /// None of them was clear: straight to the target.
    Straight,
    /// Bent to measure the range.
    Bent,
    /// The field's own trajectory, with the mean gains.
    Initial,
    /// No path is clear: stay.
    Brake,
}

/// A replan.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// When it was requested and answered; it takes effect some steps later.
    pub time_s: f64,
    /// Counts the requests.
    pub id: u32,
    pub origin: Origin,
    pub searches: bool,
    pub start_m: Xy,
    pub target_m: Xy,
    pub waypoints_m: Vec<Xy>,
    /// Its cost (eq. 41).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    pub gains: Gains,
    pub samples: Vec<Sample>,
    /// Which of them is followed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<usize>,
    /// The obstacles in the planner's request: x, y, radius.
    pub circles_m: Vec<[f64; 3]>,
    /// Likely positions of the source: x, y, weight.
    pub places: Vec<[f64; 3]>,
    /// Their mean and covariance: xx, xy, yy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub belief: Option<Belief>,
    /// The potential around the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub field: Option<Field>,
    /// Whether its samples, circles, places and potential were left out.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub thinned: bool,
    /// Hash over everything so far.
    pub trace: String,
}

/// Parameters of the field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Gains {
    pub k_att: f64,
    pub k_rep: f64,
    /// Influence range.
    pub influence_m: f64,
    /// Share of the repulsion that acts sideways.
    pub swirl: f64,
}

/// A sampled trajectory.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sample {
    pub waypoints_m: Vec<Xy>,
    pub gains: Gains,
    /// Its cost (eq. 41).
    pub cost: f64,
    pub feasible: bool,
}

/// Mean and covariance of the source's position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Belief {
    pub mean_m: Xy,
    /// xx, xy, yy.
    pub covariance_m2: [f64; 3],
}

/// The potential on a raster, row by row from the south, each from the west; without the swirl, which has no potential.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Field {
    pub south_west_m: Xy,
    pub step_m: f64,
    pub columns: usize,
    /// The potential with the gains of the plan.
    pub followed: Vec<f64>,
    /// With the mean gains.
    pub mean: Vec<f64>,
}

/// A picture of the camera that looks down: every second pixel of every second line, in 16 shades of each colour.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Picture {
    pub time_s: f64,
    pub height_m: f64,
    pub columns: usize,
    pub rows: usize,
    /// A PNG file, as Base64.
    pub png: String,
    /// The detector's result, as text.
    pub seen: &'static str,
    /// The pad, if detected: column, line, radius, in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pad: Option<[f64; 3]>,
}

/// What was left out of the file of a long flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Thinned {
    /// From which duration on a flight is long.
    pub from_s: f64,
    /// Of what.
    pub what: Vec<Thin>,
}

/// How many of some records are in the file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Thin {
    pub what: &'static str,
    pub all: u64,
    pub kept: u64,
}

/// The end of the flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct End {
    /// The object that `fly --json` prints.
    pub report: Report,
    pub steps: u64,
}

/// Rounds to a power of ten; zero has no sign.
pub(super) fn rounded(value: f64, places: i32) -> f64 {
    let scale = libm::pow(10.0, f64::from(places));
    libm::rint(value * scale) / scale + 0.0
}

/// To a centimetre a second.
pub(super) fn centi(value: f64) -> f64 {
    rounded(value, 2)
}

/// To a millimetre.
pub(super) fn milli(value: f64) -> f64 {
    rounded(value, 3)
}

/// Radians to hundredths of a degree.
pub(super) fn degrees(angle_rad: f64) -> f64 {
    rounded(angle_rad.to_degrees(), 2)
}

/// A number without the noise of its single precision; `None` if it is not finite.
pub(super) fn finite(value: f32) -> Option<f64> {
    value.is_finite().then(|| rounded(f64::from(value), 4))
}

pub(super) fn xy(vector: Horizontal) -> Xy {
    [milli(vector.east), milli(vector.north)]
}

pub(super) fn core_xy(vector: ned::Horizontal) -> Xy {
    [milli(f64::from(vector.east)), milli(f64::from(vector.north))]
}

pub(super) fn circles(discs: impl IntoIterator<Item = Disc>) -> Vec<[f64; 3]> {
    let one = |disc: Disc| {
        let [x, y] = core_xy(disc.center_ned_m);
        [x, y, milli(f64::from(disc.radius_m))]
    };
    discs.into_iter().map(one).collect()
}

pub(super) const fn guard(action: Action) -> &'static str {
    match action {
        Action::Passed => "passed",
        Action::Limited => "limited",
        Action::Looking => "looking",
        Action::Braked => "braked",
    }
}

/// Why the guard did what it did; `contradicts` if the limits of the obstacles contradict one another.
pub(super) const fn guard_reason(action: Action, contradicts: bool) -> Option<&'static str> {
    match action {
        Action::Passed => None,
        Action::Limited => Some("slowed, or deflected from an obstacle or the fence"),
        Action::Looking => Some("waits until the nose has turned to where the sensor has not looked"),
        Action::Braked if contradicts => Some("the limits of the obstacles contradict one another"),
        Action::Braked => Some("no command is clear of the obstacles and inside the fence"),
    }
}
