//! What the four antennas receive: a spherical wave, mixed down, noisy, sampled to 12-bit codes.
//!
//! The beacon radiates an *outgoing* wave: antenna `i` at distance `d_i` (main paper, eq. 49) sees
//! `A_i cos(w t - k d_i + phi)`, so that the antenna nearer the beacon leads in phase. (Eq. 48 as printed,
//! `+k d_i + w t`, is a wave that converges on the beacon; it would mirror every bearing.) Mixing to the intermediate
//! frequency keeps the phase: the four channels share one oscillator, whose phase is random from frame to frame.
//!
//! Signal-to-noise ratio is per sample, `A^2 / (2 sigma^2)`. Distances are three-dimensional; the array tilts and turns
//! with the vehicle. Angles in rad, lengths in m, amplitudes in ADC codes.

use std::f64::consts::TAU;

use foxhound_core::adc::{CHANNELS, CODE_MAX, CODE_MIN, Snapshot};
use foxhound_core::time::Instant;

use crate::random::Random;

/// Where the vehicle is and how it is turned.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position, NED, metres.
    pub position_ned_m: [f64; 3],
    /// Roll, right side down positive.
    pub roll_rad: f64,
    /// Pitch, nose up positive.
    pub pitch_rad: f64,
    /// Yaw from north, clockwise positive.
    pub yaw_rad: f64,
}

impl Pose {
    /// Rotates a body vector (forward, right, down) into NED: yaw, pitch, roll in the order of aviation (ZYX).
    #[must_use]
    pub fn to_ned(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (sr, cr) = (libm::sin(self.roll_rad), libm::cos(self.roll_rad));
        let (sp, cp) = (libm::sin(self.pitch_rad), libm::cos(self.pitch_rad));
        let (sy, cy) = (libm::sin(self.yaw_rad), libm::cos(self.yaw_rad));
        let (y, z) = (cr * y - sr * z, sr * y + cr * z);
        let (x, z) = (cp * x + sp * z, cp * z - sp * x);
        [cy * x - sy * y, sy * x + cy * y, z]
    }
}

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
        let mut snapshot = Snapshot { time, codes: [[0; N]; CHANNELS] };
        let noise_codes =
            self.snr_db.map_or(0.0, |snr_db| self.amplitude_codes / libm::sqrt(2.0 * libm::pow(10.0, snr_db / 10.0)));
        let full_scale = f64::from(CODE_MAX);
        let peak = self.amplitude_codes + 4.0 * noise_codes;
        let gain = if self.gain_control && peak > full_scale { full_scale / peak } else { 1.0 };
        let common_phase_rad = TAU * random.uniform();
        let step_rad = TAU * self.tone_hz / self.sample_rate_hz;
        let (step_sin, step_cos) = (libm::sin(step_rad), libm::cos(step_rad));
        for (channel, row) in snapshot.codes.iter_mut().enumerate() {
            let [forward, right] = self.positions_m[channel];
            let offset = vehicle.to_ned([forward, right, 0.0]);
            let distance_m = libm::sqrt(
                (0..3)
                    .map(|axis| vehicle.position_ned_m[axis] + offset[axis] - source_ned_m[axis])
                    .map(|d| d * d)
                    .sum(),
            );
            let spread = self.fall_off_from_m.map_or(1.0, |reference_m| reference_m / distance_m.max(1e-3));
            let amplitude = gain * self.amplitude_codes * self.channel_gain[channel] * spread;
            let phase_rad = common_phase_rad + self.channel_phase_rad[channel]
                - TAU * distance_m / self.wavelength_m
                - step_rad * (N as f64 - 1.0) / 2.0;
            // One rotation a sample instead of a cosine a sample: exact to 1e-13 over a frame.
            let (mut re, mut im) = (amplitude * libm::cos(phase_rad), amplitude * libm::sin(phase_rad));
            for code in row.iter_mut() {
                let noise = if noise_codes > 0.0 { gain * noise_codes * random.gaussian() } else { 0.0 };
                *code = quantise(re + noise + self.offset_codes[channel]);
                (re, im) = (re * step_cos - im * step_sin, re * step_sin + im * step_cos);
            }
        }
        snapshot
    }
}

/// The nearest code of a 12-bit converter, clipped at its rails.
#[must_use]
pub fn quantise(value_codes: f64) -> i16 {
    libm::rint(value_codes).clamp(f64::from(CODE_MIN), f64::from(CODE_MAX)) as i16
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
        let loud = Antennas { amplitude_codes: 4000.0, gain_control: false, ..clean() };
        let frame = loud.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut Random::new(1, 1));
        assert!(frame.clip_count().iter().all(|clipped| *clipped > 100));
        let controlled = Antennas { gain_control: true, ..loud };
        let frame = controlled.frame::<256>(Instant(0), &Pose::default(), [9.0, 0.0, 0.0], &mut Random::new(1, 1));
        assert!(frame.clip_count().iter().all(|clipped| *clipped < 5));
    }
}
