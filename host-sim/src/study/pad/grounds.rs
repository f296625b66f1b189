//! What the detector finds on real grounds. What `foxhound pad --grounds` does.

use std::fmt::Write as _;
use std::ops::Range;

use foxhound_core::ConfigError;
use foxhound_core::landing::observation::Seen;
use foxhound_pad::{Camera, Candidate, Config, Detector, MEASURES, Weights};
use rayon::prelude::*;
use serde::Serialize;

use super::{KINDS, Sample, Tally, regions, see_in};
use crate::world::camera::grounds::{Disc, Grounds, View};
use crate::world::random::Random;

/// The pictures of each row with a disc.
const FOUND: u64 = 1000;
/// Those without one.
const EMPTY: u64 = 10_000;
/// The rows: round discs, those that lost their shape, and round ones on ground like brick.
const ROWS: [(&str, Option<Disc>, u64); 6] = [
    ("round", Some(Disc::ROUND), FOUND),
    ("5 % off round", Some(Disc { uneven: 0.05, ..Disc::ROUND }), FOUND),
    ("axes of 0.8", Some(Disc { axes: 0.8, ..Disc::ROUND }), FOUND),
    ("axes of 0.7", Some(Disc { axes: 0.7, ..Disc::ROUND }), FOUND),
    ("round, on red", Some(Disc { is_on_red: true, ..Disc::ROUND }), FOUND),
    ("without a disc", None, EMPTY),
];

/// Seeds of the views that weights are trained on: with a disc, and without.
const TRAINING: [Range<u64>; 2] = [100_000..103_000, 200_000..205_000];
/// Seeds of those that set the score's zero.
const THRESHOLD: Range<u64> = 400_000..407_500;
/// In at most this many of those a pad may be reported.
pub(super) const INVENTED: f64 = 0.000_14;

/// The regions of views to train on, and those of views without a disc.
pub(super) fn lessons(grounds: &Grounds, detector: &Detector) -> (Vec<Sample>, Vec<Vec<[f32; MEASURES]>>) {
    let [with, without] = TRAINING;
    let regions = |seed: u64, disc: Option<&Disc>| {
        let view = grounds.view(disc, &Camera::default(), seed);
        regions(detector, &view.frame, view.height_m, view.truth.as_ref(), seed)
    };
    let samples = with.into_par_iter().flat_map_iter(|seed| regions(seed, Some(&lesson(seed))));
    let samples = samples.chain(without.into_par_iter().flat_map_iter(|seed| regions(seed, None))).collect();
    let measures = |seed| regions(seed, None).into_iter().map(|sample| sample.measures).collect();
    (samples, THRESHOLD.into_par_iter().map(measures).collect())
}

/// Of six discs four have lost their shape, and one lies on red ground.
fn lesson(seed: u64) -> Disc {
    // Other draws than those of the view.
    let mut random = Random::new(seed, 43);
    let mut share = |most: f32| most * random.uniform() as f32;
    let (uneven, narrower) = (share(0.055), share(0.35));
    match seed % KINDS {
        0 => Disc::ROUND,
        1 => Disc { is_on_red: true, ..Disc::ROUND },
        2 => Disc { uneven, ..Disc::ROUND },
        3 => Disc { axes: 1.0 - narrower, ..Disc::ROUND },
        _ => Disc { uneven, axes: 1.0 - narrower, ..Disc::ROUND },
    }
}

/// One kind of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// Whether there is a disc in them.
    pub has_disc: bool,
    /// Its results.
    #[serde(flatten)]
    pub tally: Tally,
}

/// The views of each row, with its name.
pub fn views(grounds: &Grounds, seed: u64) -> impl Iterator<Item = (&'static str, Vec<View>)> {
    ROWS.into_iter().map(move |(name, disc, count)| {
        // The rows with a disc show the same grounds from the same heights.
        let seeds = seed..seed + count;
        (name, seeds.into_par_iter().map(|seed| grounds.view(disc.as_ref(), &Camera::default(), seed)).collect())
    })
}

/// Where the detector sees a pad in a view.
///
/// # Errors
/// None in practice: the detector's own configuration.
pub fn see(weights: &[Weights], view: &View) -> Result<Seen, ConfigError> {
    let detector = Config::default().build()?;
    let score = |_, candidate: &Candidate| foxhound_pad::score(weights, &candidate.measures);
    Ok(see_in(&detector, &view.frame, view.height_m, score))
}

/// Shows the detector pictures of each row.
///
/// # Errors
/// See [`see`].
pub fn measure(grounds: &Grounds, weights: &[Weights], seed: u64) -> Result<Vec<Row>, ConfigError> {
    let row = |(name, views): (&'static str, Vec<View>)| {
        let tallies: Result<Vec<Tally>, ConfigError> =
            views.par_iter().map(|view| Ok(Tally::of(see(weights, view)?, view.truth.as_ref(), None))).collect();
        let tally = tallies?.into_iter().fold(Tally::default(), Tally::and);
        let has_disc = views.iter().any(|view| view.truth.is_some());
        Ok(Row { name, has_disc, tally })
    };
    views(grounds, seed).map(row).collect()
}

/// The rows as text.
#[must_use]
pub fn table(rows: &[Row]) -> String {
    let mut text = format!("{:<16}{:>9}{:>11}{:>18}\n", "discs", "pictures", "pads, %", "centre, rms, %");
    for Row { name, has_disc, tally } in rows {
        let rms = if *has_disc { format!("{:.2}", 100.0 * tally.rms(tally.square)) } else { String::new() };
        let _ = writeln!(text, "{name:<16}{:>9}{:>11.2}{rms:>18}", tally.due, 100.0 * tally.rate());
    }
    text
}
