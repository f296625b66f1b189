//! Every setting of sensor, bearings, vehicle and hull over every kind of world, on held-out seeds; writes
//! `docs/results/matrix.md`. `cargo xtask campaign` runs it: how many times as many flights, where BARN's worlds are, the page.
//! With a part of a setting's name behind them, only those settings, and onto standard output.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use foxhound_sim::study::matrix::{self, Failure, Row, Setting, World};
use foxhound_sim::study::seeds;

/// Pairs of start and goal in each of 20 forests.
const PAIRS: usize = 4;

type Kind = (&'static str, Vec<World>);

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (times, barn, page, only) = match &arguments[..] {
        [times, barn, page] => (times, barn, Some(page), ""),
        [times, barn, _, only] => (times, barn, None, only.as_str()),
        _ => {
            eprintln!("usage: matrix TIMES BARN PAGE [SETTING]");
            return ExitCode::from(2);
        }
    };
    let done = written(times.parse().unwrap_or(1), Path::new(barn), only).and_then(|text| match page {
        Some(page) => Ok(std::fs::write(page, text)?),
        None => {
            println!("{text}");
            Ok(())
        }
    });
    if let Err(error) = done {
        eprintln!("matrix: {error}");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// The worlds of each kind, for a hull of that radius.
fn worlds(hull_m: f64, times: u64, barn: &Path) -> Result<Vec<Kind>, Box<dyn Error>> {
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
        None => eprintln!("matrix: there is no {}: BARN's worlds are not flown", barn.display()),
    }
    Ok(kinds)
}

/// The page.
fn written(times: u64, barn: &Path, only: &str) -> Result<String, Box<dyn Error>> {
    let settings: Vec<Setting> = matrix::product().into_iter().filter(|one| one.name().contains(only)).collect();
    let by_hull = [worlds(matrix::HULLS_M[0], times, barn)?, worlds(matrix::HULLS_M[1], times, barn)?];
    let mut rows: Vec<(&str, Vec<Row>)> = by_hull[0].iter().map(|(name, _)| (*name, Vec::new())).collect();
    for (number, setting) in settings.iter().enumerate() {
        eprintln!("{} of {}: {}", number + 1, settings.len(), setting.name());
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
         depth of a collision is how far the hull was inside an obstacle when the flight was ended.\n",
        seeds::TEST.start,
        seeds::TEST.end - 1,
    );
    for (name, rows) in &rows {
        section(&mut text, name, &settings, rows)?;
    }
    Ok(text)
}

fn section(text: &mut String, name: &str, settings: &[Setting], rows: &[Row]) -> Result<(), std::fmt::Error> {
    writeln!(text, "\n## {name}\n")?;
    writeln!(text, "| setting | flights | as expected | collisions | length over the shortest | least clearance, m |")?;
    writeln!(text, "|---|---|---|---|---|---|")?;
    let mut sum = [0; 3];
    for (setting, row) in settings.iter().zip(rows) {
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
        let counts = [row.flights, row.as_expected, row.collided.len() as u32];
        let [flights, as_expected, collided] = counts;
        let (ratio, clearance) = (number(row.length_ratio), number(row.clearance_m));
        writeln!(text, "| {} | {flights} | {as_expected} | {collided} | {ratio} | {clearance} |", setting.name())?;
        sum = [0, 1, 2].map(|k| sum[k] + counts[k]);
    }
    let [flights, as_expected, collided] = sum;
    writeln!(text, "| all | {flights} | {as_expected} | {collided} | | |\n")?;
    if flights == as_expected {
        return Ok(());
    }
    writeln!(text, "| setting | outcome | world and seed |\n|---|---|---|")?;
    for (setting, row) in settings.iter().zip(rows) {
        let mut outcomes: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for Failure { world, seed, outcome } in row.collided.iter().chain(&row.others) {
            outcomes.entry(outcome).or_default().push(format!("{world} {seed}"));
        }
        for (outcome, flights) in outcomes {
            writeln!(text, "| {} | {outcome} | {} |", setting.name(), flights.join("; "))?;
        }
    }
    Ok(())
}
