//! Where the source may be, another way: particles weighted by the bearings, with which the bank is compared.
//!
//! A bearing contains no range, and the intersection of two nearly parallel bearings gives a poor one. So the whole
//! posterior is kept, as 256 weighted particles (positions). The first bearing spreads them along its line, evenly in
//! the logarithm of the range; every later sighting updates their weights by
//!
//! ```text
//!     log w -= rho / 2,   rho = x^2 / (1 + x^2 / c),   x = angle between sighting and particle / sigma
//! ```
//!
//! (Geman and `McClure` 1985): an outlier costs at most `c / 2`, however far off it is. When few particles carry most
//! of the weight, all are resampled in proportion to it and spread by a part of their own covariance (regularised
//! particle filter, Musso, Oudjane and Le Gland 2001), so that their spacing shrinks with the uncertainty. Sightings
//! that contradict all particles add new ones.

use super::Sighting;
use super::support::{SourcePosition, moments};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::rng::Rng;

/// Number of particles.
const PARTICLES: usize = 256;
/// Nearest and farthest range of a particle after the first bearing.
const RANGE_MIN_M: f32 = 0.5;
const RANGE_MAX_M: f32 = 60.0;
/// A vehicle position farther from the origin than this is refused.
const FAR_M: f32 = 1e5;
/// Lower limit of a sighting's standard deviation: the errors of sightings are not independent.
const SIGMA_FLOOR_RAD: f32 = 0.02;
/// `c` of the weight update.
const OUTLIER_COST: f32 = 9.0;
/// Share of the log-weight that is forgotten per second, for a source that moves.
const FORGET_PER_S: f32 = 0.03;
/// Standard deviation of the spread at a resampling, as a share of the particles' own.
const BANDWIDTH: f32 = 0.2;
/// `sqrt(1 - BANDWIDTH^2)`.
const SHRINK: f32 = 0.979_796;
/// Least spread at a resampling.
const SPREAD_MIN_M: f32 = 0.02;
/// Mean `rho` of the sightings above which the particles are considered wrong.
const CONTRADICTION: f32 = 4.5;
/// Memory of that mean, in sightings.
const CONTRADICTION_MEMORY: f32 = 8.0;

/// The weighted particles.
pub(super) struct Posterior {
    places: [Horizontal; PARTICLES],
    log_weights: [f32; PARTICLES],
    /// Weights as of the last resampling or estimate, summing to one.
    weights: [f32; PARTICLES],
    started: bool,
    contradiction: f32,
}

impl Posterior {
    /// No sighting yet.
    pub(super) fn new() -> Self {
        Self {
            places: [Horizontal { north: 0.0, east: 0.0 }; PARTICLES],
            log_weights: [0.0; PARTICLES],
            weights: [0.0; PARTICLES],
            started: false,
            contradiction: 0.0,
        }
    }

    /// The particles' positions and their weights, which sum to one.
    pub(super) fn particles(&self) -> impl Iterator<Item = (Horizontal, f32)> + Clone {
        self.places.iter().copied().zip(self.weights.iter().copied())
    }

    /// Processes sightings, the oldest first.
    pub(super) fn observe(&mut self, sightings: &[Sighting], rng: &mut Rng) {
        for sighting in sightings {
            self.take(sighting, rng);
        }
        let (Some(last), true) = (sightings.last(), self.started) else { return };
        let effective = self.weigh();
        if self.contradiction > CONTRADICTION {
            self.refresh(last, rng);
        } else if effective < 0.5 * PARTICLES as f32 {
            self.resample(rng);
        }
    }

