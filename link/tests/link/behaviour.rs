//! The rules of the companion, one by one. A test plays the autopilot.

use crate::bench::*;
use foxhound_core::bearing::{Bearing, Flags, Quality};
use foxhound_core::error::Why;
use foxhound_core::guidance::Output;
use foxhound_core::mission::{Control, Outcome};
use foxhound_core::scan::{Frame, Sector};
use foxhound_core::time::Instant;
use foxhound_link::companion::{Config, ObstacleFrame, Software};
use foxhound_link::dialect::*;

const ZERO: [f32; 4] = [0.0; 4];

fn position(time_boot_ms: u32) -> MavMessage {
    MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
        time_boot_ms,
        x: 1.0,
        y: 2.0,
        z: -3.0,
        vx: 0.1,
        vy: 0.2,
        vz: 0.3,
    })
}

fn attitude(time_boot_ms: u32, yaw: f32) -> MavMessage {
    MavMessage::ATTITUDE(ATTITUDE_DATA { time_boot_ms, yaw, ..ATTITUDE_DATA::DEFAULT })
}

fn extended(landed_state: u8) -> MavMessage {
    MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA { vtol_state: 0, landed_state })
}

fn ack(command: u16, result: u8) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command, result, ..COMMAND_ACK_DATA::DEFAULT })
}

// ---- heartbeat and latching ----

#[test]
fn a_heartbeat_leaves_every_second_from_the_start() {
    let mut bench = Bench::new(Config::default());
    bench.run(10.0);
    let sent = bench.take_sent();
    assert_eq!(sent.len(), 10);
    for (index, sent) in sent.iter().enumerate() {
        let MavMessage::HEARTBEAT(heartbeat) = &sent.message else { panic!() };
        assert_eq!((heartbeat.mavtype, heartbeat.autopilot, heartbeat.base_mode), (18, 8, 0));
        assert_eq!((heartbeat.custom_mode, heartbeat.system_status, heartbeat.mavlink_version), (0, 3, 3));
        assert_eq!((sent.header.system_id, sent.header.component_id), (1, 191));
        assert_eq!(sent.at_us - 10_010_000, index as u64 * 1_000_000);
    }
}

#[test]
fn the_state_in_the_heartbeat_says_what_we_do() {
    let mut bench = Bench::flying();
    let status = |bench: &mut Bench| {
        bench.take_sent();
        bench.run(2.0);
        let mut states = bench.take_sent().into_iter().filter_map(|sent| match sent.message {
            MavMessage::HEARTBEAT(heartbeat) => Some(heartbeat.system_status),
            _ => None,
        });
        states.next_back().unwrap()
    };
    assert_eq!(status(&mut bench), 4, "active");
    bench.output.as_mut().unwrap().outcome = Outcome::StaleObstacles;
    assert_eq!(status(&mut bench), 5, "critical");
    bench.output = None;
    assert_eq!(status(&mut bench), 5, "critical: guidance is silent");
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 5, ARMED));
    assert_eq!(status(&mut bench), 3, "standby");
}

#[test]
fn the_first_vehicle_is_latched_and_all_others_are_ignored() {
    let mut bench = Bench::new(Config::default());
    let data =
        |mavtype, autopilot| MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype, ..heartbeat(autopilot, GUIDED, ARMED) });
    bench.say_as((255, 190), &data(6, 8)); // ground station
    bench.say_as((42, 195), &data(18, 8)); // another companion
    bench.say_as((42, 154), &data(26, ARDUPILOT)); // a gimbal that runs ArduPilot
    bench.say_as((43, 1), &data(5, ARDUPILOT)); // an antenna tracker
    assert_eq!(bench.companion.autopilot(), None);
    assert_eq!(bench.companion.control(bench.now()), Control::LinkLost);

    bench.say_as((42, 1), &data(QUADROTOR, ARDUPILOT));
    assert_eq!(bench.companion.control(bench.now()), Control::Granted);
    bench
        .say_as((42, 154), &MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype: 26, ..heartbeat(ARDUPILOT, 0, DISARMED) }));
    bench.say_as((42, 190), &MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype: 6, ..heartbeat(8, 0, DISARMED) }));
    bench.say_as((43, 1), &MavMessage::HEARTBEAT(heartbeat(PX4, 0, DISARMED)));
    assert_eq!(bench.companion.control(bench.now()), Control::Granted);
    let autopilot = bench.companion.autopilot().unwrap();
    assert_eq!((autopilot.system_id, autopilot.software), (42, Software::ArduPilot));
    assert_eq!(bench.companion.counters().foreign_heartbeats, 1);

    bench.run(0.2);
    for sent in bench.take_sent() {
        assert_eq!((sent.header.system_id, sent.header.component_id), (42, 191), "we join its system");
        if let MavMessage::SET_POSITION_TARGET_LOCAL_NED(setpoint) = sent.message {
            assert_eq!((setpoint.target_system, setpoint.target_component), (42, 1));
        }
    }
}

