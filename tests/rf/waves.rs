//! Waves made in `f64` by a model of their own: a plane wave reaches antenna `p` with the phase `k u . p`. And what the estimator
//! makes of them.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::TAU;

use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array;
use foxhound_core::doa::bearing::{self, Bearing, BearingEstimator, Flags};
use foxhound_core::signal::phase::{self, Phasors};
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

pub(crate) const N: usize = 256;
pub(crate) const SAMPLE_RATE_HZ: f64 = 102_400.0;
pub(crate) const BIN_HZ: f64 = SAMPLE_RATE_HZ / N as f64;
pub(crate) const WAVELENGTH_M: f64 = 0.345;
pub(crate) const SIDE_WAVELENGTHS: f64 = 0.40;
pub(crate) const TURNS: usize = 8;
/// A prime bin: no harmonic of the tone falls back on it.
pub(crate) const PRIME_BIN: f64 = 37.0;

pub(crate) struct Random {
    source: Xoshiro256PlusPlus,
    spare: Option<f64>,
}

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self { source: Xoshiro256PlusPlus::seed_from_u64(seed), spare: None }
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        ((self.source.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    pub(crate) fn turn(&mut self) -> f64 {
        TAU * self.uniform()
    }

    /// Box and Muller.
    pub(crate) fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        let (sine, cosine) = self.turn().sin_cos();
        self.spare = Some(radius * sine);
        radius * cosine
    }

    /// The first of each pair.
    pub(crate) fn first_normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * self.turn().cos()
    }
}

/// A plane wave.
#[derive(Clone, Copy)]
pub(crate) struct Wave {
    pub(crate) bins: f64,
    pub(crate) amplitude: f64,
    pub(crate) azimuth: f64,
    pub(crate) elevation: f64,
    pub(crate) phase: f64,
}

/// Antenna positions in units of the side, forward and right: front-right, front-left, back-left, back-right.
const CORNERS: [[f64; 2]; CHANNELS] = [[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]];

/// What the antennas hear before it becomes codes.
#[derive(Clone)]
pub(crate) struct Air {
    pub(crate) rows: [[f64; N]; CHANNELS],
    /// Phase that each channel adds to all that it hears from now on.
    pub(crate) channel_phases: [f64; CHANNELS],
}

impl Air {
    pub(crate) fn silence() -> Self {
        Self { rows: [[0.0; N]; CHANNELS], channel_phases: [0.0; CHANNELS] }
    }

    pub(crate) fn with_wave(self, wave: Wave) -> Self {
        self.with_pulse(wave, 0..N)
    }

    /// A wave that sounds during a part of the frame.
    pub(crate) fn with_pulse(mut self, wave: Wave, samples: std::ops::Range<usize>) -> Self {
        let k_side = TAU * SIDE_WAVELENGTHS * wave.elevation.cos();
        let step = TAU * wave.bins / N as f64;
        for ((row, [x, y]), channel_phase) in self.rows.iter_mut().zip(CORNERS).zip(self.channel_phases) {
            let lead = k_side * (x * wave.azimuth.cos() + y * wave.azimuth.sin());
            let first = wave.phase + channel_phase + lead + step * (samples.start as f64 - (N as f64 - 1.0) / 2.0);
            let (mut sine, mut cosine) = first.sin_cos();
            let (step_sine, step_cosine) = step.sin_cos();
            for value in &mut row[samples.clone()] {
                *value += wave.amplitude * cosine;
                (sine, cosine) = (sine * step_cosine + cosine * step_sine, cosine * step_cosine - sine * step_sine);
            }
        }
        self
    }

    pub(crate) fn with_noise(mut self, sigma: f64, random: &mut Random) -> Self {
        for value in self.rows.as_flattened_mut() {
            *value += sigma * random.normal();
        }
        self
    }

    pub(crate) fn with_offsets(mut self, offsets: [f64; CHANNELS]) -> Self {
        for (row, offset) in self.rows.iter_mut().zip(offsets) {
            row.iter_mut().for_each(|value| *value += offset);
        }
        self
    }

    /// Rounded to 12 bits, clipped at the rails.
    pub(crate) fn codes(&self) -> AdcFrame<N> {
        let codes = self.rows.map(|row| row.map(|value| value.round().clamp(-2048.0, 2047.0) as i16));
        AdcFrame { time: Instant(0), codes }
    }
}

/// A tone whose amplitude and noise fit the converter.
#[derive(Clone, Copy)]
pub(crate) struct Source {
    pub(crate) bins: f64,
    pub(crate) amplitude: f64,
    pub(crate) snr_db: f64,
    pub(crate) elevation: f64,
}

impl Source {
    pub(crate) fn new(bins: f64, snr_db: f64) -> Self {
        let loud = Self { bins, amplitude: 1.0, snr_db, elevation: 0.0 };
        Self { amplitude: 1500f64.min(2000.0 / (1.0 + 4.5 * loud.sigma())), ..loud }
    }

    /// Noise of a sample: the ratio is that of the powers, `A^2 / (2 sigma^2)`.
    pub(crate) fn sigma(&self) -> f64 {
        self.amplitude / (2.0 * 10f64.powf(self.snr_db / 10.0)).sqrt()
    }

    pub(crate) fn wave(&self, azimuth: f64, random: &mut Random) -> Wave {
        Wave { bins: self.bins, amplitude: self.amplitude, azimuth, elevation: self.elevation, phase: random.turn() }
    }

