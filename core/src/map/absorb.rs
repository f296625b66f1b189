//! How one circle seen becomes part of the store, and how the store is held against a scan; each a piece at a time.
//!
//! A detection meets every known circle once. What is far from it is passed over, what covers its hits is noted, and then
//! it is averaged into the pillar that it is, or added where something of it is not covered yet.

use heapless::Vec;

use super::{AVERAGED, CIRCLES_MAX, DOOMED, FRONT_M, GATE, GATE_M, Keeper, Known, Map, Origin, RIM_M, STICK_OUT_M};
use crate::field::inverse_root;
use crate::frame::Horizontal;
use crate::scan::{Detection, Kind, POINTS_MAX, Ranges};
use crate::time::Instant;
use crate::units::wrap_pi;
use crate::work::Work;

/// So many circles at most are asked after one scan whether they are seen through; the others have their turn after the
/// next.
const JUDGED_MAX: u8 = 32;
/// So many pillars at most are looked at again when the one that was seen has been averaged.
const MET_MAX: usize = 4;
/// No hit sticks out of the circle of its detection by more than this.
const OUT_M: f32 = 0.03;

/// Prices, in instructions: of a circle that is far from the detection, and of one that is not, with each hit; of the end of
/// it; of an average, with each hit; of looking through the whole store; of a circle that may be seen through.
const FAR: u32 = 12;
const MEET: u32 = 70;
const MEET_HIT: u32 = 15;
const END: u32 = 350;
const AVERAGE: u32 = 600;
const AVERAGE_HIT: u32 = 75;
const WHOLE: u32 = 2_000;
const JUDGED: u32 = 400;

/// The hits behind a look.
#[derive(Clone, Copy, Debug)]
pub struct Hits<'a> {
    /// When they were measured, for all that is known.
    pub now: Instant,
    /// Where they were seen from, local NED.
    pub origin_ned_m: Horizontal,
    /// Those of the detection, from there.
    pub points_m: &'a [Horizontal],
}

/// A bit for each hit.
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

/// A detection on its way into the store.
#[derive(Clone, Debug, Default)]
pub struct Absorption {
    seen: Option<Detection>,
    /// The known circle that it meets next.
    next: u8,
    /// The store's, when it was begun.
    generation: u16,
    /// A bit for each of its hits: it is in a known circle or close to one; in a pillar or a circle that was delivered.
    covered: Bits,
    by_round: Bits,
    is_face_covered: bool,
    /// Pillars that it may be, and the nearest of them.
    met: Vec<u8, MET_MAX>,
    nearest: Option<(u8, f32)>,
    dooms: bool,
}

impl Absorption {
    /// A detection that has met nothing yet.
    #[must_use]
    pub fn of(seen: Detection) -> Self {
        Self { seen: Some(seen), ..Self::default() }
    }

    /// Whether there is nothing under way.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.seen.is_none()
    }

    /// The detection under way.
    #[must_use]
    pub fn seen(&self) -> Option<&Detection> {
        self.seen.as_ref()
    }

    /// Notes what a circle covers.
    fn mark(
        &mut self,
        known: &Known,
        center_m: Horizontal,
        face_m: Horizontal,
        points_m: &[Horizontal],
        margin_m: f32,
    ) {
        let reach_m = known.radius_m + margin_m;
        let covers = |point: Horizontal| point.minus(center_m).norm_squared() <= reach_m * reach_m;
        let is_round = known.is_round();
        for (index, point) in points_m.iter().enumerate().take(POINTS_MAX) {
            let noted = if is_round { &self.by_round } else { &self.covered };
            if !noted.has(index) && covers(*point) {
                self.covered.set(index);
                if is_round {
                    self.by_round.set(index);
                }
            }
        }
        self.is_face_covered |= covers(face_m);
    }
}

/// A scan as one asks it what lies in a direction.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Where it was taken from.
    pub origin_ned_m: Horizontal,
    /// From north to the middle of the first sector.
    pub first_ned_rad: f32,
    /// From a sector to the next.
    pub step_rad: f32,
    /// How far it sees.
    pub range_max_m: f32,
    /// Sectors of a full turn, if it is one.
    pub turn: Option<u8>,
    /// How far each sector sees.
    pub ranges: &'a Ranges,
}

/// How many circles a scan has been asked about; none while there is nothing to ask.
#[derive(Clone, Copy, Debug, Default)]
pub struct Judging {
    judged: Option<u8>,
    /// The circle that is next.
    at: u8,
}