#[test]
fn only_guided_of_a_copter_and_offboard_grant_control_and_only_when_armed() {
    let control = |mavtype, autopilot, custom_mode, base_mode| {
        let mut bench = Bench::new(Config::default());
        let data = HEARTBEAT_DATA { mavtype, ..heartbeat(autopilot, custom_mode, base_mode) };
        bench.say(&MavMessage::HEARTBEAT(data));
        bench.companion.control(bench.now())
    };
    for copter in [2, 3, 4, 13, 14, 15, 29, 35, 43] {
        assert_eq!(control(copter, ARDUPILOT, 4, ARMED), Control::Granted, "type {copter}");
    }
    assert_eq!(control(2, ARDUPILOT, 4, DISARMED), Control::NotInControl);
    for mode in [0, 2, 3, 5, 6, 9, 15, 16, 17, OFFBOARD] {
        assert_eq!(control(2, ARDUPILOT, mode, ARMED), Control::NotInControl, "mode {mode}");
    }
    // Mode 4 is ACRO of a plane and HOLD of a rover.
    assert_eq!(control(1, ARDUPILOT, 4, ARMED), Control::NotInControl);
    assert_eq!(control(10, ARDUPILOT, 4, ARMED), Control::NotInControl);

    assert_eq!(control(2, PX4, OFFBOARD, ARMED), Control::Granted);
    assert_eq!(control(2, PX4, OFFBOARD | 7 << 24, ARMED), Control::Granted, "the sub mode does not matter");
    assert_eq!(control(2, PX4, OFFBOARD, DISARMED), Control::NotInControl);
    for mode in [0, 4, 6, 1 << 16, 4 << 16, 7 << 16, 6 << 24, 6 << 8] {
        assert_eq!(control(2, PX4, mode, ARMED), Control::NotInControl, "mode {mode:#x}");
    }
    for other in [0, 4, 13, 20, 200] {
        assert_eq!(control(2, other, 4, ARMED), Control::NotInControl, "autopilot {other}");
        assert_eq!(control(2, other, OFFBOARD, ARMED), Control::NotInControl, "autopilot {other}");
    }
}

// ---- setpoints ----

#[test]
fn in_control_the_newest_setpoint_leaves_every_50_ms_in_the_one_portable_form() {
    let mut bench = Bench::flying();
    bench.run(5.0);
    let setpoints = bench.setpoints();
    assert!((99..=101).contains(&setpoints.len()), "{}", setpoints.len());
    for (at_us, setpoint) in &setpoints {
        assert_eq!(at_us % 50_000, 0, "on the grid");
        assert_eq!(
            *setpoint,
            SET_POSITION_TARGET_LOCAL_NED_DATA {
                time_boot_ms: (at_us / 1000) as u32,
                target_system: 1,
                target_component: 1,
                coordinate_frame: 1,
                type_mask: 0x05C7,
                vx: 1.0,
                vy: -0.5,
                vz: -0.25,
                yaw_rate: 0.125,
                ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
            }
        );
    }
    bench.output = Some(output([0.5, 0.0, 0.0], 0.0));
    bench.run(0.06);
    assert_eq!(velocity(&bench.setpoints().last().unwrap().1), [0.5, 0.0, 0.0, 0.0]);
}

#[test]
fn a_late_poll_sends_one_setpoint_and_returns_to_the_grid() {
    let mut bench = Bench::flying();
    bench.run(1.0);
    bench.setpoints();
    bench.step(217_000);
    bench.run(0.2);
    let times: Vec<u64> = bench.setpoints().iter().map(|(at_us, _)| *at_us).collect();
    assert_eq!(times[0], 11_217_000);
    // Steps of 10 ms from here on: the first one past each multiple of 50 ms.
    assert_eq!(times[1..], [11_257_000, 11_307_000, 11_357_000, 11_407_000]);
}

#[test]
fn a_setpoint_older_than_a_quarter_second_is_replaced_by_zero() {
    let mut bench = Bench::flying();
    bench.run(1.0);
    bench.setpoints();
    bench.output = None;
    let last_us = bench.now_us;
    bench.run(1.0);
    let setpoints = bench.setpoints();
    assert_eq!(setpoints.len(), 20, "the stream goes on");
    for (at_us, setpoint) in setpoints {
        let expected = if at_us - last_us <= 250_000 { [1.0, -0.5, -0.25, 0.125] } else { ZERO };
        assert_eq!(velocity(&setpoint), expected, "{} us", at_us - last_us);
    }
}

#[test]
fn with_nothing_published_zero_is_streamed() {
    let mut bench = Bench::flying();
    bench.output = None;
    bench.run(2.0);
    let setpoints = bench.setpoints();
    assert_eq!(setpoints.len(), 40);
    assert!(setpoints.iter().all(|(_, setpoint)| velocity(setpoint) == ZERO));
}

