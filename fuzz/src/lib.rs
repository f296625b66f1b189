//! What holds for any input at all. Bytes are a case: the fuzz targets get theirs from libFuzzer, the test
//! `fuzz_properties` draws its own from a seed.
//!
//! | case | goes through | must hold |
//! |---|---|---|
//! | [`frames`] | configurations, snapshots -> phase -> bearing | no panic, no NaN, 0 < sigma <= pi, never valid without a signal |
//! | [`link`](fn@link) | bytes, broken and whole frames, signed and not, outputs, parameters, keys, clocks -> framer and companion | every whole frame is found, nothing is invented; what is sent is well formed and signed where there is a key; a setpoint is what was published last, or that turned after a jump, inside the limits, fresh, and only where the failsafe table says so; with a key nothing unsigned or played back is believed; no parameter is proposed while in control, and what is settled builds and flies |
//! | [`steer`](fn@steer) | demands to the guard; sensors, controls and clocks through guidance and all planners -> setpoints, plans | finite and inside the limits of speed, acceleration, jerk, yaw rate and altitude; nothing without control; every plan finite |
//! | [`filters`](fn@filters) | sightings, walls, powers, looks, points, circles -> filters of the source, bank, seeking, link state, walls, search | finite; every covariance symmetric and positive; probabilities, directions and targets in range |
//! | [`lidar`](fn@lidar) | bytes, frames whole and broken -> a lidar's frames -> scans | no panic; every whole frame behind a whole one is found; rays in range |
//! | [`pad`](fn@pad) | frames of any size, broken and in any order -> pad detector | no panic; finite; a bad frame is never a pad |
//! | [`radio`](fn@radio) | bytes, IQ reports and lines of angles whole and broken -> measurements of direction finders | no panic; every whole report behind a whole one is found; fields in range |

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array;
use foxhound_core::doa::bearing::{self, Bearing, Estimator, Flags};
use foxhound_core::signal::phase::{self, Complex, Phasors};
use foxhound_core::signal::spectrum::Backend;
use foxhound_papers::aoa::AnyBearingEstimator;

mod filters;
mod lidar;
mod link;
mod pad;
mod radio;
mod steer;
pub use filters::filters;
pub use lidar::lidar;
pub use link::link;
pub use pad::pad;
pub use radio::radio;
pub use steer::steer;

/// What a case came to, so that a test can tell whether cases reach deep enough.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reached {
    /// The configuration was accepted.
    pub configured: bool,
    /// Answers: bearings, arrivals, frames found.
    pub answers: u32,
    /// Those that may be used: valid bearings; of the link, setpoints that move; of steering, what moved.
    pub usable: u32,
    /// Of the link, parameters that were settled.
    pub settled: u32,
}

/// Numbers that have broken programs before.
const CORNERS: [f32; 12] = [
    0.0,
    -0.0,
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-45,
    1e-20,
    1e20,
    -1.0,
];

/// Takes a case apart. Past its end everything is zero.
struct Draw<'a> {
    rest: &'a [u8],
}

impl Draw<'_> {
    fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.rest.split_first() else { return 0 };
        self.rest = rest;
        *first
    }

    fn word(&mut self) -> u32 {
        u32::from_le_bytes([(); 4].map(|()| self.byte()))
    }

    fn below(&mut self, count: u8) -> u8 {
        self.byte() % count
    }

    fn flag(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    /// In [0, 1).
    fn unit(&mut self) -> f32 {
        f32::from(u16::from_le_bytes([self.byte(), self.byte()])) / 65_536.0
    }

    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + self.unit() * (high - low)
    }

    /// Any number: of the range more often than not, or a corner, or any bits.
    fn any(&mut self, low: f32, high: f32) -> f32 {
        match self.byte() {
            0..=207 => self.between(low, high),
            208..=231 => CORNERS[usize::from(self.byte()) % CORNERS.len()],
            _ => f32::from_bits(self.word()),
        }
    }

    /// The usual value, or another of the range, or, seldom, any number.
    fn field(&mut self, usual: f32, low: f32, high: f32) -> f32 {
        match self.byte() {
            0..=127 => usual,
            128..=251 => self.between(low, high),
            _ => self.any(low, high),
        }
    }

    fn instant(&mut self, after: Instant) -> Instant {
        match self.byte() {
            0..=199 => after.plus_micros(u64::from(self.word() % 3_000_000)),
            200..=239 => after.plus_micros(u64::from(self.word())),
            240..=251 => Instant(u64::from(self.word())),
            _ => Instant(u64::from(self.word()) << 32 | u64::from(self.word())),
        }
    }
}

