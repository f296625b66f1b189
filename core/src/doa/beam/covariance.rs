//! The covariance of up to eight antennas: a sum of outer products.

use super::Vector;
use crate::base::adc::ANTENNAS_MAX;
use crate::signal::phase::Complex;

/// An antenna this much below the loudest, in power, hears nothing.
const DEAD_POWER_RATIO: f32 = 0.01;

/// `R = sum w z z'`, and the sum of the weights `w`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Covariance {
    rows: [Vector; ANTENNAS_MAX],
    weight: f32,
}

impl Covariance {
    /// Adds a set of phasors. The weight is what it counts for.
    pub fn add(&mut self, z: &Vector, weight: f32) {
        for (row, a) in self.rows.iter_mut().zip(z) {
            let a = a.scaled(weight);
            for (sum, b) in row.iter_mut().zip(z) {
                *sum = sum.plus(a.times_conj(*b));
            }
        }
        self.weight += weight;
    }

    /// Adds another one, times a weight.
    pub fn join(&mut self, other: &Self, weight: f32) {
        for (row, others) in self.rows.iter_mut().zip(&other.rows) {
            for (sum, other) in row.iter_mut().zip(others) {
                *sum = sum.plus(other.scaled(weight));
            }
        }
        self.weight += weight * other.weight;
    }

    /// Sum of the weights.
    #[must_use]
    pub fn weight(&self) -> f32 {
        self.weight
    }

    /// Scaled so that the trace is the sum of the weights: products of two elements do not overflow. Unchanged where the trace
    /// is zero or not finite.
    #[must_use]
    pub fn of_mean_one(&self) -> Self {
        let scale = self.weight / self.trace();
        if !(scale > 0.0) || !scale.is_finite() {
            return *self;
        }
        Self { rows: self.rows.map(|row| row.map(|r| r.scaled(scale))), weight: self.weight }
    }

    /// `a' R a`.
    #[must_use]
    pub fn power(&self, a: &Vector) -> f32 {
        let mut sum = 0.0;
        for (k, (row, a_k)) in self.rows.iter().zip(a).enumerate() {
            // The other half of the matrix gives the same once more.
            let behind = row.iter().zip(a).skip(k + 1);
            let half = behind.fold(Complex::default(), |sum, (r, a)| sum.plus(r.times(*a))).scaled(2.0);
            let own = row.get(k).map_or_else(Complex::default, |r| a_k.scaled(r.re));
            sum += half.plus(own).times_conj(*a_k).re;
        }
        sum
    }

    /// `R a`.
    #[must_use]
    pub fn times(&self, a: &Vector) -> Vector {
        let mut product = Vector::default();
        for (y, row) in product.iter_mut().zip(&self.rows) {
            *y = row.iter().zip(a).fold(Complex::default(), |sum, (r, a)| sum.plus(r.times(*a)));
        }
        product
    }

    /// Sum of the antennas' powers.
    #[must_use]
    pub fn trace(&self) -> f32 {
        self.diagonal().sum()
    }

    /// Power of each antenna.
    pub fn diagonal(&self) -> impl Iterator<Item = f32> {
        self.rows.iter().enumerate().map(|(k, row)| row.get(k).map_or(0.0, |r| r.re))
    }

    /// Without the antennas that are 20 dB below the loudest: they are not connected, and what they hear comes from the others.
    #[must_use]
    pub fn of_the_living(&self) -> Self {
        let least = DEAD_POWER_RATIO * self.diagonal().fold(0.0, f32::max);
        let mut living = *self;
        for (k, _) in self.diagonal().enumerate().filter(|(_, power)| !(*power > least)) {
            for (m, row) in living.rows.iter_mut().enumerate() {
                for (n, sum) in row.iter_mut().enumerate() {
                    *sum = if m == k || n == k { Complex::default() } else { *sum };
                }
            }
        }
        living
    }

    /// Whether an antenna hears anything.
    #[must_use]
    pub fn lives(&self, antenna: usize) -> bool {
        self.rows.get(antenna).and_then(|row| row.get(antenna)).is_some_and(|power| power.re > 0.0)
    }
}
