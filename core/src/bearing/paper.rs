//! The estimators of the main paper, to the letter: the baselines that ours is measured against.
//!
//! Equation numbers are the main paper's. Its frame is used inside: `x` forward, `y` left, angles anticlockwise, antennas
//! A1 `(d, -d)`, A2 `(d, d)`, A3 `(-d, d)`, A4 `(-d, -d)` on the square (eq. 18-19), in metres from their centroid. What
//! comes out is ours: azimuth clockwise from the nose.
//!
//! | [`Estimator`] | after | what it is |
//! |---|---|---|
//! | `Pair` | eq. 2 | the arcsine of A1A2; its side by cross-correlation with A4 and A3 |
//! | `PaperSquare` | eq. 29-30, Algorithm 1 | the cotangent rule; half-plane where `theta1 > theta2`, as printed |
//! | `PaperRepaired` | the same | half-plane where `abs theta1 > abs theta2`, as meant |
//! | `PaperCorrelated` | the same | half-plane by cross-correlation, the alternative that section II-B names |
//! | `TwoArray` | eq. 6-17, 50, appendix B | where the directions of A1A2 and A3A4 cross; any positions |
//! | `ThreeAntenna` | eq. 51 | the same with A2 = A3 |
//! | `NArray` | appendix C, end | the least-squares crossing of all neighbouring pairs |
//!
//! **Eq. 2.** A pair `i j` hears `sin theta = phi lambda / (2 pi |r_j - r_i|)`, where `phi` is the lead of `j` over `i` and
//! `theta` is seen from the pair's normal. Outside its domain the sine is clamped to 1. The arcsine cannot tell the two
//! sides of the pair apart: the source is at `s = sin theta e + cos theta n` or at its mirror image, `e` along the pair
//! and `n` across it.
//!
//! **Cross-correlation.** "Which antenna receives the signal first": the lag between the pair and the others, less what
//! `theta` explains, has the sign of `cos theta`. On the square it is the sign of the lag of A4 after A1 and A3 after A2.
//!
//! **Outcomes.** What a system of equations can do is an [`Outcome`]. A bearing keeps the azimuth of every outcome that
//! has one, but is `valid` only where the paper gives a direction to fly: `Solved`, and both singular cases, of which
//! eq. 50 says that either direction will do. `NegativeScale` and `Undefined` are `AMBIGUOUS`.
//!
//! The paper has no measure of its errors. Sigma, closure, elevation and flags of a bearing are those of our wavefront
//! fit: what the array allows, and less than what these estimators make of it. They assume a source at our height, lose
//! precision as `1 / cos theta` to the sides, and the crossings have `det A ~ s sin(beta) / R`, which vanishes with range.

use super::Estimator;
use crate::adc::CHANNELS;
use crate::array::{self, Array};
use crate::phase::Complex;
use crate::units::wrap_pi;

/// Directions closer than this are parallel, `det A = 0`: what rounding makes of parallel ones.
const PARALLEL: f32 = 4e-6;
/// Parallel directions this close to the line between the midpoints, as a sine, lie on it.
const COLLINEAR: f32 = 1e-3;
/// Pairs this close to parallel, as a sine, violate eq. 5.
const PAIRS_PARALLEL: f32 = 1e-3;
/// Smallest sine whose cotangent is taken.
const SINE_MIN: f32 = 1e-6;
/// Shortest pair, and least distance between midpoints, in radians of phase.
const PAIR_MIN_RAD: f32 = 1e-3;

/// A constraint on the positions of the antennas that is not met.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Violation {
    /// Eq. 3: the antennas of a pair are more than half a wavelength apart.
    Spacing {
        /// Antennas of the pair, 0..4.
        pair: [u8; 2],
        /// Their distance in wavelengths.
        wavelengths: f32,
    },
    /// Eq. 4: the positions do not add up to zero.
    Unbalanced {
        /// Length of their sum.
        sum_m: f32,
    },
    /// Eq. 5: the two pairs are parallel. The paper's own square is.
    Parallel,
}

/// Checks arbitrary positions against eq. 3, 4 and 5, in this order, for the pairs A1A2 and A3A4.
///
/// The paper's estimators work without: eq. 4 is about the vehicle's balance, and parallel pairs cross at a near source all
/// the same.
pub fn constraints(config: &array::Config) -> [Result<(), Violation>; 3] {
    let r = &config.antennas_m;
    let pairs = [subtract(r[1], r[0]), subtract(r[3], r[2])];
    let wavelengths = pairs.map(|pair| length(pair) / config.wavelength_m);
    let spacing = |n: usize, pair: [u8; 2]| {
        let met = wavelengths[n] <= 0.5 + 1e-6;
        if met { Ok(()) } else { Err(Violation::Spacing { pair, wavelengths: wavelengths[n] }) }
    };
    let sum_m = length(r.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]));
    let balanced = sum_m <= 1e-4 * config.wavelength_m;
    let crossed = libm::fabsf(cross(pairs[0], pairs[1])) > PAIRS_PARALLEL * length(pairs[0]) * length(pairs[1]);
    [
        spacing(0, [0, 1]).and(spacing(1, [2, 3])),
        if balanced { Ok(()) } else { Err(Violation::Unbalanced { sum_m }) },
        if crossed { Ok(()) } else { Err(Violation::Parallel) },
    ]
}

/// Whether the antennas are the paper's square (eq. 18-19), in its order, within 5 % of half its side.
#[must_use]
pub fn is_square(array: &Array) -> bool {
    let p = &array.steering;
    let h = 0.25 * (p[0][0] + p[1][0] - p[2][0] - p[3][0]);
    let square = [[h, h], [h, -h], [-h, -h], [-h, h]];
    p.iter().flatten().zip(square.iter().flatten()).all(|(is, ideal)| libm::fabsf(is - ideal) <= 0.05 * h)
}

