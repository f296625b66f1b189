//! What the firmware's twin flies: `cargo xtask qemu <bench | faults>`.

use std::path::Path;

use crate::board;
use crate::build::{Image, simulator};
use crate::parity;
use crate::{Failure, attend, bench};

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
