//! The obstacle map: a bounded store of circles, remembered once seen.
//!
//! What a sensor that delivers circles reports replaces what was known. A scan of hits ([`Segmentation`]) is taken in like this:
//!
//! 1. What the sensor sees through, in the middle or at a side, for [`Config::clear_scans`] scans is forgotten.
//! 2. A pillar that meets a known one is averaged into it (`motion`: an alpha-beta filter whose memory grows), unless it is
//!    a poor glimpse of a better known one; worse measurements of the same one are forgotten. If the average leaves out what
//!    was just seen, that is added beside what was known.
//! 3. Patches are added where a hit is not in a known circle yet, or within [`Config::cover_m`] of it; patches inside a pillar go.
//!    What a wide sector reports from more than a metre away may stand a little beside its hit, too (`absorb`).
//!
//! So after each scan every hit is covered, or else what may be behind it, however wrong the store was, unless the store is full: then the circle farthest
//! from the vehicle is dropped and [`Map::overflow_count`] counts it. Before it is full, what others cover is forgotten
//! (`thin_out`). What is out of sight stays, but for circles that move: those are carried along and forgotten when unseen
//! for a while. A circle moves when its filter says so with four sigma for several scans in a row, so that the change of the
//! view of a standing pillar does not set it in motion.
//!
//! The cost of a scan is bounded: circles meet only what lies near them (`index`). Bench rows `look_*` give it.
//!
//! The reported radius is the measured one plus its sigma, which is zero for exact circles.

use heapless::Vec;

use crate::base::error::{ConfigError, check};
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

use index::{Index, Places};
use motion::{Motion, Sighting};

/// Most circles that are remembered.
pub const CIRCLES_MAX: usize = 192;
const _: () =
    assert!(CIRCLES_MAX.is_multiple_of(32) && CIRCLES_MAX < 256, "sets of places are arrays of u32, places are bytes");
/// Most circles that one delivery may hold; the rest of a longer one is ignored.
pub const DELIVERY_MAX: usize = 64;

/// Sigma below which averaging does not bring it, so that the map follows if the vehicle's own position drifts.
const SIGMA_MIN_M: f32 = 0.005;
/// Sigmas by which a circle's reported radius is larger.
const INFLATION_SIGMAS: f32 = 1.0;
/// A ray that passes a circle's rim on the inside by more than this, unhindered, speaks against the circle.
const RIM_M: f32 = 0.03;
/// A patch inside a pillar may stick out by this much.
const STICK_OUT_M: f32 = 0.04;
/// Two pillars are one whose centres are closer than a share of the larger radius and twice their doubt, at most this.
const GATE_M: f32 = 0.10;
const GATE: f32 = 0.5;
/// In place of a number of scans: to be forgotten.
const DOOMED: u8 = u8::MAX;
/// The same: seen in the scan that is being taken in, and no other pillar of that scan can be it.
const AVERAGED: u8 = u8::MAX - 1;
/// A hit farther behind a circle's front than this speaks against the circle.
const FRONT_M: f32 = 0.08;

