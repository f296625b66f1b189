//! How Foxhound behaves on the link: it listens to one autopilot, and commands it only where its pilot says so.
//!
//! | link | setpoints |
//! |---|---|
//! | GUIDED or OFFBOARD, and armed | the newest published one at 20 Hz; zero velocity if older than 0.25 s or none |
//! | another mode, or disarmed | ArduPilot: none; PX4: zero velocity, without which OFFBOARD cannot be entered |
//! | no heartbeat for 2.5 s | zero velocity where there were setpoints |
//! | no heartbeat for 5 s | none; afterwards only a fresh entry into the mode gives control back |
//!
//! A setpoint is `SET_POSITION_TARGET_LOCAL_NED` with frame `LOCAL_NED` and type mask 0x05C7: the one form (velocity
//! and yaw rate) that every version of both autopilots takes the same way. The mode is never asked for, nor arming,
//! nor take-off; on the ground a climb is cut to zero.
//!
//! The autopilot is the first one that is heard; it stays so until restart, and we join its system. Sources:
//! ArduPilot's *Copter Commands in Guided Mode*, PX4's *Offboard Mode*, the MAVLink guide on heartbeats and message
//! intervals.

use foxhound_core::error::{ConfigError, Why, check};
use foxhound_core::frame::Ned;
use foxhound_core::guard::Setpoint;
use foxhound_core::guidance;
use foxhound_core::mission::{Control, Outcome};
use foxhound_core::ownship::Ownship;
use foxhound_core::scan::{Frame, Points, Scan};
use foxhound_core::time::Instant;
use foxhound_core::units::DEG_PER_RAD;

use crate::autopilot::{Attitude, Position};
use crate::dialect::{
    ATTITUDE_DATA, COMMAND_ACK_DATA, COMMAND_LONG_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA,
    LOCAL_POSITION_NED_DATA, MavAutopilot, MavCmd, MavFrame, MavLandedState, MavMessage, MavResult, MavSeverity,
    MavState, MavType, NAMED_VALUE_FLOAT_DATA, OBSTACLE_DISTANCE_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA,
    STATUSTEXT_DATA, TIMESYNC_DATA,
};
use crate::framer::{self, Framer, Header};
use crate::obstacles::{self, Heard, Reading};
use crate::outbox::{Errand, Note, Outbox};
use crate::requests::{Requests, Wish};
use crate::{CharArray, MessageData};

pub use crate::autopilot::{Autopilot, Software};

/// Ignore position, acceleration and yaw; obey velocity and yaw rate.
pub const TYPE_MASK: u16 = 0x05C7;

const HEARTBEAT_PERIOD_US: u64 = 1_000_000;
/// Four values in turn, each twice a second.
const TELEMETRY_PERIOD_US: u64 = 125_000;
const TEXT_PERIOD_US: u64 = 1_000_000;
/// A bearing older than this is not reported any more.
const BEARING_AGE_MAX_S: f32 = 0.5;
/// North-aligned obstacles need a yaw at most this old.
const YAW_AGE_MAX_S: f32 = 0.5;
/// Messages of one autopilot may overtake each other by less than this; more is a restart.
const BOOT_CLOCK_SLACK_MS: u32 = 1_000;

/// What the angles of `OBSTACLE_DISTANCE` count from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ObstacleFrame {
    /// From the nose when the autopilot is ArduPilot, which never looks at the frame field; else as the field says.
    #[default]
    Auto,
    /// As the field says: 12 from the nose, 0 and 1 from north; others are not understood.
    Field,
    /// Always from the nose.
    Body,
}

