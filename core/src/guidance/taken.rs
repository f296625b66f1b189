//! At the end of a step the newest obstacle measurement is in the map and with the guard, or was refused; and
//! `StaleObstacles` depends on when the newest measurement in the map was made. Over 120 000 steps of random sequences:
//! sensors at any rate, with gaps and bursts, alternating and together, with and without frames, timestamps of any age,
//! telemetry that stands still, and clocks that jump.

use heapless::Vec;

use super::*;
use crate::base::ned::Ned;
use crate::base::rng::Rng;
use crate::base::units::wrap_pi;
use crate::mapping::map::CIRCLES_MAX;
use crate::mapping::scan::{Frame, POINTS_MAX, Ranges, Rays, Refusal, SECTORS_MAX, Sector};

const EPISODES: u64 = 240;
const STEPS: u32 = 500;
/// `mission::Config`'s default.
const STALE_S: f32 = 0.5;

/// The expected result of the input so far.
#[derive(Default)]
struct Expected {
    ownship: Option<Ownship>,
    taken: Option<Instant>,
    has_scanned: bool,
    /// By reason.
    refused: [u32; 5],
}

impl Expected {
    fn pose(&self, time: Instant) -> Result<(), Refusal> {
        let ownship = self.ownship.ok_or(Refusal::NoOwnship)?;
        let attitude_us = ownship.attitude_time.0;
        let has_yaw = (attitude_us.saturating_sub(300_000)..=attitude_us + 150_000).contains(&time.0);
        if time.0.abs_diff(ownship.position_time.0) > 300_000 || !has_yaw {
            return Err(Refusal::TimesApart);
        }
        Ok(())
    }

    fn take(&mut self, now: Instant, time: Instant, taken: Result<(), Refusal>) -> bool {
        match taken {
            Ok(()) => {
                let before = self.taken.filter(|before| *before <= now);
                self.taken = before.max(Some(time));
            }
            Err(refusal) => self.refused[refusal as usize] += 1,
        }
        taken.is_ok()
    }
}

fn below(rng: &mut Rng, count: u32) -> u32 {
    ((rng.uniform() * count as f32) as u32).min(count - 1)
}

/// A timestamp, mostly of a moment ago, sometimes of any time.
fn stamp(now: Instant, rng: &mut Rng) -> Instant {
    match below(rng, 20) {
        0 => Instant(now.0.saturating_sub(u64::from(below(rng, 2_000_000)))),
        1 => now.plus_micros(u64::from(below(rng, 1_000_000))),
        _ => Instant(now.0.saturating_sub(u64::from(below(rng, 60_000)))),
    }
}

/// The surroundings, the same for an episode; in a wild one they change everywhere each time.
struct World {
    is_wild: bool,
    wall_m: f32,
    beams_m: Vec<Horizontal, 8>,
    pillars: Vec<Circle, 64>,
}

impl World {
    fn new(is_wild: bool, rng: &mut Rng) -> Self {
        let mut world = Self { is_wild, wall_m: 0.5 + 2.0 * rng.uniform(), beams_m: Vec::new(), pillars: Vec::new() };
        world.beams_m = (0..8).map(|_| away(rng)).collect();
        world.pillars = (0..below(rng, 12)).map(|_| pillar(Horizontal::default(), rng)).collect();
        world
    }

