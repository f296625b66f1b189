//! The obstacles near the vehicle, and whether one blocks the plan. These are separate functions that do not depend
//! on the length of a frame, so that they are compiled with this crate: for speed, while the rest of an image is
//! compiled for size.

use heapless::Vec;

use super::OBSTACLES_MAX;
use crate::base::math::{inverse_root, sqrt};
use crate::base::ned::Horizontal;
use crate::base::obstacle::{Circle, Neighbour};
use crate::control::guard::Guard;
use crate::mapping::map::{CIRCLES_MAX, Map};
use crate::mapping::tracks::{RADIUS_M, TRACKS_MAX, Tracks};
use crate::planning::rollout::swept_clearance_m;

/// Obstacles farther than this from the vehicle's boundary are ignored by the fast loop, unless it needs more to stop.
pub(super) const NEAR_M: f32 = 4.0;
/// Distance classes: this many rings around the vehicle up to there, the nearest the finest, and one for everything farther.
pub(super) const FAR: u8 = 64;

/// Somebody who was seen so lately is in view.
const IN_VIEW_S: f32 = 0.8;
/// The additional distance from a tracked body, in standard deviations of its position.
const DOUBT_SIGMAS: f32 = 2.0;

/// Lists the obstacles that are near the vehicle, which needs `stop_m` to stop: the nearest, if the list is full; standing before
/// moving ones.
#[inline(never)]
pub(super) fn gather(
    guard: &Guard,
    stop_m: f32,
    map: &Map,
    place: Horizontal,
    near: &mut Vec<Neighbour, OBSTACLES_MAX>,
) {
    let near_m = if stop_m > NEAR_M { stop_m } else { NEAR_M };
    // The square root of the distance, so that however far it takes to stop what is near is told apart.
    let rings_per_root_m = f32::from(FAR) * inverse_root(near_m);
    let mut rings = [FAR; CIRCLES_MAX];
    let mut counts = [0_u8; FAR as usize];
    for (circle, ring) in map.circles().zip(&mut rings) {
        let reach_m = guard.obstacle(&circle).reach_m;
        let limit = reach_m + near_m;
        let squared = circle.center_ned_m.minus(place).norm_squared();
        if squared < limit * limit {
            // The first, if it is too close: the root is not a number then.
            let clearance_m = squared * inverse_root(squared) - reach_m;
            *ring = ((sqrt(clearance_m) * rings_per_root_m) as u8).min(FAR - 1);
            if let Some(count) = counts.get_mut(usize::from(*ring)) {
                *count += 1;
            }
        }
    }
    // The rings that fit in whole, and the space that is left for the next one.
    let (mut whole, mut left) = (0, OBSTACLES_MAX as u8);
    while let Some(rest) = counts.get(usize::from(whole)).and_then(|count| left.checked_sub(*count)) {
        (whole, left) = (whole + 1, rest);
    }
    near.clear();
    let mut standing = 0;
    for (circle, ring) in map.circles().zip(rings) {
        if ring < whole || (ring == whole && ring < FAR && left > 0) {
            left -= u8::from(ring == whole);
            let mut one = guard.obstacle(&circle);
            if one.velocity_ned_mps == Horizontal::default() {
                // Takes the place of the first moving one, which goes to the end.
                if let Some(first) = near.get_mut(standing) {
                    one = core::mem::replace(first, one);
                }
                standing += 1;
            }
            // Cannot fail: this many places were allotted.
            let _ = near.push(one);
        }
    }
}

/// The standing and the moving obstacles.
pub(super) fn told_apart(near: &[Neighbour]) -> (&[Neighbour], &[Neighbour]) {
    near.split_at(near.partition_point(|neighbour| neighbour.velocity_ned_mps == Horizontal::default()))
}

/// The tracked bodies that move, as obstacles enlarged by the uncertainty of their position; returns whether one of them is in view.
#[inline(never)]
pub(super) fn followed(guard: &Guard, tracks: &Tracks, bodies: &mut Vec<Neighbour, TRACKS_MAX>) -> bool {
    let mut is_in_view = false;
    for track in tracks.all().iter().filter(|track| track.moves()) {
        let radius_m = RADIUS_M + DOUBT_SIGMAS * sqrt(track.covariance[0]);
        let (center_ned_m, velocity_ned_mps) = (track.center_ned_m, track.velocity_ned_mps);
        // Cannot fail: there is space for all of them.
        let _ = bodies.push(guard.obstacle(&Circle { center_ned_m, radius_m, velocity_ned_mps }));
        is_in_view |= track.unseen_s < IN_VIEW_S;
    }
    is_in_view
}

/// Whether an obstacle is nearer to the path from the rest point along the next waypoints than to the rest point
/// itself, and nearer than the margin.
#[inline(never)]
pub(super) fn stands_in_the_way(
    near: &[Neighbour],
    rest_ned_m: Horizontal,
    next_ned_m: &[Horizontal],
    margin_m: f32,
) -> bool {
    // No waypoint is farther away, and no point between two of them.
    let squared_m2 = next_ned_m
        .iter()
        .map(|next| next.minus(rest_ned_m).norm_squared())
        .fold(0.0, |a: f32, b| if b > a { b } else { a });
    let far_m = squared_m2 * inverse_root(squared_m2 + 1e-6) + margin_m + 0.02;
    near.iter().any(|obstacle| {
        let limit_m = obstacle.reach_m + far_m;
        if obstacle.center_ned_m.minus(rest_ned_m).norm_squared() > limit_m * limit_m {
            return false;
        }
        let at_rest = obstacle.clearance_m(rest_ned_m) - 0.01;
        let least = if at_rest < margin_m { at_rest } else { margin_m };
        swept_clearance_m(rest_ned_m, next_ned_m, &[obstacle.standing()]) < least
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::config::{RangeSensor, Vehicle};
    use crate::base::time::Instant;
    use crate::control::guard;

    #[test]
    fn the_nearest_are_listed_however_far_it_takes_to_stop() {
        for (v_max_mps, a_max_mps2) in [(1.0, 2.0), (2.0, 0.1), (10.0, 0.5), (20.0, 2.0)] {
            let config = guard::Config { v_max_mps, a_max_mps2, ..guard::Config::default() };
            let guard = config.build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT).unwrap();
            let post = |turn: f32, away_m: f32| Circle {
                center_ned_m: Horizontal::from_bearing(turn).times(away_m),
                radius_m: 0.05,
                ..Circle::default()
            };
            // More than the list holds, and then one that is much nearer.
            let ring: Vec<Circle, OBSTACLES_MAX> = (0..OBSTACLES_MAX).map(|at| post(0.098 * at as f32, 1.2)).collect();
            let mut map = Map::default();
            map.observe_circles(Instant(1_000), Horizontal::default(), &ring).unwrap();
            map.observe_circles(Instant(21_000), Horizontal::default(), &[post(0.0, 0.3)]).unwrap();
            let mut near = Vec::new();
            gather(&guard, guard.stop_m(0.53), &map, Horizontal::default(), &mut near);
            let least_m = near.iter().map(|one| one.clearance_m(Horizontal::default())).fold(f32::INFINITY, f32::min);
            assert!(near.is_full() && least_m < 0.11, "{v_max_mps} {a_max_mps2}: {least_m}");
        }
    }
}
