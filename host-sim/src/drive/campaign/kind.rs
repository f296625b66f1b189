//! The faults of a campaign.

use serde::{Deserialize, Serialize};

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Bytes are lost and changed, both ways.
    LineNoise,
    /// Nothing comes through, either way.
    LineCut,
    /// Random bytes come in as fast as the line carries them.
    LineFlood,
    /// Frames are cut short, and their length is wrong.
    WrongLength,
    /// The autopilot does not say that it is there.
    NoHeartbeat,
    /// It does not say where the vehicle is.
    NoPosition,
    /// Nothing is said of obstacles.
    NoObstacles,
    /// Its place jumps.
    PositionJump,
    /// It restarts.
    AutopilotRestart,
    /// The pilot changes the mode to and fro.
    ModeFlapping,
    /// The converters bring the same codes again and again.
    FrozenConverters,
    /// They bring nothing.
    NoFrames,
    /// Our clock jumps, forward or back.
    ClockJump,
    /// The power is cut at any instruction.
    PowerCut,
    /// So it is, and the flash is spoiled.
    SpoiledFlash,
    /// Interrupts take the processor away.
    StolenProcessor,
    /// The planner does not get to run.
    StarvedPlanner,
    /// The program panics.
    Panic,
    /// It executes what is no instruction.
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
    /// As one says it.
    #[must_use]
    pub fn name(self) -> String {
        serde_json::to_value(self).map(|name| name.as_str().unwrap_or_default().replace('_', " ")).unwrap_or_default()
    }

    /// Whether the computer is asked to restart; `None` where it may: late steps one after the other until the watchdog bites.
    #[must_use]
    pub const fn restarts(self) -> Option<bool> {
        match self {
            Self::StolenProcessor => None,
            _ => Some(self.restart_words().is_some()),
        }
    }

    /// Where it may end the program: how the text to the pilot begins.
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
