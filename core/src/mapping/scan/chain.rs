//! Surfaces that are not pillars, of any shape, are covered by a chain of small circles.
//!
//! A link of the chain spans a chord of the surface. Its circle's radius is the length of the chord, and it touches
//! both ends. So between them it bulges out by 0.13 chords at most: 2 cm for the longest chord used, more only where
//! the hits themselves are farther apart. Neighbouring links share an end, so that the chain has no gap. Towards an
//! edge past which the sensor sees, links become shorter, so that the chain sticks out beyond the edge by about 2 cm at
//! most.

use crate::base::ned::Horizontal;

use super::circle::{cross, root};
use super::unit;

/// Longest chord where hits are dense.
const CHORD_MAX_M: f32 = 0.16;
/// Longest chord at an edge.
const CHORD_EDGE_M: f32 = 0.06;
/// Growth of the chord with the distance from an edge.
const GROWTH: f32 = 0.5;
/// Largest distance by which a hit between the ends of a link may stick out of its circle.
const DIP_M: f32 = 0.01;

/// One link: a circle, the points it spans (`from..to`) and the middle of its chord. Relative to the sensor, like the
/// points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Link {
    pub(super) center: Horizontal,
    pub(super) radius_m: f32,
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) face: Horizontal,
}

/// Which ends of a piece of surface are edges past which the sensor sees.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edges {
    pub(super) first: bool,
    pub(super) last: bool,
}

/// The link over `points` (in order) that begins with the point at `from`, with a radius of at least `radius_min_m`;
/// `None` if that point is the end of the last link. The next link begins with this link's last point.
pub(super) fn next(points: &[Horizontal], edges: Edges, radius_min_m: f32, from: usize) -> Option<Link> {
    let (begin, end, start) = (*points.first()?, *points.last()?, *points.get(from)?);
    let to_edge = |is_edge: bool, edge: Horizontal| {
        if is_edge { root(start.minus(edge).norm_squared()) } else { f32::INFINITY }
    };
    let (behind, ahead) = (to_edge(edges.first, begin), to_edge(edges.last, end) - CHORD_EDGE_M);
    let nearer = if behind < ahead { behind } else { ahead };
    let chord_max_m = (CHORD_EDGE_M + GROWTH * nearer).clamp(CHORD_EDGE_M, CHORD_MAX_M);
    // At least one step, then as many as the chord allows.
    let mut last = from;
    while let Some(next) = points.get(last + 1) {
        if last > from && next.minus(start).norm_squared() > chord_max_m * chord_max_m {
            break;
        }
        last += 1;
    }
    if last == from && from > 0 {
        return None;
    }
    span(points.get(from..=last)?, from, radius_min_m)
}

/// The link over a part of the points that begins with number `from`.
fn span(part: &[Horizontal], from: usize, radius_min_m: f32) -> Option<Link> {
    let (a, b) = (*part.first()?, *part.last()?);
    let (chord, face) = (b.minus(a), a.plus(b).times(0.5));
    let chord_m = root(chord.norm_squared());
    // Away from the sensor, perpendicular to the chord if it is long enough.
    let behind = if chord_m > 0.02 {
        let side = if cross(chord, face) < 0.0 { -1.0 } else { 1.0 };
        Horizontal { north: -chord.east, east: chord.north }.times(side / chord_m)
    } else {
        unit(face)
    };
    let mut radius_m = if chord_m > radius_min_m { chord_m } else { radius_min_m };
    let half = 0.5 * chord_m;
    let center = face.plus(behind.times(root(radius_m * radius_m - half * half)));
    for point in part {
        let squared = point.minus(center).norm_squared();
        if squared > (radius_m + DIP_M) * (radius_m + DIP_M) {
            radius_m = root(squared) - DIP_M;
        }
    }
    Some(Link { center, radius_m, from, to: from + part.len(), face })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use std::vec::Vec;

    fn links(points: &[Horizontal], edges: Edges) -> Vec<Link> {
        let mut links = Vec::new();
        let mut from = 0;
        while let Some(link) = next(points, edges, 0.05, from) {
            links.push(link);
            from = link.to - 1;
            if link.to == points.len() {
                break;
            }
        }
        links
    }

    const BOTH: Edges = Edges { first: true, last: true };

    /// A wall across the nose at `north`, from -`half` to `half`, a point every `step`, with noise along the ray.
    fn wall(north: f32, half: f32, step: f32, noise: f32, rng: &mut Rng) -> Vec<Horizontal> {
        let n = (2.0 * half / step) as usize;
        (0..=n)
            .map(|k| {
                let point = Horizontal { north, east: -half + step * k as f32 };
                point.plus(unit(point).times(noise * rng.gaussian()))
            })
            .collect()
    }

    #[test]
    fn a_wall_is_covered_without_a_gap_and_bulges_by_two_centimetres_at_most() {
        let mut rng = Rng::new(1, 0);
        let links = links(&wall(1.5, 1.2, 0.03, 0.0, &mut rng), BOTH);
        assert!(links.len() < 25, "{}", links.len());
        for k in -1200..=1200 {
            let point = Horizontal { north: 1.5, east: k as f32 * 1e-3 };
            let depth = links.iter().map(|l| point.minus(l.center).norm() - l.radius_m).fold(f32::INFINITY, f32::min);
            assert!(depth < 1e-4, "open at {point:?}: {depth}");
        }
        let front = links.iter().map(|l| l.center.north - l.radius_m).fold(f32::INFINITY, f32::min);
        assert!(front > 1.5 - 0.022, "{front}");
    }

    #[test]
    fn it_does_not_stick_out_beyond_an_edge() {
        let mut rng = Rng::new(2, 0);
        let links = links(&wall(1.5, 0.6, 0.03, 0.0, &mut rng), BOTH);
        let out = links.iter().map(|l| l.center.east + l.radius_m).fold(f32::NEG_INFINITY, f32::max);
        assert!(out < 0.6 + 0.035, "{out}");
    }

    #[test]
    fn noisy_points_stay_within_a_centimetre_of_the_chain_whatever_the_shape() {
        let mut rng = Rng::new(3, 0);
        for _ in 0..500 {
            let mut at = Horizontal { north: 1.0 + rng.uniform(), east: -1.0 };
            let mut heading = 1.5_f32;
            let points: Vec<Horizontal> = (0..30)
                .map(|_| {
                    heading += 0.4 * rng.gaussian();
                    at = at.plus(Horizontal::from_bearing(heading).times(0.01 + 0.2 * rng.uniform()));
                    at
                })
                .collect();
            let links = links(&points, BOTH);
            for point in &points {
                let out = links.iter().map(|l| point.minus(l.center).norm() - l.radius_m).fold(f32::INFINITY, f32::min);
                assert!(out < DIP_M + 1e-4, "{out}");
            }
            assert!(links.windows(2).all(|w| w[0].to == w[1].from + 1), "neighbours share a point");
        }
    }

    #[test]
    fn a_lone_hit_becomes_one_small_circle_behind_it() {
        let links = links(&[Horizontal { north: 2.0, east: 0.0 }], BOTH);
        assert_eq!(links.len(), 1);
        assert!((links[0].center.north - 2.05).abs() < 1e-5 && links[0].radius_m == 0.05);
    }
}
