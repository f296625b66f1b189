//! Signing against pymavlink, in both directions. `cargo xtask test` installs it and runs these.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Stdio};

use foxhound_core::base::time::Instant;
use foxhound_link::dialect::{
    HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavMessage, NAMED_VALUE_FLOAT_DATA, OBSTACLE_DISTANCE_DATA,
    SET_POSITION_TARGET_LOCAL_NED_DATA, STATUSTEXT_DATA,
};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode};
use foxhound_link::signing::{Key, Setup, Signing, TIMESTAMP_MAX, Verdict, set_up};
use foxhound_tests::{peer, share_machine};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

const NOW: Instant = Instant(0);
const MINUTE: u64 = 6_000_000;
/// 2026-01-01 in units of 10 us since 2015-01-01.
const NEW_YEAR: u64 = 34_715_520_000_000;

/// pymavlink in a process of its own.
struct Peer {
    process: Child,
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Peer {
    fn new(key: &[u8; 32]) -> Self {
        let mut process = peer("signing.py").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (orders, answers) = (process.stdin.take().unwrap(), process.stdout.take().unwrap());
        let mut peer = Self { process, orders, answers: BufReader::new(answers) };
        assert_eq!(peer.ask(&format!("key {}", hex(key))), "ok");
        peer
    }

    fn ask(&mut self, order: &str) -> String {
        writeln!(self.orders, "{order}").unwrap();
        let mut answer = String::new();
        self.answers.read_line(&mut answer).unwrap();
        assert!(answer.ends_with('\n'), "the peer ended: {order}");
        answer.trim_end().to_owned()
    }

    fn takes(&mut self, frame: &[u8]) -> bool {
        match self.ask(&format!("read {}", hex(frame))).as_str() {
            "refused" => false,
            answer => answer.starts_with("taken ") || panic!("{answer}"),
        }
    }

    fn sign(&mut self, seed: u32, link_id: u8, timestamp: u64, component_id: u8) -> Vec<u8> {
        bytes(&self.ask(&format!("sign {seed} {link_id} {timestamp} 1 {component_id}")))
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn random_key(source: &mut Xoshiro256PlusPlus) -> [u8; 32] {
    let mut key = [0; 32];
    source.fill_bytes(&mut key);
    key
}

fn signing(key: [u8; 32], link_id: u8, timestamp: u64) -> Signing {
    let mut signing = Signing::new(Key::new(key).unwrap(), link_id);
    signing.restore(NOW, timestamp);
    signing
}

/// One of the messages that we send, with any numbers.
fn message(source: &mut Xoshiro256PlusPlus) -> MavMessage {
    let mut number = || f32::from_bits(source.next_u32());
    let (a, b, c, d) = (number(), number(), number(), number());
    let word = source.next_u32();
    match source.next_u32() % 6 {
        0 => MavMessage::HEARTBEAT(HEARTBEAT_DATA { custom_mode: word, mavtype: 18, ..HEARTBEAT_DATA::DEFAULT }),
        1 => MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
            vx: a,
            vy: b,
            vz: c,
            yaw_rate: d,
            type_mask: word as u16,
            coordinate_frame: 1,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        }),
        2 => MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA { value: a, ..NAMED_VALUE_FLOAT_DATA::DEFAULT }),
        3 => MavMessage::STATUSTEXT(STATUSTEXT_DATA { severity: (word % 8) as u8, ..STATUSTEXT_DATA::DEFAULT }),
        4 => MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            x: a,
            y: b,
            z: c,
            time_boot_ms: word,
            vx: d,
            vy: d,
            vz: d,
        }),
        _ => MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA {
            time_usec: u64::from(word),
            distances: [word as u16; 72],
            ..OBSTACLE_DISTANCE_DATA::DEFAULT
        }),
    }
}

fn signed(signing: &mut Signing, source: &mut Xoshiro256PlusPlus) -> Vec<u8> {
    let mut frame = vec![0; FRAME_MAX];
    let header = Header { system_id: 1, component_id: 191, sequence: source.next_u32() as u8 };
    let length = encode(header, &message(source), &mut frame);
    let length = signing.sign(NOW, &mut frame, length);
    frame.truncate(length);
    frame
}

