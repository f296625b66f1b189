//! `foxhound port`: the maintenance port, seen from the other end of the cable.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use foxhound_computer::SAMPLES_PER_CHANNEL;
use foxhound_computer::log::Record;
use foxhound_computer::log::frame::LogDeframer;
use foxhound_computer::port::FRAMES_MAX;
use foxhound_core::base::adc::AdcFrame;
use foxhound_sim::autopilot::transport::{Address, BAUDS, Line};
use foxhound_sim::scenario::input::{InputError, MAX_TIME_S, check_within};
use foxhound_sim::scenario::output;
use foxhound_sim::tools::frames::Recording;
use serde::Serialize;

mod bringup;

use super::terminal::{say, warn};
use super::value::{check_apart, number, whole};
use super::{Cli, json_line};

const PORT_HELP: &str = "Examples:
  foxhound port --serial /dev/ttyACM0 status
  foxhound port --serial /dev/ttyACM0 --log flight.log    until Ctrl-C
  foxhound port --serial /dev/ttyACM0 dump 64 --out F.npy
  foxhound port --serial /dev/ttyACM0 bringup

A log that is there already is replaced only with --force.

Exit status: 0 done as asked; 1 no answer, it refuses, frames are missing, the port was gone for a while, or a check or the \
self-test has failed; 2 bad usage, no such port, or a dump that is refused.";

/// Time to wait for an answer, or for the next frame.
const PATIENCE: Duration = Duration::from_secs(3);
/// An answer has ended after a silence of this length.
const SILENCE: Duration = Duration::from_secs(1);
/// Time to wait for the result of a self-test or a calibration, which take 1.5 s.
const EXAMINATION: Duration = Duration::from_secs(6);
const BAUD_MIN: u64 = *BAUDS.start() as u64;
const BAUD_MAX: u64 = *BAUDS.end() as u64;
const READ_EVERY: Duration = Duration::from_millis(2);

#[derive(Args, Debug)]
#[command(after_help = PORT_HELP)]
pub(super) struct PortCommand {
    /// The serial port; of a NUCLEO board, that of its ST-LINK.
    #[arg(long, value_name = "DEVICE")]
    serial: PathBuf,
    /// Baud rate, bits per second.
    #[arg(long, value_name = "N", default_value_t = 921_600, value_parser = whole::<u32>(BAUD_MIN..=BAUD_MAX))]
    baud: u32,
    /// Records everything that is received.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Ends after this many seconds, not with `dump` or `bringup` [default: when the answer has ended, or after 3 s; without a
    /// command, never].
    #[arg(long, value_name = "S", value_parser = number(MAX_TIME_S))]
    seconds: Option<f64>,
    /// File for the frames of `dump` or `bringup`: int16, shape (frames, 4, 256).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Command for the flight computer, or `bringup`; `help` lists them. Without one, only listens.
    command: Vec<String>,
}

#[derive(Serialize)]
struct Said<'a> {
    text: &'a str,
}

#[derive(Serialize)]
struct Dumped<'a> {
    frames: usize,
    out: &'a Path,
}

/// The cable to a flight computer.
struct Cable {
    line: Line,
    log: Option<(PathBuf, File)>,
    deframer: Box<LogDeframer>,
    is_open: bool,
    /// It was gone for a while: what was sent then is missing.
    was_cut: bool,
}

/// Something received over it.
enum Reply {
    Text(String),
    Frame(Box<AdcFrame<SAMPLES_PER_CHANNEL>>),
}

impl Cable {
    fn open(cli: &Cli, args: &PortCommand) -> Result<Self, InputError> {
        let address = Address::Serial { device: args.serial.clone(), baud: args.baud };
        let line = Line::open(&address).map_err(|error| failed(&error).in_file(&args.serial))?;
        // Written record by record: when it is interrupted, the file is a valid log.
        let begun = |path: &PathBuf| {
            if !cli.force && path.metadata().is_ok_and(|there| there.is_file() && there.len() > 0) {
                let text = "is there already; name another file, or replace it with --force";
                return Err(InputError::new(format!("--log {}: {text}", path.display())));
            }
            File::create(path).map(|file| (path.clone(), file)).map_err(|error| output::failed(path, &error))
        };
        let log = args.log.as_ref().map(begun).transpose()?;
        Ok(Self { line, log, deframer: Box::new(LogDeframer::new()), is_open: true, was_cut: false })
    }

