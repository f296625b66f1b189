//! Anything through the link.

use std::collections::VecDeque;
use std::f32::consts::PI;
use std::sync::OnceLock;

use foxhound_core::guard::Setpoint;
use foxhound_core::guidance::{self, FrontEnd, Input, Output};
use foxhound_core::mission::Control;
use foxhound_core::scan::Sector;
use foxhound_core::time::Instant;
use foxhound_link::Message as _;
use foxhound_link::companion::{self, Companion, ObstacleFrame, Software, TYPE_MASK};
use foxhound_link::dialect::{MavMessage, SET_POSITION_TARGET_LOCAL_NED_DATA};
use foxhound_link::framer::{FRAME_MAX, Framer};

use super::{Draw, Reached};

const LOCAL_NED: u8 = 1;
/// Polls that a setpoint may come from. Between two frames that fit nowhere there are never so many.
const POLLS: usize = 64;

/// Any bytes, broken and whole frames, in any pieces and at any time, and any outputs in between.
pub fn link(case: &[u8]) -> Reached {
    let draw = &mut Draw { rest: case };
    let config = config(draw);
    let Ok(companion) = config.build() else { return Reached::default() };
    let mut flight = Flight {
        config,
        companion,
        twin: Framer::new(),
        sent: Framer::new(),
        published: None,
        polls: VecDeque::with_capacity(POLLS),
        in_flight: false,
        reached: Reached { configured: true, ..Reached::default() },
    };
    let mut now = Instant(0);
    // How many whole frames there were, while there was nothing else.
    let mut whole = Some(0);
    let (mut pushed, mut framed) = (0, 0);
    let mut buffer = [0; FRAME_MAX];
    while !draw.rest.is_empty() {
        now = if draw.below(8) == 0 { draw.instant(now) } else { now.plus_micros(1_000 * u64::from(draw.below(64))) };
        let kind = draw.below(8);
        let length = match kind {
            0 => {
                whole = None;
                let length = usize::from(draw.byte());
                buffer[..length].fill_with(|| draw.byte());
                length
            }
            1 => heartbeat(draw, &mut buffer),
            2 if draw.flag() => landed(draw, &mut buffer),
            2..5 => any_frame(draw, &mut buffer),
            5 | 6 => {
                flight.publish(now, draw);
                0
            }
            _ => 0,
        };
        let bytes = &mut buffer[..length];
        if length > 0 {
            whole = whole.map(|count| count + u32::from(kind > 0));
            if draw.below(16) == 0 {
                whole = None;
                bytes[usize::from(draw.byte()) % length] ^= draw.byte();
            }
            framed += flight.receive(now, bytes, 1 + usize::from(draw.byte()));
            pushed += length;
        }
        flight.poll(now);
        let room = if draw.flag() { 300 } else { usize::from(draw.byte()) };
        flight.transmit(now, room);
    }
    flight.drain(now);
    let counters = flight.twin.counters();
    assert!(framed + counters.skipped_bytes as usize <= pushed);
    assert_eq!(counters, flight.companion.counters().framer, "pieces make no difference");
    if let Some(count) = whole {
        assert_eq!((counters.frames, counters.skipped_bytes, counters.bad_crc), (count, 0, 0));
    }
    flight.reached
}

fn config(draw: &mut Draw<'_>) -> companion::Config {
    companion::Config {
        system_id: if draw.below(8) == 0 { draw.byte() } else { 1 },
        position_hz: draw.field(50.0, 0.0, 250.0),
        setpoint_period_ms: if draw.below(8) == 0 { u16::from(draw.byte()) } else { 50 },
        setpoint_age_max_s: draw.field(0.25, 0.0, 1.0),
        speed_max_mps: draw.field(20.0, 0.0, 30.0),
        heartbeat_timeout_s: draw.field(2.5, 1.0, 10.0),
        silence_after_s: draw.field(5.0, 1.0, 30.0),
        fresh_entry_after_silence: draw.flag(),
        prestream: draw.flag(),
        obstacle_frame: [ObstacleFrame::Auto, ObstacleFrame::Field, ObstacleFrame::Body][usize::from(draw.below(3))],
        obstacle_age_max_s: draw.field(0.5, 0.0, 5.0),
        ..companion::Config::default()
    }
}

