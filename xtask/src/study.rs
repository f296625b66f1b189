//! Long campaigns of flights: the programs in `host-sim/examples`, in release. Each prints the table of a page in `docs`.

use crate::build::cargo;
use crate::{Failure, attend};

/// Runs one of them with its arguments.
pub(crate) fn run(example: &str, arguments: &[&str]) -> Result<(), Failure> {
    let example = ["run", "--release", "--package", "foxhound-sim", "--example", example, "--"];
    attend(cargo().args(example).args(arguments))
}
