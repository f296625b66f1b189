//! The parameters from outside: the command that lists and checks them, the manual's page, a flight with them, and pymavlink
//! as the ground station.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;

use foxhound_core::base::time::Instant;
use foxhound_core::guidance;
use foxhound_core::guidance::param::Values;
use foxhound_link::framer::{Content, Framer, Header};
use foxhound_link::params::{Params, Reply, Storage};
use foxhound_tests::station::frame;
use foxhound_tests::{assert_refused, errors, peer, refused, root, run, run_json, text};

/// `docs/parameters.md` is what `foxhound params --markdown` prints.
#[test]
fn the_manuals_page_is_what_the_command_prints() {
    let printed = run(&["params", "--markdown"]);
    let page = std::fs::read_to_string(root().join("docs/parameters.md")).unwrap();
    let advice = "foxhound params --markdown > docs/parameters.md";
    assert!(printed.status.success() && String::from_utf8(printed.stdout).unwrap() == page, "{advice}");
}

/// `foxhound params` lists the values that a file and `--set` give, the latter first.
#[test]
fn values_are_listed_with_what_was_set_from_the_file_and_after_it() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("quad.toml");
    std::fs::write(&file, "# ours\nFH_SPD_MAX = 2\nFH_RADIUS = 0.25\n").unwrap();
    let (code, table) = run_json(&["params", "--json", "--file", &text(&file), "--set", "FH_RADIUS=0.3"]);
    assert_eq!(code, 0);
    let value = |name: &str| {
        let row = table["params"].as_array().unwrap().iter().find(|row| row["name"] == name).unwrap();
        (row["value"].as_f64().unwrap(), row["default"].as_f64().unwrap(), row["unit"].as_str().unwrap().to_owned())
    };
    assert_eq!(value("FH_SPD_MAX"), (2.0, 1.0, "m/s".to_owned()));
    assert_eq!(value("FH_RADIUS"), (0.3, 0.15, "m".to_owned()));
    assert_eq!(value("FH_LAG"), (0.45, 0.45, "s".to_owned()));
}

