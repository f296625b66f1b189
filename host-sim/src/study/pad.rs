//! The landing pad's detector: what it finds in drawn pictures, and how the weights of its score are trained. What
//! `foxhound pad --train` does.
//!
//! The pictures are those of [`shot`]. Their seeds lie in three ranges that do not meet: [`EXAMINATION`] for what is published,
//! and two more for the training. Each picture is shown twice to a new detector, since it measures the light on the first.

use std::fmt::Write as _;
use std::ops::Range;

use foxhound_core::ConfigError;
use foxhound_core::landing::observation::{Pad, Seen};
use foxhound_pad::{Camera, Candidate, Config, Detector, MEASURES, UNITS, WEIGHTS, Weights};
use rayon::prelude::*;
use serde::Serialize;

pub mod grounds;

use super::network::{self, Network, Rows};
use crate::world::camera::grounds::Grounds;
use crate::world::camera::random::{Recipe, Shot, shot};
use crate::world::camera::watch::alone_by;
use crate::world::camera::{Frame, Truth};

/// Seeds that are never trained on.
pub const EXAMINATION: Range<u64> = 0..5000;
/// Seeds of the pictures that the network is trained on: with a pad, with one that the border cuts, without one.
const TRAINING: [(Recipe, Range<u64>); 4] = [
    (Recipe::PAD, 100_000..130_000),
    (NEAR, 100_000..102_500),
    (Recipe::CLUTTER, 100_000..152_000),
    (Recipe::CLUTTER, 300_000..347_000),
];
/// About a quarter of them, beside real grounds: there weights are trained on from those that fly.
const TRAINING_ON: [(Recipe, Range<u64>); 4] = [
    (Recipe::PAD, 100_000..107_500),
    (NEAR, 100_000..100_600),
    (Recipe::CLUTTER, 100_000..113_000),
    (Recipe::CLUTTER, 300_000..308_000),
];
/// Seeds of the pictures without a pad that set the score's zero.
const THRESHOLD: Range<u64> = 400_000..430_000;
const THRESHOLD_ON: Range<u64> = 400_000..405_000;
/// In at most this many of those pictures a pad may be reported.
const INVENTED: f64 = 0.000_8;
const INVENTED_ON: f64 = 0.000_6;
/// The border cuts most of these.
const NEAR: Recipe = Recipe { is_whole: false, height_m: [0.4, 1.2], ..Recipe::PAD };
/// How a network is trained from random weights.
const ANEW: network::Recipe =
    network::Recipe { hidden: UNITS, classes: 2, epochs: 300, decay: 3e-4, rate: network::RATE };
/// How it is trained on from others.
const ON: network::Recipe = network::Recipe { decay: 1e-4, rate: 5e-4, ..ANEW };
/// Networks that are trained from other random weights each; the one that finds most pads is taken.
const STARTS: u64 = 8;
/// So many seeds in a row are of different kinds, see [`grounds`].
const KINDS: u64 = 6;
/// A network is trained on two of this many rows of seeds; the others measure how good it is.
const PARTS: u64 = 3;
/// The largest weight of a unit in the tables, and the largest count.
const LARGEST: f64 = 126.0;
/// How often a picture is shown; the last time counts.
const LOOKS: u32 = 2;
/// Smaller pads do not count.
const WIDE_PX: f32 = 12.0;
/// More of a pad may not be covered.
const HIDDEN: f32 = 0.3;

/// Results of many pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Tally {
    /// Pictures that count.
    pub due: u32,
    /// Of these, pictures with a pad reported: at its place, or where there is none.
    pub found: u32,
    /// Sum of the squares of the centres' errors over the picture's width.
    pub square: f64,
    /// The same, straightened by the lean.
    pub straight: f64,
}

impl Tally {
    /// The part of the pictures.
    #[must_use]
    pub fn rate(&self) -> f64 {
        f64::from(self.found) / f64::from(self.due)
    }

    /// Root of the mean of one of the sums.
    #[must_use]
    pub fn rms(&self, square: f64) -> f64 {
        (square / f64::from(self.found.max(1))).sqrt()
    }

    /// Of one picture: what is seen, and what is there; `up` is the vertical for a camera that leans.
    fn of(seen: Seen, truth: Option<&Truth>, up: Option<[f32; 2]>) -> Self {
        let tally = Self { due: 1, ..Self::default() };
        let Seen::Pad(pad) = seen else { return tally };
        let Some(truth) = truth else { return Self { found: 1, ..tally } };
        let error = |pad: &Pad| f64::from(apart(pad, truth) * Camera::default().focal_widths);
        // Another thing that is red is no find.
        if error(&pad) >= 0.1 {
            return tally;
        }
        let straight = up.map_or(pad, |up| pad.straightened(up));
        Self { found: 1, square: error(&pad).powi(2), straight: error(&straight).powi(2), ..tally }
    }

