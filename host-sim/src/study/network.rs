//! Training of a small network: Adam (Kingma and Ba 2015) on mini-batches, in `f64`, the same numbers from the same seed on
//! every machine.

use crate::world::random::Random;

/// Samples of a step.
const BATCH: usize = 128;
/// Step length from random weights on.
pub(super) const RATE: f64 = 4e-3;

/// How a network is trained.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recipe {
    /// Neurons between the inputs and the classes.
    pub(super) hidden: usize,
    /// How many classes.
    pub(super) classes: usize,
    /// Passes over the rows.
    pub(super) epochs: usize,
    /// Weight decay.
    pub(super) decay: f64,
    /// Step length, at first; it falls to a hundredth.
    pub(super) rate: f64,
}

/// Rows of numbers with their classes.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    pub(super) inputs: Vec<Vec<f64>>,
    pub(super) classes: Vec<usize>,
}

impl Rows {
    /// How much a row of each class counts, so that classes count alike.
    fn class_weights(&self, classes: usize) -> Vec<f64> {
        let mut counts = vec![0.0; classes];
        for class in &self.classes {
            counts[*class] += 1.0;
        }
        let total: f64 = counts.iter().sum();
        counts.iter().map(|count: &f64| total / (classes as f64 * count.max(1.0))).collect()
    }
}

/// A network of any number of inputs; without hidden neurons, a logistic regression.
#[derive(Clone, Debug)]
pub(super) struct Network {
    pub(super) inputs: usize,
    pub(super) hidden: usize,
    classes: usize,
    /// Mean and inverse standard deviation of each input.
    pub(super) scaling: Vec<[f64; 2]>,
    /// All weights: hidden rows (with the bias last), then output rows (the same).
    weights: Vec<f64>,
}

impl Network {
    /// Trains one.
    pub(super) fn train(rows: &Rows, recipe: &Recipe, seed: u64) -> Self {
        let inputs = rows.inputs.first().map_or(0, Vec::len);
        let Recipe { hidden, classes, .. } = *recipe;
        let mut network = Self { inputs, hidden, classes, scaling: scaling(rows, inputs), weights: Vec::new() };
        let mut random = Random::new(seed, 77);
        let width = if hidden == 0 { inputs } else { hidden };
        let mut layer = |rows: usize, columns: usize| {
            let scale = libm::sqrt(2.0 / columns as f64);
            for _ in 0..rows {
                network.weights.extend((0..columns).map(|_| scale * random.gaussian()));
                network.weights.push(0.0);
            }
        };
        layer(hidden, inputs);
        layer(classes, width);
        network.descend(rows, recipe, &mut random);
        network
    }

    /// Trains one on from weights that it has: hidden rows (with the bias last), then output rows.
    pub(super) fn train_on(rows: &Rows, recipe: &Recipe, scaling: Vec<[f64; 2]>, weights: Vec<f64>, seed: u64) -> Self {
        let Recipe { hidden, classes, .. } = *recipe;
        let mut network = Self { inputs: scaling.len(), hidden, classes, scaling, weights };
        network.descend(rows, recipe, &mut Random::new(seed, 77));
        network
    }

    fn descend(&mut self, rows: &Rows, recipe: &Recipe, random: &mut Random) {
        let Recipe { epochs, decay, rate, .. } = *recipe;
        let scaled: Vec<Vec<f64>> = rows.inputs.iter().map(|row| self.scaled(row)).collect();
        let class_weights = rows.class_weights(self.classes);
        let count = self.weights.len();
        let (mut first, mut second, mut gradient) = (vec![0.0; count], vec![0.0; count], vec![0.0; count]);
        let mut order: Vec<usize> = (0..scaled.len()).collect();
        let steps = (epochs * scaled.len().div_ceil(BATCH)) as f64;
        let (mut step, mut decay1, mut decay2) = (0.0, 1.0, 1.0);
        for _ in 0..epochs {
            for last in (1..order.len()).rev() {
                let other = ((random.uniform() * (last + 1) as f64) as usize).min(last);
                order.swap(last, other);
            }
            for batch in order.chunks(BATCH) {
                gradient.iter_mut().zip(&self.weights).for_each(|(g, w)| *g = decay * w);
                for row in batch {
                    let class = rows.classes[*row];
                    self.add_gradient(&scaled[*row], class, class_weights[class] / batch.len() as f64, &mut gradient);
                }
                let rate = rate * libm::pow(0.01, step / steps);
                step += 1.0;
                decay1 *= 0.9;
                decay2 *= 0.999;
                for k in 0..count {
                    first[k] = 0.9 * first[k] + 0.1 * gradient[k];
                    second[k] = 0.999 * second[k] + 0.001 * gradient[k] * gradient[k];
                    let direction = first[k] / (1.0 - decay1);
                    self.weights[k] -= rate * direction / (libm::sqrt(second[k] / (1.0 - decay2)) + 1e-8);
                }
            }
        }
    }

    fn scaled(&self, row: &[f64]) -> Vec<f64> {
        row.iter().zip(&self.scaling).map(|(x, [mean, inverse])| (x - mean) * inverse).collect()
    }

    /// Outputs of the hidden layer, or the inputs.
    fn hidden(&self, scaled: &[f64]) -> Vec<f64> {
        if self.hidden == 0 {
            return scaled.to_vec();
        }
        let rows = self.weights.chunks_exact(self.inputs + 1).take(self.hidden);
        rows.map(|row| affine(row, scaled).max(0.0)).collect()
    }

    /// Where the output layer's weights begin.
    fn split(&self) -> usize {
        self.hidden * (self.inputs + 1)
    }

