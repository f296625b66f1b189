//! The source's position in the last metres: the belief's filter near the source, in Cartesian coordinates.
//!
//! A bearing near the beacon is two numbers that are well-behaved where azimuth and elevation are not: the wavenumber vector
//! `u = (k cos az, k sin az)`, which is the direction's part in the plane of the array. With `d` the unit vector from the
//! vehicle to the believed place, `r` its distance and `a` an axis of the body, both in NED,
//!
//! ```text
//!     u_a - a . d = H (x - x_believed) + noise,   H = (a - (a . d) d) / r,   sigma^2 = sigma_u^2 + floor^2
//! ```
//!
//! which is the recursive weighted least-squares fix of a position from lines, each weighted by its angle's sigma
//! times the range; written as a Kalman filter, with a random walk of the position as its fading memory. It is
//! unbiased: the noise is added to `u`, while lines through measured directions would pull the position towards the
//! vehicle. A bearing without a known elevation has one row, across its azimuth. The assumed depth of the beacon
//! counts as one measurement. Errors of successive bearings are correlated, so all bearings of a third of a second
//! count as one; and a bias that does not average out is added to the reported sigma.
//!
//! The fix begins when the mean direction is steep, or has swung round, or the bank's filter knows the range. It is
//! dropped when bearings do not agree with it. A distant reflection or outlier cannot hold it: its apparent position
//! would have to stay where it is while the vehicle moves past.
//!
//! Cost: in the bench's `landing_step`.

use super::Estimate;
use crate::base::history::{Axes, FullPose};
use crate::base::math::sqrt;
use crate::base::ned::{Horizontal, Ned};
use crate::base::time::Instant;
use crate::base::units::{between, sin_cos};
use crate::doa::bearing::{Bearing, Flags};

/// An elevation with a larger sigma counts as unknown.
const ELEVATION_SIGMA_MAX_RAD: f32 = 0.9;
/// A larger wavenumber is invalid; the smaller limit is used for clamping.
const K_MAX: f32 = 1.5;
const K_CLIPPED: f32 = 1.1;
/// A bearing with an ambiguous azimuth is used if the source is overhead.
const OVERHEAD_SIGMA_MAX_RAD: f32 = 0.5;
/// Noise of bearings is correlated over this time; a bias over this time, or over this distance.
const NOISE_ALIKE_S: f32 = 0.1;
const BIAS_ALIKE_S: f32 = 3.0;
const BIAS_ALIKE_M: f32 = 0.4;
/// Time constants of the mean direction, of agreement, and of strength.
const MEAN_MEMORY_S: f32 = 0.6;
/// A mean over less time than this is not used.
const MEAN_SETTLED_S: f32 = 1.0;
const AGREEMENT_MEMORY_S: f32 = 1.0;
const STRENGTH_MEMORY_S: f32 = 1.0;
/// Squared innovation over its variance up to which a bearing agrees: 99 % with two degrees of freedom.
const AGREES: f32 = 9.2;
/// Beyond this value its weight decreases.
const TRUSTED: f32 = 4.0;
/// Random walk of the position.
const WALK_M2_PER_S: f32 = 0.08;
/// A position nearer than this has no meaningful direction.
const RANGE_MIN_M: f32 = 0.3;
/// The beacon is assumed to be at least this far below.
const DEPTH_MIN_M: f32 = 0.5;
/// Down over length of a mean direction that is steep, and of one so steep that no second side is needed.
const STEEP: f32 = 0.57;
const OVERHEAD: f32 = 0.7;
/// Sine of the elevation from which on a source is not level.
const ABOVE: f32 = 0.17;
/// Share of the bearings that are steep where the beacon is near.
const STEEP_SHARE: f32 = 0.4;
/// A fix farther away than this is dropped.
const FAR_M: f32 = 8.0;
/// A swing of the direction happens within this distance.
const SWING_M: f32 = 2.0;
/// Cosine of the angle between two sides from which a position must have been seen.
const SIDES: f32 = 0.5;
/// And from at least this far.
const SIDE_M: f32 = 0.5;
/// A smaller share of the bearings that agree drops the fix.
const AGREEMENT_LOST: f32 = 0.42;
/// For a maximum, the strength must have risen by this much, and be within this of its maximum.
const RISE_DB: f32 = 6.0;
const MAXIMUM_DB: f32 = 3.0;
/// Longest time between bearings that counts.
const GAP_S: f32 = 0.5;
/// The beacon counts as heard for so long after a bearing: one that pulses is silent for up to a second.
const HEARD_S: f32 = 1.5;
/// Within this range the bank's position begins a fix, and the source counts as near.
pub(crate) const NEAR_M: f32 = 3.0;
/// Depth of the source below the vehicle if no range finder gives the height, and its standard deviation.
const BELOW_M: f32 = 2.0;
const BELOW_SIGMA_M: f32 = 1.0;
/// Standard deviation of the source's height over the ground, where there is a range finder.
const HEIGHT_SIGMA_M: f32 = 0.5;
/// Error of bearings that does not average out.
const FLOOR_RAD: f32 = 0.06;

