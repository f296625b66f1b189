//! A recorded flight of a real autopilot program, ArduCopter V4.7.0-dev in software-in-the-loop simulation: boot, EKF
//! settling, GUIDED, arming, take-off to 5 m, velocity legs, silence, landing, disarming. `arducopter-guided.tlog`
//! holds 17,127 frames as they arrived on one link, each behind its time: 8 bytes of big-endian microseconds. The
//! counts and times below were read from it with pymavlink.

use std::collections::BTreeMap;

use crate::bench::{Bench, output, read};
use foxhound_core::base::ownship::Agreement;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::guidance::mission::Control;
use foxhound_link::companion::{Config, Software};
use foxhound_link::dialect::*;
use foxhound_link::failsafe::Cause;
use foxhound_link::framer::Framer;

const LOG: &[u8] = include_bytes!("../data/arducopter-guided.tlog");

/// Frames by message id, the known and the unknown ones.
const COUNTS: [(u32, u32); 21] = [
    (0, 179),
    (1, 174),
    (2, 173),
    (22, 15),
    (24, 347),
    (30, 4350),
    (31, 4348),
    (32, 3472),
    (33, 869),
    (49, 162),
    (65, 869),
    (74, 347),
    (77, 46),
    (85, 509),
    (111, 38),
    (147, 173),
    (148, 173),
    (193, 347),
    (242, 162),
    (245, 347),
    (253, 27),
];

/// Microseconds since the first frame, and the frame.
fn records() -> Vec<(u64, &'static [u8])> {
    let mut records = Vec::new();
    let mut rest = LOG;
    while rest.len() > 8 {
        let stamp = u64::from_be_bytes(rest[..8].try_into().unwrap());
        let length = 12 + usize::from(rest[9]);
        records.push((stamp, &rest[8..8 + length]));
        rest = &rest[8 + length..];
    }
    assert!(rest.is_empty());
    let start = records[0].0;
    records.iter().map(|&(stamp, frame)| (stamp - start, frame)).collect()
}

/// How many frames of each id are found, and by what.
fn read_in_chunks(stream: &[u8], chunk: usize) -> (BTreeMap<u32, u32>, Framer) {
    let mut counts = BTreeMap::new();
    let framer = read(stream, chunk, |frame| {
        assert_eq!(frame.message().is_some(), MavMessage::all_ids().contains(&frame.message_id));
        *counts.entry(frame.message_id).or_default() += 1;
    });
    (counts, framer)
}

#[test]
fn every_frame_of_the_flight_is_found_whatever_the_pieces() {
    let stream: Vec<u8> = records().iter().flat_map(|(_, frame)| frame.iter().copied()).collect();
    let known: u32 = COUNTS.iter().filter(|(id, _)| MavMessage::all_ids().contains(id)).map(|(_, count)| count).sum();
    for chunk in [1, 7, 280, 4096] {
        let (counts, framer) = read_in_chunks(&stream, chunk);
        let seen = framer.counters();
        assert_eq!(counts, BTreeMap::from(COUNTS), "pieces of {chunk}");
        assert_eq!((seen.bad_crc, seen.skipped_bytes), (0, 0), "pieces of {chunk}");
        assert_eq!((seen.frames, seen.unknown), (known, 17_127 - known), "pieces of {chunk}");
    }
}

#[test]
fn time_stamps_between_the_frames_are_skipped_without_losing_one() {
    for chunk in [1, 7, 280, 4096] {
        let (counts, framer) = read_in_chunks(LOG, chunk);
        assert_eq!(counts, BTreeMap::from(COUNTS), "pieces of {chunk}");
        assert_eq!(framer.counters().skipped_bytes, 8 * 17_127, "pieces of {chunk}");
    }
}

#[test]
fn the_senders_of_the_flight_are_told_apart_and_what_is_missing_is_counted() {
    let frames: Vec<&[u8]> = records().into_iter().map(|(_, frame)| frame).collect();
    let lost = |left_out: usize| {
        let stream: Vec<u8> = frames
            .iter()
            .enumerate()
            .filter(|(index, _)| left_out == 0 || index % left_out != 1)
            .flat_map(|(_, frame)| frame.iter().copied())
            .collect();
        let (_, framer) = read_in_chunks(&stream, 4096);
        framer.counters().lost
    };
    // The companion that flew sent two frames that the log does not hold.
    assert_eq!(lost(0), 2);
    // Of the autopilot's frames 1 712, and one more of the companion's.
    assert_eq!(lost(10), 1_715);
}

#[test]
fn a_real_flight_is_told_without_a_gap_or_a_jump_while_we_are_in_control() {
    let mut bench = Bench::new(Config::default());
    bench.output = Some(output([1.0, 0.0, 0.0], 0.0));
    let (mut told, mut jumps) = (0, Vec::new());
    for (at_us, frame) in records() {
        bench.now_us = at_us;
        bench.companion.receive(Instant(at_us), frame);
        bench.companion.publish(bench.now(), bench.output.as_ref().unwrap());
        bench.companion.poll(bench.now());
        if bench.companion.counters().jumps as usize > jumps.len() {
            jumps.push(at_us);
        }
        if bench.companion.control(bench.now()) == Control::Granted {
            assert!(bench.companion.ownship().is_some(), "{at_us}");
            assert_eq!(bench.companion.cause(bench.now()), Cause::None);
            told += 1;
        }
    }
    assert!(told > 4_500, "{told}");
    // Only while the filter was settling, before take-off.
    assert!(jumps.iter().all(|at_us| *at_us < 13_700_000), "{jumps:?}");
    assert_eq!((bench.companion.counters().reboots, bench.companion.counters().rejected), (0, 0));
}

