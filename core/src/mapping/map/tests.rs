use super::absorb::BESIDE_FROM_M;
use super::*;
use crate::base::rng::Rng;
use crate::mapping::scan::{self, SECTORS_MAX, Sector};
use std::vec::Vec as StdVec;

fn circle(north: f32, east: f32, radius_m: f32) -> Circle {
    Circle { center_ned_m: Horizontal { north, east }, radius_m, ..Circle::default() }
}

/// A scan from the origin that sees the front of one pillar.
fn pillar(north: f32, east: f32, radius_m: f32, sigma_m: f32) -> Segmentation {
    let center_ned_m = Horizontal { north, east };
    let face_ned_m = center_ned_m.times(1.0 - radius_m / center_ned_m.norm());
    let mut look = Segmentation::default();
    look.points_m.push(face_ned_m).unwrap();
    let seen = Detection { kind: Kind::Pillar, center_ned_m, radius_m, sigma_m, face_ned_m, from: 0, to: 1 };
    look.detections.push(seen).unwrap();
    look
}

/// A remembered circle; a patch was seen from the west.
pub(super) fn known(center_ned_m: Horizontal, radius_m: f32, origin: Origin) -> Known {
    Known {
        center_ned_m,
        radius_m,
        sigma_m: 0.005,
        slope_or_front: Horizontal { north: 0.0, east: -1.0 },
        motion: Motion::default(),
        seen_ms: 0,
        origin,
        clear_scans: 0,
    }
}

fn unknown_scan() -> Scan {
    Scan {
        time: Instant(0),
        turn_s: 0.0,
        first_azimuth_rad: -0.7,
        step_rad: 0.02,
        range_max_m: 3.0,
        rays: [Sector::Unknown; SECTORS_MAX].into_iter().collect(),
    }
}

/// The circles as they were measured, without the sigma that is added to the reported radius.
fn measured(map: &Map) -> impl Iterator<Item = Circle> {
    map.known.iter().map(|known| Circle { radius_m: known.radius_m, ..known.circle() })
}

#[test]
fn repeated_looks_at_one_pillar_sharpen_one_circle() {
    let mut map = Map::default();
    let looks = [pillar(2.0, 0.1, 0.3, 0.05), pillar(2.01, 0.0, 0.2, 0.01), pillar(1.99, 0.0, 0.2, 0.01)];
    for look in &looks {
        map.observe_scan(Instant(1), &unknown_scan(), &Pose::default(), look, false);
    }
    let circles: StdVec<_> = measured(&map).collect();
    assert_eq!(circles.len(), 1);
    assert!((circles[0].center_ned_m.north - 2.0).abs() < 0.01 && (circles[0].radius_m - 0.2).abs() < 0.01);
}

#[test]
fn a_glimpse_of_a_pillars_edge_adds_no_ghost_before_or_after_the_pillar_itself() {
    let (pillar, glimpse) = (pillar(2.0, 0.0, 0.3, 0.01), pillar(1.85, 0.2, 0.05, 0.08));
    for looks in [[pillar.clone(), glimpse.clone()], [glimpse, pillar]] {
        let mut map = Map::default();
        for look in &looks {
            map.observe_scan(Instant(1), &unknown_scan(), &Pose::default(), look, false);
        }
        let circles: StdVec<_> = measured(&map).collect();
        assert_eq!(circles.len(), 1, "{circles:?}");
        assert!((circles[0].radius_m - 0.3).abs() < 5e-3);
    }
}

#[test]
fn a_post_stays_known_when_only_its_neighbour_15_centimetres_away_is_seen_any_more() {
    let mut map = Map::default();
    for _ in 0..3 {
        let look = pillar(2.0, 0.0, 0.075, 0.01);
        map.observe_scan(Instant(1), &unknown_scan(), &Pose::default(), &look, false);
    }
    // First much too large, as a part of a row of pillars can seem, then better, then accurate.
    for (radius_m, sigma_m) in [(0.15, 0.05), (0.09, 0.04), (0.075, 0.01)] {
        let look = pillar(2.0, 0.15, radius_m, sigma_m);
        map.observe_scan(Instant(2), &unknown_scan(), &Pose::default(), &look, false);
        let far_side = Horizontal { north: 2.0, east: -0.07 };
        let knows = measured(&map).any(|c| c.center_ned_m.minus(far_side).norm() < c.radius_m + 0.02);
        assert!(knows, "{radius_m} {sigma_m}: {:?}", map.circles().collect::<StdVec<_>>());
    }
}

