//! Signing, rule by rule. The frame of pymavlink is the oracle here; `tests/link/signing.rs` has pymavlink itself.

use foxhound_core::base::time::Instant;
use foxhound_link::dialect::{ATTITUDE_DATA, HEARTBEAT_DATA, MavMessage, SETUP_SIGNING_DATA};
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode};
use foxhound_link::signing::{
    Key, SIGNATURE, STREAMS, Setup, Signing, TIMESTAMP_MAX, Unsigned, Verdict, is_secret, set_up,
};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

const MINUTE: u64 = 6_000_000;
/// 2026-01-01 in units of 10 us since 2015-01-01.
const NEW_YEAR: u64 = 34_715_520_000_000;
const NEW_YEAR_UNIX_US: u64 = 1_767_225_600_000_000;
const START: Instant = Instant(0);

/// pymavlink 2.4.50: a heartbeat of component 191, key 00 01 .. 1f, link 3, timestamp 123456.
const GOLDEN: &str = "fd0901000001bf000000000000001208000403493e0340e2010000002bb0c9030021";

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn key(first: u8) -> Key {
    Key::new(std::array::from_fn(|index| first + index as u8)).unwrap()
}

fn signing() -> Signing {
    Signing::new(key(0), 3)
}

/// A signer with the same key that starts at a timestamp.
fn peer(link_id: u8, timestamp: u64) -> Signing {
    let mut peer = Signing::new(key(0), link_id);
    peer.restore(START, timestamp - 1);
    peer
}

fn attitude(component_id: u8) -> (Vec<u8>, usize) {
    let mut frame = vec![0; FRAME_MAX];
    let message = MavMessage::ATTITUDE(ATTITUDE_DATA { yaw: 1.5, yawspeed: 0.25, ..ATTITUDE_DATA::DEFAULT });
    let length = encode(Header { system_id: 1, component_id, sequence: 7 }, &message, &mut frame);
    (frame, length)
}

/// A signed frame of a component.
fn signed(signing: &mut Signing, now: Instant, component_id: u8) -> Vec<u8> {
    let (mut frame, length) = attitude(component_id);
    let longer = signing.sign(now, &mut frame, length);
    assert_eq!(longer, length + SIGNATURE);
    frame.truncate(longer);
    frame
}

fn stamp(frame: &[u8]) -> u64 {
    let mut stamp = [0; 8];
    stamp[..6].copy_from_slice(&frame[frame.len() - 12..frame.len() - 6]);
    u64::from_le_bytes(stamp)
}

/// What a signer would use now.
fn time(signing: &Signing, now: Instant) -> u64 {
    stamp(&signed(&mut signing.clone(), now, 1))
}

#[test]
fn our_signature_of_a_heartbeat_is_pymavlinks_byte_by_byte() {
    let heartbeat = HEARTBEAT_DATA { mavtype: 18, autopilot: 8, system_status: 4, ..HEARTBEAT_DATA::DEFAULT };
    let mut frame = [0; FRAME_MAX];
    let header = Header { system_id: 1, component_id: 191, sequence: 0 };
    let length = encode(header, &MavMessage::HEARTBEAT(heartbeat), &mut frame);
    let mut signing = signing();
    signing.restore(START, 123_455);
    let length = signing.sign(START, &mut frame, length);
    assert_eq!(frame[..length], bytes(GOLDEN));
    assert_eq!(Signing::new(key(0), 0).check(START, &bytes(GOLDEN)), Verdict::Valid);
    assert_eq!(Signing::new(key(1), 0).check(START, &bytes(GOLDEN)), Verdict::WrongSignature);
}

#[test]
fn a_signed_frame_of_any_length_keeps_a_right_checksum() {
    let mut source = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut signing = signing();
    let mut framer = Framer::new();
    for count in 1..=500 {
        let yaw = f32::from_bits(source.next_u32());
        let pieces = [source.next_u32() as f32, yaw, 0.0];
        let message = MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms: source.next_u32(),
            yaw,
            yawspeed: pieces[source.next_u32() as usize % 3],
            ..ATTITUDE_DATA::DEFAULT
        });
        let mut frame = [0; FRAME_MAX];
        let length = encode(Header { system_id: 1, component_id: 1, sequence: count as u8 }, &message, &mut frame);
        let length = signing.sign(START, &mut frame, length);
        assert_eq!(framer.push(&frame[..length]), length);
        let found = framer.next_frame().unwrap();
        assert!(found.signed && found.message_id == 30);
        assert_eq!((framer.counters().frames, framer.counters().bad_crc), (count, 0));
    }
}

