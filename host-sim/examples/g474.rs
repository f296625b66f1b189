//! Missions by the image of the NUCLEO-G474RE in an instruction emulator; prints `docs/results/g474.md`. `cargo xtask g474` runs
//! it: the image, QEMU's twin, how many seeds.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::path::Path;
use std::process::ExitCode;

use foxhound_sim::drive::g474::timing;
use foxhound_sim::drive::g474::trial::{self, Trial};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [elf, twin, seeds] = &arguments[..] else {
        eprintln!("usage: g474 ELF TWIN SEEDS");
        return ExitCode::from(2);
    };
    let mut last = None;
    println!("# The image in an instruction emulator\n");
    println!(
        "`cargo xtask g474` prints this page. [Contributing](../contributing.md#the-image-in-an-emulator) says what the model assumes.\n"
    );
    println!("## Missions\n");
    println!(
        "The built-in mission, by waveforms and scans. The hash is that of the image, of the desktop and of QEMU's twin on"
    );
    println!("the same inputs, equal at every step.\n");
    println!("| seed | result | time, s | steps | steps in QEMU | replans | restarts | hash |");
    println!("|---|---|---|---|---|---|---|---|");
    for seed in 1..=seeds.parse().unwrap_or(5) {
        match trial::fly(Path::new(elf), Some(Path::new(twin)), seed) {
            Ok(trial) => {
                let Trial { report, steps, twin_steps, replayed, .. } = &trial;
                let (reason, time_s, replans) = (report.result, report.time_s, report.replans);
                if !replayed.is_identical() {
                    eprintln!("g474: seed {seed}: the log does not come to the same: {replayed:?}");
                    return ExitCode::FAILURE;
                }
                let hash = &report.trace_hash;
                println!("| {seed} | {reason:?} | {time_s:.2} | {steps} | {twin_steps} | {replans} | 0 | `{hash}` |");
                last = Some(trial.timing);
            }
            Err(error) => {
                eprintln!("g474: seed {seed}: {error}");
                return ExitCode::FAILURE;
            }
        }
    }
    if let Some(timing) = last {
        println!("\n## Time\n\nOf the last mission. {}", timing::table(&timing));
    }
    ExitCode::SUCCESS
}
