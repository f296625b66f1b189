//! Missions of the firmware in QEMU, and the worst that it has shown in each; prints a table of `docs/results/bench.md`.
//! `cargo xtask qemu bench` runs it.
//!
//! Arguments: the image, then scenario files.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use foxhound_computer::twin::Setup;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use foxhound_sim::drive::flight::{self, Mission};
use foxhound_sim::drive::qemu::{QemuComputer, Worst};
use foxhound_sim::scenario::Scenario;

fn main() -> ExitCode {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let Some((elf, files)) = arguments.split_first() else {
        eprintln!("worst: the image, please");
        return ExitCode::from(2);
    };
    match run(elf, files) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("worst: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(elf: &Path, files: &[PathBuf]) -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "| mission | result | guidance, worst step | replan, with what pre-empted it | stack, bytes | late steps |"
    );
    println!("|---|---|---|---|---|---|");
    let mut worst = Worst::default();
    let mut scenarios = vec![Scenario::built_in()];
    for file in files {
        scenarios.push(Scenario::parse(&std::fs::read_to_string(file)?)?);
    }
    for scenario in scenarios {
        let (planner, estimator) = (planner::Config::default(), Estimator::CrossSpectrum);
        let mission = Mission { scenario, seed: 1, planner, estimator };
        let mut computer = QemuComputer::start(elf, &Setup { guidance: mission.guidance(), needs_entry: false })?;
        let record = flight::fly(&mission, &mut computer, None, |_| {})?;
        let result = serde_json::to_value(record.report.result)?;
        row(&record.report.name, result.as_str().unwrap_or_default(), computer.worst());
        worst.add(computer.worst());
    }
    row("the worst of all", "", worst);
    Ok(())
}

fn row(name: &str, result: &str, worst: Worst) {
    let Worst { fast_instructions, plan_instructions, stack_bytes, late_steps } = worst;
    println!("| {name} | {result} | {fast_instructions} | {plan_instructions} | {stack_bytes} | {late_steps} |");
}