    /// A scan, and whether it should be accepted.
    fn scan(&self, now: Instant, rng: &mut Rng) -> (Scan, Result<(), Refusal>) {
        const TURN_RAD: f32 = core::f32::consts::TAU;
        const RAYS: [(usize, f32); 7] = [
            (72, 0.0218),
            (72, 0.0291),
            (72, 0.0654),
            (72, TURN_RAD / 72.0),
            (360, TURN_RAD / 360.0),
            (360, 0.008),
            (100, TURN_RAD / 100.0),
        ];
        let (kind, (rays, step_rad)) = (below(rng, 12), RAYS[below(rng, 7) as usize]);
        let mut ray = |index: usize| match kind {
            0 => Sector::Hit(f32::NAN),
            1 => Sector::Clear,
            2..5 if self.is_wild => Sector::Hit(0.3 + 2.6 * rng.uniform()),
            2..5 => Sector::Hit(self.wall_m),
            6 => Sector::Unknown,
            5 if index.is_multiple_of(10) => Sector::Hit(f32::INFINITY),
            _ if (index / 6).is_multiple_of(2) => Sector::Hit(self.wall_m + 0.1 * (index / 12) as f32),
            _ if rng.uniform() < 0.1 => Sector::Unknown,
            _ => Sector::Clear,
        };
        let rays: Rays = (0..rays).map(&mut ray).collect();
        let first_azimuth_rad = -0.5 * (rays.len() - 1) as f32 * step_rad;
        let mut scan = Scan { time: stamp(now, rng), turn_s: 0.0, first_azimuth_rad, step_rad, range_max_m: 3.0, rays };
        let mut told = match kind {
            0 => Err(Refusal::Absurd),
            6 => Err(Refusal::Blind),
            _ => Ok(()),
        };
        if below(rng, 30) == 0 && kind != 6 {
            scan.step_rad = [0.0, f32::NAN, 9.0][below(rng, 3) as usize];
            told = Err(Refusal::Geometry);
        }
        (scan, told)
    }

    /// Single points, and whether they should be accepted.
    fn points(&self, now: Instant, rng: &mut Rng) -> (Points, Result<(), Refusal>) {
        let is_bad = below(rng, 10) == 0;
        let mut points = Points { time: stamp(now, rng), frame: Frame::Body, ..Points::default() };
        let count = below(rng, if self.is_wild { POINTS_MAX as u32 + 1 } else { 9 });
        for index in 0..count as usize {
            let beam_m = self.beams_m.get(index).copied().filter(|_| !self.is_wild).unwrap_or_else(|| away(rng));
            let _ = points.points_m.push(if is_bad { Horizontal { north: f32::NAN, ..beam_m } } else { beam_m });
        }
        (points, if is_bad && count > 0 { Err(Refusal::Absurd) } else { Ok(()) })
    }

    fn circles(&self, place: Horizontal, rng: &mut Rng) -> Vec<Circle, 64> {
        if self.is_wild { (0..below(rng, 65)).map(|_| pillar(place, rng)).collect() } else { self.pillars.clone() }
    }
}

fn away(rng: &mut Rng) -> Horizontal {
    Horizontal::from_bearing(wrap_pi(3.0 * rng.gaussian())).times(0.3 + 2.5 * rng.uniform())
}

fn pillar(place: Horizontal, rng: &mut Rng) -> Circle {
    Circle { center_ned_m: place.plus(away(rng)), radius_m: 0.1, ..Circle::default() }
}

/// Distance of a hit from the circles around it.
fn out_m(hit: Horizontal, circles: impl Iterator<Item = (Horizontal, f32)>) -> f32 {
    circles.map(|(center, radius_m)| hit.minus(center).norm() - radius_m).fold(f32::INFINITY, f32::min)
}

