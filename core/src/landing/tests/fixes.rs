//! The fix of the beacon, and configurations that are refused.

use super::super::*;
use super::model::{Flight, World, towards_beacon};
use super::{Landing, Memory};
use crate::base::rng::Rng;
use crate::base::units::wrap_pi;
use crate::doa::bearing::{Bearing, Flags, Quality};
use crate::localize::source::near;

/// Bearings of a beacon from a vehicle that hovers 2 m above it, for some seconds.
fn hovering(beacon: Horizontal, yaw_rad: f32, roll_rad: f32, flags: Flags) -> Option<Fix> {
    let mut state = near::State::default();
    let place_ned_m = Ned { down: -2.0, ..Ned::default() };
    let pose = FullPose { place_ned_m, roll_rad, yaw_rad, ..FullPose::default() };
    for step in 1..200_u64 {
        let axes = pose.axes();
        let range_m = libm::sqrtf(beacon.norm_squared() + 4.0);
        let along = |axis: Ned| (axis.north * beacon.north + axis.east * beacon.east + axis.down * 2.0) / range_m;
        let (forward, right) = (along(axes.forward), along(axes.right));
        let k = libm::hypotf(forward, right);
        let bearing = Bearing {
            time: Instant(20_000 * step),
            valid: flags == Flags::default(),
            azimuth_rad: wrap_pi(libm::atan2f(right, forward)),
            sigma_rad: (0.02 / k).min(3.1),
            elevation_rad: libm::acosf(k.min(1.0)),
            elevation_sigma_rad: 0.02,
            quality: Quality { wavenumber: k, snr_db: 20.0, ..Quality::default() },
            flags,
        };
        state.hear(&bearing, &pose, None);
    }
    state.fix(Instant(20_000 * 199), place_ned_m)
}

#[test]
fn the_fix_is_where_the_bearing_points_from_any_attitude() {
    for yaw_rad in [0.0, core::f32::consts::FRAC_PI_2, -2.0] {
        for roll_rad in [0.0, 0.15] {
            for (north, east) in [(1.0, 0.0), (0.0, -1.2), (0.5, 0.5), (0.0, 0.3)] {
                let beacon = Horizontal { north, east };
                let fix = hovering(beacon, yaw_rad, roll_rad, Flags::default()).unwrap();
                let off_m = fix.place_ned_m.horizontal().minus(beacon).norm();
                assert!(off_m < 0.05, "{yaw_rad} {roll_rad} {beacon:?}: {fix:?}");
            }
        }
    }
}

/// The array cannot tell above from below: leaning by 20 degrees towards a level beacon it hears it as if it were 40 degrees below.
#[test]
fn a_level_beacon_makes_no_fix_however_the_vehicle_leans() {
    let beacon = Horizontal { north: 0.0, east: 200.0 };
    for roll_rad in [-0.5, -0.35, 0.0, 0.35, 0.5] {
        assert_eq!(hovering(beacon, 0.0, roll_rad, Flags::default()), None, "{roll_rad}");
    }
}

#[test]
fn overhead_a_bearing_without_an_azimuth_is_a_good_one_and_without_a_calibration_none_is() {
    let beacon = Horizontal { north: 0.02, east: 0.01 };
    let fix = hovering(beacon, 0.3, 0.0, Flags::AMBIGUOUS).unwrap();
    assert!(fix.distance_m < 0.1 && fix.sigma_m < 0.4, "{fix:?}");
    assert_eq!(hovering(beacon, 0.3, 0.0, Flags::AMBIGUOUS.with(Flags::UNCALIBRATED)), None);
    assert_eq!(hovering(beacon, 0.3, 0.0, Flags::AMBIGUOUS.with(Flags::NO_SIGNAL)), None);
}

#[test]
fn the_fix_errs_no_more_than_it_says() {
    let lander = Landing::new(Config::default());
    let (mut squares, mut count, mut worst) = (0.0_f32, 0.0_f32, 0.0_f32);
    for seed in 0..100 {
        let mut rng = Rng::new(seed, 31);
        let direction = Horizontal::from_bearing(core::f32::consts::TAU * rng.uniform()).times(8.0);
        // As high as assumed, within the sigma that is assumed.
        let start_ned_m = Ned { down: -2.0 + rng.gaussian().clamp(-1.0, 1.0), ..Ned::default() };
        let beacon_ned_m = Ned { north: direction.north, east: direction.east, down: 0.0 };
        let world = World { seed, start_ned_m, beacon_ned_m, bias_rad: 5.0 / 57.3, ..World::new(seed) };
        let (mut flight, mut state) = (Flight::new(world), Memory::default());
        let mut last = Stage::Seeking;
        while flight.time_s() < 60.0 && last != Stage::HandedOver {
            let output = flight.step(&lander, &mut state, towards_beacon);
            if output.stage != last {
                // At the arrival, and at the end.
                let target = output.target.unwrap();
                let off_m = target.place_ned_m.horizontal().minus(flight.beacon()).norm();
                let ratio = off_m / target.sigma_m;
                squares += ratio * ratio;
                count += 1.0;
                worst = worst.max(ratio);
            }
            last = output.stage;
        }
    }
    // Sigma is that of the worse of two axes.
    let mean = squares / count;
    assert!(count >= 200.0 && mean < 2.0 && worst < 4.0, "{count} {mean} {worst}");
}

#[test]
fn a_refused_value_names_its_field() {
    let name = |config: Config| config.build(2.0).unwrap_err().field;
    let (s, c) = (search::Config::default(), centring::Config::default());
    for (config, field) in [
        (Config { pad_radius_m: 0.0, ..Config::default() }, "landing.pad_radius_m"),
        (Config { pad_radius_m: 1.3, ..Config::default() }, "landing.pad_radius_m"),
        (Config { focal_widths: f32::NAN, ..Config::default() }, "landing.focal_widths"),
        (Config { total_s: 0.0, ..Config::default() }, "landing.total_s"),
        (Config { arrival: arrival::Config { arrive_m: -1.0 }, ..Config::default() }, "landing.arrival.arrive_m"),
        (Config { search: search::Config { radius_m: 1e3, ..s }, ..Config::default() }, "landing.search.radius_m"),
        (
            Config { centring: centring::Config { kp_per_s: 9.0, ..c }, ..Config::default() },
            "landing.centring.kp_per_s",
        ),
    ] {
        assert_eq!(name(config), field);
    }
    assert!(Config::default().build(2.0).is_ok());
}
