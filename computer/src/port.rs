//! The maintenance port: a person with a cable types a line, the flight computer answers with text. It cannot fly the
//! vehicle, and reveals no keys: its answers are sent between the frames of the flight log ([`crate::log`]).
//!
//! | line | what happens | while in control |
//! |---|---|---|
//! | `help` | lists the commands | answered |
//! | `status` | prints version, restart, clock, deadlines, stack, outcome, link, lines, watchdog and the times of all tasks | answered |
//! | `selftest`, `selftest tone`, `calibrate` | tests the receiver, or calibrates its channels ([`crate::selftest`]) | refused |
//! | `factory-reset` | prints an explanation; `factory-reset yes` erases everything stored | refused |
//! | `dump N` | the samples of the next N frames go into the log | refused |
//! | `watchdog` | prints an explanation; `watchdog yes` stops feeding it, so that it restarts the computer | refused |
//! | `restart` | the computer restarts, and comes up in standby | refused |
//! | frames of a camera, between zeros | are searched for the pad ([`crate::camera`]) | accepted |
//!
//! A line ends with a carriage return, a line feed or both. One that is longer than [`LINE_MAX`], is not ASCII or is
//! not a command is answered by an error, and nothing happens. A backspace deletes a letter.

use core::fmt;

use foxhound_core::guidance::mission::{Control, Outcome};
use foxhound_link::companion;
use heapless::{String, Vec};

use crate::deadline::Counts;
use crate::restart::{Restart, decimal};
use crate::selftest::{self, Report};
use crate::sensor::Sensor;
use crate::timing::{self, BINS, Feeds, Task};
use crate::{lidar, radio};

/// Longest line.
pub const LINE_MAX: usize = 40;
/// Longest answer in one piece.
pub const ANSWER_MAX: usize = 96;
/// Most frames of one `dump`: 200 s.
pub const FRAMES_MAX: u16 = 10_000;

/// A command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// The list of commands.
    Help,
    /// The status.
    Status,
    /// A test of the receiver.
    SelfTest {
        /// With the board's own tone; otherwise with one through a splitter.
        own_tone: bool,
    },
    /// A calibration of the channels.
    Calibrate,
    /// Erases everything stored.
    FactoryReset {
        /// Whether it was confirmed.
        is_sure: bool,
    },
    /// Raw frames of the converters.
    Dump {
        /// Number of frames.
        frames: u16,
    },
    /// A restart by the watchdog.
    Watchdog {
        /// Whether it was confirmed.
        is_sure: bool,
    },
    /// A restart.
    Restart,
}

/// Why a line is not a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// It is longer than [`LINE_MAX`].
    TooLong,
    /// It contains something else than ASCII.
    NotText,
    /// The command is unknown.
    Unknown,
    /// The command does not take this argument.
    Surplus,
    /// Not a valid number of frames.
    Frames,
}

impl Refusal {
    /// The answer.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::TooLong => "error: the line is too long",
            Self::NotText => "error: the line is not ASCII",
            Self::Unknown => "error: no such command; see `help`",
            Self::Surplus => "error: invalid argument; see `help`",
            Self::Frames => "error: expected a number of frames, 1 to 10000",
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.words())
    }
}

impl Command {
    /// Whether it must not be carried out while in control.
    #[must_use]
    pub const fn disturbs(self) -> bool {
        !matches!(self, Self::Help | Self::Status)
    }

    /// Whether it is carried out; otherwise the text that gives the reason.
    ///
    /// # Errors
    /// It disturbs, and we are in control.
    pub fn admit(self, control: Control) -> Result<Self, &'static str> {
        if self.disturbs() && control == Control::Granted {
            return Err("refused: in control; leave the mode first");
        }
        Ok(self)
    }

    fn parse(line: &[u8]) -> Option<Result<Self, Refusal>> {
        let mut words = line.split(|byte| byte.is_ascii_whitespace()).filter(|word| !word.is_empty());
        let (name, argument, rest) = (words.next()?, words.next(), words.next());
        let command = match name {
            b"help" | b"?" => Self::Help,
            b"status" => Self::Status,
            b"selftest" => Self::SelfTest { own_tone: argument == Some(b"tone") },
            b"calibrate" => Self::Calibrate,
            b"factory-reset" => Self::FactoryReset { is_sure: argument == Some(b"yes") },
            b"dump" => match frames(argument.unwrap_or_default()) {
                Some(frames) => Self::Dump { frames },
                None => return Some(Err(Refusal::Frames)),
            },
            b"watchdog" => Self::Watchdog { is_sure: argument == Some(b"yes") },
            b"restart" => Self::Restart,
            _ => return Some(Err(Refusal::Unknown)),
        };
        let takes = match command {
            Self::FactoryReset { is_sure: takes }
            | Self::SelfTest { own_tone: takes }
            | Self::Watchdog { is_sure: takes } => takes,
            Self::Dump { .. } => true,
            _ => false,
        };
        let is_surplus = argument.is_some() && !takes;
        Some(if is_surplus || rest.is_some() { Err(Refusal::Surplus) } else { Ok(command) })
    }
}

