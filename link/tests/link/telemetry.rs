//! What is told about the search, and in which order everything leaves.

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::Bearing;
use foxhound_core::guidance::Output;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::localize::source::support::SourcePosition;
use foxhound_link::companion::{Config, Pace};
use foxhound_link::dialect::*;

use crate::bench::*;

#[test]
fn named_values_are_told_every_0_6_s_each_and_a_direction_with_them() {
    let mut bench = Bench::flying();
    bench.answers = true;
    bench.companion.note_pace(Pace { longest_us: 1_500, late: 3, lost: 4, lidar_bad: Some(5), radio_bad: None });
    bench.run(0.1);
    bench.take_sent();
    let told = bench.output.as_mut().unwrap();
    told.bearing = Some(bearing());
    told.source_bearing_ned_rad = Some(-1.0);
    told.source = Some(SourcePosition { place_ned_m: Horizontal { north: 4.0, east: 6.0 }, sigma_m: 1.0 });
    told.source_share_and_nis = Some((0.75, 1.25));
    told.outcome = Outcome::GuardBrake;
    // An autopilot that booted 5 s before us and answers after 10 ms.
    let (mut values, mut directions): (Vec<(String, f32)>, Vec<[f32; 3]>) = (Vec::new(), Vec::new());
    for _ in 0..1000 {
        let time_boot_ms = (bench.now_us / 1000) as u32;
        bench.say(&position(time_boot_ms));
        bench.say(&attitude(time_boot_ms, 0.0));
        bench.step(10_000);
        for sent in bench.take_sent() {
            match sent.message {
                MavMessage::NAMED_VALUE_FLOAT(value) => {
                    assert_eq!(u64::from(value.time_boot_ms), sent.at_us / 1000);
                    values.push((value.name.to_str().unwrap().to_owned(), value.value));
                }
                MavMessage::DEBUG_VECT(vector) => {
                    assert_eq!(vector.name.to_str().unwrap(), "FH_DIR");
                    directions.push([vector.x, vector.y, vector.z]);
                }
                MavMessage::TIMESYNC(request) if request.tc1 == 0 => {
                    bench.now_us += 10_000;
                    let tc1 = (bench.now_us as i64 + 5_000_000) * 1000;
                    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1, ts1: request.ts1, ..TIMESYNC_DATA::DEFAULT }));
                }
                _ => {}
            }
        }
    }
    let expected = [
        ("FH_BRG", 360.0 - 1.0_f32.to_degrees()),
        ("FH_SNR", 14.5),
        ("FH_SIG", 0.1_f32.to_degrees()),
        ("FH_ST", 9.0),
        ("FH_ELV", 0.2_f32.to_degrees()),
        ("FH_RNG", 5.0),
        ("FH_CNF", 0.75),
        ("FH_NIS", 1.25),
        ("FH_RTT", 10.0),
        ("FH_CRC", 0.0),
        ("FH_STP", 1.5),
        ("FH_LATE", 3.0),
        ("FH_LOST", 4.0),
        ("FH_LDR", 5.0),
    ];
    for (name, expected) in expected {
        let of_it: Vec<f32> = values.iter().filter(|(other, _)| other == name).map(|(_, value)| *value).collect();
        assert!((15..=17).contains(&of_it.len()), "{name}: {}", of_it.len());
        assert!(of_it.iter().all(|value| (value - expected).abs() < 1e-3), "{name}: {of_it:?}");
    }
    // North by west, and down by the elevation.
    let [north, east, down] = *directions.last().unwrap();
    assert!((16..=18).contains(&directions.len()));
    let (level, below) = (0.2_f32.cos(), 0.2_f32.sin());
    assert!((north - 1.0_f32.cos() * level).abs() < 1e-3 && (east + 1.0_f32.sin() * level).abs() < 1e-3);
    assert!((down - below).abs() < 1e-3);
}

#[test]
fn lines_of_a_radio_that_cannot_be_read_are_told_in_place_of_the_elevation() {
    let mut bench = Bench::flying();
    bench.companion.note_pace(Pace { longest_us: 0, late: 0, lost: 0, lidar_bad: None, radio_bad: Some(7) });
    bench.take_sent();
    bench.output.as_mut().unwrap().bearing = Some(bearing());
    bench.run(2.0);
    let values = bench.take_sent().into_iter().filter_map(|sent| match sent.message {
        MavMessage::NAMED_VALUE_FLOAT(value) => Some((value.name.to_str().unwrap().to_owned(), value.value)),
        _ => None,
    });
    let values: Vec<(String, f32)> = values.collect();
    assert!(values.contains(&("FH_RAD".to_owned(), 7.0)), "{values:?}");
    assert!(!values.iter().any(|(name, _)| name == "FH_ELV"), "{values:?}");
}

