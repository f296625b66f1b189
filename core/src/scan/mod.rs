//! Obstacle scans and points, and the circles behind them.
//!
//! A scan is sectors of distance around the nose, as `OBSTACLE_DISTANCE` brings them; [`Points`] are single hits in any
//! order. Neighbouring hits whose distance does not jump belong together. Each such run becomes
//!
//! - a pillar, where one circle passes within [`Config::residual_max_m`] of all its hits, is curved towards the sensor, has
//!   a radius that the arc determines, and does not reach into directions that are seen to be free (Taubin's fit; what
//!   is too short for it but free on both sides takes its radius from the angle it fills);
//! - two pieces, cut where the circle misses most, where one does not;
//! - a chain of small circles, where it is flat, hollow or short: walls, corners, what is half hidden.
//!
//! Whatever it becomes, every hit lies in a circle or within 2 cm of it. A direction without a hit yields nothing. The main
//! paper fits circles to the points of a cloud in the same place (section IV) and does not say how.
//!
//! The cost is bounded: circles are fitted to 160 points of a look at most, the rest becomes chains.

use crate::order::sort_by_key;
use heapless::Vec;

use crate::error::{ConfigError, check};
use crate::field::inverse_root;
use crate::frame::Horizontal;
use crate::time::Instant;
use crate::units::{between, sin_cos};

mod chain;
mod circle;

use chain::Edges;
use circle::root;

/// Most sectors one scan can hold.
pub const SECTORS_MAX: usize = 72;
/// Most points one delivery can hold.
pub const POINTS_MAX: usize = 72;
/// Most circles that one scan or delivery of points yields: one a hit.
pub const DETECTIONS_MAX: usize = POINTS_MAX;

/// Fewest hits that a circle is fitted to.
const FIT_MIN: usize = 5;
/// Circles are fitted to so many points of one look in all, those of a cut piece counted again; the rest becomes chains.
const FITS_MAX: usize = 160;
/// Two neighbours whose distances differ by more are two obstacles, however wide the sectors are.
const JUMP_MAX_M: f32 = 0.30;
/// How far a pillar may reach into a direction that is seen to be free.
const REACH_M: f32 = 0.03;
/// Nothing is measured from farther away.
const RANGE_MAX_M: f32 = 1e3;
/// Angles within a few turns of zero are meant; others are absurd.
const ANGLE_MAX_RAD: f32 = 100.0;

/// What one sector of a scan says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Sector {
    /// Nothing is known: not covered, or the sensor said so.
    #[default]
    Unknown,
    /// Looked at and empty as far as the sensor reaches.
    Clear,
    /// The nearest obstacle, metres from the vehicle's centre.
    Hit(f32),
}

/// One sweep of an obstacle sensor, in the body frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// When it was measured, as well as known.
    pub time: Instant,
    /// Azimuth of the centre of sector 0, from the nose, clockwise positive.
    pub first_azimuth_rad: f32,
    /// Azimuth step from a sector to the next; may be negative, never 0.
    pub step_rad: f32,
    /// Farthest distance that the sensor sees.
    pub range_max_m: f32,
    /// The sectors; those past the sensor's last are [`Sector::Unknown`].
    pub sectors: [Sector; SECTORS_MAX],
}

impl Scan {
    /// Whether its numbers mean a sensor.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        let width_rad = libm::fabsf(self.step_rad);
        libm::fabsf(self.first_azimuth_rad) <= ANGLE_MAX_RAD
            && (1e-4..=core::f32::consts::TAU * 1.001).contains(&width_rad)
            && self.range_max_m > 0.0
            && self.range_max_m <= RANGE_MAX_M
    }

    /// Sectors of a full turn, if these are one: then the last is a neighbour of the first.
    #[must_use]
    pub fn turn(&self) -> Option<usize> {
        let width_rad = libm::fabsf(self.step_rad);
        let count = libm::roundf(core::f32::consts::TAU / width_rad);
        let closes =
            count <= SECTORS_MAX as f32 && libm::fabsf(count * width_rad - core::f32::consts::TAU) < 0.5 * width_rad;
        closes.then_some(count as usize)
    }

    /// The sector at an index that may lie a turn off; unknown where there is none.
    #[must_use]
    pub fn sector(&self, index: i32) -> Sector {
        let index = match self.turn() {
            Some(turn) if turn > 0 => index.rem_euclid(turn as i32),
            _ => index,
        };
        usize::try_from(index).ok().and_then(|index| self.sectors.get(index)).copied().unwrap_or_default()
    }
}

