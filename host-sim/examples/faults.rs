//! The firmware in QEMU with everything going wrong; prints the table of `docs/faults.md`. `cargo xtask qemu faults` runs it.
//!
//! Arguments: the image, how many missions, how many faults in each.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::path::PathBuf;
use std::process::ExitCode;

use foxhound_sim::campaign::{self, KINDS, Report, Row};
use rayon::prelude::*;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let elf = arguments.next().map(PathBuf::from);
    let mut number = || arguments.next().and_then(|number| number.parse().ok());
    let (Some(elf), Some(missions), Some(faults)) = (elf, number(), number()) else {
        eprintln!("faults: the image, the number of missions and the number of faults in each, please");
        return ExitCode::from(2);
    };
    let reports: Vec<_> = (0..missions)
        .into_par_iter()
        .map(|mission: u32| {
            let first = (mission * faults) as usize % KINDS.len();
            let report = campaign::fly(&elf, u64::from(mission) + 1, faults, first);
            match &report {
                Ok(report) => {
                    let all = report.all();
                    let touched = all.collisions + all.collisions_away;
                    eprintln!(
                        "mission {}: {} faults, {touched} collisions, {} lost",
                        mission + 1,
                        all.faults,
                        all.lost
                    );
                }
                Err(error) => eprintln!("mission {}: {error}", mission + 1),
            }
            report
        })
        .collect();
    let mut whole = Report::default();
    let mut broken = 0;
    for report in &reports {
        match report {
            Ok(report) => whole.add(report),
            Err(_) => broken += 1,
        }
    }
    print(&whole);
    let all = whole.all();
    let untold = whole.rows.values().map(|row| row.restarts.saturating_sub(row.restarts_told)).sum::<u32>();
    let bad = all.lost + all.collisions + all.outside_limits + all.uninvited + untold;
    println!("\n{broken} missions in which the firmware did not answer any more; {untold} restarts without a word.");
    if bad == 0 && broken == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn print(report: &Report) {
    println!("{} missions, {} faults, {} simulated seconds.\n", report.missions, report.all().faults, report.seconds);
    println!(
        "| fault | times | flew on | stood still, saying | neither | pillars touched | with the computer away | restarts | \
         told | setpoints outside limits | uninvited |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for (kind, row) in &report.rows {
        let name = serde_json::to_value(kind).map(|name| name.as_str().unwrap_or_default().replace('_', " "));
        println!("{}", line(&name.unwrap_or_default(), row));
    }
    println!("{}", line("all", &report.all()));
    let worst = report.worst;
    println!(
        "\nThe worst of all steps: {} instructions of guidance, {} of a replan with what pre-empted it, {} bytes of stack.",
        worst.fast_instructions, worst.plan_instructions, worst.stack_bytes
    );
}

fn line(name: &str, row: &Row) -> String {
    let safe: Vec<String> = row.safe.iter().map(|(outcome, count)| format!("{count} `{outcome}`")).collect();
    format!(
        "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
        row.faults,
        row.recovered,
        safe.join(", "),
        row.lost,
        row.collisions,
        row.collisions_away,
        row.restarts,
        row.restarts_told,
        row.outside_limits,
        row.uninvited,
    )
}
