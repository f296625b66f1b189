//! Random pillars: how many, and the space that they leave free.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pillars at random places on the map; each seed of the flight gives another world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(deny_unknown_fields)]
#[serde(default)]
pub struct RandomPillars {
    /// Number of pillars.
    #[schemars(range(min = 0, max = 1000))]
    pub count: u32,
    /// Least and greatest radius, m.
    #[schemars(inner(range(min = 0.02, max = 10.0)))]
    pub radius: [f64; 2],
    /// Least free space between any two, m.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub gap: f64,
    /// Least free space around start and goal, m.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub clear: f64,
}

impl Default for RandomPillars {
    fn default() -> Self {
        Self { count: 20, radius: [0.15, 0.35], gap: 0.6, clear: 0.8 }
    }
}
