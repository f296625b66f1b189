//! How high the vehicle is over the ground, and when the autopilot is asked to land.

use foxhound_core::base::ned::Ned;
use foxhound_core::guidance::Output;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::landing::{self, Reason, Stage, Target};
use foxhound_link::companion::Config;
use foxhound_link::dialect::*;

use crate::bench::*;

const NAV_LAND: u16 = 21;
const BRAKE: u32 = 17;

fn range_finder(orientation: u8, current_distance: u16) -> MavMessage {
    MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA {
        orientation,
        current_distance,
        min_distance: 20,
        max_distance: 1200,
        ..DISTANCE_SENSOR_DATA::DEFAULT
    })
}

fn tilted(bench: &mut Bench, roll: f32, pitch: f32) {
    let time_boot_ms = (bench.now_us / 1000) as u32;
    bench.say(&MavMessage::ATTITUDE(ATTITUDE_DATA { time_boot_ms, roll, pitch, ..ATTITUDE_DATA::DEFAULT }));
}

#[test]
fn the_height_is_what_the_range_finder_says_with_the_tilt_taken_off() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    assert_eq!(bench.companion.height_m(bench.now()), None, "nobody said");
    for (roll, pitch, height_m) in [
        (0.0_f32, 0.0_f32, 3.0_f64),
        (0.3, 0.0, 3.0 * 0.3_f64.cos()),
        (0.0, -0.4, 3.0 * 0.4_f64.cos()),
        (-0.3, 0.4, 3.0 * 0.3_f64.cos() * 0.4_f64.cos()),
    ] {
        tilted(&mut bench, roll, pitch);
        bench.say(&range_finder(25, 300));
        let found_m = bench.companion.height_m(bench.now()).unwrap();
        assert!((f64::from(found_m) - height_m).abs() < 1e-4, "{roll} {pitch}: {found_m} m, not {height_m} m");
        bench.step(100_000);
    }
}

#[test]
fn a_height_is_none_without_attitude_and_when_either_is_old() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    bench.say(&range_finder(25, 300));
    assert_eq!(bench.companion.height_m(bench.now()), None, "nobody knows how it is tilted");
    tilted(&mut bench, 0.0, 0.0);
    assert_eq!(bench.companion.height_m(bench.now()), Some(3.0));
    // The attitude goes on, the range finder does not.
    for _ in 0..6 {
        bench.run(0.1);
        tilted(&mut bench, 0.0, 0.0);
    }
    assert_eq!(bench.companion.height_m(bench.now()), None, "it is 0.6 s old");
    // The range finder goes on, the attitude does not.
    for _ in 0..6 {
        bench.run(0.1);
        bench.say(&range_finder(25, 300));
    }
    assert_eq!(bench.companion.height_m(bench.now()), None, "the attitude is 0.6 s old");
    tilted(&mut bench, 0.0, 0.0);
    assert_eq!(bench.companion.height_m(bench.now()), Some(3.0));
}

#[test]
fn only_a_reading_that_looks_down_is_a_height_and_it_is_no_obstacle() {
    let mut bench = Bench::flying();
    bench.step(10_000);
    tilted(&mut bench, 0.0, 0.0);
    for (orientation, distance) in [(0, 300), (24, 300), (25, 19), (25, 1201), (25, 0)] {
        bench.say(&range_finder(orientation, distance));
        assert_eq!(bench.companion.height_m(bench.now()), None, "orientation {orientation}, {distance} cm");
    }
    bench.take_points();
    bench.say(&range_finder(25, 300));
    assert_eq!(bench.take_points(), None);
    assert_eq!(bench.companion.height_m(bench.now()), Some(3.0));
    bench.say_as((2, 1), &range_finder(25, 700));
    assert_eq!(bench.companion.height_m(bench.now()), Some(3.0), "another system's height is not ours");
}

