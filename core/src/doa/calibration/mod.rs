//! Calibration: how the [`crate::doa::array::Table`] of the channels' gains and phases is measured, checked and stored, and
//! the airframe's deviation taken off.
//!
//! **Channels.** A source in a known direction, or a splitter, defines the phasors that the channels should have,
//! `a_m = e^{j k u . p_m}` or all equal. With `y_m = z_m / a_m`, every frame gives `y_m = c g_m + noise`: its own
//! amplitude and phase `c`, and the unknown gains `g_m`. Each frame has `c = sum g* y / sum |g|^2` and the weight
//! `|c|^2 / noise` in the weighted mean of `y / c`, updated frame by frame (B. P. Welford, Technometrics 4, 1962), so
//! that frames are weighted by their signal-to-noise ratio. The residual, `sum |y - c g|^2 / noise` with three
//! complex degrees of freedom per frame except the first, widens the standard deviation of the mean if it exceeds the
//! noise. One frame of 256 samples at 40 dB leaves 0.036 deg per channel, a tenth of the noise of a frame at 20 dB.
//!
//! **Order of the channels**: [`order`]. **Deviation**: [`deviation`]. **Storage**: [`record`].
//!
//! Frequencies: that of the tone in the converters' samples, and the carrier by its wavelength; see
//! [`crate::doa::array`].

pub mod deviation;
pub mod order;
pub mod record;

use crate::base::adc::CHANNELS;
use crate::base::math::sqrt;
use crate::base::units::{sin_cos, wrap_pi};
use crate::doa::array::{Array, Entry};
use crate::signal::phase::{Complex, Phasors, Tone};

/// A channel this much below the strongest, in power, is dead.
const DEAD_POWER_RATIO: f32 = 0.01;
/// A frame whose frequency differs more from the others', relative to it, does not belong to the same entry.
const SAME_FREQUENCY: f32 = 0.02;
/// Complex degrees of freedom of a frame: its channels without their common amplitude and phase.
const LOOK_FREEDOM: f32 = CHANNELS as f32 - 1.0;

/// The origin of the known signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Source {
    /// The same signal in all channels.
    Splitter,
    /// A source in a known direction.
    Direction {
        /// Azimuth from the nose, clockwise positive.
        azimuth_rad: f32,
        /// Elevation, up or down.
        elevation_rad: f32,
        /// Distance to the middle of the array, where the wavefront's curvature matters; `None` for a plane wave.
        range_m: Option<f32>,
    },
}

impl Source {
    /// A plane wave at our height.
    #[must_use]
    pub fn ahead_at(azimuth_rad: f32) -> Self {
        Self::Direction { azimuth_rad, elevation_rad: 0.0, range_m: None }
    }

    /// The phasors of the array for this source if all channels are equal, each of magnitude one.
    #[must_use]
    pub fn phasors(&self, array: &Array) -> [Complex; CHANNELS] {
        let Self::Direction { azimuth_rad, elevation_rad, range_m } = *self else {
            return [Complex { re: 1.0, im: 0.0 }; CHANNELS];
        };
        let (sine, cosine) = sin_cos(wrap_pi(azimuth_rad));
        let (_, level) = sin_cos(wrap_pi(elevation_rad));
        array.steering.map(|[x, y]| {
            let plane = level * (cosine * x + sine * y);
            let phase = match range_m {
                None => plane,
                // |r u - p| from r, multiplied out so that large distances do not cancel.
                Some(range_m) => {
                    let r = array.wavenumber * range_m;
                    let squared = x * x + y * y;
                    let distance = sqrt((r * r - 2.0 * r * plane + squared).max(0.0));
                    (2.0 * r * plane - squared) / (r + distance)
                }
            };
            Complex::at(phase)
        })
    }
}

/// Whether a frame was used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Taken {
    /// It was used.
    Yes,
    /// It has no tone.
    NoTone,
    /// A channel is clipped.
    Clipped,
    /// This channel, 0..4, is dead.
    Dead(usize),
    /// Its tone has another frequency than those of the frames before.
    OtherFrequency,
}

/// The weighted mean of frames, without the amplitude and phase of each.
#[derive(Clone, Copy, Debug, Default)]
struct Mean {
    gain: [Complex; CHANNELS],
    weight: f32,
    /// Residual of the gains, in units of the noise.
    scatter: f32,
    looks: u32,
}

impl Mean {
    /// Known, equal gains.
    const EQUAL: Self = Self { gain: [Complex { re: 1.0, im: 0.0 }; CHANNELS], weight: 0.0, scatter: 0.0, looks: 0 };