impl Judging {
    /// With a new scan.
    #[must_use]
    pub const fn begin() -> Self {
        Self { judged: Some(0), at: 0 }
    }

    /// Whether nothing is left to ask.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        self.judged.is_none()
    }
}

impl View<'_> {
    /// Whether the sensor sees something behind a circle, or nothing where it stands.
    fn passes(&self, known: &Known, away: Horizontal, distance_m: f32) -> bool {
        let turn = self.turn.map_or(0.0, f32::from);
        let mut middle = wrap_pi(away.bearing_rad() - self.first_ned_rad) / self.step_rad;
        if turn > 0.0 && middle < -0.5 {
            middle += turn;
        }
        // Nearer than this, a hit is the circle's or in front of it.
        let (front_m, side_m) = if known.origin == Origin::Given {
            (distance_m + known.radius_m + 0.1, f32::INFINITY)
        } else {
            (distance_m - known.radius_m + FRONT_M, distance_m + 0.05)
        };
        if self.passes_sector(libm::floorf(middle + 0.5) as i32, front_m) {
            return true;
        }
        if known.origin == Origin::Given || known.radius_m <= RIM_M {
            return false;
        }
        // The outermost rays that should have met it; the arcsine from below.
        let x = (known.radius_m - RIM_M) / distance_m;
        let reach = x * (1.0 + x * x / 6.0) / libm::fabsf(self.step_rad);
        let (low, high) = (libm::ceilf(middle - reach), libm::floorf(middle + reach));
        low <= high && (self.passes_sector(low as i32, side_m) || self.passes_sector(high as i32, side_m))
    }

    fn passes_sector(&self, index: i32, limit_m: f32) -> bool {
        let index = match self.turn.map(i32::from) {
            Some(turn) if index < 0 => index + turn,
            Some(turn) if index >= turn => index - turn,
            _ => index,
        };
        usize::try_from(index).is_ok_and(|index| self.ranges.sees_m(index, f32::INFINITY) > limit_m)
    }
}

impl Keeper {
    /// Takes a detection in as far as there is time; true when it is done with.
    pub fn absorb(&self, map: &mut Map, absorption: &mut Absorption, hits: &Hits<'_>, work: &mut Work) -> bool {
        let Some(seen) = absorption.seen else { return true };
        if absorption.generation != map.generation {
            // Circles have changed their places.
            *absorption = Absorption { generation: map.generation, ..Absorption::of(seen) };
        }
        let (center, face) = (seen.center_ned_m.minus(hits.origin_ned_m), seen.face_ned_m.minus(hits.origin_ned_m));
        let margin_m = self.config.cover_m;
        let beyond_m = seen.radius_m + if margin_m + OUT_M > GATE_M { margin_m + OUT_M } else { GATE_M };
        // What moves has been carried along since.
        let late_s = map.carried.seconds_since(hits.now);
        let meet = MEET + MEET_HIT * hits.points_m.len() as u32;
        let limit_m = if map.is_still { beyond_m } else { f32::INFINITY };
        loop {
            // What is far off is passed over first, at a glance.
            let rest = map.known.get(usize::from(absorption.next)..).unwrap_or_default();
            if !work.has(meet + FAR * rest.len() as u32) {
                return false;
            }
            let is_near = |known: &Known| {
                let reach_m = known.radius_m + limit_m;
                let away = known.circle.center_ned_m.minus(seen.center_ned_m);
                libm::fabsf(away.north) <= reach_m && libm::fabsf(away.east) <= reach_m
            };
            let passed = rest.iter().position(is_near).unwrap_or(rest.len());
            work.spend(FAR * (passed + 1) as u32);
            absorption.next += passed as u8;
            let Some(known) = map.known.get_mut(usize::from(absorption.next)) else { break };
            let away = known.center_before(late_s).minus(hits.origin_ned_m);
            let squared = away.minus(center).norm_squared();
            let reach_m = known.radius_m + beyond_m;
            let index = absorption.next;
            absorption.next += 1;
            if squared > reach_m * reach_m {
                continue;
            }
            work.spend(meet);
            if seen.kind == Kind::Pillar {
                if !known.is_round() {
                    let inside_m = seen.radius_m + STICK_OUT_M - known.radius_m;
                    if inside_m > 0.0 && squared < inside_m * inside_m {
                        known.clear_looks = DOOMED;
                        absorption.dooms = true;
                        continue;
                    }
                } else if known.clear_looks != AVERAGED
                    && is_gated(known, &seen, squared)
                    && absorption.met.push(index).is_ok()
                {
                    // It covers nothing before it is known whether it is the one.
                    if absorption.nearest.is_none_or(|(_, least)| squared < least) {
                        absorption.nearest = Some((index, squared));
                    }
                    continue;
                }
            }
            absorption.mark(known, away, face, hits.points_m, margin_m);
        }
        let mut price = END;
        if seen.kind == Kind::Pillar {
            price += AVERAGE + AVERAGE_HIT * hits.points_m.len() as u32;
        }
        if absorption.dooms || map.known.is_full() {
            price += WHOLE;
        }
        if !work.take(price) {
            return false;
        }
        self.conclude(map, absorption, &seen, hits, late_s);
        absorption.seen = None;
        true
    }

