//! Obstacle scans: sectors of distance around the nose, as `OBSTACLE_DISTANCE` brings them, and the circles behind them.
//!
//! Neighbouring hits whose distance does not jump belong together; each such run becomes one circle if one fits
//! (algebraic least squares of Kasa, 1976: linear, closed, well posed on the wide arc that a pillar shows), and is cut in
//! two where it fits worst if none does. What stays too short to fit takes its radius from the angle it fills. The main
//! paper fits circles to the points of a cloud in the same place (section IV) and does not say how.
//!
//! Cost: about 60 instructions a sector.

use heapless::Vec;

use crate::error::{ConfigError, check};
use crate::frame::Horizontal;
use crate::time::Instant;
use crate::units::sin_cos;

/// Most sectors one scan can hold.
pub const SECTORS_MAX: usize = 72;
/// Most circles that one scan yields; the nearest sectors win.
pub const DETECTIONS_MAX: usize = 24;

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
}

impl Default for Config {
    fn default() -> Self {
        Self { gap_m: 0.10, residual_max_m: 0.03, radius_min_m: 0.05, radius_max_m: 1.5 }
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
        Ok(Fitter { config: *self })
    }
}

/// One circle seen in one scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Detection {
    /// Centre, local NED.
    pub center_ned_m: Horizontal,
    /// Radius.
    pub radius_m: f32,
    /// Standard deviation of centre and radius.
    pub sigma_m: f32,
}

/// Where and which way the sensor looked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position of the vehicle when it scanned.
    pub position_ned_m: Horizontal,
    /// Yaw of the vehicle when it scanned.
    pub yaw_rad: f32,
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitter {
    config: Config,
}

/// A hit, seen from the sensor.
#[derive(Clone, Copy, Default)]
struct Hit {
    azimuth_rad: f32,
    range_m: f32,
    /// From the sensor, NED.
    point: Horizontal,
    sector: usize,
}

impl Fitter {
    /// The circles behind the hits of a scan taken at `pose`.
    #[must_use]
    pub fn fit(&self, scan: &Scan, pose: &Pose) -> Vec<Detection, DETECTIONS_MAX> {
        let mut detections = Vec::new();
        let mut run: Vec<Hit, SECTORS_MAX> = Vec::new();
        for (index, sector) in scan.sectors.iter().enumerate() {
            let hit = match *sector {
                Sector::Hit(range_m) if range_m > 0.0 && range_m <= scan.range_max_m => {
                    let azimuth_rad = scan.first_azimuth_rad + scan.step_rad * index as f32;
                    let point = Horizontal::from_bearing(azimuth_rad + pose.yaw_rad).times(range_m);
                    Some(Hit { azimuth_rad, range_m, point, sector: index })
                }
                _ => None,
            };
            let continues = match (run.last(), &hit) {
                (Some(last), Some(hit)) => {
                    let nearer = if hit.range_m < last.range_m { hit.range_m } else { last.range_m };
                    let explained = 3.0 * nearer * libm::fabsf(scan.step_rad);
                    libm::fabsf(hit.range_m - last.range_m) < self.config.gap_m + explained
                }
                _ => false,
            };
            if !continues {
                self.cover(&run, scan, pose, &mut detections);
                run.clear();
            }
            if let Some(hit) = hit {
                // Cannot fail: as many places as sectors.
                let _ = run.push(hit);
            }
        }
        self.cover(&run, scan, pose, &mut detections);
        detections
    }

    /// Covers one run of hits with circles: one if it fits, else its pieces, cut where the fit is worst.
    fn cover(&self, run: &[Hit], scan: &Scan, pose: &Pose, detections: &mut Vec<Detection, DETECTIONS_MAX>) {
        // Pieces still to cover, as ranges of `run`; each cut shortens them, so this ends.
        let mut pieces: Vec<(usize, usize), SECTORS_MAX> = Vec::new();
        if !run.is_empty() {
            let _ = pieces.push((0, run.len()));
        }
        while let Some((from, to)) = pieces.pop() {
            let piece = &run[from..to];
            match self.circle(piece, scan) {
                Ok(detection) => {
                    let center_ned_m = detection.center_ned_m.plus(pose.position_ned_m);
                    let _ = detections.push(Detection { center_ned_m, ..detection });
                }
                Err(cut) => {
                    let _ = pieces.push((from + cut, to));
                    let _ = pieces.push((from, from + cut));
                }
            }
        }
    }

