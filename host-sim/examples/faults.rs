//! The firmware in QEMU with everything going wrong; prints the table of `docs/results/faults.md`. `cargo xtask qemu faults` runs it.
//!
//! It notes every mission in a file when it has been flown, and flies those that are not there yet: a campaign that was ended
//! goes on where it stopped. Ended by a signal it forgets the missions under way. Exits with 1 when anything was not as it should be, after all missions.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use clap::Parser;
use foxhound_sim::drive::campaign::{self, Head, Record, Report};
use rayon::prelude::*;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

#[derive(Parser)]
struct Arguments {
    /// The firmware's image
    elf: PathBuf,
    /// How many missions; their seeds are 1 and so on
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..))]
    missions: u64,
    /// How many faults in each
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    faults: u32,
    /// What was flown, mission by mission; where it exists it is continued
    #[arg(long, default_value = "out/faults.jsonl")]
    record: PathBuf,
    /// Fly this mission alone, and write nothing
    #[arg(long)]
    seed: Option<u64>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let Arguments { elf, faults, .. } = &arguments;
    if let Some(seed) = arguments.seed {
        return match campaign::fly(elf, seed, *faults) {
            Ok(report) => conclude(&report, [(&seed, &report)]),
            Err(error) => refuse(&error),
        };
    }
    let image = match std::fs::read(elf) {
        Ok(image) => image,
        Err(error) => return refuse(&format_args!("{}: {error}", elf.display())),
    };
    match Record::open(&arguments.record, &Head::new(&image, *faults)) {
        Ok(record) => fly_all(&arguments, record),
        Err(error) => refuse(&error),
    }
}

fn fly_all(arguments: &Arguments, record: Record) -> ExitCode {
    let Arguments { elf, missions, faults, .. } = arguments;
    let left: Vec<u64> = (1..=*missions).filter(|seed| !record.missions.contains_key(seed)).collect();
    if left.len() < *missions as usize {
        let path = arguments.record.display();
        eprintln!("{path} has {} of {missions} missions already", *missions as usize - left.len());
    }
    stay_put();
    let is_ended = Arc::new(AtomicBool::new(false));
    for signal in [SIGHUP, SIGINT, SIGTERM] {
        if let Err(error) = signal_hook::flag::register(signal, Arc::clone(&is_ended)) {
            return refuse(&error);
        }
    }
    let record = Mutex::new(record);
    // Long ones at the end would leave processors idle: one at a time.
    let flown = left.par_iter().with_max_len(1).try_for_each(|seed| {
        let begin = Instant::now();
        let report = if is_ended.load(Ordering::Relaxed) { None } else { Some(campaign::fly(elf, *seed, *faults)) };
        match report {
            // Whoever ended us may have ended QEMU before.
            Some(report) if !is_ended.load(Ordering::Relaxed) => {
                match report {
                    Ok(report) => note(&record, *seed, report, *missions, begin)?,
                    Err(error) => eprintln!("mission {seed} did not begin: {error}"),
                }
                Ok::<(), Failure>(())
            }
            _ => Err("ended; the same command goes on".into()),
        }
    });
    if let Err(error) = flown {
        return refuse(&error);
    }
    let record = record.into_inner().unwrap_or_else(PoisonError::into_inner);
    let whole = record.whole(*missions);
    let code = conclude(&whole, record.missions.range(1..=*missions));
    let missing = missions.saturating_sub(u64::from(whole.missions));
    if missing == 0 {
        return code;
    }
    eprintln!("{missing} missions are missing; the same command flies them");
    ExitCode::FAILURE
}

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn note(record: &Mutex<Record>, seed: u64, report: Report, missions: u64, begin: Instant) -> Result<(), Failure> {
    let mut record = record.lock().unwrap_or_else(PoisonError::into_inner);
    let (flown, complaints) = (report.all().faults, report.complaints.len());
    record.note(seed, report)?;
    let done = record.missions.range(1..=missions).count();
    let took_s = begin.elapsed().as_secs_f64();
    eprintln!("{done} of {missions}: mission {seed}, {flown} faults, {complaints} complaints, {took_s:.1} s");
    if let Some(report) = record.missions.get(&seed) {
        complain(seed, report);
    }
    Ok(())
}

fn complain(seed: u64, report: &Report) {
    for complaint in &report.complaints {
        eprintln!("  mission {seed}, {complaint}; again: --seed {seed}");
    }
}

fn conclude<'a>(whole: &Report, missions: impl IntoIterator<Item = (&'a u64, &'a Report)>) -> ExitCode {
    println!("{whole}");
    if whole.complaints.is_empty() {
        return ExitCode::SUCCESS;
    }
    eprintln!("not as it should be:");
    missions.into_iter().for_each(|(seed, report)| complain(*seed, report));
    ExitCode::FAILURE
}

fn refuse(error: &impl std::fmt::Display) -> ExitCode {
    eprintln!("faults: {error}");
    ExitCode::FAILURE
}

/// Gives every thread a processor of its own, where QEMU joins it: left to themselves two may share one.
fn stay_put() {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
    let Ok(ours) = sched_getaffinity(None) else { return };
    let processors: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|processor| ours.is_set(*processor)).collect();
    let pool = rayon::ThreadPoolBuilder::new().start_handler(move |thread| {
        let mut own = CpuSet::new();
        own.set(processors[thread % processors.len()]);
        // Only the speed depends on it.
        let _ = sched_setaffinity(None, &own);
    });
    // The default one does as well.
    let _ = pool.build_global();
}