    /// Averages a detection that has met all, or adds it, or neither.
    fn conclude(&self, map: &mut Map, absorption: &mut Absorption, seen: &Detection, hits: &Hits<'_>, late_s: f32) {
        let face = seen.face_ned_m.minus(hits.origin_ned_m);
        if let Some((index, _)) = absorption.nearest
            && let Some(known) = map.known.get_mut(usize::from(index))
        {
            known.circle.center_ned_m = known.center_before(late_s);
            self.refine(known, seen, hits);
            known.circle.center_ned_m = known.circle.center_ned_m.plus(known.circle.velocity_ned_mps.times(late_s));
        }
        for index in absorption.met.clone() {
            if let Some(known) = map.known.get(usize::from(index)) {
                let away = known.center_before(late_s).minus(hits.origin_ned_m);
                absorption.mark(known, away, face, hits.points_m, self.config.cover_m);
            }
        }
        if absorption.dooms {
            map.sweep();
        }
        let count = hits.points_m.len();
        let is_covered = match seen.kind {
            // The edge of a pillar at the edge of the view looks like a thin pillar of its own, and an average can shift a
            // pillar off the hits of a neighbour.
            Kind::Pillar if absorption.nearest.is_none() => absorption.by_round.has_first(count),
            Kind::Pillar => absorption.covered.has_first(count),
            // The face of a single hit is the hit.
            Kind::Patch => {
                absorption.covered.has_first(count) && (absorption.is_face_covered || seen.to <= seen.from + 1)
            }
        };
        if !is_covered && let Some(known) = self.known_of(map, hits.now, seen) {
            let clear_looks = if seen.kind == Kind::Pillar { AVERAGED } else { 0 };
            map.add(Known { clear_looks, ..known }, hits.origin_ned_m);
        }
    }

    /// Asks a scan which circles it sees through, as far as there is time; true when it is done with.
    pub fn judge(&self, map: &mut Map, judging: &mut Judging, view: &View<'_>, work: &mut Work) -> bool {
        let Some(mut judged) = judging.judged else { return true };
        let mut at = usize::from(judging.at.max(map.resume));
        while judged < JUDGED_MAX
            && let Some(known) = map.known.get_mut(at)
        {
            if !work.has(JUDGED) {
                (judging.judged, judging.at) = (Some(judged), at as u8);
                return false;
            }
            at += 1;
            let away = known.circle.center_ned_m.minus(view.origin_ned_m);
            let squared = away.norm_squared();
            let is_asked = squared >= known.radius_m * known.radius_m && squared <= view.range_max_m * view.range_max_m;
            if !is_asked {
                work.spend(3 * FAR);
                continue;
            }
            work.spend(JUDGED);
            judged += 1;
            let passes = view.passes(known, away, squared * inverse_root(squared));
            known.clear_looks = if passes { known.clear_looks.saturating_add(1) } else { 0 };
            if known.clear_looks >= self.config.clear_looks {
                known.clear_looks = DOOMED;
            }
        }
        if !work.take((10 * CIRCLES_MAX) as u32) {
            (judging.judged, judging.at) = (Some(judged), at as u8);
            return false;
        }
        // The rest is asked after the next scan.
        map.resume = if judged == JUDGED_MAX { at as u8 } else { 0 };
        map.sweep();
        judging.judged = None;
        true
    }
}

/// Whether a known pillar may be the one that is seen.
fn is_gated(known: &Known, seen: &Detection, squared: f32) -> bool {
    let larger_m = if known.radius_m > seen.radius_m { known.radius_m } else { seen.radius_m };
    let gate_m = GATE_M + GATE * larger_m;
    squared < gate_m * gate_m
}
