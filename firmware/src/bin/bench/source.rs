//! The source's position: the filter that uses the bearing, the walls and the link state that they get, the seeking
//! with one antenna, and the search. Each row is the worst of a seeded run.

use core::f32::consts::TAU;
use core::hint::black_box;

use crate::halt;
use foxhound_core::base::config::{Fence, RangeSensor};
use foxhound_core::base::ned::Horizontal;
use foxhound_core::base::obstacle::Disc;
use foxhound_core::base::pose::Pose;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::{sin_cos, wrap_pi};
use foxhound_core::doa::bearing::{Bearing, Flags, Quality};
use foxhound_core::doa::rotating;
use foxhound_core::localize::link_state::{self, Classifier, Features, Sightline};
use foxhound_core::localize::source::{Sighting, bank, polar};
use foxhound_core::mapping::map::CIRCLES_MAX;
use foxhound_core::mapping::walls::{self, Wall};
use foxhound_core::planning::explore;

use super::row;

/// Steps of a run.
const STEPS: usize = 128;
/// One bearing in this many is random.
const OUTLIER: usize = 16;
const SIGMA_RAD: f32 = 0.05;
const SOURCE_NED_M: Horizontal = Horizontal { north: 2.0, east: 9.0 };
/// A room for the walls and the search.
const ROOM_M: Horizontal = Horizontal { north: 6.0, east: 5.0 };

#[inline(never)]
pub(super) fn rows(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    filter(measure);
    several(measure);
    link(measure);
    walls(measure);
    one_antenna(measure);
    search(measure);
}

/// Sightings of a place from a weaving path.
struct Path(Rng);

impl Path {
    fn sighting(&mut self, k: usize, to: Horizontal) -> Sighting {
        let place_ned_m = Horizontal { north: 3.0 * sin_cos(0.1 * k as f32).0, east: -0.05 * k as f32 };
        let noise = if k % OUTLIER == OUTLIER - 1 { 6.0 * self.0.uniform() } else { SIGMA_RAD * self.0.gaussian() };
        let bearing_rad = to.minus(place_ned_m).bearing_rad() + noise;
        Sighting {
            place_ned_m,
            direction_ned: Horizontal::from_bearing(bearing_rad),
            sigma_rad: SIGMA_RAD,
            since_s: 0.1,
        }
    }
}

#[inline(never)]
fn filter(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(filter) = polar::Config::DEFAULT.build() else { halt(format_args!("the built-in filter does not build")) };
    let (mut state, mut path) = (polar::Resting::new(), Path(Rng::new(1, 40)));
    let counts = (0..STEPS).map(|k| {
        let heard = path.sighting(k, SOURCE_NED_M);
        measure(&mut || _ = black_box(filter.step(&mut state, black_box(&heard))))
    });
    row("ekf_2", counts.max().unwrap_or_default(), 600);
}

/// Around the corner of [`Path`]'s wall, then in view; three walls are known.
#[inline(never)]
fn several(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(bank) = bank::Config::DEFAULT.build() else { halt(format_args!("the built-in bank does not build")) };
    let wall = |from: [f32; 2], to: [f32; 2]| {
        let at = |[north, east]: [f32; 2]| Horizontal { north, east };
        Wall::between(at(from), at(to)).unwrap_or_default()
    };
    let walls = [wall([13.0, -9.0], [13.0, 14.0]), wall([-4.0, 14.0], [13.0, 14.0]), wall([-4.0, -9.0], [-4.0, 14.0])];
    let image = walls[0].mirror(SOURCE_NED_M);
    let (mut state, mut path, mut most) = (bank::State::new(), Path(Rng::new(2, 40)), 0);
    for k in 0..2 * STEPS {
        let hidden = k % 128 < 90;
        let heard = path.sighting(k, if hidden { image } else { SOURCE_NED_M });
        let reflected = if hidden { 0.7 } else { 0.2 };
        most = most.max(measure(&mut || _ = black_box(bank.step(&mut state, black_box(&heard), reflected, &walls))));
    }
    row("bank_step", most, 0);
}

#[inline(never)]
fn link(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let (mut state, mut path, mut most) = (link_state::State::new(), Path(Rng::new(3, 40)), 0);
    for k in 0..STEPS {
        let heard = path.sighting(k, SOURCE_NED_M);
        let bearing = Bearing {
            time: Instant(100_000 * k as u64),
            valid: true,
            azimuth_rad: 0.0,
            sigma_rad: SIGMA_RAD,
            elevation_rad: 0.0,
            elevation_sigma_rad: 0.1,
            quality: Quality {
                snr_db: 20.0 + path.0.gaussian(),
                closure_chi2: 1.0 + path.0.uniform(),
                wavenumber: 1.0,
                coherence: Some(0.99),
                ..Quality::default()
            },
            flags: Flags::default(),
        };
        let look = Features {
            place_ned_m: heard.place_ned_m,
            bearing: &bearing,
            bearing_ned_rad: (k % 7 > 0).then(|| heard.direction_ned.bearing_rad()),
            sightline: Sightline::Wall { range_m: 4.0 },
        };
        most = most.max(measure(&mut || _ = black_box(Classifier::TRAINED.step(&mut state, black_box(&look)))));
    }
    row("link_state_step", most, 6_000);
}

