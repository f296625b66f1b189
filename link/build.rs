//! Turns `dialect/foxhound.xml` into Rust. Reads one file, writes two, starts no program.

use std::error::Error;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=dialect/foxhound.xml");
    // Features of the crate that the generator was made for; this one has none of them.
    println!("cargo::rustc-check-cfg=cfg(feature, values(\"arbitrary\", \"serde\", \"ts-rs\"))");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let mut generated = File::create(out.join("foxhound.rs"))?;
    mavlink_bindgen::parser::generate(Path::new("dialect"), Path::new("foxhound.xml"), &mut generated)?;
    // The generated file starts with inner attributes, so it must be a module's own file.
    fs::write(out.join("dialect.rs"), "mod foxhound;\npub use foxhound::*;\n")?;
    Ok(())
}
