//! The configuration of the whole chain, checked and built module by module.

use core::f32::consts::PI;

use super::{Guidance, mission, turning};
use crate::base::config::{RangeSensor, Vehicle};
use crate::base::error::{ConfigError, Why, check};
use crate::base::ned::Horizontal;
use crate::base::units::between;
use crate::control::track::FASTEST_MPS;
use crate::control::{evade, guard, vehicle_model, wind};
use crate::doa::{array, bearing, radio};
use crate::landing;
use crate::localize::belief::Localizer;
use crate::localize::source::bank;
use crate::mapping::lidar;
use crate::planning::planner::{self, Planner};
use crate::planning::rollout::WAYPOINTS;
use crate::signal::phase;

/// After a brake plan the next one is requested after this long.
const RETRY_S: f32 = 0.5;
/// What comes into the sensor's range is known by a tenth of a second later; at 1 m/s, and a little more.
const UNSEEN_M: f32 = 0.12;
/// The pose of the middle of a scan is known for so long.
const OLDEST_S: f32 = 0.25;

/// Configuration of the whole chain, module by module.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Seed of all random numbers of the flight.
    pub seed: u64,
    /// The vehicle.
    pub vehicle: Vehicle,
    /// The obstacle sensor.
    pub sensor: RangeSensor,
    /// Period of the steps.
    pub tick_s: f32,
    /// The next plan is requested when this many waypoints are passed (main paper, section IV: 5).
    pub replan_at_waypoint: u8,
    /// It is requested after this long at the latest.
    pub replan_after_s: f32,
    /// Phasor extraction.
    pub phase: phase::Config,
    /// Antenna array.
    pub array: array::Config,
    /// Angle of arrival.
    pub bearing: bearing::Config,
    /// The radio on a serial line of our own, if bearings come from it; otherwise from the antennas.
    pub radio: Option<radio::Mount>,
    /// The lidar on the same line, if obstacles come from it; otherwise the autopilot reports them.
    pub lidar: Option<lidar::Mount>,
    /// Filters that estimate the source's position.
    pub source: bank::Config,
    /// Whether reflections are considered.
    pub reflections: bool,
    /// Position of the source, if it is known beforehand. Bearings are still needed: they show that it is received.
    pub known_source_ned_m: Option<Horizontal>,
    /// Planner.
    pub planner: planner::Config,
    /// Model of how the vehicle follows setpoints.
    pub vehicle_model: vehicle_model::Config,
    /// Estimate of gusts.
    pub wind: wind::Config,
    /// Safety filter.
    pub guard: guard::Config,
    /// State machine.
    pub mission: mission::Config,
    /// Seeking by turning, for a vehicle without an array or with too few working channels; `None` if its antennas
    /// receive equally from all directions.
    pub turning: Option<turning::Config>,
    /// Behaviour on arrival; without it the vehicle goes on seeking the beacon.
    pub landing: Option<landing::Config>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 0,
            vehicle: Vehicle::DEFAULT,
            sensor: RangeSensor::DEFAULT,
            tick_s: 0.02,
            replan_at_waypoint: 5,
            replan_after_s: 0.7,
            phase: phase::Config::default(),
            array: array::Config::default(),
            bearing: bearing::Config::default(),
            radio: None,
            lidar: None,
            source: bank::Config::DEFAULT,
            reflections: true,
            known_source_ned_m: None,
            planner: planner::Config::default(),
            vehicle_model: vehicle_model::Config::default(),
            wind: wind::Config::default(),
            guard: guard::Config::default(),
            mission: mission::Config::default(),
            turning: None,
            landing: None,
        }
    }
}

impl Config {
    /// The planner of this configuration.
    ///
    /// # Errors
    /// The field that is refused.
    pub fn build_planner(&self) -> Result<Planner, ConfigError> {
        self.planner.build(&self.vehicle, &self.sensor, &self.guard.fence, self.guard.margin_m)
    }

