//! Damaged and hostile streams. Everything random is seeded.

use crate::bench::{ARDUPILOT, ARMED, AUTOPILOT, Bench, GUIDED, heartbeat, output, read, velocity};
use foxhound_core::base::time::Instant;
use foxhound_link::Message;
use foxhound_link::companion::Config;
use foxhound_link::dialect::*;
use foxhound_link::framer::{FRAME_MAX, Framer, Header, encode};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

fn random(seed: u64) -> Xoshiro128PlusPlus {
    Xoshiro128PlusPlus::seed_from_u64(seed)
}

fn below(random: &mut Xoshiro128PlusPlus, limit: u32) -> u32 {
    random.next_u32() % limit
}

/// The `index`-th frame of a stream: a heartbeat, a position or a field of obstacles.
fn frame(random: &mut Xoshiro128PlusPlus, index: u32) -> Vec<u8> {
    let message = match index % 3 {
        0 => MavMessage::HEARTBEAT(HEARTBEAT_DATA { custom_mode: index, ..HEARTBEAT_DATA::DEFAULT }),
        1 => MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            time_boot_ms: index,
            x: random.next_u32() as f32,
            vz: -1.0,
            ..LOCAL_POSITION_NED_DATA::DEFAULT
        }),
        _ => {
            let mut obstacles =
                OBSTACLE_DISTANCE_DATA { time_usec: u64::from(index), ..OBSTACLE_DISTANCE_DATA::DEFAULT };
            obstacles.distances = std::array::from_fn(|_| random.next_u32() as u16);
            MavMessage::OBSTACLE_DISTANCE(obstacles)
        }
    };
    let header = Header { system_id: 1, component_id: 1, sequence: index as u8 };
    let mut bytes = [0; FRAME_MAX];
    let length = encode(header, &message, &mut bytes);
    bytes[..length].to_vec()
}

/// The frames of our dialect.
fn ours(stream: &[u8], chunk: usize) -> (Vec<Vec<u8>>, Framer) {
    let mut frames = Vec::new();
    let framer = read(stream, chunk, |frame| frames.extend(frame.message().map(|_| frame.bytes.to_vec())));
    (frames, framer)
}

#[test]
fn noise_between_frames_loses_none_even_when_full_of_start_bytes() {
    for start_bytes in [false, true] {
        let mut random = random(1);
        let (mut stream, mut sent) = (Vec::new(), Vec::new());
        for index in 0..20_000 {
            for _ in 0..below(&mut random, 65) {
                let start = start_bytes && below(&mut random, 8) == 0;
                stream.push(if start { 0xFD } else { random.next_u32() as u8 });
            }
            sent.push(frame(&mut random, index));
            stream.extend_from_slice(sent.last().unwrap());
        }
        // The last candidates in the noise may still wait for bytes.
        stream.extend_from_slice(&[0; FRAME_MAX]);
        for chunk in [1, 17, 4096] {
            let (found, framer) = ours(&stream, chunk);
            assert!(found == sent, "{} of {} in pieces of {chunk}", found.len(), sent.len());
            assert_eq!(framer.counters().lost, 0);
        }
    }
}

#[test]
fn a_flipped_bit_costs_its_frame_and_no_other() {
    let mut random = random(2);
    let mut seen_bad = 0;
    for index in 0..3 {
        let good = frame(&mut random, index);
        for bit in 0..good.len() * 8 {
            let mut damaged = good.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            let mut stream = damaged;
            // A longer length must not run out of bytes.
            (0..8).for_each(|_| stream.extend_from_slice(&good));
            stream.extend_from_slice(&[0; FRAME_MAX]);
            let (found, framer) = ours(&stream, 64);
            assert_eq!(found, vec![good.clone(); 8], "message {index}, bit {bit}");
            seen_bad += framer.counters().bad_crc;
        }
    }
    assert!(seen_bad > 1000, "{seen_bad}");
}

#[test]
fn a_missing_byte_costs_at_most_its_frame() {
    let mut random = random(3);
    let (mut stream, mut intact) = (Vec::new(), Vec::new());
    for index in 0..5_000 {
        let mut bytes = frame(&mut random, index);
        if below(&mut random, 10) == 0 {
            bytes.remove(below(&mut random, bytes.len() as u32) as usize);
        } else {
            intact.push(bytes.clone());
        }
        stream.extend_from_slice(&bytes);
    }
    stream.extend_from_slice(&[0; FRAME_MAX]);
    let (found, _) = ours(&stream, 4096);
    assert!(found == intact, "{} of {}", found.len(), intact.len());
}

