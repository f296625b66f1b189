//! `foxhound params`: prints the table of parameters, or checks values.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use foxhound_core::guidance::param::{Id, Kind, TABLE};
use foxhound_sim::scenario::input::InputError;
use foxhound_sim::scenario::params::{Given, page, range};
use serde::Serialize;

use super::terminal::{say, show};
use super::{Cli, json_line};

const PARAMS_HELP: &str = "A file has one NAME = VALUE per line, as in `FH_SPD_MAX = 2.0`. Values are checked one by one and all together, as a \
vehicle would check them; an error names the parameter and what would be accepted.

Examples:
  foxhound params
  foxhound params --set FH_SPD_MAX=2 --set FH_RADIUS=0.25
  foxhound params --file quad.toml --json
  foxhound fly --params quad.toml
  foxhound params --markdown > docs/parameters.md";

#[derive(Args, Debug)]
#[command(after_help = PARAMS_HELP)]
pub(super) struct ParamsCommand {
    /// Prints the page of the manual.
    #[arg(long, conflicts_with_all = ["set", "file", "json"])]
    markdown: bool,
    /// Sets a value, after those of the file.
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Takes the values of this TOML file.
    #[arg(long, value_name = "FILE")]
    file: Option<PathBuf>,
}

#[derive(Serialize)]
struct Line {
    index: usize,
    name: &'static str,
    value: f32,
    default: f32,
    unit: &'static str,
    min: f32,
    max: f32,
    whole: bool,
    doc: &'static str,
}

#[derive(Serialize)]
struct Report {
    params: Vec<Line>,
}

impl Report {
    fn table(&self) -> String {
        let mut text = format!("{:<16} {:>9} {:<8} {:<18} what it does\n", "name", "value", "unit", "range");
        for (line, row) in self.params.iter().zip(TABLE) {
            let changed =
                if line.value == line.default { String::new() } else { format!(" (default {})", line.default) };
            let _ = writeln!(
                text,
                "{:<16} {:>9} {:<8} {:<18} {}{changed}",
                line.name,
                line.value,
                line.unit,
                range(row),
                line.doc
            );
        }
        text
    }
}

pub(super) fn params(cli: &Cli, args: &ParamsCommand) -> Result<ExitCode, InputError> {
    if args.markdown {
        say(&page());
        return Ok(ExitCode::SUCCESS);
    }
    let mut given = Given::default();
    if let Some(path) = &args.file {
        given.read(path)?;
    }
    for assignment in &args.set {
        given.assign(assignment).map_err(|error| InputError::new(format!("--set {error}")))?;
    }
    given.check()?;
    let lines = Id::all().zip(TABLE).map(|(id, row)| Line {
        index: id.index(),
        name: row.name,
        value: given.values().get(id),
        default: row.default,
        unit: row.unit,
        min: row.min,
        max: row.max,
        whole: row.kind == Kind::Whole,
        doc: row.doc,
    });
    let report = Report { params: lines.collect() };
    if cli.json {
        say(&json_line(&report)?);
    } else {
        show(&report.table());
    }
    Ok(ExitCode::SUCCESS)
}
