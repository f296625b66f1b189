//! A complex number, and the few operations that phasors need.

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
