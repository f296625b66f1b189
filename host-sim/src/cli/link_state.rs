//! `foxhound link-state`: trains and tests the classifier of direct and reflected waves.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use foxhound_core::localize::link_state::Classifier;
use foxhound_sim::scenario::input::InputError;
use foxhound_sim::study::link_state::{self, DOCUMENT_FILE, EXAMINATION_SCENES, SEED, WEIGHTS_FILE};

use super::terminal::{say, show, warn};
use super::value::whole;
use super::{Cli, json_line, write_text};

const LINK_STATE_HELP: &str = "Examples:
  foxhound link-state --seed 7    how often it is right in fresh scenes
  foxhound link-state --train     makes its weights and their page; minutes
  foxhound link-state --check     the same, but compares";

#[derive(Args, Debug)]
#[command(after_help = LINK_STATE_HELP)]
pub(super) struct LinkState {
    /// Number of scenes to test it with [default: 500].
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=100_000), conflicts_with_all = ["train", "check"])]
    scenes: Option<u32>,
    /// Trains it, and writes its weights and their accuracy.
    #[arg(long, conflicts_with = "check")]
    train: bool,
    /// Trains it, and compares the weights with those in the repository.
    #[arg(long)]
    check: bool,
    /// Folder of the repository.
    #[arg(long, value_name = "DIR", default_value = ".")]
    repository: PathBuf,
}

pub(super) fn link_state(cli: &Cli, args: &LinkState) -> Result<ExitCode, InputError> {
    if args.train || args.check {
        return train(cli, args);
    }
    let scenes = args.scenes.unwrap_or(EXAMINATION_SCENES);
    let progress = cli.spinner("examining");
    let report = link_state::examine(&Classifier::TRAINED, cli.seed, scenes);
    progress.finish_and_clear();
    let report = report?;
    if cli.json {
        say(&json_line(&report)?);
    } else {
        show(&report.table());
    }
    Ok(ExitCode::SUCCESS)
}

fn train(cli: &Cli, args: &LinkState) -> Result<ExitCode, InputError> {
    let [weights, document] = [WEIGHTS_FILE, DOCUMENT_FILE].map(|file| args.repository.join(file));
    let read = |path: &PathBuf| {
        std::fs::read_to_string(path).map_err(|error| InputError::new(error.to_string()).in_file(path))
    };
    let there = read(&weights)?;
    if cli.seed != SEED {
        cli.note(&format!("note: the weights of the repository are those of seed {SEED}"));
    }
    let progress = cli.spinner("training");
    let trained = link_state::train(cli.seed);
    progress.finish_and_clear();
    let trained = trained?;
    let source = link_state::source(&trained.weights, cli.seed);
    let is_same = source == there;
    if cli.json {
        say(&json_line(&trained.report)?);
    } else {
        show(&trained.report.table());
    }
    if args.check {
        let is_described = read(&document)?.contains(&link_state::measured(&trained.report));
        for (path, is_right) in [(&weights, is_same), (&document, is_described)] {
            warn(&format!("{}: {}", path.display(), if is_right { "as trained" } else { "differs" }));
        }
        return Ok(ExitCode::from(u8::from(!(is_same && is_described))));
    }
    write_text(&weights, &source)?;
    write_text(&document, &link_state::document(&trained.report))?;
    cli.note(&format!("written: {}, {}", weights.display(), document.display()));
    Ok(ExitCode::SUCCESS)
}