    fn take(&mut self, sighting: &Sighting, rng: &mut Rng) {
        let sane = sighting.place_ned_m.norm_squared() < FAR_M * FAR_M
            && libm::fabsf(sighting.direction_ned.norm_squared() - 1.0) < 0.01
            && sighting.sigma_rad > 0.0
            && sighting.sigma_rad < core::f32::consts::PI
            && sighting.since_s >= 0.0;
        if !sane {
            return;
        }
        if !self.started {
            self.started = true;
            self.weights = [1.0 / PARTICLES as f32; PARTICLES];
            for (index, place) in self.places.iter_mut().enumerate() {
                *place = along(sighting, index, rng);
            }
            return;
        }
        let variance = variance(sighting);
        let keep = 1.0 - (FORGET_PER_S * sighting.since_s).clamp(0.0, 0.5);
        let (mut rho_sum, mut weight_sum) = (0.0, 0.0);
        let direction = sighting.direction_ned;
        for ((place, log_weight), weight) in self.places.iter().zip(&mut self.log_weights).zip(&self.weights) {
            let to = place.minus(sighting.place_ned_m);
            let along = to.dot(direction);
            let across = to.north * direction.east - to.east * direction.north;
            // The tangent in place of the angle: where they differ much, the sighting is an outlier either way.
            let rho = if along > 0.0 {
                let squared = across * across;
                squared / (variance * along * along + squared * (1.0 / OUTLIER_COST))
            } else {
                OUTLIER_COST
            };
            *log_weight = *log_weight * keep - 0.5 * rho;
            rho_sum += rho * weight;
            weight_sum += weight;
        }
        let rho = if weight_sum > 0.0 { rho_sum / weight_sum } else { 0.0 };
        self.contradiction += (rho - self.contradiction) / CONTRADICTION_MEMORY;
    }

    /// Turns log-weights into weights; returns the effective number of particles.
    fn weigh(&mut self) -> f32 {
        let most = self.log_weights.iter().fold(f32::NEG_INFINITY, |a, b| if *b > a { *b } else { a });
        let (mut sum, mut squares) = (0.0, 0.0);
        for (weight, log_weight) in self.weights.iter_mut().zip(&mut self.log_weights) {
            // Relative to the best, so that they neither vanish nor drift.
            *log_weight -= most;
            *weight = if *log_weight > -20.0 { libm::expf(*log_weight) } else { 0.0 };
            sum += *weight;
            squares += *weight * *weight;
        }
        for weight in &mut self.weights {
            *weight *= 1.0 / sum;
        }
        sum * sum / squares
    }

    /// Resamples the particles in proportion to their weights (systematic resampling), spread by a part of their
    /// covariance.
    fn resample(&mut self, rng: &mut Rng) {
        let (mean, [nn, ne, ee]) = moments(self.particles());
        // Cholesky factor of the covariance.
        let north = sqrt(nn);
        let cross = if north > 1e-6 { ne / north } else { 0.0 };
        let rest = ee - cross * cross;
        let east = sqrt(if rest > 0.0 { rest } else { 0.0 });

        let old = self.places;
        let step = 1.0 / PARTICLES as f32;
        let mut wanted = step * rng.uniform();
        let (mut source, mut reached) = (0, self.weights[0]);
        for place in &mut self.places {
            while reached < wanted && source + 1 < PARTICLES {
                source += 1;
                reached += self.weights[source];
            }
            wanted += step;
            let (a, b) = (rng.bell(), rng.bell());
            let spread = Horizontal { north: north * a, east: cross * a + east * b }.times(BANDWIDTH);
            let least = Horizontal { north: b, east: -a }.times(SPREAD_MIN_M);
            // Contracted by as much as the spread adds, so that the covariance is unchanged (Liu and West 2001).
            *place = mean.plus(old[source].minus(mean).times(SHRINK)).plus(spread).plus(least);
        }
        self.log_weights = [0.0; PARTICLES];
        self.weights = [step; PARTICLES];
    }

    /// Replaces every second particle by a new one along a sighting that contradicts them.
    fn refresh(&mut self, sighting: &Sighting, rng: &mut Rng) {
        self.contradiction = 0.0;
        for index in (0..PARTICLES).step_by(2) {
            self.places[index] = along(sighting, index, rng);
        }
        self.log_weights = [0.0; PARTICLES];
        self.weights = [1.0 / PARTICLES as f32; PARTICLES];
    }

    /// Mean and spread; `None` before the first sighting.
    pub(super) fn estimate(&self) -> Option<SourcePosition> {
        self.started.then(|| SourcePosition::of(self.particles()))
    }
}

