use std::vec::Vec;

use super::*;
use crate::base::error::Why;
use crate::doa::radio::Sends;
use crate::guidance::{self, turning};

fn named(name: &str) -> Id {
    Id::named(name.as_bytes()).unwrap()
}

type Place = fn(&guidance::Config) -> f32;

/// The field of each parameter of guidance, written a second time; in degrees where the table is.
const PLACES: &[(&str, Place)] = &[
    ("FH_SPD_MAX", |c| c.guard.v_max_mps),
    ("FH_SPD_EVADE", |c| c.guard.evade_max_mps),
    ("FH_SPD_Z_MAX", |c| c.guard.v_down_max_mps),
    ("FH_ACC_MAX", |c| c.guard.a_max_mps2),
    ("FH_JERK_MAX", |c| c.guard.jerk_max_mps3),
    ("FH_YAWR_MAX", |c| c.guard.yaw_rate_max_radps),
    ("FH_DEAD_TIME", |c| c.vehicle_model.dead_time_s),
    ("FH_LAG", |c| c.vehicle_model.lag_s),
    ("FH_RADIUS", |c| c.vehicle.radius_m),
    ("FH_MARGIN", |c| c.planner.margin_m),
    ("FH_MARGIN_TGT", |c| c.planner.tight_margin_m),
    ("FH_MARGIN_GRD", |c| c.guard.margin_m),
    ("FH_APPR_RATE", |c| c.guard.approach_rate_per_s),
    ("FH_ALT_BAND", |c| c.guard.altitude_band_m),
    ("FH_FENCE_MRG", |c| c.guard.fence.margin_m),
    ("FH_FENCE_R", |c| c.guard.fence.radius_m),
    ("FH_OBS_FOV", |c| c.sensor.fov_rad.to_degrees()),
    ("FH_OBS_RANGE", |c| c.sensor.range_m),
    ("FH_OBS_TURN", |c| c.sensor.turn_s),
    ("FH_OBS_LAG", |c| c.sensor.lag_s),
    ("FH_OBS_MIN", |c| c.guard.coverage.smallest_obstacle_m),
    ("FH_OBS_SIDE", |c| c.guard.out_of_view_share),
    ("FH_START_CLR", |c| c.guard.coverage.start_clearance_m),
    ("FH_OBS_SRC", |c| c.lidar.map_or(0.0, |lidar| 1.0 + f32::from(lidar.is_upside_down))),
    ("FH_LDR_YAW", |c| c.lidar.unwrap_or_default().yaw_rad.to_degrees()),
    ("FH_BRG_SRC", |c| c.radio.map_or(0.0, |radio| if radio.sends == Sends::Angles { 1.0 } else { 2.0 })),
    ("FH_BRG_TAG", |c| c.radio.unwrap_or_default().tag as f32),
    ("FH_BRG_YAW", |c| c.radio.unwrap_or_default().yaw_rad.to_degrees()),
    ("FH_BRG_SIGMA", |c| c.radio.unwrap_or_default().sigma_rad.to_degrees()),
    ("FH_RPL_TIME", |c| c.replan_after_s),
    ("FH_RPL_WPT", |c| f32::from(c.replan_at_waypoint)),
    ("FH_BENDS", |c| f32::from(c.planner.bends)),
    ("FH_REFLECT", |c| f32::from(c.reflections)),
    ("FH_SRCH_TIME", |c| c.planner.explore.map_or(0.0, |explore| explore.limit_s)),
    ("FH_SRCH_R", |c| c.planner.explore.unwrap_or_default().radius_m),
    ("FH_POS_AGE", |c| c.mission.position_age_max_s),
    ("FH_ATT_AGE", |c| c.mission.attitude_age_max_s),
    ("FH_OBS_AGE", |c| c.mission.obstacles_age_max_s),
    ("FH_OBS_REQ", |c| f32::from(c.mission.obstacles_required)),
    ("FH_BRG_AGE", |c| c.mission.bearing_age_max_s),
    ("FH_NOPATH_T", |c| c.mission.no_path_max_s),
    ("FH_STALL_T", |c| c.mission.stall_s),
    ("FH_STALL_R", |c| c.mission.stall_radius_m),
    ("FH_WAVELEN", |c| c.array.wavelength_m),
    ("FH_ARR_SIDE", |c| c.array.antennas_m[0][1] - c.array.antennas_m[1][1]),
    ("FH_ARR_SIDE", |c| c.array.antennas_m[0][0] - c.array.antennas_m[3][0]),
    ("FH_CAL_REQ", |c| f32::from(c.array.require_calibration)),
    ("FH_CH_SIGMA", |c| c.bearing.channel_sigma_rad),
    ("FH_SMP_RATE", |c| c.phase.sample_rate_hz),
    ("FH_TONE", |c| c.phase.tone_hz.unwrap_or(0.0)),
    ("FH_TONE_LO", |c| c.phase.tone_band_hz[0]),
    ("FH_TONE_HI", |c| c.phase.tone_band_hz[1]),
    ("FH_TURN", |c| match c.turning.map(|turning| turning.role) {
        None => 0.0,
        Some(turning::Role::Fallback) => 1.0,
        Some(turning::Role::Alone(_)) => 2.0,
    }),
    ("FH_TURN_RATE", |c| c.turning.unwrap_or_default().yaw_rate_radps),
    ("FH_TURN_CH", |c| match c.turning.map(|turning| turning.role) {
        Some(turning::Role::Alone(channel)) => f32::from(channel),
        _ => 0.0,
    }),
    ("FH_LND_MODE", |c| c.landing.map_or(0.0, |landing| 1.0 + f32::from(landing.has_camera))),
    ("FH_LND_REQ", |c| f32::from(c.landing.unwrap_or_default().request_land)),
    ("FH_PAD_R", |c| c.landing.unwrap_or_default().pad_radius_m),
    ("FH_CAM_FOCAL", |c| c.landing.unwrap_or_default().focal_widths),
];

