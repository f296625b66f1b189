//! The two places of the chain at which another system may stand: what finds bearings, and what plans.

use crate::base::error::ConfigError;
use crate::base::obstacle::Disc;
use crate::doa::bearing::{Bearing, BearingEstimator};
use crate::guidance::{Config, Guidance};
use crate::planning::planner::{Plan, PlanRequest, Planner, Workspace};
use crate::signal::phase::Phasors;

/// What a flight is flown with. The core's own systems are those of [`Planner`]; who compares others with them implements this
/// and drives the flight with it.
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

    /// The bearing that a set of phasors tells. `estimator` knows the array and the calibration.
    fn bearing(&self, estimator: &BearingEstimator, phasors: &Phasors) -> Bearing {
        estimator.estimate(phasors)
    }

    /// Answers one request; `known` are the known obstacles.
    fn plan(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Plan;

    /// The answer that says to stay where the request starts.
    fn brake(&self, request: &PlanRequest) -> Plan;
}

/// The core's own systems.
impl Systems for Planner {
    fn build(config: &Config) -> Result<Self, ConfigError> {
        config.planner.build()
    }

    fn plan(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Plan {
        Self::plan(self, workspace, request, known)
    }

    fn brake(&self, request: &PlanRequest) -> Plan {
        Self::brake(self, request)
    }
}