    /// Checks the configuration of every module.
    ///
    /// # Errors
    /// The first field that is refused.
    pub fn build<const N: usize>(&self) -> Result<Guidance<N>, ConfigError> {
        check("tick_s", self.tick_s, 0.005, 0.1)?;
        check("replan_at_waypoint", f32::from(self.replan_at_waypoint), 1.0, WAYPOINTS as f32)?;
        check("replan_after_s", self.replan_after_s, 0.3, 60.0)?;
        if let Some(place) = self.known_source_ned_m {
            for metres in [place.north, place.east] {
                check("known_source_ned_m", metres, -1e5, 1e5)?;
            }
        }
        if let Some(lidar) = &self.lidar {
            lidar.check()?;
        }
        if let Some(radio) = &self.radio {
            radio.check()?;
            if self.lidar.is_some() || self.turning.is_some() {
                // They share a line with the one, and need waveforms for the other.
                let why = Why::Inconsistent("not with a lidar or turning");
                return Err(ConfigError { field: "radio", value: 1.0, why });
            }
        }
        self.build_planner()?;
        let vehicle_model = self.vehicle_model.build(self.tick_s)?;
        let guard = self.guard.build(&self.vehicle, &self.sensor)?;
        self.sensor.check_beyond(self.vehicle.radius_m)?;
        self.sensor.check_beside(self.vehicle.radius_m, self.guard.coverage.smallest_obstacle_m)?;
        // No faster than it follows a path.
        let v_mps = if self.guard.v_max_mps < FASTEST_MPS { self.guard.v_max_mps } else { FASTEST_MPS };
        let hull_m = self.vehicle.radius_m + self.guard.margin_m + UNSEEN_M;
        let old_s = self.sensor.lag_s + 0.5 * self.sensor.turn_s.abs();
        if old_s > OLDEST_S || old_s + 0.1 > self.mission.obstacles_age_max_s {
            let why = Why::Inconsistent("with the time of a turn, older than what is used");
            return Err(ConfigError { field: "sensor.lag_s", value: self.sensor.lag_s, why });
        }
        let late_s = vehicle_model.delay_s() + old_s;
        let stops_m = hull_m + v_mps * late_s + v_mps * v_mps / (1.4 * self.guard.a_max_mps2);
        if self.mission.obstacles_required && stops_m > self.sensor.range_m {
            let why = Why::Inconsistent("too fast to stop within the sensor's range");
            return Err(ConfigError { field: "guard.v_max_mps", value: self.guard.v_max_mps, why });
        }
        // From rest, and with its back to the goal.
        let turns_s = (PI - 0.5 * self.sensor.fov_rad) / self.guard.yaw_rate_max_radps;
        let moves_s = (self.mission.stall_s - turns_s - vehicle_model.delay_s()).max(0.0);
        let speeds_up_s = between(v_mps / self.guard.a_max_mps2, 0.0, moves_s);
        let moves_m = 0.5 * self.guard.a_max_mps2 * speeds_up_s * speeds_up_s + v_mps * (moves_s - speeds_up_s);
        if moves_m < 1.8 * self.mission.stall_radius_m {
            let why = Why::Inconsistent("too slow to leave the stall radius in the stall time");
            return Err(ConfigError { field: "guard.v_max_mps", value: self.guard.v_max_mps, why });
        }
        let stop_m = guard.stop_m(vehicle_model.delay_s());
        Ok(Guidance {
            seed: self.seed,
            tick_s: self.tick_s,
            replan_at_waypoint: usize::from(self.replan_at_waypoint),
            replan_ticks: libm::ceilf(self.replan_after_s / self.tick_s) as u32,
            retry_ticks: libm::ceilf(RETRY_S / self.tick_s) as u32,
            plan_margin_m: 0.5 * self.planner.margin_m,
            stop_m,
            turn_s: self.sensor.turn_s,
            lag_us: (1e6 * self.sensor.lag_s) as u32,
            known_source_ned_m: self.known_source_ned_m,
            phase: self.phase.build()?,
            bearing: self.bearing.build(self.array.build()?)?,
            localizer: Localizer::build(&self.source, self.landing.is_some(), self.reflections)?,
            searches: self.planner.explore.is_some(),
            vehicle_model,
            wind: self.wind.build(&vehicle_model, self.tick_s)?,
            evade: evade::Evader::new(
                &vehicle_model,
                self.guard.v_max_mps,
                self.guard.evade_max_mps,
                self.guard.a_max_mps2,
            ),
            guard,
            mission: self.mission.build()?,
            turning: match &self.turning {
                Some(turning) => Some(turning.build(&self.mission, self.guard.yaw_rate_max_radps)?),
                None => None,
            },
            lander: match &self.landing {
                Some(landing) => Some(landing.build(self.guard.altitude_band_m)?),
                None => None,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::explore;

    /// A change of a fact, and the stages that it reaches.
    type Fact = (fn(&mut Config), &'static [&'static str]);

    /// Each fact that several stages share is changed in its one place, and reaches all of them.
    #[test]
    fn a_shared_fact_reaches_every_stage_that_uses_it() {
        let stages = |config: &Config| {
            let guidance = config.build::<64>().unwrap();
            let planner = std::format!("{:?}", config.build_planner().unwrap());
            let (planner, search) = planner.split_once("explorer:").unwrap();
            [
                ("guard", std::format!("{:?}", guidance.guard)),
                ("planner", planner.into()),
                ("search", search.into()),
                ("near", std::format!("{:?}", guidance.plan_margin_m)),
                ("scan", std::format!("{:?} {:?}", guidance.turn_s, guidance.lag_us)),
                ("evader", std::format!("{:?}", guidance.evade)),
                ("wind", std::format!("{:?}", guidance.wind)),
                ("vehicle model", std::format!("{:?}", guidance.vehicle_model)),
                ("turning", std::format!("{:?}", guidance.turning)),
            ]
        };
        let usual = Config {
            planner: planner::Config { explore: Some(explore::Config::default()), ..planner::Config::default() },
            turning: Some(turning::Config::default()),
            ..Config::default()
        };
        let facts: [Fact; 11] = [
            (|c| c.vehicle.radius_m = 0.2, &["guard", "planner", "search"]),
            (|c| c.sensor.range_m = 4.0, &["guard", "planner"]),
            (|c| c.sensor.fov_rad = 3.0, &["guard", "planner"]),
            (|c| c.sensor.turn_s = 0.1, &["guard", "planner", "scan"]),
            (|c| c.sensor.lag_s = 0.1, &["guard", "planner", "scan"]),
            (|c| c.planner.margin_m = 0.1, &["planner", "search", "near"]),
            (|c| c.guard.margin_m = 0.1, &["guard", "planner"]),
            (|c| c.guard.v_max_mps = 2.0, &["guard", "evader"]),
            (|c| c.guard.a_max_mps2 = 3.0, &["guard", "evader"]),
            (|c| c.vehicle_model.lag_s = 0.7, &["evader", "wind", "vehicle model"]),
            (|c| c.mission.stall_s = 50.0, &["turning"]),
        ];
        let before = stages(&usual);
        for (change, users) in facts {
            let mut config = usual;
            change(&mut config);
            let changed = before.iter().zip(stages(&config)).filter(|(old, new)| *old != new);
            let changed: std::vec::Vec<&str> = changed.map(|(old, _)| old.0).collect();
            assert_eq!(changed, users);
        }
    }
}
