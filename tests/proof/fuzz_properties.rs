//! The properties of the fuzz targets, on seeded cases.

#[path = "../../fuzz/src/lib.rs"]
pub mod properties;

use properties::{Reached, filters, frames, lidar, link, pad, radio, steer};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Runs a property on cases of up to `longest` random bytes, each with its own seed, and adds up what they reached.
fn run(property: fn(&[u8]) -> Reached, cases: u64, longest: u32) -> (u64, Reached) {
    let mut configured = 0;
    let mut sum = Reached::default();
    for seed in 0..cases {
        let mut source = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut case = vec![0; (source.next_u32() % longest) as usize];
        source.fill_bytes(&mut case);
        let reached = property(&case);
        configured += u64::from(reached.configured);
        sum.answers += reached.answers;
        sum.usable += reached.usable;
        sum.settled += reached.settled;
    }
    (configured, sum)
}

/// Any samples and configuration give finite bearings with a sigma.
#[test]
fn any_frames_and_configurations_give_finite_bearings_with_a_sigma() {
    let (configured, sum) = run(frames, 4000, 2000);
    assert!(configured > 1000 && sum.usable > 500, "too shallow: {configured} configured, {sum:?}");
}

/// Any bytes leave the link in a valid state, and its own frames are whole.
#[test]
fn any_bytes_leave_the_link_sane_and_its_own_frames_whole() {
    let (configured, sum) = run(link, 4000, 4000);
    assert!(
        configured > 1000 && sum.usable > 2000 && sum.settled > 500,
        "too shallow: {configured} configured, {sum:?}"
    );
}

/// Any inputs of guidance give finite plans, and finite setpoints within the limits.
#[test]
fn any_steering_gives_finite_setpoints_inside_the_limits_and_finite_plans() {
    let (configured, sum) = run(steer, 2400, 3000);
    assert!(
        configured > 1000 && sum.answers > 200_000 && sum.usable > 60_000,
        "too shallow: {configured} configured, {sum:?}"
    );
}

/// Any measurements leave every filter's covariance finite, symmetric and positive.
#[test]
fn any_measurements_leave_every_filter_finite_symmetric_and_positive() {
    let (configured, sum) = run(filters, 8000, 2000);
    assert!(
        configured > 1000 && sum.answers > 100_000 && sum.usable > 50_000,
        "too shallow: {configured} configured, {sum:?}"
    );
}

/// Any camera lines leave the pad detector in a valid state.
#[test]
fn any_lines_leave_the_pad_detector_sane() {
    let (configured, sum) = run(pad, 4000, 400);
    assert!(
        configured > 1000 && sum.answers > 4000 && sum.usable > 20,
        "too shallow: {configured} configured, {sum:?}"
    );
}

/// Any bytes of a lidar leave it sane, and its whole frames are found.
#[test]
fn any_bytes_of_a_lidar_leave_it_sane_and_whole_frames_are_found() {
    let (configured, sum) = run(lidar, 4000, 4000);
    assert!(
        configured > 1000 && sum.answers > 50_000 && sum.usable > 500,
        "too shallow: {configured} configured, {sum:?}"
    );
}

/// With arbitrary bytes the readers of direction finders stay valid, and they find the valid reports.
#[test]
fn any_bytes_of_a_direction_finder_leave_it_sane_and_whole_reports_are_found() {
    let (configured, sum) = run(radio, 4000, 4000);
    assert!(
        configured > 1000 && sum.answers > 10_000 && sum.usable > 1000 && sum.settled > 5000,
        "too shallow: {configured} configured, {sum:?}"
    );
}
