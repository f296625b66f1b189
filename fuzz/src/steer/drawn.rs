//! What a case of steering is drawn from: configurations, places, circles, looks, bearings.

use std::f32::consts::PI;

use foxhound_core::base::config::{Fence, RangeSensor, Vehicle};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::control::guard::{self, GuardInput};
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::guidance;
use foxhound_core::landing;
use foxhound_core::landing::observation::{Bad, Nothing, Pad, PadObservation, Seen};
use foxhound_core::mapping::scan::{Frame, Points, RAYS_MAX, SECTORS_MAX, Scan, Sector};
use foxhound_core::planning::planner::baseline::{self, Law, Offsets, Reading};
use foxhound_core::planning::planner::{self, Kind};

use super::super::{Draw, Noise};

pub(super) fn place(draw: &mut Draw<'_>) -> Horizontal {
    let reach_m = if draw.flag() { 2.0 } else { 20.0 };
    Horizontal { north: draw.any(-reach_m, reach_m), east: draw.any(-reach_m, reach_m) }
}

pub(super) fn circle(draw: &mut Draw<'_>) -> Circle {
    let moves = draw.below(6) == 0;
    let velocity_ned_mps = if moves {
        Horizontal { north: draw.any(-2.0, 2.0), east: draw.any(-2.0, 2.0) }
    } else {
        Horizontal::default()
    };
    Circle { center_ned_m: place(draw), radius_m: draw.field(0.25, 0.0, 1.0), velocity_ned_mps }
}

pub(super) fn circles(draw: &mut Draw<'_>) -> Vec<Circle> {
    let mut circles: Vec<Circle> = (0..draw.below(14)).map(|_| circle(draw)).collect();
    if draw.below(16) == 0 {
        // One in many copies, or a forest: more than the map holds.
        let (mut noise, is_forest) = (Noise(u64::from(draw.word())), draw.flag());
        let first = circles.first().copied().unwrap_or_default();
        circles.extend((0..200).map(|_| {
            let away = Horizontal { north: 3.0 * noise.gaussian(), east: 3.0 * noise.gaussian() };
            if is_forest { Circle { center_ned_m: away, radius_m: 0.1, ..Circle::default() } } else { first }
        }));
    }
    circles
}

pub(super) fn scan(draw: &mut Draw<'_>, time: Instant) -> Scan {
    let count = match draw.below(4) {
        0 => RAYS_MAX,
        1 => usize::from(draw.byte()),
        _ => SECTORS_MAX,
    };
    let (pattern, range_m) = (draw.word(), draw.any(0.0, 4.0));
    let mut sector = |index: usize| {
        match pattern.rotate_left(index as u32) & 3 {
            0 => Sector::Unknown,
            1 => Sector::Clear,
            2 => Sector::Hit(range_m),
            // Fewer bytes for more rays.
            _ if !index.is_multiple_of(5) && count > SECTORS_MAX => Sector::Hit(range_m + 0.01 * (index % 40) as f32),
            _ => Sector::Hit(draw.any(0.0, 5.0)),
        }
    };
    let rays = (0..count).map(&mut sector).collect();
    Scan {
        time,
        turn_s: 0.0,
        first_azimuth_rad: draw.field(0.0, -4.0, 4.0),
        step_rad: draw.field(PI / 36.0, -0.2, 0.2),
        range_max_m: draw.field(3.0, 0.1, 20.0),
        rays,
    }
}

pub(super) fn vehicle(draw: &mut Draw<'_>) -> Vehicle {
    Vehicle { radius_m: draw.field(Vehicle::DEFAULT.radius_m, 0.0, 2.0) }
}

pub(super) fn sensor(draw: &mut Draw<'_>) -> RangeSensor {
    let usual = RangeSensor::DEFAULT;
    RangeSensor {
        fov_rad: draw.field(usual.fov_rad, 0.1, 2.0 * PI),
        turn_s: draw.field(usual.turn_s, 0.0, 0.3),
        lag_s: draw.field(usual.lag_s, 0.0, 0.15),
        ..usual
    }
}

