//! The mmWave paper's filters of a first-order reflection, as printed: the baselines.
//!
//! - the line is known (eq. 8): the state is robot and transponder, `(p, p_tx)`, in the map's frame;
//! - it is unknown: the transponder is the origin, the state `(p, m, c)`; `m` and `c` walk at random.
//!
//! Both measure eq. 7 ([`law`](super::law)), x east and y north, with the sign of the ray opposite to eq. 3, as the
//! paper prints it. They cannot handle vertical walls.

use super::law::reflect;
use super::{Degenerate, Estimate, Sighting, Update, kalman};
use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::units::between;
use foxhound_core::localize::source::covariance::keep_positive;

/// Configuration of the filters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Smallest sigma assumed for a sighting.
    pub sigma_floor_rad: f32,
    /// Process noise of the position: a random walk with this variance a second, along each axis.
    pub walk_m2_per_s: f32,
    /// The same of the slope.
    pub slope_per_s: f32,
    /// The same of the intercept.
    pub intercept_m2_per_s: f32,
}

impl Config {
    /// The default, as a constant.
    pub const DEFAULT: Self =
        Self { sigma_floor_rad: 0.002, walk_m2_per_s: 1e-5, slope_per_s: 1e-7, intercept_m2_per_s: 1e-5 };

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Filter, ConfigError> {
        check("literal.sigma_floor_rad", self.sigma_floor_rad, 1e-4, 1.0)?;
        check("literal.walk_m2_per_s", self.walk_m2_per_s, 0.0, 10.0)?;
        check("literal.slope_per_s", self.slope_per_s, 0.0, 10.0)?;
        check("literal.intercept_m2_per_s", self.intercept_m2_per_s, 0.0, 10.0)?;
        Ok(Filter { config: *self })
    }
}

/// The configured filters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filter {
    config: Config,
}

/// How a filter begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guess {
    /// Position of the vehicle.
    pub vehicle_ned_m: Horizontal,
    /// Its standard deviation along each axis; when the line is unknown it counts as that of the source.
    pub vehicle_sigma_m: f32,
    /// Prior position of the source.
    pub source_ned_m: Horizontal,
    /// Its standard deviation along each axis.
    pub source_sigma_m: f32,
    /// Slope and intercept of the line in the map, x east and y north.
    pub slope_intercept: [f32; 2],
    /// Their standard deviations; unused when the line is known.
    pub slope_intercept_sigma: [f32; 2],
}

/// State of a filter, `(p, p_tx)` or `(p, m, c)`; by default it has not begun.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    x: [f32; 4],
    p: [[f32; 4]; 4],
    line: Option<[f32; 2]>,
    place_ned_m: Horizontal,
    started: bool,
}

impl State {
    /// The estimate of the source, as of the last sighting; `None` before [`Filter::begin_known`] or
    /// [`Filter::begin_unknown`].
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let [px, py, a, b] = self.x;
        let (place, rows) = if self.line.is_some() {
            (Horizontal { north: b, east: a }, [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]])
        } else {
            let from = self.place_ned_m.minus(Horizontal { north: py, east: px });
            (from, [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
        };
        let covariance_m2 = kalman::projected(&self.p, [&rows[0], &rows[1]]);
        Some(kalman::seen(self.place_ned_m, place, covariance_m2, 1e-3))
    }

    /// Slope and intercept of the line in the map, x east and y north.
    #[must_use]
    pub fn slope_intercept(&self) -> [f32; 2] {
        self.line.unwrap_or_else(|| {
            // From the frame of the transponder, which is at the vehicle's place less p.
            let [px, py, m, c] = self.x;
            let (tx, ty) = (self.place_ned_m.east - px, self.place_ned_m.north - py);
            [m, c + ty - m * tx]
        })
    }

    /// Its mean.
    #[must_use]
    pub fn mean(&self) -> &[f32; 4] {
        &self.x
    }

    /// Its covariance.
    #[must_use]
    pub fn covariance(&self) -> &[[f32; 4]; 4] {
        &self.p
    }
}