/// The source's position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Fix {
    /// Local NED.
    pub place_ned_m: Ned,
    /// Standard deviation of the horizontal position along its worse axis, including the bias.
    pub sigma_m: f32,
    /// Horizontal distance from the vehicle.
    pub distance_m: f32,
    /// How far below the vehicle it is, 0.5 m at least.
    pub depth_m: f32,
    /// Share of the last bearings that agree with it.
    pub agreement: f32,
    /// Time with a signal since it began.
    pub heard_s: f32,
    /// Bearings have come from two sides, or from steeply below.
    pub is_surrounded: bool,
    /// The last bearing had an elevation, and yet few were steep.
    pub is_flat: bool,
    /// The signal is at its maximum, after a rise.
    pub is_loudest: bool,
    /// A bearing was used in the last half second.
    pub is_heard: bool,
}

/// State of the filter.
#[derive(Clone, Copy, Debug, Default)]
pub struct State {
    /// When a bearing was used last, if any.
    heard: Option<Instant>,
    /// Mean direction, NED, and where and in which direction it last differed.
    mean_ned: Ned,
    mean_s: f32,
    /// Share of the last bearings that were steep.
    steep: f32,
    swung_at_ned_m: Horizontal,
    swung_ned: Horizontal,
    /// Signal strength: mean, least and largest mean.
    strength_db: f32,
    least_db: f32,
    most_db: f32,
    /// The fix: position, covariance (nn, ne, ee, nd, ed, dd), share that agrees, time with a signal since it began.
    begun: bool,
    has_depth: bool,
    place_ned_m: Ned,
    covariance_m2: [f32; 6],
    /// Position at the last bearing.
    from_ned_m: Horizontal,
    agreement: f32,
    heard_s: f32,
    /// The direction of the first bearing of it, and whether it has been seen from another side.
    first_ned: Horizontal,
    has_sides: bool,
}

impl State {
    /// The position has jumped: all stored positions are shifted.
    pub fn shift(&mut self, by: Horizontal) {
        self.place_ned_m.north += by.north;
        self.place_ned_m.east += by.east;
        self.swung_at_ned_m = self.swung_at_ned_m.plus(by);
        self.from_ned_m = self.from_ned_m.plus(by);
    }
}

/// A bearing as a measurement.
struct Sight {
    /// Wavenumber vector in the body frame, and the variance of its noise; `None` for an unknown elevation.
    u: [f32; 2],
    variance: f32,
    is_level: bool,
}

/// The usable part of a bearing.
fn sight(bearing: &Bearing) -> Option<Sight> {
    let (sigma, elevation_sigma, k) = (bearing.sigma_rad, bearing.elevation_sigma_rad, bearing.quality.wavenumber);
    let is_level = !(elevation_sigma < ELEVATION_SIGMA_MAX_RAD && k > 0.0 && k < K_MAX);
    let bad = Flags(Flags::UNCALIBRATED.0 | Flags::NO_SIGNAL.0);
    let is_overhead = bearing.flags.contains(Flags::AMBIGUOUS)
        && bearing.flags.0 & bad.0 == 0
        && elevation_sigma < OVERHEAD_SIGMA_MAX_RAD;
    let sane = libm::fabsf(bearing.azimuth_rad) < 100.0 && sigma > 0.0 && sigma < 4.0;
    if !sane || !(bearing.valid || is_overhead) {
        return None;
    }
    let (sin_az, cos_az) = sin_cos(bearing.azimuth_rad);
    if is_level {
        return Some(Sight { u: [cos_az, sin_az], variance: sigma * sigma, is_level });
    }
    let level = 1.0 - k * k;
    let (across, along) = (sigma * k, elevation_sigma * sqrt(if level > 0.0 { level } else { 0.0 }));
    let sigma_u = if across > along { across } else { along };
    let k = if k < K_CLIPPED { k } else { K_CLIPPED };
    Some(Sight { u: [k * cos_az, k * sin_az], variance: sigma_u * sigma_u, is_level })
}

/// Depth of the source below the vehicle at a height over the ground, and its standard deviation.
fn below(height_m: Option<f32>) -> (f32, f32) {
    height_m.map_or((BELOW_M, BELOW_SIGMA_M), |height_m| (height_m, HEIGHT_SIGMA_M))
}

