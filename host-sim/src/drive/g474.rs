//! The shipped image for the NUCLEO-G474RE, flown unchanged: it runs in an instruction emulator with a model of the
//! chip's registers, `tests/g474`, a Python program in its own process.
//!
//! The board keeps its own time and takes its own samples; the simulation follows it, one step for every frame that
//! it passes to guidance. The image's results are read from its flight log on the maintenance port. This process's
//! own computer ([`super::replay`]) repeats every step, with the bytes that the log contains and the samples that the
//! converters were given; the trace hashes must be equal at every step.

use std::fmt;
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use super::child::ends_with_us;
use foxhound_core::base::adc::AdcFrame;
use object::{Object as _, ObjectSection as _};
use serde::{Deserialize, Deserializer};
use serde_json::{Value, json};

mod computer;
mod mission;
pub mod timing;
pub mod trial;

pub use computer::{G474Computer, Received};
pub use mission::Needs;

use super::computer::BLOCK;

/// The board's name in the `.foxhound_board` section of an image.
const BOARD: &str = "nucleo_g474re";
const BOARD_SECTION: &str = ".foxhound_board";
/// Path of the model in the repository.
const MODEL: &str = "tests/g474/serve.py";
/// Environment variable that names the Python to run it.
const PYTHON: &str = "FOXHOUND_PYTHON";
/// The Python environment that `cargo xtask test` makes.
const OWN_PYTHON: &str = "target/venv/bin/python";
/// Half of the converters' scale, which the firmware subtracts.
const HALF_SCALE: i16 = 2048;

/// Why the board does not run, or does not continue.
#[derive(Debug)]
pub enum G474Error {
    /// The file is not an image for this board.
    Image(String),
    /// The model does not start.
    Start(String),
    /// The image violated a rule of the chip: the rule's name, and a sentence.
    Broken {
        /// The rule, by its name in `tests/g474/rules.py`.
        rule: String,
        /// Its text, and where it was violated.
        sentence: String,
    },
    /// The model has ended.
    Lost(String),
}

impl fmt::Display for G474Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Image(why) | Self::Start(why) => f.write_str(why),
            Self::Broken { sentence, .. } => write!(f, "the image violates a rule of the chip: {sentence}"),
            Self::Lost(why) => write!(f, "the model of the board has ended: {why}"),
        }
    }
}

impl std::error::Error for G474Error {}

impl From<io::Error> for G474Error {
    fn from(error: io::Error) -> Self {
        Self::Lost(error.to_string())
    }
}

/// Options at the start of a board.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Seed of the memory's content at power-on.
    pub seed: u64,
    /// Its crystal.
    pub crystal: Crystal,
    /// With its option bytes as delivered.
    pub is_new: bool,
}

/// A board's crystal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Crystal {
    /// It starts and goes on.
    #[default]
    Works,
    /// It does not start.
    Missing,
    /// It starts, and stops whenever the PLL is switched on.
    Fails,
}

/// A restart of the board.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Restarted {
    /// Time since power-on.
    #[serde(rename = "us")]
    pub time_us: f64,
    /// Its cause: `watchdog`, `software`, `pin`, `brown-out`, `cut`, `power`.
    pub cause: String,
}

/// The board's activity since the last report.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Report {
    /// Time since power-on.
    pub now_us: f64,
    /// When the frame of the next step's samples is passed on.
    pub frame_us: f64,
    /// Whether its converters run.
    pub is_sampling: bool,
    /// All converters have filled as much of their rings.
    pub is_in_step: bool,
    /// When the firmware's own time began.
    pub origin_us: f64,
    /// Bytes sent on USART1.
    #[serde(deserialize_with = "hexadecimal")]
    pub tx: Vec<u8>,
    /// Bytes sent on LPUART1.
    #[serde(deserialize_with = "hexadecimal")]
    pub log: Vec<u8>,
    /// Restarts.
    pub resets: Vec<Restarted>,
}

fn hexadecimal<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<u8>, D::Error> {
    let text = String::deserialize(from)?;
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    let bytes = text.as_bytes().chunks(2).map(byte).collect::<Option<_>>();
    bytes.ok_or_else(|| serde::de::Error::custom("expected hexadecimal digits"))
}

fn in_hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A running board.
#[derive(Debug)]
pub struct Board {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Board {
    /// Switches a board on, and runs it up to its first frame.
    ///
    /// # Errors
    /// The file is not an image for this board, there is no Python with `unicorn`, or the image violates a rule.
    pub fn start(elf: &Path, options: Options) -> Result<(Self, Report), G474Error> {
        check_image(elf)?;
        let model = find(Path::new(MODEL)).ok_or_else(|| {
            G474Error::Start(format!("{MODEL} is missing: start this inside Foxhound's repository, which has it"))
        })?;
        let python = std::env::var_os(PYTHON).map(PathBuf::from).or_else(|| find(Path::new(OWN_PYTHON)));
        let python = python.unwrap_or_else(|| PathBuf::from("python3"));
        let mut command = Command::new(&python);
        command.arg("-B").arg(model).arg(elf).arg("--seed").arg(options.seed.to_string());
        command.arg("--crystal").arg(match options.crystal {
            Crystal::Works => "works",
            Crystal::Missing => "missing",
            Crystal::Fails => "fails",
        });
        if options.is_new {
            command.arg("--new");
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = ends_with_us(&mut command)
            .spawn()
            .map_err(|error| G474Error::Start(format!("{} does not start: {error}", python.display())))?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(G474Error::Start("the model has no pipes".to_owned()));
        };
        let mut board = Self { child, input, output: BufReader::new(output) };
        match board.answer() {
            Ok(answer) => Ok((board, read_report(answer)?)),
            Err(G474Error::Lost(why)) => Err(G474Error::Start(format!(
                "{} does not run the board's model; it needs the package unicorn==2.1.4, which `cargo xtask test` installs \
                 (or name a Python that has it in {PYTHON}): {why}",
                python.display()
            ))),
            Err(error) => Err(error),
        }
    }

