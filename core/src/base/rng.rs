//! Seeded random numbers: `xoshiro128++` behind [`rand_core`], uniform and Gaussian draws in `f32`.
//!
//! The Gaussian is our own Box-Muller instead of `rand_distr`'s: that one uses the logarithm and exponential of the
//! float library that the build enables, so that host and target would draw different bits.

use core::f32::consts::TAU;
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro128PlusPlus;

use crate::base::math::sqrt;
use crate::base::units::sin_cos;

/// A seeded generator. Same seed, same numbers, on every machine.
///
/// ```
/// use foxhound_core::base::rng::Rng;
///
/// let (mut first, mut again) = (Rng::new(7, 1), Rng::new(7, 1));
/// assert_eq!(first.gaussian().to_bits(), again.gaussian().to_bits());
/// ```
#[derive(Clone, Debug)]
pub struct Rng {
    source: Xoshiro128PlusPlus,
}

impl Rng {
    /// A generator from a seed; each purpose has its own `stream`, so that the draws of modules are independent.
    #[must_use]
    pub fn new(seed: u64, stream: u64) -> Self {
        let mixed = seed ^ stream.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Self { source: Xoshiro128PlusPlus::seed_from_u64(mixed) }
    }

    /// Uniform in (0, 1]: never zero, so that its logarithm is finite.
    pub fn uniform(&mut self) -> f32 {
        ((self.source.next_u32() >> 8) + 1) as f32 * (1.0 / 16_777_216.0)
    }

    /// Standard normal (Box-Muller, the cosine half); |value| stays below 5.8.
    pub fn gaussian(&mut self) -> f32 {
        let radius = sqrt(-2.0 * libm::logf(self.uniform()));
        let (_, cosine) = sin_cos(TAU * self.uniform());
        radius * cosine
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussian_draws_have_the_moments_of_a_normal_distribution() {
        let mut rng = Rng::new(7, 1);
        let n = 200_000;
        let (mut sum, mut square, mut fourth) = (0.0_f64, 0.0_f64, 0.0_f64);
        for _ in 0..n {
            let x = f64::from(rng.gaussian());
            sum += x;
            square += x * x;
            fourth += x * x * x * x;
        }
        let n = f64::from(n);
        // Five standard errors each.
        assert!((sum / n).abs() < 5.0 / n.sqrt());
        assert!((square / n - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        assert!((fourth / n - 3.0).abs() < 5.0 * (96.0 / n).sqrt());
    }

    #[test]
    fn streams_and_seeds_are_apart_and_repeat() {
        let draw = |seed, stream| Rng::new(seed, stream).uniform();
        assert_eq!(draw(1, 1), draw(1, 1));
        assert_ne!(draw(1, 1), draw(1, 2));
        assert_ne!(draw(1, 1), draw(2, 1));
    }
}
