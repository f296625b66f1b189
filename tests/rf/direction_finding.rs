//! Direction finding against the Cramer-Rao bound, and its word about itself, on waves made here in `f64` by a model of
//! their own: a plane wave reaches antenna `p` with the phase `k u . p`. 360 azimuths, eight times each, N = 256,
//! side 0.40 wavelength, 12-bit codes, unless said otherwise.
//!
//! The bound: `sigma = lambda / (2 pi s cos(el) sqrt(N SNR))`; 0.142 deg at 20 dB.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::f64::consts::{PI, TAU};

use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array;
use foxhound_core::doa::bearing::{self, Bearing, Finder, Flags};
use foxhound_core::signal::phase::{self, Phasors, Tone};
use foxhound_papers::multipath;
use foxhound_tests::run;
use npyz::WriterBuilder as _;
use rand_core::{Rng as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::Value;

const N: usize = 256;
const SAMPLE_RATE_HZ: f64 = 102_400.0;
const BIN_HZ: f64 = SAMPLE_RATE_HZ / N as f64;
const WAVELENGTH_M: f64 = 0.345;
const SIDE_WAVELENGTHS: f64 = 0.40;
const TURNS: usize = 8;
/// A prime bin: no harmonic of the tone falls back on it.
const PRIME_BIN: f64 = 37.0;

struct Random {
    source: Xoshiro256PlusPlus,
    spare: Option<f64>,
}

impl Random {
    fn new(seed: u64) -> Self {
        Self { source: Xoshiro256PlusPlus::seed_from_u64(seed), spare: None }
    }

    fn uniform(&mut self) -> f64 {
        ((self.source.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64
    }

    fn turn(&mut self) -> f64 {
        TAU * self.uniform()
    }

    /// Box and Muller.
    fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        let (sine, cosine) = self.turn().sin_cos();
        self.spare = Some(radius * sine);
        radius * cosine
    }
}

/// A plane wave.
#[derive(Clone, Copy)]
struct Wave {
    bins: f64,
    amplitude: f64,
    azimuth: f64,
    elevation: f64,
    phase: f64,
}

/// Antenna positions in units of the side, forward and right: front-right, front-left, back-left, back-right.
const CORNERS: [[f64; 2]; CHANNELS] = [[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]];

/// What the antennas hear before it becomes codes.
#[derive(Clone)]
struct Air {
    rows: [[f64; N]; CHANNELS],
    /// Phase that each channel adds to all that it hears from now on.
    channel_phases: [f64; CHANNELS],
}

impl Air {
    fn silence() -> Self {
        Self { rows: [[0.0; N]; CHANNELS], channel_phases: [0.0; CHANNELS] }
    }

    fn with_wave(self, wave: Wave) -> Self {
        self.with_pulse(wave, 0..N)
    }

    /// A wave that sounds during a part of the frame.
    fn with_pulse(mut self, wave: Wave, samples: std::ops::Range<usize>) -> Self {
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

    fn with_noise(mut self, sigma: f64, random: &mut Random) -> Self {
        for value in self.rows.as_flattened_mut() {
            *value += sigma * random.normal();
        }
        self
    }

    fn with_offsets(mut self, offsets: [f64; CHANNELS]) -> Self {
        for (row, offset) in self.rows.iter_mut().zip(offsets) {
            row.iter_mut().for_each(|value| *value += offset);
        }
        self
    }

    /// Rounded to 12 bits, clipped at the rails.
    fn codes(&self) -> AdcFrame<N> {
        let codes = self.rows.map(|row| row.map(|value| value.round().clamp(-2048.0, 2047.0) as i16));
        AdcFrame { time: Instant(0), codes }
    }
}

/// A tone whose amplitude and noise fit the converter.
#[derive(Clone, Copy)]
struct Source {
    bins: f64,
    amplitude: f64,
    snr_db: f64,
    elevation: f64,
}

impl Source {
    fn new(bins: f64, snr_db: f64) -> Self {
        let loud = Self { bins, amplitude: 1.0, snr_db, elevation: 0.0 };
        Self { amplitude: 1500f64.min(2000.0 / (1.0 + 4.5 * loud.sigma())), ..loud }
    }

    /// Noise of a sample: the ratio is that of the powers, `A^2 / (2 sigma^2)`.
    fn sigma(&self) -> f64 {
        self.amplitude / (2.0 * 10f64.powf(self.snr_db / 10.0)).sqrt()
    }

    fn wave(&self, azimuth: f64, random: &mut Random) -> Wave {
        Wave { bins: self.bins, amplitude: self.amplitude, azimuth, elevation: self.elevation, phase: random.turn() }
    }

    fn air(&self, azimuth: f64, random: &mut Random) -> Air {
        Air::silence().with_wave(self.wave(azimuth, random)).with_noise(self.sigma(), random)
    }

    fn bound_deg(&self) -> f64 {
        let snr = 10f64.powf(self.snr_db / 10.0);
        (1.0 / (TAU * SIDE_WAVELENGTHS * self.elevation.cos() * (N as f64 * snr).sqrt())).to_degrees()
    }
}

/// Whether anything is carried from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Frames {
    Alone,
    Consecutive,
}

/// What came of it.
struct Heard {
    what: String,
    errors_deg: Vec<f64>,
    phasors: Vec<Phasors>,
    bearings: Vec<Bearing>,
}

fn finder() -> Finder {
    let array = array::Config::square(WAVELENGTH_M as f32, (SIDE_WAVELENGTHS * WAVELENGTH_M) as f32);
    bearing::Config::default().build(array.build().unwrap()).unwrap()
}

fn anywhere() -> phase::Config {
    phase::Config { sample_rate_hz: SAMPLE_RATE_HZ as f32, tone_band_hz: [800.0, 50_000.0], ..phase::Config::default() }
}

/// Around the circle, eight times.
fn circle(
    what: &str,
    config: phase::Config,
    frames: Frames,
    seed: u64,
    make: impl FnMut(f64, &mut Random) -> AdcFrame<N>,
) -> Heard {
    let azimuths = (0..360 * TURNS).map(|k| f64::from((k % 360) as u32).to_radians());
    listen(&format!("{what}, {frames:?}"), config, frames, seed, azimuths, make)
}

fn listen(
    what: &str,
    config: phase::Config,
    frames: Frames,
    seed: u64,
    azimuths: impl Iterator<Item = f64>,
    mut make: impl FnMut(f64, &mut Random) -> AdcFrame<N>,
) -> Heard {
    let (extractor, finder) = (config.build::<N>().unwrap(), finder());
    let mut random = Random::new(seed);
    let mut state = phase::State::default();
    let mut heard = Heard { what: what.to_owned(), errors_deg: vec![], phasors: vec![], bearings: vec![] };
    for azimuth in azimuths {
        if frames == Frames::Alone {
            state = phase::State::default();
        }
        let phasors = extractor.step(&mut state, &make(azimuth, &mut random));
        let bearing = finder.find(&phasors);
        heard.errors_deg.push(degrees_between(f64::from(bearing.azimuth_rad), azimuth));
        heard.phasors.push(phasors);
        heard.bearings.push(bearing);
    }
    heard
}

fn degrees_between(a: f64, b: f64) -> f64 {
    (a - b).sin().atan2((a - b).cos()).to_degrees()
}

impl Heard {
    fn rms(&self) -> f64 {
        rms(&self.errors_deg)
    }

    fn worst(&self) -> f64 {
        self.errors_deg.iter().fold(0.0, |worst, error| error.abs().max(worst))
    }

    fn share(&self, of: impl Fn(&Bearing) -> bool) -> f64 {
        self.bearings.iter().filter(|bearing| of(bearing)).count() as f64 / self.bearings.len() as f64
    }

    fn flagged(&self, flag: Flags) -> f64 {
        self.share(|bearing| bearing.flags.contains(flag))
    }

    /// Errors in units of their sigma.
    fn normalised(&self) -> impl Iterator<Item = f64> {
        self.errors_deg.iter().zip(&self.bearings).map(|(e, b)| e / f64::from(b.sigma_rad).to_degrees())
    }

    fn nees(&self) -> f64 {
        self.normalised().map(|e| e * e).sum::<f64>() / self.errors_deg.len() as f64
    }

    fn inside_three_sigma(&self) -> f64 {
        self.normalised().filter(|e| e.abs() <= 3.0).count() as f64 / self.errors_deg.len() as f64
    }

    fn report(&self, bound_deg: f64) -> String {
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
    fn assert_within(&self, times: f64, bound_deg: f64) -> &Self {
        let report = self.report(bound_deg);
        assert!(self.bearings.iter().all(|bearing| bearing.valid), "{report}");
        assert!(self.worst() <= 20.0, "{report}");
        assert!(self.rms() <= times * bound_deg, "{report}");
        self
    }

    fn assert_honest(&self) -> &Self {
        let report = self.report(1.0);
        assert!((0.80..=1.25).contains(&self.nees()), "{report}");
        assert!(self.inside_three_sigma() >= 0.99, "{report}");
        self
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

fn at_the_bound(snr_db: f64) {
    // Bins on and off the grid; the lowest and the half-way ones are allowed a little more.
    for (bins, times) in [(PRIME_BIN, 1.10), (37.37, 1.10), (4.5, 1.35), (20.5, 1.35), (60.25, 1.10), (113.8, 1.10)] {
        let source = Source::new(bins, snr_db);
        for frames in [Frames::Alone, Frames::Consecutive] {
            let seed = (bins * 100.0 + snr_db) as u64;
            let what = format!("{snr_db} dB at bin {bins}");
            circle(&what, anywhere(), frames, seed, |azimuth, random| source.air(azimuth, random).codes())
                .assert_within(times, source.bound_deg())
                .assert_honest();
        }
    }
}

/// At 0 dB the error is at the Cramer-Rao bound, on a frequency bin and between bins.
#[test]
fn at_0_db_the_error_is_at_the_bound_on_a_bin_and_off() {
    at_the_bound(0.0);
}

/// At 10 dB the error is at the Cramer-Rao bound, on a frequency bin and between bins.
#[test]
fn at_10_db_the_error_is_at_the_bound_on_a_bin_and_off() {
    at_the_bound(10.0);
}

/// At 20 dB the error is at the Cramer-Rao bound, on a frequency bin and between bins.
#[test]
fn at_20_db_the_error_is_at_the_bound_on_a_bin_and_off() {
    at_the_bound(20.0);
}

/// At 40 dB the error is at the Cramer-Rao bound, on a frequency bin and between bins.
#[test]
fn at_40_db_the_error_is_at_the_bound_on_a_bin_and_off() {
    at_the_bound(40.0);
}

/// No error is below the Cramer-Rao bound, so the signal model of these tests is right.
#[test]
fn no_estimate_is_better_than_physics() {
    let source = Source::new(37.37, 20.0);
    let heard = circle("20 dB", anywhere(), Frames::Alone, 1, |azimuth, random| source.air(azimuth, random).codes());
    assert!(heard.rms() > 0.93 * source.bound_deg(), "the model of this test is wrong: {}", heard.rms());
}

/// With two thirds of the samples clipped, a tone at a prime bin keeps an error of at most 0.1 degrees.
#[test]
fn with_two_thirds_of_the_samples_clipped_a_prime_bin_keeps_a_tenth_of_a_degree() {
    // |cos| > 1/2 two thirds of the time.
    let source = Source { amplitude: 2.0 * 2047.0, ..Source::new(PRIME_BIN, 30.0) };
    for frames in [Frames::Alone, Frames::Consecutive] {
        let heard = circle("clipped", anywhere(), frames, 3, |azimuth, random| {
            let codes = source.air(azimuth, random).codes();
            let clipped: u16 = codes.clip_count().iter().sum();
            assert!((620..740).contains(&clipped), "{clipped} of 1024");
            codes
        });
        assert!(heard.rms() <= 0.10, "{}", heard.rms());
        assert_eq!(heard.flagged(Flags::CLIP), 1.0);
        assert_eq!(heard.share(|bearing| bearing.valid), 1.0);
        heard.assert_honest();
    }
}

/// Offsets of a third of full scale do not disturb a low tone.
#[test]
fn offsets_of_a_third_of_full_scale_do_not_disturb_a_low_tone() {
    let full_scale = 2048.0;
    for (snr_db, offsets) in [(20.0, [0.3, -0.3, 0.1, 0.0]), (10.0, [0.3; 4]), (30.0, [-0.3, 0.2, 0.3, -0.1])] {
        let source =
            Source { amplitude: 900.0 / (1.0 + 2.0 * (10f64).powf(-snr_db / 20.0)), ..Source::new(6.5, snr_db) };
        for frames in [Frames::Alone, Frames::Consecutive] {
            let what = format!("{snr_db} dB at bin 6.5, offsets {offsets:?}");
            circle(&what, anywhere(), frames, 4, |azimuth, random| {
                source.air(azimuth, random).with_offsets(offsets.map(|offset| offset * full_scale)).codes()
            })
            .assert_within(1.35, source.bound_deg())
            .assert_honest();
        }
    }
}

/// A dead channel is reported by its number, and the other three still give an honest bearing.
#[test]
fn each_dead_channel_is_named_and_the_other_three_go_on() {
    let source = Source::new(37.37, 20.0);
    for dead in 0..CHANNELS {
        // Cut off, stuck somewhere, stuck at a rail, and with an open input that still makes noise.
        for stuck in [Some(0), Some(-731), Some(-2048), None] {
            for frames in [Frames::Alone, Frames::Consecutive] {
                let what = format!("channel {} dead, {stuck:?}", dead + 1);
                let heard = circle(&what, anywhere(), frames, 5 + dead as u64, |azimuth, random| {
                    let mut air = source.air(azimuth, random);
                    for value in &mut air.rows[dead] {
                        *value = stuck.map_or_else(|| source.sigma() * random.normal(), f64::from);
                    }
                    air.codes()
                });
                heard.assert_within(1.6, source.bound_deg()).assert_honest();
                for channel in 0..CHANNELS {
                    let named = if channel == dead { 1.0 } else { 0.0 };
                    assert_eq!(heard.flagged(Flags::dead(channel)), named, "{what}");
                }
                assert_eq!(heard.flagged(Flags::CLIP), if stuck == Some(-2048) { 1.0 } else { 0.0 }, "{what}");
            }
        }
    }
}

/// An interferer of ten times the power, 6 to 20 bins away, leaves an error of at most 0.25 degrees.
#[test]
fn an_interferer_of_ten_times_the_power_eight_bins_away_is_kept_out() {
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 20.0) };
    let band = |low: f64, high: f64| [low, high].map(|bin| (bin * BIN_HZ) as f32);
    let told = phase::Config { tone_hz: Some((37.0 * BIN_HZ) as f32), ..anywhere() };
    let in_band = phase::Config { tone_band_hz: band(33.0, 41.0), ..anywhere() };
    for (config, name) in [(told, "told"), (in_band, "band")] {
        for (away, seed) in [8.0, -8.0, 8.5, 6.0, 6.5, -12.3, 20.0].into_iter().zip(60..) {
            for frames in [Frames::Alone, Frames::Consecutive] {
                let what = format!("interferer {away} bins away, {name}");
                let heard = circle(&what, config, frames, seed, |azimuth, random| {
                    let other = Wave {
                        bins: source.bins + away,
                        amplitude: source.amplitude * 10f64.sqrt(),
                        ..source.wave(azimuth + 0.3 + 5.7 * random.uniform(), random)
                    };
                    source.air(azimuth, random).with_wave(other).codes()
                });
                let report = heard.report(source.bound_deg());
                assert!(heard.bearings.iter().all(|bearing| bearing.valid), "{report}");
                assert!(heard.rms() <= 0.25, "{report}");
                let sigma_deg = |bearing: &Bearing| f64::from(bearing.sigma_rad.to_degrees());
                let widest_deg = heard.bearings.iter().map(sigma_deg).fold(0.0, f64::max);
                assert!(widest_deg <= 0.6, "{widest_deg}: {report}");
                assert!(heard.inside_three_sigma() >= 0.95, "{report}");
                assert!(heard.flagged(Flags::INTERFERER) > 0.99, "{report}");
                // Nor is what leaks taken for a reflection.
                assert!(heard.flagged(Flags::MULTIPATH) <= 0.01, "{report}");
            }
        }
    }
}

/// What leaks from an interferer is included in sigma.
#[test]
fn what_leaks_from_an_interferer_is_in_sigma_where_noise_does_not_hide_it() {
    // At 40 dB it is up to five times the noise.
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 40.0) };
    let in_band = phase::Config { tone_band_hz: [33.0, 41.0].map(|bin| (bin * BIN_HZ) as f32), ..anywhere() };
    for away in [6.0, 6.5, 8.0, -8.0, -8.5, 20.5] {
        let heard = circle(&format!("{away} bins"), in_band, Frames::Alone, 70, |azimuth, random| {
            let amplitude = source.amplitude * 10f64.sqrt();
            let other = Wave { bins: source.bins + away, amplitude, ..source.wave(random.turn(), random) };
            source.air(azimuth, random).with_wave(other).codes()
        });
        let report = heard.report(source.bound_deg());
        assert!(heard.inside_three_sigma() >= 0.99 && (0.4..1.8).contains(&heard.nees()), "{report}");
        assert!(heard.flagged(Flags::MULTIPATH) <= 0.01 && heard.rms() <= 0.1, "{report}");
    }
}

/// A reflection is flagged even beside an interferer.
#[test]
fn a_reflection_beside_an_interferer_is_flagged_all_the_same() {
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 20.0) };
    let in_band = phase::Config { tone_band_hz: [33.0, 41.0].map(|bin| (bin * BIN_HZ) as f32), ..anywhere() };
    let heard = circle("-10 dB reflection and interferer", in_band, Frames::Alone, 71, |azimuth, random| {
        let amplitude = source.amplitude * 10f64.sqrt();
        let other = Wave { bins: source.bins + 8.0, amplitude, ..source.wave(random.turn(), random) };
        let echo = Wave { amplitude: 0.1 * amplitude, ..source.wave(random.turn(), random) };
        source.air(azimuth, random).with_wave(other).with_wave(echo).codes()
    });
    let report = heard.report(source.bound_deg());
    assert!(heard.flagged(Flags::MULTIPATH) >= 0.85, "{report}");
    let flagged = heard.share(|bearing| bearing.flags.contains(Flags::MULTIPATH));
    let wide = heard.share(|bearing| bearing.sigma_rad.to_degrees() >= 5.0);
    assert!(wide >= 0.95 * flagged, "{wide} of {flagged}: {report}");
}

