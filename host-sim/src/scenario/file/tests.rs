//! What is refused, and how it is named.

use serde_json::{Map, json};

use super::*;

fn refused(text: &str) -> String {
    Scenario::parse(text).unwrap_err().to_string()
}

#[test]
fn an_empty_scenario_is_the_defaults() {
    let scenario = Scenario::parse("{}").unwrap();
    assert_eq!(scenario, Scenario::default());
    assert_eq!(Scenario::parse(&serde_json::to_string(&scenario).unwrap()).unwrap(), scenario);
    let nothing = r#"{"antenna":null,"wind":null,"position":null,"landing":null,"random":null,"bearing":{"pulses":null,"snr_db":null}}"#;
    assert_eq!(Scenario::parse(nothing).unwrap(), scenario);
    assert!(scenario.bearing.only);
    assert_eq!(scenario.bearing_model(), BearingModel::Noise);
    assert_eq!((scenario.limits.v_max, scenario.limits.a_max, scenario.max_time_s), (1.0, 2.0, 90.0));
}

#[test]
fn every_key_is_taken_and_written_back() {
    let text = r#"{"$schema":"scenario.schema.json","name":"n","bounds":[-1,-2,12,13],"drone_radius":0.2,"start":[1,2],"goal":[3,4],
        "goal_velocity":[0.1,-0.1],"obstacles":[{"x":5,"y":6,"r":0.5,"vx":0.1,"vy":0.2,"turns_s":3},{"x":1,"y":9,"r":0.1}],
        "people":[{"route":[[5,6]],"heading_deg":90,"speed":1,"r":0.2,"sway_m":0.1,"sway_s":3,"stop_every_s":9,"stop_s":1,
        "turn_every_s":8,"turn_deg":50,"group":2,"group_gap":1,"steps_aside":true},{"track":[[0,5,5],[1,6,5]]}],"people_csv":"p.csv",
        "walls":[{"x0":-1,"y0":8,"x1":4,"y1":8,"r":0.1,"reflection_db":5,"passage_db":20}],
        "random":{"count":3,"radius":[0.1,0.2],"gap":1,"clear":2},"wind":{"vx":1,"vy":2,"gust_mps":1,"gust_s":3},
        "position":{"noise_m":0.1,"drift_m":0.2,"drift_s":30},
        "landing":{"height":2,"pad":[0.1,0.2],"pad_radius":0.3,"pad_missing":true,"camera":{"width":80,"height":60,"fov_deg":50,
        "rate_hz":5,"latency_s":0.1,"grey":true,"distractors":true,"cut":[1,2],"blind":[3,4]},"range_finder":false,
        "request_land":true},
        "other_beacons":[{"x":1,"y":2,"offset_hz":3000,"level_db":-3}],
        "sensor":{"fov_deg":120,"range_m":4,"occlusion":false,"model":"scan","noise_m":0.02,"missed":0.01,"lag_s":0.1},
        "bearing":{"only":false,"model":"rf","sigma_deg":5,"snr_db":10,"outlier":{"rate":0.1,"offset_deg":60},
        "dropout":[1,2],"tone_known":true,"pulses":{"period_s":1,"length_s":0.3}},"antenna":{"single":true,"exponent":3,"front_to_back_db":20,"boresight_deg":[0,90,180,-90],
        "turn_deg_per_s":60},"limits":{"v_max":2,"a_max":4},"vehicle":{"model":"arducopter","lag_s":0.1,"autopilot":"px4"},
        "goal_tolerance":0.3,"max_time_s":30,"faults":{"nan_bearing":[1,2],"stale_obstacles":[3,4],"clock_back_s":5,
        "stale_ownship":[6,7],"dead_channels":[null,[1,2],null,[3,4]]},"why":"w","frame":{"x":"east"},"expect":"reached","reference_length_m":9.5}"#;
    let scenario = Scenario::parse(text).unwrap();
    assert_eq!(scenario.obstacles[0].vy, 0.2);
    let written = serde_json::to_string(&scenario).unwrap();
    assert_eq!(Scenario::parse(&written).unwrap(), scenario);
    let value: Value = serde_json::from_str(&written).unwrap();
    for key in &SCHEMA.keys {
        let pointer = format!("/{}", key.replace("[]", ".0").replace('.', "/"));
        assert!(value.pointer(&pointer).is_some(), "{key} is not tried here");
    }
}

