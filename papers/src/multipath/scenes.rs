//! Scenes with two paths for the tests, made in f64, and what became of many of them.

use std::f64::consts::TAU;
use std::vec::Vec as List;

use super::model::{Headings, Solver, gather};
use super::{Config, Frame, Looks, Method, State, Taken};
use foxhound_core::base::ned::Ned;
use foxhound_core::base::rng::Rng;
use foxhound_core::base::time::Instant;
use foxhound_core::base::units::sin_cos;
use foxhound_core::doa::array::{self, Array};
use foxhound_core::doa::bearing;
use foxhound_core::signal::phase::{Complex, Phasors, Tone};

pub(super) const WAVELENGTH: f64 = 0.345;

/// Two-path scenes, made in f64: spherical waves from the source and from its image behind a wall.
#[derive(Clone, Copy)]
pub(super) struct Scenes {
    pub(super) reflection_db: f64,
    pub(super) looks: usize,
    pub(super) turn_deg: f64,
    pub(super) height_deg: f64,
    pub(super) snr_db: f64,
    pub(super) known_positions: bool,
    /// The image is this far beside the source, in degrees, instead of behind a wall.
    pub(super) apart_deg: Option<[f64; 2]>,
    /// Stretches all distances: 1000 leaves plane waves.
    pub(super) scale: f64,
}

pub(super) const SCENES: Scenes = Scenes {
    reflection_db: -6.0,
    looks: 8,
    turn_deg: 0.0,
    height_deg: 0.0,
    snr_db: 44.0,
    known_positions: false,
    apart_deg: None,
    scale: 1.0,
};

pub(super) struct Scene {
    pub(super) looks: List<(Phasors, f64, [f64; 2])>,
    /// True bearings from north at the last look and from the middle of the looks, and of the image at the last.
    pub(super) direct: f64,
    pub(super) direct_from_middle: f64,
    pub(super) image: f64,
}

impl Scenes {
    pub(super) fn draw(&self, rng: &mut Rng) -> Scene {
        let mut uniform = |low: f64, high: f64| low + (high - low) * f64::from(rng.uniform());
        let range = self.scale * uniform(5.0, 30.0);
        let azimuth = uniform(0.0, TAU);
        let source = [range * azimuth.cos(), range * azimuth.sin()];
        // A wall 1 to 15 m off, with both of us on one side of it.
        let (normal, behind) = loop {
            let (angle, distance) = (uniform(0.0, TAU), self.scale * uniform(1.0, 15.0));
            let normal = [angle.cos(), angle.sin()];
            let behind = distance - normal[0] * source[0] - normal[1] * source[1];
            if behind > 0.5 {
                break (normal, behind);
            }
        };
        let image = match self.apart_deg {
            None => [source[0] + 2.0 * behind * normal[0], source[1] + 2.0 * behind * normal[1]],
            Some([low, high]) => {
                let (beside, farther) = (azimuth + uniform(low, high).to_radians(), range * uniform(1.1, 3.0));
                [farther * beside.cos(), farther * beside.sin()]
            }
        };
        let (course, start_yaw) = (uniform(0.0, TAU), uniform(0.0, TAU));
        let channels = [0; 4].map(|_| 1_f64.to_radians() * f64::from(rng.gaussian()));
        let sigma = (10_f64.powf(-self.snr_db / 10.0) / 2.0).sqrt();
        let amplitudes = [1.0, 10_f64.powf(self.reflection_db / 20.0)];
        let wavenumber = TAU / WAVELENGTH * self.height_deg.to_radians().cos();
        let half = 0.2 * WAVELENGTH;
        let mut position = [0.0, 0.0];
        let mut looks = List::new();
        for k in 0..self.looks {
            if k > 0 {
                let step = WAVELENGTH * (0.25 + 0.15 * f64::from(rng.uniform()));
                let course = course + 0.3 * f64::from(rng.gaussian());
                position = [position[0] + step * course.cos(), position[1] + step * course.sin()];
            }
            let yaw = start_yaw + self.turn_deg.to_radians() * k as f64 / (self.looks - 1) as f64;
            let common = TAU * f64::from(rng.uniform());
            let mut z = [Complex::default(); 4];
            for ((z, channel), [forward, right]) in
                z.iter_mut().zip(channels).zip([[half, half], [half, -half], [-half, -half], [-half, half]])
            {
                let antenna = [
                    position[0] + forward * yaw.cos() - right * yaw.sin(),
                    position[1] + forward * yaw.sin() + right * yaw.cos(),
                ];
                let (mut re, mut im) = (0.0, 0.0);
                for (from, amplitude) in [source, image].iter().zip(amplitudes) {
                    let way = ((from[0] - antenna[0]).powi(2) + (from[1] - antenna[1]).powi(2)).sqrt() - range;
                    let phase = common + channel - wavenumber * way;
                    re += amplitude * phase.cos();
                    im += amplitude * phase.sin();
                }
                re += sigma * f64::from(rng.gaussian());
                im += sigma * f64::from(rng.gaussian());
                *z = Complex { re: (1000.0 * re) as f32, im: (1000.0 * im) as f32 };
            }
            let noise = (2e6 * sigma * sigma) as f32;
            looks.push((phasors(z, noise, k as u64 * 100_000), yaw, position));
        }
        let count = looks.len() as f64;
        let middle = [0, 1].map(|axis| looks.iter().map(|look| look.2[axis]).sum::<f64>() / count);
        let from = |here: [f64; 2], to: [f64; 2]| (to[1] - here[1]).atan2(to[0] - here[0]);
        Scene {
            looks,
            direct: from(position, source),
            direct_from_middle: from(middle, source),
            image: from(position, image),
        }
    }

