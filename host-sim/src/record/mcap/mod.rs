//! Writes a flight as an MCAP file for Foxglove and similar viewers: map, 3-D, plots (`docs/simulator.md`).
//!
//! A [`Log`] watches the flight as the report does, and writes the [`Recorder`]'s records of each step as JSON
//! messages, every topic with its schema. Foxglove's own message types are used where they exist. Times are those of
//! the flight, from its first step. The file is written in chunks during the flight, and gets its name when it is complete.
//!
//! | file | content |
//! |---|---|
//! | `frame.rs` | NED and forward-right-down to the east-north-up and forward-left-up of viewers |
//! | `schema.rs` | schemas of the messages |
//! | `message.rs` | our messages |
//! | `scene.rs` | drawings |

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ::mcap::records::MessageHeader;
use ::mcap::write::Metadata;
use ::mcap::{Attachment, McapError, WriteOptions, Writer};
use foxhound_core::guidance;
use foxhound_core::guidance::param::Values;
use serde_json::{Value, json};

use crate::drive::flight::{Ending, Mission, Moment, Report};
use crate::record::report::Recorder;
use crate::record::report::record::{Begin, Plan, Record, Remembered, Step, Tracks};
use crate::scenario::input::InputError;
use crate::scenario::output::{self, Output};
use frame::{Enu, Rotation, enu};

mod frame;
mod message;
mod scene;
mod schema;

/// Steps between drawings of the moment: 10 Hz.
const MOMENT_STEPS: u64 = 5;
/// Steps between drawings of the path flown: 1 Hz, and its largest number of points.
const WAY_STEPS: u64 = 50;
const WAY_POINTS: usize = 500;
/// Height of drawn pillars, in heights of the flight, and its minimum.
const PILLAR_HEIGHTS: f64 = 2.0;
const PILLAR_MIN_M: f64 = 2.0;

type Schema = fn() -> Value;

/// The topics, and the schema of each.
const TOPICS: [(&str, Schema); 21] = [
    ("/tf", schema::frame_transform),
    ("/pose", schema::pose_in_frame),
    ("/log", schema::log),
    ("/scene/world", schema::scene_update),
    ("/scene/remembered", schema::scene_update),
    ("/scene/plan", schema::scene_update),
    ("/scene/way", schema::scene_update),
    ("/scene/moment", schema::scene_update),
    ("/scene/tracks", schema::scene_update),
    ("/potential", schema::grid),
    ("/vehicle", schema::vehicle),
    ("/beacon", schema::beacon),
    ("/bearing", schema::bearing),
    ("/setpoint", schema::setpoint),
    ("/outcome", schema::outcome),
    ("/guard", schema::guard),
    ("/evader", schema::evader),
    ("/source", schema::source),
    ("/remembered", schema::remembered),
    ("/tracks", schema::tracks),
    ("/plan", schema::plan),
];

/// Writes a flight.
pub struct Log {
    file: Mcap,
    recorder: Recorder,
    /// The last outcome, which is written again only when it has changed.
    outcome: &'static str,
    pillars: Option<Vec<[f64; 3]>>,
    way: Way,
    steps: u64,
    time_ns: u64,
    radius_m: f64,
}

