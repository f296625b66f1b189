//! Putting in order. The standard library's sort is faster, and 13 KB of code for each kind of thing that it sorts.

/// Sorts by a key, smallest first, keeping the order of equal ones (insertion; for lists of some dozens).
pub(crate) fn sort_by_key<T: Copy>(items: &mut [T], key: impl Fn(&T) -> f32) {
    for sorted in 1..items.len() {
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
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

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
