//! What the firmware's twin flies: `cargo xtask qemu <fly | bench | faults>`.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::board;
use crate::build::{Image, cargo, workspace};
use crate::{Failure, attend, bench};

/// The built-in mission with many seeds, on the host and in QEMU.
pub(crate) fn fly(seeds: u32) -> Result<(), Failure> {
    let via = format!("qemu:{}", image()?.elf.display());
    println!("| seed | result | s | trace on the host | in QEMU |\n|---|---|---|---|---|");
    let mut bad = 0;
    for seed in 0..seeds {
        let (host, twin) = (mission("host", seed)?, mission(&via, seed)?);
        let word = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let [result, time_s, ours, theirs] =
            [&twin["result"], &twin["time_s"], &host["trace_hash"], &twin["trace_hash"]].map(word);
        println!("| {seed} | {result} | {time_s} | {ours} | {theirs} |");
        bad += u32::from(result != "reached" || ours != theirs);
    }
    println!("\n{} of {seeds} missions reached the beacon with the same trace on both.", seeds - bad);
    if bad == 0 { Ok(()) } else { Err(Failure(format!("{bad} missions did not, or differ"))) }
}

fn mission(via: &str, seed: u32) -> Result<Value, Failure> {
    let mut fly = simulator();
    fly.args(["--bin", "foxhound", "--", "fly", "--json", "--via", via, "--seed", &seed.to_string()]);
    let output = fly.stderr(Stdio::inherit()).output().map_err(|error| Failure(format!("foxhound: {error}")))?;
    serde_json::from_slice(&output.stdout).map_err(|error| Failure(format!("seed {seed} through {via}: {error}")))
}

/// The stages, then whole missions.
pub(crate) fn bench() -> Result<(), Failure> {
    let stages = bench::run(false);
    println!();
    let folder = workspace().join("tests/scenarios");
    let unreadable = |error: std::io::Error| Failure(format!("{}: {error}", folder.display()));
    let entries = std::fs::read_dir(&folder).map_err(unreadable)?;
    let mut scenarios: Vec<PathBuf> =
        entries.map(|entry| entry.map(|entry| entry.path())).collect::<Result<_, _>>().map_err(unreadable)?;
    scenarios.sort();
    let mut missions = simulator();
    missions.args(["--example", "worst", "--"]).arg(image()?.elf).args(scenarios);
    attend(&mut missions)?;
    stages
}

/// Many missions with random faults, or one of them.
pub(crate) fn faults(missions: u32, faults: u32, record: &Path, seed: Option<u64>) -> Result<(), Failure> {
    let mut campaign = simulator();
    campaign.args(["--example", "faults", "--"]).arg(image()?.elf);
    campaign.args(["--missions", &missions.to_string(), "--faults", &faults.to_string()]).arg("--record").arg(record);
    if let Some(seed) = seed {
        campaign.args(["--seed", &seed.to_string()]);
    }
    attend(&mut campaign)
}

fn image() -> Result<Image, Failure> {
    Image::build(board::TWIN, "foxhound-firmware")
}

/// `cargo run` of the simulator, in release.
fn simulator() -> Command {
    let mut cargo = cargo();
    cargo.args(["run", "--release", "--quiet", "--package", "foxhound-sim"]);
    cargo
}
