//! How Foxhound behaves on the link: it follows one autopilot, and commands it only where the pilot has given control.
//!
//! In GUIDED or OFFBOARD, armed, the newest published setpoint is sent at 20 Hz, and zero velocity if that setpoint is
//! older than 0.25 s; all other cases are in [`crate::failsafe`]. A setpoint is `SET_POSITION_TARGET_LOCAL_NED` with
//! frame `LOCAL_NED` and type mask 0x05C7 (velocity and yaw rate), the one form that every version of both autopilots
//! understands in the same way, or 0x09C7 (velocity and yaw) where [`Config::yaw`] says so. Foxhound never requests a
//! mode, arming or take-off.
//!
//! The autopilot is the first one whose heartbeat arrives; it stays so until restart, and we join its system. Its
//! position estimate is passed to guidance in a frame that does not jump when the autopilot's does. Sources:
//! ArduPilot's *Copter Commands in Guided Mode*, PX4's *Offboard Mode*, the MAVLink guide on heartbeats, message
//! intervals and time synchronisation.
//!
//! `receive` and `send` are its two halves, `texts` what the pilot reads; `control` decides whether guidance may move
//! the vehicle; `exam` tests the receiver.

mod aging;
mod config;
mod control;
mod exam;
mod parameters;
mod receive;
mod send;
mod texts;

use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::sin_cos;
use foxhound_core::control::guard::Setpoint;
use foxhound_core::guidance;
use foxhound_core::guidance::mission::{Behaviour, Outcome};
use foxhound_core::guidance::param::Values;
use foxhound_core::mapping::scan::{Points, Scan};

use crate::MessageData;
use crate::advice::Advice;
use crate::autopilot::{Attitude, Position};
use crate::beams::Beams;
use crate::clock::{PeerClock, is_over};
use crate::continuity::Continuity;
use crate::dialect::HEARTBEAT_DATA;
use crate::failsafe::Cause;
use crate::framer::{self, Content, Framer};
use crate::health::Health;
use crate::landing;
use crate::outbox::Outbox;
use crate::params::Params;
use crate::requests::Requests;
use crate::signing::{Signing, Unsigned, Verdict};
use crate::sources::Sources;
use crate::turns::Turns;

pub use self::config::{Config, ObstacleFrame, Yaw};
pub use self::exam::{Exam, Examined, Tone};
pub use self::send::NOTICE_BYTES;
#[cfg(test)]
pub(crate) use self::send::OURS;
pub use crate::autopilot::{Autopilot, Software};
pub use crate::params::Storage;
pub use crate::sources::Source;

/// Ignore position, acceleration and yaw; obey velocity and yaw rate.
pub const TYPE_MASK: u16 = 0x05C7;
/// Ignore position, acceleration and yaw rate; obey velocity and yaw.
pub const TYPE_MASK_YAW: u16 = 0x09C7;
/// Time from setpoint to setpoint.
pub const SETPOINT_PERIOD_MS: u16 = 50;
/// A published setpoint faster than this, and than any parameter allows, is a fault and replaced by zero velocity.
pub const SPEED_MAX_MPS: f32 = 21.0;
/// The same of its yaw rate.
pub const YAW_RATE_MAX_RADPS: f32 = 6.4;

const HEARTBEAT_PERIOD_US: u64 = 1_000_000;
const TIMESYNC_PERIOD_US: u32 = 1_000_000;
/// After a jump of the autopilot's estimate guidance gets no ownship for this long, and therefore holds.
const UNSETTLED_US: u64 = 500_000;
/// An older range finder reading is not used for the height.
const GROUND_AGE_MAX_S: f32 = 0.5;

/// How the application keeps time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pace {
    /// The longest step of guidance since the start, microseconds.
    pub longest_us: u32,
    /// Steps that were late since the start.
    pub late: u32,
    /// Antenna frames that did not arrive in time or could not be used, since the start.
    pub lost: u32,
    /// Damaged frames of the lidar since its setup, where there is one.
    pub lidar_bad: Option<u32>,
    /// Lines of the radio that could not be read since its setup, where there is one.
    pub radio_bad: Option<u32>,
}

