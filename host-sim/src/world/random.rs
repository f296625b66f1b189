//! Seeded random numbers of the simulated world: one generator per purpose, so that more draws for one do not change
//! the others.

use rand_core::{Rng as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// A seeded generator of uniform and Gaussian numbers.
#[derive(Clone, Debug)]
pub struct Random {
    source: Xoshiro256PlusPlus,
}

impl Random {
    /// A generator from a flight's seed and the number of its purpose.
    #[must_use]
    pub fn new(seed: u64, purpose: u64) -> Self {
        Self { source: Xoshiro256PlusPlus::seed_from_u64(seed ^ purpose.wrapping_mul(0x9e37_79b9_7f4a_7c15)) }
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.source.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Standard normal.
    pub fn gaussian(&mut self) -> f64 {
        StandardNormal.sample(&mut self.source)
    }

    /// As many draws, each `sigma` times a standard normal one.
    pub fn fill_gaussian(&mut self, sigma: f64, values: &mut [f64]) {
        // A local copy of the generator stays in registers.
        let mut source = self.source.clone();
        for value in values {
            let draw: f64 = StandardNormal.sample(&mut source);
            *value = sigma * draw;
        }
        self.source = source;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaussian_draws_have_zero_mean_and_unit_variance_and_repeat() {
        let mut random = Random::new(3, 1);
        let draws: Vec<f64> = (0..100_000).map(|_| random.gaussian()).collect();
        let mean = draws.iter().sum::<f64>() / 1e5;
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / 1e5;
        assert!(mean.abs() < 5.0 / 1e5_f64.sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / 1e5_f64).sqrt(), "{variance}");
        assert_eq!(Random::new(3, 1).gaussian(), draws[0]);
        let (mut filled, mut again) = ([0.0; 8], Random::new(3, 1));
        again.fill_gaussian(2.0, &mut filled);
        assert_eq!(filled.map(|value| value / 2.0), draws[..8]);
        assert_eq!(again.gaussian(), draws[8]);
        assert_ne!(Random::new(3, 2).gaussian(), draws[0]);
    }
}
