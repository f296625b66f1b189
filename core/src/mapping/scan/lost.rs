//! How many rays a sensor loses: they come back with nothing although something is there, as from what is black or slants.
//!
//! A ray that sees nothing between two that hit at the same range, so near to each other that hardly anybody could see
//! between them, counts as lost. Who learns from what is seen through asks for more than one scan if rays are lost.

use super::Scan;

/// The two hits beside the ray are at most so far apart, and their ranges so much.
const APART_MAX_M: f32 = 0.25;
const ALIKE_M: f32 = 0.05;
/// Share of the counts that is kept from scan to scan.
const KEPT: f32 = 0.95;
/// From this share on rays count as being lost, of this many that could be.
const SHARE: f32 = 0.01;
const ENOUGH: f32 = 1.5;

/// Counts of the last scans.
#[derive(Clone, Copy, Debug, Default)]
pub struct LostRays {
    lost: f32,
    whole: f32,
}

impl LostRays {
    /// Takes in a scan.
    #[inline(never)]
    pub fn note(&mut self, scan: &Scan) {
        let near_m = APART_MAX_M / (2.0 * libm::fabsf(scan.step_rad));
        let (lost, whole) = scan.rays.between_alike(near_m, ALIKE_M);
        self.lost = KEPT * self.lost + lost as f32;
        self.whole = KEPT * self.whole + (lost + whole) as f32;
    }

    /// Whether the sensor loses rays, more than now and then.
    #[must_use]
    pub fn are_many(&self) -> bool {
        self.lost > ENOUGH && self.lost > SHARE * self.whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::base::time::Instant;
    use crate::mapping::scan::Sector;

    fn scan(ray: impl FnMut(usize) -> Sector) -> Scan {
        let step_rad = 0.02;
        let rays = (0..72).map(ray).collect();
        Scan { time: Instant(0), turn_s: 0.0, first_azimuth_rad: -0.7, step_rad, range_max_m: 3.0, rays }
    }

    #[test]
    fn a_wall_seen_with_gaps_tells_of_lost_rays_and_a_whole_one_and_things_apart_do_not() {
        let mut rng = Rng::new(23, 0);
        let mut whole_wall = |_| Sector::Hit(2.0 + 0.02 * rng.gaussian());
        let mut lost = LostRays::default();
        for _ in 0..50 {
            lost.note(&scan(&mut whole_wall));
            assert!(!lost.are_many());
        }
        let mut rng = Rng::new(24, 0);
        let mut wall = |_| if rng.uniform() < 0.03 { Sector::Clear } else { Sector::Hit(2.0) };
        for _ in 0..20 {
            lost.note(&scan(&mut wall));
        }
        assert!(lost.are_many());
        // Gaps of one ray: between what is near and what is far, and between posts so far away that somebody could be seen there.
        let posts = |ray: usize| match ray % 6 {
            2 | 5 => Sector::Clear,
            0 | 1 => Sector::Hit(1.5),
            _ => Sector::Hit(2.0),
        };
        let far = |ray: usize| if ray % 3 == 1 { Sector::Clear } else { Sector::Hit(2.9) };
        let wide = |scan: Scan| Scan { step_rad: 0.05, ..scan };
        for _ in 0..200 {
            lost.note(&scan(posts));
            lost.note(&wide(scan(far)));
        }
        assert!(!lost.are_many());
        for _ in 0..3 {
            lost.note(&scan(far));
        }
        assert!(lost.are_many());
    }
}
