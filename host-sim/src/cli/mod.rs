//! The command line. Results go to stdout; notes, progress and errors to stderr. Exit status: 0 success, 1 flown
//! but the goal was not reached, 2 bad usage or input.

mod autopilot;
mod bearing;
mod companion;
mod fly;
mod link_state;
mod listen;

mod maps;
mod merge;
mod pad;
mod pages;
mod params;
mod port;
mod radio;
mod records;
mod replay;
mod reproduce;
mod suite;
mod terminal;
mod value;

use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use foxhound_sim::autopilot::tlog;
use foxhound_sim::scenario::input::{InputError, read_bytes};
use foxhound_sim::scenario::output;
use serde::Serialize;

use autopilot::AutopilotCommand;
use bearing::{BearingCommand, CalibrateCommand};
use companion::CompanionCommand;
use fly::Fly;
use link_state::LinkState;
use maps::MapsCommand;
use merge::MergeCommand;
use pad::PadCommand;
use pages::{CompletionsCommand, ManCommand};
use params::ParamsCommand;
use port::PortCommand;
use replay::ReplayCommand;
use reproduce::Reproduce;
use suite::SuiteCommand;
use terminal::{say, show, warn};
use value::whole;

/// Lets a small drone find a radio beacon by itself: direction finding with four antennas, planning among unknown
/// obstacles, velocity setpoints for the autopilot. Without a command, it flies the built-in mission.
#[derive(Debug, Parser)]
#[command(name = "foxhound", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Prints JSON on stdout and nothing else.
    #[arg(long, global = true)]
    json: bool,
    /// Prints no progress and no notes: results, warnings and errors only.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Seed of all random numbers; the same seed gives the same flight.
    #[arg(long, global = true, default_value_t = 1, value_parser = whole::<u64>(0..=u64::MAX))]
    seed: u64,
    /// Folder for output files [default: out; with --json nothing is written unless requested].
    #[arg(long, global = true, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replaces existing results in the folder of --out, an existing page of `listen`, and an existing log of `port`.
    #[arg(long, global = true)]
    force: bool,
}

const EXAMPLES: &str = "Examples:
  foxhound                               a pillar forest; picture in out/flight.svg
  foxhound fly --scenario gate.json --json
  foxhound fly --report flight.html      an interactive page
  foxhound fly --via qemu:firmware.elf   the same flight, the firmware in QEMU
  foxhound companion --autopilot tcp:127.0.0.1:5760 --source 8,-9,-5
  foxhound bearing --adc frames.npy --array array.toml --json
  foxhound calibrate --adc known.npy --array array.toml --azimuth-deg 30
  foxhound tlog f.tlog --json
  foxhound fly --flight-log f.log && foxhound replay f.log
  foxhound port --serial /dev/ttyACM0 --log f.log status
  foxhound maps --out forests && foxhound suite forests/suite.json
  foxhound reproduce all --out papers    every experiment, in one page

Exit status: 0 done as asked; 1 flown, but a goal was not reached; 2 bad usage or input, or a result that could not be \
written; 130 ended by Ctrl-C, 143 by SIGTERM.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Flies one mission in closed loop.
    Fly(Fly),
    /// Flies a real or modelled autopilot over MAVLink, in real time.
    Companion(CompanionCommand),
    /// Runs a modelled autopilot in real time, for use with `companion`.
    Autopilot(AutopilotCommand),
    /// Finds the bearings in a recording.
    Bearing(BearingCommand),
    /// Measures the channels with a known source and writes them into the array file.
    Calibrate(CalibrateCommand),
    /// Writes a page with bearings, spectrum and eigenvalues of a recording, or bearings of a live radio.
    Listen(listen::ListenCommand),
    /// Counts the MAVLink frames of a telemetry log.
    Tlog(TlogCommand),
    /// Flies a flight log again, and compares every step bit for bit.
    Replay(ReplayCommand),
    /// Talks to a flight computer over its maintenance port, and records its flight log.
    Port(PortCommand),
    /// Makes maps of given obstacle density with start/goal pairs, or describes those of a suite file.
    Maps(MapsCommand),
    /// Flies all pairs of a suite file, many at a time.
    Suite(SuiteCommand),
    /// Joins the shards of a suite.
    Merge(MergeCommand),
    /// Lists the parameters, or checks values for them.
    Params(ParamsCommand),
    /// Prints the JSON schema of scenario files, by which an editor completes and checks them.
    #[command(after_help = SCHEMA_HELP)]
    Schema,
    /// Repeats an experiment of a paper, and prints our number beside the paper's.
    Reproduce(Reproduce),
    /// Looks for the landing pad in a picture.
    Pad(PadCommand),
    /// Tests or trains the network that distinguishes a reflected wave from a direct one.
    LinkState(LinkState),
    /// Prints the completions for a shell.
    Completions(CompletionsCommand),
    /// Prints the manual page, or writes the pages of all commands.
    Man(ManCommand),
}

