//! The obstacle map: a bounded store of circles, remembered once seen.
//!
//! A detection that meets a known circle is averaged into it with the weight of its precision, one that lies inside a
//! better known circle is a glimpse of it and adds nothing, and one that meets none is added; when the store is full the farthest circle from the vehicle gives way and [`Map::overflow_count`] says so. A
//! circle through whose centre the sensor looks freely is forgotten. Circles that move are carried along and forgotten
//! when unseen for a while.

use heapless::Vec;

use crate::error::{ConfigError, check};
use crate::frame::Horizontal;
use crate::scan::{Detection, Pose, Scan, Sector};
use crate::time::Instant;
use crate::units::wrap_pi;

/// Most circles that are remembered.
pub const CIRCLES_MAX: usize = 64;

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
    /// Looks through a circle's centre before it is forgotten.
    pub clear_looks: u8,
}

impl Default for Config {
    fn default() -> Self {
        Self { moving_memory_s: 3.0, clear_looks: 3 }
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
        Ok(Keeper { config: *self })
    }
}

/// The configured stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keeper {
    config: Config,
}

/// A remembered circle.
#[derive(Clone, Copy, Debug)]
struct Known {
    circle: Circle,
    /// One over the variance of centre and radius.
    information: f32,
    seen: Instant,
    /// Until when `circle` has been carried along.
    carried: Instant,
    clear_looks: u8,
}

/// The store.
#[derive(Clone, Debug, Default)]
pub struct Map {
    known: Vec<Known, CIRCLES_MAX>,
    updated: Option<Instant>,
    overflow_count: u32,
    refused_count: u32,
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

    /// Circles that gave way because the store was full.
    #[must_use]
    pub fn overflow_count(&self) -> u32 {
        self.overflow_count
    }

    /// Circles refused because they were not finite, negative or absurd.
    #[must_use]
    pub fn refused_count(&self) -> u32 {
        self.refused_count
    }

    /// Adds a circle; the farthest from the vehicle gives way when the store is full.
    fn add(&mut self, known: Known, vehicle_ned_m: Horizontal) {
        if let Err(known) = self.known.push(known) {
            self.overflow_count = self.overflow_count.saturating_add(1);
            let distance = |k: &Known| k.circle.center_ned_m.minus(vehicle_ned_m).norm() - k.circle.radius_m;
            let mut far: Option<&mut Known> = None;
            for candidate in &mut self.known {
                if far.as_ref().is_none_or(|f| distance(candidate) > distance(f)) {
                    far = Some(candidate);
                }
            }
            if let Some(far) = far
                && distance(far) > distance(&known)
            {
                *far = known;
            }
        }
    }
}

impl Keeper {
    /// Takes in what was fitted to one scan.
    pub fn observe_scan(&self, map: &mut Map, now: Instant, scan: &Scan, pose: &Pose, detections: &[Detection]) {
        map.updated = Some(now);
        for detection in detections {
            let circle = Circle {
                center_ned_m: detection.center_ned_m,
                radius_m: detection.radius_m,
                velocity_ned_mps: Horizontal::default(),
            };
            if !circle.is_plausible() || !(detection.sigma_m > 0.0) {
                map.refused_count = map.refused_count.saturating_add(1);
                continue;
            }
            let information = 1.0 / (detection.sigma_m * detection.sigma_m);
            let known = Known { circle, information, seen: now, carried: now, clear_looks: 0 };
            // The edge of a pillar at the edge of the view looks like a thin pillar of its own.
            let glimpse = |k: &&mut Known| k.information > information && holds(&k.circle, &circle);
            if let Some(old) = map.known.iter_mut().find(glimpse) {
                old.seen = now;
                old.clear_looks = 0;
                continue;
            }
            map.known.retain(|k| k.information > information || !holds(&circle, &k.circle));
            match map.known.iter_mut().find(|k| meets(&k.circle, &circle)) {
                Some(old) => {
                    let share = information / (old.information + information);
                    let shift = circle.center_ned_m.minus(old.circle.center_ned_m).times(share);
                    old.circle.center_ned_m = old.circle.center_ned_m.plus(shift);
                    old.circle.radius_m += (circle.radius_m - old.circle.radius_m) * share;
                    // Capped, so that the map follows if the vehicle's own position drifts.
                    let sum = old.information + information;
                    old.information = if sum < 1e5 { sum } else { 1e5 };
                    old.seen = now;
                    old.clear_looks = 0;
                }
                None => map.add(known, pose.position_ned_m),
            }
        }
        self.forget_seen_through(map, scan, pose);
    }