/// A number of frames, up to [`FRAMES_MAX`].
fn frames(digits: &[u8]) -> Option<u16> {
    let frames = str::from_utf8(digits).ok()?.parse().ok()?;
    (1..=FRAMES_MAX).contains(&frames).then_some(frames)
}

/// Assembles lines.
#[derive(Debug)]
pub struct Lines {
    line: Vec<u8, LINE_MAX>,
    refusal: Option<Refusal>,
}

impl Lines {
    /// Before the first byte.
    #[must_use]
    pub const fn new() -> Self {
        Self { line: Vec::new(), refusal: None }
    }

    /// Takes a byte; returns the command of the line that it ends, unless that is empty.
    pub fn push(&mut self, byte: u8) -> Option<Result<Command, Refusal>> {
        match byte {
            b'\r' | b'\n' => {
                let refused = self.refusal.take().map(Err);
                let ended = refused.or_else(|| Command::parse(&self.line));
                self.line.clear();
                return ended;
            }
            0x08 | 0x7f => {
                self.line.pop();
            }
            b'\t' | b' '..=b'~' => {
                if self.line.push(byte).is_err() {
                    self.refusal.get_or_insert(Refusal::TooLong);
                }
            }
            _ => {
                self.refusal.get_or_insert(Refusal::NotText);
            }
        }
        None
    }
}

impl Default for Lines {
    fn default() -> Self {
        Self::new()
    }
}

/// The text of `help`.
pub const HELP: [&str; 9] = [
    "help: this list",
    "status: of everything",
    "selftest: of the receiver, with a tone through a splitter; disarmed",
    "selftest tone: the same with the board's own tone",
    "calibrate: the channels, with a tone through a splitter; disarmed",
    "factory-reset yes: erase everything stored; not in control",
    "dump N: log the samples of the next N frames; not in control",
    "watchdog yes: stop feeding the watchdog, to test its restart; not in control",
    "restart: into standby; not in control",
];

/// Source of the computer's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clock {
    /// The crystal.
    Crystal,
    /// The chip's own oscillator, because the crystal does not start. Sample rate, tones and times are off by up to 1
    /// % from 0 to 85 °C (DS12288, HSI16 oscillator characteristics).
    Internal,
    /// The simulator.
    Simulated,
}

impl Clock {
    /// Text for `status`.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Crystal => "clock: crystal (HSE)",
            Self::Internal => "clock: no crystal; HSI, sample rate and times off by up to 1 %",
            Self::Simulated => "clock: the simulator's",
        }
    }
}

/// Content of `status`.
#[derive(Clone, Copy, Debug)]
pub struct Status<'a> {
    /// Name of the board.
    pub board: &'a str,
    /// Since the start.
    pub uptime_s: u32,
    /// Why it has started.
    pub restart: &'a Restart,
    /// Source of the clock.
    pub clock: Clock,
    /// Timing of the steps.
    pub deadlines: Counts,
    /// Largest use of the stack found so far.
    pub stack_bytes: u32,
    /// Outcome of the last step; `None` before the first.
    pub outcome: Option<Outcome>,
    /// The link.
    pub link: companion::Counters,
    /// Damaged bytes from the autopilot: noise, framing errors, overruns.
    pub line_errors: u32,
    /// Bytes from the autopilot that waited to be read.
    pub received: Waiting,
    /// Bytes to the autopilot that waited to be sent.
    pub sent: Waiting,
    /// The sensor on a line of its own, if there is one.
    pub sensor: Option<SensorStatus>,
    /// Bytes of the log that waited to be sent; frames that were dropped.
    pub log: Waiting,
    /// Number of starts, 0 if it cannot be read from the flash.
    pub starts: u32,
    /// Feeding of the watchdog, and its timeout.
    pub feeds: Feeds,
    /// The watchdog's timeout.
    pub watchdog_us: u32,
}

