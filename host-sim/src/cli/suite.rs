//! `foxhound suite`: all flights of a suite file.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::HostComputer;
use foxhound_sim::drive::flight::Ending;
use foxhound_sim::drive::suite::journal::{self, Before, Journal};
use foxhound_sim::drive::suite::shard::{self, Shard};
use foxhound_sim::drive::suite::{self, Flight, Flown, Selection, Suite};
use foxhound_sim::record::plot;
use foxhound_sim::record::table;
use foxhound_sim::scenario::input::{DRONE_RADIUS_M, InputError, SIGMA_DEG, SNR_DB, check_within};
use foxhound_sim::scenario::{VehicleModel, output};

use super::fly::{estimator_parser, planner_parser};
use super::terminal::{interrupted, say, stop_flag, warn};
use super::value::{check_apart, number, whole};
use super::{Cli, check_writable, json_line, terminal, write_text};

/// Flights that missed and are named on the terminal.
const MISSES_SHOWN: usize = 20;

const SUITE_HELP: &str = "A suite is JSON: x east, y north, metres, degrees:
  drone_radius, bounds, sensor, bearing, limits, vehicle, goal_tolerance,
  max_time_s (all as in a scenario),
  maps [{row, instance, obstacles [[x,y,r],...],
    pairs [[x0,y0,x1,y1,reference_length],...]}]

Each pair is one flight, as `foxhound fly` flies it, with a seed made of --seed, row, instance and pair. The numbers do \
not depend on --jobs. With --out, flights.jsonl holds a line for each flight; --only ROW,INSTANCE,PAIR flies one of \
them again, and writes its scenario and its picture there.

--shard K/N flies every Nth flight from the Kth on, on whatever machine, and writes DIR/shard-K-of-N.jsonl; `foxhound \
merge` puts all N together to what the whole suite prints, and writes its tables.

What was flown is kept as it is flown, in suite-HASH.journal in the folder of --out (with --json only where --out or \
--resume is given), until the results are written. With --resume a suite that was ended in any way, by Ctrl-C or a power \
cut, goes on where it was; its results are those of the suite in one piece, byte for byte.

Examples:
  foxhound suite suite.json
  foxhound suite suite.json --resume     after it was ended
  foxhound suite suite.json --planner paper --only 4 --pairs 10
  foxhound suite suite.json --only 4,2,17 --out failed
  foxhound suite suite.json --bearing-sigma-deg 20 --json
  foxhound suite suite.json --shard 3/8 --out shards
  foxhound suite suite.json --parquet flights.parquet

Exit status: 0 every flight reached the beacon; 1 not every one, or one collided; 2 bad usage or input, or a file that could \
not be written; 130 ended by Ctrl-C, 143 by SIGTERM.";

#[derive(Args, Debug)]
#[command(after_help = SUITE_HELP)]
pub(super) struct SuiteCommand {
    /// Suite file; `foxhound maps` writes one.
    file: PathBuf,
    /// Flights at a time [default: as many as there are processors].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=1024))]
    jobs: Option<u32>,
    /// Planner: `foxhound`, ours; `paper`, the main paper's, and `standard`, its baseline, with variants; the others are the baseline
    /// in the potential field of that name.
    #[arg(long, value_parser = planner_parser(), default_value = "foxhound", value_name = "PLANNER")]
    planner: planner::Config,
    /// Which angle-of-arrival estimator.
    #[arg(long, value_parser = estimator_parser(), default_value = "cross", value_name = "ESTIMATOR")]
    estimator: Estimator,
    /// Only these flights.
    #[arg(
        long,
        value_name = "ROW[,INSTANCE[,PAIR]]",
        value_delimiter = ',',
        value_parser = whole::<u32>(0..=u32::MAX.into())
    )]
    only: Vec<u32>,
    /// Resumes the same suite with the same options where it was interrupted, in the same folder of --out.
    #[arg(long)]
    resume: bool,
    /// Only the first so many pairs of each map.
    #[arg(long, value_name = "P", value_parser = whole::<u32>(0..=u32::MAX.into()))]
    pairs: Option<u32>,
    /// Only the Kth of N parts, which `foxhound merge` puts together; it is written to the folder of --out.
    #[arg(long, value_name = "K/N", conflicts_with_all = ["csv", "parquet"])]
    shard: Option<Shard>,
    /// Radius of the vehicle, metres; overrules the file.
    #[arg(long, value_name = "M", value_parser = number(DRONE_RADIUS_M))]
    drone_radius: Option<f64>,
    /// Vehicle model; overrules the file.
    #[arg(long, value_enum)]
    vehicle: Option<VehicleModel>,
    /// Bearings with this much noise; overrules the file.
    #[arg(long, value_name = "DEG", value_parser = number(SIGMA_DEG), conflicts_with = "snr_db")]
    bearing_sigma_deg: Option<f64>,
    /// Antenna waveforms at this signal-to-noise ratio per sample, in dB; overrules the file.
    #[arg(long, value_name = "DB", value_parser = number(SNR_DB))]
    snr_db: Option<f64>,
    #[command(flatten)]
    tables: TableArgs,
}

