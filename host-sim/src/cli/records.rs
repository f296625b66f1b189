//! Records of a flight, for `fly` and `companion`: files, and browsers as the flight runs.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use foxhound_core::guidance;
use foxhound_core::guidance::param::Values;
use foxhound_sim::autopilot::tlog;
use foxhound_sim::drive::flight::{Mission, Moment, Report};
use foxhound_sim::record::mcap;
use foxhound_sim::record::report::{self, Kept, Live, Recorder};
use foxhound_sim::scenario::input::InputError;

use super::terminal::warn;
use super::value::whole;
use super::{Cli, command_line};

/// Port of the page by default.
const PORT: u16 = 8868;

#[derive(Args, Debug, Default)]
pub(super) struct RecordArgs {
    /// Report of the flight: one interactive HTML file that works offline. With `companion`, positions are those that the
    /// autopilot reports, and with `qemu:ELF` there are no plans.
    #[arg(long, value_name = "FILE")]
    pub(super) report: Option<PathBuf>,
    /// MCAP file of the flight, for Foxglove and others: map, 3-D, plots; docs/simulator.md lists the topics.
    #[arg(long, value_name = "FILE")]
    pub(super) mcap: Option<PathBuf>,
    #[command(flatten)]
    pub(super) live: LiveArgs,
    /// Telemetry log of every MAVLink frame in both directions, with simulated time; with `companion`, wall time.
    #[arg(long, value_name = "FILE")]
    pub(super) tlog: Option<PathBuf>,
}

impl RecordArgs {
    /// Each file with its option.
    pub(super) fn files(&self) -> [(&'static str, Option<&Path>); 3] {
        [("--report", self.report.as_deref()), ("--mcap", self.mcap.as_deref()), ("--tlog", self.tlog.as_deref())]
    }

    /// Whether anything looks into the flight computer.
    pub(super) const fn look_inside(&self) -> bool {
        self.live.live || self.report.is_some() || self.mcap.is_some()
    }

    /// Begins the records. Prints the address of the live page even with `--quiet`.
    ///
    /// # Errors
    /// A file cannot be written, or the page cannot be served.
    pub(super) fn begin(
        &self,
        mission: &Mission,
        config: &guidance::Config,
        values: &Values,
    ) -> Result<Records, InputError> {
        let live = if self.live.live { Some(Live::open(self.live.port.unwrap_or(PORT))?) } else { None };
        if let Some(live) = &live {
            warn(&format!("live: {}", live.address()));
        }
        let report = self.report.clone().map(|path| (path, Kept::default()));
        let is_read = live.is_some() || report.is_some();
        let recorder = is_read.then(|| Recorder::new(mission, config, values, command_line()));
        let mcap = |path: &PathBuf| mcap::Log::create(path, mission, config, values, command_line());
        let mcap = match &self.mcap {
            Some(path) => Some((mcap(path)?, path.clone())),
            None => None,
        };
        let tlog = self.tlog.as_ref().map(|path| tlog::Writer::create(path).map_err(of_tlog)).transpose()?;
        let mut records = Records { recorder, report, live, mcap, tlog };
        records.show();
        Ok(records)
    }
}

fn of_tlog(error: InputError) -> InputError {
    InputError::new(format!("--tlog {error}"))
}

/// The records of a flight.
pub(super) struct Records {
    recorder: Option<Recorder>,
    report: Option<(PathBuf, Kept)>,
    live: Option<Live>,
    mcap: Option<(mcap::Log, PathBuf)>,
    pub(super) tlog: Option<tlog::Writer>,
}

impl Records {
    pub(super) fn watch(&mut self, moment: &Moment<'_>) {
        if let Some(recorder) = &mut self.recorder {
            recorder.watch(moment);
        }
        self.show();
        if let Some((mcap, _)) = &mut self.mcap {
            mcap.watch(moment);
        }
    }

    fn show(&mut self) {
        for record in self.recorder.as_mut().map(Recorder::take).unwrap_or_default() {
            if let Some(live) = &self.live {
                live.show(&record);
            }
            if let Some((_, kept)) = &mut self.report {
                kept.add(record);
            }
        }
    }

    /// Ends all of them, also where one cannot be written; returns the file of the report if it is there, which is noted if
    /// `notes_report`.
    pub(super) fn end(&mut self, written: &mut Written<'_>, report: &Report, notes_report: bool) -> Option<PathBuf> {
        if let Some(tlog) = self.tlog.take() {
            written.file(None, tlog.finish().map_err(of_tlog));
        }
        // Browsers get the end even if no file was requested.
        if let Some(recorder) = &mut self.recorder {
            recorder.end(report);
        }
        self.show();
        let page = self.report.take().filter(|(path, kept)| {
            let note = notes_report.then(|| format!("report: {}", path.display()));
            written.file(note, report::write(path, kept))
        });
        if let Some((mcap, path)) = self.mcap.take() {
            written.file(Some(format!("MCAP: {}", path.display())), mcap.end(report));
        }
        page.map(|(path, _)| path)
    }

    /// Keeps serving the live page, if there is one, until Ctrl-C.
    pub(super) fn linger(&self, cli: &Cli, stop: &AtomicBool) {
        if let Some(live) = &self.live {
            cli.note(&format!("live: {} stays until Ctrl-C", live.address()));
            live.linger(stop);
        }
    }
}

/// The files of a flight, each of which may fail.
pub(super) struct Written<'a> {
    pub(super) cli: &'a Cli,
    pub(super) has_failed: bool,
}

impl Written<'_> {
    /// Reports that a file is written, or why it is not; returns whether it is.
    pub(super) fn file(&mut self, note: Option<String>, written: Result<(), InputError>) -> bool {
        let is_there = written.is_ok();
        match (written, note) {
            (Ok(()), Some(note)) => self.cli.note(&note),
            (Ok(()), None) => {}
            (Err(error), _) => {
                warn(&format!("error: {error}"));
                self.has_failed = true;
            }
        }
        is_there
    }
}

#[derive(Args, Debug, Default)]
pub(super) struct LiveArgs {
    /// Serves the report as a live page to browsers on this machine, while the flight runs in real time, and
    /// afterwards until Ctrl-C.
    #[arg(long)]
    live: bool,
    /// Port of the live page; 0: any free one [default: 8868].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(0..=65535), requires = "live")]
    port: Option<u16>,
}

impl LiveArgs {
    /// Whether the live page is on.
    pub(super) const fn is_on(&self) -> bool {
        self.live
    }
}

/// Keeps simulated time from running ahead of real time. On a slower machine the flight is slower.
pub(super) struct Pace {
    since: Instant,
    speed: f64,
}

impl Pace {
    /// Starts now.
    pub(super) fn new(speed: f64) -> Self {
        Self { since: Instant::now(), speed }
    }

    /// Waits until real time has reached `time_s`, or for the signal to stop.
    pub(super) fn wait(&self, time_s: f64, stop: &AtomicBool) {
        let due = Duration::from_secs_f64(time_s / self.speed);
        // A flight in real time may have a long step.
        while !stop.load(Ordering::Relaxed) && self.since.elapsed() < due {
            sleep(due.saturating_sub(self.since.elapsed()).min(Duration::from_millis(50)));
        }
    }
}