fn above_the_beacon(wants_land: bool) -> Output {
    handed_over(Reason::Arrived, wants_land)
}

fn handed_over(reason: Reason, wants_land: bool) -> Output {
    let target = Target { place_ned_m: Ned { north: 1.0, east: 2.0, down: 0.0 }, sigma_m: 0.1, is_pad: false };
    let advice = landing::Output {
        stage: Stage::HandedOver,
        demand: None,
        reason: Some(reason),
        target: Some(target),
        wants_land,
    };
    Output { outcome: Outcome::HandedOver, landing: Some(advice), ..output([0.0; 3], 0.0) }
}

fn asked_to_land(bench: &mut Bench, seconds: f64) -> Vec<u64> {
    bench.take_sent();
    bench.run(seconds);
    let of_landing = bench.commands().into_iter().filter(|(_, command)| command.command == NAV_LAND);
    of_landing
        .map(|(at_us, command)| {
            assert_eq!((command.target_system, command.target_component), AUTOPILOT);
            at_us
        })
        .collect()
}

#[test]
fn the_autopilot_is_asked_to_land_where_guidance_wants_that_and_the_mode_is_ours() {
    let mut bench = Bench::flying();
    assert_eq!(asked_to_land(&mut bench, 3.0), [0; 0], "on the way");
    bench.output = Some(above_the_beacon(false));
    assert_eq!(asked_to_land(&mut bench, 3.0), [0; 0], "the user does not want it");
    bench.output = Some(above_the_beacon(true));
    let asked = asked_to_land(&mut bench, 10.0);
    assert_eq!(asked.len(), 5);
    assert!(asked.windows(2).all(|pair| pair[1] - pair[0] >= 900_000), "{asked:?}");
    // Since the last heartbeat the pilot may have chosen another mode.
    for silent in [false, true] {
        let mut bench = Bench::flying();
        bench.output = Some(above_the_beacon(false));
        bench.run(1.5);
        let heartbeat = bench.heartbeat.take_if(|_| silent);
        bench.run(0.3);
        bench.output = Some(above_the_beacon(true));
        assert_eq!(asked_to_land(&mut bench, 1.5).is_empty(), silent);
        bench.heartbeat = heartbeat.or(bench.heartbeat);
        assert!(!asked_to_land(&mut bench, 1.1).is_empty());
    }
}

#[test]
fn in_another_mode_or_disarmed_nobody_is_asked_to_land() {
    for (autopilot, mode, base_mode) in
        [(ARDUPILOT, BRAKE, ARMED), (ARDUPILOT, GUIDED, DISARMED), (PX4, 3 << 16, ARMED), (20, GUIDED, ARMED)]
    {
        let mut bench = Bench::new(Config::default());
        bench.heartbeat = Some(heartbeat(autopilot, mode, base_mode));
        bench.output = Some(above_the_beacon(true));
        assert_eq!(asked_to_land(&mut bench, 5.0), [0; 0], "autopilot {autopilot}, mode {mode}, base mode {base_mode}");
    }
}

#[test]
fn the_pilots_word_ends_the_asking_and_so_does_a_guidance_that_is_silent() {
    let mut bench = Bench::flying();
    bench.output = Some(above_the_beacon(true));
    assert!(!asked_to_land(&mut bench, 1.5).is_empty());
    bench.heartbeat = Some(heartbeat(ARDUPILOT, BRAKE, ARMED));
    bench.run(1.1);
    assert_eq!(asked_to_land(&mut bench, 5.0), [0; 0], "the pilot has it");
    // It has landed, and takes off again for the next search, of which guidance does not know yet.
    bench.heartbeat = Some(heartbeat(ARDUPILOT, GUIDED, ARMED));
    bench.run(1.1);
    assert_eq!(asked_to_land(&mut bench, 5.0), [0; 0], "that landing is over");

    let mut bench = Bench::flying();
    bench.output = Some(above_the_beacon(true));
    assert!(!asked_to_land(&mut bench, 1.5).is_empty());
    bench.output = None;
    bench.run(0.3);
    assert_eq!(asked_to_land(&mut bench, 5.0), [0; 0], "nobody wants it any more");
}

