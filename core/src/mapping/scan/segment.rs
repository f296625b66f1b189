//! Converts the hits of a scan to circles: runs of neighbours are cut into pillars and other pieces, and the other
//! pieces become chains.

use heapless::Vec;

use super::chain::{self, Edges};
use super::circle::{self, root};
use super::{
    Detection, FIT_MIN, FITS_MAX, Frame, GAP_M, JUMP_MAX_M, Kind, POINTS_MAX, Points, Pose, RADIUS_DOUBT_MAX,
    RADIUS_MAX_M, RADIUS_MIN_M, RANGE_MAX_M, RAYS_MAX, RESIDUAL_MAX_M, Refusal, Run, SECTORS_MAX, Scan, Sector,
    Sectors, Segmentation, Turned, Verdict, around, is_inside, thin, unit,
};
use crate::base::ned::Horizontal;
use crate::base::sort::sort_by_key;
use crate::base::units::{between, sin_cos, wrap_pi};

/// The hit belongs to the same run as the one after it.
const GOES_ON: u8 = 1;
/// The sensor sees past it, on the side of the hits before it, or of those after it.
const FREE_BEFORE: u8 = 2;
const FREE_BEHIND: u8 = 4;
/// The run was cut after it.
const CUT: u8 = 8;

/// Stands for the range of a sector that sees past the obstacles at its sides.
const PAST: f32 = -1.0;

/// Marks of each hit of a scan.
#[derive(Default)]
struct Marks(Vec<u8, POINTS_MAX>);

impl Marks {
    fn has(&self, at: usize, mark: u8) -> bool {
        self.0.get(at).is_some_and(|marks| marks & mark != 0)
    }

    fn push(&mut self, marks: u8) {
        // Cannot fail: there are as many places as hits.
        let _ = self.0.push(marks);
    }

    fn cut_behind(&mut self, at: usize) {
        if let Some(marks) = self.0.get_mut(at) {
            *marks |= CUT;
        }
    }

    /// Index after the last hit of the piece that begins with hit `from`.
    fn end_of(&self, from: usize, is_last: impl Fn(u8) -> bool) -> usize {
        let rest = self.0.get(from..).unwrap_or_default();
        rest.iter().position(|marks| is_last(*marks)).map_or(self.0.len(), |index| from + index + 1)
    }
}

/// The circles fitted to the hits of a scan taken at `pose`.
///
/// ```
/// use foxhound_core::base::pose::Pose;
/// use foxhound_core::base::time::Instant;
/// use foxhound_core::mapping::scan::{Kind, Scan, Sector, fit};
///
/// // A pillar of 0.2 m, 2 m ahead, and nothing else.
/// let rays = (0..41).map(|ray| {
///     let azimuth_rad = 0.02 * ray as f32 - 0.4;
///     let (along, across) = (2.0 * libm::cosf(azimuth_rad), 2.0 * libm::sinf(azimuth_rad));
///     let inside = 0.04 - across * across;
///     if inside > 0.0 { Sector::Hit(along - libm::sqrtf(inside)) } else { Sector::Clear }
/// });
/// let time = Instant(0);
/// let scan = Scan { time, turn_s: 0.0, first_azimuth_rad: -0.4, step_rad: 0.02, range_max_m: 3.0, rays: rays.collect() };
/// let found = fit(&scan, &Pose::default()).unwrap_or_default();
/// assert_eq!(found.detections.len(), 1);
/// let pillar = found.detections[0];
/// assert_eq!(pillar.kind, Kind::Pillar);
/// assert!((pillar.center_ned_m.north - 2.0).abs() < 0.02 && (pillar.radius_m - 0.2).abs() < 0.02);
/// ```
///
/// # Errors
/// Why it is refused.
pub fn fit(scan: &Scan, pose: &Pose) -> Result<Segmentation, Refusal> {
    let mut segmentation = Segmentation::default();
    fit_into(&mut segmentation, scan, pose, Horizontal::default())?;
    Ok(segmentation)
}

