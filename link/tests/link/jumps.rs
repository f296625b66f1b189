//! Jumps of the autopilot's estimate, and an estimate that contradicts itself.

use foxhound_core::base::ownship::Stale;
use foxhound_core::guidance::mission::Outcome;
use foxhound_link::dialect::*;
use foxhound_link::failsafe::Cause;

use crate::bench::*;
use crate::failsafes::{BOTH, Flight};

#[test]
fn a_jump_of_the_position_holds_for_half_a_second_and_is_never_seen_by_guidance() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        let before = flight.bench.companion.ownship().unwrap();
        flight.position = [13.0, 16.0, -5.0];
        flight.run(0.02);
        assert_eq!(flight.bench.companion.ownship(), None, "nobody flies on the first word");
        assert_eq!(flight.bench.companion.counters().jumps, 1);
        assert_eq!(flight.cause(), Cause::None);
        flight.run(0.52);
        let after = flight.bench.companion.ownship().unwrap();
        assert!(after.position_ned_m.horizontal().minus(before.position_ned_m.horizontal()).norm() < 1e-4);
        assert_eq!(flight.setpoints(0.05), [[1.0, -0.5, -0.25, 0.125]], "velocities are the same in both frames");
        // 0.9 m is what a vehicle may do between two words.
        flight.position[0] += 0.9;
        flight.run(0.1);
        assert_eq!(flight.bench.companion.counters().jumps, 1);
    }
}

#[test]
fn a_jump_is_told_once_control_is_given_and_not_before() {
    for (autopilot, mode, elsewhere) in [(ARDUPILOT, GUIDED, 5), (PX4, OFFBOARD, 3 << 16)] {
        let mut flight = Flight::of(autopilot);
        for (mode, base_mode, is_told) in
            [(elsewhere, DISARMED, false), (elsewhere, ARMED, false), (mode, DISARMED, false), (mode, ARMED, true)]
        {
            flight.bench.heartbeat = Some(heartbeat(autopilot, mode, base_mode));
            flight.run(2.5);
            let jumps = flight.bench.companion.counters().jumps;
            flight.position[0] += 3.0;
            let told = flight.texts(3.0).contains(&"Foxhound: position or heading jumped".to_owned());
            assert_eq!(flight.bench.companion.counters().jumps, jumps + 1);
            assert_eq!(told, is_told, "autopilot {autopilot}, mode {mode:#x}, base mode {base_mode:#x}");
        }
    }
}

#[test]
fn a_turn_of_the_heading_turns_the_setpoints_and_not_what_guidance_knows() {
    for autopilot in BOTH {
        let mut flight = Flight::of(autopilot);
        let before = flight.bench.companion.ownship().unwrap();
        flight.yaw += std::f32::consts::FRAC_PI_2;
        flight.run(0.6);
        let after = flight.bench.companion.ownship().unwrap();
        assert!((after.yaw_rad - before.yaw_rad).abs() < 1e-6);
        assert!(after.position_ned_m.horizontal().minus(before.position_ned_m.horizontal()).norm() < 1e-4);
        let [north, east, down, rate] = flight.setpoints(0.05)[0];
        // [1, -0.5] turned by a quarter, clockwise.
        assert!((north - 0.5).abs() < 1e-6 && (east - 1.0).abs() < 1e-6, "{north} {east}");
        assert_eq!((down, rate), (-0.25, 0.125));
    }
}

#[test]
fn announced_resets_count_however_small_they_are() {
    let odometry = |reset_counter| MavMessage::ODOMETRY(ODOMETRY_DATA { reset_counter, ..ODOMETRY_DATA::DEFAULT });
    let origin = |latitude, altitude| {
        let data = GPS_GLOBAL_ORIGIN_DATA { latitude, altitude, ..GPS_GLOBAL_ORIGIN_DATA::DEFAULT };
        MavMessage::GPS_GLOBAL_ORIGIN(data)
    };
    let mut flight = Flight::of(PX4);
    for (count, announce) in [
        (0, odometry(3)),
        (0, origin(5, 0)),
        (1, odometry(4)),
        (2, origin(15, 0)),
        (2, odometry(4)),
        (2, origin(14, 900)),
    ] {
        let before = flight.bench.companion.ownship().unwrap().position_ned_m;
        flight.bench.say(&announce);
        if flight.bench.companion.counters().jumps > 0 && count != 2 {
            flight.position[1] += 0.25;
        }
        flight.run(0.6);
        assert_eq!(flight.bench.companion.counters().jumps, count);
        let after = flight.bench.companion.ownship().unwrap().position_ned_m;
        assert!((after.east - before.east).abs() < 1e-5, "{announce:?}");
    }
}

