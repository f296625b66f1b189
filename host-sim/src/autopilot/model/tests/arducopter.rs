//! ArduCopter.

use super::super::Start;
use super::super::arducopter::{AUTO, BRAKE, GUIDED, LAND, LOITER, RTL, STABILIZE};
use super::*;
use crate::scenario::Software;

/// The velocity of `target`.
const NORTH_EAST: [f64; 3] = [1.0, 2.0, -0.5];

#[test]
fn velocities_with_a_yaw_or_a_yaw_rate_are_obeyed_and_any_other_setpoint_stops_it() {
    for (mask, frame, wanted) in [
        (0x05C7, 1, Some(0.25)),
        (0x09C7, 1, Some(-1.05)),
        (0x05C7, 8, None),
        (0x09C7, 7, None),
        (0x0DC7, 1, None),
        (0x0DF8, 1, None),
        (0x05FF, 1, None),
    ] {
        let mut autopilot = Autopilot::default();
        assert!(!obey(&mut autopilot, &target(0x05C7, 1)).is_brake);
        let told = obey(&mut autopilot, &target(mask, frame));
        let command = (!told.is_brake).then_some((told.velocity_ned_mps, told.yaw_rate_radps));
        assert_eq!(command, wanted.map(|rate_radps| (NORTH_EAST, rate_radps)), "mask {mask:#06x}, frame {frame}");
        assert_eq!(autopilot.custom_mode, GUIDED);
    }
}

#[test]
fn velocities_that_are_not_sane_stop_it_even_where_another_field_is_good() {
    for bad in [f32::NAN, f32::INFINITY, 1000.5, -1e9] {
        for axis in 0..3 {
            let mut setpoint = target(0x05C7, 1);
            *[&mut setpoint.vx, &mut setpoint.vy, &mut setpoint.vz][axis] = bad;
            let mut autopilot = Autopilot::default();
            obey(&mut autopilot, &target(0x05C7, 1));
            assert!(obey(&mut autopilot, &setpoint).is_brake, "{bad} on axis {axis}");
        }
    }
    let mut ignored = target(0x05C7, 1);
    ignored.x = f32::NAN;
    ignored.afx = f32::NAN;
    assert!(!obey(&mut Autopilot::default(), &ignored).is_brake, "what is ignored may be anything");
}

#[test]
fn a_velocity_is_obeyed_in_guided_armed_and_in_the_air_only() {
    let told = obey(&mut Autopilot::default(), &target(0x05C7, 1));
    assert_eq!((told.velocity_ned_mps, told.yaw_rate_radps, told.is_brake), (NORTH_EAST, 0.25, false));
    let modes = [STABILIZE, AUTO, LOITER, BRAKE].map(|mode| (mode, true, false));
    for (custom_mode, armed, landed) in modes.into_iter().chain([(GUIDED, false, false), (GUIDED, true, true)]) {
        let mut autopilot = Autopilot { custom_mode, armed, ..Autopilot::default() };
        autopilot.receive(0, &eastward(PLACE), &[]);
        autopilot.set_landed(landed);
        assert!(obey(&mut autopilot, &target(0x05C7, 1)).is_brake, "{custom_mode} {armed} {landed}");
        assert!(heard(&mut autopilot).is_empty(), "without a word");
        autopilot.custom_mode = GUIDED;
        autopilot.armed = true;
        autopilot.set_landed(false);
        autopilot.receive(0, &eastward(PLACE), &[]);
        assert!(autopilot.command(0).is_brake, "what came outside the mode is not kept");
    }
}

#[test]
fn what_was_asked_before_the_mode_was_left_is_not_done_when_it_comes_back() {
    let mut autopilot = Autopilot::default();
    obey(&mut autopilot, &target(0x05C7, 1));
    for mode in [BRAKE, GUIDED] {
        assert!(autopilot.select_mode(0, mode));
        assert!(autopilot.command(0).is_brake);
    }
}

#[test]
fn setpoints_for_others_are_not_obeyed() {
    for (system, component, is_obeyed) in [(1, 1, true), (0, 0, true), (1, 0, true), (2, 1, false), (1, 191, false)] {
        let mut setpoint = target(0x05C7, 1);
        (setpoint.target_system, setpoint.target_component) = (system, component);
        assert_eq!(!obey(&mut Autopilot::default(), &setpoint).is_brake, is_obeyed, "{system} {component}");
    }
}

#[test]
fn velocities_are_held_for_guid_timeout() {
    let mut autopilot = Autopilot::default();
    for timeout_s in [3.0, 1.0] {
        autopilot.set_parameter("GUID_TIMEOUT", timeout_s);
        obey(&mut autopilot, &target(0x05C7, 1));
        let end_us = (timeout_s * 1e6) as u64;
        assert!(!autopilot.command(end_us - 1).is_brake);
        assert!(autopilot.command(end_us).is_brake);
        assert_eq!(autopilot.custom_mode, GUIDED, "it brakes and stays");
    }
}

