//! A filter for a line of reflection that is not exactly known.
//!
//! Bearings determine the mirror image `q` of the source, and nothing more: all lines and sources with this image
//! give the same bearings. So the state is the image, in modified polar coordinates as in
//! [`polar`](foxhound_core::localize::source::polar), and the line, by the bearing `phi` of its normal and its offset
//! from an anchor,
//!
//! ```text
//!     x = (beta, rho, phi, offset),   n(phi) . (q - anchor) = offset  on the line
//! ```
//!
//! which allows vertical walls; the measurement is the first state itself. Prior knowledge of the source and of the
//! line correlates the image with the line. Only by that do bearings improve the line, and the source `s = q - 2 n (n
//! . (q - anchor) - offset)`. The rest stays as uncertain as it was, and so does the covariance.
//!
//! The anchor is where the filter begins, so that an error of `phi` moves the line least near there.
#![expect(clippy::needless_range_loop, reason = "symmetric matrices are filled by row and column")]

use super::{Degenerate, Estimate, Sighting, Update, kalman};
use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::units::{between, sin_cos, wrap_pi};
use foxhound_core::localize::source::covariance::keep_positive;
use foxhound_core::mapping::walls::Wall;

/// Below this share of the range after a step, the vehicle is at the image.
const OVERHEAD: f32 = 1e-3;
/// Nearer to the line the vehicle counts as on it.
const ON_LINE_M: f32 = 1e-3;
/// A uniform bearing has this standard deviation, and nothing a larger one.
const BEARING_SIGMA_MAX_RAD: f32 = 1.813_8;

/// Configuration of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Nearest and farthest valid image.
    pub range_min_m: f32,
    /// See `range_min_m`.
    pub range_max_m: f32,
    /// Share of outliers among sightings.
    pub outlier_rate: f32,
    /// Smallest sigma assumed for a sighting.
    pub sigma_floor_rad: f32,
    /// Error of the vehicle's own position, a random walk with this variance a second.
    pub odometry_m2_per_s: f32,
    /// Drift of the line's angle.
    pub angle_rad2_per_s: f32,
    /// Drift of its offset.
    pub offset_m2_per_s: f32,
}

impl Config {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self {
        range_min_m: 0.2,
        range_max_m: 1000.0,
        outlier_rate: 0.01,
        sigma_floor_rad: 0.002,
        odometry_m2_per_s: 1e-5,
        angle_rad2_per_s: 1e-8,
        offset_m2_per_s: 1e-6,
    };

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Unknown, ConfigError> {
        check("unknown.range_min_m", self.range_min_m, 1e-3, 100.0)?;
        check("unknown.range_max_m", self.range_max_m, 2.0 * self.range_min_m, 1e5)?;
        check("unknown.outlier_rate", self.outlier_rate, 0.0, 0.9)?;
        check("unknown.sigma_floor_rad", self.sigma_floor_rad, 1e-4, 1.0)?;
        check("unknown.odometry_m2_per_s", self.odometry_m2_per_s, 0.0, 10.0)?;
        check("unknown.angle_rad2_per_s", self.angle_rad2_per_s, 0.0, 1.0)?;
        check("unknown.offset_m2_per_s", self.offset_m2_per_s, 0.0, 10.0)?;
        Ok(Unknown { config: *self })
    }
}

/// How the filter begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guess {
    /// Position of the vehicle.
    pub vehicle_ned_m: Horizontal,
    /// Prior position of the source.
    pub source_ned_m: Horizontal,
    /// Its standard deviation along each axis.
    pub source_sigma_m: f32,
    /// Prior of the line; its ends are ignored.
    pub line: Wall,
    /// Standard deviation of its angle.
    pub angle_sigma_rad: f32,
    /// Standard deviation of its distance from the vehicle.
    pub offset_sigma_m: f32,
}

/// The configured filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknown {
    config: Config,
}

/// State of the filter; by default it has not begun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Bearing and inverse range of the image, bearing of the line's normal, its offset from the anchor.
    x: [f32; 4],
    p: [[f32; 4]; 4],
    place_ned_m: Horizontal,
    anchor_ned_m: Horizontal,
    started: bool,
}