/// As [`fit`], from a vehicle of a velocity, into an empty segmentation in place: it takes 3 KB, and a copy of it would take another 3.
///
/// # Errors
/// Why it is refused.
#[inline(never)]
pub fn fit_into(
    segmentation: &mut Segmentation,
    scan: &Scan,
    pose: &Pose,
    velocity_ned_mps: Horizontal,
) -> Result<(), Refusal> {
    if !scan.is_plausible() {
        return Err(Refusal::Geometry);
    }
    if !pose.is_plausible() {
        return Err(Refusal::NoOwnship);
    }
    (segmentation.time, segmentation.origin_ned_m) = (scan.time, pose.position_ned_m);
    segmentation.slip_m = 0.5 * libm::fabsf(scan.turn_s) * velocity_ned_mps.norm();
    let sectors = scan.in_sectors(SECTORS_MAX);
    segmentation.beside_rad = if sectors.is_exact() { 0.0 } else { sectors.outermost_ray() * sectors.step_rad };
    let mut marks = Marks::default();
    trace(scan, &sectors, pose, velocity_ned_mps, segmentation, &mut marks);
    segmentation.check()?;
    segment(segmentation, &mut marks, sectors.step_rad, sectors.outermost_ray());
    Ok(())
}

/// The circles fitted to single hits seen from `pose`, into an empty segmentation.
///
/// # Errors
/// Why they are refused.
#[inline(never)]
pub fn fit_points_into(segmentation: &mut Segmentation, points: &Points, pose: &Pose) -> Result<(), Refusal> {
    if !pose.is_plausible() {
        return Err(Refusal::NoOwnship);
    }
    (segmentation.time, segmentation.origin_ned_m) = (points.time, pose.position_ned_m);
    gather(points, pose, segmentation);
    segmentation.check()?;
    let mut marks = Marks::default();
    put_in_order(segmentation, &mut marks);
    segment(segmentation, &mut marks, 0.0, 0.0);
    Ok(())
}