    fn and(self, other: Self) -> Self {
        Self {
            due: self.due + other.due,
            found: self.found + other.found,
            square: self.square + other.square,
            straight: self.straight + other.straight,
        }
    }
}

/// The pictures of a recipe with these seeds, on all cores. Only pads of 12 pixels and more count, of which as much as `inside` is
/// in the picture.
///
/// # Errors
/// None in practice: the detector's own configuration.
pub fn examine(
    weights: &[Weights],
    recipe: &Recipe,
    seeds: Range<u64>,
    inside: [f32; 2],
) -> Result<Tally, ConfigError> {
    let (camera, detector) = (Camera::default(), Config::default().build()?);
    let wanted = |truth: &Truth| {
        truth.width_px >= WIDE_PX && truth.hidden <= HIDDEN && (inside[0]..=inside[1]).contains(&truth.inside)
    };
    let look = |seed| {
        let shot = shot(recipe, &camera, seed);
        if recipe.has_pad && !shot.truth.as_ref().is_some_and(wanted) {
            return Tally::default();
        }
        let seen = see(&detector, &shot, |_, candidate| foxhound_pad::score(weights, &candidate.measures));
        Tally::of(seen, shot.truth.as_ref(), Some(shot.pose.up()))
    };
    // One by one in the order of the seeds, so that the sums are the same on any number of cores.
    let tallies: Vec<Tally> = seeds.into_par_iter().map(look).collect();
    Ok(tallies.into_iter().fold(Tally::default(), Tally::and))
}

/// What a score finds in a picture; it is given whether this time counts.
fn see(detector: &Detector, shot: &Shot, score: impl FnMut(bool, &Candidate) -> f32) -> Seen {
    see_in(detector, &shot.frame, shot.pose.height_m, score)
}

fn see_in(detector: &Detector, frame: &Frame, height_m: f32, mut score: impl FnMut(bool, &Candidate) -> f32) -> Seen {
    let score = |look, candidate: &Candidate| score(look + 1 == LOOKS, candidate);
    alone_by(detector, frame, Some(height_m), LOOKS, score).seen
}

fn apart(pad: &Pad, truth: &Truth) -> f32 {
    (pad.forward - truth.forward).hypot(pad.right - truth.right)
}

/// Results of weights on [`EXAMINATION`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Pads that are wholly in the picture.
    pub whole: Tally,
    /// Pads that the border cuts.
    pub cut: Tally,
    /// Pictures without a pad.
    pub clutter: Tally,
}

impl Report {
    /// Of these weights.
    ///
    /// # Errors
    /// See [`examine`].
    pub fn of(weights: &[Weights]) -> Result<Self, ConfigError> {
        let quarter = EXAMINATION.start..EXAMINATION.start + (EXAMINATION.end - EXAMINATION.start) / 4;
        Ok(Self {
            whole: examine(weights, &Recipe::PAD, EXAMINATION, [1.0, 1.0])?,
            cut: examine(weights, &NEAR, quarter, [0.5, 0.9999])?,
            clutter: examine(weights, &Recipe::CLUTTER, EXAMINATION, [0.0, 1.0])?,
        })
    }
}

/// A region of a training picture.
struct Sample {
    seed: u64,
    measures: [f32; MEASURES],
    is_pad: bool,
}

/// Whether a candidate is the pad: none where it is half one, half another thing.
fn judge(pad: &Pad, truth: Option<&Truth>) -> Option<bool> {
    let Some(truth) = truth else { return Some(false) };
    let radius = 0.5 * truth.width_px / f32::from(crate::world::camera::Size::USUAL.width_px);
    let radius = radius / Camera::default().focal_widths;
    let (off, ratio) = (apart(pad, truth) / radius, pad.radius / radius);
    match () {
        () if off < 0.4 && (0.75..1.35).contains(&ratio) => (truth.hidden <= 0.4).then_some(true),
        () if off > 1.0 => Some(false),
        () => None,
    }
}

/// The regions of these pictures that the score would decide about, if it were always right.
fn draw(recipe: &Recipe, seeds: Range<u64>, detector: &Detector) -> Vec<Sample> {
    let camera = Camera::default();
    let look = |seed: u64| {
        let shot = shot(recipe, &camera, seed);
        regions(detector, &shot.frame, shot.pose.height_m, shot.truth.as_ref(), seed)
    };
    seeds.into_par_iter().flat_map_iter(look).collect()
}

