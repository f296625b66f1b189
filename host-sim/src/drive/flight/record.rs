//! What a flight leaves behind: how it ended, where it went, what was planned.

use std::fmt;

use foxhound_computer::twin::Planned;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::guidance;
use foxhound_core::guidance::mission::Outcome;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::drive::computer::{Computer, ComputerError};
use crate::drive::landing::{Landing, Picture};
use crate::scenario::Scenario;
use crate::world::vehicle::Motion;
use crate::world::{Horizontal, World};

/// How a flight ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Within the goal tolerance.
    Reached,
    /// Standing still, with a reason.
    Hold,
    /// The hull met a pillar.
    Collision,
    /// Still under way at the end of the time.
    Timeout,
    /// Still under way when the program was told to end.
    Interrupted,
}

/// What a flight came to: the object that is printed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// The scenario's name.
    pub name: String,
    /// Seed of the flight.
    pub seed: u64,
    /// How it ended.
    pub result: Ending,
    /// The outcome that explains it, by name.
    pub reason: &'static str,
    /// Duration of the flight.
    pub time_s: f64,
    /// Length of the path flown.
    pub path_length_m: f64,
    /// Distance from the start to the goal's place at the end.
    pub straight_line_m: f64,
    /// Horizontal distance to the beacon at the end: a flight ends within the goal tolerance of it. With it the path is never
    /// shorter than the straight line.
    pub to_beacon_m: f64,
    /// Smallest distance between hull and pillars; `None` in a world without pillars.
    pub min_clearance_m: Option<f64>,
    /// Collisions, 0 or 1: the first one ends the flight; `None` where nobody can know.
    pub collisions: Option<u32>,
    /// Who provided the obstacles, beside an autopilot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub obstacles: Option<&'static str>,
    /// Plans made.
    pub replans: u32,
    /// Error of the valid bearings, rms; `None` without any.
    pub bearing_rms_deg: Option<f64>,
    /// Hash over every bearing, plan and setpoint.
    pub trace_hash: String,
    /// How the landing went, where there was to be one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landing: Option<Landing>,
    /// Carried through from the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expect: Option<Value>,
    /// Carried through from the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_length_m: Option<Value>,
}

/// One step of the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// When.
    pub time_s: f64,
    /// Where the vehicle was.
    pub position: Horizontal,
    /// Where its nose pointed.
    pub yaw_rad: f64,
    /// How far below the origin it was; negative above.
    pub down_m: f64,
    /// How fast it was, horizontally.
    pub speed_mps: f64,
    /// What guidance said.
    pub outcome: Outcome,
}

/// A plan that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Replan {
    /// When.
    pub time_s: f64,
    /// The temporary target that it was made for.
    pub target: Option<Horizontal>,
    /// The plan and its samples.
    pub plan: Planned,
}

/// One step as it happens.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    /// The world as it is.
    pub world: &'a World,
    /// How the vehicle really moves.
    pub motion: &'a Motion,
    /// The step as the record has it.
    pub sample: &'a Sample,
    /// What guidance published.
    pub output: &'a guidance::Output,
    /// The computer that flies, to look into.
    pub computer: &'a dyn Computer,
    /// What the camera that looks down has just seen, now and then.
    pub picture: Option<&'a Picture>,
}

/// Everything that a picture of the flight needs.
#[derive(Clone, Debug)]
pub struct Record {
    /// What was flown.
    pub scenario: Scenario,
    /// What it came to.
    pub report: Report,
    /// Where it went.
    pub path: Vec<Sample>,
    /// The plans on the way.
    pub replans: Vec<Replan>,
    /// The obstacles that the computer remembers at the end.
    pub remembered: Vec<Circle>,
    /// The world, and which ways people went in it.
    pub world: World,
}

/// Why a flight could not be flown to its end.
#[derive(Debug)]
pub enum FlightError {
    /// The computer failed.
    Computer(ComputerError),
}

impl fmt::Display for FlightError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Computer(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for FlightError {}

impl From<ComputerError> for FlightError {
    fn from(error: ComputerError) -> Self {
        Self::Computer(error)
    }
}
