//! Line-of-sight filter in modified polar coordinates, after Aidala and Hammel, "Utilization of modified polar
//! coordinates for bearings-only tracking", IEEE Transactions on Automatic Control 28 (1983).
//!
//! The state is the bearing `beta`, the inverse range `rho`, and with four states the source's velocity over the range,
//! `nu`. With the vehicle's displacement `d` since the last sighting,
//!
//! ```text
//!     m = e(beta) + nu dt - rho d,   s = |m|
//!     beta' = arg m,   rho' = rho / s,   nu' = nu / s
//! ```
//!
//! is exact, and the measurement is the first state itself. So range is corrected only through its correlation with the
//! bearing, which arises from motion across the line of sight. A straight flight towards the source leaves the variance
//! of the range unchanged, where a Cartesian filter (eq. 2-3 of the mmWave paper, `filters::cartesian` of
//! `foxhound-papers`) becomes overconfident.
//!
//! An innovation `y` of variance `S` is weighted by the probability `w` that it is not an outlier, where outliers are
//! uniform over all directions:
//!
//! ```text
//!     x += w K y,   P -= (w S - w (1 - w) y^2) K K'
//! ```
//!
//! (the probabilistic data association filter of Bar-Shalom with one measurement). Only one triangle of `P` is stored,
//! so it is symmetric; after every step its pivots are checked, and where rounding has made correlations impossible the
//! variances are increased. The bearing is kept as a unit vector, so that a step needs no sine and rarely an
//! arctangent.
#![expect(clippy::needless_range_loop, reason = "symmetric matrices are filled by row and column")]

use super::{Estimate, Sighting, Update, covariance, series};
use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::units::between;
use crate::mapping::walls::Wall;

/// If the range after a step is less than this fraction of the range before, the vehicle is at the source.
const OVERHEAD: f32 = 1e-3;
/// Smallest standard deviation of a sighting.
const SIGMA_FLOOR_RAD: f32 = 0.002;
/// Smallest range that the estimate may have.
const RANGE_MIN_M: f32 = 0.2;
/// Largest standard deviation of a bearing: that of the uniform distribution.
const BEARING_SIGMA_MAX_RAD: f32 = 1.813_8;

/// Configuration of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Inverse range assumed at the first bearing.
    pub inverse_range_per_m: f32,
    /// Its standard deviation.
    pub inverse_range_sigma_per_m: f32,
    /// Largest range that the estimate may have.
    pub range_max_m: f32,
    /// Share of sightings that are outliers.
    pub outlier_rate: f32,
    /// Error of the vehicle's own position, a random walk with this variance per second.
    pub odometry_m2_per_s: f32,
    /// Initial standard deviation of a moving source's speed, along each axis.
    pub speed_sigma_mps: f32,
    /// Spectral density of its acceleration, which is white noise.
    pub acceleration_m2_per_s3: f32,
}

impl Config {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self {
        inverse_range_per_m: 0.08,
        inverse_range_sigma_per_m: 0.12,
        range_max_m: 1000.0,
        outlier_rate: 0.01,
        odometry_m2_per_s: 1e-5,
        speed_sigma_mps: 0.5,
        acceleration_m2_per_s3: 0.01,
    };
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Filter, ConfigError> {
        check("source.range_max_m", self.range_max_m, 2.0 * RANGE_MIN_M, 1e5)?;
        check("source.inverse_range_per_m", self.inverse_range_per_m, 1.0 / self.range_max_m, 1.0 / RANGE_MIN_M)?;
        check("source.inverse_range_sigma_per_m", self.inverse_range_sigma_per_m, 1e-6, 1.0 / RANGE_MIN_M)?;
        check("source.outlier_rate", self.outlier_rate, 0.0, 0.9)?;
        check("source.odometry_m2_per_s", self.odometry_m2_per_s, 0.0, 10.0)?;
        check("source.speed_sigma_mps", self.speed_sigma_mps, 0.0, 100.0)?;
        check("source.acceleration_m2_per_s3", self.acceleration_m2_per_s3, 0.0, 100.0)?;
        Ok(Filter { config: *self })
    }
}

/// The configured filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filter {
    config: Config,
}

/// The filter's state: `S = 2` for a source at rest, `S = 4` for one that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<const S: usize> {
    /// Unit vector of the bearing, clockwise from north.
    direction_ned: Horizontal,
    inverse_range_per_m: f32,
    /// The source's velocity over the range; zero with two states.
    velocity_ned_per_s: Horizontal,
    /// Covariance of bearing, inverse range, velocity over range (north, east); only the upper triangle is used.
    p: [[f32; S]; S],
    /// Position of the vehicle at the last sighting.
    place_ned_m: Horizontal,
    started: bool,
}

