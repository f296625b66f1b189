//! How a detected circle becomes part of the store, and how the store is checked against a scan.
//!
//! A detection is compared with every known circle near it ([`Index`]). Which of its hits those circles cover is
//! recorded. Then it is averaged into the known pillar that it matches, or added if some of it is not covered yet.

use heapless::Vec;

use super::index::Index;
use super::{
    AVERAGED, CLEAR, COVER_M, DOOMED, FRONT_M, GATE, GATE_M, Known, Map, Origin, RIM_M, SEEN_THROUGH, STICK_OUT_M,
    known_of,
};
use crate::base::math::inverse_root;
use crate::base::ned::Horizontal;
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::base::units::{between, whole_below, wrap_pi};
use crate::mapping::scan::{Detection, Kind, POINTS_MAX, RAYS_MAX, Scan, Sector, Segmentation};

/// Largest number of pillars that are checked again after the detected one has been averaged.
const MET_MAX: usize = 4;
/// No hit sticks out of the circle of its detection by more than this.
const OUT_M: f32 = 0.03;
/// Largest distance beside its hits within which known circles may cover a patch, however wide the sectors are.
const BESIDE_MAX_M: f32 = 0.10;
/// Hits nearer than this must be covered where they were measured: the vehicle may be about to pass them.
pub(super) const BESIDE_FROM_M: f32 = 1.0;

/// One bit per hit.
#[derive(Clone, Copy, Debug, Default)]
struct Bits([u32; POINTS_MAX.div_ceil(32)]);

impl Bits {
    fn has(&self, index: usize) -> bool {
        self.0.get(index / 32).is_some_and(|word| word >> (index % 32) & 1 != 0)
    }

    fn set(&mut self, index: usize) {
        if let Some(word) = self.0.get_mut(index / 32) {
            *word |= 1 << (index % 32);
        }
    }

    fn has_first(&self, count: usize) -> bool {
        (0..count).all(|index| self.has(index))
    }
}

/// The hits of a detection, relative to the sensor, and which of them are in a known circle or close to one.
struct Covered<'a> {
    points_m: &'a [Horizontal],
    face_m: Horizontal,
    /// Direction of the hits, the largest distance of each from the middle of its sector, and its estimated distance
    /// from there.
    toward: Horizontal,
    beside_m: f32,
    sides: &'a [i8],
    all: Bits,
    /// The hits in a pillar or in a delivered circle.
    by_round: Bits,
    is_face: bool,
}

impl Covered<'_> {
    /// Records which hits a circle covers; `center_m` is its centre relative to the sensor.
    fn mark(&mut self, known: &Known, center_m: Horizontal) {
        let reach_m = known.radius_m + COVER_M;
        let covers = |point: Horizontal| point.minus(center_m).norm_squared() <= reach_m * reach_m;
        let is_round = known.is_round();
        for (index, point) in self.points_m.iter().enumerate().take(POINTS_MAX) {
            let noted = if is_round { &self.by_round } else { &self.all };
            if !noted.has(index) && covers(*point) {
                self.note(index, is_round);
            }
        }
        self.is_face = self.is_face || covers(self.face_m);
        if self.beside_m != 0.0 {
            self.mark_beside(known, center_m);
        }
    }

    /// Whether circles cover all of a patch.
    fn is_whole(&self) -> bool {
        self.is_face && self.all.has_first(self.points_m.len())
    }

    fn note(&mut self, index: usize, is_round: bool) {
        self.all.set(index);
        if is_round {
            self.by_round.set(index);
        }
    }

    /// The same for hits that may lie elsewhere in their sector, at the same range.
    #[inline(never)]
    fn mark_beside(&mut self, known: &Known, center_m: Horizontal) {
        // Half of the margin allows for the arc, which is approximated by a straight line.
        let reach_m = known.radius_m + 0.5 * COVER_M;
        let toward = self.toward;
        let beside_m = self.beside_m;
        let covers = |point: Horizontal, side: i8| {
            let away = point.minus(center_m);
            let along_m = away.dot(toward);
            let left = reach_m * reach_m - along_m * along_m;
            if left < 0.0 {
                return false;
            }
            let side = 0.01 * f32::from(side);
            let (back_m, on_m) = (beside_m * (-1.0 - side), beside_m * (1.0 - side));
            let (least_m, most_m) = if back_m < on_m { (back_m, on_m) } else { (on_m, back_m) };
            let across_m = toward.north * away.east - toward.east * away.north;
            let across_m =
                across_m + between(-across_m, between(least_m, -BESIDE_MAX_M, 0.0), between(most_m, 0.0, BESIDE_MAX_M));
            across_m * across_m <= left
        };
        for (index, (point, side)) in self.points_m.iter().zip(self.sides).enumerate() {
            if covers(*point, *side) {
                self.note(index, known.is_round());
            }
        }
        self.is_face = self.is_face || self.sides.first().is_some_and(|side| covers(self.face_m, *side));
    }
}