/// What an estimator of the paper arrived at. Azimuths are from the nose, clockwise positive, (-pi, pi].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Outcome {
    /// A direction; with its range where the directions of several pairs cross (eq. 17).
    Solved {
        /// Direction of the source.
        azimuth_rad: f32,
        /// Its distance from the centroid of the antennas.
        range_m: Option<f32>,
    },
    /// `det A = 0` and no solution: parallel directions, the source is far away (eq. 50).
    AtInfinity {
        /// Direction of A1A2.
        azimuth_rad: f32,
    },
    /// `det A = 0` and any number of solutions: the source is in line with the midpoints of the pairs (eq. 50).
    Collinear {
        /// Direction of A1A2.
        azimuth_rad: f32,
    },
    /// The directions diverge and cross behind a pair (appendix B): no source does this, noise does.
    NegativeScale {
        /// Direction of A1A2, not of the crossing.
        azimuth_rad: f32,
    },
    /// No direction: a pair has a dead antenna or no length, or the pairs contradict each other.
    Undefined,
}

impl Outcome {
    /// The azimuth, where there is one.
    #[must_use]
    pub fn azimuth_rad(self) -> Option<f32> {
        match self {
            Self::Solved { azimuth_rad, .. }
            | Self::AtInfinity { azimuth_rad }
            | Self::Collinear { azimuth_rad }
            | Self::NegativeScale { azimuth_rad } => Some(azimuth_rad),
            Self::Undefined => None,
        }
    }

    /// Whether the paper would fly there.
    #[must_use]
    pub fn is_usable(self) -> bool {
        matches!(self, Self::Solved { .. } | Self::AtInfinity { .. } | Self::Collinear { .. })
    }
}

/// Runs an estimator of the paper on phasors that are corrected for their channels' gains; `None` for one that is not the
/// paper's.
#[must_use]
#[inline(never)]
pub fn solve(
    estimator: Estimator,
    array: &Array,
    z: &[Complex; CHANNELS],
    living: [bool; CHANNELS],
) -> Option<Outcome> {
    let antennas = Antennas::new(array, z, living);
    let outcome = match estimator {
        Estimator::CrossSpectrum => return None,
        Estimator::Pair => antennas.pair(),
        Estimator::PaperSquare => antennas.square(HalfPlane::Printed),
        Estimator::PaperRepaired => antennas.square(HalfPlane::Magnitudes),
        Estimator::PaperCorrelated => antennas.square(HalfPlane::CrossCorrelation),
        Estimator::TwoArray => antennas.two_arrays(),
        Estimator::ThreeAntenna => antennas.three_antennas(),
        Estimator::NArray => antennas.all_neighbours(),
    };
    Some(outcome.unwrap_or(Outcome::Undefined))
}

/// How Algorithm 1, lines 1-6, finds the half-plane.
#[derive(Clone, Copy)]
enum HalfPlane {
    /// `theta1 > theta2`.
    Printed,
    /// `|theta1| > |theta2|`: the nearer pair sees the source farther to the side.
    Magnitudes,
    /// The side of A1A2 that the lags of A4 after A1 and of A3 after A2 tell.
    CrossCorrelation,
}

/// The lags that tell the side of A1A2, and of A3A4.
const ACROSS: [[usize; 2]; 2] = [[0, 3], [1, 2]];

/// The antennas and what they hear, in the paper's frame.
struct Antennas<'a> {
    position_m: [[f32; 2]; CHANNELS],
    wavenumber: f32,
    z: &'a [Complex; CHANNELS],
    living: [bool; CHANNELS],
}

/// What one pair hears, eq. 2.
#[derive(Clone, Copy)]
struct Angle {
    /// Eq. 6-7.
    midpoint_m: [f32; 2],
    /// Unit vector from the first antenna to the second.
    axis: [f32; 2],
    /// Sine of the angle from the normal: the arcsine itself would only be undone.
    sine: f32,
}

impl Angle {
    /// The normal of the pair: ahead for the pairs A1A2 and A4A3 of the square.
    fn normal(&self) -> [f32; 2] {
        [self.axis[1], -self.axis[0]]
    }

    /// Cosine of the angle, not negative, as that of an arcsine.
    fn cosine(&self) -> f32 {
        libm::sqrtf((1.0 - self.sine) * (1.0 + self.sine))
    }
}

/// A pair's midpoint and the direction it sees the source in.
#[derive(Clone, Copy, Debug)]
struct Ray {
    midpoint_m: [f32; 2],
    direction: [f32; 2],
}

impl<'a> Antennas<'a> {
    /// The door: from our frame, `[forward, right]` times the wavenumber, into the paper's.
    fn new(array: &Array, z: &'a [Complex; CHANNELS], living: [bool; CHANNELS]) -> Self {
        let position_m = array.steering.map(|p| [p[0] / array.wavenumber, -p[1] / array.wavenumber]);
        Self { position_m, wavenumber: array.wavenumber, z, living }
    }

    /// By how many metres `j` is nearer to the source than `i`; `None` with a dead one.
    fn lead_m(&self, i: usize, j: usize) -> Option<f32> {
        (self.living[i] && self.living[j]).then(|| self.z[j].times_conj(self.z[i]).arg() / self.wavenumber)
    }

    /// Eq. 2 for the pair `i j`.
    fn angle(&self, [i, j]: [usize; 2]) -> Option<Angle> {
        let (first, second) = (self.position_m[i], self.position_m[j]);
        let between = subtract(second, first);
        let spacing_m = length(between);
        if !(spacing_m * self.wavenumber > PAIR_MIN_RAD) {
            return None;
        }
        Some(Angle {
            midpoint_m: [0.5 * (first[0] + second[0]), 0.5 * (first[1] + second[1])],
            axis: [between[0] / spacing_m, between[1] / spacing_m],
            sine: (self.lead_m(i, j)? / spacing_m).clamp(-1.0, 1.0),
        })
    }

    /// Whether the source is on the side of the pair's normal, by the lags of others; `None` when none is heard.
    fn is_ahead(&self, angle: &Angle, lags: &[[usize; 2]]) -> Option<bool> {
        let normal = angle.normal();
        let mut sum = None;
        for [i, j] in lags {
            let Some(lead_m) = self.lead_m(*i, *j) else { continue };
            let baseline = subtract(self.position_m[*j], self.position_m[*i]);
            // What theta says is taken out; the rest is cos theta times the baseline's part across the pair.
            let rest = lead_m - angle.sine * dot(angle.axis, baseline);
            sum = Some(sum.unwrap_or(0.0) + dot(normal, baseline) * rest);
        }
        sum.map(|sum| sum >= 0.0)
    }

