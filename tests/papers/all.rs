//! `foxhound reproduce all`: every experiment in one folder, an index page, and a run that continues after an
//! interruption.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::path::Path;

use foxhound_tests::{peer_says, run_json};
use serde_json::Value;

const NAMES: [&str; 8] =
    ["aoa-circle", "aoa-crb", "apf-density", "apf-variants", "multipath", "localize", "mmwave", "stretch"];
/// Few of everything: some seconds.
const SMALL: [&str; 8] = ["--pairs", "4", "--scenes", "1", "--trials", "4", "--scenarios", "4"];

fn all(folder: &Path, more: &[&str]) -> Value {
    let out = folder.to_string_lossy();
    let (status, report) = run_json(&[&["reproduce", "all", "--json", "--out", &out], &SMALL[..], more].concat());
    assert_eq!(status, 0);
    report
}

/// Which were there already.
fn kept(report: &Value) -> Vec<&str> {
    let experiments = report["experiments"].as_array().unwrap().iter();
    experiments.filter(|one| one["kept"] == true).map(|one| one["experiment"].as_str().unwrap()).collect()
}

/// Every file of the experiments, but for how long they took.
fn content(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    for name in NAMES {
        for entry in std::fs::read_dir(folder.join(name)).unwrap() {
            let path = entry.unwrap().path();
            if path.file_name().unwrap() != "made.json" {
                files.insert(path.strip_prefix(folder).unwrap().display().to_string(), std::fs::read(&path).unwrap());
            }
        }
    }
    files
}

/// `reproduce all` writes every experiment, and a second run repeats only those that are incomplete.
#[test]
fn all_experiments_are_written_and_a_second_run_makes_again_what_is_not_whole_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path().join("new/papers");
    let report = all(&folder, &[]);
    let names: Vec<&str> =
        report["experiments"].as_array().unwrap().iter().map(|one| one["experiment"].as_str().unwrap()).collect();
    assert_eq!((names.as_slice(), kept(&report).len()), (&NAMES[..], 0));
    let first = content(&folder);
    for name in NAMES {
        let figures =
            first.keys().filter(|file| file.starts_with(&format!("{name}/")) && file.ends_with(".svg")).count();
        assert!(figures > 0 && first.contains_key(&format!("{name}/table.txt")), "{name}: {:?}", first.keys());
        // The same as the experiment alone prints.
        let written: Value = serde_json::from_slice(&first[&format!("{name}/report.json")]).unwrap();
        let few = match name {
            "apf-density" => &SMALL[0..2],
            "multipath" => &SMALL[2..4],
            "stretch" => &SMALL[4..6],
            "mmwave" => &SMALL[6..8],
            _ => &[],
        };
        assert_eq!(run_json(&[&["reproduce", name, "--json"], few].concat()).1, written, "{name}");
    }

    // Whole: all is kept. Then a file gone, a run ended before its list, and a list cut.
    assert_eq!(kept(&all(&folder, &[])), NAMES);
    std::fs::remove_file(folder.join("localize/localize.svg")).unwrap();
    std::fs::remove_file(folder.join("multipath/made.json")).unwrap();
    std::fs::write(folder.join("mmwave/made.json"), "{\"program\":").unwrap();
    assert_eq!(kept(&all(&folder, &[])), ["aoa-circle", "aoa-crb", "apf-density", "apf-variants", "stretch"]);
    assert_eq!(content(&folder), first, "what is made again is the same");

    // Another setting makes again what depends on it.
    let more = run_json(
        &[
            &["reproduce", "all", "--json", "--out", &folder.to_string_lossy()],
            &SMALL[..4],
            &["--trials", "5", "--scenarios", "4"],
        ]
        .concat(),
    );
    assert_eq!(kept(&more.1).len(), 7);
    assert!(!kept(&more.1).contains(&"stretch"));
    assert_eq!(kept(&all(&folder, &["--seed", "2"])), ["apf-variants"], "in which nothing is random");
}

