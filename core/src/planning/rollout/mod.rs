//! Trajectories through the field and their cost.
//!
//! The main paper descends the gradient for 15 steps (section IV) and does not define the step. In flight each step is
//! one force evaluation and 2 m / 15 of path in its direction ([`Waypoint`]): two metres of target distance in fifteen
//! waypoints. Other interpretations are in the crate `foxhound-papers`. Cost by eq. 41-45: length, error at the end,
//! turns, proximity.
//!
//! [`Scene::roll`] computes both at once and should be used: it evaluates only obstacles that can act within the next
//! few steps, and takes the proximity from the distances that the force needs anyway. The result is exact: its
//! trajectory and cost equal those of [`roll_plainly`] and [`cost`] over the same obstacles in the same order, bit for
//! bit.
//!
//! Cost of ten samples of 15 waypoints among 64 circles: bench row `rollouts_64`.

use heapless::Vec;

use crate::base::math::{inverse_root, sqrt};
use crate::base::ned::Horizontal;
use crate::base::obstacle::Obstacle;
use crate::mapping::map::CIRCLES_MAX;
use crate::planning::field::{Field, ForceField, Pole, Pull};

/// Waypoints of a trajectory (main paper, section IV).
pub const WAYPOINTS: usize = 15;

/// Distance between waypoints: the paper's 2 m in 15 steps.
pub const SPACING_M: f32 = 2.0 / WAYPOINTS as f32;

/// Distance below which eq. 45 stops growing: closer, or inside, costs the same.
const PROXIMITY_MIN_M: f32 = 0.01;

/// Number of steps for which a short list of obstacles is valid.
const BLOCK: usize = 5;

/// Number of rings around the start of a scene: up to four metres.
const RINGS: usize = 32;
const RINGS_PER_M: f32 = 8.0;

/// Added to the reachable distance, to allow for rounding: enough up to ten kilometres from the origin.
const SLACK_M: f32 = 1e-2;

/// A trajectory: the waypoints after the start.
pub type Trajectory = [Horizontal; WAYPOINTS];

/// How a trajectory follows a field from waypoint to waypoint.
pub trait Stride: Copy {
    /// Number of steps from one waypoint to the next.
    fn steps(self) -> u8;

    /// Distance from the target within which a step ends at the target; `None` if no step does.
    fn ends_within_m(self) -> Option<f32>;

    /// The factor that turns the force into a step, from the square of the force's length and the inverse of that
    /// length.
    fn factor(self, squared: f32, inverse: f32) -> f32;
}

/// One force evaluation per waypoint, and a step of 2 m / 15 in its direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Waypoint;

impl Stride for Waypoint {
    #[inline(always)]
    fn steps(self) -> u8 {
        1
    }

    #[inline(always)]
    fn ends_within_m(self) -> Option<f32> {
        Some(SPACING_M)
    }

    #[inline(always)]
    fn factor(self, _squared: f32, inverse: f32) -> f32 {
        SPACING_M * inverse
    }
}

/// The terms of eq. 41.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Cost {
    /// Length, metres (eq. 42).
    pub length: f32,
    /// Distance from the end to the target, metres (eq. 43).
    pub error: f32,
    /// Sum of the turns, radians (eq. 44).
    pub turns: f32,
    /// One over the smallest distance to an obstacle, 1/m (eq. 45); 0 without obstacles.
    pub proximity: f32,
}

impl Cost {
    /// Eq. 41.
    #[must_use]
    pub fn total(&self) -> f32 {
        self.length + self.error + self.turns + self.proximity
    }
}

/// The obstacles of one replan, sorted into rings around its start.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    start: Horizontal,
    /// Ring by ring, within a ring in the given order; forces are added up in this order ([`Scene::obstacles`]).
    obstacles: Vec<Obstacle, CIRCLES_MAX>,
    /// Number of obstacles with a clearance from the start within the first ring, within the first two and so on.
    within: [u8; RINGS],
}

/// Obstacles that can act within the next few steps.
type ShortList = Vec<Pole, CIRCLES_MAX>;

impl Scene {
    /// No obstacles.
    #[must_use]
    pub const fn new() -> Self {
        Self { start: Horizontal { north: 0.0, east: 0.0 }, obstacles: Vec::new(), within: [0; RINGS] }
    }

