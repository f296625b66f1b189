//! Deviation: the error of a bearing due to airframe and antenna coupling, as a function of its direction.
//!
//! Hover, yaw once around in front of a source whose direction is known, and fit `estimate - truth` as a Fourier
//! series of order 4 in the estimated body azimuth, the only one known in flight: `d(b) = c_0 + sum_k c_k cos k b +
//! s_k sin k b`, by least squares (nine normal equations, Cholesky). This is how a ship's compass is swung; the
//! constant is the mounting of the array.

use crate::base::math::sqrt;
use crate::base::units::{sin_cos, wrap_pi};
use crate::doa::bearing::Bearing;

/// Highest harmonic.
pub const ORDER: usize = 4;
const TERMS: usize = 1 + 2 * ORDER;
/// Sectors of the circle, each of which must have been seen.
const SECTORS: usize = 12;

/// A deviation table; the default is zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Deviation {
    /// Constant part.
    pub constant_rad: f32,
    /// Of `cos k b`, from `k = 1`.
    pub cosine_rad: [f32; ORDER],
    /// Of `sin k b`, from `k = 1`.
    pub sine_rad: [f32; ORDER],
    /// Standard deviation of the fitted curve.
    pub sigma_rad: f32,
}

impl Deviation {
    /// The deviation at this estimated body azimuth, to be subtracted.
    #[must_use]
    pub fn at(&self, azimuth_rad: f32) -> f32 {
        let terms = terms(azimuth_rad);
        let (cosines, sines) = terms[1..].split_at(ORDER);
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        self.constant_rad + dot(cosines, &self.cosine_rad) + dot(sines, &self.sine_rad)
    }

    /// The bearing without the deviation.
    #[must_use]
    pub fn apply(&self, bearing: &Bearing) -> Bearing {
        // Without a measured deviation the bearing is unchanged to the bit.
        if *self == Self::default() {
            return *bearing;
        }
        let sigma_rad = sqrt(bearing.sigma_rad * bearing.sigma_rad + self.sigma_rad * self.sigma_rad);
        Bearing {
            azimuth_rad: wrap_pi(bearing.azimuth_rad - self.at(bearing.azimuth_rad)),
            sigma_rad: sigma_rad.min(core::f32::consts::PI),
            ..*bearing
        }
    }
}

/// One, the cosines, the sines.
fn terms(azimuth_rad: f32) -> [f32; TERMS] {
    let (sine, cosine) = sin_cos(wrap_pi(azimuth_rad));
    let mut terms = [1.0; TERMS];
    let (mut c, mut s) = (1.0, 0.0);
    for k in 0..ORDER {
        (c, s) = (c * cosine - s * sine, s * cosine + c * sine);
        terms[1 + k] = c;
        terms[1 + ORDER + k] = s;
    }
    terms
}

/// Measurements during a turn on the spot.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spin {
    normal: [[f32; TERMS]; TERMS],
    right: [f32; TERMS],
    squares: f32,
    looks: u32,
    seen: u16,
}

impl Spin {
    /// Takes a bearing and its true body azimuth; an invalid one changes nothing.
    pub fn step(&mut self, bearing: &Bearing, truth_rad: f32) {
        let error_rad = wrap_pi(bearing.azimuth_rad - truth_rad);
        if !bearing.valid || !error_rad.is_finite() {
            return;
        }
        let terms = terms(bearing.azimuth_rad);
        for ((row, right), a) in self.normal.iter_mut().zip(&mut self.right).zip(terms) {
            for (sum, b) in row.iter_mut().zip(terms) {
                *sum += a * b;
            }
            *right += a * error_rad;
        }
        self.squares += error_rad * error_rad;
        self.looks += 1;
        let turn = 0.5 + wrap_pi(bearing.azimuth_rad) / core::f32::consts::TAU;
        self.seen |= 1 << ((turn * SECTORS as f32) as usize).min(SECTORS - 1);
    }

    /// The deviation; `None` while some twelfth of the circle is missing or there are too few measurements.
    #[must_use]
    pub fn deviation(&self) -> Option<Deviation> {
        if self.seen != (1 << SECTORS) - 1 || self.looks < 2 * TERMS as u32 {
            return None;
        }
        let x = solve(self.normal, self.right)?;
        let explained: f32 = x.iter().zip(self.right).map(|(x, right)| x * right).sum();
        let freedom = (self.looks - TERMS as u32) as f32;
        let variance = (self.squares - explained).max(0.0) / freedom;
        Some(Deviation {
            constant_rad: x[0],
            cosine_rad: core::array::from_fn(|k| x[1 + k]),
            sine_rad: core::array::from_fn(|k| x[1 + ORDER + k]),
            sigma_rad: sqrt(variance * TERMS as f32 / self.looks as f32),
        })
    }
}

