//! Bearings beside MUSIC and a plain beam in NumPy (`tests/peers/directions.py`), on the same frames in the same run.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use foxhound_tests::{peer_says, root, take_machine};
use serde_json::{Value, json};

use crate::modulations::{N, RATE_HZ, Reception, lines, six_kinds};
use crate::other_radios::{Files, complex64, errors, has, number};
use crate::waves::{quantile, rms};

/// What NumPy finds in the recordings of a folder, by their names in order.
pub(crate) fn directions(folder: &Path) -> Vec<Value> {
    peer_says("directions.py", &[folder]).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Numbers of a list.
pub(crate) fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

/// Six kinds of reception beside MUSIC in NumPy, on frames that no constant was chosen with: the errors are at most 1.1 of MUSIC's.
/// `--nocapture` prints the table of `docs/results/radios.md`, and what a frame takes.
#[test]
#[ignore = "needs NumPy: cargo xtask test"]
fn six_kinds_of_reception_are_as_good_as_with_music_in_numpy() {
    let _alone = take_machine();
    let files = Files::new();
    let kinds = six_kinds(5303);
    for (number, kind) in kinds.iter().enumerate() {
        let Reception { antennas_m, sent, azimuths, values, .. } = kind;
        complex64(&files.path(&format!("{number}.npy")), &[azimuths.len(), antennas_m.len(), N], values);
        let bin_hz = RATE_HZ / N as f64;
        let [low_hz, high_hz] = sent.band_hz();
        let bins = [(low_hz / bin_hz).ceil() as i32, (high_hz / bin_hz).floor() as i32];
        files.text(&format!("{number}.json"), &json!({"antennas": antennas_m, "bins": bins, "looks": [1]}).to_string());
    }
    let found = directions(files.path(".").as_path());
    assert_eq!(found.len(), kinds.len());
    println!("| antennas | sent | dB | Foxhound | MUSIC in NumPy | us a frame | MUSIC, us |");
    for (kind, found) in kinds.iter().zip(&found) {
        let Reception { name, antennas_m, sent, snr_db, azimuths, values } = kind;
        let (all, _) = lines(&files, antennas_m, sent.band_hz(), values, 1);
        // Others use the machine as well: the least time, of twenty frames.
        let parts = values.chunks_exact(20 * antennas_m.len() * N);
        let own_us = parts.map(|part| lines(&files, antennas_m, sent.band_hz(), part, 1).1).fold(f64::MAX, f64::min);
        let own = errors(&all, azimuths);
        assert_eq!(own.len(), azimuths.len(), "{name}");
        let radians: Vec<f64> = numbers(&found["music_deg"]).iter().map(|degrees| degrees.to_radians()).collect();
        let (own, its) = (rms(&own), rms(&kind.errors(&radians)));
        let its_us = found["music_us"].as_f64().unwrap();
        println!("| {name} | {sent:?} | {snr_db} | {own:.2} | {its:.2} | {own_us:.0} | {its_us:.0} |");
        assert!(own <= 1.1 * its, "{name}: {own} against {its} deg");
    }
}

/// Error in degrees of an azimuth by a row of antennas, whose broadside is ahead: of the nearest of the directions that such a row cannot tell apart.
fn row_error(azimuth: f64, off_broadside_deg: f64, apart: f64) -> f64 {
    let alike = (-2..=2).map(|turns| azimuth.sin() + f64::from(turns) / apart).filter(|sine| sine.abs() <= 1.0);
    alike.map(|sine| (sine.asin().to_degrees() - off_broadside_deg).abs()).fold(f64::MAX, f64::min)
}

/// What was heard of several frames: errors in degrees, and how many of the answers are marked.
#[derive(Default)]
struct Heard {
    lines: usize,
    own: Vec<f64>,
    music: Vec<f64>,
    beam: Vec<f64>,
    /// Of these answers: within three sigma, flagged as more than one wave, valid.
    marked: [usize; 3],
}

impl Heard {
    fn join(&mut self, other: &Self) {
        self.lines += other.lines;
        self.own.extend(&other.own);
        self.music.extend(&other.music);
        self.beam.extend(&other.beam);
        self.marked.iter_mut().zip(other.marked).for_each(|(sum, part)| *sum += part);
    }

    /// Share of the answers, %.
    fn share(&self, marked: usize) -> f64 {
        100.0 * self.marked[marked] as f64 / self.own.len() as f64
    }

    fn marks(&self) -> String {
        let [inside, flagged, valid] = [0, 1, 2].map(|marked| self.share(marked));
        let (answered, lines) = (self.own.len(), self.lines);
        format!(
            "{answered} of {lines} answered; within 3 sigma {inside:.1} %, flagged {flagged:.1} %, valid {valid:.1} %"
        )
    }

    fn row(&self) -> String {
        let parts = [&self.own, &self.music, &self.beam];
        parts.map(|part| format!("{:.2} / {:.2}", quantile(part, 0.5), quantile(part, 0.9))).join(" | ")
    }
}

/// Frames of a coherent software radio at 3.55 GHz, recorded by others: rows of four antennas give the bearings of MUSIC and of a plain beam in
/// NumPy, one by one and six joined. Their antennas are nearly a wavelength apart: most answers are ambiguous, and errors are those of the nearest
/// of the directions that fit. `--nocapture` prints the table of `docs/results/radios.md`.
#[test]
#[ignore = "needs NumPy and SciPy: cargo xtask test"]
fn a_recorded_software_radio_gives_the_bearings_of_music() {
    let beside = root().join("../shared/data/radio/icasp");
    let data = std::env::var_os("FOXHOUND_ICASP").map_or(beside, PathBuf::from);
    if !data.join("client_x1_for_az.mat").exists() {
        eprintln!(
            "SKIPPED: there is no {}, or what FOXHOUND_ICASP names: a recorded radio is not heard",
            data.display()
        );
        return;
    }
    let files = Files::new();
    let folder = files.path(".");
    let _ = peer_says("icasp_frames.py", &[&data, &folder]);
    println!("| place | off broadside | rows | Foxhound | MUSIC | plain beam |");
    let mut all: BTreeMap<u64, Heard> = BTreeMap::new();
    for found in directions(&folder) {
        let name = found["name"].as_str().unwrap();
        let described = std::fs::read_to_string(files.path(&format!("{name}.json"))).unwrap();
        let described: Value = serde_json::from_str(&described).unwrap();
        let truth_deg = described["off_broadside_deg"].as_f64().unwrap();
        let antennas: Vec<Vec<f64>> = described["antennas"].as_array().unwrap().iter().map(numbers).collect();
        let apart = antennas[0][1] - antennas[1][1];
        let looks = found["looks"].as_u64().unwrap();
        // Without a band the rate has no effect.
        let array = format!("wavelength_m = 1.0\nantennas_m = {antennas:?}\nsample_rate_hz = 1e6\n");
        let lines = files.lines("--iq", &format!("{name}.npy"), &array, &["--looks", &looks.to_string()]);
        let error = |degrees: f64| row_error(degrees.to_radians(), truth_deg, apart);
        let theirs = |key: &str| numbers(&found[key]).into_iter().map(error).collect::<Vec<_>>();
        let (music, beam) = (theirs("music_deg"), theirs("beam_deg"));
        let mut heard = Heard { lines: lines.len(), music, beam, ..Heard::default() };
        for line in lines.iter().filter(|line| line["azimuth_deg"].is_number()) {
            let off = error(number(line, "azimuth_deg"));
            let is_second = has(line, "interferer") || has(line, "multipath");
            let marks = [off < 3.0 * number(line, "sigma_deg"), is_second, line["valid"] == true];
            heard.own.push(off);
            heard.marked.iter_mut().zip(marks).for_each(|(sum, mark)| *sum += usize::from(mark));
        }
        println!("| {name} | {truth_deg:.1} | {looks} | {} |", heard.row());
        // At the second place every method finds another direction in each frame.
        if name == "2" {
            println!("{}", heard.marks());
        } else {
            all.entry(looks).or_default().join(&heard);
            for part in [0.5, 0.9] {
                let most = 1.2 * quantile(&heard.music, part).max(quantile(&heard.beam, part)) + 0.1;
                assert!(quantile(&heard.own, part) <= most, "place {name}, {looks} rows: {}", heard.row());
            }
        }
    }
    for (looks, heard) in &all {
        println!("| without 2 | | {looks} | {} |", heard.row());
        println!("{}", heard.marks());
        assert!(20 * heard.own.len() >= 19 * heard.lines && heard.share(0) >= 95.0, "{looks} rows");
        for part in [0.5, 0.9] {
            assert!(quantile(&heard.own, part) <= 1.05 * quantile(&heard.music, part), "{looks} rows: {}", heard.row());
        }
    }
    assert!(quantile(&all[&6].own, 0.5) <= 1.0 && quantile(&all[&6].own, 0.9) <= 3.0);
}