#[test]
fn a_flip_of_any_bit_of_a_signed_frame_is_noticed_and_changes_nothing() {
    let frame = signed(&mut peer(0, NEW_YEAR), START, 1);
    let mut signing = signing();
    for bit in 0..8 * frame.len() {
        let mut broken = frame.clone();
        broken[bit / 8] ^= 1 << (bit % 8);
        let expected = match bit {
            // The magic byte, the length and the flags say what a frame is.
            0..16 => Verdict::Malformed,
            16..24 => Verdict::Malformed,
            _ => Verdict::WrongSignature,
        };
        assert_eq!(signing.check(START, &broken), expected, "bit {bit}");
    }
    assert_eq!(time(&signing, START), 1, "nothing wrong sets the time");
    assert_eq!(signing.check(START, &frame), Verdict::Valid);
}

#[test]
fn a_frame_counts_once_and_its_stream_only_goes_forward() {
    let mut sender = peer(0, NEW_YEAR);
    let [first, second, third] = [(); 3].map(|()| signed(&mut sender, START, 1));
    let mut signing = signing();
    assert_eq!(signing.check(START, &first), Verdict::Valid);
    assert_eq!(signing.check(START, &first), Verdict::Replayed);
    assert_eq!(signing.check(START, &third), Verdict::Valid);
    assert_eq!(signing.check(START, &second), Verdict::Replayed, "overtaken on the way");
    assert_eq!(signing.check(START, &third), Verdict::Replayed);
}

#[test]
fn the_same_timestamp_counts_once_for_each_sender_and_each_link() {
    let mut signing = signing();
    for (link_id, component_id) in [(0, 1), (1, 1), (0, 2), (255, 1)] {
        let frame = signed(&mut peer(link_id, NEW_YEAR), START, component_id);
        assert_eq!(signing.check(START, &frame), Verdict::Valid);
        assert_eq!(signing.check(START, &frame), Verdict::Replayed);
    }
}

#[test]
fn a_stream_that_is_not_known_may_be_a_minute_behind_us_and_no_more() {
    for (behind, verdict) in [(MINUTE + 1, Verdict::TooOld), (MINUTE, Verdict::Valid), (0, Verdict::Valid)] {
        let mut signing = signing();
        signing.restore(START, NEW_YEAR);
        let frame = signed(&mut peer(0, NEW_YEAR - behind), START, 1);
        assert_eq!(signing.check(START, &frame), verdict, "{behind}");
    }
    // Known, it may lag behind the others.
    let mut signing = signing();
    let mut slow = peer(0, NEW_YEAR);
    assert_eq!(signing.check(START, &signed(&mut slow, START, 1)), Verdict::Valid);
    assert_eq!(signing.check(START, &signed(&mut peer(0, NEW_YEAR + 2 * MINUTE), START, 2)), Verdict::Valid);
    assert_eq!(signing.check(START, &signed(&mut slow, START, 1)), Verdict::Valid);
    // Time passes without frames, too.
    let later = START.plus_micros(10 * 5 * MINUTE);
    assert_eq!(signing.check(later, &signed(&mut peer(0, NEW_YEAR + 5 * MINUTE), START, 3)), Verdict::TooOld);
}

#[test]
fn a_timestamp_of_nought_is_behind_all_others() {
    // Nobody of ours makes one; this was made by hand.
    let mut frame = signed(&mut peer(0, 1), START, 1);
    let end = frame.len();
    frame[end - 12..end - 6].fill(0);
    let mut hash = <sha2::Sha256 as sha2::Digest>::new();
    sha2::Digest::update(&mut hash, key(0).secret());
    sha2::Digest::update(&mut hash, &frame[..end - 6]);
    frame[end - 6..].copy_from_slice(&sha2::Digest::finalize(hash)[..6]);
    assert_eq!(signing().check(START, &frame), Verdict::TooOld);
}

