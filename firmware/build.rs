//! Takes in the board that is chosen, or the host, where the program is built for that; puts its memory map where the linker looks
//! for it, and links the way cortex-m-rt and defmt want it.
//!
//! A board is a file `NAME.rs` in `src/boards`, with its memory map `NAME/memory.x` beside it, and the feature `board-NAME`.

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?).join("src/boards");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    let name = chosen(&folder)?;
    // The path of a module in braces is that of a folder.
    let module = format!("#[path = {folder:?}]\nmod folder {{\n    pub mod {name};\n}}\npub use folder::{name};\n");
    let alias = format!("/// The board that is chosen.\npub type Chosen = {name}::Machine;\n");
    // As long as any path makes it: defmt tells messages apart by their place behind this text, so that the image would depend on
    // the path.
    fs::write(out.join("chosen.rs"), format!("{:<6000}\n", module + &alias))?;
    if name != HOST {
        place_linker_scripts(&folder.join(name), &out)?;
    }
    println!("cargo::rerun-if-changed={}", folder.display());
    println!("cargo::rerun-if-changed=build.rs");
    Ok(())
}

/// The board that needs no feature: this machine.
const HOST: &str = "host";

/// The one board that has its feature set; the host, where the program is built for that.
fn chosen(folder: &Path) -> Result<String, Box<dyn std::error::Error>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.join("memory.x").exists() {
            names.extend(path.file_name().map(|name| name.to_string_lossy().into_owned()));
        }
    }
    names.sort();
    let is_chosen = |name: &&String| env::var_os(format!("CARGO_FEATURE_BOARD_{}", name.to_uppercase())).is_some();
    let is_host = env::var("CARGO_CFG_TARGET_OS")? != "none";
    let mut chosen = names.iter().filter(is_chosen);
    match (chosen.next(), chosen.next()) {
        (None, _) if is_host => Ok(HOST.to_owned()),
        (Some(name), _) if is_host => Err(format!("board-{name} is not for this machine: add --target").into()),
        (Some(name), None) => Ok(name.clone()),
        _ => Err(format!("choose one board: --features board-NAME, where NAME is one of {}", names.join(", ")).into()),
    }
}

/// The board's `memory.x` and, where an interrupt controller has no names from a crate, its `device.x`.
fn place_linker_scripts(from: &Path, out: &Path) -> Result<(), Box<dyn std::error::Error>> {
    for script in ["memory.x", "device.x"] {
        let script_from = from.join(script);
        if script_from.exists() {
            fs::copy(&script_from, out.join(script))?;
        }
    }
    println!("cargo::rustc-link-search={}", out.display());
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
    Ok(())
}
