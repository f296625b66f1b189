//! The fit of one or two paths: Gauss-Newton on what is left over, the amplitudes projected out.

use super::matrix::{at_least, dot, plus};
use super::model::{Linear, Paths, Solver};

/// Gauss-Newton steps of the two-path fit.
const STEPS: u8 = 4;
/// A shorter step ends the fit: the last step is another, and the error left goes with the square.
const CLOSE_RAD: f32 = 0.01;

/// Normal equations, and the power explained.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Normal {
    pub(super) h: [f32; 3],
    pub(super) b: [f32; 2],
    pub(super) explained: f32,
}

impl Normal {
    /// The Gauss-Newton step.
    fn step(&self, damping: f32) -> [f32; 2] {
        let [aa, ab, cc] = self.h;
        let (aa, cc) = (aa * (1.0 + damping) + 1e-3, cc * (1.0 + damping) + 1e-3);
        let determinant = at_least(1e-6, aa * cc - ab * ab);
        let [a, b] = self.b;
        [(cc * a - ab * b) / determinant, (aa * b - ab * a) / determinant]
    }

    /// What an undamped step explains more, if the model were linear.
    pub(super) fn gain(&self) -> f32 {
        let step = self.step(0.0);
        step[0] * self.b[0] + step[1] * self.b[1]
    }
}

impl Solver<'_> {
    /// The normal equations of every `stride`th heading.
    pub(super) fn normal(&self, paths: Paths, stride: usize) -> Normal {
        let mut sum = Normal::default();
        let azimuths = paths.azimuths();
        for heading in self.some_headings(stride) {
            let Linear { row, tangent, first, cosine, rest } = self.linear(heading, paths, azimuths);
            let seen = row.map(|row| heading.covariance.times(&row));
            let (aa, ab, cc) = (dot(&row[0], &seen[0]), dot(&row[0], &seen[1]), dot(&row[1], &seen[1]));
            sum.h[0] += dot(&tangent[0], &tangent[0]) * aa;
            sum.h[1] += dot(&tangent[0], &tangent[1]) * ab;
            sum.h[2] += dot(&tangent[1], &tangent[1]) * cc;
            sum.b[0] += dot(&tangent[0], &seen[0]);
            sum.b[1] += dot(&tangent[1], &seen[1]);
            sum.explained += dot(&first, &plus(&seen[0], cosine, &seen[1])) + rest * cc;
        }
        sum
    }

    /// Damped Gauss-Newton steps (Levenberg 1944); a step that explains less is taken back and shortened. With what the
    /// result leaves over per look.
    pub(super) fn fit(&self, start: Paths) -> (Paths, f32) {
        let (mut best, mut normal) = (start, self.normal(start, self.stride));
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let step = normal.step(damping);
            let trial = best.moved(step);
            let there = self.normal(trial, self.stride);
            if there.explained > normal.explained {
                (best, normal) = (trial, there);
                damping *= 0.1;
                if step[0] * step[0] + step[1] * step[1] < CLOSE_RAD * CLOSE_RAD {
                    break;
                }
            } else {
                damping = at_least(0.03, 30.0 * damping);
            }
        }
        (best, self.left_over(normal.explained, self.stride))
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenes::with_solver;
    use super::*;
    use foxhound_core::base::rng::Rng;

    #[test]
    fn the_normal_equations_are_the_slope_of_the_explained_power() {
        let step = 2e-3;
        with_solver(60.0, 0.9, |solver| {
            for (a, b) in [(0.3, 2.0), (-1.0, 0.4), (2.5, -2.5)] {
                for paths in [Paths::Two([a, b], 0.9), Paths::One([a, 0.8])] {
                    let normal = solver.normal(paths, 1);
                    for (i, moves) in [(0, [step, 0.0]), (1, [0.0, step])] {
                        let explained = |sign: f32| solver.normal(paths.moved(moves.map(|m| sign * m)), 1).explained;
                        // The slope of |P y|^2 is twice Kaufman's right-hand side.
                        let slope = (explained(1.0) - explained(-1.0)) / (4.0 * step);
                        let scale = 1e-3 * normal.explained;
                        assert!((slope - normal.b[i]).abs() < scale, "{paths:?} {i}: {slope} {}", normal.b[i]);
                    }
                }
            }
        });
    }

    #[test]
    fn two_paths_explain_no_more_than_there_is_and_no_less_than_one_however_close_they_are() {
        let mut rng = Rng::new(6, 2);
        with_solver(60.0, 1.0, |solver| {
            let total: f32 = solver.headings.iter().map(|heading| heading.covariance.trace()).sum();
            for run in 0..2000 {
                // From the whole circle down to a thousandth of a degree, and exactly the same.
                let apart = if run % 10 == 0 { 0.0 } else { libm::powf(10.0, 0.5 - 5.3 * rng.uniform()) };
                let azimuth = core::f32::consts::TAU * rng.uniform();
                let two = solver.normal(Paths::Two([azimuth, azimuth + apart], 1.0), 1).explained;
                let one = solver.normal(Paths::One([azimuth, 1.0]), 1).explained;
                assert!(two <= 1.0001 * total && two >= 0.9999 * one, "{apart}: {one} {two} of {total}");
            }
        });
    }
}