#[test]
fn a_stream_too_many_waits_until_one_was_silent_for_a_minute() {
    let mut signing = signing();
    let mut frames = Vec::new();
    for link_id in 0..STREAMS as u8 {
        frames.push(signed(&mut peer(link_id, NEW_YEAR + u64::from(link_id)), START, 1));
        assert_eq!(signing.check(START, &frames[usize::from(link_id)]), Verdict::Valid);
    }
    let ninth = |units: u64| signed(&mut peer(100, NEW_YEAR + units), START, 1);
    let after = |units: u64| START.plus_micros(10 * units);
    assert_eq!(signing.check(START, &ninth(100)), Verdict::TooManyStreams);
    // The time is that of the youngest: the oldest is 7 units behind it.
    assert_eq!(signing.check(after(MINUTE - 7), &ninth(MINUTE - 7)), Verdict::TooManyStreams);
    assert_eq!(signing.check(after(MINUTE - 6), &ninth(MINUTE - 6)), Verdict::Valid);
    // What made room cannot be played back, the others cannot either.
    assert_eq!(signing.check(after(MINUTE - 6), &frames[0]), Verdict::TooOld);
    for frame in &frames[1..] {
        assert_eq!(signing.check(after(MINUTE - 6), frame), Verdict::Replayed);
    }
}

#[test]
fn no_frame_is_ever_valid_twice_however_many_streams_there_are() {
    let mut source = Xoshiro256PlusPlus::seed_from_u64(2);
    for _ in 0..20 {
        let mut signing = signing();
        let mut heard: Vec<(Vec<u8>, bool)> = Vec::new();
        let mut now = START;
        let (mut valid, mut full) = (0, 0);
        let mut base = NEW_YEAR;
        for _ in 0..400 {
            now = now.plus_micros(u64::from(source.next_u32() % 2_000_000));
            base += u64::from(source.next_u32() % 200_000);
            let again = !heard.is_empty() && source.next_u32() % 2 == 0;
            let index = if again {
                source.next_u32() as usize % heard.len()
            } else {
                let behind = u64::from(source.next_u32() % 3_000_000);
                heard.push((signed(&mut peer((source.next_u32() % 20) as u8, base - behind), START, 1), false));
                heard.len() - 1
            };
            let (frame, was_valid) = &mut heard[index];
            // Clocks may even jump back.
            let then = if source.next_u32() % 16 == 0 { START } else { now };
            match signing.check(then, frame) {
                Verdict::Valid => {
                    assert!(!*was_valid, "played back");
                    *was_valid = true;
                    valid += 1;
                }
                Verdict::TooManyStreams => full += 1,
                _ => {}
            }
        }
        assert!(valid > 40 && full > 0, "{valid} {full}");
    }
}

#[test]
fn timestamps_rise_strictly_and_follow_the_best_clock() {
    let mut signing = signing();
    assert_eq!(stamp(&signed(&mut signing, START, 1)), 1);
    assert_eq!(stamp(&signed(&mut signing, START, 1)), 2, "within one unit");
    assert_eq!(stamp(&signed(&mut signing, Instant(1_000_000), 1)), 100_000, "the time since the start");
    signing.restore(Instant(1_000_000), 5_000_000);
    assert_eq!(stamp(&signed(&mut signing, Instant(1_000_000), 1)), 5_000_001, "what was stored");
    assert_eq!(stamp(&signed(&mut signing, Instant(2_000_000), 1)), 5_100_000, "and the time since then");
    signing.set_clock(Instant(2_000_000), NEW_YEAR_UNIX_US);
    assert_eq!(stamp(&signed(&mut signing, Instant(2_000_000), 1)), NEW_YEAR, "the time of day");
    assert_eq!(stamp(&signed(&mut signing, Instant(3_000_000), 1)), NEW_YEAR + 100_000);
    signing.set_clock(Instant(3_000_000), NEW_YEAR_UNIX_US - 1_000_000_000);
    signing.set_clock(Instant(3_000_000), 0);
    assert_eq!(stamp(&signed(&mut signing, Instant(3_000_000), 1)), NEW_YEAR + 100_001, "never back");
    let ahead = signed(&mut peer(9, NEW_YEAR + 10 * MINUTE), START, 1);
    assert_eq!(signing.check(Instant(3_000_000), &ahead), Verdict::Valid);
    assert_eq!(stamp(&signed(&mut signing, Instant(3_000_000), 1)), NEW_YEAR + 10 * MINUTE + 1, "a right one ahead");
    assert_eq!(stamp(&signed(&mut signing, Instant(4_000_000), 1)), NEW_YEAR + 10 * MINUTE + 100_000);
}

