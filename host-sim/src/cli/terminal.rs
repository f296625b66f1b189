//! Output to the terminal: results to stdout; notes, progress and errors to stderr. Input from it: Ctrl-C.
//!
//! Colours and bars are for terminals: text that goes into a pipe or a file is plain, and so is all text if
//! `NO_COLOR` is set. No information is in a colour alone.

use std::io::{self, Write as _};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use anstyle::{AnsiColor, Style};
use foxhound_sim::scenario::input::InputError;
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

/// Writes to stdout; a reader that has closed the pipe is not our error.
pub(super) fn say(text: &str) {
    let _ = io::stdout().lock().write_all(text.as_bytes());
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
    let _ = anstream::stdout().lock().write_all(styled.as_bytes());
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

/// A flag that is set by Ctrl-C or by a signal to end.
pub(super) fn stop_flag() -> Result<Arc<AtomicBool>, InputError> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&flag)).map_err(|error| InputError::new(error.to_string()))?;
    }
    Ok(flag)
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

fn styled(bar: ProgressBar, template: &str) -> ProgressBar {
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
