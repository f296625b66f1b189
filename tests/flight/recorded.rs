//! Flights by the bearings of recorded packets: what `foxhound bearing --switched` answers, with its errors and its sigma, place by place.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::cell::Cell;
use std::f64::consts::{PI, TAU};
use std::sync::atomic::{AtomicUsize, Ordering};

use foxhound_core::base::obstacle::Circle;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::bearing::{Bearing, Estimator, Flags};
use foxhound_core::guidance::FrontEnd;
use foxhound_core::guidance::mission::Outcome;
use foxhound_core::planning::planner;
use foxhound_sim::drive::computer::{BLOCK, Computer, ComputerError, HostComputer, StepReport};
use foxhound_sim::drive::flight::{self, Ending};
use foxhound_sim::drive::suite::{Flight, Selection, Suite};
use foxhound_sim::study::seeds;
use foxhound_sim::world::Horizontal;
use foxhound_tests::recording::{self, Place};
use foxhound_tests::{in_parallel, run_json, run_json_lines, text};
use serde_json::{Value, json};

/// Side of a place in flight; in the recording they are 3 m apart.
const PLACE_M: f64 = 2.0;
/// As a pilot sets `FH_BRG_AGE`, in periods.
const PATIENCE: f64 = 3.5;

/// A packet that came, and its bearing if it has one.
#[derive(Clone, Copy, Debug)]
struct Heard {
    time_s: f64,
    /// Error and sigma.
    bearing_rad: Option<[f64; 2]>,
}

/// The packets of one beacon at one place, and how long they were recorded.
#[derive(Clone, Debug)]
struct Block {
    heard: Vec<Heard>,
    length_s: f64,
}

impl Block {
    /// The last packet of a time span; the recording begins again when it ends.
    fn between(&self, from_s: f64, to_s: f64) -> Option<Heard> {
        let (from_s, to_s) = (from_s.rem_euclid(self.length_s), to_s.rem_euclid(self.length_s));
        let is_inside = |heard: &&Heard| match from_s <= to_s {
            true => (from_s..to_s).contains(&heard.time_s),
            false => heard.time_s >= from_s || heard.time_s < to_s,
        };
        self.heard.iter().rfind(is_inside).copied()
    }
}

/// The bearings of the packets of a place; its mean error, the heading of the board, is taken out.
fn blocks(place: &Place) -> Vec<Block> {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&dir.path().join(name));
    place.write(dir.path());
    std::fs::write(path("a.toml"), recording::array()).unwrap();
    let (f, e, a) = (path("f.npy"), path("e.npy"), path("a.toml"));
    let lines = run_json_lines(&["bearing", "--switched", &f, "--array", &a, "--emitter", &e, "--json"]);
    let packets = place.beacons.len();
    assert_eq!(lines.len(), packets);

    let bearing = |line: &Value, truth: f64| {
        let number = |key: &str| line[key].as_f64().unwrap().to_radians();
        (line["valid"] == true).then(|| [number("azimuth_deg") - truth, number("sigma_deg")])
    };
    let all: Vec<Option<[f64; 2]>> =
        lines.iter().zip(&place.truth).map(|(line, truth)| bearing(line, *truth)).collect();
    let off = || all.iter().flatten().map(|[off, _]| *off);
    let heading = f64::atan2(off().map(f64::sin).sum(), off().map(f64::cos).sum());
    let error = |off: f64| (off - heading + PI).rem_euclid(TAU) - PI;
    [1, 2, 4, 5]
        .map(|beacon| {
            let of_it = (0..packets).filter(|packet| place.beacons[*packet] == beacon);
            let heard = of_it.map(|packet| Heard {
                time_s: place.times_s[packet] - place.times_s[0],
                bearing_rad: all[packet].map(|[off, sigma]| [error(off), sigma]),
            });
            Block { heard: heard.collect(), length_s: place.times_s[packets - 1] - place.times_s[0] + 0.05 }
        })
        .to_vec()
}

/// A computer that is given the recorded bearings instead of the simulator's.
struct Listener<'a> {
    computer: HostComputer,
    blocks: &'a [Block],
    at: &'a Cell<Horizontal>,
    seed: u64,
    before_s: f64,
    given: &'a AtomicUsize,
}

impl Listener<'_> {
    /// The true bearing with the error of a packet of this place, if one comes now. Which block a place has, and where it begins,
    /// are drawn once for each flight.
    fn hear(&mut self, truth: Bearing, now: Instant) -> Option<Bearing> {
        let now_s = now.0 as f64 * 1e-6;
        let before_s = std::mem::replace(&mut self.before_s, now_s);
        let cell = |metres: f64| (metres / PLACE_M).floor() as i64 as u64;
        let mut drawn = [self.seed, cell(self.at.get().north), cell(self.at.get().east)]
            .into_iter()
            .fold(0_u64, |hash, number| (hash ^ number).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
        drawn = (drawn ^ drawn >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let block = &self.blocks[(drawn >> 33) as usize % self.blocks.len()];
        let begin_s = (drawn & 0xffff) as f64 / 65_536.0 * block.length_s;
        let [error_rad, sigma_rad] = block.between(begin_s + before_s, begin_s + now_s)?.bearing_rad?;
        self.given.fetch_add(1, Ordering::Relaxed);
        let azimuth_rad = (f64::from(truth.azimuth_rad) + error_rad + PI).rem_euclid(TAU) - PI;
        let flags = Flags::ALIKE;
        Some(Bearing { azimuth_rad: azimuth_rad as f32, sigma_rad: sigma_rad as f32, flags, ..truth })
    }
}

impl Computer for Listener<'_> {
    fn step(
        &mut self,
        now: Instant,
        front_end: FrontEnd<'_, BLOCK>,
        circles: Option<&[Circle]>,
        rx: &[u8],
    ) -> Result<StepReport, ComputerError> {
        let FrontEnd::Bearing(truth) = front_end else { return Err(ComputerError("no true bearing".to_owned())) };
        let heard = self.hear(truth, now).map_or(FrontEnd::Nothing, FrontEnd::Bearing);
        self.computer.step(now, heard, circles, rx)
    }

    fn see(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.computer.see(bytes)
    }

    fn turn(&mut self, bytes: &[u8]) -> Result<(), ComputerError> {
        self.computer.turn(bytes)
    }
}

