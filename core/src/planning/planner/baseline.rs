//! The configuration of the papers' planners, so that one configuration describes a whole flight. The planners
//! themselves are in the crate `foxhound-papers`.

/// The laws of repulsion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Kind {
    /// The main paper's (eq. 36).
    #[default]
    Logarithmic,
    /// The law that the main paper replaces (eq. 34).
    InverseDistance,
    /// The traditional one (variants paper, eq. 3-6).
    Khatib,
    /// The modified one, with a core of constant force (variants paper, eq. 7).
    Rizqi,
    /// The optimized one, with a power of the distance to the goal (variants paper, eq. 8-9).
    Sun,
    /// The one with a sideways force (variants paper, eq. 10).
    VirtualForce,
}

impl Kind {
    /// All laws.
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
    /// [`Kind::Rizqi`]: distance `p_m` below which the force is constant. Half the influence range is used if `p_m` is
    /// not less than the influence range.
    pub core_m: f32,
    /// [`Kind::Sun`]: power of the distance to the goal.
    pub exponent: Exponent,
    /// [`Kind::VirtualForce`]: gain `k_v` of the sideways force.
    pub k_virtual: f32,
}

impl Default for Law {
    fn default() -> Self {
        Self::of(Kind::Logarithmic)
    }
}

impl Law {
    /// A law with default parameters; the paper prints none, these suit metres and gains near one.
    #[must_use]
    pub const fn of(kind: Kind) -> Self {
        Self { kind, core_m: 0.2, exponent: Exponent::Two, k_virtual: 0.3 }
    }
}

/// How the main paper's "gradient descent" with 15 steps is interpreted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Reading {
    /// One force evaluation per waypoint, and a step of 2 m / 15 in its direction.
    #[default]
    Waypoint,
    /// The same in four steps of a quarter of that each.
    Quarters,
    /// Literally: a step of the force times 0.02, at most 2 m / 15. Fifteen of these cover half a metre.
    Gradient,
}

/// How `|T_j - T_init|` of eq. 47 is interpreted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Offsets {
    /// As the signed offset, point by point.
    #[default]
    Signed,
    /// Literally, as a distance, which is then added to both coordinates of a point.
    Scalar,
}
