//! The obstacle map: a bounded store of the circles seen so far.
//!
//! Circles delivered by a sensor replace what was known there. A scan of hits ([`Segmentation`]) is processed as
//! follows:
//!
//! 1. A circle that the sensor sees through, in the middle or at a side, for three scans in a row is forgotten; for six where
//!    it sees nothing behind it and loses rays.
//! 2. A pillar that matches a known one is averaged into it (`motion`: an alpha-beta filter whose memory grows), unless
//!    it is much less accurate than the known one; worse measurements of the same pillar are forgotten. If the average
//!    would not cover the new hits, the pillar is added as a separate circle.
//! 3. Patches are added where a hit is not in a known circle, or within `COVER_M` of it, yet; patches inside
//!    a pillar are removed. An obstacle that a wide sector reports from more than a metre away may also be a little
//!    beside its hit (`absorb`).
//!
//! So after each scan every hit, or its possible place in a wide sector, is covered, whatever errors the store had
//! before. The exception is a full store: then the circle farthest from the vehicle is dropped and
//! [`Map::overflow_count`] counts it. Before the store is full, circles that others cover are forgotten (`thin_out`).
//! Circles out of sight are kept, except moving ones: those are moved on with their velocity, and forgotten when unseen
//! for a while. A circle counts as moving when its filter's speed exceeds four sigma for several scans in a row, so
//! that a standing pillar does not seem to move when it is seen from another side.
//!
//! The cost of a scan is bounded: circles are compared only with those near them (`index`). Bench rows `look_*` measure
//! it.
//!
//! The reported radius is the measured one plus its sigma, which is zero for exact circles.

use heapless::Vec;

use crate::base::math::{inverse_root, sqrt};
use crate::base::ned::Horizontal;
use crate::base::obstacle::{Circle, Disc};
use crate::base::pose::Pose;
use crate::base::time::Instant;
use crate::mapping::scan::{Detection, Kind, Refusal, Scan, Segmentation};

mod absorb;
mod index;
mod motion;
mod thin_out;

use index::Index;
use motion::{Motion, Sighting};

/// Largest number of circles that are remembered.
pub const CIRCLES_MAX: usize = 192;
const _: () =
    assert!(CIRCLES_MAX.is_multiple_of(32) && CIRCLES_MAX < 256, "sets of places are arrays of u32, places are bytes");
/// Largest number of circles in one delivery; the rest of a longer one is ignored.
pub const DELIVERY_MAX: usize = 64;

/// Lower limit of a circle's sigma when it is averaged, so that the map follows if the vehicle's own position drifts.
const SIGMA_MIN_M: f32 = 0.005;
/// Number of sigmas by which a circle's reported radius is larger than the measured one.
const INFLATION_SIGMAS: f32 = 1.0;
/// A ray that passes through a circle, more than this inside its rim, is evidence against the circle.
const RIM_M: f32 = 0.03;
/// Largest distance by which a patch inside a pillar may stick out.
const STICK_OUT_M: f32 = 0.04;
/// Two pillars are the same if their centres are closer than [`GATE`] times the larger radius plus twice the sum of
/// their sigmas, which counts up to this.
const GATE_M: f32 = 0.10;
const GATE: f32 = 0.5;
/// In place of a number of scans: the circle is to be forgotten.
const DOOMED: u8 = u8::MAX;
/// In place of a number of scans: seen in the scan that is being processed; no other pillar of that scan can match it.
const AVERAGED: u8 = u8::MAX - 1;
/// A moving object has left a place, or is known to move, within this.
const STOOD_S: f32 = 3.0;
/// A hit farther behind a circle's front than this is evidence against the circle.
const FRONT_M: f32 = 0.08;
/// A circle that moves is forgotten when unseen for this long.
const MOVING_MEMORY_S: f32 = 3.0;
/// A circle is forgotten when scans in a row have seen through it so often, each counted as [`SEEN_THROUGH`].
const CLEAR: u8 = 6;
/// Of a sensor that loses rays, a scan that sees nothing behind the circle counts half.
const SEEN_THROUGH: u8 = 2;
/// A hit this close to a known circle is part of it.
const COVER_M: f32 = 0.018;

/// The origin of a remembered circle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    /// Delivered as a circle.
    Given,
    /// Fitted to hits.
    Seen(Kind),
}

/// A remembered circle: 32 bytes, of which there are [`CIRCLES_MAX`].
#[derive(Clone, Copy, Debug)]
struct Known {
    center_ned_m: Horizontal,
    /// As it was measured.
    radius_m: f32,
    /// Standard deviation of centre and radius.
    sigma_m: f32,
    /// For a round circle: its velocity, if it moves. For a patch, which never moves: the unit vector towards where it
    /// was seen from.
    slope_or_front: Horizontal,
    seen_ms: u32,
    motion: Motion,
    origin: Origin,
    clear_scans: u8,
}

