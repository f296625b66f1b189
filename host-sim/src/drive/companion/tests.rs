use super::*;
use crate::scenario::params::Given;

#[test]
fn an_obstacle_file_is_read_strictly() {
    let read = parse_obstacles(r#"{"obstacles":[{"x":1,"y":2.5,"r":0.3},{"x":-1,"y":0,"r":1}]}"#).unwrap();
    assert_eq!((read.len(), read[0].x, read[0].y, read[1].x), (2, 1.0, 2.5, -1.0));
    assert!(parse_obstacles(r#"{"obstacles":[]}"#).unwrap().is_empty());
    // Where the vehicle starts, only the autopilot knows.
    assert_eq!(parse_obstacles(r#"{"obstacles":[{"x":1,"y":1,"r":0.3}]}"#).unwrap().len(), 1);
    for (text, words) in [
        (r#"{"obstacles":[{"x":1,"y":2,"r":0.3,"h":4}]}"#, "obstacles[0].h: unknown key"),
        (r#"{"obstacels":[]}"#, "obstac"),
        (r#"{"obstacles":[{"x":1,"y":2}]}"#, "obstacles[0]"),
        (r#"{"obstacles":[{"x":1,"y":2,"r":-1}]}"#, "obstacles[0].r = -1 is outside"),
        (r#"{"obstacles":[{"x":"1","y":2,"r":1}]}"#, "obstacles[0].x"),
        (r#"{"obstacles":[[1,2,0.3]]}"#, "obstacles[0]: expected an object"),
        (r#"[]"#, "the file: expected an object"),
        (r#"{"obstacles":[]} {}"#, "trailing"),
        ("", "EOF"),
    ] {
        let error = parse_obstacles(text).unwrap_err().to_string();
        assert!(error.contains(words), "{text}: {error}");
    }
}

pub(super) fn config() -> Config {
    Config {
        source_ned_m: [8.0, 0.0, -5.0],
        pad_ne_m: None,
        is_source_known: true,
        obstacles: Provider::default(),
        v_max_mps: 2.0,
        ends: Ends::Near,
        drone_radius_m: 0.15,
        sensor: scenario::Sensor::default(),
        snr_db: 20.0,
        seed: 1,
        planner: planner::Config::default(),
        estimator: Estimator::CrossSpectrum,
        max_time_s: None,
        key: None,
    }
}

#[test]
fn an_option_out_of_range_is_named() {
    assert!(config().checked().is_ok());
    let refused = |config: Config| config.checked().unwrap_err().to_string();
    assert!(refused(Config { v_max_mps: 0.0, ..config() }).starts_with("--v-max = 0 is outside"));
    assert!(refused(Config { source_ned_m: [0.0, f64::NAN, 0.0], ..config() }).starts_with("--source: E = NaN"));
    assert!(refused(Config { drone_radius_m: -1.0, ..config() }).starts_with("--drone-radius"));
    assert!(refused(Config { snr_db: 99.0, ..config() }).starts_with("--snr-db"));
    assert!(refused(Config { max_time_s: Some(-1.0), ..config() }).starts_with("--max-time"));
}

#[test]
fn the_guard_keeps_the_limit_with_room_for_rounding() {
    let guidance = config().guidance();
    assert!(guidance.guard.v_max_mps < 2.0 && guidance.guard.v_max_mps > 1.999);
    assert!(guidance.known_source_ned_m.is_none(), "the beacon is heard, not told");
}

#[test]
fn a_speed_that_is_not_flown_is_told() {
    assert_eq!(Config { v_max_mps: 1.0, ..config() }.slower_than_asked_mps(), None);
    let fastest_mps = Config { v_max_mps: 5.0, ..config() }.slower_than_asked_mps().unwrap();
    assert!((1.2..1.35).contains(&fastest_mps), "{fastest_mps}");
}

#[test]
fn a_flight_that_is_to_hand_over_ends_after_that_and_one_that_is_to_land_when_the_autopilot_has_been_asked() {
    let at = |ms: u64| Instant(ms * 1000);
    for (ends, last_ms) in [(Ends::HandedOver, 1_000), (Ends::Landing, 6_000)] {
        let mut arrival = Arrival::new(ends);
        arrival.step(at(0), Outcome::Nominal, None);
        assert!(!arrival.has_ended(at(99_000), false), "the mode may be taken away on the way");
        arrival.step(at(1_000), Outcome::HandedOver, Some(Reason::Ambiguous));
        assert!(!arrival.is_there);
        arrival.step(at(1_500), Outcome::HandedOver, Some(Reason::Arrived));
        assert!(arrival.is_there);
        assert!(!arrival.has_ended(at(999 + last_ms), true) && arrival.has_ended(at(1_000 + last_ms), true));
        arrival.step(at(1_600), Outcome::NotInControl, None);
        assert!(arrival.has_ended(at(1_600), false) && arrival.is_there, "the autopilot lands");
        arrival.step(at(1_700), Outcome::Nominal, None);
        assert!(!arrival.has_ended(at(9_000), true), "a fresh entry seeks anew");
    }
}

#[test]
fn a_take_off_that_its_pilot_asks_for_in_guided_is_not_ended_by_our_setpoints() {
    use crate::autopilot::{Autopilot, GUIDED, Start};
    use crate::drive::computer::HostComputer;
    use crate::scenario::Software;
    use crate::world::Pose;
    use crate::world::vehicle::Vehicle;
    let mut computer = HostComputer::new(&config().guidance()).unwrap();
    let model = scenario::Vehicle { model: VehicleModel::Arducopter, ..scenario::Vehicle::default() };
    let mut vehicle = Vehicle::new(model, 2.0, Pose::default());
    let mut autopilot = Autopilot::new(Software::ArduCopter, Start::Parked);
    for step in 0..1000_u64 {
        let now_us = step * 20_000;
        let motion = vehicle.motion;
        if step == 100 {
            assert!(autopilot.select_mode(now_us, GUIDED) && autopilot.arm(now_us));
        }
        if step == 200 {
            assert!(autopilot.take_off(now_us, 5.0));
        }
        autopilot.telemetry(now_us, &motion, false);
        let rx = autopilot.transmit();
        let report = computer.step(Instant(now_us), FrontEnd::Nothing, Some(&[]), &rx).unwrap();
        autopilot.receive(now_us, &motion, &report.tx);
        vehicle.step(autopilot.command(now_us), TICK_S);
    }
    let down_m = vehicle.motion.pose.position_ned_m[2];
    assert!(down_m < -4.5, "it is {} m up", -down_m);
}
#[test]
fn a_parameter_of_the_landing_leaves_what_it_does_not_name_as_the_pad_makes_it() {
    let mut guidance = Config { pad_ne_m: Some([8.3, 0.2]), ..config() }.guidance();
    let before = guidance.landing.unwrap();
    assert!(before.has_camera && !before.request_land);
    let mut given = Given::default();
    given.assign("FH_LND_REQ=1").unwrap();
    given.apply(&mut guidance);
    let after = guidance.landing.unwrap();
    assert_eq!(after, foxhound_core::landing::Config { request_land: true, ..before });
}