impl State {
    /// Takes a bearing, made at a pose. `height_m` is the height over the ground.
    pub fn hear(&mut self, bearing: &Bearing, pose: &FullPose, height_m: Option<f32>) {
        let Some(sight) = sight(bearing) else { return };
        let since_s = self.heard.map_or(0.02, |heard| bearing.time.seconds_since(heard));
        if !(since_s > 0.0) {
            return;
        }
        let since_s = if since_s < GAP_S { since_s } else { GAP_S };
        let axes = pose.axes();
        let [forward, right] = sight.u;
        let squared = 1.0 - forward * forward - right * right;
        let under = sqrt(if squared > 0.0 { squared } else { 0.0 });
        let direction = if sight.is_level {
            let (sin_yaw, cos_yaw) = sin_cos(pose.yaw_rad);
            Ned { north: forward * cos_yaw - right * sin_yaw, east: forward * sin_yaw + right * cos_yaw, down: 0.0 }
        } else {
            axes.to_ned([forward, right, under])
        };
        let here = pose.place_ned_m.horizontal();
        let was_heard = self.heard.is_some();
        self.heard = Some(bearing.time);
        self.weigh_strength(bearing.quality.snr_db, since_s, was_heard);

        let share = since_s / (MEAN_MEMORY_S + since_s);
        let mean = &mut self.mean_ned;
        mean.north += share * (direction.north - mean.north);
        mean.east += share * (direction.east - mean.east);
        mean.down += share * (direction.down - mean.down);
        self.mean_s += since_s;
        // What the array hears from below its plane may come from above it. While the vehicle leans, that may be a level source.
        let other_down = direction.down - 2.0 * under * axes.down.down;
        let is_steep = if direction.down > STEEP && other_down < -ABOVE { 1.0 } else { 0.0 };
        self.steep += since_s / (AGREEMENT_MEMORY_S + since_s) * (is_steep - self.steep);
        let has_swung = self.mean_s > MEAN_SETTLED_S && self.swings(here);

        if !self.begun {
            let mean = self.mean_ned;
            let norm = sqrt(mean.horizontal().norm_squared() + mean.down * mean.down);
            let (below_m, below_sigma_m) = below(height_m);
            if self.steep > STEEP_SHARE && mean.down > STEEP * norm && norm > 0.5 && self.mean_s > MEAN_SETTLED_S {
                let towards = mean.horizontal().times(1.0 / mean.down);
                let place = here.plus(towards.times(below_m));
                let spread_m = 0.5 * below_m + below_sigma_m * towards.norm();
                self.begin(place, spread_m * spread_m, pose, height_m);
            } else if has_swung {
                self.begin(here, 1.0, pose, height_m);
            }
            return;
        }
        self.fuse(&sight, pose, &axes, height_m, since_s);
    }

    /// The bank's filter knows the source's position: the fix begins there, unless there is one.
    pub fn suggest(&mut self, estimate: &Estimate, pose: &FullPose, height_m: Option<f32>) {
        let here = pose.place_ned_m.horizontal();
        let [nn, _, ee] = estimate.covariance_m2;
        let near = estimate.place_ned_m.minus(here).norm_squared() < NEAR_M * NEAR_M;
        if self.begun || !near || !(nn + ee < 1.0 && nn > 0.0 && ee > 0.0) {
            return;
        }
        self.begin(estimate.place_ned_m, nn + ee + 0.1, pose, height_m);
    }

    fn begin(&mut self, place: Horizontal, variance_m2: f32, pose: &FullPose, height_m: Option<f32>) {
        let (below_m, below_sigma_m) = below(height_m);
        let towards = place.minus(pose.place_ned_m.horizontal());
        let distance_m = towards.norm();
        self.begun = true;
        self.place_ned_m = Ned { north: place.north, east: place.east, down: pose.place_ned_m.down + below_m };
        self.covariance_m2 = [variance_m2, 0.0, variance_m2, 0.0, 0.0, below_sigma_m * below_sigma_m];
        (self.agreement, self.heard_s, self.has_sides) = (0.5, 0.0, false);
        self.first_ned = if distance_m > RANGE_MIN_M { towards.times(1.0 / distance_m) } else { Horizontal::default() };
    }

