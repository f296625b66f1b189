use std::vec::Vec;

use super::*;
use crate::base::rng::Rng;
use crate::base::units::{sin_cos, wrap_pi};

const SIGMA_RAD: f32 = 0.0325;

fn filter() -> Filter {
    Config { outlier_rate: 0.0, ..Config::DEFAULT }.build().unwrap()
}

/// The prior that sources are drawn from: with one position only, the consistency would depend on its range.
fn drawn() -> Config {
    Config { inverse_range_per_m: 0.08, inverse_range_sigma_per_m: 0.01, outlier_rate: 0.0, ..Config::DEFAULT }
}

fn draw(rng: &mut Rng) -> Horizontal {
    north(1.0 / (0.08 + 0.01 * rng.gaussian()))
}

fn sighting(from: Horizontal, bearing_rad: f32) -> Sighting {
    Sighting {
        place_ned_m: from,
        direction_ned: Horizontal::from_bearing(bearing_rad),
        sigma_rad: SIGMA_RAD,
        since_s: 0.1,
    }
}

/// Takes sightings of a moving source from a path at 1 m/s and 10 Hz.
fn run<const S: usize>(
    filter: &Filter,
    rng: &mut Rng,
    source: impl Fn(f32) -> Horizontal,
    path: impl Fn(f32) -> Horizontal,
    length_s: f32,
    mut watch: impl FnMut(f32, &State<S>, Update),
) -> State<S> {
    let mut state = State::new();
    for k in 0..(length_s * 10.0) as u32 {
        let time_s = k as f32 * 0.1;
        let from = path(time_s);
        let truth = source(time_s).minus(from).bearing_rad();
        let heard = filter.step(&mut state, &sighting(from, truth + SIGMA_RAD * rng.gaussian()));
        watch(time_s, &state, heard);
    }
    state
}

fn north(metres: f32) -> Horizontal {
    Horizontal { north: metres, east: 0.0 }
}

fn weave(time_s: f32) -> Horizontal {
    Horizontal { north: time_s, east: sin_cos(1.5 * time_s).0 }
}

/// Squared error of the state over its covariance, in bearing and inverse range.
fn nees<const S: usize>(state: &State<S>, source: Horizontal) -> f32 {
    let to = source.minus(state.place_ned_m);
    let e = [wrap_pi(state.mean()[0] - to.bearing_rad()), state.mean()[1] - 1.0 / to.norm()];
    let [a, b, d] = [state.p[0][0], state.p[0][1], state.p[1][1]];
    (d * e[0] * e[0] - 2.0 * b * e[0] * e[1] + a * e[1] * e[1]) / (a * d - b * b)
}

#[test]
fn the_covariance_moves_as_finite_differences_say() {
    let still = Config { odometry_m2_per_s: 0.0, acceleration_m2_per_s3: 0.0, ..Config::DEFAULT }.build().unwrap();
    let mut rng = Rng::new(1, 9);
    for _ in 0..200 {
        let mut state = Moving { started: true, ..State::new() };
        state.direction_ned = Horizontal::from_bearing(6.0 * rng.uniform() - 3.0);
        state.inverse_range_per_m = 0.05 + rng.uniform();
        state.velocity_ned_per_s = Horizontal { north: 0.2 * rng.gaussian(), east: 0.2 * rng.gaussian() };
        // Any covariance: A A'.
        let a: [[f32; 4]; 4] = core::array::from_fn(|_| core::array::from_fn(|_| 0.1 * rng.gaussian()));
        for i in 0..4 {
            for j in i..4 {
                state.p[i][j] = (0..4).map(|k| a[i][k] * a[j][k]).sum();
            }
        }
        let place = Horizontal { north: 0.2 * rng.gaussian(), east: 0.2 * rng.gaussian() };
        let moved = |x: [f64; 4]| -> [f64; 4] {
            let (dn, de) = (f64::from(place.north), f64::from(place.east));
            let m = [x[0].cos() + 0.1 * x[2] - x[1] * dn, x[0].sin() + 0.1 * x[3] - x[1] * de];
            let s = m[0].hypot(m[1]);
            [m[1].atan2(m[0]), x[1] / s, x[2] / s, x[3] / s]
        };
        let x = state.mean().map(f64::from);
        let mut jacobian = [[0.0; 4]; 4];
        for j in 0..4 {
            let (mut up, mut down) = (x, x);
            (up[j], down[j]) = (x[j] + 1e-6, x[j] - 1e-6);
            let (up, down) = (moved(up), moved(down));
            for i in 0..4 {
                let difference = up[i] - down[i];
                let turns = (difference / std::f64::consts::TAU).round();
                jacobian[i][j] = (difference - if i == 0 { turns * std::f64::consts::TAU } else { 0.0 }) / 2e-6;
            }
        }
        let (before, after) = (state, moved(x));
        if !still.carry(&mut state, place, 0.1) {
            continue;
        }
        for i in 0..4 {
            assert!((f64::from(state.mean()[i]) - after[i]).abs() < 1e-5 * (1.0 + after[i].abs()));
            for j in i..4 {
                let entry = |k: usize, l: usize| f64::from(before.covariance(k, l));
                let expected: f64 = (0..4)
                    .flat_map(|k| (0..4).map(move |l| (k, l)))
                    .map(|(k, l)| jacobian[i][k] * entry(k, l) * jacobian[j][l])
                    .sum();
                let error = (f64::from(state.p[i][j]) - expected).abs();
                assert!(error < 1e-4 * (1.0 + expected.abs()), "{i} {j}: {} {expected}", state.p[i][j]);
            }
        }
    }
}