/// The page shows the published numbers beside ours, and refers to nothing on the network.
#[test]
fn the_page_has_the_published_numbers_beside_ours_and_asks_nobody_for_anything() {
    let folder = tempfile::tempdir().unwrap();
    let report = all(folder.path(), &[]);
    let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    for address in ["http:", "https:", "@import", "url(", "<script", "NaN", "inf "] {
        assert!(!page.contains(address), "{address}");
    }
    let beside = report["beside"].as_array().unwrap();
    assert!(NAMES.iter().all(|name| beside.iter().any(|line| line["experiment"] == *name)));
    for line in beside {
        let [published, theirs, ours] = ["published", "theirs", "ours"].map(|key| line[key].as_str().unwrap());
        assert!(!theirs.is_empty() || !ours.is_empty(), "{line}");
        for words in [line["what"].as_str().unwrap(), published, theirs, ours] {
            assert!(page.contains(words), "{words}");
        }
    }
    // Numbers of each paper, as it prints them.
    for (experiment, published) in [
        ("aoa-circle", "1.48 deg"),
        ("apf-density", "57.1 % of 7"),
        ("apf-density", "+46 %"),
        ("apf-variants", "12.818 s"),
        ("localize", "10.95 m^2"),
        ("mmwave", "94.5 %"),
        ("stretch", "1.6"),
    ] {
        let is_it = |line: &&Value| line["experiment"] == experiment && line["published"] == published;
        assert!(beside.iter().any(|line| is_it(&line)), "{experiment}: {published}");
    }
    // Every figure and table of the papers has a verdict and a sentence that says why; every paper is cited.
    let judgements = report["judgements"].as_array().unwrap();
    let manual = std::fs::read_to_string(foxhound_tests::root().join("docs/papers.md")).unwrap();
    for (paper, figures) in [
        ("main paper", &["Table I", "fig. 8", "fig. 9", "fig. 10"][..]),
        ("variants paper", &["Table I", "fig. 2", "fig. 3", "fig. 4", "fig. 5"]),
        ("mmWave paper", &["Table 2", "Table 3", "fig. 2", "fig. 3", "fig. 4", "fig. 5", "fig. 6"]),
        ("rotating vehicle's paper", &["fig. 3", "fig. 4"]),
    ] {
        for figure in figures {
            let name = format!("{paper}, {figure}");
            let found: Vec<&Value> = judgements.iter().filter(|one| one["figure"] == *name).collect();
            assert_eq!(found.len(), 1, "{name}");
            let (verdict, why) = (found[0]["verdict"].as_str().unwrap(), found[0]["why"].as_str().unwrap());
            assert!(["reproduced", "better", "not_reproduced"].contains(&verdict), "{name}: {verdict}");
            assert!(why.ends_with('.') && why.len() > 40, "{name}: {why}");
            assert!(page.contains(&why.replace('&', "&amp;").replace('"', "&quot;")), "{name}: {why}");
            assert!(manual.contains(&format!("| {name} | ")), "docs/papers.md has no verdict on {name}");
        }
    }
    for cited in ["arXiv:2506.06811", "arXiv:2303.03739", "American Control Conference, 2013"] {
        assert!(page.contains(cited) && manual.contains(cited), "{cited}");
    }
    let figures = page.matches("<img ").count();
    let files = report["experiments"].as_array().unwrap().iter().flat_map(|one| one["files"].as_array().unwrap());
    assert_eq!(figures, files.filter(|file| file.as_str().unwrap().ends_with(".svg")).count());
}

/// A browser shows every figure of the page from disk and requests nothing from the network.
#[test]
#[ignore = "needs a browser: cargo xtask test"]
fn a_browser_shows_every_figure_from_disk_and_asks_nobody() {
    let folder = tempfile::tempdir().unwrap();
    all(folder.path(), &[]);
    let _ = peer_says("papers_page.py", &[folder.path().join("index.html")]);
}