/// Configuration of the link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Our system id until an autopilot is heard, whose system we join.
    pub system_id: u8,
    /// Our component id.
    pub component_id: u8,
    /// Wanted rate of `LOCAL_POSITION_NED`; 0 leaves it to the autopilot.
    pub position_hz: f32,
    /// Wanted rate of ATTITUDE; 0 leaves it to the autopilot.
    pub attitude_hz: f32,
    /// Wanted rate of `OBSTACLE_DISTANCE`; 0 leaves it to the autopilot.
    pub obstacle_hz: f32,
    /// Wanted rate of `EXTENDED_SYS_STATE`; 0 leaves it to the autopilot.
    pub landed_hz: f32,
    /// Time from setpoint to setpoint.
    pub setpoint_period_ms: u16,
    /// A published setpoint older than this is replaced by zero velocity.
    pub setpoint_age_max_s: f32,
    /// A published setpoint faster than this is a fault and replaced by zero velocity.
    pub speed_max_mps: f32,
    /// A published setpoint that turns faster than this is a fault and replaced by zero velocity.
    pub yaw_rate_max_radps: f32,
    /// Without a heartbeat of the autopilot for this long, the link is lost.
    pub heartbeat_timeout_s: f32,
    /// Without a heartbeat of the autopilot for this long, no setpoints are sent.
    pub silence_after_s: f32,
    /// After such a silence, whether control comes back only when the mode is left and entered again.
    pub fresh_entry_after_silence: bool,
    /// Whether PX4 is sent zero velocity outside OFFBOARD, so that its pilot can enter OFFBOARD.
    pub prestream: bool,
    /// What the angles of `OBSTACLE_DISTANCE` count from.
    pub obstacle_frame: ObstacleFrame,
    /// A scan, or points, that nobody took for this long are dropped.
    pub obstacle_age_max_s: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            system_id: 1,
            component_id: 191,
            position_hz: 50.0,
            attitude_hz: 50.0,
            obstacle_hz: 10.0,
            landed_hz: 2.0,
            setpoint_period_ms: 50,
            setpoint_age_max_s: 0.25,
            speed_max_mps: 20.0,
            yaw_rate_max_radps: 4.0,
            heartbeat_timeout_s: 2.5,
            silence_after_s: 5.0,
            fresh_entry_after_silence: true,
            prestream: true,
            obstacle_frame: ObstacleFrame::Auto,
            obstacle_age_max_s: 0.5,
        }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Companion, ConfigError> {
        check("link.system_id", f32::from(self.system_id), 1.0, 254.0)?;
        check("link.component_id", f32::from(self.component_id), 2.0, 255.0)?;
        check("link.position_hz", self.position_hz, 0.0, 200.0)?;
        check("link.attitude_hz", self.attitude_hz, 0.0, 200.0)?;
        check("link.obstacle_hz", self.obstacle_hz, 0.0, 50.0)?;
        check("link.landed_hz", self.landed_hz, 0.0, 50.0)?;
        check("link.setpoint_period_ms", f32::from(self.setpoint_period_ms), 10.0, 100.0)?;
        check("link.setpoint_age_max_s", self.setpoint_age_max_s, 0.05, 1.0)?;
        check("link.speed_max_mps", self.speed_max_mps, 0.1, 30.0)?;
        check("link.yaw_rate_max_radps", self.yaw_rate_max_radps, 0.1, 10.0)?;
        check("link.heartbeat_timeout_s", self.heartbeat_timeout_s, 1.5, 10.0)?;
        check("link.silence_after_s", self.silence_after_s, 1.5, 30.0)?;
        check("link.obstacle_age_max_s", self.obstacle_age_max_s, 0.05, 5.0)?;
        if self.silence_after_s < self.heartbeat_timeout_s {
            let why = Why::Inconsistent("silence must not come before the link is lost (link.heartbeat_timeout_s)");
            return Err(ConfigError { field: "link.silence_after_s", value: self.silence_after_s, why });
        }
        Ok(Companion::from_checked(*self))
    }
}

