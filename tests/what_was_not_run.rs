//! Says, behind all other tests of `cargo test`, how many were left out and what they need.

use std::collections::BTreeMap;
use std::path::Path;

use foxhound_tests::root;

/// The crates that `cargo test` tests.
const CRATES: [&str; 8] = ["core", "papers", "pad", "link", "computer", "firmware", "host-sim", "tests"];

fn main() -> std::io::Result<()> {
    // Whoever names tests, or wants the ignored ones, knows what runs.
    if std::env::args().len() > 1 {
        return Ok(());
    }
    let mut needs = BTreeMap::new();
    for name in CRATES {
        count(&root().join(name), &mut needs)?;
    }
    println!("\n{} tests were left out:", needs.values().sum::<u32>());
    for (need, tests) in needs {
        println!("{tests:>4}  {need}");
    }
    println!("`cargo xtask test` installs all that and runs them.\n");
    Ok(())
}

/// Counts the tests in a folder by what stands behind their `ignore`.
fn count(folder: &Path, needs: &mut BTreeMap<String, u32>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            count(&path, needs)?;
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            for line in std::fs::read_to_string(&path)?.lines() {
                let reason = line.trim().strip_prefix("#[ignore = \"").and_then(|rest| rest.strip_suffix("\"]"));
                if let Some(reason) = reason {
                    let need = reason.strip_suffix(": cargo xtask test").unwrap_or(reason);
                    *needs.entry(need.to_owned()).or_insert(0) += 1;
                }
            }
        }
    }
    Ok(())
}
