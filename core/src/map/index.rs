//! Which known circles lie near a place, without asking each of them: two coarse scales, along north and along east, each
//! bin of which holds a bit for every circle that reaches into it. A circle near a place is in the bins of both.
//!
//! It is made anew for each delivery, from the store as it is, and follows what the delivery changes. The scales wrap round
//! every [`BINS`] bins and keep where a circle was before it moved: what is named has to be looked at, and nothing that is
//! near is left out.

use super::{CIRCLES_MAX, Known};
use crate::frame::Horizontal;

/// Bins of a scale; a power of two.
const BINS: usize = 32;
const BINS_PER_M: f32 = 4.0;
const WORDS: usize = CIRCLES_MAX / 32;

/// Places in the store, a bit each. Iterates over them, the first one first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Places([u32; WORDS]);

impl Iterator for Places {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        for (word, bits) in self.0.iter_mut().enumerate() {
            if *bits != 0 {
                let bit = bits.trailing_zeros();
                *bits &= *bits - 1;
                return Some(32 * word + bit as usize);
            }
        }
        None
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Index {
    /// Where the vehicle is, from which the scales are counted.
    origin_ned_m: Horizontal,
    north: [Places; BINS],
    east: [Places; BINS],
    /// Squared distance of each circle from the vehicle.
    squared_m2: [f32; CIRCLES_MAX],
}

impl Index {
    /// Nothing is known around a vehicle.
    pub(super) const fn new(origin_ned_m: Horizontal) -> Self {
        Self {
            origin_ned_m,
            north: [Places([0; WORDS]); BINS],
            east: [Places([0; WORDS]); BINS],
            squared_m2: [0.0; CIRCLES_MAX],
        }
    }

    /// Notes where all circles of a store are.
    pub(super) fn place_all(&mut self, known: &[Known]) {
        for (at, known) in known.iter().enumerate() {
            self.place(at, known);
        }
    }

    /// Notes where a circle is that has a place in the store.
    pub(super) fn place(&mut self, at: usize, known: &Known) {
        let away = known.circle.center_ned_m.minus(self.origin_ned_m);
        if let Some(squared) = self.squared_m2.get_mut(at) {
            *squared = away.norm_squared();
        }
        let (word, bit) = (at / 32, 1 << (at % 32));
        for (scale, middle) in [(&mut self.north, away.north), (&mut self.east, away.east)] {
            for bin in bins(middle, known.radius_m) {
                if let Some(bits) = scale.get_mut(bin).and_then(|places| places.0.get_mut(word)) {
                    *bits |= bit;
                }
            }
        }
    }

    /// Where the circles stand that may come nearer to a place than `reach_m`.
    pub(super) fn near(&self, place_ned_m: Horizontal, reach_m: f32) -> Places {
        let away = place_ned_m.minus(self.origin_ned_m);
        let [north, east] = [(&self.north, away.north), (&self.east, away.east)].map(|(scale, middle)| {
            bins(middle, reach_m).filter_map(|bin| scale.get(bin)).fold(Places::default(), |mut all, places| {
                all.0.iter_mut().zip(places.0).for_each(|(all, word)| *all |= word);
                all
            })
        });
        let mut both = north;
        both.0.iter_mut().zip(east.0).for_each(|(both, word)| *both &= word);
        both
    }

    /// The circle farthest from the vehicle, and its squared distance, if one is farther than that of a newcomer.
    pub(super) fn farther_than(&self, newcomer: &Known) -> Option<usize> {
        let mut most = newcomer.circle.center_ned_m.minus(self.origin_ned_m).norm_squared();
        let mut farthest = None;
        for (at, squared) in self.squared_m2.iter().enumerate() {
            if *squared > most {
                (farthest, most) = (Some(at), *squared);
            }
        }
        farthest
    }
}

/// The bins of a scale that something reaches into.
fn bins(middle_m: f32, reach_m: f32) -> impl Iterator<Item = usize> {
    // A cast saturates.
    let bin = |metres: f32| libm::floorf(metres * BINS_PER_M) as i32;
    let (low, high) = (bin(middle_m - reach_m), bin(middle_m + reach_m));
    let count = high.saturating_sub(low).clamp(0, BINS as i32 - 1) + 1;
    (0..count).map(move |k| (low.wrapping_add(k) & (BINS as i32 - 1)) as usize)
}