    /// Errors of many scenes, sorted, in degrees.
    pub(super) fn run(&self, count: usize) -> Run {
        let stage = Config { move_min_wavelengths: 0.2, ..Config::default() }.build(&array()).unwrap();
        let mut rng = Rng::new(11, 5);
        let mut run = Run::default();
        for _ in 0..count {
            let scene = self.draw(&mut rng);
            let mut state = State::default();
            let (mut north, mut east) = (0.0, 0.0);
            for (phasors, yaw, position) in &scene.looks {
                let bearing = estimator().estimate(phasors);
                let azimuth = f64::from(bearing.azimuth_rad) + yaw;
                north += azimuth.cos();
                east += azimuth.sin();
                let ned = Ned { north: position[0] as f32, east: position[1] as f32, down: 0.0 };
                let look = Frame {
                    phasors,
                    bearing: &bearing,
                    yaw_rad: *yaw as f32,
                    position_ned_m: self.known_positions.then_some(ned),
                };
                assert_eq!(stage.take(&mut state, &look), Taken::Yes);
            }
            let cosine = self.height_deg.to_radians().cos() as f32;
            let arrival = stage.solve(&state, cosine).unwrap();
            let error = degrees_apart(f64::from(arrival.azimuth_ned_rad), scene.direct);
            let last_yaw = scene.looks.last().unwrap().1;
            let body = degrees_apart(f64::from(arrival.bearing.azimuth_rad) + last_yaw, scene.direct);
            assert!((body - error).abs() < 1e-3, "{body} {error}");
            run.errors.push(error);
            run.of_the_mean.push(degrees_apart(east.atan2(north), scene.direct_from_middle));
            run.nees.push((error / f64::from(arrival.bearing.sigma_rad).to_degrees()).powi(2));
            run.useless += usize::from(!arrival.bearing.valid);
            run.alone += usize::from(arrival.reflection.is_none());
            if let Some(reflection) = arrival.reflection.filter(|_| degrees_apart(scene.direct, scene.image) > 30.0) {
                run.of_the_image.push(degrees_apart(f64::from(reflection.azimuth_ned_rad), scene.image));
                run.power_db.push(10.0 * f64::from(reflection.relative_power).log10());
            }
            run.methods.push(arrival.method);
        }
        for list in [&mut run.errors, &mut run.of_the_mean, &mut run.nees, &mut run.of_the_image, &mut run.power_db] {
            list.sort_by(f64::total_cmp);
        }
        run
    }
}

#[derive(Default)]
pub(super) struct Run {
    pub(super) errors: List<f64>,
    pub(super) of_the_mean: List<f64>,
    pub(super) of_the_image: List<f64>,
    pub(super) power_db: List<f64>,
    pub(super) nees: List<f64>,
    pub(super) alone: usize,
    /// Answers that are not valid.
    pub(super) useless: usize,
    pub(super) methods: List<Method>,
}

impl Run {
    /// Mean of the normalised squared errors, without the largest twentieth.
    pub(super) fn trimmed_nees(&self) -> f64 {
        let count = self.nees.len() * 19 / 20;
        self.nees[..count].iter().sum::<f64>() / count as f64
    }

    pub(super) fn assert_sigma_is_honest(&self) {
        let nees = self.trimmed_nees();
        assert!((0.3..3.0).contains(&nees), "{nees}");
    }
}

pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

pub(super) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

pub(super) fn degrees_apart(a: f64, b: f64) -> f64 {
    (a - b).sin().atan2((a - b).cos()).to_degrees().abs()
}

pub(super) fn array() -> Array {
    array::Config::default().build().unwrap()
}

pub(super) fn estimator() -> bearing::BearingEstimator {
    bearing::Config::default().build(array()).unwrap()
}

pub(super) fn phasors(z: [Complex; 4], noise: f32, micros: u64) -> Phasors {
    Phasors {
        time: Instant(micros),
        z,
        noise: [noise; 4],
        snr_db: 20.0,
        frequency_hz: 20_000.0,
        tone: Tone::Present,
        clipped: false,
        interferer: false,
    }
}

/// A look at a plane wave from the nose, at time and place.
pub(super) fn offer(stage: &Looks, state: &mut State, micros: u64, position_ned_m: Option<Ned>) -> Taken {
    let z = array().steering.map(|p| {
        let (im, re) = sin_cos(p[0]);
        Complex { re, im }
    });
    let phasors = phasors(z, 1e-6, micros);
    let bearing = estimator().estimate(&phasors);
    stage.take(state, &Frame { phasors: &phasors, bearing: &bearing, yaw_rad: 0.5, position_ned_m })
}

/// Solves nothing, but shows what would: the solver of a scene of eight looks, every heading taking part.
pub(super) fn with_solver(turn_deg: f64, wavenumber: f32, check: impl FnOnce(&Solver<'_>)) {
    let scene = Scenes { turn_deg, ..SCENES }.draw(&mut Rng::new(2, 9));
    let stage = Config::default().build(&array()).unwrap();
    let mut state = State::default();
    for (phasors, yaw, _) in &scene.looks {
        let bearing = estimator().estimate(phasors);
        let look = Frame { phasors, bearing: &bearing, yaw_rad: *yaw as f32, position_ned_m: None };
        assert_eq!(stage.take(&mut state, &look), Taken::Yes);
    }
    let mut headings = Headings::new();
    let heading_of = gather(&state.looks, &mut headings);
    check(&Solver {
        half: stage.half(&state).unwrap(),
        wavenumber,
        channel_variance: 3e-4,
        looks: &state.looks,
        headings: &headings,
        heading_of: &heading_of,
        stride: 1,
    });
}
