//! Pairs a computer whose state is not accessible with one in this process, which gets the same input and gives the
//! same result.

use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::FrontEnd;

use crate::drive::computer::{BLOCK, Computer, ComputerError, HostComputer, StepReport};

/// A firmware image in QEMU flies; the computer in this process repeats every step, only for the report.
#[derive(Debug)]
pub struct Beside<C> {
    flies: C,
    looked_into: HostComputer,
}

impl<C: Computer> Beside<C> {
    /// Both have just started, with the same configuration.
    pub const fn new(flies: C, looked_into: HostComputer) -> Self {
        Self { flies, looked_into }
    }
}

impl<C: Computer> Computer for Beside<C> {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        let report = self.flies.step(now, front_end, circles, rx)?;
        let beside = self.looked_into.step(now, front_end, circles, rx)?;
        if beside.output.trace_hash != report.output.trace_hash {
            return Err(ComputerError(
                "its results differ from those of the same program here: the report ends before that".to_owned(),
            ));
        }
        Ok(report)
    }

    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.flies.see(bytes)?;
        self.looked_into.see(bytes)
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.flies.turn(bytes)?;
        self.looked_into.turn(bytes)
    }

    fn log_flight(&mut self) {
        self.flies.log_flight();
    }

    fn take_flight_log(&mut self) -> Vec<u8> {
        self.flies.take_flight_log()
    }

    fn inside(&self) -> Option<&HostComputer> {
        Some(&self.looked_into)
    }
}
