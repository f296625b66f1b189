//! Long campaigns of flights: the programs in `host-sim/examples`, in release. Each writes or prints a page of `docs`.

use std::path::PathBuf;

use crate::build::{cargo, workspace};
use crate::{Failure, attend};

/// BARN's worlds, from the root.
pub(crate) const BARN: &str = "../shared/data/barn";

/// Runs one of them with its arguments.
pub(crate) fn run(example: &str, arguments: &[&str]) -> Result<(), Failure> {
    let example = ["run", "--release", "--package", "foxhound-sim", "--example", example, "--"];
    attend(cargo().args(example).args(arguments))
}

/// Runs one that writes a page of `docs/results`, or prints what development seeds come to.
pub(crate) fn write(study: &str, flights: u32, page: &str, is_development: bool) -> Result<(), Failure> {
    let page = path(&format!("docs/results/{page}.md"));
    let development: &[&str] = if is_development { &["development"] } else { &[] };
    run("study", &[&[study, &flights.to_string(), page.as_str()][..], development].concat())
}

/// Flies every setting, or those that are named so, and writes `docs/results/matrix.md`.
pub(crate) fn matrix(times: u32, only: Option<&str>) -> Result<(), Failure> {
    let (times, barn, page) = (times.to_string(), path(BARN), path("docs/results/matrix.md"));
    run("study", &[&["matrix", times.as_str(), &barn, &page][..], only.as_slice()].concat())
}

/// That place in this tree, for an argument.
pub(crate) fn path(of: &str) -> String {
    let path: PathBuf = workspace().join(of);
    path.to_string_lossy().into_owned()
}