#[test]
fn a_guess_from_far_is_forgotten_when_its_pillar_is_measured_from_near() {
    let mut map = Map::default();
    // Two inaccurate circles on either side of it, too far apart to be merged; then the pillar.
    for (east, radius_m, sigma_m) in [(0.2, 0.12, 0.06), (0.0, 0.05, 0.14), (0.105, 0.12, 0.005)] {
        let look = pillar(2.0, east, radius_m, sigma_m);
        map.observe_scan(Instant(1), &unknown_scan(), &Pose::default(), &look, false);
    }
    let circles: StdVec<_> = map.circles().collect();
    assert!(circles.len() == 1 && circles[0].radius_m < 0.135, "{circles:?}");
}

#[test]
fn the_farthest_circle_gives_way_when_the_store_is_full() {
    let mut map = Map::default();
    for k in 0..CIRCLES_MAX as i32 + 10 {
        let far = circle(300.0 - k as f32, 0.0, 0.2);
        map.observe_circles(Instant(1), Horizontal::default(), &[far]).unwrap();
    }
    assert_eq!(map.circles().count(), CIRCLES_MAX);
    assert_eq!(map.overflow_count(), 10);
    assert!(map.circles().all(|c| c.center_ned_m.north < 291.0));
}

#[test]
fn a_circle_that_is_seen_through_is_forgotten_after_three_looks_or_six_where_rays_are_lost() {
    for (loses_rays, behind, looks) in
        [(false, Sector::Clear, 3), (false, Sector::Hit(2.8), 3), (true, Sector::Clear, 6), (true, Sector::Hit(2.8), 3)]
    {
        let mut map = Map::default();
        let both = [circle(2.0, 0.0, 0.2), circle(-2.0, 0.0, 0.2)];
        map.observe_circles(Instant(1), Horizontal::default(), &both).unwrap();
        let scan = Scan { rays: [behind; SECTORS_MAX].into_iter().collect(), ..unknown_scan() };
        for look in 0..looks {
            assert_eq!(map.circles().count(), 2, "{loses_rays} {behind:?} {look}");
            map.observe_scan(Instant(1), &scan, &Pose::default(), &Segmentation::default(), loses_rays);
        }
        assert_eq!(map.circles().count(), 1, "the one behind is out of sight and stays");
    }
}

#[test]
fn what_stood_there_before_somebody_came_is_kept_and_what_he_left_is_not() {
    let patch = |mut look: Segmentation| {
        look.detections.iter_mut().for_each(|seen| seen.kind = Kind::Patch);
        look
    };
    let walker = [Horizontal { north: 2.0, east: 0.3 }];
    for (look, looks, age_us, is_kept) in [
        (pillar(2.0, 0.0, 0.2, 0.01), 12, 100_000, true),
        (pillar(2.0, 0.0, 0.2, 0.01), 3, 100_000, false),
        (patch(pillar(2.0, 0.0, 0.2, 0.01)), 3, 4_000_000, true),
        (patch(pillar(2.0, 0.0, 0.2, 0.01)), 3, 100_000, false),
    ] {
        let mut map = Map::default();
        for k in 0_u64..looks {
            let now = Instant(100_000 * k);
            map.observe_scan(now, &unknown_scan(), &Pose::default(), &look, false);
        }
        let now = Instant(100_000 * looks + age_us);
        map.vacate(now, &walker, 0.55);
        assert_eq!(map.circles().count(), usize::from(is_kept), "{looks} looks, {age_us} us");
        map.vacate(now, &[Horizontal { north: 2.0, east: 0.6 }], 0.55);
        assert_eq!(map.circles().count(), usize::from(is_kept), "too far away");
    }
}

