//! The signals of the four antennas: a spherical wave, mixed down, noisy, sampled to 12 bits.
//!
//! The beacon radiates an *outgoing* wave: antenna `i` at distance `d_i` (main paper, eq. 49) receives `A_i cos(w t -
//! k d_i + phi)`, so that the antenna nearer the beacon leads in phase. (Eq. 48 as printed, `+k d_i + w t`, is a wave
//! that converges on the beacon; it would mirror every bearing.) Mixing to the intermediate frequency keeps the
//! phase: the four channels share one oscillator, whose phase is random from frame to frame.
//!
//! Signal-to-noise ratio is per sample, `A^2 / (2 sigma^2)`. Distances are three-dimensional, which includes sources
//! above or below; the array tilts and turns with the vehicle. Angles in rad, lengths in m, amplitudes in ADC units.
//!
//! The antennas receive equally from all directions unless they have a [`Pattern`].
//!
//! [`Impairments`] are the imperfections of reality. A reflection is a second source, the mirror image of the first:
//! it transmits at the same time, and its phase follows from its distance. Without gain control a loud tone clips.

use std::f64::consts::TAU;

use foxhound_core::base::adc::{AdcFrame, CHANNELS, CODE_MAX, CODE_MIN};
use foxhound_core::base::time::Instant;

use super::geometry::Pose;
use super::random::Random;
use crate::scenario;

/// The radio and its imperfections.
#[derive(Clone, Debug, PartialEq)]
pub struct Antennas {
    /// Wavelength of the carrier.
    pub wavelength_m: f64,
    /// Antenna positions, body frame, forward and right: front-right, front-left, back-left, back-right.
    pub positions_m: [[f64; 2]; CHANNELS],
    /// Sample rate of each channel.
    pub sample_rate_hz: f64,
    /// Intermediate frequency of the tone.
    pub tone_hz: f64,
    /// Amplitude, at any distance or at `fall_off_from_m`.
    pub amplitude_codes: f64,
    /// With a distance, the amplitude falls as 1/d, and `amplitude_codes` and `snr_db` are those at that distance.
    pub fall_off_from_m: Option<f64>,
    /// Signal-to-noise ratio per sample; `None` for no noise.
    pub snr_db: Option<f64>,
    /// Lowers the gain so that the tone and four sigmas of noise fit the converter, as a receiver's gain control does.
    pub gain_control: bool,
    /// Gain of each channel.
    pub channel_gain: [f64; CHANNELS],
    /// Phase shift of each channel.
    pub channel_phase_rad: [f64; CHANNELS],
    /// Offset of each channel.
    pub offset_codes: [f64; CHANNELS],
    /// Dependence of the antennas' gain on direction; `None` for none.
    pub pattern: Option<Pattern>,
    /// Other imperfections; none by default.
    pub impairments: Impairments,
}

/// Gain of directional antennas, in power: `((1 + cos d) / 2)^n + 10^(-F / 10)` at an angle `d` from the boresight.
/// The boresights are in the plane of the array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// `n`: 2 for a cardioid.
    pub exponent: f64,
    /// `F`: gain to the front relative to the back.
    pub front_to_back_db: f64,
    /// Direction of each antenna, from the nose, clockwise.
    pub boresights_rad: [f64; CHANNELS],
}

impl Pattern {
    /// Amplitude of a wave from a direction (NED, of any length), relative to one from boresight without the back
    /// lobe.
    fn amplitude(&self, channel: usize, vehicle: &Pose, towards_ned: [f64; 3]) -> f64 {
        let boresight_rad = self.boresights_rad[channel];
        let boresight_ned = vehicle.to_ned([libm::cos(boresight_rad), libm::sin(boresight_rad), 0.0]);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let length = libm::sqrt(dot(towards_ned, towards_ned)).max(1e-9);
        let lobe = (0.5 * (1.0 + dot(boresight_ned, towards_ned) / length)).max(0.0);
        libm::sqrt(libm::pow(lobe, self.exponent) + libm::pow(10.0, -self.front_to_back_db / 10.0))
    }
}