/// Collects the hits of a scan, with marks of what is beside them.
#[inline(never)]
fn trace(
    scan: &Scan,
    sectors: &Sectors<'_>,
    pose: &Pose,
    velocity_ned_mps: Horizontal,
    segmentation: &mut Segmentation,
    marks: &mut Marks,
) {
    let step_rad = libm::fabsf(sectors.step_rad);
    let continues = |before: f32, range_m: f32| {
        let nearer = if range_m < before { range_m } else { before };
        let explained = GAP_M + 3.0 * nearer * step_rad;
        let allowed = if explained < JUMP_MAX_M { explained } else { JUMP_MAX_M };
        before > 0.0 && range_m > 0.0 && libm::fabsf(range_m - before) < allowed
    };
    // Ranges: zero where there is no hit, and [`PAST`] where the sensor sees past. Offsets: the hit's angle in its
    // sector.
    let (mut ranges_m, mut offsets_rad) = ([0.0_f32; SECTORS_MAX], [0.0_f32; SECTORS_MAX]);
    for (index, (range_m, offset_rad)) in ranges_m.iter_mut().zip(&mut offsets_rad).enumerate() {
        let (sector, offset) = sectors.nearest(index);
        (*range_m, *offset_rad) = match sector {
            Sector::Hit(hit_m) if hit_m > 0.0 && hit_m <= scan.range_max_m => (hit_m, offset * scan.step_rad),
            Sector::Hit(hit_m) => {
                segmentation.refused += 1;
                (if hit_m > scan.range_max_m { PAST } else { 0.0 }, 0.0)
            }
            Sector::Clear => (PAST, 0.0),
            Sector::Unknown => (0.0, 0.0),
        };
    }
    // A full turn is processed from a gap between runs, so that no run is cut at the seam.
    let turn = sectors.turn();
    let count = turn.unwrap_or(SECTORS_MAX).min(SECTORS_MAX);
    let range_at = |index: usize| ranges_m.get(index).copied().unwrap_or_default();
    let before = |index: usize| if index == 0 { count - 1 } else { index - 1 };
    let seam = |index: &usize| !continues(range_at(before(*index)), range_at(*index));
    let begin = if turn.is_some() { (0..count).find(seam).unwrap_or(0) } else { 0 };

    let turned = Turned::new(sectors.step_rad);
    let start = Horizontal::from_bearing(pose.yaw_rad + sectors.first_azimuth_rad);
    let mut direction =
        Horizontal::from_bearing(pose.yaw_rad + sectors.first_azimuth_rad + sectors.step_rad * begin as f32);
    // An obstacle's outline ends there, unless something nearer hides it or the sector is unknown.
    let is_free = |index: usize, edge_m: f32| range_at(index) > edge_m || range_at(index) == PAST;
    let outermost_rad = between(segmentation.beside_rad, -0.1, 0.1);
    let mut index = begin;
    for left in (0..count).rev() {
        let range_m = range_at(index);
        // The last sector is the first one's neighbour in a full turn only.
        let beside = |at: usize, is_next: bool| {
            let is_neighbour = turn.is_some() || (if is_next { at > 0 } else { index > 0 });
            if is_neighbour && continues(range_at(at), range_m) { range_at(at) } else { 0.0 }
        };
        let next = if index + 1 == count { 0 } else { index + 1 };
        if range_m > 0.0 {
            let goes_on = left > 0 && (turn.is_some() || next > 0) && continues(range_m, range_at(next));
            let mut its = if goes_on { GOES_ON } else { 0 };
            if (turn.is_some() || index > 0) && is_free(before(index), range_m) {
                its |= FREE_BEFORE;
            }
            if (turn.is_some() || next > 0) && is_free(next, range_m) {
                its |= FREE_BEHIND;
            }
            // Cannot fail: there are as many places as sectors.
            let side = nearer_side(beside(before(index), false), range_m, beside(next, true));
            let offset_rad = offsets_rad.get(index).copied().unwrap_or_default();
            let aside_rad = if sectors.is_exact() { between(offset_rad, -0.1, 0.1) } else { side * outermost_rad };
            let from = velocity_ned_mps.times(scan.after_s(sectors.middle_ray(index)));
            let _ = segmentation.points_m.push(turned_a_little(direction, aside_rad).times(range_m).plus(from));
            if outermost_rad != 0.0 {
                let _ = segmentation.sides.push((100.0 * side) as i8);
            }
            marks.push(its);
        }
        direction = if next == 0 { start } else { turned.on(direction) };
        index = next;
    }
}

/// Sorts single hits by azimuth, beginning where two neighbours are far apart.
#[inline(never)]
fn put_in_order(segmentation: &mut Segmentation, marks: &mut Marks) {
    let points_m = &mut segmentation.points_m;
    let mut keyed: Vec<(f32, Horizontal), POINTS_MAX> = Vec::new();
    for point in points_m.iter() {
        // Cannot fail: there are as many places.
        let _ = keyed.push((around(*point), *point));
    }
    sort_by_key(&mut keyed, |(around, _)| *around);
    for (point, (_, sorted)) in points_m.iter_mut().zip(&keyed) {
        *point = *sorted;
    }
    let apart = |a: &Horizontal, b: &Horizontal| {
        let limit = 2.0 * GAP_M;
        a.minus(*b).norm_squared() >= limit * limit
    };
    let seam = match (points_m.first(), points_m.last()) {
        (Some(first), Some(last)) if !apart(first, last) => {
            points_m.windows(2).position(|pair| apart(&pair[0], &pair[1])).map_or(0, |index| index + 1)
        }
        _ => 0,
    };
    let count = points_m.len();
    points_m.rotate_left(seam.min(count));
    for index in 0..count {
        let goes_on = match points_m.get(index..index + 2) {
            Some([a, b]) => !apart(a, b),
            _ => false,
        };
        marks.push(if goes_on { GOES_ON } else { 0 });
    }
}

