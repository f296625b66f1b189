//! Repeats a flight from its log: all input of the flight computer goes into one in this process, step by step, and
//! the trace hashes are compared. If they differ, the flight did not happen as logged, or the program is another
//! version.
//!
//! | part | comparison |
//! |---|---|
//! | link, parameters, guidance, planner | to the last bit, every step |
//! | front end, frames whose samples are logged | anew, without its earlier knowledge of tone and noise: if both bearings are valid, azimuths within three standard deviations |
//! | front end, the other frames | none: their bearings are used as they are |
//!
//! A gap in the log ends the comparison of a flight; the next one that begins is repeated.

use std::collections::VecDeque;

use foxhound_computer::flight::{Flight, ParameterStore, Receiver, Step};
use foxhound_computer::iq::Reports;
use foxhound_computer::log::frame::{Frame, LogDeframer};
use foxhound_computer::log::{self, Beginning, LAYOUT, Record, Writer};
use foxhound_computer::sensor::{self, Sensor};
use foxhound_computer::twin::Planned;
use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::{Circle, Disc};
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::guidance::param::{self, Values};
use foxhound_core::guidance::systems::Systems as _;
use foxhound_core::guidance::{self, FrontEnd, Guidance, Measurement, Output};
use foxhound_core::landing::observation::PadObservation;
use foxhound_core::planning::planner::{Answer, Workspace};
use foxhound_link::companion::{self, Companion};
use foxhound_papers::AllSystems;
use serde::Serialize;

use super::computer::BLOCK;
use crate::scenario::input::InputError;

/// Plans that may wait: one that is obsolete, and the next.
const PLANS: usize = 2;
const SIGMAS: f32 = 3.0;
/// A frame is identified by the time of its middle; frames are 20 ms apart.
const MIDDLE_OFF_MAX_US: u64 = 1_000;

/// Result of a replay.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Frames of the log.
    pub frames: u64,
    /// Pieces of the file that are not frames.
    pub rubbish: u64,
    /// Whether the file ends inside a frame, or with something that is none, such as a damaged one.
    pub ends_inside: bool,
    /// Number of gaps.
    pub gaps: u64,
    /// Number of missing frames.
    pub frames_missing: u64,
    /// Flights that begin in the log.
    pub flights: u64,
    /// Steps that were repeated.
    pub steps: u64,
    /// Steps that missed their deadline in flight.
    pub late_steps: u32,
    /// Frames whose samples went through the front end again.
    pub codes_checked: u64,
    /// Those with a different result.
    pub codes_off: u64,
    /// The hash at the end of the replay.
    pub trace_hash: String,
    /// The first step with a different result, counted from 0 at the beginning of its flight.
    pub first_difference: Option<u64>,
    /// Its flight, counted from 1.
    pub first_difference_flight: Option<u64>,
    /// Time of that step.
    pub first_difference_s: Option<f64>,
}

impl Summary {
    /// Whether the log is complete and every result the same.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.gaps == 0 && self.first_difference.is_none() && self.codes_off == 0
    }

    /// The result in words.
    #[must_use]
    pub fn verdict(&self) -> String {
        match (self.first_difference, self.first_difference_flight, self.first_difference_s) {
            (Some(step), Some(flight), Some(time_s)) => {
                format!("differs from step {step} of flight {flight} on, at {time_s:.2} s")
            }
            _ if self.codes_off > 0 => format!("front end differs in {} frames", self.codes_off),
            _ if self.gaps > 0 => "identical, as far as it is complete".to_owned(),
            _ if self.ends_inside => "ends inside a frame: identical as far as it goes".to_owned(),
            _ => "identical".to_owned(),
        }
    }
}

/// Repeats all of a log: a file, or a capture of the port, with anything before it and in it.
///
/// # Errors
/// No flight begins in it, or it was written by another version.
pub fn replay(bytes: &[u8]) -> Result<Summary, InputError> {
    let mut replay = Replay::default();
    let (mut deframer, mut rubbish_before) = (LogDeframer::new(), 0);
    for byte in bytes {
        if let Some(frame) = deframer.push(*byte) {
            replay.read(&frame)?;
            rubbish_before = deframer.rubbish();
        }
    }
    let mut summary = replay.summary;
    summary.rubbish = deframer.rubbish();
    // The number of the next frame would tell that one is missing, but there is none.
    summary.ends_inside = deframer.is_inside() || summary.rubbish > rubbish_before;
    match (summary.flights, summary.frames) {
        (0, 0) => Err(InputError::new("no flight log found")),
        (0, _) => Err(InputError::new("the flight log has no beginning: the capture started later than the computer")),
        _ => Ok(summary),
    }
}