/// What the axes of [`Points`] are.
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
    /// When they were measured, as well as known.
    pub time: Instant,
    /// What their axes are.
    pub frame: Frame,
    /// Where something is.
    pub points_m: Vec<Horizontal, POINTS_MAX>,
}

/// What the fit needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Neighbouring hits farther apart than this, plus what the sector width explains, are two obstacles.
    pub gap_m: f32,
    /// A circle that misses a point by more than this is no fit.
    pub residual_max_m: f32,
    /// Smallest radius that is believed.
    pub radius_min_m: f32,
    /// Largest radius that is believed; a wall becomes several circles.
    pub radius_max_m: f32,
    /// Largest share of its radius that a pillar's radius may be uncertain by, one sigma.
    pub radius_doubt_max: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { gap_m: 0.10, residual_max_m: 0.018, radius_min_m: 0.05, radius_max_m: 1.5, radius_doubt_max: 0.15 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Fitter, ConfigError> {
        check("scan.gap_m", self.gap_m, 0.01, 1.0)?;
        check("scan.residual_max_m", self.residual_max_m, 0.005, 0.5)?;
        check("scan.radius_min_m", self.radius_min_m, 0.01, 1.0)?;
        check("scan.radius_max_m", self.radius_max_m, self.radius_min_m, 10.0)?;
        check("scan.radius_doubt_max", self.radius_doubt_max, 0.01, 1.0)?;
        Ok(Fitter { config: *self })
    }
}

/// What a detection is a circle of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Kind {
    /// Something round: centre and radius mean what they say.
    Pillar,
    /// A piece of some surface: only its front means anything.
    #[default]
    Patch,
}

/// One circle seen in one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Detection {
    /// What it is a circle of.
    pub kind: Kind,
    /// Centre, local NED.
    pub center_ned_m: Horizontal,
    /// Radius.
    pub radius_m: f32,
    /// Standard deviation of centre and radius.
    pub sigma_m: f32,
    /// Middle of the surface that it stands for, local NED.
    pub face_ned_m: Horizontal,
    /// First of its points in the look.
    pub from: u8,
    /// One past the last of its points in the look.
    pub to: u8,
}

/// What one scan or delivery of points came to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Look {
    /// Where it was taken from, local NED.
    pub origin_ned_m: Horizontal,
    /// The hits, local NED, neighbours in order.
    pub points_ned_m: Vec<Horizontal, POINTS_MAX>,
    /// The circles behind them.
    pub detections: Vec<Detection, DETECTIONS_MAX>,
    /// Hits refused because they were not finite or absurd; all of them, and at least one, if the delivery was.
    pub refused: u16,
}

impl Look {
    /// Whether anything in it may be believed. A look that saw nothing may.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.refused == 0 || !self.points_ned_m.is_empty()
    }

    /// The points of one of its detections.
    #[must_use]
    pub fn points_of(&self, detection: &Detection) -> &[Horizontal] {
        self.points_ned_m.get(usize::from(detection.from)..usize::from(detection.to)).unwrap_or_default()
    }
}

/// Where and which way the sensor looked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position of the vehicle when it scanned.
    pub position_ned_m: Horizontal,
    /// Yaw of the vehicle when it scanned.
    pub yaw_rad: f32,
}