/// Converts runs of hits to circles, local NED: pillars first, then the chains of the rest.
#[inline(never)]
fn segment(segmentation: &mut Segmentation, marks: &mut Marks, step_rad: f32, outermost_ray: f32) {
    let mut chains: Vec<(u8, u8), POINTS_MAX> = Vec::new();
    let mut fits_left = FITS_MAX;
    let mut first = 0;
    while first < segmentation.points_m.len() {
        let end = marks.end_of(first, |marks| marks & GOES_ON == 0);
        let mut from = first;
        while from < end {
            // Each cut shortens the pieces, so this ends.
            let to = marks.end_of(from, |marks| marks & CUT != 0).min(end);
            match judge(
                &segmentation.points_m,
                marks,
                (first, end),
                (from, to),
                (step_rad, outermost_ray),
                &mut fits_left,
            ) {
                Verdict::Cut(at) => {
                    marks.cut_behind(from + at - 1);
                    continue;
                }
                Verdict::Pillar(pillar) => segmentation.push(pillar),
                // Cannot fail: there are at most as many chains as hits.
                Verdict::Chain => _ = chains.push((from as u8, to as u8)),
            }
            from = to;
        }
        first = end;
    }
    let doubt_rad = libm::fabsf(step_rad) * (0.5 - outermost_ray);
    for (from, to) in chains {
        chain(segmentation, marks, (from.into(), to.into()), doubt_rad);
    }
}

/// Classifies a piece of a run.
fn judge(
    points_m: &[Horizontal],
    marks: &Marks,
    (first, end): (usize, usize),
    (from, to): (usize, usize),
    (step_rad, outermost_ray): (f32, f32),
    fits_left: &mut usize,
) -> Verdict {
    let turned = Turned::new(step_rad);
    let edge = |at: usize, mark: u8| points_m.get(at).copied().filter(|_| marks.has(at, mark)).map(unit);
    let free = [
        edge(from, FREE_BEFORE).filter(|_| from == first).map(|direction| turned.back(direction)),
        edge(to - 1, FREE_BEHIND).filter(|_| to == end).map(|direction| turned.on(direction)),
    ];
    let points = points_m.get(from..to).unwrap_or_default();
    let piece = Run { points, first: from, step_rad: libm::fabsf(step_rad), outermost_ray, free };
    let length = to - from;
    // A piece that was cut many times is not a pillar.
    match fits_left.checked_sub(length) {
        Some(left) if length >= FIT_MIN => {
            *fits_left = left;
            pillar(&piece)
        }
        Some(_) if length == end - first => thin(&piece),
        _ => Verdict::Chain,
    }
}

/// Adds the links of a chain, up to the next piece, so that no gap is left between them.
fn chain(segmentation: &mut Segmentation, marks: &Marks, (from, to): (usize, usize), doubt_rad: f32) {
    let is_cut = marks.has(to - 1, GOES_ON);
    let is_begun = from > 0 && marks.has(from - 1, GOES_ON);
    let edges =
        Edges { first: !is_begun && marks.has(from, FREE_BEFORE), last: !is_cut && marks.has(to - 1, FREE_BEHIND) };
    let mut at = 0;
    loop {
        let points = segmentation.points_m.get(from..to + usize::from(is_cut)).unwrap_or_default();
        // Largest distance of a hit beside its estimated position.
        let doubt_m = points.first().map_or(0.0, |point| doubt_rad * root(point.norm_squared()));
        let radius_min_m = between(doubt_m, RADIUS_MIN_M, RADIUS_MAX_M);
        let Some(link) = chain::next(points, edges, radius_min_m, at) else { return };
        let last = link.to - 1;
        // A chain of a single hit ends with it; a chain that reaches the next piece's first hit ends there.
        let is_over = last + 1 >= points.len();
        segmentation.push(Detection {
            kind: Kind::Patch,
            center_ned_m: link.center,
            radius_m: link.radius_m,
            sigma_m: 0.01,
            face_ned_m: link.face,
            from: (from + link.from) as u8,
            to: (from + link.to) as u8,
        });
        if is_over {
            return;
        }
        at = last;
    }
}

