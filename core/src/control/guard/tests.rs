//! Tests of the guard.

use super::half_space::HalfSpace;
use super::*;
use crate::base::config::{self, Fence, RangeSensor};
use crate::base::error::ConfigError;
use crate::base::pose::Pose;
use crate::base::rng::Rng;
use crate::control::vehicle::Vehicle;
use crate::mapping::scan::{Scan, Sector};
use std::vec::Vec;

const DT: f32 = 0.02;

fn build(config: &Config, sensor: &RangeSensor) -> Result<Guard, ConfigError> {
    config.build(&config::Vehicle::DEFAULT, sensor)
}

fn guard_of(config: &Config) -> Guard {
    build(config, &RangeSensor::DEFAULT).unwrap()
}

fn wall(north: f32, reach_m: f32) -> Neighbour {
    Neighbour { center_ned_m: Horizontal { north, east: 0.0 }, reach_m, ..Neighbour::default() }
}

fn demand(north: f32, east: f32) -> Demand {
    Demand { velocity_ned_mps: Horizontal { north, east }, ..Demand::default() }
}

/// Flies a demand with an ideal vehicle (rest point = position) and returns the smallest clearance and the end.
fn fly(demand: Demand, obstacles: &[Neighbour], yaw_rad: f32) -> (f32, Horizontal) {
    let (guard, mut state) = (guard_of(&Config::default()), State::default());
    let mut at = Horizontal::default();
    let mut closest = f32::INFINITY;
    for _ in 0..1000 {
        let input = GuardInput { position_ned_m: at, rest_ned_m: at, yaw_rad, ..GuardInput::default() };
        let setpoint = guard.step(&mut state, &demand, &input, obstacles, DT).setpoint;
        at = at.plus(setpoint.velocity_ned_mps.horizontal().times(DT));
        closest = obstacles.iter().map(|o| o.clearance_m(at)).fold(closest, f32::min);
    }
    (closest, at)
}

#[test]
fn full_speed_at_a_wall_ends_before_it() {
    let (closest, at) = fly(demand(5.0, 0.0), &[wall(4.0, 1.0)], 0.0);
    assert!(closest > 0.0 && closest < 0.2, "{closest} {at:?}");
}

#[test]
fn what_evades_may_be_faster_and_nothing_else() {
    let guard = guard_of(&Config { evade_max_mps: 2.0, ..Config::default() });
    for (is_evading, most_mps) in [(false, 1.0), (true, 2.0)] {
        let mut state = State::default();
        let input = GuardInput { is_evading, ..GuardInput::default() };
        for _ in 0..100 {
            guard.step(&mut state, &demand(5.0, 0.0), &input, &[], DT);
        }
        assert!((state.command_ned_mps().norm() - most_mps).abs() < 0.01, "{is_evading}: {state:?}");
        // When evading ends, the vehicle slows to the cruise as fast as it may.
        for _ in 0..30 {
            guard.step(&mut state, &demand(5.0, 0.0), &GuardInput::default(), &[], DT);
        }
        assert!(state.command_ned_mps().norm() <= 1.0001, "{state:?}");
    }
}

#[test]
fn a_glancing_demand_slides_along() {
    let (closest, at) = fly(demand(0.5, 0.3), &[wall(2.0, 0.6)], 0.4);
    assert!(closest > 0.0 && at.north > 3.0, "{closest} {at:?}");
}

#[test]
fn outside_the_field_of_view_it_is_slower() {
    let (_, ahead) = fly(demand(1.0, 0.0), &[], 0.0);
    let (_, behind) = fly(demand(1.0, 0.0), &[], 3.0);
    assert!(behind.north < 0.51 * ahead.north && behind.north > 0.0, "{ahead:?} {behind:?}");
}

#[test]
fn from_inside_a_circle_it_may_leave_but_not_go_deeper() {
    let obstacle = wall(-0.3, 0.4);
    let (_, out) = fly(demand(1.0, 0.0), &[obstacle], 0.0);
    assert!(out.north > 5.0, "{out:?}");
    let (closest, _) = fly(demand(-1.0, 0.0), &[obstacle], 3.1);
    assert!(closest > -0.101, "{closest}");
}