/// State of a lidar or a radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorStatus {
    /// Its frames or lines.
    pub counters: SensorCounters,
    /// Bytes that waited to be read.
    pub received: Waiting,
    /// Damaged bytes: noise, framing errors, overruns.
    pub line_errors: u32,
}

/// Counts of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensorCounters {
    /// Of a lidar.
    Lidar(lidar::Counters),
    /// Of a radio.
    Radio(radio::Counters),
}

impl SensorCounters {
    /// Those of a sensor.
    #[must_use]
    pub const fn of(sensor: &Sensor) -> Self {
        match sensor {
            Sensor::Lidar(lidar) => Self::Lidar(lidar.counters()),
            Sensor::Radio(radio) => Self::Radio(radio.counters()),
        }
    }
}

/// Bytes that wait in a buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Waiting {
    /// The largest number so far.
    pub most: u32,
    /// Size of the buffer.
    pub room: u32,
    /// Bytes that did not fit.
    pub lost: u32,
}

/// Lines of `status` before those of the tasks.
const HEAD_LINES: usize = 13;
/// Lines of a task: its range, and the histogram.
const TASK_LINES: usize = 1 + BINS.div_ceil(BINS_PER_LINE);
const BINS_PER_LINE: usize = 6;

impl Status<'_> {
    /// How many times [`tell`](Self::tell) is to be called.
    pub const LINES: usize = HEAD_LINES + Task::ALL.len() * TASK_LINES;

    /// Prints a part of it, from 0 to [`LINES`](Self::LINES): one line or none. `times` are those of the tasks.
    pub fn tell(&self, part: usize, times: &timing::Table, line: impl FnOnce(&str)) {
        let mut words = Words::new();
        if let Some(task_part) = part.checked_sub(HEAD_LINES) {
            self.put_task(&mut words, task_part, times);
        } else {
            self.put_head(&mut words, part);
        }
        if !words.text.is_empty() {
            line(words.end());
        }
    }

    fn put_head(&self, words: &mut Words, part: usize) {
        match part {
            0 => {
                words.text("foxhound ").text(env!("CARGO_PKG_VERSION")).text(" on ").text(self.board);
                words.text(", up ").number(self.uptime_s).text(" s")
            }
            1 => {
                let mut digits = [0; 10];
                let [what, which] = self.restart.parts(&mut digits);
                words.text("restart: ").text(what).text(which)
            }
            2 => words.text(self.clock.words()),
            3 => {
                let Counts { steps, late, longest_us } = self.deadlines;
                words.text("steps ").number(steps).text(", late ").number(late);
                words.text(", longest ").number(longest_us).text(" us, stack ").number(self.stack_bytes).text(" bytes")
            }
            4 => words.text("outcome ").text(self.outcome.map_or("none yet", Outcome::name)),
            5 => {
                let companion::Counters { framer, rejected, setpoints_late, reboots, .. } = self.link;
                words.text("link: frames ").number(framer.frames).text(", damaged ").number(framer.bad_crc);
                words.text(", missing ").number(framer.lost).text(", rejected ").number(rejected);
                words.text(", setpoints late ").number(setpoints_late).text(", reboots ").number(reboots)
            }
            6 => {
                let words = words.waiting("received: ", self.received);
                words.text(", lost ").number(self.received.lost).text(", damaged ").number(self.line_errors)
            }
            7 => words.waiting("sent: ", self.sent),
            8 => match self.sensor.map(|sensor| sensor.counters) {
                Some(SensorCounters::Lidar(lidar::Counters { frames, bad, turns })) => {
                    words.text("lidar: turns ").number(turns).text(", frames ").number(frames);
                    words.text(", damaged ").number(bad)
                }
                Some(SensorCounters::Radio(radio::Counters { angles, others, unclear, refused })) => {
                    words.text("radio: angles ").number(angles).text(", of other tags ").number(others);
                    words.text(", without direction ").number(unclear).text(", refused ").number(refused)
                }
                None => words,
            },
            9 => match &self.sensor {
                Some(SensorStatus { counters, received, line_errors }) => {
                    let is_lidar = matches!(counters, SensorCounters::Lidar(_));
                    let words = words.waiting(if is_lidar { "lidar: " } else { "radio: " }, *received);
                    words.text(", lost ").number(received.lost).text(", damaged ").number(*line_errors)
                }
                None => words,
            },
            10 => words.text("log: frames left out ").number(self.log.lost).waiting(", ", self.log),
            11 => {
                words.text("watchdog: fed after ").number(self.feeds.longest_us()).text(" us at the longest, of ");
                words.number(self.watchdog_us).text(" us; start ").number(self.starts)
            }
            _ => words.text(match self.clock {
                Clock::Simulated => "cycles of 170 MHz: 1.5 an instruction assumed, no flash stalls",
                _ => "cycles of 170 MHz",
            }),
        };
    }

    fn put_task(&self, words: &mut Words, part: usize, times: &timing::Table) {
        let (task, part) = (part / TASK_LINES, part % TASK_LINES);
        let (Some(task), Some(times)) = (Task::ALL.get(task), times.get(task)) else { return };
        if part > 0 {
            let mut bins = times.bins().skip((part - 1) * BINS_PER_LINE).take(BINS_PER_LINE).peekable();
            if bins.peek().is_some() {
                words.text("  ");
            }
            for (exponent, count) in bins {
                match exponent {
                    Some(exponent) => words.text(" <2^").number(exponent),
                    None => words.text(" more"),
                };
                words.text(" ").number(count);
            }
            return;
        }
        words.text(task.name()).text(": ").number(times.runs()).text(" times, cycles");
        for cycles in times.range() {
            words.text(" ").number(cycles);
        }
        words.text(" (min, mean, max)");
    }
}

