//! `foxhound listen`: a page with the bearings of a recording or of a live radio.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use foxhound_core::base::time;
use foxhound_core::doa::bearing::Flags;
use foxhound_sim::drive::companion::Bearings as _;
use foxhound_sim::record::listening::{self, Page, Point};
use foxhound_sim::scenario::input::{InputError, check_within};
use foxhound_sim::tools::listen::listen as hear;
use foxhound_sim::tools::radio_array::RadioArray;
use serde::Serialize;

use super::radio::RadioArgs;
use super::terminal::{say, show, stop_flag};
use super::value::{check_apart, number, whole};
use super::{Cli, check_writable, json_line, write_text};

/// Range of the duration.
const SECONDS: std::ops::RangeInclusive<f64> = 0.1..=86_400.0;
const PERIOD: Duration = Duration::from_millis(10);

const LISTEN_HELP: &str = "FILE is what `foxhound bearing --switched` reads where the array file has [switch], else what `--iq` reads. \
The page has bearings over time with their sigma, and of recordings the eigenvalues of the covariance and, of --iq, the spectrum. It is \
one file that works offline.

Examples:
  foxhound listen recording.sigmf-meta --array array.toml --out listen.html
  foxhound listen capture.btsnoop --array ring.toml --looks 8
  foxhound listen --bearings kraken:10.0.0.2 --seconds 30";

#[derive(Args, Debug)]
#[command(after_help = LISTEN_HELP)]
pub(super) struct ListenCommand {
    /// A recording.
    #[arg(
        value_name = "FILE",
        required_unless_present = "bearings",
        conflicts_with_all = ["bearings", "emitter", "mount_deg", "sigma_deg", "bearing_age"],
        requires = "array"
    )]
    file: Option<PathBuf>,
    #[command(flatten)]
    radio: RadioArgs,
    /// Frames or packets for each bearing of a recording.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = whole::<u32>(1..=1_000_000))]
    looks: u32,
    /// Duration of listening to a radio; Ctrl-C ends it earlier.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = number(SECONDS))]
    seconds: f64,
    /// File of the page [default: listen.html; with --json none].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// The printed result.
#[derive(Serialize)]
struct Summary<'a> {
    taken: &'a str,
    answers: usize,
    valid: usize,
    flagged: usize,
    page: Option<String>,
}

pub(super) fn listen(cli: &Cli, args: &ListenCommand) -> Result<ExitCode, InputError> {
    // A recording of SigMF is two files, and FILE may be either.
    let other = |extension| args.file.as_ref().map(|file| file.with_extension(extension));
    let (meta, data) = (other("sigmf-meta"), other("sigmf-data"));
    for file in [args.file.as_deref(), meta.as_deref(), data.as_deref()] {
        check_apart(&[("FILE", file), ("--array", args.radio.array()), ("--out", args.out.as_deref())])?;
    }
    let out = args.out.clone().or_else(|| (!cli.json).then(|| PathBuf::from("listen.html")));
    if let Some(out) = &out {
        if args.out.is_some() && out.symlink_metadata().is_ok() && !cli.force {
            let text = "is there already; name another file, or replace it with --force";
            return Err(InputError::new(text).in_file(out));
        }
        check_writable("--out", Some(out))?;
    }
    let page = match &args.file {
        Some(file) => {
            let Some(array) = args.radio.array() else { return Err(InputError::new("--array: missing")) };
            recorded(file, &RadioArray::read(array)?, args.looks as usize)?
        }
        None => live(args)?,
    };
    if let Some(out) = &out {
        write_text(out, &listening::page(&page))?;
    }
    let summary = Summary {
        taken: &page.taken,
        answers: page.answers,
        valid: page.points.iter().filter(|point| point.is_valid).count(),
        flagged: page.points.iter().filter(|point| point.is_flagged).count(),
        page: out.map(|out| out.display().to_string()),
    };
    if cli.json {
        say(&json_line(&summary)?);
    } else {
        let Summary { taken, answers, valid, flagged, page } = summary;
        let page = page.unwrap_or_default();
        show(&format!("{taken}\n{answers} answers, {valid} valid, {flagged} flagged as more than one wave\n{page}\n"));
    }
    Ok(ExitCode::SUCCESS)
}

fn recorded(file: &std::path::Path, array: &RadioArray, looks: usize) -> Result<Page, InputError> {
    let heard = hear(file, array, looks)?;
    let points = heard.lines.iter().filter_map(|answer| {
        let line = &answer.line;
        Some(Point {
            at: line.frame as f64,
            emitter: answer.emitter.unwrap_or_default(),
            azimuth_deg: line.azimuth_deg?,
            sigma_deg: line.sigma_deg?,
            is_valid: line.valid,
            is_flagged: line.flags.iter().any(|flag| ["multipath", "interferer"].contains(flag)),
        })
    });
    Ok(Page {
        title: file.display().to_string(),
        unit: "frame",
        answers: heard.lines.len(),
        points: points.collect(),
        eigenvalues: heard.lines.iter().map(|answer| answer.line.frame as f64).zip(heard.eigenvalues).collect(),
        spectrum: heard.spectrum,
        band_hz: heard.band_hz,
        taken: heard.taken,
    })
}

fn live(args: &ListenCommand) -> Result<Page, InputError> {
    check_within("--seconds", args.seconds, &SECONDS)?;
    let Some(mut radio) = args.radio.open()? else { return Err(InputError::new("--bearings: missing")) };
    let stop = stop_flag()?;
    let begin = Instant::now();
    let mut points = Vec::new();
    while begin.elapsed().as_secs_f64() < args.seconds && !stop.load(std::sync::atomic::Ordering::Relaxed) {
        let now = time::Instant(begin.elapsed().as_micros() as u64);
        if let Some(bearing) = radio.poll(now) {
            points.push(Point {
                at: bearing.time.0 as f64 * 1e-6,
                emitter: 0,
                azimuth_deg: f64::from(bearing.azimuth_rad).to_degrees(),
                sigma_deg: f64::from(bearing.sigma_rad).to_degrees(),
                is_valid: bearing.valid,
                is_flagged: bearing.flags.contains(Flags::MULTIPATH) || bearing.flags.contains(Flags::INTERFERER),
            });
        }
        std::thread::sleep(PERIOD);
    }
    let (title, taken) = (args.radio.name(), radio.summary());
    Ok(Page { title, taken, unit: "seconds", answers: points.len(), points, ..Page::default() })
}
