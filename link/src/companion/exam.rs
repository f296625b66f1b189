//! The commands that have the receiver examined or calibrated.
//!
//! No command of the common set is about a receiver: `MAV_CMD_PREFLIGHT_CALIBRATION` (241) names the autopilot's sensors one
//! by one, `MAV_CMD_RUN_PREARM_CHECKS` (401) is answered by `SYS_STATUS`. So these are commands of the user's own, which
//! ground stations can send with numbers for parameters, as `COMMAND_LONG` or `COMMAND_INT`:
//!
//! | command | param1 | param2 |
//! |---|---|---|
//! | `MAV_CMD_USER_1` (31010), examine | azimuth of a known source, degrees from the nose | 0 a splitter, 1 the known source, 2 the board's own tone |
//! | `MAV_CMD_USER_2` (31011), calibrate | the same | 0 a splitter, 1 the known source |
//!
//! What a station leaves out it sends as zero or as NaN: for the azimuth these are a direction and none. So a direction holds
//! only where param2 says so, and with nothing said it is a splitter. The board's own tone calibrates nothing: it does not
//! go through the receiver.
//!
//! The answer comes twice: `IN_PROGRESS` at once, and what it came to; `TEMPORARILY_REJECTED` while the vehicle is armed, in
//! control, or examined already; `DENIED` where the parameters say nothing known.

use foxhound_core::base::units::{DEG_PER_RAD, wrap_pi};
use foxhound_core::guidance::mission::Control;

use super::Companion;
use crate::dialect::{COMMAND_ACK_DATA, MavCmd, MavResult};
use crate::framer::Header;

/// What is to be done with the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exam {
    /// See whether it works.
    SelfTest(Tone),
    /// Measure gains and phases of the channels, and go by them.
    Calibrate {
        /// Where the source is, from the nose; none is a splitter.
        azimuth_rad: Option<f32>,
    },
}

/// What the receiver is to hear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tone {
    /// The same in all channels.
    Splitter,
    /// The same, made by the board.
    Board,
    /// A source in a known direction.
    Ahead {
        /// From the nose.
        azimuth_rad: f32,
    },
}

/// What an examination came to, as far as the link is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Examined {
    /// All was well.
    Passed,
    /// Something was not.
    Failed,
    /// It could not be begun.
    Refused,
}

/// An examination that a station wants.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    exam: Exam,
    station: (u8, u8),
    is_taken: bool,
}

impl Companion {
    /// Whether the receiver may be taken away from guidance.
    #[must_use]
    #[inline(never)]
    pub fn may_examine(&self) -> bool {
        self.control(self.now) != Control::Granted && self.autopilot.is_none_or(|autopilot| !autopilot.armed)
    }

    /// What is to be examined; told once, and then waits for [`examined`](Self::examined).
    #[inline(never)]
    pub fn take_exam(&mut self) -> Option<Exam> {
        let wanted = self.exam.as_mut().filter(|wanted| !wanted.is_taken)?;
        wanted.is_taken = true;
        Some(wanted.exam)
    }

    /// An examination has ended, whoever wanted it.
    #[inline(never)]
    pub fn examined(&mut self, examined: Examined) {
        let Some(Wanted { exam, station, .. }) = self.exam.take_if(|wanted| wanted.is_taken) else { return };
        let result = match examined {
            Examined::Passed => MavResult::MAV_RESULT_ACCEPTED,
            Examined::Failed => MavResult::MAV_RESULT_FAILED,
            Examined::Refused => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
        };
        let command = match exam {
            Exam::SelfTest(_) => MavCmd::MAV_CMD_USER_1,
            Exam::Calibrate { .. } => MavCmd::MAV_CMD_USER_2,
        };
        self.acknowledge(station, command as u16, result);
    }

    #[inline(never)]
    pub(super) fn acknowledge(&mut self, station: (u8, u8), command: u16, result: MavResult) {
        self.outbox.post_errand(&COMMAND_ACK_DATA {
            command,
            result: result as u8,
            target_system: station.0,
            target_component: station.1,
            ..COMMAND_ACK_DATA::DEFAULT
        });
    }

    /// One of the two commands.
    #[inline(never)]
    pub(super) fn on_exam(&mut self, from: Header, command: u16, params: [f32; 2]) -> MavResult {
        let Some(exam) = exam(command, params) else { return MavResult::MAV_RESULT_DENIED };
        let station = (from.system_id, from.component_id);
        match self.exam {
            // Asked again, for want of patience.
            Some(wanted) if wanted.station == station && wanted.exam == exam => MavResult::MAV_RESULT_IN_PROGRESS,
            Some(_) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            None if !self.may_examine() => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
            None => {
                self.exam = Some(Wanted { exam, station, is_taken: false });
                MavResult::MAV_RESULT_IN_PROGRESS
            }
        }
    }
}

/// What is meant; `None` where nothing known is.
fn exam(command: u16, [azimuth_deg, from]: [f32; 2]) -> Option<Exam> {
    let calibrates = command == MavCmd::MAV_CMD_USER_2 as u16;
    let azimuth_rad = libm::fabsf(azimuth_deg).le(&360.0).then(|| wrap_pi(azimuth_deg / DEG_PER_RAD));
    if from == 0.0 || from.is_nan() {
        Some(if calibrates { Exam::Calibrate { azimuth_rad: None } } else { Exam::SelfTest(Tone::Splitter) })
    } else if from == 1.0 {
        let azimuth_rad = azimuth_rad?;
        Some(if calibrates {
            Exam::Calibrate { azimuth_rad: Some(azimuth_rad) }
        } else {
            Exam::SelfTest(Tone::Ahead { azimuth_rad })
        })
    } else {
        (from == 2.0 && !calibrates).then_some(Exam::SelfTest(Tone::Board))
    }
}
