//! What the four antennas receive: a spherical wave, mixed down, noisy, sampled to 12-bit codes.
//!
//! The beacon radiates an *outgoing* wave: antenna `i` at distance `d_i` (main paper, eq. 49) sees
//! `A_i cos(w t - k d_i + phi)`, so that the antenna nearer the beacon leads in phase. (Eq. 48 as printed,
//! `+k d_i + w t`, is a wave that converges on the beacon; it would mirror every bearing.) Mixing to the intermediate
//! frequency keeps the phase: the four channels share one oscillator, whose phase is random from frame to frame.
//!
//! Signal-to-noise ratio is per sample, `A^2 / (2 sigma^2)`. Distances are three-dimensional, so that a source above or
//! below is heard as such; the array tilts and turns with the vehicle. Angles in rad, lengths in m, amplitudes in ADC
//! codes.
//!
//! The antennas hear the same all round unless they have a [`Pattern`].
//!
//! [`Impairments`] are what reality adds. A reflection is a second source, the mirror image of the first: it sounds at the
//! same time, and its phase follows from its distance. Without gain control a loud tone clips.

use std::f64::consts::TAU;

use foxhound_core::base::adc::{CHANNELS, CODE_MAX, CODE_MIN, Snapshot};
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
    /// With a distance, the amplitude falls as 1/d and `amplitude_codes` and `snr_db` hold at that distance.
    pub fall_off_from_m: Option<f64>,
    /// Signal-to-noise ratio per sample; `None` is a silent world without noise.
    pub snr_db: Option<f64>,
    /// Lowers the gain so that the tone and four sigmas of noise fit the converter, as a receiver's gain control does.
    pub gain_control: bool,
    /// Gain of each channel.
    pub channel_gain: [f64; CHANNELS],
    /// Phase shift of each channel.
    pub channel_phase_rad: [f64; CHANNELS],
    /// Offset of each channel.
    pub offset_codes: [f64; CHANNELS],
    /// How the antennas' gain depends on direction; `None`: not at all.
    pub pattern: Option<Pattern>,
    /// What else is wrong; nothing by default.
    pub impairments: Impairments,
}

/// Gain of directional antennas, in power: `((1 + cos d) / 2)^n + 10^(-F / 10)` in a direction that is off the boresight by
/// `d`. The boresights lie in the plane of the array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pattern {
    /// `n`: 2 for a cardioid.
    pub exponent: f64,
    /// `F`: gain to the front over that to the back.
    pub front_to_back_db: f64,
    /// Where each antenna points, from the nose, clockwise.
    pub boresights_rad: [f64; CHANNELS],
}

impl Pattern {
    /// Amplitude of a wave from a direction (NED, of any length), over that of one from boresight but for the back lobe.
    fn amplitude(&self, channel: usize, vehicle: &Pose, towards_ned: [f64; 3]) -> f64 {
        let boresight_rad = self.boresights_rad[channel];
        let boresight_ned = vehicle.to_ned([libm::cos(boresight_rad), libm::sin(boresight_rad), 0.0]);
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let length = libm::sqrt(dot(towards_ned, towards_ned)).max(1e-9);
        let lobe = (0.5 * (1.0 + dot(boresight_ned, towards_ned) / length)).max(0.0);
        libm::sqrt(libm::pow(lobe, self.exponent) + libm::pow(10.0, -self.front_to_back_db / 10.0))
    }
}

/// What reality adds to one tone in white noise. The default adds nothing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Impairments {
    /// Each channel is sampled that much later than its time stamp says.
    pub skew_s: [f64; CHANNELS],
    /// Broken channels.
    pub faults: [Fault; CHANNELS],
    /// Other transmitters.
    pub interferers: Vec<Interferer>,
    /// Power of the direct wave over that of a free one: below zero behind a wall.
    pub direct_level_db: f64,
    /// Reflections of the beacon.
    pub reflections: Vec<Reflection>,
    /// The beacon sounds in pulses.
    pub pulses: Option<Pulses>,
    /// Rate at which the tone's frequency rises; `tone_hz` holds at time zero.
    pub drift_hz_per_s: f64,
    /// Correlation of the noise from sample to sample, -1..1: above zero it is louder at low frequencies, below at high
    /// ones. Its power stays.
    pub noise_correlation: f64,
}

/// How a channel is broken. (One that still makes noise but hears nothing has a `channel_gain` of zero.)
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fault {
    /// It is not.
    #[default]
    None,
    /// All codes are zero.
    Dead,
    /// All codes are this one.
    Stuck(i16),
}

