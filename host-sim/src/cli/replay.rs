//! `foxhound replay`: flies a flight log again.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use foxhound_sim::drive::replay::{self, Summary};
use foxhound_sim::scenario::input::{InputError, read_bytes};
use serde::Serialize;

use super::terminal::{BAD, GOOD, say, show_as};
use super::{Cli, json_line};

const REPLAY_HELP: &str =
    "The log is a file of `fly --flight-log` or of `port --log`, or any capture of the maintenance port.

Examples:
  foxhound fly --flight-log flight.log && foxhound replay flight.log
  foxhound replay flight.log --json | jq .first_difference_s

Exit status: 0 every step is the same, bit for bit, up to the end of the log, which may be cut; 1 one is not, the front end \
finds another bearing in its samples, or frames are missing; 2 there is no flight log.";

#[derive(Args, Debug)]
#[command(after_help = REPLAY_HELP)]
pub(super) struct ReplayCommand {
    /// The log file.
    file: PathBuf,
}

/// What is printed as JSON.
#[derive(Serialize)]
struct Told<'a> {
    verdict: String,
    #[serde(flatten)]
    summary: &'a Summary,
}

pub(super) fn replay(cli: &Cli, args: &ReplayCommand) -> Result<ExitCode, InputError> {
    let bytes = read_bytes(&args.file)?;
    let summary = replay::replay(&bytes).map_err(|error| error.in_file(&args.file))?;
    let is_identical = summary.is_identical();
    if cli.json {
        say(&json_line(&Told { verdict: summary.verdict(), summary: &summary })?);
    } else {
        show_as(if is_identical { GOOD } else { BAD }, &words(&summary));
    }
    Ok(if is_identical { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// A summary for people.
fn words(summary: &Summary) -> String {
    let Summary { frames, rubbish, gaps, frames_missing, flights, steps, late_steps, codes_checked, codes_off, .. } =
        summary;
    let verdict = summary.verdict();
    format!(
        "{verdict}\n  flights          {flights}, {steps} steps, {late_steps} late\n  frames           {frames}, {frames_missing} \
         missing in {gaps} gaps, {rubbish} pieces of other data\n  front end        {codes_checked} frames checked, \
         {codes_off} off\n  trace            {}\n",
        summary.trace_hash
    )
}
