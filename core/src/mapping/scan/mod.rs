//! Obstacle scans and points, and the circles fitted to them.
//!
//! A scan consists of sectors of distance around the nose, as in `OBSTACLE_DISTANCE`; [`Points`] are single hits in any
//! order. A narrow sector is one ray. A wide one reports the nearest of several rays, so its hit lies on the side on
//! which the surface comes nearer, not in the middle: to assume the middle would make pillars wider by half a sector at
//! either side. Neighbouring hits without a jump in distance form a run. Each run becomes
//!
//! - a pillar, if a circle passes within `RESIDUAL_MAX_M` of all its hits, is curved towards the sensor, has
//!   a radius that the arc determines, and does not reach into directions that are seen to be free (Taubin's fit; a run
//!   that is too short for it but free on both sides gets its radius from its angular width);
//! - two pieces, cut at the hit farthest from the circle, if the circle does not pass near all hits;
//! - a chain of small circles, if it is flat, hollow or short: walls, corners, partly hidden obstacles.
//!
//! In every case each hit lies in a circle or within 2 cm of it. A direction without a hit yields no circle. In this
//! processing step the main paper fits circles to the points of a cloud (section IV) and does not describe how.
//!
//! The cost is bounded: circles are fitted to 160 points of a scan at most; the rest becomes chains.

use heapless::Vec;

use crate::base::math::inverse_root;
use crate::base::ned::Horizontal;
use crate::base::pose::{ANGLE_MAX_RAD, Pose};
use crate::base::time::Instant;
use crate::base::units::{between, nearest, sin_cos, wrap_pi};

mod chain;
mod circle;
mod lost;
mod rays;
mod segment;

use circle::root;

pub use lost::LostRays;
pub use rays::{Ranges, Rays, Sectors};
pub use segment::{fit, fit_into, fit_points_into};

/// Largest number of rays in a scan.
pub const RAYS_MAX: usize = 360;
/// Largest number of sectors that circles are fitted to; in a scan of more rays, several rays form a sector.
pub const SECTORS_MAX: usize = 72;
/// Largest number of points in one delivery.
pub const POINTS_MAX: usize = 72;
/// Largest number of circles from one scan or delivery of points: one per hit.
pub const DETECTIONS_MAX: usize = POINTS_MAX;

/// Smallest number of hits that a circle is fitted to.
const FIT_MIN: usize = 5;
/// Largest total number of points of one scan that circles are fitted to, where the points of a cut piece count again;
/// the rest becomes chains.
const FITS_MAX: usize = 160;
/// Two neighbours whose distances differ by more than this are two obstacles, however wide the sectors are.
const JUMP_MAX_M: f32 = 0.30;
/// Largest distance by which a pillar may reach into a direction that is seen to be free.
const REACH_M: f32 = 0.03;
/// Largest angle between rays, slightly more than 1.25 degrees: a wider sector reports the nearest of several rays.
const RAY_STEP_MAX_RAD: f32 = 0.0219;
/// Neighbouring hits farther apart than this, plus what the sector width explains, are two obstacles.
const GAP_M: f32 = 0.10;
/// A circle farther than this from one of its points is refused.
const RESIDUAL_MAX_M: f32 = 0.018;
/// Smallest accepted radius.
const RADIUS_MIN_M: f32 = 0.05;
/// Largest accepted radius; a wall becomes several circles.
const RADIUS_MAX_M: f32 = 0.65;
/// Largest sigma of a pillar's radius, as a share of the radius.
const RADIUS_DOUBT_MAX: f32 = 0.15;
/// Largest plausible range of a sensor, and distance of a hit.
const RANGE_MAX_M: f32 = 1e3;
/// Longest plausible time of a turn.
const TURN_MAX_S: f32 = 10.0;
/// Largest range of a ray: it is stored in millimetres, in two bytes.
pub const RAY_MAX_M: f32 = 65.5;

/// The measurement of one sector of a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Sector {
    /// Unknown: not covered, or reported as unknown by the sensor.
    #[default]
    Unknown,
    /// Scanned and empty up to the sensor's range.
    Clear,
    /// The nearest obstacle, metres from the vehicle's centre.
    Hit(f32),
}

/// Positions and velocities of a steady autopilot are no farther apart.
const STEADY_M: f32 = 0.02;