    /// Runs to shortly before the next frame: with bytes for the serial lines from now on, and samples for the
    /// converters.
    ///
    /// # Errors
    /// The image violates a rule, or the model has ended.
    pub fn step(
        &mut self,
        rx: &[u8],
        port: &[u8],
        lidar: &[u8],
        codes: Option<&AdcFrame<BLOCK>>,
    ) -> Result<Report, G474Error> {
        let codes = codes.map_or_else(Vec::new, |snapshot| {
            let codes = snapshot.codes.as_flattened().iter();
            codes.flat_map(|code| code.saturating_add(HALF_SCALE).to_le_bytes()).collect()
        });
        let [rx, port, lidar, codes] = [rx, port, lidar, &codes].map(in_hexadecimal);
        self.ask(&json!({ "do": "step", "rx": rx, "port": port, "lidar": lidar, "codes": codes }))
    }

    /// Runs for `us` microseconds, with bytes for the lines of autopilot and port from now on.
    ///
    /// # Errors
    /// As of [`step`](Self::step).
    pub fn run(&mut self, us: u64, rx: &[u8], port: &[u8]) -> Result<Report, G474Error> {
        self.ask(&json!({ "do": "run", "us": us, "rx": in_hexadecimal(rx), "port": in_hexadecimal(port) }))
    }

    /// Injects a fault; `tests/g474/serve.py` lists them.
    ///
    /// # Errors
    /// As of [`step`](Self::step).
    pub fn fault(&mut self, fault: &Value) -> Result<Report, G474Error> {
        let mut line = fault.clone();
        line["do"] = json!("fault");
        self.ask(&line)
    }

    /// The use of the board's time.
    ///
    /// # Errors
    /// The model has ended.
    pub fn timing(&mut self) -> Result<Value, G474Error> {
        self.say(&json!({ "do": "timing" }))?;
        self.answer()
    }

    fn ask(&mut self, line: &Value) -> Result<Report, G474Error> {
        self.say(line)?;
        read_report(self.answer()?)
    }

    fn say(&mut self, line: &Value) -> Result<(), G474Error> {
        writeln!(self.input, "{line}").and_then(|()| self.input.flush()).or_else(|_| self.answer().map(|_| ()))
    }

    fn answer(&mut self) -> Result<Value, G474Error> {
        let mut line = String::new();
        if self.output.read_line(&mut line)? == 0 {
            let mut errors = String::new();
            if let Some(mut stderr) = self.child.stderr.take() {
                stderr.read_to_string(&mut errors)?;
            }
            return Err(G474Error::Lost(errors.trim().lines().last().unwrap_or("without a word").to_owned()));
        }
        let answer: Value = serde_json::from_str(&line).map_err(io::Error::from)?;
        match (answer["rule"].as_str(), answer["broken"].as_str()) {
            (Some(rule), Some(sentence)) => {
                Err(G474Error::Broken { rule: rule.to_owned(), sentence: sentence.to_owned() })
            }
            _ => Ok(answer),
        }
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // It may be gone already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn read_report(answer: Value) -> Result<Report, G474Error> {
    Ok(serde_json::from_value(answer).map_err(io::Error::from)?)
}

/// A file of the repository: in a folder above the current one, or above this program.
fn find(name: &Path) -> Option<PathBuf> {
    let places = [std::env::current_dir().ok(), std::env::current_exe().ok()];
    let folders = places.iter().flatten().flat_map(|place| place.ancestors());
    folders.map(|folder| folder.join(name)).find(|path| path.exists())
}

/// Refuses every file that is not an image for this board, and reports what it is.
fn check_image(path: &Path) -> Result<(), G474Error> {
    let refuse = |why: String| G474Error::Image(format!("{}: {why}", path.display()));
    let bytes = std::fs::read(path).map_err(|error| refuse(format!("it cannot be read ({error})")))?;
    let image = object::File::parse(bytes.as_slice()).map_err(|_| refuse("it is not an ELF file".to_owned()))?;
    let section = image.section_by_name(BOARD_SECTION);
    match section.as_ref().and_then(|section| section.data().ok()) {
        Some(name) if name == BOARD.as_bytes() => Ok(()),
        Some(name) => Err(refuse(format!("it is for the board {}, not for {BOARD}", String::from_utf8_lossy(name)))),
        None => Err(refuse(format!("it is not an image of Foxhound (no {BOARD_SECTION} section)"))),
    }
}
