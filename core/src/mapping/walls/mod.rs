//! Lines of reflection: the straight walls in a bounded map of points.
//!
//! After the belief-space paper (section III): first the points are clustered, so that walls that meet are separate,
//! then a line is fitted to each cluster. The paper clusters with a mixture of Gaussians; here
//!
//! 1. split and merge, for points in the order of a scan, proposes lines;
//! 2. every point is assigned to the nearest proposed line that it is within 0.25 m of;
//! 3. the points of a line are split where a gap is wider than [`Config::gap_m`], and each piece is fitted again;
//! 4. a piece that is too short, too thick for its length or has too few points is not a wall: a pillar is one point,
//!    or several in a round cluster;
//! 5. lines of the same wall are merged.
//!
//! The map stores circles; [`points_of`] takes the point of each that faces the vehicle, in the order of their
//! bearings.
//!
//! Memory: a [`Workspace`] of 1.6 KB, fixed.

use crate::base::sort::sort_by_key;
use heapless::Vec;

use crate::base::error::{ConfigError, check};
use crate::base::math::sqrt;
use crate::base::ned::Horizontal;
use crate::base::obstacle::Disc;

mod fit;
mod split_merge;
pub mod wall;

use fit::{Fit, Moments};
pub use wall::Wall;

/// Largest number of points that are used; the rest of a longer list is ignored.
pub const POINTS_MAX: usize = crate::mapping::map::CIRCLES_MAX;
/// Largest number of walls that are reported; the longest are kept.
pub const WALLS_MAX: usize = 8;
/// Points farther from the origin than this are ignored.
const PLACE_MAX_M: f32 = 1e5;
/// Largest number of lines proposed, and found before they are merged.
const PROPOSED_MAX: usize = 16;

/// Largest distance of a wall's point from its line.
const DEVIATION_M: f32 = 0.25;
/// The largest standard deviation across at which two clusters may be merged.
const JOINED_M: f32 = 0.5 * DEVIATION_M;
/// Smallest number of points of a wall.
const POINTS_MIN: u8 = 4;
/// A wall's largest standard deviation across, as a share of the one along.
const THICKNESS_MAX: f32 = 0.15;
/// Two lines whose directions differ by less may be the same wall,
const SAME_ANGLE_RAD: f32 = 0.15;
/// if the ends of the shorter one are this close to the longer one, and the gap between them is not wider than
/// [`Config::gap_m`].
const SAME_OFFSET_M: f32 = 0.2;

