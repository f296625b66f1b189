//! Output to the terminal: results to stdout; notes, progress and errors to stderr. Input from it: Ctrl-C.
//!
//! Colours and bars are for terminals: text that goes into a pipe or a file is plain, and so is all text if
//! `NO_COLOR` is set. No information is in a colour alone.

use std::io::{self, Write as _};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use anstyle::{AnsiColor, Style};
use foxhound_sim::scenario::input::InputError;
use foxhound_sim::scenario::output;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::Cli;

/// Style of a heading.
pub(super) const HEADING: Style = Style::new().bold();
/// Style of a success.
pub(super) const GOOD: Style = AnsiColor::Green.on_default().bold();
/// Style of a partial success.
pub(super) const HALF: Style = AnsiColor::Yellow.on_default().bold();
/// Style of a failure.
pub(super) const BAD: Style = AnsiColor::Red.on_default().bold();

/// Time between two updates of a progress line.
const TICK: Duration = Duration::from_millis(120);

/// The first error of stdout.
static BROKEN: Mutex<Option<String>> = Mutex::new(None);

/// Remembers an error of stdout; a reader that has closed the pipe is not one.
fn notice(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != io::ErrorKind::BrokenPipe
    {
        BROKEN.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| output::reason(&error));
    }
}

/// The error of stdout at the end of the program, if any.
pub(super) fn unsaid() -> Option<InputError> {
    notice(io::stdout().lock().flush());
    let broken = BROKEN.lock().unwrap_or_else(PoisonError::into_inner).take();
    broken.map(|why| InputError::new(format!("standard output: {why}")))
}

/// Writes to stdout.
pub(super) fn say(text: &str) {
    notice(io::stdout().lock().write_all(text.as_bytes()));
}

/// Writes a text for people to stdout, with the first line of each part as a heading.
pub(super) fn show(text: &str) {
    show_as(HEADING, text);
}

/// The same, with another style for the very first line.
pub(super) fn show_as(first: Style, text: &str) {
    let mut styled = String::with_capacity(text.len() + 64);
    let mut style = Some(first);
    for line in text.split_inclusive('\n') {
        let words = line.trim_end_matches('\n');
        match style.filter(|_| !words.is_empty()) {
            Some(style) => styled.push_str(&format!("{style}{words}{style:#}{}", &line[words.len()..])),
            None => styled.push_str(line),
        }
        style = words.is_empty().then_some(HEADING);
    }
    notice(anstream::stdout().lock().write_all(styled.as_bytes()));
}

/// Writes a line to stderr even with `--quiet`: a warning, or half of an answer.
pub(super) fn warn(text: &str) {
    let (label, rest) = match text.split_once(": ") {
        Some(("warning", rest)) => (format!("{HALF}warning:{HALF:#} "), rest),
        Some(("error", rest)) => (format!("{BAD}error:{BAD:#} "), rest),
        _ => (String::new(), text),
    };
    let _ = writeln!(anstream::stderr(), "{label}{rest}");
}

/// The signals that end a program. Windows has no other.
const SIGNALS: &[i32] = &[
    signal_hook::consts::SIGINT,
    signal_hook::consts::SIGTERM,
    #[cfg(unix)]
    signal_hook::consts::SIGHUP,
];

/// The received signal, or 0.
static CAME: OnceLock<Arc<AtomicUsize>> = OnceLock::new();

/// Makes a file that exceeds the size limit a write error, like a full disk, instead of the end of the program.
pub(super) fn survive_limits() -> io::Result<()> {
    #[cfg(unix)]
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    Ok(())
}

/// A flag that is set by Ctrl-C or by a signal to end.
pub(super) fn stop_flag() -> Result<Arc<AtomicBool>, InputError> {
    use signal_hook::flag::{register, register_conditional_shutdown, register_usize};
    let flag = Arc::new(AtomicBool::new(false));
    let came = CAME.get_or_init(Arc::default);
    for &signal in SIGNALS {
        // In this order, so that a second signal ends the program at once.
        register_conditional_shutdown(signal, 128 + signal, Arc::clone(&flag))
            .and_then(|_| register_usize(signal, Arc::clone(came), signal.unsigned_abs() as usize))
            .and_then(|_| register(signal, Arc::clone(&flag)))
            .map_err(|error| InputError::new(error.to_string()))?;
    }
    Ok(flag)
}

/// The exit status of an interrupted program: 130 after Ctrl-C, 143 after SIGTERM.
pub(super) fn interrupted() -> ExitCode {
    let signal = CAME.get().map_or(0, |came| came.load(Ordering::Relaxed));
    ExitCode::from(u8::try_from(128 + signal).unwrap_or(1))
}

impl Cli {
    /// Writes a note to stderr; `--quiet` suppresses it.
    pub(super) fn note(&self, text: &str) {
        if !self.quiet {
            warn(text);
        }
    }

    /// A progress bar for `length` of `unit`, with the remaining time.
    pub(super) fn bar(&self, doing: &str, length: u64, unit: &str) -> ProgressBar {
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        let template = format!("{doing} {{bar:40.green/dim}} {{pos}} of {{len}}{unit}, {{eta}} left{{msg}}");
        styled(ProgressBar::with_draw_target(Some(length), self.target()), &template)
    }

    /// A sign of progress for an unknown time.
    pub(super) fn spinner(&self, doing: &str) -> ProgressBar {
        let template = format!("{{spinner:.green}} {doing}, {{elapsed}} so far");
        let spinner = styled(ProgressBar::with_draw_target(None, self.target()), &template);
        if !spinner.is_hidden() {
            spinner.enable_steady_tick(TICK);
        }
        spinner
    }

    /// Hidden where stderr is not a terminal.
    fn target(&self) -> ProgressDrawTarget {
        if self.json || self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() }
    }
}

pub(super) fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
