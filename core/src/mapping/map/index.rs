//! Finds the known circles near a place without checking each of them: two coarse scales, along north and along east,
//! whose bins contain a bit for every circle that reaches into them. A circle near a place is in the bins of both
//! scales.
//!
//! It is rebuilt from the store for each delivery, and updated with the delivery's changes. The scales wrap around
//! every [`BINS`] bins, and keep the old bins of a circle that moved. So the result can contain circles that are not
//! near and must be checked, but it never misses a near one.

use core::ops::Range;

use super::{CIRCLES_MAX, Known};
use crate::base::ned::Horizontal;

/// Number of bins of a scale; a power of two.
const BINS: usize = 32;
const BINS_PER_M: f32 = 4.0;
const WORDS: usize = CIRCLES_MAX / 32;
/// The farthest circle is stored per block of this many circles, so that the farthest of all is found, also after a
/// change, without checking all.
const BLOCK: usize = 16;
const BLOCKS: usize = CIRCLES_MAX / BLOCK;

/// A set of places in the store for each bin, one bit per place; those of one word of all sets lie together, since a circle has its bit
/// in one word.
type Scale = [[u32; BINS]; WORDS];

/// A set of places in the store, one bit per place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Places([u32; WORDS]);

/// The places of a set, in ascending order.
pub(super) struct Ascending {
    left: [u32; WORDS],
    word: usize,
}

impl Iterator for Ascending {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        while let Some(bits) = self.left.get_mut(self.word) {
            if *bits != 0 {
                let bit = bits.trailing_zeros();
                *bits &= *bits - 1;
                return Some(32 * self.word + bit as usize);
            }
            self.word += 1;
        }
        None
    }
}

impl IntoIterator for Places {
    type Item = usize;
    type IntoIter = Ascending;

    fn into_iter(self) -> Ascending {
        Ascending { left: self.0, word: 0 }
    }
}

impl Places {
    const NONE: Self = Self([0; WORDS]);

    fn insert(&mut self, at: usize) {
        if let Some(word) = self.0.get_mut(at / 32) {
            *word |= 1 << (at % 32);
        }
    }

    fn remove(&mut self, at: usize) {
        if let Some(word) = self.0.get_mut(at / 32) {
            *word &= !(1 << (at % 32));
        }
    }
}

/// The index; see the module.
#[derive(Clone, Debug)]
pub(super) struct Index {
    /// Position of the vehicle, the origin of the scales.
    origin_ned_m: Horizontal,
    north: Scale,
    east: Scale,
    /// Bits of each circle's squared distance from the vehicle; as integers they have the same order as the distances.
    squared_bits: [u32; CIRCLES_MAX],
    /// The place of the farthest circle of each block.
    farthest: [u8; BLOCKS],
    /// Circles that are to be forgotten. They are never reported as near, and are replaced first.
    doomed: Places,
}

impl Index {
    /// An empty index around a vehicle.
    pub(super) fn new(origin_ned_m: Horizontal) -> Self {
        Self {
            origin_ned_m,
            north: [[0; BINS]; WORDS],
            east: [[0; BINS]; WORDS],
            squared_bits: [0; CIRCLES_MAX],
            farthest: core::array::from_fn(|block| (block * BLOCK) as u8),
            doomed: Places::NONE,
        }
    }

    /// Records the positions of all circles of a store.
    pub(super) fn place_all(&mut self, known: &[Known]) {
        for (at, known) in known.iter().enumerate() {
            let squared_bits = self.mark(at, known);
            if let Some(squared) = self.squared_bits.get_mut(at) {
                *squared = squared_bits;
            }
        }
        for (block, members) in self.squared_bits.chunks_exact(BLOCK).enumerate() {
            if let Some(farthest) = self.farthest.get_mut(block) {
                *farthest = (block * BLOCK + last_greatest(members)) as u8;
            }
        }
    }

    /// Records the position of a circle in the store.
    #[inline(never)]
    pub(super) fn place(&mut self, at: usize, known: &Known) {
        let squared_bits = self.mark(at, known);
        self.place_at(at, squared_bits);
    }