/// What counts as a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Largest distance between a wall's neighbouring points.
    pub gap_m: f32,
    /// Shortest wall.
    pub length_min_m: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Config {
    /// The default, as a constant.
    pub const DEFAULT: Self = Self { gap_m: 1.25, length_min_m: 1.5 };

    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Extractor, ConfigError> {
        check("walls.gap_m", self.gap_m, 0.05, 10.0)?;
        check("walls.length_min_m", self.length_min_m, 0.1, 50.0)?;
        Ok(Extractor { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extractor {
    config: Config,
}

/// Memory for one call; nothing is kept between calls.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// The points, relative to the first.
    points: Vec<Horizontal, POINTS_MAX>,
    /// Index of the proposed line that a point belongs to.
    owners: [u8; POINTS_MAX],
    order: Vec<u8, POINTS_MAX>,
    proposed: Vec<Wall, PROPOSED_MAX>,
}

impl Default for Workspace {
    fn default() -> Self {
        Self::new()
    }
}

impl Workspace {
    /// Empty. All bits are zero, so that it takes no flash.
    #[must_use]
    pub const fn new() -> Self {
        Self { points: Vec::new(), owners: [0; POINTS_MAX], order: Vec::new(), proposed: Vec::new() }
    }
}

/// Proposes the line of a cluster, given by its moments.
fn propose(proposed: &mut Vec<Wall, PROPOSED_MAX>, moments: &Moments) {
    let Some(spread) = moments.spread() else { return };
    // Up to twice as thick as a wall may be: outliers may still be removed.
    let thickest = 2.0 * THICKNESS_MAX;
    if moments.count > 1.5 && spread.across_m2 <= thickest * thickest * spread.along_m2 {
        push_longest(proposed, spread.line_through(moments.mean_ned_m), length_m);
    }
}

/// Appends an item; to a full list in place of the shortest, if it is longer.
fn push_longest<T>(list: &mut Vec<T, PROPOSED_MAX>, item: T, length_m: impl Fn(&T) -> f32) {
    let Err(item) = list.push(item) else { return };
    if let Some(shortest) = list.iter_mut().min_by(|a, b| length_m(a).total_cmp(&length_m(b)))
        && length_m(shortest) < length_m(&item)
    {
        *shortest = item;
    }
}

/// Number of rounds of assigning points to lines and fitting lines to points: outliers are removed, and points that an
/// outlier kept away are added.
const ROUNDS: u8 = 4;
/// The point belongs to no proposed line.
const NONE: u8 = u8::MAX;
/// Not yet assigned.
const UNASKED: u8 = NONE - 1;

impl Extractor {
    /// The walls among points in the order of a scan, the longest first. Points that are not finite, or implausibly far
    /// away, are ignored.
    pub fn find(&self, workspace: &mut Workspace, points_ned_m: &[Horizontal]) -> Vec<Wall, WALLS_MAX> {
        let usable =
            |point: &&Horizontal| libm::fabsf(point.north) <= PLACE_MAX_M && libm::fabsf(point.east) <= PLACE_MAX_M;
        // Relative to one of the points: far from the origin the differences are exact, but computed values would be
        // rounded.
        let origin = points_ned_m.iter().find(usable).copied().unwrap_or_default();
        workspace.points.clear();
        for point in points_ned_m.iter().filter(usable).take(POINTS_MAX) {
            let _ = workspace.points.push(point.minus(origin));
        }
        self.propose_lines(workspace);
        self.walls(workspace, origin)
    }

    /// Proposes lines. Not inlined: what it takes of the stack is given back before walls are looked for.
    #[inline(never)]
    fn propose_lines(&self, workspace: &mut Workspace) {
        workspace.proposed.clear();
        for piece in &split_merge::pieces(self.config.gap_m, &workspace.points) {
            propose(&mut workspace.proposed, &piece.moments);
        }
    }

    /// The walls among the points, which are relative to an origin, from the proposed lines.
    #[inline(never)]
    fn walls(&self, workspace: &mut Workspace, origin: Horizontal) -> Vec<Wall, WALLS_MAX> {
        workspace.owners = [UNASKED; POINTS_MAX];
        let mut found: Vec<Fit, PROPOSED_MAX> = Vec::new();
        for round in 1..=ROUNDS {
            let is_last = !self.share_out(workspace) || round == ROUNDS;
            found.clear();
            for owner in 0..workspace.proposed.len() {
                self.cut(workspace, owner, is_last, &mut found);
            }
            self.merge(&mut found);
            if is_last {
                break;
            }
            workspace.proposed.clear();
            for fit in &found {
                let _ = workspace.proposed.push(fit.line);
            }
        }
        sort_by_key(&mut found, |fit| -length_m(&fit.line));
        let mut lines = Vec::new();
        for fit in found.iter().take(WALLS_MAX) {
            let line = fit.line;
            let (off_m, along_m) = (line.normal_ned.dot(origin), line.along_ned().dot(origin));
            let _ = lines.push(Wall {
                normal_ned: line.normal_ned,
                offset_m: line.offset_m + off_m,
                from_m: line.from_m + along_m,
                to_m: line.to_m + along_m,
            });
        }
        lines
    }

    /// Assigns every point to the nearest proposed line that it may be part of; returns whether that changed anything.
    fn share_out(&self, workspace: &mut Workspace) -> bool {
        let Workspace { points, owners, proposed, .. } = workspace;
        let mut changed = false;
        for (point, owner) in points.iter().zip(owners.iter_mut()) {
            let (mut nearest, mut least) = (NONE, DEVIATION_M);
            for (index, line) in proposed.iter().enumerate() {
                let away_m = libm::fabsf(line.distance_m(*point));
                if !(away_m <= least) {
                    continue;
                }
                let along_m = line.along_ned().dot(*point);
                if along_m >= line.from_m - self.config.gap_m && along_m <= line.to_m + self.config.gap_m {
                    (nearest, least) = (index as u8, away_m);
                }
            }
            changed |= *owner != nearest;
            *owner = nearest;
        }
        changed
    }

    /// Fits the points of a proposed line, piece by piece, and keeps the walls.
    fn cut(&self, workspace: &mut Workspace, owner: usize, is_last: bool, found: &mut Vec<Fit, PROPOSED_MAX>) {
        let Workspace { points, owners, order, proposed, .. } = workspace;
        let Some(along) = proposed.get(owner).map(Wall::along_ned) else { return };
        // The sort keys are computed once.
        let mut places_m = [0.0_f32; POINTS_MAX];
        order.clear();
        let both = points.iter().zip(owners.iter()).zip(&mut places_m).enumerate();
        for (index, ((point, _), place_m)) in both.filter(|(_, ((_, o), _))| usize::from(**o) == owner) {
            *place_m = along.dot(*point);
            let _ = order.push(index as u8);
        }
        let along_m = |index: u8| places_m.get(usize::from(index)).copied().unwrap_or_default();
        sort_by_key(order, |index| along_m(*index));
        let mut from = 0;
        for to in 1..=order.len() {
            if let Some([last, next]) = order.get(to - 1..=to)
                && along_m(*next) - along_m(*last) <= self.config.gap_m
            {
                continue;
            }
            let piece = order.get(from..to).unwrap_or_default().iter();
            let places = piece.filter_map(|index| points.get(usize::from(*index)).copied());
            if let Some(fit) = fit::fit(places).filter(|fit| self.is_wall(fit) || (!is_last && may_be_wall(fit))) {
                push_longest(found, fit, |fit| length_m(&fit.line));
            }
            from = to;
        }
    }

    fn is_wall(&self, fit: &Fit) -> bool {
        fit.moments.count >= f32::from(POINTS_MIN)
            && length_m(&fit.line) >= self.config.length_min_m
            && fit.rms_m <= DEVIATION_M
            && fit.rms_m <= THICKNESS_MAX * fit.along_m
    }

    /// Merges lines of the same wall until there are none left.
    fn merge(&self, found: &mut Vec<Fit, PROPOSED_MAX>) {
        let mut index = 0;
        while let Some((earlier, [fit, ..])) = found.split_at_mut_checked(index) {
            if let Some(other) = earlier.iter_mut().find(|other| self.is_same(other, fit)) {
                *other = joined(other, fit);
                if index < found.len() {
                    found.swap_remove(index);
                }
                // The longer line may match further ones.
                index = 0;
            } else {
                index += 1;
            }
        }
    }

    fn is_same(&self, a: &Fit, b: &Fit) -> bool {
        let (longer, shorter) = if length_m(&a.line) >= length_m(&b.line) { (a, b) } else { (b, a) };
        // In most cases this decides.
        if !(libm::fabsf(longer.line.normal_ned.dot(shorter.line.along_ned())) <= SAME_ANGLE_RAD) {
            return false;
        }
        let ends = shorter.line.ends_ned_m();
        let [from_m, to_m] = ends.map(|end| longer.line.along_ned().dot(end));
        let (from_m, to_m) = if from_m <= to_m { (from_m, to_m) } else { (to_m, from_m) };
        ends.iter().all(|end| libm::fabsf(longer.line.distance_m(*end)) <= SAME_OFFSET_M)
            && from_m - longer.line.to_m <= self.config.gap_m
            && longer.line.from_m - to_m <= self.config.gap_m
    }
}

/// Whether more points might make it a wall.
fn may_be_wall(fit: &Fit) -> bool {
    fit.moments.count >= 3.0 && fit.rms_m <= 2.0 * THICKNESS_MAX * fit.along_m
}

/// Both as one line: the least-squares line of all their points, from the first end to the last.
fn joined(a: &Fit, b: &Fit) -> Fit {
    let both = a.moments.joined(&b.moments);
    let ends = [a.line.ends_ned_m(), b.line.ends_ned_m()];
    both.spread().map_or(*a, |spread| {
        let mut line = spread.line_through(both.mean_ned_m);
        let along = ends.as_flattened().iter().map(|end| line.along_ned().dot(*end));
        (line.from_m, line.to_m) = along.fold((f32::INFINITY, f32::NEG_INFINITY), |(from, to), along_m| {
            (if along_m < from { along_m } else { from }, if along_m > to { along_m } else { to })
        });
        Fit { line, moments: both, rms_m: sqrt(spread.across_m2), along_m: sqrt(spread.along_m2) }
    })
}

fn length_m(line: &Wall) -> f32 {
    line.to_m - line.from_m
}

/// The point of each circle that faces the vehicle, in the order of their bearings from it. For a circle around the
/// vehicle it is the centre; moving circles are left out.
#[must_use]
pub fn points_of<'a>(
    discs: impl IntoIterator<Item = &'a Disc>,
    seen_from_ned_m: Horizontal,
) -> Vec<Horizontal, POINTS_MAX> {
    let mut points: Vec<(f32, Horizontal), POINTS_MAX> = Vec::new();
    for disc in discs {
        if disc.moves || !disc.is_plausible() {
            continue;
        }
        let towards = seen_from_ned_m.minus(disc.center_ned_m);
        let away_m = towards.norm();
        let face = if away_m > disc.radius_m { towards.times(disc.radius_m / away_m) } else { Horizontal::default() };
        let point = disc.center_ned_m.plus(face);
        if points.push((turn(point.minus(seen_from_ned_m)), point)).is_err() {
            break;
        }
    }
    sort_by_key(&mut points, |(turn, _)| *turn);
    let mut ordered = Vec::new();
    for (_, point) in &points {
        let _ = ordered.push(*point);
    }
    ordered
}

/// A number that increases with the bearing, from 0 in the south by 4 in a full turn, without an arctangent.
fn turn(away: Horizontal) -> f32 {
    let sum = libm::fabsf(away.north) + libm::fabsf(away.east);
    let ratio = if sum > 0.0 { away.north / sum } else { 0.0 };
    if away.east < 0.0 { 1.0 + ratio } else { 3.0 - ratio }
}

#[cfg(test)]
mod tests;
