//! Which setpoints leave, when, and with what in them.

use foxhound_core::base::error::Why;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::mission::Control;
use foxhound_core::guidance::param::TABLE;
use foxhound_link::companion::{Config, Yaw};
use foxhound_link::dialect::*;

use crate::bench::*;

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
fn a_setpoint_that_is_not_finite_or_absurd_becomes_zero() {
    let mut bench = Bench::flying();
    bench.run(0.5);
    let bad = [
        ([f32::NAN, 0.0, 0.0], 0.0),
        ([0.0, f32::INFINITY, 0.0], 0.0),
        ([0.0, 0.0, f32::NEG_INFINITY], 0.0),
        ([1.0, 0.0, 0.0], f32::NAN),
        ([1.0, 0.0, 0.0], -6.5),
        ([15.0, 15.0, 0.0], 0.0),
        ([f32::MAX, f32::MAX, f32::MAX], 0.0),
    ];
    for (velocity_ned, yaw_rate) in bad {
        bench.output = None;
        bench.companion.publish(bench.now(), &output(velocity_ned, yaw_rate));
        bench.setpoints();
        bench.run(0.05);
        assert_eq!(velocity(&bench.setpoints()[0].1), ZERO, "{velocity_ned:?} {yaw_rate}");
    }
}

#[test]
fn what_the_parameters_allow_is_sent() {
    let most = |name: &str| TABLE.iter().find(|row| row.name == name).unwrap().max;
    let speed_mps = most("FH_SPD_MAX").max(most("FH_SPD_EVADE"));
    let fastest = [speed_mps, 0.0, most("FH_SPD_Z_MAX"), most("FH_YAWR_MAX").max(most("FH_TURN_RATE"))];
    let mut bench = Bench::flying();
    bench.output = Some(output([fastest[0], fastest[1], fastest[2]], fastest[3]));
    bench.run(1.0);
    assert_eq!(bench.setpoints().last().map(|(_, setpoint)| velocity(setpoint)), Some(fastest));
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
        bench.say(&extended(2));
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
    let control_after = |silence_s| {
        let mut bench = Bench::new(Config::default());
        bench.output = Some(output([1.0, 0.0, 0.0], 0.0));
        let in_mode = heartbeat(ARDUPILOT, GUIDED, ARMED);
        bench.heartbeat = Some(in_mode.clone());
        bench.run(1.0);
        bench.heartbeat = None;
        bench.run(silence_s);
        bench.heartbeat = Some(in_mode);
        bench.run(0.5);
        bench.say(&extended(2));
        bench.run(1.5);
        bench
    };
    let bench = control_after(4.0);
    assert_eq!(bench.companion.control(bench.now()), Control::Granted);

    let mut bench = control_after(6.5);
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
fn where_asked_for_the_yaw_is_an_angle_that_moves_on_at_the_rate_and_waits_for_the_vehicle() {
    let mut bench = Bench::new(Config { yaw: Yaw::Angle, ..Config::default() });
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    bench.output = Some(output([1.0, 0.0, 0.0], 0.4));
    let say = |bench: &mut Bench, yaw| bench.say(&attitude((bench.now_us / 1000) as u32, yaw));
    bench.step(10_000);
    say(&mut bench, 3.0);
    bench.run(0.5);
    let first = bench.setpoints();
    for (index, (_, setpoint)) in first.iter().enumerate() {
        assert_eq!((setpoint.type_mask, setpoint.yaw_rate), (0x09C7, 0.0));
        let expected = 3.0 + 0.02 * (index + 1) as f32;
        let expected = if expected > std::f32::consts::PI { expected - std::f32::consts::TAU } else { expected };
        assert!((setpoint.yaw - expected).abs() < 1e-4, "{index}: {} {expected}", setpoint.yaw);
    }
    // The vehicle does not turn: half a radian ahead is as far as it goes.
    bench.run(5.0);
    let yaw = bench.setpoints().last().unwrap().1.yaw;
    assert!((yaw - (3.5 - std::f32::consts::TAU)).abs() < 1e-4, "{yaw}");
}

#[test]
fn setpoints_that_do_not_get_onto_the_wire_are_counted_as_late_once() {
    let mut bench = Bench::flying();
    bench.run(1.0);
    for _ in 0..100 {
        bench.now_us += 10_000;
        bench.companion.publish(bench.now(), &output([1.0, 0.0, 0.0], 0.0));
        bench.companion.poll(bench.now());
    }
    assert_eq!(bench.companion.counters().setpoints_late, 1);
    bench.drain();
    bench.run(1.0);
    assert_eq!(bench.companion.counters().setpoints_late, 1);
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

#[test]
fn a_bad_configuration_is_refused_with_the_name_of_the_field() {
    let refused = |config: Config| config.build().err().unwrap();
    let default = Config::default();
    assert_eq!(refused(Config { system_id: 0, ..default }).field, "link.system_id");
    assert_eq!(refused(Config { component_id: 1, ..default }).field, "link.component_id", "that is the autopilot");
    assert_eq!(refused(Config { battery_min_percent: f32::NAN, ..default }).why, Why::NotFinite);
    assert_eq!(refused(Config { setpoint_age_max_s: 60.0, ..default }).field, "link.setpoint_age_max_s");
    let error = refused(Config { heartbeat_timeout_s: 4.0, silence_after_s: 3.0, ..default });
    assert_eq!(error.field, "link.silence_after_s");
    assert!(matches!(error.why, Why::Inconsistent(_)));
    assert!(default.build().is_ok());
}