pub(super) fn guard_config(draw: &mut Draw<'_>) -> guard::Config {
    let usual = guard::Config::default();
    let radius_m = if draw.below(3) == 0 { draw.field(10.0, 1.0, 50.0) } else { 0.0 };
    let fence = Fence { center_ned_m: place(draw), radius_m, margin_m: draw.field(Fence::DEFAULT.margin_m, 0.0, 5.0) };
    guard::Config {
        v_max_mps: draw.field(usual.v_max_mps, 0.05, 20.0),
        evade_max_mps: draw.field(usual.evade_max_mps, 0.0, 20.0),
        v_down_max_mps: draw.field(usual.v_down_max_mps, 0.0, 5.0),
        a_max_mps2: draw.field(usual.a_max_mps2, 0.1, 20.0),
        jerk_max_mps3: draw.field(usual.jerk_max_mps3, 1.0, 1000.0),
        yaw_rate_max_radps: draw.field(usual.yaw_rate_max_radps, 0.1, 6.3),
        margin_m: draw.field(usual.margin_m, 0.0, 1.0),
        approach_rate_per_s: draw.field(usual.approach_rate_per_s, 0.1, 20.0),
        out_of_view_share: draw.field(usual.out_of_view_share, 0.0, 1.0),
        altitude_band_m: draw.field(usual.altitude_band_m, 0.1, 100.0),
        fence,
        ..usual
    }
}

fn planner_config(draw: &mut Draw<'_>) -> planner::Config {
    let kind = [Kind::Foxhound, Kind::Foxhound, Kind::Paper, Kind::Standard][usize::from(draw.below(4))];
    let usual = planner::Config::of(kind);
    let laws = [
        baseline::Kind::Logarithmic,
        baseline::Kind::InverseDistance,
        baseline::Kind::Khatib,
        baseline::Kind::Rizqi,
        baseline::Kind::Sun,
        baseline::Kind::VirtualForce,
    ];
    let law = Law::of(laws[usize::from(draw.below(6))]);
    let mut config = planner::Config {
        law: if kind == Kind::Foxhound { Law::default() } else { law },
        reading: [Reading::Waypoint, Reading::Quarters, Reading::Gradient][usize::from(draw.below(3))],
        offsets: if draw.below(4) == 0 { Offsets::Scalar } else { Offsets::Signed },
        margin_m: draw.field(usual.margin_m, 0.02, 1.0),
        ..usual
    };
    for gains in [&mut config.gains, &mut config.gains_sigma] {
        gains.k_att = draw.field(gains.k_att, 0.05, 100.0);
        gains.k_rep = draw.field(gains.k_rep, 0.0, 100.0);
        gains.influence_m = draw.field(gains.influence_m, 0.05, 10.0);
        gains.swirl = draw.field(gains.swirl, 0.0, 100.0);
    }
    config
}

pub(super) fn situation(draw: &mut Draw<'_>) -> GuardInput {
    let position_ned_m = place(draw);
    let underway = Horizontal { north: draw.between(-1.0, 1.0), east: draw.between(-1.0, 1.0) };
    let rest_ned_m = if draw.below(8) == 0 { place(draw) } else { position_ned_m.plus(underway) };
    GuardInput {
        position_ned_m,
        rest_ned_m,
        yaw_rad: draw.any(-4.0, 4.0),
        rest_yaw_rad: draw.any(-4.0, 4.0),
        delay_s: draw.field(0.3, 0.0, 1.0),
        down_m: draw.flag().then(|| draw.any(-20.0, 5.0)),
        held_down_m: draw.flag().then(|| draw.any(-20.0, 5.0)),
        gust_margin_m: if draw.flag() { 0.0 } else { draw.between(0.0, 0.6) },
        is_evading: draw.flag(),
        may_be_unseen: draw.flag(),
        is_lost: draw.flag() && draw.flag() && draw.flag(),
        has_gusts: draw.flag(),
    }
}

