//! Tests of the path search.

use super::*;
use crate::base::config::Fence;
use crate::base::rng::Rng;
use std::boxed::Box;
use std::vec::Vec as StdVec;

fn pillar(north: f32, east: f32, reach_m: f32) -> Obstacle {
    Obstacle { center_ned_m: Horizontal { north, east }, reach_m }
}

fn march(start: Horizontal, obstacles: &[Obstacle]) -> Box<Window> {
    let mut window = Box::new(Window::new());
    super::march(&mut window, start, start, 1.0, 0.036, obstacles, &Fence::DEFAULT);
    assert_eq!(window.dropped(), 0);
    window
}

#[test]
fn in_the_open_the_arrival_is_the_distance_in_every_direction() {
    let start = Horizontal { north: 3.03, east: -7.08 };
    let window = march(start, &[]);
    let mut worst = 0.0_f32;
    for k in 0..720 {
        let place = start.plus(Horizontal::from_bearing(k as f32 * 0.0087).times(0.5 + 0.005 * k as f32));
        let error = window.arrival_m(place).unwrap() - place.minus(start).norm();
        // Half a cell's diagonal and some rounding, and the first-order scheme's error, which is largest around the
        // start.
        worst = worst.max(error.abs() - 0.08 - 0.04 * place.minus(start).norm());
    }
    assert!(worst <= 0.0, "{worst}");
}

#[test]
fn round_a_wall_the_arrival_is_the_way_round_it() {
    // A wall to the north, open at its eastern end.
    let wall: StdVec<_> = (0..30).map(|k| pillar(1.0, 1.0 - 0.2 * k as f32, 0.2)).collect();
    let window = march(Horizontal::default(), &wall);
    let corner = Horizontal { north: 1.0, east: 1.25 };
    let behind = Horizontal { north: 2.0, east: 0.0 };
    // Two tangents and an arc of the last disc and its rim; the raster and the scheme make it a little longer.
    let (tangent, angle) = (1.392, 1.927);
    let expected = tangent + 0.25 * angle + tangent;
    let arrival = window.arrival_m(behind).unwrap();
    assert!(arrival > expected - 0.1 && arrival < 1.1 * expected, "{arrival} for {expected}");
    let route = window.route(behind);
    assert!(route.iter().all(|p| wall.iter().all(|o| o.clearance_m(*p) >= 0.009)), "{route:?}");
    assert!(route.iter().any(|p| p.minus(corner).norm() < 0.25), "{route:?}");
    assert!(route[0].norm() < 0.15 && route.last().unwrap().minus(behind).norm() < 0.1);
}

#[test]
fn a_gap_twelve_centimetres_wide_is_found_wherever_it_lies() {
    for shift in 0..20 {
        let (gap, reach) = (0.013 * shift as f32, 0.3);
        let mut wall: StdVec<_> = (0..12).map(|k| pillar(1.0, gap + 0.36 + 0.4 * k as f32, reach)).collect();
        wall.extend((0..12).map(|k| pillar(1.0, gap - 0.36 - 0.4 * k as f32, reach)));
        let window = march(Horizontal { north: 0.0, east: 0.4 }, &wall);
        let arrival = window.arrival_m(Horizontal { north: 2.0, east: 0.0 });
        assert!(arrival.is_some_and(|a| a < 5.0), "shift {shift}: {arrival:?}");
    }
}

#[test]
fn what_is_sealed_is_not_reached_and_the_nearest_place_is_outside_of_the_ring() {
    let ring: StdVec<_> = (0..16)
        .map(|k| {
            let place = Horizontal::from_bearing(core::f32::consts::TAU * k as f32 / 16.0);
            pillar(3.0 + place.north, place.east, 0.25)
        })
        .collect();
    let window = march(Horizontal::default(), &ring);
    let inside = Horizontal { north: 3.0, east: 0.0 };
    assert_eq!(window.arrival_m(inside), None);
    assert!(window.route(inside).is_empty());
    let nearest = window.nearest_reached(inside).unwrap();
    assert!((nearest.minus(inside).norm() - 1.26).abs() < 0.15, "{nearest:?}");
}

#[test]
fn from_inside_an_obstacle_there_is_a_way_out() {
    let window = march(Horizontal::default(), &[pillar(0.0, 0.25, 0.3)]);
    assert!(window.arrival_m(Horizontal { north: 0.0, east: -1.0 }).is_some());
    assert_eq!(window.arrival_m(Horizontal { north: 0.0, east: 0.3 }), None);
}