/// Imperfections beside one tone in white noise. The default has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Impairments {
    /// Each channel is sampled this much later than its time stamp.
    pub skew_s: [f64; CHANNELS],
    /// Broken channels.
    pub faults: [Fault; CHANNELS],
    /// Other transmitters.
    pub interferers: Vec<Interferer>,
    /// Power of the direct wave relative to a free one: below zero behind a wall.
    pub direct_level_db: f64,
    /// Reflections of the beacon.
    pub reflections: Vec<Reflection>,
    /// The beacon transmits in pulses.
    pub pulses: Option<Pulses>,
    /// Rate at which the tone's frequency rises; `tone_hz` is the frequency at time zero.
    pub drift_hz_per_s: f64,
    /// Correlation of the noise from sample to sample, -1..1: above zero it is louder at low frequencies, below zero
    /// at high ones. Its power is the same.
    pub noise_correlation: f64,
}

/// The fault of a channel. (One with noise but without a signal has a `channel_gain` of zero.)
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fault {
    /// No fault.
    #[default]
    None,
    /// All samples are zero.
    Dead,
    /// All samples have this value.
    Stuck(i16),
}

/// Another transmitter, far away, with an independent phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interferer {
    /// Its intermediate frequency.
    pub tone_hz: f64,
    /// Its azimuth: from north, clockwise.
    pub azimuth_ned_rad: f64,
    /// Its elevation above the horizon.
    pub elevation_rad: f64,
    /// Its power relative to the tone at `amplitude_codes`.
    pub level_db: f64,
}

impl Interferer {
    /// Unit vector towards it.
    fn towards_ned(&self) -> [f64; 3] {
        let level = libm::cos(self.elevation_rad);
        let (north, east) = (libm::cos(self.azimuth_ned_rad), libm::sin(self.azimuth_ned_rad));
        [level * north, level * east, -libm::sin(self.elevation_rad)]
    }
}

/// A reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflection {
    /// Position of the beacon's mirror image.
    pub image_ned_m: [f64; 3],
    /// The image's power relative to the beacon's, at the same distance.
    pub level_db: f64,
}

/// A beacon that transmits in pulses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulses {
    /// From the start of one pulse to that of the next.
    pub period_s: f64,
    /// Length of a pulse: the period times the duty cycle.
    pub length_s: f64,
    /// Start of a pulse.
    pub start_s: f64,
}

impl scenario::Pulses {
    /// The pulses for the antennas.
    #[must_use]
    pub const fn at_antennas(self) -> Pulses {
        Pulses { period_s: self.period_s, length_s: self.length_s, start_s: 0.0 }
    }
}

impl Pulses {
    /// Whether it transmits at a time.
    #[must_use]
    pub fn sounds(&self, time_s: f64) -> bool {
        let since = (time_s - self.start_s) / self.period_s;
        (since - libm::floor(since)) * self.period_s < self.length_s
    }
}

/// A wave at one antenna.
#[derive(Clone, Copy, Debug)]
struct Arrival {
    amplitude_codes: f64,
    /// At the first sample.
    phase_rad: f64,
    /// Phase per sample, at the first sample.
    step_rad: f64,
    /// Increase of the phase step per sample.
    bend_rad: f64,
}

/// Adds a wave to all channels, for the channels and samples for which `sounds` is true.
///
/// The channels are processed side by side: each is a chain of rotations, each of which waits for the one before, so
/// that four chains take hardly longer than one.
fn add_wave<const N: usize>(
    arrivals: &[Arrival; CHANNELS],
    rows: &mut [[f64; CHANNELS]; N],
    sounds: impl Fn(usize, usize) -> bool,
) {
    // One rotation per sample instead of a cosine: exact to 1e-13 over a frame.
    let mut re = arrivals.map(|wave| wave.amplitude_codes * libm::cos(wave.phase_rad));
    let mut im = arrivals.map(|wave| wave.amplitude_codes * libm::sin(wave.phase_rad));
    let (mut step_cos, mut step_sin) =
        (arrivals.map(|wave| libm::cos(wave.step_rad)), arrivals.map(|wave| libm::sin(wave.step_rad)));
    let (bend_cos, bend_sin) =
        (arrivals.map(|wave| libm::cos(wave.bend_rad)), arrivals.map(|wave| libm::sin(wave.bend_rad)));
    let is_straight = arrivals.iter().all(|wave| wave.bend_rad == 0.0);
    for (n, values) in rows.iter_mut().enumerate() {
        for (channel, value) in values.iter_mut().enumerate() {
            *value += if sounds(channel, n) { re[channel] } else { 0.0 };
        }
        (re, im) = turned((re, im), (step_cos, step_sin));
        if !is_straight {
            (step_cos, step_sin) = turned((step_cos, step_sin), (bend_cos, bend_sin));
        }
    }
}