/// At most one frame in 1000 of noise gives a bearing, and 95 % of those with a tone at -9 dB do.
#[test]
fn noise_is_never_a_bearing_and_a_tone_at_minus_9_db_is_heard() {
    for frames in [Frames::Alone, Frames::Consecutive] {
        for sigma in [1.0, 20.0, 400.0] {
            let silence = listen("noise", anywhere(), frames, 7, (0..4000).map(|_| 0.0), |_, random| {
                Air::silence().with_noise(sigma, random).codes()
            });
            assert!(silence.share(|bearing| bearing.valid) <= 0.001, "{}", silence.report(1.0));
            assert!(silence.flagged(Flags::NO_SIGNAL) >= 0.999, "{}", silence.report(1.0));
        }
        for bins in [PRIME_BIN, 37.5, 90.2] {
            let source = Source::new(bins, -9.0);
            let heard = listen("-9 dB", anywhere(), frames, 8, (0..4000).map(f64::from), |azimuth, random| {
                source.air(azimuth, random).codes()
            });
            let found = heard.bearings.iter().zip(&heard.phasors).filter(|(bearing, phasors)| {
                let away = f64::from(phasors.frequency_hz) / BIN_HZ - bins;
                bearing.valid && phasors.tone == Tone::Present && away.abs() < 0.5
            });
            let share = found.count() as f64 / 4000.0;
            assert!(share >= 0.95, "{share}: {}", heard.report(source.bound_deg()));
        }
    }
}