/// A source at rest.
pub type Resting = State<2>;
/// A source of constant velocity.
pub type Moving = State<4>;

impl<const S: usize> Default for State<S> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const S: usize> State<S> {
    /// No sighting yet.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(S == 2 || S == 4) };
        const ZERO: Horizontal = Horizontal { north: 0.0, east: 0.0 };
        Self {
            direction_ned: ZERO,
            inverse_range_per_m: 0.0,
            velocity_ned_per_s: ZERO,
            p: [[0.0; S]; S],
            place_ned_m: ZERO,
            started: false,
        }
    }

    /// The estimate as of the last sighting; `None` before the first.
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let range_m = 1.0 / self.inverse_range_per_m;
        let along = self.direction_ned;
        let across = Horizontal { north: -along.east, east: along.north };
        // d place = r across d beta - r^2 along d rho.
        let (a, b) = (across.times(range_m), along.times(-range_m * range_m));
        let [bb, br, rr] = [self.p[0][0], self.p[0][1], self.p[1][1]];
        let product = |ai: f32, aj: f32, bi: f32, bj: f32| bb * ai * aj + br * (ai * bj + aj * bi) + rr * bi * bj;
        Some(Estimate {
            place_ned_m: self.place_ned_m.plus(along.times(range_m)),
            velocity_ned_mps: self.velocity_ned_per_s.times(range_m),
            covariance_m2: [
                product(a.north, a.north, b.north, b.north),
                product(a.north, a.east, b.north, b.east),
                product(a.east, a.east, b.east, b.east),
            ],
            bearing_ned_rad: along.bearing_rad(),
            bearing_sigma_rad: between(sqrt(bb), 0.0, BEARING_SIGMA_MAX_RAD),
            range_m,
            range_sigma_ratio: sqrt(rr) * range_m,
        })
    }

    /// The state as seen from the vehicle's mirror image: the estimated source is replaced by its mirror image.
    #[must_use]
    pub fn mirrored(&self, line: &Wall) -> Self {
        let mut image = *self;
        image.place_ned_m = line.mirror(self.place_ned_m);
        image.direction_ned = line.mirror_direction(self.direction_ned);
        // A mirror swaps left and right, and keeps ranges.
        image.p[0][1] = -self.p[0][1];
        if S == 4 {
            image.velocity_ned_per_s = line.mirror_direction(self.velocity_ned_per_s);
            let of = |row: usize| Horizontal { north: self.p[row][2], east: self.p[row][3] };
            let (with_bearing, with_range) = (line.mirror_direction(of(0)), line.mirror_direction(of(1)));
            (image.p[0][2], image.p[0][3]) = (-with_bearing.north, -with_bearing.east);
            (image.p[1][2], image.p[1][3]) = (with_range.north, with_range.east);
            // M P M, the mirror on both sides.
            let [nn, ne, ee] = [self.p[2][2], self.p[2][3], self.p[3][3]];
            let columns = [Horizontal { north: nn, east: ne }, Horizontal { north: ne, east: ee }];
            let [first, second] = columns.map(|column| line.mirror_direction(column));
            let north = line.mirror_direction(Horizontal { north: first.north, east: second.north });
            let east = line.mirror_direction(Horizontal { north: first.east, east: second.east });
            (image.p[2][2], image.p[2][3], image.p[3][3]) = (north.north, north.east, east.east);
        }
        image
    }

    /// Bearing, inverse range and velocity over range.
    #[must_use]
    pub fn mean(&self) -> [f32; S] {
        let velocity = self.velocity_ned_per_s;
        let all = [self.direction_ned.bearing_rad(), self.inverse_range_per_m, velocity.north, velocity.east];
        let mut mean = [0.0; S];
        for (mean, all) in mean.iter_mut().zip(all) {
            *mean = all;
        }
        mean
    }

    /// Unit vector towards the source.
    #[must_use]
    pub fn direction_ned(&self) -> Horizontal {
        self.direction_ned
    }

    /// One over the range.
    #[must_use]
    pub fn inverse_range_per_m(&self) -> f32 {
        self.inverse_range_per_m
    }

    /// Position of the vehicle at the last sighting, or of its mirror image.
    #[must_use]
    pub fn place_ned_m(&self) -> Horizontal {
        self.place_ned_m
    }

    /// An entry of the covariance.
    #[must_use]
    pub fn covariance(&self, i: usize, j: usize) -> f32 {
        let (i, j) = (i.min(j).min(S - 1), i.max(j).min(S - 1));
        self.p[i][j]
    }
}