fn places() -> impl Iterator<Item = (Id, Place)> {
    PLACES.iter().map(|(name, place)| (named(name), *place))
}

fn applied(values: &Values) -> guidance::Config {
    let mut config = guidance::Config::default();
    values.apply(&mut config);
    config
}

/// Other parameters that must change along with a parameter for it to take effect, or to use its whole range.
fn company(id: Id, value: f32) -> Vec<(Id, f32)> {
    let others: &[(&str, f32)] = match id.name() {
        "FH_MARGIN" => &[("FH_MARGIN_TGT", 0.0)],
        "FH_MARGIN_TGT" => &[("FH_MARGIN", value)],
        "FH_SPD_MAX" => &[("FH_STALL_T", 100.0), ("FH_OBS_RANGE", 10.0)],
        "FH_ACC_MAX" | "FH_MARGIN_GRD" => &[("FH_OBS_RANGE", 10.0)],
        "FH_YAWR_MAX" => &[("FH_STALL_T", 100.0)],
        "FH_RADIUS" => &[("FH_OBS_RANGE", 7.0), ("FH_OBS_FOV", 360.0)],
        "FH_OBS_RANGE" if value > 1.2 => &[],
        "FH_OBS_RANGE" => &[("FH_RADIUS", 0.0), ("FH_SPD_MAX", 0.1), ("FH_STALL_T", 100.0)],
        "FH_STALL_T" => &[("FH_STALL_R", 0.1), ("FH_OBS_FOV", 360.0)],
        "FH_STALL_R" => &[("FH_STALL_T", 600.0)],
        "FH_SRCH_R" => &[("FH_SRCH_TIME", 60.0)],
        "FH_WAVELEN" => &[("FH_ARR_SIDE", 0.4 * value)],
        "FH_ARR_SIDE" => &[("FH_WAVELEN", if value > 1.0 { 10.0 } else { 2.5 * value })],
        "FH_SMP_RATE" => &[("FH_TONE_LO", 0.0), ("FH_TONE_HI", 0.5 * value)],
        "FH_TONE" => &[("FH_SMP_RATE", 1e7), ("FH_TONE_HI", 5e6)],
        "FH_TONE_LO" => &[("FH_SMP_RATE", 1e7), ("FH_TONE_HI", 5e6)],
        "FH_TONE_HI" => &[("FH_SMP_RATE", if value > 1e3 { 1e7 } else { 1e3 }), ("FH_TONE_LO", 0.0)],
        "FH_TURN_RATE" => &[("FH_TURN", 1.0), ("FH_YAWR_MAX", 6.3)],
        "FH_TURN_CH" => &[("FH_TURN", 2.0)],
        "FH_LDR_YAW" => &[("FH_OBS_SRC", 1.0)],
        "FH_BRG_TAG" | "FH_BRG_YAW" | "FH_BRG_SIGMA" => &[("FH_BRG_SRC", 1.0)],
        "FH_LND_REQ" => &[("FH_LND_MODE", 2.0)],
        "FH_PAD_R" => &[("FH_LND_MODE", 2.0), ("FH_CAM_FOCAL", 0.2)],
        "FH_CAM_FOCAL" => &[("FH_LND_MODE", 2.0), ("FH_PAD_R", 0.1)],
        _ => &[],
    };
    others.iter().map(|(other, value)| (named(other), *value)).collect()
}

