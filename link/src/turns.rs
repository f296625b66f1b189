//! Joins the several `OBSTACLE_DISTANCE` messages of one turn of a fine lidar into one scan: 72 distances each, of one
//! increment, at offsets that continue each other.
//!
//! A message of a sensor that has only ever sent one offset is a scan by itself, at once. Where another message
//! continues it, the two are joined, and so on until an offset repeats: from then on that many messages make a turn,
//! and the scan is ready with the last of them. It is ready sooner where it closes a full turn; where a message was
//! lost, it is ready, with what has come, when the next turn begins or [`TURN_MAX_US`] after the first message. Missing
//! rays are unknown, except in directions in which a sensor that reports only what it has seen has seen nothing
//! ([`crate::beams`]).
//!
//! Each ray has its newest reading. A message comes when its last ray has been measured, so the messages of a turn tell how fast the
//! sensor turns; the time of a scan is that of its middle ray. A turn of more than 360 rays is joined up to 360.

use core::f32::consts::PI;

use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::mapping::scan::{RAYS_MAX, Rays, Scan, Sector};

use crate::beams::{DIRECTIONS, EACH_DEG, FIRST_DEG, RAYS_EACH};
use crate::clock::is_over;
use crate::obstacles::{FULL_TURN_DEG, Part};

/// No turn takes longer.
const TURN_MAX_US: u64 = 300_000;
/// Messages of one turn are off a common grid of rays by less than this.
const OFF_GRID_MAX: f32 = 0.25;

/// A bit for each ray.
#[derive(Clone, Copy, Debug)]
struct Bits([u32; RAYS_MAX.div_ceil(32)]);

impl Bits {
    const NONE: Self = Self([0; RAYS_MAX.div_ceil(32)]);

    fn has(&self, ray: usize) -> bool {
        self.0.get(ray / 32).is_some_and(|word| word >> (ray % 32) & 1 != 0)
    }

    fn set(&mut self, ray: usize) {
        if let Some(word) = self.0.get_mut(ray / 32) {
            *word |= 1 << (ray % 32);
        }
    }

    fn count(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }
}

/// How fast the sensor turns, by the times of its messages.
#[derive(Clone, Copy, Debug)]
struct Pace {
    /// When the first message of this turn came, and the ray behind its last.
    began: Instant,
    first_to: usize,
    /// When the last one came, and the same.
    heard_last: Instant,
    last_to: usize,
    /// The ray that is next if the sensor goes on.
    next_from: usize,
    /// Whether each message came after the one before.
    is_in_order: bool,
    has_gap: bool,
    messages: u8,
    /// Time from a ray to the next in the last turn that told it; 0 if none did.
    each_s: f32,
}

impl Pace {
    const UNKNOWN: Self = Self {
        began: Instant(0),
        first_to: 0,
        heard_last: Instant(0),
        last_to: 0,
        next_from: 0,
        is_in_order: true,
        has_gap: false,
        messages: 0,
        each_s: 0.0,
    };

    /// A message has come, of rays from one to before another, with room for so many.
    fn hear(&mut self, now: Instant, from: usize, to: usize, count: usize) {
        if self.messages == 0 {
            (self.began, self.first_to, self.is_in_order, self.has_gap) = (now, to, true, false);
        } else {
            self.is_in_order &= from >= self.last_to;
            self.has_gap |= from > self.next_from;
        }
        (self.heard_last, self.last_to, self.next_from) = (now, to, from + count);
        self.messages = self.messages.saturating_add(1);
    }

    /// How long a turn of so many rays took, and the time of its middle. A message comes when its last ray has been
    /// measured. One message does not tell how long a turn takes, nor do those around a lost one, which may be of
    /// directions that come independently: then it is as in the turn before.
    fn end(&mut self, rays: usize) -> (f32, Instant) {
        let took_us = self.heard_last.micros_since(self.began);
        if self.is_in_order && !self.has_gap && self.messages > 1 {
            self.each_s = took_us as f32 * 1e-6 / (self.last_to as f32 - self.first_to as f32);
        }
        let rays = rays as f32;
        let turn_s = self.each_s * rays;
        if self.is_in_order && turn_s <= TURN_MAX_US as f32 * 1e-6 {
            let since_middle_s = self.each_s * (self.last_to as f32 - 0.5 * rays);
            (turn_s, Instant(self.heard_last.0.saturating_sub((1e6 * since_middle_s) as u64)))
        } else {
            (0.0, self.began.plus_micros(took_us / 2))
        }
    }
}

