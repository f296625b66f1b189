use super::*;
use crate::base::ned::Ned;
use crate::base::rng::Rng;
use core::f32::consts::TAU;
use std::vec::Vec;

/// A vehicle on the spot, its antenna, and the received signal.
struct Scene {
    config: Config,
    source_rad: f32,
    /// Reflections: direction, and level under the direct wave.
    reflections: Vec<(f32, f32)>,
    noise_db: f32,
    yaw_rate_radps: f32,
    period_s: f32,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            config: Config::default(),
            source_rad: 0.7,
            reflections: Vec::new(),
            noise_db: 2.0,
            yaw_rate_radps: 1.0,
            period_s: 0.02,
        }
    }
}

impl Scene {
    fn power_db(&self, antenna_rad: f32, rng: &mut Rng) -> f32 {
        let gain = |from: f32| libm::powf(10.0, 0.1 * self.config.pattern.gain_db(wrap_pi(antenna_rad - from)));
        let reflected: f32 = self.reflections.iter().map(|(from, db)| gain(*from) * libm::powf(10.0, -0.1 * db)).sum();
        -60.0 + 10.0 * libm::log10f(gain(self.source_rad) + reflected) + self.noise_db * rng.gaussian()
    }

    /// The outcomes, each with the state that it leaves.
    fn watch(&self, seconds: f32, seed: u64) -> Vec<(Outcome, State)> {
        let seeker = self.config.build().unwrap();
        let (mut state, mut rng) = (State::new(), Rng::new(seed, 1));
        let steps = (seconds / self.period_s) as u64;
        (0..steps)
            .filter_map(|k| {
                let time_s = k as f32 * self.period_s;
                let yaw_rad = wrap_pi(2.0 + self.yaw_rate_radps * time_s);
                let power_db = self.power_db(yaw_rad, &mut rng);
                let outcome = seeker.step(&mut state, Instant((time_s * 1e6) as u64), yaw_rad, power_db)?;
                Some((outcome, state.clone()))
            })
            .collect()
    }

    fn outcomes(&self, seconds: f32, seed: u64) -> Vec<Outcome> {
        self.watch(seconds, seed).into_iter().map(|(outcome, _)| outcome).collect()
    }

    fn rotations(&self, seconds: f32, seed: u64) -> Vec<Rotation> {
        let heard = |outcome| if let Outcome::Rotation(rotation) = outcome { Some(rotation) } else { None };
        self.outcomes(seconds, seed).into_iter().filter_map(heard).collect()
    }

    fn rms(&self, rotations: &[Rotation], error: impl Fn(&Rotation) -> f32) -> f32 {
        sqrt(rotations.iter().map(|rotation| error(rotation) * error(rotation)).sum::<f32>() / rotations.len() as f32)
    }
}

#[test]
fn the_source_is_found_each_rotation_whichever_way_the_vehicle_turns() {
    for yaw_rate_radps in [1.0, -1.0, 2.5] {
        let scene = Scene { yaw_rate_radps, ..Scene::default() };
        let rotations = scene.rotations(64.0, 3);
        assert!(rotations.len() >= (64.0 * yaw_rate_radps.abs() / TAU) as usize - 1, "{}", rotations.len());
        for rotation in &rotations {
            let off = wrap_pi(rotation.bearing_ned_rad - 0.7);
            assert!(off.abs() < 4.0 * rotation.sigma_rad && off.abs() < 0.2, "{rotation:?}");
            assert!(!rotation.ambiguous && (rotation.contrast_db - 15.0).abs() < 4.0, "{rotation:?}");
        }
    }
}