/// A bad value, an unknown name, and values that do not fit one another are refused by the names of parameters, with the values of those
/// that they must fit.
#[test]
fn bad_values_are_refused_by_the_names_of_parameters() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bad.toml");
    let file = text(&path);
    for (content, words) in [
        ("FH_SPD_MX = 2.0", &["FH_SPD_MX", "did you mean `FH_SPD_MAX`?"][..]),
        ("fh_radius = 0.2", &["fh_radius", "did you mean `FH_RADIUS`?"]),
        ("qqq = 0.2", &["qqq", "`foxhound params` lists them"]),
        ("FH_SPD_MAX = 99", &["FH_SPD_MAX = 99", "outside 0.05..=20"]),
        ("FH_SPD_MAX = nan", &["FH_SPD_MAX", "not a finite number"]),
        ("FH_SPD_MAX = 1e300", &["FH_SPD_MAX", "not a finite number"]),
        ("FH_SPD_MAX = \"fast\"", &["FH_SPD_MAX", "expected a number, not string"]),
        ("FH_SPD_MAX = true", &["FH_SPD_MAX", "expected a number, not boolean"]),
        ("FH_OBS_REQ = 0.5", &["FH_OBS_REQ = 0.5", "not a whole number"]),
        ("[FH_SPD_MAX]\nx = 1", &["FH_SPD_MAX", "expected a number, not table"]),
        ("FH_SPD_MAX = 1\nFH_SPD_MAX = 2", &["FH_SPD_MAX", "duplicate key"]),
        ("FH_SPD_MAX == 1", &["bad.toml", "line 1"]),
        // What does not fit.
        ("FH_ARR_SIDE = 0.2", &["FH_ARR_SIDE = 0.2", "(FH_WAVELEN = 0.345)", "half a wavelength"]),
        ("FH_WAVELEN = 0.1", &["FH_ARR_SIDE = 0.138", "(FH_WAVELEN = 0.1)"]),
        ("FH_MARGIN = 0.01", &["FH_MARGIN_TGT = 0.02 is outside 0..=0.01", "(FH_MARGIN = 0.01)"]),
        ("FH_SMP_RATE = 50000", &["FH_TONE_HI = 49000", "FH_SMP_RATE = 50000"]),
        ("FH_TONE = 60000", &["FH_TONE = 60000 is outside", "(FH_SMP_RATE = 102400)"]),
        ("FH_BRG_SRC = 1\nFH_OBS_SRC = 1", &["FH_BRG_SRC = 1", "FH_OBS_SRC = 1"]),
        ("FH_BRG_SRC = 2\nFH_TURN = 2", &["FH_BRG_SRC", "FH_TURN = 2"]),
        ("FH_TURN = 2\nFH_TURN_RATE = 3", &["FH_TURN_RATE = 3", "(FH_YAWR_MAX = 1.25)"]),
        ("FH_TURN = 2\nFH_TURN_RATE = 0.1", &["FH_TURN_RATE = 0.1 is outside"]),
        ("FH_FENCE_R = 0.5", &["FH_FENCE_R = 0.5 is outside 1..="]),
        ("FH_SRCH_TIME = 0.5", &["FH_SRCH_TIME = 0.5 is outside 1..=3600"]),
        ("FH_SRCH_TIME = 9\nFH_RADIUS = 3", &["FH_RADIUS + FH_MARGIN = 3.05 is outside 0..=2", "FH_RADIUS = 3"]),
        ("FH_OBS_RANGE = 0.4", &["FH_OBS_RANGE = 0.4", "(FH_RADIUS = 0.15)", "0.35 m farther than the hull"]),
        ("FH_RADIUS = 1.5\nFH_OBS_RANGE = 6", &["FH_RADIUS = 1.5", "FH_OBS_MIN", "FH_OBS_FOV = 90", "155 degrees"]),
        ("FH_SPD_MAX = 0.06", &["FH_SPD_MAX = 0.06", "FH_STALL_T = 20", "FH_STALL_R = 1"]),
        ("FH_HB_TMO = 9", &["FH_SILENT = 5", "(FH_HB_TMO = 9)"]),
    ] {
        std::fs::write(&path, content).unwrap();
        for command in [["params", "--file", &file], ["fly", "--params", &file]] {
            let said = refused(&command);
            assert!(words.iter().all(|word| said.contains(word)), "{command:?} {content}: {said}");
            let inner = ["link.", "planner.", "phase.", "turning.", "guard.", "explore.", "radio =", "side_m", "_mps"];
            assert!(!inner.iter().any(|word| said.contains(word)), "{command:?} {content}: {said}");
        }
    }
    let assignments = [("FH_LAG", "NAME=VALUE"), ("FH_LAG=slow", "`slow`"), ("=1", "unknown"), ("FH_LAG=9", "0..=2")];
    assert_refused(&["params", "--set"], &assignments.map(|(assignment, word)| ([assignment], [word])));
}

