//! One direction of several looks, with reflections. (A look is a frame with its yaw.)
//!
//! A reflection at -6 dB pulls a single bearing by several degrees, and averaging bearings hardly helps. But while the
//! antennas move by a quarter of a wavelength and more from look to look, the two paths change their relative phase and
//! keep their directions, so two directions from north and one complex amplitude per path and look explain everything:
//! `z_k = A(psi_1 - yaw_k, psi_2 - yaw_k) s_k + noise`.
//!
//! **One path** is tried first, over direction *and* wavenumber: a source above or below us looks like two paths to a fit that
//! insists on our height. It is kept when noise and calibration explain what it leaves over.
//!
//! **Two paths**, both level, start from the pair of directions on a grid that leaves least over. The one path's direction is on
//! the grid: beside a weak reflection it is nearly the direct path's.
//!
//! **The fit** takes Levenberg's steps on `sum_k |P_perp(A_k) z_k|^2`, the amplitudes projected out (Golub and Pereyra 1973, with
//! Kaufman's derivative): deterministic maximum likelihood. Each direction may turn a little from look to look, as that of a near
//! source does while we pass (5 m away and 0.6 m travelled it is 7 degrees), so that the answer holds for the last look.
//!
//! **Sigma** is the inverse of the last normal matrix for noise. Phase errors left in the channels are the same in every look and
//! do not average: they go through the step's linear map. Both grow when more is left over than they explain.
//!
//! The array is taken to be level.

use std::f64::consts::{PI, TAU};

use foxhound_core::base::adc::CHANNELS;
use foxhound_core::doa::array::Array;
use foxhound_core::doa::bearing::{Bearing, Flags, Quality, SIGMA_USELESS_RAD};
use foxhound_core::signal::phase::{Phasors, Tone};
use num_complex::Complex64;

use crate::world::wrap_pi;

/// Fewer looks with a tone are not resolved.
const LOOKS_MIN: usize = 4;
/// Phase error left in each channel after calibration, rms.
const CHANNEL_SIGMA_RAD: f64 = PI / 180.0;
/// Noise over signal below which it no longer matters.
const NOISE_FLOOR: f64 = 1e-7;
/// Directions of the grid.
const GRID: usize = 16;
/// Steps of a fit at most; one this short ends it; none is longer.
const STEPS: usize = 12;
const STEP_MIN_RAD: f64 = 1e-4;
const STEP_MAX_RAD: f64 = 0.3;
/// Wavenumbers of one path, over that of a level one; the largest leaves room for errors.
const WAVENUMBERS: [f64; 2] = [0.1, 1.1];
/// Power of the second path that the first cannot take, at least: 6 degrees between them. Paths that are closer explain calibration
/// errors from many pairs of directions.
const REST_MIN: f64 = 0.02;
/// Half the precision of a path's turn from look to look, whose standard deviation is 0.01 rad.
const TURN_PRECISION: f64 = 0.5 / (0.01 * 0.01);
/// Phase errors of the channels give one path a residual, per look and in units of their variance, that is a chi-square
/// of two degrees of freedom; exceeded once in 400.
const CALIBRATION_GATE: f64 = 12.0;
/// Standard deviations of the mean residual by noise.
const NOISE_GATE: f64 = 4.5;

/// A frame, heard.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Its phasors.
    pub phasors: Phasors,
    /// The bearing of this one look.
    pub bearing: Bearing,
    /// Yaw at the look, from north.
    pub yaw_rad: f64,
}