    /// Types a line. The first line feed ends whatever was typed before.
    fn say(&mut self, command: &str) {
        self.line.write(format!("\n{command}\n").as_bytes());
    }

    /// Takes what has been received.
    fn hear(&mut self) -> Result<Vec<Reply>, InputError> {
        let bytes = self.line.read();
        let is_open = self.line.is_open();
        if is_open != self.is_open {
            warn(if is_open { "the port is back" } else { "the port is gone: what is sent now is missing" });
            self.was_cut = true;
        }
        self.is_open = is_open;
        if let Some((path, log)) = &mut self.log {
            log.write_all(&bytes).map_err(|error| output::failed(path, &error))?;
        }
        let mut heard = Vec::new();
        for byte in &bytes {
            let Some(frame) = self.deframer.push(*byte) else { continue };
            match Record::of(&frame) {
                Some(Record::Text(text)) => heard.push(Reply::Text(text.to_owned())),
                Some(Record::Codes(codes)) => heard.extend(codes.snapshot().map(|codes| Reply::Frame(Box::new(codes)))),
                _ => {}
            }
        }
        Ok(heard)
    }

    /// Sends a command, and passes each line of the answer on as it comes; returns whether there was one. It has
    /// ended after [`SILENCE`].
    fn ask(&mut self, command: &str, patience: Duration, mut answer: impl FnMut(String)) -> Result<bool, InputError> {
        self.say(command);
        let (begin, mut heard_at) = (Instant::now(), None::<Instant>);
        while heard_at.map_or(begin.elapsed() < patience, |at| at.elapsed() < SILENCE) {
            for heard in self.hear()? {
                if let Reply::Text(text) = heard {
                    heard_at = Some(Instant::now());
                    answer(text);
                }
            }
            sleep(READ_EVERY);
        }
        Ok(heard_at.is_some())
    }

    /// Requests the samples of that many frames, and requests lost ones again; fewer where none come.
    ///
    /// # Errors
    /// The computer refuses it.
    fn dump(&mut self, frames: u16) -> Result<Vec<AdcFrame<SAMPLES_PER_CHANNEL>>, InputError> {
        let mut snapshots = Vec::new();
        loop {
            let before = snapshots.len();
            self.dump_once(frames, &mut snapshots)?;
            if snapshots.len() == before || snapshots.len() >= usize::from(frames) {
                return Ok(snapshots);
            }
        }
    }

    fn dump_once(&mut self, frames: u16, snapshots: &mut Vec<AdcFrame<SAMPLES_PER_CHANNEL>>) -> Result<(), InputError> {
        let wanted = usize::from(frames);
        self.say(&format!("dump {}", wanted - snapshots.len()));
        let mut heard_at = Instant::now();
        while heard_at.elapsed() < PATIENCE && snapshots.len() < wanted {
            for heard in self.hear()? {
                match heard {
                    Reply::Text(text) if text.starts_with("error") || text.starts_with("refused") => {
                        return Err(InputError::new(text));
                    }
                    Reply::Frame(snapshot) if snapshots.len() < wanted => {
                        heard_at = Instant::now();
                        snapshots.push(*snapshot);
                    }
                    _ => {}
                }
            }
            sleep(READ_EVERY);
        }
        Ok(())
    }
}

fn failed(error: &std::io::Error) -> InputError {
    InputError::new(error.to_string())
}

