use super::*;

const SMALL: &str = r#"{"name":"n","why":"w","frame":"f","expect":"e","seed":1,"drone_radius":0.2,
    "bounds":[-1,-2,12,13],"sensor":{"fov_deg":120,"range_m":4,"occlusion":false,"model":"scan"},
    "bearing":{"only":true,"model":"noise","sigma_deg":5,"snr_db":10,"outlier":{"rate":0.1,"offset_deg":60},
    "dropout":[1,2],"tone_known":true,"pulses":{"period_s":1,"length_s":0.5}},"limits":{"v_max":2,"a_max":4},
    "vehicle":{"model":"arducopter","lag_s":0.1,"autopilot":"px4"},
    "goal_tolerance":0.3,"max_time_s":30,"maps":[{"row":3,"instance":1,"name":"m","seed":2,"mean":0.1,
    "variance":0.01,"obstacles":[[1.1,2.2,0.3],[4,5,0.3]],"pairs":[[0,0,5,5,7.5],[0,1,5,5,6.5]]},
    {"row":1,"instance":0,"obstacles":[],"pairs":[[0,0,5,5,7.1]]}]}"#;

fn flown(row: u32, result: Ending, length_ratio: f64, min_clearance_m: f64) -> Flown {
    Flown {
        place: Place { row, instance: 0, pair: 0 },
        seed: 0,
        result,
        reason: "nominal".to_owned(),
        time_s: 10.0,
        path_length_m: 8.0,
        reference_length_m: 8.0 / length_ratio,
        length_ratio: Some(length_ratio),
        whole_length_ratio: Some(length_ratio + 0.1),
        min_clearance_m: Some(min_clearance_m),
        replans: 1,
        bearing_rms_deg: None,
        trace_hash: String::new(),
    }
}

#[test]
fn every_key_is_taken_and_written_back() {
    let suite = Suite::parse(SMALL).unwrap();
    let written = serde_json::to_string(&suite).unwrap();
    assert_eq!(Suite::parse(&written).unwrap(), suite);
    let value: Value = serde_json::from_str(&written).unwrap();
    for key in &SCHEMA.keys {
        let pointer = format!("/{}", key.replace("[]", ".0").replace('.', "/"));
        assert!(value.pointer(&pointer).is_some(), "{key} is not tried here");
    }
}

#[test]
fn two_maps_of_one_row_and_instance_are_refused() {
    let text = SMALL.replace(r#""row":1,"instance":0"#, r#""row":3,"instance":1"#);
    let refused = Suite::parse(&text).unwrap_err().to_string();
    assert_eq!(refused, "maps[1]: row 3, instance 1 is maps[0], too");
}

#[test]
fn what_is_missing_is_as_in_a_scenario() {
    let suite = Suite::parse(r#"{"maps":[{"row":1,"instance":0,"obstacles":[],"pairs":[[0,0,5,5,7.1]]}]}"#).unwrap();
    let flights = suite.flights(1, &Selection::default());
    let scenario = Scenario { start: [0.0, 0.0], goal: [5.0, 5.0], ..Scenario::default() };
    let descriptive = Scenario {
        name: flights[0].scenario.name.clone(),
        reference_length_m: flights[0].scenario.reference_length_m.clone(),
        ..scenario
    };
    assert_eq!(flights[0].scenario, descriptive);
}

#[test]
fn a_flight_has_the_settings_of_the_suite_and_its_own_map_pair_and_seed() {
    let flights = Suite::parse(SMALL).unwrap().flights(7, &Selection::default());
    assert_eq!(flights.len(), 3);
    let second = &flights[1];
    assert_eq!(second.place, Place { row: 3, instance: 1, pair: 1 });
    assert_eq!((second.scenario.start, second.scenario.goal), ([0.0, 1.0], [5.0, 5.0]));
    assert_eq!((second.scenario.drone_radius, second.scenario.sensor.fov_deg), (0.2, 120.0));
    assert_eq!((second.scenario.obstacles.len(), second.reference_length_m), (2, 6.5));
    let mut seeds: Vec<u64> = flights.iter().map(|flight| flight.seed).collect();
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), 3);
}

#[test]
fn a_selected_flight_keeps_its_seed() {
    let suite = Suite::parse(SMALL).unwrap();
    let all = suite.flights(7, &Selection::default());
    let some = |only: &[u32], pairs| suite.flights(7, &Selection { only: only.to_vec(), pairs, shard: None });
    assert_eq!(some(&[3, 1, 1], None), &all[1..2]);
    assert_eq!(some(&[3], None), &all[..2]);
    assert_eq!(some(&[], Some(1)), [all[0].clone(), all[2].clone()]);
    assert_eq!(some(&[2], None), []);
    assert_ne!(suite.flights(8, &Selection::default())[0].seed, all[0].seed);
}

#[test]
fn sums_are_by_row_and_ratios_over_successes_only() {
    let flights = [
        flown(2, Ending::Reached, 1.2, 0.05),
        flown(1, Ending::Reached, 1.0, 0.04),
        flown(2, Ending::Collision, 0.1, -0.01),
        flown(2, Ending::Reached, 1.4, 0.02),
        flown(1, Ending::Hold, 0.5, 0.03),
    ];
    let Report { rows, all } = Report::of(&flights);
    assert_eq!(rows.iter().map(|row| row.row).collect::<Vec<_>>(), [1, 2]);
    assert_eq!((rows[1].tally.runs, rows[1].tally.success, rows[1].tally.collisions), (3, 2, 1));
    assert!((rows[1].tally.mean_length_ratio.unwrap() - 1.3).abs() < 1e-12);
    assert_eq!(rows[0].tally.mean_length_ratio, Some(1.0));
    assert_eq!((all.runs, all.success, all.collisions), (5, 3, 1));
    assert_eq!(all.min_clearance_m, Some(-0.01));
    assert_eq!(all.outcomes.values().sum::<usize>(), 5);
    assert_eq!(all.outcomes["hold: nominal"], 1);
    assert_eq!(Tally::of(&[]).success_rate_95, None);
}

#[test]
fn wilsons_interval_is_the_textbooks() {
    // Published values: 8 of 10, 0 of 10; and the mirror image of the latter.
    let close = |success, runs, low: f64, high: f64| {
        let [found_low, found_high] = wilson_95(success, runs).unwrap();
        assert!((found_low - low).abs() < 5e-5 && (found_high - high).abs() < 5e-5, "{found_low} {found_high}");
    };
    close(8, 10, 0.4902, 0.9433);
    close(0, 10, 0.0, 0.2775);
    close(10, 10, 0.7225, 1.0);
}
