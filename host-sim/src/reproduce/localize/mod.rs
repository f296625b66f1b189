//! `localize`: what the mmWave paper shows of its filters and planner on simple maps (its section V-A and V-B), K. Pfeiffer
//! et al., "Path Planning Under Uncertainty to Localize mmWave Sources".
//!
//! - [`filters`]: how well filters localize, in line of sight and behind walls (fig. 2 and 3).
//! - [`paths`]: paths on which bearings tell more, among three obstacles (fig. 4 and Table 2).
//! - [`leg`]: how well the range is known after half a leg, flown straight and as planned.

pub mod filters;
pub mod leg;
pub mod paths;