/// What the map needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// A circle that moves is forgotten when unseen for this long.
    pub moving_memory_s: f32,
    /// Looks through a circle before it is forgotten.
    pub clear_scans: u8,
    /// A hit this close to a known circle is part of it.
    pub cover_m: f32,
    /// Slower than this nothing moves.
    pub moving_min_mps: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { moving_memory_s: 3.0, clear_scans: 3, cover_m: 0.018, moving_min_mps: 0.10 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Mapper, ConfigError> {
        check("map.moving_memory_s", self.moving_memory_s, 0.1, 60.0)?;
        check("map.clear_scans", f32::from(self.clear_scans), 1.0, 100.0)?;
        check("map.cover_m", self.cover_m, 0.001, 0.5)?;
        check("map.moving_min_mps", self.moving_min_mps, 0.01, 5.0)?;
        Ok(Mapper { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mapper {
    config: Config,
}

/// Where a remembered circle comes from.
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
    /// Of what is round: its velocity, if it moves. Of a patch, which never does: the unit vector towards where it was seen from.
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

    /// By how much its reported radius is larger than the measured one: not at all if it was delivered.
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
}

/// The store.
#[derive(Clone, Debug, Default)]
pub struct Map {
    known: Vec<Known, CIRCLES_MAX>,
    taken: Option<Instant>,
    /// Until when the moving circles have been carried along.
    carried: Instant,
    /// The circle that was checked last for being covered by others.
    asked: usize,
    overflow_count: u32,
    refused_count: u32,
}

impl Map {
    /// Back to an empty store, in place.
    pub fn clear(&mut self) {
        let Self { known, taken, carried, asked, overflow_count, refused_count } = self;
        known.clear();
        (*taken, *carried, *asked) = (None, Instant::default(), 0);
        (*overflow_count, *refused_count) = (0, 0);
    }

    /// The remembered circles.
    pub fn circles(&self) -> impl Iterator<Item = Circle> + Clone {
        self.known.iter().map(Known::circle)
    }

    /// The same for a plan.
    pub fn discs(&self) -> impl Iterator<Item = Disc> + Clone {
        let disc = |known: &Known| {
            // Towards zero, and at most 65 m.
            let sigma_mm = (1000.0 * known.inflation_m()) as u16;
            Disc { sigma_mm, ..Disc::from(known.circle()) }
        };
        self.known.iter().map(disc)
    }

    /// When the newest scan was measured that has been taken in, even if it hit nothing.
    #[must_use]
    pub fn taken(&self) -> Option<Instant> {
        self.taken
    }

    /// Circles that were dropped because the store was full or their delivery too long.
    #[must_use]
    pub fn overflow_count(&self) -> u32 {
        self.overflow_count
    }

    /// Circles and hits refused because they were not finite, negative or absurd.
    #[must_use]
    pub fn refused_count(&self) -> u32 {
        self.refused_count
    }

    fn refuse(&mut self, count: u32) {
        self.refused_count = self.refused_count.saturating_add(count);
    }

    /// A scan has been taken in. What is newer than now was stamped by a clock that has been set back since.
    fn note_taken(&mut self, time: Instant, now: Instant) {
        if self.taken.is_none_or(|taken| taken <= time || taken > now) {
            self.taken = Some(time);
        }
    }

    /// Forgets what is to be forgotten.
    fn sweep(&mut self) {
        let mut at = self.known.len();
        while at > 0 {
            at -= 1;
            if self.known.get(at).is_some_and(|known| known.clear_scans == DOOMED) {
                self.known.swap_remove(at);
            }
        }
    }

    /// Adds a circle. When the store is full it replaces one that is to be forgotten, or else the farthest from the vehicle.
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
}

impl Mapper {
    /// Takes in what was fitted to a scan: what it sees through is forgotten in time.
    pub fn observe_scan(&self, map: &mut Map, now: Instant, scan: &Scan, pose: &Pose, segmentation: &Segmentation) {
        self.begin_look(map, now);
        self.judge(map, scan, pose);
        map.sweep();
        self.take_in(map, now, segmentation);
    }

    /// Takes in what was fitted to points. Nothing is forgotten because of it: points do not show where there is nothing.
    pub fn observe_points(&self, map: &mut Map, now: Instant, segmentation: &Segmentation) {
        self.begin_look(map, now);
        self.take_in(map, now, segmentation);
    }

    fn begin_look(&self, map: &mut Map, now: Instant) {
        self.advance(map, now);
        for known in map.known.iter_mut().filter(|known| known.clear_scans == AVERAGED) {
            known.clear_scans = 0;
        }
    }

    #[inline(never)]
    fn take_in(&self, map: &mut Map, now: Instant, segmentation: &Segmentation) {
        map.refuse(u32::from(segmentation.refused));
        map.note_taken(segmentation.time, now);
        let mut index = Index::new(segmentation.origin_ned_m);
        index.place_all(&map.known);
        self.thin_out(map, &mut index);
        for seen in &segmentation.detections {
            self.absorb(map, &mut index, now, segmentation, seen);
        }
        map.sweep();
    }

    /// Takes in circles from a sensor that delivers circles, as of now: they replace what was known.
    ///
    /// # Errors
    /// None of the circles is plausible.
    pub fn observe_circles(
        &self,
        map: &mut Map,
        now: Instant,
        vehicle_ned_m: Horizontal,
        circles: &[Circle],
    ) -> Result<(), Refusal> {
        self.advance(map, now);
        let (taken, left) = circles.split_at(circles.len().min(DELIVERY_MAX));
        map.overflow_count = map.overflow_count.saturating_add(left.len() as u32);
        let plausible = taken.iter().filter(|circle| circle.is_plausible());
        let refused = taken.len() - plausible.clone().count();
        map.refuse(refused as u32);
        if refused > 0 && refused == taken.len() {
            return Err(Refusal::Absurd);
        }
        map.note_taken(now, now);
        let now_ms = millis(now);
        let mut index = Index::new(vehicle_ned_m);
        index.place_all(&map.known);
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
            // What was pieced together from hits is superseded where the sensor names the whole.
            for at in near {
                if let Some(pieced) = map.known.get_mut(at).filter(|k| k.origin != Origin::Given && holds(circle, k)) {
                    pieced.clear_scans = DOOMED;
                    index.doom(at);
                }
            }
            let found = seen_before(&map.known, near, circle, next);
            match found.or_else(|| seen_nearby(&map.known, near, circle, near_m, now_ms)) {
                Some(at) => {
                    if let Some(old) = map.known.get_mut(at) {
                        *old = known;
                    }
                    index.place(at, &known);
                    next = at + 1;
                }
                None => map.add(&mut index, known),
            }
        }
        map.sweep();
        Ok(())
    }

    /// Forgets what was pieced together from hits where moving objects are now.
    #[inline(never)]
    pub fn vacate(&self, map: &mut Map, centers_ned_m: &[Horizontal], radius_m: f32) {
        let squared_m2 = radius_m * radius_m;
        let is_left =
            |place: Horizontal| centers_ned_m.iter().any(|center| place.minus(*center).norm_squared() < squared_m2);
        if !centers_ned_m.is_empty() {
            map.known.retain(|known| known.origin == Origin::Given || !is_left(known.center_ned_m));
        }
    }

    /// Carries moving circles along and forgets those that were unseen for too long.
    pub fn advance(&self, map: &mut Map, now: Instant) {
        if map.carried == now {
            return;
        }
        let dt_s = now.seconds_since(map.carried);
        map.carried = now;
        let (memory_s, now_ms) = (self.config.moving_memory_s, millis(now));
        map.known.retain_mut(|known| {
            let velocity = known.velocity_ned_mps();
            if velocity.norm_squared() == 0.0 {
                return true;
            }
            known.center_ned_m = known.center_ned_m.plus(velocity.times(dt_s));
            seconds_between(known.seen_ms, now_ms) <= memory_s && known.circle().is_plausible()
        });
    }

    /// Averages a pillar into the known one that it is.
    fn refine(
        &self,
        known: &mut Known,
        now: Instant,
        seen: &Detection,
        points_m: &[Horizontal],
        origin_ned_m: Horizontal,
    ) {
        let now_ms = millis(now);
        known.clear_scans = AVERAGED;
        let margin_m = self.config.cover_m;
        let covers = |known: &Known| {
            let center = known.center_ned_m.minus(origin_ned_m);
            let reach_m = known.radius_m + margin_m;
            points_m.iter().all(|point| point.minus(center).norm_squared() <= reach_m * reach_m)
        };
        let before = *known;
        let is_glimpse = seen.sigma_m > 2.0 * known.sigma_m && covers(known);
        if !is_glimpse {
            let dt_s = seconds_between(known.seen_ms, now_ms);
            let share = known.sigma_m * known.sigma_m / (known.sigma_m * known.sigma_m + seen.sigma_m * seen.sigma_m);
            let sighting = Sighting { center: seen.center_ned_m, sigma_m: seen.sigma_m, share, dt_s };
            let (center, least_mps) = (known.center_ned_m, self.config.moving_min_mps);
            known.center_ned_m = known.motion.step(&mut known.slope_or_front, center, &sighting, least_mps);
            known.radius_m += (seen.radius_m - known.radius_m) * share;
            let sigma_m = known.sigma_m * sqrt(1.0 - share);
            known.sigma_m = if sigma_m > SIGMA_MIN_M { sigma_m } else { SIGMA_MIN_M };
            if !covers(known) {
                // It is something else, too, or was taken for something else: what is known stays until it is seen through.
                *known = before;
                return;
            }
            known.origin = Origin::Seen(Kind::Pillar);
        }
        known.seen_ms = now_ms;
    }

    /// What was seen, as it would be remembered; nothing, and counted, if it is absurd.
    fn known_of(&self, map: &mut Map, now: Instant, seen: &Detection) -> Option<Known> {
        let known = Known {
            center_ned_m: seen.center_ned_m,
            radius_m: seen.radius_m,
            sigma_m: seen.sigma_m,
            slope_or_front: front_of(seen),
            seen_ms: millis(now),
            motion: Motion::default(),
            origin: Origin::Seen(seen.kind),
            clear_scans: 0,
        };
        if !known.circle().is_plausible() || !(seen.sigma_m > 0.0) {
            map.refuse(1);
            return None;
        }
        Some(known)
    }
}

/// The place of a circle that was delivered before as it is now. A sensor that names what stands still does so in the same
/// order each time: the search begins behind the last one that was found.
fn seen_before(known: &[Known], mut near: Places, circle: &Circle, next: usize) -> Option<usize> {
    let is_it = |at: &usize| known.get(*at).is_some_and(|k| k.circle() == *circle && k.origin == Origin::Given);
    Some(next).filter(is_it).or_else(|| near.find(is_it))
}

/// The place of what a circle is another measurement of.
fn seen_nearby(known: &[Known], mut near: Places, circle: &Circle, near_m: f32, now_ms: u32) -> Option<usize> {
    near.find(|at| {
        let Some(k) = known.get(*at).filter(|k| k.clear_scans != DOOMED) else { return false };
        // Two circles of one delivery are two obstacles, however near, unless they are one and the same.
        if k.seen_ms == now_ms && k.origin == Origin::Given {
            return false;
        }
        let away = k.center_ned_m.minus(circle.center_ned_m);
        away.norm_squared() < near_m * near_m && libm::fabsf(k.radius_m - circle.radius_m) < 0.05
    })
}

/// The unit vector from a patch towards where it is seen from. Round ones have no such vector, and are assumed to stand at first.
fn front_of(seen: &Detection) -> Horizontal {
    if seen.kind != Kind::Patch {
        return Horizontal::default();
    }
    let front = seen.face_ned_m.minus(seen.center_ned_m);
    front.times(inverse_root(front.norm_squared()))
}

/// Whether a circle is inside another, but for what a bad fit may stick out.
fn holds(outer: &Circle, inner: &Known) -> bool {
    let reach_m = outer.radius_m + STICK_OUT_M - inner.radius_m;
    let away = outer.center_ned_m.minus(inner.center_ned_m);
    reach_m > 0.0 && away.norm_squared() < reach_m * reach_m
}

/// Wraps after seven weeks.
fn millis(now: Instant) -> u32 {
    (now.0 / 1000) as u32
}

/// Zero when the clock went back.
fn seconds_between(earlier_ms: u32, later_ms: u32) -> f32 {
    let ms = later_ms.wrapping_sub(earlier_ms) as i32;
    if ms > 0 { ms as f32 * 1e-3 } else { 0.0 }
}

#[cfg(test)]
mod tests;
