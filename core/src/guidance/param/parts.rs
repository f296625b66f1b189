//! Parameters that are not one field of the configuration each: how they are written into it, and how those are read that take
//! more than an expression in the table.

use core::f32::consts::PI;

use super::Values;
use crate::doa::{array, radio};
use crate::guidance::{Config, param, turning};
use crate::landing;
use crate::mapping::lidar;
use crate::planning::explore;

/// Beyond this radius the cells of a search grow.
const SEARCH_R_M: f32 = 15.0;
/// Cells from the middle of the search's grid to its edge, and a little less, for rounding.
const SEARCH_CELLS: f32 = 14.9;

pub(super) fn set_obs_fov(values: &Values, config: &mut Config) {
    // In this order a quarter and a whole turn are exact.
    config.sensor.fov_rad = values.get(param::FH_OBS_FOV) / 180.0 * PI;
}

pub(super) fn obs_src(config: &Config) -> Option<f32> {
    Some(config.lidar.map_or(0.0, |lidar| 1.0 + f32::from(lidar.is_upside_down)))
}

pub(super) fn set_lidar(values: &Values, config: &mut Config) {
    config.lidar = values.is_on(param::FH_OBS_SRC).then_some(lidar::Mount {
        // In this order a quarter and a half turn are exact.
        yaw_rad: values.get(param::FH_LDR_YAW) / 180.0 * PI,
        is_upside_down: values.whole(param::FH_OBS_SRC) > 1,
    });
}

pub(super) fn brg_src(config: &Config) -> Option<f32> {
    Some(match config.radio.map(|radio| radio.sends) {
        None => 0.0,
        Some(radio::Sends::Angles) => 1.0,
        Some(radio::Sends::IqReports) => 2.0,
    })
}

pub(super) fn set_radio(values: &Values, config: &mut Config) {
    config.radio = values.is_on(param::FH_BRG_SRC).then_some(radio::Mount {
        sends: if values.whole(param::FH_BRG_SRC) > 1 { radio::Sends::IqReports } else { radio::Sends::Angles },
        yaw_rad: values.get(param::FH_BRG_YAW) / 180.0 * PI,
        sigma_rad: values.get(param::FH_BRG_SIGMA) / 180.0 * PI,
        tag: values.whole(param::FH_BRG_TAG),
    });
}

pub(super) fn set_rpl_wpt(values: &Values, config: &mut Config) {
    config.replan_at_waypoint = values.whole(param::FH_RPL_WPT) as u8;
}

pub(super) fn srch_time(config: &Config) -> Option<f32> {
    Some(config.planner.explore.map_or(0.0, |explore| explore.limit_s))
}

pub(super) fn set_search(values: &Values, config: &mut Config) {
    let (limit_s, radius_m) = (values.get(param::FH_SRCH_TIME), values.get(param::FH_SRCH_R));
    let cell_m = if radius_m > SEARCH_R_M { radius_m / SEARCH_CELLS } else { explore::Config::default().cell_m };
    let before = config.planner.explore.unwrap_or_default();
    let searches = values.is_on(param::FH_SRCH_TIME);
    config.planner.explore = searches.then_some(explore::Config { limit_s, radius_m, cell_m, ..before });
}

pub(super) fn arr_side(config: &Config) -> Option<f32> {
    Some(config.array.antennas_m[0][1] - config.array.antennas_m[1][1])
}

pub(super) fn set_arr_side(values: &Values, config: &mut Config) {
    config.array.antennas_m = array::Config::square(1.0, values.get(param::FH_ARR_SIDE)).antennas_m;
}

pub(super) fn set_tone(values: &Values, config: &mut Config) {
    config.phase.tone_hz = values.is_on(param::FH_TONE).then_some(values.get(param::FH_TONE));
}

pub(super) fn turn(config: &Config) -> Option<f32> {
    match config.turning?.role {
        turning::Role::Fallback => Some(1.0),
        turning::Role::Alone(_) => Some(2.0),
    }
}

pub(super) fn turn_ch(config: &Config) -> Option<f32> {
    match config.turning?.role {
        turning::Role::Fallback => Some(0.0),
        turning::Role::Alone(channel) => Some(f32::from(channel)),
    }
}

pub(super) fn set_turning(values: &Values, config: &mut Config) {
    let role = match values.whole(param::FH_TURN) {
        0 => {
            config.turning = None;
            return;
        }
        1 => turning::Role::Fallback,
        _ => turning::Role::Alone(values.whole(param::FH_TURN_CH) as u8),
    };
    let before = config.turning.unwrap_or_default();
    config.turning = Some(turning::Config { role, yaw_rate_radps: values.get(param::FH_TURN_RATE), ..before });
}

pub(super) fn lnd_mode(config: &Config) -> Option<f32> {
    Some(config.landing.map_or(0.0, |landing| 1.0 + f32::from(landing.has_camera)))
}

pub(super) fn set_landing(values: &Values, config: &mut Config) {
    let mode = values.whole(param::FH_LND_MODE);
    let before = config.landing.unwrap_or_default();
    config.landing = (mode > 0).then_some(landing::Config {
        has_camera: mode > 1,
        request_land: values.is_on(param::FH_LND_REQ),
        pad_radius_m: values.get(param::FH_PAD_R),
        focal_widths: values.get(param::FH_CAM_FOCAL),
        ..before
    });
}