/// The stronger path of some looks, in the body frame of the last; none when fewer than four hold a tone, or a channel is dead.
/// (The direct path need not be the stronger one.)
///
/// Signal-to-noise ratio and frequency are those of the last look with a tone, the flags those of all; `MULTIPATH` means that
/// there are two paths. `quality.closure_chi2` is the mean residual of a look over its variance.
#[must_use]
pub fn resolve(array: &Array, looks: &[Look]) -> Option<Bearing> {
    let (heard, kept): (Vec<&Look>, Vec<Kept>) =
        looks.iter().filter_map(|look| Some((look, Kept::of(array, look)?))).unzip();
    // Fading takes a channel down in some looks, not in most.
    let is_dead = |m: usize| {
        let flagged = heard.iter().filter(|look| look.bearing.flags.contains(Flags::dead(m))).count();
        2 * flagged > heard.len()
    };
    if heard.len() < LOOKS_MIN || (0..CHANNELS).any(is_dead) {
        return None;
    }
    let fit = Solver { steering: array.steering.map(|p| p.map(f64::from)), looks: &kept }.solve(&heard);
    let (last, newest) = (looks.last()?, heard.last()?);

    // One look's signs of reflections, and its ambiguity, are resolved here.
    let all = heard.iter().fold(Flags::default(), |flags, look| flags.with(look.bearing.flags));
    let mut flags = Flags(all.0 & !(Flags::MULTIPATH.0 | Flags::AMBIGUOUS.0));
    if fit.is_two {
        flags = flags.with(Flags::MULTIPATH);
    }
    // A sigma that is no number is useless.
    let sigma_rad = if fit.sigma_rad < PI { fit.sigma_rad.max(1e-6) } else { PI };
    if sigma_rad > f64::from(SIGMA_USELESS_RAD) {
        flags = flags.with(Flags::AMBIGUOUS);
    }
    let useless = Flags::AMBIGUOUS.0 | Flags::UNCALIBRATED.0 | Flags::NO_SIGNAL.0;
    Some(Bearing {
        time: last.bearing.time,
        valid: flags.0 & useless == 0,
        azimuth_rad: wrap_pi(fit.azimuth_ned_rad - last.yaw_rad) as f32,
        sigma_rad: sigma_rad as f32,
        elevation_rad: libm::acos(fit.wavenumber.min(1.0)) as f32,
        elevation_sigma_rad: newest.bearing.elevation_sigma_rad,
        quality: Quality {
            closure_chi2: fit.chi2 as f32,
            wavenumber: fit.wavenumber.min(1.0) as f32,
            ..newest.bearing.quality
        },
        flags,
    })
}

type Vector = [Complex64; CHANNELS];
type Matrix = [[f64; 4]; 4];

/// `a^H b`.
fn inner(a: &Vector, b: &Vector) -> Complex64 {
    a.iter().zip(b).map(|(a, b)| a.conj() * b).sum()
}

/// `a - factor b`.
fn less(a: &Vector, factor: Complex64, b: &Vector) -> Vector {
    std::array::from_fn(|m| a[m] - factor * b[m])
}

/// A look as the fit takes it.
struct Kept {
    /// The corrected phasors, of unit power on average.
    z: Vector,
    /// Noise variance of a channel over the power.
    noise: f64,
    /// One over the variance of a channel's error, noise and calibration.
    weight: f64,
    yaw_rad: f64,
}

impl Kept {
    /// None without a tone.
    fn of(array: &Array, look: &Look) -> Option<Self> {
        let array = array.at(look.phasors.frequency_hz);
        let z = array.correct(&look.phasors.z).map(|z| Complex64::new(f64::from(z.re), f64::from(z.im)));
        let power = z.iter().map(Complex64::norm_sqr).sum::<f64>() / CHANNELS as f64;
        let noise = |m: usize| f64::from(look.phasors.noise[m] * array.correction_power(m));
        let noise = (0..CHANNELS).map(noise).sum::<f64>() / CHANNELS as f64 / power + NOISE_FLOOR;
        let usable = look.phasors.tone == Tone::Present && power > 0.0 && noise.is_finite();
        usable.then(|| Self {
            z: z.map(|z| z / libm::sqrt(power)),
            noise,
            weight: 1.0 / (noise + CHANNEL_SIGMA_RAD * CHANNEL_SIGMA_RAD),
            yaw_rad: look.yaw_rad,
        })
    }
}

/// What the looks may hold: two paths, or one.
#[derive(Clone, Copy, Debug)]
struct Paths {
    is_two: bool,
    /// The directions from north of two level paths, or direction and wavenumber of one; then the turn of each direction from
    /// look to look. The directions are those at the middle of the looks.
    x: [f64; 4],
}

impl Paths {
    fn moved(mut self, step: [f64; 4]) -> Self {
        for (x, step) in self.x.iter_mut().zip(step) {
            *x += step.clamp(-STEP_MAX_RAD, STEP_MAX_RAD);
        }
        if !self.is_two {
            self.x[1] = self.x[1].clamp(WAVENUMBERS[0], WAVENUMBERS[1]);
        }
        self
    }
}

/// A steering vector of unit length, and its derivatives.
#[derive(Default)]
struct Steering {
    a: Vector,
    by_azimuth: Vector,
    by_wavenumber: Vector,
}

/// Sums over the looks for one hypothesis.
#[derive(Clone, Default)]
struct Sums {
    /// The normal equations.
    h: Matrix,
    b: [f64; 4],
    /// How a phase error of each channel moves the right-hand side.
    by_channel: [[f64; 4]; CHANNELS],
    /// Of each path.
    power: [f64; 2],
    /// Weighted power that is left over, and how unlikely the turns are.
    left: f64,
}