impl State {
    /// The estimate of the source, as of the last sighting; `None` before [`Unknown::begin`].
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let (source, image) = self.source();
        let rows = self.source_by_state(image);
        let covariance_m2 = kalman::projected(&self.p, [&rows[0], &rows[1]]);
        Some(kalman::seen(self.place_ned_m, source, covariance_m2, 1e-3))
    }

    /// The image, as a source of its own.
    #[must_use]
    pub fn image(&self) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let [beta, rho, _, _] = self.x;
        let (east, north) = sin_cos(beta);
        let range_m = 1.0 / rho;
        let (turn, pull) = (range_m, -range_m * range_m);
        let rows = [[-east * turn, north * pull, 0.0, 0.0], [north * turn, east * pull, 0.0, 0.0]];
        let place = self.place_ned_m.plus(Horizontal { north, east }.times(range_m));
        Some(kalman::seen(self.place_ned_m, place, kalman::projected(&self.p, [&rows[0], &rows[1]]), 1e-3))
    }

    /// The line, unbounded, with the standard deviations of its angle and of its distance from where the filter began.
    #[must_use]
    pub fn line(&self) -> Option<(Wall, [f32; 2])> {
        let normal_ned = Horizontal::from_bearing(self.x[2]);
        let offset_m = self.x[3] + normal_ned.dot(self.anchor_ned_m);
        let sigma = [sqrt(self.p[2][2]), sqrt(self.p[3][3])];
        self.started.then_some((Wall { normal_ned, offset_m, from_m: -1e5, to_m: 1e5 }, sigma))
    }

    /// Its mean: bearing and inverse range of the image, bearing of the normal, offset from the anchor.
    #[must_use]
    pub fn mean(&self) -> &[f32; 4] {
        &self.x
    }

    /// Its covariance.
    #[must_use]
    pub fn covariance(&self) -> &[[f32; 4]; 4] {
        &self.p
    }

    /// The source, and its image from the anchor.
    fn source(&self) -> (Horizontal, Horizontal) {
        let [beta, rho, phi, offset] = self.x;
        let image = self.place_ned_m.minus(self.anchor_ned_m).plus(Horizontal::from_bearing(beta).times(1.0 / rho));
        (self.anchor_ned_m.plus(mirrored(image, phi, offset).0), image)
    }

    /// Derivatives of the source's place, north and east, by the state.
    fn source_by_state(&self, image: Horizontal) -> [[f32; 4]; 2] {
        let [beta, rho, phi, offset] = self.x;
        let (_, by_phi, normal) = mirrored(image, phi, offset);
        let mirror = |v: Horizontal| v.minus(normal.times(2.0 * normal.dot(v)));
        let range_m = 1.0 / rho;
        let along = Horizontal::from_bearing(beta);
        let across = Horizontal { north: -along.east, east: along.north };
        let (by_beta, by_rho) = (mirror(across.times(range_m)), mirror(along.times(-range_m * range_m)));
        let by_offset = normal.times(2.0);
        [
            [by_beta.north, by_rho.north, by_phi.north, by_offset.north],
            [by_beta.east, by_rho.east, by_phi.east, by_offset.east],
        ]
    }
}

/// The mirror image of a point, its derivative by the line's angle, and the normal.
fn mirrored(point: Horizontal, phi: f32, offset: f32) -> (Horizontal, Horizontal, Horizontal) {
    let normal = Horizontal::from_bearing(phi);
    let turned = Horizontal { north: -normal.east, east: normal.north };
    let distance = normal.dot(point) - offset;
    let by_phi = turned.times(distance).plus(normal.times(turned.dot(point))).times(-2.0);
    (point.minus(normal.times(2.0 * distance)), by_phi, normal)
}

