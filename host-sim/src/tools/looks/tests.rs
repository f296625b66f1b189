//! What the answers are worth, on scenes of two paths: spherical waves from the source and from its image behind a wall.

use super::*;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::{array, bearing};
use foxhound_core::signal::phase::Complex;

const WAVELENGTH_M: f64 = 0.345;

#[derive(Clone, Copy)]
struct Scenes {
    reflection_db: f64,
    looks: usize,
    turn_deg: f64,
    height_deg: f64,
    snr_db: f64,
    /// The image is this far beside the source, in degrees, instead of behind a wall.
    apart_deg: Option<[f64; 2]>,
    /// Stretches all distances: 1000 leaves plane waves.
    scale: f64,
}

const SCENES: Scenes =
    Scenes { reflection_db: -6.0, looks: 8, turn_deg: 0.0, height_deg: 0.0, snr_db: 44.0, apart_deg: None, scale: 1.0 };

fn from(here: [f64; 2], to: [f64; 2]) -> f64 {
    libm::atan2(to[1] - here[1], to[0] - here[0])
}

fn polar(range: f64, azimuth: f64) -> [f64; 2] {
    [range * azimuth.cos(), range * azimuth.sin()]
}

fn array() -> Array {
    array::Config::default().build().unwrap()
}

fn look(z: [Complex; CHANNELS], noise: f32, array: Array, yaw_rad: f64) -> Look {
    let phasors = Phasors {
        time: Instant(0),
        z,
        noise: [noise; CHANNELS],
        snr_db: 20.0,
        frequency_hz: 20_000.0,
        tone: Tone::Present,
        clipped: false,
        interferer: false,
    };
    let bearing = bearing::Config::default().build(array).unwrap().estimate(&phasors);
    Look { phasors, bearing, yaw_rad }
}

impl Scenes {
    /// The looks, the true bearing from north at the last of them, and that from their middle.
    fn draw(&self, rng: &mut Rng) -> (Vec<Look>, f64, f64) {
        let mut uniform = |low: f64, high: f64| low + (high - low) * f64::from(rng.uniform());
        let (range, azimuth) = (self.scale * uniform(5.0, 30.0), uniform(0.0, TAU));
        let source = polar(range, azimuth);
        // A wall 1 to 15 m off, with both of us on one side of it.
        let (normal, behind) = loop {
            let (normal, distance) = (polar(1.0, uniform(0.0, TAU)), self.scale * uniform(1.0, 15.0));
            let behind = distance - normal[0] * source[0] - normal[1] * source[1];
            if behind > 0.5 {
                break (normal, behind);
            }
        };
        let image = match self.apart_deg {
            None => [0, 1].map(|axis| source[axis] + 2.0 * behind * normal[axis]),
            Some([low, high]) => {
                let beside = azimuth + uniform(low, high).to_radians();
                polar(range * uniform(1.1, 3.0), beside)
            }
        };
        let (course, start_yaw) = (uniform(0.0, TAU), uniform(0.0, TAU));
        let channels = [0; CHANNELS].map(|_| CHANNEL_SIGMA_RAD * f64::from(rng.gaussian()));
        let sigma = (10_f64.powf(-self.snr_db / 10.0) / 2.0).sqrt();
        let wavenumber = TAU / WAVELENGTH_M * self.height_deg.to_radians().cos();
        let (half, mut here, mut looks, mut middle) = (0.2 * WAVELENGTH_M, [0.0; 2], vec![], [0.0; 2]);
        for k in 0..self.looks {
            if k > 0 {
                let step = WAVELENGTH_M * (0.25 + 0.15 * f64::from(rng.uniform()));
                let step = polar(step, course + 0.3 * f64::from(rng.gaussian()));
                here = [here[0] + step[0], here[1] + step[1]];
            }
            middle = [0, 1].map(|axis| middle[axis] + here[axis] / self.looks as f64);
            let yaw = start_yaw + self.turn_deg.to_radians() * k as f64 / (self.looks - 1) as f64;
            let common = TAU * f64::from(rng.uniform());
            let corners = [[half, half], [half, -half], [-half, -half], [-half, half]];
            let z = std::array::from_fn(|m| {
                let [forward, right] = corners[m];
                let antenna = [
                    here[0] + forward * yaw.cos() - right * yaw.sin(),
                    here[1] + forward * yaw.sin() + right * yaw.cos(),
                ];
                let noise = Complex64::new(f64::from(rng.gaussian()), f64::from(rng.gaussian())) * sigma;
                let waves = [(source, 1.0), (image, 10_f64.powf(self.reflection_db / 20.0))].map(|(at, amplitude)| {
                    let way = (at[0] - antenna[0]).hypot(at[1] - antenna[1]) - range;
                    Complex64::from_polar(amplitude, common + channels[m] - wavenumber * way)
                });
                let z = 1000.0 * (waves[0] + waves[1] + noise);
                Complex { re: z.re as f32, im: z.im as f32 }
            });
            looks.push(look(z, (2e6 * sigma * sigma) as f32, array(), yaw));
        }
        (looks, from(here, source), from(middle, source))
    }