/// The configuration with that value, in its range or not.
fn forced(id: Id, value: f32) -> guidance::Config {
    let mut values = Values::DEFAULT;
    for (other, value) in company(id, value) {
        values.0[other.index()] = value;
    }
    values.0[id.index()] = value;
    applied(&values)
}

#[test]
fn the_defaults_of_the_table_are_those_of_guidance() {
    let default = guidance::Config::default();
    for (id, place) in places().filter(|(id, _)| !["FH_OBS_FOV", "FH_ARR_SIDE", "FH_BRG_SIGMA"].contains(&id.name())) {
        assert_eq!(id.default().to_bits(), place(&default).to_bits(), "{}", id.name());
    }
    // The values of the whole configuration, bit for bit, also where the table is in degrees.
    assert_eq!(applied(&Values::DEFAULT), default);
}

#[test]
fn every_parameter_before_those_of_the_link_arrives_where_it_belongs_and_nowhere_else() {
    for id in Id::all() {
        let arrivals: Vec<_> = places().filter(|(place, _)| *place == id).collect();
        assert_eq!(arrivals.is_empty(), id >= named("FH_SP_AGE"), "{}", id.name());
        let (min, max) = id.range();
        let value = if TABLE[id.index()].kind == Kind::Whole {
            if id.default() == max { min } else { max }
        } else {
            // No two parameters get the same one.
            min + (max - min) * (0.3 + 0.001 * id.index() as f32)
        };
        let config = forced(id, value);
        for (_, place) in &arrivals {
            let arrived = place(&config);
            assert!((arrived - value).abs() <= 1e-5 * value.abs(), "{}: {value} became {arrived}", id.name());
        }
        let alone = company(id, value);
        for (other, place) in places().filter(|(other, _)| *other != id && alone.iter().all(|(c, _)| c != other)) {
            assert_eq!(place(&config), place(&guidance::Config::default()), "{} moves {}", id.name(), other.name());
        }
    }
}

#[test]
fn what_was_applied_is_read_back_and_what_no_parameter_can_say_is_the_default() {
    let mut values = Values::DEFAULT;
    assert_eq!(Values::of(&guidance::Config::default()), values);
    for id in Id::all().filter(|id| *id < named("FH_SP_AGE")) {
        let (min, max) = id.range();
        let value = if TABLE[id.index()].kind == Kind::Whole { max } else { min + (max - min) * 0.25 };
        values.set(id, value).unwrap();
    }
    let read = Values::of(&applied(&values));
    for id in Id::all() {
        let (was, is) = (values.get(id), read.get(id));
        assert!((was - is).abs() <= 1e-5 * was.abs(), "{}: {was} became {is}", id.name());
    }
    let mut odd = guidance::Config::default();
    odd.guard.v_max_mps = f32::NAN;
    assert_eq!(Values::of(&odd), Values::DEFAULT);
}

