//! The last metres, flown to their end: onto the pad with a camera, above the beacon without one.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::landing::Stage;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::{Computer, HostComputer};
use foxhound_sim::drive::flight::{self, Ending, Mission, Record};
use foxhound_sim::drive::replay::replay;
use foxhound_sim::scenario::Scenario;
use foxhound_sim::study::landings::{Row, SCENES, row};
use foxhound_sim::study::seeds;

/// How many flights of each scene of `cargo xtask landings` are flown here, with the same seeds.
const FLIGHTS: u64 = 12;

fn flown(name: &str) -> Row {
    flown_times(name, FLIGHTS)
}

fn flown_times(name: &str, flights: u64) -> Row {
    let scene = SCENES.iter().find(|scene| scene.name == name).unwrap();
    let row = row(scene, seeds::test(flights)).unwrap();
    assert!(row.collided.is_empty() && row.unfinished.is_empty(), "{row:?}");
    row
}

/// A flight that hands over gives a reason, and does so near the beacon.
fn hands_over(row: &Row, reasons: &[&str]) {
    let all: u32 = row.handed_over.values().map(|[all, _]| all).sum();
    let near: u32 = row.handed_over.values().map(|[_, near]| near).sum();
    assert_eq!((u64::from(all), all), (FLIGHTS, near), "{row:?}");
    assert!(row.handed_over.keys().all(|reason| reasons.contains(reason)), "{row:?}");
}

/// With a range finder it arrives from high above the beacon, too.
#[test]
fn from_twelve_metres_above_the_beacon_it_arrives() {
    let text = r#"{"name": "high", "start": [1, 1], "goal": [8.1, 8.1], "obstacles": [], "sensor": {"model": "scan"},
        "bearing": {"only": true, "model": "rf", "snr_db": 20},
        "landing": {"height": 12, "camera": null, "range_finder": true}, "max_time_s": 240}"#;
    for seed in seeds::test(4) {
        let report = foxhound_sim::study::flight::report(Scenario::parse(text).unwrap(), seed, |_| ()).unwrap();
        let landing = report.landing.unwrap();
        let end = (landing.stage, landing.reason, landing.beacon_distance_m < 0.5);
        assert_eq!(end, (Stage::HandedOver, Some("arrived"), true), "{seed}: {landing:?}");
    }
}

/// With a camera, in calm air, every flight lands on the pad.
#[test]
fn with_a_camera_it_comes_down_on_the_pad() {
    let row = flown("camera, calm");
    assert_eq!(u64::from(row.on_pad), FLIGHTS, "{row:?}");
}

/// With a camera, in gusts of 3 m/s and with other red objects in sight, every flight lands on the pad.
#[test]
fn in_gusts_of_three_metres_a_second_and_with_red_things_about_it_does_as_well() {
    let row = flown("camera, gusts of 3 m/s, red things about");
    assert_eq!(u64::from(row.on_pad), FLIGHTS, "{row:?}");
}

/// Without a camera every flight hovers near the beacon and hands over.
#[test]
fn without_a_camera_it_hovers_above_the_beacon_and_hands_over() {
    for name in ["no camera, calm", "no camera, gusts of 3 m/s", "no camera, no range finder, bearings to 10 deg only"]
    {
        hands_over(&flown(name), &["arrived"]);
    }
}

/// Where there is no pad no flight lands, and at least 80 % hand over near the beacon.
#[test]
fn where_there_is_no_pad_it_hands_over_mostly_above_the_beacon() {
    let flights = 4 * FLIGHTS;
    let row = flown_times("camera, no pad there", flights);
    assert_eq!((row.on_pad, row.beside.len()), (0, 0), "{row:?}");
    // Pillars block some of the paths back.
    let [all, near] = row.handed_over["no_pad"];
    assert!(u64::from(all) == flights && f64::from(near) >= 0.8 * flights as f64, "{row:?}");
}

fn mission(text: &str) -> Mission {
    let scenario = Scenario::parse(text).unwrap();
    Mission { scenario, seed: 5, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum }
}

/// The mission, from near the pad on.
fn near(landing: &str) -> Mission {
    mission(&format!(
        r#"{{"start":[7.5,7.5],"sensor":{{"model":"scan"}},"bearing":{{"snr_db":20}},"vehicle":{{"model":"arducopter"}},
        "landing":{landing},"goal_tolerance":1.5,"max_time_s":120}}"#
    ))
}

fn fly(mission: &Mission, computer: &mut HostComputer) -> Record {
    let (v_max, mut fastest_mps) = (mission.scenario.limits.v_max, 0.0_f32);
    let record = flight::fly(mission, computer, None, |moment| {
        let velocity = moment.output.setpoint.velocity_ned_mps;
        fastest_mps = fastest_mps.max(velocity.horizontal().norm());
        assert!(velocity.is_finite() && velocity.down.abs() <= 0.5);
    })
    .unwrap();
    assert!(fastest_mps <= v_max as f32 + 1e-4, "{fastest_mps}");
    record
}

