//! The long runs: `host-sim/examples/soak.rs`, in release.

use crate::build::cargo;
use crate::{Failure, attend};

/// Runs them for so many simulated hours, and prints the tables of `docs/soak.md`.
pub(crate) fn run(hours: f64) -> Result<(), Failure> {
    let example = ["run", "--release", "--package", "foxhound-sim", "--example", "soak", "--"];
    attend(cargo().args(example).arg(hours.to_string()))
}