/// The rays gathered so far, and the scan made of them.
#[derive(Clone, Debug)]
pub(crate) struct Turns {
    scan: Scan,
    /// It has not been taken yet.
    is_new: bool,
    /// The component that sent it.
    component_id: u8,
    /// Azimuth of ray 0, as the messages count.
    first_deg: f32,
    step_deg: f32,
    /// Directions that are clear where nothing is reported about them.
    untold: u8,
    pace: Pace,
    /// Angles of the last message count from north.
    is_from_north: bool,
    /// Messages of the last turn: while this one has fewer there is no scan yet.
    messages_before: u8,
    /// The rays that were received in this turn, and those with which a message began.
    heard: Bits,
    begun: Bits,
}

impl Turns {
    pub(crate) const fn new() -> Self {
        Self {
            scan: Scan {
                time: Instant(0),
                turn_s: 0.0,
                first_azimuth_rad: 0.0,
                step_rad: 1.0,
                range_max_m: 1.0,
                rays: Rays::new(),
            },
            is_new: false,
            component_id: 0,
            first_deg: 0.0,
            step_deg: 0.0,
            untold: 0,
            pace: Pace::UNKNOWN,
            is_from_north: false,
            messages_before: 1,
            heard: Bits::NONE,
            begun: Bits::NONE,
        }
    }

    /// The scan that has not been taken.
    pub(crate) fn scan(&self) -> Option<&Scan> {
        self.is_new.then_some(&self.scan)
    }

    /// The scan has been taken.
    pub(crate) fn take(&mut self) {
        self.is_new = false;
    }

    /// Forgets all of it.
    pub(crate) fn clear(&mut self) {
        (self.is_new, self.messages_before, self.pace) = (false, 1, Pace::UNKNOWN);
        (self.heard, self.begun) = (Bits::NONE, Bits::NONE);
        self.scan.rays.resize(0);
    }

    /// The component that sent the last message.
    pub(crate) const fn component_id(&self) -> u8 {
        self.component_id
    }

    /// Drops a scan that has not been taken for that long, and stops waiting for a turn that does not end.
    pub(crate) fn age(&mut self, now: Instant, age_max_s: f32) {
        let Pace { messages, began, .. } = self.pace;
        if (1..self.messages_before).contains(&messages) && now.micros_since(began) > TURN_MAX_US {
            self.messages_before = messages;
            self.end();
        }
        if is_over(now, self.scan.time, age_max_s) {
            self.is_new = false;
        }
    }

    /// Takes in a message.
    #[inline(never)]
    pub(crate) fn hear(&mut self, now: Instant, component_id: u8, part: &Part<'_>) {
        let mut from = 0;
        match self.place(now, component_id, part) {
            // The turn began with another ray only because a message was lost.
            Some(ray) if self.begun.has(ray) && (self.heard.has(ray) || ray == 0 && self.pace.messages > 0) => {
                // The next turn. The rays of the one before are a scan, if they are not one yet.
                if self.pace.messages < self.messages_before {
                    self.end();
                }
                (self.messages_before, self.heard) = (core::mem::take(&mut self.pace.messages), Bits::NONE);
                from = ray;
            }
            Some(ray) if (ray..ray + said(part, ray)).all(|ray| !self.heard.has(ray)) => from = ray,
            _ => {
                self.clear();
                (self.component_id, self.first_deg, self.step_deg) = (component_id, part.first_deg, part.step_deg);
            }
        }
        let to = from + said(part, from);
        self.pace.hear(now, from, to, part.count);
        self.untold = part.untold;
        let scan = &mut self.scan;
        scan.step_rad = part.step_deg * (PI / 180.0);
        scan.range_max_m = part.range_max_m;
        self.is_from_north = part.yaw_rad.is_some();
        scan.first_azimuth_rad = wrap_pi(self.first_deg * (PI / 180.0) - part.yaw_rad.unwrap_or_default());
        let rays = scan.rays.len().max((from + part.count).min(room(part.step_deg)));
        scan.rays.resize(rays);
        for index in 0..said(part, from) {
            let ray = from + index;
            scan.rays.set(ray, part.sector(index));
            self.heard.set(ray);
        }
        self.begun.set(from);
        if self.pace.messages >= self.messages_before || self.is_whole() {
            self.end();
        }
    }

