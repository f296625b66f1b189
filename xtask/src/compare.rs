//! Flies the same held-out flights with two builds of `foxhound`, setting by setting, and says where the new one is worse: the
//! page `docs/results/compare.md`.
//!
//! The worlds are those of `cargo xtask campaign` and `landings`. Each flight is a run of `foxhound fly` with the same scenario and the
//! same seed by both programs, so that their results are compared in pairs.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use serde_json::{Value, json};

use crate::build::{answer, built, cargo, simulator, workspace};
use crate::{Failure, study};

const DRAWN: &str = r#"{"vehicle":{"model":"arducopter"}}"#;
const POINT: &str = r#"{"sensor":{"model":"scan"},"bearing":{"snr_db":20}}"#;
const ARDUCOPTER: &str = r#"{"sensor":{"model":"scan"},"bearing":{"snr_db":20},"vehicle":{"model":"arducopter"}}"#;
const PX4: &str =
    r#"{"sensor":{"model":"scan"},"bearing":{"snr_db":20},"vehicle":{"model":"arducopter","autopilot":"px4"}}"#;
const ALL_ROUND: &str = r#"{"sensor":{"model":"scan","fov_deg":360,"range_m":4},"bearing":{"snr_db":20},
    "vehicle":{"model":"arducopter"}}"#;
const OUTLIERS: &str = r#"{"sensor":{"model":"scan"},"vehicle":{"model":"arducopter"},
    "bearing":{"sigma_deg":5,"outlier":{"rate":0.4,"anywhere":true}}}"#;
const SIGMA_10: &str = r#"{"sensor":{"model":"scan"},"vehicle":{"model":"arducopter"},"bearing":{"sigma_deg":10}}"#;
const SIGMA_20: &str = r#"{"sensor":{"model":"scan"},"vehicle":{"model":"arducopter"},"bearing":{"sigma_deg":20}}"#;

