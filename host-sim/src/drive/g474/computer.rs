//! The board as the computer of a flight.

use std::path::Path;

use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::guidance::param::{Id, Values};
use foxhound_core::guidance::{self, FrontEnd, Output};
use foxhound_link::CharArray;
use foxhound_link::dialect::{COMMAND_LONG_DATA, MavCmd, PARAM_SET_DATA};
use foxhound_link::framer::{FRAME_MAX, Header, encode_data};

use super::{Board, G474Error, Needs, Options, Report, timing};
use crate::drive::computer::{BLOCK, Computer, ComputerError, StepReport};
use crate::drive::replay::{Followed, Follower};

/// The station that sets parameters before take-off, and its target.
const STATION: Header = Header { system_id: 255, component_id: 190, sequence: 0 };
const TARGET: (u8, u8) = (1, 191);
/// A parameter is 32 bits of a float.
const REAL32: u8 = 9;
/// Steps after which a parameter must be in use.
const PATIENCE: u32 = 100;
/// From the middle of a block to its end: 127.5 samples.
const HALF_BLOCK_US: f64 = 127.5 * 1660.0 / 170.0;

/// The image's input of a step, by its log, and its result.
#[derive(Clone, Debug)]
pub struct Received {
    /// The time of the step.
    pub now: Instant,
    /// The frame of the antennas.
    pub snapshot: Option<Box<AdcFrame<BLOCK>>>,
    /// Bytes of the autopilot.
    pub rx: Vec<u8>,
    /// The image's own trace hash.
    pub trace_hash: u64,
}

/// The board, and this process's own computer, which repeats its steps.
pub struct G474Computer {
    board: Board,
    report: Report,
    follower: Follower,
    /// Bytes of a camera for the next step.
    camera: Vec<u8>,
    /// Bytes of a lidar for the next step.
    lidar: Vec<u8>,
    flight_log: Option<Vec<u8>>,
    /// The received input, if it is recorded.
    heard: Option<Vec<Received>>,
    output: Option<Output>,
}

impl G474Computer {
    /// Switches a board on, and sets the parameters of its flight.
    ///
    /// # Errors
    /// The board does not start, or refuses a parameter.
    pub fn start(elf: &Path, options: Options, needs: &Needs) -> Result<Self, ComputerError> {
        let (board, report) = Board::start(elf, options).map_err(lost)?;
        let mut computer = Self {
            board,
            report,
            follower: Follower::default(),
            camera: Vec::new(),
            lidar: Vec::new(),
            flight_log: Some(Vec::new()),
            heard: None,
            output: None,
        };
        computer.set(needs.parameters())?;
        if needs.continues {
            let go_on = COMMAND_LONG_DATA {
                target_system: TARGET.0,
                target_component: TARGET.1,
                command: MavCmd::MAV_CMD_DO_PAUSE_CONTINUE as u16,
                param1: 1.0,
                ..Default::default()
            };
            let mut frame = [0; FRAME_MAX];
            let length = encode_data(STATION, &go_on, &mut frame);
            computer.advance(None, &frame[..length])?;
        }
        Ok(computer)
    }

    /// The board itself.
    pub fn board(&mut self) -> &mut Board {
        &mut self.board
    }

    /// Records the input from now on.
    pub fn keep_heard(&mut self) {
        self.heard = Some(Vec::new());
    }

