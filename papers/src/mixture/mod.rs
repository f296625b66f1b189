//! Walls among points in any order: the mmWave paper's mixture of Gaussians.
//!
//! The mixture makes the clusters; the rest is the same as after the split and merge of a scan ([`walls`], which
//! flies): lines through the clusters, pieces, walls.
//!
//! Memory: a [`Workspace`] of 3.2 KB, fixed. The work is bounded by [`Config::work_max`].

use heapless::Vec;

use foxhound_core::base::error::{ConfigError, Why, check};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::mapping::walls::{self, POINTS_MAX, WALLS_MAX, Wall};

mod bayes;
#[cfg(test)]
mod scenes;

use bayes::{Mixture, Prior};

/// Configuration of walls, and of their points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Definition of a wall.
    pub walls: walls::Config,
    /// Concentration of the mixture's Dirichlet process: more of it, more components.
    pub concentration: f32,
    /// Expected standard deviation of a wall's points across, before any is seen.
    pub sigma_m: f32,
    /// Most work of the mixture, in pairs of a point and a component; some 45 instructions each.
    pub work_max: u32,
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Config {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self { walls: walls::Config::DEFAULT, concentration: 0.1, sigma_m: 0.1, work_max: 5_500 };

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Extractor, ConfigError> {
        let lines = self.walls.build()?;
        check("mixture.concentration", self.concentration, 1e-3, 10.0)?;
        check("mixture.sigma_m", self.sigma_m, 0.005, 1.0)?;
        check("mixture.work_max", self.work_max as f32, 2_048.0, 1e5)?;
        if self.sigma_m > walls::DEVIATION_M {
            let why = Why::Inconsistent("points would be expected farther from their wall than they may be");
            return Err(ConfigError { field: "mixture.sigma_m", value: self.sigma_m, why });
        }
        let prior = Prior {
            concentration: self.concentration,
            sigma_m: self.sigma_m,
            joined_m: walls::JOINED_M,
            gap_m: self.walls.gap_m,
            work_max: self.work_max,
        };
        Ok(Extractor { lines, prior })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extractor {
    lines: walls::Extractor,
    prior: Prior,
}

/// Memory for one call; nothing in it is kept.
#[derive(Clone, Debug)]
pub struct Workspace {
    walls: walls::Workspace,
    mixture: Mixture,
    /// The nearest seed of a point.
    owners: [u8; POINTS_MAX],
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

impl Workspace {
    /// Empty. All bits are zero, so that it takes no flash.
    #[must_use]
    pub const fn new() -> Self {
        Self { walls: walls::Workspace::new(), mixture: Mixture::new(), owners: [0; POINTS_MAX] }
    }
}

impl Extractor {
    /// The walls among points in any order, the longest first. Points that are not finite, or absurd, are ignored.
    pub fn find(&self, workspace: &mut Workspace, points_ned_m: &[Horizontal]) -> Vec<Wall, WALLS_MAX> {
        let Workspace { walls, mixture, owners } = workspace;
        self.lines.find_among(walls, points_ned_m, |points, proposals| {
            mixture.cluster(&self.prior, points, owners);
            for component in &mixture.components {
                proposals.add(&component.moments);
            }
        })
    }
}

#[cfg(test)]
mod tests;
