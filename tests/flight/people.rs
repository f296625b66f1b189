//! Flights among people who walk on and do not step aside: recorded ones, and drawn ones.
//!
//! Each row prints what it came to; `docs/results/people.md` has the rows. Constants were chosen on the same recorded
//! people, by flights with development seeds: the other half of the recording is for others.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs::File;
use std::path::Path;

use flate2::read::GzDecoder;
use foxhound_sim::drive::flight::Ending;
use foxhound_sim::scenario::Scenario;
use foxhound_sim::study::{flight, seeds};
use foxhound_sim::world::random::Random;
use foxhound_tests::root;
use serde_json::{Map, Value, json};

const TOLD_1: &str = r#"{"sensor":{"fov_deg":360,"range_m":5}}"#;
const TOLD_2: &str = r#"{"sensor":{"fov_deg":360,"range_m":5},"limits":{"v_max":2}}"#;
const SCAN_360: &str = r#"{"sensor":{"model":"scan","fov_deg":360,"range_m":5}}"#;
const SCAN_90: &str = r#"{"sensor":{"model":"scan"}}"#;
const TOLD_90: &str = "{}";

/// What the flights of one setting came to.
struct Row {
    flights: usize,
    hit: usize,
    reached: usize,
    /// Seconds for each metre between start and goal, of the flights that reached it.
    pace_spm: f64,
}

/// Flies scenarios with waveforms at 20 dB in a setting, beside a vehicle model.
fn fly(worlds: &[Value], setting: &str, vehicle: &str) -> Row {
    let setting: Map<String, Value> = serde_json::from_str(setting).unwrap();
    let mut row = Row { flights: worlds.len(), hit: 0, reached: 0, pace_spm: 0.0 };
    for (world, seed) in worlds.iter().zip(seeds::TEST) {
        let mut world = world.as_object().unwrap().clone();
        world.extend(setting.clone());
        world.extend([("bearing".into(), json!({"snr_db": 20})), ("vehicle".into(), json!({"model": vehicle}))]);
        let scenario = Scenario::parse(&Value::Object(world).to_string()).unwrap();
        let report = flight::report(scenario, seed, |_| ()).unwrap();
        row.hit += usize::from(report.collisions > 0);
        if report.result == Ending::Reached {
            row.reached += 1;
            row.pace_spm += report.time_s / report.straight_line_m;
        }
    }
    row.pace_spm /= row.reached.max(1) as f64;
    row
}

/// Flies the settings and holds each to the most flights that may hit somebody, and the fewest that have to arrive.
fn hold(worlds: &[Value], settings: &[(&str, &str, &str, usize, usize)]) {
    let mut over = Vec::new();
    for (name, setting, vehicle, most_hit, least_reached) in settings {
        let Row { flights, hit, reached, pace_spm } = fly(worlds, setting, vehicle);
        eprintln!("{name}, {vehicle}: of {flights} flights {hit} hit somebody, {reached} reached, {pace_spm:.2} s/m");
        if hit > *most_hit || reached < *least_reached {
            over.push(format!("{name}, {vehicle}: {hit} hit, {reached} reached"));
        }
    }
    assert!(over.is_empty(), "{over:?}");
}

/// The recorded people, if they lie beside the repository.
fn recorded(folder: &Path) -> Option<Vec<Value>> {
    let packed = File::open(folder.join("cases-dev.json.gz")).ok()?;
    let mut file: Map<String, Value> = serde_json::from_reader(GzDecoder::new(packed)).unwrap();
    let cases = file.remove("cases")?;
    Some(cases.as_object()?.values().cloned().collect())
}

/// 225 flights among recorded people: in each setting no more hit somebody than `docs/results/people.md` says; told where all walk,
/// at 1 m/s, a point mass hits nobody. The recording lies beside the repository, where it lies at all.
#[test]
fn recorded_people_who_do_not_step_aside_are_evaded() {
    let folder = root().join("../shared/data/people");
    let Some(worlds) = recorded(&folder) else {
        eprintln!("SKIPPED: there is no {}: recorded people are not flown past", folder.display());
        return;
    };
    hold(
        &worlds,
        &[
            ("told all round, 1 m/s", TOLD_1, "point", 0, 225),
            ("told all round, 2 m/s", TOLD_2, "point", 1, 224),
            ("scan of 72 sectors all round", SCAN_360, "point", 25, 200),
            ("scan of 90 deg, 3 m", SCAN_90, "point", 63, 162),
            ("told in 90 deg, 3 m", TOLD_90, "point", 43, 182),
            ("told all round, 1 m/s", TOLD_1, "arducopter", 8, 217),
            ("told all round, 2 m/s", TOLD_2, "arducopter", 23, 202),
            ("scan of 72 sectors all round", SCAN_360, "arducopter", 44, 181),
            ("scan of 90 deg, 3 m", SCAN_90, "arducopter", 101, 124),
        ],
    );
}

/// Ten people cross the way of each of 40 flights; each would meet a vehicle that flies straight on.
fn drawn() -> Vec<Value> {
    let world = |seed: u64| {
        let mut random = Random::new(seed, 24);
        let people: Vec<Value> = (0..10)
            .map(|k| {
                let (met_s, heading_rad) = (2.0 + f64::from(k), std::f64::consts::TAU * random.uniform());
                let speed = 1.0 + 0.8 * random.uniform();
                let (vx, vy) = (speed * heading_rad.cos(), speed * heading_rad.sin());
                let met_x = met_s + random.uniform() - 0.5;
                json!({"x": met_x - vx * met_s, "y": -vy * met_s, "r": 0.3, "vx": vx, "vy": vy})
            })
            .filter(|person| person["x"].as_f64().unwrap().hypot(person["y"].as_f64().unwrap()) > 1.5)
            .collect();
        json!({"start": [0, 0], "goal": [13, 0], "obstacles": people, "max_time_s": 60})
    };
    seeds::test(40).map(world).collect()
}

/// 40 flights across the ways of ten people each: told where they walk a point mass hits nobody, ArduCopter two.
#[test]
fn drawn_people_who_cross_the_way_are_evaded() {
    hold(
        &drawn(),
        &[
            ("told all round, 1 m/s", TOLD_1, "point", 0, 40),
            ("scan of 72 sectors all round", SCAN_360, "point", 7, 33),
            ("told all round, 1 m/s", TOLD_1, "arducopter", 2, 38),
            ("scan of 72 sectors all round", SCAN_360, "arducopter", 15, 25),
        ],
    );
}
