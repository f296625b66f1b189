//! Worlds in which it once hit something, or stayed where it was, each with waveforms and a scan of 90 degrees.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::guidance;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::HostComputer;
use foxhound_sim::drive::flight::{self, Ending, Mission};
use foxhound_sim::scenario::Scenario;
use foxhound_sim::study::seeds;
use foxhound_tests::in_parallel;
use serde_json::{Value, json};

const FLIGHTS: u64 = 6;

/// A row of pillars from place to place, so close that nothing gets through.
fn row(from: [f64; 2], to: [f64; 2]) -> Vec<Value> {
    let [along, across] = [to[0] - from[0], to[1] - from[1]];
    let count = (along.hypot(across) / 0.14).ceil();
    let at = |k: f64| json!({"x": from[0] + along * k / count, "y": from[1] + across * k / count, "r": 0.1});
    (0..=count as u32).map(|k| at(f64::from(k))).collect()
}

/// Flies a world on held-out seeds; all must reach the beacon, without a collision.
fn fly(world: &Value, obstacles: Vec<Value>) {
    fly_with(world, obstacles, |_| ());
}

/// The same, with a configuration that is changed before.
fn fly_with(world: &Value, obstacles: Vec<Value>, tune: impl Fn(&mut guidance::Config) + Sync) {
    let mut all = json!({"start": [0, 0], "goal": [8, 0], "bounds": [-12, -8, 12, 8], "max_time_s": 120,
        "sensor": {"model": "scan"}, "bearing": {"snr_db": 20}, "vehicle": {"model": "arducopter"}});
    all["obstacles"] = Value::Array(obstacles);
    all.as_object_mut().unwrap().extend(world.as_object().unwrap().clone());
    let scenario = Scenario::parse(&all.to_string()).unwrap();
    let seeds: Vec<u64> = seeds::test(FLIGHTS).collect();
    let reports = in_parallel(&seeds, |seed| {
        let (planner, estimator) = (planner::Config::default(), Estimator::CrossSpectrum);
        let mission = Mission { scenario: scenario.clone(), seed: *seed, planner, estimator };
        let mut config = mission.guidance();
        tune(&mut config);
        let mut computer = HostComputer::new(&config).unwrap();
        flight::fly(&mission, &mut computer, None, |_| ()).unwrap().report
    });
    for (seed, report) in seeds.iter().zip(reports) {
        assert!(report.result == Ending::Reached && report.collisions == Some(0), "seed {seed}: {report:?}");
    }
}

/// A steady wind is no gust: it does not make the vehicle back into a pillar that it has not seen.
#[test]
fn a_steady_wind_does_not_make_it_back_into_what_it_has_not_seen() {
    let pillar = |x: f64| json!({"x": x, "y": 0, "r": 0.2});
    for wind_mps in [4.0, -4.0, 8.0] {
        let world = json!({"wind": {"vx": wind_mps, "vy": 0, "gust_mps": 0}});
        fly(&world, vec![pillar(0.55), pillar(-0.55)]);
    }
}

/// At 5 dB a beacon behind a U of pillars is reached, though it is taken for a mirror image first.
#[test]
fn a_weak_beacon_that_is_taken_for_a_mirror_image_is_reached_all_the_same() {
    let u = [row([4.0, -1.0], [4.0, 1.0]), row([1.0, 1.0], [4.0, 1.0]), row([1.0, -1.0], [4.0, -1.0])].concat();
    fly(&json!({"bearing": {"snr_db": 5}}), u);
}

/// A vehicle of 3 and of 8 m/s leaves a box 0.8 m wide.
#[test]
fn a_fast_vehicle_leaves_a_narrow_box() {
    let walls = [row([-1.0, 0.4], [0.4, 0.4]), row([0.4, 0.4], [0.4, -0.4]), row([-1.0, -0.4], [0.4, -0.4])].concat();
    for v_max in [3.0, 8.0] {
        fly(&json!({"limits": {"v_max": v_max}}), walls.clone());
    }
}

/// A beacon behind half a ring of pillars, of 0.7 to 1.3 m radius, is reached.
#[test]
fn a_curved_wall_is_not_a_pillar_with_the_beacon_inside() {
    for radius_m in [0.7, 0.9, 1.1, 1.3] {
        let place = |k: u32| {
            let (sin, cos) = (std::f64::consts::FRAC_PI_2 + std::f64::consts::PI * f64::from(k) / 30.0).sin_cos();
            json!({"x": radius_m * cos, "y": radius_m * sin, "r": 0.1})
        };
        fly(&json!({"start": [-6, 0], "goal": [0, 0]}), (0..=30).map(place).collect());
    }
}

/// A vehicle that may brake with 0.2 m/s^2 only slows down before it turns: it keeps off the large pillars that it turns between.
#[test]
fn a_vehicle_that_brakes_gently_slows_before_it_turns() {
    let pillar = |[x, y, r]: [f64; 3]| json!({"x": x, "y": y, "r": r});
    let first = [[5.03, 0.287, 2.057], [0.409, -3.721, 1.157], [1.141, 3.332, 1.86], [7.614, -3.882, 1.592]];
    let first = [&first[..], &[[9.98, 3.721, 2.377], [3.569, -3.507, 1.405], [1.087, -0.925, 1.054]]].concat();
    let second = [[1.059, 2.054, 1.533], [7.243, -2.185, 1.61], [4.689, 0.923, 1.523], [2.686, -3.224, 1.933]];
    let second = [&second[..], &[[7.351, 3.941, 1.375], [10.725, -0.394, 1.638], [-0.857, -1.581, 1.209]]].concat();
    let sensor = json!({"model": "circles", "fov_deg": 360, "range_m": 20});
    for (pillars, goal, v_max, a_max, autopilot) in
        [(first, [10.0, -2.423], 1.5, 0.2, "arducopter"), (second, [10.0, 3.174], 1.0, 0.1, "px4")]
    {
        let world = json!({"goal": goal, "limits": {"v_max": v_max}, "sensor": sensor,
            "bearing": {"sigma_deg": 1.86}, "vehicle": {"model": "arducopter", "autopilot": autopilot}});
        let pillars = pillars.into_iter().map(pillar).collect();
        fly_with(&world, pillars, |config| config.guard.a_max_mps2 = a_max);
    }
}

/// With the margins that the manual asks for on a first flight, a gap in which they cannot be kept is flown around.
#[test]
fn with_wide_margins_it_flies_around_a_narrow_gap() {
    for gap_m in [0.5, 0.6, 0.8] {
        let pillar = |side: f64| json!({"x": 4.0, "y": side * (0.5 * gap_m + 0.2), "r": 0.2});
        for autopilot in ["arducopter", "px4"] {
            let world = json!({"limits": {"v_max": 0.5}, "vehicle": {"model": "arducopter", "autopilot": autopilot}});
            fly_with(&world, vec![pillar(1.0), pillar(-1.0)], |config| {
                (config.planner.margin_m, config.planner.tight_margin_m, config.guard.margin_m) = (0.5, 0.3, 0.2);
                (config.guard.a_max_mps2, config.planner.bends) = (1.0, false);
            });
        }
    }
}
