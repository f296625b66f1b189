//! The flashed configuration in every setting: waveforms and scans together, each autopilot's delays, both hulls.
//!
//! Every two values of sensor, bearings, vehicle and hull meet at least once, on held-out seeds
//! ([`foxhound_sim::study::seeds`]). The
//! whole product: `cargo xtask campaign`, `docs/results/matrix.md`.
//!
//! Known failures are listed flight by flight in `tests/flight/snapshots`, collisions also in [`COLLIDES`], with
//! their cause. A flight that fails and is not listed fails the test, and so does a listed one that no longer fails.
//! A change that fixes some renews the lists:
//! `INSTA_UPDATE=always cargo test -p foxhound-tests --test flight matrix`, and shows it in its diff.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use foxhound_sim::study::matrix::{
    HULLS_M, Row, Setting, World, barn, corners, forests, gusty, pairwise, pillars, thickets, traps,
};
use foxhound_sim::study::seeds;
use foxhound_tests::root;

/// Results of the worlds in each setting; those for one hull are not those for the other.
fn flown(settings: &[Setting], worlds: impl Fn(f64) -> Vec<World>) -> Vec<(String, Row)> {
    let by_hull = HULLS_M.map(worlds);
    let hull = |setting: &Setting| usize::from(setting.hull_m() == HULLS_M[1]);
    settings.iter().map(|setting| (setting.name(), setting.fly(&by_hull[hull(setting)]).unwrap())).collect()
}

/// Where collisions are known: settings and worlds whose names have this in them, and why.
const COLLIDES: [(&str, &str, &str); 2] = [
    ("scan", "movers", "a scan reports no velocity, and what comes from outside its view is not seen"),
    (
        "PX4",
        "gusts, ",
        "PX4 holds no position under velocity setpoints: a strong gust carries it farther than the margin",
    ),
];

/// The failures are those listed, and each collision has a known cause.
fn only_known_failures(kind: &str, rows: &[(String, Row)]) {
    let flights: u32 = rows.iter().map(|(_, row)| row.flights).sum();
    let mut failures = Vec::new();
    let mut strangers = Vec::new();
    for (setting, row) in rows {
        failures.extend(row.collided.iter().chain(&row.others).map(|failure| format!("{setting}: {failure}")));
        let is_known = |world: &str| COLLIDES.iter().any(|(s, w, _)| setting.contains(s) && world.starts_with(w));
        strangers
            .extend(row.collided.iter().filter(|one| !is_known(&one.world)).map(|one| format!("{setting}: {one}")));
    }
    insta::assert_snapshot!(kind, format!("{} of {flights} flights\n{}", failures.len(), failures.join("\n")));
    assert!(strangers.is_empty(), "{kind}: {strangers:?}");
}

/// Forests of the main paper's densities: in 15 of 60 settings no flight fails but the listed ones.
#[test]
fn forests_of_the_papers_densities_are_flown_in_every_setting() {
    let rows = flown(&pairwise(), |hull_m| forests(hull_m, seeds::test(20), 4).unwrap());
    only_known_failures("matrix_forests", &rows);
}

/// Corners in which the path is longer than 1.06 of the shortest: the 72 sectors of a scan over 360 deg are 5 deg wide.
const LONGER: [&str; 2] = ["scan 360 deg 4 m, drawn, point, hull 0.215", "scan 360 deg 4 m, 20 dB, PX4, hull 0.15"];

/// 800 pairs of start and goal in each corner of the matrix: no flight fails but the listed ones.
/// Twenty forests of the main paper's densities, 40 pairs each.
#[test]
fn eight_hundred_pairs_are_flown_in_the_corners_of_the_matrix() {
    let rows = flown(&corners(), |hull_m| forests(hull_m, seeds::test(20), 40).unwrap());
    only_known_failures("matrix_corners", &rows);
    let longer: Vec<&str> =
        rows.iter().filter(|(_, row)| row.length_ratio.unwrap() > 1.06).map(|(name, _)| name.as_str()).collect();
    assert_eq!(longer, LONGER);
}

/// Random pillars: in 15 of 60 settings no flight fails but the listed ones.
#[test]
fn random_pillars_are_flown_in_every_setting() {
    let rows = flown(&pairwise(), |_| pillars(seeds::test(40)).unwrap());
    only_known_failures("matrix_pillars", &rows);
}

/// Dense corridors: in 15 of 60 settings no flight fails but the listed ones.
#[test]
fn dense_corridors_are_flown_in_every_setting() {
    let rows = flown(&pairwise(), |_| thickets(seeds::test(12)).unwrap());
    only_known_failures("matrix_thickets", &rows);
}

/// Traps: in 15 of 60 settings no flight ends otherwise than expected but the listed ones.
#[test]
fn traps_end_as_they_should_in_every_setting() {
    let rows = flown(&pairwise(), |_| traps(&root().join("tests/traps"), &seeds::test(20)).unwrap());
    only_known_failures("matrix_traps", &rows);
}

/// Walls, gaps and pillars in strong gusts: in 15 of 60 settings no flight fails but the listed ones.
#[test]
fn walls_gaps_and_pillars_in_strong_gusts_are_flown_in_every_setting() {
    let rows = flown(&pairwise(), |_| gusty(seeds::test(4)).unwrap());
    only_known_failures("matrix_gusts", &rows);
}

/// BARN's worlds: in 15 of 60 settings no flight fails but the listed ones.
/// BARN's worlds lie beside the repository, where they lie at all.
#[test]
fn barns_worlds_are_flown_in_every_setting() {
    let folder = root().join("../shared/data/barn");
    if barn(&folder, HULLS_M[0], &seeds::TEST, 10).unwrap().is_none() {
        eprintln!("SKIPPED: there is no {}: BARN's worlds are not flown", folder.display());
        return;
    }
    let rows = flown(&pairwise(), |hull_m| barn(&folder, hull_m, &seeds::TEST, 10).unwrap().unwrap());
    only_known_failures("matrix_barn", &rows);
}
