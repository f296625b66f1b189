//! The two exchangeable parts of the chain: the bearing estimator and the planner.

use crate::base::error::ConfigError;
use crate::base::obstacle::Disc;
use crate::doa::bearing::{Bearing, BearingEstimator};
use crate::guidance::{Config, Guidance};
use crate::planning::planner::{Answer, PlanRequest, Planner, Workspace};
use crate::signal::phase::Phasors;

/// The bearing estimator and the planner of a flight. The core's own are those of [`Planner`]; to compare others with
/// them, implement this trait.
pub trait Systems: Clone + core::fmt::Debug + Sized {
    /// The systems that a configuration names.
    ///
    /// # Errors
    /// The field that is refused.
    fn build(config: &Config) -> Result<Self, ConfigError>;

    /// Guidance for these systems.
    ///
    /// # Errors
    /// The field that is refused.
    fn guidance<const N: usize>(config: &Config) -> Result<Guidance<N>, ConfigError> {
        config.build()
    }

    /// The bearing from a set of phasors. `estimator` has the array and the calibration.
    fn bearing(&self, estimator: &BearingEstimator, phasors: &Phasors) -> Bearing {
        estimator.estimate(phasors)
    }

    /// Answers one request; `known` are the known obstacles.
    fn answer(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Answer;

    /// The answer to stay where the request starts.
    fn brake(&self, request: &PlanRequest) -> Answer;
}

/// The core's own systems.
impl Systems for Planner {
    fn build(config: &Config) -> Result<Self, ConfigError> {
        config.build_planner()
    }

    fn answer(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Answer {
        Self::answer(self, workspace, request, known)
    }

    fn brake(&self, request: &PlanRequest) -> Answer {
        Self::brake(self, request)
    }
}
