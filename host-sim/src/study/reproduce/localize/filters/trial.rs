//! One run: a robot that moves at random, a source, the walls between them, and what the filters make of it.

use std::f64::consts::{PI, TAU};

use foxhound_core::localize::source::polar::State;
use foxhound_core::localize::source::{Sighting, Update};
use foxhound_core::mapping::walls;

use super::consistency::Consistency;
use crate::world::random::Random;
use crate::world::{Horizontal, wrap_pi};

/// Standard deviation of a bearing (section V-A).
pub(super) const SIGMA_RAD: f64 = 0.05;
/// Sightings of a run.
pub(super) const SIGHTINGS: usize = 200;
/// Longest step along each axis: the paper's control limit.
const STEP_M: f64 = 1.0;
/// The robot keeps this near to where it began, and this far from source and walls.
const ROOM_M: f64 = 10.0;
const CLEARANCE_M: [f64; 2] = [3.0, 1.0];
/// Time between sightings.
const INTERVAL_S: f64 = 1.0;

pub(super) const ORIGIN: Horizontal = Horizontal { north: 0.0, east: 0.0 };

/// A wall without ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    pub(super) normal: Horizontal,
    pub(super) offset_m: f64,
}

impl Wall {
    /// The wall with a normal of this bearing.
    pub(super) fn new(normal_rad: f64, offset_m: f64) -> Self {
        Self { normal: Horizontal::from_bearing(normal_rad), offset_m }
    }

    /// How far in front of the wall a point is, on the origin's side.
    pub(super) fn clearance_m(&self, point: Horizontal) -> f64 {
        self.offset_m - self.normal.dot(point)
    }

    pub(super) fn mirror(&self, point: Horizontal) -> Horizontal {
        point.along(self.normal, 2.0 * self.clearance_m(point))
    }

    pub(super) fn to_core(self) -> walls::Wall {
        walls::Wall { normal_ned: self.normal.to_core(), offset_m: self.offset_m as f32, from_m: -1e5, to_m: 1e5 }
    }
}

/// A world without noise: where everything is at each sighting.
#[derive(Clone, Debug)]
pub(super) struct Course {
    pub(super) walls: Vec<Wall>,
    pub(super) robot: Vec<Horizontal>,
    pub(super) source: Vec<Horizontal>,
    /// The source's, at the end.
    velocity_mps: Horizontal,
}

impl Course {
    /// Random motions of the robot before a source at rest.
    pub(super) fn random(walls: Vec<Wall>, source: Horizontal, random: &mut Random) -> Option<Self> {
        Self::moving(walls, source, ORIGIN, 0.0, random)
    }

    /// The same before a source of nearly constant velocity, pushed by white acceleration of this density.
    pub(super) fn moving(
        walls: Vec<Wall>,
        source: Horizontal,
        mut velocity_mps: Horizontal,
        acceleration_m2_per_s3: f64,
        random: &mut Random,
    ) -> Option<Self> {
        let mut source = vec![source];
        let push_mps = libm::sqrt(acceleration_m2_per_s3 * INTERVAL_S);
        for k in 1..SIGHTINGS {
            source.push(source[k - 1].along(velocity_mps, INTERVAL_S));
            velocity_mps.north += push_mps * random.gaussian();
            velocity_mps.east += push_mps * random.gaussian();
        }
        let mut robot = vec![ORIGIN];
        for source in source.iter().skip(1) {
            let last = robot[robot.len() - 1];
            let next = (0..100).find_map(|_| {
                let step = [random.uniform(), random.uniform()].map(|u| STEP_M * (2.0 * u - 1.0));
                let next = Horizontal { north: last.north + step[0], east: last.east + step[1] };
                let free = next.norm() < ROOM_M
                    && next.minus(*source).norm() > CLEARANCE_M[0]
                    && walls.iter().all(|wall| wall.clearance_m(next) > CLEARANCE_M[1]);
                free.then_some(next)
            })?;
            robot.push(next);
        }
        let course = Self { walls, robot, source, velocity_mps };
        course
            .source
            .iter()
            .all(|source| course.walls.iter().all(|wall| wall.clearance_m(*source) > 0.5))
            .then_some(course)
    }

    /// A straight leg towards a source, so much of it.
    pub(super) fn straight(source: Horizontal, length_m: f64) -> Self {
        let steps = 60;
        let step =
            |k: usize| ORIGIN.along(Horizontal::from_bearing(source.bearing_rad()), length_m * k as f64 / steps as f64);
        Self {
            walls: Vec::new(),
            robot: (0..=steps).map(step).collect(),
            source: vec![source; steps + 1],
            velocity_mps: ORIGIN,
        }
    }

    /// Where the last ray to the robot seems to come from.
    pub(super) fn image(&self, k: usize) -> Horizontal {
        self.walls.iter().fold(self.source[k], |image, wall| wall.mirror(image))
    }