#[test]
fn whatever_comes_in_a_finite_setpoint_inside_the_limits_comes_out() {
    let config = Config::default();
    let (guard, mut state) = (guard_of(&config), State::default());
    let mut rng = Rng::new(11, 0);
    let wild = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30, 0.0, 1e-30];
    let mut last = Horizontal::default();
    for _ in 0..20_000 {
        let mut number = || {
            let pick = (rng.uniform() * 20.0) as usize;
            wild.get(pick).copied().unwrap_or(4.0 * rng.gaussian())
        };
        let mut vector = || Horizontal { north: number(), east: number() };
        let demand = Demand { velocity_ned_mps: vector(), down_mps: vector().north, yaw_rate_radps: vector().east };
        let input = GuardInput {
            position_ned_m: vector(),
            rest_ned_m: vector(),
            yaw_rad: vector().north,
            ..GuardInput::default()
        };
        let obstacles: Vec<_> =
            (0..4).map(|_| Neighbour { center_ned_m: vector(), reach_m: 0.3, velocity_ned_mps: vector() }).collect();
        let setpoint = guard.step(&mut state, &demand, &input, &obstacles, DT).setpoint;
        let velocity = setpoint.velocity_ned_mps;
        assert!(velocity.is_finite() && setpoint.yaw_rate_radps.is_finite());
        assert!(velocity.horizontal().norm() <= config.v_max_mps * 1.0001);
        assert!(velocity.down.abs() <= config.v_down_max_mps);
        assert!(setpoint.yaw_rate_radps.abs() <= config.yaw_rate_max_radps);
        assert!(velocity.horizontal().minus(last).norm() <= config.a_max_mps2 * DT * 1.001 + 1e-6);
        last = velocity.horizontal();
    }
}

/// Where an ideal vehicle ends after 20 s under a demand, with a gust margin.
fn ends(from: Horizontal, demand: Demand, gust_margin_m: f32, obstacles: &[Neighbour]) -> Horizontal {
    let (guard, mut state) = (guard_of(&Config::default()), State::default());
    let mut at = from;
    for _ in 0..1000 {
        let input = GuardInput { position_ned_m: at, rest_ned_m: at, gust_margin_m, ..GuardInput::default() };
        let setpoint = guard.step(&mut state, &demand, &input, obstacles, DT).setpoint;
        at = at.plus(setpoint.velocity_ned_mps.horizontal().times(DT));
    }
    at
}

#[test]
fn gusts_keep_it_farther_away_and_let_it_go_away_by_itself() {
    let wall = wall(4.0, 1.0);
    let calm = ends(Horizontal::default(), demand(1.0, 0.0), 0.0, &[wall]);
    let gusty = ends(Horizontal::default(), demand(1.0, 0.0), 0.4, &[wall]);
    assert!((calm.north - gusty.north - 0.4).abs() < 0.01, "{calm:?} {gusty:?}");
    // In gusts an obstacle that seems to move away is treated as standing.
    let leaving = Neighbour { velocity_ned_mps: at(0.2, 0.1), ..wall };
    let near = ends(Horizontal::default(), demand(1.0, 0.0), 0.4, &[leaving]);
    assert!((near.north - gusty.north).abs() < 0.01, "{near:?} {gusty:?}");
    // A vehicle that holds where gusts could push it into the wall moves away.
    let left = ends(Horizontal { north: 2.9, east: 0.0 }, demand(0.0, 0.0), 0.4, &[wall]);
    assert!((wall.clearance_m(left) - 0.43).abs() < 0.02, "{left:?}");
}

#[test]
fn where_gusts_want_more_room_than_there_is_it_keeps_to_the_middle() {
    // Half a metre between two pillars, of which the vehicle needs 0.3 m, and a gust margin that neither side can have.
    let sides = [pillar(0.0, -0.55, 0.3), pillar(0.0, 0.55, 0.3)];
    for off_m in [-0.08, 0.08] {
        let end = ends(at(0.0, off_m), demand(0.0, 0.0), 0.5, &sides);
        assert!(sides.iter().all(|side| side.clearance_m(end) > 0.06), "from {off_m}: {end:?}");
    }
    // In calm air it stays where it is.
    assert_eq!(ends(at(0.0, 0.05), demand(0.0, 0.0), 0.0, &sides), at(0.0, 0.05));
}

/// A wind of that speed blows north for ten seconds, against the obstacles; nothing behind the vehicle has been seen,
/// and its nose does not turn. Returns the smallest clearance and the last.
fn blown(wind_mps: f32, (gust_margin_m, has_gusts): (f32, bool), obstacles: &[Neighbour]) -> (f32, f32) {
    let (guard, mut state) = (guard_of(&Config::default()), State::default());
    let (mut position, mut closest_m, mut clearance_m) = (Horizontal::default(), f32::INFINITY, 0.0);
    for _ in 0..500 {
        guard.note_circles(&mut state, obstacles, &Pose { position_ned_m: position, yaw_rad: 0.0 });
        let input = GuardInput {
            position_ned_m: position,
            rest_ned_m: position,
            gust_margin_m,
            has_gusts,
            ..GuardInput::default()
        };
        let setpoint = guard.step(&mut state, &demand(0.0, 0.0), &input, obstacles, DT).setpoint;
        position = position.plus(setpoint.velocity_ned_mps.horizontal().plus(at(wind_mps, 0.0)).times(DT));
        clearance_m = obstacles.iter().map(|obstacle| obstacle.clearance_m(position)).fold(f32::INFINITY, f32::min);
        closest_m = clearance_m.min(closest_m);
    }
    (closest_m, clearance_m)
}

