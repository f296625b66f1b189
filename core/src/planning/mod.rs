//! Plans a trajectory from the source's estimate and the known obstacles, and selects where to search when no signal is
//! received. This module may import `base`, `mapping` and `localize`.

pub mod explore;
pub mod field;
pub mod ilqr;
pub mod planner;
pub mod rollout;
pub mod wavefront;