    /// The input recorded since the start or the last call.
    pub fn take_heard(&mut self) -> Vec<Received> {
        self.heard.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// The image's configuration at its start.
    #[must_use]
    pub fn config(&self) -> Option<&guidance::Config> {
        self.follower.begun_with()
    }

    /// Sets parameters over MAVLink, as a ground station does.
    fn set(&mut self, parameters: &[(Id, f32)]) -> Result<(), ComputerError> {
        for (id, value) in parameters {
            let set = PARAM_SET_DATA {
                target_system: TARGET.0,
                target_component: TARGET.1,
                param_id: CharArray::new(*id.padded_name()),
                param_type: REAL32,
                param_value: *value,
            };
            let mut frame = [0; FRAME_MAX];
            let length = encode_data(STATION, &set, &mut frame);
            self.advance(None, &frame[..length])?;
            let holds =
                |values: Option<&Values>| values.is_some_and(|values| values.get(*id).to_bits() == value.to_bits());
            let mut waited = 0;
            while !holds(self.follower.parameters()) {
                waited += 1;
                if waited > PATIENCE {
                    return Err(ComputerError(format!("the image refuses {} = {value}", id.name())));
                }
                self.advance(None, &[])?;
            }
        }
        Ok(())
    }

    /// One frame of the board.
    fn advance(
        &mut self,
        snapshot: Option<&AdcFrame<BLOCK>>,
        rx: &[u8],
    ) -> Result<(Vec<u8>, Vec<Followed>), ComputerError> {
        if self.report.is_sampling {
            let mut offered = snapshot.cloned().unwrap_or_else(AdcFrame::zeroed);
            offered.time = Instant((self.report.frame_us - self.report.origin_us - HALF_BLOCK_US) as u64);
            self.follower.offer(offered);
        }
        let zeroes = AdcFrame::zeroed();
        let (camera, lidar) = (std::mem::take(&mut self.camera), std::mem::take(&mut self.lidar));
        self.report = self.board.step(rx, &camera, &lidar, Some(snapshot.unwrap_or(&zeroes))).map_err(lost)?;
        let Report { resets, log, tx, .. } = &mut self.report;
        if let Some(reset) = resets.first() {
            return Err(ComputerError(format!(
                "the board restarted at {:.6} s: {}",
                reset.time_us * 1e-6,
                reset.cause
            )));
        }
        let (log, tx) = (std::mem::take(log), std::mem::take(tx));
        if let Some(flight_log) = &mut self.flight_log {
            flight_log.extend_from_slice(&log);
        }
        let steps = self.follower.hear(&log).map_err(|error| ComputerError(error.to_string()))?;
        for step in &steps {
            if step.output.trace_hash != step.trace_hash {
                return Err(ComputerError(format!(
                    "the image and this computer differ from step {}, {:.6} s: trace {:016x} there, {:016x} here",
                    step.number,
                    step.output.time.0 as f64 * 1e-6,
                    step.trace_hash,
                    step.output.trace_hash
                )));
            }
        }
        if let Some(heard) = &mut self.heard {
            heard.extend(steps.iter().map(|step| Received {
                now: step.output.time,
                snapshot: step.snapshot.clone(),
                rx: step.bytes.clone(),
                trace_hash: step.trace_hash,
            }));
        }
        Ok((tx, steps))
    }
}

fn lost(error: G474Error) -> ComputerError {
    ComputerError(error.to_string())
}

impl Computer for G474Computer {
    fn step(
        &mut self,
        _now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        let snapshot = match front_end {
            FrontEnd::Frame(snapshot) => Some(snapshot),
            FrontEnd::Nothing => None,
            FrontEnd::Measured(_) | FrontEnd::Bearing(_) => {
                return Err(ComputerError("the board needs waveforms, not bearings".to_owned()));
            }
        };
        if circles.is_some() {
            return Err(ComputerError("the board receives obstacles by MAVLink, not as circles".to_owned()));
        }
        let (tx, steps) = self.advance(snapshot, rx)?;
        let plan = steps.iter().rev().find_map(|step| step.plan.clone());
        // If its log is delayed by the samples of a frame, the last step's output is used.
        self.output = steps.last().map(|step| step.output).or(self.output);
        let output = self.output.ok_or_else(|| ComputerError("the image has made no step".to_owned()))?;
        Ok(StepReport { output, plan, tx })
    }

    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.camera.extend_from_slice(bytes);
        Ok(())
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.lidar.extend_from_slice(bytes);
        Ok(())
    }

    fn next_step_s(&self) -> Option<f64> {
        Some(self.report.frame_us * 1e-6)
    }

    fn needs_entry(&self) -> bool {
        true
    }

    fn time_spent(&mut self) -> Option<String> {
        self.board.timing().ok().as_ref().map(timing::table)
    }

    fn take_flight_log(&mut self) -> Vec<u8> {
        self.flight_log.take().unwrap_or_default()
    }
}