    /// What becomes of many scenes.
    fn run(&self, count: usize) -> Run {
        let (mut rng, mut run) = (Rng::new(11, 5), Run::default());
        for _ in 0..count {
            let (looks, truth, from_middle) = self.draw(&mut rng);
            let (mut north, mut east) = (0.0, 0.0);
            for Look { bearing, yaw_rad, .. } in &looks {
                let (sine, cosine) = (f64::from(bearing.azimuth_rad) + yaw_rad).sin_cos();
                (north, east) = (north + cosine, east + sine);
            }
            let bearing = resolve(&array(), &looks).unwrap();
            let off_deg = |a: f64, b: f64| wrap_pi(a - b).abs().to_degrees();
            let error = off_deg(f64::from(bearing.azimuth_rad) + looks[looks.len() - 1].yaw_rad, truth);
            run.errors.push(error);
            run.of_the_mean.push(off_deg(east.atan2(north), from_middle));
            run.nees.push((error / f64::from(bearing.sigma_rad).to_degrees()).powi(2));
            run.useless += usize::from(!bearing.valid);
            run.alone += usize::from(!bearing.flags.contains(Flags::MULTIPATH));
        }
        for list in [&mut run.errors, &mut run.of_the_mean, &mut run.nees] {
            list.sort_by(f64::total_cmp);
        }
        run
    }
}

/// Errors in degrees and normalised squared errors, sorted, and counts of answers.
#[derive(Default)]
struct Run {
    errors: Vec<f64>,
    of_the_mean: Vec<f64>,
    nees: Vec<f64>,
    /// Of one path.
    alone: usize,
    /// Not valid.
    useless: usize,
}

impl Run {
    /// By the mean of the normalised squared errors without the largest twentieth.
    fn assert_sigma_is_honest(&self) {
        let count = self.nees.len() * 19 / 20;
        let nees = self.nees[..count].iter().sum::<f64>() / count as f64;
        assert!((0.3..3.0).contains(&nees), "{nees}");
    }
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn a_reflection_at_minus_6_db_leaves_half_a_degree_where_averaging_leaves_two() {
    let run = SCENES.run(250);
    assert!(quantile(&run.errors, 0.5) <= 0.5, "{}", quantile(&run.errors, 0.5));
    assert!(quantile(&run.errors, 0.9) <= 1.8, "{}", quantile(&run.errors, 0.9));
    assert!(quantile(&run.of_the_mean, 0.5) > 3.0 * quantile(&run.errors, 0.5));
    assert!(quantile(&run.of_the_mean, 0.9) > 2.0 * quantile(&run.errors, 0.9));
    run.assert_sigma_is_honest();
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
        run.assert_sigma_is_honest();
    }
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
fn a_source_above_is_one_path() {
    let above = Scenes { reflection_db: -200.0, height_deg: 30.0, ..SCENES }.run(250);
    assert!(above.alone >= 245, "{}", above.alone);
    assert!(rms(&above.errors) < 0.8, "{}", rms(&above.errors));
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
fn any_array_will_do_but_not_a_dead_channel_nor_fewer_than_four_looks() {
    let mut odd = array::Config::default();
    odd.antennas_m[0][0] += 0.02;
    for (array, dead) in [(odd.build().unwrap(), false), (array(), true)] {
        let mut z = array.steering.map(|[forward, right]| Complex::at(forward * 0.7_f32.cos() + right * 0.7_f32.sin()));
        if dead {
            z[2] = Complex { re: 1e-3, im: 0.0 };
        }
        let looks = [look(z, 1e-6, array, 0.1); 5];
        let resolved = resolve(&array, &looks);
        assert_eq!(resolved.is_none(), dead);
        if let Some(bearing) = resolved {
            assert!(bearing.valid && (bearing.azimuth_rad - 0.7).abs() < 1e-3, "{bearing:?}");
            assert_eq!(bearing.flags, Flags::default());
        }
        let mut silent = looks;
        silent[1].phasors.tone = Tone::Absent;
        silent[3].phasors.z[0].re = f32::NAN;
        assert_eq!(resolve(&array, &silent), None);
    }
}

#[test]
fn the_normal_equations_are_the_slope_of_what_is_left_over() {
    let (looks, ..) = Scenes { turn_deg: 60.0, ..SCENES }.draw(&mut Rng::new(2, 9));
    let kept: Vec<Kept> = looks.iter().map(|look| Kept::of(&array(), look).unwrap()).collect();
    let solver = Solver { steering: array().steering.map(|p| p.map(f64::from)), looks: &kept };
    for x in [[0.3, 2.0, 0.01, -0.02], [-1.0, 0.4, 0.0, 0.0], [2.5, 0.9, -0.01, 0.0]] {
        for is_two in [true, false] {
            let paths = Paths { is_two, x };
            let sums = solver.sums(&paths);
            for i in 0..4 {
                let left = |step: f64| {
                    let mut there = paths;
                    there.x[i] += step;
                    solver.sums(&there).left
                };
                let slope = (left(-1e-5) - left(1e-5)) / 4e-5;
                assert!((slope - sums.b[i]).abs() < 1e-5 * sums.left, "{paths:?} {i}: {slope} {}", sums.b[i]);
            }
        }
    }
}

#[test]
fn the_inverse_undoes_the_matrix() {
    let mut rng = Rng::new(8, 1);
    for _ in 0..500 {
        let v = [0; 4].map(|_| [0; 4].map(|_| f64::from(rng.gaussian())));
        let product = |a: &Matrix, b: &Matrix| -> Matrix {
            std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
        };
        let turned: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| v[j][i]));
        let mut matrix = product(&v, &turned);
        (0..4).for_each(|i| matrix[i][i] += 1e-3);
        for (i, row) in product(&matrix, &inverted(&matrix)).iter().enumerate() {
            for (j, x) in row.iter().enumerate() {
                assert!((x - f64::from(i == j)).abs() < 1e-8, "{row:?}");
            }
        }
    }
}
