//! What of the experiments can be chosen.

use serde::Serialize;

/// What of the experiments can be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Settings {
    /// Seed of everything random.
    pub seed: u64,
    /// Pairs of each row, of `apf-density`.
    pub pairs: u32,
    /// Scenes of each kind, of `multipath`.
    pub scenes: u32,
    /// Trials of each condition, of `stretch`: as many as its paper has (section IV).
    pub trials: u32,
    /// Scenarios, of `mmwave`: as many as the mmWave paper has.
    pub scenarios: u32,
}

impl Default for Settings {
    fn default() -> Self {
        Self { seed: 1, pairs: 100, scenes: 50, trials: 1200, scenarios: 200 }
    }
}
