//! One mission of the image, compared with the desktop and QEMU.

use std::path::Path;

use foxhound_computer::twin::Setup;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::guidance::FrontEnd;
use foxhound_core::guidance::param::Values;
use foxhound_core::planning::planner;
use serde_json::Value;

use super::{G474Computer, Needs, Options, Received};
use crate::drive::flight::{self, Mission};
use crate::drive::qemu::QemuComputer;
use crate::drive::replay::{self, Summary};
use crate::scenario::Scenario;

/// Its result. The desktop's hash was the image's at every step: a flight ends where they differ.
#[derive(Debug)]
pub struct Trial {
    /// The flight.
    pub report: flight::Report,
    /// The result of replaying its log.
    pub replayed: Summary,
    /// Steps of QEMU's twin with the same input, with the same hash at every one.
    pub twin_steps: usize,
    /// Steps of the flight.
    pub steps: usize,
    /// The use of the board's time.
    pub timing: Value,
}

/// Flies the built-in mission with the image and, with the same input, with the twin, if there is one.
///
/// # Errors
/// The error, or the first step with a different result.
pub fn fly(elf: &Path, twin: Option<&Path>, seed: u64) -> Result<Trial, String> {
    let (planner, estimator) = (planner::Config::default(), Estimator::default());
    let mut mission = Mission { scenario: Scenario::built_in(), seed, planner, estimator };
    let config = mission.guidance();
    let needs = Needs::of(&mut mission, &config, &Values::of(&config)).map_err(|error| error.to_string())?;
    let options = Options { seed, ..Options::default() };
    let mut computer = G474Computer::start(elf, options, &needs).map_err(|error| error.to_string())?;
    computer.keep_heard();
    let record = flight::fly(&mission, &mut computer, None, |_| ()).map_err(|error| error.to_string())?;
    let heard = computer.take_heard();
    let log = crate::drive::computer::Computer::take_flight_log(&mut computer);
    let replayed = replay::replay(&log).map_err(|error| error.to_string())?;
    let guidance = *computer.config().ok_or("the flight log has no beginning")?;
    let timing = computer.board().timing().map_err(|error| error.to_string())?;
    drop(computer);
    let twin_steps = match twin {
        Some(twin) => repeat(twin, &Setup { guidance, needs_entry: false }, &heard)?,
        None => 0,
    };
    Ok(Trial { report: record.report, replayed, twin_steps, steps: heard.len(), timing })
}

/// Repeats the same input in the twin.
fn repeat(twin: &Path, setup: &Setup, heard: &[Received]) -> Result<usize, String> {
    let mut twin = QemuComputer::start(twin, setup).map_err(|error| error.to_string())?;
    for (number, step) in heard.iter().enumerate() {
        let front_end = step.snapshot.as_deref().map_or(FrontEnd::Nothing, FrontEnd::Frame);
        let report = twin.step(step.now, front_end, None, &step.rx).map_err(|error| error.to_string())?;
        let (here, there) = (report.output.trace_hash, step.trace_hash);
        if here != there {
            return Err(format!("QEMU and the image differ from step {number}: trace {here:016x} and {there:016x}"));
        }
    }
    Ok(heard.len())
}
