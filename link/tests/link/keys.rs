//! The companion with a key: what it believes, what it sends, and where a key may come from.

use foxhound_core::base::time::Instant;
use foxhound_core::guidance::mission::Control;
use foxhound_link::companion::{Companion, Config};
use foxhound_link::dialect::*;
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode};
use foxhound_link::signing::{Key, SIGNATURE, Signing, Unsigned, Verdict};

use crate::bench::*;

const SECRET: [u8; 32] = [7; 32];

/// An autopilot that signs, and a companion.
struct Pair {
    companion: Companion,
    autopilot: Signing,
    now_us: u64,
}

impl Pair {
    fn of(config: Config, secret: [u8; 32]) -> Self {
        let mut companion = config.build().unwrap();
        companion.sign_with(Some(Signing::new(Key::new(SECRET).unwrap(), 0)));
        Self { companion, autopilot: Signing::new(Key::new(secret).unwrap(), 3), now_us: 1_000_000 }
    }

    fn now(&self) -> Instant {
        Instant(self.now_us)
    }

    fn frame(message: &MavMessage) -> ([u8; FRAME_MAX], usize) {
        let mut frame = [0; FRAME_MAX];
        let length = encode(Header { system_id: 1, component_id: 1, sequence: 0 }, message, &mut frame);
        (frame, length)
    }

    fn say_signed(&mut self, message: &MavMessage) {
        let (mut frame, length) = Self::frame(message);
        let length = self.autopilot.sign(self.now(), &mut frame, length);
        self.companion.receive(self.now(), &frame[..length]);
    }

    fn say_unsigned(&mut self, message: &MavMessage) {
        let (frame, length) = Self::frame(message);
        self.companion.receive(self.now(), &frame[..length]);
    }

    /// A second passes; what was sent in it.
    fn run(&mut self) -> Vec<Vec<u8>> {
        let (mut framer, mut sent) = (Framer::new(), Vec::new());
        for _ in 0..50 {
            self.now_us += 20_000;
            self.companion.publish(self.now(), &output([1.0, 0.0, 0.0], 0.0));
            self.companion.poll(self.now());
            let mut sink = [0; 64];
            loop {
                let length = self.companion.transmit(&mut sink);
                if length == 0 {
                    break;
                }
                assert_eq!(framer.push(&sink[..length]), length);
                while let Some(frame) = framer.next_frame() {
                    sent.push(frame.bytes.to_vec());
                }
            }
        }
        assert_eq!((framer.counters().bad_crc, framer.counters().skipped_bytes), (0, 0));
        sent
    }
}

fn guided() -> MavMessage {
    MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED))
}

#[test]
fn everything_that_is_sent_is_signed_and_its_peer_believes_it() {
    let mut pair = Pair::of(Config::default(), SECRET);
    pair.say_signed(&guided());
    assert_eq!(pair.companion.control(pair.now()), Control::Granted);
    let sent = pair.run();
    assert!(sent.len() > 30, "{}", sent.len());
    for frame in &sent {
        assert_eq!(pair.autopilot.check(pair.now(), frame), Verdict::Valid);
        assert!(frame.len() > SIGNATURE);
    }
    assert!(sent.iter().any(|frame| frame[7] == 84), "setpoints among them");
    assert_eq!(pair.autopilot.check(pair.now(), &sent[0]), Verdict::Replayed);
}

