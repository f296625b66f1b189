//! Every setting of sensor, bearings, vehicle and hull over every kind of world, on held-out seeds: the page
//! `docs/results/matrix.md`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::{Failure, Row, Setting, World};
use crate::scenario::input::InputError;
use crate::study::{matrix, seeds};

/// Pairs of start and goal in each of 20 forests.
const PAIRS: usize = 4;

type Kind = (&'static str, Vec<World>);

/// What is flown.
#[derive(Clone, Debug)]
pub struct Settings {
    /// How many times as many flights.
    pub times: u64,
    /// Where BARN's worlds are.
    pub barn: PathBuf,
    /// Part of the names of those settings that are flown.
    pub only: String,
    /// Called with what is flown next.
    pub tell: fn(&str),
}

/// The worlds of each kind, for a hull of that radius.
fn worlds(hull_m: f64, settings: &Settings) -> Result<Vec<Kind>, InputError> {
    let Settings { times, barn, tell, .. } = settings;
    let traps = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/traps");
    let mut kinds = vec![
        ("Forests of the main paper's densities", matrix::forests(hull_m, seeds::test(20 * times), PAIRS)?),
        ("Random pillars", matrix::pillars(seeds::test(20 * times))?),
        ("Dense corridors", matrix::thickets(seeds::test(25 * times))?),
        ("Traps", matrix::traps(&traps, &seeds::test(2 * times))?),
        ("Walls, gaps and random pillars in gusts of 2.5 m/s", matrix::gusty(seeds::test(5 * times))?),
    ];
    match matrix::barn(barn, hull_m, &seeds::TEST, 3)? {
        Some(worlds) => kinds.push(("BARN, every third of the even worlds", worlds)),
        None => tell(&format!("matrix: there is no {}: BARN's worlds are not flown", barn.display())),
    }
    Ok(kinds)
}

/// Flies all of it and writes the page.
///
/// # Errors
/// A world cannot be drawn, or a flight cannot be flown.
pub fn page(of: &Settings) -> Result<String, InputError> {
    let settings: Vec<Setting> = matrix::product().into_iter().filter(|one| one.name().contains(&of.only)).collect();
    let by_hull = [worlds(matrix::HULLS_M[0], of)?, worlds(matrix::HULLS_M[1], of)?];
    let mut rows: Vec<(&str, Vec<Row>)> = by_hull[0].iter().map(|(name, _)| (*name, Vec::new())).collect();
    for (number, setting) in settings.iter().enumerate() {
        (of.tell)(&format!("{} of {}: {}", number + 1, settings.len(), setting.name()));
        let hull = usize::from(setting.hull_m() == matrix::HULLS_M[1]);
        for ((_, rows), (_, worlds)) in rows.iter_mut().zip(&by_hull[hull]) {
            rows.push(setting.fly(worlds)?);
        }
    }
    let mut text = format!(
        "# Every setting\n\n\
         `cargo xtask campaign` writes this page: every combination of obstacle sensor, bearings, vehicle and radius of the hull (m) over\n\
         every kind of world. All seeds are from the test range, {} up to {} (`host-sim/src/study/seeds.rs`), on which nothing is tuned.\n\
         `tests/flight/matrix.rs` flies a part of it in every run. What did not end as expected is named below each table; the\n\
         depth of a collision is how far the hull was inside an obstacle when the flight was ended. Two of the traps, `start_in` and\n\
         `start_in_side`, begin inside a pillar: the least clearance of the traps is that of their start.\n",
        seeds::TEST.start,
        seeds::TEST.end - 1,
    );
    for (name, rows) in &rows {
        section(&mut text, name, &settings, rows);
    }
    Ok(text)
}

fn section(text: &mut String, name: &str, settings: &[Setting], rows: &[Row]) {
    let _ = writeln!(text, "\n## {name}\n");
    let _ = writeln!(
        text,
        "| setting | flights | as expected | collisions | length over the shortest | least clearance, m |"
    );
    let _ = writeln!(text, "|---|---|---|---|---|---|");
    let mut sum = [0; 3];
    for (setting, row) in settings.iter().zip(rows) {
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
        let counts = [row.flights, row.as_expected, row.collided.len() as u32];
        let [flights, as_expected, collided] = counts;
        let (ratio, clearance) = (number(row.length_ratio), number(row.clearance_m));
        let _ =
            writeln!(text, "| {} | {flights} | {as_expected} | {collided} | {ratio} | {clearance} |", setting.name());
        sum = [0, 1, 2].map(|k| sum[k] + counts[k]);
    }
    let [flights, as_expected, collided] = sum;
    let _ = writeln!(text, "| all | {flights} | {as_expected} | {collided} | | |\n");
    if flights == as_expected {
        return;
    }
    let _ = writeln!(text, "| setting | outcome | world and seed |\n|---|---|---|");
    for (setting, row) in settings.iter().zip(rows) {
        let mut outcomes: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for Failure { world, seed, outcome } in row.collided.iter().chain(&row.others) {
            outcomes.entry(outcome).or_default().push(format!("{world} {seed}"));
        }
        for (outcome, flights) in outcomes {
            let _ = writeln!(text, "| {} | {outcome} | {} |", setting.name(), flights.join("; "));
        }
    }
}
