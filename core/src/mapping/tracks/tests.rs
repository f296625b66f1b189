//! People and walls as a sensor of any ray width sees them, and what becomes of them.

use std::vec::Vec as StdVec;

use super::*;
use crate::base::rng::Rng;
use crate::mapping::scan::{self, Sector};

const SCAN_S: f32 = 0.1;
/// A person.
const RADIUS_M: f32 = 0.3;

fn horizontal(north: f32, east: f32) -> Horizontal {
    Horizontal { north, east }
}

/// Sectors over a field of view around the nose, each the nearest of its rays.
fn cast(time: Instant, pose: &Pose, (fov_deg, sectors): (f32, usize), circles: &[(Horizontal, f32)]) -> Scan {
    let step_deg = fov_deg / sectors as f32;
    let step_rad = step_deg.to_radians();
    let first_azimuth_rad = -0.5 * (fov_deg.to_radians() - step_rad);
    let rays = libm::ceilf(step_deg / 1.25) as i32;
    let sector = |index: usize| {
        let middle_rad = pose.yaw_rad + first_azimuth_rad + step_rad * index as f32;
        let mut nearest_m = f32::INFINITY;
        for ray in 0..rays {
            let beside = (ray as f32 + 0.5) / rays as f32 - 0.5;
            let along = Horizontal::from_bearing(wrap_pi(middle_rad + beside * step_rad));
            for (center, radius_m) in circles {
                let to = center.minus(pose.position_ned_m);
                let (ahead_m, square) = (to.dot(along), to.norm_squared() - radius_m * radius_m);
                let within = ahead_m * ahead_m - square;
                if within > 0.0 && ahead_m > 0.0 {
                    nearest_m = nearest_m.min(ahead_m - within.sqrt());
                }
            }
        }
        if nearest_m < 5.0 { Sector::Hit(nearest_m) } else { Sector::Clear }
    };
    Scan { time, turn_s: 0.0, first_azimuth_rad, step_rad, range_max_m: 5.0, rays: (0..sectors).map(sector).collect() }
}

struct Watch {
    tracks: Tracks,
    now_s: f32,
    view: (f32, usize),
    /// Share of the rays that are lost, and whether the tracks are told.
    lost: f32,
    loses_rays: bool,
    /// How far positions and velocities are apart.
    apart_m: f32,
    /// Sigma of a range.
    noise_m: f32,
}

impl Watch {
    fn new(fov_deg: f32) -> Self {
        Self::with_rays(fov_deg, 72)
    }

    fn with_rays(fov_deg: f32, rays: usize) -> Self {
        let (view, tracks) = ((fov_deg, rays), Tracks::default());
        Self { tracks, now_s: 1.0, view, lost: 0.0, loses_rays: false, apart_m: 0.0, noise_m: 0.0 }
    }

    fn doubts(&self) -> Doubts {
        Doubts { loses_rays: self.loses_rays, apart_m: self.apart_m }
    }

    fn look(&mut self, pose: &Pose, circles: &[(Horizontal, f32)]) {
        self.look_with(pose, circles, &mut Rng::new(0, 0));
    }

    fn look_with(&mut self, pose: &Pose, circles: &[(Horizontal, f32)], rng: &mut Rng) {
        self.now_s += SCAN_S;
        let now = Instant((self.now_s * 1e6) as u64);
        let mut scan = cast(now, pose, self.view, circles);
        for ray in 0..scan.rays.len() {
            if rng.uniform() < self.lost {
                scan.rays.set(ray, Sector::Clear);
            }
        }
        if self.noise_m > 0.0 {
            for ray in 0..scan.rays.len() {
                if let Sector::Hit(exact_m) = scan.rays.get(ray) {
                    scan.rays.set(ray, Sector::Hit((exact_m + self.noise_m * rng.gaussian()).max(0.01)));
                }
            }
        }
        self.tracks.advance(now);
        if scan.is_fine() {
            return self.tracks.observe_rays(&scan, pose, Horizontal::default(), self.doubts());
        }
        let look = scan::fit(&scan, pose).unwrap();
        self.tracks.observe(&scan, pose, Horizontal::default(), &look.points_m, self.doubts());
    }

