//! What is flashed, flown in every setting: waveforms and scans together, behind each autopilot's delays, with either hull.
//!
//! Every two values of sensor, bearings, vehicle and hull meet at least once. All seeds are held out
//! ([`foxhound_sim::seeds`]). The whole product: `cargo xtask campaign`, `docs/results/matrix.md`.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_sim::matrix::{Row, Setting, World, fly, forests, pairwise, thickets};
use foxhound_sim::scenario::Scenario;
use foxhound_sim::seeds;
use foxhound_sim::suite::{Selection, Suite};
use foxhound_tests::root;

/// Flies worlds in every setting: none collides, and at least so many of all arrive.
fn check(reached_share: f64, worlds: impl Fn(&Setting) -> Vec<World>) -> Vec<(Setting, Row)> {
    let rows: Vec<(Setting, Row)> = pairwise().into_iter().map(|one| (one, fly(&worlds(&one)).unwrap())).collect();
    for (setting, row) in &rows {
        assert!(row.collided.is_empty(), "{}: {row:?}", setting.name());
        assert!(f64::from(row.reached) >= reached_share * f64::from(row.flights), "{}: {row:?}", setting.name());
    }
    rows
}

#[test]
fn forests_of_the_papers_densities_are_flown_without_a_collision_in_every_setting() {
    for (setting, row) in check(0.985, |setting| forests(setting, seeds::test(20), 4).unwrap()) {
        assert!(row.length_ratio.unwrap() <= 1.06, "{}: {row:?}", setting.name());
    }
}

#[test]
fn dense_corridors_are_flown_without_a_collision_in_every_setting() {
    check(0.98, |setting| thickets(setting, seeds::test(50)).unwrap());
}

/// Half of the worlds of the BARN benchmark, which may not be copied into this repository.
#[test]
fn the_barn_benchmark_is_flown_without_a_collision_in_every_setting() {
    let file = root().join("../shared/data/barn/worlds-dev.json.gz");
    if !file.exists() {
        eprintln!("SKIPPED: {} is not there, so the BARN worlds are not flown", file.display());
        return;
    }
    let unpacked = std::process::Command::new("gzip").arg("-dc").arg(&file).output().unwrap();
    let suite = Suite::parse(&String::from_utf8(unpacked.stdout).unwrap()).unwrap();
    check(149.0 / 150.0, |setting| {
        let suite = Suite { drone_radius: setting.hull_m(), ..suite.clone() };
        let flights = suite.flights(seeds::TEST.start, &Selection::default());
        let world = |scenario: &Scenario, seed| World { scenario: setting.equip(scenario), seed, shortest_m: None };
        flights.iter().map(|flight| world(&flight.scenario, flight.seed)).collect()
    });
}