/// A camera that sends no usable frames ends the landing in a hover above 1 m that gives the reason.
#[test]
fn frames_that_are_no_frames_end_in_a_hover_that_says_why() {
    for (landing, reason) in [
        (r#"{"camera":{"cut":[0,200]}}"#, "no_camera"),
        (r#"{"camera":{"blind":[0,200]}}"#, "no_camera"),
        (r#"{"camera":{"cut":[6,200]}}"#, "no_camera"),
    ] {
        let mission = near(landing);
        let record = fly(&mission, &mut HostComputer::new(&mission.guidance()).unwrap());
        let landed = record.report.landing.unwrap();
        assert_eq!((landed.stage, landed.reason), (Stage::HandedOver, Some(reason)), "{landing}: {landed:?}");
        assert!(landed.height_m > 1.0, "{landed:?}");
    }
}

/// A pad that fills the picture from higher up than the last part mostly begins is landed on: a large one, and one before a narrow camera.
#[test]
fn a_pad_that_fills_the_picture_early_is_landed_on() {
    for (pad_radius_m, fov_deg, height_m) in [(0.5, 60, 3), (1.1, 60, 5), (0.25, 30, 3)] {
        let camera = format!(r#"{{"rate_hz": 4, "fov_deg": {fov_deg}}}"#);
        let mission = near(&format!(r#"{{"height":{height_m},"pad_radius":{pad_radius_m},"camera":{camera}}}"#));
        let record = fly(&mission, &mut HostComputer::new(&mission.guidance()).unwrap());
        let landing = record.report.landing.unwrap();
        assert_eq!(landing.stage, Stage::Landed, "{pad_radius_m} {fov_deg}: {landing:?}");
    }
}

/// A camera that is blind for a second during the landing does not prevent it.
#[test]
fn a_camera_that_comes_back_in_time_is_used() {
    let mission = near(r#"{"camera":{"blind":[7,8]}}"#);
    let record = fly(&mission, &mut HostComputer::new(&mission.guidance()).unwrap());
    assert_eq!(record.report.landing.unwrap().stage, Stage::Landed, "{:?}", record.report);
    assert_eq!(record.report.result, Ending::Reached);
}

/// After touchdown the autopilot is asked to land and disarm only if the user configured it.
#[test]
fn on_the_ground_the_autopilot_is_asked_to_disarm_only_where_the_user_wants_it() {
    for (wants, asked) in [(true, true), (false, false)] {
        let mission = near(&format!(r#"{{"request_land":{wants}}}"#));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flight.tlog");
        let mut log = foxhound_sim::autopilot::tlog::Writer::create(&path).unwrap();
        let mut computer = HostComputer::new(&mission.guidance()).unwrap();
        let record = flight::fly(&mission, &mut computer, Some(&mut log), |_| ()).unwrap();
        log.finish().unwrap();
        assert_eq!(record.report.landing.unwrap().stage, Stage::Landed, "{:?}", record.report);
        // A COMMAND_LONG with MAV_CMD_NAV_LAND: MAVLink 2, id 76, its seven parameters zero, the command 21.
        let bytes = std::fs::read(&path).unwrap();
        let is_land = |at: usize| {
            let frame = &bytes[at..];
            frame.len() > 45 && frame[0] == 0xfd && frame[7..10] == [76, 0, 0] && frame[38..40] == [21, 0]
        };
        assert_eq!((0..bytes.len()).any(is_land), asked, "request_land {wants}");
    }
}

/// Above the beacon the autopilot is asked to land there in the open, and not between two poles: it would touch one.
#[test]
fn without_a_camera_it_lands_where_there_is_room_and_hovers_where_there_is_none() {
    let world = r#"{"start":[0,0],"goal":[4.743,-0.109],"goal_tolerance":1.5,"bearing":{"snr_db":20},"sensor":{"model":"scan"},
        "vehicle":{"model":"MODEL"},"max_time_s":120,"landing":{"request_land":true,"camera":null},"obstacles":POLES}"#;
    for (model, poles, stage_reason, height_m) in [
        ("point", "[]", "arrived", 0.0..0.001),
        ("arducopter", "[]", "arrived", 0.0..0.001),
        ("arducopter", r#"[{"x":4.56,"y":-0.159,"r":0.106},{"x":4.525,"y":-0.001,"r":0.247}]"#, "blocked", 2.0..4.0),
    ] {
        let scenario = Scenario::parse(&world.replace("MODEL", model).replace("POLES", poles)).unwrap();
        let (planner, estimator) = (planner::Config::default(), Estimator::CrossSpectrum);
        let mission = Mission { scenario, seed: 1_000_000, planner, estimator };
        let report = fly(&mission, &mut HostComputer::new(&mission.guidance()).unwrap()).report;
        let landing = report.landing.unwrap();
        assert_eq!((report.collisions, report.result), (Some(0), Ending::Reached), "{report:?}");
        assert_eq!((landing.stage, landing.reason), (Stage::HandedOver, Some(stage_reason)));
        assert!(height_m.contains(&landing.height_m.abs()), "{}", landing.height_m);
    }
}

/// A landing is replayed from its log with identical bits.
#[test]
fn a_landing_is_flown_again_from_its_log_to_the_last_bit() {
    let mission = near("{}");
    let mut computer = HostComputer::new(&mission.guidance()).unwrap();
    computer.log_flight();
    let record = flight::fly(&mission, &mut computer, None, |_| ()).unwrap();
    assert_eq!(record.report.landing.unwrap().stage, Stage::Landed);
    let summary = replay(&computer.take_flight_log()).unwrap();
    assert!(summary.is_identical(), "{summary:?}");
    assert_eq!(summary.trace_hash, record.report.trace_hash);
}
