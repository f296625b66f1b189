//! The command line. Results go to stdout; notes, progress and errors to stderr. Exit status: 0 done as asked, 1 flown
//! but the goal was not reached, 2 bad usage or input.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use foxhound_core::bearing::Estimator;
use foxhound_core::planner;
use foxhound_link::mailbox::Setup;
use foxhound_sim::bearings::{self, Options};
use foxhound_sim::calibrate::{self, calibrate};
use foxhound_sim::computer::{Computer, HostComputer};
use foxhound_sim::flight::{self, Ending, Mission, Record};
use foxhound_sim::frames::{ArrayDescription, Recording, read_yaw};
use foxhound_sim::input::{InputError, read_text};
use foxhound_sim::qemu::QemuComputer;
use foxhound_sim::reproduce::{circle, crb, density, variants};
use foxhound_sim::scenario::{BearingModel, Scenario, VehicleModel};
use foxhound_sim::suite::{self, Selection, Suite};
use foxhound_sim::{maps, plot, tlog};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

/// Lets a small drone find a radio beacon by itself: direction finding with four antennas, planning among unknown
/// obstacles, velocity setpoints for the autopilot. Without a command, flies the built-in mission.
#[derive(Debug, Parser)]
#[command(name = "foxhound", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
    /// Prints JSON on stdout and nothing else there.
    #[arg(long, global = true)]
    json: bool,
    /// Seed of everything random; the same seed gives the same flight.
    #[arg(long, global = true, default_value_t = 1)]
    seed: u64,
    /// Folder for the files that are written [default: out; with --json nothing is written unless asked for].
    #[arg(long, global = true, value_name = "DIR")]
    out: Option<PathBuf>,
}

const EXAMPLES: &str = "Examples:
  foxhound                                          fly through a pillar forest; picture in out/flight.svg
  foxhound fly --scenario gate.json --json          fly a scenario file, result as JSON
  foxhound fly --via qemu:firmware.elf --tlog f.tlog   the same flight with the firmware in QEMU
  foxhound bearing --adc frames.npy --array array.toml --json
  foxhound calibrate --adc known.npy --array array.toml --azimuth-deg 30
  foxhound tlog f.tlog --json
  foxhound maps --out forests && foxhound suite forests/suite.json

Exit status: 0 done as asked; 1 flown, but a goal was not reached; 2 bad usage or input.";

#[derive(Debug, Subcommand)]
enum Command {
    /// Flies one mission in closed loop.
    Fly(Fly),
    /// Finds the bearings in recorded ADC frames.
    Bearing(BearingCommand),
    /// Measures the channels with a known source and writes them into the array file.
    Calibrate(CalibrateCommand),
    /// Counts the MAVLink frames of a telemetry log.
    Tlog(TlogCommand),
    /// Draws maps of given obstacle density and start/goal pairs on them, or describes those of a suite file.
    Maps(MapsCommand),
    /// Flies all pairs of a suite file, many at a time.
    Suite(SuiteCommand),
    /// Repeats an experiment of a paper and puts our number beside its number.
    Reproduce(Reproduce),
}

const FLY_HELP: &str = "Examples:
  foxhound fly --seed 7 --plot flight.png
  foxhound fly --snr-db 0 --planner paper --json
  foxhound fly --scenario gate.json --tlog flight.tlog

A scenario is JSON: x east, y north, metres, seconds, degrees; every key has a default, an unknown one is an error:
  name, bounds [x0,y0,x1,y1], drone_radius (0.15), start [x,y], goal [x,y], goal_velocity [vx,vy],
  obstacles [{x,y,r,vx,vy}], sensor {fov_deg (90), range_m (3), occlusion (true), model circles|scan},
  bearing {only (true; false: the planner is told where the beacon is), model rf|noise, sigma_deg, snr_db,
    outlier {rate, offset_deg}, dropout [t0,t1]},
  limits {v_max (1.0), a_max (2.0)}, vehicle {model point|arducopter, lag_s (0.15)},
  goal_tolerance (0.5: within that many metres of the beacon it counts as reached), max_time_s (90),
  faults {nan_bearing [t0,t1], stale_obstacles [t0,t1], clock_back_s, stale_ownship [t0,t1]}";