#[test]
fn between_the_bins_the_fit_is_much_better_than_the_loudest_bin_and_its_sigma_is_honest() {
    for noise_db in [2.0, 4.0, 6.0] {
        // Without memory rotations are independent.
        let config = Config { memory: 0.0, sigma_min_rad: 1e-3, ..Config::default() };
        let mut all = Vec::new();
        for seed in 0..60 {
            let source_rad = 0.1 * seed as f32 - 3.0;
            let scene = Scene { config, noise_db, source_rad, ..Scene::default() };
            for (outcome, state) in scene.watch(40.0, seed) {
                let Outcome::Rotation(rotation) = outcome else { continue };
                let off = |bearing_rad: f32| wrap_pi(bearing_rad - source_rad);
                let fit = off(rotation.bearing_ned_rad);
                // The paper's greedy rule.
                let loudest =
                    state.bins().iter().enumerate().max_by(|(_, a), (_, b)| a.partial_cmp(b).unwrap()).unwrap();
                all.push([fit, off(bins::middle_rad(loudest.0)), fit / rotation.sigma_rad]);
            }
        }
        let rms = |index: usize| sqrt(all.iter().map(|row| row[index] * row[index]).sum::<f32>() / all.len() as f32);
        let [fit, loudest, normal] = [rms(0), rms(1), rms(2)];
        assert!(all.len() > 200 && fit < 0.4 * loudest, "{noise_db} dB: {fit} against {loudest} in {}", all.len());
        assert!((0.85..1.2).contains(&normal), "{noise_db} dB: errors of {normal} sigma");
    }
}

#[test]
fn memory_averages_and_says_how_much_it_repeats() {
    let quick = Scene { config: Config { memory: 0.0, ..Config::default() }, noise_db: 6.0, ..Scene::default() };
    let slow = Scene { config: Config { memory: 0.9, ..Config::default() }, noise_db: 6.0, ..Scene::default() };
    let (rotations, averaged) = (quick.rotations(600.0, 5), slow.rotations(600.0, 5));
    let off = |rotation: &Rotation| wrap_pi(rotation.bearing_ned_rad - 0.7);
    assert!(quick.rms(&rotations, off) > 1.5 * slow.rms(&averaged, off));
    // Six or seven readings a bin and rotation.
    assert!(averaged.iter().all(|rotation| (rotation.retained - 0.51).abs() < 0.05), "{:?}", averaged.last());
    assert!(rotations.iter().all(|rotation| rotation.retained == 0.0));
    let last = averaged.last().unwrap();
    assert!(last.independent_sigma_rad() > 1.5 * last.sigma_rad);
}

#[test]
fn a_reflection_pulls_the_fit_and_widens_its_sigma() {
    let mut worst = 0.0_f32;
    for level_db in [10.0, 6.0, 3.0] {
        for aside in [0.8_f32, 1.6, 2.4, 3.1] {
            let reflections = std::vec![(0.7 + aside, level_db)];
            let scene = Scene { reflections, noise_db: 1.0, ..Scene::default() };
            for rotation in scene.rotations(60.0, 7) {
                worst = worst.max(wrap_pi(rotation.bearing_ned_rad - 0.7).abs() / rotation.sigma_rad);
            }
        }
    }
    // A small pull is not detected: a reflection 45 degrees aside looks like a source between the two.
    assert!(worst < 8.0, "{worst}");
}

#[test]
fn noise_is_no_signal_and_two_equal_sources_are_ambiguous() {
    let mut heard = 0;
    let deaf = Scene::default();
    let seeker = deaf.config.build().unwrap();
    let (mut state, mut rng, mut outcomes) = (State::new(), Rng::new(9, 1), 0);
    for k in 0..400_000_u64 {
        let power_db = -95.0 + 3.0 * rng.gaussian();
        if let Some(outcome) = seeker.step(&mut state, Instant(k * 20_000), wrap_pi(0.02 * k as f32), power_db) {
            outcomes += 1;
            heard += usize::from(!matches!(outcome, Outcome::NoSignal));
        }
    }
    assert!(outcomes > 1200 && heard <= 4, "{heard} of {outcomes}");

    let mut config = Config::default();
    config.pattern.exponent = 4.0;
    let scene = Scene { config, reflections: std::vec![(-2.2, 0.5)], noise_db: 1.0, ..Scene::default() };
    let rotations = scene.rotations(60.0, 3);
    assert!(rotations.len() > 6 && rotations.iter().all(|rotation| rotation.ambiguous), "{rotations:?}");
    assert!(rotations.iter().all(|rotation| !rotation.bearing(&Ownship::default(), 0.0).valid));
    for rotation in rotations {
        let hills = [0.7, -2.2].map(|hill| wrap_pi(rotation.bearing_ned_rad - hill).abs());
        assert!(hills[0].min(hills[1]) < 0.3, "{rotation:?}");
    }
}