/// What went wrong, and what went through, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// What the framer saw.
    pub framer: framer::Counters,
    /// Messages with numbers that are not finite, absurd or mean nothing.
    pub rejected: u32,
    /// Published setpoints that were not finite or too fast.
    pub setpoint_faults: u32,
    /// Setpoints that a newer one replaced before they reached the wire.
    pub setpoints_replaced: u32,
    /// Answers and requests for which there was no room.
    pub errands_dropped: u32,
    /// Telemetry for which there was no room.
    pub telemetry_dropped: u32,
    /// Points of obstacles for which there was no room.
    pub points_dropped: u32,
    /// Restarts of the autopilot.
    pub reboots: u32,
    /// Heartbeats of autopilots other than ours.
    pub foreign_heartbeats: u32,
}

#[derive(Clone, Copy, Debug)]
struct Published {
    time: Instant,
    setpoint: Setpoint,
    outcome: Outcome,
}

/// Our end of the link. See the [module](self).
#[derive(Clone, Debug)]
pub struct Companion {
    config: Config,
    framer: Framer,
    outbox: Outbox,
    requests: Requests,
    counters: Counters,
    /// The latest time that was mentioned.
    now: Instant,

    autopilot: Option<Autopilot>,
    entry_needed: bool,
    boot_ms: Option<u32>,
    position: Option<Position>,
    attitude: Option<Attitude>,
    on_ground: Option<bool>,
    scan: Option<Scan>,
    points: Option<Points>,

    published: Option<Published>,
    heartbeat_due: Instant,
    /// Number of the grid period that was polled last.
    setpoint_slot: Option<u64>,
    telemetry_due: Instant,
    telemetry_turn: u8,
    /// Time, SNR in dB and sigma in degrees of the last valid bearing.
    bearing: Option<(Instant, f32, f32)>,
    announced: Option<Outcome>,
    text_due: Instant,
}

impl Companion {
    fn from_checked(config: Config) -> Self {
        let wish = |message_id, rate_hz, must_come| Wish { message_id, rate_hz, must_come };
        Self {
            config,
            framer: Framer::new(),
            outbox: Outbox::new(),
            requests: Requests::new([
                wish(LOCAL_POSITION_NED_DATA::ID, config.position_hz, true),
                wish(ATTITUDE_DATA::ID, config.attitude_hz, true),
                wish(EXTENDED_SYS_STATE_DATA::ID, config.landed_hz, true),
                wish(OBSTACLE_DISTANCE_DATA::ID, config.obstacle_hz, false),
            ]),
            counters: Counters::default(),
            now: Instant::default(),
            autopilot: None,
            entry_needed: false,
            boot_ms: None,
            position: None,
            attitude: None,
            on_ground: None,
            scan: None,
            points: None,
            published: None,
            heartbeat_due: Instant::default(),
            setpoint_slot: None,
            telemetry_due: Instant::default(),
            telemetry_turn: 0,
            bearing: None,
            announced: None,
            text_due: Instant::default(),
        }
    }

