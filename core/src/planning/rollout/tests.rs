//! Tests of the trajectories and of their cost.

use super::*;
use crate::base::rng::Rng;
use crate::planning::field::Gains;
use std::vec::Vec as StdVec;

#[test]
fn without_obstacles_it_goes_straight_to_the_target() {
    let (start, target) = (Horizontal::default(), Horizontal { north: 2.0, east: 0.0 });
    let gains = Gains { k_att: 1.0, k_rep: 0.2, influence_m: 0.8, swirl: 0.0 };
    let trajectory = roll_plainly(&Field { gains }, Waypoint, start, target, &[]);
    assert!(trajectory[14].minus(target).norm() < 1e-5);
    let cost = cost(start, &trajectory, target, &[]);
    assert!((cost.total() - 2.0).abs() < 1e-4, "{cost:?}");
    assert_eq!(swept_clearance_m(start, &trajectory, &[]), f32::INFINITY);
}

#[test]
fn the_cost_of_a_known_staircase_is_what_the_paper_says() {
    let start = Horizontal::default();
    // One metre north, one metre east, then standing still.
    let mut trajectory = [Horizontal { north: 1.0, east: 1.0 }; WAYPOINTS];
    trajectory[0] = Horizontal { north: 1.0, east: 0.0 };
    let target = Horizontal { north: 1.0, east: 3.0 };
    let obstacle = Obstacle { center_ned_m: Horizontal { north: 0.0, east: 1.0 }, reach_m: 0.5 };
    let cost = cost(start, &trajectory, target, &[obstacle]);
    assert!((cost.length - 2.0).abs() < 5e-6 && (cost.error - 2.0).abs() < 1e-6);
    assert!((cost.turns - core::f32::consts::FRAC_PI_2).abs() < 1e-5);
    assert!((cost.proximity - 2.0).abs() < 1e-5, "{cost:?}");
    // Between the waypoints (1,0) and (1,1) the obstacle is 0.5 m away, from the start to (1,0) 0.5 m as well.
    assert!((swept_clearance_m(start, &trajectory, &[obstacle]) - 0.5).abs() < 1e-5);
}

#[test]
fn a_segment_that_jumps_over_a_pillar_is_seen() {
    let start = Horizontal::default();
    let trajectory = [Horizontal { north: 2.0, east: 0.0 }];
    let pillar = Obstacle { center_ned_m: Horizontal { north: 1.0, east: 0.05 }, reach_m: 0.2 };
    assert!((swept_clearance_m(start, &trajectory, &[pillar]) + 0.15).abs() < 1e-5);
}

/// Sixty-four circles of a given density per square metre, and gains like the planner's.
fn forest(seed: u64, density: f32) -> (StdVec<Obstacle>, Gains, Horizontal) {
    let mut rng = Rng::new(seed, 5);
    let side_m = 8.0 / libm::sqrtf(density);
    let obstacles = (0..64)
        .map(|_| Obstacle {
            center_ned_m: Horizontal { north: side_m * (rng.uniform() - 0.5), east: side_m * (rng.uniform() - 0.5) },
            reach_m: 0.25 + 0.23 * rng.uniform(),
        })
        .collect();
    let above = |value: f32, least: f32| if value > least { value } else { least };
    let gains = Gains {
        k_att: above(1.0 + 0.3 * rng.gaussian(), 0.05),
        k_rep: above(0.1 + 0.1 * rng.gaussian(), 0.005),
        influence_m: above(0.8 + 0.3 * rng.gaussian(), 0.05),
        swirl: 3.0 * rng.gaussian(),
    };
    (obstacles, gains, Horizontal::from_bearing(3.0 * rng.uniform()).times(2.5 * rng.uniform()))
}

#[test]
fn the_default_reading_is_what_libm_in_f64_makes_of_the_equations() {
    let mut scene = Scene::new();
    let mut apart = 0;
    for seed in 0..1000 {
        let (obstacles, gains, target) = forest(seed, 1.0);
        let field = Field { gains };
        scene.gather(Horizontal::default(), obstacles.iter().copied());
        let (trajectory, price) = scene.roll(&field, target);
        let (exact, total) = in_double(&gains, target, &obstacles);
        let gap = trajectory
            .iter()
            .zip(&exact)
            .map(|(a, b)| (f64::from(a.north) - b.0).hypot(f64::from(a.east) - b.1))
            .fold(0.0, f64::max);
        // Where a trajectory jumps from side to side, rounding errors grow with every jump.
        apart += i32::from(gap > 1e-3 || (f64::from(price.total()) / total - 1.0).abs() > 1e-3);
    }
    assert!(apart <= 10, "{apart} of 1000 differ");
}