    pub(crate) fn air(&self, azimuth: f64, random: &mut Random) -> Air {
        Air::silence().with_wave(self.wave(azimuth, random)).with_noise(self.sigma(), random)
    }

    pub(crate) fn bound_deg(&self) -> f64 {
        let snr = 10f64.powf(self.snr_db / 10.0);
        (1.0 / (TAU * SIDE_WAVELENGTHS * self.elevation.cos() * (N as f64 * snr).sqrt())).to_degrees()
    }
}

/// Whether anything is carried from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Frames {
    Alone,
    Consecutive,
}

/// What came of it.
pub(crate) struct Heard {
    pub(crate) what: String,
    pub(crate) errors_deg: Vec<f64>,
    pub(crate) phasors: Vec<Phasors>,
    pub(crate) bearings: Vec<Bearing>,
}

pub(crate) fn estimator() -> BearingEstimator {
    let array = array::Config::square(WAVELENGTH_M as f32, (SIDE_WAVELENGTHS * WAVELENGTH_M) as f32);
    bearing::Config::default().build(array.build().unwrap()).unwrap()
}

pub(crate) fn anywhere() -> phase::Config {
    phase::Config { sample_rate_hz: SAMPLE_RATE_HZ as f32, tone_band_hz: [800.0, 50_000.0], ..phase::Config::default() }
}

/// Around the circle, eight times.
pub(crate) fn circle(
    what: &str,
    config: phase::Config,
    frames: Frames,
    seed: u64,
    make: impl FnMut(f64, &mut Random) -> AdcFrame<N>,
) -> Heard {
    let azimuths = (0..360 * TURNS).map(|k| f64::from((k % 360) as u32).to_radians());
    listen(&format!("{what}, {frames:?}"), config, frames, seed, azimuths, make)
}

pub(crate) fn listen(
    what: &str,
    config: phase::Config,
    frames: Frames,
    seed: u64,
    azimuths: impl Iterator<Item = f64>,
    mut make: impl FnMut(f64, &mut Random) -> AdcFrame<N>,
) -> Heard {
    let (extractor, estimator) = (config.build::<N>().unwrap(), estimator());
    let mut random = Random::new(seed);
    let mut state = phase::State::default();
    let mut heard = Heard { what: what.to_owned(), errors_deg: vec![], phasors: vec![], bearings: vec![] };
    for azimuth in azimuths {
        if frames == Frames::Alone {
            state = phase::State::default();
        }
        let phasors = extractor.step(&mut state, &make(azimuth, &mut random));
        let bearing = estimator.estimate(&phasors);
        heard.errors_deg.push(degrees_between(f64::from(bearing.azimuth_rad), azimuth));
        heard.phasors.push(phasors);
        heard.bearings.push(bearing);
    }
    heard
}

pub(crate) fn degrees_between(a: f64, b: f64) -> f64 {
    (a - b).sin().atan2((a - b).cos()).to_degrees()
}

impl Heard {
    pub(crate) fn rms(&self) -> f64 {
        rms(&self.errors_deg)
    }

    pub(crate) fn worst(&self) -> f64 {
        self.errors_deg.iter().fold(0.0, |worst, error| error.abs().max(worst))
    }

    pub(crate) fn share(&self, of: impl Fn(&Bearing) -> bool) -> f64 {
        self.bearings.iter().filter(|bearing| of(bearing)).count() as f64 / self.bearings.len() as f64
    }

    pub(crate) fn flagged(&self, flag: Flags) -> f64 {
        self.share(|bearing| bearing.flags.contains(flag))
    }

    /// Errors in units of their sigma.
    pub(crate) fn normalised(&self) -> impl Iterator<Item = f64> {
        self.errors_deg.iter().zip(&self.bearings).map(|(e, b)| e / f64::from(b.sigma_rad).to_degrees())
    }

    pub(crate) fn nees(&self) -> f64 {
        self.normalised().map(|e| e * e).sum::<f64>() / self.errors_deg.len() as f64
    }

    pub(crate) fn inside_three_sigma(&self) -> f64 {
        self.normalised().filter(|e| e.abs() <= 3.0).count() as f64 / self.errors_deg.len() as f64
    }

    pub(crate) fn report(&self, bound_deg: f64) -> String {
        format!(
            "{}: rms {:.4} = {:.3} bounds, worst {:.2}, NEES {:.3}, inside 3 sigma {:.4}, valid {:.4}, multipath {:.4}",
            self.what,
            self.rms(),
            self.rms() / bound_deg,
            self.worst(),
            self.nees(),
            self.inside_three_sigma(),
            self.share(|bearing| bearing.valid),
            self.flagged(Flags::MULTIPATH),
        )
    }

    /// All used, none wild, as good as asked, and not better than physics.
    pub(crate) fn assert_within(&self, times: f64, bound_deg: f64) -> &Self {
        let report = self.report(bound_deg);
        assert!(self.bearings.iter().all(|bearing| bearing.valid), "{report}");
        assert!(self.worst() <= 20.0, "{report}");
        assert!(self.rms() <= times * bound_deg, "{report}");
        self
    }

    pub(crate) fn assert_honest(&self) -> &Self {
        let report = self.report(1.0);
        assert!((0.80..=1.25).contains(&self.nees()), "{report}");
        assert!(self.inside_three_sigma() >= 0.99, "{report}");
        self
    }
}

pub(crate) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

pub(crate) fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}
