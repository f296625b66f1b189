//! What the companion may say, seen from outside.

use std::collections::VecDeque;
use std::f32::consts::PI;

use foxhound_core::base::ownship::Ownship;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::control::guard::Setpoint;
use foxhound_core::guidance::Output;
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::param::{Id, Values};
use foxhound_link::companion::{
    self, Autopilot, Companion, SETPOINT_PERIOD_MS, SPEED_MAX_MPS, Software, TYPE_MASK, TYPE_MASK_YAW,
    YAW_RATE_MAX_RADPS, Yaw,
};
use foxhound_link::dialect::{MavMessage, SET_POSITION_TARGET_LOCAL_NED_DATA};
use foxhound_link::failsafe::Cause;
use foxhound_link::framer::Framer;
use foxhound_link::signing::{Key, Signing, Verdict};

const LOCAL_NED: u8 = 1;
const BODY_FRD: u8 = 12;
/// `SET_MESSAGE_INTERVAL`: all that is ever asked for.
const ASKED_FOR: u16 = 511;
/// `DO_SET_MODE`, `COMPONENT_ARM_DISARM`: denied.
const NEVER: [u16; 2] = [176, 400];
const DENIED: u8 = 2;
/// How far the commanded yaw runs ahead.
const AHEAD_RAD: f32 = 0.5;

/// What counts of what was heard.
#[derive(Debug, PartialEq)]
pub(super) struct Believed {
    control: Control,
    cause: Cause,
    autopilot: Option<Autopilot>,
    ownship: Option<Ownship>,
    landed: Option<bool>,
    parameters: Values,
    proposal: Option<(Id, Values)>,
    key: Option<Key>,
}

impl Believed {
    pub(super) fn of(companion: &mut Companion, now: Instant) -> Self {
        Self {
            control: companion.control(now),
            cause: companion.cause(now),
            autopilot: companion.autopilot(),
            ownship: companion.ownship(),
            landed: companion.landed(),
            proposal: companion.proposal(),
            parameters: *companion.parameters(),
            key: companion.signing().map(|signing| signing.key().clone()),
        }
    }
}

/// Which setpoints there may be.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stream {
    None,
    Zero,
    /// Zero too, where nothing fresh was published.
    Guidance(Option<Setpoint>),
}

/// What may be said in a setpoint that is made at a poll.
#[derive(Clone, Copy, Debug)]
pub(super) struct Poll {
    time: Instant,
    target: (u8, u8),
    stream: Stream,
    yaw: Yaw,
    /// Whether the autopilot's frame may differ from guidance's.
    jumped: bool,
    /// The vehicle's yaw, if both frames are the same and it is known.
    yaw_rad: Option<f32>,
}

impl Poll {
    /// What the failsafe table allows now.
    pub(super) fn of(
        companion: &Companion,
        config: &companion::Config,
        published: Option<(Instant, Setpoint)>,
        now: Instant,
    ) -> Self {
        let jumped = companion.counters().jumps > 0;
        let yaw_rad = companion.ownship().filter(|_| !jumped).map(|ownship| ownship.yaw_rad);
        let nothing = Self { time: now, target: (0, 0), stream: Stream::None, yaw: config.yaw, jumped, yaw_rad };
        let (cause, control) = (companion.cause(now), companion.control(now));
        assert_eq!(control == Control::Granted, matches!(cause, Cause::None | Cause::OwnshipLost), "{cause:?}");
        let Some(autopilot) = companion.autopilot() else {
            assert!(matches!(cause, Cause::NoAutopilot | Cause::Unfit), "{cause:?}");
            return nothing;
        };
        let silent_s = now.seconds_since(autopilot.heard);
        let obeys = autopilot.in_mode && autopilot.armed && autopilot.software != Software::Other;
        if control == Control::Granted {
            assert!(obeys && silent_s <= config.heartbeat_timeout_s, "{autopilot:?} at {now:?}");
            assert_ne!(companion.landed(), Some(true));
        }
        let prestream = autopilot.software == Software::Px4 && config.prestream;
        let outside = if prestream { Stream::Zero } else { Stream::None };
        let fresh = published.filter(|(time, _)| now.seconds_since(*time) <= config.setpoint_age_max_s);
        let stream = match cause {
            _ if silent_s > config.silence_after_s => Stream::None,
            _ if !obeys => {
                if cause == Cause::Unfit {
                    Stream::None
                } else {
                    outside
                }
            }
            Cause::None => Stream::Guidance(fresh.map(|(_, setpoint)| setpoint)),
            Cause::Unfit | Cause::NoAutopilot | Cause::LinkLost | Cause::OwnshipLost => Stream::None,
            Cause::NotInMode | Cause::OnGround => outside,
            _ => Stream::Zero,
        };
        Self { target: (autopilot.system_id, autopilot.component_id), stream, ..nothing }
    }