    /// Takes in bytes from the autopilot, in pieces of any size.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.follow_clock(now);
        let mut rest = bytes;
        while !rest.is_empty() {
            let taken = self.framer.push(rest);
            rest = &rest[taken..];
            while let Some((header, message)) = self.framer.next_frame().map(|frame| (frame.header, frame.message())) {
                if let Some(message) = message {
                    self.handle(now, header, &message);
                }
            }
        }
    }

    /// Whether the autopilot has given us control.
    #[must_use]
    pub fn control(&self, now: Instant) -> Control {
        match self.autopilot {
            Some(autopilot) if now.seconds_since(autopilot.heard) <= self.config.heartbeat_timeout_s => {
                if autopilot.obeys() && !self.entry_needed { Control::Granted } else { Control::NotInControl }
            }
            _ => Control::LinkLost,
        }
    }

    /// The autopilot that we listen to; `None` before its first heartbeat.
    #[must_use]
    pub const fn autopilot(&self) -> Option<Autopilot> {
        self.autopilot
    }

    /// Our vehicle as last heard; `None` until position and attitude were both heard.
    #[must_use]
    pub fn ownship(&self) -> Option<Ownship> {
        let (position, attitude) = (self.position?, self.attitude?);
        Some(Ownship {
            position_time: position.time,
            position_ned_m: position.position_ned_m,
            velocity_ned_mps: position.velocity_ned_mps,
            attitude_time: attitude.time,
            roll_rad: attitude.roll_rad,
            pitch_rad: attitude.pitch_rad,
            yaw_rad: attitude.yaw_rad,
            yaw_rate_radps: attitude.yaw_rate_radps,
        })
    }

    /// Whether the vehicle stands on the ground; `None` while nobody said.
    #[must_use]
    pub const fn landed(&self) -> Option<bool> {
        self.on_ground
    }

    /// The newest obstacle scan since the last call.
    pub fn take_scan(&mut self) -> Option<Scan> {
        self.scan.take()
    }

    /// The single points, from beams and points alike, since the last call; without a point where sensors looked and saw
    /// nothing.
    pub fn take_points(&mut self) -> Option<Points> {
        self.points.take()
    }

    /// Takes the outcome of a guidance step: its setpoint for the stream, the rest for telemetry.
    pub fn publish(&mut self, now: Instant, output: &guidance::Output) {
        self.follow_clock(now);
        let setpoint = if self.is_sane(&output.setpoint) {
            output.setpoint
        } else {
            count(&mut self.counters.setpoint_faults);
            Setpoint::default()
        };
        self.published = Some(Published { time: now, setpoint, outcome: output.outcome });
        if let Some(bearing) = output.bearing.filter(|bearing| bearing.valid) {
            self.bearing = Some((now, bearing.quality.snr_db, bearing.sigma_rad * DEG_PER_RAD));
        }
        self.report(now, output);
        self.announce(now, output.outcome);
    }

    /// Does what is due: heartbeats, requests, setpoints. To be called at least every 10 ms or so.
    pub fn poll(&mut self, now: Instant) {
        self.follow_clock(now);
        if let Some(scan) = &self.scan
            && now.seconds_since(scan.time) > self.config.obstacle_age_max_s
        {
            self.scan = None;
        }
        if let Some(points) = &self.points
            && now.seconds_since(points.time) > self.config.obstacle_age_max_s
        {
            self.points = None;
        }
        if now >= self.heartbeat_due {
            self.outbox.post_heartbeat(self.heartbeat(now));
            let next = self.heartbeat_due.plus_micros(HEARTBEAT_PERIOD_US);
            self.heartbeat_due = if next > now { next } else { now.plus_micros(HEARTBEAT_PERIOD_US) };
        }
        let Some(autopilot) = self.autopilot else {
            return;
        };
        if self.config.fresh_entry_after_silence && self.is_silent(now, &autopilot) {
            self.entry_needed = true;
        }
        if self.control(now) != Control::LinkLost {
            let outbox = &mut self.outbox;
            self.requests.poll(now, (autopilot.system_id, autopilot.component_id), |command| {
                outbox.post_errand(Errand::Command(command));
            });
        }
        let slot = now.0 / (u64::from(self.config.setpoint_period_ms) * 1_000);
        let due = self.setpoint_slot.replace(slot).is_some_and(|last| last != slot);
        match self.setpoint(now, &autopilot) {
            None => self.outbox.withdraw_setpoint(),
            Some(setpoint) if due => {
                self.outbox.post_setpoint(setpoint_message(now, &autopilot, setpoint));
            }
            Some(_) => {}
        }
    }

    /// Fills `sink` with the bytes that wait to be sent, setpoints first, and says how far.
    pub fn transmit(&mut self, sink: &mut [u8]) -> usize {
        self.outbox.transmit(self.system_id(), self.config.component_id, sink)
    }

    /// What was counted so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        let dropped = self.outbox.dropped();
        Counters {
            framer: self.framer.counters(),
            setpoints_replaced: dropped.setpoints,
            errands_dropped: dropped.errands,
            telemetry_dropped: dropped.notes,
            ..self.counters
        }
    }

    fn system_id(&self) -> u8 {
        self.autopilot.map_or(self.config.system_id, |autopilot| autopilot.system_id)
    }

    /// A clock that runs backwards must not make old things look fresh.
    fn follow_clock(&mut self, now: Instant) {
        if now < self.now {
            self.published = None;
            self.scan = None;
            self.points = None;
            self.bearing = None;
            self.heartbeat_due = now;
            self.telemetry_due = now;
            self.text_due = now;
            self.requests.restart(now);
            if let Some(autopilot) = &mut self.autopilot {
                autopilot.heard = autopilot.heard.min(now);
            }
        }
        self.now = now;
    }
}