    /// The mean and the extremes of the signal's strength.
    fn weigh_strength(&mut self, snr_db: f32, since_s: f32, was_heard: bool) {
        if !(libm::fabsf(snr_db) < 200.0) {
            return;
        }
        if !was_heard {
            (self.strength_db, self.least_db, self.most_db) = (snr_db, snr_db, snr_db);
        }
        self.strength_db += since_s / (STRENGTH_MEMORY_S + since_s) * (snr_db - self.strength_db);
        if self.strength_db > self.most_db {
            self.most_db = self.strength_db;
        }
        if self.strength_db < self.least_db {
            self.least_db = self.strength_db;
        }
    }

    /// Whether the mean direction has swung round, by more than a right angle and within a short distance.
    fn swings(&mut self, here: Horizontal) -> bool {
        let mean = self.mean_ned.horizontal();
        let is_fresh = self.swung_ned == Horizontal::default();
        let has_left = here.minus(self.swung_at_ned_m).norm_squared() > SWING_M * SWING_M;
        let has_swung = !is_fresh && mean.dot(self.swung_ned) < 0.0 && mean.norm_squared() > 0.1;
        if is_fresh || has_left || has_swung {
            (self.swung_at_ned_m, self.swung_ned) = (here, mean);
        }
        has_swung && !has_left
    }

    /// One step of the filter.
    fn fuse(&mut self, sight: &Sight, pose: &FullPose, axes: &Axes, height_m: Option<f32>, since_s: f32) {
        let place = pose.place_ned_m;
        let moved_m = place.horizontal().minus(self.from_ned_m).norm();
        self.from_ned_m = place.horizontal();
        let [nn, ne, ee, nd, ed, dd] = self.covariance_m2;
        let walk_m2 = WALK_M2_PER_S * since_s;
        self.covariance_m2 = [nn + walk_m2, ne, ee + walk_m2, nd, ed, dd];
        if let Some(height_m) = height_m {
            self.place_ned_m.down = place.down + height_m;
        }

        let towards = [
            self.place_ned_m.north - place.north,
            self.place_ned_m.east - place.east,
            self.place_ned_m.down - place.down,
        ];
        let [nn, _, ee, ..] = self.covariance_m2;
        let floor = FLOOR_RAD * FLOOR_RAD;
        let once = sight.variance + floor;
        // Noise is independent after a moment, a bias only elsewhere.
        let noise_share = since_s / NOISE_ALIKE_S;
        let bias_share = since_s / BIAS_ALIKE_S + moved_m / BIAS_ALIKE_M;
        let least = |share: f32| if share < 1.0 { share } else { 1.0 };
        let variances = [once, sight.variance / least(noise_share) + floor / least(bias_share)];
        let (mut squares, mut is_behind) = (0.0, false);
        if sight.is_level {
            // Across the azimuth: the sine of the angle, and 1 if it points the other way.
            let range_m = Horizontal { north: towards[0], east: towards[1] }.norm();
            let seen_m = sqrt(range_m * range_m + 0.5 * (nn + ee) + RANGE_MIN_M * RANGE_MIN_M);
            let inverse = 1.0 / if range_m > 0.05 { range_m } else { 0.05 };
            let expected = Horizontal { north: towards[0] * inverse, east: towards[1] * inverse };
            let (sin_yaw, cos_yaw) = sin_cos(pose.yaw_rad);
            let [forward, right] = sight.u;
            let heard =
                Horizontal { north: forward * cos_yaw - right * sin_yaw, east: forward * sin_yaw + right * cos_yaw };
            let sine = expected.north * heard.east - expected.east * heard.north;
            let is_ahead = expected.dot(heard) > 0.0;
            // Beyond a right angle it goes on growing.
            let off = if is_ahead { sine } else { libm::copysignf(2.0, sine) - sine };
            let row = [-expected.east / seen_m, expected.north / seen_m, 0.0];
            squares += weigh(self, row, off, variances);
            // A fix behind the vehicle, with this distance in between, cannot be explained by sigma.
            is_behind = !is_ahead && range_m * range_m > 0.5 * (nn + ee);
        } else {
            let [n, e, d] = towards;
            let range_m = sqrt(n * n + e * e + d * d);
            let inverse = 1.0 / if range_m > RANGE_MIN_M { range_m } else { RANGE_MIN_M };
            let unit = [n * inverse, e * inverse, d * inverse];
            for (axis, measured) in [axes.forward, axes.right].into_iter().zip(sight.u) {
                let along = axis.north * unit[0] + axis.east * unit[1] + axis.down * unit[2];
                let row = [
                    (axis.north - along * unit[0]) * inverse,
                    (axis.east - along * unit[1]) * inverse,
                    (axis.down - along * unit[2]) * inverse,
                ];
                squares += weigh(self, row, measured - along, variances);
            }
        }
        let agrees = if squares < AGREES && !is_behind { 1.0 } else { 0.0 };
        self.agreement += since_s / (AGREEMENT_MEMORY_S + since_s) * (agrees - self.agreement);
        self.heard_s += since_s;

        let away = self.place_ned_m.horizontal().minus(place.horizontal());
        let distance_m = away.norm();
        if distance_m > SIDE_M && distance_m * distance_m > 2.0 * (nn + ee) {
            let direction = away.times(1.0 / distance_m);
            if self.first_ned == Horizontal::default() {
                self.first_ned = direction;
            }
            self.has_sides |= direction.dot(self.first_ned) < SIDES;
        }
        self.has_depth = !sight.is_level;
        let is_lost = self.heard_s > 1.5 && self.agreement < AGREEMENT_LOST;
        if is_lost || !(distance_m < FAR_M) || !self.covariance_m2.iter().all(|value| value.is_finite()) {
            self.begun = false;
        }
    }

