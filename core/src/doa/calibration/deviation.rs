//! Deviation: the error of a bearing due to airframe and antenna coupling, as a function of its direction.
//!
//! `estimate - truth` is a Fourier series of order 4 in the estimated body azimuth, the only one known in flight:
//! `d(b) = c_0 + sum_k c_k cos k b + s_k sin k b`. `foxhound calibrate` fits it to the bearings of a turn on the spot;
//! the constant is the mounting of the array.

use crate::base::math::sqrt;
use crate::base::units::{sin_cos, wrap_pi};
use crate::doa::bearing::Bearing;

/// Highest harmonic.
pub const ORDER: usize = 4;
/// Terms of the series.
pub const TERMS: usize = 1 + 2 * ORDER;

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
#[must_use]
pub fn terms(azimuth_rad: f32) -> [f32; TERMS] {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Instant;
    use crate::doa::bearing::{Flags, Quality};

    #[test]
    fn a_deviation_is_taken_off_and_none_changes_nothing() {
        let without = Bearing::without(Instant(0), Quality::default(), Flags::default());
        let bearing = Bearing { valid: true, azimuth_rad: 1.0, sigma_rad: 0.03, ..without };
        assert_eq!(Deviation::default().apply(&bearing), bearing);
        let deviation = Deviation {
            constant_rad: 0.03,
            cosine_rad: [0.05, -0.02, 0.0, 0.01],
            sine_rad: [-0.04, 0.0, 0.03, -0.01],
            sigma_rad: 0.04,
        };
        let series = |b: f64| {
            let cosines = 0.05 * b.cos() - 0.02 * (2.0 * b).cos() + 0.01 * (4.0 * b).cos();
            0.03 + cosines - 0.04 * b.sin() + 0.03 * (3.0 * b).sin() - 0.01 * (4.0 * b).sin()
        };
        let applied = deviation.apply(&bearing);
        assert!((f64::from(applied.azimuth_rad) - (1.0 - series(1.0))).abs() < 1e-6, "{applied:?}");
        assert!((applied.sigma_rad - 0.05).abs() < 1e-6, "{applied:?}");
    }
}
