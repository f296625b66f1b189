//! The record of a flight: its end, its path, its plans.

use foxhound_computer::twin::Planned;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::guidance;
use foxhound_core::guidance::mission::Outcome;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::drive::computer::{BLOCK, Computer};
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
    /// The hull touched a pillar.
    Collision,
    /// Not ended by the time limit.
    Timeout,
    /// Not finished when the program was interrupted.
    Interrupted,
}

/// The result of a flight: the object that is printed.
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
    /// Distance from the start to the goal's position at the end; `None` where one of them is unknown.
    pub straight_line_m: Option<f64>,
    /// Horizontal distance to the beacon at the end: a flight ends within the goal tolerance of it. With it the path is never
    /// shorter than the straight line. `None` where it is unknown.
    pub to_beacon_m: Option<f64>,
    /// Smallest distance between hull and pillars; `None` in a world without pillars.
    pub min_clearance_m: Option<f64>,
    /// Collisions, 0 or 1: the first one ends the flight; `None` where the true obstacles are unknown.
    pub collisions: Option<u32>,
    /// Who provided the obstacles, with an autopilot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub obstacles: Option<&'static str>,
    /// Plans made.
    pub replans: u32,
    /// Error of the valid bearings, rms; `None` without any.
    pub bearing_rms_deg: Option<f64>,
    /// Hash over every bearing, plan and setpoint.
    pub trace_hash: String,
    /// Result of the landing, if the scenario has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub landing: Option<Landing>,
    /// Copied from the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expect: Option<Value>,
    /// Copied from the scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_length_m: Option<Value>,
}

/// One step of the flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// When.
    pub time_s: f64,
    /// Position of the vehicle.
    pub position: Horizontal,
    /// Direction of its nose.
    pub yaw_rad: f64,
    /// Its depth below the origin; negative above.
    pub down_m: f64,
    /// Its horizontal speed.
    pub speed_mps: f64,
    /// Outcome of the step.
    pub outcome: Outcome,
}

/// A plan that was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Replan {
    /// When.
    pub time_s: f64,
    /// Its temporary target.
    pub target: Option<Horizontal>,
    /// The plan and its samples.
    pub plan: Planned,
}

/// One step while it happens.
#[derive(Clone, Copy)]
pub struct Moment<'a> {
    /// The true world.
    pub world: &'a World,
    /// The true motion of the vehicle.
    pub motion: &'a Motion,
    /// The step in the record.
    pub sample: &'a Sample,
    /// Output of guidance.
    pub output: &'a guidance::Output,
    /// The computer, whose state may be read.
    pub computer: &'a dyn Computer,
    /// The samples of the antennas, where the waveforms are simulated.
    pub frame: Option<&'a AdcFrame<BLOCK>>,
    /// The latest picture of the camera that looks down, now and then.
    pub picture: Option<&'a Picture>,
    /// Whether the world's source is where the beacon is; a flight by a radio may not know where that is.
    pub knows_source: bool,
}

/// The data for a picture of the flight.
#[derive(Clone, Debug)]
pub struct Record {
    /// The scenario.
    pub scenario: Scenario,
    /// The result.
    pub report: Report,
    /// The path.
    pub path: Vec<Sample>,
    /// The plans.
    pub replans: Vec<Replan>,
    /// The circles of the obstacle map at the end.
    pub remembered: Vec<Circle>,
    /// The world, with the paths of people.
    pub world: World,
}
