//! Where a command leads: whether that path is clear of every circle and inside the fence, and whether the sensor has
//! seen it.

use super::{Guard, GuardInput};
use crate::base::ned::Horizontal;
use crate::base::obstacle::Neighbour;
use crate::base::units::sin_cos;
use crate::mapping::coverage::{Cover, Coverage};

/// Time for which the straight line from the vehicle to where the command leads must be clear.
const CORNER_S: f32 = 0.2;
/// At a lower speed the path need not have been seen.
const CREEP_MPS: f32 = 0.001;
/// Half a path shorter than this is not checked by itself: the coverage of a place is valid for 7 cm around it.
const SHORT_M: f32 = 0.06;

/// Only this much of the margin around a known obstacle counts as known.
const BESIDE_KNOWN_M: f32 = 0.05;
/// Cosine and sine of the directions, off the direction of travel to either side, in which the hull's front approaches an obstacle: up to
/// 75 degrees. At 90 degrees it would pass it. Small hulls need every fourth of them, or every second.
const FRONT: [(f32, f32); 17] = [
    (1.0, 0.0),
    (0.996_655, 0.081_721),
    (0.986_643, 0.162_895),
    (0.970_031, 0.242_980),
    (0.946_930, 0.321_439),
    (0.917_494, 0.397_748),
    (0.881_921, 0.471_397),
    (0.840_448, 0.541_892),
    (0.793_353, 0.608_761),
    (0.740_951, 0.671_559),
    (0.683_592, 0.729_864),
    (0.621_661, 0.783_287),
    (0.555_570, 0.831_470),
    (0.485_763, 0.874_090),
    (0.412_707, 0.910_864),
    (0.336_890, 0.941_544),
    (0.258_819, 0.965_926),
];
/// Up to this reach places in every fourth direction are 7.4 cm apart at most, about as far as their coverage is valid.
const SMALL_M: f32 = 0.226;

/// The coverage of the path that a command leads along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PathCover {
    Seen,
    Hidden,
    /// Not seen, with the direction of the place to see first.
    Unseen(Horizontal),
}

impl Guard {
    /// The point that a command leads to before it is braked, at least a little ahead.
    fn ahead(&self, velocity: Horizontal, rest: Horizontal) -> (Horizontal, f32) {
        let brake_s = 0.5 * velocity.norm() / self.config.a_max_mps2;
        let ahead_s = if brake_s > CORNER_S { brake_s } else { CORNER_S };
        (rest.plus(velocity.times(ahead_s)), ahead_s)
    }

    /// Whether a command keeps the vehicle out of every circle: on the path to its rest point, from there until the
    /// command is braked, and on the straight line to where it leads next. A vehicle that already touches a circle
    /// may move if it does not go deeper.
    pub(super) fn is_clear(&self, velocity: Horizontal, input: &GuardInput, near: &[Neighbour]) -> bool {
        let (position, rest) = (input.position_ned_m, input.rest_ned_m);
        let (ahead, ahead_s) = self.ahead(velocity, rest);
        let (underway_m, ahead_m) = (position.minus(rest).norm(), ahead.minus(rest).norm());
        let spread_m = self.config.margin_m + if underway_m > ahead_m { underway_m } else { ahead_m };
        near.iter().all(|obstacle| {
            let center = obstacle.center_ned_m;
            let far_m = obstacle.reach_m + spread_m;
            let is_still = obstacle.velocity_ned_mps == Horizontal::default();
            if is_still && center.minus(rest).norm_squared() > far_m * far_m {
                return true;
            }
            let least = |distance: f32, other: f32| if distance < other { distance } else { other };
            let on_way = least(
                Horizontal::distance_to_segment(center, rest, ahead),
                Horizontal::distance_to_segment(center, position, ahead),
            ) - obstacle.reach_m;
            if on_way >= 0.5 * self.config.margin_m && is_still {
                return true;
            }
            // The path to the rest point cannot be changed any more, so it is no reason to refuse a command that
            // leads away.
            let at_rest = Horizontal::distance_to_segment(center, position, rest) - obstacle.reach_m;
            let later = center.plus(obstacle.velocity_ned_mps.times(input.delay_s + ahead_s));
            let later_ahead = ahead.minus(later).norm() - obstacle.reach_m;
            let later_at_rest = rest.minus(later).norm() - obstacle.reach_m;
            on_way >= least(0.5 * self.config.margin_m, at_rest - 1e-3)
                && later_ahead >= least(0.5 * self.config.margin_m, later_at_rest - 1e-3)
        })
    }

    /// Whether a command leads to a place inside the fence's margin, or at least not farther out.
    pub(super) fn stays_inside(&self, velocity: Horizontal, input: &GuardInput) -> bool {
        let (ahead, _) = self.ahead(velocity, input.rest_ned_m);
        let depth_m = |place| self.config.fence.inside(place).map_or(f32::INFINITY, |(_, depth_m)| depth_m);
        let then_m = depth_m(ahead);
        then_m >= self.config.fence.margin_m || then_m >= depth_m(input.rest_ned_m) - 1e-4
    }

