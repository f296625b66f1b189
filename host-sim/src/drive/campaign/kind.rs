//! The faults of a campaign.

use serde::{Deserialize, Serialize};

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Bytes are lost and changed, in both directions.
    LineNoise,
    /// Nothing comes through, in either direction.
    LineCut,
    /// Random bytes come in as fast as the line carries them.
    LineFlood,
    /// Frames are cut short, and their length is wrong.
    WrongLength,
    /// The autopilot sends no heartbeat.
    NoHeartbeat,
    /// It sends no position.
    NoPosition,
    /// No obstacles are reported.
    NoObstacles,
    /// Its position jumps.
    PositionJump,
    /// It restarts.
    AutopilotRestart,
    /// The pilot changes the mode to and fro.
    ModeFlapping,
    /// The converters deliver the same samples again and again.
    FrozenConverters,
    /// They deliver nothing.
    NoFrames,
    /// Our clock jumps, forward or back.
    ClockJump,
    /// The power is cut at any instruction.
    PowerCut,
    /// The power is cut, and the flash is damaged.
    SpoiledFlash,
    /// Interrupts take processor time away.
    StolenProcessor,
    /// The planner gets no time.
    StarvedPlanner,
    /// The program panics.
    Panic,
    /// It executes an invalid instruction.
    UndefinedInstruction,
    /// Its stack overflows.
    StackOverflow,
    /// It hangs.
    Hang,
}

/// All of them.
pub const KINDS: [Kind; 21] = [
    Kind::LineNoise,
    Kind::LineCut,
    Kind::LineFlood,
    Kind::WrongLength,
    Kind::NoHeartbeat,
    Kind::NoPosition,
    Kind::NoObstacles,
    Kind::PositionJump,
    Kind::AutopilotRestart,
    Kind::ModeFlapping,
    Kind::FrozenConverters,
    Kind::NoFrames,
    Kind::ClockJump,
    Kind::PowerCut,
    Kind::SpoiledFlash,
    Kind::StolenProcessor,
    Kind::StarvedPlanner,
    Kind::Panic,
    Kind::UndefinedInstruction,
    Kind::StackOverflow,
    Kind::Hang,
];

impl Kind {
    /// Its name in text.
    #[must_use]
    pub fn name(self) -> String {
        serde_json::to_value(self).map(|name| name.as_str().unwrap_or_default().replace('_', " ")).unwrap_or_default()
    }

    /// Whether the computer must restart; `None` if it may: late steps in a row until the watchdog restarts it.
    #[must_use]
    pub const fn restarts(self) -> Option<bool> {
        match self {
            Self::StolenProcessor => None,
            _ => Some(self.restart_words().is_some()),
        }
    }

    /// If it may end the program: how the text to the pilot begins.
    #[must_use]
    pub const fn restart_words(self) -> Option<&'static str> {
        match self {
            Self::PowerCut | Self::SpoiledFlash => Some("brown-out"),
            Self::Panic => Some("panic "),
            Self::UndefinedInstruction | Self::StackOverflow => Some("fault at 0x"),
            Self::Hang | Self::StolenProcessor => Some("watchdog at 0x"),
            _ => None,
        }
    }
}