#[test]
fn gusts_do_not_wait_until_the_nose_has_turned() {
    let near = [pillar(0.7, 0.0, 0.3)];
    let closest_m = [(0.0, false), (0.5, true), (0.5, false)].map(|gusts| blown(0.0, gusts, &near).1);
    assert!((closest_m[0] - 0.25).abs() < 0.01 && closest_m[1] > 0.45, "{closest_m:?}");
    // Gusts that are only expected do: it moves as far as it assumes to be clear at the start.
    assert!(closest_m[2] < 0.25 + 0.04, "{closest_m:?}");
}

#[test]
fn against_gusts_it_is_as_fast_among_many_obstacles_as_before_one() {
    let row: Vec<_> = (-40..=40).map(|place| pillar(1.0, 0.1 * place as f32, 0.3)).collect();
    for (obstacles, what) in [(row.get(39..42).unwrap(), "few"), (row.get(25..56).unwrap(), "many"), (&row, "all")] {
        let (closest_m, _) = blown(0.5, (0.5, true), obstacles);
        assert!(closest_m > 0.2, "{what}: {closest_m}");
    }
}

#[test]
fn bad_limits_are_refused_by_name() {
    let refused = |change: &dyn Fn(&mut Config)| {
        let mut config = Config::default();
        change(&mut config);
        build(&config, &RangeSensor::DEFAULT).unwrap_err().field
    };
    assert_eq!(refused(&|c| c.v_max_mps = 0.0), "guard.v_max_mps");
    assert_eq!(refused(&|c| c.a_max_mps2 = f32::NAN), "guard.a_max_mps2");
    let sensor = RangeSensor { fov_rad: 10.0, ..RangeSensor::DEFAULT };
    assert_eq!(build(&Config::default(), &sensor).unwrap_err().field, "sensor.fov_rad");
}

fn at(north: f32, east: f32) -> Horizontal {
    Horizontal { north, east }
}

fn pillar(north: f32, east: f32, radius_m: f32) -> Neighbour {
    Neighbour { center_ned_m: at(north, east), reach_m: radius_m + 0.15, ..Neighbour::default() }
}

/// The guard's input for a vehicle.
fn input(vehicle: &Vehicle) -> GuardInput {
    let commands = vehicle.pending.iter().map(|setpoint| setpoint.velocity_ned_mps.horizontal());
    let pending = commands.fold(Horizontal::default(), Horizontal::plus);
    GuardInput {
        position_ned_m: vehicle.position,
        rest_ned_m: vehicle.position.plus(vehicle.velocity.times(vehicle.lag_s)).plus(pending.times(DT)),
        yaw_rad: vehicle.yaw_rad,
        delay_s: vehicle.lag_s + vehicle.pending.len() as f32 * DT,
        ..GuardInput::default()
    }
}

/// An independent monitor: distance in f64 from a braking path to an obstacle's boundary, by a point-to-segment
/// distance written separately from the guard's.
fn monitored_clearance_m(rest: Horizontal, command: Horizontal, a_max_mps2: f32, obstacle: &Neighbour) -> f64 {
    let f = |v: Horizontal| (f64::from(v.north), f64::from(v.east));
    let ((x, y), (vx, vy), (cx, cy)) = (f(rest), f(command), f(obstacle.center_ned_m));
    let speed = vx.hypot(vy);
    // One more step at this command, then the brake.
    let seconds = f64::from(DT) + speed / (2.0 * f64::from(a_max_mps2));
    let nearest =
        if speed > 0.0 { (((cx - x) * vx + (cy - y) * vy) / (speed * speed)).clamp(0.0, seconds) } else { 0.0 };
    (x + nearest * vx - cx).hypot(y + nearest * vy - cy) - f64::from(obstacle.reach_m)
}

