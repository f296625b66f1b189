//! The cost of a scan of the obstacle sensor until it is in the map.

use core::f32::consts::{FRAC_PI_2, TAU};
use core::hint::black_box;

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::pose::Pose;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::wrap_pi;
use foxhound_core::mapping::map::Map;
use foxhound_core::mapping::scan::{self, Doubts, RAYS_MAX, SECTORS_MAX, Scan, Sector};
use foxhound_core::mapping::tracks::Tracks;

use crate::row;

/// A scan until it is in the map, the worst of many scans: past pillars, and of an endless number of circles.
#[inline(never)]
pub(super) fn obstacle_looks(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let mut rng = Rng::new(13, 13);
    let mut flight = |world: &[[f32; 3]], view: View, noise_m: f32, looks: u64| {
        let (mut map, mut tracks) = (Map::default(), Tracks::default());
        let (mut worst, mut worst_fit, mut worst_follow) = (0, 0, 0);
        for look in 0..looks {
            let pose = Pose {
                position_ned_m: Horizontal { north: 0.05 * (look % 20) as f32, east: 0.02 * (look % 20) as f32 },
                yaw_rad: 0.3 * (rng.uniform() - 0.5),
            };
            let scan = ranges(world, &pose, view, noise_m, &mut rng);
            let now = Instant(100_000 * look);
            let mut seen = None;
            let fit = measure(&mut || seen = scan::fit(black_box(&scan), &pose).ok());
            let Some(seen) = seen else { return (0, 0, 0) };
            worst_fit = worst_fit.max(fit);
            let take = measure(&mut || map.observe_scan(now, &scan, &pose, black_box(&seen), false));
            tracks.advance(now);
            let follow = measure(&mut || {
                if scan.is_fine() {
                    tracks.observe_rays(black_box(&scan), &pose, Horizontal::default(), Doubts::default());
                } else {
                    tracks.observe(&scan, &pose, Horizontal::default(), black_box(&seen.points_m), Doubts::default());
                }
            });
            (worst, worst_follow) = (worst.max(fit + take), worst_follow.max(follow));
        }
        (worst_fit, worst, worst_follow)
    };
    let pillars: [[f32; 3]; 10] = core::array::from_fn(|k| {
        let side = [-1.1, -0.4, 0.3, 0.9, 1.5][k % 5];
        [2.0 + 0.7 * (k / 5) as f32, side + 0.25 * (k / 5) as f32, 0.10 + 0.02 * (k % 5) as f32]
    });
    let chain: [[f32; 3]; 28] = core::array::from_fn(|k| [2.5, 0.15 * k as f32 - 2.0, 0.1]);
    let walls: [[f32; 3]; 40] = core::array::from_fn(|k| {
        let away = Horizontal::from_bearing(wrap_pi(0.16 * k as f32)).times(1.6 + 0.4 * (k % 3) as f32);
        [away.north, away.east, 0.12]
    });
    let rows = [
        ("pillars_4", flight(&pillars[..4], NOSE, 0.005, 40)),
        ("pillars_10", flight(&pillars, NOSE, 0.005, 40)),
        ("wall", flight(&[[32.0, 0.0, 30.0]], NOSE, 0.005, 40)),
        ("wall_rough", flight(&[[32.0, 0.0, 30.0]], NOSE, 0.05, 80)),
        ("chain", flight(&chain, NOSE, 0.01, 40)),
        ("random", flight(&[], NOSE, 0.0, 80)),
        ("turn_pillars_10", flight(&pillars, TURN, 0.005, 40)),
        ("turn_pillars_40", flight(&walls, TURN, 0.005, 40)),
        ("turn_wall_rough", flight(&[[32.0, 0.0, 30.0]], TURN, 0.05, 80)),
        ("turn_random", flight(&[], TURN, 0.0, 80)),
    ];
    for (name, (fit, all, _)) in rows {
        semihosting::println!("count fit_{name} {fit} 0");
        semihosting::println!("count look_{name} {all} 0");
    }
    let worst = |rows: &[(&str, (u32, u32, u32))], of: fn(&(u32, u32, u32)) -> u32| {
        rows.iter().map(|(_, counts)| of(counts)).max().unwrap_or(0)
    };
    let (narrow, turns) = rows.split_at(6);
    row("tracks_72", worst(narrow, |counts| counts.2), 0);
    row("tracks_360", worst(turns, |counts| counts.2), 0);
    row("look_pillars", worst(&rows[..2], |counts| counts.1), 0);
    row("look_worst", worst(narrow, |counts| counts.1), 0);
    row("look_360", worst(turns, |counts| counts.1), 0);
}

/// Field of view, rad, and rays over it.
pub(super) type View = (f32, usize);
/// A sensor on the nose, and a lidar.
pub(super) const NOSE: View = (FRAC_PI_2, SECTORS_MAX);
pub(super) const TURN: View = (TAU, RAYS_MAX);

/// The length of the side of a square.
fn root(area: f32) -> f32 {
    let mut side = 0.5 * area + 0.5;
    for _ in 0..20 {
        side = 0.5 * (side + area / side);
    }
    side
}

/// Ranges of a sensor of 3 m to circles (north, east, radius), to the centimetre; random ones, if there are none.
pub(super) fn ranges(world: &[[f32; 3]], pose: &Pose, (fov_rad, rays): View, noise_m: f32, rng: &mut Rng) -> Scan {
    let step_rad = fov_rad / rays as f32;
    let first_azimuth_rad = 0.5 * (step_rad - fov_rad);
    let ray = |index: usize| {
        let sight = Horizontal::from_bearing(wrap_pi(pose.yaw_rad + first_azimuth_rad + step_rad * index as f32));
        let mut range_m = if world.is_empty() { 0.3 + 2.7 * rng.uniform() } else { 4.0 };
        for [north, east, radius] in world {
            let away = Horizontal { north: *north, east: *east }.minus(pose.position_ned_m);
            let across = sight.north * away.east - sight.east * away.north;
            let along = sight.dot(away);
            if along > 0.0 && across * across < radius * radius {
                range_m = range_m.min(along - root(radius * radius - across * across));
            }
        }
        let centimetres = (100.0 * (range_m + noise_m * rng.gaussian())) as i32;
        if centimetres > 300 { Sector::Clear } else { Sector::Hit(0.01 * centimetres.max(1) as f32) }
    };
    let rays = (0..rays).map(ray).collect();
    Scan { time: Instant(0), turn_s: 0.0, first_azimuth_rad, step_rad, range_max_m: 3.0, rays }
}