    /// The direction of a pair, on the side that others tell.
    fn ray(&self, pair: [usize; 2], lags: &[[usize; 2]]) -> Option<Ray> {
        let angle = self.angle(pair)?;
        let cosine = if self.is_ahead(&angle, lags)? { angle.cosine() } else { -angle.cosine() };
        let normal = angle.normal();
        let direction = core::array::from_fn(|n| angle.sine * angle.axis[n] + cosine * normal[n]);
        Some(Ray { midpoint_m: angle.midpoint_m, direction })
    }

    fn pair(&self) -> Option<Outcome> {
        let azimuth_rad = azimuth(self.ray([0, 1], &ACROSS)?.direction)?;
        Some(Outcome::Solved { azimuth_rad, range_m: None })
    }

    /// Algorithm 1. Both angles are seen from the nose (eq. 22-23), so the second pair is A4A3.
    fn square(&self, half_plane: HalfPlane) -> Option<Outcome> {
        let (one, two) = (self.angle([0, 1])?, self.angle([3, 2])?);
        let ahead = match half_plane {
            HalfPlane::Printed => one.sine > two.sine,
            HalfPlane::Magnitudes => libm::fabsf(one.sine) > libm::fabsf(two.sine),
            HalfPlane::CrossCorrelation => self.is_ahead(&one, &ACROSS)?,
        };
        let cotangent = |angle: &Angle| {
            let floor = if angle.sine < 0.0 { -SINE_MIN } else { SINE_MIN };
            angle.cosine() / if libm::fabsf(angle.sine) > SINE_MIN { angle.sine } else { floor }
        };
        // Eq. 30. The cotangent says left or right, the half-plane ahead or behind.
        let cotangent0 = 0.5 * (cotangent(&one) + cotangent(&two));
        let x = if ahead { libm::fabsf(cotangent0) } else { -libm::fabsf(cotangent0) };
        let y = if cotangent0 < 0.0 { -1.0 } else { 1.0 };
        Some(Outcome::Solved { azimuth_rad: azimuth([x, y])?, range_m: None })
    }

    fn two_arrays(&self) -> Option<Outcome> {
        let (one, two) = (self.ray([0, 1], &ACROSS)?, self.ray([2, 3], &ACROSS)?);
        // Directions from one midpoint cross there, whatever they are.
        let apart_rad = self.wavenumber * length(subtract(two.midpoint_m, one.midpoint_m));
        if apart_rad > PAIR_MIN_RAD { crossing(one, two) } else { None }
    }

    /// Eq. 51: the paper's A1, A2 = A3, A4 are three neighbours, A1 A2 A3 of ours or those that live.
    fn three_antennas(&self) -> Option<Outcome> {
        let left_out = self.living.iter().position(|lives| !lives).unwrap_or(CHANNELS - 1);
        let [first, corner, last] = [1, 2, 3].map(|n| (left_out + n) % CHANNELS);
        // The lag of A4 after A1, whose side is too long for eq. 3, goes by way of the corner.
        crossing(self.ray([first, corner], &[[corner, last]])?, self.ray([corner, last], &[[first, corner]])?)
    }

    /// Every pair of living neighbours is a linear array; those beside it tell its side.
    fn all_neighbours(&self) -> Option<Outcome> {
        let rays: [Option<Ray>; CHANNELS] = core::array::from_fn(|n| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| (n + k) % CHANNELS);
            self.ray([a, b], &[[b, c], [d, a]])
        });
        least_squares(rays.iter().flatten())
    }
}

/// Eq. 16-17 for the directions `one` of A1A2 and `two` of A3A4.
///
/// The rows of eq. 16, subtracted from each other, leave `k12 d12 - k34 d34 = r34 - r12`; the determinant stays.
fn crossing(one: Ray, two: Ray) -> Option<Outcome> {
    let between = subtract(two.midpoint_m, one.midpoint_m);
    let azimuth_rad = azimuth(one.direction)?;
    // On the square sin(theta1 - theta2), eq. 25.
    let determinant = cross(two.direction, one.direction);
    if !(libm::fabsf(determinant) > PARALLEL) {
        let same = dot(one.direction, two.direction) > 0.0;
        return same.then(|| eq_50(azimuth_rad, is_along(one.direction, between)));
    }
    let (k12, k34) = (cross(two.direction, between) / determinant, cross(one.direction, between) / determinant);
    if k12 < 0.0 || k34 < 0.0 {
        return Some(Outcome::NegativeScale { azimuth_rad });
    }
    let source_m = [one.midpoint_m[0] + k12 * one.direction[0], one.midpoint_m[1] + k12 * one.direction[1]];
    Some(Outcome::Solved { azimuth_rad: azimuth(source_m)?, range_m: Some(length(source_m)) })
}

/// Appendix C, end: the point with the least sum of squared distances from all directions.
///
/// It minimises `sum |r_n + k_n d_n - s|^2` over `s` and all `k_n`; with `k_n = d_n . (s - r_n)` the normal equations are
/// `sum (I - d_n d_n') s = sum (I - d_n d_n') r_n`. They are set up along and across the mean direction, where the small
/// angles between far-field directions are not lost in rounding.
fn least_squares<'r>(rays: impl Iterator<Item = &'r Ray> + Clone) -> Option<Outcome> {
    let first = rays.clone().next()?;
    let count = rays.clone().count() as f32;
    let sum = rays.clone().fold([0.0; 2], |sum, ray| [sum[0] + ray.direction[0], sum[1] + ray.direction[1]]);
    let agreement = length(sum);
    if count < 2.0 || !(agreement > 0.5 * count) {
        return None;
    }
    let along = [sum[0] / agreement, sum[1] / agreement];
    let azimuth_rad = azimuth(along)?;
    let (mut xx, mut xy, mut yy, mut right) = (0.0, 0.0, 0.0, [0.0; 2]);
    for ray in rays.clone() {
        let across = [-cross(along, ray.direction), dot(along, ray.direction)];
        let distance = across[0] * dot(along, ray.midpoint_m) + across[1] * cross(along, ray.midpoint_m);
        xx += across[0] * across[0];
        xy += across[0] * across[1];
        yy += across[1] * across[1];
        right = [right[0] + across[0] * distance, right[1] + across[1] * distance];
    }
    let determinant = xx * yy - xy * xy;
    // For two directions this is (det A / 2)^2, times 4.
    if !(determinant > 0.25 * PARALLEL * PARALLEL * count * count) {
        let on_line = |ray: &Ray| is_along(along, subtract(ray.midpoint_m, first.midpoint_m));
        return Some(eq_50(azimuth_rad, rays.clone().all(on_line)));
    }
    let local = [(right[0] * yy - right[1] * xy) / determinant, (right[1] * xx - right[0] * xy) / determinant];
    let source_m = [along[0] * local[0] - along[1] * local[1], along[1] * local[0] + along[0] * local[1]];
    if rays.clone().any(|ray| dot(ray.direction, subtract(source_m, ray.midpoint_m)) < 0.0) {
        return Some(Outcome::NegativeScale { azimuth_rad });
    }
    Some(Outcome::Solved { azimuth_rad: azimuth(source_m)?, range_m: Some(length(source_m)) })
}

