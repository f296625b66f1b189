//! Hits that lie together, and the centre of the object of a known radius behind them.

use core::ops::Range;

use heapless::Vec;
use heapless::binary_heap::{BinaryHeap, Max};

use super::{CLUSTERS_MAX, Kept, RADIUS_M, THROUGH_SHARE};
use crate::base::math::{inverse_root, sqrt};
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
pub(super) const WIDE_RAD: f32 = 0.05;
/// Most Gauss-Newton steps, and the length of a step below which the fit has converged.
const STEPS: usize = 4;
const ENOUGH_M: f32 = 0.003;

/// Hits that lie together.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cluster {
    pub(super) center_ned_m: Horizontal,
    pub(super) sigma_m: f32,
    /// How long before the time of the tracks it was measured.
    pub(super) ago_s: f32,
    /// An earlier scan saw through where it is now.
    pub(super) was_free: bool,
    /// Both of its ends are seen: nothing nearer hides one, and the view does not end there.
    pub(super) is_whole: bool,
    /// The track that it belongs to.
    pub(super) track: Option<u8>,
}

/// A scan, `late_s` old, and where it hits; an earlier scan.
pub(super) struct View<'a> {
    pub(super) scan: &'a Scan,
    pub(super) late_s: f32,
    pub(super) pose: &'a Pose,
    pub(super) hits: &'a [Horizontal],
    pub(super) before: Option<(&'a Kept, Option<&'a Kept>)>,
    /// How many times as large as usual the noise of the ranges is: `CUSP_M`, `STRAIGHT_M`, what is apart and sigma grow with it.
    pub(super) noise: f32,
}

impl View<'_> {
    fn hits(&self, piece: &Piece) -> &[Horizontal] {
        self.hits.get(usize::from(piece.from)..usize::from(piece.to)).unwrap_or_default()
    }

    /// Whether an earlier scan saw through where enough of them are; where rays are lost, two.
    fn was_free(&self, hits: &[Horizontal]) -> bool {
        let Some((newest, other)) = self.before else { return false };
        let enough = THROUGH_SHARE * hits.len() as f32;
        let (mut through, mut left) = (0.0, hits.len() as f32);
        for hit in hits {
            let place = hit.plus(self.pose.position_ned_m);
            if newest.saw_through(place, self.noise) && other.is_none_or(|kept| kept.saw_through(place, self.noise)) {
                through += 1.0;
            }
            left -= 1.0;
            // Most are those of walls, through none of which was seen.
            if through > enough || through + left <= enough {
                return through > enough;
            }
        }
        false
    }

    fn measure(&self, piece: &Piece) -> Cluster {
        let Self { scan, late_s, pose, .. } = *self;
        let hits = self.hits(piece);
        let range_m = sqrt(f32::from_bits(piece.nearest_m2));
        let end = |hit: Horizontal| (hit, ray_at(scan, pose, hit));
        let (center, ends) = match hits {
            [hit] => (hit.times(1.0 + RADIUS_M * inverse_root(hit.norm_squared() + 1e-9)), [end(*hit); 2]),
            [first, .., last] => (center(hits, range_m), [end(*first), end(*last)]),
            [] => Default::default(),
        };
        let center_ned_m = center.plus(pose.position_ned_m);
        let (sigma_m, is_whole) = sigma_m(scan, &ends, range_m, 0.02 * self.noise);
        // A hit of the first or the last ray may lie outside of the view from where the vehicle was in the middle of the turn.
        let middle = hits.get(hits.len() / 2).map_or(0, |hit| ray_at(scan, pose, *hit)).max(0) as usize;
        let after_s = scan.after_s(middle.min(scan.rays.len().saturating_sub(1)) as f32);
        Cluster { center_ned_m, sigma_m, ago_s: late_s - after_s, was_free: self.was_free(hits), is_whole, track: None }
    }
}

/// Hits that may be an object: the squared distance of the nearest, as bits, which are in the order of the numbers; and
/// from which hit to before which.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Piece {
    nearest_m2: u32,
    from: u16,
    to: u16,
}

/// The farthest on top.
type Pieces = BinaryHeap<Piece, Max, CLUSTERS_MAX>;

/// The clusters that may be objects; the nearest, if they are too many.
#[inline(never)]
pub(super) fn find(clusters: &mut Vec<Cluster, CLUSTERS_MAX>, view: &View<'_>) {
    let step_rad = libm::fabsf(view.scan.step_rad);
    let mut pieces = Pieces::new();
    let mut from = 0;
    let mut cusp = Cusp::default();
    let mut next_m = view.hits.first().map_or(0.0, |first| first.norm());
    for to in 1..=view.hits.len() {
        let (Some(before), next) = (view.hits.get(to - 1), view.hits.get(to)) else { continue };
        let before_m = next_m;
        next_m = next.map_or(0.0, |next| next.norm());
        let cut = cusp.step(to - 1, before_m, CUSP_M * view.noise);
        if let Some(cut) = cut.filter(|cut| *cut > from) {
            cut_up(&mut pieces, view, from..cut);
            from = cut;
        }
        if next.is_none_or(|next| is_apart((*before, before_m), (*next, next_m), step_rad, view.noise)) {
            cut_up(&mut pieces, view, from..to);
            (from, cusp) = (to, Cusp::default());
        }
    }
    for piece in pieces.iter() {
        // Cannot fail: there are as many places.
        let _ = clusters.push(view.measure(piece));
    }
}

