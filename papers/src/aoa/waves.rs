//! Waves for the tests of the paper's estimators, made in `f64`.

use super::{AnyBearingEstimator, Outcome, solve};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array;
use foxhound_core::doa::bearing::{Config, Estimator};
use foxhound_core::signal::phase::{Complex, Phasors, Tone};
use std::f64::consts::TAU;

pub(super) const ALL: [Estimator; 7] = [
    Estimator::PaperSquare,
    Estimator::PaperRepaired,
    Estimator::PaperCorrelated,
    Estimator::Pair,
    Estimator::TwoArray,
    Estimator::ThreeAntenna,
    Estimator::NArray,
];

pub(super) const SKEWED: [[f32; 2]; 4] = [[0.05, 0.06], [0.07, -0.05], [-0.055, -0.06], [-0.065, 0.05]];

/// The default array with its antennas elsewhere.
pub(super) fn with(antennas_m: [[f32; 2]; 4]) -> array::Config {
    array::Config { antennas_m, ..array::Config::default() }
}

/// Distance in f64 from a source, given by azimuth clockwise from the nose, horizontal range and height, to each antenna.
pub(super) fn distances(config: &array::Config, azimuth_rad: f64, range_m: f64, height_m: f64) -> [f64; 4] {
    let mean = |n: usize| config.antennas_m.iter().map(|p| f64::from(p[n])).sum::<f64>() / 4.0;
    let source = [mean(0) + range_m * azimuth_rad.cos(), mean(1) + range_m * azimuth_rad.sin()];
    config.antennas_m.map(|p| {
        let [forward, right] = [source[0] - f64::from(p[0]), source[1] - f64::from(p[1])];
        (forward * forward + right * right + height_m * height_m).sqrt()
    })
}

/// An outgoing wave: what is nearer leads.
pub(super) fn wave(config: &array::Config, distances: [f64; 4]) -> [Complex; 4] {
    distances.map(|d| {
        let (sine, cosine) = (-TAU * d / f64::from(config.wavelength_m)).sin_cos();
        Complex { re: (1000.0 * cosine) as f32, im: (1000.0 * sine) as f32 }
    })
}

pub(super) fn plane_wave(config: &array::Config, azimuth_rad: f64) -> [Complex; 4] {
    let (sine, cosine) = azimuth_rad.sin_cos();
    wave(config, config.antennas_m.map(|p| -(f64::from(p[0]) * cosine + f64::from(p[1]) * sine)))
}

pub(super) fn phasors(z: [Complex; 4], noise: f32) -> Phasors {
    Phasors {
        time: Instant(0),
        z,
        noise: [noise; 4],
        snr_db: 20.0,
        frequency_hz: 1.0,
        tone: Tone::Present,
        clipped: false,
        interferer: false,
    }
}

pub(super) fn estimator(estimator: Estimator, config: &array::Config) -> AnyBearingEstimator {
    AnyBearingEstimator::build(&Config { estimator, ..Config::default() }, config.build().unwrap()).unwrap()
}

pub(super) fn solved(estimator: Estimator, config: &array::Config, z: [Complex; 4]) -> Outcome {
    solve(estimator, &config.build().unwrap(), &z, [true; 4]).unwrap()
}

pub(super) fn error_deg(found: f32, truth: f64) -> f64 {
    let difference = f64::from(found) - truth;
    difference.sin().atan2(difference.cos()).to_degrees()
}
