//! The obstacle map: a bounded store of circles, remembered once seen.
//!
//! A sensor that delivers circles has the last word on what it sees. A look at hits ([`Look`]) is taken in like this:
//!
//! 1. What the sensor sees through, in the middle or at a side, for [`Config::clear_looks`] looks is forgotten.
//! 2. A pillar that meets a known one is averaged into it (`motion`: an alpha-beta filter whose memory grows), unless it is
//!    a poor glimpse of a better known one. If the average leaves out what was just seen, the look replaces it.
//! 3. Patches are added where a hit is not in a known circle yet, or within [`Config::cover_m`] of it; patches inside a pillar go.
//!
//! So after each look every hit is covered, however wrong the store was, unless the store is full: then the circle farthest
//! from the vehicle gives way and [`Map::overflow_count`] says so. What is out of sight stays, but for circles that move:
//! those are carried along and forgotten when unseen for a while. A circle moves when its filter says so with four sigma
//! for several looks in a row, so that the change of the view of a standing pillar does not set it in motion.
//!
//! The cost of a look is bounded: circles meet only what lies near them (`places`), 32 are asked whether they are seen through
//! and the others have their turn in the next look, and when the store is crowded the nearest few are added and the rest
//! counted.
//!
//! The radius that is told is the measured one plus [`Config::inflation_sigmas`] of its sigma, nothing for exact circles.

use heapless::Vec;

use crate::error::{ConfigError, check};
use crate::field::inverse_root;
use crate::frame::Horizontal;
use crate::kernel::sqrt;
use crate::scan::{DETECTIONS_MAX, Detection, Kind, Look, POINTS_MAX, Pose, Scan, Sector};
use crate::time::Instant;
use crate::units::wrap_pi;

mod motion;
mod places;

use motion::{Motion, Sighting};
use places::Places;

/// Most circles that are remembered.
pub const CIRCLES_MAX: usize = 128;
/// Most circles that one delivery may hold; the rest of a longer one is not looked at.
pub const DELIVERY_MAX: usize = 64;

/// Sigma below which averaging does not bring it, so that the map follows if the vehicle's own position drifts.
const SIGMA_MIN_M: f32 = 0.005;
/// A ray that passes a circle's rim on the inside by more than this, unhindered, speaks against the circle.
const RIM_M: f32 = 0.03;
/// A patch inside a pillar may stick out by this much.
const STICK_OUT_M: f32 = 0.04;
/// Two pillars whose centres are closer than this, and a share of the larger radius, are one.
const GATE_M: f32 = 0.10;
const GATE: f32 = 0.5;
/// So many circles at most are asked in one look whether they are seen through; the others have their turn in the next.
const JUDGED_MAX: usize = 32;
/// So many circles at most give way in one look.
const CROWDED_MAX: usize = 6;
/// In place of a number of looks: to be forgotten.
const DOOMED: u8 = u8::MAX;
/// A hit farther behind a circle's front than this speaks against the circle.
const FRONT_M: f32 = 0.08;

/// An obstacle as a vertical cylinder, in the local NED frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Circle {
    /// Centre.
    pub center_ned_m: Horizontal,
    /// Radius.
    pub radius_m: f32,
    /// Velocity.
    pub velocity_ned_mps: Horizontal,
}

impl Circle {
    /// Whether it is finite, not negative and not absurd.
    #[must_use]
    pub fn is_plausible(&self) -> bool {
        self.center_ned_m.is_finite()
            && self.velocity_ned_mps.is_finite()
            && self.radius_m >= 0.0
            && self.radius_m <= 1e3
            && self.center_ned_m.norm_squared() < 1e12
            && self.velocity_ned_mps.norm_squared() < 1e4
    }
}

/// What the map needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// A circle that moves is forgotten when unseen for this long.
    pub moving_memory_s: f32,
    /// Looks through a circle before it is forgotten.
    pub clear_looks: u8,
    /// A hit this close to a known circle is part of it.
    pub cover_m: f32,
    /// Sigmas that a circle's radius is told larger by.
    pub inflation_sigmas: f32,
    /// Slower than this nothing moves.
    pub moving_min_mps: f32,
}

impl Default for Config {
    fn default() -> Self {
        Self { moving_memory_s: 3.0, clear_looks: 3, cover_m: 0.018, inflation_sigmas: 1.0, moving_min_mps: 0.10 }
    }
}

