//! The features: numbers that describe the last observations (looks) and how they differ.
//!
//! One source at rest, at the range `1 / rho` in the direction `e0` from the last observation, is seen from the
//! displacement `d_i` in the direction `e_i` with `e_i x (e0 - rho d_i) = 0`. With `e0 = e + delta n`, `e` the mean
//! direction and `n` across it, that is linear in `delta` and `rho`: two normal equations, with a weak prior of the
//! range. The residuals show how much the bearing varies beyond what motion explains.

use super::{Estimate, Features, LOOKS_MIN, Sightline};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::time::Instant;
use crate::base::units::between;
use crate::doa::bearing::Flags;

/// Number of observations that are kept.
pub const WINDOW: usize = 24;
/// Distance between observations: a quarter of the wavelength at 868 MHz, so that the fringes of two waves are
/// resolved.
pub const SPACING_M: f32 = 0.08;
/// Time after which a hovering vehicle keeps an observation, too.
const PAUSE_S: f32 = 0.2;

/// Number of features, the classifier's inputs.
pub const FEATURES: usize = 15;
/// Their names, in order.
pub const NAMES: [&str; FEATURES] = [
    "level_db",
    "slope_db_per_m",
    "fading_db",
    "closure",
    "coherence",
    "wavenumber",
    "multipath_share",
    "silent_share",
    "jitter",
    "misfit",
    "inverse_range",
    "inverse_range_sigma",
    "wall",
    "wall_nearer",
    "wall_inverse_range",
];

/// Level of an observation without a tone.
const SILENT_DB: f32 = -20.0;
/// Number of observations over which the array's own quality values are averaged.
const MEMORY: f32 = 12.0;
/// Smallest standard deviation of a bearing in the weights.
const SIGMA_MIN_RAD: f32 = 0.01;
/// Prior of the inverse range, and the inverse of its variance.
const PRIOR_PER_M: f32 = 0.08;
/// See `PRIOR_PER_M`.
const PRIOR_PRECISION_M2: f32 = 1.0 / (0.12 * 0.12);
/// Standard deviation of a wall's range, from its own and the vehicle's position, as inverse range.
const WALL_SIGMA_PER_M: f32 = 0.02;
/// Positions farther than this from the origin are refused.
const FAR_M: f32 = 1e6;

/// An observation as it is kept.
#[derive(Clone, Copy, Debug)]
struct Kept {
    place_ned_m: Horizontal,
    direction_ned: Horizontal,
    /// Weight of the direction; 0 when there is none.
    weight: f32,
    level_db: f32,
}

impl Kept {
    const NONE: Self = Self {
        place_ned_m: Horizontal { north: 0.0, east: 0.0 },
        direction_ned: Horizontal { north: 0.0, east: 0.0 },
        weight: 0.0,
        level_db: 0.0,
    };
}

/// The last observations, and the estimate.
#[derive(Clone, Debug)]
pub struct State {
    looks: [Kept; WINDOW],
    /// Index for the next one.
    next: u8,
    count: u8,
    /// Time of the last one.
    time: Instant,
    /// Means of closure, coherence, wavenumber and multipath flags.
    array: [f32; 4],
    /// Number of observations in these means.
    heard: f32,
    sightline: Sightline,
    pub(super) estimate: Estimate,
}

impl Default for State {
    fn default() -> Self {
        Self::new()
    }
}

/// The source at rest that fits the bearings best.
struct Fit {
    jitter_rad: f32,
    /// Mean of the squared residuals over their variance.
    misfit: f32,
    inverse_range_per_m: f32,
    inverse_range_sigma_per_m: f32,
}