/// The noise after a tone gives no bearing either.
#[test]
fn the_noise_after_a_tone_is_no_bearing_either() {
    let source = Source::new(41.6, 20.0);
    let mut frame = 0;
    let heard =
        listen("a tone, then noise", anywhere(), Frames::Consecutive, 9, (0..4000).map(|_| 1.0), |azimuth, random| {
            frame += 1;
            if frame <= 40 {
                return source.air(azimuth, random).codes();
            }
            Air::silence().with_noise(source.sigma(), random).codes()
        });
    assert_eq!(heard.bearings[..40].iter().filter(|bearing| bearing.valid).count(), 40);
    assert!(heard.bearings[40..].iter().filter(|bearing| bearing.valid).count() <= 4, "{}", heard.report(1.0));
}

/// A source 30 or 60 degrees above is found at the bound, and so is its elevation.
#[test]
fn a_source_thirty_degrees_above_costs_the_cosine_and_its_elevation_is_told() {
    for degrees in [30.0_f64, 60.0] {
        let source = Source { elevation: degrees.to_radians(), ..Source::new(37.37, 20.0) };
        for frames in [Frames::Alone, Frames::Consecutive] {
            let what = format!("{degrees} deg above");
            let heard = circle(&what, anywhere(), frames, 10, |azimuth, random| source.air(azimuth, random).codes());
            heard.assert_within(1.10, source.bound_deg()).assert_honest();
            let elevations = |b: &Bearing| f64::from(b.elevation_rad).to_degrees() - degrees;
            let errors: Vec<f64> = heard.bearings.iter().map(elevations).collect();
            assert!(rms(&errors) <= 0.5, "{}", rms(&errors));
            let normalised = heard.bearings.iter().zip(&errors);
            let nees =
                normalised.map(|(b, e)| (e / f64::from(b.elevation_sigma_rad).to_degrees()).powi(2)).sum::<f64>();
            let nees = nees / errors.len() as f64;
            assert!((0.80..=1.25).contains(&nees), "elevation NEES {nees}");
        }
    }
}