/// A scan, to look up the sector in a direction.
struct View<'a> {
    scan: &'a Scan,
    origin_ned_m: Horizontal,
    /// Azimuth of the middle of the first sector, from north.
    first_ned_rad: f32,
    /// Number of rays if the scan is a full turn.
    turn: Option<i32>,
    /// See [`Sectors::outermost_ray`](crate::mapping::scan::Sectors::outermost_ray).
    outermost_ray: f32,
    /// How far a range may be off, see [`Segmentation::slip_m`].
    slip_m: f32,
    /// What a ray that sees nothing counts.
    nothing: u8,
}

impl View<'_> {
    /// Whether the sensor sees something behind a circle, or nothing at its position, and what that counts.
    fn passes(&self, known: &Known, away: Horizontal, distance_m: f32) -> u8 {
        let mut middle = wrap_pi(away.bearing_rad() - self.first_ned_rad) / self.scan.step_rad;
        // A scan of more than half a turn continues beyond the wrap.
        if middle < -0.5 {
            middle += core::f32::consts::TAU / libm::fabsf(self.scan.step_rad);
        }
        // A hit nearer than this is on the circle or in front of it.
        let (front_m, side_m) = if known.origin == Origin::Given {
            (distance_m + known.radius_m + self.slip_m + 0.1, f32::INFINITY)
        } else {
            (distance_m - known.radius_m + self.slip_m + FRONT_M, distance_m + self.slip_m + 0.05)
        };
        let through = self.passes_sector(whole_below(middle + 0.5), front_m);
        if through == SEEN_THROUGH || known.origin == Origin::Given || known.radius_m <= RIM_M {
            return through;
        }
        // The outermost rays that should have hit it, with a lower bound of the arcsine.
        let x = (known.radius_m - RIM_M) / distance_m;
        let reach = x * (1.0 + x * x / 6.0) / libm::fabsf(self.scan.step_rad) + self.outermost_ray;
        let (low, high) = (-whole_below(reach - middle), whole_below(middle + reach));
        if low > high {
            return through;
        }
        through.max(self.passes_sector(low, side_m)).max(self.passes_sector(high, side_m))
    }

    fn passes_sector(&self, index: i32, limit_m: f32) -> u8 {
        let index = match self.turn {
            Some(turn) if index < 0 => index + turn,
            Some(turn) if index >= turn => index - turn,
            _ => index,
        };
        match usize::try_from(index).map_or(Sector::Unknown, |index| self.scan.rays.get(index)) {
            Sector::Clear => self.nothing,
            Sector::Hit(hit_m) if hit_m > limit_m && hit_m <= self.scan.range_max_m => SEEN_THROUGH,
            Sector::Hit(_) | Sector::Unknown => 0,
        }
    }
}

impl Map {
    /// Merges a detection of a scan into the store.
    pub(super) fn absorb(&mut self, index: &mut Index, now: Instant, segmentation: &Segmentation, seen: &Detection) {
        let origin = segmentation.origin_ned_m;
        let center = seen.center_ned_m.minus(origin);
        let face_m = seen.face_ned_m.minus(origin);
        let (toward, beside_m) = beside(segmentation, seen, face_m);
        let mut covered = Covered {
            points_m: segmentation.points_of(seen),
            face_m,
            toward,
            beside_m,
            sides: segmentation.sides.get(usize::from(seen.from)..usize::from(seen.to)).unwrap_or_default(),
            all: Bits::default(),
            by_round: Bits::default(),
            // The face of a single hit is the hit itself.
            is_face: seen.to <= seen.from + 1,
        };
        let beyond_m = seen.radius_m + if COVER_M + OUT_M > GATE_M { COVER_M + OUT_M } else { GATE_M };
        // Pillars that it may match, and the nearest of them.
        let mut met: Vec<u8, MET_MAX> = Vec::new();
        let mut nearest: Option<(usize, f32)> = None;
        for at in index.near(seen.center_ned_m, beyond_m) {
            let Some(known) = self.known.get_mut(at) else { continue };
            let away = known.center_ned_m.minus(origin);
            let squared = away.minus(center).norm_squared();
            let reach_m = known.radius_m + beyond_m;
            if squared > reach_m * reach_m {
                continue;
            }
            if seen.kind == Kind::Pillar {
                if !known.is_round() {
                    let inside_m = seen.radius_m + STICK_OUT_M - known.radius_m;
                    if inside_m > 0.0 && squared < inside_m * inside_m {
                        known.clear_scans = DOOMED;
                        index.doom(at);
                        continue;
                    }
                } else if known.clear_scans != AVERAGED && is_gated(known, seen, squared) && met.push(at as u8).is_ok()
                {
                    // Its coverage is counted later, when the matching pillar is known.
                    if nearest.is_none_or(|(_, least)| squared < least) {
                        nearest = Some((at, squared));
                    }
                    continue;
                }
            }
            covered.mark(known, away);
            if seen.kind == Kind::Patch && covered.is_whole() {
                break;
            }
        }
        if let Some((at, _)) = nearest
            && let Some(known) = self.known.get_mut(at)
        {
            known.refine(now, seen, covered.points_m, origin);
            index.place(at, known);
        }
        let best = nearest.and_then(|(at, _)| self.known.get(at)).copied();
        for at in met {
            let Some(known) = self.known.get_mut(usize::from(at)) else { continue };
            if best.is_some_and(|best| is_within(known, &best)) {
                known.clear_scans = DOOMED;
                index.doom(usize::from(at));
            } else {
                covered.mark(known, known.center_ned_m.minus(origin));
            }
        }
        let count = covered.points_m.len();
        let is_covered = match seen.kind {
            // The edge of a pillar at the edge of the view looks like a thin pillar of its own, and an average can
            // shift a pillar off the hits of a neighbour.
            Kind::Pillar if nearest.is_none() => covered.by_round.has_first(count),
            Kind::Pillar => covered.all.has_first(count),
            Kind::Patch => covered.is_whole(),
        };
        if !is_covered && let Some(known) = known_of(now, seen) {
            self.add(index, known);
        }
    }