#[test]
fn it_takes_off_on_command_and_not_on_a_velocity() {
    let mut flown = Flown::new(Autopilot::new(Software::ArduCopter, Start::Parked), Start::Parked);
    assert_eq!(flown.order(&command(22, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0])), 4, "not in GUIDED");
    assert_eq!(flown.order(&command(176, [1.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0])), 0);
    assert_eq!(flown.order(&command(22, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0])), 4, "not armed");
    assert_eq!(flown.order(&command(400, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])), 0);
    let mut up = target(0x05C7, 1);
    (up.vx, up.vy, up.vz) = (0.0, 0.0, -1.0);
    flown.fly(2.0, |_| bytes(&up));
    assert!(flown.place()[2].abs() < 0.01, "{:?}", flown.place());
    assert!(flown.autopilot.flight.landed);
    assert_eq!(flown.order(&command(22, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0])), 0);
    flown.idle(12.0);
    assert!((flown.place()[2] + 5.0).abs() < 0.2 && flown.speed_mps() < 0.1, "{:?}", flown.place());
    assert!(!flown.autopilot.flight.landed);
    flown.fly(1.0, |_| bytes(&target(0x05C7, 1)));
    assert!(flown.speed_mps() > 1.0, "and in the air it obeys");
}

#[test]
fn a_setpoint_during_the_take_off_ends_it() {
    let mut flown = Flown::new(Autopilot::new(Software::ArduCopter, Start::Parked), Start::Parked);
    flown.order(&command(176, [1.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    flown.order(&command(400, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    flown.order(&command(22, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0]));
    flown.idle(2.0);
    let mut still = target(0x05C7, 1);
    (still.vx, still.vy, still.vz) = (0.0, 0.0, 0.0);
    flown.fly(8.0, |_| bytes(&still));
    assert!(flown.place()[2] > -3.0 && flown.place()[2] < -0.5, "{:?}", flown.place());
}

#[test]
fn it_lands_and_disarms() {
    let mut flown = Flown::new(Autopilot::default(), Start::InControl);
    assert_eq!(flown.order(&command(400, [0.0; 7])), 4, "not disarmed in the air");
    assert_eq!(flown.order(&command(21, [0.0; 7])), 0);
    assert_eq!(flown.autopilot.custom_mode, LAND);
    flown.idle(15.0);
    assert!(flown.place()[2].abs() < 0.05 && flown.autopilot.flight.landed && !flown.autopilot.armed);
    assert_eq!(flown.order(&command(400, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])), 4, "not armed in LAND");
}

#[test]
fn it_returns_where_it_came_from_and_lands_there() {
    let mut flown = Flown::new(Autopilot::default(), Start::InControl);
    let mut north = target(0x05C7, 1);
    (north.vx, north.vy, north.vz, north.yaw_rate) = (3.0, 0.0, 0.0, 0.0);
    flown.fly(6.0, |_| bytes(&north));
    assert!(flown.place()[0] > 10.0);
    assert!(flown.autopilot.select_mode(flown.now_us(), RTL));
    let mut highest_m = 0.0_f64;
    for _ in 0..90 {
        flown.idle(1.0);
        highest_m = highest_m.max(-flown.place()[2]);
    }
    assert!(highest_m > 14.0, "by way of RTL_ALT: {highest_m}");
    let [north_m, east_m, down_m] = flown.place();
    assert!(north_m.abs() < 0.7 && east_m.abs() < 0.7 && down_m.abs() < 0.05, "{:?}", flown.place());
    assert!(!flown.autopilot.armed);
}

#[test]
fn only_modes_that_it_has_are_entered_and_not_without_a_place() {
    let mut autopilot = Autopilot::default();
    assert!(!autopilot.select_mode(0, 99));
    autopilot.faults.filter_is_bad = true;
    assert!(!autopilot.select_mode(0, LOITER) && autopilot.select_mode(0, LAND));
    assert_eq!(texts(&mut autopilot).len(), 2, "refusals are told");
}

#[test]
fn nothing_but_heartbeats_and_time_comes_until_a_message_is_asked_for() {
    let mut autopilot = Autopilot::default();
    for tick in 0..100 {
        autopilot.telemetry(tick * TICK_US, &Motion::default(), false);
    }
    assert_eq!(heard_ids(&mut autopilot), [0, 0, 111]);
    autopilot.receive(2_000_000, &Motion::default(), &bytes(&command(511, [32.0, 2e4, 0.0, 0.0, 0.0, 0.0, 0.0])));
    assert_eq!(results(&mut autopilot), [0], "acknowledged");
    for tick in 100..150 {
        autopilot.telemetry(tick * TICK_US, &Motion::default(), false);
    }
    assert_eq!(heard_ids(&mut autopilot).iter().filter(|id| **id == 32).count(), 50);
    autopilot.telemetry(3_000_000, &Motion::default(), true);
    assert!(!heard_ids(&mut autopilot).contains(&32), "a silent position is silent");
}
