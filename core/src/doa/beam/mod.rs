//! A beam turned over all directions of a flat array of 2 to 8 antennas, and where it hears most.
//!
//! The source is taken to be at the array's height. Power of the beam is `a' R a` with the steering vector `a` of a
//! direction and the covariance `R` of the antennas: of one packet, of several, or over the bins of a band. For one source in
//! white noise its maximum is the direction of most likelihood, whatever is sent.
//!
//! - Any plane geometry: where antennas are half a wavelength apart and more, other directions may fit as well. These
//!   are counted, not refused: see [`Peak::rivals`].
//! - On a **line** every direction has a mirror image that fits exactly: [`Beam::mirror_rad`].
//!
//! Not flown: no benchmark row counts it.

use core::f32::consts::TAU;

use crate::base::adc::ANTENNAS_MAX;
use crate::base::error::{ConfigError, Why, check};
use crate::base::math::sqrt;
use crate::base::units::{between, sin_cos, wrap_pi};
use crate::doa::bearing::Bearing;
use crate::signal::phase::Complex;

mod covariance;
mod source;

pub use covariance::Covariance;
pub use source::Source;

/// One complex number for each antenna; zero where there is none.
pub type Vector = [Complex; ANTENNAS_MAX];

/// Directions that the beam is turned to before the best is refined.
const DIRECTIONS: usize = 72;
/// Farthest that an antenna may be from the middle of all, in wavelengths: beyond it, the beam is so narrow that it would
/// fall between two directions.
pub const REACH_MAX_WAVELENGTHS: f32 = 3.0;
/// Two antennas closer than this, in wavelengths, are one.
const APART_MIN_WAVELENGTHS: f32 = 0.02;
/// Most directions that are counted beside the best.
pub const RIVALS: usize = 8;
/// How near to the mirror image a peak must be to be it: one and a half steps of the table.
const MIRROR_RAD: f32 = 1.5 * TAU / DIRECTIONS as f32;

/// Where the antennas are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Wavelength of the carrier.
    pub wavelength_m: f32,
    /// Antenna positions, `[forward, right]`, any common offset.
    pub antennas_m: [[f32; 2]; ANTENNAS_MAX],
    /// How many of these are in use, 2 to [`ANTENNAS_MAX`].
    pub count: usize,
}

/// The array, checked, with its steering vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Beam {
    /// Positions from their centroid times the wavenumber: radians of phase per unit of direction.
    steering: [[f32; 2]; ANTENNAS_MAX],
    count: usize,
    table: [Vector; DIRECTIONS],
    /// Direction of the line that the antennas are on, if they are.
    line_rad: Option<f32>,
}

/// Where the beam hears most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Azimuth from the nose, clockwise positive.
    pub azimuth_rad: f32,
    /// Share of all power that a plane wave from there explains, 0..=1.
    pub share: f32,
    /// The same of further maxima, largest first, zero where there are no more; the mirror image on a line is none of them.
    pub rivals: [f32; RIVALS],
    /// Sum over the antennas of the squared change of phase with azimuth, less its mean: how sharply the array sees there.
    pub sensitivity: f32,
    /// Antennas that take part.
    pub antennas: usize,
}

/// A bearing, and what else it may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// The bearing.
    pub bearing: Bearing,
    /// On a line, the direction that fits as well; a bearing with one is flagged [`Flags::AMBIGUOUS`](crate::doa::bearing::Flags::AMBIGUOUS) and valid.
    pub mirror_rad: Option<f32>,
    /// How many directions fit nearly as well; the mirror is one.
    pub ambiguities: u8,
}

impl From<Bearing> for Arrival {
    /// A bearing that could be nothing else.
    fn from(bearing: Bearing) -> Self {
        Self { bearing, mirror_rad: None, ambiguities: 0 }
    }
}