#[test]
fn moving_circles_move_and_are_forgotten_when_unseen() {
    let mut map = Map::default();
    let mover = Circle { velocity_ned_mps: Horizontal { north: 0.5, east: 0.0 }, ..circle(1.0, 0.0, 0.2) };
    map.observe_circles(Instant(0), Horizontal::default(), &[mover]).unwrap();
    map.advance(Instant(1_000_000));
    let north = map.circles().next().unwrap().center_ned_m.north;
    assert!((north - 1.5).abs() < 1e-3, "{north}");
    map.advance(Instant(5_000_000));
    assert_eq!(map.circles().count(), 0);
}

#[test]
fn circles_of_one_delivery_that_stand_close_together_are_all_kept_and_a_repeated_one_once() {
    let mut map = Map::default();
    let wall: [Circle; 20] = core::array::from_fn(|k| circle(1.0 + 0.1 * (k / 5) as f32, 0.1 * (k % 5) as f32, 0.3));
    for delivery in 0..5 {
        let now = Instant(delivery * 100_000);
        map.observe_circles(now, Horizontal::default(), &[wall, wall].concat()).unwrap();
        assert!(wall.iter().all(|circle| map.circles().any(|known| known == *circle)), "delivery {delivery}");
        assert_eq!(map.circles().count(), wall.len());
    }
}

#[test]
fn a_hit_of_a_wide_sector_may_be_of_what_stands_beside_it_at_its_distance_and_a_ray_may_not() {
    // A single hit straight ahead, about 10 cm beside a pillar, and the pillar nearer than the hit.
    for (beside_rad, east, nearer_m, circles) in [
        (0.0, 0.05, 0.0, 2),
        (0.03, 0.05, 0.0, 1),
        (0.03, 0.05, 0.1, 2),
        (0.03, 0.09, 0.0, 2),
        (1.0, 0.09, 0.0, 1),
        (1.0, 0.13, 0.0, 2),
    ] {
        let mut map = Map::default();
        map.observe_circles(Instant(1), Horizontal::default(), &[circle(2.1 - nearer_m, 0.1 + east, 0.1)]).unwrap();
        let hit = Horizontal { north: 2.1, east: 0.0 };
        let patch = Detection {
            kind: Kind::Patch,
            center_ned_m: Horizontal { north: 2.15, east: 0.0 },
            radius_m: 0.05,
            sigma_m: 0.01,
            face_ned_m: hit,
            from: 0,
            to: 1,
        };
        let look = Segmentation {
            time: Instant(2),
            beside_rad,
            sides: Vec::from_slice(&[0]).unwrap(),
            points_m: Vec::from_slice(&[hit]).unwrap(),
            detections: Vec::from_slice(&[patch]).unwrap(),
            ..Segmentation::default()
        };
        map.observe_points(Instant(2), &look);
        assert_eq!(map.circles().count(), circles, "{beside_rad} rad, {east} m, {nearer_m} m");
    }
}

#[test]
fn absurd_circles_are_refused() {
    let mut map = Map::default();
    let bad =
        [circle(f32::NAN, 0.0, 0.2), circle(0.0, 0.0, -1.0), circle(0.0, 0.0, f32::INFINITY), circle(0.0, 0.0, 1e9)];
    map.observe_circles(Instant(0), Horizontal::default(), &bad).unwrap_err();
    assert_eq!((map.circles().count(), map.taken()), (0, None));
    // A valid one among them is accepted.
    let one = [bad[0], circle(1.0, 0.0, 0.2)];
    map.observe_circles(Instant(3), Horizontal::default(), &one).unwrap();
    assert_eq!((map.circles().count(), map.taken()), (1, Some(Instant(3))));
}

#[test]
fn a_circle_takes_32_bytes_and_the_store_little_else() {
    assert_eq!(size_of::<Known>(), 32);
    assert!(size_of::<Map>() <= 32 * CIRCLES_MAX + 64, "{}", size_of::<Map>());
}

#[test]
fn a_circle_is_told_larger_by_its_sigma_and_an_exact_one_is_not() {
    let mut map = Map::default();
    map.observe_points(Instant(1), &pillar(2.0, 0.0, 0.3, 0.02));
    map.observe_circles(Instant(1), Horizontal::default(), &[circle(-2.0, 0.0, 0.3)]).unwrap();
    let radii: StdVec<f32> = map.circles().map(|c| c.radius_m).collect();
    assert!((radii[0] - 0.32).abs() < 1e-6 && radii[1] == 0.3, "{radii:?}");
}

