//! A beam turned over all directions of a flat array of 2 to 8 antennas, and where it hears most.
//!
//! The source is taken to be at the array's height. Power of the beam is `a' R a` with the steering vector `a` of a
//! direction and the covariance `R` of the antennas: of one packet, of several, or over the bins of a band. For one source in
//! white noise its maximum is the direction of most likelihood, whatever is sent.
//!
//! - Any plane geometry: where antennas are half a wavelength apart and more, other directions may fit as well. These
//!   are counted, not refused: see [`Peak::rivals`].
//! - On a **line** every direction has a mirror image that fits exactly: [`Peak::mirror_rad`].
//!
//! The table has as many directions as the array is sharp. The best is refined by a parabola and Newton's steps.
//!
//! The image of `cargo xtask flash --iq` flies by the beam of one packet's phasors. Its bench row is `beam_36`.

use core::f32::consts::TAU;

use crate::base::adc::ANTENNAS_MAX;
use crate::base::error::{ConfigError, Why, check};
use crate::base::math::sqrt;
use crate::base::units::{between, sin_cos, whole_below, wrap_pi};
use crate::doa::bearing::Bearing;
use crate::signal::phase::Complex;

mod covariance;
mod scan;

pub use covariance::Covariance;
pub use scan::Scan;

/// One complex number for each antenna; zero where there is none.
pub type Vector = [Complex; ANTENNAS_MAX];

/// Most directions that the beam is turned to before the best is refined, and fewest.
const DIRECTIONS: usize = 72;
const DIRECTIONS_MIN: usize = 24;
/// By how much the phase of the outermost antenna changes from one direction to the next, if there may be so many.
const STEP_RAD: f32 = 0.68;
/// Farthest that an antenna may be from the middle of all, in wavelengths: beyond it, the beam is so narrow that it would
/// fall between two directions.
pub const REACH_MAX_WAVELENGTHS: f32 = 3.0;
/// Two antennas closer than this, in wavelengths, are one.
const APART_MIN_WAVELENGTHS: f32 = 0.02;
/// Most directions that are counted beside the best.
pub const RIVALS: usize = 8;
/// Antennas are on a line if the product of their two moments is less than this share of the squared sum: an array ten times as
/// long as wide tells hardly more.
const LINE: f32 = 1e-2;
/// How near to the mirror image a peak must be to be it, in steps of the table.
const MIRROR_STEPS: f32 = 1.5;

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
    /// Largest of them.
    reach: f32,
    table: [Vector; DIRECTIONS],
    /// How many directions of the table are in use, and from one to the next.
    directions: usize,
    step_rad: f32,
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
    /// The direction that fits as well, if those are on a line.
    pub mirror_rad: Option<f32>,
}

/// A bearing, and what else it may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// The bearing.
    pub bearing: Bearing,
    /// On a line, the direction that fits as well; a bearing with one is flagged [`Flags::AMBIGUOUS`](crate::doa::bearing::Flags::AMBIGUOUS) and valid.
    pub mirror_rad: Option<f32>,
    /// How many directions, and offsets of an array behind a switch, fit nearly as well; the mirror is one.
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
        let mut beam = Beam::EMPTY;
        self.build_in(&mut beam).map(|()| beam)
    }

    /// The same in place: a stack may have no room for it.
    ///
    /// # Errors
    /// As above; the beam is of no use then.
    pub fn build_in(&self, beam: &mut Beam) -> Result<(), ConfigError> {
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
        (beam.count, beam.reach) = (self.count, 0.0);
        beam.steering = [[0.0; 2]; ANTENNAS_MAX];
        for (k, (steering, p)) in beam.steering.iter_mut().zip(antennas_m).enumerate() {
            let from_centre_m = [p[0] - centre[0], p[1] - centre[1]];
            check("antennas_m", length(from_centre_m), 0.0, farthest_m)?;
            *steering = from_centre_m.map(|coordinate_m| wavenumber * coordinate_m);
            beam.reach = beam.reach.max(length(*steering));
            for other in antennas_m.iter().skip(k + 1) {
                let apart_m = length([p[0] - other[0], p[1] - other[1]]);
                if apart_m < APART_MIN_WAVELENGTHS * wavelength_m {
                    let why = Why::Inconsistent("antennas closer than 0.02 wavelength measure no angle");
                    return Err(ConfigError { field: "antennas_m", value: apart_m, why });
                }
            }
        }
        let wanted = whole_below(TAU * beam.reach / STEP_RAD) as usize + 1;
        beam.directions = wanted.clamp(DIRECTIONS_MIN, DIRECTIONS);
        beam.step_rad = TAU / beam.directions as f32;
        for k in 0..beam.directions {
            let toward = beam.toward(k as f32 * beam.step_rad);
            if let Some(vector) = beam.table.get_mut(k) {
                *vector = toward;
            }
        }
        Ok(())
    }
}

fn length([x, y]: [f32; 2]) -> f32 {
    sqrt(x * x + y * y)
}

impl Beam {
    /// Of no antennas, to be built.
    pub const EMPTY: Self = Self {
        steering: [[0.0; 2]; ANTENNAS_MAX],
        count: 0,
        reach: 0.0,
        table: [[Complex { re: 0.0, im: 0.0 }; ANTENNAS_MAX]; DIRECTIONS],
        directions: 0,
        step_rad: 0.0,
    };

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

    /// Refuses an array on a line: nothing tells its bearings from their mirror images, so it is no array to fly by.
    ///
    /// # Errors
    /// `antennas_m` on a line.
    pub fn refuse_line(&self) -> Result<(), ConfigError> {
        let why = Why::Inconsistent("antennas on a line: nothing tells a bearing from its mirror image");
        self.line_rad(|_| true)
            .map_or(Ok(()), |_| Err(ConfigError { field: "antennas_m", value: self.count as f32, why }))
    }

    /// Direction of the line that the antennas that are heard are on, if they are.
    fn line_rad(&self, lives: impl Fn(usize) -> bool) -> Option<f32> {
        let heard = || self.steering.iter().take(self.count).enumerate().filter(|(k, _)| lives(*k)).map(|(_, p)| *p);
        let (count, sum) = heard().fold((0.0_f32, [0.0; 2]), |(n, [a, b]), [x, y]| (n + 1.0, [a + x, b + y]));
        let [xx, xy, yy] = heard()
            .map(|[x, y]| [x - sum[0] / count, y - sum[1] / count])
            .fold([0.0; 3], |[a, b, c], [x, y]| [a + x * x, b + x * y, c + y * y]);
        (xx * yy - xy * xy < LINE * (xx + yy) * (xx + yy)).then(|| 0.5 * libm::atan2f(2.0 * xy, xx - yy))
    }

    /// The direction that antennas on a line cannot tell from this one; none where those that are heard are not on a line, and
    /// along the line.
    fn mirror_rad(&self, azimuth_rad: f32, lives: impl Fn(usize) -> bool) -> Option<f32> {
        let mirror_rad = wrap_pi(2.0 * self.line_rad(lives)? - azimuth_rad);
        (libm::fabsf(wrap_pi(mirror_rad - azimuth_rad)) > 1e-3).then_some(mirror_rad)
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