    fn moving(&self) -> StdVec<Track> {
        self.tracks.all().iter().copied().filter(Track::moves).collect()
    }
}

#[test]
fn a_person_is_followed_with_the_velocity_that_he_has_by_rays_and_by_wide_sectors() {
    // Field of view, rays, when his velocity is looked at, and how far off it may be.
    for (fov_deg, rays, after_s, off_mps) in [
        (90.0, 72, 0.5, 0.15),
        (90.0, 72, 1.0, 0.05),
        (360.0, 72, 1.0, 0.35),
        (360.0, 72, 2.0, 0.15),
        (360.0, 360, 0.5, 0.15),
        (360.0, 360, 1.0, 0.05),
        (180.0, 360, 0.5, 0.15),
    ] {
        for velocity in [horizontal(0.0, 1.4), horizontal(-0.9, 0.9), horizontal(0.3, -1.5)] {
            let mut watch = Watch::with_rays(fov_deg, rays);
            // An empty world at first.
            for _ in 0..5 {
                watch.look(&Pose::default(), &[]);
            }
            let start = horizontal(2.5, 0.0).minus(velocity.times(0.5 * after_s));
            let mut person = start;
            let looks = (after_s / SCAN_S) as usize;
            for look in 0..=looks {
                person = start.plus(velocity.times(look as f32 * SCAN_S));
                watch.look(&Pose::default(), &[(person, RADIUS_M)]);
            }
            let moving = watch.moving();
            assert_eq!(moving.len(), 1, "{fov_deg} {velocity:?} {:?}", watch.tracks.all());
            assert!(moving[0].center_ned_m.minus(person).norm() < 0.12, "{fov_deg} {velocity:?} {moving:?}");
            let off = moving[0].velocity_ned_mps.minus(velocity).norm();
            assert!(off < off_mps, "{fov_deg} {velocity:?}: {off}");
        }
    }
}

/// A sensor turns once while the vehicle flies, yaws and is late: a person has the place and velocity that he has now, and a pillar
/// stands where it stands.
#[test]
fn a_turn_during_which_all_move_is_seen_as_it_was() {
    const TURN_S: f32 = 0.1;
    let velocity_ned_mps = horizontal(0.8, 0.6);
    let pillar = (horizontal(-2.0, 0.5), RADIUS_M);
    for (yaw_rate_radps, walks_mps) in
        [(0.0, horizontal(0.0, 1.6)), (1.2, horizontal(-0.5, 1.2)), (-1.2, horizontal(0.7, -1.2))]
    {
        for (fov_deg, rays) in [(360.0, 360), (90.0, 72)] {
            let pose = |time_s: f32| Pose {
                position_ned_m: velocity_ned_mps.times(time_s - 2.0),
                yaw_rad: yaw_rate_radps * (time_s - 2.0),
            };
            let person = |time_s: f32| horizontal(2.5, 0.0).plus(walks_mps.times(time_s - 2.0));
            let mut tracks = Tracks::default();
            let mut now_s = 0.0;
            for turn in 0..20 {
                let middle_s = 0.05 + SCAN_S * turn as f32;
                let time = Instant((middle_s * 1e6) as u64);
                let mut scan = cast(time, &pose(middle_s), (fov_deg, rays), &[]);
                scan.turn_s = TURN_S;
                for ray in 0..rays {
                    let at_s = middle_s + scan.after_s(ray as f32);
                    let seen = cast(time, &pose(at_s), (fov_deg, rays), &[(person(at_s), RADIUS_M), pillar]);
                    scan.rays.set(ray, seen.rays.get(ray));
                }
                now_s = middle_s + 0.5 * TURN_S + 0.03;
                tracks.advance(Instant((now_s * 1e6) as u64));
                let scan = scan.straightened(yaw_rate_radps * TURN_S).unwrap();
                if turn > 10 {
                    let mut look = scan::Segmentation::default();
                    scan::fit_into(&mut look, &scan, &pose(middle_s), velocity_ned_mps).unwrap();
                    let away = |hit: &Horizontal| hit.plus(pose(middle_s).position_ned_m).minus(pillar.0).norm();
                    let off = look.points_m.iter().map(away).filter(|away_m| *away_m < 0.8);
                    let worst_m = off.map(|away_m| (away_m - RADIUS_M).abs()).fold(0.0, f32::max);
                    assert!(worst_m < 0.02, "{yaw_rate_radps} {fov_deg}: beside the pillar by {worst_m}");
                }
                tracks.observe_rays(&scan, &pose(middle_s), velocity_ned_mps, Doubts::default());
            }
            let moving: StdVec<&Track> = tracks.all().iter().filter(|track| track.moves()).collect();
            let [track] = moving[..] else { panic!("{yaw_rate_radps} {fov_deg}: {:?}", tracks.all()) };
            let off_m = track.center_ned_m.minus(person(now_s)).norm();
            let off_mps = track.velocity_ned_mps.minus(walks_mps).norm();
            assert!(off_m < 0.06 && off_mps < 0.1, "{yaw_rate_radps} {fov_deg}: {off_m} m, {off_mps} m/s");
        }
    }
}

