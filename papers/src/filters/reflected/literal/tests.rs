use std::vec::Vec;

use super::*;
use crate::filters::reflected::{of_slope_intercept, slope_intercept};
use foxhound_core::base::rng::Rng;
use foxhound_core::base::units::sin_cos;
use foxhound_core::mapping::walls::Wall;

const SIGMA_RAD: f32 = 0.05;
/// y = 0.4 x + 10.
const WALL: [f32; 2] = [0.4, 10.0];

fn at(north: f32, east: f32) -> Horizontal {
    Horizontal { north, east }
}

fn sighting(from: Horizontal, bearing_rad: f32) -> Sighting {
    Sighting {
        place_ned_m: from,
        direction_ned: Horizontal::from_bearing(bearing_rad),
        sigma_rad: SIGMA_RAD,
        since_s: 0.1,
    }
}

fn circle(k: u32) -> Horizontal {
    let (s, c) = sin_cos(0.0628 * k as f32);
    at(4.0 * s, 4.0 * c)
}

fn guess(source: Horizontal, line: [f32; 2]) -> Guess {
    Guess {
        vehicle_ned_m: circle(0),
        vehicle_sigma_m: 0.05,
        source_ned_m: source,
        source_sigma_m: 3.0,
        slope_intercept: line,
        slope_intercept_sigma: [0.08, 1.0],
    }
}

fn fly(filter: &Filter, state: &mut State, source: Horizontal, rng: &mut Rng) {
    let image = of_slope_intercept(WALL).mirror(source);
    for k in 0..300 {
        let from = circle(k);
        let bearing = image.minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian();
        let _ = filter.step(state, &sighting(from, bearing));
    }
}

#[test]
fn with_the_line_known_it_finds_a_source_from_a_guess_nearby() {
    let (filter, mut rng) = (Config::DEFAULT.build().unwrap(), Rng::new(1, 27));
    let source = at(2.0, 9.0);
    let mut errors: Vec<f32> = (0..100)
        .map(|_| {
            let mut state = State::default();
            let from = source.plus(at(3.0 * rng.gaussian(), 3.0 * rng.gaussian()));
            filter.begin_known(&mut state, &guess(from, WALL)).unwrap();
            fly(&filter, &mut state, source, &mut rng);
            assert_eq!(state.slope_intercept(), WALL);
            state.estimate().unwrap().place_ned_m.minus(source).norm()
        })
        .collect();
    errors.sort_by(f32::total_cmp);
    assert!(errors[50] < 1.5, "{}", errors[50]);
}

#[test]
fn with_the_line_unknown_the_image_is_found_and_the_frame_is_that_of_the_map() {
    let (filter, mut rng) = (Config::DEFAULT.build().unwrap(), Rng::new(2, 27));
    let source = at(2.0, 9.0);
    let mut state = State::default();
    // The guess is the truth: it comes back in the map's frame.
    filter.begin_unknown(&mut state, &guess(source, WALL)).unwrap();
    assert!(state.estimate().unwrap().place_ned_m.minus(source).norm() < 1e-4);
    let [m, c] = state.slope_intercept();
    assert!((m - WALL[0]).abs() < 1e-5 && (c - WALL[1]).abs() < 1e-4, "{m} {c}");
    let image = of_slope_intercept(WALL).mirror(source);
    let mut errors: Vec<f32> = (0..100)
        .map(|_| {
            let from = source.plus(at(2.0 * rng.gaussian(), 2.0 * rng.gaussian()));
            filter.begin_unknown(&mut state, &guess(from, [0.45, 9.5])).unwrap();
            fly(&filter, &mut state, source, &mut rng);
            let line = of_slope_intercept(state.slope_intercept());
            line.mirror(state.estimate().unwrap().place_ned_m).minus(image).norm()
        })
        .collect();
    errors.sort_by(f32::total_cmp);
    assert!(errors[50] < 2.5, "{}", errors[50]);
}

#[test]
fn vertical_walls_filters_that_have_not_begun_and_vehicles_on_the_line_are_told() {
    let filter = Config::DEFAULT.build().unwrap();
    let mut state = State::default();
    assert_eq!(filter.step(&mut state, &sighting(at(0.0, 0.0), 0.1)), Err(Degenerate::NotBegun));
    let vertical = slope_intercept(&Wall::between(at(-9.0, 8.0), at(9.0, 8.0)).unwrap());
    let steep = guess(at(2.0, 2.0), vertical);
    assert_eq!(filter.begin_known(&mut state, &steep), Err(Degenerate::Vertical));
    assert_eq!(filter.begin_unknown(&mut state, &steep), Err(Degenerate::Vertical));
    assert_eq!(state, State::default());
    filter.begin_known(&mut state, &Guess { vehicle_sigma_m: 0.0, ..guess(at(2.0, 9.0), [0.0, 10.0]) }).unwrap();
    assert_eq!(filter.step(&mut state, &sighting(at(10.0, 4.0), 0.1)), Err(Degenerate::OnLine));
    assert!(matches!(filter.step(&mut state, &sighting(at(8.0, 4.0), 0.1)), Ok(Update::Fused { .. })));
}
