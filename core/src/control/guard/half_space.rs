//! Half-spaces of velocities, and the velocity nearest to the wanted one that all of them allow.

use heapless::Vec;

use crate::base::ned::Horizontal;

/// A half-space counts as kept when it is violated by no more than this.
const AGREED_MPS: f32 = 1e-4;
/// The largest number of half-spaces that may determine the answer.
const DECISIVE_MAX: usize = 12;
/// The largest number of obstacles that bound the velocity: in gusts all within the gust margin do, whatever the speed.
const GUSTY_MAX: usize = super::OBSTACLES_MAX;
/// Halvings of the shortfall when gusts need more space than there is.
const EVENED_MAX: u8 = 4;

/// A half-plane of velocities: `outwards . v >= least`.
#[derive(Clone, Copy, Debug)]
pub(super) struct HalfSpace {
    pub(super) outwards: Horizontal,
    pub(super) least_mps: f32,
    /// The smallest value of `least` that keeps the distance.
    pub(super) oncoming_mps: f32,
}

/// Half-spaces of all obstacles and of the fence.
pub(super) type HalfSpaces = Vec<HalfSpace, { GUSTY_MAX + 1 }>;

/// When gusts need more space than there is: the same shortfall for all standing obstacles, so that the vehicle keeps
/// to the middle.
pub(super) fn evened_out(wanted: Horizontal, half_spaces: &mut HalfSpaces) -> Option<Horizontal> {
    // With the largest of them, no distance is required any more.
    let most_mps = half_spaces
        .iter()
        .fold(0.0, |most, half_space| if half_space.least_mps > most { half_space.least_mps } else { most });
    let (mut least_mps, mut most_mps, mut lowered_mps) = (0.0, most_mps, 0.0);
    let mut lower = |half_spaces: &mut HalfSpaces, by_mps: f32| {
        for half_space in half_spaces {
            if half_space.oncoming_mps == 0.0 {
                half_space.least_mps -= by_mps - lowered_mps;
            }
        }
        lowered_mps = by_mps;
    };
    let mut best = None;
    for _ in 0..EVENED_MAX {
        let by_mps = 0.5 * (least_mps + most_mps);
        lower(half_spaces, by_mps);
        match nearest_allowed(wanted, half_spaces) {
            Some(velocity) => (best, most_mps) = (Some(velocity), by_mps),
            None => least_mps = by_mps,
        }
    }
    lower(half_spaces, 0.0);
    best
}

/// The velocity nearest to the wanted one that all half-spaces allow; `None` if no velocity is.
///
/// Adds, one by one, the half-space that the current answer violates most: the new answer lies on its edge, within
/// the part of that line that the earlier ones allow (the incremental linear programme of de Berg et al.,
/// Computational Geometry, section 4.3, with a distance for its objective). Exact; mostly two or three half-spaces
/// determine the answer, and if it needs more than [`DECISIVE_MAX`] the answer is `None`.
pub(super) fn nearest_allowed(wanted: Horizontal, half_spaces: &[HalfSpace]) -> Option<Horizontal> {
    let mut velocity = wanted;
    let mut decisive: Vec<HalfSpace, DECISIVE_MAX> = Vec::new();
    loop {
        let (mut most_broken, mut most_mps) = (None, AGREED_MPS);
        for half_space in half_spaces {
            let lacking_mps = half_space.least_mps - half_space.outwards.dot(velocity);
            if lacking_mps > most_mps {
                (most_broken, most_mps) = (Some(half_space), lacking_mps);
            }
        }
        let Some(edge) = most_broken else { return Some(velocity) };
        let foot = edge.outwards.times(edge.least_mps);
        let along = Horizontal { north: -edge.outwards.east, east: edge.outwards.north };
        let (mut from, mut to) = (f32::NEG_INFINITY, f32::INFINITY);
        for earlier in &decisive {
            let (slope, lacking) = (earlier.outwards.dot(along), earlier.least_mps - earlier.outwards.dot(foot));
            if libm::fabsf(slope) < 1e-5 {
                if lacking > AGREED_MPS {
                    return None;
                }
                continue;
            }
            let bound = lacking / slope;
            if slope > 0.0 && bound > from {
                from = bound;
            } else if slope < 0.0 && bound < to {
                to = bound;
            }
        }
        if from > to + AGREED_MPS {
            return None;
        }
        let at = wanted.dot(along);
        let at = if at < from { from } else { at };
        velocity = foot.plus(along.times(if at > to { to } else { at }));
        decisive.push(*edge).ok()?;
    }
}
