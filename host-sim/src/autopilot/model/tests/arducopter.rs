//! ArduCopter.

use super::super::Start;
use super::super::arducopter::{AUTO, BRAKE, GUIDED, LAND, LOITER, RTL, STABILIZE};
use super::*;
use crate::scenario::Software;

fn near(left: [f64; 3], right: [f64; 3]) -> bool {
    left.iter().zip(right).all(|(l, r)| (l - r).abs() < 1e-6)
}

/// Velocities turned by a nose to the east.
const NORTH_EAST: [f64; 3] = [1.0, 2.0, -0.5];
const TURNED: [f64; 3] = [-2.0, 1.0, -0.5];

/// What the vehicle is told; none stops it.
type Told = Option<[f64; 3]>;

#[test]
fn every_mask_in_every_frame_does_what_it_does_there() {
    // What the vehicle is told with each mask in frames 1, 7, 8, 9, from (1, 2, -5) with the nose to the east. `None`
    // stops it. A place is flown to at 1 m/s a metre, 5 m/s at most (1 m/s up and down), and the offset in a frame is
    // (3, 4, -6), turned: (-4, 3, -6). An acceleration is half a second of it.
    let to_place = [2.0, 2.0, -1.0];
    let by_offset = [3.0, 4.0, -1.0];
    let by_turned_offset = [-4.0, 3.0, -1.0];
    let plus = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    let all = |v: [f64; 3], turned: [f64; 3]| [Some(v), Some(v), Some(turned), Some(turned)];
    let stops = [None; 4];
    let velocity = all(NORTH_EAST, TURNED);
    let rows: [(u16, &str, [Told; 4]); 17] = [
        (0x05C7, "velocity and yaw rate", velocity),
        (0x09C7, "velocity and yaw", velocity),
        (0x0DC7, "velocity", velocity),
        (0x01C7, "velocity, yaw and yaw rate", velocity),
        (0x0C07, "velocity and acceleration", velocity),
        (0x07C7, "velocity, and a force bit without an acceleration", velocity),
        (0x0607, "velocity and a force", stops),
        (0x0DF8, "place", [Some(to_place), Some(by_offset), Some(by_turned_offset), Some(by_turned_offset)]),
        (
            0x0DC0,
            "place and velocity",
            [
                Some(plus(to_place, NORTH_EAST)),
                Some(plus(by_offset, NORTH_EAST)),
                Some(plus(by_turned_offset, TURNED)),
                Some(plus(by_turned_offset, TURNED)),
            ],
        ),
        (
            0x0C00,
            "everything",
            [
                Some(plus(to_place, NORTH_EAST)),
                Some(plus(by_offset, NORTH_EAST)),
                Some(plus(by_turned_offset, TURNED)),
                Some(plus(by_turned_offset, TURNED)),
            ],
        ),
        (0x0C3F, "acceleration", all([0.25, -0.125, -0.0625], [0.125, 0.25, -0.0625])),
        (0x0C38, "place and acceleration", stops),
        (0x05CF, "velocity without north", stops),
        (0x05E3, "velocity of north and east with a height", stops),
        (0x09FF, "yaw", stops),
        (0x05FF, "yaw rate", stops),
        (0x0FFF, "nothing", stops),
    ];
    for (mask, what, wanted) in rows {
        for (frame, wanted) in [1, 7, 8, 9].into_iter().zip(wanted) {
            let mut autopilot = Autopilot::default();
            assert!(!obey(&mut autopilot, &target(0x05C7, 1)).is_brake);
            let command = obey(&mut autopilot, &target(mask, frame));
            let name = format!("{what}, mask {mask:#06x}, frame {frame}: {command:?}");
            match wanted {
                Some(velocity) => assert!(!command.is_brake && near(command.velocity_ned_mps, velocity), "{name}"),
                None => assert!(command.is_brake && command.velocity_ned_mps == [0.0; 3], "{name}"),
            }
            assert_eq!(autopilot.custom_mode, GUIDED, "{name}");
        }
    }
}