impl Config {
    /// Checks the configuration.
    ///
    /// # Errors
    /// The field that is out of range.
    pub fn build(&self) -> Result<Keeper, ConfigError> {
        check("map.moving_memory_s", self.moving_memory_s, 0.1, 60.0)?;
        check("map.clear_looks", f32::from(self.clear_looks), 1.0, 100.0)?;
        check("map.cover_m", self.cover_m, 0.001, 0.5)?;
        check("map.inflation_sigmas", self.inflation_sigmas, 0.0, 5.0)?;
        check("map.moving_min_mps", self.moving_min_mps, 0.01, 5.0)?;
        Ok(Keeper { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keeper {
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

/// A remembered circle.
#[derive(Clone, Copy, Debug)]
struct Known {
    /// As it is told: inflated, and with a velocity only if it moves.
    circle: Circle,
    /// As it was measured.
    radius_m: f32,
    /// Standard deviation of centre and radius.
    sigma_m: f32,
    /// Its velocity, if it moves.
    slope_ned_mps: Horizontal,
    motion: Motion,
    seen_ms: u32,
    origin: Origin,
    clear_looks: u8,
}

impl Known {
    fn is_round(&self) -> bool {
        self.origin != Origin::Seen(Kind::Patch)
    }

    /// Whether a point is in it, or closer to it than `margin_m`.
    fn covers(&self, point: Horizontal, margin_m: f32) -> bool {
        let reach_m = self.radius_m + margin_m;
        point.minus(self.circle.center_ned_m).norm_squared() <= reach_m * reach_m
    }
}

/// The store.
#[derive(Clone, Debug, Default)]
pub struct Map {
    known: Vec<Known, CIRCLES_MAX>,
    updated: Option<Instant>,
    /// Until when the moving circles have been carried along.
    carried: Instant,
    overflow_count: u32,
    refused_count: u32,
    /// The circle that is the first to be asked in the next look whether it is seen through.
    resume: u8,
}

impl Map {
    /// The remembered circles.
    pub fn circles(&self) -> impl Iterator<Item = &Circle> + Clone {
        self.known.iter().map(|known| &known.circle)
    }

    /// When a sensor last reported, even if it saw nothing.
    #[must_use]
    pub fn updated(&self) -> Option<Instant> {
        self.updated
    }

    /// Circles that gave way because the store was full or their delivery too long.
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

    /// Forgets what is to be forgotten.
    fn sweep(&mut self) {
        let mut index = self.known.len();
        while index > 0 {
            index -= 1;
            if self.known.get(index).is_some_and(|known| known.clear_looks == DOOMED) {
                self.known.swap_remove(index);
            }
        }
    }

    /// Adds a circle; the farthest from the vehicle gives way when the store is full.
    fn add(&mut self, known: Known, vehicle_ned_m: Horizontal) {
        if let Err(known) = self.known.push(known) {
            self.overflow_count = self.overflow_count.saturating_add(1);
            let squared = |k: &Known| k.circle.center_ned_m.minus(vehicle_ned_m).norm_squared();
            let mut most = squared(&known);
            let mut far: Option<&mut Known> = None;
            for candidate in &mut self.known {
                let distance = squared(candidate);
                if distance > most {
                    (far, most) = (Some(candidate), distance);
                }
            }
            if let Some(far) = far {
                *far = known;
            }
        }
    }
}

/// A look as it is compared with the store, relative to where it was taken from.
struct Comparison<'a> {
    look: &'a Look,
    /// The hits, and from [`POINTS_MAX`] on the middles of the faces, by the numbers of their detections.
    marks: Places,
    /// How much is known of each mark: not covered, [`COVERED`], [`COVERED`] and [`BY_ROUND`].
    covered: [u8; POINTS_MAX + DETECTIONS_MAX],
    pillars: Places,
    /// Largest radius of a pillar.
    pillar_max_m: f32,
    /// Farthest hit.
    reach_m: f32,
}

/// In a known circle or close to one.
const COVERED: u8 = 1;
/// In a pillar or a circle that a sensor delivered, or close to one.
const BY_ROUND: u8 = 2;

impl<'a> Comparison<'a> {
    fn new(look: &'a Look) -> Self {
        let mut marks = Places::new();
        let mut farthest = 0.0_f32;
        for (index, point) in look.points_ned_m.iter().enumerate() {
            let place = point.minus(look.origin_ned_m);
            let squared = place.norm_squared();
            if squared > farthest {
                farthest = squared;
            }
            marks.put(index, place);
        }
        let mut pillars = Places::new();
        let mut pillar_max_m = 0.0_f32;
        for (index, seen) in look.detections.iter().enumerate() {
            match seen.kind {
                Kind::Pillar => {
                    pillars.put(index, seen.center_ned_m.minus(look.origin_ned_m));
                    if seen.radius_m > pillar_max_m {
                        pillar_max_m = seen.radius_m;
                    }
                }
                // The face of a single hit is the hit.
                Kind::Patch if seen.to > seen.from + 1 => {
                    marks.put(POINTS_MAX + index, seen.face_ned_m.minus(look.origin_ned_m));
                }
                Kind::Patch => {}
            }
        }
        let reach_m = sqrt(farthest) + 2.0 * pillar_max_m;
        Self { look, marks, covered: [0; POINTS_MAX + DETECTIONS_MAX], pillars, pillar_max_m, reach_m }
    }

    /// Marks what a circle covers.
    fn mark(&mut self, known: &Known, margin_m: f32) {
        let Self { look, marks, covered, .. } = self;
        let by = if known.is_round() { COVERED | BY_ROUND } else { COVERED };
        let reach_m = known.radius_m + margin_m;
        marks.near(known.circle.center_ned_m.minus(look.origin_ned_m), reach_m, |mark| {
            let place = match mark.checked_sub(POINTS_MAX) {
                None => look.points_ned_m.get(mark),
                Some(index) => look.detections.get(index).map(|seen| &seen.face_ned_m),
            };
            if let (Some(covered), Some(place)) = (covered.get_mut(mark), place)
                && *covered & by != by
                && known.covers(*place, margin_m)
            {
                *covered |= by;
            }
        });
    }

    /// Whether every hit of a detection, and the middle of its face, is covered in this sense.
    fn is_covered(&self, index: usize, by: u8) -> bool {
        let Some(seen) = self.look.detections.get(index) else { return true };
        let has_face = seen.kind == Kind::Patch && seen.to > seen.from + 1;
        self.covered.get(usize::from(seen.from)..usize::from(seen.to)).unwrap_or_default().iter().all(|c| c & by != 0)
            && (!has_face || self.covered.get(POINTS_MAX + index).is_some_and(|c| c & by != 0))
    }
}

/// The scan behind a look, as one asks it what lies in a direction.
struct View<'a> {
    scan: &'a Scan,
    /// From north to the middle of the first sector.
    first_ned_rad: f32,
    sectors_per_rad: f32,
    turn: Option<usize>,
}

impl<'a> View<'a> {
    fn new(scan: &'a Scan, pose: &Pose) -> Self {
        Self {
            scan,
            first_ned_rad: pose.yaw_rad + scan.first_azimuth_rad,
            sectors_per_rad: 1.0 / scan.step_rad,
            turn: scan.turn(),
        }
    }

    /// Whether the sensor sees something behind a circle, or nothing where it stands.
    fn passes(&self, known: &Known, away: Horizontal, distance_m: f32) -> bool {
        let turn = self.turn.map_or(0.0, |turn| turn as f32);
        let mut middle = wrap_pi(away.bearing_rad() - self.first_ned_rad) * self.sectors_per_rad;
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
        let reach = x * (1.0 + x * x / 6.0) * libm::fabsf(self.sectors_per_rad);
        let (low, high) = (libm::ceilf(middle - reach), libm::floorf(middle + reach));
        low <= high && (self.passes_sector(low as i32, side_m) || self.passes_sector(high as i32, side_m))
    }

    fn passes_sector(&self, index: i32, limit_m: f32) -> bool {
        let index = match self.turn {
            Some(turn) if index < 0 => index + turn as i32,
            Some(turn) if index >= turn as i32 => index - turn as i32,
            _ => index,
        };
        match usize::try_from(index).ok().and_then(|index| self.scan.sectors.get(index)) {
            Some(Sector::Clear) => true,
            Some(Sector::Hit(range_m)) => *range_m > limit_m,
            Some(Sector::Unknown) | None => false,
        }
    }
}

/// The known pillar that a seen one is.
#[derive(Clone, Copy)]
struct Match {
    known: Option<u8>,
    squared: f32,
}

impl Keeper {
    /// Takes in what was fitted to one scan.
    pub fn observe_scan(&self, map: &mut Map, now: Instant, scan: &Scan, pose: &Pose, look: &Look) {
        self.observe(map, now, look, Some(&View::new(scan, pose)));
    }

    /// Takes in what was fitted to points. Nothing is forgotten for it: points do not say where there is nothing.
    pub fn observe_look(&self, map: &mut Map, now: Instant, look: &Look) {
        self.observe(map, now, look, None);
    }

    fn observe(&self, map: &mut Map, now: Instant, look: &Look, view: Option<&View<'_>>) {
        map.refuse(u32::from(look.refused));
        if !look.is_usable() {
            return;
        }
        self.advance(map, now);
        map.updated = Some(now);
        let mut compared = Comparison::new(look);
        let mut matches = [Match { known: None, squared: f32::INFINITY }; DETECTIONS_MAX];
        let met = self.meet(map, &mut compared, &mut matches, view);

        for (seen, found) in look.detections.iter().zip(&matches) {
            if let Some(known) = found.known.and_then(|index| map.known.get_mut(usize::from(index))) {
                self.refine(known, now, look, seen);
            }
        }
        for index in met {
            if let Some(known) = map.known.get(usize::from(index)) {
                compared.mark(known, self.config.cover_m);
            }
        }
        map.sweep();

        let mut wanted: Vec<u8, DETECTIONS_MAX> = Vec::new();
        for (index, (seen, found)) in look.detections.iter().zip(&matches).enumerate() {
            if seen.kind == Kind::Pillar {
                // The edge of a pillar at the edge of the view looks like a thin pillar of its own, and an average can
                // shift a pillar off the hits of a neighbour.
                let by = if found.known.is_none() { BY_ROUND } else { COVERED };
                if !compared.is_covered(index, by)
                    && let Some(known) = self.known_of(map, now, seen)
                {
                    compared.mark(&known, self.config.cover_m);
                    let _ = wanted.push(index as u8);
                }
            }
        }
        for (index, seen) in look.detections.iter().enumerate() {
            if seen.kind == Kind::Patch
                && !compared.is_covered(index, COVERED)
                && let Some(known) = self.known_of(map, now, seen)
            {
                compared.mark(&known, self.config.cover_m);
                let _ = wanted.push(index as u8);
            }
        }
        self.add_nearest(map, now, look, &mut wanted);
    }

    /// Compares every known circle with the look: is it seen through, is it one of the pillars seen, which hits does it
    /// cover. Those that may be one of the pillars are returned, and cover nothing yet.
    fn meet(
        &self,
        map: &mut Map,
        compared: &mut Comparison<'_>,
        matches: &mut [Match],
        view: Option<&View<'_>>,
    ) -> Vec<u8, CIRCLES_MAX> {
        let look = compared.look;
        let mut met = Vec::new();
        let mut judged = 0;
        let mut resume = 0;
        let range_m = view.map_or(0.0, |view| view.scan.range_max_m);
        for (index, known) in map.known.iter_mut().enumerate() {
            let away = known.circle.center_ned_m.minus(look.origin_ned_m);
            let squared = away.norm_squared();
            if let Some(view) = view
                && judged < JUDGED_MAX
                && index >= usize::from(map.resume)
                && squared >= known.radius_m * known.radius_m
                && squared <= range_m * range_m
            {
                judged += 1;
                resume = index + 1;
                let passes = view.passes(known, away, squared * inverse_root(squared));
                known.clear_looks = if passes { known.clear_looks.saturating_add(1) } else { 0 };
                if known.clear_looks >= self.config.clear_looks {
                    known.clear_looks = DOOMED;
                    continue;
                }
            }
            let reach_m = compared.reach_m + known.radius_m;
            if squared > reach_m * reach_m {
                continue;
            }
            if !compared.pillars.is_empty() {
                let is_round = known.is_round();
                let larger_m =
                    if known.radius_m > compared.pillar_max_m { known.radius_m } else { compared.pillar_max_m };
                let reach_m = if is_round { GATE_M + GATE * larger_m } else { compared.pillar_max_m + STICK_OUT_M };
                let mut is_met = false;
                compared.pillars.near(away, reach_m, |pillar| {
                    let (Some(seen), Some(found)) = (look.detections.get(pillar), matches.get_mut(pillar)) else {
                        return;
                    };
                    let squared = known.circle.center_ned_m.minus(seen.center_ned_m).norm_squared();
                    if is_round {
                        let larger_m = if known.radius_m > seen.radius_m { known.radius_m } else { seen.radius_m };
                        let gate_m = GATE_M + GATE * larger_m;
                        if squared < gate_m * gate_m {
                            is_met = true;
                            if squared < found.squared {
                                *found = Match { known: Some(index as u8), squared };
                            }
                        }
                    } else {
                        let inside_m = seen.radius_m + STICK_OUT_M - known.radius_m;
                        if inside_m > 0.0 && squared < inside_m * inside_m {
                            known.clear_looks = DOOMED;
                        }
                    }
                });
                if known.clear_looks == DOOMED {
                    continue;
                }
                if is_met {
                    // Cannot fail: as many places as circles.
                    let _ = met.push(index as u8);
                    continue;
                }
            }
            compared.mark(known, self.config.cover_m);
        }
        // The rest is judged in the next look.
        map.resume = if judged == JUDGED_MAX { resume as u8 } else { 0 };
        met
    }

    /// Takes in circles from a sensor that delivers circles: what it says replaces what was known.
    pub fn observe_circles(&self, map: &mut Map, now: Instant, vehicle_ned_m: Horizontal, circles: &[Circle]) {
        self.advance(map, now);
        map.updated = Some(now);
        let (taken, left) = circles.split_at(circles.len().min(DELIVERY_MAX));
        map.overflow_count = map.overflow_count.saturating_add(left.len() as u32);
        let now_ms = millis(now);
        for circle in taken {
            if !circle.is_plausible() {
                map.refuse(1);
                continue;
            }
            let known = Known {
                circle: *circle,
                radius_m: circle.radius_m,
                sigma_m: SIGMA_MIN_M,
                slope_ned_mps: circle.velocity_ned_mps,
                motion: Motion::of(circle.velocity_ned_mps),
                seen_ms: now_ms,
                origin: Origin::Given,
                clear_looks: 0,
            };
            let near_m = 0.05 + 0.25 * circle.radius_m;
            let same = |k: &&mut Known| {
                if k.seen_ms == now_ms && k.origin == Origin::Given {
                    // Two circles of one delivery are two obstacles, however near, unless they are one and the same.
                    return k.circle == *circle;
                }
                let away = k.circle.center_ned_m.minus(circle.center_ned_m);
                libm::fabsf(away.north) < near_m
                    && away.norm_squared() < near_m * near_m
                    && libm::fabsf(k.radius_m - circle.radius_m) < 0.05
            };
            match map.known.iter_mut().find(same) {
                Some(old) => *old = known,
                None => map.add(known, vehicle_ned_m),
            }
        }
        // What was pieced together from hits is superseded where the sensor names the whole.
        if map.known.iter().any(|k| k.origin != Origin::Given) {
            for circle in taken {
                map.known.retain(|k| k.origin == Origin::Given || !holds(circle, k));
            }
        }
    }

    /// Carries moving circles along and forgets those that were unseen for too long.
    pub fn advance(&self, map: &mut Map, now: Instant) {
        let dt_s = now.seconds_since(map.carried);
        map.carried = now;
        if map.known.iter().all(|known| known.circle.velocity_ned_mps == Horizontal::default()) {
            return;
        }
        let (memory_s, now_ms) = (self.config.moving_memory_s, millis(now));
        map.known.retain_mut(|known| {
            let velocity = known.circle.velocity_ned_mps;
            if velocity.norm_squared() == 0.0 {
                return true;
            }
            known.circle.center_ned_m = known.circle.center_ned_m.plus(velocity.times(dt_s));
            seconds_between(known.seen_ms, now_ms) <= memory_s && known.circle.is_plausible()
        });
    }

    /// Averages a pillar into the known one that it is.
    fn refine(&self, known: &mut Known, now: Instant, look: &Look, seen: &Detection) {
        let now_ms = millis(now);
        known.clear_looks = 0;
        let margin_m = self.config.cover_m;
        let points = look.points_of(seen);
        let is_glimpse = seen.sigma_m > 2.0 * known.sigma_m && points.iter().all(|p| known.covers(*p, margin_m));
        if !is_glimpse {
            let dt_s = seconds_between(known.seen_ms, now_ms);
            let share = known.sigma_m * known.sigma_m / (known.sigma_m * known.sigma_m + seen.sigma_m * seen.sigma_m);
            let sighting = Sighting { center: seen.center_ned_m, sigma_m: seen.sigma_m, share, dt_s };
            let (center, least_mps) = (known.circle.center_ned_m, self.config.moving_min_mps);
            known.circle.center_ned_m = known.motion.step(&mut known.slope_ned_mps, center, &sighting, least_mps);
            known.radius_m += (seen.radius_m - known.radius_m) * share;
            let sigma_m = known.sigma_m * sqrt(1.0 - share);
            known.sigma_m = if sigma_m > SIGMA_MIN_M { sigma_m } else { SIGMA_MIN_M };
            if !points.iter().all(|p| known.covers(*p, margin_m)) {
                known.circle.center_ned_m = seen.center_ned_m;
                known.radius_m = seen.radius_m;
                known.sigma_m = seen.sigma_m;
            }
            known.origin = Origin::Seen(Kind::Pillar);
            known.circle.radius_m = known.radius_m + self.config.inflation_sigmas * known.sigma_m;
            known.circle.velocity_ned_mps =
                if known.motion.moves() { known.slope_ned_mps } else { Horizontal::default() };
        }
        known.seen_ms = now_ms;
    }

    /// What was seen, as it would be remembered; nothing, and counted, if it is absurd.
    fn known_of(&self, map: &mut Map, now: Instant, seen: &Detection) -> Option<Known> {
        let circle = Circle {
            center_ned_m: seen.center_ned_m,
            radius_m: seen.radius_m + self.config.inflation_sigmas * seen.sigma_m,
            velocity_ned_mps: Horizontal::default(),
        };
        if !circle.is_plausible() || !(seen.sigma_m > 0.0) {
            map.refuse(1);
            return None;
        }
        Some(Known {
            circle,
            radius_m: seen.radius_m,
            sigma_m: seen.sigma_m,
            slope_ned_mps: Horizontal::default(),
            motion: Motion::default(),
            seen_ms: millis(now),
            origin: Origin::Seen(seen.kind),
            clear_looks: 0,
        })
    }

    /// Adds what is wanted. Where there is no room for all of it, the nearest few come first and the rest is counted: it
    /// will be seen again.
    fn add_nearest(&self, map: &mut Map, now: Instant, look: &Look, wanted: &mut Vec<u8, DETECTIONS_MAX>) {
        let room = CIRCLES_MAX - map.known.len();
        let places =
            if wanted.len() <= room + CROWDED_MAX { wanted.len() } else { room.min(CROWDED_MAX) + CROWDED_MAX };
        if wanted.len() > room {
            let squared = |index: u8| {
                let seen = look.detections.get(usize::from(index));
                seen.map_or(f32::INFINITY, |seen| seen.face_ned_m.minus(look.origin_ned_m).norm_squared())
            };
            let mut keyed: Vec<(f32, u8), DETECTIONS_MAX> = Vec::new();
            for index in wanted.iter() {
                let _ = keyed.push((squared(*index), *index));
            }
            let mut rest = keyed.as_mut_slice();
            for place in wanted.iter_mut().take(places) {
                let Some((first, others)) = core::mem::take(&mut rest).split_first_mut() else { break };
                let (mut least, mut least_squared) = (None, first.0);
                for other in others.iter_mut() {
                    if other.0 < least_squared {
                        least_squared = other.0;
                        least = Some(other);
                    }
                }
                if let Some(least) = least {
                    core::mem::swap(first, least);
                }
                *place = first.1;
                rest = others;
            }
        }
        map.overflow_count = map.overflow_count.saturating_add((wanted.len() - places) as u32);
        wanted.truncate(places);
        for index in wanted.iter() {
            if let Some(known) = look.detections.get(usize::from(*index)).and_then(|seen| self.known_of(map, now, seen))
            {
                map.add(known, look.origin_ned_m);
            }
        }
    }
}

/// Whether a circle is inside another, but for what a bad fit may stick out.
fn holds(outer: &Circle, inner: &Known) -> bool {
    let reach_m = outer.radius_m + STICK_OUT_M - inner.radius_m;
    let away = outer.center_ned_m.minus(inner.circle.center_ned_m);
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