/// Counts of errors and of traffic since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Counts of the framer.
    pub framer: framer::Counters,
    /// Messages with numbers that are not finite, absurd or undefined.
    pub rejected: u32,
    /// Times that no setpoint was sent for more than 0.2 s.
    pub setpoints_late: u32,
    /// Answers and requests that were dropped because the queue was full.
    pub errands_dropped: u32,
    /// Telemetry that was dropped because the queue was full.
    pub telemetry_dropped: u32,
    /// Restarts of the autopilot.
    pub reboots: u32,
    /// Jumps of the autopilot's position or heading.
    pub jumps: u32,
    /// Heartbeats of autopilots other than ours.
    pub foreign_heartbeats: u32,
    /// Messages that were not signed and should have been.
    pub unsigned: u32,
    /// Messages whose signature was wrong, old or replayed.
    pub forged: u32,
}

#[derive(Clone, Copy, Debug)]
struct Published {
    time: Instant,
    setpoint: Setpoint,
    outcome: Outcome,
    wants_land: bool,
}

/// The share of damaged frames in the last two seconds.
#[derive(Clone, Copy, Debug)]
struct Noise {
    since: Instant,
    good: u32,
    bad: u32,
    percent: u32,
}

/// Our end of the link. See the [module](self).
///
/// ```
/// # use foxhound_core::ConfigError;
/// use foxhound_core::base::time::Instant;
/// use foxhound_link::companion::Config;
/// use foxhound_link::dialect::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};
/// use foxhound_link::failsafe::Cause;
/// use foxhound_link::framer::{FRAME_MAX, Header, encode};
///
/// let mut companion = Config::default().build()?;
/// companion.poll(Instant(0));
/// assert_eq!(companion.cause(Instant(0)), Cause::NoAutopilot);
///
/// let heartbeat = HEARTBEAT_DATA {
///     autopilot: MavAutopilot::MAV_AUTOPILOT_PX4 as u8,
///     mavtype: MavType::MAV_TYPE_QUADROTOR as u8,
///     ..HEARTBEAT_DATA::default()
/// };
/// let mut bytes = [0; FRAME_MAX];
/// let from = Header { system_id: 1, component_id: 1, sequence: 0 };
/// let length = encode(from, &MavMessage::HEARTBEAT(heartbeat), &mut bytes);
/// companion.receive(Instant(0), &bytes[..length]);
/// assert_eq!(companion.cause(Instant(0)), Cause::NotInMode, "the pilot has not given control");
/// # Ok::<(), ConfigError>(())
/// ```
#[derive(Clone, Debug)]
// In this order because it takes the least flash.
#[repr(C)]
pub struct Companion {
    config: Config,
    clock: PeerClock,
    continuity: Continuity,
    health: Health,
    /// Whether a valid signature was ever received.
    signed_heard: bool,
    /// Whether the key has changed since the application last asked.
    key_changed: bool,
    counters: Counters,
    /// The latest time that was passed in.
    now: Instant,

    autopilot: Option<Autopilot>,
    store_damaged: bool,
    entry_needed: bool,
    /// Guidance holds until the mode is entered again, or did so before it was held by us.
    has_ended: bool,
    /// Our program may have started in flight: the vehicle has not been disarmed since.
    has_crashed: bool,
    paused: bool,
    /// Another component of the vehicle asked for the pause; the pilot is told so.
    paused_aboard: bool,
    failed: bool,
    boot_ms: Option<u32>,
    /// The autopilot has restarted, and the application has not been informed yet.
    world_is_lost: bool,
    /// As the autopilot reports it.
    position: Option<Position>,
    /// Sum of its jumps in the last second.
    jumped_m: f32,
    attitude: Option<Attitude>,
    origin: Option<[i32; 2]>,
    reset_counter: Option<u8>,
    /// Guidance gets no ownship until then.
    settled_at: Instant,
    /// When the last usable ownship arrived.
    usable_at: Option<Instant>,
    landed_state: u8,
    /// Distance to the ground along the vehicle's own axis, and when it was received.
    ground: Option<(Instant, f32)>,
    noise: Noise,
    advice: Advice,
    sources: Sources,
    /// Of `ArduPilot`, and of another component.
    proximity: Beams,
    beams: Beams,
    /// The component whose scan was accepted last.
    last_scan_of: u8,

