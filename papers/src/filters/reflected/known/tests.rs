use core::f32::consts::TAU;
use std::vec::Vec;

use super::*;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::units::sin_cos;

const SIGMA_RAD: f32 = 0.05;

fn at(north: f32, east: f32) -> Horizontal {
    Horizontal { north, east }
}

fn wall(a: Horizontal, b: Horizontal) -> Wall {
    Wall::between(a, b).unwrap()
}

/// Median error of the source's place after 20 s on a circle of 3 m, off these walls.
fn median_error<const N: usize>(lines: [Wall; N], source: Horizontal, seed: u64) -> f32 {
    let filter = polar::Config { outlier_rate: 0.0, ..polar::Config::DEFAULT }.build().unwrap();
    let (known, mut rng) = (Known { filter, lines }, Rng::new(seed, 26));
    let mut errors: Vec<f32> = (0..100)
        .map(|_| {
            let mut state = polar::Resting::new();
            let mut from = Horizontal::default();
            for k in 0..200 {
                let (s, c) = sin_cos(0.0628 * k as f32);
                from = at(3.0 * s, 3.0 * c);
                let last = crate::filters::reflected::fold::points(&lines, source, from).unwrap()[N - 1];
                let bearing = last.minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian();
                let heard = Sighting {
                    place_ned_m: from,
                    direction_ned: Horizontal::from_bearing(bearing),
                    sigma_rad: SIGMA_RAD,
                    since_s: 0.1,
                };
                known.step(&mut state, &heard).unwrap();
            }
            let estimate = known.estimate(&state, from).unwrap();
            let to = source.minus(from);
            assert!((estimate.range_m - to.norm()).abs() < 0.5 * to.norm());
            assert!(
                estimate
                    .place_ned_m
                    .minus(from)
                    .minus(Horizontal::from_bearing(estimate.bearing_ned_rad).times(estimate.range_m))
                    .norm()
                    < 1e-2
            );
            estimate.place_ned_m.minus(source).norm()
        })
        .collect();
    errors.sort_by(f32::total_cmp);
    errors[50]
}

#[test]
fn a_source_is_found_through_one_wall_whichever_way_it_runs() {
    for (line, source) in [
        (wall(at(10.0, -40.0), at(10.0, 40.0)), at(4.0, 9.0)),
        (wall(at(-40.0, 8.0), at(40.0, 8.0)), at(9.0, 2.0)),
        (wall(at(40.0, -28.0), at(-30.0, 42.0)), at(-8.0, 6.0)),
    ] {
        let error = median_error([line], source, 1);
        assert!(error < 1.5, "{line:?}: {error}");
    }
}

#[test]
fn a_source_is_found_through_a_corner() {
    // The vehicle hears the east wall, and that hears the north wall.
    let lines = [wall(at(9.0, -90.0), at(9.0, 90.0)), wall(at(-90.0, 8.0), at(90.0, 8.0))];
    let error = median_error(lines, at(-2.0, -10.0), 2);
    assert!(error < 2.0, "{error}");
}

#[test]
fn what_has_no_geometry_is_told_and_changes_nothing() {
    let filter = polar::Config::DEFAULT.build().unwrap();
    let known = Known { filter, lines: [wall(at(10.0, -40.0), at(10.0, 40.0))] };
    let mut state = polar::Resting::new();
    let heard = |place: Horizontal, bearing_rad: f32| Sighting {
        place_ned_m: place,
        direction_ned: Horizontal::from_bearing(bearing_rad),
        sigma_rad: SIGMA_RAD,
        since_s: 0.1,
    };
    assert_eq!(known.step(&mut state, &heard(at(0.0, 0.0), 0.4)), Ok(Update::Started));
    let before = state;
    assert_eq!(known.step(&mut state, &heard(at(10.0, 0.0), 0.4)), Err(Degenerate::OnLine));
    assert_eq!(known.step(&mut state, &heard(at(0.0, 0.0), 2.0)), Err(Degenerate::NoReflection));
    assert_eq!(known.step(&mut state, &heard(at(f32::NAN, 0.0), 0.4)), Ok(Update::Refused));
    assert_eq!(state, before);
}

#[test]
fn any_stream_behind_any_walls_leaves_it_finite() {
    let filter = polar::Config::DEFAULT.build().unwrap();
    let mut rng = Rng::new(3, 26);
    for _ in 0..300 {
        let mut wild = || libm::expf(16.0 * rng.uniform() - 8.0) * rng.gaussian();
        let mut line = || Wall::between(at(wild(), wild()), at(wild(), wild())).unwrap_or_default();
        let known = Known { filter, lines: [line(), line()] };
        let mut state = polar::Moving::new();
        for _ in 0..100 {
            let scale = libm::expf(16.0 * rng.uniform() - 8.0);
            let heard = Sighting {
                place_ned_m: at(scale * rng.gaussian(), scale * rng.gaussian()),
                direction_ned: Horizontal::from_bearing(TAU * rng.uniform()),
                sigma_rad: libm::expf(10.0 * rng.uniform() - 9.0),
                since_s: libm::expf(10.0 * rng.uniform() - 8.0),
            };
            let _ = known.step(&mut state, &heard);
            if let Some(estimate) = known.estimate(&state, heard.place_ned_m) {
                assert!(estimate.place_ned_m.is_finite() && estimate.velocity_ned_mps.is_finite(), "{heard:?}");
                assert!(estimate.covariance_m2.iter().all(|v| v.is_finite()) && estimate.bearing_ned_rad.is_finite());
            }
        }
    }
}
