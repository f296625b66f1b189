//! How Foxhound behaves on the link: it listens to one autopilot, and commands it only where its pilot says so.
//!
//! In GUIDED or OFFBOARD and armed the newest published setpoint leaves at 20 Hz, and zero velocity if that is older than
//! 0.25 s; everything else is a row of the table in [`crate::failsafe`]. A setpoint is `SET_POSITION_TARGET_LOCAL_NED` with
//! frame `LOCAL_NED` and type mask 0x05C7 (velocity and yaw rate), the one form that every version of both autopilots takes
//! the same way, or 0x09C7 (velocity and yaw) where [`Config::yaw`] says so. The mode is never asked for, nor arming, nor
//! take-off.
//!
//! The autopilot is the first one that is heard; it stays so until restart, and we join its system. What it says of the
//! vehicle's place is told to guidance in a frame that does not jump when the autopilot's does. Sources: ArduPilot's *Copter
//! Commands in Guided Mode*, PX4's *Offboard Mode*, the MAVLink guide on heartbeats, message intervals and time
//! synchronisation.
//!
//! `hear` and `speak` are the two halves of it; `control` says whether guidance may move the vehicle; `exam` is about
//! examining the receiver.

mod aging;
mod config;
mod control;
mod exam;
mod hear;
mod parameters;
mod speak;

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
pub use self::speak::NOTICE_BYTES;
pub use crate::autopilot::{Autopilot, Software};
pub use crate::params::Storage;
pub use crate::sources::Source;

/// Ignore position, acceleration and yaw; obey velocity and yaw rate.
pub const TYPE_MASK: u16 = 0x05C7;
/// Ignore position, acceleration and yaw rate; obey velocity and yaw.
pub const TYPE_MASK_YAW: u16 = 0x09C7;

const HEARTBEAT_PERIOD_US: u64 = 1_000_000;
const TIMESYNC_PERIOD_US: u32 = 1_000_000;
/// After a jump of the autopilot's estimate guidance gets no ownship for this long, and so holds.
const UNSETTLED_US: u64 = 500_000;
/// A range finder's word that is older says nothing of the height.
const GROUND_AGE_MAX_S: f32 = 0.5;

/// How the application keeps time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pace {
    /// The longest step of guidance since the start, microseconds.
    pub longest_us: u32,
    /// Steps that were late since the start.
    pub late: u32,
    /// Frames of the antennas that did not come when they should or were no use, since the start.
    pub lost: u32,
    /// Frames of the lidar that were damaged, since its setup, where there is one.
    pub lidar_bad: Option<u32>,
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
    /// Times that no setpoint got onto the wire for more than 0.2 s.
    pub setpoints_late: u32,
    /// Answers and requests for which there was no room.
    pub errands_dropped: u32,
    /// Telemetry for which there was no room.
    pub telemetry_dropped: u32,
    /// Points of obstacles for which there was no room.
    pub points_dropped: u32,
    /// Restarts of the autopilot.
    pub reboots: u32,
    /// Jumps of the autopilot's place or heading.
    pub jumps: u32,
    /// Heartbeats of autopilots other than ours.
    pub foreign_heartbeats: u32,
    /// Messages that were not signed and should have been.
    pub unsigned: u32,
    /// Messages whose signature was wrong, old or played back.
    pub forged: u32,
}

#[derive(Clone, Copy, Debug)]
struct Published {
    time: Instant,
    setpoint: Setpoint,
    outcome: Outcome,
    wants_land: bool,
}

/// How many frames of the last while were damaged.
#[derive(Clone, Copy, Debug)]
struct Noise {
    since: Instant,
    good: u32,
    bad: u32,
    percent: u32,
}

/// Our end of the link. See the [module](self).
#[derive(Clone, Debug)]
// In this order, for the sake of the flash.
#[repr(C)]
pub struct Companion {
    config: Config,
    clock: PeerClock,
    continuity: Continuity,
    health: Health,
    /// Whether a right signature was ever seen.
    signed_heard: bool,
    /// Whether the key is another one since the application last asked.
    key_changed: bool,
    counters: Counters,
    /// The latest time that was mentioned.
    now: Instant,

