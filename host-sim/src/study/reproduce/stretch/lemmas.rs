//! The discs to which the greedy rule returns for ever: lemma 1 for outliers that point anywhere, lemma 2 for the worst.
//!
//! A return is a step into the disc from outside. A walk goes on until it has returned so often, or for
//! [`EXCURSION_STEPS_MAX`] steps without: then it has left for good, as far as anybody can tell.

use std::fmt::Write as _;

use foxhound_papers::rotating::lemma::{Bound, Motion, Silent, mean_cosine};
use rayon::prelude::{IntoParallelIterator as _, ParallelIterator as _};
use serde::Serialize;

use super::walk::{Model, Outliers, Rule, STEP_M, Walk};
use super::{START_M, STEPS_MAX, Stretch};
use crate::scenario::input::InputError;
use crate::world::Horizontal;
use crate::world::random::Random;

/// Returns after which a walk has shown that it returns.
pub const RETURNS: u32 = 300;
/// Steps without a return after which it has not.
pub const EXCURSION_STEPS_MAX: u32 = 100_000;
/// Where a walk starts, x east and y north.
const NEAR_M: [f64; 2] = [5.0, 5.0];
/// Purpose of the random numbers.
const DRAWS: u64 = 22;

/// Both lemmas.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Returns after which a walk has shown that it returns.
    pub returns: u32,
    /// Steps without one after which it has not.
    pub excursion_steps_max: u32,
    /// Outliers from anywhere, at the far corner of the figure.
    pub random: Row,
    /// Outliers straight away from the source.
    pub worst_case: Vec<Row>,
}

/// A condition.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Rate of outliers.
    pub p: f64,
    /// Standard deviation of the noise.
    pub sigma_deg: f64,
    /// The rate below which the lemma holds: eq. 6, none for lemma 1.
    pub threshold: Option<f64>,
    /// The same with what the worst outlier can really do.
    pub sharp_threshold: Option<f64>,
    /// Radius of the disc: the lemma's, or beyond its threshold that of the sharp bound; `None` beyond both.
    pub radius_m: Option<f64>,
    /// Whether the lemma as printed promises that.
    pub promised: bool,
    /// Walks.
    pub walks: u32,
    /// Those that returned as often as asked.
    pub returning: u32,
    /// The longest time outside, of all walks.
    pub longest_excursion_steps: u32,
    /// Stretch from (50, 50) m: the greedy rule, and ours.
    pub greedy_stretch: Stretch,
    /// See `greedy_stretch`.
    pub filtered_stretch: Stretch,
}

/// The result of a walk.
struct Returns {
    all: bool,
    longest_steps: u32,
}

fn walk(rule: &Rule, model: Model, radius_m: f64, random: Random) -> Returns {
    let mut walk = Walk::new(rule, model, Horizontal::from_xy(NEAR_M), random);
    let (mut inside, mut returned, mut outside_steps, mut longest_steps) = (false, 0, 0, 0);
    while returned < RETURNS {
        let within = walk.step(Horizontal::default()) < radius_m;
        if within {
            returned += u32::from(!inside);
            outside_steps = 0;
        } else {
            outside_steps += 1;
            longest_steps = outside_steps.max(longest_steps);
            if outside_steps > EXCURSION_STEPS_MAX {
                return Returns { all: false, longest_steps };
            }
        }
        inside = within;
    }
    Returns { all: true, longest_steps }
}