#[test]
fn the_newest_look_is_in_the_map_and_with_the_guard_or_is_refused() {
    let guidance = Config { reflections: false, ..Config::default() }.build::<64>().unwrap();
    let radius_m = Config::default().vehicle.radius_m;
    let mut snapshot = AdcFrame::<64>::zeroed();
    let (mut steps, mut scans_in_map, mut hits_in_map, mut hits_near) = (0_u32, 0_u32, 0_u32, 0_u32);
    let (mut stale, mut fresh) = (0_u32, 0_u32);
    let mut refused = [0_u32; 5];
    for episode in 0..EPISODES {
        let mut rng = Rng::new(episode, 77);
        let (mut state, mut expected) = (guidance.start(), Expected::default());
        let world = World::new(episode.is_multiple_of(4), &mut rng);
        // One step in this many has a delivery of each kind.
        let mut one_of = |of: [u32; 6]| of[below(&mut rng, 6) as usize];
        let (scan_every, points_every) = (one_of([1, 1, 2, 5, 12, 40]), one_of([1, 5, 9, 90, 900, 900]));
        let (circles_every, frame_every) = (one_of([2, 5, 900, 900, 900, 900]), one_of([1, 1, 2, 3, 9, 50]));
        let (mut now, mut gap, mut silence) = (Instant(10_000_000), 0, 20);
        let (mut place, mut yaw_rad) = (Horizontal::default(), 0.0_f32);
        for _ in 0..STEPS {
            steps += 1;
            now = match below(&mut rng, 400) {
                0 => Instant(now.0.saturating_sub(u64::from(below(&mut rng, 4_000_000)))),
                1 => now.plus_micros(u64::from(below(&mut rng, 4_000_000))),
                2..20 => now.plus_micros(u64::from(below(&mut rng, 100_000))),
                _ => now.plus_micros(20_000),
            };
            // Deliveries and telemetry fail for a while.
            gap = if below(&mut rng, 150) == 0 { below(&mut rng, 60) } else { u32::saturating_sub(gap, 1) };
            silence = if below(&mut rng, 200) == 0 { below(&mut rng, 40) } else { u32::saturating_sub(silence, 1) };
            place = place.plus(Horizontal { north: 0.02 * rng.uniform(), east: 0.01 * rng.gaussian() });
            yaw_rad = wrap_pi(yaw_rad + 0.02 * rng.gaussian());
            if silence == 0 {
                let time = Instant(now.0.saturating_sub(u64::from(below(&mut rng, 80_000))));
                expected.ownship = Some(Ownship {
                    position_time: time,
                    position_ned_m: Ned { north: place.north, east: place.east, down: -3.0 },
                    attitude_time: time,
                    yaw_rad,
                    ..Ownship::default()
                });
            }
            let comes = |every: u32, rng: &mut Rng| gap == 0 && below(rng, every) == 0;
            let scan = comes(scan_every, &mut rng).then(|| world.scan(now, &mut rng));
            let points = comes(points_every, &mut rng).then(|| world.points(now, &mut rng));
            let circles = comes(circles_every, &mut rng).then(|| world.circles(place, &mut rng));
            let frame = below(&mut rng, frame_every) == 0;
            if frame {
                snapshot.time = now;
                let amplitude = if below(&mut rng, 4) == 0 { 0.0 } else { 900.0 };
                for (n, code) in snapshot.codes.as_flattened_mut().iter_mut().enumerate() {
                    let turns = 9.3 * (n % 64) as f32 / 64.0;
                    *code = (amplitude * libm::cosf(core::f32::consts::TAU * turns) + 30.0 * rng.gaussian()) as i16;
                }
            }
            let overflown = state.map().overflow_count();
            let input = Input {
                front_end: if frame { FrontEnd::Frame(&snapshot) } else { FrontEnd::Nothing },
                ownship: expected.ownship,
                scan: scan.as_ref().map(|(scan, _)| scan),
                points: points.as_ref().map(|(points, _)| points),
                circles: circles.as_deref(),
                control: Control::Granted,
                ..Input::at(now)
            };
            let output = guidance.step(&mut state, &input);

            if circles.is_some() {
                let taken = expected.pose(now);
                expected.take(now, now, taken);
            }
            if let Some((points, told)) = &points {
                let taken = expected.pose(points.time).and(*told);
                let before = expected.taken;
                expected.take(now, points.time, taken);
                if expected.has_scanned {
                    expected.taken = before;
                }
            }
            let is_scan_taken = scan.as_ref().is_some_and(|(scan, told)| {
                let taken = expected.pose(scan.time).and(*told);
                expected.take(now, scan.time, taken)
            });
            expected.has_scanned |= is_scan_taken;
            assert_eq!(state.map().taken(), expected.taken, "{episode}");

            if let Some((scan, _)) = scan.as_ref().filter(|_| is_scan_taken) {
                scans_in_map += 1;
                let ownship = expected.ownship.unwrap();
                let yaw_rad = intake::pose_at(&state.vehicle, scan.time).unwrap().yaw_rad;
                let latest = state.control.guard.coverage().latest();
                let mut ranges = Ranges::new();
                ranges.take(scan);
                let sectors = scan.in_sectors(SECTORS_MAX);
                assert_eq!(
                    (&latest.ranges, latest.step_rad),
                    (&ranges, sectors.step_rad),
                    "{episode}: the guard's look"
                );
                let off_rad = latest.first_ned_rad - yaw_rad - sectors.first_azimuth_rad;
                assert!(libm::fabsf(wrap_pi(off_rad)) < 1e-4);
                let is_full = state.map().overflow_count() != overflown;
                for index in (0..sectors.count()).filter(|_| !is_full) {
                    let (Sector::Hit(range_m), offset) = sectors.nearest(index) else { continue };
                    if !(range_m > 0.0 && range_m <= scan.range_max_m) {
                        continue;
                    }
                    let middle_rad = yaw_rad + sectors.first_azimuth_rad + sectors.step_rad * index as f32;
                    // It is unknown which of a wide sector's rays hit: at least one of these places is occupied.
                    // Where rays make a sector it is known.
                    let beside_rad = if sectors.is_exact() { 0.0 } else { sectors.outermost_ray() * scan.step_rad };
                    let hits: Vec<Horizontal, 9> = (-4..=4)
                        .map(|ray| {
                            let aside_rad = 0.25 * ray as f32 * beside_rad + offset * scan.step_rad;
                            let away = Horizontal::from_bearing(wrap_pi(middle_rad + aside_rad)).times(range_m);
                            ownship.position_ned_m.horizontal().plus(away)
                        })
                        .collect();
                    let out_of = |circles: &[(Horizontal, f32)]| {
                        let out = hits.iter().map(|hit| out_m(*hit, circles.iter().copied()));
                        out.fold(f32::INFINITY, f32::min)
                    };
                    let known: Vec<_, CIRCLES_MAX> =
                        state.map().circles().map(|c| (c.center_ned_m, c.radius_m)).collect();
                    let out = out_of(&known);
                    assert!(out < 0.021, "{episode}: a hit lies {out} m out of the map");
                    hits_in_map += 1;
                    if state.surroundings.near.len() < OBSTACLES_MAX {
                        let near: Vec<_, 64> =
                            state.surroundings.near.iter().map(|o| (o.center_ned_m, o.reach_m - radius_m)).collect();
                        let out = out_of(&near);
                        assert!(out < 0.021, "{episode}: a hit lies {out} m out of what the guard heeds");
                        hits_near += 1;
                    }
                }
            }
            let is_heard = |at: Instant, limit_us: u64| now.0.abs_diff(at.0) <= limit_us;
            if let Some(ownship) = expected.ownship
                && is_heard(ownship.position_time, 190_000)
                && is_heard(ownship.attitude_time, 190_000)
                // Random positions may contradict a velocity of zero.
                && output.stale != Some(Stale::VelocityContradicts)
            {
                let is_stale = expected.taken.is_none_or(|at| now.0.abs_diff(at.0) as f32 * 1e-6 > STALE_S);
                assert_eq!(output.outcome == Outcome::StaleObstacles, is_stale, "{episode}: {output:?}");
                if is_stale { stale += 1 } else { fresh += 1 }
            }
        }
        for (sum, count) in refused.iter_mut().zip(expected.refused) {
            *sum += count;
        }
    }
    // Each case has occurred, and often.
    let counts = [steps, scans_in_map, hits_in_map, hits_near, stale, fresh];
    let least = [100_000, 20_000, 300_000, 20_000, 5_000, 40_000];
    assert!(counts.iter().zip(least).all(|(count, least)| *count >= least), "{counts:?}");
    assert!(refused.iter().all(|count| *count > 500), "{refused:?}");
}