#[test]
fn both_ends_of_every_range_build() {
    for id in Id::all() {
        let (min, max) = id.range();
        for value in [min, max] {
            let built = forced(id, value).build::<256>();
            assert!(built.is_ok(), "{} = {value}: {}", id.name(), built.err().unwrap());
        }
    }
}

#[test]
fn nothing_beyond_a_range_would_build() {
    // Switches and choices have no wider range. The others end before guidance does: where antennas can be built,
    // where a search's grid is fine enough, and where the widest band that fits into the highest rate ends.
    let narrower = [
        (named("FH_ARR_SIDE"), 0),
        (named("FH_ARR_SIDE"), 1),
        (named("FH_SRCH_R"), 1),
        (named("FH_TONE"), 1),
        (named("FH_TONE_LO"), 1),
        (named("FH_TONE_HI"), 0),
        (named("FH_FENCE_R"), 1),
    ];
    for (id, _) in places() {
        let (min, max) = id.range();
        let kind = TABLE[id.index()].kind;
        if kind == Kind::Whole
            && (max == 1.0 || ["FH_TURN", "FH_LND_MODE", "FH_OBS_SRC", "FH_BRG_SRC"].contains(&id.name()))
        {
            continue;
        }
        let step = |end: f32| if kind == Kind::Whole { 1.0 } else { (0.003 * end.abs()).max(1e-4) };
        for (side, value) in [min - step(min), max + step(max)].into_iter().enumerate() {
            if narrower.contains(&(id, side)) || (kind == Kind::Whole && value < 0.0) {
                continue;
            }
            let built = forced(id, value).build::<256>();
            let refused = built.err().map(|error| error.why);
            assert!(matches!(refused, Some(Why::OutOfRange { .. } | Why::Inconsistent(_))), "{} = {value}", id.name());
        }
    }
}

#[test]
fn values_that_do_not_fit_together_are_seen_by_the_build_and_named() {
    for (id, value, field) in [
        (named("FH_ARR_SIDE"), 0.2, "side_m"),
        (named("FH_WAVELEN"), 0.125, "side_m"),
        (named("FH_MARGIN_TGT"), 0.06, "planner.tight_margin_m"),
        (named("FH_TONE_HI"), 60_000.0, "phase.tone_band_hz"),
        (named("FH_SRCH_TIME"), 0.5, "explore.limit_s"),
        (named("FH_OBS_RANGE"), 0.45, "sensor.range_m"),
        (named("FH_RADIUS"), 2.7, "sensor.range_m"),
        (named("FH_SPD_MAX"), 0.09, "guard.v_max_mps"),
        (named("FH_STALL_R"), 11.0, "guard.v_max_mps"),
        (named("FH_OBS_RANGE"), 1.1, "guard.v_max_mps"),
        (named("FH_ACC_MAX"), 0.3, "guard.v_max_mps"),
        (named("FH_MARGIN_GRD"), 2.0, "guard.v_max_mps"),
    ] {
        let mut values = Values::DEFAULT;
        values.set(id, value).unwrap();
        assert_eq!(applied(&values).build::<256>().unwrap_err().field, field);
    }
    // A path is followed by no more than 1.27 m/s, and with little acceleration, or long delays, that takes its time.
    for (first, second, third) in [
        (("FH_SPD_MAX", 4.0), ("FH_STALL_T", 5.0), ("FH_STALL_R", 9.0)),
        (("FH_ACC_MAX", 0.1), ("FH_STALL_T", 4.0), ("FH_STALL_R", 1.0)),
        (("FH_LAG", 2.0), ("FH_DEAD_TIME", 1.12), ("FH_STALL_T", 1.0)),
        // With its back to the beacon it turns for longer than it may stand.
        (("FH_YAWR_MAX", 0.5), ("FH_STALL_T", 5.0), ("FH_STALL_R", 1.0)),
    ] {
        let mut values = Values::DEFAULT;
        for (name, value) in [first, second, third] {
            values.set(named(name), value).unwrap();
        }
        assert_eq!(applied(&values).build::<256>().unwrap_err().field, "guard.v_max_mps");
    }
    for (turn_s, age_s) in [(0.3, 0.5), (0.0, 0.2)] {
        let mut values = Values::DEFAULT;
        for (name, value) in [("FH_OBS_LAG", 0.15), ("FH_OBS_TURN", turn_s), ("FH_OBS_AGE", age_s)] {
            values.set(named(name), value).unwrap();
        }
        assert_eq!(applied(&values).build::<256>().unwrap_err().field, "sensor.lag_s");
    }
    let mut values = Values::DEFAULT;
    values.set(named("FH_TURN"), 1.0).unwrap();
    values.set(named("FH_TURN_RATE"), 0.1).unwrap();
    assert_eq!(applied(&values).build::<256>().unwrap_err().field, "turning.yaw_rate_radps");
}

