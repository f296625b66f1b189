//! The README's two commands on a machine that has just got Rust: `cargo xtask fresh`.

use std::process::Command;

use crate::build::workspace;
use crate::{Failure, attend};

/// Clones what is committed into a new folder below the system's temporary one (`TMPDIR`) and runs `.ci/run` there, which
/// makes the new homes. A failure leaves the folder behind; it takes some 15 GB.
pub(crate) fn run(no_run: bool) -> Result<(), Failure> {
    let folder = std::env::temp_dir().join(format!("foxhound-fresh-{}", std::process::id()));
    println!("cloning into {}", folder.display());
    attend(Command::new("git").args(["clone", "--quiet"]).arg(workspace()).arg(&folder))?;
    let mut check = Command::new(folder.join(".ci/run"));
    // Cargo has put the libraries of the toolchain that runs us there.
    attend(check.args(no_run.then_some("--no-run")).env_remove("LD_LIBRARY_PATH"))?;
    std::fs::remove_dir_all(&folder).map_err(|error| Failure(format!("{}: {error}", folder.display())))
}