#[test]
fn a_delivery_longer_than_allowed_is_cut_and_counted() {
    let mut map = Map::default();
    let many: StdVec<Circle> = (0..10_000).map(|k| circle(k as f32, 0.0, 0.2)).collect();
    map.observe_circles(Instant(1), Horizontal::default(), &many).unwrap();
    assert_eq!((map.circles().count(), map.overflow_count()), (DELIVERY_MAX, 10_000 - DELIVERY_MAX as u32));
    map.observe_circles(Instant(2), Horizontal::default(), &many).unwrap();
    assert_eq!(map.circles().count(), DELIVERY_MAX, "duplicates are one");
}

#[test]
fn the_newest_look_counts_and_a_clock_that_was_set_back_does_not_keep_an_old_one_new() {
    let mut map = Map::default();
    let mut take = |now: u64, measured: u64| {
        let look = Segmentation { time: Instant(measured), ..Segmentation::default() };
        map.observe_points(Instant(now), &look);
        map.taken()
    };
    assert_eq!(take(500, 400), Some(Instant(400)));
    assert_eq!(take(510, 390), Some(Instant(400)), "one that was under way for longer");
    assert_eq!(take(520, 450), Some(Instant(450)));
    assert_eq!(take(100, 90), Some(Instant(90)), "the clock was set back");
}

#[test]
fn single_points_do_not_keep_the_map_of_a_lidar_new_that_has_failed() {
    let mut map = Map::default();
    let at = |time: u64| Segmentation { time: Instant(time), ..Segmentation::default() };
    map.observe_points(Instant(100), &at(100));
    assert_eq!(map.taken(), Some(Instant(100)), "there is nothing else");
    map.observe_scan(Instant(200), &unknown_scan(), &Pose::default(), &at(200), false);
    map.observe_points(Instant(900), &at(900));
    assert_eq!(map.taken(), Some(Instant(200)));
    map.clear();
    map.observe_points(Instant(1_000), &at(1_000));
    assert_eq!(map.taken(), Some(Instant(1_000)));
}

/// Straight walls (north, east, north, east) and pillars (north, east, radius), as seen by a scanner.
#[derive(Default)]
struct World {
    walls: StdVec<[f64; 4]>,
    pillars: StdVec<[f64; 3]>,
}

impl World {
    fn distance(&self, (north, east): (f64, f64), bearing: f64) -> f64 {
        let (s, c) = bearing.sin_cos();
        let mut nearest = f64::INFINITY;
        for [an, ae, bn, be] in &self.walls {
            // p + t d = a + u (b - a)
            let (wn, we, qn, qe) = (bn - an, be - ae, an - north, ae - east);
            let determinant = c * we - s * wn;
            let (t, u) = ((qn * we - qe * wn) / determinant, (qn * s - qe * c) / determinant);
            if t > 0.0 && (0.0..=1.0).contains(&u) {
                nearest = nearest.min(t);
            }
        }
        for [n, e, r] in &self.pillars {
            let (dn, de) = (n - north, e - east);
            let (along, across) = (dn * c + de * s, (dn * s - de * c).abs());
            if along > 0.0 && across < *r {
                nearest = nearest.min((along - (r * r - across * across).sqrt()).max(0.01));
            }
        }
        nearest
    }

    /// `fov` wide, 72 sectors, to the centimetre, with noise.
    fn scan(&self, place: (f64, f64), yaw: f64, fov: f64, noise: f64, rng: &mut Rng) -> (Scan, Pose) {
        let step = fov / 72.0;
        let first = (step - fov) / 2.0;
        let sectors: [Sector; SECTORS_MAX] = core::array::from_fn(|k| {
            let distance = self.distance(place, yaw + first + step * k as f64) + noise * f64::from(rng.gaussian());
            if distance > 3.0 {
                Sector::Clear
            } else {
                Sector::Hit(((distance * 100.0).round() / 100.0).max(0.01) as f32)
            }
        });
        let pose =
            Pose { position_ned_m: Horizontal { north: place.0 as f32, east: place.1 as f32 }, yaw_rad: yaw as f32 };
        let scan = Scan {
            time: Instant(0),
            turn_s: 0.0,
            first_azimuth_rad: first as f32,
            step_rad: step as f32,
            range_max_m: 3.0,
            rays: sectors.into_iter().collect(),
        };
        (scan, pose)
    }
}