/// Listening.
impl Companion {
    fn handle(&mut self, now: Instant, header: Header, message: &MavMessage) {
        if (header.system_id, header.component_id) == (self.system_id(), self.config.component_id) {
            // A router's echo of ourselves.
            return;
        }
        match message {
            MavMessage::HEARTBEAT(heartbeat) => self.on_heartbeat(now, header, heartbeat),
            MavMessage::COMMAND_LONG(command) => self.on_command(header, command),
            MavMessage::TIMESYNC(timesync) => self.on_timesync(now, header, timesync),
            // Any component of our system may see obstacles.
            MavMessage::OBSTACLE_DISTANCE(obstacles) if header.system_id == self.system_id() => {
                if self.is_autopilot(header) {
                    self.requests.heard(OBSTACLE_DISTANCE_DATA::ID);
                }
                self.on_obstacles(now, obstacles);
            }
            MavMessage::OBSTACLE_DISTANCE_3D(point) if header.system_id == self.system_id() => {
                self.on_point(now, obstacles::point(point));
            }
            MavMessage::DISTANCE_SENSOR(beam) if header.system_id == self.system_id() => {
                self.on_point(now, obstacles::beam(beam));
            }
            _ if self.is_autopilot(header) => self.on_telemetry(now, message),
            _ => {}
        }
    }

    fn is_autopilot(&self, header: Header) -> bool {
        self.autopilot.is_some_and(|autopilot| autopilot.sent(header))
    }

    fn on_heartbeat(&mut self, now: Instant, header: Header, heartbeat: &HEARTBEAT_DATA) {
        let Some(autopilot) = Autopilot::from_heartbeat(now, header, heartbeat) else {
            return;
        };
        if self.autopilot.is_some() && !self.is_autopilot(header) {
            count(&mut self.counters.foreign_heartbeats);
            return;
        }
        let was_lost = self.control(now) == Control::LinkLost;
        if !autopilot.obeys() {
            self.entry_needed = false;
        }
        self.autopilot = Some(autopilot);
        if was_lost {
            self.requests.restart(now);
        }
    }

    fn on_telemetry(&mut self, now: Instant, message: &MavMessage) {
        if let Some(time_boot_ms) = time_boot_ms(message) {
            self.follow_boot_clock(now, time_boot_ms);
        }
        let rejected = &mut self.counters.rejected;
        match message {
            MavMessage::LOCAL_POSITION_NED(position) => {
                self.requests.heard(LOCAL_POSITION_NED_DATA::ID);
                keep(&mut self.position, Position::from_message(now, position), rejected);
            }
            MavMessage::ATTITUDE(attitude) => {
                self.requests.heard(ATTITUDE_DATA::ID);
                keep(&mut self.attitude, Attitude::from_angles(now, attitude), rejected);
            }
            MavMessage::ATTITUDE_QUATERNION(attitude) => {
                keep(&mut self.attitude, Attitude::from_quaternion(now, attitude), rejected);
            }
            MavMessage::EXTENDED_SYS_STATE(state) => {
                self.requests.heard(EXTENDED_SYS_STATE_DATA::ID);
                self.on_ground = (state.landed_state != MavLandedState::MAV_LANDED_STATE_UNDEFINED as u8)
                    .then_some(state.landed_state == MavLandedState::MAV_LANDED_STATE_ON_GROUND as u8);
            }
            MavMessage::COMMAND_ACK(ack) => self.on_ack(now, ack),
            _ => {}
        }
    }