#[test]
fn an_independent_monitor_finds_every_braking_path_clear() {
    let config = Config::default();
    let guard = guard_of(&config);
    let (mut ticks, mut limited) = (0, 0);
    for seed in 0..60 {
        let mut rng = Rng::new(seed, 3);
        let field: Vec<_> = (0..40)
            .map(|_| pillar(8.0 * rng.uniform() - 4.0, 8.0 * rng.uniform() - 4.0, 0.1 + 0.2 * rng.uniform()))
            .filter(|o| o.clearance_m(Horizontal::default()) > 0.02)
            .collect();
        let (steps, lag_s) = if seed % 2 == 0 { (0, 0.15) } else { (16, 0.5) };
        let mut vehicle = Vehicle::new(Horizontal::default(), steps, lag_s);
        let mut state = State::default();
        let mut wish = demand(0.0, 0.0);
        for step in 0..1000 {
            if step % 30 == 0 {
                wish = demand(1.5 * rng.gaussian(), 1.5 * rng.gaussian());
            }
            let input = input(&vehicle);
            let ruling = guard.step(&mut state, &wish, &input, &field, DT);
            let command = ruling.setpoint.velocity_ned_mps.horizontal();
            for obstacle in &field {
                let clearance_m = monitored_clearance_m(input.rest_ned_m, command, config.a_max_mps2, obstacle);
                assert!(clearance_m > 0.0, "seed {seed} step {step}: {clearance_m} {ruling:?}");
            }
            vehicle.follow(&ruling.setpoint);
            assert!(field.iter().all(|o| o.clearance_m(vehicle.position) > 0.0), "seed {seed} step {step}");
            ticks += 1;
            limited += u32::from(ruling.action == Action::Limited);
        }
    }
    assert!(limited > ticks / 10, "the guard must have been asked: {limited} of {ticks}");
}

/// Pillars whose surface a ray of the view meets first, in f64.
fn visible(pillars: &[Neighbour], from: Horizontal, yaw_rad: f32) -> Vec<usize> {
    let first_hit = |degree: i32| {
        let angle = f64::from(yaw_rad) + f64::from(degree).to_radians();
        let hit = |o: &Neighbour| {
            let away = o.center_ned_m.minus(from);
            let (x, y, r) = (f64::from(away.north), f64::from(away.east), f64::from(o.reach_m - 0.15));
            let along = x * angle.cos() + y * angle.sin();
            let depth = along * along - (x * x + y * y - r * r);
            (along > 0.0 && depth >= 0.0).then(|| along - depth.sqrt()).filter(|distance_m| *distance_m < 3.0)
        };
        let hits = pillars.iter().enumerate().filter_map(|(index, o)| Some((index, hit(o)?)));
        hits.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
    };
    (-45..=45).filter_map(first_hit).collect()
}

/// Sets off among unknown pillars, in a random direction relative to the nose; returns the smallest clearance and the
/// distance covered.
fn set_off(seed: u64, looks: bool) -> (f32, f32) {
    let guard = guard_of(&Config::default());
    let mut rng = Rng::new(seed, 4);
    // Close pillars all round, some of them touching the path.
    let mut pillars: Vec<Neighbour> = Vec::new();
    for _ in 0..100 {
        if pillars.len() == 5 {
            break;
        }
        let bearing_rad = core::f32::consts::TAU * rng.uniform();
        let radius_m = 0.1 + 0.2 * rng.uniform();
        let place = Horizontal::from_bearing(bearing_rad).times(radius_m + 0.17 + 0.6 * rng.uniform());
        let new = pillar(place.north, place.east, radius_m);
        if pillars.iter().all(|o| o.center_ned_m.minus(place).norm() > o.reach_m + new.reach_m + 0.15) {
            pillars.push(new);
        }
    }
    let heading_rad = core::f32::consts::TAU * rng.uniform();
    let wish = Demand { velocity_ned_mps: Horizontal::from_bearing(heading_rad).times(0.9), ..Demand::default() };
    let (mut vehicle, mut state) = (Vehicle::new(Horizontal::default(), 0, 0.15), State::default());
    let mut known = [false; 5];
    let (mut closest_m, mut came_m) = (f32::INFINITY, 0.0_f32);
    let mut look = None;
    for step in 0..400 {
        if step % 5 == 0 {
            for index in visible(&pillars, vehicle.position, vehicle.yaw_rad) {
                known[index] = true;
            }
        }
        let near: Vec<_> = pillars.iter().zip(known).filter(|(_, known)| *known).map(|(o, _)| *o).collect();
        if looks && step % 5 == 0 {
            let pose = crate::base::pose::Pose { position_ned_m: vehicle.position, yaw_rad: vehicle.yaw_rad };
            guard.note_circles(&mut state, &near, &pose);
        }
        let towards = look.unwrap_or(heading_rad);
        let yaw_rate_radps = 2.5 * crate::base::units::wrap_pi(towards - vehicle.yaw_rad);
        let ruling = guard.step(&mut state, &Demand { yaw_rate_radps, ..wish }, &input(&vehicle), &near, DT);
        look = ruling.look_ned_rad;
        vehicle.follow(&ruling.setpoint);
        closest_m = pillars.iter().map(|o| o.clearance_m(vehicle.position)).fold(closest_m, f32::min);
        came_m = came_m.max(vehicle.position.norm());
    }
    (closest_m, came_m)
}