fn row(seed: u64, walks: u32, p: f64, sigma_deg: f64, outliers: Outliers) -> Result<Row, InputError> {
    let motion = Motion::new(STEP_M as f32, p as f32, mean_cosine(sigma_deg.to_radians() as f32))?;
    let silent = |silent: Silent| InputError::new(format!("{silent:?}"));
    let any = |bound: Bound| motion.any_outlier_radius_m(bound);
    let (printed, sharp) = match outliers {
        Outliers::Anywhere => (motion.random_outlier_radius_m(), Err(Silent::NoiseTurnsAround)),
        Outliers::Away => (any(Bound::Printed), any(Bound::Sharp)),
    };
    let threshold = |bound: Bound| motion.outlier_threshold(bound).map(f64::from).map_err(silent);
    let [printed_threshold, sharp_threshold] = match outliers {
        Outliers::Anywhere => [None, None],
        Outliers::Away => [Some(threshold(Bound::Printed)?), Some(threshold(Bound::Sharp)?)],
    };
    let radius_m = printed.or(sharp).ok().map(f64::from);
    let model = Model { outlier_rate: p, sigma_rad: sigma_deg.to_radians(), outliers };
    let [greedy, filtered] = Rule::all()?;
    let random = |trial: u32| Random::new(seed, DRAWS + (u64::from(trial) << 8) + ((p * 1e4) as u64) * (1 << 40));
    let all: Vec<_> = (0..walks)
        .into_par_iter()
        .map(|trial| {
            let start = Horizontal::from_xy(START_M);
            let stretch = |rule: &Rule| Walk::new(rule, model, start, random(trial)).stretch(STEPS_MAX);
            // Where no lemma holds the disc is that of no noise and no outliers, and nobody is expected there.
            let returns = walk(&greedy, model, radius_m.unwrap_or(0.5 * STEP_M), random(trial));
            (returns, stretch(&greedy), stretch(&filtered))
        })
        .collect();
    Ok(Row {
        p,
        sigma_deg,
        threshold: printed_threshold,
        sharp_threshold,
        radius_m,
        promised: printed.is_ok(),
        walks,
        returning: all.iter().filter(|(returns, ..)| returns.all).count() as u32,
        longest_excursion_steps: all.iter().map(|(returns, ..)| returns.longest_steps).max().unwrap_or(0),
        greedy_stretch: Stretch::of(all.iter().map(|(_, greedy, _)| *greedy)),
        filtered_stretch: Stretch::of(all.iter().map(|(_, _, filtered)| *filtered)),
    })
}

/// Walks for both lemmas, a sixth as many as there are trials.
pub(super) fn run(seed: u64, trials: u32) -> Result<Report, InputError> {
    let walks = (trials / 6).max(10);
    Ok(Report {
        returns: RETURNS,
        excursion_steps_max: EXCURSION_STEPS_MAX,
        random: row(seed, walks, 0.6, 60.0, Outliers::Anywhere)?,
        // The threshold at 20 degrees is 0.400 as printed, and 0.485 as it is.
        worst_case: [0.2, 0.3, 0.38, 0.44, 0.55]
            .into_iter()
            .map(|p| row(seed, walks, p, 20.0, Outliers::Away))
            .collect::<Result<_, _>>()?,
    })
}

impl Report {
    pub(super) fn table(&self) -> String {
        let mut text = format!(
            "\nReturns to the discs of the lemmas, greedy: until {} returns, or {} steps outside\n\
             {:>6}{:>7}  {:<12}{:>10}{:>9}{:>14}{:>13}{:>20}{:>20}\n",
            self.returns,
            self.excursion_steps_max,
            "p",
            "sigma",
            "outliers",
            "threshold",
            "radius",
            "returning",
            "longest out",
            "greedy stretch",
            "filtered stretch"
        );
        for row in std::iter::once(&self.random).chain(&self.worst_case) {
            let radius = row.radius_m.map_or_else(|| "none".to_owned(), |radius| format!("{radius:.3} m"));
            let threshold = row.threshold.map_or_else(|| "-".to_owned(), |threshold| format!("{threshold:.3}"));
            let stretch = |stretch: &Stretch| match stretch.given_up {
                0 => format!("{:.3} +- {:.3}", stretch.mean, stretch.std),
                count => format!("{count} of {} given up", row.walks),
            };
            let _ = writeln!(
                text,
                "{:>6.2}{:>4.0} deg  {:<12}{threshold:>10}{radius:>9}{:>14}{:>7} steps{:>20}{:>20}{}",
                row.p,
                row.sigma_deg,
                if row.threshold.is_some() { "away" } else { "anywhere" },
                format!("{} of {}", row.returning, row.walks),
                row.longest_excursion_steps,
                stretch(&row.greedy_stretch),
                stretch(&row.filtered_stretch),
                if row.promised { "" } else { "   beyond the lemma" }
            );
        }
        text
    }
}