    fn allows(&self, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> bool {
        let velocity = [target.vx, target.vy, target.vz];
        let stands = velocity == [0.0; 3] && target.yaw_rate == 0.0;
        let moves = match self.stream {
            Stream::None => return false,
            Stream::Zero | Stream::Guidance(None) => stands,
            Stream::Guidance(Some(setpoint)) => stands || self.moves_as(&setpoint, velocity, target.yaw_rate),
        };
        (target.target_system, target.target_component) == self.target && moves && self.turns(target)
    }

    /// After a jump the autopilot's north is not guidance's: the velocity is a turned one then.
    fn moves_as(&self, setpoint: &Setpoint, [north, east, down]: [f32; 3], yaw_rate_radps: f32) -> bool {
        let wanted = &setpoint.velocity_ned_mps;
        let is_level = if self.jumped {
            let speeds = (north.hypot(east), wanted.north.hypot(wanted.east));
            (speeds.0 - speeds.1).abs() <= 1e-4 * speeds.1 + 1e-6
        } else {
            [north, east] == [wanted.north, wanted.east]
        };
        let turns = yaw_rate_radps == setpoint.yaw_rate_radps || (self.yaw == Yaw::Angle && yaw_rate_radps == 0.0);
        is_level && down == wanted.down && turns
    }

    /// By a rate, or by an angle that is not far ahead of the vehicle's.
    fn turns(&self, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) -> bool {
        if target.type_mask == TYPE_MASK {
            // Without an attitude there is no angle to begin with.
            return target.yaw == 0.0 && (self.yaw == Yaw::Rate || self.yaw_rad.is_none());
        }
        let near = |yaw_rad: f32| wrap_pi(target.yaw - yaw_rad).abs() <= AHEAD_RAD + 1e-4;
        target.type_mask == TYPE_MASK_YAW
            && self.yaw == Yaw::Angle
            && target.yaw_rate == 0.0
            && target.yaw.abs() <= PI + 1e-5
            && self.yaw_rad.is_none_or(near)
    }
}

/// Hears what the companion says.
pub(super) struct Listener {
    framer: Framer,
    /// The companion's key, and what checks its signatures.
    signing: Option<(Key, Signing)>,
    ever_signed: bool,
    /// The system as which the last frame was sent, and whether there was another before.
    system_id: Option<u8>,
    has_moved: bool,
    /// A frame has left in part.
    in_flight: bool,
    /// All bearings so far were angles: what is told of them is only as sane.
    are_angles: bool,
}

impl Listener {
    pub(super) fn new() -> Self {
        Self {
            framer: Framer::new(),
            signing: None,
            ever_signed: false,
            system_id: None,
            has_moved: false,
            in_flight: false,
            are_angles: true,
        }
    }

    /// The companion has begun anew with a key.
    pub(super) fn begins_anew(&mut self) {
        self.signing = None;
    }

    pub(super) fn hears_a_bearing(&mut self, output: &Output) {
        let elevation_rad = output.bearing.filter(|bearing| bearing.valid).map(|bearing| bearing.elevation_rad);
        let is_angle = |angle_rad: f32| angle_rad.abs() <= PI;
        self.are_angles &= elevation_rad.is_none_or(is_angle) && output.source_bearing_ned_rad.is_none_or(is_angle);
    }

