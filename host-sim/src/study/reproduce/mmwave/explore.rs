//! Exploration, the same for all agents: the core's, with the points of the map as its circles.
//!
//! The core's grid reaches 15 m around where a search began; what lies beyond is searched from where the robot is when all
//! of that has been looked at.

use foxhound_core::ConfigError;
use foxhound_core::base::config::{Fence, RangeSensor};
use foxhound_core::base::obstacle::Disc;
use foxhound_core::base::pose::Pose;
use foxhound_core::base::time::Instant;
use foxhound_core::planning::explore::{self, Explored};

use super::known::{Known, RANGE_M};
use crate::world::{Horizontal, from_core};

/// A point of a wall as a circle.
const POINT_RADIUS_M: f32 = 0.1;
/// Distance that it keeps from them.
const CLEARANCE_M: f32 = 0.2;
/// A control cycle.
const CYCLE_US: u64 = 1_000_000;

/// Where it is headed.
pub(super) struct Explorer {
    explorer: explore::Explorer,
    state: explore::State,
}

impl Explorer {
    /// With a seed of its own.
    ///
    /// # Errors
    /// None that the built-in configuration could cause.
    pub(super) fn new(seed: u64) -> Result<Self, ConfigError> {
        let config = explore::Config { limit_s: 3600.0, seed: seed as u32, ..explore::Config::default() };
        Ok(Self { explorer: config.build(CLEARANCE_M, &Fence::DEFAULT)?, state: explore::State::new() })
    }

    /// There is no path to the target.
    pub(super) fn blocked(&mut self) {
        self.state.blocked();
    }

    /// Where to go next; `None` when nothing is left to explore.
    pub(super) fn target(&mut self, known: &Known, place: Horizontal, cycle: u32) -> Option<Horizontal> {
        let circle =
            |point: &Horizontal| Disc { center_ned_m: point.to_core(), radius_m: POINT_RADIUS_M, ..Disc::default() };
        let circles: Vec<Disc> = known.points().iter().map(circle).collect();
        let pose = Pose { position_ned_m: place.to_core(), yaw_rad: 0.0 };
        let now = Instant(u64::from(cycle) * CYCLE_US);
        let sensor = RangeSensor { range_m: RANGE_M as f32, fov_rad: std::f32::consts::TAU, ..RangeSensor::DEFAULT };
        for _ in 0..2 {
            let explored = self.explorer.step(&mut self.state, now, &pose, &sensor, circles.iter());
            match explored {
                Explored::Target(target) => return Some(from_core(target)),
                _ => self.state.end(),
            }
        }
        None
    }
}
