//! Who is shown a flight: a file gets its report at the end, browsers get it as it runs.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use foxhound_sim::drive::flight::{Moment, Report};
use foxhound_sim::record::report::{self, Live, Recorder};
use foxhound_sim::scenario::input::InputError;

use super::Cli;
use super::terminal::warn;
use super::value::whole;

/// Where the page is when no port is given.
const PORT: u16 = 8868;

#[derive(Args, Debug, Default)]
pub(super) struct LiveArgs {
    /// Serves the page of the report to browsers on this machine while the flight runs, in real time, and afterwards until
    /// Ctrl-C.
    #[arg(long)]
    live: bool,
    /// Port of the live page; 0: any free one [default: 8868].
    #[arg(long, value_name = "N", value_parser = whole::<u16>(0..=65535), requires = "live", allow_negative_numbers = true)]
    port: Option<u16>,
}

impl LiveArgs {
    /// Whether anybody asked for it.
    pub(super) const fn is_on(&self) -> bool {
        self.live
    }
}

/// A flight on record, and who reads it.
pub(super) struct Watched {
    recorder: Recorder,
    lines: Vec<String>,
    file: Option<PathBuf>,
    live: Option<Live>,
}

impl Watched {
    /// None where nobody wants to see the flight. Says where the page is, `--quiet` or not: nobody else does.
    ///
    /// # Errors
    /// The page cannot be served.
    pub(super) fn new(
        args: &LiveArgs,
        file: Option<&Path>,
        recorder: impl FnOnce() -> Recorder,
    ) -> Result<Option<Self>, InputError> {
        let live = if args.live { Some(Live::open(args.port.unwrap_or(PORT))?) } else { None };
        if live.is_none() && file.is_none() {
            return Ok(None);
        }
        if let Some(live) = &live {
            warn(&format!("live: {}", live.address()));
        }
        let file = file.map(Path::to_path_buf);
        let mut watched = Self { recorder: recorder(), lines: Vec::new(), file, live };
        watched.show();
        Ok(Some(watched))
    }

    pub(super) fn watch(&mut self, moment: &Moment<'_>) {
        self.recorder.watch(moment);
        self.show();
    }

    /// Ends the record, and writes the file.
    ///
    /// # Errors
    /// It cannot be written.
    pub(super) fn end(&mut self, report: &Report) -> Result<(), InputError> {
        self.recorder.end(report);
        self.show();
        self.file.as_ref().map_or(Ok(()), |path| report::write(path, &self.lines))
    }

    /// Goes on serving until told to stop.
    pub(super) fn linger(&self, cli: &Cli, stop: &AtomicBool) {
        if let Some(live) = &self.live {
            cli.note(&format!("live: {} stays until Ctrl-C", live.address()));
            live.linger(stop);
        }
    }

    fn show(&mut self) {
        self.lines.extend(self.recorder.take_lines());
        if let Some(live) = &mut self.live {
            live.show(&self.lines);
        }
    }
}

/// Keeps simulated time from running ahead of the clock. Where the machine is slower, so is the flight.
pub(super) struct Pace {
    since: Instant,
    speed: f64,
}

impl Pace {
    /// Begins now.
    pub(super) fn new(speed: f64) -> Self {
        Self { since: Instant::now(), speed }
    }

    /// Waits until it is that late, or told to stop.
    pub(super) fn wait(&self, time_s: f64, stop: &AtomicBool) {
        let due = Duration::from_secs_f64(time_s / self.speed);
        // A step of a slow flight is long.
        while !stop.load(Ordering::Relaxed) && self.since.elapsed() < due {
            sleep(due.saturating_sub(self.since.elapsed()).min(Duration::from_millis(50)));
        }
    }
}