    /// Which part of the path, of the places where an obstacle would touch the hull, has been seen.
    pub(super) fn path_coverage(
        &self,
        coverage: &Coverage,
        velocity: Horizontal,
        input: &GuardInput,
        near: &[Neighbour],
    ) -> PathCover {
        let speed = velocity.norm();
        if speed < CREEP_MPS {
            return PathCover::Seen;
        }
        let (radius_m, smallest_m) = (self.vehicle.radius_m, self.surveyor.smallest_obstacle_m());
        let reach_m = radius_m + smallest_m;
        let along = velocity.times(1.0 / speed);
        let right = Horizontal { north: -along.east, east: along.north };
        let (ahead, _) = self.ahead(velocity, input.rest_ned_m);
        let middle = ahead.plus(input.rest_ned_m).times(0.5);
        // The end of a short path covers its middle.
        let is_short = ahead.minus(middle).norm_squared() < SHORT_M * SHORT_M;
        let (nose_east, nose_north) = sin_cos(input.yaw_rad);
        let nose = Horizontal { north: nose_north, east: nose_east };

        let stride = if reach_m < SMALL_M {
            4
        } else if reach_m < 2.0 * SMALL_M {
            2
        } else {
            1
        };
        let mut covered = PathCover::Seen;
        let mut nearest_the_nose = f32::NEG_INFINITY;
        for station in [middle, ahead].into_iter().skip(usize::from(is_short)) {
            for (number, (cosine, sine)) in FRONT.iter().step_by(stride).flat_map(|at| [(0, at), (1, at)]).skip(1) {
                let aside_m = reach_m * if number == 0 { *sine } else { -*sine };
                let place = station.plus(along.times(reach_m * cosine)).plus(right.times(aside_m));
                if self.surveyor.is_at_home(coverage, place, radius_m) {
                    continue;
                }
                let cover = self.surveyor.cover(coverage, place);
                // An unseen obstacle there would lie inside a known one, except for the margin around it. In a wide margin
                // the vehicle itself may be.
                let is_known = |obstacle: &Neighbour| {
                    let limit_m = obstacle.reach_m - reach_m + self.config.margin_m.min(BESIDE_KNOWN_M);
                    limit_m > 0.0 && obstacle.center_ned_m.minus(place).norm_squared() < limit_m * limit_m
                };
                if cover == Cover::Seen || near.iter().any(is_known) {
                    continue;
                }
                // A place that was hidden from elsewhere can be seen by now, unless something known stands before it.
                let is_before = |obstacle: &Neighbour| {
                    let place_m = Horizontal::distance_to_segment(obstacle.center_ned_m, input.position_ned_m, place);
                    place_m < obstacle.reach_m - radius_m
                };
                if cover == Cover::Hidden || cover == Cover::WasHidden && near.iter().any(is_before) {
                    if covered == PathCover::Seen {
                        covered = PathCover::Hidden;
                    }
                    continue;
                }
                let direction = place.minus(input.position_ned_m);
                let off_nose = nose.dot(direction) / direction.norm();
                if off_nose > nearest_the_nose {
                    nearest_the_nose = off_nose;
                    covered = PathCover::Unseen(direction);
                }
            }
        }
        covered
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::config::{RangeSensor, Vehicle};
    use crate::base::pose::Pose;
    use crate::base::time::Instant;
    use crate::control::guard::{Config, Demand, State};
    use crate::mapping::scan::{SECTORS_MAX, Scan, Sector};

    const DT_S: f32 = 0.02;

    /// A scan of the default sensor that sees nothing.
    fn clear_scan() -> Scan {
        let fov_rad = RangeSensor::DEFAULT.fov_rad;
        let step_rad = fov_rad / SECTORS_MAX as f32;
        Scan {
            time: Instant(0),
            turn_s: 0.0,
            first_azimuth_rad: 0.5 * (step_rad - fov_rad),
            step_rad,
            range_max_m: 3.0,
            rays: [Sector::Clear; SECTORS_MAX].into_iter().collect(),
        }
    }

    #[test]
    fn beside_something_known_it_does_not_fly_backwards_unseen_however_large_the_margin() {
        for margin_m in [0.03, 0.3, 1.0, 2.0, 5.0] {
            let guard =
                Config { margin_m, ..Config::default() }.build(&Vehicle::DEFAULT, &RangeSensor::DEFAULT).unwrap();
            let mut state = State::default();
            guard.note_scan(&mut state, &clear_scan(), &Pose::default(), false);
            let pillar =
                Neighbour { center_ned_m: Horizontal { north: 0.9, east: 0.0 }, reach_m: 0.3, ..Neighbour::default() };
            let mut at = Horizontal::default();
            let backwards = Demand { velocity_ned_mps: Horizontal { north: -1.0, east: 0.0 }, ..Demand::default() };
            for _ in 0..300 {
                let input = GuardInput { position_ned_m: at, rest_ned_m: at, ..GuardInput::default() };
                let out = guard.step(&mut state, &backwards, &input, &[pillar], DT_S);
                at = at.plus(out.setpoint.velocity_ned_mps.horizontal().times(DT_S));
            }
            assert!(at.north > -0.05, "{margin_m}: {at:?}");
        }
    }
}