impl Log {
    /// Begins a file: the parameters, and the command that repeats the flight.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(
        path: &Path,
        mission: &Mission,
        config: &guidance::Config,
        values: &Values,
        command: String,
    ) -> Result<Self, InputError> {
        let mut log = Self {
            file: Mcap::create(path)?,
            recorder: Recorder::new(mission, config, values, command),
            outcome: "",
            pillars: None,
            way: Way::default(),
            steps: 0,
            time_ns: 0,
            radius_m: f64::from(config.vehicle.radius_m),
        };
        for record in log.recorder.take() {
            if let Record::Begin(begin) = record {
                log.begin(&begin);
            }
        }
        Ok(log)
    }

    /// Adds a step. [`Self::end`] reports an error.
    pub fn watch(&mut self, moment: &Moment<'_>) {
        self.recorder.watch(moment);
        let place = enu(moment.motion.pose.position_ned_m);
        for record in self.recorder.take() {
            match record {
                Record::Step(step) => self.step(moment, place, &step),
                Record::Remembered(remembered) => self.remembered(&remembered),
                Record::Plan(plan) => self.plan(&plan, place),
                Record::Tracks(tracks) => self.tracks(&tracks, place),
                Record::Begin(_)
                | Record::People(_)
                | Record::Signal(_)
                | Record::Picture(_)
                | Record::Thinned(_)
                | Record::End(_) => {}
            }
        }
    }

    /// Ends with the result of the flight.
    ///
    /// # Errors
    /// The file could not be written.
    pub fn end(mut self, report: &Report) -> Result<(), InputError> {
        let result = json!(report.result);
        let result = result.as_str().unwrap_or_default();
        let level = if report.result == Ending::Reached { Level::Info } else { Level::Error };
        self.say(level, &format!("{result}: {}", report.reason));
        self.file.metadata("result", &json!(report));
        self.file.finish()
    }

    fn begin(&mut self, begin: &Begin) {
        let Begin { program, command, seed, planner, tick_s, .. } = begin;
        let facts =
            json!({ "program": program, "command": command, "seed": seed, "planner": planner, "tick_s": tick_s });
        self.file.metadata("flight", &facts);
        self.file.attach("scenario.json", &json!(begin.scenario));
        self.file.attach("parameters.json", &json!(begin.parameters));
    }

    fn step(&mut self, moment: &Moment<'_>, place: Enu, step: &Step) {
        self.time_ns = nanoseconds(step.time_s);
        let (time_ns, motion) = (self.time_ns, moment.motion);
        let stamp = scene::stamp(time_ns);
        let attitude = Rotation::of(&motion.pose);
        let beacon = moment.world.source_at(moment.sample.time_s);
        let beacon = moment.knows_source.then(|| enu([beacon.north, beacon.east, moment.world.source_down_m]));
        self.put(
            "/tf",
            &json!({
                "timestamp": stamp, "parent_frame_id": scene::MAP, "child_frame_id": scene::VEHICLE,
                "translation": place, "rotation": attitude,
            }),
        );
        let pose = scene::pose(place, attitude);
        self.put("/pose", &json!({ "timestamp": stamp, "frame_id": scene::MAP, "pose": pose }));
        self.put("/vehicle", &message::vehicle(motion, step));
        if let Some(beacon) = message::beacon(step) {
            self.put("/beacon", &beacon);
        }
        self.put("/setpoint", &message::setpoint(step));
        self.put("/outcome", &json!({ "outcome": step.outcome }));
        self.put("/guard", &json!({ "action": step.guard }));
        self.put("/evader", &message::evader(step));
        self.put("/source", &message::source(step, beacon));
        if let Some(heard) = &step.heard {
            self.put("/bearing", &message::bearing(heard, step.truth_deg));
        }
        if step.outcome != self.outcome {
            self.outcome = step.outcome;
            self.say(if step.outcome == "nominal" { Level::Info } else { Level::Warning }, step.outcome);
        }

        if self.steps.is_multiple_of(MOMENT_STEPS) {
            self.put("/scene/moment", &scene::moment(time_ns, place, step, self.radius_m));
            let pillar = |pillar: crate::world::Pillar| [pillar.center.east, pillar.center.north, pillar.radius_m];
            let mut pillars: Vec<[f64; 3]> = moment.world.pillars_at(moment.sample.time_s).map(pillar).collect();
            let standing = pillars.len();
            pillars.extend(beacon.map(|beacon| [beacon.x, beacon.y, 0.0]));
            if self.pillars.as_ref() != Some(&pillars) {
                self.put("/scene/world", &scene::world(time_ns, &pillars[..standing], beacon, height_m(place)));
                self.pillars = Some(pillars);
            }
        }
        self.way.add(place);
        if self.steps.is_multiple_of(WAY_STEPS) {
            let way = scene::way(time_ns, &self.way.places);
            self.put("/scene/way", &way);
        }
        self.steps += 1;
    }

    fn remembered(&mut self, remembered: &Remembered) {
        let circles = &remembered.circles_m;
        let height_m = self.way.places.last().map_or(PILLAR_MIN_M, |place| height_m(*place));
        self.put("/remembered", &message::remembered(circles));
        self.put("/scene/remembered", &scene::remembered(self.time_ns, circles, height_m));
    }

    fn tracks(&mut self, tracks: &Tracks, place: Enu) {
        self.put("/tracks", &message::tracks(tracks));
        self.put("/scene/tracks", &scene::tracks(self.time_ns, tracks, place.z));
    }

    fn plan(&mut self, plan: &Plan, place: Enu) {
        self.put("/plan", &message::plan(plan));
        self.put("/scene/plan", &scene::plan(self.time_ns, plan, place.z));
        if let Some(field) = &plan.field {
            self.put("/potential", &scene::potential(self.time_ns, field, place.z));
        }
    }

    fn say(&mut self, level: Level, words: &str) {
        let stamp = scene::stamp(self.time_ns);
        let message = json!({
            "timestamp": stamp, "level": level as u8, "message": words, "name": "foxhound", "file": "", "line": 0,
        });
        self.put("/log", &message);
    }

    fn put(&mut self, topic: &str, message: &Value) {
        self.file.put(topic, self.time_ns, message);
    }
}

