//! A suite in parts: `foxhound suite --shard` and `foxhound merge`, and the same over a Ray cluster of two nodes, one of whose
//! workers is killed.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::fs::{create_dir, read, read_to_string, write};
use std::path::{Path, PathBuf};

use foxhound_tests::{errors, foxhound, peer, python, refused, root, run, take_machine, text};
use serde_json::{Value, json};

/// Two maps, out of the order of their rows, and a goal inside a pillar that cannot be reached: 11 flights.
fn suite(folder: &Path) -> String {
    let pairs: Vec<Value> = (0..9).map(|k| json!([0.5 + f64::from(k), 0.5, 5.0, 9.0, 9.0])).collect();
    let suite = json!({"max_time_s": 30, "maps": [
        {"row": 2, "instance": 0, "obstacles": [[3, 4, 0.5], [6, 5, 0.7], [4.5, 7, 0.4]], "pairs": pairs},
        {"row": 1, "instance": 3, "obstacles": [[9, 9, 1]], "pairs": [[1, 1, 9, 9, 11.4], [1, 5, 5, 5, 4.1]]}]});
    let file = folder.join("suite.json");
    write(&file, suite.to_string()).unwrap();
    text(&file)
}

/// Flies some shards into a folder; their files.
fn fly_shards(suite: &str, folder: &Path, shards: &[&str], extra: &[&str]) -> Vec<String> {
    for shard in shards {
        let output = run(&[&["suite", suite, "--json", "--shard", shard, "--out", &text(folder)], extra].concat());
        assert!(output.status.code().is_some_and(|code| code < 2), "{}", errors(&output));
    }
    let path = |shard: &&str| folder.join(format!("shard-{}.jsonl", shard.replace('/', "-of-")));
    shards.iter().map(|shard| text(&path(shard))).collect()
}

/// What `merge` prints, its exit code and its errors.
fn merge(files: &[String], extra: &[&str]) -> (Option<i32>, Vec<u8>, String) {
    let files = files.iter().map(String::as_str);
    let output = run(&["merge", "--json"].into_iter().chain(files).chain(extra.iter().copied()).collect::<Vec<_>>());
    let errors = errors(&output);
    (output.status.code(), output.stdout, errors)
}

/// Four shards of a suite merge to the same bytes as one shard and as the whole suite.
#[test]
fn four_shards_merge_to_the_bytes_of_one_and_of_the_whole_suite() {
    let dir = tempfile::tempdir().unwrap();
    let suite = suite(dir.path());
    let whole_to = text(&dir.path().join("whole"));
    let whole = run(&["suite", &suite, "--json", "--out", &whole_to]);
    assert_eq!(whole.status.code(), Some(1), "one goal is inside a pillar");
    let totals: Value = serde_json::from_slice(&whole.stdout).unwrap();
    assert_eq!((&totals["all"]["runs"], &totals["all"]["success"]), (&json!(11), &json!(10)), "{totals}");

    let one = run(&["suite", &suite, "--json", "--shard", "1/1", "--out", &text(dir.path())]);
    assert_eq!((one.status.code(), &one.stdout), (Some(1), &whole.stdout), "one shard is the whole");
    // In any order.
    let files = fly_shards(&suite, dir.path(), &["3/4", "1/4", "4/4", "2/4"], &["--jobs", "1"]);
    let merged_to = text(&dir.path().join("merged"));
    let (code, merged, errors) = merge(&files, &["--out", &merged_to]);
    assert_eq!((code, &merged), (Some(1), &whole.stdout), "{errors}");
    let flights = |folder: &str| read(Path::new(folder).join("flights.jsonl")).unwrap();
    assert_eq!(flights(&merged_to), flights(&whole_to));
    let [whole_table, merged_table] = ["whole.csv", "merged.csv"].map(|name| text(&dir.path().join(name)));
    assert_eq!(run(&["suite", &suite, "--json", "--csv", &whole_table]).status.code(), Some(1));
    assert_eq!(merge(&files, &["--csv", &merged_table]).0, Some(1));
    assert_eq!(read(merged_table).unwrap(), read(&whole_table).unwrap());
    let said = refused(&["suite", &suite, "--shard", "1/4", "--csv", &whole_table]);
    assert!(said.contains("--csv"), "{said}");
    // For people, too.
    let table = |arguments: &[&str]| run(arguments).stdout;
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    assert_eq!(table(&[&["merge"], files.as_slice()].concat()), table(&["suite", &suite]));
}

/// With more shards than flights some shards are empty, and the merged result is still that of the whole.
#[test]
fn more_shards_than_flights_leave_some_empty_and_merge_all_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let suite = suite(dir.path());
    let only = ["--only", "1"];
    let files = fly_shards(&suite, dir.path(), &["1/3", "2/3", "3/3"], &only);
    assert_eq!(read_to_string(&files[2]).unwrap().lines().count(), 1, "its header alone");
    let whole = run(&[&["suite", &suite, "--json"][..], &only].concat());
    assert_eq!(merge(&files, &[]).1, whole.stdout);
}

