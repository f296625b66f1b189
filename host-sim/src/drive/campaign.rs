//! The firmware in QEMU with all kinds of faults, over some hundred missions.
//!
//! The vehicle flies to and fro between two places past pillars, with a modelled autopilot. Every few seconds one
//! fault happens, by a seed: from outside (noise and cuts on the line, an autopilot that restarts, converters that
//! freeze) or inside ([`Fault`](foxhound_computer::twin::Fault): power cuts at any instruction, panics, faults of the
//! processor, processor time taken away, a planner without time, damaged flash). Then the pilot takes over and enters
//! the mode again, and the vehicle must fly on, or hold and report why. Requirements for every fault:
//!
//! - no setpoint outside the limits, and no moving setpoint while the autopilot reports that it does not obey;
//! - no collision with a pillar under our control. Collisions while the autopilot flies on by itself after the
//!   computer has failed are counted separately: with `GUID_TIMEOUT` as in `docs/hardware/autopilot.md` that is a
//!   second;
//! - the computer restarts if the fault ends the program, and only then, and the pilot gets the right text for every
//!   restart;
//! - processor time taken away makes late steps.
//!
//! A mission can be repeated by its seed: the faults are the same, at the same steps. A power cut is timed by the
//! firmware's clock inside its steps, which varies slightly by interrupts: it may then come some instructions earlier
//! or later.

mod flight;
mod kind;
mod record;
mod report;

use std::path::Path;

use foxhound_computer::twin::Setup;
pub use kind::{KINDS, Kind};
pub use record::{Head, Record};
pub use report::{Complaint, Report, Row};

use super::qemu::{QemuComputer, QemuError};
use super::trial::{Clocks, Trial};
use crate::autopilot::{Start, TIMEOUTS_S};
use crate::scenario::{Obstacle, Scenario, Sensor, SensorModel, Software};
use crate::world::Horizontal;
use crate::world::random::Random;
use flight::{Flight, SECOND_US, Twin};

/// Flies one mission with this many faults; their kinds alternate, through all missions with seeds from 1 on.
///
/// # Errors
/// The firmware does not start.
pub fn fly(elf: &Path, seed: u64, faults: u32) -> Result<Report, QemuError> {
    let first = seed.wrapping_sub(1).wrapping_mul(u64::from(faults)) % KINDS.len() as u64;
    let kinds: Vec<Kind> = KINDS.into_iter().cycle().skip(first as usize).take(faults as usize).collect();
    fly_with(elf, seed, &kinds)
}

/// Flies one mission with these faults.
///
/// # Errors
/// As of [`fly`].
pub fn fly_with(elf: &Path, seed: u64, kinds: &[Kind]) -> Result<Report, QemuError> {
    let software = if seed.is_multiple_of(2) { Software::ArduCopter } else { Software::Px4 };
    let scenario = forest(seed);
    let setup = Setup { guidance: Trial::guidance(&scenario, seed), needs_entry: false };
    let twin = Twin::new(QemuComputer::start_quick(elf, &setup)?, setup);
    let mut trial = Trial::with(twin, &scenario, software, Start::Hovering, Clocks::default(), seed);
    for (name, value) in TIMEOUTS_S {
        trial.rig.autopilot.set_parameter(name, value);
    }
    let ends = [trial.rig.world.source, Horizontal::from_xy(scenario.start)];
    let mut flight = Flight::new(trial, software, Random::new(seed, 0xfa17), ends, setup.guidance.guard.v_max_mps);
    let mut report = Report { missions: 1, ..Report::default() };
    flight.run(2.0);
    for (number, &kind) in (1..).zip(kinds) {
        let row = flight.suffer(kind);
        report.note(number, kind, &row);
        if let Some(error) = flight.trial.computer.broken.take() {
            report.broken = 1;
            report.complaints.push(Complaint { fault: number, kind, what: error.to_string() });
            break;
        }
        if flight.trial.rig.collided {
            break;
        }
    }
    report.seconds = flight.trial.time_us() / SECOND_US;
    report.worst = flight.trial.computer.qemu.worst();
    Ok(report)
}

/// Eight pillars between two places, far enough from each other to pass between.
fn forest(seed: u64) -> Scenario {
    let mut random = Random::new(seed, 0xf0e5);
    let mut obstacles: Vec<Obstacle> = Vec::new();
    while obstacles.len() < 8 {
        let (x, y, r) = (-2.0 + 4.0 * random.uniform(), 3.0 + 18.0 * random.uniform(), 0.2 + 0.3 * random.uniform());
        let gap_m = |other: &Obstacle| libm::hypot(other.x - x, other.y - y) - other.r - r;
        if obstacles.iter().all(|other| gap_m(other) > 1.0) {
            obstacles.push(Obstacle { x, y, r, ..Obstacle::default() });
        }
    }
    Scenario {
        start: [0.0, 0.0],
        goal: [0.0, 24.0],
        obstacles,
        sensor: Sensor { model: SensorModel::Scan, range_m: 4.0, ..Sensor::default() },
        ..Scenario::default()
    }
}