    published: Option<Published>,
    /// Asks the autopilot to land.
    landing: landing::Request,
    /// Since when guidance has published setpoints that are not sane.
    insane_since: Option<Instant>,
    /// Whether guidance was flying at the last check.
    seeking: bool,
    /// Whether setpoints are not being sent.
    was_late: bool,
    yaw_rad: Option<f32>,
    heartbeat_due: Instant,
    timesync_due: Instant,
    /// Number of the period of the setpoint grid that was polled last.
    setpoint_slot: Option<u64>,
    telemetry: send::Telemetry,
    pace: Option<Pace>,
    exam: Option<exam::Wanted>,
    // The large ones last: the first fields are cheaper to access.
    framer: Framer,
    outbox: Outbox,
    requests: Requests,
    params: Params,
    signing: Option<Signing>,
    turns: Turns,
    points: Option<Points>,
}

impl Companion {
    #[inline(never)]
    fn from_checked(config: &Config, values: Values) -> Self {
        let mut framer = Framer::new();
        framer.accept_v1(config.accept_v1);
        Self {
            config: *config,
            framer,
            outbox: Outbox::new(),
            requests: Requests::new(),
            clock: PeerClock::new(),
            continuity: Continuity::new(),
            health: Health::new(),
            params: Params::new(values),
            signing: None,
            signed_heard: false,
            key_changed: false,
            counters: Counters::default(),
            now: Instant::default(),
            autopilot: None,
            store_damaged: false,
            entry_needed: false,
            has_ended: false,
            has_crashed: false,
            paused: false,
            paused_aboard: false,
            failed: false,
            boot_ms: None,
            world_is_lost: false,
            position: None,
            jumped_m: 0.0,
            attitude: None,
            origin: None,
            reset_counter: None,
            settled_at: Instant::default(),
            usable_at: None,
            landed_state: 0,
            ground: None,
            noise: Noise { since: Instant(0), good: 0, bad: 0, percent: 0 },
            advice: Advice::new(),
            sources: Sources::new(),
            proximity: Beams::new(),
            beams: Beams::new(),
            turns: Turns::new(),
            last_scan_of: 0,
            points: None,
            published: None,
            landing: landing::Request::new(),
            insane_since: None,
            seeking: false,
            was_late: false,
            yaw_rad: None,
            heartbeat_due: Instant::default(),
            timesync_due: Instant::default(),
            setpoint_slot: None,
            telemetry: send::Telemetry::new(),
            pace: None,
            exam: None,
        }
    }

