//! How often the classifier is right, beside the received level alone.

use std::fmt::Write as _;

use foxhound_core::localize::link_state::{CLASSES, Classifier, FEATURES, LinkState};
use serde::Serialize;

use super::legs::Sample;
use crate::world::random::Random;

/// Counts: truth, then answer.
pub(super) type Confusion = [[u64; CLASSES]; CLASSES];

/// Names of the classes.
pub(super) const CLASS_NAMES: [&str; CLASSES] = ["line of sight", "first order", "higher order", "none"];
/// Draws of the bootstrap.
const DRAWS: usize = 1000;
/// Lead of the strongest path from which a moment counts as clear.
const CLEAR_DB: f64 = 6.0;

/// Results of a classifier on fresh scenes.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Seed of the scenes.
    pub seed: u64,
    /// Scenes.
    pub scenes: usize,
    /// Moments.
    pub samples: u64,
    /// Of each class: `line_of_sight`, `first_order`, `higher_order`, `none`.
    pub class_counts: [u64; CLASSES],
    /// The classifier that has no map.
    pub without_map: Outcome,
    /// The classifier that knows most walls.
    pub with_map: Outcome,
    /// Thresholds of the level, the best that there are for these very scenes.
    pub baseline: Baseline,
}

/// How often a classifier is right.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Counts: rows are the truth, columns the answers.
    pub confusion: Confusion,
    /// Share of each class that is found.
    pub recall: [f64; CLASSES],
    /// Share of the answers of each class that are right.
    pub precision: [f64; CLASSES],
    /// Mean of the recalls.
    pub balanced_accuracy: f64,
    /// Its 95 % interval, by a bootstrap over scenes.
    pub balanced_accuracy_95: [f64; 2],
    /// By how much it is above the baseline's, 95 %, by the same bootstrap.
    pub above_baseline_95: [f64; 2],
    /// Balanced accuracy of line of sight against all others.
    pub line_of_sight_balanced: f64,
    /// Balanced accuracy where the strongest path leads by 6 dB and the truth has been the same for the whole window.
    pub clear_balanced: f64,
}

/// The best thresholds of the level alone.
#[derive(Clone, Debug, Serialize)]
pub struct Baseline {
    /// Above the first it is line of sight, above the second first order, above the third higher order.
    pub thresholds_db: [f64; CLASSES - 1],
    /// Counts: rows are the truth, columns the answers.
    pub confusion: Confusion,
    /// Share of each class that is found.
    pub recall: [f64; CLASSES],
    /// Mean of the recalls.
    pub balanced_accuracy: f64,
    /// Its 95 % interval.
    pub balanced_accuracy_95: [f64; 2],
}

pub(super) fn confusion(pairs: impl Iterator<Item = (usize, usize)>) -> Confusion {
    let mut counts = Confusion::default();
    for (truth, answer) in pairs {
        counts[truth][answer] += 1;
    }
    counts
}

fn recall(counts: &Confusion) -> [f64; CLASSES] {
    std::array::from_fn(|class| counts[class][class] as f64 / counts[class].iter().sum::<u64>().max(1) as f64)
}

fn precision(counts: &Confusion) -> [f64; CLASSES] {
    std::array::from_fn(|class| {
        counts[class][class] as f64 / counts.iter().map(|row| row[class]).sum::<u64>().max(1) as f64
    })
}

/// Mean of the recalls of the classes that occur.
pub(super) fn balanced_accuracy(counts: &Confusion) -> f64 {
    let there = counts.iter().filter(|row| row.iter().sum::<u64>() > 0).count();
    recall(counts).iter().sum::<f64>() / there.max(1) as f64
}

fn added(parts: impl Iterator<Item = Confusion>) -> Confusion {
    parts.fold(Confusion::default(), |mut sum, part| {
        sum.iter_mut().flatten().zip(part.iter().flatten()).for_each(|(a, b)| *a += b);
        sum
    })
}

fn answer(classifier: &Classifier, features: &[f32; FEATURES]) -> usize {
    let state = classifier.classify(features).state;
    LinkState::ALL.iter().position(|other| *other == state).unwrap_or(CLASSES - 1)
}

fn of_level(thresholds_db: &[f64; CLASSES - 1], sample: &Sample) -> usize {
    thresholds_db.iter().position(|threshold| f64::from(sample.blind[0]) > *threshold).unwrap_or(CLASSES - 1)
}

/// The thresholds of the level with the highest balanced accuracy, to a decibel.
fn best_thresholds(scenes: &[Vec<Sample>]) -> [f64; CLASSES - 1] {
    const LOW_DB: i32 = -21;
    const COUNT: usize = 72;
    // Share of each class at or below a level.
    let mut below = [[0.0_f64; COUNT]; CLASSES];
    for (class, shares) in below.iter_mut().enumerate() {
        let levels: Vec<f64> =
            scenes.iter().flatten().filter(|s| s.class == class).map(|s| f64::from(s.blind[0])).collect();
        for (k, share) in shares.iter_mut().enumerate() {
            let count = levels.iter().filter(|level| **level <= f64::from(LOW_DB + k as i32)).count();
            *share = count as f64 / levels.len().max(1) as f64;
        }
    }
    let (mut best, mut found) = (-1.0, [0; CLASSES - 1]);
    for a in 0..COUNT {
        for b in 0..=a {
            for c in 0..=b {
                let rate =
                    (1.0 - below[0][a]) + (below[1][a] - below[1][b]) + (below[2][b] - below[2][c]) + below[3][c];
                if rate > best {
                    (best, found) = (rate, [a, b, c]);
                }
            }
        }
    }
    found.map(|k| f64::from(LOW_DB + k as i32))
}

