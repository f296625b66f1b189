//! The start of a solve, and the check of its result.

use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::units::sin_cos;

use super::clearance::{NEAREST, Near};
use super::solver::Search;
use super::{Guess, Problem, Step};

/// Share of the bound that the initial controls may use.
const TAKEN: f32 = 0.95;

impl<const L: usize> Search<'_, L> {
    /// Rolls out the guess.
    pub(super) fn begin<const M: usize>(
        &self,
        path: &mut [Step<M>],
        first: &[f32; M],
        problem: &Problem<'_, M>,
        near: &mut [Near],
    ) {
        let along = problem.goal_ned_m.minus(problem.start_ned_m);
        let length_m = along.norm();
        let forward = if length_m > 1e-6 { along.times(1.0 / length_m) } else { Horizontal { north: 1.0, east: 0.0 } };
        let right = Horizontal { north: -forward.east, east: forward.north };
        let (count, steps) = (path.len() as f32, self.planner.config.u_max_m * TAKEN * path.len() as f32);
        let reach_m = if length_m > steps { steps } else { length_m };
        let mut place = problem.start_ned_m;
        let mut covariance = *first;
        for (index, step) in path.iter_mut().enumerate() {
            let wanted = match problem.guess {
                Guess::Bow(swing_m) => {
                    let share = (index + 1) as f32 / count;
                    let (sine, _) = sin_cos(core::f32::consts::PI * share);
                    problem.start_ned_m.plus(forward.times(share * reach_m)).plus(right.times(swing_m * sine))
                }
                Guess::Path(path) => path.get(index).or(path.last()).copied().unwrap_or(place),
            };
            let u = wanted.minus(place);
            let control =
                self.planner.bounded([u.north, u.east].map(|u| if u.is_finite() { u } else { 0.0 }), [0.0; 2]);
            place = Horizontal { north: place.north + control[0], east: place.east + control[1] };
            covariance = self.sensor.update(&covariance, [place.north, place.east]);
            *step = Step { place_ned_m: place, control_m: control, covariance_m2: covariance, rooms_m: [0.0; NEAREST] };
        }
        near.fill(Near::NONE);
    }

    /// Searches the obstacles around those steps that have moved far, at most `most` steps per call, and keeps the
    /// duals of obstacles already known. The remaining steps cannot move much farther until their turn.
    pub(super) fn look<const M: usize>(
        &self,
        path: &mut [Step<M>],
        near: &mut [Near],
        duals: &mut [[f32; NEAREST]],
        most: usize,
    ) {
        let (mut looks, mut before) = (0, None);
        let half_step_m2 = self.planner.half_step_m2;
        for ((step, near), duals) in path.iter_mut().zip(near).zip(duals) {
            let place = [step.place_ned_m.north, step.place_ned_m.east];
            if near.holds(place, 0.6) {
                continue;
            }
            looks += 1;
            if looks > most {
                break;
            }
            let known = if near.is_known() { Some(&*near) } else { before.as_ref() };
            let found = Near::look(self.obstacles, place, half_step_m2, 0.5 * self.planner.config.u_max_m, known);
            let (width, _) = self.width(&step.covariance_m2);
            let old = *duals;
            for (number, (dual, kept)) in duals.iter_mut().zip(&mut step.rooms_m).enumerate() {
                let Some((room, _)) = found.room(number, self.obstacles, place) else { break };
                *kept = room - width;
                let central = self.mu / if *kept > self.delta_m { *kept } else { self.delta_m };
                let known = near.find(&found, number).and_then(|index| old.get(index));
                *dual = known.copied().filter(|dual| *dual > 0.0).unwrap_or(central);
            }
            *near = found;
            before = Some(found);
        }
    }

    /// Initial duals of the controls' bounds.
    pub(super) fn begin_bounds<const M: usize>(&self, path: &[Step<M>], bounds: &mut [[f32; 2]]) {
        for (step, bounds) in path.iter().zip(bounds) {
            *bounds = self.planner.rooms(step.control_m).map(|room| self.mu / room);
        }
    }

    /// Smallest slack to an obstacle anywhere on the path, also between the steps.
    pub(super) fn clearance_m<const M: usize>(&self, path: &[Step<M>]) -> f32 {
        let mut clearance_m = 1e9;
        let mut before = Horizontal { north: self.start[0], east: self.start[1] };
        for step in path {
            let (width, _) = self.width(&step.covariance_m2);
            let stride_m = sqrt(4.0 * self.planner.half_step_m2);
            for obstacle in self.obstacles {
                // Most are too far to matter.
                let reach_m = obstacle.reach_m + width + clearance_m + stride_m;
                if step.place_ned_m.minus(obstacle.center_ned_m).norm_squared() > reach_m * reach_m {
                    continue;
                }
                let distance_m = Horizontal::distance_to_segment(obstacle.center_ned_m, before, step.place_ned_m);
                let room_m = distance_m - obstacle.reach_m - width;
                if room_m < clearance_m {
                    clearance_m = room_m;
                }
            }
            before = step.place_ned_m;
        }
        clearance_m
    }
}