    /// Splits a frame into its own amplitude and the residual of the gains.
    fn split(&self, y: &[Complex; CHANNELS]) -> (Complex, [Complex; CHANNELS]) {
        let power: f32 = self.gain.iter().map(|g| g.norm_squared()).sum();
        let sum = y.iter().zip(self.gain).fold(Complex::default(), |sum, (y, g)| sum.plus(y.times_conj(g)));
        let scale = if power > 0.0 { 1.0 / power } else { 0.0 };
        let c = sum.scaled(scale);
        let rest = core::array::from_fn(|m| {
            let expected = c.times(self.gain[m]);
            Complex { re: y[m].re - expected.re, im: y[m].im - expected.im }
        });
        (c, rest)
    }

    /// Adds a frame to the mean.
    fn learn(&mut self, y: &[Complex; CHANNELS], noise: f32) {
        if self.looks == 0 {
            let power = 0.25 * y.iter().map(|y| y.norm_squared()).sum::<f32>();
            let scale = 1.0 / sqrt(power);
            *self = Self { gain: y.map(|y| y.scaled(scale)), weight: power / noise, scatter: 0.0, looks: 1 };
            return;
        }
        let (c, rest) = self.split(y);
        let before = self.weight;
        self.weight += c.norm_squared() / noise;
        for (gain, rest) in self.gain.iter_mut().zip(rest) {
            *gain = gain.plus(rest.times_conj(c).scaled(1.0 / (noise * self.weight)));
        }
        self.scatter += before / self.weight * rest.iter().map(|rest| rest.norm_squared()).sum::<f32>() / noise;
        self.looks += 1;
    }

    /// Compares a frame with the present gains.
    fn compare(&mut self, y: &[Complex; CHANNELS], noise: f32) {
        let (c, rest) = self.split(y);
        self.weight += c.norm_squared() / noise;
        self.scatter += rest.iter().map(|rest| rest.norm_squared()).sum::<f32>() / noise;
        self.looks += 1;
    }
}

/// Measures the channels at one frequency, frame by frame.
///
/// ```
/// # use foxhound_core::ConfigError;
/// use foxhound_core::base::time::Instant;
/// use foxhound_core::doa::array::Config;
/// use foxhound_core::doa::calibration::{Calibrator, Source, Taken};
/// use foxhound_core::signal::phase::{Complex, Phasors, Tone};
///
/// let array = Config::default().build()?;
/// // A splitter, and a third channel that is 0.5 rad late.
/// let mut z = [Complex { re: 1000.0, im: 0.0 }; 4];
/// z[2] = Complex { re: 1000.0 * libm::cosf(0.5), im: -1000.0 * libm::sinf(0.5) };
/// let phasors = Phasors {
///     time: Instant(0),
///     z,
///     noise: [1.0; 4],
///     snr_db: 60.0,
///     frequency_hz: 8000.0,
///     tone: Tone::Present,
///     clipped: false,
///     interferer: false,
/// };
/// let mut calibrator = Calibrator::default();
/// assert_eq!(calibrator.step(&array, Source::Splitter, &phasors), Taken::Yes);
/// let phase_rad = calibrator.entry(None).map(|entry| entry.phase_rad).unwrap_or_default();
/// assert!((phase_rad[2] - phase_rad[0] + 0.5).abs() < 1e-3, "{phase_rad:?}");
/// # Ok::<(), ConfigError>(())
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Calibrator {
    mean: Mean,
    frequency_hz: f32,
}

impl Calibrator {
    /// Adds a frame, given by the extractor's phasors. A refused frame changes nothing.
    pub fn step(&mut self, array: &Array, source: Source, phasors: &Phasors) -> Taken {
        let refused = usable(phasors);
        if refused != Taken::Yes {
            return refused;
        }
        let away_hz = libm::fabsf(phasors.frequency_hz - self.frequency_hz);
        if self.mean.looks > 0 && away_hz > SAME_FREQUENCY * self.frequency_hz {
            return Taken::OtherFrequency;
        }
        let expected = source.phasors(array);
        let y = core::array::from_fn(|m| phasors.z[m].times_conj(expected[m]));
        let before = self.mean.weight;
        self.mean.learn(&y, mean_noise(phasors));
        self.frequency_hz += (phasors.frequency_hz - self.frequency_hz) * (1.0 - before / self.mean.weight);
        Taken::Yes
    }