/// The middle 95 %.
fn interval(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((share * values.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    [at(0.025), at(0.975)]
}

impl Report {
    pub(super) fn of(classifier: &Classifier, seed: u64, scenes: &[Vec<Sample>]) -> Self {
        let thresholds_db = best_thresholds(scenes);
        let each = |answer: &dyn Fn(&Sample) -> usize| -> Vec<Confusion> {
            scenes.iter().map(|samples| confusion(samples.iter().map(|s| (s.class, answer(s))))).collect()
        };
        let level = each(&|sample| of_level(&thresholds_db, sample));
        let outcome = |mapped: bool| {
            let answer = |s: &Sample| answer(classifier, if mapped { &s.mapped } else { &s.blind });
            let counts = each(&answer);
            let clear = scenes.iter().flatten().filter(|s| s.lead_db >= CLEAR_DB && !s.is_fresh);
            let clear = confusion(clear.map(|s| (s.class, answer(s))));
            Outcome::of(&counts, &level, &clear, seed)
        };
        let total = added(level.iter().copied());
        let (own, _) = bootstrap(&level, &level, seed);
        let class_counts = total.map(|row| row.iter().sum());
        Self {
            seed,
            scenes: scenes.len(),
            samples: class_counts.iter().sum(),
            class_counts,
            without_map: outcome(false),
            with_map: outcome(true),
            baseline: Baseline {
                thresholds_db,
                confusion: total,
                recall: recall(&total),
                balanced_accuracy: balanced_accuracy(&total),
                balanced_accuracy_95: own,
            },
        }
    }

    /// The report as text.
    #[must_use]
    pub fn table(&self) -> String {
        let mut text = format!("{} moments in {} scenes (seed {})\n", self.samples, self.scenes, self.seed);
        for (name, outcome) in [("without a map", &self.without_map), ("with most walls known", &self.with_map)] {
            let _ = writeln!(text, "\n{name}: balanced accuracy {}", outcome.summary());
            let _ = writeln!(
                text,
                "{:<16}{:>14}{:>14}{:>14}{:>14}{:>9}",
                "truth", CLASS_NAMES[0], CLASS_NAMES[1], CLASS_NAMES[2], CLASS_NAMES[3], "recall"
            );
            for (class, row) in outcome.confusion.iter().enumerate() {
                let [a, b, c, d] = row;
                let recall = 100.0 * outcome.recall[class];
                let _ = writeln!(text, "{:<16}{a:>14}{b:>14}{c:>14}{d:>14}{recall:>7.1} %", CLASS_NAMES[class]);
            }
        }
        let [low, high] = self.baseline.balanced_accuracy_95.map(|x| 100.0 * x);
        let _ = writeln!(
            text,
            "\nthe level alone, with the best thresholds for these scenes: balanced accuracy {:.1} % [{low:.1}, {high:.1}]",
            100.0 * self.baseline.balanced_accuracy
        );
        text
    }
}

impl Outcome {
    fn of(counts: &[Confusion], baseline: &[Confusion], clear: &Confusion, seed: u64) -> Self {
        let total = added(counts.iter().copied());
        let (own, above) = bootstrap(counts, baseline, seed);
        let others: u64 = total.iter().skip(1).flatten().sum();
        let others_found: u64 = total.iter().skip(1).flat_map(|row| row.iter().skip(1)).sum();
        let recall = recall(&total);
        Self {
            confusion: total,
            recall,
            precision: precision(&total),
            balanced_accuracy: balanced_accuracy(&total),
            balanced_accuracy_95: own,
            above_baseline_95: above,
            line_of_sight_balanced: 0.5 * (recall[0] + others_found as f64 / others.max(1) as f64),
            clear_balanced: balanced_accuracy(clear),
        }
    }

    pub(super) fn summary(&self) -> String {
        let [low, high] = self.balanced_accuracy_95.map(|x| 100.0 * x);
        let [less, more] = self.above_baseline_95.map(|x| 100.0 * x);
        format!(
            "{:.1} % [{low:.1}, {high:.1}], above the level alone by {less:.1} to {more:.1} points",
            100.0 * self.balanced_accuracy
        )
    }
}

/// 95 % intervals of the balanced accuracy, and of what it is above another's, by drawing the scenes again.
fn bootstrap(counts: &[Confusion], others: &[Confusion], seed: u64) -> ([f64; 2], [f64; 2]) {
    let mut random = Random::new(seed, 9);
    let (mut own, mut above) = (Vec::with_capacity(DRAWS), Vec::with_capacity(DRAWS));
    for _ in 0..DRAWS {
        let drawn: Vec<usize> =
            counts.iter().map(|_| ((random.uniform() * counts.len() as f64) as usize).min(counts.len() - 1)).collect();
        let one = balanced_accuracy(&added(drawn.iter().map(|k| counts[*k])));
        let other = balanced_accuracy(&added(drawn.iter().map(|k| others[*k])));
        own.push(one);
        above.push(one - other);
    }
    (interval(own), interval(above))
}
