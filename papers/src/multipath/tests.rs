//! What the answers are worth, on scenes, and what is refused.

use super::scenes::{SCENES, Scenes, array, estimator, offer, phasors, quantile, rms};
use super::*;
use foxhound_core::doa::{array, bearing};
use foxhound_core::signal::phase::Tone;

#[test]
fn a_reflection_at_minus_6_db_leaves_half_a_degree_where_averaging_leaves_two() {
    for known_positions in [false, true] {
        let run = Scenes { known_positions, ..SCENES }.run(250);
        assert!(quantile(&run.errors, 0.5) <= 0.5, "{}", quantile(&run.errors, 0.5));
        assert!(quantile(&run.errors, 0.9) <= 1.8, "{}", quantile(&run.errors, 0.9));
        assert!(quantile(&run.of_the_mean, 0.5) > 3.0 * quantile(&run.errors, 0.5));
        assert!(quantile(&run.of_the_mean, 0.9) > 2.0 * quantile(&run.errors, 0.9));
        assert!(run.methods.iter().filter(|method| **method == Method::Music).count() > 200);
        run.assert_sigma_is_honest();
    }
}

#[test]
fn plane_waves_few_looks_strong_and_weak_reflections_and_turns_between_the_looks_are_resolved_too() {
    for (scenes, p90) in [
        (Scenes { scale: 1000.0, ..SCENES }, 2.2),
        (Scenes { looks: 4, ..SCENES }, 2.2),
        (Scenes { reflection_db: -3.0, ..SCENES }, 2.2),
        (Scenes { reflection_db: -20.0, ..SCENES }, 2.2),
        (Scenes { turn_deg: 20.0, ..SCENES }, 2.0),
        (Scenes { turn_deg: 90.0, ..SCENES }, 2.0),
    ] {
        let run = scenes.run(250);
        assert!(quantile(&run.errors, 0.5) <= 0.6, "{}", quantile(&run.errors, 0.5));
        assert!(quantile(&run.errors, 0.9) <= p90, "{}", quantile(&run.errors, 0.9));
        let turned = |method: &Method| matches!(method, Method::Projection | Method::OnePath);
        assert!(scenes.turn_deg == 0.0 || run.methods.iter().all(turned));
        run.assert_sigma_is_honest();
    }
}

#[test]
fn without_a_reflection_it_is_no_worse_than_averaging() {
    for (turn_deg, bound) in [(0.0, 1.2), (90.0, 1.5)] {
        let run = Scenes { reflection_db: -200.0, turn_deg, ..SCENES }.run(500);
        assert!(rms(&run.errors) <= bound * rms(&run.of_the_mean), "{}", rms(&run.errors) / rms(&run.of_the_mean));
        assert!(run.alone >= 490, "{}", run.alone);
        run.assert_sigma_is_honest();
    }
}

#[test]
fn a_source_above_is_one_path_and_known_height_resolves_two() {
    let above = Scenes { reflection_db: -200.0, height_deg: 30.0, ..SCENES }.run(250);
    assert!(above.alone >= 245, "{}", above.alone);
    assert!(rms(&above.errors) < 0.8, "{}", rms(&above.errors));
    let reflected = Scenes { height_deg: 30.0, ..SCENES }.run(250);
    assert!(quantile(&reflected.errors, 0.5) <= 0.7 && quantile(&reflected.errors, 0.9) <= 2.5);
}

#[test]
fn noise_alone_may_limit_it_and_sigma_says_so() {
    for snr_db in [14.0, 24.0] {
        let run = Scenes { snr_db, ..SCENES }.run(250);
        assert!(quantile(&run.errors, 0.5) < quantile(&run.of_the_mean, 0.5));
        run.assert_sigma_is_honest();
    }
}

