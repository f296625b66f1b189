//! How fast the simulator is on this machine; prints the tables of `docs/results/scale.md`.
//!
//! `cargo run --release -p foxhound-sim --example rates` flies the 800 pairs of `foxhound maps` on all cores, with bearings of
//! a given noise and with the antennas' waveforms, and finds bearings in single frames. Time of a core is the process's own: what
//! else runs beside it slows down the clock's seconds, and those of a core little.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "it prints")]

use std::error::Error;
use std::f64::consts::TAU;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant as Clock;

use foxhound_core::base::adc::AdcFrame;
use foxhound_core::base::time::Instant;
use foxhound_core::doa::array;
use foxhound_core::doa::bearing::{self, Estimator};
use foxhound_core::planning::planner;
use foxhound_core::signal::phase;
use foxhound_sim::drive::maps::{self, Recipe};
use foxhound_sim::drive::suite::{Map, Place, Report, Selection, Suite, fly_all};
use foxhound_sim::scenario::BearingModel;
use foxhound_sim::world::Pose;
use foxhound_sim::world::antennas::Antennas;
use foxhound_sim::world::random::Random;

const SEED: u64 = 1;
const MAPS_EACH: u32 = 4;
const PAIRS_EACH: usize = 40;
const SNR_DB: f64 = 20.0;
/// Samples of each channel in a frame.
const N: usize = 256;
const FRAMES: usize = 100_000;
/// The best of so many: what else runs on the machine only slows down.
const TRIES: usize = 3;

