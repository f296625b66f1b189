//! `foxhound reproduce`: the experiments of the papers.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use foxhound_sim::input::InputError;
use foxhound_sim::reproduce::{circle, crb, density, localize, mmwave, multipath, stretch, variants};

use super::terminal::{say, show};
use super::value::whole;
use super::{Cli, json_line};

const REPRODUCE_HELP: &str = "Examples:
  foxhound reproduce aoa-circle              table on stdout, picture in out/aoa-circle.svg
  foxhound reproduce aoa-crb --json --seed 2
  foxhound reproduce apf-density             the main paper's planners and ours on its maps; minutes
  foxhound reproduce apf-density --pairs 10 --json --out density
  foxhound reproduce apf-variants            potential fields of the variants paper
  foxhound reproduce multipath               the closed loop among walls
  foxhound reproduce localize                filters in sight and behind walls, and paths on which bearings tell more
  foxhound reproduce stretch                 seeking with a turning antenna, greedy and filtered; a minute";

#[derive(Args, Debug)]
#[command(after_help = REPRODUCE_HELP)]
pub(super) struct Reproduce {
    /// Which one.
    #[arg(value_enum)]
    experiment: Experiment,
    /// apf-density: start/goal pairs of each row of Table I [default: 100].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=10_000), allow_negative_numbers = true)]
    pairs: Option<u32>,
    /// multipath: scenes of each kind [default: 50].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=10_000), allow_negative_numbers = true)]
    scenes: Option<u32>,
    /// stretch: trials of each condition [default: 1200].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(2..=100_000), allow_negative_numbers = true)]
    trials: Option<u32>,
    /// mmwave: scenarios [default: 200].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=10_000), allow_negative_numbers = true)]
    scenarios: Option<u32>,
}

/// Start/goal pairs of each row of Table I.
const DENSITY_PAIRS: u32 = 100;
/// Scenes of each kind among walls.
const MULTIPATH_SCENES: u32 = 50;
/// Scenarios indoors, as many as the belief-space paper has.
const MMWAVE_SCENARIOS: u32 = 200;

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Experiment {
    /// Bearings around a circle of 5 m without noise (main paper, fig. 8).
    AoaCircle,
    /// Rms error over the Cramer-Rao bound, over signal-to-noise ratio, frame length and azimuth.
    AoaCrb,
    /// Planners on maps of growing obstacle density (main paper, Table I, fig. 9 and 10).
    ApfDensity,
    /// The closed loop among walls that reflect, with and without the filters behind the bearing.
    Multipath,
    /// Filters in sight and behind walls, paths on which bearings tell more (mmWave paper, fig. 2 to 4 and Table 2).
    Localize,
    /// Agents that look for a transmitter indoors by its angle of arrival (belief-space paper, Table 3, fig. 5 and 6).
    Mmwave,
    /// Four potential fields in four scenes with local minima (variants paper, Table I).
    ApfVariants,
    /// Excess travel behind a turning antenna over outliers and noise (rotating vehicle's paper, fig. 3 and 4).
    Stretch,
}

pub(super) fn reproduce(cli: &Cli, args: &Reproduce) -> Result<ExitCode, InputError> {
    if args.pairs.is_some() && !matches!(args.experiment, Experiment::ApfDensity) {
        return Err(InputError::new("--pairs: only apf-density flies pairs"));
    }
    if args.scenes.is_some() && !matches!(args.experiment, Experiment::Multipath) {
        return Err(InputError::new("--scenes: only multipath has scenes"));
    }
    if args.trials.is_some() && !matches!(args.experiment, Experiment::Stretch) {
        return Err(InputError::new("--trials: only stretch has trials"));
    }
    if args.scenarios.is_some() && !matches!(args.experiment, Experiment::Mmwave) {
        return Err(InputError::new("--scenarios: only mmwave has scenarios"));
    }
    let folder = cli.out.clone().or_else(|| (!cli.json).then(|| PathBuf::from("out")));
    let picture = |name: &str, draw: &dyn Fn(&Path) -> Result<(), InputError>| {
        let Some(folder) = &folder else { return Ok(Vec::new()) };
        let path = folder.join(name);
        draw(&path)?;
        Ok::<Vec<PathBuf>, InputError>(vec![path])
    };
    let (line, table, pictures) = match args.experiment {
        Experiment::AoaCircle => {
            let report = circle::run(cli.seed)?;
            (json_line(&report)?, report.table(), picture("aoa-circle.svg", &|path| report.draw(path))?)
        }
        Experiment::AoaCrb => {
            let report = crb::run(cli.seed)?;
            (json_line(&report)?, report.table(), picture("aoa-crb.svg", &|path| report.draw(path))?)
        }
        Experiment::ApfDensity => {
            let options = density::Options { seed: cli.seed, pairs: args.pairs.unwrap_or(DENSITY_PAIRS) };
            let progress = cli.bar("flying", density::flights(options.pairs), "");
            let report = density::run(&options, |done| progress.set_position(done));
            progress.finish_and_clear();
            let report = report?;
            let pictures = folder.as_deref().map_or(Ok(Vec::new()), |folder| report.draw(folder))?;
            (json_line(&report)?, report.table(), pictures)
        }
        Experiment::Localize => {
            let report = localize::run(cli.seed)?;
            let pictures = folder.as_deref().map_or(Ok(Vec::new()), |folder| report.draw(folder))?;
            (json_line(&report)?, report.table(), pictures)
        }
        Experiment::Multipath => {
            let options = multipath::Options { seed: cli.seed, scenes: args.scenes.unwrap_or(MULTIPATH_SCENES) };
            let progress = cli.bar("flying", multipath::flights(options.scenes), "");
            let report = multipath::run(&options, || progress.inc(1));
            progress.finish_and_clear();
            let report = report?;
            (json_line(&report)?, report.table(), picture("multipath.svg", &|path| report.draw(path))?)
        }
        Experiment::Mmwave => {
            let options = mmwave::Options { seed: cli.seed, scenarios: args.scenarios.unwrap_or(MMWAVE_SCENARIOS) };
            let progress = cli.bar("searching", mmwave::searches(options.scenarios), "");
            let report = mmwave::run(&options, |done| progress.set_position(done));
            progress.finish_and_clear();
            let report = report?;
            let pictures = folder.as_deref().map_or(Ok(Vec::new()), |folder| report.draw(folder))?;
            (json_line(&report)?, report.table(), pictures)
        }
        Experiment::ApfVariants => {
            let report = variants::run();
            let pictures = folder.as_deref().map_or(Ok(Vec::new()), |folder| report.draw(folder))?;
            (json_line(&report)?, report.table(), pictures)
        }
        Experiment::Stretch => {
            let options = stretch::Options { seed: cli.seed, trials: args.trials.unwrap_or(stretch::TRIALS) };
            let progress = cli.bar("seeking", stretch::trials(options.trials), "");
            let report = stretch::run(&options, |done| progress.set_position(done));
            progress.finish_and_clear();
            let report = report?;
            let pictures = folder.as_deref().map_or(Ok(Vec::new()), |folder| report.draw(folder))?;
            (json_line(&report)?, report.table(), pictures)
        }
    };
    if cli.json {
        say(&line);
    } else {
        show(&table);
    }
    for path in pictures {
        cli.note(&format!("picture: {}", path.display()));
    }
    Ok(ExitCode::SUCCESS)
}