type Phasors = ([f64; CHANNELS], [f64; CHANNELS]);

/// Products of complex numbers, channel by channel.
fn turned((re, im): Phasors, (cos, sin): Phasors) -> Phasors {
    (
        std::array::from_fn(|channel| re[channel] * cos[channel] - im[channel] * sin[channel]),
        std::array::from_fn(|channel| re[channel] * sin[channel] + im[channel] * cos[channel]),
    )
}

impl Default for Antennas {
    /// A square of 0.40 wavelengths at 868 MHz; the tone is on bin 37 of 256.
    fn default() -> Self {
        Self {
            wavelength_m: 0.345,
            positions_m: square(0.138),
            sample_rate_hz: 102_400.0,
            tone_hz: 14_800.0,
            amplitude_codes: 1500.0,
            fall_off_from_m: None,
            snr_db: Some(20.0),
            gain_control: true,
            channel_gain: [1.0; CHANNELS],
            channel_phase_rad: [0.0; CHANNELS],
            offset_codes: [0.0; CHANNELS],
            pattern: None,
            impairments: Impairments::default(),
        }
    }
}

/// The corners of a square array in the order of the main paper: front-right, front-left, back-left, back-right.
#[must_use]
pub fn square(side_m: f64) -> [[f64; 2]; CHANNELS] {
    let half = side_m / 2.0;
    [[half, half], [half, -half], [-half, -half], [-half, half]]
}

impl Antennas {
    /// One frame, its middle at `time`.
    #[must_use]
    pub fn frame<const N: usize>(
        &self,
        time: Instant,
        vehicle: &Pose,
        source_ned_m: [f64; 3],
        random: &mut Random,
    ) -> AdcFrame<N> {
        let impairments = &self.impairments;
        let mut snapshot = AdcFrame { time, codes: [[0; N]; CHANNELS] };
        let noise_codes =
            self.snr_db.map_or(0.0, |snr_db| self.amplitude_codes / libm::sqrt(2.0 * libm::pow(10.0, snr_db / 10.0)));
        let gain = self.gain(noise_codes);
        let common_phase_rad = TAU * random.uniform();
        let interferer_phases_rad: Vec<f64> = impairments.interferers.iter().map(|_| TAU * random.uniform()).collect();
        let colour = impairments.noise_correlation;
        let fresh = libm::sqrt(1.0 - colour * colour);

        let middle_s = time.0 as f64 * 1e-6;
        let middle_sample = (N as f64 - 1.0) / 2.0;
        let tone_hz = self.tone_hz + impairments.drift_hz_per_s * middle_s;
        let offsets_ned_m = vehicle.all_to_ned(self.positions_m.map(|[forward, right]| [forward, right, 0.0]));
        let skew_samples = impairments.skew_s.map(|skew_s| skew_s * self.sample_rate_hz);
        let arrival = |channel: usize, hz: f64, hz_per_s: f64, amplitude_codes: f64, phase_rad: f64| {
            let step_rad = TAU * hz / self.sample_rate_hz;
            let bend_rad = TAU * hz_per_s / (self.sample_rate_hz * self.sample_rate_hz);
            let first = skew_samples[channel] - middle_sample;
            Arrival {
                amplitude_codes: gain * amplitude_codes * self.channel_gain[channel],
                phase_rad: phase_rad + step_rad * first + 0.5 * bend_rad * first * first,
                step_rad: step_rad + bend_rad * (first + 0.5),
                bend_rad,
            }
        };

        // Sample by sample, all channels of each.
        let mut values = [[0.0; CHANNELS]; N];
        let beacon = [(source_ned_m, amplitude_ratio(impairments.direct_level_db))];
        let images = impairments.reflections.iter().map(|r| (r.image_ned_m, amplitude_ratio(r.level_db)));
        for (position_ned_m, level) in beacon.into_iter().chain(images) {
            let arrivals = std::array::from_fn(|channel| {
                let from_ned_m: [f64; 3] = std::array::from_fn(|axis| {
                    vehicle.position_ned_m[axis] + offsets_ned_m[channel][axis] - position_ned_m[axis]
                });
                let distance_m = libm::sqrt(from_ned_m.iter().map(|d| d * d).sum());
                let spread = self.fall_off_from_m.map_or(1.0, |reference_m| reference_m / distance_m.max(1e-3));
                let phase_rad =
                    common_phase_rad + self.channel_phase_rad[channel] - TAU * distance_m / self.wavelength_m;
                let amplitude_codes =
                    self.amplitude_codes * level * spread * self.lobe(channel, vehicle, from_ned_m.map(|d| -d));
                arrival(channel, tone_hz, impairments.drift_hz_per_s, amplitude_codes, phase_rad)
            });
            match impairments.pulses {
                None => add_wave(&arrivals, &mut values, |_, _| true),
                Some(pulses) => add_wave(&arrivals, &mut values, |channel, n| {
                    let since_middle = n as f64 + skew_samples[channel] - middle_sample;
                    pulses.sounds(middle_s + since_middle / self.sample_rate_hz)
                }),
            }
        }
        for (interferer, phase_rad) in impairments.interferers.iter().zip(&interferer_phases_rad) {
            let arrivals = std::array::from_fn(|channel| {
                let lead_rad = self.lead_rad(interferer, offsets_ned_m[channel]);
                let phase_rad = phase_rad + self.channel_phase_rad[channel] + lead_rad;
                let amplitude_codes = self.amplitude_codes
                    * amplitude_ratio(interferer.level_db)
                    * self.lobe(channel, vehicle, interferer.towards_ned());
                arrival(channel, interferer.tone_hz, 0.0, amplitude_codes, phase_rad)
            });
            add_wave(&arrivals, &mut values, |_, _| true);
        }

        for (channel, row) in snapshot.codes.iter_mut().enumerate() {
            let mut noise = [0.0; N];
            if noise_codes > 0.0 {
                random.fill_gaussian(gain * noise_codes, &mut noise);
            }
            if colour != 0.0 {
                for n in 1..N {
                    noise[n] = colour * noise[n - 1] + fresh * noise[n];
                }
            }
            for ((code, noise), values) in row.iter_mut().zip(noise).zip(&values) {
                *code = quantise(values[channel] + noise + self.offset_codes[channel]);
            }
            match impairments.faults[channel] {
                Fault::None => (),
                Fault::Dead => row.fill(0),
                Fault::Stuck(code) => row.fill(code),
            }
        }
        snapshot
    }

