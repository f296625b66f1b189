//! Artificial potential fields of the main paper and of the variants paper.
//!
//! A field is its [`Law`] and its [`Gains`]. All laws share the attraction (main paper, eq. 33; variants paper, eq. 1-2)
//!
//! `U = 1/2 k_att |x - x_d|^2`, `F = -k_att (x - x_d)`,
//!
//! and differ in how they repel inside the influence range `d_0`. There `d` is the distance between the boundaries of
//! vehicle and obstacle (main paper, eq. 35); the variants paper's `p` is the same for its obstacles, which are points. `n`
//! is the unit vector away from the obstacle.
//!
//! | [`Kind`] | potential | force | source |
//! |---|---|---|---|
//! | `logarithmic` | `-k ln(d / d_0)` | `k / d n` | main paper, eq. 36 |
//! | `inverse_distance` | `k (1/d - 1/d_0)` | `k / d^2 n` | main paper, eq. 34 |
//! | `khatib` | `1/2 k (1/d - 1/d_0)^2` | `k (1/d - 1/d_0) / d^2 n` | variants paper, eq. 3 and 5 |
//! | `rizqi` | the same, linear below `p_m` | the same, constant below `p_m` | variants paper, eq. 7 |
//! | `sun` | `1/2 k (1/d - 1/d_0)^2 e^n`, `e = \|x - x_d\|` | eq. 9, below | variants paper, eq. 8-9 |
//! | `virtual_force` | see below | `k (1 - d/d_0) (x - x_o) + k_v (-1, 1)` | variants paper, eq. 10 |
//!
//! The *variants paper* compares these potential fields on a quadrotor in four scenes with local minima. Where its printed
//! forces are not the gradients of its printed potentials:
//!
//! - Eq. 5 and 9 have a minus sign, eq. 6 turns the gradient of `p` round: the two cancel, and the force points away.
//! - Eq. 7 leaves the direction of the constant force out; it is taken to be `n`, which makes it continuous.
//! - Below eq. 9 `(x - x_d)^n` is a sum over the components, which for `n = 1/2` has no real value and for `n = 0` is 2; here
//!   it is the distance to that power, which is the same for `n = 2`. With that, eq. 9 is minus the gradient of eq. 8:
//!   `k (1/d - 1/d_0) / d^2 e^n n - n/2 k (1/d - 1/d_0)^2 e^(n-1) (x - x_d) / e`.
//! - Eq. 10 comes without a potential. Its first term has one, being central; the second, a constant push in the paper's
//!   frame (x to the east, y to the north) whichever way the vehicle goes, has one within the range and jumps at its
//!   border. So the force is minus the gradient of [`Field::potential`] everywhere but on that border.
//!
//! Inside a circle, and closer than a centimetre to it, the force of all but `virtual_force` stays what it is there, and
//! the potential goes on linearly: both are finite everywhere. At the very centre an obstacle does not repel.
//!
//! The swirl that our planner adds has no potential.

use super::law;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Obstacle;
use foxhound_core::planning::field::{self, ForceField, Gains, Pole, Pull, repulsion};
use foxhound_core::planning::planner::baseline::{Kind, Law};

/// A potential field.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Field {
    /// Its law of repulsion.
    pub law: Law,
    /// Its gains.
    pub gains: Gains,
}

impl Field {
    /// The core's field with the same law, if there is one.
    #[must_use]
    pub(super) fn flown(&self) -> Option<field::Field> {
        (self.law.kind == Kind::Logarithmic).then_some(field::Field { gains: self.gains })
    }

