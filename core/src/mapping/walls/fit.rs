//! Total least squares: the line with the smallest mean square distance from points, and its extent.
//!
//! With the mean `m` and the scatter `S = sum (p - m)(p - m)^T` of the points, the line goes through `m` along the
//! eigenvector of the larger eigenvalue of `S`; the smaller one is the sum of the squared distances. Unlike the
//! regression of one coordinate on the other it works for every direction of a wall. Mean and scatter are computed in
//! one pass (Welford 1962), and those of two sets are combined without their points (Chan et al. 1979).

use super::Wall;
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;

/// Count, mean and scatter of points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Moments {
    /// Number of points, or their weight.
    pub(super) count: f32,
    /// Their mean.
    pub(super) mean_ned_m: Horizontal,
    /// Sums of the products of their distances from the mean: north north, north east, east east.
    pub(super) scatter_m2: [f32; 3],
}

/// The principal direction of moments, and their variances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spread {
    /// Unit vector along the least-squares line.
    pub(super) along_ned: Horizontal,
    /// Variance along it.
    pub(super) along_m2: f32,
    /// Variance across it.
    pub(super) across_m2: f32,
}

/// A line fitted to points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// The line, from the first of its points to the last.
    pub(super) line: Wall,
    /// Moments of its points.
    pub(super) moments: Moments,
    /// Root mean square distance of the points from the line.
    pub(super) rms_m: f32,
    /// Standard deviation of the points along the line.
    pub(super) along_m: f32,
}

impl Moments {
    /// No points. All bits are zero.
    #[must_use]
    pub(super) const fn new() -> Self {
        Self { count: 0.0, mean_ned_m: Horizontal { north: 0.0, east: 0.0 }, scatter_m2: [0.0; 3] }
    }

    /// Adds a point.
    pub(super) fn add(&mut self, point_ned_m: Horizontal) {
        self.count += 1.0;
        let before = point_ned_m.minus(self.mean_ned_m);
        self.mean_ned_m = self.mean_ned_m.plus(before.times(1.0 / self.count));
        let after = point_ned_m.minus(self.mean_ned_m);
        let [nn, ne, ee] = self.scatter_m2;
        self.scatter_m2 =
            [nn + before.north * after.north, ne + before.north * after.east, ee + before.east * after.east];
    }

    /// The moments of both sets of points together.
    #[must_use]
    pub(super) fn joined(&self, other: &Self) -> Self {
        let count = self.count + other.count;
        if !(count > 0.0) {
            return *self;
        }
        let apart = other.mean_ned_m.minus(self.mean_ned_m);
        let share = other.count / count;
        let between = self.count * share;
        let products = [apart.north * apart.north, apart.north * apart.east, apart.east * apart.east];
        let [mine, others] = [self.scatter_m2, other.scatter_m2];
        Self {
            count,
            mean_ned_m: self.mean_ned_m.plus(apart.times(share)),
            scatter_m2: core::array::from_fn(|k| mine[k] + others[k] + between * products[k]),
        }
    }

    /// The spread of the points; `None` if they are all at one place, or there are none.
    #[must_use]
    pub(super) fn spread(&self) -> Option<Spread> {
        let [nn, ne, ee] = self.scatter_m2.map(|sum| sum / self.count);
        let (mean, half) = (0.5 * (nn + ee), 0.5 * (nn - ee));
        let apart = sqrt(half * half + ne * ne);
        // Of the two expressions for the eigenvector, the one without cancellation.
        let along = if half >= 0.0 {
            Horizontal { north: apart + half, east: ne }
        } else {
            Horizontal { north: ne, east: apart - half }
        };
        let norm = along.norm();
        // Below this, differences of coordinates are only rounding errors.
        if !(mean > 1e-10 && mean.is_finite()) {
            return None;
        }
        // A round cluster has no principal direction: any will do.
        let along_ned = if norm > 0.0 { along.times(1.0 / norm) } else { Horizontal { north: 1.0, east: 0.0 } };
        let across_m2 = if mean > apart { mean - apart } else { 0.0 };
        Some(Spread { along_ned, along_m2: mean + apart, across_m2 })
    }
}

impl Spread {
    /// The line through a point, as long as evenly spread points with this variance.
    #[must_use]
    pub(super) fn line_through(&self, mean_ned_m: Horizontal) -> Wall {
        let middle_m = self.along_ned.dot(mean_ned_m);
        let half_m = sqrt(3.0 * self.along_m2);
        self.line_from_to(mean_ned_m, middle_m - half_m, middle_m + half_m)
    }

    fn line_from_to(&self, place_ned_m: Horizontal, from_m: f32, to_m: f32) -> Wall {
        let normal_ned = Horizontal { north: -self.along_ned.east, east: self.along_ned.north };
        Wall { normal_ned, offset_m: normal_ned.dot(place_ned_m), from_m, to_m }
    }
}