impl Filter {
    /// Begins with a known line (eq. 8).
    ///
    /// # Errors
    /// [`Degenerate::Vertical`]: there is no such slope.
    pub fn begin_known(&self, state: &mut State, guess: &Guess) -> Result<(), Degenerate> {
        let (p, t) = (xy(guess.vehicle_ned_m), xy(guess.source_ned_m));
        let sigma = [guess.vehicle_sigma_m, guess.vehicle_sigma_m, guess.source_sigma_m, guess.source_sigma_m];
        begin(state, guess, [p[0], p[1], t[0], t[1]], sigma, Some(guess.slope_intercept))
    }

    /// Begins with an unknown line, and the transponder as the origin.
    ///
    /// # Errors
    /// [`Degenerate::Vertical`]: there is no such slope.
    pub fn begin_unknown(&self, state: &mut State, guess: &Guess) -> Result<(), Degenerate> {
        let ([x, y], [tx, ty]) = (xy(guess.vehicle_ned_m), xy(guess.source_ned_m));
        let ([m, c], [m_sigma, c_sigma]) = (guess.slope_intercept, guess.slope_intercept_sigma);
        let sigma = [guess.source_sigma_m, guess.source_sigma_m, m_sigma, c_sigma];
        begin(state, guess, [x - tx, y - ty, m, c - ty + m * tx], sigma, None)
    }

    /// Updates with a sighting off the line.
    ///
    /// # Errors
    /// If eq. 7 has no value: the state has moved with the vehicle but was not updated.
    pub fn step(&self, state: &mut State, sighting: &Sighting) -> Result<Update, Degenerate> {
        if !sighting.is_plausible() {
            return Ok(Update::Refused);
        }
        if !state.started {
            return Err(Degenerate::NotBegun);
        }
        let config = &self.config;
        let [east, north] = xy(sighting.place_ned_m.minus(state.place_ned_m));
        state.place_ned_m = sighting.place_ned_m;
        state.x[0] += east;
        state.x[1] += north;
        let walk = [config.walk_m2_per_s, config.walk_m2_per_s];
        let rest = if state.line.is_some() { [0.0; 2] } else { [config.slope_per_s, config.intercept_m2_per_s] };
        for (i, density) in walk.into_iter().chain(rest).enumerate() {
            state.p[i][i] += density * sighting.since_s;
        }

        let [px, py, a, b] = state.x;
        let (ray, rest) = match state.line {
            Some(line) => (reflect([px, py], [a, b], line)?, [2, 3]),
            None => (reflect([px, py], [0.0; 2], [a, b])?, [4, 5]),
        };
        let g = ray.gradient;
        let predicted = kalman::Predicted { direction: ray.direction, gradient: [g[0], g[1], g[rest[0]], g[rest[1]]] };
        let [z_east, z_north] = xy(sighting.direction_ned.times(1.0 / sighting.direction_ned.norm()));
        let floor = config.sigma_floor_rad;
        let sigma_rad = if sighting.sigma_rad > floor { sighting.sigma_rad } else { floor };
        let weighed = kalman::update(&mut state.x, &mut state.p, &predicted, [z_east, z_north], sigma_rad * sigma_rad);
        state.x = state.x.map(|x| between(x, -5e5, 5e5));
        Ok(Update::Fused { nis: weighed.nis, weight: 1.0, likelihood: weighed.likelihood() })
    }
}

fn begin(
    state: &mut State,
    guess: &Guess,
    x: [f32; 4],
    sigma: [f32; 4],
    line: Option<[f32; 2]>,
) -> Result<(), Degenerate> {
    // Whether the line has a slope; a robot that is on it may leave it.
    if let Err(Degenerate::Vertical) = reflect([0.0; 2], [0.0; 2], guess.slope_intercept) {
        return Err(Degenerate::Vertical);
    }
    if !(x.iter().chain(&sigma).all(|x| libm::fabsf(*x) < 1e6)) {
        return Err(Degenerate::NoLine);
    }
    *state = State { x, p: [[0.0; 4]; 4], line, place_ned_m: guess.vehicle_ned_m, started: true };
    for (i, sigma) in sigma.into_iter().enumerate() {
        state.p[i][i] = sigma * sigma;
    }
    keep_positive(&mut state.p);
    Ok(())
}

/// In the paper's frame.
fn xy(ned: Horizontal) -> [f32; 2] {
    [ned.east, ned.north]
}

#[cfg(test)]
mod tests;