    /// The autopilot's clock running backwards means that it restarted: nothing that it said before counts.
    fn follow_boot_clock(&mut self, now: Instant, time_boot_ms: u32) {
        if let Some(last) = self.boot_ms {
            if last.saturating_sub(time_boot_ms) <= BOOT_CLOCK_SLACK_MS {
                self.boot_ms = Some(last.max(time_boot_ms));
                return;
            }
            count(&mut self.counters.reboots);
            self.position = None;
            self.attitude = None;
            self.on_ground = None;
            self.scan = None;
            self.points = None;
            if let Some(autopilot) = &mut self.autopilot {
                autopilot.armed = false;
            }
            self.requests.restart(now);
        }
        self.boot_ms = Some(time_boot_ms);
    }

    fn on_obstacles(&mut self, now: Instant, obstacles: &OBSTACLE_DISTANCE_DATA) {
        let ardupilot = self.autopilot.is_some_and(|autopilot| autopilot.software == Software::ArduPilot);
        let from_nose = match self.config.obstacle_frame {
            ObstacleFrame::Auto if ardupilot => true,
            ObstacleFrame::Body => true,
            ObstacleFrame::Auto | ObstacleFrame::Field => obstacles.frame == MavFrame::MAV_FRAME_BODY_FRD as u8,
        };
        let from_north = obstacles.frame == MavFrame::MAV_FRAME_GLOBAL as u8
            || obstacles.frame == MavFrame::MAV_FRAME_LOCAL_NED as u8;
        let yaw_rad = match self.attitude {
            _ if from_nose => Some(0.0),
            Some(attitude) if from_north && now.seconds_since(attitude.time) <= YAW_AGE_MAX_S => Some(attitude.yaw_rad),
            _ => None,
        };
        let zero_touches = !ardupilot;
        let heard = yaw_rad.and_then(|yaw_rad| obstacles::scan(obstacles, now, Reading { yaw_rad, zero_touches }));
        keep(&mut self.scan, heard, &mut self.counters.rejected);
    }

    fn on_point(&mut self, now: Instant, heard: Heard) {
        let point = match heard {
            Heard::At(point) => Some(point),
            Heard::Free => None,
            Heard::Nothing => return,
            Heard::Absurd => return count(&mut self.counters.rejected),
        };
        // Their time is that of the first, so that none of them seems younger than it is.
        let empty = || Points { time: now, frame: Frame::Body, ..Points::default() };
        let points = &mut self.points.get_or_insert_with(empty).points_m;
        if point.is_some_and(|point| points.push(point).is_err()) {
            count(&mut self.counters.points_dropped);
        }
    }

    fn on_command(&mut self, header: Header, command: &COMMAND_LONG_DATA) {
        if (command.target_system, command.target_component) != (self.system_id(), self.config.component_id) {
            return;
        }
        let denied = [MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, MavCmd::MAV_CMD_DO_SET_MODE]
            .iter()
            .any(|&denied| denied as u16 == command.command);
        let result = if denied { MavResult::MAV_RESULT_DENIED } else { MavResult::MAV_RESULT_UNSUPPORTED };
        self.outbox.post_errand(Errand::Ack(COMMAND_ACK_DATA {
            command: command.command,
            result: result as u8,
            target_system: header.system_id,
            target_component: header.component_id,
            ..COMMAND_ACK_DATA::DEFAULT
        }));
    }

    fn on_ack(&mut self, now: Instant, ack: &COMMAND_ACK_DATA) {
        let ours = (ack.target_system == 0 || ack.target_system == self.system_id())
            && (ack.target_component == 0 || ack.target_component == self.config.component_id);
        if ours
            && ack.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL as u16
            && ack.result != MavResult::MAV_RESULT_IN_PROGRESS as u8
        {
            self.requests.acknowledged(now);
        }
    }

