//! The command line itself: help with examples, completions, manual pages, what is quiet and what is coloured.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::process::Command;

use foxhound_tests::{errors, foxhound, refused, run, run_json, text};

/// What a command prints on stdout, which it must end well for.
fn printed(arguments: &[&str]) -> String {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", errors(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// The commands, as the help lists them.
fn verbs() -> Vec<String> {
    let help = printed(&["--help"]);
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = lines
        .filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next().filter(|_| !line.starts_with("   ")));
    names.filter(|name| *name != "help").map(str::to_owned).collect()
}

/// Every command has a help text, and the program accepts each example in it.
#[test]
fn every_command_has_a_help_with_examples_that_it_understands() {
    let verbs = verbs();
    for verb in ["fly", "companion", "bearing", "calibrate", "suite", "reproduce", "replay", "params", "maps", "tlog"] {
        assert!(verbs.iter().any(|known| known == verb), "{verb} in {verbs:?}");
    }
    for verb in &verbs {
        let help = printed(&[verb, "--help"]);
        let examples: Vec<&str> = help.lines().skip_while(|line| *line != "Examples:").skip(1).collect();
        let own = examples.iter().filter(|line| line.contains(&format!("foxhound {verb}"))).count();
        assert!(own > 0, "{verb}: {help}");
        let wide = examples.iter().find(|line| line.starts_with("  ") && line.chars().count() > 88);
        assert_eq!(wide, None, "{verb}: an example stands in one line of a narrow terminal");
        assert!(help.contains("--json") && help.contains("--quiet") && help.contains("--seed"), "{verb}");
        // The options of the examples are among those of the help.
        let options = examples.iter().filter(|line| line.contains(&format!("foxhound {verb} "))).flat_map(|line| {
            let call = line.split(&format!("foxhound {verb} ")).nth(1).unwrap_or("");
            let call = call.split(['|', '>', '&', ';', '(']).next().unwrap_or("");
            call.split_whitespace().filter(|word| word.starts_with("--")).map(|word| word.split('=').next().unwrap())
        });
        for option in options {
            assert!(help.contains(&format!("{option} ")) || help.contains(&format!("{option}\n")), "{verb}: {option}");
        }
        assert_eq!(printed(&["help", verb]), help);
    }
}

/// The script for bash completes commands, options and values.
#[test]
fn bash_completes_commands_options_and_values() {
    let script = printed(&["completions", "bash"]);
    let complete = |words: &[&str]| -> Vec<String> {
        let line = words.iter().map(|word| format!("'{word}'")).collect::<Vec<_>>().join(" ");
        let ask = format!(
            "{script}\nCOMP_WORDS=({line}); COMP_CWORD={}; COMP_TYPE=9\n_foxhound foxhound '{}' '{}'\nprintf '%s\\n' \"${{COMPREPLY[@]}}\"",
            words.len() - 1,
            words[words.len() - 1],
            words[words.len() - 2]
        );
        let output = Command::new("bash").args(["--norc", "-c", &ask]).output().unwrap();
        assert!(output.status.success(), "{}", errors(&output));
        String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
    };
    assert_eq!(complete(&["foxhound", "cal"]), ["calibrate"]);
    assert_eq!(complete(&["foxhound", "fly", "--sc"]), ["--scenario"]);
    assert_eq!(complete(&["foxhound", "fly", "--planner", "virt"]), ["virtual_force"]);
    assert!(complete(&["foxhound", "reproduce", ""]).iter().any(|name| name == "aoa-circle"));
    let verbs = verbs();
    let offered = complete(&["foxhound", ""]);
    assert!(verbs.iter().all(|verb| offered.contains(verb)), "{verbs:?} in {offered:?}");
}

/// The scripts for the other shells contain every command.
#[test]
fn the_scripts_of_the_other_shells_know_every_command() {
    for (shell, begin) in
        [("zsh", "#compdef foxhound"), ("fish", "# Print an optspec"), ("elvish", ""), ("powershell", "")]
    {
        let script = printed(&["completions", shell]);
        assert!(script.trim_start().starts_with(begin), "{shell}: {}", &script[..80]);
        for verb in verbs() {
            assert!(script.contains(&verb), "{shell}: {verb}");
        }
    }
}

