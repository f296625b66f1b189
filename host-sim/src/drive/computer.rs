//! The companion computer in a flight: in this process, or the firmware in QEMU.
//!
//! Both drive the same [`foxhound_computer::flight`], so that their traces are equal bit for bit.

use std::fmt;

use foxhound_computer::camera::{self, Came, Camera, Sighted};
use foxhound_computer::flight::{Flight, Receiver, Step, Stepped};
use foxhound_computer::iq::Reports;
use foxhound_computer::selftest::Report;
use foxhound_computer::sensor::{self, Sensor};
use foxhound_computer::twin::Planned;
use foxhound_core::ConfigError;
use foxhound_core::base::obstacle::{Circle, Disc};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::calibration::record::Calibration;
use foxhound_core::guidance::param::Values;
use foxhound_core::guidance::systems::Systems as _;
use foxhound_core::guidance::{self, FrontEnd, Guidance, Output};
use foxhound_core::localize::source::support::Support;
use foxhound_core::planning::planner::{Answer, Plan, Workspace};
use foxhound_link::companion::{self, Companion};
use foxhound_link::signing::Signing;
use foxhound_papers::AllSystems;

mod record;
mod store;

use record::Recording;
use store::Store;

/// Samples per channel of one frame.
pub const BLOCK: usize = foxhound_computer::SAMPLES_PER_CHANNEL;

/// Buffer for the bytes that the link sends in one step.
const TRANSMIT_BYTES: usize = 4096;

/// The result of one step.
#[derive(Clone, Debug, PartialEq)]
pub struct StepReport {
    /// Output of guidance.
    pub output: Output,
    /// A plan that was finished in this step.
    pub plan: Option<Planned>,
    /// Bytes for the autopilot.
    pub tx: Vec<u8>,
}

/// The planner's input and samples of a plan.
#[derive(Clone, Copy, Debug)]
pub struct Considered<'a> {
    /// The obstacles that it knew.
    pub known: &'a [Disc],
    /// Its answer.
    pub plan: &'a Plan,
    /// Where the source may be, as the request had it.
    pub support: &'a Support,
    /// Its samples, if this plan needed any; otherwise the earlier ones.
    pub workspace: &'a Workspace,
}

/// Why a computer stopped working.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComputerError(pub String);

impl fmt::Display for ComputerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for ComputerError {}

/// A companion computer.
pub trait Computer {
    /// Does one step, with the frame and the autopilot's bytes; returns the result and the bytes for the autopilot.
    ///
    /// # Errors
    /// The computer does not answer as it should.
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError>;

    /// Passes bytes of camera frames to it, as they arrive at the maintenance port before the next step.
    ///
    /// # Errors
    /// The computer does not accept them.
    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError>;

    /// Passes bytes of a lidar, or of a radio, to it, as they arrive on its line before the next step.
    ///
    /// # Errors
    /// The computer has no such line, or does not accept them.
    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError>;

    /// When its next step will be, in seconds since its start, if it keeps its own time: the simulation follows it.
    fn next_step_s(&self) -> Option<f64> {
        None
    }

    /// Whether the mode has to be entered after its start before it has control.
    fn needs_entry(&self) -> bool {
        false
    }

    /// Records its flight log from now on, if it has one.
    fn log_flight(&mut self) {}

    /// The flight log since the last call.
    fn take_flight_log(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// Sends a text of up to 50 bytes to the pilot; false if that is not possible.
    fn tell(&mut self, _text: &str) -> bool {
        false
    }

    /// The use of its time since its start, as text, if it is measured.
    fn time_spent(&mut self) -> Option<String> {
        None
    }

    /// The computer in this process whose state is this one's, if it can be read.
    fn inside(&self) -> Option<&HostComputer> {
        None
    }
}

/// The computer in this process.
#[derive(Debug)]
pub struct HostComputer {
    config: guidance::Config,
    companion: Companion,
    guidance: Guidance<BLOCK>,
    state: guidance::State<BLOCK>,
    systems: AllSystems,
    workspace: Workspace,
    finished: Option<Answer>,
    /// The obstacles of that plan.
    known: Vec<Disc>,
    store: Option<Store>,
    recording: Option<Recording>,
    receiver: Receiver,
    camera: Camera,
    sighted: Option<Sighted>,
    sensor: Option<Sensor>,
    reports: Reports,
    /// Bytes of the sensor for the next step.
    turned: Vec<u8>,
}

impl HostComputer {
    /// A computer that has just been switched on.
    ///
    /// # Errors
    /// The field of the configuration that is refused.
    pub fn new(config: &guidance::Config) -> Result<Self, ConfigError> {
        Self::with_values(config, Values::of(config))
    }