/// The same of one picture.
fn regions(detector: &Detector, frame: &Frame, height_m: f32, truth: Option<&Truth>, seed: u64) -> Vec<Sample> {
    let mut samples = Vec::new();
    see_in(detector, frame, height_m, |counts, Candidate { measures, pad }| {
        let verdict = judge(pad, truth);
        samples.extend(verdict.filter(|_| counts).map(|is_pad| Sample { seed, measures: *measures, is_pad }));
        if verdict == Some(true) { 1.0 } else { -1.0 }
    });
    samples
}

fn rows<'a>(samples: impl Iterator<Item = &'a Sample>) -> Rows {
    let (inputs, classes) =
        samples.map(|sample| (sample.measures.map(f64::from).to_vec(), usize::from(sample.is_pad))).unzip();
    Rows { inputs, classes }
}

/// What weights are trained on.
pub struct Lessons {
    samples: Vec<Sample>,
    /// The regions of pictures without a pad, and in which part of the pictures a pad may be reported.
    empty: Vec<(Vec<Vec<Measures>>, f64)>,
}

type Measures = [f32; MEASURES];

impl Lessons {
    /// Draws the pictures, those of real grounds too if there are some.
    ///
    /// # Errors
    /// None in practice: the detector's own configuration.
    pub fn draw(grounds: Option<&Grounds>) -> Result<Self, ConfigError> {
        let detector = Config::default().build()?;
        let camera = Camera::default();
        let (training, threshold, invented) = match grounds {
            None => (TRAINING, THRESHOLD, INVENTED),
            Some(_) => (TRAINING_ON, THRESHOLD_ON, INVENTED_ON),
        };
        let mut samples: Vec<Sample> =
            training.into_iter().flat_map(|(recipe, seeds)| draw(&recipe, seeds, &detector)).collect();
        let regions_of = |seed| {
            let shot = shot(&Recipe::CLUTTER, &camera, seed);
            regions(&detector, &shot.frame, shot.pose.height_m, None, seed).into_iter().map(|sample| sample.measures)
        };
        let drawn = threshold.into_par_iter().map(|seed| regions_of(seed).collect()).collect();
        let mut empty = vec![(drawn, invented)];
        if let Some(grounds) = grounds {
            let (more, real) = grounds::lessons(grounds, &detector);
            samples.extend(more);
            empty.push((real, grounds::INVENTED));
        }
        Ok(Self { samples, empty })
    }

    /// Trains weights from `STARTS` starts, from random ones or on from others, and takes the best. `seed` is that of
    /// the random weights and of the order of the regions.
    #[must_use]
    pub fn train(&self, from: Option<&Weights>, seed: u64) -> Weights {
        let is_held_out = |sample: &&Sample| (sample.seed / KINDS).is_multiple_of(PARTS);
        let lessons = rows(self.samples.iter().filter(|sample| !is_held_out(sample)));
        let held_out: Vec<&Sample> = self.samples.iter().filter(is_held_out).filter(|sample| sample.is_pad).collect();
        let trained: Vec<(usize, Weights)> = (0..STARTS)
            .into_par_iter()
            .map(|start| {
                let seed = STARTS * seed + start;
                let mut weights = weights_of(&match from {
                    Some(from) => {
                        let scaling = from.scales.map(|scale| scale.map(f64::from)).to_vec();
                        Network::train_on(&lessons, &ON, scaling, layers_of(from), seed)
                    }
                    None => Network::train(&lessons, &ANEW, seed),
                });
                weights.none -= self.threshold(&weights);
                let found = held_out.iter().filter(|sample| weights.score(&sample.measures) > 0.0).count();
                (found, weights)
            })
            .collect();
        trained.into_iter().max_by_key(|(found, _)| *found).map_or_else(base, |(_, weights)| weights)
    }

    /// The score that hardly any picture without a pad reaches.
    fn threshold(&self, weights: &Weights) -> f32 {
        let most = |regions: &Vec<Measures>| {
            regions.iter().fold(f32::NEG_INFINITY, |most, measures| most.max(weights.score(measures)))
        };
        let of = |(pictures, invented): &(Vec<Vec<Measures>>, f64)| {
            let mut scores: Vec<f32> = pictures.iter().map(most).collect();
            scores.sort_by(|a, b| b.total_cmp(a));
            scores.get((invented * scores.len() as f64) as usize).copied().unwrap_or(f32::NEG_INFINITY)
        };
        self.empty.iter().map(of).fold(f32::NEG_INFINITY, f32::max)
    }
}