/// A source exactly ahead is found as well as any other.
#[test]
fn exactly_ahead_is_as_good_as_anywhere() {
    let source = Source::new(37.37, 20.0);
    for frames in [Frames::Alone, Frames::Consecutive] {
        let heard = listen("ahead", anywhere(), frames, 11, (0..4000).map(|_| 0.0), |azimuth, random| {
            source.air(azimuth, random).codes()
        });
        heard.assert_within(1.10, source.bound_deg()).assert_honest();
        assert!(heard.worst() <= 0.7, "{}", heard.worst());
    }
}

fn a_reflection_at_minus_10_db_shows_in_a_single_frame(snr_db: f64) {
    let source = Source::new(37.37, snr_db);
    let heard = circle("-10 dB reflection", anywhere(), Frames::Alone, 12, |azimuth, random| {
        let echo = source.wave(random.turn(), random);
        let echo = Wave { amplitude: source.amplitude * 10f64.powf(-0.5), ..echo };
        source.air(azimuth, random).with_wave(echo).codes()
    });
    let report = format!("{snr_db} dB: {}", heard.report(source.bound_deg()));
    assert!(heard.flagged(Flags::MULTIPATH) >= 0.85, "{report}");
    // A flag widens sigma; it does not throw the frame away.
    assert!(heard.share(|bearing| bearing.valid) > 0.99, "{report}");
}