impl Unknown {
    /// Begins with a guess of the source and the line.
    ///
    /// # Errors
    /// [`Degenerate::NoLine`] when either is none, [`Degenerate::OnLine`] when the vehicle is on the line,
    /// [`Degenerate::NoReflection`] when the source is not on the vehicle's side of it.
    pub fn begin(&self, state: &mut State, guess: &Guess) -> Result<(), Degenerate> {
        let anchor = guess.vehicle_ned_m;
        let sigmas = [guess.source_sigma_m, guess.angle_sigma_rad, guess.offset_sigma_m];
        let plausible = sigmas.iter().all(|sigma| *sigma >= 0.0 && *sigma < 1e5)
            && anchor.norm_squared() < 1e12
            && guess.source_ned_m.norm_squared() < 1e12;
        if !(plausible && guess.line.is_valid()) {
            return Err(Degenerate::NoLine);
        }
        let [here, there] = [anchor, guess.source_ned_m].map(|place| guess.line.distance_m(place));
        if libm::fabsf(here) < ON_LINE_M {
            return Err(Degenerate::OnLine);
        }
        if !(here * there > 0.0) {
            return Err(Degenerate::NoReflection);
        }
        let (phi, offset) = (guess.line.normal_ned.bearing_rad(), -here);
        let (image, by_phi, normal) = mirrored(guess.source_ned_m.minus(anchor), phi, offset);
        let range_m = image.norm();
        let u = image.times(1.0 / range_m);
        let w = Horizontal { north: -u.east, east: u.north };
        let rho = between(1.0 / range_m, 1.0 / self.config.range_max_m, 1.0 / self.config.range_min_m);
        // The image's bearing and inverse range by the source's place, the angle and the offset; the source's own
        // uncertainty is round, and so is its mirror image.
        let state_by = |e: Horizontal| [rho * w.dot(e), -rho * rho * u.dot(e)];
        let (by_phi, by_offset) = (state_by(by_phi), state_by(normal.times(2.0)));
        let [source, angle, offset_sigma] = sigmas.map(|sigma| sigma * sigma);
        let mut p = [[0.0; 4]; 4];
        p[0][0] = rho * rho * source;
        p[1][1] = rho * rho * rho * rho * source;
        for i in 0..2 {
            for j in 0..2 {
                p[i][j] += by_phi[i] * by_phi[j] * angle + by_offset[i] * by_offset[j] * offset_sigma;
            }
            (p[i][2], p[i][3]) = (by_phi[i] * angle, by_offset[i] * offset_sigma);
            (p[2][i], p[3][i]) = (p[i][2], p[i][3]);
        }
        (p[2][2], p[3][3]) = (angle, offset_sigma);
        keep_positive(&mut p);
        *state = State {
            x: [u.bearing_rad(), rho, phi, offset],
            p,
            place_ned_m: anchor,
            anchor_ned_m: anchor,
            started: true,
        };
        Ok(())
    }

    /// Updates with a sighting off the line.
    ///
    /// # Errors
    /// [`Degenerate::NotBegun`] before [`Unknown::begin`], and again after [`Update::Overhead`].
    pub fn step(&self, state: &mut State, sighting: &Sighting) -> Result<Update, Degenerate> {
        if !sighting.is_plausible() {
            return Ok(Update::Refused);
        }
        if !state.started {
            return Err(Degenerate::NotBegun);
        }
        if !self.predict(state, sighting.place_ned_m, sighting.since_s) {
            *state = State::default();
            return Ok(Update::Overhead);
        }
        let floor = self.config.sigma_floor_rad;
        let sigma_rad = if sighting.sigma_rad > floor { sighting.sigma_rad } else { floor };
        Ok(self.update(state, sighting.direction_ned.bearing_rad(), sigma_rad))
    }