/// Both cases of `det A = 0`.
fn eq_50(azimuth_rad: f32, collinear: bool) -> Outcome {
    if collinear { Outcome::Collinear { azimuth_rad } } else { Outcome::AtInfinity { azimuth_rad } }
}

/// Whether `v` lies along the unit vector `direction`, either way.
fn is_along(direction: [f32; 2], v: [f32; 2]) -> bool {
    libm::fabsf(cross(direction, v)) <= COLLINEAR * length(v)
}

/// The door out: anticlockwise with `y` to the left becomes clockwise; `None` for no direction.
fn azimuth([x, y]: [f32; 2]) -> Option<f32> {
    let angle_rad = wrap_pi(libm::atan2f(-y, x));
    (angle_rad.is_finite() && (x != 0.0 || y != 0.0)).then_some(angle_rad)
}

fn subtract(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

fn length(a: [f32; 2]) -> f32 {
    libm::sqrtf(dot(a, a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bearing::{Bearing, Config, Finder, Flags};
    use crate::phase::{Phasors, Tone};
    use crate::rng::Rng;
    use crate::time::Instant;
    use std::f64::consts::{PI, TAU};
    use std::vec::Vec;

    const ALL: [Estimator; 7] = [
        Estimator::PaperSquare,
        Estimator::PaperRepaired,
        Estimator::PaperCorrelated,
        Estimator::Pair,
        Estimator::TwoArray,
        Estimator::ThreeAntenna,
        Estimator::NArray,
    ];
    const SKEWED: [[f32; 2]; 4] = [[0.05, 0.06], [0.07, -0.05], [-0.055, -0.06], [-0.065, 0.05]];

    /// The default array with its antennas elsewhere.
    fn with(antennas_m: [[f32; 2]; 4]) -> array::Config {
        array::Config { antennas_m, ..array::Config::default() }
    }

    /// Distance in f64 from a source, given by azimuth clockwise from the nose, horizontal range and height, to each antenna.
    fn distances(config: &array::Config, azimuth_rad: f64, range_m: f64, height_m: f64) -> [f64; 4] {
        let mean = |n: usize| config.antennas_m.iter().map(|p| f64::from(p[n])).sum::<f64>() / 4.0;
        let source = [mean(0) + range_m * azimuth_rad.cos(), mean(1) + range_m * azimuth_rad.sin()];
        config.antennas_m.map(|p| {
            let [forward, right] = [source[0] - f64::from(p[0]), source[1] - f64::from(p[1])];
            (forward * forward + right * right + height_m * height_m).sqrt()
        })
    }

    /// An outgoing wave: what is nearer leads.
    fn wave(config: &array::Config, distances: [f64; 4]) -> [Complex; 4] {
        distances.map(|d| {
            let (sine, cosine) = (-TAU * d / f64::from(config.wavelength_m)).sin_cos();
            Complex { re: (1000.0 * cosine) as f32, im: (1000.0 * sine) as f32 }
        })
    }

    fn plane_wave(config: &array::Config, azimuth_rad: f64) -> [Complex; 4] {
        let (sine, cosine) = azimuth_rad.sin_cos();
        wave(config, config.antennas_m.map(|p| -(f64::from(p[0]) * cosine + f64::from(p[1]) * sine)))
    }

    fn phasors(z: [Complex; 4], noise: f32) -> Phasors {
        Phasors {
            time: Instant(0),
            z,
            noise: [noise; 4],
            snr_db: 20.0,
            frequency_hz: 1.0,
            tone: Tone::Present,
            clipped: false,
            interferer: false,
        }
    }

    fn finder(estimator: Estimator, config: &array::Config) -> Finder {
        Config { estimator, ..Config::default() }.build(config.build().unwrap()).unwrap()
    }

    fn solved(estimator: Estimator, config: &array::Config, z: [Complex; 4]) -> Outcome {
        solve(estimator, &config.build().unwrap(), &z, [true; 4]).unwrap()
    }

    fn error_deg(found: f32, truth: f64) -> f64 {
        let difference = f64::from(found) - truth;
        difference.sin().atan2(difference.cos()).to_degrees()
    }

    /// Gaussian elimination with pivoting, in f64, of as many equations as unknowns.
    fn linear(mut rows: Vec<Vec<f64>>) -> Vec<f64> {
        let n = rows.len();
        for column in 0..n {
            let pivot = (column..n).max_by(|a, b| rows[*a][column].abs().total_cmp(&rows[*b][column].abs())).unwrap();
            rows.swap(column, pivot);
            let pivot = rows[column].clone();
            for row in rows.iter_mut().enumerate().filter(|(n, _)| *n != column).map(|(_, row)| row) {
                let factor = row[column] / pivot[column];
                row.iter_mut().zip(&pivot).for_each(|(value, pivot)| *value -= factor * pivot);
            }
        }
        (0..n).map(|k| rows[k][n] / rows[k][k]).collect()
    }

    /// Eq. 29-30 in f64 from the distances alone, in the paper's frame, its answer turned into ours.
    fn rule_f64(config: &array::Config, d: [f64; 4], is_ahead: impl Fn(f64, f64) -> bool) -> f64 {
        let side = f64::from(config.antennas_m[0][1] - config.antennas_m[1][1]);
        let theta1 = ((d[0] - d[1]) / side).clamp(-1.0, 1.0).asin();
        let theta2 = ((d[3] - d[2]) / side).clamp(-1.0, 1.0).asin();
        let cotangent = 0.5 * (1.0 / theta1.tan() + 1.0 / theta2.tan());
        let angle = (1.0 / cotangent).atan();
        let theta0 = if is_ahead(theta1, theta2) { angle } else { angle.signum() * PI - angle };
        // Behind, the printed tangent leaves the sign of y: theta0 and its mirror image share it.
        -theta0
    }

    #[test]
    fn a_source_on_the_left_has_a_positive_angle_in_the_paper_and_a_negative_azimuth_here() {
        let config = array::Config::default();
        let z = wave(&config, distances(&config, -PI / 4.0, 5.0, 0.0));
        let array = config.build().unwrap();
        let antennas = Antennas::new(&array, &z, [true; 4]);
        // A2 of the paper is at (d, d), left, and nearer to this source than A1: it leads.
        assert!(antennas.position_m[1][0] > 0.0 && antennas.position_m[1][1] > 0.0);
        assert!(antennas.lead_m(0, 1).unwrap() > 0.0);
        assert!(antennas.angle([0, 1]).unwrap().sine > 0.5);
        for estimator in ALL {
            let azimuth_rad = solved(estimator, &config, z).azimuth_rad().unwrap();
            assert!(error_deg(azimuth_rad, -PI / 4.0).abs() < 1.5, "{estimator:?}: {azimuth_rad}");
        }
    }

    #[test]
    fn the_papers_circle_gives_the_numbers_of_an_independent_study() {
        // Noise-free, 5 m, 0.125 m wavelength, 360 directions: mean and largest error in degrees.
        let config = array::Config::square(0.125, 0.45 * 0.125);
        let run = |estimator, height_m: f64, is_ahead: &dyn Fn(f64, f64) -> bool| {
            let (mut sum, mut worst, mut apart) = (0.0, 0.0_f64, 0.0_f64);
            for step in 0..360 {
                let truth = (f64::from(step) + 0.5).to_radians();
                let d = distances(&config, truth, 5.0, height_m);
                let found = solved(estimator, &config, wave(&config, d)).azimuth_rad().unwrap();
                let error = error_deg(found, truth).abs();
                sum += error / 360.0;
                worst = worst.max(error);
                apart = apart.max(error_deg(found, rule_f64(&config, d, is_ahead)).abs());
            }
            assert!(apart < 0.01, "{estimator:?} at {height_m} m is {apart} deg from the same rule in f64");
            [sum, worst]
        };
        let printed = |one: f64, two: f64| one > two;
        let magnitudes = |one: f64, two: f64| one.abs() > two.abs();
        let near = |found: [f64; 2], mean: f64, worst: f64| {
            assert!(
                (found[0] - mean).abs() < 0.011 && (found[1] - worst).abs() < 0.06,
                "{found:?}, not {mean} {worst}"
            );
        };
        near(run(Estimator::PaperSquare, 0.0, &printed), 45.0, 179.0);
        near(run(Estimator::PaperSquare, 1.0, &printed), 47.01, 179.0);
        near(run(Estimator::PaperRepaired, 0.0, &magnitudes), 0.0, 0.0);
        near(run(Estimator::PaperRepaired, 0.5, &magnitudes), 0.635, 5.24);
        near(run(Estimator::PaperRepaired, 0.828, &magnitudes), 1.48, 8.92);
        near(run(Estimator::PaperRepaired, 1.0, &magnitudes), 2.01, 10.83);
        near(run(Estimator::PaperRepaired, 2.0, &magnitudes), 5.81, 21.31);
        // Without noise the cross-correlation finds the same half-planes.
        near(run(Estimator::PaperCorrelated, 0.828, &magnitudes), 1.48, 8.92);
        near(run(Estimator::PaperCorrelated, 2.0, &magnitudes), 5.81, 21.31);
    }

    #[test]
    fn in_noise_the_magnitudes_miss_the_half_plane_and_the_cross_correlation_does_not() {
        // The same study: 5 m, 20 dB, N = 256, 0.125 m: 49.6, 22.4 and 0.05 % wrong.
        let config = array::Config::square(0.125, 0.45 * 0.125);
        let sigma = libm::sqrtf(0.5 * 4.0 * (1000.0 * 1000.0 / 200.0) / 256.0);
        let mut rng = Rng::new(5, 0);
        let mut wrong = [0_i32; 3];
        for step in 0..8000 {
            let truth = f64::from(step) * TAU / 8000.0;
            let z = wave(&config, distances(&config, truth, 5.0, 0.0));
            let z = z.map(|c| Complex { re: c.re + sigma * rng.gaussian(), im: c.im + sigma * rng.gaussian() });
            for (count, estimator) in
                wrong.iter_mut().zip([Estimator::PaperSquare, Estimator::PaperRepaired, Estimator::PaperCorrelated])
            {
                // Where both arcsines are clamped the answer is the side itself, and in neither half.
                let found = solved(estimator, &config, z).azimuth_rad().unwrap();
                *count += i32::from(f64::from(found).cos() * truth.cos() < -1e-7);
            }
        }
        let [printed, magnitudes, correlated] = wrong.map(|count| f64::from(count) / 80.0);
        assert!((printed - 49.6).abs() < 2.0, "{printed} %");
        assert!((magnitudes - 22.4).abs() < 2.0, "{magnitudes} %");
        assert!(correlated < 0.2, "{correlated} %");
    }

    #[test]
    fn the_pair_and_the_crossings_find_a_near_source_on_any_array_and_the_crossings_its_range() {
        let square = array::Config::default();
        for (config, estimator, azimuth_deg, range_part) in [
            // The pair's direction is from its own midpoint, half a side ahead of the centroid.
            (square, Estimator::Pair, 0.85, 0.0),
            (square, Estimator::TwoArray, 0.02, 0.01),
            (square, Estimator::ThreeAntenna, 0.05, 0.05),
            (square, Estimator::NArray, 0.02, 0.05),
            (with(SKEWED), Estimator::Pair, 0.85, 0.0),
            (with(SKEWED), Estimator::TwoArray, 0.15, 0.05),
            (with(SKEWED), Estimator::ThreeAntenna, 0.15, 0.05),
            (with(SKEWED), Estimator::NArray, 0.15, 0.05),
        ] {
            let side = |n: usize| (config.antennas_m[n % 4], config.antennas_m[(n + 1) % 4]);
            let line = |a: [f32; 2], b: [f32; 2]| f64::from(b[1] - a[1]).atan2(f64::from(b[0] - a[0]));
            let middle = |n: usize| [side(n).0[0] + side(n).1[0], side(n).0[1] + side(n).1[1]];
            let mut bad: Vec<f64> = (0..4).map(|n| line(side(n).0, side(n).1)).collect();
            bad.extend([(0, 1), (0, 2), (1, 2), (1, 3), (2, 3), (3, 0)].map(|(n, m)| line(middle(n), middle(m))));
            let mut answered = 0;
            for step in 0..360 {
                let truth = (f64::from(step) + 0.5).to_radians();
                let d = distances(&config, truth, 5.0, 0.0);
                // To the sides of a pair the arcsine is steep, in line with the midpoints the crossing is grazing.
                if bad.iter().any(|line| (truth - line).cos().abs() > 0.985) {
                    continue;
                }
                answered += 1;
                let outcome = solved(estimator, &config, wave(&config, d));
                let Outcome::Solved { azimuth_rad, range_m } = outcome else {
                    panic!("{estimator:?} {step}: {outcome:?}")
                };
                assert!(error_deg(azimuth_rad, truth).abs() < azimuth_deg, "{estimator:?} {step}: {outcome:?}");
                assert_eq!(range_m.is_some(), range_part > 0.0);
                let range_m = f64::from(range_m.unwrap_or(5.0));
                assert!((range_m / 5.0 - 1.0).abs() <= range_part, "{estimator:?} {step}: {outcome:?}");
            }
            assert!(answered > 80, "{answered}");
        }
    }

    #[test]
    fn the_crossing_is_the_solution_of_the_printed_system_and_of_the_square_in_closed_form() {
        for (m12, m34, source) in [
            ([0.07, 0.0], [-0.07, 0.0], [3.0, 4.0]),
            ([0.06, 0.01], [-0.02, 0.05], [-1.0, 2.5]),
            ([0.3, -0.2], [-0.1, 0.4], [0.7, -2.0]),
        ] {
            let toward = |m: [f64; 2]| {
                let v = [source[0] - m[0], source[1] - m[1]];
                let length = f64::hypot(v[0], v[1]);
                [v[0] / length, v[1] / length]
            };
            let (d12, d34) = (toward(m12), toward(m34));
            // Eq. 16: the endpoints of d12 and d34 less the midpoints are the directions.
            let x = linear(std::vec![
                std::vec![1.0, 0.0, 0.0, -d34[0], m34[0]],
                std::vec![0.0, 1.0, 0.0, -d34[1], m34[1]],
                std::vec![1.0, 0.0, -d12[0], 0.0, m12[0]],
                std::vec![0.0, 1.0, -d12[1], 0.0, m12[1]],
            ]);
            let ray =
                |m: [f64; 2], d: [f64; 2]| Ray { midpoint_m: m.map(|v| v as f32), direction: d.map(|v| v as f32) };
            let rays = [ray(m12, d12), ray(m34, d34)];
            for outcome in [crossing(rays[0], rays[1]).unwrap(), least_squares(rays.iter()).unwrap()] {
                let Outcome::Solved { azimuth_rad, range_m: Some(range_m) } = outcome else { panic!("{outcome:?}") };
                assert!(error_deg(azimuth_rad, -f64::atan2(x[1], x[0])).abs() < 0.005, "{outcome:?}, not {x:?}");
                assert!((f64::from(range_m) / f64::hypot(x[0], x[1]) - 1.0).abs() < 1e-3, "{outcome:?}, not {x:?}");
            }
        }
        // Eq. 27 with d = 0.07 and angles that cross at (3, 4).
        let d = 0.07_f64;
        let (theta1, theta2) = (f64::atan2(4.0, 3.0 - d), f64::atan2(4.0, 3.0 + d));
        let cosecant = 1.0 / (theta2 - theta1).sin();
        assert!((-d * cosecant * (theta2 + theta1).sin() - 3.0).abs() < 1e-9);
        assert!((-2.0 * d * cosecant * theta1.sin() * theta2.sin() - 4.0).abs() < 1e-9);
    }

    #[test]
    fn many_arrays_are_solved_in_the_sense_of_least_squares() {
        let mut rng = Rng::new(11, 0);
        for case in 0..200 {
            let angle = f64::from(case) * TAU / 200.0;
            let source = [3.0 * angle.cos(), 3.0 * angle.sin()];
            let rays: Vec<Ray> = (0..7)
                .map(|_| {
                    let m = [0.5 * rng.gaussian(), 0.5 * rng.gaussian()];
                    let toward = f64::atan2(source[1] - f64::from(m[1]), source[0] - f64::from(m[0]));
                    let heard = toward + 0.01 * f64::from(rng.gaussian());
                    Ray { midpoint_m: m, direction: [heard.cos() as f32, heard.sin() as f32] }
                })
                .collect();
            // All equations `s - k_n d_n = r_n`, unknowns s and k, by their normal equations.
            let unknowns = 2 + rays.len();
            let mut normal = std::vec![std::vec![0.0; unknowns + 1]; unknowns];
            for (n, ray) in rays.iter().enumerate() {
                for axis in 0..2 {
                    let mut row = std::vec![0.0; unknowns + 1];
                    row[axis] = 1.0;
                    row[2 + n] = -f64::from(ray.direction[axis]);
                    row[unknowns] = f64::from(ray.midpoint_m[axis]);
                    for i in 0..unknowns {
                        for j in 0..=unknowns {
                            normal[i][j] += row[i] * row[j];
                        }
                    }
                }
            }
            let x = linear(normal);
            let Some(Outcome::Solved { azimuth_rad, range_m: Some(range_m) }) = least_squares(rays.iter()) else {
                panic!("case {case}")
            };
            assert!(error_deg(azimuth_rad, -f64::atan2(x[1], x[0])).abs() < 0.01, "case {case}");
            assert!((f64::from(range_m) - f64::hypot(x[0], x[1])).abs() < 1e-3, "case {case}");
        }
    }

    #[test]
    fn both_singular_cases_are_told_apart_and_keep_their_direction() {
        for config in [array::Config::default(), with(SKEWED)] {
            for estimator in [Estimator::TwoArray, Estimator::ThreeAntenna, Estimator::NArray] {
                for degree in [-160_i32, -110, -30, 20, 75, 130] {
                    let truth = f64::from(degree).to_radians();
                    let outcome = solved(estimator, &config, plane_wave(&config, truth));
                    let Outcome::AtInfinity { azimuth_rad } = outcome else {
                        panic!("{estimator:?} {degree}: {outcome:?}")
                    };
                    assert!(error_deg(azimuth_rad, truth).abs() < 1e-3, "{estimator:?} {degree}: {outcome:?}");
                }
            }
        }
        // In line with both midpoints: ahead and behind on the square, at any range.
        let config = array::Config::default();
        for (azimuth_rad, range_m) in [(0.0, 5.0), (PI, 5.0), (0.0, 0.5), (PI, 400.0)] {
            let z = wave(&config, distances(&config, azimuth_rad, range_m, 0.0));
            let outcome = solved(Estimator::TwoArray, &config, z);
            let Outcome::Collinear { azimuth_rad: found } = outcome else { panic!("{azimuth_rad}: {outcome:?}") };
            assert!(error_deg(found, azimuth_rad).abs() < 1e-3);
            let bearing = finder(Estimator::TwoArray, &config).find(&phasors(z, 1.0));
            assert!(bearing.valid && error_deg(bearing.azimuth_rad, azimuth_rad).abs() < 1e-3, "{bearing:?}");
        }
        let ray = |x: f32, y: f32| Ray { midpoint_m: [x, y], direction: [0.6, 0.8] };
        let (on, off) =
            ([ray(0.0, 0.0), ray(0.6, 0.8), ray(-0.3, -0.4)], [ray(0.0, 0.0), ray(0.6, 0.8), ray(1.0, 0.0)]);
        assert!(matches!(least_squares(on.iter()), Some(Outcome::Collinear { .. })));
        assert!(matches!(least_squares(off.iter()), Some(Outcome::AtInfinity { .. })));
    }

    #[test]
    fn diverging_directions_are_a_negative_scale_and_not_a_valid_bearing() {
        // Figure 15: to the left of the nose, the pair ahead sees the source less far to the side than the one behind.
        let d = 0.069;
        let ray = |x: f32, angle: f32| Ray { midpoint_m: [x, 0.0], direction: [angle.cos(), angle.sin()] };
        let diverging = [ray(d, 0.5), ray(-d, 0.6)];
        for outcome in [crossing(diverging[0], diverging[1]), least_squares(diverging.iter())] {
            assert!(matches!(outcome, Some(Outcome::NegativeScale { .. })), "{outcome:?}");
        }
        // A plane wave with 1 deg of phase that the model does not know.
        let config = array::Config::default();
        let mut z = plane_wave(&config, 0.7);
        z[0] = z[0].times(Complex { re: 0.999_85, im: -0.017_45 });
        let finder = finder(Estimator::TwoArray, &config);
        let outcomes = [finder.outcome(&phasors(z, 1.0)).unwrap(), {
            z[0] = z[0].times(Complex { re: 0.999_39, im: 0.034_9 });
            finder.outcome(&phasors(z, 1.0)).unwrap()
        }];
        let negative = outcomes.iter().filter(|outcome| matches!(outcome, Outcome::NegativeScale { .. })).count();
        assert_eq!(negative, 1, "one sign diverges, the other crosses: {outcomes:?}");
        z[0] = plane_wave(&config, 0.7)[0];
        for turn in [-0.017_45, 0.017_45] {
            let mut z = z;
            z[0] = z[0].times(Complex { re: 0.999_85, im: turn });
            let (outcome, bearing) = (finder.outcome(&phasors(z, 100.0)).unwrap(), finder.find(&phasors(z, 100.0)));
            assert_eq!(bearing.valid, outcome.is_usable(), "{outcome:?} {bearing:?}");
            assert_eq!(bearing.flags.contains(Flags::AMBIGUOUS), !outcome.is_usable());
        }
    }

    #[test]
    fn three_antennas_go_on_with_the_three_that_live_and_the_others_say_that_they_cannot() {
        let config = array::Config::default();
        for dead in 0..4 {
            for step in 0..36 {
                let truth = (f64::from(step) * 10.0 + 7.0).to_radians();
                let mut z = wave(&config, distances(&config, truth, 5.0, 0.0));
                z[dead] = Complex { re: 1.0, im: 0.5 };
                let found = |estimator| finder(estimator, &config).find(&phasors(z, 1.0));
                let three: Bearing = found(Estimator::ThreeAntenna);
                assert!(three.flags.contains(Flags::dead(dead)));
                assert!(error_deg(three.azimuth_rad, truth).abs() < 2.0, "{dead} {step} {three:?}");
                let square = found(Estimator::PaperSquare);
                assert!(!square.valid && square.flags.contains(Flags::AMBIGUOUS), "{square:?}");
                // The pair needs its own two, and one lag for its side.
                assert_eq!(found(Estimator::Pair).valid, dead >= 2);
            }
        }
    }

    #[test]
    fn the_side_of_a_pair_is_right_where_the_others_lie_obliquely_behind_it() {
        // The lags across run 39 deg off the normal: for a third of the circle they have the sign of the other side.
        let config = with([[0.05, 0.02], [0.05, -0.10], [-0.05, -0.02], [-0.05, 0.10]]);
        for step in 0..360 {
            let truth = (f64::from(step) + 0.5).to_radians();
            if truth.cos().abs() > 0.1 {
                let azimuth_rad = solved(Estimator::Pair, &config, plane_wave(&config, truth)).azimuth_rad().unwrap();
                assert!(error_deg(azimuth_rad, truth).abs() < 0.01, "{step}: {azimuth_rad}");
            }
        }
    }

    #[test]
    fn pairs_with_one_midpoint_have_no_crossing_and_an_antenna_that_is_not_asked_does_not_matter() {
        let square = array::Config::default();
        // Off the origin, so that rounding keeps the midpoints from being quite the same.
        let [a, b, c, d] = square.antennas_m.map(|[x, y]| [0.31 + 0.7 * x, -0.17 + 0.7 * y]);
        let crossed = with([a, c, b, d]);
        let mut z = wave(&crossed, distances(&crossed, 0.6, 5.0, 0.0));
        z[0] = z[0].times(Complex { re: 0.999_85, im: 0.017_45 });
        assert_eq!(solved(Estimator::TwoArray, &crossed, z), Outcome::Undefined);

        let mut z = wave(&square, distances(&square, 0.5, 5.0, 0.0));
        let three = solved(Estimator::ThreeAntenna, &square, z);
        z[3] = Complex { re: -300.0, im: 700.0 };
        assert_eq!(solved(Estimator::ThreeAntenna, &square, z), three);
        assert_ne!(solved(Estimator::NArray, &square, z).azimuth_rad(), three.azimuth_rad());
    }

    #[test]
    fn every_constraint_is_named_and_the_papers_own_square_violates_one() {
        let square = array::Config::square(0.345, 0.40 * 0.345);
        assert_eq!(constraints(&square), [Ok(()), Ok(()), Err(Violation::Parallel)]);
        assert_eq!(constraints(&array::Config::square(0.345, 0.5 * 0.345))[0], Ok(()), "half a wavelength is allowed");
        let [spacing, ..] = constraints(&array::Config::square(0.345, 0.52 * 0.345));
        assert!(
            matches!(spacing, Err(Violation::Spacing { pair: [0, 1], wavelengths }) if (wavelengths - 0.52).abs() < 1e-4)
        );
        let of = |antennas_m| constraints(&with(antennas_m));
        assert_eq!(of(SKEWED), [Ok(()), Ok(()), Ok(())]);
        let [spacing, balance, parallel] = of([[0.05, 0.06], [0.07, -0.05], [-0.1, -0.1], [-0.1, 0.1]]);
        assert!(matches!(spacing, Err(Violation::Spacing { pair: [2, 3], .. })));
        assert!(matches!(balance, Err(Violation::Unbalanced { sum_m }) if (sum_m - 0.0806).abs() < 1e-3));
        assert_eq!(parallel, Ok(()));
        // One line, and nonsense.
        assert_eq!(of([[0.12, 0.0], [0.04, 0.0], [-0.04, 0.0], [-0.12, 0.0]])[2], Err(Violation::Parallel));
        assert!(of([[f32::NAN; 2]; 4]).iter().all(Result::is_err));
    }

    #[test]
    fn the_cotangent_rule_is_refused_on_other_arrays_than_its_square() {
        let [a, b, c, d] = array::Config::default().antennas_m;
        let build = |estimator, antennas_m| {
            let array = with(antennas_m).build().unwrap();
            Config { estimator, ..Config::default() }.build(array)
        };
        for estimator in [Estimator::PaperSquare, Estimator::PaperRepaired, Estimator::PaperCorrelated] {
            assert!(build(estimator, [a, b, c, d]).is_ok());
            assert!(build(estimator, [a, b, c, d].map(|[x, y]| [x + 0.3, y - 0.1])).is_ok(), "any origin");
            for other in [[b, c, d, a], [b, a, d, c], SKEWED] {
                assert_eq!(build(estimator, other).unwrap_err().field, "bearing.estimator");
            }
        }
        for estimator in [Estimator::Pair, Estimator::TwoArray, Estimator::ThreeAntenna, Estimator::NArray] {
            assert!(build(estimator, SKEWED).is_ok());
        }
    }

    #[test]
    fn nothing_that_is_heard_makes_an_estimator_fail_or_leave_the_circle() {
        let mut rng = Rng::new(17, 0);
        let odd = [0.0, -0.0, 1.0, -1.0, 1e-30, 1e30, 3e38, f32::INFINITY, f32::NAN];
        // A2 = A3, crossed pairs with one midpoint, an ordinary array.
        let square = array::Config::default();
        let [a, b, c, d] = square.antennas_m;
        let [three, crossed] =
            [[a, b, b, c], [a, c, b, d]].map(|antennas| with(antennas.map(|[x, y]| [0.7 * x, 0.7 * y])));
        let mut answered = 0;
        for config in [square, with(SKEWED), three, crossed] {
            let array = config.build().unwrap();
            for estimator in ALL {
                for run in 0..400_usize {
                    let mut value = |k: usize| {
                        if run % 2 == 0 { rng.gaussian() } else { odd[(run * 7 + k * (1 + run / 9)) % odd.len()] }
                    };
                    let z = core::array::from_fn(|m| Complex { re: value(2 * m), im: value(2 * m + 1) });
                    let living = core::array::from_fn(|m| run % 16 < 12 || run & (1 << m) != 0);
                    let outcome = solve(estimator, &array, &z, living).unwrap();
                    if let Some(azimuth_rad) = outcome.azimuth_rad() {
                        assert!(azimuth_rad.abs() <= core::f32::consts::PI, "{estimator:?} {z:?}: {outcome:?}");
                        answered += 1;
                    }
                    if let Ok(finder) = (Config { estimator, ..Config::default() }).build(array) {
                        let bearing = finder.find(&phasors(z, 1e-3));
                        assert!(bearing.azimuth_rad.is_finite() && bearing.sigma_rad > 0.0, "{bearing:?}");
                        let usable = finder.outcome(&phasors(z, 1e-3)).is_some_and(Outcome::is_usable);
                        assert!(!bearing.valid || usable, "{bearing:?}");
                    }
                }
            }
        }
        assert!(answered > 4000, "{answered}");
        assert_eq!(
            solve(Estimator::CrossSpectrum, &square.build().unwrap(), &[Complex::default(); 4], [true; 4]),
            None
        );
    }
}