#[test]
fn frames_other_than_1_7_8_and_9_stop_it() {
    for frame in (0..=21).filter(|frame| ![1, 7, 8, 9].contains(frame)) {
        let mut autopilot = Autopilot::default();
        obey(&mut autopilot, &target(0x05C7, 1));
        assert!(obey(&mut autopilot, &target(0x05C7, frame)).is_brake, "frame {frame}");
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
fn velocities_are_held_for_guid_timeout_and_places_for_ever() {
    let mut autopilot = Autopilot::default();
    for (mask, timeout_s) in [(0x05C7, 3.0), (0x0C3F, 3.0), (0x05C7, 1.0)] {
        autopilot.set_parameter("GUID_TIMEOUT", timeout_s);
        obey(&mut autopilot, &target(mask, 1));
        let end_us = (timeout_s * 1e6) as u64;
        assert!(!autopilot.command(end_us - 1).is_brake);
        assert!(autopilot.command(end_us).is_brake);
        assert_eq!(autopilot.custom_mode, GUIDED, "it brakes and stays");
    }
    obey(&mut autopilot, &target(0x0DF8, 1));
    assert_eq!(autopilot.command(99_000_000).velocity_ned_mps, [2.0, 2.0, -1.0]);
    obey(&mut autopilot, &target(0x05C0, 1));
    let late = autopilot.command(99_000_000);
    assert_eq!((late.velocity_ned_mps, late.yaw_rate_radps), ([2.0, 2.0, -1.0], 0.0), "the place stays");
}

#[test]
fn without_yaw_the_nose_turns_to_the_direction_of_travel_unless_told_not_to() {
    let mut flown = Flown::new(Autopilot::default(), Start::InControl);
    let mut west = target(0x0DC7, 1);
    (west.vx, west.vy, west.vz) = (0.0, -1.0, 0.0);
    flown.fly(6.0, |_| bytes(&west));
    let yaw_rad = flown.vehicle.motion.pose.yaw_rad;
    assert!((yaw_rad + std::f64::consts::FRAC_PI_2).abs() < 0.05, "{yaw_rad}");
    let mut autopilot = Autopilot::default();
    autopilot.set_parameter("WP_YAW_BEHAVIOR", 0.0);
    assert_eq!(obey(&mut autopilot, &target(0x0DC7, 1)).yaw_rate_radps, 0.0);
}

#[test]
fn a_relative_yaw_that_is_sent_again_and_again_is_a_spin() {
    let turned_rad = |frame: u8| {
        let mut flown = Flown::new(Autopilot::default(), Start::InControl);
        let mut setpoint = target(0x09C7, frame);
        (setpoint.vx, setpoint.vy, setpoint.vz) = (0.0, 0.0, 0.0);
        let mut turned_rad = 0.0;
        for _ in 0..100 {
            flown.fly(0.1, |now_us| if now_us % 100_000 == 0 { bytes(&setpoint) } else { Vec::new() });
            turned_rad += 0.1 * flown.vehicle.motion.yaw_rate_radps;
        }
        turned_rad
    };
    assert!((turned_rad(1) - 0.5).abs() < 0.2, "{}", turned_rad(1));
    assert!(turned_rad(8) > 6.0, "{}", turned_rad(8));
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
fn its_target_is_read_back_in_guided_only_in_frame_1_and_without_yaw() {
    let mut autopilot = Autopilot::default();
    obey(&mut autopilot, &target(0x05C7, 8));
    let ask = bytes(&command(512, [85.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    autopilot.receive(0, &eastward(PLACE), &ask);
    let said = heard(&mut autopilot);
    let Some(MavMessage::POSITION_TARGET_LOCAL_NED(back)) = said.first().map(|(_, message)| message.clone()) else {
        panic!("{said:?}")
    };
    assert_eq!((back.coordinate_frame, back.type_mask, back.yaw, back.yaw_rate), (1, 0x0DC7, 0.0, 0.0));
    assert!((back.vx + 2.0).abs() < 1e-6 && (back.vy - 1.0).abs() < 1e-6, "turned: {back:?}");
    autopilot.select_mode(0, LOITER);
    autopilot.receive(0, &eastward(PLACE), &ask);
    assert_eq!(results(&mut autopilot), [4], "FAILED");
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
