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
/// Distance classes: this many rings around the vehicle up to there, and one for everything farther.
pub(super) const FAR: u8 = 64;

/// The additional distance from a tracked body, in standard deviations of its position.
const DOUBT_SIGMAS: f32 = 2.0;

/// Lists the obstacles up to `near_m` from the vehicle: the nearest, if the list is full; standing before moving ones.
#[inline(never)]
pub(super) fn gather(
    guard: &Guard,
    near_m: f32,
    map: &Map,
    place: Horizontal,
    near: &mut Vec<Neighbour, OBSTACLES_MAX>,
) {
    let rings_per_m = f32::from(FAR) / near_m;
    let mut rings = [FAR; CIRCLES_MAX];
    let mut counts = [0_u8; FAR as usize];
    for (circle, ring) in map.circles().zip(&mut rings) {
        let reach_m = guard.obstacle(&circle).reach_m;
        let limit = reach_m + near_m;
        let squared = circle.center_ned_m.minus(place).norm_squared();
        if squared < limit * limit {
            // Negative, and so the first, if it is too close.
            let clearance_m = squared * inverse_root(squared) - reach_m;
            *ring = ((clearance_m * rings_per_m) as u8).min(FAR - 1);
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

/// The tracked bodies that move, as obstacles enlarged by the uncertainty of their position.
#[inline(never)]
pub(super) fn followed(guard: &Guard, tracks: &Tracks, bodies: &mut Vec<Neighbour, TRACKS_MAX>) {
    for track in tracks.all().iter().filter(|track| track.moves()) {
        let radius_m = RADIUS_M + DOUBT_SIGMAS * sqrt(track.covariance[0]);
        let (center_ned_m, velocity_ned_mps) = (track.center_ned_m, track.velocity_ned_mps);
        // Cannot fail: there is space for all of them.
        let _ = bodies.push(guard.obstacle(&Circle { center_ned_m, radius_m, velocity_ned_mps }));
    }
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
