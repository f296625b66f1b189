//! The flight computer in QEMU where it cannot be: it is refused at its start, so it never exists.

use std::convert::Infallible;
use std::io;
use std::path::Path;

use foxhound_computer::twin::{Fault, Setup};
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::FrontEnd;

use super::{QemuError, Worst};
use crate::drive::computer::{BLOCK, StepReport};

/// The firmware, running in QEMU: not on this system. It is a reference because the compiler would report all code behind a start
/// as unreachable.
#[derive(Debug)]
pub struct QemuComputer(&'static Infallible);

#[expect(missing_docs, clippy::missing_errors_doc, reason = "as in `machine.rs`; none can be called but the first two")]
impl QemuComputer {
    pub fn start(_: &Path, _: &Setup) -> Result<Self, QemuError> {
        Err(QemuError::System)
    }

    pub fn start_quick(_: &Path, _: &Setup) -> Result<Self, QemuError> {
        Err(QemuError::System)
    }

    pub fn set_up(&mut self, _: &Setup) -> Result<(), QemuError> {
        match *self.0 {}
    }

    pub fn recover(&mut self, _: &Setup) -> Result<(), QemuError> {
        match *self.0 {}
    }

    pub fn step(
        &mut self,
        _: Instant,
        _: FrontEnd<'_, BLOCK>,
        _: Option<&[Circle]>,
        _: &[u8],
    ) -> Result<StepReport, QemuError> {
        match *self.0 {}
    }

    pub fn see(&mut self, _: &[u8]) -> Result<(), QemuError> {
        match *self.0 {}
    }

    pub fn turn(&mut self, _: &[u8]) -> Result<(), QemuError> {
        match *self.0 {}
    }

    pub fn inject(&mut self, _: Fault) {
        match *self.0 {}
    }

    pub const fn worst(&self) -> Worst {
        match *self.0 {}
    }

    pub const fn late_steps(&self) -> u32 {
        match *self.0 {}
    }

    pub fn read_memory(&self, _: &mut [u8], _: usize) -> io::Result<()> {
        match *self.0 {}
    }

    pub fn write_memory(&self, _: &[u8], _: usize) -> io::Result<()> {
        match *self.0 {}
    }

    pub fn put_camera_on_line(&mut self) {
        match *self.0 {}
    }

    pub fn keep_port(&mut self) {
        match *self.0 {}
    }

    pub fn take_port(&mut self) -> Vec<u8> {
        match *self.0 {}
    }

    pub fn type_on_port(&mut self, _: &[u8]) -> io::Result<()> {
        match *self.0 {}
    }
}