/// The network's weights of whole numbers: those of a unit and its count get about the same size.
fn layers_of(weights: &Weights) -> Vec<f64> {
    let counts = weights.units.map(|(.., count)| f64::from(weights.worth) * f64::from(count) * LARGEST);
    let scales = counts.map(|count| libm::sqrt(count.abs().max(1e-6)));
    let mut layers = Vec::new();
    for ((row, bias, _), scale) in weights.units.iter().zip(scales) {
        layers.extend(row.iter().chain([bias]).map(|weight| scale * f64::from(*weight) / LARGEST));
    }
    for half in [-0.5, 0.5] {
        layers.extend(counts.iter().zip(scales).map(|(count, scale)| half * count / scale));
        layers.push(half * f64::from(weights.none));
    }
    layers
}

/// The first network that flies.
fn base() -> Weights {
    let [first, _] = WEIGHTS;
    first
}

/// A network in the detector's form: the weights of a unit in whole numbers, the largest of them [`LARGEST`].
fn weights_of(network: &Network) -> Weights {
    let mut weights = base();
    for (scale, from) in weights.scales.iter_mut().zip(&network.scaling) {
        *scale = from.map(three_digits);
    }
    let [hidden, output] = network.layers();
    let [no, yes] = <[&[f64]; 2]>::try_from(output.collect::<Vec<_>>()).unwrap_or([&[], &[]]);
    let apart: Vec<f64> = yes.iter().zip(no).map(|(yes, no)| yes - no).collect();
    let largest = |row: &[f64]| row.iter().fold(1e-9, |most, weight| f64::max(most, weight.abs()));
    let units: Vec<(&[f64], f64)> =
        hidden.zip(&apart).map(|(row, counts)| (row, counts * largest(row) / LARGEST)).collect();
    let worth = units.iter().fold(1e-9, |most, (_, counts)| f64::max(most, counts.abs())) / LARGEST;
    for (unit, (row, counts)) in weights.units.iter_mut().zip(units) {
        let whole = |weight: f64| libm::round(weight) as i8;
        let scaled = |k: usize| whole(row[k] * LARGEST / largest(row));
        *unit = (std::array::from_fn(scaled), scaled(MEASURES), whole(counts / worth));
    }
    weights.worth = three_digits(worth);
    weights.none = apart.last().copied().unwrap_or_default() as f32;
    weights
}

/// To three digits that count.
fn three_digits(value: f64) -> f32 {
    format!("{value:.2e}").parse().unwrap_or(value as f32)
}

/// The weights as a source file.
#[must_use]
pub fn source(weights: &Weights, seed: u64) -> String {
    let mut text = format!(
        "//! The weights of the score, made by `foxhound pad --train --seed {seed}`.\n\n\
         use super::score::Weights;\n\nconst NETWORK: Weights = Weights {{\n    scales: [\n"
    );
    for scale in &weights.scales {
        let _ = writeln!(text, "        {scale:?},");
    }
    text.push_str("    ],\n    units: [\n");
    for unit in &weights.units {
        let _ = writeln!(text, "        {unit:?},");
    }
    let _ = writeln!(text, "    ],\n    worth: {:?},\n    none: {:?},\n}};", weights.worth, weights.none);
    text
}

/// Weights beside those in the product, as text.
#[must_use]
pub fn table(rows: &[(&str, Report)]) -> String {
    let mut text =
        format!("{:<10}{:>16}{:>11}{:>12}{:>17}\n", "weights", "pads found, %", "rms, %", "cut, %", "invented, %");
    for (name, Report { whole, cut, clutter }) in rows {
        let [found, rms] = [whole.rate(), whole.rms(whole.square)].map(|part| 100.0 * part);
        let [cut, invented] = [cut, clutter].map(|tally| 100.0 * tally.rate());
        let _ = writeln!(text, "{name:<10}{found:>16.2}{rms:>11.2}{cut:>12.2}{invented:>17.2}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_score_as_the_network_that_they_are_made_of() {
        let samples = draw(&Recipe::PAD, 100_000..100_300, &Config::default().build().unwrap());
        let rows = rows(samples.iter());
        let recipe = network::Recipe { epochs: 10, ..ANEW };
        let network = Network::train(&rows, &recipe, 1);
        let weights = weights_of(&network);
        let agree = samples.iter().zip(&rows.inputs);
        let agree =
            agree.filter(|(sample, row)| (weights.score(&sample.measures) > 0.0) == (network.classify(row) == 1));
        assert!(samples.len() > 100 && 50 * agree.count() > 49 * samples.len());
    }
}