impl Config {
    /// Checks the geometry and computes the steering vectors.
    ///
    /// # Errors
    /// `wavelength_m` outside 1 mm..1 km; `antennas_m` that are fewer than two or more than eight, not finite, more than
    /// [`REACH_MAX_WAVELENGTHS`] from their middle, or two of them in one place.
    pub fn build(&self) -> Result<Beam, ConfigError> {
        let wavelength_m = check("wavelength_m", self.wavelength_m, 1e-3, 1e3)?;
        check("antennas_m", self.count as f32, 2.0, ANTENNAS_MAX as f32)?;
        let antennas_m = self.antennas_m.get(..self.count).unwrap_or_default();
        let farthest_m = REACH_MAX_WAVELENGTHS * wavelength_m;
        for coordinate in antennas_m.iter().flatten() {
            check("antennas_m", *coordinate, -1e4, 1e4)?;
        }
        let share = 1.0 / self.count as f32;
        let centre = antennas_m.iter().fold([0.0; 2], |[x, y], p| [x + share * p[0], y + share * p[1]]);
        let wavenumber = TAU / wavelength_m;
        let mut beam = Beam {
            steering: [[0.0; 2]; ANTENNAS_MAX],
            count: self.count,
            table: [[Complex::default(); ANTENNAS_MAX]; DIRECTIONS],
            line_rad: None,
        };
        for (k, (steering, p)) in beam.steering.iter_mut().zip(antennas_m).enumerate() {
            let from_centre_m = [p[0] - centre[0], p[1] - centre[1]];
            check("antennas_m", length(from_centre_m), 0.0, farthest_m)?;
            *steering = from_centre_m.map(|coordinate_m| wavenumber * coordinate_m);
            for other in antennas_m.iter().skip(k + 1) {
                let apart_m = length([p[0] - other[0], p[1] - other[1]]);
                if apart_m < APART_MIN_WAVELENGTHS * wavelength_m {
                    let why = Why::Inconsistent("antennas closer than 0.02 wavelength measure no angle");
                    return Err(ConfigError { field: "antennas_m", value: apart_m, why });
                }
            }
        }
        let moments = beam.steering.iter().fold([0.0; 3], |[a, b, c], [x, y]| [a + x * x, b + x * y, c + y * y]);
        let [xx, xy, yy] = moments;
        if xx * yy - xy * xy < 1e-3 * (xx + yy) * (xx + yy) {
            beam.line_rad = Some(0.5 * libm::atan2f(2.0 * xy, xx - yy));
        }
        let mut table = beam.table;
        for (k, vector) in table.iter_mut().enumerate() {
            *vector = beam.toward(k as f32 * (TAU / DIRECTIONS as f32));
        }
        beam.table = table;
        Ok(beam)
    }
}

fn length([x, y]: [f32; 2]) -> f32 {
    sqrt(x * x + y * y)
}

impl Beam {
    /// Number of antennas.
    #[must_use]
    pub fn antennas(&self) -> usize {
        self.count
    }

    /// What a plane wave from this azimuth makes of the antennas; each of length one.
    #[must_use]
    pub fn toward(&self, azimuth_rad: f32) -> Vector {
        let (sine, cosine) = sin_cos(azimuth_rad);
        let mut vector = Vector::default();
        for (z, [x, y]) in vector.iter_mut().zip(self.steering).take(self.count) {
            *z = Complex::at(x * cosine + y * sine);
        }
        vector
    }

    /// The direction that an array on a line cannot tell from this one; none where the antennas are not on a line, and
    /// along the line.
    #[must_use]
    pub fn mirror_rad(&self, azimuth_rad: f32) -> Option<f32> {
        let mirror_rad = wrap_pi(2.0 * self.line_rad? - azimuth_rad);
        (libm::fabsf(wrap_pi(mirror_rad - azimuth_rad)) > 1e-3).then_some(mirror_rad)
    }

    /// The power of the strongest of the directions in the table over the covariance's weight: the number of antennas when a
    /// plane wave from there explains phasors of length one.
    #[must_use]
    pub fn strongest(&self, covariance: &Covariance) -> f32 {
        let antennas = covariance.trace();
        let most = self.table.iter().map(|vector| covariance.power(vector)).fold(0.0, f32::max);
        if antennas > 0.0 { most / antennas } else { 0.0 }
    }

