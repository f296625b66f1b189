//! Straight pieces of ordered points: split where a point is too far from the chord, then merge neighbours that form
//! one line.
//!
//! The oldest method (Ramer 1972, Duda and Hart 1973; "iterative end point fit"), and a fast one: `n log n` distances.
//! It needs the points in the order of a scan, and one outlier in the middle of a wall cuts the wall in two.

use crate::base::sort::sort_by_key;
use heapless::Vec;

use super::fit::Moments;
use super::{DEVIATION_M, JOINED_M, POINTS_MAX};
use crate::base::ned::Horizontal;
use crate::base::units::between;

/// Smallest number of points of a piece: two always form a line.
const PIECE_MIN: usize = 3;
/// Largest number of pieces.
const PIECES_MAX: usize = POINTS_MAX / PIECE_MIN;
/// Largest number of pieces waiting to be split. The longer part waits, so the length is at least halved each time.
const WAITING_MAX: usize = 8;

/// Neighbouring points `from..to` and their moments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piece {
    pub(super) from: u8,
    pub(super) to: u8,
    pub(super) moments: Moments,
}

/// The straight pieces of ordered points, in their order; two neighbours are no farther apart than `gap_m`.
pub(super) fn pieces(gap_m: f32, points: &[Horizontal]) -> Vec<Piece, PIECES_MAX> {
    let points = points.get(..POINTS_MAX).unwrap_or(points);
    let mut pieces = Vec::new();
    let mut from = 0;
    for to in 1..=points.len() {
        let goes_on = match points.get(to - 1..=to) {
            Some([last, next]) => !(next.minus(*last).norm_squared() > gap_m * gap_m),
            _ => false,
        };
        if !goes_on {
            split(points, from, to, &mut pieces);
            from = to;
        }
    }
    sort_by_key(&mut pieces, |piece| piece.from as f32);
    merge(gap_m, points, &mut pieces);
    pieces
}

/// Splits `from..to` until every piece is straight. Pieces that are too short are left out.
fn split(points: &[Horizontal], from: usize, to: usize, pieces: &mut Vec<Piece, PIECES_MAX>) {
    let mut waiting: Vec<(usize, usize), WAITING_MAX> = Vec::new();
    let mut next = Some((from, to));
    while let Some((from, to)) = next {
        next = waiting.pop();
        let Some(part) = points.get(from..to).filter(|part| part.len() >= PIECE_MIN) else { continue };
        match corner(part) {
            // Cannot fail: pieces do not overlap.
            None => _ = pieces.push(Piece { from: from as u8, to: to as u8, moments: moments_of(part) }),
            // The corner belongs to neither piece: a map rounds it off.
            Some(at) => {
                let (before, after) = ((from, from + at), (from + at + 1, to));
                let (shorter, longer) = if at < part.len() / 2 { (before, after) } else { (after, before) };
                // Cannot fail: the shorter part is at most half as long as the pieces that wait.
                let _ = next.map(|next| waiting.push(next));
                let _ = waiting.push(longer);
                next = Some(shorter);
            }
        }
    }
}

/// The point that is farthest from the chord between the first and the last, if it is too far.
fn corner(part: &[Horizontal]) -> Option<usize> {
    let (first, last) = (*part.first()?, *part.last()?);
    let chord = last.minus(first);
    let length2 = chord.norm_squared();
    let inverse = if length2 > 0.0 { 1.0 / length2 } else { 0.0 };
    let (mut farthest, mut most2) = (None, DEVIATION_M * DEVIATION_M);
    for (index, point) in part.iter().enumerate() {
        let from_first = point.minus(first);
        let share = between(from_first.dot(chord) * inverse, 0.0, 1.0);
        let away2 = from_first.minus(chord.times(share)).norm_squared();
        if away2 > most2 {
            (farthest, most2) = (Some(index), away2);
        }
    }
    farthest
}

/// Merges neighbours that are one thin line together, the points between them included, from the first on.
fn merge(gap_m: f32, points: &[Horizontal], pieces: &mut Vec<Piece, PIECES_MAX>) {
    let mut kept = 0;
    for index in 1..pieces.len() {
        let Some([last, .., piece]) = pieces.get(kept..=index) else { break };
        let (last, piece) = (*last, *piece);
        let between = points.get(usize::from(last.to)..usize::from(piece.from)).unwrap_or_default();
        let both = last.moments.joined(&moments_of(between)).joined(&piece.moments);
        let is_near = points
            .get(usize::from(last.to.max(1)) - 1..usize::from(piece.from) + 1)
            .unwrap_or_default()
            .windows(2)
            .all(|pair| pair[1].minus(pair[0]).norm_squared() <= gap_m * gap_m);
        let is_thin = both.spread().is_some_and(|spread| spread.across_m2 <= JOINED_M * JOINED_M);
        let merged = if is_near && is_thin {
            Piece { from: last.from, to: piece.to, moments: both }
        } else {
            kept += 1;
            piece
        };
        if let Some(slot) = pieces.get_mut(kept) {
            *slot = merged;
        }
    }
    if !pieces.is_empty() {
        pieces.truncate(kept + 1);
    }
}

fn moments_of(points: &[Horizontal]) -> Moments {
    let mut moments = Moments::new();
    for point in points {
        moments.add(*point);
    }
    moments
}
