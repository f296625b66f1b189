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

/// The topics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    Transform,
    Pose,
    Log,
    World,
    Memory,
    Plans,
    Way,
    Now,
    Moving,
    Potential,
    Vehicle,
    Beacon,
    Bearing,
    Setpoint,
    Outcome,
    Guard,
    Evader,
    Source,
    Remembered,
    Tracks,
    Plan,
}

/// A topic, its name, the name of its schema, and the schema. In the order of [`Topic`].
type Row = (Topic, &'static str, &'static str, fn() -> Value);
const TOPICS: [Row; 21] = [
    (Topic::Transform, "/tf", "foxglove.FrameTransform", schema::frame_transform),
    (Topic::Pose, "/pose", "foxglove.PoseInFrame", schema::pose_in_frame),
    (Topic::Log, "/log", "foxglove.Log", schema::log),
    (Topic::World, "/scene/world", "foxglove.SceneUpdate", schema::scene_update),
    (Topic::Memory, "/scene/remembered", "foxglove.SceneUpdate", schema::scene_update),
    (Topic::Plans, "/scene/plan", "foxglove.SceneUpdate", schema::scene_update),
    (Topic::Way, "/scene/way", "foxglove.SceneUpdate", schema::scene_update),
    (Topic::Now, "/scene/moment", "foxglove.SceneUpdate", schema::scene_update),
    (Topic::Moving, "/scene/tracks", "foxglove.SceneUpdate", schema::scene_update),
    (Topic::Potential, "/potential", "foxglove.Grid", schema::grid),
    (Topic::Vehicle, "/vehicle", "foxhound.Vehicle", schema::vehicle),
    (Topic::Beacon, "/beacon", "foxhound.Beacon", schema::beacon),
    (Topic::Bearing, "/bearing", "foxhound.Bearing", schema::bearing),
    (Topic::Setpoint, "/setpoint", "foxhound.Setpoint", schema::setpoint),
    (Topic::Outcome, "/outcome", "foxhound.Outcome", schema::outcome),
    (Topic::Guard, "/guard", "foxhound.Guard", schema::guard),
    (Topic::Evader, "/evader", "foxhound.Evader", schema::evader),
    (Topic::Source, "/source", "foxhound.Source", schema::source),
    (Topic::Remembered, "/remembered", "foxhound.Remembered", schema::remembered),
    (Topic::Tracks, "/tracks", "foxhound.Tracks", schema::tracks),
    (Topic::Plan, "/plan", "foxhound.Plan", schema::plan),
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
    /// Begins a file; `command` is the command that repeats the flight.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(
        path: &Path,
        mission: &Mission,
        config: &guidance::Config,
        command: String,
    ) -> Result<Self, InputError> {
        let mut log = Self {
            file: Mcap::create(path)?,
            recorder: Recorder::new(mission, config, command),
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
        let beacon = enu([beacon.north, beacon.east, moment.world.source_down_m]);
        self.put(
            Topic::Transform,
            &json!({
                "timestamp": stamp, "parent_frame_id": scene::MAP, "child_frame_id": scene::VEHICLE,
                "translation": place, "rotation": attitude,
            }),
        );
        let pose = scene::pose(place, attitude);
        self.put(Topic::Pose, &json!({ "timestamp": stamp, "frame_id": scene::MAP, "pose": pose }));
        self.put(Topic::Vehicle, &message::vehicle(motion, step));
        self.put(Topic::Beacon, &message::beacon(step));
        self.put(Topic::Setpoint, &message::setpoint(step));
        self.put(Topic::Outcome, &json!({ "outcome": step.outcome }));
        self.put(Topic::Guard, &json!({ "action": step.guard }));
        self.put(Topic::Evader, &message::evader(step));
        self.put(Topic::Source, &message::source(step, beacon));
        if let Some(heard) = &step.heard {
            self.put(Topic::Bearing, &message::bearing(heard, step.truth_deg));
        }
        if step.outcome != self.outcome {
            self.outcome = step.outcome;
            self.say(if step.outcome == "nominal" { Level::Info } else { Level::Warning }, step.outcome);
        }

        if self.steps.is_multiple_of(MOMENT_STEPS) {
            self.put(Topic::Now, &scene::moment(time_ns, place, step, self.radius_m));
            let pillar = |pillar: crate::world::Pillar| [pillar.center.east, pillar.center.north, pillar.radius_m];
            let mut pillars: Vec<[f64; 3]> = moment.world.pillars_at(moment.sample.time_s).map(pillar).collect();
            pillars.push([beacon.x, beacon.y, 0.0]);
            if self.pillars.as_ref() != Some(&pillars) {
                let standing = &pillars[..pillars.len() - 1];
                self.put(Topic::World, &scene::world(time_ns, standing, beacon, height_m(place)));
                self.pillars = Some(pillars);
            }
        }
        self.way.add(place);
        if self.steps.is_multiple_of(WAY_STEPS) {
            let way = scene::way(time_ns, &self.way.places);
            self.put(Topic::Way, &way);
        }
        self.steps += 1;
    }

    fn remembered(&mut self, remembered: &Remembered) {
        let circles = &remembered.circles_m;
        let height_m = self.way.places.last().map_or(PILLAR_MIN_M, |place| height_m(*place));
        self.put(Topic::Remembered, &message::remembered(circles));
        self.put(Topic::Memory, &scene::remembered(self.time_ns, circles, height_m));
    }

    fn tracks(&mut self, tracks: &Tracks, place: Enu) {
        self.put(Topic::Tracks, &message::tracks(tracks));
        self.put(Topic::Moving, &scene::tracks(self.time_ns, tracks, place.z));
    }

    fn plan(&mut self, plan: &Plan, place: Enu) {
        self.put(Topic::Plan, &message::plan(plan));
        self.put(Topic::Plans, &scene::plan(self.time_ns, plan, place.z));
        if let Some(field) = &plan.field {
            self.put(Topic::Potential, &scene::potential(self.time_ns, field, place.z));
        }
    }

    fn say(&mut self, level: Level, words: &str) {
        let stamp = scene::stamp(self.time_ns);
        let message = json!({
            "timestamp": stamp, "level": level as u8, "message": words, "name": "foxhound", "file": "", "line": 0,
        });
        self.put(Topic::Log, &message);
    }

    fn put(&mut self, topic: Topic, message: &Value) {
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
    channels: Vec<(u16, u32)>,
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
            let mut channels = Vec::new();
            for (_, topic, name, schema) in TOPICS {
                let id = match schemas.get(name) {
                    Some(id) => *id,
                    None => writer.add_schema(name, "jsonschema", schema().to_string().as_bytes())?,
                };
                schemas.insert(name, id);
                channels.push((writer.add_channel(id, topic, "json", &BTreeMap::new())?, 0));
            }
            Ok((writer, channels))
        };
        let (writer, channels) = begun().map_err(|error: McapError| named(output::failed(path, &error)))?;
        Ok(Self { path: path.to_owned(), writer, channels, failed: None })
    }

    fn put(&mut self, topic: Topic, time_ns: u64, message: &Value) {
        let (channel_id, sequence) = &mut self.channels[topic as usize];
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
    fn every_topic_is_found_in_its_row() {
        for (index, (topic, ..)) in TOPICS.into_iter().enumerate() {
            assert_eq!(topic as usize, index, "{topic:?}");
        }
    }

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
