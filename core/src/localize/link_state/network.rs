//! The network: one hidden layer of rectifiers, then a softmax. The standardisation of the features is in the first
//! layer's weights.

use super::features::FEATURES;
use crate::base::units::between;

/// Classes, in the order of [`super::LinkState::ALL`].
pub const CLASSES: usize = 4;
/// Neurons of the hidden layer.
pub const HIDDEN: usize = 12;
/// Upper limit of a score.
const SCORE_MAX: f32 = 1e6;

/// The trained parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Weights of each hidden neuron, one per feature.
    pub hidden: [[f32; FEATURES]; HIDDEN],
    /// Bias.
    pub hidden_bias: [f32; HIDDEN],
    /// Weights of each class, one per hidden neuron.
    pub output: [[f32; HIDDEN]; CLASSES],
    /// Bias.
    pub output_bias: [f32; CLASSES],
}

impl Weights {
    /// Probability of each class; equal if the scores are not finite.
    pub(super) fn probabilities(&self, features: &[f32; FEATURES]) -> [f32; CLASSES] {
        let mut hidden = [0.0; HIDDEN];
        for ((out, row), bias) in hidden.iter_mut().zip(&self.hidden).zip(self.hidden_bias) {
            let sum = dot(row, features) + bias;
            *out = if sum > 0.0 { sum } else { 0.0 };
        }
        let mut scores = [0.0; CLASSES];
        let mut most = -SCORE_MAX;
        for ((out, row), bias) in scores.iter_mut().zip(&self.output).zip(self.output_bias) {
            *out = between(dot(row, &hidden) + bias, -SCORE_MAX, SCORE_MAX);
            most = if *out > most { *out } else { most };
        }
        let mut sum = 0.0;
        for score in &mut scores {
            *score = libm::expf(*score - most);
            sum += *score;
        }
        // The largest is exp(0) = 1, so this fails only for NaN.
        if !(sum >= 1.0) {
            return [1.0 / CLASSES as f32; CLASSES];
        }
        scores.map(|score| score / sum)
    }
}

fn dot<const N: usize>(a: &[f32; N], b: &[f32; N]) -> f32 {
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        sum += a * b;
    }
    sum
}
