//! Missions by the image of the NUCLEO-G474RE in an instruction emulator; prints `docs/results/g474.md`. `cargo xtask g474` runs
//! it: the image, QEMU's twin, how many seeds.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::path::Path;
use std::process::ExitCode;

use foxhound_sim::g474::trial::{self, Trial};
use serde_json::Value;

const PERIOD_MS: f64 = 19.998;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [elf, twin, seeds] = &arguments[..] else {
        eprintln!("usage: g474 ELF TWIN SEEDS");
        return ExitCode::from(2);
    };
    let mut last = None;
    println!("# The image in an instruction emulator\n");
    println!("`cargo xtask g474` prints this page. [How we measure](../measuring.md) says what the model assumes.\n");
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
        print_timing(&timing);
    }
    ExitCode::SUCCESS
}

fn print_timing(timing: &Value) {
    let number = |value: &Value| value.as_f64().unwrap_or_default();
    let hclk_mhz = number(&timing["hclk_hz"]) / 1e6;
    let (base, stall) = (&timing["cycles_per_instruction"], &timing["flash_stall_per_instruction"]);
    println!("\n## Time\n");
    println!(
        "Of the last mission. Cycles are instructions, counted, times {base} and {stall} for the flash (both assumed: no"
    );
    println!(
        "board has measured them), and {} for an exception each way. {hclk_mhz} MHz.\n",
        timing["exception_cycles"]
    );
    println!("| in a frame of {PERIOD_MS} ms | least, cycles | mean | most | mean share | most share |");
    println!("|---|---|---|---|---|---|");
    let period = hclk_mhz * 1e3 * PERIOD_MS;
    for name in ["guidance", "link", "planner", "interrupts", "sleep"] {
        let row = &timing["per_frame"][name];
        let [least, mean, most] = ["least", "mean", "most"].map(|key| number(&row[key]));
        let [mean_share, most_share] = [mean, most].map(|cycles| 100.0 * cycles / period);
        println!("| {name} | {least:.0} | {mean:.0} | {most:.0} | {mean_share:.2} % | {most_share:.2} % |");
    }
    println!(
        "\n| from its start to its end, without what interrupts it | times | least, cycles | mean | most | most, ms |"
    );
    println!("|---|---|---|---|---|---|");
    for name in ["guidance", "link", "planner"] {
        let row = &timing["per_activation"][name];
        let [count, least, mean, most] = ["count", "least", "mean", "most"].map(|key| number(&row[key]));
        println!("| {name} | {count:.0} | {least:.0} | {mean:.0} | {most:.0} | {:.2} |", most / hclk_mhz / 1e3);
    }
    println!(
        "\nLongest time between two feeds of the watchdog: {:.1} ms of 500.",
        number(&timing["watchdog_longest_us"]) / 1e3
    );
}