/// What may be said in a setpoint that is made at a poll.
#[derive(Clone, Copy)]
struct Poll {
    time: Instant,
    /// Whether there may be one at all, and to whom.
    target: Option<(u8, u8)>,
    /// The motion that it may hold.
    motion: Option<Setpoint>,
    landed: bool,
}

/// A companion and what is known of it from outside.
struct Flight {
    config: companion::Config,
    companion: Companion,
    /// Hears the same as the companion, in one piece.
    twin: Framer,
    /// Hears what the companion says.
    sent: Framer,
    published: Option<(Instant, Setpoint)>,
    polls: VecDeque<Poll>,
    /// A frame has left in part.
    in_flight: bool,
    reached: Reached,
}

impl Flight {
    fn publish(&mut self, now: Instant, draw: &mut Draw<'_>) {
        let output = output(draw);
        self.companion.publish(now, &output);
        self.published = Some((now, output.setpoint));
    }

    /// Returns how many bytes were those of frames.
    fn receive(&mut self, now: Instant, bytes: &[u8], piece: usize) -> usize {
        for piece in bytes.chunks(piece) {
            self.companion.receive(now, piece);
        }
        let (mut rest, mut framed) = (bytes, 0);
        while !rest.is_empty() {
            let taken = self.twin.push(rest);
            assert!(taken > 0, "a framer that takes nothing stops the stream");
            rest = &rest[taken..];
            while let Some(frame) = self.twin.next_frame() {
                let extra = if frame.signed { 13 } else { 0 };
                assert_eq!(frame.bytes.len(), 12 + frame.payload.len() + extra);
                framed += frame.bytes.len();
                self.reached.answers += 1;
            }
        }
        framed
    }

    fn poll(&mut self, now: Instant) {
        self.companion.poll(now);
        if let Some(ownship) = self.companion.ownship() {
            assert!(ownship.is_finite(), "{ownship:?}");
        }
        if let Some(scan) = self.companion.take_scan() {
            assert!(scan.first_azimuth_rad.is_finite() && scan.step_rad.is_finite() && scan.step_rad != 0.0);
            let sane =
                |sector: &Sector| !matches!(sector, Sector::Hit(metres) if !(metres.is_finite() && *metres >= 0.0));
            assert!(scan.sectors.iter().all(sane), "{scan:?}");
        }
        if let Some(points) = self.companion.take_points() {
            assert!(points.points_m.iter().all(|point| point.is_finite()), "{points:?}");
        }
        if self.polls.len() == POLLS {
            self.polls.pop_front();
        }
        let poll = self.allowed(now);
        self.polls.push_back(poll);
    }

    /// What the rules of the companion allow now.
    fn allowed(&self, now: Instant) -> Poll {
        let landed = self.companion.landed() == Some(true);
        let nothing = Poll { time: now, target: None, motion: None, landed };
        let Some(autopilot) = self.companion.autopilot() else { return nothing };
        let silent_s = now.seconds_since(autopilot.heard);
        let obeys = autopilot.in_mode && autopilot.armed;
        let prestream = autopilot.software == Software::Px4 && self.config.prestream;
        let control = self.companion.control(now);
        assert!(control != Control::Granted || (obeys && silent_s <= self.config.heartbeat_timeout_s));
        if silent_s > self.config.silence_after_s || !(obeys || prestream) {
            return nothing;
        }
        let fresh = self.published.filter(|(time, _)| now.seconds_since(*time) <= self.config.setpoint_age_max_s);
        let motion = fresh.filter(|_| control == Control::Granted).map(|(_, setpoint)| setpoint);
        Poll { target: Some((autopilot.system_id, autopilot.component_id)), motion, ..nothing }
    }

