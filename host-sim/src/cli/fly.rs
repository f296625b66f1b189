//! `foxhound fly`: one mission in closed loop.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anstyle::Style;
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use foxhound_computer::twin::Setup;
use foxhound_core::doa::bearing::Estimator;
use foxhound_core::planning::planner;
use foxhound_papers::apf;
use foxhound_sim::drive::computer::Computer;
use foxhound_sim::drive::flight::{self, Ending, Mission, Report};
use foxhound_sim::drive::g474::{self, G474Computer, Needs};
use foxhound_sim::drive::qemu::QemuComputer;
use foxhound_sim::record::plot;
use foxhound_sim::record::report::Beside;
use foxhound_sim::scenario::input::{InputError, SNR_DB, SPEED, check_within};
use foxhound_sim::scenario::output;
use foxhound_sim::scenario::params::Given;
use foxhound_sim::scenario::{Scenario, SensorModel};

use super::records::{Pace, RecordArgs, Written};
use super::terminal::{BAD, GOOD, HALF, interrupted, say, show_as, stop_flag};
use super::value::{check_apart, number};
use super::{Cli, check_writable, ending, json_line};

const FLY_HELP: &str = "Examples:
  foxhound fly --seed 7 --plot flight.png
  foxhound fly --snr-db 0 --planner paper --json
  foxhound fly --scenario gate.json --tlog flight.tlog
  foxhound fly --report flight.html
  foxhound fly --mcap flight.mcap
  foxhound fly --live --speed 2    watch it in a browser as it flies

A scenario is JSON: x east, y north, metres, seconds, degrees; every key has a default, an unknown one is an error. `foxhound schema` \
prints all of them as a JSON schema, for an editor too; scenarios/ has examples of every kind.";

#[derive(Args, Debug, Default)]
#[command(after_help = FLY_HELP)]
pub(super) struct Fly {
    /// Scenario file [default: the built-in pillar forest].
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Planner: `foxhound`, ours; `paper`, the main paper's, and `standard`, its baseline, with variants; the
    /// others are the baseline with the potential field of that name.
    #[arg(long, value_parser = planner_parser(), default_value = "foxhound", value_name = "PLANNER")]
    planner: planner::Config,
    /// Angle-of-arrival estimator.
    #[arg(long, value_parser = estimator_parser(), default_value = "cross", value_name = "ESTIMATOR")]
    estimator: Estimator,
    /// Flight computer: `host`; `qemu:ELF`, a firmware image in QEMU; `g474:ELF`, the image of the NUCLEO-G474RE in
    /// an instruction emulator (docs/contributing.md).
    #[arg(long, value_name = "COMPUTER", default_value = "host")]
    via: Via,
    /// Signal-to-noise ratio per sample of the antenna waveforms, in dB; overrides the scenario.
    #[arg(long, value_name = "DB", value_parser = number(SNR_DB))]
    snr_db: Option<f64>,
    /// File of parameters, as for `foxhound params`; they override the scenario.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Picture of the flight, .svg or .png [default: flight.svg in the output folder].
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    records: RecordArgs,
    /// Speed of the flight with `--live`, as a multiple of real time.
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = number(SPEED), requires = "live")]
    speed: f64,
    /// Flight log, for `foxhound replay`; with `qemu:ELF` the log that the firmware's maintenance port sent.
    #[arg(long, value_name = "FILE")]
    flight_log: Option<PathBuf>,
}

/// The estimators: name on the command line, and what it is.
const ESTIMATORS: [(&str, Estimator, &str); 8] = [
    ("cross", Estimator::CrossSpectrum, "Cross-spectra and least squares"),
    ("paper", Estimator::PaperSquare, "The main paper's algorithm, literally"),
    (
        "paper-repaired",
        Estimator::PaperRepaired,
        "The same, with the half-plane chosen by the magnitudes of its angles",
    ),
    ("paper-correlated", Estimator::PaperCorrelated, "The same, with the half-plane chosen by cross-correlation"),
    ("pair", Estimator::Pair, "The main paper's arcsine of one pair, with its side chosen by cross-correlation"),
    ("two-array", Estimator::TwoArray, "The main paper's intersection of two pairs' directions"),
    ("three-antenna", Estimator::ThreeAntenna, "The main paper's intersection of two pairs that share an antenna"),
    ("n-array", Estimator::NArray, "The main paper's least-squares intersection of all neighbours' directions"),
];