/// Prints the measurements of a test of the receiver, and its result, in lines.
pub fn tell_report(report: &Report, mut line: impl FnMut(&str)) {
    let mut words = Words::new();
    words.text(&selftest::words(report.exam, report.verdict));
    line(words.end());
    words.text("frames ").number(report.frames.into()).text(", tone ").signed(report.frequency_hz);
    words.text(" Hz, ").signed(report.snr_centi_db).text(" centi-dB over the noise, rate off ");
    words.signed(report.rate_off_ppm).text(" ppm");
    line(words.end());
    line("channel: offset, noise, amplitude (centi-codes), noise (centi-dB full scale), clipped (ppm)");
    for (number, channel) in (1..).zip(&report.channels) {
        words.number(number).text(": ").signed(channel.offset_centi_codes);
        for value in
            [channel.noise_centi_codes, channel.amplitude_centi_codes, channel.noise_centi_dbfs, channel.clipped_ppm]
        {
            words.text(", ").signed(value);
        }
        line(words.end());
    }
    line("channel: gain (centi-dB), phase, its deviation (milli-degrees)");
    for (number, channel) in (1..).zip(&report.channels) {
        words.number(number).text(": ").signed(channel.gain_centi_db);
        words.text(", ").signed(channel.phase_mdeg).text(", ").signed(channel.phase_sigma_mdeg);
        line(words.end());
    }
}

/// Builds an answer without the standard formatting of numbers, which takes 2 KB of flash. What does not fit is cut
/// off.
#[derive(Debug)]
struct Words {
    text: String<ANSWER_MAX>,
    is_ended: bool,
}

impl Words {
    fn new() -> Self {
        Self { text: String::new(), is_ended: false }
    }

    #[inline(never)]
    fn text(&mut self, text: &str) -> &mut Self {
        if core::mem::take(&mut self.is_ended) {
            self.text.clear();
        }
        // The rest is cut off.
        let _ = text.chars().try_for_each(|letter| self.text.push(letter));
        self
    }

    #[inline(never)]
    fn number(&mut self, number: u32) -> &mut Self {
        self.text(decimal(number, &mut [0; 10]))
    }

    fn signed(&mut self, number: i32) -> &mut Self {
        if number < 0 {
            self.text("-");
        }
        self.number(number.unsigned_abs())
    }

    fn waiting(&mut self, what: &str, Waiting { most, room, .. }: Waiting) -> &mut Self {
        self.text(what).text("at most ").number(most).text(" of ").number(room).text(" bytes waited")
    }

    fn end(&mut self) -> &str {
        self.is_ended = true;
        &self.text
    }
}

#[cfg(test)]
mod tests;
