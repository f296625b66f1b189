//! The configuration of the whole chain, checked and built room by room.

use super::{Guidance, mission, turning};
use crate::base::error::{ConfigError, Why, check};
use crate::control::{evade, guard, track, vehicle_model, wind};
use crate::doa::{array, bearing};
use crate::landing;
use crate::localize::goal;
use crate::localize::source::bank;
use crate::mapping::{lidar, map, scan, tracks};
use crate::planning::planner;
use crate::planning::rollout::WAYPOINTS;
use crate::signal::phase;

/// Configuration of the whole chain, room by room.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Seed of everything random in the flight.
    pub seed: u64,
    /// Period of the steps.
    pub tick_s: f32,
    /// Steps from a plan's request to its taking effect.
    pub handover_ticks: u32,
    /// The next plan is asked for when this many waypoints are passed (main paper, section IV: 5).
    pub replan_at_waypoint: u8,
    /// It is asked for after this long at the latest.
    pub replan_after_s: f32,
    /// A plan that says brake is asked for again after this long.
    pub retry_s: f32,
    /// Phasor extraction.
    pub phase: phase::Config,
    /// Antenna array.
    pub array: array::Config,
    /// Angle of arrival.
    pub bearing: bearing::Config,
    /// The lidar on a line of our own, where obstacles are taken from it; else the autopilot tells of them.
    pub lidar: Option<lidar::Mount>,
    /// Circles from scans.
    pub scan: scan::Config,
    /// Obstacle memory.
    pub map: map::Config,
    /// Tracks of what moves.
    pub tracks: tracks::Config,
    /// Filters of where the source is.
    pub source: bank::Config,
    /// Whether reflections are looked for.
    pub reflections: bool,
    /// Temporary target.
    pub goal: goal::Config,
    /// Planner.
    pub planner: planner::Config,
    /// The vehicle's answer to setpoints.
    pub vehicle_model: vehicle_model::Config,
    /// What is made of gusts.
    pub wind: wind::Config,
    /// Waypoint tracker.
    pub track: track::Config,
    /// What gets out of the way of what moves.
    pub evade: evade::Config,
    /// Safety filter.
    pub guard: guard::Config,
    /// State machine.
    pub mission: mission::Config,
    /// Seeking by turning, where there is no array or too little of it is left; none where its elements hear the same all
    /// round.
    pub turning: Option<turning::Config>,
    /// What it does where it arrives; without it the beacon is sought for ever.
    pub landing: Option<landing::Config>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            tick_s: 0.02,
            handover_ticks: 5,
            replan_at_waypoint: 5,
            replan_after_s: 0.7,
            retry_s: 0.5,
            phase: phase::Config::default(),
            array: array::Config::default(),
            bearing: bearing::Config::default(),
            lidar: None,
            scan: scan::Config::default(),
            map: map::Config::default(),
            tracks: tracks::Config::default(),
            source: bank::Config::DEFAULT,
            reflections: true,
            goal: goal::Config::default(),
            planner: planner::Config::default(),
            vehicle_model: vehicle_model::Config::default(),
            wind: wind::Config::default(),
            track: track::Config::default(),
            evade: evade::Config::default(),
            guard: guard::Config::default(),
            mission: mission::Config::default(),
            turning: None,
            landing: None,
        }
    }
}

impl Config {
    /// Sets the vehicle's radius wherever it counts.
    pub fn set_vehicle_radius_m(&mut self, radius_m: f32) {
        if let Some(explore) = &mut self.planner.explore {
            explore.clearance_m = radius_m + self.planner.margin_m;
        }
        self.planner.vehicle_radius_m = radius_m;
        self.guard.vehicle_radius_m = radius_m;
    }

    /// Checks every room's part.
    ///
    /// # Errors
    /// The first field that is refused.
    pub fn build<const N: usize>(&self) -> Result<Guidance<N>, ConfigError> {
        check("tick_s", self.tick_s, 0.005, 0.1)?;
        check("handover_ticks", self.handover_ticks as f32, 2.0, 100.0)?;
        check("replan_at_waypoint", f32::from(self.replan_at_waypoint), 1.0, WAYPOINTS as f32)?;
        check("replan_after_s", self.replan_after_s, 0.1, 60.0)?;
        check("retry_s", self.retry_s, 0.05, 10.0)?;
        if self.planner.vehicle_radius_m < self.guard.vehicle_radius_m {
            let why = Why::Inconsistent("the planner may not think the vehicle smaller than the guard does");
            return Err(ConfigError { field: "planner.vehicle_radius_m", value: self.planner.vehicle_radius_m, why });
        }
        if let Some(lidar) = &self.lidar {
            lidar.check()?;
        }
        self.planner.build()?;
        let vehicle_model = self.vehicle_model.build(self.tick_s)?;
        Ok(Guidance {
            seed: self.seed,
            tick_s: self.tick_s,
            handover_ticks: self.handover_ticks,
            replan_at_waypoint: usize::from(self.replan_at_waypoint),
            replan_ticks: libm::ceilf(self.replan_after_s / self.tick_s) as u32,
            retry_ticks: libm::ceilf(self.retry_s / self.tick_s) as u32,
            plan_margin_m: 0.5 * self.planner.margin_m,
            target_distance_m: self.goal.target_distance_m,
            known_source_ned_m: self.goal.known_source_ned_m,
            reflected_min: self.source.reflected_min,
            slack_m: self.source.slack_m,
            range_sigma_max: self.source.range_sigma_max,
            phase: self.phase.build()?,
            bearing: self.bearing.build(self.array.build()?)?,
            scan: self.scan.build()?,
            map: self.map.build()?,
            tracks: self.tracks.build()?,
            source: self.source.build()?,
            reflections: self.reflections,
            searches: self.planner.explore.is_some(),
            goal: self.goal.build()?,
            vehicle_model,
            wind: self.wind.build(&vehicle_model, self.tick_s)?,
            track: self.track.build()?,
            evade: self.evade.build(
                &vehicle_model,
                self.guard.v_max_mps,
                self.guard.evade_max_mps,
                self.guard.a_max_mps2,
            )?,
            guard: self.guard.build()?,
            mission: self.mission.build()?,
            turning: match &self.turning {
                Some(turning) => Some(turning.build(&self.mission, self.guard.yaw_rate_max_radps)?),
                None => None,
            },
            lander: match &self.landing {
                Some(landing) => Some(landing.build()?),
                None => None,
            },
        })
    }
}