#[test]
fn any_obstacles_and_any_start_end_in_a_bounded_march() {
    let mut rng = Rng::new(3, 0);
    let wild = [f32::NAN, f32::INFINITY, -1e30, 1e30, 0.0, -5.0];
    for _ in 0..40 {
        let mut number = || {
            let pick = (rng.uniform() * 60.0) as usize;
            wild.get(pick).copied().unwrap_or(4.0 * rng.gaussian())
        };
        let obstacles: StdVec<_> = (0..60).map(|_| pillar(number(), number(), number())).collect();
        let mut window = Box::new(Window::new());
        let (start, towards) =
            (Horizontal { north: number(), east: number() }, Horizontal { north: number(), east: number() });
        super::march(&mut window, start, towards, 1.0, 0.036, &obstacles, &Fence::DEFAULT);
        let exit = window.best_exit(towards);
        assert!(exit.is_none_or(|place| window.route(place).len() <= ROUTE_MAX));
    }
}

#[test]
fn what_lies_outside_of_the_fence_is_closed_and_nothing_else() {
    let mut rng = Rng::new(5, 0);
    let mut window = Box::new(Window::new());
    for _ in 0..50 {
        let mut place = || Horizontal { north: 8.0 * rng.gaussian(), east: 8.0 * rng.gaussian() };
        let (start, towards, center_ned_m) = (place(), place(), place());
        let radius_m = center_ned_m.minus(start).norm() + 1.0 + 4.0 * rng.uniform();
        let fence = Fence { center_ned_m, radius_m, margin_m: 0.5 };
        super::march(&mut window, start, towards, 1.0, 0.036, &[], &fence);
        for cell in (1..SIDE - 1).flat_map(|row| row * SIDE + 1..row * SIDE + SIDE - 1) {
            let outside_m = window.place_of(cell).minus(center_ned_m).norm() - fence.reach_m(start);
            if outside_m.abs() > 1e-4 {
                assert_eq!(window.arrival(cell) == CLOSED, outside_m > 0.0, "{cell}: {outside_m} m, {fence:?}");
            }
        }
    }
}

#[test]
fn no_route_leads_through_a_gap_that_is_too_narrow() {
    let (mut rng, mut routes) = (Rng::new(3, 3), 0);
    for case in 0..400 {
        // A row of pillars that leave no gap or next to none, and a place in the mouth of a gap on the other side.
        let along = Horizontal::from_bearing(core::f32::consts::TAU * rng.uniform() - core::f32::consts::PI);
        let across = Horizontal { north: -along.east, east: along.north };
        let reach_m = 0.2 + 0.15 * rng.uniform();
        let pitch_m = 2.0 * reach_m - 0.06 + 0.09 * rng.uniform();
        let middle = Horizontal { north: rng.uniform(), east: rng.uniform() };
        let half = (2.4 / pitch_m) as i32;
        let post = |number: i32| middle.plus(along.times((number as f32 + 0.5) * pitch_m));
        let row: StdVec<_> =
            (-half..=half).map(|number| pillar(post(number).north, post(number).east, reach_m)).collect();
        let gap = (half as f32 * (rng.uniform() - 0.5)) as i32;
        let aim = middle.plus(along.times(gap as f32 * pitch_m)).plus(across.times(0.06 + 0.25 * rng.uniform()));
        let route = march(middle.minus(across.times(0.9)), &row).route(aim);
        routes += usize::from(route.len() > 1);
        for step in route.windows(2) {
            let [before_m, after_m] = [step[0], step[1]].map(|place| place.minus(middle).dot(across));
            let passes = before_m < 0.0 && after_m >= 0.0;
            let is_inside = step[1].minus(middle).dot(along).abs() < (half as f32 - 0.5) * pitch_m;
            assert!(!(passes && is_inside), "{case}: {step:?}");
        }
    }
    assert!(routes > 300, "{routes}");
}

#[test]
fn out_of_a_corner_that_is_too_close_the_wave_leaves_on_the_free_side() {
    let window = march(Horizontal::default(), &[pillar(0.25, 0.0, 0.3), pillar(0.0, 0.25, 0.3)]);
    assert!(window.arrival_m(Horizontal { north: -1.0, east: -1.0 }).is_some());
}