#[test]
fn after_the_clock_was_set_back_people_are_followed_again() {
    let mut watch = Watch::with_rays(360.0, 360);
    watch.now_s = 100.0;
    for set_back_s in [0.0, 50.0] {
        watch.now_s -= set_back_s;
        for look in 0..20 {
            let person = horizontal(2.5, -1.0 + 0.14 * look as f32);
            watch.look(&Pose::default(), &[(person, RADIUS_M)]);
        }
        assert_eq!(watch.moving().len(), 1, "{set_back_s}");
    }
}

#[test]
fn two_people_abreast_are_two() {
    for (fov_deg, rays) in [(90.0, 72), (360.0, 72), (360.0, 360)] {
        let mut watch = Watch::with_rays(fov_deg, rays);
        for look in 0..16 {
            let north = 4.2 - 1.4 * SCAN_S * look as f32;
            let pair = [(horizontal(north, -0.4), RADIUS_M), (horizontal(north, 0.4), RADIUS_M)];
            watch.look(&Pose::default(), if look < 4 { &[] } else { &pair });
        }
        let seen: StdVec<_> = watch.moving().into_iter().filter(|track| track.unseen_s == 0.0).collect();
        assert_eq!(seen.len(), 2, "{fov_deg} {:?}", watch.tracks.all());
        assert!(seen.iter().all(|track| track.velocity_ned_mps.minus(horizontal(-1.4, 0.0)).norm() < 0.3), "{seen:?}");
    }
}

#[test]
fn nothing_of_a_wall_moves_however_it_is_flown_along() {
    let pickets: StdVec<_> = (0..80).map(|k| (horizontal(0.15 * k as f32 - 2.0, 1.2), 0.1)).collect();
    let posts: StdVec<_> = (0..12).map(|k| (horizontal(1.0 * k as f32, -1.5), 0.2)).collect();
    let world: StdVec<_> = pickets.into_iter().chain(posts).collect();
    for (fov_deg, rays) in [(90.0, 72), (120.0, 72), (270.0, 72), (360.0, 72), (180.0, 360), (360.0, 360)] {
        for speed_mps in [0.5, 1.0, 2.0] {
            let mut watch = Watch::with_rays(fov_deg, rays);
            for look in 0..40 {
                let yaw_rad = 0.6 * (0.3 * look as f32).sin();
                let north = (speed_mps * SCAN_S * look as f32).min(8.0);
                watch.look(&Pose { position_ned_m: horizontal(north, 0.0), yaw_rad }, &world);
                assert_eq!(watch.moving().len(), 0, "{fov_deg} {rays} {speed_mps} {look} {:?}", watch.moving());
            }
        }
    }
}