#[test]
fn silence_behind_is_information_and_no_readings_at_all_are_none() {
    let scene = Scene { noise_db: 1.0, ..Scene::default() };
    let seeker = scene.config.build().unwrap();
    let (mut state, mut rng) = (State::new(), Rng::new(11, 1));
    let mut heard = Vec::new();
    for k in 0..3000_u64 {
        let yaw_rad = wrap_pi(0.02 * k as f32);
        let power_db = -45.0 + scene.power_db(yaw_rad, &mut rng);
        // The receiver detects nothing below -112 dB.
        let power_db = if power_db < -112.0 { f32::NEG_INFINITY } else { power_db };
        if let Some(Outcome::Rotation(rotation)) = seeker.step(&mut state, Instant(k * 20_000), yaw_rad, power_db) {
            heard.push(rotation);
        }
    }
    assert!(heard.len() >= 8 && heard.iter().all(|rotation| wrap_pi(rotation.bearing_ned_rad - 0.7).abs() < 0.15));

    let mut state = State::new();
    let around = (0..400_u64).find_map(|k| seeker.step(&mut state, Instant(k * 20_000), 0.02 * k as f32, f32::NAN));
    assert_eq!(around, Some(Outcome::Sparse));
    let coarse = Scene { yaw_rate_radps: 50.0, ..Scene::default() };
    assert!(coarse.outcomes(0.2, 1).iter().all(|outcome| !matches!(outcome, Outcome::NoSignal)));
}

#[test]
fn bins_without_a_reading_are_bridged() {
    // 30 readings a rotation for 48 bins.
    let scene = Scene { yaw_rate_radps: TAU / 0.61, noise_db: 1.0, ..Scene::default() };
    let rotations = scene.rotations(20.0, 2);
    assert!(rotations.len() > 25, "{}", rotations.len());
    let off = |rotation: &Rotation| wrap_pi(rotation.bearing_ned_rad - 0.7);
    assert!(scene.rms(&rotations, off) < 0.1);
    let mut bins = Bins::new();
    for bin in [3, 7, 40] {
        bins.add(bins::middle_rad(bin), -(bin as f32), 0.5);
    }
    let (averages, filled, gap) = bridged(&bins);
    assert_eq!((filled, gap), (3, 32));
    for (bin, expected) in [(3, -3.0), (5, -5.0), (7, -7.0), (23, -23.0), (40, -40.0), (45, -23.181_818)] {
        assert!((averages[bin] - expected).abs() < 1e-4, "{bin}: {}", averages[bin]);
    }
}

#[test]
fn a_vehicle_that_does_not_turn_is_told_so() {
    let scene = Scene { yaw_rate_radps: 0.2, ..Scene::default() };
    let outcomes = scene.outcomes(50.0, 1);
    assert!(outcomes.len() == 2 && outcomes.iter().all(|outcome| *outcome == Outcome::NotTurning), "{outcomes:?}");
}

#[test]
fn a_bearing_goes_back_to_the_direction_that_it_came_from() {
    let scene = Scene::default();
    let rotation = scene.rotations(20.0, 1)[0];
    let ownship = Ownship {
        attitude_time: Instant(123_456),
        yaw_rad: 2.9,
        yaw_rate_radps: 1.0,
        roll_rad: 0.1,
        pitch_rad: -0.15,
        position_ned_m: Ned::default(),
        ..Ownship::default()
    };
    let bearing = rotation.bearing(&ownship, 0.3);
    assert!(bearing.valid && bearing.sigma_rad >= rotation.sigma_rad);
    let back = ownship.bearing_ned_rad(bearing.azimuth_rad, 0.3, bearing.time);
    assert!(wrap_pi(back - rotation.bearing_ned_rad).abs() < 1e-3, "{back} {rotation:?}");
    assert_eq!(bearing.quality.wavenumber, 0.0);
}

#[test]
fn what_is_out_of_range_is_refused_by_name() {
    let refused = |change: &dyn Fn(&mut Config)| {
        let mut config = Config::default();
        change(&mut config);
        config.build().unwrap_err().field
    };
    assert_eq!(refused(&|config| config.memory = 1.0), "rotating.memory");
    assert_eq!(refused(&|config| config.pattern.exponent = 0.0), "rotating.pattern.exponent");
}

#[test]
fn the_state_is_small() {
    assert!(core::mem::size_of::<State>() <= 312);
}