/// Whether a piece is a pillar, or where to cut it, or neither.
fn pillar(piece: &Run<'_>) -> Verdict {
    let points = piece.points;
    let Some(found) = circle::fit(points) else { return Verdict::Chain };
    if found.residual_m > RESIDUAL_MAX_M {
        return Verdict::Cut(found.worst.clamp(2, points.len() - 2));
    }
    let Some(&middle) = points.get(points.len() / 2) else { return Verdict::Chain };
    let is_round = found.center.minus(middle).dot(middle) > 0.0
        && found.radius_m <= RADIUS_MAX_M
        && found.sigma_m <= RADIUS_DOUBT_MAX * found.radius_m
        && is_inside(found.center, found.radius_m, piece.free);
    if !is_round {
        return Verdict::Chain;
    }
    let radius_m = if found.radius_m < RADIUS_MIN_M { RADIUS_MIN_M } else { found.radius_m };
    piece.pillar(found.center, radius_m, found.sigma_m)
}

impl Scan {
    /// The hits of all rays, north and east of where the sensor was at the scan's time, in order; a full turn begins at a gap.
    #[inline(never)]
    pub fn hits_into(&self, hits: &mut Vec<Horizontal, RAYS_MAX>, yaw_rad: f32, velocity_ned_mps: Horizontal) {
        // A turn during which the vehicle yawed along has more rays than a turn needs: the last see what the first saw.
        let turn = self.turn();
        let count = turn.unwrap_or(self.rays.len());
        let range_m = |index: usize| match self.rays.get(index) {
            Sector::Hit(range_m) if range_m > 0.0 && range_m <= self.range_max_m => range_m,
            _ => 0.0,
        };
        let before = |index: usize| if index == 0 { count.wrapping_sub(1) } else { index - 1 };
        let is_seam = |index: &usize| libm::fabsf(range_m(*index) - range_m(before(*index))) > JUMP_MAX_M;
        let begin = if turn.is_some() { (0..count).find(is_seam).unwrap_or(0) } else { 0 };
        let turned = Turned::new(self.step_rad);
        let towards = |index: usize| {
            Horizontal::from_bearing(wrap_pi(yaw_rad + self.first_azimuth_rad + self.step_rad * index as f32))
        };
        let mut direction = towards(begin);
        for index in (begin..count).chain(0..begin) {
            if index == 0 {
                direction = towards(0);
            }
            let range_m = range_m(index);
            if range_m > 0.0 {
                // Cannot fail: there are as many places as rays.
                let from = velocity_ned_mps.times(self.after_s(index as f32));
                let _ = hits.push(direction.times(range_m).plus(from));
            }
            direction = turned.on(direction);
        }
    }
}

/// On which side of its sector the nearest hit lies, from -1 (towards the sector before) to 1 (towards the next). Where
/// a surface comes nearer from sector to sector, it is the nearer side; where the surface is nearest, a parabola
/// through the ranges gives it. A neighbour's range is 0 if the surface does not continue there.
fn nearer_side(before_m: f32, range_m: f32, next_m: f32) -> f32 {
    let goes_on = (before_m > 0.0, next_m > 0.0);
    match (goes_on.0 && before_m < range_m, goes_on.1 && next_m < range_m) {
        (true, false) => -1.0,
        (false, true) => 1.0,
        (false, false) if goes_on == (true, true) => {
            let (before, next) = (root(before_m - range_m), root(next_m - range_m));
            if before + next > 0.0 { (before - next) / (before + next) } else { 0.0 }
        }
        _ => 0.0,
    }
}

/// A direction, turned clockwise by a few degrees at most.
fn turned_a_little(direction: Horizontal, angle_rad: f32) -> Horizontal {
    let right = Horizontal { north: -direction.east, east: direction.north };
    direction.times(1.0 - 0.5 * angle_rad * angle_rad).plus(right.times(angle_rad))
}

/// Single hits relative to the sensor; those that are not finite or implausible are left out and counted as refused.
fn gather(points: &Points, pose: &Pose, segmentation: &mut Segmentation) {
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
            // Cannot fail: there are as many places.
            let _ = segmentation.points_m.push(point);
        } else {
            segmentation.refused += 1;
        }
    }
}