/// The end of a fit.
struct Fit {
    paths: Paths,
    sums: Sums,
    inverse: Matrix,
}

/// What [`Solver::solve`] finds.
struct Found {
    is_two: bool,
    azimuth_ned_rad: f64,
    wavenumber: f64,
    sigma_rad: f64,
    chi2: f64,
}

struct Solver<'a> {
    /// Positions of the antennas times the wavenumber.
    steering: [[f64; 2]; CHANNELS],
    looks: &'a [Kept],
}

impl Solver<'_> {
    /// One path if it is enough, else two.
    fn solve(&self, heard: &[&Look]) -> Found {
        let one = self.fit(Self::mean(heard));
        if self.chi2(&one) < self.gate() {
            // Of three degrees of freedom for the channels' errors a look, one path takes one.
            return self.found(&one, 0, 3.0);
        }
        let grid = |k: usize| one.paths.x[0] + k as f64 * TAU / GRID as f64;
        let pairs =
            (0..GRID).flat_map(|i| (0..i).map(move |j| Paths { is_two: true, x: [grid(i), grid(j), 0.0, 0.0] }));
        let with_left = pairs.map(|paths| (self.sums(&paths).left, paths));
        let least = with_left.min_by(|(a, _), (b, _)| a.total_cmp(b)).map_or(one.paths, |(_, paths)| paths);
        let two = self.fit(least);
        // Two paths take two.
        self.found(&two, usize::from(two.sums.power[1] > two.sums.power[0]), 2.0)
    }

    /// One path: the mean of the looks' own bearings and wavenumbers.
    fn mean(heard: &[&Look]) -> Paths {
        let (mut north, mut east, mut wavenumber) = (0.0, 0.0, 0.0);
        for look in heard {
            let (sine, cosine) = libm::sincos(f64::from(look.bearing.azimuth_rad) + look.yaw_rad);
            (north, east) = (north + cosine, east + sine);
            let own = f64::from(look.bearing.quality.wavenumber);
            wavenumber += if own > WAVENUMBERS[0] && own < 1.0 { own } else { 1.0 };
        }
        Paths { is_two: false, x: [libm::atan2(east, north), wavenumber / heard.len() as f64, 0.0, 0.0] }
    }

    /// What a look leaves over on average, over its variance.
    fn chi2(&self, fit: &Fit) -> f64 {
        fit.sums.left / self.looks.len() as f64
    }

    /// The residual that one path may leave: noise gives three a look, and the channels' errors theirs.
    fn gate(&self) -> f64 {
        let count = self.looks.len() as f64;
        let variance = CHANNEL_SIGMA_RAD * CHANNEL_SIGMA_RAD;
        let calibration = self.looks.iter().map(|look| variance * look.weight).sum::<f64>() / count;
        (1.0 - calibration) * (3.0 + NOISE_GATE * libm::sqrt(3.0 / count)) + calibration * CALIBRATION_GATE
    }

    /// How often a direction has turned at a look since the middle of them.
    fn lever(&self, index: usize) -> f64 {
        index as f64 - 0.5 * (self.looks.len() as f64 - 1.0)
    }

    /// A path of a fit as it is at the last look.
    fn found(&self, fit: &Fit, path: usize, freedom: f64) -> Found {
        let Fit { paths: Paths { is_two, x }, sums, inverse } = fit;
        let (count, lever) = (self.looks.len() as f64, self.lever(self.looks.len() - 1));
        let at_last: [f64; 4] = std::array::from_fn(|i| inverse[path][i] + lever * inverse[path + 2][i]);
        // Noise is half in the real and half in the imaginary part: information is twice the normal matrix.
        let noise = 0.5 * self.looks.iter().map(|look| look.weight * look.noise).sum::<f64>() / count;
        let noise = noise * (at_last[path] + lever * at_last[path + 2]);
        let through = |by: &[f64; 4]| by.iter().zip(at_last).map(|(b, inverse)| b * inverse).sum::<f64>();
        let channels = sums.by_channel.iter().map(|by| libm::pow(CHANNEL_SIGMA_RAD * through(by), 2.0)).sum::<f64>();
        let chi2 = self.chi2(fit);
        Found {
            is_two: *is_two,
            azimuth_ned_rad: x[path] + lever * x[path + 2],
            wavenumber: if *is_two { 1.0 } else { x[1] },
            sigma_rad: libm::sqrt((noise + channels) * (chi2 / freedom).max(1.0)),
            chi2,
        }
    }

    /// Levenberg's steps from a start; one that leaves more over is taken back and shortened.
    fn fit(&self, start: Paths) -> Fit {
        let inverse = |sums: &Sums, damping: f64| {
            let mut h = sums.h;
            (0..4).for_each(|i| h[i][i] *= 1.0 + damping);
            inverted(&h)
        };
        let (mut paths, mut sums, mut damping) = (start, self.sums(&start), 1e-3);
        for _ in 0..STEPS {
            let step = inverse(&sums, damping).map(|row| row.iter().zip(sums.b).map(|(x, b)| x * b).sum());
            let trial = paths.moved(step);
            let there = self.sums(&trial);
            if there.left < sums.left {
                (paths, sums, damping) = (trial, there, 0.1 * damping);
                if step.iter().all(|step| step.abs() < STEP_MIN_RAD) {
                    break;
                }
            } else {
                damping = (30.0 * damping).max(0.03);
            }
        }
        Fit { paths, inverse: inverse(&sums, 0.0), sums }
    }

    fn steering(&self, azimuth_rad: f64, wavenumber: f64) -> Steering {
        let (sine, cosine) = libm::sincos(azimuth_rad);
        let phases = self.steering.map(|[forward, right]| forward * cosine + right * sine);
        let rates = self.steering.map(|[forward, right]| right * cosine - forward * sine);
        let a: Vector = phases.map(|phase| {
            let (im, re) = libm::sincos(wavenumber * phase);
            Complex64::new(re, im) / libm::sqrt(CHANNELS as f64)
        });
        Steering {
            a,
            by_azimuth: std::array::from_fn(|m| Complex64::i() * a[m] * wavenumber * rates[m]),
            by_wavenumber: std::array::from_fn(|m| Complex64::i() * a[m] * phases[m]),
        }
    }

    fn sums(&self, paths: &Paths) -> Sums {
        let mut sums = Sums::default();
        let Paths { is_two, x } = *paths;
        for (index, Kept { z, weight, yaw_rad, .. }) in self.looks.iter().enumerate() {
            let lever = self.lever(index);
            let first = self.steering(x[0] + lever * x[2] - yaw_rad, if is_two { 1.0 } else { x[1] });
            let second = if is_two { self.steering(x[1] + lever * x[3] - yaw_rad, 1.0) } else { Steering::default() };
            // What of the second path the first cannot take.
            let cosine = inner(&first.a, &second.a);
            let beside = less(&second.a, cosine, &first.a);
            let rest = inner(&beside, &beside).re.max(REST_MIN);
            let outside = |v: &Vector| less(&less(v, inner(&first.a, v), &first.a), inner(&beside, v) / rest, &beside);
            let weak = inner(&beside, z) / rest;
            let strong = inner(&first.a, z) - cosine * weak;
            let left = outside(z);
            let a = outside(&first.by_azimuth.map(|by| by * strong));
            let b =
                if is_two { second.by_azimuth.map(|by| by * weak) } else { first.by_wavenumber.map(|by| by * strong) };
            let b = outside(&b);
            let turn = if is_two { lever } else { 0.0 };
            let tangents = [a, b, a.map(|a| a * lever), b.map(|b| b * turn)];
            for (i, tangent) in tangents.iter().enumerate() {
                for (j, other) in tangents.iter().enumerate() {
                    sums.h[i][j] += weight * inner(tangent, other).re;
                }
                sums.b[i] += weight * inner(tangent, &left).re;
                for m in 0..CHANNELS {
                    sums.by_channel[m][i] += weight * (tangent[m].conj() * Complex64::i() * z[m]).re;
                }
            }
            sums.power[0] += strong.norm_sqr();
            sums.power[1] += weak.norm_sqr();
            sums.left += weight * inner(&left, &left).re;
        }
        for i in [2, 3] {
            sums.h[i][i] += TURN_PRECISION;
            sums.b[i] -= TURN_PRECISION * x[i];
            sums.left += TURN_PRECISION * x[i] * x[i];
        }
        sums
    }
}

/// The inverse of a positive definite matrix, by Gauss and Jordan; a pivot that is too small is raised.
fn inverted(matrix: &Matrix) -> Matrix {
    let mut a = *matrix;
    for k in 0..4 {
        let (row, pivot) = (a[k], 1.0 / a[k][k].max(1e-12 * matrix[k][k] + 1e-300));
        for (i, other) in a.iter_mut().enumerate() {
            let factor = if i == k { 1.0 - pivot } else { other[k] * pivot };
            for j in 0..4 {
                other[j] -= factor * row[j];
            }
            other[k] = if i == k { pivot } else { -factor };
        }
    }
    a
}

#[cfg(test)]
mod tests;