impl Known {
    fn is_round(&self) -> bool {
        self.origin != Origin::Seen(Kind::Patch)
    }

    fn velocity_ned_mps(&self) -> Horizontal {
        if self.motion.moves() { self.slope_or_front } else { Horizontal::default() }
    }

    /// Amount by which its reported radius is larger than the measured one: zero if it was delivered.
    fn inflation_m(&self) -> f32 {
        if self.origin == Origin::Given { 0.0 } else { INFLATION_SIGMAS * self.sigma_m }
    }

    /// As it is reported: larger by its sigma unless it was delivered, and with a velocity only if it moves.
    fn circle(&self) -> Circle {
        Circle {
            center_ned_m: self.center_ned_m,
            radius_m: self.radius_m + self.inflation_m(),
            velocity_ned_mps: self.velocity_ned_mps(),
        }
    }

    /// Averages in a pillar that matches it.
    fn refine(&mut self, now: Instant, seen: &Detection, points_m: &[Horizontal], origin_ned_m: Horizontal) {
        let now_ms = millis(now);
        self.clear_scans = AVERAGED;
        let covers = |known: &Self| {
            let center = known.center_ned_m.minus(origin_ned_m);
            let reach_m = known.radius_m + COVER_M;
            points_m.iter().all(|point| point.minus(center).norm_squared() <= reach_m * reach_m)
        };
        let before = *self;
        let is_glimpse = seen.sigma_m > 2.0 * self.sigma_m && covers(self);
        if !is_glimpse {
            let dt_s = seconds_between(self.seen_ms, now_ms);
            let share = self.sigma_m * self.sigma_m / (self.sigma_m * self.sigma_m + seen.sigma_m * seen.sigma_m);
            let sighting = Sighting { center: seen.center_ned_m, sigma_m: seen.sigma_m, share, dt_s };
            let center = self.center_ned_m;
            self.center_ned_m = self.motion.step(&mut self.slope_or_front, center, &sighting);
            self.radius_m += (seen.radius_m - self.radius_m) * share;
            let sigma_m = self.sigma_m * sqrt(1.0 - share);
            self.sigma_m = if sigma_m > SIGMA_MIN_M { sigma_m } else { SIGMA_MIN_M };
            if !covers(self) {
                // The average does not cover the hits, so it was another obstacle in part: the known pillar stays as it
                // was until scans see through it.
                *self = before;
                return;
            }
            self.origin = Origin::Seen(Kind::Pillar);
        }
        self.seen_ms = now_ms;
    }
}

/// The store.
///
/// ```
/// use foxhound_core::base::ned::Horizontal;
/// use foxhound_core::base::obstacle::Circle;
/// use foxhound_core::base::time::Instant;
/// use foxhound_core::mapping::map::Map;
///
/// let mut map = Map::default();
/// let center_ned_m = Horizontal { north: 3.0, east: 1.0 };
/// let pillar = Circle { center_ned_m, radius_m: 0.2, ..Circle::default() };
/// let here = Horizontal::default();
/// assert!(map.observe_circles(Instant(0), here, &[pillar]).is_ok());
/// assert!(map.circles().eq([pillar]));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Map {
    known: Vec<Known, CIRCLES_MAX>,
    taken: Option<Instant>,
    /// Time to which the moving circles have been predicted.
    carried: Instant,
    /// The circle that was checked last for being covered by others.
    asked: u8,
    /// Whether there has been a scan: then single points are not what the vehicle sees by.
    has_scanned: bool,
    overflow_count: u32,
}

impl Map {
    /// Back to an empty store, in place.
    pub fn clear(&mut self) {
        let Self { known, taken, carried, asked, has_scanned, overflow_count } = self;
        known.clear();
        (*taken, *carried, *asked, *has_scanned, *overflow_count) = (None, Instant::default(), 0, false, 0);
    }

    /// The remembered circles.
    pub fn circles(&self) -> impl Iterator<Item = Circle> + Clone {
        self.known.iter().map(Known::circle)
    }

    /// The same in the planner's form.
    pub fn discs(&self) -> impl Iterator<Item = Disc> + Clone {
        let disc = |known: &Known| {
            // The cast rounds towards zero, and saturates at 65 m.
            let sigma_mm = (1000.0 * known.inflation_m()) as u16;
            Disc { sigma_mm, ..Disc::from(known.circle()) }
        };
        self.known.iter().map(disc)
    }

    /// Time of measurement of the newest scan, even if it hit nothing, or delivery of circles; of the newest points where there has
    /// been no scan: a beam ahead does not replace a lidar that has failed.
    #[must_use]
    pub fn taken(&self) -> Option<Instant> {
        self.taken
    }