    /// Rows of the hidden layer, then of the output layer: the weights, and the bias last.
    pub(super) fn layers(&self) -> [impl Iterator<Item = &[f64]>; 2] {
        let (hidden, output) = self.weights.split_at(self.split());
        let width = if self.hidden == 0 { self.inputs } else { self.hidden };
        [hidden.chunks_exact(self.inputs + 1), output.chunks_exact(width + 1)]
    }

    fn softmax(&self, hidden: &[f64]) -> Vec<f64> {
        let [_, rows] = self.layers();
        let scores: Vec<f64> = rows.map(|row| affine(row, hidden)).collect();
        let most = scores.iter().copied().fold(f64::MIN, f64::max);
        let powers: Vec<f64> = scores.iter().map(|score| libm::exp(score - most)).collect();
        let sum: f64 = powers.iter().sum();
        powers.iter().map(|power| power / sum).collect()
    }

    /// Adds the gradient of the weighted cross-entropy of one row.
    fn add_gradient(&self, scaled: &[f64], class: usize, weight: f64, gradient: &mut [f64]) {
        let hidden = self.hidden(scaled);
        let mut errors = self.softmax(&hidden);
        errors[class] -= 1.0;
        let (width, split) = (hidden.len() + 1, self.split());
        let (inner, outer) = gradient.split_at_mut(split);
        let mut back = vec![0.0; hidden.len()];
        for (k, error) in errors.iter().map(|error| weight * error).enumerate() {
            let row = &mut outer[k * width..(k + 1) * width];
            add(row, &hidden, error);
            let weights = &self.weights[split + k * width..];
            back.iter_mut().zip(weights).for_each(|(b, w)| *b += error * w);
        }
        for (h, row) in inner.chunks_exact_mut(self.inputs + 1).enumerate() {
            if hidden[h] > 0.0 {
                add(row, scaled, back[h]);
            }
        }
    }

    /// The most probable class.
    #[cfg(test)]
    pub(super) fn classify(&self, row: &[f64]) -> usize {
        let probabilities = self.softmax(&self.hidden(&self.scaled(row)));
        let mut best = 0;
        for (class, p) in probabilities.iter().enumerate() {
            best = if *p > probabilities[best] { class } else { best };
        }
        best
    }
}

/// Mean and inverse standard deviation of each input.
fn scaling(rows: &Rows, inputs: usize) -> Vec<[f64; 2]> {
    let count = rows.inputs.len().max(1) as f64;
    let column = |k: usize| {
        let mean = rows.inputs.iter().map(|row| row[k]).sum::<f64>() / count;
        let variance = rows.inputs.iter().map(|row| (row[k] - mean) * (row[k] - mean)).sum::<f64>() / count;
        [mean, 1.0 / libm::sqrt(variance + 1e-9)]
    };
    (0..inputs).map(column).collect()
}

/// A row of weights, the bias last, on some values.
fn affine(row: &[f64], values: &[f64]) -> f64 {
    row.iter().zip(values).map(|(w, x)| w * x).sum::<f64>() + row[values.len()]
}

/// Adds `factor * [values, 1]`.
fn add(row: &mut [f64], values: &[f64], factor: f64) {
    row.iter_mut().zip(values).for_each(|(g, x)| *g += factor * x);
    row[values.len()] += factor;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four noisy clouds at the corners of a square, class by the product of signs: no plane parts them.
    fn crossed(seed: u64) -> Rows {
        let mut random = Random::new(seed, 1);
        let mut rows = Rows::default();
        for k in 0..800 {
            let (a, b) = (f64::from(k % 2) * 2.0 - 1.0, f64::from(k / 2 % 2) * 2.0 - 1.0);
            rows.inputs.push(vec![5.0 + a + 0.3 * random.gaussian(), b + 0.3 * random.gaussian()]);
            rows.classes.push(usize::from(a * b > 0.0));
        }
        rows
    }

    fn rate(network: &Network, rows: &Rows) -> f64 {
        let right = rows.inputs.iter().zip(&rows.classes).filter(|(row, class)| network.classify(row) == **class);
        right.count() as f64 / rows.classes.len() as f64
    }

    fn train(seed: u64, hidden: usize, epochs: usize, start: u64) -> Network {
        Network::train(&crossed(seed), &Recipe { hidden, classes: 2, epochs, decay: 1e-4, rate: RATE }, start)
    }

    #[test]
    fn hidden_neurons_learn_what_no_plane_parts_and_the_same_again_with_the_same_seed() {
        let network = train(1, 8, 300, 3);
        assert!(rate(&network, &crossed(2)) > 0.97);
        assert!(rate(&train(1, 0, 300, 3), &crossed(2)) < 0.75);
        assert_eq!(train(1, 8, 300, 3).weights, network.weights);
        assert_ne!(train(1, 8, 300, 4).weights, network.weights);
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences() {
        let rows = crossed(3);
        let mut network = train(3, 5, 1, 3);
        let loss = |network: &Network, k: usize| {
            let scaled = network.scaled(&rows.inputs[k]);
            -libm::log(network.softmax(&network.hidden(&scaled))[rows.classes[k]])
        };
        for k in 0..20 {
            let mut gradient = vec![0.0; network.weights.len()];
            network.add_gradient(&network.scaled(&rows.inputs[k]), rows.classes[k], 1.0, &mut gradient);
            for (w, slope) in gradient.iter().enumerate() {
                let kept = network.weights[w];
                network.weights[w] = kept + 1e-6;
                let above = loss(&network, k);
                network.weights[w] = kept - 1e-6;
                let below = loss(&network, k);
                network.weights[w] = kept;
                assert!(((above - below) / 2e-6 - slope).abs() < 1e-6, "row {k}, weight {w}");
            }
        }
    }
}
