//! The commands that test or calibrate the receiver.
//!
//! No command of the common set is about a receiver: `MAV_CMD_PREFLIGHT_CALIBRATION` (241) names the autopilot's
//! sensors one by one, and `MAV_CMD_RUN_PREARM_CHECKS` (401) is answered by `SYS_STATUS`. So user commands are used,
//! which ground stations can send with numbers for parameters, as `COMMAND_LONG` or `COMMAND_INT`:
//!
//! | command | param1 | param2 |
//! |---|---|---|
//! | `MAV_CMD_USER_1` (31010), test | azimuth of a known source, degrees from the nose | 0 a splitter, 1 the known source, 2 the board's own tone |
//! | `MAV_CMD_USER_2` (31011), calibrate | the same | 0 a splitter, 1 the known source |
//!
//! A station sends zero or NaN for what it leaves out, and zero is a valid azimuth. So an azimuth counts only where
//! param2 is 1, and a command without parameters means a splitter. The board's own tone calibrates nothing, since it
//! does not pass through the receiver.
//!
//! There are two answers: `IN_PROGRESS` at once, and the result later. It is `TEMPORARILY_REJECTED` while the vehicle
//! is armed, in control, or already being tested, and `DENIED` where the parameters are unknown.

use foxhound_core::base::units::{DEG_PER_RAD, wrap_pi};
use foxhound_core::guidance::mission::Control;

use super::Companion;
use crate::dialect::{COMMAND_ACK_DATA, MavCmd, MavResult};
use crate::framer::Header;

/// A test or calibration of the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exam {
    /// Test whether it works.
    SelfTest(Tone),
    /// Measure gains and phases of the channels, and use them from then on.
    Calibrate {
        /// Azimuth of the source, from the nose; `None` for a splitter.
        azimuth_rad: Option<f32>,
    },
}

/// The signal that the receiver gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tone {
    /// The same signal in all channels.
    Splitter,
    /// The same signal in all channels, made by the board.
    Board,
    /// A source in a known direction.
    Ahead {
        /// From the nose.
        azimuth_rad: f32,
    },
}

/// The result of a test or calibration, as far as the link is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Examined {
    /// It passed.
    Passed,
    /// It failed.
    Failed,
    /// It could not be started.
    Refused,
}

/// A test or calibration that a station has requested.
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

    /// The test or calibration to run; returned once, then the link waits for [`examined`](Self::examined).
    #[inline(never)]
    pub fn take_exam(&mut self) -> Option<Exam> {
        let wanted = self.exam.as_mut().filter(|wanted| !wanted.is_taken)?;
        wanted.is_taken = true;
        Some(wanted.exam)
    }

    /// A test or calibration has ended, whoever requested it.
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
            // A station that repeats its request.
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

/// What the parameters mean; `None` where they are unknown.
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
