//! The companion computer that is being flown: in this process, or the firmware in QEMU.
//!
//! Both do the same things in the same order, so that their traces are equal bit for bit:
//!
//! 1. the link takes in the bytes of the autopilot;
//! 2. guidance steps, with what the link heard, the frame, and the plan that was finished in the step before;
//! 3. the link publishes the outcome, does what is due, and gives out its bytes;
//! 4. when guidance asked for a plan, the planner makes one, which is handed over at the next step.

use std::fmt;

use foxhound_core::ConfigError;
use foxhound_core::guidance::{self, FrontEnd, Guidance, Input, Output};
use foxhound_core::map::Circle;
use foxhound_core::planner::{Plan, Planner, Scratch};
use foxhound_core::time::Instant;
use foxhound_link::companion::{self, Companion};
use foxhound_link::mailbox::Planned;

use crate::qemu::QemuComputer;

/// Samples per channel of one frame.
pub const BLOCK: usize = 256;

/// Room for what the link may want to say in one step.
const TRANSMIT_BYTES: usize = 4096;

/// What one step came to.
#[derive(Clone, Debug, PartialEq)]
pub struct StepReport {
    /// What guidance said.
    pub output: Output,
    /// A plan that was finished in this step.
    pub plan: Option<Planned>,
    /// Bytes for the autopilot.
    pub tx: Vec<u8>,
}

/// Why a computer stopped working.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComputerError(pub String);

impl fmt::Display for ComputerError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for ComputerError {}

/// A companion computer.
pub trait Computer {
    /// Does one step: the frame and the autopilot's bytes in, what happened and the bytes for the autopilot out.
    ///
    /// # Errors
    /// The computer does not answer as it should.
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError>;

    /// The obstacles that it remembers, where one can look into it.
    fn remembered(&self) -> Vec<Circle> {
        Vec::new()
    }
}

/// The computer in this process.
#[derive(Debug)]
pub struct HostComputer {
    companion: Companion,
    guidance: Guidance<BLOCK>,
    state: guidance::State<BLOCK>,
    planner: Planner,
    scratch: Scratch,
    finished: Option<Plan>,
}

impl HostComputer {
    /// A computer that was just switched on.
    ///
    /// # Errors
    /// The field of the configuration that is refused.
    pub fn new(config: &guidance::Config) -> Result<Self, ConfigError> {
        let guidance = config.build()?;
        Ok(Self {
            companion: companion::Config::default().build()?,
            state: guidance.start(),
            guidance,
            planner: config.planner.build()?,
            scratch: Scratch::default(),
            finished: None,
        })
    }
}

impl Computer for HostComputer {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        self.companion.receive(now, rx);
        let scan = self.companion.take_scan();
        let plan = self.finished.take();
        let input = Input {
            now,
            front_end,
            ownship: self.companion.ownship(),
            scan: scan.as_ref(),
            circles,
            control: self.companion.control(now),
            plan: plan.as_ref(),
        };
        let output = self.guidance.step(&mut self.state, &input);
        self.companion.publish(now, &output);
        self.companion.poll(now);
        let mut tx = vec![0; TRANSMIT_BYTES];
        let length = self.companion.transmit(&mut tx);
        tx.truncate(length);
        let mut planned = None;
        if output.plan_requested {
            let plan = self.planner.plan(&mut self.scratch, self.state.request());
            planned = Some(Planned {
                id: plan.id,
                waypoints_ned_m: plan.waypoints_ned_m,
                samples_ned_m: self.scratch.samples,
                ticks: 0,
            });
            self.finished = Some(plan);
        }
        Ok(StepReport { output, plan: planned, tx })
    }

    fn remembered(&self) -> Vec<Circle> {
        self.state.map().circles().copied().collect()
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
        let report = Self::step(self, now, front_end, circles, rx).map_err(|error| ComputerError(error.to_string()))?;
        Ok(StepReport { output: report.output, plan: report.plan, tx: report.tx })
    }
}