/// The least-squares line through finite points; `None` for fewer than two different ones.
pub(super) fn fit(points_ned_m: impl Iterator<Item = Horizontal> + Clone) -> Option<Fit> {
    let mut moments = Moments::new();
    for point in points_ned_m.clone() {
        moments.add(point);
    }
    let spread = moments.spread()?;
    // Relative to the mean, which is accurate also for points far from the origin.
    let (mut from_m, mut to_m) = (0.0_f32, 0.0_f32);
    for point in points_ned_m {
        let along_m = spread.along_ned.dot(point.minus(moments.mean_ned_m));
        from_m = if along_m < from_m { along_m } else { from_m };
        to_m = if along_m > to_m { along_m } else { to_m };
    }
    let middle_m = spread.along_ned.dot(moments.mean_ned_m);
    Some(Fit {
        line: spread.line_from_to(moments.mean_ned_m, middle_m + from_m, middle_m + to_m),
        moments,
        rms_m: sqrt(spread.across_m2),
        along_m: sqrt(spread.along_m2),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use std::vec::Vec;

    fn on(line: &Wall, along_m: f32, off_m: f32) -> Horizontal {
        line.normal_ned.times(line.offset_m + off_m).plus(line.along_ned().times(along_m))
    }

    #[test]
    fn angle_and_offset_are_within_what_the_noise_allows_for_walls_of_every_bearing() {
        let mut rng = Rng::new(11, 1);
        let (sigma_m, count, length_m) = (0.05_f32, 40, 6.0_f32);
        // Of evenly spread points: angle sigma / (length sqrt(n / 12)), offset at the middle sigma / sqrt(n).
        let angle_sigma = sigma_m / (length_m * (count as f32 / 12.0).sqrt());
        let offset_sigma = sigma_m / (count as f32).sqrt();
        let (mut angles, mut offsets, mut runs) = (0.0, 0.0, 0.0);
        for case in 0..720 {
            let truth = Wall {
                normal_ned: Horizontal::from_bearing(case as f32 * 0.5_f32.to_radians()),
                offset_m: 20.0 * rng.uniform() - 10.0,
                ..Wall::default()
            };
            let middle_m = 20.0 * rng.uniform() - 10.0;
            let points: Vec<_> = (0..count)
                .map(|k| {
                    let along_m = middle_m + length_m * ((k as f32 + 0.5) / count as f32 - 0.5);
                    on(&truth, along_m, sigma_m * rng.gaussian())
                })
                .collect();
            let found = fit(points.iter().copied()).unwrap();
            let angle = found.line.along_ned().dot(truth.normal_ned) / angle_sigma;
            let offset = found.line.distance_m(on(&truth, middle_m, 0.0)) / offset_sigma;
            assert!(angle.abs() < 5.0 && offset.abs() < 5.0, "{case}: {angle} {offset}");
            assert!((found.line.to_m - found.line.from_m - length_m * 39.0 / 40.0).abs() < 0.02);
            angles += angle * angle;
            offsets += offset * offset;
            runs += 1.0;
        }
        // Mean squares of 720 normalised errors: one, within five standard errors.
        let bound = 5.0 * (2.0_f32 / runs).sqrt();
        assert!((angles / runs - 1.0).abs() < bound && (offsets / runs - 1.0).abs() < bound, "{angles} {offsets}");
    }

    #[test]
    fn moments_are_those_of_f64_however_far_from_the_origin() {
        let mut rng = Rng::new(12, 1);
        let points: Vec<_> = (0..100)
            .map(|_| Horizontal { north: 900.0 + 3.0 * rng.gaussian(), east: -700.0 + 0.5 * rng.gaussian() })
            .collect();
        let mut all = Moments::new();
        let mut halves = [Moments::new(); 2];
        for (k, point) in points.iter().enumerate() {
            all.add(*point);
            halves[k % 2].add(*point);
        }
        let joined = halves[0].joined(&halves[1]);
        let n = points.len() as f64;
        let mean = |of: fn(&Horizontal) -> f32| points.iter().map(|p| f64::from(of(p))).sum::<f64>() / n;
        let (north, east) = (mean(|p| p.north), mean(|p| p.east));
        let ne: f64 = points.iter().map(|p| (f64::from(p.north) - north) * (f64::from(p.east) - east)).sum();
        let nn: f64 = points.iter().map(|p| (f64::from(p.north) - north).powi(2)).sum();
        for moments in [all, joined] {
            assert!((f64::from(moments.mean_ned_m.north) - north).abs() < 1e-3, "{moments:?}");
            assert!((f64::from(moments.scatter_m2[0]) / nn - 1.0).abs() < 1e-3, "{moments:?} {nn}");
            assert!((f64::from(moments.scatter_m2[1]) - ne).abs() < 1e-3 * nn, "{moments:?} {ne}");
        }
        assert_eq!(Moments::new().joined(&all), all);
    }

    #[test]
    fn what_is_no_line_is_none() {
        let place = Horizontal { north: 3.0, east: -4.0 };
        assert_eq!(fit([].into_iter()), None);
        assert_eq!(fit([place].into_iter()), None);
        assert_eq!(fit([place; 9].into_iter()), None);
        let huge = Horizontal { north: f32::MAX, east: f32::MAX };
        assert_eq!(fit([place, huge].into_iter()), None);
        let other = Horizontal { north: 3.0, east: 5.0 };
        let found = fit([place, other].into_iter()).unwrap();
        assert_eq!((found.moments.count, found.rms_m), (2.0, 0.0));
        assert!((found.line.to_m - found.line.from_m - 9.0).abs() < 1e-5);
        // Round: some line, finite.
        let round = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)].map(|(north, east)| Horizontal { north, east });
        let found = fit(round.into_iter()).unwrap();
        assert!(found.rms_m > 0.7 && found.along_m < 0.71 && found.line.normal_ned.norm() > 0.99);
    }
}