#[test]
fn the_reflection_is_reported_where_it_comes_from_and_as_strong_as_it_is() {
    let run = SCENES.run(250);
    assert!(run.of_the_image.len() > 100);
    assert!(quantile(&run.of_the_image, 0.5) < 1.5, "{}", quantile(&run.of_the_image, 0.5));
    assert!((quantile(&run.power_db, 0.5) + 6.0).abs() < 0.3, "{}", quantile(&run.power_db, 0.5));
    assert!((quantile(&run.power_db, 0.1) + 6.0).abs() < 1.0 && (quantile(&run.power_db, 0.9) + 6.0).abs() < 1.0);
}

#[test]
fn an_array_without_opposite_pairs_or_with_a_dead_channel_gets_the_mean() {
    let mut odd = array::Config::default();
    odd.antennas_m[0][0] += 0.02;
    let arrays = [(odd.build().unwrap(), false), (array(), true)];
    for (array, dead) in arrays {
        let stage = Config::default().build(&array).unwrap();
        let estimator = bearing::Config::default().build(array).unwrap();
        let mut state = State::default();
        for k in 0..8 {
            let (s, c) = sin_cos(0.7);
            let mut z = array.steering.map(|p| {
                let (im, re) = sin_cos(p[0] * c + p[1] * s);
                Complex { re, im }
            });
            if dead {
                z[2] = Complex { re: 1e-3, im: 0.0 };
            }
            let phasors = phasors(z, 1e-6, k);
            let bearing = estimator.estimate(&phasors);
            let look = Frame { phasors: &phasors, bearing: &bearing, yaw_rad: 0.1, position_ned_m: None };
            assert_eq!(stage.take(&mut state, &look), Taken::Yes);
        }
        let arrival = stage.solve(&state, 1.0).unwrap();
        assert_eq!(arrival.method, Method::Mean);
        assert_eq!(arrival.bearing.flags.contains(Flags::dead(2)), dead);
        assert!(arrival.bearing.valid);
        assert!((arrival.bearing.azimuth_rad - 0.7).abs() < 0.01, "{arrival:?}");
        assert!((arrival.azimuth_ned_rad - 0.8).abs() < 0.01, "{arrival:?}");
    }
    // A rhombus is no square but has its pairs.
    let rhombus = array::Config { antennas_m: [[0.1, 0.0], [0.0, -0.06], [-0.1, 0.0], [0.0, 0.06]], ..odd };
    assert!(Config::default().build(&rhombus.build().unwrap()).unwrap().pairs.is_some());
}

#[test]
fn a_look_is_taken_after_a_quarter_of_a_wavelength() {
    let stage = Config::default().build(&array()).unwrap();
    let mut state = State::default();
    let at = |north: f32| Some(Ned { north, ..Ned::default() });
    assert_eq!(offer(&stage, &mut state, 0, at(0.0)), Taken::Yes);
    assert_eq!(offer(&stage, &mut state, 1, at(0.080)), Taken::NotMoved);
    assert_eq!(offer(&stage, &mut state, 2, at(0.087)), Taken::Yes);
    assert_eq!(offer(&stage, &mut state, 3, at(0.080)), Taken::NotMoved);
    assert_eq!(offer(&stage, &mut state, 4, None), Taken::Yes);
    assert_eq!(state.count(), 3);
    let all = Config { move_min_wavelengths: 0.0, ..Config::default() }.build(&array()).unwrap();
    assert_eq!(offer(&all, &mut state, 5, at(0.0)), Taken::Yes);
    assert_eq!(offer(&all, &mut state, 6, at(0.0)), Taken::Yes);
}

