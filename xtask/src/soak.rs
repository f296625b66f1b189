//! The long runs: `host-sim/examples/soak.rs`, in release.

use std::process::Command;

use crate::build::workspace;
use crate::{Failure, attend};

/// Runs them for so many simulated hours, and prints the tables of `docs/soak.md`.
pub(crate) fn run(hours: f64) -> Result<(), Failure> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(workspace()).args(["run", "--release", "--package", "foxhound-sim", "--example", "soak", "--"]);
    attend(cargo.arg(hours.to_string()))
}
