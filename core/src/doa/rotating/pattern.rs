//! The antenna's gain pattern, and its best fit to a rotation.
//!
//! The gain is a raised cosine over a constant leakage from all directions, in dB
//!
//! ```text
//!     G(d) = 10 log10( ((1 + cos d) / 2)^n + 10^(-F / 10) )        n = 2: a cardioid, F: front to back
//! ```
//!
//! and has the harmonics `g_k cos(k d)`. A rotation in bins, `Q[b] = c + a G(beta_b - theta)` and noise, has the harmonics
//! `A_k, B_k`; least squares over `c, a, theta` is the place of the maximum of
//!
//! ```text
//!     C(theta) = sum_k g_k (A_k cos k theta + B_k sin k theta),     a = C / sum_k g_k^2
//! ```
//!
//! with the variance `2 s^2 / (N a^2 sum_k k^2 g_k^2)` for a residual of variance `s^2` in `N` bins. `a` is free because a
//! reflection or the noise floor flattens the pattern. Three harmonics hold nearly all of a pattern that is half as wide as
//! the circle; the residual is of all.

use core::f32::consts::PI;

use crate::base::error::{ConfigError, check};
use crate::base::units::{sin_cos, wrap_pi};

use super::bins::{BIN_RAD, BINS};

/// Harmonics that are used.
const HARMONICS: usize = 3;
/// Positions around the circle where sums of them are evaluated: every other bin is fine enough for three.
const PLACES: usize = BINS / 2;
/// From one to the next.
const PLACE_RAD: f32 = 2.0 * BIN_RAD;
/// Smallest standard deviation of a bin: readings come in steps of 1 dB or half of one.
const BIN_SIGMA_MIN_DB: f32 = 0.3;
/// Excess over white noise in the first harmonics that means something else: chi-square with four degrees of freedom
/// exceeds it once in 25.
const MISSED: f32 = 2.5;
/// `10 / ln 10`.
const DB: f32 = 4.342_945;

/// Cosines of `b` bins.
const COSINES: [f32; BINS] = {
    // Of 0 to 90 degrees by 7.5.
    let quarter: [f32; 13] = [
        1.0,
        0.991_444_9,
        0.965_925_8,
        0.923_879_5,
        0.866_025_4,
        0.793_353_3,
        core::f32::consts::FRAC_1_SQRT_2,
        0.608_761_4,
        0.5,
        0.382_683_4,
        0.258_819_05,
        0.130_526_2,
        0.0,
    ];
    let mut all = [0.0; BINS];
    let mut bin = 0;
    while bin < BINS {
        let from_ends = if bin <= 24 { bin } else { 48 - bin };
        all[bin] = if from_ends <= 12 { quarter[from_ends] } else { -quarter[24 - from_ends] };
        bin += 1;
    }
    all
};

/// Cosine and sine of `index` bins, less than [`BINS`].
pub fn table(index: usize) -> (f32, f32) {
    let behind = if index < BINS / 4 { index + BINS - BINS / 4 } else { index - BINS / 4 };
    (COSINES.get(index).copied().unwrap_or(0.0), COSINES.get(behind).copied().unwrap_or(0.0))
}

/// An antenna's pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// `n` of the raised cosine: 2 for a cardioid, more for a narrower lobe.
    pub exponent: f32,
    /// Gain to the front relative to the back.
    pub front_to_back_db: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { exponent: 2.0, front_to_back_db: 15.0 }
    }
}

