//! `foxhound completions` and `foxhound man`: shell completions and manual pages, made from the definition of the
//! command line.

use std::io;
use std::path::Path;
use std::process::ExitCode;

use clap::{Args, Command, CommandFactory as _};
use clap_complete::Shell;
use clap_mangen::Man;
use foxhound_sim::scenario::input::InputError;

use super::terminal::say;
use super::{Cli, write_text};

const COMPLETIONS_HELP: &str = "Examples:
  foxhound completions bash > ~/.local/share/bash-completion/completions/foxhound
  foxhound completions zsh > ~/.zfunc/_foxhound      with ~/.zfunc in fpath
  foxhound completions fish > ~/.config/fish/completions/foxhound.fish";

const MAN_HELP: &str = "Examples:
  foxhound man | man -l -
  foxhound man fly | man -l -
  foxhound man --out ~/.local/share/man/man1    every page";

#[derive(Args, Debug)]
#[command(after_help = COMPLETIONS_HELP)]
pub(super) struct CompletionsCommand {
    /// Name of the shell.
    #[arg(value_enum)]
    shell: Shell,
}

#[derive(Args, Debug)]
#[command(after_help = MAN_HELP)]
pub(super) struct ManCommand {
    /// Name of the command [default: foxhound itself].
    #[arg(value_name = "COMMAND")]
    of: Option<String>,
}

pub(super) fn completions(cli: &Cli, args: &CompletionsCommand) -> Result<ExitCode, InputError> {
    refuse_json(cli, "a completion script")?;
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "foxhound", &mut script);
    say(&String::from_utf8_lossy(&script));
    Ok(ExitCode::SUCCESS)
}

pub(super) fn manual(cli: &Cli, args: &ManCommand) -> Result<ExitCode, InputError> {
    refuse_json(cli, "a page of the manual")?;
    let mut all = Cli::command();
    // Adds the global options and the full name to every command.
    all.build();
    if let Some(folder) = &cli.out {
        if args.of.is_some() {
            return Err(InputError::new("--out: writes the pages of all commands, not of one"));
        }
        write_page(cli, folder, &all)?;
        return all
            .get_subcommands()
            .filter(|command| command.get_name() != "help")
            .try_for_each(|command| write_page(cli, folder, command))
            .map(|()| ExitCode::SUCCESS);
    }
    let of = match &args.of {
        None => &all,
        Some(name) => all.find_subcommand(name).ok_or_else(|| {
            let names: Vec<&str> = all.get_subcommands().map(Command::get_name).collect();
            InputError::new(format!("COMMAND `{name}`: unknown; valid: {}", names.join(", ")))
        })?,
    };
    say(&page(of)?);
    Ok(ExitCode::SUCCESS)
}

fn refuse_json(cli: &Cli, what: &str) -> Result<(), InputError> {
    if cli.json { Err(InputError::new(format!("--json: {what} is not JSON"))) } else { Ok(()) }
}

fn write_page(cli: &Cli, folder: &Path, command: &Command) -> Result<(), InputError> {
    let path = folder.join(format!("{}.1", whole_name(command)));
    write_text(&path, &page(command)?)?;
    cli.note(&format!("page: {}", path.display()));
    Ok(())
}

fn whole_name(command: &Command) -> &str {
    command.get_display_name().unwrap_or_else(|| command.get_name())
}

/// A page in roff. The text after the options in `--help` keeps its lines, since examples must not be reflowed.
fn page(command: &Command) -> Result<String, InputError> {
    let man = Man::new(command.clone());
    let mut page = Vec::new();
    let written: io::Result<()> = (|| {
        man.render_title(&mut page)?;
        man.render_name_section(&mut page)?;
        man.render_synopsis_section(&mut page)?;
        man.render_description_section(&mut page)?;
        man.render_options_section(&mut page)?;
        if command.has_subcommands() {
            man.render_subcommands_section(&mut page)?;
        }
        Ok(())
    })();
    written.map_err(|error| InputError::new(error.to_string()))?;
    let mut page = String::from_utf8_lossy(&page).into_owned();
    if let Some(help) = command.get_after_help() {
        page.push_str(".SH NOTES\n");
        let mut is_set = true;
        for line in help.to_string().lines() {
            let sets = !line.starts_with(' ');
            if sets != is_set {
                page.push_str(if sets { ".fi\n" } else { ".nf\n" });
                is_set = sets;
            }
            match line {
                "" => page.push_str(".PP\n"),
                // A dot or an apostrophe at the beginning would be a request.
                _ => page.push_str(&format!("\\&{}\n", line.replace('\\', "\\e").replace('-', "\\-"))),
            }
        }
        if !is_set {
            page.push_str(".fi\n");
        }
    }
    Ok(page)
}