    fn on_timesync(&mut self, now: Instant, header: Header, timesync: &TIMESYNC_DATA) {
        let ours = (timesync.target_system == 0 || timesync.target_system == self.system_id())
            && (timesync.target_component == 0 || timesync.target_component == self.config.component_id);
        if ours && timesync.tc1 == 0 {
            // Never 0, which would be a request.
            let tc1 = i64::try_from(now.0.saturating_mul(1_000)).unwrap_or(i64::MAX).max(1);
            self.outbox.post_errand(Errand::Timesync(TIMESYNC_DATA {
                tc1,
                ts1: timesync.ts1,
                target_system: header.system_id,
                target_component: header.component_id,
            }));
        }
    }
}

/// Speaking.
impl Companion {
    fn is_sane(&self, setpoint: &Setpoint) -> bool {
        let Ned { north, east, down } = setpoint.velocity_ned_mps;
        let speed_squared = north * north + east * east + down * down;
        // False for what is not finite.
        speed_squared <= self.config.speed_max_mps * self.config.speed_max_mps
            && libm::fabsf(setpoint.yaw_rate_radps) <= self.config.yaw_rate_max_radps
    }

    fn is_silent(&self, now: Instant, autopilot: &Autopilot) -> bool {
        now.seconds_since(autopilot.heard) > self.config.silence_after_s
    }

    /// The setpoint to be streamed now, if any.
    fn setpoint(&self, now: Instant, autopilot: &Autopilot) -> Option<Setpoint> {
        if self.is_silent(now, autopilot) {
            return None;
        }
        if !autopilot.obeys() {
            return (autopilot.software == Software::Px4 && self.config.prestream).then(Setpoint::default);
        }
        let mut setpoint = match self.published {
            Some(published)
                if self.control(now) == Control::Granted
                    && now.seconds_since(published.time) <= self.config.setpoint_age_max_s =>
            {
                published.setpoint
            }
            _ => Setpoint::default(),
        };
        if self.on_ground == Some(true) && setpoint.velocity_ned_mps.down < 0.0 {
            setpoint.velocity_ned_mps.down = 0.0;
        }
        Some(setpoint)
    }

    fn heartbeat(&self, now: Instant) -> HEARTBEAT_DATA {
        let state = match (self.control(now), self.published) {
            (Control::LinkLost | Control::NotInControl, _) => MavState::MAV_STATE_STANDBY,
            (Control::Granted, Some(published))
                if now.seconds_since(published.time) <= self.config.setpoint_age_max_s
                    && !is_critical(published.outcome) =>
            {
                MavState::MAV_STATE_ACTIVE
            }
            (Control::Granted, _) => MavState::MAV_STATE_CRITICAL,
        };
        HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER as u8,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID as u8,
            system_status: state as u8,
            ..HEARTBEAT_DATA::DEFAULT
        }
    }

    /// One of the four values, when its turn has come and there is something to tell.
    fn report(&mut self, now: Instant, output: &guidance::Output) {
        if now < self.telemetry_due {
            return;
        }
        self.telemetry_due = now.plus_micros(TELEMETRY_PERIOD_US);
        self.telemetry_turn = (self.telemetry_turn + 1) % 4;
        let fresh = self.bearing.filter(|(time, ..)| now.seconds_since(*time) <= BEARING_AGE_MAX_S);
        let (name, value) = match self.telemetry_turn {
            0 => ("FH_BRG", output.source_bearing_ned_rad.map(compass_deg)),
            1 => ("FH_SNR", fresh.map(|(_, snr_db, _)| snr_db)),
            2 => ("FH_SIG", fresh.map(|(_, _, sigma_deg)| sigma_deg)),
            _ => ("FH_ST", Some(f32::from(output.outcome as u8))),
        };
        if let Some(value) = value.filter(|value| value.is_finite()) {
            let time_boot_ms = boot_ms(now);
            let name = CharArray::from(name);
            self.outbox.post_note(Note::Value(NAMED_VALUE_FLOAT_DATA { time_boot_ms, value, name }));
        }
    }

    /// A text when the outcome changes, at most one a second; a change that did not last is not told.
    fn announce(&mut self, now: Instant, outcome: Outcome) {
        if self.announced == Some(outcome) || now < self.text_due {
            return;
        }
        self.announced = Some(outcome);
        self.text_due = now.plus_micros(TEXT_PERIOD_US);
        let severity = match outcome {
            Outcome::Nominal | Outcome::NotInControl => MavSeverity::MAV_SEVERITY_INFO,
            Outcome::Fault => MavSeverity::MAV_SEVERITY_CRITICAL,
            _ => MavSeverity::MAV_SEVERITY_WARNING,
        };
        self.outbox.post_note(Note::Text(STATUSTEXT_DATA {
            severity: severity as u8,
            text: CharArray::from(text(outcome)),
            ..STATUSTEXT_DATA::DEFAULT
        }));
    }
}