/// One sweep of an obstacle sensor, in the body frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// Estimated time of measurement, of the middle of its turn.
    pub time: Instant,
    /// Time from a ray to the next, times their number; negative if the last ray came first, 0 if all were measured at once, or
    /// that is not known.
    pub turn_s: f32,
    /// Azimuth of ray 0, or of the middle of sector 0, from the nose, clockwise positive.
    pub first_azimuth_rad: f32,
    /// Azimuth step from a ray to the next; may be negative, never 0.
    pub step_rad: f32,
    /// Range of the sensor.
    pub range_max_m: f32,
    /// Its measurements.
    pub rays: Rays,
}

/// What speaks against what a scan shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Doubts {
    /// Its sensor loses rays.
    pub loses_rays: bool,
    /// How far the vehicle's position is from where its velocities led within the last second.
    pub apart_m: f32,
}

impl Doubts {
    /// [`Self::apart_m`], or 0 where it is as little as an autopilot's noise and delays make it.
    #[must_use]
    pub fn wandered_m(&self) -> f32 {
        if self.apart_m > STEADY_M { self.apart_m } else { 0.0 }
    }
}

impl Scan {
    /// Whether its angles, its range and the time of a turn are plausible for a sensor.
    #[must_use]
    #[inline(never)]
    pub fn is_plausible(&self) -> bool {
        let width_rad = libm::fabsf(self.step_rad);
        libm::fabsf(self.first_azimuth_rad) <= ANGLE_MAX_RAD
            && libm::fabsf(self.turn_s) <= TURN_MAX_S
            && (1e-4..=core::f32::consts::TAU * 1.001).contains(&width_rad)
            && self.range_max_m > 0.0
            && self.range_max_m <= RANGE_MAX_M
    }

    /// How long after [`Self::time`] the ray at an index was measured.
    #[must_use]
    pub fn after_s(&self, index: f32) -> f32 {
        self.turn_s * ((index + 0.5) / self.rays.len().max(1) as f32 - 0.5)
    }

    /// The same scan, of a sensor that takes so long, if it tells less than half of that: it was measured before it was
    /// sent.
    #[must_use]
    pub fn lasting(mut self, turn_s: f32) -> Self {
        let (told_s, takes_s) = (libm::fabsf(self.turn_s), libm::fabsf(turn_s));
        if told_s < 0.5 * takes_s {
            self.turn_s = turn_s;
            self.time = Instant(self.time.0.saturating_sub((0.5e6 * (takes_s - told_s)) as u64));
        }
        self
    }

    /// The same scan with the azimuths of its rays from the nose as it was at its time, of a vehicle that yawed by so much
    /// during the turn. Its rays then cover more or less than a full turn, as they did. `None` where it yawed half as fast as the sensor turns.
    #[must_use]
    pub fn straightened(mut self, yawed_rad: f32) -> Option<Self> {
        let from_first_rad = if self.turn_s < 0.0 { -yawed_rad } else { yawed_rad };
        let share = from_first_rad / self.rays.len().max(1) as f32;
        let is_read = libm::fabsf(share) <= 0.5 * libm::fabsf(self.step_rad);
        self.first_azimuth_rad = wrap_pi(self.first_azimuth_rad - 0.5 * (from_first_rad - share));
        self.step_rad += share;
        is_read.then_some(self)
    }

    /// Whether no ray of it has a reading: the sensor is covered, or broken.
    #[must_use]
    pub fn is_blind(&self) -> bool {
        self.rays.iter().all(|sector| sector == Sector::Unknown)
    }

    /// Number of rays if they cover a full turn: then the last is a neighbour of the first.
    #[must_use]
    #[inline(never)]
    pub fn turn(&self) -> Option<usize> {
        let width_rad = libm::fabsf(self.step_rad);
        let turn = core::f32::consts::TAU / width_rad;
        let count = if turn < 2.0 * RAYS_MAX as f32 { nearest(turn) as f32 } else { f32::INFINITY };
        let closes = count <= self.rays.len() as f32
            && libm::fabsf(count * width_rad - core::f32::consts::TAU) < 0.5 * width_rad;
        closes.then_some(count as usize)
    }