impl Config {
    /// Checks the configuration and computes the harmonics of the pattern.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Pattern, ConfigError> {
        check("rotating.pattern.exponent", self.exponent, 0.5, 8.0)?;
        check("rotating.pattern.front_to_back_db", self.front_to_back_db, 3.0, 40.0)?;
        let gain_db: [f32; BINS] = core::array::from_fn(|bin| self.gain_db(bin as f32 * BIN_RAD));
        let harmonics = Harmonics::of(&gain_db);
        let span_db = self.gain_db(0.0) - self.gain_db(PI);
        let gains = harmonics.cosine;
        let power = gains.iter().map(|g| g * g).sum();
        let slope = gains.iter().enumerate().map(|(k, g)| (k + 1) as f32 * (k + 1) as f32 * g * g).sum();
        Ok(Pattern { gains, power, slope, variance: harmonics.variance, span_db })
    }

    /// Gain at an angle off the boresight.
    #[must_use]
    pub fn gain_db(&self, off_rad: f32) -> f32 {
        let lobe = 0.5 * (1.0 + sin_cos(off_rad).1);
        let front = if lobe > 1e-6 { libm::expf(self.exponent * libm::logf(lobe)) } else { 0.0 };
        DB * libm::logf(front + libm::expf(-self.front_to_back_db / DB))
    }
}

/// The configured pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// `g_k` from `k = 1`.
    gains: [f32; HARMONICS],
    /// `sum g_k^2` and `sum k^2 g_k^2`.
    power: f32,
    slope: f32,
    /// Mean square around the mean, of all harmonics.
    variance: f32,
    span_db: f32,
}

/// The first harmonics of a rotation.
struct Harmonics {
    cosine: [f32; HARMONICS],
    sine: [f32; HARMONICS],
    variance: f32,
}

impl Harmonics {
    fn of(values: &[f32; BINS]) -> Self {
        let mean = values.iter().sum::<f32>() / BINS as f32;
        let mut square = 0.0;
        let (mut cosine, mut sine) = ([0.0; HARMONICS], [0.0; HARMONICS]);
        let mut turned = [0_usize; HARMONICS];
        for value in values {
            let value = value - mean;
            square += value * value;
            for (k, ((cosine, sine), turned)) in cosine.iter_mut().zip(&mut sine).zip(&mut turned).enumerate() {
                let (c, s) = table(*turned);
                *cosine += value * c;
                *sine += value * s;
                *turned += k + 1;
                if *turned >= BINS {
                    *turned -= BINS;
                }
            }
        }
        let scale = 2.0 / BINS as f32;
        Self {
            cosine: cosine.map(|sum| scale * sum),
            sine: sine.map(|sum| scale * sum),
            variance: square / BINS as f32,
        }
    }
}

/// The best fit of the pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// Direction from the middle of the first bin, (-pi, pi].
    pub direction_rad: f32,
    /// Its standard deviation, from the residual.
    pub sigma_rad: f32,
    /// From the fitted pattern's lowest value to its highest.
    pub contrast_db: f32,
    /// Square of the fitted pattern over its variance: noise alone rarely exceeds it.
    pub significance: f32,
    /// How far the second maximum of the rotation's harmonics stands out, over their range; 0 with only one.
    pub second: f32,
    /// Direction of the highest maximum.
    pub hill_rad: f32,
    /// Square of the harmonics, of any shape, over the variance of the rest.
    pub roughness: f32,
}

