//! Flights to their very end, on held-out seeds, and constants of `core/src/landing`, each around its value, on development
//! seeds; writes `docs/results/landings.md`. `cargo xtask landings` runs it: how many flights of each scene, the page. With
//! `development` behind them only the constants, onto standard output.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::error::Error;
use std::fmt::Write as _;
use std::process::ExitCode;

use foxhound_core::{guidance, landing};
use foxhound_sim::study::landings::{Row, SCENES, Scene, row};
use foxhound_sim::study::seeds;

/// Scenes in which constants are tried, and flights of each for each value.
const TRIED: [&str; 2] = ["camera, gusts of 3 m/s", "camera, gusts of 3 m/s, PX4, no range finder"];
const FOR_A_VALUE: u64 = 60;

/// A constant, two values, and how it is set.
type Constant = (&'static str, [f32; 2], fn(&mut landing::Config, f32));

const CONSTANTS: [Constant; 6] = [
    ("centring.kp_per_s", [1.2, 2.0], |config, value| config.centring.kp_per_s = value),
    ("centring.kd", [0.7, 1.2], |config, value| config.centring.kd = value),
    ("centring.commit_gate_m", [0.06, 0.11], |config, value| config.centring.commit_gate_m = value),
    ("centring.commit_speed_mps", [0.1, 0.2], |config, value| config.centring.commit_speed_mps = value),
    ("centring.gate_per_m", [0.1, 0.2], |config, value| config.centring.gate_per_m = value),
    ("arrival.arrive_m", [0.9, 1.5], |config, value| config.arrival.arrive_m = value),
];

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [flights, page, rest @ ..] = &arguments[..] else {
        eprintln!("usage: landings FLIGHTS PAGE [development]");
        return ExitCode::from(2);
    };
    let flights = flights.parse().unwrap_or(200);
    let done = if rest.is_empty() {
        written(flights).and_then(|text| Ok(std::fs::write(page, text)?))
    } else {
        constants(flights).map(|text| println!("{text}"))
    };
    if let Err(error) = done {
        eprintln!("landings: {error}");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

const COLUMNS: &str = "flights | collisions | on the pad, to 0.15 m | beside it | handed over (within 1.5 m of the beacon) \
                       | unfinished | from the pad's middle, m: median, 99 %, most | mean time, s |\n";

fn written(flights: u64) -> Result<String, Box<dyn Error>> {
    let mut text = format!(
        "# Landings\n\n\
         `cargo xtask landings` writes this page. [The last metres](../landing.md) says what is flown. Flights of the first table have the\n\
         first seeds of the test range ({}), those of the second the first of the development range ({}):\n\
         `host-sim/src/study/seeds.rs`.\n\n| scene | {COLUMNS}|---|---|---|---|---|---|---|---|---|\n",
        seeds::TEST.start,
        seeds::DEVELOPMENT.start,
    );
    let mut named = String::new();
    for scene in &SCENES {
        eprintln!("{}", scene.name);
        let row = row(scene, seeds::test(flights), |_| ())?;
        line(&mut text, row.scene, &row)?;
        for (what, seeds) in [("collided", &row.collided), ("beside", &row.beside), ("unfinished", &row.unfinished)] {
            if !seeds.is_empty() {
                writeln!(named, "\n{}: {what} with the seeds {seeds:?}.", row.scene)?;
            }
        }
    }
    writeln!(text, "{named}\n{}", constants(flights)?)?;
    Ok(text)
}

fn line(text: &mut String, name: &str, row: &Row) -> Result<(), std::fmt::Error> {
    let handed_over: Vec<String> =
        row.handed_over.iter().map(|(reason, [all, near])| format!("`{reason}` {all} ({near})")).collect();
    let pad_m = row.pad_m.map_or("-".to_owned(), |[median, most, all]| format!("{median:.3}, {most:.3}, {all:.3}"));
    writeln!(
        text,
        "| {name} | {} | {} | {} | {} | {} | {} | {pad_m} | {:.1} |",
        row.flights,
        row.collided.len(),
        row.on_pad,
        row.beside.len(),
        handed_over.join(", "),
        row.unfinished.len(),
        row.time_s
    )
}

/// What the flights come to with one constant changed.
fn constants(flights: u64) -> Result<String, Box<dyn Error>> {
    let mut text = format!(
        "## The constants\n\n\
         Constants of `core/src/landing`, each at two other values, the others as they are, on development seeds.\n\n\
         | constant | value | scene | {COLUMNS}|---|---|---|---|---|---|---|---|---|---|---|\n"
    );
    let seeds = seeds::development(FOR_A_VALUE.min(flights));
    let mut fly = |name: &str, value: &str, tune: &(dyn Fn(&mut guidance::Config) + Sync)| {
        eprintln!("{name} {value}");
        for scene in SCENES.iter().filter(|scene: &&Scene| TRIED.contains(&scene.name)) {
            let row = row(scene, seeds.clone(), tune)?;
            line(&mut text, &format!("{name} | {value} | {}", row.scene), &row)?;
        }
        Ok::<(), Box<dyn Error>>(())
    };
    fly("as they are", "", &|_| ())?;
    for (name, values, set) in &CONSTANTS {
        for value in values {
            fly(name, &value.to_string(), &|config| {
                if let Some(landing) = &mut config.landing {
                    set(landing, *value);
                }
            })?;
        }
    }
    Ok(text)
}