#[derive(Args, Debug, Default)]
#[command(after_help = FLY_HELP)]
struct Fly {
    /// Scenario file [default: the built-in pillar forest].
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Which planner: ours, the main paper's and its baseline, with their readings; the others are the baseline in the
    /// field of that name.
    #[arg(long, value_parser = planner_parser(), default_value = "foxhound", value_name = "PLANNER")]
    planner: planner::Config,
    /// Which angle-of-arrival estimator.
    #[arg(long, value_enum, default_value_t)]
    estimator: EstimatorName,
    /// Which computer flies: `host`, or `qemu:ELF` for a firmware image in QEMU.
    #[arg(long, value_name = "COMPUTER", default_value = "host")]
    via: Via,
    /// Signal-to-noise ratio per sample of the antenna waveforms, in dB; overrules the scenario.
    #[arg(long, value_name = "DB", allow_negative_numbers = true)]
    snr_db: Option<f64>,
    /// Picture of the flight, .svg or .png [default: flight.svg in the output folder].
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Telemetry log of every MAVLink frame in both directions, with simulated time.
    #[arg(long, value_name = "FILE")]
    tlog: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
enum EstimatorName {
    /// Cross-spectra and least squares.
    #[default]
    Cross,
    /// The main paper's algorithm to the letter.
    Paper,
    /// The same with the half-plane by the magnitudes of its angles.
    PaperRepaired,
    /// The same with the half-plane by cross-correlation.
    PaperCorrelated,
    /// The main paper's arcsine of one pair, its side by cross-correlation.
    Pair,
    /// The main paper's crossing of two pairs' directions.
    TwoArray,
    /// The main paper's crossing of two pairs that share an antenna.
    ThreeAntenna,
    /// The main paper's least-squares crossing of all neighbours' directions.
    NArray,
}

/// A planner by its name, as clap wants it.
fn planner_parser() -> impl TypedValueParser<Value = planner::Config> {
    PossibleValuesParser::new(planner::NAMES)
        .try_map(|name| planner::Config::named(&name).ok_or("there is no such planner"))
}

impl From<EstimatorName> for Estimator {
    fn from(name: EstimatorName) -> Self {
        match name {
            EstimatorName::Cross => Self::CrossSpectrum,
            EstimatorName::Paper => Self::PaperSquare,
            EstimatorName::PaperRepaired => Self::PaperRepaired,
            EstimatorName::PaperCorrelated => Self::PaperCorrelated,
            EstimatorName::Pair => Self::Pair,
            EstimatorName::TwoArray => Self::TwoArray,
            EstimatorName::ThreeAntenna => Self::ThreeAntenna,
            EstimatorName::NArray => Self::NArray,
        }
    }
}

#[derive(Clone, Debug, Default)]
enum Via {
    #[default]
    Host,
    Qemu(PathBuf),
}

impl std::str::FromStr for Via {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "host" => Ok(Self::Host),
            Some(("qemu", elf)) if !elf.is_empty() => Ok(Self::Qemu(elf.into())),
            _ => Err("expected `host` or `qemu:ELF`".to_owned()),
        }
    }
}

const BEARING_HELP: &str =
    "Frames: NumPy .npy, int16, shape (frames, 4, N), C order, signed 12-bit codes; N is 64, 128, 256, 512 or 1024.
Array file (TOML): wavelength_m, side_m or antennas_m = [[x,y],...] (forward, right), sample_rate_hz,
  optional tone_hz, tone_band_hz = [lo, hi], skew_s = [...], require_calibration, [calibration]
  (written by `foxhound calibrate`).
Looks: from 4 on, direct path and one reflection are told apart (MUSIC over the looks); fewer are averaged as unit
  vectors, weighted by 1/sigma^2. --yaw says how the array stood; the azimuth is that in the body frame of the last
  look. Frames left over at the end are not answered.

Example:
  foxhound bearing --adc frames.npy --array array.toml --looks 4 --yaw yaw.npy --json";

#[derive(Args, Debug)]
#[command(after_help = BEARING_HELP)]
struct BearingCommand {
    /// Recorded frames.
    #[arg(long, value_name = "FILE")]
    adc: PathBuf,
    /// Description of the array.
    #[arg(long, value_name = "FILE")]
    array: PathBuf,
    /// Which angle-of-arrival estimator.
    #[arg(long, value_enum, default_value_t)]
    estimator: EstimatorName,
    /// Consecutive frames an answer.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    looks: u32,
    /// Yaw at each frame: .npy, float64, rad, one per frame.
    #[arg(long, value_name = "FILE")]
    yaw: Option<PathBuf>,
    /// The frames are not consecutive in time.
    #[arg(long)]
    independent: bool,
}

const CALIBRATE_HELP: &str = "The table goes into [calibration] of the array file; its other keys and comments stay. It holds for the tone's frequency
in the samples (and a quarter beyond) and for the file's wavelength_m; elsewhere bearings are flagged `uncalibrated`.
One frame at 40 dB is enough. Frames without a tone, with a clipped or a dead channel are refused.
With --yaw the frames are a turn on the spot: swapped channels are found, and a full turn gives the deviation as well.

Examples:
  foxhound calibrate --adc known.npy --array array.toml --azimuth-deg 30
  foxhound calibrate --adc other_tone.npy --array array.toml --splitter --add --skew
  foxhound calibrate --adc turn.npy --yaw yaw.npy --array array.toml --azimuth-deg 0";

