//! `foxhound port ... bringup`: tests a board that runs for the first time, check by check, by its answers.

use std::path::Path;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::{Duration, Instant};

use foxhound_computer::SAMPLES_PER_CHANNEL;
use foxhound_computer::selftest::{CLIPPED_MAX, OFFSET_MAX_CODES};
use foxhound_core::base::adc::{AdcFrame, CHANNELS, CODE_MAX, CODE_MIN};
use foxhound_sim::scenario::input::InputError;
use foxhound_sim::tools::frames::Recording;
use serde::Serialize;

use super::super::terminal::{say, warn};
use super::super::{Cli, json_line};
use super::{Cable, EXAMINATION, PATIENCE};

/// Frames that are examined.
const FRAMES: u16 = 32;
/// Heartbeats come once a second.
const LISTEN: Duration = Duration::from_secs(3);
/// A watchdog timeout, a start, and a crystal that does not start.
const RESTART: Duration = Duration::from_secs(20);
/// A tone in one channel: its samples vary this many times as much as those of the others.
const TONE_RATIO: f64 = 10.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Verdict {
    Passed,
    Failed,
    NotChecked,
}

#[derive(Debug, Serialize)]
struct Check {
    check: &'static str,
    verdict: Verdict,
    found: String,
}

#[derive(Debug, Default, Serialize)]
struct BringUp {
    checks: Vec<Check>,
    /// All answers of the board.
    answers: Vec<String>,
}

/// Runs all checks and prints their results.
pub(super) fn bring_up(cli: &Cli, mut cable: Cable, out: Option<&Path>) -> Result<ExitCode, InputError> {
    let mut report = BringUp::default();
    let status = report.ask(&mut cable, "status", PATIENCE)?;
    if status.is_empty() {
        warn("no answer: check the port, the baud rate, and whether the board runs");
        return Ok(ExitCode::from(1));
    }
    report.add("port", Verdict::Passed, "answers: both directions of the maintenance port work".to_owned());
    report.clock(&status);
    report.late(&status);
    let has_frames = report.frames(&mut cable, out)?;
    report.tone(&mut cable, has_frames)?;
    report.line(&mut cable, &status)?;
    let start = report.restarts(&mut cable, "flash", "restart", "restart: as asked", starts(&status))?;
    report.restarts(&mut cable, "watchdog", "watchdog yes", "restart: watchdog", start)?;
    let has_failed = report.checks.iter().any(|check| check.verdict == Verdict::Failed);
    if cli.json {
        say(&json_line(&report)?);
    } else {
        say(&report.words());
    }
    Ok(ExitCode::from(u8::from(has_failed)))
}

/// The text that follows a word in one of the lines.
fn after<'a>(lines: &'a [String], word: &str) -> Option<&'a str> {
    lines.iter().find_map(|line| line.split_once(word)).map(|(_, rest)| rest)
}

/// The number that follows a word in one of the lines.
fn number(lines: &[String], word: &str) -> Option<u32> {
    after(lines, word)?.split(|letter: char| !letter.is_ascii_digit()).next()?.parse().ok()
}

fn starts(status: &[String]) -> Option<u32> {
    number(status, "; start ").filter(|start| *start > 0)
}

impl BringUp {
    fn ask(&mut self, cable: &mut Cable, command: &str, patience: Duration) -> Result<Vec<String>, InputError> {
        let mut lines = Vec::new();
        cable.ask(command, patience, |line| lines.push(line))?;
        self.answers.push(format!("> {command}"));
        self.answers.extend_from_slice(&lines);
        Ok(lines)
    }

    fn add(&mut self, check: &'static str, verdict: Verdict, found: String) {
        self.checks.push(Check { check, verdict, found });
    }

    fn clock(&mut self, status: &[String]) {
        let words = after(status, "clock: ").unwrap_or("not told");
        let verdict = if words.starts_with("crystal") || words.starts_with("the simulator") {
            Verdict::Passed
        } else {
            Verdict::Failed
        };
        self.add("clock", verdict, words.to_owned());
    }

    fn late(&mut self, status: &[String]) {
        let verdict = if number(status, ", late ") == Some(0) { Verdict::Passed } else { Verdict::Failed };
        self.add("steps", verdict, format!("steps {}", after(status, "steps ").unwrap_or("not told")));
    }

    /// Noise and offset of each channel, and which channel has a tone; returns whether there are frames.
    fn frames(&mut self, cable: &mut Cable, out: Option<&Path>) -> Result<bool, InputError> {
        let frames = cable.dump(FRAMES)?;
        if frames.is_empty() {
            self.add("frames", Verdict::Failed, "no frames: converters, timer or DMA do not run".to_owned());
            return Ok(false);
        }
        if let Some(out) = out {
            Recording::of(&frames).write(out)?;
        }
        let channels: [Channel; CHANNELS] = std::array::from_fn(|channel| Channel::of(&frames, channel));
        for (channel, found) in channels.iter().enumerate() {
            let verdict = if found.is_sound() { Verdict::Passed } else { Verdict::Failed };
            self.add(CHANNEL[channel], verdict, found.words());
        }
        let loud = |at: usize| {
            let others = channels.iter().enumerate().filter(|(other, _)| *other != at);
            others.map(|(_, other)| other.noise_codes).fold(0.0, f64::max) * TONE_RATIO < channels[at].noise_codes
        };
        let (verdict, found) = match (0..CHANNELS).find(|at| loud(*at)) {
            Some(at) => {
                (Verdict::Passed, format!("a tone in {} only: check that it is connected to that input", CHANNEL[at]))
            }
            None => {
                (Verdict::NotChecked, "put a tone into one input at a time, and run this again for each".to_owned())
            }
        };
        self.add("order", verdict, found);
        Ok(true)
    }

