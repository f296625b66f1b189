//! What a scan of the obstacle sensor costs on its way into the map.

use core::f32::consts::FRAC_PI_2;
use core::hint::black_box;

use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::pose::Pose;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::mapping::map::{self, Map};
use foxhound_core::mapping::scan::{self, SECTORS_MAX, Scan, Sector};
use foxhound_core::mapping::tracks::{self, Tracks};
use foxhound_firmware::board::Board as _;

use crate::{Twin, row};

/// A scan's way into the map, the worst of many looks: past pillars, and at what has no end of circles.
#[inline(never)]
pub(super) fn obstacle_looks(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let (Ok(segmenter), Ok(mapper)) = (scan::Config::default().build(), map::Config::default().build()) else {
        Twin::halt(format_args!("the built-in obstacle memory does not build"))
    };
    let Ok(tracker) = tracks::Config::default().build() else {
        Twin::halt(format_args!("the built-in tracks do not build"))
    };
    let (mut rng, mut worst_follow) = (Rng::new(13, 13), 0);
    let mut flight = |world: &[[f32; 3]], noise_m: f32, looks: u64| {
        let (mut map, mut tracks) = (Map::default(), Tracks::default());
        let (mut worst, mut worst_fit) = (0, 0);
        for look in 0..looks {
            let pose = Pose {
                position_ned_m: Horizontal { north: 0.05 * (look % 20) as f32, east: 0.02 * (look % 20) as f32 },
                yaw_rad: 0.3 * (rng.uniform() - 0.5),
            };
            let scan = ranges(world, &pose, noise_m, &mut rng);
            let now = Instant(100_000 * look);
            let mut seen = None;
            let fit = measure(&mut || seen = segmenter.fit(black_box(&scan), &pose).ok());
            let Some(seen) = seen else { return (0, 0) };
            worst_fit = worst_fit.max(fit);
            let take = measure(&mut || mapper.observe_scan(&mut map, now, &scan, &pose, black_box(&seen)));
            tracker.advance(&mut tracks, now);
            let follow = measure(&mut || tracker.observe(&mut tracks, &scan, &pose, black_box(&seen)));
            (worst, worst_follow) = (worst.max(fit + take), worst_follow.max(follow));
        }
        (worst_fit, worst)
    };
    let pillars: [[f32; 3]; 10] = core::array::from_fn(|k| {
        let side = [-1.1, -0.4, 0.3, 0.9, 1.5][k % 5];
        [2.0 + 0.7 * (k / 5) as f32, side + 0.25 * (k / 5) as f32, 0.10 + 0.02 * (k % 5) as f32]
    });
    let chain: [[f32; 3]; 28] = core::array::from_fn(|k| [2.5, 0.15 * k as f32 - 2.0, 0.1]);
    let rows = [
        ("pillars_4", flight(&pillars[..4], 0.005, 40)),
        ("pillars_10", flight(&pillars, 0.005, 40)),
        ("wall", flight(&[[32.0, 0.0, 30.0]], 0.005, 40)),
        ("wall_rough", flight(&[[32.0, 0.0, 30.0]], 0.05, 80)),
        ("chain", flight(&chain, 0.01, 40)),
        ("random", flight(&[], 0.0, 80)),
    ];
    for (name, (fit, all)) in rows {
        semihosting::println!("count fit_{name} {fit} 0");
        semihosting::println!("count look_{name} {all} 0");
    }
    row("tracks_72", worst_follow, 0);
    row("look_pillars", rows.iter().take(2).map(|(_, (_, all))| *all).max().unwrap_or(0), 0);
    row("look_worst", rows.iter().map(|(_, (_, all))| *all).max().unwrap_or(0), 0);
}

/// The length of the side of a square.
fn root(area: f32) -> f32 {
    let mut side = 0.5 * area + 0.5;
    for _ in 0..20 {
        side = 0.5 * (side + area / side);
    }
    side
}

/// What a sensor of 90 degrees and 3 m sees of circles (north, east, radius), to the centimetre; anything, if there are
/// none.
pub(super) fn ranges(world: &[[f32; 3]], pose: &Pose, noise_m: f32, rng: &mut Rng) -> Scan {
    let step_rad = FRAC_PI_2 / SECTORS_MAX as f32;
    let first_azimuth_rad = 0.5 * (step_rad - FRAC_PI_2);
    let sectors = core::array::from_fn(|index| {
        let sight = Horizontal::from_bearing(pose.yaw_rad + first_azimuth_rad + step_rad * index as f32);
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
    });
    Scan { time: Instant(0), first_azimuth_rad, step_rad, range_max_m: 3.0, sectors }
}