    /// The same in at most `sectors_max` sectors.
    #[must_use]
    pub fn in_sectors(&self, sectors_max: usize) -> Sectors<'_> {
        Sectors::new(self, sectors_max)
    }

    /// Whether it has more rays than circles are fitted to.
    #[must_use]
    pub const fn is_fine(&self) -> bool {
        self.rays.len() > SECTORS_MAX
    }

    /// The ray at an index that may be off by a full turn; unknown if there is no such ray.
    #[must_use]
    pub fn sector(&self, index: i32) -> Sector {
        let index = match self.turn() {
            Some(turn) if turn > 0 => index.wrapping_rem_euclid(turn as i32),
            _ => index,
        };
        usize::try_from(index).map_or(Sector::Unknown, |index| self.rays.get(index))
    }
}

/// The axes of [`Points`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Frame {
    /// Forward and right of the vehicle (in the fields for north and east).
    #[default]
    Body,
    /// North and east of the vehicle.
    VehicleNed,
    /// North and east of the local origin.
    LocalNed,
}

/// Single hits in any order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// Estimated time of measurement.
    pub time: Instant,
    /// Their axes.
    pub frame: Frame,
    /// The hits' coordinates.
    pub points_m: Vec<Horizontal, POINTS_MAX>,
}

/// The kind of obstacle that a detection represents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// A round obstacle, with a centre and a radius.
    Pillar,
    /// A piece of a surface: only its front is meaningful.
    #[default]
    Patch,
}

/// One circle seen in one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Detection {
    /// The kind of obstacle.
    pub kind: Kind,
    /// Centre, local NED.
    pub center_ned_m: Horizontal,
    /// Radius.
    pub radius_m: f32,
    /// Standard deviation of centre and radius.
    pub sigma_m: f32,
    /// Middle of the surface that it represents, local NED.
    pub face_ned_m: Horizontal,
    /// First of its points in the scan.
    pub from: u8,
    /// One past the last of its points in the scan.
    pub to: u8,
}

/// Why a delivery of an obstacle sensor is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// The vehicle's position is unknown.
    NoOwnship,
    /// The vehicle's position or attitude is of another time, so the sensor's position is unknown.
    TimesApart,
    /// Its angles or its range are not plausible for a sensor.
    Geometry,
    /// It is not empty, but contains no finite and plausible value.
    Absurd,
    /// No ray of it has a reading.
    Blind,
}

/// Result of one scan or delivery of points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Segmentation {
    /// Estimated time of measurement.
    pub time: Instant,
    /// Position of the sensor, local NED.
    pub origin_ned_m: Horizontal,
    /// The hits, north and east of the sensor, in order.
    pub points_m: Vec<Horizontal, POINTS_MAX>,
    /// The circles fitted to them.
    pub detections: Vec<Detection, DETECTIONS_MAX>,
    /// How far the vehicle went in half the turn of the sensor: a range from the middle of the turn may be off by this.
    pub slip_m: f32,
    /// Number of hits refused because they were not finite or implausible.
    pub refused: u16,
    /// For hits of wide sectors: the largest angle of a hit from the middle of its sector; `sides` has the estimated
    /// angle of each hit, in 100ths of this.
    pub beside_rad: f32,
    /// See `beside_rad`. Empty where each hit is a ray's.
    pub sides: Vec<i8, POINTS_MAX>,
}

impl Segmentation {
    /// The points of a detection.
    #[must_use]
    pub fn points_of(&self, detection: &Detection) -> &[Horizontal] {
        self.points_m.get(usize::from(detection.from)..usize::from(detection.to)).unwrap_or_default()
    }

    /// Whether it contains anything plausible. A scan without a hit is plausible.
    fn check(&self) -> Result<(), Refusal> {
        if self.refused > 0 && self.points_m.is_empty() { Err(Refusal::Absurd) } else { Ok(()) }
    }

    /// Adds a circle, given relative to the sensor.
    fn push(&mut self, seen: Detection) {
        // Cannot fail: no more circles than hits.
        let _ = self.detections.push(Detection {
            center_ned_m: seen.center_ned_m.plus(self.origin_ned_m),
            face_ned_m: seen.face_ned_m.plus(self.origin_ned_m),
            ..seen
        });
    }
}