/// pymavlink accepts what we sign, and refuses our frames once they are changed or old.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn pymavlink_takes_what_we_sign_and_refuses_what_is_wrong_or_old() {
    let _machine = share_machine();
    let mut source = Xoshiro256PlusPlus::seed_from_u64(60);
    let key = random_key(&mut source);
    let mut peer = Peer::new(&key);
    let mut links = [signing(key, 0, NEW_YEAR), signing(key, 255, NEW_YEAR)];
    let mut last = [Vec::new(), Vec::new()];
    for round in 0..400 {
        let link = source.next_u32() as usize % 2;
        let frame = signed(&mut links[link], &mut source);
        assert!(peer.takes(&frame), "{round}: {}", hex(&frame));
        last[link] = frame;
    }
    for frame in &last {
        assert!(!peer.takes(frame), "played back");
    }
    // It judges signatures after timestamps, so each needs a new one.
    for _ in 0..20 {
        let mut frame = signed(&mut links[0], &mut source);
        let at = frame.len() - 1 - (source.next_u32() as usize % 6);
        frame[at] ^= 1 << (source.next_u32() % 8);
        assert!(!peer.takes(&frame), "a broken signature");
    }
    let mut other = key;
    other[31] ^= 1;
    assert!(!peer.takes(&signed(&mut signing(other, 7, NEW_YEAR), &mut source)), "another key");
    assert!(!peer.takes(&signed(&mut signing(key, 8, NEW_YEAR - 2 * MINUTE), &mut source)), "too old");
    assert!(peer.takes(&signed(&mut signing(key, 8, TIMESTAMP_MAX - 1), &mut source)), "the last timestamp");
}

/// We accept what pymavlink signs, and refuse its frames once they are changed or old.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn we_take_what_pymavlink_signs_and_refuse_what_is_wrong_or_old() {
    let _machine = share_machine();
    let mut source = Xoshiro256PlusPlus::seed_from_u64(61);
    let key = random_key(&mut source);
    let mut peer = Peer::new(&key);
    let mut ours = signing(key, 3, NEW_YEAR - MINUTE);
    let mut framer = Framer::new();
    let mut timestamp = NEW_YEAR;
    for seed in 0..400 {
        timestamp += 1 + u64::from(source.next_u32() % 1000);
        let (link_id, component_id) = ((source.next_u32() % 2) as u8, 1 + (source.next_u32() % 3) as u8);
        let frame = peer.sign(seed, link_id, timestamp, component_id);
        // The framer gives the frame whole.
        assert_eq!(framer.push(&frame), frame.len());
        let found = framer.next_frame().unwrap();
        assert!(found.signed && found.bytes == frame);
        let bit = source.next_u32() as usize % (8 * frame.len());
        let mut broken = frame.clone();
        broken[bit / 8] ^= 1 << (bit % 8);
        assert!(matches!(ours.check(NOW, &broken), Verdict::WrongSignature | Verdict::Malformed), "bit {bit}");
        assert_eq!(ours.check(NOW, &frame), Verdict::Valid, "{}", hex(&frame));
        assert_eq!(ours.check(NOW, &frame), Verdict::Replayed);
    }
    let old = peer.sign(1, 200, timestamp - MINUTE - 1, 1);
    assert_eq!(ours.check(NOW, &old), Verdict::TooOld);
    let last = peer.sign(1, 201, TIMESTAMP_MAX, 1);
    assert_eq!(ours.check(NOW, &last), Verdict::Valid);

    let mut stranger = Peer::new(&random_key(&mut source));
    assert_eq!(ours.check(NOW, &stranger.sign(1, 0, timestamp + 5000, 1)), Verdict::WrongSignature);
}

/// A key that pymavlink sets up lets both sides verify each other.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn a_key_from_pymavlink_makes_us_understand_each_other() {
    let _machine = share_machine();
    let mut source = Xoshiro256PlusPlus::seed_from_u64(62);
    let key = random_key(&mut source);
    let mut peer = Peer::new(&key);
    let frame = bytes(&peer.ask(&format!("setup {} {NEW_YEAR} 1 191", hex(&key))));
    let mut framer = Framer::new();
    framer.push(&frame);
    let Some(MavMessage::SETUP_SIGNING(setup)) = framer.next_frame().unwrap().message() else { panic!() };
    assert!(matches!(set_up(NOW, &setup, (1, 191), false, 0, None), Setup::Refused));
    let Setup::On(mut ours) = set_up(NOW, &setup, (1, 191), true, 0, None) else { panic!() };
    assert!(peer.takes(&signed(&mut ours, &mut source)));
    assert_eq!(ours.check(NOW, &peer.sign(1, 0, NEW_YEAR + 1, 1)), Verdict::Valid);
}
