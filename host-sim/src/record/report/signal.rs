//! What the antennas heard: the spectrum of a frame, and the tone's amplitudes and phases.
//!
//! The tone is found by the same extractor as in guidance, which runs here a second time and only on the recorded
//! frames. So it may find a tone some frames earlier or later than guidance did.

use std::fmt;
use std::sync::Arc;

use foxhound_core::base::adc::{AdcFrame, CHANNELS, CODE_MAX};
use foxhound_core::guidance;
use foxhound_core::signal::phase::{self, Extractor};
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use super::record::{Signal, Tone, rounded};
use crate::drive::computer::BLOCK;

/// Bins of the recorded spectrum, each of which holds some of the transform's.
const BINS: usize = 64;
const PER_BIN: usize = BLOCK / 2 / BINS;
/// Least power that is shown.
const FLOOR_DB: f64 = -120.0;

/// Width of a recorded bin.
pub(super) fn bin_hz(config: &guidance::Config) -> f64 {
    f64::from(config.phase.sample_rate_hz) / (2.0 * BINS as f64)
}

/// Makes the records of what is heard.
pub(super) struct Signals {
    extractor: Option<Extractor<BLOCK>>,
    state: phase::State<BLOCK>,
    transform: Arc<dyn Fft<f32>>,
    /// Hann's window.
    window: Vec<f32>,
}

impl fmt::Debug for Signals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Signals").field("extractor", &self.extractor).finish_non_exhaustive()
    }
}

impl Signals {
    pub(super) fn new(config: &guidance::Config) -> Self {
        let turn = std::f64::consts::TAU / BLOCK as f64;
        Self {
            extractor: config.phase.build().ok(),
            state: phase::State::default(),
            transform: FftPlanner::new().plan_fft_forward(BLOCK),
            window: (0..BLOCK).map(|sample| (0.5 - 0.5 * libm::cos(turn * sample as f64)) as f32).collect(),
        }
    }

    /// The record of a frame.
    pub(super) fn signal(&mut self, time_s: f64, frame: &AdcFrame<BLOCK>) -> Signal {
        Signal { time_s, tone: self.tone(frame), spectrum_db: self.spectrum_db(frame) }
    }

    fn tone(&mut self, frame: &AdcFrame<BLOCK>) -> Option<Tone> {
        let phasors = self.extractor.as_ref()?.step(&mut self.state, frame);
        if phasors.tone == phase::Tone::Absent {
            return None;
        }
        let polar = phasors.z.map(|z| (libm::hypotf(z.re, z.im), f64::from(libm::atan2f(z.im, z.re)).to_degrees()));
        let phase_deg = |deg: f64| libm::remainder(deg - polar[0].1, 360.0);
        Some(Tone {
            frequency_hz: rounded(f64::from(phasors.frequency_hz), 0),
            amplitudes: polar.map(|(amplitude, _)| rounded(f64::from(amplitude), 0)),
            phases_deg: polar.map(|(_, deg)| rounded(phase_deg(deg), 1)),
        })
    }

    fn spectrum_db(&self, frame: &AdcFrame<BLOCK>) -> Vec<i32> {
        let mut power = [0.0_f64; BINS];
        for codes in &frame.codes {
            let mean = codes.iter().map(|code| f32::from(*code)).sum::<f32>() / BLOCK as f32;
            let mut values: Vec<Complex32> = codes
                .iter()
                .zip(&self.window)
                .map(|(code, weight)| Complex32::new((f32::from(*code) - mean) * weight, 0.0))
                .collect();
            self.transform.process(&mut values);
            for (bin, sum) in power.iter_mut().enumerate() {
                let part = values.get(bin * PER_BIN..(bin + 1) * PER_BIN).unwrap_or_default();
                *sum += part.iter().map(|value| f64::from(value.norm_sqr())).sum::<f64>();
            }
        }
        // All of a sine's power through Hann's window: N A^2 / 4 times the sum of the squared weights, 3 N / 8.
        let full = f64::from(CODE_MAX) * f64::from(CODE_MAX) * (BLOCK * BLOCK) as f64 * 3.0 / 32.0;
        let db = |sum: f64| (10.0 * libm::log10(sum / (CHANNELS as f64 * full))).max(FLOOR_DB);
        power.map(|sum| libm::rint(db(sum)) as i32).to_vec()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn a_tone_is_in_the_bin_of_its_frequency_with_its_power_and_its_phases() {
        let config = guidance::Config::default();
        let mut signals = Signals::new(&config);
        let (hz, amplitude, phases_deg) = (20_100.0, 1000.0, [10.0, 50.0, -60.0, 170.0_f64]);
        let mut frame = AdcFrame::zeroed();
        for (row, deg) in frame.codes.iter_mut().zip(phases_deg) {
            for (sample, code) in row.iter_mut().enumerate() {
                let turns = hz * sample as f64 / f64::from(config.phase.sample_rate_hz);
                *code = libm::rint(amplitude * libm::cos(TAU * turns + deg.to_radians())) as i16;
            }
        }
        let signal = signals.signal(0.0, &frame);
        let loudest = signal.spectrum_db.iter().enumerate().max_by_key(|(_, db)| **db).unwrap();
        assert_eq!(loudest.0, (hz / bin_hz(&config)) as usize);
        let expected_db = 20.0 * (amplitude / f64::from(CODE_MAX)).log10();
        assert!((f64::from(*loudest.1) - expected_db).abs() < 2.0, "{} for {expected_db}", loudest.1);
        let tone = signal.tone.unwrap();
        assert!((tone.frequency_hz - hz).abs() < 5.0, "{}", tone.frequency_hz);
        for (antenna, deg) in phases_deg.into_iter().enumerate() {
            let off_deg = libm::remainder(tone.phases_deg[antenna] - (deg - phases_deg[0]), 360.0);
            assert!(off_deg.abs() < 0.5, "antenna {antenna}: {off_deg} deg");
            assert!((tone.amplitudes[antenna] - amplitude).abs() < 10.0, "{}", tone.amplitudes[antenna]);
        }
    }

    #[test]
    fn silence_has_no_tone_and_the_lowest_power() {
        let signal = Signals::new(&guidance::Config::default()).signal(1.0, &AdcFrame::zeroed());
        assert_eq!((signal.tone, signal.spectrum_db), (None, vec![FLOOR_DB as i32; BINS]));
    }
}