    /// Number of circles dropped because the store was full or their delivery too long.
    #[must_use]
    pub fn overflow_count(&self) -> u32 {
        self.overflow_count
    }

    /// Records that a scan has been processed. A recorded time later than now came from a clock that has been set back
    /// since.
    fn note_taken(&mut self, time: Instant, now: Instant) {
        if self.taken.is_none_or(|taken| taken <= time || taken > now) {
            self.taken = Some(time);
        }
    }

    /// Removes the circles marked as to be forgotten.
    fn sweep(&mut self) {
        let mut at = self.known.len();
        while at > 0 {
            at -= 1;
            if self.known.get(at).is_some_and(|known| known.clear_scans == DOOMED) {
                self.known.swap_remove(at);
            }
        }
    }

    /// Adds a circle. When the store is full it replaces one that is to be forgotten, or else the farthest from the
    /// vehicle.
    fn add(&mut self, index: &mut Index, known: Known) {
        let at = self.known.len();
        let Err(known) = self.known.push(known) else { return index.place(at, &known) };
        let (place, is_doomed) = index.give_way(&known);
        if !is_doomed {
            self.overflow_count = self.overflow_count.saturating_add(1);
        }
        if let Some(at) = place
            && let Some(old) = self.known.get_mut(at)
        {
            index.place(at, &known);
            *old = known;
        }
    }

    /// Processes the circles fitted to a scan; circles that scans see through are forgotten after some scans, after more if the
    /// sensor loses rays.
    pub fn observe_scan(
        &mut self,
        now: Instant,
        scan: &Scan,
        pose: &Pose,
        segmentation: &Segmentation,
        loses_rays: bool,
    ) {
        self.begin_look(now);
        self.has_scanned = true;
        self.note_taken(segmentation.time, now);
        self.judge(scan, pose, segmentation.slip_m, loses_rays);
        self.sweep();
        self.take_in(now, segmentation);
    }

    /// Processes the circles fitted to points. No circle is forgotten because of points: they do not show free space.
    pub fn observe_points(&mut self, now: Instant, segmentation: &Segmentation) {
        self.begin_look(now);
        if !self.has_scanned {
            self.note_taken(segmentation.time, now);
        }
        self.take_in(now, segmentation);
    }

    fn begin_look(&mut self, now: Instant) {
        self.advance(now);
        for known in self.known.iter_mut().filter(|known| known.clear_scans == AVERAGED) {
            known.clear_scans = 0;
        }
    }

    #[inline(never)]
    fn take_in(&mut self, now: Instant, segmentation: &Segmentation) {
        let mut index = Index::new(segmentation.origin_ned_m);
        index.place_all(&self.known);
        self.thin_out(&mut index);
        for seen in &segmentation.detections {
            self.absorb(&mut index, now, segmentation, seen);
        }
        self.sweep();
    }

    /// Processes circles from a sensor that delivers circles, as of now: they replace what was known there.
    ///
    /// # Errors
    /// None of the circles is plausible.
    pub fn observe_circles(
        &mut self,
        now: Instant,
        vehicle_ned_m: Horizontal,
        circles: &[Circle],
    ) -> Result<(), Refusal> {
        self.advance(now);
        let (taken, left) = circles.split_at(circles.len().min(DELIVERY_MAX));
        self.overflow_count = self.overflow_count.saturating_add(left.len() as u32);
        let mut plausible = taken.iter().filter(|circle| circle.is_plausible()).peekable();
        if plausible.peek().is_none() && !taken.is_empty() {
            return Err(Refusal::Absurd);
        }
        self.note_taken(now, now);
        let now_ms = millis(now);
        let mut index = Index::new(vehicle_ned_m);
        index.place_all(&self.known);
        let mut next = 0;
        for circle in plausible {
            let known = Known {
                center_ned_m: circle.center_ned_m,
                radius_m: circle.radius_m,
                sigma_m: SIGMA_MIN_M,
                slope_or_front: circle.velocity_ned_mps,
                motion: Motion::of(circle.velocity_ned_mps),
                seen_ms: now_ms,
                origin: Origin::Given,
                clear_scans: 0,
            };
            let near_m = 0.05 + 0.25 * circle.radius_m;
            let reach_m = circle.radius_m + STICK_OUT_M;
            let near = index.near(circle.center_ned_m, if reach_m > near_m { reach_m } else { near_m });
            // A sensor usually delivers standing obstacles in the same order each time, so the search for a circle that was
            // delivered before with the same values begins after the last one found.
            let is_again = |k: &Known| k.origin == Origin::Given && k.circle() == *circle;
            let mut again = Some(next).filter(|at| self.known.get(*at).is_some_and(is_again));
            let mut nearby = None;
            for at in near {
                let Some(k) = self.known.get_mut(at) else { continue };
                if k.origin != Origin::Given && holds(circle, k) {
                    // Circles fitted to hits are replaced where the sensor delivers the whole obstacle.
                    k.clear_scans = DOOMED;
                    index.doom(at);
                } else if again.is_none() && is_again(k) {
                    again = Some(at);
                } else if nearby.is_none() && is_measured_again(k, circle, near_m, now_ms) {
                    nearby = Some(at);
                }
            }
            match again.or(nearby) {
                Some(at) => {
                    if let Some(old) = self.known.get_mut(at) {
                        *old = known;
                    }
                    index.place(at, &known);
                    next = at + 1;
                }
                None => self.add(&mut index, known),
            }
        }
        self.sweep();
        Ok(())
    }