    /// Stores the obstacles around a start; those beyond the first [`CIRCLES_MAX`] are left out.
    pub fn gather<I>(&mut self, start: Horizontal, obstacles: I)
    where
        I: IntoIterator<Item = Obstacle>,
        I::IntoIter: Clone,
    {
        let obstacles = obstacles.into_iter().take(CIRCLES_MAX);
        let mut rings = [0_u8; CIRCLES_MAX];
        let mut places = [0_u8; RINGS + 1];
        let mut count = 0;
        for (obstacle, slot) in obstacles.clone().zip(&mut rings) {
            let squared = obstacle.center_ned_m.minus(start).norm_squared();
            let ring = ring(squared * inverse_root(squared) - obstacle.reach_m).min(RINGS);
            *slot = ring as u8;
            places[ring] += 1;
            count += 1;
        }
        let mut first = 0;
        for place in &mut places {
            (first, *place) = (first + *place, first);
        }
        self.start = start;
        // Cannot fail: the capacity is [`CIRCLES_MAX`].
        let _ = self.obstacles.resize_default(count);
        for (obstacle, ring) in obstacles.zip(rings) {
            let Some(place) = places.get_mut(usize::from(ring)) else { continue };
            if let Some(known) = self.obstacles.get_mut(usize::from(*place)) {
                *known = obstacle;
            }
            *place += 1;
        }
        // Each ring's next place is now the first of the next ring.
        self.within.copy_from_slice(&places[..RINGS]);
    }

    /// [`Self::gather`] from a slice, compiled with this crate and not with the caller, which may be optimised for
    /// size.
    #[inline(never)]
    pub fn gather_all(&mut self, start: Horizontal, obstacles: &[Obstacle]) {
        self.gather(start, obstacles.iter().copied());
    }

    /// The obstacles in the order in which their forces are added up.
    pub fn obstacles(&self) -> impl Iterator<Item = Obstacle> {
        self.obstacles.iter().copied()
    }

    /// All obstacles whose clearance from the start is not greater, and possibly some more.
    fn within(&self, clearance_m: f32) -> &[Obstacle] {
        let count = self.within.get(ring(clearance_m)).map_or(CIRCLES_MAX, |count| usize::from(*count));
        self.obstacles.get(..count).unwrap_or(&self.obstacles)
    }

    /// The trajectory from the start, and its cost.
    #[must_use]
    pub fn roll(&self, field: &Field, target: Horizontal) -> (Trajectory, Cost) {
        self.roll_by(field, Waypoint, target)
    }

    /// The same in another field, or with other steps.
    #[must_use]
    #[inline(always)]
    pub fn roll_by(&self, field: &impl ForceField, stride: impl Stride, target: Horizontal) -> (Trajectory, Cost) {
        let (trajectory, closest) = self.descend(field, stride, target);
        let cost = self.price(&trajectory, closest, field.gains().influence_m, target);
        (trajectory, cost)
    }

    /// The cost of a trajectory. `closest` is the smallest distance of its waypoints to the obstacles that act there;
    /// the others are farther away than the influence range.
    fn price(&self, trajectory: &Trajectory, closest: f32, influence_m: f32, target: Horizontal) -> Cost {
        let mut closest = closest;
        let mut cost = shape(self.start, trajectory, target);
        // An obstacle that never acts is farther away than the range, and matters only if no obstacle acts.
        if closest >= influence_m - SLACK_M {
            closest = f32::INFINITY;
            for (index, known) in self.obstacles.iter().enumerate() {
                if index >= self.within(closest + far_m(WAYPOINTS)).len() {
                    break;
                }
                closest = nearest(trajectory, known.center_ned_m, known.reach_m, closest);
            }
        }
        cost.proximity = proximity(closest);
        cost
    }

    /// The trajectory, and the smallest distance of a waypoint to an obstacle that acts there.
    #[inline(always)]
    fn descend(&self, field: &impl ForceField, stride: impl Stride, target: Horizontal) -> (Trajectory, f32) {
        let influence_m = field.gains().influence_m;
        let mut list = ShortList::new();
        let (mut closest, mut listed) = (f32::INFINITY, 0);
        let mut descent = Descent::new(self.start, target, stride);
        let mut trajectory = [target; WAYPOINTS];
        loop {
            let (passed, position) = (descent.passed, descent.position);
            if passed == listed && passed < WAYPOINTS {
                listed += BLOCK;
                shorten(self.within(influence_m + far_m(listed)), position, field, &mut list);
            }
            let Pull { force, clearance } = field.pull(position, target, list.iter().copied(), closest);
            if descent.is_at_waypoint() {
                closest = clearance;
            }
            if !descent.follow(force, &mut trajectory) {
                return (trajectory, closest);
            }
        }
    }