const TLOG_HELP: &str = "Examples:
  foxhound tlog flight.tlog
  foxhound tlog flight.tlog --json | jq .counts
  foxhound tlog --raw capture.bin     bytes of a line, without time stamps";

const SCHEMA_HELP: &str = "Examples:
  foxhound schema > scenario.schema.json
  foxhound schema --json | jq '.properties | keys'

A scenario names the schema in its key $schema, as the files in scenarios/ do; with --json it is one line.";

#[derive(Args, Debug)]
#[command(after_help = TLOG_HELP)]
struct TlogCommand {
    /// The log file.
    file: PathBuf,
    /// The file is a plain byte stream without time stamps.
    #[arg(long)]
    raw: bool,
}

/// The command line. Every option takes negative numbers, so that they are refused with the range that is accepted.
fn parse() -> Result<Cli, clap::Error> {
    fn with_negatives(command: clap::Command) -> clap::Command {
        let takes_number = |arg: &clap::Arg| arg.get_action().takes_values() && !arg.is_positional();
        command
            .mut_args(|arg| if takes_number(&arg) { arg.allow_negative_numbers(true) } else { arg })
            .mut_subcommands(with_negatives)
    }
    Cli::from_arg_matches_mut(&mut with_negatives(Cli::command()).try_get_matches()?)
}

/// Runs the command.
pub(crate) fn run() -> ExitCode {
    if let Err(error) = terminal::survive_limits() {
        warn(&format!("warning: {error}"));
    }
    let cli = match parse() {
        Ok(cli) => cli,
        Err(shown) => {
            let code = u8::try_from(shown.exit_code()).unwrap_or(2);
            // Help goes to stdout, errors to stderr.
            let is_unsaid = shown.print().is_err_and(|error| error.kind() != io::ErrorKind::BrokenPipe);
            return ExitCode::from(if is_unsaid || terminal::unsaid().is_some() { 2 } else { code });
        }
    };
    let done = match &cli.command {
        None => fly::fly(&cli, &Fly::default()),
        Some(Command::Fly(args)) => fly::fly(&cli, args),
        Some(Command::Companion(args)) => companion::companion(&cli, args),
        Some(Command::Autopilot(args)) => autopilot::autopilot(&cli, args),
        Some(Command::Bearing(args)) => bearing::bearing(&cli, args),
        Some(Command::Calibrate(args)) => bearing::calibration(&cli, args),
        Some(Command::Listen(args)) => listen::listen(&cli, args),
        Some(Command::Tlog(args)) => read_log(&cli, args),
        Some(Command::Replay(args)) => replay::replay(&cli, args),
        Some(Command::Port(args)) => port::port(&cli, args),
        Some(Command::Maps(args)) => maps::draw_maps(&cli, args),
        Some(Command::Suite(args)) => suite::fly_suite(&cli, args),
        Some(Command::Merge(args)) => merge::merge(&cli, args),
        Some(Command::Params(args)) => params::params(&cli, args),
        Some(Command::Schema) => print_schema(&cli),
        Some(Command::Reproduce(args)) => reproduce::reproduce(&cli, args),
        Some(Command::LinkState(args)) => link_state::link_state(&cli, args),
        Some(Command::Pad(args)) => pad::pad(&cli, args),
        Some(Command::Completions(args)) => pages::completions(&cli, args),
        Some(Command::Man(args)) => pages::manual(&cli, args),
    };
    match done.and_then(|code| terminal::unsaid().map_or(Ok(code), Err)) {
        Ok(code) => code,
        Err(error) => {
            warn(&format!("error: {error}"));
            ExitCode::from(2)
        }
    }
}