#[test]
fn at_the_end_of_time_signing_stops_and_never_begins_anew() {
    let mut signing = signing();
    let (mut frame, length) = attitude(1);
    let before = frame.clone();
    signing.restore(START, TIMESTAMP_MAX - 2);
    for left in [1, 0] {
        let frame = signed(&mut signing, START, 1);
        assert_eq!(stamp(&frame), TIMESTAMP_MAX - left);
    }
    for now in [START, Instant(u64::MAX)] {
        assert_eq!(signing.sign(now, &mut frame, length), 0);
        assert_eq!(frame, before, "nothing is changed");
    }
    // Others' last frames are still judged.
    let last = signed(&mut peer(0, TIMESTAMP_MAX), START, 1);
    assert_eq!(signing.check(Instant(u64::MAX), &last), Verdict::Valid);
    assert_eq!(signing.check(Instant(u64::MAX), &last), Verdict::Replayed);
    assert_eq!(signing.timestamp_to_store(START), Some(TIMESTAMP_MAX));
    assert_eq!(signing.timestamp_to_store(Instant(u64::MAX)), None, "the memory is not worn out");

    let mut other = Signing::new(key(0), 0);
    other.set_clock(START, u64::MAX);
    assert_eq!(time(&other, START), TIMESTAMP_MAX);
}

#[test]
fn a_frame_that_cannot_be_signed_is_not_to_be_sent() {
    let mut signing = signing();
    let (frame, length) = attitude(1);
    let mut signed_before = signed(&mut signing, START, 1);
    signed_before.resize(FRAME_MAX, 0);
    assert_eq!(signing.sign(START, &mut signed_before, length + SIGNATURE), 0, "signed already");
    for wrong in [0, 1, length - 1, length + 1, FRAME_MAX, FRAME_MAX + 1] {
        assert_eq!(signing.sign(START, &mut frame.clone(), wrong), 0, "{wrong}");
    }
    assert_eq!(signing.sign(START, &mut frame[..length + SIGNATURE - 1].to_vec(), length), 0, "no room");
    assert_eq!(signing.sign(START, &mut frame[..length + SIGNATURE].to_vec(), length), length + SIGNATURE);
    assert_eq!(signing.check(START, &frame[..length]), Verdict::Unsigned);
    for wrong in [0, 1, 2, 3, 9, length - 1, length + 1] {
        assert_eq!(signing.check(START, &frame[..wrong]), Verdict::Malformed, "{wrong}");
    }
}

#[test]
fn after_a_loss_of_power_at_any_moment_no_timestamp_is_used_twice() {
    let mut source = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut memory = 0;
    let mut last = 0;
    for life in 0..200 {
        let mut signing = signing();
        signing.restore(START, memory);
        let mut writes = 0;
        let micros = u64::from(source.next_u32() % 400_000_000);
        let mut now = START;
        while now.0 < micros {
            if let Some(timestamp) = signing.timestamp_to_store(now) {
                assert!(timestamp > memory);
                memory = timestamp;
                writes += 1;
            }
            for _ in 0..3 {
                let used = stamp(&signed(&mut signing, now, 191));
                assert!(used > last, "life {life}: {used} after {last}");
                assert!(used <= memory);
                last = used;
            }
            // A peer that is up to ten minutes ahead sets us forward.
            if source.next_u32() % 200 == 0 {
                let ahead = last + u64::from(source.next_u32()) % (10 * MINUTE);
                signing.check(now, &signed(&mut peer(0, ahead), START, 1));
                continue;
            }
            now = now.plus_micros(250_000);
        }
        assert!(writes <= 1 + 2 * micros / 50_000_000 + micros / 1_000_000, "life {life}: {writes} in {micros} us");
    }
}

#[test]
fn without_jumps_the_timestamp_is_stored_every_55_seconds_and_peers_find_us_again_at_once() {
    let mut signing = signing();
    signing.restore(START, NEW_YEAR);
    let mut stored = Vec::new();
    for second in 0..3600 {
        let now = Instant(second * 1_000_000);
        stored.extend(signing.timestamp_to_store(now).map(|timestamp| (second, timestamp)));
        signed(&mut signing, now, 191);
    }
    assert!((65..=67).contains(&stored.len()), "{}", stored.len());
    assert!(stored.windows(2).all(|pair| matches!(pair[1].0 - pair[0].0, 55 | 56)));

    // Power is lost just after a write; the peer has gone on meanwhile.
    let (second, memory) = stored[30];
    let mut after = self::signing();
    after.restore(START, memory);
    let theirs = NEW_YEAR + second * 100_000;
    assert_eq!(after.check(START, &signed(&mut peer(0, theirs), START, 1)), Verdict::Valid);
}