    /// The same, whose link has other parameters than the defaults.
    ///
    /// # Errors
    /// The field that is refused.
    pub fn with_values(config: &guidance::Config, values: Values) -> Result<Self, ConfigError> {
        let guidance = AllSystems::guidance(config)?;
        let mut reports = Reports::new();
        Ok(Self {
            config: *config,
            companion: companion::Config::default().build_with(values)?,
            state: guidance.start(),
            systems: AllSystems::build(config)?,
            workspace: Workspace::default(),
            finished: None,
            known: Vec::new(),
            store: None,
            recording: None,
            receiver: Receiver::new(None),
            camera: Camera::new(camera::detector(config)?),
            sighted: None,
            sensor: sensor::build(config, &mut reports)?,
            reports,
            turned: Vec::new(),
            guidance,
        })
    }

    /// Signs the link's messages from now on, and requires signatures.
    pub fn sign_with(&mut self, signing: Signing) {
        self.companion.sign_with(Some(signing));
    }

    /// Control is given only when the mode is entered from now on, as after a start of the firmware.
    pub fn require_entry(&mut self) {
        self.companion.require_entry();
    }

    /// The configuration in use.
    #[must_use]
    pub const fn config(&self) -> &guidance::Config {
        &self.config
    }

    /// The parameters in use, with those of the link.
    #[must_use]
    pub const fn parameters(&self) -> &Values {
        self.companion.parameters()
    }

    /// The state of guidance: its map, tracks and belief.
    #[must_use]
    pub const fn state(&self) -> &guidance::State<BLOCK> {
        &self.state
    }

    /// The input and samples of the plan of the last step, if there is one.
    #[must_use]
    pub fn considered(&self) -> Option<Considered<'_>> {
        let plan = &self.finished.as_ref()?.plan;
        let support = &self.state.request().support;
        Some(Considered { known: &self.known, plan, support, workspace: &self.workspace })
    }

    /// The result of the last test of the receiver.
    #[must_use]
    pub const fn examined(&self) -> Option<&Report> {
        self.receiver.test().report()
    }

    /// The calibration measured since the last call.
    pub fn take_calibration(&mut self) -> Option<Calibration> {
        self.parts().0.take_calibration()
    }

    /// The flight's parts, and the storage of its parameters.
    fn parts(&mut self) -> (Flight<'_, AllSystems>, &mut Option<Store>) {
        let Self { config, guidance, state, systems, companion, store, receiver, sensor, reports, .. } = self;
        (Flight { config, guidance, state, systems, companion, receiver, sensor, reports }, store)
    }
}

