use super::*;
use crate::base::rng::Rng;
use crate::base::time::Instant;
use crate::base::units::wrap_pi;
use crate::doa::bearing::{Flags, Quality};

fn bearing(index: usize, sigma_rad: f32, quality: Quality) -> Bearing {
    let without = Bearing::without(Instant(100_000 * index as u64), quality, Flags::default());
    Bearing { valid: true, sigma_rad, ..without }
}

fn clean(snr_db: f32) -> Quality {
    Quality { snr_db, closure_chi2: 1.0, wavenumber: 1.0, coherence: Some(0.9999), ..Quality::default() }
}

/// Flies 2.4 m on a heading past a source at rest, all turned by `turn_rad` and moved; the level falls with the range.
fn passage(turn_rad: f32, noise_rad: f32, sightline: Sightline) -> (State, Estimate) {
    let (mut state, mut estimate, mut rng) = (State::new(), Estimate::UNKNOWN, Rng::new(4, 1));
    let source = Horizontal { north: 5.0, east: 0.0 };
    let turned = |v: Horizontal| {
        let (s, c) = crate::base::units::sin_cos(turn_rad);
        Horizontal { north: c * v.north - s * v.east, east: s * v.north + c * v.east }
    };
    for k in 0..30 {
        let place = Horizontal { north: 0.0, east: 0.1 * k as f32 - 2.4 };
        let to = source.minus(place);
        let heard = bearing(k, 0.01, clean(25.0 - 8.686 * libm::logf(to.norm())));
        let angle = wrap_pi(turned(to).bearing_rad() + noise_rad * rng.gaussian());
        let place_ned_m = turned(place).plus(Horizontal { north: 30.0 * turn_rad, east: -20.0 * turn_rad });
        let look = Features { place_ned_m, bearing: &heard, bearing_ned_rad: Some(angle), sightline };
        estimate = Classifier::TRAINED.step(&mut state, &look);
    }
    (state, estimate)
}

fn named(features: &[f32; FEATURES], name: &str) -> f32 {
    features[NAMES.iter().position(|other| *other == name).unwrap()]
}

#[test]
fn the_range_of_a_source_that_is_passed_and_how_the_bearing_wanders_are_found() {
    let features = passage(0.0, 0.0, Sightline::Unknown).0.features().unwrap();
    // The last observation is 5.02 m away.
    assert!((named(&features, "inverse_range") - 0.199).abs() < 0.01, "{features:?}");
    assert!(named(&features, "jitter") < libm::logf(0.006), "{features:?}");
    let wandering = passage(0.0, 0.1, Sightline::Unknown).0.features().unwrap();
    assert!((named(&wandering, "jitter") - libm::logf(0.1)).abs() < 0.4, "{wandering:?}");
    assert!(named(&wandering, "misfit") > libm::logf(30.0), "{wandering:?}");
}

#[test]
fn turning_the_world_and_moving_its_origin_change_nothing() {
    let features = passage(0.0, 0.0, Sightline::Clear).0.features().unwrap();
    for turn_rad in [0.7, 2.0, 3.1, -1.2] {
        let turned = passage(turn_rad, 0.0, Sightline::Clear).0.features().unwrap();
        for (name, (a, b)) in NAMES.iter().zip(features.iter().zip(turned)) {
            assert!((a - b).abs() < 0.02 + 0.01 * a.abs(), "{name}: {a} {b}");
        }
    }
}

#[test]
fn the_slope_of_the_level_is_that_of_the_distance() {
    let (mut state, mut last) = (State::new(), None);
    for k in 0..24 {
        let north = 0.1 * k as f32;
        let heard = bearing(k, 0.01, clean(30.0 - 8.686 * libm::logf(10.0 - north)));
        let place_ned_m = Horizontal { north, east: 0.0 };
        let look = Features { place_ned_m, bearing: &heard, bearing_ned_rad: Some(0.0), sightline: Sightline::Unknown };
        let _ = Classifier::TRAINED.step(&mut state, &look);
        last = state.features();
    }
    // 20 lg falls by 8.686 dB over a range: at 8.85 m, in the middle, 0.98 dB/m, reduced by a tenth.
    let slope = named(&last.unwrap(), "slope_db_per_m");
    assert!((0.85..1.0).contains(&slope), "{slope}");
    assert!(named(&last.unwrap(), "fading_db") < 0.2);
}

#[test]
fn a_wall_before_the_source_is_told_from_one_behind_it() {
    let nearer =
        |range_m: f32| named(&passage(0.0, 0.0, Sightline::Wall { range_m }).0.features().unwrap(), "wall_nearer");
    assert!(nearer(2.0) > 2.0 && nearer(20.0) < -2.0, "{} {}", nearer(2.0), nearer(20.0));
}