fn main() -> ExitCode {
    match flights().and_then(|()| frames()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("rates: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Seconds on the clock and seconds of cores that a run took.
#[derive(Clone, Copy, Debug)]
struct Took {
    clock_s: f64,
    cores_s: f64,
}

/// Seconds of cores that this process took so far, in hundredths, where the system is a Linux that says so.
fn cores_s() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is the program's name in brackets; user and system time are the 14th and 15th.
    let ticks = stat.rsplit_once(')')?.1.split_whitespace().skip(11).take(2).map(str::parse::<f64>);
    Some(ticks.sum::<Result<f64, _>>().ok()? / 100.0)
}

/// The shortest of some tries on so many cores, and what it came to.
fn timed<T>(cores: usize, mut run: impl FnMut() -> Result<T, Box<dyn Error>>) -> Result<(Took, T), Box<dyn Error>> {
    let mut best: Option<(Took, T)> = None;
    for _ in 0..TRIES {
        let (begun, before_s) = (Clock::now(), cores_s());
        let result = run()?;
        let clock_s = begun.elapsed().as_secs_f64();
        let cores_s = before_s.zip(cores_s()).map_or(clock_s * cores as f64, |(before_s, after_s)| after_s - before_s);
        if best.as_ref().is_none_or(|(least, _)| clock_s < least.clock_s) {
            best = Some((Took { clock_s, cores_s }, result));
        }
    }
    best.ok_or_else(|| "no try".into())
}

/// The suite of `foxhound maps`.
fn suite() -> Result<Suite, Box<dyn Error>> {
    let mut suite = Suite::default();
    for row in 1..=maps::TABLE_I.len() as u32 {
        let recipe = Recipe::of_row(row).ok_or("Table I has no such row")?;
        for instance in 0..MAPS_EACH {
            let seed = Place { row, instance, pair: u32::MAX }.seed(SEED);
            let obstacles = maps::generate(&recipe, seed)?;
            let pairs = maps::pairs(suite.bounds, &obstacles, suite.drone_radius, PAIRS_EACH, seed)?.pairs;
            suite.maps.push(Map::new(row, instance, obstacles, pairs));
        }
    }
    Ok(suite)
}

fn flights() -> Result<(), Box<dyn Error>> {
    let cores = std::thread::available_parallelism()?.get();
    let noise = suite()?;
    let mut waves = noise.clone();
    waves.bearing.model = Some(BearingModel::Rf);
    waves.bearing.snr_db = Some(SNR_DB);
    println!("| {cores} cores | flights | s | flights/s | times real time | ms of a core | reached | collisions |");
    println!("|---|---|---|---|---|---|---|---|");
    let mut plan = Vec::new();
    for (name, suite) in [("bearings with noise", noise), ("waveforms, all of the chain", waves)] {
        let flights = suite.flights(SEED, &Selection::default());
        let (planner, estimator) = (planner::Config::default(), Estimator::CrossSpectrum);
        let (took, flown) = timed(cores, || Ok(fly_all(&flights, planner, estimator, cores, |_| ())?))?;
        let flown_s: f64 = flown.iter().map(|flown| flown.time_s).sum();
        let all = Report::of(&flown).all;
        println!(
            "| {name} | {} | {:.2} | {:.0} | {:.0} | {:.1} | {} | {} |",
            all.runs,
            took.clock_s,
            all.runs as f64 / took.clock_s,
            flown_s / took.clock_s,
            1e3 * took.cores_s / all.runs as f64,
            all.success,
            all.collisions
        );
        plan.push((name, took.cores_s / all.runs as f64));
    }
    println!("\n| flights | hours of a core | on 2 cores, min | on 64 cores, min |\n|---|---|---|---|");
    for count in [1e5, 1e6] {
        for (name, flight_s) in &plan {
            let minutes = |cores: f64| count * flight_s / 60.0 / cores;
            println!("| {count}, {name} | {:.2} | {:.1} | {:.2} |", minutes(60.0), minutes(2.0), minutes(64.0));
        }
    }
    Ok(())
}

fn frames() -> Result<(), Box<dyn Error>> {
    let extractor = phase::Config::default().build::<N>()?;
    let estimator = bearing::Config::default().build(array::Config::default().build()?)?;
    let antennas = Antennas { snr_db: Some(SNR_DB), ..Antennas::default() };
    let make = |number: usize, random: &mut Random| -> AdcFrame<N> {
        let azimuth_rad = number as f64 / FRAMES as f64 * TAU;
        let source = [1000.0 * azimuth_rad.cos(), 1000.0 * azimuth_rad.sin(), 0.0];
        antennas.frame(Instant(number as u64 * 20_000), &Pose::default(), source, random)
    };
    let count =
        |find: &mut dyn FnMut(usize) -> bool| timed(1, || Ok((0..FRAMES).filter(|number| find(*number)).count()));
    let mut random = Random::new(SEED, 1);
    let recorded: Vec<AdcFrame<N>> = (0..1000).map(|number| make(number * FRAMES / 1000, &mut random)).collect();
    let mut state = phase::State::<N>::default();

    println!("\n| N = {N}, {SNR_DB} dB | frames/s of a core | us of a core a frame | valid |\n|---|---|---|---|");
    let row = |name: &str, (took, valid): (Took, usize)| {
        let frame_s = took.cores_s / FRAMES as f64;
        println!("| {name} | {:.0} | {:.2} | {valid} |", frame_s.recip(), 1e6 * frame_s);
    };
    row("frames made", count(&mut |number| !black_box(make(number, &mut random)).codes.is_empty())?);
    row(
        "bearings of recorded frames, followed",
        count(&mut |number| estimator.estimate(&extractor.step(&mut state, &recorded[number % recorded.len()])).valid)?,
    );
    row(
        "bearings of recorded frames, each acquired alone",
        count(&mut |number| {
            state.reset();
            estimator.estimate(&extractor.step(&mut state, &recorded[number % recorded.len()])).valid
        })?,
    );
    row(
        "made and followed",
        count(&mut |number| estimator.estimate(&extractor.step(&mut state, &make(number, &mut random))).valid)?,
    );
    row(
        "made and acquired alone",
        count(&mut |number| {
            state.reset();
            estimator.estimate(&extractor.step(&mut state, &make(number, &mut random))).valid
        })?,
    );
    Ok(())
}