/// A step of a log that is followed.
#[derive(Clone, Debug)]
pub(crate) struct Followed {
    /// Counted from 0 at the beginning of its flight.
    pub(crate) number: u64,
    /// Its result here.
    pub(crate) output: Output,
    /// The hash in the log.
    pub(crate) trace_hash: u64,
    /// A plan that was requested in it.
    pub(crate) plan: Option<Planned>,
    /// Bytes of the autopilot that were received before it.
    pub(crate) bytes: Vec<u8>,
    /// Its frame.
    pub(crate) snapshot: Option<Box<AdcFrame<BLOCK>>>,
}

/// Repeats a flight while its log is written, including the front end: the samples of its frames are available.
#[derive(Default)]
pub(crate) struct Follower {
    replay: Replay,
    deframer: Box<LogDeframer>,
}

impl Follower {
    /// A frame that the computer was given; the time of its middle need not be exact.
    pub(crate) fn offer(&mut self, snapshot: AdcFrame<BLOCK>) {
        self.replay.offered.push_back(snapshot);
    }

    /// Takes bytes of the log; returns the steps that they complete.
    ///
    /// # Errors
    /// The log is of another version, has a gap, or uses a frame that was not offered.
    pub(crate) fn hear(&mut self, bytes: &[u8]) -> Result<Vec<Followed>, InputError> {
        self.replay.follows = true;
        for byte in bytes {
            if let Some(frame) = self.deframer.push(*byte) {
                self.replay.read(&frame)?;
            }
        }
        match self.replay.summary.frames_missing {
            0 => Ok(std::mem::take(&mut self.replay.followed)),
            missing => Err(InputError::new(format!("the flight log lacks {missing} frames"))),
        }
    }

    /// The parameters in use.
    pub(crate) fn parameters(&self) -> Option<&Values> {
        self.replay.flown.as_ref().map(|flown| flown.companion.parameters())
    }

    /// The configuration at the beginning of the flight.
    pub(crate) fn begun_with(&self) -> Option<&guidance::Config> {
        self.replay.flown.as_ref().map(|flown| &flown.begun_with)
    }
}

#[derive(Default)]
struct Replay {
    summary: Summary,
    next: Option<u32>,
    /// Late steps of the starts before this one.
    late_before: u32,
    flown: Option<Box<Flown>>,
    /// The planner's memory is kept from flight to flight, as in the firmware.
    workspace: Box<Workspace>,
    /// Its steps are returned, made from the samples that were offered.
    follows: bool,
    offered: VecDeque<AdcFrame<BLOCK>>,
    followed: Vec<Followed>,
}

impl Replay {
    fn read(&mut self, frame: &Frame<'_>) -> Result<(), InputError> {
        self.summary.frames += 1;
        // Other records of another version cannot be read, or not rightly.
        if let Some(Writer { version, layout, param_layout }) = Writer::of(frame)
            && (layout, param_layout) != (LAYOUT, param::LAYOUT)
        {
            return Err(InputError::new(format!(
                "the flight log was written by version {version}, whose records differ: their layout is {layout} and that of \
                 its parameters {param_layout}, here {LAYOUT} and {}",
                param::LAYOUT
            )));
        }
        let record = Record::of(frame);
        self.follow(frame.number, matches!(record, Some(Record::Begin(_))));
        record.map_or(Ok(()), |record| self.take(record))
    }

    /// The offered frame whose middle is at this time.
    fn offered_at(&mut self, time: Instant) -> Result<Box<AdcFrame<BLOCK>>, InputError> {
        while let Some(mut snapshot) = self.offered.pop_front() {
            if snapshot.time.0.abs_diff(time.0) < MIDDLE_OFF_MAX_US {
                snapshot.time = time;
                return Ok(Box::new(snapshot));
            }
        }
        Err(InputError::new(format!("the frame of {:.6} s was not among the given frames", time.0 as f64 * 1e-6)))
    }