    /// Counts, for every circle within the range of a scan, the scans in a row that see through it, and marks those
    /// with too many to be forgotten.
    pub(super) fn judge(&mut self, scan: &Scan, pose: &Pose, slip_m: f32, loses_rays: bool) {
        let view = View {
            scan,
            origin_ned_m: pose.position_ned_m,
            first_ned_rad: pose.yaw_rad + scan.first_azimuth_rad,
            turn: scan.turn().map(|turn| turn as i32),
            outermost_ray: scan.in_sectors(RAYS_MAX).outermost_ray(),
            slip_m,
            nothing: if loses_rays { SEEN_THROUGH / 2 } else { SEEN_THROUGH },
        };
        for known in &mut self.known {
            let away = known.center_ned_m.minus(view.origin_ned_m);
            let squared = away.norm_squared();
            let range_max_m = scan.range_max_m;
            if squared < known.radius_m * known.radius_m || squared > range_max_m * range_max_m {
                continue;
            }
            let passes = view.passes(known, away, squared * inverse_root(squared));
            known.clear_scans = if passes == 0 { 0 } else { known.clear_scans.saturating_add(passes) };
            if known.clear_scans >= CLEAR {
                known.clear_scans = DOOMED;
            }
        }
    }
}

/// The direction of a patch's hits, and how far from the middles of their sectors they may be: each is the nearest of
/// several rays, and which one is unknown. (A pillar is fitted to the estimated positions of its hits.)
fn beside(segmentation: &Segmentation, seen: &Detection, face_m: Horizontal) -> (Horizontal, f32) {
    let is_far = |point: &Horizontal| point.norm_squared() > BESIDE_FROM_M * BESIDE_FROM_M;
    if segmentation.beside_rad == 0.0 || seen.kind == Kind::Pillar || !segmentation.points_of(seen).iter().all(is_far) {
        return (Horizontal::default(), 0.0);
    }
    let (squared, inverse) = (face_m.norm_squared(), inverse_root(face_m.norm_squared()));
    (face_m.times(inverse), segmentation.beside_rad * squared * inverse)
}

/// Whether a known pillar may be the detected one.
fn is_gated(known: &Known, seen: &Detection, squared: f32) -> bool {
    let larger_m = if known.radius_m > seen.radius_m { known.radius_m } else { seen.radius_m };
    let doubt_m = 2.0 * (known.sigma_m + seen.sigma_m);
    let gate_m = GATE * larger_m + if doubt_m < GATE_M { doubt_m } else { GATE_M };
    squared < gate_m * gate_m
}

/// Whether a known pillar is a worse measurement of another one. Seen from a distance its radius is uncertain and its
/// sigma large; and no scan would remove it, because the sensor cannot see through a circle inside a real pillar.
fn is_within(known: &Known, best: &Known) -> bool {
    let inside_m = best.radius_m + STICK_OUT_M - known.radius_m;
    let squared = known.center_ned_m.minus(best.center_ned_m).norm_squared();
    known.sigma_m > best.sigma_m && inside_m > 0.0 && squared < inside_m * inside_m
}
