//! The JSON schema of scenario files, with which an editor completes keys, explains them and marks errors.
//!
//! It is made from the types that the files are read into, with their comments, defaults and ranges. Relations
//! between two numbers are not in it, for example that a pulse is no longer than its period. `foxhound schema`
//! prints `scenarios/scenario.schema.json`; `tests/flight/scenarios.rs` checks that.

use schemars::generate::SchemaSettings;
use serde_json::Value;

use super::file::Scenario;

/// The JSON schema (draft 2020-12) of a scenario file.
#[must_use]
pub fn schema() -> Value {
    let mut schema = SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<Scenario>();
    schema.insert("title".to_owned(), "Foxhound scenario".into());
    schema.to_value()
}

#[cfg(test)]
mod tests {
    use serde_json::{Map, json};

    use super::*;
    use crate::scenario::file::{FLIGHT_KEYS, KEYS};

    /// A number of the schema: its path, and its limits.
    struct Number {
        path: Vec<String>,
        limits: [f64; 2],
    }

    /// The definition that a part of the schema refers to.
    fn resolved<'a>(root: &'a Value, part: &'a Value) -> &'a Value {
        let part = part.get("anyOf").and_then(|choices| choices.get(0)).unwrap_or(part);
        match part.get("$ref").and_then(Value::as_str) {
            Some(name) => root.pointer(name.trim_start_matches('#')).unwrap(),
            None => part,
        }
    }

    fn is_kind(part: &Value, kinds: &[&str]) -> bool {
        let listed = |kind: &Value| kinds.iter().any(|wanted| kind == wanted);
        let kind = &part["type"];
        listed(kind) || kind.as_array().is_some_and(|all| all.iter().any(listed))
    }

    fn numbers(root: &Value, part: &Value, path: &[String], found: &mut Vec<Number>) {
        let part = resolved(root, part);
        if is_kind(part, &["number", "integer"]) {
            let limit = |name: &str| part[name].as_f64().unwrap_or_else(|| panic!("{path:?} has no {name}: {part}"));
            found.push(Number { path: path.to_vec(), limits: [limit("minimum"), limit("maximum")] });
        }
        for (key, value) in part["properties"].as_object().unwrap_or(&Map::new()) {
            numbers(root, value, &[path, std::slice::from_ref(key)].concat(), found);
        }
        if let Some(items) = part.get("items") {
            let all = part["minItems"].as_u64().unwrap_or(1);
            for index in 0..all {
                numbers(root, items, &[path, &[index.to_string()]].concat(), found);
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
        if path.iter().any(|key| ["place_bias_deg", "rate_hz"].contains(&key.as_str())) {
            // Of the noise model only, in which there are no channels.
            scenario["bearing"]["model"] = json!("noise");
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
        let is_whole = ["random count", "camera width", "camera height", "0 group", "sensor rays"]
            .iter()
            .any(|whole| path.len() > 1 && path[path.len() - 2..].join(" ") == **whole);
        *place = if is_whole { json!(value as i64) } else { json!(value) };
        Scenario::parse(&scenario.to_string()).map_err(|error| error.to_string())
    }

    #[test]
    fn every_number_has_the_limits_that_the_reader_has() {
        let root = schema();
        let mut found = Vec::new();
        numbers(&root, &root, &[], &mut found);
        assert!(found.len() > 60, "{}", found.len());
        for Number { path, limits: [low, high] } in found {
            let off = 1.0_f64.max(1e-3 * (high - low));
            for beyond in [low - off, high + off] {
                let error = parsed(&path, beyond).expect_err(&format!("{path:?} = {beyond}"));
                // Below zero it is not a count at all.
                let is_told = error.contains("is outside") || error.contains("expected u32");
                assert!(is_told && error.contains(path.last().unwrap()), "{path:?} = {beyond}: {error}");
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
                    ];
                    assert!(about.iter().any(|one| error.contains(one)), "{path:?} = {limit}: {error}");
                }
            }
        }
    }

    #[test]
    fn it_knows_the_keys_that_the_reader_knows_and_says_what_they_are() {
        let root = schema();
        for known in FLIGHT_KEYS.into_iter().chain(KEYS) {
            let mut part = &root;
            for key in known.split('.') {
                part = resolved(&root, part);
                assert_eq!(part["additionalProperties"], false, "{known}");
                let (name, is_list) = key.strip_suffix("[]").map_or((key, false), |name| (name, true));
                part = &part["properties"][name];
                assert!(part["description"].as_str().is_some_and(|text| text.len() > 3), "{known}: {part}");
                part = if is_list { &part["items"] } else { part };
            }
        }
    }
}
