//! One flight of a study: its report, with everything but the scenario as it is by default.

use foxhound_core::doa::bearing::Estimator;
use foxhound_core::guidance;
use foxhound_core::planning::planner;

use crate::drive::computer::HostComputer;
use crate::drive::flight::{self, Mission, Report};
use crate::scenario::Scenario;
use crate::scenario::input::InputError;

/// Flies a scenario with the desktop's computer, whose configuration may be changed before.
///
/// # Errors
/// A configuration is refused, or the flight cannot be flown.
pub fn report(scenario: Scenario, seed: u64, tune: impl Fn(&mut guidance::Config)) -> Result<Report, InputError> {
    let mission = Mission { scenario, seed, planner: planner::Config::default(), estimator: Estimator::CrossSpectrum };
    let mut config = mission.guidance();
    tune(&mut config);
    let mut computer = HostComputer::new(&config)?;
    let record = flight::fly(&mission, &mut computer, None, |_| ())
        .map_err(|error| InputError::new(format!("{}: {error}", mission.scenario.name)))?;
    Ok(record.report)
}
