//! `foxhound merge`: joins the shards of a suite.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use foxhound_sim::drive::suite::shard::{Part, merge as put_together};
use foxhound_sim::scenario::input::{InputError, read_text};

use super::Cli;
use super::suite::{TableArgs, show, write_flights};
use super::value::check_apart;

const MERGE_HELP: &str =
    "The files are those of `foxhound suite --shard`, all N of them, in any order, of one suite with one seed. Prints \
what the whole suite prints; with --out, flights.jsonl is what the whole suite writes, and so are the tables.

Examples:
  for k in 1 2 3 4; do foxhound suite suite.json --shard $k/4 --out shards; done
  foxhound merge shards/*.jsonl --json

Exit status: 0 every flight reached the beacon; 1 not every one, or one collided; 2 bad usage or input.";

#[derive(Args, Debug)]
#[command(after_help = MERGE_HELP)]
pub(super) struct MergeCommand {
    /// The shards.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    tables: TableArgs,
}

pub(super) fn merge(cli: &Cli, args: &MergeCommand) -> Result<ExitCode, InputError> {
    let shards = args.files.iter().map(|path| ("a shard", Some(path.as_path())));
    for shard in shards {
        let [csv, parquet] = args.tables.files();
        check_apart(&[shard, csv, parquet])?;
    }
    args.tables.check()?;
    if let Some(folder) = &cli.out {
        cli.claim(&folder.join("flights.jsonl"))?;
    }
    let read = |path: &PathBuf| Part::parse(&read_text(path)?).map_err(|error| error.in_file(path));
    let parts: Result<Vec<Part>, InputError> = args.files.iter().map(read).collect();
    let flown = put_together(parts?)?;
    let code = show(cli, &flown)?;
    args.tables.write(cli, &flown)?;
    if let Some(folder) = &cli.out {
        write_flights(cli, folder, &flown)?;
    }
    Ok(code)
}