#[test]
fn a_setpoint_that_is_not_finite_or_absurd_becomes_zero_and_is_counted() {
    let mut bench = Bench::flying();
    bench.run(0.5);
    let bad = [
        ([f32::NAN, 0.0, 0.0], 0.0),
        ([0.0, f32::INFINITY, 0.0], 0.0),
        ([0.0, 0.0, f32::NEG_INFINITY], 0.0),
        ([1.0, 0.0, 0.0], f32::NAN),
        ([1.0, 0.0, 0.0], -4.1),
        ([15.0, 15.0, 0.0], 0.0),
        ([f32::MAX, f32::MAX, f32::MAX], 0.0),
    ];
    for (index, (velocity_ned, yaw_rate)) in bad.into_iter().enumerate() {
        bench.output = None;
        bench.companion.publish(bench.now(), &output(velocity_ned, yaw_rate));
        bench.setpoints();
        bench.run(0.05);
        assert_eq!(velocity(&bench.setpoints()[0].1), ZERO, "{velocity_ned:?} {yaw_rate}");
        assert_eq!(bench.companion.counters().setpoint_faults, index as u32 + 1);
    }
}

#[test]
fn outside_the_mode_ardupilot_gets_no_setpoints() {
    for (mode, base_mode) in [(5, ARMED), (GUIDED, DISARMED), (9, ARMED)] {
        let mut bench = Bench::flying();
        bench.run(1.0);
        assert!(!bench.setpoints().is_empty());
        bench.heartbeat = Some(heartbeat(ARDUPILOT, mode, base_mode));
        bench.run(1.1);
        bench.setpoints();
        bench.run(3.0);
        assert_eq!(bench.setpoints().len(), 0, "mode {mode}, base mode {base_mode}");
    }
}

#[test]
fn a_setpoint_that_waits_is_taken_back_when_the_mode_is_left() {
    let mut bench = Bench::flying();
    bench.run(1.0);
    bench.take_sent();
    bench.companion.publish(Instant(11_050_000), &output([1.0; 3], 0.0));
    bench.companion.poll(Instant(11_050_000));
    bench.now_us = 11_051_000;
    bench.say(&MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, 5, ARMED)));
    bench.companion.poll(Instant(11_051_000));
    bench.drain();
    assert_eq!(bench.setpoints().len(), 0);
}

#[test]
fn outside_offboard_px4_gets_zeros_unless_configured_otherwise() {
    for prestream in [true, false] {
        let mut bench = Bench::new(Config { prestream, ..Config::default() });
        bench.output = Some(output([1.0, 1.0, 1.0], 1.0));
        for base_mode in [DISARMED, ARMED] {
            bench.heartbeat = Some(heartbeat(PX4, 3 << 16, base_mode));
            bench.run(1.1);
            bench.setpoints();
            bench.run(1.0);
            let setpoints = bench.setpoints();
            assert_eq!(setpoints.len(), if prestream { 20 } else { 0 });
            assert!(setpoints.iter().all(|(_, setpoint)| velocity(setpoint) == ZERO));
        }
        bench.heartbeat = Some(heartbeat(PX4, OFFBOARD, ARMED));
        bench.run(1.1);
        assert_eq!(velocity(&bench.setpoints().last().unwrap().1), [1.0; 4]);
    }
}

#[test]
fn an_autopilot_of_another_make_is_never_commanded() {
    let mut bench = Bench::flying();
    bench.heartbeat = Some(heartbeat(20, OFFBOARD | 4, ARMED));
    bench.run(5.0);
    assert_eq!(bench.setpoints().len(), 0);
}

#[test]
fn silence_of_the_autopilot_means_zero_after_2_5_s_and_nothing_after_5_s() {
    for autopilot in [heartbeat(ARDUPILOT, GUIDED, ARMED), heartbeat(PX4, OFFBOARD, ARMED)] {
        let mut bench = Bench::flying();
        bench.heartbeat = Some(autopilot);
        bench.run(0.01);
        bench.heartbeat = None;
        let heard_us = bench.now_us;
        bench.run(2.49);
        assert_eq!(bench.companion.control(bench.now()), Control::Granted);
        bench.run(0.02);
        assert_eq!(bench.companion.control(bench.now()), Control::LinkLost);
        bench.run(7.5);
        let (mut moving, mut zeros) = (0, 0);
        for (at_us, setpoint) in bench.setpoints() {
            let silent_us = at_us - heard_us;
            if silent_us <= 2_500_000 {
                moving += 1;
                assert_ne!(velocity(&setpoint), ZERO);
            } else {
                zeros += 1;
                assert_eq!(velocity(&setpoint), ZERO);
            }
            assert!(silent_us <= 5_000_000, "{silent_us}");
        }
        assert_eq!((moving, zeros), (50, 50));
    }
}