    /// Where the robot's mirror image is, which sees the source directly.
    pub(super) fn mirrored_robot(&self, k: usize) -> Horizontal {
        self.walls.iter().rev().fold(self.robot[k], |robot, wall| wall.mirror(robot))
    }

    /// The measurement.
    pub(super) fn hear(&self, random: &mut Random) -> Vec<Sighting> {
        let sighting = |k: usize| {
            let bearing = self.image(k).minus(self.robot[k]).bearing_rad() + SIGMA_RAD * random.gaussian();
            Sighting {
                place_ned_m: self.robot[k].to_core(),
                direction_ned: Horizontal::from_bearing(bearing).to_core(),
                sigma_rad: SIGMA_RAD as f32,
                since_s: INTERVAL_S as f32,
            }
        };
        (0..self.robot.len()).map(sighting).collect()
    }

    /// The state that a polar filter should have at the end.
    pub(super) fn polar_truth<const S: usize>(&self) -> [f64; S] {
        let last = self.robot.len() - 1;
        let to = self.source[last].minus(self.mirrored_robot(last));
        let rho = 1.0 / to.norm();
        let truth = [to.bearing_rad(), rho, self.velocity_mps.north * rho, self.velocity_mps.east * rho];
        std::array::from_fn(|i| truth[i])
    }
}

/// Runs of one filter in one experiment.
#[derive(Clone, Debug, Default)]
pub(super) struct Gathered {
    pub(super) initial_m: Vec<f64>,
    pub(super) errors_m: Vec<f64>,
    pub(super) lost: usize,
    pub(super) nis: Consistency,
    pub(super) nees: Consistency,
    /// Errors at each sighting, of all runs.
    pub(super) over_time_m: Vec<Vec<f64>>,
}

impl Gathered {
    /// Records the outcome of a sighting; false when the filter has diverged.
    pub(super) fn heard<E>(&mut self, heard: Result<Update, E>) -> bool {
        match heard {
            Ok(Update::Fused { nis, .. }) => self.nis.add(nis, 1),
            Ok(Update::Started) => (),
            Ok(Update::Refused | Update::Overhead) => return false,
            // A ray that noise has turned away from the wall: left out.
            Err(_) => (),
        }
        true
    }

    /// Takes in the error at a sighting.
    pub(super) fn at(&mut self, k: usize, error_m: f64) {
        if k == 0 {
            self.initial_m.push(error_m);
        }
        if self.over_time_m.len() <= k {
            self.over_time_m.push(Vec::new());
        }
        self.over_time_m[k].push(error_m);
    }
}

/// Squared error of a polar state over its covariance.
pub(super) fn polar_nees<const S: usize>(state: &State<S>, truth: [f64; S]) -> f64 {
    let mut error: [f64; S] = std::array::from_fn(|i| f64::from(state.mean()[i]) - truth[i]);
    error[0] = wrap_pi(error[0]);
    let covariance = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(state.covariance(i, j))));
    nees(error, covariance)
}

/// `e' P^-1 e`, by Gaussian elimination.
pub(super) fn nees<const S: usize>(mut error: [f64; S], mut covariance: [[f64; S]; S]) -> f64 {
    let mut sum = 0.0;
    for k in 0..S {
        let (pivot, row, first) = (covariance[k][k], covariance[k], error[k]);
        sum += first * first / pivot;
        for i in k + 1..S {
            let factor = covariance[i][k] / pivot;
            error[i] -= factor * first;
            for (entry, above) in covariance[i].iter_mut().zip(&row) {
                *entry -= factor * above;
            }
        }
    }
    sum
}

/// A direction anywhere.
pub(super) fn anywhere_rad(random: &mut Random) -> f64 {
    TAU * random.uniform() - PI
}

/// Uniform between limits.
pub(super) fn uniform(random: &mut Random, from: f64, to: f64) -> f64 {
    from + (to - from) * random.uniform()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_normalised_square_is_that_of_a_known_inverse() {
        // P = [[2, 1], [1, 3]], its inverse [[3, -1], [-1, 2]] / 5.
        let square = nees([1.0, 2.0], [[2.0, 1.0], [1.0, 3.0]]);
        assert!((square - (3.0 - 4.0 + 8.0) / 5.0).abs() < 1e-12, "{square}");
    }

    #[test]
    fn the_mirrored_robot_sees_what_the_robot_hears() {
        let mut random = Random::new(1, 1);
        let walls = vec![Wall::new(0.3, 12.0), Wall::new(1.9, 13.0)];
        let source = Horizontal { north: -6.0, east: -4.0 };
        let course = Course::random(walls, source, &mut random).unwrap();
        for k in 0..SIGHTINGS {
            let heard = course.image(k).minus(course.robot[k]).norm();
            let seen = source.minus(course.mirrored_robot(k)).norm();
            assert!((heard - seen).abs() < 1e-9);
        }
        let polar: [f64; 2] = course.polar_truth();
        assert!((1.0 / polar[1] - source.minus(course.mirrored_robot(SIGHTINGS - 1)).norm()).abs() < 1e-9);
    }
}
