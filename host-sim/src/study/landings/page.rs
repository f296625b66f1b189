//! Flights to their very end, on held-out seeds, and constants of `core/src/landing`, each around its value, on development
//! seeds: the page `docs/results/landings.md`. On development seeds it is the constants only.

use std::fmt::Write as _;

use foxhound_core::{guidance, landing};

use super::{Row, SCENES, Scene, row};
use crate::scenario::input::InputError;
use crate::study::{Campaign, seeds};

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

/// Flies all of it and writes the page.
///
/// # Errors
/// A scenario is refused, or a flight cannot be flown.
pub fn page(settings: &Campaign) -> Result<String, InputError> {
    let &Campaign { flights, is_development, tell } = settings;
    if is_development { constants(flights, tell) } else { written(flights, tell) }
}

const COLUMNS: &str = "flights | collisions | on the pad, to 0.15 m | beside it | handed over (within 1.5 m of the beacon) \
                       | unfinished | from the pad's middle, m: median, 99 %, most | mean time, s |\n";

fn written(flights: u64, tell: fn(&str)) -> Result<String, InputError> {
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
        tell(scene.name);
        let row = row(scene, seeds::test(flights), |_| ())?;
        line(&mut text, row.scene, &row);
        for (what, seeds) in [("collided", &row.collided), ("beside", &row.beside), ("unfinished", &row.unfinished)] {
            if !seeds.is_empty() {
                let _ = writeln!(named, "\n{}: {what} with the seeds {seeds:?}.", row.scene);
            }
        }
    }
    let _ = writeln!(text, "{named}\n{}", constants(flights, tell)?);
    Ok(text)
}

fn line(text: &mut String, name: &str, row: &Row) {
    let handed_over: Vec<String> =
        row.handed_over.iter().map(|(reason, [all, near])| format!("`{reason}` {all} ({near})")).collect();
    let pad_m = row.pad_m.map_or("-".to_owned(), |[median, most, all]| format!("{median:.3}, {most:.3}, {all:.3}"));
    let _ = writeln!(
        text,
        "| {name} | {} | {} | {} | {} | {} | {} | {pad_m} | {:.1} |",
        row.flights,
        row.collided.len(),
        row.on_pad,
        row.beside.len(),
        handed_over.join(", "),
        row.unfinished.len(),
        row.time_s
    );
}

/// Results of the flights with one constant changed.
fn constants(flights: u64, tell: fn(&str)) -> Result<String, InputError> {
    let mut text = format!(
        "## The constants\n\n\
         Constants of `core/src/landing`, each at two other values, the others as they are, on development seeds.\n\n\
         | constant | value | scene | {COLUMNS}|---|---|---|---|---|---|---|---|---|---|---|\n"
    );
    let seeds = seeds::development(FOR_A_VALUE.min(flights));
    let mut fly = |name: &str, value: &str, tune: &(dyn Fn(&mut guidance::Config) + Sync)| {
        tell(&format!("{name} {value}"));
        for scene in SCENES.iter().filter(|scene: &&Scene| TRIED.contains(&scene.name)) {
            let row = row(scene, seeds.clone(), tune)?;
            line(&mut text, &format!("{name} | {value} | {}", row.scene), &row);
        }
        Ok::<(), InputError>(())
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