    /// Whether a trajectory from the start keeps the margin from every obstacle, on its segments and at its waypoints.
    /// If the start is closer than that, a trajectory that does not come closer (by more than a millimetre) keeps it.
    #[must_use]
    pub fn keeps_margin(&self, trajectory: &[Horizontal], margin_m: f32) -> bool {
        let farthest = trajectory.iter().map(|w| w.minus(self.start).norm_squared()).fold(0.0, larger);
        let near = self.within(margin_m + sqrt(farthest) + SLACK_M);
        near.iter().all(|known| {
            let mut from = self.start.minus(known.center_ned_m);
            let at_start = from.norm() - known.reach_m - 1e-3;
            let least = known.reach_m + if at_start < margin_m { at_start } else { margin_m };
            least <= 0.0
                || trajectory.iter().all(|waypoint| {
                    let to = waypoint.minus(known.center_ned_m);
                    let squared = squared_to_segment(from, to);
                    from = to;
                    squared >= least * least
                })
        })
    }
}

/// The ring of a clearance; the first for obstacles that touch the start.
fn ring(clearance_m: f32) -> usize {
    // The cast saturates: zero for negative values, the largest number for values that are too large.
    (clearance_m * RINGS_PER_M) as usize
}

fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}

/// Squared distance from the origin to the segment from `a` to `b`.
fn squared_to_segment(a: Horizontal, b: Horizontal) -> f32 {
    let along = b.minus(a);
    let ahead = -a.dot(along);
    let length_squared = along.norm_squared();
    if ahead <= 0.0 {
        a.norm_squared()
    } else if ahead >= length_squared {
        b.norm_squared()
    } else {
        a.plus(along.times(ahead / length_squared)).norm_squared()
    }
}

/// The largest distance covered by a number of steps.
fn far_m(steps: usize) -> f32 {
    SPACING_M * steps as f32 + SLACK_M
}

/// Lists the obstacles that can act within a block of steps from here.
fn shorten(known: &[Obstacle], position: Horizontal, field: &impl ForceField, list: &mut ShortList) {
    let ahead = field.gains().influence_m + far_m(BLOCK);
    list.clear();
    // Four at a time: the compiler does not unroll this by itself when it optimises for size.
    let (fours, rest) = known.as_chunks::<4>();
    for [a, b, c, d] in fours {
        list_if_near(a, position, ahead, field, list);
        list_if_near(b, position, ahead, field, list);
        list_if_near(c, position, ahead, field, list);
        list_if_near(d, position, ahead, field, list);
    }
    for known in rest {
        list_if_near(known, position, ahead, field, list);
    }
}

#[inline(always)]
fn list_if_near(known: &Obstacle, position: Horizontal, ahead: f32, field: &impl ForceField, list: &mut ShortList) {
    let limit = known.reach_m + ahead;
    if position.minus(known.center_ned_m).norm_squared() < limit * limit {
        // Cannot fail: there are as many places as obstacles.
        let _ = list.push(field.pole(known.center_ned_m, known.reach_m));
    }
}

/// A trajectory in progress.
struct Descent<S> {
    stride: S,
    target: Horizontal,
    position: Horizontal,
    /// Number of waypoints that have been reached.
    passed: usize,
    /// Number of steps since the last waypoint.
    steps: u8,
}

impl<S: Stride> Descent<S> {
    #[inline(always)]
    fn new(start: Horizontal, target: Horizontal, stride: S) -> Self {
        Self { stride, target, position: start, passed: 0, steps: 0 }
    }

    /// Whether the position is a waypoint, and not the start or between two.
    #[inline(always)]
    fn is_at_waypoint(&self) -> bool {
        self.steps == 0 && self.passed > 0
    }

    /// Follows the force at the position; once at the target it stays there, and the rest of the trajectory is not
    /// written. Returns whether to go on. (With the trajectory as a field of this struct, the other fields would not be
    /// kept in registers.)
    #[inline(always)]
    fn follow(&mut self, force: Horizontal, trajectory: &mut Trajectory) -> bool {
        if self.passed >= WAYPOINTS {
            return false;
        }
        let steps = self.stride.steps();
        self.steps += 1;
        let left = self.target.minus(self.position).norm_squared();
        if self.stride.ends_within_m().is_some_and(|step_m| left <= step_m * step_m) {
            if left == 0.0 && self.passed > 0 {
                return false;
            }
            (self.position, self.steps) = (self.target, steps);
        } else {
            let squared = force.norm_squared();
            // Where the forces cancel, the position stays the same.
            if squared > 1e-12 {
                let inverse = inverse_root(squared);
                self.position = self.position.plus(force.times(self.stride.factor(squared, inverse)));
            }
        }
        if self.steps == steps {
            if let Some(waypoint) = trajectory.get_mut(self.passed) {
                *waypoint = self.position;
            }
            (self.passed, self.steps) = (self.passed + 1, 0);
        }
        true
    }
}

