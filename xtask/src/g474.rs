//! The image in an instruction emulator: `host-sim/examples/g474.rs`, in release.

use crate::board;
use crate::build::{Image, cargo};
use crate::{Failure, attend};

/// Flies so many missions by the image, the desktop and QEMU, and prints `docs/results/g474.md`.
pub(crate) fn run(seeds: u32) -> Result<(), Failure> {
    let image = Image::build(board::NUCLEO, "foxhound-firmware")?;
    let twin = Image::build(board::TWIN, "foxhound-firmware")?;
    let example = ["run", "--release", "--package", "foxhound-sim", "--example", "g474", "--"];
    attend(cargo().args(example).args([&image.elf, &twin.elf]).arg(seeds.to_string()))
}