#[test]
fn the_velocity_of_a_real_autopilot_agrees_with_its_positions() {
    let mut bench = Bench::new(Config::default());
    let (mut agreement, mut last, mut samples) = (Agreement::default(), None, 0);
    for (at_us, frame) in records() {
        bench.now_us = at_us;
        bench.companion.receive(Instant(at_us), frame);
        bench.companion.poll(bench.now());
        let Some(ownship) = bench.companion.ownship() else { continue };
        agreement.follow(last.as_ref(), &ownship);
        last = Some(ownship);
        if bench.companion.landed() == Some(true) {
            // The filter settles.
            agreement.release();
        } else {
            samples += 1;
        }
        assert_eq!(agreement.found(), None, "{at_us}");
    }
    assert!(samples > 4_000, "{samples}");
}

#[test]
fn control_follows_the_mode_and_the_motors_through_the_flight() {
    let mut bench = Bench::new(Config::default());
    let mut control = bench.companion.control(bench.now());
    assert_eq!(control, Control::LinkLost);
    let mut edges = Vec::new();
    let mut landed = Vec::new();
    for (at_us, frame) in records() {
        bench.now_us = at_us;
        bench.companion.receive(Instant(at_us), frame);
        if bench.companion.control(bench.now()) != control {
            control = bench.companion.control(bench.now());
            edges.push((at_us, control));
        }
        if landed.last().map(|&(_, last)| last) != Some(bench.companion.landed()) {
            landed.push((at_us, bench.companion.landed()));
        }
    }
    // Armed in GUIDED since 13.7 s, but on the ground and in the take-off until 21.0.
    assert_eq!(
        edges,
        [(0, Control::NotInControl), (20_976_836, Control::Granted), (63_584_484, Control::NotInControl)]
    );
    let ground = [(0, None), (2_506_440, Some(true)), (16_475_740, Some(false)), (79_985_352, Some(true))];
    assert_eq!(landed, ground);
    let autopilot = bench.companion.autopilot().unwrap();
    assert_eq!((autopilot.system_id, autopilot.component_id, autopilot.software), (1, 1, Software::ArduPilot));
    let counters = bench.companion.counters();
    assert_eq!((counters.rejected, counters.reboots, counters.foreign_heartbeats), (0, 0, 0));
}

#[test]
fn ownship_follows_the_flight() {
    let mut bench = Bench::new(Config::default());
    let mut highest_m = 0.0_f32;
    let mut fastest_mps = 0.0_f32;
    let mut attitude = None;
    let mut compared = 0;
    for (at_us, bytes) in records() {
        bench.companion.receive(Instant(at_us), bytes);
        let Some(ownship) = bench.companion.ownship() else { continue };
        assert!(ownship.is_finite());
        highest_m = highest_m.max(-ownship.position_ned_m.down);
        fastest_mps = fastest_mps.max(ownship.velocity_ned_mps.horizontal().norm());
        // The autopilot sends its attitude in two forms; of the same instant they must agree.
        let mut framer = Framer::new();
        framer.push(bytes);
        match framer.next_frame().unwrap().message() {
            Some(MavMessage::ATTITUDE(message)) => attitude = Some((message.time_boot_ms, ownship)),
            Some(MavMessage::ATTITUDE_QUATERNION(message)) => {
                if let Some((time_boot_ms, other)) = attitude
                    && time_boot_ms == message.time_boot_ms
                {
                    compared += 1;
                    assert!((ownship.roll_rad - other.roll_rad).abs() < 1e-4);
                    assert!((ownship.pitch_rad - other.pitch_rad).abs() < 1e-4);
                    assert!(wrap_pi(ownship.yaw_rad - other.yaw_rad).abs() < 1e-4);
                    assert!((ownship.yaw_rate_radps - other.yaw_rate_radps).abs() < 1e-4);
                }
            }
            _ => {}
        }
    }
    assert!(compared > 3000, "{compared}");
    assert!((6.9..7.2).contains(&highest_m), "{highest_m}");
    assert!((2.0..2.2).contains(&fastest_mps), "{fastest_mps}");
}

#[test]
fn the_autopilots_clock_requests_are_answered_and_ours_are_not() {
    let mut bench = Bench::new(Config::default());
    for (at_us, frame) in records() {
        bench.now_us = at_us;
        bench.companion.receive(Instant(at_us), frame);
        bench.drain();
    }
    let answers = bench.take_sent().iter().filter(|sent| matches!(sent.message, MavMessage::TIMESYNC(_))).count();
    // Of the log's 38, 18 are requests of the autopilot; the others are a companion's requests and their answers.
    assert_eq!(answers, 18);
}