#[test]
fn it_does_not_set_off_into_what_it_has_not_looked_at_and_yet_sets_off() {
    let flights: Vec<_> = (0..200).map(|seed| set_off(seed, true)).collect();
    for (seed, (closest_m, _)) in flights.iter().enumerate() {
        assert!(*closest_m > 0.0, "seed {seed}: {closest_m}");
    }
    let blind: Vec<_> = (0..200).map(|seed| set_off(seed, false)).collect();
    assert!(blind.iter().filter(|(closest_m, _)| *closest_m < 0.0).count() > 10, "the test must be able to fail");
    // If a vehicle that does not look gets away unharmed, so does one that looks.
    let pairs = || flights.iter().zip(&blind).filter(|(_, blind)| blind.0 > 0.02 && blind.1 > 2.0);
    let stuck = pairs().filter(|(flight, _)| flight.1 < 1.0).count();
    assert!(pairs().count() > 30 && stuck == 0, "{stuck} of {} are stuck", pairs().count());
}

/// How far from the hull a dark post, of which no ray comes back, is in the end, beside or on the way of a vehicle with this hull.
fn before_a_dark_post_m(hull_m: f32, aside_m: f32) -> f32 {
    const POST_M: f32 = 0.125;
    let post = at(3.0, aside_m);
    let guard = Config::default().build(&config::Vehicle { radius_m: hull_m }, &RangeSensor::DEFAULT).unwrap();
    let (mut vehicle, mut state) = (Vehicle::new(Horizontal::default(), 4, 0.45), State::default());
    let step_rad = core::f32::consts::FRAC_PI_2 / 72.0;
    let (mut closest_m, mut look_rad) = (f32::INFINITY, 0.0);
    for step in 0..600 {
        if step % 5 == 0 {
            let away = post.minus(vehicle.position);
            let ray = |index: u16| {
                let azimuth_rad = step_rad * (f32::from(index) - 35.5) + vehicle.yaw_rad;
                let towards = Horizontal::from_bearing(azimuth_rad);
                let (along_m, off_m) = (towards.dot(away), towards.north * away.east - towards.east * away.north);
                if along_m > 0.0 && off_m.abs() < POST_M { Sector::Unknown } else { Sector::Clear }
            };
            let scan = Scan {
                time: crate::base::time::Instant(20_000 * step),
                turn_s: 0.0,
                first_azimuth_rad: -35.5 * step_rad,
                step_rad,
                range_max_m: 3.0,
                rays: (0..72).map(ray).collect(),
            };
            let pose = Pose { position_ned_m: vehicle.position, yaw_rad: vehicle.yaw_rad };
            guard.note_scan(&mut state, &scan, &pose, false);
        }
        let yaw_rate_radps = 2.5 * crate::base::units::wrap_pi(look_rad - vehicle.yaw_rad);
        let wish = Demand { yaw_rate_radps, ..demand(1.0, 0.0) };
        let ruling = guard.step(&mut state, &wish, &input(&vehicle), &[], DT);
        look_rad = ruling.look_ned_rad.unwrap_or(0.0);
        vehicle.follow(&ruling.setpoint);
        closest_m = closest_m.min(post.minus(vehicle.position).norm() - POST_M - hull_m);
    }
    closest_m
}

#[test]
fn what_no_ray_comes_back_from_is_not_flown_into_whatever_the_hull() {
    for hull_m in [0.15, 0.3, 0.6, 0.8] {
        for aside in -25..=25 {
            let aside_m = 0.043 * aside as f32 * (hull_m + 0.05);
            let clear_m = before_a_dark_post_m(hull_m, aside_m);
            assert!(clear_m > 0.0, "hull of {hull_m} m, {aside_m} m aside: {clear_m}");
        }
    }
}

