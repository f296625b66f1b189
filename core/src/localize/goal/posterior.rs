//! Where the source may be: particles weighted by the bearings.
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

use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::rng::Rng;
use crate::localize::source::Sighting;

/// Number of particles.
pub const PARTICLES: usize = 256;
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
#[derive(Clone, Debug)]
pub struct Posterior {
    places: [Horizontal; PARTICLES],
    log_weights: [f32; PARTICLES],
    /// Weights as of the last resampling or estimate, summing to one.
    weights: [f32; PARTICLES],
    started: bool,
    contradiction: f32,
}

/// Mean and spread of the posterior.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Estimate {
    /// Mean position.
    pub place_ned_m: Horizontal,
    /// Square root of the larger eigenvalue of the covariance.
    pub sigma_m: f32,
}

impl Default for Posterior {
    fn default() -> Self {
        Self::new()
    }
}

impl Posterior {
    /// No sighting yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            places: [Horizontal { north: 0.0, east: 0.0 }; PARTICLES],
            log_weights: [0.0; PARTICLES],
            weights: [0.0; PARTICLES],
            started: false,
            contradiction: 0.0,
        }
    }

    /// Whether there has been a sighting.
    #[must_use]
    pub fn is_started(&self) -> bool {
        self.started
    }

    /// The particles' positions and their weights, which sum to one.
    pub fn particles(&self) -> impl Iterator<Item = (Horizontal, f32)> {
        self.places.iter().copied().zip(self.weights.iter().copied())
    }

    /// Processes sightings, the oldest first.
    pub fn observe(&mut self, sightings: &[Sighting], rng: &mut Rng) {
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
        let (mean, [[nn, ne], [_, ee]]) = self.moments();
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

    fn moments(&self) -> (Horizontal, [[f32; 2]; 2]) {
        let mut mean = Horizontal::default();
        for (place, weight) in self.particles() {
            mean = mean.plus(place.times(weight));
        }
        let (mut nn, mut ne, mut ee) = (0.0, 0.0, 0.0);
        for (place, weight) in self.particles() {
            let off = place.minus(mean);
            nn += weight * off.north * off.north;
            ne += weight * off.north * off.east;
            ee += weight * off.east * off.east;
        }
        (mean, [[nn, ne], [ne, ee]])
    }

    /// Mean and spread; `None` before the first sighting.
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let (place_ned_m, [[nn, ne], [_, ee]]) = self.moments();
        let (half_sum, half_difference) = (0.5 * (nn + ee), 0.5 * (nn - ee));
        let largest = half_sum + sqrt(half_difference * half_difference + ne * ne);
        Some(Estimate { place_ned_m, sigma_m: sqrt(largest) })
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

    const SOURCE: Horizontal = Horizontal { north: 9.0, east: 2.0 };

    /// Flies a path at 1 m/s and returns the posterior's error and claimed sigma at its end.
    fn fly(seed: u64, sigma_rad: f32, length_m: f32, path: impl Fn(f32) -> Horizontal, wrong: f32) -> (f32, f32) {
        let (mut posterior, mut rng) = (Posterior::new(), Rng::new(seed, 99));
        for step in 0..(length_m * 10.0) as u32 {
            let place_ned_m = path(0.1 * step as f32);
            let mut bearing_rad = SOURCE.minus(place_ned_m).bearing_rad() + sigma_rad * rng.gaussian();
            if rng.uniform() < wrong {
                bearing_rad += core::f32::consts::PI;
            }
            let direction_ned = Horizontal::from_bearing(bearing_rad);
            posterior.observe(&[Sighting { place_ned_m, direction_ned, sigma_rad, since_s: 0.1 }], &mut rng);
            let total: f32 = posterior.particles().map(|(_, weight)| weight).sum();
            assert!((total - 1.0).abs() < 1e-3, "{total}");
        }
        let estimate = posterior.estimate().unwrap();
        (estimate.place_ned_m.minus(SOURCE).norm(), estimate.sigma_m)
    }

    fn bent(s: f32) -> Horizontal {
        // Straight on, with a detour of a metre and a half to the right.
        let off = if (1.0..5.0).contains(&s) { 1.5 * crate::base::units::sin_cos((s - 1.0) * 0.785).0 } else { 0.0 };
        Horizontal { north: s, east: 0.2 * s - off }
    }

    #[test]
    fn a_detour_tells_the_range() {
        for (sigma_deg, bound_m) in [(0.5_f32, 0.8), (1.86, 0.9), (5.0, 2.2)] {
            let errors: std::vec::Vec<f32> =
                (0..40).map(|seed| fly(seed, sigma_deg.to_radians(), 6.0, bent, 0.0).0).collect();
            let rms = (errors.iter().map(|e| e * e).sum::<f32>() / 40.0).sqrt();
            assert!(rms < bound_m, "sigma {sigma_deg}: {rms}");
        }
    }

    #[test]
    fn on_a_straight_line_it_does_not_claim_to_know_the_range() {
        for seed in 0..20 {
            let (error_m, sigma_m) = fly(seed, 0.03, 3.0, |s| Horizontal { north: s, east: 0.222 * s }, 0.0);
            assert!(sigma_m > 2.0 && error_m < 3.0 * sigma_m, "seed {seed}: {error_m} m off, {sigma_m} m claimed");
        }
    }

    #[test]
    fn one_bearing_in_five_from_behind_does_no_harm() {
        let errors: std::vec::Vec<f32> = (0..40).map(|seed| fly(seed, 0.03, 6.0, bent, 0.2).0).collect();
        let rms = (errors.iter().map(|e| e * e).sum::<f32>() / 40.0).sqrt();
        assert!(rms < 1.6, "{rms}");
    }

    #[test]
    fn a_source_that_has_moved_away_is_found_again() {
        let (mut posterior, mut rng) = (Posterior::new(), Rng::new(4, 99));
        let mut observe = |posterior: &mut Posterior, source: Horizontal, s: f32| {
            let place_ned_m = bent(s);
            let bearing_rad = source.minus(place_ned_m).bearing_rad() + 0.03 * rng.gaussian();
            let direction_ned = Horizontal::from_bearing(bearing_rad);
            posterior.observe(&[Sighting { place_ned_m, direction_ned, sigma_rad: 0.03, since_s: 0.1 }], &mut rng);
        };
        (0..60).for_each(|k| observe(&mut posterior, SOURCE, 0.1 * k as f32));
        let other = Horizontal { north: 2.0, east: -4.0 };
        (0..60).for_each(|k| observe(&mut posterior, other, 6.0 - 0.1 * k as f32));
        let estimate = posterior.estimate().unwrap();
        assert!(estimate.place_ned_m.minus(other).norm() < 1.5, "{estimate:?}");
    }

    #[test]
    fn garbage_leaves_it_finite() {
        let mut posterior = Posterior::new();
        let wild = [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e30, 1e-30, 1.0];
        let (mut rng, mut draws) = (Rng::new(1, 5), Rng::new(1, 6));
        for _ in 0..3000 {
            let mut pick = || wild[(rng.uniform() * 6.99) as usize];
            let sighting = Sighting {
                place_ned_m: Horizontal { north: pick(), east: pick() },
                direction_ned: Horizontal { north: pick(), east: pick() },
                sigma_rad: pick(),
                since_s: pick(),
            };
            posterior.observe(&[sighting], &mut draws);
            let estimate = posterior.estimate();
            assert!(estimate.is_none_or(|e| e.place_ned_m.is_finite() && e.sigma_m.is_finite()), "{estimate:?}");
        }
    }
}