impl Filter {
    /// Processes a sighting.
    pub fn step<const S: usize>(&self, state: &mut State<S>, sighting: &Sighting) -> Update {
        if !sighting.is_plausible() {
            return Update::Refused;
        }
        let sigma_rad = if sighting.sigma_rad > SIGMA_FLOOR_RAD { sighting.sigma_rad } else { SIGMA_FLOOR_RAD };
        if !state.started {
            self.start(state, sighting, sigma_rad);
            return Update::Started;
        }
        if !self.carry(state, sighting.place_ned_m, sighting.since_s) {
            *state = State::new();
            return Update::Overhead;
        }
        self.update(state, sighting.direction_ned, sigma_rad)
    }

    /// [`Self::step`] for a source that may move, compiled with this crate and not with the caller, which may be
    /// optimised for size.
    #[inline(never)]
    pub fn step_moving(&self, state: &mut Moving, sighting: &Sighting) -> Update {
        self.step(state, sighting)
    }

    /// Starts from a bearing and the prior of the range.
    fn start<const S: usize>(&self, state: &mut State<S>, sighting: &Sighting, sigma_rad: f32) {
        let config = &self.config;
        *state = State::new();
        state.started = true;
        state.place_ned_m = sighting.place_ned_m;
        let direction_ned = sighting.direction_ned;
        state.direction_ned = direction_ned.times(1.0 / direction_ned.norm());
        state.inverse_range_per_m = config.inverse_range_per_m;
        let sigma_rad = between(sigma_rad, SIGMA_FLOOR_RAD, BEARING_SIGMA_MAX_RAD);
        state.p[0][0] = sigma_rad * sigma_rad;
        state.p[1][1] = config.inverse_range_sigma_per_m * config.inverse_range_sigma_per_m;
        let speed = config.speed_sigma_mps * config.inverse_range_per_m;
        for axis in 2..S {
            state.p[axis][axis] = speed * speed + 1e-12;
        }
    }

    /// Predicts the state at the vehicle's present position; false when that is at the source.
    pub fn predict<const S: usize>(&self, state: &mut State<S>, place_ned_m: Horizontal, dt_s: f32) -> bool {
        let carried = self.carry(state, place_ned_m, dt_s);
        self.keep_sound(state);
        carried
    }

    /// The same without the check of rounding: an update does it anyway.
    fn carry<const S: usize>(&self, state: &mut State<S>, place_ned_m: Horizontal, dt_s: f32) -> bool {
        let config = &self.config;
        let moved = place_ned_m.minus(state.place_ned_m);
        state.place_ned_m = place_ned_m;
        let (e, rho) = (state.direction_ned, state.inverse_range_per_m);
        let mut m = e.minus(moved.times(rho));
        if S == 4 {
            m = m.plus(state.velocity_ned_per_s.times(dt_s));
        }
        let s = m.norm();
        if !(s > OVERHEAD && rho * RANGE_MIN_M <= s) {
            return false;
        }
        let shrink = 1.0 / s;
        let u = m.times(shrink);
        let w = Horizontal { north: -u.east, east: u.north };
        // dm/dx, whose first column is across e, along w and u.
        let (mut a, mut b) = ([0.0; S], [0.0; S]);
        (a[0], a[1]) = (u.dot(e), -w.dot(moved));
        (b[0], b[1]) = (-w.dot(e), -u.dot(moved));
        let mut y = [0.0; S];
        state.direction_ned = u;
        state.inverse_range_per_m = rho * shrink;
        y[1] = state.inverse_range_per_m;
        if S == 4 {
            (a[2], a[3]) = (w.north * dt_s, w.east * dt_s);
            (b[2], b[3]) = (u.north * dt_s, u.east * dt_s);
            state.velocity_ned_per_s = state.velocity_ned_per_s.times(shrink);
            (y[2], y[3]) = (state.velocity_ned_per_s.north, state.velocity_ned_per_s.east);
        }
        // F = (a; I - y b') / s except the first row: P' without a product of matrices.
        let (pa, pb) = (times(&state.p, &a), times(&state.p, &b));
        let (apa, apb, half_bpb) = (dot(&a, &pa), dot(&a, &pb), 0.5 * dot(&b, &pb));
        let shrink2 = shrink * shrink;
        // y_i y_j b'Pb, one half to each of the two terms before.
        let mut c = [0.0; S];
        for i in 1..S {
            c[i] = pb[i] - y[i] * half_bpb;
        }
        for i in 1..S {
            state.p[0][i] = (pa[i] - y[i] * apb) * shrink2;
            for j in 1..S {
                if i <= j {
                    state.p[i][j] = (state.p[i][j] - y[i] * c[j] - y[j] * c[i]) * shrink2;
                }
            }
        }

        // Process noise of the vehicle and of the source.
        let rho2 = state.inverse_range_per_m * state.inverse_range_per_m;
        let walk = rho2 * config.odometry_m2_per_s * dt_s;
        state.p[0][0] = apa * shrink2 + walk;
        state.p[1][1] += walk * rho2;
        if S == 4 {
            let push = rho2 * config.acceleration_m2_per_s3 * dt_s;
            state.p[2][2] += push;
            state.p[3][3] += push;
        }
        true
    }