/// Solves a symmetric positive definite system; `None` when it is not.
fn solve(mut a: [[f32; TERMS]; TERMS], mut x: [f32; TERMS]) -> Option<[f32; TERMS]> {
    let least = 1e-4 * a[0][0];
    for i in 0..TERMS {
        for j in 0..=i {
            let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f32>();
            if i != j {
                a[i][j] = sum / a[j][j];
            } else if sum > least {
                a[i][i] = sqrt(sum);
            } else {
                return None;
            }
        }
    }
    for i in 0..TERMS {
        x[i] = (x[i] - (0..i).map(|k| a[i][k] * x[k]).sum::<f32>()) / a[i][i];
    }
    for i in (0..TERMS).rev() {
        x[i] = (x[i] - (i + 1..TERMS).map(|k| a[k][i] * x[k]).sum::<f32>()) / a[i][i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::base::time::Instant;
    use crate::doa::bearing::{Flags, Quality};
    use crate::doa::calibration::tests::error_rad;
    use std::f64::consts::TAU;

    fn bearing(azimuth_rad: f64) -> Bearing {
        let without = Bearing::without(Instant(0), Quality::default(), Flags::default());
        Bearing { valid: true, azimuth_rad: wrap_pi(azimuth_rad as f32), sigma_rad: 0.002, ..without }
    }

    /// The estimate for a truth: an airframe that turns bearings by up to 9 deg, 0.2 of it in the fifth harmonic.
    fn estimate(truth: f64) -> f64 {
        let d = 2.0 + 4.0 * (truth - 0.3).sin() + 2.0 * (2.0 * truth).cos() - 1.0 * (4.0 * truth + 1.0).sin();
        truth + (d + 0.2 * (5.0 * truth).sin()).to_radians()
    }

    fn spin(looks: u32, noise_rad: f32, turns: f64, rng: &mut Rng) -> Spin {
        let mut spin = Spin::default();
        for k in 0..looks {
            let truth = TAU * turns * f64::from(k) / f64::from(looks) - 2.0;
            spin.step(&bearing(estimate(truth) + f64::from(noise_rad * rng.gaussian())), wrap_pi(truth as f32));
        }
        spin
    }

    #[test]
    fn a_turn_on_the_spot_takes_degrees_of_deviation_down_to_tenths() {
        let mut rng = Rng::new(1, 1);
        let deviation = spin(720, 0.0025, 1.0, &mut rng).deviation().unwrap();
        let (mut before, mut after) = (0.0, 0.0);
        for degree in 0..360 {
            let truth = f64::from(degree).to_radians();
            let raw = bearing(estimate(truth));
            before += error_rad(raw.azimuth_rad, truth).powi(2) / 360.0;
            after += error_rad(deviation.apply(&raw).azimuth_rad, truth).powi(2) / 360.0;
        }
        let (before, after) = (before.sqrt().to_degrees(), after.sqrt().to_degrees());
        assert!(before > 3.5, "{before}");
        // The harmonics above the fourth remain; as a function of the estimate there are some more of them.
        assert!(after < 0.30, "{after}");
    }

    #[test]
    fn the_fit_is_exact_for_a_series_of_order_four_and_says_how_sure_it_is() {
        let truth = Deviation {
            constant_rad: 0.03,
            cosine_rad: [0.05, -0.02, 0.0, 0.01],
            sine_rad: [-0.04, 0.0, 0.03, -0.01],
            sigma_rad: 0.0,
        };
        let mut rng = Rng::new(2, 1);
        for (noise_rad, bound) in [(0.0, 1e-5), (0.01, 0.004)] {
            let mut spin = Spin::default();
            for k in 0..360 {
                let azimuth = wrap_pi(f64::from(k).to_radians() as f32);
                let found = bearing(f64::from(azimuth + noise_rad * rng.gaussian()));
                spin.step(&found, wrap_pi(azimuth - truth.at(azimuth)));
            }
            let found = spin.deviation().unwrap();
            let mut worst = 0.0_f32;
            for k in 0..100 {
                let azimuth = k as f32 * 0.06 - 3.0;
                worst = worst.max((found.at(azimuth) - truth.at(azimuth)).abs());
            }
            assert!(worst < bound, "{worst}");
            let expected = noise_rad * libm::sqrtf(9.0 / 360.0);
            assert!((found.sigma_rad - expected).abs() < 0.2 * expected + 1e-5, "{} {expected}", found.sigma_rad);
        }
    }

    #[test]
    fn an_unfinished_turn_and_useless_bearings_give_no_deviation() {
        let mut rng = Rng::new(3, 1);
        assert!(spin(720, 0.0, 0.8, &mut rng).deviation().is_none());
        assert!(spin(12, 0.0, 1.0, &mut rng).deviation().is_none());
        assert!(Spin::default().deviation().is_none());
        let mut spin = Spin::default();
        for k in 0..720 {
            spin.step(&Bearing { valid: false, ..bearing(f64::from(k)) }, 0.0);
            spin.step(&bearing(f64::NAN), 0.0);
        }
        assert!(spin.deviation().is_none());
    }

    #[test]
    fn no_deviation_changes_nothing() {
        assert_eq!(Deviation::default().apply(&bearing(1.0)), bearing(1.0));
    }
}