pub(super) fn guidance_config(draw: &mut Draw<'_>) -> guidance::Config {
    let usual = guidance::Config::default();
    let mut config = guidance::Config {
        seed: u64::from(draw.word()),
        vehicle: vehicle(draw),
        sensor: sensor(draw),
        tick_s: draw.field(usual.tick_s, 0.005, 0.1),
        replan_at_waypoint: if draw.flag() { usual.replan_at_waypoint } else { draw.below(17) },
        replan_after_s: draw.field(usual.replan_after_s, 0.3, 5.0),
        planner: planner_config(draw),
        guard: guard_config(draw),
        ..usual
    };
    if draw.flag() {
        config.vehicle_model.dead_time_s = draw.field(config.vehicle_model.dead_time_s, 0.0, 0.1);
        config.vehicle_model.lag_s = draw.field(config.vehicle_model.lag_s, 0.0, 5.0);
        config.mission.obstacles_required = draw.flag();
        config.mission.bearing_age_max_s = draw.field(config.mission.bearing_age_max_s, 0.05, 60.0);
        config.mission.no_path_max_s = draw.field(config.mission.no_path_max_s, 0.5, 600.0);
    }
    if draw.below(4) == 0 {
        let usual = landing::Config::default();
        config.landing = Some(landing::Config {
            has_camera: draw.flag(),
            focal_widths: draw.field(usual.focal_widths, 0.2, 5.0),
            pad_radius_m: draw.field(usual.pad_radius_m, 0.02, 5.0),
            request_land: draw.flag(),
            approach_s: draw.field(usual.approach_s, 1.0, 600.0),
            total_s: draw.field(usual.total_s, 1.0, 600.0),
            ..usual
        });
    }
    config
}

/// Guidance hands no pose to the guard whose yaw is absurd.
pub(super) fn not_absurd(value: f32) -> f32 {
    if value.is_finite() { value.clamp(-100.0, 100.0) } else { value }
}

pub(super) fn look(draw: &mut Draw<'_>, now: Instant) -> PadObservation {
    let seen = match draw.below(4) {
        0 => Seen::Bad(Bad::Cut),
        1 => Seen::Nothing(Nothing::Shape),
        _ => Seen::Pad(Pad {
            forward: draw.any(-0.6, 0.6),
            right: draw.any(-0.6, 0.6),
            radius: draw.any(0.0, 0.5),
            confidence: draw.any(0.0, 1.0),
            is_cut: draw.flag(),
        }),
    };
    PadObservation { time: draw_time(draw, now), seen }
}

pub(super) fn bearing(azimuth_rad: f32, sigma_rad: f32, time: Instant) -> Bearing {
    Bearing {
        time,
        azimuth_rad,
        sigma_rad,
        elevation_rad: 0.0,
        elevation_sigma_rad: 0.1,
        quality: Quality::default(),
        flags: Flags::default(),
        valid: true,
    }
}

pub(super) fn any_bearing(draw: &mut Draw<'_>, now: Instant) -> Bearing {
    Bearing {
        elevation_rad: draw.any(0.0, 1.5),
        elevation_sigma_rad: draw.any(0.01, 1.0),
        flags: Flags(draw.word() as u16),
        valid: draw.below(4) != 0,
        ..bearing(draw.any(-PI, PI), draw.any(0.0, 1.0), draw_time(draw, now))
    }
}

pub(super) fn draw_time(draw: &mut Draw<'_>, now: Instant) -> Instant {
    if draw.below(4) == 0 { draw.instant(now) } else { now }
}

pub(super) fn points(draw: &mut Draw<'_>, time: Instant) -> Points {
    let mut points = Points { time, ..Points::default() };
    points.frame = [Frame::Body, Frame::VehicleNed, Frame::LocalNed][usize::from(draw.below(3))];
    for _ in 0..draw.below(80) {
        // More than there is room for is not taken.
        let _ = points.points_m.push(place(draw));
    }
    points
}