    /// Takes in bytes from the autopilot, in pieces of any size.
    #[inline(never)]
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.follow_clock(now);
        let mut rest = bytes;
        while !rest.is_empty() {
            let taken = self.framer.push(rest);
            rest = rest.get(taken..).unwrap_or_default();
            while let Some(frame) = self.framer.next_frame() {
                let header = frame.header;
                // Other messages are not used, so their signatures are not checked either.
                let Some(content) = Content::of(&frame) else { continue };
                let verdict = self.signing.as_mut().map(|signing| signing.check(now, frame.bytes));
                if self.believes(verdict, content.message_id()) {
                    self.handle(header, &content);
                }
            }
        }
    }

    /// Whether a message is accepted by its signature. An unsigned heartbeat only says that somebody is there, and
    /// gives no control by itself.
    #[inline(never)]
    fn believes(&mut self, verdict: Option<Verdict>, message_id: u32) -> bool {
        let policy = self.config.unsigned;
        match verdict {
            None => true,
            Some(Verdict::Valid) => {
                self.signed_heard = true;
                true
            }
            Some(Verdict::Unsigned) => {
                let is_open = policy == Unsigned::Always || message_id != HEARTBEAT_DATA::ID;
                let believed = is_open && policy.takes(message_id, self.signed_heard);
                if !believed {
                    if self.counters.unsigned == 0 {
                        self.telemetry.warn("ignores unsigned messages");
                    }
                    count(&mut self.counters.unsigned);
                }
                believed
            }
            Some(_) => {
                if self.counters.forged == 0 {
                    self.telemetry.warn("ignores wrong signatures");
                }
                count(&mut self.counters.forged);
                false
            }
        }
    }

    /// The autopilot that we follow; `None` before its first heartbeat.
    #[must_use]
    pub const fn autopilot(&self) -> Option<Autopilot> {
        self.autopilot
    }

    /// Our vehicle as last received, in a frame that does not jump; `None` until both position and attitude have
    /// arrived, while the autopilot's estimator reports that they are invalid, and for half a second after a jump.
    #[must_use]
    #[inline(never)]
    pub fn ownship(&self) -> Option<Ownship> {
        if self.now < self.settled_at || self.health.is_estimator_bad() {
            return None;
        }
        self.ownship_as_told()
    }

    #[inline(never)]
    fn ownship_as_told(&self) -> Option<Ownship> {
        let (position, attitude) = (self.position?, self.attitude?);
        Some(Ownship {
            position_time: position.time,
            position_ned_m: self.continuity.place_to_ours(position.position_ned_m),
            velocity_ned_mps: self.continuity.velocity_to_ours(position.velocity_ned_mps),
            attitude_time: attitude.time,
            roll_rad: attitude.roll_rad,
            pitch_rad: attitude.pitch_rad,
            yaw_rad: self.continuity.heading_to_ours(attitude.yaw_rad),
            yaw_rate_radps: attitude.yaw_rate_radps,
        })
    }

    /// Whether the vehicle is on the ground; `None` until that has been reported.
    #[must_use]
    #[inline(never)]
    pub fn landed(&self) -> Option<bool> {
        receive::landed(self.landed_state)
    }

    /// Height of the vehicle over the ground by its range finder, corrected for tilt; `None` without a current reading.
    #[must_use]
    #[inline(never)]
    pub fn height_m(&self, now: Instant) -> Option<f32> {
        let (at, slant_m) = self.ground.filter(|(at, _)| !is_over(now, *at, GROUND_AGE_MAX_S))?;
        let (attitude, ground) = (self.attitude?, at);
        let level = sin_cos(attitude.roll_rad).1 * sin_cos(attitude.pitch_rad).1;
        (!is_over(ground, attitude.time, GROUND_AGE_MAX_S)).then_some(slant_m * level)
    }

    /// The newest obstacle scan, until [`Self::drop_obstacles`].
    #[must_use]
    pub fn scan(&self) -> Option<&Scan> {
        self.turns.scan()
    }

    /// The single points, from `OBSTACLE_DISTANCE_3D` and single beams, until [`Self::drop_obstacles`]; empty where
    /// sensors measured and found nothing.
    #[must_use]
    pub const fn points(&self) -> Option<&Points> {
        self.points.as_ref()
    }

    /// Forgets scan and points after they have been used by reference: a copy of them takes 1.2 KB.
    #[inline(never)]
    pub fn drop_obstacles(&mut self) {
        self.last_scan_of = self.turns.component_id();
        self.turns.take();
        self.points = None;
    }

    /// Who reports obstacles, and how long ago each did.
    pub fn obstacle_sources(&self, now: Instant) -> impl Iterator<Item = (Source, f32)> {
        self.sources.ages(now)
    }

    /// Signs what is sent from now on, and checks the signatures of what is received; with `None`, neither.
    #[inline(never)]
    pub fn sign_with(&mut self, signing: Option<Signing>) {
        self.signing = signing;
        self.signed_heard = false;
    }

    /// The key, the clock and the timestamps of signing, for the code that stores the key and sets the clock.
    pub const fn signing(&mut self) -> Option<&mut Signing> {
        self.signing.as_mut()
    }

    /// Whether the key was set, changed or taken away over the link since the last call, and has to be stored.
    #[inline(never)]
    pub fn take_key_change(&mut self) -> bool {
        core::mem::take(&mut self.key_changed)
    }

    /// Whether the autopilot has restarted since the last call, or told no position for seconds: guidance must begin anew, as its frame
    /// may.
    pub fn take_world_lost(&mut self) -> bool {
        core::mem::take(&mut self.world_is_lost)
    }

    /// We have been restarted in flight: control is given only when the mode is left and entered again.
    pub fn require_entry(&mut self) {
        self.entry_needed = true;
    }

    /// We may have been restarted in flight, as [`Self::require_entry`]; and PX4, which enters OFFBOARD by itself as soon as setpoints come,
    /// gets none outside of it until the vehicle is disarmed or a station requests to continue.
    pub fn note_crash(&mut self) {
        self.entry_needed = true;
        self.has_crashed = true;
    }

    /// Whether the newest stored record is damaged: then the vehicle is not moved.
    pub const fn note_store(&mut self, is_damaged: bool) {
        self.store_damaged = is_damaged;
    }

    /// The application is unfit to fly: no setpoints and no heartbeats from now on, until a restart.
    pub fn fail(&mut self) {
        self.failed = true;
    }

    /// Takes the outcome of a guidance step: its setpoint for the stream, the rest for telemetry.
    #[inline(never)]
    pub fn publish(&mut self, now: Instant, output: &guidance::Output) {
        self.follow_clock(now);
        let setpoint = if self.is_sane(&output.setpoint) {
            self.insane_since = None;
            output.setpoint
        } else {
            self.insane_since.get_or_insert(now);
            Setpoint::default()
        };
        // It is reported that it has landed until the next take-off, to which the pilot's arming is a fresh entry.
        if output.is_final() && (output.outcome != Outcome::Landed || self.cause(now) == Cause::None) {
            self.has_ended = true;
        } else if output.outcome.behaviour() == Behaviour::Follow {
            self.has_ended = false;
        }
        let wants_land = output.landing.is_some_and(|landing| landing.wants_land);
        self.published = Some(Published { time: now, setpoint, outcome: output.outcome, wants_land });
        self.report(output);
    }

    /// Whether the obstacle map is to be sent now.
    #[must_use]
    #[inline(never)]
    pub fn wants_surroundings(&self, now: Instant) -> bool {
        self.config.surroundings && self.telemetry.wants_surroundings(now)
    }

    /// Takes the obstacle map, to be sent as `OBSTACLE_DISTANCE`.
    pub fn publish_surroundings(&mut self, now: Instant, mut circles: impl Iterator<Item = Circle>) {
        if let Some(ownship) = self.ownship() {
            self.report_surroundings(now, &ownship, &mut circles);
        }
    }

    /// Does what is due: heartbeats, requests, setpoints. Call it at least every 10 ms.
    #[inline(never)]
    pub fn poll(&mut self, now: Instant) {
        self.follow_clock(now);
        self.age();
        let cause = self.cause(now);
        if now >= self.heartbeat_due {
            let next = self.heartbeat_due.plus_micros(HEARTBEAT_PERIOD_US);
            self.heartbeat_due = if next > now { next } else { now.plus_micros(HEARTBEAT_PERIOD_US) };
            // A heartbeat says that we are fit.
            if cause != Cause::Unfit {
                let heartbeat = self.heartbeat(cause);
                self.outbox.post_heartbeat(&heartbeat);
            }
        }
        self.announce(cause);
        self.tell_parameters();
        let Some(autopilot) = self.autopilot else {
            return;
        };
        let is_held = cause != Cause::None;
        if autopilot.may_obey() && (matches!(cause, Cause::Unfit | Cause::LinkLost) || (is_held && self.has_ended)) {
            self.entry_needed = true;
        }
        match cause {
            // What is missing for a moment ends no search.
            Cause::LinkQuiet | Cause::LinkNoisy | Cause::OwnshipLost => {}
            Cause::None => {
                let follows = |published: &Published| published.outcome.behaviour() == Behaviour::Follow;
                self.seeking |= self.published.as_ref().is_some_and(follows);
            }
            _ => self.seeking = false,
        }
        if !matches!(cause, Cause::LinkLost | Cause::LinkQuiet) {
            self.ask(&autopilot);
        }
        self.stream(&autopilot, cause);
    }

    /// Fills `sink` with the bytes that wait to be sent, setpoints first, and returns how many.
    #[inline(never)]
    pub fn transmit(&mut self, sink: &mut [u8]) -> usize {
        let address = (self.system_id(), self.config.component_id);
        let (signing, now) = (&mut self.signing, self.now);
        self.outbox.transmit(address, sink, |frame, length| match signing {
            Some(signing) => signing.sign(now, frame, length),
            None => length,
        })
    }

    /// The counts so far.
    #[must_use]
    #[inline(never)]
    pub const fn counters(&self) -> Counters {
        let dropped = self.outbox.dropped();
        Counters {
            framer: self.framer.counters(),
            errands_dropped: dropped.errands,
            telemetry_dropped: dropped.notes,
            ..self.counters
        }
    }

    #[inline(never)]
    fn system_id(&self) -> u8 {
        self.autopilot.map_or(self.config.system_id, |autopilot| autopilot.system_id)
    }
}

#[inline(never)]
fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