#[test]
fn after_a_short_silence_control_comes_back_and_after_a_long_one_only_by_a_fresh_entry() {
    let control_after = |silence_s, config| {
        let mut bench = Bench::new(config);
        bench.output = Some(output([1.0, 0.0, 0.0], 0.0));
        let in_mode = heartbeat(ARDUPILOT, GUIDED, ARMED);
        bench.heartbeat = Some(in_mode.clone());
        bench.run(1.0);
        bench.heartbeat = None;
        bench.run(silence_s);
        bench.heartbeat = Some(in_mode);
        bench.run(2.0);
        bench
    };
    let bench = control_after(4.0, Config::default());
    assert_eq!(bench.companion.control(bench.now()), Control::Granted);
    let bench = control_after(6.5, Config { fresh_entry_after_silence: false, ..Config::default() });
    assert_eq!(bench.companion.control(bench.now()), Control::Granted);

    let mut bench = control_after(6.5, Config::default());
    assert_eq!(bench.companion.control(bench.now()), Control::NotInControl);
    bench.setpoints();
    bench.run(1.0);
    let setpoints = bench.setpoints();
    assert_eq!(setpoints.len(), 20, "it is still in the mode: hold");
    assert!(setpoints.iter().all(|(_, setpoint)| velocity(setpoint) == ZERO));
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 5, ARMED));
    bench.run(1.5);
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    bench.run(1.5);
    assert_eq!(bench.companion.control(bench.now()), Control::Granted);
    assert_eq!(velocity(&bench.setpoints().last().unwrap().1), [1.0, 0.0, 0.0, 0.0]);
}

#[test]
fn a_climb_is_cut_to_zero_on_the_ground_and_nothing_else_is() {
    let mut bench = Bench::flying();
    let last = |bench: &mut Bench| {
        bench.run(0.1);
        velocity(&bench.setpoints().last().unwrap().1)
    };
    assert_eq!(bench.companion.landed(), None);
    assert_eq!(last(&mut bench), [1.0, -0.5, -0.25, 0.125]);
    bench.say(&extended(1));
    assert_eq!(bench.companion.landed(), Some(true));
    assert_eq!(last(&mut bench), [1.0, -0.5, 0.0, 0.125]);
    bench.output = Some(output([0.0, 0.0, 0.5], 0.0));
    assert_eq!(last(&mut bench), [0.0, 0.0, 0.5, 0.0], "down is no climb");
    bench.output = Some(output([1.0, -0.5, -0.25], 0.125));
    for airborne in [2, 3, 4, 77] {
        bench.say(&extended(airborne));
        assert_eq!(bench.companion.landed(), Some(false));
        assert_eq!(last(&mut bench), [1.0, -0.5, -0.25, 0.125]);
    }
    bench.say(&extended(0));
    assert_eq!(bench.companion.landed(), None);
}

#[test]
fn a_clock_that_jumps_back_does_not_keep_an_old_setpoint_alive() {
    let mut bench = Bench::flying();
    bench.run(2.0);
    bench.output = None;
    bench.setpoints();
    bench.now_us -= 1_500_000;
    bench.run(1.0);
    let setpoints = bench.setpoints();
    assert!((20..=21).contains(&setpoints.len()), "{}", setpoints.len());
    assert!(setpoints.iter().all(|(_, setpoint)| velocity(setpoint) == ZERO));
}

// ---- requests ----

#[test]
fn the_messages_we_need_are_asked_for_once_when_each_is_acknowledged() {
    let mut bench = Bench::new(Config::default());
    bench.run(3.0);
    assert_eq!(bench.commands().len(), 0, "nobody to ask yet");
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.step(10_000);
    let commands = bench.commands();
    let asked: Vec<(f32, f32)> = commands.iter().map(|(_, command)| (command.param1, command.param2)).collect();
    assert_eq!(asked, [(32.0, 20_000.0), (30.0, 20_000.0), (245.0, 500_000.0), (330.0, 100_000.0)]);
    for (_, command) in &commands {
        assert_eq!((command.target_system, command.target_component), (1, 1));
        assert_eq!((command.command, command.confirmation), (511, 0));
        let rest = [command.param3, command.param4, command.param5, command.param6, command.param7];
        assert_eq!(rest, [0.0; 5]);
    }
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    bench.run(2.9);
    assert_eq!(bench.commands().len(), 0);
}

#[test]
fn without_acknowledgement_each_request_is_repeated_five_times_half_a_second_apart() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.run(4.0);
    let commands = bench.commands();
    for message_id in [32.0, 30.0, 245.0, 330.0] {
        let of_it = commands.iter().filter(|(_, command)| command.param1 == message_id);
        let tries: Vec<(u64, u8)> = of_it.map(|(at_us, command)| (*at_us - 10_010_000, command.confirmation)).collect();
        let expected: Vec<(u64, u8)> = (0..5).map(|k| (u64::from(k) * 500_000, k)).collect();
        assert_eq!(tries, expected, "message {message_id}");
    }
}