/// A pillar hidden behind another from the start is in the open from beside it. The nose points elsewhere when the
/// vehicle gets there.
#[test]
fn what_was_hidden_from_elsewhere_is_looked_at_before_it_is_approached() {
    let guard = guard_of(&Config::default());
    let mut state = State::default();
    let screen = pillar(1.0, 0.0, 0.1);
    let look = |state: &mut State, position_ned_m: Horizontal, yaw_rad: f32| {
        guard.note_circles(state, &[screen], &Pose { position_ned_m, yaw_rad });
    };
    let rule = |state: &mut State, position_ned_m: Horizontal, yaw_rad: f32| {
        let input = GuardInput { position_ned_m, rest_ned_m: position_ned_m, yaw_rad, ..GuardInput::default() };
        guard.step(state, &demand(0.0, 0.3), &input, &[screen], DT)
    };
    look(&mut state, Horizontal::default(), 0.0);
    rule(&mut state, Horizontal::default(), 0.0);
    // Behind the screen as seen from the start; from the side nothing is in between.
    let beside = at(1.3, -0.25);
    look(&mut state, beside, 3.1);
    let ruling = rule(&mut state, beside, 3.1);
    assert_eq!((ruling.action, ruling.setpoint.velocity_ned_mps.east), (Action::Looking, 0.0));
    // The nose turns to where it is asked to, and then the vehicle may go.
    let mut look_rad = ruling.look_ned_rad;
    for _ in 0..3 {
        let Some(yaw_rad) = look_rad else { break };
        look(&mut state, beside, yaw_rad);
        look_rad = rule(&mut state, beside, yaw_rad).look_ned_rad;
    }
    let ruling = rule(&mut state, beside, look_rad.unwrap_or(1.0));
    assert!(look_rad.is_none() && ruling.setpoint.velocity_ned_mps.east > 0.0, "{ruling:?}");
}

/// Who gives way to somebody that he no longer sees looks before he goes; who sees him come does not wait.
#[test]
fn giving_way_goes_into_the_unseen_only_for_somebody_in_view() {
    let guard = guard_of(&Config::default());
    for may_be_unseen in [false, true] {
        let mut state = State::default();
        guard.note_circles(&mut state, &[], &Pose::default());
        let input = GuardInput { is_evading: true, may_be_unseen, ..GuardInput::default() };
        for _ in 0..100 {
            guard.step(&mut state, &demand(-0.5, 0.0), &input, &[], DT);
        }
        let speed_mps = state.command_ned_mps().norm();
        assert!(if may_be_unseen { speed_mps > 0.49 } else { speed_mps < 0.2 }, "{may_be_unseen}: {speed_mps}");
    }
}

#[test]
fn it_passes_a_gap_that_is_little_wider_than_itself() {
    let guard = guard_of(&Config::default());
    // 0.42 m between two walls of pillars.
    let wall: Vec<_> =
        (0..8).flat_map(|k| [1.0, -1.0].map(|side| pillar(1.5, side * (0.36 + 0.25 * k as f32), 0.15))).collect();
    let (mut vehicle, mut state) = (Vehicle::new(Horizontal::default(), 0, 0.15), State::default());
    let mut look_rad = 0.0;
    for step in 0..500 {
        if step % 5 == 0 {
            let pose = crate::base::pose::Pose { position_ned_m: vehicle.position, yaw_rad: vehicle.yaw_rad };
            guard.note_circles(&mut state, &wall, &pose);
        }
        let yaw_rate_radps = 2.5 * (look_rad - vehicle.yaw_rad);
        let wish = Demand { yaw_rate_radps, ..demand(1.0, 0.0) };
        let ruling = guard.step(&mut state, &wish, &input(&vehicle), &wall, DT);
        look_rad = ruling.look_ned_rad.unwrap_or(0.0);
        vehicle.follow(&ruling.setpoint);
        assert!(wall.iter().all(|o| o.clearance_m(vehicle.position) > 0.0));
    }
    assert!(vehicle.position.north > 3.0, "{:?}", vehicle.position);
}

#[test]
fn what_comes_at_it_is_evaded_from_a_standstill_even_into_the_unseen() {
    let guard = guard_of(&Config::default());
    for (steps, lag_s) in [(0, 0.15), (16, 0.5)] {
        for offset_m in [0.0, 0.05, -0.2] {
            let (mut vehicle, mut state) = (Vehicle::new(Horizontal::default(), steps, lag_s), State::default());
            let mut closest_m = f32::INFINITY;
            for step in 0..1000 {
                let mover = Neighbour {
                    center_ned_m: at(3.0 - 0.3 * DT * step as f32, offset_m),
                    reach_m: 0.45,
                    velocity_ned_mps: at(-0.3, 0.0),
                };
                if step % 5 == 0 {
                    let pose = crate::base::pose::Pose { position_ned_m: vehicle.position, yaw_rad: 0.0 };
                    guard.note_circles(&mut state, &[mover], &pose);
                }
                let ruling = guard.step(&mut state, &Demand::default(), &input(&vehicle), &[mover], DT);
                vehicle.follow(&ruling.setpoint);
                closest_m = closest_m.min(mover.clearance_m(vehicle.position));
            }
            assert!(closest_m > 0.0, "delay of {steps} steps, offset {offset_m}: {closest_m}");
        }
    }
}