#[test]
fn unsigned_motion_is_refused_from_the_start_and_life_is_heard() {
    let (position, obstacles, command, parameter, timesync, unknown) = (32, 330, 76, 23, 111, 65_535);
    for heard in [false, true] {
        for id in 0..70_000 {
            assert!(Unsigned::Always.takes(id, heard));
            let alive = id == 0 || id == 109;
            assert_eq!(Unsigned::HeartbeatAndRadioStatusOnly.takes(id, heard), alive, "{id}");
            // What PX4 takes.
            let open = [0, 109, 246, 247].contains(&id);
            let idle = [20, 21, 77, 148, 253].contains(&id);
            assert_eq!(Unsigned::default().takes(id, heard), open || (idle && !heard), "{id}");
        }
        for id in [position, obstacles, command, parameter, timesync, unknown, 30, 31, 84, 256, 331] {
            assert!(!Unsigned::default().takes(id, heard), "{id}");
        }
    }
    assert_eq!(Unsigned::default(), Unsigned::UntilFirstSigned);
}

const US: (u8, u8) = (1, 191);

fn setup(first: u8) -> SETUP_SIGNING_DATA {
    SETUP_SIGNING_DATA {
        target_system: 1,
        target_component: 191,
        secret_key: *key(first).secret(),
        initial_timestamp: NEW_YEAR,
    }
}

#[test]
fn a_key_is_taken_only_while_provisioning_and_only_for_us() {
    let judge = |message: &SETUP_SIGNING_DATA, provisioning| set_up(START, message, US, provisioning, 3, None);
    assert!(matches!(judge(&setup(5), false), Setup::Refused));
    let Setup::On(mut new) = judge(&setup(5), true) else { panic!() };
    assert_eq!(new.key(), &key(5));
    assert_eq!(new.timestamp_to_store(START), Some(NEW_YEAR + MINUTE), "due at once");
    let frame = signed(&mut new, START, 191);
    assert_eq!((stamp(&frame), frame[frame.len() - 13]), (NEW_YEAR + 1, 3));

    assert!(matches!(judge(&SETUP_SIGNING_DATA { target_component: 0, ..setup(5) }, true), Setup::On(_)));
    for (target_system, target_component) in [(1, 1), (2, 191), (0, 191), (0, 0), (255, 0)] {
        let other = SETUP_SIGNING_DATA { target_system, target_component, ..setup(5) };
        assert!(matches!(judge(&other, true), Setup::NotOurs));
    }
    let late = SETUP_SIGNING_DATA { initial_timestamp: TIMESTAMP_MAX + 1, ..setup(5) };
    assert!(matches!(judge(&late, true), Setup::Refused));
    let none = SETUP_SIGNING_DATA { secret_key: [0; 32], initial_timestamp: 0, ..setup(5) };
    assert!(matches!(judge(&none, true), Setup::Off));
    assert!(matches!(judge(&none, false), Setup::Refused));
}

#[test]
fn the_same_key_again_opens_no_door_and_another_key_keeps_the_clock() {
    let mut signing = signing();
    let frame = signed(&mut peer(0, NEW_YEAR + MINUTE), START, 1);
    assert_eq!(signing.check(START, &frame), Verdict::Valid);
    let used = stamp(&signed(&mut signing, START, 191));
    let Setup::On(mut again) = set_up(START, &setup(0), US, true, 4, Some(&signing)) else { panic!() };
    assert_eq!(again.check(START, &frame), Verdict::Replayed);
    let next = signed(&mut again, START, 191);
    assert!(stamp(&next) > used);
    assert_eq!(next[next.len() - 13], 4);

    let now = Instant(60_000_000);
    let Setup::On(other) = set_up(now, &setup(9), US, true, 4, Some(&signing)) else { panic!() };
    assert_eq!(time(&other, now), NEW_YEAR + 2 * MINUTE);
}

#[test]
fn a_key_is_never_shown() {
    let text = format!("{:?} {:#?}", signing(), key(0));
    assert!(text.contains("Key(..)"), "{text}");
    for shown in ["[0, 1, 2", "0001", "0x1", "30, 31"] {
        assert!(!text.contains(shown), "{text}");
    }
    assert!(is_secret(256) && !is_secret(0) && !is_secret(255) && !is_secret(257));
    assert!(Key::new([0; 32]).is_none());
    let last = std::array::from_fn(|index| u8::from(index == 31));
    assert_eq!(Key::new(last).unwrap().secret(), &last);
}

#[test]
fn the_state_is_small_and_can_be_made_while_compiling() {
    static SIGNING: Option<Signing> = match Key::new([7; 32]) {
        Some(key) => Some(Signing::new(key, 1)),
        None => None,
    };
    assert!(SIGNING.is_some());
    assert!(size_of::<Signing>() <= 136, "{}", size_of::<Signing>());
}
