//! The pad's position, and the flight to above it.
//!
//! A camera frame gives tangents in the body frame. Rotated by the attitude at its exposure, and multiplied by the
//! height over the pad, they give the pad's position in NED. A small Kalman filter keeps that position, so that the
//! vehicle is steered by its own position, at every step, and a late or missing frame does no harm. The height over
//! the pad comes from its apparent radius and from the range finder, fused with the vehicle's own vertical position.
//! A detection far from the position is ignored; if there are no others for a while, and those agree with each other,
//! the pad is taken to be there.
//!
//! The flight is controlled by a PID on the position: `v = s (kp e + integral) - kd v_measured`. The derivative is of
//! the vehicle's own velocity, so that a jump of the pad's position causes no kick. With a vehicle that responds as
//! ArduCopter (0.22 s, then a critically damped second order of 3.1 rad/s) no disturbance is amplified by more than
//! 2.1, with a faster one by less (a test computes it). High up, where detections are coarse, the gain is lower and
//! the speed higher.
//!
//! Cost: in the bench's `landing_step`.

use super::observation::Pad;
use crate::base::error::{ConfigError, check};
use crate::base::history::FullPose;
use crate::base::math::sqrt;
use crate::base::ned::{Horizontal, Ned};
use crate::base::time::Instant;
use crate::base::units::between;

/// Error of a tangent, and of a position that is exactly known.
const TANGENT_SIGMA: f32 = 0.02;
const PLACE_SIGMA_M: f32 = 0.01;
/// A pad cut by the picture's border has its centre less well known by this factor.
const CUT: f32 = 4.0;
/// Relative error of the apparent radius, and of the range finder; the least of each.
const RADIUS_SIGMA: f32 = 0.08;
const FINDER_SIGMA: f32 = 0.02;
const HEIGHT_SIGMA_M: f32 = 0.03;
/// Random walks of the position and of the height: how fast the vehicle's own position drifts.
const WALK_M2_PER_S: f32 = 0.001;
const DOWN_WALK_M2_PER_S: f32 = 0.0005;
/// A detection this many standard deviations off, plus this distance, is not of this pad.
const GATE: f32 = 3.0;
const GATE_M: f32 = 0.10;
const DOWN_GATE_M: f32 = 0.05;
/// This many detections in a row that agree with each other make another pad, if this one has not been seen for this
/// long.
const STRAY_LOOKS: u8 = 4;
const STRAY_S: f32 = 0.6;
const STRAY_M: f32 = 0.3;
const STRAY_HEIGHT_M: f32 = 0.6;
/// This many detections make a pad certain.
const LOOKS_SURE: u8 = 4;
/// A pad that is not certain is forgotten after this long.
const TENTATIVE_S: f32 = 1.0;
/// Nothing is nearer to the camera than this, and no ray is flatter.
const HEIGHT_MIN_M: f32 = 0.05;
const STEEP_MIN: f32 = 0.4;
const TANGENT_MAX: f32 = 3.0;
/// Least confidence of a detection that is used.
const CONFIDENCE_MIN: f32 = 0.1;
/// The error and the speed within which the integral changes.
const INTEGRAL_M: f32 = 0.25;
const INTEGRAL_MPS: f32 = 0.15;
/// Heights below and above which gains and speeds do not change any more.
const LOW_M: f32 = 1.0;
const HIGH_M: f32 = 3.0;
/// Horizontal speed at the ground, and its increase per metre of height.
const LOW_MPS: f32 = 0.5;
const LOW_MPS_PER_M: f32 = 0.2;
/// Gain high up.
const HIGH_GAIN: f32 = 0.7;
/// Velocity per metre and second of error, and bound of that part.
pub(super) const KI_PER_S2: f32 = 0.2;
const INTEGRAL_MAX_MPS: f32 = 0.2;
/// Largest horizontal speed.
pub(super) const SPEED_MAX_MPS: f32 = 0.8;
/// Largest change of the horizontal demand, and of the vertical one.
pub(super) const ACCEL_MAX_MPS2: f32 = 2.0;
pub(super) const DOWN_ACCEL_MAX_MPS2: f32 = 2.0;
/// Fastest descent, and the slowest, near the ground.
pub(super) const DESCENT_MAX_MPS: f32 = 0.5;
pub(super) const DESCENT_MIN_MPS: f32 = 0.25;
/// Fastest climb.
pub(super) const CLIMB_MPS: f32 = 0.3;
/// Radius of the descent cone at the ground.
const CONE_M: f32 = 0.10;
/// Below this height at least the vehicle descends without seeing the pad, once it is inside [`Config::commit_gate_m`].
pub(super) const COMMIT_M: f32 = 0.4;
/// And at most, so that the slowest descent takes no longer than [`COMMIT_S`]: what the largest pad needs before the widest camera.
pub(super) const COMMIT_MAX_M: f32 = 1.777_8;
/// Commanded rate of descent in the drop at the end: the vehicle touches down before it reaches it.
pub(super) const COMMIT_MPS: f32 = 0.5;
/// How long the last part may wait before the drop, and how long the drop may take.
pub(super) const COMMIT_S: f32 = 10.0;
/// Detections no older than this allow the descent.
pub(super) const FRESH_S: f32 = 0.5;
/// The pad is lost after this long, and the vehicle climbs.
pub(super) const LOST_S: f32 = 2.0;
/// How far it climbs; how much of it a vehicle coasts; and the longest climb, after which it searches.
pub(super) const CLIMB_M: f32 = 1.0;
pub(super) const COAST_M: f32 = 0.18;
pub(super) const CLIMB_S: f32 = 5.0;