    /// Records into which bins a circle reaches; returns the bits of its squared distance.
    fn mark(&mut self, at: usize, known: &Known) -> u32 {
        let away = known.center_ned_m.minus(self.origin_ned_m);
        for (scale, middle_m) in [(&mut self.north, away.north), (&mut self.east, away.east)] {
            let Some(word) = scale.get_mut(at / 32) else { continue };
            for bin in bins(middle_m, known.radius_m) {
                word[bin % BINS] |= 1 << (at % 32);
            }
        }
        away.norm_squared().to_bits()
    }

    fn place_at(&mut self, at: usize, squared_bits: u32) {
        let (block, first) = (at / BLOCK, at / BLOCK * BLOCK);
        let (Some(squared), Some(farthest)) = (self.squared_bits.get_mut(at), self.farthest.get_mut(block)) else {
            return;
        };
        let has_come_nearer = squared_bits < *squared;
        *squared = squared_bits;
        if has_come_nearer && usize::from(*farthest) == at {
            let members = self.squared_bits.get(first..first + BLOCK).unwrap_or_default();
            *farthest = (first + last_greatest(members)) as u8;
        } else if self.squared_bits.get(usize::from(*farthest)) <= Some(&squared_bits) {
            *farthest = at as u8;
        }
    }

    /// Marks a circle as to be forgotten.
    pub(super) fn doom(&mut self, at: usize) {
        self.doomed.insert(at);
    }

    /// The places in the store of all circles that may reach to within `reach_m` of a position.
    #[inline(never)]
    pub(super) fn near(&self, place_ned_m: Horizontal, reach_m: f32) -> Places {
        let away = place_ned_m.minus(self.origin_ned_m);
        let within = |scale: &Scale, middle_m| {
            let mut all = [0; WORDS];
            for bin in bins(middle_m, reach_m) {
                for (all, word) in all.iter_mut().zip(scale) {
                    *all |= word[bin % BINS];
                }
            }
            all
        };
        let mut both = within(&self.north, away.north);
        for ((both, east), doomed) in both.iter_mut().zip(within(&self.east, away.east)).zip(self.doomed.0) {
            *both &= east & !doomed;
        }
        Places(both)
    }

    /// The place for a new circle in a full store: that of a circle to be forgotten, or else that of the farthest, if
    /// it is farther away than the new one. Also returns whether it is that of a circle to be forgotten.
    #[inline(never)]
    pub(super) fn give_way(&mut self, newcomer: &Known) -> (Option<usize>, bool) {
        if let Some(at) = self.doomed.into_iter().next() {
            self.doomed.remove(at);
            return (Some(at), true);
        }
        let squared = |at: u8| self.squared_bits.get(usize::from(at)).copied().unwrap_or(0);
        let farthest = self.farthest.iter().copied().max_by_key(|at| squared(*at)).unwrap_or(0);
        let least = newcomer.center_ned_m.minus(self.origin_ned_m).norm_squared().to_bits();
        ((squared(farthest) > least).then_some(usize::from(farthest)), false)
    }
}

/// Index of the greatest; the last of equal ones.
fn last_greatest(members: &[u32]) -> usize {
    let mut greatest = (0, 0);
    for (at, squared) in members.iter().enumerate() {
        if *squared >= greatest.1 {
            greatest = (at, *squared);
        }
    }
    greatest.0
}

/// Bins of a scale, to be taken modulo [`BINS`].
type Bins = Range<usize>;

