//! The README's two commands on a machine that has just got Rust: `cargo xtask fresh`.

use std::process::Command;

use crate::build::in_a_clone;
use crate::{Failure, attend};

/// Clones what is committed and runs `.ci/run` there, which makes the new homes. The clone takes some 15 GB.
pub(crate) fn run(no_run: bool) -> Result<(), Failure> {
    in_a_clone("fresh", |clone| {
        let mut check = Command::new(clone.join(".ci/run"));
        // Cargo has put the libraries of the toolchain that runs us there.
        attend(check.args(no_run.then_some("--no-run")).env_remove("LD_LIBRARY_PATH"))
    })
}
