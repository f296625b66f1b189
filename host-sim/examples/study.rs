//! Studies of many flights, each of which is a page of `docs/results`. `cargo xtask gusts`, `landings` and `campaign` run
//! it: the study, how many flights, what else it needs, the page. With `development`, or settings by name, behind them the
//! page goes onto standard output. `worlds` prints those that `cargo xtask compare` flies, each in a line of JSON.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use foxhound_sim::scenario::Scenario;
use foxhound_sim::scenario::input::InputError;
use foxhound_sim::study::gusts::page as gusts;
use foxhound_sim::study::landings::{SCENES, page as landings};
use foxhound_sim::study::matrix::{World, barn, forests, gusty, page as matrix, pillars, thickets, traps};
use foxhound_sim::study::{Campaign, seeds};
use serde_json::{Value, json};

const USAGE: &str = "gusts FLIGHTS PAGE [development] | landings FLIGHTS PAGE [development] \
    | matrix TIMES BARN PAGE [SETTING] | worlds FLIGHTS TRAPS BARN";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let campaign = |flights: &str, usual, rest: &[&str]| Campaign {
        flights: flights.parse().unwrap_or(usual),
        is_development: !rest.is_empty(),
        tell,
    };
    let done = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["gusts", flights, page, ref rest @ ..] => written(gusts::page(&campaign(flights, 240, rest)), page, rest),
        ["landings", flights, page, ref rest @ ..] => {
            written(landings::page(&campaign(flights, 200, rest)), page, rest)
        }
        ["matrix", times, barn, page, ref rest @ ..] if rest.len() < 2 => {
            let (times, only) = (times.parse().unwrap_or(1), rest.concat());
            written(matrix::page(&matrix::Settings { times, barn: barn.into(), only, tell }), page, rest)
        }
        ["worlds", flights, traps, barn] => worlds(flights.parse().unwrap_or(100), traps, barn),
        _ => {
            eprintln!("usage: study {USAGE}");
            return ExitCode::from(2);
        }
    };
    if let Err(error) = done {
        eprintln!("{}: {error}", arguments[0]);
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// Writes a text to its page, or with more behind it onto standard output.
fn written(text: Result<String, InputError>, page: &str, rest: &[&str]) -> Result<(), Box<dyn Error>> {
    let text = text?;
    if rest.is_empty() {
        return Ok(std::fs::write(page, text)?);
    }
    println!("{text}");
    Ok(())
}

/// Prints about so many worlds of each kind, all on held-out seeds; of BARN's at most every second of those that there are.
fn worlds(flights: u64, trap_folder: &str, barn_folder: &str) -> Result<(), Box<dyn Error>> {
    let (hull_m, all) = (0.15, seeds::test(flights));
    let mut kinds = vec![
        ("forest", forests(hull_m, seeds::test(flights.div_ceil(4)), 4)?),
        ("pillars", pillars(all.clone())?),
        ("corridor", thickets(all.clone())?),
        ("trap", traps(Path::new(trap_folder), &seeds::test(flights.div_ceil(25)))?),
        ("gusts", gusty(seeds::test(flights.div_ceil(3)))?),
    ];
    if let Some(worlds) = barn(Path::new(barn_folder), hull_m, &seeds::TEST, 1)? {
        let nth = worlds.len().div_ceil(flights as usize).max(1);
        kinds.push(("barn", worlds.into_iter().step_by(nth).collect()));
    }
    for scene in &SCENES {
        let world = |seed| Ok(World { scenario: scene.scenario(seed)?, seed, shortest_m: None });
        kinds.push((scene.name, seeds::test(flights.div_ceil(4)).map(world).collect::<Result<_, InputError>>()?));
    }
    let usual = serde_json::to_value(Scenario::default())?;
    for (kind, worlds) in kinds {
        for World { scenario, seed, shortest_m } in worlds {
            let mut scenario = serde_json::to_value(scenario)?;
            leave_out(&mut scenario, &usual);
            println!("{}", json!({"kind": kind, "seed": seed, "shortest_m": shortest_m, "scenario": scenario}));
        }
    }
    Ok(())
}

/// Leaves out what is as usual: a build of before need not know it. Where its usual is another, it flies another world.
fn leave_out(value: &mut Value, usual: &Value) {
    let (Some(values), Some(usual)) = (value.as_object_mut(), usual.as_object()) else { return };
    values.retain(|key, value| {
        let usual = usual.get(key);
        usual.into_iter().for_each(|usual| leave_out(value, usual));
        usual != Some(value) && *value != json!({})
    });
}

fn tell(line: &str) {
    eprintln!("{line}");
}
