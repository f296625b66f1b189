//! The artificial potential field that the planner's samples follow: attraction to the target, repulsion from circles.
//!
//! After the main paper (eq. 33, 35 and 36),
//!
//! `F = -k_att (x - x_d) + sum k / d n`
//!
//! over the obstacles within the influence range `d_0`. There `d` is the distance between the boundaries of vehicle and
//! obstacle, and `n` the unit vector away from the obstacle. Inside a circle, and closer than a centimetre to it, the
//! force is constant, so it is finite everywhere. Exactly at its centre an obstacle does not repel.
//!
//! Foxhound's planner adds a swirl: a share of the repulsion, turned by a right angle, which moves the vehicle around
//! an obstacle that is exactly in its path.
//!
//! Other fields can replace it ([`ForceField`]): those of the variants paper, and the potentials of all of them, are in
//! the crate `foxhound-papers`.

use crate::base::math::inverse_root;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Obstacle;

/// Distance below which a repulsion stops growing.
pub const DISTANCE_MIN_M: f32 = 0.01;

/// The parameters that the planner samples (eq. 38-40), and the swirl.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Gains {
    /// Attraction constant.
    pub k_att: f32,
    /// Repulsion constant.
    pub k_rep: f32,
    /// Influence range of an obstacle's boundary, `d_0`.
    pub influence_m: f32,
    /// Share of the repulsion that acts sideways; positive turns clockwise (leaves the obstacle to the right).
    pub swirl: f32,
}

/// The main paper's field, with a swirl.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Field {
    /// The gains.
    pub gains: Gains,
}

/// The data of an obstacle that the inner loop needs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pole {
    /// Centre.
    pub center: Horizontal,
    /// Smallest distance of the vehicle's centre from the obstacle's centre: both radii.
    pub reach: f32,
    /// Square of the distance from the centre within which it acts.
    pub squared_range: f32,
}

/// The force at a position, and the smallest clearance of the obstacles that act there and of those before.
#[derive(Clone, Copy, Debug)]
pub struct Pull {
    /// The force.
    pub force: Horizontal,
    /// The clearance.
    pub clearance: f32,
}

/// A force field that a trajectory can follow.
pub trait ForceField {
    /// The gains.
    fn gains(&self) -> &Gains;

    /// The force from a selection of the obstacles, which contains at least all that act here, in their order.
    fn pull(&self, position: Horizontal, target: Horizontal, poles: impl Iterator<Item = Pole>, clearance: f32)
    -> Pull;

    /// Converts an obstacle, with the distance within which it acts.
    #[inline(always)]
    fn pole(&self, center: Horizontal, reach: f32) -> Pole {
        let range = reach + self.gains().influence_m;
        Pole { center, reach, squared_range: range * range }
    }

    /// The force at a position.
    #[must_use]
    fn force(&self, position: Horizontal, target: Horizontal, obstacles: &[Obstacle]) -> Horizontal {
        self.pull(position, target, obstacles.iter().map(|o| self.pole(o.center_ned_m, o.reach_m)), f32::INFINITY).force
    }
}

impl Gains {
    /// The attraction to the target (eq. 33).
    #[must_use]
    #[inline(always)]
    pub fn attraction(&self, to_target: Horizontal) -> Horizontal {
        to_target.times(self.k_att)
    }

    /// A repulsive force plus the swirl's share of it.
    #[must_use]
    #[inline(always)]
    pub fn swirled(&self, push: Horizontal) -> Horizontal {
        push.plus(Horizontal { north: -push.east, east: push.north }.times(self.swirl))
    }

    /// The force of eq. 36 along the line from an obstacle.
    #[must_use]
    #[inline(always)]
    pub fn logarithmic(&self, distance: f32) -> f32 {
        // The division is skipped where it is not needed: the compiler then branches, which is faster than a
        // conditional move.
        if distance > DISTANCE_MIN_M { self.k_rep / distance } else { self.k_rep * (1.0 / DISTANCE_MIN_M) }
    }
}

impl ForceField for Field {
    #[inline(always)]
    fn gains(&self) -> &Gains {
        &self.gains
    }

    #[inline(always)]
    fn pull(
        &self,
        position: Horizontal,
        target: Horizontal,
        poles: impl Iterator<Item = Pole>,
        clearance: f32,
    ) -> Pull {
        let gains = &self.gains;
        let attraction = gains.attraction(target.minus(position));
        let (push, clearance) = repulsion(position, poles, clearance, |distance, _| gains.logarithmic(distance));
        Pull { force: attraction.plus(gains.swirled(push)), clearance }
    }
}

/// Sum of the forces along the lines from the obstacles, and the smallest clearance.
#[inline(always)]
pub fn repulsion(
    position: Horizontal,
    poles: impl Iterator<Item = Pole>,
    mut clearance: f32,
    mut strength: impl FnMut(f32, f32) -> f32,
) -> (Horizontal, f32) {
    let mut push = Horizontal::default();
    for pole in poles {
        let away = position.minus(pole.center);
        let squared = away.norm_squared();
        if squared < pole.squared_range {
            let inverse = inverse_root(squared);
            let norm = squared * inverse;
            let distance = norm - pole.reach;
            if distance < clearance {
                clearance = distance;
            }
            push = push.plus(away.times(strength(distance, norm) * inverse));
        }
    }
    (push, clearance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_swirl_turns_the_repulsion_by_a_right_angle_clockwise() {
        let gains = Gains { k_att: 0.0, k_rep: 1.0, influence_m: 1.0, swirl: 0.5 };
        let field = Field { gains };
        // The repulsion points north, so the swirl, clockwise from it, points east.
        let north = Horizontal { north: 1.0, east: 0.0 };
        let obstacle = Obstacle { center_ned_m: Horizontal::default(), reach_m: 0.5 };
        let force = field.force(north, north, &[obstacle]);
        assert!((force.north - 2.0).abs() < 1e-5 && (force.east - 1.0).abs() < 1e-5, "{force:?}");
    }
}
