//! Tests the receiver on board, and calibrates it: the same as `foxhound calibrate`, from the flight computer's own
//! frames.
//!
//! One tone goes to all four inputs through a splitter, or comes from a source in a known direction. For
//! [`FRAMES`] frames, and eight before them, 1.5 s, outside control and disarmed, the frames are used here
//! and not by guidance. The checks, in this order; the first that fails is the verdict:
//!
//! | check | requirement | usual cause |
//! |---|---|---|
//! | [`Check::Frozen`] | no frame repeats the one before | a ring that is not written |
//! | [`Check::Frames`] | frames come, at most one in four is missing | timer or DMA do not run, or one of the converters |
//! | [`Check::Dead`] | samples change; and, once there is a tone, it has at least 1 % of the strongest one's power | wire, amplifier, mixer |
//! | [`Check::Clipped`] | at most 1 % of the samples at a rail | too loud, bias |
//! | [`Check::Same`] | no two channels have identical samples in all frames | two inputs on one converter |
//! | [`Check::Rate`] | frames come at whole multiples of their length, by the clock of the time stamps | sample timer |
//! | [`Check::Offset`] | the mean is near half scale | bias |
//! | [`Check::Noise`] | the floor is low, and no channel's is 6 dB above that of the quietest | supply, oscillation, a loose shield |
//! | [`Check::Tone`] | there is a tone, well above the noise | no tone, or outside its band |
//! | [`Check::Gain`] | the channels have about equal gain | amplifier, cable, splitter |
//! | [`Check::Phase`] | the channels' phases are steady | oscillator, a loose connector |
//! | [`Check::Order`] | each antenna is on its channel | exchanged cables |
//!
//! A splitter cannot show exchanged channels, since all signals are alike. A source in a known direction can, once
//! the channels are calibrated, unless two antennas are symmetric about that direction: dead ahead, an exchange of
//! left and right is not visible; 30 degrees beside the nose is not symmetric. Two inputs joined by a solder bridge
//! before two converters have different noise, and are not found by [`Check::Same`].
//!
//! A constant offset does not affect the phases: [`foxhound_core::signal::phase`] projects it out. It only reduces
//! the range.
//!
//! The numbers come from the samples, and from the phasors of [`foxhound_core::signal::phase`] with its noise floor;
//! relative phases and gains are those of [`foxhound_core::doa::calibration::Calibrator`]. Only sums are stored, no
//! frames.

mod report;
mod run;
#[cfg(test)]
mod tests;

use foxhound_core::base::adc::{AdcFrame, CHANNELS};
use foxhound_core::base::units::DEG_PER_RAD;
use foxhound_core::doa::array::{Array, Entry};
use foxhound_core::signal::phase::Phasors;
use foxhound_link::companion::{Exam, NOTICE_BYTES, Tone};
use heapless::String;

use crate::SAMPLES_PER_CHANNEL as N;

pub use report::{Reading, Report};
use run::{Run, SETTLING};

/// Number of frames used.
pub const FRAMES: u16 = 64;
/// Largest distance of the mean from half scale.
pub const OFFSET_MAX_CODES: f32 = 100.0;
/// Largest share of the samples at a rail.
pub const CLIPPED_MAX: f32 = 0.01;
/// Noise, rms.
const NOISE_MAX_CODES: f32 = 20.0;
/// Noise above that of the quietest channel, or above this.
const NOISE_FLOOR_CODES: f32 = 1.0;
const NOISE_SPREAD_MAX_DB: f32 = 6.0;
/// Least tone over the noise, per sample.
const SNR_MIN_DB: f32 = 10.0;
/// From the weakest channel to the strongest.
const GAIN_SPREAD_MAX_DB: f32 = 3.0;
/// Standard deviation of a channel's phase from frame to frame, against the others'.
const PHASE_SIGMA_MAX_RAD: f32 = 1.5 / DEG_PER_RAD;
/// Largest relative difference of the sample rate from the clock of the time stamps.
const RATE_OFF_MAX: f32 = 500e-6;

/// The checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Check {
    /// Frames come.
    Frames,
    /// No frame repeats the one before.
    Frozen,
    /// A channel has a signal.
    Dead,
    /// Samples stay off the rails.
    Clipped,
    /// No two channels are identical.
    Same,
    /// Frames come in time.
    Rate,
    /// The mean is near half scale.
    Offset,
    /// The noise is low.
    Noise,
    /// There is a tone.
    Tone,
    /// Channels have about equal gain.
    Gain,
    /// Phases are steady.
    Phase,
    /// Each antenna is on its channel.
    Order,
}

impl Check {
    /// The fault as text.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Frames => "no frames",
            Self::Frozen => "frozen",
            Self::Dead => "dead",
            Self::Clipped => "clipped",
            Self::Same => "identical",
            Self::Rate => "rate off",
            Self::Offset => "offset",
            Self::Noise => "noisy",
            Self::Tone => "no tone",
            Self::Gain => "gain off",
            Self::Phase => "unsteady",
            Self::Order => "exchanged",
        }
    }
}

/// Some of the channels, 0..4; none if a fault concerns all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels(u8);

impl Channels {
    /// None.
    pub const NONE: Self = Self(0);

    /// One channel.
    #[must_use]
    pub const fn one(channel: usize) -> Self {
        Self(1 << (channel % CHANNELS))
    }

    /// These and another.
    #[must_use]
    pub const fn and(self, channel: usize) -> Self {
        Self(self.0 | Self::one(channel).0)
    }