/// A piece, in parts as long as an object where it is longer.
#[inline(never)]
fn cut_up(pieces: &mut Pieces, view: &View<'_>, piece: Range<usize>) {
    let points = view.hits.get(piece.clone()).unwrap_or_default();
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
    let chord_m = last.minus(*first).norm();
    let is_long = is_wall(points, chord_m, STRAIGHT_M * view.noise);
    let parts = (nearest(chord_m * (1.0 / PART_M)) as usize).min(points.len()).max(1);
    for part in 0..parts {
        let at = |part: usize| (piece.start + part * points.len() / parts) as u16;
        let mut part = Piece { nearest_m2: u32::MAX, from: at(part), to: at(part + 1) };
        let hits = view.hits(&part);
        for hit in hits {
            part.nearest_m2 = part.nearest_m2.min(hit.norm_squared().to_bits());
        }
        // A wall, unless it came to where nothing was: people side by side.
        if is_long && !view.was_free(hits) {
            continue;
        }
        keep_nearest(pieces, part);
    }
}

/// Adds a piece; where there is no space, in place of the farthest.
#[inline(never)]
fn keep_nearest(pieces: &mut Pieces, part: Piece) {
    let Err(part) = pieces.push(part) else { return };
    if let Some(mut farthest) = pieces.peek_mut()
        && part < *farthest
    {
        *farthest = part;
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
    fn step(&mut self, index: usize, range_m: f32, depth_m: f32) -> Option<usize> {
        if range_m > self.farthest_m && range_m > self.least_m + depth_m {
            (self.farthest_m, self.at) = (range_m, index);
        }
        if self.farthest_m > 0.0 && range_m < self.farthest_m - depth_m {
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

/// Whether two neighbours, at their ranges, are apart.
fn is_apart((a, a_m): (Horizontal, f32), (b, b_m): (Horizontal, f32), step_rad: f32, noise: f32) -> bool {
    let nearer_m = if a_m < b_m { a_m } else { b_m };
    let apart_m = a.minus(b).norm();
    if step_rad > WIDE_RAD {
        return libm::fabsf(a_m - b_m) > 0.3 || apart_m > 1.8 * step_rad * nearer_m + 0.3;
    }
    let (by_step_m, least_m) = (2.5 * step_rad * nearer_m + 0.08 * noise, 0.12 * noise);
    apart_m > if by_step_m > least_m { by_step_m } else { least_m }
}

/// Whether the hits form something long or straight.
fn is_wall(piece: &[Horizontal], chord_m: f32, straight_m: f32) -> bool {
    let (Some(first), Some(last)) = (piece.first(), piece.last()) else { return true };
    if chord_m > LONG_M {
        return true;
    }
    if chord_m < WALL_M || piece.len() < 3 {
        return false;
    }
    let chord = last.minus(*first);
    let across = Horizontal { north: -chord.east, east: chord.north }.times(1.0 / chord_m);
    piece.iter().all(|point| libm::fabsf(point.minus(*first).dot(across)) < straight_m)
}

/// The centre of an object behind its hits, from where they were seen, and of which the nearest is so far.
fn center(piece: &[Horizontal], nearest_m: f32) -> Horizontal {
    let unit = |v: Horizontal| v.times(inverse_root(v.norm_squared()));
    let ends = match (piece.first(), piece.last()) {
        (Some(first), Some(last)) => unit(unit(*first).plus(unit(*last))),
        _ => return Horizontal::default(),
    };
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
    at
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

/// How well the centre is known: less well if something nearer hides a side of it, or if the view ends there; and whether neither
/// is so.
fn sigma_m(scan: &Scan, ends: &[(Horizontal, i32); 2], range_m: f32, noise_m: f32) -> (f32, bool) {
    let by_width_m = 0.3 * libm::fabsf(scan.step_rad) * range_m;
    let mut is_whole = true;
    let mut sigma_m = if by_width_m > noise_m { by_width_m } else { noise_m };
    for ((point, ray), side) in ends.iter().zip([-1, 1]) {
        let least_m = match scan.sector(ray + side) {
            Sector::Unknown => 0.15,
            Sector::Hit(hit_m) if hit_m < point.norm() - 0.1 => 0.06,
            _ => 0.0,
        };
        is_whole &= least_m == 0.0;
        if least_m > sigma_m {
            sigma_m = least_m;
        }
    }
    (sigma_m, is_whole)
}
