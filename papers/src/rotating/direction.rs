//! Estimates the source's direction from successive rotations, without a position.
//!
//! The posterior of the direction, as weights of [`BINS`] directions, twice: once for a direction that hardly moves,
//! as it does far from the source, and once for one that moves fast or jumps, as it does near it. Each rotation the
//! weights of both are spread by a random walk, and a share is exchanged between them (an interacting multiple model,
//! after Blom and Bar-Shalom 1988); then they are multiplied by the likelihood of the measured bearing, which may be
//! an outlier with the rate `p` (eq. 2):
//!
//! ```text
//!     w(b) <- w(b) (p / (2 pi) + (1 - p) N(measured - b; sigma))
//! ```
//!
//! An outlier has a limited effect, and several from the same reflector remain a second maximum. The answer is the
//! circular mean of all weights: of all directions it is the one along which a step gains the most on average, the
//! greedy rule with a memory.
//!
//! Weights on a grid are accurate enough for a density that is no narrower than half a bin; therefore the sigma of a
//! bearing is never taken to be less than [`SIGMA_MIN_RAD`].

use foxhound_core::base::error::{ConfigError, check};
use foxhound_core::base::math::sqrt;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;

use foxhound_core::doa::rotating::bins::{BIN_RAD, BINS};
use foxhound_core::doa::rotating::pattern::table;

/// The smallest sigma assumed for a bearing.
pub const SIGMA_MIN_RAD: f32 = 0.7 * BIN_RAD;
/// Half the squared deviation beyond which a Gaussian counts as zero.
const TAIL: f32 = 12.0;
/// Probability that the direction moves fast when the signal is first received.
const FAST_FIRST: f32 = 0.05;
/// Largest number of passes of the random walk, and the largest share that each gives to either neighbour.
const PASSES_MAX: usize = 4;
const SHARE_MAX: f32 = 1.0 / 3.0;