#[test]
fn people_have_one_way_each_and_do_not_start_where_the_vehicle_does() {
    let one = |text: &str| refused(&format!(r#"{{"people":[{{"route":[[5,5],[6,6]]}},{{{text}}}]}}"#));
    for (text, why) in [
        ("", "needs a route or a track"),
        (r#""route":[[5,5]]"#, "needs a heading_deg, or a second point in its route"),
        (r#""route":[[5,5],[6,6]],"heading_deg":0"#, "heading_deg needs a route of one point"),
        (r#""route":[[5,5],[6,6]],"turn_every_s":5"#, "turn_every_s needs a route of one point"),
        (r#""route":[[5,5],[5,5]]"#, "two successive points of its route are the same"),
        (r#""route":[[5,5],[6,6]],"track":[[0,5,5],[1,6,6]]"#, "has both a route and a track"),
        (r#""track":[[0,5,5]]"#, "a track needs at least two points"),
        (r#""track":[[0,5,5],[0,6,6]]"#, "the times of a track must increase"),
        (r#""track":[[0,5,5],[1,6,6]],"sway_m":0.1"#, "a person with a track can only follow it"),
        (r#""route":[[2,2],[6,6]]"#, "starts 1.41 m from the vehicle's start; at least 1.5 m is required"),
        (r#""track":[[-1,0,2],[1,2,2]]"#, "starts 1.00 m from the vehicle's start; at least 1.5 m is required"),
        (
            r#""route":[[2.8,1]],"heading_deg":0,"group":3"#,
            "starts 1.10 m from the vehicle's start; at least 1.5 m is required",
        ),
    ] {
        assert_eq!(one(text), format!("people[1]: {why}"), "{text}");
    }
    // He is not there yet.
    Scenario::parse(r#"{"people":[{"track":[[1,1,1],[2,2,2]]}]}"#).unwrap();
}

#[test]
fn a_file_of_tracks_lies_beside_the_scenario_and_its_people_become_those_of_the_scenario() {
    let folder = std::env::temp_dir().join(format!("foxhound-tracks-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("scenario.json");
    std::fs::write(&path, r#"{"people_csv":"tracks.csv","people":[{"route":[[5,5],[6,6]]}]}"#).unwrap();
    let with = |tracks: &str| {
        std::fs::write(folder.join("tracks.csv"), tracks).unwrap();
        Scenario::read(&path, 1).map_err(|error| error.to_string())
    };
    let read = with("time_s,person,x,y\n0,a,5,5\n1,a,6,5\n").unwrap();
    assert_eq!((read.people.len(), &read.people_csv), (2, &None));
    assert_eq!(read.people[1].track, [[0.0, 5.0, 5.0], [1.0, 6.0, 5.0]]);
    let wrong = with("time_s,person,x,y\n0,a,5,?\n").unwrap_err();
    assert!(wrong.contains("tracks.csv: line 2, column y: expected a number, not `?`"), "{wrong}");
    let near = with("time_s,person,x,y\n0,a,1,2\n1,a,6,5\n").unwrap_err();
    assert!(near.contains("tracks.csv: person a: starts 1.00 m from the vehicle's start"), "{near}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn an_snr_means_waveforms() {
    let scenario = Scenario::parse(r#"{"bearing":{"snr_db":20}}"#).unwrap();
    assert_eq!(scenario.bearing_model(), BearingModel::Rf);
    let scenario = Scenario::parse(r#"{"bearing":{"snr_db":20,"model":"noise"}}"#).unwrap();
    assert_eq!(scenario.bearing_model(), BearingModel::Noise, "said so, although there is an SNR");
    assert_eq!(Scenario::built_in().bearing_model(), BearingModel::Rf);
}

#[test]
fn unknown_keys_are_named_with_their_path_and_the_nearest_known_one() {
    assert_eq!(refused(r#"{"gaol":[1,1]}"#), "gaol: unknown key; did you mean `goal`?");
    assert_eq!(refused(r#"{"sensor":{"fov":90}}"#), "sensor.fov: unknown key; did you mean `fov_deg`?");
    assert_eq!(
        refused(r#"{"bearing":{"outlier":{"rat":0.1}}}"#),
        "bearing.outlier.rat: unknown key; did you mean `rate`?"
    );
    assert!(
        refused(r#"{"obstacles":[{"x":1,"y":1,"r":1},{"x":1,"y":1,"r":1,"radius":2}]}"#)
            .starts_with("obstacles[1].radius: unknown key")
    );
    assert!(refused(r#"{"limits":{"zzz":1}}"#).contains("known here: a_max, v_evade, v_max"));
    assert!(refused(r#"{"faults":{"nan_bearings":[1,2]}}"#).contains("`nan_bearing`"));
}

#[test]
fn values_out_of_range_are_named_with_value_and_range() {
    assert_eq!(refused(r#"{"limits":{"v_max":-1}}"#), "limits.v_max = -1 is outside 0.1..=20");
    for (text, field) in [
        (r#"{"drone_radius":0}"#, "drone_radius"),
        (r#"{"start":[1e9,0]}"#, "start[0]"),
        (r#"{"goal":[0,-1e9]}"#, "goal[1]"),
        (r#"{"bounds":[0,0,-1,10]}"#, "bounds[2]"),
        (r#"{"obstacles":[{"x":1,"y":1,"r":1},{"x":1,"y":1,"r":-1}]}"#, "obstacles[1].r"),
        (r#"{"sensor":{"fov_deg":361}}"#, "sensor.fov_deg"),
        (r#"{"sensor":{"range_m":0}}"#, "sensor.range_m"),
        (r#"{"bearing":{"sigma_deg":-1}}"#, "bearing.sigma_deg"),
        (r#"{"bearing":{"outlier":{"rate":2}}}"#, "bearing.outlier.rate"),
        (r#"{"bearing":{"dropout":[5,4]}}"#, "bearing.dropout[1]"),
        (r#"{"vehicle":{"lag_s":-0.1}}"#, "vehicle.lag_s"),
        (r#"{"vehicle":{"lag_s":2.1}}"#, "vehicle.lag_s"),
        (r#"{"random":{"count":2000}}"#, "random.count"),
        (r#"{"random":{"radius":[0.4,0.3]}}"#, "random.radius[1]"),
        (r#"{"obstacles":[{"x":1,"y":1,"r":1,"turns_s":-1}]}"#, "obstacles[0].turns_s"),
        (r#"{"wind":{"gust_s":0}}"#, "wind.gust_s"),
        (r#"{"position":{"drift_s":0}}"#, "position.drift_s"),
        (r#"{"bearing":{"pulses":{"period_s":1,"length_s":2}}}"#, "bearing.pulses.length_s"),
        (r#"{"bearing":{"snr_db":20},"other_beacons":[{"x":1,"y":1,"offset_hz":1e6}]}"#, "other_beacons[0].offset_hz"),
        (r#"{"antenna":{"exponent":0}}"#, "antenna.exponent"),
        (r#"{"antenna":{"front_to_back_db":60}}"#, "antenna.front_to_back_db"),
        (r#"{"antenna":{"boresight_deg":[0,0,0,999]}}"#, "antenna.boresight_deg[3]"),
        (r#"{"antenna":{"turn_deg_per_s":0}}"#, "antenna.turn_deg_per_s"),
        (
            r#"{"bearing":{"snr_db":20},"faults":{"dead_channels":[null,null,[5,4],null]}}"#,
            "faults.dead_channels[2][1]",
        ),
        (r#"{"goal_tolerance":0}"#, "goal_tolerance"),
        (r#"{"max_time_s":-5}"#, "max_time_s"),
        (r#"{"faults":{"clock_back_s":-5}}"#, "faults.clock_back_s"),
    ] {
        let message = refused(text);
        assert!(message.starts_with(field) && message.contains("is outside"), "{text}: {message}");
    }
}

#[test]
fn a_lag_of_scans_is_a_number_of_steps() {
    let why = "sensor.lag_s, FH_OBS_LAG = 0.05 is not a number of steps of 0.02 s";
    assert_eq!(refused(r#"{"sensor":{"model":"scan","lag_s":0.05}}"#), why);
    for taken in [r#"{"sensor":{"model":"scan","lag_s":0.14}}"#, r#"{"sensor":{"lag_s":0.05}}"#] {
        assert!(Scenario::parse(taken).is_ok(), "{taken}");
    }
}

#[test]
fn values_of_the_wrong_kind_are_named_with_their_path() {
    for (text, field) in [
        (r#"{"limits":{"v_max":"fast"}}"#, "limits.v_max"),
        (r#"{"start":[1]}"#, "start"),
        (r#"{"start":[1,2,3]}"#, "start"),
        (r#"{"sensor":{"model":"sonar"}}"#, "sensor.model"),
        (r#"{"vehicle":{"autopilot":"betaflight"}}"#, "vehicle.autopilot"),
        (r#"{"obstacles":[{"x":1,"y":1}]}"#, "obstacles[0]"),
        (r#"{"obstacles":[{"x":1,"y":null,"r":1}]}"#, "obstacles[0].y"),
        (r#"{"bearing":{"only":1}}"#, "bearing.only"),
        (r#"{"antenna":{"boresight_deg":[0,0]}}"#, "antenna.boresight_deg"),
        (r#"{"antenna":[true]}"#, "antenna: expected an object"),
        (r#"{"faults":{"dead_channels":[[1,2]]}}"#, "faults.dead_channels"),
    ] {
        let message = refused(text);
        assert!(message.starts_with(field), "{text}: {message}");
    }
    assert_eq!(
        refused(r#"{"antenna":{}}"#),
        "antenna: needs bearing.model `rf`; other models have no channels",
        "there is nothing to hear with"
    );
    let dead = refused(r#"{"faults":{"dead_channels":[null,[1,2],null,null]}}"#);
    assert!(dead.starts_with("faults.dead_channels[1]: needs bearing.model `rf`"), "{dead}");
    let others = refused(r#"{"other_beacons":[{"x":1,"y":1,"offset_hz":3000}]}"#);
    assert!(others.starts_with("other_beacons[0]: needs bearing.model `rf`"), "{others}");
    assert!(refused(r#"{"wind":{"gusts_mps":2}}"#).contains("`gust_mps`"));
    assert!(refused(r#"{"antenna":{"exponents":2}}"#).contains("`exponent`"));
    assert_eq!(refused(r#"{"sensor":null}"#), "sensor: expected an object {...}");
    assert_eq!(refused(r#"{"wind":[1,2,3]}"#), "wind: expected an object {...}");
    assert_eq!(refused(r#"{"bearing":{"pulses":[1,2]}}"#), "bearing.pulses: expected an object {...}");
    assert!(refused("{").contains("EOF"));
    assert!(refused("{} {}").contains("trailing"));
    assert!(refused(r#"{"max_time_s":1,"max_time_s":2}"#).contains("duplicate"));
    assert_eq!(refused("[]"), "scenario: expected an object {...}");
    assert_eq!(refused(r#"{"limits":[1,2]}"#), "limits: expected an object {...}");
    assert_eq!(refused(r#"{"obstacles":[[1,2,0.3]]}"#), "obstacles[0]: expected an object {...}");
}

/// A number of the schema: its path, and its limits.
struct Number {
    path: Vec<String>,
    limits: [f64; 2],
}

fn is_kind(part: &Value, kinds: &[&str]) -> bool {
    let listed = |kind: &Value| kinds.iter().any(|wanted| kind == wanted);
    let kind = &part["type"];
    listed(kind) || kind.as_array().is_some_and(|all| all.iter().any(listed))
}

fn numbers(part: &Value, path: &[String], found: &mut Vec<Number>) {
    let part = SCHEMA.resolved(part);
    if is_kind(part, &["number", "integer"]) {
        let limit = |name: &str| part[name].as_f64().unwrap_or_else(|| panic!("{path:?} has no {name}: {part}"));
        found.push(Number { path: path.to_vec(), limits: [limit("minimum"), limit("maximum")] });
    }
    for (key, value) in part["properties"].as_object().unwrap_or(&Map::new()) {
        numbers(value, &[path, std::slice::from_ref(key)].concat(), found);
    }
    if let Some(items) = part.get("items") {
        let all = part["minItems"].as_u64().unwrap_or(1);
        for index in 0..all {
            numbers(items, &[path, &[index.to_string()]].concat(), found);
        }
    }
}

/// A scenario with every key.
fn full() -> Value {
    json!({
        "bounds": [0, 0, 10, 10], "start": [1, 1], "goal": [9, 9], "goal_velocity": [0, 0],
        "obstacles": [{"x": 3, "y": 3, "r": 0.3}],
        "people": [{"route": [[5, 5]], "heading_deg": 0}],
        "random": {"radius": [0.1, 0.2]},
        "walls": [{"x0": 0, "y0": 0, "x1": 5, "y1": 0}], "antenna": {"boresight_deg": [0, 0, 0, 0]},
        "bearing": {"snr_db": 20, "outlier": {}, "dropout": [0, 1], "pulses": {"period_s": 1, "length_s": 0.5}},
        "other_beacons": [{"x": 1, "y": 1, "offset_hz": 3000}], "wind": {}, "position": {},
        "landing": {"pad": [0, 0], "camera": {"cut": [0, 1], "blind": [0, 1]}}, "sensor": {}, "limits": {},
        "vehicle": {},
        "faults": {"nan_bearing": [0, 1], "stale_obstacles": [0, 1], "stale_ownship": [0, 1],
            "dead_channels": [[0, 1], [0, 1], [0, 1], [0, 1]]},
    })
}

fn parsed(path: &[String], value: f64) -> Result<Scenario, String> {
    let mut scenario = full();
    if path.iter().any(|key| key == "track") {
        scenario["people"] = json!([{"track": [[0, 5, 5], [1, 6, 5]]}]);
    }
    let is_of_radio = path.iter().any(|key| ["mount_deg", "tag"].contains(&key.as_str()));
    if is_of_radio || path.iter().any(|key| ["place_bias_deg", "rate_hz"].contains(&key.as_str())) {
        // Of a radio or the noise model only, in which there are no channels.
        scenario["bearing"]["model"] = json!(if is_of_radio { "uudf" } else { "noise" });
        scenario["other_beacons"] = json!([]);
        (scenario["antenna"], scenario["faults"]["dead_channels"]) = (Value::Null, json!([null, null, null, null]));
    }
    let mut place = &mut scenario;
    for key in path {
        place = match place {
            Value::Array(list) => &mut list[key.parse::<usize>().unwrap()],
            other => &mut other[key.as_str()],
        };
    }
    let is_whole = ["bearing tag", "random count", "camera width", "camera height", "0 group", "sensor rays"]
        .iter()
        .any(|whole| path.len() > 1 && path[path.len() - 2..].join(" ") == **whole);
    *place = if is_whole { json!(value as i64) } else { json!(value) };
    Scenario::parse(&scenario.to_string()).map_err(|error| error.to_string())
}

#[test]
fn every_number_has_limits_and_the_reader_keeps_them() {
    let mut found = Vec::new();
    numbers(&SCHEMA.root, &[], &mut found);
    assert!(found.len() > 60, "{}", found.len());
    for Number { path, limits: [low, high] } in found {
        let off = 1.0_f64.max(1e-3 * (high - low));
        for beyond in [low - off, high + off] {
            let error = parsed(&path, beyond).expect_err(&format!("{path:?} = {beyond}"));
            assert!(
                error.contains("is outside") && error.contains(path.last().unwrap()),
                "{path:?} = {beyond}: {error}"
            );
        }
        for limit in [low, high] {
            // Any error at the limit must be about another number.
            if let Err(error) = parsed(&path, limit) {
                let about = [
                    "bounds",
                    "its length",
                    "radius",
                    "length_s",
                    "dropout",
                    "faults",
                    "cut",
                    "blind",
                    "people[0]:",
                    "is inside",
                    "farther than the hull",
                    "a view of 155 degrees",
                    "only where sensor.model",
                ];
                assert!(about.iter().any(|one| error.contains(one)), "{path:?} = {limit}: {error}");
            }
        }
    }
}

#[test]
fn every_key_says_what_it_is_and_no_other_may_stand_beside_it() {
    for known in &SCHEMA.keys {
        let mut part = &SCHEMA.root;
        for key in known.split('.') {
            part = SCHEMA.resolved(part);
            assert_eq!(part["additionalProperties"], false, "{known}");
            let (name, is_list) = key.strip_suffix("[]").map_or((key, false), |name| (name, true));
            part = &part["properties"][name];
            assert!(part["description"].as_str().is_some_and(|text| text.len() > 3), "{known}: {part}");
            part = if is_list { &part["items"] } else { part };
        }
    }
}