/// A body comes from ahead, where the sensor looks. Away from it, behind, nothing has been seen: the vehicle backs off from the body
/// as far as it has to, whatever the demand, and not with the demand's speed.
#[test]
fn a_threat_lets_it_make_way_into_the_unseen_and_do_no_more() {
    let guard = guard_of(&Config::default());
    let fastest_mps = |wish: Demand| {
        let mut state = State::default();
        let mut fastest_mps: f32 = 0.0;
        for step in 0..80 {
            let mover = Neighbour {
                center_ned_m: at(1.0 - 0.3 * DT * step as f32, 0.0),
                reach_m: 0.45,
                velocity_ned_mps: at(-0.3, 0.0),
            };
            let pose = Pose::default();
            guard.note_circles(&mut state, &[mover], &pose);
            let ruling = guard.step(&mut state, &wish, &GuardInput::default(), &[mover], DT);
            fastest_mps = fastest_mps.max(-ruling.setpoint.velocity_ned_mps.north);
        }
        fastest_mps
    };
    let made_way_mps = fastest_mps(Demand::default());
    assert!(made_way_mps > 0.2, "{made_way_mps}");
    let demanded_mps = fastest_mps(demand(-1.0, 0.0));
    assert!(demanded_mps < made_way_mps + 0.02, "{demanded_mps}, without the demand {made_way_mps}");
}

#[test]
fn the_fence_is_never_left_and_from_outside_it_comes_back() {
    let fence = Fence { center_ned_m: at(0.5, 0.5), radius_m: 3.0, ..Fence::DEFAULT };
    let depth_m = |place| fence.inside(place).unwrap().1;
    for seed in 0..40 {
        let guard = guard_of(&Config { fence, v_max_mps: 2.0, ..Config::default() });
        let mut rng = Rng::new(seed, 5);
        let (mut vehicle, mut state) = (Vehicle::new(Horizontal::default(), 16, 0.5), State::default());
        let mut wish = demand(0.0, 0.0);
        for step in 0..1500 {
            if step % 60 == 0 {
                wish = demand(3.0 * rng.gaussian(), 3.0 * rng.gaussian());
            }
            let ruling = guard.step(&mut state, &wish, &input(&vehicle), &[], DT);
            vehicle.follow(&ruling.setpoint);
            assert!(depth_m(vehicle.position) > 0.2, "seed {seed}: {:?}", vehicle.position);
        }
        let mut outside = Vehicle::new(at(9.0, 0.0), 16, 0.5);
        let mut state = State::default();
        for _ in 0..1500 {
            let ruling = guard.step(&mut state, &demand(1.0, 0.0), &input(&outside), &[], DT);
            outside.follow(&ruling.setpoint);
            assert!(outside.position.north < 9.01);
        }
        assert!(depth_m(outside.position) > 0.2, "{:?}", outside.position);
    }
}

#[test]
fn a_gentle_vehicle_slows_before_it_turns_and_keeps_its_distance_from_walls_and_fence() {
    let fence = Fence { radius_m: 10.0, ..Fence::DEFAULT };
    for a_max_mps2 in [0.1, 0.2, 0.5, 1.0] {
        let guard = guard_of(&Config { fence, a_max_mps2, ..Config::default() });
        for seed in 0..20 {
            let mut rng = Rng::new(seed, 7);
            let (mut vehicle, mut state) = (Vehicle::new(Horizontal::default(), 4, 0.3), State::default());
            let wall = wall(9.0, 4.0);
            let mut wish = demand(0.0, 0.0);
            for step in 0..3000 {
                if step % 80 == 0 {
                    wish = demand(rng.gaussian() + 0.5, 2.0 * rng.gaussian());
                }
                let ruling = guard.step(&mut state, &wish, &input(&vehicle), &[wall], DT);
                vehicle.follow(&ruling.setpoint);
                let at = vehicle.position;
                let (clearance_m, inside_m) = (wall.clearance_m(at), 9.5 - at.norm());
                assert!(
                    clearance_m > 0.02 && inside_m > -0.02,
                    "{a_max_mps2}, {seed}: {clearance_m} {inside_m} {at:?}"
                );
            }
        }
    }
}

#[test]
fn the_altitude_stays_in_its_band() {
    for (held_m, lowest_m, highest_m, a_max_mps2) in [(-5.0, -3.0, -7.0, 2.0), (-5.0, -3.0, -7.0, 0.1)] {
        let guard = guard_of(&Config { a_max_mps2, ..Config::default() });
        for wish in [5.0, -5.0] {
            let (mut state, mut down_m, mut speed_mps) = (State::default(), held_m, 0.0_f32);
            for _ in 0..3000 {
                let demand = Demand { down_mps: wish, ..Demand::default() };
                let input = GuardInput { down_m: Some(down_m), held_down_m: Some(held_m), ..GuardInput::default() };
                let commanded = guard.step(&mut state, &demand, &input, &[], DT).setpoint.velocity_ned_mps.down;
                assert!((commanded - speed_mps).abs() <= 2.0 * DT * 1.001 && commanded.abs() <= 0.5);
                speed_mps = commanded;
                down_m += speed_mps * DT;
                assert!(down_m <= lowest_m + 0.01 && down_m >= highest_m - 0.01, "{held_m}: {down_m}");
            }
            let end_m = if wish > 0.0 { lowest_m } else { highest_m };
            assert!((down_m - end_m).abs() < 0.1, "{held_m}: {down_m}");
        }
    }
}