impl Pose {
    fn is_plausible(&self) -> bool {
        self.position_ned_m.is_finite()
            && self.position_ned_m.norm_squared() < 1e12
            && libm::fabsf(self.yaw_rad) <= ANGLE_MAX_RAD
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitter {
    config: Config,
}

/// A run of hits, relative to the sensor, and what is known on its two sides.
struct Run<'a> {
    points: &'a [Horizontal],
    /// Index of its first point in the look.
    first: usize,
    /// Azimuth step between its points; 0 where there is none.
    step_rad: f32,
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

/// A turn by one angle, again and again: 6 instructions where a sine and a cosine take 40.
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

impl Fitter {
    /// The circles behind the hits of a scan taken at `pose`.
    #[must_use]
    pub fn fit(&self, scan: &Scan, pose: &Pose) -> Look {
        let mut look = Look { origin_ned_m: pose.position_ned_m, ..Look::default() };
        if !scan.is_plausible() || !pose.is_plausible() {
            look.refused = 1 + scan.sectors.iter().filter(|sector| matches!(sector, Sector::Hit(_))).count() as u16;
            return look;
        }
        let step_rad = libm::fabsf(scan.step_rad);
        let continues = |before: f32, range_m: f32| {
            let nearer = if range_m < before { range_m } else { before };
            let explained = self.config.gap_m + 3.0 * nearer * step_rad;
            let allowed = if explained < JUMP_MAX_M { explained } else { JUMP_MAX_M };
            before > 0.0 && range_m > 0.0 && libm::fabsf(range_m - before) < allowed
        };
        // Zero where there is no hit.
        let mut ranges_m = [0.0_f32; SECTORS_MAX];
        for (range_m, sector) in ranges_m.iter_mut().zip(&scan.sectors) {
            match *sector {
                Sector::Hit(hit_m) if hit_m > 0.0 && hit_m <= scan.range_max_m => *range_m = hit_m,
                Sector::Hit(_) => look.refused += 1,
                _ => {}
            }
        }
        // A full turn is walked from a place where nothing continues, so that no run is cut at the seam.
        let turn = scan.turn();
        let count = turn.unwrap_or(SECTORS_MAX).min(SECTORS_MAX);
        let range_m = |index: usize| ranges_m.get(index).copied().unwrap_or_default();
        let before = |index: usize| if index == 0 { count - 1 } else { index - 1 };
        let seam = |index: &usize| !continues(range_m(before(*index)), range_m(*index));
        let begin = if turn.is_some() { (0..count).find(seam).unwrap_or(0) } else { 0 };

        let turned = Turned::new(scan.step_rad);
        let start = Horizontal::from_bearing(pose.yaw_rad + scan.first_azimuth_rad);
        let mut direction =
            Horizontal::from_bearing(pose.yaw_rad + scan.first_azimuth_rad + scan.step_rad * begin as f32);
        let mut fits_left = FITS_MAX;
        let (mut first, mut first_direction, mut first_index) = (0, direction, begin);
        let (mut index, mut runs) = (begin, false);
        for left in (0..count).rev() {
            let here_m = range_m(index);
            let next = if index + 1 == count { 0 } else { index + 1 };
            if here_m > 0.0 {
                if !runs {
                    (first, first_direction, first_index) = (look.points_ned_m.len(), direction, index);
                }
                // Cannot fail: as many places as sectors.
                let _ = look.points_ned_m.push(direction.times(here_m));
                runs = left > 0 && (turn.is_some() || next > 0) && continues(here_m, range_m(next));
                if !runs {
                    // A silhouette ends there unless something nearer hides it or nothing is known.
                    let is_free = |index: Option<usize>, edge_m: f32| match index
                        .and_then(|index| scan.sectors.get(index))
                        .copied()
                        .unwrap_or_default()
                    {
                        Sector::Clear => true,
                        Sector::Hit(hit_m) => hit_m > edge_m,
                        Sector::Unknown => false,
                    };
                    let earlier = (turn.is_some() || first_index > 0).then(|| before(first_index));
                    let later = (turn.is_some() || next > 0).then_some(next);
                    let free = [
                        is_free(earlier, range_m(first_index)).then(|| turned.back(first_direction)),
                        is_free(later, here_m).then(|| turned.on(direction)),
                    ];
                    let points = look.points_ned_m.get(first..).unwrap_or_default();
                    self.cover(&Run { points, first, step_rad, free }, &mut fits_left, &mut look.detections);
                }
            }
            let is_seam = next == 0;
            direction = if is_seam { start } else { turned.on(direction) };
            index = next;
        }
        shift(&mut look);
        look
    }

    /// The circles behind single hits seen from `pose`.
    #[must_use]
    pub fn fit_points(&self, points: &Points, pose: &Pose) -> Look {
        let mut look = Look { origin_ned_m: pose.position_ned_m, ..Look::default() };
        if !pose.is_plausible() {
            look.refused = 1 + points.points_m.len() as u16;
            return look;
        }
        let (sine, cosine) = sin_cos(pose.yaw_rad);
        for point in &points.points_m {
            let point = match points.frame {
                Frame::Body => Horizontal {
                    north: cosine * point.north - sine * point.east,
                    east: sine * point.north + cosine * point.east,
                },
                Frame::VehicleNed => *point,
                Frame::LocalNed => point.minus(pose.position_ned_m),
            };
            let squared = point.norm_squared();
            if squared > 1e-6 && squared <= RANGE_MAX_M * RANGE_MAX_M {
                // Cannot fail: as many places.
                let _ = look.points_ned_m.push(point);
            } else {
                look.refused += 1;
            }
        }
        // In the order of azimuth, and begun where two neighbours are far apart.
        sort_by_key(&mut look.points_ned_m, |point| around(*point));
        let apart = |a: &Horizontal, b: &Horizontal| {
            let limit = 2.0 * self.config.gap_m;
            a.minus(*b).norm_squared() >= limit * limit
        };
        let seam = match (look.points_ned_m.first(), look.points_ned_m.last()) {
            (Some(first), Some(last)) if !apart(first, last) => {
                look.points_ned_m.windows(2).position(|pair| apart(&pair[0], &pair[1])).map_or(0, |index| index + 1)
            }
            _ => 0,
        };
        let count = look.points_ned_m.len();
        look.points_ned_m.rotate_left(seam.min(count));
        let mut first = 0;
        let mut fits_left = FITS_MAX;
        let mut rest = look.points_ned_m.as_slice();
        while !rest.is_empty() {
            let end = rest.windows(2).take_while(|pair| !apart(&pair[0], &pair[1])).count() + 1;
            let Some((run, others)) = rest.split_at_checked(end) else { break };
            rest = others;
            let run_of = Run { points: run, first, step_rad: 0.0, free: [None; 2] };
            self.cover(&run_of, &mut fits_left, &mut look.detections);
            first += run.len();
        }
        shift(&mut look);
        look
    }

    /// Covers one run of hits with circles; `fits_left` counts down the points that may still be fitted to.
    fn cover(&self, run: &Run<'_>, fits_left: &mut usize, detections: &mut Vec<Detection, DETECTIONS_MAX>) {
        let end = run.points.len();
        // Pieces still to cover, as ranges of the run; each cut shortens them, so this ends.
        let mut pieces: Vec<(usize, usize), { POINTS_MAX / 2 + 1 }> = Vec::new();
        let _ = pieces.push((0, end));
        while let Some((from, to)) = pieces.pop() {
            let piece = Run {
                points: run.points.get(from..to).unwrap_or_default(),
                first: run.first + from,
                free: [run.free[0].filter(|_| from == 0), run.free[1].filter(|_| to == end)],
                ..*run
            };
            // What is cut over and over is no pillar.
            let verdict = match fits_left.checked_sub(to - from) {
                Some(left) if to - from >= FIT_MIN => {
                    *fits_left = left;
                    self.pillar(&piece)
                }
                Some(_) if to - from == end => self.thin(&piece),
                _ => Verdict::Chain,
            };
            match verdict {
                Verdict::Pillar(pillar) => {
                    // Cannot fail: no more circles than hits.
                    let _ = detections.push(pillar);
                }
                Verdict::Cut(at) => {
                    let _ = pieces.push((from + at, to));
                    let _ = pieces.push((from, from + at));
                }
                Verdict::Chain => {
                    // As far as the next piece, so that nothing is left open between them.
                    let points = run.points.get(from..if to < end { to + 1 } else { to }).unwrap_or_default();
                    let edges = Edges { first: piece.free[0].is_some(), last: piece.free[1].is_some() };
                    self.chain(points, run.first + from, edges, run.step_rad, detections);
                }
            }
        }
    }

    fn chain(
        &self,
        points: &[Horizontal],
        first: usize,
        edges: Edges,
        step_rad: f32,
        detections: &mut Vec<Detection, DETECTIONS_MAX>,
    ) {
        // A sector's hit lies anywhere in its width.
        let half_m = points.first().map_or(0.0, |point| 0.5 * step_rad * root(point.norm_squared()));
        let radius_min_m = between(half_m, self.config.radius_min_m, self.config.radius_max_m);
        chain::cover(points, edges, radius_min_m, |link| {
            let _ = detections.push(Detection {
                kind: Kind::Patch,
                center_ned_m: link.center,
                radius_m: link.radius_m,
                sigma_m: 0.01,
                face_ned_m: link.face,
                from: (first + link.from) as u8,
                to: (first + link.to) as u8,
            });
        });
    }

    /// Whether a piece is a pillar, or where to cut it, or neither.
    fn pillar(&self, piece: &Run<'_>) -> Verdict {
        let c = &self.config;
        let points = piece.points;
        let Some(found) = circle::fit(points) else { return Verdict::Chain };
        if found.residual_m > c.residual_max_m {
            return Verdict::Cut(found.worst.clamp(2, points.len() - 2));
        }
        let middle = points[points.len() / 2];
        let is_round = found.center.minus(middle).dot(middle) > 0.0
            && found.radius_m <= c.radius_max_m
            && found.sigma_m <= c.radius_doubt_max * found.radius_m
            && is_inside(found.center, found.radius_m, piece.free);
        if !is_round {
            return Verdict::Chain;
        }
        let radius_m = if found.radius_m < c.radius_min_m { c.radius_min_m } else { found.radius_m };
        piece.pillar(found.center, radius_m, found.sigma_m)
    }

    /// The circle that fills the angle of a few hits, if both its sides are free and it covers them:
    /// `r / (nearest + r) = sin(half of the angle)`.
    fn thin(&self, piece: &Run<'_>) -> Verdict {
        let c = &self.config;
        let ([Some(_), Some(_)], Some(first), Some(last)) = (piece.free, piece.points.first(), piece.points.last())
        else {
            return Verdict::Chain;
        };
        let least = |a: f32, p: &Horizontal| if p.norm_squared() < a { p.norm_squared() } else { a };
        let nearest_m = root(piece.points.iter().fold(f32::INFINITY, least));
        // Of small angles: the fourth power of it is left out.
        let half_rad = (0.5 * piece.step_rad * piece.points.len() as f32).clamp(0.0, 1.2);
        let s = half_rad * (1.0 - half_rad * half_rad / 6.0);
        let radius_m = between(nearest_m * s / (1.0 - s), c.radius_min_m, c.radius_max_m);
        let unit = |p: &Horizontal| p.times(inverse_root(p.norm_squared()));
        let toward = unit(first).plus(unit(last));
        let center = toward.times((nearest_m + radius_m) * inverse_root(toward.norm_squared()));
        let reach_m = radius_m + c.residual_max_m;
        let covers = |point: &Horizontal| point.minus(center).norm_squared() <= reach_m * reach_m;
        if !piece.points.iter().all(covers) {
            return Verdict::Chain;
        }
        piece.pillar(center, radius_m, 0.02 + 0.5 * nearest_m * piece.step_rad)
    }
}

/// What a piece of a run turned out to be.
enum Verdict {
    Pillar(Detection),
    Cut(usize),
    Chain,
}

/// Whether a circle keeps out of the directions that are free.
fn is_inside(center: Horizontal, radius_m: f32, free: [Option<Horizontal>; 2]) -> bool {
    free.iter().flatten().all(|direction| libm::fabsf(circle::cross(*direction, center)) > radius_m - REACH_M)
}

/// From the sensor's place to the local frame.
fn shift(look: &mut Look) {
    let origin = look.origin_ned_m;
    for point in &mut look.points_ned_m {
        *point = point.plus(origin);
    }
    for detection in &mut look.detections {
        detection.center_ned_m = detection.center_ned_m.plus(origin);
        detection.face_ned_m = detection.face_ned_m.plus(origin);
    }
}

/// Grows with the azimuth from north over east, from -2 to 2, without an arctangent.
fn around(point: Horizontal) -> f32 {
    let along = point.north / (libm::fabsf(point.north) + libm::fabsf(point.east));
    if point.east >= 0.0 { 1.0 - along } else { along - 1.0 }
}

#[cfg(test)]
mod tests;