    /// Takes what the companion has to say, and checks it. What does not fit is said next time.
    fn transmit(&mut self, now: Instant, room: usize) -> usize {
        let mut sink = [0; 300];
        let length = self.companion.transmit(&mut sink[..room]);
        assert!(length <= room);
        let mut rest = &sink[..length];
        while !rest.is_empty() {
            rest = &rest[self.sent.push(rest)..];
            while let Some(frame) = self.sent.next_frame() {
                match frame.message() {
                    Some(MavMessage::SET_POSITION_TARGET_LOCAL_NED(target)) => {
                        check_setpoint(&self.config, &self.polls, (!self.in_flight).then_some(now), &target);
                        let moves = [target.vx, target.vy, target.vz, target.yaw_rate] != [0.0; 4];
                        self.reached.usable += u32::from(moves);
                    }
                    Some(MavMessage::NAMED_VALUE_FLOAT(value)) => assert!(value.value.is_finite(), "{value:?}"),
                    message => assert!(message.is_some(), "we send what we do not know: {}", frame.message_id),
                }
                self.in_flight = false;
            }
        }
        // With room to spare the last frame is whole.
        self.in_flight = length == room && (length > 0 || self.in_flight);
        let counters = self.sent.counters();
        assert_eq!((counters.bad_crc, counters.skipped_bytes, counters.unknown), (0, 0, 0), "what we send is whole");
        assert_eq!(counters.lost, 0, "our frames are counted without a gap");
        length
    }

    /// When nothing more happens, there comes an end to what it has to say.
    fn drain(&mut self, now: Instant) {
        let silent = (0..100).any(|_| self.transmit(now, 300) == 0);
        assert!(silent, "it never falls silent");
    }
}

/// A setpoint must be one that was allowed at the poll that made it. `now` is the time when it began to leave, if that
/// is known: then the poll must not be farther back than the time from setpoint to setpoint.
fn check_setpoint(
    config: &companion::Config,
    polls: &VecDeque<Poll>,
    now: Option<Instant>,
    target: &SET_POSITION_TARGET_LOCAL_NED_DATA,
) {
    assert_eq!((target.type_mask, target.coordinate_frame), (TYPE_MASK, LOCAL_NED), "{target:?}");
    let ignored = [target.x, target.y, target.z, target.afx, target.afy, target.afz, target.yaw];
    assert!(ignored.iter().all(|number| *number == 0.0), "{target:?}");
    let speed = [target.vx, target.vy, target.vz].map(f64::from).iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!(speed <= f64::from(config.speed_max_mps) * 1.000_001, "{target:?}");
    assert!(target.yaw_rate.abs() <= config.yaw_rate_max_radps, "{target:?}");

    let made_at = |poll: &&Poll| (poll.time.0 / 1_000) as u32 == target.time_boot_ms;
    let fits = |poll: &&Poll| {
        let Some(address) = poll.target else { return false };
        let still = [target.vx, target.vy, target.vz, target.yaw_rate] == [0.0; 4];
        let moves_as = |setpoint: &Setpoint| {
            let velocity = &setpoint.velocity_ned_mps;
            let down = if poll.landed { velocity.down.max(0.0) } else { velocity.down };
            [target.vx, target.vy, target.vz, target.yaw_rate]
                == [velocity.north, velocity.east, down, setpoint.yaw_rate_radps]
        };
        let recent = now.is_none_or(|now| now.micros_since(poll.time) <= 1_000 * u64::from(config.setpoint_period_ms));
        address == (target.target_system, target.target_component)
            && recent
            && (still || poll.motion.as_ref().is_some_and(moves_as))
    };
    // Two polls within a millisecond have the same name.
    assert!(polls.iter().filter(made_at).any(|poll| fits(&poll)), "{target:?} at {now:?}");
}

/// CRC-16/MCRF4XX from a table of our own.
fn checksum(bytes: &[u8], extra: u8) -> u16 {
    static TABLE: OnceLock<[u16; 256]> = OnceLock::new();
    let table = TABLE.get_or_init(|| {
        std::array::from_fn(|byte| {
            (0..8).fold(byte as u16, |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0x8408 } else { crc >> 1 })
        })
    });
    let step = |crc: u16, byte: u8| (crc >> 8) ^ table[usize::from(crc as u8 ^ byte)];
    step(bytes.iter().fold(0xffff, |crc, byte| step(crc, *byte)), extra)
}

