//! Every setting of sensor, bearings, vehicle and hull over forests and dense corridors; prints a table.
//! `cargo xtask campaign` runs it. All seeds are held out (`foxhound_sim::seeds`).

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::process::ExitCode;

use foxhound_sim::input::InputError;
use foxhound_sim::matrix::{self, Row, Setting};
use foxhound_sim::seeds;

/// Forests and corridors in each setting, and pairs of start and goal in each forest.
const FORESTS: u64 = 40;
const PAIRS: usize = 20;
const CORRIDORS: u64 = 200;

fn main() -> ExitCode {
    println!("| setting | worlds | flights | reached | collisions | path over the shortest | least clearance, m |");
    println!("|---|---|---|---|---|---|---|");
    match matrix::product().iter().try_for_each(fly) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("matrix: {error}");
            ExitCode::FAILURE
        }
    }
}

fn fly(setting: &Setting) -> Result<(), InputError> {
    let forests = matrix::forests(setting, seeds::test(FORESTS), PAIRS)?;
    let corridors = matrix::thickets(setting, seeds::test(CORRIDORS))?;
    for (name, worlds) in [("forests", forests), ("corridors", corridors)] {
        let Row { flights, reached, collided, others, length_ratio, clearance_m } = matrix::fly(&worlds)?;
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
        let (ratio, clearance) = (number(length_ratio), number(clearance_m));
        println!(
            "| {} | {name} | {flights} | {reached} | {} | {ratio} | {clearance} |",
            setting.name(),
            collided.len()
        );
        for (world, seed) in collided {
            eprintln!("{}: {world}, seed {seed}: collision", setting.name());
        }
        for (world, seed, outcome) in others {
            eprintln!("{}: {world}, seed {seed}: {outcome}", setting.name());
        }
    }
    Ok(())
}