    /// Forgets circles fitted to hits where moving objects are now, but not what stood there before they came: they may hide it.
    #[inline(never)]
    pub fn vacate(&mut self, now: Instant, centers_ned_m: &[Horizontal], radius_m: f32) {
        let squared_m2 = radius_m * radius_m;
        let is_left =
            |place: Horizontal| centers_ned_m.iter().any(|center| place.minus(*center).norm_squared() < squared_m2);
        let now_ms = millis(now);
        // A patch is not measured again while it is covered, so it was seen when it was new.
        let stood_before = |known: &Known| match known.origin {
            Origin::Given => true,
            Origin::Seen(Kind::Pillar) => known.motion.rests(),
            Origin::Seen(Kind::Patch) => seconds_between(known.seen_ms, now_ms) > STOOD_S,
        };
        if !centers_ned_m.is_empty() {
            self.known.retain(|known| stood_before(known) || !is_left(known.center_ned_m));
        }
    }

    /// Moves circles on with their velocity, and forgets moving ones that were unseen for too long, or whose age is not known since the
    /// clock was set back.
    pub fn advance(&mut self, now: Instant) {
        if self.carried == now {
            return;
        }
        let (dt_s, is_set_back) = (now.seconds_since(self.carried), now < self.carried);
        self.carried = now;
        let now_ms = millis(now);
        self.known.retain_mut(|known| {
            let velocity = known.velocity_ned_mps();
            if velocity.norm_squared() == 0.0 {
                return true;
            }
            known.center_ned_m = known.center_ned_m.plus(velocity.times(dt_s));
            !is_set_back && seconds_between(known.seen_ms, now_ms) <= MOVING_MEMORY_S && known.circle().is_plausible()
        });
    }
}

/// The detection in the form of the store; `None` if it is implausible.
fn known_of(now: Instant, seen: &Detection) -> Option<Known> {
    let known = Known {
        center_ned_m: seen.center_ned_m,
        radius_m: seen.radius_m,
        sigma_m: seen.sigma_m,
        slope_or_front: front_of(seen),
        seen_ms: millis(now),
        motion: Motion::default(),
        origin: Origin::Seen(seen.kind),
        clear_scans: if seen.kind == Kind::Pillar { AVERAGED } else { 0 },
    };
    (known.circle().is_plausible() && seen.sigma_m > 0.0).then_some(known)
}

/// Whether a circle is another measurement of a known one.
fn is_measured_again(known: &Known, circle: &Circle, near_m: f32, now_ms: u32) -> bool {
    // Two circles of one delivery are two obstacles, however near, unless they are equal.
    if known.clear_scans == DOOMED || known.seen_ms == now_ms && known.origin == Origin::Given {
        return false;
    }
    let away = known.center_ned_m.minus(circle.center_ned_m);
    away.norm_squared() < near_m * near_m && libm::fabsf(known.radius_m - circle.radius_m) < 0.05
}

/// The unit vector from a patch towards where it is seen from. Round circles get zero instead, their initial velocity.
fn front_of(seen: &Detection) -> Horizontal {
    if seen.kind != Kind::Patch {
        return Horizontal::default();
    }
    let front = seen.face_ned_m.minus(seen.center_ned_m);
    front.times(inverse_root(front.norm_squared()))
}

/// Whether a circle is inside another, except for what a bad fit may stick out.
fn holds(outer: &Circle, inner: &Known) -> bool {
    let reach_m = outer.radius_m + STICK_OUT_M - inner.radius_m;
    let away = outer.center_ned_m.minus(inner.center_ned_m);
    reach_m > 0.0 && away.norm_squared() < reach_m * reach_m
}

/// Milliseconds; wraps after seven weeks.
fn millis(now: Instant) -> u32 {
    (now.0 / 1000) as u32
}

/// Seconds from one time to another; zero if the clock went back.
fn seconds_between(earlier_ms: u32, later_ms: u32) -> f32 {
    let ms = later_ms.wrapping_sub(earlier_ms) as i32;
    if ms > 0 { ms as f32 * 1e-3 } else { 0.0 }
}

#[cfg(test)]
mod tests;