    /// Amplitude by the antenna's pattern.
    fn lobe(&self, channel: usize, vehicle: &Pose, towards_ned: [f64; 3]) -> f64 {
        self.pattern.map_or(1.0, |pattern| pattern.amplitude(channel, vehicle, towards_ned))
    }

    /// The receiver's gain.
    fn gain(&self, noise_codes: f64) -> f64 {
        let full_scale = f64::from(CODE_MAX);
        let others = self.impairments.interferers.iter().map(|i| i.level_db);
        let others = others.chain(self.impairments.reflections.iter().map(|r| r.level_db));
        let direct = amplitude_ratio(self.impairments.direct_level_db);
        let peak = self.amplitude_codes * (direct + others.map(amplitude_ratio).sum::<f64>()) + 4.0 * noise_codes;
        if self.gain_control && peak > full_scale { full_scale / peak } else { 1.0 }
    }

    /// How much an antenna leads the middle of the array in an interferer's plane wave.
    fn lead_rad(&self, interferer: &Interferer, [north, east, down]: [f64; 3]) -> f64 {
        let (sine, cosine) = (libm::sin(interferer.azimuth_ned_rad), libm::cos(interferer.azimuth_ned_rad));
        let level = libm::cos(interferer.elevation_rad);
        let towards = level * (north * cosine + east * sine) - libm::sin(interferer.elevation_rad) * down;
        TAU * towards / self.wavelength_m
    }
}

fn amplitude_ratio(level_db: f64) -> f64 {
    libm::pow(10.0, level_db / 20.0)
}

/// The nearest value of a 12-bit converter, with ties to even, clipped at its rails.
#[must_use]
pub fn quantise(value_codes: f64) -> i16 {
    // Adding this removes all fractions: it rounds without a call, and subtracting it again is exact.
    const NO_FRACTIONS: f64 = 1.5 * (1_u64 << 52) as f64;
    let within = value_codes.clamp(f64::from(CODE_MIN), f64::from(CODE_MAX));
    (within + NO_FRACTIONS - NO_FRACTIONS) as i16
}

#[cfg(test)]
mod tests;