impl State {
    /// No observation yet.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            looks: [Kept::NONE; WINDOW],
            next: 0,
            count: 0,
            time: Instant(0),
            array: [0.0; 4],
            heard: 0.0,
            sightline: Sightline::Unknown,
            estimate: Estimate::UNKNOWN,
        }
    }

    /// Number of observations that are kept.
    #[must_use]
    pub fn count(&self) -> usize {
        usize::from(self.count)
    }

    /// Keeps an observation, if it is far enough from the last one, in space or in time.
    pub(super) fn take(&mut self, look: &Features<'_>) -> bool {
        let here = look.place_ned_m;
        if !(here.norm_squared() < FAR_M * FAR_M) {
            return false;
        }
        let bearing = look.bearing;
        if let Some(last) = self.kept().next() {
            let moved = here.minus(last.place_ned_m).norm_squared();
            // A clock that went back counts as a pause.
            let paused = bearing.time < self.time || bearing.time.seconds_since(self.time) >= PAUSE_S;
            if moved < SPACING_M * SPACING_M && !paused {
                return false;
            }
        }
        self.time = bearing.time;
        self.sightline = look.sightline;

        let quality = &bearing.quality;
        let has_tone = !bearing.flags.contains(Flags::NO_SIGNAL) && quality.snr_db > SILENT_DB;
        let direction = look.bearing_ned_rad.filter(|angle| has_tone && libm::fabsf(*angle) <= 100.0);
        let mut kept = Kept { place_ned_m: here, level_db: SILENT_DB, ..Kept::NONE };
        if has_tone {
            kept.level_db = between(quality.snr_db, SILENT_DB, 60.0);
            let finite = |value: f32, low: f32, high: f32| if value >= low { between(value, low, high) } else { low };
            let incoherence = quality.coherence.map_or(0.01, |coherence| 1.0 - finite(coherence, 0.0, 1.0));
            let now = [
                libm::logf(1.0 + finite(quality.closure_chi2, 0.0, 1e6)),
                libm::logf(incoherence + 1e-4),
                finite(quality.wavenumber, 0.0, 4.0),
                if bearing.flags.contains(Flags::MULTIPATH) { 1.0 } else { 0.0 },
            ];
            self.heard = between(self.heard + 1.0, 1.0, MEMORY);
            for (mean, now) in self.array.iter_mut().zip(now) {
                *mean += (now - *mean) / self.heard;
            }
        }
        if let Some(angle) = direction {
            let sigma = if bearing.sigma_rad > SIGMA_MIN_RAD { bearing.sigma_rad } else { SIGMA_MIN_RAD };
            let sigma = between(sigma, SIGMA_MIN_RAD, 10.0);
            (kept.direction_ned, kept.weight) = (Horizontal::from_bearing(angle), 1.0 / (sigma * sigma));
        }
        if let Some(slot) = self.looks.get_mut(usize::from(self.next)) {
            *slot = kept;
        }
        self.next = (self.next + 1) % WINDOW as u8;
        self.count = if self.count < WINDOW as u8 { self.count + 1 } else { self.count };
        true
    }

    /// The observations, the newest first.
    fn kept(&self) -> impl Iterator<Item = &Kept> {
        let (new, old) = self.looks.split_at_checked(usize::from(self.next)).unwrap_or((&self.looks, &[]));
        let old = if self.count() < WINDOW { &[] } else { old };
        new.iter().rev().chain(old.iter().rev())
    }

    /// The features of the observations; `None` while there are fewer than [`LOOKS_MIN`].
    #[must_use]
    pub fn features(&self) -> Option<[f32; FEATURES]> {
        let last = self.kept().next()?;
        if self.count < LOOKS_MIN {
            return None;
        }
        let mut mean = Horizontal::default();
        for look in self.kept() {
            mean = mean.plus(look.direction_ned.times(look.weight));
        }
        let length = mean.norm();
        let along = if length > 1e-6 { mean.times(1.0 / length) } else { Horizontal { north: 1.0, east: 0.0 } };
        let [level_db, slope_db_per_m, fading_db, silent_share] = self.levels(last.place_ned_m, along);
        let fit = self.fit(last.place_ned_m, along);
        let [wall, wall_nearer, wall_inverse] = match self.sightline {
            Sightline::Unknown => [0.0; 3],
            Sightline::Clear => [-1.0, 0.0, 0.0],
            Sightline::Wall { range_m } => {
                let inverse = if range_m > 0.05 { 1.0 / range_m } else { 20.0 };
                let sigma = fit.inverse_range_sigma_per_m;
                let nearer = inverse - fit.inverse_range_per_m;
                let sigmas = nearer / sqrt(sigma * sigma + WALL_SIGMA_PER_M * WALL_SIGMA_PER_M);
                [1.0, between(sigmas, -5.0, 5.0), between(inverse, 0.0, 2.0)]
            }
        };
        let [closure, coherence, wavenumber, multipath_share] = self.array;
        Some([
            level_db,
            slope_db_per_m,
            fading_db,
            closure,
            coherence,
            wavenumber,
            multipath_share,
            silent_share,
            libm::logf(fit.jitter_rad + 1e-3),
            libm::logf(fit.misfit + 1e-2),
            between(fit.inverse_range_per_m, -0.5, 1.0),
            libm::logf(fit.inverse_range_sigma_per_m + 1e-4),
            wall,
            wall_nearer,
            wall_inverse,
        ])
    }

    /// Level, its slope towards the source, its residual around that slope (root mean square), share of silent
    /// observations.
    fn levels(&self, here: Horizontal, along: Horizontal) -> [f32; 4] {
        let (mut n, mut x, mut y, mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for look in self.kept().filter(|look| look.level_db > SILENT_DB) {
            let forward = look.place_ned_m.minus(here).dot(along);
            let level = look.level_db;
            n += 1.0;
            x += forward;
            y += level;
            xx += forward * forward;
            xy += forward * level;
            yy += level * level;
        }
        if n < 1.0 {
            return [SILENT_DB, 0.0, 0.0, 1.0];
        }
        let (mean_x, mean_y) = (x / n, y / n);
        let (sxx, sxy, syy) = (xx / n - mean_x * mean_x, xy / n - mean_x * mean_y, yy / n - mean_y * mean_y);
        // A slope needs motion of about a quarter of a metre.
        let slope = sxy / (between(sxx, 0.0, 1e6) + 0.06);
        let rest = syy - 2.0 * slope * sxy + slope * slope * sxx;
        let silent_share = 1.0 - n / f32::from(self.count);
        [mean_y, between(slope, -30.0, 30.0), sqrt(between(rest, 0.0, 1e4)), silent_share]
    }

    fn fit(&self, here: Horizontal, along: Horizontal) -> Fit {
        let across = Horizontal { north: -along.east, east: along.north };
        // Normal equations of y = delta a + rho b.
        let (mut aa, mut ab, mut bb) = (1e-3, 0.0, PRIOR_PRECISION_M2);
        let (mut ay, mut by) = (0.0, PRIOR_PRECISION_M2 * PRIOR_PER_M);
        let row = |look: &Kept| {
            let direction = look.direction_ned;
            let (cosine, sine) = (along.dot(direction), across.dot(direction));
            let moved = look.place_ned_m.minus(here);
            (cosine, moved.north * direction.east - moved.east * direction.north, sine)
        };
        for look in self.kept().filter(|look| look.weight > 0.0) {
            let (a, b, y) = row(look);
            // Bearings to the other side are not used.
            if a > 0.0 {
                aa += look.weight * a * a;
                ab += look.weight * a * b;
                bb += look.weight * b * b;
                ay += look.weight * a * y;
                by += look.weight * b * y;
            }
        }
        let determinant = aa * bb - ab * ab;
        // Positive except for rounding; otherwise only the direction is fitted.
        let (delta, rho, variance) = if determinant > 1e-5 * aa * bb {
            ((ay * bb - by * ab) / determinant, (by * aa - ay * ab) / determinant, aa / determinant)
        } else {
            (ay / aa, PRIOR_PER_M, 1.0 / PRIOR_PRECISION_M2)
        };
        let (mut n, mut square, mut chi2) = (0.0, 0.0, 0.0);
        for look in self.kept().filter(|look| look.weight > 0.0) {
            let (a, b, y) = row(look);
            let rest = if a > 0.0 { between(y - delta * a - rho * b, -1.0, 1.0) } else { 1.0 };
            n += 1.0;
            square += rest * rest;
            chi2 += look.weight * rest * rest;
        }
        let degrees = if n > 3.0 { n - 2.0 } else { 1.0 };
        let misfit = chi2 / degrees;
        let stretch = if misfit > 1.0 { misfit } else { 1.0 };
        let prior_variance = 1.0 / PRIOR_PRECISION_M2;
        let variance = between(variance * stretch, 1e-8, prior_variance);
        Fit {
            jitter_rad: sqrt(square / degrees),
            misfit,
            inverse_range_per_m: rho,
            inverse_range_sigma_per_m: sqrt(variance),
        }
    }
}
