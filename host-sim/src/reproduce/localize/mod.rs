//! `localize`: what the mmWave paper shows of its filters and planner on simple maps (its section V-A and V-B), K. Pfeiffer
//! et al., "Path Planning Under Uncertainty to Localize mmWave Sources".
//!
//! - [`filters`]: how well filters localize, in line of sight and behind walls (fig. 2 and 3).

pub mod filters;