/// How far the worst point of a scan lies outside the nearest circle. A point reported by a wide sector from a distance
/// may lie anywhere in it.
fn uncovered_m(map: &Map, look: &Segmentation) -> f32 {
    let out = |(index, point): (usize, &Horizontal)| {
        let side = look.sides.get(index).map_or(0.0, |side| 0.01 * f32::from(*side));
        let is_wide = point.norm() > BESIDE_FROM_M;
        let places = (-20..=20).map(|at| if is_wide { 0.05 * at as f32 - side } else { 0.0 }).map(|aside| {
            let (sin, cos) = (look.beside_rad * aside).sin_cos();
            Horizontal { north: cos * point.north - sin * point.east, east: cos * point.east + sin * point.north }
        });
        let depth = |place: Horizontal| {
            let place_ned_m = place.plus(look.origin_ned_m);
            measured(map).map(|c| place_ned_m.minus(c.center_ned_m).norm() - c.radius_m).fold(f32::INFINITY, f32::min)
        };
        places.map(depth).fold(f32::INFINITY, f32::min)
    };
    look.points_m.iter().enumerate().map(out).fold(f32::NEG_INFINITY, f32::max)
}

fn rooms() -> StdVec<(&'static str, World)> {
    let chain = |from: (f64, f64), to: (f64, f64), r: f64, n: usize| {
        (0..n).map(move |k| {
            let t = k as f64 / (n - 1) as f64;
            [from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1), r]
        })
    };
    std::vec![
        ("wall", World { walls: std::vec![[3.0, -3.0, 3.0, 3.0]], ..World::default() }),
        ("corner", World { walls: std::vec![[3.0, -2.0, 3.0, 1.0], [3.0, 1.0, 0.0, 1.0]], ..World::default() }),
        (
            "U",
            World {
                walls: std::vec![[0.5, -1.2, 3.0, -1.2], [3.0, -1.2, 3.0, 1.2], [3.0, 1.2, 0.5, 1.2]],
                ..World::default()
            },
        ),
        ("chain of pillars", World { pillars: chain((2.5, -2.0), (2.5, 2.0), 0.1, 28).collect(), ..World::default() }),
        (
            "forest and a thin wall",
            World {
                walls: std::vec![[1.5, 0.8, 3.0, 2.0]],
                pillars: std::vec![[2.0, -0.5, 0.3], [2.6, 0.3, 0.25], [1.2, -1.2, 0.15], [3.2, -1.0, 0.4]],
            },
        ),
    ]
}

#[test]
fn every_hit_of_the_last_look_is_in_a_circle_or_within_two_centimetres_or_else_its_wide_sector_is() {
    let mut rng = Rng::new(7, 0);
    for (name, world) in rooms() {
        for fov_deg in [60.0_f64, 90.0, 360.0] {
            for noise in [0.0, 0.01] {
                let mut map = Map::default();
                for look in 0..120 {
                    let place = (0.9 * f64::from(rng.uniform()), 1.4 * f64::from(rng.uniform()) - 0.7);
                    let yaw = 1.2 * (f64::from(rng.uniform()) - 0.5);
                    let (scan, pose) = world.scan(place, yaw, fov_deg.to_radians(), noise, &mut rng);
                    let seen = scan::fit(&scan, &pose).unwrap();
                    let overflows = map.overflow_count();
                    map.observe_scan(Instant(look * 100_000), &scan, &pose, &seen, false);
                    assert!(map.circles().all(|circle| circle.is_plausible()));
                    let out = uncovered_m(&map, &seen);
                    assert!(out < 0.02 || map.overflow_count() > overflows, "{name} {fov_deg} {noise} {look}: {out}");
                }
                assert!(noise > 0.0 || map.overflow_count() == 0, "{name} {fov_deg} overflows");
            }
        }
    }
}