#[test]
fn an_autopilot_without_rates_may_turn_as_fast_as_it_was_told_to() {
    let mut flight = Flight::of(ARDUPILOT);
    // 10 Hz, 20 degrees from one to the next, and never a word of the rate.
    for _ in 0..36 {
        flight.yaw = foxhound_core::base::units::wrap_pi(flight.yaw + 20.0_f32.to_radians());
        flight.bench.now_us += 80_000;
        flight.run(0.02);
    }
    assert_eq!(flight.bench.companion.counters().jumps, 0);
}

#[test]
fn small_jumps_that_go_on_and_on_are_no_jumps_of_an_estimate_and_take_ownship_away() {
    // 0.2 m ten times a second, while the velocity says 5 cm/s.
    let mut bench = Bench::flying();
    let mut lost = 0;
    for step in 0..100_u32 {
        let data = LOCAL_POSITION_NED_DATA {
            time_boot_ms: 1_000 + step * 100,
            x: step as f32 * 0.2,
            vx: 0.05,
            ..LOCAL_POSITION_NED_DATA::DEFAULT
        };
        bench.run(0.1);
        bench.say(&MavMessage::LOCAL_POSITION_NED(data));
        bench.say(&attitude(1_000 + step * 100, 0.25));
        lost += u32::from(bench.companion.ownship().is_none());
        assert!(step < 5 || bench.companion.ownship().is_none(), "{step}");
    }
    assert!(lost > 90, "{lost}");
    // Two that are far apart are followed.
    let mut flight = Flight::of(PX4);
    for _ in 0..2 {
        flight.position[1] += 0.3;
        flight.run(3.0);
        assert!(flight.bench.companion.ownship().is_some());
    }
    assert_eq!(flight.bench.companion.counters().jumps, 0);
}

#[test]
fn ownship_that_contradicts_itself_is_told_by_its_name_and_once() {
    for (stale, text) in [
        (Stale::VelocityContradicts, "Foxhound: velocity contradicts position, holds"),
        (Stale::PositionFrozen, "Foxhound: position stands still, holds"),
        (Stale::PositionOld, "Foxhound: position or attitude is stale"),
    ] {
        let mut flight = Flight::of(ARDUPILOT);
        flight.run(2.0);
        flight.bench.take_sent();
        let output = flight.bench.output.as_mut().unwrap();
        (output.outcome, output.stale) = (Outcome::StaleOwnship, Some(stale));
        assert_eq!(flight.texts(20.0), [text]);
    }
}

#[test]
fn a_message_that_a_later_one_has_overtaken_is_dropped() {
    let mut bench = Bench::flying();
    bench.run(0.1);
    let place = |time_boot_ms: u32| {
        let x = time_boot_ms as f32 * 1e-3;
        let data = LOCAL_POSITION_NED_DATA { time_boot_ms, x, vx: 1.0, ..LOCAL_POSITION_NED_DATA::DEFAULT };
        MavMessage::LOCAL_POSITION_NED(data)
    };
    for step in 0..200_u32 {
        bench.say(&place(10_000 + 20 * step));
        bench.say(&attitude(10_000 + 20 * step, 0.5));
        if step == 100 {
            bench.say(&place(10_000 + 20 * step - 300));
            bench.say(&attitude(10_000 + 20 * step - 300, -0.5));
        }
        bench.step(20_000);
    }
    assert_eq!((bench.companion.counters().jumps, bench.companion.counters().rejected), (0, 2));
    let ownship = bench.companion.ownship().unwrap();
    assert!((ownship.position_ned_m.north - 13.98).abs() < 1e-3 && (ownship.yaw_rad - 0.5).abs() < 1e-6);
}