    /// The circle behind a piece, relative to the sensor, or where to cut it.
    fn circle(&self, piece: &[Hit], scan: &Scan) -> Result<Detection, usize> {
        let (first, last) = match (piece.first(), piece.last()) {
            (Some(first), Some(last)) => (first, last),
            _ => return Ok(Detection::default()),
        };
        let step_rad = libm::fabsf(scan.step_rad);
        // A silhouette is cut short where the view ends or something nearer stands in front.
        let hidden = |sector: Option<usize>, edge: f32| match sector.and_then(|s| scan.sectors.get(s)) {
            Some(Sector::Hit(range_m)) => *range_m < edge,
            Some(Sector::Clear) => false,
            Some(Sector::Unknown) | None => true,
        };
        let partial = hidden(first.sector.checked_sub(1), first.range_m) || hidden(Some(last.sector + 1), last.range_m);
        let nearest = piece.iter().fold(first.range_m, |m, hit| if hit.range_m < m { hit.range_m } else { m });

        // From the angle it fills: r / (nearest + r) = sin(half of the angle).
        let (s, _) = sin_cos((0.5 * step_rad * piece.len() as f32).clamp(0.0, 1.2));
        let angle_radius = (nearest * s / (1.0 - s)).clamp(self.config.radius_min_m, self.config.radius_max_m);
        let middle = 0.5 * (first.azimuth_rad + last.azimuth_rad) - first.azimuth_rad;
        let direction = rotate(first.point.times(1.0 / first.range_m), middle);
        let by_angle = Detection {
            center_ned_m: direction.times(nearest + angle_radius),
            radius_m: angle_radius,
            sigma_m: 0.02 + nearest * step_rad * if partial { 2.0 } else { 0.5 },
        };
        if piece.len() < 5 {
            return Ok(by_angle);
        }

        let Some((center, radius)) = kasa(piece) else { return Ok(by_angle) };
        let (mut worst, mut residual) = (piece.len() / 2, 0.0_f32);
        for (index, hit) in piece.iter().enumerate() {
            let miss = libm::fabsf(hit.point.minus(center).norm() - radius);
            if miss > residual {
                (worst, residual) = (index, miss);
            }
        }
        let behind = center.norm() > nearest;
        if behind && residual <= self.config.residual_max_m && radius <= self.config.radius_max_m {
            let radius_m = if radius < self.config.radius_min_m { self.config.radius_min_m } else { radius };
            // 1 cm of quantisation over n points on the arc; a silhouette that is cut short says less.
            let arc = 0.02 / libm::sqrtf(piece.len() as f32) + 0.1 * residual;
            return Ok(Detection { center_ned_m: center, radius_m, sigma_m: if partial { 6.0 * arc } else { arc } });
        }
        if behind && radius > self.config.radius_max_m {
            // A wall: halves, until the angle rule makes a chain of small circles of it.
            return Err(piece.len() / 2);
        }
        Err(worst.clamp(2, piece.len() - 2))
    }
}

/// Turns a vector clockwise.
fn rotate(v: Horizontal, angle_rad: f32) -> Horizontal {
    let (s, c) = sin_cos(angle_rad);
    Horizontal { north: c * v.north - s * v.east, east: s * v.north + c * v.east }
}

