use std::vec::Vec;

use super::*;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::units::sin_cos;
use foxhound_core::localize::source::polar;

const SIGMA_RAD: f32 = 0.0325;

fn sighting(from: Horizontal, bearing_rad: f32) -> Sighting {
    Sighting {
        place_ned_m: from,
        direction_ned: Horizontal::from_bearing(bearing_rad),
        sigma_rad: SIGMA_RAD,
        since_s: 0.1,
    }
}

fn north(metres: f32) -> Horizontal {
    Horizontal { north: metres, east: 0.0 }
}

#[test]
fn the_papers_frame_is_east_and_north_and_its_direction_comes_from_the_transponder() {
    let filter = Config { range_m: 10.0, ..Config::DEFAULT }.build().unwrap();
    let mut state = State::default();
    assert_eq!(state.estimate(), None);
    // A robot at (3 north, 1 east) that hears the transponder due east of it is 10 m to the west of it.
    let heard = filter.step(&mut state, &sighting(Horizontal { north: 3.0, east: 1.0 }, core::f32::consts::FRAC_PI_2));
    assert_eq!(heard, Update::Started);
    assert!((state.x[0] + 10.0).abs() < 1e-4 && state.x[1].abs() < 1e-4, "{:?}", state.x);
    let estimate = state.estimate().unwrap();
    assert!(estimate.place_ned_m.minus(Horizontal { north: 3.0, east: 11.0 }).norm() < 1e-4, "{estimate:?}");
    assert!(
        (estimate.bearing_sigma_rad / SIGMA_RAD - 1.0).abs() < 1e-3 && (estimate.range_sigma_ratio - 1.0).abs() < 1e-3
    );
    // North-north is across, east-east along.
    assert!(estimate.covariance_m2[0] < 1.0 && estimate.covariance_m2[2] > 90.0, "{estimate:?}");
    // It moves by u: 2 m to the north and 4 m to the east.
    filter.step(&mut state, &sighting(Horizontal { north: 5.0, east: 5.0 }, (6.0_f32).atan2(-2.0)));
    assert!((state.x[0] + 6.0).abs() < 0.2 && (state.x[1] - 2.0).abs() < 0.2, "{:?}", state.x);
}

#[test]
fn the_gradient_is_that_of_finite_differences() {
    let mut rng = Rng::new(1, 25);
    for _ in 0..500 {
        let x = [10.0 * rng.gaussian(), 10.0 * rng.gaussian()];
        let Some(predicted) = predict(x, 0.5) else { continue };
        let h = |x: [f64; 2]| x.map(|v| v / x[0].hypot(x[1]));
        for j in 0..2 {
            let (mut up, mut down) = (x.map(f64::from), x.map(f64::from));
            (up[j], down[j]) = (up[j] + 1e-5, down[j] - 1e-5);
            let (up, down) = (h(up), h(down));
            // H = t g'.
            let [hx, hy] = predicted.direction.map(f64::from);
            for (i, t) in [-hy, hx].into_iter().enumerate() {
                let expected = (up[i] - down[i]) / 2e-5;
                let error = (t * f64::from(predicted.gradient[j]) - expected).abs();
                assert!(error < 1e-5 * (1.0 + expected.abs()), "{error}");
            }
        }
    }
}

/// Mean squared error of the place, what the filter claims it to be, and how often the range is within twice its standard
/// deviation, of the Cartesian filter from a guess, the same from the first bearing, and polar, over 500 runs: of a leg of
/// about 12 m, 6 m are flown.
fn straight() -> [[f32; 3]; 3] {
    let (prior_m, sigma_m) = (12.0, 5.0);
    let cartesian = Config { range_m: prior_m, range_sigma_m: sigma_m, ..Config::DEFAULT }.build().unwrap();
    let polar = polar::Config {
        inverse_range_per_m: 1.0 / prior_m,
        inverse_range_sigma_per_m: sigma_m / (prior_m * prior_m),
        outlier_rate: 0.0,
        ..polar::Config::DEFAULT
    };
    let polar = polar.build().unwrap();
    let mut rng = Rng::new(2, 25);
    let mut sums = [[0.0; 3]; 3];
    for _ in 0..500 {
        // Truths from the prior, but for those that the leg would reach.
        let range_m = loop {
            let range_m = prior_m + sigma_m * rng.gaussian();
            if range_m > 7.5 {
                break range_m;
            }
        };
        let source = north(range_m);
        let (mut guessed, mut heard_first, mut ours) = (State::default(), State::default(), polar::Resting::new());
        cartesian.begin(
            &mut guessed,
            north(0.0),
            Horizontal { north: prior_m, east: sigma_m * rng.gaussian() },
            sigma_m,
        );
        for k in 0..60 {
            let from = north(k as f32 * 0.1);
            let heard = sighting(from, source.minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian());
            cartesian.step(&mut guessed, &heard);
            cartesian.step(&mut heard_first, &heard);
            polar.step(&mut ours, &heard);
        }
        for (sum, estimate) in sums.iter_mut().zip([guessed.estimate(), heard_first.estimate(), ours.estimate()]) {
            let estimate = estimate.unwrap();
            sum[0] += estimate.place_ned_m.minus(source).norm_squared() / 500.0;
            sum[1] += (estimate.covariance_m2[0] + estimate.covariance_m2[2]) / 500.0;
            let off_m = (estimate.range_m - source.minus(north(5.9)).norm()).abs();
            sum[2] += if off_m < 2.0 * estimate.range_m * estimate.range_sigma_ratio { 1.0 / 500.0 } else { 0.0 };
        }
    }
    sums
}