/// Places along the walls of a room, in the order of a scan, none nearer to the middle than the walls; the share `strays` of
/// them is off their wall.
fn room(rng: &mut Rng, strays: f32) -> [Horizontal; CIRCLES_MAX] {
    let (yaw_rad, size) = (rng.uniform(), 0.7 + 0.3 * rng.uniform());
    let side = |k: usize| {
        let (along, half) = ((k % 32) as f32 / 16.0 - 1.0, ROOM_M.times(size));
        match k / 32 {
            0 => Horizontal { north: half.north, east: along * half.east },
            1 => Horizontal { north: -along * half.north, east: half.east },
            2 => Horizontal { north: -half.north, east: -along * half.east },
            _ => Horizontal { north: along * half.north, east: -half.east },
        }
    };
    let (sine, cosine) = sin_cos(yaw_rad);
    core::array::from_fn(|k| {
        let sigma_m = if rng.uniform() < strays { 0.5 } else { 0.03 };
        let place = side(k).plus(Horizontal { north: sigma_m * rng.gaussian(), east: sigma_m * rng.gaussian() });
        Horizontal { north: cosine * place.north - sine * place.east, east: sine * place.north + cosine * place.east }
    })
}

/// Four walls as a scan has them; and with strays among them, from one point in seven to all.
#[inline(never)]
fn walls(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(lines) = walls::Config::DEFAULT.build() else { halt(format_args!("the split and merge does not build")) };
    let mut workspace = walls::Workspace::new();
    let mut rng = Rng::new(4, 40);
    let mut find = |strays: f32| {
        let (points, mut found) = (room(&mut rng, strays), 0);
        (measure(&mut || found = black_box(lines.find(&mut workspace, black_box(&points))).len()), found)
    };
    let (mut most, mut most_with_strays) = (0, 0);
    for k in 0..STEPS {
        let (count, found) = find(0.0);
        if found != 4 {
            halt(format_args!("the split and merge finds {found} walls of 4"));
        }
        most = most.max(count);
        most_with_strays = most_with_strays.max(find((1 + k % 7) as f32 / 7.0).0);
    }
    row("lines_split_merge_full", most, 0);
    row("lines_split_merge_strays", most_with_strays, 0);
}

/// A cardioid turning once in 2.4 s, 50 readings a second, a reflection now and then.
#[inline(never)]
fn one_antenna(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    const READINGS: usize = 120;
    let config = rotating::Config::default();
    let Ok(seeker) = config.build() else { halt(format_args!("the seeking does not build")) };
    let (mut state, mut rng) = (rotating::State::new(), Rng::new(5, 40));
    let (mut reading, mut rotation, mut rotations) = (0, 0, 0);
    for k in 0..(STEPS + 1) * READINGS {
        let yaw_rad = wrap_pi(TAU * k as f32 / READINGS as f32);
        let echo = if (k / READINGS).is_multiple_of(3) { config.pattern.gain_db(yaw_rad + 2.0) - 6.0 } else { -60.0 };
        let direct = config.pattern.gain_db(yaw_rad - 1.0);
        let power_db = -70.0 + direct.max(echo) + rng.gaussian();
        let time = Instant(20_000 * k as u64);
        let mut is_over = false;
        let count = measure(&mut || {
            is_over = black_box(seeker.step(&mut state, time, black_box(yaw_rad), black_box(power_db))).is_some();
        });
        if is_over {
            (rotation, rotations) = (rotation.max(count), rotations + 1);
        } else {
            reading = reading.max(count);
        }
    }
    if rotations < STEPS - 1 {
        halt(format_args!("the antenna turned {rotations} times"));
    }
    row("rss_step", reading, 500);
    row("rss_rotation", rotation, 15_000);
}

/// Distance that the search keeps from obstacles: that of a vehicle of the default size.
const CLEARANCE_M: f32 = 0.2;

/// A room of as many circles as the map holds, with a door, and obstacles outside.
#[inline(never)]
fn search(measure: &impl Fn(&mut dyn FnMut()) -> u32) {
    let Ok(explorer) = explore::Config::default().build(CLEARANCE_M, &Fence::DEFAULT) else {
        halt(format_args!("the search does not build"))
    };
    let (mut state, mut rng) = (explore::State::new(), Rng::new(6, 40));
    let circles = room(&mut rng, 0.1).map(|center_ned_m| Disc { center_ned_m, radius_m: 0.15, ..Disc::default() });
    let sensor = RangeSensor { fov_rad: TAU, ..RangeSensor::DEFAULT };
    let (mut here, mut most) = (Horizontal::default(), 0);
    for k in 0..STEPS {
        let pose = Pose { position_ned_m: here, yaw_rad: wrap_pi(0.3 * k as f32) };
        let mut explored = explore::Explored::NoPose;
        most = most.max(measure(&mut || {
            explored =
                explorer.step(&mut state, Instant(500_000 * k as u64), &pose, &sensor, black_box(&circles).iter());
        }));
        match explored {
            // Walls do not hinder the bench.
            explore::Explored::Target(target) => here = here.plus(target.minus(here).clamped(0.5)),
            _ => state.end(),
        }
    }
    row("explore_full", most, 0);
}
