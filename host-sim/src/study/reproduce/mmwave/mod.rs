//! `mmwave`: agents that search for a transmitter indoors by its angle of arrival, after K. Pfeiffer et al., "Path Planning
//! Under Uncertainty to Localize mmWave Sources" (the paper here), sections IV and V, table 3 and fig. 6.
//!
//! The paper's maps and ray tracings are not at hand: `plan` draws flats of rooms, corridors, doors and furniture,
//! `radio` traces the strongest path. A robot of which only the place counts (`trial`) discovers the walls with a range
//! sensor and goes by A* on what it knows (`known`); where nothing of use is received, it explores (`explore`). All of that
//! is the same for all agents (`agent`), which differ in where they want to go:
//!
//! - one knows the transmitter, for reference;
//! - the baseline, reference 11 of the paper (M. Yin et al., "Millimeter Wave Wireless Assisted Robot Navigation With Link State
//!   Classification", 2022): a target 0.6 m ahead along the raw angle of arrival while the link is direct or reflected once,
//!   exploration otherwise, and for a while when it stays in one place; offset and patience are those of its published code;
//! - the paper's switch between exploration and what the filters say, [`foxhound_core::localize::source::bank`];
//! - ours, which in addition goes from one point of reflection to the next at higher orders: at the point of reflection
//!   the link is of one order less;
//! - the same with covariance minimisation (`bend`).
//!
//! White noise from cycle to cycle also averages while the robot stays where it is. Ours listens for a few cycles when the
//! link changes and the bearing is vague: that costs no path length, but cycles, so both are reported.

mod agent;
mod bend;
mod cycle;
mod explore;
mod known;
mod plan;
mod radio;
mod report;
mod scenarios;
mod trial;
mod walls;

use rayon::prelude::{IntoParallelRefIterator as _, ParallelIterator as _};

use crate::scenario::input::InputError;
use crate::study::reproduce::Watch;
use crate::study::reproduce::settings::Settings;
use agent::Kind;
pub use report::Report;
use report::Searched;
use std::sync::atomic::{AtomicU64, Ordering};
use trial::{Noise, Trial};

/// Noise of the angle of arrival: none, the paper's, and the paper's with a state of the link that is sometimes wrong.
const NOISES: [Noise; 3] = [
    Noise { sigma_rad: 0.0, link_error_rate: 0.0 },
    Noise { sigma_rad: 0.35, link_error_rate: 0.0 },
    Noise { sigma_rad: 0.35, link_error_rate: 0.1 },
];

/// How many searches an experiment with that many scenarios has.
#[must_use]
pub fn searches(scenarios: u32) -> u64 {
    (NOISES.len() * Kind::ALL.len()) as u64 * u64::from(scenarios)
}

/// Runs the experiment on all cores; the result does not depend on how many there are. `watch` is called with how many searches
/// are done, of [`searches`].
///
/// # Errors
/// None that the built-in configuration could cause.
fn run(settings: &Settings, watch: Watch<'_>) -> Result<Report, InputError> {
    let plans = scenarios::plans(settings.seed);
    let scenarios = scenarios::scenarios(&plans, settings.seed, settings.scenarios as usize);
    let done = AtomicU64::new(0);
    let mut searched = Vec::new();
    for noise in NOISES {
        let mut trials = Vec::new();
        for kind in Kind::ALL {
            let search = |scenario: &scenarios::Scenario| {
                let trial = trial::search(&plans[scenario.plan], &scenario.start, kind, noise);
                watch(done.fetch_add(1, Ordering::Relaxed) + 1);
                trial
            };
            trials.push(scenarios.par_iter().map(search).collect::<Result<Vec<Trial>, _>>()?);
        }
        searched.push(Searched { noise, trials });
    }
    Ok(Report::of(settings, plans, &scenarios, searched))
}
