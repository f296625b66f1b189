//! `foxhound reproduce`: the experiments of the papers.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use foxhound_sim::scenario::input::InputError;
use foxhound_sim::study::reproduce::gallery::{Gallery, Summary};
use foxhound_sim::study::reproduce::{Experiment, Settings};
use indicatif::ProgressBar;

use super::terminal::{say, show};
use super::value::whole;
use super::{Cli, command_line, json_line};

const REPRODUCE_HELP: &str = "Examples:
  foxhound reproduce all --out papers    all of them; papers/index.html; minutes
  foxhound reproduce aoa-circle          a table, and out/aoa-circle.svg
  foxhound reproduce aoa-crb --json --seed 2
  foxhound reproduce apf-density --pairs 10 --json --out density
  foxhound reproduce stretch             the largest: a minute or two

`all` continues a run that was interrupted: it keeps finished experiments that this program made with these options.";

#[derive(Args, Debug)]
#[command(after_help = REPRODUCE_HELP)]
pub(super) struct Reproduce {
    /// Name of the experiment.
    #[arg(value_enum)]
    experiment: Name,
    /// apf-density: start/goal pairs of each row of Table I [default: 100].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=10_000))]
    pairs: Option<u32>,
    /// multipath: scenes of each kind [default: 50].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=10_000))]
    scenes: Option<u32>,
    /// stretch: trials of each condition [default: 1200].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(2..=100_000))]
    trials: Option<u32>,
    /// mmwave: scenarios [default: 200].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=10_000))]
    scenarios: Option<u32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Name {
    /// All of them, into a folder with a page that shows the published results beside ours.
    All,
    /// Bearings around a circle of 5 m without noise (main paper, fig. 8).
    AoaCircle,
    /// Rms error over the Cramer-Rao bound, over signal-to-noise ratio, frame length and azimuth.
    AoaCrb,
    /// Planners on maps of growing obstacle density (main paper, Table I, fig. 9 and 10).
    ApfDensity,
    /// The closed loop among reflecting walls, with and without the filters that follow the bearing.
    Multipath,
    /// EKF and other filters in line of sight and behind walls; paths planned in belief space, on which bearings give
    /// more information (mmWave paper, fig. 2 to 4 and Table 2).
    Localize,
    /// Agents that search for a transmitter indoors by its angle of arrival (mmWave paper, Table 3, fig. 5
    /// and 6).
    Mmwave,
    /// Four potential fields in four scenes with local minima (variants paper, Table I).
    ApfVariants,
    /// Excess travel with a turning antenna over outliers and noise (rotating vehicle's paper, fig. 3 and 4).
    Stretch,
}

impl Reproduce {
    fn settings(&self, seed: u64) -> Result<Settings, InputError> {
        for (option, value, owner, what) in [
            ("--pairs", self.pairs, Name::ApfDensity, "only apf-density flies pairs"),
            ("--scenes", self.scenes, Name::Multipath, "only multipath has scenes"),
            ("--trials", self.trials, Name::Stretch, "only stretch has trials"),
            ("--scenarios", self.scenarios, Name::Mmwave, "only mmwave has scenarios"),
        ] {
            if value.is_some() && self.experiment != owner && self.experiment != Name::All {
                return Err(InputError::new(format!("{option}: {what}")));
            }
        }
        let usual = Settings::default();
        Ok(Settings {
            seed,
            pairs: self.pairs.unwrap_or(usual.pairs),
            scenes: self.scenes.unwrap_or(usual.scenes),
            trials: self.trials.unwrap_or(usual.trials),
            scenarios: self.scenarios.unwrap_or(usual.scenarios),
        })
    }
}

fn progress(cli: &Cli, experiment: Experiment, settings: &Settings) -> ProgressBar {
    match (experiment.length)(settings) {
        Some(length) => cli.bar(experiment.name, length, ""),
        None => cli.spinner(experiment.name),
    }
}

pub(super) fn reproduce(cli: &Cli, args: &Reproduce) -> Result<ExitCode, InputError> {
    let settings = args.settings(cli.seed)?;
    let name = args.experiment.to_possible_value();
    // `all` is not the name of an experiment.
    let Some(experiment) = name.and_then(|name| Experiment::named(name.get_name())) else { return all(cli, settings) };
    let folder = cli.out.clone().or_else(|| (!cli.json).then(|| PathBuf::from("out")));
    let progress = progress(cli, experiment, &settings);
    let outcome = experiment.run(&settings, folder.as_deref(), |done| progress.set_position(done));
    progress.finish_and_clear();
    let outcome = outcome?;
    if cli.json {
        say(&outcome.json);
    } else {
        show(&outcome.table);
    }
    for path in outcome.pictures {
        cli.note(&format!("picture: {}", path.display()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Every experiment, into one folder.
fn all(cli: &Cli, settings: Settings) -> Result<ExitCode, InputError> {
    let folder = match &cli.out {
        Some(folder) => folder.clone(),
        None if cli.json => return Err(InputError::new("--out: all experiments are written to a folder; name one")),
        None => PathBuf::from("out/papers"),
    };
    let mut gallery = Gallery::open(&folder, settings)?;
    for (index, experiment) in Experiment::ALL.into_iter().enumerate() {
        if !gallery.keep(experiment) {
            let progress = progress(cli, experiment, &settings);
            let made = gallery.make(experiment, |done| progress.set_position(done));
            progress.finish_and_clear();
            made?;
        }
        // So that there is a page before the last experiment is done.
        gallery.write_page(&command_line())?;
        if let Some(shown) = gallery.shown().last() {
            let how = if shown.kept { "there already".to_owned() } else { format!("{:.1} s", shown.seconds) };
            cli.note(&format!("{} of {}: {}, {how}", index + 1, Experiment::ALL.len(), shown.experiment));
        }
    }
    let summary = gallery.summary();
    if cli.json {
        say(&json_line(&summary)?);
    } else {
        show(&words(&summary));
    }
    Ok(ExitCode::SUCCESS)
}

/// A summary for people.
fn words(summary: &Summary) -> String {
    let mut text = format!("{:<14} {:>8}  files\n", "experiment", "time");
    for shown in &summary.experiments {
        let kept = if shown.kept { ", there already" } else { "" };
        let _ = writeln!(text, "{:<14} {:>6.1} s  {}{kept}", shown.experiment, shown.seconds, shown.files.len());
    }
    let _ = writeln!(text, "{:<14} {:>6.1} s", "all", summary.seconds);
    let _ = writeln!(text, "\npage: {}", summary.index.display());
    text
}