    /// Where the power of a covariance is largest; `None` when fewer than two antennas hear anything.
    #[must_use]
    pub fn find(&self, covariance: &Covariance) -> Option<Peak> {
        let antennas = covariance.living();
        let total = covariance.trace() * antennas as f32;
        if antennas < 2 || !(total > 0.0) || !total.is_finite() {
            return None;
        }
        let mut powers = [0.0_f32; DIRECTIONS];
        for (power, vector) in powers.iter_mut().zip(&self.table) {
            *power = covariance.power(vector);
        }
        let (mut best, mut most) = (0, f32::MIN);
        for (k, power) in powers.iter().enumerate() {
            (best, most) = if *power > most { (k, *power) } else { (best, most) };
        }
        let azimuth_rad = self.refined(covariance, best as f32 * (TAU / DIRECTIONS as f32));
        let mut peak = Peak {
            azimuth_rad: wrap_pi(azimuth_rad),
            share: (covariance.power(&self.toward(azimuth_rad)) / total).min(1.0),
            rivals: [0.0; RIVALS],
            sensitivity: self.sensitivity(azimuth_rad, covariance),
            antennas,
        };
        let before = powers.iter().cycle().skip(DIRECTIONS - 1);
        let behind = powers.iter().cycle().skip(1);
        for (k, ((power, before), behind)) in powers.iter().zip(before).zip(behind).enumerate() {
            let away_rad = k as f32 * (TAU / DIRECTIONS as f32) - azimuth_rad;
            let is_other = |rad: f32| libm::fabsf(wrap_pi(rad)) > MIRROR_RAD;
            let is_no_mirror =
                self.mirror_rad(azimuth_rad).is_none_or(|mirror_rad| is_other(azimuth_rad + away_rad - mirror_rad));
            if power >= before && power > behind && is_other(away_rad) && is_no_mirror {
                let near_rad = self.refined(covariance, azimuth_rad + away_rad);
                peak.note(covariance.power(&self.toward(near_rad)) / total);
            }
        }
        Some(peak)
    }

    /// The maximum near a direction of the table: a parabola through three points, twice, nearer the second time.
    fn refined(&self, covariance: &Covariance, azimuth_rad: f32) -> f32 {
        let mut azimuth_rad = azimuth_rad;
        for reach_rad in [0.5 * TAU / DIRECTIONS as f32, 0.005, 0.005] {
            let power = |away_rad: f32| covariance.power(&self.toward(azimuth_rad + away_rad));
            let (before, here, behind) = (power(-reach_rad), power(0.0), power(reach_rad));
            let bend = before - 2.0 * here + behind;
            if bend < 0.0 {
                azimuth_rad += reach_rad * between(0.5 * (before - behind) / bend, -1.0, 1.0);
            }
        }
        azimuth_rad
    }

    /// See [`Peak::sensitivity`].
    fn sensitivity(&self, azimuth_rad: f32, covariance: &Covariance) -> f32 {
        let (sine, cosine) = sin_cos(azimuth_rad);
        let (mut sum, mut squares, mut count) = (0.0_f32, 0.0_f32, 0.0_f32);
        for (k, [x, y]) in self.steering.iter().enumerate().take(self.count) {
            if covariance.lives(k) {
                let slope = y * cosine - x * sine;
                (sum, squares, count) = (sum + slope, squares + slope * slope, count + 1.0);
            }
        }
        if count > 0.0 { (squares - sum * sum / count).max(0.0) } else { 0.0 }
    }
}

impl Peak {
    /// Puts a further maximum in its place.
    fn note(&mut self, share: f32) {
        let mut share = share;
        for rival in &mut self.rivals {
            if share > *rival {
                core::mem::swap(rival, &mut share);
            }
        }
    }

    /// Mean squared phase, over the antennas, that a plane wave from the peak leaves unexplained, in noise and reflections
    /// that turn phases only.
    #[must_use]
    pub fn misfit(&self) -> f32 {
        misfit(self.share)
    }

    /// How many further directions leave a misfit below a limit.
    #[must_use]
    pub fn ambiguities(&self, limit: f32) -> u8 {
        self.rivals.iter().filter(|share| **share > 0.0 && misfit(**share) < limit).count() as u8
    }
}

/// Phases with a small variance `v` about a plane wave have a share of `1 - v`: more exactly `(1 - v/2)^2`.
fn misfit(share: f32) -> f32 {
    2.0 * (1.0 - sqrt(between(share, 0.0, 1.0)))
}

#[cfg(test)]
mod tests;
