//! `foxhound port`: the maintenance port from the other end of the cable.

use std::fs::File;
use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use foxhound_computer::log::Record;
use foxhound_computer::log::frame::Deframer;
use foxhound_sim::input::{InputError, MAX_TIME_S, check_within};
use foxhound_sim::transport::{Address, BAUDS, Line};
use serde::Serialize;

use super::terminal::{say, warn};
use super::value::{number, whole};
use super::{Cli, json_line};

const PORT_HELP: &str = "Examples:
  foxhound port --serial /dev/ttyACM0 status
  foxhound port --serial /dev/ttyACM0 --log flight.log    until Ctrl-C

Exit status: 0 done as asked; 1 nobody answered; 2 bad usage, or no such port.";

/// After the last word of an answer so much silence.
const SILENCE: Duration = Duration::from_millis(300);
const BAUD_MIN: u64 = *BAUDS.start() as u64;
const BAUD_MAX: u64 = *BAUDS.end() as u64;
const READ_EVERY: Duration = Duration::from_millis(2);

#[derive(Args, Debug)]
#[command(after_help = PORT_HELP)]
pub(super) struct PortCommand {
    /// The serial port: of a NUCLEO board the one of its ST-LINK.
    #[arg(long, value_name = "DEVICE")]
    serial: PathBuf,
    /// Bits a second.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 921_600,
        value_parser = whole::<u32>(BAUD_MIN..=BAUD_MAX),
        allow_negative_numbers = true
    )]
    baud: u32,
    /// Keeps everything that comes.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Ends after that many seconds at the latest [default: 3 with a command, else never].
    #[arg(long, value_name = "S", value_parser = number(MAX_TIME_S), allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// What to say to it; `help` lists what it understands. Without, one only listens.
    command: Vec<String>,
}

#[derive(Serialize)]
struct Said<'a> {
    text: &'a str,
}

pub(super) fn port(cli: &Cli, args: &PortCommand) -> Result<ExitCode, InputError> {
    if let Some(seconds) = args.seconds {
        check_within("--seconds", seconds, &MAX_TIME_S)?;
    }
    let failed = |error: std::io::Error| InputError::new(error.to_string());
    let address = Address::Serial { device: args.serial.clone(), baud: args.baud };
    let mut line = Line::open(&address).map_err(|error| failed(error).in_file(&args.serial))?;
    let mut log = args.log.as_ref().map(File::create).transpose().map_err(failed)?;
    let asks = !args.command.is_empty();
    if asks {
        // Whatever was begun before is ended by the first line feed.
        line.write(format!("\n{}\n", args.command.join(" ")).as_bytes());
    }
    let patience_s = args.seconds.or(asks.then_some(3.0));
    let begin = Instant::now();
    let mut heard_at = None;
    let mut deframer = Box::new(Deframer::new());
    loop {
        let bytes = line.read();
        if let Some(log) = &mut log {
            log.write_all(&bytes).map_err(failed)?;
        }
        for byte in &bytes {
            let Some(frame) = deframer.push(*byte) else { continue };
            if let Some(Record::Text(text)) = Record::of(&frame) {
                heard_at = Some(Instant::now());
                say(&if cli.json { json_line(&Said { text })? } else { format!("{text}\n") });
            }
        }
        let is_answered = asks && heard_at.is_some_and(|at| at.elapsed() > SILENCE);
        if is_answered && args.seconds.is_none() {
            return Ok(ExitCode::SUCCESS);
        }
        if patience_s.is_some_and(|patience_s| begin.elapsed().as_secs_f64() > patience_s) {
            if asks && heard_at.is_none() {
                warn("nobody answered");
                return Ok(ExitCode::from(1));
            }
            return Ok(ExitCode::SUCCESS);
        }
        sleep(READ_EVERY);
    }
}