    /// The channels for which a condition is true.
    pub fn which(holds: impl Fn(usize) -> bool) -> Self {
        (0..CHANNELS).filter(|channel| holds(*channel)).fold(Self::NONE, Self::and)
    }

    /// Whether it is among them.
    #[must_use]
    pub const fn contains(self, channel: usize) -> bool {
        self.0 & Self::one(channel).0 != 0
    }

    /// Whether there is none.
    #[must_use]
    pub const fn is_none(self) -> bool {
        self.0 == 0
    }
}

/// The result of a test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// All checks passed.
    Pass,
    /// A check failed.
    Fail {
        /// The first that failed.
        check: Check,
        /// The channels concerned.
        channels: Channels,
    },
    /// The vehicle was armed or taken into control.
    Interrupted,
}

/// Why no test was begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// A test is running.
    Busy,
    /// The vehicle is armed, or we are in control of it.
    InUse,
}

#[derive(Clone, Copy, Debug)]
enum Stage {
    Idle,
    Running(Run),
    /// It has a verdict that has not been reported yet; and the measurement, if it is to be adopted.
    Ended(Report, Option<Entry>),
    /// Everything has been reported.
    Told(Report),
}

/// The present test, or the last one.
#[derive(Clone, Copy, Debug)]
pub struct SelfTest {
    stage: Stage,
}

impl Default for SelfTest {
    fn default() -> Self {
        Self { stage: Stage::Idle }
    }
}

impl SelfTest {
    /// Begins a test.
    ///
    /// # Errors
    /// One is running already.
    pub fn begin(&mut self, exam: Exam) -> Result<(), Refused> {
        if matches!(self.stage, Stage::Running(_) | Stage::Ended(..)) {
            return Err(Refused::Busy);
        }
        self.stage = Stage::Running(Run::new(exam));
        Ok(())
    }

    /// Whether it needs frames.
    #[must_use]
    pub const fn is_running(&self) -> bool {
        matches!(self.stage, Stage::Running(_))
    }

    /// Whether the board has to make its own tone.
    #[must_use]
    pub const fn wants_tone(&self) -> bool {
        matches!(self.stage, Stage::Running(Run { exam: Exam::SelfTest(Tone::Board), .. }))
    }

    /// Whether no frame has been used yet: a tracked tone is then another one.
    #[must_use]
    pub const fn is_beginning(&self) -> bool {
        matches!(self.stage, Stage::Running(Run { settling: SETTLING, .. }))
    }

    /// A step without a usable frame.
    #[inline(never)]
    pub fn miss(&mut self, frozen: Option<usize>) {
        if let Stage::Running(run) = &mut self.stage {
            run.miss(frozen);
        }
        self.conclude(None);
    }

    /// A frame, and its phasors; `array` with the table in use.
    #[inline(never)]
    pub fn step(&mut self, array: &Array, sample_rate_hz: f32, snapshot: &AdcFrame<N>, phasors: &Phasors) {
        if let Stage::Running(run) = &mut self.stage {
            run.take(array, sample_rate_hz / N as f32, snapshot, phasors);
        }
        self.conclude(Some(array));
    }

    /// The vehicle is needed.
    #[inline(never)]
    pub fn interrupt(&mut self) {
        if let Stage::Running(run) = &self.stage {
            self.stage = Stage::Ended(run.report(Verdict::Interrupted), None);
        }
    }

    #[inline(never)]
    fn conclude(&mut self, array: Option<&Array>) {
        if let Stage::Running(run) = &self.stage
            && run.is_over()
        {
            let verdict = run.judge(array);
            let takes_over = verdict == Verdict::Pass && matches!(run.exam, Exam::Calibrate { .. });
            let entry = run.entry().filter(|_| takes_over);
            self.stage = Stage::Ended(run.report(verdict), entry);
        }
    }

    /// The test that has just ended, returned once; and the measurement, if it is to be adopted.
    pub(crate) fn take_ended(&mut self) -> Option<(Report, Option<Entry>)> {
        let Stage::Ended(report, entry) = self.stage else { return None };
        self.stage = Stage::Told(report);
        Some((report, entry))
    }

    /// The result of the last test, until the next begins.
    #[must_use]
    pub const fn report(&self) -> Option<&Report> {
        match &self.stage {
            Stage::Ended(report, _) | Stage::Told(report) => Some(report),
            Stage::Idle | Stage::Running(_) => None,
        }
    }
}

/// The verdict as the text of a `STATUSTEXT`.
#[must_use]
pub fn words(exam: Exam, verdict: Verdict) -> String<NOTICE_BYTES> {
    let (passed, failed) = match exam {
        Exam::SelfTest(_) => ("Foxhound: self-test passed", "Foxhound: self-test: "),
        Exam::Calibrate { .. } => ("Foxhound: calibrated", "Foxhound: not calibrated: "),
    };
    let mut words = String::new();
    // All of it fits, as a test checks.
    let mut say = |text: &str| words.push_str(text).unwrap_or_default();
    match verdict {
        Verdict::Pass => say(passed),
        Verdict::Interrupted => [failed, "interrupted"].into_iter().for_each(say),
        Verdict::Fail { check, channels } => {
            say(failed);
            let digits = || ["1", "2", "3", "4"].into_iter().enumerate().filter(|(m, _)| channels.contains(*m));
            if let Some((first, _)) = digits().next() {
                say(if channels == Channels::one(first) { "channel " } else { "channels " });
                digits().for_each(|(_, digit)| say(digit));
                say(" ");
            }
            say(check.words());
        }
    }
    words
}