/// A small generator for what takes more numbers than a case has bytes: splitmix64.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Nearly normal: the sum of four uniform numbers, scaled.
    fn gaussian(&mut self) -> f32 {
        let bits = self.next();
        let sum: u32 = (0..4).map(|k| (bits >> (16 * k)) as u16 as u32).sum();
        (sum as f32 / 65_536.0 - 2.0) * 1.732
    }
}

fn array_config(draw: &mut Draw<'_>) -> array::Config {
    let wavelength_m = draw.field(0.345, 0.05, 1.0);
    let side_m = wavelength_m * draw.field(0.40, 0.01, 0.55);
    let mut config = array::Config::square(wavelength_m, side_m);
    if draw.below(4) == 0 {
        for coordinate in config.antennas_m.iter_mut().flatten() {
            *coordinate += draw.field(0.0, -0.1, 0.1) * wavelength_m;
        }
    }
    if draw.below(4) == 0 {
        let mut gain = || Complex { re: draw.field(1.0, -2.0, 2.0), im: draw.field(0.0, -2.0, 2.0) };
        config.channel_gain = Some([(); CHANNELS].map(|()| gain()));
    }
    config.require_calibration = draw.below(8) == 0;
    config
}

fn phase_config(draw: &mut Draw<'_>) -> phase::Config {
    let sample_rate_hz = draw.field(102_400.0, 1e3, 1e6);
    let mut config = phase::Config { sample_rate_hz, ..phase::Config::default() };
    config.tone_band_hz = [
        draw.field(0.02 * sample_rate_hz, 0.0, 0.5 * sample_rate_hz),
        draw.field(0.48 * sample_rate_hz, 0.0, 0.5 * sample_rate_hz),
    ];
    if draw.below(3) == 0 {
        config.tone_hz = Some(draw.field(0.15 * sample_rate_hz, 0.0, 0.5 * sample_rate_hz));
    }
    config.skew_s = [(); CHANNELS].map(|()| draw.field(0.0, -1.0, 1.0) / sample_rate_hz);
    if draw.flag() {
        config.backend = Backend::Microfft;
    }
    config
}

fn bearing_config(draw: &mut Draw<'_>) -> bearing::Config {
    let estimator = match draw.below(16) {
        0 => Estimator::PaperSquare,
        1 => Estimator::PaperRepaired,
        2 => Estimator::PaperCorrelated,
        3 => Estimator::Pair,
        4 => Estimator::TwoArray,
        5 => Estimator::ThreeAntenna,
        6 => Estimator::NArray,
        _ => Estimator::CrossSpectrum,
    };
    bearing::Config { estimator, channel_sigma_rad: draw.field(0.0, 0.0, 0.3) }
}

/// What stays the same from frame to frame, as a rule.
struct Scene {
    bins: f32,
    amplitude: f32,
    sigma: f32,
    phases_rad: [f32; CHANNELS],
}

fn scene(draw: &mut Draw<'_>, half: f32) -> Scene {
    let azimuth_rad = draw.unit() * TAU;
    let reach_rad = draw.field(0.4 * PI, 0.0, PI);
    let corners = [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0_f32]];
    Scene {
        bins: draw.field(0.2891 * half, 0.0, half),
        amplitude: draw.field(1000.0, 0.0, 6000.0),
        sigma: draw.field(50.0, 0.0, 2000.0),
        phases_rad: corners.map(|[x, y]| reach_rad * (x * azimuth_rad.cos() + y * azimuth_rad.sin())),
    }
}

