//! The antenna array: where the antennas are, and what is known of their channels.
//!
//! Positions are body forward-right (metres, any common offset). The default is the main paper's square (eq. 18-19) in
//! our frame: A1 front-right, A2 front-left, A3 back-left, A4 back-right. Its side is 0.40 wavelength: half a wavelength,
//! which the paper's eq. 3 allows, cannot tell ahead from behind nor left from right, and what is close to it turns round
//! in noise.

use crate::adc::CHANNELS;
use crate::error::{ConfigError, Why, check};
use crate::phase::Complex;

/// Shortest side, in wavelengths, that is refused: from here on two opposite directions look the same.
pub const SIDE_REFUSED: f32 = 0.5;
/// Shortest side, in wavelengths, that deserves a warning.
pub const SIDE_WARNED: f32 = 0.46;

/// What the array needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Wavelength of the carrier.
    pub wavelength_m: f32,
    /// Antenna positions, `[forward, right]`.
    pub antennas_m: [[f32; 2]; CHANNELS],
    /// Complex gain of each channel relative to their mean; measured channels are divided by it.
    pub channel_gain: Option<[Complex; CHANNELS]>,
    /// Refuse to call a bearing valid without `channel_gain`.
    pub require_calibration: bool,
}

impl Default for Config {
    /// 868 MHz, side 0.40 wavelength.
    fn default() -> Self {
        Self::square(0.345, 0.40 * 0.345)
    }
}

impl Config {
    /// The square array in the paper's order.
    #[must_use]
    pub const fn square(wavelength_m: f32, side_m: f32) -> Self {
        let h = side_m / 2.0;
        Self {
            wavelength_m,
            antennas_m: [[h, h], [h, -h], [-h, -h], [-h, h]],
            channel_gain: None,
            require_calibration: false,
        }
    }

    /// Checks the geometry.
    ///
    /// # Errors
    /// `wavelength_m` outside 1 mm..10 m; `side_m` where two neighbours are 0.5 wavelength or more apart or closer than
    /// 0.02; `antennas_m` where the positions are not finite or lie on one line; `channel_gain` that is zero or not finite.
    pub fn build(&self) -> Result<Array, ConfigError> {
        let wavelength_m = check("wavelength_m", self.wavelength_m, 1e-3, 10.0)?;
        for coordinate in self.antennas_m.iter().flatten() {
            check("antennas_m", *coordinate, -10.0, 10.0)?;
        }
        let mean = |axis: usize| self.antennas_m.iter().map(|p| p[axis]).sum::<f32>() / CHANNELS as f32;
        let centre = [mean(0), mean(1)];
        let wavenumber = core::f32::consts::TAU / wavelength_m;
        let steering = self.antennas_m.map(|p| [wavenumber * (p[0] - centre[0]), wavenumber * (p[1] - centre[1])]);

        // Neighbours around the array, in order: the sides whose length decides about ambiguity.
        let mut side_m = 0.0_f32;
        for (a, b) in self.antennas_m.iter().zip(self.antennas_m.iter().cycle().skip(1)) {
            let length = libm::sqrtf((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]));
            side_m = if length > side_m { length } else { side_m };
        }
        let side = side_m / wavelength_m;
        if side >= SIDE_REFUSED {
            let why =
                Why::Inconsistent("antennas half a wavelength or more apart cannot tell opposite directions apart");
            return Err(ConfigError { field: "side_m", value: side_m, why });
        }
        if side < 0.02 {
            let why = Why::Inconsistent("antennas closer than 0.02 wavelength measure no angle");
            return Err(ConfigError { field: "side_m", value: side_m, why });
        }
        let [xx, xy, yy] = steering.iter().fold([0.0; 3], |[xx, xy, yy], [x, y]| [xx + x * x, xy + x * y, yy + y * y]);
        if xx * yy - xy * xy < 1e-3 * (xx + yy) * (xx + yy) {
            let why = Why::Inconsistent("the antennas lie on one line and see only half of the circle");
            return Err(ConfigError { field: "antennas_m", value: side_m, why });
        }

        let mut correction = [Complex { re: 1.0, im: 0.0 }; CHANNELS];
        if let Some(gains) = self.channel_gain {
            for (inverse, gain) in correction.iter_mut().zip(gains) {
                let power = check("channel_gain", gain.norm_squared(), 1e-6, 1e6)?;
                *inverse = Complex { re: gain.re / power, im: -gain.im / power };
            }
        }
        Ok(Array {
            steering,
            wavenumber,
            closure: closure(&steering),
            side_wavelengths: side,
            correction,
            calibrated: self.channel_gain.is_some(),
            require_calibration: self.require_calibration,
        })
    }
}