    autopilot: Option<Autopilot>,
    store_damaged: bool,
    entry_needed: bool,
    paused: bool,
    /// Another component of the vehicle asked for it, which tells the pilot why.
    paused_aboard: bool,
    failed: bool,
    boot_ms: Option<u32>,
    /// The autopilot has restarted, and the application does not know yet.
    world_is_lost: bool,
    /// As the autopilot says it.
    position: Option<Position>,
    /// What its jumps of the last second add up to.
    jumped_m: f32,
    attitude: Option<Attitude>,
    origin: Option<[i32; 3]>,
    reset_counter: Option<u8>,
    /// Guidance gets no ownship until then.
    settled_at: Instant,
    /// When there was a usable one last.
    usable_at: Option<Instant>,
    landed_state: u8,
    /// How far the ground is, along the vehicle's own axis, and when it was heard.
    ground: Option<(Instant, f32)>,
    noise: Noise,
    advice: Advice,
    sources: Sources,
    beams: Beams,
    /// The component whose scan was taken last.
    last_scan_of: u8,

    published: Option<Published>,
    /// Asks the autopilot to land.
    landing: landing::Request,
    /// Since when what guidance publishes is not sane.
    insane_since: Option<Instant>,
    /// Whether guidance was flying when last looked at.
    seeking: bool,
    /// Whether setpoints do not get onto the wire.
    was_late: bool,
    yaw_rad: Option<f32>,
    heartbeat_due: Instant,
    timesync_due: Instant,
    /// Number of the grid period that was polled last.
    setpoint_slot: Option<u64>,
    telemetry: speak::Telemetry,
    pace: Option<Pace>,
    exam: Option<exam::Wanted>,
    // The large ones last: what is near is cheaper to reach.
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
            telemetry: speak::Telemetry::new(),
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
                // Nothing is done about the others, so their signatures are not looked at either.
                let Some(content) = Content::of(&frame) else { continue };
                let verdict = self.signing.as_mut().map(|signing| signing.check(now, frame.bytes));
                if self.believes(verdict, content.message_id()) {
                    self.handle(header, &content);
                }
            }
        }
    }

    /// Whether a message is believed for its signature. An unsigned heartbeat only says that somebody is there, and by
    /// itself gives no control.
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
                        self.telemetry.warn("Foxhound: ignores unsigned messages");
                    }
                    count(&mut self.counters.unsigned);
                }
                believed
            }
            Some(_) => {
                if self.counters.forged == 0 {
                    self.telemetry.warn("Foxhound: ignores wrong signatures");
                }
                count(&mut self.counters.forged);
                false
            }
        }
    }

    /// The autopilot that we listen to; `None` before its first heartbeat.
    #[must_use]
    pub const fn autopilot(&self) -> Option<Autopilot> {
        self.autopilot
    }

    /// Our vehicle as last heard, in a frame that does not jump; `None` until position and attitude were both heard, while
    /// the autopilot's estimator says that it does not know them, and for half a second after a jump.
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

    /// Whether the vehicle stands on the ground; `None` while nobody said.
    #[must_use]
    #[inline(never)]
    pub fn landed(&self) -> Option<bool> {
        hear::landed(self.landed_state)
    }

    /// How high the vehicle is over the ground by its range finder, if it has one and that reads; its tilt is taken off.
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

    /// The single points, from beams and points alike, until [`Self::drop_obstacles`]; empty where sensors measured and found
    /// nothing.
    #[must_use]
    pub const fn points(&self) -> Option<&Points> {
        self.points.as_ref()
    }

    /// Forgets scan and points, which have been used by reference: a copy of them takes 1.2 KB.
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

    /// Signs what is sent from now on, and looks at the signatures of what is heard; or neither.
    #[inline(never)]
    pub fn sign_with(&mut self, signing: Option<Signing>) {
        self.signing = signing;
        self.signed_heard = false;
    }

    /// The key, the clock and the timestamps of signing, for whoever stores the first and knows the second.
    pub const fn signing(&mut self) -> Option<&mut Signing> {
        self.signing.as_mut()
    }

    /// Whether the key was set, changed or taken away over the link since the last call, and has to be stored.
    #[inline(never)]
    pub fn take_key_change(&mut self) -> bool {
        core::mem::take(&mut self.key_changed)
    }

    /// Whether the autopilot has restarted since the last call: guidance must begin anew, as its frame does.
    pub fn take_world_lost(&mut self) -> bool {
        core::mem::take(&mut self.world_is_lost)
    }

    /// We have been restarted in flight: the mode gives control only when it is entered afresh.
    pub fn require_entry(&mut self) {
        self.entry_needed = true;
    }

    /// Whether the newest record of something that the application had stored is damaged: then the vehicle is not moved.
    pub const fn note_store(&mut self, is_damaged: bool) {
        self.store_damaged = is_damaged;
    }

    /// The application has found itself unfit to fly: no setpoints and no heartbeats from now on, until a restart.
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
            count(&mut self.counters.setpoint_faults);
            self.insane_since.get_or_insert(now);
            Setpoint::default()
        };
        let wants_land = output.landing.is_some_and(|landing| landing.wants_land);
        self.published = Some(Published { time: now, setpoint, outcome: output.outcome, wants_land });
        self.report(output);
    }

    /// Whether what is remembered of the obstacles is wanted now.
    #[must_use]
    #[inline(never)]
    pub fn wants_surroundings(&self, now: Instant) -> bool {
        self.config.surroundings && self.telemetry.wants_surroundings(now)
    }

    /// Takes what is remembered of the obstacles, for whoever wants to see it.
    pub fn publish_surroundings(&mut self, now: Instant, mut circles: impl Iterator<Item = Circle>) {
        if let Some(ownship) = self.ownship() {
            self.report_surroundings(now, &ownship, &mut circles);
        }
    }

    /// Does what is due: heartbeats, requests, setpoints. To be called at least every 10 ms or so.
    #[inline(never)]
    pub fn poll(&mut self, now: Instant) {
        self.follow_clock(now);
        self.age();
        let cause = self.cause(now);
        if now >= self.heartbeat_due {
            let next = self.heartbeat_due.plus_micros(HEARTBEAT_PERIOD_US);
            self.heartbeat_due = if next > now { next } else { now.plus_micros(HEARTBEAT_PERIOD_US) };
            // A heartbeat says that we are well.
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
        let needs_entry = matches!(cause, Cause::Unfit | Cause::LinkLost) && self.config.fresh_entry_after_silence;
        if needs_entry && autopilot.obeys() {
            self.entry_needed = true;
        }
        if cause != Cause::None {
            self.seeking = false;
        } else if self.published.is_some_and(|published| published.outcome.behaviour() == Behaviour::Follow) {
            self.seeking = true;
        }
        if !matches!(cause, Cause::LinkLost | Cause::LinkQuiet) {
            self.ask(&autopilot);
        }
        self.stream(&autopilot, cause);
    }

    /// Fills `sink` with the bytes that wait to be sent, setpoints first, and says how far.
    #[inline(never)]
    pub fn transmit(&mut self, sink: &mut [u8]) -> usize {
        let address = (self.system_id(), self.config.component_id);
        let (signing, now) = (&mut self.signing, self.now);
        self.outbox.transmit(address, sink, |frame, length| match signing {
            Some(signing) => signing.sign(now, frame, length),
            None => length,
        })
    }

    /// What was counted so far.
    #[must_use]
    #[inline(never)]
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

    #[inline(never)]
    fn system_id(&self) -> u8 {
        self.autopilot.map_or(self.config.system_id, |autopilot| autopilot.system_id)
    }
}

#[inline(never)]
fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}