    /// The gains and phases from all frames, with their accuracy; `None` before the first.
    #[must_use]
    pub fn entry(&self, temperature_c: Option<f32>) -> Option<Entry> {
        let mean = &self.mean;
        if mean.looks == 0 {
            return None;
        }
        let magnitude = mean.gain.map(|g| sqrt(g.norm_squared()));
        let scale = CHANNELS as f32 / magnitude.iter().sum::<f32>();
        let gain = magnitude.map(|magnitude| magnitude * scale);
        let sum = mean.gain.iter().fold(Complex::default(), |sum, g| sum.plus(*g));
        // Channels that cancel each other have no common phase: then the first one's is used.
        let common = if sum.norm_squared() > 0.01 { sum } else { mean.gain[0] };
        let phase_rad = mean.gain.map(|g| g.times_conj(common).arg());
        let freedom = LOOK_FREEDOM * (mean.looks - 1) as f32;
        let widening = if freedom > 0.0 { (mean.scatter / freedom).max(1.0) } else { 1.0 };
        // A weak channel's phase is less certain.
        let weakness = gain.iter().map(|gain| 1.0 / (gain * gain)).sum::<f32>() / CHANNELS as f32;
        let residual_rad = sqrt(0.5 * widening * weakness / mean.weight);
        Some(Entry { frequency_hz: self.frequency_hz, gain, phase_rad, residual_rad, temperature_c })
    }
}

/// Mean variance of the phasors.
fn mean_noise(phasors: &Phasors) -> f32 {
    (0.25 * phasors.noise.iter().sum::<f32>()).max(1e-12)
}