/// A reflection at -10 dB is flagged in 85 % of single frames at 40 dB.
#[test]
fn a_reflection_at_minus_10_db_shows_in_a_single_frame_at_40_db() {
    a_reflection_at_minus_10_db_shows_in_a_single_frame(40.0);
}

/// A reflection at -10 dB is flagged in 85 % of single frames at 20 and 30 dB.
#[test]
fn a_reflection_at_minus_10_db_shows_in_a_single_frame_at_20_and_30_db() {
    a_reflection_at_minus_10_db_shows_in_a_single_frame(30.0);
    a_reflection_at_minus_10_db_shows_in_a_single_frame(20.0);
}

/// At most 1 % of frames without a reflection are flagged.
#[test]
fn a_clean_frame_is_not_taken_for_a_reflection() {
    for snr_db in [0.0, 10.0, 20.0, 30.0, 40.0, 60.0] {
        let source = Source::new(37.37, snr_db);
        let heard =
            circle("clean", anywhere(), Frames::Alone, 13, |azimuth, random| source.air(azimuth, random).codes());
        assert!(heard.flagged(Flags::MULTIPATH) <= 0.01, "{snr_db} dB: {}", heard.report(source.bound_deg()));
    }
}

/// A beacon and one reflection, heard on the way.
struct Passage {
    frames: Vec<AdcFrame<N>>,
    yaws: Vec<f64>,
    /// Azimuth of the beacon in the body frame of the last look.
    truth: f64,
}