#[test]
fn the_landing_target_is_told_while_the_source_is_known_in_the_form_of_the_autopilot() {
    for (autopilot, frame) in [(ARDUPILOT, 12), (PX4, 1)] {
        let mut bench = Bench::new(Config { landing_target: true, ..Config::default() });
        bench.heartbeat = Some(heartbeat(autopilot, if autopilot == PX4 { OFFBOARD } else { GUIDED }, ARMED));
        bench.output = Some(output([0.0; 3], 0.0));
        let fly = |bench: &mut Bench| {
            bench.take_sent();
            for _ in 0..100 {
                let time_boot_ms = (bench.now_us / 1000) as u32;
                bench.say(&position(time_boot_ms));
                bench.say(&attitude(time_boot_ms, 0.0));
                bench.step(10_000);
            }
            let pick = |sent: Sent| match sent.message {
                MavMessage::LANDING_TARGET(target) => Some(target),
                _ => None,
            };
            bench.take_sent().into_iter().filter_map(pick).collect::<Vec<_>>()
        };
        assert_eq!(fly(&mut bench).len(), 0, "nothing is heard");
        let told = bench.output.as_mut().unwrap();
        told.bearing = Some(bearing());
        told.source = Some(SourcePosition { place_ned_m: Horizontal { north: 5.0, east: 2.0 }, sigma_m: 1.0 });
        let targets = fly(&mut bench);
        assert!((9..=11).contains(&targets.len()), "{}", targets.len());
        let target = targets.last().unwrap();
        assert_eq!((target.frame, target.position_valid), (frame, 1));
        // 4 m ahead and as far below as the elevation of 0.2 says.
        let below = 4.0 * 0.2_f32.tan();
        let expected = if autopilot == PX4 { [5.0, 2.0, -3.0 + below] } else { [4.0, 0.0, below] };
        for (value, expected) in [target.x, target.y, target.z].iter().zip(expected) {
            assert!((value - expected).abs() < 1e-3, "{target:?}");
        }
        bench.output.as_mut().unwrap().source.as_mut().unwrap().sigma_m = 3.0;
        assert!(fly(&mut bench).len() <= 1, "too vague");
    }
}

#[test]
fn what_is_remembered_of_the_obstacles_is_told_where_asked_for() {
    let circle = Circle {
        center_ned_m: Horizontal { north: 4.0, east: 2.0 },
        radius_m: 1.0,
        velocity_ned_mps: Horizontal::default(),
    };
    for surroundings in [true, false] {
        let mut bench = Bench::new(Config { surroundings, ..Config::default() });
        bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
        let mut told = Vec::new();
        for _ in 0..100 {
            let time_boot_ms = (bench.now_us / 1000) as u32;
            bench.say(&position(time_boot_ms));
            bench.say(&attitude(time_boot_ms, 0.0));
            if bench.companion.wants_surroundings(bench.now()) {
                bench.companion.publish_surroundings(bench.now(), [circle].into_iter());
            }
            bench.step(10_000);
            told.extend(bench.take_sent().into_iter().filter_map(|sent| match sent.message {
                MavMessage::OBSTACLE_DISTANCE(obstacles) => Some(obstacles.distances[0]),
                _ => None,
            }));
        }
        if surroundings {
            assert!((4..=6).contains(&told.len()) && told.iter().all(|cm| *cm == 200), "{told:?}");
        } else {
            assert!(told.is_empty());
        }
    }
}

#[test]
fn what_is_not_known_is_not_told() {
    let mut bench = Bench::flying();
    bench.output.as_mut().unwrap().bearing = Some(Bearing { valid: false, ..bearing() });
    bench.run(2.0);
    for sent in bench.take_sent() {
        if let MavMessage::NAMED_VALUE_FLOAT(value) = sent.message {
            assert!(["FH_ST", "FH_CRC"].contains(&value.name.to_str().unwrap()), "{:?}", value.name);
        }
    }
}

#[test]
fn a_change_of_the_outcome_is_told_once_and_at_most_one_a_second() {
    let mut bench = Bench::flying();
    bench.run(3.0);
    let told = texts(&mut bench);
    assert_eq!(told.len(), 1, "{told:?}");
    assert_eq!(told[0].1, "Foxhound: seeking");
    // Flapping at 50 Hz.
    for step in 0..500 {
        bench.output.as_mut().unwrap().outcome = if step % 2 == 0 { Outcome::NoSignal } else { Outcome::NoPath };
        bench.step(20_000);
    }
    let told = texts(&mut bench);
    assert!((9..=11).contains(&told.len()), "{}", told.len());
    assert!(told.windows(2).all(|pair| pair[1].0 - pair[0].0 >= 1_000_000));
    // The last state is told even if its edge came too soon.
    bench.output.as_mut().unwrap().outcome = Outcome::Fault;
    bench.run(2.0);
    assert_eq!(texts(&mut bench).last().unwrap().1, "Foxhound: internal fault");
}

