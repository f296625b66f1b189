//! The flight computer in QEMU: starts the firmware's twin, passes frames to it, and reads its answers.
//!
//! Every step is in lock-step: the step's input is written into the memory that both sides share (layout in
//! [`foxhound_computer::twin`]), a byte on the second serial line rings the doorbell, and the answer is awaited. The
//! first serial line carries the MAVLink bytes of the firmware unchanged. The result does not depend on the speed of
//! either side.
//!
//! The third serial line, the maintenance port, is a pair of pipes: QEMU writes byte by byte, and of such writes a
//! pipe holds 64 KB, a socket fewer than 300 bytes. They are emptied at every step, so that the firmware never waits
//! for us.
//!
//! `-icount shift=8` advances the twin's clock by 256 ns an instruction, which makes instruction counts exact. Its
//! idle time passes in real time (`sleep=on`, the default): with `sleep=off` it would pass at once, and while we
//! compute the twin would assume that we were gone.

use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::FrontEnd;
use serde::{Deserialize, Serialize};

use super::computer::{BLOCK, Computer, ComputerError, StepReport};

/// What the other systems have, for the test of its refusal.
#[cfg(test)]
pub mod elsewhere;
mod error;
#[cfg_attr(not(target_os = "linux"), path = "qemu/elsewhere.rs")]
mod machine;

pub use error::QemuError;
pub use machine::QemuComputer;

/// The worst values of a firmware.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Worst {
    /// Instructions of a step of guidance.
    pub fast_instructions: u32,
    /// Instructions of a replan, with what pre-empted it.
    pub plan_instructions: u32,
    /// Bytes of the stack.
    pub stack_bytes: u32,
    /// Late steps without a restart between them.
    pub late_steps: u32,
}

impl Worst {
    /// The larger of both, in every value.
    pub fn add(&mut self, other: Self) {
        self.fast_instructions = self.fast_instructions.max(other.fast_instructions);
        self.plan_instructions = self.plan_instructions.max(other.plan_instructions);
        self.stack_bytes = self.stack_bytes.max(other.stack_bytes);
        self.late_steps = self.late_steps.max(other.late_steps);
    }
}

impl Computer for QemuComputer {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        Ok(Self::step(self, now, front_end, circles, rx)?)
    }

    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        Ok(Self::see(self, bytes)?)
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        Ok(Self::turn(self, bytes)?)
    }

    fn log_flight(&mut self) {
        self.keep_port();
    }

    fn take_flight_log(&mut self) -> Vec<u8> {
        self.take_port()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use foxhound_computer::twin::Setup;
    use foxhound_core::guidance::Config;

    use super::elsewhere::QemuComputer;

    #[test]
    fn another_system_refuses_qemu_by_name() {
        let setup = Setup { guidance: Config::default(), needs_entry: false };
        let refusals =
            [QemuComputer::start(Path::new("a.elf"), &setup), QemuComputer::start_quick(Path::new("a.elf"), &setup)];
        for refusal in refusals {
            let text = refusal.err().map(|error| error.to_string());
            assert!(text.as_ref().is_some_and(|text| text.starts_with("qemu needs Linux: ")), "{text:?}");
        }
    }
}