/// Finishes a frame whose header and payload are there, and says how long it is.
fn finish(buffer: &mut [u8; FRAME_MAX], extra: u8, draw: &mut Draw<'_>) -> usize {
    let body = 10 + usize::from(buffer[1]);
    let crc = checksum(&buffer[1..body], extra).to_le_bytes();
    buffer[body..body + 2].copy_from_slice(&crc);
    if buffer[2] == 0 {
        return body + 2;
    }
    buffer[body + 2..body + 15].fill_with(|| draw.byte());
    body + 15
}

/// A heartbeat of an autopilot, in or out of the mode, armed or not.
fn heartbeat(draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
    let (kind, mode) = (draw.byte(), draw.byte());
    let (autopilot, custom_mode) = match kind & 7 {
        0..5 => (3, if mode < 192 { 4 } else { u32::from(mode) }),
        5 | 6 => (12, if mode < 192 { 6 << 16 } else { u32::from(mode) << 16 }),
        _ => (mode, 4),
    };
    let armed = if kind < 224 { 0x89 } else { 0x09 };
    let component = if kind & 0x18 == 0x18 { mode } else { 1 };
    buffer[..10].copy_from_slice(&[0xfd, 9, 0, 0, draw.byte(), 1, component, 0, 0, 0]);
    buffer[10..14].copy_from_slice(&custom_mode.to_le_bytes());
    buffer[14..19].copy_from_slice(&[2, autopilot, armed, 4, 3]);
    finish(buffer, MavMessage::extra_crc(0), draw)
}

/// The autopilot says where the vehicle is: on the ground, in the air, or anywhere.
fn landed(draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
    const ID: u8 = 245;
    let state = if draw.flag() { 1 } else { draw.byte() };
    buffer[..12].copy_from_slice(&[0xfd, 2, 0, 0, draw.byte(), 1, 1, ID, 0, 0, 0, state]);
    finish(buffer, MavMessage::extra_crc(u32::from(ID)), draw)
}

/// A whole frame of one of our messages with any payload.
fn any_frame(draw: &mut Draw<'_>, buffer: &mut [u8; FRAME_MAX]) -> usize {
    let ids = MavMessage::all_ids();
    let id = ids[usize::from(draw.byte()) % ids.len()];
    let length = draw.byte();
    let signed = draw.below(8) == 0;
    let sender = if draw.below(4) == 0 { [draw.byte(), draw.byte()] } else { [1, 1] };
    let [low, middle, high, _] = id.to_le_bytes();
    let head = [0xfd, length, u8::from(signed), 0, draw.byte(), sender[0], sender[1], low, middle, high];
    buffer[..10].copy_from_slice(&head);
    buffer[10..10 + usize::from(length)].fill_with(|| draw.byte());
    finish(buffer, MavMessage::extra_crc(id), draw)
}

/// An output of guidance with any numbers.
fn output(draw: &mut Draw<'_>) -> Output {
    static SILENT: OnceLock<Output> = OnceLock::new();
    let mut output = *SILENT.get_or_init(|| match guidance::Config::default().build::<64>() {
        Ok(guidance) => guidance.step(
            &mut guidance.start(),
            &Input {
                now: Instant(0),
                front_end: FrontEnd::Nothing,
                ownship: None,
                scan: None,
                points: None,
                circles: None,
                control: Control::LinkLost,
                plan: None,
            },
        ),
        Err(error) => unreachable!("the default configuration: {error}"),
    });
    let velocity = &mut output.setpoint.velocity_ned_mps;
    (velocity.north, velocity.east, velocity.down) = (draw.any(-3.0, 3.0), draw.any(-3.0, 3.0), draw.any(-3.0, 3.0));
    output.setpoint.yaw_rate_radps = draw.any(-1.0, 1.0);
    output.source_bearing_ned_rad = draw.flag().then(|| draw.any(-PI, PI));
    output
}