#[test]
fn whatever_is_delivered_in_whatever_order_the_store_is_finite_and_covers_the_last_look() {
    let mut rng = Rng::new(8, 0);
    let mut covered = 0;
    for _ in 0..60 {
        let mut map = Map::default();
        let mut now = 1_000_000_u64;
        for _ in 0..60 {
            let mut number = |spread: f32| match (rng.uniform() * 40.0) as u32 {
                0 => f32::NAN,
                1 => f32::INFINITY,
                2 => -1e30,
                _ => spread * (2.0 * rng.uniform() - 1.0),
            };
            now = now.wrapping_add_signed((number(400_000.0) as i64).saturating_add(100_000));
            let pose =
                Pose { position_ned_m: Horizontal { north: number(2.0), east: number(2.0) }, yaw_rad: number(3.0) };
            let look = match number(3.0) {
                kind if kind > 1.0 => {
                    let circles: StdVec<Circle> = (0..70)
                        .map(|_| Circle {
                            velocity_ned_mps: Horizontal { north: number(1.0), east: number(1.0) },
                            ..circle(number(3.0), number(3.0), number(0.5))
                        })
                        .collect();
                    _ = map.observe_circles(Instant(now), pose.position_ned_m, &circles);
                    None
                }
                kind if kind > -1.0 => {
                    let sectors: [Sector; SECTORS_MAX] = core::array::from_fn(|_| match number(3.0) {
                        n if n < -1.5 => Sector::Unknown,
                        n if n < 0.0 => Sector::Clear,
                        n => Sector::Hit(n),
                    });
                    let scan = Scan {
                        time: Instant(now),
                        turn_s: 0.0,
                        first_azimuth_rad: number(3.0),
                        step_rad: number(0.09),
                        range_max_m: 3.0,
                        rays: sectors.into_iter().collect(),
                    };
                    let look = scan::fit(&scan, &pose).ok();
                    if let Some(look) = &look {
                        map.observe_scan(Instant(now), &scan, &pose, look, false);
                    }
                    look
                }
                _ => {
                    let points_m = (0..72).map(|_| Horizontal { north: number(3.0), east: number(3.0) }).collect();
                    let points = scan::Points { points_m, ..scan::Points::default() };
                    let mut look = Segmentation::default();
                    let is_taken = scan::fit_points_into(&mut look, &points, &pose).is_ok();
                    is_taken.then(|| {
                        map.observe_points(Instant(now), &look);
                        look
                    })
                }
            };
            assert!(map.circles().all(|circle| circle.is_plausible()));
            if let Some(look) = look.filter(|_| map.overflow_count() == 0) {
                let out = uncovered_m(&map, &look);
                assert!(out < 0.02, "{out}");
                covered += 1;
            }
        }
    }
    assert!(covered > 50, "{covered}");
}

#[test]
fn standing_pillars_do_not_seem_to_move_however_the_view_of_them_changes() {
    let mut rng = Rng::new(9, 0);
    let (mut told, mut looks) = (0, 0);
    for (_, world) in rooms() {
        for flight in 0..10 {
            let mut map = Map::default();
            for look in 0..40 {
                // 1 m/s past them, with the nose turning left and right.
                let along = 0.1 * f64::from(look) - 1.5;
                let place = (0.2 * f64::from(flight) - 1.4, along);
                let yaw = 0.6 * (0.15 * f64::from(look) + f64::from(flight)).sin();
                let (scan, pose) = world.scan(place, yaw, 1.571, 0.003, &mut rng);
                let now = Instant(look as u64 * 100_000);
                map.observe_scan(now, &scan, &pose, &scan::fit(&scan, &pose).unwrap(), false);
                told += map.circles().filter(|c| c.velocity_ned_mps.norm_squared() > 0.0).count();
                looks += map.circles().count();
            }
        }
    }
    assert!(looks > 20_000 && told == 0, "{told} of {looks}");
}

