use foxhound_core::base::obstacle::Circle;
use foxhound_core::guidance::FrontEnd;

use super::*;
use crate::drive::computer::{BLOCK, HostComputer, StepReport};
use crate::scenario::FLIGHT_DOWN_M;

fn mission(scenario: Scenario, seed: u64) -> Mission {
    Mission { scenario, seed, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum }
}

fn flown(mission: &Mission) -> Record {
    let mut computer = HostComputer::new(&mission.guidance()).unwrap();
    fly(mission, &mut computer, None, |_| ()).unwrap()
}

fn parsed(text: &str) -> Scenario {
    Scenario::parse(text).unwrap()
}

/// A computer that fails after so many steps.
struct Dies(HostComputer, u32);

impl Computer for Dies {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        self.1 = self.1.checked_sub(1).ok_or_else(|| ComputerError("it is gone".to_owned()))?;
        self.0.step(now, front_end, circles, rx)
    }

    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.0.see(bytes)
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.0.turn(bytes)
    }
}

#[test]
fn a_flight_whose_computer_fails_is_there_as_far_as_it_came() {
    let mission = mission(Scenario::built_in(), 1);
    let fails = || Dies(HostComputer::new(&mission.guidance()).unwrap(), 100);
    let mut watched = 0;
    let (record, failed) = fly_as_far(&mission, &mut fails(), None, &AtomicBool::new(false), |_| watched += 1);
    assert_eq!(failed.map(|error| error.to_string()), Some("it is gone".to_owned()));
    let Report { result, reason, time_s, .. } = record.report;
    assert_eq!((result, reason, time_s), (Ending::Hold, "fault", 2.0));
    assert_eq!((record.path.len(), watched), (100, 100));
    assert!(fly(&mission, &mut fails(), None, |_| ()).is_err());
    // What ends this program ends the computer's as well.
    let (record, failed) = fly_as_far(&mission, &mut fails(), None, &AtomicBool::new(true), |_| ());
    assert!(failed.is_none() && record.report.result == Ending::Interrupted);
}

#[test]
fn the_built_in_mission_reaches_the_beacon_by_its_waves_alone() {
    for seed in 1..=5 {
        let Record { report, path, .. } = flown(&mission(Scenario::built_in(), seed));
        assert_eq!((report.result, report.collisions), (Ending::Reached, Some(0)), "seed {seed}: {report:?}");
        assert!(path.iter().all(|sample| (sample.down_m - FLIGHT_DOWN_M).abs() < 0.05), "seed {seed}: altitude lost");
        // The straight line less the tolerance is the least that anyone can fly.
        let straight_line_m = report.straight_line_m.unwrap();
        assert!(report.path_length_m > straight_line_m - 0.51);
        assert!(report.path_length_m < 1.5 * straight_line_m);
        assert!(report.min_clearance_m.unwrap() > 0.0);
        assert!(report.bearing_rms_deg.unwrap() < 0.25);
    }
}

fn by_lidar() -> Scenario {
    parsed(include_str!("../../../../tests/scenarios/lidar.json"))
}

#[test]
fn by_a_lidar_it_flies_around_pillars_and_stands_while_that_is_silent() {
    let undisturbed = flown(&mission(by_lidar(), 3));
    assert_eq!((undisturbed.report.result, undisturbed.report.collisions), (Ending::Reached, Some(0)));
    let is_stale = |sample: &&Sample| sample.outcome == Outcome::StaleObstacles;
    assert!(!undisturbed.path.iter().skip(50).any(|sample| is_stale(&sample)), "it turns");
    let mut scenario = by_lidar();
    scenario.faults.stale_obstacles = Some([4.0, 8.0]);
    let silent = flown(&mission(scenario, 3));
    assert_eq!((silent.report.result, silent.report.collisions), (Ending::Reached, Some(0)));
    // The last turn ends at 4 s and counts from its middle; 0.5 s later it is too old.
    let first = silent.path.iter().skip(50).find(is_stale).unwrap();
    assert!((4.3..4.56).contains(&first.time_s), "{}", first.time_s);
    let stands = |sample: &Sample| sample.speed_mps < 0.05;
    assert!(silent.path.iter().filter(|sample| (7.0..8.0).contains(&sample.time_s)).all(stands));
}