#[test]
fn on_a_straight_run_the_range_stays_as_uncertain_as_it_is() {
    // The Cartesian filter claims 3.5 m^2 here for a squared error of 25.6 m^2. The claim must cover the error.
    let (filter, mut rng) = (drawn().build().unwrap(), Rng::new(2, 9));
    let (mut squared, mut claimed) = (0.0, 0.0);
    for _ in 0..400 {
        let source = draw(&mut rng);
        let state = run::<2>(&filter, &mut rng, |_| source, north, 6.0, |_, _, _| ());
        let rho_error = state.mean()[1] - 1.0 / source.minus(state.place_ned_m).norm();
        squared += rho_error * rho_error / 400.0;
        claimed += state.p[1][1] / 400.0;
    }
    assert!(claimed > 0.7 * squared && claimed < 1.4 * squared, "claims {claimed}, errs {squared}");
}

#[test]
fn a_weave_finds_the_range_and_the_filter_is_consistent() {
    let (filter, mut rng) = (drawn().build().unwrap(), Rng::new(3, 9));
    let runs = 500;
    let (mut squared, mut nees_sum, mut nis_sum, mut count) = (0.0, 0.0, 0.0, 0.0);
    for _ in 0..runs {
        let source = draw(&mut rng);
        let state = run::<2>(
            &filter,
            &mut rng,
            |_| source,
            weave,
            6.0,
            |_, _, heard| {
                if let Update::Fused { nis, .. } = heard {
                    nis_sum += nis;
                    count += 1.0;
                }
            },
        );
        let range_m = source.minus(state.place_ned_m).norm();
        let error = state.estimate().unwrap().range_m - range_m;
        squared += (error / range_m) * (error / range_m) / runs as f32;
        nees_sum += nees(&state, source) / runs as f32;
    }
    // Chi-square of 500 x 2 degrees of freedom: 95 % within 1.83..2.18; of 29 500 x 1: within 0.984..1.016.
    assert!((1.83..2.18).contains(&nees_sum), "NEES {nees_sum}");
    assert!((0.984..1.016).contains(&(nis_sum / count)), "NIS {}", nis_sum / count);
    assert!(libm::sqrtf(squared) < 0.2, "{}", libm::sqrtf(squared));
}