/// A flight uses the parameters that it is given, and those of its scenario for the rest.
#[test]
fn a_flight_goes_by_the_parameters_that_it_is_given_and_by_its_scenario_else() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("slow.toml");
    let scenario = text(&root().join("tests/scenarios/open_field.json"));
    let fly = |content: &str| {
        std::fs::write(&file, content).unwrap();
        run_json(&["fly", "--json", "--scenario", &scenario, "--params", &text(&file)]).1
    };
    let (as_it_is, slow) = (fly(""), fly("FH_SPD_MAX = 0.5"));
    assert_eq!(as_it_is, run_json(&["fly", "--json", "--scenario", &scenario]).1);
    assert_eq!(slow["result"], "reached");
    let (fast_s, slow_s) = (as_it_is["time_s"].as_f64().unwrap(), slow["time_s"].as_f64().unwrap());
    // Not twice: the nose turns as fast.
    assert!(slow_s > 1.6 * fast_s, "{fast_s} s, then {slow_s} s");
    // Those of the link are used too: the simulated pilot has the switch on, and no battery is full.
    assert_eq!(fly("FH_RC_CH = 7")["result"], "reached");
    let careful = run(&["fly", "--json", "--scenario", &scenario, "--params", &text(&file)]).status.code();
    assert_eq!(careful, Some(0));
    std::fs::write(&file, "FH_BAT_MIN = 100").unwrap();
    let (code, held) = run_json(&["fly", "--json", "--scenario", &scenario, "--params", &text(&file)]);
    assert!(code == 1 && held["reason"] != "nominal" && held["path_length_m"].as_f64() < Some(0.5), "{held}");
}

/// The companion's side of `tests/peers/set_parameters.py`.
struct Companion {
    framer: Framer,
    params: Params,
    now: Instant,
    sequence: u8,
}

impl Companion {
    fn hear(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.framer.push(&[*byte]);
            while let Some((header, content)) =
                self.framer.next_frame().map(|frame| (frame.header, Content::of(&frame)))
            {
                assert!(self.params.hear((1, 191), header, &content.unwrap(), false) || header.system_id == 255);
            }
            self.decide();
        }
    }

    /// As an application does.
    fn decide(&mut self) {
        while let Some(values) = self.params.proposal(false) {
            let mut config = guidance::Config::default();
            values.apply(&mut config);
            self.params.settle(config.build::<256>().map(|_| ()));
        }
        if let Some(storage) = self.params.take_storage() {
            if storage == Storage::Reset {
                self.params.replace(Values::DEFAULT);
            }
            self.params.stored(true);
        }
    }

    fn speak(&mut self, milliseconds: u64) -> Vec<u8> {
        let mut sent = Vec::new();
        for _ in 0..milliseconds {
            self.now = self.now.plus_micros(1_000);
            let header = Header { system_id: 1, component_id: 191, sequence: self.sequence };
            sent.extend(match self.params.next(self.now) {
                Some(Reply::Value(value)) => frame(header, &value),
                Some(Reply::Text(text)) => frame(header, &text),
                Some(Reply::Ack(ack)) => frame(header, &ack),
                None => continue,
            });
            self.sequence = self.sequence.wrapping_add(1);
        }
        sent
    }
}

/// pymavlink, as a ground station, lists, sets, reads back and stores the parameters.
#[test]
#[ignore = "needs pymavlink: cargo xtask test"]
fn pymavlink_lists_sets_reads_back_and_stores_them() {
    let dir = tempfile::tempdir().unwrap();
    let table = dir.path().join("table.json");
    std::fs::write(&table, run(&["params", "--json"]).stdout).unwrap();
    let mut station = peer("set_parameters.py")
        .arg(&table)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut companion =
        Companion { framer: Framer::new(), params: Params::new(Values::DEFAULT), now: Instant(0), sequence: 0 };
    let mut to_station = station.stdin.take().unwrap();
    for line in BufReader::new(station.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        let (milliseconds, hex) = line.split_once(' ').unwrap();
        let byte = |at: usize| u8::from_str_radix(&hex[at..at + 2], 16).unwrap();
        companion.hear(&(0..hex.len()).step_by(2).map(byte).collect::<Vec<_>>());
        let answer = companion.speak(milliseconds.parse().unwrap());
        let answer: String = answer.iter().map(|byte| format!("{byte:02x}")).collect();
        // A station that has failed listens no more.
        if writeln!(to_station, "{answer}").is_err() {
            break;
        }
    }
    drop(to_station);
    let output = station.wait_with_output().unwrap();
    assert!(output.status.success() && errors(&output).contains("all checks passed"), "{}", errors(&output));
}
