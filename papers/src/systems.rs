//! The papers' systems beside the core's own, for a flight.

use crate::aoa::{self, AnyEstimator};
use foxhound_core::base::error::ConfigError;
use foxhound_core::doa::bearing::{Bearing, Finder};
use foxhound_core::guidance::systems::Systems;
use foxhound_core::guidance::{Config, Guidance};
use foxhound_core::planning::planner::{Plan, PlanRequest, Planner, Scratch};
use foxhound_core::signal::phase::Phasors;

/// Any planner and any estimator of bearings that a configuration names, the papers' and the core's own.
#[derive(Clone, Debug)]
pub struct AllSystems {
    planner: Planner,
    estimator: AnyEstimator,
}

impl Systems for AllSystems {
    fn build(config: &Config) -> Result<Self, ConfigError> {
        let planner = config.planner.build()?;
        let estimator = AnyEstimator::build(&config.bearing, &config.array.build()?)?;
        Ok(Self { planner, estimator })
    }

    fn guidance<const N: usize>(config: &Config) -> Result<Guidance<N>, ConfigError> {
        Config { bearing: aoa::own(&config.bearing), ..*config }.build()
    }

    fn bearing(&self, finder: &Finder, phasors: &Phasors) -> Bearing {
        self.estimator.find(finder, phasors)
    }

    fn plan(&self, scratch: &mut Scratch, request: &PlanRequest) -> Plan {
        self.planner.plan(scratch, request)
    }

    fn brake(&self, request: &PlanRequest) -> Plan {
        self.planner.brake(request)
    }
}
