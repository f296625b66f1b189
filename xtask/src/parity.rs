//! The same flights on the host and in QEMU: every trace hash must be the same on both.
//!
//! The hash runs over the bearings, the plans with all their waypoints, and the setpoints, in bits. The flights go in turn
//! through the built-in mission, `tests/scenarios` and `tests/traps`, and through the three planners.

use std::path::PathBuf;
use std::process::Stdio;

use serde_json::Value;

use crate::Failure;
use crate::board;
use crate::build::{Image, simulator, workspace};

const PLANNERS: [&str; 3] = ["foxhound", "paper", "standard"];

/// Flies, and prints a table.
pub(crate) fn run(flights: u32) -> Result<(), Failure> {
    let image = Image::build(board::TWIN, "foxhound-firmware")?;
    let scenarios = scenarios(&["tests/scenarios", "tests/traps"])?;

    println!("| seed | scenario | planner | result | s | trace on the host | in QEMU |");
    println!("|---|---|---|---|---|---|---|");
    let mut different = 0;
    for seed in 1..=flights {
        let scenario = scenarios.get(seed as usize % (scenarios.len() + 1));
        // Not in step with the scenarios.
        let planner = PLANNERS[seed as usize / PLANNERS.len() % PLANNERS.len()];
        let [host, twin] = fly(&image, scenario, planner, seed)?;
        let [name, result, time_s, ours, theirs] =
            [&host["name"], &host["result"], &host["time_s"], &host["trace_hash"], &twin["trace_hash"]].map(word);
        println!("| {seed} | {name} | {planner} | {result} | {time_s} | {ours} | {theirs} |");
        different += u32::from(ours != theirs);
    }
    println!("\n{} of {flights} flights have the same trace on both.", flights - different);
    if different == 0 { Ok(()) } else { Err(Failure(format!("{different} flights differ"))) }
}

/// The files of these folders, in order.
pub(crate) fn scenarios(folders: &[&str]) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    for folder in folders {
        let unreadable = |error: std::io::Error| Failure(format!("{folder}: {error}"));
        for entry in std::fs::read_dir(workspace().join(folder)).map_err(unreadable)? {
            found.push(entry.map_err(unreadable)?.path());
        }
    }
    found.sort();
    Ok(found)
}

/// What a flight prints on the host, and in QEMU.
fn fly(image: &Image, scenario: Option<&PathBuf>, planner: &str, seed: u32) -> Result<[Value; 2], Failure> {
    let one = |via: &str| {
        let mut fly = simulator();
        fly.args(["--bin", "foxhound", "--", "fly", "--json", "--via", via, "--planner", planner]);
        fly.args(["--seed", &seed.to_string()]);
        if let Some(scenario) = scenario {
            fly.arg("--scenario").arg(scenario);
        }
        let output = fly.stderr(Stdio::inherit()).output().map_err(|error| Failure(format!("foxhound: {error}")))?;
        serde_json::from_slice(&output.stdout).map_err(|error| Failure(format!("seed {seed} through {via}: {error}")))
    };
    Ok([one("host")?, one(&format!("qemu:{}", image.elf.display()))?])
}

/// A value without quotation marks.
fn word(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
