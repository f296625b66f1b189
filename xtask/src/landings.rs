//! Flights to their very end: `host-sim/examples/landings.rs`, in release.

use crate::build::cargo;
use crate::{Failure, attend};

/// Flies so many of each scene, and prints the table of `docs/landing.md`.
pub(crate) fn run(flights: u32) -> Result<(), Failure> {
    let example = ["run", "--release", "--package", "foxhound-sim", "--example", "landings", "--"];
    attend(cargo().args(example).arg(flights.to_string()))
}