    /// Updates the state with a bearing, given as a vector along it.
    fn update<const S: usize>(&self, state: &mut State<S>, direction_ned: Horizontal, sigma_rad: f32) -> Update {
        let config = &self.config;
        let r = sigma_rad * sigma_rad;
        let e = state.direction_ned;
        let across = e.north * direction_ned.east - e.east * direction_ned.north;
        let innovation = series::angle(across, e.dot(direction_ned));
        let row = state.p[0];
        let s = row[0] + r;
        let inverse = 1.0 / s;
        let nis = innovation * innovation * inverse;
        // Divided by sqrt(2 pi).
        let inlier = 0.398_942_3 * (1.0 - config.outlier_rate) * series::exp_minus(0.5 * nis) * sqrt(s) * inverse;
        let outlier = config.outlier_rate * (0.5 * core::f32::consts::FRAC_1_PI);
        // For a distant outlier both may be zero.
        let likelihood = inlier + outlier + 1e-30;
        let weight = (inlier + 1e-30) / likelihood;
        let known = weight * inverse;
        let gain = known * innovation;
        // (w S - w (1 - w) y^2) / S^2.
        let known = known * (1.0 - (1.0 - weight) * nis);
        state.direction_ned = series::turned(e, gain * row[0]);
        state.inverse_range_per_m += gain * row[1];
        if S == 4 {
            state.velocity_ned_per_s.north += gain * row[2];
            state.velocity_ned_per_s.east += gain * row[3];
        }
        for i in 0..S {
            let known = known * row[i];
            for j in 0..S {
                if i <= j {
                    state.p[i][j] -= known * row[j];
                }
            }
        }
        // This form is always positive, while the difference above loses digits.
        if weight > 0.999 {
            state.p[0][0] = row[0] * r * inverse;
        }
        self.keep_sound(state);
        Update::Fused { nis, weight, likelihood }
    }

    /// Limits the state to its ranges, and keeps the covariance positive definite.
    fn keep_sound<const S: usize>(&self, state: &mut State<S>) {
        let config = &self.config;
        let rho = state.inverse_range_per_m;
        if rho * RANGE_MIN_M > 1.0 {
            state.inverse_range_per_m = 1.0 / RANGE_MIN_M;
        } else if rho * config.range_max_m < 1.0 {
            state.inverse_range_per_m = 1.0 / config.range_max_m;
        }
        // A bearing less certain than uniform is treated as uniform.
        if state.p[0][0] > BEARING_SIGMA_MAX_RAD * BEARING_SIGMA_MAX_RAD {
            narrow(&mut state.p);
        }
        covariance::keep_positive(&mut state.p);
    }
}

/// Treats the first state, the bearing, as uniform when it is entirely unknown.
#[cold]
#[inline(never)]
fn narrow<const S: usize>(p: &mut [[f32; S]; S]) {
    let scale = BEARING_SIGMA_MAX_RAD / sqrt(p[0][0]);
    for j in 1..S {
        p[0][j] *= scale;
    }
    p[0][0] = BEARING_SIGMA_MAX_RAD * BEARING_SIGMA_MAX_RAD;
}

/// A symmetric matrix, its upper triangle given, times a vector.
#[inline(always)]
fn times<const S: usize>(p: &[[f32; S]; S], v: &[f32; S]) -> [f32; S] {
    let mut product = [0.0; S];
    for i in 0..S {
        let mut sum = p[0][i] * v[0];
        for j in 1..S {
            sum += v[j] * if i <= j { p[i][j] } else { p[j][i] };
        }
        product[i] = sum;
    }
    product
}

#[inline(always)]
fn dot<const S: usize>(a: &[f32; S], b: &[f32; S]) -> f32 {
    let mut sum = a[0] * b[0];
    for i in 1..S {
        sum += a[i] * b[i];
    }
    sum
}

#[cfg(test)]
mod tests;