impl Pattern {
    /// Fits the pattern to a rotation's averages, `filled` of which have a reading; `None` if all directions are
    /// equal.
    #[must_use]
    pub fn fit(&self, average_db: &[f32; BINS], filled: usize) -> Option<Fit> {
        let heard = Harmonics::of(average_db);
        let terms: [[f32; 2]; HARMONICS] = core::array::from_fn(|k| {
            let gain = self.gains.get(k).copied().unwrap_or(0.0);
            [heard.cosine.get(k), heard.sine.get(k)].map(|part| gain * part.copied().unwrap_or(0.0))
        });
        let (start, _) = highest(&sampled(&terms));
        let (direction_rad, correlation) = climb(&terms, start as f32 * PLACE_RAD);
        let shape: [[f32; 2]; HARMONICS] =
            core::array::from_fn(|k| [heard.cosine.get(k), heard.sine.get(k)].map(|part| part.copied().unwrap_or(0.0)));
        let shown = sampled(&shape);
        let (hill, _) = highest(&shown);
        let second = second_hill(&shown, hill);
        if !(correlation > 0.0) {
            return None;
        }
        let scale = correlation / self.power;
        let left = heard.variance - scale * scale * self.variance;
        let least = BIN_SIGMA_MIN_DB * BIN_SIGMA_MIN_DB;
        let filled = filled.max(8) as f32;
        // Three numbers were fitted.
        let residual = if left > least { left } else { least } * filled / (filled - 3.0);
        let energy = 0.5 * shape.as_flattened().iter().map(|part| part * part).sum::<f32>();
        let rest = heard.variance - energy;
        // Variance of a harmonic's part: of white noise, and of the first harmonics' difference from the pattern's,
        // two of which the fit could not change. A reflection is in that difference, not in the rest.
        let white = 2.0 * residual / filled;
        let missed = (energy - 0.5 * scale * scale * self.power) / (HARMONICS as f32 - 1.0);
        let part = if missed > MISSED * white { missed } else { white };
        let variance = part / (scale * scale * self.slope);
        Some(Fit {
            direction_rad: wrap_pi(direction_rad),
            sigma_rad: crate::base::math::sqrt(variance),
            contrast_db: scale * self.span_db,
            significance: 0.5 * filled * scale * scale * self.power / residual,
            second,
            hill_rad: wrap_pi(hill as f32 * PLACE_RAD),
            roughness: (filled - 2.0 * HARMONICS as f32) * energy / if rest > least { rest } else { least },
        })
    }
}

/// A sum of harmonics at each place.
fn sampled(terms: &[[f32; 2]; HARMONICS]) -> [f32; PLACES] {
    core::array::from_fn(|place| {
        let mut turned = 0;
        terms.iter().fold(0.0, |sum, [cosine, sine]| {
            turned += 2 * place;
            if turned >= BINS {
                turned -= BINS;
            }
            let (c, s) = table(turned);
            sum + cosine * c + sine * s
        })
    })
}

/// The position of the largest value, and that value.
fn highest(values: &[f32; PLACES]) -> (usize, f32) {
    let pick = |best: (usize, f32), (place, value): (usize, &f32)| if *value > best.1 { (place, *value) } else { best };
    values.iter().enumerate().fold((0, f32::NEG_INFINITY), pick)
}

/// How far the second maximum stands out of the minima that separate it from the highest one, over the whole range.
fn second_hill(values: &[f32; PLACES], top: usize) -> f32 {
    let at = |steps: usize| values.get((top + steps) % PLACES).copied().unwrap_or(0.0);
    let mut out = [0.0; PLACES];
    let mut valley = at(0);
    for (steps, out) in out.iter_mut().enumerate() {
        let here = at(steps);
        valley = if here < valley { here } else { valley };
        *out = here - valley;
    }
    let (range, mut best) = (at(0) - values.iter().copied().fold(f32::INFINITY, f32::min), 0.0_f32);
    valley = at(0);
    for (steps, out) in out.iter().enumerate().skip(1).rev() {
        let here = at(steps);
        valley = if here < valley { here } else { valley };
        let least = if here - valley < *out { here - valley } else { *out };
        best = if least > best { least } else { best };
    }
    if range > 0.0 { best / range } else { 0.0 }
}

