//! `foxhound bearing` and `foxhound calibrate`: recorded frames instead of a flight.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{ArgGroup, Args};
use foxhound_core::doa::bearing::Estimator;
use foxhound_sim::scenario::input::{AZIMUTH_DEG, ELEVATION_DEG, InputError, RANGE_M, TEMPERATURE_C, read_text};
use foxhound_sim::scenario::output;
use foxhound_sim::tools::bearings::{self, Line, Options};
use foxhound_sim::tools::calibrate::{self, calibrate};
use foxhound_sim::tools::frames::{ArrayDescription, Recording, read_yaw};
use foxhound_sim::tools::iq::{self, Frames};
use foxhound_sim::tools::radio_array::RadioArray;
use foxhound_sim::tools::switched::{self, Packets};
use serde::Serialize;

use super::fly::estimator_parser;
use super::terminal::{say, show, warn};
use super::value::{number, whole};
use super::{Cli, json_line};

const BEARING_HELP: &str =
    "--adc: NumPy .npy, int16, shape (frames, 4, N), C order, signed 12-bit codes; N is 64, 128, 256, 512 or 1024. \
Array file (TOML): wavelength_m, side_m or antennas_m = [[x,y],...] (forward, right), sample_rate_hz, \
optional tone_hz, tone_band_hz = [lo, hi], skew_s = [...], require_calibration, [calibration] \
(written by `foxhound calibrate`).

--switched: complex64, (packets, slots, samples of a slot), or Bluetooth IQ reports: a btsnoop file, or the bytes of an \
H4 line (sample_rate_hz = 1e6, that of the reference period; the handle is the transmitter). Array file: wavelength_m, antennas_m of 2 to 8 antennas, \
sample_rate_hz, tone_hz (in the samples), [switch] with slot_s (from slot to slot) and pattern (the antenna of each slot \
from 1 on, repeated; 0: not used), optional sigma_floor_deg.

--iq: complex64, (frames, channels, N); int16 or int8, (frames, channels, N, 2); SigMF (ci16_le, ci8, cu8, cf32_le); WAV of \
as many channels as antennas (real samples) or twice as many (I and Q of each). Array file: wavelength_m, antennas_m, \
sample_rate_hz, optional tone_band_hz (the occupied band, about zero), sigma_floor_deg.

Looks: of an array that moves, from 4 on, direct path and one reflection are told apart; others are \
averaged. Where nothing moves and most looks do not fit a plane wave the answer is their median. --yaw gives the heading of the \
array; the azimuth is that in the body frame of the last look. --switched joins packets of one transmitter, --iq \
frames. Frames left over at the end are an error (of several transmitters a note).

Lines of --switched and --iq also have mirror_deg (the other answer of antennas on a line) and ambiguities (how many \
directions fit nearly as well).

Examples:
  foxhound bearing --adc frames.npy --array array.toml
  foxhound bearing --adc frames.npy --array array.toml --looks 4 --yaw yaw.npy --json
  foxhound bearing --switched packets.npy --array ring.toml --emitter beacons.npy
  foxhound bearing --switched capture.btsnoop --array ring.toml --looks 8
  foxhound bearing --iq recording.sigmf-meta --array array.toml";

#[derive(Args, Debug)]
#[command(after_help = BEARING_HELP)]
#[command(group(ArgGroup::new("recording").required(true).args(["adc", "switched", "iq"])))]
pub(super) struct BearingCommand {
    /// Recorded frames of four converters.
    #[arg(long, value_name = "FILE")]
    adc: Option<PathBuf>,
    /// Recorded packets of an array behind a switch: .npy, btsnoop, or an H4 line's bytes.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["estimator", "yaw", "independent"])]
    switched: Option<PathBuf>,
    /// Recorded complex samples of all channels: .npy, .sigmf-meta or .wav.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["estimator", "yaw", "independent"])]
    iq: Option<PathBuf>,
    /// Which transmitter sent each packet: .npy, int32, one per packet.
    #[arg(long, value_name = "FILE", requires = "switched")]
    emitter: Option<PathBuf>,
    /// Description of the array.
    #[arg(long, value_name = "FILE")]
    array: PathBuf,
    /// Which angle-of-arrival estimator.
    #[arg(long, value_parser = estimator_parser(), default_value = "cross", value_name = "ESTIMATOR")]
    estimator: Estimator,
    /// Consecutive frames for each bearing.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = whole::<u32>(1..=1_000_000))]
    looks: u32,
    /// Yaw at each frame: .npy, float64, rad, one per frame.
    #[arg(long, value_name = "FILE")]
    yaw: Option<PathBuf>,
    /// The frames are not consecutive in time.
    #[arg(long)]
    independent: bool,
}

const CALIBRATE_HELP: &str = "The table goes into [calibration] of the array file; its other keys and comments stay. It holds for the tone's frequency \
in the samples (and a quarter beyond) and for the file's wavelength_m; elsewhere bearings are flagged `uncalibrated`. \
One frame at 40 dB is enough. Frames without a tone, with a clipped or a dead channel are refused. \
With --yaw the frames are a turn on the spot: swapped channels are found, and a full turn gives the deviation as well.