/// An estimator by its name, as clap wants it.
pub(super) fn estimator_parser() -> impl TypedValueParser<Value = Estimator> {
    let names = ESTIMATORS.map(|(name, _, what)| PossibleValue::new(name).help(what));
    PossibleValuesParser::new(names).try_map(|name| {
        let row = ESTIMATORS.into_iter().find(|(known, ..)| *known == name);
        row.map(|(_, estimator, _)| estimator).ok_or("there is no such estimator")
    })
}

/// A planner by its name, as clap wants it.
pub(super) fn planner_parser() -> impl TypedValueParser<Value = planner::Config> {
    PossibleValuesParser::new(apf::NAMES).try_map(|name| apf::named(&name).ok_or("there is no such planner"))
}

#[derive(Clone, Debug, Default)]
pub(super) enum Via {
    #[default]
    Host,
    Qemu(PathBuf),
    G474(PathBuf),
}

impl std::str::FromStr for Via {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "host" => Ok(Self::Host),
            Some(("qemu", elf)) if !elf.is_empty() => Ok(Self::Qemu(elf.into())),
            Some(("g474", elf)) if !elf.is_empty() => Ok(Self::G474(elf.into())),
            _ => Err("expected `host`, `qemu:ELF` or `g474:ELF`".to_owned()),
        }
    }
}

pub(super) fn fly(cli: &Cli, args: &Fly) -> Result<ExitCode, InputError> {
    let mut scenario = match &args.scenario {
        Some(path) => Scenario::read(path, cli.seed)?,
        None => Scenario::built_in(),
    };
    if let Some(snr_db) = args.snr_db {
        scenario.bearing.set_snr_db("--snr-db", snr_db)?;
    }
    if args.records.live.is_on() {
        check_within("--speed", args.speed, &SPEED)?;
    }
    let mut mission = Mission { scenario, seed: cli.seed, planner: args.planner, estimator: args.estimator };
    let plot_path = args.plot.clone().or_else(|| {
        let folder = cli.out.clone().or_else(|| (!cli.json).then(|| PathBuf::from("out")))?;
        Some(folder.join("flight.svg"))
    });
    if let Some(path) = plot_path.as_deref().filter(|path| !matches!(ending(path), Some("svg" | "png"))) {
        return Err(InputError::new(format!("--plot {}: expected a file ending in .svg or .png", path.display())));
    }

    let [report, mcap, tlog] = args.records.files();
    check_apart(&[
        ("--scenario", args.scenario.as_deref()),
        ("--params", args.params.as_deref()),
        ("--plot", plot_path.as_deref()),
        report,
        mcap,
        tlog,
        ("--flight-log", args.flight_log.as_deref()),
    ])?;
    for (option, path) in [("--report", &args.records.report), ("--flight-log", &args.flight_log)] {
        check_writable(option, path.as_ref())?;
    }
    if let Some(path) = plot_path.as_deref() {
        if args.plot.is_none() { cli.claim(path) } else { check_writable("--plot", args.plot.as_ref()) }?;
    }
    let mut given = Given::default();
    if let Some(path) = &args.params {
        given.read(path)?;
        given.check_link().map_err(|error| error.in_file(path))?;
    }
    // Checked here for every computer, so that a refused field is named the same way.
    let (config, host) = mission.with_parameters(&given)?;
    if args.params.is_some() {
        let (told_s, turn_s) = (f64::from(config.sensor.turn_s), mission.scenario.sensor.turn_s);
        if (told_s - turn_s).abs() > 1e-3 {
            cli.note(&format!("FH_OBS_TURN = {told_s:.3}: the simulated sensor takes {turn_s} s for a turn"));
        }
    }
    let values = *given.beside(&config).values();
    let mut computer: Box<dyn Computer> = match &args.via {
        Via::Host => Box::new(host),
        Via::Qemu(elf) => {
            given.refuse_of_link()?;
            let qemu = QemuComputer::start(elf, &Setup { guidance: config, needs_entry: false });
            let qemu = qemu.map_err(|error| InputError::new(format!("--via: {error}")))?;
            if args.records.look_inside() { Box::new(Beside::new(qemu, host)) } else { Box::new(qemu) }
        }
        Via::G474(elf) => {
            if mission.scenario.sensor.model == SensorModel::Circles {
                cli.note("the sensor's circles are sent to the board as scans");
            }
            let needs = Needs::of(&mut mission, &config, &values)?;
            let options = g474::Options { seed: mission.seed, ..g474::Options::default() };
            let board = G474Computer::start(elf, options, &needs);
            Box::new(board.map_err(|error| InputError::new(format!("--via: {error}")))?)
        }
    };
    // The board's flight may have another sensor than the scenario asks for.
    let mut records = args.records.begin(&mission, &config, &values)?;
    if args.flight_log.is_some() {
        computer.log_flight();
    }
    let progress = cli.bar("flying", mission.scenario.max_time_s as u64, "s at most");
    let pace = args.records.live.is_on().then(|| Pace::new(args.speed));
    let stop = stop_flag()?;
    let mut tlog = records.tlog.take();
    let (record, failed) = flight::fly_as_far(&mission, computer.as_mut(), tlog.as_mut(), &stop, |moment| {
        progress.set_position(moment.sample.time_s as u64);
        records.watch(moment);
        if let Some(pace) = &pace {
            pace.wait(moment.sample.time_s, &stop);
        }
    });
    records.tlog = tlog;
    progress.finish_and_clear();
    if let Some(table) = computer.time_spent() {
        cli.note(&table);
    }
    if let Some(overlap_m) = record.report.min_clearance_m.filter(|clearance_m| *clearance_m < 0.0)
        && record.report.result != Ending::Collision
    {
        cli.note(&format!(
            "note: the hull overlapped something by {:.3} m at the start; while that does not grow by a millimetre it is no \
             collision",
            -overlap_m
        ));
    }
    // If a file cannot be written, the others and the printed result are still complete.
    let mut written = Written { cli, has_failed: false };
    if let Some(error) = failed {
        written.file(None, Err(InputError::new(error.to_string())));
    }
    let page = records.end(&mut written, &record.report, cli.json);
    if let Some(path) = &args.flight_log {
        let log = output::write(path, &computer.take_flight_log());
        written.file(None, log.map_err(|error| InputError::new(format!("--flight-log {error}"))));
    }
    let named = |path: &Path| cli.json.then(|| format!("picture: {}", path.display()));
    let plotted = plot_path.as_deref().filter(|path| written.file(named(path), plot::draw(&record, path)));
    if cli.json {
        say(&json_line(&record.report)?);
    } else {
        show_as(look(record.report.result), &summary(&record.report, plotted, page.as_deref()));
    }
    records.linger(cli, &stop);
    Ok(exit_code(record.report.result, &written))
}