#[derive(Args, Debug)]
#[command(after_help = CALIBRATE_HELP)]
struct CalibrateCommand {
    /// Recorded frames of the known source.
    #[arg(long, value_name = "FILE")]
    adc: PathBuf,
    /// Description of the array; it is rewritten.
    #[arg(long, value_name = "FILE")]
    array: PathBuf,
    /// Where the source is, from the nose and clockwise; with --yaw, where it is at yaw zero.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, required_unless_present = "splitter")]
    azimuth_deg: Option<f64>,
    /// All channels hear the same, through a splitter.
    #[arg(long, conflicts_with_all = ["azimuth_deg", "elevation_deg", "range_m", "yaw"])]
    splitter: bool,
    /// Elevation of the source.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    elevation_deg: f64,
    /// Distance of the source [default: so far that its wave is plane].
    #[arg(long, value_name = "M")]
    range_m: Option<f64>,
    /// Yaw at each frame: .npy, float64, rad, one per frame.
    #[arg(long, value_name = "FILE")]
    yaw: Option<PathBuf>,
    /// Add the tone's frequency to the table, up to four, instead of replacing it.
    #[arg(long)]
    add: bool,
    /// Take the channels' sampling delays out of the phases at two frequencies or more, and write `skew_s`.
    #[arg(long)]
    skew: bool,
    /// Temperature of the receiver, for the record.
    #[arg(long, value_name = "DEG_C", allow_negative_numbers = true)]
    temperature_c: Option<f64>,
}

#[derive(Args, Debug)]
struct TlogCommand {
    /// The log.
    file: PathBuf,
    /// The file is a plain byte stream without time stamps.
    #[arg(long)]
    raw: bool,
}

/// Flights that missed and are named on the terminal.
const MISSES_SHOWN: usize = 20;

const MAPS_HELP: &str =
    "Density is the area of all pillars in a unit square over that of the square; mean and variance are over all unit
squares and are reached within 0.0005. Starts and goals are at least 4 m apart and can be joined by a planner that
knows the map and keeps 0.05 m from every pillar; the suite file holds the length of the shortest such way.
Without --row or --mean: the five maps of the main paper's Table I, four of each.

Examples:
  foxhound maps                                    out/suite.json and out/maps.svg
  foxhound maps --row 4 --count 20 --pairs 5 --drone-radius 0.2 --seed 3 --out dense
  foxhound maps --mean 0.12 --variance 0.01 --step
  foxhound maps --describe out/suite.json --json";

#[derive(Args, Debug)]
#[command(after_help = MAPS_HELP)]
struct MapsCommand {
    /// Row of the main paper's Table I.
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..=5))]
    row: Option<u32>,
    /// Mean density.
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true, requires = "variance", conflicts_with = "row")]
    mean: Option<f64>,
    /// Variance of the density.
    #[arg(long, value_name = "V", allow_negative_numbers = true, requires = "mean")]
    variance: Option<f64>,
    /// Dense on one side of a line, sparse on the other, as row 5 is.
    #[arg(long, requires = "mean")]
    step: bool,
    /// Edges of the map, metres.
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_delimiter = ',', allow_hyphen_values = true)]
    bounds: Vec<f64>,
    /// Maps of each density.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1000))]
    count: u32,
    /// Start/goal pairs of each map.
    #[arg(long, value_name = "P", default_value_t = 40, value_parser = clap::value_parser!(u32).range(0..=10_000))]
    pairs: u32,
    /// Radius of the vehicle, metres.
    #[arg(long, value_name = "M", allow_negative_numbers = true, default_value_t = 0.15)]
    drone_radius: f64,
    /// Describes the maps of this suite file instead.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["row", "mean", "bounds"])]
    describe: Option<PathBuf>,
}

const SUITE_HELP: &str = "A suite is JSON: x east, y north, metres, degrees:
  drone_radius, bounds, sensor, bearing, limits, vehicle, goal_tolerance, max_time_s (all as in a scenario),
  maps [{row, instance, obstacles [[x,y,r],...], pairs [[x0,y0,x1,y1,reference_length],...]}]

Each pair is one flight, as `foxhound fly` flies it, with a seed made of --seed, row, instance and pair. The numbers do
not depend on --jobs. With --out, flights.jsonl holds a line for each flight; --only ROW,INSTANCE,PAIR flies one of
them again, and writes its scenario and its picture there.

Examples:
  foxhound suite suite.json
  foxhound suite suite.json --planner paper --only 4 --pairs 10
  foxhound suite suite.json --only 4,2,17 --out failed
  foxhound suite suite.json --bearing-sigma-deg 20 --json

Exit status: 0 every flight reached the beacon; 1 not every one, or one collided; 2 bad usage or input.";

