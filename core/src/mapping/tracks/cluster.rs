//! Hits that lie together, and the centre of the object of a known radius behind them.

use core::ops::Range;

use heapless::Vec;

use super::{CLUSTERS_MAX, Kept, RADIUS_M};
use crate::base::math::inverse_root;
use crate::base::ned::Horizontal;
use crate::base::pose::Pose;
use crate::base::units::{nearest, wrap_pi};
use crate::mapping::scan::{Scan, Sector};

/// A cluster longer than this is not an object.
const LONG_M: f32 = 1.1;
/// Nor is a cluster that is longer than the first and as straight as the second.
const WALL_M: f32 = 0.45;
const STRAIGHT_M: f32 = 0.05;
/// Parts of a long piece.
const PART_M: f32 = 0.7;
/// A gap in range deeper than this separates two objects.
const CUSP_M: f32 = 0.08;
/// Wider sectors give the range of a hit but not its position.
const WIDE_RAD: f32 = 0.05;
/// Most Gauss-Newton steps, and the length of a step below which the fit has converged.
const STEPS: usize = 4;
const ENOUGH_M: f32 = 0.003;

/// Hits that lie together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cluster {
    pub(super) center_ned_m: Horizontal,
    /// Distance of the nearest hit.
    pub(super) range_m: f32,
    pub(super) sigma_m: f32,
    /// How long before the time of the tracks it was measured.
    pub(super) ago_s: f32,
    /// An earlier scan saw through where it is now.
    pub(super) was_free: bool,
    /// The track that it belongs to.
    pub(super) track: Option<u8>,
}

/// A scan, `late_s` old, and where it hits; an earlier scan.
pub(super) struct View<'a> {
    pub(super) scan: &'a Scan,
    pub(super) late_s: f32,
    pub(super) pose: &'a Pose,
    pub(super) hits: &'a [Horizontal],
    pub(super) before: Option<&'a Kept>,
}

/// The clusters that may be objects; the nearest, if they are too many.
pub(super) fn find(clusters: &mut Vec<Cluster, CLUSTERS_MAX>, view: &View<'_>) {
    let step_rad = libm::fabsf(view.scan.step_rad);
    let mut from = 0;
    let mut cusp = Cusp::default();
    for to in 1..=view.hits.len() {
        let (Some(before), next) = (view.hits.get(to - 1), view.hits.get(to)) else { continue };
        let cut = cusp.step(to - 1, before.norm());
        if let Some(cut) = cut.filter(|cut| *cut > from) {
            cut_up(clusters, view, from..cut);
            from = cut;
        }
        if next.is_none_or(|next| is_apart(*before, *next, step_rad)) {
            cut_up(clusters, view, from..to);
            (from, cusp) = (to, Cusp::default());
        }
    }
}

/// A piece, in parts as long as an object where it is longer.
#[inline(never)]
fn cut_up(clusters: &mut Vec<Cluster, CLUSTERS_MAX>, view: &View<'_>, piece: Range<usize>) {
    let View { scan, late_s, pose, hits, before } = *view;
    let points = hits.get(piece.clone()).unwrap_or_default();
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
    let chord_m = last.minus(*first).norm();
    // A wall, or people side by side, who came to where nothing was.
    let is_long = is_wall(points, chord_m);
    let parts = (libm::roundf(chord_m / PART_M) as usize).min(points.len()).max(1);
    for part in 0..parts {
        let at = |part: usize| piece.start + part * points.len() / parts;
        let (from, to) = (at(part), at(part + 1));
        let its = hits.get(from..to).unwrap_or_default();
        let was_free = before.is_some_and(|before| before.saw_through(its, pose.position_ned_m));
        if is_long && !was_free {
            continue;
        }
        let (center, range_m) = center(its);
        let sigma_m = sigma_m(scan, pose, its, range_m);
        // A hit of the first or the last ray may lie outside of the view from where the vehicle was in the middle of the turn.
        let middle = its.get(its.len() / 2).map_or(0, |hit| ray_at(scan, pose, *hit)).max(0) as usize;
        let after_s = scan.after_s(middle.min(scan.rays.len().saturating_sub(1)) as f32);
        let center_ned_m = center.plus(pose.position_ned_m);
        let seen = Cluster { center_ned_m, range_m, sigma_m, ago_s: late_s - after_s, was_free, track: None };
        let Err(seen) = clusters.push(seen) else { continue };
        if let Some(farthest) = clusters.iter_mut().max_by(|a, b| a.range_m.total_cmp(&b.range_m))
            && seen.range_m < farthest.range_m
        {
            *farthest = seen;
        }
    }
}

/// Finds where the range has a hollow between two things that are nearer: there two objects stand side by side.
#[derive(Clone, Copy, Debug)]
struct Cusp {
    least_m: f32,
    farthest_m: f32,
    at: usize,
}

impl Default for Cusp {
    fn default() -> Self {
        Self { least_m: f32::INFINITY, farthest_m: 0.0, at: 0 }
    }
}

