//! How the fields repel: equations in the documentation of [`super`].

use crate::base::math::sqrt;

use super::{ConfigError, Gains, Horizontal, check};

/// Distance below which a repulsion stops growing.
const DISTANCE_MIN_M: f32 = 0.01;

/// The laws of repulsion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Kind {
    /// The main paper's (eq. 36).
    #[default]
    Logarithmic,
    /// What the main paper replaces (eq. 34).
    InverseDistance,
    /// The traditional one (variants paper, eq. 3-6).
    Khatib,
    /// The modified one, with a core of constant force (variants paper, eq. 7).
    Rizqi,
    /// The optimized one, with a power of the distance to the goal (variants paper, eq. 8-9).
    Sun,
    /// With a push to the side (variants paper, eq. 10).
    VirtualForce,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Logarithmic, Self::InverseDistance, Self::Khatib, Self::Rizqi, Self::Sun, Self::VirtualForce];
}

/// The exponents `n` that the variants paper names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Exponent {
    /// 0: the traditional field.
    Zero,
    /// 0.5.
    Half,
    /// 1.
    One,
    /// 2.
    #[default]
    Two,
}

/// How a field repels.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Law {
    /// Which law.
    pub kind: Kind,
    /// [`Kind::Rizqi`]: distance `p_m` below which the force is constant. Half the influence range where it is
    /// not within that.
    pub core_m: f32,
    /// [`Kind::Sun`]: power of the distance to the goal.
    pub exponent: Exponent,
    /// [`Kind::VirtualForce`]: gain `k_v` of the push to the side.
    pub k_virtual: f32,
}

impl Default for Law {
    fn default() -> Self {
        Self::of(Kind::Logarithmic)
    }
}

impl Law {
    /// A law; the paper prints no parameters, these suit metres and gains near one.
    #[must_use]
    pub const fn of(kind: Kind) -> Self {
        Self { kind, core_m: 0.2, exponent: Exponent::Two, k_virtual: 0.3 }
    }

    /// Checks the parameters.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        check("planner.law.core_m", self.core_m, DISTANCE_MIN_M, 100.0)?;
        check("planner.law.k_virtual", self.k_virtual, -100.0, 100.0)?;
        Ok(())
    }

    /// Where the force stops growing.
    fn floor(&self, gains: &Gains) -> f32 {
        match self.kind {
            Kind::Rizqi if self.core_m < gains.influence_m => self.core_m,
            Kind::Rizqi => 0.5 * gains.influence_m,
            _ => DISTANCE_MIN_M,
        }
    }

    /// Force of one obstacle along the line from it, before [`Law::complete`]; and its share in what acts across.
    #[inline(never)]
    pub(super) fn strength(&self, gains: &Gains, distance: f32, norm: f32) -> (f32, f32) {
        let floor = self.floor(gains);
        let floored = if distance > floor { distance } else { floor };
        let inverse = 1.0 / floored;
        let above = inverse - 1.0 / gains.influence_m;
        let slope = above * inverse * inverse;
        match self.kind {
            Kind::Logarithmic => (logarithmic(gains, distance), 0.0),
            Kind::InverseDistance => (gains.k_rep * inverse * inverse, 0.0),
            Kind::Khatib | Kind::Rizqi => (gains.k_rep * slope, 0.0),
            // The share is twice the traditional potential of unit gain.
            Kind::Sun => (gains.k_rep * slope, above * above + 2.0 * slope * (floored - distance)),
            Kind::VirtualForce => (gains.k_rep * (1.0 - distance / gains.influence_m) * norm, 1.0),
        }
    }

    /// What becomes of the sums over the obstacles: the repulsion, and what does not act along the lines from them.
    #[inline(always)]
    pub(super) fn complete(
        &self,
        gains: &Gains,
        push: Horizontal,
        shares: f32,
        to_target: Horizontal,
    ) -> (Horizontal, Horizontal) {
        match self.kind {
            Kind::Sun => {
                let (factor, growth) = self.fade(to_target.norm_squared());
                (push.times(factor), to_target.times(0.5 * gains.k_rep * shares * growth))
            }
            Kind::VirtualForce => (push, Horizontal { north: self.k_virtual, east: -self.k_virtual }.times(shares)),
            _ => (push, Horizontal::default()),
        }
    }

    /// The factor `e^n` of a squared distance to the goal, and `n e^(n-2)`; finite at the goal.
    pub(super) fn fade(&self, squared: f32) -> (f32, f32) {
        if self.kind != Kind::Sun {
            return (1.0, 0.0);
        }
        let least = DISTANCE_MIN_M * DISTANCE_MIN_M;
        let error = sqrt(squared);
        let floored = if squared > least { squared } else { least };
        match self.exponent {
            Exponent::Zero => (1.0, 0.0),
            Exponent::Half => {
                let root = sqrt(sqrt(floored));
                (sqrt(error), 0.5 * root / floored)
            }
            Exponent::One => (error, 1.0 / sqrt(floored)),
            Exponent::Two => (squared, 2.0),
        }
    }

    /// Potential of one obstacle within its range, before the factor of [`Law::fade`].
    pub(super) fn potential(&self, gains: &Gains, distance: f32, reach: f32, away: Horizontal) -> f32 {
        let (k, range) = (gains.k_rep, gains.influence_m);
        if self.kind == Kind::VirtualForce {
            let squares = range * range - distance * distance;
            let cubes = range * range * range - distance * distance * distance;
            let central =
                0.5 * squares - cubes / (3.0 * range) + reach * (range - distance) - 0.5 * reach * squares / range;
            return k * central - self.k_virtual * (away.north - away.east);
        }
        let floor = self.floor(gains);
        let floored = if distance > floor { distance } else { floor };
        let above = 1.0 / floored - 1.0 / range;
        let outside = match self.kind {
            Kind::Logarithmic => -k * libm::logf(floored / range),
            Kind::InverseDistance => k * above,
            _ => 0.5 * k * above * above,
        };
        let (slope, _) = self.strength(gains, floored, floored);
        outside + slope * (floored - distance)
    }
}

/// The force of eq. 36.
#[inline(always)]
pub(super) fn logarithmic(gains: &Gains, distance: f32) -> f32 {
    // Without the division where it is not needed, which makes the compiler branch and is faster than to choose.
    if distance > DISTANCE_MIN_M { gains.k_rep / distance } else { gains.k_rep * (1.0 / DISTANCE_MIN_M) }
}