    /// Checks all that came, for which there was some room, and says how many setpoints in it move.
    pub(super) fn hear(
        &mut self,
        now: Instant,
        bytes: &[u8],
        room: usize,
        key: Option<Key>,
        polls: &VecDeque<Poll>,
    ) -> u32 {
        let mut moving = 0;
        if self.signing.as_ref().map(|(known, _)| known) != key.as_ref() {
            self.signing = key.map(|key| (key.clone(), Signing::new(key, 0)));
        }
        self.ever_signed |= self.signing.is_some();
        self.framer.each(bytes, |frame| {
            let system_id = frame.header.system_id;
            self.has_moved |= self.system_id.replace(system_id).is_some_and(|last| last != system_id);
            if !self.in_flight {
                let verdict = self.signing.as_mut().map(|(_, signing)| signing.check(now, frame.bytes));
                // Too old is what comes of clocks that run backwards.
                assert!(matches!(verdict, None | Some(Verdict::Valid | Verdict::TooOld)), "{verdict:?}");
                assert_eq!(frame.signed, verdict.is_some());
            }
            match frame.message() {
                Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) => {
                    check_setpoint(polls, (!self.in_flight).then_some(now), &target);
                    moving += u32::from([target.vx, target.vy, target.vz, target.yaw_rate] != [0.0; 4]);
                }
                Some(message) => check_message(&message, self.are_angles),
                None => unreachable!("we send what we do not know: {}", frame.message_id),
            }
            self.in_flight = false;
        });
        // With room to spare the last frame is whole.
        self.in_flight = bytes.len() == room && (!bytes.is_empty() || self.in_flight);
        let counters = self.framer.counters();
        assert_eq!((counters.bad_crc, counters.skipped_bytes, counters.unknown), (0, 0, 0), "what we send is whole");
        // What cannot be signed is not sent; and as another system, behind another autopilot, they go on counting.
        assert!(counters.lost == 0 || self.ever_signed || self.has_moved, "our frames are counted without a gap");
        moving
    }
}

fn check_message(message: &MavMessage, are_angles: bool) {
    match message {
        MavMessage::HEARTBEAT(heartbeat) => assert_eq!((heartbeat.mavtype, heartbeat.autopilot), (18, 8)),
        MavMessage::NAMED_VALUE_FLOAT(value) => assert!(value.value.is_finite(), "{value:?}"),
        MavMessage::DEBUG_VECT(towards) => {
            let is_unit = (towards.x.hypot(towards.y).hypot(towards.z) - 1.0).abs() < 1e-3;
            assert!(is_unit || !are_angles, "{towards:?}");
        }
        MavMessage::LANDING_TARGET(target) => {
            assert!(target.distance > 0.0 && [target.x, target.y, target.z].iter().all(|part| part.is_finite()));
            assert!(target.position_valid == 1 && [LOCAL_NED, BODY_FRD].contains(&target.frame), "{target:?}");
        }
        MavMessage::COMMAND_LONG(command) => assert_eq!(command.command, ASKED_FOR),
        MavMessage::PARAM_REQUEST_READ(read) => assert_eq!(read.param_index, -1, "by name: {read:?}"),
        MavMessage::COMMAND_ACK(ack) => assert!(ack.result == DENIED || !NEVER.contains(&ack.command), "{ack:?}"),
        MavMessage::PARAM_VALUE(value) => assert!(value.param_value.is_finite(), "{value:?}"),
        MavMessage::TIMESYNC(_) | MavMessage::STATUSTEXT(_) | MavMessage::OBSTACLE_DISTANCE(_) => {}
        message => unreachable!("nothing that we say: {message:?}"),
    }
}

/// A setpoint must be one that was allowed at the poll that made it. `now` is the time when it began to leave, if that
/// is known: then the poll must not be farther back than the time from setpoint to setpoint.
fn check_setpoint(polls: &VecDeque<Poll>, now: Option<Instant>, target: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
    assert_eq!(target.coordinate_frame, LOCAL_NED, "{target:?}");
    let ignored = [target.x, target.y, target.z, target.afx, target.afy, target.afz];
    assert!(ignored.iter().all(|number| *number == 0.0), "{target:?}");
    let speed = [target.vx, target.vy, target.vz].map(f64::from).iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!(speed <= f64::from(SPEED_MAX_MPS) * 1.000_1, "{target:?}");
    assert!(target.yaw.is_finite() && target.yaw_rate.abs() <= YAW_RATE_MAX_RADPS, "{target:?}");

    let made_at = |poll: &&Poll| (poll.time.0 / 1_000) as u32 == target.time_boot_ms;
    let recent =
        |poll: &Poll| now.is_none_or(|now| now.micros_since(poll.time) <= 1_000 * u64::from(SETPOINT_PERIOD_MS));
    // Two polls within a millisecond have the same name.
    let allowed = polls.iter().filter(made_at).any(|poll| recent(poll) && poll.allows(target));
    let made: Vec<_> = polls.iter().filter(made_at).collect();
    assert!(allowed, "{target:?} at {now:?}, of {made:?}");
}