    /// The board's own tone, tested by the self-test.
    fn tone(&mut self, cable: &mut Cable, has_frames: bool) -> Result<(), InputError> {
        if !has_frames {
            self.add("tone", Verdict::NotChecked, "no frames".to_owned());
            return Ok(());
        }
        let mut lines = self.ask(cable, "selftest tone", PATIENCE)?;
        let begin = Instant::now();
        while after(&lines, "self-test").is_none() && begin.elapsed() < EXAMINATION {
            cable.ask("", Duration::from_millis(100), |line| lines.push(line))?;
        }
        self.answers.extend_from_slice(&lines);
        let found = after(&lines, "self-test").map_or("no answer", |words| words.trim_start_matches([':', ' ']));
        let (verdict, hint) = match found {
            "passed" => (Verdict::Passed, ""),
            "no tone" => (Verdict::NotChecked, ": PA4 goes through four equal resistors to the four inputs"),
            _ => (Verdict::Failed, ""),
        };
        self.add("tone", verdict, format!("{found}{hint}"));
        Ok(())
    }

    /// What arrives on the autopilot's line, from an autopilot or from the board itself.
    fn line(&mut self, cable: &mut Cable, before: &[String]) -> Result<(), InputError> {
        sleep(LISTEN);
        let after = self.ask(cable, "status", PATIENCE)?;
        let came = |word| number(&after, word).unwrap_or(0).saturating_sub(number(before, word).unwrap_or(0));
        let (frames, damaged) = (came("link: frames "), came(", damaged "));
        let (verdict, found) = match (frames, damaged) {
            (0, 0) => (
                Verdict::NotChecked,
                "nothing received: join PA9 and PA10 (D8 and D2), so that the board receives its own heartbeats"
                    .to_owned(),
            ),
            (0, _) => (Verdict::Failed, format!("{damaged} damaged frames and no intact one")),
            _ => (Verdict::Passed, format!("{frames} frames, {damaged} damaged")),
        };
        self.add("autopilot's line", verdict, found);
        Ok(())
    }

    /// Restarts the board in one of two ways; returns the number of this start.
    fn restarts(
        &mut self,
        cable: &mut Cable,
        check: &'static str,
        command: &str,
        reason: &str,
        start: Option<u32>,
    ) -> Result<Option<u32>, InputError> {
        self.ask(cable, command, PATIENCE)?;
        let begin = Instant::now();
        let mut status = Vec::new();
        while begin.elapsed() < RESTART && !status.iter().any(|line: &String| line.starts_with(reason)) {
            sleep(READ_EVERY_START);
            status = self.ask(cable, "status", PATIENCE)?;
        }
        let told = after(&status, "restart: ").unwrap_or("no answer").to_owned();
        let now = starts(&status);
        let is_counted = start.is_some() && now == start.map(|start| start + 1);
        let is_told = status.iter().any(|line| line.starts_with(reason));
        let verdict = if is_counted && is_told { Verdict::Passed } else { Verdict::Failed };
        let count = |start: Option<u32>| start.map_or("unknown".to_owned(), |start| start.to_string());
        self.add(check, verdict, format!("restart: {told}; start {}, before {}", count(now), count(start)));
        Ok(now)
    }

    fn words(&self) -> String {
        let mut text = String::new();
        for Check { check, verdict, found } in &self.checks {
            let verdict = match verdict {
                Verdict::Passed => "passed",
                Verdict::Failed => "FAILED",
                Verdict::NotChecked => "not checked",
            };
            text.push_str(&format!("{verdict:<12} {check:<17} {found}\n"));
        }
        text.push_str("\nTo attach to a report: these lines, the answers below, and the frames (--out FILE).\n\n");
        self.answers.iter().for_each(|line| text.push_str(&format!("{line}\n")));
        text
    }
}

const READ_EVERY_START: Duration = Duration::from_millis(300);
const CHANNEL: [&str; CHANNELS] = ["channel A1", "channel A2", "channel A3", "channel A4"];

/// Statistics of the samples of one channel.
struct Channel {
    offset_codes: f64,
    noise_codes: f64,
    lowest: i16,
    highest: i16,
    /// Share of samples at a rail.
    clipped: f64,
}

impl Channel {
    fn of(frames: &[AdcFrame<SAMPLES_PER_CHANNEL>], channel: usize) -> Self {
        let codes = || frames.iter().flat_map(|frame| frame.codes[channel]);
        let count = codes().count() as f64;
        let offset_codes = codes().map(f64::from).sum::<f64>() / count;
        let power = codes().map(|code| (f64::from(code) - offset_codes).powi(2)).sum::<f64>() / count;
        let at_rail = codes().filter(|code| [CODE_MIN, CODE_MAX].contains(code)).count() as f64;
        let (lowest, highest) = (codes().min().unwrap_or(0), codes().max().unwrap_or(0));
        Self { offset_codes, noise_codes: power.sqrt(), lowest, highest, clipped: at_rail / count }
    }

    fn is_sound(&self) -> bool {
        self.lowest < self.highest
            && self.offset_codes.abs() <= f64::from(OFFSET_MAX_CODES)
            && self.clipped <= f64::from(CLIPPED_MAX)
    }

    fn words(&self) -> String {
        let Self { offset_codes, noise_codes, lowest, highest, clipped } = self;
        format!(
            "offset {offset_codes:.1} codes, rms {noise_codes:.2} codes, from {lowest} to {highest}, {:.1} % at a rail",
            100.0 * clipped
        )
    }
}