/// Configuration of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Rate of outliers.
    pub outlier_rate: f32,
    /// Random walk of a direction that hardly moves, standard deviation after a second.
    pub slow_rad: f32,
    /// Random walk of a direction that moves fast, standard deviation after a second.
    pub fast_rad: f32,
    /// Rate at which the fast one jumps to any direction, as it does when the vehicle passes the source.
    pub renewal_per_s: f32,
    /// Rate of changes between the two.
    pub change_per_s: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { outlier_rate: 0.4, slow_rad: 0.02, fast_rad: 1.0, renewal_per_s: 2.0, change_per_s: 0.02 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Filter, ConfigError> {
        check("rotating.direction.outlier_rate", self.outlier_rate, 0.001, 0.95)?;
        check("rotating.direction.slow_rad", self.slow_rad, 0.0, 10.0)?;
        check("rotating.direction.fast_rad", self.fast_rad, self.slow_rad, 10.0)?;
        check("rotating.direction.renewal_per_s", self.renewal_per_s, 0.0, 100.0)?;
        check("rotating.direction.change_per_s", self.change_per_s, 0.0, 100.0)?;
        Ok(Filter { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Filter {
    config: Config,
}

/// The posterior; none before a measurement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    updated: Option<Instant>,
    slow: Weights,
    fast: Weights,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Weights([f32; BINS]);

impl Default for Weights {
    fn default() -> Self {
        Self([0.0; BINS])
    }
}

/// The estimate of the direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Circular mean, from north, clockwise, (-pi, pi].
    pub bearing_ned_rad: f32,
    /// Circular standard deviation; large with two maxima.
    pub sigma_rad: f32,
    /// Probability that the direction moves fast.
    pub fast: f32,
}

impl Weights {
    /// Spreads a share of the weight, up to all of it, over all directions.
    fn renew(&mut self, share: f32) {
        let share = if share < 1.0 { share } else { 1.0 };
        let each = share * self.0.iter().sum::<f32>() / BINS as f32;
        for weight in &mut self.0 {
            *weight += each - share * *weight;
        }
    }

    /// A random walk of this variance, in bins squared; as far as [`PASSES_MAX`] passes reach.
    fn spread(&mut self, variance_bins: f32) {
        let mut left = 0.5 * variance_bins;
        for _ in 0..PASSES_MAX {
            if !(left > 0.0) {
                return;
            }
            let share = if left < SHARE_MAX { left } else { SHARE_MAX };
            left -= share;
            let (Some(&first), Some(&last)) = (self.0.first(), self.0.last()) else { return };
            let mut before = last;
            for index in 0..BINS {
                let after = self.0.get(index + 1).copied().unwrap_or(first);
                if let Some(here) = self.0.get_mut(index) {
                    let was = *here;
                    *here += share * (before - was + (after - was));
                    before = was;
                }
            }
        }
    }
}

impl Filter {
    /// Takes a bearing from north, clockwise, with its standard deviation; `None` if they are NaN.
    pub fn step(&self, state: &mut State, time: Instant, bearing_ned_rad: f32, sigma_rad: f32) -> Option<Estimate> {
        if !(libm::fabsf(bearing_ned_rad) < 1e3 && sigma_rad >= 0.0) {
            return None;
        }
        self.predict(state, time);
        let likelihood = self.likelihood(bearing_ned_rad, sigma_rad);
        let (mut total, mut fast, mut north, mut east) = (0.0, 0.0, 0.0, 0.0);
        let pairs = state.slow.0.iter_mut().zip(&mut state.fast.0).zip(likelihood);
        for (bin, ((slow_weight, fast_weight), likelihood)) in pairs.enumerate() {
            *slow_weight *= likelihood;
            *fast_weight *= likelihood;
            let both = *slow_weight + *fast_weight;
            let (cosine, sine) = table(bin);
            total += both;
            fast += *fast_weight;
            north += both * cosine;
            east += both * sine;
        }
        // The outliers' part is never zero, so neither is the total.
        let scale = 1.0 / total;
        for weight in state.slow.0.iter_mut().chain(&mut state.fast.0) {
            *weight *= scale;
        }
        let length = scale * sqrt(north * north + east * east);
        let length = if length > 1e-6 { length } else { 1e-6 };
        Some(Estimate {
            bearing_ned_rad: libm::atan2f(east, north),
            sigma_rad: if length < 1.0 { sqrt(-2.0 * libm::logf(length)) } else { 0.0 },
            fast: fast * scale,
        })
    }

    /// Predicts the weights to an instant; all equal before the first.
    fn predict(&self, state: &mut State, time: Instant) {
        let Some(updated) = state.updated.replace(time) else {
            let alike = 1.0 / BINS as f32;
            (state.slow, state.fast) =
                (Weights([(1.0 - FAST_FIRST) * alike; BINS]), Weights([FAST_FIRST * alike; BINS]));
            return;
        };
        let elapsed_s = time.seconds_since(updated);
        let moved = self.config.change_per_s * elapsed_s;
        let moved = if moved < 0.5 { moved } else { 0.5 };
        for (slow, fast) in state.slow.0.iter_mut().zip(&mut state.fast.0) {
            let over = moved * (*fast - *slow);
            (*slow, *fast) = (*slow + over, *fast - over);
        }
        let walk = |sigma_rad: f32| sigma_rad * sigma_rad * elapsed_s / (BIN_RAD * BIN_RAD);
        state.slow.spread(walk(self.config.slow_rad));
        state.fast.spread(walk(self.config.fast_rad));
        state.fast.renew(self.config.renewal_per_s * elapsed_s);
    }

    /// Likelihood of each direction for a bearing, times the width of a bin.
    fn likelihood(&self, bearing_ned_rad: f32, sigma_rad: f32) -> [f32; BINS] {
        let sigma_rad = foxhound_core::base::units::between(sigma_rad, SIGMA_MIN_RAD, core::f32::consts::PI);
        let scale = 0.5 / (sigma_rad * sigma_rad);
        let mut all = [0.0; BINS];
        let mut sum = 0.0;
        for (bin, value) in all.iter_mut().enumerate() {
            let off_rad = wrap_pi(bearing_ned_rad - bin as f32 * BIN_RAD);
            let half_square = scale * off_rad * off_rad;
            if half_square < TAIL {
                *value = libm::expf(-half_square);
                sum += *value;
            }
        }
        let inliers = (1.0 - self.config.outlier_rate) / sum;
        let outliers = self.config.outlier_rate / BINS as f32;
        all.map(|value| inliers * value + outliers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::{PI, TAU};
    use foxhound_core::base::rng::Rng;

    fn hear(rng: &mut Rng, truth: f32, p: f32, sigma: f32) -> f32 {
        let outlier = (rng.uniform() <= p).then(|| TAU * rng.uniform());
        wrap_pi(outlier.unwrap_or(truth + sigma * rng.gaussian()))
    }

    #[test]
    fn a_direction_is_held_through_four_outliers_in_ten_and_across_the_wrap() {
        let filter = Config::default().build().unwrap();
        let mut rng = Rng::new(1, 1);
        for truth in [-PI, -1.0, 0.0, 2.5] {
            let (mut state, mut squares, mut claimed, sigma) = (State::default(), 0.0, 0.0, 0.35);
            for k in 0..2000_u64 {
                let heard = hear(&mut rng, truth, 0.4, sigma);
                let estimate = filter.step(&mut state, Instant(k * 100_000), heard, sigma).unwrap();
                if k >= 100 {
                    let error = wrap_pi(estimate.bearing_ned_rad - truth);
                    squares += error * error;
                    claimed += estimate.sigma_rad * estimate.sigma_rad;
                }
            }
            let (rms, claimed) = (sqrt(squares / 1900.0), sqrt(claimed / 1900.0));
            assert!(rms < 0.13, "{truth}: {rms}");
            // The truth stands still while the filter expects motion: the estimate may be better than its sigma, not
            // much worse.
            assert!(rms < 1.1 * claimed && claimed < 3.0 * rms, "{truth}: {rms} said {claimed}");
        }
    }

    #[test]
    fn it_is_the_posterior_of_bayes_rule_on_a_fine_grid() {
        let config = Config { slow_rad: 0.3, fast_rad: 0.3, renewal_per_s: 0.0, ..Config::default() };
        let filter = config.build().unwrap();
        let (mut state, mut rng) = (State::default(), Rng::new(2, 1));
        // The same model in f64 on a grid 30 times as fine, its random walk by an exact Gaussian.
        let fine = 1440;
        let step = std::f64::consts::TAU / f64::from(fine);
        let wrapped = |x: f64| x - std::f64::consts::TAU * (x / std::f64::consts::TAU).round();
        let mut weights = std::vec![1.0_f64; fine as usize];
        let walk: std::vec::Vec<f64> =
            (0..fine).map(|k| (-0.5 * wrapped(f64::from(k) * step).powi(2) / (0.09 * 0.1)).exp()).collect();
        for k in 0..25_u64 {
            let heard = hear(&mut rng, 1.0, 0.4, 0.35);
            if k > 0 {
                let n = fine as usize;
                weights = (0..n).map(|to| (0..n).map(|from| weights[from] * walk[(n + to - from) % n]).sum()).collect();
            }
            let mut sums = [0.0_f64; 3];
            for (bin, weight) in weights.iter_mut().enumerate() {
                let at = bin as f64 * step;
                let off = wrapped(f64::from(heard) - at) / 0.35;
                let gauss = (-0.5 * off * off).exp() / (0.35 * std::f64::consts::TAU.sqrt());
                *weight *= 0.4 / std::f64::consts::TAU + 0.6 * gauss;
                sums[0] += *weight;
                sums[1] += *weight * at.cos();
                sums[2] += *weight * at.sin();
            }
            weights.iter_mut().for_each(|weight| *weight /= sums[0]);
            let estimate = filter.step(&mut state, Instant(k * 100_000), heard, 0.35).unwrap();
            let length = (sums[1].hypot(sums[2]) / sums[0]).min(1.0);
            let off = wrapped(f64::from(estimate.bearing_ned_rad) - sums[2].atan2(sums[1]));
            assert!(off.abs() < 0.01, "{k}: off by {off}");
            let sigma = (-2.0 * length.ln()).sqrt();
            assert!((f64::from(estimate.sigma_rad) / sigma - 1.0).abs() < 0.03, "{k}: {estimate:?} {sigma}");
        }
    }

    #[test]
    fn a_reflector_that_answers_four_times_in_ten_does_not_win() {
        let filter = Config::default().build().unwrap();
        let (mut state, mut rng) = (State::default(), Rng::new(3, 1));
        let mut far = 0;
        for k in 0..1000_u64 {
            let outlier = (rng.uniform() <= 0.4).then_some(2.0);
            let heard = wrap_pi(outlier.unwrap_or(0.35 * rng.gaussian()));
            let estimate = filter.step(&mut state, Instant(k * 100_000), heard, 0.35).unwrap();
            far += usize::from(k > 100 && estimate.bearing_ned_rad.abs() > 0.8);
        }
        // The greedy rule goes astray 360 times.
        assert!(far < 240, "{far} of 900");
    }

    #[test]
    fn a_direction_that_starts_to_turn_is_followed() {
        let filter = Config::default().build().unwrap();
        let (mut state, mut rng, mut squares, mut fast) = (State::default(), Rng::new(4, 1), 0.0_f32, 0.0_f32);
        for k in 0..400_u64 {
            let truth = if k < 200 { 0.0 } else { 0.05 * (k - 200) as f32 };
            let heard = hear(&mut rng, wrap_pi(truth), 0.2, 0.2);
            let estimate = filter.step(&mut state, Instant(k * 100_000), heard, 0.2).unwrap();
            if k >= 230 {
                let error = wrap_pi(estimate.bearing_ned_rad - truth);
                squares += error * error;
                fast = fast.max(estimate.fast);
            }
        }
        let rms = sqrt(squares / 170.0);
        // The bearings themselves are off by 0.8 rad rms, outliers among them.
        assert!(rms < 0.4 && fast > 0.9, "{rms} {fast}");
    }
}
