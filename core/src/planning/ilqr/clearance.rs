//! Distance to the obstacles less the uncertainty of the position (paper, eq. 14), and its derivatives. The code calls
//! the left side of an inequality its room (slack).
//!
//! `|p - c| - r_rob - r_obs - n_std * deviation(P) >= 0`, for every obstacle at every step. The paper prints
//! `max(eig(P))`, a variance, and calls it a standard deviation; here it is the root of that.
//!
//! The larger eigenvalue of `[[a, b], [b, c]]` is `m + r` with `m = (a + c)/2`, `r = sqrt(((a - c)/2)^2 + b^2)`; its
//! derivative is the outer product of its eigenvector, `1/2 + (a - c)/4r` by `a` and `b/r` by `b`. Where the two
//! eigenvalues are equal it has no derivative: `r` is kept above a small number.

use crate::base::math::sqrt;
use crate::base::obstacle::Obstacle;

/// Number of obstacles considered around each step; the distance of the next nearest one limits how far a step may move
/// before all are searched again.
pub(super) const NEAREST: usize = 3;

/// The largest standard deviation of the position block `[nn, ne, ee]`, and its derivative by the three.
#[inline]
pub(super) fn deviation([a, b, c]: [f32; 3]) -> (f32, [f32; 3]) {
    let mean = 0.5 * (a + c);
    let half = 0.5 * (a - c);
    let root = sqrt(half * half + b * b + 1e-12);
    let (by_a, by_b) = (0.5 * half / root, b / root);
    let eigenvalue = mean + root;
    let deviation = sqrt(if eigenvalue > 1e-12 { eigenvalue } else { 1e-12 });
    (deviation, [0.5 + by_a, by_b, 0.5 - by_a].map(|by| 0.5 * by / deviation))
}

/// The obstacles around a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    /// Indices of the nearest ones; an index without an obstacle marks an empty entry.
    which: [u16; NEAREST],
    /// Their reaches, enlarged for half a step: between two steps the path can come nearer than at either.
    reaches_m: [f32; NEAREST],
    /// The position for which they were searched.
    around: [f32; 2],
    /// How far the step may move from there; beyond that, another obstacle may be nearer than these.
    valid_m: f32,
}

impl Near {
    pub(super) const NONE: Self =
        Self { which: [0; NEAREST], reaches_m: [0.0; NEAREST], around: [0.0; 2], valid_m: 0.0 };

    /// Searches the nearest obstacles. A step may always move by `least_m`, even if more obstacles are near;
    /// `half_step_m2` is the square of half the longest step. `known`, found at a position nearby, limits the search
    /// distance.
    pub(super) fn look(
        obstacles: &[Obstacle],
        place: [f32; 2],
        half_step_m2: f32,
        least_m: f32,
        known: Option<&Self>,
    ) -> Self {
        // At most the distance of the next nearest obstacle before, plus the distance moved since.
        let far_m = known.filter(|known| known.is_known()).map_or(1e9, |known| {
            let away = [place[0] - known.around[0], place[1] - known.around[1]];
            2.0 * known.valid_m + sqrt(away[0] * away[0] + away[1] * away[1]) + 1e-3
        });
        let mut rooms_m = [far_m; NEAREST];
        let mut next_m = far_m;
        let mut which = [u16::MAX; NEAREST];
        for (obstacle, index) in obstacles.iter().zip(0..u16::MAX) {
            let [north, east] = [place[0] - obstacle.center_ned_m.north, place[1] - obstacle.center_ned_m.east];
            let distance2 = north * north + east * east;
            // Obstacles farther than the last one need no root.
            let reach_m = next_m + obstacle.reach_m;
            if distance2 >= reach_m * reach_m {
                continue;
            }
            let mut entry = (sqrt(distance2) - obstacle.reach_m, index);
            for (room_m, which) in rooms_m.iter_mut().zip(which.iter_mut()) {
                if entry.0 < *room_m {
                    core::mem::swap(room_m, &mut entry.0);
                    core::mem::swap(which, &mut entry.1);
                }
            }
            if entry.0 < next_m {
                next_m = entry.0;
            }
        }
        let reaches_m = which.map(|index| {
            let reach_m = obstacles.get(usize::from(index)).map_or(0.0, |obstacle| obstacle.reach_m);
            sqrt(reach_m * reach_m + half_step_m2)
        });
        let valid_m = 0.5 * next_m;
        Self { which, reaches_m, around: place, valid_m: if valid_m > least_m { valid_m } else { least_m } }
    }

    /// Whether they have been searched.
    pub(super) fn is_known(&self) -> bool {
        self.valid_m > 0.0
    }

    /// Whether the list is valid for a step at this position; `times` scales the distance that it may move.
    #[inline]
    pub(super) fn holds(&self, place: [f32; 2], times: f32) -> bool {
        let away = [place[0] - self.around[0], place[1] - self.around[1]];
        let valid_m = times * self.valid_m;
        away[0] * away[0] + away[1] * away[1] < valid_m * valid_m
    }

    /// The entry here of an obstacle in another list.
    pub(super) fn find(&self, others: &Self, number: usize) -> Option<usize> {
        let wanted = others.which.get(number)?;
        self.which.iter().position(|which| which == wanted)
    }

    /// Distance to the reach of one of them, and the direction away from it.
    #[inline]
    pub(super) fn room(&self, number: usize, obstacles: &[Obstacle], place: [f32; 2]) -> Option<(f32, [f32; 2])> {
        let obstacle = obstacles.get(usize::from(*self.which.get(number)?))?;
        let away = [place[0] - obstacle.center_ned_m.north, place[1] - obstacle.center_ned_m.east];
        let distance = sqrt(away[0] * away[0] + away[1] * away[1]);
        let scale = 1.0 / (distance + 1e-6);
        Some((distance - self.reaches_m.get(number)?, [away[0] * scale, away[1] * scale]))
    }
}