impl Cusp {
    /// Takes one more hit; returns the hit behind which the hollow lies, once it is passed.
    fn step(&mut self, index: usize, range_m: f32) -> Option<usize> {
        if range_m > self.farthest_m && range_m > self.least_m + CUSP_M {
            (self.farthest_m, self.at) = (range_m, index);
        }
        if self.farthest_m > 0.0 && range_m < self.farthest_m - CUSP_M {
            let at = self.at;
            *self = Self { least_m: range_m, ..Self::default() };
            return Some(at);
        }
        if range_m < self.least_m {
            self.least_m = range_m;
        }
        None
    }
}

fn is_apart(a: Horizontal, b: Horizontal, step_rad: f32) -> bool {
    let (a_m, b_m) = (a.norm(), b.norm());
    let nearer_m = if a_m < b_m { a_m } else { b_m };
    let apart_m = a.minus(b).norm();
    if step_rad > WIDE_RAD {
        return libm::fabsf(a_m - b_m) > 0.3 || apart_m > 1.8 * step_rad * nearer_m + 0.3;
    }
    let by_step_m = 2.5 * step_rad * nearer_m + 0.08;
    apart_m > if by_step_m > 0.12 { by_step_m } else { 0.12 }
}

/// Whether the hits form something long or straight.
fn is_wall(piece: &[Horizontal], chord_m: f32) -> bool {
    let (Some(first), Some(last)) = (piece.first(), piece.last()) else { return true };
    if chord_m > LONG_M {
        return true;
    }
    if chord_m < WALL_M || piece.len() < 3 {
        return false;
    }
    let chord = last.minus(*first);
    let across = Horizontal { north: -chord.east, east: chord.north }.times(1.0 / chord_m);
    piece.iter().all(|point| libm::fabsf(point.minus(*first).dot(across)) < STRAIGHT_M)
}

/// The centre of an object behind its hits, from where they were seen, and the distance of the nearest of them.
fn center(piece: &[Horizontal]) -> (Horizontal, f32) {
    let unit = |v: Horizontal| v.times(inverse_root(v.norm_squared()));
    let ends = match (piece.first(), piece.last()) {
        (Some(first), Some(last)) => unit(unit(*first).plus(unit(*last))),
        _ => return (Horizontal::default(), 0.0),
    };
    let nearest_m = piece.iter().map(|p| p.norm()).fold(f32::INFINITY, |a, b| if b < a { b } else { a });
    let begin = ends.times(nearest_m + RADIUS_M);
    let mut at = begin;
    for _ in 0..STEPS {
        // The hits say how far it is across the surface; along it a little holds it where its ends say.
        let hold = 0.1 * piece.len() as f32;
        let (mut nn, mut ne, mut ee) = (hold, 0.0, hold);
        let drag = begin.minus(at).times(hold);
        let (mut n, mut e) = (drag.north, drag.east);
        for point in piece {
            let away = at.minus(*point);
            let towards = away.times(inverse_root(away.norm_squared() + 1e-9));
            let miss_m = RADIUS_M - away.dot(towards);
            nn += towards.north * towards.north;
            ne += towards.north * towards.east;
            ee += towards.east * towards.east;
            n += towards.north * miss_m;
            e += towards.east * miss_m;
        }
        let of = 1.0 / (nn * ee - ne * ne);
        let step = Horizontal { north: (ee * n - ne * e) * of, east: (nn * e - ne * n) * of };
        at = at.plus(step);
        if step.norm_squared() < ENOUGH_M * ENOUGH_M {
            break;
        }
    }
    (at, nearest_m)
}

/// Index of the ray that hit a point; one that is not in the view is on the side to which the point is nearer.
fn ray_at(scan: &Scan, pose: &Pose, point: Horizontal) -> i32 {
    let azimuth_rad = wrap_pi(point.bearing_rad() - pose.yaw_rad - scan.first_azimuth_rad);
    let index = nearest(azimuth_rad / scan.step_rad);
    let whole =
        scan.turn().map_or_else(|| nearest(core::f32::consts::TAU / libm::fabsf(scan.step_rad)), |turn| turn as i32);
    let unseen = (whole - scan.rays.len() as i32).max(0);
    if index < -unseen / 2 { index + whole } else { index }
}

/// How well the centre is known: less well if something nearer hides a side of it, or if the view ends there.
fn sigma_m(scan: &Scan, pose: &Pose, piece: &[Horizontal], range_m: f32) -> f32 {
    let by_width_m = 0.3 * libm::fabsf(scan.step_rad) * range_m;
    let mut sigma_m = if by_width_m > 0.02 { by_width_m } else { 0.02 };
    for (point, side) in [(piece.first(), -1), (piece.last(), 1)] {
        let Some(point) = point else { continue };
        let least_m = match scan.sector(ray_at(scan, pose, *point) + side) {
            Sector::Unknown => 0.15,
            Sector::Hit(hit_m) if hit_m < point.norm() - 0.1 => 0.06,
            _ => 0.0,
        };
        if least_m > sigma_m {
            sigma_m = least_m;
        }
    }
    sigma_m
}
