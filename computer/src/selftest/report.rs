//! What was measured, in whole numbers: to write floats takes more flash than there is.

use foxhound_core::base::adc::CHANNELS;
use foxhound_link::companion::Exam;

use super::Verdict;

/// One examination.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Which one.
    pub exam: Exam,
    /// What it came to.
    pub verdict: Verdict,
    /// Frames listened to.
    pub frames: u16,
    /// The tone's frequency in the samples; zero where there was none.
    pub frequency_hz: i32,
    /// The tone over the noise, per sample.
    pub snr_centi_db: i32,
    /// The sample rate by the clock of the time stamps, over the configured one.
    pub rate_off_ppm: i32,
    /// Standard deviation of a channel's phase that a calibration from this leaves.
    pub residual_mdeg: i32,
    /// Channel by channel.
    pub channels: [Reading; CHANNELS],
}

/// One channel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// Mean of the codes.
    pub offset_centi_codes: i32,
    /// Codes at a rail, of a million.
    pub clipped_ppm: i32,
    /// Noise floor, rms.
    pub noise_centi_codes: i32,
    /// The same below the loudest sine that fits.
    pub noise_centi_dbfs: i32,
    /// The tone.
    pub amplitude_centi_codes: i32,
    /// Its amplitude over the channels' mean.
    pub gain_centi_db: i32,
    /// Its phase over the channels' common one; with a known source, less what its direction makes.
    pub phase_mdeg: i32,
    /// Standard deviation of that from frame to frame.
    pub phase_sigma_mdeg: i32,
}