/// Configuration of the centring.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Velocity per metre of error.
    pub kp_per_s: f32,
    /// Share of the measured velocity that is subtracted.
    pub kd: f32,
    /// Increase of the descent cone's radius per metre of height.
    pub gate_per_m: f32,
    /// Horizontal error at the commit.
    pub commit_gate_m: f32,
    /// Horizontal speed at the commit.
    pub commit_speed_mps: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { kp_per_s: 1.6, kd: 0.95, gate_per_m: 0.15, commit_gate_m: 0.08, commit_speed_mps: 0.15 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Pilot, ConfigError> {
        check("landing.centring.kp_per_s", self.kp_per_s, 0.1, 3.0)?;
        check("landing.centring.kd", self.kd, 0.0, 2.0)?;
        check("landing.centring.gate_per_m", self.gate_per_m, 0.0, 1.0)?;
        check("landing.centring.commit_gate_m", self.commit_gate_m, 0.01, 2.0)?;
        check("landing.centring.commit_speed_mps", self.commit_speed_mps, 0.01, 2.0)?;
        Ok(Pilot { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pilot {
    pub(super) config: Config,
}

/// The result of a detection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It was used.
    Yes,
    /// It is far off, or not finite.
    Refused,
    /// The vehicle's height is unknown.
    NoHeight,
}

/// A detection as a position.
struct Spot {
    time: Instant,
    place_ned_m: Horizontal,
    variance_m2: f32,
    /// Vertical position of the vehicle.
    own_down_m: f32,
    /// Vertical position of the pad and its variance, by the apparent radius.
    down: Option<(f32, f32)>,
}

/// The pad's estimated position.
#[derive(Clone, Copy, Debug, Default)]
pub struct Track {
    place_ned_m: Horizontal,
    variance_m2: f32,
    /// Its vertical position.
    down_m: f32,
    down_variance_m2: f32,
    /// Detections that agreed, up to [`LOOKS_SURE`]; 0 without a pad.
    looks: u8,
    strays: u8,
    stray_ned_m: Horizontal,
    stray_down_m: f32,
    seen: Instant,
}

impl Track {
    /// The position has jumped.
    pub fn shift(&mut self, by: Horizontal) {
        self.place_ned_m = self.place_ned_m.plus(by);
        self.stray_ned_m = self.stray_ned_m.plus(by);
    }

    /// Whether the pad is certain.
    #[must_use]
    pub fn is_sure(&self) -> bool {
        self.looks >= LOOKS_SURE
    }

    /// Its position.
    #[must_use]
    pub fn place_ned_m(&self) -> Ned {
        Ned { north: self.place_ned_m.north, east: self.place_ned_m.east, down: self.down_m }
    }

    /// Standard deviation of its horizontal position.
    #[must_use]
    pub fn sigma_m(&self) -> f32 {
        sqrt(self.variance_m2)
    }

    /// Time since it was seen.
    #[must_use]
    pub fn unseen_s(&self, now: Instant) -> f32 {
        now.seconds_since(self.seen)
    }

    /// Height over it at a vertical position.
    #[must_use]
    pub fn height_m(&self, down_m: f32) -> f32 {
        self.down_m - down_m
    }

    /// Uses the range finder's vertical position of the ground.
    pub fn level(&mut self, ground_down_m: f32, height_m: f32, tick_s: f32) {
        if self.looks == 0 {
            return;
        }
        let sigma_m = HEIGHT_SIGMA_M + FINDER_SIGMA * height_m;
        self.down_variance_m2 += DOWN_WALK_M2_PER_S * tick_s;
        // Errors within a third of a second are correlated.
        let alike = if tick_s < 0.3 { 0.3 / tick_s } else { 1.0 };
        self.correct_down(ground_down_m, sigma_m * sigma_m * alike);
    }

    /// Starts a pad at this detection.
    fn begin(&mut self, seen: &Spot, looks: u8) -> Taken {
        (self.place_ned_m, self.variance_m2) = (seen.place_ned_m, 2.0 * seen.variance_m2);
        if let Some((down_m, variance_m2)) = seen.down {
            (self.down_m, self.down_variance_m2) = (down_m, variance_m2);
        }
        (self.looks, self.strays, self.seen) = (looks, 0, seen.time);
        Taken::Yes
    }

    /// Uses one more detection, unless it is of another pad.
    fn correct(&mut self, seen: &Spot, since_s: f32) -> Taken {
        self.variance_m2 += WALK_M2_PER_S * between(since_s, 0.0, 1.0);
        self.down_variance_m2 += DOWN_WALK_M2_PER_S * between(since_s, 0.0, 1.0);
        let off = seen.place_ned_m.minus(self.place_ned_m);
        let total = self.variance_m2 + seen.variance_m2;
        let gate_m = GATE_M + GATE * sqrt(total);
        let is_level = seen.down.is_none_or(|(down_m, variance_m2)| {
            let gate_m = DOWN_GATE_M + GATE * sqrt(self.down_variance_m2 + variance_m2);
            libm::fabsf(down_m - self.down_m) < gate_m
        });
        if off.norm_squared() > gate_m * gate_m || !is_level {
            if self.looks < LOOKS_SURE {
                self.looks -= 1;
                return if self.looks == 0 { self.begin(seen, 1) } else { Taken::Refused };
            }
            // Near the ground everything is near everything else: a detection there does not make another pad.
            let Some((down_m, _)) = seen.down.filter(|_| self.down_m - seen.own_down_m > STRAY_HEIGHT_M) else {
                return Taken::Refused;
            };
            let agrees = self.strays > 0
                && seen.place_ned_m.minus(self.stray_ned_m).norm_squared() < STRAY_M * STRAY_M
                && libm::fabsf(down_m - self.stray_down_m) < STRAY_M;
            self.strays = if agrees { self.strays + 1 } else { 1 };
            (self.stray_ned_m, self.stray_down_m) = (seen.place_ned_m, down_m);
            let is_other = self.strays >= STRAY_LOOKS && since_s > STRAY_S;
            return if is_other { self.begin(seen, LOOKS_SURE) } else { Taken::Refused };
        }
        let gain = self.variance_m2 / total;
        self.place_ned_m = self.place_ned_m.plus(off.times(gain));
        self.variance_m2 *= 1.0 - gain;
        self.looks = (self.looks + 1).min(LOOKS_SURE);
        (self.strays, self.seen) = (0, seen.time);
        if let Some((down_m, variance_m2)) = seen.down {
            self.correct_down(down_m, variance_m2);
        }
        Taken::Yes
    }

    fn correct_down(&mut self, down_m: f32, variance_m2: f32) {
        let (off_m, total) = (down_m - self.down_m, self.down_variance_m2 + variance_m2);
        let gain = self.down_variance_m2 / total;
        if gain.is_finite() && off_m.is_finite() {
            self.down_m += gain * off_m;
            self.down_variance_m2 *= 1.0 - gain;
        }
    }
}

impl Pilot {
    /// Takes a pad that was seen from a pose. `ground_down_m` is the range finder's vertical position of the ground.
    pub fn see(
        &self,
        track: &mut Track,
        pad: &Pad,
        time: Instant,
        pose: &FullPose,
        pad_radius_m: f32,
        ground_down_m: Option<f32>,
    ) -> Taken {
        let is_ray = libm::fabsf(pad.forward) < TANGENT_MAX && libm::fabsf(pad.right) < TANGENT_MAX;
        if !is_ray || !(pad.confidence >= CONFIDENCE_MIN) {
            return Taken::Refused;
        }
        let ray = pose.axes().to_ned([pad.forward, pad.right, 1.0]);
        if !(ray.down > STEEP_MIN) {
            return Taken::Refused;
        }
        let own_down_m = pose.place_ned_m.down;
        let by_radius_m =
            (!pad.is_cut && pad.radius > 1e-3 && pad.radius < 10.0).then(|| pad_radius_m / pad.radius * ray.down);
        // Its error follows from the expected height: a distant detection must not excuse itself by its own.
        let expected_m = (track.looks > 0).then_some(track.down_m - own_down_m);
        let height = |height_m: f32| {
            let sigma_m = HEIGHT_SIGMA_M + RADIUS_SIGMA * libm::fabsf(expected_m.unwrap_or(height_m));
            (own_down_m + height_m, sigma_m * sigma_m)
        };
        let by_radius = by_radius_m.map(height);
        let by_finder = ground_down_m.map(|down_m| height(down_m - own_down_m));
        let since_s = track.unseen_s(time);
        if track.looks < LOOKS_SURE && since_s > TENTATIVE_S {
            track.looks = 0;
        }
        // The height used for the position: that of the known pad, or else that of this detection.
        let known = (track.looks > 0).then_some((track.down_m, track.down_variance_m2));
        let Some((down_m, down_variance_m2)) = known.or(by_finder).or(by_radius) else { return Taken::NoHeight };
        let height_m = down_m - own_down_m;
        let height_m = if height_m > HEIGHT_MIN_M { height_m } else { HEIGHT_MIN_M };
        let away = ray.horizontal().times(height_m / ray.down);
        let confidence = if pad.confidence < 1.0 { pad.confidence } else { 1.0 };
        let sigma_m = TANGENT_SIGMA * height_m * if pad.is_cut { CUT } else { 1.0 };
        let seen = Spot {
            time,
            place_ned_m: pose.place_ned_m.horizontal().plus(away),
            variance_m2: (sigma_m * sigma_m + PLACE_SIGMA_M * PLACE_SIGMA_M) / confidence,
            own_down_m,
            down: by_radius,
        };
        if !seen.place_ned_m.is_finite() {
            return Taken::Refused;
        }
        if track.looks == 0 {
            (track.down_m, track.down_variance_m2) = (down_m, down_variance_m2);
            return track.begin(&seen, 1);
        }
        track.correct(&seen, since_s)
    }

    /// Velocity towards a position that is `error` away, of at most `speed_max_mps`.
    pub fn steer(
        &self,
        integral_mps: &mut Horizontal,
        error_m: Horizontal,
        velocity_ned_mps: Horizontal,
        height_m: f32,
        speed_max_mps: f32,
        tick_s: f32,
    ) -> Horizontal {
        let c = &self.config;
        let high = between((height_m - LOW_M) / (HIGH_M - LOW_M), 0.0, 1.0);
        let gain = 1.0 - (1.0 - HIGH_GAIN) * high;
        let speed_max_mps = if speed_max_mps < SPEED_MAX_MPS { speed_max_mps } else { SPEED_MAX_MPS };
        // The derivative's share at full speed is added here.
        let towards = error_m.times(gain * c.kp_per_s).clamped(speed_max_mps * (1.0 + c.kd));
        let wanted = towards.plus(*integral_mps).minus(velocity_ned_mps.times(c.kd));
        let limited = wanted.clamped(speed_max_mps);
        let is_free = wanted.norm_squared() <= speed_max_mps * speed_max_mps;
        let is_slow = velocity_ned_mps.norm_squared() < INTEGRAL_MPS * INTEGRAL_MPS;
        if is_free && is_slow && error_m.norm_squared() < INTEGRAL_M * INTEGRAL_M {
            *integral_mps = integral_mps.plus(error_m.times(KI_PER_S2 * tick_s)).clamped(INTEGRAL_MAX_MPS);
        }
        limited
    }

    /// Radius of the cone at a height.
    #[must_use]
    pub fn gate_m(&self, height_m: f32) -> f32 {
        CONE_M + self.config.gate_per_m * between(height_m, 0.0, 4.0)
    }

    /// Rate of descent at a height and a horizontal error.
    #[must_use]
    pub fn descent_mps(&self, height_m: f32, error_m: f32) -> f32 {
        let by_height = between(0.15 + 0.2 * height_m, DESCENT_MIN_MPS, DESCENT_MAX_MPS);
        // The full rate in the inner half.
        by_height * between(2.0 * (1.0 - error_m / self.gate_m(height_m)), 0.0, 1.0)
    }
}

/// Horizontal speed at a height.
#[must_use]
pub fn speed_mps(height_m: f32) -> f32 {
    between(LOW_MPS + LOW_MPS_PER_M * height_m, 0.0, SPEED_MAX_MPS)
}