fn snapshot<const N: usize>(draw: &mut Draw<'_>, scene: &Scene, time: Instant) -> AdcFrame<N> {
    let mut snapshot = AdcFrame::zeroed();
    snapshot.time = time;
    let mut noise = Noise(u64::from(draw.word()));
    let kind = draw.below(8);
    let (bins, ratio) = (draw.unit() * N as f32 / 2.0, draw.unit());
    let start_rad = draw.unit() * TAU;
    let words = [(); 16].map(|()| (draw.word() & 0xffff) as u16 as i16);
    for (channel, row) in snapshot.codes.iter_mut().enumerate() {
        let turn = |bins: f32, n: usize| TAU * (bins * n as f32 / N as f32).fract();
        for (n, code) in row.iter_mut().enumerate() {
            let tone = scene.amplitude * (turn(scene.bins, n) + start_rad + scene.phases_rad[channel]).cos();
            let hiss = scene.sigma * noise.gaussian();
            let value = match kind {
                0 => f32::from(words[(n + 5 * channel) % words.len()]),
                1 => f32::from(noise.next() as u16 as i16),
                2 => f32::from(words[channel]),
                3 => hiss,
                4 => tone + hiss + scene.amplitude * ratio * (turn(bins, n) + channel as f32).cos(),
                _ => tone + hiss,
            };
            // Beyond 12 bits only where words are taken as they are.
            *code = if kind < 2 { value as i16 } else { value.clamp(-2048.0, 2047.0).round() as i16 };
        }
    }
    match draw.below(16) {
        channel @ 0..4 => snapshot.codes[usize::from(channel)].fill(words[0] >> 4),
        4 => snapshot.codes[2] = snapshot.codes[1],
        _ => {}
    }
    snapshot
}

fn check_bearing(bearing: &Bearing) {
    // Comparisons are false for what is not a number.
    assert!(bearing.azimuth_rad.abs() <= PI + 1e-6, "azimuth: {bearing:?}");
    assert!(bearing.sigma_rad > 0.0 && bearing.sigma_rad <= PI, "sigma: {bearing:?}");
    assert!((0.0..=FRAC_PI_2 + 1e-6).contains(&bearing.elevation_rad), "elevation: {bearing:?}");
    assert!(bearing.elevation_sigma_rad > 0.0 && bearing.elevation_sigma_rad <= PI, "elevation: {bearing:?}");
    let quality = &bearing.quality;
    for number in [quality.snr_db, quality.frequency_hz, quality.closure_chi2, quality.wavenumber] {
        assert!(number.is_finite(), "quality: {bearing:?}");
    }
    let useless = Flags::NO_SIGNAL.0 | Flags::AMBIGUOUS.0 | Flags::UNCALIBRATED.0;
    assert!(!bearing.valid || bearing.flags.0 & useless == 0, "valid: {bearing:?}");
}

fn check_phasors(phasors: &Phasors) {
    for z in phasors.z {
        assert!(z.re.is_finite() && z.im.is_finite(), "{phasors:?}");
    }
    assert!(phasors.noise.iter().all(|noise| *noise > 0.0 && noise.is_finite()), "{phasors:?}");
    assert!(phasors.snr_db.is_finite() && phasors.frequency_hz.is_finite(), "{phasors:?}");
    assert!(phasors.frequency_hz >= 0.0, "{phasors:?}");
}

/// Any frames through any configuration: phase, then bearing.
pub fn frames(case: &[u8]) -> Reached {
    let mut draw = Draw { rest: case };
    match draw.below(8) {
        0 => frames_of::<128>(&mut draw),
        1 => frames_of::<256>(&mut draw),
        2 => frames_of::<512>(&mut draw),
        3 => frames_of::<1024>(&mut draw),
        _ => frames_of::<64>(&mut draw),
    }
}

fn frames_of<const N: usize>(draw: &mut Draw<'_>) -> Reached {
    let (phase, array, bearing) = (phase_config(draw), array_config(draw), bearing_config(draw));
    let (Ok(extractor), Ok(array)) = (phase.build::<N>(), array.build()) else { return Reached::default() };
    let Ok(estimator) = AnyBearingEstimator::build(&bearing, array) else { return Reached::default() };
    let mut reached = Reached { configured: true, ..Reached::default() };
    let mut state = phase::State::default();
    let mut now = Instant(0);
    let mut seen = scene(draw, N as f32 / 2.0);
    for _ in 0..=draw.below(12) {
        now = draw.instant(now);
        match draw.below(16) {
            0 => seen = scene(draw, N as f32 / 2.0),
            1 => state.reset(),
            _ => {}
        }
        let phasors = extractor.step(&mut state, &snapshot::<N>(draw, &seen, now));
        check_phasors(&phasors);
        let bearing = estimator.estimate(&phasors);
        check_bearing(&bearing);
        assert_eq!(bearing.time, now);
        reached.answers += 1;
        reached.usable += u32::from(bearing.valid);
    }
    reached
}