/// Shards that do not belong together, or lack flights, are refused, and the message names the shard.
#[test]
fn shards_that_do_not_make_one_suite_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let suite = suite(dir.path());
    let files = fly_shards(&suite, dir.path(), &["1/2", "2/2"], &["--pairs", "1"]);
    let other = dir.path().join("other");
    create_dir(&other).unwrap();
    let other_seed = fly_shards(&suite, &other, &["2/2"], &["--pairs", "1", "--seed", "2"]);
    let cut = dir.path().join("cut.jsonl");
    let whole = read_to_string(&files[0]).unwrap();
    write(&cut, whole.lines().next().unwrap()).unwrap();
    let strange = dir.path().join("strange.jsonl");
    write(&strange, whole.replace("\"seed\"", "\"sead\"")).unwrap();
    let (a, b) = (files[0].clone(), files[1].clone());
    let cases: [(&[String], &str); 7] = [
        (std::slice::from_ref(&a), "shard 2/2 is missing"),
        (&[a.clone(), a.clone()], "shard 1/2 was given twice"),
        (&[a.clone(), other_seed[0].clone()], "shard 2/2 is of another suite, seed or release than shard 1/2"),
        (&[text(&cut), b.clone()], "cut.jsonl: 0 flights of the 1 of shard 1/2"),
        (&[text(&strange), b], "strange.jsonl: line 2: missing field `seed`"),
        (&[suite.clone(), a.clone()], "suite.json: line 1: "),
        (&[a.clone(), text(&other.join("none.jsonl"))], "none.jsonl"),
    ];
    for (files, expected) in cases {
        let (code, out, errors) = merge(files, &[]);
        assert_eq!((code, out.len()), (Some(2), 0), "{errors}");
        assert!(errors.contains(expected), "{expected}: {errors}");
    }
}

/// The program itself, for scripts that start it.
fn program() -> PathBuf {
    PathBuf::from(foxhound().get_program())
}

/// A Ray cluster of two nodes gives the same bytes as the suite in one piece, although a worker is killed while it flies.
#[test]
#[ignore = "needs Ray: cargo xtask test"]
fn a_ray_cluster_of_two_nodes_comes_to_the_bytes_of_the_suite_though_a_worker_is_killed() {
    let _machine = take_machine();
    let dir = tempfile::tempdir().unwrap();
    let suite = suite(dir.path());
    let output = peer("ray_cluster.py")
        // The killed worker leaves its folder behind.
        .env("TMPDIR", dir.path())
        .arg("--kill")
        .arg(root().join("examples/ray_suite.py"))
        .args(["--foxhound".as_ref(), program().as_os_str(), "--shards".as_ref(), "4".as_ref(), "--out".as_ref()])
        .arg(dir.path())
        .args([suite.as_str(), "--", "--seed", "3"])
        .output()
        .unwrap();
    let errors = errors(&output);
    let whole = run(&["suite", &suite, "--json", "--seed", "3"]);
    assert_eq!((output.status.code(), &output.stdout), (whole.status.code(), &whole.stdout), "{errors}");
    assert!(errors.contains(" was killed\n"), "{errors}");
    assert!(errors.contains("4 shards on 2 nodes"), "both nodes flew: {errors}");
}

/// `examples/snr_sweep.py` writes a table within 15 % of the bound, and a plot where Matplotlib is installed.
#[test]
#[ignore = "needs NumPy and Matplotlib: cargo xtask test"]
fn the_sweep_of_the_snr_writes_a_table_near_the_bound_and_a_plot_where_matplotlib_is() {
    let dir = tempfile::tempdir().unwrap();
    let sweep = |name: &str, search_first: &Path| {
        let out = dir.path().join(name);
        let output = python()
            .env("PYTHONPATH", search_first)
            .arg(root().join("examples/snr_sweep.py"))
            .args(["--frames", "200", "--snr-db", "10", "20", "30", "--foxhound"])
            .args([program().as_os_str(), "--out".as_ref(), out.as_os_str()])
            .output()
            .unwrap();
        let errors = errors(&output);
        assert!(output.status.success(), "{errors}");
        (read_to_string(out.join("snr_sweep.csv")).unwrap(), out.join("snr_sweep.png").exists(), errors)
    };
    let (table, drawn, errors) = sweep("with", dir.path());
    assert!(drawn, "{errors}");
    let rows: Vec<Vec<f64>> =
        table.lines().skip(1).map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
    assert_eq!(table.lines().next(), Some("snr_db,frames,valid,rms_deg,bound_deg"));
    assert_eq!(rows.iter().map(|row| row[0]).collect::<Vec<_>>(), [10.0, 20.0, 30.0]);
    for row in &rows {
        assert_eq!((row[1], row[2]), (200.0, 200.0), "{table}");
        // 200 frames: the rms is known to 5 %.
        let ratio = row[3] / row[4];
        assert!((0.85..1.15).contains(&ratio), "{ratio}: {table}");
    }
    // One that cannot be imported is found first.
    let without = dir.path().join("stub");
    create_dir(&without).unwrap();
    write(without.join("matplotlib.py"), "raise ImportError('not here')\n").unwrap();
    let (same, drawn, errors) = sweep("without", &without);
    assert!(!drawn && errors.contains("no matplotlib"), "{errors}");
    assert_eq!(same, table);
}