/// From the position to the maximum, by Newton's steps; returns the direction and the correlation there.
fn climb(terms: &[[f32; 2]; HARMONICS], start_rad: f32) -> (f32, f32) {
    let value = |angle_rad: f32| {
        let (sine, cosine) = sin_cos(angle_rad);
        let (mut c, mut s) = (cosine, sine);
        let (mut sum, mut slope, mut bend) = (0.0, 0.0, 0.0);
        for (k, [a, b]) in terms.iter().enumerate() {
            let order = (k + 1) as f32;
            let (along, across) = (a * c + b * s, b * c - a * s);
            sum += along;
            slope += order * across;
            bend -= order * order * along;
            (c, s) = (c * cosine - s * sine, s * cosine + c * sine);
        }
        [sum, slope, bend]
    };
    let mut angle_rad = start_rad;
    for _ in 0..2 {
        let [_, slope, bend] = value(angle_rad);
        if bend < 0.0 {
            angle_rad =
                start_rad + crate::base::units::between(angle_rad - slope / bend - start_rad, -BIN_RAD, BIN_RAD);
        }
    }
    let [sum, _, _] = value(angle_rad);
    (angle_rad, sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;

    #[test]
    fn the_table_is_that_of_the_cosine() {
        for bin in 0..BINS {
            let (c, s) = table(bin);
            let angle = bin as f64 * std::f64::consts::TAU / BINS as f64;
            assert!((f64::from(c) - angle.cos()).abs() < 1e-6 && (f64::from(s) - angle.sin()).abs() < 1e-6, "{bin}");
        }
    }

    #[test]
    fn a_clean_pattern_is_found_between_the_bins_at_any_level() {
        for exponent in [1.0, 2.0, 4.0] {
            let config = Config { exponent, ..Config::default() };
            let pattern = config.build().unwrap();
            for k in 0..200 {
                let truth = wrap_pi(k as f32 * 0.0314);
                let heard = core::array::from_fn(|bin| -70.0 + config.gain_db(bin as f32 * BIN_RAD - truth));
                let fit = pattern.fit(&heard, BINS).unwrap();
                assert!(wrap_pi(fit.direction_rad - truth).abs() < 3e-3, "{truth}: {fit:?}");
                assert!((fit.contrast_db - pattern.span_db).abs() < 0.1 && fit.second < 0.1, "{fit:?}");
            }
        }
    }

    #[test]
    fn the_error_is_as_large_as_its_sigma_says() {
        let config = Config::default();
        let pattern = config.build().unwrap();
        let mut rng = Rng::new(4, 1);
        for noise_db in [1.0_f32, 3.0, 6.0] {
            let runs = 4000;
            let mut squares = 0.0;
            for _ in 0..runs {
                let truth = core::f32::consts::TAU * rng.uniform();
                let heard = core::array::from_fn(|bin| {
                    config.gain_db(bin as f32 * BIN_RAD - truth) + noise_db * rng.gaussian()
                });
                let fit = pattern.fit(&heard, BINS).unwrap();
                let off = wrap_pi(fit.direction_rad - truth) / fit.sigma_rad;
                squares += off * off;
            }
            // Chi-square of 4000 errors; sigma is itself estimated from 45 residuals, which adds 5 %.
            let ratio = squares / runs as f32;
            assert!((0.9..1.25).contains(&ratio), "{noise_db} dB: {ratio}");
        }
    }

    #[test]
    fn noise_alone_is_rarely_significant_and_two_sources_are_ambiguous() {
        let config = Config { exponent: 4.0, ..Config::default() };
        let pattern = config.build().unwrap();
        let mut rng = Rng::new(5, 1);
        let runs = 4000;
        let significant = (0..runs)
            .filter(|_| {
                let heard = core::array::from_fn(|_| 3.0 * rng.gaussian());
                pattern.fit(&heard, BINS).is_some_and(|fit| super::super::is_signal(&fit))
            })
            .count();
        assert!(significant <= 8, "{significant} of {runs}");
        let heard = core::array::from_fn(|bin| {
            let [a, b] = [0.0, 2.6].map(|at| libm::powf(10.0, 0.1 * config.gain_db(bin as f32 * BIN_RAD - at)));
            10.0 * libm::log10f(a + 0.9 * b)
        });
        let fit = pattern.fit(&heard, BINS).unwrap();
        assert!(fit.second > 0.3 && fit.hill_rad.abs() < 0.2 && fit.roughness > 100.0, "{fit:?}");
        assert_eq!(pattern.fit(&[-60.0; BINS], BINS), None);
    }
}