    /// The fix as seen from a position; `None` if there is none.
    #[must_use]
    pub fn fix(&self, now: Instant, place_ned_m: Ned) -> Option<Fix> {
        if !self.begun {
            return None;
        }
        let [nn, ne, ee, ..] = self.covariance_m2;
        let (middle, half) = (0.5 * (nn + ee), 0.5 * (nn - ee));
        let distance_m = self.place_ned_m.horizontal().minus(place_ned_m.horizontal()).norm();
        let depth_m = between(self.place_ned_m.down - place_ned_m.down, DEPTH_MIN_M, 1e3);
        let slant2 = distance_m * distance_m + depth_m * depth_m;
        // A bias of the angle, along the ground: larger at flatter angles.
        let flat = if self.has_depth { slant2 / depth_m } else { sqrt(slant2) };
        let biased = FLOOR_RAD * FLOOR_RAD * flat * flat;
        let mean = self.mean_ned;
        let length2 = mean.horizontal().norm_squared() + mean.down * mean.down;
        let is_overhead =
            self.steep > STEEP_SHARE && mean.down > 0.0 && mean.down * mean.down > OVERHEAD * OVERHEAD * length2;
        Some(Fix {
            place_ned_m: self.place_ned_m,
            sigma_m: sqrt(middle + sqrt(half * half + ne * ne) + biased),
            distance_m,
            depth_m,
            agreement: self.agreement,
            heard_s: self.heard_s,
            is_surrounded: is_overhead || self.has_sides,
            is_flat: self.has_depth && self.steep < STEEP_SHARE,
            is_loudest: self.most_db - self.least_db > RISE_DB && self.strength_db > self.most_db - MAXIMUM_DB,
            is_heard: self.heard.is_some_and(|heard| now.seconds_since(heard) < HEARD_S),
        })
    }
}

/// Takes one component of a bearing; returns its squared innovation over its variance. Outliers get less weight.
fn weigh(state: &mut State, row: [f32; 3], off: f32, [once, variance]: [f32; 2]) -> f32 {
    let squares = off * off / (once + spread(state, row));
    let doubt = if squares > TRUSTED { squares / TRUSTED } else { 1.0 };
    update(state, row, off, variance * doubt * doubt);
    squares
}

/// Variance of a row of the state.
fn spread(state: &State, row: [f32; 3]) -> f32 {
    let [a, b, c] = times(&state.covariance_m2, row);
    row[0] * a + row[1] * b + row[2] * c
}

fn times([nn, ne, ee, nd, ed, dd]: &[f32; 6], [n, e, d]: [f32; 3]) -> [f32; 3] {
    [nn * n + ne * e + nd * d, ne * n + ee * e + ed * d, nd * n + ed * e + dd * d]
}

/// A scalar update. The depth's uncertainty is considered, but the depth is not corrected.
fn update(state: &mut State, row: [f32; 3], off: f32, variance: f32) {
    let gain = times(&state.covariance_m2, row);
    let total = variance + row[0] * gain[0] + row[1] * gain[1] + row[2] * gain[2];
    if !(total > 0.0 && off.is_finite()) {
        return;
    }
    let step = between(off / total, -1e6, 1e6);
    state.place_ned_m.north += gain[0] * step;
    state.place_ned_m.east += gain[1] * step;
    let scale = 1.0 / sqrt(total);
    let [n, e, d] = gain.map(|gain| gain * scale);
    let [nn, ne, ee, nd, ed, dd] = state.covariance_m2;
    // Rounding must not make a variance negative.
    let least = |variance: f32| if variance > 1e-6 { variance } else { 1e-6 };
    state.covariance_m2 = [least(nn - n * n), ne - n * e, least(ee - e * e), nd - n * d, ed - e * d, dd];
}
