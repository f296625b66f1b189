//! Measurements in whole numbers: the formatting of floats takes too much flash.

use foxhound_core::base::adc::CHANNELS;
use foxhound_link::companion::Exam;

use super::Verdict;

/// One test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Kind of the test.
    pub exam: Exam,
    /// Its result.
    pub verdict: Verdict,
    /// Frames used.
    pub frames: u16,
    /// The tone's frequency in the samples; zero without one.
    pub frequency_hz: i32,
    /// The tone over the noise, per sample.
    pub snr_centi_db: i32,
    /// The sample rate by the clock of the time stamps, relative to the configured one.
    pub rate_off_ppm: i32,
    /// Remaining standard deviation of a channel's phase after a calibration from this.
    pub residual_mdeg: i32,
    /// Channel by channel.
    pub channels: [Reading; CHANNELS],
}

/// One channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// Mean of the samples.
    pub offset_centi_codes: i32,
    /// Samples at a rail, per million.
    pub clipped_ppm: i32,
    /// Noise floor, rms.
    pub noise_centi_codes: i32,
    /// The same relative to the loudest sine that fits.
    pub noise_centi_dbfs: i32,
    /// The tone.
    pub amplitude_centi_codes: i32,
    /// Its amplitude relative to the channels' mean.
    pub gain_centi_db: i32,
    /// Its phase relative to the channels' common one; with a known source, minus that of its direction.
    pub phase_mdeg: i32,
    /// Standard deviation of that from frame to frame.
    pub phase_sigma_mdeg: i32,
}
