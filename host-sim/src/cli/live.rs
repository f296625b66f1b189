//! Readers of a flight's report: a file gets it at the end, browsers get it as the flight runs.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use foxhound_sim::drive::flight::{Moment, Report};
use foxhound_sim::record::report::{self, Kept, Live, Recorder};
use foxhound_sim::scenario::input::InputError;

use super::Cli;
use super::terminal::warn;
use super::value::whole;

/// Port of the page by default.
const PORT: u16 = 8868;

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

/// The record of a flight, and its readers.
pub(super) struct Watched {
    recorder: Recorder,
    file: Option<(PathBuf, Kept)>,
    live: Option<Live>,
}

impl Watched {
    /// `None` if there is no reader. Prints the address of the page even with `--quiet`.
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
        let file = file.map(|path| (path.to_path_buf(), Kept::default()));
        let mut watched = Self { recorder: recorder(), file, live };
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
        self.file.as_ref().map_or(Ok(()), |(path, kept)| report::write(path, kept))
    }

    /// Keeps serving until Ctrl-C.
    pub(super) fn linger(&self, cli: &Cli, stop: &AtomicBool) {
        if let Some(live) = &self.live {
            cli.note(&format!("live: {} stays until Ctrl-C", live.address()));
            live.linger(stop);
        }
    }

    fn show(&mut self) {
        for record in self.recorder.take() {
            if let Some(live) = &self.live {
                live.show(&record);
            }
            if let Some((_, kept)) = &mut self.file {
                kept.add(record);
            }
        }
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
