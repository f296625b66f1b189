//! The papers' algorithms together with the core's own, for a flight.

use crate::aoa::{self, AnyEstimator};
use crate::apf::{self, AnyPlanner};
use foxhound_core::base::error::ConfigError;
use foxhound_core::base::obstacle::Disc;
use foxhound_core::doa::bearing::{Bearing, BearingEstimator};
use foxhound_core::guidance::systems::Systems;
use foxhound_core::guidance::{Config, Guidance};
use foxhound_core::planning::planner::{Answer, PlanRequest, Workspace};
use foxhound_core::signal::phase::Phasors;

/// Any planner and any bearing estimator that a configuration names, the papers' and the core's own.
#[derive(Clone, Debug)]
pub struct AllSystems {
    planner: AnyPlanner,
    estimator: AnyEstimator,
}

impl Systems for AllSystems {
    fn build(config: &Config) -> Result<Self, ConfigError> {
        let planner = AnyPlanner::build(&config.planner, &config.vehicle, &config.sensor, &config.guard)?;
        let estimator = AnyEstimator::build(&config.bearing, &config.array.build()?)?;
        Ok(Self { planner, estimator })
    }

    fn guidance<const N: usize>(config: &Config) -> Result<Guidance<N>, ConfigError> {
        let (bearing, planner) = (aoa::own(&config.bearing), apf::own(&config.planner));
        Config { bearing, planner, ..*config }.build()
    }

    fn bearing(&self, estimator: &BearingEstimator, phasors: &Phasors) -> Bearing {
        self.estimator.estimate(estimator, phasors)
    }

    fn answer(&self, workspace: &mut Workspace, request: &PlanRequest, known: &[Disc]) -> Answer {
        self.planner.answer(workspace, request, known)
    }

    fn brake(&self, request: &PlanRequest) -> Answer {
        self.planner.brake(request)
    }
}