    /// Follows the numbers of the frames; a gap ends the flight, whose state is then unknown.
    fn follow(&mut self, number: u32, is_beginning: bool) {
        let expected = self.next.replace(number.wrapping_add(1));
        if number == 0 && is_beginning {
            // The computer was switched on.
            *self.workspace = Workspace::default();
            // It counts from zero again.
            self.late_before = self.summary.late_steps;
            return;
        }
        if let Some(missing) = expected.map(|expected| number.wrapping_sub(expected)).filter(|missing| *missing != 0) {
            self.summary.gaps += 1;
            // Numbers that run backwards belong to another log.
            self.summary.frames_missing += u64::from(if missing < 1 << 31 { missing } else { 0 });
            self.flown = None;
        }
    }

    fn take(&mut self, record: Record<'_>) -> Result<(), InputError> {
        match record {
            Record::Begin(begin) => {
                self.flown = Some(Flown::begin(&begin)?);
                self.summary.flights += 1;
            }
            Record::Late(late) => self.summary.late_steps = self.late_before.saturating_add(late.late),
            Record::Text(_) => {}
            Record::Step(step) => {
                // The bearings of a radio are in the bytes of its line, not in a frame.
                let has_radio = self.flown.as_ref().is_some_and(|flown| flown.config.radio.is_some());
                let by_frames = self.follows && !has_radio;
                let taken = step.heard.as_ref().filter(|_| by_frames).map(|heard| heard.bearing.time);
                let snapshot = taken.map(|time| self.offered_at(time)).transpose()?;
                if let Some(flown) = &mut self.flown {
                    let bytes = if self.follows { flown.bytes.concat() } else { Vec::new() };
                    let number = flown.steps;
                    let (output, plan) = flown.step(&step, snapshot.as_deref(), &mut self.workspace, &mut self.summary);
                    if self.follows {
                        let trace_hash = u64::from_le_bytes(step.trace_hash);
                        self.followed.push(Followed { number, output, trace_hash, plan, bytes, snapshot });
                    }
                }
            }
            other => {
                if let Some(flown) = &mut self.flown {
                    flown.take(other, &mut self.summary);
                }
            }
        }
        Ok(())
    }
}

/// A flight that is repeated.
struct Flown {
    begun_with: guidance::Config,
    config: guidance::Config,
    guidance: Guidance<BLOCK>,
    state: guidance::State<BLOCK>,
    systems: AllSystems,
    companion: Companion,
    receiver: Receiver,
    sensor: Option<Sensor>,
    reports: Reports,
    plans: VecDeque<Answer>,
    steps: u64,
    has_differed: bool,
    /// The last measurement.
    heard: Option<Measurement>,
    /// Input of the next step.
    bytes: Vec<Vec<u8>>,
    turned: Vec<Vec<u8>>,
    circles: Option<Vec<Circle>>,
    look: Option<PadObservation>,
    answers: Answers,
}

impl Flown {
    fn begin(begin: &Beginning<'_>) -> Result<Box<Self>, InputError> {
        let values = begin.values.as_slice().try_into().map(|values| Values::restore(values).0);
        let Ok(values) = values else { return Err(InputError::new("the flight log's parameters are incomplete")) };
        let guidance = AllSystems::guidance(&begin.config)?;
        let mut companion = companion::Config::default().build_with(values)?;
        if begin.needs_entry {
            companion.require_entry();
        }
        let mut reports = Reports::new();
        Ok(Box::new(Self {
            begun_with: begin.config,
            config: begin.config,
            state: guidance.start(),
            guidance,
            systems: AllSystems::build(&begin.config)?,
            companion,
            receiver: Receiver::new(None),
            sensor: sensor::build(&begin.config, &mut reports)?,
            reports,
            plans: VecDeque::new(),
            steps: 0,
            has_differed: false,
            heard: None,
            bytes: Vec::new(),
            turned: Vec::new(),
            circles: None,
            look: None,
            answers: Answers::default(),
        }))
    }

