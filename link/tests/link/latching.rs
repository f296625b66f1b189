//! Who the autopilot is, and what our own heartbeat says.

use foxhound_core::guidance::mission::{Control, Outcome};
use foxhound_link::companion::{Config, Software};
use foxhound_link::dialect::*;
use foxhound_link::failsafe::Cause;

use crate::bench::*;

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
        bench.run(1.0);
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
    bench.run(0.9);
    assert_eq!(status(&mut bench), 5, "critical: guidance is silent");
    bench.output = Some(output([1.0, 0.0, 0.0], 0.0));
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
fn a_script_that_calls_itself_a_generic_autopilot_gives_way_to_the_real_one() {
    let mut bench = Bench::new(Config::default());
    bench.say_as((255, 0), &MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT));
    bench.run(0.2);
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    bench.output = Some(output([1.0, 0.0, 0.0], 0.0));
    bench.run(1.0);
    assert_eq!(bench.companion.autopilot().map(|autopilot| autopilot.system_id), Some(1));
    assert_eq!(bench.companion.cause(bench.now()), Cause::EntryNeeded, "it was in the mode before it was known");
    bench.heartbeat = Some(heartbeat(ARDUPILOT, 0, ARMED));
    bench.run(1.0);
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    for _ in 0..3 {
        bench.say_as((255, 0), &MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT));
        bench.run(1.0);
    }
    assert_eq!(bench.companion.cause(bench.now()), Cause::None, "and it is ignored from then on");
}

#[test]
fn a_vehicle_that_is_gone_while_it_was_disarmed_is_not_waited_for_and_an_armed_one_is() {
    for (base_mode, followed) in [(DISARMED, 7), (ARMED, 1)] {
        let mut bench = Bench::new(Config::default());
        bench.say(&MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, base_mode)));
        bench.say(&position(60_000));
        for second in 0..10 {
            bench.say_as((7, 1), &MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, DISARMED)));
            let system_id = bench.companion.autopilot().map(|autopilot| autopilot.system_id);
            assert_eq!(system_id, Some(if second > 5 { followed } else { 1 }), "after {second} s");
            bench.run(1.0);
        }
        bench.say_as((7, 1), &MavMessage::HEARTBEAT(heartbeat(ARDUPILOT, GUIDED, ARMED)));
        bench.say_as((7, 1), &position(1_000));
        assert_eq!(bench.companion.counters().reboots, 0, "it has a clock of its own");
        let granted = bench.companion.control(bench.now()) == Control::Granted;
        assert_eq!(granted, followed == 7);
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