/// Name of a setting, its worlds, and what is put over their scenarios.
const SETTINGS: [(&str, &str, &str); 25] = [
    ("forests, point mass", "forest", POINT),
    ("forests, ArduCopter", "forest", ARDUCOPTER),
    ("forests, PX4", "forest", PX4),
    ("forests, ArduCopter, scan all round, 4 m", "forest", ALL_ROUND),
    ("forests, ArduCopter, drawn", "forest", DRAWN),
    ("random pillars, ArduCopter", "pillars", ARDUCOPTER),
    ("random pillars, ArduCopter, drawn", "pillars", DRAWN),
    ("dense corridors, ArduCopter", "corridor", ARDUCOPTER),
    ("dense corridors, ArduCopter, drawn", "corridor", DRAWN),
    ("traps, ArduCopter", "trap", ARDUCOPTER),
    ("traps, ArduCopter, drawn", "trap", DRAWN),
    ("BARN, ArduCopter", "barn", ARDUCOPTER),
    ("BARN, ArduCopter, drawn", "barn", DRAWN),
    ("gusts of 2.5 m/s, ArduCopter", "gusts", ARDUCOPTER),
    ("gusts of 2.5 m/s, PX4", "gusts", PX4),
    ("gusts of 2.5 m/s, ArduCopter, drawn", "gusts", r#"{"sensor":{"model":"circles"},"bearing":{"snr_db":null}}"#),
    ("forests, ArduCopter, scan, 40 % of the bearings from anywhere", "forest", OUTLIERS),
    ("forests, ArduCopter, scan, bearings with sigma 10 deg", "forest", SIGMA_10),
    ("forests, ArduCopter, scan, bearings with sigma 20 deg", "forest", SIGMA_20),
    ("turning antenna, point mass", "turning_antenna", "{}"),
    ("turning antenna, ArduCopter", "turning_antenna", ARDUCOPTER),
    ("two channels die, ArduCopter", "two_channels_die", ARDUCOPTER),
    ("landings: camera, calm", "camera, calm", "{}"),
    ("landings: camera, gusts of 3 m/s", "camera, gusts of 3 m/s", "{}"),
    ("landings: no camera, gusts of 3 m/s", "no camera, gusts of 3 m/s", "{}"),
];

/// Experiments of `foxhound reproduce`: the names and numbers that are shown, and a part that every shown line has.
const EXPERIMENTS: [(&str, &[&str], &str); 3] = [
    ("localize", &["median_m", "p90_m", "range_rmse_m", "extra_length"], ""),
    ("multipath", &["reached", "collisions", "mean_length_m", "mean_time_s"], "with,"),
    ("mmwave", &["success_rate", "mean_length_m"], "belief,"),
];
const NAMES: [&str; 7] = ["way", "name", "kind", "chain", "agent", "sigma_rad", "link_error_rate"];

/// What is compared, and on which side of zero the difference is worse.
const NUMBERS: [(&str, f64); 4] = [("reached", -1.0), ("collisions", 1.0), ("length", 1.0), ("time", 1.0)];
/// A flight's [`NUMBERS`]: 1 or 0, 1 or 0, ratio, seconds.
type Flight = [f64; 4];

/// Flies everything with both, and writes the page; without `new`, that of this tree. `commit` is what the page calls the old one.
pub(crate) fn run(old: &Path, new: Option<&Path>, commit: &str, flights: u32) -> Result<(), Failure> {
    let new = match new {
        Some(program) => program.to_owned(),
        None => built(cargo().args(["build", "--release", "-p", "foxhound-sim", "--bin", "foxhound"]), "foxhound")?,
    };
    let programs = [old, &new];
    let worlds = worlds(flights)?;
    let mut text = format!(
        "# Two builds beside each other\n\n\
         `cargo xtask compare OLD` writes this page: the same flights, on held-out seeds, with two builds of `foxhound`. Old is\n\
         {commit}, new is {}.\n\n\
         A scan covers 90 degrees and 3 m, and waveforms have 20 dB, unless the setting says otherwise; \"drawn\" is without both: the\n\
         true circles of the pillars, and bearings with noise. Shares are in percent, with their 95 % interval by Wilson. Length\n\
         is the path, with what was left to the beacon, over the shortest path where it is known, otherwise over the straight line; length\n\
         and time are means over the flights that reached the beacon with both, each with its 95 % interval. The last column\n\
         names what is worse: the 95 % interval of the mean difference, flight by flight, lies wholly on the worse side.\n\
         By chance alone that is so for one number in 40. Some of the traps have no way to the beacon.\n\
         Each build flies in its own simulator, so a change of a model shows as well.\n\n\
         | setting | flights | reached, old | new | collisions, old | new | length, old | new | new - old | time, s, old | new | |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n",
        answer(Command::new("git").current_dir(workspace()).args(["rev-parse", "--short", "HEAD"]))?.trim(),
    );
    let (mut refused, mut all) = (String::new(), Vec::new());
    for (name, kind, with) in SETTINGS {
        let over: Value = serde_json::from_str(with).map_err(|error| Failure(format!("{name}: {error}")))?;
        let of_kind: Vec<&Value> = worlds.iter().filter(|world| world["kind"] == kind).collect();
        if of_kind.is_empty() {
            refused.push_str(&format!("- {name}: the worlds are not on this machine\n"));
            continue;
        }
        match pairs(programs, &of_kind, &over) {
            Ok(pairs) => {
                text.push_str(&row(name, &pairs));
                all.extend(pairs);
            }
            Err(Failure(why)) => refused.push_str(&format!("- {name}: {why}\n")),
        }
        eprintln!("compare: {name}: {}", text.lines().last().unwrap_or_default());
    }
    text.push_str(&row("all", &all));
    text.push_str("\n## The papers' experiments\n\nOne run each, without intervals.\n\n| experiment | number | old | new |\n|---|---|---|---|\n");
    for (experiment, keys, part) in EXPERIMENTS {
        eprintln!("compare: reproduce {experiment}");
        let [old, new] = [reproduce(old, experiment, keys, flights)?, reproduce(&new, experiment, keys, flights)?];
        for (name, value) in new.iter().filter(|(name, _)| name.contains(part)) {
            let before = old.iter().find(|(one, _)| one == name);
            let before = before.map_or("-".to_owned(), |(_, value)| format!("{value:.3}"));
            let _ = writeln!(text, "| `{experiment}` | {name} | {before} | {value:.3} |");
        }
    }
    if !refused.is_empty() {
        let _ = write!(text, "\n## Not flown by both\n\n{refused}");
    }
    let page = study::path("docs/results/compare.md");
    fs::write(&page, text).map_err(|error| Failure(format!("{page}: {error}")))
}

/// The worlds of all kinds: kind, seed, `shortest_m`, scenario.
fn worlds(flights: u32) -> Result<Vec<Value>, Failure> {
    let mut cargo = simulator();
    cargo.args(["--example", "study", "--", "worlds"]).arg(flights.to_string());
    cargo.args([study::path("tests/traps"), study::path(study::BARN)]);
    let refused = |error| Failure(format!("study worlds: {error}"));
    let lines = output(cargo.stderr(Stdio::inherit()))?;
    let mut worlds = lines.lines().map(serde_json::from_str).collect::<Result<Vec<Value>, _>>().map_err(refused)?;
    let seeds: Vec<Value> =
        worlds.iter().filter(|one| one["kind"] == "pillars").map(|one| one["seed"].clone()).collect();
    for kind in ["turning_antenna", "two_channels_die"] {
        let file = study::path(&format!("tests/scenarios/{kind}.json"));
        let text = fs::read_to_string(&file).map_err(|error| Failure(format!("{file}: {error}")))?;
        let scenario: Value = serde_json::from_str(&text).map_err(|error| Failure(format!("{file}: {error}")))?;
        worlds.extend(seeds.iter().map(|seed| json!({"kind": kind, "seed": seed, "scenario": scenario})));
    }
    Ok(worlds)
}

/// The flights through these worlds, by the old program and by the new one, on all processors.
fn pairs(programs: [&Path; 2], worlds: &[&Value], over: &Value) -> Result<Vec<[Flight; 2]>, Failure> {
    let next = AtomicUsize::new(0);
    let work = || {
        let mut flown = Vec::new();
        while let Some(world) = worlds.get(next.fetch_add(1, Ordering::Relaxed)) {
            flown.push(pair(programs, world, over)?);
        }
        Ok(flown)
    };
    let processors = thread::available_parallelism().map_or(1, usize::from);
    thread::scope(|scope| {
        let workers: Vec<_> = (0..processors).map(|_| scope.spawn(work)).collect();
        let mut flown = Vec::new();
        for worker in workers {
            flown.extend(worker.join().map_err(|_| Failure("a thread has ended early".to_owned()))??);
        }
        Ok(flown)
    })
}

fn pair(programs: [&Path; 2], world: &Value, over: &Value) -> Result<[Flight; 2], Failure> {
    let mut scenario = world["scenario"].clone();
    for (key, value) in over.as_object().into_iter().flatten() {
        for (inner, value) in value.as_object().into_iter().flatten() {
            scenario[key][inner] = value.clone();
        }
    }
    let folder = workspace().join("target/compare");
    let file = folder.join(format!("{:?}.json", thread::current().id()));
    let written = fs::create_dir_all(&folder).and_then(|()| fs::write(&file, scenario.to_string()));
    written.map_err(|error| Failure(format!("{}: {error}", file.display())))?;
    let [old, new] = [("old", programs[0]), ("new", programs[1])].map(|(which, program)| {
        let mut command = Command::new(program);
        command.args(["fly", "--json", "--quiet", "--seed", &world["seed"].to_string(), "--scenario"]).arg(&file);
        let report: Value = serde_json::from_str(&output(&mut command)?)
            .map_err(|error| Failure(format!("the {which} program: {error}")))?;
        let number = |name: &str| report[name].as_f64().unwrap_or(f64::NAN);
        let ended = |how: &str| f64::from(u8::from(report["result"] == how));
        let shortest_m = world["shortest_m"].as_f64().unwrap_or(number("straight_line_m"));
        let length_ratio = (number("path_length_m") + number("to_beacon_m")) / shortest_m;
        Ok([ended("reached"), ended("collision"), length_ratio, number("time_s")])
    });
    Ok([old?, new?])
}

/// What a program prints; on no output, its first line of errors.
fn output(command: &mut Command) -> Result<String, Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.output().map_err(|error| Failure(format!("{name} cannot be started: {error}")))?;
    if output.stdout.is_empty() {
        return Err(Failure(String::from_utf8_lossy(&output.stderr).lines().next().unwrap_or("no output").to_owned()));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The row of a setting.
fn row(name: &str, pairs: &[[Flight; 2]]) -> String {
    let has_both = |pair: &&[Flight; 2]| pair.iter().all(|flight| flight[0] > 0.0 && flight[2].is_finite());
    let both: Vec<[Flight; 2]> = pairs.iter().filter(has_both).copied().collect();
    let mut text = format!("| {name} | {} |", pairs.len());
    let mut worse = Vec::new();
    for (k, (what, sign)) in NUMBERS.into_iter().enumerate() {
        let of = if k < 2 { pairs } else { &both };
        for side in 0..2 {
            let values: Vec<f64> = of.iter().map(|pair| pair[side][k]).collect();
            let (mean, half) = mean(&values);
            let [low, high] = wilson(values.iter().sum(), values.len() as f64).map(|share| 100.0 * share);
            text += &match k {
                0 | 1 => format!(" {:.1} ({low:.1} to {high:.1}) |", 100.0 * mean),
                2 => format!(" {mean:.3} ± {half:.3} |"),
                _ => format!(" {mean:.1} ± {half:.1} |"),
            };
        }
        let (mean, half) = mean(&of.iter().map(|[old, new]| new[k] - old[k]).collect::<Vec<_>>());
        if k == 2 {
            text += &format!(" {mean:+.4} ± {half:.4} |");
        }
        if sign * mean - half > 0.0 {
            worse.push(what);
        }
    }
    let worse = if worse.is_empty() { String::new() } else { format!("worse: {} ", worse.join(", ")) };
    format!("{text} {worse}|\n")
}

/// Mean, and half of its 95 % interval; nothing finite without values.
fn mean(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, 1.96 * (variance / n).sqrt())
}

/// The 95 % interval of a share, by Wilson.
fn wilson(count: f64, n: f64) -> [f64; 2] {
    let (share, z2) = (count / n, 1.96 * 1.96);
    let middle = share + z2 / (2.0 * n);
    let half = (z2 * (share * (1.0 - share) / n + z2 / (4.0 * n * n))).sqrt();
    [middle - half, middle + half].map(|edge| (edge / (1.0 + z2 / n)).clamp(0.0, 1.0))
}

/// The numbers of an experiment, by their names.
fn reproduce(program: &Path, experiment: &str, keys: &[&str], flights: u32) -> Result<Vec<(String, f64)>, Failure> {
    let mut command = Command::new(program);
    command.args(["reproduce", experiment, "--json", "--quiet"]);
    // The others have as many as they always have.
    command.args(["--scenarios", &flights.min(200).to_string()].iter().filter(|_| experiment == "mmwave"));
    let refused = |error| Failure(format!("{experiment}: {error}"));
    let mut found = Vec::new();
    numbers(&serde_json::from_str(&output(&mut command)?).map_err(refused)?, "", keys, &mut found);
    Ok(found)
}

/// Those with these keys, each behind the names of what it is in; not the ones of a published method, nor of parts of the scenarios.
fn numbers(value: &Value, within: &str, keys: &[&str], found: &mut Vec<(String, f64)>) {
    for item in value.as_array().into_iter().flatten() {
        numbers(item, within, keys, found);
    }
    let Some(object) = value.as_object() else { return };
    let named = NAMES.iter().filter_map(|name| Some((name, object.get(*name)?)));
    let within = named.fold(within.to_owned(), |within, (name, value)| {
        value.as_str().map_or_else(|| format!("{within}{name} {value}, "), |text| format!("{within}{text}, "))
    });
    for (key, value) in object {
        if let Some(number) = value.as_f64().filter(|_| keys.contains(&key.as_str())) {
            found.push((format!("{within}{key}"), number));
        } else if !["paper", "classes"].contains(&key.as_str()) {
            numbers(value, &within, keys, found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_textbooks_and_a_difference_counts_only_outside_its_own() {
        // 81 of 263 (Newcombe, "Two-sided confidence intervals for the single proportion", 1998), 0 of 20.
        let close = |[a, b]: [f64; 2], [c, d]: [f64; 2]| (a - c).abs() < 1e-4 && (b - d).abs() < 1e-4;
        assert!(close(wilson(81.0, 263.0), [0.2553, 0.3662]) && close(wilson(0.0, 20.0), [0.0, 0.1611]));
        assert_eq!(mean(&[1.0, 3.0]), (2.0, 1.96));

        let pairs = |longer: [f64; 4]| longer.map(|by| [[1.0, 0.0, 1.0, 9.0], [1.0, 0.0, 1.0 + by, 9.0]]);
        assert!(row("", &pairs([0.1, 0.2, 0.1, 0.2])).ends_with("| worse: length |\n"));
        assert!(row("", &pairs([0.1, -0.2, 0.1, -0.2])).ends_with(" 9.0 ± 0.0 | |\n"));
    }
}
