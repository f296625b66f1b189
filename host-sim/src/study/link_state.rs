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
use foxhound_core::localize::link_state::weights::WEIGHTS;
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

/// Balanced accuracy of a network that sees less, or more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ablation {
    /// What it sees.
    pub name: &'static str,
    /// Balanced accuracy without a map.
    pub without_map: f64,
    /// With one.
    pub with_map: f64,
}

/// Groups of features, by name and place in `foxhound_core::localize::link_state::NAMES`.
const GROUPS: [(&str, &[usize]); 7] = [
    ("without the level", &[0]),
    ("without its slope", &[1]),
    ("without fading", &[2]),
    ("without closure, coherence, wavenumber, flags", &[3, 4, 5, 6]),
    ("without the share of silent looks", &[7]),
    ("without jitter, misfit, inverse range", &[8, 9, 10, 11]),
    ("without the wall ahead", &[12, 13, 14]),
];
/// All features but the first.
const ALL_BUT_LEVEL: &[usize] = &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14];

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

/// What a network is given of a sample.
fn inputs(sample: &Sample, mapped: bool, keep: &dyn Fn(usize) -> bool, music: bool) -> Vec<f64> {
    let features = if mapped { &sample.mapped } else { &sample.blind };
    let own = features.iter().enumerate().filter(|(k, _)| keep(*k)).map(|(_, x)| f64::from(*x));
    let more = sample.music.iter().filter(|_| music).map(|x| f64::from(*x));
    own.chain(more).collect()
}

/// A kind of network that is compared.
struct Contender {
    name: &'static str,
    without: &'static [usize],
    music: bool,
    hidden: usize,
}

impl Contender {
    fn inputs(&self, sample: &Sample, mapped: bool) -> Vec<f64> {
        inputs(sample, mapped, &|k| !self.without.contains(&k), self.music)
    }

    fn train(&self, scenes: &[Vec<Sample>], seed: u64) -> Network {
        let mut rows = Rows::default();
        for sample in scenes.iter().flatten() {
            for mapped in [false, true] {
                rows.inputs.push(self.inputs(sample, mapped));
                rows.classes.push(sample.class);
            }
        }
        let recipe = Recipe { hidden: self.hidden, classes: CLASSES, epochs: EPOCHS, decay: DECAY, rate: RATE };
        Network::train(&rows, &recipe, seed)
    }

    fn examine(&self, network: &Network, scenes: &[Vec<Sample>]) -> Ablation {
        let balanced = |mapped: bool| {
            let pairs = scenes.iter().flatten();
            let pairs = pairs.map(|sample| (sample.class, network.classify(&self.inputs(sample, mapped))));
            examination::balanced_accuracy(&examination::confusion(pairs))
        };
        Ablation { name: self.name, without_map: balanced(false), with_map: balanced(true) }
    }
}

/// All features, and as many neurons as the core has.
const ALL: Contender = Contender { name: "all of them", without: &[], music: false, hidden: HIDDEN };

/// Trains the weights of the repository, and others beside them where the features are compared.
///
/// # Errors
/// None in practice: the chain's own configuration.
pub fn train(seed: u64, ablate: bool) -> Result<(Trained, Vec<Ablation>), ConfigError> {
    let lessons = draw(seed, TRAINING, TRAINING_SCENES)?;
    let exam = draw(seed, EXAMINATION, EXAMINATION_SCENES)?;
    let mut contenders = vec![ALL];
    if ablate {
        contenders.extend(GROUPS.map(|(name, without)| Contender { name, without, ..ALL }));
        contenders.push(Contender { name: "the level alone", without: ALL_BUT_LEVEL, ..ALL });
        contenders.push(Contender { name: "all, without a hidden layer", hidden: 0, ..ALL });
        contenders.push(Contender { name: "all, with 24 hidden neurons", hidden: 24, ..ALL });
        contenders.push(Contender { name: "all, and the two-path fit of eight looks", music: true, ..ALL });
    }
    let networks: Vec<Network> = contenders.par_iter().map(|contender| contender.train(&lessons, seed)).collect();
    let ablations = contenders.par_iter().zip(&networks).map(|(c, network)| c.examine(network, &exam)).collect();
    let weights = networks.first().and_then(weights_of).unwrap_or(WEIGHTS);
    let report = Report::of(&Classifier::new(weights.clone()), seed, &exam);
    Ok((Trained { weights, report }, ablations))
}

/// A network in the core's form, the scaling folded into the first layer; `None` when the shape is another.
fn weights_of(network: &Network) -> Option<Weights> {
    if network.inputs != FEATURES || network.hidden != HIDDEN {
        return None;
    }
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
    Some(weights)
}