/// The bins of a scale within a reach of a position.
fn bins(middle_m: f32, reach_m: f32) -> Bins {
    // Rounded down; a cast saturates.
    let bin = |metres: f32| {
        let bins = metres * BINS_PER_M;
        (bins as i32).wrapping_sub(i32::from(bins < (bins as i32) as f32))
    };
    let (low, high) = (bin(middle_m - reach_m), bin(middle_m + reach_m));
    let count = high.saturating_sub(low).clamp(0, BINS as i32 - 1) as usize + 1;
    let first = low as usize % BINS;
    first..first + count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use crate::mapping::map::{Origin, tests};
    use std::vec::Vec;

    fn known(rng: &mut Rng, spread_m: f32) -> Known {
        let center_ned_m = Horizontal { north: spread_m * rng.gaussian(), east: spread_m * rng.gaussian() };
        tests::known(center_ned_m, 0.05 + rng.uniform() * rng.uniform(), Origin::Given)
    }

    #[test]
    fn nothing_that_is_near_is_left_out_and_little_else_is_named_except_what_is_to_be_forgotten() {
        let mut rng = Rng::new(1, 9);
        let (mut near, mut named) = (0, 0);
        for (spread_m, far_m) in [(0.5, 0.0), (2.0, 3.0), (5.0, -900.0), (60.0, 20_000.0)] {
            for _ in 0..30 {
                let origin = Horizontal { north: far_m, east: -far_m };
                let all: Vec<Known> = (0..CIRCLES_MAX)
                    .map(|_| {
                        let mut known = known(&mut rng, spread_m);
                        known.center_ned_m = known.center_ned_m.plus(origin);
                        known
                    })
                    .collect();
                let mut index = Index::new(origin);
                index.place_all(&all);
                index.doom(7);
                for _ in 0..20 {
                    let (place, reach_m) =
                        (all[(rng.uniform() * (CIRCLES_MAX - 1) as f32) as usize].center_ned_m, rng.uniform());
                    let found: Vec<usize> = index.near(place, reach_m).into_iter().collect();
                    assert!(found.windows(2).all(|pair| pair[0] < pair[1]) && !found.contains(&7));
                    for (at, known) in all.iter().enumerate().filter(|(at, _)| *at != 7) {
                        let is_near = known.center_ned_m.minus(place).norm() < 0.999 * (known.radius_m + reach_m);
                        assert!(!is_near || found.contains(&at), "{at}: {known:?} {place:?} {reach_m}");
                        near += usize::from(is_near && spread_m == 2.0);
                    }
                    named += if spread_m == 2.0 { found.len() } else { 0 };
                }
            }
        }
        assert!(named < 3 * near, "{named} {near}");
    }

    #[test]
    fn what_is_to_be_forgotten_gives_way_first_and_then_the_farthest_unless_the_newcomer_is_farther() {
        let mut rng = Rng::new(2, 9);
        let mut all: Vec<Known> = (0..CIRCLES_MAX).map(|_| known(&mut rng, 2.0)).collect();
        all[90].center_ned_m = Horizontal { north: 50.0, east: 0.0 };
        let mut index = Index::new(Horizontal::default());
        index.place_all(&all);
        index.doom(30);
        let mut newcomer = known(&mut rng, 1.0);
        assert_eq!(index.give_way(&newcomer), (Some(30), true));
        assert_eq!(index.give_way(&newcomer), (Some(90), false));
        newcomer.center_ned_m = Horizontal { north: 0.0, east: 51.0 };
        assert_eq!(index.give_way(&newcomer), (None, false));
    }

    #[test]
    fn what_gives_way_is_what_a_search_through_all_finds_however_circles_move_and_are_replaced() {
        let mut rng = Rng::new(3, 9);
        let far = |known: &Known| known.center_ned_m.norm_squared();
        for _ in 0..20 {
            let mut all: Vec<Known> = (0..CIRCLES_MAX).map(|_| known(&mut rng, 2.0)).collect();
            let mut index = Index::new(Horizontal::default());
            index.place_all(&all);
            for round in 0..500 {
                for _ in 0..round % 4 {
                    let at = (rng.uniform() * (CIRCLES_MAX - 1) as f32) as usize;
                    all[at] = known(&mut rng, 2.0);
                    index.place(at, &all[at]);
                }
                let newcomer = known(&mut rng, 2.0);
                let farthest = all.iter().map(far).fold(0.0, f32::max);
                let (place, is_doomed) = index.give_way(&newcomer);
                assert!(!is_doomed);
                assert_eq!(place.map(|at| far(&all[at])), Some(farthest).filter(|most| *most > far(&newcomer)));
                if let Some(at) = place {
                    index.place(at, &newcomer);
                    all[at] = newcomer;
                }
            }
        }
    }
}