/// [`Scene::roll`]'s trajectory, computed from every obstacle at every step.
#[must_use]
pub fn roll_plainly(
    field: &impl ForceField,
    stride: impl Stride,
    start: Horizontal,
    target: Horizontal,
    obstacles: &[Obstacle],
) -> Trajectory {
    let mut descent = Descent::new(start, target, stride);
    let mut trajectory = [target; WAYPOINTS];
    while descent.follow(field.force(descent.position, target, obstacles), &mut trajectory) {}
    trajectory
}

/// The cost of a trajectory from `start` (eq. 41-45).
#[must_use]
pub fn cost(start: Horizontal, trajectory: &Trajectory, target: Horizontal, obstacles: &[Obstacle]) -> Cost {
    let mut cost = shape(start, trajectory, target);
    let nearest = |closest, o: &Obstacle| nearest(trajectory, o.center_ned_m, o.reach_m, closest);
    cost.proximity = proximity(obstacles.iter().fold(f32::INFINITY, nearest));
    cost
}

/// The terms of eq. 42-44.
fn shape(start: Horizontal, trajectory: &Trajectory, target: Horizontal) -> Cost {
    let mut cost = Cost::default();
    let (mut previous, mut before) = (start, Horizontal::default());
    for waypoint in trajectory {
        let step = waypoint.minus(previous);
        let squared = step.norm_squared();
        if squared > 1e-8 {
            let inverse = inverse_length(squared);
            cost.length += squared * inverse;
            let direction = step.times(inverse);
            cost.turns += turn_rad(before, direction);
            before = direction;
        }
        previous = *waypoint;
    }
    cost.error = previous.minus(target).norm();
    cost
}

/// One over the length of a step. Nearly all steps are as long as the spacing, where the tangent's error is within
/// 4e-7.
#[inline(always)]
fn inverse_length(squared: f32) -> f32 {
    const SPACING_SQUARED: f32 = SPACING_M * SPACING_M;
    if libm::fabsf(squared - SPACING_SQUARED) < 1e-3 * SPACING_SQUARED {
        1.5 / SPACING_M - squared * (0.5 / (SPACING_M * SPACING_SQUARED))
    } else {
        inverse_root(squared)
    }
}

/// Angle between two unit vectors, to a few millionths: twice the arctangent of `|a x b| / (1 + a . b)`, and its
/// supplement beyond a right angle. Zero when one of them is the zero vector.
fn turn_rad(a: Horizontal, b: Horizontal) -> f32 {
    let (cross, dot) = (libm::fabsf(a.north * b.east - a.east * b.north), a.dot(b));
    let angle = 2.0 * arctangent(cross / (1.0 + libm::fabsf(dot)));
    if dot < 0.0 { core::f32::consts::PI - angle } else { angle }
}

/// Arctangent from 0 to 1, within 2e-6.
fn arctangent(x: f32) -> f32 {
    let s = x * x;
    let high = -0.116_432_87 + s * (0.052_653_32 - s * 0.011_721_2);
    x * (0.999_977_26 + s * (-0.332_623_47 + s * (0.193_543_46 + s * high)))
}

/// The smaller of the closest distance so far and the smallest distance between a waypoint and an obstacle's reach.
fn nearest(trajectory: &Trajectory, center: Horizontal, reach: f32, closest: f32) -> f32 {
    let mut closest = closest;
    for waypoint in trajectory {
        // The square root is computed only where it can matter.
        let limit = reach + closest + SLACK_M;
        let squared = waypoint.minus(center).norm_squared();
        if limit > 0.0 && squared < limit * limit {
            let distance = squared * inverse_root(squared) - reach;
            if distance < closest {
                closest = distance;
            }
        }
    }
    closest
}

/// Eq. 45.
fn proximity(closest: f32) -> f32 {
    1.0 / if closest < PROXIMITY_MIN_M { PROXIMITY_MIN_M } else { closest }
}

/// Smallest distance between the vehicle's boundary and any obstacle along the first `segments` segments from `start`;
/// infinite without obstacles. Exact for the straight segments between waypoints.
#[must_use]
pub fn swept_clearance_m(start: Horizontal, trajectory: &[Horizontal], obstacles: &[Obstacle]) -> f32 {
    let mut closest = f32::INFINITY;
    let mut previous = start;
    for waypoint in trajectory {
        let half = 0.5 * waypoint.minus(previous).norm();
        let middle = previous.plus(*waypoint).times(0.5);
        for obstacle in obstacles {
            let limit = closest + obstacle.reach_m + half;
            if middle.minus(obstacle.center_ned_m).norm_squared() >= limit * limit {
                continue;
            }
            let distance =
                Horizontal::distance_to_segment(obstacle.center_ned_m, previous, *waypoint) - obstacle.reach_m;
            if distance < closest {
                closest = distance;
            }
        }
        previous = *waypoint;
    }
    closest
}

#[cfg(test)]
mod tests;
