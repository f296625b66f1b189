//! Writes parameters into the configuration of guidance, and reads them back.

use core::f32::consts::PI;

use super::{Id, Values};
use crate::base::ned::Horizontal;
use crate::control::guard::Fence;
use crate::doa::array;
use crate::guidance::{self, param, turning};
use crate::landing;
use crate::mapping::lidar;
use crate::planning::explore;

/// Beyond this radius the cells of a search grow.
const SEARCH_R_M: f32 = 15.0;
/// Cells from the middle of the search's grid to its edge, and a little less, for rounding.
const SEARCH_CELLS: f32 = 14.9;

/// From the configuration to parameters.
impl Values {
    /// The parameters that correspond to a configuration of guidance. A value that the table cannot express gets its
    /// default, and so do the parameters of the link.
    #[must_use]
    pub fn of(config: &guidance::Config) -> Self {
        let mut values = Self::DEFAULT;
        for id in Id::all() {
            if let Some(value) = read_one(id, config) {
                // If refused, it stays the default.
                let _ = values.set(id, value);
            }
        }
        values
    }
}

fn read_one(id: Id, config: &guidance::Config) -> Option<f32> {
    let (guard, mission, planner) = (&config.guard, &config.mission, &config.planner);
    let switch = |is_on: bool| f32::from(u8::from(is_on));
    Some(match id {
        param::FH_SPD_MAX => guard.v_max_mps,
        param::FH_SPD_EVADE => guard.evade_max_mps,
        param::FH_SPD_Z_MAX => guard.v_down_max_mps,
        param::FH_ACC_MAX => guard.a_max_mps2,
        param::FH_JERK_MAX => guard.jerk_max_mps3,
        param::FH_YAWR_MAX => guard.yaw_rate_max_radps,
        param::FH_DEAD_TIME => config.vehicle_model.dead_time_s,
        param::FH_LAG => config.vehicle_model.lag_s,
        param::FH_RADIUS => config.vehicle.radius_m,
        param::FH_MARGIN => planner.margin_m,
        param::FH_MARGIN_TGT => planner.tight_margin_m,
        param::FH_MARGIN_GRD => guard.margin_m,
        param::FH_APPR_RATE => guard.approach_rate_per_s,
        param::FH_ALT_BAND => guard.altitude_band_m,
        param::FH_FENCE_R => match guard.fence {
            Fence::Circle { radius_m, .. } => radius_m,
            _ => 0.0,
        },
        param::FH_FENCE_MRG => guard.fence_margin_m,
        param::FH_OBS_FOV => config.sensor.fov_rad * (180.0 / PI),
        param::FH_OBS_RANGE => config.sensor.range_m,
        param::FH_OBS_MIN => guard.coverage.smallest_obstacle_m,
        param::FH_OBS_SIDE => guard.out_of_view_share,
        param::FH_START_CLR => guard.coverage.start_clearance_m,
        param::FH_OBS_SRC => config.lidar.map_or(0.0, |lidar| 1.0 + switch(lidar.is_upside_down)),
        param::FH_LDR_YAW => config.lidar?.yaw_rad * (180.0 / PI),
        param::FH_TGT_DIST => config.goal.target_distance_m,
        param::FH_RPL_TIME => config.replan_after_s,
        param::FH_RPL_WPT => f32::from(config.replan_at_waypoint),
        param::FH_BENDS => switch(planner.bends),
        param::FH_REFLECT => switch(config.reflections),
        param::FH_SRCH_TIME => planner.explore.map_or(0.0, |explore| explore.limit_s),
        param::FH_SRCH_R => planner.explore?.radius_m,
        param::FH_POS_AGE => mission.position_age_max_s,
        param::FH_ATT_AGE => mission.attitude_age_max_s,
        param::FH_OBS_AGE => mission.obstacles_age_max_s,
        param::FH_OBS_REQ => switch(mission.obstacles_required),
        param::FH_BRG_AGE => mission.bearing_age_max_s,
        param::FH_NOPATH_T => mission.no_path_max_s,
        param::FH_STALL_T => mission.stall_s,
        param::FH_STALL_R => mission.stall_radius_m,
        param::FH_WAVELEN => config.array.wavelength_m,
        param::FH_ARR_SIDE => config.array.antennas_m[0][1] - config.array.antennas_m[1][1],
        param::FH_CAL_REQ => switch(config.array.require_calibration),
        param::FH_CH_SIGMA => config.bearing.channel_sigma_rad,
        param::FH_SMP_RATE => config.phase.sample_rate_hz,
        param::FH_TONE => config.phase.tone_hz.unwrap_or_default(),
        param::FH_TONE_LO => config.phase.tone_band_hz[0],
        param::FH_TONE_HI => config.phase.tone_band_hz[1],
        param::FH_TURN => match config.turning?.role {
            turning::Role::Fallback => 1.0,
            turning::Role::Alone(_) => 2.0,
        },
        param::FH_TURN_RATE => config.turning?.yaw_rate_radps,
        param::FH_TURN_CH => match config.turning?.role {
            turning::Role::Fallback => 0.0,
            turning::Role::Alone(channel) => f32::from(channel),
        },
        param::FH_LND_MODE => match config.landing {
            None => 0.0,
            Some(landing) => 1.0 + switch(landing.has_camera),
        },
        param::FH_LND_REQ => switch(config.landing?.request_land),
        param::FH_PAD_R => config.landing?.pad_radius_m,
        param::FH_CAM_FOCAL => config.landing?.focal_widths,
        _ => return None,
    })
}

