//! Studies of many flights, each of which is a page of `docs/results`. `cargo xtask gusts`, `landings` and `campaign` run
//! it: the study, how many flights, what else it needs, the page. With `development`, or settings by name, behind them the
//! page goes onto standard output.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::error::Error;
use std::process::ExitCode;

use foxhound_sim::study::gusts::page as gusts;
use foxhound_sim::study::landings::page as landings;
use foxhound_sim::study::matrix::page as matrix;
use foxhound_sim::study::{Campaign, Study};

const USAGE: &str =
    "gusts FLIGHTS PAGE [development] | landings FLIGHTS PAGE [development] | matrix TIMES BARN PAGE [SETTING]";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["gusts", flights, page, ref rest @ ..] => campaign::<gusts::Page>(flights.parse().unwrap_or(240), page, rest),
        ["landings", flights, page, ref rest @ ..] => {
            campaign::<landings::Page>(flights.parse().unwrap_or(200), page, rest)
        }
        ["matrix", times, barn, page, ref rest @ ..] if rest.len() < 2 => {
            let (times, only) = (times.parse().unwrap_or(1), rest.concat());
            written::<matrix::Page>(&matrix::Settings { times, barn: barn.into(), only, tell }, page, !rest.is_empty())
        }
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

fn campaign<S: Study<Settings = Campaign>>(flights: u64, page: &str, rest: &[&str]) -> Result<(), Box<dyn Error>> {
    let is_development = !rest.is_empty();
    written::<S>(&Campaign { flights, is_development, tell }, page, is_development)
}

fn written<S: Study>(settings: &S::Settings, page: &str, is_shown: bool) -> Result<(), Box<dyn Error>> {
    let text = S::run(settings, &|_| ())?.table();
    if is_shown {
        println!("{text}");
        return Ok(());
    }
    Ok(std::fs::write(page, text)?)
}

fn tell(line: &str) {
    eprintln!("{line}");
}