#[test]
fn other_peoples_acknowledgements_do_not_count() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.step(10_000);
    for _ in 0..4 {
        let data =
            COMMAND_ACK_DATA { command: 511, target_system: 255, target_component: 190, ..COMMAND_ACK_DATA::DEFAULT };
        bench.say(&MavMessage::COMMAND_ACK(data));
        bench.say(&ack(512, 0));
        bench.say(&ack(511, 5));
        bench.say_as((1, 154), &ack(511, 0));
    }
    bench.take_sent();
    bench.run(0.6);
    assert_eq!(bench.commands().len(), 4);
}

/// Plays an autopilot that sends the three messages that must come, at a share of the wished rates.
fn stream(bench: &mut Bench, seconds: u32, share: f32) {
    for step in 0..seconds * 100 {
        let due = |rate_hz: f32| {
            let per_step = rate_hz * share * 0.01;
            (step as f32 * per_step).floor() != ((step + 1) as f32 * per_step).floor()
        };
        let time_boot_ms = (bench.now_us / 1000) as u32;
        if due(50.0) {
            bench.say(&position(time_boot_ms));
            bench.say(&attitude(time_boot_ms, 0.0));
        }
        if due(2.0) {
            bench.say(&extended(1));
        }
        bench.step(10_000);
    }
}

#[test]
fn a_message_that_comes_too_slowly_is_asked_for_again_but_obstacles_are_not() {
    let mut bench = Bench::new(Config::default());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, DISARMED));
    bench.step(10_000);
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    bench.take_sent();
    stream(&mut bench, 12, 0.8);
    assert_eq!(bench.commands().len(), 0, "80 % is enough");
    stream(&mut bench, 4, 0.4);
    let mut asked: Vec<u32> = bench.commands().iter().map(|(_, command)| command.param1 as u32).collect();
    asked.sort_unstable();
    asked.dedup();
    assert_eq!(asked, [30, 32, 245]);
}

#[test]
fn a_restart_of_the_autopilot_forgets_what_it_said_and_asks_for_everything_again() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    bench.say(&position(60_000));
    bench.say(&attitude(59_500, 0.0));
    bench.say(&extended(2));
    bench.step(10_000);
    assert!(bench.companion.ownship().is_some(), "messages may overtake each other");
    assert_eq!(bench.companion.counters().reboots, 0);
    bench.take_sent();

    bench.say(&position(900));
    assert_eq!(bench.companion.counters().reboots, 1);
    assert_eq!(bench.companion.ownship(), None);
    assert_eq!(bench.companion.landed(), None);
    assert_eq!(bench.companion.control(bench.now()), Control::NotInControl, "until it says so again");
    bench.step(10_000);
    assert_eq!(bench.commands().len(), 4);
}

#[test]
fn after_a_lost_link_everything_is_asked_for_again() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    let data = bench.heartbeat.take();
    bench.run(3.5);
    bench.take_sent();
    bench.heartbeat = data;
    bench.step(10_000);
    assert_eq!(bench.commands().len(), 4);
}

// ---- commands and clock requests ----

#[test]
fn commands_for_us_are_refused_and_commands_for_others_are_not_answered() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    let command = |target_system, target_component, command| {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            target_system,
            target_component,
            command,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    };
    for (number, result) in [(400, 2), (176, 2), (512, 3), (22, 3), (65_000, 3)] {
        bench.take_sent();
        bench.say_as((255, 190), &command(1, 191, number));
        bench.drain();
        let sent = bench.take_sent();
        assert_eq!(sent.len(), 1);
        let MavMessage::COMMAND_ACK(ack) = &sent[0].message else { panic!() };
        assert_eq!((ack.command, ack.result), (number, result));
        assert_eq!((ack.target_system, ack.target_component), (255, 190));
    }
    for (target_system, target_component) in [(1, 1), (1, 0), (0, 0), (2, 191), (1, 195)] {
        bench.say_as((255, 190), &command(target_system, target_component, 400));
    }
    bench.drain();
    assert_eq!(bench.take_sent().len(), 0);
}

#[test]
fn clock_requests_are_answered_with_our_clock_and_answers_are_not() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.take_sent();
    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: -77, ..TIMESYNC_DATA::DEFAULT }));
    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 5, ts1: 6, ..TIMESYNC_DATA::DEFAULT }));
    bench.say(&MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 8, target_system: 9, target_component: 1 }));
    bench.drain();
    let sent = bench.take_sent();
    assert_eq!(sent.len(), 1);
    let MavMessage::TIMESYNC(answer) = &sent[0].message else { panic!() };
    assert_eq!((answer.tc1, answer.ts1), (10_010_000_000, -77));
    assert_eq!((answer.target_system, answer.target_component), (1, 1));
}

// ---- ownship ----

