//! Sorting. The standard library's sort is faster, but takes 13 KB of code for each type.

/// Sorts by a key, smallest first, keeping the order of equal items (insertion sort; for lists of a few dozen).
pub fn sort_by_key<T: Copy>(items: &mut [T], key: impl Fn(&T) -> f32) {
    for sorted in 1..items.len() {
        insert(items, sorted, &key);
    }
}

/// Inserts one item among the sorted ones before it.
pub fn insert<T: Copy>(items: &mut [T], sorted: usize, key: impl Fn(&T) -> f32) {
    let Some(item) = items.get(sorted).copied() else { return };
    let its_key = key(&item);
    let mut at = sorted;
    while let Some(before) = at.checked_sub(1)
        && let Some(other) = items.get(before).copied()
        && key(&other).total_cmp(&its_key).is_gt()
    {
        if let Some(slot) = items.get_mut(at) {
            *slot = other;
        }
        at = before;
    }
    if let Some(slot) = items.get_mut(at) {
        *slot = item;
    }
}

/// The value that has `nth` others before it in sorted order, of values none of which is negative; their order is
/// changed. `None` if there are too few. Hoare's selection, with the middle one of three as the pivot.
#[inline(never)]
pub fn nth(values: &mut [f32], nth: usize) -> Option<f32> {
    let (mut left, mut nth) = (values, nth);
    loop {
        // Non-negative floats sort in the order of their bits.
        let middle = left.get(left.len() / 2)?.to_bits();
        let (first, last) = (left.first()?.to_bits(), left.last()?.to_bits());
        let (low, high) = if first < last { (first, last) } else { (last, first) };
        let pivot = middle.clamp(low, high);
        let mut split = parted(left, |value| value < pivot);
        if split == 0 {
            // None is smaller, so the equal ones come first.
            split = parted(left, |value| value <= pivot);
            if nth < split {
                return Some(f32::from_bits(pivot));
            }
        }
        let (before, behind) = left.split_at_mut_checked(split)?;
        (left, nth) = if nth < split { (before, nth) } else { (behind, nth - split) };
    }
}

/// Moves the values whose bits satisfy the condition to the front, and returns how many there are.
fn parted(values: &mut [f32], is_before: impl Fn(u32) -> bool) -> usize {
    let mut count = 0;
    let mut between = values.iter_mut();
    while let Some(value) = between.next() {
        if !is_before(value.to_bits()) {
            let Some(other) = between.rfind(|other| is_before(other.to_bits())) else { break };
            core::mem::swap(value, other);
        }
        count += 1;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::Rng;
    use std::vec::Vec;

    #[test]
    fn the_nth_of_any_values_is_what_sorting_finds() {
        let mut rng = Rng::new(2, 8);
        for length in 0..80_usize {
            // Few different ones, and many.
            for scale in [3.0, 1e6] {
                let values: Vec<f32> = (0..length).map(|_| libm::floorf(scale * libm::fabsf(rng.gaussian()))).collect();
                let mut sorted = values.clone();
                sorted.sort_by(f32::total_cmp);
                for at in [0, 1, length / 2, length.saturating_sub(1), length] {
                    assert_eq!(nth(&mut values.clone(), at), sorted.get(at).copied());
                    assert_eq!(nth(&mut sorted.clone(), at), sorted.get(at).copied());
                }
            }
        }
    }

    #[test]
    fn any_list_is_sorted_as_the_standard_library_does_it() {
        let mut rng = Rng::new(1, 8);
        for length in 0..60 {
            let mut items: std::vec::Vec<(f32, usize)> =
                (0..length).map(|k| (libm::floorf(8.0 * rng.gaussian()), k)).collect();
            let mut expected = items.clone();
            expected.sort_by(|a, b| a.0.total_cmp(&b.0));
            sort_by_key(&mut items, |item| item.0);
            assert_eq!(items, expected);
        }
    }
}