#[test]
fn the_pad_is_told_as_seen_where_targets_are_wanted() {
    let mut bench = Bench::new(Config { landing_target: true, ..Config::default() });
    bench.heartbeat = Some(heartbeat(PX4, OFFBOARD, ARMED));
    let mut output = above_the_beacon(false);
    let target = Target { place_ned_m: Ned { north: 2.0, east: 2.0, down: 0.0 }, sigma_m: 0.05, is_pad: true };
    output.landing =
        output.landing.map(|advice| landing::Output { stage: Stage::Centring, target: Some(target), ..advice });
    bench.output = Some(output);
    let mut told = Vec::new();
    for _ in 0..50 {
        bench.run(0.02);
        let time_boot_ms = (bench.now_us / 1000) as u32;
        bench.say(&position(time_boot_ms));
        bench.say(&attitude(time_boot_ms, 0.0));
        told.extend(bench.take_sent().into_iter().filter_map(|sent| match sent.message {
            MavMessage::LANDING_TARGET(target) => Some((target.mavtype, target.frame, [target.x, target.y, target.z])),
            _ => None,
        }));
    }
    // VISION_OTHER, LOCAL_NED.
    assert!(told.len() >= 8 && told.iter().all(|it| *it == (3, 1, [2.0, 2.0, 0.0])), "{told:?}");
}

/// The texts of the next while, with their severity.
fn told(bench: &mut Bench, seconds: f64) -> Vec<(u8, String)> {
    bench.take_sent();
    bench.run(seconds);
    let text = |sent: Sent| match sent.message {
        MavMessage::STATUSTEXT(text) => Some((text.severity, text.text.to_str().unwrap().to_owned())),
        _ => None,
    };
    bench.take_sent().into_iter().filter_map(text).collect()
}

#[test]
fn the_pilot_reads_why_it_hovers() {
    const NOTICE: u8 = 5;
    const WARNING: u8 = 4;
    for (reason, severity, text) in [
        (Reason::Arrived, NOTICE, "Foxhound: arrived, hovers, take over"),
        (Reason::NoPad, WARNING, "Foxhound: no pad here, hovers, take over"),
        (Reason::PadLost, WARNING, "Foxhound: pad lost, hovers, take over"),
        (Reason::NoCamera, WARNING, "Foxhound: no picture, hovers, take over"),
        (Reason::NoHeight, WARNING, "Foxhound: height unknown, hovers, take over"),
        (Reason::Ambiguous, WARNING, "Foxhound: beacon not located, hovers, take over"),
        (Reason::SearchLimit, WARNING, "Foxhound: beacon not found, hovers, take over"),
        (Reason::TimeLimit, WARNING, "Foxhound: time limit, hovers, take over"),
        (Reason::Blocked, WARNING, "Foxhound: path blocked, hovers, take over"),
    ] {
        let mut bench = Bench::flying();
        bench.answers = true;
        bench.run(2.0);
        bench.output = Some(handed_over(reason, false));
        assert_eq!(told(&mut bench, 20.0), [(severity, text.to_owned())], "{reason:?}");
    }
}

#[test]
fn the_pilot_reads_that_the_autopilot_is_asked_to_land_and_when_it_does_not() {
    let mut bench = Bench::flying();
    bench.answers = true;
    bench.run(2.0);
    bench.output = Some(above_the_beacon(true));
    let asks = "Foxhound: arrived, asks the autopilot to land".to_owned();
    assert_eq!(told(&mut bench, 5.0), [(5, asks)]);
    assert_eq!(told(&mut bench, 20.0), [(2, "Foxhound: autopilot does not land, take over".to_owned())]);
}