    /// The ray at which a message continues the turn; `None` where it does not belong to it.
    fn place(&self, now: Instant, component_id: u8, part: &Part<'_>) -> Option<usize> {
        let is_same = component_id == self.component_id
            && part.step_deg == self.step_deg
            && part.range_max_m == self.scan.range_max_m
            && now.micros_since(self.pace.began) <= TURN_MAX_US;
        let steps = (part.first_deg - self.first_deg) / part.step_deg;
        let whole = libm::roundf(steps);
        if !is_same || libm::fabsf(steps - whole) > OFF_GRID_MAX {
            return None;
        }
        let turn = libm::roundf(FULL_TURN_DEG / libm::fabsf(part.step_deg)) as i32;
        let ray = (whole as i32).wrapping_rem_euclid(turn.max(1)) as usize;
        (ray < room(part.step_deg)).then_some(ray)
    }

    /// Whether every ray of a full turn was received.
    fn is_whole(&self) -> bool {
        let turn = self.scan.turn();
        turn.is_some_and(|turn| self.heard.count() >= turn)
    }

    /// Whether a ray is in a direction in which nothing was ever seen.
    fn is_untold(&self, ray: usize) -> bool {
        let first = libm::roundf((self.first_deg - FIRST_DEG) / EACH_DEG) as usize;
        self.untold >> ((first + ray / RAYS_EACH) % usize::from(DIRECTIONS)) & 1 != 0
    }

    /// Ends the turn: what has come is a scan.
    fn end(&mut self) {
        for ray in 0..self.scan.rays.len() {
            if !self.heard.has(ray) {
                let told = if self.is_untold(ray) { Sector::Clear } else { Sector::Unknown };
                self.scan.rays.set(ray, told);
            }
        }
        let told = self.pace.end(self.scan.rays.len());
        // Angles from north were turned by the heading of the moment when they came.
        let at_once = (0.0, self.pace.heard_last);
        (self.scan.turn_s, self.scan.time) = if self.is_from_north { at_once } else { told };
        self.is_new = true;
    }
}

/// Rays of a turn, up to the limit.
fn room(step_deg: f32) -> usize {
    let turn = libm::roundf(FULL_TURN_DEG / libm::fabsf(step_deg));
    if turn < RAYS_MAX as f32 { turn as usize } else { RAYS_MAX }
}

