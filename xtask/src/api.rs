//! The public interface of the libraries that others depend on, item by item, beside what is committed: `cargo xtask api`. A change of
//! it is so seen in a review, where it decides about the version.

use std::fs;

use public_api::Builder;

use crate::build::{cargo, workspace};
use crate::{Failure, attend};

/// The crates that have a listing in `xtask/api`.
const CRATES: [&str; 2] = ["core", "link"];

/// Fails where the interface is not the one that is committed; with `renew` writes it instead.
pub(crate) fn run(renew: bool) -> Result<(), Failure> {
    let mut changed = Vec::new();
    for name in CRATES {
        let now = listing(name)?;
        let path = workspace().join(format!("xtask/api/{name}.txt"));
        let failed = |error| Failure(format!("{}: {error}", path.display()));
        if renew {
            fs::write(&path, now).map_err(failed)?;
            continue;
        }
        let before = fs::read_to_string(&path).map_err(failed)?;
        changed.extend(differing('-', &before, &now));
        changed.extend(differing('+', &now, &before));
    }
    if changed.is_empty() {
        return Ok(());
    }
    Err(Failure(format!(
        "the public interface has changed; `cargo xtask api --renew` accepts it:\n{}",
        changed.join("\n")
    )))
}

/// The lines of one listing that the other does not have.
fn differing(mark: char, of: &str, other: &str) -> Vec<String> {
    let other: std::collections::BTreeSet<&str> = other.lines().collect();
    of.lines().filter(|line| !other.contains(line)).map(|line| format!("{mark} {line}")).collect()
}

/// Every public item of a crate, without what is derived or generated.
fn listing(name: &str) -> Result<String, Failure> {
    let target = workspace().join("target/api");
    let mut rustdoc = cargo();
    rustdoc
        .args(["rustdoc", "--quiet", "--lib", "--package", &format!("foxhound-{name}"), "--target-dir"])
        .arg(&target);
    // rustdoc's JSON is not stable yet: `public-api` is the version that reads this compiler's.
    rustdoc.args(["--", "-Zunstable-options", "--output-format=json"]).env("RUSTC_BOOTSTRAP", "1");
    attend(&mut rustdoc)?;
    let json = target.join(format!("doc/foxhound_{name}.json"));
    let api = Builder::from_rustdoc_json(&json)
        .omit_blanket_impls(true)
        .omit_auto_trait_impls(true)
        .omit_auto_derived_impls(true)
        .build()
        .map_err(|error| Failure(format!("{}: {error}", json.display())))?;
    let own = format!("foxhound_{name}::");
    let lines = api.items().map(ToString::to_string).filter(|line| !is_generated(line, &own));
    Ok(lines.map(|line| line + "\n").collect())
}

/// Whether an item is of MAVLink's dialect, which is made of the public definitions.
fn is_generated(line: &str, own: &str) -> bool {
    line.find(own).is_some_and(|at| line[at + own.len()..].starts_with("dialect::"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_dialect_has_is_left_out_and_what_takes_it_is_not() {
        assert!(is_generated("pub struct foxhound_link::dialect::HEARTBEAT_DATA", "foxhound_link::"));
        assert!(!is_generated("pub fn foxhound_link::encode(&foxhound_link::dialect::MavMessage)", "foxhound_link::"));
    }

    #[test]
    fn a_line_that_is_gone_and_a_new_one_are_told() {
        assert_eq!(differing('-', "a\nb\n", "b\nc\n"), ["- a"]);
        assert_eq!(differing('+', "b\nc\n", "a\nb\n"), ["+ c"]);
    }
}
