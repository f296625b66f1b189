//! Puts the board's memory map where the linker looks for it, and links the way cortex-m-rt and defmt want it.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let twin = env::var_os("CARGO_FEATURE_BOARD_MPS2_AN386").is_some();
    let map = if twin { "src/boards/mps2_an386/memory.x" } else { "src/boards/nucleo_g474re/memory.x" };
    place(Path::new(map), &out.join("memory.x"))?;
    if twin {
        // cortex-m-rt asks for the names of a chip's interrupts; this board's table holds the functions themselves.
        fs::write(out.join("device.x"), "")?;
    }
    println!("cargo::rustc-link-search={}", out.display());
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
    println!("cargo::rerun-if-changed=build.rs");
    Ok(())
}

fn place(from: &Path, to: &Path) -> io::Result<()> {
    println!("cargo::rerun-if-changed={}", from.display());
    fs::copy(from, to).map(|_| ())
}
