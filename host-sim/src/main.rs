//! `foxhound`: fly a mission, find bearings, look into telemetry logs.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