    fn take(&mut self, record: Record<'_>, summary: &mut Summary) {
        match record {
            Record::Bytes(bytes) => self.bytes.push(bytes.to_vec()),
            Record::Sensor(bytes) => self.turned.push(bytes.to_vec()),
            Record::Circles(circles) => self.circles = Some(circles.to_vec()),
            Record::Look(look) => self.look = Some(look),
            Record::Codes(codes) => {
                // With a radio the bearings are not those of the converters.
                if self.config.radio.is_none()
                    && let (Some(snapshot), Some(heard)) = (codes.snapshot(), &self.heard)
                {
                    summary.codes_checked += 1;
                    summary.codes_off += u64::from(!self.is_heard_in(heard, &snapshot));
                }
            }
            Record::Saved(is_saved) => self.answers.saved.push_back(is_saved),
            Record::Loaded(values) => self.answers.loaded.push_back(
                values.and_then(|values| values.as_slice().try_into().ok().map(|values| Values::restore(values).0)),
            ),
            Record::Begin(_) | Record::Step(_) | Record::Late(_) | Record::Text(_) => {}
        }
    }

    /// One step, with the measurement of its frame, or with the frame itself.
    fn step(
        &mut self,
        step: &log::Step<Measurement>,
        snapshot: Option<&AdcFrame<BLOCK>>,
        workspace: &mut Workspace,
        summary: &mut Summary,
    ) -> (Output, Option<Planned>) {
        self.heard = step.heard;
        let answer = step.plan.and_then(|id| self.plans.iter().rev().find(|answer| answer.plan.id == id).cloned());
        let (circles, look) = (self.circles.take(), self.look.take());
        let (bytes, mut answers) = (std::mem::take(&mut self.bytes), std::mem::take(&mut self.answers));
        let turned = std::mem::take(&mut self.turned);
        let mut flight = self.flight();
        for piece in &bytes {
            flight.hear(step.now, piece);
        }
        for piece in &turned {
            flight.hear_sensor(step.now, piece);
        }
        flight.serve(&mut answers);
        let heard = step.heard.as_ref().map_or(FrontEnd::Nothing, FrontEnd::Measured);
        let front_end = snapshot.map_or(heard, FrontEnd::Frame);
        let now = Step { now: step.now, front_end, circles: circles.as_deref(), look, answer: answer.as_ref() };
        let output = flight.step(&now, || 0).output;
        // Its output is discarded.
        while self.companion.transmit(&mut [0; 512]) > 0 {}
        let mut planned = None;
        if step.ordered {
            let known: Vec<Disc> = self.state.map().discs().collect();
            let answer = self.systems.answer(workspace, self.state.request(), &known);
            planned = Some(Planned {
                id: answer.plan.id,
                waypoints_ned_m: answer.plan.waypoints_ned_m,
                samples_ned_m: workspace.samples,
                ticks: 0,
            });
            self.plans.push_back(answer);
            if self.plans.len() > PLANS {
                self.plans.pop_front();
            }
        }
        if !self.has_differed && output.trace_hash != u64::from_le_bytes(step.trace_hash) {
            self.has_differed = true;
            if summary.first_difference.is_none() {
                summary.first_difference = Some(self.steps);
                summary.first_difference_flight = Some(summary.flights);
                summary.first_difference_s = Some(step.now.0 as f64 * 1e-6);
            }
        }
        summary.trace_hash = format!("{:016x}", output.trace_hash);
        self.steps += 1;
        summary.steps += 1;
        (output, planned)
    }

    fn flight(&mut self) -> Flight<'_, AllSystems> {
        let Self { config, guidance, state, systems, companion, receiver, sensor, reports, .. } = self;
        Flight { config, guidance, state, systems, companion, receiver, sensor, reports }
    }

    /// Whether the samples give the logged measurement, as far as that can be compared.
    fn is_heard_in(&self, heard: &Measurement, snapshot: &AdcFrame<BLOCK>) -> bool {
        let mut fresh = self.guidance.start();
        let (then, now) = (&heard.bearing, &self.guidance.bearing(&mut fresh, &self.systems, snapshot));
        let apart_rad = wrap_pi(then.azimuth_rad - now.azimuth_rad);
        !(then.valid && now.valid) || apart_rad.abs() <= SIGMAS * then.sigma_rad.max(now.sigma_rad)
    }
}

/// Results of the storage in flight.
#[derive(Default)]
struct Answers {
    saved: VecDeque<bool>,
    loaded: VecDeque<Option<Values>>,
}

impl ParameterStore for Answers {
    fn save(&mut self, _values: &Values) -> bool {
        self.saved.pop_front().unwrap_or(false)
    }

    fn load(&mut self) -> Option<Values> {
        self.loaded.pop_front().flatten()
    }

    fn reset(&mut self) -> bool {
        self.saved.pop_front().unwrap_or(false)
    }
}
