//! Checks whether a filter's errors match its covariance: the mean of normalised squares against its chi-square band.
//!
//! The squared innovation over its variance (NIS) of one bearing has one degree of freedom, the squared error of a state
//! over its covariance (NEES) as many as the state. Sums of independent ones are chi-square of all their degrees, whose
//! quantiles Wilson and Hilferty (1931) give as
//!
//! ```text
//!     k (1 - 2 / (9 k) +- z sqrt(2 / (9 k)))^3
//! ```
//!
//! A consistent filter's NIS are independent over time; its NEES are so from run to run only.

use foxhound_core::base::math::sqrt;
use serde::Serialize;

/// Two-sided 95 % of a normal distribution.
const Z_95: f32 = 1.959_964;
/// Below this many degrees of freedom there is no verdict.
const DOF_MIN: u32 = 10;
/// Above this many the rounding of the sum is as wide as the band.
const DOF_MAX: u32 = 1_000_000;

/// Collected normalised squares.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Consistency {
    sum: f32,
    count: u32,
    dof: u32,
}

/// The verdict of the mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Within the band.
    Consistent,
    /// Its errors are larger than its covariance.
    Optimistic,
    /// Its errors are smaller than its covariance.
    Pessimistic,
    /// Not enough data.
    TooFew,
}

impl Consistency {
    /// Adds a normalised square of `dof` degrees of freedom; one that is NaN, or one too many, is ignored.
    pub(super) fn add(&mut self, square: f32, dof: u32) {
        if (0.0..1e12).contains(&square) && dof > 0 && dof <= DOF_MAX - self.dof {
            self.sum += square;
            self.count += 1;
            self.dof += dof;
        }
    }

    /// Their mean; zero without any.
    pub(super) fn mean(&self) -> f32 {
        if self.count == 0 { 0.0 } else { self.sum / self.count as f32 }
    }

    /// The band of 95 % of such means for a consistent filter; zeros without any.
    pub(super) fn band(&self) -> [f32; 2] {
        if self.count == 0 {
            return [0.0; 2];
        }
        let k = self.dof as f32;
        let ninth = 2.0 / (9.0 * k);
        [-Z_95, Z_95].map(|z| {
            let root = 1.0 - ninth + z * sqrt(ninth);
            let root = if root > 0.0 { root } else { 0.0 };
            k * root * root * root / self.count as f32
        })
    }

    /// The verdict of the mean.
    pub(super) fn verdict(&self) -> Verdict {
        let ([low, high], mean) = (self.band(), self.mean());
        if self.dof < DOF_MIN {
            Verdict::TooFew
        } else if mean > high {
            Verdict::Optimistic
        } else if mean < low {
            Verdict::Pessimistic
        } else {
            Verdict::Consistent
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::rng::Rng;

    #[test]
    fn the_band_is_that_of_the_tables() {
        // Quantiles 2.5 % and 97.5 % of the chi-square distribution.
        for (dof, table) in [(10, [3.247, 20.483]), (30, [16.791, 46.979]), (100, [74.222, 129.561])] {
            let mut one = Consistency::default();
            one.add(1.0, dof);
            for (bound, table) in one.band().into_iter().zip(table) {
                assert!((bound / table - 1.0_f32).abs() < 1e-2, "{dof}: {bound} {table}");
            }
        }
    }

    #[test]
    fn nineteen_of_twenty_consistent_runs_are_called_so_and_a_tenth_more_error_is_found() {
        let mut rng = Rng::new(1, 21);
        let mut verdicts = |scale: f32| {
            let mut counts = [0; 3];
            for _ in 0..1000 {
                let mut gathered = Consistency::default();
                for _ in 0..2000 {
                    let error = scale * rng.gaussian();
                    gathered.add(error * error, 1);
                }
                match gathered.verdict() {
                    Verdict::Consistent => counts[0] += 1,
                    Verdict::Optimistic => counts[1] += 1,
                    Verdict::Pessimistic => counts[2] += 1,
                    Verdict::TooFew => panic!("2000 are enough"),
                }
            }
            counts
        };
        let [consistent, optimistic, pessimistic] = verdicts(1.0);
        // 950 +- 3.5 standard deviations of 6.9.
        assert!((926..974).contains(&consistent), "{consistent}");
        assert!(optimistic < 55 && pessimistic < 55, "{optimistic} {pessimistic}");
        assert!(verdicts(1.1)[1] > 990 && verdicts(0.9)[2] > 990);
    }

    #[test]
    fn what_is_no_square_and_what_is_too_little_is_said() {
        let mut gathered = Consistency::default();
        for bad in [f32::NAN, f32::INFINITY, -1.0] {
            gathered.add(bad, 1);
        }
        gathered.add(1.0, 0);
        assert_eq!((gathered.count, gathered.mean(), gathered.band()), (0, 0.0, [0.0; 2]));
        for _ in 0..9 {
            gathered.add(100.0, 1);
        }
        assert_eq!(gathered.verdict(), Verdict::TooFew);
        gathered.add(100.0, 1);
        assert_eq!(gathered.verdict(), Verdict::Optimistic);
        gathered.add(0.0, DOF_MAX);
        assert_eq!(gathered.count, 10, "it holds no more than it can tell apart");
    }
}