#[test]
fn a_source_of_constant_velocity_is_followed_by_four_states() {
    let filter = Config { outlier_rate: 0.0, speed_sigma_mps: 0.7, acceleration_m2_per_s3: 1e-4, ..Config::DEFAULT };
    let (filter, mut rng) = (filter.build().unwrap(), Rng::new(4, 9));
    let circle = |time_s: f32| {
        let (s, c) = sin_cos(0.5 * time_s);
        Horizontal { north: 2.0 * s, east: 2.0 - 2.0 * c }
    };
    let source = |time_s: f32| Horizontal { north: 8.0, east: 0.3 * time_s };
    let mut errors = Vec::new();
    for _ in 0..50 {
        let state = run::<4>(&filter, &mut rng, source, circle, 30.0, |_, _, _| ());
        let estimate = state.estimate().unwrap();
        errors.push(estimate.velocity_ned_mps.minus(Horizontal { north: 0.0, east: 0.3 }).norm());
        assert!(estimate.place_ned_m.minus(source(29.9)).norm() < 1.5, "{estimate:?}");
    }
    errors.sort_by(f32::total_cmp);
    assert!(errors[25] < 0.06, "median velocity error {}", errors[25]);
}

#[test]
fn outliers_neither_move_nor_convince_it() {
    let config = Config { outlier_rate: 0.3, ..Config::DEFAULT };
    let (filter, mut rng) = (config.build().unwrap(), Rng::new(5, 9));
    let source = Horizontal { north: 6.0, east: 6.0 };
    let mut worst = 0.0_f32;
    for _ in 0..50 {
        let mut state = Resting::new();
        for k in 0..120 {
            let from = weave(k as f32 * 0.05);
            let truth = source.minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian();
            let heard = if k > 0 && rng.uniform() < 0.3 { core::f32::consts::TAU * rng.uniform() } else { truth };
            filter.step(&mut state, &sighting(from, heard));
        }
        let error = wrap_pi(state.mean()[0] - source.minus(state.place_ned_m).bearing_rad());
        worst = worst.max(error.abs());
    }
    assert!(worst < 0.1, "{worst}");
}

#[test]
fn bearings_that_wrap_are_one_bearing() {
    let (filter, mut rng) = (filter(), Rng::new(6, 9));
    let state = run::<2>(
        &filter,
        &mut rng,
        |_| north(-12.0),
        |t| Horizontal { north: 0.0, east: t - 3.0 },
        6.0,
        |t, _, heard| {
            if let Update::Fused { nis, .. } = heard {
                assert!(nis < 25.0, "{t}: {nis}");
            }
        },
    );
    assert!((state.estimate().unwrap().range_m - 12.3).abs() < 2.0, "{:?}", state.estimate());
}

#[test]
fn the_mirror_image_of_a_filter_is_that_of_what_it_would_have_heard_there() {
    let filter = filter();
    let line = crate::mapping::walls::Wall::between(
        Horizontal { north: 9.0, east: -4.0 },
        Horizontal { north: 7.0, east: 5.0 },
    );
    let line = line.unwrap();
    let (mut here, mut there, mut rng) = (Moving::new(), Moving::new(), Rng::new(8, 9));
    for k in 0..80 {
        let from = weave(0.1 * k as f32);
        let source = Horizontal { north: 12.0, east: 1.0 + 0.02 * k as f32 };
        let heard = sighting(from, source.minus(from).bearing_rad() + SIGMA_RAD * rng.gaussian());
        filter.step(&mut here, &heard);
        let mirrored = Sighting {
            place_ned_m: line.mirror(heard.place_ned_m),
            direction_ned: line.mirror_direction(heard.direction_ned),
            ..heard
        };
        filter.step(&mut there, &mirrored);
    }
    let image = here.mirrored(&line);
    for i in 0..4 {
        assert!((image.mean()[i] - there.mean()[i]).abs() < 1e-3, "{i}: {image:?} {there:?}");
        for j in i..4 {
            let scale = libm::sqrtf(there.p[i][i] * there.p[j][j]);
            assert!((image.p[i][j] - there.p[i][j]).abs() < 1e-2 * scale, "{i} {j}: {image:?} {there:?}");
        }
    }
}

#[test]
fn a_config_that_cannot_be_names_its_field() {
    let field = |config: Config| config.build().unwrap_err().field;
    assert_eq!(field(Config { range_max_m: 0.1, ..Config::DEFAULT }), "source.range_max_m");
    assert_eq!(field(Config { outlier_rate: 1.0, ..Config::DEFAULT }), "source.outlier_rate");
    assert_eq!(field(Config { inverse_range_per_m: f32::NAN, ..Config::DEFAULT }), "source.inverse_range_per_m");
}