/// Tables of the flights.
#[derive(Args, Debug)]
pub(super) struct TableArgs {
    /// Writes a table of the flights as CSV, a row for each: docs/simulator.md lists the columns.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// The same as Parquet, for pandas and polars.
    #[arg(long, value_name = "FILE")]
    parquet: Option<PathBuf>,
}

impl TableArgs {
    /// Each file with its option.
    pub(super) fn files(&self) -> [(&'static str, Option<&Path>); 2] {
        [("--csv", self.csv.as_deref()), ("--parquet", self.parquet.as_deref())]
    }

    /// Checks before the work that they can be written.
    pub(super) fn check(&self) -> Result<(), InputError> {
        check_writable("--csv", self.csv.as_ref())?;
        check_writable("--parquet", self.parquet.as_ref())
    }

    /// Writes them.
    pub(super) fn write(&self, cli: &Cli, flown: &[Flown]) -> Result<(), InputError> {
        if let Some(path) = &self.csv {
            write_text(path, &table::csv(flown))?;
            cli.note(&format!("table: {}", path.display()));
        }
        if let Some(path) = &self.parquet {
            let table = table::parquet(flown).map_err(|error| output::failed(path, &error))?;
            output::write(path, &table)?;
            cli.note(&format!("table: {}", path.display()));
        }
        Ok(())
    }
}

/// The suite as it is in the file, with what the command line overrules.
fn suite_of(args: &SuiteCommand) -> Result<Suite, InputError> {
    let [csv, parquet] = args.tables.files();
    check_apart(&[("the suite", Some(&args.file)), csv, parquet])?;
    let mut suite = Suite::read(&args.file)?;
    if let Some(radius_m) = args.drone_radius {
        check_within("--drone-radius", radius_m, &DRONE_RADIUS_M)?;
        suite.drone_radius = radius_m;
    }
    if let Some(sigma_deg) = args.bearing_sigma_deg {
        suite.bearing.set_sigma_deg("--bearing-sigma-deg", sigma_deg)?;
    }
    if let Some(snr_db) = args.snr_db {
        suite.bearing.set_snr_db("--snr-db", snr_db)?;
    }
    if let Some(vehicle) = args.vehicle {
        suite.vehicle.model = vehicle;
    }
    Ok(suite)
}

pub(super) fn fly_suite(cli: &Cli, args: &SuiteCommand) -> Result<ExitCode, InputError> {
    let suite = suite_of(args)?;
    let selection = Selection { only: args.only.clone(), pairs: args.pairs, shard: args.shard };
    let count = suite.count(&selection).map_err(|error| error.in_file(&args.file))?;
    let flights = suite.flights(cli.seed, &selection);
    let (planner, estimator) = (args.planner, args.estimator);
    // Refused once, not by every worker; a shard of a small suite may be empty.
    if let Some(first) = flights.first() {
        HostComputer::new(&first.mission(planner, estimator).guidance())?;
    }

    args.tables.check()?;
    let processors = || std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or_else(processors, |jobs| jobs as usize);
    let progress = cli.bar("flying", flights.len() as u64, "");
    let failed = std::sync::atomic::AtomicUsize::new(0);
    let header = args
        .shard
        .unwrap_or_else(Shard::whole)
        .header(count, shard::fingerprint(&suite, &selection, cli.seed, planner, estimator)?);
    claim_results(cli, args, &flights)?;
    let journal = journal_of(cli, args, &header)?;
    let before = journal.as_ref().map(|journal| journal.flown().clone()).unwrap_or_default();
    progress.inc(before.len() as u64);
    let rest: Vec<(usize, &Flight)> =
        flights.iter().enumerate().filter(|(number, _)| !before.contains_key(number)).collect();
    let stop = stop_flag()?;
    let flown = suite::fly_until(&rest, planner, estimator, jobs, &stop, |number, flown| {
        if let Some(journal) = &journal {
            journal.add(number, flown)?;
        }
        if flown.result != Ending::Reached {
            let count = failed.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress.set_message(format!(", {count} not reached"));
        }
        progress.inc(1);
        Ok(())
    });
    progress.finish_and_clear();
    let now = rest.iter().zip(flown?).filter_map(|((number, _), flown)| Some((*number, flown?)));
    let mut flown = before;
    flown.extend(now);
    let done = flown.len();
    let flown: Vec<Flown> = flown.into_values().collect();
    let code = show(cli, &flown)?;
    if done < flights.len() {
        let kept = match &journal {
            Some(journal) => format!("kept in {}, --resume goes on", journal.path().display()),
            None => "with --json they are kept only where --out or --resume is given".to_owned(),
        };
        warn(&format!("interrupted after {done} of {} flights: {kept}", flights.len()));
        return Ok(interrupted());
    }
    write_results(cli, args, &header, &flights, &flown)?;
    if let Some(journal) = journal {
        let folder = journal.path().parent().map(Path::to_path_buf);
        journal.remove()?;
        // Nothing else may be in it, where nothing was to be written.
        let _ = folder.filter(|_| cli.out.is_none()).map(std::fs::remove_dir);
    }
    Ok(code)
}

/// The journal of the flights, if one is kept.
fn journal_of(cli: &Cli, args: &SuiteCommand, header: &shard::Header) -> Result<Option<Journal>, InputError> {
    let is_asked = cli.out.is_some() || args.resume || args.shard.is_some();
    if cli.json && !is_asked {
        return Ok(None);
    }
    let folder = cli.out.as_deref().unwrap_or_else(|| Path::new("out"));
    if !is_asked && let Err(error) = std::fs::create_dir_all(folder) {
        cli.note(&format!("note: {}: {error}: what is flown is not kept if this is ended", folder.display()));
        return Ok(None);
    }
    // A shard is the same every time, so one that was begun elsewhere may be handed out again.
    let before = match (args.resume || args.shard.is_some(), cli.force) {
        (true, _) => Before::Resume,
        (false, true) => Before::Discard,
        (false, false) => Before::Refuse,
    };
    let journal = Journal::open(folder, &journal::Header::new(header.clone()), before)?;
    if args.resume {
        let (done, path) = (journal.flown().len(), journal.path().display());
        cli.note(&match done {
            0 => format!("nothing of this suite with these options was flown in {}: it begins", folder.display()),
            _ => format!("goes on after {done} flights of {path}"),
        });
    }
    Ok(Some(journal))
}

/// Checks before the flights that their results can be written.
fn claim_results(cli: &Cli, args: &SuiteCommand, flights: &[Flight]) -> Result<(), InputError> {
    // A resumed suite may have been interrupted while it wrote these; a shard is the same every time.
    let Some(folder) = cli.out.as_ref().filter(|_| !args.resume && args.shard.is_none()) else { return Ok(()) };
    cli.claim(&folder.join("flights.jsonl"))?;
    match flights {
        [flight] => ["json", "svg"].iter().try_for_each(|ending| cli.claim(&path_of(folder, flight, ending))),
        _ => Ok(()),
    }
}

fn path_of(folder: &Path, flight: &Flight, ending: &str) -> PathBuf {
    let suite::Place { row, instance, pair } = flight.place;
    folder.join(format!("flight-{row}-{instance}-{pair}.{ending}"))
}

/// Writes all requested files.
fn write_results(
    cli: &Cli,
    args: &SuiteCommand,
    header: &shard::Header,
    flights: &[Flight],
    flown: &[Flown],
) -> Result<(), InputError> {
    if let Some(shard) = args.shard {
        let folder = cli.out.as_deref().unwrap_or_else(|| Path::new("out"));
        let path = folder.join(shard.file_name());
        write_text(&path, &(json_line(header)? + &lines(flown)?))?;
        cli.note(&format!("shard: {}", path.display()));
        return Ok(());
    }
    args.tables.write(cli, flown)?;
    if let Some(folder) = &cli.out {
        write_flights(cli, folder, flown)?;
        if let [flight] = flights {
            let path = |ending: &str| path_of(folder, flight, ending);
            write_text(&path("json"), &json_line(&flight.scenario)?)?;
            let (_, record) = flight.fly(args.planner, args.estimator)?;
            plot::draw(&record, &path("svg"))?;
            cli.note(&format!("picture: {}", path("svg").display()));
            cli.note(&format!("again: foxhound fly --scenario {} --seed {}", path("json").display(), flight.seed));
        }
    }
    Ok(())
}

/// Says what flights came to; whether all did as they should.
pub(super) fn show(cli: &Cli, flown: &[Flown]) -> Result<ExitCode, InputError> {
    let report = suite::Report::of(flown);
    if cli.json {
        say(&json_line(&report)?);
    } else {
        terminal::show(&report.table());
    }
    let missed: Vec<&Flown> = flown.iter().filter(|flown| flown.result != Ending::Reached).collect();
    if !cli.json {
        for miss in missed.iter().take(MISSES_SHOWN) {
            let suite::Place { row, instance, pair } = miss.place;
            cli.note(&format!("--only {row},{instance},{pair}  {} after {:.1} s", miss.outcome(), miss.time_s));
        }
        if missed.len() > MISSES_SHOWN {
            cli.note(&format!("and {} more", missed.len() - MISSES_SHOWN));
        }
    }
    let all_reached = report.all.success == report.all.runs && report.all.collisions == 0;
    Ok(if all_reached { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// A line for each flight.
fn lines(flown: &[Flown]) -> Result<String, InputError> {
    flown.iter().map(json_line).collect()
}

/// Writes a line for each flight.
pub(super) fn write_flights(cli: &Cli, folder: &Path, flown: &[Flown]) -> Result<(), InputError> {
    let path = folder.join("flights.jsonl");
    write_text(&path, &lines(flown)?)?;
    cli.note(&format!("flights: {}", path.display()));
    Ok(())
}