/// A run of hits, relative to the sensor, and whether its two sides are free.
struct Run<'a> {
    points: &'a [Horizontal],
    /// Index of its first point in the scan.
    first: usize,
    /// Azimuth step between its points; 0 if they have no fixed step.
    step_rad: f32,
    /// See [`Sectors::outermost_ray`].
    outermost_ray: f32,
    /// The direction next to either end, if it is seen to be free, as a unit vector.
    free: [Option<Horizontal>; 2],
}

impl Run<'_> {
    fn pillar(&self, center: Horizontal, radius_m: f32, sigma_m: f32) -> Verdict {
        Verdict::Pillar(Detection {
            kind: Kind::Pillar,
            center_ned_m: center,
            radius_m,
            sigma_m,
            face_ned_m: self.points[self.points.len() / 2],
            from: self.first as u8,
            to: (self.first + self.points.len()) as u8,
        })
    }
}

/// A rotation by a constant angle: 6 instructions where a sine and a cosine take 40.
struct Turned {
    sine: f32,
    cosine: f32,
}

impl Turned {
    fn new(angle_rad: f32) -> Self {
        let (sine, cosine) = sin_cos(angle_rad);
        Self { sine, cosine }
    }

    fn on(&self, v: Horizontal) -> Horizontal {
        Horizontal {
            north: self.cosine * v.north - self.sine * v.east,
            east: self.sine * v.north + self.cosine * v.east,
        }
    }

    fn back(&self, v: Horizontal) -> Horizontal {
        Horizontal {
            north: self.cosine * v.north + self.sine * v.east,
            east: self.cosine * v.east - self.sine * v.north,
        }
    }
}

/// The circle with the angular width of a few hits, if both its sides are free and it covers them:
/// `r / (nearest + r) = sin(half of the angle)`.
fn thin(piece: &Run<'_>) -> Verdict {
    let ([Some(_), Some(_)], Some(first), Some(last)) = (piece.free, piece.points.first(), piece.points.last()) else {
        return Verdict::Chain;
    };
    let least = |a: f32, p: &Horizontal| if p.norm_squared() < a { p.norm_squared() } else { a };
    let nearest_m = root(piece.points.iter().fold(f32::INFINITY, least));
    // Sine of a small angle, by its series: the relative term of the fourth power is left out.
    let sectors = piece.points.len() as f32 - 2.0 * piece.outermost_ray;
    let half_rad = (0.5 * piece.step_rad * sectors).clamp(0.0, 1.2);
    let s = half_rad * (1.0 - half_rad * half_rad / 6.0);
    let radius_m = between(nearest_m * s / (1.0 - s), RADIUS_MIN_M, RADIUS_MAX_M);
    let unit = |p: &Horizontal| p.times(inverse_root(p.norm_squared()));
    let toward = unit(first).plus(unit(last));
    let center = toward.times((nearest_m + radius_m) * inverse_root(toward.norm_squared()));
    let reach_m = radius_m + RESIDUAL_MAX_M;
    let covers = |point: &Horizontal| point.minus(center).norm_squared() <= reach_m * reach_m;
    if !piece.points.iter().all(covers) {
        return Verdict::Chain;
    }
    piece.pillar(center, radius_m, 0.02 + 0.5 * nearest_m * piece.step_rad)
}

/// Result for a piece of a run.
enum Verdict {
    Pillar(Detection),
    Cut(usize),
    Chain,
}

/// Whether a circle stays out of the directions that are free.
fn is_inside(center: Horizontal, radius_m: f32, free: [Option<Horizontal>; 2]) -> bool {
    free.iter().flatten().all(|direction| libm::fabsf(circle::cross(*direction, center)) > radius_m - REACH_M)
}

/// The direction of a position.
fn unit(v: Horizontal) -> Horizontal {
    let squared = v.norm_squared();
    if squared > 1e-12 { v.times(inverse_root(squared)) } else { Horizontal { north: 1.0, east: 0.0 } }
}

/// Increases with the azimuth, from -2 to 2 (0 at north, 1 at east), without an arctangent.
fn around(point: Horizontal) -> f32 {
    let along = point.north / (libm::fabsf(point.north) + libm::fabsf(point.east));
    if point.east >= 0.0 { 1.0 - along } else { along - 1.0 }
}

#[cfg(test)]
mod tests;