pub(super) fn port(cli: &Cli, args: &PortCommand) -> Result<ExitCode, InputError> {
    if let Some(seconds) = args.seconds {
        check_within("--seconds", seconds, &MAX_TIME_S)?;
    }
    check_apart(&[("--log", args.log.as_deref()), ("--out", args.out.as_deref())])?;
    let words: Vec<_> = args.command.iter().map(String::as_str).collect();
    if let Some(out) = &args.out
        && !matches!(words[..], ["dump", _] | ["bringup"])
    {
        return Err(InputError::new(format!("--out {}: only with dump or bringup", out.display())));
    }
    if args.seconds.is_some() && matches!(words[..], ["dump", ..] | ["bringup"]) {
        return Err(InputError::new("--seconds: not with dump or bringup, which end by themselves".to_owned()));
    }
    match (&words[..], &args.out) {
        (["dump", frames], Some(out)) => dump(cli, args, frames, out),
        (["dump", _], None) => Err(InputError::new("dump: --out FILE says where the frames go".to_owned())),
        (["bringup"], out) => bringup::bring_up(cli, Cable::open(cli, args)?, out.as_deref()),
        _ => listen(cli, args, &words.join(" ")),
    }
}

fn dump(cli: &Cli, args: &PortCommand, frames: &str, out: &Path) -> Result<ExitCode, InputError> {
    let wanted = frames.parse().ok().filter(|wanted| (1..=FRAMES_MAX).contains(wanted));
    let wanted = wanted
        .ok_or_else(|| InputError::new(format!("dump {frames}: expected a number of frames, 1 to {FRAMES_MAX}")))?;
    let snapshots = Cable::open(cli, args)?.dump(wanted)?;
    if snapshots.is_empty() {
        warn("no frames received");
        return Ok(ExitCode::from(1));
    }
    Recording::of(&snapshots).write(out)?;
    let frames = snapshots.len();
    say(&if cli.json {
        json_line(&Dumped { frames, out })?
    } else {
        format!("{frames} frames of {wanted} in {}\n", out.display())
    });
    Ok(ExitCode::from(u8::from(frames < usize::from(wanted))))
}

/// Sends the command, if there is one, and prints the texts that come.
fn listen(cli: &Cli, args: &PortCommand, command: &str) -> Result<ExitCode, InputError> {
    let mut cable = Cable::open(cli, args)?;
    let asks = !command.is_empty();
    if asks {
        cable.say(command);
    }
    let is_exam = matches!(command.split_whitespace().next(), Some("selftest" | "calibrate"));
    let patience = if is_exam { EXAMINATION } else { PATIENCE };
    let patience_s = args.seconds.or(asks.then_some(patience.as_secs_f64()));
    let begin = Instant::now();
    let mut heard_at = None;
    let (mut has_ended, mut has_failed) = (!is_exam, false);
    loop {
        for heard in cable.hear()? {
            if let Reply::Text(text) = heard {
                heard_at = Some(Instant::now());
                let is_refused = text.starts_with("error") || text.starts_with("refused");
                let is_bad = text.starts_with("Foxhound: self-test:") || text.starts_with("Foxhound: not calibrated");
                has_failed |= asks && (is_refused || is_exam && is_bad);
                has_ended |= has_failed
                    || ["Foxhound: self-test", "Foxhound: calibrated"].iter().any(|end| text.starts_with(end));
                say(&if cli.json { json_line(&Said { text: &text })? } else { format!("{text}\n") });
            }
        }
        let is_answered = asks && has_ended && heard_at.is_some_and(|at: Instant| at.elapsed() > SILENCE);
        let is_late = patience_s.is_some_and(|patience_s| begin.elapsed().as_secs_f64() > patience_s);
        if is_late && asks && heard_at.is_none() {
            warn("no answer");
            return Ok(ExitCode::from(1));
        }
        if is_late || is_answered && args.seconds.is_none() {
            if !has_ended {
                warn("no result came");
            }
            return Ok(ExitCode::from(u8::from(cable.was_cut || has_failed || !has_ended)));
        }
        sleep(READ_EVERY);
    }
}