#[test]
fn looks_from_the_same_place_count_five_times_a_second_only() {
    let mut state = State::new();
    let look_at = |state: &mut State, time_us: u64, north: f32| {
        let heard = Bearing { time: Instant(time_us), ..bearing(0, 0.01, clean(20.0)) };
        let place_ned_m = Horizontal { north, east: 0.0 };
        let look = Features { place_ned_m, bearing: &heard, bearing_ned_rad: Some(0.1), sightline: Sightline::Unknown };
        let _ = Classifier::TRAINED.step(state, &look);
        state.count()
    };
    assert_eq!(look_at(&mut state, 1_000_000, 0.0), 1);
    assert_eq!(look_at(&mut state, 1_020_000, 0.02), 1, "too near");
    assert_eq!(look_at(&mut state, 1_040_000, 0.09), 2, "far enough");
    assert_eq!(look_at(&mut state, 1_200_000, 0.09), 2, "too soon");
    assert_eq!(look_at(&mut state, 1_250_000, 0.09), 3, "late enough");
    assert_eq!(look_at(&mut state, 2, 0.09), 4, "a clock that ran backwards");
    for k in 0..100 {
        let _ = look_at(&mut state, 10, k as f32);
    }
    assert_eq!(state.count(), WINDOW);
}

#[test]
fn nothing_is_said_before_there_are_enough_looks() {
    let mut state = State::new();
    for k in 0..usize::from(LOOKS_MIN) {
        let heard = bearing(k, 0.01, clean(20.0));
        let place_ned_m = Horizontal { north: k as f32, east: 0.0 };
        let look = Features { place_ned_m, bearing: &heard, bearing_ned_rad: Some(0.1), sightline: Sightline::Unknown };
        let estimate = Classifier::TRAINED.step(&mut state, &look);
        assert_eq!(estimate == Estimate::UNKNOWN, k + 1 < usize::from(LOOKS_MIN), "{k}");
    }
}

#[test]
fn a_clean_passage_is_line_of_sight_and_silence_is_none() {
    let (_, estimate) = passage(0.3, 0.005, Sightline::Unknown);
    assert_eq!(estimate.state, LinkState::LineOfSight, "{estimate:?}");
    let (mut state, mut estimate) = (State::new(), Estimate::UNKNOWN);
    for k in 0..30 {
        let silent = Bearing {
            valid: false,
            flags: Flags::NO_SIGNAL,
            ..bearing(k, core::f32::consts::PI, Quality { snr_db: -30.0, ..Quality::default() })
        };
        let place_ned_m = Horizontal { north: 0.1 * k as f32, east: 0.0 };
        let look = Features { place_ned_m, bearing: &silent, bearing_ned_rad: None, sightline: Sightline::Unknown };
        estimate = Classifier::TRAINED.step(&mut state, &look);
    }
    assert_eq!(estimate.state, LinkState::None, "{estimate:?}");
    assert!(estimate.probabilities[3] > 0.9, "{estimate:?}");
}

#[test]
fn features_that_are_no_numbers_know_nothing() {
    let estimate = Classifier::TRAINED.classify(&[f32::NAN; FEATURES]);
    assert!(estimate.probabilities.iter().all(|p| p.is_finite()), "{estimate:?}");
    let huge = Classifier::TRAINED.classify(&[f32::MAX; FEATURES]);
    assert!((huge.probabilities.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{huge:?}");
}

#[test]
fn the_network_is_two_layers_with_rectifiers_and_a_softmax() {
    let mut rng = Rng::new(2, 1);
    let mut draw = || rng.gaussian();
    for _ in 0..50 {
        let weights = Weights {
            hidden: core::array::from_fn(|_| core::array::from_fn(|_| draw())),
            hidden_bias: core::array::from_fn(|_| draw()),
            output: core::array::from_fn(|_| core::array::from_fn(|_| draw())),
            output_bias: core::array::from_fn(|_| draw()),
        };
        let features: [f32; FEATURES] = core::array::from_fn(|_| draw());
        let hidden: std::vec::Vec<f64> = (0..HIDDEN)
            .map(|h| {
                let sum: f64 = (0..FEATURES).map(|k| f64::from(weights.hidden[h][k]) * f64::from(features[k])).sum();
                (sum + f64::from(weights.hidden_bias[h])).max(0.0)
            })
            .collect();
        let powers: std::vec::Vec<f64> = (0..CLASSES)
            .map(|c| {
                let sum: f64 = (0..HIDDEN).map(|h| f64::from(weights.output[c][h]) * hidden[h]).sum();
                (sum + f64::from(weights.output_bias[c])).exp()
            })
            .collect();
        let estimate = Classifier::new(weights).classify(&features);
        for (p, power) in estimate.probabilities.iter().zip(&powers) {
            assert!((f64::from(*p) - power / powers.iter().sum::<f64>()).abs() < 1e-5);
        }
    }
}

#[test]
fn the_nearest_of_some_walls_is_what_lies_ahead() {
    let wall =
        |north: f32| walls::Wall::between(Horizontal { north, east: -1.0 }, Horizontal { north, east: 1.0 }).unwrap();
    let walls = [wall(7.0), wall(3.0), wall(-2.0), wall(5.0)];
    let here = Horizontal::default();
    assert_eq!(Sightline::among(&walls, here, 0.0, 0.0), Sightline::Wall { range_m: 3.0 });
    assert_eq!(Sightline::among(&walls, here, core::f32::consts::FRAC_PI_2, 0.0), Sightline::Clear);
    assert_eq!(Sightline::among(&[], here, 0.0, 0.0), Sightline::Clear);
}

#[test]
fn the_state_and_the_weights_are_small() {
    assert!(size_of::<State>() <= 704, "{}", size_of::<State>());
    assert!(size_of::<Weights>() <= 1024, "{}", size_of::<Weights>());
}
