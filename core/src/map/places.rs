//! Small things by the place where they are, so that a circle is compared only with what is near it.
//!
//! A grid of 16 x 16 cells of 25 cm, each the head of a list. It repeats every four metres: what is farther away than it
//! seems is told apart by its distance, which whoever asks tests anyway.

use crate::frame::Horizontal;

/// Most things.
pub(super) const THINGS_MAX: usize = 144;

const SIDE: usize = 16;
const CELLS_PER_M: f32 = 4.0;
/// Makes the cells of what is up to 8 km away positive, so that cutting off rounds down.
const OFFSET: f32 = 32_768.0;
const END: u8 = u8::MAX;

/// Things, each a number below [`THINGS_MAX`].
#[derive(Clone, Debug)]
pub(super) struct Places {
    heads: [u8; SIDE * SIDE],
    next: [u8; THINGS_MAX],
    is_empty: bool,
}

impl Places {
    pub(super) const fn new() -> Self {
        Self { heads: [END; SIDE * SIDE], next: [END; THINGS_MAX], is_empty: true }
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.is_empty
    }

    /// Puts a thing at a place, which is told from the middle of the grid as all places are.
    pub(super) fn put(&mut self, thing: usize, place: Horizontal) {
        let head = &mut self.heads[cell(line(place.north), line(place.east))];
        if let Some(next) = self.next.get_mut(thing) {
            *next = *head;
            *head = thing as u8;
            self.is_empty = false;
        }
    }

    /// Calls for every thing within `reach_m` of a place, and for some others.
    pub(super) fn near(&self, place: Horizontal, reach_m: f32, mut call: impl FnMut(usize)) {
        let lines = |x: f32| {
            let (low, high) = (line(x - reach_m), line(x + reach_m));
            low..=if high - low < SIDE as i32 { high } else { low + SIDE as i32 - 1 }
        };
        let columns = lines(place.east);
        for row in lines(place.north) {
            for column in columns.clone() {
                let mut thing = self.heads[cell(row, column)];
                // The end has no next one.
                while let Some(next) = self.next.get(usize::from(thing)) {
                    call(usize::from(thing));
                    thing = *next;
                }
            }
        }
    }
}

fn line(x: f32) -> i32 {
    (x * CELLS_PER_M + OFFSET) as i32
}

fn cell(row: i32, column: i32) -> usize {
    let last = SIDE as i32 - 1;
    ((row & last) * SIDE as i32 + (column & last)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use std::vec::Vec;

    #[test]
    fn whatever_is_within_reach_is_found_once() {
        let mut rng = Rng::new(1, 0);
        let mut found = 0;
        for _ in 0..300 {
            let mut places = Places::new();
            let at: Vec<Horizontal> = (0..THINGS_MAX)
                .map(|_| Horizontal { north: 30.0 * (rng.uniform() - 0.5), east: 6.0 * (rng.uniform() - 0.5) })
                .collect();
            assert!(places.is_empty());
            for (thing, place) in at.iter().enumerate() {
                places.put(thing, *place);
            }
            let (asked, reach_m) = (at[7].plus(Horizontal { north: rng.uniform(), east: 0.0 }), 3.0 * rng.uniform());
            let mut called = [0; THINGS_MAX];
            places.near(asked, reach_m, |thing| called[thing] += 1);
            for (thing, place) in at.iter().enumerate() {
                assert!(called[thing] <= 1, "{thing} comes twice");
                if place.minus(asked).norm() < reach_m {
                    assert_eq!(called[thing], 1, "{thing} is overlooked");
                    found += 1;
                }
            }
        }
        assert!(found > 1000, "{found}");
    }
}