/// Kasa's fit: minimises sum (x^2 + y^2 - 2 a x - 2 b y - c)^2 about the centroid.
fn kasa(piece: &[Hit]) -> Option<(Horizontal, f32)> {
    let n = piece.len() as f32;
    let centroid = piece.iter().fold(Horizontal::default(), |sum, hit| sum.plus(hit.point)).times(1.0 / n);
    let (mut xx, mut xy, mut yy, mut xz, mut yz, mut zz) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for hit in piece {
        let p = hit.point.minus(centroid);
        let z = p.norm_squared();
        xx += p.north * p.north;
        xy += p.north * p.east;
        yy += p.east * p.east;
        xz += p.north * z;
        yz += p.east * z;
        zz += z;
    }
    let determinant = xx * yy - xy * xy;
    if !(determinant > 1e-5 * (xx + yy) * (xx + yy)) {
        return None;
    }
    let a = 0.5 * (xz * yy - yz * xy) / determinant;
    let b = 0.5 * (yz * xx - xz * xy) / determinant;
    let radius = libm::sqrtf(zz / n + a * a + b * b);
    let center = centroid.plus(Horizontal { north: a, east: b });
    (center.is_finite() && radius.is_finite()).then_some((center, radius))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec as StdVec;

    /// Ray-casts circles (north, east, radius) from the origin, nose to the north, as a 90 deg sensor of 3 m would, in cm.
    fn cast(circles: &[(f64, f64, f64)]) -> Scan {
        let (fov, range) = (90.0_f64.to_radians(), 3.0);
        let step = fov / 72.0;
        let first = -fov / 2.0 + step / 2.0;
        let mut sectors = [Sector::Clear; SECTORS_MAX];
        for (index, sector) in sectors.iter_mut().enumerate() {
            let azimuth = first + step * index as f64;
            for (north, east, radius) in circles {
                let along = north * azimuth.cos() + east * azimuth.sin();
                let across = (north * azimuth.sin() - east * azimuth.cos()).abs();
                if across < *radius && along > 0.0 {
                    let hit = ((along - (radius * radius - across * across).sqrt()) * 100.0).round() / 100.0;
                    let nearer = !matches!(sector, Sector::Hit(old) if f64::from(*old) < hit);
                    if hit < range && nearer {
                        *sector = Sector::Hit(hit as f32);
                    }
                }
            }
        }
        Scan {
            time: Instant(0),
            first_azimuth_rad: first as f32,
            step_rad: step as f32,
            range_max_m: range as f32,
            sectors,
        }
    }

    fn fit(circles: &[(f64, f64, f64)]) -> StdVec<Detection> {
        Config::default().build().unwrap().fit(&cast(circles), &Pose::default()).into_iter().collect()
    }

    #[test]
    fn a_pillar_is_found_where_it_stands_and_as_thick_as_it_is() {
        for radius in [0.1, 0.15, 0.25, 0.33, 0.5] {
            for distance in [0.9, 1.5, 2.2] {
                for side in [-0.4, 0.0, 0.3] {
                    let found = fit(&[(distance, side, radius)]);
                    assert_eq!(found.len(), 1, "{radius} {distance} {side}: {found:?}");
                    let center = found[0].center_ned_m;
                    let miss = (f64::from(center.north) - distance).hypot(f64::from(center.east) - side);
                    let allowed = 0.03 + 0.02 * distance;
                    assert!(miss < allowed, "{radius} {distance} {side}: {found:?}");
                    assert!((f64::from(found[0].radius_m) - radius).abs() < allowed, "{radius} {distance}: {found:?}");
                    // Its near face, which is what one flies into, is right to the centimetre.
                    let face = f64::from(center.norm() - found[0].radius_m);
                    let truth = (distance.hypot(side)) - radius;
                    assert!((face - truth).abs() < 0.03, "{radius} {distance} {side}: face {face} {truth}");
                }
            }
        }
    }

    #[test]
    fn two_pillars_side_by_side_are_two_even_when_they_touch() {
        assert_eq!(fit(&[(1.5, -0.4, 0.2), (1.6, 0.4, 0.2)]).len(), 2);
        let touching = fit(&[(1.5, -0.25, 0.25), (1.5, 0.25, 0.25)]);
        assert!(touching.len() >= 2, "{touching:?}");
    }

    #[test]
    fn a_wall_becomes_a_chain_of_circles_that_leaves_no_gap_to_slip_through() {
        // A circle of 30 m radius is a wall at this range.
        let found = fit(&[(31.5, 0.0, 30.0)]);
        assert!(found.len() >= 3, "{found:?}");
        for azimuth in (-40..=40).map(|a| f64::from(a).to_radians()) {
            let point = Horizontal { north: 1.5, east: (1.5 * azimuth.tan()) as f32 };
            let nearest =
                found.iter().map(|d| d.center_ned_m.minus(point).norm() - d.radius_m).fold(f32::INFINITY, f32::min);
            assert!(nearest < 0.15, "open at {azimuth}: {nearest}");
        }
    }

    #[test]
    fn the_pose_turns_and_shifts_what_is_seen() {
        let scan = cast(&[(1.5, 0.0, 0.25)]);
        let pose =
            Pose { position_ned_m: Horizontal { north: 10.0, east: -4.0 }, yaw_rad: core::f32::consts::FRAC_PI_2 };
        let found = Config::default().build().unwrap().fit(&scan, &pose);
        assert_eq!(found.len(), 1);
        assert!((found[0].center_ned_m.north - 10.0).abs() < 0.05, "{found:?}");
        assert!((found[0].center_ned_m.east + 2.5).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn garbage_in_sectors_yields_finite_circles_or_none() {
        for value in [f32::NAN, f32::INFINITY, -1.0, 0.0, 1e-20, 1e30] {
            let mut scan = cast(&[]);
            scan.sectors = [Sector::Hit(value); SECTORS_MAX];
            for detection in Config::default().build().unwrap().fit(&scan, &Pose::default()) {
                assert!(detection.center_ned_m.is_finite() && detection.radius_m.is_finite(), "{value}");
            }
        }
    }
}