/// Whether all four channels of a frame can be used.
fn usable(phasors: &Phasors) -> Taken {
    if phasors.tone == Tone::Absent {
        return Taken::NoTone;
    }
    if phasors.clipped {
        return Taken::Clipped;
    }
    let powers = phasors.z.map(Complex::norm_squared);
    let strongest = powers.iter().fold(0.0_f32, |a, b| if *b > a { *b } else { a });
    let lives = |m: usize| powers[m] > DEAD_POWER_RATIO * strongest && powers[m] > 2.0 * phasors.noise[m];
    (0..CHANNELS).find(|m| !lives(*m)).map_or(Taken::Yes, Taken::Dead)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::base::adc::AdcFrame;
    use crate::base::rng::Rng;
    use crate::base::time::Instant;
    use crate::doa::array::{self, Table};
    use crate::doa::bearing;
    use crate::signal::phase;
    use std::f64::consts::{PI, TAU};
    use std::vec::Vec;

    const N: usize = 256;
    /// Of the tone.
    const BINS: f64 = 37.3;
    const SIDE: f64 = 0.40;

    /// A receiver of four different channels, before a source on the horizon.
    #[derive(Clone, Copy)]
    pub(crate) struct Receiver {
        pub(crate) gain: [f64; 4],
        pub(crate) phase_rad: [f64; 4],
        pub(crate) snr_db: f64,
    }

    impl Receiver {
        pub(crate) const IDEAL: Self = Self { gain: [1.0; 4], phase_rad: [0.0; 4], snr_db: 20.0 };

        /// 3 dB and tens of degrees; the noise of all channels is the same.
        fn uneven() -> Self {
            let phase_rad = [0.0, 47.0, -31.0, 68.0].map(f64::to_radians);
            Self { gain: [1.0, 0.708, 1.0, 0.85], phase_rad, ..Self::IDEAL }
        }

        /// The frame of a source in a direction, or on a splitter, in f64 and 12-bit codes.
        pub(crate) fn frame(&self, azimuth: Option<f64>, rng: &mut Rng) -> AdcFrame<N> {
            let ratio = (2.0 * 10_f64.powf(self.snr_db / 10.0)).sqrt();
            let sigma = 1800.0 / (ratio + 4.0);
            let start = TAU * f64::from(rng.uniform());
            let mut frame = AdcFrame::zeroed();
            frame.time = Instant(0);
            let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)];
            for (m, row) in frame.codes.iter_mut().enumerate() {
                let (x, y) = corners[m];
                let wave = azimuth.map_or(0.0, |a| PI * SIDE * (x * a.cos() + y * a.sin()));
                for (n, code) in row.iter_mut().enumerate() {
                    let t = n as f64 - (N as f64 - 1.0) / 2.0;
                    let phase = TAU * BINS / N as f64 * t + start + wave + self.phase_rad[m];
                    let value = ratio * sigma * self.gain[m] * phase.cos() + sigma * f64::from(rng.gaussian());
                    *code = value.round().clamp(-2048.0, 2047.0) as i16;
                }
            }
            frame
        }

        pub(crate) fn phasors(&self, azimuth: Option<f64>, rng: &mut Rng) -> Phasors {
            let extractor = phase::Config::default().build::<N>().unwrap();
            extractor.step(&mut phase::State::default(), &self.frame(azimuth, rng))
        }

        fn at_snr(self, snr_db: f64) -> Self {
            Self { snr_db, ..self }
        }
    }

    pub(crate) fn square() -> array::Config {
        array::Config::default()
    }

    fn array() -> Array {
        square().build().unwrap()
    }

    fn entry(receiver: &Receiver, frames: usize, azimuth: Option<f64>, rng: &mut Rng) -> Entry {
        let mut calibrator = Calibrator::default();
        let source = azimuth.map_or(Source::Splitter, |azimuth| Source::ahead_at(azimuth as f32));
        for _ in 0..frames {
            assert_eq!(calibrator.step(&array(), source, &receiver.phasors(azimuth, rng)), Taken::Yes);
        }
        calibrator.entry(None).unwrap()
    }

    pub(crate) fn error_rad(found: f32, truth: f64) -> f64 {
        let difference = f64::from(found) - truth;
        difference.sin().atan2(difference.cos())
    }

    /// Errors of the entry's phases, without the common one.
    fn phase_errors(entry: &Entry, receiver: &Receiver) -> [f64; 4] {
        let errors: [f64; 4] = core::array::from_fn(|m| error_rad(entry.phase_rad[m], receiver.phase_rad[m]));
        let first = errors[0];
        let errors = errors.map(|error| (error - first).sin().atan2((error - first).cos()));
        let mean = errors.iter().sum::<f64>() / 4.0;
        errors.map(|error| error - mean)
    }

    fn bound(snr_db: f64) -> f64 {
        1.0 / (TAU * SIDE * (N as f64 * 10_f64.powf(snr_db / 10.0)).sqrt())
    }

    /// rms over 360 azimuths x 8, in units of the bound, each group of eight azimuths' calibration made anew.
    fn rms_over_bound(receiver: &Receiver, snr_db: f64, frames: usize, seed: u64) -> f64 {
        let mut rng = Rng::new(seed, 1);
        let mut squares = 0.0;
        for round in 0..8 {
            let known = Some(f64::from(round) * 0.77);
            let table = Table::new(0.345, &[entry(&receiver.at_snr(40.0), frames, known, &mut rng)]).unwrap();
            let config = array::Config { calibration: Some(table), require_calibration: true, ..square() };
            let estimator = bearing::Config::default().build(config.build().unwrap()).unwrap();
            for degree in 0..360 {
                let truth = f64::from(degree).to_radians();
                let bearing = estimator.estimate(&receiver.at_snr(snr_db).phasors(Some(truth), &mut rng));
                assert!(bearing.valid, "{degree}: {bearing:?}");
                squares += error_rad(bearing.azimuth_rad, truth).powi(2);
            }
        }
        (squares / 2880.0).sqrt() / bound(snr_db)
    }

    #[test]
    fn one_frame_at_40_db_calibrates_channels_tens_of_degrees_and_3_db_apart() {
        let receiver = Receiver::uneven();
        let at_20_db = rms_over_bound(&receiver, 20.0, 1, 1);
        assert!(at_20_db <= 1.30, "{at_20_db} of the bound at 20 dB");
        // The bound of these channels themselves, two of which are weak, is 1.15 of that of equal ones: reached at 20
        // dB. At 30 dB one frame's own noise, a third of the other's, begins to show (1.23); 16 frames remove it
        // (1.15).
        let at_30_db = rms_over_bound(&receiver, 30.0, 1, 2);
        assert!(at_30_db <= 1.30, "{at_30_db} of the bound at 30 dB");
        let averaged = rms_over_bound(&receiver, 30.0, 16, 3);
        assert!(averaged <= 1.20 && averaged < at_30_db, "{averaged} of the bound at 30 dB after 16 frames");
    }

    #[test]
    fn the_residual_is_the_error_that_is_left() {
        for (snr_db, frames) in [(40.0, 1), (20.0, 1), (20.0, 10)] {
            let receiver = Receiver::uneven().at_snr(snr_db);
            let mut rng = Rng::new(6, frames as u64);
            let (mut errors, mut said) = (0.0, 0.0);
            for _ in 0..200 {
                let entry = entry(&receiver, frames, None, &mut rng);
                // Three degrees of freedom: the common phase does not count.
                errors += phase_errors(&entry, &receiver).iter().map(|error| error * error).sum::<f64>() / 3.0;
                said += f64::from(entry.residual_rad).powi(2);
                for (gain, truth) in entry.gain.iter().zip(receiver.gain) {
                    assert!((f64::from(*gain) - truth / 0.8895).abs() < 0.03, "{gain}");
                }
            }
            let ratio = errors / said;
            assert!((0.8..1.25).contains(&ratio), "{snr_db} dB, {frames} frames: {ratio}");
        }
    }

    #[test]
    fn looks_that_disagree_by_more_than_their_noise_widen_the_residual() {
        let mut rng = Rng::new(7, 1);
        let mut calibrator = Calibrator::default();
        for k in 0..20 {
            // The true direction differs from the assumed one, by 3 deg rms.
            let truth = 0.05 * f64::from(rng.gaussian());
            let phasors = Receiver::uneven().at_snr(40.0).phasors(Some(truth), &mut rng);
            assert_eq!(calibrator.step(&array(), Source::ahead_at(0.0), &phasors), Taken::Yes, "{k}");
        }
        let residual_rad = calibrator.entry(None).unwrap().residual_rad;
        // 0.05 rad of direction are 0.063 of phase, over the root of 20.
        assert!((0.007..0.02).contains(&residual_rad), "{residual_rad}");
    }

    #[test]
    fn a_weak_look_counts_for_little() {
        let mut rng = Rng::new(8, 1);
        let receiver = Receiver::uneven();
        let mut calibrator = Calibrator::default();
        calibrator.step(&array(), Source::Splitter, &receiver.at_snr(0.0).phasors(None, &mut rng));
        calibrator.step(&array(), Source::Splitter, &receiver.at_snr(40.0).phasors(None, &mut rng));
        calibrator.step(&array(), Source::Splitter, &receiver.at_snr(0.0).phasors(None, &mut rng));
        let errors = phase_errors(&calibrator.entry(None).unwrap(), &receiver);
        assert!(errors.iter().all(|error| error.to_degrees().abs() < 0.25), "{errors:?}");
    }

    #[test]
    fn frames_that_tell_nothing_are_refused_and_named() {
        let mut rng = Rng::new(9, 1);
        let phasors = Receiver::IDEAL.phasors(None, &mut rng);
        let mut calibrator = Calibrator::default();
        let mut step = |phasors: Phasors| calibrator.step(&array(), Source::Splitter, &phasors);
        assert_eq!(step(Phasors { tone: Tone::Absent, ..phasors }), Taken::NoTone);
        assert_eq!(step(Phasors { clipped: true, ..phasors }), Taken::Clipped);
        let mut dead = phasors;
        dead.z[2] = Complex::default();
        assert_eq!(step(dead), Taken::Dead(2));
        assert_eq!(step(phasors), Taken::Yes);
        assert_eq!(step(Phasors { frequency_hz: phasors.frequency_hz * 1.05, ..phasors }), Taken::OtherFrequency);
        assert_eq!(calibrator.mean.looks, 1);
        assert!(Calibrator::default().entry(None).is_none());
    }

    #[test]
    fn elevation_and_range_are_taken_from_the_known_direction() {
        // Distances in f64, from the definition.
        let config = square();
        let (azimuth, elevation, k) = (1.1_f64, 0.6_f64, TAU / 0.345);
        for range in [0.7, 5.0, 3000.0_f64] {
            let source =
                [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()].map(|u| range * u);
            let truth: Vec<f64> = config
                .antennas_m
                .iter()
                .map(|p| {
                    let (x, y) = (source[0] - f64::from(p[0]), source[1] - f64::from(p[1]));
                    k * (range - (x * x + y * y + source[2] * source[2]).sqrt())
                })
                .collect();
            let known = Source::Direction {
                azimuth_rad: azimuth as f32,
                elevation_rad: elevation as f32,
                range_m: Some(range as f32),
            };
            for (z, truth) in known.phasors(&array()).iter().zip(&truth) {
                assert!(error_rad(z.arg(), *truth).abs() < 1e-4, "{range} m");
            }
            let plane =
                Source::Direction { azimuth_rad: azimuth as f32, elevation_rad: elevation as f32, range_m: None };
            let worst = plane
                .phasors(&array())
                .iter()
                .zip(&truth)
                .map(|(z, t)| error_rad(z.arg(), *t).abs())
                .fold(0.0, f64::max);
            assert_eq!(worst < 1e-3, range > 100.0, "{range} m: {worst}");
        }
    }
}