#[test]
fn on_a_straight_run_it_claims_a_range_that_it_does_not_know_and_polar_does_not() {
    let [guessed, heard_first, polar] = straight();
    assert!(guessed[0] > 4.0 * guessed[1], "errs {} m^2, claims {} m^2", guessed[0], guessed[1]);
    // Of Gaussian errors 95 % would be within.
    let within = [guessed, heard_first, polar].map(|[_, _, within]| within);
    assert!(within[0] < 0.65 && within[0] < within[1] && within[1] < within[2] && within[2] > 0.93, "{within:?}");
}

#[test]
fn a_weave_lets_it_find_the_source() {
    let filter = Config::DEFAULT.build().unwrap();
    let mut rng = Rng::new(3, 25);
    let mut errors: Vec<f32> = (0..200)
        .map(|_| {
            let mut state = State::default();
            let source = north(12.0);
            for k in 0..60 {
                let time = k as f32 * 0.1;
                let from = Horizontal { north: time, east: sin_cos(1.5 * time).0 };
                filter.step(&mut state, &sighting(from, source.minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian()));
            }
            state.estimate().unwrap().place_ned_m.minus(source).norm()
        })
        .collect();
    errors.sort_by(f32::total_cmp);
    assert!(errors[100] < 1.0, "median {}", errors[100]);
}

#[test]
fn bearings_behind_wrap_as_directions_do() {
    let filter = Config::DEFAULT.build().unwrap();
    let (mut rng, mut state) = (Rng::new(4, 25), State::default());
    for k in 0..60 {
        let from = Horizontal { north: 0.0, east: 0.1 * k as f32 - 3.0 };
        let bearing = north(-12.0).minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian();
        if let Update::Fused { nis, .. } = filter.step(&mut state, &sighting(from, bearing)) {
            assert!(nis < 25.0, "{nis}");
        }
    }
    assert!(state.estimate().unwrap().place_ned_m.minus(north(-12.0)).norm() < 3.0, "{:?}", state.estimate());
}

#[test]
fn at_the_source_it_starts_over() {
    let filter = Config::DEFAULT.build().unwrap();
    let mut state = State::default();
    filter.begin(&mut state, north(0.0), north(4.0), 1.0);
    assert_eq!(filter.step(&mut state, &sighting(north(4.0), 0.0)), Update::Overhead);
    assert_eq!(state, State::default());
    assert_eq!(filter.step(&mut state, &sighting(north(4.0), 0.0)), Update::Started);
    assert_eq!(filter.step(&mut state, &sighting(north(f32::NAN), 0.0)), Update::Refused);
}

#[test]
fn a_config_that_cannot_be_names_its_field() {
    let field = |config: Config| config.build().unwrap_err().field;
    assert_eq!(field(Config { range_min_m: 0.0, ..Config::DEFAULT }), "cartesian.range_min_m");
    assert_eq!(field(Config { range_m: f32::NAN, ..Config::DEFAULT }), "cartesian.range_m");
    assert_eq!(field(Config { range_sigma_m: -1.0, ..Config::DEFAULT }), "cartesian.range_sigma_m");
    assert_eq!(field(Config { walk_m2_per_s: 11.0, ..Config::DEFAULT }), "cartesian.walk_m2_per_s");
}