/// Eight looks a third of a wavelength apart, the reflection at -6 dB, channels that are one degree off.
fn passage(turning: bool, random: &mut Random) -> Passage {
    let source = Source { amplitude: 800.0, ..Source::new(37.37, 20.0) };
    let ahead = |range: f64, azimuth: f64| [range * azimuth.cos(), range * azimuth.sin()];
    let beacon = ahead(8.0 + 50.0 * random.uniform(), random.turn());
    let image = ahead(15.0 + 80.0 * random.uniform(), random.turn());
    let channel_phases = [0; CHANNELS].map(|_| 1f64.to_radians() * random.normal());
    let course = random.turn();
    let mut yaw = random.turn() - PI;
    let (mut frames, mut yaws, mut truth) = (vec![], vec![], 0.0);
    for look in 0..8 {
        let here = ahead(f64::from(look) * WAVELENGTH_M / 3.0, course);
        let common = random.turn();
        let mut air = Air { channel_phases, ..Air::silence() };
        for (from, level) in [(beacon, 1.0), (image, 10f64.powf(-6.0 / 20.0))] {
            let way = [from[0] - here[0], from[1] - here[1]];
            air = air.with_wave(Wave {
                bins: source.bins,
                amplitude: level * source.amplitude,
                azimuth: way[1].atan2(way[0]) - yaw,
                elevation: 0.0,
                phase: common - TAU / WAVELENGTH_M * way[0].hypot(way[1]),
            });
        }
        truth = (beacon[1] - here[1]).atan2(beacon[0] - here[0]) - yaw;
        frames.push(air.with_noise(source.sigma(), random).codes());
        yaws.push(yaw);
        if turning {
            yaw += 20f64.to_radians() * (random.uniform() - 0.3);
        }
    }
    Passage { frames, yaws, truth }
}

/// A reflection at -6 dB leaves a median error of at most 1 degree over eight frames while moving.
#[test]
fn a_reflection_at_minus_6_db_costs_less_than_a_degree_over_eight_looks() {
    let (extractor, finder) = (anywhere().build::<N>().unwrap(), finder());
    let config = multipath::Config { move_min_wavelengths: 0.0, ..multipath::Config::default() };
    let looks = config.build(finder.array()).unwrap();
    for turning in [false, true] {
        let mut random = Random::new(16);
        let (mut errors, mut single, mut normalised, mut unresolved) = (vec![], vec![], vec![], 0);
        for _ in 0..250 {
            let passage = passage(turning, &mut random);
            let (mut tone, mut state) = (phase::State::default(), multipath::State::default());
            for (frame, yaw) in passage.frames.iter().zip(&passage.yaws) {
                let phasors = extractor.step(&mut tone, frame);
                let bearing = finder.find(&phasors);
                let yaw_rad = *yaw as f32;
                let look = multipath::Frame { phasors: &phasors, bearing: &bearing, yaw_rad, position_ned_m: None };
                assert_eq!(looks.take(&mut state, &look), multipath::Taken::Yes);
                single.push(degrees_between(f64::from(bearing.azimuth_rad) + yaw, passage.truth + passage.yaws[7]));
            }
            let bearing = looks.solve(&state, 1.0).unwrap().bearing;
            unresolved += usize::from(!bearing.valid);
            let error = degrees_between(f64::from(bearing.azimuth_rad), passage.truth);
            errors.push(error);
            normalised.push(error / f64::from(bearing.sigma_rad).to_degrees());
        }
        let (median, p90) = (quantile(&errors, 0.5), quantile(&errors, 0.9));
        assert!(median <= 1.0 && p90 <= 2.5, "turning {turning}: median {median}, p90 {p90}");
        // Where both come from almost the same side they may stay one, and it says so.
        assert_eq!(unresolved, 0);
        assert!(quantile(&single, 0.5) > 4.0 * median, "a look alone: {}", quantile(&single, 0.5));
        assert!(quantile(&normalised, 0.95) <= 3.0, "{}", quantile(&normalised, 0.95));
    }
}

/// An antenna spacing of half a wavelength is refused with the reason.
#[test]
fn half_a_wavelength_is_refused_with_the_reason() {
    let refused = array::Config::square(0.345, 0.1725).build().unwrap_err();
    assert_eq!(refused.field, "side_m");
    assert!(format!("{refused}").contains("half a wavelength"), "{refused}");
}