#[test]
fn an_answer_needs_enough_looks_and_old_ones_go() {
    let stage = Config { looks_max: 6, ..Config::default() }.build(&array()).unwrap();
    let mut state = State::default();
    for k in 0..10_u64 {
        assert_eq!(stage.solve(&state, 1.0).is_some(), k >= 4, "{k}");
        assert_eq!(offer(&stage, &mut state, k * 1000, None), Taken::Yes);
        assert_eq!(state.count() as u64, (k + 1).min(6));
    }
    let arrival = stage.solve(&state, 1.0).unwrap();
    assert_eq!((arrival.looks, arrival.method, arrival.bearing.time), (6, Method::OnePath, Instant(9000)));
    assert!(arrival.bearing.azimuth_rad.abs() < 1e-3 && (arrival.azimuth_ned_rad - 0.5).abs() < 1e-3);
    assert!(arrival.bearing.valid && arrival.bearing.flags == Flags::default());
    // Five seconds later only the new one is left; a clock that runs backwards empties the ring too.
    assert_eq!(offer(&stage, &mut state, 6_000_000, None), Taken::Yes);
    assert_eq!(state.count(), 1);
    assert_eq!(offer(&stage, &mut state, 5_900_000, None), Taken::Yes);
    assert_eq!(state.count(), 1);
}

#[test]
fn what_holds_no_tone_or_no_numbers_is_not_a_look() {
    let stage = Config::default().build(&array()).unwrap();
    let mut state = State::default();
    let silent = Phasors { tone: Tone::Absent, ..phasors([Complex { re: 1.0, im: 0.0 }; 4], 1e-6, 0) };
    let bearing = estimator().estimate(&silent);
    let look = Frame { phasors: &silent, bearing: &bearing, yaw_rad: 0.0, position_ned_m: None };
    assert_eq!(stage.take(&mut state, &look), Taken::NoTone);
    let odd = phasors([Complex { re: f32::NAN, im: 0.0 }; 4], 1e-6, 0);
    assert_eq!(stage.take(&mut state, &Frame { phasors: &odd, ..look }), Taken::Unusable);
    assert_eq!(state.count(), 0);
}

#[test]
fn the_configuration_is_checked_by_name() {
    let refused = |config: Config| config.build(&array()).unwrap_err().field;
    let good = Config::default();
    assert_eq!(refused(Config { looks_min: 1, ..good }), "multipath.looks_min");
    assert_eq!(refused(Config { looks_max: 9, ..good }), "multipath.looks_max");
    assert_eq!(refused(Config { looks_min: 6, looks_max: 5, ..good }), "multipath.looks_max");
    assert_eq!(refused(Config { move_min_wavelengths: f32::NAN, ..good }), "multipath.move_min_wavelengths");
    assert_eq!(refused(Config { age_max_s: 0.0, ..good }), "multipath.age_max_s");
    assert_eq!(refused(Config { channel_sigma_rad: 1.0, ..good }), "multipath.channel_sigma_rad");
}

#[test]
fn every_scene_is_resolved_however_many_looks_however_strong_the_reflection_and_however_far_we_turn() {
    for looks in [4, 6, 8] {
        for reflection_db in [-3.0, -6.0, -10.0] {
            for turn_deg in [0.0, 90.0, 270.0] {
                let run = Scenes { looks, reflection_db, turn_deg, ..SCENES }.run(500);
                let [median, p90, p99] = [0.5, 0.9, 0.99].map(|share| quantile(&run.errors, share));
                let scene = (looks, reflection_db, turn_deg);
                assert!(median <= 0.6 && p90 <= 2.0 && p99 <= 10.0, "{scene:?}: {median} {p90} {p99}");
                assert_eq!(run.useless, 0, "{scene:?}");
            }
        }
    }
}

#[test]
fn paths_from_almost_the_same_side_leave_an_answer_on_that_side() {
    for turn_deg in [0.0, 90.0] {
        for apart_deg in [[3.0, 10.0], [10.0, 20.0]] {
            let run = Scenes { turn_deg, apart_deg: Some(apart_deg), ..SCENES }.run(1000);
            let [median, p90, p99] = [0.5, 0.9, 0.99].map(|share| quantile(&run.errors, share));
            let scene = (turn_deg, apart_deg);
            assert!(median <= 2.5 && p90 <= 6.0 && p99 <= 15.0, "{scene:?}: {median} {p90} {p99}");
            assert_eq!(run.useless, 0, "{scene:?}");
        }
    }
}