/// Every command has a manual page with its options and examples.
#[test]
fn there_is_a_manual_page_for_every_command_with_its_options_and_examples() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("man1");
    printed(&["man", "--out", &text(&out)]);
    let page = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
    assert_eq!(printed(&["man"]), page("foxhound.1"));
    for verb in verbs() {
        let page = page(&format!("foxhound-{verb}.1"));
        assert_eq!(printed(&["man", &verb]), page);
        // What a macro begins with is a macro that there is; the text of examples is set as it stands.
        let macros =
            page.lines().filter(|line| line.starts_with(['.', '\''])).map(|line| line.split(' ').next().unwrap());
        for name in macros {
            let known =
                [".TH", ".SH", ".SS", ".TP", ".PP", ".RS", ".RE", ".br", ".nf", ".fi", ".ie", ".el", ".IP", ".B", ".I"];
            assert!(known.contains(&name), "{verb}: {name}");
        }
        for word in [
            format!("foxhound\\-{}", verb.replace('-', "\\-")),
            "NAME".into(),
            "SYNOPSIS".into(),
            "\\-\\-json".into(),
            "Examples:".into(),
        ] {
            assert!(page.contains(&word), "{verb}: {word} in {page}");
        }
        let (asked, set) = (page.matches("\n.nf\n").count(), page.matches("\n.fi\n").count());
        assert!(asked > 0 && asked == set, "{verb}: {asked} {set}");
    }
}

/// `--quiet` leaves only results and errors, and `--json` prints nothing but JSON.
#[test]
fn quiet_leaves_results_and_errors_and_json_leaves_nothing_but_json() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path());
    let maps = ["maps", "--row", "1", "--count", "1", "--pairs", "2", "--out", &out];
    let loud = run(&maps);
    assert!(errors(&loud).contains("suite.json"));
    for quiet in ["--quiet", "-q"] {
        let output = run(&[&maps[..], &[quiet, "--force"]].concat());
        assert!(output.status.success() && output.stderr.is_empty() && output.stdout == loud.stdout);
    }
    let suite = text(&folder.path().join("suite.json"));
    for verb in [
        &["suite", &suite][..],
        &["params"],
        &["schema"],
        &["maps", "--describe", &suite],
        &["reproduce", "aoa-circle"],
    ] {
        let output = run(&[verb, &["--quiet", "--json"]].concat());
        assert_eq!((output.status.code(), output.stderr.len()), (Some(0), 0), "{verb:?}");
        let _: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    }
    assert!(!refused(&["params", "--set", "FH_SPD_MAX=-1", "--quiet"]).is_empty(), "an error is no note");
    assert_eq!(run_json(&["params", "--json"]).0, 0);
}

/// Output is coloured on a terminal or when colour is asked for, and nowhere else.
#[test]
fn colours_are_for_terminals_and_for_who_asks_for_them() {
    let coloured = |variables: &[(&str, &str)], arguments: &[&str]| {
        let mut command = foxhound();
        for name in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "TERM"] {
            command.env_remove(name);
        }
        let output = command.envs(variables.iter().copied()).args(arguments).output().unwrap();
        [output.stdout, output.stderr].map(|bytes| bytes.contains(&0x1b))
    };
    let forced = ("CLICOLOR_FORCE", "1");
    assert_eq!(coloured(&[("TERM", "xterm")], &["params"]), [false, false], "a pipe is no terminal");
    assert_eq!(coloured(&[forced], &["params"]), [true, false]);
    assert_eq!(coloured(&[forced], &["params", "--set", "x=1"]), [false, true]);
    assert_eq!(coloured(&[forced], &["params", "--json"]), [false, false], "JSON is never coloured");
    assert_eq!(coloured(&[forced, ("NO_COLOR", "1")], &["params", "--set", "x=1"]), [false, false]);
    // Without its colours it is the same text.
    let plain = printed(&["params"]);
    let output = foxhound().env("CLICOLOR_FORCE", "1").arg("params").output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(text.replace("\u{1b}[1m", "").replace("\u{1b}[0m", ""), plain);
}