/// A beacon that sends pulses for 2 % of the time is heard in its pulses only.
#[test]
fn a_beacon_that_pulses_one_fiftieth_of_the_time_is_heard_in_its_pulses_only() {
    // 20 ms every second: a frame of 2.5 ms. The pulse begins somewhere in a frame.
    let source = Source::new(45.3, 20.0);
    let mut random = Random::new(14);
    let (extractor, finder) = (anywhere().build::<N>().unwrap(), finder());
    let mut state = phase::State::default();
    let (mut errors, mut normalised, mut frequency_errors, mut edges) = (vec![], vec![], vec![], vec![]);
    let (mut full, mut heard_full, mut silent, mut wrong, mut wild_edges) = (0, 0, 0, 0, 0);
    let pulse = (0.020 * SAMPLE_RATE_HZ) as i64;
    let period = SAMPLE_RATE_HZ as i64;
    for frame in 0..8000_i64 {
        let azimuth = f64::from((frame % 360) as i32).to_radians();
        let since = (frame * N as i64 + 100) % period;
        // Samples of this frame that lie in a pulse.
        let start = if since < pulse { 0 } else { (period - since).min(N as i64) };
        let end = if since < pulse { (pulse - since).min(N as i64) } else { N as i64 };
        let samples = start as usize..end as usize;
        let wave = source.wave(azimuth, &mut random);
        let air = Air::silence().with_pulse(wave, samples.clone()).with_noise(source.sigma(), &mut random);
        let phasors = extractor.step(&mut state, &air.codes());
        let bearing = finder.find(&phasors);
        let error = degrees_between(f64::from(bearing.azimuth_rad), azimuth);
        match samples.len() {
            0 => {
                silent += 1;
                wrong += usize::from(bearing.valid || !bearing.flags.contains(Flags::NO_SIGNAL));
            }
            N => {
                full += 1;
                heard_full += usize::from(bearing.valid);
                errors.push(error);
                normalised.push(error / f64::from(bearing.sigma_rad).to_degrees());
                frequency_errors.push(f64::from(phasors.frequency_hz) / BIN_HZ - source.bins);
            }
            _ if bearing.valid => {
                edges.push(error);
                wild_edges += usize::from(error.abs() > 5.0 * f64::from(bearing.sigma_rad).to_degrees());
            }
            _ => (),
        }
    }
    assert!(silent > 7700 && full > 120);
    assert_eq!(heard_full, full);
    assert!(wrong <= 7, "{wrong} of {silent} silent frames gave a bearing");
    assert!(rms(&errors) <= 1.15 * source.bound_deg(), "{}", rms(&errors));
    assert!(rms(&normalised).powi(2) < 1.5, "{}", rms(&normalised));
    assert!(rms(&frequency_errors) < 0.01, "{}", rms(&frequency_errors));
    // Pieces of a pulse are worse, and say so.
    assert_eq!(wild_edges, 0, "{edges:?}");
}

/// A carrier that drifts is followed, with the error at the bound.
#[test]
fn a_carrier_that_drifts_is_followed() {
    // Bins a frame: a hundredth is 1.6 kHz a second.
    for (snr_db, drift) in [(0.0, 0.001), (20.0, 0.001), (20.0, 0.01), (40.0, 0.01)] {
        let source = Source::new(30.0, snr_db);
        let mut bins = source.bins;
        let mut away = vec![];
        let what = format!("{snr_db} dB, {drift} bins a frame");
        let heard = circle(&what, anywhere(), Frames::Consecutive, 15, |azimuth, random| {
            bins += drift;
            away.push(bins);
            Source { bins, ..source }.air(azimuth, random).codes()
        });
        heard.assert_within(1.10, source.bound_deg()).assert_honest();
        let errors: Vec<f64> =
            heard.phasors.iter().zip(&away).map(|(p, bins)| f64::from(p.frequency_hz) / BIN_HZ - bins).collect();
        assert!(rms(&errors) < 0.03, "{what}: {}", rms(&errors));
    }
}