/// A particle along a sighting; the ranges of all particles are spread evenly in their logarithm.
fn along(sighting: &Sighting, index: usize, rng: &mut Rng) -> Horizontal {
    let share = (index as f32 + 0.5) / PARTICLES as f32;
    let range_m = RANGE_MIN_M * libm::expf(share * libm::logf(RANGE_MAX_M / RANGE_MIN_M));
    let direction = sighting.direction_ned;
    let side = Horizontal { north: -direction.east, east: direction.north };
    let off = range_m * sqrt(variance(sighting)) * rng.bell();
    sighting.place_ned_m.plus(direction.times(range_m)).plus(side.times(off))
}

/// Variance of a sighting's direction, with its lower limit.
fn variance(sighting: &Sighting) -> f32 {
    sighting.sigma_rad * sighting.sigma_rad + SIGMA_FLOOR_RAD * SIGMA_FLOOR_RAD
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::units::sin_cos;
    use crate::localize::source::bank;
    use crate::localize::source::support::Support;

    const SOURCE: Horizontal = Horizontal { north: 9.0, east: 2.0 };

    /// Straight on, with a detour of a metre and a half to the right.
    fn bent(s: f32) -> Horizontal {
        let off = if (1.0..5.0).contains(&s) { 1.5 * sin_cos((s - 1.0) * 0.785).0 } else { 0.0 };
        Horizontal { north: s, east: 0.2 * s - off }
    }

    /// Flies a path at 1 m/s; the error and the told spread at its end, of the bank and of the particles. A share of the
    /// bearings comes from anywhere.
    fn fly(seed: u64, sigma_rad: f32, path: impl Fn(f32) -> Horizontal, wrong: f32) -> [SourcePosition; 2] {
        let (bank, mut state) = (bank::Config::DEFAULT.build().unwrap(), bank::State::new());
        let (mut particles, mut rng, mut draws) = (Posterior::new(), Rng::new(seed, 99), Rng::new(seed, 98));
        for step in 0..60 {
            let place_ned_m = path(0.1 * step as f32);
            let mut bearing_rad = SOURCE.minus(place_ned_m).bearing_rad() + sigma_rad * rng.gaussian();
            if rng.uniform() < wrong {
                bearing_rad = core::f32::consts::TAU * rng.uniform();
            }
            let direction_ned = Horizontal::from_bearing(bearing_rad);
            let sighting = Sighting { place_ned_m, direction_ned, sigma_rad, since_s: 0.1 };
            bank.step(&mut state, &sighting, 0.0, &[]);
            particles.observe(&[sighting], &mut draws);
        }
        let mut support = Support::default();
        state.support(&mut support);
        [support.mean().unwrap(), particles.estimate().unwrap()]
    }

    fn rms_m(sigma_rad: f32, wrong: f32) -> [f32; 2] {
        let flights: std::vec::Vec<_> = (0..60).map(|seed| fly(seed, sigma_rad, bent, wrong)).collect();
        [0, 1].map(|which| {
            let squares = flights.iter().map(|both| both[which].place_ned_m.minus(SOURCE).norm_squared());
            libm::sqrtf(squares.sum::<f32>() / 60.0)
        })
    }

    #[test]
    fn the_bank_finds_the_source_as_well_as_particles_do() {
        for sigma_deg in [0.5_f32, 1.86, 5.0] {
            let [bank_m, particles_m] = rms_m(sigma_deg.to_radians(), 0.0);
            assert!(bank_m < 1.1 * particles_m, "{sigma_deg}: {bank_m} m, {particles_m} m");
        }
    }

    #[test]
    fn among_outliers_too() {
        for wrong in [0.2, 0.4] {
            let [bank_m, particles_m] = rms_m(0.03, wrong);
            assert!(bank_m < 1.1 * particles_m, "{wrong}: {bank_m} m, {particles_m} m");
        }
    }

    #[test]
    fn on_a_straight_line_neither_claims_to_know_the_range() {
        for seed in 0..20 {
            for found in fly(seed, 0.03, |s| Horizontal { north: 0.5 * s, east: 0.111 * s }, 0.0) {
                let error_m = found.place_ned_m.minus(SOURCE).norm();
                assert!(
                    found.sigma_m > 2.0 && error_m < 3.0 * found.sigma_m,
                    "seed {seed}: {error_m} m off, {found:?}"
                );
            }
        }
    }
}