/// How many rays a message that begins at `from` covers: those behind the last known one may belong to the next turn.
fn said(part: &Part<'_>, from: usize) -> usize {
    let mut said = part.count.min(room(part.step_deg) - from);
    while said > 1 && part.sector(said - 1) == Sector::Unknown {
        said -= 1;
    }
    said
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use foxhound_core::base::rng::Rng;

    use super::*;
    use crate::dialect::OBSTACLE_DISTANCE_DATA;
    use crate::obstacles::{Reading, part};

    const NOSE: Reading = Reading { yaw_rad: None, zero_touches: false, untold: 0 };

    fn message(first_deg: f32, step_deg: f32, distances_cm: &[u16]) -> OBSTACLE_DISTANCE_DATA {
        OBSTACLE_DISTANCE_DATA {
            distances: core::array::from_fn(|index| distances_cm.get(index).copied().unwrap_or(u16::MAX)),
            increment_f: step_deg,
            angle_offset: first_deg,
            min_distance: 5,
            max_distance: 1200,
            ..OBSTACLE_DISTANCE_DATA::DEFAULT
        }
    }

    fn hear(turns: &mut Turns, at_ms: u64, message: &OBSTACLE_DISTANCE_DATA) {
        turns.hear(Instant(1000 * at_ms), 7, &part(message, NOSE).unwrap());
    }

    /// What a scan says in so many directions of a turn, centimetres; 0 where nothing is known.
    fn around(scan: &Scan, rays: usize) -> Vec<u16> {
        let step_rad = scan.step_rad;
        let mut around = std::vec![0; rays];
        for (index, sector) in scan.rays.iter().enumerate() {
            let azimuth_rad = scan.first_azimuth_rad + step_rad * index as f32;
            let at = (azimuth_rad / step_rad.abs()).round() as i32;
            if let Sector::Hit(range_m) = sector {
                around[at.rem_euclid(rays as i32) as usize] = (100.0 * range_m).round() as u16;
            }
        }
        around
    }

    #[test]
    fn five_messages_make_a_turn_from_the_second_on_whichever_comes_first() {
        for first in 0..5 {
            let mut turns = Turns::new();
            for count in 0..20 {
                let number = (first + count) % 5;
                let distances: Vec<u16> = (0..72).map(|ray| 100 + 72 * number + ray).collect();
                hear(&mut turns, 20 * u64::from(count), &message(f32::from(72 * number), 1.0, &distances));
                let scan = turns.scan().cloned();
                turns.take();
                let is_last = count % 5 == 4;
                assert_eq!(scan.is_some(), count < 5 || is_last, "the first turn bit by bit, then whole ones");
                if is_last {
                    let scan = scan.unwrap();
                    assert_eq!(scan.turn(), Some(360));
                    assert_eq!(around(&scan, 360), (100..460).collect::<Vec<_>>());
                    assert_eq!(scan.time, Instant(20_000 * u64::from(count) - 50_000), "the middle");
                    assert!((scan.turn_s - 0.1).abs() < 1e-6, "{}", scan.turn_s);
                }
            }
        }
    }

    #[test]
    fn what_is_lost_is_unknown_and_the_rest_is_a_scan_when_the_next_turn_begins_or_none_does() {
        let mut turns = Turns::new();
        let part_of = |number: u16| message(f32::from(72 * number), 1.0, &[100 + number; 72]);
        (0..5).for_each(|number| hear(&mut turns, 20 * u64::from(number), &part_of(number)));
        turns.take();
        for number in [0, 1, 3, 4] {
            hear(&mut turns, 100 + 20 * u64::from(number), &part_of(number));
        }
        assert!(turns.scan().is_none(), "one is missing");
        hear(&mut turns, 200, &part_of(0));
        let known = |scan: &Scan| scan.rays.iter().filter(|sector| *sector != Sector::Unknown).count();
        let scan = turns.scan().unwrap();
        assert_eq!((known(scan), scan.time), (288, Instant(130_000)), "as long as the turn before");
        assert!((scan.turn_s - 0.1).abs() < 1e-6, "{}", scan.turn_s);
        turns.take();
        hear(&mut turns, 220, &part_of(1));
        turns.age(Instant(450_000), 0.5);
        assert!(turns.scan().is_none());
        turns.age(Instant(510_000), 0.5);
        assert_eq!(turns.scan().map(known), Some(144), "the sensor fell silent");
        turns.age(Instant(900_000), 0.5);
        assert!(turns.scan().is_none(), "too old");
    }

    #[test]
    fn angles_from_north_are_of_the_heading_when_they_came_however_long_the_turn() {
        let mut turns = Turns::new();
        for number in 0..10_u8 {
            let from_north = Reading { yaw_rad: Some(0.01 * f32::from(number)), ..NOSE };
            let message = message(72.0 * f32::from(number % 5), 1.0, &[200; 72]);
            let now = Instant(20_000 * u64::from(number));
            turns.hear(now, 7, &part(&message, from_north).unwrap());
            let scan = turns.scan().unwrap();
            if number % 5 == 4 {
                assert_eq!((scan.turn_s, scan.time), (0.0, now));
                assert!((scan.first_azimuth_rad + 0.01 * f32::from(number)).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn other_sensors_and_other_angles_begin_anew() {
        let mut turns = Turns::new();
        let base = message(-36.0, 1.0, &[200; 72]);
        for other in [
            message(-35.5, 1.0, &[200; 72]),
            message(0.0, 1.0, &[200; 72]),
            message(36.0, 2.0, &[200; 72]),
            OBSTACLE_DISTANCE_DATA { max_distance: 600, ..message(36.0, 1.0, &[200; 72]) },
        ] {
            hear(&mut turns, 0, &base);
            hear(&mut turns, 10, &other);
            assert_eq!(turns.scan().unwrap().rays.len(), 72, "{}", other.angle_offset);
        }
        hear(&mut turns, 20, &base);
        hear(&mut turns, 321, &message(36.0, 1.0, &[200; 72]));
        assert_eq!(turns.scan().unwrap().rays.len(), 72, "of another turn");
        turns.hear(Instant(322_000), 8, &part(&message(108.0, 1.0, &[200; 72]), NOSE).unwrap());
        assert_eq!(turns.scan().unwrap().rays.len(), 72, "another's");
    }

    #[test]
    fn nothing_is_lost_and_no_ray_is_older_than_it_may_be() {
        let (mut scans, mut said_rays) = (0, 0);
        for seed in 0..400 {
            let mut rng = Rng::new(seed, 3);
            let mut below = |count: u32| ((rng.uniform() * count as f32) as u32).min(count - 1);
            // Rays of a turn, of how many of them something is told, in messages of so many, and what is lost of a hundred.
            let rays = [72_usize, 100, 180, 240, 300, 360][below(6) as usize];
            let told = if below(2) == 0 { rays } else { rays / 2 };
            let each = [36_usize, 60, 72][below(3) as usize].min(told);
            let messages = told.div_ceil(each);
            let (lost, period_ms) = ([0, 0, 10, 40][below(4) as usize], u64::from(60 + below(140)));
            let step_deg = 360.0 / rays as f32;
            let mut turns = Turns::new();
            let mut number = 0_u16;
            // When each ray was last told of, what it was, and whether a scan has said so.
            let mut truth = std::vec![(0_u64, 0_u16, true); rays];
            for count in below(5) as usize..80 {
                let at_ms = 1000 + count as u64 * period_ms / messages as u64;
                turns.age(Instant(1000 * at_ms), 0.5);
                let from = count % messages * each;
                if below(100) >= lost {
                    let mut distances = Vec::new();
                    for ray in &mut truth[from..(from + each).min(told)] {
                        number = number % 1000 + 1;
                        distances.push(number);
                        *ray = (at_ms, number, false);
                    }
                    hear(&mut turns, at_ms, &message(step_deg * from as f32, step_deg, &distances));
                }
                if below(3) > 0
                    && let Some(scan) = turns.scan().cloned()
                {
                    turns.take();
                    scans += 1;
                    for (heard, truth) in around(&scan, rays).into_iter().zip(&mut truth) {
                        // The newest that was heard, or nothing.
                        assert!(heard == 0 || heard == truth.1, "{seed} {count}");
                        if heard != 0 {
                            said_rays += 1;
                            truth.2 = true;
                            assert!((1000 * truth.0).abs_diff(scan.time.0) <= TURN_MAX_US, "{seed} {count}");
                        }
                    }
                }
                for (ray, (told_ms, _, is_said)) in truth.iter().enumerate() {
                    // Until the next turn has begun, or nobody waits for it any more, and somebody took it.
                    let most_ms = 300 + 12 * period_ms / messages as u64 + period_ms;
                    assert!(*is_said || at_ms - told_ms <= most_ms, "{seed} {count}: ray {ray}");
                }
            }
        }
        assert!(scans > 5_000 && said_rays > 500_000, "{scans} {said_rays}");
    }

    #[test]
    fn directions_make_a_turn_and_those_that_were_never_told_are_clear_in_it() {
        use crate::beams::Beams;
        use crate::dialect::DISTANCE_SENSOR_DATA;
        let (mut turns, mut beams) = (Turns::new(), Beams::new());
        let mut told = |turns: &mut Turns, at_ms: u64, orientation: u8, current_distance: u16| {
            let beam = DISTANCE_SENSOR_DATA {
                id: 10 + orientation,
                orientation,
                max_distance: 600,
                current_distance,
                ..DISTANCE_SENSOR_DATA::DEFAULT
            };
            let (message, untold) = beams.sector(1, true, &beam).unwrap();
            turns.hear(Instant(1000 * at_ms), 1, &part(&message, Reading { untold, ..NOSE }).unwrap());
        };
        // What the middle of each direction says, and whether all nine rays say the same.
        let middles = |scan: &Scan| {
            let first = (scan.first_azimuth_rad.to_degrees() + 20.0) / 45.0;
            let at = |direction: usize| (direction + 8 - first.round() as usize) % 8 * 9;
            (0..8)
                .map(|direction| {
                    let rays: Vec<_> = (0..9).map(|ray| scan.rays.get(at(direction) + ray)).collect();
                    assert!(rays.iter().all(|ray| *ray == rays[4]), "{rays:?}");
                    rays[4]
                })
                .collect::<Vec<_>>()
        };
        told(&mut turns, 0, 0, 300);
        told(&mut turns, 0, 2, 200);
        let scan = turns.scan().unwrap();
        let (clear, hit) = (Sector::Clear, Sector::Hit);
        assert_eq!(middles(scan), [hit(3.0), clear, hit(2.0), clear, clear, clear, clear, clear]);
        turns.take();
        for (at_ms, nearer_cm) in [(100, 10), (200, 20), (700, 30)] {
            told(&mut turns, at_ms, 0, 600);
            told(&mut turns, at_ms, 1, 250 - nearer_cm);
            told(&mut turns, at_ms, 2, 200 - nearer_cm);
            let near = |cm: u16| hit(f32::from(cm - nearer_cm) / 100.0);
            assert_eq!(
                middles(turns.scan().unwrap()),
                [clear, near(250), near(200), clear, clear, clear, clear, clear]
            );
            turns.take();
        }
        // One is lost: unknown, until the next turn.
        told(&mut turns, 800, 0, 600);
        told(&mut turns, 800, 1, 240);
        assert!(turns.scan().is_none());
        told(&mut turns, 900, 0, 600);
        assert_eq!(middles(turns.scan().unwrap())[..4], [clear, hit(2.4), Sector::Unknown, clear]);
    }
}