/// However slow, he moves at the latest when he has gone a little more than `LEFT_BEHIND_M`.
#[test]
fn who_is_slow_moves_when_he_has_left_where_he_was() {
    for rays in [72, 360] {
        for velocity in [horizontal(0.2, 0.0), horizontal(0.0, 0.25), horizontal(-0.3, 0.3)] {
            let mut watch = Watch::with_rays(360.0, rays);
            let start = horizontal(3.0, -0.5);
            let mut gone_m = 0.0;
            let mut person = start;
            while watch.moving().is_empty() && gone_m < 2.0 {
                watch.look(&Pose::default(), &[(person, RADIUS_M)]);
                person = person.plus(velocity.times(SCAN_S));
                gone_m = person.minus(start).norm();
            }
            assert!(gone_m > 0.1 && gone_m < LEFT_BEHIND_M + 0.25, "{rays} {velocity:?} {gone_m}");
        }
    }
}

/// A wall behind a row of posts: the pieces between them slide as the vehicle passes.
#[test]
fn what_is_seen_of_a_wall_through_a_gap_does_not_move() {
    let wall = (0..80).map(|k| (horizontal(0.1 * k as f32 - 2.0, 3.0), 0.1));
    let posts = (0..6).map(|k| (horizontal(0.9 * k as f32, 1.2), 0.35));
    let world: StdVec<_> = wall.chain(posts).collect();
    for (fov_deg, rays) in [(90.0, 72), (360.0, 72), (360.0, 360)] {
        for speed_mps in [0.2, 0.4, 1.0] {
            let mut watch = Watch::with_rays(fov_deg, rays);
            for look in 0..100 {
                let north = (speed_mps * SCAN_S * look as f32).min(5.0);
                let pose = Pose { position_ned_m: horizontal(north, 0.0), yaw_rad: 1.4 };
                watch.look(&pose, &world);
                assert_eq!(watch.moving(), [], "{fov_deg} {rays} {speed_mps} {look}");
            }
        }
    }
}

/// Ranges with errors of several centimetres make nobody of a wall, and who walks is followed all the same.
#[test]
fn noise_makes_nobody_of_a_wall() {
    let side = |east: f32| (0..60).map(move |k| (horizontal(0.15 * k as f32 - 1.0, east), 0.1));
    let end = (0..8).map(|k| (horizontal(6.0, 0.15 * k as f32 - 0.6), 0.1));
    let world: StdVec<_> = side(-0.6).chain(side(0.6)).chain(end).collect();
    for noise_m in [0.03, 0.04, 0.05] {
        let mut followed = 0;
        for flight in 0..20 {
            let (mut rng, mut watch) = (Rng::new(flight, 0), Watch::new(90.0));
            watch.noise_m = noise_m;
            for look in 0..60 {
                let yaw_rad = 0.6 * (0.3 * look as f32).sin();
                let pose = Pose { position_ned_m: horizontal(0.06 * look as f32, 0.0), yaw_rad };
                watch.look_with(&pose, &world, &mut rng);
                assert_eq!(watch.moving(), [], "{noise_m} {flight} {look}");
            }
            for look in 0..25 {
                let person = horizontal(5.5, 0.14 * look as f32 - 1.4);
                let there = [(person, RADIUS_M)];
                let pose = Pose { position_ned_m: horizontal(3.5, 0.0), yaw_rad: 0.0 };
                watch.look_with(&pose, if look < 5 { &[] } else { &there }, &mut rng);
            }
            followed += watch.moving().len();
        }
        assert_eq!(followed, 20, "{noise_m}");
    }
}