#[test]
fn what_is_not_signed_moves_nothing() {
    for unsigned in [Unsigned::UntilFirstSigned, Unsigned::HeartbeatAndRadioStatusOnly] {
        let mut pair = Pair::of(Config { unsigned, ..Config::default() }, SECRET);
        pair.say_unsigned(&guided());
        assert_eq!(pair.companion.autopilot(), None, "a heartbeat gives no control");
        pair.say_signed(&guided());
        pair.say_signed(&position(1_000));
        pair.say_signed(&attitude(1_000, 0.5));
        let known = pair.companion.ownship();
        assert!(known.is_some());
        pair.now_us += 20_000;
        pair.say_unsigned(&position(1_020));
        pair.say_unsigned(&attitude(1_020, 0.6));
        pair.say_unsigned(&extended(1));
        pair.say_unsigned(&MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, 5, DISARMED)));
        pair.say_unsigned(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            target_system: 1,
            target_component: 191,
            command: 193,
            ..COMMAND_LONG_DATA::DEFAULT
        }));
        assert_eq!(pair.companion.ownship(), known);
        assert_eq!(pair.companion.landed(), None);
        assert_eq!(pair.companion.control(pair.now()), Control::Granted);
        assert_eq!(pair.companion.counters().unsigned, 6);
        assert_eq!(pair.companion.counters().forged, 0);
    }
    let mut pair = Pair::of(Config { unsigned: Unsigned::Always, ..Config::default() }, SECRET);
    pair.say_unsigned(&guided());
    assert_eq!(pair.companion.control(pair.now()), Control::Granted, "who asks for it gets it");
}

#[test]
fn wrong_keys_changed_frames_and_old_ones_are_refused_and_counted() {
    let mut pair = Pair::of(Config::default(), [8; 32]);
    pair.say_signed(&guided());
    assert_eq!((pair.companion.autopilot(), pair.companion.counters().forged), (None, 1));

    let mut pair = Pair::of(Config::default(), SECRET);
    let (mut frame, length) = Pair::frame(&guided());
    let length = pair.autopilot.sign(pair.now(), &mut frame, length);
    let mut changed = frame;
    changed[length - 1] ^= 1;
    pair.companion.receive(pair.now(), &changed[..length]);
    assert_eq!((pair.companion.autopilot(), pair.companion.counters().forged), (None, 1));
    for count in [1, 2, 3] {
        pair.companion.receive(pair.now(), &frame[..length]);
        assert_eq!(pair.companion.counters().forged, count, "the first is new, the others are played back");
    }
}

fn key(target_system: u8, secret_key: [u8; 32]) -> MavMessage {
    MavMessage::SETUP_SIGNING(SETUP_SIGNING_DATA {
        target_system,
        target_component: 191,
        secret_key,
        initial_timestamp: 5,
    })
}

#[test]
fn a_key_is_taken_where_it_is_allowed_on_a_disarmed_vehicle_and_nowhere_else() {
    for provisioning in [false, true] {
        for base_mode in [DISARMED, ARMED] {
            let mut bench = Bench::new(Config { provisioning, ..Config::default() });
            bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, base_mode));
            bench.step(10_000);
            bench.say_as((255, 190), &key(9, SECRET));
            assert!(bench.companion.signing().is_none(), "somebody else's");
            bench.say_as((255, 190), &key(1, SECRET));
            let taken = provisioning && base_mode == DISARMED;
            assert_eq!(bench.companion.signing().is_some(), taken, "{provisioning} {base_mode}");
            assert_eq!(bench.companion.take_key_change(), taken);
            assert!(!bench.companion.take_key_change(), "told once");
            bench.run(2.0);
            let told: Vec<String> = texts(&mut bench).into_iter().map(|(_, text)| text).collect();
            let expected = if taken { "Foxhound: signing is on" } else { "Foxhound: takes no key now" };
            assert!(told.iter().any(|text| text == expected), "{told:?}");
            assert!(!told.iter().any(|text| text.contains('7')), "no word of the key");
        }
    }
}

#[test]
fn with_a_key_another_one_comes_only_signed() {
    let config = Config { provisioning: true, ..Config::default() };
    let mut pair = Pair::of(config, SECRET);
    pair.say_unsigned(&key(1, [9; 32]));
    assert!(!pair.companion.take_key_change());
    pair.say_signed(&key(1, [0; 32]));
    assert!(pair.companion.take_key_change() && pair.companion.signing().is_none(), "zeros end it");
}