#[test]
fn the_printed_object_has_the_promised_keys_and_no_others() {
    let report = flown(&mission(parsed(r#"{"goal":[3,1],"reference_length_m":2,"max_time_s":20}"#), 1)).report;
    let json = serde_json::to_value(&report).unwrap();
    let mut keys: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    let promised = [
        "bearing_rms_deg",
        "collisions",
        "min_clearance_m",
        "name",
        "path_length_m",
        "reason",
        "reference_length_m",
        "replans",
        "result",
        "seed",
        "straight_line_m",
        "time_s",
        "to_beacon_m",
        "trace_hash",
    ];
    assert_eq!(keys, promised);
    assert_eq!(json["result"], "reached");
    assert_eq!(json["trace_hash"].as_str().unwrap().len(), 16);
    assert!(json["min_clearance_m"].is_null(), "there is nothing to be clear of");
    assert_eq!(json["reference_length_m"], 2);
}

#[test]
fn in_the_open_the_path_is_the_straight_line_to_the_tolerance_and_what_a_bend_to_learn_the_range_adds() {
    let mut mission = mission(parsed(r#"{"start":[0,0],"goal":[6,0],"bounds":[-1,-1,7,1]}"#), 1);
    let bent = flown(&mission).report;
    assert!(bent.path_length_m > 5.4 && bent.path_length_m < 1.12 * 5.5, "{}", bent.path_length_m);
    mission.planner.bends = false;
    let report = flown(&mission).report;
    assert_eq!(report.result, Ending::Reached);
    assert!((report.path_length_m - 5.5).abs() < 0.1, "{}", report.path_length_m);
    // Six metres at 1 m/s, and the start.
    assert!(report.time_s > 5.5 && report.time_s < 9.0, "{}", report.time_s);
}

#[test]
fn the_noise_of_the_bearings_is_the_one_that_was_asked_for() {
    let report = flown(&mission(parsed(r#"{"bearing":{"sigma_deg":5}}"#), 2)).report;
    // 500 bearings: the rms is known to 3 %.
    assert!((report.bearing_rms_deg.unwrap() - 5.0).abs() < 0.6, "{:?}", report.bearing_rms_deg);
}

#[test]
fn a_vehicle_without_a_signal_or_with_bearings_that_are_no_numbers_holds_and_says_why() {
    for fault in [r#""bearing":{"snr_db":20,"dropout":[0,99]}"#, r#""faults":{"nan_bearing":[0,99]}"#] {
        let record = flown(&mission(parsed(&format!(r#"{{{fault},"max_time_s":8}}"#)), 1));
        assert_eq!((record.report.result, record.report.reason), (Ending::Hold, "no_signal"), "{fault}");
        assert!(record.report.path_length_m < 0.05, "{fault}: noise alone moves nothing");
        assert!(serde_json::to_value(&record.report).unwrap()["bearing_rms_deg"].is_null(), "{fault}");
    }
}

#[test]
fn a_vehicle_without_a_signal_searches_where_it_may_and_ends_in_a_hold_or_at_the_beacon() {
    let text = r#"{"bearing":{"snr_db":20,"dropout":[0,99]},"max_time_s":40,"explore_s":20,
        "obstacles":[{"x":3,"y":3,"r":0.4},{"x":1,"y":3,"r":0.3}]}"#;
    let record = flown(&mission(parsed(text), 1));
    assert_eq!((record.report.result, record.report.reason), (Ending::Hold, "no_signal"));
    assert!(record.report.path_length_m > 5.0 && record.report.min_clearance_m.unwrap() > 0.0);
    let after = record.path.iter().filter(|sample| sample.time_s > 24.0);
    assert!(after.clone().all(|sample| sample.speed_mps < 0.1), "the search has an end");
    let text = text.replace("[0,99]", "[0,12]");
    let record = flown(&mission(parsed(&text), 1));
    assert_eq!((record.report.result, record.report.collisions), (Ending::Reached, Some(0)), "{:?}", record.report);
}

#[test]
fn px4_is_flown_once_its_pilot_could_enter_offboard() {
    let mut scenario = Scenario::built_in();
    scenario.vehicle.autopilot = Software::Px4;
    let record = flown(&mission(scenario, 1));
    assert_eq!((record.report.result, record.report.collisions), (Ending::Reached, Some(0)), "{:?}", record.report);
    let before = &record.path[..PILOT_TICKS as usize];
    assert!(before.iter().all(|sample| sample.outcome == Outcome::NotInControl && sample.speed_mps < 0.01));
}

#[test]
fn a_vehicle_without_telemetry_or_obstacle_data_holds_and_goes_on_afterwards() {
    for (fault, name) in [("stale_ownship", "stale_ownship"), ("stale_obstacles", "stale_obstacles")] {
        let text = format!(r#"{{"faults":{{"{fault}":[3,6]}},"limits":{{"v_max":1}}}}"#);
        let record = flown(&mission(parsed(&text), 1));
        assert_eq!(record.report.result, Ending::Reached, "{fault}");
        let during = record.path.iter().find(|sample| sample.time_s > 5.0).unwrap();
        assert_eq!(during.outcome.name(), name);
        assert!(during.speed_mps < 0.1, "{fault}: {} m/s", during.speed_mps);
    }
}

#[test]
fn the_bytes_of_a_logged_flight_are_clean_mavlink() {
    let path = std::env::temp_dir().join(format!("foxhound-flight-test-{}.tlog", std::process::id()));
    let mission = mission(Scenario::built_in(), 1);
    let mut computer = HostComputer::new(&mission.guidance()).unwrap();
    let mut log = tlog::Writer::create(&path).unwrap();
    let record = fly(&mission, &mut computer, Some(&mut log), |_| ()).unwrap();
    log.finish().unwrap();
    let summary = tlog::read_stamped(&std::fs::read(&path).unwrap());
    std::fs::remove_file(&path).unwrap();
    assert_eq!((summary.bad_crc, summary.skipped_bytes), (0, 0));
    let rate_hz = |id: u32| summary.counts.get(&id).copied().unwrap_or(0) as f64 / record.report.time_s;
    assert!((rate_hz(84) - 20.0).abs() < 2.0, "setpoints at {} Hz", rate_hz(84));
    assert!((rate_hz(330) - 10.0).abs() < 1.0, "scans at {} Hz", rate_hz(330));
    // Two ends, one beat a second each.
    assert!((rate_hz(0) - 2.0).abs() < 0.3, "heartbeats at {} Hz", rate_hz(0));
}