/// The autopilot's position slides to the east by half a metre a second for half a second, and its velocity does not tell.
#[test]
fn posts_do_not_move_because_the_position_does() {
    let posts = [(2.0, -1.0), (2.5, 0.2), (1.8, 1.0)].map(|(north, east)| (Horizontal { north, east }, 0.2));
    let movers = |is_told: bool| {
        let mut watch = Watch::with_rays(90.0, 72);
        let mut movers = 0;
        for look in 0..20_u8 {
            let slid_m = 0.05 * f32::from(look.saturating_sub(5).min(5));
            watch.apart_m = if is_told { slid_m } else { 0.0 };
            let pose = Pose { position_ned_m: Horizontal { north: 0.0, east: slid_m }, yaw_rad: 0.0 };
            let seen = posts.map(|(center, radius_m)| (Horizontal { east: center.east + slid_m, ..center }, radius_m));
            watch.look(&pose, &seen);
            movers += watch.moving().len();
        }
        movers
    };
    assert!(movers(false) > 3, "{}", movers(false));
    assert_eq!(movers(true), 0);
}

/// A ray that was lost says of a place that it was free.
#[test]
fn of_a_sensor_that_loses_rays_two_scans_must_have_seen_through() {
    let posts: StdVec<_> =
        (0..12).map(|k| (horizontal(0.9 * k as f32, if k % 2 == 0 { 1.1 } else { -1.3 }), 0.05)).collect();
    let [one, two] = [false, true].map(|loses_rays| {
        let mut moving = 0;
        for flight in 0..20 {
            let (mut rng, mut watch) = (Rng::new(flight, 0), Watch::new(360.0));
            (watch.lost, watch.loses_rays) = (0.2, loses_rays);
            for look in 0..60 {
                let pose = Pose { position_ned_m: horizontal(0.1 * look as f32, 0.0), yaw_rad: 0.0 };
                watch.look_with(&pose, &posts, &mut rng);
                moving += watch.moving().len();
            }
        }
        moving
    });
    assert!(one > 100 && 4 * two < one, "{one} {two}");
}

#[test]
fn who_is_gone_is_forgotten_and_who_is_out_of_view_remembered_for_a_while() {
    let velocity = horizontal(0.0, 1.0);
    let walk = |watch: &mut Watch| {
        let mut person = horizontal(2.0, -1.0);
        for look in 0..14 {
            person = person.plus(velocity.times(SCAN_S));
            let there = [(person, RADIUS_M)];
            watch.look(&Pose::default(), if look < 4 { &[] } else { &there });
        }
        assert_eq!(watch.moving().len(), 1);
        person
    };
    let mut watch = Watch::new(90.0);
    walk(&mut watch);
    for _ in 0..5 {
        watch.look(&Pose::default(), &[]);
    }
    assert!(watch.moving().is_empty(), "seen through {:?}", watch.moving());

    let mut watch = Watch::new(90.0);
    let mut person = walk(&mut watch);
    let behind = Pose { yaw_rad: 3.0, ..Pose::default() };
    for look in 1..40 {
        person = person.plus(velocity.times(SCAN_S));
        watch.look(&behind, &[]);
        let moving = watch.moving();
        assert_eq!(moving.len(), usize::from(look <= 30), "after {look} scans");
        assert!(moving.iter().all(|track| track.center_ned_m.minus(person).norm() < 0.6));
    }
}

