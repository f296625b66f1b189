//! A trajectory from what is believed of the source and what is in the way, and where to look when nothing is heard. It may
//! import `base`, `mapping` and `localize`.

pub mod explore;
pub mod field;
pub mod ilqr;
pub mod planner;
pub mod rollout;
pub mod wavefront;