/// The lines that `foxhound bearing` prints for frames.
fn lines(frames: &[AdcFrame<N>], yaws: &[f64], keys: &str, arguments: &[&str]) -> Vec<Value> {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    let (adc, array, yaw) = (path("adc.npy"), path("array.toml"), path("yaw.npy"));
    write_npy(&adc, &[frames.len() as u64, 4, N as u64], frames.iter().flat_map(|frame| frame.codes.as_flattened()));
    write_npy(&yaw, &[yaws.len() as u64], yaws);
    let side_m = SIDE_WAVELENGTHS * WAVELENGTH_M;
    let text = format!("wavelength_m = {WAVELENGTH_M}\nside_m = {side_m}\nsample_rate_hz = {SAMPLE_RATE_HZ}\n{keys}");
    std::fs::write(&array, text).unwrap();
    let mut all = vec!["bearing", "--adc", &adc, "--array", &array, "--json"];
    all.extend_from_slice(arguments);
    if !yaws.is_empty() {
        all.extend(["--yaw", yaw.as_str()]);
    }
    let output = run(&all);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn write_npy<'a, T: npyz::AutoSerialize + Copy + 'a>(
    path: &str,
    shape: &[u64],
    values: impl IntoIterator<Item = &'a T>,
) {
    let file = std::fs::File::create(path).unwrap();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(shape).writer(file).begin_nd().unwrap();
    writer.extend(values).unwrap();
    writer.finish().unwrap();
}

/// Errors of lines, in degrees and in sigmas.
fn errors_of(lines: &[Value], truth: impl Fn(usize) -> f64) -> (Vec<f64>, Vec<f64>) {
    let errors = lines.iter().enumerate().map(|(k, line)| {
        assert_eq!(line["valid"], true, "{line}");
        let error = degrees_between(line["azimuth_deg"].as_f64().unwrap().to_radians(), truth(k));
        (error, error / line["sigma_deg"].as_f64().unwrap())
    });
    errors.unzip()
}

fn turns(count: usize, make: impl Fn(f64, &mut Random) -> AdcFrame<N>) -> Vec<AdcFrame<N>> {
    let mut random = Random::new(17);
    (0..count).map(|k| make(azimuth_of(k), &mut random)).collect()
}

fn azimuth_of(frame: usize) -> f64 {
    (frame as f64).to_radians()
}

/// `foxhound bearing` is at the bound too.
#[test]
fn the_command_line_is_at_the_bound_too() {
    for (bins, snr_db) in [(37.37, 0.0), (60.25, 10.0), (37.0, 40.0)] {
        let source = Source::new(bins, snr_db);
        let frames = turns(2880, |azimuth, random| source.air(azimuth, random).codes());
        for arguments in [&[][..], &["--independent"]] {
            let answers = lines(&frames, &[], "", arguments);
            // One plane wave, less its noise; none has a range but by chance, three sigma on one side.
            let coherent = |line: &Value| line["coherence"].as_f64().is_some_and(|gamma| (0.93..=1.0).contains(&gamma));
            assert!(answers.iter().all(coherent), "{bins} {snr_db}: coherence");
            assert!(
                answers.iter().filter(|line| !line["range_hint_m"].is_null()).count() <= 14,
                "{bins} {snr_db}: ranges"
            );
            let (errors, normalised) = errors_of(&answers, azimuth_of);
            assert_eq!(errors.len(), 2880);
            assert!(rms(&errors) <= 1.10 * source.bound_deg(), "{bins} {snr_db}: {}", rms(&errors));
            let nees = rms(&normalised).powi(2);
            assert!((0.80..=1.25).contains(&nees), "{bins} {snr_db}: NEES {nees}");
        }
    }
}

/// `foxhound bearing` reports a dead channel, an interferer and silence.
#[test]
fn the_command_line_names_a_dead_channel_an_interferer_and_silence() {
    let source = Source { amplitude: 400.0, ..Source::new(37.3, 20.0) };
    let frames = turns(360, |azimuth, random| {
        let mut frame = source.air(azimuth, random).codes();
        frame.codes[2] = [0; N];
        frame
    });
    let answers = lines(&frames, &[], "", &["--independent"]);
    assert!(answers.iter().all(|line| line["flags"] == serde_json::json!(["dead_3"])), "{}", answers[0]);
    assert!(answers.iter().all(|line| line["closure_chi2"].is_null() && line["coherence"].is_null()));
    assert!(rms(&errors_of(&answers, azimuth_of).0) <= 1.6 * source.bound_deg());

    let frames = turns(360, |azimuth, random| {
        let other = Wave { bins: 45.3, amplitude: 1265.0, ..source.wave(azimuth + 2.0, random) };
        source.air(azimuth, random).with_wave(other).codes()
    });
    let answers = lines(&frames, &[], "tone_hz = 14900\n", &["--independent"]);
    assert!(answers.iter().all(|line| line["flags"].as_array().unwrap().iter().any(|flag| flag == "interferer")));
    assert!(rms(&errors_of(&answers, azimuth_of).0) <= 0.25);

    let frames = turns(360, |_, random| Air::silence().with_noise(300.0, random).codes());
    let answers = lines(&frames, &[], "", &[]);
    let is_silent = |line: &Value| line["valid"] == false && line["azimuth_deg"].is_null();
    assert!(answers.iter().filter(|line| is_silent(line)).count() >= 359);
    assert_eq!(answers[0]["flags"], serde_json::json!(["no_signal"]));
}

/// `foxhound bearing` resolves a reflection over eight frames while moving.
#[test]
fn the_command_line_resolves_a_reflection_over_eight_looks() {
    for turning in [false, true] {
        let mut random = Random::new(18);
        let passages: Vec<Passage> = (0..250).map(|_| passage(turning, &mut random)).collect();
        let frames: Vec<_> = passages.iter().flat_map(|passage| passage.frames.clone()).collect();
        let yaws: Vec<f64> = passages.iter().flat_map(|passage| passage.yaws.clone()).collect();
        // A yaw that does not change need not be told.
        let yaws = if turning { &yaws[..] } else { &[] };
        let answers = lines(&frames, yaws, "", &["--looks", "8", "--independent"]);
        assert_eq!(answers.len(), 250);
        assert!(answers.iter().enumerate().all(|(group, line)| line["frame"] == 8 * group + 7));
        let unresolved = answers.iter().filter(|line| line["valid"] == false).count();
        assert_eq!(unresolved, 0);
        let error = |(line, passage): (&Value, &Passage)| {
            degrees_between(line["azimuth_deg"].as_f64().unwrap().to_radians(), passage.truth)
        };
        let errors: Vec<f64> = answers.iter().zip(&passages).map(error).collect();
        let (median, p90) = (quantile(&errors, 0.5), quantile(&errors, 0.9));
        assert!(median <= 1.0 && p90 <= 2.5, "turning {turning}: median {median}, p90 {p90}");
        let flagged = answers.iter().filter(|line| line["flags"].as_array().unwrap().iter().any(|f| f == "multipath"));
        assert!(flagged.count() >= 225);
    }
}