/// From parameters to the configuration.
impl Values {
    /// Writes every parameter of guidance into its configuration. The antennas become the square of `FH_ARR_SIDE`;
    /// fields without a parameter are unchanged.
    pub fn apply(&self, config: &mut guidance::Config) {
        for id in Id::all() {
            self.apply_one(id, config);
        }
    }

    /// Writes one parameter into the configuration; parameters of the link have no field there.
    pub fn apply_one(&self, id: Id, config: &mut guidance::Config) {
        let value = self.get(id);
        let is_on = self.is_on(id);
        let (guard, mission, planner) = (&mut config.guard, &mut config.mission, &mut config.planner);
        match id {
            param::FH_SPD_MAX => guard.v_max_mps = value,
            param::FH_SPD_EVADE => guard.evade_max_mps = value,
            param::FH_SPD_Z_MAX => guard.v_down_max_mps = value,
            param::FH_ACC_MAX => guard.a_max_mps2 = value,
            param::FH_JERK_MAX => guard.jerk_max_mps3 = value,
            param::FH_YAWR_MAX => guard.yaw_rate_max_radps = value,
            param::FH_DEAD_TIME => config.vehicle_model.dead_time_s = value,
            param::FH_LAG => config.vehicle_model.lag_s = value,
            param::FH_RADIUS => config.vehicle.radius_m = value,
            param::FH_MARGIN => planner.margin_m = value,
            param::FH_MARGIN_TGT => planner.tight_margin_m = value,
            param::FH_MARGIN_GRD => guard.margin_m = value,
            param::FH_APPR_RATE => guard.approach_rate_per_s = value,
            param::FH_ALT_BAND => guard.altitude_band_m = value,
            param::FH_FENCE_MRG => guard.fence_margin_m = value,
            param::FH_FENCE_R => {
                let circle = Fence::Circle { center_ned_m: Horizontal::default(), radius_m: value };
                guard.fence = if is_on { circle } else { Fence::Off };
            }
            // In this order a quarter and a whole turn are exact.
            param::FH_OBS_FOV => config.sensor.fov_rad = value / 180.0 * PI,
            param::FH_OBS_RANGE => config.sensor.range_m = value,
            param::FH_OBS_MIN => guard.coverage.smallest_obstacle_m = value,
            param::FH_OBS_SIDE => guard.out_of_view_share = value,
            param::FH_START_CLR => guard.coverage.start_clearance_m = value,
            param::FH_OBS_SRC | param::FH_LDR_YAW => self.apply_lidar(config),
            param::FH_TGT_DIST => config.goal.target_distance_m = value,
            param::FH_RPL_TIME => config.replan_after_s = value,
            param::FH_RPL_WPT => config.replan_at_waypoint = self.whole(id) as u8,
            param::FH_BENDS => planner.bends = is_on,
            param::FH_REFLECT => config.reflections = is_on,
            param::FH_SRCH_TIME | param::FH_SRCH_R => self.apply_search(config),
            param::FH_POS_AGE => mission.position_age_max_s = value,
            param::FH_ATT_AGE => mission.attitude_age_max_s = value,
            param::FH_OBS_AGE => mission.obstacles_age_max_s = value,
            param::FH_OBS_REQ => mission.obstacles_required = is_on,
            param::FH_BRG_AGE => mission.bearing_age_max_s = value,
            param::FH_NOPATH_T => mission.no_path_max_s = value,
            param::FH_STALL_T => mission.stall_s = value,
            param::FH_STALL_R => mission.stall_radius_m = value,
            param::FH_WAVELEN => config.array.wavelength_m = value,
            param::FH_ARR_SIDE => config.array.antennas_m = array::Config::square(1.0, value).antennas_m,
            param::FH_CAL_REQ => config.array.require_calibration = is_on,
            param::FH_CH_SIGMA => config.bearing.channel_sigma_rad = value,
            param::FH_SMP_RATE => config.phase.sample_rate_hz = value,
            param::FH_TONE => config.phase.tone_hz = is_on.then_some(value),
            param::FH_TONE_LO => config.phase.tone_band_hz[0] = value,
            param::FH_TONE_HI => config.phase.tone_band_hz[1] = value,
            param::FH_TURN | param::FH_TURN_RATE | param::FH_TURN_CH => self.apply_turning(config),
            param::FH_LND_MODE | param::FH_LND_REQ | param::FH_PAD_R | param::FH_CAM_FOCAL => {
                self.apply_landing(config);
            }
            _ => {}
        }
    }

