//! The noise of a sensor's ranges, from its own scans: how far a range is off the straight line through those on either side.
//!
//! On a straight wall `1 / range` is a sinusoid of the azimuth, whatever the wall's direction, so that the middle one of three ranges
//! follows from the other two. What it is off by has 1.22 times the sigma of a range, and a median of 0.83 sigma. Corners, edges and
//! what is round are off by more; they are the fewer, and the median does not mind by how much.

use super::cluster::WIDE_RAD;
use crate::mapping::scan::{Scan, Sector};

/// Sigma of a range up to which the constants of tracks hold.
const USUAL_M: f32 = 0.025;
/// Median of what the middle range is off by, for a sigma of one.
const MEDIAN: f32 = 0.826;
/// Most triples of one scan.
const TRIPLES: usize = 72;
/// How far the median moves for each of them, at least: 2 cm in a second of scans of 72 rays at 10 Hz, of which every other is used.
const STEP_M: f32 = 6e-5;
/// For the first of all, and for the second half as far, and so on: after the first scan of a wall it is known.
const FIRST_M: f32 = 0.02;
/// As far as it goes.
const MOST_M: f32 = 0.1;

/// A running median, by the stochastic approximation of Robbins and Monro.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Noise {
    median_m: f32,
    taken: u16,
}

impl Noise {
    /// Takes in a scan, unless its sectors are so wide that they show no straight lines.
    #[inline(never)]
    pub(super) fn take(&mut self, scan: &Scan) {
        if libm::fabsf(scan.step_rad) > WIDE_RAD {
            return;
        }
        let twice_cosine = 2.0 - scan.step_rad * scan.step_rad;
        let each = scan.rays.len() / TRIPLES + 1;
        for at in (1..scan.rays.len().saturating_sub(1)).step_by(each) {
            let [Sector::Hit(before_m), Sector::Hit(range_m), Sector::Hit(after_m)] =
                [at - 1, at, at + 1].map(|at| scan.rays.get(at))
            else {
                continue;
            };
            let off_m = libm::fabsf(range_m - twice_cosine * before_m * after_m / (before_m + after_m));
            self.taken = self.taken.saturating_add(1);
            let step_m = FIRST_M / f32::from(self.taken);
            let step_m = if step_m > STEP_M { step_m } else { STEP_M };
            self.median_m += if off_m > self.median_m { step_m } else { -step_m };
        }
        self.median_m = self.median_m.clamp(0.0, MOST_M);
    }

    /// How many times as large as usual it is; at least 1.
    pub(super) fn factor(&self) -> f32 {
        let factor = self.median_m * (1.0 / (MEDIAN * USUAL_M));
        if factor > 1.0 { factor } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::base::time::Instant;

    /// A wall ahead that turns away on the right, seen with noise.
    fn corner(sigma_m: f32, rays: usize, rng: &mut Rng) -> Scan {
        let step_rad = 1.57 / rays as f32;
        let ray = |at: usize| {
            let azimuth_rad = step_rad * at as f32 - 0.78;
            let range_m = (2.0 / libm::cosf(azimuth_rad)).min(1.2 / libm::sinf(azimuth_rad).max(0.01));
            Sector::Hit(range_m + sigma_m * rng.gaussian())
        };
        let rays = (0..rays).map(ray).collect();
        Scan { time: Instant(0), turn_s: 0.0, first_azimuth_rad: -0.78, step_rad, range_max_m: 5.0, rays }
    }

    #[test]
    fn the_noise_is_that_of_the_ranges_after_one_scan_and_follows_them() {
        for (sigma_m, rays) in [(0.03, 72), (0.05, 72), (0.05, 180), (0.08, 72)] {
            let (mut noise, mut rng) = (Noise::default(), Rng::new(1, rays as u64));
            noise.take(&corner(sigma_m, rays, &mut rng));
            let first = noise.factor() * USUAL_M;
            assert!((first / sigma_m - 1.0).abs() < 0.4, "{sigma_m} {rays}: {first}");
            for _ in 0..20 {
                noise.take(&corner(sigma_m, rays, &mut rng));
            }
            let last = noise.factor() * USUAL_M;
            assert!((last / sigma_m - 1.0).abs() < 0.12, "{sigma_m} {rays}: {last}");
            for _ in 0..60 {
                noise.take(&corner(0.01, rays, &mut rng));
            }
            assert_eq!(noise.factor(), 1.0, "{sigma_m} {rays}");
        }
    }

    #[test]
    fn of_little_noise_and_of_wide_sectors_nothing_comes() {
        for (sigma_m, rays) in [(0.0, 72), (0.02, 72), (0.02, 300), (0.05, 24)] {
            let (mut noise, mut rng) = (Noise::default(), Rng::new(2, rays as u64));
            for _ in 0..50 {
                noise.take(&corner(sigma_m, rays, &mut rng));
                assert_eq!(noise.factor(), 1.0, "{sigma_m} {rays}");
            }
        }
    }
}