    /// Takes in circles from a sensor that delivers circles: what it says replaces what was known.
    pub fn observe_circles(&self, map: &mut Map, now: Instant, vehicle_ned_m: Horizontal, circles: &[Circle]) {
        map.updated = Some(now);
        for circle in circles {
            if !circle.is_plausible() {
                map.refused_count = map.refused_count.saturating_add(1);
                continue;
            }
            let known = Known { circle: *circle, information: 1e6, seen: now, carried: now, clear_looks: 0 };
            let same = |k: &&mut Known| {
                let apart = k.circle.center_ned_m.minus(circle.center_ned_m).norm();
                apart < 0.05 + 0.25 * circle.radius_m && libm::fabsf(k.circle.radius_m - circle.radius_m) < 0.05
            };
            match map.known.iter_mut().find(same) {
                Some(old) => *old = known,
                None => map.add(known, vehicle_ned_m),
            }
        }
    }

    /// Carries moving circles along and forgets those that were unseen for too long.
    pub fn advance(&self, map: &mut Map, now: Instant) {
        let memory_s = self.config.moving_memory_s;
        map.known.retain_mut(|known| {
            let moves = known.circle.velocity_ned_mps.norm_squared() > 0.0;
            if !moves {
                return true;
            }
            let dt_s = now.seconds_since(known.carried);
            known.circle.center_ned_m = known.circle.center_ned_m.plus(known.circle.velocity_ned_mps.times(dt_s));
            known.carried = now;
            now.seconds_since(known.seen) <= memory_s
        });
    }

    /// Forgets circles through whose centre the sensor sees something farther, or nothing.
    fn forget_seen_through(&self, map: &mut Map, scan: &Scan, pose: &Pose) {
        map.known.retain_mut(|known| {
            let away = known.circle.center_ned_m.minus(pose.position_ned_m);
            let distance = away.norm();
            if distance < known.circle.radius_m || distance > scan.range_max_m {
                return true;
            }
            let azimuth_rad = wrap_pi(away.bearing_rad() - pose.yaw_rad - scan.first_azimuth_rad);
            let index = libm::roundf(azimuth_rad / scan.step_rad);
            if !(index >= 0.0 && index < scan.sectors.len() as f32) {
                return true;
            }
            let seen_through = match scan.sectors.get(index as usize) {
                Some(Sector::Clear) => true,
                Some(Sector::Hit(range_m)) => *range_m > distance + known.circle.radius_m + 0.1,
                _ => false,
            };
            known.clear_looks = if seen_through { known.clear_looks.saturating_add(1) } else { 0 };
            known.clear_looks < self.config.clear_looks
        });
    }
}

/// Whether the inner circle is clearly smaller and inside the outer one, but for what a bad fit may stick out.
fn holds(outer: &Circle, inner: &Circle) -> bool {
    let apart = outer.center_ned_m.minus(inner.center_ned_m).norm();
    apart + inner.radius_m < outer.radius_m + 0.10 && inner.radius_m < 0.7 * outer.radius_m
}

