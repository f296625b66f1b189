//! Bartlett's spectrum: the power in the direction of each steering vector of a grid.

use super::matrix::{Vector, halves, reversed};
use super::model::{HEADINGS, Solver};

/// Directions around the circle at which the scans look; opposite ones share their sines.
pub(super) const GRID: usize = 16;
pub(super) const HALF: usize = GRID / 2;
pub(super) const GRID_STEP_RAD: f32 = core::f32::consts::TAU / GRID as f32;

/// Sines and cosines of half the circle.
const DIRECTIONS: [(f32, f32); HALF] = {
    const EIGHTH: f32 = core::f32::consts::FRAC_1_SQRT_2;
    const SIXTEENTH: (f32, f32) = (0.382_683_43, 0.923_879_5);
    let (s, c) = SIXTEENTH;
    [(0.0, 1.0), (s, c), (EIGHTH, EIGHTH), (c, s), (1.0, 0.0), (c, -s), (EIGHTH, -EIGHTH), (s, -c)]
};

/// What one heading sees in one direction of the grid and in the opposite one, whose sines have the other sign.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// The steering vector.
    pub(super) d: Vector,
    /// The covariance times its cosines, and times its sines.
    pub(super) seen: [Vector; 2],
    /// Bartlett power in the direction and in the opposite one.
    pub(super) power: [f32; 2],
}

/// Half of the circle, from each heading that takes part.
pub(super) struct Scan([[View; HEADINGS]; HALF]);

impl Scan {
    pub(super) const EMPTY: Self = Self([[View { d: [0.0; 4], seen: [[0.0; 4]; 2], power: [0.0; 2] }; HEADINGS]; HALF]);

    /// The views in a direction of half the circle.
    pub(super) fn at(&self, i: usize) -> &[View; HEADINGS] {
        &self.0[i % HALF]
    }

    /// The steering vector of a direction, seen from the first heading.
    pub(super) fn steering(&self, i: usize) -> Vector {
        let d = &self.at(i)[0].d;
        if i < HALF { *d } else { reversed(d) }
    }
}

impl Solver<'_> {
    /// Looks around. Into a place that is there: returned, it would be copied.
    pub(super) fn scan(&self, scan: &mut Scan) {
        for (views, azimuth) in scan.0.iter_mut().zip(DIRECTIONS) {
            for (heading, view) in self.some_headings(self.stride).zip(views) {
                view.d = self.vector(Self::direction(heading, azimuth), self.wavenumber);
                view.seen = heading.covariance.times_halves(&view.d);
                let ([even, cross], [crossed, odd]) = (halves(&view.d, &view.seen[0]), halves(&view.d, &view.seen[1]));
                view.power = [even + odd + (cross + crossed), even + odd - (cross + crossed)];
            }
        }
    }
}
