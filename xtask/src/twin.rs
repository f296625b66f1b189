//! What the firmware's twin flies: `cargo xtask qemu <fly | bench | faults>`.

use std::path::Path;

use crate::board;
use crate::build::{Image, simulator};
use crate::parity::{self, word};
use crate::{Failure, attend, bench};

/// The built-in mission with many seeds, on the host and in QEMU.
pub(crate) fn fly(seeds: u32) -> Result<(), Failure> {
    let image = image()?;
    println!("| seed | result | s | trace on the host | in QEMU |\n|---|---|---|---|---|");
    let mut bad = 0;
    for seed in 0..seeds {
        let [host, twin] = parity::fly(&image, None, "foxhound", seed)?;
        let [result, time_s, ours, theirs] =
            [&twin["result"], &twin["time_s"], &host["trace_hash"], &twin["trace_hash"]].map(word);
        println!("| {seed} | {result} | {time_s} | {ours} | {theirs} |");
        bad += u32::from(result != "reached" || ours != theirs);
    }
    println!("\n{} of {seeds} missions reached the beacon with the same trace on both.", seeds - bad);
    if bad == 0 { Ok(()) } else { Err(Failure(format!("{bad} missions did not, or differ"))) }
}

/// The stages, then whole missions.
pub(crate) fn bench() -> Result<(), Failure> {
    let stages = bench::run();
    println!();
    let mut missions = simulator();
    missions.args(["--example", "worst", "--"]).arg(image()?.elf).args(parity::scenarios(&["tests/scenarios"])?);
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
