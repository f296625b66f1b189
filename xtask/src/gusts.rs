//! Flights in gusts: `host-sim/examples/gusts.rs`, in release.

use std::process::Command;

use crate::build::workspace;
use crate::{Failure, attend};

/// Flies so many in each scene and weather, and prints the table of `docs/gusts.md`.
pub(crate) fn run(flights: u32) -> Result<(), Failure> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(workspace()).args(["run", "--release", "--package", "foxhound-sim", "--example", "gusts", "--"]);
    attend(cargo.arg(flights.to_string()))
}