/// Another transmitter, far away, whose phase has nothing to do with ours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interferer {
    /// Its intermediate frequency.
    pub tone_hz: f64,
    /// Where it comes from: from north, clockwise.
    pub azimuth_ned_rad: f64,
    /// Where it comes from: above the horizon.
    pub elevation_rad: f64,
    /// Its power over that of the tone at `amplitude_codes`.
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
    /// Where the beacon's mirror image is.
    pub image_ned_m: [f64; 3],
    /// The image's power over the beacon's, at the same distance.
    pub level_db: f64,
}

/// A beacon that sounds now and then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulses {
    /// From the start of one pulse to that of the next.
    pub period_s: f64,
    /// Length of a pulse: the period times the duty.
    pub length_s: f64,
    /// Start of a pulse.
    pub start_s: f64,
}

impl scenario::Pulses {
    /// As the antennas have them.
    #[must_use]
    pub const fn at_antennas(self) -> Pulses {
        Pulses { period_s: self.period_s, length_s: self.length_s, start_s: 0.0 }
    }
}

impl Pulses {
    /// Whether it does at a time.
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
    /// Phase a sample, at the first sample.
    step_rad: f64,
    /// Growth of the phase a sample from sample to sample.
    bend_rad: f64,
}

/// Adds a wave to all channels, where `sounds` says so for a channel and a sample.
///
/// The channels go side by side: each is a chain of rotations, every one of which waits for the one before, so that four
/// chains take hardly longer than one.
fn add_wave<const N: usize>(
    arrivals: &[Arrival; CHANNELS],
    rows: &mut [[f64; CHANNELS]; N],
    sounds: impl Fn(usize, usize) -> bool,
) {
    // One rotation a sample instead of a cosine a sample: exact to 1e-13 over a frame.
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
    ) -> Snapshot<N> {
        let impairments = &self.impairments;
        let mut snapshot = Snapshot { time, codes: [[0; N]; CHANNELS] };
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

    /// By how much an antenna leads the middle of the array in an interferer's plane wave.
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

/// The nearest code of a 12-bit converter, even where two are as near, clipped at its rails.
#[must_use]
pub fn quantise(value_codes: f64) -> i16 {
    // Where this is added there are no fractions: it rounds without a call, and what is added comes off exactly.
    const NO_FRACTIONS: f64 = 1.5 * (1_u64 << 52) as f64;
    let within = value_codes.clamp(f64::from(CODE_MIN), f64::from(CODE_MAX));
    (within + NO_FRACTIONS - NO_FRACTIONS) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Phase and amplitude of the tone by correlation in `f64`, independent of the core.
    fn phasor(row: &[i16], cycles: f64) -> (f64, f64) {
        let n = row.len() as f64;
        let (mut re, mut im) = (0.0, 0.0);
        for (k, code) in row.iter().enumerate() {
            let angle = TAU * cycles * (k as f64 - (n - 1.0) / 2.0) / n;
            re += f64::from(*code) * angle.cos();
            im -= f64::from(*code) * angle.sin();
        }
        (im.atan2(re), 2.0 / n * re.hypot(im))
    }

    fn clean() -> Antennas {
        Antennas { snr_db: None, ..Antennas::default() }
    }

    fn phases(antennas: &Antennas, pose: &Pose, source: [f64; 3]) -> [f64; 4] {
        let frame = antennas.frame::<256>(Instant(0), pose, source, &mut Random::new(1, 1));
        frame.codes.each_ref().map(|row| phasor(row, 37.0).0)
    }

    fn ahead(phase: f64, of: f64) -> f64 {
        crate::world::wrap_pi(phase - of)
    }

    #[test]
    fn a_directional_antenna_hears_by_the_angle_off_its_boresight_whatever_the_attitude() {
        let boresights_rad = [0.0, 30.0, 90.0, 180.0].map(f64::to_radians);
        let pattern = Some(Pattern { exponent: 2.0, front_to_back_db: 15.0, boresights_rad });
        let all_round = clean();
        let directional = Antennas { pattern, ..clean() };
        for (yaw_deg, azimuth_deg) in [(0.0_f64, 0.0_f64), (50.0, 50.0), (200.0, -70.0), (-45.0, 135.0)] {
            // Far off, so that all antennas see the same direction.
            let azimuth_rad = azimuth_deg.to_radians();
            let source = [5000.0 * azimuth_rad.cos(), 5000.0 * azimuth_rad.sin(), 0.0];
            let pose = Pose { yaw_rad: yaw_deg.to_radians(), ..Pose::default() };
            let amplitudes = |antennas: &Antennas| {
                let frame = antennas.frame::<256>(Instant(0), &pose, source, &mut Random::new(1, 1));
                frame.codes.each_ref().map(|row| phasor(row, 37.0).1)
            };
            let (flat, lobed) = (amplitudes(&all_round), amplitudes(&directional));
            for channel in 0..CHANNELS {
                let off_rad = azimuth_rad - pose.yaw_rad - boresights_rad[channel];
                let expected_db = 10.0 * ((0.5 + 0.5 * off_rad.cos()).powi(2) + 10.0_f64.powf(-1.5)).log10();
                let heard_db = 20.0 * (lobed[channel] / flat[channel]).log10();
                assert!((heard_db - expected_db).abs() < 0.05, "{yaw_deg} {azimuth_deg} {channel}: {heard_db}");
            }
        }
        // Straight up is a right angle off whatever the yaw, unless the vehicle tilts.
        let up = |pose: Pose| {
            let frame = directional.frame::<256>(Instant(0), &pose, [0.0, 0.0, -5000.0], &mut Random::new(1, 1));
            20.0 * (phasor(&frame.codes[0], 37.0).1 / 1500.0).log10()
        };
        let level_db = 10.0 * (0.25 + 10.0_f64.powf(-1.5)).log10();
        assert!((up(Pose { yaw_rad: 1.0, ..Pose::default() }) - level_db).abs() < 0.05);
        assert!(up(Pose { pitch_rad: 0.5, ..Pose::default() }) > level_db + 2.0, "the nose is up");
    }

    #[test]
    fn the_antenna_nearer_the_source_leads_in_phase_whatever_the_yaw() {
        // The source is dead ahead of the nose: the front pair leads the back pair by k s, left and right agree.
        for yaw_deg in [0.0_f64, 90.0, 200.0, -45.0] {
            let yaw_rad = yaw_deg.to_radians();
            let pose = Pose { yaw_rad, ..Pose::default() };
            let source = [500.0 * yaw_rad.cos(), 500.0 * yaw_rad.sin(), 0.0];
            let [front_right, front_left, back_left, back_right] = phases(&clean(), &pose, source);
            let expected = TAU * 0.40;
            assert!((ahead(front_right, back_right) - expected).abs() < 1e-3, "yaw {yaw_deg}");
            assert!((ahead(front_left, back_left) - expected).abs() < 1e-3, "yaw {yaw_deg}");
            assert!(ahead(front_right, front_left).abs() < 1e-3, "yaw {yaw_deg}");
        }
        // To the right of the nose, the right pair leads.
        let [front_right, front_left, ..] = phases(&clean(), &Pose::default(), [0.0, 500.0, 0.0]);
        assert!((ahead(front_right, front_left) - TAU * 0.40).abs() < 1e-3);
    }

    #[test]
    fn rolling_the_right_side_down_brings_the_right_antennas_nearer_a_source_below() {
        let pose = Pose { roll_rad: 0.3, position_ned_m: [0.0, 0.0, -500.0], ..Pose::default() };
        let [front_right, front_left, ..] = phases(&clean(), &pose, [0.0, 0.0, 0.0]);
        assert!((ahead(front_right, front_left) - TAU * 0.40 * 0.3_f64.sin()).abs() < 1e-3);
    }

    #[test]
    fn pitching_the_nose_up_moves_the_front_antennas_up() {
        let pose = Pose { pitch_rad: 0.2, ..Pose::default() };
        assert!(pose.to_ned([1.0, 0.0, 0.0])[2] < -0.19);
        let turned = Pose { yaw_rad: 1.1, pitch_rad: 0.2, roll_rad: -0.4, ..Pose::default() };
        let norm: f64 = turned.to_ned([1.0, 2.0, 3.0]).iter().map(|x| x * x).sum();
        assert!((norm - 14.0).abs() < 1e-12, "a rotation keeps lengths");
    }

    #[test]
    fn the_noise_has_the_asked_signal_to_noise_ratio() {
        for snr_db in [0.0, 10.0, 20.0] {
            let antennas = Antennas { snr_db: Some(snr_db), ..Antennas::default() };
            let mut random = Random::new(5, 1);
            let (mut signal, mut noise) = (0.0, 0.0);
            for _ in 0..200 {
                let frame = antennas.frame::<256>(Instant(0), &Pose::default(), [7.0, 3.0, 1.0], &mut random);
                for row in &frame.codes {
                    let (phase, amplitude) = phasor(row, 37.0);
                    signal += 256.0 * amplitude * amplitude / 2.0;
                    for (k, code) in row.iter().enumerate() {
                        let tone = amplitude * (TAU * 37.0 * (k as f64 - 127.5) / 256.0 + phase).cos();
                        noise += (f64::from(*code) - tone).powi(2);
                    }
                }
            }
            let measured_db = 10.0 * (signal / noise).log10();
            assert!((measured_db - snr_db).abs() < 0.1, "{snr_db} dB asked, {measured_db} dB in the codes");
        }
    }

    #[test]
    fn amplitude_gain_mismatch_and_fall_off_arrive_in_the_codes() {
        let antennas = Antennas {
            channel_gain: [1.0, 0.5, 1.0, 1.0],
            channel_phase_rad: [0.0, 0.25, 0.0, 0.0],
            offset_codes: [0.0, 0.0, 40.0, 0.0],
            fall_off_from_m: Some(5.0),
            ..clean()
        };
        let source = [10.0, 0.0, 0.0];
        let frame = antennas.frame::<256>(Instant(0), &Pose::default(), source, &mut Random::new(1, 1));
        let amplitude = |channel: usize| phasor(&frame.codes[channel], 37.0).1;
        assert!((amplitude(0) - 750.0).abs() < 8.0, "{}", amplitude(0));
        assert!((amplitude(1) / amplitude(0) - 0.5).abs() < 1e-3);
        let mean = frame.codes[2].iter().map(|code| f64::from(*code)).sum::<f64>() / 256.0;
        assert!((mean - 40.0).abs() < 0.5);
        let [a1, a2, ..] = frame.codes.each_ref().map(|row| phasor(row, 37.0).0);
        assert!((ahead(a2, a1) - 0.25).abs() < 1e-3);
    }

    #[test]
    fn codes_are_rounded_to_nearest_and_clipped_at_the_rails() {
        assert_eq!([0.4, 0.6, -0.6, 1e9, -1e9].map(quantise), [0, 1, -1, 2047, -2048]);
        let mut random = Random::new(1, 1);
        let halves = (-5000..5000).map(|k| f64::from(k) * 0.5);
        for value in halves.chain((0..1000).map(|_| 5000.0 * (random.uniform() - 0.5))) {
            assert_eq!(f64::from(quantise(value)), value.round_ties_even().clamp(-2048.0, 2047.0), "{value}");
        }
        let loud = Antennas { amplitude_codes: 4000.0, gain_control: false, ..clean() };
        let frame = loud.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut Random::new(1, 1));
        assert!(frame.clip_count().iter().all(|clipped| *clipped > 100));
        let controlled = Antennas { gain_control: true, ..loud };
        let frame = controlled.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut Random::new(1, 1));
        assert!(frame.clip_count().iter().all(|clipped| *clipped < 5));
    }

    /// Frames of a source 500 m ahead of a vehicle that looks north.
    fn heard(impairments: Impairments, time: Instant) -> Snapshot<256> {
        let antennas = Antennas { impairments, amplitude_codes: 800.0, ..clean() };
        antennas.frame(time, &Pose::default(), [500.0, 0.0, 0.0], &mut Random::new(2, 1))
    }

    #[test]
    fn a_channel_sampled_later_is_further_in_phase() {
        let plain = heard(Impairments::default(), Instant(0)).codes.each_ref().map(|row| phasor(row, 37.0).0);
        let skew_s = [0.0, 3e-6, 0.0, -5e-6];
        let skewed = heard(Impairments { skew_s, ..Impairments::default() }, Instant(0));
        for (channel, row) in skewed.codes.iter().enumerate() {
            let expected = TAU * 14_800.0 * skew_s[channel];
            assert!((ahead(phasor(row, 37.0).0, plain[channel]) - expected).abs() < 2e-3, "channel {channel}");
        }
    }

    #[test]
    fn dead_and_stuck_channels_say_nothing_and_the_others_are_as_before() {
        let plain = heard(Impairments::default(), Instant(0));
        let faults = [Fault::None, Fault::Dead, Fault::Stuck(-77), Fault::None];
        let broken = heard(Impairments { faults, ..Impairments::default() }, Instant(0));
        assert_eq!(broken.codes, [plain.codes[0], [0; 256], [-77; 256], plain.codes[3]]);
    }

    #[test]
    fn an_interferer_comes_from_its_own_direction_at_its_own_level() {
        // From the right at bin 45, 6 dB down: the right pair leads, the front pair does not.
        let interferer =
            Interferer { tone_hz: 18_000.0, azimuth_ned_rad: TAU / 4.0, elevation_rad: 0.5, level_db: -6.0 };
        let frame = heard(Impairments { interferers: vec![interferer], ..Impairments::default() }, Instant(0));
        let [front_right, front_left, back_left, _] = frame.codes.each_ref().map(|row| phasor(row, 45.0));
        assert!((front_right.1 / 800.0 - 0.501).abs() < 2e-3, "{}", front_right.1 / 800.0);
        assert!((ahead(front_right.0, front_left.0) - TAU * 0.40 * 0.5_f64.cos()).abs() < 5e-3);
        assert!(ahead(front_left.0, back_left.0).abs() < 5e-3);
    }

    #[test]
    fn a_reflection_adds_the_image_with_the_phase_of_its_distance() {
        // The image stands half a wavelength, then a whole one, behind the source: it weakens, then strengthens.
        for (wavelengths, expected) in [(0.5, 0.5), (1.0, 1.5)] {
            let image_ned_m = [500.0 + wavelengths * 0.345, 0.0, 0.0];
            let reflections = vec![Reflection { image_ned_m, level_db: -6.0206 }];
            let frame = heard(Impairments { reflections, ..Impairments::default() }, Instant(0));
            for row in &frame.codes {
                assert!((phasor(row, 37.0).1 / 800.0 - expected).abs() < 2e-3, "{}", phasor(row, 37.0).1 / 800.0);
            }
        }
    }

    #[test]
    fn pulses_sound_for_their_length_once_a_period() {
        // 20 ms every second, the first at 0.3 s: a frame of 2.5 ms at 310 ms is full, one at 320 ms half, others empty.
        let pulses = Some(Pulses { period_s: 1.0, length_s: 0.020, start_s: 0.3 });
        let sounding = |time_us: u64| {
            let frame = heard(Impairments { pulses, ..Impairments::default() }, Instant(time_us));
            frame.codes[0].iter().filter(|code| **code != 0).count()
        };
        assert!(sounding(310_000) > 250 && sounding(7_310_000) > 250);
        assert!((120..=130).contains(&sounding(320_000)), "{}", sounding(320_000));
        assert_eq!((sounding(298_000), sounding(322_000), sounding(900_000)), (0, 0, 0));
    }

    #[test]
    fn the_frequency_drifts_with_time_and_within_the_frame() {
        // One bin is 400 Hz: at 10 s and 40 Hz/s the tone stands on bin 38.
        let drifting = Impairments { drift_hz_per_s: 40.0, ..Impairments::default() };
        let frame = heard(drifting, Instant(10_000_000));
        assert!((phasor(&frame.codes[0], 38.0).1 / 800.0 - 1.0).abs() < 2e-3);
        // A chirp of one bin in the frame, sample by sample; the same seed starts both frames with the same phase.
        let steady = heard(Impairments::default(), Instant(0));
        let chirped = heard(Impairments { drift_hz_per_s: 160_000.0, ..Impairments::default() }, Instant(0));
        let (phase, amplitude) = phasor(&steady.codes[0], 37.0);
        for (n, code) in chirped.codes[0].iter().enumerate() {
            let t = (n as f64 - 127.5) / 102_400.0;
            let expected = amplitude * (phase + TAU * (14_800.0 * t + 80_000.0 * t * t)).cos();
            assert!((f64::from(*code) - expected).abs() < 1.0, "sample {n}: {code} {expected}");
        }
    }

    #[test]
    fn coloured_noise_keeps_its_power_and_is_correlated() {
        for noise_correlation in [-0.5, 0.0, 0.8] {
            let impairments = Impairments { noise_correlation, ..Impairments::default() };
            let antennas = Antennas { snr_db: Some(0.0), channel_gain: [0.0; 4], impairments, ..Antennas::default() };
            let (mut power, mut product, mut random) = (0.0, 0.0, Random::new(7, 1));
            for _ in 0..100 {
                let frame = antennas.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut random);
                for pair in frame.codes.iter().flat_map(|row| row.windows(2)) {
                    power += f64::from(pair[0]) * f64::from(pair[0]);
                    product += f64::from(pair[0]) * f64::from(pair[1]);
                }
            }
            assert!((product / power - noise_correlation).abs() < 0.02, "{} {noise_correlation}", product / power);
            let gain = 2047.0 / (1500.0 + 4.0 * 1500.0 / 2.0_f64.sqrt());
            let expected = 102_000.0 * (gain * 1500.0).powi(2) / 2.0;
            assert!((power / expected - 1.0).abs() < 0.05, "{}", power / expected);
        }
    }
}