/// Eq. 33, 36 and 41-45 in f64.
fn in_double(gains: &Gains, target: Horizontal, obstacles: &[Obstacle]) -> (StdVec<(f64, f64)>, f64) {
    let (spacing, target) = (f64::from(SPACING_M), (f64::from(target.north), f64::from(target.east)));
    let swirl = f64::from(gains.swirl);
    let relative = |q: (f64, f64), o: &Obstacle| {
        let away = (q.0 - f64::from(o.center_ned_m.north), q.1 - f64::from(o.center_ned_m.east));
        (away, away.0.hypot(away.1) - f64::from(o.reach_m))
    };
    let mut q = (0.0_f64, 0.0_f64);
    let mut points = StdVec::new();
    for _ in 0..WAYPOINTS {
        let left = (target.0 - q.0, target.1 - q.1);
        let mut force = (left.0 * f64::from(gains.k_att), left.1 * f64::from(gains.k_att));
        for o in obstacles {
            let (away, d) = relative(q, o);
            if d < f64::from(gains.influence_m) {
                let push = f64::from(gains.k_rep) / d.max(0.01) / away.0.hypot(away.1);
                force.0 += push * (away.0 - swirl * away.1);
                force.1 += push * (away.1 + swirl * away.0);
            }
        }
        let norm = force.0.hypot(force.1);
        if left.0.hypot(left.1) <= spacing {
            q = target;
        } else if norm > 1e-6 {
            q = (q.0 + spacing * force.0 / norm, q.1 + spacing * force.1 / norm);
        }
        points.push(q);
    }
    let mut total = (q.0 - target.0).hypot(q.1 - target.1);
    let (mut previous, mut heading, mut closest) = ((0.0, 0.0), None::<f64>, f64::INFINITY);
    for point in &points {
        let step = (point.0 - previous.0, point.1 - previous.1);
        total += step.0.hypot(step.1);
        if step.0.hypot(step.1) > 1e-4 {
            let bearing = step.1.atan2(step.0);
            if let Some(heading) = heading {
                let turn = (bearing - heading).abs();
                total += turn.min(std::f64::consts::TAU - turn);
            }
            heading = Some(bearing);
        }
        previous = *point;
        closest = obstacles.iter().map(|o| relative(*point, o).1).fold(closest, f64::min);
    }
    (points, total + 1.0 / closest.max(0.01))
}

#[test]
fn the_margin_check_agrees_with_the_swept_clearance_of_each_obstacle() {
    let mut scene = Scene::new();
    let (mut kept, mut lost, mut inside) = (0, 0, 0);
    for seed in 0..2000 {
        let (obstacles, gains, target) = forest(seed, [1.0, 0.4, 0.1][(seed % 3) as usize]);
        let start = Horizontal::default();
        scene.gather(start, obstacles.iter().copied());
        let trajectory = roll_plainly(&Field { gains }, Waypoint, start, target, &obstacles);
        let checked = &trajectory[..6];
        // The clearance of each obstacle less the required one.
        let spare = |o: &Obstacle| {
            let at_start = o.clearance_m(start) - 1e-3;
            swept_clearance_m(start, checked, core::slice::from_ref(o)) - if at_start < 0.05 { at_start } else { 0.05 }
        };
        let least = obstacles.iter().map(spare).fold(f32::INFINITY, f32::min);
        if least.abs() > 1e-5 {
            assert_eq!(scene.keeps_margin(checked, 0.05), least >= 0.0, "seed {seed}: {least}");
            kept += i32::from(least >= 0.0);
            lost += i32::from(least < 0.0);
            inside += i32::from(obstacles.iter().any(|o| o.clearance_m(start) < 0.0) && least >= 0.0);
        }
    }
    assert!(kept > 300 && lost > 200 && inside > 20, "{kept} {lost} {inside}");
}

#[test]
fn the_turn_between_two_directions_is_their_angle() {
    for i in 0..200_u16 {
        for j in 0..200_u16 {
            let angle = |k: u16| core::f32::consts::TAU * (f32::from(k) / 200.0 - 0.5);
            let turn = turn_rad(Horizontal::from_bearing(angle(i)), Horizontal::from_bearing(angle(j)));
            let steps = f32::from(i.abs_diff(j).min(200 - i.abs_diff(j)));
            let limit = 1e-5;
            assert!((turn - core::f32::consts::TAU * steps / 200.0).abs() < limit, "{i} {j}: {turn}");
        }
    }
}
