//! The same flights on the host and in QEMU: every trace hash must be the same on both.
//!
//! The hash runs over the bearings, the plans with all their waypoints, and the setpoints, in bits. The flights go in turn
//! through the built-in mission, `tests/scenarios` and `tests/traps`, and through the three planners.

use std::path::PathBuf;
use std::process::Stdio;

use serde_json::Value;

use crate::Failure;
use crate::board;
use crate::build::{Image, cargo, workspace};

const PLANNERS: [&str; 3] = ["foxhound", "paper", "standard"];

/// Flies, and prints a table.
pub(crate) fn run(flights: u32) -> Result<(), Failure> {
    let image = Image::build(board::TWIN, "foxhound-firmware")?;
    let via = format!("qemu:{}", image.elf.display());
    let scenarios = scenarios()?;

    println!("| seed | scenario | planner | result | s | trace on the host | in QEMU |");
    println!("|---|---|---|---|---|---|---|");
    let mut different = 0;
    for seed in 1..=flights {
        let scenario = scenarios.get(seed as usize % (scenarios.len() + 1));
        // Not in step with the scenarios.
        let planner = PLANNERS[seed as usize / PLANNERS.len() % PLANNERS.len()];
        let (host, twin) = (fly("host", scenario, planner, seed)?, fly(&via, scenario, planner, seed)?);
        different += u32::from(host["trace_hash"] != twin["trace_hash"]);
        let word = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        println!(
            "| {seed} | {} | {planner} | {} | {} | {} | {} |",
            word(&host["name"]),
            word(&host["result"]),
            word(&host["time_s"]),
            word(&host["trace_hash"]),
            word(&twin["trace_hash"]),
        );
    }
    println!("\n{} of {flights} flights have the same trace on both.", flights - different);
    if different == 0 { Ok(()) } else { Err(Failure(format!("{different} flights differ"))) }
}

fn scenarios() -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    for folder in ["tests/scenarios", "tests/traps"] {
        let unreadable = |error: std::io::Error| Failure(format!("{folder}: {error}"));
        for entry in std::fs::read_dir(workspace().join(folder)).map_err(unreadable)? {
            found.push(entry.map_err(unreadable)?.path());
        }
    }
    found.sort();
    Ok(found)
}

fn fly(via: &str, scenario: Option<&PathBuf>, planner: &str, seed: u32) -> Result<Value, Failure> {
    let mut fly = cargo();
    fly.args(["run", "--release", "--quiet", "--package", "foxhound-sim", "--"]);
    fly.args(["fly", "--json", "--via", via, "--planner", planner, "--seed", &seed.to_string()]);
    if let Some(scenario) = scenario {
        fly.arg("--scenario").arg(scenario);
    }
    let output = fly.stderr(Stdio::inherit()).output().map_err(|error| Failure(format!("foxhound: {error}")))?;
    serde_json::from_slice(&output.stdout).map_err(|error| Failure(format!("seed {seed} through {via}: {error}")))
}
