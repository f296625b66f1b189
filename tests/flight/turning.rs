//! Seeking by turning, flown through the command line: with one directional antenna, and with the rest of an array.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_sim::study::seeds;
use foxhound_tests::{in_parallel, root, run_json};
use serde_json::{Value, json};

const SEEDS: u64 = 12;

fn scenario(name: &str) -> Value {
    let file = root().join("tests/scenarios").join(name);
    serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap()
}

/// Flies a scenario with many seeds.
fn fly(scenario: &Value, count: u64) -> Vec<(i32, Value)> {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("scenario.json");
    std::fs::write(&file, scenario.to_string()).unwrap();
    let path = file.to_string_lossy();
    let seeds: Vec<String> = seeds::test(count).map(|seed| seed.to_string()).collect();
    in_parallel(&seeds, |seed| run_json(&["fly", "--json", "--scenario", &path, "--seed", seed]))
}

fn number(report: &Value, field: &str) -> f64 {
    report[field].as_f64().unwrap()
}

/// Every flight reaches the beacon, and touches nothing.
fn assert_reached(flights: &[(i32, Value)]) {
    for (code, report) in flights {
        assert_eq!((*code, report["result"].as_str()), (0, Some("reached")), "{report}");
        assert_eq!(report["collisions"], 0, "{report}");
        assert!(number(report, "min_clearance_m") > 0.0, "{report}");
        assert!(number(report, "straight_line_m") > 9.9, "{report}");
        assert!(number(report, "path_length_m") < 1.5 * number(report, "straight_line_m"), "{report}");
    }
}

/// A vehicle that turns with one directional antenna reaches a beacon 10 m away among pillars, without a collision.
#[test]
fn one_antenna_that_turns_finds_a_beacon_ten_metres_off_among_pillars() {
    let flights = fly(&scenario("turning_antenna.json"), SEEDS);
    assert_reached(&flights);
    // A turn before the first bearing; and it does not stand still from turn to turn.
    assert!(flights.iter().all(|(_, report)| (15.0..60.0).contains(&number(report, "time_s"))), "{flights:?}");
}

/// Between walls that reflect, the first rotations have two maxima or more: the vehicle searches on, to where there is one.
#[test]
fn one_antenna_that_turns_leaves_a_room_whose_reflections_are_ambiguous() {
    let wall = |[x0, y0, x1, y1]: [f64; 4]| json!({"x0": x0, "y0": y0, "x1": x1, "y1": y1, "r": 0.1, "passage_db": 10, "reflection_db": 6});
    let outside = [[-2.0, -3.0, 12.0, -3.0], [12.0, -3.0, 12.0, 5.0], [12.0, 5.0, -2.0, 5.0], [-2.0, 5.0, -2.0, -3.0]];
    let doors = [[3.0, -3.0, 3.0, 1.35], [3.0, 2.65, 3.0, 5.0], [7.0, -3.0, 7.0, -1.85], [7.0, -0.55, 7.0, 5.0]];
    let rooms = json!({
        "name": "rooms", "start": [0, -1], "goal": [10.5, 3.5], "max_time_s": 300, "explore_s": 120,
        "obstacles": [], "walls": outside.into_iter().chain(doors).map(wall).collect::<Vec<_>>(),
        "vehicle": {"model": "arducopter", "autopilot": "px4"}, "sensor": {"model": "scan"},
        "bearing": {"snr_db": 20}, "antenna": {"single": true},
    });
    let flights = fly(&rooms, SEEDS);
    for (_, report) in &flights {
        assert_eq!(report["collisions"], 0, "{report}");
        assert!(number(report, "path_length_m") > 10.0 && report["reason"] != "ambiguous", "{report}");
    }
    // One uses up its time for searching.
    let reached = flights.iter().filter(|(_, report)| report["result"] == "reached").count();
    assert!(reached >= 11, "{reached} of {SEEDS}");
}

/// Other turn rates, antenna patterns and a slower vehicle reach the beacon as well.
#[test]
fn other_rates_and_lobes_and_a_slower_vehicle_do_as_well() {
    for change in [
        json!({"antenna": {"single": true, "turn_deg_per_s": 120, "exponent": 4, "front_to_back_db": 25}}),
        json!({"antenna": {"single": true, "turn_deg_per_s": 45, "boresight_deg": [90, 0, 0, 0]}}),
        json!({"vehicle": {"model": "arducopter"}, "bearing": {"snr_db": 5}}),
    ] {
        let mut scenario = scenario("turning_antenna.json");
        for (key, value) in change.as_object().unwrap() {
            scenario[key] = value.clone();
        }
        assert_reached(&fly(&scenario, 4));
    }
}

/// A flight in which two of four channels die continues by turning, and reaches the beacon.
#[test]
fn a_flight_in_which_two_of_four_channels_die_goes_on_by_turning() {
    let mut scenario = scenario("two_channels_die.json");
    let flights = fly(&scenario, SEEDS);
    assert_reached(&flights);
    scenario["faults"] = json!({});
    let whole = fly(&scenario, 4);
    assert_reached(&whole);
    // They turned: that takes its time.
    let slowest_s = whole.iter().map(|(_, report)| number(report, "time_s")).fold(0.0, f64::max);
    assert!(flights.iter().all(|(_, report)| number(report, "time_s") > slowest_s + 2.0), "{slowest_s} {flights:?}");
}

/// Two dead channels of omnidirectional antennas end in a hold that says `ambiguous`; one dead channel does not.
#[test]
fn an_array_that_hears_the_same_all_round_holds_when_two_channels_die_and_says_why() {
    let mut scenario = scenario("two_channels_die.json");
    scenario.as_object_mut().unwrap().remove("antenna");
    scenario["max_time_s"] = json!(30);
    for (code, report) in fly(&scenario, SEEDS) {
        assert_ne!(code, 0, "{report}");
        assert_eq!((&report["result"], &report["reason"]), (&"hold".into(), &"ambiguous".into()), "{report}");
        assert_eq!(report["collisions"], 0, "{report}");
        // It continued for no longer than a bearing stays valid.
        assert!(number(&report, "path_length_m") < 5.0, "{report}");
    }
    // One dead channel only costs precision.
    scenario["faults"] = json!({"dead_channels": [null, [3, 1000], null, null]});
    assert_reached(&fly(&scenario, 4));
}

/// When the beacon falls silent the vehicle holds, and it arrives when the beacon returns.
#[test]
fn a_beacon_that_falls_silent_is_waited_for_and_found_when_it_is_back() {
    let mut scenario = scenario("turning_antenna.json");
    scenario["bearing"]["dropout"] = json!([8, 1000]);
    scenario["max_time_s"] = json!(45);
    for (_, report) in fly(&scenario, 6) {
        assert_eq!((&report["result"], &report["reason"]), (&"hold".into(), &"no_signal".into()), "{report}");
        assert_eq!(report["collisions"], 0, "{report}");
        // The turn in which the signal stopped gives no direction.
        assert!(number(&report, "bearing_rms_deg") < 10.0, "{report}");
    }
    scenario["bearing"]["dropout"] = json!([8, 20]);
    scenario["max_time_s"] = json!(120);
    assert_reached(&fly(&scenario, 6));
}
