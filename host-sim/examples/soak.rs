//! Two long runs beside each modelled autopilot: the link by itself, and the whole computer; prints tables for
//! `docs/results/soak.md`. `cargo xtask soak` runs it.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::process::ExitCode;

use foxhound_sim::drive::soak::{Config, course, fly_laps, keep_link};
use foxhound_sim::drive::trial::Clocks;
use foxhound_sim::scenario::Software;
use serde_json::Value;

const BOTH: [Software; 2] = [Software::ArduCopter, Software::Px4];
const MUST_NOT: [&str; 6] =
    ["collided", "missed", "not_recovered", "setpoints_off_grid", "setpoints_wrong", "telemetry_off"];

fn main() -> ExitCode {
    let hours = std::env::args().nth(1).and_then(|hours| hours.parse().ok()).unwrap_or(24.0);
    match run(hours) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("soak: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(hours: f64) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let config = |software, step_us| Config { software, hours, step_us, clocks: Clocks::default(), seed: 1 };
    let link = both(move |software| Ok(serde_json::to_value(keep_link(&config(software, 10_000), |_| ())?)?))?;
    table("The link by itself, every 10 ms", &link);
    let laps =
        both(move |software| Ok(serde_json::to_value(fly_laps(&course(), &config(software, 20_000), |_| ())?)?))?;
    table("The whole computer, every 20 ms", &laps);
    let wrong: Vec<String> = [link, laps].iter().flatten().flat_map(wrong).collect();
    if wrong.is_empty() { Ok(()) } else { Err(wrong.join(", ").into()) }
}

/// What must not happen, with its number.
fn wrong(column: &Value) -> impl Iterator<Item = String> {
    let has_happened = |value: &&Value| value.as_u64() != Some(0) && value.as_bool() != Some(false);
    MUST_NOT
        .into_iter()
        .filter_map(move |name| column.get(name).filter(has_happened).map(|value| format!("{name} {value}")))
}

type Outcome = Result<Value, Box<dyn std::error::Error + Send + Sync>>;

/// The same beside both, at the same time.
fn both(run: impl Fn(Software) -> Outcome + Sync) -> Result<[Value; 2], Box<dyn std::error::Error + Send + Sync>> {
    let [first, second] = std::thread::scope(|scope| {
        let run = &run;
        BOTH.map(|software| scope.spawn(move || run(software)))
            .map(|thread| thread.join().unwrap_or_else(|_| Err("a thread has panicked".into())))
    });
    Ok([first?, second?])
}

fn table(title: &str, columns: &[Value; 2]) {
    println!("\n## {title}\n\n| | ArduCopter | PX4 |\n|---|---|---|");
    for (name, value) in columns[0].as_object().into_iter().flatten() {
        println!("| {} | {value} | {} |", name.replace('_', " "), columns[1][name]);
    }
}