#[test]
fn ownship_needs_position_and_attitude_of_the_latched_autopilot() {
    let mut bench = Bench::flying();
    bench.say(&position(1));
    bench.say(&attitude(1, 0.0));
    assert_eq!(bench.companion.ownship(), None, "nobody is latched yet");
    bench.step(10_000);
    bench.say_as((2, 1), &position(1));
    bench.say_as((1, 2), &attitude(1, 0.0));
    bench.say(&position(5));
    assert_eq!(bench.companion.ownship(), None);
    bench.step(20_000);
    bench.say(&attitude(7, 0.75));
    let ownship = bench.companion.ownship().unwrap();
    assert_eq!((ownship.position_time, ownship.attitude_time), (Instant(10_010_000), Instant(10_030_000)));
    let (at, speed) = (ownship.position_ned_m, ownship.velocity_ned_mps);
    assert_eq!([at.north, at.east, at.down], [1.0, 2.0, -3.0]);
    assert_eq!([speed.north, speed.east, speed.down], [0.1, 0.2, 0.3]);
    assert_eq!(ownship.yaw_rad, 0.75);
}

#[test]
fn numbers_that_are_not_finite_or_absurd_are_rejected_and_counted() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&position(1));
    bench.say(&attitude(1, 0.5));
    let before = bench.companion.ownship();
    let MavMessage::LOCAL_POSITION_NED(good_position) = position(1) else { panic!() };
    let MavMessage::ATTITUDE(good_attitude) = attitude(1, 0.0) else { panic!() };
    let quaternion = ATTITUDE_QUATERNION_DATA { q1: 1.0, ..ATTITUDE_QUATERNION_DATA::DEFAULT };
    let bad = [
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { x: f32::NAN, ..good_position.clone() }),
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { vz: f32::INFINITY, ..good_position.clone() }),
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { y: 1e30, ..good_position }),
        MavMessage::ATTITUDE(ATTITUDE_DATA { yaw: f32::NAN, ..good_attitude.clone() }),
        MavMessage::ATTITUDE(ATTITUDE_DATA { yawspeed: f32::NAN, ..good_attitude.clone() }),
        MavMessage::ATTITUDE(ATTITUDE_DATA { roll: 1e9, ..good_attitude }),
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA { q1: 0.0, ..quaternion.clone() }),
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA { q2: 0.5, ..quaternion.clone() }),
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA { q3: f32::NAN, ..quaternion }),
    ];
    for (index, message) in bad.iter().enumerate() {
        bench.say(message);
        assert_eq!(bench.companion.counters().rejected, index as u32 + 1, "{message:?}");
    }
    assert_eq!(bench.companion.ownship(), before);
}

#[test]
fn quaternions_and_angles_mean_the_same_attitude() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&position(1));
    for (roll, pitch, yaw) in [(0.0, 0.0, 3.1), (0.3, -0.2, -2.0), (-1.2, 0.9, 0.4), (0.0, 1.4, 1.0)] {
        // Yaw, then pitch, then roll, in f64.
        let half = |angle: f64| ((angle / 2.0).sin(), (angle / 2.0).cos());
        let ((sr, cr), (sp, cp), (sy, cy)) = (half(roll), half(pitch), half(yaw));
        let data = ATTITUDE_QUATERNION_DATA {
            q1: (cr * cp * cy + sr * sp * sy) as f32,
            q2: (sr * cp * cy - cr * sp * sy) as f32,
            q3: (cr * sp * cy + sr * cp * sy) as f32,
            q4: (cr * cp * sy - sr * sp * cy) as f32,
            ..ATTITUDE_QUATERNION_DATA::DEFAULT
        };
        bench.say(&MavMessage::ATTITUDE_QUATERNION(data));
        let ownship = bench.companion.ownship().unwrap();
        assert!((f64::from(ownship.roll_rad) - roll).abs() < 1e-5);
        assert!((f64::from(ownship.pitch_rad) - pitch).abs() < 1e-5);
        assert!((f64::from(ownship.yaw_rad) - yaw).abs() < 1e-5);
    }
}

#[test]
fn the_yaw_rate_is_that_of_the_yaw_angle() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&position(1));
    // Banked 60 degrees right in a level turn of 0.4 rad/s: the body sees pitch rate 0.4 sin, yaw rate 0.4 cos.
    let (sine, cosine) = 60.0_f32.to_radians().sin_cos();
    let (pitchspeed, yawspeed) = (0.4 * sine, 0.4 * cosine);
    let roll = 60.0_f32.to_radians();
    bench.say(&MavMessage::ATTITUDE(ATTITUDE_DATA { roll, pitchspeed, yawspeed, ..ATTITUDE_DATA::DEFAULT }));
    assert!((bench.companion.ownship().unwrap().yaw_rate_radps - 0.4).abs() < 1e-5);
}

// ---- obstacles ----

fn obstacles(frame: u8) -> MavMessage {
    let mut data = OBSTACLE_DISTANCE_DATA {
        increment: 5,
        min_distance: 20,
        max_distance: 1000,
        frame,
        ..OBSTACLE_DISTANCE_DATA::DEFAULT
    };
    data.distances = [1001; 72];
    data.distances[0] = 250;
    data.distances[1] = 0;
    data.distances[2] = u16::MAX;
    MavMessage::OBSTACLE_DISTANCE(data)
}