Examples:
  foxhound calibrate --adc known.npy --array array.toml --azimuth-deg 30
  foxhound calibrate --adc other_tone.npy --array array.toml --splitter --add --skew
  foxhound calibrate --adc turn.npy --yaw yaw.npy --array array.toml --azimuth-deg 0";

#[derive(Args, Debug)]
#[command(after_help = CALIBRATE_HELP)]
pub(super) struct CalibrateCommand {
    /// Recorded frames of the known source.
    #[arg(long, value_name = "FILE")]
    adc: PathBuf,
    /// Description of the array; it is rewritten.
    #[arg(long, value_name = "FILE")]
    array: PathBuf,
    /// Where the source is, from the nose and clockwise; with --yaw, where it is at yaw zero.
    #[arg(long, value_name = "DEG", value_parser = number(AZIMUTH_DEG), required_unless_present = "splitter")]
    azimuth_deg: Option<f64>,
    /// All channels get the same signal, through a splitter.
    #[arg(long, conflicts_with_all = ["azimuth_deg", "elevation_deg", "range_m", "yaw"])]
    splitter: bool,
    /// Elevation of the source.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, value_parser = number(ELEVATION_DEG))]
    elevation_deg: f64,
    /// Distance of the source [default: so far that its wave is plane].
    #[arg(long, value_name = "M", value_parser = number(RANGE_M))]
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
    #[arg(long, value_name = "DEG_C", value_parser = number(TEMPERATURE_C))]
    temperature_c: Option<f64>,
}

pub(super) fn bearing(cli: &Cli, args: &BearingCommand) -> Result<ExitCode, InputError> {
    let looks = args.looks as usize;
    if let Some(path) = &args.switched {
        let array = RadioArray::read(&args.array)?;
        let packets = Packets::read(path, args.emitter.as_deref(), &array)?;
        cli.note(&format!("note: read {}", packets.taken()));
        let (lines, left) = switched::find(&packets, &array, looks)?;
        let count = packets.count();
        // The user does not choose who sends when: an incomplete group of a transmitter is not an error.
        if (args.emitter.is_none() && packets.transmitters() < 2) || lines.is_empty() {
            refuse_left(left, count, "packets", looks)?;
        } else if left != 0 {
            cli.note(&format!("note: {left} of {count} packets make no group of {looks} of one transmitter"));
        }
        return print(cli, &lines, |line| (&line.line, line.more()));
    }
    if let Some(path) = &args.iq {
        let array = RadioArray::read(&args.array)?;
        let frames = Frames::read(path, &array)?;
        cli.note(&format!("note: read {}", frames.taken()));
        if let Some(text) = frames.warning() {
            warn(&format!("warning: {text}"));
        }
        let lines = iq::find(&frames, &array, looks)?;
        refuse_left(frames.count() % looks, frames.count(), "frames", looks)?;
        return print(cli, &lines, |line| (&line.line, line.more()));
    }
    let Some(adc) = &args.adc else { return Err(InputError::new("--adc: missing")) };
    let description = ArrayDescription::read(&args.array)?;
    for text in description.warnings()? {
        warn(&format!("warning: {text}"));
    }
    let recording = Recording::read(adc)?;
    let frames = recording.frames().len();
    let yaw_rad = match &args.yaw {
        Some(path) => read_yaw(path, frames)?,
        None => Vec::new(),
    };
    let options = Options { estimator: args.estimator, looks, yaw_rad, independent: args.independent };
    let lines = bearings::find(&recording, &description, &options)?;
    refuse_left(frames % looks, frames, "frames", looks)?;
    print(cli, &lines, |line| (line, String::new()))
}

/// Names the option.
fn refuse_left(left: usize, count: usize, what: &str, looks: usize) -> Result<(), InputError> {
    bearings::refuse_left(left, count, what, looks)
        .map_err(|error| InputError::new(format!("--looks {looks}: {error}")))
}

/// Prints the lines of any recording.
fn print<L: Serialize>(cli: &Cli, lines: &[L], line: impl Fn(&L) -> (&Line, String)) -> Result<ExitCode, InputError> {
    if cli.json {
        let mut text = String::new();
        for line in lines {
            text.push_str(&json_line(line)?);
        }
        say(&text);
    } else {
        show(&bearings::table(lines.iter().map(line)));
    }
    Ok(ExitCode::SUCCESS)
}

pub(super) fn calibration(cli: &Cli, args: &CalibrateCommand) -> Result<ExitCode, InputError> {
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
    output::write(&args.array, text.as_bytes())?;
    if report.interferer_frames > 0 {
        warn(&format!(
            "warning: in {} frames another line stands near the tone or within 10 dB of it",
            report.interferer_frames
        ));
    }
    if args.yaw.is_none() && report.spread_deg > calibrate::SPREAD_DOUBTFUL_DEG {
        warn(&format!("warning: the channels' phases differ by {:.1} deg from frame to frame", report.spread_deg));
    }
    if args.yaw.is_some() && report.deviation_max_deg.is_none() {
        cli.note("note: the frames do not go all around the circle: no deviation");
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
    show(&text);
    Ok(ExitCode::SUCCESS)
}