    /// Moves the state to the vehicle's present position; false when it is at the image.
    fn predict(&self, state: &mut State, place_ned_m: Horizontal, dt_s: f32) -> bool {
        let config = &self.config;
        let moved = place_ned_m.minus(state.place_ned_m);
        state.place_ned_m = place_ned_m;
        let [beta, rho, _, _] = state.x;
        let (sine, cosine) = sin_cos(beta);
        let m = Horizontal { north: cosine - rho * moved.north, east: sine - rho * moved.east };
        let s = m.norm();
        if !(s > OVERHEAD) || rho > s / config.range_min_m {
            return false;
        }
        let shrink = 1.0 / s;
        let u = m.times(shrink);
        let w = Horizontal { north: -u.east, east: u.north };
        let turned = Horizontal { north: -sine, east: cosine };
        let next = rho * shrink;
        // Rows of the derivative by bearing and inverse range.
        let f = [
            [w.dot(turned) * shrink, -w.dot(moved) * shrink],
            [-next * u.dot(turned) * shrink, (1.0 + next * u.dot(moved)) * shrink],
        ];
        state.x[0] = u.bearing_rad();
        state.x[1] = next;
        let p = &mut state.p;
        // F P, then its columns.
        for j in 0..4 {
            let (top, below) = (p[0][j], p[1][j]);
            p[0][j] = f[0][0] * top + f[0][1] * below;
            p[1][j] = f[1][0] * top + f[1][1] * below;
        }
        let [a, b] = [[p[0][0], p[0][1]], [p[1][0], p[1][1]]];
        p[0][0] = a[0] * f[0][0] + a[1] * f[0][1];
        p[0][1] = a[0] * f[1][0] + a[1] * f[1][1];
        p[1][1] = b[0] * f[1][0] + b[1] * f[1][1];
        p[1][0] = p[0][1];
        for j in 2..4 {
            (p[j][0], p[j][1]) = (p[0][j], p[1][j]);
        }
        let walk = next * next * config.odometry_m2_per_s * dt_s;
        p[0][0] += walk;
        p[1][1] += walk * next * next;
        p[2][2] += config.angle_rad2_per_s * dt_s;
        p[3][3] += config.offset_m2_per_s * dt_s;
        true
    }

    /// Updates with a bearing, as [`polar`](foxhound_core::localize::source::polar) does.
    fn update(&self, state: &mut State, bearing_ned_rad: f32, sigma_rad: f32) -> Update {
        let config = &self.config;
        let r = sigma_rad * sigma_rad;
        let innovation = wrap_pi(bearing_ned_rad - state.x[0]);
        let s = state.p[0][0] + r;
        let nis = innovation * innovation / s;
        // sqrt(2 pi).
        let inlier = (1.0 - config.outlier_rate) * libm::expf(-0.5 * nis) / (2.506_628_3 * sqrt(s));
        let outlier = config.outlier_rate * (0.5 * core::f32::consts::FRAC_1_PI);
        // Far out, both may vanish.
        let likelihood = inlier + outlier + 1e-30;
        let weight = (inlier + 1e-30) / likelihood;
        let row = state.p[0];
        let gain = weight * innovation / s;
        let known = weight * (1.0 - (1.0 - weight) * nis) / s;
        for i in 0..4 {
            state.x[i] += gain * row[i];
            for j in i..4 {
                let entry = state.p[i][j] - known * row[i] * row[j];
                (state.p[i][j], state.p[j][i]) = (entry, entry);
            }
        }
        // Positive as it stands, where the difference above loses digits.
        if weight > 0.999 {
            state.p[0][0] = row[0] * r / s;
        }
        self.keep_sound(state);
        Update::Fused { nis, weight, likelihood }
    }

    /// Within its ranges, and positive.
    fn keep_sound(&self, state: &mut State) {
        let config = &self.config;
        state.x[0] = wrap_pi(state.x[0]);
        state.x[1] = between(state.x[1], 1.0 / config.range_max_m, 1.0 / config.range_min_m);
        state.x[2] = wrap_pi(between(state.x[2], -100.0, 100.0));
        state.x[3] = between(state.x[3], -1e6, 1e6);
        // Angles worse than uniform are uniform.
        for angle in [0, 2] {
            let most = BEARING_SIGMA_MAX_RAD * BEARING_SIGMA_MAX_RAD;
            if state.p[angle][angle] > most {
                let scale = BEARING_SIGMA_MAX_RAD / sqrt(state.p[angle][angle]);
                for j in 0..4 {
                    state.p[angle][j] *= scale;
                    state.p[j][angle] = state.p[angle][j];
                }
                state.p[angle][angle] = most;
            }
        }
        keep_positive(&mut state.p);
    }
}

#[cfg(test)]
mod tests;