    /// The potential at a position, for plots and tests; zero where no obstacle acts at the target.
    #[must_use]
    pub fn potential(&self, position: Horizontal, target: Horizontal, obstacles: &[Obstacle]) -> f32 {
        let error = position.minus(target);
        let mut repulsion = 0.0;
        for obstacle in obstacles {
            let distance = obstacle.clearance_m(position);
            if distance < self.gains.influence_m {
                let away = position.minus(obstacle.center_ned_m);
                repulsion += law::potential(&self.law, &self.gains, distance, obstacle.reach_m, away);
            }
        }
        0.5 * self.gains.k_att * error.norm_squared() + repulsion * law::fade(&self.law, error.norm_squared()).0
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
        if let Some(flown) = self.flown() {
            return flown.pull(position, target, poles, clearance);
        }
        let gains = &self.gains;
        let to_target = target.minus(position);
        let mut shares = 0.0;
        let (push, clearance) = repulsion(position, poles, clearance, |distance, norm| {
            let (strength, share) = law::strength(&self.law, gains, distance, norm);
            shares += share;
            strength
        });
        let (push, aside) = law::complete(&self.law, gains, push, shares, to_target);
        Pull { force: gains.attraction(to_target).plus(gains.swirled(push)).plus(aside), clearance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::planning::planner::baseline::Exponent;

    const TARGET: Horizontal = Horizontal { north: 2.0, east: -1.0 };

    fn obstacle(north: f32, east: f32, reach_m: f32) -> Obstacle {
        Obstacle { center_ned_m: Horizontal { north, east }, reach_m }
    }

    /// All laws, Sun's with each exponent.
    fn fields() -> std::vec::Vec<Field> {
        let gains = Gains { k_att: 1.3, k_rep: 0.2, influence_m: 0.8, swirl: 0.0 };
        let mut fields: std::vec::Vec<Field> =
            Kind::ALL.into_iter().map(|kind| Field { law: Law::of(kind), gains }).collect();
        for exponent in [Exponent::Zero, Exponent::Half, Exponent::One] {
            fields.push(Field { law: Law { exponent, ..Law::of(Kind::Sun) }, gains });
        }
        fields
    }

    /// The equations as printed, for points (no floor but Rizqi's), in f64. x is east and y is north.
    fn printed_potential(field: &Field, q: (f64, f64), obstacles: &[Obstacle]) -> f64 {
        let (k_att, k, d0) =
            (f64::from(field.gains.k_att), f64::from(field.gains.k_rep), f64::from(field.gains.influence_m));
        let e = (q.0 - f64::from(TARGET.north)).hypot(q.1 - f64::from(TARGET.east));
        let mut u = 0.5 * k_att * e * e;
        for o in obstacles {
            let (north, east) = (q.0 - f64::from(o.center_ned_m.north), q.1 - f64::from(o.center_ned_m.east));
            let (norm, reach) = (north.hypot(east), f64::from(o.reach_m));
            let d = norm - reach;
            if d >= d0 {
                continue;
            }
            let khatib = |d: f64| 0.5 * k * (1.0 / d - 1.0 / d0).powi(2);
            u += match field.law.kind {
                Kind::Logarithmic => -k * (d / d0).ln(),
                Kind::InverseDistance => k * (1.0 / d - 1.0 / d0),
                Kind::Khatib => khatib(d),
                Kind::Rizqi => {
                    let core = f64::from(field.law.core_m);
                    let slope = k * (1.0 / core - 1.0 / d0) / (core * core);
                    if d < core { khatib(core) + slope * (core - d) } else { khatib(d) }
                }
                Kind::Sun => {
                    let n = match field.law.exponent {
                        Exponent::Zero => 0.0,
                        Exponent::Half => 0.5,
                        Exponent::One => 1.0,
                        Exponent::Two => 2.0,
                    };
                    khatib(d) * e.powf(n)
                }
                Kind::VirtualForce => {
                    // The work of k (1 - d/d0) |x - x_o| from d to d0, by Simpson's rule, exact for a cubic.
                    let push = |s: f64| k * (1.0 - s / d0) * (s + reach);
                    let central = (d0 - d) / 6.0 * (push(d) + 4.0 * push(0.5 * (d + d0)) + push(d0));
                    central - f64::from(field.law.k_virtual) * (north - east)
                }
            };
        }
        u
    }

    #[test]
    fn every_force_is_minus_the_gradient_of_its_potential() {
        let obstacles = [obstacle(1.0, 0.2, 0.4), obstacle(0.3, -0.9, 0.3), obstacle(1.6, -0.6, 0.05)];
        for field in fields() {
            let (mut tested, mut acted) = (0, 0);
            for i in 0..20 {
                for j in 0..20 {
                    let q = Horizontal { north: -0.5 + 0.15 * i as f32, east: -1.5 + 0.15 * j as f32 };
                    let unclear = |o: &Obstacle| {
                        let d = o.clearance_m(q);
                        d < 0.03 || (d - field.gains.influence_m).abs() < 1e-3 || (d - field.law.core_m).abs() < 1e-3
                    };
                    if obstacles.iter().any(unclear) {
                        continue;
                    }
                    let (north, east, h) = (f64::from(q.north), f64::from(q.east), 1e-6);
                    let at = |north, east| printed_potential(&field, (north, east), &obstacles);
                    let gradient = (
                        (at(north + h, east) - at(north - h, east)) / (2.0 * h),
                        (at(north, east + h) - at(north, east - h)) / (2.0 * h),
                    );
                    let force = field.force(q, TARGET, &obstacles);
                    let (f, g) = ((f64::from(force.north), f64::from(force.east)), gradient);
                    let limit = 1e-3 + 2e-4 * g.0.hypot(g.1);
                    assert!((f.0 + g.0).hypot(f.1 + g.1) < limit, "{field:?} at {q:?}: {f:?}, {g:?}");
                    let u = at(north, east);
                    let potential = f64::from(field.potential(q, TARGET, &obstacles));
                    assert!((potential - u).abs() < 1e-4 + 2e-4 * u.abs(), "{field:?} at {q:?}: {potential}, {u}");
                    tested += 1;
                    acted += i32::from(obstacles.iter().any(|o| o.clearance_m(q) < field.gains.influence_m));
                }
            }
            assert!(tested > 250 && acted > 150, "{tested} {acted}");
        }
    }

    #[test]
    fn the_forces_of_the_variants_paper_are_what_is_printed() {
        // An obstacle at a point, 0.5 m away along (0.6, 0.8), the goal 5 m north of the vehicle; the attraction is off.
        let gains = Gains { k_att: 0.0, k_rep: 2.0, influence_m: 1.0, swirl: 0.0 };
        let position = Horizontal { north: 0.3, east: 0.4 };
        let goal = Horizontal { north: 5.3, east: 0.4 };
        let force = |law: Law| {
            let f = Field { law, gains }.force(position, goal, &[obstacle(0.0, 0.0, 0.0)]);
            (f.north, f.east)
        };
        let near = |got: (f32, f32), want: (f32, f32)| {
            assert!((got.0 - want.0).abs() < 1e-3 && (got.1 - want.1).abs() < 1e-3, "{got:?} for {want:?}");
        };
        // Eq. 5: 2 (2 - 1) / 0.25 = 8.
        near(force(Law::of(Kind::Khatib)), (4.8, 6.4));
        // Eq. 7 within p_m = 0.8: 2 (1.25 - 1) 1.5625 = 0.78125.
        near(force(Law { core_m: 0.8, ..Law::of(Kind::Rizqi) }), (0.46875, 0.625));
        near(force(Law { core_m: 0.2, ..Law::of(Kind::Rizqi) }), (4.8, 6.4));
        // Eq. 9: the first part times 5^n, the second n/2 2 (2 - 1)^2 5^(n-1) towards the goal.
        let sun = |exponent| force(Law { exponent, ..Law::of(Kind::Sun) });
        near(sun(Exponent::Zero), (4.8, 6.4));
        near(sun(Exponent::Half), (4.8 * 2.236_068 + 0.5 * 0.447_213_6, 6.4 * 2.236_068));
        near(sun(Exponent::One), (24.0 + 1.0, 32.0));
        near(sun(Exponent::Two), (120.0 + 10.0, 160.0));
        // Eq. 10: 2 (1 - 0.5) (0.3, 0.4), and k_v (-1, 1) in (x, y) = (east, north).
        near(force(Law { k_virtual: 0.7, ..Law::of(Kind::VirtualForce) }), (0.3 + 0.7, 0.4 - 0.7));
    }

    #[test]
    fn the_forces_of_the_main_paper_are_what_is_printed() {
        let gains = Gains { k_att: 3.0, k_rep: 2.0, influence_m: 1.0, swirl: 0.0 };
        let position = Horizontal { north: 0.0, east: 1.0 };
        let east = |kind, influence_m| {
            let field = Field { law: Law::of(kind), gains: Gains { influence_m, ..gains } };
            field.force(position, Horizontal { north: 0.0, east: 2.0 }, &[obstacle(0.0, 0.0, 0.6)]).east
        };
        assert!((east(Kind::Logarithmic, 1.0) - (3.0 + 2.0 / 0.4)).abs() < 1e-4);
        assert!((east(Kind::InverseDistance, 1.0) - (3.0 + 2.0 / 0.16)).abs() < 1e-4);
        assert_eq!(east(Kind::Logarithmic, 0.39), 3.0);
    }

    #[test]
    fn inside_an_obstacle_and_at_its_centre_and_at_the_target_everything_is_finite() {
        let pillar = obstacle(0.0, 0.0, 0.5);
        for mut field in fields() {
            field.gains.swirl = 0.3;
            for east in [0.0, 1e-38, 1e-22, 1e-20, 1e-12, 1e-6, 0.2, 0.499_999, 0.5, 0.5001] {
                let at = Horizontal { north: 0.0, east };
                for target in [TARGET, at, Horizontal::default()] {
                    let (force, u) = (field.force(at, target, &[pillar]), field.potential(at, target, &[pillar]));
                    assert!(force.is_finite() && u.is_finite(), "{field:?} at {east}: {force:?} {u}");
                }
            }
            let inside = Horizontal { north: 0.0, east: 0.2 };
            let outwards = field.force(inside, inside, &[pillar]).east;
            // Where the factor of the distance to the goal is zero, nothing repels: that is its point.
            let vanishes = field.law.kind == Kind::Sun && field.law.exponent != Exponent::Zero;
            assert!(
                if vanishes { outwards.abs() < 1e-3 } else { outwards > 0.0 } || field.law.kind == Kind::VirtualForce
            );
        }
    }
}
