//! Anything through the link.

mod application;
mod frames;
mod rules;

use std::collections::VecDeque;

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::control::guard::Setpoint;
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::param::{Id, Values};
use foxhound_core::mapping::scan::Sector;
use foxhound_link::companion::{self, Companion, ObstacleFrame, Storage, Yaw};
use foxhound_link::framer::{FRAME_MAX, Framer};
use foxhound_link::signing::{Signing, Unsigned};

use super::{Draw, Reached};
use application::Application;
use frames::{Peer, key};
use rules::{Believed, Listener, Poll};

/// Polls that a setpoint may come from. Between two frames that fit nowhere there are never so many.
const POLLS: usize = 64;

/// Any bytes, broken and whole frames, signed and not, in any pieces and at any time, any outputs and parameters in
/// between.
pub fn link(case: &[u8]) -> Reached {
    let draw = &mut Draw { rest: case };
    let config = config(draw);
    let values = draw.flag().then(|| values(draw));
    let Ok(mut companion) = values.map_or_else(|| config.build(), |values| config.build_with(values)) else {
        return Reached::default();
    };
    let mut twin = Framer::new();
    let config_now = values.map_or(config, |values| config.with(&values));
    twin.accept_v1(config_now.accept_v1);
    if draw.below(3) == 0 {
        companion.sign_with(key(draw).map(|key| Signing::new(key, 0)));
    }
    let mut flight = Flight {
        base: config,
        config: config_now,
        companion,
        peer: Peer::new(draw),
        twin,
        listener: Listener::new(),
        application: Application::new(),
        published: None,
        polls: VecDeque::with_capacity(POLLS),
        reached: Reached { configured: true, ..Reached::default() },
    };
    let mut now = Instant(0);
    // How many whole frames there were, while there was nothing else.
    let mut whole = Some(0);
    let (mut pushed, mut framed) = (0, 0);
    let mut buffer = [0; FRAME_MAX];
    while !draw.rest.is_empty() {
        let before = now;
        now = if draw.below(8) == 0 { draw.instant(now) } else { now.plus_micros(1_000 * u64::from(draw.below(64))) };
        if now < before {
            flight.published = None;
        }
        let kind = draw.below(16);
        let length = match kind {
            0 => {
                whole = None;
                let length = usize::from(draw.byte());
                buffer[..length].fill_with(|| draw.byte());
                length
            }
            1 | 2 => flight.peer.heartbeat(now, draw, &mut buffer),
            3 => flight.peer.landed(now, draw, &mut buffer),
            4 | 5 => flight.peer.motion(now, draw, &mut buffer),
            6 => flight.peer.health(now, draw, &mut buffer),
            7 => flight.peer.order(now, draw, &mut buffer),
            8 => flight.peer.parameter(now, draw, &mut buffer),
            9 => flight.peer.again(&mut buffer),
            10 => flight.peer.any_frame(now, draw, &mut buffer),
            11..14 => {
                flight.publish(now, draw);
                0
            }
            14 => {
                flight.tamper(draw);
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
        flight.serve(now, draw);
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
        setpoint_age_max_s: draw.field(0.25, 0.0, 1.0),
        yaw: if draw.below(3) == 0 { Yaw::Angle } else { Yaw::Rate },
        heartbeat_timeout_s: draw.field(2.5, 1.0, 10.0),
        silence_after_s: draw.field(5.0, 1.0, 30.0),
        prestream: draw.flag(),
        obstacle_frame: [ObstacleFrame::Auto, ObstacleFrame::Field, ObstacleFrame::Body][usize::from(draw.below(3))],
        battery_min_percent: if draw.below(8) == 0 { 30.0 } else { 0.0 },
        switch_channel: draw.byte().saturating_sub(237),
        landing_target: draw.flag(),
        surroundings: draw.flag(),
        accept_v1: draw.below(8) == 0,
        unsigned: [Unsigned::Always, Unsigned::UntilFirstSigned, Unsigned::HeartbeatAndRadioStatusOnly]
            [usize::from(draw.below(3))],
        provisioning: draw.flag(),
        ..companion::Config::default()
    }
}

/// The defaults, but for a few.
fn values(draw: &mut Draw<'_>) -> Values {
    let mut values = Values::DEFAULT;
    for _ in 0..draw.below(4) {
        let (id, value) = setting(draw);
        // What is refused stays.
        let _ = values.set(id, value);
    }
    values
}

/// A parameter, and a value that it may have more often than not.
fn setting(draw: &mut Draw<'_>) -> (Id, f32) {
    let all: Vec<Id> = Id::all().collect();
    let id = all[usize::from(draw.byte()) % all.len()];
    let (min, max) = id.range();
    let value = draw.any(min, max);
    (id, if draw.flag() { value.round() } else { value })
}

/// A companion and what is known of it from outside.
struct Flight {
    /// As it was built, and with the parameters.
    base: companion::Config,
    config: companion::Config,
    companion: Companion,
    /// Who speaks to it.
    peer: Peer,
    /// Hears the same as the companion, in one piece.
    twin: Framer,
    /// Hears what the companion says.
    listener: Listener,
    application: Application,
    published: Option<(Instant, Setpoint)>,
    polls: VecDeque<Poll>,
    reached: Reached,
}

impl Flight {
    fn publish(&mut self, now: Instant, draw: &mut Draw<'_>) {
        let output = application::output(draw);
        self.listener.hears_a_bearing(&output);
        self.companion.publish(now, &output);
        self.published = Some((now, output.setpoint));
        if self.companion.wants_surroundings(now) {
            let circle = Circle {
                center_ned_m: Horizontal { north: draw.any(-9.0, 9.0), east: draw.any(-9.0, 9.0) },
                radius_m: draw.any(0.0, 2.0),
                velocity_ned_mps: Horizontal::default(),
            };
            self.companion.publish_surroundings(now, [circle].into_iter());
        }
    }

    /// What an application may do besides.
    fn tamper(&mut self, draw: &mut Draw<'_>) {
        match draw.below(8) {
            0 => {
                let values = values(draw);
                if self.companion.set_parameters(values).is_ok() {
                    self.follow_parameters();
                }
            }
            1 => {
                self.companion.sign_with(key(draw).map(|key| Signing::new(key, 0)));
                self.begin_anew();
            }
            2 if draw.below(8) == 0 => self.companion.fail(),
            3 => {
                if let Some(signing) = self.companion.signing() {
                    signing.set_clock(Instant(0), 1_000_000 * u64::from(draw.word()));
                }
            }
            _ => {}
        }
    }

    /// With another key, or with the same and nothing known.
    fn begin_anew(&mut self) {
        self.peer.begins_anew();
        self.listener.begins_anew();
    }

    /// Returns how many bytes were those of frames.
    fn receive(&mut self, now: Instant, bytes: &[u8], piece: usize) -> usize {
        // The time alone changes enough.
        self.companion.receive(now, &[]);
        let key = self.companion.signing().map(|signing| signing.key().clone());
        let before = Believed::of(&mut self.companion, now);
        for piece in bytes.chunks(piece) {
            self.companion.receive(now, piece);
        }
        let (mut rest, mut framed, mut genuine) = (bytes, 0, false);
        while !rest.is_empty() {
            let taken = self.twin.push(rest);
            assert!(taken > 0, "a framer that takes nothing stops the stream");
            rest = &rest[taken..];
            while let Some(frame) = self.twin.next_frame() {
                let around = if frame.bytes[0] == 0xFE { 8 } else { 12 };
                let extra = if frame.signed { 13 } else { 0 };
                assert_eq!(frame.bytes.len(), around + frame.payload.len() + extra);
                framed += frame.bytes.len();
                genuine |= self.peer.signed(frame.signature(), key.as_ref());
                self.reached.answers += 1;
            }
        }
        if key.is_some() && !genuine && self.config.unsigned != Unsigned::Always {
            assert_eq!(before, Believed::of(&mut self.companion, now), "believed without a signature");
            assert!(self.companion.scan().is_none() && self.companion.points().is_none());
        }
        framed
    }

    /// Does for the companion what its application does.
    fn serve(&mut self, now: Instant, draw: &mut Draw<'_>) {
        if self.companion.take_key_change() {
            self.begin_anew();
        }
        if let Some(storage) = self.companion.take_storage() {
            if storage == Storage::Reset && self.companion.set_parameters(Values::DEFAULT).is_ok() {
                self.follow_parameters();
            }
            self.companion.stored(draw.flag());
        }
        let granted = self.companion.control(now) == Control::Granted;
        let held = *self.companion.parameters();
        let Some((id, values)) = self.companion.proposal() else {
            assert_eq!(*self.companion.parameters(), held, "changed without an answer");
            return;
        };
        assert!(!granted, "proposes while in control");
        assert_eq!(id.check(values.get(id)), Ok(()));
        assert!(Id::all().all(|other| other == id || values.get(other) == held.get(other)));
        let verdict = self.application.adopt(id, &values);
        self.companion.settle(verdict);
        assert_eq!(*self.companion.parameters(), if verdict.is_ok() { values } else { held });
        self.follow_parameters();
        self.reached.settled += u32::from(verdict.is_ok());
    }

    /// The link's own part of the parameters holds from now on, and is one that it could start with.
    fn follow_parameters(&mut self) {
        let accepts_v1 = self.config.accept_v1;
        self.config = self.base.with(self.companion.parameters());
        assert!(self.config.build().is_ok(), "{:?}", self.config.build().err());
        if self.config.accept_v1 != accepts_v1 {
            self.twin.accept_v1(self.config.accept_v1);
        }
    }

    fn poll(&mut self, now: Instant) {
        self.companion.poll(now);
        if let Some(ownship) = self.companion.ownship() {
            assert!(ownship.is_finite(), "{ownship:?}");
        }
        if let Some(scan) = self.companion.scan() {
            assert!(scan.first_azimuth_rad.is_finite() && scan.step_rad.is_finite() && scan.step_rad != 0.0);
            let sane =
                |sector: &Sector| !matches!(sector, Sector::Hit(metres) if !(metres.is_finite() && *metres >= 0.0));
            assert!(scan.rays.iter().all(|sector| sane(&sector)), "{scan:?}");
        }
        if let Some(points) = self.companion.points() {
            assert!(points.points_m.iter().all(|point| point.is_finite()), "{points:?}");
        }
        self.companion.drop_obstacles();
        if self.polls.len() == POLLS {
            self.polls.pop_front();
        }
        self.polls.push_back(Poll::of(&self.companion, &self.config, self.published, now));
    }

    /// Takes what the companion has to say, and checks it. What does not fit is said next time.
    fn transmit(&mut self, now: Instant, room: usize) -> usize {
        let mut sink = [0; 300];
        let key = self.companion.signing().map(|signing| signing.key().clone());
        let length = self.companion.transmit(&mut sink[..room]);
        assert!(length <= room);
        self.reached.usable += self.listener.hear(now, &sink[..length], room, key, &self.polls);
        length
    }

    /// When nothing more happens, there comes an end to what it has to say.
    fn drain(&mut self, now: Instant) {
        let silent = (0..100).any(|_| self.transmit(now, 300) == 0);
        assert!(silent, "it never falls silent");
    }
}