#[test]
fn an_acceleration_builds_up_no_faster_than_the_jerk_limit_but_a_brake_is_at_once() {
    let config = Config::default();
    let guard = guard_of(&config);
    let mut rng = Rng::new(3, 6);
    let (mut state, input) = (State::default(), GuardInput::default());
    let (mut last, mut change) = (Horizontal::default(), Horizontal::default());
    let mut grew = 0;
    let mut wish = demand(0.0, 0.0);
    for step in 0..5000 {
        if step % 40 == 0 {
            wish = demand(rng.gaussian(), rng.gaussian());
        }
        let velocity = guard.step(&mut state, &wish, &input, &[], DT).setpoint.velocity_ned_mps.horizontal();
        let now = velocity.minus(last);
        if velocity.norm() > last.norm() + 1e-6 && wish.velocity_ned_mps.norm() > last.norm() {
            let built_up = now.norm() - change.norm();
            assert!(built_up <= config.jerk_max_mps3 * DT * DT * 1.001 + 1e-6, "{built_up}");
            grew += 1;
        }
        (last, change) = (velocity, now);
    }
    assert!(grew > 500, "{grew}");

    let mut state = State::default();
    for _ in 0..100 {
        guard.step(&mut state, &demand(1.0, 0.0), &input, &[], DT);
    }
    guard.step(&mut state, &demand(0.0, 0.0), &input, &[], DT);
    assert!((state.command_ned_mps().north - (1.0 - 2.0 * DT)).abs() < 1e-5, "{:?}", state.command_ned_mps());
}

#[test]
fn the_nearest_allowed_velocity_is_allowed_and_none_is_nearer() {
    let mut rng = Rng::new(9, 7);
    let (mut found, mut none) = (0, 0);
    for _ in 0..2000 {
        let half_spaces: Vec<_> = (0..1 + (6.0 * rng.uniform()) as usize)
            .map(|_| HalfSpace {
                outwards: Horizontal::from_bearing(core::f32::consts::TAU * rng.uniform()),
                least_mps: 0.4 * rng.gaussian() - 0.1,
                oncoming_mps: 0.0,
            })
            .collect();
        let wanted = at(rng.gaussian(), rng.gaussian());
        let answer = nearest_allowed(wanted, &half_spaces);
        let keeps = |v: Horizontal, by: f32| half_spaces.iter().all(|h| h.outwards.dot(v) >= h.least_mps + by);
        let allowed: Vec<_> =
            (0..400).map(|_| at(2.0 * rng.gaussian(), 2.0 * rng.gaussian())).filter(|v| keeps(*v, 1e-3)).collect();
        match answer {
            Some(velocity) => {
                assert!(keeps(velocity, -2e-3), "{velocity:?} {half_spaces:?}");
                let distance = velocity.minus(wanted).norm();
                assert!(allowed.iter().all(|v| v.minus(wanted).norm() > distance - 2e-3), "{half_spaces:?}");
                found += 1;
            }
            None => {
                assert!(allowed.is_empty(), "{half_spaces:?}");
                none += 1;
            }
        }
    }
    assert!(found > 500 && none > 50, "{found} {none}");
}

#[test]
fn half_spaces_that_do_not_agree_brake_and_are_counted() {
    let guard = guard_of(&Config::default());
    let mut state = State::default();
    let jaw = |north: f32| Neighbour {
        center_ned_m: at(north, 0.0),
        reach_m: 0.45,
        velocity_ned_mps: at(-0.5 * north.signum(), 0.0),
    };
    let jaws = [jaw(0.5), jaw(-0.5)];
    let ruling = guard.step(&mut state, &demand(0.0, 0.0), &GuardInput::default(), &jaws, DT);
    assert_eq!((ruling.action, state.counts().not_converged), (Action::Braked, 1));
    state.release(None);
    let ruling = guard.step(&mut state, &demand(1.0, 0.0), &GuardInput::default(), &[], DT);
    let counts = state.counts();
    assert_eq!(ruling.action, Action::Passed);
    assert_eq!((counts.passed, counts.braked), (1, 1));
}
