//! Flights in gusts: `host-sim/examples/gusts.rs`, in release.

use crate::build::cargo;
use crate::{Failure, attend};

/// Flies so many in each scene and weather, and prints the table of `docs/gusts.md`.
pub(crate) fn run(flights: u32) -> Result<(), Failure> {
    let example = ["run", "--release", "--package", "foxhound-sim", "--example", "gusts", "--"];
    attend(cargo().args(example).arg(flights.to_string()))
}