/// The checked array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Array {
    /// Positions from their centroid times the wavenumber, `[forward, right]`: radians of phase per unit of direction.
    pub steering: [[f32; 2]; CHANNELS],
    /// Free-space wavenumber, radians a metre.
    pub wavenumber: f32,
    /// The one combination of the four phases in which every plane wave cancels; largest element 1. On the square it is
    /// `1, -1, 1, -1`.
    pub closure: [f32; CHANNELS],
    /// Longest distance between neighbours, in wavelengths.
    pub side_wavelengths: f32,
    correction: [Complex; CHANNELS],
    calibrated: bool,
    require_calibration: bool,
}

/// The null vector of `[1; x; y]`: signed areas of the triangles that remain when one antenna is left out.
fn closure(p: &[[f32; 2]; CHANNELS]) -> [f32; CHANNELS] {
    let area = |a: usize, b: usize, c: usize| {
        (p[b][0] - p[a][0]) * (p[c][1] - p[a][1]) - (p[c][0] - p[a][0]) * (p[b][1] - p[a][1])
    };
    let areas = [area(1, 2, 3), -area(0, 2, 3), area(0, 1, 3), -area(0, 1, 2)];
    let largest = areas.iter().fold(0.0_f32, |a, b| if libm::fabsf(*b) > a { libm::fabsf(*b) } else { a });
    let scale = if areas[0] < 0.0 { -largest } else { largest };
    areas.map(|area| area / scale)
}

impl Array {
    /// Takes the channels' own gains and phases out of a set of phasors.
    #[must_use]
    pub fn correct(&self, z: &[Complex; CHANNELS]) -> [Complex; CHANNELS] {
        core::array::from_fn(|m| z[m].times(self.correction[m]))
    }

    /// Power gain of that correction, by which noise variances grow.
    #[must_use]
    pub fn correction_power(&self, channel: usize) -> f32 {
        self.correction[channel].norm_squared()
    }

    /// Whether a calibration is demanded and missing.
    #[must_use]
    pub fn is_uncalibrated(&self) -> bool {
        self.require_calibration && !self.calibrated
    }

    /// Whether the side is so close to half a wavelength that noise turns some bearings round.
    #[must_use]
    pub fn is_nearly_ambiguous(&self) -> bool {
        self.side_wavelengths > SIDE_WARNED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_wavelength_is_refused_by_name() {
        assert_eq!(Config::square(0.345, 0.1725).build().unwrap_err().field, "side_m");
        assert_eq!(Config::square(0.345, 0.5 * 0.345).build().unwrap_err().field, "side_m");
        assert!(Config::square(0.345, 0.49 * 0.345).build().unwrap().is_nearly_ambiguous());
        assert!(!Config::default().build().unwrap().is_nearly_ambiguous());
    }

    #[test]
    fn the_closure_cancels_every_plane_wave() {
        let skewed = [[0.05, 0.06], [0.07, -0.05], [-0.04, -0.06], [-0.06, 0.04]];
        for config in [Config::default(), Config { antennas_m: skewed, ..Config::default() }] {
            let array = config.build().unwrap();
            for (a, b, c) in [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3, -2.0, 0.7)] {
                let sum: f32 =
                    array.closure.iter().zip(array.steering).map(|(k, p)| k * (a + b * p[0] + c * p[1])).sum();
                assert!(sum.abs() < 1e-5, "{sum}");
            }
        }
        assert_eq!(
            Config::default().build().unwrap().closure.map(|c| (c * 1e4) as i32),
            [10_000, -10_000, 10_000, -10_000]
        );
    }

    #[test]
    fn bad_geometry_is_refused_by_name() {
        assert_eq!(Config::square(f32::NAN, 0.1).build().unwrap_err().field, "wavelength_m");
        assert_eq!(Config::square(0.345, 0.0).build().unwrap_err().field, "side_m");
        assert_eq!(Config::square(0.345, f32::INFINITY).build().unwrap_err().field, "antennas_m");
        let line = Config { antennas_m: [[0.0, 0.0], [0.04, 0.0], [0.08, 0.0], [0.12, 0.0]], ..Config::default() };
        assert_eq!(line.build().unwrap_err().field, "antennas_m");
        let dead = Config { channel_gain: Some([Complex::default(); 4]), ..Config::default() };
        assert_eq!(dead.build().unwrap_err().field, "channel_gain");
    }
}