#[test]
fn an_entry_tells_neither_the_wait_for_the_first_plan_nor_a_silence_that_was_none() {
    let mut bench = Bench::new(Config::default());
    bench.answers = true;
    let output = |outcome| Some(Output { outcome, ..output([0.0; 3], 0.0) });
    bench.output = output(Outcome::LinkLost);
    bench.run(2.0);
    assert!(texts(&mut bench).is_empty(), "nobody is there yet, and nobody was");
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, ARMED));
    bench.run(3.0);
    assert_eq!(texts(&mut bench).pop().unwrap().1, "Foxhound: waits for GUIDED or OFFBOARD, armed");
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    bench.next_heartbeat_us = bench.now_us;
    for outcome in [Outcome::NotInControl, Outcome::LinkLost, Outcome::PlanLate] {
        bench.output = output(outcome);
        bench.run(0.12);
    }
    bench.output = output(Outcome::Nominal);
    bench.run(3.0);
    let told: Vec<String> = texts(&mut bench).into_iter().map(|(_, text)| text).collect();
    assert_eq!(told, ["Foxhound: seeking"]);
    // What lasts is told.
    bench.output = output(Outcome::PlanLate);
    bench.run(2.0);
    assert_eq!(texts(&mut bench).pop().unwrap().1, "Foxhound: plan is late");
}

#[test]
fn a_pause_from_aboard_is_left_to_who_asks_for_it_and_one_from_the_ground_is_told() {
    for (from, expected) in [((1, 192), None), ((255, 190), Some("Foxhound: paused"))] {
        let mut bench = Bench::flying();
        bench.answers = true;
        bench.run(3.0);
        bench.take_sent();
        let pause =
            COMMAND_LONG_DATA { target_system: 1, target_component: 191, command: 193, ..COMMAND_LONG_DATA::DEFAULT };
        bench.say_as(from, &MavMessage::COMMAND_LONG(pause));
        bench.run(3.0);
        assert_eq!(texts(&mut bench).pop().map(|(_, text)| text).as_deref(), expected, "{from:?}");
    }
}

#[test]
fn the_setpoint_leaves_first_and_telemetry_is_dropped_first() {
    let mut bench = Bench::flying();
    bench.companion.note_pace(Pace::default());
    bench.answers = true;
    bench.run(1.0);
    bench.take_sent();
    // Nobody fetches bytes for 1.4 s.
    for step in 1..=140 {
        let now = Instant(11_000_000 + step * 10_000);
        let bearing = Some(bearing());
        bench.companion.publish(now, &Output { bearing, ..output([step as f32 * 0.01, 0.0, 0.0], 0.0) });
        bench.companion.poll(now);
    }
    bench.now_us += 1_400_000;
    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 1, ..TIMESYNC_DATA::DEFAULT }));
    bench.drain();
    let sent = bench.take_sent();
    let kind = |sent: &Sent| match sent.message {
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) => 0,
        MavMessage::HEARTBEAT(_) => 1,
        MavMessage::COMMAND_LONG(_) | MavMessage::COMMAND_ACK(_) | MavMessage::TIMESYNC(_) => 2,
        MavMessage::NAMED_VALUE_FLOAT(_) | MavMessage::STATUSTEXT(_) => 3,
        _ => panic!(),
    };
    let kinds: Vec<u8> = sent.iter().map(kind).collect();
    assert!(kinds.is_sorted(), "{kinds:?}");
    assert_eq!(kinds.iter().filter(|kind| **kind == 0).count(), 1);
    let MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint) = &sent[0].message else { panic!() };
    assert_eq!(setpoint.vx, 1.4, "the newest one");
    assert!(kinds.contains(&1) && kinds.contains(&2) && kinds.contains(&3));
    let values = sent.iter().filter_map(|sent| match &sent.message {
        MavMessage::NAMED_VALUE_FLOAT(value) => Some(value.time_boot_ms),
        _ => None,
    });
    assert!(values.max().unwrap() >= 12_150, "the oldest telemetry is dropped, not the newest");
    let counters = bench.companion.counters();
    assert!(counters.telemetry_dropped > 0);
    assert_eq!(counters.errands_dropped, 0);
}

#[test]
fn the_bytes_are_the_same_whatever_the_size_of_the_sink() {
    let bytes = |size: usize| {
        let mut bench = Bench::flying();
        bench.now_us = 10_050_000;
        bench.say(&MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED)));
        bench.companion.publish(bench.now(), &output([1.0, 0.0, 0.0], 0.0));
        bench.companion.poll(bench.now());
        let mut all = Vec::new();
        let mut sink = vec![0; size];
        loop {
            let length = bench.companion.transmit(&mut sink);
            if length == 0 {
                return all;
            }
            all.extend_from_slice(&sink[..length]);
        }
    };
    let reference = bytes(4096);
    assert!(reference.len() > 200);
    for size in [1, 3, 64, 65, 280] {
        assert_eq!(bytes(size), reference, "sink of {size}");
    }
    assert_eq!(Config::default().build().unwrap().transmit(&mut []), 0);
}

#[test]
fn our_own_echo_is_not_taken_for_somebody_else() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.take_sent();
    let command =
        COMMAND_LONG_DATA { target_system: 1, target_component: 191, command: 400, ..COMMAND_LONG_DATA::DEFAULT };
    bench.say_as((1, 191), &MavMessage::COMMAND_LONG(command));
    bench.say_as((1, 191), &MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 8, ..TIMESYNC_DATA::DEFAULT }));
    bench.drain();
    assert_eq!(bench.take_sent().len(), 0);
}