fn first_azimuth(autopilot: u8, frame: u8, config: Config) -> Option<f32> {
    let mut bench = Bench::new(config);
    bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, 0, DISARMED)));
    bench.say(&attitude(1, 0.5));
    bench.say_as((1, 158), &obstacles(frame));
    bench.companion.take_scan().map(|scan| scan.first_azimuth_rad)
}

#[test]
fn obstacle_angles_count_from_the_nose_on_ardupilot_and_as_the_frame_says_on_px4() {
    let auto = Config::default();
    for frame in [0, 1, 8, 12] {
        assert_eq!(first_azimuth(ARDUPILOT, frame, auto), Some(0.0), "ArduPilot ignores the frame");
    }
    assert_eq!(first_azimuth(PX4, 12, auto), Some(0.0));
    assert_eq!(first_azimuth(PX4, 0, auto), Some(-0.5), "north is to the left");
    assert_eq!(first_azimuth(PX4, 1, auto), Some(-0.5));
    assert_eq!(first_azimuth(PX4, 8, auto), None);
    let with = |obstacle_frame| Config { obstacle_frame, ..Config::default() };
    assert_eq!(first_azimuth(ARDUPILOT, 0, with(ObstacleFrame::Field)), Some(-0.5));
    assert_eq!(first_azimuth(PX4, 0, with(ObstacleFrame::Body)), Some(0.0));
}

#[test]
fn north_aligned_obstacles_without_a_fresh_yaw_are_rejected() {
    let mut bench = Bench::new(Config::default());
    bench.say(&MavMessage::HEARTBEAT(heartbeat(PX4, 0, DISARMED)));
    bench.say(&obstacles(0));
    assert_eq!(bench.companion.take_scan(), None);
    bench.say(&attitude(1, 0.5));
    bench.step(600_000);
    bench.say(&obstacles(0));
    assert_eq!(bench.companion.take_scan(), None);
    assert_eq!(bench.companion.counters().rejected, 2);
}

#[test]
fn zero_is_no_reading_on_ardupilot_and_touching_elsewhere() {
    for (autopilot, expected) in [(ARDUPILOT, Sector::Unknown), (PX4, Sector::Hit(0.2))] {
        let mut bench = Bench::new(Config::default());
        bench.say(&MavMessage::HEARTBEAT(heartbeat(autopilot, 0, DISARMED)));
        bench.say(&obstacles(12));
        let scan = bench.companion.take_scan().unwrap();
        assert_eq!(scan.sectors[..4], [Sector::Hit(2.5), expected, Sector::Unknown, Sector::Clear]);
        assert_eq!((scan.time, scan.range_max_m), (bench.now(), 10.0));
        assert_eq!(bench.companion.take_scan(), None, "taken once");
    }
}

#[test]
fn obstacles_come_from_any_component_of_our_system_but_no_other_system() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say_as((2, 1), &obstacles(12));
    assert_eq!(bench.companion.take_scan(), None);
    bench.say_as((1, 196), &obstacles(12));
    assert!(bench.companion.take_scan().is_some());
}

#[test]
fn a_scan_that_nobody_takes_is_dropped_when_it_is_old() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&obstacles(12));
    bench.run(0.6);
    assert_eq!(bench.companion.take_scan(), None);
}

fn beam(orientation: u8, current_distance: u16) -> MavMessage {
    MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA {
        orientation,
        current_distance,
        min_distance: 20,
        max_distance: 800,
        ..DISTANCE_SENSOR_DATA::DEFAULT
    })
}

fn point(x: f32, y: f32) -> MavMessage {
    MavMessage::OBSTACLE_DISTANCE_3D(OBSTACLE_DISTANCE_3D_DATA {
        frame: 12,
        x,
        y,
        min_distance: 0.2,
        max_distance: 8.0,
        ..OBSTACLE_DISTANCE_3D_DATA::DEFAULT
    })
}

#[test]
fn beams_and_points_of_our_system_are_gathered_until_they_are_taken() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    let heard_at = bench.now();
    bench.say(&beam(0, 300));
    bench.step(10_000);
    bench.say_as((1, 196), &beam(2, 150));
    bench.say_as((1, 196), &point(1.0, -0.5));
    bench.say_as((2, 1), &beam(0, 100));
    let points = bench.companion.take_points().unwrap();
    let found: Vec<(f32, f32)> = points.points_m.iter().map(|point| (point.north, point.east)).collect();
    assert_eq!(found.len(), 3, "{found:?}");
    for (found, expected) in found.iter().zip([(3.0, 0.0), (0.0, 1.5), (1.0, -0.5)]) {
        assert!((found.0 - expected.0).abs() < 1e-5 && (found.1 - expected.1).abs() < 1e-5, "{found:?}");
    }
    assert_eq!((points.frame, points.time), (Frame::Body, heard_at), "as old as the oldest of them");
    assert_eq!(bench.companion.take_points(), None, "taken once");
}

