//! Vectors in the north-east-down frame, and the rotation between body azimuth and NED bearing.

use crate::base::math::sqrt;
use crate::base::units::sin_cos;

/// A vector in the local north-east-down frame. Its unit is in the name of the variable that holds it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Ned {
    /// Component to the north.
    pub north: f32,
    /// Component to the east.
    pub east: f32,
    /// Component downwards.
    pub down: f32,
}

impl Ned {
    /// The horizontal part.
    #[must_use]
    pub fn horizontal(self) -> Horizontal {
        Horizontal { north: self.north, east: self.east }
    }

    /// Whether all components are finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.north.is_finite() && self.east.is_finite() && self.down.is_finite()
    }
}

/// A vector in the horizontal plane of the NED frame, in which planning takes place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Horizontal {
    /// Component to the north.
    pub north: f32,
    /// Component to the east.
    pub east: f32,
}

impl Horizontal {
    /// The unit vector that points along a bearing (from north, clockwise).
    #[must_use]
    pub fn from_bearing(bearing_rad: f32) -> Self {
        let (east, north) = sin_cos(bearing_rad);
        Self { north, east }
    }

    /// The bearing of this vector (from north, clockwise), in (-pi, pi]; 0 for the zero vector.
    #[must_use]
    pub fn bearing_rad(self) -> f32 {
        libm::atan2f(self.east, self.north)
    }

    /// Sum.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { north: self.north + other.north, east: self.east + other.east }
    }

    /// Difference.
    #[must_use]
    pub fn minus(self, other: Self) -> Self {
        Self { north: self.north - other.north, east: self.east - other.east }
    }

    /// This vector times a number.
    #[must_use]
    pub fn times(self, factor: f32) -> Self {
        Self { north: self.north * factor, east: self.east * factor }
    }

    /// Inner product.
    #[must_use]
    pub fn dot(self, other: Self) -> f32 {
        self.north * other.north + self.east * other.east
    }

    /// Squared length.
    #[must_use]
    pub fn norm_squared(self) -> f32 {
        self.dot(self)
    }

    /// Length.
    #[must_use]
    pub fn norm(self) -> f32 {
        sqrt(self.norm_squared())
    }

    /// This vector shortened to `length` if it is longer.
    #[must_use]
    pub fn clamped(self, length: f32) -> Self {
        let norm = self.norm();
        if norm > length { self.times(length / norm) } else { self }
    }

    /// Whether both components are finite.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.north.is_finite() && self.east.is_finite()
    }

    /// Shortest distance from `point` to the segment from `a` to `b`.
    #[must_use]
    pub fn distance_to_segment(point: Self, a: Self, b: Self) -> f32 {
        let along = b.minus(a);
        let length_squared = along.norm_squared();
        let t = if length_squared > 0.0 { (point.minus(a).dot(along) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
        point.minus(a.plus(along.times(t))).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bearings_run_clockwise_from_north() {
        let east = Horizontal::from_bearing(core::f32::consts::FRAC_PI_2);
        assert!(east.north.abs() < 1e-6 && (east.east - 1.0).abs() < 1e-6);
        assert!((Horizontal { north: 0.0, east: -1.0 }.bearing_rad() + core::f32::consts::FRAC_PI_2).abs() < 1e-6);
    }

    #[test]
    fn distance_to_a_segment_counts_its_ends_and_its_inside() {
        let a = Horizontal { north: 0.0, east: 0.0 };
        let b = Horizontal { north: 2.0, east: 0.0 };
        let at = |north, east| Horizontal::distance_to_segment(Horizontal { north, east }, a, b);
        assert_eq!(at(1.0, 3.0), 3.0);
        assert_eq!(at(-3.0, 4.0), 5.0);
        assert_eq!(at(5.0, 4.0), 5.0);
        assert_eq!(Horizontal::distance_to_segment(b, a, a), 2.0);
    }
}