    fn apply_search(&self, config: &mut guidance::Config) {
        let (limit_s, radius_m) = (self.get(param::FH_SRCH_TIME), self.get(param::FH_SRCH_R));
        let cell_m = if radius_m > SEARCH_R_M { radius_m / SEARCH_CELLS } else { explore::Config::default().cell_m };
        let before = config.planner.explore.unwrap_or_default();
        let searches = self.is_on(param::FH_SRCH_TIME);
        config.planner.explore = searches.then_some(explore::Config { limit_s, radius_m, cell_m, ..before });
    }

    fn apply_lidar(&self, config: &mut guidance::Config) {
        config.lidar = self.is_on(param::FH_OBS_SRC).then_some(lidar::Mount {
            // In this order a quarter and a half turn are exact.
            yaw_rad: self.get(param::FH_LDR_YAW) / 180.0 * PI,
            is_upside_down: self.whole(param::FH_OBS_SRC) > 1,
        });
    }

    fn apply_landing(&self, config: &mut guidance::Config) {
        let mode = self.whole(param::FH_LND_MODE);
        let before = config.landing.unwrap_or_default();
        config.landing = (mode > 0).then_some(landing::Config {
            has_camera: mode > 1,
            request_land: self.is_on(param::FH_LND_REQ),
            pad_radius_m: self.get(param::FH_PAD_R),
            focal_widths: self.get(param::FH_CAM_FOCAL),
            ..before
        });
    }

    fn apply_turning(&self, config: &mut guidance::Config) {
        let role = match self.whole(param::FH_TURN) {
            0 => {
                config.turning = None;
                return;
            }
            1 => turning::Role::Fallback,
            _ => turning::Role::Alone(self.whole(param::FH_TURN_CH) as u8),
        };
        let before = config.turning.unwrap_or_default();
        config.turning = Some(turning::Config { role, yaw_rate_radps: self.get(param::FH_TURN_RATE), ..before });
    }
}