/// Foxglove's numbers.
#[derive(Clone, Copy)]
enum Level {
    Info = 2,
    Warning = 3,
    Error = 4,
}

/// Times of records are whole milliseconds.
fn nanoseconds(time_s: f64) -> u64 {
    libm::rint(time_s * 1e3) as u64 * 1_000_000
}

fn height_m(place: Enu) -> f64 {
    (PILLAR_HEIGHTS * place.z).max(PILLAR_MIN_M)
}

/// The path flown so far, sampled; when it gets long every other point is dropped.
#[derive(Debug)]
struct Way {
    places: Vec<Enu>,
    every: u64,
    steps: u64,
}

impl Default for Way {
    fn default() -> Self {
        Self { places: Vec::new(), every: MOMENT_STEPS, steps: 0 }
    }
}

impl Way {
    fn add(&mut self, place: Enu) {
        if self.steps.is_multiple_of(self.every) {
            self.places.push(place);
        }
        self.steps += 1;
        if self.places.len() > WAY_POINTS {
            let mut keeps = false;
            self.places.retain(|_| {
                keeps = !keeps;
                keeps
            });
            self.every *= 2;
        }
    }
}

/// The file.
struct Mcap {
    path: PathBuf,
    writer: Writer<Output>,
    /// Per topic: its channel, and its number of messages.
    channels: BTreeMap<&'static str, (u16, u32)>,
    /// The first error; nothing is written after it.
    failed: Option<McapError>,
}

impl Mcap {
    fn create(path: &Path) -> Result<Self, InputError> {
        let file = Output::create(path).map_err(named)?;
        let options = WriteOptions::new().compression(None).library(concat!("foxhound ", env!("CARGO_PKG_VERSION")));
        let begun = || {
            let mut writer = options.create(file)?;
            let mut schemas = BTreeMap::new();
            let mut channels = BTreeMap::new();
            for (topic, schema) in TOPICS {
                let schema = schema();
                let name = schema["title"].as_str().unwrap_or_default().to_owned();
                let id = match schemas.get(&name) {
                    Some(id) => *id,
                    None => writer.add_schema(&name, "jsonschema", schema.to_string().as_bytes())?,
                };
                schemas.insert(name, id);
                channels.insert(topic, (writer.add_channel(id, topic, "json", &BTreeMap::new())?, 0));
            }
            Ok((writer, channels))
        };
        let (writer, channels) = begun().map_err(|error: McapError| named(output::failed(path, &error)))?;
        Ok(Self { path: path.to_owned(), writer, channels, failed: None })
    }

    fn put(&mut self, topic: &str, time_ns: u64, message: &Value) {
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else { return };
        let header =
            MessageHeader { channel_id: *channel_id, sequence: *sequence, log_time: time_ns, publish_time: time_ns };
        *sequence += 1;
        self.then(|writer| writer.write_to_known_channel(&header, message.to_string().as_bytes()));
    }

    /// An object's fields, as text.
    fn metadata(&mut self, name: &str, of: &Value) {
        let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let fields = of.as_object().into_iter().flatten().map(|(key, value)| (key.clone(), text(value)));
        let metadata = Metadata { name: name.to_owned(), metadata: fields.collect() };
        self.then(|writer| writer.write_metadata(&metadata));
    }

    fn attach(&mut self, name: &str, of: &Value) {
        let attachment = Attachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: "application/json".to_owned(),
            data: of.to_string().into_bytes().into(),
        };
        self.then(|writer| writer.attach(&attachment));
    }

    fn then(&mut self, write: impl FnOnce(&mut Writer<Output>) -> Result<(), McapError>) {
        if self.failed.is_none() {
            self.failed = write(&mut self.writer).err();
        }
    }

    fn finish(mut self) -> Result<(), InputError> {
        self.then(|writer| writer.finish().map(drop));
        match self.failed {
            None => self.writer.into_inner().finish().map_err(named),
            Some(error) => Err(named(output::failed(&self.path, &error))),
        }
    }
}

/// The error of the option's file.
fn named(error: InputError) -> InputError {
    InputError::new(format!("--mcap {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_way_is_kept_whole_in_few_points() {
        let mut way = Way::default();
        let steps = 200_000;
        for step in 0..steps {
            way.add(Enu { x: f64::from(step), y: 0.0, z: 0.0 });
        }
        let places: Vec<f64> = way.places.iter().map(|place| place.x).collect();
        assert!((WAY_POINTS / 2..=WAY_POINTS).contains(&places.len()), "{}", places.len());
        assert_eq!(places[0], 0.0);
        let apart: Vec<f64> = places.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(apart.iter().all(|distance| *distance == way.every as f64), "{apart:?}");
        assert!(places[places.len() - 1] + way.every as f64 >= f64::from(steps));
    }
}