/// Of 50 MB of random bytes 195 000 are an 0xFD. Behind one of these stand right flags and a published id with a chance of
/// 1.8e-7, and then a right checksum with one of 2^-16: 5e-7 frames are to be expected in all of it, and about as many
/// where every sixteenth byte is an 0xFD.
#[test]
fn pure_noise_holds_no_frame() {
    for start_bytes in [false, true] {
        let mut random = random(4);
        let mut framer = Framer::new();
        let mut noise = vec![0; 4000];
        for _ in 0..if start_bytes { 2_500 } else { 12_500 } {
            for word in noise.chunks_mut(8) {
                word.copy_from_slice(&random.next_u64().to_le_bytes());
                if start_bytes && random.next_u32().is_multiple_of(2) {
                    word[random.next_u32() as usize % 8] = 0xFD;
                }
            }
            let mut rest = &noise[..];
            while !rest.is_empty() {
                rest = &rest[framer.push(rest)..];
                assert!(framer.next_frame().is_none());
            }
        }
        let (seen, pushed) = (framer.counters(), if start_bytes { 10_000_000 } else { 50_000_000 });
        assert_eq!(seen.skipped_bytes as usize + framer.waiting(), pushed);
        assert_eq!((seen.frames, seen.unknown), (0, 0));
    }
}

/// Valid frames of random ids and contents between random bytes, and a guidance that publishes anything at all.
#[test]
fn whatever_arrives_or_is_published_only_sane_setpoints_and_requests_leave() {
    let mut random = random(5);
    let float = |random: &mut Xoshiro128PlusPlus| match below(random, 4) {
        0 => f32::from_bits(random.next_u32()),
        1 => f32::NAN,
        2 => f32::INFINITY,
        _ => below(random, 100) as f32 * 0.1 - 5.0,
    };
    let mut setpoints = 0;
    for run in 0..40 {
        let mut bench = Bench::new(Config::default());
        if run % 2 == 0 {
            bench.say(&MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED)));
        }
        for _ in 0..2_000 {
            bench.now_us += u64::from(below(&mut random, 20_000));
            match below(&mut random, 8) {
                0 => {
                    let noise: Vec<u8> = (0..below(&mut random, 400)).map(|_| random.next_u32() as u8).collect();
                    bench.companion.receive(bench.now(), &noise);
                }
                1 => {
                    let mut any = output([0.0; 3], float(&mut random));
                    any.setpoint.velocity_ned_mps.north = float(&mut random);
                    any.setpoint.velocity_ned_mps.east = float(&mut random);
                    any.setpoint.velocity_ned_mps.down = float(&mut random);
                    any.source_bearing_ned_rad = Some(float(&mut random));
                    bench.companion.publish(bench.now(), &any);
                }
                _ => {
                    let ids = MavMessage::all_ids();
                    let id = ids[below(&mut random, ids.len() as u32) as usize];
                    let payload: Vec<u8> = (0..255).map(|_| random.next_u32() as u8).collect();
                    let message = MavMessage::parse(mavlink_core::MavlinkVersion::V2, id, &payload).unwrap();
                    let from = if below(&mut random, 4) == 0 { (random.next_u32() as u8, 1) } else { AUTOPILOT };
                    match message {
                        // A heartbeat that keeps control, so that setpoints flow.
                        MavMessage::HEARTBEAT(_) if below(&mut random, 4) != 0 => {
                            bench.say_as(from, &MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED)));
                        }
                        message => bench.say_as(from, &message),
                    }
                }
            }
            bench.companion.poll(bench.now());
            bench.drain();
            if let Some(ownship) = bench.companion.ownship() {
                assert!(ownship.is_finite());
            }
            let (scan, points) = bench.take_obstacles();
            if let Some(scan) = scan {
                assert!(scan.step_rad.is_finite() && scan.step_rad != 0.0 && scan.first_azimuth_rad.is_finite());
            }
            if let Some(points) = points {
                assert!(points.points_m.iter().all(|point| point.is_finite()));
            }
            for sent in bench.take_sent() {
                match sent.message {
                    MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint) => {
                        setpoints += 1;
                        let [north, east, down, yaw_rate] = velocity(&setpoint);
                        assert!((north * north + east * east + down * down).sqrt() <= 20.001);
                        assert!(yaw_rate.abs() <= 4.0);
                        assert_eq!((setpoint.type_mask, setpoint.coordinate_frame), (0x05C7, 1));
                    }
                    MavMessage::COMMAND_LONG(command) => assert_eq!(command.command, 511),
                    MavMessage::NAMED_VALUE_FLOAT(value) => assert!(value.value.is_finite()),
                    _ => {}
                }
            }
        }
    }
    // Random health, commands and landings hold or silence the rest.
    assert!(setpoints > 300, "{setpoints}");
}

#[test]
fn time_may_jump_anywhere() {
    let mut random = random(6);
    let mut bench = Bench::flying();
    for _ in 0..10_000 {
        let at = match below(&mut random, 4) {
            0 => random.next_u64(),
            1 => 0,
            2 => u64::MAX,
            _ => u64::from(random.next_u32()),
        };
        bench.now_us = at;
        let data = heartbeat(ARDUPILOT, GUIDED, ARMED);
        bench.say(&MavMessage::HEARTBEAT(data));
        bench.companion.publish(Instant(at), &output([1.0, 0.0, 0.0], 0.0));
        bench.companion.poll(Instant(at));
        bench.drain();
    }
}