impl Computer for HostComputer {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        let answer = self.finished.take();
        let look = self.sighted.take().map(|sighted| sighted.look(now));
        let mut recording = self.recording.take();
        let turned = std::mem::take(&mut self.turned);
        let (mut flight, store) = self.parts();
        flight.hear(now, rx);
        let is_turned = flight.hear_sensor(now, &turned);
        let begins_anew = match &mut recording {
            Some(recording) => recording.write(|log| {
                log.hear(rx);
                if is_turned {
                    log.hear_sensor(&turned);
                }
                flight.serve(&mut log.parameter_store(store))
            }),
            None => flight.serve(store),
        };
        let answer = answer.as_ref().filter(|_| !begins_anew);
        let step = Step { now, front_end, circles, look, answer };
        let stepped = flight.step(&step, || 0);
        let Stepped { output, .. } = stepped;
        if let Some(recording) = &mut recording {
            recording.write(|log| log.step(front_end, circles, look.as_ref(), &stepped, output.plan_requested));
        }
        self.recording = recording;
        let mut tx = vec![0; TRANSMIT_BYTES];
        let length = self.companion.transmit(&mut tx);
        tx.truncate(length);
        let mut planned = None;
        if output.plan_requested {
            self.known = self.state.map().discs().collect();
            let answer = self.systems.answer(&mut self.workspace, self.state.request(), &self.known);
            planned = Some(Planned {
                id: answer.plan.id,
                waypoints_ned_m: answer.plan.waypoints_ned_m,
                samples_ned_m: self.workspace.samples,
                ticks: 0,
            });
            self.finished = Some(answer);
        }
        Ok(StepReport { output, plan: planned, tx })
    }

    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        let height_m = self.state.height_m();
        // As the firmware does: with the parameters in use now.
        let detector = camera::detector(&self.config).map_err(|error| ComputerError(error.to_string()))?;
        self.camera.set_detector(detector);
        for byte in bytes {
            if let Some(Came::Sighted(sighted)) = self.camera.push(*byte, height_m) {
                self.sighted = Some(sighted);
            }
        }
        Ok(())
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.turned.extend_from_slice(bytes);
        Ok(())
    }

    fn log_flight(&mut self) {
        let mut recording = Recording::default();
        recording.write(|log| log.begin("simulated", false, &self.parts().0));
        self.recording = Some(recording);
    }

    fn take_flight_log(&mut self) -> Vec<u8> {
        self.recording.as_mut().map(Recording::take).unwrap_or_default()
    }

    fn tell(&mut self, text: &str) -> bool {
        self.companion.notify_text(text)
    }

    fn inside(&self) -> Option<&HostComputer> {
        Some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::Autopilot;
    use crate::scenario::Scenario;
    use crate::world::Pose;
    use crate::world::vehicle::Vehicle;
    use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
    use foxhound_core::guidance::mission::Outcome;
    use foxhound_link::dialect::DISTANCE_SENSOR_DATA;
    use foxhound_link::framer::{FRAME_MAX, Header, encode_data};

    const WALL_NORTH_M: f64 = 5.0;
    const STEP_S: f64 = 0.02;

    /// Eight beams around the vehicle, ten times a second, as the bytes of `DISTANCE_SENSOR` messages.
    fn beams(position: [f64; 3], yaw_rad: f64, sequence: &mut u8) -> Vec<u8> {
        let mut bytes = Vec::new();
        for orientation in 0..8_u8 {
            let toward = (f64::from(orientation) * std::f64::consts::FRAC_PI_4 + yaw_rad).cos();
            let range_m = if toward > 1e-3 { (WALL_NORTH_M - position[0]) / toward } else { f64::INFINITY };
            let message = DISTANCE_SENSOR_DATA {
                orientation,
                min_distance: 10,
                max_distance: 400,
                current_distance: (range_m * 100.0).round().min(401.0) as u16,
                ..DISTANCE_SENSOR_DATA::DEFAULT
            };
            let mut frame = [0; FRAME_MAX];
            let header = Header { system_id: 1, component_id: 173, sequence: *sequence };
            *sequence = sequence.wrapping_add(1);
            let length = encode_data(header, &message, &mut frame);
            bytes.extend_from_slice(&frame[..length]);
        }
        bytes
    }

    #[test]
    fn a_vehicle_with_nothing_but_distance_sensors_flies_and_stops_before_a_wall() {
        let (scenario, guidance) = (Scenario::default(), guidance::Config::default());
        let mut computer = HostComputer::new(&guidance).unwrap();
        let pose = Pose { position_ned_m: [0.0, 0.0, -5.0], ..Pose::default() };
        let mut vehicle = Vehicle::new(scenario.vehicle, scenario.limits.a_max, pose);
        let (mut autopilot, mut sequence) = (Autopilot::default(), 0);
        let (mut fastest_mps, mut northmost_m) = (0.0_f64, 0.0_f64);
        let mut outcomes = Vec::new();
        for step in 0..2000_u64 {
            let now_us = step * 20_000;
            let motion = vehicle.motion;
            autopilot.telemetry(now_us, &motion, false);
            let mut rx = autopilot.transmit();
            if step % 5 == 0 {
                rx.extend(beams(motion.pose.position_ned_m, motion.pose.yaw_rad, &mut sequence));
            }
            let now = Instant(now_us);
            // The source is far behind the wall.
            let heard = Bearing {
                time: now,
                valid: true,
                azimuth_rad: -motion.pose.yaw_rad as f32,
                sigma_rad: 0.01,
                elevation_rad: 0.0,
                elevation_sigma_rad: 1.0,
                quality: Quality::default(),
                flags: Flags::default(),
            };
            let report = computer.step(now, FrontEnd::Bearing(heard), None, &rx).unwrap();
            outcomes.push(report.output.outcome);
            autopilot.receive(now_us, &motion, &report.tx);
            vehicle.step(autopilot.command(now_us), STEP_S);
            fastest_mps = fastest_mps.max(vehicle.motion.velocity_ned_mps[0]);
            northmost_m = northmost_m.max(vehicle.motion.pose.position_ned_m[0]);
        }
        assert!(!outcomes[100..].contains(&Outcome::StaleObstacles), "beams are obstacle data");
        assert!(fastest_mps > 0.4, "it flies: {fastest_mps}");
        assert!(northmost_m > 2.0 && northmost_m < WALL_NORTH_M - 0.15, "{northmost_m}");
        assert!(computer.state().map().circles().count() > 3);
    }
}