/// Whether two circles are the same obstacle: the centre of one lies well inside the other.
fn meets(a: &Circle, b: &Circle) -> bool {
    let larger = if a.radius_m > b.radius_m { a.radius_m } else { b.radius_m };
    a.center_ned_m.minus(b.center_ned_m).norm() < 0.10 + 0.5 * larger
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan::SECTORS_MAX;
    use std::vec::Vec as StdVec;

    fn circle(north: f32, east: f32, radius_m: f32) -> Circle {
        Circle { center_ned_m: Horizontal { north, east }, radius_m, ..Circle::default() }
    }

    fn detection(north: f32, east: f32, radius_m: f32, sigma_m: f32) -> Detection {
        Detection { center_ned_m: Horizontal { north, east }, radius_m, sigma_m }
    }

    fn unknown_scan() -> Scan {
        Scan {
            time: Instant(0),
            first_azimuth_rad: -0.7,
            step_rad: 0.02,
            range_max_m: 3.0,
            sectors: [Sector::Unknown; SECTORS_MAX],
        }
    }

    fn keeper() -> Keeper {
        Config::default().build().unwrap()
    }

    #[test]
    fn repeated_looks_at_one_pillar_sharpen_one_circle() {
        let (keeper, mut map) = (keeper(), Map::default());
        let looks = [detection(2.0, 0.1, 0.3, 0.05), detection(2.02, 0.0, 0.2, 0.01), detection(1.98, 0.0, 0.2, 0.01)];
        for look in looks {
            keeper.observe_scan(&mut map, Instant(1), &unknown_scan(), &Pose::default(), &[look]);
        }
        let circles: StdVec<_> = map.circles().collect();
        assert_eq!(circles.len(), 1);
        assert!((circles[0].center_ned_m.north - 2.0).abs() < 0.01 && (circles[0].radius_m - 0.2).abs() < 0.01);
    }

    #[test]
    fn a_glimpse_of_a_pillars_edge_adds_no_ghost_before_or_after_the_pillar_itself() {
        let keeper = keeper();
        let (pillar, glimpse) = (detection(2.0, 0.0, 0.3, 0.01), detection(1.85, 0.2, 0.05, 0.08));
        for looks in [[pillar, glimpse], [glimpse, pillar]] {
            let mut map = Map::default();
            for look in looks {
                keeper.observe_scan(&mut map, Instant(1), &unknown_scan(), &Pose::default(), &[look]);
            }
            let circles: StdVec<_> = map.circles().collect();
            assert_eq!(circles.len(), 1, "{circles:?}");
            assert!((circles[0].radius_m - 0.3).abs() < 1e-3);
        }
    }

    #[test]
    fn the_farthest_circle_gives_way_when_the_store_is_full() {
        let (keeper, mut map) = (keeper(), Map::default());
        for k in 0..CIRCLES_MAX as i32 + 10 {
            let far = circle(100.0 - k as f32, 0.0, 0.2);
            keeper.observe_circles(&mut map, Instant(1), Horizontal::default(), &[far]);
        }
        assert_eq!(map.circles().count(), CIRCLES_MAX);
        assert_eq!(map.overflow_count(), 10);
        assert!(map.circles().all(|c| c.center_ned_m.north < 91.0));
    }

    #[test]
    fn a_circle_that_is_seen_through_is_forgotten_after_three_looks() {
        let (keeper, mut map) = (keeper(), Map::default());
        keeper.observe_circles(
            &mut map,
            Instant(1),
            Horizontal::default(),
            &[circle(2.0, 0.0, 0.2), circle(-2.0, 0.0, 0.2)],
        );
        let scan = Scan { sectors: [Sector::Clear; SECTORS_MAX], ..unknown_scan() };
        for look in 0..3 {
            assert_eq!(map.circles().count(), 2, "{look}");
            keeper.observe_scan(&mut map, Instant(1), &scan, &Pose::default(), &[]);
        }
        assert_eq!(map.circles().count(), 1, "the one behind is out of sight and stays");
    }

    #[test]
    fn moving_circles_move_and_are_forgotten_when_unseen() {
        let (keeper, mut map) = (keeper(), Map::default());
        let mover = Circle { velocity_ned_mps: Horizontal { north: 0.5, east: 0.0 }, ..circle(1.0, 0.0, 0.2) };
        keeper.observe_circles(&mut map, Instant(0), Horizontal::default(), &[mover]);
        keeper.advance(&mut map, Instant(1_000_000));
        let north = map.circles().next().unwrap().center_ned_m.north;
        assert!((north - 1.5).abs() < 1e-3, "{north}");
        keeper.advance(&mut map, Instant(5_000_000));
        assert_eq!(map.circles().count(), 0);
    }

    #[test]
    fn absurd_circles_are_refused_at_the_door() {
        let (keeper, mut map) = (keeper(), Map::default());
        let bad = [
            circle(f32::NAN, 0.0, 0.2),
            circle(0.0, 0.0, -1.0),
            circle(0.0, 0.0, f32::INFINITY),
            circle(0.0, 0.0, 1e9),
        ];
        keeper.observe_circles(&mut map, Instant(0), Horizontal::default(), &bad);
        assert_eq!((map.circles().count(), map.refused_count()), (0, 4));
    }
}