#[test]
fn who_is_at_the_first_edge_of_the_view_was_seen_in_this_turn() {
    // The vehicle moves ahead, so that from where it was in the middle of the turn the hit lies outside of the view.
    let rays = (0..72).map(|ray| if ray == 0 { Sector::Hit(2.0) } else { Sector::Clear });
    let (step_rad, time) = (1.25_f32.to_radians(), Instant(1_000_000));
    let scan = Scan {
        time,
        turn_s: 0.1,
        first_azimuth_rad: -35.5 * step_rad,
        step_rad,
        range_max_m: 5.0,
        rays: rays.collect(),
    };
    let mut look = scan::Segmentation::default();
    scan::fit_into(&mut look, &scan, &Pose::default(), horizontal(1.0, 0.0)).unwrap();
    for hits in [&look.points_m[..], &[horizontal(2.0, -2.0)]] {
        let mut clusters = Vec::new();
        let pose = &Pose::default();
        cluster::find(
            &mut clusters,
            &cluster::View { scan: &scan, late_s: 0.05, pose, hits, before: None, noise: 1.0 },
        );
        assert!((0.05..=0.101).contains(&clusters[0].ago_s), "{clusters:?}");
    }
}

#[test]
fn who_is_near_is_followed_however_much_stands_around_and_in_whichever_direction() {
    // A ring of more thin pillars than clusters, and somebody inside who is seen last, by the last rays.
    let ring = (0..44).map(|post| (Horizontal::from_bearing(wrap_pi(0.142_8 * post as f32)).times(4.5), 0.05));
    let mut watch = Watch::with_rays(360.0, 360);
    for look in 0..20 {
        let person = horizontal(-2.0, 2.0 - 0.1 * look as f32);
        let world: StdVec<_> = ring.clone().chain([(person, RADIUS_M)]).collect();
        watch.look(&Pose::default(), &world);
        let moving = watch.moving();
        assert!(
            look < 5 || moving.len() == 1 && moving[0].center_ned_m.minus(person).norm() < 0.1,
            "{look}: {moving:?}"
        );
    }
}

#[test]
fn each_of_a_thicket_belongs_to_its_own_track() {
    let (mut tracks, mut clusters) = (Vec::<Track, TRACKS_MAX>::new(), Vec::<Cluster, CLUSTERS_MAX>::new());
    for post in 0..TRACKS_MAX as u8 {
        let center_ned_m = horizontal(3.0 + 0.35 * f32::from(post / 6), 0.35 * f32::from(post % 6));
        let mut track = Track {
            center_ned_m,
            velocity_ned_mps: Horizontal::default(),
            covariance: [4e-4, 0.0, SIGMA_MPS * SIGMA_MPS],
            unseen_s: 0.0,
            clear_s: 0.0,
            moved_s: 0.0,
            first_ned_m: center_ned_m,
            scans: 1,
            slow_scans: 0,
            moves: false,
        };
        track.predict(0.1);
        tracks.push(track).unwrap();
        let seen = Cluster { center_ned_m, sigma_m: 0.02, ago_s: 0.0, was_free: false, is_whole: true, track: None };
        clusters.push(seen).unwrap();
    }
    associate(&tracks, &mut clusters);
    assert!(clusters.iter().enumerate().all(|(post, seen)| seen.track == Some(post as u8)), "{clusters:?}");
}

#[test]
fn who_turns_round_moves_throughout_and_who_stops_comes_to_stand() {
    for (speed_mps, rays) in [(0.6, 360), (1.0, 360), (1.0, 72)] {
        let mut watch = Watch::with_rays(360.0, rays);
        let person = |look: usize| {
            // To and fro for 3 s each, and at rest from the end of the second turn on.
            let at_s = f32::min(0.1 * look as f32, 12.0) % 6.0;
            horizontal(2.5, speed_mps * (f32::min(at_s, 6.0 - at_s) - 1.5))
        };
        for look in 0..150 {
            watch.look(&Pose::default(), &[(person(look), RADIUS_M)]);
            let moving = watch.moving().len();
            assert!(!(25..120).contains(&look) || moving == 1, "{speed_mps}, {look}: {:?}", watch.tracks.all());
            assert!(look < 145 || moving == 0, "{speed_mps}, {look}: {:?}", watch.tracks.all());
        }
    }
}
