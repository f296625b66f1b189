//! The link state's classifier: how it is trained, and how often it is right. What `foxhound link-state` does.
//!
//! Random scenes (half of them yards with one to six walls, half floors of two to four rooms), short legs through them,
//! whole ADC frames of all paths of up to three reflections, the product's own chain, and truth from the rays: the class of
//! the strongest path. Everything is drawn from the seed; scenes of the training and of the examination are never the same.

mod examination;
mod legs;
mod scenes;
mod writing;

pub use examination::{Baseline, Outcome, Report};
pub use legs::NONE_BELOW_DB;
pub use writing::{DOCUMENT_FILE, WEIGHTS_FILE, document, measured, source};

use foxhound_core::ConfigError;
use foxhound_core::localize::link_state::{CLASSES, Classifier, FEATURES, HIDDEN, Weights};
use rayon::prelude::*;

use super::network::{Network, RATE, Recipe, Rows};
use legs::{Chain, Sample};

/// Seed of the weights in the repository.
pub const SEED: u64 = 1;
/// Scenes that the network is trained on.
pub const TRAINING_SCENES: u32 = 5000;
/// Scenes that it is examined with.
pub const EXAMINATION_SCENES: u32 = 500;
/// Passes over the training set.
const EPOCHS: usize = 12;
/// Weight decay.
const DECAY: f64 = 1e-4;
/// Purposes of the random numbers, one a scene.
const TRAINING: u64 = 1 << 32;
const EXAMINATION: u64 = 2 << 32;

/// New weights, and their examination with other scenes.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The weights.
    pub weights: Weights,
    /// Their examination.
    pub report: Report,
}

/// Samples of each of some scenes.
fn draw(seed: u64, purpose: u64, scenes: u32) -> Result<Vec<Vec<Sample>>, ConfigError> {
    let chain = Chain::build()?;
    Ok((0..u64::from(scenes)).into_par_iter().map(|scene| chain.samples(seed, purpose + scene)).collect())
}

/// Examines a classifier with fresh scenes.
///
/// # Errors
/// None in practice: the chain's own configuration.
pub fn examine(classifier: &Classifier, seed: u64, scenes: u32) -> Result<Report, ConfigError> {
    Ok(Report::of(classifier, seed, &draw(seed, EXAMINATION, scenes)?))
}

/// Trains the weights of the repository.
///
/// # Errors
/// None in practice: the chain's own configuration.
pub fn train(seed: u64) -> Result<Trained, ConfigError> {
    let lessons = draw(seed, TRAINING, TRAINING_SCENES)?;
    let exam = draw(seed, EXAMINATION, EXAMINATION_SCENES)?;
    let mut rows = Rows::default();
    for sample in lessons.iter().flatten() {
        for features in [&sample.blind, &sample.mapped] {
            rows.inputs.push(features.map(f64::from).to_vec());
            rows.classes.push(sample.class);
        }
    }
    let recipe = Recipe { hidden: HIDDEN, classes: CLASSES, epochs: EPOCHS, decay: DECAY, rate: RATE };
    let weights = weights_of(&Network::train(&rows, &recipe, seed));
    let report = Report::of(&Classifier::new(weights.clone()), seed, &exam);
    Ok(Trained { weights, report })
}

/// A network in the core's form, the scaling folded into the first layer.
fn weights_of(network: &Network) -> Weights {
    let mut weights = Weights {
        hidden: [[0.0; FEATURES]; HIDDEN],
        hidden_bias: [0.0; HIDDEN],
        output: [[0.0; HIDDEN]; CLASSES],
        output_bias: [0.0; CLASSES],
    };
    let [hidden, output] = network.layers();
    for (h, row) in hidden.enumerate() {
        let mut bias = row[FEATURES];
        for (k, [mean, inverse]) in network.scaling.iter().enumerate() {
            weights.hidden[h][k] = (row[k] * inverse) as f32;
            bias -= row[k] * inverse * mean;
        }
        weights.hidden_bias[h] = bias as f32;
    }
    for (class, row) in output.enumerate() {
        weights.output[class] = std::array::from_fn(|k| row[k] as f32);
        weights.output_bias[class] = row[HIDDEN] as f32;
    }
    weights
}