/// The exit status of a flight.
pub(super) fn exit_code(ending: Ending, written: &Written<'_>) -> ExitCode {
    match ending {
        _ if written.has_failed => ExitCode::from(2),
        Ending::Reached => ExitCode::SUCCESS,
        Ending::Interrupted => interrupted(),
        Ending::Hold | Ending::Collision | Ending::Timeout => ExitCode::from(1),
    }
}

/// Style of the text for an ending.
pub(super) fn look(ending: Ending) -> Style {
    match ending {
        Ending::Reached => GOOD,
        Ending::Hold | Ending::Timeout | Ending::Interrupted => HALF,
        Ending::Collision => BAD,
    }
}

pub(super) const fn word(ending: Ending) -> &'static str {
    match ending {
        Ending::Reached => "reached the beacon",
        Ending::Hold => "holds",
        Ending::Collision => "collided",
        Ending::Timeout => "ran out of time",
        Ending::Interrupted => "was interrupted",
    }
}

/// How a flight ended, and its numbers as far as they are known, for people.
pub(super) fn numbers(report: &Report, after: &str) -> String {
    let reason = if report.result == Ending::Reached { String::new() } else { format!(" ({})", report.reason) };
    let mut text = format!("{}{reason} after {:.1} s{after}\n", word(report.result), report.time_s);
    let _ = write!(text, "  path             {:.2} m", report.path_length_m);
    if let Some(to_beacon_m) = report.to_beacon_m {
        let _ = write!(text, " to {to_beacon_m:.2} m from the beacon");
    }
    if let Some(straight_line_m) = report.straight_line_m {
        let _ = write!(text, ", straight line to the beacon {straight_line_m:.2} m");
    }
    text.push('\n');
    if let Some(clearance_m) = report.min_clearance_m {
        let _ = writeln!(text, "  least clearance  {clearance_m:.3} m");
    }
    if let Some(obstacles) = report.obstacles {
        let _ = writeln!(text, "  obstacles        {obstacles}");
    }
    if let Some(rms_deg) = report.bearing_rms_deg {
        let _ = writeln!(text, "  bearing error    {rms_deg:.2} deg rms");
    }
    text + &format!("  plans            {}\n", report.replans)
}

/// A flight for people.
fn summary(report: &Report, plot: Option<&Path>, page: Option<&Path>) -> String {
    let mut text = format!("{}: {}", report.name, numbers(report, ""));
    let _ = writeln!(text, "  trace            {} (seed {})", report.trace_hash, report.seed);
    for (name, path) in [("picture", plot), ("report ", page)] {
        if let Some(path) = path {
            let _ = writeln!(text, "  {name}          {}", path.display());
        }
    }
    text
}