#[test]
fn a_beam_that_sees_nothing_is_a_word_and_one_that_does_not_look_ahead_or_does_not_read_is_none() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    for silent in [beam(25, 300), beam(24, 300), beam(0, 5), beam(0, 0)] {
        bench.say(&silent);
        assert_eq!(bench.companion.take_points(), None, "{silent:?}");
    }
    bench.say(&beam(0, 801));
    assert_eq!(bench.companion.take_points().map(|points| points.points_m.len()), Some(0));
    bench.say(&point(f32::NAN, 0.0));
    assert_eq!((bench.companion.take_points(), bench.companion.counters().rejected), (None, 1));
}

#[test]
fn points_are_bounded_counted_and_dropped_when_they_are_old() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    for k in 0..100 {
        bench.say(&point(1.0 + 0.01 * k as f32, 0.0));
    }
    assert_eq!(bench.companion.counters().points_dropped, 28);
    assert_eq!(bench.companion.take_points().unwrap().points_m.len(), 72);
    bench.say(&beam(0, 300));
    bench.run(0.6);
    assert_eq!(bench.companion.take_points(), None);
}

// ---- telemetry ----

fn bearing() -> Bearing {
    Bearing {
        time: Instant(0),
        valid: true,
        azimuth_rad: 0.0,
        sigma_rad: 0.1,
        elevation_rad: 0.0,
        elevation_sigma_rad: 0.1,
        quality: Quality { snr_db: 14.5, ..Quality::default() },
        flags: Flags(0),
    }
}

#[test]
fn four_named_values_are_told_twice_a_second_each() {
    let mut bench = Bench::flying();
    let told = bench.output.as_mut().unwrap();
    told.bearing = Some(bearing());
    told.source_bearing_ned_rad = Some(-1.0);
    told.outcome = Outcome::GuardBrake;
    bench.run(10.0);
    let mut values: Vec<(String, f32)> = Vec::new();
    for sent in bench.take_sent() {
        if let MavMessage::NAMED_VALUE_FLOAT(value) = sent.message {
            assert_eq!(u64::from(value.time_boot_ms), sent.at_us / 1000);
            values.push((value.name.to_str().unwrap().to_owned(), value.value));
        }
    }
    let brg = 360.0 - 1.0_f32.to_degrees();
    for (name, expected) in [("FH_BRG", brg), ("FH_SNR", 14.5), ("FH_SIG", 0.1_f32.to_degrees()), ("FH_ST", 9.0)] {
        let of_it: Vec<f32> = values.iter().filter(|(other, _)| other == name).map(|(_, value)| *value).collect();
        assert!((18..=21).contains(&of_it.len()), "{name}: {}", of_it.len());
        assert!(of_it.iter().all(|value| (value - expected).abs() < 1e-3), "{name}: {of_it:?}");
    }
}

#[test]
fn what_is_not_known_is_not_told() {
    let mut bench = Bench::flying();
    bench.output.as_mut().unwrap().bearing = Some(Bearing { valid: false, ..bearing() });
    bench.run(2.0);
    for sent in bench.take_sent() {
        if let MavMessage::NAMED_VALUE_FLOAT(value) = sent.message {
            assert_eq!(value.name.to_str().unwrap(), "FH_ST");
        }
    }
}

fn texts(bench: &mut Bench) -> Vec<(u64, String)> {
    let pick = |sent: Sent| match sent.message {
        MavMessage::STATUSTEXT(text) => Some((sent.at_us, text.text.to_str().unwrap().to_owned())),
        _ => None,
    };
    bench.take_sent().into_iter().filter_map(pick).collect()
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

// ---- sending ----

#[test]
fn the_setpoint_leaves_first_and_telemetry_is_dropped_first() {
    let mut bench = Bench::flying();
    bench.run(0.1);
    (0..4).for_each(|_| bench.say(&ack(511, 0)));
    bench.run(0.9);
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
    assert!(values.max().unwrap() >= 12_250, "the oldest telemetry is dropped, not the newest");
    let counters = bench.companion.counters();
    assert_eq!(counters.setpoints_replaced, 27);
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

// ---- configuration ----

#[test]
fn a_bad_configuration_is_refused_with_the_name_of_the_field() {
    let refused = |config: Config| config.build().err().unwrap();
    let default = Config::default();
    assert_eq!(refused(Config { system_id: 0, ..default }).field, "link.system_id");
    assert_eq!(refused(Config { component_id: 1, ..default }).field, "link.component_id", "that is the autopilot");
    assert_eq!(refused(Config { position_hz: f32::NAN, ..default }).why, Why::NotFinite);
    assert_eq!(refused(Config { setpoint_period_ms: 0, ..default }).field, "link.setpoint_period_ms");
    assert_eq!(refused(Config { setpoint_age_max_s: 60.0, ..default }).field, "link.setpoint_age_max_s");
    let error = refused(Config { heartbeat_timeout_s: 4.0, silence_after_s: 3.0, ..default });
    assert_eq!(error.field, "link.silence_after_s");
    assert!(matches!(error.why, Why::Inconsistent(_)));
    assert!(default.build().is_ok());
}