#[test]
fn rows_are_what_a_ground_station_can_show() {
    for (row, param) in TABLE.iter().enumerate() {
        let name = param.name;
        assert!(name.len() <= NAME_MAX && name.starts_with("FH_"), "{name}");
        assert!(name.bytes().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == b'_'), "{name}");
        assert_eq!(TABLE.iter().position(|other| other.name == name), Some(row), "{name} is there twice");
        assert!(param.min < param.max, "{name}");
        let id = Id::at(row).unwrap();
        for value in [param.default, param.min, param.max] {
            assert_eq!(id.check(value), Ok(()), "{name} = {value}");
        }
        assert!(param.doc.ends_with('.') && param.doc.is_ascii() && !param.doc.contains('|'), "{name}");
        assert_eq!((id.name(), id.default(), id.range()), (name, param.default, (param.min, param.max)));
    }
    // A set of waiting answers has one bit for each.
    const { assert!(COUNT <= 128) };
}

#[test]
fn names_are_found_whole_and_only_whole() {
    for id in Id::all() {
        assert_eq!(Id::named(id.padded_name()), Some(id));
        assert_eq!(Id::named(id.name().as_bytes()), Some(id));
    }
    for name in [&b""[..], b"\0", b"FH_SPD_MA", b"FH_SPD_MAXX", b"fh_spd_max", b"FH_SPD_MAXXXXXXXXXXXX", b"\xff\xfe"] {
        assert_eq!(Id::named(name), None);
    }
    assert_eq!(Id::named(b"FH_SPD_MAX\0rubbish"), Some(named("FH_SPD_MAX")));
    assert_eq!((Id::at(0), Id::at(COUNT)), (Some(named("FH_SPD_MAX")), None));
}

#[test]
fn bad_values_are_refused_and_leave_the_old_one() {
    let mut values = Values::DEFAULT;
    let range = Refusal::OutOfRange { min: 0.05, max: 20.0 };
    for (name, value, refusal) in [
        ("FH_SPD_MAX", 0.0, range),
        ("FH_SPD_MAX", 20.01, range),
        ("FH_SPD_MAX", f32::NAN, Refusal::NotFinite),
        ("FH_SPD_MAX", f32::INFINITY, Refusal::NotFinite),
        ("FH_V1", 0.5, Refusal::NotWhole),
        ("FH_V1", 2.0, Refusal::OutOfRange { min: 0.0, max: 1.0 }),
        ("FH_RC_CH", 7.000_001, Refusal::NotWhole),
    ] {
        assert_eq!(values.set(named(name), value), Err(refusal), "{name} = {value}");
        assert_eq!(values, Values::DEFAULT);
    }
    values.set(named("FH_RC_CH"), 7.0).unwrap();
    values.set(named("FH_V1"), -0.0).unwrap();
    assert_eq!(
        (values.whole(named("FH_RC_CH")), values.is_on(named("FH_V1")), values.get(named("FH_V1")).to_bits()),
        (7, false, 0)
    );
}

#[test]
fn stored_values_come_back_and_refused_ones_are_their_defaults() {
    let mut values = Values::DEFAULT;
    values.set(named("FH_RADIUS"), 0.3).unwrap();
    assert_eq!(Values::restore(values.as_array()), (values, 0));
    let mut stored = *values.as_array();
    stored[named("FH_SPD_MAX").index()] = f32::NAN;
    stored[named("FH_V1").index()] = 7.0;
    assert_eq!(Values::restore(&stored), (values, 2));
}