fn json_line(value: &impl Serialize) -> Result<String, InputError> {
    let mut line = serde_json::to_string(value).map_err(|error| InputError::new(error.to_string()))?;
    line.push('\n');
    Ok(line)
}

/// The command line as given.
fn command_line() -> String {
    let mut text = "foxhound".to_owned();
    for argument in std::env::args().skip(1) {
        let is_plain = argument.chars().all(|c| c.is_ascii_alphanumeric() || "-_./:=,+@".contains(c));
        let _ = if is_plain && !argument.is_empty() {
            write!(text, " {argument}")
        } else {
            write!(text, " '{}'", argument.replace('\'', r"'\''"))
        };
    }
    text
}

fn ending(path: &Path) -> Option<&str> {
    path.extension().and_then(|ending| ending.to_str())
}

fn write_text(path: &Path, text: &str) -> Result<(), InputError> {
    output::write(path, text.as_bytes())
}

impl Cli {
    /// Protects previous results: in a folder given by `--out` they are replaced only with `--force`.
    /// The default folder, `out`, holds the last run, so that a command can be repeated; what is replaced there is reported.
    fn claim(&self, path: &Path) -> Result<(), InputError> {
        if path.symlink_metadata().is_ok() && !self.force {
            if self.out.is_some() {
                let text = "is there already; name another folder with --out, or replace it with --force";
                return Err(InputError::new(text).in_file(path));
            }
            self.note(&format!("note: {} of the last run is replaced; --out DIR keeps this one", path.display()));
        }
        output::check_writable(path)
    }
}

/// Checks before the work that its result can be written.
fn check_writable(option: &str, path: Option<&PathBuf>) -> Result<(), InputError> {
    let Some(path) = path else { return Ok(()) };
    output::check_writable(path).map_err(|error| InputError::new(format!("{option} {error}")))
}

fn print_schema(cli: &Cli) -> Result<ExitCode, InputError> {
    let schema = foxhound_sim::scenario::schema();
    if cli.json {
        say(&json_line(&schema)?);
    } else {
        let text = serde_json::to_string_pretty(&schema);
        say(&(text.map_err(|error| InputError::new(error.to_string()))? + "\n"));
    }
    Ok(ExitCode::SUCCESS)
}

fn read_log(cli: &Cli, args: &TlogCommand) -> Result<ExitCode, InputError> {
    let bytes = read_bytes(&args.file)?;
    let summary = if args.raw { tlog::read_raw(&bytes) } else { tlog::read_stamped(&bytes) };
    if summary.frames == 0 {
        let count = bytes.len();
        let text = format!(
            "no MAVLink frame in {count} bytes; a telemetry log has one behind every time stamp (--raw: no stamps)"
        );
        return Err(InputError::new(text).in_file(&args.file));
    }
    if cli.json {
        say(&json_line(&summary)?);
    } else {
        let mut text = format!(
            "{} frames, {} with a wrong checksum, {} bytes skipped\n",
            summary.frames, summary.bad_crc, summary.skipped_bytes
        );
        if summary.mavlink_1 > 0 {
            let _ = writeln!(text, "{:>8}  of them MAVLink 1", summary.mavlink_1);
        }
        for (id, count) in &summary.counts {
            let name = summary.names.get(id).copied().unwrap_or("unknown to the ArduPilot dialect");
            let _ = writeln!(text, "{count:>8}  message {id:<5} {name}");
        }
        show(&text);
    }
    Ok(ExitCode::SUCCESS)
}