#[test]
fn a_moving_pillar_gets_its_velocity_within_a_second_and_a_half_and_leaves_no_ghosts() {
    let mut rng = Rng::new(10, 0);
    for (vn, ve) in [(0.0, 0.3), (-0.3, 0.0), (-0.3, 0.4), (0.2, -0.5)] {
        let mut map = Map::default();
        for look in 0..24 {
            let time = 0.1 * f64::from(look);
            let world = World { pillars: std::vec![[2.2 + vn * time, -0.3 + ve * time, 0.25]], ..World::default() };
            let (scan, pose) = world.scan((0.0, 0.0), 0.0, 1.571, 0.003, &mut rng);
            let now = Instant(look as u64 * 100_000);
            map.observe_scan(now, &scan, &pose, &scan::fit(&scan, &pose).unwrap(), false);
            if look >= 15 {
                let nearest = map.circles().find(|c| c.velocity_ned_mps.norm_squared() > 0.0);
                let nearest = nearest.unwrap_or_else(|| panic!("{vn} {ve} after {time} s: {map:?}"));
                let off = nearest.velocity_ned_mps.minus(Horizontal { north: vn as f32, east: ve as f32 }).norm();
                assert!(off < 0.15, "{vn} {ve} after {time} s: {nearest:?}");
            }
        }
        assert!(map.circles().count() <= 2, "{vn} {ve}: {map:?}");
    }
}

#[test]
fn what_was_seen_once_is_remembered_when_the_view_has_turned_away() {
    let mut rng = Rng::new(11, 0);
    let world = World { pillars: std::vec![[2.0, 0.0, 0.3]], walls: std::vec![[1.0, 1.0, 2.0, 1.2]] };
    let mut map = Map::default();
    for look in 0..600_u64 {
        let yaw = if look < 5 { 0.2 } else { 3.0 };
        let (scan, pose) = world.scan((0.0, 0.0), yaw, 1.571, 0.0, &mut rng);
        map.observe_scan(Instant(look * 100_000), &scan, &pose, &scan::fit(&scan, &pose).unwrap(), false);
    }
    let (scan, pose) = world.scan((0.0, 0.0), 0.2, 1.571, 0.0, &mut rng);
    assert!(uncovered_m(&map, &scan::fit(&scan, &pose).unwrap()) < 0.02);
}

#[test]
fn a_single_scan_of_a_wall_with_a_gap_of_83_centimetres_leaves_the_gap_open() {
    let mut rng = Rng::new(12, 0);
    let world = World { walls: std::vec![[2.0, -3.0, 2.0, -0.415], [2.0, 0.415, 2.0, 3.0]], ..World::default() };
    let mut map = Map::default();
    for look in 0..10 {
        let (scan, pose) = world.scan((0.1 * f64::from(look), 0.0), 0.0, 1.571, 0.003, &mut rng);
        map.observe_scan(Instant(look as u64 * 100_000), &scan, &pose, &scan::fit(&scan, &pose).unwrap(), false);
    }
    // The vehicle, 15 cm in radius, in the middle of the gap, and before and behind it.
    for north in [1.5, 1.8, 1.9, 2.0, 2.1, 2.2, 2.5] {
        let at = Horizontal { north, east: 0.0 };
        let clearance = measured(&map).map(|c| at.minus(c.center_ned_m).norm() - c.radius_m - 0.15).fold(9.0, f32::min);
        assert!(clearance > 0.18, "{clearance} at {north}");
    }
}

#[test]
fn a_wall_is_not_seen_through_where_the_vehicle_moves_while_the_sensor_turns() {
    let mut rng = Rng::new(13, 0);
    let world = World { walls: std::vec![[-1.5, -2.0, -1.5, 2.0], [3.0, -2.0, 3.0, 2.0]], ..World::default() };
    let (velocity, turn_s) = (Horizontal { north: 1.0, east: 0.0 }, 0.2_f32);
    for yaw in [0.0, core::f64::consts::PI] {
        let mut map = Map::default();
        for look in 0..8_u16 {
            let north = 0.2 * f64::from(look);
            let (mut scan, pose) = world.scan((north, 0.0), yaw, core::f64::consts::TAU, 0.0, &mut rng);
            scan.turn_s = turn_s;
            for ray in 0..scan.rays.len() {
                let at = north + f64::from(scan.after_s(ray as f32));
                let (seen, _) = world.scan((at, 0.0), yaw, core::f64::consts::TAU, 0.0, &mut rng);
                scan.rays.set(ray, seen.rays.get(ray));
            }
            let mut found = Segmentation::default();
            scan::fit_into(&mut found, &scan, &pose, velocity).unwrap();
            map.observe_scan(Instant(u64::from(look) * 200_000), &scan, &pose, &found, false);
            assert!(
                map.known.iter().all(|known| known.clear_scans == 0 || known.clear_scans == AVERAGED),
                "{yaw} {look}"
            );
        }
    }
}
