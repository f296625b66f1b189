//! A complex number, and the few operations that phasors need.

use crate::base::math::sqrt;
use crate::base::units::sin_cos;

/// A complex number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Complex {
    /// Real part.
    pub re: f32,
    /// Imaginary part.
    pub im: f32,
}

impl Complex {
    /// Product.
    #[must_use]
    pub fn times(self, other: Self) -> Self {
        Self { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }

    /// Product with the conjugate of `other`.
    #[must_use]
    pub fn times_conj(self, other: Self) -> Self {
        Self { re: self.re * other.re + self.im * other.im, im: self.im * other.re - self.re * other.im }
    }

    /// Sum.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }

    /// This number times a real factor.
    #[must_use]
    pub fn scaled(self, factor: f32) -> Self {
        Self { re: self.re * factor, im: self.im * factor }
    }

    /// The number of length one at an angle.
    #[must_use]
    pub fn at(angle_rad: f32) -> Self {
        let (im, re) = sin_cos(angle_rad);
        Self { re, im }
    }

    /// The same direction with length one; zero for zero.
    #[must_use]
    pub fn unit(self) -> Self {
        let power = self.norm_squared();
        if power > 0.0 && power.is_finite() { self.scaled(1.0 / sqrt(power)) } else { Self::default() }
    }

    /// Squared magnitude.
    #[must_use]
    pub fn norm_squared(self) -> f32 {
        self.re * self.re + self.im * self.im
    }

    /// Argument in (-pi, pi].
    #[must_use]
    pub fn arg(self) -> f32 {
        libm::atan2f(self.im, self.re)
    }
}
