//! Flights to their very end: `host-sim/examples/landings.rs`, in release.

use std::process::Command;

use crate::build::workspace;
use crate::{Failure, attend};

/// Flies so many of each scene, and prints the table of `docs/landing.md`.
pub(crate) fn run(flights: u32) -> Result<(), Failure> {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    let example = ["run", "--release", "--package", "foxhound-sim", "--example", "landings", "--"];
    attend(cargo.current_dir(workspace()).args(example).arg(flights.to_string()))
}