/// The autopilot's clock, in the messages that have it.
fn time_boot_ms(message: &MavMessage) -> Option<u32> {
    match message {
        MavMessage::LOCAL_POSITION_NED(position) => Some(position.time_boot_ms),
        MavMessage::ATTITUDE(attitude) => Some(attitude.time_boot_ms),
        MavMessage::ATTITUDE_QUATERNION(attitude) => Some(attitude.time_boot_ms),
        MavMessage::SYSTEM_TIME(time) => Some(time.time_boot_ms),
        _ => None,
    }
}

/// A message that was refused leaves what is known.
fn keep<T>(known: &mut Option<T>, heard: Option<T>, rejected: &mut u32) {
    if heard.is_some() {
        *known = heard;
    } else {
        count(rejected);
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

/// Milliseconds since boot; wraps after 49 days, as MAVLink's own clocks do.
fn boot_ms(now: Instant) -> u32 {
    (now.0 / 1_000) as u32
}

/// A bearing in degrees from north, 0 to 360.
fn compass_deg(bearing_rad: f32) -> f32 {
    let degrees = bearing_rad * DEG_PER_RAD;
    if degrees < 0.0 { degrees + 360.0 } else { degrees }
}

fn setpoint_message(now: Instant, autopilot: &Autopilot, setpoint: Setpoint) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: boot_ms(now),
        target_system: autopilot.system_id,
        target_component: autopilot.component_id,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        type_mask: TYPE_MASK,
        vx: setpoint.velocity_ned_mps.north,
        vy: setpoint.velocity_ned_mps.east,
        vz: setpoint.velocity_ned_mps.down,
        yaw_rate: setpoint.yaw_rate_radps,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
    }
}

/// Whether we hold because something that we need is missing.
fn is_critical(outcome: Outcome) -> bool {
    matches!(outcome, Outcome::Uncalibrated | Outcome::StaleOwnship | Outcome::StaleObstacles | Outcome::Fault)
}

fn text(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Nominal => "Foxhound: seeking",
        Outcome::NoSignal => "Foxhound: no signal",
        Outcome::Ambiguous => "Foxhound: bearing is ambiguous",
        Outcome::Uncalibrated => "Foxhound: array is not calibrated",
        Outcome::StaleOwnship => "Foxhound: position or attitude is stale",
        Outcome::StaleObstacles => "Foxhound: obstacle data is stale",
        Outcome::NoPath => "Foxhound: no safe path",
        Outcome::GoalUnreachable => "Foxhound: goal cannot be reached",
        Outcome::PlanLate => "Foxhound: plan is late",
        Outcome::GuardBrake => "Foxhound: guard brakes",
        Outcome::LinkLost => "Foxhound: autopilot is silent",
        Outcome::NotInControl => "Foxhound: waits for GUIDED or OFFBOARD, armed",
        Outcome::Fault => "Foxhound: internal fault",
    }
}
