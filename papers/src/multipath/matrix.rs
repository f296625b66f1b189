//! Vectors and symmetric matrices of four.

pub(super) type Vector = [f32; 4];

/// The larger of two numbers, the first when the second is none: `f32::max` takes four times as long.
pub(super) fn at_least(least: f32, x: f32) -> f32 {
    if x > least { x } else { least }
}

pub(super) fn dot(a: &Vector, b: &Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// The inner product's part from cosines and its part from sines.
pub(super) fn halves(a: &Vector, b: &Vector) -> [f32; 2] {
    [a[0] * b[0] + a[1] * b[1], a[2] * b[2] + a[3] * b[3]]
}

/// `a + factor b`.
pub(super) fn plus(a: &Vector, factor: f32, b: &Vector) -> Vector {
    [a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2], a[3] + factor * b[3]]
}

pub(super) fn scaled(a: &Vector, factor: f32) -> Vector {
    a.map(|x| x * factor)
}

/// The steering vector of the opposite direction.
pub(super) fn reversed(d: &Vector) -> Vector {
    [d[0], d[1], -d[2], -d[3]]
}

/// A symmetric 4 x 4 matrix.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Symmetric(pub(super) [Vector; 4]);

impl Symmetric {
    /// Adds `weight (v v' + w w')`.
    pub(super) fn add(&mut self, weight: f32, [v, w]: [&Vector; 2]) {
        for ((row, x), y) in self.0.iter_mut().zip(v).zip(w) {
            *row = plus(&plus(row, weight * x, v), weight * y, w);
        }
    }

    pub(super) fn times(&self, v: &Vector) -> Vector {
        let [a, b, c, d] = &self.0;
        [dot(a, v), dot(b, v), dot(c, v), dot(d, v)]
    }

    /// The products with the first and with the second half of a vector, the other half zero.
    pub(super) fn times_halves(&self, v: &Vector) -> [Vector; 2] {
        let [a, b, c, d] = self.0.map(|row| halves(&row, v));
        [[a[0], b[0], c[0], d[0]], [a[1], b[1], c[1], d[1]]]
    }

    pub(super) fn trace(&self) -> f32 {
        self.0[0][0] + self.0[1][1] + self.0[2][2] + self.0[3][3]
    }

    /// The inverse of a positive definite matrix, by Gauss-Jordan on the diagonal; a pivot that is too small is raised.
    pub(super) fn inverse(&self) -> Self {
        let mut a = self.0;
        for k in 0..4 {
            let least = 1e-6 * self.0[k][k] + 1e-12;
            let pivot = 1.0 / if a[k][k] > least { a[k][k] } else { least };
            let row = a[k];
            for (_, other) in a.iter_mut().enumerate().filter(|(i, _)| *i != k) {
                let factor = other[k] * pivot;
                *other = plus(other, -factor, &row);
                other[k] = -factor;
            }
            a[k] = scaled(&row, pivot);
            a[k][k] = pivot;
        }
        Self(a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foxhound_core::base::rng::Rng;

    #[test]
    fn the_inverse_undoes_the_matrix() {
        let mut rng = Rng::new(8, 1);
        for _ in 0..500 {
            let mut matrix = Symmetric::default();
            for _ in 0..2 {
                let [v, w] = [[0; 4].map(|_| rng.gaussian()), [0; 4].map(|_| rng.gaussian())];
                matrix.add(1.0, [&v, &w]);
            }
            let mut plus_one = matrix;
            for i in 0..4 {
                plus_one.0[i][i] += 1.0;
            }
            // (M + 1)^-1 v summed with M (M + 1)^-1 v is v again.
            let v = [1.0, 2.0, -1.0, 0.5];
            let solved = plus_one.inverse().times(&v);
            for (a, b) in plus(&matrix.times(&solved), 1.0, &solved).iter().zip(v) {
                assert!((a - b).abs() < 1e-4, "{a} {b}");
            }
        }
    }
}