#[derive(Args, Debug)]
#[command(after_help = SUITE_HELP)]
struct SuiteCommand {
    /// Suite file; `foxhound maps` writes one.
    file: PathBuf,
    /// Flights at a time [default: as many as there are processors].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    jobs: Option<u32>,
    /// Which planner: ours, the main paper's and its baseline, with their readings; the others are the baseline in the
    /// field of that name.
    #[arg(long, value_parser = planner_parser(), default_value = "foxhound", value_name = "PLANNER")]
    planner: planner::Config,
    /// Which angle-of-arrival estimator.
    #[arg(long, value_enum, default_value_t)]
    estimator: EstimatorName,
    /// Only these flights.
    #[arg(long, value_name = "ROW[,INSTANCE[,PAIR]]", value_delimiter = ',')]
    only: Vec<u32>,
    /// Only the first so many pairs of each map.
    #[arg(long, value_name = "P")]
    pairs: Option<u32>,
    /// Radius of the vehicle, metres; overrules the file.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    drone_radius: Option<f64>,
    /// Vehicle model; overrules the file.
    #[arg(long, value_enum)]
    vehicle: Option<VehicleName>,
    /// Bearings with this much noise; overrules the file.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, conflicts_with = "snr_db")]
    bearing_sigma_deg: Option<f64>,
    /// Antenna waveforms at this signal-to-noise ratio per sample, in dB; overrules the file.
    #[arg(long, value_name = "DB", allow_negative_numbers = true)]
    snr_db: Option<f64>,
    /// Writes the scenario of the one flight that --only names, for `foxhound fly --scenario`.
    #[arg(long, value_name = "FILE", requires = "only")]
    dump_scenario: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum VehicleName {
    /// A point mass with a velocity lag and an acceleration limit.
    Point,
    /// The delays measured on ArduCopter.
    Arducopter,
}

impl From<VehicleName> for VehicleModel {
    fn from(name: VehicleName) -> Self {
        match name {
            VehicleName::Point => Self::Point,
            VehicleName::Arducopter => Self::Arducopter,
        }
    }
}

const REPRODUCE_HELP: &str = "Examples:
  foxhound reproduce aoa-circle              table on stdout, picture in out/aoa-circle.svg
  foxhound reproduce aoa-crb --json --seed 2
  foxhound reproduce apf-density             the main paper's planners and ours on its maps; minutes
  foxhound reproduce apf-density --pairs 10 --json --out density
  foxhound reproduce apf-variants            potential fields of the variants paper";

#[derive(Args, Debug)]
#[command(after_help = REPRODUCE_HELP)]
struct Reproduce {
    /// Which one.
    #[arg(value_enum)]
    experiment: Experiment,
    /// apf-density: start/goal pairs of each row of Table I [default: 100].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pairs: Option<u32>,
}

/// Start/goal pairs of each row of Table I.
const DENSITY_PAIRS: u32 = 100;

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Experiment {
    /// Bearings around a circle of 5 m without noise (main paper, fig. 8).
    AoaCircle,
    /// Rms error over the Cramer-Rao bound, over signal-to-noise ratio, frame length and azimuth.
    AoaCrb,
    /// Planners on maps of growing obstacle density (main paper, Table I, fig. 9 and 10).
    ApfDensity,
    /// Four potential fields in four scenes with local minima (variants paper, Table I).
    ApfVariants,
}

/// Runs the command that was given.
pub(crate) fn run() -> ExitCode {
    let cli = Cli::parse();
    let done = match &cli.command {
        None => fly(&cli, &Fly::default()),
        Some(Command::Fly(args)) => fly(&cli, args),
        Some(Command::Bearing(args)) => bearing(&cli, args),
        Some(Command::Calibrate(args)) => calibration(&cli, args),
        Some(Command::Tlog(args)) => read_log(&cli, args),
        Some(Command::Maps(args)) => draw_maps(&cli, args),
        Some(Command::Suite(args)) => fly_suite(&cli, args),
        Some(Command::Reproduce(args)) => reproduce(&cli, args),
    };
    match done {
        Ok(code) => code,
        Err(error) => {
            note(&format!("error: {error}"));
            ExitCode::from(2)
        }
    }
}

fn note(text: &str) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Writes to stdout; a reader that has gone away is not our error.
fn say(text: &str) {
    let _ = io::stdout().lock().write_all(text.as_bytes());
}

fn json_line(value: &impl Serialize) -> Result<String, InputError> {
    let mut line = serde_json::to_string(value).map_err(|error| InputError::new(error.to_string()))?;
    line.push('\n');
    Ok(line)
}

fn fly(cli: &Cli, args: &Fly) -> Result<ExitCode, InputError> {
    let mut scenario = match &args.scenario {
        Some(path) => Scenario::parse(&read_text(path)?).map_err(|error| error.in_file(path))?,
        None => Scenario::built_in(),
    };
    if let Some(snr_db) = args.snr_db {
        foxhound_sim::input::check("--snr-db", snr_db, -30.0, 80.0)?;
        scenario.bearing.snr_db = Some(snr_db);
        scenario.bearing.model = Some(BearingModel::Rf);
    }
    let mission = Mission { scenario, seed: cli.seed, planner: args.planner, estimator: args.estimator.into() };
    let plot_path = args.plot.clone().or_else(|| {
        let folder = cli.out.clone().or_else(|| (!cli.json).then(|| PathBuf::from("out")))?;
        Some(folder.join("flight.svg"))
    });
    if let Some(path) = plot_path.as_deref().filter(|path| !matches!(ending(path), Some("svg" | "png"))) {
        return Err(InputError::new(format!("--plot {}: expected a file ending in .svg or .png", path.display())));
    }

    let config = mission.guidance();
    // Checked here for every computer, so that a refused field is named the same way.
    let host = HostComputer::new(&config)?;
    let mut computer: Box<dyn Computer> = match &args.via {
        Via::Host => Box::new(host),
        Via::Qemu(elf) => {
            let qemu = QemuComputer::start(elf, &Setup { guidance: config });
            Box::new(qemu.map_err(|error| InputError::new(format!("--via: {error}")))?)
        }
    };
    let mut log = match &args.tlog {
        Some(path) => Some(
            tlog::Writer::create(path)
                .map_err(|error| InputError::new(format!("--tlog {}: {error}", path.display())))?,
        ),
        None => None,
    };

    let progress = bar(cli, mission.scenario.max_time_s as u64, "flying {bar:40} {pos} of at most {len} s");
    let flown = flight::fly(&mission, computer.as_mut(), log.as_mut(), |time_s| progress.set_position(time_s as u64));
    progress.finish_and_clear();
    let record = flown.map_err(|error| InputError::new(error.to_string()))?;
    if let Some(log) = log {
        log.finish().map_err(|error| InputError::new(format!("--tlog: {error}")))?;
    }
    if let Some(path) = &plot_path {
        plot::draw(&record, path)?;
        if cli.json {
            note(&format!("picture: {}", path.display()));
        }
    }
    if cli.json {
        say(&json_line(&record.report)?);
    } else {
        say(&summary(&record, plot_path.as_deref()));
    }
    Ok(if record.report.result == Ending::Reached { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn ending(path: &Path) -> Option<&str> {
    path.extension().and_then(|ending| ending.to_str())
}

fn bar(cli: &Cli, length: u64, template: &str) -> ProgressBar {
    // Hidden by itself where stderr is no terminal.
    let target = if cli.json { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(length), target);
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// A flight for people.
fn summary(record: &Record, plot: Option<&Path>) -> String {
    let report = &record.report;
    let word = match report.result {
        Ending::Reached => "reached the beacon",
        Ending::Hold => "holds",
        Ending::Collision => "collided",
        Ending::Timeout => "ran out of time",
    };
    let mut text = String::new();
    let reason = if report.result == Ending::Reached { String::new() } else { format!(" ({})", report.reason) };
    let _ = writeln!(text, "{}: {word}{reason} after {:.1} s", report.name, report.time_s);
    let _ = writeln!(
        text,
        "  path             {:.2} m, straight line {:.2} m",
        report.path_length_m, report.straight_line_m
    );
    if let Some(clearance_m) = report.min_clearance_m {
        let _ = writeln!(text, "  least clearance  {clearance_m:.3} m");
    }
    if let Some(rms_deg) = report.bearing_rms_deg {
        let _ = writeln!(text, "  bearing error    {rms_deg:.2} deg rms");
    }
    let _ = writeln!(text, "  plans            {}", report.replans);
    let _ = writeln!(text, "  trace            {} (seed {})", report.trace_hash, report.seed);
    if let Some(path) = plot {
        let _ = writeln!(text, "  picture          {}", path.display());
    }
    text
}

fn bearing(cli: &Cli, args: &BearingCommand) -> Result<ExitCode, InputError> {
    let description = ArrayDescription::read(&args.array)?;
    if description.array.build()?.is_nearly_ambiguous() {
        note("warning: side_m is close to half a wavelength: noise will turn some bearings round");
    }
    if description.array.calibration.is_some_and(|table| table.entries().is_empty()) {
        note("warning: [calibration] is damaged, its crc does not match: all bearings are uncalibrated");
    }
    let recording = Recording::read(&args.adc)?;
    let frames = recording.frames().len();
    let yaw_rad = match &args.yaw {
        Some(path) => read_yaw(path, frames)?,
        None => Vec::new(),
    };
    let looks = args.looks as usize;
    let options = Options { estimator: args.estimator.into(), looks, yaw_rad, independent: args.independent };
    let lines = bearings::find(&recording, &description, &options)?;
    if frames % looks != 0 {
        note(&format!(
            "note: the last {} of {frames} frames make no group of {looks} and are not answered",
            frames % looks
        ));
    }
    if cli.json {
        let mut text = String::new();
        for line in &lines {
            text.push_str(&json_line(line)?);
        }
        say(&text);
    } else {
        say(&bearings::table(&lines));
    }
    Ok(ExitCode::SUCCESS)
}

fn calibration(cli: &Cli, args: &CalibrateCommand) -> Result<ExitCode, InputError> {
    let text = read_text(&args.array)?;
    ArrayDescription::parse(&text).map_err(|error| error.in_file(&args.array))?;
    let recording = Recording::read(&args.adc)?;
    let yaw_rad = match &args.yaw {
        Some(path) => read_yaw(path, recording.frames().len())?,
        None => Vec::new(),
    };
    let options = calibrate::Options {
        azimuth_deg: args.azimuth_deg,
        elevation_deg: args.elevation_deg,
        range_m: args.range_m,
        yaw_rad,
        temperature_c: args.temperature_c,
        add: args.add,
        skew: args.skew,
    };
    let (text, report) = calibrate(&recording, &text, &options)?;
    std::fs::write(&args.array, text).map_err(|error| InputError::new(error.to_string()).in_file(&args.array))?;
    if report.interferer_frames > 0 {
        note(&format!("warning: in {} frames another line stands within 10 dB of the tone", report.interferer_frames));
    }
    if args.yaw.is_some() && report.deviation_max_deg.is_none() {
        note("note: the frames do not go all around the circle: no deviation");
    }
    if cli.json {
        say(&json_line(&report)?);
        return Ok(ExitCode::SUCCESS);
    }
    let mut text = String::from("channel     gain  phase/deg\n");
    for (channel, (gain, phase_deg)) in report.gain.iter().zip(report.phase_deg).enumerate() {
        let _ = writeln!(text, "{:>7} {gain:>8.4} {phase_deg:>10.3}", channel + 1);
    }
    let _ = writeln!(
        text,
        "at {:.1} Hz from {} frames at {:.1} dB; {:.3} deg a channel are left",
        report.frequency_hz, report.frames, report.snr_db, report.residual_deg
    );
    if let Some(largest_deg) = report.deviation_max_deg {
        let _ = writeln!(text, "deviation up to {largest_deg:.2} deg");
    }
    if let Some(skew_s) = report.skew_s {
        let _ = writeln!(text, "skew_s = {skew_s:?}");
    }
    let _ = writeln!(text, "written to {}", args.array.display());
    say(&text);
    Ok(ExitCode::SUCCESS)
}

fn reproduce(cli: &Cli, args: &Reproduce) -> Result<ExitCode, InputError> {
    if args.pairs.is_some() && !matches!(args.experiment, Experiment::ApfDensity) {
        return Err(InputError::new("--pairs: only apf-density flies pairs"));
    }
    let folder = cli.out.clone().or_else(|| (!cli.json).then(|| PathBuf::from("out")));
    let picture = |name: &str, draw: &dyn Fn(&Path) -> Result<(), InputError>| {
        let Some(folder) = &folder else { return Ok(Vec::new()) };
        let path = folder.join(name);
        draw(&path)?;
        Ok::<Vec<PathBuf>, InputError>(vec![path])
    };
    let (line, table, pictures) = match args.experiment {
        Experiment::AoaCircle => {
            let report = circle::run(cli.seed)?;
            (json_line(&report)?, report.table(), picture("aoa-circle.svg", &|path| report.draw(path))?)
        }
        Experiment::AoaCrb => {
            let report = crb::run(cli.seed)?;
            (json_line(&report)?, report.table(), picture("aoa-crb.svg", &|path| report.draw(path))?)
        }
        Experiment::ApfDensity => {
            let options = density::Options { seed: cli.seed, pairs: args.pairs.unwrap_or(DENSITY_PAIRS) };
            let progress = bar(cli, density::flights(options.pairs), "flying {bar:40} {pos} of {len}");
            let report = density::run(&options, |done| progress.set_position(done));
            progress.finish_and_clear();
            let report = report?;
            let pictures = folder.as_deref().map_or(Ok(Vec::new()), |folder| report.draw(folder))?;
            (json_line(&report)?, report.table(), pictures)
        }
        Experiment::ApfVariants => {
            let report = variants::run();
            let pictures = folder.as_deref().map_or(Ok(Vec::new()), |folder| report.draw(folder))?;
            (json_line(&report)?, report.table(), pictures)
        }
    };
    say(if cli.json { &line } else { &table });
    for path in pictures {
        note(&format!("picture: {}", path.display()));
    }
    Ok(ExitCode::SUCCESS)
}

/// A map for people and machines.
#[derive(Serialize)]
struct MapLine {
    row: u32,
    instance: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    asked: Option<maps::Density>,
    mean: f64,
    variance: f64,
    pillars: usize,
    pairs: usize,
    /// Share of the pairs drawn between which there was a way.
    #[serde(skip_serializing_if = "Option::is_none")]
    reachable_share: Option<f64>,
}

#[derive(Serialize)]
struct MapsReport {
    maps: Vec<MapLine>,
}

impl MapsReport {
    fn table(&self) -> String {
        let mut text =
            String::from(" row  map  asked: mean  variance  reached: mean  variance  pillars  pairs  reachable\n");
        for line in &self.maps {
            let (mean, variance) = match line.asked {
                Some(asked) => (format!("{:.4}", asked.mean), format!("{:.4}", asked.variance)),
                None => ("-".to_owned(), "-".to_owned()),
            };
            let reachable =
                line.reachable_share.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
            let _ = writeln!(
                text,
                "{:>4} {:>4} {mean:>12} {variance:>9} {:>14.4} {:>9.4} {:>8} {:>6} {reachable:>10}",
                line.row, line.instance, line.mean, line.variance, line.pillars, line.pairs
            );
        }
        text
    }
}

fn draw_maps(cli: &Cli, args: &MapsCommand) -> Result<ExitCode, InputError> {
    let (suite, report) = match &args.describe {
        Some(path) => describe(Suite::read(path)?),
        None => drawn(cli, args)?,
    };
    say(&if cli.json { json_line(&report)? } else { report.table() });
    // What is described has its file already.
    let folder = cli.out.clone().or_else(|| (!cli.json && args.describe.is_none()).then(|| PathBuf::from("out")));
    if let Some(folder) = folder {
        let picture = folder.join("maps.svg");
        maps::draw(&suite, &picture)?;
        note(&format!("picture: {}", picture.display()));
        if args.describe.is_none() {
            let file = folder.join("suite.json");
            write_text(&file, &json_line(&suite)?)?;
            note(&format!("suite: {}", file.display()));
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn drawn(cli: &Cli, args: &MapsCommand) -> Result<(Suite, MapsReport), InputError> {
    foxhound_sim::input::check("--drone-radius", args.drone_radius, 0.01, 5.0)?;
    let mut recipes: Vec<(u32, maps::Recipe)> = match (args.row, args.mean, args.variance) {
        (_, Some(mean), Some(variance)) => {
            let density = maps::Density { mean, variance };
            vec![(0, maps::Recipe { density, step: args.step, ..maps::Recipe::default() })]
        }
        (row, ..) => (1..=5)
            .filter(|k| row.is_none_or(|row| row == *k))
            .filter_map(|row| Some((row, maps::Recipe::of_row(row)?)))
            .collect(),
    };
    let mut suite = Suite { drone_radius: args.drone_radius, seed: Some(cli.seed.into()), ..Suite::default() };
    match *args.bounds.as_slice() {
        [] => {}
        [x0, y0, x1, y1] => suite.bounds = [x0, y0, x1, y1],
        _ => return Err(InputError::new("--bounds: expected X0,Y0,X1,Y1")),
    }
    for (_, recipe) in &mut recipes {
        recipe.bounds = suite.bounds;
    }
    let progress = bar(cli, u64::from(args.count) * recipes.len() as u64, "drawing {bar:40} {pos} of {len} maps");
    let mut lines = Vec::new();
    for (row, recipe) in recipes {
        for instance in 0..args.count {
            let seed = suite::Place { row, instance, pair: u32::MAX }.seed(cli.seed);
            let obstacles = maps::generate(&recipe, seed)?;
            let drawn = maps::pairs(suite.bounds, &obstacles, args.drone_radius, args.pairs as usize, seed)?;
            let reached = maps::density(suite.bounds, &obstacles);
            lines.push(MapLine {
                row,
                instance,
                asked: Some(recipe.density),
                mean: reached.mean,
                variance: reached.variance,
                pillars: obstacles.len(),
                pairs: drawn.pairs.len(),
                reachable_share: Some(drawn.reachable_share),
            });
            suite.maps.push(suite::Map::new(row, instance, obstacles, drawn.pairs));
            progress.inc(1);
        }
    }
    progress.finish_and_clear();
    Ok((suite, MapsReport { maps: lines }))
}

fn describe(suite: Suite) -> (Suite, MapsReport) {
    let line = |map: &suite::Map| {
        let reached = maps::density(suite.bounds, &map.obstacles);
        MapLine {
            row: map.row,
            instance: map.instance,
            asked: None,
            mean: reached.mean,
            variance: reached.variance,
            pillars: map.obstacles.len(),
            pairs: map.pairs.len(),
            reachable_share: None,
        }
    };
    let maps = suite.maps.iter().map(line).collect();
    (suite, MapsReport { maps })
}

fn write_text(path: &Path, text: &str) -> Result<(), InputError> {
    let failed = |error: io::Error| InputError::new(error.to_string()).in_file(path);
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    std::fs::write(path, text).map_err(failed)
}

/// The suite as it is in the file, with what the command line overrules.
fn suite_of(args: &SuiteCommand) -> Result<Suite, InputError> {
    let mut suite = Suite::read(&args.file)?;
    if let Some(radius_m) = args.drone_radius {
        foxhound_sim::input::check("--drone-radius", radius_m, 0.01, 5.0)?;
        suite.drone_radius = radius_m;
    }
    if let Some(sigma_deg) = args.bearing_sigma_deg {
        foxhound_sim::input::check("--bearing-sigma-deg", sigma_deg, 0.0, 180.0)?;
        suite.bearing.sigma_deg = sigma_deg;
        suite.bearing.model = Some(BearingModel::Noise);
    }
    if let Some(snr_db) = args.snr_db {
        foxhound_sim::input::check("--snr-db", snr_db, -30.0, 80.0)?;
        suite.bearing.snr_db = Some(snr_db);
        suite.bearing.model = Some(BearingModel::Rf);
    }
    if let Some(vehicle) = args.vehicle {
        suite.vehicle.model = vehicle.into();
    }
    Ok(suite)
}

fn fly_suite(cli: &Cli, args: &SuiteCommand) -> Result<ExitCode, InputError> {
    let suite = suite_of(args)?;
    if args.only.len() > 3 {
        return Err(InputError::new("--only: expected ROW, ROW,INSTANCE or ROW,INSTANCE,PAIR"));
    }
    let selection = Selection { only: args.only.clone(), pairs: args.pairs };
    let flights = suite.flights(cli.seed, &selection);
    let Some(first) = flights.first() else {
        let what = if selection == Selection::default() {
            "maps: there is no pair"
        } else {
            "--only or --pairs: no pair is left"
        };
        return Err(InputError::new(what).in_file(&args.file));
    };
    let (planner, estimator) = (args.planner, args.estimator.into());
    // Refused once, not by every worker.
    HostComputer::new(&first.mission(planner, estimator).guidance())?;
    if let Some(path) = &args.dump_scenario {
        if flights.len() > 1 {
            return Err(InputError::new("--dump-scenario: --only must name one flight, as ROW,INSTANCE,PAIR"));
        }
        write_text(path, &json_line(&first.scenario)?)?;
        note(&format!("scenario: {} (fly it with --seed {})", path.display(), first.seed));
    }

    let processors = || std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or_else(processors, |jobs| jobs as usize);
    let progress = bar(cli, flights.len() as u64, "flying {bar:40} {pos} of {len}, {eta} left{msg}");
    let failed = std::sync::atomic::AtomicUsize::new(0);
    let flown = suite::fly_all(&flights, planner, estimator, jobs, |flown| {
        if flown.result != Ending::Reached {
            let count = failed.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress.set_message(format!(", {count} not reached"));
        }
        progress.inc(1);
    });
    progress.finish_and_clear();
    let flown = flown?;
    let report = suite::Report::of(&flown);
    say(&if cli.json { json_line(&report)? } else { report.table() });

    let missed: Vec<&suite::Flown> = flown.iter().filter(|flown| flown.result != Ending::Reached).collect();
    if !cli.json {
        for miss in missed.iter().take(MISSES_SHOWN) {
            let suite::Place { row, instance, pair } = miss.place;
            note(&format!("--only {row},{instance},{pair}  {} after {:.1} s", miss.outcome(), miss.time_s));
        }
        if missed.len() > MISSES_SHOWN {
            note(&format!("and {} more", missed.len() - MISSES_SHOWN));
        }
    }
    if let Some(folder) = &cli.out {
        let lines: Result<String, InputError> = flown.iter().map(json_line).collect();
        let path = folder.join("flights.jsonl");
        write_text(&path, &lines?)?;
        note(&format!("flights: {}", path.display()));
        if let [flight] = flights.as_slice() {
            let suite::Place { row, instance, pair } = flight.place;
            let path = |ending: &str| folder.join(format!("flight-{row}-{instance}-{pair}.{ending}"));
            write_text(&path("json"), &json_line(&flight.scenario)?)?;
            let (_, record) = flight.fly(planner, estimator)?;
            plot::draw(&record, &path("svg"))?;
            note(&format!("picture: {}", path("svg").display()));
            note(&format!("again: foxhound fly --scenario {} --seed {}", path("json").display(), flight.seed));
        }
    }
    let all_reached = report.all.success == report.all.runs && report.all.collisions == 0;
    Ok(if all_reached { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

fn read_log(cli: &Cli, args: &TlogCommand) -> Result<ExitCode, InputError> {
    let bytes = std::fs::read(&args.file).map_err(|error| InputError::new(error.to_string()).in_file(&args.file))?;
    let summary = if args.raw { tlog::read_raw(&bytes) } else { tlog::read_stamped(&bytes) };
    if cli.json {
        say(&json_line(&summary)?);
    } else {
        let mut text = format!(
            "{} frames, {} with a wrong checksum, {} bytes skipped\n",
            summary.frames, summary.bad_crc, summary.skipped_bytes
        );
        for (id, count) in &summary.counts {
            let _ = writeln!(text, "{count:>8}  message {id}");
        }
        say(&text);
    }
    Ok(ExitCode::SUCCESS)
}