/// How a flight ended.
struct Ended {
    result: Ending,
    is_silent: bool,
    /// Its length over the reference.
    ratio: f64,
    time_s: f64,
}

fn fly(planned: &Flight, blocks: &[Block], age_s: f64, given: &AtomicUsize) -> Ended {
    let mission = planned.mission(planner::Config::default(), Estimator::default());
    let mut config = mission.guidance();
    config.mission.bearing_age_max_s = config.mission.bearing_age_max_s.max(age_s as f32);
    let at = Cell::new(Horizontal::from_xy(mission.scenario.start));
    let computer = HostComputer::new(&config).unwrap();
    let mut listener = Listener { computer, blocks, at: &at, seed: planned.seed, before_s: 0.0, given };
    let record = flight::fly(&mission, &mut listener, None, |moment| at.set(moment.sample.position)).unwrap();
    let whole_m = record.report.path_length_m + mission.scenario.goal_tolerance;
    let (result, time_s) = (record.report.result, record.report.time_s);
    let is_silent = record.report.reason == Outcome::NoSignal.name();
    Ended { result, is_silent, ratio: whole_m / planned.reference_length_m, time_s }
}

/// Pillar forests of five densities, four maps each, by the bearings of 6600 recorded Bluetooth packets as they came, with their gaps, errors and
/// sigma: at least 98 % arrive where it searches in places that hear nothing, and none collides, with a search or without. A place of the flight
/// has the packets of one beacon at one place of the recording. Four pairs a map; `FOXHOUND_PAIRS=40` flies the 800 of `docs/results/radios.md`.
#[test]
fn bearings_of_recorded_packets_lead_through_pillar_forests() {
    let Some(places) = recording::places() else {
        eprintln!("SKIPPED: there is no ../shared/data/radio: recorded packets are not flown on");
        return;
    };
    let blocks: Vec<Block> = places.values().flat_map(blocks).collect();
    let bearings: Vec<[f64; 2]> =
        blocks.iter().flat_map(|block| &block.heard).filter_map(|heard| heard.bearing_rad).collect();
    let rms_deg =
        (bearings.iter().map(|[error, _]| error * error).sum::<f64>() / bearings.len() as f64).sqrt().to_degrees();
    let rate_hz = bearings.len() as f64 / blocks.iter().map(|block| block.length_s).sum::<f64>();
    let is_silent = |block: &&Block| block.heard.iter().all(|heard| heard.bearing_rad.is_none());
    let silent = blocks.iter().filter(is_silent).count();
    println!("{} places, {silent} of them silent, {rate_hz:.2} bearings a second, {rms_deg:.1} deg rms", blocks.len());

    let dir = tempfile::tempdir().unwrap();
    let pairs = std::env::var("FOXHOUND_PAIRS").unwrap_or_else(|_| "4".to_owned());
    let (out, seed) = (text(dir.path()), seeds::TEST.start);
    let made =
        ["maps", "--json", "--seed", &seed.to_string(), "--pairs", &pairs, "--drone-radius", "0.15", "--out", &out];
    assert_eq!(run_json(&made).0, 0);
    let suite = std::fs::read_to_string(dir.path().join("suite.json")).unwrap();
    let mut suite: Value = serde_json::from_str(&suite).unwrap();
    suite["bearing"] = json!({"only": true, "model": "noise", "sigma_deg": 0});
    let suite = Suite::parse(&suite.to_string()).unwrap();
    println!(
        "| `FH_SRCH_TIME` | bearings a second | flights | reached | ended without a signal | collisions | path over reference |"
    );
    for (search_s, least) in [(0.0, 0.8), (30.0, 0.98)] {
        let mut flights = suite.flights(seed, &Selection::default());
        assert!(flights.len() >= 80);
        for planned in &mut flights {
            planned.scenario.explore_s = search_s;
        }
        let given = AtomicUsize::new(0);
        let ended = in_parallel(&flights, |planned| fly(planned, &blocks, PATIENCE / rate_hz, &given));
        let count = |result: Ending| ended.iter().filter(|ended| ended.result == result).count();
        let (reached, collisions) = (count(Ending::Reached), count(Ending::Collision));
        let silent = ended.iter().filter(|ended| ended.result != Ending::Reached && ended.is_silent).count();
        let ratios = ended.iter().filter(|ended| ended.result == Ending::Reached).map(|ended| ended.ratio);
        println!(
            "| {search_s} | {:.2} | {} | {reached} | {silent} | {collisions} | {:.2} |",
            given.load(Ordering::Relaxed) as f64 / ended.iter().map(|ended| ended.time_s).sum::<f64>(),
            ended.len(),
            ratios.sum::<f64>() / reached as f64
        );
        assert_eq!(collisions, 0, "FH_SRCH_TIME = {search_s}");
        assert!(reached as f64 >= least * ended.len() as f64, "FH_SRCH_TIME = {search_s}: {reached}");
    }
}
